"""Constraints of velocity limits that fall towards the end of a range: chords of a parabola.

At the distance `w` from the end, a joint keeps the limit where `u² ≤ 2 d w` for some `u ≥ 0` and
`u ≥ v + o`. Over an interval `v` is a polynomial with Bernstein coefficients `b`. The polynomial
`u` with the coefficients `max(0, b + o)` is nowhere below `v + o`. If all Bernstein coefficients of
`u² − 2 d w` are at most 0, the limit holds at every instant. With constant acceleration the inner
coefficient gives `(v₀ + o)(v₁ + o) ≤ 2 d w`, the chord between both ends of the interval. A motion
along the limit is no polynomial of time, so the error falls with the square of the intervals'
lengths.
"""

from __future__ import annotations

from itertools import pairwise
from math import comb
from typing import Any, NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.limits import FallingVelocity
from trajopt.core.problem import Problem
from trajopt.planners.planner import backend

# Width of the rounded corner of `max(0, v + o)`, relative to the offset, and to the largest
# velocity that the limit allows at any position.
_CORNER_OF_OFFSET = 1e-3
_CORNER_OF_TOP = 1e-7


class Falling(NamedTuple):
    """Falling velocity limits of the moving joints, in a grid's units; upper side first.

    Attributes:
        limited: which joints have one, `(joints,)`.
        numbers: offset, deceleration, upper end, lower end, and width of the corner, `(5, joints)`.
        inside: where no motion towards the end is allowed, at waypoints, `(2, waypoints, joints)`.
    """

    limited: tuple[bool, ...]
    numbers: Array
    inside: Bools

    def leaving(self, intervals: int) -> Bools:
        """Return the intervals in which a joint may only move away from the end.

        A segment may begin where the limit allows no motion towards the end. Then these are the
        first half of its intervals, or all of them if it also ends there. In the others the limit
        is imposed. Lengths of intervals are free, so the joint may turn at any time. The shape is
        `(2, intervals, joints)`.

        Args:
            intervals: number of intervals per segment.
        """
        begins = np.repeat(self.inside[:, :-1], intervals, axis=1)
        ends = np.repeat(self.inside[:, 1:], intervals, axis=1)
        first_half = np.arange(begins.shape[1]) % intervals < intervals / 2
        return begins & (ends | first_half[:, None])


def of(problem: Problem, unit: float, scale: Array, origin: Array) -> Falling:
    """Return the limits of joints that all move.

    Args:
        problem: its limits are used.
        unit: unit of time, s.
        scale: unit of length of each joint, rad, `(joints,)`.
        origin: position of each joint that counts as 0, rad, `(joints,)`.
    """
    own = problem.limits.kinds.get(FallingVelocity.key)
    rows = np.full((problem.joints, 4), np.nan)
    if isinstance(own, FallingVelocity):
        rows = own.rows
    limits = FallingVelocity(rows)
    inside = limits.slack(problem.waypoints) < 0
    offset, deceleration, low, high = limits.in_units(unit, scale[:, None]).rows.T
    ends = [high - origin / scale, low - origin / scale]
    top = np.sqrt(2 * deceleration * (high - low))
    corner = np.maximum(_CORNER_OF_OFFSET * offset, _CORNER_OF_TOP * top)
    numbers = np.nan_to_num(np.array([offset, deceleration, *ends, corner]))
    return Falling(tuple(limits.bounds.tolist()), numbers, inside)


def excess(velocity: list[Any], position: list[Any], numbers: list[Any], side: int) -> list[Any]:
    """Return the Bernstein coefficients of `u² − 2 d w` on each interval, but for the last one.

    The last one is the first of the next interval.

    Args:
        velocity: Bernstein coefficients of velocity, CasADi's columns with an entry per interval.
        position: those of position.
        numbers: of one joint, as in `Falling`.
        side: 0 towards the upper end, 1 towards the lower.
    """
    ca = backend("casadi")
    offset, deceleration, *ends, corner = numbers
    sign = -1 if side else 1
    above = []
    for coefficient in velocity:
        value = sign * coefficient + offset
        above.append((value + ca.sqrt(value**2 + corner**2)) / 2)
    degree = 2 * (len(velocity) - 1)
    distance = [sign * (ends[side] - own) for own in position]
    while len(distance) <= degree:
        distance = _elevated(distance)
    squares = _square(above)
    return [
        square - 2 * deceleration * own
        for square, own in zip(squares[:-1], distance[:-1], strict=True)
    ]


def _square(coefficients: list[Any]) -> list[Any]:
    """Return the Bernstein coefficients of a polynomial's square."""
    degree = len(coefficients) - 1
    found = []
    for k in range(2 * degree + 1):
        terms = [
            comb(degree, i) * comb(degree, k - i) * coefficients[i] * coefficients[k - i]
            for i in range(max(0, k - degree), min(degree, k) + 1)
        ]
        found.append(sum(terms) / comb(2 * degree, k))
    return found


def _elevated(coefficients: list[Any]) -> list[Any]:
    """Return the Bernstein coefficients of the same polynomial, of one degree more."""
    degree = len(coefficients)
    inner = [
        (k * before + (degree - k) * after) / degree
        for k, (before, after) in enumerate(pairwise(coefficients), 1)
    ]
    return [coefficients[0], *inner, coefficients[-1]]
