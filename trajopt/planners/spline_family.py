"""Families of splines by the degrees of their pieces: 3-5-3, 4-3-4, cubic, quintic, septic, others.

All joints share the times `T_k` of the pieces. Piece `k` of degree `p` is given by its Bernstein
coefficients `b_0 … b_p`, its *controls*, relative to the start of its segment. It goes from `b_0`
to `b_p`, and its derivative of order `r` has the controls `p!/(p − r)! Δ^r b / T^r`. So all
conditions of a family are linear in the controls: those of waypoints, of rest, and of continuity.

Positions, velocities and accelerations are continuous; higher derivatives may jump. Pieces of
degrees `p_k` between waypoints then have `Σ (p_k − 3)` degrees of freedom per joint, two less with
zero acceleration at both ends: none in a 3-5-3 or 4-3-4, four in a 5-5-5 (velocity and acceleration
at both inner waypoints). Where that number is negative, as for cubics, and jerk is limited, the
first and the last segment are cut once more, at free positions (Lin, Chang and Luh, IEEE Trans.
Automatic Control 28, 1983).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import comb, perm
from typing import Any, Literal

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput

Ends = Literal["rest", "standstill"]
Controls = Sequence[Any] | Array  # of one piece: numbers, arrays over joints, or symbols

_LOWEST_DEGREE = 3
_HIGHEST_DEGREE = 9
# Rounding of a position, relative to the joint's span.
POSITION_RTOL = 1e-12
# Derivatives that are continuous where pieces join.
SMOOTH_ORDERS = (1, 2)
# Largest ratio of the weights of two pieces in the smoothness objective.
_MOST_WEIGHT = 1e4


@dataclass(frozen=True)
class SplineFamily:
    """Splines of one shape, at any times.

    Attributes:
        degrees: of each piece.
        segments: index of each piece's segment.
        still_orders: highest derivative that is zero at both ends: 1 (velocity) or 2.
    """

    degrees: tuple[int, ...]
    segments: tuple[int, ...]
    still_orders: int

    @property
    def pieces(self) -> int:
        return len(self.degrees)

    @property
    def degree(self) -> int:
        """Return the highest degree of a piece."""
        return max(self.degrees)

    @cached_property
    def parts(self) -> Indices:
        """Return the number of pieces of each segment, `(segments,)`."""
        return np.bincount(self.segments)

    @cached_property
    def lengths(self) -> list[int]:
        """Return the number of controls of each piece."""
        return [degree + 1 for degree in self.degrees]

    @property
    def joins_count(self) -> int:
        """Return the number of differences that `joins` returns."""
        knots = self.pieces - 1
        free_positions = int((self.parts - 1).sum())
        return knots * len(SMOOTH_ORDERS) + free_positions

    def fixed(self, displacements: Array) -> tuple[Bools, Array]:
        """Return which controls are determined by the waypoints and rest at both ends.

        Args:
            displacements: of the segments, `(segments, joints)`.

        Returns:
            For the controls of all pieces, one after another: whether each is determined,
            `(controls,)`, and its position relative to the segment's start, `(controls, joints)`,
            NaN for the others.
        """
        count = sum(self.lengths)
        joints = displacements.shape[1]
        values = np.full((count, joints), np.nan)
        firsts = np.cumsum([0, *self.lengths])
        for piece, segment in enumerate(self.segments):
            earlier = self.segments[:piece]
            later = self.segments[piece + 1 :]
            if segment not in earlier:
                values[firsts[piece]] = 0.0
            if segment not in later:
                last = firsts[piece + 1] - 1
                values[last] = displacements[segment]
        # a derivative vanishes at an end where one more control equals the last
        still = 1 + self.still_orders
        values[:still] = 0.0
        values[-still:] = displacements[-1]
        which = np.isfinite(values[:, 0])
        return which, values

    def joins(self, controls: Sequence[Controls], times: Controls) -> list[Any]:
        """Return the differences that are zero where pieces join, for numbers or symbols.

        Args:
            controls: of each piece.
            times: of each piece.

        Returns:
            Differences of position (only where no waypoint determines it), of velocity, and of
            acceleration times `T_k T_{k+1} / (T_k + T_{k+1})`. The latter has the unit of a
            velocity and the same size for short pieces.
        """
        rows = []
        for k in range(self.pieces - 1):
            before = controls[k]
            after = controls[k + 1]
            time_before = times[k]
            time_after = times[k + 1]
            both = time_before + time_after
            if self.segments[k] == self.segments[k + 1]:
                rows.append(before[-1] - after[0])
            for order in SMOOTH_ORDERS:
                *_, end = derivative(before, order)
                start, *_ = derivative(after, order)
                power = order - 1
                earlier = (time_after / both) ** power / time_before
                later = (time_before / both) ** power / time_after
                rows.append(end * earlier - start * later)
        return rows

    def smoothest(self, displacements: Array, times: Array) -> Array:
        """Return the controls `(…, controls, joints)` of a smooth spline at times `(…, pieces)`.

        It is the spline of the family through the waypoints with the least sum of squared third
        differences over `T^5`, approximately the integral of squared jerk.
        """
        is_fixed, values = self.fixed(displacements)
        free = ~is_fixed
        held = values[is_fixed]
        joins, bends = self._matrices(times)
        turned = np.swapaxes(bends, -1, -2)
        squares = turned[..., free, :] @ bends
        own_joins = joins[..., free]

        # H u + Aᵀ m = −H_f x_f with multipliers m
        across = np.swapaxes(own_joins, -1, -2)
        top = np.concatenate([squares[..., free], across], axis=-1)
        pulling = squares[..., is_fixed]
        top_right = pulling @ held
        # A u = −A_f x_f
        rows = own_joins.shape[-2]
        corner = np.zeros((*own_joins.shape[:-1], rows))
        bottom = np.concatenate([own_joins, corner], axis=-1)
        joining = joins[..., is_fixed]
        bottom_right = joining @ held

        matrix = np.concatenate([top, bottom], axis=-2)
        right = np.concatenate([top_right, bottom_right], axis=-2)
        solution = np.linalg.solve(matrix, -right)
        # the multipliers, which come last, are left out
        count = free.sum()
        batch = times.shape[:-1]
        controls = np.empty((*batch, *values.shape))
        controls[..., is_fixed, :] = held
        controls[..., free, :] = solution[..., :count, :]
        return controls

    def joined(self, controls: Array, times: Array) -> Array:
        """Return the closest controls with which the pieces join up to rounding.

        Args:
            controls: `(controls, joints)`; determined ones already have their positions.
            times: of the pieces; shorter pieces have less weight.
        """
        segments = len(self.parts)
        anywhere = np.zeros((segments, controls.shape[1]))
        is_fixed, _ = self.fixed(anywhere)
        free = ~is_fixed
        joins, _ = self._matrices(times)
        relative = times / times.mean()
        of_controls = np.repeat(relative, self.lengths)
        reach = of_controls[free]
        misses = joins @ controls
        scaled = joins[:, free] * reach
        step, *_ = np.linalg.lstsq(scaled, misses, rcond=None)
        moved = controls.copy()
        moved[free] -= reach[:, None] * step
        return moved

    def _matrices(self, times: Array) -> tuple[Array, Array]:
        """Return the matrices of joins and of weighted third differences, over all controls."""
        count = sum(self.lengths)
        each = np.eye(count)
        controls = self.split(each)
        batch = times.shape[:-1]
        relative = times / times.mean(axis=-1, keepdims=True)
        columns = np.moveaxis(relative, -1, 0)[..., None]

        joins = np.zeros((*batch, self.joins_count, count))
        for i, row in enumerate(self.joins(controls, columns)):
            joins[..., i, :] = row

        bends = []
        weights = np.clip(columns**-2.5, 1 / _MOST_WEIGHT, _MOST_WEIGHT)
        for own, weight in zip(controls, weights, strict=True):
            for bend in derivative(own, 3):
                bends.append(weight * bend)
        return joins, np.stack(bends, axis=-2)

    def split(self, controls: Array) -> list[Array]:
        """Return the controls `(controls, …)` of all pieces, one table per piece."""
        ends = np.cumsum(self.lengths)
        return np.split(controls, ends[:-1])

    def powers(self, controls: Array) -> Array:
        """Return the pieces on `[0, 1]`, `(degree + 1, pieces, …)`, highest power first."""
        trailing = controls.shape[1:]
        shape = (self.degree + 1, self.pieces, *trailing)
        coefficients = np.zeros(shape)
        for k, own in enumerate(self.split(controls)):
            degree = len(own) - 1
            for power in range(degree + 1):
                # C(p, i) Δ^i b_0 multiplies s^i
                first, *_ = np.diff(own, power, axis=0)
                row = -1 - power
                coefficients[row, k] = comb(degree, power) * first
        return coefficients


def derivative(controls: Controls, order: int) -> list[Any]:
    """Controls of a derivative over the unit interval: `p!/(p − r)! Δ^r b`."""
    degree = len(controls) - 1
    differences = list(controls)
    for _ in range(order):
        steps = []
        for i in range(len(differences) - 1):
            step = differences[i + 1] - differences[i]
            steps.append(step)
        differences = steps
    factor = perm(degree, order)
    return [factor * difference for difference in differences]


def family(shape: str, segments: int, ends: Ends, jerk_limited: bool) -> SplineFamily:
    """Return the family of a shape for a number of segments.

    With jerk limits, degrees too low for zero acceleration at the ends get one more knot in the
    first and the last segment. Without jerk limits the best such knot would be infinitely close to
    the end, so these splines have zero velocity only at the ends.

    Args:
        shape: one degree for all segments ("5"), one for each ("4-3-4"), or three of which the
            middle one is repeated ("4-3-4" for 4-3-3-4).
        segments: between waypoints.
        ends: zero velocity ("standstill"), or zero acceleration too ("rest").
        jerk_limited: whether any joint's jerk is limited.

    Raises:
        InvalidInput: the shape has no such degrees, or does not fit so many segments.
    """
    fitted = _fitted(degrees(shape), segments)
    if not fitted:
        right = f"degrees for {segments} segments: one, {segments}, or three of more than three"
        raise InvalidInput("shape", right, value=shape)
    numbers = list(range(segments))
    too_low = sum(fitted) < 3 * segments + 2
    still_orders = 2
    if ends == "standstill" or (too_low and not jerk_limited):
        still_orders = 1
    elif too_low:
        # at both ends one more piece, of the same degree in the same segment
        fitted = [fitted[0], *fitted, fitted[-1]]
        numbers = [0, *numbers, segments - 1]
    return SplineFamily(tuple(fitted), tuple(numbers), still_orders)


def degrees(shape: str) -> list[int]:
    """Return the degrees of a shape; raises `InvalidInput` for other text."""
    allowed = range(_LOWEST_DEGREE, _HIGHEST_DEGREE + 1)
    right = f"degrees from {_LOWEST_DEGREE} to {_HIGHEST_DEGREE}, as in 4-3-4"
    named = []
    for word in shape.split("-"):
        if not word.isdecimal() or int(word) not in allowed:
            raise InvalidInput("shape", right, value=shape)
        named.append(int(word))
    return named


def _fitted(named: list[int], segments: int) -> list[int]:
    """Return one degree per segment; none if the degrees do not fit."""
    if len(named) == segments:
        return named
    if len(named) == 1:
        return named * segments
    if len(named) == 3 and segments > 3:
        first, inner, last = named
        return [first, *[inner] * (segments - 2), last]
    return []


def peaks(unit: Array, times: Array, order: int, bounds: Array) -> tuple[Array, Array]:
    """Return the instant of the largest use of a limit on each piece, and that use.

    Args:
        unit: pieces on the unit interval, `(degree + 1, pieces, joints)`.
        times: of the pieces.
        order: of the derivative that is limited.
        bounds: its limits, `(joints, 2)`.

    Returns:
        Instants on the unit interval and utilisations there, each `(pieces, joints)`.
    """
    rate = polynomials.derivative(unit, order)
    points = _critical(rate)
    used = utilisation(rate[:, None], points, times, order, bounds)
    return _highest(points, used)


def farthest(unit: Array, room: Array) -> tuple[Array, Array]:
    """Return the instant nearest to a position limit on each piece, and the excess there.

    Args:
        unit: As for `peaks`, in spans.
        room: The position limits from the start of each segment, `(pieces, joints, 2)`, in spans.

    Returns:
        Instants on the unit interval, and how far beyond the limit (negative within), each
        `(pieces, joints)`.
    """
    points = _critical(unit)
    beyond = excess(unit[:, None], points, room)
    return _highest(points, beyond)


def excess(unit: Array, points: Array, room: Array) -> Array:
    """Return the excess over the nearer position limit at points, `(points, pieces, joints)`."""
    values = polynomials.evaluate(unit, points)
    above = values - room[..., 1]
    below = room[..., 0] - values
    return np.maximum(above, below)


def _critical(unit: Array) -> Array:
    """Return the possible extrema of each piece and joint, `(points, pieces, joints)`."""
    one_by_one = unit.reshape(len(unit), -1)
    critical = polynomials.critical_points(one_by_one)
    return critical.reshape(-1, *unit.shape[1:])


def _highest(points: Array, values: Array) -> tuple[Array, Array]:
    """Return the point of the highest value, and that value, of each piece and joint."""
    worst = values.argmax(axis=0)[None]
    instants = np.take_along_axis(points, worst, axis=0)
    highest = np.take_along_axis(values, worst, axis=0)
    return instants[0], highest[0]


def utilisation(rate: Array, points: Array, times: Array, order: int, bounds: Array) -> Array:
    """Return a derivative's use of its limit at points, `(points, pieces, joints)`."""
    low, high = bounds.T
    # d^r q/dt^r = d^r q/ds^r / T^r
    scale = times[:, None] ** order
    values = polynomials.evaluate(rate, points) / scale
    return np.maximum(values / high, values / low)
