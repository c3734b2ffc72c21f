"""The exact minimum time with velocity and acceleration limits (mathematics, section 3).

No discretisation. For one joint over one segment of time `T` with end velocities `u`, `w`, the
displacements that the limits allow fill an interval `[D_lo, D_up]`; its ends come from speeding up
to a peak `p`, cruising and braking. With the peaks as variables the minimum-time problem is a small
smooth NLP over segment times, waypoint velocities and peaks. It is not convex, so IPOPT starts from
several points of its own, and the answer is the best known, not a proof.

    from baselines.exact.acceleration import Exact
    solution = Exact().solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from baselines.ipopt import Program, flat, no_start_succeeded, optima, program
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, Relation, backend, passing_once
from trajopt.problem import LimitName, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]

IPOPT: dict[str, float | str] = {
    "tol": 1e-11,
    "constr_viol_tol": 1e-10,
    "acceptable_tol": 1e-8,
    "bound_relax_factor": 0.0,
    "mu_strategy": "adaptive",
    "max_iter": 1000,
}

_IGNORED: tuple[LimitName, ...] = ("jerk", "position")
_PATIENCE = 5  # times as many starts where all have failed so far
_MISSED = 1e-9  # of the way a joint travels: more than rounding
_ROUNDING = 1e-15  # of a velocity
_SLIVER = 1e-9  # of a segment: pieces that short come from IPOPT's tolerance, not from the optimum


@dataclass(frozen=True)
class Exact(Planner):
    """Exact minimum time under velocity and acceleration limits (CasADi/IPOPT, several starts)."""

    starts: int = 8

    requires = ("casadi",)

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidInput("starts", "at least 1", value=self.starts)

    def relation(self, problem: Problem) -> Relation:
        """Jerk and position limits are ignored, so with them the answer is a lower bound."""
        return Relation.RELAXATION if any(map(problem.has, _IGNORED)) else Relation.SAME

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best local optimum of `starts`, or of more where all of those failed.

        `stats`: each start's IPOPT status and duration (s, infinite where it failed).
        """
        scaled, began = Scaled(problem), time.perf_counter()
        solver = _solver(*scaled.h.shape)
        setup_time = time.perf_counter() - began
        starts = starting_points(scaled, _PATIENCE * self.starts)
        found = optima(lambda start: _solve_from(solver, scaled, start), starts, self.starts)
        best = min(found, key=lambda optimum: optimum.duration)
        statuses = [optimum.status for optimum in found]
        durations = scaled.unit * np.array([optimum.duration for optimum in found])
        stats = {"start_status": statuses, "start_duration": durations}
        if not np.isfinite(best.duration):
            message = no_start_succeeded(statuses)
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        answer = scaled.trajectory(best.times, best.velocities)
        bound, message = None, ""
        if self.relation(problem) is Relation.RELAXATION:
            bound = verify(problem.without(*_IGNORED), answer).certified_duration
            ignored = " and ".join(name for name in _IGNORED if problem.has(name))
            message = f"{ignored} limits are ignored: a lower bound (best known, not proved)"
        return Solution(Status.SOLVED, answer, message, bound, setup_time=setup_time, stats=stats)


@dataclass(frozen=True)
class _Optimum:
    """What IPOPT found from one start, exactly reachable; infinite duration if nothing."""

    duration: float
    times: Array
    velocities: Array
    status: str


