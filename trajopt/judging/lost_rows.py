"""Rows that a log lost, where its times were written as if none was.

There the position jumps by what the joint moves in a whole number of steps: a local parabola has a
step there, and the step over the slope is the same whole number for every joint that moves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt.core.arrays import Array
from trajopt.judging.premise import Premise
from trajopt.judging.scatter import LEAST_WINDOWS, differences

_WINDOW_S = 0.03  # on each side of a place
_WINDOW = 3, 12  # rows on each side, at least and at most
_CUBIC = 6  # rows on each side from which on the parabola is a cubic
_SURE_STEP, _SURE_SLOPE = 5.0, 2.0  # standard errors above which a step, a slope is one
_WHOLE = 0.15  # distance from a whole number, beside three standard errors
_ROUNDS = 3
_MOST_STEPS = 4.0  # noise of an analog sensor would look like lost rows
_QUIET = 1.2  # times the scatter by the median, which a few lost rows do not raise


@dataclass(frozen=True)
class Lost:
    """Rows that seem to be missing.

    Attributes:
        row: They are missing after this one, counted from 0.
        count: How many.
        strength: Of the step, in standard errors.
    """

    row: int
    count: int
    strength: float


def lost_rows(joints: list[Premise]) -> tuple[list[Lost], Array]:
    """Return where rows seem to be missing, and the times with them.

    Args:
        joints: Premises of joints with the same times.
    """
    times = joints[0].times
    positions = np.stack([own.positions for own in joints], axis=1)
    noise = np.array([_noise(own) for own in joints])
    step = float(np.median(np.diff(times)))
    found: list[Lost] = []
    for _ in range(_ROUNDS):
        more = _places(times, positions, noise, step)
        if not more:
            break
        found += more
        for own in more:
            times = np.concatenate([times[: own.row + 1], times[own.row + 1 :] + own.count * step])
    return sorted(found, key=lambda own: own.row), times


def _noise(known: Premise) -> float:
    """Return the standard deviation of noise that lost rows do not raise."""
    rounded = max(known.unit, known.step) / np.sqrt(12)
    if known.step:
        return max(min(known.noise, _MOST_STEPS * known.step), rounded)
    squares, moving, _ = differences(known.times, known.positions, known.unit, 4)
    if moving.sum() <= LEAST_WINDOWS:
        return rounded
    typical = float(np.median(np.sqrt(squares[moving]))) / 0.6745  # of a normal variable
    return max(rounded, _QUIET * typical)


def _places(times: Array, positions: Array, noise: Array, step: float) -> list[Lost]:
    """Return places where every joint that surely moves has lost the same number of rows."""
    widest = int(np.clip(round(_WINDOW_S / step), *_WINDOW))
    found = []
    for rows in sorted({widest, max(_WINDOW[0], widest // 2), _WINDOW[0]}):  # two may be close
        found += _steps(times, positions, noise, step, rows)
    strongest: list[Lost] = []
    for one in sorted(found, key=lambda own: -own.strength):
        if all(abs(one.row - other.row) > 1 for other in strongest):
            strongest.append(one)
    return sorted(strongest, key=lambda own: own.row)


def _steps(times: Array, positions: Array, noise: Array, step: float, m: int) -> list[Lost]:
    """Return the places by fits to `m` rows on each side."""
    if len(times) < 2 * m + 1:
        return []
    at = np.lib.stride_tricks.sliding_window_view(times, 2 * m)
    since = (at - (at[:, m - 1 : m] + at[:, m : m + 1]) / 2) / (m * step)
    powers = [since**0, since, since**2, (since > 0).astype(float)]
    if m >= _CUBIC:
        powers.append(since**3)
    fit = np.linalg.pinv(np.stack(powers, axis=2))  # (windows, unknowns, rows)
    error = np.sqrt((fit[:, 3] ** 2).sum(axis=1))[:, None] * noise
    each = np.lib.stride_tricks.sliding_window_view(positions, 2 * m, axis=0)
    jump = np.einsum("wjm,wm->wj", each, fit[:, 3])
    slope = np.abs(np.einsum("wjm,wm->wj", each, fit[:, 1])) / m  # a row
    sign = np.sign(np.einsum("wjm,wm->wj", each, fit[:, 1]))
    sure = (np.abs(jump) > _SURE_STEP * error) & (slope > _SURE_SLOPE * error)
    found = []
    for place in np.flatnonzero(sure.any(axis=1)).tolist():
        own = sure[place]
        lost = (sign * jump)[place, own] / slope[place, own]
        count = int(np.round(np.median(lost)))
        near = _WHOLE + 3 * error[place, own] / slope[place, own]
        if count >= 1 and (np.abs(lost - count) < near).all():
            strength = float((np.abs(jump[place, own]) / error[place, own]).max())
            found.append(Lost(place + m - 1, count, strength))
    return found
