"""Judge any motion: by a problem with waypoints, or by limits alone.

    judgement = trajopt.judge("six-axis", "theirs.csv")
    print(judgement.certificate.feasible, judgement.certified_duration, judgement.gap)

The verifier judges. If the user accepts misses of waypoints (`via_tolerance`), the waypoints are
moved to where the motion passes, and the motion is judged by that problem. The optimum of the gap
passes the same points.
"""

from __future__ import annotations

import warnings
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from math import tau
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.best_known import records
from trajopt.benchmark.logs import AS_LOG, LogOptions, evidence_of
from trajopt.benchmark.store.folder import is_trial, recorded
from trajopt.benchmark.suites import catalogue
from trajopt.core.arrays import Array
from trajopt.core.braking import Braking
from trajopt.core.braking import brake_first as braking_of
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import FileNote, InvalidInput, UnitWarning
from trajopt.core.interpolation import Interpolation
from trajopt.core.limits import KINDS, Limits
from trajopt.core.problem import Problem
from trajopt.core.rounding import of_states
from trajopt.core.route import NOTHING
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.core.units import mixed_units
from trajopt.explain import decomposition, references
from trajopt.explain.decomposition import Explanation
from trajopt.explain.references import BUG_RTOL, REFINED_RTOL
from trajopt.formats.motion import Motion, of_samples
from trajopt.formats.motion import motion as read_motion
from trajopt.formats.samples import Samples
from trajopt.judging.certificate import Certificate, Worst
from trajopt.judging.ends import Standing, standing, standing_of, states
from trajopt.judging.evidence import DEFAULT_WINDOW_S, Evidence
from trajopt.judging.evidence import passing as through
from trajopt.judging.passing import waypoint_times
from trajopt.judging.smoothness import Smoothness, of_certified, smoothness
from trajopt.judging.turns import unwrapped
from trajopt.judging.verification import hand_over, verify
from trajopt.planners.planner import Planner

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly


LITTLE = 0.05
"""Share of the shortest segment by which a waypoint is missed by little, at most."""
_RAD_IN_DEG = (38, 86)  # about 180 / pi


