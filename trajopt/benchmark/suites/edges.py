"""Degenerate problems, one kind each, as `data/edges.toml` lists them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

from trajopt.benchmark.suites.suite import source
from trajopt.core import built_in, files
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

# Raise it whenever a degenerate problem changes.
VERSION = 2


def stream() -> Iterator[Problem]:
    """Yield all degenerate problems in the order of the file."""
    for key in _tables():
        yield _made(key)


def named(name: str) -> Problem | None:
    """Return the problem of this name, or None."""
    prefix, _, key = name.partition("-")
    return _made(key) if prefix == "edges" and key in _tables() else None


@cache
def _tables() -> dict[str, dict[str, Any]]:
    """Return the file's tables by name: `description`, `waypoints`, and limits by kind."""
    return files.toml(built_in.data_folder() / "edges.toml", "list of degenerate problems")


def _made(key: str) -> Problem:
    limits = dict(_tables()[key])
    description = limits.pop("description")
    waypoints = limits.pop("waypoints")
    return Problem(
        waypoints,
        Limits(**limits),
        name=f"edges-{key}",
        source=source("edges", f"degenerate on purpose: {description}"),
    )
