"""The exact peak of a derivative over a whole motion: roots of polynomials, not samples.

A piece's polynomial divided by its limit is its use of the limit. Bernstein coefficients bound the
use, so roots are computed only for pieces whose bound exceeds the worst use so far.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    best: Peak | None = None
    blocks = list(motion.blocks())
    for some in blocks:
        unit = motion.pieces(order, some)
        rounding = polynomials.evaluation_rounding(unit)
        finite = np.isfinite(rounding)
        if not finite.all():
            piece, joint = np.unravel_index(np.argmin(finite), finite.shape)
            return Use(np.nan, int(joint), float(motion.breaks[some][piece]))
        both = np.stack([unit[-1], unit.sum(axis=0)])
        ends = measure(both, rounding, *_sides(limits, some))
        side, piece, joint = np.unravel_index(np.argmax(ends), ends.shape)
        own = Peak(float(ends.max()), some.start + int(piece), int(joint), float(side))
        if best is None or own.value > best.value:
            best = own
    assert best is not None

    # A piece's measure is at most its bound: others need no roots.
    promising = []
    for some in blocks:
        if len(blocks) > 1:
            unit = motion.pieces(order, some)
            rounding = polynomials.evaluation_rounding(unit)
        bounds = measure(polynomials.bernstein(unit), rounding, *_sides(limits, some)).max(axis=0)
        which = np.nonzero(bounds > best.value)
        pieces, joints = which
        units = unit[:, pieces, joints]
        promising.append((bounds[which], some.start + pieces, joints, units, rounding[which]))
    bound, pieces, joints, units, roundings = promising[0]
    if len(promising) > 1:
        bound, pieces, joints, units, roundings = (
            np.concatenate(own, axis=-1) for own in zip(*promising, strict=True)
        )
    by_bound = np.argsort(-bound)
    for start in range(0, len(by_bound), PIECES_PER_CHUNK):
        chunk = by_bound[start : start + PIECES_PER_CHUNK]
        chunk = chunk[bound[chunk] > best.value]
        if not len(chunk):
            break
        where = pieces[chunk], joints[chunk]
        best = max(best, _peak_among(units[:, chunk], roundings[chunk], where, limits, measure))
    return use(best, motion)


def peaks(
    units: Array, limits: Array, measure: Measure, motions: Sequence[slice]
) -> list[Peak | None]:
    """Return the peak of a derivative of each of several motions, as `peak` finds it.

    Args:
        units: Pieces of all motions on the unit interval, `(degree + 1, pieces, joints)`.
        limits: Low and high of each piece and joint, `(pieces, joints, 2)`.
        measure: `ratio` or `excess`.
        motions: Which pieces are a motion's; those of the peaks are counted from its first.

    Returns:
        A peak each; None where polynomials overflow, or too many pieces may have it.
    """
    rounding = polynomials.evaluation_rounding(units)
    finite = np.isfinite(rounding)
    low, high = limits[..., 0], limits[..., 1]
    ends = measure(np.stack([units[-1], units.sum(axis=0)]), rounding, low, high)
    # a matrix of another width may be multiplied in another order
    controls = np.concatenate([polynomials.bernstein(units[:, own]) for own in motions], axis=1)
    bounds = measure(controls, rounding, low, high).max(axis=0)
    best: list[Peak | None] = []
    least = np.empty(len(units[0]))
    for own in motions:
        values = ends[:, own]
        side, piece, joint = np.unravel_index(np.argmax(values), values.shape)
        top = Peak(float(values[side, piece, joint]), int(piece), int(joint), float(side))
        best.append(top if finite[own].all() else None)
        least[own] = top.value
    which = np.nonzero(bounds > least[:, None])
    pieces, joints = which
    if not len(pieces):
        return best
    units, bounds = units[:, pieces, joints], bounds[which]
    points, measured = _at_critical_points(units, rounding[which], limits[which], measure)
    for number, own in enumerate(motions):
        first, after = np.searchsorted(pieces, (own.start, own.stop))
        known = best[number]
        if known is None or first == after:
            continue
        if after - first > PIECES_PER_CHUNK:
            best[number] = None
            continue
        by_bound = first + np.argsort(-bounds[first:after])
        where = pieces[by_bound] - own.start, joints[by_bound]
        best[number] = max(known, _largest(points[:, by_bound], measured[:, by_bound], where))
    return best


def use(peak: Peak, motion: Trajectory) -> Use:
    """Return a peak as the use of a limit, with its time."""
    elapsed = peak.share * motion.lengths[peak.piece]
    time = motion.breaks[peak.piece] + elapsed
    return Use(peak.value + 0.0, peak.joint, float(time))


class Peak(NamedTuple):
    """A measured value and its place: `share` is the fraction of the piece's time passed there."""

    value: float
    piece: int
    joint: int
    share: float


def _sides(limits: Array, some: slice) -> tuple[Array, Array]:
    """Return the low and the high limits of some pieces."""
    own = limits if limits.ndim == 2 else limits[some]
    return own[..., 0], own[..., 1]


def _peak_among(
    units: Array, rounding: Array, where: tuple[Indices, Indices], limits: Array, measure: Measure
) -> Peak:
    """Return the largest measure of some pieces, at their critical points."""
    _, joints = where
    own = limits[joints] if limits.ndim == 2 else limits[where]
    return _largest(*_at_critical_points(units, rounding, own, measure), where)


def _at_critical_points(
    units: Array, rounding: Array, limits: Array, measure: Measure
) -> tuple[Array, Array]:
    """Return the critical points of some pieces, and the measure there, `(points, pieces)`."""
    points = polynomials.critical_points(units)
    values = polynomials.evaluate(units[:, None], points)
    low, high = limits.T
    return points, measure(values, rounding, low, high)


def _largest(points: Array, measured: Array, where: tuple[Indices, Indices]) -> Peak:
    pieces, joints = where
    row, i = np.unravel_index(np.argmax(measured), measured.shape)
    return Peak(
        value=float(measured[row, i]),
        piece=int(pieces[i]),
        joint=int(joints[i]),
        share=float(points[row, i]),
    )
