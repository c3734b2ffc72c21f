"""Planners of other authors, one file each, run as their authors run them.

Each runs its package with up to twelve settings, and returns the answer of the shortest certified
duration. The first setting is that of the package's own example, so `tries=1` is what its
documentation shows. Each file lists its choices and their sources.

Each package is an extra (`pip install "mintime[rivals]"` for all). These planners run on request,
and are judged as every other planner is.

- `totg.py`: the fastest timing of a path;
- `totg_ruckig.py`: that timing, smoothed until it keeps jerk limits;
- `iterative_spline.py`: a spline whose intervals are stretched until it keeps the limits;
- `copp.py`: the fastest timing of a path under jerk limits too;
- `drake_kto.py`: the fastest B-spline;
- `drake_gcs.py`: the fastest Bézier curves through boxes;
- `minsnap.py`: splines of least snap.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

from baselines.topp_ra import best_of, rules
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution
from trajopt.planners.planner import Planner
from trajopt.planners.reductions import EQUAL_WAYPOINTS, reduced

TRIES = 12

Setting = tuple[Any, ...]


@dataclass(frozen=True)
class Rival(Planner):
    """A planner of other authors: the best answer of its first `tries` settings.

    - `tries`: number of settings that are run. 1: the setting of its authors' own example.
    """

    tries: int = TRIES

    on_request = True
    settings: ClassVar[Sequence[Setting]]

    def __post_init__(self) -> None:
        if not 1 <= self.tries <= TRIES:
            raise InvalidInput("tries", f"from 1 to {TRIES}", value=self.tries)

    @reduced(EQUAL_WAYPOINTS)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the best of its tries. `stats`: the setting, and every setting's result."""
        solutions = {}
        for setting in self.settings[: self.tries]:
            name = "/".join(map(str, setting))
            solutions[name] = self.tried(problem, *setting)
        return replace(best_of(problem, solutions), evaluations=len(solutions))

    @abstractmethod
    def tried(self, problem: Problem, *setting: Any) -> Solution:
        """Return the package's answer with one of the settings."""


def splines_after(first: Setting) -> list[Setting]:
    """Return the twelve splines through the waypoints, the authors' own one first."""
    return [first, *(spline for spline in rules() if spline != first)]
