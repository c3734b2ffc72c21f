"""The program (5.5) of the mathematics, by CasADi and IPOPT: a check of `exact.jerk`.

Variables are the segment times, the waypoint states, and for both sides of each cell the levels and
holding times of a motion. `exact.jerk.profiles` has the extreme motions in closed form. Here IPOPT
finds them. Segment times are in units of their stop times.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from baselines.exact.acceleration.by_ipopt import LONGEST, OPTIONS
from baselines.exact.jerk.cells import JerkTables
from baselines.exact.method.planner import LocalOptimum
from baselines.exact.method.scaled import Scaled
from baselines.ipopt import Options, Program, flat, program, unflat
from trajopt.core.arrays import Array
from trajopt.planners.planner import backend

# IPOPT's "acceptable" points violate constraints by no more than its optimal ones.
_OPTIONS: Options = {
    **OPTIONS,
    "acceptable_tol": 1e-9,
    "acceptable_constr_viol_tol": 1e-12,
    "mu_strategy": "adaptive",
    "max_iter": 1000,
}
# Initial guess of the levels and holding times, for both sides, in order of size as (5.5) asks.
_GUESS = [0.5, 0.0, -0.5, 0.125, 0.25, 0.125] * 2


def minimised(scaled: Scaled, starts: Sequence[Array]) -> list[LocalOptimum]:
    """Return the local optimum that IPOPT finds from each initial guess.

    Its duration is infinite where IPOPT finds none.
    """
    size = scaled.h.size
    stop = scaled.stop[:, None]
    limits = np.abs([*scaled.v, *scaled.r])
    a1, a2 = np.abs(scaled.a)
    v1, v2, r1, _ = limits
    cells = np.zeros_like(scaled.h)
    inner = cells[1:]
    # without a jerk limit acceleration may jump at a waypoint, and has no value there
    jerky = (r1 > 0).any(axis=0)
    longest = LONGEST * scaled.stop.sum()
    lowest = [scaled.shortest / scaled.stop, inner - v1, inner - jerky * a1]
    highest = [longest / scaled.stop, inner + v2, inner + jerky * a2]
    for rising, falling in ((a2, a1), (a1, a2)):
        lowest += 3 * [cells - falling] + 3 * [cells]
        highest += 3 * [cells + rising] + 3 * [cells + np.inf]
    low = flat(*lowest)
    high = flat(*highest)
    parameters = flat(scaled.h / stop**2, *(limits / stop), stop)
    guess = np.repeat(_GUESS, size)
    solver = _solver(*scaled.h.shape)
    optima = []
    for times in starts:
        # at rest at every waypoint
        start = flat(times / scaled.stop, inner, inner, guess)
        run = solver(
            start=np.clip(start, low, high),
            parameters=parameters,
            bounds=(low, high),
            constraint_bounds=(0.0, np.repeat([0.0, np.inf], [4 * size, 16 * size])),
        )
        shares, *states = unflat(run.x, [times.shape, inner.shape, inner.shape])
        times = shares * scaled.stop
        duration = times.sum() if run.success else np.inf
        one = (table[None] for table in (times, *states))
        optima.append(LocalOptimum(duration, times, JerkTables(scaled).linked(*one), run.status))
    return optima


@cache
def _solver(segments: int, joints: int) -> Program:
    """Return IPOPT's program for all problems of this size, built once.

    Displacements and limits are its parameters.
    """
    ca = backend("casadi")

    def tables(count: int, rows: int) -> list[Any]:
        return [ca.MX.sym("table", rows, joints) for _ in range(count)]

    times = ca.MX.sym("T", segments)
    stop = ca.MX.sym("stop", segments)
    states = tables(2, segments - 1)
    upper = tables(6, segments)
    lower = tables(6, segments)
    numbers = tables(5, segments)
    h, v1, v2, r1, r2 = numbers
    t = ca.repmat(times, 1, joints)
    rest = ca.MX.zeros(1, joints)
    velocity, acceleration = (ca.vertcat(rest, state, rest) for state in states)
    units = ca.repmat(stop, 1, joints)
    ends = [
        velocity[:-1, :] / units,
        acceleration[:-1, :],
        velocity[1:, :] / units,
        acceleration[1:, :],
    ]
    mirrored_ends = [-end for end in ends]

    def rows(side: list[Any], ends: list[Any], h: Any, limits: tuple[Any, Any, Any]) -> Any:
        """Return the equations, then the inequalities `≥ 0`, of the motion of one side."""
        rise, level, fall, rise_hold, cruise, fall_hold = side
        u, a, w, b = ends
        top, up, down = limits
        phases = [
            # duration, acceleration at its start and at its end
            (up * (rise - a), a, rise),
            (rise_hold, rise, rise),
            (down * (rise - level), rise, level),
            (cruise, level, level),
            (down * (level - fall), level, fall),
            (fall_hold, fall, fall),
            (up * (b - fall), fall, b),
        ]
        spent = 0
        travelled = 0
        speeds = [u]
        for length, before, after in phases:
            speed = speeds[-1]
            spent += length
            travelled += length * (speed + length * (2 * before + after) / 6)
            speeds.append(speed + length * (before + after) / 2)
        # 4.1, and at both ends of the cruise
        ramp = down * level**2 / 2
        peaks = [u + down * a**2 / 2, speeds[3] + ramp, speeds[4] + ramp]
        ramps = [rise - a, rise - level, level - fall, b - fall]
        slower = [top - peak for peak in peaks]
        return [spent - t, speeds[-1] - w], [travelled - h, *ramps, *slower]

    equal, least = rows(upper, ends, h, (v2, r2, r1))
    # the lower side is the mirror image of the upper one
    mirrored, as_least = rows(lower, mirrored_ends, -h, (v1, r1, r2))
    return program(
        "exact_jerk",
        variables=[times, *states, *upper, *lower],
        parameters=[*numbers, stop],
        objective=ca.dot(stop, times),
        constraints=[*equal, *mirrored, *least, *as_least],
        options=_OPTIONS,
    )
