"""One joint of a log: the motions that its samples allow, and the share of limits that they use.

A log has rounded positions and times, and noise. So each position is known within a half width, and
so is each velocity that was logged. `Joint.found` returns the motion within these half widths that
uses the smallest share of the limits, and a lower bound on the share that every such motion uses
(`trajopt.judging.tube`). `means_over_windows` bounds, without any motion, for how long an excess
over a limit could stay unnoticed.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.limits import Limit as OtherLimit
from trajopt.core.limits import LimitName, Limits
from trajopt.core.trajectory import Trajectory
from trajopt.judging.tube import Rates, TubeAnswer, slope, tube
from trajopt.judging.tube_proof import NO_READINGS, Limit, Readings

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

EXCESS = 0.05
"""A mean excess over a window that must show, as a share of the limit."""
NOISE_DOUBT = 1e-3
"""Probability that some sample's noise is larger than the half width of the tube."""
RATES: tuple[LimitName, ...] = ("velocity", "acceleration", "jerk")

Positions = Callable[[Array], tuple[Array, Array]]
"""A function of times that returns the lowest and the highest possible position, rad."""

_FLOOR = 1e-7  # least half width, rad and rad/s: the program rounds narrower tubes away
_UNLIMITED: Limit = (-np.inf, np.inf)
_WAYPOINT_SHARE = 1e-7  # half width at a waypoint, relative to the joint's span; repair corrects it
_MAX_NARROWINGS = 4
_LEAST_RATE = 1e-3  # least velocity limit at any time, relative to the constant one
_SINGLE_ROUNDS = 2  # rounds of adding knots, for one limit alone
_STRIDE_GROWTH = 1.25
_MAX_STRIDE_BY_ONE = 8


@dataclass(frozen=True, eq=False)
class Log:
    """Samples of joint positions, and the digits of positions and times.

    Attributes:
        times: Increasing from 0, s, `(samples,)`.
        positions: rad (m for a prismatic joint), `(samples, joints)`.
        half_digits: Half a unit of the last digit of each position, rad, `(samples, joints)`.
        time_half_digit: Half a unit of the last digit of the times, s; 0 where they are exact.
        decimals: Number of decimals of each joint's column, in the unit of the file.
        velocities: rad/s, `(samples, joints)`; None for a log of positions alone.
        velocity_half_digits: Half a unit of the last digit of each velocity, rad/s.
    """

    times: Array
    positions: Array
    half_digits: Array
    time_half_digit: float = 0.0
    decimals: Sequence[int] = ()
    velocities: Array | None = None
    velocity_half_digits: Array | None = None


@dataclass(frozen=True, eq=False)
class _Conditions:
    """Conditions on a joint's motion, beside its constant limits.

    Attributes:
        half: Half width of each sample, rad.
        readings: Logged velocities with their half widths.
        rates: Velocity limits that depend on the time.
        turns: Times between samples at which the position limits are imposed, s.
    """

    half: Array
    readings: Readings
    rates: Rates | None
    turns: Array


def _along(spline: BSpline) -> Positions:
    """Return the positions of one motion as `Positions`: the lowest is the highest."""

    def at(times: Array) -> tuple[Array, Array]:
        positions = spline(times)
        return positions, positions

    return at


