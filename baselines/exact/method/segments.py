"""Motions of pieces between waypoints: corrected to meet the ends, thinned within the limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from baselines.exact.method.pieces import Pieces, correction, quotient
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.rounding import KEPT_RTOL

# Largest share of a limit that a motion may use. Larger: certified durations are above the claim by
# more. Smaller: more joints need the linear program, and more brief pieces stay.
MOST = 1 + 3e-10
_FEASIBILITY_TOL = 1e-10  # of the linear program, relative to the limits; the least of HiGHS
# Residuals at a segment's end, relative to its largest velocity or to the way at that velocity:
_ROUNDING_RTOL = 4e-15  # a smaller one is rounding: its correction would only add rounding
_MISSED_RTOL = 1e-12  # a larger one means that the motion misses its end: the verifier repairs it
# The same two between given velocities, where the judge dilates nothing: half of what it counts as
# rounding, and a residual that it need not repair.
MOST_IN_MOTION = 1 + KEPT_RTOL / 2
_MISSED_IN_MOTION_RTOL = 1e-14
# Largest share of a limit that a correction of rounding may use. Larger: limits are exceeded by as
# much. Smaller: more of the rounding stays.
_NEGLIGIBLE = 1e-13


class Segments(NamedTuple):
    """The waypoints and limits of some segments.

    Attributes:
        u: velocities at the start, `(segments, joints)`.
        w: velocities at the end, likewise.
        h: displacements, likewise.
        limits: of velocity, acceleration and jerk, `(2, segments, joints)` each, low first.
        most: largest share of a limit that a motion may use.
        missed: largest residual at the end, relative, of a motion that meets it.
    """

    u: Array
    w: Array
    h: Array
    limits: tuple[Array, Array, Array]
    most: float = MOST
    missed: float = _MISSED_RTOL

    @classmethod
    def under(cls, u: Array, w: Array, h: Array, *limits: Array) -> Self:
        """Return segments under three limits, each `(2, segments, joints)` or `(2, 1, joints)`."""
        velocity, acceleration, jerk = (np.broadcast_to(own, (2, *h.shape)) for own in limits)
        return cls(u, w, h, (velocity, acceleration, jerk))

    @property
    def jerky(self) -> Bools:
        """Return which joints have jerk limits, `(joints,)`: in all segments or in none."""
        return np.asarray(np.isfinite(self.limits[-1]).any(axis=(0, 1)))

    def of(self, some: Indices) -> Self:
        """Return some of the segments."""
        limits = (sides[:, some] for sides in self.limits)
        own = self.under(self.u[some], self.w[some], self.h[some], *limits)
        return own._replace(most=self.most, missed=self.missed)

    @property
    def undilated(self) -> Self:
        """Return the segments of a motion that cannot be dilated: it has to be accurate."""
        return self._replace(most=MOST_IN_MOTION, missed=_MISSED_IN_MOTION_RTOL)

    def missing(self, lengths: Array, passed: tuple[Array, Array], rtol: float) -> Array:
        """Return the residuals of velocity and displacement at the end, `(2, segments, joints)`.

        Args:
            lengths: of the pieces.
            passed: their velocities and positions at the breaks.
            rtol: a residual below this share of the largest velocity, or of the way at that
                velocity, counts as zero.
        """
        velocity, position = passed
        slow = self.w - velocity[-1]
        short = self.h - position[-1]
        speeds = np.abs(velocity).max(axis=0)
        times = lengths.sum(axis=0)
        ways = speeds * times
        is_slow = np.abs(slow) > rtol * speeds
        is_short = np.abs(short) > rtol * ways
        return np.where([is_slow, is_short], [slow, short], 0.0)

    def mended(self, pieces: Pieces) -> Pieces:
        """Return the pieces, corrected so that they end at the next waypoint with its velocity.

        A single piece gets its velocity only. A large correction leaves some rounding.
        """
        passed = pieces.passed(self.u)
        slow, short = self.missing(pieces.lengths, passed, _ROUNDING_RTOL)
        change = correction(pieces.lengths, slow, short, self.jerky)
        start, jerk = pieces.start + change.start, pieces.jerk + change.jerk
        return pieces._replace(start=start, jerk=jerk)

    def negligible(self, lengths: Array, slow: Array, short: Array) -> Pieces:
        """Return the correction of rounding at the ends, zero where it uses a limit noticeably.

        Args:
            lengths: of the pieces.
            slow, short: what velocity and displacement lack, `(segments, joints)`.
        """
        change = correction(lengths, slow, short, self.jerky)
        shares = _shares(change, 0 * change.start, self.limits)
        is_negligible = shares.max(axis=0) <= _NEGLIGIBLE
        start, jerk = (np.where(is_negligible, table, 0.0) for table in change[1:])
        return Pieces(lengths, start, jerk)

    def use(self, pieces: Pieces) -> Array:
        """Return the largest share of a limit that each joint uses, `(segments, joints)`.

        It is infinite where the pieces miss their end.
        """
        takes_time = pieces.lengths > 0
        first = np.where(takes_time, pieces.start, 0.0)
        jerk = np.where(takes_time, pieces.jerk, 0.0)
        own = Pieces(pieces.lengths, first, jerk)
        passed = own.passed(self.u)
        velocity, _ = passed
        speeds = velocity[:-1]
        # Within a piece velocity is extreme where the acceleration is zero.
        is_inside = first * own.end < 0
        lost = quotient(first**2, 2 * jerk, is_inside)
        velocities = np.concatenate([speeds, speeds - lost])
        shares = _shares(own, velocities, self.limits)
        misses = self.missing(own.lengths, passed, self.missed).any(axis=0)
        return np.where(misses, np.inf, shares.max(axis=0))

    def kept(self, pieces: Pieces, some: Bools) -> tuple[Pieces, Bools]:
        """Return the corrected pieces, and in which segments they keep the limits.

        Where a joint exceeds a limit in one of the segments of `some`, a linear program changes its
        accelerations, if that lowers its use.
        """
        mended = self.mended(pieces)
        use = self.use(mended)
        exceeds = ~(use <= self.most) & some[:, None]
        if exceeds.any():
            squeezed = Pieces(*(table.copy() for table in mended))
            for segment, joint in np.argwhere(exceeds):
                self._squeeze(squeezed, segment, joint)
            squeezed = self.mended(squeezed)
            after = self.use(squeezed)
            helps = after < use
            use = np.where(helps, after, use)
            start = np.where(helps, squeezed.start, mended.start)
            jerk = np.where(helps, squeezed.jerk, mended.jerk)
            mended = mended._replace(start=start, jerk=jerk)
        return mended, np.asarray((use <= self.most).all(axis=1))

    def thinned(self, pieces: Pieces, close: Array, brief: Array | float) -> Pieces:
        """Return the pieces without breaks that are close to another, where the limits are kept.

        In each segment the break with the least distance is tried first. After each removal all
        breaks are tried again.

        Args:
            pieces: corrected or not; those that are returned are corrected.
            close: breaks at a smaller distance are tried, `(segments,)`.
            brief: to remove a piece that takes less, a linear program is tried too, `(segments,)`.
        """
        brief = np.broadcast_to(brief, close.shape)
        every = np.arange(len(close))
        pieces, _ = self.kept(pieces, np.full(len(close), True))
        pieces = pieces._replace(lengths=pieces.lengths.copy())
        lengths = pieces.lengths[..., 0]
        before = lengths[:-1]
        after = lengths[1:]
        # Three pieces can meet any end. One of constant acceleration meets the end that it has.
        fewest = 3 if self.jerky.any() else 1
        is_needed = np.zeros(before.shape, dtype=bool)
        while True:
            distance = np.minimum(before, after)
            is_end = after == 0
            distance[is_needed | is_end] = np.inf
            closest = distance.argmin(axis=0)
            least = distance[closest, every]
            is_spare = (lengths > 0).sum(axis=0) > fewest
            is_close = least < close
            (tried,) = np.nonzero(is_spare & is_close)
            if not tried.size:
                return pieces
            place = closest[tried]
            joined = pieces.of(tried).joined(place, self.jerky)
            fewer, keeps = self.of(tried).kept(joined, least[tried] < brief[tried])
            gone = tried[keeps]
            for table, changed in zip(pieces, fewer, strict=True):
                table[:, gone] = changed[:, keeps]
            is_needed[:, gone] = False
            is_needed[place[~keeps], tried[~keeps]] = True

    def _squeeze(self, pieces: Pieces, segment: int, joint: int) -> None:
        """Lower the largest share of a limit that a joint uses in a segment, in place.

        A linear program changes the accelerations at inner breaks (without a jerk limit, those of
        the pieces). The end state stays. Extreme velocities within pieces are not constrained;
        `use` checks them.
        """
        used = pieces.lengths[:, segment, 0] > 0
        lengths = pieces.lengths[used, segment]
        start = pieces.start[used, segment, joint]
        own = Pieces(lengths[:, 0], start, pieces.jerk[used, segment, joint])
        limits = [sides[:, segment, joint] for sides in self.limits]
        count = len(lengths)
        change = Pieces(lengths, np.eye(count), np.zeros((count, count)))
        if self.jerky[joint]:
            at_breaks = np.eye(count + 1)[:, 1:-1]
            change = Pieces.straight(lengths, at_breaks[:-1], at_breaks[1:])
        gained, _ = change.passed(0 * change.start[0])
        velocity, _ = own.passed(self.u[segment, joint])
        found = _least(
            _shares(change, gained, limits),
            1 - _shares(own, velocity, limits),
            np.array(change.gained),
        )
        pieces.start[used, segment, joint] += change.start @ found
        pieces.jerk[used, segment, joint] += change.jerk @ found


def _shares(pieces: Pieces, velocity: Array, limits: Sequence[Array]) -> Array:
    """Return velocities, accelerations at breaks, and jerks, each over its low and high limit."""
    accelerations = np.concatenate([pieces.start, pieces.end])
    tables = [velocity, accelerations, pieces.jerk]
    shares = []
    for table, sides in zip(tables, limits, strict=True):
        shares += [table / side for side in sides]
    return np.concatenate(shares)


def _least(matrix: Array, slack: Array, ends: Array) -> Array:
    """Return `x` with the least `e ≥ 0`, `matrix x ≤ slack + e` and `ends x = 0`; zeros if none."""
    from scipy.optimize import linprog  # late: few motions need it

    rows, changes = matrix.shape
    if not np.isfinite(slack).all():
        return np.zeros(changes)
    # HiGHS's tolerance is absolute, so a change of 1 is scaled to use the whole of a limit.
    unit = 1 / np.abs(matrix).max(axis=0)
    gains = ends * unit
    sizes = np.abs(gains).max(axis=1, keepdims=True)
    found = linprog(
        np.append(np.zeros(changes), 1.0),
        A_ub=np.hstack([matrix * unit, -np.ones((rows, 1))]),
        b_ub=slack,
        A_eq=np.hstack([gains / sizes, np.zeros((2, 1))]),
        b_eq=np.zeros(2),
        bounds=[(None, None)] * changes + [(0.0, None)],
        options={
            "primal_feasibility_tolerance": _FEASIBILITY_TOL,
            "dual_feasibility_tolerance": _FEASIBILITY_TOL,
        },
    )
    return np.zeros(changes) if found.x is None else unit * found.x[:-1]
