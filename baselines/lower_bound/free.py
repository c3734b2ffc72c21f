"""Any trajectory under velocity and acceleration limits (mathematics, section 3), nearly convex.

With `r ≤ 1/T`, both conditions of a joint with displacement `h ≥ 0` (mirror the joint if `h < 0`)
are convex cones, because `D_up ≥ h` and `D_lo ≤ h` read

    p_up T ≥ h + (p_up − u)²/(2 A2) + (p_up − w)²/(2 A1),
    (h r − p_lo) T ≥ (p_lo − u)²/(2 A1) + (p_lo − w)²/(2 A2).

At `r = 1/T` they are section 3 itself, and a smaller `r` only restricts. So `r ≤ 1/T`, one scalar
relation per segment, is all that is not convex: SCIP branches on the segment times only, however
many joints there are.

SCIP is trusted to `TOLERANCE` (1e-9) in each scaled constraint and helper variable, whichever way.
A dilation by `1 + ρ` gives every constraint that much slack, so the bound is divided by `1 + ρ`. A
velocity limit, a step of velocity and a displacement may each be off by ε (in units of the limits,
of `A S`, and of `A S²`, with `S` the segment's time of stopping and `T` its least time). A bump of
velocity over the segment makes up the displacement; it takes `4ε S²/T²` of `A` and `2ε A S²/(T V)`
of `V`; see `_worth`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.exact.acceleration import Exact, Scaled, repair
from baselines.lower_bound.program import TOLERANCE, certified
from trajopt.exceptions import TrajoptError
from trajopt.problem import Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

_HELPERS = 8  # variables and rows that make up one constraint for SCIP, each with that tolerance


class Free:
    """Section 3, a convex program but for `r ≤ 1/T`; a time counts in its segment's stop time.

    Jerk and position limits are ignored, so the bound holds with them too.
    """

    exchanges = False

    def __init__(self, problem: Problem, scip: Any) -> None:
        self.problem, self.scip = problem.without("jerk", "position"), scip
        self.scaled = Scaled(self.problem)
        self.unit, stop = self.scaled.unit, self.scaled.stop
        self.shortest = np.maximum(self.scaled.least, _from_rest(self.scaled))
        self.least = float(self.shortest.sum()) * self.unit
        self.worth = _worth(stop, self.shortest, float(np.abs(self.scaled.v).min()))

    def incumbent(self) -> Trajectory:
        answer = Exact().solve(self.problem).trajectory
        if answer is None:
            raise TrajoptError("no trajectory to start from: IPOPT failed from every start")
        return certified(self.problem, answer)

    def model(self, cutoff: float | None) -> Any:
        """Variables: `T/S` and `S/T` of each segment, waypoint velocities, peaks."""
        m, stop, (segments, joints) = self.scip.Model(), self.scaled.stop, self.scaled.h.shape
        total = stop.sum() if cutoff is None else min(cutoff, stop.sum())
        shortest = self.shortest
        longest = np.maximum(total - (shortest.sum() - shortest), shortest)
        pairs = list(zip(shortest / stop, longest / stop, strict=True))
        self.t = [m.addVar(lb=low, ub=high) for low, high in pairs]
        self.r = [m.addVar(lb=1 / high, ub=1 / low) for low, high in pairs]
        v = [[m.addVar(lb=a, ub=b) for a, b in self.scaled.v.T] for _ in range(segments - 1)]
        self.ends = [[0.0] * joints, *v, [0.0] * joints]
        for t, r in zip(self.t, self.r, strict=True):
            m.chgVarBranchPriority(t, 1000)
            m.addCons(r <= t**-1)
        for k, j in np.ndindex(segments, joints):
            self._reach(m, k, j, (shortest[k], longest[k]))
        m.setObjective(
            duration := self.scip.quicksum(s * t for s, t in zip(stop, self.t, strict=True))
        )
        m.addCons(duration <= float(total))
        return m

    def _reach(self, m: Any, k: int, j: int, between: tuple[float, float]) -> None:
        """Joint `j` can cover segment `k`, seen in the direction it moves."""
        sign, h, s = (1 if self.scaled.h[k, j] >= 0 else -1), abs(self.scaled.h[k, j]), self.scaled
        (v1, v2), (a1, a2) = (np.abs(x[::sign, j]) for x in (s.v, s.a))
        u, w, t, r, stop = sign * self.ends[k][j], sign * self.ends[k + 1][j], *self._times(k)
        up = m.addVar(lb=h / between[1], ub=v2)
        lo = m.addVar(lb=-v1, ub=min(v2, h / between[0]))
        for row in (up - u, up - w, u - lo, w - lo):
            m.addCons(row >= 0)
        m.addCons((a1 + a2) * up <= a1 * a2 * stop * t + a1 * u + a2 * w)
        m.addCons((a1 + a2) * lo >= a2 * u + a1 * w - a1 * a2 * stop * t)
        b1, b2 = np.sqrt([2 * a1, 2 * a2]) * stop
        _cone(m, up / stop, t, [(up - u) / b2, (up - w) / b1], h / stop**2)
        _cone(m, h / stop**2 * r - lo / stop, t, [(lo - u) / b1, (lo - w) / b2], 0.0)

    def _times(self, k: int) -> tuple[Any, Any, float]:
        return self.t[k], self.r[k], float(self.scaled.stop[k])

    def learn(self, model: Any) -> Trajectory | None:
        """SCIP's best solution, dilated until it is exactly reachable."""
        if not model.getNSols():
            return None
        times = self.scaled.stop * [model.getVal(t) for t in self.t]
        velocities = np.array([[model.getVal(v) for v in row] for row in self.ends[1:-1]])
        velocities = velocities.reshape(len(times) - 1, self.scaled.h.shape[1])
        k = repair(times, velocities, self.scaled)
        if not np.isfinite(k):
            return None
        return certified(self.problem, self.scaled.trajectory(k * times, velocities / k))


