"""Segments between waypoints: a motion of pieces meets their ends and keeps their limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from baselines.exact.mending import Pieces
from trajopt.core.arrays import Array, Bools, Indices

MOST = 1 + 3e-10  # share of a limit that a motion may use
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
        jerk = np.where(takes_time, pieces.jerk, 0.0)
        own = Pieces(pieces.lengths, first, jerk)
        velocity, _ = own.passed(self.u)
        speeds = velocity[:-1]
        # the fastest point of a piece, at no acceleration
        lost = np.divide(
            first**2,
            2 * jerk,
            out=np.zeros_like(first),
            where=first * own.end < 0,
        )
        velocities = np.concatenate([speeds, speeds - lost])
        shares = _shares(own, velocities, self.limits)
        return np.asarray(shares.max(axis=0))

    def kept(self, pieces: Pieces, some: Bools) -> tuple[Pieces, Bools]:
        """The pieces, and in which segments they keep the limits when they are mended.

        In some segments a linear program changes those of joints that do not, where that helps.
        """
        mended = self.mended(pieces)
        use = self.use(mended)
        exceeds = ~(use <= MOST) & some[:, None]
        if exceeds.any():
            squeezed = mended._replace(start=mended.start.copy(), jerk=mended.jerk.copy())
            for segment, joint in np.argwhere(exceeds):
                self._squeeze(squeezed, segment, joint)
            after = self.use(self.mended(squeezed))
            helps = exceeds & (after < use)
            use = np.where(helps, after, use)
            start = np.where(helps, squeezed.start, pieces.start)
            jerk = np.where(helps, squeezed.jerk, pieces.jerk)
            pieces = pieces._replace(start=start, jerk=jerk)
        return pieces, np.asarray((use <= MOST).all(axis=1))

    def _squeeze(self, pieces: Pieces, segment: int, joint: int) -> None:
        """Let a joint use the least share of its limits in a segment.

        The accelerations at inner breaks change, by a linear program. Without a jerk limit those at
        both ends of each piece do. Velocities within pieces are left to `use`.
        """
        used = pieces.lengths[:, segment, 0] > 0
        lengths = pieces.lengths[used, segment]
        start = pieces.start[used, segment, joint]
        own = Pieces(lengths[:, 0], start, pieces.jerk[used, segment, joint])
        limits = [sides[:, joint] for sides in self.limits]
        count = len(lengths)
        if np.isfinite(limits[-1]).any():
            at_breaks = np.eye(count + 1)[:, 1:-1]
            first = at_breaks[:-1]
            last = at_breaks[1:]
        else:
            first, last = np.eye(2 * count).reshape(2, count, -1)
        change = Pieces.straight(lengths, first, last)
        gained, position = change.passed(np.zeros(first.shape[1]))
        u, w, h = (table[segment, joint] for table in (self.u, self.w, self.h))
        velocity, _ = own.passed(u)
        found = _least(
            _shares(change, gained, limits),
            1 - _shares(own, velocity, limits),
            np.array([gained[-1], position[-1]]),
            own.missing(u, w, h),
        )
        pieces.start[used, segment, joint] += change.start @ found
        pieces.jerk[used, segment, joint] += change.jerk @ found


def _shares(pieces: Pieces, velocity: Array, limits: Sequence[Array]) -> Array:
    """Velocities, accelerations at the ends of pieces and jerks, relative to either limit."""
    accelerations = np.concatenate([pieces.start, pieces.end])
    tables = [velocity, accelerations, pieces.jerk]
    shares = []
    for table, sides in zip(tables, limits, strict=True):
        shares += [table / side for side in sides]
    return np.concatenate(shares)


def _least(matrix: Array, slack: Array, ends: Array, missed: Array) -> Array:
    """The `x` of least `e ≥ 0` with `matrix x ≤ slack + e` and `ends x = missed`, or zeros."""
    from scipy.optimize import linprog  # late: few motions need it

    rows, changes = matrix.shape
    if not np.isfinite(slack).all():
        return np.zeros(changes)
    # HiGHS's tolerance is absolute: a change of 1 takes the whole of a limit
    unit = 1 / np.abs(matrix).max(axis=0)
    gains = ends * unit
    sizes = np.abs(gains).max(axis=1, keepdims=True)
    found = linprog(
        np.append(np.zeros(changes), 1.0),
        A_ub=np.hstack([matrix * unit, -np.ones((rows, 1))]),
        b_ub=slack,
        A_eq=np.hstack([gains / sizes, np.zeros((2, 1))]),
        b_eq=missed / sizes[:, 0],
        bounds=[(None, None)] * changes + [(0.0, None)],
        options={
            "primal_feasibility_tolerance": _TOLERANCE,
            "dual_feasibility_tolerance": _TOLERANCE,
        },
    )
    return np.zeros(changes) if found.x is None else unit * found.x[:-1]
