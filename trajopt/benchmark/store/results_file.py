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
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise
from typing import Any

import h5py
import numpy as np

from trajopt.benchmark.store.schema import (
    ARRAYS,
    COLUMNS,
    PROBLEM,
    SCHEMA,
    STATS,
    Array,
    Encoded,
    unpack,
)

_CHUNK = 1 << 14  # values, 128 KiB: read or damaged together
_BUFFER = 1 << 20  # values kept in memory before they are written
_TEXT = 1 << 26  # bytes of a column beyond which its texts are stored one by one


def write(file: Any, trials: Iterable[Encoded]) -> None:
    """Write all trials into an empty HDF5 file, in one pass over them."""
    file.attrs["schema"] = SCHEMA
    file.attrs["description"] = "trials of minimum-time planners, each judged by the verifier"
    rows: dict[str, list[Any]] = {name: [] for name in COLUMNS}
    numbers: dict[str, dict[str, Array]] = {}
    arrays = {name: _Ragged(file, name, *about) for name, about in ARRAYS.items()}
    for count, trial in enumerate(trials):
        for name in trial.arrays.keys() - arrays:
            arrays[name] = _Ragged(file, name, *STATS, before=count)
        for name, ragged in arrays.items():
            ragged.add(trial.arrays.get(name))
        numbers.setdefault(trial.row["digest"], trial.problem)
        for name, column in COLUMNS.items():
            value = trial.row[name]
            rows[name].append(json.dumps(value) if column.kind is object else value)
    scale = _write_columns(file.create_group("trials"), rows, list(numbers))
    for ragged in arrays.values():
        ragged.close(scale)
    _write_problems(file.create_group("problems"), numbers)


def read(file: Any) -> Iterator[Encoded]:
    """The trials that `write` stored, in its order."""
    columns = {name: _column(file["trials"][name], name) for name in COLUMNS}
    digests = file["problems/digest"].asstr()[()]
    tables = [_cut(file["problems"][name]) for name in PROBLEM]
    numbers = (dict(zip(PROBLEM, table, strict=True)) for table in zip(*tables, strict=True))
    problems: dict[str, Any] = dict(zip(digests, numbers, strict=True))
    arrays = {name: _cut(file[name]) for name in _ragged(file)}
    for i, values in enumerate(zip(*columns.values(), strict=True)):
        row = dict(zip(COLUMNS, values, strict=True))
        own = {name: array for name, cut in arrays.items() if (array := cut[i]) is not None}
        yield Encoded(row, problems[row["digest"]], own)


class _Ragged:
    """Arrays of differing shapes, end to end in one dataset."""

    def __init__(
        self, file: Any, name: str, units: str, description: str, *, before: int = 0
    ) -> None:
        self.group, self.units, self.description = file.create_group(name), units, description
        self.filters = _RAW if name.endswith("coefficients") else _FILTERS
        self.buffer: list[Array] = []
        self.waiting, self.offsets = 0, [0] * (before + 1)
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

    def _flush(self) -> None:
        if "values" not in self.group:
            chunk = max(1, min(self.waiting, _CHUNK))
            data = self.group.create_dataset(
                "values", (0,), float, chunks=(chunk,), maxshape=(None,), **self.filters
            )
            describe(data, self.units, self.description)
        values = self.group["values"]
        if self.buffer:
            values.resize((len(values) + self.waiting,))
            values[len(values) - self.waiting :] = np.concatenate(self.buffer)
            self.buffer, self.waiting = [], 0

    def close(self, scale: Any) -> None:
        self._flush()
        axes = max((len(s) for s in self.shapes if s is not None), default=1)
        shape = np.full((len(self.shapes), axes), -1)
        for row, own in zip(shape, self.shapes, strict=True):
            row[: len(own or ())] = own or ()
        data = _put(self.group, "shape", shape, "1", "shape of each; -1: none, or no such axis")
        data.dims[0].attach_scale(scale)
        what = "where each starts in values, and where the last one ends"
        _put(self.group, "offsets", np.array(self.offsets), "1", what)


def _cut(group: Any) -> list[Array | None]:
    values, shapes = group["values"][()], group["shape"][()]
    parts = (values[a:b] for a, b in pairwise(group["offsets"][()].tolist()))
    return [
        None if shape[0] < 0 else part.reshape([n for n in shape if n >= 0])
        for part, shape in zip(parts, shapes.tolist(), strict=True)
    ]


def _ragged(file: Any) -> list[str]:
    return [*ARRAYS, *(f"stats/{name}" for name in file.get("stats", ()))]


def _write_columns(group: Any, rows: Mapping[str, list[Any]], digests: list[str]) -> Any:
    """Every column of the trials; returns their dimension scale."""
    for name, column in COLUMNS.items():
        _put(group, name, _as(column.kind, rows[name]), column.units, column.description)
    number = {digest: i for i, digest in enumerate(digests)}
    owners = np.array([number[digest] for digest in rows["digest"]], dtype=int)
    _put(group, "problem_row", owners, "1", "row of the trial's problem in problems/, from 0")
    return _scaled(group, "id", "trial")


def _write_problems(group: Any, numbers: Mapping[str, Mapping[str, Array]]) -> None:
    _put(group, "digest", _as(str, list(numbers)), "", "SHA-256 of the problem's numbers")
    scale = _scaled(group, "digest", "problem")
    for name, about in PROBLEM.items():
        ragged = _Ragged(group, name, *about)
        for problem in numbers.values():
            ragged.add(problem[name])
        ragged.close(scale)


def _scaled(group: Any, scale: str, dimension: str) -> Any:
    group[scale].make_scale(dimension)
    for name in set(group) - {scale}:
        group[name].dims[0].attach_scale(group[scale])
    return group[scale]


def _column(data: Any, name: str) -> list[Any]:
    kind = COLUMNS[name].kind
    if kind is float:
        return [None if value != value else value for value in data[()].tolist()]
    if kind is int:
        return [int(value) for value in data[()].tolist()]
    texts = data.asstr()[()].tolist()
    return texts if kind is str else list(map(json.loads, texts))


def _as(kind: type, values: list[Any]) -> Any:
    if kind is int and max(map(abs, values), default=0) >= 2**63:  # seeds may be of any size
        kind, values = str, [str(value) for value in values]
    if kind in (int, float):
        return np.array(unpack(values), dtype=kind)
    texts = [value.encode() for value in values]
    longest = max(map(len, texts), default=0) or 1
    if longest * len(texts) > _TEXT:
        return np.array(texts, dtype=h5py.string_dtype())
    return np.array(texts, dtype=h5py.string_dtype("utf-8", longest))


def _put(group: Any, name: str, values: Any, units: str, description: str) -> Any:
    limits = {"maxshape": (None, *values.shape[1:])}
    limits["chunks"] = (max(1, min(len(values), _CHUNK)), *values.shape[1:])
    filters = {} if values.dtype.kind == "O" else _FILTERS  # texts of any length take none
    data = group.create_dataset(name, data=values, **limits, **filters)
    return describe(data, units, description)


def describe(data: Any, units: str, description: str) -> Any:
    """The same dataset, with its units and what it means."""
    data.attrs["units"], data.attrs["description"] = units, description
    return data


_RAW: dict[str, Any] = {"fletcher32": True}  # for coefficients: they hardly get shorter
_FILTERS = _RAW | {"compression": "gzip", "compression_opts": 1, "shuffle": True}
