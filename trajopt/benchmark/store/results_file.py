"""`results.h5`: every trial of a folder, for people and other programs, and as it is kept.

- `problems/`, `runs/` and `trials/` are for people (`layout.py`): any HDF5 tool finds a number by
  its name, with its unit;
- `texts` has the trials' own texts (`trial_text.py`), each ended by a zero byte.

The fastest trajectory, with plain h5py:

    with h5py.File("results/results.h5") as file:
        best = int(np.nanargmin(file["trials/certified_duration"]))
        motion = file[file["trials/path"].asstr()[best]]["trajectory"]
        fastest = PPoly(motion["coefficients"][()], motion["breaks"][()])

This package reads nothing but `texts`, which must lie in the very file, in chunks whose size is
known. So it takes no more memory than a text, whatever a stranger's file claims. The first text
that states no identity, or that of another one, ends it: nobody can make a small file that takes
minutes. `differences` compares everything else with what the texts give. The file ends
with a seal: the mark `trajopt4` and the SHA-256 of all bytes before it, which HDF5 ignores.
"""

from __future__ import annotations

import hashlib
import os
import re
import shlex
import sys
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from trajopt.benchmark.provenance import provenance
from trajopt.benchmark.store import layout
from trajopt.benchmark.store.document import Malformed
from trajopt.benchmark.store.layout import Data, Group, References
from trajopt.benchmark.store.trial_text import MAX_BYTES, SCHEMA, WrongSchema, stated_id
from trajopt.benchmark.trial import Trial, now
from trajopt.core import files
from trajopt.core.harmless import harmless

_MARK = f"trajopt{SCHEMA}".encode()
_SEAL_BYTES = len(_MARK) + 32  # of SHA-256
_OTHER_MARK = re.compile(rb"trajopt\d")
_BLOCK_BYTES = 1 << 20
_CHUNK_BYTES = 1 << 18  # of texts, inflated at once
_END = b"\0"  # ends a text; JSON never holds this character
_TITLE = "trials of minimum-time planners, each judged by the verifier"
_TEXTS = "the trials' texts, JSON in UTF-8, in the order of trials/id, each ended by a zero byte"
_TEXT_BYTES = 1 << 26  # of texts that are read at once


# --- writing ---


def content(
    trials: Sequence[Trial], texts: Sequence[bytes], references: References | None = None
) -> bytes:
    """Return the file's bytes. It is made in memory: HDF5 may crash on a full disk.

    Args:
        trials: In the order of their texts.
        texts: As `trial_text.write` makes them.
        references: What gaps are measured against; None: they are NaN.
    """
    import h5py  # late, here and below: takes long to import

    joined = b"".join(text + _END for text in texts)
    with h5py.File.in_memory(libver="v110") as file:
        file.attrs.update(_about())
        _write(file, layout.tree(trials, references), h5py.string_dtype())
        scale = file["trials/id"]
        scale.make_scale("trial")
        for name, data in file["trials"].items():
            if name != "id":
                data.dims[0].attach_scale(scale)
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


def _about() -> dict[str, Any]:
    """Return the attributes of the file."""
    program, *arguments = sys.argv or [""]
    about = {name: provenance()[name] for name in ("mintime", "commit")}
    return {
        "title": _TITLE,
        "command": harmless(shlex.join([Path(program).name, *arguments])),
        "created": now(),
        **about,
        "schema": SCHEMA,
    }


def _write(place: Any, group: Group, text: Any) -> None:
    """Write a group's attributes and members; `text` is the type of texts."""
    for name, value in group.attributes.items():
        place.attrs[name] = value
    for name, member in group.members.items():
        if isinstance(member, Group):
            _write(place.create_group(name), member, text)
            continue
        kind = None if isinstance(member.values, np.ndarray) else text
        data = place.create_dataset(name, data=member.values, dtype=kind)
        data.attrs["units"] = member.units
        if member.description:
            data.attrs["description"] = member.description


def sealed(data: bytes) -> bytes:
    """Return the bytes with their seal."""
    return data + _MARK + hashlib.sha256(data).digest()


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
        with files.opened(path) as stream:
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


# --- comparing ---


def differences(path: Path, trials: Sequence[Trial], references: References) -> list[str]:
    """Name the datasets and attributes that are not what the trials give.

    Args:
        path: Of a file whose texts are those of the trials.
        trials: In the order of the texts.
        references: What gaps are measured against.

    Raises:
        Exception: The file is damaged.
    """
    check_seal(path)
    import h5py

    expected = layout.tree(trials, references)
    rows = max(1, _TEXT_BYTES // path.stat().st_size)
    with h5py.File(path, "r", locking=False) as file:
        if "runs" not in file:  # of version 0.2, which wrote none
            return []
        return list(_differing(h5py, file, expected, "", rows))


def _differing(h5py: Any, place: Any, group: Group, path: str, rows: int) -> Iterator[str]:
    """Yield what differs below a group that is in the very file."""
    for name, value in group.attributes.items():
        if not _same_attribute(place, name, value):
            yield f"{path}: {name}"
    known = {*group.members, *(() if path else ("texts",))}
    for name in sorted(known ^ set(place)):
        yield f"{path}/{name}"
    for name, member in group.members.items():
        if name not in place:
            continue
        own = f"{path}/{name}"
        is_here = isinstance(place.get(name, getlink=True), h5py.HardLink)
        kind = h5py.Group if isinstance(member, Group) else h5py.Dataset
        if not is_here or place.get(name, getclass=True) is not kind:
            yield own
        elif isinstance(member, Group):
            yield from _differing(h5py, place[name], member, own, rows)
        elif not _same_data(place[name], member, rows):
            yield own


def _same_data(data: Any, expected: Data, rows: int) -> bool:
    """Return whether a dataset has these values and this unit; nothing larger is read."""
    values = expected.values
    shape = np.shape(values)
    if data.shape != shape or data.chunks or data.external or data.is_virtual:
        return False  # a chunk may inflate to any size
    if not _same_attribute(data, "units", expected.units):
        return False
    if isinstance(values, np.ndarray):
        return data.dtype == values.dtype and _close(data[()], values)
    if (data.dtype.metadata or {}).get("vlen") is not str:
        return False
    texts = data.asstr()
    # a forged row may be as long as the file
    starts = range(0, len(values), rows)
    return all(list(texts[i : i + rows]) == values[i : i + rows] for i in starts)


def _same_attribute(place: Any, name: str, expected: Any) -> bool:
    if name not in place.attrs or place.attrs.get_id(name).shape != np.shape(expected):
        return False
    found = place.attrs[name]
    if isinstance(expected, float):
        return isinstance(found, float) and _close(found, expected)
    return bool(np.all(found == expected))


def _close(found: Any, expected: Any) -> bool:
    return np.allclose(found, expected, rtol=_SAME_RTOL, atol=0.0, equal_nan=True)


_SAME_RTOL = 1e-9  # another machine rounds otherwise


# --- the seal ---


def check_seal(path: Path) -> None:
    """Compute the seal anew: HDF5 never sees a file that was damaged."""
    with files.opened(path) as stream:
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
