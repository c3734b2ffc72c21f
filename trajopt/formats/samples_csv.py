"""Samples of a motion as CSV: the time, then every joint's position, velocity and acceleration.

    time [s],elbow_joint [rad],wrist_1_joint [rad],elbow_joint [rad/s],wrist_1_joint [rad/s]
    0.0,0.0,0.0,0.0,0.0

That is what `write` writes. Logs of other programs are read too:

- The unit, or else a word of the name says which of the three a column is: `elbow_velocity`, `dq1`,
  `actual_qd_0`, `field.velocity0`, `/joint_states/elbow/velocity`. A name without such a word is
  that of a position, unless other columns have one or no line has a number there. Further columns
  are left out.
- Of joints that are there twice, as commanded (`target_q_0`) and as measured (`actual_q_0`), the
  commanded ones are read.
- A unit may stand in one column of a kind, or come from outside (`unit="deg,ms"`).
- Time may start anywhere; it is read exactly and counted from the first sample. Without a unit it
  is in seconds, or in the unit in which its first value is a date from 2001 to 2100. A ROS stamp
  may be in two columns, `header.stamp.sec` and `header.stamp.nanosec`.

Columns of accelerations make a controller join the samples with quintic pieces
(`trajopt.core.interpolation`).
"""

from __future__ import annotations

import csv
import re
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from decimal import Decimal
from itertools import chain
from pathlib import Path
from types import MappingProxyType

import numpy as np

from trajopt.core import files
from trajopt.core.arrays import Array
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.units import ANGLES, LENGTHS, TIMES, UNITS, asked, completed, contradicted
from trajopt.formats import csv_file, digits
from trajopt.formats.csv_file import Table
from trajopt.formats.samples import Samples, known_as

TIME = "time [s]"
READABLE = "rename the columns"
"""It introduces a header that is read, in an error."""


def _marker(words: str, further: str = "") -> re.Pattern[str]:
    """Match one of these words in a heading, with a character that separates it from the rest."""
    ends = rf"[_./ ](?:{words})$"
    pattern = rf"{ends}|(?<![a-z])(?:{words})(?![a-z])[_./ ]?{further}"
    return re.compile(pattern, re.IGNORECASE)


# The units' ends for positions, velocities and accelerations; the first is written.
_RATES = (("",), ("/s",), ("/s^2", "/s²", "/s2", "/s/s"))
_FIELDS = ("positions", "velocities", "accelerations")
_TIME = "time"
_BARE = "bare"  # a name alone, until all columns are known
_ACTUAL = "actual"  # measured, where other columns say what was commanded
_OTHER = (
    "efforts?|torques?|trq|tq|tau|currents?|forces?|temperatures?|voltages?|frame_id|seq|status"
    r"|nano_?secs?|nsecs?|(?:episode_|chunk_|frame_|task_|sample_|row_)?index(?=\W*$)|idx(?=\W*$)"
)
_KINDS = {  # words of a heading that say what a column is, looked for in this order
    "accelerations": "accelerations?|acc|accel|qdd|ddq|qddot|q_ddot|qacc",
    "velocities": "velocity|velocities|vel|speeds?|qd|dq|qdot|q_dot|qvel",
    "positions": rf"positions?|pos|qpos|angles?|q(?!.*[_./ ](?:{_OTHER}))",
    "": _OTHER,
}
_PATTERNS = {
    kind: re.compile(rf"[_./ ]?(?<![a-z])({words})(?![a-z])", re.IGNORECASE)
    for kind, words in _KINDS.items()
}
_ENDED = re.compile(r"(.*\w)[_./ ](?:positions?|pos)", re.IGNORECASE)
_TIME_NAME = re.compile(
    r"[%_]*(?:t|(?:.*[_./ ])?(?:times?|timestamp|stamp|time_from_start))(?:_(s|ms|us|ns))?"
    r"|.*stamp[_./ ]secs?",
    re.IGNORECASE,
)
_NANO = re.compile("n(?:ano)?(?=secs?$)")
# Words for a commanded and for a measured signal; libfranka writes state.q_d[0] for the commanded.
_COMMANDED = _marker(
    "target|command(?:ed)?|cmd|desired|reference|setpoint|action", r"|(?<=q)_d(?=\[)"
)
_MEASURED = _marker(r"actual|measured|feedback|output|observation\.state|observation")
_OUTPUT = _marker("output")
_EPOCH_S = (978_307_200, 4_102_444_800)  # the years 2001 to 2100
PARTS = ("episode_index", "chunk_index")
"""Headings of columns by which a table was told apart."""
_LONG_STEP = 1.0  # a log's steps, s, are shorter: without a unit these may be milliseconds
_LARGEST_RAD = 4 * np.pi  # two turns
_SHOWN = 6  # columns in a note


