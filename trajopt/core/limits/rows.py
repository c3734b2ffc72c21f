"""What a limit asks at every instant, in inequalities: written once, for whatever computes them.

A kind of limit writes its inequalities in NumPy:

    def rows(self, at):
        yield Row(at.v[0] * at.a[0], high=self.power)

A caller chooses what `at` holds: arrays of numbers, or a planner's own symbols that take part in
NumPy's arithmetic (`__array_ufunc__`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from trajopt.core.arrays import Indices


class JointState(NamedTuple):
    """The state of all joints at some instants, or on some pieces of a motion.

    Attributes:
        q: position of each joint, rad (or m); each entry is an array or a symbol.
        v: velocity of each joint, rad/s.
        a: acceleration of each joint, rad/s².
        j: jerk of each joint, rad/s³.
        segments: the segment of each instant or piece, from 0.
    """

    q: Sequence[Any]
    v: Sequence[Any]
    a: Sequence[Any]
    j: Sequence[Any]
    segments: Indices


class Row(NamedTuple):
    """The inequality `low ≤ value ≤ high`.

    Attributes:
        value: an entry of the state as it is, or what NumPy makes of such entries. Solvers want it
            to be of the order of 1.
        low, high: numbers, or one for each instant or piece.
        leaving: a bound of a velocity, which planners impose instead around a waypoint where this
            row does not hold at rest. From there the motion may only go back.
        joint: whose it is, from 0; None where it is not one joint's.
    """

    value: Any
    low: Any = -np.inf
    high: Any = np.inf
    leaving: Row | None = None
    joint: int | None = None


def positive(x: Any, corner: Any) -> Any:
    """Return `max(0, x)`; of symbols a smooth function above it.

    Args:
        x: numbers or symbols.
        corner: the difference at 0 is half of this, and vanishes away from 0.
    """
    smooth = getattr(x, "positive", None)
    return np.maximum(x, 0.0) if smooth is None else smooth(corner)


def sign(x: Any, otherwise: float) -> Any:
    """Return the sign of numbers, 0 at 0; of symbols, which have none, `otherwise`.

    A kind yields such a row with 1 and with −1: planners then keep both.
    """
    return otherwise if hasattr(x, "positive") else np.sign(x)
