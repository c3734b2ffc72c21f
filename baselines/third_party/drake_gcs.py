"""Drake's `GcsTrajectoryOptimization`: Bézier curves through a sequence of convex sets (`drake`).

Planners of this kind (graphs of convex sets, Marcucci and others 2023) find a motion that passes
through sets one after another. Here the order is known: each segment consists of one or more
regions, and the motion enters the next segment in the waypoint, or in its box of tolerance.

The program's curve over a region is a Bézier curve of free duration. Velocity limits are linear.
Limits of acceleration and jerk, and continuous velocities, are not convex: Drake keeps them in its
restriction to one path, at the control points of the derivatives, hence everywhere.

Choices and their sources (repository RobotLocomotion/drake, `planning/trajectory_optimization/`):

- the cost, the duration: `AddTimeCost`, without path length, which is not judged here;
- order 5 at first, one region per segment: `test/gcs_trajectory_optimization_test.cc` has orders
  from 1 to 6. Then orders from 3 to 8, and 2 or 3 regions;
- `SolveConvexRestriction` along the only path, its solver (SNOPT) and initial guess Drake's own.

    from baselines.third_party.drake_gcs import Gcs
    solution = Gcs().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np

from baselines.third_party import Rival
from trajopt.core.arrays import Array
from trajopt.core.demand import END_VELOCITIES
from trajopt.core.limits import LIMIT_NAMES
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend
from trajopt.planners.reductions import OWN_UNITS, reduced

# Without position limits a region extends this far beyond the waypoints, relative to the largest
# displacement.
_AROUND = 1.0
# Shortest and longest duration of a region, relative to the time of stopping at every waypoint.
_SHORTEST = 1e-6
_LONGEST = 2.0


@dataclass(frozen=True)
class Gcs(Rival):
    """Drake's Bézier curves through boxes (graph of convex sets); by default the best of twelve.

    - `tries`: number of programs: one to three curves per segment, of orders 3 to 8. 1: one curve
      of order 5 per segment.
    """

    requires = ("pydrake.planning", "pydrake.geometry.optimization")
    extra = "drake"
    knows = (*LIMIT_NAMES, "segment", *END_VELOCITIES, "tolerance")
    settings = (*product((1,), (5, 6, 7, 8, 4, 3)), *product((2, 3), (3, 4, 5)))

    @reduced(OWN_UNITS)
    def tried(self, problem: Problem, curves: int, order: int) -> Solution:
        planning, sets = [backend(name, self.extra) for name in self.requires]
        graph = planning.GcsTrajectoryOptimization(problem.joints)
        region, *boxes = _regions(problem, sets)
        following = [(i, i + 1) for i in range(curves - 1)]
        segments = []
        for number in range(problem.segments):
            own = graph.AddRegions([region] * curves, following, order, _SHORTEST, _LONGEST)
            _limit(own, problem.limits.of_segments(np.array([number])).in_all_segments())
            segments.append(own)
        ends = [graph.AddRegions([box], [], 0, 0.0, 0.0) for box in (boxes[0], boxes[-1])]
        edges = [graph.AddEdges(ends[0], segments[0]), graph.AddEdges(segments[-1], ends[1])]
        for edge, state in zip(edges, (problem.route.start, problem.route.end), strict=True):
            _held(edge, state.velocity, accelerated=problem.has("jerk"))
        for (before, after), box in zip(pairwise(segments), boxes[1:-1], strict=True):
            graph.AddEdges(before, after, box)
        graph.AddContinuityConstraints(1)
        if problem.has("jerk"):
            graph.AddContinuityConstraints(2)
        graph.AddTimeCost()
        path = [ends[0], *segments, ends[1]]
        vertices = [vertex for part in path for vertex in part.Vertices()]
        with inside_library():
            answer, result = graph.SolveConvexRestriction(vertices)
        if not result.is_success():
            solver = result.get_solver_id().name()
            return Solution(Status.FAILED, message=f"Drake: {solver} found no curves")
        return Solution(Status.SOLVED, _polynomials(answer, curves, problem.segments))


def _regions(problem: Problem, sets: Any) -> list[Any]:
    """Return the region of all segments, and the waypoints' boxes."""
    waypoints = problem.waypoints
    low, high = problem.limits.position.T
    lowest = np.where(np.isfinite(low), low, waypoints.min(axis=0) - _AROUND)
    highest = np.where(np.isfinite(high), high, waypoints.max(axis=0) + _AROUND)
    missed = problem.route.demand("tolerance")
    boxes = [
        sets.Hyperrectangle(np.maximum(q - r, low), np.minimum(q + r, high)).MakeHPolyhedron()
        if r.any()
        else sets.Point(q)
        for q, r in zip(waypoints, missed, strict=True)
    ]
    return [sets.Hyperrectangle(lowest, highest), *boxes]


def _limit(part: Any, limits: Any) -> None:
    """Add limits of velocity, acceleration and jerk to a segment."""
    part.AddVelocityBounds(*limits.velocity.T)
    part.AddNonlinearDerivativeBounds(*limits.acceleration.T, 2)
    if np.isfinite(limits.jerk).any():
        part.AddNonlinearDerivativeBounds(*limits.jerk.T, 3)


def _held(edge: Any, velocity: Array, *, accelerated: bool) -> None:
    """Fix the velocity at an end; with jerk limits the motion does not accelerate there."""
    if velocity.any():
        edge.AddVelocityBounds(velocity, velocity)
    else:
        edge.AddZeroDerivativeConstraints(1)
    if accelerated:
        edge.AddZeroDerivativeConstraints(2)


def _polynomials(answer: Any, curves: int, segments: int) -> Trajectory:
    """Return Drake's Bézier curves as polynomials."""
    import scipy  # late: planners that are only listed need none of it

    pieces = [answer.segment(i) for i in range(answer.get_number_of_segments())]
    moving = [piece for piece in pieces if piece.end_time() > piece.start_time()]
    controls = np.array([piece.control_points().T for piece in moving]).swapaxes(0, 1)
    lengths = [piece.end_time() - piece.start_time() for piece in moving]
    breaks = np.append(0.0, np.cumsum(lengths))
    bezier = scipy.interpolate.BPoly(controls, breaks)
    passed: Array = breaks[::curves][: segments + 1]
    return Trajectory.from_ppoly(
        scipy.interpolate.PPoly.from_bernstein_basis(bezier), waypoint_times=passed
    )
