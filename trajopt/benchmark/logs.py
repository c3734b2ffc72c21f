"""Recognise a log among motions, and judge it by what its digits tell.

A table of many positions alone is a log: no controller's motion is known between them. So is a file
with velocities whose samples are close together and whose digits are worth more than 1 % of a
limit: there a change of the last digit changes the verdict. With eight decimals or more the motion
is judged as it stands. A `spline` joins positions alone, so velocities are left out for it.
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
_LOG_SAMPLES = 20  # at least
_LOG_STEP_S = 0.1  # at most between samples of positions alone
_DENSE_STEP_S = 0.02  # at most between samples with velocities
_WORTH = 0.01  # of a limit


@dataclass(frozen=True)
class LogOptions:
    """How a log is judged.

    Attributes:
        noise: Standard deviation of the positions' noise, rad (m); 0 for digits alone.
        window: Over which a mean excess of 5 % must show for a log to count as kept, s.
    """

    noise: float = 0.0
    window: float = DEFAULT_WINDOW_S


def evidence_of(
    motion: Motion, limits: Limits, options: LogOptions, accelerations: Sequence[bool] = ()
) -> Evidence | None:
    """Return what a log tells about the limits of its joints; None for any other motion.

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
    moving = np.ptp(samples.positions, axis=0) > 0  # a constant says nothing of the digits
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
