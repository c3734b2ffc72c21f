"""Readings of the paper's text, which leaves choices open: one choice at a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np

from experiments.paper.kept_searches import ALGORITHMS, Runs, swarm
from trajopt import Limits, Problem
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core.arrays import Array
from trajopt.planners import spline353
from trajopt.planners.registry import configured, load, options
from trajopt.planners.swarm.optimiser import added
from trajopt.planners.swarm_planner import JointGroup, SegmentTimes, SwarmPlanner

Excess = Callable[[Array, Array, Limits], Array]


@dataclass(frozen=True)
class Fitness:
    """A fitness that `SwarmPlanner` does not offer: what counts as excess, and its weight.

    `excess` gives per joint by how much limits are broken, relative; with no `weight`, a candidate
    with any ranks below all without. The box is in seconds.
    """

    excess: Excess
    weight: float | None = None
    box: tuple[float, float] = (0.008, 8.0)


@dataclass(frozen=True, eq=False)
class OtherGroup(JointGroup):
    """Joints with common segment times, and another fitness."""

    fitness: Fitness

    @classmethod
    def like(cls, group: JointGroup, fitness: Fitness) -> OtherGroup:
        low, high = fitness.box
        return cls(**vars(group) | {"low": low, "high": high}, fitness=fitness)

    def penalty(self, times: Array) -> Array:
        """The fitness of candidates `(N, 3)`, s: `(N,)`."""
        total = added(times)
        over = self.fitness.excess(self.displacements, times[:, None], self.limits).sum(axis=-1)
        if self.fitness.weight is not None:
            return np.asarray(total + self.fitness.weight * over)
        return np.asarray(np.where(over > 0, 1e3 + over, total))

    def penalty_below(self, times: Array, incumbent: Array) -> Array:
        return self.penalty(times)


@dataclass(frozen=True)
class OtherSwarm(SwarmPlanner):
    """A swarm with another fitness."""

    other: Fitness = field(default_factory=lambda: Fitness(exact_excess))

    def task(self, problem: Problem) -> SegmentTimes:
        own = super().task(problem)
        groups = tuple(OtherGroup.like(group, self.other) for group in own.groups)
        return replace(own, groups=groups)


def exact_excess(displacements: Array, times: Array, limits: Limits) -> Array:
    """By how much the true peaks of velocity and acceleration exceed their limits."""
    use_v, use_a, _ = spline353.limit_use(displacements, times, limits, exact_above=1.0)
    return _excess(use_v, use_a)


def ends_excess(displacements: Array, times: Array, limits: Limits) -> Array:
    """Fitness whose limits are checked at the waypoints only."""
    v, a = _at_ends(displacements, times)
    return _beyond(v, a, limits)


def printed_excess(displacements: Array, times: Array, limits: Limits) -> Array:
    """Fitness with the quintic's eq. 28 as printed: `3 a₃ τ³` and `9 a₃ τ²`, at 21 samples."""
    quintic = spline353.coefficients(displacements, times)[1]
    p5, p4, p3, p2, p1, _ = np.moveaxis(quintic, -1, 0)
    # The cubics' peaks are at the segments' ends.
    v, a = _at_ends(displacements, times)
    for share in np.linspace(0, 1, 21):
        t = share * times[..., 1]
        # v = 5 a₅ τ⁴ + (4 a₄ + 3 a₃) τ³ + 2 a₂ τ + a₁
        c3 = 4 * p4 + 3 * p3
        velocity = 5 * p5 * t**4 + c3 * t**3 + 2 * p2 * t + p1
        # a = 20 a₅ τ³ + (12 a₄ + 9 a₃) τ² + 2 a₂
        c2 = 12 * p4 + 9 * p3
        acceleration = 20 * p5 * t**3 + c2 * t**2 + 2 * p2
        v = np.maximum(v, np.abs(velocity))
        a = np.maximum(a, np.abs(acceleration))
    return _beyond(v, a, limits)


def _at_ends(displacements: Array, times: Array) -> tuple[Array, Array]:
    """The larger velocity and acceleration where the quintic starts and ends."""
    quintic = spline353.Quintic.of(displacements, times)
    v = np.maximum(np.abs(quintic.v0), np.abs(quintic.v1))
    a = np.maximum(np.abs(quintic.a0), np.abs(quintic.a1))
    return v, a


def _beyond(velocity: Array, acceleration: Array, limits: Limits) -> Array:
    use_v = velocity / limits.velocity[..., 1]
    use_a = acceleration / limits.acceleration[..., 1]
    return _excess(use_v, use_a)


def _excess(use_v: Array, use_a: Array) -> Array:
    """From the shares used of each limit, what is beyond 1, both together."""
    beyond_v = np.maximum(use_v - 1, 0.0)
    beyond_a = np.maximum(use_a - 1, 0.0)
    return np.asarray(beyond_v + beyond_a)


