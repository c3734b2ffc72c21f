"""COPP: the fastest timing of a path under jerk limits too, from the package `copp-py`.

The path is a cubic spline through the waypoints. Without jerk limits COPP's reachability analysis
gives path speeds between which the path acceleration is constant: composed exactly. With them its
second-order cone program gives path speed and acceleration at the gridpoints, from a jerk limit
that is linearised around the previous answer, again and again. What runs between the gridpoints is
then the quintic Hermite piece, as a controller would run it.

    from baselines.third_party.copp import Copp
    solution = Copp().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from baselines.third_party import imported, in_own_units
from baselines.topp_ra import Grid, best_of, cut, rules, spline, timed, unit_path
from trajopt import polynomials
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Copp(Planner):
    """COPP along a cubic spline, jerk limits kept at gridpoints; the best of twelve splines.

    - `knots`: the spline's parameter from waypoint to waypoint grows by 1, by the chord's length,
      by its square root, or by the time from stop to stop;
    - `ends`: the spline's end rule;
    - `gridpoints`: about how many intervals the path is cut into;
    - `linearisations`: of the jerk limit, each around the answer before.
    """

    knots: Literal["uniform", "chord", "centripetal", "limit", "best"] = "best"
    ends: Literal["not-a-knot", "natural", "clamped", "best"] = "best"
    gridpoints: int = 300
    linearisations: int = 3

    on_request = True
    requires = ("copp_py",)
    extra = "copp"
    knows = ("velocity", "acceleration", "jerk")

    def __post_init__(self) -> None:
        if self.gridpoints < 10:
            raise InvalidInput("gridpoints", "at least 10", value=self.gridpoints)
        if self.linearisations < 1:
            raise InvalidInput("linearisations", "at least 1", value=self.linearisations)

    @passing_once
    @in_own_units
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of its paths' timings. `stats`: the path, and every path's result."""
        copp, seconds = imported("copp_py", self.extra)
        solutions = {}
        for knots, ends in rules(self.knots, self.ends):
            path = spline(problem, knots, ends)
            try:
                trajectory = self._along(problem, path, copp)
            except (copp.CoppError, copp.ConstraintError) as error:
                solution = Solution(Status.FAILED, message=f"COPP: {error}")
            else:
                solution = Solution(Status.SOLVED, trajectory)
            solutions[f"{knots}/{ends}"] = solution
        return replace(best_of(problem, solutions), setup_time=seconds)

    def _along(self, problem: Problem, path: Trajectory, copp: Any) -> Trajectory:
        # the parameter about as long as the motion takes: path speeds near 1
        unit = unit_path(path, self.gridpoints)
        scale = verify(problem, unit).dilation
        grid = cut(unit)
        at = grid.at * scale
        derivatives = _derivatives(grid)
        for order, derivative in enumerate(derivatives):
            derivative /= scale**order

        robot = copp.Robot(problem.joints, capacity=len(at))
        robot.append_s(at)
        *up_to_second, third = derivatives
        robot.set_q(*up_to_second, 0, dddq=third)
        limits = problem.limits
        everywhere = {"start_idx_s": 0, "length": len(at)}
        robot.add_velocity_limits(*_sides(limits.velocity), **everywhere)
        robot.add_acceleration_limits(*_sides(limits.acceleration), **everywhere)
        topp2 = copp.solver.topp2_ra
        problem2 = topp2.Problem(robot.constraints, (0, len(at) - 1), (0.0, 0.0))
        squared = np.asarray(topp2.solve(problem2))
        if not problem.has("jerk"):
            speeds = np.sqrt(squared) / scale
            return timed(grid, speeds, unit.waypoint_times)

        robot.add_jerk_limits(*_sides(limits.jerk), **everywhere)
        profile = self._third_order(copp, robot, squared)
        _, times = copp.interpolation.s_to_t_topp3(at, profile)
        return _sampled(derivatives, profile, np.asarray(times), grid, unit.waypoint_times)

    def _third_order(self, copp: Any, robot: Any, squared: Array) -> Any:
        """Squared path speeds and path accelerations, from those without jerk limits."""
        topp3 = copp.solver.topp3_socp
        robot.constraints.amax_substitute(squared, 0)
        profile = topp3.solve(topp3.Problem(robot.constraints, squared))
        for _ in range(self.linearisations - 1):
            problem = topp3.Problem(
                robot.constraints,
                profile.a,
                b_linearization=profile.b,
            )
            profile = topp3.solve(problem)
        return profile


def _sides(bounds: Array) -> tuple[Array, Array]:
    """Upper and lower limits, as COPP takes them."""
    low, high = bounds.T
    return high.copy(), low.copy()


def _derivatives(grid: Grid) -> list[Array]:
    """The path and its first three derivatives at all gridpoints, each `(gridpoints, joints)`."""
    step = grid.step[:, None]
    derivatives = []
    for order in range(4):
        piece = polynomials.derivative(grid.local, order) / step**order
        last = piece[:, -1].sum(axis=0)
        values = np.concatenate([piece[-1], last[None]])
        derivatives.append(np.ascontiguousarray(values))
    return derivatives


def _sampled(
    derivatives: list[Array],
    profile: Any,
    times: Array,
    grid: Grid,
    waypoints: Array,
) -> Trajectory:
    """The motion through the gridpoints with their positions, velocities and accelerations."""
    position, slope, bend, _ = derivatives
    squared = np.maximum(np.asarray(profile.a), 0.0)[:, None]
    path_acceleration = np.asarray(profile.b)[:, None]
    # q̇ = q' ṡ,  q̈ = q'' ṡ² + q' s̈
    velocity = slope * np.sqrt(squared)
    acceleration = bend * squared + slope * path_acceleration
    nearest = np.abs(grid.at[:, None] - waypoints).argmin(axis=0)
    return Trajectory.from_samples(
        times,
        position,
        velocity,
        acceleration,
        waypoint_times=times[nearest] - times[0],
    )