class Scaled:
    """The moving joints without units: time in mean stop times, tighter acceleration limit 1.

    `h` is `(segments, joints)`; the velocity and acceleration limits `v`, `a` are `(2, joints)`.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.moving = problem, problem.moving
        limits, stop = problem.limits, stop_times(problem.without(*_IGNORED))
        self.unit = float(stop.mean())
        tighter = np.abs(limits.acceleration[self.moving]).min(axis=1)
        # of acceleration, velocity and position
        self.units = tighter * self.unit ** np.arange(3)[:, None]
        self.a = limits.acceleration[self.moving].T / self.units[0]
        self.v = limits.velocity[self.moving].T / self.units[1]
        self.h = problem.displacements[:, self.moving] / self.units[2]
        self.stop = stop / self.unit
        self.least = np.maximum(self.h / self.v[1], self.h / self.v[0]).max(axis=1)

    def trajectory(self, times: Array, velocities: Array) -> Trajectory:
        """The explicit answer: in each segment a convex combination of both extreme profiles."""
        breaks = np.r_[0.0, np.cumsum(times)] * self.unit
        joints = [(breaks[[0, -1]], np.array([[start]])) for start in self.problem.waypoints[0]]
        for i, joint in enumerate(np.flatnonzero(self.moving)):
            waypoints = self.problem.waypoints[:, joint]
            joints[joint] = self._joint(i, waypoints, breaks, times, velocities)
        return Trajectory.joined(joints, breaks)

    def _joint(
        self, i: int, waypoints: Array, breaks: Array, times: Array, velocities: Array
    ) -> tuple[Array, Array]:
        """Breaks (s) and coefficients (rad/s^power) of one moving joint."""
        ends, starts, parts = _with_rest(velocities)[:, i], [], []
        for k, t in enumerate(times):
            limits = self.v[:, i], self.a[:, i]
            local, part = combined(ends[k], ends[k + 1], t, self.h[k, i], *limits)
            part *= self.units[:, i, None]
            part[2] += waypoints[k]
            starts.append(breaks[k] + local[:-1] * self.unit)
            parts.append(part)
        return np.r_[np.concatenate(starts), breaks[-1]], np.hstack(parts)


def _with_rest(velocities: Array) -> Array:
    """Waypoint velocities with rest at both ends, `(segments + 1, joints)`."""
    return np.pad(velocities, ((1, 1), (0, 0)))


def extremes(u: Array, w: Array, t: Array, v: Array, a: Array) -> tuple[Array, Array, Array, Array]:
    """Peaks and displacements of the extreme profiles: `p_up, D_up, p_lo, D_lo`.

    From velocity `u` to `w` in time `t` under velocity limits `v = (low, high)` and acceleration
    limits `a = (low, high)`, all broadcasting. Meaningful where `|w − u|` is within the limits.
    """
    (v1, v2), (a1, a2) = (-v[0], v[1]), (-a[0], a[1])
    up = np.minimum(v2, (a1 * a2 * t + a1 * u + a2 * w) / (a1 + a2))
    lo = np.maximum(-v1, (a2 * u + a1 * w - a1 * a2 * t) / (a1 + a2))
    d_up = up * t - (up - u) ** 2 / (2 * a2) - (up - w) ** 2 / (2 * a1)
    d_lo = lo * t + (lo - u) ** 2 / (2 * a1) + (lo - w) ** 2 / (2 * a2)
    return up, d_up, lo, d_lo


def combined(u: float, w: float, t: float, h: float, v: Array, a: Array) -> tuple[Array, Array]:
    """Breaks and position coefficients (3, pieces) of the profile that covers exactly `h`."""
    up, d_up, lo, d_lo = map(float, extremes(np.asarray(u), np.asarray(w), np.asarray(t), v, a))
    wide = d_up - d_lo > 1e-15 * (abs(d_up) + abs(d_lo))
    share = float(np.clip((h - d_lo) / (d_up - d_lo), 0.0, 1.0)) if wide else 1.0
    knots = np.clip(
        [(up - u) / a[1], t + (up - w) / a[0], (lo - u) / a[0], t + (lo - w) / a[1]], 0, t
    )
    for apart in (_SLIVER * t, 0.0):
        local = _apart(np.r_[0.0, knots, t], apart)
        upper = np.interp(local, [0, *knots[:2], t], [u, up, up, w])
        lower = np.interp(local, [0, *knots[2:], t], [u, lo, lo, w])
        speed, lengths = share * upper + (1 - share) * lower, np.diff(local)
        slope = np.diff(speed) / lengths
        travelled = np.cumsum(lengths * (speed[:-1] + speed[1:]) / 2)
        missed = abs(travelled[-1] - h) > _MISSED * (lengths @ np.abs(speed[:-1] + speed[1:]))
        if not missed and (slope / np.where(slope > 0, a[1], a[0]) <= 1 + _SLIVER).all():
            break  # else what was left out mattered
    slope = np.clip(slope, *a)  # over a brief piece, rounding of the speeds shows
    return local, np.stack([slope / 2, speed[:-1], np.r_[0.0, travelled[:-1]]])


def _apart(times: Array, least: float) -> Array:
    """The times in order, both ends among them, without those that follow another too closely."""
    times = np.unique(times)
    inner = times[1:-1][(np.diff(times)[:-1] > least) & (times[-1] - times[1:-1] > least)]
    return np.asarray(np.r_[times[0], inner, times[-1]])


def repair(times: Array, velocities: Array, scaled: Scaled) -> float:
    """The smallest dilation that makes times and waypoint velocities exactly reachable.

    IPOPT meets its constraints to a tolerance; dilating by `k` multiplies the velocity limits by
    `k` and the accelerations by `k²`, which widens every reachable interval. In the briefest
    segments velocities differ by less than their rounding, which no dilation mends: let it be.
    """
    ends = _with_rest(velocities)
    u, w, t, h = ends[:-1], ends[1:], times[:, None], scaled.h
    spare = _ROUNDING * (np.abs(u) + np.abs(w))

    def reachable(k: float) -> bool:
        v, a = scaled.v * k, scaled.a * k**2
        _, d_up, _, d_lo = extremes(u, w, t, v[:, None], a[:, None])
        kept = (v[0] <= ends) & (ends <= v[1])
        steps = (a[0] * t - spare <= w - u) & (w - u <= a[1] * t + spare)
        reached = (d_lo - h <= spare * t) & (h - d_up <= spare * t)
        return bool(kept.all() and (steps & reached).all())

    low, high = 1.0, 1.0 + 1e-15
    while not reachable(high):
        low, high = high, 1 + 4 * (high - 1)
        if high > 2:
            return np.inf
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reachable(middle) else (middle, high)
    return high


@cache
def _solver(segments: int, joints: int) -> Program:
    """IPOPT for all problems of this size, built once; the numbers are parameters.

    Some segments are a billion times as long as others. So `u`, `w` and the peaks count from the
    segment's mean velocity, in units of `T` (the acceleration limit is 1), and `T` logarithmically:
    then what they can reach is of order one, whatever its length.
    """
    ca = backend("casadi")
    log, v = ca.MX.sym("log", segments), ca.MX.sym("v", segments - 1, joints)
    u, w, up, lo = (ca.MX.sym(name, segments, joints) for name in ("u", "w", "up", "lo"))
    h, stop = ca.MX.sym("h", segments, joints), ca.MX.sym("stop", segments)
    limits = [ca.MX.sym(name, 1, joints) for name in ("v1", "v2", "a1", "a2", "top")]
    # every constraint as a (segments, joints) matrix
    v1, v2, a1, a2, top = (ca.repmat(limit, segments, 1) for limit in limits)
    rest, times = ca.MX.zeros(1, joints), stop * ca.exp(log)
    t = ca.repmat(times, 1, joints)
    mean = h / t
    joined = [mean + t * u - ca.vertcat(rest, v), mean + t * w - ca.vertcat(v, rest)]
    free = [v2 - mean - t * up, mean + t * lo - v1]
    reached = [
        a2 - (w - u),
        a1 + (w - u),
        up - (up - u) ** 2 / (2 * a2) - (up - w) ** 2 / (2 * a1),
        -lo - (lo - u) ** 2 / (2 * a1) - (lo - w) ** 2 / (2 * a2),
    ]
    rows = [*(row / top for row in joined + free), *reached, ca.sum1(stop - times)]
    return program(
        "exact",
        variables=(log, v, u, w, up, lo),
        parameters=(h, stop, *limits),
        objective=ca.sum1(times),
        constraints=rows,
        options=IPOPT,
    )


def starting_points(scaled: Scaled, count: int) -> Iterator[tuple[Array, Array]]:
    """Times and waypoint velocities to start from: generous stopping first, then random ones."""
    segments, joints = scaled.h.shape
    rng = np.random.default_rng(0)
    yield 1.5 * scaled.stop, np.zeros((segments - 1, joints))
    for _ in range(count - 1):
        times = scaled.stop * rng.uniform(0.5, 1.5, segments)
        slopes = scaled.h / times[:, None]
        mix = rng.uniform(size=(segments - 1, joints))
        between = mix * slopes[:-1] + (1 - mix) * slopes[1:]
        yield times, between * rng.uniform(0, 1.5, (segments - 1, 1))


def _solve_from(solver: Program, scaled: Scaled, start: tuple[Array, Array]) -> _Optimum:
    """One run of IPOPT, its answer dilated until it is exactly reachable."""
    low, high = _bounds(scaled)
    x0 = np.clip(_point(scaled, *start), low, high)
    top = np.minimum(np.abs(scaled.v).max(axis=0), scaled.stop.sum())  # velocities are below it
    p = flat(scaled.h, scaled.stop, *scaled.v, *np.abs(scaled.a), top)
    most = np.r_[np.zeros(2 * scaled.h.size), np.full(6 * scaled.h.size + 1, np.inf)]
    run = solver(x0, p, (low, high), (0.0, most))
    times, velocities = _read(scaled, run.x)
    k = repair(times, velocities, scaled) if run.success else np.inf
    return _Optimum(k * float(times.sum()), k * times, velocities / k, run.status)


def _point(scaled: Scaled, times: Array, velocities: Array) -> Array:
    """IPOPT's variables for times and waypoint velocities, which need not be reachable."""
    ends, t = _with_rest(velocities), times[:, None]
    u, w = ((part - scaled.h / t) / t for part in (ends[:-1], ends[1:]))
    up, lo = np.maximum(np.maximum(u, w), 0.0), np.minimum(np.minimum(u, w), 0.0)
    return flat(np.log(times / scaled.stop), velocities, u, w, up, lo)


