"""A trial: one planner on one problem with one seed, judged by the verifier."""

from __future__ import annotations

import hashlib
import importlib
import json
import sys
import time
import traceback
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from copy import deepcopy
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from itertools import islice
from numbers import Real
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from trajopt.benchmark.provenance import Code, code_of, judge_digest, plain, provenance
from trajopt.core.arrays import Array
from trajopt.core.exceptions import (
    InvalidInput,
    InvalidTrajectory,
    MissingBackend,
    shortened,
    shown,
)
from trajopt.core.files import MAX_NAME
from trajopt.core.harmless import harmless
from trajopt.core.numerals import is_number
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.tables import check_length
from trajopt.core.trajectory import Trajectory
from trajopt.judging.certificate import Certificate
from trajopt.judging.smoothness import Smoothness, of_certified
from trajopt.judging.together import verify_many
from trajopt.judging.verification import certified, fits, verify
from trajopt.planners.planner import Planner, Relation, adapted, check_visible
from trajopt.planners.registry import entries, label, named

DEGREE_MAX = 100  # largest polynomial degree; the memory for roots grows with its square
MAX_LABEL = 10 * MAX_NAME  # characters of a planner's name with its options
OUT_OF_MEMORY = "out of memory"  # the message of a trial with too little memory


@dataclass(frozen=True, eq=False)
class Trial:
    """One planner's answer on one problem with one seed, and the verdict on it.

    `planner` is its name, `label` the name with the options that differ from the registered ones,
    or the name that a user gave to a planner that is not registered.
    `status` and `message` are the verdict. Of a motion it follows from the motion alone, whatever
    its planner says: `solved` if the verifier certifies a duration, `invalid` if not. Without a
    motion the status is the planner's own. `setup_time` is the wall time, s, for what later calls
    need not repeat: importing what the planner requires, and building what it keeps. `solve_time`
    is the rest. Of a batch of `batch` runs solved together, each has its share. `asked` is the time
    at which a later comparison kept it in place of trials of newer code. `differences` are the
    statements of a file that the judge of this installation does not confirm.
    """

    problem: Problem
    planner: str
    label: str
    options: Mapping[str, Any]
    seed: int
    relation: Relation
    status: Status
    message: str
    solution: Solution
    certificate: Certificate | None
    setup_time: float
    solve_time: float
    batch: int
    started: str
    provenance: Mapping[str, str]
    asked: str = ""
    differences: tuple[str, ...] = ()

    def __repr__(self) -> str:
        verdict = str(self.status)
        if self.certified_duration is not None:
            verdict += f", {self.certified_duration:.6g} s certified"
        return f"Trial({self.label} on {self.problem.name}, seed {self.seed}, {verdict})"

    @cached_property
    def id(self) -> str:
        """Return the identity: problem digest, planner, all options, seed, and code."""
        return trial_id(self.problem, self.planner, self.options, self.seed, self.code)

    @property
    def code(self) -> str:
        """Return the digest of the code that ran; in old trials, the package's version."""
        return code_in(self.provenance)

    @property
    def runs_again(self) -> bool:
        """Return whether the next run repeats it: it crashed, was stopped, or lacked a package."""
        return self.status in (Status.CRASHED, Status.MISSING, Status.TIMEOUT)

    @property
    def claimed_duration(self) -> float | None:
        """The duration of the trajectory as the planner returned it, s."""
        trajectory = self.solution.trajectory
        return None if trajectory is None else trajectory.duration

    @property
    def certified_duration(self) -> float | None:
        """Return the certified duration, s; None without one."""
        return self.certificate.certified_duration if self.certificate else None

    @property
    def lower_bound(self) -> float | None:
        return self.solution.lower_bound

    @property
    def library_time(self) -> float | None:
        """The part of `solve_time` inside the calls of a library that plans, s; None without one.

        The planner states it, so no more than the whole counts.
        """
        stated = self.solution.library_time
        return None if stated is None else min(stated, self.solve_time)

    @property
    def dilation(self) -> float | None:
        """Return the least dilation that keeps the limits."""
        return self.certificate.dilation if self.certificate else None

    @property
    def position_excess(self) -> float | None:
        """The largest distance beyond a position limit, rad or m; None without such limits."""
        worst = self.certificate.position if self.certificate else None
        return max(0.0, worst.value) if worst else None

    @cached_property
    def smoothness(self) -> Smoothness | None:
        """Integrals of the motion that has the certified duration; None without one."""
        trajectory = self.solution.trajectory
        if trajectory is None or trajectory.joints != self.problem.joints:
            return None
        if self.certificate is None:
            return None
        return of_certified(self.problem, trajectory, self.certificate)

    @property
    def jerk_integral(self) -> float | None:
        """`∫ jerk²` over all joints, infinite where acceleration jumps."""
        return None if self.smoothness is None else self.smoothness.jerk_integral

    @property
    def acceleration_integral(self) -> float | None:
        """`∫ acceleration²` over all joints."""
        return None if self.smoothness is None else self.smoothness.acceleration_integral

    @property
    def jerk_rms_sum(self) -> float | None:
        """The sum of the joints' root mean square jerks, infinite where acceleration jumps."""
        return None if self.smoothness is None else self.smoothness.jerk_rms_sum

    @property
    def feasible(self) -> bool | None:
        """True if the trajectory keeps every limit as claimed; None without one."""
        return self.certificate.feasible if self.certificate else None

    @property
    def digest(self) -> str:
        """SHA-256 of the problem's numbers."""
        return self.problem.digest()

    @property
    def relaxed_duration(self) -> float | None:
        """The claimed duration of a relaxation's motion that breaks a limit, s; None elsewhere.

        It bounds nothing that other planners do: it is the best known without the ignored limits.
        """
        if self.relation is not Relation.RELAXATION or self.certificate is None:
            return None
        return None if self.certificate.nearly_feasible else self.claimed_duration

    @property
    def is_answered(self) -> bool:
        """True if there is a certified motion, or a lower bound."""
        return self.certified_duration is not None or self.lower_bound is not None

    @cached_property
    def certified_trajectory(self) -> Trajectory | None:
        """The trajectory that has the certified duration; None without one."""
        trajectory = self.solution.trajectory
        if trajectory is None or self.certificate is None or not self.certificate.valid:
            return None
        return self.certificate.certified_motion or certified(self.problem, trajectory)

    @property
    def certified_history(self) -> Array:
        """The search's certified duration over its evaluations: `(m, 2)`, evaluations and s.

        A planner's history holds claims; the dilation that its answer needed is applied to all of
        them, so that it ends at the certified duration and at all evaluations that were spent. NaN
        before the first candidate, and everywhere if nothing is certified. A history that does not
        lead to the answer (`Solution.history_flaw`) counts as none.
        """
        spent = float(self.solution.evaluations or 0)
        history = self.solution.history
        if history is None or not len(history) or self.solution.history_flaw:
            return np.array([[spent, np.nan]])
        last_spent, last_claim = history[-1]
        end = [max(spent, last_spent), last_claim]
        dilated = np.vstack([history, end])
        dilation = np.nan
        if self.certified_duration is not None:
            dilation = self.certified_duration / last_claim
        dilated[:, 1] *= dilation
        return dilated

    def as_dict(self) -> dict[str, Any]:
        """For JSON: SI units, joints count from 1, None for what does not exist."""
        trajectory = self.certified_trajectory
        times = None if trajectory is None else trajectory.waypoint_times.tolist()
        return {
            "problem": self.problem.name,
            "planner": self.planner,
            "options": dict(self.options),
            "seed": self.seed,
            "status": str(self.status),
            "message": self.message,
            "claimed_duration": self.claimed_duration,
            "certified_duration": self.certified_duration,
            "lower_bound": self.lower_bound,
            "smoothness": self.smoothness and self.smoothness.as_dict(),
            "waypoint_times": times,
            "evaluations": self.solution.evaluations,
            "setup_time": self.setup_time,
            "solve_time": self.solve_time,
            "library_time": self.library_time,
            "certificate": self.certificate.as_dict() if self.certificate else None,
        }


