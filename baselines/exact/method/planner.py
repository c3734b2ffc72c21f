"""Planners whose answer is the best of the local optima that several starts lead to."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import islice
from typing import Any, Literal, NamedTuple, Protocol, TypeVar

import numpy as np

from baselines.exact.method import bounds, free_pieces, one_piece
from baselines.exact.method.free_pieces import FreeGuess, FreeOptimum
from baselines.exact.method.scaled import leave
from baselines.several_starts import no_start_succeeded, optima_together, still_wanted
from baselines.sizes import announce, cells
from trajopt.core.arrays import Array
from trajopt.core.demand import names
from trajopt.core.exceptions import InvalidInput, InvalidTrajectory
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.route import NOTHING
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.together import verify_many
from trajopt.judging.verification import keeping, keeps, verify
from trajopt.planners.planner import Planner, Relation
from trajopt.planners.reductions import SIMPLEST

Start = TypeVar("Start")


# Demands of a route that both planners know.
DEMANDS_KNOWN = ("least_times", "given_times", "closed")
# A duration that exceeds the sum of the given times by less, relative, counts as equal: rounding.
_GIVEN_RTOL = 1e-10
# Largest possible excess over the optimum, relative, with which the second method is left out.
# Larger: motions that are too long by as much stay. Smaller: the second method runs in vain,
# where the bound leaves as much.
_NEAR_RTOL = 1e-4
_PROVED_RTOL = 1e-6  # and with which its next guesses are left out; smaller: more CPU time
_SAME_RTOL = 1e-12  # durations that differ by less, relative, are one: convergence leaves as much
# Most cells, segments times joints, of the problems that are solved together: with more, tables
# leave the processor's cache.
_MOST_CELLS = 4000


def without_ipopt(solver: str, problem: Problem, knows: Sequence[str] = ()) -> str | None:
    """Return why IPOPT's program cannot solve a problem: it knows no demands but `knows`."""
    unknown = [key for key in problem.demands if key not in knows]
    if solver != "ipopt" or not unknown:
        return None
    return f"its program for IPOPT does not know {names(unknown)}; the interior-point method does"


class LocalOptimum(NamedTuple):
    """The local optimum from one initial guess, exactly reachable.

    Attributes:
        duration: in the problem's own unit of time; infinite where there is no optimum.
        times: of the segments, in that unit, `(segments,)`.
        states: of the waypoints, without units, as `Reaching.trajectory` takes them.
        status: `Converged`, or IPOPT's own word.
    """

    duration: float
    times: Array
    states: Any
    status: str


class Reaching(Protocol):
    """A problem without units, and the motions through given waypoint states."""

    problem: Problem
    unit: float  # of time, s

    def trajectory(self, times: Array, states: Any, /) -> Trajectory:
        """Return the motion of these segment times and waypoint states."""


