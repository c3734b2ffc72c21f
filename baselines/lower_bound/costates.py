"""Inequalities that follow from any three functions `p, q, λ` (docs/mathematics.md, section 7b).

In normalised time `τ`, over one segment and joint, `v' = α`, `α' = u` and `x' = v`, where
`|u| ≤ J Q`, `|α| ≤ A T`, `|v| ≤ V` and `x` runs from 0 to `h S`. Integrating by parts, for
all piecewise polynomials `p, q, λ`,

    [p α] + [q v] + [λ x] = ∫ p u + ∫ α (dp + q dτ) + ∫ v (dq + λ dτ) + ∫ x dλ,

brackets from 0 to 1, jumps included. Bounding the right-hand side by the limits gives

    p₁ α₁ − p₀ α₀ + q₁ v₁ − q₀ v₀ + λ₁ h S
        ≤ Q J ∫|p| + T A ∫|dp + q dτ| + V ∫|dq + λ dτ| + S (x_max ∫dλ⁺ − x_min ∫dλ⁻):

This is linear in the segment's variables, and nothing is discretised. The inequality is tightest
where the functions are the costates of the optimality conditions.

A velocity limit that falls towards the end of a range, at the distance `D` from the segment's
start, is `v + o ≤ sqrt(2 d w)` with `w = D − x T`. So for every `c > 0`

    v + c x ≤ d T / (2 c) + c D S − o.

It is a tangent of the parabola, and its point moves with `T`. Where `λ` rises at the rate `λ'` and
`μ = q' + λ ≥ 0`, the choice `c = λ' / μ` bounds both of their terms together by

    T d ∫μ² / (2 λ') + S D ∫dλ − o ∫μ.
"""

from __future__ import annotations

from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baselines.lower_bound.relaxation import Relaxation
from trajopt.core.arrays import Array, Bools, Indices

# `f0, f1, f2` of `f0 + f1 s + f2 s²`, piece by piece.
Quadratic = tuple[Array, Array, Array]

# Upper bound on the rounding of a few dozen operations, relative to the terms' sizes.
COEFFICIENT_RTOL = 1e-14
# Rounding of a sum for each of its cells, relative to the terms' sizes.
_CELL_RTOL = 2.0**-52

# Columns of a cell: its start, three coefficients of `p` from there, two of `q`, then `λ`; where
# velocity limits fall, also the rate of `λ`.
CELL_COLUMNS = 7
SLOPE, RATE = 6, 7


class Cut(NamedTuple):
    """Costates of one inequality: segment, joint (of those that move), cells `(cells, 7 or 8)`."""

    segment: int
    joint: int
    cells: Array


class Costates(NamedTuple):
    """Costates with equal numbers of cells, each of one segment and joint: `(rows, ...)`."""

    segments: Indices
    joints: Indices
    cells: Array


def with_rates(cells: Array) -> Array:
    """Return cells with the column of rates, which are 0 where there is none."""
    if cells.shape[-1] > CELL_COLUMNS:
        return cells
    return np.concatenate([cells, np.zeros((*cells.shape[:-1], 1))], axis=-1)


def row(relaxation: Relaxation, segment: int, joint: int, cells: Array) -> tuple[Array, float]:
    """Return the inequality of one segment and joint's costates, as `rows` does."""
    one = Costates(segments=np.array([segment]), joints=np.array([joint]), cells=cells[None])
    coefficients, bounds = rows(relaxation, one)
    return coefficients[0], float(bounds[0])


