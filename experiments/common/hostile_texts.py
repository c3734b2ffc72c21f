"""Text files that a stranger crafted, or an accident changed, of every format that is read.

`mutated` changes a file that is shipped (a bit, a span, a line, a number, a key); `crafted` makes
one that no reader may take. `nonsense` says, by parsers that are not this project's own, what was
wrong with a file that was taken all the same.
"""

from __future__ import annotations

import csv
import io
import json
import re
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import yaml

from trajopt import built_in
from trajopt.benchmark.best_known import record, records
from trajopt.benchmark.suites import literature
from trajopt.formats import arms, joint_trajectory
from trajopt.formats.motion import motion
from trajopt.kinematics import Robot

Rng = np.random.Generator
Command = list[str] | Callable[[], object]

EXAMPLES = built_in.data_folder().parent / "docs" / "examples"
_MOTIONS = EXAMPLES / "motions"
_LIMITS = _MOTIONS / "joint_limits.yaml"
_PLAN = ("plan", "--planner", "ruckig-stop", "--json")
_WAYPOINTS = "shoulder [deg],elbow [deg]\n0,0\n40,-25\n90,30\n"
_RECORD_BYTES = 20_000  # of the records that are mutated

_DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
_OCTAL = re.compile(r"[+-]?0\d+", re.ASCII)
_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(\.\d+)?([eE][+-]?\d+)?")
_NUMERIC_KEYS = re.compile(r"max_.*|min_.*|sec|nanosec|positions|velocities|accelerations")
ODD_NUMBERS = (
    "1_0", "١", "1:30", "010", "0x1F", "nan", "inf", "1e999", "1e-99999999999999999999", "--1",
    "true", '"1"', "1,5", "", "9" * 60_000, "0x" + "f" * 5000, "18446744073709551616", "-1",
    "1e308", "5e-324", "null", "[1]", "{}", "1.5.2", "1 2", "½",
)  # fmt: skip
JUNK = (
    b"\0",
    b"\xff\xfe",
    b"\x1b[31m",
    b"\n",
    b"\r",
    b"[" * 5000,
    b"{",
    b"&a *a",
    b"- ",
    b'"',
    b"<",
)


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes:
        ending: Of its name.
        shipped: Files of this kind, as they should be.
        command: What reads a file.
    """

    ending: str
    shipped: tuple[bytes, ...]
    command: Callable[[Path], Command]


@cache
def formats() -> dict[str, Format]:
    """Every format by name."""
    data = built_in.data_folder()
    message = json.dumps(joint_trajectory.to_message(joint_trajectory.read(_MOTIONS / "sent.yaml")))
    small = [file for file in _files(records.folder(), "*.json") if len(file) < _RECORD_BYTES]
    polynomials = {
        "joint_names": ["shoulder", "elbow"],
        "breaks": [0, 1, 2],
        "coefficients": [[[0.5, 1], [-0.5, -1]], [[0, 0], [1, 2]], [[0, 0], [0.5, 1]]],
    }
    array = io.BytesIO()
    np.save(array, np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 0.5, -1.0, 1.0, 2.0]]))
    rows = {"waypoints": [[0, 0], [40, -25]], "joint_names": ["shoulder", "elbow"], "unit": "deg"}
    return {
        "problem": Format(".toml", _files(data, "problems/*.toml"), _planned),
        "publication": Format(".toml", _files(data, "literature/*.toml"), _published),
        "arm": Format(".toml", _files(data, "robots/*.toml"), _arm),
        "kinematics": Format(".toml", _files(data, "kinematics/*.toml"), _kinematics),
        "joint limits": Format(".yaml", (_LIMITS.read_bytes(),), _limiting),
        "message, YAML": Format(".yaml", _files(_MOTIONS, "sent.yaml"), _verified),
        "message, JSON": Format(".json", (message.encode(),), _verified),
        "samples, CSV": Format(".csv", _files(_MOTIONS, "spline.csv"), _verified),
        "polynomials": Format(".json", (json.dumps(polynomials).encode(),), _verified),
        "record": Format(".json", tuple(small), _recorded),
        "waypoints, CSV": Format(".csv", (_WAYPOINTS.encode(),), _passed),
        "waypoints, JSON": Format(".json", (json.dumps(rows).encode(),), _passed),
        "waypoints, npy": Format(".npy", (array.getvalue(),), _array),
        "URDF": Format(".urdf", _files(EXAMPLES, "ur5e/*.urdf"), _described),
    }


def _files(folder: Path, pattern: str) -> tuple[bytes, ...]:
    return tuple(file.read_bytes() for file in sorted(folder.glob(pattern)))


def _planned(path: Path) -> Command:
    return [*_PLAN, str(path)]


def _published(path: Path) -> Command:
    return lambda: literature.published(path)


def _arm(path: Path) -> Command:
    return lambda: arms.named(str(path))


def _kinematics(path: Path) -> Command:
    return lambda: Robot.from_toml(path)


def _limiting(path: Path) -> Command:
    return ["verify", str(_MOTIONS / "spline.csv"), "--limits", str(path)]


def _verified(path: Path) -> Command:
    return ["verify", str(path), "--limits", str(_LIMITS)]


def _recorded(path: Path) -> Command:
    return lambda: (record.read(path), motion(path))


def _passed(path: Path) -> Command:
    return [*_PLAN, str(path), "--limits", str(_LIMITS)]


def _array(path: Path) -> Command:
    return [*_PLAN, str(path), "--robot", "crs-a255"]


def _described(path: Path) -> Command:
    rows = path.with_name("waypoints.csv")
    names = [f"{name}_joint" for name in ("shoulder_pan", "elbow", "wrist_3")]
    limits = path.with_name("acceleration.yaml")
    rows.write_text(f"{','.join(names)}\n0,0,0\n1,-1,2\n")
    table = {name: {"max_acceleration": 5.0} for name in names}
    limits.write_text(json.dumps({"joint_limits": table}))
    return [*_PLAN, str(rows), "--urdf", str(path), "--limits", str(limits)]


# --- what an accident does ---


def mutated(kind: Format, rng: Rng) -> bytes:
    """A shipped file with one to three changes."""
    content = kind.shipped[int(rng.integers(len(kind.shipped)))]
    for _ in range(int(rng.integers(1, 4))):
        change = _CHANGES[int(rng.integers(len(_CHANGES)))]
        content = change(content, rng) or b" "
    return content


def _bit(content: bytes, rng: Rng) -> bytes:
    changed = bytearray(content)
    changed[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _cut(content: bytes, rng: Rng) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _span(content: bytes, rng: Rng) -> bytes:
    """A span is removed, repeated or moved."""
    start, end, other = np.sort(rng.integers(len(content) + 1, size=3)).tolist()
    end = min(end, start + 200)
    span = content[start:end]
    removed = content[:start] + content[end:]
    return [
        removed,
        removed[:other] + span + removed[other:],
        content[:end] + span + content[end:],
    ][int(rng.integers(3))]


def _line(content: bytes, rng: Rng) -> bytes:
    """A line is there twice."""
    lines = content.splitlines(keepends=True)
    place = int(rng.integers(len(lines))) if lines else 0
    return b"".join([*lines[: place + 1], *lines[place:]])


def _junk(content: bytes, rng: Rng) -> bytes:
    place = int(rng.integers(len(content) + 1))
    return content[:place] + JUNK[int(rng.integers(len(JUNK)))] + content[place:]


def _number(content: bytes, rng: Rng) -> bytes:
    text = content.decode("utf-8", "surrogateescape")
    found = list(_NUMBER.finditer(text))
    if not found:
        return content
    match = found[int(rng.integers(len(found)))]
    odd = ODD_NUMBERS[int(rng.integers(len(ODD_NUMBERS)))]
    changed = text[: match.start()] + odd + text[match.end() :]
    return changed.encode("utf-8", "surrogateescape")


def _key(content: bytes, rng: Rng) -> bytes:
    """Two letters of a word change places."""
    words = list(re.finditer(rb"[a-z_]{4,}", content))
    if not words:
        return content
    match = words[int(rng.integers(len(words)))]
    place = match.start() + int(rng.integers(1, len(match[0]) - 1))
    changed = bytearray(content)
    changed[place : place + 2] = changed[place : place + 2][::-1]
    return bytes(changed)


_CHANGES = (_bit, _cut, _span, _line, _junk, _number, _number, _key, _key)


# --- what a stranger crafts ---

_BOMB = "a0: &a0 {k: 1}\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 12)
)


def crafted(ending: str, rng: Rng) -> bytes:
    """A file that no reader may take."""
    size = int(10 ** rng.uniform(3, 7.3))
    made = [
        b"",
        b"\0" * size,
        rng.bytes(size),
        b"\xff\xfe" + "a: 1\n".encode("utf-16-le") * 100,
        b"1" * size,
        b"1," * size,
        b"1\n" * size,
        b" " * size,
        b"[" * size,
        b"[]," * size,
        b"a." * size,
        b"a . " * size,
        b"\x1b]0;title\x07" * 10,
        f"{'k' * size} = 1".encode(),
        *_OWN[ending](size),
    ]
    return made[int(rng.integers(len(made)))]


def _toml(size: int) -> Iterator[bytes]:
    deep = min(size, 100_000)
    yield f"waypoints = {'[' * deep}{']' * deep}".encode()
    yield f"waypoints = {'{a=' * deep}1{'}' * deep}".encode()
    yield f"waypoints = [[0x{'f' * size}]]".encode()
    yield f"{' . '.join(['a'] * deep)} = 1".encode()
    yield b"".join(b"[a%d]\n" % n for n in range(deep))
    yield b"name = 3\nwaypoints = [[0], [1]]"


def _yaml(size: int) -> Iterator[bytes]:
    deep = min(size, 100_000)
    yield _BOMB.encode() + b"joint_limits: *a11\npoints: *a11\n"
    yield b"a: &a {b: 1}\njoint_limits: {<<: *a}\n"
    yield b"- " * deep + b"1"
    yield b"? " * deep + b"1"
    yield b"joint_limits: {[1, 2]: 3}"
    yield f"joint_limits: {{a: {{max_velocity: {'1' * size}x}}}}".encode()
    yield f"joint_limits: {{shoulder: {{max_velocity: 1:30}}, {'k' * 300}: {{}}}}".encode()
    yield b"joint_limits: !!python/object/apply:os.getcwd []"
    yield b"joint_limits: {shoulder: {max_velocity: 1, max_velocity: 2}}"


def _json(size: int) -> Iterator[bytes]:
    deep = min(size, 100_000)
    points = '{"positions": [0], "time_from_start": {"sec": 1, "nanosec": 5000000000}}'
    yield f'{{"joint_names": ["shoulder"], "points": [{points}, {points}]}}'.encode()
    yield f'{{"breaks": [0, 1], "coefficients": [{",".join(["[[1]]"] * deep)}]}}'.encode()
    yield b'{"breaks": [0, 1' + b"0" * 350 + b'], "coefficients": [[[1]]]}'
    yield b'{"breaks": [0, 1], "coefficients": [[[1]]], "joint_names": 3}'
    yield b'{"breaks": [0, 1], "coefficients": [[[1, 2]]], "unit": "deg"}'
    yield b'{"a":' * deep
    yield b"[" + b'{"a":0},' * size + b"0]"
    row = ",".join(["[0.5, 1]"] * deep)
    own = f'{{"waypoint_times": [0, 1], "joints": [[[0, 1], {row}]]}}'
    yield f'{{"trajectory": {own}}}'.encode()
    yield b'{"waypoints": [[0, 0], [1, 1]], "waypoints": [[0, 0], [2, 2]]}'


def _csv(size: int) -> Iterator[bytes]:
    head = b"time [s],shoulder [deg],elbow [deg]\n"
    yield head + b"0,0,0\n1e-9999999999999999999999,1,1\n"
    yield head + b"0,0,0\n1," + b"1" * size + b"x,1\n"
    yield head + b'0,0,0\n1,"' + b"1\n" * size
    yield b"time [s],shoulder [mm],shoulder [deg/s]\n0,0,0\n1,1,1\n"
    yield b"shoulder [deg],elbow [deg]\n" + b"0 " * size
    yield b"time [s],shoulder [deg],shoulder [deg]\n0,0,0\n1,1,1\n"


def _npy(size: int) -> Iterator[bytes]:
    for kind, shape in (("<f8", "(1000000000000, 2)"), ("<c16", "(2, 2)"), ("|O", "(2, 2)")):
        yield _npy_file(f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}")
    yield _npy_file("{'descr': '<f8', 'fortran_order': False, 'shape': (2L, 2L), }")
    yield _npy_file("(" * 5000)
    yield _npy_file(f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({'9' * 5000},)}}")
    yield b"PK\3\4" + b"\0" * 100


def _npy_file(header: str) -> bytes:
    text = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + bytes(64)


def _urdf(size: int) -> Iterator[bytes]:
    deep = min(size, 200_000)
    entities = "".join(
        f'<!ENTITY e{n} "{f"&e{n - 1};" * 10}">' for n in range(1, 12)
    )  # a billion laughs
    yield f'<!DOCTYPE r [<!ENTITY e0 "ha">{entities}]><robot name="&e11;"/>'.encode()
    yield b"<sdf><model/></sdf>"
    yield b"<robot>" + b"<a>" * deep
    yield b"<robot>" + b"<a>" * deep + b"</a>" * deep + b"</robot>"
    yield b"<robot>" + b"<joint/>" * deep + b"</robot>"
    joint = '<joint name="shoulder_pan_joint" type="revolute"><limit velocity="{}"/></joint>'
    yield f"<robot>{joint.format('1_0')}</robot>".encode()
    yield f"<robot>{joint.format('1' * size + 'x')}</robot>".encode()


_OWN = {
    ".toml": _toml,
    ".yaml": _yaml,
    ".json": _json,
    ".csv": _csv,
    ".npy": _npy,
    ".urdf": _urdf,
}


# --- what a reader may not take ---


def nonsense(kind: Format, content: bytes) -> str:
    """Why a file that was taken should have been refused; empty where nothing is known."""
    if kind.ending == ".npy":
        return ""
    text = content.decode("utf-8-sig")
    keys, numbers = _READ[kind.ending](text)
    known: set[str] = set()
    for shipped in kind.shipped:
        own, _ = _READ[kind.ending](shipped.decode("utf-8-sig"))
        known |= set(own)
    unknown = sorted(set(keys) - known - _OPTIONAL)
    if unknown:
        return f"took the unknown keys {unknown}"
    odd = [number for number in numbers if not _DECIMAL.fullmatch(number)]
    if kind.ending == ".yaml":
        odd += [number for number in numbers if _OCTAL.fullmatch(number)]
    return f"took the numbers {odd}" if odd else ""


_OPTIONAL = {"robot", "rule", "address", "checked", "position", "jerk", "angle_unit", "units"}

Found = tuple[list[str], list[str]]  # keys, and what stands where a number should


def _of_tables(table: Any, key: str = "") -> Found:
    keys: list[str] = []
    numbers: list[str] = []
    if isinstance(table, dict):
        for name, value in table.items():
            own_keys, own_numbers = _of_tables(value, name)
            keys += [name, *own_keys]
            numbers += own_numbers
    elif isinstance(table, list):
        for value in table:
            own_keys, own_numbers = _of_tables(value, key)
            keys += own_keys
            numbers += own_numbers
    elif isinstance(table, str) and _NUMERIC_KEYS.fullmatch(key):
        numbers.append(table)
    return keys, numbers


def _of_yaml(text: str) -> Found:
    return _of_tables(list(yaml.load_all(text, yaml.BaseLoader)))


def _of_json(text: str) -> Found:
    twice: list[str] = []

    def once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        names = [name for name, _ in pairs]
        twice.extend(f"{name}, twice" for name in names if names.count(name) > 1)
        return dict(pairs)

    keys, numbers = _of_tables(json.loads(text, object_pairs_hook=once))
    return [*keys, *twice], numbers


def _of_toml(text: str) -> Found:
    return _of_tables(tomllib.loads(text))


def _of_csv(text: str) -> Found:
    rows = [row for row in csv.reader(text.splitlines()) if any(row) and row[0][:1] != "#"]
    cells = [cell.strip() for row in rows[1:] for cell in row]
    return [], [cell for cell in cells if cell]


def _of_urdf(text: str) -> Found:
    root = ElementTree.fromstring(text)
    limits = root.findall("joint/limit")
    return [root.tag], [limit.get("velocity", "0") for limit in limits]


_READ: dict[str, Callable[[str], Found]] = {
    ".toml": _of_toml,
    ".yaml": _of_yaml,
    ".json": _of_json,
    ".csv": _of_csv,
    ".urdf": _of_urdf,
}
