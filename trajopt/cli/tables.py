"""What the command line lists, as plain dictionaries: planners, problems, re-verified trials."""

from __future__ import annotations

import inspect
import json
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.benchmark.store.folder import Damaged, Record, records
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import TrajoptError
from trajopt.planner import Entry, entries, options
from trajopt.problem import LIMIT_NAMES
from trajopt.solution import Status

_SAME = 1e-9  # relative difference within which a certified duration is the recorded one


def planners() -> list[dict[str, Any]]:
    """Every registered planner: name, one line, options with defaults, what is missing."""
    return [_planner(entry) for entry in entries().values()]


def _planner(entry: Entry) -> dict[str, Any]:
    missing, described = entry.missing(), {"description": "", "options": {}}
    try:
        planner = entry.load()
        text = getattr(planner, "description", None) or inspect.getdoc(type(planner)) or ""
        described = {"description": text.split("\n")[0], "options": options(planner)}
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


def verification(path: Path) -> list[dict[str, Any]]:
    """Every stored trial, claimed against certified, and whether what was recorded holds."""
    damaged: list[Damaged] = []
    checked = [_checked(trial, record) for trial, record in records(path, damaged.append)]
    return checked + [_damaged(error) for error in damaged]


def _damaged(error: Damaged) -> dict[str, Any]:
    names = {"id": error.path.stem, "problem": "", "planner": "a damaged file", "seed": None}
    numbers = ("claimed_duration", "certified_duration", "recorded_claim", "recorded_duration")
    absent = dict.fromkeys([*numbers, "dilation"])
    return names | absent | {"status": "damaged", "flaws": [str(error)], "holds": False}


def _checked(trial: Trial, record: Record) -> dict[str, Any]:
    certificate = trial.certificate
    return {
        "id": record.id,
        "problem": trial.problem.name,
        "planner": trial.label,
        "seed": trial.seed,
        "status": str(trial.status),
        "claimed_duration": trial.claimed_duration,
        "certified_duration": trial.certified_duration,
        "recorded_claim": record.claimed_duration,
        "recorded_duration": record.certified_duration,
        "dilation": certificate.dilation if certificate else None,
        "flaws": list(certificate.flaws) if certificate else [trial.message],
        "holds": _holds(trial, record),
    }


def _holds(trial: Trial, record: Record) -> bool:
    """The file's identity is its content's, and its verdict is what the verifier says now."""
    same = _same(trial.certified_duration, record.certified_duration)
    claimed = _same(trial.claimed_duration, record.claimed_duration)
    consistent = (trial.status is not Status.SOLVED) or trial.certified_duration is not None
    return same and claimed and consistent and trial.id == record.id


def _same(now: float | None, then: float | None) -> bool:
    if now is None or then is None:
        return now is then
    return bool(np.isclose(now, then, rtol=_SAME, atol=0))


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
