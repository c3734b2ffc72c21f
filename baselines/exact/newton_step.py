"""Newton steps of the program of `exact.acceleration`.

A cell depends on one segment time and two waypoint velocities (`exact.cells`). So a step eliminates
peaks and end velocities in closed form, all cells at once; what is left is a banded matrix as wide
as there are joints, and its work grows in proportion to the segments.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from baselines.exact.cells import Point, Rows, at_ends, both_sides

Array = NDArray[np.float64]


class Linear:
    """The program near a point: rows linear, the objective quadratic, peaks and ends eliminated.

    With `s` the logarithm of the time `T`, `x` an end velocity and `p` a peak. The matrix over
    them is the Lagrangian's, and each row's gradient squared times its weight.

    Args:
        rows: the program at the point.
        multipliers: of the rows.
        weights: what their squares count.
    """

    def __init__(
        self,
        rows: Rows,
        multipliers: Array,
        weights: Array,
    ) -> None:
        cells = rows.cells
        ends = rows.point.ends
        y_room, y_reach = multipliers
        w_room, w_reach = weights
        t = rows.t
        room_s = rows.room_s
        room_p = rows.room_p
        reach_x = rows.reach_x
        reach_p = rows.reach_p

        # the matrix over x and p
        curved = y_reach / cells.a
        weighted = w_reach * reach_x
        squared = weighted * reach_x
        xx = curved + squared
        uw = weighted[0] * reach_x[1]
        xp = weighted * reach_p
        xp -= curved
        pressed = w_room * room_p
        pp = curved[0] + curved[1]
        pp += pressed * room_p
        pp += w_reach * reach_p**2
        # and over s: x counts from the mean velocity, so its share of the Lagrangian bends
        mean = cells.h / t
        steep = mean / t
        sx = y_reach * reach_x
        sp = pressed * room_s
        sp -= y_room * room_p
        bent = sx * (steep + rows.x)
        ss = bent[0] + bent[1]
        ss += w_room * room_s**2
        ss += y_room * rows.cruise

        # peaks eliminated; then both sides are one
        peak_x = xp / pp
        peak_s = sp / pp
        ss -= sp * peak_s
        sx -= xp * peak_s
        xx -= xp * peak_x
        uw -= xp[0] * peak_x[1]

        self.rows = rows
        self.pp = pp
        self.peak_x = peak_x
        self.peak_s = peak_s
        self.ss = ss[0] + ss[1]
        self.sx = _both(sx)
        self.xx = xx[:, 0] + xx[:, 1]
        self.uw = uw[0] + uw[1]
        # x = (v − h/T)/T: its slope over s, and what it misses
        self.slope_x = steep[0] - ends
        at_waypoints = at_ends(rows.point.velocity)
        excess = at_waypoints - mean[0]
        self.missing = excess / t - ends

    @cached_property
    def apart(self) -> Array:
        """The most that an end velocity differs from its waypoint's, in the fastest ones."""
        missing = self.missing * self.rows.room_p
        return np.asarray(np.abs(missing).max(axis=(0, 2, 3)))

    def matrices(self) -> Array:
        """The rest over `(s, v)`, segment by segment, as LAPACK's lower band, of every start."""
        rows = self.rows
        starts, segments, joints = rows.cells.every
        slope = self.slope_x
        pulled = self._pulled(slope)
        twice = 2 * self.sx
        along = slope * (twice + pulled)
        ss = self.ss + along[0] + along[1]
        sv = self.sx + pulled
        sv /= rows.t
        squared = rows.t**2
        vv = self.xx / squared
        across = self.uw / squared

        # columns: a segment's time, then the velocities after it; after the last there are none
        columns = joints + 1
        height = joints + 2
        band = np.zeros((starts, segments, columns, height))
        times = band[:, :, 0]
        velocities = band[:, :-1, 1:]
        diagonal = velocities[..., 0]
        times[..., 0] = ss.sum(axis=2)
        times[..., 0] += rows.times
        before, after = _around(vv)
        np.add(before, after, out=diagonal)
        band[:, -1, 1:, 0] = 1.0
        # a time beside the velocities after it, and the next time beside them
        before, after = _around(sv)
        joint = np.arange(joints)
        times[:, :-1, 1:-1] = before
        velocities[:, :, joint, joints - joint] = after
        velocities[:, :-1, :, -1] = across[:, 1:-1]
        by_start = band.reshape(starts, -1, height)
        return by_start.swapaxes(1, 2)

    def slope(self, multipliers: Array) -> Array:
        """The largest entry of the Lagrangian's gradient, `(starts,)`."""
        by = self.rows.gradients(multipliers)
        down = self._descent(by.s[0] + by.s[1], _both(by.x))
        steepest = np.abs(down).max(axis=(1, 2))
        steepest_peak = np.abs(by.p).max(axis=(0, 2, 3))
        return np.asarray(np.maximum(steepest, steepest_peak))

    def step(self, factors: Sequence[Array], aim: Array) -> tuple[Point, Array]:
        """The Newton step to multipliers, and by how much it changes every row.

        Args:
            factors: the Cholesky factors of `matrices`.
            aim: the multipliers, less what the rows' misses cost.
        """
        import scipy  # late: planners that are only listed need none of it

        rows = self.rows
        by_s, by_x, by_p = rows.gradients(aim)
        by_s -= self.peak_s * by_p
        by_x -= self.peak_x * by_p
        cost = self.sx * self.missing
        segment_s = by_s[0] + by_s[1]
        segment_s -= cost[0]
        segment_s -= cost[1]
        ends_x = _both(by_x)
        ends_x -= self._pulled(self.missing)
        columns = self._descent(segment_s, ends_x)
        for factor, own in zip(factors, columns, strict=True):
            solved, _ = scipy.linalg.lapack.dpbtrs(factor, own.ravel(), lower=1)
            own[:] = solved.reshape(own.shape)

        log = columns[..., 0]
        velocity = columns[:, :-1, 1:]
        s = log[..., None]
        inner = np.empty((2, *self.missing.shape))
        ends, peaks = inner
        np.divide(at_ends(velocity), rows.t, out=ends)
        ends += self.slope_x * s
        ends += self.missing
        x = both_sides(ends)
        led = self.peak_x * x
        np.divide(by_p, self.pp, out=peaks)
        peaks -= self.peak_s * s
        peaks -= led[0] + led[1]
        step = Point(log, velocity, inner)
        return step, rows.change(step, x)

    def _pulled(self, ends: Array) -> Array:
        """The matrix over both ends, times these."""
        other = self.uw * ends[::-1]
        return np.asarray(self.xx * ends + other)

    def _descent(self, by_s: Array, by_x: Array) -> Array:
        """Gradients over `(s, v)`, a row per segment, less that of the duration."""
        rows = self.rows
        starts, segments, joints = rows.cells.every
        through_x = self.slope_x * by_x
        by_time = by_s + through_x[0] + through_x[1]
        by_end = by_x / rows.t
        down = np.zeros((starts, segments, joints + 1))
        times = down[..., 0]
        times += by_time.sum(axis=2)
        times -= rows.times
        before, after = _around(by_end)
        velocities = down[:, :-1, 1:]
        np.add(before, after, out=velocities)
        return down


def _around(by_end: Array) -> tuple[Array, Array]:
    """Of the ends `(2, starts, segments, joints)`, those before and after the inner waypoints."""
    starts, ends = by_end
    return ends[:, :-1], starts[:, 1:]


def _both(by_side: Array) -> Array:
    """Of both sides together, seen from the upper one: `(2, 2, …)` to `(2, …)`."""
    upper = by_side[:, 0]
    lower = by_side[:, 1]
    return np.asarray(upper - lower)
