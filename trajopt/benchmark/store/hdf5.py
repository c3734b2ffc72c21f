"""HDF5 files that say when they were damaged, and that are read without trusting who made them.

A file ends with a seal, `trajopt3` and the SHA-256 of all bytes before it, which HDF5 ignores. Who
edits a file breaks its seal: every reader notices. A stranger can seal what he made up, therefore
nothing outside of the file is ever read (no links, no external or virtual data, no filter that
would have to be loaded), only the declared types and shapes are, nothing is unpickled, and the
memory to read it all is bounded by the size of the file.
"""

from __future__ import annotations

import hashlib
import os
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any, BinaryIO

import h5py
import numpy as np
from h5py import h5d, h5z

from trajopt.benchmark.store.columns import Array, Malformed, naming
from trajopt.exceptions import StoreError

SCHEMA = 3  # raise it whenever a reader of this version could misread the file
_READABLE = (2, 3)
LIBRARY = "v110"  # compact, checksummed metadata that HDF5 1.10 (2016) and later read

_MARK = b"trajopt3"
_SEAL_BYTES = len(_MARK) + hashlib.sha256().digest_size
_MARK_2 = b"trajopt2"  # schema 2: only trial files, with CRC-32 as hexadecimal digits
_SEAL_2_BYTES = len(_MARK_2) + 8

_ALLOWANCE_BYTES = 1 << 24  # what the datasets of a file may take, however small it is,
_ALLOWANCE_RATIO = 100  # and besides, times its size

_FILTERS = {
    (),
    (h5z.FILTER_FLETCHER32,),
    (h5z.FILTER_SHUFFLE, h5z.FILTER_DEFLATE, h5z.FILTER_FLETCHER32),
}


class WrongSchema(StoreError):
    """A file that another version wrote and this one does not read."""


def content(file: h5py.File) -> bytes:
    """The bytes of a file in memory, sealed."""
    file.flush()
    data: bytes = file.id.get_file_image()
    return sealed(data)


def sealed(data: bytes) -> bytes:
    """The same with its seal."""
    return data + _MARK + hashlib.sha256(data).digest()


def ends_sealed(path: Path) -> bool:
    """Whether the file ends with a seal, right or wrong: quickly found, and no cut file does."""
    with path.open("rb") as stream:
        tail = _tail(stream)
    end = tail[-_SEAL_2_BYTES:]
    return tail.startswith(_MARK) or end.startswith(_MARK_2)


@contextmanager
def opened(path: Path) -> Iterator[Source]:
    """The file's datasets, once its seal and its schema are those of a file of ours.

    Raises:
        WrongSchema: for what another version wrote.
        Malformed: if it was damaged or edited.
    """
    with path.open("rb") as stream:
        has_seal = _is_seal_right(stream)
    with h5py.File(path, locking=False) as file:  # files are replaced, never changed
        schema = _schema(file)
        if schema not in _READABLE:
            mend = "run again into another folder"
            if schema > SCHEMA:
                mend = "upgrade trajopt"
            words = f"written with schema {schema}, this reads {SCHEMA}; {mend}"
            raise WrongSchema(f"{path}: {words}")
        if schema > 2 and not has_seal:
            raise Malformed("its checksum is missing, it was cut or edited")
        yield Source(file, path.stat().st_size)


def _tail(stream: BinaryIO) -> bytes:
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - _SEAL_BYTES))
    return stream.read()


def _is_seal_right(stream: BinaryIO) -> bool:
    """Whether there is a seal; raises `Malformed` if it is another file's."""
    tail = _tail(stream)
    size = stream.tell()
    if tail.startswith(_MARK):
        digest = _sha256(stream, size - _SEAL_BYTES)
        right = tail[len(_MARK) :] == digest
    elif tail[-_SEAL_2_BYTES:].startswith(_MARK_2):
        stream.seek(0)
        crc = zlib.crc32(stream.read(size - _SEAL_2_BYTES))
        right = tail[-8:] == b"%08x" % crc
    else:
        return False
    if not right:
        raise Malformed("its checksum differs, it was damaged or edited")
    return True


def _sha256(stream: BinaryIO, size: int) -> bytes:
    """Of the first `size` bytes, little by little."""
    stream.seek(0)
    digest = hashlib.sha256()
    while size > 0:
        block = stream.read(min(size, 1 << 20))
        digest.update(block)
        size -= len(block)
    return digest.digest()


def _schema(file: h5py.File) -> int:
    if "schema" not in file.attrs:
        raise Malformed("it has no schema")
    attribute = file.attrs.get_id("schema")
    if attribute.shape != () or attribute.dtype.kind not in "iu":
        raise Malformed("attribute schema: expected a whole number")
    return int(file.attrs["schema"])


def allowance(size: int) -> int:
    """Bytes that the datasets of a file of this size may take in memory."""
    return _ALLOWANCE_BYTES + _ALLOWANCE_RATIO * size


