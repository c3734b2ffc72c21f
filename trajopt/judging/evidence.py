"""Tell from the samples of a log whether limits are broken, kept, or cannot be told.

A log has digits, rounded times and noise. So a position is known within a half width. There may be
a motion within these half widths that keeps the limits (`trajopt.judging.tube`), or a proof that
there is none (`trajopt.judging.tube_proof`). Three verdicts follow:

- `broken`: no motion within the half widths keeps the limits, which is proved;
- `kept`: a motion keeps them, and an excess of 5 % that lasts for the window would have shown;
- `cannot be told`: neither. The windows say for how long an excess of 5 % could hide.

Velocities that were logged beside positions have digits too, which tell far more of an acceleration
than those of positions do. Under `noise` they are left out: theirs is not known. So are velocities
with which every motion would use more than three times a limit that the positions allow to be kept:
they were measured or filtered apart from the positions, or are zeros in place of none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from statistics import NormalDist
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.limits import LIMIT_ORDERS, LimitName, Limits
from trajopt.core.limits import Limit as OtherLimit
from trajopt.core.limits.peaks import peak, ratio
from trajopt.core.trajectory import Trajectory
from trajopt.judging.tube import BROKEN_RTOL, Rates, TubeAnswer, slope, tube
from trajopt.judging.tube_proof import NO_READINGS, Limit, Readings, proved

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

Verdict = Literal["broken", "kept", "cannot be told"]

KEPT_RTOL = 1e-3
"""A motion that uses 1 + this share of its limits counts as one that keeps them."""
EXCESS = 0.05
"""A mean excess over a window that must show, as a share of the limit."""
DEFAULT_WINDOW_S = 0.1
NOISE_DOUBT = 1e-3
"""Probability that some sample's noise is larger than the half width of the tube."""

Positions = Callable[[Array], tuple[Array, Array]]
"""The lowest and highest positions at times, rad."""

_RATES: tuple[LimitName, ...] = ("velocity", "acceleration", "jerk")
_FLOOR = 1e-7  # rad, rad/s, least half width: narrower tubes are lost in rounding
DIGITS_WORTH: dict[LimitName, float] = {"velocity": 3.0, "acceleration": 12.0, "jerk": 24.0}
"""Largest change of a cubic spline's derivatives: this times half width / step**order."""
VELOCITY_WORTH: dict[LimitName, float] = {"velocity": 1.0, "acceleration": 6.0, "jerk": 12.0}
"""The same of cubic pieces between positions and velocities, by half a digit of the latter."""
_UNLIMITED: Limit = (-np.inf, np.inf)
_WAYPOINT_SHARE = 1e-7  # of a joint's span: half width at a waypoint, within what is repaired
_MAX_NARROWINGS = 4
_MISFIT = 3.0  # times a limit: velocities that need more than positions, which need less than 1
_MAX_STRETCHES = 5
_MAX_SLOWER = 1e4  # times as long: beyond that no motion is looked for
_SLOWER_RTOL = 5e-4  # between what a motion takes at least and at most
_LEAST_RATE = 1e-3  # of a velocity limit: no smaller one is asked for
_MAX_PASSAGES = 3  # samples that are tried as the passage of a waypoint
_SINGLE_ROUNDS = 2  # of knots added for one limit alone
_STRIDE_GROWTH = 1.25
_MAX_STRIDE_BY_ONE = 8


