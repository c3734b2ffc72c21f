"""What the planners of `tesseract-robotics` share: its programs of moves, and their execution.

from baselines.third_party.tesseract import LANGUAGE, program, states
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from baselines.topp_ra import Ends, Knots, cut, spline, unit_path
from trajopt.core.arrays import Array, Indices
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

LANGUAGE = "tesseract_robotics.tesseract_command_language"
TIMING = "tesseract_robotics.tesseract_time_parameterization"

# Jerk limit where a problem has none, rad/s³: MoveIt's DEFAULT_MAX_JERK.
_JERK = 1000.0


class Points(NamedTuple):
    """Points of a path.

    Attributes:
        positions: Joint positions, rad or the problem's unit, `(points, joints)`.
        waypoints: Which points are the problem's waypoints, `(waypoints,)`.
    """

    positions: Array
    waypoints: Indices


class States(NamedTuple):
    """A timed program: one row for each point; s, rad, rad/s, rad/s²."""

    times: Array
    positions: Array
    velocities: Array
    accelerations: Array


def points(problem: Problem, knots: Knots, ends: Ends, count: int) -> Points:
    """Return a cubic spline's points, `count` for each of its segments; 1: the waypoints alone."""
    if count == 1:
        return Points(problem.waypoints, np.arange(len(problem.waypoints)))
    path = unit_path(spline(problem, knots, ends), count * problem.segments)
    at = cut(path).at
    return Points(path(at), np.abs(at[:, None] - path.waypoint_times).argmin(axis=0))


def limits(problem: Problem) -> tuple[Array, Array, Array]:
    """Return limits of velocity, acceleration and jerk, symmetric, each `(joints, 2)`."""
    own = problem.limits
    jerk = np.where(np.isfinite(own.jerk), own.jerk, [-_JERK, _JERK])
    return _narrowed(own.velocity), _narrowed(own.acceleration), _narrowed(jerk)


def program(positions: Array, language: Any) -> Any:
    """Return Tesseract's program of one move for each point."""
    names = [f"joint{joint}" for joint in range(positions.shape[1])]
    moves = language.CompositeInstruction()
    for position in positions:
        state = language.StateWaypoint(names, position)
        waypoint = language.StateWaypointPoly_wrap_StateWaypoint(state)
        move = language.MoveInstruction(waypoint, language.MoveInstructionType_FREESPACE)
        moves.appendMoveInstruction(language.MoveInstructionPoly_wrap_MoveInstruction(move))
    return moves


def states(moves: Any, language: Any) -> States:
    """Return a timed program's states."""
    rows = []
    for i in range(len(moves)):
        # each view needs the one before, which Tesseract's views do not keep alive
        instruction = moves[i]
        move = language.InstructionPoly_as_MoveInstructionPoly(instruction)
        waypoint = move.getWaypoint()
        state = language.WaypointPoly_as_StateWaypointPoly(waypoint)
        orders = (state.getPosition(), state.getVelocity(), state.getAcceleration())
        rows.append((state.getTime(), *(np.array(order).ravel() for order in orders)))
    return States(*(np.array(column) for column in zip(*rows, strict=True)))


def executed(timed: States, waypoints: Indices) -> Trajectory:
    """Return quintics from state to state, as a controller of ROS executes them."""
    return Trajectory.from_samples(
        *timed, interpolation="quintic", waypoint_times=timed.times[waypoints]
    )


def _narrowed(bounds: Array) -> Array:
    """Return symmetric limits at the tighter side: Tesseract's planners support no others."""
    tighter = np.abs(bounds).min(axis=1)
    return np.stack([-tighter, tighter], axis=1)
