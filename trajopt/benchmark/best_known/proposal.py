"""Better answers than the recorded ones: a motion, or a planner's trials, judged; then written.

Only numbers are taken from anyone, never code: a motion is verified here, and a proof is checked
without a solver.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

import numpy as np

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.record import (
    CLOSED_FORM,
    Origin,
    Record,
    evidence,
    origin,
    parsed,
    proof_of,
    text,
)
from trajopt.benchmark.best_known.record_check import proved
from trajopt.benchmark.best_known.records import BETTER_RTOL
from trajopt.benchmark.store import atomic
from trajopt.benchmark.store.folder import read as stored_trials
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidTrajectory, StoreError, TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.formats import own_breaks
from trajopt.judging.verification import verify
from trajopt.planners.rest_to_rest import end_to_end_bound

# Digits of a proof's numbers, fewest first: whatever they are, it proves something.
_PROOF_DIGITS = (5, 6, 7, 9, 12)
_START_DIGITS = 12
# Bound that a proof may lose by rounding its numbers, relative.
_PROOF_RTOL = 1e-5
# Arrays of a proof that stay exact: its units and its question.
_EXACT = ("units", "cutoff")
# Duration that a motion may lose by writing it briefly, relative: little beside `BETTER_RTOL`.
_KEPT_RTOL = 0.1 * BETTER_RTOL


@dataclass(frozen=True, eq=False)
class Candidate:
    """A motion or a proof that may be better than the recorded one.

    Attributes:
        problem: That it is about.
        origin: Where it comes from.
        trajectory: None where there is only a proof.
        proof: Arrays by name, as a record has them; empty where there is only a motion.
    """

    problem: Problem
    origin: Origin
    trajectory: Trajectory | None = None
    proof: Mapping[str, Array] | None = None


@dataclass(frozen=True, eq=False)
class Outcome:
    """The candidates for one problem, compared with its record.

    Attributes:
        problem: Theirs.
        before: The record as it is; None where there is none.
        after: The record with what is better; None where nothing is.
        duration: The shortest certified one among the candidates, s; None where there is none.
    """

    problem: Problem
    before: Record | None
    after: Record | None
    duration: float | None

    @property
    def shorter(self) -> bool:
        """True if the motion is better than the recorded one."""
        if self.after is None:
            return False
        return self.before is None or self.after.duration < self.before.duration

    @property
    def tighter(self) -> bool:
        """True if the bound is better than the recorded one."""
        if self.after is None:
            return False
        return self.before is None or self.after.lower_bound > self.before.lower_bound


def of_trials(path: Path, submitter: str = "") -> Iterator[Candidate]:
    """Yield the answers and proofs for suite problems among stored trials.

    Args:
        path: A results folder, a `results.h5`, or a trial's file.
        submitter: Who sends them.

    Raises:
        StoreError: There are none, or they cannot be read.
    """
    for trial in stored_trials(path):
        problem = suite_problem(trial.problem)
        proof = proof_of(trial.solution.stats)
        trajectory = trial.solution.trajectory
        if problem is not None and (trajectory is not None or proof):
            yield Candidate(problem, _origin(trial, submitter), trajectory, proof)


def _origin(trial: Trial, submitter: str) -> Origin:
    version = trial.provenance.get("planner_version", "")
    return origin(trial.label, version, trial.started[:10], submitter)


def suite_problem(problem: Problem) -> Problem | None:
    """Return the suites' problem of these numbers, or None."""
    listed = catalogue.every_problem().get(problem.digest())
    return None if listed is None else listed.problem


def today() -> str:
    """The date of what is submitted now, UTC."""
    return datetime.now(UTC).date().isoformat()


def outcomes(candidates: Iterable[Candidate], where: Path) -> Iterator[Outcome]:
    """Compare the candidates with a folder of records, problem by problem.

    Raises:
        TrajoptError: A motion is briefer than what is proved: one of them is wrong.
    """
    groups: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault(candidate.problem.digest(), []).append(candidate)
    for own in groups.values():
        yield _outcome(own, where)


def _outcome(candidates: Sequence[Candidate], where: Path) -> Outcome:
    problem = candidates[0].problem
    before = records.find(problem, where)
    record = before
    shortest = _shortest(candidates)
    duration = None
    if shortest is not None:
        duration = shortest.duration
        record = _with_motion(problem, before, shortest)
    if record is not None:
        for candidate in candidates:
            record = _with_proof(record, candidate)
        _check_order(record)
    after = None if record is before else record
    return Outcome(problem, before, after, duration)


