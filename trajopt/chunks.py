"""Chunks of learned policies: targets at a rate, executed as fast as the arm allows.

    chunk = trajopt.from_samples(targets, limits, rate=30, tolerance=0.005)
    answer = chunk.fastest()
    answer.duration, answer.motion

A policy emits 30 to 100 targets at once. The motion begins in the arm's state, passes every target
within a tolerance, and ends at the last one, at rest or in motion. `fastest` asks for the least
time. `at_given_times` asks that no target follows the one before sooner than the chunk says: where
its own times are possible these are the answer, else those of the least largest delay.

The answer is the planner's, or the clamped spline through the targets, dilated: whichever takes
less time, both judged. It is therefore never slower than that spline. Limits that the planner does
not know, such as the tool's speed, time the path of its motion anew.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial
from typing import Any, Literal, cast

import numpy as np
from numpy.typing import ArrayLike

from trajopt import retiming
from trajopt.benchmark.trial import (
    Answers,
    Configuration,
    Trial,
    answered,
    answered_many,
    judged,
    now,
    verdict,
)
from trajopt.best_planner import Prover, best
from trajopt.core.arrays import Array
from trajopt.core.chain import LinkChain
from trajopt.core.demand import END_STATES
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.tables import frozen
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import keeping, keeps, verify
from trajopt.planners.few_targets import FewTargets
from trajopt.planners.planner import Planner, Relation
from trajopt.planners.registry import load

Mode = Literal["fastest", "at-given-times"]
TOLERANCE = 0.005
"""By default targets are passed within this distance, rad (or m)."""

_PLANNER, _JERK_PLANNER = "exact:within=1e-4", "exact-jerk"
_BOUNDED_PLANNER = "exact:within=1e-3,starts=3"
QUICK = "few-targets", FewTargets()
"""A planner under jerk limits that answers in some tenths of a second, with its name."""
_SPLINE = "spline"
# Dilations of a spline that begins or ends in motion: the largest tried, and the factor of two
# between which the least one lies is halved so often.
_MAX_DILATION = 64.0
_HALVINGS = 12
_STILL_RTOL = 1e-9  # of a limit: what is smaller is rest
_SAME_RTOL = 1e-9  # durations that differ by less, relative, are one


@dataclass(frozen=True, eq=False)
class Chunk:
    """Targets of a policy, and what is asked of the motion through them.

    Attributes:
        problem: the targets as waypoints, within the tolerance but for the first and the last one,
            and the states at both ends. The first waypoint is the arm's place where the chunk
            begins.
        times: at which the chunk asks for these waypoints, from 0 on, s, `(waypoints,)`.
    """

    problem: Problem
    times: Array

    def __post_init__(self) -> None:
        object.__setattr__(self, "times", frozen(np.asarray(self.times, dtype=float)))

    @property
    def given_duration(self) -> float:
        """The time that the chunk asks for, s."""
        return float(self.times[-1])

    def fastest(self) -> ChunkAnswer:
        """Return the fastest certified motion through the targets."""
        return answers([self])[0]

    def at_given_times(self) -> ChunkAnswer:
        """Return the certified motion that is late by the least time, at the most late target."""
        return answers([self], "at-given-times")[0]

    @property
    def spline(self) -> DilatedSpline:
        """The planner of the clamped spline through the targets at the chunk's times."""
        return DilatedSpline(tuple(self.times.tolist()))

    def asked(self, mode: Mode) -> Problem:
        """Return the problem that a mode solves."""
        if mode == "fastest":
            return self.problem
        demands = {**self.problem.demands, "least_times": np.diff(self.times)}
        return replace(self.problem, demands=demands)


