"""The rows of a problem's limits, as boxes and constraints on a grid. No kind of limit is named.

A row may bound one derivative of one joint. Then it becomes a box: bounds of a variable. All other
rows become constraints ("curved" rows). A polynomial row is imposed on its Bernstein coefficients,
so it holds at every instant. Any other row is imposed at five instants of each interval.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from baselines.collocation.symbols import NotPolynomialError, Polynomial, Symbol, made
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.limits import Limit
from trajopt.core.limits.rows import JointState, Row
from trajopt.core.problem import Problem
from trajopt.planners.planner import backend

# Where a row that is no polynomial is imposed, in shares of an interval.
_SHARES = (0.0, 0.25, 0.5, 0.75, 1.0)


class Curved(NamedTuple):
    """The rows of one limit that become constraints.

    Attributes:
        limit: the limit, in SI units.
        rows: indices of these rows among all rows of the limit.
        vary: of each row, whether its bounds differ from segment to segment.
        low, high: bounds of the rows, infinite where a row is not imposed, `(rows, intervals)`.
    """

    limit: Limit
    rows: tuple[int, ...]
    vary: tuple[bool, ...]
    low: Array
    high: Array


class Asked(NamedTuple):
    """What limits ask on a grid, in SI units.

    Attributes:
        boxes: lowest and highest values of each derivative, `(4 orders, 2, intervals, joints)`.
        leaving: lowest and highest velocities, `(2, intervals, joints)`. One of them is 0 where a
            joint may only move away from an end of its range; elsewhere they are infinite.
        curved: the limits with other rows.
        segments: the segment of each interval.
    """

    boxes: Array
    leaving: Array
    curved: tuple[Curved, ...]
    segments: Indices

    @property
    def together(self) -> bool:
        """Whether one curved row may depend on several joints."""
        return not all(own.limit.separate for own in self.curved)


def of(problem: Problem, intervals: int) -> Asked:
    """Return what a problem's limits ask on equal numbers of intervals per segment.

    A segment may begin at a waypoint where a row does not hold at rest. Then the row's `leaving` is
    imposed in the first half of the segment's intervals, or in all of them if the row does not hold
    at the segment's end either. The row itself is imposed in the others. Lengths of free intervals
    vary, so the joint may turn at any time.
    """
    segments = np.repeat(np.arange(problem.segments), intervals)
    at = _at_rest(problem, segments)
    places = {id(own): (order, k) for order in range(4) for k, own in enumerate(at[order])}
    unbounded = np.tile([[[-np.inf]], [[np.inf]]], (1, len(segments), problem.joints))
    boxes = np.tile(unbounded, (4, 1, 1, 1))
    leaving = unbounded.copy()
    first_half = np.arange(len(segments)) % intervals < intervals / 2
    curved = []
    for limit in problem.limits.kinds.values():
        rows, vary, lows, highs = [], [], [], []
        for number, row in enumerate(limit.rows(at)):
            if id(row.value) in places:
                order, joint = places[id(row.value)]
                _tighten(boxes[order, ..., joint], row, True)
                continue
            if np.ndim(row.value) == 0:  # a constant: its joints are at rest
                continue
            imposed = np.ones(len(segments), dtype=bool)
            if row.leaving is not None:
                begins, ends = (row.value < row.low) | (row.value > row.high)
                away = begins & (ends | first_half)
                _, joint = places[id(row.leaving.value)]
                _tighten(leaving[..., joint], row.leaving, away)
                imposed = ~away
            rows.append(number)
            vary.append(any(np.unique(bound).size > 1 for bound in (row.low, row.high)))
            lows.append(np.where(imposed, row.low, -np.inf))
            highs.append(np.where(imposed, row.high, np.inf))
        if rows:
            bounds = np.array(lows), np.array(highs)
            curved.append(Curved(limit, tuple(rows), tuple(vary), *bounds))
    return Asked(boxes, leaving, tuple(curved), segments)


def bent(problem: Problem) -> Bools:
    """Return the joints whose optimal acceleration is no step function, `(joints,)`.

    A row that depends on acceleration together with position or velocity makes it a curve.
    """
    joints = problem.joints
    found = np.zeros(joints, dtype=bool)
    rng = np.random.default_rng(0)
    q, v, a, j = (list(own) for own in rng.uniform(0.1, 1.0, (4, joints, 3)))
    at = JointState(q, v, a, j, np.zeros(3, dtype=np.intp))
    other = at._replace(a=[2 * own for own in a])
    moved = at._replace(q=[1.5 * own for own in q], v=[1.5 * own for own in v])
    for limit in problem.limits.kinds.values():
        for rows in zip(*(limit.rows(own) for own in (at, other, moved)), strict=True):
            here, faster, there = (row.value for row in rows)
            if np.any(here != faster) and np.any(here != there):
                found |= limit.bounds
    return found


def _at_rest(problem: Problem, segments: Any) -> JointState:
    """Return rest at the waypoints of each interval's segment, `(2 waypoints, intervals)`."""
    q = problem.waypoints[np.stack([segments, segments + 1])]
    joints = range(problem.joints)
    v, a, j = ([np.zeros(q.shape[:2]) for _ in joints] for _ in range(3))
    return JointState([q[..., k] for k in joints], v, a, j, segments)


