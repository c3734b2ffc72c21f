"""Whale optimisation (Mirjalili and Lewis, 2016, doi:10.1016/j.advengsoft.2016.01.008).

Here because papers give it the segment times of splines, and no library that installs beside
NumPy 2 has it. Written from the paper's equations, with its parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt.planners.swarm import Box, Optimiser, Streams
from trajopt.planners.swarm.optimiser import Search

Array = NDArray[np.float64]

_SPIRAL = 1.0  # b of eq. 2.5


@dataclass(frozen=True)
class WOA(Optimiser):
    """Whales encircle the best place so far, spiral towards it, or follow another whale."""

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        shape = (self.population, box.dim)
        rows = np.arange(len(streams))[:, None]
        x = box.spread(streams.uniform(*shape))
        f = yield x
        best_x, best_f = _best(x, f)
        for t in range(iterations):
            # A = 2 a r − a and C = 2 r, where a falls from 2 to 0 (eqs. 2.3 and 2.4)
            a = 2 * (1 - t / iterations)
            r_a = streams.uniform(*shape)
            r_c = streams.uniform(*shape)
            big_a = 2 * a * r_a - a
            big_c = 2 * r_c
            # X_rand takes the place of X* where |A| ≥ 1 (eq. 2.8)
            drawn = self.population * streams.uniform(self.population)
            other_x = x[rows, drawn.astype(np.intp)]
            leader = np.where(np.abs(big_a) < 1, best_x, other_x)
            # X = X* − A |C X* − X| (eq. 2.1)
            distance = np.abs(big_c * leader - x)
            encircling = leader - big_a * distance
            # X = |X* − X| exp(b l) cos(2π l) + X*, with l from −1 to 1 (eq. 2.5)
            turn = 2 * streams.uniform(self.population, 1) - 1
            growth = np.exp(_SPIRAL * turn)
            swing = np.cos(2 * np.pi * turn)
            spiralling = best_x + np.abs(best_x - x) * growth * swing
            encircles = streams.uniform(self.population, 1) < 0.5
            moved = np.where(encircles, encircling, spiralling)
            x = box.clip(moved)
            f = yield x
            # X*, the best so far
            now_x, now_f = _best(x, f)
            better = now_f < best_f
            best_x = np.where(better[..., None], now_x, best_x)
            best_f = np.where(better, now_f, best_f)


def _best(x: Array, f: Array) -> tuple[Array, Array]:
    """The place of the lowest fitness, `(runs, 1, dim)`, and that fitness, `(runs, 1)`."""
    winner = f.argmin(axis=1)[:, None]
    best_x = np.take_along_axis(x, winner[..., None], axis=1)
    best_f = np.take_along_axis(f, winner, axis=1)
    return best_x, best_f
