"""Inverse kinematics, and the `Problem` of a Cartesian path.

Modified Denavit–Hartenberg parameters (Craig), eq. 1 of Ma et al. 2024, for any chain of revolute
joints (`trajopt.core.chain`). The inverse is Newton's method (Levenberg and Marquardt). It starts
from the eight solutions in closed form where the arm has them, as six axes with the twists of the
paper's Table 1 do. For any other arm it starts from the posture before, and from random ones where
that leads far away. A pose is a 4 x 4 homogeneous matrix, or SciPy's `RigidTransform`, which takes
any orientation.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import scipy  # loads its submodules where they are first used
from numpy.typing import ArrayLike

from trajopt.core import files
from trajopt.core.arrays import Array, Bools
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.units import ANGLES
from trajopt.planners import six_axis_inverse

_COLUMNS = ("a", "alpha", "d", "theta", "joint_range")
_REQUIRED = sorted((*_COLUMNS, "angle_unit", "convention"))
# Number of postures from which the inverse of an arm without branches starts: the given one, then
# random ones.
_STARTS = 40
# A solution this near to the posture is accepted without a search for a nearer one.
_NEARBY_RAD = 1.0
# Largest miss of a pose that counts as reached: of rotation entries, and of lengths over arm size.
_REACHED_RTOL = 1e-10
# Smaller singular values, relative, count as 0: in these directions joints move and the hand rests.
_SINGULAR_RTOL = 1e-6
# An angle that is outside its range by less is at the end of the range.
_ROUNDING_RAD = 1e-9
# Largest entry of R Rᵀ − 1 that a rotation may have.
_ORTHONORMAL_ATOL = 1e-6
_COMPLEX_STEP = 1e-30
_SOLVER_OPTIONS = {"ftol": 1e-15, "xtol": 1e-15, "gtol": 1e-15, "max_nfev": 60}


@dataclass(frozen=True, eq=False)
class Branches:
    """All eight inverses of poses, by two signs of θ1, two of θ3 and two of θ5.

    Attributes:
        q: Joint angles, rad, `(…, 8, joints)`; in the joint's range where a whole turn leads there,
            and else as near as possible to the posture asked for. Where the pose is out of reach,
            those of the arm stretched or folded towards it, with the orientation of the pose.
        miss: Distance of the hand from the pose, m, `(…, 8)`; rounding alone where it is reached.
        within: Whether all angles are in their ranges, `(…, 8)`.
        singular: Whether axes 4 and 6 are one, `(…, 8)`: the pose fixes θ4 + θ6 or θ4 − θ6 alone,
            and both are as near to the posture as that allows, in their ranges or not (`nearest`
            keeps the ranges).
    """

    q: Array
    miss: Array
    within: Bools
    singular: Bools


@dataclass(frozen=True, eq=False)
class Robot:
    """A chain of revolute joints by its modified D-H table, one row per joint.

    Row i holds `a` = a_{i-1} (m), `alpha` = α_{i-1} (rad), `d` = d_i (m), and `theta` (rad), which
    is added to the joint's angle; `joint_range` is `(joints, 2)`, `[low, high]` rad, perhaps
    infinite.

    Raises:
        InvalidInput: naming the key, joint and value.
    """

    a: Array
    alpha: Array
    d: Array
    theta: Array
    joint_range: Array
    name: str = "unnamed"
    source: str = ""

    def __post_init__(self) -> None:
        given = {key: getattr(self, key) for key in _COLUMNS}
        for key, array in _columns(given).items():
            array.setflags(write=False)
            object.__setattr__(self, key, array)

    @property
    def joints(self) -> int:
        return len(self.a)

    @cached_property
    def chain(self) -> LinkChain:
        """Return the link frames."""
        return LinkChain.modified_dh(self.a, self.alpha, self.d, self.theta)

    @classmethod
    def from_toml(cls, path: str | Path) -> Robot:
        """Read a robot file; every error names the file, key, joint and value."""
        file = Path(path)
        try:
            return _parsed(files.toml(file, "robot"), file.stem)
        except InvalidInput as error:
            raise error.in_file(str(path)) from None

    def forward(self, q: ArrayLike) -> Array:
        """Poses `(…, 4, 4)` of the hand at angles `q` `(…, joints)` rad (eq. 2); m."""
        return self.chain.forward(self._angles("q", q))

    @property
    def has_branches(self) -> bool:
        """Whether `branches` knows the inverse of this arm."""
        return six_axis_inverse.is_solved(self.a, self.alpha, self.d)

    def branches(self, poses: Any, posture: ArrayLike | None = None) -> Branches:
        """Return the eight inverses of poses `(…, 4, 4)` in closed form, all poses at once.

        The arm has the twists 0, −90, 0, −90, 90, −90 degrees of the paper's Table 1, and its last
        three axes meet in a point (`has_branches`).

        Args:
            poses: The poses to reach, m.
            posture: Angles to stay near to where the pose leaves some free, `(joints,)`, rad; by
                default as in `nearest`.

        Raises:
            InvalidInput: naming the pose, or the arm that has another shape.
        """
        if not self.has_branches:
            twists = "six joints with alpha 0, -90, 0, -90, 90, -90 degrees and a5, a6, d5 zero"
            raise InvalidInput("robot", f"{twists} (any arm: `nearest`)", value=self.name)
        given = _checked(poses)
        near = self._posture("posture", posture)
        found, singular = six_axis_inverse.eight_branches(self.a, self.d, given, near + self.theta)
        q = _turned(found - self.theta, self.joint_range, near)
        apart = self.forward(q)[..., :3, 3] - given[..., None, :3, 3]
        within = np.all(_outside(q, *self.joint_range.T) <= 0, axis=-1)
        return Branches(q, np.linalg.norm(apart, axis=-1), within, singular)

    def nearest(self, pose: Any, posture: ArrayLike | None = None) -> Array:
        """Return angles within the joint ranges that reach a pose `(4, 4)`, `(joints,)`, rad.

        The nearest of all eight `branches` where the arm has them, by the Euclidean norm of the
        differences; else of those that Newton's method finds from the posture and from random ones.

        Args:
            pose: The pose to reach.
            posture: Angles, `(joints,)`, rad; by default zero, or the end of the range nearest to
                it.

        Raises:
            InvalidInput: naming the pose that is out of reach and by how far, or the joint that
                leaves its range.
        """
        return _nearest(self, _checked(pose), self._posture("posture", posture), "pose")

    def _angles(self, key: str, q: ArrayLike) -> Array:
        expected = f"{self.joints} finite angles in rad, one per joint"
        array = _array(key, q, (self.joints,), expected)
        endless = ~np.isfinite(array)
        for *place, joint in np.argwhere(endless).tolist():
            value = array[*place, joint]
            raise InvalidInput(key, expected, value=value, joint=joint)
        return array

    def _posture(self, key: str, q: ArrayLike | None) -> Array:
        if q is not None:
            return self._angles(key, q)
        low, high = self.joint_range.T
        return np.clip(0 * self.a, low, high)


def cartesian_problem(
    robot: Robot, poses: Any, limits: Limits, start: ArrayLike | None = None, name: str = ""
) -> Problem:
    """Step 1 of the paper's procedure: the problem of passing poses `(waypoints, 4, 4)` in order.

    Each waypoint is `Robot.nearest` to the one before, without looking ahead; the first to the
    posture `start` `(joints,)` rad, itself no waypoint. Without a `name` the problem takes the
    robot's.

    Raises:
        InvalidInput: as `Robot.nearest` and `Problem` do.
    """
    path = _checked(poses)
    posture = robot._posture("start", start)
    waypoints = []
    for number, pose in enumerate(path, start=1):
        posture = _nearest(robot, pose, posture, f"pose {number}")
        waypoints.append(posture)
    return Problem(waypoints, limits, name or robot.name)


def _nearest(robot: Robot, pose: Array, posture: Array, key: str) -> Array:
    """Return the answer of `Robot.nearest`; `key` names the pose in errors."""
    low, high = robot.joint_range.T
    size = _size(robot)
    missed = np.inf
    reached: list[Array] = []
    for start in _starts(robot, pose, posture):
        found, miss = _solved(robot, pose, start, posture, size)
        missed = min(missed, miss)
        reached += found
        near = [q for q in found if np.linalg.norm(q - posture) < _NEARBY_RAD]
        if not robot.has_branches and any(_outside(q, low, high).max() <= 0 for q in near):
            break
    if not reached:
        raise InvalidInput(
            f"{key}, metres outside of the robot's reach",
            "a pose that it reaches",
            value=missed * size,
        )
    inside = [q for q in reached if _outside(q, low, high).max() <= 0]
    if inside:
        best = min(inside, key=lambda q: np.linalg.norm(q - posture))
        return np.clip(best, low, high)
    best = min(reached, key=lambda q: _outside(q, low, high).max())
    joint = int(_outside(best, low, high).argmax())
    raise InvalidInput(
        f"{key}, best branch",
        f"an angle in joint_range [{low[joint]:.9g}, {high[joint]:.9g}] rad",
        value=best[joint],
        joint=joint,
    )


def _starts(robot: Robot, pose: Array, posture: Array) -> Iterator[Array]:
    """Yield where Newton's method starts: all inverses, or the posture and then random ones."""
    if robot.has_branches:
        found = robot.branches(pose, posture)
        reached = found.miss < _REACHED_RTOL * _size(robot)
        yield from found.q[reached] if reached.any() else found.q
        return
    yield posture
    low, high = robot.joint_range.T
    middle = np.clip(posture, low, high)
    rng = np.random.default_rng(0)
    for _ in range(_STARTS - 1):
        yield rng.uniform(np.maximum(low, middle - np.pi), np.minimum(high, middle + np.pi))


