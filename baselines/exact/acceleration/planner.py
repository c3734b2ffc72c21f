"""The exact minimum time with velocity and acceleration limits (mathematics, section 4).

Nothing is discretised. A joint passes a segment of time `T` with the end velocities `u` and `w`.
The displacements that the limits allow then fill an interval `[D_lo, D_up]`. At its ends the joint
speeds up to a peak `p`, cruises and brakes. With the peaks as variables the minimum-time problem is
a small smooth nonlinear program over segment times, waypoint velocities and peaks. It is not
convex, so there are several initial guesses, and the answer is best known, not proved. From each
guess an interior-point method made for this program (`exact.method.crossover`) leads to a local
optimum.

    from baselines.exact.acceleration import Exact
    solution = Exact().solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import Any

import numpy as np

from baselines.exact.acceleration import boxes, gaps, instants
from baselines.exact.acceleration.cells import AccelerationTables
from baselines.exact.acceleration.motion import SegmentTask, pieces
from baselines.exact.acceleration.newton_step import AccelerationInequalities
from baselines.exact.acceleration.profiles import extremes
from baselines.exact.method import brief_steps, free_pieces, gate, guesses, interior_point
from baselines.exact.method.chain import at_ends, with_outer
from baselines.exact.method.crossover import minimised
from baselines.exact.method.free_pieces import FreeOptimum
from baselines.exact.method.guesses import Guess
from baselines.exact.method.planner import (
    DEMANDS_KNOWN,
    LocalOptimum,
    SeveralStarts,
    motion_of,
    stats_of,
    without_ipopt,
)
from baselines.exact.method.scaled import BRIEF_PIECE_S, Abreast, Scaled, inner_velocities, motions
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.demand import END_STATES
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.rounding import KEPT_RTOL
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import flaws
from trajopt.planners.reductions import SIMPLEST, reduced
from trajopt.planners.rest_to_rest import stop_times

# Largest number of initial guesses if all fail, times `starts`. Fewer: no answer where a later one
# would have had one. More: CPU time where none has.
MAX_STARTS_FACTOR = 5
# Rounding of a velocity. Smaller: a brief segment needs a dilation for it, which does not help
# there.
_VELOCITY_RTOL = 1e-15
# Largest dilation of a solver's answer. Smaller: it is refused where its constraints are met badly.
# Larger: answers far from an optimum count.
MAX_DILATION = 2.0
# Excess over the limits for which a motion is planned within them. Larger: its end is missed by as
# much. Smaller: limits are wider by rounding where they need not be.
_NEGLIGIBLE = 1e-14
# A motion uses at most this share of the excess that the judge allows. At 1 nothing is left for the
# rounding of the judge.
_KEPT_SHARE = 0.45
# Shares by which limits are wider at first, for an interval of a single time. Where the limits of
# several joints meet in it, the descent needs the largest.
_WIDER = (1e-9, 1e-8, 1e-6)
# Excess over the limits of a time that rounding of several joints' borders moved. Smaller: the
# first time is missed. Larger: times are sharpened that are not possible.
_BORDER_EXCESS = 1e-8
# Rounding of a time at which a segment becomes possible. Larger: a time before it counts, too.
MAX_BORDER_DILATION = 1 + 1e-9
DILATION_TOL = 1e-15  # to which the least dilation is found, by halving; less is no number beside 1
# A velocity that is closer to its limit than this is set to the limit: the duration changes by the
# square of this.
_LIMIT_RTOL = 1e-9
# A mean acceleration in a segment closer to its limit than this, relative, is at the limit.
# Smaller: rounding of a brief segment hides it. Larger: a joint with slack counts as one without.
_FULL_RTOL = 1e-7
# Which initial guesses are tried, in this order, for an answer near an optimum: the nominal points
# in half and in all the time of stopping, the chord in all and in half of it, the chord slower.
_NEAR_GUESSES = (4, 3, 0, 1, 2)
_NEAR_STEPS = 45  # steps of the interior point at most; three of four guesses need fewer than 30
_NEAR_FACTOR = 10.0  # largest dilation of such an answer, times `within`; less: more are refused
_LEAST_SHARE = 0.03  # of its time of stopping, that a segment takes at least: costs up to 5e-5


@dataclass(frozen=True)
class Exact(SeveralStarts):
    """Exact minimum time under velocity and acceleration limits (several starts).

    On 2000 random problems all of 64 starts led to one optimum (`experiments/local_optima.py`). The
    second of two starts that agree guards against a start that ends badly. `solver` is its own
    interior-point method, or IPOPT on a program of other variables: an independent check.

    `within`, for problems with tolerances: an answer about this far above a local optimum,
    relative, is near enough. The first initial guess that leads to one ends the search, and
    `solve_many` advances problems of one shape together. By default the search goes on to the last
    digit, from every side of the tolerances: some 60 times the time where boxes overlap. With fewer
    than five `starts` it fails after so many guesses: its time is then bounded.
    """

    within: float = 0.0

    knows = (
        *("velocity", "acceleration", "segment"),
        *(*END_STATES, *DEMANDS_KNOWN, "tolerance"),
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.within < 1:
            raise InvalidInput("within", "a share from 0 to below 1", value=self.within)

    def unsupported(self, problem: Problem) -> str | None:
        return without_ipopt(self.solver, problem, END_STATES)

    @reduced(SIMPLEST)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best local optimum of `starts` initial guesses, or of more if all fail.

        `stats`: status and duration (s, infinite where it failed) of each start tried.
        """
        self.announce("exact", problem)
        if self.solver == "ipopt":  # an independent check: no other method steps in
            return self._planned(problem)
        if self._stops_near(problem):
            (near,) = self._near([problem])
            if near is None and self.starts < len(_NEAR_GUESSES):
                return Solution(Status.FAILED, message=f"none of {self.starts} guesses leads there")
            if near is not None:
                return near
        return gate.certified(problem, self._planned, self.solve)

    def _stops_near(self, problem: Problem) -> bool:
        """Return whether an answer near an optimum is enough."""
        return self.within > 0 and "tolerance" in problem.demands

    def joins_a_batch(self, problem: Problem) -> bool:
        return self._stops_near(problem) or super().joins_a_batch(problem)

    def shape(self, problem: Problem) -> Hashable:
        return super().shape(problem), *problem.demands

    def _together(self, problems: Sequence[Problem]) -> list[Solution | None]:
        if self._stops_near(problems[0]):
            return self._near(problems)
        return super()._together(problems)

    def _near(self, problems: Sequence[Problem]) -> list[Solution | None]:
        """Return answers near an optimum to problems of one shape; None where no guess leads there.

        A segment between boxes that overlap may take no time, which its logarithm does not reach.
        So each segment takes at least a share of its time of stopping, small enough to cost less
        than `within`.
        """
        every = [_not_at_once(problem) for problem in problems]
        answers: list[Solution | None] = [None] * len(every)
        left = list(range(len(every)))
        for number in _NEAR_GUESSES[: self.starts]:
            some = [every[i] for i in left]
            starts = [next(islice(_guesses(own, number + 1), number, None)) for own in some]
            with np.errstate(all="ignore"):
                found = _near_optima(some, starts, self.within)
            for i, own, optimum in zip(left, some, found, strict=True):
                motion = None if optimum is None else motion_of(own, optimum)
                if optimum is not None and motion is not None:
                    answer = self.answered(problems[i], motion, stats_of(own, [optimum]))
                    if answer.status is not Status.SOLVED or not flaws(problems[i], motion):
                        answers[i] = answer
            left = [i for i in left if answers[i] is None]
            if not left:
                break
        return answers

    def _planned(self, problem: Problem) -> Solution:
        """Return the planner's own answer, which nobody has judged."""
        known = problem.without(*self.unknown(problem))
        if "tolerance" in problem.demands:
            # the optimum may be on any side of a box: two guesses that agree say nothing
            sides = guesses.EVERY_SIDE
            several = replace(self, starts=max(self.starts, sides), agreeing=sides)
            found = boxes.best(self, problem, _solved_near, several)
            return boxes.or_freely(self, problem, known, found, _freely)
        return brief_steps.solved(problem, known, self._solved)

    def _solved(
        self,
        problem: Problem,
        _: Array | None,
        passing: Array | None = None,
        patient: bool = True,
    ) -> Solution:
        """Return the answer without leaving out waypoints.

        Args:
            problem: Through these waypoints.
            passing: Further limits at the waypoints, in the form that `Scaled` takes.
            patient: Whether more initial guesses are tried where all have failed.
        """
        if (short := self.in_one_piece(problem)) is not None:
            return short
        scaled = Passing(problem, passing)

        def solve_from(starts: Sequence[Guess]) -> list[LocalOptimum]:
            if self.solver == "ipopt":
                return _minimised_by_ipopt(scaled, starts)
            return _minimised([scaled] * len(starts), starts)

        known: list[LocalOptimum] = []
        beside: list[Guess] = []
        if not problem.route.at_rest:
            if self.solver != "ipopt":
                first_time = _of_one_segment(scaled)
                if first_time is not None:
                    return self.best_of(scaled, lambda _: [first_time], iter([None]))
                known = _before_gaps(scaled)
            beside = [*(Guess(*own) for own in gaps.starts(scaled)), *guesses.cruising(scaled)]
        starts = _guesses(scaled, (MAX_STARTS_FACTOR if patient else 1) * self.starts)
        return self.best_of(scaled, solve_from, starts, known, beside)

    def first_optima(
        self, problems: Sequence[Problem]
    ) -> Iterator[tuple[Passing, list[LocalOptimum]]]:
        every = [Passing(problem) for problem in problems]
        count = min(self.agreeing, self.starts)
        starts = [guess for own in every for guess in islice(_guesses(own, self.starts), count)]
        numbers = np.repeat(np.arange(len(every)), count)
        optima = iter(_minimised([every[i] for i in numbers], starts, numbers))
        for own in every:
            yield own, list(islice(optima, count))

    def motions(self, every: Sequence[Passing], optima: Sequence[LocalOptimum]) -> list[Trajectory]:
        times = np.array([own.times for own in optima])
        velocities = np.array([own.states for own in optima])
        ends = np.pad(velocities, ((0, 0), (1, 1), (0, 0)))
        return _motions(every, every, times, ends)