@dataclass(frozen=True, eq=False)
class Execution:
    """Verdict on a motion and limits alone.

    Attributes:
        motion: The motion as executed.
        problem: The limits, with the motion's own start, end and turning points as waypoints.
        certificate: The verifier's certificate. For a log, that of a motion within its digits, if
            there is one.
        evidence: The verdict on a log, with that motion; None where the motion is no log.
        cut: Whether it begins or ends in motion, which no problem forbids: its exact peaks are
            judged, without repair.
        jumps: The largest jump of position, velocity and acceleration where it takes over from
            another motion (`taking_over`); else empty.
    """

    motion: Motion
    problem: Problem
    certificate: Certificate
    evidence: Evidence | None = field(default=None, kw_only=True)
    cut: bool = field(default=False, kw_only=True)
    jumps: tuple[Worst, ...] = field(default=(), kw_only=True)

    @property
    def executed(self) -> Trajectory:
        """Return the trajectory that the certificate is about."""
        within = self.evidence and self.evidence.motion
        return within or self.motion.trajectory

    @cached_property
    def smoothness(self) -> Smoothness | None:
        """Return the integrals of the certified motion; None where the given one has a flaw."""
        if self.cut and self.certificate.valid:
            factor = max(1.0, self.certificate.dilation)
            return smoothness(self.problem, self.executed).dilated(factor)
        return of_certified(self.problem, self.executed, self.certificate)

    @cached_property
    def standing(self) -> Standing:
        """Return how long the given motion stands at its ends."""
        limits = self.problem.limits
        if self.evidence is None:
            return standing_of(self.motion.trajectory, limits)
        half = np.array([logged.known.known for logged in self.evidence.joints])
        return standing(self.evidence.log.times, self.evidence.log.positions, half, limits)

    @property
    def kept(self) -> bool:
        """Return whether the motion keeps every limit without a dilation."""
        if self.evidence is not None:
            return self.evidence.verdict == "kept"
        return self.certificate.feasible

    @property
    def broken(self) -> bool:
        """Return whether the motion breaks a limit; for a log, whether that is proved."""
        if self.evidence is not None:
            return self.evidence.verdict == "broken"
        return not self.kept

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON: SI units, joints count from 1, None for what does not exist."""
        return {
            "motion": self.motion.name,
            "interpolation": self.motion.interpolation,
            "duration": self.certificate.duration,
            "feasible": self.certificate.feasible,
            "dilation": self.certificate.dilation,
            "certified_duration": self.certificate.certified_duration,
            "ends": _ends(self.executed),
            "jumps": [jump.value for jump in self.jumps],
            "standing": {"start": self.standing.start, "end": self.standing.end},
            "smoothness": self.smoothness and self.smoothness.as_dict(),
            "certificate": self.certificate.as_dict(),
            "evidence": self.evidence and self.evidence.as_dict(),
        }


@dataclass(frozen=True, eq=False)
class Judgement(Execution):
    """Verdict on a motion and a problem.

    If the tolerance was needed, the waypoints of `problem` are where the motion passes, and its
    name says so.

    Attributes:
        trajectory: The motion with the times at which it passes each waypoint.
        via_tolerance: Tolerance of each joint, rad.
        tolerance_needed: Whether the motion passes the waypoints only with the tolerance.
        asked: The original problem if the tolerance was needed, or velocities at the ends.
        ends_taken: Largest velocity at an end, beside the demanded one, that was taken as it is,
            rad/s; 0 where none was.
        braking: The braking into the limits that was allowed first, if one was.
    """

    trajectory: Trajectory
    via_tolerance: float
    tolerance_needed: bool = False
    asked: Problem | None = None
    braking: Braking | None = None
    ends_taken: float = 0.0

    def __repr__(self) -> str:
        return f"Judgement({self.motion.name} on {self.problem.name}, {self.certificate})"

    @property
    def executed(self) -> Trajectory:
        return self.trajectory

    @property
    def status(self) -> Status:
        return Status.SOLVED if self.certificate.valid else Status.INVALID

    @property
    def claimed_duration(self) -> float:
        """Return the duration of the motion, s."""
        return self.trajectory.duration

    @property
    def certified_duration(self) -> float | None:
        """Return the certified duration, s; None if the motion has a flaw."""
        return self.certificate.certified_duration

    @cached_property
    def explanation(self) -> Explanation | None:
        """The parts of the gap, by the references.

        None without a certified duration, and where a braking was allowed first.
        """
        if not self.certificate.valid or self.braking is not None:
            return None
        known = records.answer(self.problem)
        slower = self.certificate.motion
        trajectory = slower or self.trajectory
        return decomposition.explain(self.problem, None, trajectory, known)

    @cached_property
    def optimum_within(self) -> float | None:
        """The best known minimum time with every waypoint within `via_tolerance`, s.

        None where the motion passes the waypoints without it, or no planner finds that optimum.
        """
        if not self.tolerance_needed or self.asked is None:
            return None
        demands: dict[str, Any] = {**self.asked.demands, "tolerance": self.via_tolerance}
        near = replace(self.asked, demands=demands)
        answers = (references.asked(name, near) for name in references.references(near))
        return next((answer.duration for answer in answers if answer.duration is not None), None)

    @property
    def gap(self) -> float | None:
        """Return the certified duration over the best known optimum of `problem`, minus 1."""
        return None if self.explanation is None else self.explanation.gap

    @property
    def below_optimum(self) -> bool:
        """Return whether it is shorter than the best known optimum: a bug, or a better optimum."""
        tolerance = REFINED_RTOL if self.problem.has("position") else BUG_RTOL
        return self.gap is not None and self.gap < -tolerance

    @cached_property
    def without_jerk(self) -> Judgement | None:
        """The verdict without jerk limits, if the motion is invalid only because of them."""
        lifted = without_jerk(self.problem)
        if self.certificate.valid or lifted is None:
            return None
        certificate = verify(lifted, self.trajectory)
        return replace(self, problem=lifted, certificate=certificate) if certificate.valid else None

    @cached_property
    def nearly(self) -> Judgement | None:
        """The verdict through the points that the motion passes, if it misses waypoints by little.

        Where that does not help, also with the velocities that it has at its ends (MoveIt's
        time-optimal timing begins with the velocity of its first millisecond). Little is at most
        `LITTLE` of the shortest segment, and of the velocity limits. None where a tolerance was
        given, or the motion would be invalid all the same.
        """
        if self.certificate.valid or self.via_tolerance:
            return None
        times = self.trajectory.waypoint_times
        misses = np.abs(self.trajectory(times) - self.problem.waypoints)
        needed = _rounded_up(float(np.where(misses > self.problem.rounding, misses, 0.0).max()))
        if needed > LITTLE * _shortest(self.problem):
            return None
        passed = _passed(self, needed) if needed else None
        return passed or _passed(self, needed, _ends_by_little(self))

    @property
    def best(self) -> Judgement:
        """This verdict, or the one without jerk limits or through the points that it passes."""
        nearly = self.nearly
        return self.without_jerk or (nearly and (nearly.without_jerk or nearly)) or self

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON: SI units, joints count from 1, None for what does not exist."""
        table = super().as_dict() | {
            "problem": self.problem.name,
            "via_tolerance": self.via_tolerance,
            "ends_taken": self.ends_taken,
            "status": str(self.status),
            "claimed_duration": self.claimed_duration,
            "gap": self.gap,
            "optimum_within_tolerance": self.optimum_within,
            "waypoint_times": self.trajectory.waypoint_times.tolist(),
            "flaws": list(self.certificate.flaws),
        }
        if self.problem.has("jerk"):
            table["without_jerk"] = self.without_jerk and self.without_jerk.as_dict()
        if not self.via_tolerance:
            table["nearly"] = self.nearly and self.nearly.as_dict()
        return table