def _tighten(box: Array, row: Row, where: Bools | bool) -> None:
    """Make a box, `(2, intervals)`, as narrow as a row in some intervals."""
    box[0] = np.where(where, np.maximum(box[0], row.low), box[0])
    box[1] = np.where(where, np.minimum(box[1], row.high), box[1])


class Curves:
    """Constraints of the curved rows. Two that are equal have the same expressions.

    Attributes:
        together: whether all joints have the same lengths of intervals, since one row may depend
            on several of them.
        sampled: whether a row is imposed at instants only. Known after `constraints`.
        jumps: whether a row's value jumps between intervals. Known after `constraints`.
    """

    sampled = False
    jumps = False

    def __init__(
        self, asked: Asked, unit: float, scale: Array, origin: Array, to_end: bool
    ) -> None:
        """Prepare the rows of a grid.

        Args:
            asked: what the limits ask.
            unit: the grid's unit of time, s.
            scale: its unit of length of each joint, rad, `(joints,)`.
            origin: position of each joint that counts as 0, rad, `(joints,)`.
            to_end: whether the motion's last state varies, so that rows are imposed there too.
        """
        self.asked, self.unit, self.scale, self.origin = asked, unit, scale, origin
        self.to_end = to_end
        limits = [own.limit for own in asked.curved]
        self.together = asked.together
        numbers = [(type(own), own.numbers.shape, own.numbers.tobytes()) for own in limits]
        units = (unit, scale.tobytes(), origin.tobytes(), to_end)
        self._key = (*numbers, *units) if limits else ()

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Curves) and self._key == other._key

    def __hash__(self) -> int:
        return hash(self._key)

    def constraints(self, x: Any, smooth: Sequence[bool]) -> list[tuple[Any, Any, Any]]:
        """Return columns of CasADi and symbols for their lowest and highest values.

        Args:
            x: the grid's nodes (`baselines.collocation.uniform.Nodes`), symbols.
            smooth: which joints have a continuous acceleration.
        """
        ca = backend("casadi")
        found = []
        self._places: list[tuple[int, int, slice]] = []  # limit, row and intervals of each column
        for number, own in enumerate(self.asked.curved):
            at, limit = self._state(own.limit, x, smooth), self._in_units(own.limit)
            try:
                rows = _of(own, limit, at)
                values = [made(row.value) for row in rows]
                every = [(list(value.parts), value.continuous) for value in values]
            except NotPolynomialError:
                self.sampled = True
                every = _at_instants(own, limit, at)
            for row, (parts, continuous) in enumerate(every):
                self.jumps |= not continuous
                # the last part is the next interval's first
                shared = continuous and not own.vary[row] and len(parts) > 1
                whole = parts[:-1] if shared else parts
                columns = [(part, slice(None)) for part in whole]
                if shared and self.to_end:
                    columns.append((parts[-1][-1], slice(-1, None)))
                for column, intervals in columns:
                    low, high = (ca.MX.sym(side, column.shape[0]) for side in ("low", "high"))
                    found.append((column, low, high))
                    self._places.append((number, row, intervals))
        return found

    def bounds(self, curved: Sequence[Curved], fixed: Bools | None = None) -> list[Array]:
        """Return the numbers for the symbols of `constraints`, low and high of each column.

        Args:
            curved: of a grid with equal `Curves`.
            fixed: of all constraints of a program, which ones no variable changes; the constraints
                of the rows are the last of them. Nothing is imposed on fixed ones.
        """
        found = []
        end = 0
        for number, row, intervals in reversed(self._places):
            low, high = curved[number].low[row, intervals], curved[number].high[row, intervals]
            begin = end - len(low)
            if fixed is not None:
                imposed = ~fixed[begin : end or None]
                low, high = np.where(imposed, low, -np.inf), np.where(imposed, high, np.inf)
            found += [high, low]
            end = begin
        return found[::-1]

    def _in_units(self, limit: Limit) -> Limit:
        return limit.in_units(self.unit, self.scale[:, None]) if limit.separate else limit

    def _state(self, limit: Limit, x: Any, smooth: Sequence[bool]) -> JointState:
        """Return the state on every interval; of `separate` limits in the grid's units."""
        unit, scale, shift = self.unit, self.scale, self.origin
        if limit.separate:
            unit, scale, shift = 1.0, np.ones_like(self.scale), self.origin / self.scale
        orders: list[list[Any]] = [[], [], [], []]
        for joint, is_smooth in enumerate(smooth):
            every = polynomials(x, joint, is_smooth)
            for order, (parts, continuous) in enumerate(every):
                size = float(scale[joint] / unit**order)
                own = parts if size == 1 else [size * part for part in parts]
                if order == 0:
                    own = [part + float(shift[joint]) for part in own]
                orders[order].append(Polynomial(own, continuous=continuous))
        q, v, a, j = orders
        return JointState(q, v, a, j, self.asked.segments)