def _guesses(scaled: Passing, count: int) -> Iterator[Guess]:
    """Yield initial guesses in the order in which they are tried, at most `count`."""
    random = starting_points(scaled, count)
    stopping = islice(random, 1)
    purpose = guesses.on_purpose(scaled)
    # a tolerance has its optimum near the chord; without one stopping is next to none
    first = (purpose, stopping) if scaled.tolerance.any() else (stopping, purpose)
    return islice(chain(*first, random), count)


def without_jerk(problem: Problem, passing: Array | None) -> Trajectory | None:
    """Return the motion of the first method without jerk limits; None where it has none.

    Args:
        problem: Its jerk limits are ignored.
        passing: Further limits at the waypoints, in the form that `Scaled` takes.
    """
    return Exact()._solved(problem.without("jerk"), None, passing).trajectory


def _solved_near(
    problem: Problem, passing: Array | None, planner: Exact, patient: bool
) -> Solution:
    return planner._solved(problem, None, passing, patient)


def _freely(
    problem: Problem, passing: Array | None, planner: Exact, _: bool, below: float
) -> Solution:
    def optimum(scaled: Passing, found: FreeOptimum) -> LocalOptimum:
        near = scaled.tolerance.any()
        states = (found.velocity, found.offset) if near else found.velocity
        return LocalOptimum(float(found.times.sum()), found.times, states, "Converged")

    scales = [Passing(problem, passing) for _ in free_pieces.SPARES]
    return planner.freely(problem, scales, optimum, below, free_pieces.guesses(scales[0]))


