"""`results.h5`: every trial of a folder, for people and other programs, and as it is kept.

- `trials/` has a dataset for each field (`fields.py`), one entry per trial, with `id` as their
  dimension scale, `units` and a `description`;
- `texts` has the trials' own texts (`trial_text.py`) in the same order, each ended by a zero byte.

The fastest trajectory, with plain h5py:

    with h5py.File("results/results.h5") as file:
        best = int(np.nanargmin(file["trials/certified_duration"]))
        texts = file["texts"][()].tobytes().split(b"\\0")
    trajectory = json.loads(texts[best])["solution"]["trajectory"]
    fastest = PPoly(trajectory["coefficients"], trajectory["breaks"])

This package reads nothing but `texts`, which must lie in the very file, in chunks whose size is
known. So it takes no more memory than a text, whatever a stranger's file claims. The first text
that states no identity, or that of another one, ends it: nobody can make a small file that takes
minutes. The file ends
with a seal: the mark `trajopt4` and the SHA-256 of all bytes before it, which HDF5 ignores.
"""

from __future__ import annotations

import hashlib
import os
import re
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.store import fields
from trajopt.benchmark.store.document import Malformed, pack
from trajopt.benchmark.store.fields import FIELDS
from trajopt.benchmark.store.trial_text import MAX_BYTES, SCHEMA, WrongSchema, stated_id
from trajopt.benchmark.trial import Trial

_MARK = f"trajopt{SCHEMA}".encode()
_SEAL_BYTES = len(_MARK) + 32  # of SHA-256
_OTHER_MARK = re.compile(rb"trajopt\d")
_BLOCK_BYTES = 1 << 20
_CHUNK_BYTES = 1 << 18  # of texts, inflated at once
_END = b"\0"  # ends a text; JSON never holds this character
_FILTERS: dict[str, Any] = {"compression": 1, "shuffle": True, "fletcher32": True}
_DESCRIPTION = "trials of minimum-time planners, each judged by the verifier"
_TEXTS = "the trials' texts, JSON in UTF-8, in the order of trials/id, each ended by a zero byte"


# --- writing ---


def content(trials: Sequence[Trial], texts: Sequence[bytes]) -> bytes:
    """Return the file's bytes. It is made in memory: HDF5 may crash on a full disk."""
    import h5py  # late, here and below: takes long to import

    joined = b"".join(text + _END for text in texts)
    columns = fields.columns(trials)
    with h5py.File.in_memory(libver="v110") as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["description"] = _DESCRIPTION
        for field in FIELDS:
            column = columns[field.name]
            if not isinstance(column, np.ndarray):
                column = _texts(pack(column))
            filters = _FILTERS if len(trials) and column.dtype.kind != "O" else {}
            data = file.create_dataset(f"trials/{field.name}", data=column, **filters)
            data.attrs["units"] = field.unit
            data.attrs["description"] = field.meaning
        scale = file["trials/id"]
        scale.make_scale("trial")
        for field in FIELDS:
            if field.name != "id":
                file[f"trials/{field.name}"].dims[0].attach_scale(scale)
        data = file.create_dataset(
            "texts",
            data=np.frombuffer(joined, np.uint8),
            chunks=(_CHUNK_BYTES,),
            maxshape=(None,),
            compression=1,
        )
        data.attrs["units"] = ""
        data.attrs["description"] = _TEXTS
        file.flush()
        return sealed(file.id.get_file_image())


def sealed(data: bytes) -> bytes:
    """Return the bytes with their seal."""
    return data + _MARK + hashlib.sha256(data).digest()


def _texts(texts: Sequence[str]) -> NDArray[Any]:
    """Texts of one length, which compress, unless one of them is much longer than the others."""
    import h5py

    encoded = [text.encode() for text in texts]
    sizes = [len(text) for text in encoded]
    longest = max(sizes, default=0) or 1
    padded = longest * len(encoded)
    allowed = max(_PADDED_BYTES, _PADDED_RATIO * sum(sizes))
    if padded > allowed:
        return np.array(encoded, dtype=h5py.string_dtype())
    return np.array(encoded, dtype=h5py.string_dtype("utf-8", longest))


_PADDED_BYTES = 1 << 22  # padded texts may take this much,
_PADDED_RATIO = 4  # or this much more than without padding


# --- reading ---


def read(path: Path) -> Iterator[bytes]:
    """Yield the trials' texts.

    Raises:
        WrongSchema: Another version wrote the file.
        Exception: Any other error means that the file is damaged, or not ours.
    """
    check_seal(path)
    import h5py

    with h5py.File(path, "r", locking=False) as file:
        rest = b""
        known = set()
        for block in _blocks(h5py, file):
            *whole, rest = (rest + block).split(_END)
            if len(rest) > MAX_BYTES:
                raise Malformed(f"texts: one has more than {MAX_BYTES / 1e6:g} MB")
            for text in whole:
                trial_id = stated_id(text)
                if trial_id in known:
                    raise Malformed(f"texts: two of trial {trial_id}")
                known.add(trial_id)
                yield text
    if rest:
        raise Malformed("texts: the last one has no end")


def check_schema(path: Path) -> None:
    """Raise `WrongSchema` for a file that another version wrote; other files are not looked at."""
    if path.is_file():
        with path.open("rb") as stream:
            _own_seal(path, stream)


def _blocks(h5py: Any, file: Any) -> Iterator[bytes]:
    """Yield the bytes of `texts`, chunk by chunk.

    Each chunk is inflated here: HDF5 would take as much memory as a chunk claims.
    """
    if not isinstance(file.get("texts", getlink=True), h5py.HardLink):
        raise Malformed("texts: expected a dataset in this very file")
    data = file["texts"]
    if not isinstance(data, h5py.Dataset):
        raise Malformed("texts: expected a dataset")
    if data.dtype != np.uint8 or data.ndim != 1:
        raise Malformed("texts: expected bytes")
    plan = data.id.get_create_plist()
    filters = []
    for place in range(plan.get_nfilters()):
        kind, *_ = plan.get_filter(place)
        filters.append(kind)
    if data.chunks != (_CHUNK_BYTES,) or filters != [h5py.h5z.FILTER_DEFLATE]:
        raise Malformed("texts: expected deflated chunks of this program's size")
    for start in range(0, len(data), _CHUNK_BYTES):
        skipped, block = data.id.read_direct_chunk((start,))
        if not skipped:
            block = zlib.decompressobj().decompress(block, _CHUNK_BYTES + 1)
        if len(block) != _CHUNK_BYTES:
            raise Malformed("texts: a chunk that is not of its size")
        yield block[: len(data) - start]


def check_seal(path: Path) -> None:
    """Compute the seal anew: HDF5 never sees a file that was damaged."""
    with path.open("rb") as stream:
        stated = _own_seal(path, stream)
        left = stream.seek(0, os.SEEK_END) - _SEAL_BYTES
        stream.seek(0)
        digest = hashlib.sha256()
        while left > 0:
            block = stream.read(min(left, _BLOCK_BYTES))
            digest.update(block)
            left -= len(block)
    if digest.digest() != stated:
        raise Malformed("its checksum differs or is missing: it was damaged, cut or edited")


def _own_seal(path: Path, stream: BinaryIO) -> bytes:
    """The digest at the end of the file; nothing where there is no seal."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - _SEAL_BYTES))
    tail = stream.read()
    if tail.startswith(_MARK):
        return tail[len(_MARK) :]
    if _OTHER_MARK.search(tail):
        raise WrongSchema(str(path))
    return b""
