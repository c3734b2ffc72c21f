"""Limits of one segment in a problem file: tables `[[limits.segment]]`.

    [[limits.segment]]
    number = 2                       # from 1: between the second waypoint and the third
    velocity = [0.5, 0.5]            # replaces that of [limits], also if it is larger

Kinds that a table does not have are those of `[limits]`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trajopt.core.exceptions import InvalidInput
from trajopt.core.files import check_keys
from trajopt.core.limits.limit import KINDS, Limit
from trajopt.core.limits.limits import Limits
from trajopt.core.tables import is_list

KEY = "segment"


def names() -> list[str]:
    """Return the kinds of limits that a segment may have of its own."""
    return [key for key, kind in KINDS.items() if kind.by_segment]


def read(value: Any, segments: int, joints: int) -> dict[str, dict[int, Limit]]:
    """Return the limits in the tables of a file: of each kind by the segment, from 0.

    Raises:
        InvalidInput: Names the key, the segment, the joint, the value, and what would be right.
    """
    key, kinds = f"limits.{KEY}", names()
    either = f"{', '.join(kinds[:-1])} or {kinds[-1]}"
    if not is_list(value) or not all(isinstance(table, Mapping) for table in value):
        right = f"tables [[{key}]], each with number and {either}"
        raise InvalidInput(key, right, value=value)
    found: dict[str, dict[int, Limit]] = {}
    seen = set()
    for table in value:
        if "position" in table:
            right = "no position in a segment: a range is the same in every segment"
            raise InvalidInput(f"{key}.position", right, value=table["position"])
        check_keys(f"{key}.", table, ("number", *kinds), ("number",))
        number = table["number"]
        if not isinstance(number, int) or isinstance(number, bool) or not 1 <= number <= segments:
            right = f"a whole number from 1 to {segments}, the segments between waypoints"
            raise InvalidInput(f"{key}.number", right, value=number)
        if number in seen:
            raise InvalidInput(f"{key}.number", "a table for each segment once", value=number)
        seen.add(number)
        if len(table) == 1:
            raise InvalidInput(f"{key} number {number}", f"{either} beside number")
        for name in kinds:
            if name in table:
                own = KINDS[name].read_segment(number - 1, table[name], joints)
                found.setdefault(name, {})[number - 1] = own
    return found


def tables(limits: Limits) -> list[dict[str, Any]]:
    """Return the tables of a problem file, as `read` takes them."""
    found = []
    for segment in range(limits.segments or 0):
        own = {key: limit.of_segment(segment) for key, limit in limits.kinds.items()}
        given = {key: value for key, value in own.items() if value is not None}
        if given:
            found.append({"number": segment + 1, **given})
    return found
