"""Compute the statements of a file about its trials again, and report what does not hold.

The verdict of each trial is computed from its stored trajectory, its lower bound by the planner
that proved it, and a problem with a built-in name is compared with the built-in one. What the
reader refuses (a wrong checksum, identity or digest) is a damaged file.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.benchmark.store import proofs, verdicts
from trajopt.benchmark.store.folder import Damaged, misstated, texts
from trajopt.benchmark.store.layout import References
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.core.numerals import rounded_down
from trajopt.core.problem import Problem

BOUND_RTOL = 1e-6  # a smaller excess of a proof over a certified duration, relative, is rounding
MAX_MISSTATED = 10  # names in the summary


@dataclass(frozen=True)
class CheckedTrial:
    """Recorded and computed values of a stored trial; durations in s.

    Attributes:
        flaws: The verifier's, or why there is no trajectory.
        differences: What does not hold.
        bound: Result of checking the lower bound (`proofs.rechecked`); empty without a bound.
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
    """All trials of a file or folder, computed again.

    Attributes:
        misstated: Datasets and attributes of `results.h5` that differ from its own texts.
    """

    trials: tuple[CheckedTrial, ...]
    misstated: tuple[str, ...] = ()

    @property
    def answered(self) -> bool:
        """True if some trial has a certified duration or a lower bound."""
        return any(t.certified_duration or t.lower_bound for t in self.trials)

    @property
    def holds(self) -> bool:
        return self.answered and not self.misstated and all(t.holds for t in self.trials)

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
        if self.misstated:
            shown = ", ".join(self.misstated[:MAX_MISSTATED])
            more = len(self.misstated) - MAX_MISSTATED
            shown += f" and {more} more" if more > 0 else ""
            lines.append(f"results.h5 differs from what its trials' texts give: {shown}.")
        return lines


def verification(path: Path | str, references: References | None = None) -> Verification:
    """Compute every stored trial of a folder, a `results.h5` or a trial's text again.

    Args:
        path: Of one of these.
        references: What gaps are measured against; None: the datasets are not compared.

    Raises:
        StoreError: The path holds no results, or the file cannot be read. A damaged file in a
            folder is a trial that does not hold.
    """
    damaged: list[Damaged] = []
    pairs = list(texts(Path(path), damaged.append))
    pairs.sort(key=lambda pair: (pair[0].problem.name, pair[0].label, pair[0].seed))
    anew = verdicts.again_many([trial for trial, _ in pairs])
    found = _all_checked([trial for trial, _ in pairs], anew)
    for error in damaged:
        found.append(CheckedTrial(error.path.stem, differences=(str(error),)))
    known = {text: (then, now) for (then, text), now in zip(pairs, anew, strict=True)}
    differing = misstated(Path(path), references, known) if references else []
    return Verification(tuple(found), tuple(differing))


def checked(trials: Sequence[Trial]) -> list[CheckedTrial]:
    """Compute trials again; a bound must not exceed a certified duration of its problem."""
    return _all_checked(trials, verdicts.again_many(trials))


def _all_checked(trials: Sequence[Trial], anew: Sequence[Trial]) -> list[CheckedTrial]:
    """Trials beside their computed verdicts."""
    shortest: dict[str, float] = {}
    for now in anew:
        duration = np.inf if now.certified_duration is None else now.certified_duration
        shortest[now.digest] = min(duration, shortest.get(now.digest, np.inf))
    pairs = zip(trials, anew, strict=True)
    return [_checked(then, now, shortest[now.digest]) for then, now in pairs]


def _checked(then: Trial, now: Trial, shortest: float) -> CheckedTrial:
    """A trial beside its computed verdict, and the shortest certified duration of its problem."""
    stated = then.certificate
    bound, unproved = proofs.rechecked(then)
    differences = [*verdicts.changed(then, now), *_foreign(then.problem)]
    if then.lower_bound is not None and then.lower_bound > shortest * (1 + BOUND_RTOL):
        lower = f"{rounded_down(then.lower_bound, '.9g')} s"
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
