"""`results.h5`: every trial of a folder, for people and other programs.

The fastest trajectory, with plain h5py:

    with h5py.File("results/results.h5") as file:
        best = int(np.nanargmin(file["trials/certified_duration"]))
        row, problem = (file["trials"][name][best] for name in ("row", "problem"))
        motion = file["problems"][problem]["certified"]
        first, count = motion["start"][row], motion["count"][row]
        coefficients = motion["coefficients"][:, first : first + count - 1]
        fastest = PPoly(coefficients, motion["breaks"][first : first + count])

Its groups and columns are those of `layout`. It is a product, never evidence: a function of the
trials' texts and of the references alone, so the same texts give the same bytes. What is read back
as evidence is `/texts`; `differences` compares everything else with what these give. The next file
may take rows over from it (`Product`), which saves judging them again. The file ends with a seal:
the mark `trajopt5` and the SHA-256 of all bytes before it, which HDF5 ignores.
"""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import numpy as np

from trajopt.benchmark.store import layout
from trajopt.benchmark.store.document import Malformed, pack
from trajopt.benchmark.store.fields import DTYPES, PROVENANCE
from trajopt.benchmark.store.hdf5 import Columns, Writer
from trajopt.benchmark.store.layout import COLUMNS, MEANINGS, MOTIONS, BestMotion, Key, Rows
from trajopt.benchmark.store.trial_text import MAX_BYTES, WrongSchema, stated_id
from trajopt.benchmark.trial import code_in
from trajopt.core import files
from trajopt.core.demand import DEMANDS
from trajopt.core.problem import Problem

SCHEMA = 5  # raise it whenever the layout, or the meaning of a column, changes
_MARK = f"trajopt{SCHEMA}".encode()
_SEAL_BYTES = len(_MARK) + 32  # of SHA-256
_OTHER_MARK = re.compile(rb"trajopt\d")
_BLOCK_BYTES = 1 << 20
_GROWTH_BYTES = 1 << 22  # of a file in memory: smaller steps cost the system more than all else
_TITLE = "trials of minimum-time planners, each judged by the verifier; all numbers in rad, m, s"
_TEXT = "sealed text of the same row of /trials, JSON in UTF-8: the only evidence in this file"
_CODE = "versions, commit and machine of trials, JSON; trials/code counts its rows from 0"
_TEXT_BYTES = 1 << 26  # of texts that are read at once, if each is as long as the file
_SAME_RTOL = 1e-9  # another machine rounds otherwise
_HEAP_REFERENCE_BYTES = 16  # of a text's length and place
_COMMENT = 13  # HDF5's number of the message in an object's header
_JUDGE = "judge"  # attribute: digest of the code that judged
_DIGEST = re.compile(r"[0-9a-f]{64}")


class StoredRow(NamedTuple):
    """A trial's row: in which tables it is, and what orders it there."""

    key: Key
    label: bytes
    seed: int
    id: str
    planner: str
    part: Any
    row: int


class Version(NamedTuple):
    """Which planner's trial a row is, of which code, and when it ran."""

    id: str
    label: str
    planner: str
    options: Mapping[str, Any]
    code: str
    started: str
    asked: str


class Stored(NamedTuple):
    """All rows of a file.

    Attributes:
        entries: Of each trial, in any order.
        problems: Each problem.
        best: What is known of each problem, by digest.
    """

    entries: Sequence[StoredRow]
    problems: Mapping[Key, Problem]
    best: Mapping[str, BestMotion]


def entry(key: Key, part: Any, row: int = 0) -> StoredRow:
    """Return a row of a problem's table."""
    label, seed, own_id, planner = (
        part["trials"][name][row] for name in ("label", "seed", "id", "planner")
    )
    return StoredRow(key, label, int(seed), own_id.decode(), planner.decode(), part, row)


def version(row: StoredRow) -> Version:
    """Return the version of the planner that gave a row's answer."""
    names = ("label", "planner", "options", "started", "asked", PROVENANCE.name)
    label, planner, options, started, asked, code = (
        row.part["trials"][name][row.row].decode() for name in names
    )
    code = code_in(json.loads(code))
    return Version(row.id, label, planner, json.loads(options), code, started, asked)


