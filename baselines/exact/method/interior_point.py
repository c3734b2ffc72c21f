"""A primal-dual interior-point method for the programs of a chain of cells.

Both programs of this folder use it, with and without jerk limits. Slacks and multipliers of all
inequalities, Newton steps to a falling barrier parameter (Nocedal and Wright, Numerical
Optimization, chapter 19). A general sparse solver takes the same steps at twenty times the cost.
Several starts take their steps together, each at its own barrier and length.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from trajopt.core.arrays import Array, Bools

MAX_ITERATIONS = 2000
# Converged: complementarity gap and change of the last step, relative to the duration, and
# constraint violation.
GAP_RTOL = 1e-12
GAIN_RTOL = 1e-10
MISS_TOL = 1e-11
START_LENGTH = 0.5
# The gap falls by `(1 - length of the last step) ** FALL_POWER`, at most by the least share.
FALL_POWER = 1.5
MIN_LEFT = 0.02
# After a step shorter than this the gap rises instead, by `RAISED ** FALL_POWER`.
STUCK = 0.02
RAISED = 3.0
# The barrier waits while the Lagrangian's gradient is larger than both.
WAIT_PER_GAP = 10.0
WAIT_RTOL = 1e-1
# A step goes this share of the way to where a slack or a multiplier vanishes.
TO_BOUNDARY = 0.99
# A slack becomes its row's value where that is at least this share of the slack before.
MIN_KEPT_SLACK = 0.005
# A step is shortened by this factor, at most so many times.
SHORTER = 0.6
MAX_SHORTENED = 40
# Largest ratio between a multiplier and barrier over slack, either way.
MULTIPLIER_SPREAD = 1e10

# Inequalities are `(kinds, sides, starts, segments, joints)`: all axes but the starts.
ROW_AXES = (0, 1, 3, 4)


def moved(point: Any, step: Any, length: Array) -> Any:
    """The point so far along a step, `(starts,)`.

    Both are named tuples: logarithms of the times, `(starts, segments)`, then tables `(…, starts,
    segments, joints)`.
    """
    of_times = length[:, None]
    of_cells = of_times[:, None]
    tables = []
    for table, change in zip(point, step, strict=True):
        along = of_times if table.ndim == of_times.ndim else of_cells
        tables.append(table + along * change)
    return point._make(tables)


def chosen(point: Any, some: Bools) -> Any:
    """The point of some of the starts."""
    times, *cells = point
    return point._make([times[some], *(table[..., some, :, :] for table in cells)])


class Linearisation(Protocol):
    """A program near a point, for a Newton step."""

    def slope(self, multipliers: Array, /) -> Array:
        """The largest entry of the Lagrangian's gradient, `(starts,)`."""

    def step(self, aim: Array, /) -> tuple[Any, Array]:
        """The Newton step to these multipliers, and by how much it changes every row."""

    def bending(self, step: Any, /) -> Array | None:
        """By how much a step changes every row at second order, where that is known."""


class Inequalities(Protocol):
    """A program's inequalities at a point.

    Attributes:
        point: where the unknowns are.
        values: positive inside, `(kinds, sides, starts, segments, joints)`.
        times: of the segments, `(starts, segments)`.
        start_slack: the least slack that a start has.
        min_gap_rtol: least complementarity gap that a step aims at, relative to the duration.
        max_log_step: largest change of a time's logarithm in one step, to first order.
        start_barrier: product of slack and multiplier at the start, `(starts,)`.
    """

    point: Any
    start_slack: float
    min_gap_rtol: float
    max_log_step: float
    start_barrier: Array
    values: Array
    times: Array

    @property
    def apart(self) -> Array:
        """The most that a link between cells misses, `(starts,)`."""

    def linear(self, multipliers: Array, weights: Array, /) -> Linearisation:
        """The model of a Newton step; `weights` are multiplier over slack of each row."""

    def after(self, step: Any, length: Array, /) -> Self:
        """The rows after such a length of a step, `(starts,)`."""

    def follows(self, before: Self, /) -> Bools:
        """Return whether the step from the rows before may be taken, `(starts,)`."""

    def of(self, some: Bools, /) -> Self:
        """The rows of some of the starts."""


