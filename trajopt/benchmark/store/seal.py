"""Files that say when they were damaged.

A file ends with a seal, `trajopt3` and the SHA-256 of all bytes before it, which HDF5 ignores. Who
edits a file breaks its seal: every reader notices.
"""

from __future__ import annotations

import hashlib
import os
import zlib
from pathlib import Path
from typing import BinaryIO

from trajopt.benchmark.store.columns import Malformed

_MARK = b"trajopt3"
_SEAL_BYTES = len(_MARK) + 32  # of SHA-256
_MARK_2 = b"trajopt2"  # schema 2: only trial files, with CRC-32 as hexadecimal digits
_SEAL_2_BYTES = len(_MARK_2) + 8
_BLOCK_BYTES = 1 << 20


def sealed(data: bytes) -> bytes:
    """The same with its seal."""
    digest = hashlib.sha256(data).digest()
    return data + _MARK + digest


def ends_sealed(path: Path) -> bool:
    """Whether the file ends with a seal, right or wrong: quickly found, and no cut file does."""
    with path.open("rb") as stream:
        tail = _tail(stream)
    end = tail[-_SEAL_2_BYTES:]
    return tail.startswith(_MARK) or end.startswith(_MARK_2)


def is_right(path: Path) -> bool:
    """Whether the file has a seal; raises `Malformed` if that is another file's."""
    with path.open("rb") as stream:
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


def _tail(stream: BinaryIO) -> bytes:
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - _SEAL_BYTES))
    return stream.read()


def _sha256(stream: BinaryIO, size: int) -> bytes:
    """Of the first `size` bytes, little by little."""
    stream.seek(0)
    digest = hashlib.sha256()
    while size > 0:
        block = stream.read(min(size, _BLOCK_BYTES))
        digest.update(block)
        size -= len(block)
    return digest.digest()
