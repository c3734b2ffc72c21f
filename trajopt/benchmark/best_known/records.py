"""Where the records lie, and the one of a problem: found by its numbers, whatever it is called."""

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
    """That of this installation, or of the checkout."""
    return built_in.data_folder() / "best_known"


def folder_to_write() -> Path:
    """The checkout's, which a pull request changes; else a folder here."""
    if built_in.is_installed():
        return Path("best_known")
    return folder()


def files(where: Path | None = None) -> list[Path]:
    """All records' files, by name."""
    return sorted((where or folder()).glob("*.json"))


def file_of(problem: Problem, where: Path | None = None) -> Path | None:
    """The file of a problem's record; None where there is none."""
    found = sorted((where or folder()).glob(f"*{ending(problem)}"))
    return found[0] if found else None


def find(problem: Problem, where: Path | None = None) -> Record | None:
    """The record of a problem; None where there is none.

    Raises:
        InvalidInput: Its file cannot be read, or holds another problem's record.
    """
    file = file_of(problem, where)
    if file is None:
        return None
    record = _read(file, file.stat().st_mtime_ns)
    if record.problem.digest() != problem.digest():
        return None
    return record


@lru_cache(maxsize=256)
def _read(file: Path, changed: int) -> Record:
    return read(file)


def answer(problem: Problem) -> Answer:
    """The recorded motion as a reference's answer, verified now; its reason is its origin."""
    record = find(problem)
    if record is None:
        return Answer(None, "nothing is recorded for these numbers")
    return Answer(certified(problem, record.trajectory), str(record.motion))