@dataclass(frozen=True)
class Entrant:
    """A planner as a trial states it: its name, its options, its code.

    Computed once where a run is planned: a worker elsewhere may have other files.
    """

    name: str
    label: str
    options: Mapping[str, Any]
    code: Code

    def trial_id(self, problem: Problem, seed: int) -> str:
        """The identity of its trial on a problem with a seed."""
        return trial_id(problem, self.name, self.options, seed, self.code.digest)


@dataclass(frozen=True)
class Configuration:
    """A planner as it runs, and what its trials keep of it."""

    planner: Planner
    entrant: Entrant

    @classmethod
    def of(cls, planner: object, name: str = "", shown: str = "") -> Configuration:
        """Configure a planner, or a function that plans; by default under its class's name.

        `shown` is its label; by default its name with the options that differ from the defaults.

        Raises:
            InvalidInput: for what is no planner, or may have options that nobody sees.
        """
        ours = adapted(planner)
        check_visible(ours)
        name = harmless(name or type(ours).__name__, lines=False)
        check_length("planner", name)
        options = {
            key: plain(value, f"planner {name}, option {key}")
            for key, value in ours.options().items()
        }
        shown = harmless(shown or label(name, ours), lines=False)
        if len(shown) > MAX_LABEL:
            right = f"options that are said in at most {MAX_LABEL} characters"
            raise InvalidInput("planner", right, value=shortened(shown, 60))
        return cls(ours, Entrant(name, shown, options, code_of(ours)))

    @classmethod
    def given(cls, planner: object) -> Configuration:
        """Configure a planner, a registered one by its name, or a pair of a name and a planner.

        A name that is given is the label, without options, unless a registered planner has it.

        Raises:
            InvalidInput: As `of` does, or another planner is registered by this name: `exact` is a
                reference by its name.
        """
        if isinstance(planner, str):
            name, loaded = named(planner)
            return cls.of(loaded, name)
        if isinstance(planner, tuple):
            name, unnamed = planner
            found = cls.of(unnamed, name, "" if name in entries() else name)
        else:
            found = cls.of(planner)
        _check_name(found)
        return found


