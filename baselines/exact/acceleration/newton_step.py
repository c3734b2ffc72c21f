"""The inequalities of the program of `exact.acceleration`, and its Newton steps.

A cell depends on one segment time and on two waypoint velocities (`exact.acceleration.cells`). A
step eliminates its two peaks in closed form; `exact.method.chain` solves for the rest.
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


class Gradients(NamedTuple):
    """Gradients of the inequalities, each times a number, by a cell's variables.

    Attributes:
        s: over the logarithm of the time, `(2 sides, starts, segments, joints)`.
        x: over the end velocities, `(2 ends, 2 sides, starts, segments, joints)`.
        p: over the peak, `(2 sides, starts, segments, joints)`.
    """

    s: Array
    x: Array
    p: Array


class AccelerationInequalities:
    """Every inequality of the program at a point: its value and its derivatives.

    Each side of a cell has two inequalities: `room`, the slack of the peak `p` below the velocity
    limit, and `reach`, the extreme displacement minus `h`. Their derivatives by the logarithm `s`
    of the time `T`, the end velocities `x` and the peak `p` are `room_s`, `room_p`, `reach_x` and
    `reach_p`.

    Where limits differ from segment to segment there is a third one, `passing`: the slack of the
    velocity at a cell's end below the tighter limit of both segments there. Its derivatives by `s`
    and that end's `x` are `passing_s` and `passing_x`. With the same limits in all segments it is
    not needed (mathematics, section 4).

    Attributes:
        values: slacks, negative where an inequality is violated,
            `(kinds, 2 sides, starts, segments, joints)`.
        times: of the segments, `(starts, segments)`.
        t: the same for every joint.
        x: end velocities for both sides, mirrored for the lower one.
        cruise: velocity of the cruise, in units of `AccelerationTables.top`.
    """

    start_slack = 0.1
    min_gap_rtol = 1e-13
    max_log_step = 1.0

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
        values = np.empty(cells.rows)
        values[0] = cells.fastest - cruise
        values[1] = peaks - spent / 2
        if cells.passing is not None:
            from_mean = room_p * x[1]
            is_inner = np.isfinite(cells.passing)
            values[2] = np.where(is_inner, cells.passing - mean + from_mean, 1.0)
            self.passing_s = np.where(is_inner, mean + from_mean, 0.0)
            self.passing_x = np.where(is_inner, room_p, 0.0)

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
        of_both_ends = reach_x[0] + reach_x[1]
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
        room, reach = numbers[:2]
        by_s = self.room_s * room
        by_x = self.reach_x * reach
        by_p = self.room_p * room
        by_p += self.reach_p * reach
        if self.cells.passing is not None:
            by_s += self.passing_s * numbers[2]
            by_x[1] += self.passing_x * numbers[2]
        return Gradients(by_s, by_x, by_p)

    def change(self, step: AccelerationUnknowns, x: Array) -> Array:
        """Return the change of every inequality in a step; `x` are its ends, of both sides."""
        s = step.log[..., None]
        peaks = step.peaks
        change = np.empty_like(self.values)
        by_time = self.room_s * s
        change[0] = by_time + self.room_p * peaks
        reached = self.reach_x * x
        by_ends = reached[0] + reached[1]
        change[1] = by_ends + self.reach_p * peaks
        if self.cells.passing is not None:
            change[2] = self.passing_s * s + self.passing_x * x[1]
        return change


class AccelerationLinearisation:
    """The program near a point: linear inequalities, a quadratic objective, peaks eliminated.

    Variables are the logarithm `s` of the time `T`, the end velocities `x` and the peaks `p`. The
    matrix is the Lagrangian's Hessian, plus each inequality's gradient squared times its weight.

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

        # The second derivative of the reach over x and p is 1/a. xx = y/a + w (∂reach/∂x)²
        curved = y_reach / cells.a
        weighted = w_reach * reach_x
        xx = curved + weighted * reach_x
        # of both ends: uw = w ∂reach/∂u ∂reach/∂w
        uw = weighted[0] * reach_x[1]
        # xp = w ∂reach/∂x ∂reach/∂p − y/a
        xp = weighted * reach_p - curved
        # pp = Σ y/a + w (∂room/∂p)² + w (∂reach/∂p)²
        pressed = w_room * room_p
        pp = curved.sum(axis=0) + pressed * room_p + w_reach * reach_p**2
        # x counts from the mean velocity, which depends on s.
        mean = cells.h / t
        steep = mean / t
        sx = y_reach * reach_x
        sp = pressed * room_s - y_room * room_p
        ss = (sx * (steep + rows.x)).sum(axis=0)
        ss += w_room * room_s**2 + y_room * rows.cruise

        if cells.passing is not None:
            # linear in the waypoint's velocity: no second derivative
            weighted_s = weights[2] * rows.passing_s
            ss += weighted_s * rows.passing_s
            sx[1] += weighted_s * rows.passing_x
            xx[1] += weights[2] * rows.passing_x**2

        # Schur complement of the peaks: A −= b bᵀ / pp, where b are xp and sp
        peak_x = xp / pp
        peak_s = sp / pp
        ss -= sp * peak_s
        sx -= xp * peak_s
        xx -= xp * peak_x
        uw -= xp[0] * peak_x[1]

        # the sum of both sides, over s and both ends
        matrix = np.empty((*t.shape, 3, 3))
        matrix[..., 0, 0] = ss.sum(axis=0)
        matrix[..., 1, 2] = uw.sum(axis=0)
        matrix[..., 2, 1] = matrix[..., 1, 2]
        for end, over_s in enumerate(_both(sx)):
            matrix[..., 0, 1 + end] = over_s
            matrix[..., 1 + end, 0] = over_s
            matrix[..., 1 + end, 1 + end] = xx[end].sum(axis=0)
        links = Links(steep[0] - rows.point.ends, rows.missing)
        self.rows = rows
        self.pp = pp
        self.peak_x = peak_x
        self.peak_s = peak_s
        self.links = links
        self.chain = Chain(rows.times, links, matrix)

    def slope(self, multipliers: Array) -> Array:
        """Return the largest entry of the Lagrangian's gradient, `(starts,)`."""
        by_s, by_x, by_p = self.rows.gradients(multipliers)
        steepest_peak = np.abs(by_p).max(axis=(0, 2, 3))
        steepest = self.chain.steepest(_by_cell(by_s, by_x))
        return np.maximum(steepest, steepest_peak)

    def step(self, aim: Array) -> tuple[AccelerationUnknowns, Array]:
        """Return the Newton step for target multipliers, and the change of every inequality."""
        by_s, by_x, by_p = self.rows.gradients(aim)
        by_s -= self.peak_s * by_p
        by_x -= self.peak_x * by_p
        solved = self.chain.step(_by_cell(by_s, by_x))

        # Back substitution: p from s and x.
        ends = solved.cells[..., 1:].transpose(3, 0, 1, 2)
        x = both_sides(ends)
        s = solved.log[..., None]
        peaks = by_p / self.pp - self.peak_s * s - (self.peak_x * x).sum(axis=0)
        step = AccelerationUnknowns(solved.log, solved.velocity, np.array([ends, peaks]))
        return step, self.rows.change(step, x)

    def bending(self, step: AccelerationUnknowns) -> None:
        """Return None: clipping replaces a second-order correction."""


def _both(by_side: Array) -> Array:
    """Return the sum of both sides, with the signs of the upper one: `(2, 2, …)` to `(2, …)`."""
    return by_side[:, 0] - by_side[:, 1]


def _by_cell(by_s: Array, by_x: Array) -> Array:
    """Return the gradient by `s` and both ends, sides summed, with variables on the last axis."""
    _, *cells = by_s.shape
    gradient = np.empty((*cells, 3))  # in place of `np.stack`, 10 us slower
    gradient[..., 0] = by_s.sum(axis=0)
    gradient[..., 1], gradient[..., 2] = _both(by_x)
    return gradient
