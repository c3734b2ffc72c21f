"""Particle swarm optimisation with the constriction coefficients (Clerc and Kennedy, 2002)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt.swarm.optimiser import Box, Optimiser, Search, Streams, require


@dataclass(frozen=True)
class PSO(Optimiser):
    """Particle swarm: every particle is drawn to its own best position and to the swarm's.

    - `inertia`, `cognitive`, `social`: χ and χφ₁ = χφ₂ for φ₁ + φ₂ = 4.1;
    - `clamp`: the largest speed, as a fraction of the box;
    - `rebound`: a particle that would leave the box is put on its wall, its velocity across it
      times `-rebound`. 0.5 is standard PSO 2007; with -1, which keeps the velocity, one swarm in
      ten ends up flat against a wall near which the minimum lies.

    Particles start at rest.
    """

    inertia: float = 0.7298
    cognitive: float = 1.49618
    social: float = 1.49618
    clamp: float = 1.0
    rebound: float = 0.5

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("inertia", "cognitive", "social"):
            value = getattr(self, name)
            require(name, value, 0 <= value < np.inf, "a finite number, 0 or more")
        require("clamp", self.clamp, 0 < self.clamp < np.inf, "a finite number above 0")
        require("rebound", self.rebound, -1 <= self.rebound <= 1, "a number from -1 to 1")

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        shape, rows = (self.population, box.low.shape[-1]), np.arange(len(streams))
        x = box.spread(streams.uniform(*shape))
        f = yield x
        own_x, own_f, v = x, f, np.zeros_like(x)  # p_i, its fitness, and the velocity
        top = self.clamp * box.size
        for _ in range(iterations):
            swarm_x = own_x[rows, own_f.argmin(axis=1), None]  # p_g
            to_own, to_swarm = streams.uniform(*shape), streams.uniform(*shape)
            v = self.inertia * v + self.cognitive * to_own * (own_x - x)
            v = np.clip(v + self.social * to_swarm * (swarm_x - x), -top, top)
            flown = x + v
            x = box.clip(flown)
            v = np.where(x == flown, v, -self.rebound * v)
            f = yield x
            better = f < own_f
            own_x, own_f = np.where(better[..., None], x, own_x), np.where(better, f, own_f)
