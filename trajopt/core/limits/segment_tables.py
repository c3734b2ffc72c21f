"""Limits of one segment in a problem file: tables `[[limits.segment]]`.

    [[limits.segment]]
    number = 2                       # from 1: between the second waypoint and the third
    velocity = [0.5, 0.5]            # replaces that of [limits], also if it is larger

Kinds that a table does not have are those of `[limits]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.files import check_keys
from trajopt.core.limits.joint_limit import JointLimit, segment_key, value_pairs
from trajopt.core.limits.limit import named
from trajopt.core.limits.limits import Limits
from trajopt.core.tables import is_list

KEY = "segment"
NAMES = ("velocity", "acceleration", "jerk")
"""Kinds of limits that a segment may have of its own."""

Pairs = Mapping[str, Mapping[int, Array]]
"""Each kind's pairs `(joints, 2)` by the segment, from 0."""


def read(value: Any, segments: int, joints: int) -> Pairs:
    """Return the limits in the tables of a file.

    Raises:
        InvalidInput: Names the key, the segment, the joint, the value, and what would be right.
    """
    key = f"limits.{KEY}"
    if not is_list(value) or not all(isinstance(table, Mapping) for table in value):
        right = f"tables [[{key}]], each with number and {', '.join(NAMES[:-1])} or {NAMES[-1]}"
        raise InvalidInput(key, right, value=value)
    found: dict[str, dict[int, Array]] = {}
    seen = set()
    for table in value:
        if "position" in table:
            right = "no position in a segment: a range is the same in every segment"
            raise InvalidInput(f"{key}.position", right, value=table["position"])
        check_keys(f"{key}.", table, ("number", *NAMES), ("number",))
        number = table["number"]
        if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= segments:
            right = f"a whole number from 1 to {segments}, the segments between waypoints"
            raise InvalidInput(f"{key}.number", right, value=number)
        if number in seen:
            raise InvalidInput(f"{key}.number", "a table for each segment once", value=number)
        seen.add(number)
        if len(table) == 1:
            right = f"{', '.join(NAMES[:-1])} or {NAMES[-1]} beside number"
            raise InvalidInput(f"{key} number {number}", right)
        for name in NAMES:
            if name in table:
                own = _own(name, number - 1, table[name], joints)
                found.setdefault(name, {})[number - 1] = own
    return found


def _own(name: str, segment: int, value: Any, joints: int) -> Array:
    kind = named(name)
    assert issubclass(kind, JointLimit)
    where = segment_key(name, segment)
    pairs = value_pairs(where, value)
    if len(pairs) != joints:
        raise InvalidInput(where, f"{joints} values, one per joint", value=len(pairs))
    try:
        return kind(pairs).pairs
    except InvalidInput as error:
        raise InvalidInput(where, error.expected, value=error.value, joint=error.joint) from None


def with_segments(limits: Limits, own: Pairs, segments: int) -> Limits:
    """Return limits with those of single segments put in.

    Args:
        limits: The same in all segments.
        own: The limits of single segments.
        segments: Number of segments of the problem.

    Raises:
        InvalidInput: A limit under `[limits]` is each segment's own already.
    """
    for name, rows in own.items():
        pairs = limits.by_name()[name]
        if pairs.ndim != 2:
            right = f"one value per joint, beside [[limits.{KEY}]]"
            raise InvalidInput(f"limits.{name}", right, value=f"{len(pairs)} segments")
        table = np.repeat(pairs[None], segments, axis=0)
        for segment, values in rows.items():
            table[segment] = values
        kind = named(name)
        limits = limits.with_limit(kind.of_numbers(table))
    return limits


def tables(limits: Limits) -> list[dict[str, Any]]:
    """Return the tables of a problem file, as `read` takes them."""
    found = []
    for segment in range(limits.segments or 0):
        own = {key: limit.of_segment(segment) for key, limit in limits.kinds.items()}
        given = {key: value for key, value in own.items() if value is not None}
        if given:
            found.append({"number": segment + 1, **given})
    return found
