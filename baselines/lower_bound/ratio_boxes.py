"""The best 3-5-3 spline with shared times, by branching on its two ratios (mathematics, section 7).

With `r1 = t2/t1` and `r3 = t2/t3` every derivative of the quintic, times a power of `t2`, is a sum
of `1, r1, r3, r1², r3²` at each normalised instant. The cubics' jerk is one of `r1³, r3³`. The
total time is `t2 (1 + 1/r1 + 1/r3)`. So a box of ratios holds no spline shorter than a cut-off if
one limit at one instant needs a longer `t2` everywhere in the box. The boxes that prove this, in
the order in which they are found, are the proof. What it proves, `check_spline353` says, in exact
fractions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from baselines.spline353_nlp import MovingSpline, Spline353NLP
from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.judging import proved_bounds
from trajopt.judging.check_spline353 import FIRST_JERK, JERK, LAST_JERK, POSITION, ROWS
from trajopt.planners import spline353

# Exponents of `r1` and `r3` in the monomials.
_EXPONENTS = np.array(
    [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [2.0, 0.0], [0.0, 2.0], [3.0, 0.0], [0.0, 3.0]]
)
# Quintic Hermite polynomials of `h, v0, v1, a0, a1` on the unit interval, highest power first.
_HERMITE = np.array(
    [
        [6, -15, 10, 0, 0, 0],
        [-3, 8, -6, 0, 1, 0],
        [-3, 7, -4, 0, 0, 0],
        [-0.5, 1.5, -1.5, 0.5, 0, 0],
        [0.5, -1, 0.5, 0, 0, 0],
    ]
).T
# Bound on the rounding of a row's few hundred operations, relative to the sum of all terms.
_ROUNDING_RTOL = 1e-12
_START_INSTANTS = 33
_MAX_INSTANTS = 2000
_INSTANT_SOURCES_PER_ROUND = 4
_BOXES_AT_ONCE = 2048
_MAX_BOXES = 1_000_000
# Smallest width of a box, in logarithms of ratios. In a smaller one rounding errors dominate.
_MIN_LOG_WIDTH = 1e-10
# The gap asked for is reached by steps of this factor, so that a time limit leaves a bound.
_GAP_STEP = 10.0
_FIRST_GAP = 1.0
_PREFIX = "ratio_proof_"


@dataclass(frozen=True, eq=False)
class RatioProof:
    """A proof that no 3-5-3 spline is shorter than a cut-off.

    Attributes:
        cutoff: s, `(1,)`.
        rows: Kind, joint, side and normalised instant of each row that excludes a box, `(rows, 4)`.
        steps: Round by round, a number per box: cut across the first or the last ratio (0 or 1), or
            2 and the number of the row that excludes it, `(boxes,)`.
    """

    cutoff: Array
    rows: Array
    steps: Array

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by the names under which a trial stores them."""
        return {_PREFIX + name: value for name, value in vars(self).items()}

    @classmethod
    def stored(cls, stats: Mapping[str, Any], problem: Problem) -> RatioProof | None:
        """Return the proof among a trial's statistics, if there is one.

        An older proof states instants and leaves in place of rows, which are found anew.

        Raises:
            InvalidInput: A proof without rows is damaged, or belongs to another problem.
        """

        def table(name: str) -> Array:
            return np.asarray(stats[_PREFIX + name], dtype=float)

        names = cls.__dataclass_fields__
        if all(_PREFIX + name in stats for name in names):
            return cls(**{name: table(name) for name in names})
        if not all(_PREFIX + name in stats for name in ("cutoff", "instants", "leaves")):
            return None
        cutoff, instants, leaves = map(table, ("cutoff", "instants", "leaves"))
        usable = np.isin(leaves, np.arange(256)).all() and len(instants) <= 2 * _MAX_INSTANTS
        usable &= bool(((instants >= 0) & (instants <= 1)).all())
        if not usable or cutoff.shape != (1,) or not 0 < cutoff[0] < np.inf:
            raise InvalidInput("proof", "a cut-off, instants from 0 to 1, and leaves")
        with np.errstate(all="ignore"):
            found = Ratios(MovingSpline.of(problem), float(cutoff[0])).restated(instants, leaves)
        if found is None:
            raise InvalidInput("proof", "boxes that cover all ratios, each of them proved")
        return found


