"""Prove that no motion is shorter than a cut-off, by branching on segment times.

Inequalities of costates are added to the relaxation's linear program where its answers violate
them, until none is violated. Then the program bounds single variables, which narrows the box. Where
that no longer helps, the box is split. Every bound is the one that `dual_check` computes from the
program's multipliers, so the steps of the search are the proof.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from baselines.linear_programs import LinearOptimum
from baselines.lower_bound import dual_check, extremal, jerk_rows
from baselines.lower_bound.costates import SLOPE, Cut
from baselines.lower_bound.dual_check import BoundProof
from baselines.lower_bound.relaxation import Relaxation, VariableBounds
from baselines.lower_bound.row_pool import RowPool, Tangent
from baselines.lower_bound.separation import Separation
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

# Rounds of adding inequalities: for the total time at the root and below, and for one variable.
_MAX_ROOT_ROUNDS = 60
_MAX_NODE_ROUNDS = 6
_MAX_VARIABLE_ROUNDS = 4
# Sweeps over all segment times and accelerations of a node.
_MAX_ROOT_SWEEPS = 12
_MAX_NODE_SWEEPS = 3
# Least move of a box's side that becomes a step, and the margin that each move leaves for rounding,
# relative to the box's width.
_MIN_MOVE = 0.02
_MOVE_MARGIN = 1e-4
# Another sweep follows if the last one has narrowed the box's times by this share.
_MIN_NARROWING = 0.05
# Distance of the cut-off above the target, relative to the gap asked for.
_CUTOFF_ABOVE_TARGET = 0.5
_LONGER_CUTOFF = 1.25
# Least violation of an added inequality: in the last rounds, relative to the gap asked for; in the
# first rounds; and in any.
_FINAL_VIOLATION_SHARE = 0.1
_FIRST_VIOLATION = 1e-3
_MIN_VIOLATION = 1e-8
# Least progress of the bound for another round or split, relative to its distance from the target.
_MIN_PROGRESS = 0.01
# Splits without that progress before the search gives up.
MAX_IDLE_SPLITS = 24
# Index of the cut-off's inequality among those of a box.
_CUTOFF_ROW = 0
# Segments that can take no time are split where all of them together take this share of the gap.
_INSTANT_SHARE = 0.125
# Factor by which a scaled ray exceeds what proves the cut-off.
_RAY_FACTOR = 4.0
# Least distance of a split from the box's sides, relative to the box's width.
_SPLIT_MARGIN = 0.2
# Least violation of a tangent to `1/T`, relative.
_MIN_TANGENT_VIOLATION = 1e-9
# An inequality of cost 1 with less slack at a motion is active.
_ACTIVE_TOLERANCE = 1e-6
_TANGENTS_PER_SEGMENT = 5


class _Step(NamedTuple):
    kind: int
    variable: int
    value: float
    rows: Indices
    multipliers: Array


_NO_ROWS = (np.zeros(0, dtype=np.intp), np.zeros(0))


@dataclass
class _Node:
    """A part of the tree: its box, the steps that narrowed it, and the bound proved in it."""

    box: VariableBounds
    bound: float
    steps: list[_Step] = field(default_factory=list)
    leaf: _Step | None = None
    children: tuple[_Node, ...] = ()


class ProvedBound(NamedTuple):
    """A lower bound, s, its proof, and the numbers of boxes split and linear programs solved."""

    lower_bound: float
    proof: BoundProof
    splits: int
    programs: int


def branch_and_bound(
    problem: Problem,
    target: float,
    gap: float,
    late: Callable[[], bool],
    motion: Trajectory | None = None,
    idle_splits: int = MAX_IDLE_SPLITS,
) -> ProvedBound:
    """Prove that no motion is shorter than the target, or than less if the time is over first.

    Args:
        problem: Without identical consecutive waypoints; all joints move, all limits are used.
        target: s. If it is not a lower bound, the bound that is proved is smaller.
        gap: Relative distance of the target from the fastest motion known; it sets the tolerances.
        late: Returns whether the time limit is over.
        motion: A motion near the optimum; the first inequalities are those active at it.
        idle_splits: Splits without progress before the search gives up.

    Raises:
        MissingBackend: HiGHS is not installed.
        TrajoptError: HiGHS breaks down.
    """
    asked = target
    # no variable counts the waits
    target -= problem.route.demand("dwell").sum()
    # half of the gap is left for rows that are violated by less than the tolerance
    cutoff = target * (1 + _CUTOFF_ABOVE_TARGET * gap)
    relaxation = Relaxation.of(problem, cutoff)
    # the cut-off must be longer than what a single segment takes
    while dual_check.is_empty(relaxation.root_box()):
        cutoff *= _LONGER_CUTOFF
        relaxation = Relaxation.of(problem, cutoff)
    search = _BranchAndBound(relaxation, target, gap, late, idle_splits)
    if motion is not None:
        search.add_active_rows(relaxation.at(problem, motion))
    try:
        root = search.run()
    except TrajoptError:
        if motion is None:
            raise
        # HiGHS has broken down on the motion's rows
        return branch_and_bound(problem, asked, gap, late, None, idle_splits)
    proof = search.proof(root)
    lower_bound = dual_check.proved_bound(problem, proof)
    return ProvedBound(lower_bound, proof, search.splits, search.pool.programs)


class _BranchAndBound:
    """The linear program with all inequalities found so far, and the tree of boxes."""

    def __init__(
        self,
        relaxation: Relaxation,
        target: float,
        gap: float,
        late: Callable[[], bool],
        idle_splits: int,
    ) -> None:
        self.relaxation = relaxation
        self.idle_splits = idle_splits
        self.late = late
        self.target = target / relaxation.time_unit
        self.least_violation = max(_FINAL_VIOLATION_SHARE * gap, _MIN_VIOLATION)
        self.total = relaxation.total()
        self.splits = 0
        instants = max(len(relaxation.instants), 1)
        self.instant = _INSTANT_SHARE * gap * relaxation.cutoff / instants
        box = relaxation.root_box()
        self.pool = RowPool(relaxation, box)
        limited = np.isfinite(relaxation.below) | np.isfinite(relaxation.above)
        # where velocity limits fall most rows need no jerk limit: those are found much sooner
        falls = relaxation.falling.acts.any(axis=0) & relaxation.limited
        self.separations = [
            Separation(relaxation, *place, jerky=False) for place in np.argwhere(falls).tolist()
        ]
        self.separations += [
            Separation(relaxation, *place, jerky=bool(relaxation.limited[*place]))
            for place in np.argwhere(limited).tolist()
        ]
        for segment in range(relaxation.segments):
            ends = (box.low[segment] or self.instant, box.high[segment])
            for at in np.linspace(*ends, _TANGENTS_PER_SEGMENT).tolist():
                self.pool.add([Tangent(segment, at)])

    def run(self) -> _Node:
        """Return the tree, grown until the deadline or until HiGHS breaks down."""
        root = _Node(self.relaxation.root_box(), 0.0)
        try:
            self._grow(root)
        except TrajoptError:
            # the answer is what was proved before HiGHS broke down
            if root.leaf is None:
                raise
        return root

    def _grow(self, root: _Node) -> None:
        """Bound, narrow and split the box with the lowest bound, until there is no progress."""
        order = itertools.count()
        self._narrow_by_cutoff(root)
        self._treat(root, _MAX_ROOT_ROUNDS, _MAX_ROOT_SWEEPS)
        pending = [(root.bound, next(order), root)]
        best = root.bound
        idle_splits = 0
        while not self.late() and idle_splits < self.idle_splits:
            bound, _, node = heapq.heappop(pending)
            if bound >= self.target or not self._widths(node.box).any():
                break
            idle_splits += 1
            if bound - best > _MIN_PROGRESS * (self.target - best):
                best = bound
                idle_splits = 0
            self._split(node)
            for child in node.children:
                self._treat(child, _MAX_NODE_ROUNDS, _MAX_NODE_SWEEPS)
                heapq.heappush(pending, (child.bound, next(order), child))

    # --- a node ---

    def _treat(self, node: _Node, rounds: int, sweeps: int) -> None:
        """Bound the time in a box, and narrow the box while that pays."""
        self._bound_total(node, rounds)
        for sweep in range(sweeps):
            if node.bound >= self.target or self.late():
                return
            before = self._widths(node.box).sum()
            self._sweep(node, with_accelerations=sweep > 0 or rounds == _MAX_NODE_ROUNDS)
            if dual_check.is_empty(node.box):
                return
            self._bound_total(node, rounds)
            if self._widths(node.box).sum() > (1 - _MIN_NARROWING) * before:
                return

    def _widths(self, box: VariableBounds) -> Array:
        times = self.relaxation.time
        return box.high[times] - box.low[times]

    def _bound_total(self, node: _Node, rounds: int) -> None:
        """Bound the total time in a box from below; add inequalities until none is violated."""
        self.pool.enter(node.box)
        violation = max(self.least_violation, _FIRST_VIOLATION)
        before = -np.inf
        for _ in range(rounds):
            answer = self.pool.minimised(self.total)
            self._prove_leaf(node, answer)
            missing = self.target - node.bound
            if missing <= 0 or answer.x is None or self.late():
                return
            added = self._separate(answer.x, violation)
            slow = answer.value - before < _MIN_PROGRESS * missing
            before = answer.value
            if added and not slow:
                continue
            if not added:
                # the target is missed: rows that are violated by less are needed
                self.least_violation = max(_MIN_VIOLATION, self.least_violation / 10)
            if violation <= self.least_violation:
                return
            violation = max(self.least_violation, violation / 10)

    def _prove_leaf(self, node: _Node, answer: LinearOptimum) -> None:
        """Keep the bound that an answer's multipliers prove, if it is larger than before."""
        multipliers = answer.multipliers
        if answer.x is None:
            multipliers = self._scaled_ray(multipliers)
        proved = self.pool.proved(self.total, multipliers)
        if node.leaf is None or proved.bound > node.bound:
            node.leaf = _Step(dual_check.LEAF, 0, 0.0, proved.rows, proved.multipliers)
            node.bound = max(node.bound, proved.bound)

    def _scaled_ray(self, ray: Array) -> Array:
        """Return multipliers that prove the target where no point satisfies the inequalities.

        A ray with a multiplier of the cut-off `Σ T ≤ U` proves `Σ T > U` by its other multipliers,
        divided by that one. They are of moderate size, so they can be rounded. Any other ray is
        scaled until it proves the cut-off.
        """
        of_cutoff = ray[_CUTOFF_ROW]
        if of_cutoff > 0:
            others = np.asarray(ray / of_cutoff)
            others[_CUTOFF_ROW] = 0.0
            if self.pool.proved(self.total, others).bound >= self.target:
                return others
        proved = self.pool.proved(np.zeros_like(self.total), ray).bound
        if proved <= 0:
            return ray
        return ray * (_RAY_FACTOR * self.relaxation.cutoff / proved)

    def _narrow_by_cutoff(self, node: _Node) -> None:
        """Bound each segment's time by the cut-off minus the least times of all others."""
        multipliers = np.zeros(self.pool.box_count)
        multipliers[_CUTOFF_ROW] = 1.0
        for column in self.relaxation.time.tolist():
            self._move(node, dual_check.LOWER, column, multipliers)

    def _sweep(self, node: _Node, with_accelerations: bool) -> None:
        """Move both sides of the box's times and accelerations as far as can be proved."""
        relaxation = self.relaxation
        columns = relaxation.time.tolist()
        if with_accelerations:
            columns += relaxation.acceleration[:, relaxation.jerky].ravel().tolist()
        for column in columns:
            for kind in (dual_check.RAISE, dual_check.LOWER):
                if self.late():
                    return
                self._tighten(node, kind, column)
                if dual_check.is_empty(node.box) or node.bound >= self.target:
                    return

    def _tighten(self, node: _Node, kind: int, column: int) -> None:
        """Move one side of the box as far as can be proved; add inequalities while that helps."""
        width = node.box.high[column] - node.box.low[column]
        if width <= 0:
            return
        objective = self._side_objective(kind, column)
        rounds = _MAX_VARIABLE_ROUNDS if column < self.relaxation.segments else 1
        least = _side(node.box, kind, column) + _MIN_MOVE * width
        answer = self.pool.minimised(objective)
        for _ in range(rounds - 1):
            at_side = answer.value <= least
            if answer.x is None or at_side or not self._separate(answer.x, _FIRST_VIOLATION):
                break
            answer = self.pool.minimised(objective)
        if answer.x is None:
            self._prove_leaf(node, answer)
            return
        self._move(node, kind, column, answer.multipliers)

    def _move(self, node: _Node, kind: int, column: int, multipliers: Array) -> None:
        """Move one side of the box as far as multipliers prove, unless that is negligible."""
        width = node.box.high[column] - node.box.low[column]
        proved = self.pool.proved(self._side_objective(kind, column), multipliers)
        # rounding must not grow from step to step
        bound = proved.bound - _MOVE_MARGIN * width
        if bound <= _side(node.box, kind, column) + _MIN_MOVE * width:
            return
        raises = kind == dual_check.RAISE
        value = bound if raises else -bound
        node.steps.append(_Step(kind, column, value, proved.rows, proved.multipliers))
        node.box = dual_check.moved(self.relaxation, node.box, column, raises, bound)
        if dual_check.is_empty(node.box):
            node.bound = np.inf
            node.leaf = _Step(dual_check.LEAF, 0, 0.0, *_NO_ROWS)
            return
        self.pool.enter(node.box)

    def _side_objective(self, kind: int, column: int) -> Array:
        objective = np.zeros_like(self.total)
        objective[column] = 1.0 if kind == dual_check.RAISE else -1.0
        return objective

    def _split(self, node: _Node) -> None:
        """Split a box across its widest segment time, at the answer's time if there is one."""
        self.pool.enter(node.box)
        answer = self.pool.minimised(self.total)
        widths = self._widths(node.box)
        column = int(widths.argmax())
        times = self.relaxation.time
        middle = 0.5 * (node.box.low[times] + node.box.high[times])
        place = middle if answer.x is None else answer.x
        margin = _SPLIT_MARGIN * widths[column]
        low = node.box.low[column] + margin
        high = node.box.high[column] - margin
        value = float(np.clip(place[column], low, high))
        instants = self.relaxation.instants
        undecided = instants[
            (node.box.low[instants] < self.instant) & (node.box.high[instants] > self.instant)
        ]
        if len(undecided):
            column = int(undecided[place[undecided].argmin()])
            value = self.instant
        boxes = dual_check.branched(self.relaxation, node.box, column, value)
        node.children = tuple(_Node(box, node.bound, leaf=node.leaf) for box in boxes)
        node.steps.append(_Step(dual_check.BRANCH, column, value, *_NO_ROWS))
        self.splits += 1

    # --- rows ---

    def _separate(self, x: Array, violation: float) -> int:
        """Add the inequalities that a point violates; return their number."""
        relaxation = self.relaxation
        before = len(self.pool.found)
        brief = np.isinf(self.pool.box.high[relaxation.inverse])
        if brief.any():
            x = self._on_curve(x, brief)
        times = x[relaxation.time]
        least = max(violation / 10, _MIN_TANGENT_VIOLATION)
        below = np.flatnonzero(x[relaxation.inverse] * times < 1 - least)
        tangents = [Tangent(segment, float(times[segment])) for segment in below.tolist()]
        self.pool.add_violated(tangents, x)
        if relaxation.jerky.any():
            squares = jerk_rows.square_tangents(relaxation, x, self.pool.box)
            squares = [square for square in squares if not brief[square.segment]]
            self.pool.add_violated(squares, x)
            self.pool.add_violated(jerk_rows.violated_ramps(relaxation, x), x)
        cuts = extremal.violated(relaxation, x, violation / 2)
        # where a segment may take no time, a row that counts its displacement bounds nothing
        cuts = [cut for cut in cuts if not brief[cut.segment] or not cut.cells[:, SLOPE:].any()]
        done = {(cut.segment, cut.joint) for cut in cuts}
        for separation in self.separations:
            if self.late():
                break
            place = (separation.segment, separation.joint)
            known = place in done or brief[separation.segment]
            cells = None if known else separation.most_violated(x, violation)
            if cells is not None:
                cuts.append(Cut(*place, cells))
        self.pool.add_violated(cuts, x)
        return len(self.pool.found) - before

    def add_active_rows(self, x: Array) -> None:
        """Add the inequalities that are active at a motion's times, velocities, accelerations."""
        relaxation = self.relaxation
        exact = self._on_curve(x, np.ones(relaxation.segments, dtype=bool))
        times = exact[relaxation.time]
        exact[relaxation.square] = times**2
        a = x[relaxation.acceleration]
        exact[relaxation.before] = a * times[relaxation.segment_before, None]
        exact[relaxation.after] = a * times[relaxation.segment_after, None]
        self.pool.add([Tangent(segment, at) for segment, at in enumerate(times.tolist())])
        self.pool.add(extremal.violated(relaxation, exact, -_ACTIVE_TOLERANCE))

    def _on_curve(self, x: Array, segments: Bools) -> Array:
        """A point with `S = 1/T` of some segments, and offsets times that; no time is 0."""
        relaxation = self.relaxation
        exact = x.copy()
        time, inverse = relaxation.time[segments], relaxation.inverse[segments]
        exact[time] = np.where(x[time] > 0, x[time], self.instant)
        exact[inverse] = 1 / exact[time]
        if relaxation.tolerant:
            offset, by = x[relaxation.offset], exact[relaxation.inverse][:, None]
            before, after = relaxation.segment_before, relaxation.segment_after
            for product, beside in (
                (relaxation.offset_before, before),
                (relaxation.offset_after, after),
            ):
                own = segments[beside]
                exact[product[own]] = (offset * by[beside])[own]
        return exact

    # --- the proof ---

    def proof(self, root: _Node) -> BoundProof:
        """Return the tree as a proof, with only the inequalities that it uses."""
        steps = list(_walk(root))
        used = np.unique(np.concatenate([step.rows for step in steps]))
        tables, new_numbers = self.pool.tables(used)
        for name in ("cells", "rates"):
            tables[name] = _moderate(tables[name])
        heads = [(step.kind, step.variable, step.value, len(step.rows)) for step in steps]
        numbers = [new_numbers[step.rows] for step in steps]
        values = [step.multipliers for step in steps]
        relaxation = self.relaxation
        multipliers = np.column_stack([np.concatenate(numbers), np.concatenate(values)])
        return BoundProof(
            units=np.append(relaxation.time_unit, relaxation.length_units),
            cutoff=np.array([relaxation.cutoff * relaxation.time_unit]),
            steps=np.array(heads, dtype=float),
            multipliers=_moderate(multipliers),
            **tables,
        )


def _walk(node: _Node) -> Iterator[_Step]:
    """Yield a tree's steps, the lower part of a split box first."""
    yield from node.steps
    for child in node.children:
        yield from _walk(child)
    if not node.children:
        assert node.leaf is not None
        yield node.leaf


def _moderate(table: Array) -> Array:
    """Set numbers to 0 that are too small for a proof; it stays valid with any numbers."""
    return np.where(np.abs(table) < dual_check.SMALLEST, 0.0, table)


def _side(box: VariableBounds, kind: int, column: int) -> float:
    """Return the side of a box that a step moves, as the bound of `x` or of `−x`."""
    return float(box.low[column] if kind == dual_check.RAISE else -box.high[column])
