"""What the paper's text leaves open, one choice at a time: the readings of `paper_readings`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.random import SeedSequence

from experiments.paper.searches import ALGORITHMS, Array, Runs, swarm
from trajopt import Limits, Problem, spline353
from trajopt.benchmark.suites import catalogue as suite
from trajopt.registry import configured, load, options
from trajopt.swarm import Optimiser, minimise
from trajopt.swarm.optimiser import added
from trajopt.swarm_planner import SwarmPlanner

Excess = Callable[[Array, Array, Limits], Array]


@dataclass(frozen=True)
class Fitness:
    """A fitness that `SwarmPlanner` does not offer: what counts as excess, and its weight.

    `excess` gives per joint by how much limits are broken, relative; with no `weight`, a candidate
    with any ranks below all without. The box is in seconds, `None`: the planner's own.
    """

    excess: Excess
    weight: float | None = None
    box: tuple[float, float] | None = None

    def value(self, displacements: Array, times: Array, limits: Limits, shared: bool) -> Array:
        """Of candidates `(…, 3)` for each joint `(…, joints)`, or for all together `(…, 1)`."""
        over, total = self.excess(displacements, times, limits), added(times)
        over = over.sum(axis=-1, keepdims=True) if shared else over
        if self.weight is not None:
            return np.asarray(total + self.weight * over)
        return np.asarray(np.where(over > 0, 1e3 + over, total))


def searched(
    fitness: Fitness, optimiser: Optimiser, problem: Problem, seeds: int, iterations: int,
    shared: bool,
) -> Runs:  # fmt: skip
    """Runs with another fitness, all joints together or each alone; `history` is the fitness's."""
    joints, limits = np.flatnonzero(problem.moving), problem.limits
    own = limits.only(joints)
    groups, displacements = [-1] if shared else list(joints), problem.displacements.T[joints]

    def objective(x: Array) -> Array:
        times = x.reshape(seeds, len(groups), -1, 3).swapaxes(1, 2)
        value = fitness.value(displacements, times, own, shared)
        return value.swapaxes(1, 2).reshape(x.shape[:2])

    streams = [SeedSequence(s, spawn_key=(int(g),) if g >= 0 else ()) for s in range(seeds)
               for g in groups]  # fmt: skip
    low, high = fitness.box or (0.008, 8.0)
    low3, high3 = np.full(3, low), np.full(3, high)
    found = minimise(optimiser, objective, low3, high3, streams, iterations=iterations)
    times = np.full((seeds, problem.joints, 3), np.nan)
    times[:, joints] = found.position.reshape(seeds, len(groups), 3)
    keys = [[seed, group] for seed in range(seeds) for group in groups]
    marked = [np.column_stack([np.tile(np.array(k), (len(h), 1)), h])
              for k, h in zip(keys, found.histories, strict=True)]  # fmt: skip
    return Runs(times, np.concatenate(marked))


def exact_excess(displacements: Array, times: Array, limits: Limits) -> Array:
    """By how much the true peaks of velocity and acceleration exceed their limits."""
    v, a, _ = spline353.limit_use(displacements, times, limits, exact_above=1.0)
    return np.maximum(v - 1, 0.0) + np.maximum(a - 1, 0.0)


def ends_excess(displacements: Array, times: Array, limits: Limits) -> Array:
    """The same, with limits looked at where segments meet only."""
    v = np.abs(spline353.velocity_controls(displacements, times)[[0, -1]]).max(axis=0)
    a = np.abs(spline353.acceleration_controls(displacements, times)[[0, -1]]).max(axis=0)
    return _beyond(v, a, limits)


def printed_excess(displacements: Array, times: Array, limits: Limits) -> Array:
    """The same with the quintic's eq. 28 as printed: `3 a₃ τ³` and `9 a₃ τ²`, at 21 samples."""
    p5, p4, p3, p2, p1, _ = np.moveaxis(spline353.coefficients(displacements, times)[1], -1, 0)
    v0, v1 = np.abs(spline353.velocity_controls(displacements, times)[[0, -1]])
    a0, a1 = np.abs(spline353.acceleration_controls(displacements, times)[[0, -1]])
    v, a = np.maximum(v0, v1), np.maximum(a0, a1)  # the cubics, whose peaks these are
    for share in np.linspace(0, 1, 21):
        t = share * times[..., 1]
        v = np.maximum(v, np.abs(5 * p5 * t**4 + (4 * p4 + 3 * p3) * t**3 + 2 * p2 * t + p1))
        a = np.maximum(a, np.abs(20 * p5 * t**3 + (12 * p4 + 9 * p3) * t**2 + 2 * p2))
    return _beyond(v, a, limits)


