"""Judge a published time, a claim without a trajectory (docs/mathematics.md, section 8).

known = survey(problem, families=["3-5-3"])
judgement = judge(claim, known)
print(judgement.verdict, judgement.excess, known.stopping)
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np

from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.explain.references import (
    BEST_OF_FAMILY,
    OPTIMUM_WITH_JERK,
    PROOF,
    STOPPING,
    THROUGH_WAYPOINTS,
    ReferenceAnswer,
    asked,
    references,
    under_peak_jerk,
)
from trajopt.planners.registry import load
from trajopt.planners.rest_to_rest import end_to_end_bound, stop_times

# A best known duration this close to its lower bound is the optimum, proved.
PROVED_RTOL = 1e-3
# An answer closer to the bound than this is at the bound; it exceeds rounding errors.
_MET_RTOL = 1e-6


class Verdict(StrEnum):
    """Verdicts on a claim; its last printed digit is rounded in its favour."""

    IMPOSSIBLE = "impossible"
    UNPROVED = "unproved"
    EQUAL = "equal"
    ABOVE = "above"
    OPEN = "open"


MEANINGS = {
    Verdict.IMPOSSIBLE: "shorter than a proved lower bound: no motion does it under these limits",
    Verdict.UNPROVED: "shorter than the best known motion; no proof refutes it",
    Verdict.EQUAL: "as long as the best known motion, to the digits printed",
    Verdict.ABOVE: "longer than the best known motion",
    Verdict.OPEN: "nothing is known to compare it with",
}


@dataclass(frozen=True)
class Claim:
    """A published duration.

    Attributes:
        method: the method that found it, and its author where the source quotes another.
        duration: s.
        rounding: half a unit of the last printed digit, s.
        table: table of the source that prints it.
        objective: objective that was optimised.
        family: of trajectories, where the toolkit knows the family's best (`BEST_OF_FAMILY`).
        peak_jerk: that the source prints for this trajectory, rad/s³, one per joint.
    """

    method: str
    duration: float
    rounding: float = 0.0
    table: str = ""
    objective: str = ""
    family: str = ""
    peak_jerk: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if not 0 < self.duration < np.inf:
            raise InvalidInput("time", "a positive duration", value=self.duration)
        if not 0 <= self.rounding < np.inf:
            raise InvalidInput("rounding", "0 or more seconds", value=self.rounding)
        if self.family and self.family not in BEST_OF_FAMILY:
            known = ", ".join(BEST_OF_FAMILY)
            raise InvalidInput("family", f"one of {known}, or none", value=self.family)


@dataclass(frozen=True, eq=False)
class Known:
    """Best known motion and lower bound of a problem; every duration is the verifier's, s.

    Attributes:
        problem: waypoints and limits.
        best: the shortest certified duration, None if no planner has one.
        best_by: that planner's name, or the reasons why every planner failed.
        lower_bound: no trajectory takes less; proved.
        bound_by: what proved it.
        stopping: the fastest motion that rests at every inner waypoint.
        best_of_family: the shortest certified duration within a family, by the family's name.
        trajectory: of the best.
    """

    problem: Problem
    best: float | None
    best_by: str
    lower_bound: float
    bound_by: str
    stopping: float
    best_of_family: Mapping[str, float]
    trajectory: Trajectory | None = field(repr=False, default=None)

    @property
    def width(self) -> float | None:
        """Return the relative distance of the best known duration from the lower bound."""
        if self.best is None:
            return None
        return self.best / self.lower_bound - 1

    @property
    def proved(self) -> bool:
        """Return whether the best known is the optimum, within `PROVED_RTOL`."""
        return self.width is not None and self.width <= PROVED_RTOL


@dataclass(frozen=True, eq=False)
class JudgedClaim:
    """A claim and its verdict; ratios minus 1, None without a duration to compare with.

    Attributes:
        claim: the published duration.
        verdict: by the lower bound first, then by the best known.
        excess: over the best known.
        over_stopping: over stopping at every waypoint.
        over_family: over the best of its own family.
        over_equal_jerk: over the best known under the peak jerks that the source prints for it.
    """

    claim: Claim
    verdict: Verdict
    excess: float | None
    over_stopping: float
    over_family: float | None
    over_equal_jerk: float | None


def survey(problem: Problem, families: Iterable[str] = (), *, time_limit: float = 20.0) -> Known:
    """Run every reference on a problem; its claims are judged by their answers.

    Args:
        problem: waypoints and limits.
        families: whose best member is wanted too.
        time_limit: for the proof of the lower bound, s.
    """
    bound_by = "closed form"
    bound = end_to_end_bound(problem)
    best_by, best = _best(problem, bound)
    if not _met(best, bound):
        bound_by, bound = _proved(problem, bound, time_limit)
    best_of_family = {}
    for family in families:
        answer = asked(BEST_OF_FAMILY[family], problem)
        if answer.duration is not None:
            best_of_family[family] = answer.duration
    return Known(
        problem,
        best.duration,
        best_by,
        bound,
        bound_by,
        stopping=_stopping(problem),
        best_of_family=best_of_family,
        trajectory=best.trajectory,
    )


def _stopping(problem: Problem) -> float:
    """Return the duration of stopping at every inner waypoint, s; NaN if it is not known."""
    if problem.route.at_rest:
        return float(stop_times(problem).sum())
    return asked(STOPPING, problem).duration or np.nan


def judge_claim(claim: Claim, known: Known) -> JudgedClaim:
    """Return the verdict on a claim, and its ratios to the known durations."""
    under_jerk = None
    if claim.peak_jerk is not None:
        equal = under_peak_jerk(known.problem, claim.peak_jerk)
        under_jerk = asked(OPTIMUM_WITH_JERK, equal).duration
    return JudgedClaim(
        claim,
        verdict(claim, known),
        excess=_over(claim, known.best),
        over_stopping=claim.duration / known.stopping - 1,
        over_family=_over(claim, known.best_of_family.get(claim.family)),
        over_equal_jerk=_over(claim, under_jerk),
    )


def verdict(claim: Claim, known: Known) -> Verdict:
    """Return the verdict on the longest duration that rounds to the printed claim."""
    longest = claim.duration + claim.rounding
    if longest < known.lower_bound:
        return Verdict.IMPOSSIBLE
    if known.best is None:
        return Verdict.OPEN
    if longest < known.best:
        return Verdict.UNPROVED
    if claim.duration - claim.rounding <= known.best:
        return Verdict.EQUAL
    return Verdict.ABOVE


def _best(problem: Problem, bound: float) -> tuple[str, ReferenceAnswer]:
    """Return the planner and its shortest certified answer, or why no planner has one.

    No further planner runs once an answer is at the lower bound.
    """
    shortest = ReferenceAnswer(None)
    by = ""
    reasons = []
    for name in (THROUGH_WAYPOINTS, *references(problem)):
        if _met(shortest, bound):
            break
        answer = asked(name, problem)
        if answer.duration is None:
            reasons.append(f"{name}: {answer.reason}")
        elif shortest.duration is None or answer.duration < shortest.duration:
            shortest = answer
            by = name
    return by or "; ".join(reasons), shortest


def _met(answer: ReferenceAnswer, bound: float) -> bool:
    """Return whether an answer is at the lower bound."""
    return answer.duration is not None and answer.duration <= bound * (1 + _MET_RTOL)


def _proved(problem: Problem, closed_form: float, time_limit: float) -> tuple[str, float]:
    """Return the higher of the solver's bound and the closed form, and its name."""
    try:
        proof = load(f"{PROOF}:time_limit={time_limit}").solve(problem)
    except TrajoptError:
        return "closed form", closed_form
    if proof.lower_bound is None or proof.lower_bound < closed_form:
        return "closed form", closed_form
    return PROOF, proof.lower_bound


def _over(claim: Claim, duration: float | None) -> float | None:
    if duration is None:
        return None
    return claim.duration / duration - 1
