"""COPP: the fastest timing of a path under jerk limits too, from the package `copp-py`.

Without jerk limits COPP's reachability analysis gives path speeds at gridpoints, with constant path
acceleration in between; the motion is composed exactly. With jerk limits its second-order cone
program gives path speed and acceleration at the gridpoints, from jerk limits that are linearised
around the previous answer. Between the gridpoints the motion is a quintic Hermite piece, as a
controller would interpolate it.

Choices and their sources (repository TOPP-THU/copp):

- the first path, COPP's own quintic through the waypoints (`Path.from_waypoints`); 1001 gridpoints;
  the reachability analysis as first linearisation, two programs; almost solved is accepted: all
  `bindings/python/examples/topp3_socp.py`;
- the other paths are eleven of the splines that all path followers get here, without the clamped
  one on even knots, which is the quintic's sister.

    from baselines.third_party.copp import Copp
    solution = Copp().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.third_party import Rival, splines_after
from baselines.topp_ra import Knots, PathGrid, cut, spline, timed, unit_path
from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend
from trajopt.planners.reductions import OWN_UNITS, reduced

_OWN = ("uniform", "quintic")
_INTERVALS = 1000
_PROGRAMS = 2


@dataclass(frozen=True)
class Copp(Rival):
    """COPP along a spline, jerk limits kept at gridpoints; the best of twelve splines.

    - `tries`: number of splines. 1: COPP's own quintic, as in its examples.
    """

    requires = ("copp_py",)
    extra = "copp"
    knows = ("velocity", "acceleration", "jerk")
    settings = tuple(own for own in splines_after(_OWN) if own != ("uniform", "clamped"))

    @reduced(OWN_UNITS)
    def tried(self, problem: Problem, knots: Knots, ends: Any) -> Solution:
        copp = backend("copp_py", self.extra)
        path = _quintic(problem, copp) if ends == "quintic" else spline(problem, knots, ends)
        try:
            return Solution(Status.SOLVED, self._along(problem, path, copp))
        except (copp.CoppError, copp.ConstraintError) as error:
            return Solution(Status.FAILED, message=f"COPP: {error}")

    def _along(self, problem: Problem, path: Trajectory, copp: Any) -> Trajectory:
        # the parameter about as long as the motion takes: path speeds near 1
        unit = unit_path(path, _INTERVALS)
        scale = verify(problem, unit).dilation
        grid = cut(unit)
        at = grid.at * scale
        derivatives = _derivatives(grid)
        for order, derivative in enumerate(derivatives):
            derivative /= scale**order

        *up_to_second, third = derivatives
        limits = problem.limits
        everywhere = {"start_idx_s": 0, "length": len(at)}
        topp2 = copp.solver.topp2_ra
        with inside_library():
            robot = copp.Robot(problem.joints, capacity=len(at))
            robot.append_s(at)
            robot.set_q(*up_to_second, 0, dddq=third)
            robot.add_velocity_limits(*_sides(limits.velocity), **everywhere)
            robot.add_acceleration_limits(*_sides(limits.acceleration), **everywhere)
            problem2 = topp2.Problem(robot.constraints, (0, len(at) - 1), (0.0, 0.0))
            squared = np.asarray(topp2.solve(problem2))
        if not problem.has("jerk"):
            speeds = np.sqrt(squared) / scale
            return timed(grid, speeds, unit.waypoint_times)

        with inside_library():
            robot.add_jerk_limits(*_sides(limits.jerk), **everywhere)
            profile = self._third_order(copp, robot, squared)
            _, times = copp.interpolation.s_to_t_topp3(at, profile)
        return _sampled(derivatives, profile, np.asarray(times), grid, unit.waypoint_times)

    def _third_order(self, copp: Any, robot: Any, squared: Array) -> Any:
        """Return squared path speeds and path accelerations under jerk limits."""
        topp3 = copp.solver.topp3_socp
        options = copp.clarabel.Options(allow_almost_solved=True)
        robot.constraints.amax_substitute(squared, 0)
        for _ in range(_PROGRAMS):
            problem = topp3.Problem(robot.constraints, squared)
            profile = topp3.solve(problem, options)
            squared = np.asarray(profile.a)
        return profile


def _quintic(problem: Problem, copp: Any) -> Trajectory:
    """Return COPP's own spline through the waypoints, over [0, 1]."""
    with inside_library():
        path = copp.Path.from_waypoints(problem.waypoints)
        first, last = path.s_range
        knots = np.linspace(first, last, len(problem.waypoints))
        at = path.evaluate_up_to_2nd(knots)
    return Trajectory.from_samples(
        knots, problem.waypoints, at.dq, at.ddq, interpolation="quintic", waypoint_times=knots
    )


def _sides(bounds: Array) -> tuple[Array, Array]:
    """Return upper and lower limits, as COPP takes them."""
    low, high = bounds.T
    return high.copy(), low.copy()


def _derivatives(grid: PathGrid) -> list[Array]:
    """Return the path and three derivatives at all gridpoints, each `(gridpoints, joints)`."""
    step = grid.step[:, None]
    derivatives = []
    for order in range(4):
        piece = polynomials.derivative(grid.local, order) / step**order
        last = piece[:, -1].sum(axis=0)
        values = np.concatenate([piece[-1], last[None]])
        derivatives.append(np.ascontiguousarray(values))
    return derivatives


def _sampled(
    derivatives: list[Array], profile: Any, times: Array, grid: PathGrid, waypoints: Array
) -> Trajectory:
    """Return the motion through the gridpoints' positions, velocities and accelerations."""
    position, slope, bend, _ = derivatives
    squared = np.maximum(np.asarray(profile.a), 0.0)[:, None]
    path_acceleration = np.asarray(profile.b)[:, None]
    # q̇ = q' ṡ,  q̈ = q'' ṡ² + q' s̈
    velocity = slope * np.sqrt(squared)
    acceleration = bend * squared + slope * path_acceleration
    nearest = np.abs(grid.at[:, None] - waypoints).argmin(axis=0)
    return Trajectory.from_samples(
        times, position, velocity, acceleration, waypoint_times=times[nearest] - times[0]
    )
