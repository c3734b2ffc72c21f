"""The decomposition of a gap, and the active limits (docs/mathematics.md, section 6).

    trajectory = certified(problem, load("issa").solve(problem).trajectory)
    explanation = explain(problem, load("issa"), trajectory)
    print(explanation.gap, explanation.timing_gap, explanation.route_gap, explanation.notes)

Other planners are asked for what is needed: `trajopt.explain.references` says which.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from trajopt.core import dwell, polynomials
from trajopt.core.arrays import Array
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.explain.active_limits import ActiveLimit, active_limits, scattered
from trajopt.explain.references import (
    BEST_353,
    OPTIMUM_WITH_JERK,
    PATH_TIMING,
    ReferenceAnswer,
    asked,
    judged,
    references,
    under_peak_jerk,
)
from trajopt.judging.verification import certified, verify
from trajopt.planners import spline353
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load

# Two positions count as equal within this, relative to the largest coordinate, at least 1 rad.
_SAME_RTOL = 1e-9
# A record replaces the computed optimum if it is shorter by more than this, relative.
_RECORDED_RTOL = 1e-6
# Instants per segment: two piecewise quintics that agree there agree everywhere.
_SAMPLES = 50

_GAPS = ("gap", "timing_gap", "route_gap", "optimiser_gap", "shape_gap", "smoothness_gap")
# The parts of each decomposition, from the optimum up.
_CHAINS = {
    "path and timing": ("route", "timing"),
    "the 3-5-3 family": ("smoothness", "shape", "optimiser"),
}


@dataclass(frozen=True, eq=False)
class Explanation:
    """Two decompositions of one gap, and the active limits. Each gap is a ratio minus 1.

    - `gap = certified_duration / exact - 1`, both in seconds; `exact` is the best known optimum;
    - `1 + gap = (1 + timing_gap) (1 + route_gap)`: over the best timing of its own path, and that
      over the optimum;
    - `1 + gap = (1 + optimiser_gap) (1 + shape_gap) (1 + smoothness_gap)`, of a 3-5-3 spline: over
      the best 3-5-3, that over the optimum with its jerk, and that over the optimum.

    A gap that does not apply is None, and `notes` has the reason under its name. `trajectory`,
    `retimed`, the best timing of its path, and `optimum` are what was compared; `notes` says under
    "timing" where that path asks for stops. Where the optimum was recorded and not computed,
    `recorded` says where it comes from.
    """

    certified_duration: float
    exact: float | None
    gap: float | None
    timing_gap: float | None
    route_gap: float | None
    optimiser_gap: float | None
    shape_gap: float | None
    smoothness_gap: float | None
    notes: Mapping[str, str]
    active_limits: tuple[ActiveLimit, ...]
    trajectory: Trajectory = field(repr=False)
    optimum: Trajectory | None = field(repr=False)
    recorded: str = ""
    retimed: Trajectory | None = field(repr=False, default=None)

    def steps(self) -> dict[str, list[tuple[str, float]]]:
        """Both decompositions that apply, from the optimum up: what was added, the duration, s."""
        found = {}
        for title, names in _CHAINS.items():
            gaps = [getattr(self, f"{name}_gap") for name in names]
            if self.exact is None or None in gaps:
                continue
            ratios = 1 + np.array([0.0, *gaps])
            durations = np.cumprod(ratios) * self.exact
            steps = zip(("optimum", *names), durations, strict=True)
            found[title] = list(steps)
        return found

    def as_dict(self) -> dict[str, Any]:
        """For JSON: seconds, and gaps as ratios minus 1; joints count from 1."""
        return {
            "certified_duration": self.certified_duration,
            "exact": self.exact,
            "recorded": self.recorded,
            **{name: getattr(self, name) for name in _GAPS},
            "notes": self.notes,
            "active": [_row(limit) for limit in self.active_limits],
        }


def _row(active: ActiveLimit) -> dict[str, Any]:
    of_segment = {} if active.segment is None else {"segment": active.segment + 1}
    return {
        "joint": None if active.joint is None else active.joint + 1,
        "limit": active.limit,
        **of_segment,
        "from": active.start,
        "to": active.end,
        "saving": active.saving,
    }


def explain(
    problem: Problem,
    planner: Planner | None,
    trajectory: Trajectory,
    recorded: ReferenceAnswer | None = None,
) -> Explanation:
    """Decompose the gap of a planner's certified trajectory, and say which limits are active.

    Args:
        problem: The problem that the motion solves.
        planner: The planner; None for a motion that cannot be planned again.
        trajectory: The planner's motion.
        recorded: The best known motion, as a reference's answer; its reason states its origin. It
            replaces the optimum if it is shorter than the references' answers.

    Raises:
        TrajoptError: `trajectory` has no certified duration.
    """
    motion = certified(problem, trajectory)
    if motion is None:
        flaws = "; ".join(verify(problem, trajectory).flaws)
        raise TrajoptError(f"no certified duration, so nothing to explain: {flaws}")
    optimum = _optimum(problem)
    origin = ""
    computed = np.inf if optimum.duration is None else optimum.duration
    if recorded is not None and (recorded.duration or np.inf) < computed * (1 - _RECORDED_RTOL):
        optimum = recorded
        origin = recorded.reason
    retimed = _retimed(problem, motion)
    gaps, notes = _gaps(problem, motion, retimed, optimum)
    solver, savings_are_of = _solver(planner, problem, motion)
    active = active_limits(problem, motion, solver)
    if scattered(active, motion.duration, dilatable=problem.route.dilatable):
        savings_are_of += "; a local search: some of it is luck, no optimum changes like this"
    return Explanation(
        motion.duration,
        optimum.duration,
        **gaps,
        notes=notes | {"saving": savings_are_of},
        active_limits=active,
        trajectory=motion,
        optimum=optimum.trajectory,
        recorded=origin,
        retimed=retimed.trajectory,
    )


def _solver(
    planner: Planner | None, problem: Problem, trajectory: Trajectory
) -> tuple[Planner | None, str]:
    """Return a solver for relaxed limits. A swarm is replaced: its scatter exceeds the savings."""
    if planner is not None and not planner.stochastic:
        return planner, "this planner, planning again"
    if planner is not None and _is_spline353(problem, trajectory):
        return load(BEST_353), "the best 3-5-3, found again"
    if not problem.route.dilatable:
        return None, "not known: this trajectory cannot be dilated"
    return None, "this trajectory, dilated less"


def _gaps(
    problem: Problem, trajectory: Trajectory, retimed: ReferenceAnswer, optimum: ReferenceAnswer
) -> tuple[dict[str, float | None], dict[str, str]]:
    """Return every gap by name; None, with a note, where it does not apply."""
    answer = ReferenceAnswer(trajectory)
    best = _best_spline(problem, trajectory)
    smooth = _as_smooth(problem, best)
    pairs = {
        "gap": (answer, optimum),
        "timing_gap": (answer, retimed),
        "route_gap": (retimed, optimum),
        "optimiser_gap": (answer, best),
        "shape_gap": (best, smooth),
        "smoothness_gap": (smooth, optimum),
    }
    gaps: dict[str, float | None] = {}
    notes = {}
    if retimed.trajectory is not None and retimed.reason:
        notes["timing"] = retimed.reason
    for name, (above, below) in pairs.items():
        if above.duration is None or below.duration is None:
            gaps[name] = None
            notes[name] = above.reason or below.reason
        else:
            ratio = above.duration / below.duration
            gaps[name] = ratio - 1
    return gaps, notes


def _optimum(problem: Problem) -> ReferenceAnswer:
    """Return the first reference answer that keeps all limits, also those its planner ignores."""
    reason = ""
    for name in references(problem):
        answer = asked(name, problem)
        if answer.trajectory is not None:
            return answer
        reason = f"{name}: {answer.reason}"
    return ReferenceAnswer(None, reason)


def _shorter(trajectory: Trajectory, answer: ReferenceAnswer) -> ReferenceAnswer:
    """Return the trajectory if it is not longer than the answer, else the answer."""
    if answer.duration is not None and trajectory.duration <= answer.duration:
        return ReferenceAnswer(trajectory)
    return answer


def _retimed(problem: Problem, trajectory: Trajectory) -> ReferenceAnswer:
    """Return the best timing of the trajectory's own path, or its own if that is shorter.

    The reason of an answer says where the path has to stop.
    """
    try:
        planner = load(PATH_TIMING)
        reason = planner.unsupported(problem)
        if reason is not None:
            return ReferenceAnswer(None, reason)
        solution = _along(planner, problem, trajectory)
        answer = judged(problem, planner, solution)
    except TrajoptError as error:
        return ReferenceAnswer(None, str(error))
    shorter = _shorter(trajectory, answer)
    return shorter._replace(reason=answer.reason or solution.message)


def _along(planner: Planner, problem: Problem, trajectory: Trajectory) -> Solution:
    """Return the planner's timing of the trajectory's path, part by part if it waits in between."""
    if not planner.splits(problem):
        return planner.along(problem, trajectory)
    cut = dwell.cut(problem, trajectory) or []
    parts = zip(dwell.parts(problem), cut, strict=True)
    answers = [planner.along(part, trajectory.motion) for part, trajectory in parts]
    motions = [answer.trajectory for answer in answers if answer.trajectory is not None]
    if len(motions) < len(answers):
        return next(answer for answer in answers if answer.trajectory is None)
    said = "; ".join(answer.message for answer in answers if answer.message)
    return Solution(Status.SOLVED, dwell.joined(problem, motions), said)


def _best_spline(problem: Problem, trajectory: Trajectory) -> ReferenceAnswer:
    """Return the best 3-5-3 with shared times, if the trajectory is such a spline."""
    if not _is_spline353(problem, trajectory):
        return ReferenceAnswer(None, "not a 3-5-3 spline with segment times shared by all joints")
    return _shorter(trajectory, asked(BEST_353, problem))


def _is_spline353(problem: Problem, trajectory: Trajectory) -> bool:
    """Return whether a trajectory is the 3-5-3 spline with its own waypoint times."""
    merged, index = problem.merged()
    _, passed = np.unique(index, return_index=True)
    times = np.diff(trajectory.waypoint_times[passed])
    if spline353.unsupported(problem) is not None or not (times > 0).all():
        return False
    spline = spline353.trajectory(merged, times)
    instants = [np.linspace(a, b, _SAMPLES) for a, b in pairwise(spline.breaks)]
    t = np.concatenate(instants)
    difference = np.abs(spline(t) - trajectory(t)).max()
    scale = max(1.0, float(np.abs(problem.waypoints).max()))
    return bool(difference <= _SAME_RTOL * scale)


def _as_smooth(problem: Problem, spline: ReferenceAnswer) -> ReferenceAnswer:
    """Return the optimum with each joint's peak jerk in this spline as its jerk limit."""
    if spline.trajectory is None:
        return spline
    equal = under_peak_jerk(problem, peaks(spline.trajectory, order=3))
    return _shorter(spline.trajectory, asked(OPTIMUM_WITH_JERK, equal))


def peaks(trajectory: Trajectory, order: int) -> Array:
    """Return the exact largest absolute value of a derivative, rad/s^order, `(joints,)`."""
    unit = trajectory.pieces(order)
    flat = unit.reshape(len(unit), -1)
    at = polynomials.critical_points(flat)
    values = polynomials.evaluate(flat[:, None], at)
    highest = np.abs(values).max(axis=0)
    by_piece = highest.reshape(unit.shape[1:])
    return by_piece.max(axis=0)
