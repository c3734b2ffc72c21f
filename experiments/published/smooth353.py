"""How smooth can a 3-5-3 be, whatever times its optimiser finds?"""

from __future__ import annotations

import numpy as np
from scipy.optimize import minimize

from baselines.front.least import without_limits
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.judging.smoothness import smoothness
from trajopt.planners import spline353

_WIDEST = 8.0  # logarithm of a ratio of segment times
_STARTS = ((0.0, 0.0), (-1.0, 0.0), (0.0, -1.0))


def times_the_least(problem: Problem) -> float:
    """Return the least ∫ jerk² of a 3-5-3 over the least of any motion of the same duration.

    Without limits both are proportional to 1/D⁵, so this holds for every duration D at which the
    limits do not act in the smoothest motion. The least 3-5-3 is a local search over two ratios of
    segment times, from three starts.
    """
    merged, _ = problem.merged()
    least = without_limits(merged, "jerk")
    if least is None or spline353.unsupported(merged):
        return np.nan

    def logarithm(ratios: Array) -> float:
        shares = np.exp(np.append(np.clip(ratios, -_WIDEST, _WIDEST), 0.0))
        motion = spline353.trajectory(merged, shares / shares.sum())
        return float(np.log(smoothness(merged, motion).jerk_integral))

    options = {"xatol": 1e-6, "fatol": 1e-10}
    found = [
        minimize(logarithm, start, method="Nelder-Mead", options=options).fun for start in _STARTS
    ]
    return float(np.exp(min(found)) / least)
