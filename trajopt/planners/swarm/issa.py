"""The improved sparrow search algorithm under test (the paper's section 4.2, eq. 42–50).

Four changes to SSA, each of which can be switched off; with all four off it *is* SSA, bit for bit.
Where the printed formula differs from what must be meant and still runs, both readings are options.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import gamma, pi, sin
from typing import Literal

import numpy as np

from trajopt.core.arrays import Array
from trajopt.planners.swarm.optimiser import require, require_size
from trajopt.planners.swarm.ssa import SSA, Flock, Move

Reading = Literal["intended", "printed"]


@dataclass(frozen=True)
class ISSA(SSA):
    """SSA with a chaotic start, Lévy flights, a falling weight and opposite points.

    - `chaos` (eq. 43, parameter `chaos_a`): the first flock comes from a chaotic map; `eq43`;
    - `levy` (eq. 44, 45, 47, exponent `levy_exponent`): discoverers move by `X · Lévy` in calm;
    - `weight` (eq. 46, 47, from `weight_max` to `weight_min`): their random steps shrink with time;
    - `opposition` (eq. 48–50): a vigilante also tries a point towards the best sparrow's opposite,
      and goes there if it is better than eq. 41's; both count as evaluations. `eq49` starts at the
      opposite point (intended) or at the best sparrow (printed); `eq50` is `((t_max − t)/t_max)^t`
      (intended) or `(t_max − t/t_max)^t` (printed; it overflows, and then the walls stop it).
    """

    chaos: bool = True
    levy: bool = True
    weight: bool = True
    opposition: bool = True
    chaos_a: float = 0.9
    levy_exponent: float = 1.5
    weight_max: float = 0.9
    weight_min: float = 0.4
    eq43: Reading = "intended"
    eq49: Reading = "intended"
    eq50: Reading = "intended"

    def __post_init__(self) -> None:
        super().__post_init__()
        a = self.chaos_a
        require("chaos_a", a, 0 <= a <= 1, "a number from 0 to 1")
        exponent = self.levy_exponent
        require("levy_exponent", exponent, 0 < exponent < 2, "a number between 0 and 2")
        for name in ("weight_max", "weight_min"):
            require_size(self, name)

    @property
    def evaluations_per_iteration(self) -> int:
        own = super().evaluations_per_iteration
        if self.opposition:
            return own + self._count(self.vigilantes)
        return own

    def _start(self, flock: Flock) -> Array:
        """Every dimension follows its own orbit of the map, from its own random point."""
        if not self.chaos:
            return super()._start(flock)
        dim = flock.box.dim
        x = flock.extra.uniform(dim)
        y = flock.extra.uniform(dim)
        orbit = []
        for _ in range(self.population):
            x, y = chaotic_map(x, y, self.chaos_a, self.eq43)
            orbit.append(x)
        unit = np.stack(orbit, axis=1)
        return flock.box.spread(unit)

    def _calm(self, flock: Flock, shrunk: Array, x: Array) -> Array:
        """Eq. 47, first case: X + X · Lévy, with Mantegna's steps μ / |ν|^(1/λ)."""
        if not self.levy:
            return shrunk
        drawn = flock.extra.normal(2, *x.shape[1:])
        mu = levy_scale(self.levy_exponent) * drawn[:, 0]
        nu = drawn[:, 1]
        power = 1 / self.levy_exponent
        levy = mu / np.abs(nu) ** power
        return x + x * levy

    def _weight(self, flock: Flock) -> float:
        if not self.weight:
            return 1.0
        progress = flock.t / flock.t_max
        return falling_weight(progress, self.weight_max, self.weight_min)

    def _watch(self, flock: Flock) -> Move:
        slots, places = super()._watch(flock)
        if not self.opposition:
            return slots, places
        opposite = self._opposite(flock)
        return slots, [*places, opposite]

    def _opposite(self, flock: Flock) -> Array:
        """Eq. 48 and 49."""
        best = flock.best_x
        box = flock.box
        # X* = u + r (l − X_b)
        vigilantes = self._count(self.vigilantes)
        r = flock.extra.uniform(vigilantes, box.dim)
        opposite = box.high + r * (box.low - best)
        # X* + b1 (X_b − X*), or X_b + b1 (X_b − X*) as printed; b1 can be infinite
        b1 = control(flock.t, flock.t_max, self.eq50)
        with np.errstate(over="ignore", invalid="ignore"):
            step = b1 * (best - opposite)
            if self.eq49 == "printed":
                return best + step
            return opposite + step


def chaotic_map(x: Array, y: Array, a: float, reading: Reading = "intended") -> tuple[Array, Array]:
    """One step of the two-dimensional logistic-sine-coupling map (eq. 43), any shape.

    Maps the unit square to itself for `a` in `[0, 1]`: the sine's argument stays within `[0, π]`.
    """
    logistic_x = 4 * a * x * (1 - x)
    logistic_y = 4 * a * y * (1 - y)
    if reading == "intended":
        # x' = sin(π (4 a x (1 − x) + (1 − a) sin πy)), and y' likewise with x'
        coupling = (1 - a) * np.sin(pi * y)
        x = np.sin(pi * (logistic_x + coupling))
        coupling = (1 - a) * np.sin(pi * x)
        y = np.sin(pi * (logistic_y + coupling))
        return x, y
    # x' = sin(π · 4 a x (1 − x) + (1 − a) sin πy), and y' with x'²
    coupling = (1 - a) * np.sin(pi * y)
    x = np.sin(pi * logistic_x + coupling)
    coupling = (1 - a) * np.sin(pi * x**2)
    y = np.sin(pi * logistic_y + coupling)
    return x, y


def falling_weight(progress: float, weight_max: float, weight_min: float) -> float:
    """Eq. 46: ω, where `progress` is `t / t_max`."""
    return weight_max - (weight_max - weight_min) * progress**2


def control(t: int, t_max: int, reading: Reading = "intended") -> np.float64:
    """Eq. 50: b1; infinite where the printed form overflows."""
    base = (t_max - t) / t_max
    if reading == "printed":
        base = t_max - t / t_max
    with np.errstate(over="ignore"):
        return np.float64(np.float64(base) ** t)


def levy_scale(exponent: float) -> float:
    """Eq. 45: σ_μ of Mantegna's algorithm."""
    wave = sin(pi * exponent / 2)
    top = gamma(1 + exponent) * wave
    half = (1 + exponent) / 2
    power = 2 ** ((exponent - 1) / 2)
    bottom = gamma(half) * exponent * power
    return float((top / bottom) ** (1 / exponent))
