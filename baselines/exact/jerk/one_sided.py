"""Jerk limits on one side only, under which there is no optimum (ExactJerk says why)."""

from __future__ import annotations

import numpy as np

from trajopt.core.problem import Problem


def unsupported(problem: Problem) -> str | None:
    """Why jerk limits as these have no optimum, or None."""
    jerk = problem.limits.jerk[problem.moving]
    downwards, upwards = np.isfinite(jerk).T
    one_sided = downwards != upwards
    if one_sided.any():
        return "a jerk limit on one side only has no optimum, only an infimum"
    return None
