"""A motion from a file of samples or polynomials, or from an object in Python.

- `.csv`, `.txt`: samples, with a header of names and units (`trajopt.formats.samples_csv`);
- `.json`, `.yaml`: a `trajectory_msgs/JointTrajectory` (`trajopt.formats.joint_trajectory`);
- `.yaml`: a log of `sensor_msgs/JointState` (`trajopt.formats.joint_state`);
- `.npz`, `.npy` or `.json`: arrays with names (`trajopt.formats.arrays`);
- `.json` with `breaks` and `coefficients`: polynomials, as `plan --out motion.json` writes them,
  with the `lengths` of pieces where the breaks round them; or MATLAB's `pp`, of `jsonencode`;
- in Python also a `Trajectory`, `Samples`, and SciPy's `PPoly` and `BSpline`.
"""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trajopt.core import files, keys
from trajopt.core.arrays import Array
from trajopt.core.exceptions import FileNote, InvalidInput, InvalidTrajectory
from trajopt.core.interpolation import Interpolation
from trajopt.core.keys import Key
from trajopt.core.numerals import is_number
from trajopt.core.problem import Problem
from trajopt.core.tables import check_joint_names
from trajopt.core.trajectory import Trajectory
from trajopt.core.units import UNIT
from trajopt.formats import arrays, joint_state, joint_trajectory, samples_csv
from trajopt.formats.samples import Samples, known_as

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly

ENDINGS = (".csv", ".txt", ".json", ".yaml", ".yml", ".npz", ".npy")
TABLES = (".csv", ".txt")
ARRAYS = (".npz", ".npy")
WITH_UNITS = (*TABLES, *ARRAYS, ".json")
"""Endings of files whose units may be stated beside them."""
_RIGHT = "breaks (s) and coefficients (degree + 1, pieces, joints) that fit together, all finite"
MATLAB = {
    "form": Key(keys.text, "pp"),
    "breaks": Key(keys.a_list, "s"),
    "coefs": Key(keys.a_list, "a row for each joint of each piece, highest power first"),
    "pieces": Key(keys.number, "number of pieces"),
    "order": Key(keys.number, "number of coefficients"),
    "dim": Key(keys.numbers, "number of joints"),
}
"""The keys of MATLAB's `pp`."""
_OF_TRIAL = (
    "certificate",
    "certified_duration",
    "claimed_duration",
    "evaluations",
    "library_time",
    "lower_bound",
    "message",
    "options",
    "planner",
    "problem",
    "seed",
    "setup_time",
    "smoothness",
    "solve_time",
    "status",
    "waypoint_times",
)
POLYNOMIALS = {
    "breaks": Key(keys.a_list, "s"),
    "coefficients": Key(keys.a_list, "(degree + 1, pieces, joints)"),
    "joint_names": Key(keys.a_list, "one per joint"),
    "lengths": Key(keys.a_list, "of the pieces, s, where the breaks round them"),
    **{key: Key(keys.anything, "what `plan` writes of its trial") for key in _OF_TRIAL},
}
"""The keys of a file of polynomials."""
MAX_COEFFICIENTS = 101
_MAX_WORK = 5e7  # polynomials, times the square of their numbers of coefficients (at least 10)