class ProvedSpline(NamedTuple):
    """Segment times (s) of the best spline known, and the proof of a lower bound on all splines.

    There is no proof where a segment is so short beside the others that rounding errors dominate.
    """

    times: Array
    proof: RatioProof | None


def best_spline(problem: Problem, within: float, late: Callable[[], bool]) -> ProvedSpline:
    """Search until no spline is shorter than the best one known by more than a given share.

    Args:
        problem: With four waypoints that differ from their neighbours, and some spline that keeps
            the position limits.
        within: Relative gap of both bounds at which to stop.
        late: Returns whether the time limit is over. The proof of the last gap reached is the
            answer.
    """
    spline = MovingSpline.of(problem)
    times = Spline353NLP().solve(problem).stats["segment_times"]
    even = np.linspace(0, 1, _START_INSTANTS)
    proof = None
    reached = _FIRST_GAP
    while reached > within:
        gap = max(within, reached / _GAP_STEP)
        ratios = Ratios(spline, times.sum() / (1 + gap))
        instants = np.unique(np.append(even, _critical_instants(spline, times)))
        outcome = ratios.search(instants, late)
        if outcome.times is not None:
            times = outcome.times
        elif outcome.proof is not None:
            proof = outcome.proof
            reached = gap
        else:
            break
    return ProvedSpline(times, proof)


class SearchResult(NamedTuple):
    """Result of a search: a proof, or a shorter spline's segment times (s), or neither."""

    proof: RatioProof | None
    times: Array | None


class _ImposedLimits(NamedTuple):
    """Limits at some instants: a sum of monomials is at most `t2^order`, or 0 for a position.

    Attributes:
        coefficients: Coefficients of the monomials, divided by the limit, `(rows, 7)`.
        orders: Orders of the derivatives, `(rows,)`; 0 for position.
        origins: Kind, joint, side and instant of each, as in a proof, `(rows, 4)`.
    """

    coefficients: Array
    orders: Indices
    origins: Array


class Boxes(NamedTuple):
    """Boxes of `(log r1, log r3)`; both corners are `(boxes, 2)`."""

    low: Array
    high: Array

    @property
    def centre(self) -> Array:
        return (self.low + self.high) / 2

    def only(self, chosen: Bools) -> Boxes:
        return Boxes(self.low[chosen], self.high[chosen])

    @property
    def longer(self) -> Indices:
        """Return which side of each box is longer, 0 or 1."""
        return (self.high - self.low).argmax(axis=1)

    def halved(self) -> Boxes:
        """Return both halves of each box, across its longer side."""
        across = np.equal(self.longer[:, None], np.arange(2))
        upper = np.where(across, self.centre, self.low)
        lower = np.where(across, self.centre, self.high)
        return Boxes(np.concatenate([self.low, upper]), np.concatenate([lower, self.high]))


