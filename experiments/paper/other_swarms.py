"""Two optimisers that the paper's introduction names, in the form of their first publications.

The works that it cites improve them; it does not say how, so their improvements are not here.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt.planners.swarm.optimiser import Box, Contest, Optimiser, Search, Streams


@dataclass(frozen=True)
class QPSO(Optimiser):
    """Quantum-behaved particle swarm (Sun, Feng and Xu, CEC 2004).

    A particle is drawn anew about a point between its own best place and the swarm's, at a
    distance from the mean of all best places. The factor falls linearly from `first` to `last`.
    """

    first: float = 1.0
    last: float = 0.5

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        shape = (self.population, box.dim)
        rows = np.arange(len(streams))
        own_x = box.spread(streams.uniform(*shape))
        own_f = yield own_x
        x = own_x
        for t in range(iterations):
            factor = self.first + (self.last - self.first) * t / max(iterations - 1, 1)
            share, u, coin = streams.uniform(3, *shape).swapaxes(0, 1)
            best = own_x[rows, own_f.argmin(axis=1), None]
            middle = own_x.mean(axis=1, keepdims=True)
            # x = p ± β |m − x| ln(1/u), p between the particle's best place and the swarm's
            about = share * own_x + (1 - share) * best
            away = factor * np.abs(middle - x) * -np.log1p(-u)
            x = box.clip(about + np.where(coin < 0.5, away, -away))
            f = yield Contest(x, own_f)
            better = f < own_f
            own_x = np.where(better[..., None], x, own_x)
            own_f = np.where(better, f, own_f)


@dataclass(frozen=True)
class WOA(Optimiser):
    """Whale optimisation (Mirjalili and Lewis, Adv. Eng. Softw. 95, 2016), `b` of its spiral."""

    b: float = 1.0

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        n = self.population
        rows = np.arange(len(streams))
        x = box.spread(streams.uniform(n, box.dim))
        f = yield x
        leader_x, leader_f = x[rows, f.argmin(axis=1), None], f.min(axis=1)
        for t in range(iterations):
            a = 2 - 2 * t / iterations
            r1, r2, p, turn, pick = np.moveaxis(streams.uniform(5, n, 1), 1, 0)
            # Encircle the leader, or search about a random whale where |A| ≥ 1
            A, C = 2 * a * r1 - a, 2 * r2
            other = x[rows[:, None], np.floor(n * pick[..., 0]).astype(int)]
            towards = np.where(np.abs(A) < 1, leader_x, other)
            straight = towards - A * np.abs(C * towards - x)
            # Or follow a spiral to the leader, l from −1 to 1 (its authors' program: to −2)
            turn = 2 * turn - 1
            spiral = np.abs(leader_x - x) * np.exp(self.b * turn) * np.cos(2 * np.pi * turn)
            x = box.clip(np.where(p < 0.5, straight, spiral + leader_x))
            f = yield x
            winner = f.argmin(axis=1)
            better = f[rows, winner] < leader_f
            leader_x = np.where(better[:, None, None], x[rows, winner, None], leader_x)
            leader_f = np.where(better, f[rows, winner], leader_f)
