"""Refuse jerk limits on one side or in some segments only: no optimum exists (see `ExactJerk`)."""

from __future__ import annotations

import numpy as np

from trajopt.core.problem import Problem


def unsupported(problem: Problem) -> str | None:
    """Return why these jerk limits have no optimum; None if they have one."""
    limited = np.isfinite(problem.limits.jerk[..., problem.moving, :])
    if (limited[..., 0] != limited[..., 1]).any():
        return "a jerk limit on one side only has no optimum, only an infimum"
    if limited.ndim == 3 and (limited != limited[:1]).any():
        return "a joint's jerk limit in some segments only has no optimum, only an infimum"
    return None
