"""The results folder: a text per finished trial, and `results.h5` made from them.

A trial's text is written under a temporary name, synced and renamed into place, so the file exists
whole or not at all; the folder is the index of what is finished. `results.h5` is rebuilt from the
texts and renamed into place, never appended to. A trial that crashed, was stopped or missed a
package has the name `<id>.missing.json`, and runs again.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from trajopt.benchmark.store import atomic, results_file, trial_text, verdicts
from trajopt.benchmark.store.document import Malformed
from trajopt.benchmark.store.layout import References
from trajopt.benchmark.store.trial_text import WrongSchema
from trajopt.benchmark.trial import Trial
from trajopt.core import files
from trajopt.core.exceptions import StoreError
from trajopt.core.harmless import harmless

T = TypeVar("T")
Stamp = tuple[int, int]  # a file's inode and its time of last change, ns

_FINISHED = ".json"
_UNANSWERED = ".missing.json"
_TRIAL_NAME = re.compile(r"[0-9a-f]{20}(\.missing)?\.json")
_MAX_NAMED = 10  # damaged files that are named one by one
_OTHER_VERSION = "written by another version of trajopt"
_REASON_CHARACTERS = 300  # shown of an error of HDF5 or JSON


class Damaged(StoreError):
    """A file that holds no trial that can be read here; `path` is its path."""

    def __init__(self, path: Path, reason: str) -> None:
        words = " ".join(f"{path}: {reason}".split())
        super().__init__(harmless(words, lines=False))
        self.path = path


class DamagedFile(UserWarning):
    """A damaged file was left out while the others were read, or was written again."""


class Unheld(UserWarning):
    """Trials whose stated verdict differs from that of this installation's judge."""


OnDamage = Callable[[Damaged], None]


def _warn(damaged: Sequence[Damaged]) -> None:
    """Warn of each damaged file, or of all in one line if there are many."""
    said = [str(error) for error in damaged]
    if len(said) > _MAX_NAMED:
        folder = damaged[0].path.parent
        said = [f"{folder}: {len(said)} files are left out; the first, {said[0]}"]
    for words in said:
        warnings.warn(words, DamagedFile, stacklevel=3)


def _pass(error: Damaged) -> None:
    """Do nothing with a damaged file: its trial runs again, and readers of the folder warn."""


class Written(NamedTuple):
    """A trial's file, its stamp, and its text."""

    path: Path
    stamp: Stamp | None
    text: bytes


