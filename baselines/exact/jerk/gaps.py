"""Initial guesses under jerk limits, where a motion begins or ends in motion.

A *gap* is an interval of times in which a segment is impossible, between possible times on both
sides: a joint that cannot stop before its waypoint passes it early, or comes back later. The first
and the last segment may have gaps, and a descent does not cross them (`exact.acceleration.gaps`).
So there is an initial guess in each interval of possible times, before a gap and behind it.

Under jerk limits gaps have no closed form. So no gap is computed: each segment time of a grid is
tested with the extreme profiles, and a run of possible grid times is one interval (`_places`). At
the inner end of the first and the last segment a grid of states is tried at each time, and each
joint takes the one with the most slack (`_outer_segments`). The interior-point method has to start
with positive slack in every inequality, and these times and states have that.

In a problem of one segment the states at both ends are numbers, and only the time is free. Its
optimum is the first possible time (`first_time`), which may be a single one before a gap. No
descent follows.

A motion in motion cannot be dilated. So its limits are made tighter by 1e-10, relative, for its
rounding, or by 1e-8 (`exact.method.scaled.leave`).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from baselines.exact.jerk.cells import JerkInequalities, JerkTables
from baselines.exact.jerk.profiles import ExtremeProfiles
from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Array, Bools
from trajopt.core.rounding import of_states

MAX_STARTS = 32  # combinations of intervals that are tried; fewer may miss that of the optimum
# Shares of the limits that are left to rounding: the second where the first is not enough. Larger:
# a duration longer by as much.
SPARES = (1e-10, 1e-8)
# Grid of times of a segment: how many, the longest and the shortest, relative to its stop time. A
# sparser grid misses intervals between two of its times. A denser one takes longer.
_TIMES = 160
_LONGEST = 30.0
_SHORTEST = 1e-3
_TINIEST = 1e-9  # the least time of a segment of no displacement, whose shortest time is 0
# Grid of states at a segment's free end: velocities as shares of their limits, accelerations as
# shares of the largest ones possible at such a velocity. All below 1: at a limit there is no slack.
# Fewer states: intervals whose states lie between them are missed. CPU time grows with their
# number.
_VELOCITIES = np.linspace(-0.95, 0.95, 21)
_ACCELERATIONS = np.linspace(-0.9, 0.9, 5)
# States at the end of a short segment: jerks of its first and second half, as shares of the limits,
# all below 1: at a limit there is no slack.
_JERKS = (-0.8, -0.3, 0.0, 0.3, 0.8)
# Further times of the grid, relative to the time of passing the segment at constant velocity:
# before a gap intervals are too narrow for the grid.
_PASSING = np.linspace(0.85, 1.15, 25)
# Number of times that are tried where only the time is free; each edge is then so often halved.
_ALONE_TIMES = 2000
_HALVINGS = 50
_PASSES = 2  # of looking for edges: in the first one two edges between two times show as none
# Rounding of a slack, relative to the changes of position that it is the difference of. Smaller:
# the first time is missed by rounding. Larger: a limit is exceeded by more.
_ROUNDING_RTOL = 1e-14
# The least share of the time that a phase may take whose ends may be rounded: about the root of
# their rounding, as time enters with its square. Closer to 0: such a motion is missed.
_ROUNDED_PHASE = -1e-3
# Least slack of an initial guess's displacements, in units of the time squared. Smaller: a guess
# begins at the boundary, with short steps. Larger: narrow intervals have no guess.
_SLACK = 1e-6
# Distance of an initial guess from the edge of its interval, in times of the grid. The second value
# is used where all guesses of the first fail, and so on. Small: little slack. Large: far from the
# least time of the interval.
DEPTHS = (8, 20, 3, 50)


class JerkStart(NamedTuple):
    """An initial guess: segment times, and velocities and accelerations at the inner waypoints."""

    times: Array
    velocity: Array
    acceleration: Array


class _OuterSegment(NamedTuple):
    """A time of the first or last segment, and the state at its inner end.

    Attributes:
        time: in units of the problem. NaN means that the inner end is at rest; the time is then
            the last interval's, in which the joints can stop.
        state: velocity and acceleration, `(2, joints)`.
    """

    time: float
    state: Array


def first_time(scaled: Scaled, rounded: bool = False) -> list[JerkStart]:
    """Return the start at the first possible time of a problem of one segment, or an empty list.

    At that time one joint becomes possible. So the times at which any does are tried in order: an
    extreme displacement equals the segment's own, or end states come into reach of each other. The
    time is later by 1e-10, relative, or half of what it can be, which is left to rounding.

    Args:
        scaled: A problem of one segment.
        rounded: Whether a motion counts that meets the end states only within their rounding. Such
            a time is a guess for the second method (`exact.method.free_pieces`), where the end
            states were computed and rounded (`exact.method.one_piece.nearly`).
    """
    given = np.array([*zip(scaled.end_v, scaled.end_a, strict=True)])
    speed = np.abs(given[:, 0]).sum(axis=0)

    def rows(times: Array) -> JerkInequalities:
        return _inequalities(scaled, 0, times, np.repeat(given[:, :, None], len(times), axis=2))

    def in_reach(times: Array) -> Bools:
        """Return where the phases of each end take time, `(2 ends × 2 sides, times, joints)`."""
        profiles = rows(times).profiles
        reached = _nearly_reached(profiles) if rounded else profiles.ends_reachable
        return reached.reshape(4, len(times), -1)

    def possible(times: Array) -> Bools:
        """Return where both extreme displacements allow the joint's, `(2 sides, times, joints)`."""
        t = times[:, None]
        own = rows(times)
        if rounded:
            *_, a_unit, v_unit, q_unit = scaled.units
            place, swift, steep = of_states(scaled.problem)
            rounding = (place / q_unit / t + swift / v_unit) / t + steep / a_unit
            nearly = _nearly_reached(own.profiles).all(axis=0)
            return np.asarray(nearly & (own.reach >= -rounding))[:, :, 0]
        rounding = _ROUNDING_RTOL * (np.abs(scaled.h[0]) / t + speed) / t
        return _slack(own) >= -rounding

    def edges(times: Array, inside: Callable[[Array], Bools]) -> Array:
        """Return the two times next to each edge between which `inside` changes."""
        found = inside(times)
        own = np.nonzero(found[:, 1:] != found[:, :-1])
        side, place, joint = own
        early, late = times[place], times[place + 1]
        begins = found[side, place + 1, joint]
        every = np.arange(len(place))
        for _ in range(_HALVINGS if len(place) else 0):
            middle = (early + late) / 2
            is_after = inside(middle)[side, every, joint] == begins
            early, late = np.where(is_after, early, middle), np.where(is_after, middle, late)
        return np.concatenate([early, late])

    low = max(float(scaled.shortest[0]), float(scaled.least[0]), _TINIEST)
    times = np.geomspace(low, _LONGEST * max(float(scaled.stop[0]), low), _ALONE_TIMES)
    with np.errstate(all="ignore"):
        # between two edges others may come and go
        for _ in range(_PASSES):
            near = np.unique(edges(times, in_reach))
            times = np.concatenate([times, near, (near[1:] + near[:-1]) / 2])
            times.sort()
        tried = np.union1d(times[:1], edges(times, possible))
        found = np.append(possible(tried).all(axis=(0, 2)), False)
    if not found.any():
        return []
    first = int(found.argmax())
    last = first + int(found[first:].argmin()) - 1
    time = tried[first] + min((tried[last] - tried[first]) / 2, SPARES[0] * tried[first])
    none = np.zeros((0, scaled.h.shape[1]))
    return [JerkStart(time[None], none, none)]


