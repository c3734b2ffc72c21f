"""Results files that a stranger crafted, or that a disk corrupted.

Crafted: one thing in a trial's text or in the dataset of texts in a `results.h5` is made what it
should not be (another type, shape, text, number, link, filter, size), and it is sealed again, as a
forger would. Corrupted: bits, blocks or the end of a `results.h5` are changed, and nothing else.
`verify`, `export` and `report` then read it. Needs Linux.
"""

from __future__ import annotations

import json
import re
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd

from soaks import said
from soaks.hostile_texts import changed, drawn
from soaks.said import ESCAPES
from trajopt.benchmark.store.folder import DamagedFile, Store
from trajopt.benchmark.store.results_file import seal as seal_of
from trajopt.benchmark.store.trial_text import seal, sealed
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import named

Rng = np.random.Generator
TextCraft = Callable[[bytes, Rng], bytes]
FileCraft = Callable[[h5py.File, Rng, Path], None]
Craft = Any  # one of the two

SECRET = "what-only-this-machine-knows"
ODD_VALUES: tuple[Any, ...] = (
    None,
    True,
    -1,
    0.5,
    1e308,
    10**30,
    [],
    {},
    "",
    "text",
    [1, "a"],
    {"a": None},
    {"$float": "inf"},
    {"$float": "text"},
    {"$array": [1, 2], "dtype": "O"},
    {"$array": ["a"], "dtype": "S999999999"},
    {"$array": [[1], 2], "dtype": "<f8"},
    {"$array": ["a"], "dtype": "<U999999999"},
    float("nan"),
    "\ud800",
    *ESCAPES,
)
PLANNERS = ("pso:iterations=20,population=5", "unoptimised", "ruckig-stop", "toppra")


def template(folder: Path) -> Path:
    """Make a results folder of four planners on one problem."""
    store = Store(folder)
    problem = catalogue.load("one-joint")
    for spec in PLANNERS:
        name, planner = named(spec)
        store.write(trials_of(planner, problem, [0], name)[0])
    return store.consolidate().parent


# --- what a forger does to a trial's text ---


def odd_text(text: bytes, rng: Rng) -> bytes:
    """Change a text as an accident does, and seal it again."""
    return resealed(changed(text, rng))


def resealed(text: bytes) -> bytes:
    """Return a text whose lines after the checksum were changed, sealed again."""
    *_, body = text.split(b"\n", 3)
    return seal(body)


def odd_json(text: bytes, rng: Rng) -> bytes:
    """Replace one value of the text by another one."""
    table = _mutated(_table(text), rng)
    try:
        return sealed(table if isinstance(table, dict) else {"id": table})
    except ValueError:  # not a number, or half a surrogate pair: no text has it
        return odd_text(text, rng)


def _table(text: bytes) -> dict[str, Any]:
    table: dict[str, Any] = json.loads(text)
    del table["schema"], table["sha256"]
    return table