@dataclass(frozen=True, eq=False)
class State:
    """Rows with a slack and a multiplier each, in tables of their shape."""

    rows: Inequalities
    slacks: Array
    multipliers: Array

    @cached_property
    def duration(self) -> Array:
        """The sum of the segment times, `(starts,)`."""
        return self.rows.times.sum(axis=1)

    @cached_property
    def gap(self) -> Array:
        """The complementarity gap, `(starts,)`."""
        return (self.slacks * self.multipliers).sum(axis=ROW_AXES)

    @cached_property
    def miss(self) -> Array:
        """The rows' values less their slacks."""
        return self.rows.values - self.slacks

    @cached_property
    def weights(self) -> Array:
        """Multiplier over slack of each row."""
        return self.multipliers / self.slacks

    @cached_property
    def linear(self) -> Linearisation:
        """The model of a Newton step from here."""
        return self.rows.linear(self.multipliers, self.weights)

    @cached_property
    def slope(self) -> Array:
        """The largest entry of the Lagrangian's gradient, `(starts,)`."""
        return self.linear.slope(self.multipliers)

    def of(self, some: Bools) -> State:
        """The state of some of the starts."""
        return State(self.rows.of(some), self.slacks[:, :, some], self.multipliers[:, :, some])


class Iterate(NamedTuple):
    """The state of some starts after a step.

    Attributes:
        state: where they are.
        before: where they were before the last step.
        length: of each one's last step, up to 1, `(starts,)`.
        gain: change of the duration over the whole of that step, to first order, `(starts,)`.
        steps: how many there were.
    """

    state: State
    before: State
    length: Array
    gain: Array
    steps: int

    @property
    def lost(self) -> Bools:
        """Which starts have diverged, `(starts,)`."""
        return ~np.isfinite(self.state.gap) | (self.length == 0)

    def of(self, some: Bools) -> Iterate:
        """Some of the starts."""
        return Iterate(
            self.state.of(some),
            self.before.of(some),
            self.length[some],
            self.gain[some],
            self.steps,
        )


Arrived = Callable[[Iterate], Bools]
"""Which starts need no more steps, `(starts,)`."""


def begun(rows: Inequalities) -> Iterate:
    """No step yet."""
    slacks = np.maximum(rows.values, rows.start_slack)
    state = State(rows, slacks, rows.start_barrier[:, None, None] / slacks)
    length = np.full(len(rows.times), START_LENGTH)
    gain = np.full(len(rows.times), np.inf)
    return Iterate(state, state, length, gain, steps=0)


def descended(iterate: Iterate, arrived: Arrived) -> Iterate:
    """Steps until every start has arrived or is lost."""
    most = getattr(iterate.state.rows, "max_iterations", MAX_ITERATIONS)
    while iterate.steps < most:
        if (arrived(iterate) | iterate.lost).all():
            break
        iterate = _stepped(iterate)
    return iterate


def near(iterate: Iterate, gap_rtol: float) -> Bools:
    """Which points' gaps are at most this share of their durations, `(starts,)`."""
    state = iterate.state
    return state.gap <= gap_rtol * state.duration


def converged(iterate: Iterate, times: float = 1.0) -> Bools:
    """Which points are local optima to so many times the tolerances, `(starts,)`."""
    closed = near(iterate, times * GAP_RTOL)
    if not closed.any():
        return closed
    state = iterate.state
    missed = np.abs(state.miss).max(axis=ROW_AXES)
    closed &= np.maximum(missed, state.rows.apart) <= times * MISS_TOL
    return closed & (iterate.gain <= times * GAIN_RTOL * state.duration)


def _stepped(iterate: Iterate) -> Iterate:
    """After a Newton step to `slack × multiplier = barrier`."""
    state = iterate.state
    slacks = state.slacks
    multipliers = state.multipliers
    waits = state.slope > np.maximum(WAIT_PER_GAP * state.gap, WAIT_RTOL * state.duration)
    left = np.where(waits, 1.0, np.maximum(1 - iterate.length, MIN_LEFT))
    left = np.where(iterate.length < STUCK, RAISED, left)
    gap = np.maximum(left**FALL_POWER * state.gap, state.rows.min_gap_rtol * state.duration)
    barrier = (gap / slacks[:, :, 0].size)[:, None, None]

    aim = barrier / slacks
    rows, direction = _followed(iterate, aim)
    forwards = direction.forwards
    multiplier_step = aim - multipliers - state.weights * direction.slacks
    upwards = _longest(multipliers, multiplier_step)
    slacks = np.where(
        rows.values >= MIN_KEPT_SLACK * slacks,
        rows.values,
        slacks + forwards[:, None, None] * direction.slacks,
    )
    aim = barrier / slacks
    multipliers = np.clip(
        multipliers + upwards[:, None, None] * multiplier_step,
        aim / MULTIPLIER_SPREAD,
        aim * MULTIPLIER_SPREAD,
    )
    return Iterate(
        State(rows, slacks, multipliers),
        state,
        length=np.minimum(forwards, upwards),
        gain=np.abs((state.rows.times * direction.step.log).sum(axis=1)),
        steps=iterate.steps + 1,
    )


