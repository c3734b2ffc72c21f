"""HDF5 files that are read without trusting who made them.

A stranger can seal what he made up (`seal` says when a file was damaged or edited), therefore
nothing outside of the file is ever read (no links, no external or virtual data, no filter that
would have to be loaded), only the declared types and shapes are, nothing is unpickled, and the
memory to read it all is bounded by the size of the file.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import product, repeat
from math import prod
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5f, h5g, h5l, h5o, h5p, h5s, h5t, h5z
from numpy.typing import NDArray

from trajopt.benchmark.store import seal
from trajopt.benchmark.store.columns import Array, Malformed, naming
from trajopt.core.exceptions import StoreError

SCHEMA = 3  # raise it whenever a reader of this version could misread the file
_READABLE = (2, 3)

_ALLOWANCE_BYTES = 1 << 24  # what the datasets of a file may take, however small it is,
_ALLOWANCE_RATIO = 100  # and besides, times its size

_DOUBLE = np.dtype("<f8")
_FILTERS = {
    (),
    (h5z.FILTER_FLETCHER32,),
    (h5z.FILTER_SHUFFLE, h5z.FILTER_DEFLATE, h5z.FILTER_FLETCHER32),
}


def _unlocked() -> Any:
    """How to open files that are replaced, but never changed."""
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_file_locking(False, False)
    return access


_UNLOCKED = _unlocked()


class WrongSchema(StoreError):
    """A file that another version wrote and this one does not read."""


@contextmanager
def opened(path: Path) -> Iterator[Source]:
    """The file's datasets, once its seal and its schema are those of a file of ours.

    Raises:
        WrongSchema: for what another version wrote.
        Malformed: if it was damaged or edited.
    """
    has_seal = seal.is_right(path)
    file = h5f.open(os.fsencode(path), h5f.ACC_RDONLY, _UNLOCKED)
    source = Source(file, path.stat().st_size)
    try:
        _check_schema(path, file, has_seal)
        yield source
    except BaseException:
        h5py.File(file).close()  # whatever the error's traceback still holds of it
        raise
    source.close()


def _check_schema(path: Path, file: Any, has_seal: bool) -> None:
    schema = _schema(file)
    if schema not in _READABLE:
        mend = "run again into another folder"
        if schema > SCHEMA:
            mend = "upgrade trajopt"
        words = f"written with schema {schema}, this reads {SCHEMA}; {mend}"
        raise WrongSchema(f"{path}: {words}")
    if schema > 2 and not has_seal:
        raise Malformed("its checksum is missing, it was cut or edited")


def _schema(file: Any) -> int:
    if not h5a.exists(file, b"schema"):
        raise Malformed("it has no schema")
    attribute = h5a.open(file, b"schema")
    space = attribute.get_space()
    kind = attribute.get_type()
    if space.get_simple_extent_type() != h5s.SCALAR or kind.get_class() != h5t.INTEGER:
        raise Malformed("attribute schema: expected a whole number")
    schema = np.zeros((), np.int64)
    attribute.read(schema, h5t.NATIVE_INT64)
    return int(schema)


def allowance(size: int) -> int:
    """Bytes that the datasets of a file of this size may take in memory."""
    return _ALLOWANCE_BYTES + _ALLOWANCE_RATIO * size


class Source:
    """The datasets of one file, each checked before any of its content is read.

    By HDF5's own calls: h5py's `Group` and `Dataset` take four times as long.
    """

    def __init__(self, file: Any, size: int) -> None:
        self._found: dict[str, Any] = {"": file}  # by path, each reached without a link
        self._left = allowance(size)

    def __contains__(self, name: str) -> bool:
        return self._at(name) is not None

    def close(self) -> None:
        """Give the file back: HDF5 keeps it for as long as anything of it is in use."""
        file = self._found.pop("")
        self._found.clear()
        file.close()

    def names(self, group: str) -> list[str]:
        """What lies in a group; nothing if there is none."""
        found = self._at(group)
        if not isinstance(found, h5g.GroupID):
            return []
        return [name.decode() for name in found]

    def numbers(self, name: str, axes: int | None = None) -> Array:
        """Floating-point numbers, with so many axes."""
        data = self._dataset(name, axes)
        if data.kind.kind != "f":
            raise Malformed(f"{name}: expected floating-point numbers, found {data.kind}")
        return np.asarray(data.values(), dtype=float)

    def integers(self, name: str, axes: int) -> list[Any]:
        """Whole numbers, as nested lists of as many axes."""
        data = self._dataset(name, axes)
        if data.kind.kind != "i":
            raise Malformed(f"{name}: expected whole numbers, found {data.kind}")
        found: list[Any] = data.values().tolist()
        return found

    def texts(self, name: str) -> list[str]:
        """A column of texts in UTF-8."""
        data = self._dataset(name, 1)
        text = h5py.check_string_dtype(data.kind)
        if text is None:
            raise Malformed(f"{name}: expected text, found {data.kind}")
        if text.length is not None:
            encoded = data.values().tolist()
        else:
            encoded = []
            rows = h5py.Dataset(data.id)
            for row in range(len(rows)):  # of any length: each may claim all that the file holds
                one = rows[row]
                self._spend(name, len(one))
                encoded.append(one)
        with naming(name):
            return [one.decode() for one in encoded]

    def text(self, name: str) -> str:
        """A single text in UTF-8."""
        data = self._dataset(name, 0)
        if data.kind.kind != "S":
            raise Malformed(f"{name}: expected text of a fixed length, found {data.kind}")
        encoded: bytes = data.values().item()
        with naming(name):
            return encoded.decode()

    def _at(self, path: str) -> Any:
        """What lies at a path within this very file, `None` where nothing does."""
        if path not in self._found:
            parent, _, name = path.rpartition("/")
            self._found[path] = _child(self._at(parent), name, path)
        return self._found[path]

    def _dataset(self, name: str, axes: int | None) -> _Dataset:
        found = self._at(name)
        if not isinstance(found, h5d.DatasetID):
            raise Malformed(f"{name}: expected a dataset")
        space = found.get_space()
        if space.get_simple_extent_type() == h5s.NULL:
            raise Malformed(f"{name}: expected {axes} axes, found nothing")
        shape = space.get_simple_extent_dims()
        if axes not in (None, len(shape)):
            raise Malformed(f"{name}: expected {axes} axes, found shape {shape}")
        data = _Dataset.of(found, shape)
        self._spend(name, data.size)
        if found.get_offset() is None:  # not simply one after the other in this very file
            _check_storage(name, data)
        return data

    def _spend(self, name: str, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise Malformed(f"{name}: claims {size} bytes, more than such a file can hold")


@dataclass(frozen=True)
class _Dataset:
    """A dataset of a file, with the type and the shape of its values.

    `memory` is their type in memory, where HDF5 need not find that out.
    """

    id: Any
    kind: np.dtype[Any]
    shape: tuple[int, ...]
    memory: Any

    @classmethod
    def of(cls, found: Any, shape: tuple[int, ...]) -> _Dataset:
        """Nearly all are doubles: their type is known at once."""
        stored = found.get_type()
        if stored.equal(h5t.IEEE_F64LE):
            return cls(found, _DOUBLE, shape, h5t.IEEE_F64LE)
        return cls(found, stored.dtype, shape, None)

    @property
    def size(self) -> int:
        """In bytes."""
        return prod(self.shape) * self.kind.itemsize

    def values(self) -> NDArray[Any]:
        """All of them."""
        found = np.empty(self.shape, self.kind)
        self.id.read(h5s.ALL, h5s.ALL, found, self.memory)
        return found


def _child(group: Any, name: str, path: str) -> Any:
    encoded = name.encode()
    if not isinstance(group, h5g.GroupID):
        return None
    if not group.links.exists(encoded):
        return None
    link = group.links.get_info(encoded)
    if link.type != h5l.TYPE_HARD:
        raise Malformed(f"{path}: a link to elsewhere, which is never followed")
    return h5o.open(group, encoded)


def _check_storage(name: str, data: _Dataset) -> None:
    """Where and how the values are stored: in this file, by no filters but ours."""
    plan = data.id.get_create_plist()
    layout = plan.get_layout()
    if layout == h5d.VIRTUAL or plan.get_external_count():
        raise Malformed(f"{name}: its data lie in another file, which is never read")
    count = plan.get_nfilters()
    filters = tuple(plan.get_filter(i)[0] for i in range(count))
    if filters not in _FILTERS:
        raise Malformed(f"{name}: filters {filters} are not this program's")
    if layout != h5d.CHUNKED:
        return
    chunk = plan.get_chunk()
    _check_chunk_size(name, data, chunk)
    if data.size and h5z.FILTER_DEFLATE in filters:
        place = filters.index(h5z.FILTER_DEFLATE)
        _check_inflation(name, data, chunk, skipped=1 << place)


def _check_chunk_size(name: str, data: _Dataset, chunk: tuple[int, ...]) -> None:
    """HDF5 allocates whole chunks, also of a dataset that is smaller than one."""
    size = prod(chunk) * data.kind.itemsize
    if size > max(_ALLOWANCE_BYTES, data.size):
        raise Malformed(f"{name}: chunks of {size} bytes, more than such a file can hold")


def _check_inflation(name: str, data: _Dataset, chunk: tuple[int, ...], skipped: int) -> None:
    """HDF5 allocates whatever a chunk inflates to, unless its mask has the bit `skipped`."""
    size = prod(chunk) * data.kind.itemsize
    starts = map(range, repeat(0), data.shape, chunk)
    for start in product(*starts):
        mask, stored = data.id.read_direct_chunk(start)
        if mask & skipped:
            continue
        inflated = zlib.decompressobj().decompress(stored, size + 1)
        if len(inflated) > size:
            raise Malformed(f"{name}: a chunk that inflates beyond {size} bytes")
