"""Starts of a motion that begins or ends in motion, under jerk limits: inside every inequality.

As without jerk limits (`exact.acceleration.gaps`) the times of the first and of the last segment
leave gaps, which a descent does not cross. Here they have no closed form: the intervals between
them are found on a grid of times, by the extreme profiles, for the best of a grid of states at the
segment's other end. This method has to start inside all inequalities, so each start's states come
from there too.

Nothing is inside where an end state is at a limit. Such a joint is planned from states that are
smaller by a share of 1e-4, and a linear program (`judging.slower`) brings the motion to the right
ones; that costs some 1e-6 of the time, 1e-4 at most.
"""

from __future__ import annotations

import copy
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from itertools import islice, product
from typing import NamedTuple

import numpy as np

from baselines.exact.jerk.cells import JerkInequalities, JerkTables
from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Array, Bools
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.slower import slower
from trajopt.judging.verification import keeping

MAX_STARTS = 32
# An end state this near a limit, relative, is moved off it by as much.
OFF_LIMITS = 1e-4
# Times that are tried in a segment, the longest of them relative to stopping, and the shortest.
_TIMES = 160
_LONGEST = 30.0
_SHORTEST = 1e-3
# States that are tried at a segment's free end: shares of the velocity limits, and of the
# accelerations that such a velocity leaves.
_VELOCITIES = np.linspace(-0.95, 0.95, 21)
_ACCELERATIONS = np.linspace(-0.9, 0.9, 5)
# States that a brief segment leads to: jerks of its first and second half, shares of the limits.
_JERKS = (-0.8, -0.3, 0.0, 0.3, 0.8)
# Times near which a joint keeps its velocity through a segment, relative to that time.
_PASSING = np.linspace(0.85, 1.15, 25)
# A start's displacements are so far inside what is reachable, in units of the time squared.
_SLACK = 1e-6
# Times of the grid from the edge of an interval to a start; the later ones where all starts fail.
DEPTHS = (8, 20, 3, 50)


class JerkStart(NamedTuple):
    """Segment times, and velocities and accelerations at the inner waypoints."""

    times: Array
    velocity: Array
    acceleration: Array


class _Beside(NamedTuple):
    """A time of a segment at an end, and velocity and acceleration at its other end."""

    time: float
    state: Array


def off_limits(problem: Problem) -> Problem:
    """Return the problem with end states that are at a limit moved off it; itself if none is."""
    demands = dict(problem.demands)
    moved = False

    for end, state, segment in (
        ("start", problem.route.start, 0),
        ("end", problem.route.end, problem.segments - 1),
    ):
        limits = problem.limits.of_segments(np.array([segment]))
        V, A, J = (
            np.abs(own).min(axis=1) for own in (limits.velocity, limits.acceleration, limits.jerk)
        )
        size = np.abs(state.velocity)
        led = size + state.acceleration**2 / (2 * J)
        use = np.maximum(np.maximum(size, led) / V, np.abs(state.acceleration) / A)
        if (use > 1 - OFF_LIMITS).any():
            moved = True
            share = np.where(use > 1 - OFF_LIMITS, 1 - OFF_LIMITS, 1.0)
            demands[f"{end}_velocity"] = share * state.velocity
            demands[f"{end}_acceleration"] = share * state.acceleration
    return replace(problem, demands=demands) if moved else problem


def brought_back(problem: Problem, motion: Trajectory) -> Trajectory | None:
    """Return a motion of the problem near one of the problem off its limits, if one is found."""
    found = slower(problem, motion.dilated(1 - 2 * OFF_LIMITS), partial(keeping, problem))
    return None if found is None else found.motion


def starts(scaled: Scaled, depth: int = DEPTHS[0]) -> list[JerkStart]:
    """Return a start in every combination of intervals.

    Args:
        scaled: A problem that begins or ends in motion.
        depth: Times of the grid from the edge of an interval to a start.
    """
    with np.errstate(all="ignore"):
        return list(islice(_starts(scaled, depth), MAX_STARTS))


def more_starts(scaled: Scaled) -> Iterator[JerkStart]:
    """Yield starts elsewhere in the intervals."""
    for depth in DEPTHS[1:]:
        yield from starts(scaled, depth)


