"""The inequalities of the program of `exact.acceleration`, and its Newton steps.

A cell depends on one segment time and on two waypoints (`exact.acceleration.cells`). A step
eliminates its two peaks in closed form; `exact.method.chain` solves for the rest. There an offset
stands where the program with jerk limits has an acceleration.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np

from baselines.exact.acceleration.cells import (
    START_BARRIER,
    AccelerationTables,
    AccelerationUnknowns,
    both_sides,
)
from baselines.exact.method.chain import Chain, Links
from baselines.exact.method.interior_point import chosen, joined, moved
from trajopt.core.arrays import Array, Bools, Indices

ROOM, REACH, PASSING = range(3)  # kinds of inequalities; then those of the demands
_UP_AND_DOWN = np.reshape([1.0, -1.0], (2, 1, 1))


class Gradients(NamedTuple):
    """Gradients of the inequalities, each times a number, by a cell's variables.

    Attributes:
        s: over the logarithm of the time, `(2 sides, starts, segments, joints)`.
        x: over the states of the ends, `(states, 2 sides, starts, segments, joints)`.
        p: over the peak, `(2 sides, starts, segments, joints)`.
    """

    s: Array
    x: Array
    p: Array


class AccelerationInequalities:
    """Every inequality of the program at a point: its value and its derivatives.

    Each side of a cell has two inequalities: `room`, the slack of the peak `p` below the velocity
    limit, and `reach`, the extreme displacement minus `h`. Their derivatives by the logarithm `s`
    of the time `T`, the states `x` of the ends and the peak `p` are `room_s`, `room_p`, `reach_x`
    and `reach_p`. The states are the velocity at each end; with a tolerance, velocity and offset.

    Where limits differ from segment to segment there is a third one, `passing`: the slack of the
    velocity at a cell's end below the tighter limit of both segments there. Its derivatives by `s`
    and that end's `x` are `passing_s` and `passing_x`. With the same limits in all segments it is
    not needed (mathematics, section 4).

    Demands add their own. A kind that a cell does not have is the constant 1 there.

    - *Tolerance* `r`: `|offset| ≤ r`. The displacement grows by the offset at the cell's end less
      the one at its start, so the reach falls by this `way`, in the cell's units.
    - *Least times* `τ`: `log T ≥ log τ`; latest times, which keep an initial guess before a gap,
      are the same with `≤`.

    Attributes:
        values: slacks, negative where an inequality is violated,
            `(kinds, 2 sides, starts, segments, joints)`.
        times: of the segments, `(starts, segments)`.
        t: the same for every joint.
        x: end velocities for both sides, mirrored for the lower one.
        velocities, offsets: where these are among the states of the ends.
        cruise: velocity of the cruise, in units of `AccelerationTables.top`.
    """

    start_slack = 0.1
    min_gap_rtol = 1e-13
    max_log_step = 1.0
    velocities = slice(None)

    def __init__(self, cells: AccelerationTables, point: AccelerationUnknowns) -> None:
        peaks = point.peaks
        in_stop_times = np.exp(point.log)
        times = cells.stop * in_stop_times
        by_segment = times[..., None]
        t = by_segment * cells.ones
        # (V − h/T − p T) / top
        mean = cells.h_by_top / t
        room_p = -t / cells.top
        falling = room_p * peaks
        cruise = mean - falling
        # p − (p − u)²/(2 A2) − (p − w)²/(2 A1)
        x = both_sides(point.ends)
        risen = peaks - x
        reach_x = risen / cells.a
        spent_each = risen * reach_x
        spent = spent_each[0] + spent_each[1]
        of_both_ends = reach_x[0] + reach_x[1]
        values = np.empty((cells.kinds, *cells.lowest.shape[1:]))
        values[ROOM] = cells.fastest - cruise
        values[REACH] = peaks - spent / 2
        if cells.passing is not None:
            from_mean = room_p * x[1]
            is_inner = np.isfinite(cells.passing)
            values[PASSING] = np.where(is_inner, cells.passing - mean + from_mean, 1.0)
            self.passing_s = np.where(is_inner, mean + from_mean, 0.0)
            self.passing_x = np.where(is_inner, room_p, 0.0)
        if cells.tolerant or cells.timed:
            # a time may tend to 0, or a box may be as wide as the displacement
            self.max_iterations = 300
        if cells.tolerant:
            first, last = both_sides(cells.offsets(point.offset))
            self.way = (last - first) / t**2
            values[REACH] -= self.way
            self.box = cells.kinds - 1 - cells.timed
            values[self.box] = np.where(cells.free, 1 - last / cells.box, 1.0)
            self.box_x = -(cells.free / cells.box)
            by_way = np.array([cells.free_before, -1.0 * cells.free]) / t**2
            by_offsets = np.repeat(by_way[:, None], 2, axis=1)
            reach_x = np.stack([reach_x, by_offsets], axis=1).reshape(4, *x.shape[1:])
            self.velocities, self.offsets = slice(None, None, 2), slice(1, None, 2)
        if cells.timed:
            least, latest = cells.bounded
            longer = np.log(times / np.where(least, cells.scaled.least, 1.0))
            earlier = np.log(np.where(latest, cells.latest, 1.0) / times)
            # they stand in the cell of the first joint
            values[-1] = 1.0
            values[-1, ..., 0] = np.where(cells.bounded, [longer, earlier], 1.0)
            self.timed_s = cells.bounded * _UP_AND_DOWN

        self.cells = cells
        self.point = point
        self.values = values
        self.start_barrier = np.full(len(times), START_BARRIER)
        self.times = times
        self.t = t
        self.x = x
        self.cruise = cruise
        self.room_s = mean + falling
        self.room_p = room_p
        self.reach_x = reach_x
        self.reach_p = 1 - of_both_ends

    def linear(self, multipliers: Array, weights: Array) -> AccelerationLinearisation:
        """Return the linear model; `weights` are multiplier over slack of each inequality."""
        return AccelerationLinearisation(self, multipliers, weights)

    def after(self, step: AccelerationUnknowns, length: Array) -> Self:
        """Return the inequalities after a step of this length, with clipped unknowns."""
        cells = self.cells
        return type(self)(cells, cells.clipped(moved(self.point, step, length)))

    def follows(self, before: AccelerationInequalities) -> Bools:
        """Return that every point is allowed: clipping replaces a line search."""
        return np.ones(len(self.times), dtype=bool)

    def of(self, some: Bools | Indices) -> Self:
        """Return the inequalities of some of the starts."""
        return type(self)(self.cells.of(some), chosen(self.point, some))

    def with_others(self, others: Sequence[Self]) -> Self:
        """Return the inequalities of these starts, then of the others."""
        cells = self.cells.with_others([own.cells for own in others])
        return type(self)(cells, joined([self.point, *(own.point for own in others)]))

    @cached_property
    def missing(self) -> Array:
        """Residual of the links in units of the cells' ends, `(2, starts, segments, joints)`."""
        mean, _ = self.cells.h / self.t
        excess = self.cells.at_ends(self.point.velocity) - mean
        return excess / self.t - self.point.ends

    @property
    def apart(self) -> Array:
        """Return the largest residual of a link, in units of the highest velocity, `(starts,)`."""
        missed = np.abs(self.missing * self.room_p)
        return missed.max(axis=(0, 2, 3))

    def gradients(self, numbers: Array) -> Gradients:
        """Return the inequalities' gradients, times a number each."""
        cells = self.cells
        room, reach = numbers[:2]
        by_s = self.room_s * room
        by_x = self.reach_x * reach
        by_p = self.room_p * room
        by_p += self.reach_p * reach
        if cells.passing is not None:
            by_s += self.passing_s * numbers[PASSING]
            by_x[self.velocities][1] += self.passing_x * numbers[PASSING]
        if cells.tolerant:
            by_s += 2 * self.way * reach
            by_x[-1] += self.box_x * numbers[self.box]
        if cells.timed:
            by_s[..., 0] += self.timed_s * numbers[-1, ..., 0]
        return Gradients(by_s, by_x, by_p)

    def change(self, step: AccelerationUnknowns, x: Array) -> Array:
        """Return the change of every inequality in a step, whose ends' states are `x`."""
        cells = self.cells
        s = step.log[..., None]
        peaks = step.peaks
        change = np.empty_like(self.values)
        by_time = self.room_s * s
        change[ROOM] = by_time + self.room_p * peaks
        reached = self.reach_x * x
        change[REACH] = reached.sum(axis=0) + self.reach_p * peaks
        if cells.passing is not None:
            change[PASSING] = self.passing_s * s + self.passing_x * x[self.velocities][1]
        if cells.tolerant:
            change[REACH] += 2 * self.way * s
            change[self.box] = self.box_x * x[-1]
        if cells.timed:
            change[-1] = 0.0
            change[-1, ..., 0] = self.timed_s * step.log
        return change