@dataclass(frozen=True, eq=False)
class Joint:
    """One joint's samples and limits.

    Attributes:
        times: s, `(samples,)`.
        positions: rad, `(samples,)`.
        digits: Half width of each position at its true time, rad.
        shift: Half width of each time, s.
        limits: Of velocity, acceleration and jerk; infinite where there is none.
        range: Position limits, rad.
        logged: Logged velocities with their half widths.
        others: Limits of other kinds for this joint; some bound its velocity at each position.
        stretch: Factor by which the motion is slowed down. The samples keep their times, and the
            limits are those of the motion before it is slowed down, so they are wider.
    """

    times: Array
    positions: Array
    digits: Array
    shift: float
    limits: tuple[Limit, Limit, Limit]
    range: Limit
    logged: Readings
    others: Mapping[str, OtherLimit]
    stretch: float = 1.0

    def stretched(self, factor: float) -> Joint:
        """Return the samples, without velocities, for a motion that is slowed down by a factor."""
        wider = [
            (low * factor**order, high * factor**order)
            for order, (low, high) in enumerate(self.limits, start=1)
        ]
        velocity, acceleration, jerk = wider
        limits = (velocity, acceleration, jerk)
        return replace(self, limits=limits, logged=NO_READINGS, stretch=factor)

    @property
    def half(self) -> Array:
        """Half width at the stated times, rad.

        A stated time is off by up to `shift`, in which the joint moves at most `shift V`.
        """
        low, high = self.limits[0]
        return self.digits + self.shift * max(-low, high)

    @cached_property
    def readings(self) -> Readings:
        """Return the logged velocities, with their half widths widened for rounded times.

        There are none where times are rounded and the acceleration is not limited.
        """
        if not self.shift:
            return self.logged
        blur = self.shift * max(-self.limits[1][0], self.limits[1][1])
        known = replace(self.logged, half=self.logged.half + blur)
        return known if np.isfinite(blur) else NO_READINGS

    @property
    def beyond(self) -> Array:
        """Return the least distance of each sample beyond the position limits, rad."""
        low, high = self.range
        return np.maximum(low - self.positions, self.positions - high) - self.digits

    def found(self, rest: bool, passing: tuple[Array, Array] | None = None) -> TubeAnswer:
        """Return the motion that uses the smallest share of the limits, and the lower bound."""
        limits = list(self.limits)
        while not np.isfinite(limits[-1][1]):
            limits.pop()
        if len(limits) == 1:  # velocity is continuous: degree 2, a very wide acceleration limit
            steep = 100 * max(self.limits[0]) / float(np.median(np.diff(self.times)))
            limits.append((-steep, steep))
        falling = self.falling()
        own = _Conditions(self.half, self.readings, self._rates(self.reach, falling), np.zeros(0))
        found = self._solved(own, limits, rest, passing)
        for _ in range(_MAX_NARROWINGS):
            beyond = self.beyond_between(found)
            hits, use = self._hits(found), self._use_of(found, falling)
            kept = hits and not len(beyond) and use <= max(1.0, found.high)
            if kept or not np.isfinite(found.high):
                return found
            spline = found.spline()
            if not hits:
                own = self._narrowed(own, spline)
            rates = self._rates(_along(spline), falling)
            own = replace(own, rates=rates, turns=np.union1d(own.turns, beyond))
            narrower = self._solved(own, limits, rest, passing)
            # A narrower tube, or rates along one motion, hold for that motion only. The position
            # limits between samples hold for every motion: only with these the bound is a proof.
            proves = hits and not falling and narrower.low > found.low
            better = narrower if proves else found
            found = replace(narrower, low=better.low, proof=better.proof)
        if not self._hits(found):
            return replace(found, high=np.inf)
        return replace(found, high=max(found.high, self._use_of(found, falling)))

    def _narrowed(self, own: _Conditions, spline: BSpline) -> _Conditions:
        """Return narrower half widths, where this motion is slower than its limit allows."""
        speed = np.abs(spline(self.times, nu=1))
        half = np.minimum(own.half, self.digits + self.shift * speed)
        readings = own.readings
        if len(readings.times):
            bend = np.abs(spline(readings.times, nu=2))
            width = np.minimum(readings.half, self.logged.half + self.shift * bend)
            readings = replace(readings, half=width)
        return replace(own, half=half, readings=readings)

    def beyond_between(self, found: TubeAnswer) -> Array:
        """Return times between samples at which the motion turns beyond its position limits, s."""
        low, high = self.range
        inside = (found.coefficients >= low - _FLOOR) & (found.coefficients <= high + _FLOOR)
        # A spline stays within the range of its coefficients. Samples beyond the limits are
        # reported elsewhere.
        if inside.all() or not np.isfinite(found.high) or self.beyond.max() > 0:
            return np.zeros(0)
        from scipy.interpolate import PPoly

        spline = found.spline()
        turns = PPoly.from_spline(spline.derivative()).roots(extrapolate=False)
        turns = turns[np.isfinite(turns)]
        positions = spline(turns)
        beyond: Array = turns[(positions < low - _FLOOR / 10) | (positions > high + _FLOOR / 10)]
        return beyond

    def falling(self) -> list[str]:
        """Return the keys of the limits that bound the velocity at each position."""
        at = self.positions
        return [
            key
            for key, own in self.others.items()
            if np.isfinite(own.velocities(0, at, at)).any() and np.isfinite(self.limits[0][1])
        ]

    def reach(self, times: Array) -> tuple[Array, Array]:
        """Return the lowest and highest position at some times, for use up to twice the limits.

        Between two samples at the distance `h`, a motion within the limits `V` and `A` is off the
        straight line by at most `V h / 2` and `A h² / 8`.
        """
        steps = np.diff(self.times)
        beyond = 2 * max(map(abs, self.limits[0])) * steps / 2
        if np.isfinite(self.limits[1][1]):
            beyond = np.minimum(beyond, 2 * max(map(abs, self.limits[1])) * steps**2 / 8)
        piece = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, len(steps) - 1)
        lowest = np.interp(times, self.times, self.positions - self.half)
        highest = np.interp(times, self.times, self.positions + self.half)
        return lowest - beyond[piece], highest + beyond[piece]

    def _rates(self, positions: Positions, keys: Sequence[str]) -> Rates | None:
        """Return the velocity limits as a function of time, from the limits with these keys."""
        if not keys:
            return None
        low, high = self.limits[0]

        def rates(times: Array) -> tuple[Array, Array]:
            lowest, highest = np.full(len(times), low), np.full(len(times), high)
            for key in keys:
                down, up = self.others[key].velocities(0, *positions(times))
                lowest = np.maximum(lowest, np.minimum(self.stretch * down, _LEAST_RATE * low))
                highest = np.minimum(highest, np.maximum(self.stretch * up, _LEAST_RATE * high))
            return lowest, highest

        return rates

    def _use_of(self, found: TubeAnswer, keys: Sequence[str]) -> float:
        """Return the motion's exact largest use of the limits with these keys."""
        if not keys or not np.isfinite(found.high):
            return 0.0
        motion = joined([found], self.times[[0, -1]])
        if motion is None:
            return 0.0
        slow = motion.dilated(self.stretch)
        return max(self.others[key].worst(slow).value for key in keys)

    def _solved(
        self,
        own: _Conditions,
        limits: Sequence[Limit],
        rest: bool,
        passing: tuple[Array, Array] | None,
    ) -> TubeAnswer:
        points = self._inside(own)
        if passing is not None:
            points = _through(*points, passing)
        return tube(*points, limits, rest=rest, readings=own.readings, rates=own.rates)

    def _inside(self, own: _Conditions) -> tuple[Array, Array, Array]:
        """Return times, centres and half widths of the tube, cut off at the position limits.

        A sample outside the limits keeps its half width. At the times `turns`, where a motion
        turned beyond the limits, the tube is as wide as the range.
        """
        low, high = self.range
        half = own.half
        lowest = np.maximum(self.positions - half, low)
        highest = np.minimum(self.positions + half, high)
        fits = highest - lowest > 0.1 * half
        centre = np.where(fits, (lowest + highest) / 2, self.positions)
        half = np.where(fits, (highest - lowest) / 2, half)
        if not len(own.turns):
            return self.times, centre, half
        wide = float(np.ptp(self.positions)) + 1.0  # for sides without a position limit
        low = max(low, float(self.positions.min()) - wide)
        high = min(high, float(self.positions.max()) + wide)
        times = np.concatenate([self.times, own.turns])
        order = np.argsort(times, kind="stable")
        centre = np.append(centre, np.full(len(own.turns), (low + high) / 2))
        half = np.append(half, np.full(len(own.turns), (high - low) / 2 * (1 - 1e-8)))
        return times[order], centre[order], half[order]

    def _hits(self, found: TubeAnswer) -> bool:
        """Return whether the motion passes each sample within `shift` of its stated time."""
        if not self.shift or not np.isfinite(found.high):
            return True
        ends = self.times[[0, -1]]
        shifted = self.times + self.shift * np.array([[-1.0], [0.0], [1.0]])
        kinds = [(0, self.positions, self.digits)]
        if len(self.readings.times):
            kinds.append((1, self.logged.values, self.logged.half))
        for order, values, digits in kinds:
            passed = found.spline()(np.clip(shifted, *ends), nu=order)
            slack = digits * (1 + 1e-6)
            above = passed.min(axis=0) <= values + slack
            below = passed.max(axis=0) >= values - slack
            if not (above & below).all():
                return False
        return True

    def singles(self) -> dict[str, float]:
        """Return the share of each limit that every motion uses, with that limit alone."""
        half = self.half
        shares: dict[str, float] = {}
        for order, (name, limit) in enumerate(zip(RATES, self.limits, strict=True)):
            if not np.isfinite(limit[1]):
                continue
            if order == 0:
                shares[name] = self.slope()[0]
                continue
            alone = [_UNLIMITED] * order + [limit]
            shares[name] = tube(
                self.times,
                self.positions,
                half,
                alone,
                rounds=_SINGLE_ROUNDS,
                readings=self.readings,
            ).low
        for key in self.falling():
            shares[key] = self._least_of_falling(self.others[key])
        return shares

    def _least_of_falling(self, limit: OtherLimit) -> float:
        """Return the share of a velocity limit that depends on position, used by every motion.

        It is the largest share that the mean velocity over a window uses, less its doubt.
        """
        from scipy.ndimage import maximum_filter1d, minimum_filter1d

        low, high = limit.velocities(0, *self.reach(self.times))
        share = 0.0
        positions, half = self.positions[:, None], self.half[:, None]
        for size, mean, doubt, _ in means_over_windows(self.times, positions, half, 1):
            lowest = _filtered(minimum_filter1d, low, size)
            highest = _filtered(maximum_filter1d, high, size)
            with np.errstate(divide="ignore", invalid="ignore"):
                up = (mean - doubt)[:, 0] / highest
                down = (mean + doubt)[:, 0] / lowest
            share = max(share, float(np.nanmax(np.maximum(up, down))))
        return share

    def slope(self) -> tuple[float, float, float]:
        """Return the share of the velocity limit that every motion uses, and its two times, s."""
        steepest = slope(self.times, self.positions, self.half, self.limits[0])
        low, high = self.limits[0]
        read = self.readings
        if not len(read.times):
            return steepest
        shares = np.maximum((read.values - read.half) / high, (read.values + read.half) / low)
        time = float(read.times[np.argmax(shares)])
        return max(steepest, (float(shares.max()), time, time))


