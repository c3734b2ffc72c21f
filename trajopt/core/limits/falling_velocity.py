"""Velocity limits that fall towards the ends of a joint's range: Franka's own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt.core.exceptions import InvalidInput


@dataclass(frozen=True)
class FallingVelocity:
    """A velocity limit that falls to zero towards the ends of a joint's range.

    The joint at `q` may move upwards no faster than `max(0, sqrt(2 d max(0, high − q)) − o)`, and
    downwards no faster than `max(0, sqrt(2 d max(0, q − low)) − o)`. This is Franka's form
    (libfranka, `include/franka/rate_limiting.h`; `<position_based_velocity_limits>` in a URDF).

    Attributes:
        offset: `o`, rad/s (m/s for a prismatic joint).
        deceleration: `d`, rad/s².
        low, high: Positions where the roots end, rad; they may differ from the position limits.
    """

    offset: float
    deceleration: float
    low: float
    high: float

    def __post_init__(self) -> None:
        if not 0 <= self.offset < np.inf:
            raise InvalidInput("velocity_offset", "a number from 0", value=self.offset)
        if not 0 < self.deceleration < np.inf:
            right = "a positive number"
            raise InvalidInput("deceleration_limit", right, value=self.deceleration)
        if not -np.inf < self.low < self.high < np.inf:
            right = "a finite range, lower below upper"
            raise InvalidInput("position range", right, value=[self.low, self.high])
