"""Can a proof be forged? Records whose stored proof claims three times the best known duration.

    python tests/soak.py forgeries             # 585 forgeries, a few seconds
    python tests/soak.py forgeries --quick     # 59
    python tests/soak.py forgeries --script    # a minute: check_proof.py as a process too

Each is an honest record whose proof was changed or replaced, such that an error of rounding, of
units or of reading might accept it. Its file is sealed, as anyone could submit it. *Proved* is the
bound that the check returns, in percent above the best known duration: more than 0 is a false
bound. A refused record proves nothing; *refused* has the reason. Exit code 1 if a forgery is
accepted.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any

import numpy as np
import pandas as pd

from experiments.common.output import say
from soaks import soak_report
from soaks.forged_results import resealed
from trajopt.benchmark.best_known import records
from trajopt.benchmark.store.proofs import proved
from trajopt.benchmark.suites import catalogue
from trajopt.core.exceptions import TrajoptError

Said = dict[str, Any]
Named = tuple[str, Said]

PROBLEMS = ("six-axis", "jerk-limit", "position-limits")
"""Velocity and acceleration limits; jerk limits too; position limits too."""

CLAIMED = 3.0
"""Of the best known duration: what each forgery asks to be believed."""

_FILE = tomllib.loads((soak_report.DATA / "forgeries.toml").read_text(encoding="utf-8"))
FAMILIES = _FILE["families"]
ATTACKS = _FILE["attacks"]
_LEAF = [3, 0, 0, 0]
# Values that a proof's numbers must not have, in JSON.
_NO_NUMBERS = f"NaN Infinity -Infinity 1e999 1{400 * '0'} true null 1e308 5e-324 -1"
# Text that stands in the file as it is: JSON cannot say it otherwise.
_RAW = "raw:"
# A key that stands in the file once more.
_AGAIN = "again:"
_TWICE = (
    "solution.lower_bound solution.trajectory solution.status certificate.duration problem.limits"
)
_PROOF = "proof_"


@dataclass(frozen=True)
class Forgery:
    """A record's text with a forged proof.

    Attributes:
        family: How it is forged.
        name: What was forged, and of which problem.
        text: Of the file.
        duration: Of the best known motion, s: a bound above it is false.
    """

    family: str
    name: str
    text: str
    duration: float


def forgeries(problem: str) -> list[Forgery]:
    """Return every forgery of every family, of one built-in problem's record."""
    honest = record(problem)
    found = []
    for family, title in FAMILIES.items():
        own = [*listed(family, honest), *listed_changes(family, honest)]
        if family in FURTHER:
            own += FURTHER[family](honest)
        for name, said in own:
            forged = Forgery(
                family=title,
                name=f"{problem}: {name}",
                text=text(said),
                duration=honest["certificate"]["duration"],
            )
            found.append(forged)
    return found


def record(problem: str) -> Said:
    """Read what a built-in problem's record states, with its proof's tables by their names."""
    file = records.file_of(catalogue.load(problem))
    assert file is not None
    said: Said = json.loads(file.read_text(encoding="utf-8"))
    stats = said["solution"].pop("stats")
    proof = {name.removeprefix(_PROOF): array["$array"] for name, array in stats.items()}
    return said | {"proof": proof}


def text(said: Said) -> str:
    """Return the record as a sealed text; a value may be one that JSON does not have."""
    stats = {}
    for name, rows in said["proof"].items():
        shape = np.array(rows, dtype=object).shape
        stats[_PROOF + name] = {"$array": rows, "dtype": "<f8", "shape": shape}
    stated = said | {"solution": said["solution"] | {"stats": stats}}
    del stated["proof"]
    plain = re.sub(f'"{_RAW}([^"]*)"', r"\1", json.dumps(stated, indent=0))
    return resealed(plain.replace(_AGAIN, "").encode()).decode()


# --- building blocks ---


