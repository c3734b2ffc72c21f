"""The program of `exact.acceleration` for routes with demands.

Three demands add inequalities or unknowns. Without them `newton_step` solves the same program
faster.

- *Least times*: `log T ≥ log τ`, one inequality for each segment. Latest times, which keep an
  initial guess before a gap, are the same with `≤`.
- *Tolerance*: the inner waypoints' offsets `p` are unknowns, `|p| ≤ r`. A cell's displacement grows
  by the offset `p'` at its end less the one `p` at its start. So its displacement inequality
  changes by `(p' − p)/T²`, in the cell's units. In the chain an offset stands where the program
  with jerk limits has an acceleration.
- *Closed motion*: the first and the last waypoint have one velocity, one more unknown for each
  joint.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from baselines.exact.acceleration.cells import (
    SIDES,
    AccelerationTables,
    AccelerationUnknowns,
    both_sides,
)
from baselines.exact.acceleration.newton_step import AccelerationInequalities
from baselines.exact.method.chain import Chain, Links, at_ends
from baselines.exact.method.scaled import Abreast
from trajopt.core.arrays import Array

# Variables of a cell: logarithm of the time, velocity and offset at both ends, peak.
_S, _X0, _P0, _X1, _P1, _PEAK = range(6)


_ROOM = 0.98  # of its box, the most that an initial guess uses


class DemandUnknowns(NamedTuple):
    """The unknowns of every start, or a step of them.

    Attributes:
        log: logarithms of the segment times in stop times, `(starts, segments)`.
        velocity: at the inner waypoints; of a closed motion at all waypoints but the first,
            `(starts, waypoints, joints)`.
        inner: end velocities and peaks of the cells, see `AccelerationUnknowns`.
        offset: of the same waypoints from their nominal positions, likewise.
    """

    log: Array
    velocity: Array
    inner: Array
    offset: Array

    @property
    def ends(self) -> Array:
        """Return the velocities at both ends, from the mean one, in units of the time."""
        return self.inner[0]

    @property
    def peaks(self) -> Array:
        """Return the peaks of the upper and the mirrored lower profile, in the units of `ends`."""
        return self.inner[1]


class DemandTables(AccelerationTables):
    """The constant tables of the program, and of the demands.

    Args:
        scaled: the problem of each start, all with the same kinds of demands.
    """

    def __init__(self, scaled: Abreast) -> None:
        super().__init__(scaled)
        every: Sequence[Any] = scaled.every
        tolerance = np.array([own.tolerance for own in every])
        self.tolerance = tolerance
        self.tolerant = bool(tolerance.any())
        self.least = scaled.least
        self.latest = np.array([own.latest for own in every])
        self.bounded = np.array([self.least > 0, np.isfinite(self.latest)])
        # half width of the box around the waypoint at each cell's end; 1 for an exact waypoint
        box = np.zeros(self.every)
        box[:, : tolerance.shape[1]] = tolerance
        self.free = box > 0
        self.box = np.where(self.free, box, 1.0)
        self.free_before, _ = self.offsets(np.sign(tolerance))

    def offsets(self, offset: Array) -> Array:
        """Return the offsets at the start and the end of each segment, 0 at the motion's ends."""
        return at_ends(offset, closed=self.scaled.closed)

    def near(self, times: Array, velocities: Array, offset: Array) -> DemandUnknowns:
        """Return the initial guess: times not below the least, offsets of 0 or within the boxes.

        Ends and peaks are counted from the mean velocity between the nominal waypoints.
        """
        times = np.maximum(times, self.least * (1 + 1e-3))
        if not self.tolerant:
            point = self.start(times, velocities)
            return DemandUnknowns(*point, np.zeros_like(velocities))
        box = _ROOM * self.tolerance
        inside = np.clip(offset, -box, box)
        first, last = self.offsets(inside)
        moved = copy(self)
        moved.h = self.h + SIDES * (last - first)
        log, velocity, inner = moved.start(times, velocities)
        mean = (last - first) / times[..., None] ** 2
        shift = np.array([[mean, mean], mean * SIDES])
        return DemandUnknowns(log, velocity, inner + shift, inside)

    def clipped(self, point: Any) -> Any:
        """Return the point with ends and peaks clipped to where an answer can have them.

        They are counted from the mean velocity between the nominal waypoints, their bounds from
        the mean velocity between the waypoints with their offsets.
        """
        if not isinstance(point, DemandUnknowns):
            return super().clipped(point)
        if not self.tolerant:
            return DemandUnknowns(*super().clipped(AccelerationUnknowns(*point[:3])), point.offset)
        t = (self.stop * np.exp(point.log))[..., None]
        first, last = self.offsets(point.offset)
        mean = (last - first) / t**2
        shift = np.array([[mean, mean], mean * SIDES])
        inner = np.clip(point.inner - shift, self.lowest, self.highest) + shift
        return point._replace(inner=inner)


