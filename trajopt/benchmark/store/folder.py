"""The results folder: a text per finished trial, and `results.h5` made from them.

A trial's text is written under a temporary name, synced and renamed into place, so the file exists
whole or not at all; the folder is the index of what is finished. `results.h5` is rebuilt from the
texts and renamed into place, never appended to. A trial that crashed, was stopped or missed a
package has the name `<id>.missing.json`, and runs again.
"""

from __future__ import annotations

import re
import warnings
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeVar

from trajopt.benchmark.provenance import judge_digest
from trajopt.benchmark.store import atomic, layout, results_file, trial_text, verdicts
from trajopt.benchmark.store.document import Malformed, UnknownKind
from trajopt.benchmark.store.layout import Key, References, Table
from trajopt.benchmark.store.results_file import Stored, StoredRow, Version
from trajopt.benchmark.store.trial_text import WrongSchema
from trajopt.benchmark.trial import Trial, frozen
from trajopt.core import files
from trajopt.core.exceptions import StoreError
from trajopt.core.harmless import harmless
from trajopt.core.problem import Problem
from trajopt.explain.references import PROVERS, REFERENCES

T = TypeVar("T")
Stamp = tuple[int, int]  # a file's inode and its time of last change, ns

_FINISHED = ".json"
_UNANSWERED = ".missing.json"
_TRIAL_NAME = re.compile(r"[0-9a-f]{20}(\.missing)?\.json")
_MAX_NAMED = 10  # damaged files that are named one by one
_TELLING = (*REFERENCES, *PROVERS)  # planners whose trials are references
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


class Found(NamedTuple):
    """A trial's file, its stamp, and its text."""

    path: Path
    stamp: Stamp | None
    text: bytes


