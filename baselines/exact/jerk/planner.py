"""The exact minimum time with velocity, acceleration and jerk limits (mathematics, section 5).

Nothing is discretised. A joint goes from one state (velocity, acceleration) to another in the time
`T` of a segment. The displacements that the limits allow then fill an interval `[D_lo, D_up]`.
`exact.jerk.profiles` has both ends of it in closed form, with their derivatives. So the segment
times and the waypoints' states are the only variables of a small program. An interior-point method
made for this program solves it (`exact.method.interior_point`).

    from baselines.exact.jerk import ExactJerk
    trajectory = ExactJerk().solve(problem).trajectory
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import TYPE_CHECKING

import numpy as np

from baselines.exact.acceleration import Exact, boxes
from baselines.exact.acceleration.planner import without_jerk
from baselines.exact.jerk import gaps, one_sided
from baselines.exact.jerk.cells import JerkInequalities, JerkTables
from baselines.exact.jerk.gaps import JerkStart
from baselines.exact.method import brief_steps, free_pieces, gate, one_piece
from baselines.exact.method.free_pieces import FreeGuess, FreeOptimum
from baselines.exact.method.interior_point import (
    begun,
    chosen,
    converged,
    descended,
    joined,
)
from baselines.exact.method.planner import (
    DEMANDS_KNOWN,
    LocalOptimum,
    SeveralStarts,
    certified,
    unconverged,
    without_ipopt,
)
from baselines.exact.method.scaled import Scaled, leave
from trajopt.core.arrays import Array
from trajopt.core.demand import END_STATES
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import keeping
from trajopt.planners.reductions import SIMPLEST, reduced

if TYPE_CHECKING:
    from baselines.exact.jerk.motion import Reachable

# Most initial guesses, relative to `starts`: they are tried as long as all have failed. Fewer: no
# answer where a later one would have had one. More: CPU time where none has.
MAX_STARTS_FACTOR = 3
# An initial guess stops at every waypoint. Least and largest time of a segment, relative to the
# least time with such stops. At 1 a guess has no slack.
STOPPING_DILATION = 1.05
MAX_START_DILATION = 1.5
# The motion through the exact points, as an initial guess: times so much longer, and steps. At 1
# the guess has no slack. Fewer steps: the last iterate is longer. More: CPU time in dozens of
# points.
_SLOWER = 1.02
_MOST_STEPS = 400
# For each problem, where boxes overlap and there are several problems: more cost CPU time in each.
_FEW_STARTS = 2
# A segment in motion that takes longer than its first possible time, relative, is tried again, from
# these shares of that time. Fewer shares: a motion just behind that time is missed.
_SAME_RTOL = 1e-9
_BESIDE_FIRST = (1.0, 1.01, 1.1, 1.3, 1.5, 2.0)
# Factor on the tolerances that is still accepted if rounding stops the method. Smaller: no answer
# there. Larger: durations above the optimum by as much.
ACCEPTED = 100.0


@dataclass(frozen=True)
class ExactJerk(SeveralStarts):
    """Exact minimum time under velocity, acceleration and jerk limits (several starts).

    Limits may be asymmetric, joints may rest, and some joints may have no jerk limit. Jerk limits
    may be from 1 to 1e5 times those of acceleration; with 1e5 times the duration is within 1e-4 of
    the optimum without jerk limits. There are several initial guesses (`starts`), and the answer is
    the best local optimum found, which is not proved. `solver` is its own interior-point method, or
    IPOPT on a program of other variables, an independent check.

    A jerk limit on one side only is unsupported: there is no optimum. Acceleration has to be
    continuous where jerk is limited on any side. On the side without a limit it may change as
    steeply as it likes, and a steeper change is always a little faster. A joint's jerk limit in
    some segments only is unsupported for the same reason.
    """

    starts: int = 4

    knows = (
        *("velocity", "acceleration", "jerk", "segment"),
        *(*END_STATES, *DEMANDS_KNOWN, "tolerance"),
    )
    seconds = (3e-4, 2e-8)

    def unsupported(self, problem: Problem) -> str | None:
        if self.solver == "ipopt" and problem.limits.segments is not None:
            return "its program for IPOPT has the same limits in all segments"
        return one_sided.unsupported(problem) or without_ipopt(self.solver, problem)

    @reduced(SIMPLEST)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best of several local optima. `stats`: each start's status and duration (s).

        Where no joint has a jerk limit, `exact` solves the problem.
        """
        if not problem.limits.jerk_limited.any():
            jerkless = problem.without("jerk")
            return Exact(self.starts, self.agreeing, self.solver).solve(jerkless)
        self.announce("exact-jerk", problem)
        if self.solver == "ipopt":  # an independent check: no other method steps in
            return self._planned(problem)
        return gate.certified(problem, self._planned, self.solve)

    def _planned(self, problem: Problem) -> Solution:
        """Return the planner's own answer, which nobody has judged."""
        known = problem.without(*self.unknown(problem))
        if "tolerance" in problem.demands:
            several = replace(self, starts=min(self.starts, _FEW_STARTS))
            found = boxes.best(self, problem, _solved_near, several)
        else:
            briefly = partial(self._solved, patient=False)
            stopping = _stopping if problem.route.at_rest else None
            found = brief_steps.solved(problem, known, self._solved, briefly, stopping)
        return boxes.or_freely(self, problem, known, found, _freely)

    def _solved(
        self,
        problem: Problem,
        left_out: Array | None,
        passing: Array | None = None,
        patient: bool = True,
    ) -> Solution:
        """Return the answer through these waypoints.

        Args:
            problem: Without waypoints to leave out.
            left_out: Positions of waypoints that were left out, see `Reachable`.
            passing: Further limits at the waypoints, in the form that `Scaled` takes.
            patient: Whether more initial guesses are tried where all have failed.
        """
        if problem.route.at_rest:
            return self._from_starts(problem, left_out, passing, patient)
        if (short := self.in_one_piece(problem)) is not None:
            return short
        if problem.segments == 1:
            return self._alone(problem, passing)
        for spare in gaps.SPARES:
            solution = self._from_starts(problem, left_out, passing, patient, spare)
            motion = solution.trajectory
            if motion is None or keeping(problem, motion) is not None:
                break
        return solution

    def _alone(self, problem: Problem, passing: Array | None) -> Solution:
        """Return the answer to a segment in motion: only the time is free.

        Where rounding breaks a limit at the first possible time, or the states are rounded so that
        there is none, the next ones may be far. Then the second method looks for a motion near it.
        """
        from baselines.exact.jerk.motion import Reachable

        known = problem.without(*self.unknown(problem))
        firsts: list[JerkStart] = []
        if one_piece.nearly(known):
            firsts += gaps.first_time(Reachable(problem, passing=passing), rounded=True)
        # no descent needs room inside the limits
        for spare in (0.0, *gaps.SPARES):
            scaled = Reachable(problem, passing=passing)
            leave(scaled, spare)
            starts = gaps.first_time(scaled)
            firsts += starts
            solution = self.best_of(scaled, partial(_met, scaled), iter(starts))
            motion = solution.trajectory
            kept = motion is None or keeping(known, motion) is not None
            if kept:
                break
        below = motion.duration if motion is not None and kept else certified(known, solution)
        first = min((own.times for own in firsts), key=np.sum, default=None)
        if first is None or below <= scaled.unit * first[0] * (1 + _SAME_RTOL):
            return solution
        guesses = [FreeGuess(share * first) for share in _BESIDE_FIRST]
        other = _freely(problem, passing, self, True, below, guesses)
        return solution if other.trajectory is None else other

    def shape(self, problem: Problem) -> Hashable:
        jerky = problem.limits.jerk_limited
        # without a jerk limit it is a problem of `exact`: solved alone
        return (super().shape(problem), tuple(jerky)) if jerky.any() else problem.digest()

    def first_optima(
        self, problems: Sequence[Problem]
    ) -> Iterator[tuple[Reachable, list[LocalOptimum]]]:
        from baselines.exact.jerk.motion import Reachable

        every = [Reachable(problem) for problem in problems]
        count = min(self.agreeing, self.starts)
        starts = [start for own in every for start in islice(_starts(own), count)]
        numbers = np.repeat(np.arange(len(every)), count)
        optima = iter(_minimised(every[0], starts, every=[every[i] for i in numbers]))
        for own in every:
            yield own, list(islice(optima, count))

    def motions(
        self, every: Sequence[Reachable], optima: Sequence[LocalOptimum]
    ) -> list[Trajectory]:
        from baselines.exact.jerk.motion import fitted

        times = np.array([own.times for own in optima])
        return fitted(every, times, joined([own.states for own in optima]))

    def _from_starts(
        self,
        problem: Problem,
        left_out: Array | None,
        passing: Array | None,
        patient: bool,
        spare: float = 0.0,
    ) -> Solution:
        """Return the best of the local optima; `spare`: share of the limits left to rounding."""
        # late: planners that are only listed need none of it
        from baselines.exact.jerk.motion import Reachable

        scaled = Reachable(problem, passing=passing)
        scaled.left_out = left_out
        if not problem.route.at_rest:
            leave(scaled, spare)

        def solve(starts: Sequence[JerkStart]) -> list[LocalOptimum]:
            if self.solver == "ipopt":
                from baselines.exact.jerk.by_ipopt import minimised

                return minimised(scaled, [own.times for own in starts])
            return _minimised(scaled, starts)

        if not problem.route.at_rest:
            beside = gaps.starts(scaled)
            known = solve(beside) if beside else []
            more = gaps.more_starts(scaled) if patient else iter(())
            if np.isfinite([own.duration for own in known]).any():
                more = islice(more, max(self.starts - len(known), 0))
            return self.best_of(scaled, solve, more, known)
        starts = islice(_starts(scaled), (MAX_STARTS_FACTOR if patient else 1) * self.starts)
        if not scaled.tolerance.any() or self.solver == "ipopt":
            return self.best_of(scaled, solve, starts)
        exact = self._from_starts(problem.without("tolerance"), None, passing, patient)
        if exact.trajectory is None:
            return self.best_of(scaled, solve, starts)
        near = self.best_of(scaled, solve, starts, _from_exact_points(scaled, exact.trajectory))
        return min(near, exact, key=partial(certified, problem))


