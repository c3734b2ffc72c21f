"""`trajopt list`: planners and the limits that they keep, problems, robots, kinds of limits."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from rich.text import Text

from trajopt.benchmark.run.profile import Profile
from trajopt.benchmark.run.runner import profiled
from trajopt.benchmark.run.tasks import Allowance
from trajopt.benchmark.suites import catalogue, robots
from trajopt.cli import console
from trajopt.cli.console import PlainTable
from trajopt.cli.parameters import Json
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import TrajoptError, UnknownName
from trajopt.core.limits import KINDS, LimitName, Limits, strangers
from trajopt.core.problem import Problem
from trajopt.planners.planner import Relation
from trajopt.planners.registry import Entry, entries

_OPTIONAL_LIMITS: tuple[LimitName, ...] = ("jerk", "position")


def list_(what: str = "", /, *, json: Json = False) -> int:
    """List planners with their options and defaults, problems, robots, and kinds of limits.

    Args:
        what: planners, problems, robots or limits; or a planner, with every optimiser that it has
            by name.
    """
    if what and what not in _READ:
        return _one(what, as_json=json)
    found = {kind: read() for kind, read in _READ.items() if what in ("", kind)}
    if json:
        console.print_json(found)
        return 0
    for place, (kind, rows) in enumerate(found.items()):
        if place:
            console.paragraph()
        console.OUT.print(_TABLES[kind](rows))
    return 0


def _one(name: str, *, as_json: bool) -> int:
    """List one planner, and the values of its options that its library knows."""
    if name not in entries():
        raise UnknownName("list or planner", name, [*_READ, *entries()])
    entry = entries()[name]
    row = described(entry)
    row["choices"] = entry.load().choices() if row["available"] and entry.is_own else {}
    if as_json:
        console.print_json(row)
        return 0
    console.OUT.print(_planner_table([row]))
    for option, values in row["choices"].items():
        console.paragraph()
        console.OUT.print(Text(f"{option}, one of {len(values)}: {', '.join(values)}"))
    return 0


def described(entry: Entry) -> dict[str, Any]:
    """Describe a planner: its name, one line, options, limits, demands, and what is missing.

    It keeps the limits that it `knows`, and the `demands` of the route. It leaves out limits that
    it `ignores`, and may break them. It does not solve problems with limits that it `refuses`. It
    may break any other limit. The verifier reports every limit that is broken.
    """
    row: dict[str, Any] = {
        "name": entry.name,
        "description": "",
        "options": {},
        "on_request": False,
        "knows": [],
        "demands": [],
        "ignores": [],
        "refuses": [],
    }
    problems = {limit: _limited_by(limit) for limit in _OPTIONAL_LIMITS}
    try:
        profile = profiled(entry.name, list(problems.values()), Allowance())
    except TrajoptError as error:
        missing: str | None = str(error)
    else:
        missing = profile.missing
        row["description"] = profile.description
        row["options"] = profile.entrant.options
        row["on_request"] = profile.on_request
        row["knows"] = list(profile.knows)
        row["demands"] = list(profile.demands)
        for limit, problem in problems.items():
            row.get(_fate(profile, problem), []).append(limit)
    row["available"] = missing is None
    row["missing"] = missing
    return row


def _fate(profile: Profile, problem: Problem) -> str:
    """Tell whether a planner `ignores` or `refuses` a kind of limit; empty for neither."""
    if profile.refusals[problem.digest()] is not None:
        return "refuses"
    if profile.relations[problem.digest()] is Relation.RELAXATION:
        return "ignores"
    return ""


@cache
def _limited_by(name: LimitName) -> Problem:
    """Return a problem of one joint and four waypoints, as many as a 3-5-3 spline takes."""
    optional = {"jerk": [1.0], "position": [10.0]}
    limits = Limits([1.0], [1.0], **{name: optional[name]})
    return Problem([[0.0], [1.0], [2.0], [3.0]], limits)


def _problem(name: str) -> dict[str, Any]:
    """Describe a built-in problem: its file, size, limits and source."""
    problem = catalogue.load(name)
    return {
        "name": name,
        "file": str(catalogue.find(name)),
        "joints": problem.joints,
        "waypoints": len(problem.waypoints),
        "limits": list(problem.limits.kinds),
        "source": problem.source,
    }


def _arm(name: str) -> dict[str, Any]:
    """Describe a built-in robot: its joints, kinds of limits, and how well each kind is known."""
    arm = robots.arm(name)
    return {
        "name": name,
        "description": arm.description,
        "joint_names": list(arm.joint_names),
        "limits": {kind: origin.status for kind, origin in arm.origins.items()},
        "link_frames": arm.chain_origin.status if arm.chain_origin else None,
    }


def _kind(key: str) -> dict[str, Any]:
    """Describe a kind of limit; one that a package registers and no problem has used by its place.

    That one is not imported.
    """
    point = strangers.registered().get(key)
    package = point.dist.name if point is not None and point.dist else ""
    row: dict[str, Any] = {
        "name": key,
        "description": "",
        "fields": [],
        "rows": None,
        "from": "",
        "refused": "",
    }
    if key not in KINDS:
        assert point is not None
        return row | {"from": f"{point.value} of package {package}"}
    kind = KINDS[key]
    ours = strangers.is_ours(kind)
    if ours and point is not None:
        row["refused"] = f"{point.value} of package {package} has this key too, and is not used"
    return row | {
        "description": (kind.__doc__ or "").partition("\n")[0],
        "fields": [field.name for field in getattr(kind, "fields", ())],
        "rows": kind.has_rows(),
        "from": "" if ours else f"{kind.__module__}.{kind.__qualname__}",
    }


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
        name = console.bold(arm["name"])
        joints = len(arm["joint_names"])
        table.row(name, joints, ", ".join(origins))
    return table


_READ: dict[str, Callable[[], list[dict[str, Any]]]] = {
    "planners": lambda: [described(entry) for entry in entries().values()],
    "problems": lambda: [_problem(name) for name in catalogue.problem_files()],
    "robots": lambda: [_arm(name) for name in robots.arm_files()],
    "limits": lambda: [_kind(key) for key in dict.fromkeys([*KINDS, *strangers.registered()])],
}
_TABLES = {
    "planners": _planner_table,
    "problems": _problem_table,
    "robots": _arm_table,
    "limits": _kind_table,
}
