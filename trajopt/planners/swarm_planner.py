"""The 3-5-3 spline's segment times by a swarm: the paper's method, and its alternatives.

A swarm searches `(t1, t2, t3)` in a box. The paper's fitness does not include position limits. Here
a motion outside them breaks a limit like any other (docs/mathematics.md, section 2).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trajopt.core.arrays import Array, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import LIMIT_NAMES, Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline353
from trajopt.planners.compiled import compiled
from trajopt.planners.planner import Planner
from trajopt.planners.reductions import EQUAL_WAYPOINTS, reduced
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.swarm import ISSA, PSO, SSA, Compared, Optimiser, Result, minimise
from trajopt.planners.swarm.optimiser import added, check_choices, require
from trajopt.planners.timing import Timing

if TYPE_CHECKING:
    from numpy.random import SeedSequence


@dataclass(frozen=True)
class SwarmPlanner(Planner):
    """The 3-5-3 spline, its segment times searched by a swarm.

    - `timing`: one `(t1, t2, t3)` for all joints, or one for every moving joint
      (docs/mathematics.md, section 3). In the latter case the answer takes each segment's longest
      time over the joints. That is its claim, and it may break limits;
    - `fitness`: `penalty` ranks candidates within the limits by duration; candidates that break
      limits come after them, ranked by their summed relative violation (Deb's rule). `scaled`
      dilates every candidate to the limits first (section 2). A dilation does not change positions,
      so position limits are kept by Deb's rule; with position limits, a candidate whose dilated
      duration exceeds the box's longest one ranks with those that break a limit. Violations of
      positions are relative to the joint's largest displacement;
    - `space`: the swarm moves in seconds, or in the unit cube, mapped linearly to them (sparrows
      drift to the origin, so it matters);
    - `iterations`, or `evaluations` if given: the budget, per joint if `timing` is;
    - `upper`: upper end of the box over the longest time of a segment from rest to rest (of that
      joint alone if `timing` is per joint). It is raised if the box would not contain times that
      are known to keep the position limits. `lower`: lower end over upper end.

    `stats` has `segment_times` `(3,)`, s, and `iterations`. With `timing="per-joint"` it also has
    `joint_times` `(joints, 3)` and `joint_durations` `(joints,)`, s, NaN for joints that never
    move, and `joint_history` `(m, 3)`: joint (from 0), evaluations of that joint, its best duration
    by then, s. Then `history` is None: shorter times of single joints can make the longest times of
    the segments longer, so there is no common curve. `evaluations` counts those of all joints.
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
        """Return the answer of one run."""
        solutions = self.solve_batch(problem, [seed])
        return solutions[0]

    def solve_batch(self, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        """Return one answer per seed, each equal to that of `solve`; all runs advance together."""
        if len(seeds) == 0:
            return []
        reason = spline353.infeasible(problem)
        if reason is not None:
            return [Solution(Status.INFEASIBLE, message=reason) for _ in seeds]
        merged = EQUAL_WAYPOINTS.apply(problem)
        task = self.task(merged)
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
            solutions.append(EQUAL_WAYPOINTS.invert(problem, solution))
        return solutions

    def task(self, problem: Problem) -> SegmentTimes:
        """Return what the swarm minimises on a problem whose consecutive waypoints differ."""
        return SegmentTimes.of(problem, self)

    def _solution(
        self,
        problem: Problem,
        task: SegmentTimes,
        result: Result,
        times: Array,
        histories: list[Array],
    ) -> Solution:
        """Return one run's answer, from times `(groups, 3)` and histories of its groups."""
        longest = times.max(axis=0)
        groups = len(times)
        stats: dict[str, Any] = {"segment_times": longest, "iterations": result.iterations}
        history: Array | None = histories[0]
        if self.timing == "per-joint":
            stats |= task.joint_stats(problem.joints, times, histories)
            history = None
        last = [history[-1, 1] for history in histories]
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
class JointGroup(Timing):
    """Joints with common segment times, between `low` and `high`, s.

    `displacements` `(joints, 3)`, `limits` and `room` (None without position limits) are theirs.
    """

    variables = 3

    displacements: Array
    limits: Limits
    room: Array | None
    low: float
    high: float

    @classmethod
    def of(cls, problem: Problem, joints: Indices, lower: float, upper: float) -> JointGroup:
        """Build the group of these joints, which move, with the box of a planner's options."""
        of_joints = problem.only(joints)
        displacements = of_joints.displacements.T
        longest = stop_times(of_joints.without("position")).max()
        high = upper * longest
        room = spline353.position_room(of_joints)
        if room is not None:
            times = spline353.keeping_times(displacements, of_joints.limits, room, longest)
            # the best spline's longest outer time may be longer still
            high = max(high, 2 * times.max())
        return cls(displacements, of_joints.limits, room, low=lower * high, high=high)

    def uses(self, times: Array, exact_above: float = 0.0) -> tuple[Array, ...]:
        return spline353.limit_use(self.displacements, times[:, None], self.limits, exact_above)

    def outside(self, times: Array) -> Array | None:
        if self.room is None:
            return None
        return spline353.position_excess(self.displacements, times[:, None], self.room)

    def trajectory(self, problem: Problem, times: Array) -> Trajectory:
        return spline353.trajectory(problem, times)

    def fast(self, fitness: str) -> Callable[[Array], Array]:
        """Return `penalty` or `scaled`, compiled.

        The exact positions of a joint take as long as all the rest. So they are computed only where
        the Bernstein coefficients do not show that the joint keeps its limits.
        """
        sample = self.high * np.array([0.2, 0.3, 0.4])
        if self.room is None:
            whole = compiled(getattr(self, fitness), sample)
            return lambda times: np.array([whole(candidate) for candidate in times])
        room = self.room
        bounds = compiled(
            lambda times: spline353.position_bounds(self.displacements, times[:, None], room),
            sample,
        )
        # one record for all joints, with displacements and limits as arguments
        joints = np.column_stack([self.displacements, room])
        excess = compiled(_excess_alone, np.concatenate([sample, joints[0]]))
        beyond = getattr(self, f"{fitness}_beyond")
        whole = compiled(
            lambda known: beyond(known[:, :3], known[:, 3:]),
            np.concatenate([sample, np.zeros(len(joints))]),
        )
        numbers = joints.tolist()

        def value(times: list[float]) -> Any:
            outside = [
                excess(times + joint) if bound > 0 else 0.0
                for joint, bound in zip(numbers, bounds(times), strict=True)
            ]
            return whole(times + outside)

        return lambda times: np.array([value(candidate) for candidate in times.tolist()])

    def penalty_below(self, times: Array, incumbent: Array) -> Array:
        """Return `penalty` where it is below the incumbent `(N,)`, elsewhere no less than that."""
        duration = added(times)
        value = np.full(len(times), self.above_any)
        # A candidate that lasts no shorter is not taken.
        (shorter,) = (duration < incumbent).nonzero()
        keeps = spline353.keeps_limits(self.displacements, times[shorter], self.limits)
        within = shorter[keeps]
        outside = self.outside(times[within])
        if outside is not None:
            within = within[added(outside) == 0]
        value[within] = duration[within]
        # The size of a violation matters only to incumbents that violate a limit themselves.
        broken = (value > self.ceiling) & (incumbent > value)
        if broken.any():
            value[broken] = self.penalty(times[broken])
        return value


def _excess_alone(known: Array) -> Array:
    """`position_excess` of one joint `(n,)`, of its times, displacements and room `(n, 8)`."""
    times, displacements, room = known[:, None, :3], known[:, None, 3:6], known[:, None, 6:]
    return spline353.position_excess(displacements, times, room)[:, 0]


@dataclass(frozen=True, eq=False)
class SegmentTimes:
    """The objective of a swarm: the duration of groups of the moving `joints`.

    search = SegmentTimes.of(problem, SwarmPlanner())
    low, high = search.box(seeds=1)
    minimise(PSO(), search.fitness, low, high, seeds=[0], iterations=100)
    """

    planner: SwarmPlanner
    joints: Indices
    groups: tuple[JointGroup, ...]

    @classmethod
    def of(cls, problem: Problem, planner: SwarmPlanner) -> SegmentTimes:
        """Build the objective of a merged problem from a planner's options."""
        joints = np.flatnonzero(problem.moving)
        together = [joints]
        if planner.timing == "per-joint":
            together = list(joints[:, None])
        groups = [
            JointGroup.of(problem, joints, planner.lower, planner.upper) for joints in together
        ]
        return cls(planner, joints, tuple(groups))

    @property
    def low(self) -> Array:
        """The box's lower end, `(groups, 3)`, s."""
        ends = [group.low for group in self.groups]
        return np.repeat(ends, 3).reshape(-1, 3)

    @property
    def high(self) -> Array:
        """Its upper end, `(groups, 3)`, s."""
        ends = [group.high for group in self.groups]
        return np.repeat(ends, 3).reshape(-1, 3)

    @property
    def position_limited(self) -> bool:
        return any(group.room is not None for group in self.groups)

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
        if self.planner.timing == "per-joint":
            keys = [(int(joint),) for joint in self.joints]
        streams = []
        for seed in seeds:
            streams += [np.random.SeedSequence(seed, spawn_key=key) for key in keys]
        return streams

    def seconds(self, x: Array, group: JointGroup) -> Array:
        """Segment times of a group's candidates `(seeds, m, 3)`: `(seeds · m, 3)`, s."""
        candidates = x.reshape(-1, 3)
        if self.planner.space == "unit":
            return group.low + candidates * (group.high - group.low)
        return candidates

    def fitness(self, x: Array, incumbent: Array | None = None) -> Array:
        """Return the fitness of candidates `(seeds · groups, m, 3)`: `(seeds · groups, m)`.

        Exact where it is below the `incumbent` `(seeds · groups, m)`, or without one.
        """
        value = np.empty(x.shape[:2])
        for row, group in enumerate(self.groups):
            runs = slice(row, None, len(self.groups))
            times = self.seconds(x[runs], group)
            if self.planner.fitness == "scaled":
                values = group.scaled(times)
            elif incumbent is None:
                values = group.penalty(times)
            else:
                values = group.penalty_below(times, incumbent[runs].ravel())
            value[runs] = values.reshape(-1, x.shape[1])
        return value

    def answers(self, result: Result) -> Iterator[tuple[Array, list[Array]]]:
        """Per seed: the best times of each group `(groups, 3)`, s, and each group's history."""
        count = len(self.groups)
        best = []
        for row, group in enumerate(self.groups):
            runs = slice(row, None, count)
            times = self.seconds(result.position[runs], group)
            best.append(self._dilated(times, group, result.fitness[runs]))
        for seed, best_times in enumerate(zip(*best, strict=True)):
            first = seed * count
            histories = result.histories[first : first + count]
            feasible = map(self._feasible, histories, self.groups)
            yield np.array(best_times), list(feasible)

    def _dilated(self, times: Array, group: JointGroup, fitness: Array) -> Array:
        """Return a group's best times `(seeds, 3)`, s, dilated to the duration of their fitness."""
        if self.planner.fitness == "penalty":
            return times
        factor = fitness / added(times)
        if self.position_limited:
            # the fitness of a candidate that leaves its position limits is no duration
            factor = group.dilation(times)
        return times * factor[:, None]

    def _feasible(self, history: Array, group: JointGroup) -> Array:
        """A history with NaN until the first candidate within the limits."""
        if self.planner.fitness == "scaled" and not self.position_limited:
            return history
        spent, best = history.T
        within = np.where(best > group.ceiling, np.nan, best)
        return np.column_stack([spent, within])

    def joint_stats(self, joints: int, times: Array, histories: list[Array]) -> dict[str, Array]:
        """Return the times and durations of each joint alone; NaN for joints that never move."""
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
                "segment_time", "a positive time in seconds", value=self.segment_time
            )

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @reduced(EQUAL_WAYPOINTS)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        times = np.full(3, self.segment_time)
        trajectory = spline353.trajectory(problem, times)
        return Solution(Status.SOLVED, trajectory, evaluations=0)


pso = SwarmPlanner(PSO())
ssa = SwarmPlanner(SSA())
issa = SwarmPlanner(ISSA())
