"""Is every forged place of results.h5 named? Each edit at each place of the file, sealed again.

    python tests/soak.py forged_tables            # some 3,000 forgeries, five minutes on one core
    python tests/soak.py forged_tables --quick    # every 53rd

The file has four planners' trials of a problem. Every group, column and attribute in it is removed,
changed, linked elsewhere, stored in another way, made huge, or gets what it does not have: the
edits of `OF_OBJECTS`, `OF_GROUPS`, `OF_COLUMNS` and `OF_ATTRIBUTES`, each at every place where it
changes something. `OF_TEXTS` forge the sealed texts and the file as a whole. `verify` must name the
place, or refuse the file; *held* counts what it believed. Exit code 1 if a forgery is believed.
"""

from __future__ import annotations

import json
import resource
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
import pandas as pd

from experiments.common.output import progress, save_table
from soaks import forged_results
from trajopt.benchmark.store.folder import Store, read
from trajopt.benchmark.store.layout import BestMotion, References
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.store.results_file import seal
from trajopt.benchmark.store.trial_text import sealed
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import StoreError
from trajopt.views.analysis.gap_reference import best

QUICK = 53  # every 53rd forgery: no number of edits divides it
HUGE = 40_000_000  # bytes
LITTLE = 1e-8  # relative: ten times what counts as rounding
_TEXT = h5py.string_dtype()

Edit = Callable[[h5py.File, str], object]
"""Changes a place of a file; raises `Same` where it would change nothing."""


class Same(Exception):
    """The edit leaves the place as it is, or cannot be made there."""


# --- of groups and columns ---


def _linked(target: Callable[[str], Any], file: h5py.File, place: str) -> None:
    del file[place]
    file[place] = target(place)


def _beside(file: h5py.File, place: str) -> None:
    """Let a place be another one that is of its kind."""
    group = file[place].parent
    own = file[place]
    others = [name for name, other in group.items() if type(other) is type(own) and other != own]
    if not others:
        raise Same
    _linked(lambda _: h5py.SoftLink(f"{group.name}/{others[0]}"), file, place)


def _moved(file: h5py.File, place: str) -> None:
    file.move(place, f"{place}.")


def _comment(file: h5py.File, place: str) -> None:
    h5py.h5o.set_comment(file[place].id, b"by NIST")


OF_OBJECTS: dict[str, Edit] = {
    "removed": lambda file, place: file.__delitem__(place),
    "renamed": _moved,
    "a link to itself": partial(_linked, h5py.SoftLink),
    "a link to its neighbour": _beside,
    "a link into another file": partial(_linked, lambda _: h5py.ExternalLink("/etc/passwd", "/x")),
    "the root once more": lambda file, place: _linked(lambda _: file["/"], file, place),
    "one attribute more": lambda file, place: file[place].attrs.create("verified", "by NIST"),
    "a comment": _comment,
}

OF_GROUPS: dict[str, Edit] = {
    "one column more": lambda file, place: file[place].create_dataset("more", data=1.0),
    "one group more": lambda file, place: file[place].create_group("\x1b[31m\u202egnp.exe"),
    "itself as a member": lambda file, place: file[place].__setitem__("again", file[place]),
    "a thousand groups more": lambda file, place: [
        file[place].create_group(f"x{number}") for number in range(1000)
    ],
    "a name of 60,000 characters": lambda file, place: file[place].create_group("n" * 60_000),
    "a thousand groups deep": lambda file, place: file[place].create_group("/".join("d" * 1000)),
}


# --- of columns ---


def _values(change: Callable[[Any], Any], file: h5py.File, place: str) -> None:
    """Change values of a column where they are."""
    before = file[place][()]
    after = change(np.array(before))
    if _alike(before, after):
        raise Same
    file[place][...] = after


def _alike(one: Any, other: Any) -> bool:
    kinds = {one.dtype.kind, other.dtype.kind}
    return bool(np.array_equal(one, other, equal_nan=kinds == {"f"}))


def _first(values: Any) -> Any:
    if not values.size:
        raise Same
    place = (0,) * values.ndim
    if values.dtype.kind == "O":
        values[place] = b"mine"
    else:
        values[place] = 7.5 if np.isnan(values[place]) else values[place] + 1
    return values


