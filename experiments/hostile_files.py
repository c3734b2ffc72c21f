"""What do stored files do that a stranger crafted, or that a disk corrupted?

    python -m experiments.hostile_files            # 2000 crafted, 1500 corrupted; half an hour
    python -m experiments.hostile_files --quick    # 100 and 75

Crafted: one thing in a `results.h5` or a trial file is made what it should not be (another type,
shape, text, number, link, filter, size), and it is sealed again, as a forger would. Corrupted:
bits, blocks or the end of a `results.h5` are changed, and nothing else. `verify`, `export` and, of
every tenth, `report` then read it. A fault is a traceback, an exit code but 0, 1 and 2, an error of
several lines, an escape sequence or the content of another file in what is printed or written, more
than 300 MB of memory, or, of a corrupted file, other numbers exported. Needs Linux.
"""

from __future__ import annotations

import contextlib
import io
import json
import tempfile
import traceback
import warnings
import zlib
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cyclopts
import h5py
import numpy as np
import pandas as pd

from experiments.common.output import save_table
from trajopt.benchmark.store.folder import DamagedFile, Store
from trajopt.benchmark.store.hdf5 import sealed
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import judge
from trajopt.cli import app
from trajopt.registry import named

Rng = np.random.Generator
Craft = Callable[[h5py.File, Path, Rng], None]

SECRET = "what-only-this-machine-knows"
MEMORY_MB = 300.0
ESCAPES = ("\x1b[31m", "\x1b]0;title\x07", "\x9b2J", "\r", "\u202e")
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
    file.visititems(lambda name, item: found.append(name) if hasattr(item, "shape") else None)
    return found


def _one_of(file: h5py.File, rng: Rng) -> str:
    return str(rng.choice(_datasets(file)))


def _replaced(file: h5py.File, name: str, **what: Any) -> None:
    del file[name]
    file.create_dataset(name, **what)


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
    _replaced(file, _one_of(file, rng), data=values[rng.integers(len(values))])


