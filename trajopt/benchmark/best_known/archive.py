"""One archive of all problems, best known motions and proofs, for people without this package.

    archive.write(Path("mintime-data.zip"))

It holds the records as they are, the problems as TOML files, an index, a data card, a citation,
checksums, and two scripts of the standard library: `check_proof.py` checks one bound in exact
fractions, `check_all.py` the checksums and every bound. The same records give the same bytes.
"""

from __future__ import annotations

import csv
import hashlib
import io
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path

import trajopt
from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import CLOSED_WITHIN, Record
from trajopt.benchmark.store import atomic
from trajopt.benchmark.suites import catalogue, robots
from trajopt.core import built_in
from trajopt.core.exceptions import InvalidInput
from trajopt.judging import check_proof

KERNEL = Path(check_proof.__file__)
CHECK_ALL = "check_all.py"
SUMS = "SHA256SUMS"
# ZIP's own first date: the archive has none, so that it depends on its content alone.
_NO_DATE = (1980, 1, 1, 0, 0, 0)
_READABLE = 0o644 << 16  # for all, also where it was made with another mask


def write(file: Path, where: Path | None = None) -> int:
    """Write the archive of a folder of records; return how many there are.

    Args:
        file: The archive, `.zip`; all lies in a folder of its name.
        where: The folder of records; by default the package's.

    Raises:
        InvalidInput: The name does not end in `.zip`, or there are no records.
        OSError: The archive cannot be written.
    """
    if file.suffix != ".zip":
        raise InvalidInput("ARCHIVE", "a name that ends in .zip", value=str(file))
    found = [records.read(own) for own in records.files(where)]
    if not found:
        right = "a folder of records"
        raise InvalidInput("--registry", right, value=str(where or records.folder()))
    contents = _contents(found, where)
    contents[SUMS] = "".join(
        f"{hashlib.sha256(content).hexdigest()}  {name}\n" for name, content in contents.items()
    ).encode()
    atomic.write(file, _zipped(contents, file.stem))
    return len(found)


def _contents(found: Sequence[Record], where: Path | None) -> dict[str, bytes]:
    """Return the archive's files by name, but for the checksums."""
    contents = {"README.md": _card(found).encode(), "CITATION.cff": _citation(found).encode()}
    for script in (KERNEL, _check_all()):
        contents[script.name] = script.read_bytes()
    contents["index.csv"] = _index(found).encode()
    for record in found:
        file = records.file_of(record.problem, where)
        assert file is not None
        contents[f"records/{record.file_name}"] = file.read_bytes()
        contents[f"problems/{_stem(record)}.toml"] = record.problem.to_toml().encode()
    return dict(sorted(contents.items()))


def _zipped(contents: Mapping[str, bytes], folder: str) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as archive:
        for name, content in contents.items():
            member = zipfile.ZipInfo(f"{folder}/{name}", _NO_DATE)
            member.compress_type = zipfile.ZIP_DEFLATED
            member.external_attr = _READABLE
            archive.writestr(member, content)
    return packed.getvalue()


def _check_all() -> Path:
    """Return the script: in the installed package, or among the examples of a checkout."""
    folder = built_in.data_folder()
    if not built_in.is_installed():
        folder = folder.parent / "docs" / "examples" / "best-known"
    return folder / CHECK_ALL


def _stem(record: Record) -> str:
    return record.file_name.removesuffix(".json")


def _index(found: Sequence[Record]) -> str:
    suites = {digest: listed.suite for digest, listed in catalogue.every_problem().items()}
    table = io.StringIO()
    rows = csv.writer(table, lineterminator="\n")
    head = ("problem", "suite", "joints", "waypoints", "limits", "duration_s", "lower_bound_s")
    rows.writerow((*head, "status", "record"))
    for record in found:
        problem = record.problem
        rows.writerow(
            (
                problem.name,
                suites.get(problem.digest(), ""),
                problem.joints,
                len(problem.waypoints),
                " ".join([*problem.limits.kinds, *problem.demands]),
                repr(record.duration),
                repr(record.lower_bound),
                "closed" if record.closed else "open",
                f"records/{record.file_name}",
            )
        )
    return table.getvalue()


def _newest(found: Sequence[Record]) -> str:
    return max(origin.date for record in found for origin in (record.motion, record.bound))


def _citation(found: Sequence[Record]) -> str:
    return (
        "cff-version: 1.2.0\n"
        'title: "mintime data: minimum-time robot motions with proved lower bounds"\n'
        'message: "If you use these data, please cite them with their version and SHA256SUMS."\n'
        "type: dataset\n"
        "authors:\n"
        '  - name: "The mintime authors"\n'
        f"version: {trajopt.__version__}\n"
        f"date-released: {_newest(found)}\n"
        "license: MIT\n"
    )


def _card(found: Sequence[Record]) -> str:
    """Return the data card: what it is, where it comes from, its limits, how to check and cite."""
    closed = sum(record.closed for record in found)
    sizes = [(record.problem.joints, len(record.problem.waypoints)) for record in found]
    joints, waypoints = zip(*sizes, strict=True)
    return f"""\
# Minimum-time robot motions with proved lower bounds

{len(found)} problems of {min(joints)} to {max(joints)} joints and {min(waypoints)} to \
{max(waypoints)} waypoints: pass these
points within these limits of velocity, acceleration, jerk or position (some of the tool's speed or
of torques), as fast as you can. For each there is the shortest motion that anyone has found, and a
lower bound that no motion beats, with its
proof. {closed} are closed: both are less than {100 * CLOSED_WITHIN:g} % apart. The other \
{len(found) - closed} are open.

Version {trajopt.__version__}; the newest record is of {_newest(found)}.

## Files

- `index.csv`: a row for each problem; durations and lower bounds in s.
- `records/*.json`: problem, motion, bound and proof in one text with its SHA-256; SI units.
- `problems/*.toml`: the problems alone, for a planner of yours.
- `check_all.py`, `check_proof.py`: they confirm every bound, with Python's standard library only.
- `SHA256SUMS`: of every other file. `CITATION.cff`: how to cite.

A motion is polynomials joint by joint; a piece is its start and its coefficients, highest power
first. A proof is a tree of boxes of segment times with multipliers of linear inequalities that
every motion satisfies; where there is none, the bound is the time of a single joint in closed form.

## Check

    python check_all.py            # minutes; every bound in exact fractions, and the checksums
    python check_proof.py < records/NAME.json

Bounds need no trust: a forged proof proves less. That a motion keeps its limits is checked by
`trajopt best-known verify --registry records` of the package mintime.

## Where it comes from

Problems: degenerate ones, {len(robots.SUITE_ARMS)} real arms with limits from data sheets, random
families drawn from seeds, published papers, and the test suites of toppra, Ruckig and MoveIt;
`source` in each record says which. Motions and bounds are computed by mintime, or sent in;
`options` in each record names method, version, date and submitter.

## Limits

No obstacles. Bounds leave torques out. Motions are exact polynomials, not tested on robots. A lower
bound is proved for the stated numbers, read as exact binary fractions. Open problems are no
sample of hard ones: they are those that our proofs do not close.

## License and citation

MIT. Cite `CITATION.cff` with the SHA-256 of `SHA256SUMS`.
"""