def _size(robot: Robot) -> float:
    """Return the length of all links and offsets together, m; 1 where there are none."""
    return float(np.abs([robot.a, robot.d]).sum()) or 1.0


def _solved(
    robot: Robot, pose: Array, start: Array, posture: Array, size: float
) -> tuple[list[Array], float]:
    """Return solutions that Newton's method reaches, and how far it misses in the worst entry.

    None, or one; or two where the joints can move while the hand rests, as at a singular wrist: the
    second one is as near to the posture as the ranges allow.
    """
    scale = np.array([1.0, 1.0, 1.0, 1 / size])

    def miss(q: Array) -> Array:
        apart = robot.chain.forward(q) - pose
        return np.asarray((apart[:3] * scale).ravel())

    def slope(q: Array) -> Array:
        steps = _COMPLEX_STEP * np.eye(robot.joints)
        moved = robot.chain.forward(q + 1j * steps).imag / _COMPLEX_STEP
        columns = moved[:, :3] * scale
        return columns.reshape(robot.joints, -1).T

    def solved(q: Array) -> Array:
        found = scipy.optimize.least_squares(miss, q, slope, method="lm", **_SOLVER_OPTIONS)
        return np.asarray(found.x)

    q = start
    if np.abs(miss(start)).max() > _REACHED_RTOL:
        q = solved(start)
    answers = [q]
    free = scipy.linalg.null_space(slope(q), rcond=_SINGULAR_RTOL)
    if free.size:
        moved = _along(q, free, robot.joint_range, posture)
        if np.abs(miss(moved)).max() > _REACHED_RTOL:
            moved = solved(moved)
        answers.append(moved)
    misses = [float(np.abs(miss(own)).max()) for own in answers]
    reached = [
        _turned(own, robot.joint_range, posture)
        for own, far in zip(answers, misses, strict=True)
        if far < _REACHED_RTOL
    ]
    return reached, min(misses)


