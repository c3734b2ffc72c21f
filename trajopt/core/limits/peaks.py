"""The exact peak of a derivative over a whole motion: roots of polynomials, not samples.

A piece's polynomial divided by its limit is its use of the limit. Bernstein coefficients bound the
use, so roots are computed only for pieces whose bound exceeds the worst use so far.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Indices
from trajopt.core.limits.limit import Use
from trajopt.core.trajectory import Trajectory

Measure = Callable[[Array, Array, Array, Array], Array]
"""A measure of values, their rounding, and their lower and upper limits. It is convex in the
values, and largest where they are worst."""

PIECES_PER_CHUNK = 256  # pieces whose roots are computed in one call, the largest bounds first


def ratio(values: Array, rounding: Array, low: Array, high: Array) -> Array:
    """Return the share of the limits that values use; `low < 0 < high`."""
    upwards = (values + rounding) / high
    downwards = (values - rounding) / low
    return np.maximum(upwards, downwards)


def excess(values: Array, rounding: Array, low: Array, high: Array) -> Array:
    """Return how far values are beyond the limits; below 0 inside."""
    above = values + rounding - high
    below = low - values + rounding
    return np.maximum(above, below)


def peak(motion: Trajectory, order: int, limits: Array, measure: Measure) -> Use:
    """Return the largest value of a measure of a derivative, over all pieces and joints.

    The value includes the rounding error of evaluating the polynomials. It is NaN where they
    overflow.

    Args:
        motion: the motion.
        order: of the derivative.
        limits: low and high of each joint, `(joints, 2)`, or of each piece and joint.
        measure: `ratio` or `excess`.
    """
    low, high = limits[..., 0], limits[..., 1]
    unit = motion.pieces(order)
    rounding = polynomials.evaluation_rounding(unit)
    finite = np.isfinite(rounding)
    if not finite.all():
        piece, joint = np.unravel_index(np.argmin(finite), finite.shape)
        return Use(np.nan, int(joint), float(motion.breaks[piece]))
    starts = unit[-1]
    stops = unit.sum(axis=0)
    both = np.stack([starts, stops])
    ends = measure(both, rounding, low, high)
    side, piece, joint = np.unravel_index(np.argmax(ends), ends.shape)
    highest = float(ends.max())
    best = _Peak(highest, int(piece), int(joint), float(side))

    # A piece's measure is at most its bound: others need no roots.
    bounds = measure(polynomials.bernstein(unit), rounding, low, high)
    bounds = bounds.max(axis=0)
    by_bound = np.argsort(-bounds, axis=None)
    for start in range(0, bounds.size, PIECES_PER_CHUNK):
        chunk = by_bound[start : start + PIECES_PER_CHUNK]
        promising = chunk[bounds.ravel()[chunk] > best.value]
        if not len(promising):
            break
        where = np.unravel_index(promising, bounds.shape)
        best = max(best, _peak_among(unit, rounding, where, limits, measure))
    elapsed = best.share * motion.lengths[best.piece]
    time = motion.breaks[best.piece] + elapsed
    return Use(best.value + 0.0, best.joint, float(time))


class _Peak(NamedTuple):
    """A measured value and its place: `share` is the fraction of the piece's time passed there."""

    value: float
    piece: int
    joint: int
    share: float


def _peak_among(
    unit: Array, rounding: Array, where: tuple[Indices, ...], limits: Array, measure: Measure
) -> _Peak:
    """Return the largest measure of some pieces, at their critical points."""
    pieces, joints = where
    candidates = unit[:, pieces, joints]
    points = polynomials.critical_points(candidates)
    values = polynomials.evaluate(candidates[:, None], points)
    own = limits[joints] if limits.ndim == 2 else limits[where]
    low, high = own.T
    measured = measure(values, rounding[pieces, joints], low, high)
    row, i = np.unravel_index(np.argmax(measured), measured.shape)
    return _Peak(
        value=float(measured[row, i]),
        piece=int(pieces[i]),
        joint=int(joints[i]),
        share=float(points[row, i]),
    )
