"""Rows that any three functions `p, q, λ` give (docs/mathematics.md, section 5b).

In normalised time `τ`, over one segment and joint, `v' = α`, `α' = u` and `x' = v`, where
`|u| ≤ J Q`, `|α| ≤ A T`, `|v| ≤ V` and `x` runs from 0 to `h S`. Integrating by parts, for
all piecewise polynomials `p, q, λ`,

    [p α] + [q v] + [λ x] = ∫ p u + ∫ α (dp + q dτ) + ∫ v (dq + λ dτ) + ∫ x dλ,

brackets from 0 to 1, jumps included. Bounding the right-hand side by the limits gives

    p₁ α₁ − p₀ α₀ + q₁ v₁ − q₀ v₀ + λ₁ h S
        ≤ Q J ∫|p| + T A ∫|dp + q dτ| + V ∫|dq + λ dτ| + S (x_max ∫dλ⁺ − x_min ∫dλ⁻):

linear in the segment's variables, and nothing is discretised. The functions are the optimality
conditions' costates where the row is as tight as it can be.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound.relaxation import ROW_ENTRIES, Relaxation

Array = NDArray[np.float64]
# `f0, f1, f2` of `f0 + f1 s + f2 s²`, piece by piece.
Quadratic = tuple[Array, Array, Array]

# A generous bound on what the roundings of a few dozen operations add up to, of the terms' sizes.
COEFFICIENT_RTOL = 1e-14

# A cell: its start, `p` as a quadratic from there, `q` as a line, `λ` constant.
CELL_COLUMNS = 7


def row(relaxation: Relaxation, segment: int, joint: int, cells: Array) -> tuple[Array, float]:
    """The inequality that costates give.

    Args:
        relaxation: Whose limits count.
        segment: Counted from 0.
        joint: Among those that move, counted from 0.
        cells: `(cells, 7)`: start in normalised time (the first 0), `p0, p1, p2`, `q0, q1`, `λ`.

    Returns:
        Coefficients of the variables in `Relaxation.row_columns`, and the bound; rounded so that
        the row is valid.
    """
    starts = cells[:, 0]
    p0, p1, p2, q0, q1, slope = cells[:, 1:].T
    ends = np.append(starts[1:], 1.0)
    # rounding the width of a cell only moves what is integrated by its last digit
    widths = ends - starts
    p = (p0, p1, p2)
    zero = np.zeros_like(starts)
    q = (q0, q1, zero)
    v = relaxation.v[:, joint]
    a = relaxation.a[:, joint]
    j = relaxation.j[:, joint]

    # what jerk, acceleration and velocity can add, between the cells' borders
    jerk = _weighed(p, widths, j)
    bending = (p1 + q0, 2 * p2 + q1, zero)
    acceleration = _weighed(bending, widths, a)
    p_rate_size = _size((p1, 2 * p2, zero), widths)
    terms = p_rate_size + _size(q, widths)
    acceleration += _rounding(widths * terms, a)
    turning = (q1 + slope, zero, zero)
    velocity = _weighed(turning, widths, v)
    terms = np.abs(q1) + np.abs(slope)
    velocity += _rounding(widths * terms, v)

    # and at the borders, where the costates jump; the end's own rounding is a jump too
    p_end = _value(p, widths)
    q_end = _value(q, widths)
    p_jumps = _jumps(p0, p_end, _size(p, widths), a)
    q_jumps = _jumps(q0, q_end, _size(q, widths), v)
    slope_jumps = np.diff(slope)
    walls, wall_size = _walls(relaxation, segment, joint, slope_jumps)

    displacement = slope[-1] * relaxation.h[segment, joint]
    inverse_size = np.abs(displacement) + wall_size
    inverse_rounding = COEFFICIENT_RTOL * inverse_size
    coefficients = np.zeros(ROW_ENTRIES)
    coefficients[0] = -_up(acceleration.sum() + p_jumps)
    coefficients[1] = displacement - walls - inverse_rounding
    coefficients[2] = -_up(jerk.sum())
    coefficients[3] = -q0[0]
    coefficients[4] = q_end[-1]
    coefficients[5] = -p0[0]
    coefficients[6] = p_end[-1]
    bound = _up(velocity.sum() + q_jumps)
    return coefficients, bound


def integral(quadratic: Quadratic, widths: Array, down: float, up: float) -> Array:
    """An upper bound of `∫ (up f⁺ + down f⁻)` over each width, tight but for rounding.

    Between the computed roots `f` has one sign, but for what the roots' rounding is worth: the
    depth to which it has the other sign there is known from its ends and its vertex.

    Args:
        quadratic: `f0, f1, f2` of `f0 + f1 s + f2 s²`, `(pieces,)` each.
        widths: `(pieces,)`.
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
        area = _area(quadratic, end) - _area(quadratic, start)
        positive = area >= 0
        sign = np.where(positive, 1.0, -1.0)
        weight = np.where(positive, up, down)
        inside = np.clip(vertex, start, end)
        least = sign * _value(quadratic, inside)
        for place in (start, end):
            value = sign * _value(quadratic, place)
            least = np.minimum(least, value)
        # the depth of the other sign
        depth = np.maximum(-least, 0.0) + rounding
        length = end - start
        total += weight * np.abs(area)
        total += (up + down) * depth * length
    return np.asarray(total)


