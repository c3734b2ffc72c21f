"""Both ends of a proof: a lower bound that nothing beats, and the shortest verified trajectory.

Any trajectory is bounded under every kind of limit by linear programs (`branching.py`,
`dual_check.py`), the 3-5-3 splines with shared times by boxes of their two ratios
(`ratio_boxes.py`). Both ask for anything that is shorter than the incumbent by a given share, until
there is none. Each bound has a proof that is checked without a solver.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound import ratio_boxes
from baselines.lower_bound import spline353 as best_spline353
from baselines.lower_bound.branching import prove
from baselines.lower_bound.dual_check import Proof
from baselines.lower_bound.incumbent import Incumbent, incumbent, kept
from baselines.lower_bound.ratio_boxes import RatioProof
from baselines.sizes import cells, described
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline353
from trajopt.planners.rest_to_rest import end_to_end_bound, stop_times

Family = Literal["free", "spline353"]

# A time limit below this (s) still lets a proof begin.
_GRACE_SECONDS = 1.0
# Share of the time limit that an incumbent may take.
_INCUMBENT_SHARE = 0.3
# Measured, per segment and moving joint: one linear program and one start of `exact`, s.
_SECONDS_PER_CELL = 5e-3
# A verified duration may exceed the solver's by rounding, relative.
_ROUNDING_RTOL = 1e-9


@dataclass(frozen=True, eq=False)
class Bound:
    """What is proved about the minimum time. All times in seconds.

    Attributes:
        lower_bound: No trajectory is faster.
        upper_bound: The certified duration of `trajectory`; infinite if none is known to keep
            every limit, or none was looked for.
        proved_within: Upper over lower bound, minus 1.
        status: "proved" (within what was asked), "time limit", "stopped: no progress", or
            "infeasible" (no 3-5-3 spline keeps the position limits: the message says why, and both
            bounds are infinite).
        solve_time: Wall time spent.
        trajectory: The fastest one known.
        message: Why there was no time to begin, if there was none.
        proof: What proves the lower bound without a solver; None for a closed form.
    """

    lower_bound: float
    upper_bound: float
    proved_within: float
    status: str
    solve_time: float
    trajectory: Trajectory | None
    message: str = ""
    proof: Proof | RatioProof | None = None


def certify(
    problem: Problem,
    family: Family = "free",
    *,
    within: float = 1e-4,
    time_limit: float = 60.0,
    joint: int | None = None,
) -> Bound:
    """Bounds on the minimum time, or on the best 3-5-3 spline with shared times.

    Args:
        problem: All its limits count.
        family: Any trajectory, or the 3-5-3 spline only.
        within: Relative distance of upper and lower bound at which to stop.
        time_limit: Seconds, building the programs included; then the bounds reached are the answer.
            A problem whose first program alone would take longer gets a bound in closed form and a
            message. Below one second it counts as one for that.
        joint: That joint alone, counted from 0.

    Raises:
        InvalidInput: An argument cannot be used.
        MissingBackend: HiGHS is not installed.
        TrajoptError: HiGHS breaks down.
    """
    for name, value in (("within", within), ("time_limit", time_limit)):
        if not value > 0:
            raise InvalidInput(name, "a positive number", value=value)
    began = time.perf_counter()
    question, index = asked(problem, family, joint)
    if family == "free":
        bound = _free(question, within, began, time_limit)
    else:
        bound = _spline353(question, within, began + time_limit)
    trajectory = bound.trajectory
    if trajectory is not None:
        trajectory = Trajectory(
            trajectory.breaks,
            trajectory.coefficients,
            trajectory.waypoint_times[index],
        )
    return replace(bound, trajectory=trajectory, solve_time=time.perf_counter() - began)


def asked(problem: Problem, family: Family, joint: int | None) -> tuple[Problem, NDArray[np.intp]]:
    """The problem that a bound is about, consecutive identical waypoints merged.

    Returns:
        The problem, and which of its waypoints each original one is.

    Raises:
        InvalidInput: An argument cannot be used.
    """
    if family not in ("free", "spline353"):
        raise InvalidInput("family", "'free' or 'spline353'", value=family)
    problem, index = problem.merged()
    if joint is not None:
        if not 0 <= joint < problem.joints or not problem.moving[joint]:
            raise InvalidInput("joint", "the index of a joint that moves", value=joint)
        problem = problem.only([joint])
    if joint is not None and family == "free":
        # alone, the joint may rest over a segment
        problem, own_index = problem.merged()
        index = own_index[index]
    if family == "spline353" and problem.segments != 3:
        raise InvalidInput("problem", "exactly 4 waypoints", value=problem.segments + 1)
    return problem, index


def _free(problem: Problem, within: float, began: float, time_limit: float) -> Bound:
    """Linear programs under every limit."""
    needed = _SECONDS_PER_CELL * cells(problem)
    if needed > max(time_limit, _GRACE_SECONDS):
        return _not_begun(problem, needed, time_limit)
    deadline = began + time_limit
    best = incumbent(problem, _INCUMBENT_SHARE * time_limit)
    # without a trajectory there is something to prove all the same
    known = float(stop_times(problem).sum())
    motion = None
    if best is not None:
        known = best.duration
        motion = best.trajectory
    outcome = prove(
        problem,
        known / (1 + within),
        within,
        deadline,
        motion,
    )
    late = time.perf_counter() > deadline
    word = "time limit" if late else "stopped: no progress"
    return _bound(outcome.lower_bound, best, within, word, outcome.proof)


def _spline353(problem: Problem, within: float, deadline: float) -> Bound:
    """Boxes of the two ratios."""
    reason = spline353.infeasible(problem)
    if reason is not None:
        return Bound(np.inf, np.inf, 0.0, "infeasible", 0.0, None, reason)
    times, proof = best_spline353.prove(problem, within, deadline)
    best = kept(problem, spline353.trajectory(problem, times))
    if proof is None:
        return _bound(end_to_end_bound(problem), best, within, "stopped: no progress", None)
    lower = ratio_boxes.proved_bound(problem, proof)
    return _bound(lower, best, within, "time limit", proof)


def _bound(
    lower: float,
    best: Incumbent | None,
    within: float,
    otherwise: str,
    proof: Proof | RatioProof | None,
) -> Bound:
    """Both ends; the status is `otherwise` where they are farther apart than was asked."""
    if best is None:
        return Bound(lower, np.inf, np.inf, otherwise, 0.0, None, proof=proof)
    proved = best.duration <= lower * (1 + within) * (1 + _ROUNDING_RTOL)
    return Bound(
        lower_bound=lower,
        upper_bound=best.duration,
        proved_within=best.duration / lower - 1,
        status="proved" if proved else otherwise,
        solve_time=0.0,
        trajectory=best.trajectory,
        proof=proof,
    )


def _not_begun(problem: Problem, needed: float, time_limit: float) -> Bound:
    """A bound in closed form, where a time limit (s) leaves no room for anything else."""
    message = (
        f"{described(problem)} need about {needed:.0f} s before a proof can begin, "
        f"more than the limit of {time_limit:g} s: this is a bound in closed form"
    )
    lower = end_to_end_bound(problem)
    return Bound(lower, np.inf, np.inf, "time limit", 0.0, None, message)
