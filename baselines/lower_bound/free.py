"""Any trajectory under velocity and acceleration limits, nearly convex.

With `r ≤ 1/T`, both conditions of docs/mathematics.md, section 3, for a joint with displacement
`h ≥ 0` (mirror the joint if `h < 0`) are convex cones, because `D_up ≥ h` and `D_lo ≤ h` read

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
of `V`; see `_margin`.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines.exact.acceleration import Exact, Scaled, repair
from baselines.lower_bound.program import TOLERANCE, certified
from baselines.sizes import cells
from trajopt.exceptions import TrajoptError
from trajopt.problem import Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

# Variables and rows that make up one constraint for SCIP, each with that tolerance.
_HELPERS = 8
# SCIP branches on variables of higher priority first: only the segment times need it.
_TIME_PRIORITY = 1000
# Measured, per segment and moving joint: building the model, and a start of `exact`.
_MODEL_SECONDS = 1.5e-3
_START_SECONDS = 3e-3
_STARTS = 8


class Free:
    """Section 3, a convex program but for `r ≤ 1/T`; a time counts in its segment's stop time.

    Jerk and position limits are ignored, so the bound holds with them too.
    """

    exchanges = False

    def __init__(self, problem: Problem, scip: Any, *, seconds: float = np.inf) -> None:
        self.problem = problem.without("jerk", "position")
        self.scip = scip
        self.starts = _affordable_starts(problem, seconds)
        self.scaled = Scaled(self.problem)
        self.unit = self.scaled.unit
        self.shortest = _shortest_times(self.scaled)
        self.trivial_bound = float(self.shortest.sum()) * self.unit
        speeds = np.abs(self.scaled.v)
        self.margin = _margin(
            self.scaled.stop,
            self.shortest,
            float(speeds.min()),
        )

    @staticmethod
    def expected_seconds(problem: Problem) -> float:
        """What the model and one start of `exact` take about, s."""
        return (_MODEL_SECONDS + _START_SECONDS) * cells(problem)

    def incumbent(self) -> Trajectory:
        planner = Exact(starts=self.starts)
        answer = planner.solve(self.problem).trajectory
        if answer is None:
            raise TrajoptError("no trajectory to start from: IPOPT failed from every start")
        return certified(self.problem, answer)

    def model(self, cutoff: float | None) -> Any:
        """Variables: `T/S` and `S/T` of each segment, waypoint velocities, peaks."""
        m = self.scip.Model()
        stop = self.scaled.stop
        segments, joints = self.scaled.h.shape
        total = float(stop.sum())
        if cutoff is not None:
            total = min(cutoff, total)

        # the longest a segment may take: the total, less the others' shortest times
        shortest = self.shortest
        others = shortest.sum() - shortest
        longest = np.maximum(total - others, shortest)

        # t = T/S and r ≤ 1/t
        low = shortest / stop
        high = longest / stop
        self.t = _variables(m, low, high)
        self.r = _variables(m, 1 / high, 1 / low)

        # waypoint velocities, at rest at both ends
        slowest, fastest = self.scaled.v
        rest: list[Any] = [0.0] * joints
        self.ends = [rest]
        for _ in range(segments - 1):
            self.ends.append(_variables(m, slowest, fastest))
        self.ends.append(rest)

        for t, r in zip(self.t, self.r, strict=True):
            m.chgVarBranchPriority(t, _TIME_PRIORITY)
            m.addCons(r <= t**-1)
        spans = np.stack([shortest, longest], axis=1)
        for k, between in enumerate(spans.tolist()):
            for j in range(joints):
                self._reach(m, k, j, between)

        # Σ T = Σ S t
        times = []
        for size, t in zip(stop, self.t, strict=True):
            times.append(size * t)
        duration = self.scip.quicksum(times)
        m.setObjective(duration)
        m.addCons(duration <= total)
        return m

    def _reach(
        self,
        m: Any,
        k: int,
        j: int,
        between: list[float],
    ) -> None:
        """Joint `j` can cover segment `k`, seen in the direction it moves.

        `between` are the segment's shortest and longest times.
        """
        shortest, longest = between
        scaled = self.scaled
        displacement = scaled.h[k, j]
        h = abs(displacement)
        sign = 1 if displacement >= 0 else -1
        v1, v2 = np.abs(scaled.v[::sign, j])
        a1, a2 = np.abs(scaled.a[::sign, j])
        stop = float(scaled.stop[k])
        t = self.t[k]
        r = self.r[k]
        start = self.ends[k]
        end = self.ends[k + 1]
        u = sign * start[j]
        w = sign * end[j]

        # the mean velocity h/T lies between both peaks
        lowest_mean = h / longest
        highest_mean = h / shortest
        up = m.addVar(lb=lowest_mean, ub=v2)
        lo = m.addVar(lb=-v1, ub=min(v2, highest_mean))

        # max(u, w) ≤ p_up and p_lo ≤ min(u, w)
        up_u = up - u
        up_w = up - w
        lo_u = lo - u
        lo_w = lo - w
        for row in (up_u, up_w, u - lo, w - lo):
            m.addCons(row >= 0)

        # (A1 + A2) p_up ≤ A1 A2 T + A1 u + A2 w
        sum_a = a1 + a2
        gained = a1 * a2 * stop * t
        highest = gained + a1 * u + a2 * w
        m.addCons(sum_a * up <= highest)
        # (A1 + A2) p_lo ≥ A2 u + A1 w − A1 A2 T
        lowest = a2 * u + a1 * w - gained
        m.addCons(sum_a * lo >= lowest)

        # both cones of the module's docstring, over S²
        root2 = np.sqrt(2 * a2) * stop
        root1 = np.sqrt(2 * a1) * stop
        h_scaled = h / stop**2
        above = up / stop
        below = h_scaled * r - lo / stop
        upper_ramps = [up_u / root2, up_w / root1]
        lower_ramps = [lo_u / root1, lo_w / root2]
        _cone(
            m,
            above,
            t,
            upper_ramps,
            constant=h_scaled,
        )
        _cone(
            m,
            below,
            t,
            lower_ramps,
            constant=0.0,
        )

    def improved(self, model: Any) -> Trajectory | None:
        """SCIP's best solution, dilated until it is exactly reachable."""
        if not model.getNSols():
            return None
        scaled = self.scaled
        segments, joints = scaled.h.shape
        shares = [model.getVal(t) for t in self.t]
        times = scaled.stop * shares
        velocities = np.zeros((segments - 1, joints))
        for i, row in enumerate(self.ends[1:-1]):
            velocities[i] = [model.getVal(v) for v in row]
        k = repair(times, velocities, scaled)
        if not np.isfinite(k):
            return None
        reachable = scaled.trajectory(k * times, velocities / k)
        return certified(self.problem, reachable)


