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
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from baselines.exact import acceleration, one_sided_jerk
from baselines.exact.acceleration import Exact
from baselines.exact.jerk_profiles import Array, Bools, Limit, Profile, risen
from baselines.exact.several_starts import Optimum, SeveralStarts, statistics
from baselines.ipopt import Bounds, Program, flat, optima, program, unflat
from baselines.settled import settled
from baselines.sizes import announce, cells
from trajopt.planner import backend, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution
from trajopt.verification import verify

if TYPE_CHECKING:
    from baselines.exact.jerk_reach import Scaled

Start = tuple[Array, Array]  # segment times, waypoint states

IPOPT = acceleration.IPOPT | {"tol": 1e-10}

_LONGEST = 1.1  # of the time of stopping everywhere: stopping itself must lie inside
_PATIENCE = 3  # times as many starts where all have failed so far
_FOLLOW_ROUNDS = 5
# From where every limit is active IPOPT takes twice as long as from a slower motion, or fails; from
# much slower ones it takes a tenth longer.
_FOLLOW_DILATIONS = (1.05, 1.2)
_ENDED = ("Solve_Succeeded", "Solved_To_Acceptable_Level")
_PROGRESS_RTOL = 1e-7  # the smallest gain that another round is for
# Without units: what is closer to a bound is put on it, if the motion stays as brief.
_NEAR = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
_CERTIFIED_RTOL = 1e-9  # what its certified duration may cost
_START_DILATION = 1.3  # of the optimum without jerk limits: a start
_STOPPING_DILATION = 1.5  # of stopping at every waypoint, likewise
# Measured up to 343 segments times moving joints, in proportion to them.
_SECONDS_PER_CELL = 0.02


