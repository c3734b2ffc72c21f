"""Recognise a log among motions, and judge it by what its digits allow.

A table of many positions without velocities is a log, since the motion between them is not known.
A file with velocities is a log if its samples are close together and a change of their last digits
changes a use of a limit by more than 1 %. With eight decimals or more a motion is judged as it is.
The interpolation `spline` joins positions only, so velocities are ignored with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from trajopt.core.exceptions import InvalidInput
from trajopt.core.interpolation import Interpolation
from trajopt.core.limits import LIMIT_ORDERS, Limits
from trajopt.formats.motion import Motion
from trajopt.formats.samples import Samples
from trajopt.judging.evidence import (
    DEFAULT_WINDOW_S,
    DIGITS_WORTH,
    VELOCITY_WORTH,
    Evidence,
    evidence,
)
from trajopt.judging.log_joint import Log

AS_LOG: tuple[Interpolation, ...] = ("auto", "spline")
"""Interpolations that no controller was said to use: a log may be judged by its digits."""

_MANY_DECIMALS = 8
_LOG_SAMPLES = 20  # least number of samples of a log
_LOG_STEP_S = 0.1  # largest time between samples of positions alone, s
_DENSE_STEP_S = 0.02  # largest time between samples with velocities, s
_WORTH = 0.01  # share of a limit that the digits of a log change


@dataclass(frozen=True)
class LogOptions:
    """How a log is judged.

    Attributes:
        noise: Standard deviation of the positions' noise, rad (m); 0 for rounding alone.
        window: A log is `kept` only if a mean excess of 5 % over this time, s, is excluded.
    """

    noise: float = 0.0
    window: float = DEFAULT_WINDOW_S


def evidence_of(
    motion: Motion, limits: Limits, options: LogOptions, accelerations: Sequence[bool] = ()
) -> Evidence | None:
    """Return the verdict on a log by the limits of its joints; None for any other motion.

    Where segments differ, the widest limits count.
    """
    limits = limits.in_all_segments(tightest=False)
    samples = motion.samples
    if samples is None or samples.half_digits is None or len(samples.times) < 3:
        return None
    if not options.noise and not _is_log(samples, limits.in_all_segments()):
        return None
    if limits.segments is not None:
        right = "limits that are the same in all segments, for a log, whose digits say less"
        raise InvalidInput("limits.segment", right)
    log = Log(
        times=samples.times - samples.times[0],
        positions=samples.positions,
        half_digits=samples.half_digits,
        time_half_digit=samples.time_half_digit,
        decimals=samples.decimals,
        velocities=None if motion.interpolation == "spline" else samples.velocities,
        velocity_half_digits=samples.velocity_half_digits,
    )
    return evidence(
        log,
        limits,
        noise=options.noise,
        window=options.window,
        accelerations=accelerations,
    )


def _is_log(samples: Samples, limits: Limits) -> bool:
    assert samples.half_digits is not None
    step = float(np.median(np.diff(samples.times)))
    moving = np.ptp(samples.positions, axis=0) > 0  # constant columns do not show digits
    decimals = np.array(samples.decimals)[moving]
    fine = (decimals >= _MANY_DECIMALS).all()
    if len(samples.times) < _LOG_SAMPLES or step > _LOG_STEP_S:
        return False
    if samples.velocities is None:
        return not fine
    half = np.median(samples.half_digits, axis=0)
    rates = np.zeros(len(half))
    if samples.velocity_half_digits is not None:
        rates = np.median(samples.velocity_half_digits, axis=0)
        fine = fine and (rates[moving] < 10.0**-_MANY_DECIMALS).all()
    if fine or step > _DENSE_STEP_S:
        return False
    worth = 0.0
    for name, factor in DIGITS_WORTH.items():
        order = LIMIT_ORDERS[name]
        sizes = np.abs(limits.by_name()[name]).min(axis=1)
        changed = factor * half / step**order + VELOCITY_WORTH[name] * rates / step ** (order - 1)
        worth = max(worth, float((changed / sizes).max()))
    return worth > _WORTH
