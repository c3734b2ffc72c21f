"""A trajectory as JSON, joint by joint: each has breaks of its own, and says only what changes.

    {"waypoint_times": [0, 0.5, 1],
     "joints": [[[0, 2, 0, 0.3], [0.5, -2]], [[0, 0.2]]]}

A piece is its start, s, then its coefficients in the time since then, highest power first
(rad/s^power). Those that are left out at its end go on from the piece before without a jump. So a
minimum-time motion takes two numbers a piece: a tenth of what all joints' coefficients on the
breaks of all joints do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput, InvalidTrajectory
from trajopt.core.files import check_keys
from trajopt.core.numerals import is_number
from trajopt.core.trajectory import Trajectory

Row = list[float]

_KEYS = {"waypoint_times", "joints"}

SAME_RTOLS = (1e-12, 1e-13, 1e-14, 1e-15)
"""What a piece may differ by and still go on from the one before, roughest first.

Of the joint's range of positions, over the mean time of a segment to the power of the derivative.
"""
COEFFICIENTS_MAX = 101
_WORK_MAX = 5e7  # polynomials, times the square of their coefficients (at least 10)
_EPS = float(np.finfo(float).eps)
_PIECE = "its start (s), then coefficients: finite numbers"


def table(trajectory: Trajectory, rtol: float = SAME_RTOLS[0]) -> dict[str, Any]:
    """The trajectory as JSON can say it.

    Args:
        trajectory: Any.
        rtol: One of `SAME_RTOLS`; 0: every piece with all its coefficients, exactly what it was.
    """
    segments = len(trajectory.waypoint_times) - 1
    unit = trajectory.duration / segments
    joints = []
    for joint in range(trajectory.joints):
        own = trajectory.coefficients[:, :, joint]
        coefficients = _without_leading_zeros(own)
        allowed = np.full(len(coefficients), -np.inf)
        if rtol > 0:
            allowed = _allowed(coefficients, unit, rtol)
        rows = _rows(trajectory.breaks, coefficients, allowed)
        joints.append(rows)
    return {
        "waypoint_times": trajectory.waypoint_times.tolist(),
        "joints": joints,
    }


def trajectory(said: Any) -> Trajectory:
    """The trajectory that a table says.

    Raises:
        InvalidInput: It says none; names the key, the joint and the piece.
    """
    if not is_said(said):
        names = " and ".join(sorted(_KEYS))
        raise InvalidInput("trajectory", f"an object with {names}")
    check_keys("trajectory.", said, _KEYS)
    times = _row("waypoint_times", said["waypoint_times"], "times: finite numbers")
    joints = said["joints"]
    has_joints = isinstance(joints, list) and len(joints) > 0
    if len(times) < 2 or not has_joints:
        right = "two or more waypoint times, and one or more joints"
        raise InvalidInput("trajectory", right)
    pieces = len(times)
    most = 1
    for joint, rows in enumerate(joints):
        if not isinstance(rows, list) or not rows or not isinstance(rows[0], list):
            raise InvalidInput("trajectory, joints", "a list of pieces", joint=joint)
        pieces += len(rows)
        most = max(most, len(rows[0]) - 1)  # no later piece has more coefficients
    check_work(most, pieces, len(joints))
    parts = []
    for joint, rows in enumerate(joints):
        part = _joint(rows, joint, times[-1])
        parts.append(part)
    try:
        return Trajectory.joined(parts, times)
    except InvalidTrajectory as error:
        right = f"a piecewise polynomial, but {error}"
        raise InvalidInput("trajectory", right) from None


def array(key: str, rows: Any, right: str) -> Array:
    """Return nested lists of finite numbers as an array; texts and truth values are refused.

    Raises:
        InvalidInput: They are none, or of several lengths; `right` says what is expected.
    """
    try:
        found = np.array(rows, dtype=object)
    except ValueError:  # of several lengths
        found = np.array(None)
    if not found.ndim or not all(map(is_number, found.flat)):
        raise InvalidInput(key, right, value=rows)
    return found.astype(float)


def check_work(rows: int, pieces: int, joints: int) -> None:
    """Refuse polynomials that take more than seconds, or gigabytes, to judge.

    Raises:
        InvalidInput: There are more than a motion of 83,000 samples and six joints has.
    """
    if rows > COEFFICIENTS_MAX:
        right = f"polynomials of at most degree {COEFFICIENTS_MAX - 1}"
        raise InvalidInput("trajectory", right, value=rows - 1)
    if max(rows, 10) ** 2 * pieces * joints > _WORK_MAX:
        right = "fewer pieces, or polynomials of a lower degree"
        counts = f"{pieces} pieces of degree {rows - 1} for {joints} joints"
        raise InvalidInput("trajectory", right, value=counts)


def is_said(said: Any) -> bool:
    """Return whether a JSON value has the keys of such a trajectory."""
    return isinstance(said, Mapping) and said.keys() >= _KEYS


def _without_leading_zeros(coefficients: Array) -> Array:
    """Of as low a degree as all pieces have."""
    constant = len(coefficients) - 1
    used = np.flatnonzero(coefficients.any(axis=1))
    first = used[0] if len(used) else constant
    return coefficients[first:]


def _allowed(coefficients: Array, unit: float, rtol: float) -> Array:
    """By how much each coefficient may differ where a piece goes on, highest power first."""
    positions = coefficients[-1]
    degree = len(coefficients) - 1
    powers = np.arange(degree, -1, -1)
    allowed = rtol * np.ptp(positions) / unit**powers
    # a coordinate is known to some units in its last place
    largest = np.abs(positions).max()
    allowed[-1] += 4 * _EPS * largest
    return np.asarray(allowed)


def _rows(breaks: Array, coefficients: Array, allowed: Array) -> list[Row]:
    """The pieces of one joint; each is compared with what the rows before it lead to."""
    current = coefficients[:, 0]
    start = float(breaks[0])
    rows = [[start, *current.tolist()]]
    for piece in range(1, coefficients.shape[1]):
        wanted = coefficients[:, piece]
        arriving = _moved(current, breaks[piece] - start)
        difference = np.abs(wanted - arriving)
        changed = np.flatnonzero(difference > allowed)
        if not len(changed):
            continue
        count = changed[-1] + 1
        stated = wanted[:count]
        going_on = arriving[count:]
        current = np.concatenate([stated, going_on])
        start = float(breaks[piece])
        rows.append([start, *stated.tolist()])
    return rows


def _joint(said: Sequence[Any], joint: int, end: float) -> tuple[Array, Array]:
    """Breaks and coefficients `(degree + 1, pieces)` of one joint."""
    starts: list[float] = []
    pieces: list[Array] = []
    for number, item in enumerate(said, start=1):
        key = f"trajectory, piece {number}"
        start, *stated = _row(key, item, _PIECE, joint)
        going_on = np.zeros(0)
        most = COEFFICIENTS_MAX
        if pieces:
            before = pieces[-1]
            most = len(before)
            arriving = _moved(before, start - starts[-1])
            going_on = arriving[len(stated) :]
        if not 1 <= len(stated) <= most:
            right = f"from 1 to {most} coefficients"
            raise InvalidInput(key, right, value=len(stated), joint=joint)
        starts.append(start)
        pieces.append(np.concatenate([stated, going_on]))
    breaks = np.array([*starts, end])
    lengths = np.diff(breaks)
    if starts[0] != 0 or lengths.min() <= 0:
        right = "starts that rise from 0 to below the last waypoint time"
        raise InvalidInput("trajectory, joints", right, joint=joint)
    return breaks, np.stack(pieces, axis=1)


def _moved(coefficients: Array, offset: float) -> Array:
    """A polynomial in the time since a later instant."""
    return polynomials.shifted(coefficients, np.array(offset))


def _row(
    key: str,
    value: Any,
    right: str,
    joint: int | None = None,
) -> Sequence[float]:
    """A list of finite numbers, as floats."""
    if not isinstance(value, list) or not value:
        raise InvalidInput(key, right, value=value, joint=joint)
    for item in value:
        if not is_number(item):
            raise InvalidInput(key, right, value=item, joint=joint)
    return [float(item) for item in value]
