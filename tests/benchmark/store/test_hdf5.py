"""What HDF5 would take memory for is refused before it is read."""

from __future__ import annotations

import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from trajopt.benchmark.store.hdf5 import Source
from trajopt.benchmark.store.seal import Malformed

FILTERS = {"compression": 1, "shuffle": True, "fletcher32": True}  # ours


def chunk_that_holds(path: Path, count: int) -> Source:
    """A file of a dataset of 4 numbers in one chunk, which is stored as `count` zeros."""
    with h5py.File(path, "w") as file:
        data = file.create_dataset("x", shape=(4,), dtype="f8", chunks=(4,), **FILTERS)  # type: ignore[arg-type]
        checksum = b"\0\0\0\0"  # of zeros
        data.id.write_direct_chunk((0,), zlib.compress(bytes(8 * count)) + checksum)
    return Source(h5py.h5f.open(str(path).encode(), h5py.h5f.ACC_RDONLY), path.stat().st_size)


def test_a_chunk_that_inflates_beyond_its_size_is_refused(tmp_path: Path) -> None:
    assert chunk_that_holds(tmp_path / "right.h5", 4)._dataset("x", 1).size == 32
    with pytest.raises(Malformed, match="x: a chunk that inflates beyond 32 bytes"):
        chunk_that_holds(tmp_path / "wrong.h5", 5).numbers("x")


def test_a_dataset_in_another_file_is_never_read(tmp_path: Path) -> None:
    np.arange(4.0).tofile(tmp_path / "secret")
    path = tmp_path / "outside.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset(
            "x", shape=(4,), dtype="f8", external=[(str(tmp_path / "secret"), 0, 32)]
        )
    source = Source(h5py.h5f.open(str(path).encode(), h5py.h5f.ACC_RDONLY), 10_000)
    with pytest.raises(Malformed, match="another file"):
        source.numbers("x")