def rows(relaxation: Relaxation, given: Costates) -> tuple[Array, Array]:
    """Return the inequalities that costates give.

    Args:
        relaxation: Its limits are used.
        given: Indices of segments and joints (of those that move), `(rows,)`. Cells
            `(rows, cells, 7 or 8)`: start in normalised time (the first is 0), `p0, p1, p2`,
            `q0, q1`, `λ`, and its rate if any rate is not 0.

    Returns:
        Coefficients of the variables in `Relaxation.row_columns`, `(rows, 7)`, and the bounds,
        rounded so that the inequalities are valid.
    """
    parts = _Parts.of(relaxation, given)
    h = relaxation.h[given.segments, given.joints]
    displacement = parts.slope_end[:, -1] * h
    limits, limit_size = _position_costs(relaxation, given, parts)
    inverse_size = np.abs(displacement) + limit_size
    by_velocity = _by_velocity(parts)
    by_time = _by_acceleration(parts)
    if parts.rate.any():
        fallen = _by_falling(relaxation, given, parts)
        by_velocity = by_velocity + fallen.constant
        by_time = by_time + fallen.time
        limits = limits + fallen.inverse
        inverse_size = inverse_size + fallen.inverse_size
    inverse_rounding = parts.sum_rtol * inverse_size
    p_end = value(parts.p, parts.widths)
    q_end = value(parts.q, parts.widths)
    coefficients = [
        -by_time,
        displacement - limits - inverse_rounding,
        -_by_jerk(parts),
        -parts.q[0][:, 0],
        q_end[:, -1],
        -parts.p[0][:, 0],
        p_end[:, -1],
    ]
    if relaxation.tolerant:
        coefficients += [-parts.slope[:, 0], parts.slope_end[:, -1]]
    return np.stack(coefficients, axis=1), by_velocity


class _Parts(NamedTuple):
    """Costates of rows, `(rows, cells)`, and their limits' sizes, `(2, rows, 1)`.

    `together` is true where a falling velocity limit bounds `q' + λ` and the rate of `λ` together.
    """

    widths: Array
    p: Quadratic
    q: Quadratic
    slope: Array
    slope_end: Array
    rate: Array
    together: Bools
    velocity: Array
    acceleration: Array
    jerk: Array

    @property
    def sum_rtol(self) -> float:
        """Bound on the rounding of a sum over cells, relative to the terms' sizes."""
        _, cells = self.widths.shape
        return COEFFICIENT_RTOL + float(cells) * _CELL_RTOL

    def up(self, values: Array) -> Array:
        """Return sums over cells, rounded upwards."""
        return values * (1 + self.sum_rtol)

    @classmethod
    def of(cls, relaxation: Relaxation, given: Costates) -> _Parts:
        starts, p0, p1, p2, q0, q1, slope, rate = np.moveaxis(with_rates(given.cells), -1, 0)
        ends = np.ones_like(starts)
        ends[:, :-1] = starts[:, 1:]
        # rounding the width of a cell only moves what is integrated by its last digit
        widths = ends - starts
        jerk = relaxation.j[:, given.segments, given.joints, None]
        p0 = _one_sided((p0, p1, p2), widths, jerk)
        acts = relaxation.falling.acts[:, given.segments, given.joints, None]
        turning = q1 + slope
        upwards = (rate > 0) & (turning >= 0) & acts[1]
        downwards = (rate < 0) & (turning <= 0) & acts[0]
        return cls(
            widths=widths,
            p=(p0, p1, p2),
            q=(q0, q1, np.zeros_like(q0)),
            slope=slope,
            slope_end=slope + rate * widths,
            rate=rate,
            together=upwards | downwards,
            velocity=relaxation.v[:, given.segments, given.joints, None],
            acceleration=relaxation.a[:, given.segments, given.joints, None],
            jerk=jerk,
        )


def _by_jerk(parts: _Parts) -> Array:
    """Return the cost of jerk, `J ∫|p|`."""
    limit = np.where(np.isfinite(parts.jerk), parts.jerk, 0.0)
    integrals = _weighed(parts.p, parts.widths, limit)
    return parts.up(integrals.sum(axis=1))


def _by_acceleration(parts: _Parts) -> Array:
    """Return the cost of acceleration, `A ∫|dp + q dτ|`, jumps included."""
    _, p1, p2 = parts.p
    q0, q1, zero = parts.q
    bending = (p1 + q0, 2 * p2 + q1, zero)
    integrals = _weighed(bending, parts.widths, parts.acceleration)
    rate_size = _size((p1, 2 * p2, zero), parts.widths)
    q_size = _size(parts.q, parts.widths)
    terms = parts.widths * (rate_size + q_size)
    integrals += _rounding(terms, parts.acceleration)
    jumps = _jumps(parts.p, parts.widths, parts.acceleration)
    return parts.up(integrals.sum(axis=1) + jumps)


