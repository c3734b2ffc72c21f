"""Whether the velocities of a log were measured, and how accurately they are known.

Many logs have velocities that were computed from their positions, filtered, or not measured at all.
These add nothing to the positions. Velocities count if they have a rounding and noise of their own,
if their integral agrees with the positions over short and long intervals, and if they are not late.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trajopt.core.arrays import Array
from trajopt.judging.premise import Premise, measured
from trajopt.judging.scatter import differences
from trajopt.judging.tube_proof import Limit


@dataclass(frozen=True, eq=False)
class Readings:
    """Logged velocities with half widths, `(readings,)` each.

    Attributes:
        times: s.
        values: rad/s.
        half: Positive, rad/s.
    """

    times: Array
    values: Array
    half: Array


NO_READINGS = Readings(np.zeros(0), np.zeros(0), np.zeros(0))

# Share of the rows in motion that are differences of the positions, in computed velocities.
_OWN_SHARE = 0.98
_COARSE = 0.05  # rounding over velocity: a coarser one hides whether velocities were computed
_ORDER = 4  # order of the differences by which both scatters are compared
# Variance of velocities over that of differences of neighbours; that of central ones is 1/12.
_SMOOTH = 0.02
_LATE, _SURELY_LATE = 0.25, 0.75  # rows; the first counts only if it is above the error
_ERRORS = 3.0  # standard errors of the lateness
_OFF_SHARE = 0.005  # largest share of intervals whose velocities do not fit the positions
_SLACK = 1.2  # factor on the largest allowed misfit of an interval
_STRIDES = (1, 2, 4, 8, 16, 32, 64, 128, 256)  # rows of an interval


def evidence_of(
    known: Premise,
    velocities: Array,
    half_digits: Array,
    limits: Sequence[Limit],
    count: int,
) -> Readings | str:
    """Return velocities with their half widths, or a reason why they do not count.

    Args:
        known: The premise of the positions, at the same times.
        velocities: rad/s, `(samples,)`.
        half_digits: Half a unit of the last digit of each velocity.
        limits: Of the derivatives of position, from order 1.
        count: Number of positions of the whole log.
    """
    times, positions = known.times, known.positions
    if np.ptp(velocities) == 0:
        return "they are always the same"
    own = measured(times, velocities, half_digits, limits[1:] or limits, count, jitter=False)
    if own.left_out:
        return "they repeat older values"
    if _differences(known, velocities, half_digits):
        return "they are differences of the positions"
    steps = np.diff(times)
    means = (velocities[1:] + velocities[:-1]) / 2
    # Between two samples a monotone velocity differs from the trapezoidal rule by this at most.
    bends = np.append(0, np.cumsum(np.abs(np.diff(velocities)) * steps / 4))
    rest = positions - np.append(0, np.cumsum(means * steps))
    for stride in _STRIDES:
        if stride >= len(times):
            break
        mean_noise = 1.0 if not own.seen or own.step else min(1.0, 3 / np.sqrt(stride))
        allowed = known.half[stride:] + known.half[:-stride]
        allowed = allowed + own.known * mean_noise * (times[stride:] - times[:-stride])
        allowed = allowed + (bends[stride:] - bends[:-stride]) / 2
        off = np.abs(rest[stride:] - rest[:-stride])
        if np.mean(off > _SLACK * allowed) > _OFF_SHARE:
            return "they are not those of the positions at these times"
    late = _lateness(known, velocities, rest)
    if late is not None:
        return f"they are late by {late:.2g} s, as if filtered"
    return Readings(times, own.positions, own.half)


def _differences(known: Premise, velocities: Array, half_digits: Array) -> bool:
    """Return whether velocities are differences of the positions, up to their rounding."""
    times, positions = known.times, known.positions
    steps, moved = np.diff(times), np.diff(positions)
    rates = moved / steps
    moving = np.abs(moved) > 0
    allowed = half_digits[1:] + 1.01 * known.unit / steps + 1e-9 * np.abs(rates)
    if not moving.any() or np.median(allowed) > _COARSE * np.median(np.abs(rates[moving])):
        return False
    unit = 2 * float(np.median(half_digits))
    smooth, _, _ = differences(times[1:], velocities[1:], unit, _ORDER)
    rough, _, _ = differences(times[1:], rates, unit, _ORDER)
    if np.median(smooth) < _SMOOTH * np.median(rough):  # differences scatter more
        return False
    central = (positions[2:] - positions[:-2]) / (times[2:] - times[:-2])
    alike = (
        (np.abs(velocities[1:] - rates) <= allowed)[moving],
        (np.abs(velocities[:-1] - rates) <= allowed)[moving],
        (np.abs(velocities[1:-1] - central) <= allowed[1:])[moving[1:]],
    )
    return any(own.mean() > _OWN_SHARE for own in alike if len(own))


def _lateness(known: Premise, velocities: Array, rest: Array) -> float | None:
    """Return the delay of the velocities, s, by least squares; None if they are not late.

    With a delay `d`, the positions minus the integral of the velocities are `d` times the
    velocities.
    """
    step = float(np.median(np.diff(known.times)))
    shape, own = (_without_line(known.times, values) for values in (velocities, rest))
    power = float((shape**2).sum())
    if power <= 0:
        return None
    late = float((shape * own).sum()) / power
    doubt = _ERRORS * known.known / np.sqrt(3 * power)
    return late if late - doubt > _LATE * step or late > _SURELY_LATE * step else None


def _without_line(times: Array, values: Array) -> Array:
    since = times - times.mean()
    centred = values - values.mean()
    rest: Array = centred - since * ((since * centred).sum() / (since**2).sum())
    return rest
