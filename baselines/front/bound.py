"""Prove a lower bound on the smoothness integral at a duration, over all segment times.

The segment times that add up to a duration form a simplex. It is bisected until every part's lower
bound (`dual.py`) is close to the best motion found. Parts without active limits need the equations
alone. The others get the limits that the best motion and some near it use. A bound may leave out
waypoints: without them the smoothest motion is at least as smooth.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import combinations, permutations
from typing import Any

import numpy as np

from baselines.front.dual import (
    SmoothnessConstraints,
    best_costates,
    exponents,
    free_bounds,
    linear_bounds,
)
from trajopt.core.arrays import Array, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.judging.smoothness import weights

# Largest number of segments of the problem that is bounded.
MAX_SEGMENTS = 3
# Instants of each segment at which limits may be imposed. Their shares are multiples of a power of
# two, so they are exact.
_INSTANTS = 32
SHORTEST_EDGE = 1e-4  # smaller simplices, relative to the segment times, are not halved
_BATCH = 64
# Largest number of choices of waypoints that are compared.
_MAX_CHOICES = 60
# Simplices whose centre is worse than this, relative to the best value, need no limits.
_NEAR_RTOL = 0.05
# Costates whose bound exceeds this multiple of the target are scaled down to it.
_ENOUGH = 1.5
# Weight of the simplex's centre in the points at which costates are computed.
_INWARDS = 0.1
_PREFIX = "front_"
_LEAF_FREE, _LEAF_LIMITS = -1, -2


@dataclass(frozen=True, eq=False)
class FrontProof:
    """A proof that no motion of a duration has a smaller integral; arrays of floats, as stored.

    Attributes:
        kept: The waypoints that are kept, by index, `(K + 1,)`.
        order: 3 for jerk, 2 for acceleration, `(1,)`.
        duration: s, `(1,)`. It is 0 for a bound without limits: that of 1 s, to be divided by the
            fifth (for acceleration, third) power of any duration.
        limits: For each inequality: order of the derivative, segment, share of the segment at
            which it is imposed, `(rows, 3)`.
        steps: The tree of simplices, each before its parts, `(steps, 2)`. For a simplex that is
            halved: the two corners of the halved edge; the part without the first one follows
            first. −1 for a part that is bounded by the equations alone, −2 for one with costates.
        costates: The costates that are not 0, `(costates, 5)`: number of the part among those with
            costates, corner, row, joint among those that move, value. Units are the duration and
            radians or metres.
    """

    kept: Array
    order: Array
    duration: Array
    limits: Array
    steps: Array
    costates: Array

    def arrays(self) -> dict[str, Array]:
        """Return the arrays by the names under which a solution's `stats` keep them."""
        return {f"{_PREFIX}{name}": value for name, value in vars(self).items()}

    @classmethod
    def stored(cls, stats: Mapping[str, Any]) -> FrontProof | None:
        """Return the proof among a solution's `stats`; None if there is none.

        Raises:
            InvalidInput: A part of it is missing or is no table of finite numbers.
        """
        own = {k.removeprefix(_PREFIX): v for k, v in stats.items() if k.startswith(_PREFIX)}
        if not own:
            return None
        names = cls.__dataclass_fields__.keys()
        if own.keys() != names:
            raise InvalidInput("front proof", f"the arrays {', '.join(names)}", value=list(own))
        tables = {name: np.asarray(value, dtype=float) for name, value in own.items()}
        if not all(np.isfinite(table).all() for table in tables.values()):
            raise InvalidInput("front proof", "finite numbers")
        return cls(**tables)


@dataclass(frozen=True, eq=False)
class FrontBound:
    """A proved lower bound on the smoothness integral, over all segment times.

    Attributes:
        lower: No motion of the duration has a smaller integral.
        simplices: Number of simplices that were bounded.
        closed: Whether the bound is as close to the best motion as was asked for.
        proof: The proof, for `proved` to check.
    """

    lower: float
    simplices: int
    closed: bool
    proof: FrontProof


