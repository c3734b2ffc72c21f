"""The 3-5-3 spline's segment times by a swarm: the paper's method, and its alternatives.

A swarm searches `(t1, t2, t3)` in a box. Position limits are no part of the paper's fitness: they
are left to the verifier.
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
from trajopt.problem import Limits, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.swarm import ISSA, PSO, SSA, Optimiser, Result, minimise
from trajopt.swarm.optimiser import added, check_choices, require

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SwarmPlanner(Planner):
    """The 3-5-3 spline, its segment times searched by a swarm.

    - `timing`: one `(t1, t2, t3)` for all joints, or every moving joint on its own (mathematics,
      section 9): the answer then takes each segment's longest time over the joints, which is its
      claim and may break limits;
    - `fitness`: `penalty` ranks any candidate within the limits by its duration, above any that
      breaks them, and those by their summed relative violation (Deb's rule); `scaled` dilates every
      candidate to the limits first (mathematics, section 2), so none breaks them;
    - `space`: the swarm moves in seconds, or in the unit cube, mapped linearly to them (sparrows
      drift to the origin, so it matters);
    - `iterations`, or `evaluations` if given: the budget, per joint where `timing` is;
    - `upper`: the box's upper end over the longest stop-to-stop time of any segment (of that joint
      alone where `timing` is); `lower`: its lower end over the upper.

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

    def __post_init__(self) -> None:
        check_choices(self)
        require("iterations", self.iterations, self.iterations >= 0, "0 or more")
        some = self.evaluations is None or self.evaluations >= 1
        require("evaluations", self.evaluations, some, "at least 1, or None")
        require("upper", self.upper, 0 < self.upper < np.inf, "a finite number above 0")
        require("lower", self.lower, 0 < self.lower < 1, "a number between 0 and 1")

    @property
    def description(self) -> str:
        return f"The 3-5-3 spline, its segment times searched by {type(self.optimiser).__name__}."

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The answer of one run."""
        return self.solve_batch(problem, [seed])[0]

    def solve_batch(self, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
        """One answer per seed, all runs advancing together; each is what `solve` gives alone."""
        if len(seeds) == 0:
            return []
        merged, index = problem.merged()
        task = _Task.of(merged, self)
        found = minimise(
            self.optimiser, task.fitness, *task.box(len(seeds)), task.streams(seeds),
            iterations=self.iterations, evaluations=self.evaluations,
        )  # fmt: skip
        best = task.answers(found)
        return [expanded(self._solution(merged, task, found, *own), index) for own in best]

    def _solution(
        self, problem: Problem, task: _Task, found: Result, times: Array, histories: list[Array]
    ) -> Solution:
        """One run's answer, from the times `(groups, 3)` and the history of each of its groups."""
        longest = times.max(axis=0)
        lost = sum(bool(np.isnan(h[-1, 1])) for h in histories)
        stats: dict[str, Any] = {"segment_times": longest, "iterations": found.iterations}
        if self.timing == "per-joint":
            stats |= task.joint_stats(problem.joints, times, histories)
        return Solution(
            Status.SOLVED,
            spline353.trajectory(problem, longest),
            f"no candidate kept the limits ({lost} of {len(times)} searches)" if lost else "",
            evaluations=found.evaluations * len(times),
            history=histories[0] if self.timing == "shared" else None,
            stats=stats,
        )