@dataclass(frozen=True)
class ExactJerk(SeveralStarts):
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

    requires = ("casadi", "highspy", "scipy.linalg")

    knows = ("velocity", "acceleration", "jerk")

    def unsupported(self, problem: Problem) -> str | None:
        return one_sided_jerk.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of several local optima. `stats`: each start's last status and duration (s).

        A start that IPOPT leads where an earlier one led ends where that one ended. Where no joint
        that moves has a jerk limit, section 3's program is the same problem and much smaller.
        """
        # profiles, slivers and their linear programs: not where planners are only listed
        from baselines.exact.jerk_reach import Scaled

        moving = problem.moving
        if not problem.limits.jerk_limited[moving].any():
            return Exact(self.starts, self.agreeing).solve(problem)
        announce("exact-jerk", problem, _SECONDS_PER_CELL * cells(problem))
        scaled = Scaled(problem)
        began = time.perf_counter()
        solver = _solver(*scaled.h.shape)
        setup_time = time.perf_counter() - began
        nothing_apart = np.zeros((2, *scaled.h.shape), dtype=bool)

        def solve_from(start: Start) -> Optimum:
            return _run(solver, scaled, *start, nothing_apart)

        starts = _starts(scaled, _PATIENCE * self.starts)
        first = optima(solve_from, starts, self.starts, self.agreeing)
        local = _followed_once(solver, scaled, first)
        best = int(np.argmin([optimum.duration for optimum in local]))
        local[best] = _settled(solver, scaled, local[best])
        return replace(
            self.best(scaled, local),
            setup_time=setup_time,
            stats=statistics(scaled, local),
        )


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

    # variables
    (t,) = symbols(1, columns=1)
    inner = symbols(2, rows=segments - 1)
    upper = symbols(5)
    lower = symbols(5)
    (share,) = symbols(1)
    x = _Variables(t, inner, upper, lower, share)
    # parameters: displacements, stop times, units of velocity, and the limits V1, V2, r1, r2
    (h,) = symbols(1)
    (stop,) = symbols(1, columns=1)
    (speed,) = symbols(1, rows=1)
    limits = symbols(4, rows=1)

    # every constraint is a table over segments and joints
    tables = [ca.repmat(limit, segments, 1) for limit in (speed, *limits)]
    speeds, v1, v2, r1, r2 = tables
    times = ca.repmat(t, 1, joints)
    size = ca.repmat(stop, 1, joints)
    # both ends rest, without acceleration
    rest = ca.MX.zeros(1, joints)
    shares_of_speed, accelerations = inner
    velocities = shares_of_speed * speeds[1:, :]
    u = ca.vertcat(rest, velocities)
    w = ca.vertcat(velocities, rest)
    a = ca.vertcat(rest, accelerations)
    b = ca.vertcat(accelerations, rest)
    d_up, upper_rows = _profile_rows(
        upper,
        (u, a, w, -b),
        times,
        size,
        speeds,
        limits=(v2, r2, r1),
    )
    d_lo, lower_rows = _profile_rows(
        lower,
        (-u, -a, -w, b),
        times,
        size,
        speeds,
        limits=(v1, r1, r2),
    )
    # λ D_up + (1 − λ) D_lo = h, the lower profile being mirrored
    covered = share * d_up - (1 - share) * d_lo
    missed = covered - h
    displacement_row = missed / (size**2 * speeds)
    # all together hardly slower than stopping at every waypoint
    total = ca.dot(stop, t)
    spare_time = _LONGEST * ca.sum1(stop) - total
    return program(
        "exact_jerk",
        variables=x.tables,
        parameters=[h, stop, speed, *limits],
        objective=total,
        constraints=[*upper_rows, *lower_rows, displacement_row, spare_time],
        options=IPOPT,
    )


def _profile_rows(
    profile: list[Any],
    ends: tuple[Any, Any, Any, Any],
    t: Any,
    size: Any,
    speed: Any,
    limits: tuple[Any, Any, Any],
) -> tuple[Any, list[Any]]:
    """Displacement and constraints of one extreme profile, in CasADi's symbols.

    Args:
        profile: its variables, as in `_Variables`.
        ends: velocity and acceleration at the start, then at the end seen backwards.
        t: segment times, in stop times.
        size: stop times.
        speed: units of velocity.
        limits: velocity limit, inverse jerk upwards and downwards.

    Returns:
        The displacement, and the rows: two that vanish, four that are not negative.
    """
    rise, fall, rise_hold, cruise, fall_hold = profile
    u, a, w, b = ends
    top, up, down = limits
    peak, before, ascended = risen(
        u,
        a,
        rise,
        rise_hold * size,
        up,
        down,
    )
    same_peak, after, descended = risen(
        w,
        b,
        fall,
        fall_hold * size,
        up,
        down,
    )
    duration = (before + after) / size + cruise
    cruised = peak * cruise * size
    displacement = ascended + descended + cruised
    rows = [
        # equal: the time is filled, rise and fall meet at one peak
        duration - t,
        (peak - same_peak) / speed,
        # not negative: the velocity limit, ramps forwards in time, straight from rise to fall
        (top - peak) / speed,
        rise - a,
        fall - b,
        rise + fall,
    ]
    return displacement, rows


def _bounds(scaled: Scaled, apart: Bools) -> tuple[Array, Array]:
    """Bounds of all variables; no segment takes longer than stopping everywhere does."""
    stop = scaled.stop
    jerky = scaled.jerky
    zero = np.zeros(scaled.h.shape)
    inner = np.ones((len(stop) - 1, 1))
    slowest, fastest = scaled.v / scaled.speed
    a1, a2 = np.where(jerky, scaled.a, 0.0)
    upper_side, lower_side = scaled.sides()
    upper_apart, lower_apart = apart
    upper_low, upper_high = _profile_bounds(upper_side, upper_apart, jerky)
    lower_low, lower_high = _profile_bounds(lower_side, lower_apart, jerky)
    low = _Variables(
        times=scaled.shortest / stop,
        inner=[inner * slowest, inner * a1],
        upper=upper_low,
        lower=lower_low,
        share=zero,
    )
    high = _Variables(
        times=_LONGEST * stop.sum() / stop,
        inner=[inner * fastest, inner * a2],
        upper=upper_high,
        lower=lower_high,
        share=zero + 1,
    )
    return flat(*low.tables), flat(*high.tables)


def _profile_bounds(
    limit: Limit,
    apart: Bools,
    jerky: Bools,
) -> tuple[list[Array], list[Array]]:
    """Profiles `apart` from acceleration 0 have no cruise; the others rise and fall through it.

    A rise that stays below 0 ends at least at the limit of the fall, and so the other way. Without
    a jerk limit acceleration is at its own.
    """
    zero = np.zeros(apart.shape)
    infinite = zero + np.inf
    highest_rise = zero + limit.rise
    highest_fall = zero + limit.fall
    through_rise = np.where(jerky, 0.0, highest_rise)
    through_fall = np.where(jerky, 0.0, highest_fall)
    lowest_rise = np.where(apart, -highest_fall, through_rise)
    lowest_fall = np.where(apart, -highest_rise, through_fall)
    longest_cruise = np.where(apart, 0.0, infinite)
    # rise, fall, rise_hold, cruise, fall_hold
    low = [lowest_rise, lowest_fall, zero, zero, zero]
    high = [highest_rise, highest_fall, infinite, longest_cruise, infinite]
    return low, high


def _point(scaled: Scaled, times: Array, states: Array) -> Array:
    """IPOPT's variables for times and waypoint states, with their extreme profiles."""
    both = scaled.extremes(times, states)
    size = scaled.stop[:, None]
    velocities, accelerations = states[:, 1:-1]
    variables = _Variables(
        times=times / scaled.stop,
        inner=[velocities / scaled.speed, accelerations],
        upper=_profile_point(both.upper, size),
        lower=_profile_point(both.lower, size),
        share=both.share(scaled.h),
    )
    return flat(*variables.tables)


