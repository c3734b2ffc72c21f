"""How accurately a log's positions are known, joint by joint, from the samples alone.

Every verdict on a log uses these half widths. A position is rounded to its printed digits, to a
step of its sensor (`trajopt.judging.lattice`), or to 32 bits. It also has noise
(`trajopt.judging.scatter`): the largest noise that the samples allow counts, even if there is none.
Noise below `HIDDEN_NOISE` steps of the rounding does not show in rounded values. So a half width is
at least 1.6 times the rounding.

A sensor that is slower than the log repeats its values; repeated rows are not samples. Where time
stamps differ from the sampling times, the scatter grows with the speed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import sqrt
from statistics import NormalDist

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.judging.lattice import lattice
from trajopt.judging.scatter import differences, scatter
from trajopt.judging.tube_proof import Limit

NOISE_DOUBT = 1e-3
"""Probability that some sample of a log is farther off than its half width."""
LEAST_HALF = 1e-7
"""Least half width, rad: the tolerance of the linear program of `tube` is about as large."""
HIDDEN_NOISE = 0.2
"""Noise below this share of the rounding's unit does not show in rounded values."""

_HIDDEN = 1.6  # least half width, times the rounding, where the noise is not stated
_SEEN = 1.02  # a scatter above this many times that of the rounding is noise
_ERRORS = 1.5, 2.5  # standard errors added to the scatter: without and with visible noise
_ROUNDED = sqrt(12)  # unit of a rounding over its standard deviation
_EPSILONS = 8  # least rounding, in units of a float's last place
_SHORT = 7  # a number with at most this many decimals is not a 32-bit float

# How a sensor that is slower than the log is recognised:
_LEAST_HELD = 12  # least number of changes of the value, and of rows in motion
_MOST_HELD = 12  # most rows for which a value is repeated
_STAIR = 3.5  # steps of the sensor; a larger change is not the next step of a slow motion
_HELD_SHARE = 0.15  # least share of repeated rows among those in motion
_STEADY_SHARE = 0.5  # least share of the changes in intervals of one rate
_ROW_SEEN = 2.0  # rows by which changes at one rate may differ from it

# How a scatter that grows with the speed is recognised:
_JITTER_WINDOWS = 60  # least number of windows in motion
_JITTER_BLOCK = 15  # windows whose mean is taken
_JITTER_CORRELATION = 0.7  # least correlation of the variance with the squared speed
_JITTER_GROWTH = 3.0  # least ratio of the variances of the fastest and the slowest windows
_JITTER_UPPER = 1.5  # factor on the variance of the times, for its error


@dataclass(frozen=True, eq=False)
class Premise:
    """How accurately the positions of a joint are known.

    Attributes:
        times: Of the rows that are samples, and of the last one, s, `(samples,)`.
        positions: Rounded to the sensor's steps, rad.
        half: Half width of each position, rad.
        unit: Unit of the last digit, or of a 32-bit float, rad.
        rounding: Half width of rounding alone, rad.
        step: Step of the sensor, rad; 0 where it is not coarser than the digits.
        values: Number of different values.
        noise: Standard deviation of the largest noise that the samples allow, rad.
        windows: Number of windows in motion from which the noise is estimated; 0 if there are too
            few.
        seen: Whether the samples scatter more than rounding alone does.
        jitter: Standard deviation of the time stamps, s, where the scatter shows it; else 0.
        left_out: Number of rows that repeat an older value.
        stated: Which of `noise` and `resolution` the user stated; the others are estimated.
        commanded: Whether the positions were commanded; they are then exact to their digits.
    """

    times: Array
    positions: Array
    half: Array
    unit: float
    rounding: float
    step: float = 0.0
    values: int = 0
    noise: float = 0.0
    windows: int = 0
    seen: bool = False
    jitter: float = 0.0
    left_out: int = 0
    stated: Sequence[str] = ()
    commanded: bool = False

    @property
    def known(self) -> float:
        """Return the half width of most positions, rad."""
        return float(np.median(self.half))

    @property
    def statistical(self) -> bool:
        """Return whether noise counts, so that a proof errs with probability `NOISE_DOUBT`."""
        return self.noise > 0

    def as_dict(self) -> dict[str, object]:
        """Return it for JSON, in SI units."""
        arrays = ("times", "positions", "half")
        table = {name: value for name, value in vars(self).items() if name not in arrays}
        return {"half_width": self.known, **table, "stated": list(self.stated)}