def _mutated(value: Any, rng: Rng) -> Any:
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = str(rng.choice(list(value)))
        if rng.random() < 0.1:
            return {other: own for other, own in value.items() if other != key}
        return value | {key: _mutated(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.7:
        place = int(rng.integers(len(value)))
        changed = [*value]
        changed[place] = _mutated(value[place], rng)
        return changed
    return drawn(ODD_VALUES, rng)


def deep(text: bytes, rng: Rng) -> bytes:
    """Nest options deeper than a parser's stack."""
    depth = int(rng.choice([50, 900, 100_000]))
    options = b"[" * depth + b"]" * depth
    changed = re.sub(rb'"options": .*', b'"options": {"x": ' + options + b"},", text)
    return resealed(changed)


def high_degree(text: bytes, rng: Rng) -> bytes:
    """Add a polynomial of degree 20,000, whose roots would take gigabytes."""
    table = _table(text)
    ends = [0.0, 1.0]
    rows = [[[1.0]]] * 20_001
    table["solution"]["trajectory"] = {"breaks": ends, "coefficients": rows, "waypoint_times": ends}
    return sealed(table)


def odd_schema(text: bytes, rng: Rng) -> bytes:
    values = [b'"3"', b"4", b'"trajopt-3"', b'"trajopt-99999999999"', b'"\x1b[31m"', b"[4]"]
    return text.replace(b'"trajopt-4"', drawn(values, rng), 1)


# --- what a forger does to `results.h5` ---


def _replaced(file: h5py.File, **what: Any) -> None:
    del file["texts"]
    file.create_dataset("texts", **what)


def another_type(file: h5py.File, rng: Rng, secret: Path) -> None:
    ragged = np.empty(4, dtype=h5py.vlen_dtype(int))
    ragged[:] = [np.arange(2)] * 4
    values = [
        np.arange(4),
        np.arange(4.0),
        np.array([b"a", b"b", b"c", b"d"]),
        np.array(["a", "b", "c", "d"], dtype=h5py.string_dtype()),
        np.zeros(4, dtype=[("a", float), ("b", "S3")]),
        np.zeros(4, dtype=complex),
        np.zeros(4, dtype=bool),
        ragged,
        np.array([file.ref] * 4, dtype=h5py.ref_dtype),
        np.zeros(4, dtype="V5"),
    ]
    _replaced(file, data=drawn(values, rng))


def another_shape(file: h5py.File, rng: Rng, secret: Path) -> None:
    values = file["texts"][()]
    changed = [values[:0], values[None], np.concatenate([values, values]), values[0]]
    _replaced(file, data=drawn(changed, rng), dtype=_TEXT)


def huge(file: h5py.File, rng: Rng, secret: Path) -> None:
    """Declare a column of 2^40 texts that the file does not hold."""
    late = {"shape": (1 << 40,), "dtype": _TEXT}
    kinds: list[dict[str, Any]] = [late, {**late, "chunks": (1 << int(rng.integers(10, 20)),)}]
    kinds.append({**kinds[1], "fillvalue": "A" * 1000})
    kinds.append({**kinds[1], "compression": 1})
    _replaced(file, **drawn(kinds, rng))


def amplified(file: h5py.File, rng: Rng, secret: Path) -> None:
    """Let a thousand rows be the same 20 MB of the file."""
    long = drawn([b"x" * 20_000_000, sealed({"id": "0" * 20, "problem": "x" * 20_000_000})], rng)
    _replaced(file, data=[long] + [b"x"] * 999, dtype=_TEXT)
    place = file["texts"].id.get_offset()
    file.flush()
    with open(file.filename, "r+b") as stream:
        stream.seek(place)
        first = stream.read(16)
        stream.seek(place)
        stream.write(first * 1000)


_TEXT = h5py.string_dtype()


def elsewhere(file: h5py.File, rng: Rng, secret: Path) -> None:
    """Remove the texts, or move them to another place, perhaps of another file."""
    size = len(SECRET)
    other = secret.with_suffix(".h5")
    del file["texts"]
    match int(rng.integers(6)):
        case 0:
            file.create_group("texts")
        case 1:
            file["texts"] = h5py.SoftLink("/trials/id")
        case 2:
            file["texts"] = h5py.ExternalLink(str(other), "/secret")
        case 3:
            place = (str(secret), 0, size)
            file.create_dataset("texts", shape=(size,), dtype="u1", external=[place])
        case 4:
            layout = h5py.VirtualLayout(shape=(size,), dtype="u1")
            layout[:] = h5py.VirtualSource(other, "secret", shape=(size,))
            file.create_virtual_dataset("texts", layout)


TEXT_CRAFTS: tuple[TextCraft, ...] = (
    odd_text,
    odd_json,
    odd_json,
    odd_text,
    deep,
    high_degree,
    odd_schema,
)
FILE_CRAFTS: tuple[FileCraft, ...] = (
    another_type,
    another_shape,
    huge,
    amplified,
    elsewhere,
    elsewhere,
    elsewhere,
    elsewhere,
    elsewhere,
)
CRAFTS: tuple[Craft, ...] = (*TEXT_CRAFTS, *FILE_CRAFTS)


def crafted(folder: Path, work: Path, craft: Craft, rng: Rng) -> Path:
    """Return a forged file: a `results.h5`, or in half of the cases a trial's text."""
    if craft in FILE_CRAFTS:
        return _crafted_file(folder, work, lambda file, secret: craft(file, rng, secret))
    texts = [path.read_bytes() for path in sorted(folder.glob("trials/*.json"))]
    place = int(rng.integers(len(texts)))
    texts[place] = craft(texts[place], rng)
    if rng.random() < 0.5:
        path = work / "trial.json"
        path.write_bytes(texts[place])
        return path
    return _crafted_file(folder, work, lambda file, _: _replaced(file, data=texts, dtype=_TEXT))


def _crafted_file(folder: Path, work: Path, craft: Callable[[h5py.File, Path], None]) -> Path:
    secret = work / "secret.txt"
    secret.write_text(SECRET)
    with h5py.File(secret.with_suffix(".h5"), "w") as other:
        other["secret"] = np.frombuffer(SECRET.encode(), np.uint8)
    path = work / "results.h5"
    path.write_bytes((folder / "results.h5").read_bytes()[: -len(seal_of(b""))])
    with h5py.File(path, "r+") as file:
        craft(file, secret)
    content = path.read_bytes()
    path.write_bytes(content + seal_of(content))
    return path


# --- what a disk does to a file ---


def corrupted(folder: Path, work: Path, rng: Rng) -> Path:
    """Return a `results.h5` with bits flipped, or a block overwritten, moved or cut off."""
    path = work / "results.h5"
    path.write_bytes(changed((folder / "results.h5").read_bytes(), rng))
    return path


def faults(path: Path, *, expected: pd.DataFrame | None, report: bool) -> list[str]:
    """List the faults of `verify`, `export` and `report` on a file; `expected`: its true table."""
    table = path.with_name("trials.csv")
    table.unlink(missing_ok=True)
    commands = [["verify", str(path)], _export(path, table)]
    if report:
        commands.append(["report", str(path)])
    found = []
    for arguments in commands:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DamagedFile)
            answer = said.by(arguments)
        wrong = answer.faults()
        if SECRET in answer.out + answer.err:
            wrong.append("another file's content")
        command = arguments[0]
        found += [f"{command}: {what}" for what in wrong]
    if table.exists():
        text = table.read_text(encoding="utf-8")
        if SECRET in text:
            found.append("export: another file's content")
        if expected is not None and not _numbers(table).equals(expected):
            found.append("export: other numbers")
    return found


def _export(path: Path, table: Path) -> list[str]:
    return ["export", str(path), "--to", "csv", "--out", str(table)]


def _numbers(table: Path) -> pd.DataFrame:
    numbers = pd.read_csv(table, keep_default_na=False)
    return numbers.astype(str)


def true_numbers(folder: Path) -> pd.DataFrame:
    """Return the table that `export` writes for the whole `results.h5`."""
    with tempfile.TemporaryDirectory() as work:
        table = Path(work) / "trials.csv"
        said.by(_export(folder / "results.h5", table))
        return _numbers(table)