def _profile_point(profile: Profile, size: Array) -> list[Array]:
    """IPOPT's variables for a profile; `size` are the stop times."""
    return [
        profile.rise,
        profile.fall,
        profile.rise_hold / size,
        profile.cruise / size,
        profile.fall_hold / size,
    ]


def _read(scaled: Scaled, x: Array) -> tuple[Array, Array]:
    """Times and waypoint states from IPOPT's variables."""
    segments, joints = scaled.h.shape
    inner = (segments - 1, joints)
    times, velocities, accelerations = unflat(x, [(segments,), inner, inner])
    inner_states = np.stack([velocities * scaled.speed, accelerations])
    return times * scaled.stop, _with_rest(inner_states)


def _starts(scaled: Scaled, count: int) -> list[Start]:
    """Times and waypoint states to start from: stopping, section 3's optimum, then random ones."""
    stopping, *others = acceleration.starting_points(scaled, count, _STOPPING_DILATION)
    ordered = [stopping, *_relaxed(scaled), *others]
    starts = []
    for times, velocity in ordered[:count]:
        velocity = np.clip(velocity, *scaled.v)
        inner = np.stack([velocity, 0 * velocity])
        starts.append((times, _with_rest(inner)))
    return starts


def _with_rest(inner: Array) -> Array:
    """Waypoint states with rest at both ends, `(2, segments + 1, joints)`."""
    return np.pad(inner, ((0, 0), (1, 1), (0, 0)))


def _relaxed(scaled: Scaled) -> list[Start]:
    """Times and velocities of the optimum without jerk limits, slowed down, if IPOPT finds it."""
    without_jerk = scaled.problem.without("jerk", "position")
    answer = Exact(starts=1).solve(without_jerk).trajectory
    if answer is None:
        return []
    passages = answer.waypoint_times
    times = np.diff(passages)
    velocities = answer(passages, order=1)
    inner = velocities[1:-1, scaled.moving] / scaled.units[2]
    slower = _START_DILATION * times / scaled.unit
    return [(slower, inner / _START_DILATION)]


def _followed_once(solver: Program, scaled: Scaled, first: list[Optimum]) -> list[Optimum]:
    """What each optimum leads to; of equal ones the first alone is followed, unless IPOPT fails."""
    last: list[Optimum] = []
    for optimum in first:
        end = _known_end(optimum, first, last)
        if end is None:
            end = _followed(solver, scaled, optimum)
        last.append(end)
    return last


def _known_end(
    optimum: Optimum,
    first: list[Optimum],
    last: list[Optimum],
) -> Optimum | None:
    """Where an optimum of equal duration led, of those followed so far."""
    for other, end in zip(first, last, strict=False):
        excess = other.duration / optimum.duration - 1
        equal = abs(excess) < _PROGRESS_RTOL
        if equal and end.status in _ENDED:
            return end
    return None


