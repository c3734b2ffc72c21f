"""Link frames: a chain of joints, and where each link is at given joint positions.

A joint's frame lies on the link before it, by an origin as in a URDF, and the link after it turns
about an axis of that frame, or slides along it. Modified Denavit–Hartenberg parameters (Craig) are
the special case of an axis z.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools
from trajopt.core.bodies import Masses
from trajopt.core.exceptions import InvalidInput

KEYS = ("xyz", "rpy", "axis", "tool_xyz", "tool_rpy")
"""The keys of a chain in a robot's file; those of the tool are optional."""
REQUIRED = KEYS[:3]
UNKNOWN_MASSES = (
    "an arm whose masses are known: a robot's (`trajopt list robots` says which), a URDF's with "
    "<inertial>, or [dynamics] of a problem file"
)
_ROUNDING = 1e-15
"""Entries of rotations that are smaller are rounded zeros: a tool's place changes by 1e-15 m."""


class LinkFrame(NamedTuple):
    """The frame of a link.

    Attributes:
        joint: index, from 0, of the joint that moves the link.
        pose: in that joint's frame, m, `(4, 4)`.
    """

    joint: int
    pose: Array


class LinkPoint(NamedTuple):
    """A point that is fixed to a link.

    Attributes:
        joint: index, from 0, of the joint that moves the link.
        place: in that joint's frame, m, `(3,)`.
    """

    joint: int
    place: Array