def _check_name(configuration: Configuration) -> None:
    """Refuse the name of a registered planner for another one, also with options after it."""
    name = configuration.entrant.name
    registered = name.partition(":")[0]
    entry = entries().get(registered)
    if entry is not None and (
        name != registered or type(entry.load()) is not type(configuration.planner)
    ):
        right = f"a name of its own: {registered!r} is a registered planner"
        raise InvalidInput("planner", right, value=name)


@dataclass(frozen=True)
class Answers:
    """The answers of a planner to one call, a solution per seed, and the time they took.

    `relation` is how they relate to the optimum. `loading_time` went into importing what the
    planner requires, `wall_time` into the call, both in seconds. `together` is how many runs were
    solved in that call, where problems were solved together; 0 for these alone.
    """

    solutions: Sequence[Solution]
    relation: Relation
    loading_time: float = 0.0
    wall_time: float = 0.0
    together: int = 0

    def instead(self, solution: Solution) -> Answers:
        """Return the answers with one solution in place of each."""
        return replace(self, solutions=[solution] * len(self.solutions))


def trial_id(
    problem: Problem, planner: str, options: Mapping[str, Any], seed: int, code: str
) -> str:
    """A trial's identity as 20 hexadecimal digits; `code` is the digest of the code that ran."""
    identity = [problem.digest(), planner, dict(options), seed, code]
    text = json.dumps(identity, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def code_in(provenance: Mapping[str, str]) -> str:
    """Return the digest of the code that ran; in old trials, the package's version."""
    return provenance.get("planner_digest") or provenance["mintime"]


def trials_of(
    planner: object, problem: Problem, seeds: Sequence[int], name: str = ""
) -> list[Trial]:
    """Run a planner and verify its answers, one trial per seed; what it raises is recorded."""
    return run(Configuration.of(planner, name), problem, seeds)


def run(
    configuration: Configuration,
    problem: Problem,
    seeds: Sequence[int],
    limits: Mapping[str, str] = MappingProxyType({}),
) -> list[Trial]:
    """Run a configuration and verify its answers; `limits` of time and memory join the provenance.

    The planner is given a copy of the problem: whatever it does to that, it is judged on ours.
    """
    started = now()
    answers = answered(configuration.planner, copied(problem), seeds)
    return judged(configuration.entrant, problem, seeds, answers, started, limits)


def answered(planner: Planner, problem: Problem, seeds: Sequence[int]) -> Answers:
    """Run a planner: this, and nothing else, calls a stranger's `solve`."""
    loading_time = load_required(planner.requires)
    began = time.perf_counter()
    solutions = _solutions(planner, problem, seeds)
    wall_time = time.perf_counter() - began
    return Answers(solutions, _relation(planner, problem), loading_time, wall_time)


def answered_many(
    planner: Planner, problems: Sequence[Problem], seeds: Sequence[int]
) -> list[Answers]:
    """Run a planner on several problems together, each with a seed of its own.

    Raises:
        Exception: Whatever it raises. Which of the problems it failed on is not known.
    """
    loading_time = load_required(planner.requires)
    began = time.perf_counter()
    found = planner.solve_many(problems, seeds)
    if not isinstance(found, list | tuple) or len(found) != len(problems):
        raise TypeError(f"solve_many must return one Solution per problem, got {found!r:.200}")
    wall_time = time.perf_counter() - began
    return [
        Answers(
            [well_formed(solution)],
            _relation(planner, problem),
            loading_time,
            wall_time,
            len(problems),
        )
        for problem, solution in zip(problems, found, strict=True)
    ]


def judged(
    entrant: Entrant,
    problem: Problem,
    seeds: Sequence[int],
    answers: Answers,
    started: str,
    limits: Mapping[str, str] = MappingProxyType({}),
) -> list[Trial]:
    """Return the judged trials of answers, one per seed; they are verified on `problem`."""
    asked = Exchange(entrant, problem, tuple(seeds), answers, limits)
    return judged_many([asked], started)


class Exchange(NamedTuple):
    """What was asked of a planner on a problem, with seeds, and what it answered.

    `limits` are those of time and memory.
    """

    entrant: Entrant
    problem: Problem
    seeds: Sequence[int]
    answers: Answers
    limits: Mapping[str, str]


def judged_many(every: Sequence[Exchange], started: str) -> list[Trial]:
    """Return the judged trials of all answers, one after the other; they are verified together."""
    pairs = [
        (question.problem, solution)
        for question in every
        for solution in question.answers.solutions
    ]
    found = iter(verdicts(pairs))
    return [
        trial
        for question in every
        for trial in _trials(question, started, islice(found, len(question.answers.solutions)))
    ]


def _trials(asked: Exchange, started: str, verdicts: Iterable[Verdict]) -> list[Trial]:
    """Return the trials of judged answers."""
    entrant, problem, seeds, answers, limits = asked
    trials = []
    runs = answers.together or len(seeds)
    each = zip(seeds, answers.solutions, verdicts, strict=True)
    for seed, solution, (status, message, certificate) in each:
        stated = solution.setup_time
        building_time = stated / runs if stated <= answers.wall_time else 0.0
        solve_time = answers.wall_time / runs - building_time
        blank = unanswered(entrant, problem, seed, status, message, limits)
        trial = replace(
            blank,
            relation=answers.relation,
            solution=solution,
            certificate=certificate,
            setup_time=building_time + answers.loading_time / runs,
            solve_time=max(0.0, solve_time),
            batch=runs,
            started=started,
        )
        trials.append(trial)
    return trials


def unanswered(
    entrant: Entrant,
    problem: Problem,
    seed: int,
    status: Status,
    message: str,
    limits: Mapping[str, str] = MappingProxyType({}),
) -> Trial:
    """Return the trial of a planner without an answer: it hung, or its process died."""
    return Trial(
        problem=problem,
        planner=entrant.name,
        label=entrant.label,
        options=entrant.options,
        seed=seed,
        relation=Relation.RESTRICTION,
        status=status,
        message=message,
        solution=Solution(status, message=message),
        certificate=None,
        setup_time=0.0,
        solve_time=0.0,
        batch=1,
        started=now(),
        provenance={
            **provenance(),
            "judge_digest": judge_digest(problem),
            **entrant.code.as_dict(),
            **limits,
        },
    )


def now() -> str:
    """Return the present time in the form of trials: UTC, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def copied(problem: Problem) -> Problem:
    """Return a copy of the problem with its own read-only arrays."""
    return frozen(deepcopy(problem))


def frozen(problem: Problem) -> Problem:
    """Return the problem, whose arrays can then only be read: a copy, or one from a pickle."""
    arrays = [problem.waypoints]
    arrays += [limit.numbers for limit in problem.limits.kinds.values()]
    arrays += problem.limits.by_name().values()
    for array in arrays:
        array.setflags(write=False)
    return problem


Verdict = tuple[Status, str, Certificate | None]
"""Status, message and certificate."""


def verdicts(pairs: Sequence[tuple[Problem, Solution]]) -> list[Verdict]:
    """Return the verifier's verdict on each solution of a problem; the motions are one table."""
    motions = {
        place: motion
        for place, (problem, solution) in enumerate(pairs)
        if (motion := solution.trajectory) is not None and fits(problem, motion)
    }
    found = verify_many([pairs[place][0] for place in motions], list(motions.values()))
    certificates = dict(zip(motions, found, strict=True))
    return [verdict(*pair, certificates.get(place)) for place, pair in enumerate(pairs)]


def verdict(problem: Problem, solution: Solution, known: Certificate | None = None) -> Verdict:
    """Return the verifier's verdict on a solution.

    A motion is graded by what it does. Neither the planner's status, nor its relation, nor the
    limits that it knows change the verdict on it.

    Args:
        problem: That was asked.
        solution: The answer.
        known: The certificate of its motion, if that was verified before.
    """
    if solution.trajectory is None:
        if solution.status in (Status.SOLVED, Status.RELAXED):
            return Status.FAILED, f"reported {solution.status} without a trajectory", None
        return solution.status, solution.message, None
    try:
        certificate = known or verify(problem, solution.trajectory)
    except InvalidTrajectory as error:
        return Status.INVALID, str(error), None
    if not certificate.valid:
        flaws = "; ".join(certificate.flaws)
        return Status.INVALID, "; ".join(filter(None, [solution.message, flaws])), certificate
    kept_all_the_same = solution.status is Status.RELAXED and certificate.nearly_feasible
    return Status.SOLVED, "" if kept_all_the_same else solution.message, certificate


def load_required(modules: Sequence[str]) -> float:
    """Import what a planner requires and is not there yet; return how long that took, s."""
    absent = [name for name in modules if name not in sys.modules]
    if not absent:
        return 0.0
    began = time.perf_counter()
    for name in absent:
        with suppress(Exception, SystemExit):  # `solve` meets it again, and is recorded
            importlib.import_module(name)
    return time.perf_counter() - began


def _relation(planner: Planner, problem: Problem) -> Relation:
    try:
        return planner.relation(problem)
    except Exception:  # the trial reports the planner's error
        return Relation.RESTRICTION


def _solutions(planner: Planner, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
    try:
        reason = planner.unsupported(problem)
        if reason is not None:
            return [Solution(Status.UNSUPPORTED, message=reason)] * len(seeds)
        found = planner.solve_batch(problem, seeds)
        if not isinstance(found, list | tuple) or len(found) != len(seeds):
            raise TypeError(f"solve_batch must return one Solution per seed, got {found!r:.200}")
        return [well_formed(solution) for solution in found]
    except MissingBackend as error:
        return [Solution(Status.MISSING, message=str(error))] * len(seeds)
    except MemoryError:
        return [crash(OUT_OF_MEMORY)] * len(seeds)
    except (Exception, SystemExit):
        return [crash(traceback.format_exc())] * len(seeds)


def crash(message: str) -> Solution:
    """Return a crash that gives the reason in place of an answer."""
    return Solution(Status.CRASHED, message=message)


def well_formed(answer: Any) -> Solution:
    """Return the answer; if a part is not what a `Solution` holds, a crash that names it."""
    if not isinstance(answer, Solution):
        return crash(f"solve must return a Solution, got {_in_a_line(answer)}")
    for name, kinds in _KINDS.items():
        value = getattr(answer, name)
        if not isinstance(value, kinds):
            right = "an (m, 2) array" if name == "history" else getattr(kinds, "__name__", kinds)
            return crash(f"Solution.{name} cannot be {_in_a_line(value)}: expected {right}")
    if answer.trajectory is not None and len(answer.trajectory.coefficients) > DEGREE_MAX + 1:
        degree = len(answer.trajectory.coefficients) - 1
        return crash(f"Solution.trajectory is of degree {degree}, expected at most {DEGREE_MAX}")
    if not is_number(answer.setup_time) or answer.setup_time < 0:
        return crash(f"Solution.setup_time cannot be {_in_a_line(answer.setup_time)}")
    inside = answer.library_time
    if inside is not None and (not is_number(inside) or inside < 0):
        return crash(f"Solution.library_time cannot be {_in_a_line(inside)}")
    bound = answer.lower_bound
    if bound is not None and not is_number(bound):
        return crash(f"Solution.lower_bound cannot be {_in_a_line(bound)}")
    evaluations = answer.evaluations
    if evaluations is not None and not 0 <= evaluations <= _MOST_EVALUATIONS:
        return crash(f"Solution.evaluations cannot be {_in_a_line(evaluations)}")
    if answer.history is not None and answer.history.shape[1:] != (2,):
        return crash(f"Solution.history must be (m, 2), got {answer.history.shape}")
    return answer


def _in_a_line(value: object) -> str:
    return " ".join(shown(value).split())


_MOST_EVALUATIONS = 2**63 - 1  # the largest signed integer of 64 bits
_KINDS: dict[str, Any] = {  # types of a `Solution`'s fields
    "status": Status,
    "trajectory": Trajectory | None,
    "message": str,
    "lower_bound": Real | None,
    "evaluations": Real | None,
    "history": np.ndarray | None,
    "setup_time": Real,
    "library_time": Real | None,
    "stats": Mapping,
}
