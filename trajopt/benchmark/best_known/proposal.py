"""Better answers than the recorded ones: a motion, or a planner's trials, judged; then written.

Only numbers are taken from anyone, never code: a motion is verified here, and a proof is checked
without a solver.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import BETTER_RTOL, CLOSED_FORM, Origin, Record
from trajopt.benchmark.store import own_breaks
from trajopt.benchmark.store.folder import read as stored_trials
from trajopt.benchmark.store.proofs import proved
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.numerals import rounded_down
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.explain.references import BEST_KNOWN
from trajopt.planners.rest_to_rest import end_to_end_bound

Stats = Mapping[str, Any]

_PROOF = "proof_"  # prefix of the names of a proof's arrays among a solution's stats
# Numbers of digits to which a proof is rounded, fewest first. A rounded proof still proves a bound.
_PROOF_DIGITS = (5, 6, 7, 9, 12)
_START_DIGITS = 12
# Largest loss of the bound by rounding a proof's numbers, relative.
_PROOF_RTOL = 1e-5
# Arrays of a proof that are not rounded: its units and its cut-off.
_EXACT = ("proof_units", "proof_cutoff")
# Largest loss of duration by writing a motion in few numbers, relative; small beside `BETTER_RTOL`.
_KEPT_RTOL = 0.1 * BETTER_RTOL


@dataclass(frozen=True, eq=False)
class Candidate:
    """A motion or a proof that may be better than the recorded one.

    Attributes:
        problem: Its problem.
        origin: Its source.
        trajectory: None where there is only a proof.
        proof: Arrays by name, as a solution's stats have them; empty where there is only a motion.
    """

    problem: Problem
    origin: Origin
    trajectory: Trajectory | None = None
    proof: Stats = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class RecordUpdate:
    """What proposed motions and proofs change in the record of their problem.

    Attributes:
        problem: The candidates' problem.
        before: The present record; None where there is none.
        after: The improved record; None where nothing is better.
        duration: The shortest certified duration of the candidates, s; None where there is none.
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
        StoreError: There are no trials, or they cannot be read.
    """
    for trial in stored_trials(path):
        problem = suite_problem(trial.problem)
        proof = _proof(trial.solution.stats)
        trajectory = trial.solution.trajectory
        if problem is None:
            continue
        if trial.planner == BEST_KNOWN:
            record = records.of_trial(trial)
            yield Candidate(problem, record.motion, trajectory)
            yield Candidate(problem, record.bound, None, proof)
        elif trajectory is not None or proof:
            yield Candidate(problem, _origin(trial, submitter), trajectory, proof)


def _proof(stats: Stats) -> dict[str, Array]:
    """The arrays of a proof among a solution's stats."""
    found = {}
    for name, value in stats.items():
        if name.startswith(_PROOF) and isinstance(value, np.ndarray):
            found[name] = np.asarray(value, dtype=float)
    return found


def _origin(trial: Trial, submitter: str) -> Origin:
    version = trial.provenance.get("planner_version", "")
    return Origin(trial.label, version, trial.started[:10], submitter)


def suite_problem(problem: Problem) -> Problem | None:
    """Return the suites' problem of these numbers, or None."""
    listed = catalogue.every_problem().get(problem.digest())
    return None if listed is None else listed.problem


def today() -> str:
    """The date of what is submitted now, UTC."""
    return datetime.now(UTC).date().isoformat()


def outcomes(candidates: Iterable[Candidate], where: Path) -> Iterator[RecordUpdate]:
    """Compare the candidates with a folder of records, problem by problem.

    Raises:
        TrajoptError: A motion is shorter than a proved bound: one of the two is wrong.
    """
    groups: dict[str, list[Candidate]] = {}
    for candidate in candidates:
        groups.setdefault(candidate.problem.digest(), []).append(candidate)
    for own in groups.values():
        yield _outcome(own, where)


