"""Trials in a few numbers: what gaps are measured against, and a line per problem and planner.

    summary = Summary(trials)
    summary.lines()               # a line per problem and planner
    summary.references            # what gaps are measured against, by the problem's digest

Without pandas, which takes longer to import than a table of one problem takes to print; `Results`
makes frames of the same. Durations and times are in seconds, gaps are ratios minus 1, and NaN is
what does not exist.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from functools import cached_property
from math import inf, isnan, nan
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import BETTER_RTOL
from trajopt.benchmark.trial import Trial
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.explain.references import PROOF, REFERENCES
from trajopt.judging.verification import Certificate
from trajopt.views.analysis.statistics import FIVE_NUMBERS

Array = NDArray[np.float64]
Kind = Literal["exact", "refined", "best known", "relaxed", "lower bound"]

OPTIMA = ("exact", "refined", "best known")  # kinds of references that are motions

BUG_RTOL = 1e-6  # a planner below the reference by more than this is a bug to hunt
REFINED_RTOL = 1e-4  # what refined collocation may itself be above the optimum


@dataclass(frozen=True)
class Kept:
    """How many of a comparison's trials an earlier run had left, and when the first of them ran."""

    count: int
    total: int
    since: datetime

    def __str__(self) -> str:
        when = self.since.astimezone().strftime("%d %b %H:%M")
        return f"{self.count} of {self.total} trials kept from {when}"


@dataclass(frozen=True)
class Reference:
    """What the gaps on a problem are measured against.

    Attributes:
        duration: s.
        kind: `exact`, the shortest certified answer of the exact planners, or of the proof;
            `refined`, that of refined collocation, above the optimum by at most `REFINED_RTOL`;
            `best known`, where the recorded motion is shorter than these; `relaxed`, where none
            knows all limits, the largest of what they found without the limits that they ignore;
            `lower bound`, where more than that is proved.
        proved: No trajectory is faster, s; NaN where nothing was proved.
        recorded: Where the recorded motion comes from, if it is the reference.
        recorded_proof: Where the recorded lower bound comes from, if it is the highest.
    """

    duration: float
    kind: Kind
    proved: float
    recorded: str = ""
    recorded_proof: str = ""

    @property
    def tolerance(self) -> float:
        """By how much it may itself be above the optimum, relative."""
        return REFINED_RTOL if self.kind == "refined" else BUG_RTOL


@dataclass(frozen=True)
class Line:
    """One problem and planner with its options: see `Results.summary()` for what each is."""

    problem: str
    digest: str
    label: str
    median: float
    q1: float
    q3: float
    min: float
    max: float
    gap: float
    kind: Kind | None
    reference: float
    proved: float
    recorded: str
    recorded_proof: str
    runs: int
    solved: int
    kept: float
    dilation: float
    position_excess: float
    lower_bound: float
    evaluations: float
    solve_time: float
    setup_time: float
    status: str
    message: str


@dataclass(frozen=True, eq=False)
class Summary:
    """Trials in a few numbers."""

    trials: Sequence[Trial]

    @cached_property
    def references(self) -> dict[str, Reference]:
        """What gaps are measured against, by the problem's digest, where there is anything."""
        exact: dict[str, list[Trial]] = {digest: [] for digest in self.problems}
        for trial in self.trials:
            if trial.planner in REFERENCES or trial.planner == PROOF:
                exact[trial.problem.digest()].append(trial)
        found = {}
        for digest, own in exact.items():
            found[digest] = _with_record(_reference(own), self.problems[digest])
        return {digest: one for digest, one in found.items() if not isnan(one.duration)}

    @cached_property
    def problems(self) -> dict[str, Problem]:
        """Every problem by its digest."""
        return {trial.problem.digest(): trial.problem for trial in self.trials}

    def improvements(self) -> list[Trial]:
        """The shortest certified trial on each problem, where it is better than the record."""
        shortest: dict[str, Trial] = {}
        for trial in self.trials:
            digest = trial.problem.digest()
            if _duration(trial) < _duration(shortest.get(digest)):
                shortest[digest] = trial
        return [trial for trial in shortest.values() if _is_improvement(trial)]

    def lines(self) -> list[Line]:
        """A line per problem and planner, by problem and median certified duration."""
        groups: dict[tuple[str, str, str], list[Trial]] = {}
        for trial in self.trials:
            key = (trial.problem.name, trial.problem.digest(), trial.label)
            own = groups.setdefault(key, [])
            own.append(trial)
        lines = [self._line(runs) for runs in groups.values()]
        return sorted(lines, key=_by_problem_and_median)

    def gap(self, trial: Trial) -> float:
        """Of a trial's certified duration to the reference; NaN without either."""
        reference = self.references.get(trial.problem.digest())
        if reference is None:
            return nan
        return _number(trial.certified_duration) / reference.duration - 1

    def suspicious(self) -> list[Trial]:
        """Trials below the reference by more than its tolerance: each is a bug to hunt."""
        return [trial for trial in self.trials if self._beats_reference(trial)]

    def _beats_reference(self, trial: Trial) -> bool:
        reference = self.references.get(trial.problem.digest())
        if reference is None:
            return False
        proved = reference.proved * (1 - BUG_RTOL)
        below_proof = _number(trial.certified_duration) < proved
        return below_proof or self.gap(trial) < -reference.tolerance

    def _line(self, runs: Sequence[Trial]) -> Line:
        """The line of one planner's runs on one problem."""
        first = runs[0]
        digest = first.problem.digest()
        reference = self.references.get(digest)
        certified = _numbers([trial.certified_duration for trial in runs])
        five = _quantiles(certified, FIVE_NUMBERS)
        low, q1, median, q3, high = five.tolist()
        gaps = np.array([self.gap(trial) for trial in runs])
        unsolved = [trial for trial in runs if trial.status is not Status.SOLVED]
        kept = [is_kept(trial.certificate) for trial in runs]
        mended = [_mended_dilation(trial) for trial in runs]
        excesses = [position_excess(trial.certificate) for trial in runs]
        bounds = [trial.lower_bound for trial in runs]
        evaluations = [trial.solution.evaluations for trial in runs]
        solve_times = [trial.solve_time for trial in runs]
        setup_times = [trial.setup_time for trial in runs]
        telling = unsolved[0] if unsolved else first
        return Line(
            problem=first.problem.name,
            digest=digest,
            label=first.label,
            median=median,
            q1=q1,
            q3=q3,
            min=low,
            max=high,
            gap=_median(gaps),
            kind=reference.kind if reference else None,
            reference=reference.duration if reference else nan,
            proved=reference.proved if reference else nan,
            recorded=reference.recorded if reference else "",
            recorded_proof=reference.recorded_proof if reference else "",
            runs=len(runs),
            solved=len(runs) - len(unsolved),
            kept=sum(kept) / len(runs),
            dilation=_median(_numbers(mended)),
            position_excess=_largest(excesses),
            lower_bound=_smallest(bounds),
            evaluations=_median(_numbers(evaluations)),
            solve_time=_median(_numbers(solve_times)),
            setup_time=_largest(setup_times),
            status=str(telling.status),
            message=telling.message,
        )


