"""Forces of joints: what moves the links of an arm against inertia, gravity and friction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.chain import applied, is_zero, plus


@dataclass(frozen=True, eq=False)
class Dynamics:
    """The masses of an arm behind each of its joints.

    Attributes:
        origins: Pose of each joint's frame in the frame of the joint before, m, `(joints, 4, 4)`.
        axes: Unit vectors in each joint's own frame, `(joints, 3)`.
        slides: Which joints slide along their axes, `(joints,)`.
        bodies: Pseudo-inertia of the bodies between each joint and the next one, in the joint's
            frame, `(joints, 4, 4)`.
        damping: Viscous friction, N m s/rad (N s/m), `(joints,)`.
        gravity: Acceleration by gravity in the base, m/s², `(3,)`.
    """

    origins: Array
    axes: Array
    slides: Bools
    bodies: Array
    damping: Array
    gravity: Array

    @cached_property
    def _frames(self) -> list[tuple[Array, list[float], list[float], Array]]:
        """Frames whose axis is z: turn and place in the one before, axis, and body of each."""
        found = []
        before = np.eye(3)
        for origin, axis, body in zip(self.origins, self.axes, self.bodies, strict=True):
            turn = _with_axis(axis)
            pose = np.eye(4)
            pose[:3, :3] = turn
            rotation = _clean(before.T @ origin[:3, :3] @ turn)
            place = _clean(before.T @ origin[:3, 3]).tolist()
            found.append((rotation, place, rotation[:, 2].tolist(), pose.T @ body @ pose))
            before = turn
        return found

    def forces(self, q: Sequence[Any], v: Sequence[Any], a: Sequence[Any]) -> list[Any]:
        """Return the torque of each joint's drive, N m; the force, N, of one that slides.

        Newton's and Euler's equations, outwards for motions and inwards for forces. The formula
        takes whatever knows `+`, `−`, `×`, and NumPy's sine and cosine.

        Args:
            q: Position of each joint, rad (m).
            v: Velocity, rad/s (m/s).
            a: Acceleration, rad/s² (m/s²).
        """
        spin: list[Any] = [0.0, 0.0, 0.0]  # angular velocity of the link before
        change: list[Any] = [0.0, 0.0, 0.0]  # angular acceleration
        rise: list[Any] = (-self.gravity).tolist()  # acceleration of the frame's origin, minus g
        swept = _swept(spin, change)
        waves = [
            (0.0, 0.0) if slides else (np.sin(angle), np.cos(angle))
            for angle, slides in zip(q, self.slides, strict=True)
        ]
        loads = []
        places = []
        for joint, (turn, place, axis, body) in enumerate(self._frames):
            if self.slides[joint]:
                place = plus(place, [_times(q[joint], entry) for entry in axis])
            places.append(place)
            rise = plus(rise, _linear(swept, place))
            rise, spin, change = (applied(turn.T, vector) for vector in (rise, spin, change))
            if self.slides[joint]:
                x, y, _ = spin  # Coriolis: 2 ω × v
                twice = 2.0 * v[joint]
                rise = plus(rise, [_times(y, twice), _negative(_times(x, twice)), a[joint]])
            else:
                rise, spin, change = (
                    _back(waves[joint], vector) for vector in (rise, spin, change)
                )
                x, y, z = spin
                gained = [_times(y, v[joint]), _negative(_times(x, v[joint])), a[joint]]
                change = plus(change, gained)
                spin = [x, y, _sum(z, v[joint])]
            swept = _swept(spin, change)
            loads.append(_load(body, rise, swept))
        force: list[Any] = [0.0, 0.0, 0.0]
        moment: list[Any] = [0.0, 0.0, 0.0]
        found: list[Any] = []
        for joint in reversed(range(len(loads))):
            force, moment = plus(force, loads[joint][0]), plus(moment, loads[joint][1])
            load = force[2] if self.slides[joint] else moment[2]
            damping = float(self.damping[joint])
            found.insert(0, load + damping * v[joint] if damping else load)
            turn = self._frames[joint][0]
            if not self.slides[joint]:
                force, moment = (_on(waves[joint], vector) for vector in (force, moment))
            force, moment = applied(turn, force), applied(turn, moment)
            moment = plus(moment, _cross(places[joint], force))
        return found


def _load(body: Array, rise: Sequence[Any], swept: Sequence[Sequence[Any]]) -> tuple[Any, Any]:
    """Return force and moment about the frame's origin that move a body.

    A mass point at `x` is accelerated by `rise + S x`; its moment is `m x × (rise + S x)`. Summed
    up, the second part is the skew part of `S Σ m x xᵀ`.
    """
    first = body[:3, 3].tolist()
    force = plus(applied(body[3, 3] * np.eye(3), rise), _linear(swept, first))
    columns = [_linear(swept, column) for column in body[:3, :3].T.tolist()]
    turning = [
        _sum(columns[1][2], _negative(columns[2][1])),
        _sum(columns[2][0], _negative(columns[0][2])),
        _sum(columns[0][1], _negative(columns[1][0])),
    ]
    return force, plus(_cross(first, rise), turning)


def _swept(spin: Sequence[Any], change: Sequence[Any]) -> list[list[Any]]:
    """Return the matrix `S = [ω̇] + ω ωᵀ − |ω|²` by which places of a turning body accelerate."""
    x, y, z = spin
    dx, dy, dz = change
    xx, yy, zz = _squared(x), _squared(y), _squared(z)
    xy, xz, yz = _times(x, y), _times(x, z), _times(y, z)
    return [
        [_negative(_sum(yy, zz)), _sum(xy, _negative(dz)), _sum(xz, dy)],
        [_sum(xy, dz), _negative(_sum(xx, zz)), _sum(yz, _negative(dx))],
        [_sum(xz, _negative(dy)), _sum(yz, dx), _negative(_sum(xx, yy))],
    ]


def _linear(matrix: Sequence[Sequence[Any]], vector: Sequence[Any]) -> list[Any]:
    found = []
    for row in matrix:
        total: Any = 0.0
        for entry, factor in zip(row, vector, strict=True):
            total = _sum(total, _times(entry, factor))
        found.append(total)
    return found


def _back(wave: tuple[Any, Any], vector: Sequence[Any]) -> list[Any]:
    """Return a vector in the frame that is turned about z, by sine and cosine of the angle."""
    sine, cosine = wave
    x, y, z = vector
    return [
        _sum(_times(cosine, x), _times(sine, y)),
        _sum(_times(cosine, y), _negative(_times(sine, x))),
        z,
    ]


def _on(wave: tuple[Any, Any], vector: Sequence[Any]) -> list[Any]:
    """Return a vector of the frame that is turned about z, in the frame that is not."""
    sine, cosine = wave
    return _back((-sine, cosine), vector)


def _cross(one: Sequence[Any], other: Sequence[Any]) -> list[Any]:
    a, b, c = one
    x, y, z = other
    return [
        _sum(_times(b, z), _negative(_times(c, y))),
        _sum(_times(c, x), _negative(_times(a, z))),
        _sum(_times(a, y), _negative(_times(b, x))),
    ]


def _times(one: Any, other: Any) -> Any:
    return 0.0 if is_zero(one) or is_zero(other) else one * other


def _squared(one: Any) -> Any:
    return 0.0 if is_zero(one) else one**2


def _negative(one: Any) -> Any:
    return one if is_zero(one) else -one


def _sum(one: Any, other: Any) -> Any:
    return other if is_zero(one) else one if is_zero(other) else one + other


def _with_axis(axis: Array) -> Array:
    """Return a rotation whose third column is the axis; exact for axes of a frame."""
    side = np.cross(np.eye(3)[np.abs(axis).argmin()], axis)
    side /= np.linalg.norm(side)
    return np.stack([side, np.cross(axis, side), axis], axis=1)


def _clean(numbers: Array) -> Array:
    """Return numbers without entries of rounding size."""
    return np.where(np.abs(numbers) < 1e-15, 0.0, numbers)
