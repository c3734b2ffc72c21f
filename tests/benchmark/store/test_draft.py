"""Files made by HDF5's own calls are those that h5py makes."""

import h5py
import numpy as np
import pytest

from trajopt.benchmark.store.columns import Block
from trajopt.benchmark.store.draft import Draft, checked, compressed, unfiltered
from trajopt.benchmark.store.hdf5 import SCHEMA
from trajopt.benchmark.store.seal import sealed

ABOUT = Block(("row", "joint"), "rad/s²", "an array")
TEXT = h5py.string_dtype("utf-8", 5)
ARRAYS = {
    "record": np.array("ßabc".encode(), dtype=TEXT),
    "one/breaks": np.arange(4.0),
    "one/empty": np.zeros((0, 3)),
    "two/cube": np.arange(24.0).reshape(2, 3, 4),
    "two/turned": np.arange(6.0).reshape(2, 3).T,
    "two/rows": np.array([[1, -1], [2, 3]]),
    "two/texts": np.array([b"one", b"two"], dtype=TEXT),
}


def by_h5py(arrays, **options):
    """The same file by h5py's own objects."""
    with h5py.File.in_memory(libver="v110") as file:
        file.attrs["schema"] = SCHEMA
        file.attrs["description"] = "what it is"
        for name, array in arrays.items():
            chosen = dict(options)
            if options:
                chosen |= {"chunks": (2, *array.shape[1:]), "maxshape": (None, *array.shape[1:])}
            data = file.create_dataset(name, data=array, **chosen)
            data.attrs["units"] = "rad/s²"
            data.attrs["description"] = "an array: (row, joint)"
        file.flush()
        return sealed(file.id.get_file_image())


def test_a_file_of_fixed_arrays_is_h5py_s_byte_for_byte():
    with Draft("what it is") as draft:
        for name, array in ARRAYS.items():
            draft.put(name, array, ABOUT)
        assert draft.content() == by_h5py(ARRAYS)


@pytest.mark.parametrize(
    ("filters", "options"),
    [
        (unfiltered, {"fletcher32": False}),
        (checked, {"fletcher32": True}),
        (compressed, {"compression": 1, "shuffle": True, "fletcher32": True}),
    ],
)
def test_a_file_with_a_growing_array_is_h5py_s_byte_for_byte(filters, options):
    for name, array in ARRAYS.items():
        if not array.ndim:
            continue
        with Draft("what it is") as draft:
            draft.put_growing(name, array, ABOUT, rows=2, filters=filters)
            assert draft.content() == by_h5py({name: array}, **options), name
            assert draft.claimed == array.nbytes


def test_what_is_appended_follows_what_was_there(tmp_path):
    with Draft("what it is") as draft:
        draft.put_growing("one/values", np.arange(3.0), ABOUT, rows=2, filters=compressed)
        draft.append("one/values", np.arange(3.0, 8.0))
        (tmp_path / "x.h5").write_bytes(draft.content())
        assert draft.claimed == 8 * 8
    with h5py.File(tmp_path / "x.h5") as file:
        assert file["one/values"][()].tolist() == list(range(8))


def test_drafts_may_be_open_side_by_side():
    with Draft("one") as one, Draft("two") as two:
        one.put("values", np.arange(3.0), ABOUT)
        two.put("values", np.arange(4.0), ABOUT)
        assert one.content() != two.content()