class Written(NamedTuple):
    """What was stored, the trial that its text states, and its row of `results.h5`."""

    found: Found
    trial: Trial
    row: tuple[Key, Table]


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
        return written.found.path

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
        made: dict[Path, tuple[bytes, Trial, tuple[Key, Table]]] = {}
        for trial in trials:
            kept = trial
            try:
                text, stated = trial_text.written(trial)
            except StoreError:
                raise
            except Exception:
                if instead is None:
                    raise
                kept = instead(trial)
                text, stated = trial_text.written(kept)
            path = self.path(kept.id, unanswered=kept.runs_again)
            stated = verdicts.with_motion(stated, kept.certificate)
            made[path] = text, stated, _row(stated, text)
        atomic.write_all({path: text for path, (text, *_) in made.items()})
        for path in made:
            if not _is_unanswered(path):
                self.path(path.stem, unanswered=True).unlink(missing_ok=True)
        return [
            Written(Found(path, _stamp(path), text), trial, row)
            for path, (text, trial, row) in made.items()
        ]

    def consolidate(self, seen: Seen | None = None, references: References | None = None) -> Path:
        """Write `results.h5` of every trial's text; warns of damaged ones (`DamagedFile`).

        Files that were `seen` are not read again. Rows are those that judges of this run made,
        those of the last `results.h5` whose texts are the same and which this installation's judge
        made, and for the rest trials are judged. It starts anew if another run replaced
        `results.h5` meanwhile: that run may know more trials. Gaps are measured against
        `references`; without them they are NaN.
        """
        atomic.sweep(self.folder, self.folder / "trials")
        known = seen or Seen()
        before = _stamp(self.results)
        content = self._content(known, references)

        def rebuild(place: Path) -> None:
            nonlocal before, content
            while True:
                with place.open("wb") as stream:
                    stream.write(content)
                    stream.write(results_file.seal(content))
                if _stamp(self.results) == before:
                    return
                before = _stamp(self.results)
                content = self._content(known, references)

        if not results_file.holds(self.results, content):
            atomic.write(self.results, rebuild)
        return self.results

    def refresh(self, references: References | None = None) -> bool:
        """Write `results.h5` anew if it is not of the folder's trials; return whether it was.

        Damaged trials are left out without a word: who reads them warns.

        Raises:
            StoreError: The disk refuses.
        """
        if self._is_current():
            return False
        before = _stamp(self.results)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DamagedFile)
            return _stamp(self.consolidate(references=references)) != before

    def _is_current(self) -> bool:
        """Return whether `results.h5` has the folder's texts, and this installation's verdicts."""
        try:
            with results_file.product(self.results, judge_digest()) as held:
                texts = {entry.id: text for entry, text in held}
            paths = _trial_files(self.folder)
            same = (texts.get(_id(path)) == _load(path) for path in paths)
            return len(texts) == len(paths) and all(same)
        except Exception:  # there is none, or none that can be read
            return False

    def _content(self, known: Seen, references: References | None) -> bytes:
        """Return the bytes of `results.h5` for the trials in the folder, without their seal."""
        damaged: list[Damaged] = []
        texts: dict[str, bytes] = {}
        for path in _trial_files(self.folder):
            text = known.text(path, damaged.append)
            if text is not None:
                texts[_id(path)] = text
        judge = judge_digest()
        bad = len(damaged)

        def content(old: Sequence[tuple[StoredRow, bytes]]) -> bytes:
            del damaged[bad:]
            kept = [entry for entry, text in old if texts.get(entry.id) == text]
            stored = self._rows(texts, kept, known, references, damaged.append)
            known.versions = [results_file.version(own) for own in stored.entries]
            # a stranger's kind of limit may have been imported by reading
            return results_file.content(stored, judge_digest())

        try:
            with results_file.product(self.results, judge) as old:
                made = content(old)
        except Exception:  # there is no last file, or none that is of use
            made = content([])
        _warn(damaged)
        return made

    def _rows(
        self,
        texts: Mapping[str, bytes],
        kept: Iterable[StoredRow],
        known: Seen,
        references: References | None,
        damaged: OnDamage,
    ) -> Stored:
        """Return all rows for `results.h5`: those that are known, and judged trials for the rest.

        Args:
            texts: Of the trials, by identity.
            kept: Rows of the last file.
            known: What the run has seen.
            references: What is known of each problem.
            damaged: Called with each trial whose text is damaged.
        """
        trials = dict(known.trials)
        entries = {entry.id: entry for entry in kept}
        made = known.rows.items()
        entries |= {own: results_file.entry(*row) for own, row in made if own in texts}
        for own_id in texts.keys() - entries.keys():
            try:
                with _reading(self.path(own_id)):
                    text = texts[own_id]
                    trial = trials.get(own_id) or verdicts.judged(trial_text.read(text))
            except Damaged as error:
                damaged(error)
            except WrongSchema:
                damaged(Damaged(self.path(own_id), _OTHER_VERSION))
            else:
                trials[own_id] = trial
                entries[own_id] = results_file.entry(*_row(trial, text))
        return _arranged(entries, texts, trials, references)

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

    def seen(self, asked: Container[str] | None = None) -> Seen:
        """Return the stored trials as they are now, but for damaged files.

        Those that are `asked` for, by default all, are judged: one that does not hold what it
        states is left out, with a warning (`Unheld`), and runs again. Of the others only the texts
        are kept.

        Raises:
            StoreError: Another version filled this folder.
        """
        paths = _trial_files(self.folder)
        found = Seen()
        stamps = {path: _stamp(path) for path in paths}
        counts = Counter[bool]()
        read = list(_each(paths, _of_asked(asked), _pass))
        judged = _judged([(path, trial) for path, (trial, _) in read if trial is not None])
        for path, (stated, text) in read:
            trial = judged.get(path)
            if stated is not None and trial is None:  # it cannot be judged: it runs again
                continue
            holds = trial is None or not trial.differences
            counts[holds] += trial is not None
            if holds:
                found.keep(Found(path, stamps[path], text), trial)
        _warn_of_unheld(self.folder, counts[False], counts.total())
        try:
            with _reading(self.results):
                results_file.check_schema(self.results)
        except WrongSchema:
            if not paths:
                raise
            words = f"{_OTHER_VERSION}; it is written anew from the texts in trials/"
            _warn([Damaged(self.results, words)])
        except StoreError:  # no file that can be read: it is written anew, too
            pass
        return found

    def read(self) -> list[Trial]:
        """Return the stored trials with computed verdicts; warns as `read` below does."""
        return read(self.folder)


