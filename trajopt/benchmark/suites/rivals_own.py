"""Inputs of the test suites of toppra, Ruckig and MoveIt, as `data/rivals-own.toml` lists them."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import Any

from trajopt.benchmark.suites.suite import Suite
from trajopt.core import built_in, files
from trajopt.core.demand import DEMANDS
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

# Raise it whenever a problem changes.
VERSION = 1

_PREFIX = "rivals-own-"


def expected() -> dict[str, float]:
    """Return the durations that the tests expect, s, by the names of their problems."""
    return {
        _PREFIX + key: float(table["expected"])
        for key, table in _tables().items()
        if "expected" in table
    }


def _stream() -> Iterator[Problem]:
    for key in _tables():
        yield _made(key)


def _named(name: str) -> Problem | None:
    key = name.removeprefix(_PREFIX)
    return _made(key) if name.startswith(_PREFIX) and key in _tables() else None


@cache
def _tables() -> dict[str, dict[str, Any]]:
    """Return the file's tables by name: `source`, `expected`, `waypoints`, limits and demands."""
    return files.toml(built_in.data_folder() / "rivals-own.toml", "list of others' tests")


def _made(key: str) -> Problem:
    table = dict(_tables()[key])
    source = table.pop("source")
    waypoints = table.pop("waypoints")
    table.pop("expected", None)
    demands = {name: table.pop(name) for name in DEMANDS if name in table}
    return Problem(waypoints, Limits(**table), _PREFIX + key, source, demands=demands)


SUITE = Suite("rivals-own", "the tests of toppra, Ruckig and MoveIt", VERSION, _stream, _named)
