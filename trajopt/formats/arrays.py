"""A motion as the arrays that a Python program keeps: NumPy's `.npz`, or JSON.

    np.savez("log.npz", t=t, q=q, dq=dq)                      # (samples,) and (samples, joints)
    {"joint_names": ["q1", "q2"], "dt": 0.02, "position": [[0, 0], ...], "velocity": [...]}

An array's name says what it is, by the words of a CSV's headings (`trajopt.formats.samples_csv`);
tables within tables and lists of records are arrays too. Times are an array, or follow from a step
(`dt`) or a rate (`fps`). Angles are in radians unless `unit` says otherwise.
"""

from __future__ import annotations

import re
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.core import files
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.keys import a_list
from trajopt.core.units import asked
from trajopt.formats import samples_csv
from trajopt.formats.csv_file import Table
from trajopt.formats.samples import Samples

_NAMES = ("joint_names", "names", "name", "joints")
_STEP = re.compile(r"(\w+[_.])?(dt|time_?step|sample_time|period)", re.IGNORECASE)
_RATE = re.compile(r"(\w+[_.])?(fps|hz|rate|frequency)", re.IGNORECASE)
_BARE = re.compile(r"(joint_?)?(states?|trajectory|traj|plan|path|solution)", re.IGNORECASE)
NO_MOTION = "the arrays are"
"""It introduces the arrays of a file that is no motion, in an error."""

_SAVE = "np.savez('log.npz', t=a[:, 0], q=a[:, 1:])"


def read(
    path: Path, unit: str | None = None, joint_units: Mapping[str, str] = MappingProxyType({})
) -> Samples:
    """Read samples from a `.npz` or `.npy` file.

    Args:
        path: The file.
        unit: Units, like "deg" or "deg,mm,ms"; by default radians, which a `FileNote` says.
        joint_units: "rad" or "m" by the names of the robot's joints, where known.

    Raises:
        InvalidInput: The file cannot be read, or has no times or positions; names its arrays.
    """
    held = load(path)
    if isinstance(held, np.ndarray):
        right = f"arrays with names, as {_SAVE} writes them"
        raise InvalidInput("motion", f"{right}; {NO_MOTION} one {held.shape} without a name")
    return samples(held, path.name, unit, joint_units)


def load(path: Path) -> dict[str, NDArray[Any]] | NDArray[Any]:
    """Return the arrays of a `.npz` or `.npy` file by their names, or one without a name.

    Raises:
        InvalidInput: The file cannot be read.
    """
    try:
        with files.opened(path) as file:
            if path.suffix == ".npz":
                sizes = [member.file_size for member in zipfile.ZipFile(file).infolist()]
                if sum(sizes) > files.MAX_BYTES:
                    raise ValueError(f"it has more than {files.MAX_BYTES / 1e6:g} MB")
            file.seek(0)
            found = np.load(file, allow_pickle=False)
            held = dict(found) if path.suffix == ".npz" else found
    except Exception as error:  # of NumPy, of zip files, or of the system
        raise files.unreadable(path, "motion", path.suffix, error) from None
    if isinstance(held, np.ndarray) and held.dtype.names is not None:
        return {name: held[name] for name in held.dtype.names}
    return held


def samples(
    given: Any,
    name: str,
    unit: str | None = None,
    joint_units: Mapping[str, str] = MappingProxyType({}),
) -> Samples:
    """Return the samples in a table of arrays, or in a list of records.

    Args:
        given: The table.
        name: The file's name.
        unit: As in `read`.
        joint_units: As in `read`.

    Raises:
        InvalidInput: The table has no times or no positions; names its arrays.
    """
    whole = table(given, name)
    wanted = asked(unit)
    if "angle" not in wanted:
        wanted["angle"] = "rad"
        warnings.warn(FileNote(f"{name}: angles are read in rad; unit=deg if not"), stacklevel=2)
    return samples_csv.of_table(whole, name, wanted, joint_units)


def table(given: Any, name: str) -> Table:
    """Return a table of arrays, or a list of records, as a table of texts with headings.

    Args:
        given: The table.
        name: The file's name, for notes.

    Raises:
        InvalidInput: The table has no times or no positions; names its arrays.
    """
    return _table(_arrays(given), name)


def held(given: Any) -> bool:
    """Return whether this may be a table of arrays, or a list of records: not a list of numbers."""
    if a_list(given):
        return bool(given) and all(isinstance(table, Mapping) for table in given)
    return isinstance(given, Mapping) and any(array.ndim for array in _arrays(given).values())