def prove(
    problem: Problem,
    order: int,
    duration: float | None,
    value: float,
    *,
    within: float,
    deadline: float,
    times: Array | None = None,
    kept: Indices | None = None,
) -> FrontBound:
    """Search for a proof that no motion of the duration has a smaller integral.

    Args:
        problem: Without repeated waypoints.
        order: 3 for jerk, 2 for acceleration.
        duration: s; None for 1 s without limits, whose bound gives that of any duration.
        value: The integral of the best motion known.
        within: Relative gap to `value` at which to stop.
        deadline: When to stop, by `time.process_time()`.
        times: Segment times of the best motion, relative. They determine the limits that are used;
            without them no limit is.
        kept: Indices of the waypoints to keep; by default all. `value` and `times` belong to the
            problem of these waypoints.
    """
    if kept is None:
        kept = np.arange(len(problem.waypoints))
    unit = duration or 1.0
    rows, s = problem_rows(problem, kept, order, duration)
    target = value * unit ** (2 * order - 1)
    full = rows.only(np.arange(rows.equations))
    if times is not None and duration is not None:
        full = _in_use(rows, times / times.sum())
    search = _SimplexSearch(full, target * (1 - within))
    while search.open_simplices and time.process_time() < deadline:
        search.step(target)
    limits = full.only(np.arange(full.equations, len(full.power)))
    proof = FrontProof(
        kept=kept.astype(float),
        order=np.array([float(order)]),
        duration=np.array([duration or 0.0]),
        limits=np.stack([order - 1.0 - limits.power, limits.segment, limits.share], axis=-1),
        steps=search.steps(),
        costates=search.costates(s),
    )
    lower = search.lower() / unit ** (2 * order - 1)
    return FrontBound(max(lower, 0.0), len(search.bounds), search.lower() >= search.target, proof)


def chosen_waypoints(problem: Problem, order: int) -> Indices:
    """Return the waypoints that the bound keeps: all, or the four with the largest integral."""
    count = len(problem.waypoints)
    if count <= MAX_SEGMENTS + 1:
        return np.arange(count)
    inner = np.unique(np.linspace(1, count - 2, min(count - 2, 11)).round().astype(int))
    choices = list(combinations(inner.tolist(), MAX_SEGMENTS - 1))[:_MAX_CHOICES]
    best, chosen = -np.inf, np.arange(count)
    grid = exponents(MAX_SEGMENTS, 12) / 12
    grid = grid[grid.min(axis=1) > 0]
    for choice in choices:
        kept = np.array([0, *choice, count - 1])
        rows, _ = problem_rows(problem, kept, order, None)
        equations = rows.only(np.arange(rows.equations))
        least = best_costates(equations, grid)[1].min()
        if least > best:
            best, chosen = least, kept
    return chosen


def problem_rows(
    problem: Problem, kept: Indices, order: int, duration: float | None
) -> tuple[SmoothnessConstraints, Array]:
    """Return all rows of a problem in units of the duration, and the joints' scale.

    Each joint is multiplied by the root of its weight (`trajopt.judging.smoothness.weights`).
    """
    moving = problem.moving
    scale = np.sqrt(weights(problem)[moving])
    way = (problem.waypoints[kept] - problem.waypoints[0])[:, moving] * scale
    segments = len(kept) - 1
    still = np.zeros(way.shape[1])
    kinds = [(order - 1, k, 1.0, way[k + 1], way[k + 1]) for k in range(segments)]
    kinds += [(order - 1 - d, segments - 1, 1.0, still, still) for d in range(1, order)]
    unit = duration or 1.0
    velocity = problem.limits.velocity[moving].T * unit * scale
    acceleration = problem.limits.acceleration[moving].T * unit**2 * scale
    instants = np.arange(1, _INSTANTS + 1) / _INSTANTS
    for k in range(segments if duration else 0):
        for share in instants[: _INSTANTS - (k == segments - 1)]:
            kinds.append((order - 2, k, share, *velocity))
            if order == 3:  # otherwise acceleration is the integrand
                kinds.append((0, k, share, *acceleration))
    power, segment, share, low, high = (np.array(column) for column in zip(*kinds, strict=True))
    return SmoothnessConstraints(order, segments, power, segment, share, low, high), scale


def _in_use(rows: SmoothnessConstraints, times: Array) -> SmoothnessConstraints:
    """Return the inequalities that the best costates use at these times and at times near them."""
    near = [times]
    for k, other in permutations(range(len(times)), 2):
        moved = times.copy()
        step = 0.12 * min(times[k], times[other])
        moved[k] += step
        moved[other] -= step
        near.append(moved)
    costates, values = best_costates(rows, np.array(near))
    size = np.abs(costates) * np.maximum(np.abs(rows.low), np.abs(rows.high))
    largest = (size / values[:, None, None]).max(axis=(0, 2))
    largest[: rows.equations] = np.inf
    return rows.only(np.flatnonzero(largest > 1e-4))


def _tamed(costates: Array, values: Array, enough: float) -> Array:
    """Return costates, scaled down where their bound is more than `enough`, so that it is `enough`.

    At times that are hardly possible the best costates are huge and differ much from corner to
    corner, so a linear interpolation between corners proves little. Costates scaled by `t` have
    `(2 t − t²)` times the bound.
    """
    share = np.minimum(1.0, enough / np.maximum(values, enough))
    scale: Array = 1 - np.sqrt(1 - share)
    return costates * scale[:, None, None]