def _read(scaled: Scaled, x: Array) -> tuple[Array, Array]:
    """Times and waypoint velocities from IPOPT's variables; the briefer segment knows better."""
    segments, joints = scaled.h.shape
    times = scaled.stop * np.exp(x[:segments])
    ends = x[segments + (segments - 1) * joints :].reshape(-1, joints, segments)[:2]
    u, w = scaled.h / times[:, None] + times[:, None] * ends.swapaxes(1, 2)
    return times, np.where((times[:-1] < times[1:])[:, None], w[:-1], u[1:])


def _bounds(scaled: Scaled) -> tuple[Array, Array]:
    """Bounds of all variables; no segment takes longer than stopping everywhere does.

    From the mean velocity, none strays further than half a limit does in the segment's time.
    """
    least, longest = (np.log(t / scaled.stop) for t in (scaled.least, scaled.stop.sum()))
    (a1, a2), wide = scaled.a / 2, np.diff(scaled.a, axis=0)[0] / 2
    both = [-a2, a1, 0 * wide, -wide], [-a1, a2, wide, 0 * wide]  # u, w, up, lo
    every = np.ones((len(least), 1))
    sides = zip((least, longest), scaled.v, both, strict=True)
    low, high = (flat(t, every[1:] * v, *(every * x for x in bounds)) for t, v, bounds in sides)
    return low, high