def _by_velocity(parts: _Parts) -> Array:
    """Return the cost of velocity, `V ∫|dq + λ dτ|`, jumps included."""
    _, q1, zero = parts.q
    turning = (q1 + parts.slope, parts.rate, zero)
    integrals = _weighed(turning, parts.widths, parts.velocity)
    integrals[parts.together] = 0.0
    sizes = np.abs(q1) + np.abs(parts.slope) + np.abs(parts.rate) * parts.widths
    terms = parts.widths * sizes
    integrals += _rounding(terms, parts.velocity)
    jumps = _jumps(parts.q, parts.widths, parts.velocity)
    return parts.up(integrals.sum(axis=1) + jumps)


class _ByFalling(NamedTuple):
    """Cost by falling velocity limits: a constant, per `T`, and per `S` with its terms' size.

    Positive parts are rounded upwards, `(rows,)` each.
    """

    constant: Array
    time: Array
    inverse: Array
    inverse_size: Array


def _by_falling(relaxation: Relaxation, given: Costates, parts: _Parts) -> _ByFalling:
    """Return the cost of the cells in which `λ` has a rate.

    Where a falling velocity limit bounds both terms, `μ = |q' + λ|` rises linearly at the size of
    the rate. Elsewhere the rate costs as much as a jump of `λ`, by the farthest position.
    """
    falling = relaxation.falling
    _, q1, _ = parts.q
    rise = np.abs(parts.rate)
    gained = rise * parts.widths
    start = np.where(parts.together, np.abs(q1 + parts.slope), 0.0)
    end = start + gained
    mean = parts.widths * (start + end) / 2
    squares = parts.widths * (start**2 + start * end + end**2) / 3
    place = (given.segments, given.joints)
    upwards = parts.rate > 0

    deceleration = falling.deceleration[given.joints, None]
    time = np.where(parts.together, deceleration * squares / np.where(rise > 0, 2 * rise, 1.0), 0.0)
    offset = falling.offset[given.joints, None] * np.where(parts.together, mean, 0.0)
    down, up = falling.distance[(slice(None), *place)]
    to_end = np.where(upwards, up[:, None], down[:, None])
    farthest = [-relaxation.below[place], relaxation.above[place]]
    to_wall = np.where(upwards, farthest[1][:, None], farthest[0][:, None])
    inverse = gained * np.where(parts.together, to_end, to_wall)
    # the rounding of λ at a cell's end counts as a jump
    sizes = (np.abs(parts.slope) + gained) * (np.abs(farthest[0]) + np.abs(farthest[1]))[:, None]
    sizes = sizes + gained * np.abs(to_end)
    rounding = parts.sum_rtol * offset.sum(axis=1)
    return _ByFalling(
        constant=rounding - offset.sum(axis=1),
        time=parts.up(time.sum(axis=1)),
        inverse=inverse.sum(axis=1),
        inverse_size=sizes.sum(axis=1),
    )


def _one_sided(p: Quadratic, widths: Array, limit: Array) -> Array:
    """Move `p0` until `p` is nowhere of the sign whose side has no jerk limit."""
    p0, p1, p2 = p
    rounding = COEFFICIENT_RTOL * _size(p, widths)
    vertex = _quotient(-p1, 2 * p2)
    inside = np.clip(vertex, 0.0, widths)
    places = [np.zeros_like(p0), inside, widths]
    values = [value(p, place) for place in places]
    least = np.min(values, axis=0) - rounding
    largest = np.max(values, axis=0) + rounding
    free_down, free_up = np.isinf(limit)
    too_low = np.minimum(least, 0.0)
    too_high = np.maximum(largest, 0.0)
    raised = np.where(free_down & ~free_up, -too_low, 0.0)
    lowered = np.where(free_up & ~free_down, too_high, 0.0)
    return p0 + raised - lowered


def value(quadratic: Quadratic, s: Array) -> Array:
    """Return `f0 + f1 s + f2 s²`."""
    f0, f1, f2 = quadratic
    slope = f1 + s * f2
    return f0 + s * slope


def area(quadratic: Quadratic, s: Array) -> Array:
    """Return the integral of the quadratic from 0 to `s`."""
    f0, f1, f2 = quadratic
    halves = (f0, f1 / 2, f2 / 3)
    mean = value(halves, s)
    return s * mean


