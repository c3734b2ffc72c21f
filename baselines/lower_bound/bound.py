"""The proof loop: ask for anything shorter than the incumbent by the gap, until there is none.

A bound is a pair: a lower bound that no trajectory can beat, and the certified duration of a
verified trajectory. Any trajectory is bounded under every kind of limit by linear programs, with a
proof that is checked without a solver (`branching.py`, `dual_check.py`). SCIP bounds the 3-5-3
spline, and any trajectory under velocity and acceleration limits where the linear programs leave
a gap. SCIP's own primal value is never used: it rests on tolerances. Its dual bound is lowered by
what those tolerances can be worth (each program says how much).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound.branching import prove
from baselines.lower_bound.dual_check import Proof
from baselines.lower_bound.free import Free, trivial_bound
from baselines.lower_bound.incumbent import incumbent
from baselines.lower_bound.program import TOLERANCE, Program
from baselines.lower_bound.spline353 import Spline353
from baselines.sizes import described
from trajopt import spline353
from trajopt.exceptions import InvalidInput, TrajoptError
from trajopt.planner import backend
from trajopt.problem import Problem
from trajopt.rest_to_rest import stop_times
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Family = Literal["free", "spline353"]

# SCIP's words for how it ended, in ours.
_STATUSES = {"timelimit": "time limit", "infeasible": "tolerance", "optimal": "tolerance"}
# A bound that comes out again lower by this (relative) has come out again.
_RECHECK_RTOL = 1e-9
# A time limit below this (s) still lets a proof begin.
_GRACE_SECONDS = 1.0
# Of the time limit: what an incumbent may take, and linear programs before SCIP is asked.
_INCUMBENT_SHARE = 0.3
_PROGRAMS_SHARE = 0.6
# SCIP takes a time limit of zero (s) for none.
_SHORTEST_SCIP_SECONDS = 0.01


@dataclass(frozen=True, eq=False)
class Bound:
    """What is proved about the minimum time. All times in seconds.

    Attributes:
        lower_bound: No trajectory is faster, SCIP's tolerance allowed for.
        upper_bound: The certified duration of `trajectory`; infinite if none is known to keep
            every limit, or none was looked for.
        proved_within: Upper over lower bound, minus 1.
        status: "proved" (within what was asked), "time limit", "tolerance" (SCIP is done, but its
            tolerance is worth more than that), "infeasible" (no 3-5-3 spline keeps the position
            limits: the message says why, and both bounds are infinite), or "stopped" with the
            reason.
        solve_time: Wall time spent.
        trajectory: The fastest one known.
        message: Why there was no time to begin, if there was none.
        proof: What proves the lower bound without a solver; None where SCIP is to be believed.
    """

    lower_bound: float
    upper_bound: float
    proved_within: float
    status: str
    solve_time: float
    trajectory: Trajectory | None
    message: str = ""
    proof: Proof | None = None


@dataclass(frozen=True, eq=False)
class _Question:
    """The problem that is asked about, consecutive identical waypoints merged.

    `index` says which of its waypoints each original one is.
    """

    problem: Problem
    family: Family
    index: NDArray[np.intp]

    def infeasible(self) -> str | None:
        """Why nothing that is asked about keeps every limit, or None; a free trajectory can."""
        if self.family == "free":
            return None
        return spline353.infeasible(self.problem)

    @property
    def kind(self) -> type[Free] | type[Spline353]:
        return Free if self.family == "free" else Spline353


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
        time_limit: Seconds, building the model included; then the bounds reached are the answer. A
            problem whose model alone would take longer gets its trivial bound and a message. Below
            one second it counts as one for that.
        joint: That joint alone, counted from 0.

    Raises:
        InvalidInput: An argument cannot be used.
        MissingBackend: HiGHS or SCIP is not installed.
        TrajoptError: HiGHS or SCIP breaks down.
    """
    for name, value in (("within", within), ("time_limit", time_limit)):
        if not value > 0:
            raise InvalidInput(name, "a positive number", value=value)
    began = time.perf_counter()
    question = _asked(problem, family, joint)
    reason = question.infeasible()
    needed = question.kind.expected_seconds(question.problem)
    if reason is not None:
        bound = Bound(np.inf, np.inf, 0.0, "infeasible", 0.0, None, reason)
    elif needed > max(time_limit, _GRACE_SECONDS):
        bound = _not_begun(question.problem, needed, time_limit)
    elif family == "free":
        bound = _free(question.problem, within, began, time_limit)
    else:
        scip = backend("pyscipopt")
        program = question.kind(question.problem, scip, seconds=time_limit)
        bound = _prove(question.problem, program, within, began + time_limit)
    trajectory = bound.trajectory
    if trajectory is not None:
        trajectory = Trajectory(
            trajectory.breaks,
            trajectory.coefficients,
            trajectory.waypoint_times[question.index],
        )
    return replace(bound, trajectory=trajectory, solve_time=time.perf_counter() - began)


