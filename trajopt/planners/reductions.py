"""Reductions: a simpler problem for a planner, and its answer converted back.

    @reduced(SIMPLEST)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution: ...

This `solve` gets a problem in which consecutive waypoints differ and every joint moves. Its caller
gets the answer to the original problem. The design is cvxpy's: `accepts`, `apply`, `invert`.

Some planners get all joints, with `EQUAL_WAYPOINTS` alone:

- a swarm, because each joint has random numbers of its own, by its number;
- `smooth`, because its measure weighs joints by the units of all of them;
- TOPP-RA and planners of other packages, which get a problem as their own users would state it.

Code that reads a problem and returns no motion of it, like the judge and the closed forms, calls
`Problem.merged` itself.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import wraps
from itertools import chain
from typing import Any, TypeVar, cast

import numpy as np

from trajopt.core.problem import Problem
from trajopt.core.solution import Solution
from trajopt.core.trajectory import Trajectory
from trajopt.planners.rest_to_rest import stop_times

SolveT = TypeVar("SolveT", bound=Callable[..., Solution])


class Reduction(ABC):
    """A transformation to a simpler problem whose answers give answers to the original one."""

    @abstractmethod
    def accepts(self, problem: Problem) -> bool:
        """Return whether the problem becomes simpler."""

    @abstractmethod
    def apply(self, problem: Problem) -> Problem:
        """Return the simpler problem; the problem itself where there is nothing to do."""

    @abstractmethod
    def restored(self, problem: Problem, motion: Trajectory) -> Trajectory:
        """Return the original problem's motion for one of the simpler problem."""

    def invert(self, problem: Problem, solution: Solution) -> Solution:
        """Return the original problem's answer for one of the simpler problem."""
        if solution.trajectory is None:
            return solution
        return replace(solution, trajectory=self.restored(problem, solution.trajectory))


class EqualWaypoints(Reduction):
    """Merge consecutive waypoints that are equal up to rounding into one, passed once."""

    def accepts(self, problem: Problem) -> bool:
        merged, _ = problem.merged()
        return merged is not problem

    def apply(self, problem: Problem) -> Problem:
        merged, _ = problem.merged()
        return merged

    def restored(self, problem: Problem, motion: Trajectory) -> Trajectory:
        _, index = problem.merged()
        return replace(motion, waypoint_times=motion.waypoint_times[index])


class RestingJoints(Reduction):
    """Leave out joints that never move."""

    def accepts(self, problem: Problem) -> bool:
        return not problem.moving.all()

    def apply(self, problem: Problem) -> Problem:
        return problem.only(problem.moving) if self.accepts(problem) else problem

    def restored(self, problem: Problem, motion: Trajectory) -> Trajectory:
        if not self.accepts(problem):
            return motion
        return motion.beside(problem.waypoints[0], problem.moving)

    def reduced(self, problem: Problem, motion: Trajectory) -> Trajectory:
        """Return the simpler problem's motion for one of the original problem."""
        return replace(motion, coefficients=motion.coefficients[..., problem.moving])


class RestingUncoupled(RestingJoints):
    """Leave out joints that never move, unless a limit of several joints may depend on them.

    Such a joint may help others by moving: an arm is faster with a bent elbow.
    """

    def accepts(self, problem: Problem) -> bool:
        return super().accepts(problem) and not problem.limits.coupled


class OwnUnits(Reduction):
    """Scale lengths and times to about 1, for solvers with absolute tolerances.

    The unit of time is the time of stopping at every waypoint, the unit of length the largest
    displacement of all joints.
    """

    def accepts(self, problem: Problem) -> bool:
        return True

    def apply(self, problem: Problem) -> Problem:
        second, length = self._units(problem)
        route = problem.route.in_units(second, length)
        limits = problem.limits.in_units(second, length)
        return replace(problem, waypoints=route.waypoints, limits=limits, demands=route.demands)

    def restored(self, problem: Problem, motion: Trajectory) -> Trajectory:
        second, length = self._units(problem)
        slower = motion.dilated(second)
        return replace(slower, coefficients=length * slower.coefficients)

    def _units(self, problem: Problem) -> tuple[float, float]:
        """Return the units of time, s, and of length, rad."""
        stops = stop_times(problem)
        return float(stops.sum()), float(np.abs(problem.displacements).max())


@dataclass(frozen=True)
class OneByOne(Reduction):
    """Apply several reductions in order, each to the result of the one before."""

    reductions: tuple[Reduction, ...]

    def accepts(self, problem: Problem) -> bool:
        steps, _ = self.applied(problem)
        return bool(steps)

    def apply(self, problem: Problem) -> Problem:
        _, simplest = self.applied(problem)
        return simplest

    def restored(self, problem: Problem, motion: Trajectory) -> Trajectory:
        steps, _ = self.applied(problem)
        for reduction, asked in reversed(steps):
            motion = reduction.restored(asked, motion)
        return motion

    def applied(self, problem: Problem) -> tuple[list[tuple[Reduction, Problem]], Problem]:
        """Return each reduction that applies, with its own problem, and the last problem."""
        steps: list[tuple[Reduction, Problem]] = []
        for reduction in self.reductions:
            if reduction.accepts(problem):
                steps.append((reduction, problem))
                problem = reduction.apply(problem)
        return steps, problem


EQUAL_WAYPOINTS = EqualWaypoints()
RESTING_JOINTS = RestingJoints()
RESTING_UNCOUPLED = RestingUncoupled()
OWN_UNITS = OwnUnits()
SIMPLEST = OneByOne((EQUAL_WAYPOINTS, RESTING_JOINTS))
"""Consecutive waypoints differ, and every joint moves: what most planners and the bound solve."""


def reduced(*reductions: Reduction) -> Callable[[SolveT], SolveT]:
    """Decorate a method that solves a problem, so that it gets the reduced problem."""
    every = OneByOne(tuple(chain.from_iterable(map(_parts, reductions))))

    def decorated(solve: SolveT) -> SolveT:
        @wraps(solve)
        def whole(self: Any, problem: Problem, *arguments: Any, **keywords: Any) -> Solution:
            steps, simplest = every.applied(problem)
            solution = solve(self, simplest, *arguments, **keywords)
            for reduction, asked in reversed(steps):
                solution = reduction.invert(asked, solution)
            return solution

        return cast(SolveT, whole)

    return decorated


def _parts(reduction: Reduction) -> tuple[Reduction, ...]:
    return reduction.reductions if isinstance(reduction, OneByOne) else (reduction,)