class DemandInequalities(AccelerationInequalities):
    """The inequalities of `newton_step.AccelerationInequalities`, then those of the demands.

    A kind of inequality that a cell does not have is the constant 1 there.
    """

    # A start that needs more cycles: a time tends to 0, or a box is as wide as the displacement.
    max_iterations = 300

    cells: DemandTables
    point: Any  # DemandUnknowns

    def __init__(self, cells: DemandTables, point: Any) -> None:
        super().__init__(cells, point)
        one = np.ones_like(self.t)
        added = []
        if cells.tolerant:
            offset = both_sides(cells.offsets(point.offset))
            self.way = (offset[1] - offset[0]) / self.t**2
            self.values[1] -= self.way
            # (r − p) / r and (r + p) / r
            added.append(np.where(cells.free, 1 - offset[1] / cells.box, 1.0))
        if cells.bounded.any():
            least, latest = cells.least, cells.latest
            is_least, is_latest = cells.bounded
            longer = np.log(self.times / np.where(is_least, least, 1.0))
            earlier = np.log(np.where(is_latest, latest, 1.0) / self.times)
            bounds = np.array([one, one])
            bounds[0, :, :, 0] = np.where(is_least, longer, 1.0)
            bounds[1, :, :, 0] = np.where(is_latest, earlier, 1.0)
            added.append(bounds)
        self.values = np.concatenate([self.values, *[rows[None] for rows in added]])

    def linear(self, multipliers: Array, weights: Array) -> Any:
        return DemandLinearisation(self, multipliers, weights)

    @cached_property
    def slopes(self) -> Array:
        """Gradients of the inequalities by the variables of their side of a cell.

        `(6 variables, kinds, 2 sides, starts, segments, joints)`.
        """
        cells = self.cells
        slopes = np.zeros((6, *self.values.shape))
        slopes[_S, 0] = self.room_s
        slopes[_PEAK, 0] = self.room_p
        slopes[_X0, 1], slopes[_X1, 1] = self.reach_x
        slopes[_PEAK, 1] = self.reach_p
        kinds = 2
        if cells.passing is not None:
            slopes[_S, kinds] = self.passing_s
            slopes[_X1, kinds] = self.passing_x
            kinds += 1
        if cells.tolerant:
            slopes[_S, 1] = 2 * self.way
            slopes[_P0, 1] = cells.free_before / self.t**2
            slopes[_P1, 1] = -(cells.free / self.t**2)
            slopes[_P1, kinds] = -(cells.free / cells.box)
        if cells.bounded.any():
            slopes[_S, -1, 0, :, :, 0], slopes[_S, -1, 1, :, :, 0] = cells.bounded * [[[1]], [[-1]]]
        return slopes


