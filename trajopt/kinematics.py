"""Where a robot's hand is, and the joint angles that put it there: Cartesian path to `Problem`.

Modified Denavit–Hartenberg parameters (Craig), eq. 1 of Ma et al. 2024, for any chain of revolute
joints. The analytic inverse is for the commonest arm: six joints, the second and third parallel to
each other and perpendicular to the first, the last three meeting in one point (spherical wrist).
It is derived from eq. 1: there are slips in eq. 8 and 11–26 as printed there.
A pose is a 4 x 4 homogeneous matrix, or SciPy's `RigidTransform`, which takes any orientation.
"""

from __future__ import annotations

import itertools
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt.exceptions import InvalidInput
from trajopt.problem import Limits, Problem

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Part = tuple[Array, Array, Array, Mask]

BRANCHES = np.array(list(itertools.product((1.0, -1.0), repeat=3)))
BRANCHES.setflags(write=False)
"""The eight branches in their order, `(8, 3)`: signs of shoulder (the arm reaches forwards or over
its back), elbow, and wrist (`s5 ≥ 0` or `s5 ≤ 0` in Table 1's convention)."""

_COLUMNS = ("a", "alpha", "d", "theta", "joint_range")
_KEYS = {*_COLUMNS, "angle_unit", "convention", "name", "source"}
_NUMBERS = {int, float, np.int64, np.float64}
_TWISTS = np.array([0, -1, 0, -1, 1, -1]) * np.pi / 2  # Table 1's alpha
_TOUCHING = 1e-12  # of the arm's size: a wrist centre this near a boundary of its reach is on it
_ALIGNED = 1e-10  # rad: below, axes 4 and 6 are one
_ROUNDING = 1e-10  # rad: an angle this far outside its range is at its end


@dataclass(frozen=True, eq=False)
class Inverse:
    """All branches of each pose, in the order of `BRANCHES`; never NaN.

    - `joints` `(…, 8, 6)`, rad: a branch that does not exist stretches towards the pose;
    - `exists` `(…, 8)`: whether the branch reaches the pose;
    - `in_range` `(…, 8)`: whether it exists and keeps every joint in its range;
    - `singular` `(…, 8, 3)`: shoulder (wrist centre as near axis 1 as it gets), elbow (stretched or
      folded), wrist (axes 4 and 6 aligned). At a singular shoulder or elbow its two branches
      coincide or turn about a free axis; at a singular wrist the previous θ4 is kept;
    - `distance` `(…)`, m: how far the wrist centre is from the nearest one that some branch reaches
      with θ1 turned towards it: its distance from the reach if d2 + d3 = 0, else a bound above it.
    """

    joints: Array
    exists: Mask
    in_range: Mask
    singular: Mask
    distance: Array


