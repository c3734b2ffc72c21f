"""HDF5: one file per finished trial, and one consolidated file made from them.

A trial file is written under a temporary name, closed, synced and renamed into place, so it exists
whole or not at all; the folder is the index of what is finished. `results.h5` is rebuilt from the
trial files the same way, never appended to. Every dataset carries its `units` and a `description`,
arrays have dimension scales, and plain h5py reads all of it:

    with h5py.File("results/results.h5") as file:
        for trial in file["trials"].values():
            print(trial["label"].asstr()[()], trial["certified_duration"][()])
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from uuid import uuid4

import h5py

from trajopt.benchmark.schema import SCHEMA, check_schema, optional, read_trial, write_trial
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import StoreError
from trajopt.solution import Status


@dataclass(frozen=True)
class Store:
    """A results folder: `trials/*.h5` and `results.h5`."""

    folder: Path

    @property
    def results(self) -> Path:
        return self.folder / "results.h5"

    def path(self, trial_id: str) -> Path:
        """The file of one trial."""
        return self.folder / "trials" / f"{trial_id}.h5"

    def finished(self) -> set[str]:
        """Identities of the trials that need not run again.

        Not those that lacked a backend: installing it is how a user mends them.
        """
        return {f.stem for f in self._whole_files() if _status(f) != Status.MISSING}

    def has(self, trial_id: str) -> bool:
        """Whether this trial is there and readable."""
        return _is_whole(self.path(trial_id))

    def _whole_files(self) -> list[Path]:
        return [f for f in sorted((self.folder / "trials").glob("*.h5")) if _is_whole(f)]

    def write(self, trial: Trial) -> Path:
        """Store one finished trial; after this returns it survives a power cut."""
        return save(self.path(trial.id), trial)

    def consolidate(self) -> Path:
        """Rebuild `results.h5` from every readable trial file."""
        files = self._whole_files()
        _write_atomically(self.results, lambda out: _copy_all(out, files))
        return self.results

    def read(self, ids: set[str] | None = None) -> list[Trial]:
        """The stored trials, or those with these identities."""
        files = (
            self._whole_files() if ids is None else filter(_is_whole, map(self.path, sorted(ids)))
        )
        return [trial for file in files for trial, _ in records(file)]


def save(path: Path, trial: Trial) -> Path:
    """Write one trial to a file of its own, whole or not at all."""
    _write_atomically(path, lambda file: write_trial(file, trial))
    return path


def read(path: Path | str) -> list[Trial]:
    """Every trial of a results folder, of its `results.h5`, or of a single trial file.

    Raises `StoreError` naming the file if it is missing, damaged, or from a newer version.
    """
    return [trial for trial, _ in records(path)]


def records(path: Path | str) -> list[tuple[Trial, Record]]:
    """Every trial, verified anew from its stored trajectory, beside what was recorded of it.

    A folder is read from its trial files. Raises `StoreError` as `read` does.
    """
    path = Path(path)
    if path.is_dir():
        files = sorted((path / "trials").glob("*.h5"))
        if not files:
            raise StoreError(f"{path}: expected a results folder with trials/*.h5 in it")
        return [pair for file in files for pair in records(file)]
    with _opened(path) as file:
        return [_pair(group) for group in _groups(file)]


def _pair(group: Any) -> tuple[Trial, Record]:
    try:
        return read_trial(group), _record(group)
    except StoreError:
        raise
    except Exception as error:  # whatever a damaged file makes h5py or us raise
        where = f"{group.file.filename}, {group.name}"
        raise StoreError(f"{where}: damaged, or not a trial of trajopt ({error})") from error


@dataclass(frozen=True)
class Record:
    """What a file says of a trial: its identity, and its claimed and certified durations (s)."""

    id: str
    claimed_duration: float | None
    certified_duration: float | None


def _record(group: Any) -> Record:
    durations = (group[name][()] for name in ("claimed_duration", "certified_duration"))
    return Record(group["id"].asstr()[()], *(optional(value, float) for value in durations))


def _write_atomically(path: Path, write: Callable[[Any], None]) -> None:
    """Temporary name in the same folder, close, sync, rename, sync the folder."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        temporary = path.with_name(f".{path.stem}-{uuid4().hex}.tmp")
        try:
            with h5py.File(temporary, "w") as file:
                write(file)
            _sync(temporary)
            os.replace(temporary, path)
            _sync(path.parent)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise StoreError(f"{path}: cannot be written: {error.strerror or error}") from error


def _sync(path: str | Path) -> None:
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _copy_all(out: Any, files: list[Path]) -> None:
    """All trials under `trials/`, each a copy of its file."""
    out.attrs["schema"] = SCHEMA
    out.attrs["description"] = "trials of minimum-time planners; each group under trials/ is one"
    trials = out.create_group("trials")
    for path in files:
        with h5py.File(path) as file:
            file.copy(file["/"], trials, name=path.stem)
            _attach_anew(file, trials[path.stem])


def _attach_anew(source: Any, copy: Any) -> None:
    """Attach a copy's own dimension scales: HDF5 leaves copied references dangling."""
    names: list[str] = []
    source.visit(names.append)
    for name in names:
        for reference in ("DIMENSION_LIST", "REFERENCE_LIST"):
            if reference in copy[name].attrs:
                del copy[name].attrs[reference]
    for name in names:
        if "DIMENSION_LIST" in source[name].attrs:
            for axis, dimension in enumerate(source[name].dims):
                for scale in dimension.values():
                    copy[name].dims[axis].attach_scale(copy[scale.name.lstrip("/")])


def _groups(file: Any) -> Iterator[Any]:
    check_schema(file)
    yield from file["trials"].values() if "trials" in file else [file]


def _opened(path: Path) -> Any:
    try:
        return h5py.File(path)
    except FileNotFoundError:
        raise StoreError(f"{path}: no such file; expected a results folder or results.h5") from None
    except OSError as error:
        raise StoreError(f"{path}: damaged, or not an HDF5 file ({error})") from None


def _status(path: Path) -> str:
    with h5py.File(path) as file:
        return str(file["status"].asstr()[()])


def _is_whole(path: Path) -> bool:
    """Whether everything in the file can be read."""
    try:
        with h5py.File(path) as file:
            file.visititems(_touch)
            return {"schema"} <= set(file.attrs) and {"status", "provenance"} <= set(file)
    except Exception:  # whatever a damaged file makes h5py raise
        return False


def _touch(_: str, item: Any) -> None:
    if isinstance(item, h5py.Dataset):
        item[()]
