"""The exact minimum time with velocity and acceleration limits (mathematics, section 3).

No discretisation. For one joint over one segment of time `T` with end velocities `u`, `w`, the
displacements that the limits allow fill an interval `[D_lo, D_up]`; its ends come from speeding up
to a peak `p`, cruising and braking. With the peaks as variables the minimum-time problem is a small
smooth NLP over segment times, waypoint velocities and peaks. It is not convex, so IPOPT starts from
several points of its own, and the answer is the best known, not a proof.

    from baselines.exact_nlp import Exact
    solution = Exact().solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from trajopt.exceptions import InvalidInput
from trajopt.planner import Relation, backend, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.stopping import stop_times
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]

IPOPT = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt": {
        "print_level": 0,
        "sb": "yes",
        "tol": 1e-10,
        "constr_viol_tol": 1e-10,
        "acceptable_tol": 1e-8,
        "bound_relax_factor": 0.0,
        "max_iter": 1000,
    },
}


@dataclass(frozen=True)
class Exact:
    """Exact minimum time under velocity and acceleration limits (CasADi/IPOPT, several starts)."""

    starts: int = 8

    requires: ClassVar[tuple[str, ...]] = ("casadi",)

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidInput("starts", "at least 1", value=self.starts)

    def relation(self, problem: Problem) -> Relation:
        """Jerk and position limits are ignored, so with them the answer is a lower bound."""
        ignored = problem.has("jerk") or problem.has("position")
        return Relation.RELAXATION if ignored else Relation.SAME

    def unsupported(self, problem: Problem) -> str | None:
        return None

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of several local optima. `stats`: each start's IPOPT status and duration (s)."""
        scaled, began = _Scaled(problem), time.perf_counter()
        solver = _solver(scaled.h.shape[0], scaled.h.shape[1])
        setup_time = time.perf_counter() - began
        found = [_solve_from(solver, scaled, start) for start in _starts(scaled, self.starts)]
        durations = [d for d, *_ in found]
        stats = {
            "start_status": [status for *_, status in found],
            "start_duration": np.array(durations) * scaled.unit,
        }
        best = int(np.argmin(durations))
        if not np.isfinite(durations[best]):
            statuses = ", ".join(sorted(set(stats["start_status"])))
            message = f"no start succeeded: {statuses}"
            return Solution(Status.FAILED, message=message, setup_time=setup_time, stats=stats)
        _, times, velocities, _ = found[best]
        trajectory = scaled.trajectory(times, velocities)
        relaxed = verify(problem.without("jerk", "position"), trajectory).certified_duration
        bound = relaxed if self.relation(problem) is Relation.RELAXATION else None
        message = "" if bound is None else _RELAXED
        return Solution(
            Status.SOLVED,
            trajectory,
            message,
            lower_bound=bound,
            setup_time=setup_time,
            stats=stats,
        )


_RELAXED = "jerk and position limits are ignored: a lower bound (best known, not proved)"


