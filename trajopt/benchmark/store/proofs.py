"""Check the stored proof of a lower bound again, without a solver."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Protocol, runtime_checkable

from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.renamed import current
from trajopt.explain.references import BEST_KNOWN, PROOF
from trajopt.planners.planner import Relation
from trajopt.planners.registry import configured, entries
from trajopt.planners.rest_to_rest import end_to_end_bound

# How far a recorded bound may be above what is proved: closed forms differ by their rounding.
ROUNDING_RTOL = 1e-12
# And below: bounds that were checked in floats were lowered by all rounding that may have occurred.
LOWERED_RTOL = 1e-8

PROVED_AGAIN = "proved again"
NOT_RECHECKED = "not rechecked"
NOT_PROVED = "not proved"


@runtime_checkable
class StoresProofs(Protocol):
    """A planner whose solutions carry a proof of their bound, which needs no solver."""

    def relation(self, problem: Problem) -> Relation:
        """Return how the planner's answers and bounds relate to the optimum."""
        ...

    def stored_bound(self, problem: Problem, stats: Mapping[str, Any]) -> float | None:
        """Return the bound that the proof among `stats` proves, s; None without a proof."""
        ...


def rechecked(trial: Trial) -> tuple[str, list[str]]:
    """Return the result of checking a trial's lower bound, and what does not hold.

    The first is `PROVED_AGAIN`, `NOT_PROVED`, `NOT_RECHECKED` (its planner is not installed, or
    proves nothing), or empty where there is no bound.
    """
    bound = trial.lower_bound
    if bound is None:
        # a bound on some trajectories only, as of the 3-5-3 splines
        bound = trial.solution.stats.get("lower_bound")
    if bound is None:
        return "", []
    if not isinstance(bound, float | int):
        return NOT_PROVED, ["lower bound: it is no number"]
    planner = _planner(trial)
    if planner is None:
        return NOT_RECHECKED, []
    if trial.lower_bound is not None and planner.relation(trial.problem) is Relation.RESTRICTION:
        return NOT_PROVED, [f"lower bound: {trial.label} bounds some trajectories only"]
    try:
        now = _proved(planner, trial)
    except TrajoptError as error:
        return NOT_PROVED, [f"lower bound: {error}"]
    if now * (1 - LOWERED_RTOL) <= bound <= now * (1 + ROUNDING_RTOL):
        return PROVED_AGAIN, []
    return NOT_PROVED, [f"lower bound: recorded {bound:.9g}, computed {now:.9g}"]


def proved(trial: Trial) -> float:
    """Return the lower bound that a trial's proof gives, s, without a solver.

    Raises:
        TrajoptError: The proof is damaged, or what checks it is not installed.
    """
    planner = _planner(trial)
    if planner is None:
        raise TrajoptError(f"lower bound of {trial.label}: nothing installed here checks its proof")
    return _proved(planner, trial)


def _proved(planner: StoresProofs, trial: Trial) -> float:
    """Return the bound of the stored proof; without one, the bound in closed form."""
    bound = planner.stored_bound(trial.problem, trial.solution.stats)
    return end_to_end_bound(trial.problem) if bound is None else bound


def _planner(trial: Trial) -> StoresProofs | None:
    """The trial's planner with its options, where it is installed and stores proofs."""
    name, options = current(trial.planner), trial.options
    if name == BEST_KNOWN:
        name, options = PROOF, {}
    entry = entries().get(name)
    if entry is None or entry.missing():
        return None
    try:
        planner = configured(entry.load(), options, name)
    except TrajoptError:
        return None
    return planner if isinstance(planner, StoresProofs) else None