class Seen:
    """The trials that a run has found or stored: their files need not be read again.

    Attributes:
        trials: Those that were asked for or added, by their identities.
        rows: Those that judges made, by identity.
        versions: Of every trial of the folder, once `results.h5` is written.
    """

    def __init__(self) -> None:
        self.trials: dict[str, Trial] = {}
        self.rows: dict[str, tuple[Key, Table]] = {}
        self.versions: list[Version] = []
        self._found: dict[str, Found] = {}
        self._problems: dict[Key, Problem] = {}

    def add(self, written: Iterable[Written], *, trusted: bool) -> None:
        """Keep what has been stored.

        Args:
            written: By judges.
            trusted: Whether this run started them, from this installation; else the trials are
                judged again.
        """
        for found, trial, row in written:
            if not trusted:
                self.keep(found, verdicts.judged(trial_text.read(found.text)))
                continue
            key, _ = row
            if key not in self._problems:  # one object, however many trials it has
                self._problems[key] = frozen(trial.problem)
            shared = self._problems[key]
            # its own object has what the judge computed of it
            own = trial if trial.problem is shared else replace(trial, problem=shared)
            self.keep(found, own, row)

    def keep(self, found: Found, trial: Trial | None, row: tuple[Key, Table] | None = None) -> None:
        """Keep a file, the trial in it, and its row."""
        own_id = _id(found.path)
        self._found[own_id] = found
        self.rows.pop(own_id, None)
        if row is not None:
            self.rows[own_id] = row
        if trial is not None:
            self.trials[own_id] = trial

    def text(self, path: Path, damaged: OnDamage) -> bytes | None:
        """Return the text in a file; None if it is damaged."""
        known = self._found.get(_id(path))
        if known and known.path == path and known.stamp == _stamp(path):
            return known.text
        try:
            text = _one(path, bytes)
            if known and known.text != text:  # another run, or worker, finished it too
                trial = _one(path, trial_text.read) if _id(path) in self.trials else None
                self.keep(Found(path, _stamp(path), text), trial and verdicts.judged(trial))
            return text
        except Damaged as error:
            damaged(error)
        except WrongSchema:
            damaged(Damaged(path, _OTHER_VERSION))
        return None

    def lost(self) -> dict[Path, bytes]:
        """Return the files that somebody else has removed or changed, and their texts."""
        found = self._found.values()
        return {one.path: one.text for one in found if _stamp(one.path) != one.stamp}


# --- rows of results.h5 ---


def _row(trial: Trial, text: bytes) -> tuple[Key, Table]:
    """Return a judged trial's problem and row."""
    return layout.key(trial.problem), layout.table(trial, text)


def _arranged(
    entries: Mapping[str, StoredRow],
    texts: Mapping[str, bytes],
    trials: Mapping[str, Trial],
    references: References | None,
) -> Stored:
    """Return rows with their problems, and what is known of these.

    Args:
        entries: The rows, by identity.
        texts: Theirs.
        trials: Judged ones; of the references the others are read and judged.
        references: What is known of each problem.
    """
    problems = {}
    telling = []
    for key, own in results_file.by_problem(entries.values()).items():
        first = texts[own[0].id]
        known = trials.get(own[0].id)
        problems[key] = known.problem if known else trial_text.problem(first)
        if references is None:
            continue
        chosen = [entry.id for entry in own if entry.planner in _TELLING]
        for one in chosen:
            telling.append(trials.get(one) or verdicts.judged(trial_text.read(texts[one])))
        if not chosen:
            telling.append(trial_text.read(first))
    best = references(telling) if references else {}
    return Stored(list(entries.values()), problems, best)


def save(path: Path, trial: Trial, references: References | None = None) -> Path:
    """Write a `results.h5` of one trial."""
    content = rebuilt([trial_text.write(trial)], references, judge=judge_digest(trial.problem))
    atomic.write(path, content + results_file.seal(content))
    return path


