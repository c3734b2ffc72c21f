"""What a log's positions are known to, joint by joint, from the samples alone.

Any verdict on a log rests on it. A position is rounded to its printed digits, to a step of its
sensor (`trajopt.judging.lattice`), or to 32 bits; and it scatters (`trajopt.judging.scatter`). The
noise that the scatter does not exclude counts, though none may be there. Noise below
`HIDDEN_NOISE` steps is not mixed by the rounding, and hides in it: so at least 1.6 times the
rounding counts.

Some rows are no samples: where a sensor is slower than the log, its values repeat. And where stamps
are not those of the samples, the scatter grows with the speed.
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
"""Least half width, rad: the program of `tube` rounds narrower tubes away."""
HIDDEN_NOISE = 0.2
"""Noise below this part of the rounding's unit is not mixed by it, and does not show."""

_HIDDEN = 1.6  # times the rounding: a half width at least, where the noise was not stated
_SEEN = 1.02  # scatter above that of the rounding by this factor is noise
_ERRORS = 1.5, 2.5  # standard errors above the scatter that count: of unseen and of seen noise
_ROUNDED = sqrt(12)  # a rounding error has this part of its unit as standard deviation
_EPSILONS = 8  # no number is known better than this many roundings of floats
_SHORT = 7  # decimals of a number that is no result of 32 bits

_LEAST_HELD = 12  # changes of a value, and rows in motion, by which repeats are recognised
_MOST_HELD = 12  # rows that a slower sensor repeats its value
_STAIR = 3.5  # a change by more steps than this is no staircase of one step at a time
_HELD_SHARE = 0.15  # of rows in motion that repeat, at least
_STEADY_SHARE = 0.5  # of changes that are in stretches of one rate
_ROW_SEEN = 2.0  # rows: a change is seen within one, and the rate is known to some of another

_JITTER_WINDOWS = 60
_JITTER_BLOCK = 15
_JITTER_CORRELATION = 0.7
_JITTER_GROWTH = 3.0  # of the variance from the slowest windows to the fastest
_JITTER_UPPER = 1.5  # times the variance of the times


@dataclass(frozen=True, eq=False)
class Premise:
    """What the positions of a joint are known to.

    Attributes:
        times: Of the rows that are samples, and of the last one, s, `(samples,)`.
        positions: Moved onto the sensor's lattice, rad.
        half: Half width of each position, rad.
        unit: Of the last digit, or of 32 bits, rad.
        rounding: Half width of rounding alone, rad.
        step: Of the sensor, rad; 0 where none is coarser than the digits.
        values: How many different values the joint has.
        noise: Standard deviation of the noise that counts, rad.
        windows: Number of windows in motion that exclude more noise; 0 where it cannot be told.
        seen: Whether the samples scatter more than rounded ones.
        jitter: Standard deviation of the times, s, where the scatter shows it; else 0.
        left_out: Number of rows that repeat an older value.
        stated: Which of `noise` and `resolution` were stated, not found.
        commanded: Whether the positions were commanded, so that their digits are all there is.
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
    """Return the premise of positions that are all that was sent: their digits."""
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
        jitter: Whether a scatter that grows with the speed is that of the times.
    """
    fresh, late = _held(positions, half_digits)
    with np.errstate(all="ignore"):  # samples of any size: what overflows tells nothing
        samples = times[fresh], positions[fresh], half_digits[fresh]
        known = _of_samples(*samples, limits, count, noise, resolution, jitter)
    if fresh.all():
        return known
    # A repeated value is as old as its sample, and the joint moves on.
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
    """Return the premise of rows all of which are samples."""
    largest = float(np.abs(positions).max())
    unit = max(2 * float(np.median(half_digits)), _EPSILONS * np.finfo(float).eps * largest)
    unit = max(unit, _unit_of_32_bits(positions))
    found = lattice(positions, unit) if resolution is None else None
    step = resolution or 0.0
    if found is not None:
        step, positions = found
    rounding = max(unit, step) / 2
    if found is not None:  # the lattice is known to the errors of a mean
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
        # A sensor's step below two units of the last digit shows in the scatter only: it and the
        # noise share what the scatter leaves, so that their squares add.
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

    A sensor that is slower than the log repeats its value while the joint moves fast: by more than
    a staircase of single steps. It does so again and again for the same number of rows, or for two
    numbers in turn, at a rate of its own. Then a sample is up to one row older than its row.
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
    regular = bool((lengths % usual == 0).all())  # a value may be the same twice
    if not regular and not _steady(runs, fast):
        return everything, 0.0
    period = usual if regular else int(lengths.max())
    starts = np.append(0, at + 1)
    since = np.arange(len(positions)) - np.repeat(
        starts, np.diff(np.append(starts, len(positions)))
    )
    return since % period == 0, 0.0 if regular else 0.5


def _steady(runs: Indices, fast: Bools) -> bool:
    """Return whether fast changes come at one rate, up to the row in which they are seen.

    Of noise the number of changes is a random walk about any rate.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], fast.astype(int), [0]])))
    steady = 0
    for first, last in zip(edges[::2], edges[1::2], strict=True):
        own = runs[first:last]
        if len(own) >= _LEAST_HELD and np.ptp(np.cumsum(own - own.mean())) <= _ROW_SEEN:
            steady += len(own)
    return steady > _STEADY_SHARE * int(fast.sum())


def _jitter(times: Array, values: Array, unit: float) -> tuple[float, float]:
    """Return the standard deviation of the times, s, and the variance of values that stand.

    The variance of the scatter is fitted by `a + b v²`. (0, 0) where it does not grow with speed.
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
    """Return the mean of squares of which single ones, of switches of a motion, are cut."""
    from_median = 9 * float(np.median(squares)) / 0.455  # of a squared normal variable
    return float(np.minimum(squares, from_median + unit**2).mean())