@dataclass(frozen=True, eq=False)
class LinkChain:
    """Joints one after another, from the base to the tool.

    Attributes:
        origins: Pose of each joint's frame in the frame of the joint before, of the first one's in
            the base, where all joints are at 0; m, `(joints, 4, 4)`.
        axes: Unit vectors in each joint's own frame, `(joints, 3)`.
        slides: Which joints slide along their axes, `(joints,)`; the others turn about them.
        tool: Pose of the tool in the last joint's frame, m, `(4, 4)`.
        masses: What the joints move; None where that is not known, or the error of what a file
            states, which is raised where they are needed.
        links: The frames of links by their names, as far as these are known.
    """

    origins: Array
    axes: Array
    slides: Bools
    tool: Array = field(default_factory=partial(np.eye, 4))
    masses: Masses | InvalidInput | None = None
    links: Mapping[str, LinkFrame] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for key, value in vars(self).items():
            if key in ("masses", "links"):
                continue
            array = np.array(value, dtype=bool if key == "slides" else float)
            array.setflags(write=False)
            object.__setattr__(self, key, array)

    @property
    def joints(self) -> int:
        return len(self.axes)

    @property
    def tool_point(self) -> LinkPoint:
        """Return the tool's origin."""
        return LinkPoint(self.joints - 1, self.tool[:3, 3])

    def named(self, joints: Sequence[str]) -> LinkChain:
        """Return the chain in which each joint's name also names the link that it moves.

        Such a link begins at its joint's frame. A link that has that name already keeps its own.
        """
        numbered = zip(joints, range(self.joints), strict=False)
        by_joint = {name: LinkFrame(joint, np.eye(4)) for name, joint in numbered}
        return replace(self, links={**by_joint, **self.links})

    def carrying(self, payload: Mapping[str, Any]) -> LinkChain:
        """Return the chain with a payload at its tool (`Masses.carrying`).

        Raises:
            InvalidInput: The masses of the arm are not known, or it cannot carry that.
        """
        masses = self.known_masses("payload", payload.get("mass"))
        return replace(self, masses=masses.carrying(payload, self.tool))

    def known_masses(self, key: str, value: Any) -> Masses:
        """Return what the joints move.

        Raises:
            InvalidInput: The masses are not known, and the error names this key and value; or the
                masses in a file are wrong, and the error is that of the file.
        """
        if isinstance(self.masses, InvalidInput):
            raise self.masses
        if self.masses is None:
            raise InvalidInput(key, UNKNOWN_MASSES, value=value)
        return self.masses

    def frames(self, q: Any) -> Array:
        """Return the poses of all links and of the tool, m, `(…, joints + 1, 4, 4)`.

        Args:
            q: Joint positions, `(…, joints)`, rad (m); complex numbers give derivatives.
        """
        q = np.asarray(q)
        steps = self.origins @ self._moves(q)
        pose = np.broadcast_to(np.eye(4, dtype=steps.dtype), (*q.shape[:-1], 4, 4))
        found = []
        for joint in range(self.joints):
            pose = pose @ steps[..., joint, :, :]
            found.append(pose)
        return np.stack([*found, pose @ self.tool], axis=-3)

    def forward(self, q: Any) -> Array:
        """Return the pose of the tool, m, `(…, 4, 4)`, at positions `(…, joints)`, rad (m)."""
        return self.frames(q)[..., -1, :, :]

    def places(self, q: Any, point: LinkPoint) -> Array:
        """Return the place of a point, m, `(…, 3)`, at positions `(…, joints)`, rad (m)."""
        pose = self.frames(q)[..., point.joint, :3, :]
        return np.asarray(pose[..., :3] @ point.place + pose[..., 3])

    def moving(
        self, point: LinkPoint, q: Sequence[Any], v: Sequence[Any]
    ) -> tuple[list[Any], list[Any]]:
        """Return position, m, and velocity, m/s, of a point of a link: x, y and z of each.

        The formula takes whatever knows `+`, `−`, `×`, and NumPy's sine and cosine: numbers, arrays
        of states, enclosures, symbols.

        Args:
            point: The point.
            q: Position of each joint, rad (m).
            v: Velocity of each joint, rad/s (m/s).
        """
        place: list[Any] = point.place.tolist()
        speed: list[Any] = [0.0, 0.0, 0.0]
        # from the point to the base: each joint moves what follows it, in its own frame
        for joint in reversed(range(point.joint + 1)):
            turn, shift = self.origins[joint, :3, :3], self.origins[joint, :3, 3].tolist()
            if self.slides[joint]:
                axis = self.axes[joint].tolist()
                place = plus(place, [q[joint] * entry for entry in axis])
                speed = plus(speed, [v[joint] * entry for entry in axis])
            else:
                cross = self._crosses[joint]
                lever = applied(cross, place)
                speed = plus(speed, [v[joint] * entry for entry in lever])
                sine, cosine = np.sin(q[joint]), np.cos(q[joint])
                place, speed = (_turned(cross, sine, cosine, entry) for entry in (place, speed))
            place, speed = plus(applied(turn, place), shift), applied(turn, speed)
        return place, speed

    @property
    def _crosses(self) -> Array:
        """Return the matrices of the cross products with the axes, `(joints, 3, 3)`."""
        x, y, z = self.axes.T
        zero = np.zeros_like(x)
        return _matrix([[zero, -z, y], [z, zero, -x], [-y, x, zero]])

    def _moves(self, q: Array) -> Array:
        """Return what each joint's own motion does to its frame, `(…, joints, 4, 4)`.

        A turn by the angle θ about the unit vector u is `1 + sin θ [u] + (1 − cos θ) [u]²`
        (Rodrigues).
        """
        cross = self._crosses
        angle = np.where(self.slides, 0.0, q)[..., None, None]
        moves = np.zeros((*q.shape, 4, 4), dtype=angle.dtype)
        moves[..., :3, :3] = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
        moves[..., :3, 3] = np.where(self.slides, q, 0.0)[..., None] * self.axes
        moves[..., 3, 3] = 1.0
        return moves

    @classmethod
    def modified_dh(cls, a: Array, alpha: Array, d: Array, theta: Array) -> LinkChain:
        """Return the chain of turning joints by their modified Denavit–Hartenberg table (Craig).

        Args:
            a: `a_{i−1}` of each joint, m, `(joints,)`.
            alpha: `α_{i−1}`, rad.
            d: `d_i`, m.
            theta: What is added to the joint's angle, rad.
        """
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        zero, one = np.zeros(len(a)), np.ones(len(a))
        rows = [
            [c, -s, zero, a],
            [s * ca, c * ca, -sa, -d * sa],
            [s * sa, c * sa, ca, d * ca],
            [zero, zero, zero, one],
        ]
        axes = np.tile([0.0, 0.0, 1.0], (len(a), 1))
        return cls(_matrix(rows), axes, np.zeros(len(a), dtype=bool))

    @classmethod
    def read(
        cls,
        table: Mapping[str, Any],
        joints: int,
        slides: Bools | None = None,
        moved: Mapping[str, Any] | None = None,
    ) -> LinkChain:
        """Return the chain that a file of a robot or a problem states.

        Args:
            table: `xyz` (m), `rpy` (rad) and `axis`, three numbers per joint, as in the `<origin>`
                and the `<axis>` of a URDF; and `tool_xyz`, `tool_rpy` where there is a tool.
            joints: How many joints the robot has.
            slides: Which of them slide, `(joints,)`; by default all turn.
            moved: `[dynamics]` of the file, as `Masses.read` takes it, where it has that.

        Raises:
            InvalidInput: Names the key, the joint, the value, and what would be right.
        """
        xyz, rpy, axis = (_triples(f"chain.{key}", table.get(key), joints) for key in REQUIRED)
        tool = np.eye(4)
        if "tool_xyz" in table or "tool_rpy" in table:
            tool_pose = [table.get(key, [0, 0, 0]) for key in KEYS[3:]]
            at, turned = (_triples(key, [v], 1) for key, v in zip(KEYS[3:], tool_pose, strict=True))
            tool = origin_poses(at, turned)[0]
        slides = np.zeros(joints, dtype=bool) if slides is None else slides
        masses = None if moved is None else Masses.read(moved, joints)
        return cls(origin_poses(xyz, rpy), unit_axes("chain.axis", axis), slides, tool, masses)