def write(path: Path, samples: Samples, units: Sequence[str] = ()) -> None:
    """Write samples; in rad and m every number comes back to the last bit.

    Args:
        path: The file.
        samples: What is written.
        units: Of each joint: "deg", "rad", "m" or "mm"; by default the samples' own.
    """
    units = units or samples.joint_units or ["rad"] * len(samples.joint_names)
    sizes = [UNITS[unit] for unit in units]
    header = [TIME]
    columns = [samples.times[:, None]]
    for (rate, *_), field in zip(_RATES, _FIELDS, strict=True):
        table = getattr(samples, field)
        if table is not None:
            for name, unit in zip(samples.joint_names, units, strict=True):
                header.append(f"{name} [{unit}{rate}]")
            columns.append(table / sizes)
    values = np.hstack(columns)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file, lineterminator="\n")
        rows.writerow(header)
        rows.writerows(values.tolist())


def read(
    path: Path, unit: str | None = None, joint_units: Mapping[str, str] = MappingProxyType({})
) -> Samples:
    """Read samples, as `write` wrote them, or a log.

    Warns with `FileNote` of columns that are left out and of an offset of time.

    Args:
        path: The file.
        unit: Units of columns whose header says none, like "deg" or "deg,mm,ms".
        joint_units: "rad" or "m" by the names of the robot's joints, where known.

    Raises:
        InvalidInput: Names the file, the line, the column, the value, and what would be right.
    """
    text = files.text(path, "samples", "CSV")
    try:
        table = csv_file.parted(csv_file.table(text, commented=True))
        return of_table(table, path.name, asked(unit), joint_units)
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    except csv.Error as error:
        raise files.unreadable(path, "samples", "CSV", error) from None


@dataclass(frozen=True)
class _Column:
    """A column, and what its heading says.

    Attributes:
        index: The column's index, from 0.
        name: The heading without its unit.
        kind: `_TIME`, one of `_FIELDS`, or empty or `_ACTUAL` for a column that is not read.
        unit: Of the position or the time, or None.
    """

    index: int
    name: str
    kind: str
    unit: str | None

    @property
    def key(self) -> str:
        """The name without the word for its kind: the same in all columns of a joint."""
        if self.kind not in _FIELDS:
            return self.name
        ended = _ENDED.fullmatch(self.name)
        if ended and self.kind == "positions":
            return ended[1].strip("_./ ")  # the joint may be called q1
        return _PATTERNS[self.kind].sub("", self.name, count=1).strip("_./ ")

    @property
    def joint(self) -> str:
        """The joint's name, in a column of positions."""
        if self.unit:
            return self.name.removesuffix("_position").removesuffix("_pos")
        return self.key if re.search("[A-Za-z]", self.key) else self.name


