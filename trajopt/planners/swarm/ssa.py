"""The sparrow search algorithm (Xue and Shen, 2020; the paper's eq. 37–41).

Symbols of the paper: `X` positions, `f` fitness, `i` rank from 1 in the sorted flock, `t`
iteration, `X_b, f_g` best so far, `X_w, f_w` worst of the flock, `X_p` best discoverer after its
move, `R2` alarm, `ST` safety value. `Q`, `α` and `K` are one number per sparrow (`L` is a row of
ones), `β` one per dimension, as in the authors' program.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from trajopt.core.arrays import Array, Indices
from trajopt.planners.swarm.optimiser import (
    Box,
    Contest,
    Optimiser,
    Search,
    Streams,
    added,
    require,
)

Slots = Indices | slice  # which sparrows of the flock: (m,), or (runs, m)
Move = tuple[Slots, list[Array]]  # some sparrows, and their candidate positions

_EPSILON = 1e-50  # ε of eq. 41, as in the authors' program


class Flock:
    """The state of a search, at iteration `t` of `t_max`.

    Positions `x` `(runs, population, dim)` and fitness `f` `(runs, population)`; the best so far
    `best_x` `(runs, 1, dim)` and `best_f` `(runs, 1)`. What SSA draws comes from `streams`; what
    only ISSA draws comes from `extra`, so that SSA's numbers stay the same beside it.
    """

    def __init__(self, box: Box, streams: Streams, t_max: int) -> None:
        self.box = box
        self.streams = streams
        self.extra = streams.beside()
        self.t = 0
        self.t_max = t_max
        self.rows = np.arange(len(streams))[:, None]

    def settle(self, x: Array, f: Array) -> None:
        """Start from the first positions."""
        self.x = x
        self.f = f
        self.sort()
        self.best_x = self.x[:, :1].copy()
        self.best_f = self.f[:, :1].copy()

    def sort(self) -> None:
        """Sort the flock, best first."""
        order = self.f.argsort(axis=1, kind="stable")
        self.x, self.f = self.place(order)

    def place(self, slots: Slots) -> tuple[Array, Array]:
        """Positions `(runs, m, dim)` and fitness `(runs, m)` of some sparrows."""
        if isinstance(slots, slice):
            # neighbours need no look-up
            return self.x[:, slots], self.f[:, slots]
        x = self.x[self.rows, slots]
        f = self.f[self.rows, slots]
        return x, f

    def worst(self) -> tuple[Array, Array]:
        """`X_w` `(runs, 1, dim)` and `f_w` `(runs, 1)`."""
        last = self.f.argmax(axis=1)
        return self.place(last[:, None])

    def move(self, slots: Slots, x: Array, f: Array) -> None:
        """Move sparrows to new positions."""
        if isinstance(slots, slice):
            self.x[:, slots] = x
            self.f[:, slots] = f
            return
        self.x[self.rows, slots] = x
        self.f[self.rows, slots] = f

    def remember(self, x: Array, f: Array) -> None:
        """Update the best position seen."""
        rows = self.rows
        winner = f.argmin(axis=1)
        first = winner[:, None]
        first_x = x[rows, first]
        first_f = f[rows, first]
        better = first_f < self.best_f
        self.best_x = np.where(better[..., None], first_x, self.best_x)
        self.best_f = np.where(better, first_f, self.best_f)


@dataclass(frozen=True)
class SSA(Optimiser):
    """Sparrow search: discoverers explore, followers gather round the best, vigilantes take fright.

    - `discoverers`, `vigilantes`: shares of the population; `safety`: ST;
    - `acceptance`: whether a sparrow keeps its place where the new one is worse;
    - `boundary`: what happens outside the box; a place that is not a number is never taken;
    - `sorting`: the flock is ranked once per iteration, or before each kind of move;
    - `watch`: vigilantes are drawn at random, no sparrow twice, or are the first of the flock;
    - `step`: `|X_i − X_p| · A⁺ · L` of eq. 40 as the matrix product that it is (one step for all
      dimensions), or element by element with `A` for `A⁺`, as many programs have it;
    - `eq41`: the denominator `(f_i − f_w) + ε` (intended) or `(f_i > f_w) + ε` (printed).
    """

    discoverers: float = 0.2
    vigilantes: float = 0.1
    safety: float = 0.8
    acceptance: Literal["greedy", "always"] = "greedy"
    boundary: Literal["clip", "reflect"] = "clip"
    sorting: Literal["iteration", "phase"] = "iteration"
    watch: Literal["random", "first"] = "random"
    step: Literal["matrix", "elementwise"] = "matrix"
    eq41: Literal["intended", "printed"] = "intended"

    def __post_init__(self) -> None:
        super().__post_init__()
        most = self.population - 1
        some = f"a share of 1 to {most} sparrows"
        for name in ("discoverers", "vigilantes"):
            share = getattr(self, name)
            holds = 0 < share < 1 and 1 <= self._count(share) <= most
            require(name, share, holds, some)
        is_share = 0 <= self.safety <= 1
        require("safety", self.safety, is_share, "a number from 0 to 1")

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population + self._count(self.vigilantes)

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        flock = Flock(box, streams, iterations)
        x = self._start(flock)
        f = yield x
        flock.settle(x, f)
        for flock.t in range(1, iterations + 1):
            if self.sorting == "iteration":
                flock.sort()
            for phase in (self._discover, self._follow, self._watch):
                if self.sorting == "phase":
                    flock.sort()
                slots, places = phase(flock)
                yield from self._moved(flock, slots, places)

    def _start(self, flock: Flock) -> Array:
        unit = flock.streams.uniform(self.population, flock.box.dim)
        return flock.box.spread(unit)

    def _discover(self, flock: Flock) -> Move:
        """Eq. 39."""
        m = self._count(self.discoverers)
        slots = slice(0, m)
        i = np.arange(m)[:, None] + 1
        x = flock.x[:, slots]
        drawn = flock.streams.uniform(1 + m, 1)
        safe = drawn[:, :1] < self.safety
        alpha = 1.0 - drawn[:, 1:]
        Q = flock.streams.normal(m, 1)
        # X exp(−i/(α t_max)) where R2 < ST, else X + Q L
        decay = -i / (alpha * flock.t_max)
        shrunk = x * np.exp(decay)
        calm = self._calm(flock, shrunk, x)
        weight = self._weight(flock)
        alarmed = x + Q * weight
        places = np.where(safe, calm, alarmed)
        return slots, [places]

    def _calm(self, flock: Flock, shrunk: Array, x: Array) -> Array:
        """Return the new positions of discoverers at `x` while `R2 < ST`."""
        return shrunk

    def _weight(self, flock: Flock) -> float:
        """The factor of a discoverer's random step."""
        return 1.0

    def _follow(self, flock: Flock) -> Move:
        """Eq. 40."""
        first = self._count(self.discoverers)
        slots = slice(first, self.population)
        i = np.arange(first, self.population)[:, None] + 1
        x = flock.x[:, slots]
        x_w, _ = flock.worst()
        discoverers_f = flock.f[:, :first]
        leader = discoverers_f.argmin(axis=1)
        x_p, _ = flock.place(leader[:, None])
        Q = flock.streams.normal(self.population - first, 1)
        coin = flock.streams.uniform(self.population - first, flock.box.dim)
        A = np.where(coin < 0.5, -1.0, 1.0)
        # The better half: X_p + |X − X_p| A⁺ L
        step = np.abs(x - x_p) * A
        if self.step == "matrix":
            # A⁺ = Aᵀ(AAᵀ)⁻¹ = Aᵀ/d; L spreads the sum over all dimensions
            total = added(step)
            step = total[..., None] / flock.box.dim
        gathered = x_p + step
        # The others: Q exp((X_w − X)/i²); in a box hundreds wide the bounds stop an overflow
        with np.errstate(over="ignore"):
            exponent = (x_w - x) / i**2
            away = Q * np.exp(exponent)
        hungry = i > self.population / 2
        places = np.where(hungry, away, gathered)
        return slots, [places]

    def _watch(self, flock: Flock) -> Move:
        """Eq. 41."""
        slots = self._vigilantes(flock)
        count = self._count(self.vigilantes)
        beta = flock.streams.normal(count, flock.box.dim)
        K = 2 * flock.streams.uniform(count, 1) - 1
        x, f = flock.place(slots)
        x_b = flock.best_x
        x_w, f_w = flock.worst()
        # Behind the best, f > f_g: X_b + β |X − X_b|
        from_best = np.abs(x - x_b)
        home = x_b + beta * from_best
        # The best itself: X + K |X − X_w| / ((f − f_w) + ε)
        fall = f - f_w
        if self.eq41 == "printed":
            worse = f > f_w
            fall = worse.astype(float)
        denominator = fall + _EPSILON
        from_worst = np.abs(x - x_w)
        step = from_worst / denominator[..., None]
        flee = x + K * step
        behind = f > flock.best_f
        places = np.where(behind[..., None], home, flee)
        return slots, [places]

    def _vigilantes(self, flock: Flock) -> Indices:
        """Indices of the vigilantes: the lowest of one random number per sparrow, or the first."""
        count = self._count(self.vigilantes)
        if self.watch == "first":
            return np.arange(count)
        drawn = flock.streams.uniform(self.population).argsort(axis=1)
        return drawn[:, :count]

    def _moved(self, flock: Flock, slots: Slots, places: list[Array]) -> Search:
        """Evaluate the candidates of some sparrows; each moves to its best one, if allowed."""
        own_x, own_f = flock.place(slots)
        x = [self._inside(flock.box, own_x, place) for place in places]
        greedy = self.acceptance == "greedy"
        asked = np.concatenate(x, axis=1)
        if greedy:
            incumbents = [own_f] * len(places)
            f = yield Contest(asked, np.concatenate(incumbents, axis=1))
        else:
            f = yield asked
        best_x, *other_x = x
        by_place = f.reshape(len(f), len(places), -1)
        best_f, *other_f = by_place.swapaxes(0, 1)
        others = zip(other_x, other_f, strict=True)
        for next_x, next_f in others:
            better = next_f < best_f
            best_x = np.where(better[..., None], next_x, best_x)
            best_f = np.where(better, next_f, best_f)
        flock.remember(best_x, best_f)
        if greedy:
            better = best_f < own_f
            best_x = np.where(better[..., None], best_x, own_x)
            best_f = np.where(better, best_f, own_f)
        flock.move(slots, best_x, best_f)

    def _inside(self, box: Box, own_x: Array, x: Array) -> Array:
        """Bring candidates into the box; NaN becomes the sparrow's own position."""
        inside = box.clip(x)
        if self.boundary == "reflect":
            inside = box.reflect(x)
        return np.where(np.isnan(inside), own_x, inside)

    def _count(self, share: float) -> int:
        return round(share * self.population)