@dataclass(frozen=True, eq=False)
class ChunkAnswer:
    """A chunk's motion, and the verdict on it.

    Attributes:
        chunk: what was asked.
        mode: "fastest" or "at-given-times".
        trial: the motion, judged; `trajopt.write` writes it for a controller. Its planner says
            whether it is the spline's.
    """

    chunk: Chunk
    mode: Mode
    trial: Trial

    def __repr__(self) -> str:
        name = self.chunk.problem.name
        if self.duration is None:
            return f"ChunkAnswer({name}: {self.trial.message})"
        return f"ChunkAnswer({name}: {self.duration:.6g} s certified)"

    @property
    def motion(self) -> Trajectory | None:
        """The certified motion; None where there is none, and `trial.message` says why."""
        return self.trial.certified_trajectory

    @property
    def duration(self) -> float | None:
        """The certified duration, s; None without one."""
        return self.trial.certified_duration

    @cached_property
    def spline(self) -> float | None:
        """The duration of the clamped spline through the targets, s, as little dilated as possible.

        None where no dilation makes it lawful.
        """
        motion = self.chunk.spline.motion(self.chunk.asked(self.mode))
        return None if motion is None else motion.duration

    @cached_property
    def delay(self) -> float | None:
        """How late the motion passes the most late target, s; negative where all are early."""
        if self.motion is None:
            return None
        return float((self.motion.waypoint_times - self.chunk.times)[1:].max())

    @cached_property
    def deviation(self) -> float | None:
        """How far the motion passes from a target at most, rad (or m)."""
        if self.motion is None:
            return None
        passed = self.motion(self.motion.waypoint_times)
        return float(np.abs(passed - self.chunk.problem.waypoints).max())

    def bound(self, seconds: float = 60.0, within: float = 0.005) -> float:
        """Return a proved lower bound on the time through the targets, s; 0 where there is none.

        It is proved (`prove`) for motions of some joints that pass some of the targets: no motion
        of all joints through all of them is faster. Least times of segments are left out, and jerk
        limits where the chunk begins or ends in motion.

        Args:
            seconds: CPU time for the proof.
            within: gap of the answer to the bound at which to stop, relative.
        """
        if self.motion is None:
            return 0.0
        asked = self.chunk.problem
        if not asked.route.at_rest:
            asked = asked.without("jerk", "start_acceleration", "end_acceleration")
        prover = cast(Prover, load(f"prove:time_limit={seconds},within={within}"))
        return prover.beside(asked, self.motion)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON: SI units, joints count from 1, None for what does not exist."""
        return {
            "chunk": self.chunk.problem.name,
            "mode": self.mode,
            "given_duration": self.chunk.given_duration,
            "spline_duration": self.spline,
            "delay": self.delay,
            "deviation": self.deviation,
            **self.trial.as_dict(),
        }


def from_samples(
    targets: ArrayLike,
    limits: Limits,
    *,
    times: ArrayLike | None = None,
    rate: float | None = None,
    tolerance: ArrayLike = TOLERANCE,
    start: ArrayLike | None = None,
    name: str = "chunk",
    joint_names: Sequence[str] = (),
    joint_units: Sequence[str] = (),
    chain: LinkChain | None = None,
    start_velocity: ArrayLike | None = None,
    start_acceleration: ArrayLike | None = None,
    end_velocity: ArrayLike | None = None,
    end_acceleration: ArrayLike | None = None,
) -> Chunk:
    """Return the chunk of some targets.

    Args:
        targets: rad (or m), `(targets, joints)`, at least two.
        limits: of the arm.
        times: of the targets, strictly increasing, s, `(targets,)`.
        rate: targets per second, in place of `times`.
        tolerance: how far a target may be missed, rad (or m): a number, or one per joint. The last
            target is met exactly, and so is the first where the motion begins there.
        start: where the arm is, rad, `(joints,)`; the targets follow, the first one after one step
            of time. By default the motion begins at the first target.
        name, joint_names, joint_units, chain: as a `Problem` has them.
        start_velocity, end_velocity: rad/s, `(joints,)`; at rest by default.
        start_acceleration, end_acceleration: with jerk limits, rad/s², `(joints,)`; 0 by default.

    Raises:
        InvalidInput: The targets, times, limits or states cannot be used; it says which, where, and
            what would be right.
    """
    places = np.asarray(targets, dtype=float)
    if places.ndim != 2 or len(places) < 2:
        right = "(targets, joints), at least two targets"
        raise InvalidInput("targets", right, value=f"shape {places.shape}")
    for target, joint in np.argwhere(~np.isfinite(places))[:1].tolist():
        value = float(places[target, joint])
        raise InvalidInput(f"target {target + 1}", "a finite number", value=value, joint=joint)
    stamps = _times(times, rate, len(places))
    if start is not None:
        place = np.asarray(start, dtype=float)
        if place.shape != places.shape[1:]:
            right = f"{places.shape[1]} numbers, one per joint of the targets"
            raise InvalidInput("start", right, value=f"shape {place.shape}")
        places = np.vstack([place, places])
        stamps = np.append(0.0, stamps - stamps[0] + (stamps[1] - stamps[0]))
    states = {
        "start_velocity": start_velocity,
        "start_acceleration": start_acceleration,
        "end_velocity": end_velocity,
        "end_acceleration": end_acceleration,
    }
    stated = {key: state for key, state in states.items() if state is not None}
    near = {"tolerance": tolerance} if len(places) > 2 else {}
    problem = Problem(
        places,
        limits,
        name=name,
        joint_names=joint_names,
        joint_units=joint_units,
        chain=chain,
        demands={**near, **stated},
    )
    return Chunk(problem, stamps - stamps[0])


def _times(times: ArrayLike | None, rate: float | None, count: int) -> Array:
    """Return the times of the targets, s."""
    if (times is None) == (rate is None):
        raise InvalidInput("rate", "times or a rate, targets per second: one of both", value=rate)
    if rate is not None:
        if not 0 < rate < np.inf:
            raise InvalidInput("rate", "targets per second, above 0", value=rate)
        return np.arange(count) / rate
    stamps = np.asarray(times, dtype=float)
    if stamps.shape != (count,):
        raise InvalidInput("times", f"{count}, one per target", value=f"shape {stamps.shape}")
    for target in np.flatnonzero(~(np.diff(stamps) > 0) | ~np.isfinite(stamps[1:]))[:1].tolist():
        right = f"a time after {stamps[target]:.6g} s, that of the target before"
        raise InvalidInput(f"times, target {target + 2}", right, value=float(stamps[target + 1]))
    return stamps


def take_over(
    running: Trajectory,
    at: float,
    targets: ArrayLike,
    limits: Limits,
    *,
    mode: Mode = "fastest",
    **keywords: Any,
) -> ChunkAnswer:
    """Return the motion through new targets that takes over from one that runs, in bounded time.

    A few initial guesses are tried, then the spline. Slower methods are left out. Under jerk limits
    only the spline is as quick where the new motion begins in motion, and `QUICK` where it begins
    at rest. Without an answer `motion` is None, and the running motion goes on. That ends at rest,
    as every answer does that is not asked to end in motion.

    Args:
        running: the motion that runs.
        at: when it is left, s; after its end it is at rest.
        targets: those that are still ahead then, rad, `(targets, joints)`.
        limits: of the arm.
        mode: "fastest" or "at-given-times".
        keywords: as `from_samples` has them, but for the state at the start.

    Raises:
        InvalidInput: As `from_samples` does.
    """
    when = min(max(at, 0.0), running.duration)
    place, velocity, acceleration = (running(when, order) for order in range(3))
    jerky = limits.jerk_limited
    fastest, steepest = (
        np.abs(pairs).min(axis=1) for pairs in (limits.velocity, limits.acceleration)
    )
    states = {
        # the rounding of a motion at rest is no velocity
        "start_velocity": np.where(np.abs(velocity) > _STILL_RTOL * fastest, velocity, 0.0),
        "start_acceleration": np.where(
            jerky & (np.abs(acceleration) > _STILL_RTOL * steepest), acceleration, 0.0
        ),
    }
    moving: dict[str, Any] = {key: state for key, state in states.items() if state.any()}
    chunk = from_samples(targets, limits, start=place, **moving, **keywords)
    planner: object = QUICK if jerky.any() else _BOUNDED_PLANNER
    return answers([chunk], mode, planner, patient=False)[0]


def answers(
    chunks: Sequence[Chunk],
    mode: Mode = "fastest",
    planner: object = None,
    *,
    patient: bool = True,
    timeout: float | None = None,
    quick: bool = False,
) -> list[ChunkAnswer]:
    """Return the answers to several chunks; those of one shape are planned together.

    Args:
        chunks: of any size, of any robots.
        mode: "fastest" or "at-given-times".
        planner: a planner, or a registered one by its name; by default the best for the limits.
        patient: whether slower planners are asked where this one and the spline have no answer.
        timeout: wall time of a chunk with jerk limits, s, after which the planner is stopped, in a
            process of its own. Seconds are usual; from a state in motion it may take minutes.
            `QUICK` or the spline is the answer then.
        quick: whether `QUICK` plans under jerk limits, in place of the full search.

    Raises:
        UnknownName: There is no planner of this name.
    """
    problems = [chunk.asked(mode) for chunk in chunks]
    found: list[Trial | None] = [None] * len(chunks)
    by_limits = _PLANNER, QUICK if quick else _JERK_PLANNER
    for name in by_limits if planner is None else (planner,):
        jerky = name is by_limits[1]
        places = [
            i
            for i, problem in enumerate(problems)
            if planner is not None or problem.has("jerk") == jerky
        ]
        some = [problems[i] for i in places]
        trials = (
            _planned(name, some)
            if timeout is None or name != _JERK_PLANNER
            else _stopped(name, some, timeout)
        )
        for i, trial in zip(places, trials, strict=True):
            found[i] = trial
    return [
        _better(chunk, mode, problem, trial, patient=patient)
        for chunk, problem, trial in zip(chunks, problems, found, strict=True)
        if trial is not None
    ]


def _planned(planner: object, problems: Sequence[Problem]) -> list[Trial]:
    """Return the judged answers of a planner, which may plan problems together.

    It plans without the limits that it does not know; the judge dilates what breaks these.
    """
    if not problems:
        return []
    configuration = Configuration.given(planner)
    started = now()
    known = _as_known(planner, problems)
    every: list[Answers] = []
    if len(problems) > 1:
        try:
            every = answered_many(configuration.planner, known, [0] * len(known))
        except Exception:  # whatever a planner raises: which of them it failed on is not known
            every = []
    every = every or [answered(configuration.planner, problem, [0]) for problem in known]
    return [
        judged(configuration.entrant, problem, [0], found, started)[0]
        for problem, found in zip(problems, every, strict=True)
    ]


def _stopped(planner: object, problems: Sequence[Problem], seconds: float) -> list[Trial]:
    """Return the judged answers of a planner that is stopped after a time for each problem."""
    if not problems:
        return []
    from trajopt.benchmark.run.runner import Supervised  # late: needs cloudpickle

    known = _as_known(planner, problems)
    with closing(Supervised(planner, known[0], timeout=seconds)) as chosen:
        found = [chosen.trials(problem, [0])[0] for problem in known]
    return [_judged_on(problem, trial) for problem, trial in zip(problems, found, strict=True)]


def _as_known(planner: object, problems: Sequence[Problem]) -> list[Problem]:
    """Return problems without the limits that a planner does not know."""
    chosen = Configuration.given(planner).planner
    return [problem.without(*chosen.unknown(problem)) for problem in problems]


def _better(
    chunk: Chunk, mode: Mode, problem: Problem, trial: Trial, *, patient: bool
) -> ChunkAnswer:
    """Return the planner's answer, or the spline's where that is no slower."""
    if mode == "fastest" and not trial.feasible:
        trial = _retimed(problem, trial) or trial
    if trial.certified_duration is None and patient and problem.has("jerk"):
        (other,) = _planned(QUICK, [problem])
        trial = other if other.feasible else trial
    planned = trial.certified_duration
    motion = chunk.spline.motion(problem, planned)
    if motion is not None and (planned is None or motion.duration <= planned * (1 + _SAME_RTOL)):
        configuration = Configuration.of(chunk.spline, _SPLINE, _SPLINE)
        solution = Solution(Status.SOLVED, motion, trial.message if planned is None else "")
        found = Answers([solution], Relation.RESTRICTION, wall_time=trial.solve_time)
        trial = judged(configuration.entrant, problem, [0], found, trial.started)[0]
    elif planned is None and trial.status is not Status.INFEASIBLE and patient:
        trial = best(problem, 0).trial
    return ChunkAnswer(chunk, mode, trial)


def _retimed(problem: Problem, trial: Trial) -> Trial | None:
    """Return a motion along the path of one that breaks limits, timed under all of them."""
    motion = trial.solution.trajectory
    if motion is None:
        return None
    found = retiming.along(problem.name, motion, problem.without("tolerance")).trial
    timed = _judged_on(problem, found)
    is_shorter = (timed.certified_duration or np.inf) < (trial.certified_duration or np.inf)
    return timed if is_shorter else None


def _judged_on(problem: Problem, trial: Trial) -> Trial:
    """Return a trial, planned without some of a problem's limits, judged on the whole problem."""
    if trial.problem is problem:
        return trial
    status, message, certificate = verdict(problem, trial.solution)
    return replace(trial, problem=problem, status=status, message=message, certificate=certificate)