@dataclass(frozen=True, eq=False)
class _Task:
    """What the swarm minimises. A group is a set of joints with common times: all, or each alone.

    `displacements` `(joints, 3)` and `limits` of the moving `joints`; box `low`, `high`
    `(groups, 3)`, s.
    """

    planner: SwarmPlanner
    joints: NDArray[np.intp]
    displacements: Array
    limits: Limits
    low: Array
    high: Array

    @classmethod
    def of(cls, problem: Problem, planner: SwarmPlanner) -> _Task:
        joints = np.flatnonzero(problem.moving)
        moving = _only(problem, joints)
        groups = [joints] if planner.timing == "shared" else list(joints[:, None])
        longest = [stop_times(_only(problem, group)).max() for group in groups]
        high = np.repeat(planner.upper * np.array(longest)[:, None], 3, axis=1)
        low = planner.lower * high
        return cls(planner, joints, moving.displacements.T, moving.limits, low, high)

    @property
    def ceiling(self) -> Array:
        """The longest duration in the box, `(groups,)`, s: fitness above it breaks a limit."""
        return added(self.high)

    def box(self, seeds: int) -> tuple[Array, Array]:
        """Bounds of all runs, `(seeds · groups, 3)`."""
        low, high = np.tile(self.low, (seeds, 1)), np.tile(self.high, (seeds, 1))
        unit = self.planner.space == "unit"
        return (np.zeros_like(low), np.ones_like(high)) if unit else (low, high)

    def streams(self, seeds: Sequence[int]) -> list[SeedSequence]:
        """One per run: a joint's stream does not depend on which other joints move."""
        shared = self.planner.timing == "shared"
        keys = [()] if shared else [(int(joint),) for joint in self.joints]
        return [SeedSequence(seed, spawn_key=key) for seed in seeds for key in keys]

    def seconds(self, x: Array) -> Array:
        """Segment times of candidates `(seeds · groups, m, 3)`: `(seeds, m, groups, 3)`, s."""
        times = x.reshape(-1, len(self.low), *x.shape[1:]).swapaxes(1, 2)
        unit = self.planner.space == "unit"
        return self.low + times * (self.high - self.low) if unit else times

    def fitness(self, x: Array) -> Array:
        """Of candidates `(seeds · groups, m, 3)`, to be minimised: `(seeds · groups, m)`."""
        times = self.seconds(x)
        value = self._scaled(times) if self.planner.fitness == "scaled" else self._penalty(times)
        return value.swapaxes(1, 2).reshape(x.shape[:2])

    def _penalty(self, times: Array) -> Array:
        """Deb's rule as one number: the duration, or more than any by what breaks the limits."""
        uses = spline353.limit_use(self.displacements, times, self.limits, exact_above=1.0)
        excess = reduce(np.add, [np.maximum(use - 1.0, 0.0) for use in uses])
        if len(self.low) == 1:
            excess = added(excess)[..., None]
        beyond = np.nextafter(self.ceiling, np.inf) + excess
        return np.asarray(np.where(excess > 0, beyond, added(times)))

    def _scaled(self, times: Array) -> Array:
        """The duration once dilated to the limits."""
        v, a, j = spline353.limit_use(self.displacements, times, self.limits)
        factor = np.maximum(np.maximum(v, np.sqrt(a)), np.cbrt(j))
        if len(self.low) == 1:
            factor = factor.max(axis=-1, keepdims=True)
        return factor * added(times)

    def answers(self, found: Result) -> Iterator[tuple[Array, list[Array]]]:
        """Per seed: the best times of each group `(groups, 3)`, s, and each group's history."""
        groups = len(self.low)
        times = self.seconds(found.position[:, None])[:, 0]
        if self.planner.fitness == "scaled":
            times = times * (found.fitness.reshape(-1, groups) / added(times))[..., None]
        for row, own in enumerate(times):
            histories = found.histories[row * groups : (row + 1) * groups]
            yield own, [self._feasible(h, c) for h, c in zip(histories, self.ceiling, strict=True)]

    def _feasible(self, history: Array, ceiling: float) -> Array:
        """A history with NaN until the first candidate within the limits."""
        if self.planner.fitness == "scaled":
            return history
        spent, best = history.T
        return np.column_stack([spent, np.where(best > ceiling, np.nan, best)])

    def joint_stats(self, joints: int, times: Array, histories: list[Array]) -> dict[str, Array]:
        """What each joint would do alone; NaN for joints that never move."""
        own = np.full((joints, 3), np.nan)
        own[self.joints] = times
        duration = np.full(joints, np.nan)
        duration[self.joints] = [h[-1, 1] for h in histories]
        curves = [np.insert(h, 0, j, axis=1) for j, h in zip(self.joints, histories, strict=True)]
        return {
            "joint_times": own,
            "joint_durations": duration,
            "joint_history": np.concatenate(curves),
        }


def _only(problem: Problem, joints: NDArray[np.intp]) -> Problem:
    """The problem of some joints, without position limits."""
    return problem.only(joints).without("position")


@dataclass(frozen=True)
class Unoptimised(Planner):
    """The 3-5-3 spline at the same fixed time for every segment (the paper, section 5: 2 s)."""

    segment_time: float = 2.0  # s

    def __post_init__(self) -> None:
        if not 1e-9 < self.segment_time < 1e9:
            raise InvalidInput(
                "segment_time", "a positive time in seconds", value=self.segment_time
            )

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        times = np.full(3, self.segment_time)
        return Solution(Status.SOLVED, spline353.trajectory(problem, times), evaluations=0)


pso, ssa, issa = SwarmPlanner(PSO()), SwarmPlanner(SSA()), SwarmPlanner(ISSA())
