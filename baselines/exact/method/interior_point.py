"""A primal-dual interior-point method for the programs of a chain of cells.

`exact` and `exact-jerk` use it. Every inequality has a slack and a multiplier; each iteration is a
Newton step to `slack × multiplier = barrier`, and the barrier falls (Nocedal and Wright, Numerical
Optimization, chapter 19). A general sparse solver takes the same steps at twenty times the cost.
Several initial guesses, of one problem or of several, take their steps together, each with its own
barrier and step length.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Protocol, Self

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices

# Smaller: a slow descent, in which a time tends to 0, ends unconverged. Larger: so does a diverging
# one, but later.
MAX_ITERATIONS = 2000
# Converged: complementarity gap and change of the last step, relative to the duration, and
# constraint violation. Larger: the duration is above the optimum by as much. Smaller: rounding
# keeps a start from converging; the gap cannot fall below `min_gap_rtol`.
GAP_RTOL = 1e-12
GAIN_RTOL = 1e-10
MISS_TOL = 1e-11
# Stands for the last step's length before the first one, and so sets the first fall of the gap.
# Halved or doubled: one step more or less.
START_LENGTH = 0.5
# The next gap is `left ** FALL_POWER` times the gap, `left` being 1 minus the last step's length.
# Halved: a sixth more steps. Doubled: steps are shortened more often.
FALL_POWER = 1.5
# Least value of `left`: the gap falls to no less than 0.003 of itself in a step.
MIN_LEFT = 0.02
# After a shorter step than this the gap rises instead: `left` is then `RAISED`. Smaller: a start
# stays near the boundary for longer. Larger: the gap also rises where the descent goes on.
STUCK = 0.02
RAISED = 3.0
# The barrier stays as it is while the Lagrangian's gradient exceeds both of these: times the gap,
# and relative to the duration. Halved: 5 % more steps. Doubled: the barrier falls farther
# from its own optimum, and steps are shortened more often.
WAIT_PER_GAP = 10.0
WAIT_RTOL = 1e-1
# A step goes at most this share of the way to where a slack or a multiplier vanishes. Smaller: at
# most that share of a gap goes in a step. 1: a slack becomes 0.
TO_BOUNDARY = 0.99
# A slack is reset to its inequality's value if that is at least this share of the slack before.
# Doubled: steps are shortened more often, and there are 7 % more. Smaller: a slack may all but
# vanish in one step.
MIN_KEPT_SLACK = 0.005
# A step that cannot be taken is shortened by this factor, at most so many times: to 1e-9. Fewer
# times: a start counts as diverged too early. A larger factor: more evaluations for such a step.
SHORTER = 0.6
MAX_SHORTENED = 40
# Largest factor between a multiplier and `barrier / slack`, either way: keeps the weights finite.
MULTIPLIER_SPREAD = 1e10

# Inequalities are `(kinds, sides, starts, segments, joints)`: all axes but the starts.
ROW_AXES = (0, 1, 3, 4)


def moved(point: Any, step: Any, length: Array) -> Any:
    """Return the point moved along a step by a length each, `(starts,)`.

    Point and step are named tuples: logarithms of the times, `(starts, segments)`, then tables
    `(…, starts, segments, joints)`.
    """
    of_times = length[:, None]
    of_cells = of_times[:, None]
    tables = []
    for table, change in zip(point, step, strict=True):
        along = of_times if table.ndim == of_times.ndim else of_cells
        tables.append(table + along * change)
    return point._make(tables)


def chosen(point: Any, some: Bools | Indices | slice) -> Any:
    """Return the point of some of the starts."""
    times, *cells = point
    return point._make([times[some], *(table[..., some, :, :] for table in cells)])


def joined(points: Sequence[Any]) -> Any:
    """Return the point of the starts of several points, one after another."""
    times, *cells = zip(*points, strict=True)
    tables = [np.concatenate(own, axis=-3) for own in cells]
    return points[0]._make([np.concatenate(times), *tables])


class Linearisation(Protocol):
    """The linear model of a program at a point, for a Newton step."""

    def slope(self, multipliers: Array, /) -> Array:
        """Return the largest entry of the Lagrangian's gradient, `(starts,)`."""

    def step(self, aim: Array, /) -> tuple[Any, Array]:
        """Return the Newton step for target multipliers, and the change of every inequality."""

    def bending(self, step: Any, /) -> Array | None:
        """Return the second-order change of every inequality; None if it is not known."""