def joints_of(log: Log, limits: Limits, noise: float, accelerations: Sequence[bool]) -> list[Joint]:
    judged = accelerations or [True] * log.positions.shape[1]
    return [_joint(log, limits, noise, joint, own) for joint, own in enumerate(judged)]


def _joint(log: Log, limits: Limits, noise: float, joint: int, judged: bool) -> Joint:
    digits = np.maximum(log.half_digits[:, joint], _FLOOR)
    if noise:
        digits = digits + noise * _noise_quantile(log.positions.size)
    own: list[Limit] = []
    for name in RATES:
        low, high = map(float, limits.by_name()[name][joint])
        known = np.isfinite([low, high]).all() and (judged or name != "acceleration")
        own.append((low, high) if known else _UNLIMITED)
    velocity, acceleration, jerk = own
    low, high = map(float, limits.position[joint])
    logged = NO_READINGS
    if log.velocities is not None and log.velocity_half_digits is not None and not noise:
        width = np.maximum(log.velocity_half_digits[:, joint], _FLOOR)
        logged = Readings(log.times, log.velocities[:, joint], width)
    return Joint(
        times=log.times,
        positions=log.positions[:, joint],
        digits=digits,
        shift=log.time_half_digit,
        limits=(velocity, acceleration, jerk),
        range=(low, high),
        logged=logged,
        others=limits.only([joint]).others,
    )


