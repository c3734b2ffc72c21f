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

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.trajectory import BREAK_RTOL, Trajectory, nearest

# Breaks further apart than this, relative to the duration, are two in any order of summation.
DISTINCT_RTOL = 2 * BREAK_RTOL

_MENDINGS = 2  # the second one mends the rounding of the first
_RANK_RTOL = 1e-28  # of squares: less of a change is rounding
_TINY = 1e-300  # instead of dividing by 0

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
        common = self.start + apart(
            since_start,
            whole,
            self.resolution,
        )
        common[-1] = self.end
        return [
            np.unique(
                common[
                    nearest(
                        common,
                        own,
                    )
                ]
            )
            for own in stored
        ]


def clocks(passages: Array, units: Array | float) -> Iterator[Clock]:
    """A clock of every segment.

    Args:
        passages: when the waypoints are passed, s.
        units: of each segment's own times, or of all of them, s.
    """
    resolution = DISTINCT_RTOL * passages[-1]
    lengths = np.diff(passages)
    segment_units = np.broadcast_to(
        units,
        lengths.shape,
    )
    segments = itertools.pairwise(passages)
    for (start, end), unit in zip(
        segments,
        segment_units,
        strict=True,
    ):
        yield Clock(
            start,
            end,
            unit,
            resolution,
        )


def apart(knots: Array, end: float, closest: float) -> Array:
    """0, the knots in order and the end, without knots that follow or precede too closely."""
    times = np.unique(np.r_[0.0, knots, end])
    inner = times[1:-1]
    gaps = np.diff(times)[:-1]
    after_another = gaps > closest
    before_the_end = times[-1] - inner > closest
    apart = inner[after_another & before_the_end]
    return np.concatenate([times[:1], apart, times[-1:]])


def later(times: Array, lengths: Array) -> Array:
    """The first times that are later by at least these lengths."""
    later = times + lengths
    return np.where(
        later - times < lengths,
        np.nextafter(
            later,
            np.inf,
        ),
        later,
    )


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
        for (stored, displacement), waypoint in zip(
            pieces,
            waypoints[:-1],
            strict=True,
        ):
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
    h: Array | float,
) -> Array:
    """The motions of such accelerations at the breaks, mended to end with their velocity at `h`.

    Knots that were left out or moved cost some velocity and displacement. The least change of the
    inner accelerations makes up for both.

    Args:
        lengths: of the pieces, `(pieces, …)`.
        acceleration: at the breaks, straight in between, `(pieces + 1, …)`.
        velocities: at the start and at the end, `(2, …)`.
        h: displacements, `(…)`.

    Returns:
        Position coefficients `(4, pieces, …)`; not finite where a piece has no length.
    """
    u, w = velocities
    t = lengths.sum(axis=0)
    # 1 more at an inner break, in units of the segment: half of both lengths more velocity,
    # as if all of it were gained at their centroid
    at = _from(
        np.zeros_like(t),
        lengths / t,
    )
    gained = (at[2:] - at[:-2]) / 2
    centroid = (at[:-2] + at[1:-1] + at[2:]) / 3
    further = gained * (1 - centroid)
    # the changes that cost displacement alone
    squares = np.maximum(
        (gained**2).sum(axis=0),
        _TINY,
    )
    shared = (further * gained).sum(axis=0) / squares
    alone = further - shared * gained
    squares_alone = (alone**2).sum(axis=0)
    independent = squares_alone > _RANK_RTOL * squares
    mended = acceleration.copy()
    for _ in range(_MENDINGS):
        _, velocity, position = integrated(
            lengths,
            mended,
            u,
        )
        slow = (w - velocity) / t
        short = (h - position) / t**2 - shared * slow
        by_displacement = np.where(
            independent,
            short
            / np.maximum(
                squares_alone,
                _TINY,
            ),
            0.0,
        )
        mended[1:-1] += gained * (slow / squares) + alone * by_displacement
    coefficients, _, _ = integrated(
        lengths,
        mended,
        u,
    )
    return coefficients


def integrated(
    lengths: Array,
    acceleration: Array,
    u: Array | float,
) -> tuple[Array, Array, Array]:
    """The motions of piecewise linear acceleration, and their velocities and displacements.

    Args:
        lengths: of the pieces, `(pieces, …)`.
        acceleration: at the breaks, `(pieces + 1, …)`.
        u: velocities at the start, `(…)`.

    Returns:
        Position coefficients `(4, pieces, …)`, velocity and displacement at the end, `(…)`.
    """
    first = acceleration[:-1]
    last = acceleration[1:]
    # a piece of no length, as after the last break of a table, changes nothing
    jerk = np.divide(
        last - first,
        lengths,
        out=np.zeros_like(first),
        where=lengths > 0,
    )
    cubic = jerk / 6
    square = first / 2
    # as the verifier evaluates a piece's end: between its pieces the motion does not jump
    gains = 3.0 * cubic * lengths**2 + 2.0 * square * lengths
    velocity = _from(
        u,
        gains,
    )
    ways = cubic * lengths**3 + square * lengths**2 + velocity[:-1] * lengths
    position = _from(
        np.zeros_like(u),
        ways,
    )
    coefficients = np.stack([cubic, square, velocity[:-1], position[:-1]])
    return coefficients, velocity[-1], position[-1]


def _from(start: Array | float, steps: Array) -> Array:
    """The value before the first step and after each, along the first axis."""
    first = np.broadcast_to(start, steps[:1].shape)
    return np.cumsum(
        np.concatenate([first, steps]),
        axis=0,
    )