def integral(quadratic: Quadratic, widths: Array, down: float | Array, up: float | Array) -> Array:
    """Return an upper bound of `∫ (up f⁺ + down f⁻)` over each width, tight but for rounding.

    Between the computed roots `f` has one sign, but for the roots' rounding. Its largest value of
    the other sign is known from its ends and its vertex.

    Args:
        quadratic: `f0, f1, f2` of `f0 + f1 s + f2 s²`, `(..., pieces)` each.
        widths: `(..., pieces)`.
        down, up: Weights of the negative and the positive part.
    """
    f0, f1, f2 = quadratic
    size = _size(quadratic, widths)
    vertex = _quotient(-f1, 2 * f2)
    roots = _roots(quadratic)
    inner = np.clip(roots, 0.0, widths)
    inner.sort(axis=0)
    left = np.zeros_like(f0)
    borders = [left, *inner, widths]
    rounding = COEFFICIENT_RTOL * size
    total = (up + down) * widths * rounding
    for start, end in pairwise(borders):
        gained = area(quadratic, end) - area(quadratic, start)
        positive = gained >= 0
        sign = np.where(positive, 1.0, -1.0)
        weight = np.where(positive, up, down)
        inside = np.clip(vertex, start, end)
        places = (start, inside, end)
        values = [sign * value(quadratic, place) for place in places]
        least = np.min(values, axis=0)
        # the largest value of the other sign
        depth = np.maximum(-least, 0.0) + rounding
        length = end - start
        total += weight * np.abs(gained)
        total += (up + down) * depth * length
    return total


def _size(quadratic: Quadratic, widths: Array) -> Array:
    """Return the sizes of a quadratic's terms at the end of its piece."""
    f0, f1, f2 = quadratic
    sizes = (np.abs(f0), np.abs(f1), np.abs(f2))
    return value(sizes, widths)


def _rounding(terms: Array, limit: Array) -> Array:
    """Bound the rounding of terms of such sizes, multiplied by a limit."""
    weight = COEFFICIENT_RTOL * limit.sum(axis=0)
    return weight * terms


def _weighed(quadratic: Quadratic, widths: Array, limit: Array) -> Array:
    """Call `integral` with a limit's sizes downwards and upwards as weights."""
    down, up = limit
    return integral(quadratic, widths, down, up)


def _jumps(quadratic: Quadratic, widths: Array, limit: Array) -> Array:
    """Return the cost of the jumps between cells, and the rounding of all ends."""
    starts = quadratic[0]
    ends = value(quadratic, widths)
    jumps = starts[:, 1:] - ends[:, :-1]
    down, up = limit[..., 0]
    upwards = np.maximum(jumps, 0.0).sum(axis=1)
    downwards = np.maximum(-jumps, 0.0).sum(axis=1)
    terms = _size(quadratic, widths) + np.abs(starts)
    rounding = _rounding(terms, limit).sum(axis=1)
    return up * upwards + down * downwards + rounding


def _position_costs(relaxation: Relaxation, given: Costates, parts: _Parts) -> tuple[Array, Array]:
    """Return the cost of position limits, per `S`, and the sizes of its terms."""
    jumps = parts.slope[:, 1:] - parts.slope_end[:, :-1]
    upwards = np.maximum(jumps, 0.0).sum(axis=1)
    downwards = np.maximum(-jumps, 0.0).sum(axis=1)
    distance_above = relaxation.above[given.segments, given.joints]
    distance_below = relaxation.below[given.segments, given.joints]
    # a position limit that is not active may be infinite
    distance_above = np.where(upwards > 0, distance_above, 0.0)
    distance_below = np.where(downwards > 0, distance_below, 0.0)
    above = upwards * distance_above
    below = downwards * distance_below
    total = above - below
    size = np.abs(above) + np.abs(below)
    return total, size


def _quotient(a: Array, b: Array) -> Array:
    """Return `a / b`, and 0 where it is not finite; validity does not depend on it."""
    with np.errstate(all="ignore"):
        quotient = a / b
    return np.where(np.isfinite(quotient), quotient, 0.0)


def _roots(quadratic: Quadratic) -> Array:
    """Return approximate roots, `(2, pieces)`; validity does not depend on them."""
    f0, f1, f2 = quadratic
    with np.errstate(under="ignore"):
        square = f1 * f1 - 4 * f2 * f0
    discriminant = np.maximum(square, 0.0)
    sign = np.where(f1 >= 0, 1.0, -1.0)
    both = f1 + sign * np.sqrt(discriminant)
    larger = -0.5 * both
    first = _quotient(larger, f2)
    second = _quotient(f0, larger)
    return np.stack([first, second])
