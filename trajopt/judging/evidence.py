"""Judge from the samples of a log whether limits were kept, broken, or whether that is unknown.

A log has rounded positions and times, and noise. So a position is known within a half width. There
may be a motion within these half widths that keeps the limits (`trajopt.judging.tube`), or a proof
that there is none (`trajopt.judging.tube_proof`). So there are three verdicts:

- `broken`: it is proved that no motion within the half widths keeps the limits;
- `kept`: a motion within the half widths keeps them, and the samples exclude a mean excess of 5 %
  over the window;
- `cannot be told`: neither. The windows say over which time an excess of 5 % is excluded.

Logged velocities bound an acceleration much more tightly than positions of as many digits do. They
are ignored in two cases. With `noise`, their noise is not known. And where they would need more
than three times a limit that the positions alone allow to be kept, they do not belong to these
positions: they were measured or filtered separately, or zeros stand for missing values.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.limits import KINDS, LIMIT_ORDERS, LimitName, Limits
from trajopt.core.limits import Limit as OtherLimit
from trajopt.core.limits.peaks import peak, ratio
from trajopt.core.trajectory import Trajectory
from trajopt.judging.log_joint import RATES, Joint, Log, joined, joints_of, window_of
from trajopt.judging.tube import BROKEN_RTOL, TubeAnswer
from trajopt.judging.tube_proof import proved

Verdict = Literal["broken", "kept", "cannot be told"]

KEPT_RTOL = 1e-3
"""A motion that uses 1 + this share of its limits counts as one that keeps them."""
DEFAULT_WINDOW_S = 0.1
DIGITS_WORTH: dict[LimitName, float] = {"velocity": 3.0, "acceleration": 12.0, "jerk": 24.0}
"""The half widths change a cubic spline's derivative by up to this times half width /
step**order."""
VELOCITY_WORTH: dict[LimitName, float] = {"velocity": 1.0, "acceleration": 6.0, "jerk": 12.0}
"""The same for cubic pieces between positions and velocities, by the velocities' half widths."""

_MISFIT = 3.0  # velocities are ignored if they alone need this many times a limit
_MAX_STRETCHES = 5
_MAX_SLOWER = 1e4  # no slower motion is searched beyond this dilation
_SLOWER_RTOL = 1e-4  # between the lower bound of a dilation and the one that is found
_MAX_PASSAGES = 3  # samples that are tried as the passage of a waypoint


@dataclass(frozen=True)
class Told:
    """Use of one kind of limit, as a share of it, for the joint that uses most.

    Attributes:
        at_least: Every motion within the half widths uses at least this share.
        uses: Share that the motion found uses; None where none was found.
        spline: Share that the cubic spline through the samples uses, at rest at both ends.
        digits_alone: Largest change of that share by the half widths.
        window: The shortest window, s, over which the samples exclude a mean excess of 5 %;
            infinite if there is none.
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
        at_least: Share of the limits that every motion within the half widths uses. For a position
            limit: the least distance beyond it, rad.
        limit: The limit that is broken; None where only all limits together prove it.
        start, end: The proof needs only the samples between these times, s.
    """

    joint: int
    at_least: float
    limit: str | None
    start: float
    end: float


@dataclass(frozen=True, eq=False)
class SlowerLog:
    """A slower motion through the samples of a broken log, with their times dilated.

    Attributes:
        at_least: Lower bound on the dilation of every motion that keeps the limits.
        factor: Dilation of the motion found.
        motion: The motion; it keeps the limits.
    """

    at_least: float
    factor: float
    motion: Trajectory


@dataclass(frozen=True, eq=False)
class Evidence:
    """The verdict on a log, and what it rests on.

    Attributes:
        verdict: `broken`, `kept` or `cannot be told`.
        limits: Use of each kind of limit that a joint has.
        motion: The motion within the half widths that uses the smallest share of the limits; None
            where none was found.
        at_rest: Whether that motion rests at both ends; if not, the log was cut.
        convictions: The strongest proof for each joint; none unless the verdict is `broken`.
        log: The samples.
        noise: Standard deviation of the noise that was given, rad; 0 for rounding alone.
        window: The window that was asked for, s.
        by_positions: The verdict without the velocities, where these are part of the proof.
        slower: For a broken log, the shortest motion found through its samples that keeps the
            limits.
        misfit: With the velocities that were ignored, this would be proved; None if none were.
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
    slower: SlowerLog | None = None
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
        window: `kept` requires that a mean excess of 5 % over this window is excluded, s.
        accelerations: Whether each joint's acceleration is judged; by default all are.
    """
    limits = limits.in_all_segments(tightest=False)
    joints = joints_of(log, limits, noise, accelerations)
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
    motion = joined(chosen, log.times[[0, -1]])
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
    slower = _slower(joints, lows, singles, at_rest) if verdict == "broken" else None
    return Evidence(
        verdict, told, motion, at_rest, convictions, log, noise, window, by_positions, slower
    )


