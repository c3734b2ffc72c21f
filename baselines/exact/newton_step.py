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
        point = rows.point
        y_room, y_reach = multipliers
        w_room, w_reach = weights
        t = rows.t
        room_s = rows.room_s
        room_p = rows.room_p
        reach_x = rows.reach_x
        reach_p = rows.reach_p

        # Over x and p the reach bends by 1/a, the same for both. xx = y/a + w (∂reach/∂x)²
        curved = y_reach / cells.a
        weighted = w_reach * reach_x
        squared = weighted * reach_x
        xx = curved + squared
        # of the one end and the other: uw = w ∂reach/∂u ∂reach/∂w
        weighted_start = weighted[0]
        reach_end = reach_x[1]
        uw = weighted_start * reach_end
        # xp = w ∂reach/∂x ∂reach/∂p − y/a
        xp = weighted * reach_p
        xp -= curved
        # pp = Σ y/a + w (∂room/∂p)² + w (∂reach/∂p)²
        pressed = w_room * room_p
        pp = _sum(curved)
        pp += pressed * room_p
        pp += w_reach * reach_p**2
        # and over s: x counts from the mean velocity, so its share of the Lagrangian bends
        mean = cells.h / t
        steep = mean / t
        sx = y_reach * reach_x
        sp = pressed * room_s
        sp -= y_room * room_p
        bent = sx * (steep + rows.x)
        ss = _sum(bent)
        ss += w_room * room_s**2
        ss += y_room * rows.cruise

        # peaks eliminated (Schur complement): A −= b bᵀ / pp, where b are xp and sp
        peak_x = xp / pp
        peak_s = sp / pp
        ss -= sp * peak_s
        sx -= xp * peak_s
        xx -= xp * peak_x
        peak_start = xp[0]
        peak_end = peak_x[1]
        uw -= peak_start * peak_end

        # then both sides are one
        self.rows = rows
        self.pp = pp
        self.peak_x = peak_x
        self.peak_s = peak_s
        self.ss = _sum(ss)
        self.sx = _both(sx)
        upper_xx = xx[:, 0]
        lower_xx = xx[:, 1]
        self.xx = upper_xx + lower_xx
        self.uw = _sum(uw)
        # x = (v − h/T)/T: its slope over s, and what it misses
        ends = point.ends
        upper_mean = mean[0]
        upper_steep = steep[0]
        self.slope_x = upper_steep - ends
        at_waypoints = at_ends(point.velocity)
        excess = at_waypoints - upper_mean
        self.missing = excess / t - ends

    @cached_property
    def apart(self) -> Array:
        """The most that an end velocity differs from its waypoint's, in the fastest ones."""
        missing = self.missing * self.rows.room_p
        return _largest(missing)

    def matrices(self) -> Array:
        """The rest over `(s, v)`, segment by segment, as LAPACK's lower band, of every start."""
        rows = self.rows
        starts, segments, joints = rows.cells.every
        slope = self.slope_x
        pulled = self._pulled(slope)
        twice = 2 * self.sx
        along = slope * (twice + pulled)
        ss = self.ss + along[0]
        ss += along[1]
        sv = self.sx + pulled
        sv /= rows.t
        squared = rows.t**2
        vv = self.xx / squared
        across = self.uw / squared

        # columns: a segment's time, then the velocities after it; after the last there are none
        columns = joints + 1
        height = joints + 2
        shape = (starts, segments, columns, height)
        band = np.zeros(shape)
        times = band[:, :, 0]
        velocities = band[:, :-1, 1:]
        none = band[:, -1, 1:]
        # the diagonal
        own_time = times[..., 0]
        own_time += ss.sum(axis=2)
        own_time += rows.times
        own_velocity = velocities[..., 0]
        before, after = _around(vv)
        np.add(before, after, out=own_velocity)
        none[..., 0] = 1.0
        # a time beside the velocities after it, and the next time beside them
        before, after = _around(sv)
        beside = times[:, :-1]
        beside[..., 1:-1] = before
        joint = np.arange(joints)
        to_next_time = joints - joint
        velocities[:, :, joint, to_next_time] = after
        # a velocity beside the same joint's at the next waypoint
        farthest = velocities[..., -1]
        between = across[:, 1:-1]
        farthest[:, :-1] = between
        by_start = band.reshape(starts, -1, height)
        return by_start.swapaxes(1, 2)

    def slope(self, multipliers: Array) -> Array:
        """The largest entry of the Lagrangian's gradient, `(starts,)`."""
        rows = self.rows
        by_s, by_x, by_p = rows.gradients(multipliers)
        segment_s = _sum(by_s)
        ends_x = _both(by_x)
        down = self._descent(segment_s, ends_x)
        size = np.abs(down)
        steepest = size.max(axis=(1, 2))
        steepest_peak = _largest(by_p)
        return np.asarray(np.maximum(steepest, steepest_peak))

    def step(
        self,
        factors: Sequence[Array],
        aim: Array,
    ) -> tuple[Point, Array]:
        """The Newton step to multipliers, and by how much it changes every row.

        Args:
            factors: the Cholesky factors of `matrices`.
            aim: the multipliers, less what the rows' misses cost.
        """
        import scipy  # late: planners that are only listed need none of it

        rows = self.rows
        missing = self.missing
        by_s, by_x, by_p = rows.gradients(aim)
        # peaks eliminated, ends where their waypoints are
        by_s -= self.peak_s * by_p
        by_x -= self.peak_x * by_p
        cost = self.sx * missing
        segment_s = _sum(by_s)
        segment_s -= cost[0]
        segment_s -= cost[1]
        ends_x = _both(by_x)
        ends_x -= self._pulled(missing)
        columns = self._descent(segment_s, ends_x)
        dpbtrs = scipy.linalg.lapack.dpbtrs
        for factor, own in zip(factors, columns, strict=True):
            flat = own.ravel()
            solved, _ = dpbtrs(factor, flat, lower=1)
            own[:] = solved.reshape(own.shape)

        # back: x from s and v, p from s and x
        log = columns[..., 0]
        velocity = columns[:, :-1, 1:]
        s = log[..., None]
        shape = (2, *missing.shape)
        inner = np.empty(shape)
        ends, peaks = inner
        at_waypoints = at_ends(velocity)
        np.divide(at_waypoints, rows.t, out=ends)
        ends += self.slope_x * s
        ends += missing
        x = both_sides(ends)
        led = self.peak_x * x
        np.divide(by_p, self.pp, out=peaks)
        peaks -= self.peak_s * s
        peaks -= _sum(led)
        step = Point(log, velocity, inner)
        return step, rows.change(step, x)

    def _pulled(self, ends: Array) -> Array:
        """The matrix over both ends, times these."""
        opposite = ends[::-1]
        own: Array = self.xx * ends
        other = self.uw * opposite
        own += other
        return own

    def _descent(self, by_s: Array, by_x: Array) -> Array:
        """Gradients over `(s, v)`, a row per segment, less that of the duration."""
        rows = self.rows
        starts, segments, joints = rows.cells.every
        through_x = self.slope_x * by_x
        by_time = by_s + through_x[0]
        by_time += through_x[1]
        by_end = by_x / rows.t
        shape = (starts, segments, joints + 1)
        down = np.zeros(shape)
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
    before = ends[:, :-1]
    after = starts[:, 1:]
    return before, after


def _both(by_side: Array) -> Array:
    """Of both sides together, seen from the upper one: `(2, 2, …)` to `(2, …)`."""
    upper = by_side[:, 0]
    lower = by_side[:, 1]
    both: Array = upper - lower
    return both


def _sum(pair: Array) -> Array:
    """Of the two on the first axis."""
    total: Array = pair[0] + pair[1]
    return total


def _largest(values: Array) -> Array:
    """The largest size of `(2, starts, segments, joints)`, `(starts,)`."""
    size = np.abs(values)
    largest = size.max(axis=(0, 2, 3))
    return np.asarray(largest)
