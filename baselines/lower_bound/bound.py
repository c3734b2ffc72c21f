"""Prove a lower bound on the minimum time, and return the shortest verified trajectory.

Linear programs bound all trajectories under every kind of limit (`branching.py`, `dual_check.py`).
Boxes of two ratios bound the 3-5-3 splines with shared times (`ratio_boxes.py`). Both searches end
if nothing is shorter than the incumbent by a given share. Each bound has a proof that is checked
without a solver.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from baselines.lower_bound import decisive, ratio_boxes
from baselines.lower_bound.apart import counted, relaxed
from baselines.lower_bound.branching import MAX_IDLE_SPLITS, ProvedBound, branch_and_bound
from baselines.lower_bound.dual_check import BoundProof
from baselines.lower_bound.incumbent import Incumbent, incumbent, kept
from baselines.lower_bound.ratio_boxes import RatioProof
from baselines.sizes import cells, described
from trajopt.core.arrays import Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline353
from trajopt.planners.reductions import RESTING_JOINTS, SIMPLEST
from trajopt.planners.rest_to_rest import end_to_end_bound, stop_times

Family = Literal["free", "spline353"]

# A shorter time limit counts as this one, s, so that a proof can begin.
_MIN_TIME_LIMIT_S = 1.0
# Share of the time limit that an incumbent may take.
_INCUMBENT_SHARE = 0.3
# Time of one linear program and one start of `exact`, s per segment and joint (measured).
_SECONDS_PER_CELL = 5e-3
# Splits without progress before all waypoints count.
_FEW_IDLE_SPLITS = 3
# Segments from which on a problem within tolerance is bounded by its decisive parts first; what the
# first part may lose at least, whose proof is quick; and the factor from one part to the next.
_MANY_SEGMENTS = 8
_QUICK_LOSS = 5e-3
_LOSS_FACTOR = 4.0
# A part is proved to this share of the time that it may lose.
_SHARE_OF_LOSS = 0.25
# Rounding by which a verified duration may exceed the solver's, relative.
_ROUNDING_RTOL = 1e-9


@dataclass(frozen=True, eq=False)
class Bound:
    """Bounds on the minimum time. All times in seconds.

    Attributes:
        lower_bound: No trajectory takes less.
        upper_bound: The certified duration of `trajectory`; infinite without a trajectory that
            keeps every limit.
        proved_within: Upper over lower bound, minus 1.
        status: "proved" (within what was asked), "time limit", "stopped: no progress", or
            "infeasible" (no 3-5-3 spline keeps the position limits: the message says why, and both
            bounds are infinite).
        trajectory: The fastest one known.
        message: The reason if the time limit left no time to begin.
        proof: Proof of the lower bound, checked without a solver; None for a closed form.
        disagreement: Relative difference of the best two starts of the trajectory's planner; None
            where it states no starts.
    """

    lower_bound: float
    upper_bound: float
    proved_within: float
    status: str
    trajectory: Trajectory | None
    message: str = ""
    proof: BoundProof | RatioProof | None = None
    disagreement: float | None = None


def prove(
    problem: Problem,
    family: Family = "free",
    *,
    within: float = 1e-4,
    time_limit: float = 60.0,
    known: Trajectory | None = None,
) -> Bound:
    """Bound the minimum time, or that of the best 3-5-3 spline with shared times.

    Args:
        problem: All its limits are used.
        family: Any trajectory, or 3-5-3 splines only.
        within: Relative gap of upper and lower bound at which to stop, positive.
        time_limit: s of CPU time, so that no bound depends on what else the machine does; includes
            the time to build the programs. After it the bounds reached are the answer. If the first
            program alone takes longer than that, and longer than one second, the bound is one in
            closed form, and a message says so.
        known: A motion that keeps every limit, as the upper bound of all trajectories; by default
            one is planned here.

    Raises:
        InvalidInput: An argument cannot be used.
        MissingBackend: HiGHS is not installed.
        TrajoptError: HiGHS breaks down.
    """
    began = time.process_time()

    def late() -> bool:
        return time.process_time() > began + time_limit

    if family not in ("free", "spline353"):
        raise InvalidInput("family", "'free' or 'spline353'", value=family)
    simpler = SIMPLEST.apply(problem)
    if family == "free":
        given = None
        if known is not None:
            _, index = problem.merged()
            passed = known.waypoint_times[np.diff(index, prepend=-1) > 0]
            given = kept(
                simpler, RESTING_JOINTS.reduced(problem, replace(known, waypoint_times=passed))
            )
        bound = _free(simpler, within, late, time_limit, given)
    else:
        bound = _spline353(simpler, within, late)
    if isinstance(bound.proof, BoundProof) and bound.proof.joints.size:
        # a proof numbers all joints of its problem
        joints = np.flatnonzero(problem.moving)[bound.proof.joints.astype(np.intp)]
        bound = replace(bound, proof=replace(bound.proof, joints=joints.astype(float)))
    if bound.trajectory is None:
        return bound
    return replace(bound, trajectory=SIMPLEST.restored(problem, bound.trajectory))


def _free(
    problem: Problem,
    within: float,
    late: Callable[[], bool],
    time_limit: float,
    given_motion: Incumbent | None,
) -> Bound:
    """Bound all trajectories by linear programs, without the waypoints that rounding may miss."""
    needed = _SECONDS_PER_CELL * cells(problem)
    if needed > max(time_limit, _MIN_TIME_LIMIT_S):
        return _not_begun(problem, needed, time_limit)
    best = given_motion or incumbent(problem, _INCUMBENT_SHARE * time_limit)
    # without a trajectory, the time of stopping at every waypoint is the target
    waits = problem.route.demand("dwell").sum()
    least = problem.route.demand("least_times")
    known = float(np.maximum(stop_times(problem), least).sum() + waits)
    asked = float(problem.route.demand("least_duration"))
    if best is not None and best.duration <= asked * (1 + _ROUNDING_RTOL):
        return Bound(asked, best.duration, 0.0, "proved", best.trajectory)
    known = max(known, asked)
    given = _given(problem)
    if given:
        if best is not None:
            return Bound(given, best.duration, 0.0, "proved", best.trajectory)
        closed_form = end_to_end_bound(problem)
        if closed_form > given * (1 + _ROUNDING_RTOL):
            return _impossible(given, closed_form, None)
        known = given * (1 + within) ** 2
    if best is not None:
        known = best.duration
    lower, proof = 0.0, None
    for outcome in _outcomes(problem, known, within, late, best):
        if outcome.lower_bound > lower:
            lower, proof = outcome.lower_bound, outcome.proof
        if late() or lower * (1 + within) * (1 + _ROUNDING_RTOL) >= known:
            break
    if given and lower > given * (1 + _ROUNDING_RTOL):
        return _impossible(given, lower, proof)
    closed_form = end_to_end_bound(problem)
    if closed_form > lower * (1 + within):
        lower, proof = closed_form, None
    word = "time limit" if late() else "stopped: no progress"
    bound = _bound(lower, best, within, word, proof)
    if proof is None or not proof.waypoints.size:
        return bound
    return replace(bound, message=_left_out(problem, proof))


def _left_out(problem: Problem, proof: BoundProof) -> str:
    """Return in words what a proof does not count."""
    if proof.joints.size:
        sizes = ((proof.waypoints, len(problem.waypoints)), (proof.joints, problem.joints))
        some = [f"{own.size} of {every}" for own, every in sizes]
        return f"the bound counts waypoints: {some[0]}, moving joints: {some[1]}"
    numbers = np.setdiff1d(np.arange(len(problem.waypoints)), proof.waypoints) + 1
    said = "the bound leaves out waypoints that others' tolerances overlap: "
    return said + ", ".join(map(str, numbers.tolist()))


def _given(problem: Problem) -> float:
    """Return the time that is given for the whole motion, s; 0 where none is."""
    demand = problem.route.demand
    if "given_times" in problem.demands:
        return float(demand("given_times").sum() + demand("dwell").sum())
    return float(demand("duration"))


def _choices(problem: Problem) -> list[Indices | None]:
    """Return the waypoints to count, numbers from 0: all (None), or without what others imply."""
    if "tolerance" not in problem.demands:
        return [None]
    kept = counted(problem)
    if kept.all():
        return [None]
    fewer = np.flatnonzero(kept)
    return [fewer, None]


def _outcomes(
    problem: Problem,
    known: float,
    within: float,
    late: Callable[[], bool],
    best: Incumbent | None,
) -> Iterator[ProvedBound]:
    """Yield what searches prove: of decisive parts, then of most waypoints, then of all.

    Args:
        problem: Without identical consecutive waypoints; all joints move.
        known: Duration of the fastest motion known, s.
        within: Gap that is asked for, relative.
        late: Returns whether the time is over.
        best: The fastest motion known.
    """
    many = "tolerance" in problem.demands and problem.segments > _MANY_SEGMENTS
    # under jerk limits a part in motion takes the planner minutes
    quick = problem.route.at_rest or not problem.has("jerk")
    if many and best is not None and quick and not _given(problem):
        losses = [max(within / 2, decisive.LEAST_LOSS)]
        while losses[-1] < _QUICK_LOSS:
            losses.append(losses[-1] * _LOSS_FACTOR)
        for part in reversed(decisive.parts(problem, known, losses, late)):
            asked = max(within / 2, _SHARE_OF_LOSS * part.loss)
            target = part.known.duration / (1 + asked)
            moving = RESTING_JOINTS.apply(part.problem)
            motion = RESTING_JOINTS.reduced(part.problem, part.known.trajectory)
            found = branch_and_bound(moving, target, asked, late, motion)
            counts = {"waypoints": part.waypoints, "joints": part.joints}
            tables = {name: own.astype(float) for name, own in counts.items()}
            yield found._replace(proof=replace(found.proof, **tables))
    for waypoints in _choices(problem):
        outcome = _searched(problem, waypoints, known / (1 + within), within, late, best)
        if outcome is not None:
            yield outcome


def _searched(
    problem: Problem,
    waypoints: Indices | None,
    target: float,
    within: float,
    late: Callable[[], bool],
    best: Incumbent | None,
) -> ProvedBound | None:
    """Return what a search proves that counts these waypoints; None where nothing moves."""
    try:
        relaxation = relaxed(problem, waypoints)
    except InvalidInput:
        return None
    motion = None
    if best is not None:
        places = (
            np.flatnonzero(counted(problem)) if "tolerance" not in problem.demands else waypoints
        )
        times = best.trajectory.waypoint_times
        passed = times if places is None else times[places]
        motion = replace(best.trajectory, waypoint_times=passed)
        motion = RESTING_JOINTS.reduced(relaxation, motion)
    moving = RESTING_JOINTS.apply(relaxation)
    idle_splits = MAX_IDLE_SPLITS if waypoints is None else _FEW_IDLE_SPLITS
    found = branch_and_bound(moving, target, within, late, motion, idle_splits)
    if waypoints is None:
        return found
    return found._replace(proof=replace(found.proof, waypoints=waypoints.astype(float)))


def _impossible(given: float, lower: float, proof: BoundProof | None) -> Bound:
    """Return that no motion has the given time, s: the lower bound is above it."""
    message = f"no motion takes the given time, {given:.9g} s: it would take {lower:.9g} s"
    return Bound(lower, np.inf, np.inf, "infeasible", None, message, proof)


def _spline353(problem: Problem, within: float, late: Callable[[], bool]) -> Bound:
    """Bound the 3-5-3 splines by boxes of their two ratios."""
    if problem.segments != 3:
        raise InvalidInput("problem", "exactly 4 waypoints", value=problem.segments + 1)
    reason = spline353.infeasible(problem)
    if reason is not None:
        return Bound(np.inf, np.inf, 0.0, "infeasible", None, reason)
    times, proof = ratio_boxes.best_spline(problem, within, late)
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
    proof: BoundProof | RatioProof | None,
) -> Bound:
    """Return both bounds, with the status `otherwise` if the gap is larger than asked for."""
    if best is None:
        return Bound(lower, np.inf, np.inf, otherwise, None, proof=proof)
    proved = best.duration <= lower * (1 + within) * (1 + _ROUNDING_RTOL)
    return Bound(
        lower_bound=lower,
        upper_bound=best.duration,
        proved_within=best.duration / lower - 1 if lower else np.inf,
        status="proved" if proved else otherwise,
        trajectory=best.trajectory,
        proof=proof,
        disagreement=best.disagreement,
    )


def _not_begun(problem: Problem, needed: float, time_limit: float) -> Bound:
    """Return a bound in closed form if a time limit (s) is too short for a proof."""
    message = (
        f"{described(problem)} need about {needed:.0f} s before a proof can begin, "
        f"more than the limit of {time_limit:g} s: this is a bound in closed form"
    )
    lower = end_to_end_bound(problem)
    return Bound(lower, np.inf, np.inf, "time limit", None, message)
