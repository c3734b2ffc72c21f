"""Find the very short pieces of a motion, and those without which it would keep its limits.

For each joint a linear program searches a motion between the same waypoint states and on the other
breaks. It limits velocities at breaks only, so it may find a motion that does not exist; a piece
for which it finds none is needed.
"""

from __future__ import annotations

import numpy as np
from scipy.optimize import linprog

from baselines.exact.method.pieces import Pieces
from trajopt import Problem, Trajectory
from trajopt.core.arrays import Array, Indices

BRIEF_S = 1e-6
# Share of a limit by which a motion without the piece may exceed it.
EXCESS_RTOL = 1e-9
SOLVER_TOLERANCE = 1e-10  # HiGHS's least


def brief(trajectory: Trajectory) -> Indices:
    """The pieces that take less than 1e-6 s."""
    return np.flatnonzero(trajectory.lengths < BRIEF_S)


def needless(problem: Problem, trajectory: Trajectory) -> int:
    """Number of brief pieces without which a motion keeps the limits but for 1e-9 of them."""
    middles = trajectory.breaks[:-1] + trajectory.lengths / 2
    segments = np.searchsorted(trajectory.waypoint_times[1:-1], middles)
    count = 0
    for piece in brief(trajectory):
        segment = segments[piece]
        own = np.flatnonzero(segments == segment)
        place = piece - own[0]
        inner = [k for k in (place - 1, place) if 0 <= k < len(own) - 1]
        count += any(_could_go(problem, trajectory, segment, own, k) for k in inner)
    return count


def _could_go(
    problem: Problem, trajectory: Trajectory, segment: int, own: Indices, place: int
) -> bool:
    """Return whether a segment of these pieces could do without the break after this one."""
    lengths = trajectory.lengths[own]
    joined = np.delete(lengths, place + 1)
    joined[place] += lengths[place + 1]
    h = problem.displacements[segment]
    limits = problem.limits
    for joint in np.flatnonzero(problem.moving):
        velocity, acceleration = (trajectory.pieces(order)[:, own, joint] for order in (1, 2))
        states = [(table[-1, 0], table[:, -1].sum()) for table in (velocity, acceleration)]
        sides = [own[joint] for own in (limits.velocity, limits.acceleration, limits.jerk)]
        if _least_excess(joined, states, h[joint], sides) > EXCESS_RTOL:
            return False
    return True


def _least_excess(
    lengths: Array, states: list[tuple[float, float]], h: float, limits: list[Array]
) -> float:
    """The least excess over the limits of one joint, relative; infinite if nothing gets there.

    Args:
        lengths: of the pieces.
        states: velocity at the start and at the end, and acceleration.
        h: displacement.
        limits: of velocity, acceleration and jerk, low first.
    """
    time = lengths.sum()
    shares = lengths[:, None] / time
    count = len(lengths)
    (u, w), (a, b) = states
    least = [np.abs(sides).min() for sides in limits]
    steepest = min(least[1], least[2] * time)
    fastest = steepest * time
    # unknown: accelerations at the start and at the end of each piece, relative to the steepest
    first, last = np.eye(2 * count).reshape(2, count, -1)
    motion = Pieces.straight(shares, first, last)
    velocity, way = motion.passed(np.zeros(2 * count))
    tables = [
        (fastest * velocity, u),
        (steepest * first, 0.0),
        (steepest * last, 0.0),
        (steepest / time * motion.jerk, 0.0),
    ]
    rows = []
    room = []
    kinds = [limits[0], limits[1], limits[1], limits[2]]
    for (table, known), sides in zip(tables, kinds, strict=True):
        for side in sides:
            rows.append(table / side)
            room.append(np.full(len(table), 1 - known / side))
    ends = [velocity[-1], way[-1]]
    wanted = [(w - u) / fastest, (h / time - u) / fastest]
    if np.isfinite(limits[2]).any():
        ends += [first[0], *(last[:-1] - first[1:]), last[-1]]
        wanted += [a / steepest, *np.zeros(count - 1), b / steepest]
    found = linprog(
        np.append(np.zeros(2 * count), 1.0),
        A_ub=np.pad(np.vstack(rows), [(0, 0), (0, 1)], constant_values=-1.0),
        b_ub=np.hstack(room),
        A_eq=np.pad(ends, [(0, 0), (0, 1)]),
        b_eq=wanted,
        bounds=[(None, None)] * (2 * count) + [(0.0, None)],
        options={
            "primal_feasibility_tolerance": SOLVER_TOLERANCE,
            "dual_feasibility_tolerance": SOLVER_TOLERANCE,
        },
    )
    return np.inf if found.x is None else float(found.fun)
