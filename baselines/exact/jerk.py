"""The exact minimum time with velocity, acceleration and jerk limits (mathematics, section 4).

No discretisation. For one joint over one segment of time `T`, between two states (velocity,
acceleration), the displacements that the limits allow fill an interval `[D_lo, D_up]`, whose ends
are the profiles of `exact.jerk_profiles`. With the accelerations and holds of their rises as
variables, and the share of both ends that covers `h` (well posed where the interval shrinks to a
point), the minimum-time problem is a small smooth NLP. Jerk enters by its inverse: an unlimited one
is 0, and the profiles are then those of section 3.

    from baselines.exact.jerk import ExactJerk
    solution = ExactJerk().solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import numpy as np

from baselines.exact import acceleration as exact_nlp
from baselines.exact import jerk_reach
from baselines.exact.acceleration import Exact
from baselines.exact.jerk_profiles import Array, Bools, Limit, risen
from baselines.exact.jerk_reach import Scaled, repaired
from baselines.ipopt import Program, flat, no_start_succeeded, optima, program
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, Relation, backend, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status
from trajopt.verification import verify

IPOPT = exact_nlp.IPOPT | {"tol": 1e-10}

_LONGEST = 1.1  # of the time of stopping everywhere: stopping itself must lie inside
_PATIENCE = 3  # times as many starts where all have failed so far
_ROUNDS = 5
_ENDED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
_PROGRESS = 1e-7  # relative: the least gain worth another round
_SLOWER = 1.3  # than without jerk limits: a start


@dataclass(frozen=True)
class ExactJerk(Planner):
    """Exact minimum time under velocity, acceleration and jerk limits (CasADi/IPOPT).

    Jerk limits may be stiff (1e5 times those of acceleration: section 3's optimum but for 1e-4) or
    soft (once), on some joints only, and all limits asymmetric; joints may rest. IPOPT starts from
    `starts` points: the answer is the best known, not proved.

    A jerk limit on one side only is unsupported. Acceleration could then jump the other way, and
    the optimum wants that. But where jerk is limited at all acceleration has to be continuous:
    steeper and steeper ramps approach the optimum, and none reaches it.

    Ruckig, segment by segment from the answer's waypoint states divided by `1 + 1e-6`, returns its
    segment times, except on segments so tiny that this shift leaves the interval they can reach.
    """

    starts: int = 4

    requires = ("casadi",)

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise InvalidInput("starts", "at least 1", value=self.starts)

    def relation(self, problem: Problem) -> Relation:
        """Position limits are ignored, so with them the answer is a lower bound."""
        return Relation.RELAXATION if problem.has("position") else Relation.SAME

    def unsupported(self, problem: Problem) -> str | None:
        return jerk_reach.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of several local optima. `stats`: each start's last status and duration (s).

        A start that IPOPT leads where an earlier one led ends where that one ended.
        """
        scaled, began = Scaled(problem), time.perf_counter()
        solver = _solver(*scaled.h.shape)
        setup_time = time.perf_counter() - began
        starts = _starts(scaled, _PATIENCE * self.starts)
        free = np.zeros((2, *scaled.h.shape), dtype=bool)
        first = optima(lambda start: _run(solver, scaled, *start, free), starts, self.starts)
        found = _refined(solver, scaled, first)
        durations = scaled.unit * np.array([optimum.duration for optimum in found])
        stats = {"start_status": [o.status for o in found], "start_duration": durations}
        return replace(self._best(scaled, found), setup_time=setup_time, stats=stats)

    def _best(self, scaled: Scaled, found: list[_Optimum]) -> Solution:
        best = min(found, key=lambda optimum: optimum.duration)
        if not np.isfinite(best.duration):
            message = no_start_succeeded(optimum.status for optimum in found)
            return Solution(Status.FAILED, message=message)
        answer = scaled.trajectory(best.times, best.states)
        if self.relation(scaled.problem) is Relation.SAME:
            return Solution(Status.SOLVED, answer)
        bound = verify(scaled.problem.without("position"), answer).certified_duration
        message = "position limits are ignored: a lower bound (best known, not proved)"
        return Solution(Status.SOLVED, answer, message, bound)


class _Optimum(NamedTuple):
    """What IPOPT found from one start, exactly reachable; infinite duration if nothing.

    `states` are the velocities and accelerations of all waypoints, `(2, segments + 1, joints)`.
    """

    duration: float
    times: Array
    states: Array
    status: str


class _Variables(NamedTuple):
    """IPOPT's variables, in its order: symbols, bounds or values; tables over the segments.

    Times, holds and cruises count in stop times of their segment.
    """

    times: Any
    inner: Any  # waypoint velocities and accelerations, without the ends
    upper: Any  # rise, fall, rise_hold, cruise, fall_hold
    lower: Any
    share: Any

    @property
    def tables(self) -> list[Any]:
        return [self.times, *self.inner, *self.upper, *self.lower, self.share]


@cache
def _solver(segments: int, joints: int) -> Program:
    """IPOPT for all problems of this size, built once; the numbers are parameters."""
    ca = backend("casadi")

    def symbols(count: int, rows: int = segments, columns: int = joints) -> list[Any]:
        return [ca.MX.sym(f"x{i}", rows, columns) for i in range(count)]

    (t, stop), (h, share) = symbols(2, columns=1), symbols(2)
    inner, limits = symbols(2, rows=segments - 1), symbols(4, rows=1)
    x = _Variables(t, inner, symbols(5), symbols(5), share)
    wide = [ca.repmat(limit, segments, 1) for limit in limits]
    times, size = (ca.repmat(y, 1, joints) for y in (t, stop))
    rows, total = _rows(ca, x._replace(times=times), h, size, wide), ca.dot(stop, t)
    g = [*rows, _LONGEST * ca.sum1(stop) - total]
    return program(
        "exact_jerk",
        variables=x.tables,
        parameters=[h, stop, *limits],
        objective=total,
        constraints=g,
        options=IPOPT,
    )


def _rows(ca: Any, x: _Variables, h: Any, size: Any, limits: Any) -> list[Any]:
    """The constraints of all segments and joints; `size` holds the segments' stop times."""
    rest, (v1, v2, r1, r2) = ca.MX.zeros(1, h.shape[1]), limits
    (u, w), (a, b) = ((ca.vertcat(rest, y), ca.vertcat(y, rest)) for y in x.inner)
    d_up, *upper = _profile_rows(x.upper, (u, a, w, -b), x.times, size, (v2, r2, r1))
    d_lo, *lower = _profile_rows(x.lower, (-u, -a, -w, b), x.times, size, (v1, r1, r2))
    return [*upper, *lower, (x.share * d_up - (1 - x.share) * d_lo - h) / size**2]


def _profile_rows(profile: Any, ends: Any, t: Any, size: Any, limits: Any) -> list[Any]:
    """Displacement and constraints of one extreme profile: two that vanish, four not negative."""
    (rise, fall, rise_hold, cruise, fall_hold), (u, a, w, b) = profile, ends
    top, up, down = limits
    p, before, moved = risen(u, a, rise, rise_hold * size, up, down)
    q, after, left = risen(w, b, fall, fall_hold * size, up, down)
    total, displacement = (before + after) / size + cruise, moved + left + p * cruise * size
    return [displacement, total - t, p - q, top - p, rise - a, fall - b, rise + fall]


def _bounds(scaled: Scaled, apart: Bools) -> tuple[Array, Array]:
    """Bounds of all variables; no segment takes longer than stopping everywhere does."""
    zero, stop = np.zeros(scaled.h.shape), scaled.stop
    box = np.stack([scaled.v, np.where(scaled.jerky, scaled.a, 0.0)], axis=1)[:, :, None]
    inner = np.tile(box, (len(zero) - 1, 1))
    sides = zip(scaled.sides(), apart, strict=True)
    upper, lower = (_profile_bounds(limit, free, scaled.jerky) for limit, free in sides)
    low = _Variables(scaled.shortest / stop, inner[0], upper[0], lower[0], zero)
    high = _Variables(_LONGEST * stop.sum() / stop, inner[1], upper[1], lower[1], zero + 1)
    return flat(*low.tables), flat(*high.tables)


def _profile_bounds(limit: Limit, apart: Bools, jerky: Bools) -> tuple[list[Array], list[Array]]:
    """Profiles `apart` from acceleration 0 have no cruise; the others rise and fall through it.

    A rise that stays below 0 ends at least at the limit of the fall, and so the other way. Without
    a jerk limit acceleration is at its own.
    """
    zero = np.zeros(apart.shape)
    most = [zero + limit.rise, zero + limit.fall]
    floor = [np.where(jerky, 0.0, own) for own in most]
    low = [np.where(apart, -other, x) for x, other in zip(floor, most[::-1], strict=True)]
    free = zero + np.inf
    return [*low, zero, zero, zero], [*most, free, np.where(apart, 0.0, free), free]


def _point(scaled: Scaled, times: Array, states: Array) -> Array:
    """IPOPT's variables for times and waypoint states, with their extreme profiles."""
    both, size = scaled.extremes(times, states), scaled.stop[:, None]
    upper, lower = (
        [p.rise, p.fall, *(x / size for x in (p.rise_hold, p.cruise, p.fall_hold))] for p in both
    )
    share = both.share(scaled.h)
    return flat(*_Variables(times / scaled.stop, states[:, 1:-1], upper, lower, share).tables)


def _read(scaled: Scaled, x: Array) -> tuple[Array, Array]:
    """Times and waypoint states from IPOPT's variables."""
    segments, joints = scaled.h.shape
    inner = x[segments:][: 2 * (segments - 1) * joints].reshape(2, joints, segments - 1)
    return x[:segments] * scaled.stop, _with_rest(inner.swapaxes(1, 2))


def _starts(scaled: Scaled, count: int) -> list[tuple[Array, Array]]:
    """Times and waypoint states to start from: stopping, section 3's optimum, then random ones."""
    stopping, *others = exact_nlp.starting_points(scaled, count)  # type: ignore[arg-type]
    starts = [stopping, *_relaxed(scaled), *others][:count]
    clipped = [(times, np.clip(velocities, *scaled.v)) for times, velocities in starts]
    return [(times, _with_rest(np.stack([v, 0 * v]))) for times, v in clipped]


def _with_rest(inner: Array) -> Array:
    """Waypoint states with rest at both ends, `(2, segments + 1, joints)`."""
    return np.pad(inner, ((0, 0), (1, 1), (0, 0)))


def _relaxed(scaled: Scaled) -> list[tuple[Array, Array]]:
    """The optimum without jerk limits, slowed down a little, if it is found."""
    answer = Exact(starts=1).solve(scaled.problem.without("jerk", "position")).trajectory
    if answer is None:
        return []
    velocities = answer(answer.waypoint_times, order=1)[1:-1, scaled.moving] / scaled.units[2]
    return [(_SLOWER * np.diff(answer.waypoint_times) / scaled.unit, velocities / _SLOWER)]


def _refined(solver: Program, scaled: Scaled, found: list[_Optimum]) -> list[_Optimum]:
    """What each optimum leads to; of equal ones the first alone is followed, unless IPOPT fails."""
    pairs: list[tuple[_Optimum, _Optimum]] = []
    for one in found:
        known = (
            last
            for first, last in pairs
            if last.status in _ENDED and abs(first.duration / one.duration - 1) < _PROGRESS
        )
        pairs.append((one, next(known, None) or _followed(solver, scaled, one)))
    return [last for _, last in pairs]


def _followed(solver: Program, scaled: Scaled, best: _Optimum) -> _Optimum:
    """The local optimum near one where every extreme profile passes through acceleration 0.

    Those that want to avoid it are now allowed to, without a cruise; and again from there, while
    that helps.
    """
    before = np.zeros((2, *scaled.h.shape), dtype=bool)
    for _ in range(_ROUNDS if best.duration < np.inf else 0):
        apart = _avoiding(scaled, best)
        if (apart == before).all():
            break
        found, before = _run(solver, scaled, best.times, best.states, apart), apart
        if not found.duration < best.duration * (1 - _PROGRESS):
            return best._replace(status=found.status)
        best = found
    return best


def _avoiding(scaled: Scaled, found: _Optimum) -> Bools:
    """Which extreme profiles hardly pass through acceleration 0, `(2, segments, joints)`."""
    both = scaled.extremes(found.times, found.states)
    return np.stack([scaled.jerky & p.avoids_zero(found.times[:, None]) for p in both])


def _run(solver: Program, scaled: Scaled, times: Array, states: Array, apart: Bools) -> _Optimum:
    """One run of IPOPT, its answer dilated until it is exactly reachable."""
    low, high = _bounds(scaled, apart)
    x0 = np.clip(_point(scaled, times, states), low, high)
    p = flat(scaled.h, scaled.stop, *np.abs(scaled.v), *scaled.r)
    equal, least = np.zeros(2 * scaled.h.size), np.full(4 * scaled.h.size, np.inf)
    most = np.r_[equal, least, equal, least, equal[::2], np.inf]  # as `_rows` has them
    run = solver(x0, p, (low, high), (0.0, most))
    times, states = _read(scaled, run.x)
    usable = run.success and (times > 0).all()
    k, states = repaired(times, states, scaled) if usable else (np.inf, states)
    slower = states / np.array([k, k**2])[:, None, None]
    return _Optimum(k * float(times.sum()), k * times, slower, run.status)
