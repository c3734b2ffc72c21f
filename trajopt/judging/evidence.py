"""Judge from the samples of a log whether limits were kept, broken, or whether that is unknown.

A log has rounded positions and times, and noise. So each position is known within a half width.
The half widths are the premise of every verdict (`trajopt.judging.premise`). They are found from
the samples, unless they were stated. There are three verdicts:

- `broken`: it is proved that no motion within the half widths keeps the limits, mostly by a few
  rows (`trajopt.judging.log_windows`), else by all samples together (`trajopt.judging.tube`);
- `kept`: a motion within the half widths keeps them, and the samples exclude a mean excess of 5 %
  over the window;
- `cannot be told`: neither. The windows say over which time an excess of 5 % is excluded. Or rows
  seem to be missing (`trajopt.judging.lost_rows`), with which nothing is broken.

The ends of a log are facts: no rest is asked of it. Where samples allow rest, the motion rests.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Literal

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.limits import KINDS, LIMIT_ORDERS, LimitName, Limits
from trajopt.core.limits.peaks import peak, ratio
from trajopt.core.trajectory import Trajectory
from trajopt.judging import log_windows, tube_proof
from trajopt.judging.log_joint import RATES, Joint, Log, joined, joints_of, premise_of
from trajopt.judging.log_velocities import NO_READINGS
from trajopt.judging.lost_rows import Lost, lost_rows
from trajopt.judging.tube import TubeAnswer

Verdict = Literal["broken", "kept", "cannot be told"]

KEPT_RTOL = 1e-3
"""A motion that uses 1 + this share of its limits counts as one that keeps them, and only a proof
that every motion uses more convicts."""
DEFAULT_WINDOW_S = 0.1
DIGITS_WORTH: dict[LimitName, float] = {"velocity": 3.0, "acceleration": 12.0, "jerk": 24.0}
"""The half widths change a cubic spline's derivative by up to this times half width /
step**order."""
VELOCITY_WORTH: dict[LimitName, float] = {"velocity": 1.0, "acceleration": 6.0, "jerk": 12.0}
"""The same for cubic pieces between positions and velocities, by the velocities' half widths."""

_SLOWER_RTOL = 1e-3  # between the lower bound of a dilation and the one that is found
_MAX_STRETCHES = 16
_MAX_PASSAGES = 3  # samples that are tried as the passage of a waypoint