def of_table(
    table: Table, name: str, wanted: Mapping[str, str], joint_units: Mapping[str, str]
) -> Samples:
    """Return the samples of a table of texts, as `read` does.

    Args:
        table: Headings and cells.
        name: The file's name, for notes.
        wanted: Units by "angle", "length" and "time", as `trajopt.core.units.asked` returns them.
        joint_units: "rad" or "m" by the names of the robot's joints, where known.

    Raises:
        InvalidInput: Names the line, the column, the value, and what would be right.
    """
    columns = _columns(table)
    try:
        time, joints = _chosen(columns)
        units = _units(joints, wanted, joint_units)
        if time.unit not in (None, wanted.get("time", time.unit)):
            raise contradicted(time.unit, wanted["time"])
    except InvalidInput as error:
        right = error.expected
        header = "" if table.cells else _header(columns, table, joint_units, wanted)
        if header:
            right += f"; {READABLE} of {name}: {header}"
        raise InvalidInput(error.key, right, value=error.value) from None

    clock = [time, *_nanoseconds(time, columns)]
    chosen = [*clock, *chain(*joints.values())]
    numbers = table.numbers([column.index for column in chosen])[:, len(clock) :]
    # Of times like 1.7e9 the difference keeps every digit.
    stamps = [*map(Decimal, table.columns[time.index])]
    for column in clock[1:]:
        parts = table.columns[column.index]
        stamps = [sec + Decimal(part).scaleb(-9) for sec, part in zip(stamps, parts, strict=True)]
    if len(stamps) < 2:
        raise InvalidInput("samples", "at least two lines of numbers", value=len(stamps))
    start = stamps[0]
    elapsed = np.array([float(stamp - start) for stamp in stamps])
    for row in np.flatnonzero(np.diff(elapsed) <= 0)[:1] + 1:
        right = "a time after that of the line before"
        raise InvalidInput(table.place(row, time.index), right, value=float(stamps[row]))
    unit = time.unit or wanted.get("time") or _time_unit(float(start), elapsed)
    first, second = (float(stamp) * TIMES[unit] for stamp in stamps[:2])
    if first < _EPOCH_S[0] <= second <= _EPOCH_S[1]:
        right = "a date, as the times of the lines after it"
        raise InvalidInput(table.place(0, time.index), right, value=float(start))
    notes = [f"times count from {start} {unit}"] if start else []
    others = (column for column in columns if column not in chosen)
    left_out = [column.name or f"column {column.index + 1}" for column in others]
    left_out = [heading for heading in left_out if heading not in PARTS]
    dropped = [column.name for column in columns if column.kind == _ACTUAL]
    if dropped:
        sent = all(_OUTPUT.search(heading) for heading in dropped)
        other = "what was sent to the hardware (output)" if sent else "what was measured"
        notes.append(f"what was commanded is read, not {other}")
    if left_out:
        more = ", …" if len(left_out) > _SHOWN else ""
        notes.append(f"left out: {', '.join(left_out[:_SHOWN])}{more}")
    if notes:
        warnings.warn(FileNote(f"{name}: {'; '.join(notes)}"), stacklevel=2)

    sizes = [UNITS[unit] for unit in chain(*units)]
    fields = np.hsplit(numbers * sizes, len(joints))
    texts = [table.columns[column.index] for column in chosen[len(clock) :]]
    half, decimals = digits.of_columns(texts, numbers)
    tables = dict(zip(joints, fields, strict=True))
    halves = dict(zip(joints, np.hsplit(half * sizes, len(joints)), strict=True))
    return Samples(
        joint_names=tuple(column.joint for column in joints["positions"]),
        times=elapsed * TIMES[unit],
        joint_units=tuple("m" if unit in LENGTHS else "rad" for unit in units[0]),
        half_digits=halves["positions"],
        velocity_half_digits=halves.get("velocities"),
        time_half_digit=_time_half_digit(stamps) * TIMES[unit],
        decimals=decimals[: len(units[0])],
        commanded=all(_sent(table, column) for column in joints["positions"]),
        positions=tables["positions"],
        velocities=tables.get("velocities"),
        accelerations=tables.get("accelerations"),
    )


def _sent(table: Table, column: _Column) -> bool:
    """Return whether a column's heading says that it was commanded."""
    name, _ = csv_file.heading(table.headings[column.index])
    return _COMMANDED.search(name) is not None


def _time_half_digit(stamps: Sequence[Decimal]) -> float:
    texts = [str(stamp) for stamp in stamps]
    last = max(map(digits.decimals, texts))
    elapsed = [int((stamp - stamps[0]).scaleb(last)) for stamp in stamps]
    return digits.time_half_digit(texts, np.array(stamps, dtype=float), elapsed)


def _nanoseconds(time: _Column, columns: Sequence[_Column]) -> list[_Column]:
    """The column of nanoseconds beside a ROS stamp's column of whole seconds, if it is there."""
    return [column for column in columns if column.name != time.name == _NANO.sub("", column.name)]


def _time_unit(start: float, elapsed: Array) -> str:
    """The unit of times whose heading says none."""
    step = float(np.median(np.diff(elapsed)))
    since = _unit_since_1970(start)
    if not since and step >= _LONG_STEP:
        right = f"a unit in the heading, like {TIME} or time [ms], or unit=deg,ms"
        raise InvalidInput("times", right, value=f"steps of {step:g}")
    return since or "s"


def _unit_since_1970(time: float) -> str:
    """The unit in which this is a date from 2001 to 2100; empty if there is none."""
    low, high = _EPOCH_S
    return next((unit for unit, size in TIMES.items() if low <= time * size <= high), "")


def _columns(table: Table) -> list[_Column]:
    """Read the headings; a bare name is a position where no other name says that it is."""
    found = [_column(index, cell) for index, cell in enumerate(table.headings)]
    if table.indexed:
        found[0] = replace(found[0], kind="")
    named = any(column.kind == "positions" and column.key != column.name for column in found)
    texts = table.texts()
    for column in found:
        if column.kind == _BARE:
            kind = "" if named or column.index in texts else "positions"
            found[column.index] = replace(column, kind=kind)
    return _commanded(found)


