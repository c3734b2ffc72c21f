"""Check a record: its motion by the verifier, its bound by its proof, without a solver."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from trajopt.benchmark.best_known.record import CLOSED_FORM, Record, ending, read
from trajopt.benchmark.store.recheck import StoresProofs, foreign
from trajopt.core.exceptions import TrajoptError
from trajopt.explain.references import PROOF
from trajopt.judging.verification import verify
from trajopt.planners.registry import load
from trajopt.planners.rest_to_rest import end_to_end_bound

DURATION_RTOL = 1e-9  # a duration computed again is the recorded one within this
BOUND_RTOL = 1e-12  # between two checks of a proof: the order of sums may differ


@dataclass(frozen=True)
class CheckedRecord:
    """A record computed again; durations in s, None for what its files do not give.

    Attributes:
        file: Of the record.
        problem: Its name; empty if the file cannot be read.
        duration: Certified now.
        lower_bound: Proved now.
        differences: What does not hold.
    """

    file: str
    problem: str
    duration: float | None
    lower_bound: float | None
    differences: tuple[str, ...]

    @property
    def holds(self) -> bool:
        return not self.differences

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self) | {"holds": self.holds}


def checked(file: Path) -> CheckedRecord:
    """Compute again what a record says; a file that cannot be checked does not hold."""
    try:
        return _checked(file)
    except TrajoptError as error:
        reason = str(error)
    except Exception as error:  # the other files are checked all the same
        reason = f"record: it cannot be checked, {type(error).__name__}: {error}"
    return CheckedRecord(file.name, "", None, None, (reason,))


def _checked(file: Path) -> CheckedRecord:
    record = read(file)
    duration, slower = _duration(record)
    bound, weaker = _bound(record)
    differences = [*slower, *weaker, *_misplaced(record, file)]
    if record.lower_bound > record.duration * (1 + DURATION_RTOL):
        differences.append("lower bound: it is above the duration")
    return CheckedRecord(file.name, record.problem.name, duration, bound, tuple(differences))


def proved(record: Record) -> float:
    """Return the bound that a record's proof proves, s; in closed form without a proof.

    Raises:
        TrajoptError: The proof is none, or what checks it is not installed.
    """
    if record.bound.method == CLOSED_FORM and not record.proof:
        return end_to_end_bound(record.problem)
    planner = load(PROOF)
    found = None
    if isinstance(planner, StoresProofs):
        found = planner.stored_bound(record.problem, record.proof_stats)
    if found is None:
        raise TrajoptError(f"{PROOF} finds no proof in it")
    return found


def _duration(record: Record) -> tuple[float | None, list[str]]:
    """The certified duration of the recorded motion, and what is wrong with it."""
    try:
        certificate = verify(record.problem, record.trajectory)
    except TrajoptError as error:
        return None, [f"motion: {error}"]
    duration = certificate.certified_duration
    if duration is None:
        return None, [f"motion: {'; '.join(certificate.flaws)}"]
    if abs(duration - record.duration) > DURATION_RTOL * duration:
        return duration, [_difference("duration", record.duration, "certified", duration)]
    return duration, []


def _bound(record: Record) -> tuple[float | None, list[str]]:
    """Return the proved bound, and the difference if the record claims more."""
    try:
        bound = proved(record)
    except TrajoptError as error:
        return None, [f"lower bound: {error}"]
    if record.lower_bound > bound * (1 + BOUND_RTOL):
        return bound, [_difference("lower bound", record.lower_bound, "proved", bound)]
    return bound, []


def _difference(name: str, recorded: float, word: str, computed: float) -> str:
    return f"{name}: recorded {recorded:.9g}, {word} {computed:.9g} s"


def _misplaced(record: Record, file: Path) -> Iterator[str]:
    """Report a file name or a built-in problem's name that belongs to another problem."""
    problem = record.problem
    if not file.name.endswith(ending(problem)):
        yield f"file: its name should end in {ending(problem)}"
    yield from foreign(problem)
