"""What the command line lists, as plain dictionaries: planners and problems."""

from __future__ import annotations

import json
from typing import Any

from trajopt.benchmark.suites import catalogue as suite
from trajopt.exceptions import TrajoptError
from trajopt.problem import LIMIT_NAMES
from trajopt.registry import Entry, entries


def planners() -> list[dict[str, Any]]:
    """Every registered planner: name, one line, options with defaults, what is missing."""
    return [_planner(entry) for entry in entries().values()]


def _planner(entry: Entry) -> dict[str, Any]:
    missing, described = entry.missing(), {"description": "", "options": {}}
    try:
        planner = entry.load()
        described = {"description": planner.description, "options": planner.options()}
    except TrajoptError:
        pass  # `missing` says why
    return {"name": entry.name, **described, "available": missing is None, "missing": missing}


def problems() -> list[dict[str, Any]]:
    """Every built-in problem: name, file, size, which limits it has, and where it comes from."""
    table = []
    for name, file in suite.problem_files().items():
        problem = suite.load(name)
        limits = [limit for limit in LIMIT_NAMES if problem.has(limit)]
        size = {"joints": problem.joints, "waypoints": len(problem.waypoints)}
        table.append(
            {"name": name, "file": str(file), **size, "limits": limits, "source": problem.source}
        )
    return table


def as_json(table: Any) -> str:
    """JSON has no infinity or NaN: what does not exist is null."""
    return json.dumps(_finite(table), indent=2, allow_nan=False, default=str)


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if isinstance(value, float) and not abs(value) < float("inf"):
        return None
    return value
