"""One joint of a log: the motions that its samples allow, and the share of limits that they use.

A log has rounded positions and times, and noise. So each position is known within a half width
(`trajopt.judging.premise`). `Joint.bounds` are what a few rows prove of each limit
(`trajopt.judging.log_windows`). `Joint.found` returns the motion within the half widths that uses
the smallest share of the limits, and a lower bound on the share that every such motion uses
(`trajopt.judging.tube`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from typing import TYPE_CHECKING

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.limits import Limit as OtherLimit
from trajopt.core.limits import LimitName, Limits
from trajopt.core.trajectory import Trajectory
from trajopt.judging import log_velocities, log_windows, premise
from trajopt.judging.log_velocities import NO_READINGS, Readings
from trajopt.judging.log_windows import WindowBound
from trajopt.judging.premise import LEAST_HALF, Premise
from trajopt.judging.tube import Rates, TubeAnswer, slope, tube
from trajopt.judging.tube_proof import Limit

if TYPE_CHECKING:
    from scipy.interpolate import BSpline

RATES: tuple[LimitName, ...] = ("velocity", "acceleration", "jerk")

Positions = Callable[[Array], tuple[Array, Array]]
"""A function of times that returns the lowest and the highest possible position, rad."""

_UNLIMITED: Limit = (-np.inf, np.inf)
_WAYPOINT_SHARE = 1e-7  # half width at a waypoint, relative to the joint's span; repair corrects it
_MAX_NARROWINGS = 4
_LEAST_RATE = 1e-3  # least velocity limit at any time, relative to the constant one
_LEAST_VELOCITY = 1e-9  # least velocity limit at any position, rad/s
_SINGLE_ROUNDS = 2  # rounds of adding knots, for one limit alone


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
        commanded: Whether the positions were sent, not measured.
        turns: For each joint the rows after which a whole turn was removed.
    """

    times: Array
    positions: Array
    half_digits: Array
    time_half_digit: float = 0.0
    decimals: Sequence[int] = ()
    velocities: Array | None = None
    velocity_half_digits: Array | None = None
    commanded: bool = False
    turns: Sequence[Sequence[int]] = ()