def by_problem(entries: Iterable[StoredRow]) -> dict[Key, list[StoredRow]]:
    """Return the rows of each problem in the order of the file: by label, seed and identity."""
    found: dict[Key, list[StoredRow]] = {}
    for row in sorted(entries, key=lambda row: (row.key, row.label, row.seed, row.id)):
        found.setdefault(row.key, []).append(row)
    return found


def _tables(entries: Sequence[StoredRow]) -> Rows:
    """Return the rows of one problem."""
    parts: dict[int, Any] = {id(row.part): row.part for row in entries}
    places = {part: place for place, part in enumerate(parts)}
    return Rows(list(parts.values()), [(places[id(row.part)], row.row) for row in entries])


# --- writing ---


def content(stored: Stored, judge: str) -> bytes:
    """Return the file's bytes, without their seal. HDF5 may crash on a full disk: not there.

    Args:
        stored: Its rows.
        judge: Digest of the code that judged them.
    """
    import h5py  # late, here and below: takes long to import

    in_memory = {"driver": "core", "backing_store": False, "block_size": _GROWTH_BYTES}
    with h5py.File("results.h5", "w", libver=("earliest", "v110"), **in_memory) as file:
        file.attrs.update({"title": _TITLE, "schema": SCHEMA, _JUDGE: judge})
        rows = {key: _tables(entries) for key, entries in by_problem(stored.entries).items()}
        names = layout.groups(rows)
        file.create_group("problems")
        writer = Writer()
        _write_trials(writer, file.id, rows, stored.best, names)
        for key, tables in rows.items():
            problem = stored.problems[key]
            # any letters, unlike the names within
            place = file.create_group(f"problems/{names[key]}").id
            _write_problem(writer, place, problem)
            _write_tables(writer, place, tables, problem)
            if key[1] in stored.best:
                _write_best(writer, writer.group(place, "best"), stored.best[key[1]], problem)
        file.flush()
        image: bytes = file.id.get_file_image()
        return image


def _write_trials(
    writer: Writer,
    file: Any,
    rows: Mapping[Key, Rows],
    best: Mapping[str, BestMotion],
    names: Mapping[Key, str],
) -> None:
    """Write what has a row for every trial."""
    made = {"problem", "reference", "gap", "code", "row"}
    parts = list(rows.values())
    columns: dict[str, Any] = {
        field.name: _joined([part.column("trials", field.name) for part in parts], field.kind)
        for field in COLUMNS
        if field.name not in made
    }
    counts = [part.count for part in parts]
    known = [best[digest].duration if digest in best else np.nan for _, digest in rows]
    code = _joined([part.column("trials", PROVENANCE.name) for part in parts], "text")
    codes = sorted(set(code))
    places = {text: place for place, text in enumerate(codes)}
    columns["problem"] = np.repeat(np.array([names[key] for key in rows], dtype=object), counts)
    columns["reference"] = np.repeat(np.array(known, dtype=float), counts)
    columns["gap"] = columns["certified_duration"] / columns["reference"] - 1
    columns["code"] = np.array([places[text] for text in code], dtype=np.int64)
    columns["row"] = _joined([np.arange(count) for count in counts], "integer")
    place = writer.group(file, "trials")
    for field in COLUMNS:
        writer.column(place, field.name, columns[field.name], field.unit, field.meaning)
    place = writer.group(file, "code")
    writer.column(place, "provenance", np.array(codes, dtype=object), "", _CODE)
    texts = _joined([part.column("texts", "text") for part in parts], "text")
    writer.column(file, "texts", texts, "", _TEXT)


def _joined(columns: Sequence[Any], kind: str) -> Any:
    return np.concatenate([np.zeros(0, dtype=DTYPES.get(kind, object)), *columns])


