"""Rows that position limits give: one linear program per segment and joint.

Where no position limit is met `extremal.py` knows the row that a point breaks most. Where `λ` jumps
it is searched for. On a grid of normalised time `q` and `p` are chained from cell to cell, and the
row's violation is maximised while its own cost (the right-hand side of `costates.py`) is 1. `∫|p|`
(without jerk limits `∫|q|`) is summed over two Gauss points a cell, which only steers: the row is
computed exactly from what comes out. Cells are halved at changes of sign, at ends of arcs and where
a wall is met, until their squares are worth less than the tolerance: a coarse grid's claim is no
bound.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

from baselines.lower_bound import costates
from baselines.lower_bound.linear import Linear
from baselines.lower_bound.relaxation import Relaxation

Array = NDArray[np.float64]

_CELLS = 12
_MOST_CELLS = 64
_NARROWEST = 2.0**-20
# Of the tolerance's root: cells so narrow lose less than the tolerance.
_WIDTH_SHARE = 0.2
_HALVINGS = 16
# What a grid loses, measured, over the squared width of the cells where something happens.
_LOSS = 2.0
# Of the largest: a costate so small on a cell is 0 there.
_ZERO_SHARE = 1e-9
# Of the other sign's: a change of sign worth a knot.
_MIXED_SHARE = 1e-3
_GAUSS = (0.5 - 0.5 / np.sqrt(3), 0.5 + 0.5 / np.sqrt(3))


class Separation:
    """One segment and joint's program; its grid and its basis stay from call to call."""

    def __init__(self, relaxation: Relaxation, segment: int, joint: int, solver: Any) -> None:
        self.relaxation = relaxation
        self.segment = segment
        self.joint = joint
        self.solver = solver
        self.jerky = bool(relaxation.jerky[joint])
        below = relaxation.below[segment, joint]
        above = relaxation.above[segment, joint]
        self.walls = np.array([-below, above])
        self.walled = bool(np.isfinite(self.walls).any())
        self.columns = relaxation.row_columns(segment, joint)
        self._build(np.linspace(0.0, 1.0, _CELLS + 1))

    def broken_most(self, x: Array, tolerance: float) -> Array | None:
        """Costates whose row the variables break, `(cells, 7)`; None if none by the tolerance.

        Args:
            x: The relaxation's variables.
            tolerance: Of the row's violation, where its cost is 1.
        """
        point = x[self.columns]
        best = None
        largest = tolerance / 2
        for _ in range(_HALVINGS + 1):
            claimed, cells = self._solved(point)
            slope = cells[:, -1]
            meets_walls = (slope[1:] != slope[:-1]).any()
            if not meets_walls:
                # without them `extremal` knows the rows
                break
            violation = self._violation(cells, point)
            if violation > largest:
                best = cells
                largest = violation
            chosen = self._halvable(cells, tolerance)
            # what is lost by a grid goes with the squares of the cells where something happens
            lost = _LOSS * self.widths[chosen].max(initial=0.0) ** 2
            if claimed + lost < tolerance or not chosen.any():
                break
            self._halve(chosen)
        return None if best is None else _thinned(best)

    def _violation(self, cells: Array, point: Array) -> float:
        coefficients, bound = costates.row(
            self.relaxation,
            self.segment,
            self.joint,
            cells,
        )
        return float(coefficients @ point - bound)

    def _halvable(self, cells: Array, tolerance: float) -> NDArray[np.bool_]:
        """Cells where `p` changes its sign, an arc begins or ends, or a wall is met."""
        chosen = _coarse(cells, self.widths, 1 if self.jerky else 4)
        chosen |= _beside_walls(cells)
        chosen &= self.widths > max(_NARROWEST, _WIDTH_SHARE * np.sqrt(tolerance))
        return chosen

    def _halve(self, chosen: NDArray[np.bool_]) -> None:
        """Halve cells; of too many, only those near them are kept."""
        knots = np.append(self.starts, 1.0)
        if len(self.starts) > _MOST_CELLS:
            near = np.append(chosen, False)
            near[1:] |= chosen
            base = np.linspace(0.0, 1.0, _CELLS + 1)
            knots = np.union1d(knots[near], base)
        middles = self.starts[chosen] + self.widths[chosen] / 2
        self._build(np.union1d(knots, middles))

    # --- the program ---

    def _build(self, knots: Array) -> None:
        self.starts = knots[:-1]
        self.widths = np.diff(knots)
        self._count_columns()
        self.rows: list[tuple[Any, Any, Any]] = []
        self.sides: list[float] = []
        w = self.widths
        self._chain_q(w)
        if self.jerky:
            self._chain_p(w)
        for share in _GAUSS:
            if self.jerky:
                self._p_at(share, w)
            else:
                self._q_at(share, w)
        if self.walled:
            self._chain_slope()
        self.program = self._program()

    def _count_columns(self) -> None:
        cells = len(self.widths)
        sizes = {"q": cells + 1, "slope": cells if self.walled else 1}
        parts = {"v": cells, "q_jump": cells - 1}
        if self.jerky:
            sizes["p"] = cells + 1
            parts |= {"p_first": cells, "p_second": cells, "p_jump": cells - 1}
            parts |= {"a_start": cells, "a_end": cells}
        else:
            parts |= {"q_first": cells, "q_second": cells}
        if self.walled:
            parts["wall"] = cells - 1
        # what costs is the difference of two parts that are not negative, downwards and upwards
        for name, size in parts.items():
            sizes[f"{name}-"] = size
            sizes[f"{name}+"] = size
        self.at: dict[str, NDArray[np.intp]] = {}
        count = 0
        for name, size in sizes.items():
            self.at[name] = np.arange(count, count + size)
            count += size
        self.count = count

    def _rows(self, count: int) -> NDArray[np.intp]:
        """New equations."""
        first = len(self.sides)
        self.sides += [0.0] * count
        return np.arange(first, first + count)

    def _put(self, rows: Any, columns: Any, values: Any) -> None:
        triple = np.broadcast_arrays(rows, columns, values)
        self.rows.append((triple[0], triple[1], triple[2]))

    def _put_parts(self, rows: Any, name: str, values: Any) -> None:
        self._put(rows, self.at[f"{name}+"], values)
        self._put(rows, self.at[f"{name}-"], -np.asarray(values))

    def _slopes(self) -> NDArray[np.intp]:
        """The column of each cell's `λ`."""
        slopes = self.at["slope"]
        return slopes if self.walled else np.repeat(slopes, len(self.widths))

    def _chain_q(self, w: Array) -> None:
        """`q_{i+1} = q_i − λ w + v w + jump`."""
        rows = self._rows(len(w))
        columns = self.at["q"]
        slopes = self._slopes()
        self._put(rows, columns[1:], 1.0)
        self._put(rows, columns[:-1], -1.0)
        self._put(rows, slopes, w)
        self._put_parts(rows, "v", -w)
        self._put_parts(rows[:-1], "q_jump", -1.0)

    def _put_integrals(self, rows: Any, s: Array, w: Array, sign: float) -> None:
        """`sign (−∫₀ˢ q + ∫₀ˢ a)`, with `q' = v − λ` and `a` a line over the cell."""
        half_square = sign * s**2 / 2
        at_end = half_square / w
        at_start = sign * s - at_end
        columns = self.at["q"][:-1]
        slopes = self._slopes()
        self._put(rows, columns, -sign * s)
        self._put(rows, slopes, half_square)
        self._put_parts(rows, "v", -half_square)
        self._put_parts(rows, "a_start", at_start)
        self._put_parts(rows, "a_end", at_end)

    def _chain_p(self, w: Array) -> None:
        """`p_{i+1} = p_i − ∫ q + ∫ a + jump`."""
        rows = self._rows(len(w))
        columns = self.at["p"]
        self._put(rows, columns[1:], 1.0)
        self._put(rows, columns[:-1], -1.0)
        self._put_integrals(rows, w, w, -1.0)
        self._put_parts(rows[:-1], "p_jump", -1.0)

    def _p_at(self, share: float, w: Array) -> None:
        """`p` at a share of each cell, in parts."""
        name = _at_share("p", share)
        rows = self._rows(len(w))
        self._put(rows, self.at["p"][:-1], 1.0)
        self._put_integrals(rows, share * w, w, 1.0)
        self._put_parts(rows, name, -1.0)

    def _q_at(self, share: float, w: Array) -> None:
        """`q` at a share of each cell, in parts: without `p`, acceleration pays for all of it."""
        name = _at_share("q", share)
        rows = self._rows(len(w))
        self._put(rows, self.at["q"][:-1], 1.0)
        self._put(rows, self._slopes(), -share * w)
        self._put_parts(rows, "v", share * w)
        self._put_parts(rows, name, -1.0)

    def _chain_slope(self) -> None:
        """`λ_{i+1} = λ_i + wall`."""
        slopes = self.at["slope"]
        rows = self._rows(len(slopes) - 1)
        self._put(rows, slopes[1:], 1.0)
        self._put(rows, slopes[:-1], -1.0)
        self._put_parts(rows, "wall", -1.0)

    def _costs(self, time: float, inverse: float, square: float) -> Array:
        """The row's right-hand side, part by part."""
        relaxation = self.relaxation
        costs = np.zeros(self.count)
        w = self.widths
        half = w / 2
        for side, sign in enumerate("-+"):
            v = relaxation.v[side, self.joint]
            a = relaxation.a[side, self.joint] * time
            limit = relaxation.j[side, self.joint]
            j = limit * square if np.isfinite(limit) else 0.0
            room = self.walls[side]
            prices = {
                "v": v * w,
                "q_jump": v,
                "q_first": a * half,
                "q_second": a * half,
                "a_start": a * half,
                "a_end": a * half,
                "p_jump": a,
                "p_first": j * half,
                "p_second": j * half,
            }
            if np.isfinite(room):
                prices["wall"] = room * inverse
            for name, price in prices.items():
                column = self.at.get(name + sign)
                if column is not None:
                    costs[column] = price
        return costs

    def _program(self) -> Linear:
        low = np.zeros(self.count)
        for name in ("q", "slope", "p"):
            if name in self.at:
                low[self.at[name]] = -np.inf
        high = np.full(self.count, np.inf)
        # without a jerk limit on a side, `p` never has its sign
        for side, sign in zip(self.relaxation.j[:, self.joint], "-+", strict=True):
            for name in ("p_first", "p_second"):
                if self.jerky and np.isinf(side):
                    high[self.at[f"{name}{sign}"]] = 0.0
        for room, sign in zip(self.walls, "-+", strict=True):
            if self.walled and np.isinf(room):
                high[self.at[f"wall{sign}"]] = 0.0
        # units are such that T, S and Q are about 1
        costs = self._costs(1.0, 1.0, 1.0)
        last = len(self.sides)
        self._put(last, np.arange(self.count), costs)
        parts = zip(*self.rows, strict=True)
        rows, columns, values = map(np.concatenate, parts)
        shape = (last + 1, self.count)
        matrix = scipy.sparse.csr_matrix(
            (values, (rows, columns)),
            shape=shape,
        )
        matrix.eliminate_zeros()
        equal = np.array(self.sides)
        below = np.append(equal, 1.0)
        above = np.append(equal, 1.0)
        return Linear(self.solver, low, high, matrix, below, above)

    def _solved(self, point: Array) -> tuple[float, Array]:
        """What the program claims as the violation, and its costates."""
        time, inverse, square, v_start, v_end, a_start, a_end = point.tolist()
        objective = self._costs(time, inverse, square)
        q = self.at["q"]
        objective[q[-1]] -= v_end
        objective[q[0]] += v_start
        displacement = self.relaxation.h[self.segment, self.joint]
        objective[self.at["slope"][-1]] -= displacement * inverse
        if self.jerky:
            p = self.at["p"]
            objective[p[-1]] -= a_end
            objective[p[0]] += a_start
        answer = self.program.minimised(objective)
        if answer.x is None:
            return 0.0, np.zeros((0, costates.CELL_COLUMNS))
        return -answer.value, self._cells(answer.x)

    def _difference(self, x: Array, name: str) -> Array:
        upwards = x[self.at[f"{name}+"]]
        downwards = x[self.at[f"{name}-"]]
        return np.asarray(upwards - downwards)

    def _cells(self, x: Array) -> Array:
        """The costates of a solution.

        Where `p` is 0 at both Gauss points it is made 0: the program lets it swing there for
        nothing.
        """
        w = self.widths
        slope = x[self._slopes()]
        q0 = x[self.at["q"][:-1]]
        q1 = self._difference(x, "v") - slope
        p = np.zeros((3, len(w)))
        if self.jerky:
            start = self._difference(x, "a_start")
            end = self._difference(x, "a_end")
            rise = (end - start) / w
            p[0] = x[self.at["p"][:-1]]
            p[1] = start - q0
            p[2] = (rise - q1) / 2
            first = self._difference(x, "p_first")
            second = self._difference(x, "p_second")
            size = np.maximum(np.abs(first), np.abs(second))
            zero = size <= _ZERO_SHARE * size.max()
            p[:, zero] = 0.0
        return np.column_stack([self.starts, *p, q0, q1, slope])