def commanded(times: Array, positions: Array, half_digits: Array) -> Premise:
    """Return the premise of commanded positions, which are exact to their digits."""
    half = np.maximum(half_digits, LEAST_HALF)
    digit = float(np.median(half_digits))
    return Premise(times, positions, half, 2 * digit, digit, commanded=True)


def measured(
    times: Array,
    positions: Array,
    half_digits: Array,
    limits: Sequence[Limit],
    count: int,
    noise: float | None = None,
    resolution: float | None = None,
    jitter: bool = True,
) -> Premise:
    """Return the premise of measured positions.

    Args:
        times: Increasing, s, `(samples,)`.
        positions: rad, `(samples,)`.
        half_digits: Half a unit of the last digit of each position, rad.
        limits: Of the derivatives of order 1 and up; infinite where there is none.
        count: Number of positions of the whole log.
        noise: Standard deviation of the noise, rad, if it is known.
        resolution: The sensor's step, rad, if it is known.
        jitter: Whether a scatter that grows with the speed is due to the time stamps.
    """
    fresh, late = _held(positions, half_digits)
    with np.errstate(all="ignore"):  # samples of any size: their squares may overflow
        samples = times[fresh], positions[fresh], half_digits[fresh]
        known = _of_samples(*samples, limits, count, noise, resolution, jitter)
    if fresh.all():
        return known
    # The joint moves on while a value is repeated.
    speed = max(map(abs, limits[0]))
    half, at = known.half, known.positions
    if late:
        half = half + speed * late * float(np.median(np.diff(times)))
    if not fresh[-1]:
        half = np.append(half, half[-1] + speed * (times[-1] - times[fresh][-1]))
        at = np.append(at, at[-1])
        fresh[-1] = True
    left_out = int((~fresh).sum())
    return replace(known, times=times[fresh], positions=at, half=half, left_out=left_out)


def _of_samples(
    times: Array,
    positions: Array,
    half_digits: Array,
    limits: Sequence[Limit],
    count: int,
    noise: float | None,
    resolution: float | None,
    jitter: bool,
) -> Premise:
    """Return the premise of rows without repeated ones."""
    largest = float(np.abs(positions).max())
    unit = max(2 * float(np.median(half_digits)), _EPSILONS * np.finfo(float).eps * largest)
    unit = max(unit, _unit_of_32_bits(positions))
    found = lattice(positions, unit) if resolution is None else None
    step = resolution or 0.0
    if found is not None:
        step, positions = found
    rounding = max(unit, step) / 2
    if found is not None:  # the estimated step has the error of a mean
        rounding += unit / sqrt(len(np.unique(positions)))
    elif resolution is not None:
        rounding = (resolution + unit) / 2
    own = np.maximum(half_digits, rounding)
    quantile = NormalDist().inv_cdf(1 - NOISE_DOUBT / (2 * max(count, 1)))
    stated = tuple(
        name for name, value in (("noise", noise), ("resolution", resolution)) if value is not None
    )
    whole = Premise(
        times, positions, own, unit, rounding, step, len(np.unique(positions)), stated=stated
    )
    if noise is not None:
        half = np.maximum(own + quantile * noise, LEAST_HALF)
        return replace(whole, half=half, noise=noise, seen=noise > 0)
    order = max((k for k, own in enumerate(limits, 1) if np.isfinite(own[1])), default=1)
    scattered = scatter(times, positions, max(unit, step), order, limits[order - 1])
    if scattered is None:
        return replace(whole, half=np.maximum(_HIDDEN * own, LEAST_HALF))
    rounded = max(2 * rounding, 2 * LEAST_HALF) / _ROUNDED
    errors = _ERRORS[1]
    seen = scattered.upper(-errors) > _SEEN * rounded
    upper = scattered.upper(errors if seen else _ERRORS[0])
    noise = sqrt(max(0.0, upper**2 - rounded**2))
    far: float | Array = quantile * noise
    if not seen and not step:
        # A sensor's step below two units of the last digit shows in the scatter only. The variances
        # of this step and of the noise add up to the scatter.
        ratio = float(np.clip(scattered.upper(errors) / rounded, 1, 2))
        far = np.hypot(far, own * sqrt(ratio**2 - 1))
    half = np.maximum(_HIDDEN * own, own + far)
    late, variance = _jitter(times, positions, max(unit, step)) if jitter else (0.0, 0.0)
    if late:
        speed = np.abs(np.gradient(positions, times))
        wide = 2 * int(len(speed) ** 0.3) + 1
        speed = np.convolve(speed, np.full(wide, 1 / wide), "same")
        each = variance + _JITTER_UPPER * (late * speed) ** 2 - rounded**2
        half = np.maximum(half, own + quantile * np.sqrt(np.maximum(0.0, each)))
    return replace(
        whole,
        half=np.maximum(half, LEAST_HALF),
        noise=noise,
        windows=scattered.windows,
        seen=seen,
        jitter=late,
    )


