"""The relaxation's linear program: a box's rows, and those that were found to be broken.

Rows hold in every box, so each stays for the proof. In the program itself only those stay that
were of use lately: what is broken again is found again.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound import dual_check, jerk_rows, sources
from baselines.lower_bound.costates import Cut
from baselines.lower_bound.jerk_rows import SquareTangent
from baselines.lower_bound.linear import Answer
from baselines.lower_bound.relaxation import Box, Relaxation, Rows
from baselines.lower_bound.scaled import ScaledProgram
from baselines.lower_bound.sources import Source, Tables, Tangent

Array = NDArray[np.float64]
Indices = NDArray[np.intp]

# Programs without a multiplier, after which a row leaves; rows are looked through so often.
_IDLE_PROGRAMS = 40
_LOOK_PROGRAMS = 20


class Proved(NamedTuple):
    """The rows that multipliers use, counted through box and pool, and the bound they prove."""

    rows: Indices
    multipliers: Array
    bound: float


class Enclosing(NamedTuple):
    """Rows, their numbers through box and pool, and the segments whose curves they enclose."""

    numbers: Indices
    rows: Rows
    segments: Indices


class RowPool:
    """The linear program over one box at a time.

    Attributes:
        box_count: How many rows enclose a box; those of the pool are counted after them.
        programs: How many linear programs were solved.
    """

    def __init__(self, relaxation: Relaxation, solver: Any, box: Box) -> None:
        self.relaxation = relaxation
        self.solver = solver
        self.programs = 0
        self.found: list[Rows] = []
        self.sources: list[Source] = []
        # which of the pool's rows are square tangents
        self.squares: list[int] = []
        # the pool's rows in the program, in its order, and when each was of use
        self.present: list[int] = []
        self.used_at: list[int] = []
        self.held: set[int] = set()
        self.box = box
        self.box_rows = relaxation.box_rows(box)
        self.box_count = len(self.box_rows.bounds)
        self.program = self._program()

    def enter(self, box: Box) -> None:
        """Ask about another box."""
        before = self.box_rows
        self.box = box
        self.box_rows = self.relaxation.box_rows(box)
        renewed = self._renewed_squares()
        if not self.program.suits(box):
            self.program = self._program()
            return
        self.program.set_box(box)
        differs = before.coefficients != self.box_rows.coefficients
        changed = differs.any(axis=1) | (before.bounds != self.box_rows.bounds)
        for number in np.flatnonzero(changed).tolist():
            row = _one(self.box_rows, number)
            self.program.set_row(number, row)
        places = {number: place for place, number in enumerate(self.present)}
        for number in renewed:
            if number in places:
                place = self.box_count + places[number]
                row = self.found[number]
                self.program.set_row(place, row)

    def _renewed_squares(self) -> list[int]:
        """Square tangents are other rows in another box: which they are in the pool."""
        rows = jerk_rows.square_rows(self.relaxation, self._squares(), self.box)
        renewed = []
        for place, number in enumerate(self.squares):
            row = _one(rows, place)
            before = self.found[number]
            if row.bounds[0] != before.bounds[0]:
                self.found[number] = row
                renewed.append(number)
        return renewed

    def _squares(self) -> list[SquareTangent]:
        sources = [self.sources[number] for number in self.squares]
        return [source for source in sources if isinstance(source, SquareTangent)]

    def _program(self) -> ScaledProgram:
        """The linear program in units that suit the box."""
        parts = [self.box_rows]
        parts += [self.found[number] for number in self.present]
        return ScaledProgram(
            self.solver,
            self.box,
            dual_check.joined(parts),
            self.relaxation.nothing,
        )

    def minimised(self, objective: Array) -> Answer:
        """The minimum, with multipliers of the box's rows and then of all the pool's."""
        self.programs += 1
        answer = self.program.minimised(objective)
        multipliers = np.zeros(self.box_count + len(self.found))
        multipliers[: self.box_count] = answer.multipliers[: self.box_count]
        own = answer.multipliers[self.box_count :]
        places = self.box_count + np.array(self.present, dtype=np.intp)
        multipliers[places] = own
        for place in np.flatnonzero(own > 0):
            self.used_at[self.present[place]] = self.programs
        if self.programs % _LOOK_PROGRAMS == 0:
            self._drop_idle()
        if answer.x is None:
            return answer._replace(multipliers=multipliers)
        # HiGHS may leave the box by its tolerance
        inside = np.clip(answer.x, self.box.low, self.box.high)
        return Answer(inside, answer.value, multipliers)

    def hold(self, rows: Indices) -> None:
        """Keep those of the pool in the program, whatever it is asked next; no others are held.

        Args:
            rows: Counted through box and pool.
        """
        of_pool = rows[rows >= self.box_count] - self.box_count
        self.held = set(of_pool.tolist())
        absent = self.held.difference(self.present)
        for number in sorted(absent):
            row = self.found[number]
            if self.program.add_row(row):
                self.present.append(number)
                self.used_at[number] = self.programs

    def _is_idle(self, number: int) -> bool:
        oldest = self.programs - _IDLE_PROGRAMS
        return self.used_at[number] < oldest and number not in self.held

    def _drop_idle(self) -> None:
        idle = [self._is_idle(number) for number in self.present]
        places = np.flatnonzero(idle)
        self.program.drop_rows(self.box_count + places)
        self.present = [
            number for number, is_idle in zip(self.present, idle, strict=True) if not is_idle
        ]

    def add_tangent(self, segment: int, at: float) -> None:
        """A tangent to `1/T` of a segment."""
        row = self.relaxation.tangent(segment, at)
        self._add(row, Tangent(segment, at))

    def add_broken_tangent(self, segment: int, x: Array) -> None:
        """The tangent at a point, if the point breaks it."""
        at = float(x[self.relaxation.time[segment]])
        row = self.relaxation.tangent(segment, at)
        if self.program.breaks(row, x)[0]:
            self._add(row, Tangent(segment, at))

    def add_broken_jerk_rows(self, x: Array) -> None:
        """The square tangents and ramps that a point breaks."""
        relaxation = self.relaxation
        squares = jerk_rows.square_tangents(relaxation, x, self.box)
        rows = jerk_rows.square_rows(relaxation, squares, self.box)
        self._add_broken(squares, rows, x)
        ramps = jerk_rows.broken_ramps(relaxation, x)
        if ramps:
            parts = [jerk_rows.ramp_row(relaxation, ramp) for ramp in ramps]
            self._add_broken(ramps, dual_check.joined(parts), x)

    def add_broken_cuts(self, given: Sequence[Cut], x: Array) -> None:
        """Those rows of costates that a point breaks."""
        rows = dual_check.cuts(self.relaxation, given)
        self._add_broken(given, rows, x)

    def add_touching(self, x: Array, cuts: Sequence[Cut]) -> None:
        """The tangents at a point of the curves, and rows of costates."""
        times = x[self.relaxation.time].tolist()
        for segment, at in enumerate(times):
            self.add_tangent(segment, at)
        if cuts:
            self._add_each(cuts, dual_check.cuts(self.relaxation, cuts))

    def _add_broken(
        self,
        given: Sequence[Source],
        rows: Rows,
        x: Array,
    ) -> None:
        if not given:
            return
        numbers = np.flatnonzero(self.program.breaks(rows, x))
        broken = [given[number] for number in numbers.tolist()]
        self._add_each(broken, rows.chosen(numbers))

    def _add_each(self, given: Sequence[Source], rows: Rows) -> None:
        for number, source in enumerate(given):
            row = _one(rows, number)
            self._add(row, source)

    def _add(self, row: Rows, source: Source) -> None:
        if not self.program.add_row(row):
            return
        if isinstance(source, SquareTangent):
            self.squares.append(len(self.found))
        self.present.append(len(self.found))
        self.used_at.append(self.programs)
        self.found.append(row)
        self.sources.append(source)

    def enclosing(self) -> Enclosing:
        """The rows that depend on the box, but for the cut-off."""
        own = np.array(self.squares, dtype=np.intp)
        of_box = np.arange(1, self.box_count)
        parts = [self.box_rows.chosen(of_box)]
        parts += [self.found[number] for number in self.squares]
        of_squares = [square.segment for square in self._squares()]
        segments = self.relaxation.row_segments()[1:]
        return Enclosing(
            numbers=np.concatenate([of_box, self.box_count + own]),
            rows=dual_check.joined(parts),
            segments=np.append(segments, of_squares).astype(np.intp),
        )

    def proved(self, objective: Array, box: Box, multipliers: Array) -> Proved:
        """What multipliers prove of an objective on the box that was entered."""
        used = np.flatnonzero(multipliers > 0)
        of_box = used[used < self.box_count]
        of_pool = used[used >= self.box_count] - self.box_count
        parts = [self.box_rows.chosen(of_box)]
        parts += [self.found[number] for number in of_pool]
        rows = dual_check.joined(parts)
        own = multipliers[used]
        bound = dual_check.dual_bound(objective, box, rows, own)
        return Proved(used, own, bound)

    def tables(self, used: Indices) -> tuple[Tables, Indices]:
        """What a proof stores of the rows that it uses, and the new numbers of all rows."""
        of_pool = used[used >= self.box_count] - self.box_count
        ordered = sources.in_order(self.sources, of_pool.tolist())
        chosen = [self.sources[number] for number in ordered]
        stored = sources.tables(chosen)
        count = self.box_count + len(self.found)
        numbers = np.arange(count)
        places = self.box_count + np.array(ordered, dtype=np.intp)
        new = np.arange(len(ordered))
        numbers[places] = self.box_count + new
        return stored, numbers


def _one(rows: Rows, number: int) -> Rows:
    """One of the rows."""
    chosen = np.array([number])
    return rows.chosen(chosen)