Change = Callable[[Problem], Problem]


def limited(read: Callable[[Limits], Limits]) -> Change:
    """A problem's limits read in another way."""

    def changed(problem: Problem) -> Problem:
        return replace(problem, limits=read(problem.limits))

    return changed


def one_joint_for_all(joint: int) -> Change:
    """One joint's limits (from 0) for all joints."""

    def read(limits: Limits) -> Limits:
        same = [joint] * limits.joints
        return Limits(limits.velocity[same], limits.acceleration[same])

    return limited(read)


def unchanged(problem: Problem) -> Problem:
    return problem


def printed_order(problem: Problem) -> Problem:
    """The waypoints in the order of eq. 31's right-hand side."""
    order = [1, 3, 2, 0]
    return replace(problem, waypoints=problem.waypoints[order])


@dataclass(frozen=True)
class Reading:
    """One reading of the paper: its options, fitness or problem, where not the default.

    `beside`: the reading whose runs stand for the algorithms that this one leaves out.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    fitness: Fitness | None = None
    problem: Change = unchanged
    algorithms: tuple[str, ...] = ALGORITHMS
    beside: str = ""

    def search(self, algorithm: str, timing: str, seeds: int, iterations: int) -> Runs:
        problem = self.problem(suite.load("six-axis"))
        planner = load(algorithm)
        known = options(planner)
        changes = {key: value for key, value in self.options.items() if key in known}
        changes |= {"iterations": iterations, "timing": timing}
        planner = configured(planner, changes)
        assert isinstance(planner, SwarmPlanner)
        if self.fitness is not None:
            own = {option.name: getattr(planner, option.name) for option in fields(planner)}
            planner = OtherSwarm(**own, other=self.fitness)
        return swarm(planner, problem, seeds)


FREE = 1e6  # times a limit: none
PRINTED = dict.fromkeys(("eq41", "eq43", "eq49", "eq50"), "printed")
FIRST_PSO = {"inertia": 1.0, "cognitive": 2.0, "social": 2.0}  # Kennedy and Eberhart (1995)
SPARROWS = ("ssa", "issa")
PSO_ALONE = ("pso",)


def _swapped(limits: Limits) -> Limits:
    return Limits(limits.acceleration, limits.velocity)


def _velocity_only(limits: Limits) -> Limits:
    return Limits(limits.velocity, FREE * limits.acceleration)


def _acceleration_only(limits: Limits) -> Limits:
    return Limits(FREE * limits.velocity, limits.acceleration)


def _degrees(limits: Limits) -> Limits:
    return Limits(np.degrees(limits.velocity), np.degrees(limits.acceleration))


DEFAULT = Reading("default")
# Readings that run with every algorithm.
BASES = (
    Reading("unit box", options={"space": "unit"}),
    Reading("soft penalty 0.5 s", fitness=Fitness(exact_excess, weight=0.5)),
    Reading("bounds 0.5–4 s", fitness=Fitness(exact_excess, box=(0.5, 4.0))),
    Reading("joint 6's limits for all", problem=one_joint_for_all(5)),
    Reading("eq. 28 as printed", fitness=Fitness(printed_excess)),
)


def _with_first_pso(base: Reading) -> Reading:
    return replace(
        base,
        name=f"PSO of 1995, {base.name}",
        options={**base.options, **FIRST_PSO},
        algorithms=PSO_ALONE,
        beside=base.name,
    )


def _with_pso(name: str, problem: Change = unchanged, fitness: Fitness | None = None) -> Reading:
    return Reading(name, fitness=fitness, problem=problem, algorithms=PSO_ALONE)


READINGS = (
    DEFAULT,
    *BASES,
    Reading(
        "eq. 41, 43, 49, 50 as printed", options=PRINTED, algorithms=SPARROWS, beside=DEFAULT.name
    ),
    Reading(
        "always accept", options={"acceptance": "always"}, algorithms=SPARROWS, beside=DEFAULT.name
    ),
    Reading("PSO of 1995", options=FIRST_PSO, algorithms=PSO_ALONE, beside=DEFAULT.name),
    *map(_with_first_pso, BASES[1:]),
    _with_pso("eq. 31 as printed", printed_order),
    _with_pso("joint 1's limits for all", one_joint_for_all(0)),
    _with_pso("velocity and acceleration swapped", limited(_swapped)),
    _with_pso("velocity limits only", limited(_velocity_only)),
    _with_pso("acceleration limits only", limited(_acceleration_only)),
    _with_pso("degrees against radians", limited(_degrees)),
    _with_pso("limits where segments meet", fitness=Fitness(ends_excess)),
    _with_pso("bounds 0.1–2 s", fitness=Fitness(exact_excess, box=(0.1, 2.0))),
    _with_pso("soft penalty 1 s", fitness=Fitness(exact_excess, weight=1.0)),
)
