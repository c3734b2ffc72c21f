"""Results files that a stranger crafted, or that a disk corrupted.

Crafted: one thing in a `results.h5` or a trial file is made what it should not be (another type,
shape, text, number, link, filter, size), and it is sealed again, as a forger would. Corrupted:
bits, blocks or the end of a `results.h5` are changed, and nothing else. `verify`, `export` and
`report` then read it. Needs Linux.
"""

from __future__ import annotations

import json
import tempfile
import warnings
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np
import pandas as pd

from experiments.common import said
from experiments.common.said import ESCAPES
from trajopt.benchmark.store.folder import DamagedFile, Store
from trajopt.benchmark.store.seal import sealed
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import judge
from trajopt.planners.registry import named

T = TypeVar("T")
Rng = np.random.Generator
Craft = Callable[[h5py.File, Path, Rng], None]

SECRET = "what-only-this-machine-knows"
LONGEST_BLOCK = 4096  # bytes

ODD_TEXTS = (
    b"\xff\xfe",
    b"\xed\xa0\x80",
    b"\0",
    b"",
    b"[" * 100_000,
    b"1e999",
    b"nan",
    b"null",
)
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
ODD_INTEGERS = (-1, 0, 1, 2**62, -(2**62))
ODD_FLOATS = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e308, 5e-324)

JSON = ("record", "options", "certificate", "stats", "provenance")  # datasets of it
FILTERS: dict[str, Any] = {"compression": 1, "shuffle": True, "fletcher32": True}
CHECKSUM = b"\0\0\0\0"  # of zeros

PLANNERS = ("pso:iterations=20,population=5", "unoptimised", "ruckig-stop", "toppra")


def template(folder: Path) -> Path:
    """A results folder of four planners on one problem."""
    store = Store(folder)
    problem = catalogue.load("one-joint")
    for spec in PLANNERS:
        name, planner = named(spec)
        store.write(judge(planner, problem, [0], name)[0])
    return store.consolidate().parent


# --- what a forger does to a file ---


def _datasets(file: h5py.File) -> list[str]:
    found: list[str] = []

    def visit(name: str, item: h5py.Dataset | h5py.Group) -> None:
        if isinstance(item, h5py.Dataset):
            found.append(name)

    file.visititems(visit)
    return found


def _of_kind(file: h5py.File, kinds: str) -> list[str]:
    """The datasets whose type is of one of NumPy's kinds."""
    return [name for name in _datasets(file) if file[name].dtype.kind in kinds]


def _one_of(file: h5py.File, rng: Rng) -> str:
    return str(rng.choice(_datasets(file)))


def _drawn(values: Sequence[T], rng: Rng) -> T:
    place = int(rng.integers(len(values)))
    return values[place]


def _replaced(file: h5py.File, name: str, **what: Any) -> None:
    del file[name]
    file.create_dataset(name, **what)


def _texts(file: h5py.File, name: str) -> list[bytes]:
    values = np.atleast_1d(file[name][()])
    return list(values.tolist())


def _with_texts(file: h5py.File, name: str, texts: list[bytes]) -> None:
    """Other texts in a dataset, a scalar where it was one."""
    width = max(map(len, texts))
    data = np.array(texts, dtype=f"S{width}")
    if file[name].ndim == 0:
        data = data[0]
    _replaced(file, name, data=data)


def another_type(file: h5py.File, secret: Path, rng: Rng) -> None:
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
    name = _one_of(file, rng)
    _replaced(file, name, data=_drawn(values, rng))