def _write_problem(writer: Writer, place: Any, problem: Problem) -> None:
    about = {
        "name": problem.name,
        "source": problem.source,
        "digest": problem.digest(),
        "joint_names": list(problem.joint_labels),
        "joint_units": [problem.unit(joint) for joint in range(problem.joints)],
        "uses": layout.limits_used(problem),
    }
    # an attribute of no texts is of numbers otherwise
    writer.attributes(place, {name: value if value else "" for name, value in pack(about).items()})
    length = problem.shared_unit()
    writer.column(place, "waypoints", problem.waypoints, length, MEANINGS["waypoints"])
    for name, numbers in problem.demands.items():
        unit = _ascii(DEMANDS[name].unit(length))
        writer.column(place, name, np.asarray(numbers), unit, MEANINGS[name])
    inner = writer.group(place, "limits")
    for name, limit in sorted(problem.limits.kinds.items()):
        unit = _ascii(limit.unit(problem))
        writer.column(inner, name, np.asarray(limit.numbers), unit, MEANINGS["limits"])


def _ascii(unit: str) -> str:
    """Return a unit in ASCII: `h5dump` shows nothing else."""
    return unit.replace("²", "^2").replace("³", "^3")


def _write_tables(writer: Writer, place: Any, rows: Rows, problem: Problem) -> None:
    times = rows.column("", "waypoint_times")
    writer.column(place, "waypoint_times", times, "s", MEANINGS["waypoint_times"])
    groups = {"uses": writer.group(place, "uses")}
    for name, unit in (("joint", "1"), ("time", "s"), ("value", "1")):
        column = rows.column("uses", name)
        writer.column(groups["uses"], name, column, unit, MEANINGS[f"uses/{name}"])
    power = f"{problem.shared_unit(1)}^power"
    units = {"breaks": "s", "coefficients": power, "lengths": "s"}
    searches = {"duration": "s", "evaluations": "1"}
    for name in (*MOTIONS, "history"):
        groups[name] = writer.group(place, name)
        own_units = units if name in MOTIONS else searches
        _write_ragged(writer, groups[name], name, rows, own_units)
    for name in (*MOTIONS, "history", "uses"):
        writer.attributes(groups[name], {"description": MEANINGS[name]})


def _write_ragged(
    writer: Writer, place: Any, group: str, rows: Rows, units: Mapping[str, str]
) -> None:
    count = rows.column(group, "count").astype(np.int64)
    writer.column(place, "start", np.cumsum(count) - count, "1", MEANINGS["start"])
    writer.column(place, "count", count, "1", MEANINGS["count"])
    for name, unit in units.items():
        writer.column(place, name, rows.column(group, name), unit, MEANINGS[name])


def _write_best(writer: Writer, place: Any, best: BestMotion, problem: Problem) -> None:
    about = {name: getattr(best, name) for name in ("duration", "kind", "lower_bound", "source")}
    writer.attributes(place, {"description": MEANINGS["best"], **about})
    if best.motion is not None:
        writer.column(place, "breaks", best.motion.breaks, "s", MEANINGS["breaks"])
        power = f"{problem.shared_unit(1)}^power"
        meaning = MEANINGS["best/coefficients"]
        writer.column(place, "coefficients", best.motion.coefficients, power, meaning)


def seal(data: bytes) -> bytes:
    """Return the seal that follows these bytes."""
    return _MARK + hashlib.sha256(data).digest()


# --- reading ---


