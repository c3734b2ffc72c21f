"""Section 4's program as it is printed, by CasADi and IPOPT: a check of `exact.acceleration`.

Variables are the segment times, the waypoint velocities and both peaks. `exact.acceleration.cells`
has other variables: logarithms of times, and velocities counted from each segment's mean. IPOPT
meets its inequalities to a tolerance only, so the caller dilates the answer until it is exactly
reachable. Section 5's program is in `exact.jerk.by_ipopt`.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from baselines.exact.acceleration.profiles import extremes
from baselines.exact.method.chain import with_outer
from baselines.exact.method.scaled import Scaled
from baselines.ipopt import Options, Program, Run, flat, program, unflat
from trajopt.core.arrays import Array
from trajopt.planners.planner import backend

# Larger: the check is coarser than the method that it checks. By default IPOPT widens bounds by
# 1e-8.
OPTIONS: Options = {"tol": 1e-12, "constr_viol_tol": 1e-12, "bound_relax_factor": 0.0}
# Longest segment, relative to stopping everywhere, which is possible. Below 1 it may be shut out.
LONGEST = 1.1


def minimised(scaled: Scaled, times: Array, velocities: Array) -> tuple[Array, Array, Run]:
    """Return where IPOPT comes to from these times and waypoint velocities, and its run.

    Without units: times of the segments, `(segments,)`; velocities at the inner waypoints,
    `(segments - 1, joints)`.
    """
    v1, v2 = np.abs(scaled.v)
    a1, a2 = np.abs(scaled.a)
    slowest, fastest = scaled.waypoint_v
    peak = np.zeros_like(scaled.h)
    longest = np.full_like(scaled.stop, LONGEST * scaled.stop.sum())
    low = flat(scaled.shortest, velocities * 0 + slowest, peak - v1, peak - v2)
    high = flat(longest, velocities * 0 + fastest, peak + v2, peak + v1)
    ends = with_outer(velocities, scaled.end_v)
    reach = extremes(ends[:-1], ends[1:], times[:, None], scaled.v, scaled.a)
    start = flat(times, velocities, reach.p_up, -reach.p_lo)
    solver = _solver(*scaled.h.shape)
    run = solver(
        start=np.clip(start, low, high),
        parameters=flat(scaled.h, peak + a1, peak + a2, scaled.end_v),
        bounds=(low, high),
        constraint_bounds=(0.0, np.inf),
    )
    times, velocities = unflat(run.x, [times.shape, velocities.shape])
    return times, velocities, run


@cache
def _solver(segments: int, joints: int) -> Program:
    """Return IPOPT for all problems of this size, built once.

    Displacements, limits and the velocities at the ends are parameters.
    """
    ca = backend("casadi")
    times = ca.MX.sym("T", segments)
    inner = ca.MX.sym("v", segments - 1, joints)
    upper = ca.MX.sym("p_up", segments, joints)
    lower = ca.MX.sym("p_lo", segments, joints)
    h = ca.MX.sym("h", segments, joints)
    a1, a2 = limits = [ca.MX.sym(name, segments, joints) for name in ("a1", "a2")]
    t = ca.repmat(times, 1, joints)
    outer = ca.MX.sym("v_ends", 2, joints)
    u = ca.vertcat(outer[0, :], inner)
    w = ca.vertcat(inner, outer[1, :])

    def rows(p: Any, u: Any, w: Any, h: Any, a1: Any, a2: Any) -> list[Any]:
        # (4.2): D(p) is at least h, and both ramps fit into the time.
        first = (p - u) ** 2 / (2 * a2)
        last = (p - w) ** 2 / (2 * a1)
        fits = a1 * a2 * t + a1 * u + a2 * w - (a1 + a2) * p
        return [p * t - first - last - h, p - u, p - w, fits]

    return program(
        "exact",
        variables=[times, inner, upper, lower],
        parameters=[h, *limits, outer],
        objective=ca.sum1(times),
        # (4.3) is its mirror image, with the peak counted downwards.
        constraints=[*rows(upper, u, w, h, a1, a2), *rows(lower, -u, -w, -h, a2, a1)],
        options=OPTIONS,
    )