def _commanded(columns: list[_Column]) -> list[_Column]:
    """Keep what was commanded, if positions are there as commanded and as measured."""
    plain = {column.name: _COMMANDED.sub("", column.name, count=1) for column in columns}
    positions = [column.name for column in columns if column.kind == "positions"]
    measured = {_MEASURED.sub("", name, count=1) for name in positions}
    both = {plain[name] for name in positions if plain[name] != name} & measured
    if positions and all(plain[name] != name for name in positions):  # nothing was measured
        both = {plain[name] for name in positions}
    found = []
    for column in columns:
        name = plain[column.name]
        kept = name != column.name and (column.kind != "positions" or name in both)
        if both and column.kind in _FIELDS:
            column = replace(column, name=name) if kept else replace(column, kind=_ACTUAL)
        found.append(column)
    return found


FIELDS = {"positions": "position", "velocities": "velocity", "accelerations": "acceleration"}
"""The word for each field in a heading."""


def kind(name: str) -> str:
    """Return what a heading without a unit says: a key of `FIELDS`, "time", "bare" or empty."""
    return _column(0, name).kind


def source(name: str) -> str:
    """Return the start of a heading that says, as this one, what was commanded or measured."""
    if _COMMANDED.search(name):
        return "target_"
    return "actual_" if _MEASURED.search(name) else ""


def clock(name: str) -> str:
    """Return the heading of times, with the unit that a name has at its end."""
    time = _TIME_NAME.fullmatch(name)
    return f"time [{time[1]}]" if time and time[1] else "time"


def _column(index: int, cell: str) -> _Column:
    name, unit = csv_file.heading(cell)
    if unit in TIMES:
        return _Column(index, name, _TIME, unit)
    for field, rates in zip(_FIELDS, _RATES, strict=True):
        for rate in rates:
            length = (unit or "").removesuffix(rate)
            if name and length in UNITS and unit == length + rate:
                return _Column(index, name, field, length)
    time = _TIME_NAME.fullmatch(name)
    if unit or not name:
        return _Column(index, name, "", unit)
    if time:
        return _Column(index, name, _TIME, time[1])
    kinds = (kind for kind, pattern in _PATTERNS.items() if pattern.search(name))
    return _Column(index, name, next(kinds, _BARE), None)


def _chosen(columns: Sequence[_Column]) -> tuple[_Column, dict[str, list[_Column]]]:
    """The column of times, and the columns of each field that is there, joint by joint.

    Raises:
        InvalidInput: A column is missing, or is there twice.
    """
    times = [column for column in columns if column.kind == _TIME]
    names = _joints(columns)
    if not times:
        right = f"{TIME}, then columns like elbow [rad]; no column has times"
        raise InvalidInput("header", right)
    if not names:
        raise InvalidInput("header", "columns of positions, like elbow [rad]")
    chosen = {}
    for field, (rate, *_) in zip(_FIELDS, _RATES, strict=True):
        of_joint: dict[str, _Column] = {}
        for column in columns:
            if column.kind != field:
                continue
            joint = names.get(column.name, names.get(column.key))
            if joint is None and column.unit is None:
                continue  # a tool's speed, say
            joint = joint or column.key
            if joint in of_joint:
                right = "a column that is not there twice"
                raise InvalidInput("header", right, value=column.name)
            of_joint[joint] = column
        wanted = dict.fromkeys(names.values())
        odd = of_joint.keys() ^ wanted.keys()
        if of_joint and odd:
            right = f"a column [rad{rate}] for each joint that has positions, and no other"
            raise InvalidInput("header", f"{right}: {min(odd)}")
        if of_joint:
            chosen[field] = [of_joint[joint] for joint in wanted]
    return times[0], chosen


def _joints(columns: Sequence[_Column]) -> dict[str, str]:
    """The joints' names, by what columns may call them."""
    names: dict[str, str] = {}
    for column in columns:
        if column.kind == "positions":
            names |= dict.fromkeys((column.key, column.joint, column.name), column.joint)
    return names


