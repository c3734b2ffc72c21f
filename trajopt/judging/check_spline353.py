"""Check in exact fractions that no 3-5-3 spline takes less time than a cut-off.

It is believed because this file derives every row again, with the numbers, the problem and the
refusals of `check_proof.py` beside it. Both import the standard library only.

Equation numbers are those of docs/mathematics/bounds.md. A box is one of r1 = t2/t1 and r3 = t2/t3.
Its corners are floats, which are exact. Where a box is cut decides nothing: both halves share the
cut, so they cover the box wherever it is.

In reading order: the rows of a problem; the box of all ratios; one box; the walk through all boxes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import inf, nextafter, sqrt
from typing import Any, NamedTuple

from trajopt.judging import check_proof as kernel
from trajopt.judging.check_proof import ExactProblem, NoProof

TABLES = {  # the tables of a proof, and how many columns each has; 0 for a plain list
    "cutoff": 0,
    "rows": 4,  # kind, joint, side, instant
    "steps": 0,  # of each box: 0 or 1, cut across r1 or r3; else 2 and the row that excludes it
}
POSITION, VELOCITY, ACCELERATION, JERK, FIRST_JERK, LAST_JERK = range(6)  # kinds of rows
# A bound without a demand holds with it, but for these.
REFUSED = ("tolerance", "closed", *kernel.END_STATES)
HERMITE = (  # of h, v0, v1, a0, a1 on the unit interval: coefficients of 1, s, s², ..., doubled
    (0, 0, 0, 20, -30, 12),
    (0, 2, 0, -12, 16, -6),
    (0, 0, 0, -8, 14, -6),
    (0, 0, 1, -3, 3, -1),
    (0, 0, 0, 1, -2, 1),
)
# The search bounds a box in logarithms of the ratios: where its bound is closer than this one, a
# box is excluded in parts, each of them halved so often at most.
MORE_HALVES = 8
CUT_FIRST, CUT_LAST, ROWS = range(3)  # kinds of steps; from `ROWS` on, rows
ZERO, ONE = Fraction(0), Fraction(1)

Box = tuple[float, float, float, float]  # from and to, of r1 and of r3
Powers = tuple[Fraction, Fraction, Fraction]  # coefficients of r, r² and r³
NO_POWERS: Powers = (ZERO, ZERO, ZERO)


class SplineRow(NamedTuple):
    """A polynomial in each ratio, which is at most `limit · t2^order`, (7.3).

    Attributes:
        constant: The summand without a ratio.
        powers: Coefficients in r1, and in r3.
        limit: A positive size; 0 for a position.
        order: Of the derivative.
    """

    constant: Fraction
    powers: tuple[Powers, Powers]
    limit: Fraction
    order: int


def rows_of(problem: ExactProblem, table: Sequence[Sequence[Fraction]]) -> list[SplineRow]:
    """Return the rows that a proof uses.

    Raises:
        NoProof: There is no such row, or the problem has no such limit.
    """
    found = []
    for number, joint, end, instant in table:
        kind = kernel.counted("rows, kind", number, LAST_JERK + 1)
        side = kernel.counted("rows, side", end, 2)
        j = kernel.counted("rows, joint", joint, len(problem.joints))
        if not 0 <= instant <= 1:
            raise NoProof("rows, instant", "from 0 to 1", instant)
        found.append(_row(problem, kind, j, side, instant))
    return found


def _row(problem: ExactProblem, kind: int, joint: int, side: int, instant: Fraction) -> SplineRow:
    d1, h, d3 = (step[joint] for step in problem.displacements())
    sign = (-1, 1)[side]
    if kind == FIRST_JERK:
        powers = _times(sign, (ZERO, ZERO, 6 * d1)), NO_POWERS
        return SplineRow(ZERO, powers, _existing(problem.jerk[0][joint][side]), JERK)
    if kind == LAST_JERK:
        powers = NO_POWERS, _times(sign, (ZERO, ZERO, 6 * d3))
        return SplineRow(ZERO, powers, _existing(problem.jerk[2][joint][side]), JERK)
    b = [_derivative(own, kind, instant) for own in HERMITE]
    constant, limit = h * b[0], ZERO
    first, last = (3 * d1 * b[1], 6 * d1 * b[3], ZERO), (3 * d3 * b[2], -6 * d3 * b[4], ZERO)
    if kind == POSITION:
        constant += problem.waypoints[1][joint] - _existing(problem.position[joint][side])
    else:
        limits = (problem.velocity, problem.acceleration, problem.jerk)[kind - VELOCITY]
        limit = _existing(limits[1][joint][side])
    powers = _times(sign, first), _times(sign, last)
    return SplineRow(sign * constant, powers, limit, kind)


def _times(sign: int, powers: Powers) -> Powers:
    return sign * powers[0], sign * powers[1], sign * powers[2]


def _existing(limit: Fraction | None) -> Fraction:
    if limit is None:
        raise NoProof("rows", "a limit that the problem has")
    return limit


def _derivative(doubled: Sequence[int], order: int, s: Fraction) -> Fraction:
    """Return a derivative of half a polynomial at an instant."""
    coefficients = list(doubled)
    for _ in range(order):
        coefficients = [k * c for k, c in enumerate(coefficients)][1:]
    return kernel.total(c * s**k for k, c in enumerate(coefficients)) / 2


# --- all ratios ---


def least_times(problem: ExactProblem) -> list[Fraction]:
    """Return a time that each segment needs at least, s.

    An outer one is a cubic from or to rest: 3 |d|/t ≤ V, 6 |d|/t² ≤ A, 6 |d|/t³ ≤ J.
    """
    found = []
    for k, step in enumerate(problem.displacements()):
        times = []
        for j, d in enumerate(map(abs, step)):
            speed, acceleration = max(problem.velocity[k][j]), max(problem.acceleration[k][j])
            if k == 1:
                times.append(d / speed)
                continue
            times += [3 * d / speed, kernel.root_below(6 * d / acceleration)]
            jerk = [size for size in problem.jerk[k][j] if size is not None]
            if len(jerk) == 2:
                times.append(_cube_root_below(6 * d / max(jerk)))
        found.append(max(times))
    return found


def _cube_root_below(x: Fraction) -> Fraction:
    """Return ∛x, rounded down by some places of floats."""
    root = Fraction(nextafter(float(x) ** (1 / 3), 0.0))
    return root if root**3 <= x else root * (1 - Fraction(1, 2**48))


def all_ratios(least: Sequence[Fraction], cutoff: Fraction) -> Box:
    """Return the box of all ratios of splines that are shorter than a cut-off."""
    most = [cutoff - (sum(least) - own) for own in least]
    first, last = ((least[1] / most[k], most[1] / least[k]) for k in (0, 2))
    return (_below(first[0]), -_below(-first[1]), _below(last[0]), -_below(-last[1]))


def _below(x: Fraction) -> float:
    near = float(x)
    return near if near <= x else nextafter(near, -inf)


# --- one box ---


@dataclass(frozen=True)
class SplineRows:
    """What excludes boxes: rows and the cut-off."""

    rows: list[SplineRow]
    cutoff: Fraction

    def excluded(self, row: SplineRow, box: Box, halves: int = MORE_HALVES) -> bool:
        """Return whether a row is broken everywhere in a box."""
        if self.least(row, box) > 0:
            return True
        if not halves:
            return False
        a1, b1, a3, b3 = box
        parts = halved(box, CUT_LAST if b3 / a3 > b1 / a1 else CUT_FIRST)
        return all(self.excluded(row, part, halves - 1) for part in parts)

    def least(self, row: SplineRow, box: Box) -> Fraction:
        """Return less than the row's excess anywhere in a box, by the mean value theorem.

        The excess is the row's sum minus `limit · (cutoff · s)^order`, where s is the share of the
        middle segment in the total time. s rises with both ratios.
        """
        a1, b1, a3, b3 = map(Fraction, box)
        sides = ((a1, b1), (a3, b3))
        middle = tuple((low + high) / 2 for low, high in sides)
        scale = row.limit * self.cutoff**row.order
        powers = zip(row.powers, middle, strict=True)
        least = row.constant + kernel.total(_value(own, r) for own, r in powers)
        least -= scale * _share(*middle) ** row.order
        # The slope of s^p in a ratio r is p s^(p + 1)/r².
        steep = row.order * scale
        smallest = steep * _share(a1, a3) ** (row.order + 1)
        largest = steep * _share(b1, b3) ** (row.order + 1)
        for own, (low, high) in zip(row.powers, sides, strict=True):
            falls, rises = _slopes(own, low, high)
            steepest = max(rises - smallest / high**2, largest / low**2 - falls)
            least -= steepest * (high - low) / 2
        return least


def _share(r1: Fraction, r3: Fraction) -> Fraction:
    """Return t2/(t1 + t2 + t3)."""
    return r1 * r3 / (r1 * r3 + r1 + r3)


def _value(powers: Powers, r: Fraction) -> Fraction:
    return r * (powers[0] + r * (powers[1] + r * powers[2]))


def _slopes(powers: Powers, low: Fraction, high: Fraction) -> tuple[Fraction, Fraction]:
    """Return the least and the largest slope between two positive ratios, or less and more."""
    least = largest = powers[0]
    for k, c in ((1, 2 * powers[1]), (2, 3 * powers[2])):
        ends = sorted((c * low**k, c * high**k))
        least, largest = least + ends[0], largest + ends[1]
    return least, largest


def halved(box: Box, side: int) -> tuple[Box, Box]:
    """Return both halves of a box, cut across r1 or r3 near the middle of its logarithm."""
    a1, b1, a3, b3 = box
    low, high = (a3, b3) if side else (a1, b1)
    cut = sqrt(low) * sqrt(high)
    if not low < cut < high:
        raise NoProof("steps", "boxes that can be halved")
    if side:
        return (a1, b1, a3, cut), (a1, b1, cut, b3)
    return (a1, cut, a3, b3), (cut, b1, a3, b3)


# --- the proof ---


def proved(said: dict[str, Any], tables: dict[str, Any]) -> Fraction:
    """Return the cut-off, s: no 3-5-3 spline of the problem with shared times takes less.

    Args:
        said: The problem as a file states it, with four waypoints of which no two in a row are one.
        tables: The proof's.

    Raises:
        NoProof: A part is not what it must be, or a box is neither cut nor excluded.
    """
    proof = kernel.whole(tables, TABLES, ())
    demands = [name for name in REFUSED if name in said]
    if demands:
        raise NoProof("a demand", "none that moves a waypoint or an end", ", ".join(demands))
    problem = kernel.stated(said)
    if len(problem.segments) != 3:
        raise NoProof("waypoints", "four", len(problem.waypoints))
    if len(proof["cutoff"]) != 1 or proof["cutoff"][0] <= 0:
        raise NoProof("cutoff", "one time above 0")
    (cutoff,) = proof["cutoff"]
    least = least_times(problem)
    if not all(least):
        raise NoProof("waypoints", "four of which no two in a row are one")
    if sum(least) >= cutoff:
        return cutoff
    search = SplineRows(rows_of(problem, proof["rows"]), cutoff)
    steps = iter(proof["steps"])
    boxes = [all_ratios(least, cutoff)]
    while boxes:
        halves = []
        for box in boxes:
            step = kernel.counted("steps", next(steps, -ONE), ROWS + len(search.rows))
            if step < ROWS:
                halves.append(halved(box, step))
            elif not search.excluded(search.rows[step - ROWS], box):
                raise NoProof("steps", "rows that are broken everywhere in their boxes", step)
        boxes = [low for low, _ in halves] + [high for _, high in halves]
    if next(steps, None) is not None:
        raise NoProof("steps", "none after the last box")
    return cutoff
