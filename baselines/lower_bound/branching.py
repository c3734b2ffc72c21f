"""Prove that no motion is briefer than a cut-off, by branching on segment times.

The relaxation's linear program gets rows of costates where its answers break them, until none is
broken. What it then says of single variables, given the cut-off, narrows the box; where that ends,
the box is split. Every bound that is used is the one that `dual_check` computes from the program's
multipliers, so that the steps taken here are the proof.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound import dual_check, extremal
from baselines.lower_bound.costates import Cut
from baselines.lower_bound.dual_check import Proof
from baselines.lower_bound.linear import Answer
from baselines.lower_bound.relaxation import Box, Relaxation
from baselines.lower_bound.row_pool import RowPool
from baselines.lower_bound.separation import Separation
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import backend

Array = NDArray[np.float64]

# Rounds of rows for the total time, at the root and below, and for a single variable.
_ROOT_ROUNDS = 60
_NODE_ROUNDS = 6
_VARIABLE_ROUNDS = 4
# Sweeps over all segment times (and accelerations) of a node.
_ROOT_SWEEPS = 12
_NODE_SWEEPS = 3
# A bound that moves a side of the box by less than this share of its width is not worth a step.
_WORTHWHILE_SHARE = 0.02
# Of a box's width: how far a side is moved less than is proved.
_ROUNDING_SHARE = 1e-4
# Sweeps go on while they narrow the box's times by this share.
_SWEEP_SHARE = 0.05
# Of the gap that is asked for: how far the cut-off lies above the target.
_ROOM_SHARE = 0.5
_LONGER_CUTOFF = 1.25
# Of the gap that is asked for: what a row must be broken by, at the end and to begin with.
_TOLERANCE_SHARE = 0.1
_COARSE_TOLERANCE = 1e-3
_FINEST_TOLERANCE = 1e-8
# Rounds go on while they raise the bound by this share of what is missing.
_PROGRESS_SHARE = 0.01
# Splits that raise the lowest bound by less than that share, after which the search stands still.
_IDLE_SPLITS = 24
# The first of a box's rows.
_CUTOFF_ROW = 0
# A ray, scaled so that it proves the cut-off this many times over.
_RAY_FACTOR = 4.0
# A box is split no closer to its sides than this share of its width.
_MARGIN_SHARE = 0.2
_TANGENT_RTOL = 1e-9
# A point so close to the relaxation's curves is on them.
_CURVE_RTOL = 1e-7
# A row of cost 1 that a motion meets within this is active.
_ACTIVE_TOLERANCE = 1e-6
_START_TANGENTS = 5


class _Step(NamedTuple):
    kind: int
    variable: int
    value: float
    rows: NDArray[np.intp]
    multipliers: Array


@dataclass
class _Node:
    """A part of the tree: its box, the steps that narrowed it, and what is proved in it."""

    box: Box
    bound: float
    steps: list[_Step] = field(default_factory=list)
    leaf: _Step | None = None
    children: tuple[_Node, ...] = ()
    # a point of the relaxation's own curves and of every row is as brief as the bound
    settled: bool = False


class Outcome(NamedTuple):
    """A lower bound, s, with its proof; how many boxes were split, and linear programs solved."""

    lower_bound: float
    proof: Proof
    splits: int
    programs: int


def prove(
    problem: Problem,
    target: float,
    gap: float,
    deadline: float,
    motion: Trajectory | None = None,
) -> Outcome:
    """Prove that no motion is briefer than the target, or as much of it as there is time for.

    Args:
        problem: Without identical consecutive waypoints; all its limits count.
        target: s. It need not be true: the answer is then below it.
        gap: Relative, between the target and the fastest motion known: sets the tolerances.
        deadline: Of `time.perf_counter`.
        motion: Whose own costates are the first rows: near the optimum's they prove most of it.

    Raises:
        MissingBackend: HiGHS is not installed.
        TrajoptError: HiGHS breaks down.
    """
    solver = backend("highspy")
    # half of the gap is room for rows that are broken by less than the tolerance
    cutoff = target * (1 + _ROOM_SHARE * gap)
    relaxation = Relaxation.of(problem, cutoff)
    # below what a single segment takes there is no motion to ask about
    while dual_check.is_empty(relaxation.root_box()):
        cutoff *= _LONGER_CUTOFF
        relaxation = Relaxation.of(problem, cutoff)
    search = _Search(relaxation, solver, gap, deadline)
    if motion is not None:
        search.add_active(relaxation.at(problem, motion))
    try:
        root = search.run()
    except TrajoptError:
        if motion is None:
            raise
        # HiGHS has broken down on the motion's rows
        return prove(problem, target, gap, deadline)
    proof = search.proof(root)
    lower_bound = dual_check.proved_bound(problem, proof)
    return Outcome(lower_bound, proof, search.splits, search.pool.programs)


class _Search:
    """The linear program with all rows found so far, and the tree."""

    def __init__(
        self,
        relaxation: Relaxation,
        solver: Any,
        gap: float,
        deadline: float,
    ) -> None:
        self.relaxation = relaxation
        self.deadline = deadline
        self.target = relaxation.cutoff / (1 + _ROOM_SHARE * gap)
        self.finest = max(_TOLERANCE_SHARE * gap, _FINEST_TOLERANCE)
        self.total = relaxation.total()
        self.splits = 0
        box = relaxation.root_box()
        self.pool = RowPool(relaxation, solver, box)
        self.separations: dict[tuple[int, int], Separation] = {}
        for k, j in np.ndindex(relaxation.segments, relaxation.joints):
            walls = (relaxation.below[k, j], relaxation.above[k, j])
            if np.isfinite(walls).any():
                self.separations[k, j] = Separation(relaxation, k, j, solver)
        self._first_tangents(box)

    @property
    def late(self) -> bool:
        return time.perf_counter() > self.deadline

    def run(self) -> _Node:
        """The tree, as far as there was time for it, or as HiGHS got."""
        root = _Node(self.relaxation.root_box(), 0.0)
        try:
            self._grow(root)
        except TrajoptError:
            # HiGHS has broken down: what was proved until then is the answer
            if root.leaf is None:
                raise
        return root

    def _grow(self, root: _Node) -> None:
        """Treat and split boxes, that of the lowest bound first, until the search stands still."""
        order = itertools.count()
        self._narrow_by_cutoff(root)
        self._treat(root, _ROOT_ROUNDS, _ROOT_SWEEPS)
        pending = [(root.bound, next(order), root)]
        best = root.bound
        idle_splits = 0
        while pending and not self.late and idle_splits < _IDLE_SPLITS:
            bound, _, node = heapq.heappop(pending)
            if bound >= self.target or node.settled:
                break
            idle_splits += 1
            if bound - best > _PROGRESS_SHARE * (self.target - best):
                best = bound
                idle_splits = 0
            self._split(node)
            for child in node.children:
                self._treat(child, _NODE_ROUNDS, _NODE_SWEEPS)
                heapq.heappush(pending, (child.bound, next(order), child))

    # --- a node ---

    def _treat(self, node: _Node, rounds: int, sweeps: int) -> None:
        """Bound the time in a box, and narrow the box while that pays."""
        self._bound_total(node, rounds)
        for sweep in range(sweeps):
            if node.bound >= self.target or self.late:
                return
            before = self._widths(node.box).sum()
            self._sweep(node, with_accelerations=sweep > 0 or rounds == _NODE_ROUNDS)
            if dual_check.is_empty(node.box):
                return
            self._bound_total(node, rounds)
            after = self._widths(node.box).sum()
            if after > (1 - _SWEEP_SHARE) * before:
                return

    def _widths(self, box: Box) -> Array:
        times = self.relaxation.time
        return np.asarray(box.high[times] - box.low[times])

    def _bound_total(self, node: _Node, rounds: int) -> None:
        """The least total time in a box, with rows added until none is broken."""
        self.pool.enter(node.box)
        if node.leaf is not None:
            self.pool.hold(node.leaf.rows)
        tolerance = max(self.finest, _COARSE_TOLERANCE)
        before = -np.inf
        for _ in range(rounds):
            answer = self.pool.minimised(self.total)
            self._prove_leaf(node, answer)
            missing = self.target - node.bound
            if missing <= 0 or answer.x is None or self.late:
                return
            added = self._separate(answer.x, tolerance)
            slow = answer.value - before < _PROGRESS_SHARE * missing
            before = answer.value
            if added and not slow:
                continue
            if not added and tolerance <= _FINEST_TOLERANCE:
                node.settled = self._is_on_curves(answer.x)
            if not added:
                # no row is broken by more, and the target is missed: what is broken by less counts
                self.finest = max(_FINEST_TOLERANCE, self.finest / 10)
            if tolerance <= self.finest and (slow or not added):
                return
            tolerance = max(self.finest, tolerance / 10)

    def _prove_leaf(self, node: _Node, answer: Answer) -> None:
        """What an answer's multipliers prove of the total time, if it is more than before."""
        multipliers = answer.multipliers
        if answer.x is None:
            multipliers = self._scaled_ray(node.box, multipliers)
        step, bound = self._step(
            dual_check.LEAF,
            0,
            self.total,
            node.box,
            multipliers,
        )
        if node.leaf is None or bound > node.bound:
            node.leaf = step
            node.bound = max(node.bound, bound)

    def _scaled_ray(self, box: Box, ray: Array) -> Array:
        """Multipliers that prove the target where no point meets the rows.

        A ray that uses the cut-off's row `Σ T ≤ U` says of the others alone, divided by that row's
        multiplier, that `Σ T > U`. These multipliers are of moderate size, so that they can be
        rounded. One that does without the cut-off is made so long that it proves more than that.
        """
        of_cutoff = ray[_CUTOFF_ROW]
        if of_cutoff > 0:
            others = np.asarray(ray / of_cutoff)
            others[_CUTOFF_ROW] = 0.0
            if self._proved(self.total, box, others) >= self.target:
                return others
        nothing = np.zeros_like(self.total)
        proved = self._proved(nothing, box, ray)
        if proved <= 0:
            return ray
        longer = _RAY_FACTOR * self.relaxation.cutoff / proved
        return np.asarray(ray * longer)

    def _proved(self, objective: Array, box: Box, multipliers: Array) -> float:
        return self.pool.proved(objective, box, multipliers).bound

    def _narrow_by_cutoff(self, node: _Node) -> None:
        """No segment takes longer than the cut-off leaves when all others are briefest."""
        rows = np.array([_CUTOFF_ROW])
        cutoff_row = self.pool.box_rows.chosen(rows)
        one = np.ones(1)
        for column in self.relaxation.time.tolist():
            objective = np.zeros_like(self.total)
            objective[column] = -1.0
            bound = dual_check.dual_bound(objective, node.box, cutoff_row, one)
            if bound <= _side(node.box, column, raises=False):
                continue
            node.steps.append(_Step(dual_check.LOWER, column, 0.0, rows, one))
            node.box = dual_check.moved(
                self.relaxation,
                node.box,
                column,
                raises=False,
                bound=bound,
            )

    def _sweep(self, node: _Node, with_accelerations: bool) -> None:
        """Move both sides of the box's times (and accelerations) as far as the rows prove."""
        relaxation = self.relaxation
        columns = relaxation.time.tolist()
        if with_accelerations:
            columns += relaxation.acceleration[:, relaxation.jerky].ravel().tolist()
        for column in columns:
            rounds = _VARIABLE_ROUNDS if column < relaxation.segments else 1
            for raises in (True, False):
                if self.late:
                    return
                self._move(node, column, raises, rounds)
                if dual_check.is_empty(node.box) or node.bound >= self.target:
                    return

    def _move(self, node: _Node, column: int, raises: bool, rounds: int) -> None:
        objective = np.zeros_like(self.total)
        objective[column] = 1.0 if raises else -1.0
        width = node.box.high[column] - node.box.low[column]
        if width <= 0:
            return
        answer = self.pool.minimised(objective)
        for _ in range(rounds - 1):
            at_side = answer.value <= _side(node.box, column, raises) + _WORTHWHILE_SHARE * width
            if answer.x is None or at_side or not self._separate(answer.x, _COARSE_TOLERANCE):
                break
            answer = self.pool.minimised(objective)
        if answer.x is None:
            self._prove_leaf(node, answer)
            return
        kind = dual_check.RAISE if raises else dual_check.LOWER
        step, bound = self._step(
            kind,
            column,
            objective,
            node.box,
            answer.multipliers,
        )
        # what the multipliers' rounding is worth, for it not to grow from step to step
        stated = bound - _ROUNDING_SHARE * width
        if stated <= _side(node.box, column, raises) + _WORTHWHILE_SHARE * width:
            return
        side = stated if raises else -stated
        node.steps.append(step._replace(value=side))
        node.box = dual_check.moved(
            self.relaxation,
            node.box,
            column,
            raises,
            stated,
        )
        if dual_check.is_empty(node.box):
            node.bound = np.inf
            node.leaf = _Step(
                dual_check.LEAF,
                0,
                0.0,
                np.zeros(0, np.intp),
                np.zeros(0),
            )
            return
        self.pool.enter(node.box)

    def _split(self, node: _Node) -> None:
        """Split a box at the segment time whose curves cost the bound most."""
        self.pool.enter(node.box)
        answer = self.pool.minimised(self.total)
        widths = self._widths(node.box)
        scores = widths / max(widths.max(), np.finfo(float).tiny)
        place = 0.5 * (node.box.low + node.box.high)
        if answer.x is not None:
            costs = self._curve_costs(answer, node.box)
            if costs.max() > 0:
                scores = costs / costs.max() + 1e-3 * scores
            place = answer.x
        column = int(scores.argmax())
        margin = _MARGIN_SHARE * widths[column]
        low = node.box.low[column] + margin
        high = node.box.high[column] - margin
        value = float(np.clip(place[column], low, high))
        children = dual_check.branched(
            self.relaxation,
            node.box,
            column,
            value,
        )
        nodes = [_Node(box, node.bound, leaf=node.leaf) for box in children]
        node.children = tuple(nodes)
        node.steps.append(_branch(column, value))
        self.splits += 1

    def _curve_costs(self, answer: Answer, box: Box) -> Array:
        """Per segment, what the bound would gain if its curves were met, to first order."""
        relaxation = self.relaxation
        assert answer.x is not None
        enclosing = self.pool.enclosing()
        y = np.maximum(answer.multipliers[enclosing.numbers], 0.0)
        misses = np.abs(self._on_the_curves(answer.x) - answer.x)
        errors = np.abs(enclosing.rows.coefficients) * misses[enclosing.rows.columns]
        shares = y * errors.sum(axis=1)
        costs = np.bincount(enclosing.segments, shares, relaxation.segments)
        return np.asarray(costs, dtype=float)

    def _on_the_curves(self, x: Array) -> Array:
        """The same times, velocities and accelerations, with what their products truly are."""
        relaxation = self.relaxation
        times = x[relaxation.time]
        accelerations = x[relaxation.acceleration]
        exact = x.copy()
        exact[relaxation.inverse] = 1 / times
        exact[relaxation.square] = times**2
        exact[relaxation.before] = accelerations * times[:-1, None]
        exact[relaxation.after] = accelerations * times[1:, None]
        return exact

    def _is_on_curves(self, x: Array) -> bool:
        exact = self._on_the_curves(x)
        return np.allclose(x, exact, rtol=_CURVE_RTOL, atol=_CURVE_RTOL)

    # --- rows ---

    def _separate(self, x: Array, tolerance: float) -> int:
        """Add the rows that a point breaks; how many."""
        relaxation = self.relaxation
        before = len(self.pool.found)
        tangent_rtol = max(tolerance / 10, _TANGENT_RTOL)
        for k in range(relaxation.segments):
            product = x[relaxation.inverse[k]] * x[relaxation.time[k]]
            if product < 1 - tangent_rtol:
                self.pool.add_broken_tangent(k, x)
        if relaxation.jerky.any():
            self.pool.add_broken_jerk_rows(x)
        broken = extremal.broken(relaxation, x, tolerance / 2)
        places = {(row.segment, row.joint) for row in broken}
        for (k, j), separation in self.separations.items():
            if self.late:
                break
            if (k, j) in places:
                continue
            cells = separation.broken_most(x, tolerance)
            if cells is not None:
                broken.append(Cut(k, j, cells))
        self.pool.add_broken_cuts(broken, x)
        return len(self.pool.found) - before

    def _first_tangents(self, box: Box) -> None:
        for k in range(self.relaxation.segments):
            places = np.linspace(box.low[k], box.high[k], _START_TANGENTS)
            for at in places:
                self.pool.add_tangent(k, float(at))

    def _step(
        self,
        kind: int,
        variable: int,
        objective: Array,
        box: Box,
        multipliers: Array,
    ) -> tuple[_Step, float]:
        """A step with the rows that its multipliers use, and what they prove."""
        proved = self.pool.proved(objective, box, multipliers)
        step = _Step(
            kind,
            variable,
            0.0,
            proved.rows,
            proved.multipliers,
        )
        return step, proved.bound

    def add_active(self, x: Array) -> None:
        """Add the rows that a motion meets exactly."""
        exact = self._on_the_curves(x)
        cuts = extremal.broken(self.relaxation, exact, -_ACTIVE_TOLERANCE)
        self.pool.add_touching(exact, cuts)

    # --- the proof ---

    def proof(self, root: _Node) -> Proof:
        """The tree as a proof, with only those rows that it uses."""
        steps = list(_walk(root))
        every = [step.rows for step in steps]
        used = np.unique(np.concatenate(every))
        tables, new_numbers = self.pool.tables(used)
        table = []
        multipliers = []
        for step in steps:
            line = (step.kind, step.variable, step.value, len(step.rows))
            table.append(line)
            numbers = new_numbers[step.rows]
            pairs = np.column_stack([numbers, step.multipliers])
            multipliers.append(pairs)
        relaxation = self.relaxation
        cutoff = relaxation.cutoff * relaxation.time_unit
        return Proof(
            units=np.append(relaxation.time_unit, relaxation.length_units),
            cutoff=np.array([cutoff]),
            square_tangents=tables.square_tangents,
            tangents=tables.tangents,
            ramps=tables.ramps,
            cuts=tables.cuts,
            cells=_moderate(tables.cells),
            steps=np.array(table, dtype=float),
            multipliers=_moderate(np.concatenate(multipliers)),
        )


def _walk(node: _Node) -> Iterator[_Step]:
    """A tree's steps, the lower part of a split box first."""
    yield from node.steps
    for child in node.children:
        yield from _walk(child)
    if not node.children:
        assert node.leaf is not None
        yield node.leaf


def _moderate(table: Array) -> Array:
    """0 for what is too small for a proof: any costates and multipliers prove something."""
    return np.where(np.abs(table) < dual_check.SMALLEST, 0.0, table)


def _branch(column: int, value: float) -> _Step:
    nothing = np.zeros(0)
    return _Step(
        dual_check.BRANCH,
        column,
        value,
        nothing.astype(np.intp),
        nothing,
    )


def _side(box: Box, column: int, raises: bool) -> float:
    """The side of a box, as the bound of `x` or of `−x` that moves it."""
    return float(box.low[column] if raises else -box.high[column])
