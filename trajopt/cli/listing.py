"""`trajopt list`: planners and the limits that they keep, problems, robots, kinds of limits.

What travels with the package is stored (`trajopt.cli.described`), so that nothing of it is
imported. Planners of other people are described anew; with kinds of limits of theirs all are.
"""

from __future__ import annotations

import json as json_text
import sys
from collections.abc import Callable, Sequence
from importlib.metadata import EntryPoint, entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from rich.text import Text

from trajopt.cli import console
from trajopt.cli.console import PlainTable
from trajopt.cli.parameters import Json
from trajopt.core.built_in import data_folder, listed
from trajopt.core.exceptions import MissingBackend, UnknownName

_OURS = "mintime"  # the distribution whose entry points are stored

Rows = list[dict[str, Any]]


def list_(what: str = "", /, *, json: Json = False) -> int:
    """List planners with their options and defaults, problems, robots, and kinds of limits.

    Args:
        what: planners, problems, robots or limits; or a planner, with every optimiser that it has
            by name.
    """
    if what and what not in _TABLES:
        return _one(what, as_json=json)
    found = lists(what)
    if json:
        console.print_json(found)
        return 0
    for place, (kind, rows) in enumerate(found.items()):
        if place:
            console.paragraph()
        console.OUT.print(_TABLES[kind](rows))
    return 0


def lists(what: str = "") -> dict[str, Rows]:
    """Return the rows of one list, or of all."""
    wanted = [kind for kind in _TABLES if what in ("", kind)]
    if _only_our_kinds():
        return _stored(wanted)
    from trajopt.cli import described  # late: it imports every planner

    return {kind: described.READ[kind]() for kind in wanted}


def _stored(wanted: Sequence[str]) -> dict[str, Rows]:
    """Return the stored lists, with what depends on this machine, and the planners of others."""
    lists = json_text.loads(listed().read_text(encoding="utf-8"))
    found: dict[str, Rows] = {kind: lists[kind] for kind in wanted}
    for row in found.get("problems", ()):
        row["file"] = str(data_folder() / row["file"])
    if "planners" in found:
        known = {row["name"]: row for row in found["planners"]}
        points: dict[str, list[EntryPoint]] = {}
        for point in entry_points(group="trajopt.planners"):
            points.setdefault(point.name, []).append(point)
        found["planners"] = [_planner(name, own, known.get(name)) for name, own in points.items()]
    return found


def _planner(name: str, points: Sequence[EntryPoint], row: dict[str, Any] | None) -> dict[str, Any]:
    """Return the row of a planner, from the stored one if that is what is registered."""
    value = row.pop("value") if row else None
    if row is None or any(not _is_ours(own) or own.value != value for own in points):
        from trajopt.cli import described  # late: it imports much
        from trajopt.planners.registry import entries

        return described.described(entries()[name])
    absent = [module for module in row.pop("requires") if find_spec(module) is None]
    extra = row.pop("extra")
    row["available"] = not absent
    row["missing"] = str(MissingBackend(" ".join(absent), extra)) if absent else None
    return row


def _is_ours(point: EntryPoint) -> bool:
    """Return whether an entry point is of this distribution, and leads to its modules."""
    if point.dist is None or point.dist.name != _OURS:
        return False
    spec = find_spec(point.module.partition(".")[0])
    origin = Path((spec and spec.origin) or "").resolve()
    return origin.parent.parent == Path(__file__).resolve().parents[2]


def _only_our_kinds() -> bool:
    """Return whether nobody else's kinds of limits are known: they are planned for, or not."""
    if any(not _is_ours(point) for point in entry_points(group="trajopt.limits")):
        return False
    limits = sys.modules.get("trajopt.core.limits")  # `--kind` has imported it
    return not limits or all(map(limits.strangers.is_ours, limits.KINDS.values()))


