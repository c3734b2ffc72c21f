"""Chunks and episodes of learned policies, from the files in which they are kept.

- `.csv`, `.txt`, `.npz`, `.npy`, `.json`: as a motion's (`trajopt.formats.motion`), where a column
  `chunk` or `episode_index` tells several apart, an array has a further axis for them, or a list
  has a table for each;
- `.parquet`: LeRobot's, versions 2 and 3, with lists of numbers in cells. The names of joints and
  the rate come from its `meta/info.json`. A list of lists in a cell is a chunk;
- `.hdf5`, `.h5`: ALOHA's (`action`, `observations/qpos`) and robomimic's (`data/demo_0`, of which
  the joint positions are read: its actions are no joint positions);
- `.mcap`: a bag of ROS 2. Each topic of `JointState` is an episode, each `JointTrajectory` a chunk.

A wrong episode does not hinder the others: it has its error in place of samples.
"""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.core import files
from trajopt.core.exceptions import FileNote, InvalidInput, TrajoptError
from trajopt.core.units import ANGLES, asked
from trajopt.formats import arrays, csv_file, samples_csv
from trajopt.formats.csv_file import Table
from trajopt.formats.samples import Samples
from trajopt.planners.planner import backend

RECORDED = (".parquet", ".hdf5", ".h5", ".mcap")
"""Endings of the files of recorded episodes, which no other reader takes."""
ENDINGS = (".csv", ".txt", ".npz", ".npy", ".json", *RECORDED)
"""Endings of the files that `read` takes."""

# Headings of columns that say to which episode and to which chunk a line belongs.
_KEYS = (
    re.compile(r"episode(?:[_ ]?(?:index|id|idx|nr))?", re.IGNORECASE),
    re.compile(r"chunk(?:[_ ]?(?:index|id|idx|nr))?", re.IGNORECASE),
)


def is_recorded(path: Path) -> bool:
    """Return whether a file has recorded episodes; a `.h5` may have results instead."""
    if path.suffix != ".h5":
        return path.suffix in RECORDED
    import h5py  # late: reading other files needs none of it

    try:
        with files.opened(path) as opened, h5py.File(opened, "r") as file:
            return "action" in file or "data" in file
    except OSError:
        return False


@dataclass(frozen=True, eq=False)
class Episode:
    """An episode or a chunk of a file.

    Attributes:
        name: the file's name, with the number of the part where there are several.
        samples: None where they cannot be used.
        error: what is wrong then.
    """

    name: str
    samples: Samples | None
    error: TrajoptError | None = None


