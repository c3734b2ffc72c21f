"""Describe planners, problems, robots and kinds of limits, as `trajopt list` shows them.

This imports every planner. What travels with the package is described once and stored in
`data/listed.json`, which `trajopt list` reads instead:

    python -m trajopt.cli.described      # writes it; a test compares it with what is there
"""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

from trajopt.benchmark.run.profile import Profile
from trajopt.benchmark.run.runner import profiled
from trajopt.benchmark.run.tasks import Allowance
from trajopt.benchmark.suites import catalogue, robots
from trajopt.core.built_in import data_folder, listed
from trajopt.core.exceptions import TrajoptError
from trajopt.core.limits import KINDS, LimitName, Limits, strangers
from trajopt.core.problem import Problem
from trajopt.planners.planner import Relation
from trajopt.planners.registry import Entry, entries

_OPTIONAL_LIMITS: tuple[LimitName, ...] = ("jerk", "position")


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
        "masses": arm.dynamics_origin.status if arm.dynamics_origin else None,
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


def _planners() -> list[dict[str, Any]]:
    return [described(entry) for entry in entries().values()]


def _problems() -> list[dict[str, Any]]:
    return [_problem(name) for name in catalogue.problem_files()]


def _robots() -> list[dict[str, Any]]:
    return [_arm(name) for name in robots.arm_files()]


def _limits() -> list[dict[str, Any]]:
    return [_kind(key) for key in dict.fromkeys([*KINDS, *strangers.registered()])]


READ: dict[str, Callable[[], list[dict[str, Any]]]] = {
    "planners": _planners,
    "problems": _problems,
    "robots": _robots,
    "limits": _limits,
}


def choices(name: str) -> dict[str, Any]:
    """Describe a planner with the values of its options that its library knows."""
    entry = entries()[name]
    row = described(entry)
    row["choices"] = entry.load().choices() if row["available"] and entry.is_own else {}
    return row


def to_store() -> dict[str, list[dict[str, Any]]]:
    """Return all lists without what depends on this machine: what is missing, and where files are.

    In its place a planner has its entry point, the modules that it `requires`, and their `extra`.
    """
    found = {kind: read() for kind, read in READ.items() if kind != "planners"}
    for row in found["problems"]:
        row["file"] = Path(row["file"]).relative_to(data_folder()).as_posix()
    planners = []
    for entry in entries().values():
        try:
            planner = entry.load()
        except TrajoptError:  # registered by another checkout
            continue
        if not entry.is_own:
            continue
        row = described(entry)
        del row["available"], row["missing"]
        row["value"] = entry.point.value
        row["requires"] = sorted({name.partition(".")[0] for name in planner.requires})
        row["extra"] = planner.extra
        planners.append(row)
    return {"planners": planners, **found}


if __name__ == "__main__":
    text = json.dumps(to_store(), indent=1, ensure_ascii=False)
    listed().write_text(f"{text}\n", encoding="utf-8")