def _one(name: str, *, as_json: bool) -> int:
    """List one planner, and the values of its options that its library knows."""
    from trajopt.cli import described  # late: it imports the planner
    from trajopt.planners.registry import entries

    if name not in entries():
        raise UnknownName("list or planner", name, [*_TABLES, *entries()])
    row = described.choices(name)
    if as_json:
        console.print_json(row)
        return 0
    console.OUT.print(_planner_table([row]))
    for option, values in row["choices"].items():
        console.paragraph()
        console.OUT.print(Text(f"{option}, one of {len(values)}: {', '.join(values)}"))
    return 0


def _kind_table(kinds: Sequence[dict[str, Any]]) -> PlainTable:
    table = console.table("limit", "what it is, its numbers, and whether its rows are planned for")
    for kind in kinds:
        lines = [Text(console.visible(kind["description"] or "imported when a problem has it"))]
        if kind["fields"]:
            lines.append(Text(console.visible(", ".join(kind["fields"])), "dim"))
        if kind["rows"] is not None:
            said = "planners that take rows plan for it" if kind["rows"] else "it states no rows"
            lines.append(Text(said, "dim"))
        if kind["from"]:
            lines.append(Text(console.visible(kind["from"]), "dim"))
        if kind["refused"]:
            lines.append(Text(console.visible(kind["refused"]), "red"))
        table.row(console.bold(kind["name"]), Text("\n").join(lines))
    return table


def _planner_table(planners: Sequence[dict[str, Any]]) -> PlainTable:
    table = console.table("planner", "what it is, its options, and the limits it knows")
    for planner in planners:
        lines = [Text(console.visible(planner["description"]))]
        settings = [f"{key}={value}" for key, value in planner["options"].items()]
        if settings:
            lines.append(Text(console.visible(", ".join(settings)), "dim"))
        if planner["available"]:
            lines.append(Text(_limits_in_words(planner), "dim"))
            if planner["on_request"]:
                lines.append(Text("`compare` runs it only if it is named", "dim"))
        else:
            lines.append(Text(console.visible(f"not available: {planner['missing']}"), "red"))
        table.row(console.bold(planner["name"]), Text("\n").join(lines))
    return table


def _limits_in_words(planner: dict[str, Any]) -> str:
    known = ", ".join(planner["knows"]) or "none"
    sentences = [f"limits that it knows: {known.replace('_', ' ')}"]
    if planner["demands"]:
        from trajopt.core.demand import DEMANDS  # late: it needs NumPy

        demands = ", ".join(DEMANDS[key].name for key in planner["demands"])
        sentences.append(f"demands that it knows: {demands}")
    if planner["ignores"]:
        ignored = " and ".join(planner["ignores"])
        sentences.append(f"ignores {ignored} limits, and may break them")
    if planner["refuses"]:
        sentences.append(f"refuses {' and '.join(planner['refuses'])} limits")
    return "; ".join(sentences)


def _problem_table(problems: Sequence[dict[str, Any]]) -> PlainTable:
    table = console.table("problem", "joints", "waypoints", "limits")
    for problem in problems:
        name = console.bold(problem["name"])
        table.row(name, problem["joints"], problem["waypoints"], ", ".join(problem["limits"]))
    return table


def _arm_table(arms: Sequence[dict[str, Any]]) -> PlainTable:
    table = console.table("robot", "joints", "limits and link frames, and how they are known")
    for arm in arms:
        origins = [f"{kind} ({status})" for kind, status in arm["limits"].items()]
        if arm["link_frames"]:
            origins.append(f"link frames ({arm['link_frames']})")
        if arm["masses"]:
            origins.append(f"masses and torques ({arm['masses']})")
        name = console.bold(arm["name"])
        joints = len(arm["joint_names"])
        table.row(name, joints, ", ".join(origins))
    return table


_TABLES: dict[str, Callable[[Sequence[dict[str, Any]]], PlainTable]] = {
    "planners": _planner_table,
    "problems": _problem_table,
    "robots": _arm_table,
    "limits": _kind_table,
}
