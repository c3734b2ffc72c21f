"""Minimum-snap splines, from the package `minsnap-trajectories` (Mellinger and Kumar 2011).

Of all splines of one degree through the waypoints at given times the one with the least snap (or
jerk, or acceleration) squared. The package has a closed form, which is right for degree 5 (that of
least jerk) and not beyond (in version 0.3: between two points at rest and with degree 8 it leaves
1222 where 720 is least), and a slow quadratic program. The times are the user's: here they are in
the proportions of a rule, and the whole is dilated until the limits hold. Slower or faster, the
spline of least snap stays the same path. Its polynomials are the answer: nothing is sampled.

    from baselines.third_party.minsnap import MinSnap
    solution = MinSnap().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from itertools import product
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from baselines.third_party import imported, in_own_units
from baselines.topp_ra import best_of, steps_by_rule
from trajopt.planner import Planner, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]

# Of the derivative that is kept small.
_ORDERS = {"acceleration": 2, "jerk": 3, "snap": 4}


@dataclass(frozen=True)
class MinSnap(Planner):
    """Splines of least snap, jerk or acceleration, dilated; the best of its rules by default.

    - `knots`: times from waypoint to waypoint are in proportion to 1, to the distance, to its
      square root, or to the time from stop to stop;
    - `minimised`: which derivative's square;
    - `degree`: of the polynomials;
    - `algorithm`: the package's closed form, or its quadratic program.
    """

    knots: Literal["uniform", "chord", "centripetal", "limit", "best"] = "best"
    minimised: Literal["acceleration", "jerk", "snap", "best"] = "best"
    degree: Literal[5, 6, 7, 8, 9] = 5
    algorithm: Literal["closed-form", "constrained"] = "closed-form"

    on_request = True
    requires = ("minsnap_trajectories",)
    extra = "minsnap"
    knows = ("velocity", "acceleration", "jerk")

    @passing_once
    @in_own_units
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The briefest after dilation. `stats`: its rules, and every rule's result."""
        package, seconds = imported("minsnap_trajectories", self.extra)
        steps = steps_by_rule(problem)
        knots = [self.knots] if self.knots != "best" else list(steps)
        orders = [self.minimised] if self.minimised != "best" else list(_ORDERS)
        solutions = {}
        for rule, minimised in product(knots, orders):
            times = np.r_[0.0, np.cumsum(steps[rule])]
            solution = self._at(problem, times, _ORDERS[minimised], package)
            solutions[f"{rule}/{minimised}"] = solution
        return replace(best_of(problem, solutions), setup_time=seconds)

    def _at(
        self,
        problem: Problem,
        times: Array,
        order: int,
        package: Any,
    ) -> Solution:
        waypoints = [
            package.Waypoint(time=float(t), position=q)
            for t, q in zip(times, problem.waypoints, strict=True)
        ]
        with warnings.catch_warnings():
            # of ill-conditioned systems: what comes of them is judged like anything else
            warnings.simplefilter("ignore")
            try:
                spline = package.generate_trajectory(
                    waypoints,
                    degree=self.degree,
                    idx_minimized_orders=order,
                    num_continuous_orders=3,
                    algorithm=self.algorithm,
                )
            except (RuntimeError, ValueError) as error:
                return Solution(Status.FAILED, message=str(error))
        # (pieces, powers, joints), lowest power first
        coefficients = np.moveaxis(spline.coefficients, 0, 1)[::-1]
        timed = Trajectory(times, coefficients, times)
        cheapest = verify(problem, timed).dilation
        return Solution(Status.SOLVED, timed.dilated(cheapest))