class AccelerationLinearisation:
    """The program near a point: linear inequalities, a quadratic objective, peaks eliminated.

    Variables are the logarithm `s` of the time `T`, the states `x` of the ends and the peaks `p`.
    The matrix is the Lagrangian's Hessian, plus each inequality's gradient squared times its
    weight.

    Args:
        rows: the inequalities at the point.
        multipliers: of the inequalities.
        weights: `z / s` of each inequality, multiplier over slack.
    """

    def __init__(self, rows: AccelerationInequalities, multipliers: Array, weights: Array) -> None:
        cells = rows.cells
        y_room, y_reach = multipliers[:2]
        w_room, w_reach = weights[:2]
        t = rows.t
        room_s = rows.room_s
        room_p = rows.room_p
        reach_x = rows.reach_x
        reach_p = rows.reach_p

        # of each pair of states: w ∂reach/∂x ∂reach/∂x'
        weighted = w_reach * reach_x
        pairs = [(i, j) for i in range(len(reach_x)) for j in range(i + 1, len(reach_x))]
        across = [weighted[i] * reach_x[j] for i, j in pairs]
        # The second derivative of the reach over velocities and p is 1/a. xx = y/a + w (∂reach/∂x)²
        curved = y_reach / cells.a
        xx = weighted * reach_x
        xx[rows.velocities] += curved
        # xp = w ∂reach/∂x ∂reach/∂p − y/a
        xp = weighted * reach_p
        xp[rows.velocities] -= curved
        # pp = Σ y/a + w (∂room/∂p)² + w (∂reach/∂p)²
        pressed = w_room * room_p
        pp = curved.sum(axis=0) + pressed * room_p + w_reach * reach_p**2
        # velocities count from the mean one, which depends on s
        mean = cells.h / t
        steep = mean / t
        sx = y_reach * reach_x
        sp = pressed * room_s - y_room * room_p
        ss = (sx[rows.velocities] * (steep + rows.x)).sum(axis=0)
        ss += w_room * room_s**2 + y_room * rows.cruise

        if cells.passing is not None:
            # linear in the waypoint's velocity: no second derivative
            weighted_s = weights[PASSING] * rows.passing_s
            ss += weighted_s * rows.passing_s
            sx[rows.velocities][1] += weighted_s * rows.passing_x
            xx[rows.velocities][1] += weights[PASSING] * rows.passing_x**2
        if cells.tolerant:
            # the reach falls by way / T²: its derivative by s is 2 way / T²
            reach_s = 2 * rows.way
            sx[rows.offsets] *= 2
            sx += weighted * reach_s
            sp += w_reach * reach_s * reach_p
            ss += 2 * y_reach * reach_s + w_reach * reach_s**2
            xx[-1] += weights[rows.box] * rows.box_x**2
        if cells.timed:
            ss[..., 0] += weights[-1, ..., 0] * cells.bounded

        # Schur complement of the peaks: A −= b bᵀ / pp, where b are xp and sp
        peak_x = xp / pp
        peak_s = sp / pp
        ss -= sp * peak_s
        sx -= xp * peak_s
        xx -= xp * peak_x

        # the sum of both sides, over s and the states of the ends
        matrix = np.empty((*t.shape, 1 + len(xx), 1 + len(xx)))
        matrix[..., 0, 0] = ss.sum(axis=0)
        for (i, j), own in zip(pairs, across, strict=True):
            own -= xp[i] * peak_x[j]
            matrix[..., 1 + i, 1 + j] = matrix[..., 1 + j, 1 + i] = own.sum(axis=0)
        for i, over_s in enumerate(_both(sx)):
            matrix[..., 0, 1 + i] = over_s
            matrix[..., 1 + i, 0] = over_s
            matrix[..., 1 + i, 1 + i] = xx[i].sum(axis=0)
        if cells.tolerant:
            # an exact waypoint has no offset: an entry on the diagonal keeps the matrix regular
            matrix[..., -1, -1] += ~cells.free
        links = Links(steep[0] - rows.point.ends, rows.missing)
        self.rows = rows
        self.pp = pp
        self.peak_x = peak_x
        self.peak_s = peak_s
        self.links = links
        self.chain = Chain(rows.times, links, matrix, cells.scaled.closed)

    def slope(self, multipliers: Array) -> Array:
        """Return the largest entry of the Lagrangian's gradient, `(starts,)`."""
        by_s, by_x, by_p = self.rows.gradients(multipliers)
        steepest_peak = np.abs(by_p).max(axis=(0, 2, 3))
        by_cell = _by_cell(by_s, by_x)
        steepest = np.maximum(self.chain.steepest(by_cell), steepest_peak)
        cells = self.rows.cells
        if not cells.tolerant:
            return steepest
        # offsets count in units of their boxes
        over = np.abs(self.chain.offsets(self.chain.gradient(by_cell)))
        return np.maximum(steepest, (over * cells.box[:, : over.shape[1]]).max(axis=(1, 2)))

    def step(self, aim: Array) -> tuple[AccelerationUnknowns, Array]:
        """Return the Newton step for target multipliers, and the change of every inequality."""
        by_s, by_x, by_p = self.rows.gradients(aim)
        by_s -= self.peak_s * by_p
        by_x -= self.peak_x * by_p
        solved = self.chain.step(_by_cell(by_s, by_x))

        # Back substitution: p from s and x.
        states = solved.cells[..., 1:].transpose(3, 0, 1, 2)
        x = both_sides(states)
        s = solved.log[..., None]
        peaks = by_p / self.pp - self.peak_s * s - (self.peak_x * x).sum(axis=0)
        offset = np.zeros_like(solved.velocity)
        if self.rows.cells.tolerant:
            offset = states[-1][:, : offset.shape[1]]
        inner = np.array([states[self.rows.velocities], peaks])
        step = AccelerationUnknowns(solved.log, solved.velocity, inner, offset)
        return step, self.rows.change(step, x)

    def bending(self, step: AccelerationUnknowns) -> None:
        """Return None: clipping replaces a second-order correction."""


def _both(by_side: Array) -> Array:
    """Return the sum of both sides, with the signs of the upper one: `(n, 2, …)` to `(n, …)`."""
    return by_side[:, 0] - by_side[:, 1]


def _by_cell(by_s: Array, by_x: Array) -> Array:
    """Return the gradient by `s` and the ends' states, sides summed, variables on the last axis."""
    _, *cells = by_s.shape
    gradient = np.empty((*cells, 1 + len(by_x)))  # in place of `np.stack`, 10 us slower
    gradient[..., 0] = by_s.sum(axis=0)
    for i, by_state in enumerate(_both(by_x)):
        gradient[..., 1 + i] = by_state
    return gradient
