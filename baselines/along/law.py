"""What limits ask along a path: for each row, seven numbers at each point.

Along a path with speed `w`, acceleration `x` and jerk `y` of its parameter a joint has

    v = q' w,    a = q'' w² + q' x,    j = q''' w³ + 3 q'' w x + q' y.

So a row of velocity, acceleration, jerk, tool speed (squared), torque, their rates, or power is

    c0 + cv w + c2 w² + ca x + c3 w³ + cb w x + cu y ≤ 0

with numbers that depend on the position only. A row whose value is an entry of the state has these
numbers at once. Of any other row they are computed from its values at seven states, and an eighth
must agree: no kind of limit is named here.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Indices
from trajopt.core.exceptions import TrajoptError
from trajopt.core.limits import Limit, Limits
from trajopt.core.limits.rows import JointState, Row

# The powers of w, x and y in each of the seven terms.
_TERMS = np.array([(0, 0, 0), (1, 0, 0), (2, 0, 0), (0, 1, 0), (3, 0, 0), (1, 1, 0), (0, 0, 1)])
ORDERS = _TERMS @ (1, 2, 3)
"""By which power of time each term falls in a dilation."""

# States (w, x, y) at which the seven terms are told apart, and one more.
_PROBES = np.array(
    [(0, 0, 0), (1, 0, 0), (-1, 0, 0), (2, 0, 0), (0, 1, 0), (1, 1, 0), (0, 0, 1), (1.5, -0.7, 0.4)]
)
_VALUES = np.prod(_PROBES[:, None] ** _TERMS, axis=2)
_SOLVED = np.linalg.inv(_VALUES[:7])
# By which the eighth value may differ, relative to the largest.
_AGREES_RTOL = 1e-7
# Numbers of terms that count as 0, relative to the largest of the row at any point.
_NOTHING_RTOL = 1e-12
# Bounds smaller than this, relative to the row's values, do not scale it.
_SMALLEST_BOUND = 1e-9


class NoLawError(TrajoptError):
    """A limit's rows have another form along a path than the seven terms."""


class Law(NamedTuple):
    """The numbers of all rows at some points, `(7, points, rows)`, each row divided by its bound.

    Attributes:
        slow: rows without the jerk of the parameter.
        jerk: rows with it.
        keys: the key of the limit of each row, first of `slow`, then of `jerk`.
    """

    slow: Array
    jerk: Array
    keys: tuple[str, ...]


def law(limits: Limits, states: Array, segments: Indices, unit: float) -> Law:
    """Return what limits ask at points of a path.

    Args:
        limits: of the problem.
        states: the path and three derivatives by its parameter, `(4, points, joints)`.
        segments: of each point.
        unit: a speed of the parameter of the usual size.

    Raises:
        NoLawError: the rows of a limit have another form.
    """
    slow: list[tuple[str, Array]] = []
    jerk: list[tuple[str, Array]] = []
    for key, limit in limits.kinds.items():
        for row in _of_limit(limit, states, segments, unit):
            (jerk if row[6].any() else slow).append((key, row))
    keys = tuple(key for key, _ in (*slow, *jerk))
    count = states.shape[1]
    return Law(_table(slow, count), _table(jerk, count), keys)


def _table(rows: list[tuple[str, Array]], count: int) -> Array:
    """Return rows as one table, `(7, points, rows)`; each is given up as it is copied."""
    table = np.empty((7, count, len(rows)))
    for k in reversed(range(len(rows))):
        table[..., k] = rows.pop()[1]
    return table


def _of_limit(limit: Limit, states: Array, segments: Indices, unit: float) -> Iterator[Array]:
    """Yield the numbers of each row of a limit that depends on speed, `(7, points)`."""
    at = _state(states, np.zeros(3), segments)
    places = {id(own): (order, k) for order in range(4) for k, own in enumerate(at[order])}
    rows = list(limit.path_rows(at))
    others = {k: row for k, row in enumerate(rows) if id(row.value) not in places}
    computed = _computed(limit, others, states, segments, unit) if others else {}
    for k, row in enumerate(rows):
        numbers = computed[k] if k in computed else _entry(states, *places[id(row.value)])
        if numbers[1:].any():
            yield from _sides(numbers, row)


def _entry(states: Array, order: int, joint: int) -> Array:
    """Return the numbers of a derivative of a joint itself, `(7, points)`."""
    q, q1, q2, q3 = states[..., joint]
    numbers = np.zeros((7, len(q)))
    if order == 0:
        numbers[0] = q
    elif order == 1:
        numbers[1] = q1
    elif order == 2:
        numbers[2], numbers[3] = q2, q1
    else:
        numbers[4], numbers[5], numbers[6] = q3, 3 * q2, q1
    return numbers