def _beyond(velocity: Array, acceleration: Array, limits: Limits) -> Array:
    use_v = velocity / limits.velocity[..., 1]
    use_a = acceleration / limits.acceleration[..., 1]
    return np.asarray(np.maximum(use_v - 1, 0.0) + np.maximum(use_a - 1, 0.0))


def limited(velocity: Callable[[Limits], Array], acceleration: Callable[[Limits], Array]) -> Any:
    """A problem's limits read in another way."""
    return lambda p: replace(p, limits=Limits(velocity(p.limits), acceleration(p.limits)))


def every(row: int) -> Callable[[Array], Array]:
    """One joint's limit for all joints."""
    return lambda pairs: np.tile(pairs[row], (len(pairs), 1))


@dataclass(frozen=True)
class Reading:
    """What differs from the default, as options, fitness or problem.

    `beside`: the reading whose runs stand for the algorithms that this one leaves out.
    """

    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    fitness: Fitness | None = None
    problem: Callable[[Problem], Problem] = lambda p: p
    algorithms: tuple[str, ...] = ALGORITHMS
    beside: str = ""

    def search(self, algorithm: str, timing: str, seeds: int, iterations: int) -> Runs:
        planner, problem = load(algorithm), self.problem(suite.load("six-axis"))
        fitting = {k: v for k, v in self.options.items() if k in options(planner)}
        planner = configured(planner, fitting | {"iterations": iterations, "timing": timing})
        assert isinstance(planner, SwarmPlanner)
        if self.fitness is None:
            return swarm(planner, problem, seeds)
        shared = timing == "shared"
        return searched(self.fitness, planner.optimiser, problem, seeds, iterations, shared)


FREE = 1e6  # times a limit: none
PRINTED = {"eq41": "printed", "eq43": "printed", "eq49": "printed", "eq50": "printed"}
FIRST_PSO = {"inertia": 1.0, "cognitive": 2.0, "social": 2.0}  # Kennedy and Eberhart (1995)
SPARROWS, PSO_ALONE = ("ssa", "issa"), ("pso",)

WIDE = limited(lambda x: every(5)(x.velocity), lambda x: every(5)(x.acceleration))
SOFT = Fitness(exact_excess, weight=0.5)
HALF = Fitness(exact_excess, box=(0.5, 4.0))
BASES = (
    Reading("default"),
    Reading("unit box", {"space": "unit"}),
    Reading("soft penalty 0.5 s", fitness=SOFT),
    Reading("bounds 0.5–4 s", fitness=HALF),
    Reading("joint 6's limits for all", problem=WIDE),
    Reading("eq. 28 as printed", fitness=Fitness(printed_excess)),
)
READINGS = (
    *BASES,
    Reading("eq. 41, 43, 49, 50 as printed", PRINTED, algorithms=SPARROWS, beside="default"),
    Reading("always accept", {"acceptance": "always"}, algorithms=SPARROWS, beside="default"),
    Reading("PSO of 1995", FIRST_PSO, algorithms=PSO_ALONE, beside="default"),
    *(replace(base, name=f"PSO of 1995, {base.name}", options={**base.options, **FIRST_PSO},
              algorithms=PSO_ALONE, beside=base.name) for base in BASES[2:]),
    Reading("eq. 31 as printed", algorithms=PSO_ALONE,
            problem=lambda p: replace(p, waypoints=p.waypoints[[1, 3, 2, 0]])),
    Reading("joint 1's limits for all", algorithms=PSO_ALONE, problem=limited(
        lambda x: every(0)(x.velocity), lambda x: every(0)(x.acceleration))),
    Reading("velocity and acceleration swapped", algorithms=PSO_ALONE, problem=limited(
        lambda x: x.acceleration, lambda x: x.velocity)),
    Reading("velocity limits only", algorithms=PSO_ALONE, problem=limited(
        lambda x: x.velocity, lambda x: FREE * x.acceleration)),
    Reading("acceleration limits only", algorithms=PSO_ALONE, problem=limited(
        lambda x: FREE * x.velocity, lambda x: x.acceleration)),
    Reading("degrees against radians", algorithms=PSO_ALONE, problem=limited(
        lambda x: np.degrees(x.velocity), lambda x: np.degrees(x.acceleration))),
    Reading("limits where segments meet", fitness=Fitness(ends_excess), algorithms=PSO_ALONE),
    Reading("bounds 0.1–2 s", fitness=Fitness(exact_excess, box=(0.1, 2.0)), algorithms=PSO_ALONE),
    Reading("soft penalty 1 s", fitness=Fitness(exact_excess, weight=1.0), algorithms=PSO_ALONE),
)  # fmt: skip
