"""The exact minimum time where segments are a billion times as long as others."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites import catalogue as suite

POWERS = (-10, -20, -30, -40)  # of 2: whatever is added to 1 and 0.5 stays exact


def solved(problem: Problem, starts: int = 8) -> float:
    """The duration, s, of an answer that keeps every limit; most starts succeeded.

    The judge mends what the last place of a coordinate is of the shortest displacement.
    """
    solution = Exact(starts).solve(problem)
    assert solution.trajectory is not None, solution.message
    assert np.isfinite(solution.stats["start_duration"]).mean() > 0.5
    certificate = verify(problem, solution.trajectory)
    lengths = np.abs(problem.displacements)
    last_place = np.spacing(np.abs(problem.waypoints).max()) / lengths[lengths > 0].min()
    assert certificate.valid
    assert certificate.dilation <= 1 + 1e-9 + last_place
    return solution.trajectory.duration


def limited(waypoints: object, joints: int) -> Problem:
    return Problem(waypoints, Limits([1.0] * joints, [2.0] * joints))


@pytest.mark.parametrize("power", [-10, -20, -28])
def test_tiny_segments_on_the_way_cost_nothing(power: int) -> None:
    tiny = 2.0**power
    problem = limited([[0], [1], [1 + tiny], [1 + 2 * tiny], [2]], 1)
    assert solved(problem) == pytest.approx(2 / 1 + 1 / 2, rel=1e-8)  # h/V + V/A


@pytest.mark.parametrize("power", POWERS[1:])
def test_a_tiny_segment_decides_the_direction_of_the_passage(power: int) -> None:
    """Velocities `(v, −v)`, so one joint overshoots: the second one's turn decides `v`.

    Reaching 1 at `v` takes `3/2 − v/2 + v²/4`, reaching 0.5 at `−v` `1 + v/2 + v²/4`; both alike at
    `v = 1/2`, and the way on is the same backwards.
    """
    tiny = 2.0**power
    problem = limited([[0, 0], [1, 0.5], [1 + tiny, 0.5 - tiny], [2, 1]], 2)
    assert solved(problem) == pytest.approx(2 * (1 + 1 / 4 + 1 / 16), abs=2 * tiny + 1e-8)


def test_a_rounding_unit_is_a_segment() -> None:
    (problem,) = (p for p in suite.problems("edges") if p.name == "edges-one-ulp")
    assert solved(problem) == pytest.approx(2 / 1 + 1 / 2, rel=1e-8)


@pytest.mark.parametrize("scale", [1e-9, 1e-3, 1e3])
def test_tiny_turns_among_tiny_turns_scale_as_roots(scale: float) -> None:
    """Without velocity limits, waypoints `c` times as far take `√c` times as long."""
    rng = np.random.default_rng(0)
    steps = rng.uniform(-1, 1, (8, 4)) * 10.0 ** rng.uniform(-6, 0, (8, 1))
    waypoints = np.vstack([np.zeros(4), np.cumsum(steps, axis=0)])
    limits = Limits([1e3] * 4, [1.0, 2.0, 3.0, 4.0])
    durations = [solved(Problem(c * waypoints, limits), starts=2) for c in (1.0, scale)]
    assert durations[1] == pytest.approx(np.sqrt(scale) * durations[0], rel=1e-7)
