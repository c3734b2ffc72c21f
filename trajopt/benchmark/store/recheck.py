"""Compute again what a file states of its trials, and report what does not hold.

The verdict of each trial is computed from its stored trajectory, its lower bound by the planner
that proved it, and a problem with a built-in name is compared with the built-in one. What the
reader refuses (a wrong checksum, identity or digest) is a damaged file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from trajopt.benchmark.store.folder import Damaged, recorded
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial, verdict
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.explain.references import BEST_KNOWN, PROOF
from trajopt.judging.verification import RATIO_KINDS, WORST_KINDS, Certificate
from trajopt.planners.planner import Relation
from trajopt.planners.registry import configured, entries
from trajopt.planners.rest_to_rest import end_to_end_bound

DURATION_RTOL = 1e-9  # between a recorded duration and the computed one
CERTIFICATE_RTOL = 1e-6  # between a certificate's uses of limits
CERTIFICATE_ATOL = 1e-8  # between its misses: rad, rad/s, rad/s^2
BOUND_RTOL = 1e-6  # by which rounding may lift a proof above a certified duration
PROOF_RTOL = 1e-12  # between two checks of a proof: the order of sums may differ

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


@dataclass(frozen=True)
class CheckedTrial:
    """Recorded and computed values of a stored trial; durations in s.

    Attributes:
        flaws: The verifier's, or why there is no trajectory.
        differences: What does not hold.
        bound: What came of the lower bound: `PROVED_AGAIN`, `NOT_PROVED`, `NOT_RECHECKED` (its
            planner is not installed, or proves nothing); empty where there is none.
    """

    id: str
    problem: str = ""
    planner: str = "a damaged file"
    seed: int | None = None
    status: str = "damaged"
    claimed_duration: float | None = None
    certified_duration: float | None = None
    recorded_claim: float | None = None
    recorded_duration: float | None = None
    dilation: float | None = None
    lower_bound: float | None = None
    bound: str = ""
    flaws: tuple[str, ...] = ()
    differences: tuple[str, ...] = ()

    @property
    def holds(self) -> bool:
        return not self.differences

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"holds": self.holds}


@dataclass(frozen=True)
class Verification:
    """All trials of a file or folder, computed again."""

    trials: tuple[CheckedTrial, ...]

    @property
    def answered(self) -> bool:
        """True if some trial has a certified duration or a lower bound."""
        return any(t.certified_duration or t.lower_bound for t in self.trials)

    @property
    def holds(self) -> bool:
        return self.answered and all(t.holds for t in self.trials)

    def summary(self) -> list[str]:
        """Summarise the result, a sentence a line."""
        wrong = sum(not t.holds for t in self.trials)
        count = len(self.trials)
        said = f"{wrong} do not hold" if wrong else "all hold"
        lines = [f"Trials verified anew: {count}; {said} what was recorded."]
        if not self.answered:
            lines.append("No trial has a certified duration or a lower bound: nothing holds.")
        bounds = [t.bound for t in self.trials if t.bound]
        counts = [f"{count} {word}" for word, count in Counter(bounds).items()]
        if counts:
            words = ", ".join(counts)
            lines.append(f"Lower bounds: {words}.")
        return lines


def verification(path: Path | str) -> Verification:
    """Compute every stored trial of a folder, a `results.h5` or a trial's text again.

    Raises:
        StoreError: The path holds no results, or the file cannot be read. A damaged file in a
            folder is a trial that does not hold.
    """
    damaged: list[Damaged] = []
    trials = recorded(Path(path), damaged.append)
    found = checked(sorted(trials, key=lambda t: (t.problem.name, t.label, t.seed)))
    for error in damaged:
        found.append(CheckedTrial(error.path.stem, differences=(str(error),)))
    return Verification(tuple(found))


def checked(trials: Sequence[Trial]) -> list[CheckedTrial]:
    """Compute trials again; a bound must not exceed what is certified of its problem."""
    anew = []
    shortest: dict[str, float] = {}
    for trial in trials:
        status, message, certificate = verdict(trial.problem, trial.solution)
        now = replace(trial, status=status, message=message, certificate=certificate)
        duration = np.inf if now.certified_duration is None else now.certified_duration
        shortest[now.digest] = min(duration, shortest.get(now.digest, np.inf))
        anew.append(now)
    pairs = zip(trials, anew, strict=True)
    return [_checked(then, now, shortest[now.digest]) for then, now in pairs]


def _checked(then: Trial, now: Trial, shortest: float) -> CheckedTrial:
    """A trial beside its computed verdict, and the shortest certified duration of its problem."""
    stated = then.certificate
    bound, unproved = _rechecked(then)
    differences = [*_changed(then, now), *_foreign(then.problem)]
    if then.lower_bound is not None and then.lower_bound > shortest * (1 + BOUND_RTOL):
        lower = f"{then.lower_bound:.9g} s"
        differences.append(f"lower bound: {lower}, but {shortest:.9g} s is certified")
    return CheckedTrial(
        id=then.id,
        problem=then.problem.name,
        planner=then.label,
        seed=then.seed,
        status=str(now.status),
        claimed_duration=now.claimed_duration,
        certified_duration=now.certified_duration,
        recorded_claim=stated.duration if stated else then.claimed_duration,
        recorded_duration=then.certified_duration,
        dilation=now.dilation,
        lower_bound=then.lower_bound,
        bound=bound,
        flaws=now.certificate.flaws if now.certificate else (then.message,),
        differences=(*differences, *unproved),
    )


def _changed(then: Trial, now: Trial) -> list[str]:
    """Name the recorded values that differ from the computed ones."""
    found = []
    if then.label.partition(":")[0] != then.planner:
        found.append(_difference("label", then.planner, then.label))
    for name in ("status", "feasible", "certified_duration", "dilation"):
        new = getattr(now, name)
        old = getattr(then, name)
        if not _close(new, old, rtol=DURATION_RTOL, atol=0.0):
            found.append(_difference(name, new, old))
    claim = getattr(then.certificate, "duration", then.claimed_duration)
    if not _close(then.claimed_duration, claim, rtol=DURATION_RTOL, atol=0.0):
        found.append(_difference("duration", then.claimed_duration, claim))
    for kind in WORST_KINDS:
        rtol = CERTIFICATE_RTOL if kind in RATIO_KINDS else 0.0
        atol = 0.0 if kind in RATIO_KINDS else CERTIFICATE_ATOL
        new = _worst_value(now.certificate, kind)
        old = _worst_value(then.certificate, kind)
        if not _close(new, old, rtol=rtol, atol=atol):
            found.append(_difference(f"certificate's {kind}", new, old))
    return found


def _worst_value(certificate: Certificate | None, kind: str) -> float | None:
    worst = getattr(certificate, kind, None)
    return worst.value if worst else None


def _close(now: Any, then: Any, *, rtol: float, atol: float) -> bool:
    if not isinstance(now, float | int) or not isinstance(then, float | int):
        return bool(now == then)
    return bool(np.isclose(now, then, rtol=rtol, atol=atol))


def _difference(name: str, now: Any, then: Any) -> str:
    return f"{name}: recorded {_said(then)}, computed {_said(now)}"


def _said(value: Any) -> str:
    if value is None:
        return "none"
    return f"{value:.9g}" if isinstance(value, float) else str(value)


def _foreign(problem: Problem) -> list[str]:
    """Say whether a problem of a built-in name has other numbers than the built-in one."""
    digests = _built_in(problem.name)
    if not digests or problem.digest() in digests:
        return []
    return [f"problem: its numbers are not those of the built-in {problem.name}"]


@cache
def _built_in(name: str) -> frozenset[str]:
    """Digests of the built-in problems of this name."""
    if name in catalogue.problem_files():
        return frozenset([catalogue.load(name).digest()])
    every = catalogue.every_problem().items()
    return frozenset(digest for digest, (_, problem) in every if problem.name == name)


def _rechecked(trial: Trial) -> tuple[str, list[str]]:
    """Return the result for the trial's lower bound, and its differences."""
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
    if _close(now, bound, rtol=PROOF_RTOL, atol=0.0):
        return PROVED_AGAIN, []
    return NOT_PROVED, [_difference("lower bound", now, bound)]


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
    """The bound of the stored proof; in closed form where none is stored."""
    bound = planner.stored_bound(trial.problem, trial.solution.stats)
    return end_to_end_bound(trial.problem) if bound is None else bound


def _planner(trial: Trial) -> StoresProofs | None:
    """The trial's planner with its options, where it is installed and stores proofs."""
    name, options = trial.planner, trial.options
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
