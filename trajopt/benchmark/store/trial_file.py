"""One trial as one small HDF5 file: `record`, a JSON text, beside the arrays.

The arrays lie under `trajectory/`, `history/` and `stats/`; every dataset carries its `units` and a
`description`. 16 bytes behind the HDF5 data hold their checksum, which HDF5 does not mind:

    with h5py.File("results/trials/0123456789abcdef0123.h5") as file:
        record = json.loads(file["record"][()])
        trajectory = PPoly(*(file["trajectory"][n][()] for n in ("coefficients", "breaks")))

h5py's low-level interface makes and reads such a file in half the time of the other.
"""

from __future__ import annotations

import json
import zlib
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5f, h5o, h5p, h5s, h5t
from numpy.typing import NDArray

from trajopt.benchmark.store.schema import (
    ARRAYS,
    SCHEMA,
    STATS,
    Encoded,
    check_schema,
    pack,
    unpack,
)

LIBRARY = "v110"  # compact, checksummed metadata that HDF5 1.10 (2016) and later read
_MAGIC = b"trajopt%d" % SCHEMA
TAIL = len(_MAGIC) + 8  # bytes
_DESCRIPTION = "one planner on one problem with one seed, judged by the verifier"
_RECORD = ("", "all but the arrays, as JSON: problem, planner, options, verdict, provenance")
_SCALAR = h5s.create(h5s.SCALAR)
_TEXT = h5t.py_create(h5py.string_dtype(), logical=True)
_PARENTS = h5p.create(h5p.LINK_CREATE)
_PARENTS.set_create_intermediate_group(True)


def write(kept: Encoded) -> bytes:
    """The file's content. Made in memory: a full disk then is no business of HDF5's."""
    numbers = {name: pack(array.tolist()) for name, array in kept.problem.items()}
    record = json.dumps(kept.row | {"numbers": numbers, "arrays": list(kept.arrays)}).encode()
    with h5py.File.in_memory(libver=LIBRARY) as file:
        file.attrs["schema"], file.attrs["description"] = SCHEMA, _DESCRIPTION
        text = h5t.py_create(h5py.string_dtype("utf-8", len(record)))
        _put(file.id, "record", np.array(record), text, _RECORD)
        for name, array in kept.arrays.items():
            _put(file.id, name, array, h5t.IEEE_F64LE, ARRAYS.get(name, STATS))
        file.flush()
        data = bytes(file.id.get_file_image())
    return data + _tail(data)


def read(data: bytes, file: str) -> Encoded:
    """The trial in a file's content; raises `StoreError` for what another version wrote.

    Whatever else it raises means that the content is damaged.
    """
    if ends_well(data[-TAIL:]) and data[-TAIL:] != _tail(data[:-TAIL]):
        raise ValueError("its checksum differs")
    if not data:
        raise ValueError("it is empty")
    with h5py.File(h5f.open_file_image(data)) as opened:
        check_schema(opened.attrs.get("schema"), file)
        row = json.loads(_get(opened.id, "record").tobytes())
        arrays = {name: _get(opened.id, name) for name in row.pop("arrays")}
    numbers = {n: np.array(unpack(v), dtype=float) for n, v in row.pop("numbers").items()}
    return Encoded(row, numbers, arrays)


def ends_well(tail: bytes) -> bool:
    """Whether the last `TAIL` bytes are those of a whole file; its inside may still be damaged."""
    return tail.startswith(_MAGIC)


def _tail(data: bytes) -> bytes:
    return _MAGIC + b"%08x" % zlib.crc32(data)


def _put(file: Any, name: str, array: NDArray[Any], kind: Any, about: tuple[str, str]) -> None:
    space = h5s.create_simple(array.shape) if array.shape else _SCALAR
    data = h5d.create(file, None, kind, space)
    data.write(h5s.ALL, h5s.ALL, np.ascontiguousarray(array), mtype=kind)
    for key, text in zip((b"units", b"description"), about, strict=True):
        h5a.create(data, key, _TEXT, _SCALAR).write(np.array(text, dtype=object))
    h5o.link(data, file, name.encode(), lcpl=_PARENTS)


def _get(file: Any, name: str) -> NDArray[Any]:
    data = h5d.open(file, name.encode())
    array = np.empty(data.shape, data.dtype)
    data.read(h5s.ALL, h5s.ALL, array)
    return array