def read(
    path: Path,
    unit: str | None = None,
    joint_units: Mapping[str, str] = MappingProxyType({}),
    *,
    rate: float | None = None,
    size: int | None = None,
) -> list[Episode]:
    """Read the chunks or episodes of a file.

    Args:
        path: the file.
        unit: units of columns whose heading says none, like "deg" or "deg,mm,ms"; by default rad.
        joint_units: "rad" or "m" by the names of the robot's joints, where known.
        rate: targets per second, where the file has no times.
        size: number of targets of a chunk, where the file does not tell chunks apart; the last
            chunk of an episode may be shorter.

    Raises:
        InvalidInput: The file cannot be read, or has no samples; names it and what would be right.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        found = _read(path, unit, joint_units, rate, size)
    for said, kind in dict.fromkeys((str(warning.message), warning.category) for warning in caught):
        warnings.warn(kind(said), stacklevel=2)  # once, not for each part
    return found


def _read(
    path: Path,
    unit: str | None,
    joint_units: Mapping[str, str],
    rate: float | None,
    size: int | None,
) -> list[Episode]:
    wanted = asked(unit)
    try:
        whole = list(_tables(path, rate))
        if not whole:
            raise InvalidInput("episodes", "one at least; the file has none")
        every = [part for name, table in whole for part in _told_apart(name, table)]
        if size is not None:
            every = [part for name, table in every for part in _of_size(name, table, size)]
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    headings = [
        heading for _, table in every if isinstance(table, Table) for heading in table.headings
    ]
    if "angle" not in wanted:
        wanted["angle"] = "rad"
        if not any(csv_file.heading(heading)[1] in ANGLES for heading in headings):
            note = f"{path.name}: angles are read in rad; unit=deg if not"
            warnings.warn(FileNote(note), stacklevel=2)
    parts: list[Episode] = []
    for number, (name, table) in enumerate(every, start=1):
        own_name = name or (f"{path.stem}-{number}" if len(every) > 1 else path.stem)
        with warnings.catch_warnings():
            if parts:  # what was said of the first one
                warnings.simplefilter("ignore", FileNote)
            parts.append(_part(own_name, table, path.name, wanted, joint_units, rate))
    return parts


def _part(
    name: str,
    table: Table | InvalidInput,
    file: str,
    wanted: Mapping[str, str],
    joint_units: Mapping[str, str],
    rate: float | None,
) -> Episode:
    """Return the samples of a table, or what is wrong with it."""
    try:
        if isinstance(table, InvalidInput):
            raise table
        timed = _timed(table, rate)
        return Episode(name, samples_csv.of_table(timed, file, wanted, joint_units))
    except InvalidInput as error:
        return Episode(name, None, error)


def _tables(path: Path, rate: float | None) -> Iterator[tuple[str, Table | InvalidInput]]:
    """Yield the tables of a file with their names, which are empty where it has none."""
    if path.suffix in (".csv", ".txt"):
        text = files.text(path, "samples", "CSV")
        yield "", csv_file.parted(csv_file.table(text, commented=True))
        return
    for name, held in _held(path):
        try:
            told = dict(held)
            for key, value in told.items():
                array = _array(value)
                if array is not None and array.ndim == 2 and len(array) == 1:
                    raise InvalidInput(key, "at least two targets", value=1)
            if rate is not None:
                told = {"fps": rate, **{key: value for key, value in told.items() if key != "fps"}}
            yield name, arrays.table(told, path.name)
        except InvalidInput as error:
            yield name, error


def _held(path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the arrays of each chunk of a file of arrays, with its name where it has one."""
    if path.suffix in RECORDED:
        yield from _READERS[path.suffix](path)
        return
    if path.suffix == ".json":
        given = files.json(path, "samples")
    elif path.suffix in (".npz", ".npy"):
        given = arrays.load(path)
    else:
        right = f"a file ending in {', '.join(ENDINGS)}"
        raise InvalidInput("PATH", right, value=str(path))
    if isinstance(given, Mapping) and len(given) == 1:  # {"chunks": [...]}
        (only,) = given.values()
        given = only if _is_list_of_tables(only) else given
    if _is_list_of_tables(given):
        for row in given:
            yield str(row.get("name", "")), row
        return
    if isinstance(given, np.ndarray):
        given = {"action": given}
    if not isinstance(given, Mapping):
        raise InvalidInput("samples", "a table of arrays, or a list with a table for each chunk")
    sizes = {
        len(array) for array in map(_array, given.values()) if array is not None and array.ndim == 3
    }
    if len(sizes) != 1:
        yield "", given
        return
    (count,) = sizes
    for number in range(count):
        yield "", {key: _of_chunk(value, number, count) for key, value in given.items()}


def _is_list_of_tables(given: Any) -> bool:
    """Return whether this is a list of tables, each with an array of two axes."""
    if not isinstance(given, list) or not given:
        return False
    if not all(isinstance(row, Mapping) for row in given):
        return False
    two = [
        array for array in map(_array, given[0].values()) if array is not None and array.ndim == 2
    ]
    return bool(two)


def _array(value: Any) -> NDArray[Any] | None:
    try:
        return np.asarray(value)
    except ValueError:  # of several lengths
        return None


def _of_chunk(value: Any, number: int, count: int) -> Any:
    """Return what one chunk has of an array: its part of one with an axis for the chunks."""
    array = _array(value)
    if array is None or array.dtype.kind not in "iuf" or array.ndim < 2 or len(array) != count:
        return value
    return array[number]


def _told_apart(
    name: str, table: Table | InvalidInput
) -> Iterator[tuple[str, Table | InvalidInput]]:
    """Yield the parts of a table that its columns of episodes and chunks tell apart."""
    if isinstance(table, InvalidInput):
        yield name, table
        return
    keys = [
        index
        for pattern in _KEYS
        for index, heading in enumerate(table.headings)
        if pattern.fullmatch(csv_file.heading(heading)[0].strip())
    ]
    if not keys:
        yield name, table
        return
    rows = [*zip(*(table.columns[index] for index in keys), strict=True)]
    words = [re.split(r"[_ ]", table.headings[index])[0].lower() for index in keys]
    headings = list(table.headings)
    for index, word in zip(keys, words, strict=True):
        headings[index] = f"{word}_index"  # it is no joint's
    table = replace(table, headings=headings, cells=table.columns)
    for key in dict.fromkeys(rows):
        own_rows = [row for row, other in enumerate(rows) if other == key]
        said = "-".join(f"{word}-{value}" for word, value in zip(words, key, strict=True))
        yield "-".join(filter(None, [name, said])), _rows(table, own_rows)