@dataclass(frozen=True, eq=False)
class Robot:
    """A chain of revolute joints by its modified D-H table, one row per joint.

    Row i holds `a` = a_{i-1} (m), `alpha` = α_{i-1} (rad), `d` = d_i (m), and `theta` (rad), which
    is added to the joint's angle; `joint_range` is `(joints, 2)`, `[low, high]` rad, perhaps
    infinite. Raises `InvalidInput` naming the key, joint and value.
    """

    a: Array
    alpha: Array
    d: Array
    theta: Array
    joint_range: Array
    name: str = "unnamed"
    source: str = ""

    def __post_init__(self) -> None:
        for key, array in _columns({key: getattr(self, key) for key in _COLUMNS}).items():
            array.setflags(write=False)
            object.__setattr__(self, key, array)
        for key in ("name", "source"):
            if not isinstance(getattr(self, key), str):
                raise InvalidInput(key, "a string", value=getattr(self, key))

    @property
    def joints(self) -> int:
        return len(self.a)

    @classmethod
    def from_toml(cls, path: str | Path) -> Robot:
        """Read a robot file; every error names the file, key, joint and value."""
        try:
            return _parsed(tomllib.loads(Path(path).read_text(encoding="utf-8")), Path(path).stem)
        except InvalidInput as error:
            raise error.in_file(str(path)) from None
        except (OSError, ValueError) as error:
            reason, right = getattr(error, "strerror", None) or str(error), "a readable TOML file"
            raise InvalidInput("robot", right, value=reason, file=str(path)) from None

    def frames(self, q: ArrayLike) -> Array:
        """Poses `(…, joints + 1, 4, 4)` of the base and every link at `q` `(…, joints)` rad; m."""
        links = _link(self.a, self.alpha, self.d, self._angles("q", q) + self.theta)
        frames = [np.broadcast_to(np.eye(4), (*links.shape[:-3], 4, 4))]
        for link in np.moveaxis(links, -3, 0):
            frames.append(frames[-1] @ link)
        return np.stack(frames, axis=-3)

    def forward(self, q: ArrayLike) -> Array:
        """Poses `(…, 4, 4)` of the hand at angles `q` `(…, joints)` rad (eq. 2); m."""
        return np.asarray(self.frames(q)[..., -1, :, :])

    def jacobian(self, q: ArrayLike) -> Array:
        """The hand's velocity (m) over its turning (rad), base frame, per rad: `(…, 6, joints)`."""
        frames = self.frames(q)
        axes, origins = frames[..., 1:, :3, 2], frames[..., 1:, :3, 3]
        linear = np.cross(axes, origins[..., -1:, :] - origins)
        return np.swapaxes(np.concatenate([linear, axes], axis=-1), -1, -2)

    def inverse(self, pose: Any, previous: ArrayLike | None = None) -> Inverse:
        """All eight branches of each pose `(…, 4, 4)`.

        Of the angles that differ by 2π, each joint takes the one in its range nearest to `previous`
        `(…, 6)` rad (by default zero, or the end of the range nearest to it), or if there is none
        the one nearest to its range. What a singularity leaves free stays as in `previous`.
        Raises `InvalidInput` if the arm is not of this family, or a pose is not a pose: its
        rotation must be orthonormal to 1e-6, and is taken as it is.
        """
        self.check_spherical_wrist()
        before, (signs, base, hand) = self._posture("previous", previous), _flips(self)
        near = _TOUCHING * float(np.abs([self.a, self.d]).sum())
        target = np.linalg.inv(base) @ _checked(pose) @ hand
        free = (signs * (before + self.theta))[..., None, :]
        joints, gap, singular = _solve(self.a, signs * self.d, target, free, near)
        exists = gap <= near
        q, inside = _representative(signs * joints - self.theta, self.joint_range, before)
        distance = np.where(exists.any(axis=-1), 0.0, gap.min(axis=-1))
        return Inverse(q, exists, exists & inside, singular & exists[..., None], distance)

    def nearest(self, pose: Any, posture: ArrayLike | None = None) -> Array:
        """The branch in joint range nearest to a posture, `(…, 6)` rad, for each pose `(…, 4, 4)`.

        By the Euclidean norm of the angles' differences; `posture` is also `inverse`'s `previous`.
        Raises `InvalidInput` naming the pose (counted from 1) that is out of reach and by how far,
        or the joint that leaves its range in its best branch.
        """
        return _nearest(self, pose, self._posture("posture", posture), "pose")

    def check_spherical_wrist(self) -> None:
        """Raise `InvalidInput` naming what keeps this arm from having the analytic inverse."""
        if self.joints != 6:
            raise InvalidInput("a", "six joints, for the analytic inverse", value=self.joints)
        turns = (self.alpha - _TWISTS) / np.pi
        square = np.abs(turns - np.round(turns)) < 1e-12
        meet, move = "0, as the last three axes meet", "not 0, as the elbow moves the wrist"
        needs = [("alpha", i, square[i], "0 or ±pi" if i == 2 else "±pi/2") for i in range(1, 6)]
        needs += [(k, i, getattr(self, k)[i] == 0, meet) for k, i in (("a", 4), ("d", 4), ("a", 5))]
        needs += [("a", 2, self.a[2] != 0, move), ("d", 3, self.a[3] or self.d[3], move)]
        for key, joint, right, expected in needs:
            if not right:
                value, expected = getattr(self, key)[joint], f"{expected}, for the analytic inverse"
                raise InvalidInput(key, expected, value=value, joint=joint)

    def _angles(self, key: str, q: ArrayLike) -> Array:
        expected = f"{self.joints} finite angles in rad, one per joint"
        array = _array(key, q, (self.joints,), expected)
        for index in np.argwhere(~np.isfinite(array)).tolist():
            raise InvalidInput(key, expected, value=array[tuple(index)], joint=index[-1])
        return array

    def _posture(self, key: str, q: ArrayLike | None) -> Array:
        return np.clip(0 * self.a, *self.joint_range.T) if q is None else self._angles(key, q)


