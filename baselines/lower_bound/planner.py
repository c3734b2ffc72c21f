"""The registered planner of proved lower bounds."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from trajopt.core.demand import END_STATES, WHOLE_TIMES, names
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import LIMIT_NAMES, FallingVelocity, Limit
from trajopt.core.numerals import rounded_down
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline353
from trajopt.planners.planner import Planner, Relation
from trajopt.planners.reductions import SIMPLEST

if TYPE_CHECKING:  # the proofs are imported when they are used: listing planners does not need them
    from baselines.lower_bound.bound import Bound

AGREEMENT_RTOL = 1e-6  # durations of starts that differ by less, relative, count as equal


@dataclass(frozen=True)
class Prove(Planner):
    """A proved lower bound on the minimum time, and the fastest motion known (HiGHS).

    It uses velocity, acceleration, jerk, position and falling velocity limits. Other kinds are left
    out, which keeps the bound valid; the message says so. Least times of segments that follow from
    them (`trajopt.core.limits.Limit.least_times`) count.

    - `within`: relative gap of upper and lower bound at which to stop;
    - `time_limit`: s of CPU time, including that to build the model; then the bounds reached are
      the answer;
    - `family`: `free` bounds every trajectory, `spline353` only the 3-5-3 splines with shared
      times. Then the bound is in `stats`, not in the solution's `lower_bound`.
    """

    within: float = 1e-4
    time_limit: float = 60.0
    family: Literal["free", "spline353"] = "free"

    on_request = True
    requires = ("highspy", "casadi", "scipy.linalg")
    knows = (
        *(*LIMIT_NAMES, FallingVelocity.key, "segment"),
        *(*END_STATES, *WHOLE_TIMES, "least_times", "dwell", "closed", "tolerance"),
    )
    drops = True

    def __post_init__(self) -> None:
        for name in ("within", "time_limit"):
            if not getattr(self, name) > 0:
                raise InvalidInput(name, "a positive number", value=getattr(self, name))

    def unknown(self, problem: Problem) -> list[str]:
        """Return the kinds of limits that are left out; for splines also falling velocities."""
        left_out = super().unknown(problem)
        if self.family != "free" and problem.has(FallingVelocity.key):
            left_out.append(FallingVelocity.key)
        return left_out

    def relation(self, problem: Problem) -> Relation:
        if self.family != "free":
            return Relation.RESTRICTION
        return Relation.RELAXATION if self.unknown(problem) else Relation.SAME

    def unsupported(self, problem: Problem) -> str | None:
        if self.family == "free":
            return None
        if problem.demands:
            return f"its bound of splines does not know {names(problem.demands)}"
        if problem.limits.segments is not None:
            return "it bounds 3-5-3 splines under limits that are the same in all segments only"
        return spline353.unsupported(problem)

    def tightened(self, problem: Problem, left_out: Sequence[Limit]) -> Problem:
        """Return the problem with the least times of segments that limits left out imply.

        Where a motion may miss waypoints by rounding there are none: the times are those of ways
        through them.
        """
        if self.family != "free" or "given_times" in problem.demands:
            return problem
        merged, _ = problem.merged()
        if spared(merged).any():
            return problem
        stated = problem.route.demand("least_times")
        least = np.maximum.reduce([stated, *(own.least_times(problem) for own in left_out)])
        if (least == stated).all():
            return problem
        return replace(problem, demands={**problem.demands, "least_times": least})

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return the lower bound, and the fastest trajectory known if it keeps every limit.

        `stats`: `proof` (its status), `lower_bound` and `upper_bound`, s, and `proved_within`; the
        last two are NaN if no trajectory is known. The arrays of `dual_check.BoundProof` or
        `ratio_boxes.RatioProof` are there too, to check the proof without a solver.
        """
        bound = self.bound(problem)
        if bound.status == "infeasible":
            proof = bound.proof.arrays() if bound.proof else {}
            stated = bound.lower_bound if np.isfinite(bound.lower_bound) else None
            return Solution(Status.INFEASIBLE, None, bound.message, stated, stats=proof)
        known = np.isfinite(bound.upper_bound)
        stats: dict[str, Any] = {
            "proof": bound.status,
            "lower_bound": bound.lower_bound,
            "upper_bound": bound.upper_bound if known else np.nan,
            "proved_within": bound.proved_within if known else np.nan,
        }
        if bound.proof is not None:
            stats |= bound.proof.arrays()
        lower_bound = bound.lower_bound if self.family == "free" else None
        message = self._message(bound)
        if bound.trajectory is None:
            return Solution(Status.INVALID, None, message, lower_bound, stats=stats)
        return Solution(Status.SOLVED, bound.trajectory, message, lower_bound, stats=stats)

    def bound(self, problem: Problem) -> Bound:
        """Return both bounds, as `baselines.lower_bound.bound.prove` does."""
        from baselines.lower_bound.bound import prove

        return prove(problem, self.family, within=self.within, time_limit=self.time_limit)

    def beside(self, problem: Problem, motion: Trajectory) -> float:
        """Return a lower bound, s, with a motion that keeps every limit as the target.

        It takes the place of the motion that `solve` plans first.
        """
        from baselines.lower_bound.bound import prove

        shown, _ = self._shown(problem)
        bound = prove(
            shown, self.family, within=self.within, time_limit=self.time_limit, known=motion
        )
        return bound.lower_bound

    def stored_bound(self, problem: Problem, stats: Mapping[str, Any]) -> float | None:
        """Return the bound, s, that the proof among a solution's `stats` proves, without a solver.

        None without a proof: the bound is in closed form, or there is no bound.

        Raises:
            InvalidInput: The proof is damaged, or belongs to another problem.
        """
        from baselines.lower_bound import dual_check, ratio_boxes

        shown, _ = self._shown(problem)
        if self.family == "free":
            of_all = dual_check.BoundProof.stored(stats)
            # the check derives least times of limits that it knows from the limits themselves
            stated = replace(problem, demands=shown.demands)
            return None if of_all is None else dual_check.proved_bound(stated, of_all)
        simplest = SIMPLEST.apply(shown)
        of_splines = ratio_boxes.RatioProof.stored(stats, simplest)
        return None if of_splines is None else ratio_boxes.proved_bound(simplest, of_splines)

    def _message(self, bound: Bound) -> str:
        about = "trajectory" if self.family == "free" else "3-5-3 spline"
        lower = rounded_down(bound.lower_bound, ".9g")
        text = f"no {about} is faster than {lower} s ({bound.status})"
        if bound.message:
            return f"{text}; {bound.message}"
        if bound.trajectory is None:
            return f"{text}; the fastest breaks a limit that the bound lifts"
        if bound.status == "proved":
            return text
        above = f"the fastest known is {100 * bound.proved_within:.3g} % above"
        if bound.disagreement is None or bound.disagreement <= AGREEMENT_RTOL:
            return f"{text}; {above}"
        if np.isinf(bound.disagreement):
            return f"{text}; {above}: one of its planner's starts succeeded alone"
        apart = f"{100 * bound.disagreement:.2g} %"
        return f"{text}; {above}, and its planner's starts disagree by {apart}"