def _computed(
    limit: Limit, rows: dict[int, Row], states: Array, segments: Indices, unit: float
) -> dict[int, Array]:
    """Return the numbers of rows by their values at eight states, `(7, points)` each."""
    powers = unit ** np.arange(1.0, 4.0)
    every = [_state(states, probe * powers, segments) for probe in _PROBES]
    q, v, a, j = (
        [np.concatenate(own) for own in zip(*(at[k] for at in every), strict=True)]
        for k in range(4)
    )
    together = JointState(q, v, a, j, np.tile(segments, len(_PROBES)))
    found = {}
    for k, row in enumerate(limit.path_rows(together)):
        if k not in rows:
            continue
        values = np.broadcast_to(row.value, len(together.segments)).reshape(len(_PROBES), -1)
        numbers = _SOLVED @ values[:7]
        sizes = np.abs(values).max(axis=0)
        missed = np.abs(_VALUES[7] @ numbers - values[7])
        if not (missed <= _AGREES_RTOL * sizes).all():
            raise NoLawError(
                f"{limit.name()} limits: a row is no sum of 1, w, w², x, w³, w x and y times "
                "functions of position (w, x, y: speed, acceleration and jerk along the path), so "
                "a path cannot be timed under them; path_rows may state it in that form"
            )
        largest = np.abs(numbers).max(axis=1, keepdims=True)
        numbers[(largest <= _NOTHING_RTOL * largest.max())[:, 0]] = 0.0
        numbers[np.abs(numbers) < _NOTHING_RTOL * sizes] = 0.0
        found[k] = numbers / (unit**ORDERS)[:, None]
    return found


def _sides(numbers: Array, row: Row) -> Iterator[Array]:
    """Yield `value ≤ high` and `−value ≤ −low`, divided by the size of the bound."""
    for sign, bound in ((1.0, row.high), (-1.0, row.low)):
        own = np.asarray(bound, dtype=float)
        if np.isfinite(own).any():
            size = np.maximum(np.abs(own), _SMALLEST_BOUND)
            wanted = sign * numbers
            wanted[0] = wanted[0] - sign * own
            finite = np.isfinite(own)
            scaled = wanted / np.where(finite, size, 1.0)
            yield scaled if finite.all() else np.where(finite, scaled, _unbounded())


def _unbounded() -> Array:
    """Return the numbers of a row that always holds, `(7, 1)`."""
    return np.array([[-1.0], *[[0.0]] * 6])


def excess(limits: Limits, states: Array, rates: Array, segments: Indices) -> tuple[Array, Array]:
    """Return by how much a motion breaks its limits at points, and how much room it leaves.

    Args:
        limits: of the problem.
        states: the path and three derivatives, `(4, points, joints)`.
        rates: speed, acceleration and jerk of the parameter, `(3, points)`.
        segments: of each point.

    Returns:
        The part of the duration by which the motion must be slower there, to first order; and the
        room to the nearest bound, as a share of what is left of it at rest, `(points,)` each.
    """
    moving = _state(states, rates[..., None], segments)
    resting = _state(states, np.zeros(3), segments)
    slower = np.zeros(len(segments))
    room = np.ones(len(segments))
    for limit in limits.kinds.values():
        if not limit.is_ratio:
            continue
        for row, rest in zip(limit.path_rows(moving), limit.path_rows(resting), strict=True):
            for sign, bound in ((1.0, row.high), (-1.0, row.low)):
                if not np.isfinite(bound).any():
                    continue
                left = np.maximum(sign * (bound - rest.value), _SMALLEST_BOUND)
                over = sign * (row.value - bound) / left
                slower = np.maximum(slower, over / (limit.power * (limit.degree or 2)))
                room = np.minimum(room, -over)
    return slower, room


def _state(states: Array, rates: Array, segments: Indices) -> JointState:
    """Return the joints' state at a speed, acceleration and jerk of the parameter."""
    q, q1, q2, q3 = states
    w, x, y = rates
    orders = (q, q1 * w, q2 * w**2 + q1 * x, q3 * w**3 + 3 * q2 * w * x + q1 * y)
    position, *derivatives = (list(np.ascontiguousarray(own.T)) for own in orders)
    velocity, acceleration, jerk = derivatives
    return JointState(position, velocity, acceleration, jerk, segments)
