"""The best 3-5-3 spline with shared times, by branching on its two ratios (mathematics, section 5).

With `r1 = t2/t1` and `r3 = t2/t3` every derivative of the quintic, times a power of `t2`, is a sum
of `1, r1, r3, r1², r3²` at each normalised instant, and the cubics' jerk is one of `r1³, r3³`. The
total time is `t2 (1 + 1/r1 + 1/r3)`. So a box of ratios holds no spline briefer than a cut-off if
one limit at one instant needs a longer `t2` everywhere in the box. The boxes that prove this, in
the order in which they are found, are the proof, which is checked without a solver.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.spline353_nlp import MovingSpline
from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.planners import spline353

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

# Exponents of `r1` and `r3` in the monomials.
_EXPONENTS = np.array([[0, 0], [1, 0], [0, 1], [2, 0], [0, 2], [3, 0], [0, 3]], dtype=float)
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
# Relative to the sum of all terms: more than a row's few hundred operations can round.
_ROUNDING_RTOL = 1e-12
_START_INSTANTS = 33
_MAX_INSTANTS = 2000
_INSTANT_SOURCES_PER_ROUND = 4
_BOXES_AT_ONCE = 2048
_MAX_BOXES = 1_000_000
# Logarithm of a ratio: in a smaller box rounding decides.
_LEAST_WIDTH = 1e-10
_PREFIX = "ratio_proof_"


@dataclass(frozen=True, eq=False)
class RatioProof:
    """What proves that no 3-5-3 spline is briefer than a cut-off.

    Attributes:
        cutoff: s, `(1,)`.
        instants: Normalised instants of the quintic at which limits are asked, `(instants,)`.
        leaves: Round by round, whether each box is proved (1) or halved (0), packed eight to a
            number, `(bytes,)`.
    """

    cutoff: Array
    instants: Array
    leaves: Array

    def arrays(self) -> dict[str, Array]:
        """By the names under which a trial stores them."""
        return {_PREFIX + name: value for name, value in vars(self).items()}

    @classmethod
    def stored(cls, stats: Mapping[str, Any]) -> RatioProof | None:
        """The proof among a trial's statistics, if there is one."""
        names = cls.__dataclass_fields__
        if not all(_PREFIX + name in stats for name in names):
            return None
        return cls(**{name: np.asarray(stats[_PREFIX + name], dtype=float) for name in names})


class Outcome(NamedTuple):
    """How a search ended: with a proof, with a briefer spline's segment times (s), or neither."""

    proof: RatioProof | None
    times: Array | None


class _Rows(NamedTuple):
    """Limits at instants: the monomials' sum is at most `t2^order`, or 0 for a position limit.

    Attributes:
        coefficients: Of the monomials, over the limit, `(rows, 7)`.
        orders: Of the derivative, `(rows,)`; 0 for position.
    """

    coefficients: Array
    orders: NDArray[np.intp]


class Boxes(NamedTuple):
    """Boxes of `(log r1, log r3)`; both corners are `(boxes, 2)`."""

    low: Array
    high: Array

    @property
    def centre(self) -> Array:
        return (self.low + self.high) / 2

    def only(self, chosen: Flags) -> Boxes:
        return Boxes(self.low[chosen], self.high[chosen])

    def halved(self) -> Boxes:
        """Both halves of each box, across its longer side."""
        width = self.high - self.low
        longer = width.argmax(axis=1)
        across = np.equal(longer[:, None], np.arange(2))
        upper = np.where(across, self.centre, self.low)
        lower = np.where(across, self.centre, self.high)
        return Boxes(np.concatenate([self.low, upper]), np.concatenate([lower, self.high]))


