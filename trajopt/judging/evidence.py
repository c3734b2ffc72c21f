"""Tell from the samples of a log whether limits are broken, kept, or cannot be told.

A log has digits, rounded times and noise. So a position is known within a half width. There may be
a motion within these half widths that keeps the limits (`trajopt.judging.tube`), or a proof that
there is none (`trajopt.judging.tube_proof`). Three verdicts follow:

- `broken`: no motion within the half widths keeps the limits, which is proved;
- `kept`: a motion keeps them, and an excess of 5 % that lasts for the window would have shown;
- `cannot be told`: neither. The windows say for how long an excess of 5 % could hide.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from math import factorial
from statistics import NormalDist
from typing import Any, Literal

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.limits import LIMIT_ORDERS, LimitName, Limits
from trajopt.core.limits.peaks import peak, ratio
from trajopt.core.trajectory import Trajectory
from trajopt.judging.tube import BROKEN_RTOL, TubeAnswer, slope, tube
from trajopt.judging.tube_proof import Limit, proved

Verdict = Literal["broken", "kept", "cannot be told"]

KEPT_RTOL = 1e-3
"""A motion that uses 1 + this share of its limits counts as one that keeps them."""
EXCESS = 0.05
"""A mean excess over a window that must show, as a share of the limit."""
DEFAULT_WINDOW_S = 0.1
NOISE_DOUBT = 1e-3
"""Probability that some sample's noise is larger than the half width of the tube."""

_RATES: tuple[LimitName, ...] = ("velocity", "acceleration", "jerk")
_FLOOR = 1e-7  # rad, least half width: narrower tubes are lost in rounding
DIGITS_WORTH: dict[LimitName, float] = {"velocity": 3.0, "acceleration": 12.0, "jerk": 24.0}
"""Largest change of a cubic spline's derivatives: this times half width / step**order."""
_UNLIMITED: Limit = (-np.inf, np.inf)
_WAYPOINT_SHARE = 1e-7  # of a joint's span: half width at a waypoint, within what is repaired
_MAX_NARROWINGS = 2
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
    """

    times: Array
    positions: Array
    half_digits: Array
    time_half_digit: float = 0.0
    decimals: Sequence[int] = ()


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
    limit: LimitName | None
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """What a log tells.

    Attributes:
        verdict: One of three.
        limits: By kind, without kinds that no joint has.
        motion: The motion within the half widths that uses the least of the limits; None where
            none was found.
        at_rest: Whether that motion rests at both ends; if not, the log was cut.
        conviction: The proof; None unless the verdict is `broken`.
        log: The samples.
        noise: The standard deviation that was given, rad; 0 for digits alone.
        window: The window that was asked for, s.
    """

    verdict: Verdict
    limits: dict[LimitName, Told]
    motion: Trajectory | None
    at_rest: bool
    conviction: Conviction | None
    log: Log
    noise: float
    window: float

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
        }
        for name, told in self.limits.items():
            table[name] = {**vars(told), "joint": told.joint + 1}
        broken = self.conviction
        table["conviction"] = broken and {**vars(broken), "joint": broken.joint + 1}
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
        limits: Of its joints.
        noise: Standard deviation of independent normal noise of the positions, rad.
        window: A mean excess of 5 % over this window must show for `kept`, s.
        accelerations: Whether each joint's acceleration is judged; by default all are.
    """
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
    conviction = _conviction(joints, lows, singles)
    motion = _joined(chosen, log.times[[0, -1]])
    told = dict(_told(log, limits, joints, singles, motion))
    verdict: Verdict = "cannot be told"
    if conviction is not None:
        verdict = "broken"
    elif max(found.high for found in chosen) <= 1 + KEPT_RTOL:
        shown = all(own.window <= window for own in told.values())
        verdict = "kept" if shown else "cannot be told"
    return Evidence(verdict, told, motion, at_rest, conviction, log, noise, window)


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
    joints = _joints(log, limits, found.noise, ())
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
class _Joint:
    """One joint's samples.

    Attributes:
        limits: Of velocity, acceleration and jerk, infinite where there is none.
        range: Its position limits, rad.
        digits: Half width of each position, rad.
        shift: Half width of each time, s.
    """

    times: Array
    positions: Array
    digits: Array
    shift: float
    limits: tuple[Limit, Limit, Limit]
    range: Limit

    @property
    def half(self) -> Array:
        """Half width at the stated times: a motion within its limits moves so far meanwhile."""
        low, high = self.limits[0]
        return self.digits + self.shift * max(-low, high)

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
        half = self.half
        found = self._solved(half, limits, rest, passing)
        for _ in range(_MAX_NARROWINGS if self.shift else 0):
            if not np.isfinite(found.high) or self._hits(found):
                return found
            # The motion moves less than its limit allows: where it does, the tube is narrower.
            speed = np.abs(found.spline()(self.times, nu=1))
            half = np.minimum(half, self.digits + self.shift * speed)
            narrower = self._solved(half, limits, rest, passing)
            found = replace(narrower, low=found.low, proof=found.proof)
        if self.shift and not self._hits(found):
            found = replace(found, high=np.inf)
        return found

    def _solved(
        self,
        half: Array,
        limits: Sequence[Limit],
        rest: bool,
        passing: tuple[Array, Array] | None,
    ) -> TubeAnswer:
        times, positions, half = self._inside(half)
        if passing is not None:
            times, positions, half = _through(times, positions, half, passing)
        return tube(times, positions, half, limits, rest=rest)

    def _inside(self, half: Array) -> tuple[Array, Array, Array]:
        """The tube, narrowed to the position limits where it does not lie outside of them."""
        low, high = self.range
        lowest = np.maximum(self.positions - half, low)
        highest = np.minimum(self.positions + half, high)
        fits = highest - lowest > 0.1 * half
        centre = np.where(fits, (lowest + highest) / 2, self.positions)
        return self.times, centre, np.where(fits, (highest - lowest) / 2, half)

    def _hits(self, found: TubeAnswer) -> bool:
        """Return whether the motion meets each sample at some time that rounds to its stamp."""
        ends = self.times[[0, -1]]
        shifted = self.times + self.shift * np.array([[-1.0], [0.0], [1.0]])
        passed = found.spline()(np.clip(shifted, *ends))
        slack = self.digits * (1 + 1e-6)
        above = passed.min(axis=0) <= self.positions + slack
        below = passed.max(axis=0) >= self.positions - slack
        return bool((above & below).all())

    def singles(self) -> dict[LimitName, float]:
        """The share of each limit that every motion uses, if it had no other limit."""
        half = self.half
        shares: dict[LimitName, float] = {}
        for order, (name, limit) in enumerate(zip(_RATES, self.limits, strict=True)):
            if not np.isfinite(limit[1]):
                continue
            if order == 0:
                shares[name] = self.slope()[0]
                continue
            alone = [_UNLIMITED] * order + [limit]
            shares[name] = tube(self.times, self.positions, half, alone, rounds=_SINGLE_ROUNDS).low
        return shares

    def slope(self) -> tuple[float, float, float]:
        return slope(self.times, self.positions, self.half, self.limits[0])


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
    return _Joint(
        times=log.times,
        positions=log.positions[:, joint],
        digits=digits,
        shift=log.time_half_digit,
        limits=(velocity, acceleration, jerk),
        range=(low, high),
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


def _conviction(
    joints: Sequence[_Joint], lows: Sequence[TubeAnswer], singles: Sequence[dict[LimitName, float]]
) -> Conviction | None:
    """The joint that breaks its limits most, proved in rational numbers."""
    convictions: list[Conviction] = []
    for joint, (own, found, alone) in enumerate(zip(joints, lows, singles, strict=True)):
        beyond = own.beyond
        farthest = int(np.argmax(beyond))
        if beyond[farthest] > 0:
            time = float(own.times[farthest])
            return Conviction(joint, float(beyond[farthest]), "position", time, time)
        share, start, end = own.slope()
        if share > 1 + BROKEN_RTOL:
            convictions.append(Conviction(joint, share, "velocity", start, end))
        if found.low > 1 + BROKEN_RTOL and found.proof is not None:
            least = float(proved(found.proof))
            highest = max(alone, key=lambda name: alone[name])
            limit = highest if alone[highest] > 1 else None
            if least > 1:
                convictions.append(Conviction(joint, least, limit, *found.span))
    return max(convictions, key=lambda own: own.at_least, default=None)


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
    singles: Sequence[dict[LimitName, float]],
    motion: Trajectory | None,
) -> Iterator[tuple[LimitName, Told]]:
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
        worth = DIGITS_WORTH[name] * np.median(half, axis=0) / step**order
        yield (
            name,
            Told(
                at_least=max(0.0, singles[least][name]),
                uses=None if motion is None else _use(motion, order, known, bounds),
                spline=_use(spline, order, known, bounds),
                digits_alone=float((worth / np.abs(bounds).min(axis=1)).max()),
                window=_window(log.times, positions, half, bounds, order),
                joint=least,
                by_joint=tuple(own.get(name) for own in singles),
            ),
        )