@dataclass(frozen=True, eq=False)
class Log:
    """Positions of joints at some times, and how well both are known.

    Attributes:
        times: Increasing from 0, s, `(samples,)`.
        positions: rad (m for a prismatic joint), `(samples, joints)`.
        half_digits: Half a unit of the last digit of each position, rad, `(samples, joints)`.
        time_half_digit: The same of the times, s; 0 where they are exact.
        decimals: Of each joint's column, in its unit.
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


@dataclass(frozen=True)
class Told:
    """What is known of one kind of limit: shares of it, of the joint with the largest one.

    Attributes:
        at_least: Every motion within the half widths uses this share.
        uses: The motion uses this share; None where no motion was found.
        spline: The cubic spline through the samples, at rest at both ends, uses this share.
        digits_alone: The half widths change a cubic spline by at most this share.
        window: The shortest window, s, in which no mean excess of 5 % can hide; or infinite.
        joint: The joint of `at_least`, counted from 0.
        by_joint: `at_least` of each joint; None without such a limit.
    """

    at_least: float
    uses: float | None
    spline: float
    digits_alone: float
    window: float
    joint: int
    by_joint: tuple[float | None, ...]


@dataclass(frozen=True)
class Conviction:
    """A proof that a joint breaks its limits.

    Attributes:
        joint: Counted from 0.
        at_least: Share of the limits that every motion within the half widths uses; for a position
            limit, how far beyond it the joint is at least, rad.
        limit: The limit that alone needs that; None where it takes all of them together.
        start, end: The times between which the proof lives, s.
    """

    joint: int
    at_least: float
    limit: str | None
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class Slower:
    """The samples of a broken log, passed at their own spacing in time but more slowly.

    Attributes:
        at_least: Every lawful motion within the half widths takes so many times as long.
        factor: The motion takes so many times as long as the log.
        motion: It keeps the limits.
    """

    at_least: float
    factor: float
    motion: Trajectory


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a log tells.

    Attributes:
        verdict: One of three.
        limits: By kind, without kinds that no joint has.
        motion: The motion within the half widths that uses the least of the limits; None where
            none was found.
        at_rest: Whether that motion rests at both ends; if not, the log was cut.
        convictions: Of each joint the strongest proof; none unless the verdict is `broken`.
        log: The samples.
        noise: The standard deviation that was given, rad; 0 for digits alone.
        window: The window that was asked for, s.
        by_positions: The verdict without the velocities, where these are part of the proof.
        slower: For a broken log, the shortest lawful motion through its samples that was found.
        misfit: Why the velocities were left out: with them every motion would break a limit far,
            by the positions none needs to. They are not the positions' own.
    """

    verdict: Verdict
    limits: dict[str, Told]
    motion: Trajectory | None
    at_rest: bool
    convictions: Sequence[Conviction]
    log: Log
    noise: float
    window: float
    by_positions: Verdict | None = None
    slower: Slower | None = None
    misfit: Conviction | None = None

    @property
    def conviction(self) -> Conviction | None:
        """The strongest proof; None unless the verdict is `broken`."""
        return self.convictions[0] if self.convictions else None

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON: SI units, joints count from 1, None for what does not exist."""
        table: dict[str, Any] = {
            "verdict": self.verdict,
            "digits": list(self.log.decimals),
            "time_half_digit": self.log.time_half_digit,
            "samples": len(self.log.times),
            "noise": self.noise,
            "asked_window": self.window,
            "at_rest": self.at_rest,
            "by_positions": self.by_positions,
        }
        for name, told in self.limits.items():
            table[name] = {**vars(told), "joint": told.joint + 1}
        broken = [{**vars(own), "joint": own.joint + 1} for own in self.convictions]
        table["conviction"] = broken[0] if broken else None
        table["convictions"] = broken
        table["misfit"] = self.misfit and {**vars(self.misfit), "joint": self.misfit.joint + 1}
        slower = self.slower
        table["slower"] = slower and {"at_least": slower.at_least, "factor": slower.factor}
        return table


def evidence(
    log: Log,
    limits: Limits,
    *,
    noise: float = 0.0,
    window: float = DEFAULT_WINDOW_S,
    accelerations: Sequence[bool] = (),
) -> Evidence:
    """Return what a log tells about limits.

    Args:
        log: Its samples.
        limits: Of its joints. Where segments differ, the widest counts.
        noise: Standard deviation of independent normal noise of the positions, rad.
        window: A mean excess of 5 % over this window must show for `kept`, s.
        accelerations: Whether each joint's acceleration is judged; by default all are.
    """
    limits = limits.in_all_segments(tightest=False)
    joints = _joints(log, limits, noise, accelerations)
    resting = [own.found(rest=True) for own in joints]
    moving = list(resting)
    for joint, (own, found) in enumerate(zip(joints, resting, strict=True)):
        if found.high > 1 + KEPT_RTOL:
            moving[joint] = own.found(rest=False)
    pairs = list(zip(resting, moving, strict=True))
    at_rest = all(rest.high <= max(1.0, free.high) * (1 + KEPT_RTOL) for rest, free in pairs)
    chosen = resting if at_rest else moving
    singles = [own.singles() for own in joints]
    lows = [max(pair, key=lambda found: found.low) for pair in pairs]
    convictions = _convictions(joints, lows, singles)
    motion = _joined(chosen, log.times[[0, -1]])
    told = dict(_told(log, limits, joints, singles, motion))
    verdict: Verdict = "cannot be told"
    if convictions:
        verdict = "broken"
    elif max(found.high for found in chosen) <= 1 + KEPT_RTOL and not any(
        len(own.beyond_between(found)) for own, found in zip(joints, chosen, strict=True)
    ):
        shown = all(own.window <= window for own in told.values())
        verdict = "kept" if shown else "cannot be told"
    by_positions = None
    if verdict == "broken" and any(len(own.readings.times) for own in joints):
        positions = replace(log, velocities=None)
        alone = evidence(positions, limits, window=window, accelerations=accelerations)
        by_positions = alone.verdict
        if by_positions != "broken" and convictions[0].at_least > _MISFIT:
            return replace(alone, misfit=convictions[0])
    slower = _slower(joints, lows, at_rest) if verdict == "broken" else None
    return Evidence(
        verdict, told, motion, at_rest, convictions, log, noise, window, by_positions, slower
    )


def passing(found: Evidence, limits: Limits, times: Array, waypoints: Array) -> Evidence:
    """Return the evidence with a motion that passes waypoints, if one within the digits does.

    A waypoint that the motion misses by more than a digit is not passed. All joints pass a waypoint
    at one time, which the digits blur: samples that are the waypoint but for their digits are tried
    too, the nearest first.

    Args:
        found: Of a log that was not cut.
        limits: Of its joints.
        times: About when the waypoints are passed, from the log's first time to its last, s.
        waypoints: rad, `(waypoints, joints)`.
    """
    log = found.log
    joints = _joints(log, limits.in_all_segments(tightest=False), found.noise, ())
    digits = np.stack([own.digits for own in joints], axis=1)
    if (
        found.motion is None
        or (np.abs(found.motion(times) - waypoints) > 2 * np.median(digits, axis=0)).any()
    ):
        return found
    best = _through_all(joints, times, waypoints)
    for index in range(1, len(times) - 1):
        near = (np.abs(log.positions - waypoints[index]) <= digits).all(axis=1)
        alike = log.times[near]
        nearest = np.argsort(np.abs(alike - times[index]))[:_MAX_PASSAGES]
        for time in alike[nearest]:
            own = np.array(best.times)
            own[index] = time
            if best.high > 1 and (np.diff(own) > 0).all():
                best = min(best, _through_all(joints, own, waypoints), key=lambda one: one.high)
    motion = _joined(best.joints, best.times)
    return found if motion is None else replace(found, motion=motion)


@dataclass(frozen=True, eq=False)
class _Through:
    """The joints' motions through waypoints at these times."""

    times: Array
    joints: Sequence[TubeAnswer]

    @property
    def high(self) -> float:
        return max(found.high for found in self.joints)


