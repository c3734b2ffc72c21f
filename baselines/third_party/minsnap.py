"""Minimum-snap splines, from the package `minsnap-trajectories` (Mellinger and Kumar 2011).

Of all splines of one degree through the waypoints at given times the one with the least snap (or
jerk, or acceleration) squared; the whole is then dilated until the limits hold, which leaves the
path as it is. Its polynomials are the answer: nothing is sampled.

What is chosen, and whence:

- the first setting: degree 8, least jerk and snap, continuous to the third derivative, closed form,
  equal times: `example/example.py` and README (repository Hs293Go/minsnap_trajectories);
- the others optimise the ratios of the times, as Mellinger and Kumar do (ICRA 2011, optimal segment
  times); what is minimised is the dilated duration, which is judged here, not the snap. Where that
  leaves position limits, which the package does not know, the ratios of the start are kept;
- their degree is 5: the closed form is that of least jerk then, and is wrong beyond (in version
  0.3, between two points at rest and with degree 8, it leaves 1222 where 720 is least).

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
from numpy.typing import NDArray

from baselines.third_party import Rival, in_own_units
from baselines.topp_ra import Knots, sampled_dilation, steps
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners.planner import backend

Array = NDArray[np.float64]

# Of the derivatives that are kept small.
_ORDERS: dict[str, int | tuple[int, ...]] = {
    "acceleration": 2,
    "jerk": 3,
    "snap": 4,
    "jerk and snap": (3, 4),
}
# Splines tried for each ratio of times.
_SPLINES_PER_RATIO = 40


@dataclass(frozen=True)
class MinSnap(Rival):
    """Splines of least snap, jerk or acceleration, dilated; the best of twelve, times optimised.

    - `tries`: how many settings. 1: degree 8, equal times, as the package's own example has it.
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

    @in_own_units
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
        # the search knows no position limits: where it leaves them, its start may not
        valid = [answer for answer in answers if verify(problem, answer).valid]
        shortest = min(valid or answers, key=lambda answer: answer.duration)
        return Solution(Status.SOLVED, shortest)


def spline(
    problem: Problem,
    durations: Array,
    order: int | tuple[int, ...],
    degree: int,
    package: Any,
) -> Trajectory:
    """The package's spline of a degree, its segments of such durations, s."""
    times = np.r_[0.0, np.cumsum(durations)]
    waypoints = [
        package.Waypoint(time=float(t), position=q)
        for t, q in zip(times, problem.waypoints, strict=True)
    ]
    with warnings.catch_warnings():
        # of ill-conditioned systems: what comes of them is judged like anything else
        warnings.simplefilter("ignore")
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


def optimised(
    problem: Problem,
    durations: Array,
    at: Callable[[Array], Trajectory],
) -> Array:
    """The times of the segments whose spline is shortest once dilated, by Powell's method.

    Args:
        problem: with the limits.
        durations: where the search begins, s, `(segments,)`. Only their ratios matter.
        at: the spline at such times.
    """
    import scipy  # late: planners that are only listed need none of it

    def dilated(logarithms: Array) -> float:
        timed = at(durations * np.exp(logarithms))
        return sampled_dilation(problem.limits, timed) * timed.duration

    evaluations = _SPLINES_PER_RATIO * problem.segments
    start = np.zeros(problem.segments)
    options = {"maxfev": evaluations, "ftol": 1e-4, "xtol": 1e-3}
    found = scipy.optimize.minimize(dilated, start, method="Powell", options=options)
    return np.asarray(durations * np.exp(found.x))