def another_shape(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    values = np.atleast_1d(file[name][()])
    if rng.random() < 0.1:
        _replaced(file, name, data=h5py.Empty("f8"))
        return
    changed = [
        values[:-1],
        values[:0],
        values[None],
        np.concatenate([values, values]),
        values[0],
    ]
    _replaced(file, name, data=_drawn(changed, rng))


def missing(file: h5py.File, secret: Path, rng: Rng) -> None:
    names = [*_datasets(file), *file]
    name = str(rng.choice(names))
    del file[name]


def group_instead(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    del file[name]
    file.create_group(name)


def odd_text(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = str(rng.choice(_of_kind(file, "SO")))
    odd = [escape.encode() + b"x" for escape in ESCAPES]
    odd += ODD_TEXTS
    text = _drawn(odd, rng)
    texts = _texts(file, name)
    row = rng.integers(len(texts))
    texts[row] = text
    _with_texts(file, name, texts)


def odd_json(file: h5py.File, secret: Path, rng: Rng) -> None:
    """Something in a JSON text is made something else."""
    names = [name for name in _datasets(file) if name.split("/")[-1] in JSON]
    name = str(rng.choice(names))
    texts = _texts(file, name)
    row = int(rng.integers(len(texts)))
    value = json.loads(texts[row])
    mutated = json.dumps(_mutated(value, rng))
    texts[row] = mutated.encode()
    _with_texts(file, name, texts)


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
    return _drawn(ODD_VALUES, rng)


def odd_numbers(file: h5py.File, secret: Path, rng: Rng) -> None:
    names = [name for name in _of_kind(file, "fi") if file[name].size]
    name = str(rng.choice(names))
    values = file[name][()]
    odd: Sequence[float] = ODD_INTEGERS
    if values.dtype.kind == "f":
        odd = ODD_FLOATS
    number = _drawn(odd, rng)
    place = rng.integers(values.size)
    values.flat[place] = number
    _replaced(file, name, data=values)


def huge_fill(file: h5py.File, secret: Path, rng: Rng) -> None:
    """A terabyte of which the file holds nothing."""
    name = _one_of(file, rng)
    chunk = 1 << int(rng.integers(10, 28))
    _replaced(
        file,
        name,
        shape=(1 << 37,),
        dtype=file[name].dtype,
        chunks=(chunk,),
    )


def bomb(file: h5py.File, secret: Path, rng: Rng) -> None:
    """Half a gigabyte of zeros, deflated to half a megabyte, in honest chunks."""
    name = _one_of(file, rng)
    chunk = 1 << 20
    size = 64 * chunk
    kind = rng.choice(["f8", "i8", "S8"])
    _replaced(
        file,
        name,
        shape=(size,),
        dtype=kind,
        chunks=(chunk,),
        **FILTERS,
    )
    stored = _deflated_zeros(8) + CHECKSUM
    for start in range(0, size, chunk):
        file[name].id.write_direct_chunk((start,), stored)


def inflating_chunk(file: h5py.File, secret: Path, rng: Rng) -> None:
    """A small chunk, stored as what inflates to 400 MB."""
    name = _one_of(file, rng)
    _replaced(
        file,
        name,
        shape=(4,),
        dtype="f8",
        chunks=(4,),
        **FILTERS,
    )
    stored = _deflated_zeros(400) + CHECKSUM
    file[name].id.write_direct_chunk((0,), stored)


@cache
def _deflated_zeros(megabytes: int) -> bytes:
    deflate = zlib.compressobj(1)
    zeros = bytes(1 << 20)
    blocks = [deflate.compress(zeros) for _ in range(megabytes)]
    blocks.append(deflate.flush())
    return b"".join(blocks)


def high_degree(file: h5py.File, secret: Path, rng: Rng) -> None:
    """Roots of a polynomial of degree 20 000 take gigabytes."""
    rows = np.ones((20_001, 1, 1))
    if "record" in file:
        ends = np.array([0.0, 1.0])
        _replaced(file, "trajectory/coefficients", data=rows)
        _replaced(file, "trajectory/breaks", data=ends)
        _replaced(file, "trajectory/waypoint_times", data=ends)
        return
    count = len(file["trials/id"])
    group = "trajectory/coefficients"
    values = np.tile(rows.ravel(), count)
    shapes = np.tile(rows.shape, (count, 1))
    offsets = rows.size * np.arange(count + 1)
    _replaced(file, f"{group}/values", data=values)
    _replaced(file, f"{group}/shape", data=shapes)
    _replaced(file, f"{group}/offsets", data=offsets)


def external_storage(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    size = len(SECRET)
    elsewhere = (str(secret), 0, size)
    _replaced(
        file,
        name,
        shape=(1,),
        dtype=f"S{size}",
        external=[elsewhere],
    )


def external_link(file: h5py.File, secret: Path, rng: Rng) -> None:
    names = [*_datasets(file), *file]
    name = str(rng.choice(names))
    other = secret.with_suffix(".h5")
    del file[name]
    file[name] = h5py.ExternalLink(str(other), "/secret")


def soft_link(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    target = _one_of(file, rng)
    del file[name]
    file[name] = h5py.SoftLink(f"/{target}")


def virtual(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    other = secret.with_suffix(".h5")
    layout = h5py.VirtualLayout(shape=(1,), dtype=f"S{len(SECRET)}")
    layout[:] = h5py.VirtualSource(other, "secret", shape=(1,))
    del file[name]
    file.create_virtual_dataset(name, layout)


def odd_schema(file: h5py.File, secret: Path, rng: Rng) -> None:
    values: list[Any] = [
        "3",
        3.0,
        [3],
        np.arange(1000),
        -1,
        2**40,
        h5py.Empty("i8"),
        b"\x1b[31m",
    ]
    file.attrs["schema"] = _drawn(values, rng)


CRAFTS: tuple[Craft, ...] = (
    another_type,
    another_shape,
    missing,
    group_instead,
    odd_text,
    odd_json,
    odd_json,
    odd_numbers,
    huge_fill,
    bomb,
    inflating_chunk,
    high_degree,
    external_storage,
    external_link,
    soft_link,
    virtual,
    odd_schema,
)


def crafted(
    folder: Path,
    work: Path,
    craft: Craft,
    rng: Rng,
) -> Path:
    """A forged file: made from `results.h5`, or as often from one of the trial files."""
    trials = sorted(folder.glob("trials/*.h5"))
    files = [folder / "results.h5", *trials]
    weights = np.ones(len(files))
    weights[0] = len(trials)
    source = rng.choice(len(files), p=weights / weights.sum())
    secret = work / "secret.txt"
    secret.write_text(SECRET)
    with h5py.File(secret.with_suffix(".h5"), "w") as other:
        other["secret"] = np.array([SECRET.encode()])
    path = work / "results.h5"
    path.write_bytes(files[source].read_bytes())
    with h5py.File(path, "r+") as file:
        craft(file, secret, rng)
    forged = path.read_bytes()
    path.write_bytes(sealed(forged))
    return path


# --- what a disk does to a file ---


def corrupted(folder: Path, work: Path, rng: Rng) -> Path:
    """A `results.h5` with bits flipped, a block overwritten, moved or cut off."""
    data = bytearray((folder / "results.h5").read_bytes())
    places = rng.integers(len(data), size=2)
    start, end = np.sort(places).tolist()
    end = min(end, start + LONGEST_BLOCK)
    length = end - start
    match int(rng.integers(5)):
        case 0:
            bit = int(rng.integers(8))
            data[start] ^= 1 << bit
        case 1:
            data[start:end] = bytes(length)
        case 2:
            data[start:end] = rng.bytes(length)
        case 3:
            del data[start:]
        case 4:
            other = int(rng.integers(len(data) - length))
            data[start:end] = data[other : other + length]
    path = work / "results.h5"
    path.write_bytes(data)
    return path


def faults(
    path: Path,
    *,
    expected: pd.DataFrame | None,
    report: bool,
) -> list[str]:
    """What `verify`, `export` and `report` do wrong with a file; `expected`: its true table."""
    table = path.with_name("trials.csv")
    table.unlink(missing_ok=True)
    commands = [
        ["verify", str(path)],
        _export(path, table),
    ]
    if report:
        folder = path.with_name("folder")
        trial = folder / "trials" / f"{0:020x}.h5"
        trial.parent.mkdir(parents=True, exist_ok=True)
        trial.write_bytes(path.read_bytes())
        commands.append(["report", str(folder)])
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
    """What `export` says of the whole `results.h5`."""
    with tempfile.TemporaryDirectory() as work:
        table = Path(work) / "trials.csv"
        said.by(_export(folder / "results.h5", table))
        return _numbers(table)