def _outcome(candidates: Sequence[Candidate], where: Path) -> RecordUpdate:
    problem = candidates[0].problem
    before = records.find(problem, where)
    found = [_with_motion(before, candidate) for candidate in candidates]
    motions = [record for record in found if record is not None]
    shortest = min(motions, key=lambda record: record.duration, default=None)
    record = before
    if shortest and (not before or shortest.duration < before.duration * (1 - BETTER_RTOL)):
        record = _brief_motion(shortest)
    if record is not None:
        for candidate in candidates:
            record = _with_proof(record, candidate)
        _check_order(record)
    after = None if record is before else record
    return RecordUpdate(problem, before, after, shortest.duration if shortest else None)


def _with_motion(before: Record | None, candidate: Candidate) -> Record | None:
    """The record with another motion; None without a certified duration.

    The first motion of a problem has the bound in closed form.
    """
    problem = candidate.problem
    origin = candidate.origin
    if candidate.trajectory is None:
        return None
    bound = replace(origin, method=CLOSED_FORM, submitter="")
    solution = Solution(Status.SOLVED, lower_bound=end_to_end_bound(problem))
    if before is not None:
        bound = before.bound
        solution = before.trial.solution
    try:
        whole = replace(solution, trajectory=candidate.trajectory)
        return records.made(problem, whole, origin, bound)
    except InvalidInput:
        return None


def _brief_motion(record: Record) -> Record:
    """Return the record with its motion in as few numbers as keep its certified duration."""
    table = own_breaks.table(record.trajectory, own_breaks.SAME_RTOL)
    brief = Candidate(record.problem, record.motion, own_breaks.trajectory(table))
    found = _with_motion(record, brief)
    if found is None or found.duration > record.duration * (1 + _KEPT_RTOL):
        return record
    return found


def _with_proof(record: Record, candidate: Candidate) -> Record:
    """Return the record with a proof, if that proves more."""
    if not candidate.proof:
        return record
    exact = _proving(record, candidate, candidate.proof)
    if exact is None:  # about another question, or no proof
        return record
    # a smaller difference may be the recorded proof's loss by rounding
    least = record.lower_bound * (1 + BETTER_RTOL) / (1 - _PROOF_RTOL)
    if exact.lower_bound <= least:
        return record
    for digits in _PROOF_DIGITS:
        brief = _proving(record, candidate, _rounded(candidate.proof, digits))
        if brief and brief.lower_bound >= exact.lower_bound * (1 - _PROOF_RTOL):
            return brief
    return exact


def _proving(record: Record, candidate: Candidate, proof: Stats) -> Record | None:
    """Return the record with another proof and its bound; None if it proves nothing."""
    solution = replace(record.trial.solution, stats=proof)
    options = {**record.trial.options, "bound": asdict(candidate.origin)}
    trial = replace(record.trial, solution=solution, options=options)
    try:
        bound = proved(trial)
    except TrajoptError:
        return None
    return records.of_trial(replace(trial, solution=replace(solution, lower_bound=bound)))


def _rounded(proof: Stats, digits: int) -> dict[str, Array]:
    """Return the proof with fewer digits; whole numbers and units stay exact."""
    found = {}
    for name, array in proof.items():
        brief = _brief(array, digits)
        whole = array == np.rint(array)
        if name in _EXACT:
            whole[...] = True
        found[name] = np.where(whole, array, brief)
    cells = proof.get("proof_cells")
    if cells is not None and cells.ndim == 2:
        # starts of narrow cells: after rounding their width must not be 0
        found["proof_cells"][:, 0] = _brief(cells[:, 0], _START_DIGITS)
    return found


def _brief(array: Array, digits: int) -> Array:
    numbers = [float(f"{value:.{digits}g}") for value in array.ravel()]
    return np.reshape(numbers, array.shape)


def _check_order(record: Record) -> None:
    if record.duration < record.lower_bound * (1 - BETTER_RTOL):
        name, lower = record.problem.name, rounded_down(record.lower_bound, ".9g")
        raise TrajoptError(
            f"{name}: a motion of {record.duration:.9g} s ({record.motion}) is briefer than the "
            f"proved {lower} s ({record.bound}): one of them is wrong"
        )
