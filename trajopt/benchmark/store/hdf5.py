"""Groups, columns and attributes of an HDF5 file through h5py's lower layer.

The bytes are those of h5py's usual calls. These prepare types, spaces and properties anew for each
of a thousand problems' 23 columns and 60 attributes, which takes three fifths of their time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np


class Writer:
    """Types and properties that all groups, columns and attributes share."""

    def __init__(self) -> None:
        import h5py  # takes long to import
        from h5py import h5a, h5d, h5g, h5p, h5s, h5t

        self._h5a, self._h5d, self._h5g, self._h5s, self._h5t = h5a, h5d, h5g, h5s, h5t
        self._text = h5py.string_dtype()
        self._as_group = h5p.create(h5p.GROUP_CREATE)
        self._as_column = h5p.create(h5p.DATASET_CREATE)
        self._as_column.set_fill_time(h5d.FILL_TIME_IFSET)
        for own in (self._as_group, self._as_column):
            own.set_obj_track_times(False)
        self._types: dict[Any, tuple[Any, Any]] = {}
        self._spaces: dict[tuple[int, ...], Any] = {}
        self._texts: dict[str, Any] = {}

    def group(self, parent: Any, name: str) -> Any:
        """Make a group in another one, and return it; its name is in ASCII."""
        return self._h5g.create(parent, name.encode("ascii"), gcpl=self._as_group)

    def column(self, place: Any, name: str, values: Any, units: str, description: str) -> None:
        """Write an array, or a column of texts, with its units and its meaning."""
        if values.dtype == object:
            values = values.astype(self._text)
        values = np.asarray(values, order="C")
        stored, in_memory = self._type(values.dtype)
        space = self._space(values.shape)
        made = self._h5d.create(place, name.encode("ascii"), stored, space, dcpl=self._as_column)
        made.write(self._h5s.ALL, self._h5s.ALL, values, in_memory)
        self.attributes(made, {"units": units, "description": description})

    def attributes(self, place: Any, values: Mapping[str, Any]) -> None:
        """Write attributes of a group or column: texts, numbers, or lists of texts."""
        for name, value in values.items():
            array = self._scalar(value) if isinstance(value, str) else self._array(value)
            stored, in_memory = self._type(array.dtype)
            made = self._h5a.create(place, name.encode("ascii"), stored, self._space(array.shape))
            made.write(array, mtype=in_memory)

    def _array(self, value: Any) -> Any:
        return np.array(value, dtype=self._text if isinstance(value, list) else None)

    def _scalar(self, text: str) -> Any:
        """Return a text as an array; units and meanings come again and again."""
        if text not in self._texts:
            self._texts[text] = np.array(text, dtype=self._text)
        return self._texts[text]

    def _type(self, dtype: Any) -> tuple[Any, Any]:
        """Return a type as the file has it, and as memory does."""
        key = "text" if dtype.kind == "O" else dtype
        if key not in self._types:
            create = self._h5t.py_create
            self._types[key] = create(dtype, logical=True), create(dtype)
        return self._types[key]

    def _space(self, shape: tuple[int, ...]) -> Any:
        if shape not in self._spaces:
            self._spaces[shape] = self._h5s.create_simple(shape)
        return self._spaces[shape]


class Columns:
    """The columns of a group, each read where it is used.

    Args:
        place: Of the group that the group is in.
        name: Of the group; empty for that very one.
    """

    def __init__(self, place: Any, name: str) -> None:
        self._place = place
        self._name = name

    def __getitem__(self, name: str) -> Any:
        from h5py import h5d, h5s

        path = f"{self._name}/{name}" if self._name else name
        column = h5d.open(self._place, path.encode("ascii"))
        values = np.empty(column.shape, column.dtype)
        column.read(h5s.ALL, h5s.ALL, values)
        return values