def changed(honest: Said, **tables: Any) -> Said:
    """Return the honest proof with other tables, claimed for three times the best duration."""
    said = deepcopy(honest)
    cutoff = CLAIMED * said["certificate"]["duration"]
    said["solution"]["lower_bound"] = cutoff
    said["proof"]["cutoff"] = [cutoff]
    said["proof"].update(tables)
    return said


def one_leaf(honest: Said, **tables: Any) -> Said:
    """Return a proof of one leaf without inequalities, with other tables."""
    said = changed(honest)
    proof = said["proof"]
    for name in proof.keys() - {"units", "cutoff"}:
        proof[name] = []
    proof["steps"] = [_LEAF]
    proof.update(tables)
    return said


def one_row(
    honest: Said, cells: Sequence[Any], multiplier: float, time_unit: float, length_unit: float
) -> Said:
    """Return a leaf with one inequality of costates, of the largest upward displacement."""
    places = np.array(honest["problem"]["waypoints"])
    ways = np.diff(places, axis=0)
    ways = ways[:, np.ptp(places, axis=0) > 0]
    segment, joint = divmod(int(ways.argmax()), ways.shape[1])
    return one_leaf(
        honest,
        units=[time_unit, *[length_unit] * ways.shape[1]],
        cuts=[[segment, joint, len(cells)]],
        cells=cells,
        steps=[[3, 0, 0, 1]],
        multipliers=[[_box_rows(honest, *ways.shape), multiplier]],
    )


def _box_rows(honest: Said, segments: int, joints: int) -> int:
    """Return the number of inequalities of a box: cut-off, secants, and McCormick's."""
    jerky = joints if "jerk" in honest["problem"]["limits"] else 0
    return 1 + 2 * segments + 8 * (segments - 1) * jerky


def with_first(honest: Said, table: str, column: int, value: Any) -> Said:
    """Return a table whose first row has another number."""
    said = changed(honest)
    said["proof"][table][0][column] = value
    return said


def listed(family: str, honest: Said) -> Iterator[Named]:
    """Return the forgeries of one inequality that the file lists."""
    time_unit = honest["proof"]["units"][0]
    for own, name, said, multiplier, exponent in _lines(ATTACKS["one_rows"]):
        if own == family:
            length_unit = 2.0 ** int(exponent)
            cells = _cells(said)
            yield name, one_row(honest, cells, float(multiplier), time_unit, length_unit)


def _cells(said: str) -> list[list[float]]:
    """Return costate cells from JSON, or from "thirds λ p q"."""
    if not said.startswith("thirds"):
        rows: list[list[float]] = json.loads(said)
        return rows
    slope, p, q = map(float, said.split()[1:])
    return [[start, p, 0, 0, q, 0, slope] for start in (0, 0.34, 0.67)]