def _at_share(name: str, share: float) -> str:
    return f"{name}_first" if share < 0.5 else f"{name}_second"


def _coarse(cells: Array, widths: Array, column: int) -> NDArray[np.bool_]:
    """Where the costate from a column on changes its sign, or begins or ends to be 0."""
    f0 = cells[:, column]
    f1 = cells[:, column + 1]
    f2 = cells[:, column + 2] if column == 1 else np.zeros_like(f0)
    quadratic = (f0, f1, f2)
    upwards = costates.integral(
        quadratic,
        widths,
        down=0.0,
        up=1.0,
    )
    downwards = costates.integral(
        quadratic,
        widths,
        down=1.0,
        up=0.0,
    )
    smaller = np.minimum(upwards, downwards)
    larger = np.maximum(upwards, downwards)
    mean = larger / widths
    zero = mean <= _ZERO_SHARE * mean.max()
    mixed = smaller > _MIXED_SHARE * larger
    coarse = mixed & ~zero
    changes = zero[1:] != zero[:-1]
    coarse[1:] |= changes
    coarse[:-1] |= changes
    return np.asarray(coarse)


def _beside_walls(cells: Array) -> NDArray[np.bool_]:
    """The cells before and after an instant at which a position limit is met: `λ` jumps there."""
    slope = cells[:, -1]
    jumps = np.abs(np.diff(slope)) > _ZERO_SHARE * np.abs(slope).max()
    beside = np.zeros(len(cells), dtype=bool)
    beside[1:] |= jumps
    beside[:-1] |= jumps
    return beside


def _thinned(cells: Array) -> Array:
    """Without the borders where nothing happens: cells of zeros that follow one another."""
    idle = np.all(cells[:, 1:] == 0, axis=1)
    continued = np.zeros(len(cells), dtype=bool)
    continued[1:] = idle[1:] & idle[:-1]
    return np.asarray(cells[~continued])
