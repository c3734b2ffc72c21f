"""The best 3-5-3 spline with shared segment times, by CasADi/IPOPT.

Three variables (the logarithms of the segment times) and limits that hold at every instant: they
are imposed at a few instants of each joint, the true worst instants of the answer replace the idle
ones among them, and the solver runs again until no limit is broken in between (the exchange method
of semi-infinite programming). The answer is dilated by its exact factor, which by then is 1 to
rounding. Only the ratios of the times matter (mathematics, section 2), so the starts are the local
minima of a grid over both ratios.

    from baselines.spline353_nlp import Spline353NLP
    solution = Spline353NLP().solve(problem)
    print(solution.trajectory.duration, solution.stats["segment_times"])
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass
from functools import cache
from math import comb
from typing import Any

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

from trajopt import polynomials, spline353
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, backend, passing_once
from trajopt.problem import Limits, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status

Array = NDArray[np.float64]

IPOPT = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11, "acceptable_tol": 1e-8, "max_iter": 300},
}
_INSTANTS = 11  # per joint and limit; evenly spread at first
_ROUNDS = 20
_ENOUGH = 1e-10  # excess dilation at which the exchange has converged
_LOG_RATIOS = np.linspace(-10.0, 10.0, 61)  # of the outer segment times to the middle one


@dataclass(frozen=True)
class Spline353NLP(Planner):
    """The best 3-5-3 spline with shared times (CasADi/IPOPT, limits at every instant)."""

    starts: int = 4

    requires = ("casadi",)

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidInput("starts", "at least 1", value=self.starts)

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of several local optima. `stats`: segment times; each start's outcome (s)."""
        spline, began = Spline(problem), time.perf_counter()
        solver = _solver(*spline.size)
        setup_time = time.perf_counter() - began
        found = [
            _exchange(solver, spline, start) for start in _starts(spline, problem, self.starts)
        ]
        durations = np.array([times.sum() for times, _ in found])
        stats: dict[str, Any] = {
            "start_status": [status for _, status in found],
            "start_duration": durations,
        }
        times = found[int(np.nanargmin(durations))][0] if np.isfinite(durations).any() else None
        if times is None:
            message = f"no start succeeded: {', '.join(sorted(set(stats['start_status'])))}"
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        answer = spline353.trajectory(problem, times)
        stats["segment_times"] = times
        return Solution(Status.SOLVED, answer, setup_time=setup_time, stats=stats)


class Spline:
    """The moving joints of a problem."""

    def __init__(self, problem: Problem) -> None:
        moving, limits = problem.moving, problem.limits
        kinds = (limits.velocity, limits.acceleration, limits.jerk)
        self.limits = Limits(*(x[moving] for x in kinds))
        self.displacements = problem.displacements.T[moving]
        orders = 3 if problem.has("jerk") else 2
        self.bounds = [x[moving] for x in kinds[:orders]]
        self.size = (int(moving.sum()), orders)

    def dilation(self, times: Array) -> float:
        return float(spline353.dilation(self.displacements, times, self.limits))

    def rates(self, times: Array) -> list[Array]:
        """Velocity, acceleration (and jerk) over the quintic, on the unit interval of time."""
        unit = polynomials.stretched(
            spline353.coefficients(self.displacements, times)[1].T, times[1]
        )
        orders = range(1, len(self.bounds) + 1)
        return [polynomials.derivative(unit, k) / times[1] ** k for k in orders]

    def exchanged(self, times: Array, instants: list[Array]) -> list[Array]:
        """The instants `(k, joints)` of each limit, the idlest replaced by the true worst one."""
        return [
            _replace_idlest(rate, bounds.T, old)
            for rate, bounds, old in zip(self.rates(times), self.bounds, instants, strict=True)
        ]


def _replace_idlest(rate: Array, bounds: Array, instants: Array) -> Array:
    def use(points: Array) -> Array:
        values = polynomials.evaluate(rate[:, None], points)
        return np.asarray(np.maximum(values / bounds[1], values / bounds[0]))

    points, new, joints = (
        polynomials.critical_points(rate),
        instants.copy(),
        np.arange(rate.shape[1]),
    )
    new[1 + use(instants)[1:-1].argmin(axis=0), joints] = points[use(points).argmax(axis=0), joints]
    return new