def recheck(
    problem: Problem,
    lower_bound: float,
    family: Family = "free",
    *,
    time_limit: float = 60.0,
    joint: int | None = None,
) -> bool | None:
    """Prove again that no trajectory is faster than a bound that someone states.

    SCIP gets the bound as its cut-off: that it finds nothing is the proof. A bound that comes out
    again to 1e-9 counts as proved.

    Args:
        problem, family, time_limit, joint: As for `certify`.
        lower_bound: What is stated, s.

    Returns:
        True if proved, False if refuted (a trajectory that keeps every limit is faster), None if
        neither within the time limit.

    Raises:
        InvalidInput: The bound is not a number, or an argument cannot be used.
    """
    if np.isnan(lower_bound):
        raise InvalidInput("lower_bound", "a number", value=lower_bound)
    deadline = time.perf_counter() + time_limit
    question = _asked(problem, family, joint)
    if lower_bound <= trivial_bound(question.problem) * (1 + _RECHECK_RTOL):
        return True
    if question.infeasible() is not None:
        return True
    if family == "free" and _stopping_is_faster(question.problem, lower_bound):
        return False
    if question.kind.expected_seconds(question.problem) > max(time_limit, _GRACE_SECONDS):
        return None
    scip = backend("pyscipopt")
    program = question.kind(question.problem, scip, seconds=time_limit)
    return _proved_again(question.problem, program, lower_bound, deadline)


def _asked(problem: Problem, family: Family, joint: int | None) -> _Question:
    if family not in ("free", "spline353"):
        raise InvalidInput("family", "'free' or 'spline353'", value=family)
    problem, index = problem.merged()
    if joint is not None:
        problem = _alone(problem, joint)
    if joint is not None and family == "free":
        # alone, the joint may rest over a segment
        problem, own_index = problem.merged()
        index = own_index[index]
    return _Question(problem, family, index)


def _alone(problem: Problem, joint: int) -> Problem:
    if not 0 <= joint < problem.joints or not problem.moving[joint]:
        raise InvalidInput("joint", "the index of a joint that moves", value=joint)
    return problem.only([joint])


def _not_begun(problem: Problem, needed: float, time_limit: float) -> Bound:
    """The trivial bound, where a time limit (s) leaves no room for anything else."""
    message = (
        f"{described(problem)} need about {needed:.0f} s before a proof can begin, "
        f"more than the limit of {time_limit:g} s: this is the trivial bound"
    )
    return Bound(
        lower_bound=trivial_bound(problem),
        upper_bound=np.inf,
        proved_within=np.inf,
        status="time limit",
        solve_time=0.0,
        trajectory=None,
        message=message,
    )


def _free(problem: Problem, within: float, began: float, time_limit: float) -> Bound:
    """Linear programs under every limit; SCIP too where they leave something that it can prove."""
    deadline = began + time_limit
    best = incumbent(problem, _INCUMBENT_SHARE * time_limit)
    # without a trajectory there is something to prove all the same
    known = float(stop_times(problem).sum())
    if best is not None:
        known = best.duration
    for_scip = not (problem.has("jerk") or problem.has("position"))
    share = _PROGRAMS_SHARE if for_scip else 1.0
    end = began + share * time_limit
    outcome = prove(problem, known / (1 + within), within, end)
    late = time.perf_counter() > end
    lower = outcome.lower_bound
    own_proof: Proof | None = outcome.proof
    trivial = trivial_bound(problem)
    if trivial > lower * (1 + within):
        lower = trivial
        own_proof = None
    if best is None:
        return Bound(lower, np.inf, np.inf, "time limit", 0.0, None, proof=own_proof)
    status = "time limit" if late else "stopped: no progress"
    if best.duration <= lower * (1 + within) * (1 + 1e-12):
        status = "proved"
    bound = Bound(
        lower_bound=lower,
        upper_bound=best.duration,
        proved_within=best.duration / lower - 1,
        status=status,
        solve_time=0.0,
        trajectory=best.trajectory,
        proof=own_proof,
    )
    if status == "proved" or not for_scip or time.perf_counter() > deadline:
        return bound
    program = Free(problem, backend("pyscipopt"), seconds=deadline - time.perf_counter())
    by_scip = _prove(problem, program, within, deadline)
    if by_scip.lower_bound > lower:
        return by_scip
    return replace(bound, status=by_scip.status)


