"""Particle swarm optimisation with the constriction coefficients (Clerc and Kennedy, 2002)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt.planners.swarm.optimiser import (
    Box,
    Contest,
    Optimiser,
    Search,
    Streams,
    require,
    require_size,
)


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
            require_size(self, name)
        clamp = self.clamp
        require("clamp", clamp, 0 < clamp < np.inf, "a finite number above 0")
        rebound = self.rebound
        require("rebound", rebound, -1 <= rebound <= 1, "a number from -1 to 1")

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        shape = (self.population, box.dim)
        rows = np.arange(len(streams))
        x = box.spread(streams.uniform(*shape))
        f = yield x
        # p_i, its fitness, and the velocities
        own_x = x
        own_f = f
        v = np.zeros_like(x)
        v_max = self.clamp * box.size
        for _ in range(iterations):
            # p_g
            best = own_f.argmin(axis=1)
            swarm_x = own_x[rows, best, None]
            # v = χ v + χφ₁ u₁ (p_i − x) + χφ₂ u₂ (p_g − x), within ±v_max
            u1, u2 = streams.uniform(2, *shape).swapaxes(0, 1)
            to_own = self.cognitive * u1 * (own_x - x)
            to_swarm = self.social * u2 * (swarm_x - x)
            v = self.inertia * v + to_own
            v = np.clip(v + to_swarm, -v_max, v_max)
            # x = x + v; a particle outside is put on the bound, its velocity turned back
            flown = x + v
            x = box.clip(flown)
            turned = -self.rebound * v
            v = np.where(x == flown, v, turned)
            f = yield Contest(x, own_f)
            better = f < own_f
            own_x = np.where(better[..., None], x, own_x)
            own_f = np.where(better, f, own_f)