def _starts(spline: Spline, problem: Problem, count: int) -> list[Array]:
    """Feasible segment times to start from: the best local minima of a grid over their ratios."""
    first, last = np.meshgrid(_LOG_RATIOS, _LOG_RATIOS, indexing="ij")
    times = np.exp(np.stack([first, np.zeros_like(first), last], axis=-1))
    times *= stop_times(problem)
    times *= spline353.dilation(spline.displacements, times[..., None, :], spline.limits)[..., None]
    total = times.sum(axis=-1)
    lowest = total <= scipy.ndimage.minimum_filter(total, size=3, mode="nearest")
    best = np.argsort(total[lowest])[:count]
    return list(times[lowest][best])


def _exchange(solver: Any, spline: Spline, times: Array) -> tuple[Array, str]:
    """Feasible segment times (NaN if none) and IPOPT's last status, from one start."""
    best, status = np.full(3, np.nan), ""
    even = np.linspace(0.0, 1.0, _INSTANTS)[:, None] + np.zeros(spline.size[0])
    instants = [even for _ in spline.bounds]
    for _ in range(_ROUNDS):
        instants = spline.exchanged(times, instants)
        times, status, ok = _solve_at(solver, spline, times, instants)
        if not ok:
            break
        k = spline.dilation(times)
        best = best if k * times.sum() >= best.sum() else k * times
        if k - 1 < _ENOUGH:
            break
    return best, status


def _solve_at(
    solver: Any, spline: Spline, times: Array, instants: list[Array]
) -> tuple[Array, str, bool]:
    """One NLP from `times`, its limits imposed at these instants."""
    unit = float(times.mean())
    scaled = [1 / (bounds * unit**order) for order, bounds in enumerate(spline.bounds, start=1)]
    p = np.concatenate([x.ravel("F") for x in (spline.displacements, *scaled, *instants)])
    y = np.log(times / unit)
    result = solver(x0=y, p=p, lbx=y - 12, ubx=y + 5, lbg=-np.inf, ubg=1.0)
    stats = solver.stats()
    found = np.exp(np.asarray(result["x"]).ravel()) * unit
    return found, str(stats["return_status"]), bool(stats["success"])


@cache
def _solver(joints: int, orders: int) -> Any:
    """IPOPT for this many joints, limited up to this derivative; built once for all problems.

    Every constraint reads "value over its limit is at most 1", for both sides of every limit; an
    infinite limit has a reciprocal of zero.
    """
    ca = backend("casadi")
    d, y = ca.MX.sym("d", joints, 3), ca.MX.sym("y", 3)
    reciprocals = [ca.MX.sym(f"limit{order}", joints, 2) for order in range(1, orders + 1)]
    instants = [ca.MX.sym(f"s{order}", _INSTANTS, joints) for order in range(1, orders + 1)]
    t = ca.exp(y)
    d1, h, d3 = ca.horzsplit(d)
    v0, a0, v1, a1 = 3 * d1 / t[0], 6 * d1 / t[0] ** 2, 3 * d3 / t[2], -6 * d3 / t[2] ** 2
    rise = 20 * h / t[1] ** 2
    velocity = [
        v0,
        v0 + a0 * t[1] / 4,
        5 * h / t[1] - 2 * (v0 + v1) + (a1 - a0) * t[1] / 4,
        v1 - a1 * t[1] / 4,
        v1,
    ]
    acceleration = [
        a0,
        rise - (12 * v0 + 8 * v1) / t[1] + a1 - 2 * a0,
        -rise + (8 * v0 + 12 * v1) / t[1] - 2 * a1 + a0,
        a1,
    ]
    jerk = [3 * (b - a) / t[1] for a, b in itertools.pairwise(acceleration)]
    use = []
    for controls, limit, s in zip(
        (velocity, acceleration, jerk), reciprocals, instants, strict=False
    ):
        values = _bernstein([ca.repmat(c.T, _INSTANTS, 1) for c in controls], s)
        use += [values * ca.repmat(limit[:, side].T, _INSTANTS, 1) for side in (0, 1)]
    if orders == 3:  # the cubics' constant jerk
        use += [
            6 * x * reciprocals[2]
            for x in (ca.repmat(d1 / t[0] ** 3, 1, 2), ca.repmat(d3 / t[2] ** 3, 1, 2))
        ]
    g = ca.vertcat(*map(ca.vec, use))
    p = ca.vertcat(*map(ca.vec, (d, *reciprocals, *instants)))
    return ca.nlpsol("spline353", "ipopt", {"x": y, "p": p, "f": ca.sum1(t), "g": g}, IPOPT)


def _bernstein(controls: list[Any], s: Any) -> Any:
    """Values of Bernstein polynomials with these coefficients at `s`."""
    n = len(controls) - 1
    return sum(comb(n, i) * c * (s**i * (1 - s) ** (n - i)) for i, c in enumerate(controls))
