"""The route of a problem: its waypoints and the demands beside them, without limits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput
from trajopt.core.tables import frozen, waypoint_table

# Rounding of a coordinate, relative: some units in its last place.
COORDINATE_RTOL = 16 * float(np.finfo(float).eps)

NOTHING: Mapping[str, Any] = MappingProxyType({})
"""No demand beside the waypoints."""


class State(NamedTuple):
    """Velocity, rad/s, and acceleration, rad/s², of the joints, `(joints,)` each."""

    velocity: Array
    acceleration: Array


@dataclass(frozen=True, eq=False)
class Route:
    """Waypoints to pass exactly and in order, all joints at the same time, and further demands.

    `waypoints` is `(waypoints, joints)` in radians: one row per waypoint. Consecutive identical
    waypoints are one waypoint, passed once. Waypoints that differ by no more than rounding are
    identical.

    `demands` are by key (`trajopt.core.demand.DEMANDS`), in rad (or m) and s. Demands that ask
    nothing are left out. Without demands, a motion begins and ends at rest.

    Raises `InvalidInput` where the waypoints are not finite, or do not move, and where a demand has
    numbers of another shape.
    """

    waypoints: Array
    demands: Mapping[str, Array]

    def __init__(
        self,
        waypoints: ArrayLike | Sequence[Any],
        demands: Mapping[str, Any] = NOTHING,
    ) -> None:
        self.__dict__["waypoints"] = frozen(waypoint_table(waypoints))
        if not self._differing[1:].any():
            raise InvalidInput("waypoints", "at least two different ones; these never move")
        size = self.waypoints.shape
        read = {}
        for key, demand in DEMANDS.items():
            if key in demands:
                values = demand.read(demands[key], *size)
                if not np.array_equal(values, demand.none(*size), equal_nan=True):
                    read[key] = values
        self.__dict__["demands"] = read
        for key, values in read.items():
            DEMANDS[key].check_way(values, self.waypoints, self.rounding)

    @property
    def joints(self) -> int:
        return int(self.waypoints.shape[1])

    @property
    def segments(self) -> int:
        return len(self.waypoints) - 1

    def demand(self, key: str) -> Array:
        """Return the numbers of a demand; its default where the route has no such demand."""
        if key in self.demands:
            return self.demands[key]
        return DEMANDS[key].none(*self.waypoints.shape)

    @property
    def start(self) -> State:
        """Return the state in which the motion begins."""
        return State(self.demand("start_velocity"), self.demand("start_acceleration"))

    @property
    def end(self) -> State:
        """Return the state in which the motion ends."""
        return State(self.demand("end_velocity"), self.demand("end_acceleration"))

    def ends(self, joint: int, orders: int = 2) -> Array:
        """Return a joint's velocity (and acceleration) at the start and the end, `(2, orders)`."""
        return np.array(
            [[rate[joint] for rate in state[:orders]] for state in (self.start, self.end)]
        )

    @property
    def at_rest(self) -> bool:
        """Return whether the motion begins and ends at rest."""
        return not any(DEMANDS[key].moves for key in self.demands)

    @property
    def dilatable(self) -> bool:
        """Return whether a dilation of a motion keeps all demands."""
        return all(DEMANDS[key].dilatable for key in self.demands)

    @property
    def rests(self) -> Indices:
        """Return the waypoints at which the robot stands, by index: where it waits, and the ends.

        The ends of a closed motion do not count, nor does an end with a velocity or acceleration.
        """
        found = self.demand("dwell") > 0
        for waypoint, state in ((0, self.start), (-1, self.end)):
            found[waypoint] |= "closed" not in self.demands and not np.any(state)
        return np.flatnonzero(found)

    @property
    def displacements(self) -> Array:
        """Return the displacements `h_k = q_k − q_{k−1}`, rad, `(segments, joints)`."""
        return np.diff(self.waypoints, axis=0)

    @property
    def moving(self) -> Bools:
        """Return which joints move, `(joints,)`."""
        found = np.any(self.displacements, axis=0)
        for key, numbers in self.demands.items():
            if DEMANDS[key].moves:
                found = found | (numbers != 0)
        return found

    @cached_property
    def largest_displacements(self) -> Array:
        """Largest `|h_k|` of each joint, rad, `(joints,)`; a joint at rest gets the largest."""
        distances = np.abs(self.displacements)
        largest = distances.max(axis=0)
        return np.where(largest > 0, largest, distances.max())

    @cached_property
    def rounding(self) -> Array:
        """Some units in the last place of each joint's largest coordinate, rad, `(joints,)`."""
        largest = np.abs(self.waypoints).max(axis=0)
        return COORDINATE_RTOL * largest

    def merged(self) -> tuple[Route, Indices]:
        """Return the route with consecutive identical waypoints merged, and their new indices.

        Waypoints that a demand separates stay, for example with a least time between them.
        """
        differs = self._differing
        for key, numbers in self.demands.items():
            if DEMANDS[key].separates:
                differs = differs | np.append(False, numbers > 0)
        index = np.cumsum(differs) - 1
        return self if differs.all() else self.at(differs), index

    def at(self, kept: Bools) -> Route:
        """Return the route through the waypoints of a mask, `(waypoints,)`."""
        demands = {key: DEMANDS[key].at(values, kept) for key, values in self.demands.items()}
        return Route(self.waypoints[kept], demands)

    def part(self, first: int, last: int) -> Route:
        """Return the part between two waypoints, by index; it is at rest where it is cut.

        What is asked of the whole motion is not asked of a part.
        """
        demands = {}
        for key, values in self.demands.items():
            cut_off = first if key.startswith("start_") else len(self.waypoints) - 1 - last
            if not (DEMANDS[key].whole or (DEMANDS[key].moves and cut_off)):
                demands[key] = DEMANDS[key].part(values, first, last)
        demands.pop("dwell", None)
        return Route(self.waypoints[first : last + 1], demands)

    def only(self, joints: Indices) -> Route:
        """Return the route of some joints, by index."""
        demands = {
            key: DEMANDS[key].of_joints(values, joints) for key, values in self.demands.items()
        }
        return Route(self.waypoints[:, joints], demands)

    def in_units(self, time: float, lengths: Array | float) -> Route:
        """Return the route with times in units of `time`, s, and positions in `lengths`, rad.

        `lengths` is one number for all joints, or `(joints,)`.
        """
        demands = {
            key: values / DEMANDS[key].unit_size(lengths, time)
            for key, values in self.demands.items()
        }
        return Route(self.waypoints / lengths, demands)

    def reversed(self) -> Route:
        """Return the route of the same motions backwards in time."""
        demands = {}
        for key, values in self.demands.items():
            demand = DEMANDS[key]
            demands[demand.when_reversed or key] = demand.backwards(values)
        return Route(self.waypoints[::-1], demands)

    @cached_property
    def _differing(self) -> Bools:
        """Which waypoints are no repetition of the one before, up to rounding, `(waypoints,)`."""
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
