"""Proved bounds, by whoever provides them: the entry-point group `trajopt.bounds`."""

from __future__ import annotations

from collections.abc import Callable
from importlib.metadata import entry_points
from typing import Any, Literal

from trajopt.exceptions import TrajoptError
from trajopt.problem import Problem

GROUP = "trajopt.bounds"

Family = Literal["free", "spline353"]


def certify(problem: Problem, family: Family = "free", **options: Any) -> Any:
    """Bounds on the minimum time of a problem (`free`), or of its best 3-5-3 (`spline353`).

    Options: `gap` (relative), `time_limit` (s), `joint` (from 0: that joint alone). The answer has
    `lower_bound`, `upper_bound`, `solve_time` (s), `relative_gap`, `status` and the `trajectory` of
    the upper bound. Raises `TrajoptError` where no provider is installed.
    """
    return _provider()(problem, family, **options)


def _provider() -> Callable[..., Any]:
    for point in entry_points(group=GROUP):
        provider: Callable[..., Any] = point.load()
        return provider
    raise TrajoptError(f"nothing installed provides bounds (entry-point group {GROUP})")