@dataclass(eq=False)
class _SimplexSearch:
    """Simplices of segment times: a tree whose leaves are bounded.

    Attributes:
        rows: The equations and inequalities that may be used.
        target: A leaf with this bound needs no further halving.
    """

    rows: SmoothnessConstraints
    target: float
    corners: list[Array] = field(default_factory=list)
    bounds: list[float] = field(default_factory=list)
    leaves: list[Array | None] = field(default_factory=list)
    splits: dict[int, tuple[int, int, int, int]] = field(default_factory=dict)
    open_simplices: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._add(np.eye(self.rows.segments)[None], self.target)

    def _add(self, corners: Array, near: float) -> list[int]:
        """Bound simplices, with limits where the equations alone do not reach the target."""
        low = free_bounds(self.rows, corners)
        costates: list[Array | None] = [None] * len(corners)
        wanting = np.flatnonzero(low < self.target)
        if len(self.rows.power) > self.rows.equations and len(wanting):
            centres = corners[wanting].mean(axis=1)
            equations = self.rows.only(np.arange(self.rows.equations))
            values = best_costates(equations, np.maximum(centres, 1e-9))[1]
            wanting = wanting[values < (1 + _NEAR_RTOL) * near]
        else:
            wanting = wanting[:0]
        if len(wanting):
            own = corners[wanting]
            shape = own.shape
            inner = (1 - _INWARDS) * own + _INWARDS * own.mean(axis=1, keepdims=True)
            found, values = best_costates(self.rows, inner.reshape(-1, shape[-1]))
            found = _tamed(found, values, _ENOUGH * self.target)
            found = found.reshape(*shape[:2], *found.shape[1:])
            better = linear_bounds(self.rows, own, found)
            for place, bound, y in zip(wanting, better, found, strict=True):
                if bound > low[place]:
                    low[place] = bound
                    costates[place] = y
        first = len(self.bounds)
        self.corners += list(corners)
        self.bounds += low.tolist()
        self.leaves += costates
        added = list(range(first, len(self.bounds)))
        self.open_simplices += [k for k in added if self.bounds[k] < self.target]
        return added

    def step(self, near: float) -> None:
        """Halve the longest edge, relative to the segment times, of the simplices with least bound.

        A simplex whose edges are all short is left as it is, since its bound would hardly change.
        """
        if self.rows.segments == 1:
            self.open_simplices.clear()
            return
        self.open_simplices.sort(key=self.bounds.__getitem__)
        worst = self.open_simplices[:_BATCH]
        self.open_simplices = self.open_simplices[_BATCH:]
        corners = np.array([self.corners[k] for k in worst])
        count = corners.shape[1]
        edges = np.abs(corners[:, :, None] - corners[:, None])
        lengths = (edges / corners.mean(axis=1)[:, None, None]).sum(-1)
        longest = lengths.reshape(len(corners), -1).argmax(axis=1)
        i, j = np.divmod(longest, count)
        wide = lengths[np.arange(len(corners)), i, j] > SHORTEST_EDGE
        worst = [k for k, one in zip(worst, wide, strict=True) if one]
        if not worst:
            return
        corners, i, j = corners[wide], i[wide], j[wide]
        each = np.arange(len(corners))
        middle = 0.5 * (corners[each, i] + corners[each, j])
        first, second = corners.copy(), corners.copy()
        first[each, i] = middle
        second[each, j] = middle
        added = self._add(np.concatenate([first, second]), near)
        for place, parent in enumerate(worst):
            parts = added[place], added[place + len(worst)]
            self.splits[parent] = (int(i[place]), int(j[place]), *parts)

    def lower(self) -> float:
        """Return the least bound of all leaves."""
        return min(bound for k, bound in enumerate(self.bounds) if k not in self.splits)

    def _walk(self) -> list[int]:
        """Yield all simplices, each before its parts."""
        order, waiting = [], [0]
        while waiting:
            k = waiting.pop()
            order.append(k)
            if k in self.splits:
                _, _, first, second = self.splits[k]
                waiting += [second, first]
        return order

    def steps(self) -> Array:
        """Return the tree in the form of `FrontProof.steps`."""
        found = []
        for k in self._walk():
            if k in self.splits:
                found.append(self.splits[k][:2])
            else:
                kind = _LEAF_FREE if self.leaves[k] is None else _LEAF_LIMITS
                found.append((kind, kind))
        return np.array(found, dtype=float)

    def costates(self, scale: Array) -> Array:
        """Return the costates in the form of `FrontProof.costates`, without the joints' weights."""
        leaves = [self.leaves[k] for k in self._walk() if k not in self.splits]
        own = [y / scale for y in leaves if y is not None]
        if not own:
            return np.zeros((0, 5))
        places = np.argwhere(np.array(own))
        values = np.array(own)[tuple(places.T)]
        return np.column_stack([places, values])
