"""Recognise a log among motions, and judge it within the accuracy of its samples.

A table of many positions without velocities is a log, whatever its digits are, since the motion
between them is not known. A file with velocities is a log if its samples are close together and a
change of their last digits changes a use of a limit by more than 1 %. With eight decimals and more
their scatter about the integral of the velocities has to do that, and the motion has to break a
limit as a controller executes it: a planner's exact samples are executed as they stand.

The interpolation `spline` joins positions only, so velocities are ignored with it. Whole turns of
continuous joints are removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.interpolation import Interpolation
from trajopt.core.limits import LIMIT_ORDERS, Limits
from trajopt.core.trajectory import Trajectory
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
from trajopt.judging.scatter import scatter
from trajopt.judging.turns import unwrapped

AS_LOG: tuple[Interpolation, ...] = ("auto", "spline")
"""Interpolations that no controller was said to use: a log may be judged by its digits."""

_LOG_SAMPLES = 20  # least number of samples of a log
_LOG_STEP_S = 0.1  # largest time between samples of positions alone, s
_DENSE_STEP_S = 0.02  # largest time between samples with velocities, s
_FINE = 1e-8  # half a digit, rad and rad/s, below which samples may be a planner's
_LARGEST = 100.0  # rad (m): noise or a step beyond it is a slip of the pen
_WORTH = 0.01  # share of a limit that the digits of a log change


@dataclass(frozen=True)
class LogOptions:
    """How a log is judged.

    Attributes:
        noise: Standard deviation of the positions' noise, rad (m); None if it is to be found.
        resolution: Step of the sensors, rad (m); None if it is to be found.
        commanded: Whether positions were sent, not measured; None if names and format say it.
        window: A log is `kept` only if a mean excess of 5 % over this time, s, is excluded.

    Raises:
        InvalidInput: Noise or resolution is larger than any joint moves.
    """

    noise: float | None = None
    resolution: float | None = None
    commanded: bool | None = None
    window: float = DEFAULT_WINDOW_S

    def __post_init__(self) -> None:
        for name in ("noise", "resolution"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= _LARGEST:
                raise InvalidInput(name, f"a number from 0 to {_LARGEST:g}, rad (m)", value=value)

    @property
    def stated(self) -> bool:
        """Return whether something is known of the positions, as of those of a log."""
        return self.noise is not None or self.resolution is not None or self.commanded is False


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
    if motion.interpolation == "spline":
        samples = replace(samples, velocities=None)
    log = _log(samples, limits, options)
    if not options.stated and not _is_log(log, limits, motion.trajectory):
        return None
    if limits.segments is not None:
        right = "limits that are the same in all segments, for a log, whose digits say less"
        raise InvalidInput("limits.segment", right)
    return evidence(
        log,
        limits,
        noise=options.noise,
        resolution=options.resolution,
        window=options.window,
        accelerations=accelerations,
    )


def _log(samples: Samples, limits: Limits, options: LogOptions) -> Log:
    assert samples.half_digits is not None
    slides = [unit == "m" for unit in samples.joint_units] or [False] * len(samples.joint_names)
    half = np.median(samples.half_digits, axis=0)
    turning = [not own for own in slides]
    positions, turns = unwrapped(samples.times, samples.positions, half, limits, turning)
    sent = samples.commanded if options.commanded is None else options.commanded
    return Log(
        times=samples.times - samples.times[0],
        positions=positions,
        half_digits=samples.half_digits,
        time_half_digit=samples.time_half_digit,
        decimals=samples.decimals,
        velocities=samples.velocities,
        velocity_half_digits=samples.velocity_half_digits,
        commanded=sent,
        turns=turns,
    )


def _is_log(log: Log, limits: Limits, executed: Trajectory) -> bool:
    step = float(np.median(np.diff(log.times)))
    if len(log.times) < _LOG_SAMPLES or step > _LOG_STEP_S:
        return False
    if log.velocities is None:
        return True
    if step > _DENSE_STEP_S:
        return False
    rates = np.zeros(len(log.positions.T))
    if log.velocity_half_digits is not None:
        rates = np.median(log.velocity_half_digits, axis=0)
    half = np.median(log.half_digits, axis=0)
    moving = np.ptp(log.positions, axis=0) > 0  # a constant column does not show its digits
    limits = limits.in_all_segments()
    if max(half[moving].max(initial=0.0), rates[moving].max(initial=0.0)) < _FINE:
        ratios = [key for key, own in limits.kinds.items() if own.is_ratio]
        if all(limits.worst(key, executed).value <= 1 + _WORTH for key in ratios):
            return False
        half = _scatter(log)
    worth = 0.0
    for name, factor in DIGITS_WORTH.items():
        order = LIMIT_ORDERS[name]
        sizes = np.abs(limits.by_name()[name]).min(axis=1)
        changed = factor * half / step**order + VELOCITY_WORTH[name] * rates / step ** (order - 1)
        worth = max(worth, float((changed / sizes)[moving].max(initial=0.0)))
    return worth > _WORTH


def _scatter(log: Log) -> Array:
    """Return the scatter of each joint's positions about the integral of its velocities, rad."""
    assert log.velocities is not None
    steps = np.diff(log.times)[:, None]
    rest = np.diff(log.positions, axis=0) - steps * (log.velocities[1:] + log.velocities[:-1]) / 2
    each = [scatter(log.times[1:], own, 0.0, 1, (-np.inf, np.inf)) for own in rest.T]
    return np.array([0.0 if own is None else own.sigma for own in each])
