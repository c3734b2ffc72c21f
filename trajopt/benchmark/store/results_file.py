"""`results.h5`: every trial of a folder, column by column, for plain h5py, pandas and xarray.

- `trials/` has one dataset per column, one entry per trial, with `id` as their dimension scale;
- `problems/` the waypoints and limits, once per problem, `trials/problem_row` says whose;
- `trajectory/`, `history/` and `stats/` the arrays. These differ in size from trial to trial, so
  all of one kind lie end to end in `values`: trial i has `values[offsets[i]:offsets[i + 1]]`, to
  be reshaped to `shape[i]` (−1 where it has none). `problems/` does the same.

Every dataset carries its `units` and a `description`. The fastest trajectory, with plain h5py:

    with h5py.File("results/results.h5") as file:
        best = int(np.nanargmin(file["trials/certified_duration"]))
        def array(data):
            start, end = data["offsets"][best : best + 2]
            return data["values"][start:end].reshape(data["shape"][best])
        trajectory = PPoly(*(array(file["trajectory"][n]) for n in ("coefficients", "breaks")))
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.store import hdf5
from trajopt.benchmark.store.columns import (
    ARRAYS,
    COLUMNS,
    PROBLEM,
    STATS,
    Array,
    Block,
    Column,
    Malformed,
    naming,
)
from trajopt.benchmark.store.draft import Draft, Filters, checked, compressed, unfiltered
from trajopt.benchmark.store.schema import Encoded, unpack

_CHUNK = 1 << 14  # values, 128 KiB: read or damaged together
_BUFFER = 1 << 20  # values kept in memory before they are written
_PADDED_BYTES = 1 << 22  # of a column's texts, beyond which they are stored one by one
_PADDED_RATIO = 4  # if they also take as many times what they say

_NO_VALUES = np.empty(0)

Columns = dict[str, list[Any]]
Numbers = dict[str, Array]  # of a problem, by the names of `PROBLEM`
Problems = dict[str, Numbers]  # by the problems' digests
Parts = list[Array | None]  # an array per trial or problem

_DESCRIPTION = "trials of minimum-time planners, each judged by the verifier"
_OFFSETS = Block(None, "1", "where each starts in values, and where the last one ends")
_SHAPE = Block(None, "1", "shape of each; -1: none, or no such axis")
_PROBLEM_ROW = Block(None, "1", "row of the trial's problem in problems/, from 0")
_PROBLEM_DIGEST = Block(None, "", "SHA-256 of the problem's numbers")


def content(trials: Callable[[], Iterable[Encoded]]) -> bytes:
    """The file's bytes, in one pass over the trials. Made in memory, as a trial file is.

    What would compress so well that readers took it for a bomb is stored as it is.
    """
    data = b""
    for filters in (compressed, checked):
        with Draft(_DESCRIPTION) as draft:
            _write(_Writer(draft, filters), trials())
            data = draft.content()
        if draft.claimed <= hdf5.allowance(len(data)):
            break
    return data


def _write(writer: _Writer, trials: Iterable[Encoded]) -> None:
    columns: Columns = {name: [] for name in COLUMNS}
    problems: Problems = {}
    arrays: dict[str, _Ragged] = {}
    for name, block in ARRAYS.items():
        arrays[name] = _Ragged(writer, name, block)
    for count, trial in enumerate(trials):
        for name in sorted(trial.arrays.keys() - arrays):
            arrays[name] = _Ragged(writer, name, STATS, before=count)
        for name, ragged in arrays.items():
            ragged.add(trial.arrays.get(name))
        for name, values in columns.items():
            values.append(trial.row[name])
        problems.setdefault(trial.row["digest"], trial.problem)
    for name, column in COLUMNS.items():
        values = _stored(column, columns[name])
        writer.put(f"trials/{name}", values, column)
    row_of = {digest: row for row, digest in enumerate(problems)}
    rows = [row_of[digest] for digest in columns["digest"]]
    writer.put("trials/problem_row", np.array(rows, dtype=int), _PROBLEM_ROW)
    scale = writer.scaled("trials", "id", "trial")
    for ragged in arrays.values():
        ragged.close(scale)
    _write_problems(writer, problems)


def _write_problems(writer: _Writer, problems: Problems) -> None:
    digests = _padded(list(problems))
    writer.put("problems/digest", digests, _PROBLEM_DIGEST)
    scale = writer.scaled("problems", "digest", "problem")
    for name, block in PROBLEM.items():
        ragged = _Ragged(writer, f"problems/{name}", block)
        for numbers in problems.values():
            ragged.add(numbers[name])
        ragged.close(scale)


def read(path: Path) -> Iterator[Encoded]:
    """The trials that `content` stored, in its order.

    Raises:
        WrongSchema: for what another version wrote.
        Exception: whatever else it raises means that the content is damaged, or not ours.
    """
    with hdf5.opened(path) as source:
        columns = {name: _column(source, name) for name in _present(source)}
        count = len(columns["id"])
        for name in COLUMNS.keys() - columns:
            columns[name] = [""] * count
        for name, values in columns.items():
            entries = len(values)
            if entries != count:
                raise Malformed(f"trials/{name}: {entries} entries, but {count} trials")
        problems = _problems(source)
        stats = [f"stats/{name}" for name in source.names("stats")]
        arrays: dict[str, Parts] = {}
        for name in (*ARRAYS, *stats):
            arrays[name] = _parts(source, name, count)
    for i in range(count):
        row = {name: values[i] for name, values in columns.items()}
        digest = row["digest"]
        if digest not in problems:
            raise Malformed(f"trials/digest: {digest!r:.80} is not in problems/digest")
        present = {}
        for name, parts in arrays.items():
            part = parts[i]
            if part is not None:
                present[name] = part
        yield Encoded(row, problems[digest], present)


def texts(path: Path, *names: str) -> list[tuple[str, ...]]:
    """Some columns of texts, a tuple per trial; raises as `read` does."""
    with hdf5.opened(path) as source:
        present = _present(source)
        ids = _column(source, "id")
        columns = []
        for name in names:
            column = _column(source, name) if name in present else [""] * len(ids)
            columns.append(column)
    return list(zip(*columns, strict=True))


def _present(source: hdf5.Source) -> list[str]:
    """The columns that a file must have, and the newer ones that it has."""
    there = source.names("trials")
    present = []
    for name, column in COLUMNS.items():
        if not column.newer or name in there:
            present.append(name)
    return present


@dataclass(frozen=True)
class _Writer:
    """A file being made, and the filters that its datasets pass."""

    draft: Draft
    filters: Filters

    def put(self, name: str, values: NDArray[Any], about: Block | Column) -> None:
        """Write values into a dataset that can grow."""
        filters = self.filters
        if name == "trajectory/coefficients/values":  # they hardly get shorter
            filters = checked
        if values.dtype.kind == "O":  # texts of any length take none
            filters = unfiltered
        rows = max(1, min(len(values), _CHUNK))
        self.draft.put_growing(name, values, about, rows=rows, filters=filters)

    def extend(self, name: str, values: Array, about: Block) -> None:
        """Let these values follow those that there are."""
        if name not in self.draft.datasets:
            self.put(name, values, about)
        elif values.size:
            self.draft.append(name, values)

    def scaled(self, group: str, name: str, dimension: str) -> str:
        """The path of the dataset `name`, made the dimension scale of all others in the group."""
        scale = f"{group}/{name}"
        self.draft.make_scale(scale, dimension)
        for path in self.draft.datasets:
            above, _, _ = path.rpartition("/")
            if above == group and path != scale:
                self.draft.attach(path, scale)
        return scale


class _Ragged:
    """Arrays of differing shapes, end to end in one dataset."""

    def __init__(self, writer: _Writer, name: str, block: Block, *, before: int = 0) -> None:
        self.writer = writer
        self.name = name
        self.block = block
        self.buffer: list[Array] = []
        self.waiting = 0
        self.offsets = [0] * (before + 1)
        self.shapes: list[tuple[int, ...]] = [()] * before  # empty where there is no array

    def add(self, array: Array | None) -> None:
        end = self.offsets[-1]
        if array is None:
            self.shapes.append(())
            self.offsets.append(end)
            return
        self.shapes.append(array.shape)
        self.offsets.append(end + array.size)
        self.buffer.append(array.ravel())
        self.waiting += array.size
        if self.waiting > _BUFFER:
            self._flush()

    def close(self, scale: str) -> None:
        self._flush()
        shape = f"{self.name}/shape"
        self.writer.put(shape, self._table(), _SHAPE)
        self.writer.draft.attach(shape, scale)
        offsets = np.array(self.offsets)
        self.writer.put(f"{self.name}/offsets", offsets, _OFFSETS)

    def _table(self) -> NDArray[np.int64]:
        """The shapes, one a row."""
        axes = max(map(len, self.shapes), default=0)
        rows = len(self.shapes)
        table = np.full((rows, max(1, axes)), -1)
        for row, shape in zip(table, self.shapes, strict=True):
            row[: len(shape)] = shape
        return table

    def _flush(self) -> None:
        values = np.concatenate([_NO_VALUES, *self.buffer])
        self.writer.extend(f"{self.name}/values", values, self.block)
        self.buffer = []
        self.waiting = 0


def _parts(source: hdf5.Source, name: str, count: int) -> Parts:
    """The arrays of a `_Ragged`."""
    values = source.numbers(f"{name}/values", 1)
    shapes = source.integers(f"{name}/shape", 2)
    offsets = source.integers(f"{name}/offsets", 1)
    sizes = (len(offsets), len(shapes))
    if sizes != (count + 1, count):
        raise Malformed(f"{name}: offsets or shape are not those of {count} arrays")
    ends = (offsets[0], offsets[-1])
    if ends != (0, len(values)):
        raise Malformed(f"{name}: offsets do not reach from 0 to {len(values)}")
    parts: Parts = []
    for start, end, row in zip(offsets, offsets[1:], shapes, strict=False):
        if end < start:
            raise Malformed(f"{name}/offsets: they decrease")
        shape = [side for side in row if side >= 0]
        if not shape:
            parts.append(None)
            continue
        with naming(f"{name}/shape"):
            parts.append(values[start:end].reshape(shape))
    return parts


def _problems(source: hdf5.Source) -> Problems:
    """Waypoints and limits by the problem's digest."""
    digests = source.texts("problems/digest")
    count = len(digests)
    problems: Problems = {digest: {} for digest in digests}
    for name in PROBLEM:
        parts = _parts(source, f"problems/{name}", count)
        for digest, part in zip(digests, parts, strict=True):
            if part is None:
                raise Malformed(f"problems/{name}: none for problem {digest!r:.80}")
            problems[digest][name] = part
    return problems