def claimed(file: h5py.File) -> int:
    """Bytes that all datasets of a file take in memory."""
    found: list[Any] = []
    file.visititems(lambda _, item: found.append(item))
    return sum(item.nbytes for item in found if isinstance(item, h5py.Dataset))


class Source:
    """The datasets of one file, each checked before any of its content is read."""

    def __init__(self, file: h5py.File, size: int) -> None:
        self._found: dict[str, Any] = {"": file}  # by path, each reached without a link
        self._left = allowance(size)

    def __contains__(self, name: str) -> bool:
        return self._at(name) is not None

    def names(self, group: str) -> list[str]:
        """What lies in a group; nothing if there is none."""
        found = self._at(group)
        return list(found) if isinstance(found, h5py.Group) else []

    def numbers(self, name: str, axes: int | None = None) -> Array:
        """Floating-point numbers, with so many axes."""
        data = self._dataset(name, axes)
        if data.dtype.kind != "f":
            raise Malformed(f"{name}: expected floating-point numbers, found {data.dtype}")
        return np.asarray(data[()], dtype=float)

    def integers(self, name: str, axes: int) -> list[Any]:
        """Whole numbers, as nested lists of as many axes."""
        data = self._dataset(name, axes)
        if data.dtype.kind != "i":
            raise Malformed(f"{name}: expected whole numbers, found {data.dtype}")
        found: list[Any] = data[()].tolist()
        return found

    def texts(self, name: str) -> list[str]:
        """A column of texts in UTF-8."""
        data = self._dataset(name, 1)
        kind = h5py.check_string_dtype(data.dtype)
        if kind is None:
            raise Malformed(f"{name}: expected text, found {data.dtype}")
        if kind.length is not None:
            encoded = data[()].tolist()
        else:
            encoded = []
            for row in range(len(data)):  # of any length: each may claim all that the file holds
                text = data[row]
                self._spend(name, len(text))
                encoded.append(text)
        with naming(name):
            return [text.decode() for text in encoded]

    def text(self, name: str) -> str:
        """A single text in UTF-8."""
        data = self._dataset(name, 0)
        if data.dtype.kind != "S":
            raise Malformed(f"{name}: expected text of a fixed length, found {data.dtype}")
        with naming(name):
            return bytes(data[()]).decode()

    def _at(self, path: str) -> Any:
        """What lies at a path within this very file, `None` where nothing does."""
        if path not in self._found:
            parent, _, name = path.rpartition("/")
            self._found[path] = _child(self._at(parent), name, path)
        return self._found[path]

    def _dataset(self, name: str, axes: int | None) -> h5py.Dataset:
        data = self._at(name)
        if not isinstance(data, h5py.Dataset):
            raise Malformed(f"{name}: expected a dataset")
        plan = data.id.get_create_plist()
        if plan.get_layout() == h5d.VIRTUAL or plan.get_external_count():
            raise Malformed(f"{name}: its data lie in another file, which is never read")
        count = plan.get_nfilters()
        filters = tuple(plan.get_filter(i)[0] for i in range(count))
        if filters not in _FILTERS:
            raise Malformed(f"{name}: filters {filters} are not this program's")
        if data.shape is None or axes not in (None, data.ndim):
            raise Malformed(f"{name}: expected {axes} axes, found shape {data.shape}")
        self._spend(name, data.size * data.dtype.itemsize)
        if data.chunks:
            _check_chunk_size(name, data)
        if data.size and h5z.FILTER_DEFLATE in filters:
            place = filters.index(h5z.FILTER_DEFLATE)
            _check_inflation(name, data, skipped=1 << place)
        return data

    def _spend(self, name: str, size: int) -> None:
        self._left -= size
        if self._left < 0:
            raise Malformed(f"{name}: claims {size} bytes, more than such a file can hold")


def _child(group: Any, name: str, path: str) -> Any:
    if not isinstance(group, h5py.Group):
        return None
    link = group.get(name, getlink=True)
    if link is None:
        return None
    if not isinstance(link, h5py.HardLink):
        raise Malformed(f"{path}: a link to elsewhere, which is never followed")
    return group[name]


def _check_chunk_size(name: str, data: h5py.Dataset) -> None:
    """HDF5 allocates whole chunks, also of a dataset that is smaller than one."""
    size = prod(data.chunks) * data.dtype.itemsize
    if size > max(_ALLOWANCE_BYTES, data.size * data.dtype.itemsize):
        raise Malformed(f"{name}: chunks of {size} bytes, more than such a file can hold")


def _check_inflation(name: str, data: h5py.Dataset, skipped: int) -> None:
    """HDF5 allocates whatever a chunk inflates to, unless its mask has the bit `skipped`."""
    size = prod(data.chunks) * data.dtype.itemsize
    for part in data.iter_chunks():
        start = tuple(side.start for side in part)
        mask, stored = data.id.read_direct_chunk(start)
        if mask & skipped:
            continue
        inflated = zlib.decompressobj().decompress(stored, size + 1)
        if len(inflated) > size:
            raise Malformed(f"{name}: a chunk that inflates beyond {size} bytes")