def _solved_near(
    problem: Problem, passing: Array | None, planner: ExactJerk, patient: bool
) -> Solution:
    return planner._solved(problem, None, passing, patient)


def _freely(
    problem: Problem,
    passing: Array | None,
    planner: ExactJerk,
    _: bool,
    below: float,
    guesses: Iterable[FreeGuess] | None = None,
) -> Solution:
    from baselines.exact.jerk.motion import Reachable

    def optimum(scaled: Scaled, found: FreeOptimum) -> LocalOptimum:
        own = (found.times[None], found.velocity[None], found.acceleration[None])
        states = JerkTables(scaled).linked(*own)._replace(offset=found.offset[None])
        return LocalOptimum(float(found.times.sum()), found.times, states, "Converged")

    scales = [Reachable(problem, passing=passing) for _ in free_pieces.SPARES]
    if guesses is None:
        guesses = free_pieces.guesses(scales[0], without_jerk(problem, passing))
    return planner.freely(problem, scales, optimum, below, guesses)


def _stopping(problem: Problem, _: Array | None) -> Solution:
    """Return a motion that rests at every waypoint."""
    from baselines.exact.jerk.motion import Reachable

    scaled = Reachable(problem)
    start = next(_starts(scaled))
    states = JerkTables(scaled).linked(*(own[None] for own in start))
    return Solution(Status.SOLVED, scaled.trajectory(start.times, states))


