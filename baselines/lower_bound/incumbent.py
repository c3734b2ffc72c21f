"""The best trajectory of the references: the target of a lower bound."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from baselines.sizes import cells
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import certified, verify
from trajopt.planners import registry
from trajopt.planners.planner import Planner

# Time of one start of each planner, s per segment and joint (measured).
_START_SECONDS = 3e-3
_START_SECONDS_JERK = 0.05
_START_SECONDS_POSITION = 0.03
_STARTS = 4
# Planners go by their names: those that are exact use bounds themselves.
_STOPPING = "ruckig-stop"
# Stand-in for an infinite jerk limit, relative to the limit of the other side.
_WIDE_JERK_FACTOR = 1e3


class Incumbent(NamedTuple):
    """A verified trajectory that keeps every limit.

    Attributes:
        trajectory: Repaired and dilated.
        duration: Of it, s.
        disagreement: Difference of its planner's starts (`Solution.disagreement`).
        dilated: Whether it was slowed down because its planner ignores a limit.
    """

    trajectory: Trajectory
    duration: float
    disagreement: float | None = None
    dilated: bool = False


def incumbent(problem: Problem, seconds: float) -> Incumbent | None:
    """Return the best trajectory of the references, or one that stops at every waypoint.

    Args:
        problem: All its limits are kept.
        seconds: Approximate time available; it limits the number of starts.

    Returns:
        None if no planner's answer keeps every limit.
    """
    best = None
    for spec in _planners(problem, seconds):
        answer = _answer(registry.load(spec), problem)
        if answer is not None and (best is None or answer.duration < best.duration):
            best = answer
        if answer is not None and not answer.dilated and spec != _STOPPING:
            break
    return best


def _answer(planner: Planner, problem: Problem) -> Incumbent | None:
    """Return a planner's answer, dilated until it keeps every limit, if that is possible."""
    solution = planner.solve(_two_sided(problem))
    if solution.trajectory is None:
        return None
    found = kept(problem, solution.trajectory)
    return found and found._replace(disagreement=solution.disagreement)


def kept(problem: Problem, answer: Trajectory) -> Incumbent | None:
    """Dilate a trajectory until it keeps every limit, if that is possible."""
    certificate = verify(problem, answer)
    duration = certificate.certified_duration
    trajectory = certified(problem, answer)
    if duration is None or trajectory is None:
        return None
    return Incumbent(trajectory, duration, dilated=not certificate.nearly_feasible)


def _two_sided(problem: Problem) -> Problem:
    """Replace the infinite side of one-sided jerk limits by a very wide limit."""
    jerk = problem.limits.jerk
    limited = np.isfinite(jerk)
    sides_limited = limited.sum(axis=-1)
    one_sided = np.equal(sides_limited, 1)
    if not one_sided.any():
        return problem
    sizes = np.where(limited, np.abs(jerk), 0.0)
    wide = _WIDE_JERK_FACTOR * sizes.max(axis=-1)
    sides = np.stack([-wide, wide], axis=-1)
    stands_in = ~limited
    stands_in[~one_sided] = False
    limits = replace(problem.limits, jerk=np.where(stands_in, sides, jerk))
    return replace(problem, limits=limits)


def _planners(problem: Problem, seconds: float) -> list[str]:
    """Return the planners in the order in which they are run, up to the first answer."""
    size = cells(problem)
    rate = _START_SECONDS_JERK if problem.has("jerk") else _START_SECONDS
    starts = int(np.clip(seconds / (rate * size), 1, _STARTS))
    own = f"exact-jerk:starts={starts}" if problem.has("jerk") else f"exact:starts={2 * starts}"
    planners = [_STOPPING, own]
    if problem.limits.beyond_rates:
        rate += _START_SECONDS_POSITION
        starts = int(np.clip(seconds / (rate * size), 1, _STARTS))
        planners.append(f"collocation-refined:starts={starts}")
    return planners
