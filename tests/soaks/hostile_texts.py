"""Text files that a stranger crafted, or an accident changed, of every format that is read.

`mutated` changes a file that is shipped (a bit, a span, a block, a line, a number, a key);
`crafted` makes one that no reader may take. `nonsense` says, by parsers that are not this project's
own, what was wrong with a file that was taken all the same.
"""

from __future__ import annotations

import csv
import io
import json
import re
import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, TypeVar
from xml.etree import ElementTree

import numpy as np
import yaml

from soaks import soak_report
from trajopt.benchmark.best_known import records
from trajopt.benchmark.store.proofs import proved
from trajopt.benchmark.suites import literature
from trajopt.core import built_in
from trajopt.formats import arms, joint_trajectory
from trajopt.planners.kinematics import Robot

Rng = np.random.Generator
T = TypeVar("T")
Command = list[str] | Callable[[], object]

EXAMPLES = built_in.data_folder().parent / "docs" / "examples"
_MOTIONS = EXAMPLES / "motions"
_LIMITS = _MOTIONS / "joint_limits.yaml"
FILE = "FILE"
_PLAN = ("plan", "--planner", "ruckig-stop", "--json", FILE)
_WAYPOINTS = "shoulder [deg],elbow [deg]\n0,0\n40,-25\n90,30\n"
# Files beside a URDF: waypoints and limits of three of its joints.
_ROWS = "waypoints.csv"
_ACCELERATION = "acceleration.yaml"
_BESIDE = {
    _ROWS: "shoulder_pan_joint,elbow_joint,wrist_3_joint\n0,0,0\n1,-1,2\n",
    _ACCELERATION: """joint_limits:
  shoulder_pan_joint: {max_acceleration: 5.0}
  elbow_joint: {max_acceleration: 5.0}
  wrist_3_joint: {max_acceleration: 5.0}
""",
}

_DECIMAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d{1,4})?", re.ASCII)
_OCTAL = re.compile(r"[+-]?0\d+", re.ASCII)
_NUMBER = re.compile(r"(?<![\w.])[+-]?\d+(\.\d+)?([eE][+-]?\d+)?")
_NUMERIC_KEYS = re.compile(r"max_.*|min_.*|sec|nanosec|positions|velocities|accelerations")
LONG = 60_000  # digits
LONGEST_SPAN = 200  # bytes
LONGEST_BLOCK = 4096  # bytes
MAX_BYTES = 40_000_000  # largest crafted file
TEXTS = tomllib.loads((soak_report.DATA / "hostile_texts.toml").read_text(encoding="utf-8"))
ODD_NUMBERS: list[str] = [*TEXTS["odd_numbers"], "9" * LONG, "0x" + "f" * LONG]
JUNK: list[str] = [*TEXTS["junk"], "[" * LONG]


@dataclass(frozen=True)
class Format:
    """A kind of file.

    Attributes:
        ending: Of its name.
        shipped: Files of this kind, as they should be.
        reader: A function of a file, or a command in which `FILE` stands for it.
    """

    ending: str
    shipped: tuple[bytes, ...]
    reader: Callable[[Path], object] | Sequence[str | Path]

    def command(self, path: Path) -> Command:
        """Return what reads a file of this kind."""
        if callable(self.reader):
            return partial(self.reader, path)
        for name, content in _BESIDE.items():
            path.with_name(name).write_text(content)
        given = {FILE: str(path)} | {name: str(path.with_name(name)) for name in _BESIDE}
        return [given.get(word, word) for word in map(str, self.reader)]


@cache
def formats() -> dict[str, Format]:
    """Return every format by name."""
    data = built_in.data_folder()
    sent = joint_trajectory.read(_MOTIONS / "sent.yaml")
    message = joint_trajectory.to_message(sent)
    polynomials = {
        "joint_names": ["shoulder", "elbow"],
        "breaks": [0, 1, 2],
        "coefficients": [[[0.5, 1], [-0.5, -1]], [[0, 0], [1, 2]], [[0, 0], [0.5, 1]]],
    }
    array = io.BytesIO()
    np.save(array, np.array([[0.0, 0.0, 0.0, 0.0, 0.0], [1.0, 0.5, -1.0, 1.0, 2.0]]))
    rows = {"waypoints": [[0, 0], [40, -25]], "joint_names": ["shoulder", "elbow"], "unit": "deg"}
    verified = ("verify", FILE, "--limits", _LIMITS)
    passed = (*_PLAN, "--limits", _LIMITS)
    return {
        "problem": Format(".toml", _files(data, "problems/*.toml"), _PLAN),
        "publication": Format(".toml", _files(data, "literature/*.toml"), literature.published),
        "arm": Format(".toml", _files(data, "robots/*.toml"), _arm),
        "kinematics": Format(".toml", _files(data, "kinematics/*.toml"), Robot.from_toml),
        "joint limits": Format(
            ".yaml",
            _files(_MOTIONS, "joint_limits.yaml"),
            ("verify", _MOTIONS / "spline.csv", "--limits", FILE),
        ),
        "message, YAML": Format(".yaml", _files(_MOTIONS, "sent.yaml"), verified),
        "message, JSON": Format(".json", _json(message), verified),
        "samples, CSV": Format(".csv", _files(_MOTIONS, "spline.csv"), verified),
        "polynomials": Format(".json", _json(polynomials), verified),
        "record": Format(".json", _files(records.folder(), "edges-*.json"), _recorded),
        "waypoints, CSV": Format(".csv", (_WAYPOINTS.encode(),), passed),
        "waypoints, JSON": Format(".json", _json(rows), passed),
        "waypoints, npy": Format(".npy", (array.getvalue(),), (*_PLAN, "--robot", "crs-a255")),
        "URDF": Format(
            ".urdf",
            _files(EXAMPLES, "ur5e/*.urdf"),
            (*_PLAN[:-1], _ROWS, "--urdf", FILE, "--limits", _ACCELERATION),
        ),
    }


