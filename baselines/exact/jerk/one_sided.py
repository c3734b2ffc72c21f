"""Jerk limits on one side or in some segments only: there is no optimum (ExactJerk says why)."""

from __future__ import annotations

import numpy as np

from trajopt.core.problem import Problem


def unsupported(problem: Problem) -> str | None:
    """Why jerk limits as these have no optimum, or None."""
    limited = np.isfinite(problem.limits.jerk[..., problem.moving, :])
    if (limited[..., 0] != limited[..., 1]).any():
        return "a jerk limit on one side only has no optimum, only an infimum"
    if limited.ndim == 3 and (limited != limited[:1]).any():
        return "a joint's jerk limit in some segments only has no optimum, only an infimum"
    return None
