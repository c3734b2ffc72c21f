"""One trial as one small HDF5 file: `record`, a JSON text, beside the arrays.

The arrays lie under `trajectory/`, `history/` and `stats/`; every dataset carries its `units` and a
`description`:

    with h5py.File("results/trials/0123456789abcdef0123.h5") as file:
        record = json.loads(file["record"][()])
        trajectory = PPoly(*(file["trajectory"][n][()] for n in ("coefficients", "breaks")))
"""

from __future__ import annotations

import json
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
    Malformed,
    naming,
)
from trajopt.benchmark.store.draft import Draft
from trajopt.benchmark.store.schema import Encoded, pack, unpack

_DESCRIPTION = "one planner on one problem with one seed, judged by the verifier"
_RECORD = Block(
    None, "", "all but the arrays, as JSON: problem, planner, options, verdict, provenance"
)


def content(kept: Encoded) -> bytes:
    """The file's bytes. Made in memory: a full disk then is no business of HDF5's."""
    numbers = {name: _listed(array) for name, array in kept.problem.items()}
    record = kept.row | {"numbers": numbers, "arrays": list(kept.arrays)}
    text = json.dumps(record).encode()
    kind = h5py.string_dtype("utf-8", len(text))
    with Draft(_DESCRIPTION) as draft:
        draft.put("record", np.array(text, dtype=kind), _RECORD)
        for name, array in kept.arrays.items():
            draft.put(name, array, ARRAYS.get(name, STATS))
        return draft.content()


def read(path: Path) -> Encoded:
    """The trial in a file.

    Raises:
        WrongSchema: for what another version wrote.
        Exception: whatever else it raises means that the content is damaged, or not ours.
    """
    with hdf5.opened(path) as source:
        with naming("record"):
            record = json.loads(source.text("record"))
            _check_keys(record)
            numbers = {name: _table(record["numbers"][name]) for name in PROBLEM}
        arrays = {name: _array(source, name) for name in record["arrays"]}
    row = {name: record.get(name, "") for name in COLUMNS}
    return Encoded(row, numbers, arrays)


def _listed(table: Array) -> Any:
    """A table in JSON's terms."""
    rows = table.tolist()
    if np.isfinite(table).all():
        return rows
    return pack(rows)


def _table(value: Any) -> Array:
    try:
        return np.array(value, dtype=float)
    except TypeError:  # something in it is infinite, and spelled out
        return np.array(unpack(value), dtype=float)


def _check_keys(record: Any) -> None:
    if not isinstance(record, dict):
        raise Malformed("expected a JSON object")
    required = [name for name, column in COLUMNS.items() if not column.newer]
    for name in (*required, "numbers", "arrays"):
        if name not in record:
            raise Malformed(f"{name} is missing")
    numbers = record["numbers"]
    if not isinstance(numbers, dict) or not numbers.keys() >= PROBLEM.keys():
        names = ", ".join(PROBLEM)
        raise Malformed(f"numbers: expected {names}")
    arrays = record["arrays"]
    if not isinstance(arrays, list) or not all(isinstance(name, str) for name in arrays):
        raise Malformed("arrays: expected a list of names")


def _array(source: hdf5.Source, name: str) -> Array:
    block = ARRAYS.get(name)
    if block is not None and block.axes is not None:
        return source.numbers(name, len(block.axes))
    group, _, last = name.partition("/")
    if group != "stats" or not last or "/" in last:
        raise Malformed(f"record: arrays: {name!r:.80} is none of a trial's")
    return source.numbers(name)