def _through_all(joints: Sequence[_Joint], times: Array, waypoints: Array) -> _Through:
    columns = zip(joints, waypoints.T, strict=True)
    return _Through(times, [own.found(rest=True, passing=(times, q)) for own, q in columns])


@dataclass(frozen=True, eq=False)
class _Conditions:
    """What a joint's motion must keep, beside its constant limits.

    Attributes:
        half: Of each sample, rad.
        readings: The velocities that are known.
        rates: Limits of the velocity that depend on the time.
        turns: Times between samples at which the position limits count, s.
    """

    half: Array
    readings: Readings
    rates: Rates | None
    turns: Array


def _along(spline: BSpline) -> Positions:
    """The positions of a motion, lowest and highest."""

    def at(times: Array) -> tuple[Array, Array]:
        positions = spline(times)
        return positions, positions

    return at


@dataclass(frozen=True, eq=False)
class _Joint:
    """One joint's samples.

    Attributes:
        limits: Of velocity, acceleration and jerk, infinite where there is none.
        range: Its position limits, rad.
        digits: Half width of each position, rad.
        shift: Half width of each time, s.
        logged: The velocities with their digits.
        others: Limits of other kinds, of this joint alone: some bound its velocity by its position.
        stretch: How many times as long the motion may take: its derivatives are as much larger.
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

    def stretched(self, factor: float) -> _Joint:
        """The same samples, without velocities, where a motion takes so many times as long."""
        wider = [
            (low * factor**order, high * factor**order)
            for order, (low, high) in enumerate(self.limits, start=1)
        ]
        velocity, acceleration, jerk = wider
        limits = (velocity, acceleration, jerk)
        return replace(self, limits=limits, logged=NO_READINGS, stretch=factor)

    @property
    def half(self) -> Array:
        """Half width at the stated times: a motion within its limits moves so far meanwhile."""
        low, high = self.limits[0]
        return self.digits + self.shift * max(-low, high)

    @cached_property
    def readings(self) -> Readings:
        """The velocities at the stated times; none where these are blurred without a limit."""
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
        """The motion that uses the least of all limits, and the bound."""
        limits = list(self.limits)
        while not np.isfinite(limits[-1][1]):
            limits.pop()
        if len(limits) == 1:  # a velocity does not jump: a spline of degree 2, nearly unlimited
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
            # Only the positions between samples are a condition of every motion.
            proves = hits and not falling and narrower.low > found.low
            better = narrower if proves else found
            found = replace(narrower, low=better.low, proof=better.proof)
        if not self._hits(found):
            return replace(found, high=np.inf)
        return replace(found, high=max(found.high, self._use_of(found, falling)))

    def _narrowed(self, own: _Conditions, spline: BSpline) -> _Conditions:
        """The tube where a motion moves less than its limit allows: it is narrower there."""
        speed = np.abs(spline(self.times, nu=1))
        half = np.minimum(own.half, self.digits + self.shift * speed)
        readings = own.readings
        if len(readings.times):
            bend = np.abs(spline(readings.times, nu=2))
            width = np.minimum(readings.half, self.logged.half + self.shift * bend)
            readings = replace(readings, half=width)
        return replace(own, half=half, readings=readings)

    def beyond_between(self, found: TubeAnswer) -> Array:
        """Times between samples at which a motion turns beyond the position limits, s."""
        low, high = self.range
        inside = (found.coefficients >= low - _FLOOR) & (found.coefficients <= high + _FLOOR)
        # A spline is between its coefficients; a sample beyond the limits is another fault.
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
        """The keys of the other limits that bound the velocity by the position."""
        at = self.positions
        return [
            key
            for key, own in self.others.items()
            if np.isfinite(own.velocities(0, at, at)).any() and np.isfinite(self.limits[0][1])
        ]

    def reach(self, times: Array) -> tuple[Array, Array]:
        """The lowest and highest position that a motion within twice its limits has at times.

        Between samples it leaves the straight line by at most `V h / 2` and `A h² / 8`.
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
        """The velocity's limits at times, with those of other limits, where these say anything."""
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
        """The exact use of other limits by a motion."""
        if not keys or not np.isfinite(found.high):
            return 0.0
        motion = _joined([found], self.times[[0, -1]])
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
        """The tube, narrowed to the position limits where it does not lie outside of them.

        Where a motion turned beyond them the whole range is one point more of the tube.
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
        wide = float(np.ptp(self.positions)) + 1.0  # in place of a side without a limit
        low = max(low, float(self.positions.min()) - wide)
        high = min(high, float(self.positions.max()) + wide)
        times = np.concatenate([self.times, own.turns])
        order = np.argsort(times, kind="stable")
        centre = np.append(centre, np.full(len(own.turns), (low + high) / 2))
        half = np.append(half, np.full(len(own.turns), (high - low) / 2 * (1 - 1e-8)))
        return times[order], centre[order], half[order]

    def _hits(self, found: TubeAnswer) -> bool:
        """Return whether the motion meets each sample at some time that rounds to its stamp."""
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
        """The share of each limit that every motion uses, if it had no other limit."""
        half = self.half
        shares: dict[str, float] = {}
        for order, (name, limit) in enumerate(zip(_RATES, self.limits, strict=True)):
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
        """The share of velocities that positions bound which a mean over some window uses."""
        from scipy.ndimage import maximum_filter1d, minimum_filter1d

        low, high = limit.velocities(0, *self.reach(self.times))
        share = 0.0
        positions, half = self.positions[:, None], self.half[:, None]
        for size, mean, doubt, _ in _means(self.times, positions, half, 1):
            lowest = _filtered(minimum_filter1d, low, size)
            highest = _filtered(maximum_filter1d, high, size)
            with np.errstate(divide="ignore", invalid="ignore"):
                up = (mean - doubt)[:, 0] / highest
                down = (mean + doubt)[:, 0] / lowest
            share = max(share, float(np.nanmax(np.maximum(up, down))))
        return share

    def slope(self) -> tuple[float, float, float]:
        """The share of the velocity limit that every motion uses, and from when to when, s."""
        steepest = slope(self.times, self.positions, self.half, self.limits[0])
        low, high = self.limits[0]
        read = self.readings
        if not len(read.times):
            return steepest
        shares = np.maximum((read.values - read.half) / high, (read.values + read.half) / low)
        time = float(read.times[np.argmax(shares)])
        return max(steepest, (float(shares.max()), time, time))


def _joints(log: Log, limits: Limits, noise: float, accelerations: Sequence[bool]) -> list[_Joint]:
    judged = accelerations or [True] * log.positions.shape[1]
    return [_joint(log, limits, noise, joint, own) for joint, own in enumerate(judged)]


def _joint(log: Log, limits: Limits, noise: float, joint: int, judged: bool) -> _Joint:
    digits = np.maximum(log.half_digits[:, joint], _FLOOR)
    if noise:
        digits = digits + noise * _noise_quantile(log.positions.size)
    own: list[Limit] = []
    for name in _RATES:
        low, high = map(float, limits.by_name()[name][joint])
        known = np.isfinite([low, high]).all() and (judged or name != "acceleration")
        own.append((low, high) if known else _UNLIMITED)
    velocity, acceleration, jerk = own
    low, high = map(float, limits.position[joint])
    logged = NO_READINGS
    if log.velocities is not None and log.velocity_half_digits is not None and not noise:
        width = np.maximum(log.velocity_half_digits[:, joint], _FLOOR)
        logged = Readings(log.times, log.velocities[:, joint], width)
    return _Joint(
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
    """Standard deviations within which all samples are but with probability `NOISE_DOUBT`."""
    return NormalDist().inv_cdf(1 - NOISE_DOUBT / (2 * samples))


def _through(
    times: Array, positions: Array, half: Array, passing: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """The tube with a point at each waypoint, in place of a sample that is very near."""
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


def _convictions(
    joints: Sequence[_Joint], lows: Sequence[TubeAnswer], singles: Sequence[dict[str, float]]
) -> list[Conviction]:
    """The joints that break limits, proved in rational numbers: position limits, then the most."""
    convictions: list[Conviction] = []
    for joint, (own, found, alone) in enumerate(zip(joints, lows, singles, strict=True)):
        of_joint: list[Conviction] = []
        beyond = own.beyond
        farthest = int(np.argmax(beyond))
        share, start, end = own.slope()
        if share > 1 + BROKEN_RTOL:
            of_joint.append(Conviction(joint, share, "velocity", start, end))
        if found.low > 1 + BROKEN_RTOL and found.proof is not None:
            least = float(proved(found.proof))
            highest = max(alone, key=lambda name: alone[name])
            limit = highest if alone[highest] > 1 else None
            if least > 1:
                of_joint.append(Conviction(joint, least, limit, *found.span))
        if beyond[farthest] > 0:
            time = float(own.times[farthest])
            convictions.append(Conviction(joint, float(beyond[farthest]), "position", time, time))
        elif of_joint:
            convictions.append(max(of_joint, key=lambda one: one.at_least))
    return sorted(convictions, key=lambda one: (one.limit != "position", -one.at_least))


def _slower(joints: Sequence[_Joint], lows: Sequence[TubeAnswer], at_rest: bool) -> Slower | None:
    """The shortest lawful motion through the samples at their own spacing; None if none is found.

    The joint that needs the longest decides. All are asked in the order of what they need.
    """
    at_least, factor = 1.0, 1.0
    for joint in sorted(range(len(joints)), key=lambda joint: -lows[joint].low):
        own = joints[joint]
        if own.beyond.max() > 0 or lows[joint].low > _MAX_SLOWER:
            return None
        if own.stretched(factor).found(at_rest).high <= 1:
            continue
        # A motion takes at least the r-th root of its use as long, and at most as long as that.
        order = max(k for k, (_, high) in enumerate(own.limits, start=1) if np.isfinite(high))
        low = max(1.0, lows[joint].low ** (1 / order))
        high = max(factor, lows[joint].low) * (1 + KEPT_RTOL)
        for _ in range(_MAX_STRETCHES):
            if own.stretched(high).found(at_rest).high <= 1:
                break
            high *= 1 + 0.1 * high
        else:
            return None
        while high / low > 1 + _SLOWER_RTOL:
            middle = float(np.sqrt(low * high))
            found = own.stretched(middle).found(at_rest)
            if found.high <= 1:
                high = middle
            elif found.low > 1:
                low = middle
            else:
                break
        at_least, factor = max(at_least, low), max(factor, high)
    motion = _joined(
        [own.stretched(factor).found(at_rest) for own in joints], joints[0].times[[0, -1]]
    )
    return None if motion is None else Slower(at_least, factor, motion.dilated(factor))


def _joined(chosen: Sequence[TubeAnswer], waypoint_times: Array) -> Trajectory | None:
    """The joints' motions as one trajectory; None where there is none, or none in floats."""
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
    except InvalidTrajectory:  # of times that differ by their rounding
        return None