class Passing(Scaled):
    """A problem without units, and the motions through given waypoint velocities.

    Args:
        problem: its position and jerk limits are ignored.
        passing: further limits at the waypoints, as `Scaled` has them; only velocities count.

    Attributes:
        latest: longest times of the segments, infinite where there are none, `(segments,)`.
        brief: shorter pieces are removed at the price of a linear program each, s.
    """

    def __init__(self, problem: Problem, passing: Array | None = None) -> None:
        super().__init__(problem, jerk=False, passing=passing)
        self.brief = BRIEF_PIECE_S
        self.latest = np.full_like(self.stop, np.inf)

    @property
    def walls(self) -> Array:
        """Return the position limits, low first, `(2, joints)`."""
        return self.problem.limits.position.T

    @property
    def has_demands(self) -> bool:
        """Return whether the route asks for more than exact waypoints and rest at its ends."""
        limited = self.least.any() or np.isfinite(self.latest).any()
        return bool(self.closed or limited or self.tolerance.any())

    @property
    def allowed(self) -> Passing:
        """Return the problem with the limits that the judge allows.

        Between given velocities they are wider by rounding. A motion that is possible at a single
        instant cannot be dilated to meet its limits.
        """
        return self if self.problem.route.dilatable else self.widened(_KEPT_SHARE * KEPT_RTOL)

    def widened(self, share: float) -> Passing:
        """Return the problem with the limits that suffice for dilations by up to this share."""
        k = 1 + share
        own = copy(self)
        own.v, own.a, own.waypoint_v = k * self.v, k**2 * self.a, k * self.waypoint_v
        return own

    def trajectory(self, times: Array, states: Any) -> Trajectory:
        """Return the motion of least acceleration of each joint in each segment."""
        if self.tolerance.any():
            velocities, offset = states
            return self.shifted(offset).trajectory(times, velocities)
        needed = 0.0 if self.problem.route.dilatable else instants.excess(self, times, states)
        allowed = self.allowed if needed > _NEGLIGIBLE else self
        ends = with_outer(states, self.end_v, self.closed)
        (motion,) = _motions([self], [allowed], times[None], ends[None])
        return motion


