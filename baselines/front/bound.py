"""Prove a lower bound on the smoothness integral at a duration, over all segment times.

The segment times that add up to a duration form a simplex. It is bisected until every part's lower
bound (`dual.py`) is close to the best motion found. Parts without active limits need the equations
alone. The others get the limits that the best motion and some near it use. A bound may leave out
waypoints: without them the smoothest motion is at least as smooth.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from itertools import combinations, pairwise, permutations, product

import numpy as np

from baselines.front.dual import (
    SmoothnessConstraints,
    best_costates,
    exponents,
    free_bounds,
    linear_bounds,
    scaled_costates,
)
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.limits import LIMIT_ORDERS
from trajopt.core.problem import Problem
from trajopt.judging.smoothness import weights

# Largest number of segments of the problem that is bounded.
MAX_SEGMENTS = 4
# Parts of each segment at whose ends, or on whose mean, limits may be imposed. Their shares are
# multiples of a power of two, so they are exact.
_INSTANTS = 32
SHORTEST_EDGE = 1e-4  # smaller simplices, relative to the segment times, are not halved
# Share of the way to the target up to which simplices are halved with the one of the least bound.
_NEAREST = 0.3
_BATCH = 64
# A bound this close to the value at the simplex's centre hardly rises in its parts, relative.
_STUCK_RTOL = 0.02
# Largest number of choices of waypoints that are compared.
_MAX_CHOICES = 170
# Simplices whose centre is worse than this, relative to the best value, need no limits.
_NEAR_RTOL = 0.05
# Stands for no limit: no motion comes near it, so that no best costate uses it.
_NO_LIMIT = 1e30
# Largest share of the duration that the shortest times of all segments take together.
_MOST = 1 - 1e-6
_LEAF_FREE, _LEAF_LIMITS = -1, -2


@dataclass(frozen=True, eq=False)
class FrontProof:
    """A proof that no motion of a duration has a smaller integral; arrays of floats, as stored.

    Attributes:
        kept: The waypoints that are kept, by index, `(K + 1,)`.
        order: 3 for jerk, 2 for acceleration, `(1,)`.
        duration: s, `(1,)`. It is 0 for a bound without limits: that of 1 s, to be divided by the
            fifth (for acceleration, third) power of any duration.
        shortest: Shortest time of each segment, s, `(K,)`: the simplex holds all longer times.
        limits: For each inequality: order of the derivative, segment, and the two shares of the
            segment between which the mean is limited, equal for an instant, `(rows, 4)`.
        steps: The tree of simplices, each before its parts, `(steps, 2)`. For a simplex that is
            halved: the two corners of the halved edge; the part without the first one follows
            first. −1 for a part that is bounded by the equations alone, −2 for one with costates.
        costates: The costates that are not 0, `(costates, 3 + K)`: number of the part among those
            with costates, row, joint among those that move, values at the part's corners. Units
            are the duration and radians or metres.
    """

    kept: Array
    order: Array
    duration: Array
    shortest: Array
    limits: Array
    steps: Array
    costates: Array


@dataclass(frozen=True, eq=False)
class FrontBound:
    """A proved lower bound on the smoothness integral, over all segment times.

    Attributes:
        lower: No motion of the duration has a smaller integral; rounding is subtracted.
        simplices: Number of simplices that were bounded.
        closed: Whether the bound is as close to the best motion as was asked for.
        proof: What `trajopt.judging.check_front` checks.
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
    used = [np.zeros(rows.low.shape, dtype=bool)]
    shortest = np.zeros(rows.segments)
    if times is not None and duration is not None:
        used = [_in_use(rows, times / times.sum(), own) for own in _choices(rows)]
        shortest = shortest_times(problem, kept)
        shortest *= min(1.0, _MOST * duration / shortest.sum())
    for own in used:
        own[: rows.equations] = True
    keep = np.flatnonzero(np.any(used, axis=(0, 2)))
    rows = rows.only(keep)
    share = shortest / unit
    start = share + (1 - share.sum()) * np.eye(rows.segments)
    search = _SimplexSearch(rows, target * (1 - within), start, [own[keep] for own in used])
    while search.may_improve and time.process_time() < deadline:
        search.step(target)
    limits = rows.only(np.arange(rows.equations, len(rows.power)))
    derivative = order - 1.0 - limits.power + (limits.width > 0)
    proof = FrontProof(
        kept=kept.astype(float),
        order=np.array([float(order)]),
        duration=np.array([duration or 0.0]),
        shortest=shortest,
        limits=np.stack([derivative, limits.segment, limits.since, limits.share], axis=-1),
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
    kinds = [(order - 1, k, 1.0, 1.0, way[k + 1], way[k + 1]) for k in range(segments)]
    kinds += [(order - 1 - d, segments - 1, 1.0, 1.0, still, still) for d in range(1, order)]
    unit = duration or 1.0
    tables = problem.limits.by_name()
    tables["position"] = tables["position"] - problem.waypoints[0][:, None]
    instants = np.arange(_INSTANTS + 1) / _INSTANTS
    for name, of in LIMIT_ORDERS.items() if duration else ():
        if of > order:
            continue
        sides = np.clip(tables[name][moving].T * scale * unit**of, -_NO_LIMIT, _NO_LIMIT)
        if (np.abs(sides) == _NO_LIMIT).all():
            continue
        mean = of % 2 == 1 or of == order
        for k, (since, share) in product(range(segments), pairwise(instants)):
            if mean:
                kinds.append((order - of, k, share, since, *sides))
            elif share < 1:
                kinds.append((order - 1 - of, k, share, share, *sides))
            elif of == 2 and k < segments - 1:
                kinds.append((0, k, share, share, *sides))
            if of == 2 and order == 3:
                kinds.append((1, k, share, since, *sides))
    power, segment, share, since, low, high = (
        np.array(column) for column in zip(*kinds, strict=True)
    )
    rows = SmoothnessConstraints(order, segments, power, segment, share, since, low, high)
    return rows, scale


def _choices(rows: SmoothnessConstraints) -> list[Bools]:
    """Return which rows bound simplices together, `(rows,)` each, in the order to try them.

    Accelerations are limited at instants, which gives good bounds of wide simplices, or their means
    between instants are: between two instants at its limit an acceleration may exceed it, so the
    bounds of small simplices are better by these.
    """
    changes = rows.width > 0
    if rows.order == 2:
        return [np.ones(len(changes), dtype=bool)]
    return [~(changes & (rows.power == 1)), changes | (rows.power > 0)]


def _in_use(rows: SmoothnessConstraints, times: Array, chosen: Bools) -> Bools:
    """Return which chosen rows the best costates use at or near these times, `(rows, joints)`."""
    near = [times]
    for k, other in permutations(range(len(times)), 2):
        moved = times.copy()
        step = 0.12 * min(times[k], times[other])
        moved[k] += step
        moved[other] -= step
        near.append(moved)
    chosen = np.repeat(chosen[:, None], rows.low.shape[1], axis=1)
    costates, values = best_costates(rows, np.array(near), used=chosen)
    size = np.abs(costates) * np.maximum(np.abs(rows.low), np.abs(rows.high))
    size *= rows.lengths(np.array(near))[..., None]
    used: Bools = (size / values[:, None, None]).max(axis=0) > 1e-4
    used[: rows.equations] = True
    return used


def shortest_times(problem: Problem, kept: Indices) -> Array:
    """Return times that no segment is shorter than, s, `(K,)`.

    A joint keeps its velocity limit, and its acceleration limit from and to rest.
    """
    moving = problem.moving
    way = np.diff(problem.waypoints[kept][:, moving], axis=0)
    sign = np.sign(way)
    velocity, acceleration, braking = (
        np.where(way > 0, own[moving, 1], -own[moving, 0])
        for own in (
            problem.limits.velocity,
            problem.limits.acceleration,
            -problem.limits.acceleration[:, ::-1],
        )
    )
    way = way * sign
    found = way / velocity
    for k, rate in ((0, acceleration), (-1, braking)):
        ramp = velocity[k] ** 2 / (2 * rate[k])
        slow = way[k] / velocity[k] + velocity[k] / (2 * rate[k])
        found[k] = np.maximum(
            found[k], np.where(way[k] > ramp, slow, np.sqrt(2 * way[k] / rate[k]))
        )
    shortest: Array = found.max(axis=1) * (1 - 1e-9)
    return shortest


@dataclass(eq=False)
class _SimplexSearch:
    """Simplices of segment times: a tree whose leaves are bounded.

    Attributes:
        rows: Those that may be used.
        target: A leaf with this bound is closed.
        start: The corners of all segment times, `(K, K)`.
        used: Which of the rows each joint may use, `(rows, joints)`: for simplices that the first
            such choice cannot bound well there are others.
        choices: The choice with which each simplex is first bounded.
    """

    rows: SmoothnessConstraints
    target: float
    start: Array
    used: list[Bools]
    choices: list[int] = field(default_factory=list)
    corners: list[Array] = field(default_factory=list)
    bounds: list[float] = field(default_factory=list)
    leaves: list[Array | None] = field(default_factory=list)
    splits: dict[int, tuple[int, int, int, int]] = field(default_factory=dict)
    open_simplices: list[int] = field(default_factory=list)
    least_left: float = np.inf  # bound of a simplex that is too small to be halved

    def __post_init__(self) -> None:
        self._add(self.start[None], self.target, np.zeros(1, dtype=int))

    def _add(self, corners: Array, near: float, choice: Indices) -> list[int]:
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
        for number, used in enumerate(self.used):
            own = wanting[choice[wanting] == number]
            if not len(own):
                continue
            found, values = self._best_at_corners(corners[own], used)
            better = linear_bounds(self.rows, corners[own], found)
            for place, bound, y in zip(own, better, found, strict=True):
                if bound > low[place]:
                    low[place] = bound
                    costates[place] = y
            stuck = (better < self.target) & (better > (1 - _STUCK_RTOL) * values)
            choice[own[stuck]] = min(number + 1, len(self.used) - 1)
        first = len(self.bounds)
        self.corners += list(corners)
        self.bounds += low.tolist()
        self.leaves += costates
        self.choices += choice.tolist()
        added = list(range(first, len(self.bounds)))
        self.open_simplices += [k for k in added if self.bounds[k] < self.target]
        return added

    def _best_at_corners(self, corners: Array, used: Bools) -> tuple[Array, Array]:
        """Return the best costates at corners with the limits of the centre, and values there."""
        centre, values = best_costates(self.rows, corners.mean(axis=1), used=used)
        times = corners.reshape(-1, corners.shape[-1])
        like = np.repeat(centre, corners.shape[1], axis=0)
        found, _ = best_costates(self.rows, times, like=like)
        found = scaled_costates(self.rows, found, times)
        return found.reshape(*corners.shape[:2], *found.shape[1:]), values

    @property
    def may_improve(self) -> bool:
        """Return whether the least bound may rise: it is one of a simplex that can be halved."""
        least = min((self.bounds[k] for k in self.open_simplices), default=np.inf)
        return least < self.least_left

    def step(self, near: float) -> None:
        """Halve the longest edge, relative to the segment times, of the simplices with least bound.

        A simplex whose edges are all short is left as it is, since its bound would hardly change.
        """
        if self.rows.segments == 1:
            self.open_simplices.clear()
            return
        self.open_simplices.sort(key=self.bounds.__getitem__)
        # those far above the least may never count: it may be that of a simplex that is left
        least = self.bounds[self.open_simplices[0]]
        most = least + _NEAREST * (self.target - least)
        count = sum(self.bounds[k] <= most for k in self.open_simplices[:_BATCH])
        worst = self.open_simplices[:count]
        self.open_simplices = self.open_simplices[count:]
        corners = np.array([self.corners[k] for k in worst])
        count = corners.shape[1]
        edges = np.abs(corners[:, :, None] - corners[:, None])
        lengths = (edges / corners.mean(axis=1)[:, None, None]).sum(-1)
        longest = lengths.reshape(len(corners), -1).argmax(axis=1)
        i, j = np.divmod(longest, count)
        wide = lengths[np.arange(len(corners)), i, j] > SHORTEST_EDGE
        left = [self.bounds[k] for k, one in zip(worst, wide, strict=True) if not one]
        self.least_left = min([self.least_left, *left])
        worst = [k for k, one in zip(worst, wide, strict=True) if one]
        if not worst:
            return
        corners, i, j = corners[wide], i[wide], j[wide]
        each = np.arange(len(corners))
        middle = 0.5 * (corners[each, i] + corners[each, j])
        first, second = corners.copy(), corners.copy()
        first[each, i] = middle
        second[each, j] = middle
        choice = np.array([self.choices[k] for k in worst])
        added = self._add(np.concatenate([first, second]), near, np.tile(choice, 2))
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
        own = np.array([y / scale for y in leaves if y is not None])
        if not len(own):
            return np.zeros((0, 3 + self.rows.segments))
        places = np.argwhere((own != 0).any(axis=1))
        leaf, row, joint = places.T
        return np.column_stack([places, own[leaf, :, row, joint]])
