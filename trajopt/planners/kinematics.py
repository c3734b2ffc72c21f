"""Forward and inverse kinematics, and the `Problem` of a Cartesian path.

Modified Denavit–Hartenberg parameters (Craig), eq. 1 of Ma et al. 2024, for any chain of revolute
joints. The analytic inverse is for the commonest arm: six joints, the second and third parallel to
each other and perpendicular to the first, the last three meeting in one point (spherical wrist).
It is derived from eq. 1: there are slips in eq. 8 and 11–26 as printed there.
A pose is a 4 x 4 homogeneous matrix, or SciPy's `RigidTransform`, which takes any orientation.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core import files
from trajopt.core.arrays import Array, Bools
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Limits, Problem
from trajopt.core.units import ANGLES

_SIGNS = itertools.product((1.0, -1.0), repeat=3)
BRANCHES = np.array(list(_SIGNS))
BRANCHES.setflags(write=False)
"""The eight branches in their order, `(8, 3)`: signs of shoulder (the arm reaches forwards or over
its back), elbow, and wrist (`s5 ≥ 0` or `s5 ≤ 0` in Table 1's convention)."""

_COLUMNS = ("a", "alpha", "d", "theta", "joint_range")
_REQUIRED = sorted((*_COLUMNS, "angle_unit", "convention"))
_TWISTS = np.array([0, -1, 0, -1, 1, -1]) * np.pi / 2  # Table 1's alpha
# A wrist centre this near the boundary of its reach is on it, relative to the arm's size.
_TOUCHING_RTOL = 1e-12
# Below this angle axes 4 and 6 are one.
_ALIGNED_RAD = 1e-10
# An angle this far outside its range is at its end.
_ROUNDING_RAD = 1e-10
# Largest difference of a twist from a multiple of a quarter turn, in half turns.
_TWIST_HALF_TURNS = 1e-12
# Largest entry of R Rᵀ − 1 that a rotation may have.
_ORTHONORMAL_ATOL = 1e-6


@dataclass(frozen=True, eq=False)
class Inverse:
    """All branches of each pose, in the order of `BRANCHES`; never NaN.

    At a singular shoulder or elbow two branches coincide or turn about a free axis. At a singular
    wrist (axes 4 and 6 aligned) the previous θ4 is kept.

    - `joints` `(…, 8, 6)`, rad: a branch that does not exist stretches towards the pose;
    - `exists` `(…, 8)`: whether the branch reaches the pose;
    - `in_range` `(…, 8)`: whether it exists and keeps every joint in its range;
    - `distance` `(…)`, m: how far the wrist centre is from the nearest one that some branch reaches
      with θ1 turned towards it: its distance from the reach if d2 + d3 = 0, else a bound above it.
    """

    joints: Array
    exists: Bools
    in_range: Bools
    distance: Array


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
        theta = self._angles("q", q) + self.theta
        links = _link(self.a, self.alpha, self.d, theta)
        return reduce(np.matmul, np.moveaxis(links, -3, 0))

    def inverse(self, pose: Any, previous: ArrayLike | None = None) -> Inverse:
        """All eight branches of each pose `(…, 4, 4)`.

        Among the angles that differ by 2π each joint takes the one in its range nearest to
        `previous` `(…, 6)` rad (by default zero, or the end of the range nearest to it). Without
        one in range it takes the one nearest to its range. A free angle of a singularity stays as
        in `previous`.

        Raises:
            InvalidInput: the arm is not of this family, or a pose is not a pose: its rotation must
                be orthonormal to 1e-6, and is taken as it is.
        """
        self.check_spherical_wrist()
        before = self._posture("previous", previous)
        signs, base, hand = _flips(self)
        lengths = np.abs([self.a, self.d])
        near = _TOUCHING_RTOL * float(lengths.sum())
        target = np.linalg.inv(base) @ _checked(pose)
        target = target @ hand
        free = signs * (before + self.theta)
        joints, gap = _solve(
            self.a,
            signs * self.d,
            target,
            free=free[..., None, :],
            near=near,
        )
        exists = gap <= near
        angles = signs * joints - self.theta
        q, inside = _representative(angles, self.joint_range, before)
        nearest = gap.min(axis=-1)
        return Inverse(
            joints=q,
            exists=exists,
            in_range=exists & inside,
            distance=np.where(exists.any(axis=-1), 0.0, nearest),
        )

    def nearest(self, pose: Any, posture: ArrayLike | None = None) -> Array:
        """The branch in joint range nearest to a posture, `(…, 6)` rad, for each pose `(…, 4, 4)`.

        By the Euclidean norm of the angles' differences; `posture` is also `inverse`'s `previous`.

        Raises:
            InvalidInput: naming the pose (counted from 1) that is out of reach and by how far, or
                the joint that leaves its range in its best branch.
        """
        return _nearest(self, pose, self._posture("posture", posture), "pose")

    def check_spherical_wrist(self) -> None:
        """Raise `InvalidInput` naming what keeps this arm from having the analytic inverse."""
        if self.joints != 6:
            raise InvalidInput("a", "six joints, for the analytic inverse", value=self.joints)
        half_turns = (self.alpha - _TWISTS) / np.pi
        off = half_turns - np.round(half_turns)
        square = np.abs(off) < _TWIST_HALF_TURNS
        meet = "0, as the last three axes meet"
        move = "not 0, as the elbow moves the wrist"
        required = [("alpha", joint, square[joint], "±pi/2") for joint in (1, 3, 4, 5)]
        required += [
            ("alpha", 2, square[2], "0 or ±pi"),
            ("a", 4, self.a[4] == 0, meet),
            ("d", 4, self.d[4] == 0, meet),
            ("a", 5, self.a[5] == 0, meet),
            ("a", 2, self.a[2] != 0, move),
            ("d", 3, self.a[3] != 0 or self.d[3] != 0, move),
        ]
        for key, joint, holds, expected in required:
            if not holds:
                right = f"{expected}, for the analytic inverse"
                raise InvalidInput(key, right, value=getattr(self, key)[joint], joint=joint)

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
    robot: Robot,
    poses: Any,
    limits: Limits,
    start: ArrayLike | None = None,
    name: str = "",
) -> Problem:
    """Step 1 of the paper's procedure: the problem of passing poses `(waypoints, 4, 4)` in order.

    Each waypoint is `Robot.nearest` to the one before, without looking ahead; the first to the
    posture `start` `(6,)` rad, itself no waypoint. Without a `name` the problem takes the robot's.

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


def _nearest(robot: Robot, poses: ArrayLike, posture: Array, key: str) -> Array:
    inverse = robot.inverse(poses, posture)
    reached = inverse.in_range.any(axis=-1)
    for index in np.argwhere(~reached).tolist():
        key += _numbered(index)
        raise _unreached(robot, inverse, tuple(index), key)
    difference = inverse.joints - posture[..., None, :]
    distance = np.linalg.norm(difference, axis=-1)
    distance = np.where(inverse.in_range, distance, np.inf)
    branch = distance.argmin(axis=-1)
    index = branch[..., None, None]
    best = np.take_along_axis(inverse.joints, index, axis=-2)
    return best[..., 0, :]


def _numbered(index: list[int]) -> str:
    """Positions in a batch, counted from 1."""
    numbers = [f" {i + 1}" for i in index]
    return "".join(numbers)


def _unreached(
    robot: Robot,
    inverse: Inverse,
    index: tuple[int, ...],
    key: str,
) -> InvalidInput:
    exists = inverse.exists[index]
    if not exists.any():
        return InvalidInput(
            f"{key}, metres outside of the robot's reach",
            "a pose that it reaches",
            value=inverse.distance[index],
        )
    q = inverse.joints[index]
    lows, highs = robot.joint_range.T
    # The branch whose worst joint is least outside of its range, and that joint.
    outside = np.maximum(lows - q, q - highs)
    excess = np.where(exists[:, None], outside, np.inf)
    worst = excess.max(axis=-1)
    branch = int(worst.argmin())
    joint = int(excess[branch].argmax())
    low = lows[joint]
    high = highs[joint]
    return InvalidInput(
        f"{key}, best branch",
        f"an angle in joint_range [{low:.9g}, {high:.9g}] rad",
        value=q[branch, joint],
        joint=joint,
    )


def _link(
    a: ArrayLike,
    alpha: ArrayLike,
    d: ArrayLike,
    theta: ArrayLike,
) -> Array:
    """Eq. 1, batched: `(…, 4, 4)`."""
    alike = np.broadcast_arrays(a, alpha, d, theta)
    a, alpha, d, theta = alike
    c = np.cos(theta)
    s = np.sin(theta)
    ca = np.cos(alpha)
    sa = np.sin(alpha)
    zero = np.zeros_like(c)
    one = np.ones_like(c)
    rows = [
        [c, -s, zero, a],
        [s * ca, c * ca, -sa, -d * sa],
        [s * sa, c * sa, ca, d * ca],
        [zero, zero, zero, one],
    ]
    return _matrix(rows)


def _matrix(rows: list[list[Array]]) -> Array:
    """Matrices `(…, rows, columns)` from their entries `(…)`."""
    stacked = [np.stack(row, axis=-1) for row in rows]
    return np.stack(stacked, axis=-2)


def _flips(robot: Robot) -> tuple[Array, Array, Array]:
    """Signs of the joints, and fixed frames of base and hand, that give the arm Table 1's twists.

    Half a turn about x flips every joint after it: `Rx(π) Rz(θ) Tz(d) = Rz(−θ) Tz(−d) Rx(π)`.
    """
    half_turns = np.round((robot.alpha - _TWISTS) / np.pi)
    flips = half_turns % 2
    flips[0] = 0.0  # the base frame takes the first twist, whatever it is
    signs = (-1.0) ** np.cumsum(flips)
    last = signs[-1]
    first_a = robot.a[0]
    first_alpha = robot.alpha[0]
    base = _link(first_a, first_alpha, d=0, theta=0)
    hand = np.diag([1, last, last, 1])
    return signs, base, hand


def _solve(
    a: Array,
    d: Array,
    pose: Array,
    free: Array,
    near: float,
) -> tuple[Array, Array]:
    """Angles `(…, 8, 6)`, and each branch's distance from its pose, `(…, 8)`, m."""
    # The wrist's centre lies d6 behind the hand.
    hand = pose[..., :3, 3]
    approach = pose[..., :3, 2]
    centre = hand - d[5] * approach
    x = centre[..., 0, None]
    y = centre[..., 1, None]
    z = centre[..., 2, None]
    shoulder_sign, elbow_sign, wrist_sign = BRANCHES.T
    t1, reach, beside = _shoulder(
        x,
        y,
        offset=d[1] + d[2],
        sign=shoulder_sign,
        free=free[..., 0],
        near=near,
    )
    t2, t3, beyond = _elbow(
        reach - a[1],
        d[0] - z,
        upper=a[2],
        lower=(a[3], d[3]),
        sign=elbow_sign,
        free=free[..., 1],
        near=near,
    )
    t4, t5, t6 = _wrist(
        pose[..., None, :3, :3],
        t1,
        t2 + t3,
        sign=wrist_sign,
        free=free[..., 3],
    )
    angles = np.broadcast_arrays(t1, t2, t3, t4, t5, t6)
    joints = np.stack(angles, axis=-1)
    gap = np.hypot(beside, beyond)
    return joints, np.broadcast_to(gap, joints.shape[:-1])