def _motions(
    every: Sequence[Passing], allowed: Sequence[Passing], times: Array, ends: Array
) -> list[Trajectory]:
    """Return the motions of problems of one shape.

    Args:
        every: the problems, all dilatable or none.
        allowed: the same with the limits that the motions keep.
        times: of the segments, `(problems, segments)`.
        ends: velocities at all waypoints, `(problems, waypoints, joints)`.
    """
    segments = times.shape[1]

    def in_a_row(tables: Sequence[Array]) -> Array:
        shapes = [(*own.shape[:-2], segments, own.shape[-1]) for own in tables]
        whole = [np.broadcast_to(own, shape) for own, shape in zip(tables, shapes, strict=True)]
        return np.concatenate(whole, axis=-2)

    task = SegmentTask(
        times.reshape(-1, 1),
        in_a_row([own.h for own in every]),
        ends[:, :-1].reshape(-1, ends.shape[-1]),
        ends[:, 1:].reshape(-1, ends.shape[-1]),
        in_a_row([own.v for own in allowed]),
        in_a_row([own.a for own in allowed]),
        in_a_row([own.problem.waypoints[:-1] / own.units[-1] for own in every]),
        in_a_row([own.walls[:, None] / own.units[-1] for own in every]),
    )
    brief = np.repeat([own.brief / own.unit for own in every], segments)
    with np.errstate(all="ignore"):
        constant = pieces(task, brief, dilatable=every[0].problem.route.dilatable)
    return motions(every, constant, task.u)


def within(velocities: Array, limits: Array) -> Array:
    """Return velocities within their limits; one that is close to its limit is set to it."""
    lowest, highest = limits
    slowest, fastest = limits * (1 - _LIMIT_RTOL)
    limited = np.where(velocities > fastest, highest, velocities)
    return np.where(limited < slowest, lowest, limited)


