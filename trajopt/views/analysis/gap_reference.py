"""The reference of gaps: the shortest motion known for a problem, and the proved lower bound.

    references(trials)      # by the problem's digest
    best(trials)            # with the motion, for `results.h5`
    improvements(trials)    # answers that are better than the best known

Durations are in seconds, and NaN is what does not exist.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from math import inf, isnan, nan
from typing import Literal

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import BETTER_RTOL, CLOSED_WITHIN
from trajopt.benchmark.store.layout import BestMotion
from trajopt.benchmark.trial import Trial
from trajopt.core.problem import Problem
from trajopt.explain.references import PROVERS, REFERENCES
from trajopt.planners.planner import Relation
from trajopt.planners.rest_to_rest import end_to_end_bound
from trajopt.views.analysis.versions import by_problem, newest

Kind = Literal["exact", "refined", "best known", "relaxed", "lower bound"]

OPTIMA = ("exact", "refined", "best known")  # kinds of references that are motions


@dataclass(frozen=True)
class Reference:
    """The duration that the gaps on a problem are measured against.

    Attributes:
        duration: s.
        kind: `exact`: the shortest certified answer of the exact planners, or of the proof.
            `refined`: that of refined collocation, above the optimum by at most `REFINED_RTOL`.
            `best known`: the recorded motion, if it is shorter than these. `relaxed`: if no planner
            knows all limits, the largest duration found without the ignored limits.
            `lower bound`: the proved bound, if it is above that.
        proved: No trajectory takes less, s; NaN where nothing was proved. The bound in closed form
            is used if the reference is within `CLOSED_WITHIN` of it.
        recorded: Source of the recorded motion, if it is the reference.
        recorded_proof: Source of the recorded lower bound, if it is the highest.
    """

    duration: float
    kind: Kind
    proved: float
    recorded: str = ""
    recorded_proof: str = ""


def references(trials: Iterable[Trial]) -> dict[str, Reference]:
    """Return the reference of every problem, by its digest, where there is one."""
    found = {}
    for digest, own in by_problem(trials).items():
        problem = own[0].problem
        computed = _computed(own)
        reference = _with_closed_form(_with_record(computed, problem), problem)
        if not isnan(reference.duration):
            found[digest] = reference
    return found


def best(trials: Iterable[Trial]) -> dict[str, BestMotion]:
    """Return what is known of every problem's optimum, of newest trials, by its digest."""
    shown = newest(trials).trials
    own = by_problem(shown)
    return {digest: _best(known, own[digest]) for digest, known in references(shown).items()}


def _best(known: Reference, trials: Sequence[Trial]) -> BestMotion:
    """Return a reference with its motion."""
    source, motion = "", None
    if known.kind == "best known":
        source, motion = known.recorded, records.answer(trials[0].problem).trajectory
    elif known.kind in OPTIMA:
        optima = [t for t in trials if t.planner in (*REFERENCES, *PROVERS) and _is_reference(t)]
        shortest = min(optima, key=lambda trial: (_duration(trial), trial.label, trial.id))
        source = f"{shortest.label}, seed {shortest.seed}"
        motion = shortest.certified_trajectory
    return BestMotion(known.duration, known.kind, known.proved, source, motion)


def improvements(trials: Iterable[Trial]) -> list[Trial]:
    """Return the shortest certified trial on each problem, where it is better than the record."""
    better = []
    for own in by_problem(trials).values():
        shortest = min(own, key=_duration)
        record = records.find(shortest.problem)
        if record and _duration(shortest) < record.duration * (1 - BETTER_RTOL):
            better.append(shortest)
    return better


def _computed(trials: Sequence[Trial]) -> Reference:
    """Return the reference from one problem's trials of the exact planners and of the proof."""
    exact = [trial for trial in trials if trial.planner in (*REFERENCES, *PROVERS)]
    proved = nan
    relaxed = nan
    for trial in exact:
        relaxed = _larger(relaxed, trial.relaxed_duration)
        if trial.planner in PROVERS:
            proved = _larger(proved, trial.lower_bound)
    certified = [trial for trial in exact if _is_reference(trial)]
    if certified:
        shortest = min(_duration(trial) for trial in certified)
        only_refined = all(trial.planner == REFERENCES[-1] for trial in certified)
        return Reference(shortest, "refined" if only_refined else "exact", proved)
    if proved >= relaxed or isnan(relaxed):
        return Reference(proved, "lower bound", proved)
    return Reference(relaxed, "relaxed", proved)


def _is_reference(trial: Trial) -> bool:
    """Return whether a trial is a reference: its planner knew all limits, or kept them."""
    if trial.certificate is None or not trial.certificate.valid:
        return False
    if trial.planner in PROVERS:
        return trial.relation is not Relation.RELAXATION
    return trial.certificate.nearly_feasible or not trial.problem.limits.others


def _with_record(reference: Reference, problem: Problem) -> Reference:
    """Return the better of the computed reference and the record of the problem.

    The recorded motion is verified here; its bound was proved (`records.bound`).
    """
    record = records.find(problem)
    if record is None:
        return reference
    proved = records.bound(problem)
    if proved is not None and not proved <= reference.proved:
        reference = replace(reference, proved=proved, recorded_proof=str(record.bound))
    computed = reference.duration if reference.kind in OPTIMA else inf
    if record.duration >= computed * (1 - BETTER_RTOL):
        return reference
    duration = records.answer(problem).duration
    if duration is None:
        return reference
    return replace(reference, duration=duration, kind="best known", recorded=str(record.motion))


def _with_closed_form(reference: Reference, problem: Problem) -> Reference:
    """Replace the proved bound by the one in closed form, where that closes the problem."""
    if reference.kind not in OPTIMA:
        return reference
    bound = end_to_end_bound(problem)
    closes = reference.duration < bound * (1 + CLOSED_WITHIN)
    if not closes or bound <= reference.proved:
        return reference
    return replace(reference, proved=bound, recorded_proof="")


def _duration(trial: Trial) -> float:
    """Return the certified duration, s; infinite without one."""
    certified = trial.certified_duration
    return inf if certified is None else certified


def _larger(known: float, value: float | None) -> float:
    """Return the larger of two numbers; the first may be NaN, the second None."""
    if value is None or known >= value:
        return known
    return float(value)