class _Scaled:
    """The problem without units: time in mean stop times, each joint's tighter acceleration is 1."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.moving = problem, problem.moving
        stop = stop_times(problem.without("jerk", "position"))
        self.unit = float(stop.mean())
        limits = problem.limits
        self.a_unit = np.abs(limits.acceleration[self.moving]).min(axis=1)
        self.v_unit, self.q_unit = self.a_unit * self.unit, self.a_unit * self.unit**2
        self.h = problem.displacements[:, self.moving] / self.q_unit
        self.v = limits.velocity[self.moving].T / self.v_unit
        self.a = limits.acceleration[self.moving].T / self.a_unit
        self.stop = stop / self.unit
        self.least = np.maximum(self.h / self.v[1], self.h / self.v[0]).max(axis=1)

    def trajectory(self, times: Array, velocities: Array) -> Trajectory:
        """The explicit answer: in each segment a convex combination of both extreme profiles."""
        ends = _with_rest(velocities)
        breaks, waypoints = np.r_[0.0, np.cumsum(times)] * self.unit, self.problem.waypoints
        joints: list[tuple[Array, Array]] = []
        moving = iter(range(self.h.shape[1]))
        for joint in range(self.problem.joints):
            if not self.moving[joint]:
                joints.append((breaks[[0, -1]], waypoints[:1, joint, None].copy()))
                continue
            i = next(moving)
            pieces = [
                _combined(
                    ends[k, i], ends[k + 1, i], times[k], self.h[k, i], self.v[:, i], self.a[:, i]
                )
                for k in range(len(times))
            ]
            own = [breaks[k] + local[:-1] * self.unit for k, (local, _) in enumerate(pieces)]
            units = np.array([self.a_unit[i], self.v_unit[i], self.q_unit[i]])[:, None]
            local = [c * units for _, c in pieces]
            for k, c in enumerate(local):
                c[2] += waypoints[k, joint]
            joints.append((np.r_[np.concatenate(own), breaks[-1]], np.hstack(local)))
        return Trajectory.joined(joints, breaks)


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


def _combined(u: float, w: float, t: float, h: float, v: Array, a: Array) -> tuple[Array, Array]:
    """Breaks and position coefficients (3, pieces) of the profile that covers exactly `h`."""
    up, d_up, lo, d_lo = (float(x) for x in extremes(*map(np.asarray, (u, w, t)), v, a))
    width = d_up - d_lo
    share = (
        np.clip((h - d_lo) / width, 0.0, 1.0) if width > 1e-15 * (abs(d_up) + abs(d_lo)) else 1.0
    )
    knots = np.array([(up - u) / a[1], t - (up - w) / -a[0], (lo - u) / a[0], t - (w - lo) / a[1]])
    local = np.unique(np.r_[0.0, np.clip(knots, 0.0, t), t])
    upper = np.interp(local, [0, *np.clip(knots[:2], 0, t), t], [u, up, up, w])
    lower = np.interp(local, [0, *np.clip(knots[2:], 0, t), t], [u, lo, lo, w])
    speed, lengths = share * upper + (1 - share) * lower, np.diff(local)
    travelled = np.cumsum(lengths * (speed[:-1] + speed[1:]) / 2)
    slope = np.diff(speed) / lengths
    return local, np.stack([slope / 2, speed[:-1], np.r_[0.0, travelled[:-1]]])


def repair(times: Array, velocities: Array, scaled: _Scaled) -> float:
    """The smallest dilation that makes times and waypoint velocities exactly reachable.

    IPOPT meets its constraints to a tolerance; dilating by `k` multiplies the velocity limits by
    `k` and the accelerations by `k²`, which widens every reachable interval.
    """
    ends = _with_rest(velocities)
    u, w, t = ends[:-1], ends[1:], times[:, None]

    def reachable(k: float) -> bool:
        v, a = scaled.v * k, scaled.a * k**2
        _, d_up, _, d_lo = extremes(u, w, t, v[:, None], a[:, None])
        kept = (v[0] <= ends) & (ends <= v[1])
        steps = (a[0] * t <= w - u) & (w - u <= a[1] * t)
        return bool(kept.all() and (steps & (d_lo <= scaled.h) & (scaled.h <= d_up)).all())

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
def _solver(segments: int, joints: int) -> Any:
    """IPOPT for all problems of this size, built once; the numbers are parameters."""
    ca = backend("casadi")
    t, h = ca.MX.sym("t", segments), ca.MX.sym("h", segments, joints)
    v = ca.MX.sym("v", segments - 1, joints)
    up, lo = ca.MX.sym("up", segments, joints), ca.MX.sym("lo", segments, joints)
    a1, a2 = ca.MX.sym("a1", 1, joints), ca.MX.sym("a2", 1, joints)
    size = ca.MX.sym("size", segments)  # each segment's stop time: the scale of its constraints
    ends = ca.vertcat(ca.MX.zeros(1, joints), v, ca.MX.zeros(1, joints))
    u, w = ends[:-1, :], ends[1:, :]
    wide = lambda x: ca.repmat(x, 1, joints)  # noqa: E731
    tall = lambda x: ca.repmat(x, segments, 1)  # noqa: E731
    tt, aa1, aa2, ss = wide(t), tall(a1), tall(a2), wide(size)
    d_up = up * tt - (up - u) ** 2 / (2 * aa2) - (up - w) ** 2 / (2 * aa1)
    d_lo = lo * tt + (lo - u) ** 2 / (2 * aa1) + (lo - w) ** 2 / (2 * aa2)
    positive = [aa2 * tt - (w - u), (w - u) + aa1 * tt, (d_up - h) / ss**2, (h - d_lo) / ss**2]
    g = ca.vertcat(*[ca.vec(x) for x in positive], ca.sum1(size) - ca.sum1(t))
    x = ca.vertcat(*map(ca.vec, (t, v, up, lo)))
    p = ca.vertcat(*map(ca.vec, (h, a1, a2, size)))
    return ca.nlpsol("exact", "ipopt", {"x": x, "p": p, "f": ca.sum1(t), "g": g}, IPOPT)


def _starts(scaled: _Scaled, count: int) -> list[tuple[Array, Array]]:
    """Times and waypoint velocities to start from: generous stopping first, then random ones."""
    segments, joints = scaled.h.shape
    rng = np.random.default_rng(0)
    starts = [(1.5 * scaled.stop, np.zeros((segments - 1, joints)))]
    for _ in range(count - 1):
        times = scaled.stop * rng.uniform(0.5, 1.5, segments)
        slopes = scaled.h / times[:, None]
        mix = rng.uniform(size=(segments - 1, joints))
        between = mix * slopes[:-1] + (1 - mix) * slopes[1:]
        starts.append((times, between * rng.uniform(0, 1.5, (segments - 1, 1))))
    return starts


def _solve_from(
    solver: Any, scaled: _Scaled, start: tuple[Array, Array]
) -> tuple[float, Array, Array, str]:
    """Repaired duration, segment times, waypoint velocities, and IPOPT's status from one start."""
    segments, joints = scaled.h.shape
    times, velocities = start
    tall = lambda x, rows: np.tile(x, (rows, 1)).ravel("F")  # noqa: E731
    ends = np.clip(_with_rest(velocities), *scaled.v)
    up, lo = np.maximum(ends[:-1], ends[1:]), np.minimum(ends[:-1], ends[1:])
    x0 = np.concatenate([times, *(x.ravel("F") for x in (ends[1:-1], up, lo))])
    low, high = (
        np.concatenate([edge, tall(v, segments - 1), tall(v, segments), tall(v, segments)])
        for edge, v in zip(
            (scaled.least, np.full(segments, scaled.stop.sum())), scaled.v, strict=True
        )
    )
    p = np.concatenate([scaled.h.ravel("F"), -scaled.a[0], scaled.a[1], scaled.stop])
    result = solver(x0=x0, p=p, lbx=low, ubx=high, lbg=0.0, ubg=np.inf)
    status = str(solver.stats()["return_status"])
    x = np.asarray(result["x"]).ravel()
    times = x[:segments]
    velocities = x[segments : segments + (segments - 1) * joints].reshape(
        segments - 1, joints, order="F"
    )
    ok = solver.stats()["success"] and np.isfinite(x).all() and (times > 0).all()
    k = repair(times, velocities, scaled) if ok else np.inf
    return k * float(times.sum()), k * times, velocities / k, status