def _told(
    log: Log,
    limits: Limits,
    joints: Sequence[_Joint],
    singles: Sequence[dict[str, float]],
    motion: Trajectory | None,
) -> Iterator[tuple[str, Told]]:
    step = float(np.median(np.diff(log.times)))
    spline = Trajectory.from_samples(log.times, log.positions, interpolation="spline")
    widths = np.stack([own.half for own in joints], axis=1)
    for name in _RATES:
        known = [joint for joint, own in enumerate(singles) if name in own]
        if not known:
            continue
        order = LIMIT_ORDERS[name]
        bounds = limits.by_name()[name][known]
        positions, half = log.positions[:, known], widths[:, known]
        least = max(known, key=lambda joint: singles[joint][name])
        window = _window(log.times, positions, half, bounds, order)
        if order > 1 and all(len(own.readings.times) for own in joints):
            readings = [joints[joint].readings for joint in known]
            values = np.stack([own.values for own in readings], axis=1)
            doubt = np.stack([own.half for own in readings], axis=1)
            window = min(window, _window(log.times, values, doubt, bounds, order - 1))
        worth = DIGITS_WORTH[name] * np.median(half, axis=0) / step**order
        yield (
            name,
            Told(
                at_least=max(0.0, singles[least][name]),
                uses=None if motion is None else _use(motion, order, known, bounds),
                spline=_use(spline, order, known, bounds),
                digits_alone=float((worth / np.abs(bounds).min(axis=1)).max()),
                window=window,
                joint=least,
                by_joint=tuple(own.get(name) for own in singles),
            ),
        )

    for key, own in limits.others.items():
        known = [joint for joint, single in enumerate(singles) if key in single]
        if not known:
            continue
        least = max(known, key=lambda joint: singles[joint][key])
        found = [_falling(joints[joint], own, joint, step) for joint in known]
        yield (
            key,
            Told(
                at_least=max(0.0, singles[least][key]),
                uses=None if motion is None else own.worst(motion).value,
                spline=own.worst(spline).value,
                digits_alone=max(worth for worth, _ in found),
                window=max(window for _, window in found),
                joint=least,
                by_joint=tuple(single.get(key) for single in singles),
            ),
        )


