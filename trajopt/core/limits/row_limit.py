"""A limit that is judged by its rows: whoever states the inequalities has the judge, too."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Indices
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.limits.enclosures import Enclosure, made
from trajopt.core.limits.fields import FieldsLimit
from trajopt.core.limits.limit import Interval, Use
from trajopt.core.limits.rows import JointState, Row
from trajopt.core.trajectory import Trajectory

WORST_RTOL = 1e-8
"""The worst use is this much too large, at most."""

_WITHIN = 2 * WORST_RTOL
_LEAST = 0.5  # uses below it are not told apart while a dilation is searched
_MAX_BOXES = 1 << 18
_TOGETHER = 256  # intervals that NumPy bounds in about the time of one
_MAX_PARTS = 8
_SAMPLES = 64  # of each piece, in which an interval of a high use is looked for
_HALVINGS = 50  # until its ends are known to rounding
_MAX_DILATION = 2.0**20
_MAX_CUTS = 50  # each is a Newton step; three or four are enough
_MOST_CUTS = 4096  # instants of a motion at the beginning, or one of each piece
_SHARES = np.array([1.0, 0.75, 0.5, 0.25, 0.6])  # of `1/k`: four for a cubic, and one to check it
_POLYNOMIAL_RTOL = 1e-9


@dataclass(frozen=True, eq=False)
class RowLimit(FieldsLimit):
    """A limit whose rows are all `low ≤ value ≤ high`, with 0 inside.

    The use of a row is its value over its bound, or the root of it (`power`). The worst use is
    found by bounds of the rows over intervals of time, which are halved where the worst one may be
    (docs/mathematics.md, section 9).

    Attributes:
        degree: dilating by `k` divides the use by `k ** degree`. None: they change in another
            way, for example because gravity takes part, and the dilation is searched.
    """

    degree: ClassVar[int | None] = None

    def worst(self, motion: Trajectory) -> Use:
        """Return the worst use, at most `WORST_RTOL` too large.

        Rounding of the formula itself is not counted, about 1e-15 of its largest term.
        """
        found = self._worst(motion)
        uses = self.uses(motion, np.array([found.time]))
        joint = max(uses, key=lambda own: float(uses[own][0]), default=None)
        return found._replace(value=float(self._root(found.value)), joint=joint)

    def _worst(self, motion: Trajectory, least: float = 0.0) -> Use:
        """Return the worst use, to its `power`; `least` where it is less."""
        motion = motion.refined(motion.waypoint_times)  # rows may depend on the segment
        pieces = np.arange(len(motion.lengths))
        starts, size = np.zeros(len(pieces)), 1.0
        best, at = least, 0.0
        while True:
            middle, highest = self._bounds(motion, pieces, starts + size / 2, size / 2)
            if not np.isfinite(middle).all():
                k = int(np.argmin(np.isfinite(middle)))
                return Use(np.nan, None, float(motion.breaks[pieces[k]]))
            k = int(middle.argmax())
            if middle[k] > best:
                best = float(middle[k])
                at = motion.breaks[pieces[k]] + (starts[k] + size / 2) * motion.lengths[pieces[k]]
            enough = best * (1 + WORST_RTOL)
            left = highest > max(enough, WORST_RTOL)
            if not left.any():
                return Use(enough, None, float(at))
            if 2 * left.sum() > _MAX_BOXES:
                return Use(float(highest.max()), None, float(at))
            # a few intervals cost as much as one: then each is cut in more than two
            parts = 2
            while parts < _MAX_PARTS and 2 * parts * left.sum() <= _TOGETHER:
                parts *= 2
            size /= parts
            pieces = np.repeat(pieces[left], parts)
            starts = np.ravel(starts[left, None] + size * np.arange(parts))

    def _bounds(
        self, motion: Trajectory, pieces: Indices, middles: Array, half: float
    ) -> tuple[Array, Array]:
        """Return the use in the middle of intervals, and what it is at most within each."""
        orders = []
        for order in range(4):
            unit = _at(motion.pieces(order)[:, pieces], middles[:, None], half)
            orders.append([Enclosure.of_polynomial(unit[..., k]) for k in range(motion.joints)])
        q, v, a, j = orders
        segments = motion.segments_at(motion.breaks[pieces] + middles * motion.lengths[pieces])
        uses, bounds = [np.full(len(pieces), -np.inf)], [np.full(len(pieces), -np.inf)]
        for row in self._rows(JointState(q, v, a, j, segments)):
            value = made(row.value)
            low, high = value.values
            uses.append(np.maximum(value.middle / row.high, value.middle / row.low))
            bounds.append(np.maximum(high / row.high, low / row.low))
        return np.maximum.reduce(uses), np.maximum.reduce(bounds)

    def _rows(self, at: JointState) -> list[Row]:
        """Return the rows, or raise `TrajoptError` for a kind whose code raises."""
        try:
            rows = list(self.rows(at))
        except Exception as error:
            told = f"{type(error).__name__}: {error}"
            raise TrajoptError(f"the rows of {self.key} limits raise {told}") from error
        for row in rows:
            if not (np.all(np.less(row.low, 0)) and np.all(np.greater(row.high, 0))):
                bounds = f"[{row.low}, {row.high}]"
                right = "rows with a negative low and a positive high, or a `worst` of its own"
                raise InvalidInput(f"limits.{self.key}", right, value=bounds)
        return rows

    def uses(self, motion: Trajectory, times: Array) -> dict[int | None, Array]:
        """Return the use at times, s, by the joint whose it is."""
        q, v, a, j = (list(motion(times, order).T) for order in range(4))
        found: dict[int | None, Array] = {}
        for row in self._rows(JointState(q, v, a, j, motion.segments_at(times))):
            own = np.maximum(row.value / row.high, row.value / row.low)
            own = np.broadcast_to(own, times.shape)
            found[row.joint] = np.maximum(own, found.get(row.joint, own))
        return {joint: np.asarray(self._root(own)) for joint, own in found.items()}

    def _root(self, value: Any) -> Any:
        return value if self.power == 1 else np.maximum(value, 0.0) ** (1 / self.power)

    def dilation(self, use: Use, motion: Trajectory) -> float:
        """Return the least dilation that brings a motion within the limit, infinite if none does.

        Of a motion that keeps the limit it is the least from which on it keeps it.

        A dilation by `k` changes a state `(q, v, a, j)` to `(q, v/k, a/k², j/k³)`. At an instant a
        row is mostly a cubic polynomial of `1/k`, whose roots say which dilations it excludes,
        whatever the other instants do. They are excluded at samples, then at the worst instant that
        is left, until there is none. Other rows are asked at dilations in turn: if they hold at
        rest and after a dilation, they must hold after a larger one.
        """
        if self.degree is not None:
            return super().dilation(use, motion)
        if not np.isfinite(use.value):
            return np.inf
        samples = int(np.clip(_MOST_CUTS // len(motion.lengths), 1, _SAMPLES))
        shares = np.linspace(0.0, 1.0, samples + 2)[1:-1]
        times = np.ravel(motion.breaks[:-1, None] + shares * motion.lengths[:, None])
        cuts = self._cuts(motion, np.append(times, use.time))
        if cuts is None:
            return self._searched(use, motion)
        too_fast = use.value > 1 + _WITHIN
        excluded = _slowest if too_fast else _fastest
        factor = excluded(cuts, 1.0)
        for _ in range(_MAX_CUTS):
            if not 1 / _MAX_DILATION < factor < _MAX_DILATION:
                return np.inf if too_fast else 0.0
            found = self._worst(motion.dilated(factor), least=_LEAST)
            if found.value <= 1 + _WITHIN:
                return factor
            more = self._cuts(motion, np.array([found.time / factor]))
            assert more is not None
            cuts = np.concatenate([cuts, more], axis=1)
            factor = max(excluded(cuts, factor if too_fast else 1.0), factor * (1 + WORST_RTOL))
        return np.inf if too_fast else 1.0  # as it is, the motion keeps the limit

    def _cuts(self, motion: Trajectory, times: Array) -> Array | None:
        """Return each row at each time as a polynomial of `1/k`, positive where it does not hold.

        Its coefficients, `(4, rows and times)`; None where a row is no such polynomial.
        """
        q, *rates = (motion(times, order).T for order in range(4))
        values = []
        for share in _SHARES:
            v, a, j = (own * share**order for order, own in enumerate(rates, 1))
            state = JointState(list(q), list(v), list(a), list(j), motion.segments_at(times))
            over = [
                np.broadcast_to(row.value / bound - 1, times.shape)
                for row in self._rows(state)
                for bound in (row.low, row.high)
            ]
            values.append(np.ravel(over))
        *used, other = values
        found = np.linalg.solve(np.vander(_SHARES[:4]), np.array(used))
        missed = np.abs(polynomials.evaluate(found, _SHARES[4]) - other)
        sizes = np.maximum(1.0, np.abs(values).max(axis=0))
        return found if (missed <= _POLYNOMIAL_RTOL * sizes).all() else None

    def _searched(self, use: Use, motion: Trajectory) -> float:
        """Return the dilation at which the use crosses 1."""

        def beyond(factor: float) -> float:
            return self._worst(motion.dilated(factor), least=_LEAST).value - 1

        high, above = 1.0, use.value - 1
        while above > _WITHIN:
            high *= 2
            above = beyond(high)
            if high > _MAX_DILATION:
                return np.inf
        low, below = high / 2, beyond(high / 2)
        while below <= _WITHIN:
            low, below, high, above = low / 2, beyond(low / 2), low, below
            if high < 1 / _MAX_DILATION:
                return 0.0
        # the secant of both ends, where an end that stays counts half (Illinois)
        while high - low > WORST_RTOL * high and abs(above) > _WITHIN:
            middle = (low * above - high * below) / (above - below)
            found = beyond(middle)
            if found > _WITHIN:
                low, below, above = middle, found, above / 2
            else:
                high, above, below = middle, found, below / 2
        return float(high)

    def keeps(self, use: Use, rtol: float) -> bool:
        return use.value <= 1 + rtol if self.degree is None else super().keeps(use, rtol)

    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        """Yield where the use is above a share, with exact ends, but none between two samples."""
        if self.segments is not None:
            motion = motion.refined(motion.waypoint_times)
        grid = np.linspace(motion.breaks[:-1], motion.breaks[1:], _SAMPLES)
        times = np.unique(grid)
        for joint, use in self.uses(motion, times).items():
            above = use > share
            changes = np.flatnonzero(above[1:] != above[:-1])
            inside = np.where(above[changes], times[changes], times[changes + 1])
            outside = np.where(above[changes], times[changes + 1], times[changes])
            for _ in range(_HALVINGS if len(changes) else 0):
                middle = (inside + outside) / 2
                more = self.uses(motion, middle)[joint] > share
                inside, outside = np.where(more, middle, inside), np.where(more, outside, middle)
            ends = [*times[:1][above[:1]], *inside, *times[-1:][above[-1:]]]
            for start, end in zip(ends[::2], ends[1::2], strict=True):
                yield Interval(joint, float(start), float(end))

    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        return self.uses(motion, times)


def _slowest(cuts: Array, factor: float) -> float:
    """Return the least dilation from `factor` on that no cut excludes, infinite if there is none.

    Args:
        cuts: Polynomials of `1/k` that are positive where they exclude it, `(4, n)`.
        factor: A dilation.
    """
    share = 1 / factor
    powers = np.arange(len(cuts) - 1, -1, -1.0)[:, None]
    while share > 1 / _MAX_DILATION:
        unit = cuts * share**powers
        excluding = unit[:, unit.sum(axis=0) > WORST_RTOL / 2]
        if not excluding.shape[1]:
            return 1 / share
        roots = np.nan_to_num(polynomials.unit_roots(excluding), nan=0.0)
        share *= float(roots.max(axis=0).min())
    return np.inf


def _fastest(cuts: Array, factor: float) -> float:
    """Return the least dilation such that no cut excludes one from there to `factor`."""
    unit = cuts[::-1] * factor ** np.arange(len(cuts) - 1, -1, -1.0)[:, None]  # times k³
    if (unit.sum(axis=0) > 0).any():  # by rounding
        return factor
    roots = np.nan_to_num(polynomials.unit_roots(unit), nan=0.0)
    return factor * float(roots.max(initial=0.0))


def _at(unit: Array, middles: Array, half: float) -> Array:
    """Return polynomials of `x` from −1 to 1, at the place `middle + half x` of those given."""
    shifted = [*unit]
    count = len(shifted)
    for last in range(count, 1, -1):  # Taylor's coefficients by Horner's rule, lowest power first
        for k in range(1, last):
            shifted[k] = shifted[k] + middles * shifted[k - 1]
    powers = np.arange(count - 1, -1, -1.0).reshape(-1, *[1] * (unit.ndim - 1))
    return np.array(shifted) * half**powers
