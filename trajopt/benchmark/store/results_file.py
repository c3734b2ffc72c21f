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
from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import h5py
import numpy as np

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
from trajopt.benchmark.store.schema import Encoded, unpack

_CHUNK = 1 << 14  # values, 128 KiB: read or damaged together
_BUFFER = 1 << 20  # values kept in memory before they are written
_PADDED_BYTES = 1 << 22  # of a column's texts, beyond which they are stored one by one
_PADDED_RATIO = 4  # if they also take as many times what they say

Filters = dict[str, Any]
_CHECKED: Filters = {"fletcher32": True}
_COMPRESSED: Filters = _CHECKED | {"compression": "gzip", "compression_opts": 1, "shuffle": True}

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
    for filters in (_COMPRESSED, _CHECKED):
        with h5py.File.in_memory(libver=hdf5.LIBRARY) as file:
            file.attrs["schema"] = hdf5.SCHEMA
            file.attrs["description"] = _DESCRIPTION
            _write(file, trials(), filters)
            data = hdf5.content(file)
            claimed = hdf5.claimed(file)
        if claimed <= hdf5.allowance(len(data)):
            break
    return data


def _write(file: h5py.File, trials: Iterable[Encoded], filters: Filters) -> None:
    rows: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    problems: dict[str, dict[str, Array]] = {}
    arrays = {name: _Ragged(file, name, block, filters) for name, block in ARRAYS.items()}
    for count, trial in enumerate(trials):
        for name in trial.arrays.keys() - arrays:
            arrays[name] = _Ragged(file, name, STATS, filters, before=count)
        for name, ragged in arrays.items():
            ragged.add(trial.arrays.get(name))
        problems.setdefault(trial.row["digest"], trial.problem)
        for name in COLUMNS:
            rows[name].append(trial.row[name])
    scale = _write_columns(file.create_group("trials"), rows, list(problems), filters)
    for ragged in arrays.values():
        ragged.close(scale)
    _write_problems(file.create_group("problems"), problems, filters)


def read(path: Path) -> Iterator[Encoded]:
    """The trials that `content` stored, in its order.

    Raises:
        WrongSchema: for what another version wrote.
        Exception: whatever else it raises means that the content is damaged, or not ours.
    """
    with hdf5.opened(path) as source:
        columns = {name: _column(source, name) for name in COLUMNS}
        count = len(columns["id"])
        for name, values in columns.items():
            if len(values) != count:
                raise Malformed(f"trials/{name}: {len(values)} entries, but {count} trials")
        problems = _problems(source)
        names = [*ARRAYS, *(f"stats/{name}" for name in source.names("stats"))]
        arrays = {name: _parts(source, name, count) for name in names}
    for i in range(count):
        row = {name: values[i] for name, values in columns.items()}
        if row["digest"] not in problems:
            raise Malformed(f"trials/digest: {row['digest']!r:.80} is not in problems/digest")
        own = {}
        for name, parts in arrays.items():
            part = parts[i]
            if part is not None:
                own[name] = part
        yield Encoded(row, problems[row["digest"]], own)


class _Ragged:
    """Arrays of differing shapes, end to end in one dataset."""

    def __init__(
        self, file: Any, name: str, block: Block, filters: Filters, *, before: int = 0
    ) -> None:
        self.group = file.create_group(name)
        self.block = block
        self.filters = filters
        self.value_filters = _CHECKED if name.endswith("coefficients") else filters
        self.buffer: list[Array] = []
        self.waiting = 0
        self.offsets = [0] * (before + 1)
        self.shapes: list[tuple[int, ...] | None] = [None] * before

    def add(self, array: Array | None) -> None:
        size = 0 if array is None else array.size
        self.shapes.append(None if array is None else array.shape)
        self.offsets.append(self.offsets[-1] + size)
        if array is not None and size:
            self.buffer.append(array.ravel())
            self.waiting += size
        if self.waiting > _BUFFER:
            self._flush()

    def close(self, scale: Any) -> None:
        self._flush()
        axes = max((len(shape) for shape in self.shapes if shape is not None), default=1)
        table = np.full((len(self.shapes), axes), -1)
        for row, shape in zip(table, self.shapes, strict=True):
            own = shape or ()
            row[: len(own)] = own
        data = _put(self.group, "shape", table, _SHAPE, self.filters)
        data.dims[0].attach_scale(scale)
        _put(self.group, "offsets", np.array(self.offsets), _OFFSETS, self.filters)

    def _flush(self) -> None:
        if "values" not in self.group:
            self._create(chunk=max(1, min(self.waiting, _CHUNK)))
        if not self.buffer:
            return
        values = self.group["values"]
        start = len(values)
        values.resize((start + self.waiting,))
        values[start:] = np.concatenate(self.buffer)
        self.buffer = []
        self.waiting = 0

    def _create(self, chunk: int) -> None:
        data = self.group.create_dataset(
            "values",
            shape=(0,),
            dtype=float,
            chunks=(chunk,),
            maxshape=(None,),
            **self.value_filters,
        )
        _describe(data, self.block)