class _Motion(NamedTuple):
    """A motion as it was planned, its certified duration, s, and where it comes from."""

    trajectory: Trajectory
    duration: float
    origin: Origin


def _shortest(candidates: Sequence[Candidate]) -> _Motion | None:
    """Return the candidates' motion of the shortest certified duration."""
    best = None
    for candidate in candidates:
        trajectory = candidate.trajectory
        if trajectory is None:
            continue
        try:
            duration = verify(candidate.problem, trajectory).certified_duration
        except InvalidTrajectory:
            continue
        if duration is not None and (best is None or duration < best.duration):
            best = _Motion(trajectory, duration, candidate.origin)
    return best


def _with_motion(
    problem: Problem,
    before: Record | None,
    motion: _Motion,
) -> Record:
    """The record with a motion, where that is better."""
    if before is None:
        return Record(
            problem=problem,
            duration=motion.duration,
            lower_bound=end_to_end_bound(problem),
            motion=motion.origin,
            bound=replace(motion.origin, method=CLOSED_FORM, submitter=""),
            evidence=evidence(motion.trajectory, {}, rtol=0.0),
        )
    if motion.duration >= before.duration * (1 - BETTER_RTOL):
        return before
    return replace(
        before,
        duration=motion.duration,
        motion=motion.origin,
        evidence=evidence(motion.trajectory, before.proof, rtol=0.0),
    )


def _with_proof(record: Record, candidate: Candidate) -> Record:
    """The record with a proof, where that proves more."""
    if not candidate.proof:
        return record
    exact = _proving(record, candidate, candidate.proof)
    if exact is None:  # about another question, or no proof
        return record
    # less may be what the recorded one lost by rounding
    least = record.lower_bound * (1 + BETTER_RTOL) / (1 - _PROOF_RTOL)
    if exact.lower_bound <= least:
        return record
    for digits in _PROOF_DIGITS:
        brief = _proving(record, candidate, _rounded(candidate.proof, digits))
        if brief and brief.lower_bound >= exact.lower_bound * (1 - _PROOF_RTOL):
            return brief
    return exact


def _proving(record: Record, candidate: Candidate, proof: Mapping[str, Array]) -> Record | None:
    """The record with another proof and what that proves; None where it proves nothing."""
    stated = evidence(record.trajectory, proof, rtol=0.0)
    other = replace(record, evidence=stated, bound=candidate.origin)
    try:
        return replace(other, lower_bound=proved(other))
    except TrajoptError:
        return None


def _rounded(proof: Mapping[str, Array], digits: int) -> dict[str, Array]:
    """The proof with fewer digits; whole numbers, and what it counts in, as they are."""
    found = {}
    for name, array in proof.items():
        brief = _brief(array, digits)
        whole = array == np.rint(array)
        if name in _EXACT:
            whole[...] = True
        found[name] = np.where(whole, array, brief)
    cells = proof.get("cells")
    if cells is not None and cells.ndim == 2:
        # starts of narrow cells: rounding must leave them a width
        found["cells"][:, 0] = _brief(cells[:, 0], _START_DIGITS)
    return found


def _brief(array: Array, digits: int) -> Array:
    numbers = [float(f"{value:.{digits}g}") for value in array.ravel()]
    return np.reshape(numbers, array.shape)


def _check_order(record: Record) -> None:
    if record.duration < record.lower_bound * (1 - BETTER_RTOL):
        name = record.problem.name
        raise TrajoptError(
            f"{name}: a motion of {record.duration:.9g} s ({record.motion}) is briefer than the "
            f"proved {record.lower_bound:.9g} s ({record.bound}): one of them is wrong"
        )


def write(record: Record, where: Path) -> Path:
    """Write a record, as briefly as its motion keeps its certified duration; returns the file.

    Raises:
        StoreError: The file cannot be written, or its motion would not be what it was.
    """
    file = records.file_of(record.problem, where) or where / record.file_name
    content = _content(record)
    atomic.write(file, content.encode())
    return file


def _content(record: Record) -> str:
    """The file's text, read back and verified."""
    for rtol in (*own_breaks.SAME_RTOLS, 0.0):
        brief = replace(record, evidence=evidence(record.trajectory, record.proof, rtol))
        back = parsed(text(brief))
        duration = verify(back.problem, back.trajectory).certified_duration
        if duration is not None and duration <= record.duration * (1 + _KEPT_RTOL):
            return text(replace(brief, duration=duration))
    raise StoreError(f"{record.problem.name}: its motion is another one when it is read again")