def _along(q: Array, free: Array, joint_range: Array, posture: Array) -> Array:
    """Return angles moved in free directions `(joints, directions)`, near to a posture.

    In one direction they stay in the ranges if they can, each moving joint perhaps a turn away.
    """
    if free.shape[1] > 1:
        return np.asarray(q + free @ (free.T @ (posture - q)))
    way = free[:, 0]
    (moving,) = np.nonzero(np.abs(way) > _SINGULAR_RTOL)
    ends = joint_range[moving]
    turns = [2 * np.pi * turn * own for own in np.eye(len(q))[moving] for turn in (0, -1, 1)]
    moved = []
    for own in q + np.array(turns):
        # low ≤ own + z way ≤ high
        low, high = np.sort((ends.T - own[moving]) / way[moving], axis=0)
        lowest, highest = low.max(), high.min()
        z = np.clip(way @ (posture - own), lowest, max(lowest, highest))
        there = own + z * way
        moved.append((lowest > highest, float(np.linalg.norm(there - posture)), there))
    _, _, best = min(moved, key=lambda own: own[:2])
    return np.asarray(best)


def _turned(q: Array, joint_range: Array, posture: Array) -> Array:
    """Angles plus multiples of 2π: in range where they can be, and nearest to a posture."""
    low, high = joint_range.T
    turn = 2 * np.pi
    q = q + turn * np.round((posture - q) / turn)
    above = np.ceil((q - high - _ROUNDING_RAD) / turn)
    q = q - turn * np.maximum(above, 0.0)
    below = np.ceil((low - _ROUNDING_RAD - q) / turn)
    return np.asarray(q + turn * np.maximum(below, 0.0))


