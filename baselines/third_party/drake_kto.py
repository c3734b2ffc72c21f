"""Drake's `KinematicTrajectoryOptimization`: the fastest B-spline, from the package `drake`.

The control points and the duration of a B-spline on uniform knots are variables. The user has to
choose at which share of the duration it passes each waypoint; here several rules are tried. Drake
imposes the limits on the control points of the derivatives, so they hold at every instant. The
B-spline is the answer.

Choices and their sources (repositories RobotLocomotion/drake and RussTedrake/manipulation):

- order 4, cubic: the default of `KinematicTrajectoryOptimization`;
- 10 control points in every segment at first: `book/trajectories/
  kinematic_trajectory_optimization.ipynb` has 10 for a motion from one pose to another. Then 5, 20;
- the cost, its duration: the same notebook, without its path length, which is not judged here;
- the initial guess, straight lines: the same, where it moves from bin to bin;
- the times at which it passes the waypoints: ours, since Drake's examples have no waypoints.

    from baselines.third_party.drake_kto import DrakeKto
    solution = DrakeKto().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any, Literal

import numpy as np

from baselines.third_party import Rival
from baselines.topp_ra import Knots, steps
from trajopt.core.arrays import Array
from trajopt.core.limits import LIMIT_NAMES
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend
from trajopt.planners.reductions import OWN_UNITS, reduced
from trajopt.planners.rest_to_rest import stop_times

# Initial guess of the duration, relative to the time of stopping at every waypoint.
_SLOWER = 1.5
_RULES: tuple[Knots, ...] = ("uniform", "limit", "chord", "centripetal")


@dataclass(frozen=True)
class DrakeKto(Rival):
    """Drake's fastest B-spline on uniform knots; by default the best of twelve programs.

    - `tries`: number of programs: three numbers of control points, four rules of passing times. 1:
      ten control points in every segment, waypoints passed at even times;
    - `order`: order of the B-spline, its degree plus one; Drake's own default is 4, cubic.
    """

    order: Literal[4, 5, 6, 8] = 4

    requires = ("pydrake.planning", "pydrake.solvers")
    extra = "drake"
    knows = LIMIT_NAMES
    settings = tuple(product((10, 5, 20), _RULES))

    @reduced(OWN_UNITS)
    def tried(self, problem: Problem, controls: int, knots: Knots) -> Solution:
        planning, solvers = [backend(name, self.extra) for name in self.requires]
        passed = np.cumsum(steps(problem, knots))
        shares = np.r_[0.0, passed / passed[-1]]
        count = self.order + controls * problem.segments
        stopping = _SLOWER * float(stop_times(problem).sum())
        search = planning.KinematicTrajectoryOptimization(
            problem.joints, count, self.order, stopping
        )
        for q, share in zip(problem.waypoints, shares, strict=True):
            search.AddPathPositionConstraint(q, q, share)
        _limit(search, problem)
        search.AddDurationConstraint(1e-3 * stopping, None)
        search.AddDurationCost()
        program = search.get_mutable_prog()
        on_the_way = np.linspace(0.0, 1.0, count)
        guess = [np.interp(on_the_way, shares, column) for column in problem.waypoints.T]
        program.SetInitialGuess(search.control_points(), np.array(guess))
        with inside_library():
            result = solvers.Solve(program)
        if not result.is_success():
            solver = result.get_solver_id().name()
            return Solution(Status.FAILED, message=f"Drake: {solver} found no spline")
        return Solution(Status.SOLVED, _polynomials(search.ReconstructTrajectory(result), shares))


def _limit(search: Any, problem: Problem) -> None:
    """Add the limits, and rest at both ends (without acceleration under jerk limits)."""
    nothing = np.zeros(problem.joints)
    limits = problem.limits
    for share in (0.0, 1.0):
        search.AddPathVelocityConstraint(nothing, nothing, share)
        if problem.has("jerk"):
            search.AddPathAccelerationConstraint(nothing, nothing, share)
    search.AddVelocityBounds(*limits.velocity.T)
    search.AddAccelerationBounds(*limits.acceleration.T)
    if problem.has("jerk"):
        search.AddJerkBounds(*limits.jerk.T)
    if problem.has("position"):
        search.AddPositionBounds(*limits.position.T)


def _polynomials(answer: Any, shares: Array) -> Trajectory:
    """Return Drake's B-spline as polynomials between its knots."""
    import scipy  # late: planners that are only listed need none of it

    basis = answer.basis()
    knots = np.array(basis.knots())
    controls = np.array([point[:, 0] for point in answer.control_points()])
    degree = basis.order() - 1
    # the end knots are repeated: pieces without length are left out
    inside = slice(degree, len(knots) - degree)
    breaks = knots[inside]
    columns = []
    for column in controls.T:
        pieces = scipy.interpolate.PPoly.from_spline((knots, column, degree))
        columns.append(pieces.c[:, inside][:, :-1])
    return Trajectory(breaks, np.stack(columns, axis=-1), shares * breaks[-1])