def judge(
    problem: Problem | str | Path,
    motion: str | Path | Motion | Samples | Trajectory | PPoly | BSpline,
    *,
    interpolation: Interpolation = "auto",
    via_tolerance: float = 0.0,
    unit: str | None = None,
    noise: float | None = None,
    resolution: float | None = None,
    commanded: bool | None = None,
    window: float = DEFAULT_WINDOW_S,
    brake_first: bool = False,
) -> Judgement:
    """Judge a motion against a problem (docs/mathematics.md, section 11).

    A log, whose positions are not known well enough to determine its derivatives, gets the verdict
    of `trajopt.benchmark.logs` in the answer's `evidence`.

    Waypoint times are those of the closest approach to each waypoint, in order. With a tolerance, a
    waypoint that no joint misses by more is moved to where the motion passes. That is done only if
    the motion is invalid without it and valid with it; the name of the answer's `problem` says so.

    `UnitWarning` warns of a motion that moves about 57.3 times as far as the waypoints, or 1/57.3
    times: its angles are probably in another unit.

    Args:
        problem: or the name of a built-in one, or a problem file.
        motion: a file of samples or polynomials, or an object (`motion_of`).
        interpolation: how samples are joined; by default as a controller joins them.
        via_tolerance: largest miss of a waypoint by each joint, rad. It must be less than half of
            any segment; otherwise one instant might pass two waypoints.
        unit: units of a CSV's columns whose header says none, like "deg" or "deg,mm,ms".
        noise: standard deviation of the noise of a log's positions, rad; by default it is found.
        resolution: step of the sensors of a log, rad; by default it is found.
        commanded: whether a log's positions were sent, not measured, so that they are known to
            their digits; by default the columns' names and the format say it.
        window: a log is `kept` only if a mean excess of 5 % over this time, s, is excluded.
        brake_first: whether a start beyond limits may brake into them first
            (`trajopt.core.braking`). Then no optimum is compared.

    Raises:
        InvalidInput: The motion cannot be read, has other joints than the problem, or the
            tolerance is too large.
    """
    asked = catalogue.given(problem)
    units = dict(zip(asked.joint_labels, asked.joint_units, strict=False)) or dict.fromkeys(
        asked.joint_names, "rad"
    )
    given = motion_of(motion, interpolation, unit, units).for_joints(asked.joint_names)
    _check_joints(given, asked.joints)
    given.check_units(asked)
    _warn_of_other_unit(asked, given)
    _check_tolerance(asked, via_tolerance)
    braking = braking_of(asked) if brake_first else None
    if braking is not None:
        asked = braking.problem_of(given.trajectory)
    told = None
    if interpolation in AS_LOG:
        options = LogOptions(noise, resolution, commanded, window)
        told = evidence_of(given, asked.limits, options)
    # a log may be a part of a longer one, but states that the problem asks for are judged
    at_rest = told is None or told.at_rest or not asked.route.at_rest
    if told is not None and told.motion is not None and at_rest:
        times = passing(asked, told.motion).waypoint_times
        told = through(told, times, asked.waypoints)
    if told is None:
        given = at_turns(without_turns(given, asked.limits), asked)
    within = told and told.motion
    trajectory = passing(asked, within or given.trajectory)
    certificate = verify(asked, trajectory, at_rest=at_rest)
    strict = Judgement(given, asked, certificate, trajectory, via_tolerance, evidence=told)
    strict = replace(strict, braking=braking)
    strict = replace(strict, evidence=_confirmed(strict, valid=True))  # of limits, not waypoints
    if strict.certificate.valid or via_tolerance == 0:
        return strict
    return _passed(strict, via_tolerance) or strict