def cartesian_problem(
    robot: Robot, poses: Any, limits: Limits, start: ArrayLike | None = None, name: str = ""
) -> Problem:
    """Step 1 of the paper's procedure: the problem of passing poses `(waypoints, 4, 4)` in order.

    Each waypoint is `Robot.nearest` to the one before, without looking ahead; the first to the
    posture `start` `(6,)` rad, itself no waypoint. Without a `name` the problem takes the robot's.
    Raises `InvalidInput` as `Robot.nearest` and `Problem` do.
    """
    path, waypoints = _checked(poses), [robot._posture("start", start)]
    for number, target in enumerate(path, start=1):
        waypoints.append(_nearest(robot, target, waypoints[-1], f"pose {number}"))
    return Problem(waypoints[1:], limits, name or robot.name)


def _nearest(robot: Robot, poses: ArrayLike, posture: Array, key: str) -> Array:
    inverse = robot.inverse(poses, posture)
    for index in np.argwhere(~inverse.in_range.any(axis=-1)).tolist():
        key += "".join(f" {i + 1}" for i in index)
        raise _unreached(robot, inverse, tuple(index), key)
    length = np.linalg.norm(inverse.joints - posture[..., None, :], axis=-1)
    best = np.where(inverse.in_range, length, np.inf).argmin(axis=-1)
    return np.asarray(np.take_along_axis(inverse.joints, best[..., None, None], -2)[..., 0, :])


def _unreached(robot: Robot, inverse: Inverse, index: tuple[int, ...], key: str) -> InvalidInput:
    exists, q, (low, high) = inverse.exists[index], inverse.joints[index], robot.joint_range.T
    if not exists.any():
        where, right = f"{key}, metres outside of the robot's reach", "a pose that it reaches"
        return InvalidInput(where, right, value=inverse.distance[index])
    excess = np.where(exists[:, None], np.maximum(low - q, q - high), np.inf)
    branch = int(excess.max(axis=-1).argmin())
    joint = int(excess[branch].argmax())
    right = f"an angle in joint_range [{low[joint]:.9g}, {high[joint]:.9g}] rad"
    return InvalidInput(f"{key}, best branch", right, value=q[branch, joint], joint=joint)


def _link(a: ArrayLike, alpha: ArrayLike, d: ArrayLike, theta: ArrayLike) -> Array:
    """Eq. 1, batched: `(…, 4, 4)`."""
    a, alpha, d, theta = np.broadcast_arrays(a, alpha, d, theta)
    c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
    o, i = np.zeros_like(c), np.ones_like(c)
    rows = [c, -s, o, a, s * ca, c * ca, -sa, -d * sa, s * sa, c * sa, ca, d * ca, o, o, o, i]
    return np.stack(rows, axis=-1).reshape(*c.shape, 4, 4)


def _flips(robot: Robot) -> tuple[Array, Array, Array]:
    """Signs of the joints, and fixed frames of base and hand, that give the arm Table 1's twists.

    Half a turn about x flips every joint after it: `Rx(π) Rz(θ) Tz(d) = Rz(−θ) Tz(−d) Rx(π)`.
    """
    halves = np.round((robot.alpha - _TWISTS) / np.pi) % 2
    halves[0] = 0.0  # the base frame takes the first twist, whatever it is
    signs = (-1.0) ** np.cumsum(halves)
    return signs, _link(robot.a[0], robot.alpha[0], 0, 0), np.diag([1, signs[-1], signs[-1], 1])