def _units(
    joints: Mapping[str, Sequence[_Column]],
    wanted: Mapping[str, str],
    joint_units: Mapping[str, str],
) -> list[list[str]]:
    """The unit of each column, field by field.

    Raises:
        InvalidInput: Nothing says the unit of angles, or two units contradict each other.
    """
    said = {column.unit for column in chain(*joints.values())}
    known = dict(wanted)
    for kind, units in (("angle", ANGLES), ("length", LENGTHS)):
        stated = [unit for unit in units if unit in said]
        if len(stated) == 1:
            known.setdefault(kind, stated[0])
    positions = joints["positions"]
    names = known_as([column.joint for column in positions], list(joint_units))
    slides = []
    for column, name in zip(positions, names, strict=True):
        slides.append((column.unit or joint_units.get(name)) in LENGTHS)
    found = []
    for columns in joints.values():
        for column, position, slide in zip(columns, positions, slides, strict=True):
            if column.unit and (column.unit in LENGTHS) != slide:
                right = f"a unit that goes with that of {position.name}"
                raise InvalidInput("header", right, value=f"{column.name} [{column.unit}]")
        row = []
        completed_units = completed([column.unit for column in columns], slides, known)
        for unit, slide in zip(completed_units, slides, strict=True):
            if unit is None and not slide:
                raise InvalidInput("header", "the unit of angles: unit=deg or unit=rad")
            row.append(unit or "m")
        found.append(row)
    return found


def _header(
    columns: Sequence[_Column],
    table: Table,
    joint_units: Mapping[str, str],
    wanted: Mapping[str, str],
) -> str:
    """A header that is read, made of this one; empty where no other names make it a motion.

    What the header says stays: units, and names that are joints. Where it says no unit, it is the
    one that was asked for (`wanted`).
    """
    known = list(joint_units)
    rates = dict(zip(_FIELDS, _RATES, strict=True))
    times = [column for column in columns if column.kind == _TIME]
    first = known_as([column.joint for column in columns], known)[0]
    only_joints = any(table.headings) and (len(columns) <= len(known) or first in known)
    if not times and (only_joints or not _rises(table)):
        return ""  # nothing has times
    clock = times[0] if times else columns[0]
    read = list(columns)
    read[clock.index] = replace(clock, kind=_TIME)
    angle = wanted.get("angle") or _likely_unit(read, table)

    def unit_of(joint: str) -> str:
        slides = joint_units.get(joint) == "m"
        return wanted.get("length", "m") if slides else angle

    positions = [column.joint for column in read if column.kind == "positions"]
    if len(set(positions)) < len(positions):
        return ""  # renaming is to invent a name
    names = _joints(read)
    joints = list(dict.fromkeys(names.values())) or [f"joint_{column.index}" for column in read[1:]]
    robots = dict(zip(joints, known_as(joints, known), strict=True))
    # further columns are no joints of the robot
    whole = bool(known) and set(known) < set(robots.values())
    cells = []
    for column in read:
        name = names.get(column.name, names.get(column.key, column.name))
        if name and column.kind in ("", _ACTUAL):
            name += " [-]"  # an unknown unit: it is left out
        elif column.kind in rates and name in robots:
            unit = f"{column.unit or unit_of(robots[name])}{rates[column.kind][0]}"
            left_out = whole and robots[name] not in known
            name = f"{robots[name]} [{'-' if left_out else unit}]"
        cells.append(name)
    if not names:
        cells[1:] = [f"{name} [{unit_of(name)}]" for name in robots.values()]
    if "time" in wanted and not clock.unit:
        cells[clock.index] = f"time [{wanted['time']}]"
    elif clock.unit:
        cells[clock.index] = f"time [{clock.unit}]"
    elif not _nanoseconds(clock, columns):
        cells[clock.index] = _heading_of_times(table.numbers([clock.index])[:, 0])
    return ",".join(cells)


def _likely_unit(columns: Sequence[_Column], table: Table) -> str:
    """Return "deg" where nobody says a unit and positions are larger than an arm's radians."""
    places = [column.index for column in columns if column.kind == "positions" and not column.unit]
    if not places:
        places = [column.index for column in columns if column.kind != _TIME]
    try:
        largest = np.abs(table.numbers(places)).max(initial=0.0) if places else 0.0
    except InvalidInput:  # texts
        return "rad"
    return "deg" if largest > _LARGEST_RAD else "rad"


def _rises(table: Table) -> bool:
    """Return whether the first column rises, as times do."""
    first = table.numbers([0])[:, 0]
    return bool((np.diff(first) > 0).all())


def _heading_of_times(times: Array) -> str:
    """A heading with the largest unit in which these are times since 1970, or a log's steps."""
    if len(times) < 2:
        return TIME
    step = np.median(np.diff(times))
    short = next((unit for unit, size in TIMES.items() if step * size < _LONG_STEP), "ns")
    return f"time [{_unit_since_1970(times[0]) or short}]"
