"""The route: what is asked of the way, whatever the limits are."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.tables import frozen, waypoint_table

# A coordinate is known to some units in its last place.
COORDINATE_RTOL = 16 * float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class Route:
    """Waypoints to pass exactly and in order, all joints at the same time, from rest to rest.

    `waypoints` is `(waypoints, joints)` in radians: one row per waypoint. Consecutive identical
    waypoints are one waypoint, passed once; waypoints that differ by no more than rounding are
    identical. As it begins and ends at rest, a motion along it may be slowed down.

    Raises `InvalidInput` where the waypoints are not finite, or do not move.
    """

    waypoints: Array

    def __init__(self, waypoints: ArrayLike | Sequence[Any]) -> None:
        self.__dict__["waypoints"] = frozen(waypoint_table(waypoints))
        if not self._differing[1:].any():
            raise InvalidInput("waypoints", "at least two different ones; these never move")

    @property
    def joints(self) -> int:
        return int(self.waypoints.shape[1])

    @property
    def segments(self) -> int:
        return len(self.waypoints) - 1

    @property
    def displacements(self) -> Array:
        """`h_k = q_k − q_{k−1}`, `(segments, joints)`, rad."""
        return np.diff(self.waypoints, axis=0)

    @property
    def moving(self) -> Bools:
        """Which joints move at all, `(joints,)`."""
        return np.any(self.displacements, axis=0)

    @cached_property
    def largest_displacements(self) -> Array:
        """Largest `|h_k|` of each joint, rad, `(joints,)`; a joint at rest gets the largest."""
        distances = np.abs(self.displacements)
        own = distances.max(axis=0)
        return np.where(self.moving, own, distances.max())

    @cached_property
    def rounding(self) -> Array:
        """Some units in the last place of each joint's largest coordinate, rad, `(joints,)`."""
        largest = np.abs(self.waypoints).max(axis=0)
        return COORDINATE_RTOL * largest

    def merged(self) -> tuple[Route, Indices]:
        """This route with consecutive identical waypoints merged, and where each one went."""
        differs = self._differing
        index = np.cumsum(differs) - 1
        return self if differs.all() else Route(self.waypoints[differs]), index

    @cached_property
    def _differing(self) -> Bools:
        """Which waypoints differ by more than rounding from the last one that did."""
        steps = np.abs(np.diff(self.waypoints, axis=0))
        differs = np.ones(len(self.waypoints), dtype=bool)
        if (steps > self.rounding).any(axis=1).all():
            return differs
        last = self.waypoints[0]
        for row, waypoint in enumerate(self.waypoints[1:], start=1):
            distance = np.abs(waypoint - last)
            differs[row] = (distance > self.rounding).any()
            if differs[row]:
                last = waypoint
        return differs
