"""The motion through given waypoint velocities without a jerk limit (mathematics, section 4).

In each segment each joint takes the profile of least acceleration: two ramps and a cruise at most.
If that leaves the joint's position limits, it takes the profile with the least overshoot. All
joints of a segment share its breaks. A break that is close to another one, or to a waypoint, is
removed if the motion keeps its limits without it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from baselines.exact.acceleration.profiles import Ramps, extremes, gentlest, straightest
from baselines.exact.method.pieces import Pieces, quotient
from baselines.exact.method.segments import Segments
from trajopt.core.arrays import Array, Bools

# Breaks at a smaller distance than this share of a segment are close: one is removed if the motion
# keeps its limits without it. Larger: more are tried, at a linear program each.
_CLOSE_RTOL = 1e-6
# Of a motion that cannot be dilated, breaks at a smaller distance than this share are one: their
# distance is rounding, and no accelerations over it correct the motion.
_ONE_BREAK_RTOL = 3e-14
# Share of the unused acceleration that the profile of least overshoot leaves, so that close breaks
# can be removed. Larger: the joint passes its position limits by more. 0: brief pieces stay.
_KEPT_SHARE = 1e-3
# With less unused acceleration than this, relative to the limit, there is only one motion.
_LEAST_SPARE = 1e-6


class SegmentTask(NamedTuple):
    """What a motion has to do in every segment, each joint in its own units.

    Attributes:
        times: of the segments, `(segments, 1)`.
        h: displacements, `(segments, joints)`.
        u: velocities at the segments' starts, likewise.
        w: velocities at their ends, likewise.
        v: velocity limits, `(2, segments, joints)`, low first; 1 where all segments have the same.
        a: acceleration limits, likewise.
        q: positions at the segments' starts, `(segments, joints)`.
        positions: position limits, `(2, segments, joints)`, low first.
    """

    times: Array
    h: Array
    u: Array
    w: Array
    v: Array
    a: Array
    q: Array
    positions: Array


def pieces(task: SegmentTask, brief: Array | float, *, dilatable: bool = True) -> Pieces:
    """Return the motion of all joints: constant accelerations on shared breaks.

    Args:
        task: what the motion has to do.
        brief: to remove a piece that takes less, a linear program is tried too, `(segments,)`.
        dilatable: whether the motion can be dilated; if not, it is more accurate.
    """
    between = task.u, task.w, task.times
    limits = task.v, task.a
    # Rounding may put a displacement a little outside the interval that the limits allow.
    reach = extremes(*between, *limits)
    task = task._replace(h=np.clip(task.h, reach.d_lo, reach.d_up))
    ramps = gentlest(*between, task.h, *limits)
    if np.isfinite(task.positions).any():
        ramps = _within_positions(ramps, task)

    own = _own(ramps, task)
    first, cruise, _ = own.lengths
    breaks = _breaks(own, task.times, 0.0 if dilatable else _ONE_BREAK_RTOL)
    middles = (breaks[:-1] + breaks[1:]) / 2
    at_first, _, at_last = own.start
    last = first + cruise
    parts = [middles < first, middles > last]
    acceleration = np.select(parts, [at_first, at_last], 0.0)
    shared = Pieces(np.diff(breaks, axis=0), acceleration, 0 * acceleration)
    unlimited = np.array([[[-np.inf]], [[np.inf]]]) + 0 * task.a
    segments = Segments.under(task.u, task.w, task.h, *limits, unlimited)
    if not dilatable:
        segments = segments.undilated
    close = np.maximum(_CLOSE_RTOL * task.times[:, 0], brief)
    return segments.thinned(shared, close, brief)


def _breaks(own: Pieces, end: Array, apart: float) -> Array:
    """Return all joints' breaks in order, each once, then the end, `(breaks, segments, 1)`.

    Breaks at a smaller distance than the share `apart` of a segment are one.
    """
    first, cruise, _ = own.lengths
    times = np.sort(np.hstack([0 * end, first, first + cruise, end]), axis=1)
    if apart:
        times = np.where(end - times <= apart * end, end, times)
    is_new = np.diff(times, axis=1, prepend=-1.0) > apart * end
    once = np.where(is_new, times, end)
    return np.sort(once, axis=1).T[..., None]


def _own(ramps: Ramps, task: SegmentTask) -> Pieces:
    """Return each joint's own ramp, cruise and ramp."""
    cruise = task.times - ramps.first - ramps.last
    lengths = np.array([ramps.first, cruise, ramps.last])
    none = np.zeros_like(cruise)
    steps = np.array([ramps.peak - task.u, none, task.w - ramps.peak])
    acceleration = quotient(steps, lengths, lengths > 0)
    # Over a short ramp the rounding of velocities is a large acceleration.
    within = np.clip(acceleration, *task.a)
    return Pieces(lengths, within, 0 * within)


def _within_positions(ramps: Ramps, task: SegmentTask) -> Ramps:
    """Return the ramps, those of least overshoot where the given ones leave position limits."""
    spare = np.maximum(1 - ramps.share, 0.0)
    # A joint that decides the segment's time has only one motion.
    has_choice = spare > _LEAST_SPARE
    leaves = has_choice & _leaves_positions(ramps, task)
    taken = 1 - _KEPT_SHARE * spare
    straight = straightest(task.u, task.w, task.times, task.h, taken * task.a)
    peak, first, last = np.where(leaves, straight, ramps[:3])
    return Ramps(peak, first, last, ramps.share)


def _leaves_positions(ramps: Ramps, task: SegmentTask) -> Bools:
    """Return in which segments a joint leaves its position limits between the waypoints."""
    own = _own(ramps, task)
    velocity, position = own.passed(task.u)
    before = velocity[:-1]
    turns = before * velocity[1:] < 0
    turned = quotient(before**2, 2 * own.start, turns)
    turning = task.q + position[:-1] - turned
    low, high = task.positions
    outside = (turning < low) | (turning > high)
    return np.asarray(outside.any(axis=0))
