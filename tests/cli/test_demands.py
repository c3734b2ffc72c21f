"""What a file asks of the way, through the commands: planned, written, read again, judged."""

from __future__ import annotations

import json

import pytest

from baselines.exact.acceleration import Exact
from trajopt import Limits, Problem, judge

TEXT = """
waypoints = [[0.0, 0.0], [1.0, 0.5], [2.0, 0.0], [1.1, -0.73], [0.0, 0.0]]
{demand}
units = {{ waypoints = "rad", limits = "rad" }}
[limits]
velocity = [2, 2]
acceleration = [4, 3]
"""


@pytest.mark.parametrize(
    "demand",
    [
        "tolerance = [0.05, 0.02]",
        "closed = true",
        "dwell = [0, 0.3, 0, 0, 0.1]",
        "least_times = [0, 1.50033, 0, 0]",
        "given_times = [1.2, 1.2, 1.2, 1.2]",
    ],
)
def test_a_motion_is_planned_written_read_and_judged(run, demand):
    text = TEXT.format(demand=demand)
    code, out, _ = run("plan asked.toml --out motion.csv", asked__toml=text)
    assert code == 0
    assert "it keeps every limit" in " ".join(out.split())
    code, out, _ = run("judge motion.csv asked.toml --json")
    assert code == 0
    judged = json.loads(out)
    assert judged["feasible"]
    if demand.startswith("given"):
        assert judged["waypoint_times"] == pytest.approx([0, 1.2, 2.4, 3.6, 4.8], rel=1e-9)


def test_a_motion_that_passes_near_is_compared_with_the_optimum_of_its_tolerance():
    """There and back at velocity 1 and acceleration 2: 2 (1 − 0.15 + 0.5) s."""
    exactly = Problem([[0.0], [1.0], [0.0]], Limits([1.0], [2.0]))
    near = Exact().solve(Problem([[0.0], [0.9], [0.0]], exactly.limits)).trajectory
    found = judge(exactly, near, via_tolerance=0.15)
    assert found.tolerance_needed
    assert found.optimum_within == pytest.approx(2.7, rel=1e-9)
    assert found.gap == pytest.approx(0.0, abs=1e-9)  # through the points that it passes
    assert found.as_dict()["optimum_within_tolerance"] == found.optimum_within
    assert judge(exactly, near, via_tolerance=0.05).optimum_within is None