def starts(scaled: Scaled, depth: int = DEPTHS[0]) -> list[JerkStart]:
    """Return an initial guess in every combination of the intervals of both end segments.

    Args:
        scaled: A problem of several segments that begins or ends in motion.
        depth: Distance of a guess from the edge of its interval, in times of the grid.
    """
    with np.errstate(all="ignore"):
        return list(islice(_starts(scaled, depth), MAX_STARTS))


def more_starts(scaled: Scaled) -> Iterator[JerkStart]:
    """Yield initial guesses at other places of the intervals."""
    for depth in DEPTHS[1:]:
        yield from starts(scaled, depth)


def _starts(scaled: Scaled, depth: int) -> Iterator[JerkStart]:
    segments, joints = scaled.h.shape
    start, end = (np.array(pair) for pair in zip(scaled.end_v, scaled.end_a, strict=True))
    rest = np.zeros((2, joints))
    firsts = [*_outer_segments(scaled, depth, 0, start, first=True), _OuterSegment(np.nan, rest)]
    lasts = [
        *_outer_segments(scaled, depth, segments - 1, end, first=False),
        _OuterSegment(np.nan, rest),
    ]
    if segments == 2:
        # both segments share their only waypoint
        for state in [*(own.state for own in firsts), *(own.state for own in lasts[:-1])]:
            before, after = (
                _between(scaled, depth, 0, start, state),
                _between(scaled, depth, 1, state, end),
            )
            for both in product(before, after):
                yield JerkStart(np.array(both), state[:1], state[1:])
        return
    for first, last in product(firsts, lasts):
        states = np.zeros((segments + 1, 2, joints))
        states[0], states[1], states[-2], states[-1] = start, first.state, last.state, end
        choices = [
            [own.time]
            if np.isfinite(own.time)
            else _between(scaled, depth, k, *states[k : k + 2])[-1:]
            for k, own in ((0, first), (segments - 1, last))
        ]
        middle = [_between(scaled, depth, k, *states[k : k + 2]) for k in range(1, segments - 1)]
        if segments > 3:  # only the last interval of each, in which there is time to stop
            middle = [own[-1:] for own in middle]
        for times in product(choices[0], *middle, choices[1]):
            inner = states[1:-1]
            yield JerkStart(np.array(times), inner[:, 0], inner[:, 1])


