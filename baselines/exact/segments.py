"""Segments between waypoints: a motion of pieces meets their ends and keeps their limits."""

from __future__ import annotations

from typing import NamedTuple, Self

import numpy as np

from baselines.exact.mending import Pieces
from trajopt.core.arrays import Array, Indices

_TOLERANCE = 1e-10  # feasibility relative to the limits, HiGHS's least


class Segments(NamedTuple):
    """The waypoints and limits of some segments.

    Attributes:
        u: velocities at the start, `(segments, joints)`.
        w: velocities at the end, likewise.
        h: displacements, likewise.
        limits: of velocity, acceleration and jerk, `(2, joints)` each, low first.
    """

    u: Array
    w: Array
    h: Array
    limits: tuple[Array, Array, Array]

    def of(self, some: Indices) -> Self:
        """Some of the segments."""
        return self._replace(u=self.u[some], w=self.w[some], h=self.h[some])

    def mended(self, pieces: Pieces) -> Pieces:
        """Pieces that lead to the next waypoint and its velocity."""
        return pieces.mended(self.u, self.w, self.h)

    def use(self, pieces: Pieces) -> Array:
        """The largest share of a limit that each joint uses, `(segments, joints)`."""
        takes_time = pieces.lengths > 0
        first = np.where(takes_time, pieces.start, 0.0)
        last = np.where(takes_time, pieces.end, 0.0)
        jerks = np.where(takes_time, pieces.jerk, 0.0)
        velocity, _ = pieces.passed(self.u)
        speeds = velocity[:-1]
        # the fastest point of a piece, at no acceleration
        lost = np.divide(
            first**2,
            2 * jerks,
            out=np.zeros_like(first),
            where=first * last < 0,
        )
        velocities = np.concatenate([speeds, speeds - lost])
        accelerations = np.concatenate([first, last])
        tables = [velocities, accelerations, jerks]
        shares = []
        for values, sides in zip(tables, self.limits, strict=True):
            shares += [(values / side).max(axis=0) for side in sides]
        return np.asarray(np.max(shares, axis=0))

    def squeezed(self, pieces: Pieces) -> Pieces:
        """Pieces of one segment that use the least share of their limits.

        The accelerations at inner breaks change, by a linear program for each joint. Velocities
        within pieces are left to `use`.
        """
        used = pieces.lengths[:, 0, 0] > 0
        lengths = pieces.lengths[used, 0]
        # one acceleration is 1 at each inner break, and straight to 0 at its neighbours
        at_breaks = np.eye(len(lengths) + 1)[:, 1:-1]
        slopes = np.diff(at_breaks, axis=0) / lengths
        change = Pieces(lengths, at_breaks[:-1], slopes)
        velocity, position = change.passed(np.zeros(at_breaks.shape[1]))
        changes = [velocity, at_breaks, slopes]
        ends = np.array([velocity[-1], position[-1]])
        start = pieces.start.copy()
        jerk = pieces.jerk.copy()
        for joint, speed in enumerate(self.u[0]):
            own = Pieces(lengths[:, 0], start[used, 0, joint], jerk[used, 0, joint])
            speeds, _ = own.passed(speed)
            levels = np.append(own.start, own.end[-1])
            matrix = []
            slack = []
            for table, values, sides in zip(
                changes,
                [speeds, levels, own.jerk],
                self.limits,
                strict=True,
            ):
                for side in sides[:, joint]:
                    matrix.append(table / side)
                    slack.append(1 - values / side)
            missed = own.missing(speed, self.w[0, joint], self.h[0, joint])
            found = _least(np.vstack(matrix), np.hstack(slack), ends, missed)
            start[used, 0, joint] += change.start @ found
            jerk[used, 0, joint] += change.jerk @ found
        return Pieces(pieces.lengths, start, jerk)


def _least(matrix: Array, slack: Array, ends: Array, missed: Array) -> Array:
    """The `x` of least `e ≥ 0` with `matrix x ≤ slack + e` and `ends x = missed`, or zeros."""
    from scipy.optimize import linprog  # late: few motions need it

    rows, changes = matrix.shape
    if not np.isfinite(slack).all():
        return np.zeros(changes)
    sizes = np.abs(ends).max(axis=1, keepdims=True)
    found = linprog(
        np.append(np.zeros(changes), 1.0),
        A_ub=np.hstack([matrix, -np.ones((rows, 1))]),
        b_ub=slack,
        A_eq=np.hstack([ends / sizes, np.zeros((2, 1))]),
        b_eq=missed / sizes[:, 0],
        bounds=[(None, None)] * changes + [(0.0, None)],
        options={
            "primal_feasibility_tolerance": _TOLERANCE,
            "dual_feasibility_tolerance": _TOLERANCE,
        },
    )
    return np.zeros(changes) if found.x is None else np.asarray(found.x[:-1])