class Ratios:
    """All ratios of segment times of a problem's 3-5-3 splines that are briefer than a cut-off.

    Args:
        spline: Of the problem.
        cutoff: s.
    """

    def __init__(self, spline: MovingSpline, cutoff: float) -> None:
        self.spline = spline
        self.cutoff = cutoff
        low, high = segment_times(spline, cutoff)
        # Without displacement an outer segment takes no time: its ratio has no part in anything.
        self.present = low[::2] > 0
        self.is_empty = bool(low.sum() * (1 - _ROUNDING_RTOL) > cutoff)
        outer_low = np.where(self.present, low[::2], 1.0)
        outer_high = np.where(self.present, high[::2], 1.0)
        margin = _ROUNDING_RTOL
        lowest = np.log(low[1] / outer_high) - margin
        highest = np.log(high[1] / outer_low) + margin
        lowest = np.where(self.present, lowest, 0.0)
        highest = np.where(self.present, highest, 0.0)
        self.root = Boxes(lowest[None], highest[None])

    def search(self, instants: Array, deadline: float) -> Outcome:
        """Halve boxes until all are proved, a briefer spline is found, or time is over.

        Args:
            instants: Normalised instants to begin with.
            deadline: Of `time.perf_counter`.
        """
        if self.is_empty:
            return Outcome(self._proof(instants, []), None)
        boxes = self.root
        flags: list[Flags] = []
        while len(boxes.low):
            late = time.perf_counter() > deadline
            width = (boxes.high - boxes.low).max()
            if late or width < _LEAST_WIDTH or len(boxes.low) > _MAX_BOXES:
                return Outcome(None, None)
            rows = self._rows(instants)
            proved = self._proved(rows, boxes)
            flags.append(proved)
            rest = boxes.only(~proved)
            briefer, instants = self._exchanged(rows, rest.centre, instants)
            if briefer is not None:
                return Outcome(None, briefer)
            boxes = rest.halved()
        return Outcome(self._proof(instants, flags), None)

    def check(self, proof: RatioProof) -> bool:
        """Whether the proof's boxes cover all ratios, and each one is proved."""
        if self.is_empty:
            return True
        packed = proof.leaves.astype(np.uint8)
        flags = np.unpackbits(packed).astype(bool)
        rows = self._rows(proof.instants)
        boxes = self.root
        begin = 0
        while len(boxes.low):
            proved = flags[begin : begin + len(boxes.low)]
            begin += len(boxes.low)
            if len(proved) < len(boxes.low):
                return False
            if not self._proved(rows, boxes.only(proved)).all():
                return False
            boxes = boxes.only(~proved).halved()
        return True

    def _proof(self, instants: Array, flags: list[Flags]) -> RatioProof:
        every = np.concatenate([*flags, np.zeros(0, dtype=bool)])
        leaves = np.packbits(every).astype(float)
        return RatioProof(np.array([self.cutoff]), instants, leaves)

    def _rows(self, instants: Array) -> _Rows:
        spline = self.spline
        d1, h, d3 = spline.displacements.T
        parts = np.stack([h, 3 * d1, 3 * d3, 6 * d1, -6 * d3], axis=-1)
        tables = []
        orders = []
        for order, bounds in enumerate(spline.bounds, start=1):
            rates = polynomials.derivative(_HERMITE, order)[:, None]
            basis = polynomials.evaluate(rates, instants[:, None])
            values = basis[:, None] * parts
            for side in bounds.T:
                finite = np.isfinite(side)
                table = values[:, finite] / side[finite, None]
                tables.append(_padded(table))
                orders.append(order)
        if spline.orders == 3:
            for side in spline.bounds[2].T:
                finite = np.isfinite(side)
                tables.append(_cubes(spline.displacements[finite], side[finite]))
                orders.append(3)
        for table in self._position_tables(instants, parts):
            tables.append(table)
            orders.append(0)
        counts = [len(table) for table in tables]
        return _Rows(np.concatenate(tables), np.repeat(orders, counts))

    def _position_tables(self, instants: Array, parts: Array) -> Iterator[Array]:
        """How far a position is beyond each limit, over the joint's largest displacement."""
        room = self.spline.room
        if room is None:
            return
        basis = polynomials.evaluate(_HERMITE[:, None], instants[:, None])
        values = basis[:, None] * parts
        for side, sign in zip(room.T, (-1.0, 1.0), strict=True):
            finite = np.isfinite(side)
            beyond = values[:, finite].copy()
            beyond[..., 0] -= side[finite]
            beyond *= sign / self.spline.sizes[finite, None]
            yield _padded(beyond)

    def _exchanged(self, rows: _Rows, points: Array, instants: Array) -> tuple[Array | None, Array]:
        """Segment times briefer than the cut-off among points, or more instants that exclude them.

        Points that some row excludes need neither.
        """
        points = points[(self._excess(rows, points) <= 0).all(axis=1)]
        if not len(points):
            return None, instants
        times = self._times(points)
        own_times = times[:, None, :]
        displacements = self.spline.displacements
        dilation = spline353.dilation(displacements, own_times, self.spline.limits)
        inside = self.spline.excesses(times) == 0
        best = int(np.where(inside, dilation, np.inf).argmin())
        if inside[best] and dilation[best] < 1:
            return times[best] * dilation[best], instants
        if len(instants) > _MAX_INSTANTS:
            return None, instants
        nearest = np.argsort(dilation)[:_INSTANT_SOURCES_PER_ROUND]
        found = [critical_instants(self.spline, own) for own in times[nearest]]
        return None, np.unique(np.concatenate([instants, *found]))

    def _excess(self, rows: _Rows, points: Array) -> Array:
        """Each row's sum minus the longest `t2` to the power of its order, `(points, rows)`."""
        sums = _monomials(points) @ rows.coefficients.T
        return np.asarray(sums - self._thresholds(points)[:, rows.orders])

    def _times(self, points: Array) -> Array:
        """Segment times of points, with the cut-off as their sum, `(points, 3)`."""
        shares = self._shares(points)
        middle = self.cutoff / (1 + shares.sum(axis=1))
        outer = np.maximum(shares, _ROUNDING_RTOL) * middle[:, None]
        return np.stack([outer[:, 0], middle, outer[:, 1]], axis=1)

    def _shares(self, points: Array) -> Array:
        """`t1/t2` and `t3/t2`, `(points, 2)`."""
        return np.where(self.present, np.exp(-points), 0.0)

    def _thresholds(self, points: Array) -> Array:
        """The longest `t2` to the power of each order, `(points, 4)`; 0 for positions."""
        longest = self.cutoff / (1 + self._shares(points).sum(axis=1))
        powers = longest[:, None] ** np.arange(4)
        powers[:, 0] = 0.0
        return np.asarray(powers)

    def _proved(self, rows: _Rows, boxes: Boxes) -> Flags:
        """Which boxes hold no spline briefer than the cut-off."""
        parts = [np.zeros(0, dtype=bool)]
        for begin in range(0, len(boxes.low), _BOXES_AT_ONCE):
            chosen = slice(begin, begin + _BOXES_AT_ONCE)
            some = Boxes(boxes.low[chosen], boxes.high[chosen])
            parts.append(self._proved_at_once(rows, some))
        return np.concatenate(parts)

    def _proved_at_once(self, rows: _Rows, boxes: Boxes) -> Flags:
        """By the mean value theorem: a row at the centre less its largest slopes times half widths.

        A row is a limit's sum of monomials minus the longest `t2` to the power of its order.
        """
        at_centre = self._excess(rows, boxes.centre)
        # A row that is negative at every centre proves none of these boxes.
        useful = (at_centre > 0).any(axis=0)
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
            share_low, share_high = self._share_of_total(boxes, side)
            smallest = np.arange(4) * threshold_low * share_low[:, None]
            largest = np.arange(4) * threshold_high * share_high[:, None]
            rise = slope + error - smallest[:, orders]
            fall = error - slope + largest[:, orders]
            steepest = np.maximum(rise, fall)
            least -= steepest * half_width[:, side, None]
        rounded = monomials_high @ sizes + threshold_high[:, orders]
        return np.asarray((least > _ROUNDING_RTOL * rounded).any(axis=1))

    def _share_of_total(self, boxes: Boxes, side: int) -> tuple[Array, Array]:
        """The least and the largest share of an outer segment in the total time, `(boxes,)`."""
        other = 1 - side
        longest = self._shares(boxes.low)
        briefest = self._shares(boxes.high)
        low = briefest[:, side] / (1 + briefest[:, side] + longest[:, other])
        high = longest[:, side] / (1 + longest[:, side] + briefest[:, other])
        return low, high