@dataclass(frozen=True, eq=False)
class _Conditions:
    """Conditions on a joint's motion, beside its constant limits.

    Attributes:
        half: Half width of each sample, rad.
        rates: Velocity limits that depend on the time.
        turns: Times between samples at which the position limits are imposed, s.
    """

    half: Array
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
        known: How accurately its positions are known.
        shift: Half width of each time, s.
        limits: Of velocity, acceleration and jerk; infinite where there is none.
        range: Position limits, rad.
        others: Limits of other kinds for this joint; some bound its velocity at each position.
        readings: Logged velocities that are evidence of their own.
        no_readings: Why the logged velocities are none; empty without any.
        stretch: Factor by which the motion is slowed down. The samples keep their times, and the
            limits are those of the motion before it is slowed down, so they are wider.
    """

    known: Premise
    shift: float
    limits: tuple[Limit, Limit, Limit]
    range: Limit
    others: Mapping[str, OtherLimit]
    readings: Readings = NO_READINGS
    no_readings: str = ""
    stretch: float = 1.0

    @property
    def times(self) -> Array:
        """Times of the samples, s."""
        return self.known.times

    @property
    def positions(self) -> Array:
        """Their positions, rad."""
        return self.known.positions

    @property
    def digits(self) -> Array:
        """Half width of each position at its true time, rad."""
        return self.known.half

    def stretched(self, factor: float) -> Joint:
        """Return the samples for a motion that is slowed down by a factor."""
        wider = [
            (low * factor**order, high * factor**order)
            for order, (low, high) in enumerate(self.limits, start=1)
        ]
        velocity, acceleration, jerk = wider
        return replace(self, limits=(velocity, acceleration, jerk), stretch=factor)

    @property
    def half(self) -> Array:
        """Half width at the stated times, rad.

        A stated time is off by up to `shift`, in which the joint moves at most `shift V`.
        """
        return self.digits + (self.shift * max(map(abs, self.limits[0])) if self.shift else 0.0)

    @property
    def beyond(self) -> Array:
        """Return the least distance of each sample beyond the position limits, rad."""
        low, high = self.range
        return np.maximum(low - self.positions, self.positions - high) - self.digits

    @property
    def place(self) -> float | None:
        """Return a position at which the joint may stand all the time, rad; None if it moves."""
        low, high = self.range
        lowest = max(float((self.positions - self.half).max()), low)
        highest = min(float((self.positions + self.half).min()), high)
        return (lowest + highest) / 2 if lowest <= highest else None

    def may_rest(self, share: float) -> bool:
        """Return whether the samples allow rest at both ends, with a share of the limits.

        From rest a joint moves by at most V t, A t² / 2 and J t³ / 6.
        """
        for sign in (1, -1):
            since = np.abs(self.times - self.times[::sign][0])
            reach = np.full(len(since), np.inf)
            for order, limit in enumerate(self.limits, start=1):
                size = max(1.0, share) * max(map(abs, limit))
                if np.isfinite(size):
                    reach = np.minimum(reach, size * since**order / factorial(order))
            first = 0 if sign == 1 else -1
            moved = np.abs(self.positions - self.positions[first])
            if (moved > reach + self.half + self.half[first]).any():
                return False
        return True

    def still(self) -> TubeAnswer | None:
        """Return the motion that stands; None if the joint moves."""
        place = self.place
        if place is None:
            return None
        degree = 3 if np.isfinite(self.limits[2][1]) else 2
        knots = np.repeat(self.times[[0, -1]], degree + 1)
        return TubeAnswer(0.0, 0.0, degree, knots, np.full(degree + 1, place), None)

    def found(self, rest: bool, passing: tuple[Array, Array] | None = None) -> TubeAnswer:
        """Return the motion that uses the smallest share of the limits, and the lower bound."""
        limits = list(self.limits)
        while not np.isfinite(limits[-1][1]):
            limits.pop()
        if len(limits) == 1:  # velocity is continuous: degree 2, a very wide acceleration limit
            steep = 100 * max(self.limits[0]) / float(np.median(np.diff(self.times)))
            limits.append((-steep, steep))
        falling = self.falling()
        conditions = _Conditions(self.half, self._rates(self.reach, falling), np.zeros(0))
        found = self._solved(conditions, limits, rest, passing)
        for _ in range(_MAX_NARROWINGS):
            beyond = self.beyond_between(found)
            hits, use = self._hits(found), self._use_of(found, falling)
            kept = hits and not len(beyond) and use <= max(1.0, found.high)
            if kept or not np.isfinite(found.high):
                return found
            spline = found.spline()
            if not hits:
                conditions = self._narrowed(conditions, spline)
            rates = self._rates(_along(spline), falling)
            conditions = replace(
                conditions, rates=rates, turns=np.union1d(conditions.turns, beyond)
            )
            narrower = self._solved(conditions, limits, rest, passing)
            # A narrower tube, or rates along one motion, hold for that motion only. The position
            # limits between samples hold for every motion: only with these the bound is a proof.
            proves = hits and not falling and narrower.low > found.low
            better = narrower if proves else found
            found = replace(narrower, low=better.low, proof=better.proof)
        if not self._hits(found):
            return replace(found, high=np.inf)
        return replace(found, high=max(found.high, self._use_of(found, falling)))

    def _narrowed(self, conditions: _Conditions, spline: BSpline) -> _Conditions:
        """Return narrower half widths, where this motion is slower than its limit allows."""
        speed = np.abs(spline(self.times, nu=1))
        half = np.minimum(conditions.half, self.digits + self.shift * speed)
        return replace(conditions, half=half)

    def beyond_between(self, found: TubeAnswer) -> Array:
        """Return times between samples at which the motion turns beyond its position limits, s."""
        low, high = self.range
        inside = (found.coefficients >= low - LEAST_HALF) & (
            found.coefficients <= high + LEAST_HALF
        )
        # A spline stays within the range of its coefficients. Samples beyond the limits are
        # reported elsewhere.
        if inside.all() or not np.isfinite(found.high) or self.beyond.max() > 0:
            return np.zeros(0)
        from scipy.interpolate import PPoly

        spline = found.spline()
        turns = PPoly.from_spline(spline.derivative()).roots(extrapolate=False)
        turns = turns[np.isfinite(turns)]
        positions = spline(turns)
        beyond: Array = turns[
            (positions < low - LEAST_HALF / 10) | (positions > high + LEAST_HALF / 10)
        ]
        return beyond

    def falling(self) -> list[str]:
        """Return the keys of the limits that bound the velocity at each position."""
        at = self.positions
        return [
            key
            for key, limit in self.others.items()
            if np.isfinite(limit.velocities(0, at, at)).any() and np.isfinite(self.limits[0][1])
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
        conditions: _Conditions,
        limits: Sequence[Limit],
        rest: bool,
        passing: tuple[Array, Array] | None,
    ) -> TubeAnswer:
        points = self._inside(conditions)
        if passing is not None:
            points = _through(*points, passing)
        return tube(*points, limits, rest=rest, rates=conditions.rates)

    def _inside(self, conditions: _Conditions) -> tuple[Array, Array, Array]:
        """Return times, centres and half widths of the tube, cut off at the position limits.

        A sample outside the limits keeps its half width. At the times `turns`, where a motion
        turned beyond the limits, the tube is as wide as the range.
        """
        low, high = self.range
        half = conditions.half
        lowest = np.maximum(self.positions - half, low)
        highest = np.minimum(self.positions + half, high)
        fits = highest - lowest > 0.1 * half
        centre = np.where(fits, (lowest + highest) / 2, self.positions)
        half = np.where(fits, (highest - lowest) / 2, half)
        if not len(conditions.turns):
            return self.times, centre, half
        wide = float(np.ptp(self.positions)) + 1.0  # for sides without a position limit
        low = max(low, float(self.positions.min()) - wide)
        high = min(high, float(self.positions.max()) + wide)
        times = np.concatenate([self.times, conditions.turns])
        order = np.argsort(times, kind="stable")
        centre = np.append(centre, np.full(len(conditions.turns), (low + high) / 2))
        half = np.append(half, np.full(len(conditions.turns), (high - low) / 2 * (1 - 1e-8)))
        return times[order], centre[order], half[order]

    def _hits(self, found: TubeAnswer) -> bool:
        """Return whether the motion passes each sample within `shift` of its stated time."""
        if not self.shift or not np.isfinite(found.high):
            return True
        ends = self.times[[0, -1]]
        shifted = self.times + self.shift * np.array([[-1.0], [0.0], [1.0]])
        passed = found.spline()(np.clip(shifted, *ends))
        slack = self.digits * (1 + 1e-6)
        above = passed.min(axis=0) <= self.positions + slack
        below = passed.max(axis=0) >= self.positions - slack
        return bool((above & below).all())

    @cached_property
    def by_positions(self) -> dict[str, WindowBound]:
        """Return what windows of positions prove of each limit."""
        found: dict[str, WindowBound] = {}
        for order, (name, (low, high)) in enumerate(zip(RATES, self.limits, strict=True), start=1):
            if np.isfinite(high):
                found[name] = self._bound(low, high, order)
        if "velocity" in found:
            found["velocity"] = self._steepest(found["velocity"])
        for key in self.falling():
            found[key] = self._bound(*self.velocities(key), 1)
        return found

    def velocities(self, key: str) -> tuple[Array, Array]:
        """Return a limit that depends on the position, at the samples: low < 0 and high > 0."""
        low, high = self.others[key].velocities(0, *self.reach(self.times))
        return np.minimum(low, -_LEAST_VELOCITY), np.maximum(high, _LEAST_VELOCITY)

    @cached_property
    def bounds(self) -> dict[str, WindowBound]:
        """Return what windows of positions and of velocities prove of each limit."""
        found = dict(self.by_positions)
        read = self.readings
        for order, (name, (low, high)) in enumerate(zip(RATES, self.limits, strict=True)):
            if len(read.times) and name in found:
                window = log_windows.bound(read.times, read.values, read.half, low, high, order)
                window = replace(window, of_velocities=True)
                found[name] = log_windows.best([found[name], window])
        return found

    def _bound(self, low: float | Array, high: float | Array, order: int) -> WindowBound:
        return log_windows.bound(self.times, self.positions, self.half, low, high, order)

    def _steepest(self, window: WindowBound) -> WindowBound:
        """Return the bound on the velocity by the steepest pair of all samples."""
        share, *at = slope(self.times, self.positions, self.half, self.limits[0])
        if share <= window.share:
            return window
        rows = tuple(int(np.searchsorted(self.times, time)) for time in at)
        return replace(window, share=share, rows=rows)

    def alone(self, name: str) -> TubeAnswer:
        """Return the tube's answer with one limit of `RATES` alone."""
        order = RATES.index(name)
        limits = [*[_UNLIMITED] * order, self.limits[order]]
        return tube(self.times, self.positions, self.half, limits, rounds=_SINGLE_ROUNDS)