def _starts(scaled: Scaled) -> Iterator[JerkStart]:
    """Yield initial guesses that stop at every waypoint; such a motion keeps all limits."""
    rng = np.random.default_rng(0)
    inner = scaled.h if scaled.closed else scaled.h[1:]
    at_rest = np.zeros_like(inner)
    yield JerkStart(STOPPING_DILATION * scaled.stop, at_rest, at_rest)
    while True:
        slower = rng.uniform(STOPPING_DILATION, MAX_START_DILATION, len(scaled.stop))
        yield JerkStart(slower * scaled.stop, at_rest, at_rest)


def _from_exact_points(scaled: Reachable, motion: Trajectory) -> list[LocalOptimum]:
    """Return the local optimum near the motion through the exact points, a little slower.

    Where dozens of points are near each other no other guess leads to an optimum in bounded time.
    The last iterate counts too, if the judge certifies its motion.
    """
    *_, a_unit, v_unit, _ = scaled.units
    times = motion.waypoint_times
    at = times[1:] if scaled.closed else times[1:-1]
    velocity, acceleration = motion(at, 1) / v_unit, motion(at, 2) / a_unit
    acceleration *= scaled.problem.limits.jerk_limited
    start = JerkStart(
        _SLOWER * np.diff(times) / scaled.unit, velocity / _SLOWER, acceleration / _SLOWER**2
    )
    (found,) = _minimised(scaled, [start], _MOST_STEPS)
    if np.isfinite(found.duration):
        return [found]
    is_kept = unconverged(scaled, [found]) is not None
    return [found._replace(duration=float(found.times.sum()))] if is_kept else []


def _met(scaled: Scaled, starts: Sequence[JerkStart]) -> list[LocalOptimum]:
    """Return starts that are optima themselves."""
    cells = JerkTables(scaled)
    optima = []
    for own in starts:
        states = cells.linked(*(values[None] for values in own))
        optima.append(LocalOptimum(own.times.sum(), own.times, states, "Converged"))
    return optima


def _minimised(
    scaled: Scaled,
    starts: Sequence[JerkStart],
    most_steps: int | None = None,
    every: Sequence[Scaled] = (),
) -> list[LocalOptimum]:
    """Return the local optimum that each initial guess leads to.

    Args:
        scaled: the problem; of several the first.
        starts: the guesses.
        most_steps: of the interior-point method; by default as many as it allows.
        every: the problem of each guess, where they are several.
    """
    cells = JerkTables(scaled, 2, every)
    times, velocity, acceleration = (np.array(own) for own in zip(*starts, strict=True))
    # the number of each guess's problem
    problems = np.unique([id(own) for own in every], return_inverse=True)[1] if every else None
    # a start that diverges overflows; `converged` is then false
    with np.errstate(all="ignore"):
        point = cells.linked(times, velocity, acceleration)
        rows = JerkInequalities(cells, point)
        if most_steps is not None:
            rows.max_iterations = most_steps
        iterate = descended(begun(rows), converged, problems=problems)
        done = converged(iterate, ACCEPTED)
    points = iterate.state.rows.point
    optima = []
    for k, times in enumerate(iterate.state.rows.times):
        states = chosen(points, slice(k, k + 1))
        optimum = LocalOptimum(times.sum(), times, states, "Converged")
        if not done[k]:
            optimum = optimum._replace(duration=np.inf, status="Not_Converged")
        optima.append(optimum)
    return optima