def _of_size(
    name: str, table: Table | InvalidInput, size: int
) -> Iterator[tuple[str, Table | InvalidInput]]:
    """Yield parts of as many lines; a single line left over joins the part before it."""
    if isinstance(table, InvalidInput):
        yield name, table
        return
    count = len(table.columns[0])
    firsts = list(range(0, max(count - 1, 1), size))
    for number, (first, last) in enumerate(zip(firsts, [*firsts[1:], count], strict=True), 1):
        said = f"{name}-{number}" if name and len(firsts) > 1 else name
        yield said, _rows(table, range(first, last))


def _rows(table: Table, rows: Sequence[int]) -> Table:
    """Return some lines of a table."""
    return replace(
        table,
        lines=[table.lines[row] for row in rows],
        cells=[[column[row] for row in rows] for column in table.columns],
    )


def _timed(table: Table, rate: float | None) -> Table:
    """Return the table with a column of times, at a rate, in place of what it has of times.

    Columns without headings are joints in their order.
    """
    headings, cells = list(table.headings), list(table.columns)
    if not any(headings):
        headings = [f"joint_{index + 1}" for index in range(len(headings))]
    clocks = [i for i, heading in enumerate(headings) if samples_csv.kind(heading) == "time"]
    if rate is None and not clocks:
        raise InvalidInput("times", "a column of times, or --rate, targets per second")
    if rate is not None:
        step = 1 / Decimal(str(rate))
        for index in reversed(clocks):
            del headings[index], cells[index]
        headings.append("time [s]")
        cells.append([str(step * row) for row in range(len(table.columns[0]))])
    return replace(table, headings=headings, cells=cells)