def joints_of(
    log: Log,
    limits: Limits,
    accelerations: Sequence[bool] = (),
    *,
    noise: float | None = None,
    resolution: float | None = None,
) -> list[Joint]:
    """Return the joints of a log, and how accurately the positions of each are known.

    Args:
        log: The samples.
        limits: Of its joints, the same in all segments.
        accelerations: Whether each joint's acceleration is judged; by default all are.
        noise: Standard deviation of the positions' noise, rad, if it is known.
        resolution: Step of the sensors, rad, if it is known.
    """
    judged = accelerations or [True] * log.positions.shape[1]
    return [
        _joint(log, limits, joint, is_judged, noise, resolution)
        for joint, is_judged in enumerate(judged)
    ]


def premise_of(
    log: Log,
    joint: int,
    limits: Sequence[Limit],
    noise: float | None = None,
    resolution: float | None = None,
) -> Premise:
    """Return how accurately the positions of a joint are known (`trajopt.judging.premise`)."""
    samples = log.times, log.positions[:, joint], log.half_digits[:, joint]
    if log.commanded:
        return premise.commanded(*samples)
    return premise.measured(*samples, limits, log.positions.size, noise, resolution)


def _joint(
    log: Log,
    limits: Limits,
    joint: int,
    judged: bool,
    noise: float | None,
    resolution: float | None,
) -> Joint:
    pairs: list[Limit] = []
    for name in RATES:
        low, high = map(float, limits.by_name()[name][joint])
        known = np.isfinite([low, high]).all() and (judged or name != "acceleration")
        pairs.append((low, high) if known else _UNLIMITED)
    velocity, acceleration, jerk = pairs
    count = log.positions.size
    known_to = premise_of(log, joint, pairs, noise, resolution)
    low, high = map(float, limits.position[joint])
    found = Joint(
        known=known_to,
        shift=log.time_half_digit,
        limits=(velocity, acceleration, jerk),
        range=(low, high),
        others=limits.only([joint]).others,
    )
    stands = not np.ptp(log.positions[:, joint])
    if log.velocities is None or log.velocity_half_digits is None or stands:
        return found
    if known_to.left_out:
        return replace(found, no_readings="the positions repeat older values")
    velocities, half = log.velocities[:, joint], log.velocity_half_digits[:, joint]
    readings = log_velocities.evidence_of(known_to, velocities, half, pairs, count)
    if isinstance(readings, str):
        return replace(found, no_readings=readings)
    blur = log.time_half_digit * max(map(abs, acceleration)) if log.time_half_digit else 0.0
    if not np.isfinite(blur):
        return replace(found, no_readings="their times are rounded, without acceleration limits")
    return replace(found, readings=replace(readings, half=readings.half + blur))


def _through(
    times: Array, positions: Array, half: Array, passing: tuple[Array, Array]
) -> tuple[Array, Array, Array]:
    """Return the tube with a point at each waypoint; it replaces a sample that is very near."""
    own_times, waypoints = passing
    near = 1e-3 * float(np.diff(times).min())
    apart = np.abs(times[:, None] - own_times).min(axis=1) > near
    narrow = np.full(len(own_times), max(LEAST_HALF, _WAYPOINT_SHARE * float(np.ptp(positions))))
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
        curve = PPoly.from_spline(found.spline())  # with empty pieces at both ends
        kept = np.diff(curve.x) > 0
        breaks = np.append(curve.x[:-1][kept], curve.x[-1])
        pieces.append((breaks, curve.c[:, kept]))
    try:
        return Trajectory.joined(pieces, waypoint_times)
    except InvalidTrajectory:  # breaks that differ by rounding only
        return None
