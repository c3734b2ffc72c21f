"""Inequalities of position and falling velocity limits: a linear program per segment and joint.

Where no such limit is active, `extremal.py` gives the inequality that a point violates most in
closed form. Where one is active `λ` jumps, and the inequality is searched for. A grid divides
normalised time into cells. The program maximises the violation while its own approximation of the
cost, the right-hand side of `costates.py`, is 1. It replaces `∫|p|` (without jerk limits `∫|q|`) by
a sum over two Gauss points per cell. This sum only guides the search: `costates.py` computes the
inequality exactly from the costates found.

A cell is halved if a costate changes its sign in it, if a costate is 0 in one of two neighbouring
cells only, or if a position limit is active at its ends. This is repeated until the error of the
grid is below the tolerance.

A falling velocity limit is represented by tangents of its parabola: a few over the whole range, and
a few near the last solution. `costates.py` then uses the best tangent. Where the limit is active
`λ` grows. A cell in which it grows by more than a given share is halved.
"""

from __future__ import annotations

import numpy as np
import scipy  # its submodules are imported when they are used: listing planners does not need them

from baselines.linear_programs import LinearProgram
from baselines.lower_bound import costates
from baselines.lower_bound.relaxation import Relaxation
from trajopt.core.arrays import Array, Bools, Indices

_START_CELLS = 12
_MAX_CELLS = 64
_MAX_FALLING_CELLS = 192
_MAX_HALVINGS = 16
# Smallest width of a cell in normalised time, and relative to the tolerance's square root.
_MIN_WIDTH = 2.0**-20
_MIN_WIDTH_SHARE = 0.2
# Error of a grid, relative to the squared width of the cells that are to be halved (measured).
_GRID_ERROR = 2.0
# A smaller costate on a cell counts as 0, relative to the largest one.
_ZERO_RTOL = 1e-9
# A smaller integral of one sign counts as no change of sign, relative to the other sign's integral.
_SIGN_CHANGE_RTOL = 1e-3
# Tangents of a falling velocity limit: number of points from the offset to the highest velocity,
# the smallest point relative to the highest, and factors on the point of the last solution.
_TANGENTS = 6
_LEAST_PLACE = 0.03
_NEAR_PLACES = (0.93, 1.0, 1.08)
# A program is built again if the segment's time differs by more than this, relative.
_SAME_TIME_RTOL = 0.05
# Least relative growth of `λ` in a cell for it to be halved, and relative to the tolerance's root.
_MIN_GROWTH = 0.02
_MIN_GROWTH_SHARE = 3.0
# Gauss points on the unit interval.
_GAUSS_POINTS = {"first": 0.5 - 0.5 / np.sqrt(3), "second": 0.5 + 0.5 / np.sqrt(3)}


