"""Motions over the breaks that a trajectory stores (mathematics, section 3).

A trajectory stores its breaks as times since its start: after half a minute to 4e-15 s, and those
of all joints that rounding alone keeps apart as one. Over a piece of 1e-13 s that is a percent of
its length, and a motion whose breaks are rounded after it was computed breaks its limits by as
much. So breaks are rounded first, and each joint's motion is fitted to the rounded ones.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt.core.problem import Problem
from trajopt.core.trajectory import BREAK_RTOL, Trajectory, nearest

Array = NDArray[np.float64]
# Breaks further apart than this, relative to the duration, are two in any order of summation.
DISTINCT_RTOL = 2 * BREAK_RTOL

_MENDINGS = 2  # the second one mends the rounding of the first

Pieces = tuple[Array, Array]  # breaks, and position coefficients (degree + 1, pieces)

NO_PIECES: Pieces = (np.zeros(1), np.zeros((1, 0)))
"""What a joint does in a segment that is flown by in less time than can be stored."""


@dataclass(frozen=True)
class Clock:
    """One segment's times, as its motion counts them and as the trajectory stores them.

    Attributes:
        start: when the segment starts, s since the motion's start.
        end: when it ends, s since the motion's start.
        unit: the unit of the motion's own times, which count from the segment's start, s.
        resolution: breaks no further apart than this are one, s.
    """

    start: float
    end: float
    unit: float
    resolution: float

    @property
    def length(self) -> float:
        """The segment's time as it is stored, in `unit`."""
        return (self.end - self.start) / self.unit

    def stored(self, local: Array) -> Array:
        """The breaks that a trajectory stores for these times, the last being the end, s."""
        times = self.start + local * self.unit
        times[-1] = self.end
        return times

    def stored_at(
        self,
        local: Array,
        places: Array,
        near: float,
    ) -> Array:
        """Return the stored breaks, those near a break of another joint moved there.

        Args:
            local: breaks, from 0 to the segment's end, in `unit`.
            places: stored breaks in order, s.
            near: so far from a place, s, or within the resolution.
        """
        within = max(near, self.resolution)
        times = self.stored(local)
        place = places[nearest(places, times)]
        is_there = np.abs(times - place) <= within
        return np.where(is_there, place, times)

    def stored_outwards(self, local: Array, places: Array) -> Array:
        """Return the stored breaks such that only the longest piece gets briefer."""
        times = self.stored(local)
        lengths = np.diff(local) * self.unit
        longest = int(lengths.argmax())
        for k in range(longest):
            later = _later(times[k], lengths[k])
            times[k + 1] = self._onwards(later, places)
        mirrored = -places[::-1]
        for k in range(len(lengths) - 1, longest, -1):
            later = _later(-times[k + 1], lengths[k])
            times[k] = -self._onwards(later, mirrored)
        return times

    def _onwards(self, time: float, places: Array) -> float:
        """The time, or the first one after it that is a place or apart from all."""
        for place in places:
            if place > time + self.resolution:
                break
            if place >= time:
                return float(place)
            if place >= time - self.resolution:
                time = np.nextafter(place + self.resolution, np.inf)
        return float(time)

    def elapsed(self, stored: Array) -> Array:
        """Stored breaks as the motion counts time."""
        return (stored - self.start) / self.unit

    def lengths(self, stored: Array) -> Array:
        """The lengths of the pieces between stored breaks, as the motion counts time.

        From the breaks themselves: over a brief piece, another rounding in between would count.
        """
        return np.diff(stored) / self.unit

    def shared(self, joints: Sequence[Array]) -> list[Array]:
        """Each joint's breaks as they are stored, where those that are one are at one place.

        Args:
            joints: breaks of each joint, from 0 to the segment's end, in `unit`.

        Returns:
            Times that strictly increase from the segment's start to its end, s, of each joint.
        """
        stored = [self.stored(local) for local in joints]
        since_start = np.concatenate(stored) - self.start
        whole = self.end - self.start
        common = self.start + apart(since_start, whole, self.resolution)
        common[-1] = self.end
        return [np.unique(common[nearest(common, own)]) for own in stored]


def _later(time: float, length: float) -> float:
    """The first time that is later by at least this length."""
    later = time + length
    if later - time < length:
        return float(np.nextafter(later, np.inf))
    return later


def clocks(passages: Array, units: Array | float) -> Iterator[Clock]:
    """A clock of every segment.

    Args:
        passages: when the waypoints are passed, s.
        units: of each segment's own times, or of all of them, s.
    """
    resolution = DISTINCT_RTOL * passages[-1]
    lengths = np.diff(passages)
    segment_units = np.broadcast_to(units, lengths.shape)
    segments = itertools.pairwise(passages)
    for (start, end), unit in zip(segments, segment_units, strict=True):
        yield Clock(start, end, unit, resolution)