@dataclass(frozen=True)
class Store:
    """A results folder: `trials/*.json` and `results.h5`."""

    folder: Path

    @property
    def results(self) -> Path:
        return self.folder / "results.h5"

    def path(self, trial_id: str, *, unanswered: bool = False) -> Path:
        """The file of one trial; one without an answer has another name."""
        ending = _UNANSWERED if unanswered else _FINISHED
        return self.folder / "trials" / f"{trial_id}{ending}"

    def write(self, trial: Trial) -> Path:
        """Store one finished trial; after this returns it survives a power cut.

        Raises:
            StoreError: The disk refuses; what was stored before stays as it was.
        """
        (written,) = self.write_all([trial])
        return written.path

    def write_all(
        self, trials: Iterable[Trial], instead: Callable[[Trial], Trial] | None = None
    ) -> list[Written]:
        """Store trials that finished together, which takes hardly longer than to store one.

        Args:
            trials: Each gets a file of its own, which is there whole or not at all.
            instead: Called where no text can hold a trial, while the exception that says why is
                handled; returns the trial to store in its place. By default that is an error.

        Raises:
            StoreError: The disk refuses a file. Those before it are kept.
        """
        texts: dict[Path, bytes] = {}
        for trial in trials:
            kept = trial
            try:
                text = trial_text.write(trial)
            except StoreError:
                raise
            except Exception:
                if instead is None:
                    raise
                kept = instead(trial)
                text = trial_text.write(kept)
            texts[self.path(kept.id, unanswered=kept.runs_again)] = text
        atomic.write_all(texts)
        for path in texts:
            if not _is_unanswered(path):
                self.path(path.stem, unanswered=True).unlink(missing_ok=True)
        return [Written(path, _stamp(path), text) for path, text in texts.items()]

    def consolidate(self, seen: Seen | None = None, references: References | None = None) -> Path:
        """Rebuild `results.h5` from every trial's text; warns of damaged ones (`DamagedFile`).

        Files that were `seen` are not read again. It starts anew if another run replaced
        `results.h5` meanwhile: that run may know more trials. Gaps are measured against
        `references`; without them they are NaN.
        """
        atomic.sweep(self.folder, self.folder / "trials")
        known = seen or Seen()

        def rebuild(place: Path) -> None:
            while True:
                before = _stamp(self.results)
                place.write_bytes(self._content(known, references))
                if _stamp(self.results) == before:
                    return

        atomic.write(self.results, rebuild)
        return self.results

    def _content(self, known: Seen, references: References | None) -> bytes:
        """Return the bytes of `results.h5` for the trials in the folder."""
        damaged: list[Damaged] = []
        found = [known.read(path, damaged.append) for path in _trial_files(self.folder)]
        _warn(damaged)
        pairs = [pair for pair in found if pair is not None]
        trials = list(verdicts.judged(pairs))
        texts = [text for _, text in pairs]
        return results_file.content(trials, texts, references)

    def restore(self, seen: Seen) -> None:
        """Write again what others have removed or changed since it was seen, and warn."""
        # another run, or another worker, may have found the same
        bad = {path: text for path, text in seen.lost().items() if not _holds(path, text)}
        if not bad:
            return
        atomic.write_all(bad)
        warnings.warn(
            f"{self.folder}: a planner or another program removed or changed {len(bad)} trials "
            "during the run; they are written again",
            DamagedFile,
            stacklevel=2,
        )

    def is_current(self) -> bool:
        """Return whether `results.h5` is whole, and younger than every trial file."""
        trials = self.folder / "trials"
        try:
            built = self.results.stat().st_mtime_ns
            changes = [path.stat().st_mtime_ns for path in (trials, *trials.iterdir())]
            results_file.check_seal(self.results)
        except (OSError, ValueError):
            return False
        return max(changes) < built

    def seen(self) -> Seen:
        """Return the stored trials as they are now, but for damaged files.

        A trial that does not hold what it states is left out too, with a warning (`Unheld`): it
        runs again where it is asked for.

        Raises:
            StoreError: Another version filled this folder.
        """
        with _reading(self.results):
            results_file.check_schema(self.results)
        stamps = {path: _stamp(path) for path in _trial_files(self.folder)}
        stored = []
        for path, (trial, text) in _each(list(stamps), _both, _pass):
            stored.append((Written(path, stamps[path], text), trial))
        found = Seen()
        judged = verdicts.judged((trial, written.text) for written, trial in stored)
        unheld = 0
        for (written, _), trial in zip(stored, judged, strict=True):
            unheld += bool(trial.differences)
            if not trial.differences:
                found.keep(written, trial)
        _warn_of_unheld(self.folder, unheld, len(stored))
        return found

    def read(self) -> list[Trial]:
        """Return the stored trials with computed verdicts; warns as `read` below does."""
        damaged: list[Damaged] = []
        found = _judged(self.folder, _stored(self.folder, _both, damaged.append))
        _warn(damaged)
        return found