def another_shape(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    values = np.atleast_1d(file[name][()])
    changed = [values[:-1], values[:0], values[None], np.concatenate([values, values]), values[0]]
    if rng.random() < 0.1:
        _replaced(file, name, data=h5py.Empty("f8"))
    else:
        _replaced(file, name, data=changed[rng.integers(len(changed))])


def missing(file: h5py.File, secret: Path, rng: Rng) -> None:
    names = [*_datasets(file), *file]
    del file[str(rng.choice(names))]


def group_instead(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    del file[name]
    file.create_group(name)


def odd_text(file: h5py.File, secret: Path, rng: Rng) -> None:
    names = [name for name in _datasets(file) if file[name].dtype.kind in "SO"]
    name = str(rng.choice(names))
    texts = [escape.encode() + b"x" for escape in ESCAPES]
    texts += [b"\xff\xfe", b"\xed\xa0\x80", b"\0", b"", b"[" * 100_000, b"1e999", b"nan", b"null"]
    text = texts[rng.integers(len(texts))]
    values = np.atleast_1d(file[name][()]).tolist()
    values[rng.integers(len(values))] = text
    data = np.array(values, dtype=f"S{max(map(len, values))}")
    _replaced(file, name, data=data if file[name].ndim else data[0])


def odd_json(file: h5py.File, secret: Path, rng: Rng) -> None:
    """Something in a JSON text is made something else."""
    names = [name for name in _datasets(file) if name.split("/")[-1] in _JSON]
    name = str(rng.choice(names))
    values = np.atleast_1d(file[name][()]).tolist()
    row = int(rng.integers(len(values)))
    value = json.loads(values[row])
    values[row] = json.dumps(_mutated(value, rng)).encode()
    data = np.array(values, dtype=f"S{max(map(len, values))}")
    _replaced(file, name, data=data if file[name].ndim else data[0])


_JSON = ("record", "options", "certificate", "stats", "provenance")


def _mutated(value: Any, rng: Rng) -> Any:
    if isinstance(value, dict) and value and rng.random() < 0.9:
        key = str(rng.choice(list(value)))
        if rng.random() < 0.1:
            return {k: v for k, v in value.items() if k != key}
        return value | {key: _mutated(value[key], rng)}
    if isinstance(value, list) and value and rng.random() < 0.7:
        place = int(rng.integers(len(value)))
        return [*value[:place], _mutated(value[place], rng), *value[place + 1 :]]
    odd: list[Any] = [
        None, True, -1, 0.5, 1e308, 10**30, [], {}, "", "text", [1, "a"], {"a": None},
        {"$float": "inf"}, {"$float": "text"}, {"$array": [1, 2], "dtype": "O"},
        {"$array": ["a"], "dtype": "S999999999"}, {"$array": [[1], 2], "dtype": "<f8"},
        {"$array": ["a"], "dtype": "<U999999999"}, float("nan"), "\ud800", *ESCAPES,
    ]  # fmt: skip
    return odd[rng.integers(len(odd))]


def odd_numbers(file: h5py.File, secret: Path, rng: Rng) -> None:
    names = [n for n in _datasets(file) if file[n].dtype.kind in "fi" and file[n].size]
    name = str(rng.choice(names))
    values = file[name][()]
    odd: list[float] = [-1, 0, 1, 2**62, -(2**62)]
    if values.dtype.kind == "f":
        odd = [np.nan, np.inf, -np.inf, -1.0, 0.0, 1e308, 5e-324]
    values.flat[rng.integers(values.size)] = odd[rng.integers(len(odd))]
    _replaced(file, name, data=values)


def huge_fill(file: h5py.File, secret: Path, rng: Rng) -> None:
    """A terabyte of which the file holds nothing."""
    name = _one_of(file, rng)
    chunks = (1 << int(rng.integers(10, 28)),)
    _replaced(file, name, shape=(1 << 37,), dtype=file[name].dtype, chunks=chunks)


def bomb(file: h5py.File, secret: Path, rng: Rng) -> None:
    """Half a gigabyte of zeros, deflated to half a megabyte, in honest chunks."""
    name = _one_of(file, rng)
    chunk = 1 << 20
    count = 64
    filters = {"compression": 1, "shuffle": True, "fletcher32": True}
    kind = rng.choice(["f8", "i8", "S8"])
    _replaced(file, name, shape=(count * chunk,), dtype=kind, chunks=(chunk,), **filters)
    stored = _deflated_zeros(8) + b"\0\0\0\0"
    for start in range(0, count * chunk, chunk):
        file[name].id.write_direct_chunk((start,), stored)


def inflating_chunk(file: h5py.File, secret: Path, rng: Rng) -> None:
    """A small chunk, stored as what inflates to 400 MB."""
    name = _one_of(file, rng)
    filters = {"compression": 1, "shuffle": True, "fletcher32": True}
    _replaced(file, name, shape=(4,), dtype="f8", chunks=(4,), **filters)
    stored = _deflated_zeros(400) + b"\0\0\0\0"
    file[name].id.write_direct_chunk((0,), stored)


@cache
def _deflated_zeros(megabytes: int) -> bytes:
    deflate = zlib.compressobj(1)
    blocks = [deflate.compress(bytes(1 << 20)) for _ in range(megabytes)]
    return b"".join([*blocks, deflate.flush()])


def high_degree(file: h5py.File, secret: Path, rng: Rng) -> None:
    """Roots of a polynomial of degree 20 000 take gigabytes."""
    rows = np.ones((20_001, 1, 1))
    if "record" in file:
        _replaced(file, "trajectory/coefficients", data=rows)
        _replaced(file, "trajectory/breaks", data=np.array([0.0, 1.0]))
        _replaced(file, "trajectory/waypoint_times", data=np.linspace(0.0, 1.0, 2))
        return
    count = len(file["trials/id"])
    group = "trajectory/coefficients"
    _replaced(file, f"{group}/values", data=np.tile(rows.ravel(), count))
    _replaced(file, f"{group}/shape", data=np.tile(rows.shape, (count, 1)))
    _replaced(file, f"{group}/offsets", data=rows.size * np.arange(count + 1))


def external_storage(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    size = len(SECRET)
    _replaced(file, name, shape=(1,), dtype=f"S{size}", external=[(str(secret), 0, size)])


def external_link(file: h5py.File, secret: Path, rng: Rng) -> None:
    names = [*_datasets(file), *file]
    name = str(rng.choice(names))
    del file[name]
    file[name] = h5py.ExternalLink(str(secret.with_suffix(".h5")), "/secret")


def soft_link(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    target = _one_of(file, rng)
    del file[name]
    file[name] = h5py.SoftLink(f"/{target}")


def virtual(file: h5py.File, secret: Path, rng: Rng) -> None:
    name = _one_of(file, rng)
    length = len(SECRET)
    layout = h5py.VirtualLayout(shape=(1,), dtype=f"S{length}")
    layout[:] = h5py.VirtualSource(secret.with_suffix(".h5"), "secret", shape=(1,))
    del file[name]
    file.create_virtual_dataset(name, layout)


def odd_schema(file: h5py.File, secret: Path, rng: Rng) -> None:
    values: list[Any] = ["3", 3.0, [3], np.arange(1000), -1, 2**40, h5py.Empty("i8"), b"\x1b[31m"]
    file.attrs["schema"] = values[rng.integers(len(values))]


CRAFTS: tuple[Craft, ...] = (
    another_type, another_shape, missing, group_instead, odd_text, odd_json, odd_json, odd_numbers,
    huge_fill, bomb, inflating_chunk, high_degree, external_storage, external_link, soft_link,
    virtual, odd_schema,
)  # fmt: skip


def crafted(folder: Path, work: Path, craft: Craft, rng: Rng) -> Path:
    """A forged file made from one of the folder's."""
    files = [folder / "results.h5", *sorted((folder / "trials").glob("*.h5"))]
    weights = np.array([len(files) - 1.0] + [1.0] * (len(files) - 1))
    source = files[rng.choice(len(files), p=weights / weights.sum())]
    secret = work / "secret.txt"
    secret.write_text(SECRET)
    with h5py.File(secret.with_suffix(".h5"), "w") as other:
        other["secret"] = np.array([SECRET.encode()])
    path = work / "results.h5"
    path.write_bytes(source.read_bytes())
    with h5py.File(path, "r+") as file:
        craft(file, secret, rng)
    path.write_bytes(sealed(path.read_bytes()))
    return path


# --- what a disk does to a file ---


def corrupted(folder: Path, work: Path, rng: Rng) -> Path:
    """A `results.h5` with bits flipped, a block overwritten, moved or cut off."""
    data = bytearray((folder / "results.h5").read_bytes())
    start, end = np.sort(rng.integers(len(data), size=2)).tolist()
    end = min(end, start + 4096)
    match int(rng.integers(5)):
        case 0:
            data[start] ^= 1 << int(rng.integers(8))
        case 1:
            data[start:end] = bytes(end - start)
        case 2:
            data[start:end] = rng.bytes(end - start)
        case 3:
            del data[start:]
        case 4:
            other = int(rng.integers(len(data) - (end - start)))
            data[start:end] = data[other : other + end - start]
    path = work / "results.h5"
    path.write_bytes(data)
    return path


# --- what the program makes of it ---


def run(arguments: Sequence[str]) -> tuple[int, str, str, str]:
    """Exit code, output, errors, and the traceback of what should have been one line."""
    out = io.StringIO()
    err = io.StringIO()
    code = -1
    trace = ""
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            app.main(list(arguments))
        except SystemExit as end:
            code = int(end.code or 0)
        except Exception:
            trace = traceback.format_exc()
    return code, out.getvalue(), err.getvalue(), trace


def faults(path: Path, *, expected: pd.DataFrame | None, report: bool) -> list[str]:
    """What `verify`, `export` and `report` do wrong with a file; `expected`: its true table."""
    table = path.with_name("trials.csv")
    table.unlink(missing_ok=True)
    commands = [["verify", str(path)], ["export", str(path), "--to", "csv", "--out", str(table)]]
    if report:
        page = path.with_name("folder")
        (page / "trials").mkdir(parents=True, exist_ok=True)
        (page / "trials" / f"{0:020x}.h5").write_bytes(path.read_bytes())
        commands.append(["report", str(page)])
    found = []
    for arguments in commands:
        before = _reset_peak()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DamagedFile)
            code, out, err, trace = run(arguments)
        wrong = _wrong(code, out, err, trace)
        if _peak_mb() - before > MEMORY_MB:
            wrong.append(f"{_peak_mb() - before:.0f} MB more")
        found += [f"{arguments[0]}: {what}" for what in wrong]
    if table.exists():
        text = table.read_text(encoding="utf-8")
        if SECRET in text:
            found.append("export: another file's content")
        if expected is not None and not _numbers(table).equals(expected):
            found.append("export: other numbers")
    return found


def _wrong(code: int, out: str, err: str, trace: str) -> list[str]:
    wrong = []
    if trace or "Traceback" in err:
        wrong.append(f"traceback: {(trace or err).strip().splitlines()[-1]}")
    elif code not in (0, 1, 2):
        wrong.append(f"exit code {code}")
    if code == 2 and len(err.strip().splitlines()) != 1:
        wrong.append(f"{len(err.strip().splitlines())} lines of error")
    if any(escape in out + err for escape in ESCAPES):
        wrong.append("an escape sequence")
    if SECRET in out + err:
        wrong.append("another file's content")
    return wrong


def _reset_peak() -> float:
    """Forget the largest memory so far (Linux); what is in use now, MB."""
    Path("/proc/self/clear_refs").write_text("5")
    return _peak_mb()


def _peak_mb() -> float:
    status = Path("/proc/self/status").read_text()
    (line,) = [line for line in status.splitlines() if line.startswith("VmHWM")]
    return int(line.split()[1]) / 1024


def _numbers(table: Path) -> pd.DataFrame:
    return pd.read_csv(table, keep_default_na=False).astype(str)


def true_numbers(folder: Path) -> pd.DataFrame:
    """What `export` says of the whole `results.h5`."""
    with tempfile.TemporaryDirectory() as work:
        table = Path(work) / "trials.csv"
        run(["export", str(folder / "results.h5"), "--to", "csv", "--out", str(table)])
        return _numbers(table)


def one(folder: Path, work: Path, seed: int, kind: str, expected: pd.DataFrame) -> dict[str, Any]:
    """A row of the table: one file, and the faults in reading it."""
    rng = np.random.default_rng(seed)
    report = seed % _REPORT_EVERY == 0
    if kind == _CORRUPTED:
        path = corrupted(folder, work, rng)
        found = faults(path, expected=expected, report=report)
    else:
        path = crafted(folder, work, _BY_NAME[kind], rng)
        found = faults(path, expected=None, report=report)
    return {"kind": kind, "seed": seed, "faults": "; ".join(found)}


def main(
    *,
    output: Path = Path("experiments-output/hostile-files"),
    crafts: int = 2000,
    corruptions: int = 1500,
    quick: bool = False,
) -> None:
    """Craft and corrupt files, read them, count the faults."""
    if quick:
        crafts, corruptions = 100, 75
    kinds = [CRAFTS[i % len(CRAFTS)].__name__ for i in range(crafts)]
    kinds += [_CORRUPTED] * corruptions
    order = np.random.default_rng(0).permutation(len(kinds)).tolist()
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        work = Path(scratch)
        folder = template(work / "template")
        expected = true_numbers(folder)
        for done, seed in enumerate(order, 1):
            row = one(folder, work, seed, kinds[seed], expected)
            rows.append(row)
            if row["faults"]:
                print(row, flush=True)
            if done % _PROGRESS_EVERY == 0:
                print(f"{done} of {len(order)} files", flush=True)
    table = pd.DataFrame(rows).sort_values("seed")
    save_table(table, output / "hostile-files")
    faulty = table["faults"] != ""
    summary = faulty.groupby(table["kind"]).agg(files="size", faulty="sum")
    print(summary.to_string())


_BY_NAME = {craft.__name__: craft for craft in CRAFTS}
_CORRUPTED = "corrupted"
_REPORT_EVERY = 10  # files
_PROGRESS_EVERY = 100  # files


if __name__ == "__main__":
    cyclopts.run(main)