def _worth(stop: Array, least: Array, slowest: float) -> float:
    """What SCIP's tolerance can be worth, relative, from the segments' stop and least times.

    The bump of velocity stays in its segment (module docstring), or a constant one fills the
    segment and fades in the neighbours as `c (3τ² − 2τ)`, without displacement there and with
    acceleration `4c/T`. Every segment meets at most its own and its neighbours'.
    """
    slack, ratio = _HELPERS * TOLERANCE, stop / least
    own = slack * (ratio + 4 * ratio**2)
    bump = 2 * slack * stop * (1 + ratio)
    padded = np.r_[0.0, least, 0.0]  # nothing fades where the motion rests
    with np.errstate(divide="ignore"):
        faded = 4 * bump / np.minimum(padded[:-2], padded[2:])
    acceleration = 3 * np.minimum(own, faded).max()
    return float(max(acceleration / 2, (slack + 3 * bump.max()) / slowest))


def _from_rest(scaled: Scaled) -> Array:
    """Least times of the first and the last segment, rest at one end and free at the other."""
    least, ends = np.zeros(len(scaled.stop)), ((0, 1), (-1, 0))
    for k, side in ends:
        h = scaled.h[k]
        towards = np.where(h >= 0, side, 1 - side)
        a = np.abs(scaled.a)[towards, np.arange(len(h))]
        v = np.where(h >= 0, scaled.v[1], -scaled.v[0])
        ramp = np.abs(h) / v + v / (2 * a)
        times = np.where(2 * a * np.abs(h) <= v**2, np.sqrt(2 * np.abs(h) / a), ramp)
        least[k] = max(least[k], times.max())
    return least


def _cone(m: Any, x: Any, t: Any, parts: list[Any], constant: float) -> None:
    """`x t ≥ Σ parts² + constant` with `x, t ≥ 0`, with variables of its own: SCIP sees a cone."""
    total, difference = m.addVar(lb=0.0), m.addVar(lb=None)
    m.addCons(2 * total == x + t)
    m.addCons(2 * difference == x - t)
    own = [m.addVar(lb=None) for _ in parts]
    for variable, part in zip(own, parts, strict=True):
        m.addCons(variable == part)
    squares = difference * difference + sum(variable * variable for variable in own)
    m.addCons(squares + constant <= total * total)
    m.addCons(x >= 0)
