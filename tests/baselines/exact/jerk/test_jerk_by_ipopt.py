"""IPOPT on section 5's program: closed forms, Ruckig, and the optimum by the other method."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.jerk import ExactJerk
from baselines.ruckig_ import RuckigStop
from experiments.known_optima import end_to_end, one_way
from trajopt import Limits, Problem, Status, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem

IPOPT = ExactJerk(solver="ipopt")


def solved(problem: Problem, planner: ExactJerk = IPOPT) -> Trajectory:
    """The motion of IPOPT's optimum, which keeps every limit."""
    solution = planner.solve(problem)
    assert solution.status is Status.SOLVED, solution.message
    assert solution.trajectory is not None
    certificate = verify(problem, solution.trajectory)
    assert certificate.flaws == ()
    assert certificate.dilation <= 1 + 1e-9
    return solution.trajectory


def one_joint(*waypoints: float, jerk: float = 5.0) -> Problem:
    return Problem([[q] for q in waypoints], Limits([1.0], [2.0], [jerk]))


@pytest.mark.parametrize(
    ("problem", "optimum"),
    [
        (one_joint(0, 1.5), 1.5 / 1 + 1 / 2 + 2 / 5),  # seven phases: h/V + V/A + A/J
        (one_joint(0, 0.4, 1.0, 1.5), 1.5 / 1 + 1 / 2 + 2 / 5),  # waypoints on the way cost nothing
        (one_joint(0, 1e-6), 4 * np.cbrt(1e-6 / 10)),  # four phases: 4 ∛(h/2J)
        (one_joint(0, 1e4, jerk=2e5), 1e4 + 1 / 2 + 1e-5),
    ],
)
def test_closed_forms(problem: Problem, optimum: float) -> None:
    assert solved(problem).duration == pytest.approx(optimum, rel=1e-10)


@pytest.mark.parametrize("seed", range(6))
def test_two_waypoints_equal_ruckig(seed: int) -> None:
    problem = random_problem(seed, waypoints=2, jerk=True)
    ruckig = RuckigStop().solve(problem).trajectory
    assert ruckig is not None
    assert solved(problem).duration == pytest.approx(ruckig.duration, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_one_way_in_one_joint_is_ruckigs_from_end_to_end(seed: int) -> None:
    problem = one_way(seed)
    assert solved(problem).duration == pytest.approx(end_to_end(problem), rel=1e-9)


ASYMMETRIC = Problem([[0.0], [1.0], [0.4]], Limits([[-1, 0.6]], [[-3.0, 2.0]], [[-4.0, 9.0]]))
# the second joint has no jerk limit
MIXED = Problem([[0.0, 0], [0.5, 1], [1.0, 0.5]], Limits([1, 2], [3, 4], [8.0, np.inf]))
RESTING = Problem([[0.0, 1], [0.5, 1], [0.2, 1]], Limits([1, 1], [2, 2], [8.0, 8.0]))
WITHOUT = load("six-axis").without("jerk", "position")


@pytest.mark.parametrize(
    "problem",
    [
        ASYMMETRIC,
        MIXED,
        RESTING,
        WITHOUT,
        load("jerk-limit"),
        *(random_problem(seed, jerk=True) for seed in (1, 3, 5, 7, 8, 14, 16)),
    ],
)
def test_the_other_method_finds_the_same_optimum(problem: Problem) -> None:
    problem = problem.without("position")
    own = solved(problem, ExactJerk()).duration
    assert solved(problem).duration == pytest.approx(own, rel=1e-9)


def test_where_ipopt_finds_none_there_is_no_answer(monkeypatch: pytest.MonkeyPatch) -> None:
    """No other method steps in: the message has IPOPT's own words."""
    from baselines.exact.jerk import by_ipopt

    monkeypatch.setitem(by_ipopt._OPTIONS, "max_iter", 1)
    by_ipopt._solver.cache_clear()
    solution = IPOPT.solve(one_joint(0, 1.5))
    by_ipopt._solver.cache_clear()
    assert solution.status is Status.FAILED
    assert solution.message == "no start succeeded: Maximum_Iterations_Exceeded"
