"""Whether what a file says of its trials holds: everything that can be computed again, is.

Of each trial: the identity and the digest from its content, the claimed duration and the whole
certificate from its stored trajectory, the status from both, its lower bound by the planner that
proved it, and whether a problem that bears a built-in name is the built-in one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from trajopt.benchmark.store.folder import Damaged, records
from trajopt.benchmark.store.schema import encode, unpack
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.judging.verification import RATIO_KINDS, WORST_KINDS
from trajopt.planners.planner import Relation
from trajopt.planners.registry import configured, entries
from trajopt.planners.rest_to_rest import end_to_end_bound

DURATION_RTOL = 1e-9  # a duration computed again is the recorded one within this
CERTIFICATE_RTOL = 1e-6  # a certificate's uses of limits likewise
CERTIFICATE_ATOL = 1e-8  # and its misses: rad, rad/s, rad/s^2
BOUND_RTOL = 1e-6  # a proof may exceed a certified duration by so much, which is rounding

PROVED_AGAIN = "proved again"
NOT_RECHECKED = "not rechecked"
NOT_PROVED = "not proved"


@runtime_checkable
class StoresProofs(Protocol):
    """A planner whose solutions carry a proof of their bound, which needs no solver."""

    def relation(self, problem: Problem) -> Relation:
        """What the planner's answers, and so its bounds, are about."""
        ...

    def stored_bound(self, problem: Problem, stats: Mapping[str, Any]) -> float | None:
        """What the proof among `stats` proves, s; `None` where there is none."""
        ...


@dataclass(frozen=True)
class CheckedTrial:
    """A stored trial computed again (durations in s), beside what was recorded of it.

    `flaws` are the verifier's, or why there is no trajectory; `differences` say what does not
    hold. `bound` says what came of its lower bound: `PROVED_AGAIN`, `NOT_PROVED`,
    `NOT_RECHECKED` (its planner is not installed, or proves nothing), or nothing where it has none.
    """

    id: str
    problem: str
    planner: str
    seed: int | None
    status: str
    claimed_duration: float | None
    certified_duration: float | None
    recorded_claim: float | None
    recorded_duration: float | None
    dilation: float | None
    lower_bound: float | None
    bound: str
    flaws: tuple[str, ...]
    differences: tuple[str, ...]

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
        """Whether there is anything that could hold: a certified duration or a lower bound."""
        return any(t.certified_duration or t.lower_bound for t in self.trials)

    @property
    def holds(self) -> bool:
        return self.answered and all(t.holds for t in self.trials)

    def summary(self) -> list[str]:
        """What came of it, a sentence a line."""
        wrong = sum(not t.holds for t in self.trials)
        lines = [f"{len(self.trials)} trials verified anew; {wrong} do not hold what was recorded."]
        if not self.answered:
            lines.append("No trial has a certified duration or a lower bound: nothing holds.")
        bounds = [t.bound for t in self.trials if t.bound]
        counts = {word: bounds.count(word) for word in dict.fromkeys(bounds)}
        if counts:
            words = ", ".join(f"{count} {word}" for word, count in counts.items())
            lines.append(f"{len(bounds)} lower bounds: {words}.")
        return lines


def verification(path: Path | str) -> Verification:
    """Compute every stored trial of a folder, a `results.h5` or a trial file again.

    Raises:
        StoreError: if the path holds no results, or the file cannot be read. A damaged file in a
            folder is a trial that does not hold.
    """
    damaged: list[Damaged] = []
    found = records(path, damaged.append)
    shortest = _shortest([trial for trial, _ in found])
    trials = [_checked(trial, recorded, shortest) for trial, recorded in found]
    return Verification((*trials, *map(_damaged, damaged)))


def _shortest(trials: Sequence[Trial]) -> dict[str, float]:
    """The shortest certified duration of each problem (by digest), s."""
    shortest: dict[str, float] = {}
    for trial in trials:
        duration = trial.certified_duration
        if duration is not None:
            digest = trial.problem.digest()
            shortest[digest] = min(duration, shortest.get(digest, np.inf))
    return shortest


def _damaged(error: Damaged) -> CheckedTrial:
    return CheckedTrial(
        id=error.path.stem,
        problem="",
        planner="a damaged file",
        seed=None,
        status="damaged",
        claimed_duration=None,
        certified_duration=None,
        recorded_claim=None,
        recorded_duration=None,
        dilation=None,
        lower_bound=None,
        bound="",
        flaws=(),
        differences=(str(error),),
    )