def _unit_of_32_bits(values: Array) -> float:
    """Return the largest spacing of 32-bit floats if all values are such floats, else 0."""
    with np.errstate(over="ignore"):
        single = values.astype(np.float32)
    if (single != values).any() or (np.round(values, _SHORT) == values).all():
        return 0.0
    return float(np.spacing(np.abs(single).max()))


def _held(positions: Array, half_digits: Array) -> tuple[Bools, float]:
    """Return which rows are samples, and by how many rows these may be late.

    A sensor that is slower than the log repeats its value also while the joint moves by several
    steps a row. It repeats it for the same number of rows each time. Or it has a rate of its own
    and repeats it for two numbers of rows in turn; a sample is then up to one row older than its
    row.
    """
    everything = np.ones(len(positions), bool)
    changes = np.diff(positions)
    at = np.flatnonzero(changes)
    if len(at) < _LEAST_HELD:
        return everything, 0.0
    sizes, runs = np.abs(changes[at]), np.diff(at)
    least = max(2 * float(np.median(half_digits)), float(np.sort(sizes)[len(at) // 20]))
    fast = (runs <= _MOST_HELD) & (sizes[1:] > _STAIR * least)
    lengths = runs[fast]
    moving, repeats = int(lengths.sum()), int((lengths - 1).sum())
    if moving < _LEAST_HELD or repeats < _HELD_SHARE * moving:
        return everything, 0.0
    usual = int(np.bincount(lengths).argmax())
    regular = bool((lengths % usual == 0).all())  # two samples may have the same value
    if not regular and not _steady(runs, fast):
        return everything, 0.0
    period = usual if regular else int(lengths.max())
    starts = np.append(0, at + 1)
    since = np.arange(len(positions)) - np.repeat(
        starts, np.diff(np.append(starts, len(positions)))
    )
    return since % period == 0, 0.0 if regular else 0.5


def _steady(runs: Indices, fast: Bools) -> bool:
    """Return whether the rows of fast changes differ from a constant rate by `_ROW_SEEN` at most.

    Changes that noise makes are a random walk about any rate.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fast.astype(int), [0]])))
    steady = 0
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        own = runs[first:last]
        if len(own) >= _LEAST_HELD and np.ptp(np.cumsum(own - own.mean())) <= _ROW_SEEN:
            steady += len(own)
    return steady > _STEADY_SHARE * int(fast.sum())


def _jitter(times: Array, values: Array, unit: float) -> tuple[float, float]:
    """Return the standard deviation of the time stamps, s, and the values' variance at rest.

    The variance of the scatter is fitted by `a + b v²`, with the speed `v`. Return (0, 0) where it
    does not grow with the speed.
    """
    squares, moving, speeds = differences(times, values, unit, 4)
    squares, speeds = squares[moving], speeds[moving]
    if len(squares) < _JITTER_WINDOWS:
        return 0.0, 0.0
    blocks = np.array_split(np.argsort(speeds), np.clip(len(squares) // _JITTER_BLOCK, 4, 12))
    mean = np.array([_robust_mean(squares[own], unit) for own in blocks])
    fast = np.array([np.mean(speeds[own] ** 2) for own in blocks])
    slowest = float(mean[: max(1, len(mean) // 4)].mean())
    if not np.isfinite(mean).all() or np.ptp(fast) <= 0 or np.ptp(mean) <= 0:
        return 0.0, 0.0
    grows = np.corrcoef(mean, fast)[0, 1] > _JITTER_CORRELATION
    if not grows or mean[-1] <= _JITTER_GROWTH * slowest:
        return 0.0, 0.0
    matrix = np.stack([np.ones_like(fast), fast], axis=1)
    still, rate = np.linalg.lstsq(matrix / mean.mean(), mean / mean.mean(), rcond=None)[0]
    return sqrt(max(0.0, float(rate))), max(float(still), slowest)


def _robust_mean(squares: Array, unit: float) -> float:
    """Return the mean of the squares; large ones, where the motion switches, are clipped."""
    from_median = 9 * float(np.median(squares)) / 0.455  # 0.455: median of a squared normal
    return float(np.minimum(squares, from_median + unit**2).mean())