def _of_one_segment(scaled: Passing) -> LocalOptimum | None:
    """Return the optimum of a problem of one segment: the first time that is possible.

    Return None where the problem has more segments or demands, or where none of the times is
    possible.
    """
    if len(scaled.h) > 1 or scaled.has_demands:
        return None
    none = np.zeros((0, scaled.h.shape[1]))
    for time in gaps.borders(scaled):
        near = np.array([time])
        if instants.excess(scaled, near, none) < _BORDER_EXCESS:
            # rounding moves the borders of several joints apart
            own, _ = instants.sharpened(scaled, near, none)
            (found,) = _reached(Abreast([scaled]), own[None], none[None], MAX_BORDER_DILATION)
            if found is not None:
                return found
    return None


def _before_gaps(scaled: Passing) -> list[LocalOptimum]:
    """Return the optima of the intervals of time before gaps, also of those of a single time.

    An interval of a single time has no interior. So the limits are a little wider at first.
    """
    if scaled.tolerance.any():
        return []
    found = []
    left = gaps.before_gaps(scaled.widened(max(_WIDER)))
    for share in _WIDER:
        failed = []
        for starts in _in_groups(left):
            wider = scaled.widened(share)
            earliest, wider.latest = starts[0].between
            wider.least = np.maximum(wider.least, earliest)
            optima = _minimised([wider] * len(starts), [Guess(*start[:2]) for start in starts])
            for start, near in zip(starts, optima, strict=True):
                optimum = None
                if np.isfinite(near.duration):
                    sharp = instants.sharpened(scaled, near.times, near.states)
                    times, states = (table[None] for table in sharp)
                    (optimum,) = _reached(Abreast([scaled]), times, states, MAX_BORDER_DILATION)
                if optimum is None:
                    failed.append(start)
                else:
                    found.append(optimum)
        left = failed
    return found


def _in_groups(starts: Sequence[gaps.Start]) -> list[list[gaps.Start]]:
    """Return the guesses in groups between the same gaps."""
    groups: dict[bytes, list[gaps.Start]] = {}
    for start in starts:
        groups.setdefault(start.between.tobytes(), []).append(start)
    return list(groups.values())


def reachable(times: Array, velocities: Array, scaled: Abreast, k: Array) -> Bools:
    """Return whether times and waypoint velocities are reachable after a dilation by `k`.

    Velocity limits are `k` times as wide, acceleration limits `k²` times; the velocities at the
    motion's ends are `k` times as large. In the briefest segments velocities differ by less than
    their rounding. Dilation does not help there, so it is allowed.

    Args:
        times: of the segments, `(starts, segments)`.
        velocities: at the inner waypoints, `(starts, waypoints, joints)`.
        scaled: the problems.
        k: `(starts,)`.
    """
    u, w = at_ends(velocities, k[:, None] * scaled.end_v, scaled.closed)
    t = times[..., None]
    h = scaled.h
    wider = k[:, None, None]
    v = scaled.v * wider
    a = scaled.a * wider**2
    slowest, fastest = scaled.waypoint_v * wider
    braking, speeding = a
    size = np.abs(u) + np.abs(w)
    rounding = _VELOCITY_RTOL * size
    step = w - u
    reach = extremes(u, w, t, v, a)
    conditions = [
        scaled.least <= k[:, None] * times,
        # −V1 ≤ v ≤ V2 at the inner waypoints
        slowest <= velocities,
        velocities <= fastest,
        # −A1 T ≤ w − u ≤ A2 T
        braking * t - rounding <= step,
        step <= speeding * t + rounding,
        # D_lo ≤ h ≤ D_up
        reach.d_lo - h <= rounding * t,
        h - reach.d_up <= rounding * t,
    ]
    every = [own.reshape(len(k), -1).all(axis=1) for own in conditions]
    return np.logical_and.reduce(every)


