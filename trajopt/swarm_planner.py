"""The 3-5-3 spline's segment times by a swarm: the paper's method, and its alternatives.

A swarm searches `(t1, t2, t3)` in a box. Position limits are no part of the paper's fitness; here
leaving one counts as breaking any other does (docs/mathematics.md, section 2).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import reduce
from typing import Any, Literal

import numpy as np
from numpy.random import SeedSequence
from numpy.typing import NDArray

from trajopt import spline353
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, expanded, passing_once
from trajopt.problem import LIMIT_NAMES, Limits, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.swarm import ISSA, PSO, SSA, Compared, Optimiser, Result, minimise
from trajopt.swarm.optimiser import added, check_choices, require

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SwarmPlanner(Planner):
    """The 3-5-3 spline, its segment times searched by a swarm.

    - `timing`: one `(t1, t2, t3)` for all joints, or every moving joint on its own
      (docs/mathematics.md, section 9): the answer then takes each segment's longest time over the
      joints, which is its claim and may break limits;
    - `fitness`: `penalty` ranks any candidate within the limits by its duration, above any that
      breaks them, and those by their summed relative violation (Deb's rule); `scaled` dilates every
      candidate to the limits first (section 2), so none breaks them. Position limits, which no
      dilation mends, are then kept by Deb's rule alone; where there are any, times dilated beyond
      the box's longest duration rank among those that break a limit. A position's violation counts
      in the joint's largest displacement;
    - `space`: the swarm moves in seconds, or in the unit cube, mapped linearly to them (sparrows
      drift to the origin, so it matters);
    - `iterations`, or `evaluations` if given: the budget, per joint where `timing` is;
    - `upper`: the box's upper end over the longest stop-to-stop time of any segment (of that joint
      alone where `timing` is), or higher where it would else hold no times that are known to keep
      the position limits; `lower`: its lower end over the upper.

    `stats` hold `segment_times` `(3,)`, s, and `iterations`; with `timing="per-joint"` also
    `joint_times` `(joints, 3)` and `joint_durations` `(joints,)`, s, NaN for joints that never
    move, and `joint_history` `(m, 3)`: joint (from 0), evaluations of that joint, its best duration
    by then, s. There is no common curve then, so `history` is None: better times of single joints
    can make the segment-wise longest ones worse. `evaluations` counts those of all joints.
    """

    optimiser: Optimiser = field(default_factory=ISSA)
    timing: Literal["shared", "per-joint"] = "shared"
    fitness: Literal["penalty", "scaled"] = "penalty"
    space: Literal["seconds", "unit"] = "seconds"
    iterations: int = 1000
    evaluations: int | None = None
    upper: float = 4.0
    lower: float = 1e-3
    stochastic = True
    knows = LIMIT_NAMES

    def __post_init__(self) -> None:
        check_choices(self)
        require("iterations", self.iterations, self.iterations >= 0, "0 or more")
        some = self.evaluations is None or self.evaluations >= 1
        require("evaluations", self.evaluations, some, "at least 1, or None")
        upper = self.upper
        require("upper", upper, 0 < upper < np.inf, "a finite number above 0")
        lower = self.lower
        require("lower", lower, 0 < lower < 1, "a number between 0 and 1")

    @property
    def description(self) -> str:
        return f"The 3-5-3 spline, its segment times searched by {type(self.optimiser).__name__}."

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The answer of one run."""
        solutions = self.solve_batch(problem, [seed])
        return solutions[0]

    def solve_batch(self, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        """One answer per seed, all runs advancing together; each is what `solve` gives alone."""
        if len(seeds) == 0:
            return []
        reason = spline353.infeasible(problem)
        if reason is not None:
            return [Solution(Status.INFEASIBLE, message=reason) for _ in seeds]
        merged, index = problem.merged()
        task = SegmentTimes.of(merged, self)
        low, high = task.box(len(seeds))
        result = minimise(
            self.optimiser,
            Compared(task.fitness),
            low,
            high,
            task.streams(seeds),
            iterations=self.iterations,
            evaluations=self.evaluations,
        )
        solutions = []
        for times, histories in task.answers(result):
            solution = self._solution(merged, task, result, times, histories)
            solutions.append(expanded(solution, index))
        return solutions

    def _solution(
        self,
        problem: Problem,
        task: SegmentTimes,
        result: Result,
        times: Array,
        histories: list[Array],
    ) -> Solution:
        """One run's answer, from the times `(groups, 3)` and the history of each of its groups."""
        longest = times.max(axis=0)
        groups = len(times)
        stats: dict[str, Any] = {
            "segment_times": longest,
            "iterations": result.iterations,
        }
        history: Array | None = histories[0]
        if self.timing == "per-joint":
            stats |= task.joint_stats(problem.joints, times, histories)
            history = None
        last = [own[-1, 1] for own in histories]
        lost = np.isnan(last).sum()
        message = ""
        if lost > 0:
            message = f"no candidate kept the limits ({lost} of {groups} searches)"
        return Solution(
            Status.SOLVED,
            spline353.trajectory(problem, longest),
            message,
            evaluations=result.evaluations * groups,
            history=history,
            stats=stats,
        )


@dataclass(frozen=True, eq=False)
class SegmentTimes:
    """What the swarm minimises. A group is a set of joints with common times: all, or each alone.

    `displacements` `(joints, 3)`, `limits` and `room` (None without position limits) of the moving
    `joints`; box `low`, `high` `(groups, 3)`, s.

        search = SegmentTimes.of(problem, SwarmPlanner())
        low, high = search.box(seeds=1)
        minimise(PSO(), search.fitness, low, high, seeds=[0], iterations=100)
    """

    planner: SwarmPlanner
    joints: NDArray[np.intp]
    displacements: Array
    limits: Limits
    room: Array | None
    low: Array
    high: Array

    @classmethod
    def of(cls, problem: Problem, planner: SwarmPlanner) -> SegmentTimes:
        """Of a problem without consecutive identical waypoints, as a planner's options say."""
        joints = np.flatnonzero(problem.moving)
        free = problem.without("position")
        moving = free.only(joints)
        groups = [joints]
        if planner.timing == "per-joint":
            groups = list(joints[:, None])
        ends = []
        for group in groups:
            own = problem.only(group)
            longest = stop_times(free.only(group)).max()
            end = planner.upper * longest
            room = spline353.position_room(own)
            if room is not None:
                times = spline353.keeping_times(own.displacements.T, own.limits, room, longest)
                # the longest outer time of the best one may be longer still
                end = max(end, 2 * times.max())
            ends.append(end)
        high = np.array(ends)
        high = np.repeat(high[:, None], 3, axis=1)
        return cls(
            planner,
            joints,
            displacements=moving.displacements.T,
            limits=moving.limits,
            room=spline353.position_room(problem),
            low=planner.lower * high,
            high=high,
        )

    @property
    def shared(self) -> bool:
        """Whether one group holds all joints."""
        return self.planner.timing == "shared"

    @property
    def ceiling(self) -> Array:
        """The longest duration in the box, `(groups,)`, s: fitness above it breaks a limit."""
        return added(self.high)

    def box(self, seeds: int) -> tuple[Array, Array]:
        """Bounds of all runs, `(seeds · groups, 3)`."""
        low = np.tile(self.low, (seeds, 1))
        high = np.tile(self.high, (seeds, 1))
        if self.planner.space == "unit":
            return np.zeros_like(low), np.ones_like(high)
        return low, high

    def streams(self, seeds: Sequence[int]) -> list[SeedSequence]:
        """One per run: a joint's stream does not depend on which other joints move."""
        keys: list[tuple[int, ...]] = [()]
        if not self.shared:
            keys = [(int(joint),) for joint in self.joints]
        streams = []
        for seed in seeds:
            streams += [SeedSequence(seed, spawn_key=key) for key in keys]
        return streams

    def seconds(self, x: Array) -> Array:
        """Segment times of candidates `(seeds · groups, m, 3)`: `(seeds, m, groups, 3)`, s."""
        groups = len(self.low)
        by_seed = x.reshape(-1, groups, *x.shape[1:])
        times = by_seed.swapaxes(1, 2)
        if self.planner.space == "unit":
            size = self.high - self.low
            return self.low + times * size
        return times

    def fitness(self, x: Array, incumbent: Array | None = None) -> Array:
        """Of candidates `(seeds · groups, m, 3)`, to be minimised: `(seeds · groups, m)`.

        Exact where it is below the `incumbent` `(seeds · groups, m)`, or where there is none.
        """
        times = self.seconds(x)
        if self.planner.fitness == "scaled":
            value = self._scaled(times)
        elif incumbent is None:
            value = self._penalty(times)
        else:
            by_seed = incumbent.reshape(-1, len(self.low), x.shape[1])
            value = self._penalty_below(times, by_seed.swapaxes(1, 2))
        by_group = value.swapaxes(1, 2)
        return by_group.reshape(x.shape[:2])

    def _penalty_below(self, times: Array, incumbent: Array) -> Array:
        """`_penalty` where it is below the incumbent `(seeds, m, groups)`; a lower bound elsewhere.

        The bound takes the peaks where segments meet: of four candidates in a settled swarm three
        already break a limit there, or last longer than what they are compared with.
        """
        ends = spline353.use_at_ends(self.displacements, times, self.limits)
        value = self._deb(times, ends)
        open_ = (value < incumbent).any(axis=-1)
        if open_.any():
            value[open_] = self._penalty(times[open_])
        return value

    def _penalty(self, times: Array) -> Array:
        """The penalty of candidates `(…, groups, 3)`: `(…, groups)`."""
        uses = spline353.limit_use(
            self.displacements,
            times,
            self.limits,
            exact_above=1.0,
        )
        if self.room is None:
            return self._deb(times, uses)
        outside = spline353.position_excess(self.displacements, times, self.room)
        return self._deb(times, uses, [outside])

    def _deb(self, times: Array, uses: Sequence[Array], outside: Sequence[Array] = ()) -> Array:
        """Deb's rule as one number: the duration, or more than any by what breaks the limits.

        Args:
            times: `(…, groups, 3)`, s.
            uses: peak velocity, acceleration and jerk over their limits, `(…, joints)` each.
            outside: how far positions leave their limits, `(…, joints)`.
        """
        excesses = [np.maximum(use - 1.0, 0.0) for use in uses]
        excess = self._of_groups(reduce(np.add, [*excesses, *outside]))
        above_any = np.nextafter(self.ceiling, np.inf)
        beyond = above_any + excess
        duration = added(times)
        return np.asarray(np.where(excess > 0, beyond, duration))

    def _of_groups(self, excess: Array) -> Array:
        """The excess of joints `(…, joints)`, summed over each group, `(…, groups)`."""
        if len(self.low) > 1:
            return excess
        return added(excess)[..., None]

    def _scaled(self, times: Array) -> Array:
        """The duration once dilated to the limits; Deb's rule keeps what no dilation can mend."""
        duration = self._dilation(times) * added(times)
        if self.room is None:
            return duration
        outside = spline353.position_excess(self.displacements, times, self.room)
        excess = self._of_groups(outside)
        # Below `above_any` is then only what keeps its position limits.
        above_any = np.nextafter(self.ceiling, np.inf)
        beyond = np.maximum(duration, above_any) * (1.0 + excess)
        return np.asarray(np.where(excess > 0, beyond, duration))

    def _dilation(self, times: Array) -> Array:
        """The cheapest dilation of each group, `(…, groups)`."""
        use = spline353.limit_use(self.displacements, times, self.limits)
        factor = spline353.cheapest_dilation(*use)
        if len(self.low) == 1:
            factor = factor.max(axis=-1, keepdims=True)
        return factor

    def answers(self, result: Result) -> Iterator[tuple[Array, list[Array]]]:
        """Per seed: the best times of each group `(groups, 3)`, s, and each group's history."""
        groups = len(self.low)
        one_candidate = result.position[:, None]
        times = self.seconds(one_candidate)[:, 0]
        if self.planner.fitness == "scaled":
            duration = result.fitness.reshape(-1, groups)
            factor = duration / added(times)
            if self.room is not None:
                # the fitness of what leaves its position limits is no duration
                factor = self._dilation(times)
            times = times * factor[..., None]
        for row, own in enumerate(times):
            first = row * groups
            histories = result.histories[first : first + groups]
            feasible = map(self._feasible, histories, self.ceiling)
            yield own, list(feasible)

    def _feasible(self, history: Array, ceiling: float) -> Array:
        """A history with NaN until the first candidate within the limits."""
        if self.planner.fitness == "scaled" and self.room is None:
            return history
        spent, best = history.T
        within = np.where(best > ceiling, np.nan, best)
        return np.column_stack([spent, within])

    def joint_stats(
        self,
        joints: int,
        times: Array,
        histories: list[Array],
    ) -> dict[str, Array]:
        """What each joint would do alone; NaN for joints that never move."""
        own_times = np.full((joints, 3), np.nan)
        durations = np.full(joints, np.nan)
        curves = []
        for row, joint in enumerate(self.joints):
            history = histories[row]
            own_times[joint] = times[row]
            durations[joint] = history[-1, 1]
            curve = np.insert(history, 0, joint, axis=1)
            curves.append(curve)
        return {
            "joint_times": own_times,
            "joint_durations": durations,
            "joint_history": np.concatenate(curves),
        }


@dataclass(frozen=True)
class Unoptimised(Planner):
    """The 3-5-3 spline at the same fixed time for every segment (the paper's section 5: 2 s)."""

    segment_time: float = 2.0  # s

    knows = ()

    def __post_init__(self) -> None:
        if not 1e-9 < self.segment_time < 1e9:
            raise InvalidInput(
                "segment_time",
                "a positive time in seconds",
                value=self.segment_time,
            )

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        times = np.full(3, self.segment_time)
        trajectory = spline353.trajectory(problem, times)
        return Solution(Status.SOLVED, trajectory, evaluations=0)


pso = SwarmPlanner(PSO())
ssa = SwarmPlanner(SSA())
issa = SwarmPlanner(ISSA())
