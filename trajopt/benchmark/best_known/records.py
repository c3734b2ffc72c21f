"""Records: the best known motion of a problem, and a proved lower bound, in a file.

A record is a trial's text, as the files of a results folder are. The trial is that of `BEST_KNOWN`:
its solution is the best known motion with the highest lower bound and its proof, and its
options state the sources of both. The motion is stated joint by joint
(`trajopt.benchmark.store.own_breaks`). A record is found by the problem's numbers.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from pathlib import Path

from trajopt.benchmark.provenance import provenance
from trajopt.benchmark.store import atomic, proofs, recheck, trial_text
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.store.proofs import PROVED_AGAIN
from trajopt.benchmark.store.recheck import CheckedTrial
from trajopt.benchmark.trial import Trial, verdict
from trajopt.core import built_in
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.renamed import current
from trajopt.core.solution import Solution
from trajopt.core.trajectory import Trajectory
from trajopt.explain.references import BEST_KNOWN, ReferenceAnswer
from trajopt.judging.verification import certified
from trajopt.planners.planner import Relation

CLOSED_WITHIN = 1e-3
"""A best known duration this close to its proved lower bound leaves no question open."""

CLOSED_FORM = "closed form"
"""The method of a bound without a stored proof: `rest_to_rest.end_to_end_bound`."""

BETTER_RTOL = 1e-6
"""A duration is an improvement if it is shorter by more than this, relative."""

PROVED = "proved.sha256"
"""List of the files whose bounds were proved, as `sha256sum` reads it (`write_list`)."""

_MAX_TEXT_LENGTH = 300  # characters of a line


@dataclass(frozen=True)
class Origin:
    """The source of a motion or a bound.

    Attributes:
        method: The planner with its options, or whatever its submitter calls it.
        version: Of that planner's package; may be empty.
        date: On which it was recorded, ISO 8601.
        submitter: Who sent it; empty where this project computed it.
    """

    method: str
    version: str
    date: str
    submitter: str = ""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            is_line = isinstance(value, str) and value.isprintable()
            if not is_line or len(value) > _MAX_TEXT_LENGTH:
                right = f"one printable line of at most {_MAX_TEXT_LENGTH} characters"
                raise InvalidInput(name, right, value=value)

    def __str__(self) -> str:
        planner, *options = self.method.split(":", 1)
        method = ":".join([current(planner), *options])
        name = " ".join(filter(None, [method, self.version]))
        return ", ".join(filter(None, [name, self.submitter, self.date]))


@dataclass(frozen=True, eq=False)
class Record:
    """The best known motion and bound of a problem.

    Attributes:
        trial: The trial that states everything.
        duration: Certified duration of `trajectory`, s.
        lower_bound: No motion takes less, s.
        trajectory: The motion as planned; its certified duration may be longer.
        motion: Source of the trajectory.
        bound: Source of the lower bound.
    """

    trial: Trial
    duration: float
    lower_bound: float
    trajectory: Trajectory
    motion: Origin
    bound: Origin

    @property
    def problem(self) -> Problem:
        """Return the record's problem; problems with the same numbers are the same."""
        return self.trial.problem

    @property
    def proved_within(self) -> float:
        """Return the largest possible excess over the optimum, a ratio minus 1."""
        return self.duration / self.lower_bound - 1

    @property
    def closed(self) -> bool:
        """True if the duration is proved to be optimal within `CLOSED_WITHIN`."""
        return self.proved_within < CLOSED_WITHIN

    @property
    def file_name(self) -> str:
        name = re.sub(r"[^\w-]", "_", self.problem.name, flags=re.ASCII)
        return name + ending(self.problem)


def ending(problem: Problem) -> str:
    """Return the ending of the file name of a problem's record, from the problem's digest."""
    return f".{problem.digest()[:16]}.json"


# --- a record and its trial ---


def made(problem: Problem, solution: Solution, motion: Origin, bound: Origin) -> Record:
    """Return the record of a motion and a lower bound, judged now.

    Raises:
        InvalidInput: The motion has no certified duration.
    """
    status, message, certificate = verdict(problem, solution)
    trial = Trial(
        problem=problem,
        planner=BEST_KNOWN,
        label=BEST_KNOWN,
        options={"motion": asdict(motion), "bound": asdict(bound)},
        seed=0,
        relation=Relation.SAME,
        status=status,
        message=message,
        solution=solution,
        certificate=certificate,
        setup_time=0.0,
        solve_time=0.0,
        batch=1,
        started=f"{motion.date}T00:00:00+00:00",
        provenance={"mintime": provenance()["mintime"]},
    )
    return of_trial(trial)


def of_trial(trial: Trial) -> Record:
    """Return the record that a trial states.

    Raises:
        InvalidInput: The trial states no record.
    """
    duration = trial.certified_duration
    lower_bound = trial.lower_bound
    trajectory = trial.solution.trajectory
    if trial.planner != BEST_KNOWN or not duration or not lower_bound or trajectory is None:
        right = f"a trial of {BEST_KNOWN}, with a certified motion and a lower bound"
        raise InvalidInput("record", right, value=trial.label)
    try:
        motion, bound = (Origin(**trial.options[name]) for name in ("motion", "bound"))
    except (KeyError, TypeError):
        right = "motion and bound: each with method, version, date and submitter"
        raise InvalidInput("options", right, value=dict(trial.options)) from None
    return Record(trial, duration, lower_bound, trajectory, motion, bound)