def _size(quadratic: Quadratic, widths: Array) -> Array:
    """The sizes of a quadratic's terms at the end of its piece."""
    f0, f1, f2 = quadratic
    sizes = (np.abs(f0), np.abs(f1), np.abs(f2))
    return _value(sizes, widths)


def _rounding(terms: Array, limit: Array) -> Array:
    """What terms of such sizes can round by, under a limit."""
    weight = COEFFICIENT_RTOL * limit.sum()
    return np.asarray(weight * terms)


def _weighed(quadratic: Quadratic, widths: Array, limit: Array) -> Array:
    """The same with a limit's sizes downwards and upwards as weights."""
    down, up = limit.tolist()
    return integral(quadratic, widths, down, up)


def _jumps(starts: Array, ends: Array, sizes: Array, limit: Array) -> float:
    """What the jumps between cells can add, and the rounding of all ends, the last one's too."""
    jumps = starts[1:] - ends[:-1]
    down, up = limit.tolist()
    upwards = np.maximum(jumps, 0.0).sum()
    downwards = np.maximum(-jumps, 0.0).sum()
    terms = sizes + np.abs(starts)
    rounding = _rounding(terms, limit).sum()
    total = up * upwards + down * downwards
    return float(total + rounding)


def _walls(
    relaxation: Relaxation,
    segment: int,
    joint: int,
    jumps: Array,
) -> tuple[float, float]:
    """What position limits can add, per `S`, and the sizes of its terms."""
    upwards = np.maximum(jumps, 0.0).sum()
    downwards = np.maximum(-jumps, 0.0).sum()
    total = 0.0
    size = 0.0
    if upwards > 0:
        above = upwards * relaxation.above[segment, joint]
        total += above
        size += abs(above)
    if downwards > 0:
        below = downwards * relaxation.below[segment, joint]
        total -= below
        size += abs(below)
    return float(total), float(size)


def _up(value: float) -> float:
    return float(value * (1 + COEFFICIENT_RTOL))


def _quotient(a: Array, b: Array) -> Array:
    """`a / b`, and 0 where that is no number."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        quotient = a / b
    return np.where(np.isfinite(quotient), quotient, 0.0)


def _roots(quadratic: Quadratic) -> Array:
    """Both roots, `(2, pieces)`; anything where there are none."""
    f0, f1, f2 = quadratic
    square = f1 * f1 - 4 * f2 * f0
    discriminant = np.maximum(square, 0.0)
    sign = np.where(f1 >= 0, 1.0, -1.0)
    both = f1 + sign * np.sqrt(discriminant)
    larger = -0.5 * both
    first = _quotient(larger, f2)
    second = _quotient(f0, larger)
    return np.stack([first, second])


def _value(quadratic: Quadratic, s: Array) -> Array:
    f0, f1, f2 = quadratic
    slope = f1 + s * f2
    return np.asarray(f0 + s * slope)


def _area(quadratic: Quadratic, s: Array) -> Array:
    f0, f1, f2 = quadratic
    halves = (f0, f1 / 2, f2 / 3)
    mean = _value(halves, s)
    return np.asarray(s * mean)