def _shoulder(
    x: Array,
    y: Array,
    offset: float,
    sign: Array,
    free: Array,
    near: float,
) -> tuple[Array, Array, Array]:
    """θ1, the wrist centre's distance forwards, and how much too near axis 1 it is.

    The wrist centre `(x, y)` stands `offset` beside the arm's plane, which turns by θ1.
    """
    r = np.hypot(x, y)
    inner = abs(offset)
    # reach = ±√(r² − offset²), as a product: precise where the difference is small.
    beyond = np.maximum(r - inner, 0.0)
    beyond = np.where(beyond <= near, 0.0, beyond)
    reach = sign * np.sqrt(beyond) * np.sqrt(r + inner)
    # θ1 = atan2(y, x) − atan2(offset, reach)   (eq. 6)
    heading = np.arctan2(y, x)
    heading = np.where(r > near, heading, free)
    angle = heading - np.arctan2(offset, reach)
    return angle, reach, np.maximum(inner - r, 0.0)


def _elbow(
    u: Array,
    w: Array,
    upper: Any,
    lower: tuple[Any, Any],
    sign: Array,
    free: Array,
    near: float,
) -> tuple[Array, Array, Array]:
    """θ2, θ3, and how far the wrist centre is outside the annulus that the links reach.

    Links of lengths `upper` and `|lower|` reach `(u, w)` in the arm's plane (eq. 7).
    """
    lower_length = np.hypot(*lower)
    inner = abs(abs(upper) - lower_length)
    outer = abs(upper) + lower_length
    rho = np.hypot(u, w)
    # Within the annulus, and on its rims where rounding would leave them.
    rim = np.clip(rho, inner, outer)
    rim = np.where(np.abs(rho - outer) <= near, outer, rim)
    rim = np.where(np.abs(rho - inner) <= near, inner, rim)
    # tan²(bend/2) = (outer² − ρ²)/(ρ² − inner²), factored: precise up to the stretched arm.
    beyond = (outer - rim) * (outer + rim)
    within = (rim - inner) * (rim + inner)
    half = np.arctan2(np.sqrt(beyond), np.sqrt(within))
    straight = 0.0 if upper > 0 else np.pi
    bend = straight + 2 * sign * half
    # θ2 = atan2(w, u) − the angle at the shoulder between upper link and wrist centre
    opposite = lower_length * np.sin(bend)
    adjacent = upper + lower_length * np.cos(bend)
    elevation = np.arctan2(w, u)
    lift = elevation - np.arctan2(opposite, adjacent)
    upper_angle = np.where(rho > near, lift, free)
    # θ3 counts from the lower link's x axis.
    along, across = lower
    lower_angle = bend - np.arctan2(across, along)
    outside = np.maximum(rho - outer, inner - rho)
    return upper_angle, lower_angle, np.maximum(outside, 0.0)