def proved_bound(problem: Problem, proof: RatioProof) -> float:
    """The lower bound that a proof proves on all 3-5-3 splines of a problem with four waypoints, s.

    Raises:
        InvalidInput: The proof proves nothing of this problem.
    """
    cutoff = proof.cutoff
    instants = proof.instants
    usable = cutoff.shape == (1,) and bool(np.isfinite(cutoff).all() and (cutoff > 0).all())
    usable = usable and bool(((instants >= 0) & (instants <= 1)).all())
    leaves = proof.leaves
    bytes_only = (leaves >= 0) & (leaves <= 255) & (leaves == np.floor(leaves))
    if not usable or not bytes_only.all() or len(instants) > 2 * _MAX_INSTANTS:
        raise InvalidInput("proof", "a cut-off, instants from 0 to 1, and leaves")
    try:
        with np.errstate(over="raise", under="raise", invalid="raise", divide="raise"):
            holds = Ratios(MovingSpline(problem), float(cutoff[0])).check(proof)
    except FloatingPointError as error:
        raise InvalidInput("proof", "numbers within the range of arithmetic") from error
    if not holds:
        raise InvalidInput("proof", "boxes that cover all ratios, each of them proved")
    return float(cutoff[0])


def start_instants(spline: MovingSpline, times: Array) -> Array:
    """Evenly spread normalised instants, and those where limits can be worst at segment times."""
    even = np.linspace(0, 1, _START_INSTANTS)
    return np.unique(np.concatenate([even, critical_instants(spline, times)]))