def _arrays(given: Any) -> dict[str, NDArray[Any]]:
    """Return all arrays, numbers and texts of a table, by name; of tables within with their place.

    Raises:
        InvalidInput: Records have different keys.
    """
    if a_list(given):
        first = given[0]
        if any(table.keys() != first.keys() for table in given):
            raise InvalidInput("records", f"the same keys in each: {', '.join(first)}")
        given = {key: [table[key] for table in given] for key in first}
    return dict(_flat("", given))


def _flat(place: str, given: Mapping[str, Any]) -> Iterator[tuple[str, NDArray[Any]]]:
    for key, value in given.items():
        if isinstance(value, Mapping):
            yield from _flat(f"{place}{key}.", value)
        elif a_list(value) and value and isinstance(value[0], Mapping):
            if all(
                isinstance(table, Mapping) and table.keys() == value[0].keys() for table in value
            ):
                yield from _flat(
                    f"{place}{key}.", {k: [table[k] for table in value] for k in value[0]}
                )
        else:
            try:
                array = np.array(value) if not isinstance(value, np.ndarray) else value
            except ValueError:  # of several lengths
                continue
            if array.ndim == 3 and len(array) == 1:  # a batch of one
                array = array[0]
            yield f"{place}{key}", array


def _table(arrays: Mapping[str, NDArray[Any]], name: str) -> Table:
    """Return the arrays as a table with headings, whose times are in its first column."""
    numbers = {key: array for key, array in arrays.items() if array.dtype.kind in "iuf"}
    said = ", ".join(f"{key} {array.shape}" for key, array in arrays.items()) or "none"
    roles = {key: samples_csv.kind(key.replace(".", "_")) for key in numbers}
    clocks = [key for key, role in roles.items() if role == "time" and numbers[key].ndim == 1]
    motions = [key for key, array in numbers.items() if array.ndim == 2 and len(array) > 1]
    if not any(roles[key] == "positions" for key in motions):
        for key in motions:
            bare = _BARE.fullmatch(key.rpartition(".")[2]) or samples_csv.source(key)
            if roles[key] == "bare" and (bare or len(motions) == 1):
                roles[key] = "positions"
    motions = [key for key in motions if roles[key] in samples_csv.FIELDS]
    positions = [key for key in motions if roles[key] == "positions"]
    if not positions:
        right = f"an array of positions, (samples, joints), q or position, say; {NO_MOTION} {said}"
        raise InvalidInput("motion", right)
    rows, joints = numbers[positions[0]].shape
    clocks = [key for key in clocks if len(numbers[key]) == rows]
    if clocks:
        headings, cells = [samples_csv.clock(clocks[0])], [[*map(str, numbers[clocks[0]])]]
    else:
        headings, cells = ["time [s]"], [_times(numbers, rows, said)]
    listed = [arrays[key].tolist() for key in arrays if key.rpartition(".")[2] in _NAMES]
    labels = next((names for names in listed if a_list(names) and len(names) == joints), None)
    labels = [*map(str, labels)] if labels else [f"joint_{joint + 1}" for joint in range(joints)]
    left_out = []
    for key, array in numbers.items():
        if key in motions and array.shape == (rows, joints):
            word = samples_csv.FIELDS[roles[key]]
            headings += [f"{samples_csv.source(key)}{label}_{word}" for label in labels]
            cells += [[*map(str, column)] for column in array.T]
        elif array.ndim and key != (clocks or [""])[0]:
            left_out.append(key)
    if left_out:
        warnings.warn(FileNote(f"{name}: left out: {', '.join(left_out)}"), stacklevel=2)
    return Table(headings, 1, ",", [(row + 1, "") for row in range(rows)], cells)


def _times(numbers: Mapping[str, NDArray[Any]], rows: int, said: str) -> list[str]:
    """Return the times of equal steps, s, exactly."""
    for key, array in numbers.items():
        if array.ndim == 0 and array > 0 and (_STEP.fullmatch(key) or _RATE.fullmatch(key)):
            size = Decimal(str(array))
            step = size if _STEP.fullmatch(key) else 1 / size
            return [str(step * row) for row in range(rows)]
    right = f"an array of times, t, or a step of time, dt, or a rate, fps; {NO_MOTION} {said}"
    raise InvalidInput("motion", right)