def repair(
    times: Array, velocities: Array, scaled: Abreast, largest: float = MAX_DILATION
) -> Array:
    """Return the smallest dilations that make times and waypoint velocities reachable, `(starts,)`.

    Solvers meet constraints to a tolerance; dilating by `k` widens every reachable interval.
    One is infinite where it would be larger than `largest`.
    """
    low = np.ones(len(times))
    high = np.full(len(times), 1.0 + DILATION_TOL)

    def are_reachable(some: Indices, k: Array) -> Bools:
        if len(some) == len(times):
            return reachable(times, velocities, scaled, k)
        return reachable(times[some], velocities[some], scaled.of(some), k)

    left = np.arange(len(times))
    while left.size:
        left = left[~are_reachable(left, high[left])]
        low[left] = high[left]
        high[left] = 1 + 4 * (high[left] - 1)
        high[left[high[left] > largest]] = np.inf
        left = left[np.isfinite(high[left])]
    while True:
        left = np.flatnonzero(np.isfinite(high) & (high - low > DILATION_TOL))
        if not left.size:
            return high
        middle = 0.5 * (low[left] + high[left])
        is_enough = are_reachable(left, middle)
        high[left] = np.where(is_enough, middle, high[left])
        low[left] = np.where(is_enough, low[left], middle)


def starting_points(scaled: Scaled, count: int, stopping: float = 1.0) -> Iterator[Guess]:
    """Yield initial guesses, times and waypoint velocities: stopping first, then random ones.

    Args:
        scaled: the problem.
        count: how many.
        stopping: times of the first guess, relative to the stop times.
    """
    segments, joints = scaled.h.shape
    rng = np.random.default_rng(0)
    inner = (segments - (not scaled.closed), joints)
    at_rest = np.zeros(inner)
    yield Guess(stopping * scaled.stop, at_rest)
    for _ in range(count - 1):
        times = scaled.stop * rng.uniform(0.5, 1.5, segments)
        # between the mean velocities before and after the waypoint, times a random factor
        mean = scaled.h / times[:, None]
        before = mean[: len(at_rest)]
        after = np.roll(mean, -1, axis=0)[: len(at_rest)]
        mix = rng.uniform(size=inner)
        between = mix * before + (1 - mix) * after
        speed = rng.uniform(0, 1.5, (len(at_rest), 1))
        yield Guess(times, between * speed)


def _minimised(
    every: Sequence[Passing], starts: Sequence[Guess], problems: Indices | None = None
) -> list[LocalOptimum]:
    """Return the local optimum near each initial guess, dilated until it is reachable.

    Args:
        every: the problem of each guess, all of one shape and with the same kinds of demands.
        starts: the guesses.
        problems: the number of each guess's problem; by default one for all.
    """
    abreast = Abreast(every)

    def reached(rows: Any, some: Indices, largest_dilation: float) -> list[LocalOptimum | None]:
        own = abreast if len(some) == len(every) else abreast.of(some)
        return _reached_from(rows, own, largest_dilation)

    optima = minimised(_begun(abreast, starts), reached, problems)
    return [
        LocalOptimum(np.inf, *start[:2], "Not_Converged") if optimum is None else optimum
        for start, optimum in zip(starts, optima, strict=True)
    ]


def _begun(abreast: Abreast, starts: Sequence[Guess]) -> AccelerationInequalities:
    """Return the program at initial guesses."""
    cells = AccelerationTables(abreast)
    times, velocities = (np.array(column) for column in list(zip(*starts, strict=True))[:2])
    still = np.zeros_like(velocities[0])
    offset = np.array([still if own.offset is None else own.offset for own in starts])
    return AccelerationInequalities(cells, cells.start(times, velocities, offset))


