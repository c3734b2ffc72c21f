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

from trajopt.problem import Problem
from trajopt.trajectory import BREAK_RTOL, Trajectory, nearest

Array = NDArray[np.float64]
# Of the duration: breaks further apart are two, in whatever order the times were added up.
_DISTINCT_RTOL = 2 * BREAK_RTOL

Pieces = tuple[Array, Array]  # breaks, and position coefficients (degree + 1, pieces)


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

    def elapsed(self, stored: Array) -> Array:
        """Stored breaks as the motion counts time."""
        return (stored - self.start) / self.unit

    def rounded(self, local: Array) -> Array:
        """What these times become when they are stored, as the motion counts time."""
        return self.elapsed(self.stored(local))

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


def clocks(passages: Array, unit: float) -> Iterator[Clock]:
    """A clock of every segment.

    Args:
        passages: when the waypoints are passed, s.
        unit: of the motions' own times, s.
    """
    resolution = _DISTINCT_RTOL * passages[-1]
    for start, end in itertools.pairwise(passages):
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
            segment's start as coefficients, rad/s^power.
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