def critical_instants(spline: MovingSpline, times: Array) -> Array:
    """The normalised instants of the quintic where a limit can be worst, `(instants,)`."""
    rates = spline.rates(times)
    if spline.room is not None:
        rates.append(spline.position(times))
    points = [polynomials.critical_points(rate).ravel() for rate in rates]
    return np.clip(np.concatenate(points), 0.0, 1.0)


def segment_times(spline: MovingSpline, total: float) -> tuple[Array, Array]:
    """Least and most time of each segment where the total is at most so long, `(3,)` each, s.

    Without displacement an outer segment may take no time at all.
    """
    d = np.abs(spline.displacements)
    v = _wider(spline.limits.velocity)
    a = _wider(spline.limits.acceleration)
    j = _wider(spline.limits.jerk)

    # 3 |d|/t ≤ V, 6 |d|/t² ≤ A, 6 |d|/t³ ≤ J
    by_velocity = 3 * d / v
    by_acceleration = np.sqrt(6 * d / a)
    by_jerk = np.cbrt(6 * d / j)
    outer = np.maximum(np.maximum(by_velocity, by_acceleration), by_jerk)

    # A joint that is back where it was stops on the way, from the ends' speeds 3 d1/t1 and 3 d3/t3.
    h = d[:, 1:2]
    braking = 3 * d[:, ::2] / (total * a)
    stop = np.where(h == 0, braking, 0)
    cruising = h / v
    first, _, last = outer.max(axis=0)
    low = np.array([first, max(cruising.max(), stop.max()), last])
    others = low.sum() - low
    return low, np.maximum(total - others, low)


def _wider(limits: Array) -> Array:
    """The larger of both sides' sizes, `(joints, 1)`."""
    return np.asarray(np.abs(limits).max(axis=1)[:, None])


def _monomials(points: Array) -> Array:
    """`(points, 7)`."""
    return np.asarray(np.exp(points @ _EXPONENTS.T))


def _padded(table: Array) -> Array:
    """Coefficients of the first five monomials as rows of all seven."""
    rows = table.reshape(-1, 5)
    return np.pad(rows, ((0, 0), (0, 2)))


def _cubes(displacements: Array, limits: Array) -> Array:
    """Rows of the jerk of both cubics: `6 d1 r1³` and `6 d3 r3³`, over the limit."""
    rows = np.zeros((2 * len(limits), 7))
    rows[: len(limits), 5] = 6 * displacements[:, 0] / limits
    rows[len(limits) :, 6] = 6 * displacements[:, 2] / limits
    return rows
