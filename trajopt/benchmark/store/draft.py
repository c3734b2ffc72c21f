"""HDF5 files that are made in memory, by HDF5's own calls.

h5py's `File`, `Group` and `Dataset` make the same file, byte for byte, in three times the time.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5ds, h5f, h5g, h5p, h5s, h5t
from numpy.typing import NDArray

from trajopt.benchmark.store.columns import Block, Column
from trajopt.benchmark.store.hdf5 import SCHEMA
from trajopt.benchmark.store.seal import sealed

Filters = Callable[[Any], None]  # adds them to the plan of a dataset

_BLOCK_BYTES = 1 << 16  # by which the memory grows
_DEFLATE_LEVEL = 1  # the fastest
_DOUBLE = np.dtype("<f8")
_TEXT = h5py.string_dtype()
_TEXT_STORED = h5t.py_create(_TEXT, logical=True)
_TEXT_IN_MEMORY = h5t.py_create(_TEXT)
_ONE = h5s.create(h5s.SCALAR)


def _plan(kind: Any) -> Any:
    """How to create what: without times, so that the same trial makes the same file."""
    plan = h5p.create(kind)
    plan.set_obj_track_times(False)
    return plan


def _in_memory() -> Any:
    """How to open a file that no disk knows."""
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fapl_core(_BLOCK_BYTES, False)
    # compact, checksummed metadata that HDF5 1.10 (2016) and later read
    access.set_libver_bounds(h5f.LIBVER_V110, h5f.LIBVER_LATEST)
    access.set_fclose_degree(h5f.CLOSE_STRONG)
    return access


_IN_MEMORY = _in_memory()
_FILE = _plan(h5p.FILE_CREATE)
_GROUP = _plan(h5p.GROUP_CREATE)
_FIXED = _plan(h5p.DATASET_CREATE)

_made = count()  # no two files that are open at once may have the same name


def unfiltered(plan: Any) -> None:
    """Values are stored as they are."""


def checked(plan: Any) -> None:
    """Values are stored with a checksum."""
    plan.set_fletcher32()


def compressed(plan: Any) -> None:
    """Values are compressed, and stored with a checksum."""
    plan.set_shuffle()
    plan.set_deflate(_DEFLATE_LEVEL)
    plan.set_fletcher32()


class Draft:
    """A file of this schema that is being made.

    Attributes:
        datasets: the paths of what it has so far.
        claimed: the bytes that these take in memory.
    """

    def __init__(self, description: str) -> None:
        name = f"draft-{next(_made)}"
        self._file = h5f.create(name.encode(), h5f.ACC_EXCL, _FILE, _IN_MEMORY)
        self._groups: dict[str, Any] = {"": self._file}
        self._scales: dict[str, Any] = {}
        self.datasets: list[str] = []
        self.claimed = 0
        schema = h5a.create(self._file, b"schema", h5t.NATIVE_INT64, _ONE)
        schema.write(np.array(SCHEMA))
        _say(self._file, b"description", description)

    def __enter__(self) -> Draft:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._file.close()

    def put(self, name: str, values: NDArray[Any], about: Block | Column) -> None:
        """Values that are there to stay."""
        space = h5s.create_simple(values.shape)
        self._create(name, values, about, _FIXED, space)

    def put_growing(
        self,
        name: str,
        values: NDArray[Any],
        about: Block | Column,
        *,
        rows: int,
        filters: Filters,
    ) -> None:
        """Values that more can follow, in chunks of so many rows that pass these filters."""
        plan = _plan(h5p.DATASET_CREATE)
        rest = values.shape[1:]
        plan.set_chunk((rows, *rest))
        filters(plan)
        space = h5s.create_simple(values.shape, (h5s.UNLIMITED, *rest))
        self._create(name, values, about, plan, space)

    def append(self, name: str, values: NDArray[Any]) -> None:
        """Let these values follow those in a dataset of one axis."""
        data = self._opened(name)
        (start,) = data.shape
        end = start + len(values)
        data.set_extent((end,))
        place = data.get_space()
        place.select_hyperslab((start,), values.shape)
        data.write(h5s.create_simple(values.shape), place, values)
        self.claimed += values.nbytes

    def make_scale(self, name: str, dimension: str) -> None:
        """Make a dataset the dimension scale of those that it is attached to."""
        scale = self._opened(name)
        h5ds.set_scale(scale, dimension.encode())
        self._scales[name] = scale

    def attach(self, name: str, scale: str) -> None:
        """Let the first axis of a dataset have this scale."""
        data = self._opened(name)
        h5ds.attach_scale(data, self._scales[scale], 0)

    def content(self) -> bytes:
        """The file's bytes, sealed."""
        h5f.flush(self._file)
        return sealed(self._file.get_file_image())

    def _create(
        self,
        name: str,
        values: NDArray[Any],
        about: Block | Column,
        plan: Any,
        space: Any,
    ) -> None:
        path, _, last = name.rpartition("/")
        group = self._group(path)
        stored, memory = _types(values.dtype)
        data = h5d.create(group, last.encode(), stored, space, plan)
        data.write(h5s.ALL, h5s.ALL, np.asarray(values, order="C"), memory)
        _say(data, b"units", about.units)
        _say(data, b"description", about.text)
        self.datasets.append(name)
        self.claimed += values.nbytes

    def _opened(self, name: str) -> Any:
        """A dataset; one that stays open keeps its values in memory."""
        return h5d.open(self._file, name.encode())

    def _group(self, path: str) -> Any:
        if path not in self._groups:
            above, _, last = path.rpartition("/")
            parent = self._group(above)
            self._groups[path] = h5g.create(parent, last.encode(), None, _GROUP)
        return self._groups[path]


def _say(about: Any, name: bytes, text: str) -> None:
    """Let a dataset or the file have an attribute."""
    attribute = h5a.create(about, name, _TEXT_STORED, _ONE)
    attribute.write(np.array(text, dtype=_TEXT), _TEXT_IN_MEMORY)


def _types(kind: np.dtype[Any]) -> tuple[Any, Any]:
    """HDF5's types for values in the file, and for them in memory."""
    if kind == _DOUBLE:  # nearly all: known at once
        return h5t.IEEE_F64LE, h5t.IEEE_F64LE
    return h5t.py_create(kind, logical=True), h5t.py_create(kind)