def _falling(joint: _Joint, limit: OtherLimit, index: int, step: float) -> tuple[float, float]:
    """What digits are worth of a velocity that positions bound, and the window for it.

    Digits count where the joint moves by more than its own.
    """
    reach = joint.reach(joint.times)
    low, high = limit.velocities(index, *reach)
    low, high = np.minimum(low, -1e-9), np.maximum(high, 1e-9)
    moved = np.diff(joint.positions)
    towards = np.where(moved > 0, high[1:], -low[1:])
    moving = np.abs(moved) > 2 * joint.half[1:]
    worth = DIGITS_WORTH["velocity"] * joint.half[1:] / step / towards
    bounds = np.stack([low, high], axis=1)[:, None]
    window = _window(joint.times, joint.positions[:, None], joint.half[:, None], bounds, 1)
    return float(worth[moving].max(initial=0.0)), window


def _use(trajectory: Trajectory, order: int, joints: Sequence[int], limits: Array) -> float:
    own = replace(trajectory, coefficients=trajectory.coefficients[..., joints])
    return float(peak(own, order, limits, ratio).value)


def _window(times: Array, values: Array, half: Array, limits: Array, order: int) -> float:
    """The shortest window in which no mean of a derivative beyond 1.05 of its limit can hide.

    Args:
        times: s, `(samples,)`.
        values: Positions, or velocities, whose derivatives count from theirs, `(samples, joints)`.
        half: Their half widths.
        limits: `(joints, 2)`; or those at each sample, `(samples, joints, 2)`, of which the
            narrowest of a window counts.
        order: Of the derivative.
    """
    from scipy.ndimage import maximum_filter1d, minimum_filter1d

    low, high = limits[..., 0], limits[..., 1]
    for size, mean, doubt, longest in _means(times, values, half, order):
        if limits.ndim == 3:
            low = _filtered(maximum_filter1d, limits[..., 0], size)
            high = _filtered(minimum_filter1d, limits[..., 1], size)
        if np.maximum((mean + doubt) / high, (mean - doubt) / low).max() <= 1 + EXCESS:
            return longest
    return float("inf")


def _filtered(extreme: Callable[..., Array], values: Array, size: int) -> Array:
    """The extreme of each window of so many samples."""
    found: Array = extreme(values, size, axis=0)
    return found[size // 2 :][: len(values) - size + 1]


def _means(
    times: Array, values: Array, half: Array, order: int
) -> Iterator[tuple[int, Array, Array, float]]:
    """Means of a derivative over longer and longer windows.

    A divided difference over samples is a mean of the derivative between them; digits leave a doubt
    about it, which is smaller the longer the window is.

    Yields:
        How many samples a window has, each window's mean and doubt, and the longest window, s.
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