def _wrist(
    rotation: Array,
    t1: Array,
    t23: Array,
    sign: Array,
    free: Array,
) -> tuple[Array, Array, Array]:
    """θ4, θ5, θ6 from `N = Rx(π/2) R36 = Rz(θ4) Ry(−θ5) Rz(θ6)`."""
    c1 = np.cos(t1)
    s1 = np.sin(t1)
    c = np.cos(t23)
    s = np.sin(t23)
    # N = Rx(π/2) R03ᵀ R
    rows = [
        [c1 * c, s1 * c, -s],
        [s1, -c1, 0 * c],
        [-c1 * s, -s1 * s, -c],
    ]
    product = _matrix(rows) @ rotation
    first_row, second_row, _ = np.moveaxis(product, (-2, -1), (0, 1))
    n11, n12, n13 = first_row
    n21, n22, n23 = second_row
    n33 = product[..., 2, 2]
    # Its last column is (−c4 s5, −s4 s5, c5): θ4 from the first two, unless they vanish.
    aligned = np.hypot(n13, n23) <= _ALIGNED_RAD
    flip = np.where(sign > 0, 0.0, np.pi)
    turned = np.arctan2(-sign * n23, -sign * n13)
    t4 = np.where(aligned, free + flip, turned)
    # Rz(−θ4) N = Ry(−θ5) Rz(θ6)
    c4 = np.cos(t4)
    s4 = np.sin(t4)
    s5 = -c4 * n13 - s4 * n23
    t5 = np.arctan2(s5, n33)
    s6 = c4 * n21 - s4 * n11
    c6 = c4 * n22 - s4 * n12
    return t4, t5, np.arctan2(s6, c6)


