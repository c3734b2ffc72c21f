"""The exact minimum time by CasADi and IPOPT: an independent check, with and without jerk limits.

Its variables include the extreme profiles: the accelerations and holds of the rise and the fall, a
cruise, and the share of both profiles that covers the displacement. Equations tie them together,
where the other method knows the profiles as functions. IPOPT meets these equations to a tolerance,
and it may end in local optima that only these variables have. Without a jerk limit all ramps of
acceleration take no time.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.exact.cells import at_ends
from baselines.exact.jerk_cells import Cells, Point, Rows
from baselines.exact.jerk_descent import Start
from baselines.exact.scaled import Scaled
from baselines.exact.several_starts import Optimum
from baselines.ipopt import Program, flat, program, unflat
from trajopt.planners.planner import backend

Array = NDArray[np.float64]

IPOPT: dict[str, float | str] = {
    "tol": 1e-10,
    "constr_viol_tol": 1e-10,
    "acceptable_tol": 1e-8,
    "bound_relax_factor": 0.0,
    "mu_strategy": "adaptive",
    "max_iter": 1000,
    "mumps_pivot_order": 0,  # approximate minimum degree: a fifth faster here than MUMPS's choice
}

# Largest duration, relative to stopping everywhere: stopping itself must lie inside.
LONGEST = 1.1
# Velocity limits below this, without units, would be lost in IPOPT's absolute tolerances.
SLOW = 1e-3
TINY = 1e-300  # instead of dividing by 0


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


def minimised(scaled: Scaled, starts: Sequence[Start]) -> list[Optimum]:
    """The local optimum that IPOPT finds from each start."""
    solver = _solver(*scaled.h.shape)
    speed = _speed(scaled)
    v1, v2 = np.abs(scaled.v)
    parameters = flat(
        scaled.h,
        scaled.stop,
        speed,
        v1,
        v2,
        *scaled.r,
    )
    size = scaled.h.size
    vanishing = np.zeros(2 * size)
    profile = np.r_[vanishing, np.full(6 * size, np.inf)]
    highest = np.r_[profile, profile, np.zeros(size), np.inf]
    segments, joints = scaled.h.shape
    inner = (segments - 1, joints)
    low, high = _bounds(scaled)
    optima = []
    for start in starts:
        run = solver(
            start=np.clip(_point(scaled, start), low, high),
            parameters=parameters,
            bounds=(low, high),
            constraint_bounds=(0.0, highest),
        )
        times, velocity, acceleration = unflat(run.x, [(segments,), inner, inner])
        times = times * scaled.stop
        duration = float(times.sum()) if run.success else np.inf
        states = np.stack([velocity * speed, acceleration])
        optima.append(Optimum(duration, times, states, run.status))
    return optima


def _speed(scaled: Scaled) -> Array:
    """A unit of velocity for absolute tolerances: the limit of joints that are slow, else 1."""
    fastest = np.abs(scaled.v).max(axis=0)
    return np.where(fastest < SLOW, fastest, 1.0)


@cache
def _solver(segments: int, joints: int) -> Program:
    """IPOPT for all problems of this size, built once; the numbers are parameters."""
    ca = backend("casadi")

    def symbols(count: int, rows: int = segments, columns: int = joints) -> list[Any]:
        return [
            ca.MX.sym(
                f"x{i}",
                rows,
                columns,
            )
            for i in range(count)
        ]

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
    tables = [
        ca.repmat(
            limit,
            segments,
            1,
        )
        for limit in (speed, *limits)
    ]
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
        (times, size, speeds),
        (v2, r2, r1),
    )
    d_lo, lower_rows = _profile_rows(
        lower,
        (-u, -a, -w, b),
        (times, size, speeds),
        (v1, r1, r2),
    )
    # λ D_up + (1 − λ) D_lo = h, the lower profile being mirrored
    missed = share * d_up - (1 - share) * d_lo - h
    # all together hardly slower than stopping at every waypoint
    total = ca.dot(stop, t)
    spare_time = LONGEST * ca.sum1(stop) - total
    return program(
        "exact_jerk",
        variables=x.tables,
        parameters=[h, stop, speed, *limits],
        objective=total,
        constraints=[*upper_rows, *lower_rows, missed / (size**2 * speeds), spare_time],
        options=IPOPT,
    )


def _profile_rows(
    profile: list[Any],
    ends: tuple[Any, Any, Any, Any],
    units: tuple[Any, Any, Any],
    limits: tuple[Any, Any, Any],
) -> tuple[Any, list[Any]]:
    """Displacement and constraints of one extreme profile, in CasADi's symbols.

    Args:
        profile: its variables, as in `_Variables`.
        ends: velocity and acceleration at the start, then at the end seen backwards.
        units: segment times in stop times, stop times, units of velocity.
        limits: velocity limit, inverse jerk upwards and downwards.

    Returns:
        The displacement, and the rows: two that vanish, six that are not negative.
    """
    rise, fall, rise_hold, cruise, fall_hold = profile
    u, a, w, b = ends
    t, size, speed = units
    top, up, down = limits
    peak, before, ascended = _risen(
        u,
        a,
        rise,
        rise_hold * size,
        up,
        down,
    )
    same_peak, after, descended = _risen(
        w,
        b,
        fall,
        fall_hold * size,
        up,
        down,
    )
    duration = (before + after) / size + cruise
    rows = [
        # equal: the time is filled, rise and fall meet at one peak
        duration - t,
        (peak - same_peak) / speed,
        # not negative: the velocity limit, ramps forwards in time, straight from rise to fall
        (top - peak) / speed,
        rise - a,
        fall - b,
        rise + fall,
        # a profile whose acceleration stays below 0 has no cruise
        rise * cruise,
        fall * cruise,
    ]
    return ascended + descended + peak * cruise * size, rows


def _risen(u: Any, a: Any, rise: Any, hold: Any, up: Any, down: Any) -> tuple[Any, Any, Any]:
    """A rise to the acceleration `rise`, held, then to 0: peak velocity, time, displacement."""
    # t1 = r2 (A − a), t3 = r1 A
    first = (rise - a) * up
    last = rise * down
    # v1 = u + t1 (a + A)/2, v2 = v1 + A d, p = v2 + t3 A/2
    v1 = u + first * (a + rise) / 2
    v2 = v1 + rise * hold
    peak = v2 + rise * last / 2
    ramped = first * (u + first * (2 * a + rise) / 6)
    held = (v1 + v2) / 2 * hold
    released = last * (v2 + rise * last / 3)
    return peak, first + hold + last, ramped + held + released


def _bounds(scaled: Scaled) -> tuple[Array, Array]:
    """Bounds of all variables; no segment takes longer than stopping everywhere does."""
    stop = scaled.stop
    jerky = scaled.r.any(axis=0)
    zero = np.zeros(scaled.h.shape)
    infinite = zero + np.inf
    inner = np.ones((len(stop) - 1, 1))
    slowest, fastest = scaled.v / _speed(scaled)
    a1, a2 = np.where(jerky, scaled.a, 0.0)
    braking, speeding = np.abs(scaled.a)
    low_profiles = []
    high_profiles = []
    for rise, fall in ((speeding, braking), (braking, speeding)):
        # a rise that stays below 0 ends at least at the other side's limit
        lowest_rise = zero + np.where(jerky, -fall, rise)
        lowest_fall = zero + np.where(jerky, -rise, fall)
        low_profiles.append([lowest_rise, lowest_fall, zero, zero, zero])
        high_profiles.append([zero + rise, zero + fall, infinite, infinite, infinite])
    low = _Variables(
        scaled.shortest / stop,
        [inner * slowest, inner * a1],
        upper=low_profiles[0],
        lower=low_profiles[1],
        share=zero,
    )
    high = _Variables(
        LONGEST * stop.sum() / stop,
        [inner * fastest, inner * a2],
        upper=high_profiles[0],
        lower=high_profiles[1],
        share=zero + 1,
    )
    return flat(*low.tables), flat(*high.tables)


def _point(scaled: Scaled, start: Start) -> Array:
    """IPOPT's variables for times and waypoint states, with their extreme profiles."""
    times, velocity, _ = start
    rows = _profiles(scaled, start)
    profiles = rows.profiles
    in_stop_times = (times / scaled.stop)[:, None]
    sides = []
    for side in (0, 1):
        rise, fall = profiles.rises[:, side, 0]
        rise_hold, fall_hold = profiles.hold[:, side, 0] * in_stop_times
        cruise = profiles.cruise[side, 0] * in_stop_times
        sides.append([rise, fall, rise_hold, cruise, fall_hold])
    high, low = np.maximum(
        rows.reach[:, 0],
        0.0,
    )
    upper, lower = sides
    variables = _Variables(
        times / scaled.stop,
        [velocity / _speed(scaled), start[2]],
        upper,
        lower,
        low / np.maximum(high + low, TINY),
    )
    return np.nan_to_num(flat(*variables.tables))


def _profiles(scaled: Scaled, start: Start) -> Rows:
    """The extreme profiles between these waypoint states."""
    times, velocity, acceleration = (table[None] for table in start)
    t = times[..., None]
    ends = (at_ends(velocity) - scaled.h / t) / t
    with np.errstate(all="ignore"):
        return Rows(
            Cells(scaled),
            Point(np.log(times), ends, velocity, acceleration),
        )