class JointFrame(NamedTuple):
    """A joint's frame in a robot that may branch.

    Attributes:
        before: Name of the joint on the way to the base that moves its link; None at the base.
        origin: Pose in the frame of that joint, or in the base, m, `(4, 4)`.
        axis: Unit vector in its own frame, `(3,)`.
        slides: Whether it slides; else it turns.
        tool: Pose of what is fixed behind it, in its own frame, m, `(4, 4)`.
        body: What is fixed to it, in its own frame (`trajopt.core.bodies`), `(4, 4)`; None where
            that is not known, or the error of what a file states.
        damping: Viscous friction, N m s/rad (N s/m).
        friction: Coulomb friction, N m (N).
        effort: The largest torque, N m, or force, N, of its drive; NaN where it is not known.
        payload: The largest mass that the arm may carry, kg.
        links: Poses of links that are fixed to it, in its own frame, m, `(4, 4)`, by name.
    """

    before: str | None
    origin: Array
    axis: Array
    slides: bool
    tool: Array
    body: Array | InvalidInput | None = None
    damping: float = 0.0
    friction: float = 0.0
    effort: float = np.nan
    payload: float = np.inf
    links: Mapping[str, Array] = MappingProxyType({})


def frames_of(chain: LinkChain | None, names: Sequence[str]) -> dict[str, JointFrame]:
    """Return the frames of a chain's joints by their names; none where there is no chain."""
    if chain is None:
        return {}
    tools = [np.eye(4)] * (chain.joints - 1) + [chain.tool]
    found = {
        name: JointFrame(before, *parts)
        for before, name, *parts in zip(
            (None, *names), names, chain.origins, chain.axes, chain.slides, tools, strict=False
        )
    }
    for link, (joint, pose) in chain.links.items():
        frame = found[names[joint]]
        found[names[joint]] = frame._replace(links={**frame.links, link: pose})
    masses = chain.masses
    if isinstance(masses, Masses):
        columns = masses.bodies, masses.damping, masses.friction, masses.effort
        for name, body, damping, friction, effort in zip(names, *columns, strict=True):
            found[name] = found[name]._replace(
                body=body,
                damping=damping,
                friction=friction,
                effort=effort,
                payload=masses.payload,
            )
    return found


def chain_of(frames: Mapping[str, JointFrame], names: Sequence[str]) -> LinkChain | None:
    """Return the chain of some joints; the others on their way to the base stay at 0.

    None where a joint has no frame, or they do not follow one another in this order.
    """
    try:
        return linked(frames, names)
    except InvalidInput:
        return None


def linked(frames: Mapping[str, JointFrame], names: Sequence[str]) -> LinkChain:
    """Return the chain of some joints, as `chain_of`.

    Raises:
        InvalidInput: Names the joint without a frame, or those that do not follow one another.
    """
    way: list[str] = []
    name = names[-1] if names else None
    while name is not None:
        if name not in frames or name in way:
            raise InvalidInput("link frames", "a frame of each joint on the way", value=name)
        way.insert(0, name)
        name = frames[name].before
    origins = []
    pose = np.eye(4)
    for name in way:
        pose = pose @ frames[name].origin
        if name in names:
            origins.append(pose)
            pose = np.eye(4)
    if not names or [name for name in way if name in names] != list(names):
        right = f"joints one behind the other, from the base to {', '.join(names[-1:])}"
        raise InvalidInput("link frames", right, value=list(names))
    joint_frames = [frames[name] for name in names]
    axes = np.array([frame.axis for frame in joint_frames])
    slides = np.array([frame.slides for frame in joint_frames])
    links = {
        link: LinkFrame(names.index(at), pose @ offset)
        for name, at, pose in _carried(frames, names)
        for link, offset in frames[name].links.items()
    }
    masses = _masses(frames, names)
    return LinkChain(np.array(origins), axes, slides, joint_frames[-1].tool, masses, links)


