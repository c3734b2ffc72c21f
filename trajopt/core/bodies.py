"""What joints move: masses, centres of mass, inertias, friction, and what drives them.

A body is its pseudo-inertia, the `(4, 4)` sum of `m x xᵀ` over its mass points, where `x` has a
place, m, and a 1. A pose `T` moves it to `T P Tᵀ`, bodies fixed to each other add up, and a matrix
is a body exactly if it is positive semidefinite (Wensing, Kim and Slotine 2018, doi
10.1109/LRA.2017.2729659).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.files import check_keys
from trajopt.core.numerals import is_number
from trajopt.core.tables import is_list

KEYS = ("mass", "centre", "inertia", "damping", "friction", "effort", "payload", "gravity")
"""The keys of `[dynamics]` in a robot's or a problem's file."""
REQUIRED = KEYS[:3]
PAYLOAD_KEYS = ("mass", "centre", "inertia")
GRAVITY = (0.0, 0.0, -9.81)
"""Acceleration by gravity in the frame of the base, m/s²."""
# By which the largest principal moment may exceed the sum of the others. No body's does, but energy
# stays positive and torques well defined, and numbers identified from torques do so: those of the
# Panda's fourth link in its maker's own file by 9 %. A wrong unit or sign is farther off.
_BODY_RTOL = 0.25
# More than this is not the rounding of printed digits: a line says so.
_DOUBT_RTOL = 0.01
_ROUNDING_RTOL = 1e-6
_TENSOR = np.triu_indices(3)  # xx, xy, xz, yy, yz, zz


def body(mass: float, centre: Sequence[float], inertia: Sequence[float]) -> Array:
    """Return the pseudo-inertia of a body, kg, kg m and kg m², `(4, 4)`.

    Args:
        mass: kg.
        centre: Its centre of mass, m, `(3,)`.
        inertia: Its tensor of inertia about that centre, kg m²: xx, xy, xz, yy, yz, zz.

    Raises:
        InvalidInput: No distribution of mass has these numbers; says which and why.
    """
    if not is_number(mass) or mass < 0:
        raise InvalidInput("mass", "a number from 0 on, kg", value=mass)
    tensor = _tensor(inertia)
    moments = _moments(inertia)
    first, second, third = moments.tolist()
    largest = float(np.abs(moments).max())
    if first < -_ROUNDING_RTOL * largest or third > (1 + _BODY_RTOL) * (first + second):
        right = "principal moments from 0 on, none larger than the sum of the other two, kg m²"
        raise InvalidInput("inertia", right, value=[float(f"{own:.4g}") for own in moments])
    if mass == 0 and third > 0:
        raise InvalidInput("mass", "a positive one beside an inertia, kg", value=mass)
    place = np.array([*centre, 1.0])
    found = mass * np.outer(place, place)
    found[:3, :3] += np.trace(tensor) / 2 * np.eye(3) - tensor
    return found


def _tensor(inertia: Sequence[float]) -> Array:
    tensor = np.zeros((3, 3))
    tensor[_TENSOR] = inertia
    return np.asarray(tensor + tensor.T - np.diag(tensor.diagonal()))


def _moments(inertia: Sequence[float]) -> Array:
    """Return the principal moments, the smallest first."""
    return np.asarray(np.linalg.eigvalsh(_tensor(inertia)))


def described(own: Array) -> list[float]:
    """Return mass, centre of mass and inertia about it of a body: 10 numbers, as `body` takes them.

    The centre of a body without mass is 0.
    """
    mass = float(own[3, 3])
    centre = own[:3, 3] / mass if mass else np.zeros(3)
    around = own[:3, :3] - mass * np.outer(centre, centre)
    tensor = np.trace(around) * np.eye(3) - around
    return [mass, *centre.tolist(), *tensor[_TENSOR].tolist()]


@dataclass(frozen=True, eq=False)
class Masses:
    """The bodies that the joints of an arm move, and their drives.

    Attributes:
        bodies: Of what is fixed to each joint, in its own frame, `(joints, 4, 4)`.
        damping: Viscous friction, N m s/rad (N s/m of a joint that slides), `(joints,)`.
        friction: Coulomb friction, N m (N), `(joints,)`.
        effort: The largest torque, N m, or force, N, of each drive; NaN where it is not known.
        payload: The largest mass that the arm may carry, kg; infinite where it is not known.
        gravity: Its acceleration in the frame of the base, m/s², `(3,)`.
    """

    bodies: Array
    damping: Array
    friction: Array
    effort: Array
    payload: float = np.inf
    gravity: tuple[float, ...] = GRAVITY

    @property
    def unreal(self) -> list[int]:
        """Return the joints, from 0, whose inertia no body has.

        Its largest principal moment is above the sum of the other two by more than rounding.
        """
        moments = np.array([_moments(described(own)[4:]) for own in self.bodies])
        over = moments[:, 2] > (1 + _DOUBT_RTOL) * (moments[:, 0] + moments[:, 1])
        return np.flatnonzero(over).tolist()

    @classmethod
    def read(cls, table: Mapping[str, Any], joints: int) -> Masses:
        """Return what `[dynamics]` of a file states.

        Args:
            table: `mass` (kg), `centre` (m, `[x, y, z]` in the joint's frame) and `inertia` (kg m²
                about it: xx, xy, xz, yy, yz, zz) per joint; and where they are known `damping`
                (viscous, N m s/rad), `friction` (Coulomb's, N m) and `effort` (N m) per joint,
                `payload` (kg), `gravity` (m/s²).
            joints: How many joints the arm has.

        Raises:
            InvalidInput: Names the key, the joint, the value, and what would be right.
        """
        mass, centre, inertia = (
            _rows(f"dynamics.{key}", table.get(key), joints, count)
            for key, count in zip(REQUIRED, (1, 3, 6), strict=True)
        )
        found = []
        for joint in range(joints):
            try:
                found.append(body(float(mass[joint, 0]), centre[joint], inertia[joint]))
            except InvalidInput as error:
                key = f"dynamics.{error.key}"
                raise InvalidInput(key, error.expected, value=error.value, joint=joint) from None
        bodies = np.array(found)
        rubbing = {}
        for key in ("damping", "friction"):
            own = _rows(f"dynamics.{key}", table.get(key, [0] * joints), joints, 1)[:, 0]
            for joint in np.flatnonzero(own < 0).tolist():
                value = float(own[joint])
                raise InvalidInput(f"dynamics.{key}", "0 or more", value=value, joint=joint)
            rubbing[key] = own
        effort = np.full(joints, np.nan)
        if "effort" in table:
            effort = _rows("dynamics.effort", table["effort"], joints, 1)[:, 0]
        payload = table.get("payload", np.inf)
        if payload != np.inf and (not is_number(payload) or payload < 0):
            raise InvalidInput("dynamics.payload", "a mass from 0 on, kg", value=payload)
        (gravity,) = _rows("dynamics.gravity", [table.get("gravity", GRAVITY)], 1, 3)
        return cls(
            bodies,
            **rubbing,
            effort=effort,
            payload=float(payload),
            gravity=tuple(gravity.tolist()),
        )

    def carrying(self, payload: Mapping[str, Any], tool: Array) -> Masses:
        """Return the masses with a payload that is fixed to the tool.

        Args:
            payload: `mass` (kg), and where they are known its `centre` (m, in the tool's frame) and
                `inertia` (kg m² about it: xx, xy, xz, yy, yz, zz); else it is a point at the tool.
            tool: Pose of the tool in the last joint's frame, m, `(4, 4)`.

        Raises:
            InvalidInput: Names the key, the value, and what would be right.
        """
        check_keys("payload.", payload, PAYLOAD_KEYS, ("mass",))
        (mass,) = _rows("payload.mass", [payload["mass"]], 1, 1)[0]
        (centre,) = _rows("payload.centre", [payload.get("centre", [0] * 3)], 1, 3)
        (inertia,) = _rows("payload.inertia", [payload.get("inertia", [0] * 6)], 1, 6)
        if mass > self.payload:
            right = f"at most {self.payload:g} kg, the payload of the arm"
            raise InvalidInput("payload.mass", right, value=float(mass))
        try:
            own = body(float(mass), centre, inertia)
        except InvalidInput as error:
            raise InvalidInput(f"payload.{error.key}", error.expected, value=error.value) from None
        bodies = np.array(self.bodies)
        bodies[-1] += tool @ own @ tool.T
        return replace(self, bodies=bodies)


def _rows(key: str, value: Any, joints: int, count: int) -> Array:
    """Return finite numbers, `(joints, count)`."""
    right = f"{joints} finite numbers" if count == 1 else f"{count} finite numbers per joint"
    if joints == 1:
        right = "a finite number" if count == 1 else f"{count} finite numbers"
    if not is_list(value) or len(value) != joints:
        raise InvalidInput(key, f"{right}, of {joints} joints", value=value)
    for joint, item in enumerate(value):
        parts = item if count > 1 and is_list(item) else [item]
        if len(parts) != count or not all(map(is_number, parts)):
            raise InvalidInput(key, right, value=item, joint=joint if joints > 1 else None)
    return np.array(value, dtype=float).reshape(joints, count)