def _reached_from(
    rows: Any, abreast: Abreast, largest_dilation: float
) -> list[LocalOptimum | None]:
    """Return the optima of a program's inequalities, dilated until they are reachable."""
    cells = rows.cells
    times = rows.times
    ends = rows.point.ends
    if not cells.tolerant:
        # A joint at its limit throughout a segment has end velocities ∓A T/2 from the mean one.
        gain = ends[1] - ends[0]
        limit = np.where(gain > 0, abreast.a[1], abreast.a[0])
        is_full = np.abs(gain / limit - 1) < _FULL_RTOL
        ends = np.where(is_full, [-limit / 2, limit / 2], ends)
    velocities = inner_velocities(abreast.h, times, ends, abreast.closed)
    velocities = within(velocities, abreast.waypoint_v)
    if not cells.tolerant:
        return _reached(abreast, times, velocities, largest_dilation)
    offsets = np.clip(rows.point.offset, -cells.tolerance, cells.tolerance)
    pairs = zip(abreast.every, offsets, strict=True)
    moved = Abreast([scaled.shifted(offset) for scaled, offset in pairs])
    found = _reached(moved, times, velocities, largest_dilation)
    return [
        optimum and optimum._replace(states=(optimum.states, offset))
        for optimum, offset in zip(found, offsets, strict=True)
    ]


def _not_at_once(problem: Problem) -> Passing:
    """Return the problem without units, each segment of which takes some time."""
    scaled = Passing(problem)
    least = _LEAST_SHARE * stop_times(problem) / scaled.unit
    scaled.least = np.maximum(scaled.least, least)
    scaled.brief = 0.0  # there are hundreds
    return scaled


def _near_optima(
    every: Sequence[Passing], starts: Sequence[Guess], within: float
) -> list[LocalOptimum | None]:
    """Return optima to about `within`, relative, each from a guess; None where it leads to none.

    Args:
        every: the problem of each guess, all of one shape and with the same kinds of demands.
        starts: the guesses.
        within: largest gap, relative to the duration, and largest miss of an inequality.
    """

    def there(iterate: interior_point.Iterate) -> Bools:
        state = iterate.state
        missed = np.abs(state.miss).max(axis=interior_point.ROW_AXES)
        missed = np.maximum(missed, state.rows.apart)
        return interior_point.near(iterate, within) & (missed <= within)

    abreast = Abreast(every)
    rows = _begun(abreast, starts)
    numbers = np.arange(len(every))  # each guess ends its steps by itself
    end = interior_point.descended(interior_point.begun(rows), there, _NEAR_STEPS, numbers)
    return _reached_from(end.state.rows, abreast, 1 + _NEAR_FACTOR * within)


def _minimised_by_ipopt(scaled: Passing, starts: Sequence[Guess]) -> list[LocalOptimum]:
    """Return IPOPT's local optimum near each initial guess, dilated until it is reachable."""
    from baselines.exact.acceleration import by_ipopt  # late: it needs CasADi

    optima = []
    for start in starts:
        times, velocities, run = by_ipopt.minimised(scaled, *start[:2])
        velocities = within(velocities, scaled.waypoint_v)
        (optimum,) = _reached(Abreast([scaled]), times[None], velocities[None], MAX_DILATION)
        if optimum is None or not run.success:
            optimum = LocalOptimum(np.inf, *start[:2], run.status)
        optima.append(optimum._replace(status=run.status))
    return optima


def _reached(
    scaled: Abreast, times: Array, velocities: Array, largest_dilation: float
) -> list[LocalOptimum | None]:
    """Return the optima of times and waypoint velocities, dilated until they are reachable."""
    k = repair(times, velocities, scaled, largest_dilation)
    for i in np.flatnonzero(np.isinf(k)).tolist():
        own: Any = scaled.every[i]
        if own.allowed is not own:
            some = slice(i, i + 1)
            allowed = Abreast([own.allowed])
            k[some] = repair(times[some], velocities[some], allowed, largest_dilation)
    durations = k * times.sum(axis=1)
    found = zip(k, durations, k[:, None] * times, velocities / k[:, None, None], strict=True)
    return [
        None if np.isinf(factor) else LocalOptimum(float(duration), slower, slowed, "Converged")
        for factor, duration, slower, slowed in found
    ]