def _json(value: Any) -> tuple[bytes]:
    return (json.dumps(value).encode(),)


def _files(folder: Path, pattern: str) -> tuple[bytes, ...]:
    return tuple(file.read_bytes() for file in sorted(folder.glob(pattern)))


def _arm(path: Path) -> object:
    return arms.named(str(path))


def _recorded(path: Path) -> object:
    return proved(records.read(path).trial)


# --- what an accident does ---


def mutated(kind: Format, rng: Rng) -> bytes:
    """Return a shipped file with one or two changes."""
    return changed(drawn(kind.shipped, rng), rng)


def changed(content: bytes, rng: Rng) -> bytes:
    """Return a file's content after one or two changes."""
    for _ in range(1 + int(rng.random() < 0.2)):
        change = drawn(_CHANGES, rng)
        content = change(content, rng) or b" "
    return content


def _bit(content: bytes, rng: Rng) -> bytes:
    changed = bytearray(content)
    changed[int(rng.integers(len(content)))] ^= 1 << int(rng.integers(8))
    return bytes(changed)


def _cut(content: bytes, rng: Rng) -> bytes:
    return content[: int(rng.integers(len(content)))]


def _span(content: bytes, rng: Rng) -> bytes:
    """Remove, repeat or move a span."""
    start, end, other = np.sort(rng.integers(len(content) + 1, size=3)).tolist()
    end = min(end, start + LONGEST_SPAN)
    span = content[start:end]
    removed = content[:start] + content[end:]
    return [
        removed,
        removed[:other] + span + removed[other:],
        content[:end] + span + content[end:],
    ][int(rng.integers(3))]


def _block(content: bytes, rng: Rng) -> bytes:
    """Overwrite a block by zeros or by noise."""
    start, end = np.sort(rng.integers(len(content) + 1, size=2)).tolist()
    end = min(end, start + LONGEST_BLOCK)
    written = [bytes(end - start), rng.bytes(end - start)]
    return content[:start] + written[int(rng.integers(2))] + content[end:]


def _line(content: bytes, rng: Rng) -> bytes:
    """Repeat a line."""
    lines = content.splitlines(keepends=True)
    place = int(rng.integers(len(lines))) if lines else 0
    return b"".join([*lines[: place + 1], *lines[place:]])


def _junk(content: bytes, rng: Rng) -> bytes:
    place = int(rng.integers(len(content) + 1))
    junk = drawn(JUNK, rng)
    return content[:place] + _bytes(junk) + content[place:]


def _number(content: bytes, rng: Rng) -> bytes:
    text = content.decode("utf-8", "surrogateescape")
    found = list(_NUMBER.finditer(text))
    if not found:
        return content
    match = drawn(found, rng)
    odd: str = drawn(ODD_NUMBERS, rng)
    changed: str = text[: match.start()] + odd + text[match.end() :]
    return changed.encode("utf-8", "surrogateescape")


def _key(content: bytes, rng: Rng) -> bytes:
    """Exchange two letters of a word."""
    words = list(re.finditer(rb"[a-z_]{4,}", content))
    if not words:
        return content
    match = drawn(words, rng)
    place = match.start() + int(rng.integers(1, len(match[0]) - 1))
    changed = bytearray(content)
    changed[place : place + 2] = changed[place : place + 2][::-1]
    return bytes(changed)


_CHANGES = (_bit, _cut, _span, _block, _line, _junk, _number, _number, _key, _key)


# --- what a stranger crafts ---


def crafted(ending: str, rng: Rng) -> bytes:
    """Return a crafted file that every reader has to refuse."""
    size = int(10 ** rng.uniform(3, 7.3))
    match int(rng.integers(4)):
        case 0:
            return _repeated(drawn(TEXTS["anywhere"], rng), size)
        case 1:
            return rng.bytes(size)
        case 2:
            begin, repeated, end = drawn(TEXTS["placed"][ending], rng)
            middle = _repeated(repeated, size)
            return _bytes(begin) + middle + _bytes(end)
        case _:
            whole: str = drawn(TEXTS["whole"][ending], rng)
            return _bytes(whole)


def drawn(values: Sequence[T], rng: Rng) -> T:
    """Return one of some values."""
    return values[int(rng.integers(len(values)))]


def _bytes(text: str) -> bytes:
    return text.encode("latin-1")


def _repeated(text: str, times: int) -> bytes:
    return _bytes(text) * min(times, MAX_BYTES // max(1, len(text)))


# --- what a reader may not take ---


def nonsense(kind: Format, content: bytes) -> str:
    """Return why an accepted file should have been refused; empty if there is no known reason."""
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