def read(path: Path) -> Iterator[bytes]:
    """Yield the trials' texts: the only part of a file that is read as evidence.

    Raises:
        WrongSchema: Another version wrote the file.
        Exception: Any other error means that the file is damaged, or not ours.
    """
    check_seal(path)
    import h5py

    with h5py.File(path, "r", locking=False) as file:
        texts = _texts(h5py, file)
        rows = max(1, _TEXT_BYTES // path.stat().st_size)
        known = set()
        for start in range(0, len(texts), rows):
            for text in texts[start : start + rows]:
                if len(text) > MAX_BYTES:
                    raise Malformed(f"texts: one has more than {MAX_BYTES / 1e6:g} MB")
                trial_id = stated_id(text)
                if trial_id in known:
                    raise Malformed(f"texts: two of trial {trial_id}")
                known.add(trial_id)
                yield text


def _texts(h5py: Any, file: Any) -> Any:
    """Return the column of texts, if it is in the very file, and no longer than that."""
    is_here = isinstance(file.get("texts", getlink=True), h5py.HardLink)
    data = file["texts"] if is_here else None
    if not isinstance(data, h5py.Dataset) or data.ndim != 1:
        raise Malformed("texts: expected a column in this very file")
    if data.chunks or data.external or data.is_virtual:
        raise Malformed("texts: expected a column in this very file, in one piece")
    kind = h5py.check_string_dtype(data.dtype)
    if kind is None or kind.length is not None:
        raise Malformed("texts: expected texts of any length")
    if data.id.get_storage_size() != _HEAP_REFERENCE_BYTES * len(data):
        raise Malformed("texts: expected a text in each row")
    return data


def check_schema(path: Path) -> None:
    """Raise `WrongSchema` for a file that another version wrote; other files are not looked at."""
    if path.is_file():
        with files.opened(path) as stream:
            _own_seal(path, stream)


@contextmanager
def product(path: Path, judge: str) -> Iterator[list[tuple[StoredRow, bytes]]]:
    """Yield the rows of a file, each with its text, for the next file.

    They are as trustworthy as the file itself: `verify` finds what was forged.

    Args:
        path: Of the file, which is open in the block.
        judge: Digest of the code that must have judged them.

    Raises:
        Exception: There is no such file, it is damaged, or other code made it.
    """
    check_seal(path)
    import h5py

    with h5py.File(path, "r", locking=False) as file:
        if file.attrs["schema"] != SCHEMA or file.attrs[_JUDGE] != judge:
            raise Malformed("other code made it")
        trials = {name: data[()] for name, data in file["trials"].items()}
        codes = file["code/provenance"][()]
        trials[PROVENANCE.name] = codes[trials["code"]]
        texts = file["texts"][()]
        found = []
        for name in np.unique(trials["problem"]):
            (rows,) = np.nonzero(trials["problem"] == name)
            place = file["problems"][name]
            part = _Part(place, {name: data[rows] for name, data in trials.items()}, texts[rows])
            key = str(place.attrs["name"]), str(place.attrs["digest"])
            if not np.array_equal(trials["row"][rows], np.arange(len(place["waypoint_times"]))):
                raise Malformed("rows that are not in order")
            for row in range(len(rows)):
                found.append((entry(key, part, row), texts[rows[row]]))
        yield found


class _Part:
    """The tables of a problem in an open file; its columns are read where they are used."""

    def __init__(self, place: Any, trials: Mapping[str, Any], texts: Any) -> None:
        self._cut = {"trials": trials, "texts": {"text": texts}}
        self._groups = {name: Columns(place.id, name) for name in ("", *layout.GROUPS)}

    def __getitem__(self, group: str) -> Any:
        return self._cut[group] if group in self._cut else self._groups[group]


# --- comparing ---


def holds(path: Path, expected: bytes) -> bool:
    """Return whether a file has this content, byte for byte, and its seal."""
    try:
        with files.opened(path) as stream:
            if stream.seek(0, os.SEEK_END) != len(expected) + _SEAL_BYTES:
                return False
            stream.seek(0)
            starts = range(0, len(expected), _BLOCK_BYTES)
            blocks = (expected[start : start + _BLOCK_BYTES] for start in starts)
            same = all(stream.read(len(block)) == block for block in blocks)
            return same and stream.read() == seal(expected)
    except OSError:
        return False


def differences(path: Path, expected: bytes) -> list[str]:
    """Name the groups, columns and attributes of a file that are not what its texts give.

    Args:
        path: Of the file.
        expected: The content that its texts give.

    Raises:
        Exception: The file is damaged.
    """
    if holds(path, expected):
        return []
    check_seal(path)
    import h5py

    with (
        h5py.File(path, "r", locking=False) as found,
        h5py.File(io.BytesIO(expected), "r") as right,
    ):
        return list(_differing(h5py, found, right, ""))


def judge_of(path: Path) -> str:
    """Return which code judged the rows of a file, as it says; empty where it says nothing."""
    import h5py

    with h5py.File(path, "r", locking=False) as file:
        stated = file.attrs.get_id(_JUDGE) if _JUDGE in file.attrs else None
        if stated is None or stated.shape != () or stated.get_storage_size() > 64:
            return ""
        digest = str(file.attrs[_JUDGE])
        return digest if _DIGEST.fullmatch(digest) else ""


def _differing(h5py: Any, found: Any, expected: Any, path: str) -> Iterator[str]:
    """Yield what differs below two groups; links and loops of the found one are not followed."""
    yield from _differing_attributes(found, expected, path or "/")
    if found.id.get_num_objs() != len(expected) or list(found) != list(expected):
        yield f"{path or '/'}: names"
    if _is_commented(h5py, found):
        yield f"{path or '/'}: comment"
    for name in expected:
        place = f"{path}/{name}"
        if not isinstance(found.get(name, getlink=True), h5py.HardLink):
            yield place
            continue
        ours, theirs = expected[name], found[name]
        if type(ours) is not type(theirs):
            yield place
        elif isinstance(ours, h5py.Group):
            yield from _differing(h5py, theirs, ours, place)
        else:
            if _is_commented(h5py, theirs):
                yield f"{place}: comment"
            if not _same_kind(theirs, ours) or not _same_values(h5py, theirs, ours):
                yield place
            yield from _differing_attributes(theirs, ours, place)


def _is_commented(h5py: Any, place: Any) -> bool:
    """Return whether an object has a comment, which some viewers show."""
    return bool(h5py.h5o.get_info(place.id).hdr.mesg.present >> _COMMENT & 1)


def _differing_attributes(found: Any, expected: Any, path: str) -> Iterator[str]:
    if set(found.attrs) != set(expected.attrs):
        yield f"{path}: attributes"
        return
    for name in expected.attrs:
        ours, theirs = (place.attrs.get_id(name) for place in (expected, found))
        alike = ours.shape == theirs.shape and ours.get_type() == theirs.get_type()
        if not alike or not _close(found.attrs[name], expected.attrs[name]):
            yield f"{path}: {name}"


def _same_kind(found: Any, expected: Any) -> bool:
    """Return whether shape, type, and how the data are stored are the same."""
    kinds = [place.id.get_type().encode() for place in (found, expected)]  # texts' coding too
    if found.shape != expected.shape or kinds[0] != kinds[1]:
        return False
    return bool(found.id.get_create_plist().equal(expected.id.get_create_plist()))


def _same_values(h5py: Any, found: Any, expected: Any) -> bool:
    if not h5py.check_string_dtype(expected.dtype):
        return _close(found[()], expected[()])
    rows = max(1, _TEXT_BYTES // found.file.id.get_filesize())  # each may be as long as the file
    starts = range(0, len(expected), rows)
    return all(np.array_equal(found[i : i + rows], expected[i : i + rows]) for i in starts)


def _close(found: Any, expected: Any) -> bool:
    """Return whether values are the same, numbers but for rounding; a power's to its largest."""
    if not isinstance(expected, float) and np.asarray(expected).dtype.kind != "f":
        return bool(np.all(found == expected))
    scale = np.abs(np.where(np.isfinite(expected), expected, 0.0))
    if scale.ndim == 3:
        scale = scale.max(axis=(1, 2), keepdims=True, initial=0.0)
    with np.errstate(invalid="ignore"):
        near = np.abs(found - expected) <= _SAME_RTOL * scale
    same = near | (found == expected) | (np.isnan(found) & np.isnan(expected))
    return bool(same.all())


# --- the seal ---


def check_seal(path: Path) -> None:
    """Compute the seal anew: HDF5 never sees a file that was damaged."""
    with files.opened(path) as stream:
        stated = _own_seal(path, stream)
        left = stream.seek(0, os.SEEK_END) - _SEAL_BYTES
        stream.seek(0)
        digest = hashlib.sha256()
        while left > 0:
            block = stream.read(min(left, _BLOCK_BYTES))
            digest.update(block)
            left -= len(block)
    if digest.digest() != stated:
        raise Malformed("its checksum differs or is missing: it was damaged, cut or edited")


def _own_seal(path: Path, stream: BinaryIO) -> bytes:
    """The digest at the end of the file; nothing where there is no seal."""
    size = stream.seek(0, os.SEEK_END)
    stream.seek(max(0, size - _SEAL_BYTES))
    tail = stream.read()
    if tail.startswith(_MARK):
        return tail[len(_MARK) :]
    if _OTHER_MARK.search(tail):
        raise WrongSchema(str(path))
    return b""
