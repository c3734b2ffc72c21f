"""What the judge says of a motion, in words: 1 rad from rest to rest by two parabolas.

With an acceleration a it takes 2 s / sqrt(a) and passes 1 rad/s sqrt(a).
"""

from __future__ import annotations

import pytest

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify


def told(limit, jerk=None):
    """The certificate of the motion of 1 rad/s² under another acceleration limit."""
    parabolas = [[[0.5], [-0.5]], [[0.0], [1.0]], [[0.0], [0.5]]]
    motion = Trajectory([0.0, 1.0, 2.0], parabolas, [0.0, 2.0])
    limits = Limits([10.0], [limit], None if jerk is None else [jerk])
    return verify(Problem([[0.0], [1.0]], limits), motion)


@pytest.mark.parametrize(
    ("limit", "verdict", "lines"),
    [
        (1.0, "feasible", ["It keeps every limit."]),
        (
            4.0,
            "feasible",
            ["It could run 2.000000 times as fast within every limit, in 1.000000 s."],
        ),
        (
            0.25,
            "not feasible",
            [
                "Slowed down 2.000000 times, to 4.000000 s, it keeps every limit.",
                "To plan it again, multiply the planner's limits: velocity 0.5000, "
                "acceleration 0.2500.",
            ],
        ),
    ],
)
def test_how_much_slower_or_faster_it_keeps_every_limit(limit, verdict, lines):
    certificate = told(limit)
    assert (certificate.verdict, list(certificate.lines())) == (verdict, lines)
    assert certificate.reason == verdict


def test_what_no_dilation_mends_and_what_one_would():
    certificate = told(0.25, jerk=1.0)
    flaw = "joint 1 at 1 s: acceleration jumps by 2 rad/s²"
    assert certificate.reason == f"not feasible: {flaw}"
    first, second = certificate.lines()
    assert first.startswith(f"Slowing down does not help: {flaw}")
    assert second == "Besides, its limits need it 2.000000 times as slow."


def test_the_highest_peak_names_its_limit_and_joint():
    problem = Problem([[0.0], [1.0]], Limits([10.0], [0.25]))
    assert told(0.25).peak(problem) == "its peak is 4.00000 of the acceleration limit of joint 1"