def operated(rows: Any, operation: str, *numbers: float) -> Any:
    """Return a table after one of the operations that the file lists."""
    table = np.array(rows, dtype=float)
    column, value = numbers or (0, 0.0)
    match operation:
        case "set":
            table[..., int(column) :] = value
        case "times":
            table[..., int(column) :] *= value
        case "first":
            table.flat[int(column)] *= value
        case "reversed":
            table = table[::-1]
        case "rolled":
            table = np.roll(table, -1, axis=0)
        case "half":
            table = table[: len(table) // 2]
        case "longer":
            table = np.concatenate([table, table[-1:]])
        case "shorter":
            table = table[:-1]
    return table.tolist()


def one_change(honest: Said, table: str, operation: str) -> Said:
    """Return the proof with a table after an operation, as the file writes it."""
    word, *numbers = operation.split()
    said = changed(honest)
    said["proof"][table] = operated(said["proof"][table], word, *map(float, numbers))
    return said


def listed_changes(family: str, honest: Said) -> Iterator[Named]:
    """Return the forgeries of one table that the file lists."""
    for own, name, table, operation in _lines(ATTACKS["changes"]):
        if own == family:
            yield name, one_change(honest, table, operation)


# --- forgeries that are not in the tables ---


def no_numbers(honest: Said) -> Iterator[Named]:
    for number in _NO_NUMBERS.split():
        raw = _RAW + number
        short = number[:12]
        step = [0, 0, raw, 0]
        yield f"{short} as a multiplier", with_first(honest, "multipliers", 1, raw)
        yield f"{short} in a cell", with_first(honest, "cells", 6, raw)
        yield f"{short} as the cut-off", changed(honest, cutoff=[raw])
        yield f"a step to {short}", one_leaf(honest, steps=[step, _LEAF])


def powers_of_two(honest: Said) -> Iterator[Named]:
    for line in ATTACKS["units"].splitlines():
        time, length = map(int, line.split())
        units = [2.0**length for _ in honest["proof"]["units"]]
        units[0] = 2.0**time
        name = f"units of 2^{time} s and 2^{length} rad"
        yield name, one_leaf(honest, units=units)
        yield f"{name}, the honest rows", changed(honest, units=units)


def sums(honest: Said) -> Iterator[Named]:
    t, *lengths = honest["proof"]["units"]
    steps = [[start, 0, 0, 0, 0, 0, 1] for start in np.linspace(0, 1, 20_001)[:-1].tolist()]
    yield "20,000 cells", one_row(honest, steps, 1.0, t, 1.0)
    for cell in steps[::2]:
        cell[4] = 1e17
    yield "20,000 jumps of 1e17", one_row(honest, steps, 1.0, t, 1.0)
    rows = honest["proof"]["multipliers"]
    both = [[row, y * size] for row, y in rows for size in (1e17, -1e17)]
    yield "multipliers of both signs", _one_step(honest, both)
    secants = [[row, 1e30] for row in range(_box_rows(honest, 3, len(lengths)))]
    yield "every row of the box 1e30 times", _one_step(honest, secants)
    yield "every row a hundred times", _one_step(honest, 100 * rows)


def _one_step(honest: Said, multipliers: Sequence[Sequence[float]]) -> Said:
    leaf = [3, 0, 0, len(multipliers)]
    return changed(honest, steps=[leaf], multipliers=multipliers)


def trees(honest: Said) -> Iterator[Named]:
    for name, *steps in _lines(ATTACKS["steps"]):
        numbers = [[float(number) for number in step.split()] for step in steps]
        yield name, one_leaf(honest, steps=numbers)


def odd_rows(honest: Said) -> Iterator[Named]:
    for table, column, values in _lines(ATTACKS["first_rows"]):
        for value in values.split():
            name = f"{table} that begin with {value} in column {column}"
            yield name, with_first(honest, table, int(column), float(value))
    for name, table, rows in _lines(ATTACKS["tables"]):
        yield f"{table}: {name}", changed(honest, **{table: json.loads(rows)})
    numbers, values = np.transpose(honest["proof"]["multipliers"])
    moved = np.transpose([np.roll(numbers, 1), 1e3 * values]).tolist()
    yield "multipliers of other rows", changed(honest, multipliers=moved)


def _lines(table: str) -> Iterator[list[str]]:
    """Return a table's lines, column by column."""
    for line in table.strip().splitlines():
        yield [column.strip() for column in line.split("|")]


def short_tables(honest: Said) -> Iterator[Named]:
    for table in ("cells", "cuts", "tangents", "multipliers", "steps", "units"):
        yield f"{table} cut in half", one_change(honest, table, "half")
        yield f"{table} with a row too many", one_change(honest, table, "longer")
        without = changed(honest)
        del without["proof"][table]
        yield f"no {table}", without
    first, *others = honest["proof"]["cells"]
    yield "rows of other lengths", changed(honest, cells=[first[:3], *others])
    yield "cells in one row", changed(honest, cells=np.ravel([first, *others]).tolist())
    yield "no proof", changed(honest) | {"proof": {}}
    closed = changed(honest) | {"proof": {}}
    closed["options"]["bound"]["method"] = "closed form"
    yield "a bound in closed form that is none", closed


def keys_twice(honest: Said) -> Iterator[Named]:
    for key in _TWICE.split():
        part, name = key.split(".")
        said = changed(honest)
        said[part][_AGAIN + name] = said[part][name]
        yield f"{key} twice", said
    for name in ("multipliers", "units", "cells"):
        units = [2.0**-1022 for _ in honest["proof"]["units"]]
        units[0] = 2.0**30
        said = one_leaf(honest, units=units)
        said["proof"][_AGAIN + name] = said["proof"][name]
        yield f"{name} twice", said


def others(honest: Said) -> Iterator[Named]:
    for name in (*PROBLEMS, "seven-waypoints", "reversal"):
        other = record(name)
        if other["problem"]["name"] != honest["problem"]["name"] and other["proof"]:
            yield f"the proof of {name}", changed(honest, **other["proof"])
    slow = changed(honest)
    for pairs in slow["problem"]["limits"].values():
        pairs[:] = [[low and low / 9, high and high / 9] for low, high in pairs]
    yield "limits of a slower robot under the same digest", slow
    long = changed(honest)
    waypoints = np.array(long["problem"]["waypoints"])
    long["problem"]["waypoints"] = (9 * waypoints).tolist()
    yield "a longer way under the same digest", long


FURTHER: dict[str, Callable[[Said], Iterator[Named]]] = {
    "too_large": no_numbers,
    "other_units": powers_of_two,
    "cancelling": sums,
    "boxes": trees,
    "rows": odd_rows,
    "truncated": short_tables,
    "twice": keys_twice,
    "other_problems": others,
}


# --- the check ---

SCRIPT = Path(__file__).parents[2] / "docs" / "examples" / "best-known" / "check_proof.py"
BELIEVED_ABOVE = 1e-9  # relative to the best known duration


def believed(content: str) -> float:
    """Return the bound that a record's file proves, s.

    Raises:
        TrajoptError: The file is refused.
    """
    with NamedTemporaryFile("w", suffix=".json", encoding="utf-8") as file:
        file.write(content)
        file.flush()
        return proved(records.read(Path(file.name)).trial)


def judged(forgery: Forgery) -> dict[str, object]:
    """Check a forgery: percent above the best known duration, or the reason of refusal."""
    bound = None
    refused = ""
    try:
        bound = believed(forgery.text)
    except TrajoptError as error:
        refused = str(error)
    above = None if bound is None else 100 * (bound / forgery.duration - 1)
    return {
        "family": forgery.family,
        "forgery": forgery.name,
        "proved %": above,
        "refused": refused,
    }


def confirmed(forgery: Forgery) -> bool:
    """Return whether `check_proof.py` believes a forgery."""
    command = [sys.executable, "-I", str(SCRIPT)]
    ran = subprocess.run(command, input=forgery.text, text=True, capture_output=True, check=False)
    return ran.returncode == 0


def main(
    *, script: bool = False, output: Path = Path("results/forgeries"), quick: bool = False
) -> None:
    """Check every forgery, write the table and print it.

    Args:
        script: Ask docs/examples/best-known/check_proof.py too.
        output: Folder of the table.
        quick: One forgery in ten.
    """
    attempts = [forgery for problem in PROBLEMS for forgery in forgeries(problem)]
    if quick:
        attempts = attempts[::10]
    say(f"{len(attempts)} forgeries in all")
    rows = pd.DataFrame([judged(forgery) for forgery in attempts])
    refused = rows["refused"] != ""
    print(refused.groupby(rows["family"], sort=False).sum().to_string())
    false = rows["proved %"] > 100 * BELIEVED_ABOVE
    if script:
        false |= pd.Series([confirmed(forgery) for forgery in attempts])
    soak_report.conclude(rows, false, output / "forgeries")