def _followed(solver: Program, scaled: Scaled, best: Optimum) -> Optimum:
    """The local optimum near one where every extreme profile passes through acceleration 0.

    Those that want to avoid it are now allowed to, without a cruise; and again from there, while
    that helps.
    """
    if not np.isfinite(best.duration):
        return best
    before = np.zeros((2, *scaled.h.shape), dtype=bool)
    for _ in range(_FOLLOW_ROUNDS):
        apart = _avoiding(scaled, best)
        if (apart == before).all():
            break
        before = apart
        as_good = best.duration * (1 + _PROGRESS_RTOL)
        better = best.duration * (1 - _PROGRESS_RTOL)
        for k in _FOLLOW_DILATIONS:
            optimum = _run(
                solver,
                scaled,
                k * best.times,
                best.states / _powers(k),
                apart,
            )
            if optimum.duration < as_good:
                break
        if not optimum.duration < better:
            return best._replace(status=optimum.status)
        best = optimum
    return best


def _avoiding(scaled: Scaled, optimum: Optimum) -> Bools:
    """Which extreme profiles hardly pass through acceleration 0, `(2, segments, joints)`."""
    both = scaled.extremes(optimum.times, optimum.states)
    t = optimum.times[:, None]
    return np.stack([scaled.jerky & profile.avoids_zero(t) for profile in both])


def _run(
    solver: Program,
    scaled: Scaled,
    times: Array,
    states: Array,
    apart: Bools,
) -> Optimum:
    """One run of IPOPT, its answer dilated until it is exactly reachable."""
    low, high = _bounds(scaled, apart)
    point = _point(scaled, times, states)
    x0 = np.clip(point, low, high)
    run = solver(
        start=x0,
        parameters=_parameters(scaled),
        bounds=(low, high),
        constraint_bounds=_constraint_bounds(scaled),
    )
    optimum = _reached(scaled, run.x, run.status)
    if not run.success:
        return optimum._replace(duration=np.inf)
    return optimum


def _parameters(scaled: Scaled) -> Array:
    """The numbers of a problem, as `_solver` has them."""
    v1, v2 = np.abs(scaled.v)
    return flat(
        scaled.h,
        scaled.stop,
        scaled.speed,
        v1,
        v2,
        *scaled.r,
    )


def _constraint_bounds(scaled: Scaled) -> Bounds:
    """Of `_solver`'s rows: two of a profile that vanish, and four that are not negative."""
    size = scaled.h.size
    equal = np.zeros(2 * size)
    not_negative = np.full(4 * size, np.inf)
    displacement = np.zeros(size)
    spare_time = [np.inf]
    profile = (equal, not_negative)
    highest = np.concatenate([*profile, *profile, displacement, spare_time])
    return 0.0, highest


def _reached(scaled: Scaled, x: Array, status: str) -> Optimum:
    """The optimum at IPOPT's variables, dilated until it is exactly reachable."""
    from baselines.exact.jerk_reach import repaired

    times, states = _read(scaled, x)
    k = np.inf
    if np.isfinite(x).all() and (times > 0).all():
        k, times, states = repaired(times, states, scaled)
    duration = k * float(times.sum())
    return Optimum(
        duration,
        k * times,
        states / _powers(k),
        status,
    )


def _settled(solver: Program, scaled: Scaled, best: Optimum) -> Optimum:
    """An optimum without the phases of profiles that IPOPT's tolerance alone keeps above 0.

    The further from a bound counts as on it, the more phases vanish, and the likelier such bounds
    contradict each other: the first distance that works.
    """
    if not np.isfinite(best.duration):
        return best
    longest = _certified(scaled, best) * (1 + _CERTIFIED_RTOL)
    apart = _avoiding(scaled, best)
    point = _point(scaled, best.times, best.states)
    for near in _NEAR:
        x = settled(
            solver,
            point,
            _parameters(scaled),
            _bounds(scaled, apart),
            _constraint_bounds(scaled),
            near,
        )
        if x is None:
            continue
        optimum = _reached(scaled, x, best.status)
        if optimum.duration > best.duration:
            continue
        # Where the extreme profiles become one, rounding a break may cost more than its ramp did.
        if _certified(scaled, optimum) <= longest:
            return optimum
    return best


def _certified(scaled: Scaled, optimum: Optimum) -> float:
    """The certified duration of the motion through an optimum's states, s; infinite without."""
    trajectory = scaled.motion(optimum.times, optimum.states)
    relaxed = scaled.problem.without("position")
    duration = verify(relaxed, trajectory).certified_duration
    return np.inf if duration is None else duration


def _powers(k: float) -> Array:
    """What a dilation by `k` divides states by: velocities by `k`, accelerations by `k²`."""
    return np.array([k, k**2])[:, None, None]