def _between(scaled: Scaled, depth: int, segment: int, start: Array, end: Array) -> list[float]:
    """Return a time in every interval in which a segment leads from one state to another."""
    times = _grid(scaled, segment, (start[0] + end[0]) / 2)
    states = np.repeat(np.stack([start, end])[:, :, None], len(times), axis=2)
    slack = _slack(_inequalities(scaled, segment, times, states)).min(axis=(0, 2))
    return [float(times[place]) for place in _places(slack > _SLACK, depth)]


def _outer_segments(
    scaled: Scaled, depth: int, segment: int, given: Array, *, first: bool
) -> list[_OuterSegment]:
    """Return a time of every interval in which the first or last segment is possible, and a state.

    The state is that of the segment's inner end.

    Each joint has the state with the most slack of those tried.

    Args:
        scaled: The problem.
        depth: Distance of the time from the first one of its interval, in times of the grid.
        segment: The segment's index.
        given: State at the motion's end, `(2, joints)`.
        first: Whether it is the first segment, or the last.
    """
    joints = scaled.h.shape[1]
    times = _grid(scaled, segment, given[0])
    beside = 0 if first else -1
    low, high = scaled.waypoint_v[:, beside]
    braking, speeding = scaled.waypoint_a[:, beside]
    easing = scaled.r.reshape(-1, joints).max(axis=0)
    tried = []
    for share, bend in product(_VELOCITIES, _ACCELERATIONS):
        velocity = np.where(share > 0, share * high, -share * low)
        room = np.minimum(high - velocity, velocity - low)
        most = np.sqrt(1.8 * room / np.maximum(easing, 1e-300))
        state = np.stack([velocity, bend * np.minimum(np.minimum(speeding, -braking), most)])
        tried.append(np.repeat(state[:, None], len(times), axis=1))
    tried += _after(given, times, 1 / easing, forwards=first)
    best = np.full((len(times), joints), -np.inf)
    chosen = np.zeros((len(times), 2, joints))
    held = np.repeat(given[:, None], len(times), axis=1)
    for state in tried:
        ends = np.stack([held, state] if first else [state, held])
        slack = _slack(_inequalities(scaled, segment, times, ends)).min(axis=0)
        better = slack > best
        best = np.where(better, slack, best)
        chosen = np.where(better[:, None], state.swapaxes(0, 1), chosen)
    inside = best.min(axis=1) > _SLACK
    return [_OuterSegment(float(times[place]), chosen[place]) for place in _places(inside, depth)]


