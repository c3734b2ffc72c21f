"""A jerk-limited problem without units, and which times and waypoint states it can reach.

IPOPT meets its constraints to a tolerance; here its answer becomes exactly reachable, at the price
of a tiny dilation.
"""

from __future__ import annotations

import numpy as np

from baselines.exact import acceleration as exact_nlp
from baselines.exact import jerk_profiles as jerk_profile
from baselines.exact.jerk_profiles import Array, Extremes, Limit, Pieces, Sides
from trajopt.problem import Problem
from trajopt.rest_to_rest import stop_times
from trajopt.trajectory import Trajectory

_CHEAP = 1e-6  # a dilation below 1 + this is as good as none
_BRIEF = 1e-3  # of the mean stop time: a segment over which jerk may be taken as constant


def unsupported(problem: Problem) -> str | None:
    """Why jerk limits as these have no optimum, or None."""
    finite = np.isfinite(problem.limits.jerk[problem.moving])
    lopsided = (finite[:, 0] != finite[:, 1]).any()
    return "a jerk limit on one side only has no optimum, only an infimum" if lopsided else None


class Scaled:
    """The moving joints without units: time in mean stop times, accelerations of order one.

    `h` is `(segments, joints)`; limits `v`, `a` and inverse jerks `r` are `(2, joints)`, low first;
    `v` and `a` signed, `r` not. `jerky` joints have a jerk limit.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.moving = problem, problem.moving
        limits, stop = problem.limits, stop_times(problem.without("position"))
        self.unit = float(stop.mean())
        velocity, acceleration, jerk = (
            x[self.moving].T for x in (limits.velocity, limits.acceleration, limits.jerk)
        )
        felt = np.minimum(np.abs(acceleration), np.abs(jerk) * self.unit).min(axis=0)
        # of jerk, acceleration, velocity and position
        self.units = felt * self.unit ** np.arange(-1.0, 3.0)[:, None]
        self.r = self.units[0] / np.abs(jerk)
        self.a, self.v = acceleration / self.units[1], velocity / self.units[2]
        self.h = problem.displacements[:, self.moving] / self.units[3]
        self.stop, self.jerky = stop / self.unit, self.r.any(axis=0)
        self.least = np.maximum(self.h / self.v[1], self.h / self.v[0]).max(axis=1)

    def sides(self, k: float = 1.0) -> Sides:
        """Limits of the upper and the mirrored lower profile, for motions `k` times as fast."""
        v, a, r = np.abs(self.v) * k, np.abs(self.a) * k**2, self.r / k**3
        return Limit(v[1], a[1], a[0], r[1], r[0]), Limit(v[0], a[0], a[1], r[0], r[1])

    def extremes(self, times: Array, states: Array, k: float = 1.0) -> Extremes:
        """The extreme profiles of every segment and joint."""
        (u, w), (a, b) = ((x[:-1], x[1:]) for x in states)
        return jerk_profile.extremes((u, a), (w, b), times[:, None], self.sides(k))

    def trajectory(self, times: Array, states: Array) -> Trajectory:
        """The explicit answer: in each segment a convex combination of both extreme profiles."""
        breaks = np.r_[0.0, np.cumsum(times)] * self.unit
        joints = [(breaks[[0, -1]], np.array([[start]])) for start in self.problem.waypoints[0]]
        both = self.extremes(times, states)
        for i, joint in enumerate(np.flatnonzero(self.moving)):
            parts = [self._piece(k, i, t, states, both) for k, t in enumerate(times)]
            starts = [at + own[:-1] for at, (own, _) in zip(breaks, parts, strict=False)]
            joints[joint] = np.r_[(*starts, breaks[-1])], np.hstack([part for _, part in parts])
        return Trajectory.joined(joints, breaks)

    def _piece(self, k: int, i: int, t: float, states: Array, both: Extremes) -> Pieces:
        """Local breaks (s) and coefficients (rad/s^power) of one joint over one segment."""
        h, ends, v, a = self.h[k, i], states[:, k : k + 2, i], self.v[:, i], self.a[:, i]
        if self.jerky[i]:
            upper, lower = (side.at(i) for side in self.sides())
            local, part = jerk_profile.combined(ends, t, h, both.at(k, i), (upper, lower))
        else:
            local, part = exact_nlp.combined(ends[0, 0], ends[0, 1], t, h, v, a)
        part = part * self.units[4 - len(part) :, i, None]
        part[-1] += self.problem.waypoints[k, self.moving][i]
        return local * self.unit, part


def repaired(times: Array, states: Array, scaled: Scaled) -> tuple[float, Array]:
    """The smallest dilation that makes times and waypoint states reachable, and those states.

    In a segment so brief that what its states reach is narrower than IPOPT's tolerance, no dilation
    helps: if its states are replaced by those that reach, the long neighbours hardly notice.
    """
    k = repair(times, states, scaled)
    if k < 1 + _CHEAP:
        return k, states
    smooth = _smoothed(times, states, scaled)
    other = repair(times, smooth, scaled)
    return (other, smooth) if other < k else (k, states)


def _smoothed(times: Array, states: Array, scaled: Scaled) -> Array:
    """The states, where a brief segment is not reachable those of constant jerk through it."""
    both, states = scaled.extremes(times, states), states.copy()
    brief = (times < _BRIEF)[:, None] & ~both.reach(scaled.h, scaled.sides())
    brief[[0, -1]] = False  # their outer ends rest
    for k, joint in np.argwhere(brief):
        t, h, (a, b) = times[k], scaled.h[k, joint], states[1, k : k + 2, joint]
        u = h / t - a * t / 2 - (b - a) * t / 6
        states[0, k : k + 2, joint] = u, u + (a + b) / 2 * t
    return states


def repair(times: Array, states: Array, scaled: Scaled) -> float:
    """The smallest dilation that makes times and waypoint states exactly reachable.

    Dilating by `k` multiplies the velocity limits by `k`, the accelerations by `k²` and the jerks
    by `k³`, which widens every reachable interval.
    """
    low, high = 1.0, 1.0 + 1e-14
    while not _reachable(times, states, scaled, high):
        low, high = high, 1 + 10 * (high - 1)
        if high > 2:
            return np.inf
    for _ in range(5):
        k = 0.5 * (low + high)
        low, high = (low, k) if _reachable(times, states, scaled, k) else (k, high)
    return high


def _reachable(times: Array, states: Array, scaled: Scaled, k: float) -> bool:
    """Whether limits widened by a dilation by `k` admit these times and states."""
    wide = np.stack([scaled.v * k, scaled.a * k**2])[:, :, None]
    kept = (wide[:, 0] <= states) & (states <= wide[:, 1])
    reached = scaled.extremes(times, states, k).reach(scaled.h, scaled.sides(k))
    return bool(kept.all() and reached.all())