def _a_little(values: Any) -> Any:
    """Change the largest number by little more than rounding."""
    sizes = np.abs(np.where(np.isfinite(values), values, 0.0)) if values.dtype.kind == "f" else 0
    if not np.any(sizes):
        raise Same
    values[np.unravel_index(np.argmax(sizes), values.shape)] *= 1 - LITTLE
    return values


def _nothing(values: Any) -> Any:
    if values.dtype.kind != "f":
        raise Same
    return np.full_like(values, np.nan)


def _stored(file: h5py.File, place: str, **how: Any) -> None:
    """Store a column's values in another way."""
    data, about = file[place][()], dict(file[place].attrs)
    kind = _TEXT if data.dtype.kind == "O" else None
    del file[place]
    made = file.create_dataset(place, **{"data": data, "dtype": kind} | how)
    made.attrs.update(about)


def _rows(change: Callable[[Any], Any], file: h5py.File, place: str) -> None:
    before = file[place][()]
    if not before.ndim:
        raise Same
    after = change(before)
    if _alike(before, after):
        raise Same
    _stored(file, place, data=after)


def _typed(numbers: Any, texts: Any, file: h5py.File, place: str) -> None:
    """Store a column as another type; None: there is no such type of numbers, or of texts."""
    data = file[place][()]
    kind = texts if data.dtype.kind == "O" else numbers
    if kind is None:
        raise Same
    if data.dtype.kind == "O" and kind == "S":
        data = data.astype("S")
        kind = None
    _stored(file, place, data=data, dtype=kind)


def _empty(dtype: Any, file: h5py.File, place: str) -> None:
    """Store as many rows of another type, without content."""
    shape = file[place].shape
    about = dict(file[place].attrs)
    del file[place]
    file.create_dataset(place, shape, dtype).attrs.update(about)


def _chunked(file: h5py.File, place: str, **how: Any) -> None:
    if not file[place].size or not file[place].ndim:
        raise Same
    _stored(file, place, chunks=True, **how)


def _grown(file: h5py.File, place: str) -> None:
    shape = file[place].shape
    _chunked(file, place, maxshape=(None,) * len(shape))


