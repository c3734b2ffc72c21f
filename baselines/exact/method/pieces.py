"""Motions of piecewise linear acceleration: velocities, positions, and joining two pieces."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools, Indices


class Pieces(NamedTuple):
    """A motion whose acceleration is linear on each piece. A piece may have the length 0.

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
        """Return pieces whose accelerations go straight from `first` to `last`."""
        return cls(lengths, first, quotient(last - first, lengths, lengths > 0))

    @classmethod
    def between(cls, lengths: Array, breaks: Array, middles: Array, jerky: Bools) -> Pieces:
        """Return pieces through given accelerations, `(…, joints)`.

        With a jerk limit these are the accelerations at the breaks. Without one a piece has the
        acceleration of its middle throughout.
        """
        first = np.where(jerky, breaks[:-1], middles)
        last = np.where(jerky, breaks[1:], middles)
        return cls.straight(lengths, first, last)

    def of(self, segments: Indices) -> Pieces:
        """Return the pieces of some segments, in tables `(pieces, segments, …)`."""
        return Pieces(*(table[:, segments] for table in self))

    @property
    def end(self) -> Array:
        """Return the accelerations at the ends of the pieces."""
        return self.start + self.jerk * self.lengths

    @property
    def gained(self) -> tuple[Array, Array]:
        """Return velocity and displacement at the end, from rest."""
        velocity, position = self.passed(np.zeros_like(self.start[0]))
        return velocity[-1], position[-1]

    def passed(self, u: Array) -> tuple[Array, Array]:
        """Return velocities and positions at the breaks, `(pieces + 1, …)`.

        The motion begins with the velocity `u` at the position 0.
        """
        lengths = self.lengths
        bend = self.jerk * lengths
        mean = self.start + bend / 2
        velocity = summed(u, lengths * mean)
        early = self.start / 2 + bend / 6
        speed = velocity[:-1] + lengths * early
        position = summed(0.0, lengths * speed)
        return velocity, position

    def integrated(self, u: Array) -> Array:
        """Return the coefficients of position, `(4, pieces, …)`; see `passed`."""
        velocity, position = self.passed(u)
        cubic = self.jerk / 6
        square = self.start / 2
        return np.array([cubic, square, velocity[:-1], position[:-1]])

    def joined(self, place: Indices, jerky: Bools) -> Pieces:
        """Return the pieces with one piece in place of two neighbours in each segment.

        Args:
            place: index of the first of both, `(segments,)`.
            jerky: which joints have a jerk limit, `(joints,)`. Without one the new piece has the
                acceleration of the longer of both.
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


def correction(lengths: Array, slow: Array, short: Array, jerky: Bools) -> Pieces:
    """Return accelerations that lead from rest to a velocity `slow` and a displacement `short`.

    They are a multiple of `x (1 - x)`, which gains the velocity, and of `x (1 - x) (1 - 2 x)`,
    which gains the displacement; `x` is the share of the time that has passed. Both need three
    pieces, or two of constant acceleration; a single piece gains the velocity only.

    Args:
        lengths: of the pieces, `(pieces, segments, 1)`.
        slow: velocities, `(segments, joints)`.
        short: displacements, likewise.
        jerky: which joints have jerk limits, `(joints,)`.
    """
    shares = lengths / lengths.sum(axis=0)
    x = summed(0.0, shares)
    middle = (x[:-1] + x[1:]) / 2
    even = Pieces.between(lengths, _even(x), _even(middle), jerky)
    odd = Pieces.between(lengths, _odd(x), _odd(middle), jerky)
    even_gain, even_way = even.gained
    odd_gain, odd_way = odd.gained
    # The even change gains the velocity. The odd one, less as much of the even one as keeps the
    # velocity, gains the displacement.
    ratio = odd_gain / even_gain
    evenly = slow / even_gain
    short = short - evenly * even_way
    way = odd_way - ratio * even_way
    oddly = quotient(short, way, way != 0)
    evenly -= oddly * ratio
    start = evenly * even.start
    start += oddly * odd.start
    jerk = evenly * even.jerk
    jerk += oddly * odd.jerk
    return Pieces(lengths, start, jerk)


def _even(x: Array) -> Array:
    """Return a change that is symmetric about the middle, and zero at both ends."""
    return x * (1 - x)


def _odd(x: Array) -> Array:
    """Return a change that is antisymmetric about the middle, and zero at both ends."""
    return _even(x) * (1 - 2 * x)


def quotient(whole: Array, parts: Array, where: Bools) -> Array:
    """Return `whole / parts` where asked, and 0 elsewhere."""
    return np.divide(whole, parts, out=np.zeros_like(whole), where=where)


def summed(start: Array | float, steps: Array) -> Array:
    """Return the value before the first step and after each one, along the first axis."""
    pieces, *others = steps.shape
    values = np.empty((pieces + 1, *others))
    values[0] = start
    np.cumsum(steps, axis=0, out=values[1:])
    values[1:] += start
    return values