class DemandLinearisation:
    """The program near a point, its peaks eliminated as in `newton_step`.

    Args:
        rows: the inequalities at the point.
        multipliers: of the inequalities.
        weights: `z / s` of each inequality, multiplier over slack.
    """

    def __init__(self, rows: DemandInequalities, multipliers: Array, weights: Array) -> None:
        cells = rows.cells
        slopes = rows.slopes
        t = rows.t
        room, reach = multipliers[:2]
        steep = cells.h / t / t
        # each inequality's gradient squared times its weight; then the Lagrangian's Hessian
        matrix = np.einsum("ik...,jk...->ij...", weights * slopes, slopes)

        def add(i: int, j: int, values: Array) -> None:
            matrix[i, j] += values
            if i != j:
                matrix[j, i] += values

        for end, x in enumerate((_X0, _X1)):
            curved = reach / cells.a[end]
            pulled = reach * rows.reach_x[end]
            add(x, x, curved)
            add(x, _PEAK, -curved)
            add(_PEAK, _PEAK, curved)
            # x is counted from the mean velocity, which changes with s
            add(_S, _S, pulled * (steep + rows.x[end]))
            add(_S, x, pulled)
        add(_S, _S, room * rows.cruise)
        add(_S, _PEAK, -room * rows.room_p)
        if cells.tolerant:
            add(_S, _S, 4 * reach * rows.way)
            bent = 2 * reach / t**2
            add(_S, _P0, cells.free_before * bent)
            add(_S, _P1, -(cells.free * bent))
        self.peak = matrix[_PEAK, _PEAK]
        self.by_peak = matrix[:_PEAK, _PEAK] / self.peak
        matrix = matrix[:_PEAK, :_PEAK] - matrix[:_PEAK, _PEAK][:, None] * self.by_peak
        # the sum of both sides, seen from the upper one
        signs = np.ones((_PEAK, 2, 1, 1, 1))
        signs[1:, 1] = -1.0
        self.signs = signs
        summed = (matrix * signs[:, None] * signs).sum(axis=2)
        self.used = [_S, _X0, _P0, _X1, _P1] if cells.tolerant else [_S, _X0, _X1]
        if cells.tolerant:
            # an exact waypoint has no offset: an entry on the diagonal keeps the matrix regular
            summed[_P1, _P1] += ~cells.free
        own = summed[np.ix_(self.used, self.used)].transpose(2, 3, 4, 0, 1)
        links = Links(steep[0] - rows.point.ends, rows.missing)
        self.rows = rows
        self.chain = Chain(rows.times, links, np.ascontiguousarray(own), cells.scaled.closed)

    def slope(self, multipliers: Array) -> Array:
        """Return the largest entry of the Lagrangian's gradient, `(starts,)`."""
        gradient = (self.rows.slopes * multipliers).sum(axis=1)
        of_peaks = np.abs(gradient[_PEAK]).max(axis=(0, 2, 3))
        by_cell = self._by_cell(gradient)
        steepest = np.maximum(self.chain.steepest(by_cell), of_peaks)
        cells = self.rows.cells
        if not cells.tolerant:
            return steepest
        # offsets count in units of their boxes
        over = np.abs(self.chain.offsets(self.chain.gradient(by_cell)))
        return np.maximum(steepest, (over * cells.box[:, : over.shape[1]]).max(axis=(1, 2)))

    def step(self, aim: Array) -> tuple[DemandUnknowns, Array]:
        """Return the Newton step to these multipliers, and its first-order change of the slacks."""
        gradient = (self.rows.slopes * aim).sum(axis=1)
        of_peaks = gradient[_PEAK] / self.peak
        gradient[:_PEAK] -= self.by_peak * gradient[_PEAK]
        solved = self.chain.step(self._by_cell(gradient))
        # Back substitution: peaks from the other variables.
        own = np.zeros((_PEAK, *solved.cells.shape[:-1]))
        own[self.used] = np.moveaxis(solved.cells, -1, 0)
        sided = own[:, None] * self.signs
        peaks = of_peaks - (self.by_peak * sided).sum(axis=0)
        point = self.rows.point
        offset = np.zeros_like(point.offset)
        if self.rows.cells.tolerant:
            offset = own[_P1][:, : offset.shape[1]]
        step = DemandUnknowns(
            solved.log, solved.velocity, np.array([own[[_X0, _X1]], peaks]), offset
        )
        everything = np.concatenate([sided, peaks[None]])
        return step, (self.rows.slopes * everything[:, None]).sum(axis=0)

    def bending(self, step: DemandUnknowns) -> None:
        """Return None: clipping replaces a second-order correction."""

    def _by_cell(self, gradient: Array) -> Array:
        """Return the gradient by the cells' variables, from that by the variables of both sides."""
        summed = (gradient[:_PEAK] * self.signs).sum(axis=1)
        return np.moveaxis(summed[self.used], 0, -1)
