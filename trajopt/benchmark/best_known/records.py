"""Find the records' files, and a problem's record by the problem's numbers."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path

from trajopt.benchmark.best_known.record import Record, ending, read
from trajopt.core import built_in
from trajopt.core.problem import Problem
from trajopt.explain.references import Answer
from trajopt.judging.verification import certified

BETTER_RTOL = 1e-6
"""A duration is an improvement if it is shorter by more than this, relative."""


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
    return sorted((where or folder()).glob("*.json"))


def file_of(problem: Problem, where: Path | None = None) -> Path | None:
    """Return the file of a problem's record, or None."""
    place = where or folder()
    changed = place.stat().st_mtime_ns if place.is_dir() else 0
    return _files_by_ending(place, changed).get(ending(problem))


@lru_cache(maxsize=8)
def _files_by_ending(where: Path, changed: int) -> dict[str, Path]:
    """Every record's file by the end of its name; `changed` is when the folder last was."""
    found = {}
    for file in reversed(files(where)):
        _, *digest = file.name.rsplit(".", maxsplit=2)
        found[f".{'.'.join(digest)}"] = file
    return found


def find(problem: Problem, where: Path | None = None) -> Record | None:
    """Return the record of a problem, or None.

    Raises:
        InvalidInput: Its file cannot be read.
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


def answer(problem: Problem) -> Answer:
    """Return the recorded motion as a reference's answer, verified now, with its origin."""
    record = find(problem)
    if record is None:
        return Answer(None, "nothing is recorded for these numbers")
    return Answer(certified(problem, record.trajectory), str(record.motion))