def _prove(problem: Problem, program: Program, within: float, deadline: float) -> Bound:
    """Ask for anything shorter than the incumbent by `within` until there is none, or no time."""
    best = program.incumbent()
    lower = program.trivial_bound
    word = "timelimit"
    while (left := deadline - time.perf_counter()) > 0:
        # SCIP's tolerance is allowed for in advance, as far as `within` leaves room for it
        allowance = min(program.margin, within / 2)
        cutoff = best.duration * (1 + allowance) / (1 + within)
        word, dual, answer = _solved(program, cutoff, left)
        lower = max(lower, dual / (1 + program.margin))
        if answer is not None and answer.duration < best.duration:
            best = answer
        asked_anew = answer is not None and program.exchanges
        if not asked_anew or best.duration <= lower * (1 + within):
            break
    if lower > best.duration * (1 + 1e-9):
        raise TrajoptError(f"the bound {lower} s is above a trajectory of {best.duration} s")
    status = _STATUSES.get(word, f"stopped: {word}")
    if best.duration <= lower * (1 + within) * (1 + 1e-12):
        status = "proved"
    return _bound(problem, best, min(lower, best.duration), status)


def _proved_again(
    problem: Problem, program: Program, lower_bound: float, deadline: float
) -> bool | None:
    incumbent = program.incumbent()
    if _is_faster(problem, incumbent, lower_bound):
        return False
    while (left := deadline - time.perf_counter()) > 0:
        cutoff = lower_bound * (1 + program.margin)
        _, dual, answer = _solved(program, cutoff, left)
        if dual / (1 + program.margin) >= lower_bound * (1 - _RECHECK_RTOL):
            return True
        if answer is None:
            return None
        if _is_faster(problem, answer, lower_bound):
            return False
        if not program.exchanges:
            return None
    return None


def _stopping_is_faster(problem: Problem, lower_bound: float) -> bool:
    """Stopping at every waypoint keeps position limits too: it never leaves the waypoints' box."""
    return float(stop_times(problem).sum()) < lower_bound * (1 - _RECHECK_RTOL)


def _is_faster(problem: Problem, trajectory: Trajectory, lower_bound: float) -> bool:
    """Whether a trajectory, verified under all limits, refutes a lower bound."""
    duration = verify(problem, trajectory).certified_duration
    return duration is not None and duration < lower_bound * (1 - _RECHECK_RTOL)


def _solved(
    program: Program, cutoff: float | None, seconds: float
) -> tuple[str, float, Trajectory | None]:
    """SCIP's status, its dual bound (s, at most the cut-off), and what its solution leads to."""
    if cutoff is None:
        model = program.model(None)
        highest = np.inf
    else:
        model = program.model(cutoff / program.unit)
        highest = cutoff
    word, dual = _optimised(model, seconds)
    return word, min(dual * program.unit, highest), program.improved(model)


def _optimised(model: Any, seconds: float) -> tuple[str, float]:
    """SCIP's status and dual bound, in the program's units."""
    model.hideOutput()
    for name in ("numerics/feastol", "numerics/epsilon", "numerics/dualfeastol"):
        model.setRealParam(name, TOLERANCE)
    model.setRealParam("limits/time", max(seconds, _SHORTEST_SCIP_SECONDS))
    try:
        model.optimize()
    except Exception as error:
        raise TrajoptError(f"SCIP failed: {error}") from error
    return str(model.getStatus()), float(model.getDualbound())


def _bound(problem: Problem, best: Trajectory, lower: float, status: str) -> Bound:
    duration = verify(problem, best).certified_duration
    if duration is None:
        return Bound(lower, np.inf, np.inf, status, 0.0, None)
    return Bound(lower, duration, duration / lower - 1, status, 0.0, best)