def rebuilt(
    texts: Iterable[bytes],
    references: References | None = None,
    known: Mapping[bytes, tuple[Trial, Trial]] = MappingProxyType({}),
    *,
    judge: str = "",
) -> bytes:
    """Return the content of the `results.h5` that texts give, without its seal.

    Args:
        texts: Of trials.
        references: What is known of each problem.
        known: Trials as texts state them, and with computed verdicts (`verdicts.again`), by texts.
        judge: Digest of the code that judged, as the file says.

    Raises:
        Exception: A text is damaged.
    """
    found: dict[str, bytes] = {}
    trials: dict[str, Trial] = {}
    entries: dict[str, StoredRow] = {}
    for text in texts:
        then, now = known.get(text) or (trial_text.read(text), None)
        trial = verdicts.judged(then, now)
        found[trial.id], trials[trial.id] = text, trial
        entries[trial.id] = results_file.entry(*_row(trial, text))
    return results_file.content(_arranged(entries, found, trials, references), judge)


def read(path: Path | str) -> list[Trial]:
    """Return the trials of a results folder, of a `results.h5`, or of one trial's text.

    Verdicts are computed here (`verdicts`); how many trials state another one is a warning
    (`Unheld`).

    Raises:
        StoreError: The file is missing, damaged, or from another version; a damaged file in a
            folder is left out with a warning (`DamagedFile`).
    """
    found = verdicts.judged_many(list(recorded(Path(path))))
    _warn_of_unheld(path, sum(bool(trial.differences) for trial in found), len(found))
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


def _warn_of_unheld(path: Path | str, unheld: int, count: int) -> None:
    if unheld:
        words = f"{path}: {unheld} of {count} trials do not hold what they state; "
        words += "every verdict is computed here (`trajopt verify` names them)"
        warnings.warn(words, Unheld, stacklevel=3)


def texts(path: Path, damaged: OnDamage) -> Iterator[tuple[Trial, bytes]]:
    """Yield the trials of a path as `recorded` does, each with its text."""
    yield from _stored(path, _both, damaged)


def misstated(
    path: Path, references: References, known: Mapping[bytes, tuple[Trial, Trial]]
) -> list[str]:
    """Return the names of what differs in a `results.h5` from what its own texts give.

    Args:
        path: The file, or its folder; a folder may have none.
        references: What is known of each problem.
        known: Trials as texts state them, and with computed verdicts (`verdicts.again`), by texts.

    Raises:
        StoreError: The file is damaged.
    """
    file = Store(path).results if path.is_dir() else path
    if is_trial(file) or not file.exists():
        return []
    with _reading(file):
        judge = results_file.judge_of(file)
        content = rebuilt(results_file.read(file), references, known, judge=judge)
        return results_file.differences(file, content)


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


def _of_asked(
    asked: Container[str] | None,
) -> Callable[[bytes], tuple[Trial | None, bytes]]:
    """Return what reads the trials that are asked for, and no other."""

    def use(text: bytes) -> tuple[Trial | None, bytes]:
        is_asked = asked is None or trial_text.stated_id(text) in asked
        return trial_text.read(text) if is_asked else None, text

    return use


def _judged(read: Sequence[tuple[Path, Trial]]) -> dict[Path, Trial]:
    """Return the judged trials by their files, but for those that no judge can judge."""
    try:
        trials = verdicts.judged_many([trial for _, trial in read])
        return {path: trial for (path, _), trial in zip(read, trials, strict=True)}
    except Exception:  # one of them: the others are judged all the same
        found = {}
        for path, trial in read:
            with suppress(Damaged), _reading(path):
                found[path] = verdicts.judged(trial)
        return found


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
    except UnknownKind as error:
        raise Damaged(path, str(error)) from error
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
    solution = stated["solution"] | {"setup_time": 0.0, "library_time": None}
    return [stated["id"], stated["status"], stated["certificate"], solution]


def _stamp(path: Path) -> Stamp | None:
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_ino, found.st_ctime_ns