def _passed(
    strict: Judgement, via_tolerance: float, ends: Mapping[str, Array] = NOTHING
) -> Judgement | None:
    """Return the verdict through the points that the motion passes; None where it helps nothing.

    Args:
        strict: The verdict on the problem as it is.
        via_tolerance: How far it may miss each waypoint, rad.
        ends: Velocities at its ends that are taken as they are.
    """
    told, route = strict.evidence, strict.problem.route
    at_rest = told is None or told.at_rest or not route.at_rest
    moved = strict.problem
    if via_tolerance:
        moved = _as_passed(moved, strict.trajectory, via_tolerance)
    if ends:
        name = f"{moved.name}, with the motion's velocities at the ends"
        moved = replace(moved, demands={**moved.demands, **ends}, name=name)
    passed = replace(
        strict,
        problem=moved,
        certificate=verify(moved, strict.trajectory, at_rest=at_rest),
        via_tolerance=via_tolerance,
        tolerance_needed=via_tolerance > 0,
        asked=strict.problem,
        ends_taken=max((_off(strict, key, state) for key, state in ends.items()), default=0.0),
    )
    helps = passed.certificate.valid or (passed.without_jerk and not strict.without_jerk)
    return passed if helps else None


def _ends_by_little(strict: Judgement) -> dict[str, Array]:
    """Return the velocities at the ends, if they are other ones than demanded by little.

    One that differs by rounding is the one that is demanded.
    """
    limits = strict.problem.limits.in_all_segments()
    rounding = of_states(strict.problem).velocity
    sizes = np.abs(limits.velocity).min(axis=1)
    velocities = {}
    for key, value in states(strict.trajectory, limits).items():
        if key.endswith("velocity"):
            demanded = _demanded(strict, key)
            off = np.abs(value - demanded)
            if (off > LITTLE * sizes).any():
                return {}
            velocities[key] = np.where(off <= rounding, demanded, value)
    return velocities


def _demanded(strict: Judgement, key: str) -> Array:
    """Return a state that is demanded at an end; rest by default."""
    return np.zeros(strict.problem.joints) + strict.problem.demands.get(key, 0.0)


