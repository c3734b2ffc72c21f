"""Motions of piecewise linear acceleration, and what makes them meet their end."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices

_ROUNDING_RTOL = 4e-15  # relative to the numbers that a residual comes from


class Pieces(NamedTuple):
    """A motion of linear acceleration on each piece. A piece of no length changes nothing.

    Attributes:
        lengths: of the pieces, `(pieces, …)`.
        start: accelerations at their starts, likewise.
        jerk: slopes of the accelerations, likewise.
    """

    lengths: Array
    start: Array
    jerk: Array

    @classmethod
    def straight(cls, lengths: Array, first: Array, last: Array) -> Pieces:
        """Pieces of these lengths from the first accelerations to the last ones."""
        change = last - first
        jerk = np.divide(
            change,
            lengths,
            out=np.zeros_like(change),
            where=lengths > 0,
        )
        return cls(lengths, first, jerk)

    def of(self, segments: Indices) -> Pieces:
        """The pieces of some of the segments, in tables `(pieces, segments, …)`."""
        return Pieces(*(table[:, segments] for table in self))

    @property
    def end(self) -> Array:
        """Accelerations at the ends of the pieces."""
        return self.start + self.jerk * self.lengths

    def passed(self, u: Array) -> tuple[Array, Array]:
        """Velocities and positions at the breaks, from velocity `u` and 0, `(pieces + 1, …)`."""
        lengths = self.lengths
        bend = self.jerk * lengths
        mean = self.start + bend / 2
        velocity = summed(u, lengths * mean)
        early = self.start / 2 + bend / 6
        speed = velocity[:-1] + lengths * early
        position = summed(0.0, lengths * speed)
        return velocity, position

    def integrated(self, u: Array) -> Array:
        """Position coefficients from velocity `u` and position 0, `(4, pieces, …)`."""
        velocity, position = self.passed(u)
        cubic = self.jerk / 6
        square = self.start / 2
        return np.array([cubic, square, velocity[:-1], position[:-1]])

    def missing(self, u: Array, w: Array, h: Array) -> Array:
        """Velocity and displacement that are missing at the end, `(2, …)`; 0 if that is rounding.

        Args:
            u: velocities at the start, `(…)`.
            w: and at the end.
            h: displacements.
        """
        velocity, position = self.passed(u)
        slow = w - velocity[-1]
        short = h - position[-1]
        speeds = np.abs(u) + np.abs(w)
        is_slow = np.abs(slow) > _ROUNDING_RTOL * speeds
        is_short = np.abs(short) > _ROUNDING_RTOL * np.abs(h)
        return np.where([is_slow, is_short], [slow, short], 0.0)

    def mended(self, u: Array, w: Array, h: Array) -> Pieces:
        """Pieces of which nothing is missing, at least three.

        Their accelerations change by a multiple of `x (1 - x)` and one of `x (1 - x) (1 - 2 x)`,
        where `x` is the share of the time that has passed: a large change leaves some rounding.
        """
        shares = self.lengths / self.lengths.sum(axis=0)
        x = summed(0.0, shares)
        left = 1 - x
        even = x * left
        odd = even * (left - x)
        even_gain, even_way = self._gained(even)
        odd_gain, odd_way = self._gained(odd)
        slow, short = self.missing(u, w, h)
        # both equations by Cramer's rule
        size = even_gain * odd_way - odd_gain * even_way
        evenly = slow * odd_way - odd_gain * short
        oddly = even_gain * short - even_way * slow
        change = evenly * even
        change += oddly * odd
        more = self._between(change / size)
        start = self.start + more.start
        return self._replace(start=start, jerk=self.jerk + more.jerk)

    def joined(self, place: Indices, jerky: Bools) -> Pieces:
        """One piece in place of two: that at these places, `(segments,)`, and the following one.

        Without a jerk limit, `(joints,)`, acceleration is that of the longer one.
        """
        segments = np.arange(len(place))
        one = Pieces(*(table[place, segments] for table in self))
        other = Pieces(*(table[place + 1, segments] for table in self))
        is_longer = other.lengths > one.lengths
        longer = np.where(is_longer, other.start, one.start)
        first = np.where(jerky, one.start, longer)
        last = np.where(jerky, other.end, longer)
        both = Pieces.straight(one.lengths + other.lengths, first, last)
        pieces = np.arange(len(self.start))[:, None, None]
        is_behind = pieces > place[:, None]
        tables = []
        for table, own in zip(self, both, strict=True):
            following = np.roll(table, -1, axis=0)
            following[-1] = 0.0
            fewer = np.where(is_behind, following, table)
            fewer[place, segments] = own
            tables.append(fewer)
        return Pieces(*tables)

    def _gained(self, acceleration: Array) -> tuple[Array, Array]:
        """Velocity and displacement, from rest, of accelerations at the breaks."""
        velocity, position = self._between(acceleration).passed(0 * acceleration[0])
        return velocity[-1], position[-1]

    def _between(self, acceleration: Array) -> Pieces:
        """Pieces between these accelerations at the breaks, `(pieces + 1, …)`."""
        return Pieces.straight(self.lengths, acceleration[:-1], acceleration[1:])


def summed(start: Array | float, steps: Array) -> Array:
    """The value before the first step and after each, along the first axis."""
    pieces, *others = steps.shape
    values = np.empty((pieces + 1, *others))
    values[0] = start
    np.cumsum(steps, axis=0, out=values[1:])
    values[1:] += start
    return values