def is_kept(certificate: Certificate | None) -> bool:
    """Whether a trajectory keeps every limit as claimed."""
    return certificate is not None and certificate.feasible


def position_excess(certificate: Certificate | None) -> float | None:
    """How far a trajectory leaves its position limits, rad; None without it or them."""
    if certificate is None or certificate.position is None:
        return None
    return max(0.0, certificate.position.value)


def _reference(exact: Sequence[Trial]) -> Reference:
    """Of one problem's trials of the exact planners and of the proof; NaN where they found none."""
    proved = _largest([trial.lower_bound for trial in exact if trial.planner == PROOF])
    certified = [trial for trial in exact if trial.certified_duration is not None]
    if not certified:
        relaxed = _largest([trial.relaxed_duration for trial in exact])
        if proved >= relaxed or isnan(relaxed):
            return Reference(proved, "lower bound", proved)
        return Reference(relaxed, "relaxed", proved)
    shortest = _smallest([trial.certified_duration for trial in certified])
    only_refined = all(trial.planner == REFERENCES[-1] for trial in certified)
    kind: Kind = "refined" if only_refined else "exact"
    return Reference(shortest, kind, proved)


def _duration(trial: Trial | None) -> float:
    """Certified, s; infinite without one."""
    if trial is None or trial.certified_duration is None:
        return inf
    return trial.certified_duration


def _is_improvement(trial: Trial) -> bool:
    """Whether there is a record of its problem that it betters."""
    record = records.find(trial.problem)
    return record is not None and _duration(trial) < record.duration * (1 - BETTER_RTOL)


def _with_record(reference: Reference, problem: Problem) -> Reference:
    """The same with what is recorded of the problem, where that is better than what was computed.

    The recorded motion is verified before it counts; the proof is, by `trajopt best-known verify`.
    """
    record = records.find(problem)
    if record is None:
        return reference
    if record.proof and not record.lower_bound <= reference.proved:
        reference = replace(
            reference,
            proved=record.lower_bound,
            recorded_proof=str(record.bound),
        )
    computed = inf
    if reference.kind in OPTIMA:
        computed = reference.duration
    if record.duration >= computed * (1 - BETTER_RTOL):
        return reference
    duration = records.answer(problem).duration
    if duration is None:
        return reference
    return replace(reference, duration=duration, kind="best known", recorded=str(record.motion))


def _mended_dilation(trial: Trial) -> float | None:
    """The dilation of an answer that breaks a limit and can be mended; None for others."""
    certificate = trial.certificate
    if trial.certified_duration is None or certificate is None or certificate.feasible:
        return None
    return certificate.dilation


def by_median(line: Line) -> float:
    """To sort by: lines without a median come last."""
    return inf if isnan(line.median) else line.median


def _by_problem_and_median(line: Line) -> tuple[str, float]:
    return line.problem, by_median(line)


def _number(value: float | None) -> float:
    return nan if value is None else float(value)


def _numbers(values: Sequence[float | None]) -> Array:
    return np.array([_number(value) for value in values])


def _quantiles(values: Array, q: Sequence[float]) -> Array:
    """Of those that are numbers, linear between neighbours; NaN where none is."""
    numbers = values[~np.isnan(values)]
    if not numbers.size:
        return np.full(len(q), nan)
    return np.quantile(numbers, q)


def _median(values: Array) -> float:
    (middle,) = _quantiles(values, [0.5])
    return float(middle)


def _largest(values: Sequence[float | None]) -> float:
    """Of those that exist."""
    numbers = _numbers(values)
    return float(np.fmax.reduce(numbers, initial=nan))


def _smallest(values: Sequence[float | None]) -> float:
    """Of those that exist."""
    numbers = _numbers(values)
    return float(np.fmin.reduce(numbers, initial=nan))