class _Direction(NamedTuple):
    """A Newton step.

    Attributes:
        step: of the unknowns.
        change: of the rows to first order, in a table of their shape.
        slacks: of the slacks.
        forwards: how far it may be taken, `(starts,)`.
    """

    step: Any
    change: Array
    slacks: Array
    forwards: Array


def _direction(state: State, aim: Array, miss: Array) -> _Direction:
    """The Newton step that makes up for what the rows miss of their slacks."""
    step, change = state.linear.step(aim - state.weights * miss)
    slack_step = change + miss
    farthest = np.abs(step.log).max(axis=1)
    allowed = state.rows.max_log_step
    forwards = np.minimum(
        allowed / np.maximum(farthest, allowed), _longest(state.slacks, slack_step)
    )
    return _Direction(step, change, slack_step, forwards)


def _followed(iterate: Iterate, aim: Array) -> tuple[Inequalities, _Direction]:
    """The rows after a Newton step, and the step.

    It bends with the rows, first as their second derivatives say, then as a step has shown. Where
    the method cannot go on from there it is straight, and shortened.
    """
    state = iterate.state
    before = state.rows
    straight = _direction(state, aim, state.miss)
    direction = straight
    bending = state.linear.bending(straight.step)
    if bending is not None:
        direction = _bent(state, aim, straight, bending)
    rows = before.after(direction.step, direction.forwards)
    follows = rows.follows(before) | iterate.lost
    if follows.all():
        return rows, direction
    length = direction.forwards[:, None, None]
    bending = (rows.values - before.values - length * direction.change) / length**2
    bent = _bent(state, aim, direction, bending)
    direction = _either(follows, direction, bent)
    rows = before.after(direction.step, direction.forwards)
    follows = rows.follows(before) | iterate.lost
    if follows.all():
        return rows, direction
    return _shortened(iterate, _either(follows, direction, straight))


def _bent(state: State, aim: Array, tried: _Direction, bending: Array) -> _Direction:
    """The step that makes up for the rows' bending, unless it is much shorter than the one tried.

    Args:
        state: where it begins.
        aim: barrier over slack of each row.
        tried: another step.
        bending: of the rows, after the whole of it.
    """
    length = tried.forwards[:, None, None]
    bent = _direction(state, aim, state.miss + length * bending)
    return _either(bent.forwards >= SHORTER * tried.forwards, bent, tried)


def _either(first: Bools, one: _Direction, other: _Direction) -> _Direction:
    """One step for some starts, another one for the rest."""
    if first.all():
        return one
    share = first.astype(float)
    difference = moved(one.step, other.step, -np.ones_like(share))
    of_rows = first[:, None, None]
    return _Direction(
        moved(other.step, difference, share),
        np.where(of_rows, one.change, other.change),
        np.where(of_rows, one.slacks, other.slacks),
        np.where(first, one.forwards, other.forwards),
    )


def _shortened(iterate: Iterate, direction: _Direction) -> tuple[Inequalities, _Direction]:
    """The rows after a step, shortened until the method may go on; a length of 0 if it may not."""
    rows = iterate.state.rows
    length = direction.forwards
    for _ in range(MAX_SHORTENED):
        after = rows.after(direction.step, length)
        follows = after.follows(rows) | iterate.lost
        if follows.all():
            return after, direction._replace(forwards=length)
        length = np.where(follows, length, SHORTER * length)
    length = np.where(follows, length, 0.0)
    return rows.after(direction.step, length), direction._replace(forwards=length)


def _longest(values: Array, step: Array) -> Array:
    """Return the longest step, at most 1, that keeps every value positive, `(starts,)`."""
    fastest = -(step / values).min(axis=ROW_AXES)
    return TO_BOUNDARY / np.maximum(fastest, TO_BOUNDARY)