@dataclass(frozen=True)
class DilatedSpline(Planner):
    """The clamped cubic spline through the points at given times, dilated as little as possible.

    With jerk limits it is the quintic spline, with accelerations at its ends: a cubic one begins
    with a jump of the acceleration.

    Attributes:
        times: of the waypoints, s.
    """

    times: tuple[float, ...]

    knows = (
        *("velocity", "acceleration", "jerk", "position", "segment"),
        *(*END_STATES, "least_times", "tolerance"),
    )

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        motion = self.motion(problem)
        if motion is None:
            return Solution(Status.FAILED, message="no dilation makes the spline lawful")
        return Solution(Status.SOLVED, motion)

    def motion(self, problem: Problem, above: float | None = None) -> Trajectory | None:
        """Return the certified spline of least dilation; None where none is lawful.

        Args:
            problem: through the waypoints.
            above: the duration of an answer that is known, s. A spline in motion at an end that is
                not lawful in that time is None: a slower one is of no use.
        """
        least = 1.0 if "least_times" in problem.demands else 0.0
        if problem.route.dilatable:
            whole = self._spline(problem, 1.0)
            certificate = verify(problem.without("least_times"), whole)
            if not certificate.valid:
                return None
            return keeping(problem, whole.dilated(max(certificate.dilation, least, 1e-12)))

        def lawful(k: float) -> Trajectory | None:
            spline = self._spline(problem, k)
            return spline if keeps(problem, spline) else None

        if above is None:
            return _least(lawful, 1.0, least)
        first = max(above / self.times[-1], least)
        return _least(lawful, first, least) if lawful(first) else None

    def _spline(self, problem: Problem, dilation: float) -> Trajectory:
        """Return the spline in `dilation` times the given times, with the states at the ends."""
        from scipy.interpolate import CubicSpline, make_interp_spline  # late: SciPy is large

        times = dilation * np.array(self.times)
        begins, ends = problem.route.start, problem.route.end
        if not problem.has("jerk"):
            cubic = CubicSpline(times, problem.waypoints, bc_type=((1, begins[0]), (1, ends[0])))
            return Trajectory(times, cubic.c, times)
        rules = tuple([(1, state[0]), (2, state[1])] for state in (begins, ends))
        quintic = make_interp_spline(times, problem.waypoints, k=5, bc_type=rules)
        taylor = [quintic(times[:-1], order) / factorial(order) for order in range(5, -1, -1)]
        return Trajectory(times, np.array(taylor), times)


def _least(
    lawful: Callable[[float], Trajectory | None], first: float, least: float
) -> Trajectory | None:
    """Return the motion of about the least dilation that is lawful.

    Args:
        lawful: returns the motion of a dilation, or None.
        first: the dilation that is tried first.
        least: no smaller one is tried.
    """
    found = lawful(first)
    low, high = first, first
    while found is None and high < _MAX_DILATION:
        low, high = high, 2 * high
        found = lawful(high)
    while high == low and low > max(least, first / _MAX_DILATION):
        low = max(low / 2, least)
        faster = lawful(low)
        if faster is None:
            break
        found, high = faster, low
    for _ in range(_HALVINGS if low < high else 0):
        middle = (low + high) / 2
        faster = lawful(middle)
        if faster is None:
            low = middle
        else:
            found, high = faster, middle
    return found
