"""The timing of a spline as a function to minimise, for any optimiser.

f = trajopt.objective("six-axis")
f(f.low + 0.4 * (f.high - f.low))                                # one candidate: a number
f(np.random.default_rng(0).uniform(f.low, f.high, (1000, 3)))    # 1000 of them: (1000,)
trajopt.judge("six-axis", f.trajectory(best))
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.arrays import Array
from trajopt.core.demand import DEMANDS, names
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline353
from trajopt.planners.planner import Planner
from trajopt.planners.reductions import SIMPLEST
from trajopt.planners.swarm_planner import JointGroup, SwarmPlanner
from trajopt.planners.timing import FamilyTiming, Timing

Fitness = Literal["penalty", "scaled"]

CLOSED_FORM = "3-5-3"
"""The shape that is compiled."""

# The box of the swarms: upper end over the longest time of a segment from rest to rest, and lower
# end over upper end.
UPPER = 4.0
LOWER = 1e-3


class Objective:
    """The fitness of segment times, s, for any optimiser.

    Called with one candidate `(variables,)` it returns a number, with many `(n, variables)` an
    array `(n,)`, s. A candidate outside the box is evaluated as the nearest one inside. One that is
    not finite has an infinite fitness. Where limits differ between segments, the tightest of each
    joint count everywhere. Only one thread at a time may call it; other processes get a
    copy.

    Attributes:
        problem: Whose motion is timed.
        shape: The degrees of the spline's pieces.
        fitness: `penalty`: the duration, or more than any duration in the box if a limit is broken;
            `scaled`: the duration once dilated to the limits.
        low, high: The box, `(variables,)`, s.
        variables: Number of times.
        ceiling: The longest duration in the box, s; a larger fitness means that a limit is broken.
        evaluations: Candidates evaluated so far; may be set.
    """

    def __init__(
        self,
        problem: Problem,
        shape: str = CLOSED_FORM,
        fitness: Fitness = "penalty",
        *,
        lower: float = LOWER,
        upper: float = UPPER,
    ) -> None:
        """Take the arguments of `trajopt.objective`, and the box of the swarms' options."""
        choices = get_args(Fitness)
        if fitness not in choices:
            raise InvalidInput("fitness", " or ".join(map(repr, choices)), value=fitness)
        reason = unsupported(problem, str(shape))
        if reason is not None:
            raise InvalidInput("shape", f"one for {problem.name}: {reason}", value=shape)
        self.problem = problem
        self._searched = replace(problem, limits=problem.limits.in_all_segments())
        self.shape = str(shape)
        self.fitness = fitness
        self._simpler = SIMPLEST.apply(self._searched)
        self._timing = _timing(self._simpler, self.shape, lower, upper)
        self.variables = self._timing.variables
        self.low = np.full(self.variables, self._timing.low)
        self.high = np.full(self.variables, self._timing.high)
        self.ceiling = self._timing.ceiling
        self.evaluations = 0

    def __call__(self, times: ArrayLike) -> Any:
        """Return the fitness of one candidate, or of many.

        Raises:
            InvalidInput: The times have another shape.
        """
        candidates = self._checked(times)
        rows = candidates.reshape(-1, self.variables)
        if not len(rows):
            return np.empty(0)
        self.evaluations += len(rows)
        inside = self._inside(rows)
        finite = np.isfinite(rows)
        if finite.all():
            values = self._values(inside)
        else:
            lost = ~finite.all(axis=1)
            inside[lost] = self.high
            values = np.where(lost, np.inf, self._values(inside))
        return values if candidates.ndim == 2 else values.item()

    def trajectory(self, times: ArrayLike) -> Trajectory:
        """Return the motion of one candidate `(variables,)`, to be judged.

        Raises:
            InvalidInput: The times have another shape, or are not finite.
        """
        candidate = self._checked(times)
        if candidate.ndim != 1 or not np.isfinite(candidate).all():
            right = f"one candidate of {self.variables} finite times, s"
            raise InvalidInput("times", right, value=candidate.tolist())
        inside = self._inside(candidate)
        if self.fitness == "scaled":
            inside = inside * self._timing.dilation(inside[None])
        motion = self._timing.trajectory(self._simpler, inside)
        return SIMPLEST.restored(self._searched, motion)

    def __repr__(self) -> str:
        name = self.problem.name or "a problem"
        return f"Objective({name}, shape={self.shape!r}, fitness={self.fitness!r})"

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without compiled functions, so that it can be copied to processes."""
        return {key: value for key, value in vars(self).items() if key != "_values"}

    @cached_property
    def _values(self) -> Callable[[Array], Array]:
        return self._timing.fast(self.fitness)

    def _checked(self, times: ArrayLike) -> Array:
        try:
            candidates = np.asarray(times, dtype=float)
        except (TypeError, ValueError):
            candidates = np.empty(0)
        if candidates.ndim not in (1, 2) or candidates.shape[-1] != self.variables:
            right = f"times in seconds, ({self.variables},) or (n, {self.variables})"
            raise InvalidInput("times", right, value=np.shape(times) or times)
        return candidates

    def _inside(self, candidates: Array) -> Array:
        return np.minimum(np.maximum(candidates, self.low), self.high)


def unsupported(problem: Problem, shape: str) -> str | None:
    """Return why no times of a shape can be searched for a problem, or None."""
    demands = [key for key in problem.demands if DEMANDS[key].left_out != "restriction"]
    if demands:
        return f"a spline's times do not know {names(demands)}"
    reason = Planner.unsupported(SwarmPlanner(), problem)  # a kind of limit that no timing knows
    if reason is not None:
        return reason
    if shape == CLOSED_FORM:
        return spline353.unsupported(problem) or spline353.infeasible(problem)
    try:
        of_all = replace(problem, limits=problem.limits.in_all_segments())
        FamilyTiming.of(SIMPLEST.apply(of_all), shape, LOWER, UPPER)
    except InvalidInput as error:
        return str(error)
    return None


def _timing(problem: Problem, shape: str, lower: float, upper: float) -> Timing:
    if shape == CLOSED_FORM:
        return JointGroup.of(problem, np.arange(problem.joints), lower, upper)
    return FamilyTiming.of(problem, shape, lower, upper)
