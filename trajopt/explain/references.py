"""Which planner is the reference for what: the only place in the library that knows their names.

They are asked for by name, as any planner is, and may be missing.
"""

from __future__ import annotations

from trajopt.problem import Problem

OPTIMUM = "exact"
"""The optimum under velocity and acceleration limits."""

OPTIMUM_WITH_JERK = "exact-jerk"
"""The optimum under jerk limits too."""

OPTIMUM_WITH_POSITION = "collocation-refined"
"""The optimum under every kind of limit, refined until two grids agree."""

REFERENCES = (OPTIMUM, OPTIMUM_WITH_JERK, OPTIMUM_WITH_POSITION)
"""The planners whose certified answers are best known optima."""

PATH_TIMING = "toppra"
"""The fastest timing of a given path, by its method `along`."""

BEST_353 = "spline353-nlp"
"""The best 3-5-3 spline with shared times."""

PROOF = "certify"
"""The planner whose lower bound is proved."""


def references(problem: Problem) -> list[str]:
    """The planners whose shortest certified answer is a problem's best known optimum."""
    names = [OPTIMUM]
    if problem.has("jerk"):
        names.append(OPTIMUM_WITH_JERK)
    if problem.has("position"):
        names.append(OPTIMUM_WITH_POSITION)
    return names
