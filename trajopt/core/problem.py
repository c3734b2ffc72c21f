"""The problem: a route, to be passed as fast as limits allow."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core import problem_file
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.chain import LinkChain
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput, WrongType, shown
from trajopt.core.limits import Limits
from trajopt.core.out_of_scope import out_of_scope
from trajopt.core.route import NOTHING, Route
from trajopt.core.tables import check_joint_names, check_length

_PER_TIME = ("", "/s", "/s²", "/s³")  # units of the derivatives, order by order


@dataclass(frozen=True, eq=False)
class Problem:
    """Pass every waypoint in order, as fast as the limits allow; from rest to rest by default.

    `waypoints` is `(waypoints, joints)` in radians, one row per waypoint. What else is asked of the
    way is given by name, `start_velocity` say, as a problem file has it but in rad (or m) and s;
    `trajopt.core.demand.DEMANDS` has all. `route` has waypoints and demands, and what follows from
    them (`trajopt.core.route.Route`).

    `joint_names` has one name per joint, or is empty. `joint_units` has "rad", or "m" for a
    prismatic joint; empty means radians. `chain` has the link frames of the joints, where they are
    known. None of these is part of the digest.

    Problems are equal if their waypoints, demands and limits are: names do not count.

    Raises `InvalidInput` where the waypoints do not fit the limits, are not finite, or do not move,
    and where a demand does not fit waypoints and limits.
    """

    waypoints: Array
    limits: Limits
    demands: Mapping[str, Array]
    name: str = "unnamed"
    source: str = ""
    joint_names: tuple[str, ...] = ()
    joint_units: tuple[str, ...] = ()
    chain: LinkChain | None = None
    route: ClassVar[Route]  # of the waypoints and demands

    def __init__(
        self,
        waypoints: ArrayLike | Sequence[Any],
        limits: Limits,
        name: str = "unnamed",
        source: str = "",
        joint_names: Sequence[str] = (),
        joint_units: Sequence[str] = (),
        demands: Mapping[str, Any] = NOTHING,
        chain: LinkChain | None = None,
        **by_key: Any,
    ) -> None:
        for key in by_key:
            if key not in DEMANDS:
                fields = "waypoints, limits, name, source, joint_names, joint_units, chain"
                known = f"{fields}, {', '.join(DEMANDS)}"
                raise WrongType(f"Problem takes no {key}: {out_of_scope(key) or f'it has {known}'}")
        route = Route(waypoints, {**demands, **by_key})
        self._hold(route, limits, name, source, tuple(joint_names), tuple(joint_units), chain)
        if chain is not None:
            chain = chain.named(self.joint_labels)
        limits = self.__dict__["limits"] = limits.for_chain(chain)
        if limits.joints != self.joints:
            expected = f"{self.joints} values, one per joint of the waypoints"
            raise InvalidInput("limits.velocity", expected, value=limits.joints)
        if limits.segments not in (None, self.segments):
            right = f"{self.segments} segments, as the waypoints have"
            name = next(key for key, own in limits.kinds.items() if own.segments)
            raise InvalidInput(f"limits.{name}", right, value=limits.segments)
        check_length("name", name)
        _check_joint_units(self.joint_units, self.joints)
        self._check_waypoints()
        for key, numbers in route.demands.items():
            DEMANDS[key].check(numbers, route.demands, limits)
        if self.joint_names:
            check_joint_names(self.joint_names, self.joints)
        if chain is not None and chain.joints != self.joints:
            raise InvalidInput("chain", f"{self.joints} joints", value=chain.joints)
        for own in limits.kinds.values():
            error = own.contradicted(self)
            if error is not None:
                raise error

    def _hold(
        self,
        route: Route,
        limits: Limits,
        name: str,
        source: str,
        joint_names: tuple[str, ...],
        joint_units: tuple[str, ...],
        chain: LinkChain | None,
    ) -> None:
        """Set every attribute, without a check."""
        self.__dict__.update(
            {key: route.demand(key) for key in DEMANDS},
            route=route,
            waypoints=route.waypoints,
            limits=limits,
            name=name,
            source=source,
            joint_names=joint_names,
            joint_units=joint_units,
            chain=chain,
            demands=route.demands,
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Problem):
            return NotImplemented
        return self.digest() == other.digest()

    def __hash__(self) -> int:
        return hash(self.digest())

    def __repr__(self) -> str:
        limits = ", ".join(self.limits.kinds)
        size = f"{len(self.waypoints)} waypoints, {self.joints} joint{'s' * (self.joints > 1)}"
        demands = f", demands: {', '.join(self.demands)}" if self.demands else ""
        return f"Problem({self.name!r}, {size}, limits: {limits}{demands})"

    @property
    def joints(self) -> int:
        return int(self.waypoints.shape[1])

    @property
    def joint_labels(self) -> tuple[str, ...]:
        """A label of each joint: its name, or its number from 1."""
        numbered = tuple(f"joint {joint + 1}" for joint in range(self.joints))
        return self.joint_names or numbered

    def unit(self, joint: int, order: int = 0) -> str:
        """The unit of a joint's position or of its derivative of this order, rad/s or m/s say."""
        length = self.joint_units[joint] if self.joint_units else "rad"
        return length + _PER_TIME[order]

    def shared_unit(self, order: int = 0) -> str:
        """The unit of all joints together: rad, m, or "rad or m" where there are both."""
        units = {self.unit(joint, order) for joint in range(self.joints)}
        return " or ".join(sorted(units, reverse=True))

    @property
    def segments(self) -> int:
        return self.route.segments

    @property
    def displacements(self) -> Array:
        """`h_k = q_k − q_{k−1}`, `(segments, joints)`, rad."""
        return self.route.displacements

    @property
    def moving(self) -> Bools:
        """Which joints move at all, `(joints,)`."""
        return self.route.moving

    @property
    def largest_displacements(self) -> Array:
        """Largest `|h_k|` of each joint, rad, `(joints,)`; a joint at rest gets the largest."""
        return self.route.largest_displacements

    @property
    def rounding(self) -> Array:
        """Some units in the last place of each joint's largest coordinate, rad, `(joints,)`."""
        return self.route.rounding

    def merged(self) -> tuple[Problem, Indices]:
        """This problem with consecutive identical waypoints merged, and where each one went.

        `times[index]` expands the merged problem's waypoint times to this one's. A segment between
        two that are the same takes no time, and its own limits ask nothing.
        """
        route, index = self.route.merged()
        return self if route is self.route else self.at(np.diff(index, prepend=-1) > 0), index

    def at(self, kept: Bools) -> Problem:
        """This problem through some of its waypoints, `(waypoints,)`.

        Where segments have limits of their own, those of a longer one are its last part's.
        """
        route = self.route.at(kept)
        limits = self.limits.of_segments(np.flatnonzero(kept)[1:] - 1)
        return replace(self, waypoints=route.waypoints, demands=route.demands, limits=limits)

    def along(self, route: Route) -> Problem:
        """This problem along another route of its joints, of as many segments."""
        return replace(self, waypoints=route.waypoints, demands=route.demands)

    def without(self, *names: str) -> Problem:
        """This problem with the named limits lifted, and without the named demands.

        It is a relaxation of it where only limits are named.
        """
        if not any(name in self.limits.kinds or name in self.demands for name in names):
            return self
        limits = self.limits.without(*names)
        left = {
            key: DEMANDS[key].under(own, limits)
            for key, own in self.demands.items()
            if key not in names
        }
        return replace(self, limits=limits, demands=left)

    def only(self, joints: ArrayLike) -> Problem:
        """The problem of some joints, by index (from 0) or mask: a relaxation of it.

        Limits that depend on several joints are left out, unless all other joints rest.

        Raises:
            InvalidInput: None of these joints moves.
        """
        kept = np.arange(self.joints)[np.asarray(joints)]
        names, units = (
            tuple(own[joint] for joint in kept.tolist()) if own else own
            for own in (self.joint_names, self.joint_units)
        )
        if names:
            check_joint_names(names, len(kept))
        # what is right for all joints is right for some, but that they move: the route asks that
        part = object.__new__(type(self))
        others = np.delete(self.moving, kept)
        limits = self.limits.only(kept, None if others.any() else self.waypoints[0])
        part._hold(self.route.only(kept), limits, self.name, self.source, names, units, None)
        return part

    def has(self, key: str) -> bool:
        """Return whether a limit of this kind bounds any joint."""
        return key in self.limits.kinds

    def digest(self) -> str:
        """SHA-256 of the numbers (not of names): a changed problem has another digest."""
        return self._digest

    @cached_property
    def _digest(self) -> str:
        import hashlib  # OpenSSL: not where problems are only listed

        digest = hashlib.sha256()
        always = self.limits.by_name()
        # Whatever is not there by default counts only where it is there.
        kinds = self.limits.kinds
        others = {key: own.numbers for key, own in kinds.items() if key not in always}
        others |= self.demands
        parts = [("", self.waypoints), *(("", pairs) for pairs in always.values())]
        parts += [(key, others[key]) for key in sorted(others)]
        for key, array in parts:
            numbers = (array + 0.0).astype("<f8")  # −0.0 is 0.0
            digest.update(key.encode())
            digest.update(repr(array.shape).encode())
            digest.update(numbers.tobytes())
        return digest.hexdigest()

    @classmethod
    def from_toml(cls, path: str | Path) -> Problem:
        """Read a problem file (`trajopt.core.problem_file`).

        Warns with `UnitWarning` where one unit is given for everything, but waypoints and limits
        look as if they were written in different ones.

        Raises:
            InvalidInput: Names the file, the key, the joint, the value, and what would be right.
        """
        return problem_file.read(Path(path), cls)

    def to_toml(self) -> str:
        """The problem file, in radians; reading it back gives the same digest."""
        return problem_file.text(self)

    def _check_waypoints(self) -> None:
        lows, highs = self.limits.position.T
        outside = (self.waypoints < lows) | (self.waypoints > highs)
        for row, joint in np.argwhere(outside):
            low = lows[joint]
            high = highs[joint]
            range_ = f"[{low:.9g}, {high:.9g}] {self.unit(joint)}"
            right = f"a value inside limits.position {range_}"
            raise InvalidInput(
                f"waypoints, waypoint {row + 1}",
                right,
                value=float(self.waypoints[row, joint]),
                joint=int(joint),
            )


def check_problem(value: object) -> Problem:
    """Return a problem as it is.

    Raises:
        WrongType: The value is no problem; the message says how one is made.
    """
    if isinstance(value, Problem):
        return value
    raise WrongType(
        f"expected a trajopt.Problem, got {shown(value)}: make one with "
        "Problem(waypoints, Limits(velocity, acceleration)) or Problem.from_toml(file)"
    )


def _check_joint_units(units: Sequence[str], joints: int) -> None:
    if len(units) not in (0, joints):
        right = f"{joints} units, one per joint of the waypoints"
        raise InvalidInput("units", right, value=list(units))
    for joint, unit in enumerate(units):
        if unit not in ("rad", "m"):
            raise InvalidInput("joint_units", '"rad" or "m"', value=unit, joint=joint)