class Seen:
    """The trials that a run has found or stored: their files need not be read again.

    Attributes:
        trials: By their identities.
    """

    def __init__(self) -> None:
        self.trials: dict[str, Trial] = {}
        self._written: dict[str, Written] = {}
        self._added: list[str] = []

    def add(self, written: Iterable[Written]) -> None:
        """Keep what has been stored."""
        for one in written:
            trial = trial_text.read(one.text)
            self.keep(one, trial)
            self._added.append(trial.id)

    def judge_trials(self, *, trusted: bool) -> None:
        """Compute the verdicts of all trials, except of those added, if their judge is `trusted`.

        A judge is trusted that this run started, from this installation.
        """
        if trusted:
            verdicts.trust(self._written[trial_id].text for trial_id in self._added)
        pairs = [(trial, self._written[trial_id].text) for trial_id, trial in self.trials.items()]
        self.trials = {trial.id: trial for trial in verdicts.judged(pairs)}

    def keep(self, one: Written, trial: Trial) -> None:
        """Keep a file, and the trial in it."""
        self.trials[trial.id] = trial
        self._written[trial.id] = one

    def read(self, path: Path, damaged: OnDamage) -> tuple[Trial, bytes] | None:
        """Return the trial in a file, and its text; None if it is damaged."""
        known = self._written.get(_id(path))
        if known and known.path == path and known.stamp == _stamp(path):
            return self.trials[_id(path)], known.text
        try:
            return _one(path, _both)
        except Damaged as error:
            damaged(error)
        except WrongSchema:
            damaged(Damaged(path, _OTHER_VERSION))
        return None

    def lost(self) -> dict[Path, bytes]:
        """Return the files that somebody else has removed or changed, and their texts."""
        written = self._written.values()
        return {one.path: one.text for one in written if _stamp(one.path) != one.stamp}


def save(path: Path, trial: Trial, references: References | None = None) -> Path:
    """Write a `results.h5` of one trial."""
    text = trial_text.write(trial)
    content = results_file.content([trial], [text], references)
    atomic.write(path, content)
    return path


def read(path: Path | str) -> list[Trial]:
    """Return the trials of a results folder, of a `results.h5`, or of one trial's text.

    Verdicts are computed here (`verdicts`); how many trials state another one is a warning
    (`Unheld`).

    Raises:
        StoreError: The file is missing, damaged, or from another version; a damaged file in a
            folder is left out with a warning (`DamagedFile`).
    """
    damaged: list[Damaged] = []
    found = _judged(path, _stored(Path(path), _both, damaged.append))
    _warn(damaged)
    return found


def recorded(path: Path, damaged: OnDamage | None = None) -> Iterator[Trial]:
    """Yield the trials of a path with the verdicts that their texts state; raises as `read` does.

    A damaged file in a folder goes to `damaged`. A damaged text in a `results.h5` refuses that
    file: its seal is right, so somebody forged it.
    """
    if damaged is not None:
        yield from _stored(path, trial_text.read, damaged)
        return
    found: list[Damaged] = []
    yield from _stored(path, trial_text.read, found.append)
    _warn(found)


def _stored(path: Path, use: Callable[[bytes], T], damaged: OnDamage) -> Iterator[T]:
    """Yield what is made of each trial's text."""
    if path.is_dir():
        listed = _trial_files(path)
        if not listed:
            raise StoreError(f"{path}: expected a results folder with trials/*.json in it")
        for _, found in _each(listed, use, damaged):
            yield found
    elif is_trial(path):
        with _reading(path):
            yield use(_load(path))
    else:
        with _reading(path):
            yield from map(use, results_file.read(path))


def _judged(path: Path | str, pairs: Iterable[tuple[Trial, bytes]]) -> list[Trial]:
    """Return trials with computed verdicts, and warn of those that state others."""
    found = list(verdicts.judged(pairs))
    _warn_of_unheld(path, sum(bool(trial.differences) for trial in found), len(found))
    return found


def _warn_of_unheld(path: Path | str, unheld: int, count: int) -> None:
    if unheld:
        words = f"{path}: {unheld} of {count} trials do not hold what they state; "
        words += "every verdict is computed here (`trajopt verify` names them)"
        warnings.warn(words, Unheld, stacklevel=3)


def misstated(path: Path, references: References) -> list[str]:
    """Return the names of datasets of a `results.h5` that differ from its own texts.

    Args:
        path: The file, or its folder; a folder may have none.
        references: What gaps are measured against.

    Raises:
        StoreError: The file is damaged.
    """
    file = Store(path).results if path.is_dir() else path
    if is_trial(file) or not file.exists():
        return []
    with _reading(file):
        pairs = list(map(_both, results_file.read(file)))
        trials = []
        for (then, _), now in zip(pairs, verdicts.judged(pairs), strict=True):
            # another machine may find another joint at the same use of a limit
            trials.append(now if now.differences else then)
        return results_file.differences(file, trials, references)