def _noise_quantile(samples: int) -> float:
    """Return the number of standard deviations that all samples keep, but for `NOISE_DOUBT`."""
    return NormalDist().inv_cdf(1 - NOISE_DOUBT / (2 * samples))


def _through(
    times: Array, positions: Array, half: Array, passing: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Return the tube with a point at each waypoint; it replaces a sample that is very near."""
    own_times, waypoints = passing
    near = 1e-3 * float(np.diff(times).min())
    apart = np.abs(times[:, None] - own_times).min(axis=1) > near
    narrow = np.full(len(own_times), max(_FLOOR, _WAYPOINT_SHARE * float(np.ptp(positions))))
    whole = np.concatenate([times[apart], own_times])
    order = np.argsort(whole, kind="stable")
    return (
        whole[order],
        np.concatenate([positions[apart], waypoints])[order],
        np.concatenate([half[apart], narrow])[order],
    )


def joined(chosen: Sequence[TubeAnswer], waypoint_times: Array) -> Trajectory | None:
    """Return the joints' motions as one trajectory; None where a joint has none."""
    from scipy.interpolate import PPoly

    if not all(np.isfinite(found.high) for found in chosen):
        return None
    pieces = []
    for found in chosen:
        own = PPoly.from_spline(found.spline())  # with empty pieces at both ends
        kept = np.diff(own.x) > 0
        breaks = np.append(own.x[:-1][kept], own.x[-1])
        pieces.append((breaks, own.c[:, kept]))
    try:
        return Trajectory.joined(pieces, waypoint_times)
    except InvalidTrajectory:  # breaks that differ by rounding only
        return None


def window_of(times: Array, values: Array, half: Array, limits: Array, order: int) -> float:
    """Return the shortest window, s, over which the samples exclude a mean excess of 5 %.

    It is infinite where they exclude it over no window.

    Args:
        times: s, `(samples,)`.
        values: Positions or velocities, `(samples, joints)`.
        half: Their half widths.
        limits: `(joints, 2)`, or at each sample `(samples, joints, 2)`, of which the tightest of a
            window counts.
        order: Order of the derivative of `values`.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    low, high = limits[..., 0], limits[..., 1]
    for size, mean, doubt, longest in means_over_windows(times, values, half, order):
        if limits.ndim == 3:
            low = _filtered(maximum_filter1d, limits[..., 0], size)
            high = _filtered(minimum_filter1d, limits[..., 1], size)
        if np.maximum((mean + doubt) / high, (mean - doubt) / low).max() <= 1 + EXCESS:
            return longest
    return float("inf")


def _filtered(extreme: Callable[..., Array], values: Array, size: int) -> Array:
    """Return the extreme value in each window of `size` samples."""
    found: Array = extreme(values, size, axis=0)
    return found[size // 2 :][: len(values) - size + 1]


def means_over_windows(
    times: Array, values: Array, half: Array, order: int
) -> Iterator[tuple[int, Array, Array, float]]:
    """Yield means of a derivative over longer and longer windows.

    A divided difference of samples is a mean of the derivative between them. It is known within a
    half width, from those of the samples, which is smaller for longer windows.

    Yields:
        The number of samples of a window, each window's mean and its half width, and the longest
        window, s.
    """
    stride = 1
    while order * stride < len(times):
        count = len(times) - order * stride
        at = np.stack([times[i * stride : i * stride + count] for i in range(order + 1)])
        mean = np.zeros((count, values.shape[1]))
        doubt = np.zeros((count, values.shape[1]))
        for i in range(order + 1):
            others = [at[i] - at[j] for j in range(order + 1) if j != i]
            weight = (factorial(order) / np.prod(others, axis=0))[:, None]
            part = slice(i * stride, i * stride + count)
            mean += weight * values[part]
            doubt += np.abs(weight) * half[part]
        yield order * stride + 1, mean, doubt, float((at[-1] - at[0]).max())
        stride = stride + 1 if stride < _MAX_STRIDE_BY_ONE else int(_STRIDE_GROWTH * stride)