def _after(given: Array, times: Array, jerk: Array, *, forwards: bool) -> Iterator[Array]:
    """Yield states after a constant jerk in each half of a segment, `(2, times, joints)`.

    If not `forwards`, these are the states before the segment, which lead to the given one.
    """
    half = (times if forwards else -times)[:, None] / 2
    for shares in product(_JERKS, _JERKS):
        velocity, acceleration = given[0], given[1]
        for share in shares:
            own = share * jerk
            velocity = velocity + acceleration * half + own * half**2 / 2
            acceleration = acceleration + own * half
        yield np.stack([velocity, acceleration])


def _nearly_reached(profiles: ExtremeProfiles) -> Bools:
    """Return as `Profiles.ends_reachable` does, where states may be rounded."""
    return np.asarray(np.minimum(profiles.first, profiles.hold) >= _ROUNDED_PHASE)


def _slack(rows: JerkInequalities) -> Array:
    """Return the slack of both extreme displacements, over T², `(2 sides, times, joints)`.

    It is minus infinity where the states are not reachable from each other in the time.
    """
    return np.where(rows.profiles.reachable, rows.reach, -np.inf)[:, :, 0]


def _inequalities(scaled: Scaled, segment: int, times: Array, states: Array) -> JerkInequalities:
    """Return the inequalities of one segment between given states, for many times.

    Args:
        scaled: The problem.
        segment: The segment's index.
        times: Of the segment, `(times,)`.
        states: At its ends, `(2 ends, 2 orders, times, joints)`.
    """
    own = copy.copy(scaled)
    own.h = scaled.h[[segment]]
    own.v, own.a, own.r = (_of(limits, segment) for limits in (scaled.v, scaled.a, scaled.r))
    own.end_v, own.end_a = states[:, 0], states[:, 1]
    own.tolerance = own.h[:0]
    own.least = np.zeros(1)
    own.closed = own.by_segment = False
    own.passing = None
    none = np.zeros((len(times), 0, scaled.h.shape[1]))
    tables = JerkTables(own)
    return JerkInequalities(tables, tables.linked(times[:, None], none, none))


def _of(limits: Array, segment: int) -> Array:
    """Return the limits of one segment, in the shapes of `Scaled`."""
    return limits if limits.ndim == 2 or limits.shape[1] == 1 else limits[:, [segment]]


def _grid(scaled: Scaled, segment: int, velocity: Array) -> Array:
    """Return the times to try in a segment, in order.

    Some are close to the time in which a joint passes it at constant `velocity`, `(joints,)`.
    """
    stop = float(scaled.stop[segment])
    shortest = max(_SHORTEST * stop, float(scaled.shortest[segment]))
    times = np.geomspace(shortest, _LONGEST * stop, _TIMES)
    passing = np.outer(_PASSING, scaled.h[segment] / velocity).ravel()
    inside = (passing >= times[0]) & (passing <= times[-1])
    return np.union1d(times, passing[inside])


def _places(inside: Bools, depth: int) -> list[int]:
    """Return the index of an initial guess in every run of the grid that is `inside`.

    It is `depth` behind the first one of the run, or in its middle if that is nearer.
    """
    padded = np.zeros(len(inside) + 2, dtype=bool)
    padded[1:-1] = inside
    edges = np.flatnonzero(np.diff(padded))
    runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [first + min((after - first) // 2, depth) for first, after in runs]
