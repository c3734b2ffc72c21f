"""Check tables of numbers and names that a caller or a file states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput, shortened
from trajopt.core.files import MAX_NAME
from trajopt.core.numerals import is_number


def waypoint_table(rows: Any, least: int = 2) -> Array:
    """Waypoints as a table; errors name the waypoint and the joint, counted from 1.

    Raises:
        InvalidInput: Fewer rows than `least`, rows of different lengths, a value that is not
            finite.
    """
    if is_table(rows) and len(rows) >= least and np.isfinite(rows).all():
        return rows
    if not is_list(rows) or len(rows) < least:
        raise InvalidInput("waypoints", "at least two rows, one per waypoint", value=rows)
    for number, row in enumerate(rows, start=1):
        key = f"waypoints, waypoint {number}"
        if not is_list(row) or len(row) == 0:
            raise InvalidInput(key, "a row of numbers, one per joint", value=row)
        joints = len(rows[0])
        if len(row) != joints:
            raise InvalidInput(key, f"{joints} numbers", value=list(row))
        for joint, item in enumerate(row):
            if not is_number(item):
                raise InvalidInput(key, "a finite number", value=item, joint=joint)
    return np.array(rows, dtype=float)


def check_joint_names(names: Sequence[Any], joints: int) -> None:
    """Refuse names that are not one printable text per joint, or not unique.

    Raises:
        InvalidInput: Names the joint and the value.
    """
    if len(names) != joints:
        right = f"{joints} names, one per joint"
        raise InvalidInput("joint_names", right, value=list(names))
    seen = set()
    for joint, name in enumerate(names):
        if not isinstance(name, str) or not name.isprintable() or not name.strip():
            raise InvalidInput("joint_names", "a name", value=name, joint=joint)
        check_length("joint_names", name, joint)
        if name in seen:
            raise InvalidInput("joint_names", "names that differ", value=name, joint=joint)
        seen.add(name)


def check_length(key: str, name: str, joint: int | None = None) -> None:
    """Refuse a name that is too long for a line, a table or a file.

    Raises:
        InvalidInput: The name has more than `MAX_NAME` characters.
    """
    if len(name) > MAX_NAME:
        right = f"a name of at most {MAX_NAME} characters"
        raise InvalidInput(key, right, value=shortened(name, 40), joint=joint)


def is_table(value: Any) -> TypeGuard[Array]:
    """Return whether this is a table of floats, whose items need no check of their types."""
    if not isinstance(value, np.ndarray) or value.dtype != float:
        return False
    return value.ndim == 2 and value.size > 0


def is_list(value: Any) -> bool:
    """Return whether this is an array, or a sequence that is no text."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def frozen(values: ArrayLike) -> Array:
    """Return a read-only copy."""
    array = np.array(values, dtype=float)
    array.setflags(write=False)
    return array
