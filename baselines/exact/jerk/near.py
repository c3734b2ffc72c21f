"""The jerk-limited program with waypoints within a tolerance (mathematics, section 5).

The offsets `p` of the inner waypoints from their nominal positions are unknowns, and `|p| ≤ r`.
A cell's displacement grows by the offset `p'` at its end less the one `p` at its start. So its
displacement inequalities change by `(p' − p)/T²`, in units of its time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from baselines.exact.jerk.cells import (
    REACH,
    JerkInequalities,
    JerkLinearisation,
    JerkTables,
    JerkUnknowns,
)
from baselines.exact.jerk.profiles import ACCELERATIONS, TIME, VELOCITIES, Slopes
from baselines.exact.method.chain import at_ends
from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Array

# Here the offsets at both ends of a cell follow its other five variables. In the chain each follows
# the acceleration of its waypoint.
_OFFSETS = 5, 6
_IN_CHAIN = [0, 1, 2, 5, 3, 4, 6]
_FROM_CHAIN = [0, 1, 2, 4, 5, 3, 6]


class NearUnknowns(NamedTuple):
    """The unknowns of `JerkUnknowns`, and the waypoints' offsets.

    Attributes:
        offset: from the nominal positions, for the same waypoints as `velocity`,
            `(starts, segments - 1, joints)`.
    """

    log: Array
    ends: Array
    velocity: Array
    acceleration: Array
    offset: Array


class NearTables(JerkTables):
    """The constant tables of the program, with the half widths of the waypoints' boxes."""

    def __init__(self, scaled: Scaled, kinds: int = 1, every: Sequence[Scaled] = ()) -> None:
        super().__init__(scaled, kinds, every)
        r = np.zeros(scaled.h.shape)
        r[: len(scaled.tolerance)] = scaled.tolerance
        self.free = r > 0
        self.box = np.where(self.free, r, 1.0)
        before = np.roll(self.free, 1, axis=0)
        before[0] &= scaled.closed
        self.free_before = before

    def linked(self, times: Array, velocity: Array, acceleration: Array) -> Any:
        point = super().linked(times, velocity, acceleration)
        return NearUnknowns(*point, np.zeros_like(velocity))


class NearInequalities(JerkInequalities):
    """The inequalities of `JerkInequalities`, and `|p| ≤ r`, both sides of each."""

    # A start that needs more cycles: a time tends to 0, or a box is as wide as the displacement.
    max_iterations = 120

    cells: NearTables
    point: Any

    def __init__(self, cells: NearTables, point: Any) -> None:
        super().__init__(cells, point)
        first, last = at_ends(point.offset, closed=cells.closed)
        self.way = (last - first) / self.t**2
        self.reach = self.reach - cells.signs * self.way
        share = last / cells.box
        boxes = np.where(cells.free, [1 - share, 1 + share], 1.0)
        # the velocity inequalities of limits per segment stay last
        last = len(self.values) - 2 * cells.by_segment - 2 * (cells.passing is not None)
        others = self.values[REACH:last], boxes[:, None], self.values[last:]
        self.values = np.concatenate([self.reach[:, None], *others])
        self.boxes = slice(last, last + 2)

    def linear(self, multipliers: Array, weights: Array) -> NearLinearisation:
        return NearLinearisation(self, multipliers, weights)

    @cached_property
    def slopes(self) -> Slopes:
        cells = self.cells
        known = super().slopes
        count, rows, *shape = known.first.shape
        first = np.zeros((count + 2, rows, *shape))
        first[:count] = known.first
        second = np.zeros((count + 2, count + 2, REACH, *shape))
        second[:count, :count] = known.second
        way = cells.signs * self.way
        by_square = cells.signs / self.t**2
        before, after = _OFFSETS
        first[TIME, :REACH] += 2 * way
        first[before, :REACH] = by_square * cells.free_before
        first[after, :REACH] = -by_square * cells.free
        first[after, self.boxes] = np.reshape([-1.0, 1.0], (2, 1, 1, 1)) * (cells.free / cells.box)
        second[TIME, TIME] -= 4 * way
        for offset, sign, free in ((before, -2, cells.free_before), (after, 2, cells.free)):
            second[TIME, offset] = second[offset, TIME] = sign * by_square * free
        return Slopes(first, second)


class NearLinearisation(JerkLinearisation):
    """The program near a point, with offsets: as `JerkLinearisation`."""

    rows: NearInequalities

    def _by_cell(self, matrix: Array) -> Array:
        # an exact waypoint has no offset: an entry on the diagonal keeps the matrix regular
        _, after = _OFFSETS
        matrix[after, after] += ~self.rows.cells.free
        return super()._by_cell(matrix[np.ix_(_IN_CHAIN, _IN_CHAIN)])

    def _gradient(self, multipliers: Array) -> Array:
        return super()._gradient(multipliers)[..., _IN_CHAIN]

    def step(self, aim: Array) -> tuple[Any, Array]:
        log, cells, velocity = self.chain.step(self._gradient(aim))
        by_variable = cells.transpose(3, 0, 1, 2)[_FROM_CHAIN]
        change = (self.rows.slopes.first * by_variable[:, None]).sum(axis=0) + self.missed
        acceleration, offset = by_variable[[ACCELERATIONS[1], _OFFSETS[1]], :, : velocity.shape[1]]
        ends = by_variable[list(VELOCITIES)]
        return NearUnknowns(log, ends, velocity, acceleration, offset), change[:, None]

    def _changes(self, step: Any) -> Array:
        offsets = at_ends(step.offset, closed=self.rows.cells.closed)
        return np.concatenate([super()._changes(step), offsets])


def at_exact_points(scaled: Scaled, times: Array, states: NearUnknowns) -> JerkUnknowns:
    """Return one start's unknowns in the program through exact points, its waypoints shifted."""
    return JerkTables(scaled).linked(times[None], states.velocity, states.acceleration)