def is_trial(path: Path) -> bool:
    """Return whether a file starts like a trial's text, under any name."""
    try:
        with files.opened(path) as stream:
            return stream.read(len(trial_text.START)) == trial_text.START
    except OSError:
        return False


def _each(
    files: Sequence[Path], use: Callable[[bytes], T], damaged: OnDamage
) -> Iterator[tuple[Path, T]]:
    """Yield each file with what is made of its text; a bad one does not take the others down.

    Raises:
        WrongSchema: Another version wrote all of them.
    """
    foreign = 0
    for path in files:
        try:
            found = _one(path, use)
        except Damaged as error:
            damaged(error)
        except WrongSchema:
            foreign += 1
            if foreign == len(files):
                raise
            damaged(Damaged(path, _OTHER_VERSION))
        else:
            yield path, found


def _one(path: Path, use: Callable[[bytes], T]) -> T:
    """Return what is made of the text in a folder's file."""
    with _reading(path):
        text = _load(path)
        stated = trial_text.stated_id(text)
        if stated != _id(path):
            raise Malformed(f"it holds trial {stated}")
        return use(text)


def _trial_files(folder: Path) -> list[Path]:
    """Return one file per trial; one without an answer only if there is none with one.

    Raises:
        WrongSchema: Another version wrote the trials.
    """
    place = folder / "trials"
    names = sorted(file.name for file in place.glob("*.*"))
    files = [place / name for name in names if _TRIAL_NAME.fullmatch(name)]
    if not files and any(name.endswith(".h5") for name in names):
        raise WrongSchema(str(folder))
    done = {file.stem for file in files if not _is_unanswered(file)}
    return [file for file in files if not _is_unanswered(file) or _id(file) not in done]


def _both(text: bytes) -> tuple[Trial, bytes]:
    return trial_text.read(text), text


def _is_unanswered(path: Path) -> bool:
    return path.name.endswith(_UNANSWERED)


def _id(path: Path) -> str:
    return path.name.split(".")[0]


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    """Convert all errors of reading a damaged file to one error that names it."""
    try:
        yield
    except WrongSchema as error:
        raise WrongSchema(str(path)) from error
    except StoreError:
        raise
    except FileNotFoundError:
        raise Damaged(path, "no such file; expected a results folder or results.h5") from None
    except OSError as error:
        if error.strerror is None:  # HDF5's
            raise _damaged(path, error) from error
        raise Damaged(path, f"cannot be read: {error.strerror}") from error
    except MemoryError as error:
        raise StoreError(f"{path}: there is not enough memory to read it") from error
    except Exception as error:
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> Damaged:
    reason = str(error)[:_REASON_CHARACTERS]
    advice = ""
    if path.parent.name == "trials" and _TRIAL_NAME.fullmatch(path.name):
        advice = "; running its comparison again replaces it"
    return Damaged(path, f"damaged, or not a file of trajopt's trials ({reason}){advice}")


def _load(path: Path) -> bytes:
    """A trial's text."""
    if _is_unanswered(path) and not path.exists():  # another run has finished it meanwhile
        path = path.with_name(f"{_id(path)}{_FINISHED}")
    return files.content(path, trial_text.MAX_BYTES)


def _holds(path: Path, text: bytes) -> bool:
    """Return whether a file has the same answer and verdict; times may differ."""
    if _is_unanswered(path) and path.with_name(f"{_id(path)}{_FINISHED}").exists():
        return True  # another run has finished it
    try:
        return _verdict(_load(path)) == _verdict(text)
    except Exception:
        return False


def _verdict(text: bytes) -> list[Any]:
    stated = trial_text.row(text)
    solution = stated["solution"] | {"setup_time": 0.0}
    return [stated["id"], stated["status"], stated["certificate"], solution]


def _stamp(path: Path) -> Stamp | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_ctime_ns