def polynomials(x: Any, joint: int, smooth: bool) -> list[tuple[list[Any], bool]]:
    """Return the Bernstein coefficients of position and its derivatives in the grid's units."""
    length = x.lengths[:, joint]
    (q0, q1), (v0, v1), (a0, a1) = ((own[:-1, joint], own[1:, joint]) for own in (x.q, x.v, x.a))
    if smooth:
        q = [q0, q0 + length * v0 / 3, q1 - length * v1 / 3, q1]
        jerk = [(a1 - a0) / length]
        return [(q, True), ([v0, v0 + length * a0 / 2, v1], True), ([a0, a1], True), (jerk, False)]
    q = [q0, q0 + length * v0 / 2, q1]
    return [(q, True), ([v0, v1], True), ([(v1 - v0) / length], False), ([0 * length], False)]


def _of(curved: Curved, limit: Limit, at: JointState) -> list[Row]:
    every = list(limit.rows(at))
    return [every[row] for row in curved.rows]


def _at_instants(curved: Curved, limit: Limit, at: JointState) -> list[tuple[list[Any], bool]]:
    ca = backend("casadi")
    entries = [own for order in range(4) for own in at[order]]
    symbols = [ca.MX.sym("entry", len(at.segments)) for _ in entries]
    q, v, a, j = np.array([Symbol(own) for own in symbols], dtype=object).reshape(4, -1).tolist()
    rows = _of(curved, limit, JointState(q, v, a, j, at.segments))
    values = [ca.MX(getattr(own.value, "column", own.value)) for own in rows]
    function = ca.Function("rows", symbols, values)
    every = [function.call([own.at(share) for own in entries]) for share in _SHARES]
    pairs = zip(symbols, entries, strict=True)
    jumping = ca.vertcat(*(own for own, entry in pairs if not entry.continuous))
    return [
        (list(parts), limit.segments is None and not ca.depends_on(value, jumping))
        for value, parts in zip(values, zip(*every, strict=True), strict=True)
    ]
