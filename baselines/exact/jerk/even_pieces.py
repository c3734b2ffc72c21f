"""Starts by IPOPT, where waypoints are passed before a joint can stop: motions of even pieces.

Every segment has the same number of pieces of constant jerk, equally long. IPOPT minimises the time
of such a motion, within limits that are a little tighter, from guesses of the segment times. It may
miss waypoints, at a cost, so no guess is impossible. The states of an answer that misses none are
inside every inequality of the exact program: its method begins there. Where an answer misses one,
wider limits are tried; `exact.jerk.narrow` leads from there to the problem's own.

What has time to stop needs no such start. So only the segments that are passed before every joint
can stop are planned so, and one more, from the motion's start on and backwards from its end.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from baselines.exact.jerk.gaps import JerkStart
from baselines.exact.method.scaled import RETURNS, Scaled
from baselines.ipopt import Options, Program, flat, program, unflat
from trajopt.core.arrays import Array, Bools
from trajopt.planners.planner import backend

PIECES = 8
# A segment that stops, relative to the least time of stopping: inside the inequalities.
_STOPPING = 1.05
# The share of what the states at the ends leave of the limits by which these are tighter.
_TIGHTER = 0.02
# The share by which they are wider where that misses a waypoint.
_WIDER = 0.01
# A guess passes at the velocity of the motion's end, or at this share of the limits.
_SLOWEST = 0.3
_LONGEST = 10.0  # segment, relative to the whole of a guess
# Cost of missing a waypoint; by how much a guess may miss one; a smaller miss is rounding.
_MISS_COST = 100.0
_MISSING = 0.1
_MISSED = 1e-5
# Motions whose times differ less, relative, lead to one optimum.
_SAME_RTOL = 1e-3
_OPTIONS: Options = {"tol": 1e-6, "max_iter": 150, "mu_strategy": "adaptive"}


class _Passage(NamedTuple):
    """Consecutive segments of a problem without units.

    Attributes:
        h: displacements, `(segments, joints)`.
        v, a, r: limits as `Scaled` has them, but of every segment, `(2, segments, joints)`.
        stop: times of stopping at both ends of a segment, `(segments,)`.
        shortest: the least times, `(segments,)`.
        ends: velocity and acceleration at both ends, `(2 ends, 2, joints)`.
    """

    h: Array
    v: Array
    a: Array
    r: Array
    stop: Array
    shortest: Array
    ends: Array

    @classmethod
    def of(cls, scaled: Scaled) -> _Passage:
        whole = (2, *scaled.h.shape)
        v, a, r = (np.broadcast_to(own, whole) for own in (scaled.v, scaled.a, scaled.r))
        ends = np.stack([scaled.end_v, scaled.end_a], axis=1)
        own = cls(scaled.h, v, a, r, scaled.stop.copy(), scaled.least, ends)
        own.stop[0] -= own.returns[0]
        own.stop[-1] -= own.returns[1]
        return own._replace(shortest=np.maximum(scaled.shortest, scaled.least))

    @property
    def returns(self) -> Array:
        """Times to stop, to come back, and to start again so, of both ends, `(2,)`."""
        steepest = np.abs(self.a).min(axis=(0, 1))
        times: Array = RETURNS * np.abs(self.ends[:, 0]) / steepest
        return times.max(axis=1)

    def part(self, first: int, last: int) -> _Passage:
        """The segments from one to before another, at rest where the way goes on."""
        h, v, a, r, stop, shortest, ends = self
        own = slice(first, last)
        ends = ends.copy()
        ends[0] *= first == 0
        ends[1] *= last == len(h)
        return _Passage(h[own], v[:, own], a[:, own], r[:, own], stop[own], shortest[own], ends)

    def fast(self, end: int) -> int:
        """Return the number of segments at end 0 or 1 that a joint leaves before it can stop."""
        onwards = 1 if end == 0 else -1
        velocity, acceleration = self.ends[end]
        steepest = np.abs(self.a).min(axis=(0, 1))
        slow = self.r.max(axis=(0, 1))
        speed = np.abs(velocity) + slow * acceleration**2 / 2
        # the ramps of braking take up to 2 √(speed/J); twice the way of braking is enough
        braking = speed / steepest + 2 * np.sqrt(speed * slow)
        way = np.sign(velocity) * np.cumsum(self.h[::onwards], axis=0)
        too_near = ((way >= 0) & (way < speed * braking)).any(axis=1)
        return int(np.append(too_near, False).argmin())

    def guesses(self, first: int, last: int) -> Iterator[Array]:
        """Segment times: up to so many segments from both ends on are passed at speed."""
        count = len(self.h)
        top = np.abs(self.v).min(axis=(0, 1))
        speeds = np.maximum(np.abs(self.ends[:, 0]), _SLOWEST * top)
        passing = (np.abs(self.h) / speeds[:, None]).max(axis=2)
        for begun, ended in product(range(first + 1), range(last + 1)):
            between = count - begun - ended
            if between < 0:
                continue
            times = self.stop.copy()
            times[:begun] = passing[0, :begun]
            times[count - ended :] = passing[1, count - ended :]
            if between:
                times[begun] += self.returns[0]
                times[count - ended - 1] += self.returns[1]
            yield times


def starts(scaled: Scaled) -> list[JerkStart]:
    """Return starts that pass several waypoints before the joints can stop; none without need.

    Args:
        scaled: A problem that begins or ends in motion.
    """
    way = _Passage.of(scaled)
    count = len(way.h)
    first, last = way.fast(0), way.fast(1)
    if first == last == 0 or count == 1:
        return []
    if first + last + 2 > count:
        return _different(way, first, last)
    begun = _different(way.part(0, first + 1), first, 0)
    ended = _different(way.part(count - last - 1, count), 0, last)
    between = way.part(first + 1, count - last - 1)
    rest = np.zeros((len(between.h) + 1, way.h.shape[1]))
    return [
        JerkStart(
            np.concatenate([one.times, _STOPPING * between.stop, other.times]),
            np.concatenate([one.velocity, rest, other.velocity]),
            np.concatenate([one.acceleration, rest, other.acceleration]),
        )
        for one, other in product(begun, ended)
    ]


def _different(way: _Passage, first: int, last: int) -> list[JerkStart]:
    """Return the motions to which the guesses lead, the fastest first."""
    found = [own for times in way.guesses(first, last) for own in _motions(way, times)]
    motions = sorted(found, key=lambda own: own.times.sum())
    totals = np.array([own.times.sum() for own in motions])
    is_other = np.diff(totals, prepend=0.0) > _SAME_RTOL * totals
    return [own for own, other in zip(motions, is_other, strict=True) if other]


def _motions(way: _Passage, times: Array) -> Iterator[JerkStart]:
    """Yield the motions through all waypoints that are found from a guess of its times.

    Where a state at an end is at a limit, or a waypoint is missed, the motion may be possible at a
    single instant alone: so limits are a little wider. Where there is no time to pass a waypoint at
    speed the first such segment is given the time to stop, to come back and to start again.
    """
    tighter, wider = _Numbers(way, _TIGHTER), _Numbers(way, -_WIDER)
    found = wider.solved(times) if tighter.is_full else None
    if found is not None:
        yield found.start
    lengthened = np.zeros(len(times), dtype=bool)
    for _ in times:
        found = tighter.solved(times)
        if found is None:
            return
        if found.hits:
            yield found.start
            return
        if not tighter.is_full:
            within = wider.solved(found.start.times)
            if within is not None:
                yield within.start
        missed = found.missed.argmax()
        if lengthened[missed]:
            return
        times = found.start.times.copy()
        times[missed] = way.stop[missed] + way.returns.sum()
        lengthened[missed] = True


class _Found(NamedTuple):
    """The motion that IPOPT finds.

    Attributes:
        start: its times and states.
        missed: segments that miss their waypoint, `(segments,)`.
    """

    start: JerkStart
    missed: Bools

    @property
    def hits(self) -> bool:
        """Return whether every waypoint is met."""
        return not self.missed.any()


class _Numbers:
    """The numbers of a passage in its program: limits tighter by a share, by piece.

    A negative share makes all of them wider.
    """

    def __init__(self, way: _Passage, share: float) -> None:
        signs = np.array([[[-1.0]], [[1.0]]])
        slow = way.r.max(axis=(0, 1))
        velocity, acceleration = np.abs(way.ends).swapaxes(0, 1)
        led = velocity + slow * acceleration**2 / 2

        self.is_full = bool(
            any(
                (used > (1 - _TIGHTER) * np.abs(limits).min(axis=0)[[0, -1]]).any()
                for limits, used in ((way.v, led), (way.a, acceleration))
            )
        )

        def tighter(limits: Array, used: Array) -> Array:
            by_segment = np.zeros_like(way.h)
            by_segment[0] = used[0]
            by_segment[-1] = np.maximum(by_segment[-1], used[1])
            left = np.maximum(np.abs(limits) - (by_segment if share > 0 else 0.0), 0.0)
            return (limits - share * signs * left)[:, self.pieces]

        self.way = way
        self.jerky = slow > 0
        self.pieces = np.repeat(np.arange(len(way.h)), PIECES)
        self.v = tighter(way.v, led)
        self.a = tighter(way.a, acceleration)
        with np.errstate(divide="ignore"):
            self.jerk = (signs * (1 - share) / way.r)[:, self.pieces]

    def solved(self, times: Array) -> _Found | None:
        """Return the motion that IPOPT finds from these times."""
        way = self.way
        count, joints = way.h.shape
        # at a break the tighter limits of the pieces on both sides
        within = [[own[0, 1:], own[0, :-1], own[1, 1:], own[1, :-1]] for own in (self.v, self.a)]
        lows = [np.maximum(before, after) for after, before, _, _ in within]
        highs = [np.minimum(before, after) for _, _, after, before in within]
        missing = np.zeros((2 * count, joints))
        low = flat(way.shortest, *lows, self.jerk[0], missing)
        high = flat(times * 0 + _LONGEST * times.sum(), *highs, self.jerk[1], missing + np.inf)
        if np.any(low > high):  # a limit of rounding's width, or a time beyond the longest
            return None
        mean = (way.h / times[:, None])[self.pieces]
        guess = flat(times, mean[1:], 0 * mean[1:], 0 * mean, missing + _MISSING)
        run = _solver(count, joints)(
            start=np.clip(guess, low, high),
            parameters=flat(way.h, *way.ends.swapaxes(0, 1), *self.v, *way.r[:, self.pieces]),
            bounds=(low, high),
            constraint_bounds=(
                0.0,
                np.repeat([0.0, np.inf], [(2 * PIECES + 1) * way.h.size, 4 * mean.size]),
            ),
        )
        if not run.success:
            return None
        shapes = [times.shape, *([mean[1:].shape] * 2), mean.shape, missing.shape]
        found, velocity, acceleration, _, misses = unflat(run.x, shapes)
        at = slice(PIECES - 1, None, PIECES)
        states = velocity[at], np.where(self.jerky, acceleration[at], 0.0)
        missed = np.any(misses[:count] + misses[count:] > _MISSED, axis=1)
        return _Found(JerkStart(found, *states), missed)


@cache
def _solver(segments: int, joints: int) -> Program:
    """Return the program for all passages of this size, built once; its data are parameters."""
    ca = backend("casadi")
    count = segments * PIECES

    def table(rows: int) -> Any:
        return ca.MX.sym("table", rows, joints)

    times = ca.MX.sym("T", segments)
    velocity, acceleration, jerk = table(count - 1), table(count - 1), table(count)
    misses = table(2 * segments)
    h, end_v, end_a = table(segments), table(2), table(2)
    slowest, fastest, falling, rising = (table(count) for _ in range(4))
    of_pieces = np.repeat(np.eye(segments), PIECES, axis=0)
    d = ca.repmat(of_pieces @ times / PIECES, 1, joints)
    v = ca.vertcat(end_v[0, :], velocity, end_v[1, :])
    a = ca.vertcat(end_a[0, :], acceleration, end_a[1, :])
    v0, v1, a0, a1 = v[:-1, :], v[1:, :], a[:-1, :], a[1:, :]
    way = of_pieces.T @ (d * (v0 + d * (a0 / 2 + d * jerk / 6)))
    missed = misses[:segments, :] - misses[segments:, :]
    # the ramps that end an acceleration, forwards and backwards, each within its own piece
    speeds = []
    for speed, bend in ((v0, a0), (v1, -a1)):
        speeds += [
            fastest - speed - falling * ca.fmax(bend, 0) ** 2 / 2,
            speed - slowest - rising * ca.fmax(-bend, 0) ** 2 / 2,
        ]
    return program(
        "even_pieces",
        variables=[times, velocity, acceleration, jerk, misses],
        parameters=[h, end_v, end_a, slowest, fastest, falling, rising],
        objective=ca.sum1(times) + _MISS_COST * ca.sum1(ca.vec(misses)),
        constraints=[
            v0 + d * (a0 + d * jerk / 2) - v1,
            a0 + d * jerk - a1,
            way + missed - h,
            *speeds,
        ],
        options=_OPTIONS,
    )