@dataclass(frozen=True)
class SeveralStarts(Planner):
    """A planner that returns the best of several local optima.

    It tries at most `starts` initial guesses, and stops when `agreeing` of them share the shortest
    duration.

    Kinds of limits that it does not know are ignored: with them the answer is `RELAXED`.
    """

    starts: int = 8
    agreeing: int = 2
    solver: Literal["interior-point", "ipopt"] = "interior-point"

    requires = ("scipy.linalg", "scipy.optimize")
    # CPU seconds of an initial guess for each segment and joint: a constant, and a factor of the
    # number of joints squared.
    seconds = (2e-4, 3e-9)

    def __post_init__(self) -> None:
        for name in ("starts", "agreeing"):
            value = getattr(self, name)
            if value < 1:
                raise InvalidInput(name, "at least 1", value=value)

    def relation(self, problem: Problem) -> Relation:
        """Return `RELAXATION` if limits of joints that move are ignored."""
        if self.joins_segments(problem) or self.unknown_demands(problem):
            return Relation.RESTRICTION
        ignores = self.unknown(problem) and self.unknown(SIMPLEST.apply(problem))
        return Relation.RELAXATION if ignores else Relation.SAME

    def solve_many(
        self, problems: Sequence[Problem], seeds: Sequence[int] | None = None
    ) -> list[Solution]:
        """Return one answer per problem, whatever the seeds; problems of one shape are one batch.

        Those are problems from rest to rest without demands and without tiny steps, with the
        interior-point method. If the first initial guesses do not agree on a problem, or the judge
        does not certify their motion, it is solved alone, like all others.
        """
        answers: list[Solution | None] = [None] * len(problems)
        alike: dict[Hashable, list[int]] = {}
        simplest = []
        for i, problem in enumerate(problems):
            steps, simple = SIMPLEST.applied(problem)
            simplest.append((steps, simple))
            if self.solver != "ipopt" and self.joins_a_batch(simple):
                alike.setdefault(self.shape(simple), []).append(i)
        for numbers in alike.values():
            size = max(1, _MOST_CELLS // cells(simplest[numbers[0]][1]))
            for first in range(0, len(numbers) if len(numbers) > 1 else 0, size):
                some = numbers[first : first + size]
                found = self._together([simplest[i][1] for i in some])
                for i, solution in zip(some, found, strict=True):
                    for reduction, asked in reversed(simplest[i][0]):
                        solution = solution and reduction.invert(asked, solution)
                    answers[i] = solution
        return [
            self.solve(problem) if answer is None else answer
            for problem, answer in zip(problems, answers, strict=True)
        ]

    def _together(self, problems: Sequence[Problem]) -> list[Solution | None]:
        """Return the answers to problems of one shape; None for one that is to be solved alone."""
        answers: list[Solution | None] = [None] * len(problems)
        agreed = []
        for i, (scaled, local) in enumerate(self.first_optima(problems)):
            if still_wanted(local, self.starts, self.agreeing) <= 0:
                agreed.append((i, scaled, local))
        if not agreed:
            return answers
        numbers, every, optima = zip(*agreed, strict=True)
        motions = self.motions(every, [_shortest(local)[0] for local in optima])
        some = [problems[i] for i in numbers]
        verdicts = verify_many(some, motions)
        rows = zip(numbers, every, optima, motions, verdicts, strict=True)
        for i, scaled, local, motion, verdict in rows:
            found = self.answered(problems[i], motion, stats_of(scaled, local))
            if found.status is not Status.SOLVED or verdict.valid:
                answers[i] = found
        return answers

    def joins_a_batch(self, problem: Problem) -> bool:
        """Return whether the problem can be solved together with others of its shape."""
        return not problem.demands and not spared(problem).any()

    def shape(self, problem: Problem) -> Hashable:
        """Return what problems have in common that can be one batch."""
        return problem.segments, problem.joints, problem.limits.segments is None

    @abstractmethod
    def first_optima(self, problems: Sequence[Problem]) -> Iterator[tuple[Any, list[LocalOptimum]]]:
        """Yield each problem of a batch without units, with the optima of its first guesses."""

    @abstractmethod
    def motions(self, every: Sequence[Any], optima: Sequence[LocalOptimum]) -> list[Trajectory]:
        """Return the motions of a batch of problems without units, each of one optimum."""

    def announce(self, planner: str, problem: Problem) -> None:
        """Log an estimate of the time that it will take, if that is long."""
        alone, by_pairs = self.seconds
        a_cell = alone + by_pairs * problem.joints**2
        a_start = a_cell * cells(problem)
        announce(planner, problem, min(self.starts, self.agreeing) * a_start)

    def in_one_piece(self, problem: Problem) -> Solution | None:
        """Return the answer of one piece to a segment in motion, if there is one."""
        if self.solver == "ipopt":
            return None
        motion = one_piece.motion(problem.without(*self.unknown(problem)))
        return None if motion is None else self.answered(problem, motion)

    def is_near(self, problem: Problem, found: Solution) -> bool:
        """Return whether the second method can be left out.

        It can if the motion begins and ends at rest, if it has one segment, or if a bound proves
        that the answer is within `_NEAR_RTOL` of the fastest.

        Args:
            problem: With the limits that count.
            found: The answer.
        """
        motion = found.trajectory
        alone = problem.route.at_rest or problem.segments == 1 or self.solver == "ipopt"
        return alone or (motion is not None and bounds.is_near(problem, motion, _NEAR_RTOL))

    def freely(
        self,
        problem: Problem,
        scales: Sequence[Any],
        optimum: Callable[[Any, FreeOptimum], LocalOptimum],
        below: float,
        guesses: Iterable[FreeGuess],
    ) -> Solution:
        """Return the shortest answer of the second method (`exact.method.free_pieces`).

        Args:
            problem: Whose motions begin or end in motion.
            scales: The problem without units, `Scaled` and `Reaching`, once for each of
                `free_pieces.SPARES`.
            optimum: Returns what the planner makes a motion of.
            below: Duration of a known answer, s; a longer one is none.
            guesses: Where it begins.
        """
        known = problem.without(*self.unknown(problem))
        for scaled, spare in zip(scales, free_pieces.SPARES, strict=True):
            leave(scaled, spare)
        shortest, best = below, None
        # limits that are wider at first lead to some optima, and away from others
        going = [(guess, widened) for guess in guesses for widened in (False, True)]
        for scaled in scales:
            failed, broken = [], []
            for guess, widened in going:
                most = shortest / scaled.unit
                found = free_pieces.minimised(scaled, *guess, widened=widened, below=most)
                if found is None:
                    failed.append((guess, widened))
                elif found.duration() < most:
                    motion = _kept(known, scaled, optimum(scaled, found), found)
                    if motion is None:
                        broken.append((guess, widened))
                        continue
                    shortest, best = motion.duration, motion
                    if bounds.is_near(known, best, _PROVED_RTOL):
                        return self.answered(problem, best)
            # the next share is for what breaks a limit; for all guesses where none led to a motion
            if len(failed) == len(going):
                broken = [(guess, widened) for guess, widened in failed if not widened]
            going = broken
        if best is None:
            return Solution(Status.FAILED, message="the second method finds none")
        return self.answered(problem, best)

    def best_of(
        self,
        scaled: Reaching,
        solve: Callable[[Sequence[Start]], list[LocalOptimum]],
        starts: Iterator[Start],
        known: Sequence[LocalOptimum] = (),
        beside: Sequence[Start] = (),
    ) -> Solution:
        """Return the shortest of the local optima, as an answer to the whole problem.

        `stats`: status and duration (s, infinite where it failed) of each start tried.

        Args:
            scaled: the problem.
            solve: returns the local optimum of each of some initial guesses.
            starts: the initial guesses, in the order in which they are tried.
            known: local optima that are known already, each on one side of a gap. Their agreement
                does not end the search, as it tells nothing about the other side of a gap.
            beside: initial guesses beside gaps, solved together with the first of `starts`.
        """
        first = list(islice(starts, min(self.agreeing, self.starts))) if beside else []
        together = solve([*beside, *first]) if beside else []
        known = [*known, *together[: len(beside)]]
        if np.isfinite([own.duration for own in known]).any():
            starts = islice(starts, self.starts - len(first))
        begun = together[len(beside) :]
        others = optima_together(solve, starts, self.starts, self.agreeing, begun=begun)
        local = [*known, *others]
        if not local:
            return Solution(Status.FAILED, message=no_start_succeeded([]))
        stats = stats_of(scaled, local)
        if not np.isfinite([optimum.duration for optimum in local]).any():
            message = no_start_succeeded(stats["start_status"])
            motion = None if self.solver == "ipopt" else unconverged(scaled, local)
            if motion is None:
                return Solution(Status.FAILED, message=message, stats=stats)
            found = self.answered(scaled.problem, motion, stats)
            said = f"{message}: the best of their last iterates that the judge certifies"
            return replace(found, message="; ".join(filter(None, [found.message, said])))
        # Durations may differ by rounding alone. Where no dilation mends an excess, take the first
        # of these motions that keeps its limits.
        ties = _shortest(local)
        answer = scaled.trajectory(ties[0].times, ties[0].states)
        for own in ties[1:] if not scaled.problem.route.dilatable else ():
            if keeping(scaled.problem, answer) is not None:
                break
            answer = scaled.trajectory(own.times, own.states)
        return self.answered(scaled.problem, answer, stats)

    def answered(
        self, problem: Problem, answer: Trajectory, stats: Mapping[str, Any] = NOTHING
    ) -> Solution:
        """Return a motion as an answer to the whole problem."""
        given = problem.route.demand("given_times").sum()
        if given and answer.duration > given * (1 + _GIVEN_RTOL):
            message = (
                f"no motion found in the given {given:.6g} s; the fastest one found, with no "
                f"segment faster than given, takes {answer.duration:.6g} s"
            )
            return Solution(Status.FAILED, message=message, stats=stats)
        ignored = [KINDS[key].name() for key in self.unknown(problem)]
        if not ignored:
            said = one_piece.rounded_away(problem, answer.duration)
            return Solution(Status.SOLVED, answer, said, stats=stats)
        kinds = " and ".join(ignored)
        best_known = f"{answer.duration:.6g} s is the best known without them, not proved"
        message = f"{kinds} limits are ignored: {best_known}"
        return Solution(Status.RELAXED, answer, message, stats=stats)


def _shortest(local: Sequence[LocalOptimum]) -> list[LocalOptimum]:
    """Return the optima of the shortest duration, but for rounding."""
    shortest = min(own.duration for own in local)
    return [own for own in local if own.duration <= shortest * (1 + _SAME_RTOL)]


def stats_of(scaled: Reaching, local: Sequence[LocalOptimum]) -> dict[str, Any]:
    """Return the status and the duration, s, of each start tried."""
    durations = np.array([optimum.duration for optimum in local])
    statuses = [optimum.status for optimum in local]
    return {"start_status": statuses, "start_duration": scaled.unit * durations}


def certified(problem: Problem, solution: Solution) -> float:
    """Return the certified duration of an answer, s; infinite where there is none."""
    motion = solution.trajectory
    return np.inf if motion is None else verify(problem, motion).certified_duration or np.inf


def unconverged(scaled: Reaching, local: Sequence[LocalOptimum]) -> Trajectory | None:
    """Return the shortest motion of the last iterates that the judge certifies."""
    found: list[tuple[float, Trajectory]] = []
    for own in local:
        motion = motion_of(scaled, own)
        if motion is not None:
            duration = verify(scaled.problem, motion).certified_duration
            found += [(duration, motion)] if duration is not None else []
    return min(found, key=lambda pair: pair[0])[1] if found else None


def _kept(known: Problem, scaled: Any, own: LocalOptimum, found: FreeOptimum) -> Trajectory | None:
    """Return the motion of an optimum, the planner's or of its pieces, if it keeps all limits."""
    for motion in (motion_of(scaled, own), free_pieces.motion(scaled, found)):
        if motion is not None and keeps(known, motion):
            return motion
    return None


def motion_of(scaled: Reaching, own: LocalOptimum) -> Trajectory | None:
    """Return the motion of an iterate; None where it is none: it may not have converged."""
    if own.states is None or not np.isfinite(own.times).all():
        return None
    try:
        with np.errstate(all="ignore"):
            return scaled.trajectory(own.times, own.states)
    except (InvalidTrajectory, ValueError, IndexError, np.linalg.LinAlgError):
        return None