class Ratios:
    """All ratios of segment times of 3-5-3 splines that are shorter than a cut-off, s."""

    def __init__(self, spline: MovingSpline, cutoff: float) -> None:
        self.spline = spline
        self.cutoff = cutoff
        low, high = segment_times(spline, cutoff)
        self.is_empty = bool(low.sum() * (1 - _ROUNDING_RTOL) > cutoff)
        lowest = np.log(low[1] / high[::2]) - _ROUNDING_RTOL
        highest = np.log(high[1] / low[::2]) + _ROUNDING_RTOL
        self.root = Boxes(lowest[None], highest[None])

    def search(self, instants: Array, late: Callable[[], bool]) -> SearchResult:
        """Halve boxes until all are proved, a shorter spline is found, or time is over.

        Args:
            instants: Normalised instants to begin with.
            late: Returns whether the time limit is over.
        """
        if self.is_empty:
            return SearchResult(self._proof([]), None)
        boxes = self.root
        steps: list[tuple[Indices, Array]] = []
        while len(boxes.low):
            width = (boxes.high - boxes.low).max()
            if late() or width < _MIN_LOG_WIDTH or len(boxes.low) > _MAX_BOXES:
                return SearchResult(None, None)
            rows = self._rows(instants)
            row = self._excluding(rows, boxes)
            steps.append((np.where(row < 0, boxes.longer, ROWS), rows.origins[row]))
            rest = boxes.only(row < 0)
            shorter, instants = self._exchanged(rows, rest.centre, instants)
            if shorter is not None:
                return SearchResult(None, shorter)
            boxes = rest.halved()
        return SearchResult(self._proof(steps), None)

    def restated(self, instants: Array, leaves: Array) -> RatioProof | None:
        """Return a proof with the rows that exclude its boxes; None where a box has no such row.

        Args:
            instants: Normalised instants of the quintic at which the limits count, `(instants,)`.
            leaves: Round by round, a bit per box: excluded (1) or halved (0). Eight bits are
                packed into a number, `(bytes,)`.
        """
        flags = np.unpackbits(leaves.astype(np.uint8)).astype(bool)
        rows = self._rows(instants)
        boxes = self.root.only(np.array([not self.is_empty]))
        steps = []
        while len(boxes.low):
            leaf, flags = np.split(flags, [len(boxes.low)])
            row = self._excluding(rows, boxes)
            if len(leaf) < len(boxes.low) or (row[leaf] < 0).any():
                return None
            steps.append((np.where(leaf, ROWS, boxes.longer), rows.origins[row]))
            boxes = boxes.only(~leaf).halved()
        return self._proof(steps)

    def _proof(self, found: list[tuple[Indices, Array]]) -> RatioProof:
        """Return the proof of the steps of all rounds, and of the row that each leaf has."""
        steps = np.concatenate([np.zeros(0, dtype=int), *(step for step, _ in found)])
        origins = np.concatenate([np.zeros((0, 4)), *(origin for _, origin in found)])
        leaf = steps == ROWS
        rows, number = np.unique(origins[leaf], axis=0, return_inverse=True)
        steps[leaf] += number.ravel()
        return RatioProof(np.array([self.cutoff]), rows, steps.astype(float))

    def _rows(self, instants: Array) -> _ImposedLimits:
        spline = self.spline
        d1, h, d3 = spline.displacements.T
        parts = np.stack([h, 3 * d1, 3 * d3, 6 * d1, -6 * d3], axis=-1)
        tables = []
        origins = []

        def add(table: Array, kind: int, joints: Bools, side: int, at: Array) -> None:
            tables.append(table)
            at, joint = np.broadcast_arrays(at[:, None], np.flatnonzero(joints))
            columns = np.broadcast_arrays(kind, joint.ravel(), side, at.ravel())
            origins.append(np.stack(columns, axis=1).astype(float))

        bounds = (spline.limits.velocity, spline.limits.acceleration, spline.limits.jerk)
        for order, pairs in enumerate(bounds, start=1):
            rates = polynomials.derivative(_HERMITE, order)[:, None]
            basis = polynomials.evaluate(rates, instants[:, None])
            values = basis[:, None] * parts
            for side, limits in enumerate(pairs.T):
                finite = np.isfinite(limits)
                add(
                    _padded(values[:, finite] / limits[finite, None]), order, finite, side, instants
                )
                if order == JERK:
                    for segment, kind in ((0, FIRST_JERK), (2, LAST_JERK)):
                        cube = 6 * spline.displacements[finite, segment] / limits[finite]
                        add(_cubes(cube, kind), kind, finite, side, np.zeros(1))
        for side, (table, finite) in enumerate(self._position_tables(instants, parts)):
            add(table, POSITION, finite, side, instants)
        every = np.concatenate(origins)
        orders = np.minimum(every[:, 0], JERK).astype(int)
        return _ImposedLimits(np.concatenate(tables), orders, every)

    def _position_tables(self, instants: Array, parts: Array) -> Iterator[tuple[Array, Bools]]:
        """Yield a position's distance beyond each limit, over the joint's largest displacement.

        Beside it stands which joints have that limit.
        """
        room = self.spline.room
        if room is None:
            return
        basis = polynomials.evaluate(_HERMITE[:, None], instants[:, None])
        values = basis[:, None] * parts
        sizes = np.abs(self.spline.displacements).max(axis=1)
        for side, sign in zip(room.T, (-1.0, 1.0), strict=True):
            finite = np.isfinite(side)
            beyond = values[:, finite].copy()
            beyond[..., 0] -= side[finite]
            beyond *= sign / sizes[finite, None]
            yield _padded(beyond), finite

    def _exchanged(
        self, rows: _ImposedLimits, points: Array, instants: Array
    ) -> tuple[Array | None, Array]:
        """Return a shorter spline's segment times among points, or more instants that exclude them.

        Points that are already excluded are ignored.
        """
        points = points[(self._excess(rows, points) <= 0).all(axis=1)]
        if not len(points):
            return None, instants
        times = self._times(points)
        dilation = self.spline.dilation(times)
        inside = self.spline.keeps_positions(times)
        best = int(np.where(inside, dilation, np.inf).argmin())
        if inside[best] and dilation[best] < 1:
            return times[best] * dilation[best], instants
        if len(instants) > _MAX_INSTANTS:
            return None, instants
        nearest = np.argsort(dilation)[:_INSTANT_SOURCES_PER_ROUND]
        found = [_critical_instants(self.spline, own) for own in times[nearest]]
        return None, np.unique(np.concatenate([instants, *found]))

    def _excess(self, rows: _ImposedLimits, points: Array) -> Array:
        """Return each row's sum minus the longest `t2` to its order, `(points, rows)`."""
        sums = _monomials(points) @ rows.coefficients.T
        return sums - self._thresholds(points)[:, rows.orders]

    def _times(self, points: Array) -> Array:
        """Return segment times of points, with the cut-off as their sum, `(points, 3)`."""
        shares = _shares(points)
        middle = self.cutoff / (1 + shares.sum(axis=1))
        outer = shares * middle[:, None]
        return np.stack([outer[:, 0], middle, outer[:, 1]], axis=1)

    def _thresholds(self, points: Array) -> Array:
        """Return the longest `t2` to the power of each order, `(points, 4)`; 0 for positions."""
        longest = self.cutoff / (1 + _shares(points).sum(axis=1))
        powers = longest[:, None] ** np.arange(4)
        powers[:, 0] = 0.0
        return powers

    def _excluding(self, rows: _ImposedLimits, boxes: Boxes) -> Indices:
        """Return the row by which a box holds no spline shorter than the cut-off; -1 without."""
        parts = [np.zeros(0, dtype=int)]
        for begin in range(0, len(boxes.low), _BOXES_AT_ONCE):
            chosen = slice(begin, begin + _BOXES_AT_ONCE)
            some = Boxes(boxes.low[chosen], boxes.high[chosen])
            parts.append(self._excluding_at_once(rows, some))
        return np.concatenate(parts)

    def _excluding_at_once(self, rows: _ImposedLimits, boxes: Boxes) -> Indices:
        """Bound each row from below by the mean value theorem.

        A row is a limit's sum of monomials minus the longest `t2` to the power of its order. It is
        at least its value at the centre minus its largest slopes times half the widths.
        """
        at_centre = self._excess(rows, boxes.centre)
        # a row that is negative at every centre excludes none of these boxes
        useful = np.flatnonzero((at_centre > 0).any(axis=0))
        if not len(useful):
            return np.full(len(boxes.low), -1)
        orders = rows.orders[useful]
        coefficients = rows.coefficients[useful].T
        sizes = np.abs(coefficients)
        monomials_low = _monomials(boxes.low)
        monomials_high = _monomials(boxes.high)
        middle = (monomials_low + monomials_high) / 2
        spread = (monomials_high - monomials_low) / 2
        threshold_low = self._thresholds(boxes.low)
        threshold_high = self._thresholds(boxes.high)
        least = at_centre[:, useful]
        half_width = (boxes.high - boxes.low) / 2
        for side in range(2):
            exponents = _EXPONENTS[:, side]
            slope = (middle * exponents) @ coefficients
            error = (spread * exponents) @ sizes
            # the threshold's own slope: order * threshold * (t_side/t2) / (1 + t1/t2 + t3/t2)
            share_low, share_high = _share_of_total(boxes, side)
            smallest = np.arange(4) * threshold_low * share_low[:, None]
            largest = np.arange(4) * threshold_high * share_high[:, None]
            rise = slope + error - smallest[:, orders]
            fall = error - slope + largest[:, orders]
            steepest = np.maximum(rise, fall)
            least -= steepest * half_width[:, side, None]
        rounded = monomials_high @ sizes + threshold_high[:, orders]
        certain = least / rounded
        best = certain.argmax(axis=1)
        return np.where(certain.max(axis=1) > _ROUNDING_RTOL, useful[best], -1)


