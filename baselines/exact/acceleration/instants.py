"""Times and velocities where a motion between given states is possible at single instants.

Where a gap in time begins at the earliest time of another joint, one single time of that segment is
possible, and the inequalities have no interior. An interior-point method then solves the problem
with limits that are a little wider. From its answer this module goes to the limits themselves, by
linear programs. Each has the inequalities' first derivatives. It minimises the largest excess over
a limit, and among equal excesses the duration.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baselines.exact.acceleration.profiles import extremes
from baselines.exact.method.chain import with_outer
from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Array, Bools, Indices

Point = tuple[Array, Array]  # segment times, inner velocities

STEPS = 24  # linear programs at most; fewer: more of an excess at a double root stays
# After a step that leaves more of the excess than this, a longer one is tried too. Larger: steps to
# a double root are too short. Smaller: the longer one is tried in vain.
SLOW = 0.1
ROUNDING = 2e-16  # a smaller excess over a limit, relative to it, is rounding
# Share by which limits are wider, for the derivatives by them: between the rounding and the
# curvature of a difference.
_WIDER = 1e-6
_LEAST_UNIT = 1e-12  # least derivative by the dilation, relative to the largest: no division by 0
# Weights, beside the duration, whose weight is 1. The largest excess over a limit: so heavy that it
# comes first. Each change: so light that the duration hardly feels it; without it a change upwards
# and one downwards may come together.
_EXCESS_WEIGHT = 1e7
_CHANGE_WEIGHT = 1e-4
# Largest change, in units of the largest excess so far. Smaller: more steps. Larger: a step leaves
# the region in which the derivatives hold.
_FARTHEST = 1e5
# Inequalities with more slack than this do not count, in units of the largest excess: a
# change of at most `_FARTHEST` does not use it up. Larger: larger programs.
_NEAR = 1e6
_TOL = 1e-10  # of the linear program, the least of HiGHS


class _CellRows(NamedTuple):
    """Inequalities `values ≥ 0` with their derivatives, `(rows,)` each.

    Attributes:
        values: where one is negative, a dilation by 1 minus it makes the inequality hold.
        segment: index of the row's segment.
        joint: index of its joint.
        by_log: derivatives by the logarithm of the segment's time.
        by_u, by_w: by the velocities at the segment's start and end.
    """

    values: Array
    segment: Indices
    joint: Indices
    by_log: Array
    by_u: Array
    by_w: Array

    def of(self, some: Bools) -> _CellRows:
        """Return some of the rows."""
        numbers = self.segment[some], self.joint[some]
        return _CellRows(
            self.values[some], *numbers, self.by_log[some], self.by_u[some], self.by_w[some]
        )

    @property
    def excess(self) -> float:
        """Return the largest excess over a limit, relative to it; `ROUNDING` if it is less."""
        return max(-float(self.values.min()), ROUNDING)


def sharpened(scaled: Scaled, times: Array, velocities: Array) -> Point:
    """Return segment times and inner velocities with as little excess over the limits as possible.

    Args:
        scaled: the problem, its waypoints exact.
        times: of a motion that nearly keeps the limits, `(segments,)`.
        velocities: at the inner waypoints, `(segments - 1, joints)`.
    """
    limits = scaled.waypoint_v
    best = times, np.clip(velocities, *limits)
    rows = _rows(scaled, *best)
    for _ in range(STEPS):
        if rows.excess <= ROUNDING:
            break
        step = _step(scaled, *best, rows)
        if step is None:
            break
        before = rows.excess
        tried = []
        # Newton's step to a double root goes half the way: there twice the step is tried
        for factor in (1, 2):
            own = _moved(best, step, factor, limits)
            tried.append((own, _rows(scaled, *own)))
            if tried[0][1].excess <= SLOW * before:
                break
        own, after = min(tried, key=lambda each: each[1].excess)
        if after.excess >= before:
            break
        best, rows = own, after
    return best


def excess(scaled: Scaled, times: Array, velocities: Array) -> float:
    """Return the share by which limits have to be wider for these times and inner velocities."""
    return _rows(scaled, times, velocities).excess


def _moved(point: Point, step: Point, factor: float, limits: Array) -> Point:
    times, velocities = point
    log, change = step
    return times * np.exp(factor * log), np.clip(velocities + factor * change, *limits)


def _rows(scaled: Scaled, times: Array, velocities: Array) -> _CellRows:
    """Return the inequalities of section 4 in every cell."""
    ends = with_outer(velocities, scaled.end_v, scaled.closed)
    u, w, t, h = ends[:-1], ends[1:], times[:, None], scaled.h
    v, a = (np.broadcast_to(own, (2, *h.shape)) for own in (scaled.v, scaled.a))
    reach = extremes(u, w, t, v, a)
    wider = extremes(u, w, t, v * (1 + _WIDER), a * (1 + _WIDER) ** 2)
    up, lo = reach.p_up, reach.p_lo
    # value, then derivatives by the logarithm of the time, by u, by w, and by the dilation
    one = np.ones_like(h)
    gained = (wider.d_up - reach.d_up) / _WIDER, (reach.d_lo - wider.d_lo) / _WIDER
    tables = [
        (reach.d_up - h, up * t, (up - u) / a[1], (w - up) / a[0], gained[0]),
        (h - reach.d_lo, -lo * t, (u - lo) / a[0], (lo - w) / a[1], gained[1]),
        (a[1] * t - (w - u), a[1] * t, one, -one, 2 * a[1] * t),
        ((w - u) - a[0] * t, -a[0] * t, -one, one, -2 * a[0] * t),
    ]
    columns = [np.concatenate([table[i].ravel() for table in tables]) for i in range(5)]
    segment, joint = (np.tile(own.ravel(), len(tables)) for own in np.indices(h.shape))
    *counted, unit = columns
    values, by_log, by_u, by_w = counted / np.maximum(unit, _LEAST_UNIT * unit.max())
    return _CellRows(values, segment, joint, by_log, by_u, by_w)


def _step(scaled: Scaled, times: Array, velocities: Array, rows: _CellRows) -> Point | None:
    """Return the change of the times' logarithms and of the velocities; None if there is none."""
    from scipy.optimize import linprog  # late: few motions need it
    from scipy.sparse import coo_array, hstack

    segments, joints = scaled.h.shape
    count = segments + velocities.size  # changes of times and velocities
    unit = rows.excess
    rows = rows.of(rows.values < _NEAR * unit)
    numbers = np.arange(len(rows.values))
    velocity = segments + rows.segment * joints + rows.joint
    is_inner = rows.segment < segments - 1, rows.segment > 0
    row = np.concatenate([numbers, numbers[is_inner[0]], numbers[is_inner[1]]])
    column = np.concatenate([rows.segment, velocity[is_inner[0]], velocity[is_inner[1]] - joints])
    entry = np.concatenate([rows.by_log, rows.by_w[is_inner[0]], rows.by_u[is_inner[1]]])
    matrix = coo_array((entry, (row, column)), shape=(len(numbers), count)).tocsr()
    slowest, fastest = np.broadcast_to(scaled.waypoint_v, (2, *velocities.shape))
    room = np.concatenate([np.full(segments, np.inf), (fastest - velocities).ravel()])
    back = np.concatenate([np.full(segments, np.inf), (velocities - slowest).ravel()])
    with np.errstate(divide="ignore"):
        back[:segments] = np.log(times / scaled.least)
    cost = np.concatenate([times, np.zeros(velocities.size)])
    # changes upwards, changes downwards, the largest excess
    found = linprog(
        np.concatenate([_CHANGE_WEIGHT + cost, _CHANGE_WEIGHT - cost, [_EXCESS_WEIGHT]]),
        A_ub=hstack([-matrix, matrix, coo_array(-np.ones((len(numbers), 1)))]),
        b_ub=rows.values / unit,
        bounds=[(0, own) for own in np.clip(np.append(room, back) / unit, 0, _FARTHEST)]
        + [(0, None)],
        options={"primal_feasibility_tolerance": _TOL, "dual_feasibility_tolerance": _TOL},
    )
    if found.x is None:
        return None
    change = unit * (found.x[:count] - found.x[count:-1])
    return change[:segments], change[segments:].reshape(velocities.shape)