class Separation:
    """The program of one segment and joint with such limits; its grid stays between calls.

    Args:
        relaxation: Whose limits count.
        segment, joint: Counted from 0.
        jerky: Whether its rows may use a jerk limit; without it the program is a third as large.
    """

    def __init__(self, relaxation: Relaxation, segment: int, joint: int, *, jerky: bool) -> None:
        self.relaxation = relaxation
        self.segment = segment
        self.joint = joint
        self.jerky = jerky
        # distances to the position limits downwards and upwards
        below = relaxation.below[segment, joint]
        self.slack = np.array([-below, relaxation.above[segment, joint]])
        self.columns = relaxation.row_columns(segment, joint)
        self.factors = relaxation.row_factors(segment, joint)
        self.acts = relaxation.falling.acts[:, segment, joint]
        self.time = 1.0
        self.places = np.array([[0.5], [np.nan]])
        self._build(np.linspace(0.0, 1.0, _START_CELLS + 1))

    def most_violated(self, x: Array, tolerance: float) -> Array | None:
        """Return the costates `(cells, 8)` whose row a point violates most.

        None if no row with such a limit is violated by the tolerance.

        Args:
            x: The relaxation's variables.
            tolerance: Least violation of a row of cost 1.
        """
        point = x[self.columns] * self.factors
        if self.acts.any() and abs(np.log(point[0] / self.time)) > _SAME_TIME_RTOL:
            self.time = float(point[0])
            self._build(np.append(self.starts, 1.0))
        best = None
        largest = tolerance / 2
        for _ in range(_MAX_HALVINGS + 1):
            claimed, cells = self._solved(point)
            slope = cells[:, costates.SLOPE]
            if not (slope[1:] != slope[:-1]).any() and not cells[:, costates.RATE].any():
                # no such limit is active: `extremal` has this inequality in closed form
                break
            coefficients, bound = costates.row(self.relaxation, self.segment, self.joint, cells)
            violation = float(coefficients @ point - bound)
            if violation > largest:
                best = cells
                largest = violation
            chosen = self._worth_halving(cells, tolerance)
            grid_error = _GRID_ERROR * self.widths[chosen].max(initial=0.0) ** 2
            if claimed + grid_error < tolerance or not chosen.any():
                break
            self._halve(chosen)
        return None if best is None else _without_idle_borders(best)

    def _worth_halving(self, cells: Array, tolerance: float) -> Bools:
        """Return which cells contain or touch an event that a finer grid would locate better."""
        upwards, downwards = self._signed_integrals(cells)
        smaller = np.minimum(upwards, downwards)
        larger = np.maximum(upwards, downwards)
        mean = larger / self.widths
        zero = mean <= _ZERO_RTOL * mean.max()
        changes_sign = smaller > _SIGN_CHANGE_RTOL * larger
        slope = cells[:, costates.SLOPE]
        growth = np.abs(cells[:, costates.RATE] * self.widths)
        jumps = slope[1:] - slope[:-1] - (cells[:, costates.RATE] * self.widths)[:-1]
        at_limit = np.abs(jumps) > _ZERO_RTOL * np.abs(slope).max()
        falls = growth > _ZERO_RTOL * np.abs(slope).max()
        border = (zero[1:] != zero[:-1]) | at_limit | (falls[1:] != falls[:-1])
        chosen = changes_sign & ~zero
        chosen[1:] |= border
        chosen[:-1] |= border
        most_growth = max(_MIN_GROWTH, _MIN_GROWTH_SHARE * np.sqrt(tolerance))
        chosen |= falls & (growth > most_growth * (np.abs(slope) + growth))
        least = max(_MIN_WIDTH, _MIN_WIDTH_SHARE * np.sqrt(tolerance))
        return chosen & (self.widths > least)

    def _signed_integrals(self, cells: Array) -> tuple[Array, Array]:
        """Integrate the positive and the negative part of `p` (`q` without jerk limits)."""
        zero = np.zeros_like(self.widths)
        quadratic = (cells[:, 4], cells[:, 5], zero)
        if self.jerky:
            quadratic = (cells[:, 1], cells[:, 2], cells[:, 3])
        upwards = costates.integral(quadratic, self.widths, down=0.0, up=1.0)
        downwards = costates.integral(quadratic, self.widths, down=1.0, up=0.0)
        return upwards, downwards

    def _halve(self, chosen: Bools) -> None:
        """Halve cells; if there are too many, only those near them are kept."""
        knots = np.append(self.starts, 1.0)
        if len(self.starts) > (_MAX_FALLING_CELLS if self.acts.any() else _MAX_CELLS):
            near = np.append(chosen, False)
            near[1:] |= chosen
            knots = np.union1d(knots[near], np.linspace(0.0, 1.0, _START_CELLS + 1))
        middles = self.starts[chosen] + self.widths[chosen] / 2
        self._build(np.union1d(knots, middles))

    # --- the program ---

    def _build(self, knots: Array) -> None:
        """Set up the program on a grid.

        The costates at the knots have any sign. Everything that costs is a difference of two parts
        that are not negative: the columns of the upward parts follow the costates, then come those
        of the downward parts.
        """
        self.starts = knots[:-1]
        self.widths = np.diff(knots)
        self.tangents = self._tangents()
        cells = len(self.widths)
        free = {"q": cells + 1, "slope": cells}
        parts = {"v": cells, "q_jump": cells - 1, "slope_jump": cells - 1}
        if self.jerky:
            free["p"] = cells + 1
            parts |= {"a_start": cells, "a_end": cells, "p_jump": cells - 1}
        parts |= dict.fromkeys(self.tangents, cells)
        gauss = "p" if self.jerky else "q"
        parts |= {f"{gauss}_{point}": cells for point in _GAUSS_POINTS}
        sizes = free | parts
        ends = np.cumsum(list(sizes.values()))
        self.at = {
            name: np.arange(end - size, end)
            for (name, size), end in zip(sizes.items(), ends.tolist(), strict=True)
        }
        self.part_count = sum(parts.values())
        self.free_count = sum(free.values())

        rows = []
        for equation in self._equations():
            block = np.zeros((len(next(iter(equation.values()))), int(ends[-1])))
            for name, coefficients in equation.items():
                block[:, self.at[name]] = coefficients
            rows.append(block)
        chained = np.vstack(rows)
        equations = np.hstack([chained, -chained[:, self.free_count :]])
        # in the relaxation's units T, S and Q are about 1
        cost = self._costs(1.0, 1.0, 1.0)
        above = np.append(np.zeros(len(equations)), 1.0)
        low = np.zeros(len(cost))
        low[: self.free_count] = -np.inf
        self.program = LinearProgram()
        self.program.load(
            low,
            self._highest(),
            matrix=scipy.sparse.csr_matrix(np.vstack([equations, cost])),
            above=above,
            below=above,
        )

    def _equations(self) -> list[dict[str, Array]]:
        """Return the coefficients of each chain of equations, whose right-hand sides are 0."""
        cells = len(self.widths)
        w = np.diag(self.widths)
        start = np.eye(cells, cells + 1)
        end = np.eye(cells, cells + 1, 1)
        jump = np.eye(cells, cells - 1)
        between = np.eye(cells - 1)
        step = np.eye(cells - 1, cells, 1) - np.eye(cells - 1, cells)
        turned = self._turned()
        falls = {name: -w @ part for name, part in turned.items()}
        grown = {name: np.diag(-c * self.widths)[:-1] for name, c in self.tangents.items()}
        equations = [
            # q_{i+1} = q_i − λ w + v w + jump, where λ may grow
            {"q": end - start, "slope": w, "v": -w, "q_jump": -jump, **falls},
            # λ_{i+1} = λ_i + growth + jump
            {"slope": step, "slope_jump": -between, **grown},
        ]
        if not self.jerky:
            # q at the Gauss points: without p, acceleration pays for all of q
            for point, share in _GAUSS_POINTS.items():
                s = share * w
                falls = {name: s @ part for name, part in turned.items()}
                gauss = {"slope": -s, "v": s, f"q_{point}": -np.eye(cells)}
                equations.append({"q": start, **gauss, **falls})
            return equations
        # p_{i+1} = p_i + ∫ (a − q) over the cell + jump, then p at the Gauss points
        whole = self._p_gained(self.widths)
        chain = {name: -coefficients for name, coefficients in whole.items()}
        equations.append({"p": end - start, "p_jump": -jump, **chain})
        for point, share in _GAUSS_POINTS.items():
            gained = self._p_gained(share * self.widths)
            equations.append({"p": start, f"p_{point}": -np.eye(cells), **gained})
        return equations

    def _tangents(self) -> dict[str, Array]:
        """Return the rates `c` of tangents in each cell, by their names, `(cells,)` each."""
        if not self.acts.any():
            return {}
        falling = self.relaxation.falling
        offset = float(falling.offset[self.joint])
        scale = float(falling.deceleration[self.joint]) * self.time  # c = d T / (v + o)
        most = offset + float(self.relaxation.v[:, self.segment, self.joint].max())
        everywhere = np.geomspace(max(offset, _LEAST_PLACE * most), most, _TANGENTS)
        at, known = self.places
        if np.isnan(known).any():
            known = np.full_like(known, np.log(everywhere[len(everywhere) // 2]))
        near = np.exp(np.interp(self.starts + self.widths / 2, at, known))
        places = [np.full_like(near, place) for place in everywhere]
        places += [factor * near for factor in _NEAR_PLACES]
        return {f"fall_{number}": scale / place for number, place in enumerate(places)}

    def _turned(self) -> dict[str, Array]:
        """Return the change of `q` by a tangent's part: `λ` grows with it, by half on average."""
        return {name: np.diag(1 - c * self.widths / 2) for name, c in self.tangents.items()}

    def _p_gained(self, s: Array) -> dict[str, Array]:
        """Return the coefficients of `∫ (a − q)` from a cell's start to `s`.

        `q' = v − λ`, and `a` is a line over the cell.
        """
        half_square = s**2 / 2
        at_end = half_square / self.widths
        turned = {name: np.diag(-half_square) @ part for name, part in self._turned().items()}
        return {
            **turned,
            "q": np.diag(-s) @ np.eye(len(s), len(s) + 1),
            "slope": np.diag(half_square),
            "v": np.diag(-half_square),
            "a_start": np.diag(s - at_end),
            "a_end": np.diag(at_end),
        }

    def _part(self, name: str, upwards: bool) -> Indices:
        """Return the columns of a quantity's upward or downward part."""
        return self.at[name] if upwards else self.at[name] + self.part_count

    def _costs(self, time: float, inverse: float, square: float) -> Array:
        """Return the row's right-hand side, part by part."""
        relaxation = self.relaxation
        costs = np.zeros(self.free_count + 2 * self.part_count)
        half = self.widths / 2
        for side in (0, 1):
            v = relaxation.v[side, self.segment, self.joint]
            a = relaxation.a[side, self.segment, self.joint] * time
            j = relaxation.j[side, self.segment, self.joint] * square
            prices = {
                "v": v * self.widths,
                "q_jump": v,
                "q_first": a * half,
                "q_second": a * half,
                "a_start": a * half,
                "a_end": a * half,
                "p_jump": a,
                "p_first": j * half,
                "p_second": j * half,
                "slope_jump": self.slack[side] * inverse,
            }
            falling = self.relaxation.falling
            offset = falling.offset[self.joint]
            distance = falling.distance[side, self.segment, self.joint] * inverse
            for name, c in self.tangents.items():
                fallen = falling.deceleration[self.joint] * time / (2 * c) + c * distance
                prices[name] = self.widths * (fallen - offset)
            for name, price in prices.items():
                if name in self.at and np.isfinite(price).all():
                    costs[self._part(name, upwards=side == 1)] = price
        return costs

    def _highest(self) -> Array:
        """Return the variables' upper bounds: a part whose limit is infinite is 0."""
        highest = np.full(self.free_count + 2 * self.part_count, np.inf)
        for side in (0, 1):
            free = []
            if self.jerky and np.isinf(self.relaxation.j[side, self.segment, self.joint]):
                free += ["p_first", "p_second"]
            if np.isinf(self.slack[side]):
                free.append("slope_jump")
            if not self.acts[side]:
                free += list(self.tangents)
            for name in free:
                highest[self._part(name, upwards=side == 1)] = 0.0
        return highest

    def _solved(self, point: Array) -> tuple[float, Array]:
        """Return the violation that the program claims at a point, and its costates."""
        time, inverse, square, v_start, v_end, a_start, a_end, *offsets = point.tolist()
        objective = self._costs(time, inverse, square)
        displacement = self.relaxation.h[self.segment, self.joint]
        objective[self.at["slope"][-1]] -= displacement * inverse
        for name, c in self.tangents.items():
            for upwards, sign in ((True, 1.0), (False, -1.0)):
                grown = sign * c[-1] * self.widths[-1]
                objective[self._part(name, upwards)[-1]] -= displacement * inverse * grown
        if offsets:
            objective[self.at["slope"][[0, -1]]] += [offsets[0], -offsets[1]]
        objective[self.at["q"][[0, -1]]] += [v_start, -v_end]
        if self.jerky:
            objective[self.at["p"][[0, -1]]] += [a_start, -a_end]
        answer = self.program.minimised(objective)
        if answer.x is None:
            return 0.0, np.zeros((0, costates.RATE + 1))
        return -answer.value, self._cells(answer.x)

    def _cells(self, x: Array) -> Array:
        """Return the costates of a solution.

        Where `p` is 0 at both Gauss points it is set to 0, since the program does not determine it
        elsewhere in the cell.
        """

        def difference(name: str) -> Array:
            return x[self._part(name, True)] - x[self._part(name, False)]

        slope = x[self.at["slope"]]
        q0 = x[self.at["q"][:-1]]
        q1 = difference("v") - slope
        rate = np.zeros_like(slope)
        mass = np.zeros_like(slope)
        for name, c in self.tangents.items():
            part = difference(name)
            q1 += part * (1 - c * self.widths / 2)
            rate += c * part
            mass += part
        self._keep_places(rate, mass)
        p = np.zeros((3, len(slope)))
        if self.jerky:
            start = difference("a_start")
            rise = (difference("a_end") - start) / self.widths
            p[0] = x[self.at["p"][:-1]]
            p[1] = start - q0
            p[2] = (rise - q1) / 2
            gauss = np.stack([difference("p_first"), difference("p_second")])
            size = np.abs(gauss).max(axis=0)
            p[:, size <= _ZERO_RTOL * size.max()] = 0.0
        return np.column_stack([self.starts, *p, q0, q1, slope, rate])

    def _keep_places(self, rate: Array, mass: Array) -> None:
        """Keep the points where tangents touch the parabola, for the next program."""
        touched = rate * mass > 0
        if touched.any():
            scale = self.relaxation.falling.deceleration[self.joint] * self.time
            at = self.starts + self.widths / 2
            places = np.log(scale * mass[touched] / rate[touched])
            self.places = np.array([at[touched], places])


def _without_idle_borders(cells: Array) -> Array:
    """Merge consecutive cells of zeros into one."""
    idle = np.all(cells[:, 1:] == 0, axis=1)
    continued = np.append(False, idle[1:] & idle[:-1])
    return cells[~continued]
