"""What both programs for SCIP share."""

from __future__ import annotations

from typing import Any, Protocol

from trajopt.problem import Problem
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

# SCIP's own, for each constraint.
TOLERANCE = 1e-9


class Program(Protocol):
    """A polynomial program for SCIP, and the way back from its solutions.

    Attributes:
        trivial_bound: A lower bound that needs no solver, s.
        unit: Of the program's times, s.
        exchanges: Whether a solution of SCIP's adds constraints.
    """

    trivial_bound: float
    unit: float
    exchanges: bool

    @property
    def margin(self) -> float:
        """By what share SCIP's tolerance can lift its dual bound above the true one."""

    def incumbent(self) -> Trajectory:
        """The best trajectory that a local search gives."""

    def model(self, cutoff: float | None) -> Any:
        """SCIP's model of everything up to a total time, in `unit`s."""

    def improved(self, model: Any) -> Trajectory | None:
        """SCIP's best solution as a trajectory that keeps its limits; None without one."""


def certified(problem: Problem, trajectory: Trajectory) -> Trajectory:
    """Dilated until it keeps every limit of the (relaxed) problem."""
    return trajectory.dilated(max(1.0, verify(problem, trajectory).dilation))