def trivial_bound(problem: Problem) -> float:
    """The sum of each segment's shortest time, whatever its ends: needs no solver, s."""
    scaled = Scaled(problem.without("jerk", "position"))
    shortest = _shortest_times(scaled)
    return float(shortest.sum()) * scaled.unit


def _variables(m: Any, low: Array, high: Array) -> list[Any]:
    """A variable of SCIP's for each pair of bounds."""
    variables = []
    for lb, ub in zip(low, high, strict=True):
        variable = m.addVar(lb=lb, ub=ub)
        variables.append(variable)
    return variables


def _affordable_starts(problem: Problem, seconds: float) -> int:
    """Starts of `exact` in half the time at most, but one at least."""
    start_seconds = _START_SECONDS * cells(problem)
    fitting = 0.5 * seconds / start_seconds
    return int(np.clip(fitting, 1, _STARTS))


def _shortest_times(scaled: Scaled) -> Array:
    """Least times of all segments with free ends, but rest at the motion's own ends."""
    from_rest = _from_rest(scaled)
    return np.asarray(np.maximum(scaled.shortest, from_rest))


def _from_rest(scaled: Scaled) -> Array:
    """Least times of the first and the last segment, rest at one end and free at the other."""
    least = np.zeros(len(scaled.stop))
    v1, v2 = np.abs(scaled.v)
    a1, a2 = np.abs(scaled.a)
    # the first segment speeds up with its own side's limit, the last brakes with the other's
    first = (0, a2, a1)
    last = (-1, a1, a2)
    for k, forward_limit, backward_limit in (first, last):
        displacement = scaled.h[k]
        forwards = displacement >= 0
        h = np.abs(displacement)
        a = np.where(forwards, forward_limit, backward_limit)
        v = np.where(forwards, v2, v1)
        # h = a T²/2 while a T ≤ v, else h = v T − v²/(2a)
        parabola = np.sqrt(2 * h / a)
        ramp = h / v + v / (2 * a)
        slow = 2 * a * h <= v**2
        times = np.where(slow, parabola, ramp)
        least[k] = max(least[k], times.max())
    return least


def _margin(stop: Array, shortest: Array, slowest: float) -> float:
    """What SCIP's tolerance can be worth, relative, from the segments' stop and shortest times.

    The bump of velocity stays in its segment (module docstring), or a constant one fills the
    segment and fades in the neighbours as `c (3τ² − 2τ)`, without displacement there and with
    acceleration `4c/T`. Every segment meets at most its own and its neighbours'.
    """
    slack = _HELPERS * TOLERANCE
    ratio = stop / shortest

    # acceleration of a bump that stays in its segment: ε S/T for the step, 4ε S²/T² for the way
    bending = ratio + 4 * ratio**2
    own = slack * bending

    # of one that fades in the neighbours: 4c/T, where nothing fades if the motion rests
    longer = 1 + ratio
    bump = 2 * slack * stop * longer
    padded = np.r_[0.0, shortest, 0.0]
    before = padded[:-2]
    after = padded[2:]
    briefer = np.minimum(before, after)
    with np.errstate(divide="ignore"):
        faded = 4 * bump / briefer

    # a dilation by 1 + ρ gives acceleration 2ρ and velocity ρ
    easier = np.minimum(own, faded)
    acceleration = 3 * easier.max()
    lifted = slack + 3 * bump.max()
    velocity = lifted / slowest
    return float(max(acceleration / 2, velocity))


def _cone(
    m: Any,
    x: Any,
    t: Any,
    parts: list[Any],
    constant: float,
) -> None:
    """`x t ≥ Σ parts² + constant` with `x, t ≥ 0`, with variables of its own: SCIP sees a cone."""
    # ((x + t)/2)² − ((x − t)/2)² = x t
    total = m.addVar(lb=0.0)
    difference = m.addVar(lb=None)
    m.addCons(2 * total == x + t)
    m.addCons(2 * difference == x - t)
    own = [m.addVar(lb=None) for _ in parts]
    for variable, part in zip(own, parts, strict=True):
        m.addCons(variable == part)
    squares = difference * difference
    squares += sum(variable * variable for variable in own)
    m.addCons(squares + constant <= total * total)
    m.addCons(x >= 0)
