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
from numpy.typing import NDArray

from trajopt.swarm.optimiser import Array, Box, Optimiser, Search, Streams, added, require

Slots = NDArray[np.intp]  # which sparrows of the flock: (m,), or (runs, m)

_EPSILON = 1e-50  # ε of eq. 41, as in the authors' program


class Flock:
    """The state of a search, at iteration `t` of `t_max`.

    Positions `x` `(runs, population, dim)` and fitness `f` `(runs, population)`; the best so far
    `best_x` `(runs, 1, dim)` and `best_f` `(runs, 1)`. What SSA draws comes from `streams`; what
    only ISSA draws comes from `extra`, so that SSA's numbers stay the same beside it.
    """

    def __init__(self, box: Box, streams: Streams, t_max: int) -> None:
        self.box, self.streams, self.extra = box, streams, streams.beside()
        self.t, self.t_max = 0, t_max
        self.rows = np.arange(len(streams))[:, None]

    def settle(self, x: Array, f: Array) -> None:
        self.x, self.f = x, f
        self.sort()
        self.best_x, self.best_f = self.x[:, :1].copy(), self.f[:, :1].copy()

    def sort(self) -> None:
        """Best first."""
        order = np.argsort(self.f, axis=1, kind="stable")
        self.x, self.f = self.x[self.rows, order], self.f[self.rows, order]

    def place(self, slots: Slots) -> tuple[Array, Array]:
        """Positions `(runs, m, dim)` and fitness `(runs, m)` of some sparrows."""
        return self.x[self.rows, slots], self.f[self.rows, slots]

    def worst(self) -> tuple[Array, Array]:
        return self.place(self.f.argmax(axis=1)[:, None])

    def move(self, slots: Slots, x: Array, f: Array, greedy: bool) -> None:
        """Put sparrows in new places; the greedy ones only if they are better off there."""
        old_x, old_f = self.place(slots)
        moved = f < old_f if greedy else np.full(f.shape, True)
        self.x[self.rows, slots] = np.where(moved[..., None], x, old_x)
        self.f[self.rows, slots] = np.where(moved, f, old_f)
        first = f.argmin(axis=1)[:, None]
        better = f[self.rows, first] < self.best_f
        self.best_x = np.where(better[..., None], x[self.rows, first], self.best_x)
        self.best_f = np.where(better, f[self.rows, first], self.best_f)


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
        for name in ("discoverers", "vigilantes"):
            share = getattr(self, name)
            some = 0 < share < 1 and 0 < self._count(share) < self.population
            require(name, share, some, f"a share of 1 to {self.population - 1} sparrows")
        require("safety", self.safety, 0 <= self.safety <= 1, "a number from 0 to 1")

    @property
    def evaluations_per_iteration(self) -> int:
        return self.population + self._count(self.vigilantes)

    def search(self, box: Box, streams: Streams, iterations: int) -> Search:
        flock = Flock(box, streams, iterations)
        x = self._start(flock)
        flock.settle(x, (yield x))
        for flock.t in range(1, iterations + 1):
            for phase in (self._discover, self._follow, self._watch):
                if phase == self._discover or self.sorting == "phase":
                    flock.sort()
                slots, places = phase(flock)
                yield from self._moved(flock, slots, places)

    def _start(self, flock: Flock) -> Array:
        return flock.box.spread(flock.streams.uniform(self.population, flock.box.low.shape[-1]))

    def _discover(self, flock: Flock) -> tuple[Slots, list[Array]]:
        """Eq. 39."""
        slots = np.arange(self._count(self.discoverers))
        calm = flock.streams.uniform(1, 1) < self.safety  # R2 < ST, one R2 per run
        alpha = 1.0 - flock.streams.uniform(len(slots), 1)
        q, x = flock.streams.normal(len(slots), 1), flock.x[:, slots]
        shrunk = x * np.exp(-(slots[:, None] + 1) / (alpha * flock.t_max))
        return slots, [np.where(calm, self._calm(flock, shrunk, x), x + q * self._weight(flock))]

    def _calm(self, flock: Flock, shrunk: Array, x: Array) -> Array:
        """Where discoverers at `x` go while `R2 < ST`."""
        return shrunk

    def _weight(self, flock: Flock) -> float:
        """The factor of a discoverer's random step."""
        return 1.0

    def _follow(self, flock: Flock) -> tuple[Slots, list[Array]]:
        """Eq. 40."""
        first = self._count(self.discoverers)
        slots = np.arange(first, self.population)
        x, (worst, _) = flock.x[:, slots], flock.worst()
        leader = flock.place(flock.f[:, :first].argmin(axis=1)[:, None])[0]  # X_p
        q, i = flock.streams.normal(len(slots), 1), slots[:, None] + 1
        signs = np.where(flock.streams.uniform(*x.shape[1:]) < 0.5, -1.0, 1.0)  # A
        step = np.abs(x - leader) * signs
        if self.step == "matrix":  # A⁺ = Aᵀ(AAᵀ)⁻¹ = Aᵀ/d; L spreads the sum over all dimensions
            step = added(step)[..., None] / x.shape[-1]
        with np.errstate(over="ignore"):  # in a box hundreds wide: the walls stop it
            away = q * np.exp((worst - x) / i**2)
        return slots, [np.where(i > self.population / 2, away, leader + step)]

    def _watch(self, flock: Flock) -> tuple[Slots, list[Array]]:
        """Eq. 41."""
        slots: Slots = np.arange(self._count(self.vigilantes))
        if self.watch == "random":
            slots = flock.streams.uniform(self.population).argsort(axis=1)[:, : len(slots)]
        (x, f), (worst_x, worst_f) = flock.place(slots), flock.worst()
        beta, k = flock.streams.normal(*x.shape[1:]), 2 * flock.streams.uniform(x.shape[1], 1) - 1
        fall = f - worst_f if self.eq41 == "intended" else (f > worst_f).astype(float)
        flee = x + k * (np.abs(x - worst_x) / (fall + _EPSILON)[..., None])
        home = flock.best_x + beta * np.abs(x - flock.best_x)
        return slots, [np.where((f > flock.best_f)[..., None], home, flee)]

    def _moved(self, flock: Flock, slots: Slots, places: list[Array]) -> Search:
        """Evaluate the places that some sparrows consider; each takes its best, if acceptable."""
        x, f = [self._inside(flock, slots, place) for place in places], []
        for place in x:
            f.append((yield place))
        winner = np.argmin(f, axis=0)[None, ..., None]
        best_x = np.take_along_axis(np.stack(x), winner, axis=0)[0]
        flock.move(slots, best_x, np.min(f, axis=0), self.acceptance == "greedy")

    def _inside(self, flock: Flock, slots: Slots, x: Array) -> Array:
        x = flock.box.clip(x) if self.boundary == "clip" else flock.box.reflect(x)
        return np.where(np.isnan(x), flock.place(slots)[0], x)

    def _count(self, share: float) -> int:
        return round(share * self.population)