def _checked(
    trial: Trial,
    recorded: Mapping[str, Any],
    shortest: Mapping[str, float],
) -> CheckedTrial:
    certificate = trial.certificate
    bound, unproved = _rechecked(trial)
    differences = [
        *_changed(trial, recorded),
        *_foreign(trial.problem),
        *_refuted(trial, shortest),
        *unproved,
    ]
    return CheckedTrial(
        id=recorded["id"],
        problem=trial.problem.name,
        planner=trial.label,
        seed=trial.seed,
        status=str(trial.status),
        claimed_duration=trial.claimed_duration,
        certified_duration=trial.certified_duration,
        recorded_claim=recorded["claimed_duration"],
        recorded_duration=recorded["certified_duration"],
        dilation=certificate.dilation if certificate else None,
        lower_bound=trial.lower_bound,
        bound=bound,
        flaws=certificate.flaws if certificate else (trial.message,),
        differences=tuple(differences),
    )


def _changed(trial: Trial, recorded: Mapping[str, Any]) -> list[str]:
    """What was recorded otherwise than it is computed now."""
    now = unpack(encode(trial).row)
    found = [
        _difference(name, now[name], recorded[name])
        for name in ("id", "digest", "status", "feasible")
        if now[name] != recorded[name]
    ]
    if trial.label.partition(":")[0] != trial.planner:
        found.append(_difference("label", trial.planner, trial.label))
    found += [
        _difference(name, now[name], recorded[name])
        for name in ("claimed_duration", "certified_duration", "dilation")
        if not _close(now[name], recorded[name], rtol=DURATION_RTOL, atol=0.0)
    ]
    if now["certificate"] and recorded["certificate"]:
        found += _changed_worst(now["certificate"], recorded["certificate"])
    return found


def _changed_worst(now: Mapping[str, Any], then: Mapping[str, Any]) -> list[str]:
    """The certificate's worst values that the verifier does not find."""
    found = []
    for kind in WORST_KINDS:
        rtol = CERTIFICATE_RTOL if kind in RATIO_KINDS else 0.0
        atol = 0.0 if kind in RATIO_KINDS else CERTIFICATE_ATOL
        new = _worst_value(now, kind)
        old = _worst_value(then, kind)
        if not _close(new, old, rtol=rtol, atol=atol):
            found.append(_difference(f"certificate's {kind}", new, old))
    return found


def _worst_value(certificate: Mapping[str, Any], kind: str) -> Any:
    worst = certificate.get(kind)
    return worst["value"] if worst else None


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
    """Whether a problem of a built-in name has other numbers than the built-in one."""
    digests = _built_in(problem.name)
    if not digests or problem.digest() in digests:
        return []
    return [f"problem: its numbers are not those of the built-in {problem.name}"]


@cache
def _built_in(name: str) -> frozenset[str]:
    """Digests of the built-in problems of this name."""
    if name in catalogue.problem_files():
        return frozenset([catalogue.load(name).digest()])
    return frozenset(p.digest() for p in _suite_problems() if p.name == name)


@cache
def _suite_problems() -> tuple[Problem, ...]:
    return tuple(p for name in catalogue.suites() for p in catalogue.problems(name))


def _refuted(trial: Trial, shortest: Mapping[str, float]) -> list[str]:
    """Why a lower bound on all trajectories cannot be one."""
    if trial.lower_bound is None:
        return []
    best = shortest.get(trial.problem.digest(), np.inf)
    if trial.lower_bound > best * (1 + BOUND_RTOL):
        return [f"lower bound: {trial.lower_bound:.9g} s, but {best:.9g} s is certified"]
    return []


def _rechecked(trial: Trial) -> tuple[str, list[str]]:
    """What came of the trial's lower bound, and what does not hold of it."""
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
        proved = planner.stored_bound(trial.problem, trial.solution.stats)
    except TrajoptError as error:
        return NOT_PROVED, [f"lower bound: {error}"]
    if proved is None:
        proved = end_to_end_bound(trial.problem)
    if _close(proved, bound, rtol=DURATION_RTOL, atol=0.0):
        return PROVED_AGAIN, []
    return NOT_PROVED, [_difference("lower bound", proved, bound)]


def _planner(trial: Trial) -> StoresProofs | None:
    """The trial's planner with its options, where it is installed and stores proofs."""
    entry = entries().get(trial.planner)
    if entry is None or entry.missing():
        return None
    try:
        planner = configured(entry.load(), trial.options, trial.planner)
    except TrajoptError:
        return None
    return planner if isinstance(planner, StoresProofs) else None
