"""What SCIP is asked to prove something about, and how far it is trusted."""

from __future__ import annotations

from typing import Any, Protocol

from trajopt.problem import Problem
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

TOLERANCE = 1e-9  # SCIP's own, for each constraint


class Program(Protocol):
    """A polynomial program for SCIP, and the way back from its solutions."""

    least: float  # trivial lower bound, s
    unit: float  # of its times, s
    exchanges: bool  # whether a solution of SCIP's adds constraints

    @property
    def worth(self) -> float: ...  # what SCIP's tolerance can be worth, relative
    def incumbent(self) -> Trajectory: ...
    def model(self, cutoff: float | None) -> Any: ...
    def learn(self, model: Any) -> Trajectory | None: ...


def certified(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """Dilated until it keeps every limit of the (relaxed) problem."""
    return trajectory.dilated(max(1.0, verify(problem, trajectory).dilation))