def _solve(a: Array, d: Array, pose: Array, free: Array, near: float) -> tuple[Array, Array, Mask]:
    """Angles `(…, 8, 6)`, each branch's distance from its pose `(…, 8)` m, and singularities."""
    (shoulder, elbow, wrist), links = BRANCHES.T, np.array([a[2], a[3], d[3]])
    x, y, z = np.moveaxis(pose[..., :3, 3] - d[5] * pose[..., :3, 2], -1, 0)[..., None]
    t1, reach, aside, over = _shoulder(x, y, d[1] + d[2], shoulder, free[..., 0], near)
    t2, t3, short, straight = _elbow(reach - a[1], d[0] - z, links, elbow, free[..., 1], near)
    t4, t5, t6, aligned = _wrist(pose[..., None, :3, :3], t1, t2 + t3, wrist, free[..., 3])
    joints = np.stack(np.broadcast_arrays(t1, t2, t3, t4, t5, t6), axis=-1)
    singular = np.stack(np.broadcast_arrays(over, straight, aligned), axis=-1)
    return joints, np.broadcast_to(np.hypot(aside, short), joints.shape[:-1]), singular


def _shoulder(x: Array, y: Array, offset: float, sign: Array, free: Array, near: float) -> Part:
    """θ1 (eq. 6), the wrist centre's distance forwards, and how much too near it is to axis 1."""
    r, inner = np.hypot(x, y), abs(offset)
    over = np.abs(r - inner) <= near
    reach = sign * np.sqrt(np.where(over, 0.0, np.maximum(r - inner, 0.0))) * np.sqrt(r + inner)
    heading = np.where(r > near, np.arctan2(y, x), free)
    return heading - np.arctan2(offset, reach), reach, np.maximum(inner - r, 0.0), over


def _elbow(u: Array, w: Array, links: Array, sign: Array, free: Array, near: float) -> Part:
    """θ2, θ3 of links that reach `(u, w)` (eq. 7), and how far outside their annulus that is."""
    upper, lower = links[0], np.hypot(links[1], links[2])
    inner, outer, rho = abs(abs(upper) - lower), abs(upper) + lower, np.hypot(u, w)
    rim = np.where(np.abs(rho - outer) <= near, outer, np.clip(rho, inner, outer))
    rim = np.where(np.abs(rho - inner) <= near, inner, rim)
    # The bend's half angle from factored differences: precise up to the stretched arm.
    beyond, within = (outer - rim) * (outer + rim), (rim - inner) * (rim + inner)
    bend = (0.0 if upper > 0 else np.pi) + 2 * sign * np.arctan2(np.sqrt(beyond), np.sqrt(within))
    lift = np.arctan2(w, u) - np.arctan2(lower * np.sin(bend), upper + lower * np.cos(bend))
    short = np.maximum(np.maximum(rho - outer, inner - rho), 0.0)
    t3 = bend - np.arctan2(links[2], links[1])
    return np.where(rho > near, lift, free), t3, short, (rim == inner) | (rim == outer)


def _wrist(rotation: Array, t1: Array, t23: Array, sign: Array, free: Array) -> Part:
    """θ4, θ5, θ6 from `N = Rx(π/2) R36 = Rz(θ4) Ry(−θ5) Rz(θ6)`."""
    c1, s1, c, s = np.cos(t1), np.sin(t1), np.cos(t23), np.sin(t23)
    rows = np.stack([c1 * c, s1 * c, -s, s1, -c1, 0 * c, -c1 * s, -s1 * s, -c], axis=-1)
    n = np.moveaxis(rows.reshape(*c.shape, 3, 3) @ rotation, (-2, -1), (0, 1))
    aligned = np.hypot(n[0, 2], n[1, 2]) <= _ALIGNED
    flip = np.where(sign > 0, 0.0, np.pi)
    t4 = np.where(aligned, free + flip, np.arctan2(-sign * n[1, 2], -sign * n[0, 2]))
    c4, s4 = np.cos(t4), np.sin(t4)
    t5 = np.arctan2(-c4 * n[0, 2] - s4 * n[1, 2], n[2, 2])
    t6 = np.arctan2(c4 * n[1, 0] - s4 * n[0, 0], c4 * n[1, 1] - s4 * n[0, 1])
    return t4, t5, t6, aligned


