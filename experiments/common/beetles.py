"""Dung beetle optimisation (Xue and Shen, 2023, doi:10.1007/s11227-022-04959-6).

Here because papers give it the segment times of splines, and no library that installs beside
NumPy 2 has it. Written from the paper's equations; where it is silent, as its authors' program:
the numbers of beetles, the best place of the moment once the balls have rolled, and beetles that
start from their own best place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt.planners.swarm import Box, Optimiser, Streams
from trajopt.planners.swarm.optimiser import Search, require

Array = NDArray[np.float64]

# k and b of eq. 1, S of eq. 7
_DEFLECTION = 0.1
_LIGHT = 0.3
_THEFT = 0.5
_DEFLECTED_PROBABILITY = 0.1
_OBSTACLE_PROBABILITY = 0.1
# Beetles that roll, brood and forage, of every 30; the others steal.
_ROLLING = 6
_BROODING = 6
_FORAGING = 7


@dataclass(frozen=True)
class DBO(Optimiser):
    """Beetles roll balls, brood, forage and steal, each from the best place that it had."""

    def __post_init__(self) -> None:
        super().__post_init__()
        own = self.population
        require("population", own, own % 30 == 0, "a multiple of 30")

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        share = self.population // 30
        rolling = _ROLLING * share
        brooding = rolling + _BROODING * share
        foraging = brooding + _FORAGING * share
        x = box.spread(streams.uniform(self.population, box.dim))
        f = yield x
        # every beetle's own best place, where it was an iteration before, and the best of all
        own_x = x
        own_f = f
        before_x = x
        best_x = _best(x, f)
        for t in range(iterations):
            worst_x = _best(x, -f)
            rolled = _roll(own_x[:, :rolling], before_x[:, :rolling], worst_x, streams)
            rolled = box.clip(rolled)
            rolled_f = yield rolled
            x = np.concatenate([rolled, x[:, rolling:]], axis=1)
            f = np.concatenate([rolled_f, f[:, rolling:]], axis=1)
            # X*, the best of the moment; the surroundings shrink with R = 1 − t/t_max
            now_x = _best(x, f)
            width = 1 - (t + 1) / iterations
            nest = _around(now_x, width, box)
            food = _around(best_x, width, box)
            broods = _brood(own_x[:, rolling:brooding], now_x, nest, streams)
            foraged = _forage(own_x[:, brooding:foraging], food, streams)
            stolen = _steal(own_x[:, foraging:], now_x, best_x, streams)
            others = np.concatenate([broods, foraged, stolen], axis=1)
            others = box.clip(others)
            others_f = yield others
            x = np.concatenate([rolled, others], axis=1)
            f = np.concatenate([rolled_f, others_f], axis=1)
            before_x = own_x
            better = f < own_f
            own_x = np.where(better[..., None], x, own_x)
            own_f = np.where(better, f, own_f)
            best_x = _best(own_x, own_f)


def _best(x: Array, f: Array) -> Array:
    """The place of the lowest fitness, `(runs, 1, dim)`."""
    winner = f.argmin(axis=1)
    return np.take_along_axis(x, winner[:, None, None], axis=1)


def _around(x: Array, width: float, box: Box) -> tuple[Array, Array]:
    """The surroundings of a place: X (1 − R) and X (1 + R) within the box (eqs. 3 and 5)."""
    reach = width * x
    low = box.clip(x - reach)
    high = box.clip(x + reach)
    return low, high


def _roll(
    x: Array,
    before: Array,
    worst: Array,
    streams: Streams,
) -> Array:
    """Eq. 1, away from the worst place and on as before; eq. 2 where an obstacle turns a run."""
    beetles = x.shape[1]
    deflected = streams.uniform(beetles, 1) < _DEFLECTED_PROBABILITY
    alpha = np.where(deflected, -1.0, 1.0)
    # x + b |x − X^w| + α k x(t − 1)
    straight = x + _LIGHT * np.abs(x - worst) + alpha * _DEFLECTION * before
    # x + tan θ |x − x(t − 1)|
    angle = np.pi * streams.uniform(beetles, 1)
    turned = x + np.tan(angle) * np.abs(x - before)
    obstacle = streams.uniform(1, 1) < _OBSTACLE_PROBABILITY
    return np.where(obstacle, turned, straight)


def _brood(
    x: Array,
    now: Array,
    around: tuple[Array, Array],
    streams: Streams,
) -> Array:
    """Eq. 4: X* + b₁ (x − low) + b₂ (x − high), within the surroundings."""
    low, high = around
    b1 = streams.uniform(*x.shape[1:])
    b2 = streams.uniform(*x.shape[1:])
    laid = now + b1 * (x - low) + b2 * (x - high)
    inside: Array = np.clip(laid, low, high)
    return inside


def _forage(x: Array, around: tuple[Array, Array], streams: Streams) -> Array:
    """Eq. 6: x + C₁ (x − low) + C₂ (x − high), C₁ normal, C₂ uniform."""
    low, high = around
    c1 = streams.normal(x.shape[1], 1)
    c2 = streams.uniform(*x.shape[1:])
    return x + c1 * (x - low) + c2 * (x - high)


def _steal(
    x: Array,
    now: Array,
    best: Array,
    streams: Streams,
) -> Array:
    """Eq. 7: X^b + S g (|x − X*| + |x − X^b|), g normal."""
    g = streams.normal(*x.shape[1:])
    reach: Array = np.abs(x - now) + np.abs(x - best)
    return best + _THEFT * g * reach
