"""Minimum-snap splines, from the package `minsnap-trajectories` (Mellinger and Kumar 2011).

The package returns the spline of one degree through the waypoints at given times with the least
integral of squared snap (or jerk, or acceleration). The spline is then dilated until the limits
hold, which does not change the path. Its polynomials are the answer: nothing is sampled.

Choices and their sources:

- the first setting: degree 8, least jerk and snap, continuous to the third derivative, closed form,
  equal times: `example/example.py` and README (repository Hs293Go/minsnap_trajectories);
- the other settings optimise the ratios of the times, as Mellinger and Kumar do (ICRA 2011, optimal
  segment times). They minimise the dilated duration instead of the snap. The first ratios are kept
  if the result leaves its position limits, which the package does not support;
- their degree is 5, where the closed form has the least jerk. It is wrong for higher degrees
  (version 0.3, degree 8, two points at rest: 1222, but 720 is the minimum).

    from baselines.third_party.minsnap import MinSnap
    solution = MinSnap().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.third_party import Rival
from baselines.topp_ra import Knots, sampled_dilation, steps
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend
from trajopt.planners.reductions import OWN_UNITS, reduced

# Orders of the derivatives that are minimised.
_ORDERS: dict[str, int | tuple[int, ...]] = {
    "acceleration": 2,
    "jerk": 3,
    "snap": 4,
    "jerk and snap": (3, 4),
}
# Evaluations of the search, per segment.
_EVALUATIONS_PER_SEGMENT = 40


@dataclass(frozen=True)
class MinSnap(Rival):
    """Splines of least snap, jerk or acceleration, dilated; the best of twelve, times optimised.

    - `tries`: number of settings. 1: degree 8, equal times, as in the package's own example.
    """

    requires = ("minsnap_trajectories",)
    extra = "minsnap"
    knows = ("velocity", "acceleration", "jerk")
    settings = (
        ("uniform", "jerk and snap", 8),
        *(("limit", minimised, 5) for minimised in ("jerk", "snap", "acceleration")),
        *(("chord", minimised, 5) for minimised in ("jerk", "snap", "acceleration")),
        *(("centripetal", minimised, 5) for minimised in ("jerk", "snap", "acceleration")),
        *(("uniform", minimised, 5) for minimised in ("jerk", "snap")),
    )

    @reduced(OWN_UNITS)
    def tried(self, problem: Problem, knots: Knots, minimised: str, degree: int) -> Solution:
        package = backend("minsnap_trajectories", self.extra)
        order = _ORDERS[minimised]

        def at(durations: Array) -> Trajectory:
            return spline(problem, durations, order, degree, package)

        ratios = [steps(problem, knots)]
        answers = []
        try:
            if degree == 5:
                ratios.append(optimised(problem, ratios[0], at))
            for durations in ratios:
                timed = at(durations)
                answers.append(timed.dilated(verify(problem, timed).dilation))
        except (RuntimeError, ValueError) as error:
            return Solution(Status.FAILED, message=str(error))
        # the search ignores position limits: its start may keep them if its end does not
        valid = [answer for answer in answers if verify(problem, answer).valid]
        shortest = min(valid or answers, key=lambda answer: answer.duration)
        return Solution(Status.SOLVED, shortest)


def spline(
    problem: Problem, durations: Array, order: int | tuple[int, ...], degree: int, package: Any
) -> Trajectory:
    """Return the package's spline of a degree, with segments of these durations, s."""
    times = np.r_[0.0, np.cumsum(durations)]
    waypoints = [
        package.Waypoint(time=float(t), position=q)
        for t, q in zip(times, problem.waypoints, strict=True)
    ]
    with warnings.catch_warnings():
        # the package warns of ill-conditioned systems; their results are judged too
        warnings.simplefilter("ignore")
        with inside_library():
            found = package.generate_trajectory(
                waypoints,
                degree=degree,
                idx_minimized_orders=order,
                num_continuous_orders=3,
                algorithm="closed-form",
            )
    # (pieces, powers, joints), lowest power first
    coefficients = np.moveaxis(found.coefficients, 0, 1)[::-1]
    return Trajectory(times, coefficients, times)


def optimised(problem: Problem, durations: Array, at: Callable[[Array], Trajectory]) -> Array:
    """Return the segment times whose spline is shortest once dilated, by Powell's method.

    Args:
        problem: Its limits count.
        durations: First times of the search, s, `(segments,)`. Only their ratios matter.
        at: Returns the spline of given times.
    """
    import scipy  # late: planners that are only listed need none of it

    def dilated(logarithms: Array) -> float:
        timed = at(durations * np.exp(logarithms))
        return sampled_dilation(problem.limits, timed) * timed.duration

    evaluations = _EVALUATIONS_PER_SEGMENT * problem.segments
    start = np.zeros(problem.segments)
    options = {"maxfev": evaluations, "ftol": 1e-4, "xtol": 1e-3}
    found = scipy.optimize.minimize(dilated, start, method="Powell", options=options)
    return durations * np.exp(found.x)
