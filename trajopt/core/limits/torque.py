"""A limit on the torque of each joint's drive."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.bodies import body, described
from trajopt.core.chain import UNKNOWN_MASSES, LinkChain
from trajopt.core.dynamics import Dynamics
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.fields import Quantity
from trajopt.core.limits.joint_limit import by_segment
from trajopt.core.limits.limit import Limit, Use, where
from trajopt.core.limits.link_frames import FRAMES, FramesLimit, frame_columns
from trajopt.core.limits.rows import JointState, Row, sign
from trajopt.core.numerals import is_number, parsed
from trajopt.core.tables import is_list

if TYPE_CHECKING:
    from trajopt.core.problem import Problem
    from trajopt.core.trajectory import Trajectory

_SHARE = re.compile(r"\s*(\d+(?:\.\d+)?)\s*%\s*")
_SOURCES = ("urdf", "robot")
_SLOWEST = 1e6  # a dilation after which gravity alone is left


@dataclass(frozen=True, eq=False)
class Torque(FramesLimit):
    """Torque of each joint's drive, N m (N of a joint that slides), by the arm's masses.

    A problem file states a number per joint, `inf` for none, where the masses are known; or `true`
    for those that the robot's maker states, and `"60 %"` for a share of them. Else a table with the
    numbers, the link frames (as of a tool's speed, without the tool), `mass` (kg), `centre` (m, in
    the joint's frame) and `inertia` (kg m² about it: xx, xy, xz, yy, yz, zz) of what each joint
    moves, viscous `damping` (N m s/rad), Coulomb `friction` (N m), and `gravity` (m/s², in the
    base).

    The torque is that of Newton's and Euler's equations (docs/mathematics.md, section 9). If the
    motion is dilated by `k`, the part of gravity and Coulomb friction stays, that of damping falls
    as `1 / k`, the rest as `1 / k²`. Coulomb friction has the sign of the velocity: where that
    changes, both sides count; at rest there is none. Planners count it against the drive.
    """

    key = "torque"
    degree = None
    of_chain = True
    monotone = False
    flag = "Torques of the drives: urdf or robot, as stated there; a share, 60%; or N m: 9,9,4."
    flag_is_text = True
    fields = (
        Quantity("torque", widens=1),
        *FRAMES,
        Quantity("mass"),
        Quantity("centre", count=3),
        Quantity("inertia", count=6),
        Quantity("damping"),
        Quantity("friction"),
        Quantity("gravity", count=3, common=True),
    )

    def __post_init__(self) -> None:
        numbers = np.array(self.numbers)
        numbers[..., 0][numbers[..., 0] == np.inf] = np.nan  # stores have one sign of no limit
        object.__setattr__(self, "numbers", numbers)
        super().__post_init__()
        torque = self.column("torque")
        if self.is_complete:
            wrong = ~(np.isnan(torque) | (torque > 0)).reshape(-1, len(self.bounds))
            self.refuse("torque", "a positive number, or inf", np.asarray(wrong.any(axis=0)))
            for key in ("damping", "friction"):
                self.refuse(key, "0 or more", self.column(key) < 0)
            for joint in range(len(self.bounds)):
                self._body(joint)

    def _body(self, joint: int) -> Array:
        mass, centre, inertia = (self.column(key)[joint] for key in ("mass", "centre", "inertia"))
        try:
            return body(float(mass), centre.tolist(), inertia.tolist())
        except InvalidInput as error:
            key = f"limits.{self.key}.{error.key}"
            raise InvalidInput(key, error.expected, value=error.value, joint=joint) from None

    @classmethod
    def is_of_each(cls, value: Any) -> bool:
        return super().is_of_each(value) and all(map(is_list, value))

    @classmethod
    def read_one(cls, value: Any, joints: int) -> Self:
        """Return the limit of a number per joint, a share of what a maker states, or a table.

        `inf` is no limit.
        """
        if isinstance(value, Mapping):
            return super().read_one(value, joints)
        columns = sum(field.columns for field in cls.fields)
        numbers = np.full((joints, columns), np.nan)
        share = _share(value)
        if share is not None:
            numbers[:, 0] = -share
            return cls(numbers)
        if isinstance(value, str) and "," in value:  # on the command line
            texts = [own.strip() for own in value.split(",")]
            value = [np.inf if own == "inf" else parsed(own) for own in texts]
        right = f"{joints} numbers, N m, one per joint; or true, or a share as in '60 %'"
        if not is_list(value) or len(value) != joints:
            raise InvalidInput(f"limits.{cls.key}", right, value=value)
        for joint, item in enumerate(value):
            if not ((is_number(item) and item > 0) or item == np.inf):
                right = "a positive number, N m, or inf"
                raise InvalidInput(f"limits.{cls.key}", right, value=item, joint=joint)
        numbers[:, 0] = value
        return cls(numbers)

    @classmethod
    def unlimited(cls, numbers: Array) -> Bools:
        """Return whether no joint has a finite torque, for every joint."""
        return np.full(len(numbers), not np.isfinite(numbers[:, 0]).any())

    def stated(self, column: Array) -> Any:
        if column[0] < 0:
            return f"{-100 * column[0]:.12g} %"
        return np.nan_to_num(column, nan=np.inf).tolist()

    def for_chain(self, chain: LinkChain | None) -> Limit:
        """Return the limit with an arm's masses, if it has none yet.

        Raises:
            InvalidInput: The arm's link frames or masses are not known, or are no masses; or its
                drives' torques are asked for, and one is not known.
        """
        if self.is_complete or not self.bounds.any():
            return self
        key, joints = f"limits.{self.key}", len(self.bounds)
        if chain is None or chain.joints != joints:
            raise InvalidInput(key, UNKNOWN_MASSES, value=self.table())
        masses = chain.known_masses(key, self.table())
        torque = self.column("torque")
        shared = torque < 0  # a share of the arm's own
        for *_, joint in np.argwhere(shared & ~(masses.effort > 0)).tolist():
            right = "a number per joint, N m: the arm's own is not known"
            raise InvalidInput(key, right, value=self.table(), joint=joint)
        numbers = self.numbers.copy()
        numbers[..., 0] = np.where(shared, -torque * masses.effort, torque)
        columns = [
            frame_columns(chain),
            np.array([described(own) for own in masses.bodies]),
            masses.damping,
            masses.friction,
            np.tile(masses.gravity, (joints, 1)),
        ]
        numbers[..., 1:] = np.column_stack(columns)
        return type(self)(numbers)

    @cached_property
    def dynamics(self) -> Dynamics:
        """The arm's links and masses."""
        return Dynamics(
            self.origins,
            self.column("axes"),
            self.column("slides") != 0,
            np.array([self._body(joint) for joint in range(len(self.bounds))]),
            self.column("damping"),
            self.column("gravity")[0],
        )

    def rows(self, at: JointState) -> Iterator[Row]:
        """Yield the torque of each drive, as a share of its limit."""
        return self._rows_with(at, sign)

    def path_rows(self, at: JointState) -> Iterator[Row]:
        """Yield the rows with Coulomb friction that acts against the drive."""
        return self._rows_with(at, lambda velocity, side: side)

    def _rows_with(self, at: JointState, direction: Callable[[Any, float], Any]) -> Iterator[Row]:
        friction = self.column("friction").tolist()
        for joint, force in enumerate(self.dynamics.forces(at.q, at.v, at.a)):
            if not self.bounds[joint]:
                continue
            torque, wider = self.within(joint, at.segments)
            for side in (1.0, -1.0) if friction[joint] else (0.0,):
                rubbing = friction[joint] * direction(at.v[joint], side) if side else 0.0
                yield Row((force + rubbing) / torque, -wider, wider, joint=joint)

    def held(self, place: Array) -> Array:
        """Return the torque of each drive at rest, N m, `(joints,)`."""
        rest = np.zeros(len(place)).tolist()
        return np.array(self.dynamics.forces(place.tolist(), rest, rest), dtype=float)

    def contradicted(self, problem: Problem) -> InvalidInput | None:
        """Return the error of a problem whose arm must rest where a drive does not hold it.

        It names the joint, the waypoint, and the torque that gravity asks for there.
        """
        limits = np.nan_to_num(self.column("torque"), nan=np.inf)
        limits = np.broadcast_to(limits, (problem.segments, problem.joints))
        for waypoint in problem.route.rests.tolist():
            allowed = limits[max(waypoint - 1, 0) : waypoint + 1].max(axis=0).tolist()
            for joint, torque in enumerate(self.held(problem.waypoints[waypoint]).tolist()):
                if abs(torque) > allowed[joint]:
                    label = problem.joint_labels[joint]
                    right = (
                        f"at least {abs(torque):.6g} {self._unit(joint)}, by which {label} holds "
                        f"the arm at rest at waypoint {waypoint + 1}"
                    )
                    value = allowed[joint]
                    return InvalidInput(f"limits.{self.key}", right, value=value, joint=joint)
        return None

    # --- words ---

    def _unit(self, joint: int) -> str:
        return "N" if self.column("slides")[joint] else "N m"

    def unit(self, problem: Problem) -> str:
        units = {self._unit(joint) for joint in np.flatnonzero(self.bounds).tolist()}
        return units.pop() if len(units) == 1 else ""

    def of_joint(self, joint: int, problem: Problem) -> str:
        if not self.bounds[joint]:
            return "–"
        each = self.column("torque")[..., joint].ravel().tolist()
        unit = self._unit(joint)
        return by_segment(["–" if np.isnan(own) else f"{own:.6g} {unit}" for own in each])

    def hopeless(self, use: Use, motion: Trajectory, problem: Problem) -> str:
        at = self.worst(motion.dilated(_SLOWEST))
        assert at.joint is not None
        time = at.time / _SLOWEST
        holds = abs(float(self.held(motion(time))[at.joint]))
        least, wider = self.within(at.joint, motion.segments_at(time))
        limit = float(least * wider)
        place = where(at._replace(time=time), problem)
        unit = self._unit(at.joint)
        return f"{place}: holds {holds:.6g} {unit} against gravity, its limit is {limit:.6g} {unit}"


def _share(value: Any) -> float | None:
    """Return the share of a maker's torques that a value states; None where it states none."""
    if value is True or (isinstance(value, str) and value.strip().lower() in _SOURCES):
        return 1.0
    match = _SHARE.fullmatch(value) if isinstance(value, str) else None
    share = float(match[1]) / 100 if match else 0.0
    return share or None