@dataclass(frozen=True)
class Told:
    """How much of one kind of limit a log uses: the largest share of all joints.

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


@dataclass(frozen=True, eq=False)
class Conviction:
    """A proof that a joint breaks its limits.

    Attributes:
        joint: Counted from 0.
        at_least: Share of the limits that every motion within the half widths uses. For a position
            limit: the least distance beyond it, rad.
        limit: The limit that is broken; None where only all limits together prove it.
        times: Of the samples that prove it, s. Of a proof by all samples together: the first and
            the last time that it needs.
        values: Their positions, rad, or velocities, rad/s; none of a proof by all samples.
        half: Half widths of the values.
        of_velocities: Whether the values are logged velocities.
        margin: The limit can be kept only if positions (or velocities) were off by at least this
            many times their half widths; 0 where it is not known.
    """

    joint: int
    at_least: float
    limit: str | None
    times: Array
    values: Array = field(default_factory=lambda: np.zeros(0))
    half: Array = field(default_factory=lambda: np.zeros(0))
    of_velocities: bool = False
    margin: float = 0.0

    @property
    def start(self) -> float:
        return float(self.times[0])

    @property
    def end(self) -> float:
        return float(self.times[-1])

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON: SI units, joints count from 1."""
        table: dict[str, Any] = {
            "joint": self.joint + 1,
            "at_least": self.at_least,
            "limit": self.limit,
            "start": self.start,
            "end": self.end,
            "margin": self.margin or None,
            "of": "velocities" if self.of_velocities else "positions",
        }
        for name in ("times", "values", "half"):
            table[name] = getattr(self, name).tolist() if len(self.values) else None
        return table


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
        joints: Each joint's samples, and how accurately they are known.
        window: The window that was asked for, s.
        by_positions: The verdict without the velocities, where these are part of the proof.
        lost: Rows that seem to be missing, where that explains what else is broken.
    """

    verdict: Verdict
    limits: dict[str, Told]
    motion: Trajectory | None
    at_rest: bool
    convictions: Sequence[Conviction]
    log: Log
    joints: Sequence[Joint]
    window: float
    by_positions: Verdict | None = None
    lost: Sequence[Lost] = ()

    @property
    def conviction(self) -> Conviction | None:
        """The strongest proof; None unless the verdict is `broken`."""
        return self.convictions[0] if self.convictions else None

    @cached_property
    def otherwise(self) -> float:
        """Return the largest share of a limit that the positions prove by the other reading.

        Of measured positions: as exact digits. Of commanded ones: as measured.
        """
        other = replace(self.log, commanded=not self.log.commanded)
        joints = [
            replace(logged, known=premise_of(other, joint, logged.limits))
            for joint, logged in enumerate(self.joints)
        ]
        return max(bound.share for joint in joints for bound in joint.by_positions.values())

    @cached_property
    def slower(self) -> SlowerLog | None:
        """The shortest motion found through the samples of a broken log that keeps the limits."""
        return _slower(self.joints, self.at_rest) if self.verdict == "broken" else None

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON: SI units, joints count from 1, None for what does not exist.

        A slower motion is there if it was asked for before.
        """
        table: dict[str, Any] = {
            "verdict": self.verdict,
            "premise": [logged.known.as_dict() for logged in self.joints],
            "digits": list(self.log.decimals),
            "time_half_digit": self.log.time_half_digit,
            "samples": len(self.log.times),
            "asked_window": self.window,
            "at_rest": self.at_rest,
            "by_positions": self.by_positions,
            "otherwise": self.otherwise,
            "velocities_left_out": [logged.no_readings or None for logged in self.joints],
            "lost_rows": [{"row": loss.row + 1, "count": loss.count} for loss in self.lost],
        }
        for name, told in self.limits.items():
            table[name] = {**vars(told), "joint": told.joint + 1}
        broken = [conviction.as_dict() for conviction in self.convictions]
        table["conviction"] = broken[0] if broken else None
        table["convictions"] = broken
        slower = vars(self).get("slower")
        table["slower"] = slower and {"at_least": slower.at_least, "factor": slower.factor}
        return table


def evidence(
    log: Log,
    limits: Limits,
    *,
    noise: float | None = None,
    resolution: float | None = None,
    window: float = DEFAULT_WINDOW_S,
    accelerations: Sequence[bool] = (),
) -> Evidence:
    """Return what a log tells about limits.

    Args:
        log: Its samples.
        limits: Of its joints. Where segments differ, the widest counts.
        noise: Standard deviation of independent normal noise of the positions, rad; None if it is
            to be found from the samples.
        resolution: The step of the sensors, rad; None if it is to be found.
        window: `kept` requires that a mean excess of 5 % over this window is excluded, s.
        accelerations: Whether each joint's acceleration is judged; by default all are.
    """
    limits = limits.in_all_segments(tightest=False)
    joints = joints_of(log, limits, accelerations, noise=noise, resolution=resolution)
    found = [_found(logged) for logged in joints]
    convictions = _convictions(joints, found)
    lost: Sequence[Lost] = ()
    if convictions and not log.commanded:
        lost, corrected = _with_lost_rows(joints)
        if lost:
            joints = corrected
            found = [_found(logged) for logged in joints]
            convictions = _convictions(joints, found)
    motion = joined([part.answer for part in found], joints[0].times[[0, -1]])
    verdict = _verdict(joints, found, convictions, lost, window)
    by_positions: Verdict | None = None
    if convictions and any(len(logged.readings.times) for logged in joints):
        alone = [replace(logged, readings=NO_READINGS) for logged in joints]
        by_positions = _verdict(alone, found, _convictions(alone, found), lost, window)
    return Evidence(
        verdict=verdict,
        limits=dict(_told(log, limits, joints, convictions, motion)),
        motion=motion,
        at_rest=all(part.at_rest for part in found),
        convictions=convictions,
        log=log,
        joints=joints,
        window=window,
        by_positions=by_positions,
        lost=lost,
    )


