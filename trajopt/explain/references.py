"""The reference planners by name, and the question that each one answers.

They are loaded by name like any planner, and may be missing.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core.demand import names as demands_in_words
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.core.renamed import RENAMED
from trajopt.core.solution import Solution
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import broken, certified, verify
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load

OPTIMUM = "exact"
"""The optimum under velocity and acceleration limits."""

OPTIMUM_WITH_JERK = "exact-jerk"
"""The optimum under jerk limits too."""

OPTIMUM_WITH_POSITION = "collocation-refined"
"""The optimum under every kind of limit, refined until two grids agree."""

REFERENCES = (OPTIMUM, OPTIMUM_WITH_JERK, OPTIMUM_WITH_POSITION)
"""The planners whose certified answers are best known optima."""

BUG_RTOL = 1e-6
"""A motion below a reference by more than this is a bug to hunt, or a better optimum."""

REFINED_RTOL = 1e-4
"""Refined collocation is above the optimum by at most this."""

PATH_TIMING = "along:accuracy=0.0003"
"""The fastest timing of a given path under every kind of limit, by its method `along`."""

BEST_353 = "spline353-nlp"
"""The best 3-5-3 spline with shared times."""

BEST_OF_FAMILY = {
    "3-5-3": BEST_353,
    "quintic spline": "spline:degree=5",
    "septic spline": "spline:degree=7",
}
"""The planner of the best member of a family of trajectories, by the family's name.

Splines of one degree are C² here, their times and knot derivatives free: B-splines, which are
smoother, are among them and cannot be faster.
"""

STOPPING = "ruckig-stop"
"""At rest at every inner waypoint, where the motion begins or ends with a velocity."""

THROUGH_WAYPOINTS = "ruckig-search"
"""The planner whose certified answers are at or near the optimum, where a reference fails."""

PROOF = "prove"
"""The planner whose lower bound is proved."""

PROVERS = (PROOF, *(former for former, now in RENAMED.items() if now == PROOF))
"""The names of that planner in stored trials."""

BEST_KNOWN = "best-known"
"""The planner that a best known answer names; `PROOF` checks its bound."""


def references(problem: Problem) -> list[str]:
    """Return the planners whose shortest certified answer is a problem's best known optimum."""
    names = [OPTIMUM_WITH_JERK if problem.has("jerk") else OPTIMUM]
    if problem.limits.beyond_rates:  # the exact planners leave these out
        names.append(OPTIMUM_WITH_POSITION)
    return names


def best_planners(problem: Problem) -> list[str]:
    """Return the planners to run for the fastest motion, in order, until one keeps every limit.

    Planners that know fewer limits come first. They take less time, and if their answer keeps the
    other limits too, no faster motion is known.
    """
    return [*references(problem), THROUGH_WAYPOINTS]


class ReferenceAnswer(NamedTuple):
    """A certified trajectory, or None with the reason."""

    trajectory: Trajectory | None
    reason: str = ""

    @property
    def duration(self) -> float | None:
        if self.trajectory is None:
            return None
        return self.trajectory.duration


def under_peak_jerk(problem: Problem, peak_jerk: ArrayLike) -> Problem:
    """Return the problem with each joint's peak jerk in a trajectory as its jerk limit.

    Args:
        problem: waypoints and limits.
        peak_jerk: rad/s³, one per joint; 0 for a joint that never moves.

    Raises:
        InvalidInput: `peak_jerk` is not one number per joint.
    """
    jerk = np.asarray(peak_jerk, dtype=float)
    if jerk.shape != (problem.joints,):
        raise InvalidInput("peak_jerk", f"{problem.joints} numbers, one per joint", value=len(jerk))
    limits = replace(problem.limits, jerk=np.where(jerk > 0, jerk, np.inf))
    return replace(problem, limits=limits)


def asked(name: str, problem: Problem) -> ReferenceAnswer:
    """Return a registered planner's certified answer."""
    try:
        planner = load(name)
        reason = planner.unsupported(problem)
        unknown = planner.unknown_demands(problem)
        if reason is None and unknown:
            reason = f"it does not know {demands_in_words(unknown)}"
        if reason is not None:
            return ReferenceAnswer(None, reason)
        return judged(problem, planner, planner.solve(problem))
    except TrajoptError as error:
        return ReferenceAnswer(None, str(error))


def judged(problem: Problem, planner: Planner, solution: Solution) -> ReferenceAnswer:
    """Return the certified trajectory of a planner's answer, or why it is no reference.

    An answer that breaks a limit which its planner does not know is no reference, even dilated.
    """
    if solution.trajectory is None:
        return ReferenceAnswer(None, solution.message or str(solution.status))
    found = verify(problem, solution.trajectory)
    unknown = planner.unknown(problem)
    ignored = [KINDS[key].name() for key in broken(problem, found) if key in unknown]
    if ignored:
        return ReferenceAnswer(None, f"it ignores {' and '.join(ignored)} limits, and breaks them")
    return ReferenceAnswer(certified(problem, solution.trajectory), "; ".join(found.flaws))