@dataclass(frozen=True, eq=False)
class Motion:
    """A motion as it is executed.

    Attributes:
        name: The name of its file, or of its type.
        trajectory: From time 0 on; its waypoint times are its start and end.
        interpolation: The interpolation of its samples; `polynomial` where it has none.
        joint_names: One per joint, or empty if unknown.
        joint_units: "rad", or "m" for a prismatic joint; empty if unknown.
        of_message: Whether its names are a robot's own, not columns of a table by numbers.
        samples: What was joined; None where it has none.
    """

    name: str
    trajectory: Trajectory
    interpolation: Interpolation | Literal["polynomial"]
    joint_names: tuple[str, ...] = ()
    joint_units: tuple[str, ...] = ()
    of_message: bool = False
    samples: Samples | None = None

    def digest(self) -> str:
        """SHA-256 of the executed polynomials: 20 hexadecimal digits."""
        whole = hashlib.sha256()
        own = self.trajectory
        for array in (own.breaks, own.coefficients, own.lengths):
            whole.update(repr(array.shape).encode())
            whole.update(array.astype("<f8").tobytes())
        return whole.hexdigest()[:20]

    def for_joints(self, joint_names: Sequence[str]) -> Motion:
        """Return the motion with its joints in this order, if both sides name them.

        Names are compared as `trajopt.formats.samples.known_as` does. Joints beyond these (a
        gripper's, say) are left out, which a `FileNote` says.

        Raises:
            InvalidInput: The motion has other joints.
        """
        if not self.joint_names or not joint_names or self.joint_names == tuple(joint_names):
            return self
        names = known_as(self.joint_names, joint_names, ordered=not self.of_message)
        if len(set(names)) == len(names) and set(joint_names) < set(names):
            others = ", ".join(name for name in names if name not in joint_names)
            warnings.warn(
                FileNote(f"{self.name}: left out, as the robot has no such joint: {others}"),
                stacklevel=2,
            )
        elif sorted(names) != sorted(joint_names):
            right = f"the joints {', '.join(joint_names)}; rename them"
            raise InvalidInput("joint_names", right, value=list(self.joint_names), file=self.name)
        self._note_prefix(names)
        order = [names.index(name) for name in joint_names]
        in_order = self.trajectory.coefficients[..., order]
        own = replace(self.trajectory, coefficients=in_order)
        units = tuple(self.joint_units[joint] for joint in order if self.joint_units)
        samples = self.samples and self.samples.for_joints(order)
        return replace(
            self,
            trajectory=own,
            joint_names=tuple(joint_names),
            joint_units=units,
            samples=samples,
        )

    def _note_prefix(self, names: Sequence[str]) -> None:
        """Say that joints were found by the end of their names, or of the robot's."""
        first, known = next(zip(self.joint_names, names, strict=True))
        shorter, longer = sorted((first, known), key=len)
        if shorter != longer and longer.endswith(shorter) and "/" not in longer + shorter:
            note = f"{self.name}: its joints are found without a prefix: {first} is {known}"
            warnings.warn(FileNote(note), stacklevel=3)

    def check_units(self, problem: Problem) -> None:
        """Refuse metres for a joint that turns, and angles for one that slides.

        Joints are in the problem's order. Without units on both sides nothing is refused.

        Raises:
            InvalidInput: Names the joint and the unit.
        """
        for joint, own in enumerate(self.joint_units):
            if problem.joint_units and own != problem.unit(joint):
                does = "slides" if own == "rad" else "turns"
                label = problem.joint_labels[joint]
                right = f"a unit of {problem.unit(joint)}: {label} {does}"
                raise InvalidInput("unit", right, value=own, joint=joint, file=self.name)


def motion(
    given: str | Path | Motion | Samples | Trajectory | PPoly | BSpline,
    interpolation: Interpolation = "auto",
    unit: str | None = None,
    joint_units: Mapping[str, str] = MappingProxyType({}),
) -> Motion:
    """Return the motion of a file or an object.

    Args:
        given: The file or the object.
        interpolation: How samples are joined; by default as a controller joins them.
        unit: Units of a CSV's columns without a unit in the header, and of arrays, like "deg" or
            "deg,mm,ms".
        joint_units: "rad" or "m" by the names of the robot's joints, where known.

    Raises:
        InvalidInput: The file cannot be read, or lacks what the interpolation needs; names the
            file, the place in it, the value, and what would be right.
        InvalidTrajectory: The object is no piecewise polynomial.
    """
    if isinstance(given, str | Path):
        return _read(Path(given), interpolation, unit, joint_units)
    if isinstance(given, Samples):
        return of_samples("samples", given, interpolation)
    _check_nothing_to_join(interpolation)
    if isinstance(given, Motion):
        return given
    if isinstance(given, Trajectory):
        return Motion("trajectory", given, "polynomial")
    spline = Trajectory.from_ppoly(given)
    return Motion(type(given).__name__, spline, "polynomial")


def of_samples(name: str, samples: Samples, interpolation: Interpolation) -> Motion:
    """Return the motion of samples, joined as `interpolation` says."""
    trajectory = samples.trajectory(interpolation)
    kind = samples.interpolation(interpolation)
    return Motion(name, trajectory, kind, samples.joint_names, samples.joint_units, samples=samples)


def _check_nothing_to_join(interpolation: Interpolation) -> None:
    if interpolation != "auto":
        right = "auto: these are polynomials, there is nothing to interpolate"
        raise InvalidInput("interpolation", right, value=interpolation)


def _read(
    path: Path, interpolation: Interpolation, unit: str | None, joint_units: Mapping[str, str]
) -> Motion:
    if path.suffix not in ENDINGS:
        right = f"a file ending in {', '.join(ENDINGS)}"
        raise InvalidInput("motion", right, value=str(path))
    try:
        if path.suffix in TABLES:
            samples = samples_csv.read(path, unit, joint_units)
            motion = of_samples(path.name, samples, interpolation)
        elif path.suffix in ARRAYS:
            samples = arrays.read(path, unit, joint_units)
            motion = of_samples(path.name, samples, interpolation)
        else:
            motion = _in_file(path, interpolation, unit, joint_units)
        check_work(*motion.trajectory.coefficients.shape)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    except InvalidTrajectory as error:
        raise InvalidInput("motion", _RIGHT, value=str(error), file=str(path)) from None
    return motion