def _verdict(
    joints: Sequence[Joint],
    found: Sequence[_MotionFound],
    convictions: Sequence[Conviction],
    lost: Sequence[Lost],
    window: float,
) -> Verdict:
    if convictions:
        return "broken"
    shown = all(bound.window <= window for logged in joints for bound in logged.bounds.values())
    return "kept" if shown and not lost and all(part.kept for part in found) else "cannot be told"


@dataclass(frozen=True, eq=False)
class _MotionFound:
    """A joint's motion within its half widths.

    Attributes:
        answer: The motion, and the lower bound on the use of all limits together.
        at_rest: Whether it rests at both ends.
        kept: Whether it keeps the limits.
    """

    answer: TubeAnswer
    at_rest: bool
    kept: bool


def _found(logged: Joint) -> _MotionFound:
    still = logged.still()
    if still is not None:
        return _MotionFound(still, True, True)
    resting: TubeAnswer | None = None
    share = max((bound.share for bound in logged.by_positions.values()), default=0.0)
    if logged.may_rest(share):
        resting = logged.found(rest=True)
        if resting.high <= 1 + KEPT_RTOL and resting.low <= 1 + KEPT_RTOL:
            return _MotionFound(resting, True, not len(logged.beyond_between(resting)))
        if share > 1 + KEPT_RTOL and np.isfinite(resting.high):  # a few rows prove it
            return _MotionFound(replace(resting, low=0.0, proof=None), True, False)
    free = logged.found(rest=False)
    best, at_rest = free, False
    if resting is not None and resting.high <= max(1.0, free.high) * (1 + KEPT_RTOL):
        # What is proved of motions at rest is not proved of all.
        best, at_rest = replace(resting, low=free.low, proof=free.proof), True
    kept = best.high <= 1 + KEPT_RTOL and not len(logged.beyond_between(best))
    return _MotionFound(best, at_rest, kept)


def passing(found: Evidence, times: Array, waypoints: Array) -> Evidence:
    """Return the evidence with a motion that passes waypoints, if there is one within the digits.

    A waypoint that the motion misses by more than one digit is not passed. All joints have to pass
    a waypoint at the same time, which the log's digits leave open. So the times of samples that are
    the waypoint within their digits are tried too, the nearest first.

    Args:
        found: The evidence of a log that was not cut.
        times: Approximate times of the waypoints, from the log's first time to its last, s.
        waypoints: rad, `(waypoints, joints)`.
    """
    log = found.log
    joints = found.joints
    digits = np.array([logged.known.known for logged in joints])
    if found.motion is None or (np.abs(found.motion(times) - waypoints) > 2 * digits).any():
        return found
    best = _through_all(joints, times, waypoints)
    for index in range(1, len(times) - 1):
        near = (np.abs(log.positions - waypoints[index]) <= digits).all(axis=1)
        alike = log.times[near]
        nearest = np.argsort(np.abs(alike - times[index]))[:_MAX_PASSAGES]
        for time in alike[nearest]:
            shifted = np.array(best.times)
            shifted[index] = time
            if best.high > 1 and (np.diff(shifted) > 0).all():
                best = min(best, _through_all(joints, shifted, waypoints), key=lambda one: one.high)
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
    return _Through(times, [logged.found(rest=True, passing=(times, q)) for logged, q in columns])


def _convictions(joints: Sequence[Joint], found: Sequence[_MotionFound]) -> list[Conviction]:
    """Return the strongest proof of each joint that breaks a limit, in rational numbers.

    Position limits come first, then the largest shares.
    """
    each = [_conviction(joint, *pair) for joint, pair in enumerate(zip(joints, found, strict=True))]
    proofs = [proof for proof in each if proof is not None]
    return sorted(proofs, key=lambda one: (one.limit != "position", -one.at_least))