def _outside(q: Array, low: Array, high: Array) -> Array:
    """Return how far each angle is outside its range, rad; at most 0 within it."""
    return np.maximum(low - q, q - high) - _ROUNDING_RAD


def _checked(poses: Any) -> Array:
    """Copy poses `(…, 4, 4)`, or raise the error that names the first wrong one."""
    expected = "a finite 4 x 4 matrix: a rotation and a position over a row 0, 0, 0, 1"
    given = poses.as_matrix() if hasattr(poses, "as_matrix") else poses
    array = _array("pose", given, (4, 4), expected)
    entries = (-1, -2)
    finite = np.isfinite(array).all(axis=entries)
    rotation = np.clip(array[..., :3, :3], -2, 2)
    rotation = np.nan_to_num(rotation)
    # R Rᵀ = 1, det R > 0
    gram = rotation @ np.swapaxes(rotation, -1, -2)
    deviation = np.abs(gram - np.eye(3))
    orthonormal = deviation.max(axis=entries) < _ORTHONORMAL_ATOL
    right_handed = np.linalg.det(rotation) > 0
    last_row = array[..., 3, :] == [0, 0, 0, 1]
    fits = finite & orthonormal & right_handed & last_row.all(axis=-1)
    for index in np.argwhere(~fits).tolist():
        key = " ".join(["pose", *(str(i + 1) for i in index)])
        wrong = array[tuple(index)]
        raise InvalidInput(key, expected, value=wrong.tolist())
    # The nearest rotation: a pose printed with seven digits is one that an arm can have.
    left, _, right = np.linalg.svd(array[..., :3, :3])
    array[..., :3, :3] = left @ right
    return array


def _array(key: str, value: Any, shape: tuple[int, ...], expected: str) -> Array:
    """`value` as a new array `(…, *shape)` of numbers."""
    try:
        array = np.asarray(value)
    except ValueError:  # ragged
        array = np.asarray(None)
    batch = array.ndim - len(shape)
    trailing = array.shape[batch:]
    if array.dtype.kind not in "iuf" or trailing != shape:
        if isinstance(value, np.ndarray):
            value = value.tolist()
        raise InvalidInput(key, expected, value=value)
    return array.astype(float)


def _parsed(table: Mapping[str, Any], stem: str) -> Robot:
    files.check_keys("", table, (*_REQUIRED, "name", "source"), _REQUIRED)
    _check_choice(table, "convention", ("modified-dh",))
    _check_choice(table, "angle_unit", tuple(ANGLES))
    given = {key: table[key] for key in _COLUMNS}
    columns = _columns(given)
    # Only after checking, so that errors show what the file says.
    for key in ("alpha", "theta", "joint_range"):
        columns[key] *= ANGLES[table["angle_unit"]]
    name = files.text_at(table, "name", stem)
    return Robot(**columns, name=name, source=files.text_at(table, "source"))


def _check_choice(table: Mapping[str, Any], key: str, choices: tuple[str, ...]) -> None:
    chosen = table[key]
    if chosen not in choices:
        quoted = [f'"{choice}"' for choice in choices]
        raise InvalidInput(key, " or ".join(quoted), value=chosen)


def _columns(given: Mapping[str, Any]) -> dict[str, Array]:
    """The columns as new arrays, one row per joint, or the error that names the wrong entry."""
    columns: dict[str, Array] = {}
    for key, value in given.items():
        is_range = key == "joint_range"
        entry = "[low, high] with low < high" if is_range else "finite number"
        expected = f"one {entry} per joint"
        if _has_truth_value(value):
            raise InvalidInput(key, expected, value=value)
        array = _array(key, value, (2,) if is_range else (), expected)
        columns[key] = array
        is_column = array.ndim == 1 + is_range
        if not is_column or not 0 < len(array) == len(columns["a"]):
            raise InvalidInput(key, f"{expected} of a", value=array.tolist())
        right = np.isfinite(array)
        if is_range:
            low, high = array.T
            right = low < high
        for joint in np.flatnonzero(~right).tolist():
            raise InvalidInput(key, expected, value=array[joint].tolist(), joint=joint)
    return columns


def _has_truth_value(value: Any) -> bool:
    """Return whether a nested list holds `True` or `False`, which NumPy takes for numbers."""
    if isinstance(value, list):
        return any(map(_has_truth_value, value))
    return isinstance(value, bool)
