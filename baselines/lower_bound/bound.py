"""The proof loop: ask SCIP for anything shorter than the incumbent by the gap, until there is none.

A bound is a pair: a lower bound that no trajectory can beat, and the certified duration of a
verified trajectory. SCIP's own primal value is never used: it rests on tolerances. Its dual bound
is lowered by what those tolerances can be worth (each program says how much).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from baselines.lower_bound.free import Free
from baselines.lower_bound.program import TOLERANCE, Program
from baselines.lower_bound.spline353 import Spline353
from trajopt.exceptions import InvalidInput, TrajoptError
from trajopt.planner import backend
from trajopt.problem import Problem
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

_WORDS = {"timelimit": "time limit", "infeasible": "tolerance", "optimal": "tolerance"}


@dataclass(frozen=True, eq=False)
class Bound:
    """What is proved about the minimum time. All times in seconds.

    - `lower_bound`: no trajectory is faster, SCIP's tolerance allowed for;
    - `upper_bound`: the certified duration of `trajectory`; infinite if none keeps the limits that
      the bound ignores (free: jerk and position, 3-5-3: position), which lower bounds may ignore;
    - `relative_gap`: upper over lower bound, minus 1;
    - `status`: "proved" (to the gap), "time limit", "tolerance" (SCIP is done, but its tolerance is
      worth more than the gap), or "stopped" with SCIP's own word.
    """

    lower_bound: float
    upper_bound: float
    relative_gap: float
    status: str
    solve_time: float
    trajectory: Trajectory | None


def certify(
    problem: Problem,
    family: Literal["free", "spline353"] = "free",
    *,
    gap: float = 1e-4,
    time_limit: float = 60.0,
    joint: int | None = None,
) -> Bound:
    """Bounds on the minimum time, or on the best 3-5-3 with shared times; `joint`: of it alone.

    Raises `InvalidInput`, `MissingBackend` without SCIP, `TrajoptError` if SCIP breaks down.
    """
    if family not in ("free", "spline353"):
        raise InvalidInput("family", "'free' or 'spline353'", value=family)
    for name, value in (("gap", gap), ("time_limit", time_limit)):
        if not value > 0:
            raise InvalidInput(name, "a positive number", value=value)
    began, scip = time.perf_counter(), backend("pyscipopt")
    problem, index = problem.merged()
    problem = problem if joint is None else _alone(problem, joint)
    if family == "free" and joint is not None:
        problem, own = problem.merged()
        index = own[index]
    program: Program = Free(problem, scip) if family == "free" else Spline353(problem, scip)
    bound = _prove(problem, program, gap, began + time_limit)
    t = bound.trajectory
    t = t and Trajectory(t.breaks, t.coefficients, t.waypoint_times[index])
    return replace(bound, trajectory=t, solve_time=time.perf_counter() - began)


def _alone(problem: Problem, joint: int) -> Problem:
    if not 0 <= joint < problem.joints or not problem.moving[joint]:
        raise InvalidInput("joint", "the index of a joint that moves", value=joint)
    return problem.only([joint])


def _prove(problem: Problem, program: Program, gap: float, deadline: float) -> Bound:
    """Ask for anything shorter than the incumbent by the gap until there is none, or no time."""
    best, lower, word = program.incumbent(), program.least, "timelimit"
    while (left := deadline - time.perf_counter()) > 0:
        cutoff = best.duration * (1 + min(program.worth, gap / 2)) / (1 + gap)
        word, dual, found = _solved(program, cutoff, left)
        lower = max(lower, dual / (1 + program.worth))
        if found and found.duration < best.duration:
            best = found
        if not (found and program.exchanges) or best.duration <= lower * (1 + gap):
            break
    if lower > best.duration * (1 + 1e-9):
        raise TrajoptError(f"the bound {lower} s is above a trajectory of {best.duration} s")
    proved = best.duration <= lower * (1 + gap) * (1 + 1e-12)
    status = "proved" if proved else _WORDS.get(word, f"stopped: {word}")
    return _bound(problem, best, min(lower, best.duration), status)


def _solved(
    program: Program, cutoff: float | None, seconds: float
) -> tuple[str, float, Trajectory | None]:
    """SCIP's status, its dual bound (s, at most the cut-off), and what its solution teaches."""
    model = program.model(None if cutoff is None else cutoff / program.unit)
    word, dual = _optimised(model, seconds)
    bound = min(dual * program.unit, np.inf if cutoff is None else cutoff)
    return word, bound, program.learn(model)


def _optimised(model: Any, seconds: float) -> tuple[str, float]:
    """SCIP's status and dual bound, in the program's units."""
    model.hideOutput()
    for name in ("numerics/feastol", "numerics/epsilon", "numerics/dualfeastol"):
        model.setRealParam(name, TOLERANCE)
    model.setRealParam("limits/time", max(seconds, 0.01))
    try:
        model.optimize()
    except Exception as error:
        raise TrajoptError(f"SCIP failed: {error}") from error
    return str(model.getStatus()), float(model.getDualbound())


def _bound(problem: Problem, best: Trajectory, lower: float, status: str) -> Bound:
    duration = verify(problem, best).certified_duration
    upper = np.inf if duration is None else duration
    trajectory = None if duration is None else best
    return Bound(lower, upper, upper / lower - 1, status, 0.0, trajectory)
