"""MoveIt's time-optimal trajectory generation (TOTG), as `tesseract-robotics` has it.

Straight lines between given points, rounded by circles, are traversed as fast as velocity and
acceleration limits allow (Kunz and Stilman, RSS 2012). The circles cut the corners, so TOTG's
motion misses the points that it is given. Here the points are dense and lie so far outside of the
path that every circle's middle is a point of a cubic spline through the waypoints: TOTG's own
motion then passes the waypoints.

TOTG returns time, velocity and acceleration in the middle of every circle. The answer is its path,
a quintic from middle to middle with the circles' tangents and curvatures, at its path speeds, with
constant path acceleration from middle to middle.

Choices and their sources (repositories moveit/moveit2 and tesseract-robotics/tesseract_planning):

- a circle may leave its corner by 0.1 rad: `DEFAULT_PATHTOLERANCE`, the default of both;
- the first path: evenly spaced knots, our choice, since MoveIt's paths come from a planner;
- 20 points in every segment: our choice; more points change 0.3 % and take ten times as long;
- points are never left out (`min_angle_change`): our choice, since all points differ;
- Tesseract counts the points in one more joint without limits, and so do the circles here
  (`totg/src/time_optimal_trajectory_generation.cpp`).

    from baselines.third_party.totg import Totg
    solution = Totg().solve(problem)
    print(solution.trajectory.duration, solution.stats["spline"])
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from baselines.third_party import Rival, splines_after
from baselines.third_party.tesseract import (
    LANGUAGE,
    TIMING,
    States,
    limits,
    points,
    program,
    states,
)
from baselines.topp_ra import Ends, Knots, PathGrid, timed
from trajopt.core import polynomials
from trajopt.core.arrays import Array, Indices
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import backend

# Distance of a circle from its corner, rad.
TOLERANCE = 0.1
# Distance below which the package leaves points out, rad.
SAME_POINT = 1e-9
_POINTS_PER_SEGMENT = 20
# Corrections of the corners; each reduces the error to a quarter.
_CORRECTIONS = 25
# Squares of tangents below it, relative to the largest, are rounding.
_STILL_RTOL = 1e-12
# Smallest difference of two directions, against division by 0 on a straight line.
_LEAST_TURN = 1e-12


@dataclass(frozen=True)
class Totg(Rival):
    """MoveIt's TOTG (Tesseract's) along a cubic spline; by default the best of twelve splines.

    - `tries`: number of splines. 1: evenly spaced knots, not-a-knot.
    """

    requires = (LANGUAGE, TIMING)
    extra = "totg"
    settings = splines_after(("uniform", "not-a-knot"))

    def unsupported(self, problem: Problem) -> str | None:
        if problem.has("jerk"):
            return "TOTG does not limit jerk: its accelerations jump"
        return None

    def tried(self, problem: Problem, knots: Knots, ends: Ends) -> Solution:
        language, timing = [backend(name, self.extra) for name in self.requires]
        wanted, waypoints = points(problem, knots, ends, _POINTS_PER_SEGMENT)
        corners = wanted
        for _ in range(_CORRECTIONS):
            corners = wanted - _rounded(corners).offset
        moves = program(corners, language)
        container = timing.InstructionsTrajectory(moves)
        generation = timing.TimeOptimalTrajectoryGeneration(TOLERANCE, SAME_POINT)
        with inside_library():
            solved = generation.compute(container, *limits(problem))
        if not solved:
            return Solution(Status.FAILED, message="TOTG found no timing")
        timed_states = states(moves, language)
        motion = _motion(wanted, _rounded(corners), timed_states, waypoints)
        if motion is None:
            return Solution(Status.FAILED, message="TOTG's states do not go forward on its path")
        return Solution(Status.SOLVED, motion, stats={"own duration": timed_states.times[-1]})


class _Circles(NamedTuple):
    """Circles that round the corners of a line, at their middles; zeros at the line's ends.

    Attributes:
        offset: Vector from the corner to the circle's middle, rad, `(points, joints)`.
        tangent: Derivative of the joints with respect to path length, `(points, joints)`.
        curvature: Their second derivative, `(points, joints)`.
        between: Path length from middle to middle, `(points − 1,)`.
    """

    offset: Array
    tangent: Array
    curvature: Array
    between: Array


def _rounded(corners: Array) -> _Circles:
    """Return TOTG's circles, as wide as half of the shorter side and the tolerance allow."""
    counted = np.column_stack([corners, np.arange(len(corners))])
    sides = np.diff(counted, axis=0)
    lengths = np.linalg.norm(sides, axis=1)
    directions = sides / lengths[:, None]
    before = directions[:-1]
    after = directions[1:]
    turn = after - before
    size = np.linalg.norm(turn, axis=1)
    size = np.maximum(size, _LEAST_TURN)
    angle = 2 * np.arcsin(size / 2)
    # from a corner to where its circle begins
    shorter = np.minimum(lengths[:-1], lengths[1:]) / 2
    distance = np.minimum(shorter, TOLERANCE / np.tan(angle / 4))
    towards = turn / size[:, None]
    offset = towards * (distance * np.tan(angle / 4))[:, None]
    curvature = towards * (np.tan(angle / 2) / distance)[:, None]
    along = before + after
    tangent = along / np.linalg.norm(along, axis=1)[:, None]
    # difference of the lengths of a corner and its circle, on either side
    spared = np.pad(distance - angle / 2 * distance / np.tan(angle / 2), 1)
    return _Circles(
        _inside(offset),
        np.vstack([before[:1], tangent, after[-1:]])[:, :-1],
        _inside(curvature),
        lengths - spared[:-1] - spared[1:],
    )


def _inside(values: Array) -> Array:
    """Append zeros at both ends, and leave out the counting joint."""
    return np.pad(values[:, :-1], ((1, 1), (0, 0)))


def _motion(
    positions: Array, circles: _Circles, own: States, waypoints: Indices
) -> Trajectory | None:
    """Return TOTG's path from middle to middle at its path speeds there; None if one is below 0."""
    at = np.r_[0.0, np.cumsum(circles.between)]
    path = Trajectory.from_samples(
        at, positions, circles.tangent, circles.curvature, interpolation="quintic"
    )
    steps = np.diff(at)
    local = polynomials.stretched(path.coefficients, steps)
    # q̇ = t ṡ: a projection, since the counting joint's share of t is not returned
    projected = (own.velocities * circles.tangent).sum(axis=1)
    steepness = (circles.tangent**2).sum(axis=1)
    stands = steepness <= _STILL_RTOL * steepness.max()
    speeds = projected / np.where(stands, 1.0, steepness)
    speeds[[0, -1]] = 0  # but for rounding
    # where all joints turn back only the counting joint moves: Δs = (ṡ₀ + ṡ₁) Δt / 2
    for i in np.flatnonzero(stands[1:-1]) + 1:
        mean = circles.between[i - 1] / (own.times[i] - own.times[i - 1])
        speeds[i] = 2 * mean - speeds[i - 1]
    if not speeds[1:-1].min(initial=1.0) > 0:
        return None
    return timed(PathGrid(at, steps, local), speeds, at[waypoints])