class Inequalities(Protocol):
    """A program's inequalities at a point.

    Attributes:
        point: values of the unknowns.
        values: positive inside, `(kinds, sides, starts, segments, joints)`.
        times: of the segments, `(starts, segments)`.
        start_slack: least slack at the initial guess.
        min_gap_rtol: least complementarity gap to aim at, relative to the duration.
        max_log_step: largest change of a time's logarithm in one step, to first order.
        start_barrier: product of slack and multiplier at the initial guess, `(starts,)`.
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
        """Return the largest residual of a link between cells, `(starts,)`."""

    def linear(self, multipliers: Array, weights: Array, /) -> Linearisation:
        """Return the linear model; `weights` are multiplier over slack of each inequality."""

    def after(self, step: Any, length: Array, /) -> Self:
        """Return the inequalities after a step of this length, `(starts,)`."""

    def follows(self, before: Self, /) -> Bools:
        """Return whether the method may continue from here, after a step from `before`."""

    def of(self, some: Bools | Indices, /) -> Self:
        """Return the inequalities of some of the starts."""

    def with_others(self, others: Sequence[Self], /) -> Self:
        """Return the inequalities of these starts, then of the others."""


@dataclass(frozen=True, eq=False)
class PrimalDualState:
    """Inequalities with their slacks and multipliers, in tables of the shape of their values."""

    rows: Inequalities
    slacks: Array
    multipliers: Array

    @cached_property
    def duration(self) -> Array:
        """Return the sum of the segment times, `(starts,)`."""
        return self.rows.times.sum(axis=1)

    @cached_property
    def gap(self) -> Array:
        """Return the complementarity gap, `(starts,)`."""
        return (self.slacks * self.multipliers).sum(axis=ROW_AXES)

    @cached_property
    def miss(self) -> Array:
        """Return the primal residual: the inequalities' values minus their slacks."""
        return self.rows.values - self.slacks

    @cached_property
    def weights(self) -> Array:
        """Return multiplier over slack of each inequality."""
        return self.multipliers / self.slacks

    @cached_property
    def linear(self) -> Linearisation:
        """Return the linear model at this point."""
        return self.rows.linear(self.multipliers, self.weights)

    @cached_property
    def slope(self) -> Array:
        """The largest entry of the Lagrangian's gradient, `(starts,)`."""
        return self.linear.slope(self.multipliers)

    def of(self, some: Bools | Indices) -> PrimalDualState:
        """Return the state of some of the starts."""
        return PrimalDualState(
            self.rows.of(some), self.slacks[:, :, some], self.multipliers[:, :, some]
        )

    def with_others(self, others: Sequence[PrimalDualState]) -> PrimalDualState:
        """Return the state of these starts, then of the others."""
        every = [self, *others]
        return PrimalDualState(
            self.rows.with_others([own.rows for own in others]),
            np.concatenate([own.slacks for own in every], axis=2),
            np.concatenate([own.multipliers for own in every], axis=2),
        )


class Iterate(NamedTuple):
    """The state of the initial guesses after an iteration.

    Attributes:
        state: after the last step.
        before: before the last step.
        length: of the last step, up to 1, `(starts,)`.
        gain: first-order change of the duration over the whole of that step, `(starts,)`.
        steps: number of iterations.
    """

    state: PrimalDualState
    before: PrimalDualState
    length: Array
    gain: Array
    steps: int

    @property
    def lost(self) -> Bools:
        """Return which starts have diverged, `(starts,)`."""
        return ~np.isfinite(self.state.gap) | (self.length == 0)

    def of(self, some: Bools | Indices) -> Iterate:
        """Return the iterate of some of the starts."""
        return Iterate(
            self.state.of(some),
            self.before.of(some),
            self.length[some],
            self.gain[some],
            self.steps,
        )

    def with_others(self, others: Sequence[Iterate]) -> Iterate:
        """Return the iterate of these starts, then of the others."""
        every = [self, *others]
        return Iterate(
            self.state.with_others([own.state for own in others]),
            self.before.with_others([own.before for own in others]),
            np.concatenate([own.length for own in every]),
            np.concatenate([own.gain for own in every]),
            max(own.steps for own in every),
        )


Arrived = Callable[[Iterate], Bools]
"""Which starts need no more steps, `(starts,)`."""


def begun(rows: Inequalities) -> Iterate:
    """Return the initial iterate."""
    slacks = np.maximum(rows.values, rows.start_slack)
    state = PrimalDualState(rows, slacks, rows.start_barrier[:, None, None] / slacks)
    length = np.full(len(rows.times), START_LENGTH)
    gain = np.full(len(rows.times), np.inf)
    return Iterate(state, state, length, gain, steps=0)