def _representative(q: Array, joint_range: Array, previous: Array) -> tuple[Array, Mask]:
    """Angles `(…, 8, 6)` plus multiples of 2π as `Robot.inverse` promises; if all are in range."""
    (low, high), turn = joint_range.T, 2 * np.pi
    first = np.ceil((low - _ROUNDING - q) / turn)
    last = np.floor((high + _ROUNDING - q) / turn)
    inside = first <= last
    outside = np.where(q + first * turn - high < low - q - last * turn, first, last)
    wanted = np.clip(np.round((previous[..., None, :] - q) / turn), first, last)
    q = q + turn * np.where(inside, wanted, outside)
    return np.where(inside, np.clip(q, low, high), q), inside.all(axis=-1)


def _checked(poses: Any) -> Array:
    expected = "a finite 4 x 4 matrix: a rotation and a position over a row 0, 0, 0, 1"
    array = _array("pose", getattr(poses, "as_matrix", lambda: poses)(), (4, 4), expected)
    r = np.nan_to_num(np.clip(array[..., :3, :3], -2, 2))
    off = np.abs(r @ np.swapaxes(r, -1, -2) - np.eye(3)).max(axis=(-1, -2))
    right = (off < 1e-6) & (np.linalg.det(r) > 0) & (array[..., 3, :] == [0, 0, 0, 1]).all(axis=-1)
    for index in np.argwhere(~right | ~np.isfinite(array).all(axis=(-1, -2))).tolist():
        key = "pose" + "".join(f" {i + 1}" for i in index)
        raise InvalidInput(key, expected, value=array[tuple(index)].tolist())
    return array


def _array(key: str, value: Any, shape: tuple[int, ...], expected: str) -> Array:
    """`value` as a new array `(…, *shape)` of numbers."""
    try:
        array = np.asarray(value)
    except ValueError:  # ragged
        array = np.asarray(None)
    if array.dtype.kind not in "iuf" or array.shape[array.ndim - len(shape) :] != shape:
        value = value.tolist() if isinstance(value, np.ndarray) else value
        raise InvalidInput(key, expected, value=value)
    return array.astype(float)


def _parsed(table: Mapping[str, Any], stem: str) -> Robot:
    table = {"name": stem, "source": "", **table}
    for key in sorted(set(table) ^ _KEYS):
        right = f"{'one of' if key in table else 'this key, as all of'} {', '.join(sorted(_KEYS))}"
        raise InvalidInput(key, right, value=table.get(key))
    for key, choice in (("convention", ["modified-dh"]), ("angle_unit", ["deg", "rad"])):
        if table[key] not in choice:
            raise InvalidInput(key, " or ".join(f'"{c}"' for c in choice), value=table[key])
    columns = _columns({key: table[key] for key in _COLUMNS})
    for key in ("alpha", "theta", "joint_range"):  # after checking: errors show what the file says
        columns[key] *= np.pi / 180 if table["angle_unit"] == "deg" else 1.0
    return Robot(**columns, name=table["name"], source=table["source"])


def _columns(given: Mapping[str, Any]) -> dict[str, Array]:
    """The columns as new arrays, one row per joint, or the error that names the wrong entry."""
    columns: dict[str, Array] = {}
    for key, value in given.items():
        pairs = key == "joint_range"
        right = f"one {'[low, high] with low < high' if pairs else 'finite number'} per joint"
        for joint, item in enumerate(value if isinstance(value, list | tuple) else ()):
            if {type(x) for x in np.array(item, dtype=object).flat} - _NUMBERS:
                raise InvalidInput(key, right, value=item, joint=joint)
        array = columns[key] = _array(key, value, (2,) if pairs else (), right)
        if array.ndim != 1 + pairs or not 0 < len(array) == len(columns["a"]):
            raise InvalidInput(key, f"{right} of a", value=array.tolist())
        wrong = ~(array[:, 0] < array[:, 1]) if pairs else ~np.isfinite(array)
        for joint in np.flatnonzero(wrong).tolist():
            raise InvalidInput(key, right, value=array[joint].tolist(), joint=joint)
    return columns