def _parquet(path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the arrays of each episode of a Parquet file; of each cell where one holds a chunk."""
    pyarrow = backend("pyarrow", "parquet")
    parquet = backend("pyarrow.parquet", "parquet")
    try:
        with files.opened(path) as file:
            whole = parquet.ParquetFile(file)
            wanted = [
                field.name for field in whole.schema_arrow if _is_numbers(pyarrow, field.type)
            ]
            columns = whole.read(columns=wanted)
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        raise files.unreadable(path, "episodes", "Parquet", error) from None
    held = {}
    for name in wanted:
        try:
            held[name] = _rows_of(columns[name])
        except (TypeError, ValueError):
            right = "a list of numbers in each row, all of one length"
            raise InvalidInput(f"column {name}", right) from None
    info = _info(path)
    chunked = [name for name, array in held.items() if array.ndim == 3]
    if chunked:
        for number in range(len(held[chunked[0]])):
            yield "", {**info, **{name: held[name][number] for name in chunked}}
        return
    index = held.pop("episode_index", None)
    if index is not None and not np.isfinite(index).all():
        row = int(np.flatnonzero(~np.isfinite(index))[0]) + 1
        raise InvalidInput(f"episode_index, row {row}", "the number of an episode")
    numbers = [] if index is None else np.unique(index).astype(int).tolist()
    for number in numbers or [None]:
        some = slice(None) if number is None else index == number
        name = f"episode-{number}" if len(numbers) > 1 else ""
        yield name, {**info, **{key: array[some] for key, array in held.items()}}


def _is_numbers(pyarrow: Any, kind: Any) -> bool:
    """Return whether a column has numbers, or lists of them."""
    types = pyarrow.types
    while types.is_list(kind) or types.is_fixed_size_list(kind) or types.is_large_list(kind):
        kind = kind.value_type
    return bool(types.is_floating(kind) or types.is_integer(kind))


def _rows_of(column: Any) -> NDArray[Any]:
    """Return a column as an array, a row for each row.

    Raises:
        TypeError, ValueError: Lists are of several lengths, or one is missing.
    """
    found = column.to_pylist()
    if any(isinstance(cell, list) for cell in found):
        return np.array(found, dtype=float)
    return np.asarray(column.to_numpy())


def _info(path: Path) -> dict[str, Any]:
    """Return names and rate from a LeRobot data set's `meta/info.json`, where it is there."""
    for folder in path.absolute().parents[1:4]:
        file = folder / "meta" / "info.json"
        if not file.is_file():
            continue
        found = files.json(file, "info")
        names = _under(found, "features", "action", "names")
        if isinstance(names, Mapping):  # {"motors": [...]}
            names = next(iter(names.values()), None)
        told: dict[str, Any] = {}
        if isinstance(names, list) and names:
            told["joint_names"] = [str(name).removesuffix(".pos") for name in names]
        rate = _under(found, "fps")
        return told | ({} if rate is None else {"fps": rate})
    return {}


def _under(table: Any, *keys: str) -> Any:
    """Return what a table has under keys, one within the other; None where it has not."""
    for key in keys:
        table = table.get(key) if isinstance(table, Mapping) else None
    return table


_ALOHA = ("waist", "shoulder", "elbow", "forearm_roll", "wrist_angle", "wrist_rotate", "gripper")


def _hdf5(path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the arrays of ALOHA's episode, or of each of robomimic's demonstrations."""
    import h5py  # late: reading other files needs none of it

    held: list[tuple[str, dict[str, Any]]] = []
    episode: dict[str, Any]
    try:
        with files.opened(path) as opened, h5py.File(opened, "r") as file:
            demos = file.get("data")
            if isinstance(demos, h5py.Group):
                env = json.loads(demos.attrs.get("env_args", "{}"))
                rate = _under(env, "env_kwargs", "control_freq")
                for name in sorted(demos, key=lambda demo: (len(demo), demo)):
                    episode = {"q": _positions(demos, f"{name}/obs/robot0_joint_pos")}
                    held.append((name, episode | ({} if rate is None else {"fps": rate})))
            else:
                action = _positions(file, "action")
                episode = {
                    "action": action,
                    "observation.state": _positions(file, "observations/qpos"),
                }
                if action.shape[1] == 2 * len(_ALOHA):
                    sides = [f"{side}_{key}" for side in ("left", "right") for key in _ALOHA]
                    episode["joint_names"] = sides
                held.append(("", episode))
    except InvalidInput:
        raise
    except (OSError, ValueError) as error:
        raise files.unreadable(path, "episodes", "HDF5", error) from None
    yield from held


def _positions(group: Any, key: str) -> NDArray[Any]:
    """Return a table of positions of an HDF5 file.

    Raises:
        InvalidInput: The file has no positions under this key.
    """
    found = group.get(key)
    if getattr(found, "ndim", 0) != 2 or found.dtype.kind not in "iuf":
        right = "an array of positions, (samples, joints), as ALOHA and robomimic keep it"
        raise InvalidInput(f"{group.name.rstrip('/')}/{key}", right)
    return np.asarray(found[()])


def _mcap(path: Path) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield the joint states of each topic of a bag, and each joint trajectory."""
    bags, decoder = backend("mcap.reader", "mcap"), backend("mcap_ros2.decoder", "mcap")
    states: dict[tuple[str, tuple[str, ...]], tuple[list[float], list[Any]]] = {}
    try:
        with files.opened(path) as file:
            bag = bags.make_reader(file, decoder_factories=[decoder.DecoderFactory()])
            messages = [
                (channel.topic, record.log_time, message)
                for _, channel, record, message in bag.iter_decoded_messages()
                if hasattr(message, "position") or hasattr(message, "points")
            ]
        for name, log_time, message in messages:
            topic = name.strip("/").replace("/", "-")
            if hasattr(message, "position") and hasattr(message, "name") and len(message.position):
                stamps, rows = states.setdefault((topic, tuple(message.name)), ([], []))
                stamp = message.header.stamp
                stamps.append(stamp.sec + stamp.nanosec / 1e9)
                rows.append(list(message.position))
            elif hasattr(message, "points") and hasattr(message, "joint_names"):
                starts = [point.time_from_start for point in message.points]
                yield (
                    f"{topic}-{log_time}",
                    {
                        "joint_names": list(message.joint_names),
                        "time": np.array([start.sec + start.nanosec / 1e9 for start in starts]),
                        "action": np.array([list(point.positions) for point in message.points]),
                    },
                )
    except Exception as error:  # of the reader, its decoder, or the system
        raise files.unreadable(path, "episodes", "MCAP", error) from None
    for (topic, names), (stamps, rows) in states.items():
        yield topic, {"joint_names": list(names), "time": np.array(stamps), "q": np.array(rows)}


_READERS = {".parquet": _parquet, ".hdf5": _hdf5, ".h5": _hdf5, ".mcap": _mcap}