def _conviction(joint: int, logged: Joint, found: _MotionFound) -> Conviction | None:
    """Return the proof by one sample beyond the range, by a few rows, or by all samples."""
    beyond = logged.beyond
    farthest = int(np.argmax(beyond))
    if beyond[farthest] > 0:
        row = slice(farthest, farthest + 1)
        samples = logged.times[row], logged.positions[row], logged.digits[row]
        return Conviction(joint, float(beyond[farthest]), "position", *samples)
    by_rows = [_by_rows(joint, logged, name) for name in logged.bounds]
    proofs = [proof for proof in by_rows if proof is not None]
    if not proofs and found.answer.low > 1 + KEPT_RTOL:
        names = [name for name in RATES[1:] if name in logged.bounds]  # `slope` is exact
        by_all = [_by_all(joint, logged.alone(name), name) for name in names]
        proofs = [proof for proof in by_all if proof is not None]
        together = None if proofs else _by_all(joint, found.answer, None)
        proofs += [together] if together else []
    return max(proofs, key=lambda one: one.at_least, default=None)


def _by_rows(joint: int, logged: Joint, name: str) -> Conviction | None:
    """Return the proof that a few rows break a limit; None if they do not."""
    bound = logged.bounds[name]
    if bound.share <= 1 + KEPT_RTOL:
        return None
    rows = list(bound.rows)
    if bound.of_velocities:
        samples = (
            logged.readings.times[rows],
            logged.readings.values[rows],
            logged.readings.half[rows],
        )
    else:
        samples = logged.times[rows], logged.positions[rows], logged.half[rows]
    share = bound.share
    if name in RATES:
        share = float(log_windows.proved(*samples, *logged.limits[RATES.index(name)]))
    if share <= 1 + KEPT_RTOL:
        return None
    return Conviction(joint, share, name, *samples, bound.of_velocities, bound.margin)


def _by_all(joint: int, answer: TubeAnswer, name: str | None) -> Conviction | None:
    """Return the proof by all samples together that limits are broken; None if there is none."""
    if answer.low <= 1 + KEPT_RTOL or answer.proof is None:
        return None
    share = tube_proof.proved(answer.proof)
    convicts = share > 1 + KEPT_RTOL
    return Conviction(joint, share, name, np.array(answer.span)) if convicts else None


def _with_lost_rows(joints: Sequence[Joint]) -> tuple[Sequence[Lost], list[Joint]]:
    """Return the rows that seem to be missing, and the joints at the times with them.

    At a place like that a time may be off by a step, so half widths grow by a step's own motion.
    """
    times = joints[0].times
    if any(len(logged.times) != len(times) or (logged.times != times).any() for logged in joints):
        return (), []
    lost, times = lost_rows([logged.known for logged in joints])
    step = float(np.median(np.diff(times)))
    corrected = []
    for logged in joints:
        speed = np.convolve(np.abs(np.gradient(logged.positions, times)), np.full(5, 0.2), "same")
        known = replace(logged.known, times=times, half=logged.known.half + step * speed)
        corrected.append(replace(logged, known=known, readings=NO_READINGS))
    return lost, corrected


def _slower(joints: Sequence[Joint], at_rest: bool) -> SlowerLog | None:
    """Return the least dilation found with which a motion through the samples keeps the limits.

    Any motion within the half widths keeps them when it is dilated enough. So the first one gives a
    factor, and motions that are sought at smaller factors reduce it. Joints are tried in the order
    of what they are proved to need; only one that needs more than those before is sought.
    Return None if a joint has no motion within its half widths and position limits.
    """
    at_least, factor = 1.0, 1.0
    lows = [_least_dilation(logged) for logged in joints]
    chosen: list[TubeAnswer | None] = [None] * len(joints)
    for joint in sorted(range(len(joints)), key=lambda joint: -lows[joint]):
        logged, low = joints[joint], lows[joint]
        at_least = max(at_least, low)
        need, best = np.inf, logged.still()
        stretch = max(factor, low) * (1 + KEPT_RTOL)
        if best is not None:
            need = 1.0
        for _ in range(_MAX_STRETCHES):
            if need <= max(factor, low * (1 + _SLOWER_RTOL)):
                break
            found = logged.stretched(stretch).found(at_rest)
            found_need = _dilation(logged, found)
            if found_need < need:
                need, best = found_need, found
            if found.low > 1:
                low = max(low, stretch)
            if not np.isfinite(need):
                stretch *= 2
                continue
            stretch = float(np.sqrt(max(factor, low) * need))
        if best is None or not np.isfinite(need):
            return None
        chosen[joint] = best
        factor = max(factor, need)
    motion = joined([part for part in chosen if part is not None], joints[0].times[[0, -1]])
    return None if motion is None else SlowerLog(at_least, factor, motion.dilated(factor))