def _in_file(
    path: Path, interpolation: Interpolation, unit: str | None, joint_units: Mapping[str, str]
) -> Motion:
    table = files.json(path, "motion") if path.suffix == ".json" else None
    stated = _stated(table, path.name) if isinstance(table, Mapping) else None
    if stated is None and path.suffix == ".json" and not _is_message(table):
        samples = arrays.samples(table, path.name, unit, joint_units)
        return of_samples(path.name, samples, interpolation)
    if unit is not None:
        right = f"left out: {path.name} is in rad and m"
        raise InvalidInput(UNIT, right, value=unit)
    if stated is None:
        samples = joint_state.read(path) or joint_trajectory.read(path)
        return replace(of_samples(path.name, samples, interpolation), of_message=True)
    _check_nothing_to_join(interpolation)
    trajectory, names = stated
    if names:
        check_joint_names(names, trajectory.joints)
    return Motion(path.name, trajectory, "polynomial", tuple(names))


def _is_message(table: Any) -> bool:
    """Return whether a JSON file is to be read as a message: arrays have no points."""
    try:
        inside = joint_trajectory.found(table)
    except InvalidInput:
        return not arrays.held(table)
    return any("points" in own for own in inside.values()) or not arrays.held(table)


def _stated(table: Mapping[str, Any], name: str) -> tuple[Trajectory, Sequence[str]] | None:
    """The trajectory and the joints' names of a table of polynomials; None for a message."""
    if table.get("form") == "pp" and "coefs" in table:
        return _of_matlab(table, name), ()
    if "coefficients" not in table:
        return None
    others = keys.unread("", table, POLYNOMIALS, ("breaks", "coefficients"), strictness="ours")
    keys.note_unread(name, others)
    breaks = _array("breaks", table)
    coefficients = _array("coefficients", table)
    if breaks.ndim != 1 or coefficients.ndim != 3 or 0 in coefficients.shape or not breaks.size:
        shapes = f"{breaks.shape} and {coefficients.shape}"
        raise InvalidInput("breaks and coefficients", _RIGHT, value=shapes)
    check_work(*coefficients.shape)
    lengths = _array("lengths", table) if "lengths" in table else np.zeros(0)
    trajectory = Trajectory(breaks, coefficients, breaks[[0, -1]], lengths)
    return trajectory, files.names_at(table, "joint_names")


def _of_matlab(table: Mapping[str, Any], name: str) -> Trajectory:
    """The trajectory of MATLAB's `pp` (`mkpp`, `spline`), as `jsonencode` writes it.

    Each row of `coefs` is one joint's polynomial on a piece, highest power first; the joints of a
    piece follow each other.
    """
    keys.note_unread(name, keys.unread("", table, MATLAB, ("breaks", "coefs")))
    breaks = _array("breaks", table)
    coefficients = np.atleast_2d(_array("coefs", table))
    pieces = len(breaks) - 1
    joints, rest = divmod(len(coefficients), max(pieces, 1))
    if breaks.ndim != 1 or coefficients.ndim != 2 or pieces < 1 or rest or not joints:
        right = "breaks, and coefs with a row for each joint of each piece"
        raise InvalidInput("breaks and coefs", right, value=f"{breaks.shape}, {coefficients.shape}")
    rows = coefficients.reshape(pieces, joints, -1)
    check_work(rows.shape[2], pieces, joints)
    times = breaks - breaks[0]
    return Trajectory(times, np.moveaxis(rows, 2, 0), times[[0, -1]])


def _array(key: str, table: Mapping[str, Any]) -> Array:
    """Return nested lists of finite numbers as an array; texts and truth values are refused.

    Raises:
        InvalidInput: The lists hold something else, or are of several lengths.
    """
    try:
        found = np.array(table[key], dtype=object)
    except ValueError:  # of several lengths
        found = np.array(None)
    if not found.ndim or not all(map(is_number, found.flat)):
        raise InvalidInput(key, _RIGHT, value=table[key])
    return found.astype(float)


def check_work(rows: int, pieces: int, joints: int) -> None:
    """Refuse polynomials whose judgement would take many seconds, or gigabytes of memory.

    Raises:
        InvalidInput: There are more coefficients than a motion of 83,000 samples and six joints
            has.
    """
    if rows > MAX_COEFFICIENTS:
        right = f"polynomials of at most degree {MAX_COEFFICIENTS - 1}"
        raise InvalidInput("trajectory", right, value=rows - 1)
    if max(rows, 10) ** 2 * pieces * joints > _MAX_WORK:
        right = "fewer pieces, or polynomials of a lower degree"
        counts = f"{pieces} pieces of degree {rows - 1} for {joints} joints"
        raise InvalidInput("trajectory", right, value=counts)