def _stored(column: Column, values: list[Any]) -> Any:
    """A column's values as they lie in HDF5."""
    if column.kind == "number":
        return np.array(unpack(values), dtype=float)
    if column.kind == "integer":
        return np.array(values, dtype=np.int64)
    if column.kind == "object":
        return _padded([json.dumps(value) for value in values])
    return _padded(values)


def _column(source: hdf5.Source, name: str) -> list[Any]:
    """A column's values as `Encoded` has them."""
    kind = COLUMNS[name].kind
    path = f"trials/{name}"
    if kind == "number":
        numbers = source.numbers(path, 1).tolist()
        return [None if np.isnan(value) else value for value in numbers]
    if kind == "integer":
        return source.integers(path, 1)
    texts = source.texts(path)
    if kind != "object":
        return texts
    with naming(path):
        return [json.loads(text) for text in texts]


def _padded(texts: list[str]) -> Any:
    """Texts of one length, which compress and which everybody reads, unless they were too long."""
    encoded = [text.encode() for text in texts]
    sizes = [len(text) for text in encoded]
    longest = max(sizes, default=0) or 1
    allowed = max(_PADDED_BYTES, _PADDED_RATIO * sum(sizes))
    if longest * len(encoded) > allowed:
        return np.array(encoded, dtype=h5py.string_dtype())
    return np.array(encoded, dtype=h5py.string_dtype("utf-8", longest))