def _least_dilation(logged: Joint) -> float:
    """Return the dilation that every motion within the half widths of positions needs.

    Dilation by d divides the use of a limit of order k by d^k. What logged velocities prove does
    not hold for slower motions.
    """
    degrees = {name: KINDS[name].degree or np.inf for name in logged.by_positions}
    each = [bound.share ** (1 / degrees[name]) for name, bound in logged.by_positions.items()]
    return max([1.0, *each])


def _dilation(logged: Joint, found: TubeAnswer) -> float:
    """Return by how much a motion must be dilated to keep the limits; infinite without one."""
    if not np.isfinite(found.high) or logged.beyond.max() > 0 or len(logged.beyond_between(found)):
        return np.inf
    motion = joined([found], logged.times[[0, -1]])
    if motion is None:
        return np.inf
    needs = [1.0]
    for order, (name, limit) in enumerate(zip(RATES, logged.limits, strict=True), start=1):
        if np.isfinite(limit[1]):
            use = float(peak(motion, order, np.array([limit]), ratio).value)
            needs.append(use ** (1 / (KINDS[name].degree or np.inf)))
    needs += [
        logged.others[key].worst(motion).value ** (1 / (KINDS[key].degree or np.inf))
        for key in logged.falling()
    ]
    return max(needs)


def _told(
    log: Log,
    limits: Limits,
    joints: Sequence[Joint],
    convictions: Sequence[Conviction],
    motion: Trajectory | None,
) -> Iterator[tuple[str, Told]]:
    """Yield what is told of each kind of limit; a proof by all samples counts where it is best."""
    spline = Trajectory.from_samples(log.times, log.positions, interpolation="spline")
    proved = {(proof.joint, proof.limit): proof.at_least for proof in convictions}
    for name in dict.fromkeys(name for logged in joints for name in logged.bounds):
        known = [joint for joint, logged in enumerate(joints) if name in logged.bounds]
        shares: list[float | None] = [None] * len(joints)
        for joint in known:
            shares[joint] = proved.get((joint, name), joints[joint].bounds[name].share)
        least = max(known, key=lambda joint: shares[joint] or 0.0)
        if name in LIMIT_ORDERS:
            rate = RATES[LIMIT_ORDERS[name] - 1]
            bounds = limits.by_name()[rate][known]
            uses, raw = (
                None if curve is None else _use(curve, LIMIT_ORDERS[rate], known, bounds)
                for curve in (motion, spline)
            )
        else:
            uses, raw = (
                None if curve is None else limits.others[name].worst(curve).value
                for curve in (motion, spline)
            )
        assert raw is not None
        yield (
            name,
            Told(
                at_least=shares[least] or 0.0,
                uses=uses,
                spline=raw,
                digits_alone=max(_alone(joints[joint], name) for joint in known),
                window=max(joints[joint].bounds[name].window for joint in known),
                joint=least,
                by_joint=tuple(shares),
            ),
        )


def _alone(logged: Joint, name: str) -> float:
    """Return the largest change of a use by the half widths.

    Of a limit that depends on the position, only samples between which the joint moves by more than
    its half widths are counted.
    """
    step = float(np.median(np.diff(logged.times)))
    if name in RATES:
        order = RATES.index(name)
        size = min(map(abs, logged.limits[order]))
        return (
            DIGITS_WORTH[RATES[order]] * float(np.median(logged.half)) / step ** (order + 1) / size
        )
    low, high = logged.velocities(name)
    moved = np.diff(logged.positions)
    towards = np.where(moved > 0, high[1:], -low[1:])
    moving = np.abs(moved) > 2 * logged.half[1:]
    worth = DIGITS_WORTH["velocity"] * logged.half[1:] / step / towards
    return float(worth[moving].max(initial=0.0))


def _use(trajectory: Trajectory, order: int, joints: Sequence[int], limits: Array) -> float:
    part = replace(trajectory, coefficients=trajectory.coefficients[..., joints])
    return float(peak(part, order, limits, ratio).value)
