"""The results folder: one HDF5 file per finished trial, and `results.h5` made from them.

A trial file is written under a temporary name, synced and renamed into place, so it exists whole
or not at all; the folder is the index of what is finished. `results.h5` is rebuilt from the trial
files and renamed into place, never appended to. `trialfile.py` and `columns.py` show how to read
them with plain h5py. A trial that lacked a backend is `<id>.missing.h5`, and runs again.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import h5py

from trajopt.benchmark.store import atomic
from trajopt.benchmark.store import results_file as columns
from trajopt.benchmark.store import trial_file as trialfile
from trajopt.benchmark.store.schema import Encoded, check_schema, decode, encode, unpack
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import StoreError
from trajopt.solution import Status

T = TypeVar("T")

_MISSING = ".missing.h5"


class Damaged(StoreError):
    """A file that is not what was written; `path` is its path."""

    def __init__(self, path: Path, reason: str) -> None:
        super().__init__(f"{path}: {reason}; delete it and run again")
        self.path = path


class DamagedFile(UserWarning):
    """A damaged file was left out; the others were read."""


Damages = Callable[[Damaged], None]


def _warn(error: Damaged) -> None:
    warnings.warn(str(error), DamagedFile, stacklevel=2)


@dataclass(frozen=True)
class Store:
    """A results folder: `trials/*.h5` and `results.h5`."""

    folder: Path

    @property
    def results(self) -> Path:
        return self.folder / "results.h5"

    def path(self, trial_id: str, *, missing: bool = False) -> Path:
        """The file of one trial; one that lacked a backend has another name."""
        return self.folder / "trials" / f"{trial_id}{_MISSING if missing else '.h5'}"

    def finished(self) -> set[str]:
        """Identities of the trials that need not run again.

        Not those that lacked a backend (installing it is how a user mends them), nor those that
        were cut short. Raises `StoreError` if another version filled this folder.
        """
        names = (file for file in _trial_files(self.folder) if not file.name.endswith(_MISSING))
        return {file.stem for file in names if _is_whole(file)}

    def has(self, trial_id: str) -> bool:
        """Whether this trial is finished and its file whole."""
        return _is_whole(self.path(trial_id))

    def write(self, trial: Trial) -> Path:
        """Store one finished trial; after this returns it survives a power cut.

        Raises `StoreError` where the disk refuses; what was stored before stays as it was.
        """
        missing = trial.status is Status.MISSING
        path = save(self.path(trial.id, missing=missing), trial)
        if not missing:
            self.path(trial.id, missing=True).unlink(missing_ok=True)
        return path

    def consolidate(self) -> Path:
        """Rebuild `results.h5` from every trial file; warns of damaged ones (`DamagedFile`)."""
        atomic.sweep(self.folder, self.folder / "trials")
        atomic.write(self.results, self._rebuild)
        return self.results

    def _rebuild(self, place: Path) -> None:
        """Again if another run replaced `results.h5` meanwhile: it may know more trials."""
        while True:
            seen = _stamp(self.results)
            trials = _each(_trial_files(self.folder), lambda kept: kept, _warn)
            with (
                atomic.Disk(place, "w+b") as disk,
                h5py.File(disk, "w", libver=trialfile.LIBRARY) as file,
            ):
                columns.write(file, disk.while_well(trials))
            if _stamp(self.results) == seen:
                return

    def read(self) -> list[Trial]:
        """The stored trials, each from its own file; warns of damaged ones."""
        return list(_each(_trial_files(self.folder), decode, _warn))


def save(path: Path, trial: Trial) -> Path:
    """Write one trial to a file of its own, whole or not at all."""
    data = trialfile.write(encode(trial))
    atomic.write(path, lambda place: place.write_bytes(data))
    return path


def read(path: Path | str, ids: Container[str] | None = None) -> list[Trial]:
    """The trials of a results folder, of a `results.h5`, or of a single trial file.

    All of them, or those with these `ids`. Certificates are the recorded ones. Raises `StoreError`
    naming the file if it is missing, damaged, or from another version; a damaged file in a folder
    is left out with a warning (`DamagedFile`).
    """

    def chosen(kept: Encoded) -> Trial | None:
        return decode(kept) if ids is None or kept.row["id"] in ids else None

    return [trial for trial in _all(Path(path), chosen, _warn) if trial is not None]


def records(path: Path | str, damaged: Damages = _warn) -> list[tuple[Trial, dict[str, Any]]]:
    """Every trial, verified anew from its stored trajectory, beside the row recorded of it.

    Raises `StoreError` as `read` does; a damaged file in a folder goes to `damaged`.
    """
    return list(_all(Path(path), _verified, damaged))


def _verified(kept: Encoded) -> tuple[Trial, dict[str, Any]]:
    recorded: dict[str, Any] = unpack(kept.row)
    return decode(kept, anew=True), recorded


def _all(path: Path, use: Callable[[Encoded], T], damaged: Damages) -> Iterator[T]:
    if path.is_dir():
        files = _trial_files(path)
        if not files:
            raise StoreError(f"{path}: expected a results folder with trials/*.h5 in it")
        yield from _each(files, use, damaged)
        return
    with _reading(path), h5py.File(path) as file:
        check_schema(file.attrs.get("schema"), str(path))
        kept = list(columns.read(file)) if "trials" in file else [_load(path)]
        found = [use(one) for one in kept]
    yield from found


def _each(files: list[Path], use: Callable[[Encoded], T], damaged: Damages) -> Iterator[T]:
    """One after the other; a damaged file does not take the others down."""
    for path in files:
        try:
            with _reading(path):
                found = use(_load(path))
        except Damaged as error:
            damaged(error)
        else:
            yield found


def _trial_files(folder: Path) -> list[Path]:
    """One file per trial: those that lacked a backend only until they are finished."""
    found = sorted((folder / "trials").glob("*.h5"))
    done = {file.stem for file in found if not file.name.endswith(_MISSING)}
    return [f for f in found if not f.name.endswith(_MISSING) or _id(f) not in done]


def _id(path: Path) -> str:
    return path.name.split(".")[0]


def _is_whole(path: Path) -> bool:
    """Whether the file ends as `save` left it, or, where someone edited it, can be read."""
    try:
        with path.open("rb") as file:
            file.seek(-trialfile.TAIL, os.SEEK_END)
            if trialfile.ends_well(file.read()):
                return True
    except OSError:  # not there, or shorter than that
        return False
    try:
        with _reading(path):
            decode(_load(path))
    except Damaged:
        return False
    return True


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Whatever a damaged file makes h5py, JSON or us raise is one error that names it."""
    try:
        yield
    except StoreError:
        raise
    except FileNotFoundError:
        raise StoreError(f"{path}: no such file; expected a results folder or results.h5") from None
    except PermissionError as error:
        raise StoreError(f"{path}: cannot be read: {error.strerror or error}") from error
    except Exception as error:
        raise Damaged(path, f"damaged, or not an HDF5 file of trajopt ({error})") from error


def _load(path: Path) -> Encoded:
    if path.name.endswith(_MISSING) and not path.exists():  # another run has finished it meanwhile
        path = path.with_name(f"{_id(path)}.h5")
    return trialfile.read(path.read_bytes(), str(path))


def _stamp(path: Path) -> tuple[int, int] | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_mtime_ns
