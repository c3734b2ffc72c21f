"""The results folder: one HDF5 file per finished trial, and `results.h5` made from them.

A trial file is written under a temporary name, synced and renamed into place, so it exists whole
or not at all; the folder is the index of what is finished. `results.h5` is rebuilt from the trial
files and renamed into place, never appended to. `trial_file.py` and `results_file.py` show how to
read them with plain h5py. A trial without an answer, for reasons that may be gone the next time (it
crashed, was stopped, or lacked a backend), is `<id>.missing.h5`, and runs again.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Collection, Container, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from trajopt.benchmark.store import atomic, seal
from trajopt.benchmark.store.columns import harmless
from trajopt.benchmark.store.schema import Encoded, decode, decoded, encode, recorded
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import StoreError

T = TypeVar("T")
Stamp = tuple[int, int]  # of a file: its inode, and when that last changed, ns

_UNANSWERED = ".missing.h5"
_TRIAL_NAME = re.compile(r"[0-9a-f]{20}(\.missing)?\.h5")
_VERDICT = ("id", "digest", "status", "certified_duration", "lower_bound", "certificate")
_REASON_CHARACTERS = 300  # of what HDF5 or JSON say


class Damaged(StoreError):
    """A file that is not what was written; `path` is its path."""

    def __init__(self, path: Path, reason: str) -> None:
        words = " ".join(f"{path}: {reason}".split())
        super().__init__(harmless(words, lines=False))
        self.path = path


class DamagedFile(UserWarning):
    """A damaged file was left out and the others were read, or what was damaged is mended."""


OnDamage = Callable[[Damaged], None]


def _warn(error: Damaged) -> None:
    warnings.warn(str(error), DamagedFile, stacklevel=2)


@dataclass(frozen=True)
class Store:
    """A results folder: `trials/*.h5` and `results.h5`."""

    folder: Path

    @property
    def results(self) -> Path:
        return self.folder / "results.h5"

    def path(self, trial_id: str, *, unanswered: bool = False) -> Path:
        """The file of one trial; one without an answer has another name."""
        ending = _UNANSWERED if unanswered else ".h5"
        return self.folder / "trials" / f"{trial_id}{ending}"

    def finished(self) -> set[str]:
        """Identities of the trials that need not run again.

        Not those without an answer (the next run may give one), nor those that were cut short.
        Raises `StoreError` if another version filled this folder.
        """
        files = [file for file in _trial_files(self.folder) if not _is_unanswered(file)]
        return {file.stem for file in files if _is_whole(file)}

    def has(self, trial_id: str) -> bool:
        """Whether this trial is finished and its file whole."""
        return _is_whole(self.path(trial_id))

    def write(self, trial: Trial) -> Path:
        """Store one finished trial; after this returns it survives a power cut.

        Raises `StoreError` where the disk refuses; what was stored before stays as it was.
        """
        (written,) = self.write_all([trial])
        return written.path

    def write_all(
        self,
        trials: Iterable[Trial],
        instead: Callable[[Trial], Trial] | None = None,
    ) -> list[Written]:
        """Store trials that finished together, which takes hardly longer than to store one.

        Args:
            trials: Each gets a file of its own, which is there whole or not at all.
            instead: Called while the exception is handled that says why no file can hold a trial,
                and answers with the trial to store in its place; without it, that is an error.

        Raises:
            StoreError: where the disk refuses a file. Those before it are kept.
        """
        files: dict[Path, atomic.Content] = {}
        encoded: dict[Path, Encoded] = {}
        for trial in trials:
            kept = trial
            try:
                whole = encode(trial)
                content = _filling(whole)
            except StoreError:
                raise
            except Exception:
                if instead is None:
                    raise
                kept = instead(trial)
                whole = encode(kept)
                content = _filling(whole)
            path = self.path(kept.id, unanswered=kept.runs_again)
            files[path] = content
            encoded[path] = whole
        atomic.write_all(files)
        for path in files:
            if not _is_unanswered(path):
                self.path(path.stem, unanswered=True).unlink(missing_ok=True)
        return [Written(path, _stamp(path), whole) for path, whole in encoded.items()]

    def consolidate(self, seen: Seen | None = None) -> Path:
        """Rebuild `results.h5` from every trial file; warns of damaged ones (`DamagedFile`).

        Files that were `seen` are not read again.
        """
        atomic.sweep(self.folder, self.folder / "trials")
        rebuild = partial(self._rebuild, seen or Seen())
        atomic.write(self.results, rebuild)
        return self.results

    def stamps(self) -> dict[Path, Stamp | None]:
        """What tells later whether the files of finished trials have changed."""
        files = _trial_files(self.folder)
        return {path: _stamp(path) for path in files if not _is_unanswered(path)}

    def restore(self, before: Mapping[Path, Stamp | None], seen: Seen) -> None:
        """Write again what others have removed or changed since this run began, and warn.

        A trial that this run did not make is taken from `results.h5`, if that has it.
        """
        lost = seen.lost(before)
        if not lost:
            return
        known = {path: content for path, content in lost.items() if content is not None}
        if len(known) < len(lost):
            with suppress(OSError, StoreError):
                for content in _loaded(self.results):
                    known.setdefault(self.path(content.row["id"]), content)
        # another run, or another worker, may have found the same
        same = {path for path in lost if path in known and _holds(path, known[path])}
        bad = lost.keys() - same
        if not bad:
            return
        restored = known.keys() & bad
        atomic.write_all({path: _filling(known[path]) for path in restored})
        others = len(bad) - len(restored)
        again = f"; {others} of them are lost, and run again" if others else ""
        warnings.warn(
            f"{self.folder}: a planner or another program removed or changed {len(bad)} trials "
            f"during the run; {len(restored)} are written again{again}",
            DamagedFile,
            stacklevel=2,
        )

    def current(self, ids: Collection[str]) -> list[Trial] | None:
        """The trials with these identities from `results.h5`, if it need not be rebuilt.

        None where a trial file is younger, where one is not in it, or where it cannot be read.
        """
        if not self._is_current():
            return None
        try:
            stored = read(self.results, ids)
        except StoreError:
            return None
        return stored if len(stored) == len(ids) else None

    def _is_current(self) -> bool:
        """Whether `results.h5` is younger than every trial file."""
        trials = self.folder / "trials"
        try:
            built = self.results.stat().st_mtime_ns
            changes = [path.stat().st_mtime_ns for path in (trials, *trials.iterdir())]
        except OSError:
            return False
        return max(changes) < built

    def columns(self, *names: str) -> list[tuple[str, ...]]:
        """Some columns of texts in `results.h5`, a tuple per trial."""
        from trajopt.benchmark.store import results_file

        with _reading(self.results):
            return results_file.texts(self.results, *names)

    def _rebuild(self, seen: Seen, place: Path) -> None:
        """Again if another run replaced `results.h5` meanwhile: it may know more trials."""
        # h5py, here and below: not where nothing is read or written yet
        from trajopt.benchmark.store import results_file

        while True:
            before = _stamp(self.results)
            encoded = partial(self._encoded, seen)
            place.write_bytes(results_file.content(encoded))
            if _stamp(self.results) == before:
                return

    def _encoded(self, seen: Seen) -> Iterator[Encoded]:
        for path in _trial_files(self.folder):
            kept = seen.content(path)
            if kept is None:
                yield from _each([path], _readable, _warn)
            else:
                yield kept

    def unanswered(self) -> list[Trial]:
        """The trials that ended without an answer, for reasons that may be gone."""
        files = [file for file in _trial_files(self.folder) if _is_unanswered(file)]
        return list(_each(files, decode, _warn))

    def read(self) -> list[Trial]:
        """The stored trials, each from its own file; warns of damaged ones."""
        return list(_each(_trial_files(self.folder), decode, _warn))


class Written(NamedTuple):
    """A trial that has been stored: its file, what tells whether that changed, and the content."""

    path: Path
    stamp: Stamp | None
    content: Encoded


class Seen:
    """Trials that this run has stored, as their judges said: no file is asked again.

    Attributes:
        trials: by their identities.
    """

    def __init__(self) -> None:
        self.trials: dict[str, Trial] = {}
        self._written: dict[Path, Written] = {}

    def add(self, written: Iterable[Written]) -> None:
        """Keep what has been stored."""
        for one in written:
            trial = decode(one.content)
            self.trials[trial.id] = trial
            self._written[one.path] = one

    def content(self, path: Path) -> Encoded | None:
        """What this run wrote to a file."""
        written = self._written.get(path)
        return None if written is None else written.content

    def lost(self, before: Mapping[Path, Stamp | None]) -> dict[Path, Encoded | None]:
        """The files that somebody else has removed or changed, and what they held, if known.

        Those of this run since it wrote them, and those that were there `before`.
        """
        lost: dict[Path, Encoded | None] = {}
        for path, stamp in before.items():
            if path not in self._written and _stamp(path) != stamp:
                lost[path] = None
        for path, one in self._written.items():
            if _stamp(path) != one.stamp:
                lost[path] = one.content
        return lost


def save(path: Path, trial: Trial) -> Path:
    """Write one trial to a file of its own, whole or not at all."""
    atomic.write(path, _filling(encode(trial)))
    return path


def _filling(trial: Encoded) -> atomic.Content:
    """What fills a file with a trial."""
    from trajopt.benchmark.store import trial_file

    data = trial_file.content(trial)
    return lambda place: place.write_bytes(data)


def read(path: Path | str, ids: Container[str] | None = None) -> list[Trial]:
    """The trials of a results folder, of a `results.h5`, or of a single trial file.

    All of them, or those with these `ids`. Certificates are the recorded ones. A folder is read
    from its `results.h5` where that holds every trial file as it is.

    Raises:
        StoreError: naming the file if it is missing, damaged, or from another version; a damaged
            file in a folder is left out with a warning (`DamagedFile`).
    """

    def chosen(kept: Encoded) -> Trial | None:
        return decode(kept) if ids is None or kept.row["id"] in ids else None

    source = Path(path)
    if ids is None and source.is_dir():
        files = _trial_files(source)
        named = {_id(file) for file in files}
        whole = Store(source).current(named) if files else None
        if whole is not None:
            return whole
    return [trial for trial in _all(source, chosen, _warn) if trial is not None]


def records(path: Path | str, damaged: OnDamage = _warn) -> list[tuple[Trial, dict[str, Any]]]:
    """Every trial, verified anew from its stored trajectory, beside the row recorded of it.

    Raises `StoreError` as `read` does; a damaged file in a folder goes to `damaged`.
    """
    return list(_all(Path(path), _verified, damaged))


def _verified(kept: Encoded) -> tuple[Trial, dict[str, Any]]:
    row = recorded(kept)
    return decoded(row, kept, anew=True), row


def _readable(kept: Encoded) -> Encoded:
    """The same, if it can be read: one bad trial must not spoil the `results.h5` of all."""
    decode(kept)
    return kept


def _both(kept: Encoded) -> tuple[Encoded, Trial]:
    """As it is stored, and what that is."""
    return kept, decode(kept)


def _all(path: Path, use: Callable[[Encoded], T], damaged: OnDamage) -> Iterator[T]:
    if path.is_dir():
        files = _trial_files(path)
        if not files:
            raise StoreError(f"{path}: expected a results folder with trials/*.h5 in it")
        yield from _each(files, use, damaged)
        return
    with _reading(path):
        found = [_used(kept, use) for kept in _loaded(path)]
    yield from found


def _each(files: list[Path], use: Callable[[Encoded], T], damaged: OnDamage) -> Iterator[T]:
    """One after the other; a damaged file does not take the others down."""
    for path in files:
        try:
            with _reading(path):
                found = use(_load(path))
        except Damaged as error:
            damaged(error)
        else:
            yield found


def _used(kept: Encoded, use: Callable[[Encoded], T]) -> T:
    """What `use` makes of a trial among others; an error says which one it was."""
    try:
        return use(kept)
    except ValueError as error:
        raise ValueError(f"trial {kept.row['id']!r:.24}: {error}") from error


def _trial_files(folder: Path) -> list[Path]:
    """One file per trial: those without an answer only until there is one."""
    files = sorted((folder / "trials").glob("*.h5"))
    done = {file.stem for file in files if not _is_unanswered(file)}
    return [file for file in files if not _is_unanswered(file) or _id(file) not in done]


def _is_unanswered(path: Path) -> bool:
    return path.name.endswith(_UNANSWERED)


def _id(path: Path) -> str:
    return path.name.split(".")[0]


def _is_whole(path: Path) -> bool:
    """Whether the file ends as `save` left it, or can be read.

    Of what is inside the end says nothing, but to look there takes a hundred times as long.
    """
    try:
        if seal.ends_sealed(path):
            return True
        with _reading(path):
            decode(_load(path))
    except (Damaged, FileNotFoundError):
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
        reason = str(error)[:_REASON_CHARACTERS]
        advice = ""
        if path.parent.name == "trials" and _TRIAL_NAME.fullmatch(path.name):
            advice = "; running its comparison again replaces it"
        raise Damaged(
            path, f"damaged, or not an HDF5 file of trajopt ({reason}){advice}"
        ) from error


def _load(path: Path) -> Encoded:
    if _is_unanswered(path) and not path.exists():  # another run has finished it meanwhile
        path = path.with_name(f"{_id(path)}.h5")
    from trajopt.benchmark.store import trial_file

    return trial_file.read(path)


def _loaded(path: Path) -> list[Encoded]:
    """All trials of a file, whichever of the two kinds it is."""
    from trajopt.benchmark.store import hdf5, results_file, trial_file

    with hdf5.opened(path) as source:
        consolidated = "trials" in source
    return list(results_file.read(path)) if consolidated else [trial_file.read(path)]


def _holds(path: Path, content: Encoded) -> bool:
    """Whether a file holds the same answer and verdict; when and how fast does not matter."""
    try:
        found = _load(path)
    except Exception:
        return False
    same_row = all(found.row.get(name) == content.row[name] for name in _VERDICT)
    same_names = found.arrays.keys() == content.arrays.keys()
    return (
        same_row
        and same_names
        and all(
            np.array_equal(found.arrays[name], array, equal_nan=True)
            for name, array in content.arrays.items()
        )
    )


def _stamp(path: Path) -> Stamp | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_ctime_ns