def _carried(
    frames: Mapping[str, JointFrame], names: Sequence[str]
) -> Iterator[tuple[str, str, Array]]:
    """Yield each joint whose link moves, the joint of `names` that moves it, and its frame there.

    Joints that `names` leaves out stay at 0, so what is behind them moves with the last of `names`
    before them. The frame is a pose in that joint's frame, m, `(4, 4)`.
    """
    for name in frames:
        pose = np.eye(4)
        at: str | None = name
        for _ in frames:  # no longer than the robot, even in a loop
            if at is None or at in names or at not in frames:
                break
            pose, at = frames[at].origin @ pose, frames[at].before
        if at is not None and at in names:
            yield name, at, pose


def _masses(frames: Mapping[str, JointFrame], names: Sequence[str]) -> Masses | InvalidInput | None:
    """Return what some joints move; all others stay at 0."""
    bodies = dict.fromkeys(names, np.zeros((4, 4)))
    for name, at, pose in _carried(frames, names):
        own_body = frames[name].body
        if not isinstance(own_body, np.ndarray):
            return own_body
        bodies[at] = bodies[at] + pose @ own_body @ pose.T
    last = names[-1]
    if not bodies[last].any():
        right = "a link with a mass behind the last joint"
        return InvalidInput(f"mass behind {last}", right, value=0)
    joint_frames = [frames[name] for name in names]
    damping, friction, effort = (
        np.array([getattr(frame, key) for frame in joint_frames])
        for key in ("damping", "friction", "effort")
    )
    every = np.array(list(bodies.values()))
    return Masses(every, damping, friction, effort, joint_frames[-1].payload)


def origin_poses(xyz: Array, rpy: Array) -> Array:
    """Return poses `(…, 4, 4)` of origins as a URDF states them.

    Args:
        xyz: Positions, m, `(…, 3)`.
        rpy: Turns about the fixed axes x, then y, then z, rad, `(…, 3)`.
    """
    (cx, cy, cz), (sx, sy, sz) = (np.moveaxis(wave(rpy), -1, 0) for wave in (np.cos, np.sin))
    x, y, z = np.moveaxis(xyz, -1, 0)
    zero, one = np.zeros_like(x), np.ones_like(x)
    rows = [
        [cy * cz, sx * sy * cz - cx * sz, cx * sy * cz + sx * sz, x],
        [cy * sz, sx * sy * sz + cx * cz, cx * sy * sz - sx * cz, y],
        [-sy, sx * cy, cx * cy, z],
        [zero, zero, zero, one],
    ]
    return _matrix(rows)


def unit_axes(key: str, axes: Array) -> Array:
    """Return axes `(joints, 3)` of length 1; raise `InvalidInput` where one has none."""
    sizes = np.linalg.norm(axes, axis=-1, keepdims=True)
    for joint in np.flatnonzero(sizes == 0).tolist():
        raise InvalidInput(key, "a direction", value=axes[joint].tolist(), joint=joint)
    return axes / sizes


def _triples(key: str, value: Any, joints: int) -> Array:
    expected = f"three finite numbers per joint of {joints}"
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError):
        raise InvalidInput(key, expected, value=value) from None
    if array.shape != (joints, 3) or not np.isfinite(array).all():
        raise InvalidInput(key, expected, value=value)
    return array


def _matrix(rows: Sequence[Sequence[Any]]) -> Array:
    """Return matrices `(…, rows, columns)` of their entries `(…)`."""
    return np.stack([np.stack(np.broadcast_arrays(*row), axis=-1) for row in rows], axis=-2)


def _turned(cross: Array, sine: Any, cosine: Any, vector: Sequence[Any]) -> list[Any]:
    """Return a vector turned about an axis, by Rodrigues' formula (`LinkChain._moves`)."""
    squared = cross @ cross
    along = applied(np.eye(3) + squared, vector)
    across = [cosine * entry for entry in applied(-squared, vector)]
    return plus(plus(along, across), [sine * entry for entry in applied(cross, vector)])


def plus(one: Sequence[Any], other: Sequence[Any]) -> list[Any]:
    """Return the sum of two vectors; a number 0 is left out."""
    pairs = zip(one, other, strict=True)
    return [b if is_zero(a) else a if is_zero(b) else a + b for a, b in pairs]


def applied(matrix: Array, vector: Sequence[Any]) -> list[Any]:
    """Return a matrix of numbers times a vector; terms of rounding size are left out."""
    found = []
    for row in matrix.tolist():
        terms = [
            entry if factor == 1 else factor * entry
            for factor, entry in zip(row, vector, strict=True)
            if abs(factor) > _ROUNDING and not is_zero(entry)
        ]
        found.append(sum(terms[1:], terms[0]) if terms else 0.0)
    return found


def is_zero(value: Any) -> bool:
    return isinstance(value, float) and value == 0
