"""No optimisation at all: the paper's fixed time per segment (section 5)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt import spline353
from trajopt.exceptions import InvalidInput
from trajopt.planner import Relation, passing_once
from trajopt.problem import Problem
from trajopt.solution import Solution, Status


@dataclass(frozen=True)
class Unoptimised:
    """The 3-5-3 spline at the same fixed time for every segment (the paper: 2 s)."""

    segment_time: float = 2.0  # s

    def __post_init__(self) -> None:
        if not 1e-9 < self.segment_time < 1e9:
            raise InvalidInput(
                "segment_time", "a positive time in seconds", value=self.segment_time
            )

    def relation(self, problem: Problem) -> Relation:
        return Relation.RESTRICTION

    def unsupported(self, problem: Problem) -> str | None:
        return spline353.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        times = np.full(3, self.segment_time)
        return Solution(Status.SOLVED, spline353.trajectory(problem, times), evaluations=0)