def _shares(points: Array) -> Array:
    """Return `t1/t2` and `t3/t2`, `(points, 2)`."""
    return np.exp(-points)


def _share_of_total(boxes: Boxes, side: int) -> tuple[Array, Array]:
    """Return the least and the largest share of an outer segment in the total time."""
    other = 1 - side
    longest = _shares(boxes.low)
    shortest = _shares(boxes.high)
    low = shortest[:, side] / (1 + shortest[:, side] + longest[:, other])
    high = longest[:, side] / (1 + longest[:, side] + shortest[:, other])
    return low, high


def proved_bound(problem: Problem, proof: RatioProof) -> float:
    """Return the lower bound, s, that a proof proves for all 3-5-3 splines of a problem.

    Raises:
        InvalidInput: The proof is not one of this problem, or the problem has not four waypoints.
    """
    return proved_bounds.proved_spline353(problem, vars(proof))


def _critical_instants(spline: MovingSpline, times: Array) -> Array:
    """Return the normalised instants of the quintic where a limit can be worst, `(instants,)`."""
    parts = spline.displacements.T
    quintic = spline353.Quintic.between(parts, times)
    points = []
    for controls in (
        spline353.position_coefficients(parts, times),
        quintic.velocity(),
        quintic.acceleration(),
        quintic.jerk(),
    ):
        curve = polynomials.from_bernstein(np.array(controls))
        points.append(polynomials.critical_points(curve).ravel())
    return np.clip(np.concatenate(points), 0.0, 1.0)


