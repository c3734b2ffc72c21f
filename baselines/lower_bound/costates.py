"""The rows of the relaxation: any three functions `p, q, λ` give one (docs/mathematics.md, 5b).

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
    p_end = p0 + widths * (p1 + widths * p2)
    q_end = q0 + widths * q1
    p_size = np.abs(p0) + widths * (np.abs(p1) + widths * np.abs(p2))
    q_size = np.abs(q0) + widths * np.abs(q1)

    # what jerk, acceleration and velocity can add, between the cells' borders
    zero = np.zeros_like(starts)
    jerk = _weighed((p0, p1, p2), widths, relaxation.j[:, joint])
    bending = (p1 + q0, 2 * p2 + q1, zero)
    acceleration = _weighed(bending, widths, relaxation.a[:, joint])
    slack = COEFFICIENT_RTOL * widths * (np.abs(p1) + 2 * widths * np.abs(p2) + q_size)
    acceleration += slack * relaxation.a[:, joint].sum()
    velocity = _weighed((q1 + slope, zero, zero), widths, relaxation.v[:, joint])
    slack = COEFFICIENT_RTOL * widths * (np.abs(q1) + np.abs(slope))
    velocity += slack * relaxation.v[:, joint].sum()

    # and at the borders, where the costates jump; the end's own rounding is a jump too
    p_jumps = _jumps(p0, p_end, p_size, relaxation.a[:, joint])
    q_jumps = _jumps(q0, q_end, q_size, relaxation.v[:, joint])
    walls, wall_size = _walls(relaxation, segment, joint, np.diff(slope))

    displacement = slope[-1] * relaxation.h[segment, joint]
    inverse_size = np.abs(displacement) + wall_size
    coefficients = np.zeros(ROW_ENTRIES)
    coefficients[0] = -_up(acceleration.sum() + p_jumps)
    coefficients[1] = displacement - walls - COEFFICIENT_RTOL * inverse_size
    coefficients[2] = -_up(jerk.sum())
    coefficients[3] = -q0[0]
    coefficients[4] = q_end[-1]
    coefficients[5] = -p0[0]
    coefficients[6] = p_end[-1]
    bound = _up(velocity.sum() + q_jumps)
    return coefficients, bound


def integral(quadratic: tuple[Array, Array, Array], widths: Array, down: float, up: float) -> Array:
    """An upper bound of `∫ (up f⁺ + down f⁻)` over each width, tight but for rounding.

    Between the computed roots `f` has one sign, but for what the roots' rounding is worth: the
    depth to which it has the other sign there is known from its ends and its vertex.

    Args:
        quadratic: `f0, f1, f2` of `f0 + f1 s + f2 s²`, `(pieces,)` each.
        widths: `(pieces,)`.
        down, up: Weights of the negative and the positive part.
    """
    f0, f1, f2 = quadratic
    size = np.abs(f0) + widths * (np.abs(f1) + widths * np.abs(f2))
    vertex = _quotient(-f1, 2 * f2)
    inner = np.clip(_roots(quadratic), 0.0, widths)
    inner.sort(axis=0)
    borders = np.vstack([np.zeros_like(f0), inner, widths])
    total = np.zeros_like(f0)
    for start, end in pairwise(borders):
        area = _area(quadratic, end) - _area(quadratic, start)
        sign = np.where(area >= 0, 1.0, -1.0)
        weight = np.where(area >= 0, up, down)
        places = (start, end, np.clip(vertex, start, end))
        depths = [-sign * _value(quadratic, place) for place in places]
        deepest = np.max(depths, axis=0)
        other = np.maximum(deepest, 0.0) + COEFFICIENT_RTOL * size
        total += weight * np.abs(area) + (up + down) * other * (end - start)
    rounding = COEFFICIENT_RTOL * (up + down) * widths * size
    return np.asarray(total + rounding)


def _weighed(quadratic: tuple[Array, Array, Array], widths: Array, limit: Array) -> Array:
    """The same with a limit's sizes downwards and upwards as weights."""
    down, up = limit.tolist()
    return integral(quadratic, widths, down, up)


def _jumps(starts: Array, ends: Array, sizes: Array, limit: Array) -> float:
    """What the jumps between cells can add, and the rounding of all ends, the last one's too."""
    jumps = starts[1:] - ends[:-1]
    down, up = limit.tolist()
    upwards = np.maximum(jumps, 0.0).sum()
    downwards = np.maximum(-jumps, 0.0).sum()
    rounding = COEFFICIENT_RTOL * (up + down) * (sizes.sum() + np.abs(starts).sum())
    return float(up * upwards + down * downwards + rounding)


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


def _roots(quadratic: tuple[Array, Array, Array]) -> Array:
    """Both roots, `(2, pieces)`; anything where there are none."""
    f0, f1, f2 = quadratic
    discriminant = np.maximum(f1 * f1 - 4 * f2 * f0, 0.0)
    sign = np.where(f1 >= 0, 1.0, -1.0)
    larger = -0.5 * (f1 + sign * np.sqrt(discriminant))
    first = _quotient(larger, f2)
    second = _quotient(f0, larger)
    return np.stack([first, second])


def _value(quadratic: tuple[Array, Array, Array], s: Array) -> Array:
    f0, f1, f2 = quadratic
    return np.asarray(f0 + s * (f1 + s * f2))


def _area(quadratic: tuple[Array, Array, Array], s: Array) -> Array:
    f0, f1, f2 = quadratic
    return np.asarray(s * (f0 + s * (f1 / 2 + s * f2 / 3)))