def _use(trajectory: Trajectory, order: int, joints: Sequence[int], limits: Array) -> float:
    own = replace(trajectory, coefficients=trajectory.coefficients[..., joints])
    return float(peak(own, order, limits, ratio).value)


def _window(times: Array, positions: Array, half: Array, limits: Array, order: int) -> float:
    """The shortest window in which no mean of a derivative beyond 1.05 of its limit can hide.

    A divided difference over samples is a mean of the derivative between them; digits leave a doubt
    about it, which is smaller the longer the window is.
    """
    low, high = limits.T
    stride = 1
    while order * stride < len(times):
        count = len(times) - order * stride
        at = np.stack([times[i * stride : i * stride + count] for i in range(order + 1)])
        mean = np.zeros((count, len(limits)))
        doubt = np.zeros((count, len(limits)))
        for i in range(order + 1):
            others = [at[i] - at[j] for j in range(order + 1) if j != i]
            weight = (factorial(order) / np.prod(others, axis=0))[:, None]
            part = slice(i * stride, i * stride + count)
            mean += weight * positions[part]
            doubt += np.abs(weight) * half[part]
        worst = np.maximum((mean + doubt) / high, (mean - doubt) / low).max()
        if worst <= 1 + EXCESS:
            return float((at[-1] - at[0]).max())
        stride = stride + 1 if stride < _MAX_STRIDE_BY_ONE else int(_STRIDE_GROWTH * stride)
    return float("inf")