def _off(strict: Judgement, key: str, state: Array) -> float:
    return float(np.abs(state - _demanded(strict, key)).max())


def without_jerk(problem: Problem) -> Problem | None:
    """Return the problem without its jerk limits, named so; None where it has none."""
    if not problem.has("jerk"):
        return None
    return replace(problem.without("jerk"), name=f"{problem.name} without jerk limits")


def motion_of(
    motion: str | Path | Motion | Samples | Trajectory | PPoly | BSpline,
    interpolation: Interpolation = "auto",
    unit: str | None = None,
    joint_units: Mapping[str, str] = MappingProxyType({}),
) -> Motion:
    """Return the motion of a trial's file too, else what `trajopt.formats.motion` reads."""
    if not isinstance(motion, str | Path) or not is_trial(Path(motion)):
        return read_motion(motion, interpolation, unit, joint_units)
    (trial,) = recorded(Path(motion))
    if trial.solution.trajectory is None:
        raise InvalidInput("motion", "a trial with a trajectory", file=str(motion))
    of_trial = read_motion(trial.solution.trajectory, interpolation)
    return replace(of_trial, name=Path(motion).name, joint_names=trial.problem.joint_names)


def passing(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """Return the motion with its waypoint times: the given ones, or of the closest approach."""
    demand = problem.route.demand
    asked = demand("tolerance"), demand("least_times")
    excess = None
    if "tolerance" in problem.demands and problem.limits.segments is not None:
        excess = partial(_beyond_both, problem, trajectory)
    times = waypoint_times(trajectory, problem.waypoints, *asked, excess)
    waits = demand("dwell")
    given = np.append(0.0, np.cumsum(demand("given_times") + waits[:-1]))
    given[-1] += waits[-1]
    if "given_times" in problem.demands and np.isclose(given[-1], times[-1], rtol=1e-9, atol=0):
        times = given
        times[-1] = trajectory.duration
    return replace(trajectory, waypoint_times=times)


def _beyond_both(problem: Problem, motion: Trajectory, waypoint: int, times: Array) -> Array:
    """Return the excess of velocities over the limits of both segments at a waypoint."""
    both = [max(waypoint - 1, 0), min(waypoint, problem.segments - 1)]
    low, high = np.moveaxis(problem.limits.of_segments(np.array(both)).velocity, -1, 0)
    velocity = motion(times, 1)[:, None]
    use = np.maximum(velocity / high, velocity / low)
    return np.asarray(np.maximum(use.max(axis=(1, 2)) - 1, 0.0))


def _check_joints(motion: Motion, joints: int) -> None:
    count = motion.trajectory.joints
    if count != joints:
        raise InvalidInput("joints", f"{joints}, as the problem has", value=count, file=motion.name)


def _check_tolerance(problem: Problem, via_tolerance: float) -> None:
    shortest = _shortest(problem)
    if not 0 <= via_tolerance < shortest / 2:
        right = f"a number from 0 to less than half the shortest segment, {shortest:.4g} "
        right += problem.shared_unit()
        raise InvalidInput("via_tolerance", right, value=via_tolerance)


def _shortest(problem: Problem) -> float:
    """Return the largest displacement of any joint in the shortest segment that moves, rad."""
    largest = np.abs(problem.displacements).max(axis=1)
    return float(largest[largest > 0].min())


def _rounded_up(size: float) -> float:
    """Return the next larger number of one digit; 0 of 0."""
    if not 0 < size < np.inf:
        return 0.0
    unit = 10.0 ** np.floor(np.log10(size))
    return float(f"{np.ceil(size / unit * (1 - 1e-12)) * unit:.0e}")


def _as_passed(problem: Problem, trajectory: Trajectory, via_tolerance: float) -> Problem:
    """Return the problem through the points that the motion passes, within the tolerance.

    The points are moved into the position limits, since waypoints have to be inside.
    """
    passed = trajectory(trajectory.waypoint_times)
    low, high = problem.limits.position.T
    inside = np.clip(passed, low, high)
    miss = np.abs(passed - problem.waypoints).max(axis=1)
    moved = np.where(miss[:, None] <= via_tolerance, inside, problem.waypoints)
    tolerance = f"{via_tolerance:g} {problem.shared_unit()}"
    return replace(problem, waypoints=moved, name=f"{problem.name}, as passed within {tolerance}")


def as_executed(
    motion: Motion,
    limits: Limits,
    *,
    joint_units: Sequence[str] = (),
    accelerations: bool = True,
    log: LogOptions | None = None,
    ends: Mapping[str, Array] | None = None,
) -> Execution:
    """Judge a motion, as a controller runs it, by limits alone.

    How the motion begins and ends is a fact, unless `ends` demands a state: a motion may replace
    another one that runs, or be cut out of a longer one. Steps of whole turns of joints without
    position limits are no jumps. `UnitWarning` warns of a joint whose motion or limits seem to
    be in degrees.

    Args:
        motion: The motion as executed.
        limits: Of its joints, in its order.
        joint_units: "rad" or "m" per joint, as a `Problem` has them.
        accelerations: Whether accelerations are judged. If not, their limits only scale the jumps
            of velocity that are repaired.
        log: Returns the verdict on a log; None for a motion that is executed as it is.
        ends: The demanded states at both ends (`trajopt.core.demand.END_STATES`), at rest where one
            is missing; by default none is demanded.

    Raises:
        InvalidInput: It has another number of joints than the limits, or never moves.
    """
    _check_joints(motion, limits.joints)
    if limits.segments is not None:
        right = (
            "a motion judged against its problem: `trajopt judge MOTION PROBLEM` knows the segments"
        )
        raise InvalidInput("limits.segment", right)
    told = None
    if log is not None:
        judged = [accelerations] * limits.joints
        told = evidence_of(motion, limits, log, judged)
    if told is None:
        motion = without_turns(motion, limits)
    at_rest = told is None or told.at_rest
    trajectory = (told and told.motion) or motion.trajectory
    at_breaks = trajectory(trajectory.breaks)
    if not np.ptp(at_breaks, axis=0).any():
        known = "at its samples" if told is None else "within what its samples are known to"
        right = f"a motion; {known} this one stays where it is"
        raise InvalidInput("motion", right, file=motion.name)
    times = trajectory.breaks[_own_waypoints(at_breaks, limits)]
    timed = replace(trajectory, waypoint_times=times)
    low, high = limits.position.T
    problem = Problem(
        np.clip(timed(times), low, high),
        limits,
        name=motion.name,
        joint_names=motion.joint_names,
        joint_units=joint_units or motion.joint_units,
        demands=ends or NOTHING,
    )
    motion.check_units(problem)
    _warn_of_units(problem, motion.trajectory(times))
    unjudged = () if accelerations else ("acceleration",)
    certificate = _of_limits(problem, timed, unjudged, at_rest=at_rest)
    found = Execution(motion, problem, certificate, evidence=told)
    if ends is None and not (at_rest and certificate.valid):
        moving = replace(problem, demands=states(timed, limits))
        if told is not None:
            between = verify(moving, timed, unjudged=unjudged)
            if between.valid:
                found = Execution(motion, moving, between, evidence=told)
                return replace(found, evidence=_confirmed(found, valid=True))
        free = _of_limits(moving, timed, unjudged, at_rest=False)
        if len(free.flaws) < len(certificate.flaws) or not at_rest:
            found = replace(found, problem=moving, certificate=free, cut=True)
    return replace(found, evidence=_confirmed(found, valid=found.certificate.valid))


def taking_over(found: Execution, before: Motion, at: float) -> Execution:
    """Return the verdict on a motion that takes over from another one that runs.

    Args:
        found: The verdict on its limits alone (`as_executed`).
        before: The motion before, in the same order of joints.
        at: Time of the hand-over in it, s.

    Returns:
        The verdict with the jumps of position, velocity and acceleration there, in `jumps`; those
        that are too large are flaws.

    Raises:
        InvalidInput: The motion before ends earlier, or has other joints.
    """
    running = before.trajectory
    _check_joints(before, found.problem.joints)
    if not 0 <= at <= running.duration:
        right = f"a time from 0 to {running.duration:.6g} s, in {before.name}"
        raise InvalidInput("at", right, value=at)
    state = [running(at, order) for order in range(3)]
    jumps, flaws = hand_over(found.problem, found.executed, state)
    certificate = replace(found.certificate, flaws=(*flaws, *found.certificate.flaws))
    return replace(found, certificate=certificate, jumps=tuple(jumps))


def _of_limits(
    problem: Problem, trajectory: Trajectory, unjudged: Collection[str], *, at_rest: bool
) -> Certificate:
    """Return the certificate of a motion whose waypoints are its own.

    These are moved into the position limits; a motion that leaves them misses no waypoint there,
    and does not jump.
    """
    certificate = verify(problem, trajectory, unjudged=unjudged, at_rest=at_rest)
    beyond = np.abs(trajectory(trajectory.waypoint_times) - problem.waypoints).max(axis=0)
    if certificate.valid or not (beyond > problem.rounding).any():
        return certificate
    free = replace(problem.without("position"), waypoints=trajectory(trajectory.waypoint_times))
    found = verify(free, trajectory, unjudged=unjudged, at_rest=at_rest)
    use = problem.limits.worst("position", trajectory)
    flaw = problem.limits.kinds["position"].flaw(use, np.zeros(problem.joints), problem)
    if flaw and use.joint is not None:
        low, high = problem.limits.position[use.joint]
        there = float(trajectory(use.time)[use.joint])
        flaw += f" ({there:.3g} of {high if there > high else low:.3g})"
    uses = {key: found.uses.get(key, use) for key in certificate.uses}
    return replace(found, uses=uses, flaws=tuple(filter(None, [flaw, *found.flaws])))


def _confirmed(found: Execution, *, valid: bool) -> Evidence | None:
    """Return the evidence; a log is `kept` only if its motion keeps every other limit too."""
    told = found.evidence
    if told is None or told.verdict != "kept":
        return told
    certificate = found.certificate
    limits = found.problem.limits
    unknown = limits.others if limits.segments is None else limits.kinds  # to the evidence
    uses = [certificate.uses[key].value for key in unknown if KINDS[key].is_ratio]
    kept = max(uses, default=0.0) <= 1 + certificate.tolerance.limit
    return told if kept and valid else replace(told, verdict="cannot be told")


def _warn_of_other_unit(problem: Problem, motion: Motion) -> None:
    """Warn if the motion spans about 180 / pi times as much as the waypoints, or pi / 180."""
    if problem.shared_unit() != "rad":
        return
    moved = motion.trajectory(motion.trajectory.breaks)
    ratio = np.ptp(moved, axis=0).max() / np.ptp(problem.waypoints, axis=0).max()
    low, high = _RAD_IN_DEG
    if low < ratio < high or 1 / high < ratio < 1 / low:
        warnings.warn(
            UnitWarning(f"{motion.name} spans {ratio:.3g} times the waypoints: deg beside rad?"),
            stacklevel=3,
        )


def _warn_of_units(problem: Problem, positions: Array) -> None:
    """Warn of the first joint that looks as if its motion or its limits were in degrees.

    Joint by joint: a `!degrees` may be lost in one line of a joint_limits.yaml. The positions are
    those of the motion, which may be far outside the limits.
    """
    for joint in np.flatnonzero(np.ptp(positions, axis=0)).tolist():
        velocity = problem.limits.velocity[[joint]]
        # an acceleration limit of its own may be right: only the velocity is tested
        mixed = mixed_units(positions[:, [joint]], velocity, acceleration=velocity)
        if mixed and problem.unit(joint) == "rad":
            label = problem.joint_labels[joint]
            message = f"{problem.name}, {label}: {mixed}; limits are rad/s, or tagged !degrees"
            warnings.warn(UnitWarning(message), stacklevel=3)
            return


def without_turns(motion: Motion, limits: Limits) -> Motion:
    """Return the motion without steps of whole turns of joints without position limits."""
    samples = motion.samples
    if samples is None:
        return motion
    turning = [unit != "m" for unit in motion.joint_units] or [True] * limits.joints
    exact = np.zeros(limits.joints)
    positions, rows = unwrapped(samples.times, samples.positions, exact, limits, turning)
    if not any(rows):
        return motion
    names = [name for name, is_turned in zip(samples.joint_names, rows, strict=True) if is_turned]
    warnings.warn(
        FileNote(f"{motion.name}: steps of whole turns are no motion of {', '.join(names)}"),
        stacklevel=3,
    )
    kind: Any = motion.interpolation
    again = of_samples(motion.name, replace(samples, positions=positions), kind)
    return replace(motion, trajectory=again.trajectory, samples=again.samples)


def at_turns(motion: Motion, problem: Problem) -> Motion:
    """Return the motion with joints without position limits moved by whole turns to its start."""
    trajectory = motion.trajectory
    free = np.isinf(problem.limits.position).all(axis=1)
    turning = [problem.unit(joint) == "rad" for joint in range(problem.joints)]
    turns = np.round((problem.waypoints[0] - trajectory(0.0)) / tau) * (free & np.array(turning))
    turns[np.abs(turns) > 1e3] = 0.0  # no numbers of a robot
    if not turns.any():
        return motion
    joints = [label for label, turn in zip(problem.joint_labels, turns, strict=True) if turn]
    warnings.warn(
        FileNote(f"{motion.name}: moved by whole turns to the first waypoint: {', '.join(joints)}"),
        stacklevel=3,
    )
    moved = trajectory.coefficients.copy()
    moved[-1] += tau * turns
    return replace(motion, trajectory=replace(trajectory, coefficients=moved))


def _ends(motion: Trajectory) -> dict[str, list[float]]:
    """Return the velocities at both ends, SI units, a number per joint."""
    first, last = motion(np.array([0.0, motion.duration]), 1).tolist()
    return {"start_velocity": first, "end_velocity": last}


def _own_waypoints(positions: Array, limits: Limits) -> NDArray[np.intp]:
    """Return start, end, and where each joint is farthest from its start within its limits.

    These waypoints give every joint the displacement that its tolerances are relative to.
    """
    low, high = limits.position.T
    inside = ((positions >= low) & (positions <= high)).all(axis=1)
    inside[[0, -1]] = True
    distances = np.abs(positions - positions[0])
    distances[~inside] = 0.0
    farthest = np.argmax(distances, axis=0)
    return np.unique(np.concatenate([[0], farthest, [len(positions) - 1]]))


@dataclass(frozen=True, eq=False)
class GivenMotion(Planner):
    """A motion that takes part in a comparison beside the planners.

    Its options are the interpolation and a digest of the executed polynomials: a changed file is
    another motion, and the old trials are not shown for it.
    """

    motion: Motion

    drops = True  # no limit is planned for: all are judged
    knows = (*DEMANDS, "segment")

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the motion with the times at which it comes closest to the waypoints, in order."""
        ordered = self.motion.for_joints(problem.joint_names)
        return Solution(Status.SOLVED, passing(problem, ordered.trajectory))

    def unsupported(self, problem: Problem) -> str | None:
        """Say why it is not a motion of this problem's robot; None if it is."""
        joints = self.motion.trajectory.joints
        if joints != problem.joints:
            return f"a motion of {joints} joints; the problem has {problem.joints}"
        try:
            self.motion.for_joints(problem.joint_names).check_units(problem)
        except InvalidInput as error:
            return str(error)
        return None

    def options(self) -> dict[str, Any]:
        return {"interpolation": self.motion.interpolation, "digest": self.motion.digest()}

    def defaults(self) -> dict[str, Any]:
        return self.options()
