"""Proved bounds, by whoever provides them: the entry-point group `trajopt.bounds`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import entry_points
from typing import Any, ClassVar, Literal

import numpy as np

from trajopt.exceptions import InvalidInput, TrajoptError
from trajopt.planner import Relation
from trajopt.problem import Problem
from trajopt.solution import Solution, Status

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


@dataclass(frozen=True)
class Certify:
    """A proved lower bound on the minimum time, with the fastest trajectory known (SCIP).

    - `gap`: relative, at which to stop;
    - `time_limit`: s, after which the bounds reached are the answer.

    The bound is the solution's `lower_bound`; jerk and position limits are lifted for it.
    """

    gap: float = 1e-4
    time_limit: float = 60.0

    on_request: ClassVar[bool] = True

    def __post_init__(self) -> None:
        for name in ("gap", "time_limit"):
            if not getattr(self, name) > 0:
                raise InvalidInput(name, "a positive number", value=getattr(self, name))

    def relation(self, problem: Problem) -> Relation:
        """Jerk and position limits are ignored, so with them the answer is a lower bound."""
        lifted = problem.has("jerk") or problem.has("position")
        return Relation.RELAXATION if lifted else Relation.SAME

    def unsupported(self, problem: Problem) -> str | None:
        return None

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The proof's two ends; without the upper one if it breaks a lifted limit."""
        bound = certify(problem, gap=self.gap, time_limit=self.time_limit)
        found = f"no trajectory is faster than {bound.lower_bound:.9g} s ({bound.status})"
        stats = {"proof": bound.status}
        if bound.trajectory is None:
            message = f"{found}; the fastest breaks a limit that the bound lifts"
            return Solution(Status.INVALID, None, message, bound.lower_bound, stats=stats)
        stats["relative_gap"] = bound.relative_gap if np.isfinite(bound.relative_gap) else np.nan
        return Solution(Status.SOLVED, bound.trajectory, found, bound.lower_bound, stats=stats)
