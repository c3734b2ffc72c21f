"""Groups, columns and attributes, against h5py's usual calls."""

from __future__ import annotations

from typing import Any

import h5py
import numpy as np

from trajopt.benchmark.store.hdf5 import Columns, Writer

COLUMNS = {
    "numbers": np.arange(12.0).reshape(3, 4)[:, ::2],
    "whole": np.array([3, 5], dtype=np.int64),
    "none": np.zeros((2, 0, 3)),
    "texts": np.array(["q1", "Gelenk ä"], dtype=object),
    "bytes": np.array([b"q1", b"\xc3\xa4"], dtype=object),
}
ATTRIBUTES = {"name": "Arm ä", "labels": ["q1", "q2"], "duration": 1.5, "none": float("nan")}


def _image(fill: Any) -> bytes:
    with h5py.File("x.h5", "w", driver="core", backing_store=False) as file:
        fill(file)
        file.flush()
        image: bytes = file.id.get_file_image()
        return image


def test_the_bytes_are_those_of_h5pys_usual_calls() -> None:
    def usual(file: Any) -> None:
        place = file.create_group("tables")
        place.attrs.update(ATTRIBUTES)
        for name, values in COLUMNS.items():
            kind = h5py.string_dtype() if values.dtype == object else None
            data = place.create_dataset(name, data=values, dtype=kind)
            data.attrs["units"] = "rad"
            data.attrs["description"] = "what it means"

    def ours(file: Any) -> None:
        writer = Writer()
        place = writer.group(file.id, "tables")
        writer.attributes(place, ATTRIBUTES)
        for name, values in COLUMNS.items():
            writer.column(place, name, values, "rad", "what it means")

    assert _image(ours) == _image(usual)


def test_columns_are_read_as_they_were_written() -> None:
    with h5py.File("x.h5", "w", driver="core", backing_store=False) as file:
        writer = Writer()
        place = writer.group(file.id, "tables")
        for name, values in COLUMNS.items():
            writer.column(place, name, values, "rad", "what it means")
        for name in ("numbers", "whole", "none"):
            for found in (Columns(file.id, "tables")[name], Columns(place, "")[name]):
                assert found.dtype == COLUMNS[name].dtype
                np.testing.assert_array_equal(found, COLUMNS[name])
