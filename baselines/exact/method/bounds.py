"""What the search for a lower bound (`baselines.lower_bound`) says of an answer at once.

Its first program, without branching, begins with the inequalities that a motion makes equations.
Near an optimum these prove nearly all of its duration, in some 20 ms.
"""

from __future__ import annotations

import time
from dataclasses import replace

from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.trajectory import Trajectory
from trajopt.planners.reductions import RESTING_JOINTS

# By which given times may be exceeded in the search, relative. Smaller: a proof takes
# longer. Larger: times that are too short by less may stay unproved.
_GIVEN_RTOL = 1e-4
# CPU time for the proof that given times are impossible, s. Less: `failed` in place of
# `infeasible`.
_GIVEN_SECONDS = 5.0
_ROUNDING_RTOL = 1e-9  # a bound above the given times by less may be rounding, and proves nothing


def is_near(problem: Problem, motion: Trajectory, within: float) -> bool:
    """Return whether no motion is shorter by more than a share, `within`; False: it is not known.

    Args:
        problem: Without consecutive identical waypoints, with the limits that count.
        motion: A motion of it.
        within: Relative.
    """
    target = motion.duration / (1 + within)
    passing = replace(motion, waypoint_times=motion.waypoint_times[~spared(problem)])
    return _bound(problem, target, within, passing, 0.0) >= target


def impossible_times(problem: Problem) -> str:
    """Return a sentence if a bound proves that no motion has the given times; empty if not."""
    given = float(problem.route.demand("given_times").sum())
    if not given:
        return ""
    least = _bound(problem, given * (1 + _GIVEN_RTOL), _GIVEN_RTOL, None, _GIVEN_SECONDS)
    if not least > given * (1 + _ROUNDING_RTOL):
        return ""
    return (
        f"no motion has the given times, {given:.9g} s together: a bound proves that it takes "
        f"{least:.9g} s at least (`prove` states the proof)"
    )


def _bound(
    problem: Problem, target: float, gap: float, motion: Trajectory | None, seconds: float
) -> float:
    """Return a lower bound, s, at most about the target; 0 where the search breaks down.

    Args:
        problem: As in `is_near`.
        target: s.
        gap: Relative, for tolerances of the search.
        motion: One near the optimum, where there is one.
        seconds: CPU time for branching.
    """
    from baselines.lower_bound.apart import relaxed  # late: they need SciPy and HiGHS
    from baselines.lower_bound.branching import MAX_IDLE_SPLITS, branch_and_bound

    ends = time.process_time() + seconds
    try:
        relaxation = relaxed(problem)
        found = branch_and_bound(
            RESTING_JOINTS.apply(relaxation),
            target,
            gap,
            lambda: seconds > 0 and time.process_time() > ends,
            motion and RESTING_JOINTS.reduced(relaxation, motion),
            MAX_IDLE_SPLITS if seconds else 0,
        )
    except TrajoptError:
        return 0.0
    return found.lower_bound