def passing(found: Evidence, limits: Limits, times: Array, waypoints: Array) -> Evidence:
    """Return the evidence with a motion that passes waypoints, if there is one within the digits.

    A waypoint that the motion misses by more than one digit is not passed. All joints have to pass
    a waypoint at the same time, which the log's digits leave open. So the times of samples that are
    the waypoint within their digits are tried too, the nearest first.

    Args:
        found: The evidence of a log that was not cut.
        limits: Of its joints.
        times: Approximate times of the waypoints, from the log's first time to its last, s.
        waypoints: rad, `(waypoints, joints)`.
    """
    log = found.log
    joints = joints_of(log, limits.in_all_segments(tightest=False), found.noise, ())
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
    motion = joined(best.joints, best.times)
    return found if motion is None else replace(found, motion=motion)


@dataclass(frozen=True, eq=False)
class _Through:
    """The joints' motions that pass the waypoints at these times, s."""

    times: Array
    joints: Sequence[TubeAnswer]

    @property
    def high(self) -> float:
        return max(found.high for found in self.joints)


def _through_all(joints: Sequence[Joint], times: Array, waypoints: Array) -> _Through:
    columns = zip(joints, waypoints.T, strict=True)
    return _Through(times, [own.found(rest=True, passing=(times, q)) for own, q in columns])


def _convictions(
    joints: Sequence[Joint], lows: Sequence[TubeAnswer], singles: Sequence[dict[str, float]]
) -> list[Conviction]:
    """Return the strongest proof of each joint that breaks a limit, in rational numbers.

    Position limits come first, then the largest shares.
    """
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


def _slower(
    joints: Sequence[Joint],
    lows: Sequence[TubeAnswer],
    singles: Sequence[dict[str, float]],
    at_rest: bool,
) -> SlowerLog | None:
    """Return the least dilation found with which a motion through the samples keeps the limits.

    Joints are tested in the order of their use; the one that needs the largest dilation decides.
    Return None if none is found.
    """
    at_least, factor = 1.0, 1.0
    for joint in sorted(range(len(joints)), key=lambda joint: -lows[joint].low):
        own = joints[joint]
        if own.beyond.max() > 0 or lows[joint].low > _MAX_SLOWER:
            return None
        if own.stretched(factor).found(at_rest).high <= 1:
            continue
        # Dilation by d divides the use of a limit of order k by d^k: a lower bound. Proofs that
        # need the logged velocities do not hold for slower motions.
        low = 1.0
        if not len(own.readings.times):
            order = max(k for k, (_, high) in enumerate(own.limits, start=1) if np.isfinite(high))
            roots = [lows[joint].low ** (1 / order)]
            for name, share in singles[joint].items():
                roots.append(share ** (1 / (KINDS[name].degree or np.inf)))
            low = max(low, *roots)
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
    motion = joined(
        [own.stretched(factor).found(at_rest) for own in joints], joints[0].times[[0, -1]]
    )
    return None if motion is None else SlowerLog(at_least, factor, motion.dilated(factor))


def _told(
    log: Log,
    limits: Limits,
    joints: Sequence[Joint],
    singles: Sequence[dict[str, float]],
    motion: Trajectory | None,
) -> Iterator[tuple[str, Told]]:
    step = float(np.median(np.diff(log.times)))
    spline = Trajectory.from_samples(log.times, log.positions, interpolation="spline")
    widths = np.stack([own.half for own in joints], axis=1)
    for name in RATES:
        known = [joint for joint, own in enumerate(singles) if name in own]
        if not known:
            continue
        order = LIMIT_ORDERS[name]
        bounds = limits.by_name()[name][known]
        positions, half = log.positions[:, known], widths[:, known]
        least = max(known, key=lambda joint: singles[joint][name])
        window = window_of(log.times, positions, half, bounds, order)
        if order > 1 and all(len(own.readings.times) for own in joints):
            readings = [joints[joint].readings for joint in known]
            values = np.stack([own.values for own in readings], axis=1)
            doubt = np.stack([own.half for own in readings], axis=1)
            window = min(window, window_of(log.times, values, doubt, bounds, order - 1))
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


def _falling(joint: Joint, limit: OtherLimit, index: int, step: float) -> tuple[float, float]:
    """Return `digits_alone` and `window` of a velocity limit that depends on the position.

    Only samples between which the joint moves by more than its half widths are counted.
    """
    reach = joint.reach(joint.times)
    low, high = limit.velocities(index, *reach)
    low, high = np.minimum(low, -1e-9), np.maximum(high, 1e-9)
    moved = np.diff(joint.positions)
    towards = np.where(moved > 0, high[1:], -low[1:])
    moving = np.abs(moved) > 2 * joint.half[1:]
    worth = DIGITS_WORTH["velocity"] * joint.half[1:] / step / towards
    bounds = np.stack([low, high], axis=1)[:, None]
    window = window_of(joint.times, joint.positions[:, None], joint.half[:, None], bounds, 1)
    return float(worth[moving].max(initial=0.0)), window


def _use(trajectory: Trajectory, order: int, joints: Sequence[int], limits: Array) -> float:
    own = replace(trajectory, coefficients=trajectory.coefficients[..., joints])
    return float(peak(own, order, limits, ratio).value)