def _starts(scaled: Scaled, depth: int) -> Iterator[JerkStart]:
    segments, joints = scaled.h.shape
    start, end = (np.array(pair) for pair in zip(scaled.end_v, scaled.end_a, strict=True))
    none = np.zeros((max(segments - 1, 0), joints))
    if segments == 1:
        for time in _between(scaled, depth, 0, start, end):
            yield JerkStart(np.array([time]), none, none)
        return
    rest = np.zeros((2, joints))
    firsts = [*_beside(scaled, depth, 0, start, first=True), _Beside(np.nan, rest)]
    lasts = [*_beside(scaled, depth, segments - 1, end, first=False), _Beside(np.nan, rest)]
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
        if segments > 3:  # what has time to stop takes it
            middle = [own[-1:] for own in middle]
        for times in product(choices[0], *middle, choices[1]):
            inner = states[1:-1]
            yield JerkStart(np.array(times), inner[:, 0], inner[:, 1])


def _between(scaled: Scaled, depth: int, segment: int, start: Array, end: Array) -> list[float]:
    """A time in every interval in which a segment leads from a state to another."""
    times = _grid(scaled, segment, (start[0] + end[0]) / 2)
    states = np.repeat(np.stack([start, end])[:, :, None], len(times), axis=2)
    inside = _slack(scaled, segment, times, states).min(axis=1) > _SLACK
    return [float(times[place]) for place in _places(inside, depth)]


def _beside(
    scaled: Scaled, depth: int, segment: int, given: Array, *, first: bool
) -> list[_Beside]:
    """A time in every interval in which a segment at an end is possible, and a state for it.

    For each time and joint it is the state, of those tried, with the most slack.
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
        slack = _slack(scaled, segment, times, np.stack([held, state] if first else [state, held]))
        better = slack > best
        best = np.where(better, slack, best)
        chosen = np.where(better[:, None], state.swapaxes(0, 1), chosen)
    inside = best.min(axis=1) > _SLACK
    return [_Beside(float(times[place]), chosen[place]) for place in _places(inside, depth)]


def _after(given: Array, times: Array, jerk: Array, *, forwards: bool) -> Iterator[Array]:
    """States that constant jerks in both halves of a segment lead to, `(2, times, joints)`.

    Backwards in time, the state that leads to the given one.
    """
    half = (times if forwards else -times)[:, None] / 2
    for shares in product(_JERKS, _JERKS):
        velocity, acceleration = given[0], given[1]
        for share in shares:
            own = share * jerk
            velocity = velocity + acceleration * half + own * half**2 / 2
            acceleration = acceleration + own * half
        yield np.stack([velocity, acceleration])


def _slack(scaled: Scaled, segment: int, times: Array, states: Array) -> Array:
    """What both extreme displacements leave at least, over the time squared, `(times, joints)`.

    Args:
        scaled: The problem.
        segment: Its number, from 0; below 0 from the end.
        times: Of the segment, `(times,)`.
        states: At its ends, `(2 ends, 2 orders, times, joints)`.
    """
    own = copy.copy(scaled)
    own.h = scaled.h[[segment]]
    own.v, own.a, own.r = (_of(limits, segment) for limits in (scaled.v, scaled.a, scaled.r))
    own.end_v, own.end_a = states[:, 0], states[:, 1]
    own.least = np.zeros(1)
    own.closed = own.by_segment = False
    none = np.zeros((len(times), 0, scaled.h.shape[1]))
    tables = JerkTables(own)
    rows = JerkInequalities(tables, tables.linked(times[:, None], none, none))
    reachable = np.all(rows.profiles.reachable, axis=0)
    return np.where(reachable, rows.reach.min(axis=0), -np.inf)[:, 0]


def _of(limits: Array, segment: int) -> Array:
    """The limits of a segment, as `Scaled` has them."""
    return limits if limits.ndim == 2 or limits.shape[1] == 1 else limits[:, [segment]]


def _grid(scaled: Scaled, segment: int, velocity: Array) -> Array:
    """Times to try, among them those near which a joint passes with this velocity, `(joints,)`."""
    stop = float(scaled.stop[segment])
    shortest = max(_SHORTEST * stop, float(scaled.shortest[segment]))
    times = np.geomspace(shortest, _LONGEST * stop, _TIMES)
    passing = np.outer(_PASSING, scaled.h[segment] / velocity).ravel()
    inside = (passing >= times[0]) & (passing <= times[-1])
    return np.union1d(times, passing[inside])


def _places(inside: Bools, depth: int) -> list[int]:
    """The place of a start in every run of the grid that is inside."""
    padded = np.zeros(len(inside) + 2, dtype=bool)
    padded[1:-1] = inside
    edges = np.flatnonzero(np.diff(padded))
    runs = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
    return [first + min((after - first) // 2, depth) for first, after in runs]
