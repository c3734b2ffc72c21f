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

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.trajectory import BREAK_RTOL, Trajectory, nearest

# Breaks further apart than this, relative to the duration, are two in any order of summation.
DISTINCT_RTOL = 2 * BREAK_RTOL

_MENDINGS = 2  # the second one mends the rounding of the first
_ROUNDING_RTOL = 4e-15  # relative to the numbers that a residual comes from

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
            segment's start as coefficients, rad/s^power; one break and none where it takes no time.
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


def missing(
    lengths: Array,
    acceleration: Array,
    u: Array | float,
    w: Array | float,
    h: Array | float,
) -> tuple[Array, Array]:
    """The velocity and the displacement that motions miss at their end; 0 where that is rounding.

    Args:
        lengths: of the pieces, `(pieces, …)`.
        acceleration: at the breaks, straight in between, `(pieces + 1, …)`.
        u: velocities at the start, `(…)`.
        w: and at the end.
        h: displacements.
    """
    _, reached, travelled = integrated(lengths, acceleration, u)
    slow = w - reached
    short = h - travelled
    is_fast = np.abs(slow) > _ROUNDING_RTOL * (np.abs(u) + np.abs(w))
    is_far = np.abs(short) > _ROUNDING_RTOL * np.abs(h)
    return np.where(is_fast, slow, 0.0), np.where(is_far, short, 0.0)


def mended(
    lengths: Array,
    acceleration: Array,
    u: Array | float,
    w: Array | float,
    h: Array | float,
) -> Array:
    """Accelerations with which nothing is missing, of at least three pieces.

    They change by a multiple of `x (1 - x)` and one of `x (1 - x) (1 - 2 x)`, where `x` is the
    share of the time that has passed. The arguments are those of `missing`.
    """
    none = np.zeros_like(lengths[0])
    passed = _from(none, lengths / lengths.sum(axis=0))
    even = passed * (1 - passed)
    odd = even * (1 - 2 * passed)
    _, even_gain, even_way = integrated(lengths, even, none)
    _, odd_gain, odd_way = integrated(lengths, odd, none)
    # both equations by Cramer's rule
    size = even_gain * odd_way - odd_gain * even_way
    for _ in range(_MENDINGS):
        slow, short = missing(lengths, acceleration, u, w, h)
        evenly = slow * odd_way - odd_gain * short
        oddly = even_gain * short - even_way * slow
        acceleration = acceleration + (evenly * even + oddly * odd) / size
    return acceleration


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
    derivative = np.array([3.0 * cubic, 2.0 * square, 0.0 * first])
    gains = polynomials.stretched(derivative, lengths).sum(axis=0)
    velocity = _from(
        u,
        gains,
    )
    ways = lengths * (velocity[:-1] + lengths * (square + cubic * lengths))
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