def descended(
    iterate: Iterate,
    arrived: Arrived,
    most: int | None = None,
    problems: Indices | None = None,
) -> Iterate:
    """Return the iterate at which every start has arrived or diverged, or after `most` steps.

    The starts of a problem take their steps until all of them are there, whatever other problems
    take theirs beside them: a batch gives what each problem alone would.

    Args:
        iterate: Of all starts.
        arrived: Which starts need no more steps.
        most: Number of steps, from the initial guess.
        problems: The number of each start's problem, `(starts,)`; by default one for all.
    """
    most = MAX_ITERATIONS if most is None else most
    most = min(most, getattr(iterate.state.rows, "max_iterations", most))
    left = np.arange(len(iterate.length))  # the starts that are under way
    places, parts = [], []
    while True:
        away = ~(arrived(iterate) | iterate.lost)
        if iterate.steps >= most or not away.any():
            break
        if problems is not None and not away.all():
            waits = np.isin(problems[left], problems[left[away]])
            if not waits.all():
                places.append(left[~waits])
                parts.append(iterate.of(~waits))
                left, iterate = left[waits], iterate.of(waits)
        iterate = _stepped(iterate)
    if not parts:
        return iterate
    order = np.argsort(np.concatenate([left, *places]))
    return iterate.with_others(parts).of(order)


def near(iterate: Iterate, gap_rtol: float) -> Bools:
    """Return which starts have a gap of at most this share of their duration, `(starts,)`."""
    state = iterate.state
    return state.gap <= gap_rtol * state.duration


def converged(iterate: Iterate, times: float = 1.0) -> Bools:
    """Return which starts are local optima, to `times` the tolerances, `(starts,)`."""
    closed = near(iterate, times * GAP_RTOL)
    if not closed.any():
        return closed
    state = iterate.state
    missed = np.abs(state.miss).max(axis=ROW_AXES)
    closed &= np.maximum(missed, state.rows.apart) <= times * MISS_TOL
    return closed & (iterate.gain <= times * GAIN_RTOL * state.duration)


def _stepped(iterate: Iterate) -> Iterate:
    """Return the iterate after a Newton step to `slack × multiplier = barrier`."""
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
    multipliers = multipliers + upwards[:, None, None] * multiplier_step
    multipliers = np.maximum(multipliers, aim / MULTIPLIER_SPREAD)  # `clip` takes 10 µs more
    multipliers = np.minimum(multipliers, aim * MULTIPLIER_SPREAD)
    return Iterate(
        PrimalDualState(rows, slacks, multipliers),
        state,
        length=np.minimum(forwards, upwards),
        gain=np.abs((state.rows.times * direction.step.log).sum(axis=1)),
        steps=iterate.steps + 1,
    )


class _Direction(NamedTuple):
    """A Newton step.

    Attributes:
        step: of the unknowns.
        change: first-order change of the inequalities, in a table of their shape.
        slacks: of the slacks.
        forwards: largest allowed length, `(starts,)`.
    """

    step: Any
    change: Array
    slacks: Array
    forwards: Array


def _direction(state: PrimalDualState, aim: Array, miss: Array) -> _Direction:
    """Return the Newton step that also removes the primal residual `miss`."""
    step, change = state.linear.step(aim - state.weights * miss)
    slack_step = change + miss
    farthest = np.abs(step.log).max(axis=1)
    allowed = state.rows.max_log_step
    forwards = np.minimum(
        allowed / np.maximum(farthest, allowed), _longest(state.slacks, slack_step)
    )
    return _Direction(step, change, slack_step, forwards)


def _followed(iterate: Iterate, aim: Array) -> tuple[Inequalities, _Direction]:
    """Return the inequalities after a Newton step, and the step.

    Three steps are tried in turn: one corrected by the inequalities' second derivatives, one
    corrected by the second-order change that this step turned out to have, and the plain Newton
    step, shortened until the method may continue.
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


def _bent(state: PrimalDualState, aim: Array, tried: _Direction, bending: Array) -> _Direction:
    """Return the step corrected for second order, unless it is much shorter than the one tried.

    Args:
        state: at the start of the step.
        aim: barrier over slack of each inequality.
        tried: the step to correct.
        bending: second-order change of the inequalities over the whole of `tried`.
    """
    length = tried.forwards[:, None, None]
    bent = _direction(state, aim, state.miss + length * bending)
    return _either(bent.forwards >= SHORTER * tried.forwards, bent, tried)


def _either(first: Bools, one: _Direction, other: _Direction) -> _Direction:
    """Return `one` step for the starts of `first`, and the `other` for the rest."""
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
    """Return the inequalities after a step, shortened until the method may continue.

    A start whose step cannot be shortened enough gets the length 0, and counts as diverged.
    """
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