def _representative(
    q: Array,
    joint_range: Array,
    previous: Array,
) -> tuple[Array, Bools]:
    """Angles `(…, 8, 6)` plus multiples of 2π as `Robot.inverse` promises; if all are in range."""
    low, high = joint_range.T
    turn = 2 * np.pi
    # q + m · 2π is in range for every whole m from `first` to `last`.
    to_low = low - _ROUNDING_RAD - q
    to_high = high + _ROUNDING_RAD - q
    first = np.ceil(to_low / turn)
    last = np.floor(to_high / turn)
    inside = first <= last
    above = q + first * turn - high
    below = low - q - last * turn
    outside = np.where(above < below, first, last)
    to_previous = previous[..., None, :] - q
    nearest = np.round(to_previous / turn)
    wanted = np.clip(nearest, first, last)
    turns = np.where(inside, wanted, outside)
    q = q + turn * turns
    clipped = np.clip(q, low, high)
    return np.where(inside, clipped, q), inside.all(axis=-1)


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
    right = finite & orthonormal & right_handed & last_row.all(axis=-1)
    for index in np.argwhere(~right).tolist():
        key = "pose" + _numbered(index)
        wrong = array[tuple(index)]
        raise InvalidInput(key, expected, value=wrong.tolist())
    return array


def _array(
    key: str,
    value: Any,
    shape: tuple[int, ...],
    expected: str,
) -> Array:
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


def _check_choice(
    table: Mapping[str, Any],
    key: str,
    choices: tuple[str, ...],
) -> None:
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