def _bomb(file: h5py.File, place: str) -> None:
    if file[place].dtype.kind == "O":
        raise Same
    _stored(file, place, data=np.zeros(HUGE // 8), chunks=(2**16,), compression=9)


def _filled(file: h5py.File, place: str) -> None:
    _stored(file, place, fillvalue="x" if file[place].dtype.kind == "O" else 7)


def _external(file: h5py.File, place: str) -> None:
    shape, kind = file[place].shape, file[place].dtype
    if kind.kind == "O" or not file[place].size:
        raise Same
    about = dict(file[place].attrs)
    del file[place]
    zeros = [("/dev/zero", 0, h5py.h5f.UNLIMITED)]
    file.create_dataset(place, shape, kind, external=zeros).attrs.update(about)


def _virtual(file: h5py.File, place: str) -> None:
    shape, kind = file[place].shape, file[place].dtype
    if not shape:
        raise Same
    about = dict(file[place].attrs)
    del file[place]
    layout = h5py.VirtualLayout(shape, kind)
    layout[:] = h5py.VirtualSource("x.h5", "x", shape, kind)
    file.create_virtual_dataset(place, layout).attrs.update(about)


def _all_texts(text: bytes, file: h5py.File, place: str) -> None:
    data = file[place]
    if data.dtype.kind != "O" or not data.size:
        raise Same
    rows = np.empty(data.shape, dtype=object)
    rows[...] = text
    _stored(file, place, data=rows)


_PAIR = np.dtype([("a", "f8"), ("b", "S400")])
OF_COLUMNS: dict[str, Edit] = {
    "another first value": partial(_values, _first),
    "the largest number 1e-8 less": partial(_values, _a_little),
    "no number any more": partial(_values, _nothing),
    "rows in reverse": partial(_rows, lambda rows: rows[::-1]),
    "one row less": partial(_rows, lambda rows: rows[:-1]),
    "one row twice": partial(_rows, lambda rows: np.concatenate([rows, rows[:1]])),
    "one axis more": partial(_rows, lambda rows: rows[None]),
    "half as many bits, or ASCII": partial(_typed, "f4", h5py.string_dtype("ascii")),
    "the other order of bytes": partial(_typed, ">f8", None),
    "texts of one length": partial(_typed, None, "S"),
    "references": partial(_empty, h5py.ref_dtype),
    "lists of any length": partial(_empty, h5py.vlen_dtype("f8")),
    "opaque bytes": partial(_empty, np.dtype("V100")),
    "pairs": partial(_empty, _PAIR),
    "in pieces": _chunked,
    "in pieces, compressed": partial(_chunked, compression=9),
    "in pieces, may grow": _grown,
    "40 MB of zeros, compressed": _bomb,
    "another value of empty rows": _filled,
    "in another file": _external,
    "virtual": _virtual,
    "texts that are no UTF-8": partial(_all_texts, b"\xff\xfe"),
    "texts of 40 MB": partial(_all_texts, b"x" * HUGE),
    "a scale": lambda file, place: file[place].make_scale("\x1b[31m"),
}


# --- of attributes ---

OF_ATTRIBUTES: dict[str, Callable[[Any, str], object]] = {
    "removed": lambda about, name: about.__delitem__(name),
    "another value": lambda about, name: _another(about, name),
    "another type": lambda about, name: about.create(name, 5, dtype="i4"),
    "a table": lambda about, name: about.create(name, np.zeros((9, 9))),
    "40 MB": lambda about, name: about.create(name, "x" * HUGE),
}


def _another(about: Any, name: str) -> None:
    value = np.array(about[name])
    about.modify(name, "by NIST" if value.dtype.kind in "OU" and not value.ndim else _first(value))


# --- of texts, and of the whole file ---


def _column(change: Callable[[list[bytes]], list[bytes]], file: h5py.File, _: str) -> None:
    texts = list(file["texts"][()])
    about = dict(file["texts"].attrs)
    del file["texts"]
    file.create_dataset("texts", data=change(texts), dtype=_TEXT).attrs.update(about)


def _forged(change: Callable[[dict[str, Any]], object], texts: list[bytes]) -> list[bytes]:
    """Change what the first text states, and seal it again."""
    table = json.loads(texts[0])
    change(table)
    del table["schema"], table["sha256"]
    return [sealed(table), *texts[1:]]


def _faster(table: dict[str, Any]) -> None:
    table["certificate"]["dilation"] = 0.5
    table["certified_duration"] = 0.5


def _proved(file: h5py.File) -> None:
    """Say it in the text, which is not believed, and in the row made from it."""
    _column(partial(_forged, lambda table: table.update(message="proved by NIST")), file, "")
    file["trials/message"][0] = "proved by NIST"


def _late(file: h5py.File, _: str) -> None:
    """Declare 2^40 texts that the file does not hold."""
    del file["texts"]
    plan = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    plan.set_alloc_time(h5py.h5d.ALLOC_TIME_LATE)
    kind = h5py.h5t.py_create(_TEXT, logical=True)
    h5py.h5d.create(file.id, b"texts", kind, h5py.h5s.create_simple((2**40,)), plan)


def _other_certificates(file: h5py.File, _: str) -> None:
    del file["problems"]
    file["trials/certified_duration"][...] = 0.001


OF_TEXTS: dict[str, Edit] = {
    "all rows one text of 20 MB": lambda file, _: forged_results.amplified(
        file, np.random.default_rng(0), Path()
    ),
    "a declared column": _late,
    "one text twice": partial(_column, lambda texts: [*texts, texts[0]]),
    "one text less": partial(_column, lambda texts: texts[1:]),
    "texts in reverse": partial(_column, lambda texts: texts[::-1]),
    "an edited text": partial(_column, lambda t: [t[0].replace(b"seed", b"sead"), *t[1:]]),
    "another verdict, sealed": partial(_column, partial(_forged, _faster)),
    "another message, sealed, and in its row": lambda file, _: _proved(file),
    "another planner's label, sealed": partial(
        _column, partial(_forged, lambda table: table.update(label="exact"))
    ),
    "shorter durations without motions": _other_certificates,
}


# --- all of them ---


class Forgery(NamedTuple):
    """An edit at a place: what is edited, how, where, the change, and what must be named."""

    of: str
    edit: str
    place: str
    change: Callable[[h5py.File], object]
    named: str


def forgeries(file: h5py.File) -> Iterator[Forgery]:
    """Return each edit at each place of a file."""
    places: list[str] = []
    file.visit(places.append)
    for place in places:
        is_group = isinstance(file[place], h5py.Group)
        own = ("group", OF_GROUPS) if is_group else ("column", OF_COLUMNS)
        for of, edits in (("group or column", OF_OBJECTS), own):
            for edit, change in edits.items():
                # from other texts other tables follow: what is named is these
                named = "" if place == "texts" else f"/{place}"
                yield Forgery(of, edit, place, partial(_at, change, place), named)
    for place in ["/", *places]:
        for name in file[place].attrs:
            for edit, change in OF_ATTRIBUTES.items():
                at = partial(_attribute, change, place, name)
                yield Forgery("attribute", edit, f"{place}: {name}", at, place)
    for edit, change in OF_GROUPS.items():
        yield Forgery("group", edit, "/", partial(_at, change, "/"), "/: names")
    for edit, change in OF_TEXTS.items():
        yield Forgery("texts and file", edit, "", partial(_at, change, ""), "")


def _at(change: Edit, place: str, file: h5py.File) -> None:
    change(file, place)


def _attribute(
    change: Callable[[Any, str], object], place: str, name: str, file: h5py.File
) -> None:
    change(file[place].attrs, name)


def attempt(
    content: bytes, forgery: Forgery, path: Path, known: References
) -> dict[str, Any] | None:
    """Forge a file and verify it; None where the edit changes nothing."""
    path.write_bytes(content)
    with h5py.File(path, "r+") as file:
        try:
            forgery.change(file)
        except Same:
            return None
    forged = path.read_bytes()
    path.write_bytes(forged + seal(forged))
    began = time.process_time()
    said = verdict(path, forgery.named, known)
    row = {"of": forgery.of, "edit": forgery.edit, "place": forgery.place}
    return row | {"said": said, "CPU s": time.process_time() - began}


def verdict(path: Path, named: str, known: References) -> str:
    """Return `named`, `refused`, or `held`: what `verify` does with a file."""
    try:
        found = verification(path, known)
    except StoreError:
        return "refused"
    trials = any(not trial.holds for trial in found.trials)
    place = any(named in words for words in found.misstated)
    return "named" if not found.holds and (place or trials) else "held"


def template(folder: Path) -> tuple[bytes, References]:
    """Return the content of an honest file, without its seal, and what is known of its problem."""
    forged_results.template(folder)
    optima = best(read(folder))  # once: each call would check the same proof

    def known(_: Sequence[Trial]) -> Mapping[str, BestMotion]:
        return optima

    content = Store(folder).consolidate(references=known).read_bytes()
    return content[: -len(seal(b""))], known


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per edit: its places, and what became of it there."""
    said = pd.get_dummies(rows["said"]).reindex(columns=["named", "refused", "held"], fill_value=0)
    counted = pd.concat([rows[["of", "edit"]], said.astype(int)], axis=1)
    counted.insert(2, "places", 1)
    found = counted.groupby(["of", "edit"], sort=False).sum()
    found["longest, CPU s"] = rows.groupby(["of", "edit"], sort=False)["CPU s"].max().round(2)
    every = found.sum()
    every["longest, CPU s"] = found["longest, CPU s"].max()
    found.loc[("all", ""), :] = every
    return found.astype(dict.fromkeys(("places", "named", "refused", "held"), int))


def main(output: Path = Path("results/forged-tables"), *, quick: bool = False) -> None:
    """Forge each place in each way, and print the table."""
    work = Path(tempfile.mkdtemp(prefix="forged-"))
    rows = []
    try:
        content, known = template(work / "results")
        honest = work / "honest.h5"
        honest.write_bytes(content + seal(content))
        assert verdict(honest, "", known) == "held"
        with h5py.File(honest) as file:
            every = list(forgeries(file))[:: QUICK if quick else 1]
        with progress(len(every), "forgeries") as advance:
            for forgery in every:
                with suppress(Same):
                    row = attempt(content, forgery, work / "forged.h5", known)
                    rows += [row] if row else []
                advance(1)
    finally:
        shutil.rmtree(work)
    found = pd.DataFrame(rows)
    counts = table(found)
    save_table(counts, output / "forged-tables")
    print(counts.to_string())
    held = found[found["said"] == "held"]
    for _, row in held.iterrows():
        print(f"held: {row['edit']}: {row['place']}")
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    print(f"{len(found) - len(held)} of {len(found)} forgeries named or refused; {peak:.0f} MB")
    if len(held):
        sys.exit(1)
