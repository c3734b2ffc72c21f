"""Drake's TOPP-RA: the fastest timing of a path, from the package `drake`.

The path is a cubic spline through the waypoints, given to Drake by its slopes at the knots. Drake
returns `s(t)` with constant acceleration between gridpoints, so the answer is composed exactly.

    from baselines.third_party.drake_toppra import DrakeToppra
    solution = DrakeToppra().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from baselines.third_party import imported, in_own_units
from baselines.topp_ra import best_of, cut, rules, spline, timed, unit_path
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DrakeToppra(Planner):
    """Drake's TOPP-RA along a cubic spline; by default the best of twelve splines.

    - `knots`: the spline's parameter from waypoint to waypoint grows by 1, by the chord's length,
      by its square root, or by the time from stop to stop;
    - `ends`: the spline's end rule;
    - `gridpoints`: about how many intervals the path is cut into;
    - `discretization`: where Drake imposes acceleration limits, its own default `interpolation`,
      or `collocation`.
    """

    knots: Literal["uniform", "chord", "centripetal", "limit", "best"] = "best"
    ends: Literal["not-a-knot", "natural", "clamped", "best"] = "best"
    gridpoints: int = 1000
    discretization: Literal["interpolation", "collocation"] = "interpolation"

    on_request = True
    requires = ("pydrake",)
    extra = "drake"

    def __post_init__(self) -> None:
        if self.gridpoints < 10:
            raise InvalidInput("gridpoints", "at least 10", value=self.gridpoints)

    def unsupported(self, problem: Problem) -> str | None:
        if problem.has("jerk"):
            return "Drake's TOPP-RA does not limit jerk: its accelerations jump"
        return None

    @passing_once
    @in_own_units
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of its paths' timings. `stats`: the path, and every path's result."""
        optimization, seconds = imported("pydrake.multibody.optimization", self.extra)
        plant, more = _plant(problem.joints)
        solutions = {}
        for knots, ends in rules(self.knots, self.ends):
            path = unit_path(spline(problem, knots, ends), self.gridpoints)
            solutions[f"{knots}/{ends}"] = self._along(problem, path, optimization, plant)
        return replace(best_of(problem, solutions), setup_time=seconds + more)

    def _along(self, problem: Problem, path: Trajectory, optimization: Any, plant: Any) -> Solution:
        grid = cut(path)
        same = _drakes(path)  # Drake keeps its address only: it has to outlive the solver
        topp = optimization.Toppra(same, plant, grid.at)
        scheme = optimization.ToppraDiscretization.kInterpolation
        if self.discretization == "collocation":
            scheme = optimization.ToppraDiscretization.kCollocation
        topp.AddJointVelocityLimit(*problem.limits.velocity.T)
        topp.AddJointAccelerationLimit(*problem.limits.acceleration.T, scheme)
        parameter = topp.SolvePathParameterization()
        if parameter is None:
            return Solution(Status.FAILED, message="Drake's TOPP-RA found no timing")
        speeds = [parameter.EvalDerivative(t, 1)[0, 0] for t in parameter.get_segment_times()]
        return Solution(Status.SOLVED, timed(grid, np.array(speeds), path.waypoint_times))


def _plant(joints: int) -> tuple[Any, float]:
    """A robot of so many sliding joints: the limits are the problem's, not a real robot's."""
    plants, seconds = imported("pydrake.multibody.plant", DrakeToppra.extra)
    tree, more = imported("pydrake.multibody.tree", DrakeToppra.extra)
    plant = plants.MultibodyPlant(0.0)
    inertia = tree.SpatialInertia(1.0, np.zeros(3), tree.UnitInertia(1.0, 1.0, 1.0))
    for joint in range(joints):
        body = plant.AddRigidBody(f"body{joint}", inertia)
        slider = tree.PrismaticJoint(
            f"joint{joint}",
            plant.world_frame(),
            body.body_frame(),
            [1, 0, 0],
        )
        plant.AddJoint(slider)
    plant.Finalize()
    return plant, seconds + more


def _drakes(path: Trajectory) -> Any:
    """The same cubic spline as Drake's own."""
    trajectories, _ = imported("pydrake.trajectories", DrakeToppra.extra)
    at = path.breaks
    slopes = path(at, order=1)
    return trajectories.PiecewisePolynomial.CubicHermite(at, path(at).T, slopes.T)