def apart(knots: Array, end: float, closest: float) -> Array:
    """0, the knots in order and the end, without knots that follow or precede too closely."""
    times = np.unique(np.r_[0.0, knots, end])
    inner = times[1:-1]
    gaps = np.diff(times)[:-1]
    after_another = gaps > closest
    before_the_end = times[-1] - inner > closest
    apart = inner[after_another & before_the_end]
    return np.concatenate([times[:1], apart, times[-1:]])


def assembled(
    problem: Problem,
    passages: Array,
    segments: Iterable[Sequence[Pieces]],
) -> Trajectory:
    """The trajectory of some segments' pieces, the joints that rest among them.

    Args:
        problem: whose waypoints the segments start from.
        passages: when the waypoints are passed, s.
        segments: of each joint that moves its stored breaks, s, and its displacement since the
            segment's start as coefficients, rad/s^power; `NO_PIECES` where it takes no time.
    """
    moving = problem.moving
    joints = []
    for pieces, waypoints in zip(
        zip(*segments, strict=True),
        problem.waypoints.T[moving],
        strict=True,
    ):
        starts = []
        parts = []
        for (stored, displacement), waypoint in zip(pieces, waypoints[:-1], strict=True):
            if len(stored) < 2:
                continue
            starts.append(stored[:-1])
            part = displacement.copy()
            part[-1] += waypoint
            parts.append(part)
        starts.append(passages[-1:])
        joints.append((np.concatenate(starts), np.hstack(parts)))
    return Trajectory.of_moving(
        problem.waypoints[0],
        moving,
        joints,
        passages,
    )


def through(
    lengths: Array,
    acceleration: Array,
    velocities: Array | tuple[float, float],
    h: float,
    weights: Array | float = 1.0,
) -> Array | None:
    """The motion of such accelerations at the breaks, mended to end with its velocity at `h`.

    Knots that were left out or moved cost some velocity and displacement. The least change of the
    inner accelerations makes up for both.

    Args:
        lengths: of the pieces, `(pieces,)`.
        acceleration: at the breaks, straight in between, `(pieces + 1,)`.
        velocities: at the start and at the end.
        h: displacement.
        weights: what a change counts in, at the breaks, `(pieces + 1,)`.

    Returns:
        Position coefficients `(4, pieces)`; None for less than three pieces, or one of no length.
    """
    if len(lengths) < 3 or lengths.min() <= 0:
        return None
    u, w = velocities
    t = lengths.sum()
    # 1 more at an inner break, in units of the segment: half of both lengths more velocity,
    # as if all of it were gained at their centroid
    at = np.r_[0.0, np.cumsum(lengths)] / t
    before = at[:-2]
    here = at[1:-1]
    after = at[2:]
    gained = (after - before) / 2
    centroid = (before + here + after) / 3
    travelled = gained * (1 - centroid)
    scale = np.broadcast_to(weights, acceleration.shape)[1:-1]
    effect = scale * np.stack([gained, travelled])
    mended = acceleration.copy()
    for _ in range(_MENDINGS):
        _, velocity, position = integrated(lengths, mended, u)
        slow = (w - velocity) / t
        short = (h - position) / t**2
        missed = np.array([slow, short])
        change, *_ = np.linalg.lstsq(effect, missed, rcond=None)
        mended[1:-1] += scale * change
    coefficients, _, _ = integrated(lengths, mended, u)
    return coefficients


def integrated(
    lengths: Array,
    acceleration: Array,
    u: float,
) -> tuple[Array, float, float]:
    """The motion of piecewise linear acceleration, and its velocity and displacement at the end.

    Args:
        lengths: of the pieces, `(pieces,)`.
        acceleration: at the breaks, `(pieces + 1,)`.
        u: velocity at the start.

    Returns:
        Position coefficients `(4, pieces)`, velocity, displacement.
    """
    first = acceleration[:-1]
    last = acceleration[1:]
    jerk = (last - first) / lengths
    # v += d (a0 + a1)/2, q += d (v + d (2 a0 + a1)/6)
    gains = lengths * (first + last) / 2
    velocity = accumulated(u, gains)
    mean = velocity + lengths * (2 * first + last) / 6
    steps = lengths * mean
    position = accumulated(0.0, steps)
    coefficients = np.stack([jerk / 6, first / 2, velocity, position])
    final_velocity = velocity[-1] + gains[-1]
    final_position = position[-1] + steps[-1]
    return coefficients, float(final_velocity), float(final_position)


def accumulated(start: Array | float, steps: Array) -> Array:
    """The value before each step."""
    sums = np.r_[0.0, np.cumsum(steps[:-1])]
    return np.asarray(start + sums)