def segment_times(spline: MovingSpline, total: float) -> tuple[Array, Array]:
    """Return the least and the most time of each segment within a total, s, `(3,)` each."""
    d = np.abs(spline.displacements)
    v = _wider(spline.limits.velocity)
    a = _wider(spline.limits.acceleration)
    j = _wider(spline.limits.jerk)

    # 3 |d|/t ≤ V, 6 |d|/t² ≤ A, 6 |d|/t³ ≤ J
    by_velocity = 3 * d / v
    by_acceleration = np.sqrt(6 * d / a)
    by_jerk = np.cbrt(6 * d / j)
    outer = np.max([by_velocity, by_acceleration, by_jerk], axis=0)
    outer[:, 1] = d[:, 1] / v[:, 0]
    low = outer.max(axis=0)
    others = low.sum() - low
    return low, np.maximum(total - others, low)


def _wider(limits: Array) -> Array:
    """Return the larger size of both sides of each limit, `(joints, 1)`."""
    return np.abs(limits).max(axis=1)[:, None]


def _monomials(points: Array) -> Array:
    """Return the monomials at points, `(points, 7)`."""
    return np.exp(points @ _EXPONENTS.T)


def _padded(table: Array) -> Array:
    """Complete coefficients of the first five monomials to rows of all seven."""
    rows = table.reshape(-1, 5)
    return np.pad(rows, ((0, 0), (0, 2)))


def _cubes(coefficients: Array, kind: int) -> Array:
    """Return rows of a cubic's jerk: of `r1³` or `r3³`."""
    rows = np.zeros((len(coefficients), len(_EXPONENTS)))
    rows[:, 5 + kind - FIRST_JERK] = coefficients
    return rows
