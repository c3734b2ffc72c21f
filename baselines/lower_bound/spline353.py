"""The best 3-5-3 spline with shared times, by cutting planes (docs/mathematics.md, section 5).

Every limit is linear in `x1², x1x2, x2², x2x3, x3²` beside `x2`, 1 and `t2` (`x = 1/t`), a position
limit in these five alone; it is imposed at finitely many normalised times, and those of the worst
violations are added until bound and certified duration meet.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

from baselines.lower_bound.program import TOLERANCE, certified
from baselines.spline353_nlp import Spline, Spline353NLP
from trajopt import polynomials, spline353
from trajopt.exceptions import InvalidInput
from trajopt.problem import Problem
from trajopt.rest_to_rest import stop_times
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

# Normalised times to begin with.
_START_INSTANTS = 33
# For a segment without displacement, as a fraction of the others.
_NO_TIME = 1e-9
# Searches for the segment times where IPOPT is no help.
_SEARCHES = 12
# Measured, per moving joint: the incumbent, and one model.
_SECONDS_PER_JOINT = 0.1

# Quintic Hermite polynomials of `h, v0, a0, v1, a1` on the unit interval, highest power first.
_HERMITE = np.array(
    [
        [6, -15, 10, 0, 0, 0],
        [-3, 8, -6, 0, 1, 0],
        [-0.5, 1.5, -1.5, 0.5, 0, 0],
        [-3, 7, -4, 0, 0, 0],
        [0.5, -1, 0.5, 0, 0, 0],
    ]
).T
# The monomials `x_i x_k` that these carry: h, v0, a0, v1, a1.
_MONOMIALS = ((1, 1), (0, 1), (0, 0), (1, 2), (2, 2))


class Spline353:
    """The best 3-5-3 spline with shared times; `x = 1/t`, times in thirds of the incumbent."""

    exchanges = True

    def __init__(self, problem: Problem, scip: Any, *, seconds: float = np.inf) -> None:
        if problem.segments != 3:
            raise InvalidInput("problem", "exactly 4 waypoints", value=problem.segments + 1)
        self.problem = problem
        self.scip = scip
        self.spline = Spline(self.problem)
        self.instants = set(np.linspace(0, 1, _START_INSTANTS))
        self.times = self._best_times()
        total = self.times.sum()
        self.unit = float(total) / 3
        self.instants.update(self._critical(self.times))
        shortest, longest = self._between(total)
        self.low = shortest / self.unit
        self.high = longest / self.unit
        self.trivial_bound = float(self.low.sum()) * self.unit

    @staticmethod
    def expected_seconds(problem: Problem) -> float:
        """What the incumbent and one model take about, s."""
        return _SECONDS_PER_JOINT * int(problem.moving.sum())

    @property
    def margin(self) -> float:
        """With SCIP's `x` taken as exact, each `t` is off by a share ε, each monomial by ε.

        So a row (monomials over a limit) is off by ε times its coefficients' sum. Dilated by
        `1 + ρ`, rows gain slack of at least `ρ/t2` (velocity), `ρ` (acceleration), `ρ t2` (jerk).
        """
        longest = self.high[1]
        shortest = self.low[1]
        slack = {
            1: longest,
            2: 1.0,
            3: 1 / shortest,
        }
        shares = []
        for coefficients, order in self._rows():
            sums = np.abs(coefficients).sum(axis=1)
            largest = (1 + sums).max()
            shares.append(slack[order] * largest)
        return float(TOLERANCE * (2 + max(shares)))

    def _best_times(self) -> Array:
        """IPOPT's; with a segment of no displacement, whose time may tend to 0, a search's."""
        moves = self.problem.displacements.any(axis=1)
        if moves.all():
            planner = Spline353NLP()
            answer = planner.solve(self.problem).trajectory
            if answer is not None:
                return np.diff(answer.waypoint_times)
        middle = np.array([False, True, False])
        return self._searched_times(moves | middle)

    def _searched_times(self, free: NDArray[np.bool_]) -> Array:
        """The best segment times by Nelder and Mead; those that are not `free` tend to 0.

        Only their ratios to the middle one matter, which is always free.
        """
        middle = int(free[0])

        def times(y: Array) -> Array:
            ratios = np.insert(y, middle, 0.0)
            own = np.exp(ratios)
            vanishing = _NO_TIME * own.sum()
            t = np.full(3, vanishing)
            t[free] = own
            k = self.spline.dilation(t)
            return np.asarray(t * k)

        def duration(y: Array) -> float:
            t = times(y)
            if self.spline.excess(t) > 0:
                return np.inf
            return float(t.sum())

        unknowns = int(free.sum()) - 1
        if not unknowns:
            return times(np.empty(0))
        rng = np.random.default_rng(0)
        starts = rng.uniform(-3, 3, (_SEARCHES, unknowns))
        if self.spline.room is not None:
            kept = spline353.keeping_times(
                self.spline.displacements,
                self.spline.limits,
                self.spline.room,
                unit=float(stop_times(self.problem).max()),
            )
            ratios = np.log(kept[free] / kept[1])
            start = np.delete(ratios, middle)
            starts = np.vstack([starts, start])
        optima = []
        for start in starts:
            optimum = scipy.optimize.minimize(
                duration,
                start,
                method="Nelder-Mead",
                options={"xatol": 1e-12, "fatol": 1e-14, "maxiter": 4000},
            )
            optima.append(optimum)
        best = min(optima, key=lambda optimum: float(optimum.fun))
        return times(best.x)

    def _between(self, total: float) -> tuple[Array, Array]:
        """Shortest and longest times, s; without displacement an outer time may be 0."""
        d = np.abs(self.spline.displacements)
        limits = self.spline.limits
        v = _wider(limits.velocity)
        a = _wider(limits.acceleration)
        j = _wider(limits.jerk)

        # 3 |d|/t ≤ V, 6 |d|/t² ≤ A, 6 |d|/t³ ≤ J
        by_velocity = 3 * d / v
        by_acceleration = np.sqrt(6 * d / a)
        by_jerk = np.cbrt(6 * d / j)
        outer = np.maximum(by_velocity, by_acceleration)
        outer = np.maximum(outer, by_jerk)

        # a joint back where it was stops at some instant, from ends of 3 d1/t1 and 3 d3/t3
        h = d[:, 1:2]
        ends = d[:, ::2]
        braking = 3 * ends / (total * a)
        stop = np.where(h == 0, braking, 0)
        cruising = h / v
        middle = max(cruising.max(), stop.max())

        first, _, last = outer.max(axis=0)
        low = np.array([first, middle, last])
        others = low.sum() - low
        high = np.maximum(total - others, low)
        return low, high

    def _critical(self, times: Array) -> Array:
        """The normalised times where a limit can be worst."""
        instants = []
        rates = self.spline.rates(times)
        if self.spline.room is not None:
            rates.append(self.spline.position(times))
        for rate in rates:
            points = polynomials.critical_points(rate)
            instants.append(points.ravel())
        return np.concatenate(instants)

    def _values(self, order: int) -> Array:
        """Coefficients of the monomials in a derivative of the quintic, `(instants, joints, 5)`.

        In position they make `x2² (q − q1)`, in velocity `x2 v`, in acceleration `a`, in jerk
        `t2 j`: with `h x2²`, `v0 x2 = 3 d1 x1x2`, `a0 = 6 d1 x1²`, `v1 x2 = 3 d3 x2x3` and
        `a1 = −6 d3 x3²`.
        """
        d1, h, d3 = self.spline.displacements.T
        columns = [h, 3 * d1, 6 * d1, 3 * d3, -6 * d3]
        weights = np.stack(columns, axis=-1)
        instants = np.array(sorted(self.instants))
        rates = polynomials.derivative(_HERMITE, order)[:, None]
        basis = polynomials.evaluate(rates, instants[:, None])
        return np.asarray(basis[:, None] * weights)

    def _rows(self) -> list[tuple[Array, int]]:
        """Coefficients of the monomials over each limit, `(rows, 5)`, and the limit's order."""
        rows = []
        for order, bounds in enumerate(self.spline.bounds, start=1):
            values = self._values(order) / self.unit**order
            for side in bounds.T:
                finite = np.isfinite(side)
                if not finite.any():
                    continue
                use = values[:, finite] / side[finite, None]
                table = use.reshape(-1, 5)
                rows.append((table, order))
        return rows

    def _position_rows(self) -> Array:
        """Coefficients of the monomials, `(rows, 5)`, whose sum a position limit keeps below 0.

        Positions count in the joint's largest displacement. Rows that hold in the whole box are
        left out.
        """
        room = self.spline.room
        if room is None:
            return np.empty((0, 5))
        values = self._values(0)
        tables = []
        for side, sign in zip(room.T, (-1.0, 1.0), strict=True):
            limited = np.isfinite(side)
            beyond = values[:, limited].copy()
            # x2² (q − q1) ≤ x2² (limit − q1)
            beyond[..., 0] -= side[limited]
            beyond *= sign / self.spline.sizes[limited, None]
            tables.append(beyond.reshape(-1, 5))
        rows = np.concatenate(tables)
        lowest, highest = self._monomial_bounds()
        most = np.maximum(rows * lowest, rows * highest).sum(axis=1)
        return np.asarray(rows[most > 0])

    def _monomial_bounds(self) -> tuple[Array, Array]:
        """The lowest and the highest value of each monomial in the box, `(5,)` each."""
        moving = self.low > 0
        least = np.zeros(3)
        least[moving] = 1 / self.high[moving]
        most = np.zeros(3)
        most[moving] = 1 / self.low[moving]
        first, second = np.transpose(_MONOMIALS)
        lowest = least[first] * least[second]
        highest = most[first] * most[second]
        return lowest, highest

    def incumbent(self) -> Trajectory:
        return self._along(self.times)

    def _along(self, times: Array) -> Trajectory:
        """The spline of these segment times, s, keeping its limits."""
        spline = spline353.trajectory(self.problem, times)
        return certified(self.problem, spline)

    def model(self, cutoff: float | None) -> Any:
        """Variables: `t`, `x` (0 where it is multiplied by no displacement), the monomials."""
        m = self.scip.Model()
        low = self.low
        high = self.high
        moving = np.flatnonzero(low)
        t = []
        for shortest, longest in zip(low, high, strict=True):
            variable = m.addVar(lb=shortest, ub=longest)
            t.append(variable)
        x: list[Any] = [0.0, 0.0, 0.0]
        for i in moving:
            smallest = 1 / high[i]
            largest = 1 / low[i]
            x[i] = m.addVar(lb=smallest, ub=largest)
        for i in moving:
            reciprocal = t[i] * x[i]
            m.addCons(reciprocal == 1)
        self.t = t

        # a velocity row is multiplied by x2, a jerk row by t2
        terms = []
        for first, second in _MONOMIALS:
            term = self._product(m, x[first], x[second])
            terms.append(term)
        beside = {
            1: x[1],
            2: 1.0,
            3: t[1],
        }
        for rows, order in self._rows():
            present = rows.any(axis=1)
            for row in rows[present]:
                products = []
                for coefficient, term in zip(row, terms, strict=True):
                    products.append(float(coefficient) * term)
                use = self.scip.quicksum(products)
                m.addCons(use <= beside[order])

        # No dilation makes room here for SCIP's tolerance: the limit itself is moved by it.
        for row in self._position_rows():
            products = []
            for coefficient, term in zip(row, terms, strict=True):
                products.append(float(coefficient) * term)
            beyond = self.scip.quicksum(products)
            size = np.abs(row).sum()
            tolerance = TOLERANCE * (1 + size)
            m.addCons(beyond <= float(tolerance))

        highest = high.sum() if cutoff is None else cutoff
        duration = self.scip.quicksum(t)
        m.setObjective(duration)
        m.addCons(duration <= float(highest))
        return m

    @staticmethod
    def _product(m: Any, a: Any, b: Any) -> Any:
        if isinstance(a, float) or isinstance(b, float):
            return 0.0
        z = m.addVar(lb=0.0)
        m.addCons(z == a * b)
        return z

    def improved(self, model: Any) -> Trajectory | None:
        """Impose the limits where SCIP's best times break them; those times, dilated."""
        if not model.getNSols():
            return None
        values = [model.getVal(t) for t in self.t]
        times = np.maximum(values, _NO_TIME) * self.unit
        self.instants.update(self._critical(times))
        times = self.spline.kept(times, self.times)
        k = self.spline.dilation(times)
        return self._along(k * times)


def _wider(limits: Array) -> Array:
    """The larger of both sides' sizes, `(joints, 1)`."""
    sizes = np.abs(limits).max(axis=1)
    return np.asarray(sizes[:, None])
