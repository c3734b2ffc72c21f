"""Drake's TOPP-RA: the fastest timing of a path, from the package `drake`.

The path is a cubic spline through the waypoints, given to Drake by its slopes at the knots. Drake
returns `s(t)` with constant acceleration between gridpoints, so the answer is composed exactly.

Choices and their sources (repository RobotLocomotion/drake):

- the first path, a clamped spline with knots spaced evenly: as `multibody/optimization/test/
  toppra_test.cc` makes it;
- acceleration limits by interpolation: the default of `AddJointAccelerationLimit`;
- 1000 intervals: our choice. `CalcGridPoints` refines from 100.

    from baselines.third_party.drake_toppra import DrakeToppra
    solution = DrakeToppra().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from baselines.third_party import Rival, in_own_units, splines_after
from baselines.topp_ra import Ends, Knots, cut, spline, timed, unit_path
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import backend

_GRIDPOINTS = 1000


@dataclass(frozen=True)
class DrakeToppra(Rival):
    """Drake's TOPP-RA along a cubic spline; by default the best of twelve splines.

    - `tries`: number of splines. 1: evenly spaced knots, clamped, as in Drake's own test.
    """

    requires = (
        "pydrake.multibody.optimization",
        "pydrake.multibody.plant",
        "pydrake.multibody.tree",
        "pydrake.trajectories",
    )
    extra = "drake"
    settings = splines_after(("uniform", "clamped"))

    def unsupported(self, problem: Problem) -> str | None:
        if problem.has("jerk"):
            return "Drake's TOPP-RA does not limit jerk: its accelerations jump"
        return None

    @in_own_units
    def tried(self, problem: Problem, knots: Knots, ends: Ends) -> Solution:
        optimization, *_ = modules = [backend(name, self.extra) for name in self.requires]
        path = unit_path(spline(problem, knots, ends), _GRIDPOINTS)
        grid = cut(path)
        plant = _plant(problem.joints, *modules[1:3])
        same = _drakes(path, modules[3])  # Drake keeps its address only: it has to outlive it
        topp = optimization.Toppra(same, plant, grid.at)
        topp.AddJointVelocityLimit(*problem.limits.velocity.T)
        topp.AddJointAccelerationLimit(*problem.limits.acceleration.T)
        parameter = topp.SolvePathParameterization()
        if parameter is None:
            return Solution(Status.FAILED, message="Drake's TOPP-RA found no timing")
        speeds = [parameter.EvalDerivative(t, 1)[0, 0] for t in parameter.get_segment_times()]
        return Solution(Status.SOLVED, timed(grid, np.array(speeds), path.waypoint_times))


def _plant(joints: int, plants: Any, tree: Any) -> Any:
    """A robot of so many sliding joints: the limits are the problem's, not a real robot's."""
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
    return plant


def _drakes(path: Trajectory, trajectories: Any) -> Any:
    """Return the cubic spline as a trajectory of Drake's."""
    at = path.breaks
    slopes = path(at, order=1)
    return trajectories.PiecewisePolynomial.CubicHermite(at, path(at).T, slopes.T)