# --- files ---


def read(file: Path) -> Record:
    """Read a record; `checked` computes again what it states.

    Raises:
        TrajoptError: The file holds none; names the file.
    """
    try:
        if not store.is_trial(file):
            raise InvalidInput("record", "a sealed text, as `trajopt best-known propose` writes it")
        (trial,) = store.recorded(file)
        return of_trial(trial)
    except InvalidInput as error:
        raise error.in_file(str(file)) from None


def write(record: Record, where: Path) -> Path:
    """Write a record into a folder, in place of the problem's record there; returns the file.

    Raises:
        StoreError: The file cannot be written.
    """
    file = file_of(record.problem, where) or where / record.file_name
    atomic.write(file, trial_text.write(record.trial, brief=True))
    return file


def folder() -> Path:
    """Return the folder of this installation, or of the checkout."""
    return built_in.data_folder() / "best_known"


def folder_to_write() -> Path:
    """Return the checkout's folder, which a pull request changes; else a folder here."""
    if built_in.is_installed():
        return Path("best_known")
    return folder()


def files(where: Path | None = None) -> list[Path]:
    """Return all records' files, by name."""
    return sorted((where or folder()).rglob("*.json"))


def file_of(problem: Problem, where: Path | None = None) -> Path | None:
    """Return the file of a problem's record, or None."""
    place = where or folder()
    if not place.is_dir():
        return None
    inner = _folders(place, place.stat().st_mtime_ns)
    stamps = tuple((own, own.stat().st_mtime_ns) for own in (place, *inner))
    return _by_ending(stamps).get(ending(problem))


@lru_cache(maxsize=8)
def _folders(place: Path, changed: int) -> list[Path]:
    return sorted(own for own in place.iterdir() if own.is_dir())


@lru_cache(maxsize=8)
def _by_ending(folders: tuple[tuple[Path, int], ...]) -> dict[str, Path]:
    """Return the records' files in some folders, by the endings of their names."""
    found = [file for folder, _ in reversed(folders) for file in folder.glob("*.json")]
    return {"".join(file.suffixes[-2:]): file for file in found}


def find(problem: Problem, where: Path | None = None) -> Record | None:
    """Return the record of a problem, or None.

    Raises:
        TrajoptError: Its file cannot be read.
    """
    file = file_of(problem, where)
    if file is None:
        return None
    record = _read(file, file.stat().st_mtime_ns)
    if record.problem.digest() != problem.digest():
        return None
    return record


@lru_cache(maxsize=512)
def _read(file: Path, changed: int) -> Record:
    return read(file)


def answer(problem: Problem) -> ReferenceAnswer:
    """Return the recorded motion as a reference's answer, verified now, with its origin."""
    record = find(problem)
    if record is None:
        return ReferenceAnswer(None, "nothing is recorded for these numbers")
    return ReferenceAnswer(certified(problem, record.trajectory), str(record.motion))


def bound(problem: Problem) -> float | None:
    """Return the recorded lower bound, s; None without a proof.

    The bound of a file that `PROVED` lists was proved where the list was written. The proof of any
    other is checked now, without a solver; one that is damaged, or that nothing installed here
    checks, is none.
    """
    file = file_of(problem)
    record = find(problem)
    if file is None or record is None or record.bound.method == CLOSED_FORM:
        return None
    return _proved(file, file.stat().st_mtime_ns)


@lru_cache(maxsize=512)
def _proved(file: Path, changed: int) -> float | None:
    record = _read(file, changed)
    if _sha256(file) in listed():
        return record.lower_bound
    try:
        return proofs.proved(record.trial)
    except TrajoptError:
        return None


def _sha256(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def listed(where: Path | None = None) -> frozenset[str]:
    """Return the SHA-256 of the files that a folder's list names; none without a list."""
    file = (where or folder()) / PROVED
    return _listed(file, file.stat().st_mtime_ns) if file.is_file() else frozenset()


@lru_cache(maxsize=8)
def _listed(file: Path, changed: int) -> frozenset[str]:
    return frozenset(line.partition(" ")[0] for line in file.read_text("ascii").splitlines())


def write_list(proved: Iterable[Path], where: Path) -> Path:
    """Write the list of a folder's files whose bounds were proved just now; returns the list.

    Raises:
        StoreError: The list cannot be written.
    """
    lines = [f"{_sha256(file)}  {file.relative_to(where).as_posix()}\n" for file in sorted(proved)]
    atomic.write(where / PROVED, "".join(lines).encode("ascii"))
    return where / PROVED


# --- the check ---


def checked(file: Path) -> CheckedTrial:
    """Compute again what a record states; a file that cannot be checked does not hold."""
    try:
        record = read(file)
        (found,) = recheck.checked([record.trial])
    except Exception as error:  # the other files are checked all the same
        reason = f"record: it cannot be checked, {type(error).__name__}: {error}"
        return CheckedTrial(file.name, differences=(reason,))
    differences = list(found.differences)
    if not differences and found.bound != PROVED_AGAIN:
        differences.append(f"lower bound: {found.bound}")
    if not file.name.endswith(ending(record.problem)):
        differences.append(f"file: its name should end in {ending(record.problem)}")
    return replace(found, id=file.name, differences=tuple(differences))