def _parts(source: hdf5.Source, name: str, count: int) -> list[Array | None]:
    """The arrays of a `_Ragged`."""
    values = source.numbers(f"{name}/values", 1)
    shapes = source.integers(f"{name}/shape", 2)
    offsets = source.integers(f"{name}/offsets", 1)
    ends_fit = offsets[:1] == [0] and offsets[-1:] == [len(values)]
    if not ends_fit or len(offsets) != count + 1 or len(shapes) != count:
        raise Malformed(f"{name}: offsets, shape and values do not fit together")
    parts: list[Array | None] = []
    for (start, end), row in zip(pairwise(offsets), shapes, strict=True):
        if end < start:
            raise Malformed(f"{name}/offsets: they decrease")
        shape = [n for n in row if n >= 0]
        parts.append(values[start:end].reshape(shape) if shape else None)
    return parts


def _problems(source: hdf5.Source) -> dict[str, dict[str, Array]]:
    """Waypoints and limits by the problem's digest."""
    digests = source.texts("problems/digest")
    tables = {name: _parts(source, f"problems/{name}", len(digests)) for name in PROBLEM}
    problems: dict[str, dict[str, Array]] = {}
    for i, digest in enumerate(digests):
        problems[digest] = {}
        for name, parts in tables.items():
            part = parts[i]
            if part is None:
                raise Malformed(f"problems/{name}: none for problem {i}")
            problems[digest][name] = part
    return problems


def _write_columns(
    group: Any, rows: Mapping[str, list[Any]], digests: list[str], filters: Filters
) -> Any:
    """Every column of the trials; returns their dimension scale."""
    for name, column in COLUMNS.items():
        _put(group, name, _stored(column, rows[name]), column, filters)
    number = {digest: i for i, digest in enumerate(digests)}
    owners = [number[digest] for digest in rows["digest"]]
    _put(group, "problem_row", np.array(owners, dtype=int), _PROBLEM_ROW, filters)
    return _scaled(group, "id", "trial")


def _write_problems(
    group: Any, problems: Mapping[str, Mapping[str, Array]], filters: Filters
) -> None:
    _put(group, "digest", _padded(list(problems)), _PROBLEM_DIGEST, filters)
    scale = _scaled(group, "digest", "problem")
    for name, block in PROBLEM.items():
        ragged = _Ragged(group, name, block, filters)
        for problem in problems.values():
            ragged.add(problem[name])
        ragged.close(scale)


def _scaled(group: Any, scale: str, dimension: str) -> Any:
    group[scale].make_scale(dimension)
    for name in set(group) - {scale}:
        group[name].dims[0].attach_scale(group[scale])
    return group[scale]


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
    longest = max(1, max(map(len, encoded), default=0))
    padded = longest * len(encoded)
    if padded > max(_PADDED_BYTES, _PADDED_RATIO * sum(map(len, encoded))):
        return np.array(encoded, dtype=h5py.string_dtype())
    return np.array(encoded, dtype=h5py.string_dtype("utf-8", longest))


def _put(group: Any, name: str, values: Any, about: Block | Column, filters: Filters) -> Any:
    rest = values.shape[1:]
    rows = max(1, min(len(values), _CHUNK))
    if values.dtype.kind == "O":  # texts of any length take none
        filters = {}
    data = group.create_dataset(
        name,
        data=values,
        chunks=(rows, *rest),
        maxshape=(None, *rest),
        **filters,
    )
    _describe(data, about)
    return data


def _describe(data: Any, about: Block | Column) -> None:
    data.attrs["units"] = about.units
    data.attrs["description"] = about.text if isinstance(about, Block) else about.description
