"""Can a crafted or damaged file crash a command, or pass as a good one?

    python tests/soak.py hostile_inputs            # 2000 mutated and 600 crafted, 2 min
    python tests/soak.py hostile_inputs --quick    # 200 and 60

Mutated files are shipped files of every format, with changed bits, spans, blocks, lines, numbers or
keys. Crafted files are such that every reader has to refuse them. Every fifth is a results file
(`forged_results`), the others are text (`hostile_texts`). Each is read in a child process by the
command that a user would type. The promise: no traceback, one line of error of at most 1500
characters, no escape sequence, at most 10 s of CPU and 500 MB, and no invalid file accepted. (All
crafted files are refused. In mutated files that were accepted, other parsers find no unknown key,
no key twice, and only plain decimals for numbers.) Exit code 1 if the promise is broken. Needs
Linux.
"""

from __future__ import annotations

import sys
import tempfile
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pebble import ProcessExpired

from experiments.common.kept import apart
from experiments.common.output import progress, save_table
from soaks import forged_results, hostile_texts, said

WALL_S = 120.0  # for 10 s of CPU on a machine with other work
STORED_EVERY = 5  # files
REPORT_EVERY = 10  # stored files
WORKERS = 2
FILES_PER_WORKER = 100
REFUSED = 2  # exit code


@cache
def _template() -> tuple[Path, pd.DataFrame]:
    """Return a results folder, made once in each process, and its true numbers."""
    folder = forged_results.template(Path(tempfile.mkdtemp(prefix="hostile-")))
    return folder, forged_results.true_numbers(folder)


def one(seed: int, mutated: bool) -> dict[str, Any]:
    """A row of the table: one file, the outcome of reading it, and the faults."""
    rng = np.random.default_rng([seed, mutated])
    with tempfile.TemporaryDirectory() as work:
        if seed % STORED_EVERY == 0:
            return stored(Path(work), seed // STORED_EVERY, rng, mutated)
        return text(Path(work), rng, mutated)


def text(work: Path, rng: np.random.Generator, mutated: bool) -> dict[str, Any]:
    """Return the row of one text file."""
    names = sorted(hostile_texts.formats())
    name = names[int(rng.integers(len(names)))]
    kind = hostile_texts.formats()[name]
    if mutated:
        content = hostile_texts.mutated(kind, rng)
    else:
        content = hostile_texts.crafted(kind.ending, rng)
    path = work / f"input{kind.ending}"
    path.write_bytes(content)
    answer = said.by(kind.command(path))
    faults = answer.faults()
    refused = answer.code == REFUSED
    if not refused and not answer.trace:
        took = hostile_texts.nonsense(kind, content) if mutated else "took a crafted file"
        faults += [took] if took else []
    return {
        "format": name,
        "outcome": "refused" if refused else "read",
        "seconds": answer.seconds,
        "megabytes": answer.megabytes,
        "faults": "; ".join(faults),
    }


def stored(work: Path, number: int, rng: np.random.Generator, mutated: bool) -> dict[str, Any]:
    """Return the row of one results file."""
    folder, numbers = _template()
    crafts = forged_results.CRAFTS
    if mutated:
        path = forged_results.corrupted(folder, work, rng)
    else:
        path = forged_results.crafted(folder, work, crafts[number % len(crafts)], rng)
    faults = forged_results.faults(
        path, expected=numbers if mutated else None, report=number % REPORT_EVERY == 0
    )
    return {"format": "results, HDF5", "outcome": "read or refused", "faults": "; ".join(faults)}


def table(mutations: int, crafts: int, first: int) -> pd.DataFrame:
    """Yield a row for each file from seed `first` on; a process that dies or hangs is a fault."""
    asked = [(first + number, True) for number in range(mutations)]
    asked += [(first + number, False) for number in range(crafts)]
    # results files last: what HDF5 leaves in a process would count as memory of the next text
    asked.sort(key=lambda own: own[0] % STORED_EVERY == 0)
    answers = apart(
        [partial(one, *own) for own in asked],
        lost=lost,
        workers=WORKERS,
        timeout=WALL_S,
        start="fork",
        cells_per_worker=FILES_PER_WORKER,
    )
    rows = []
    with progress(len(asked)) as advance:
        for (seed, mutated), answer in zip(asked, answers, strict=True):
            rows.append({"seed": seed, "made": "mutated" if mutated else "crafted", **answer})
            advance(1)
    return pd.DataFrame(rows)


def lost(error: BaseException) -> dict[str, Any]:
    """Return the row of a file whose reader was killed or hung; any other error is raised."""
    if isinstance(error, TimeoutError):
        return {"format": "unknown", "outcome": "hang", "faults": f"more than {WALL_S:g} s"}
    if isinstance(error, ProcessExpired):
        return {"format": "unknown", "outcome": "killed", "faults": str(error)}
    raise error


def main(
    *,
    output: Path = Path("experiments-output/hostile-inputs"),
    mutations: int = 2000,
    crafts: int = 600,
    first: int = 0,
    quick: bool = False,
) -> None:
    """Mutate and craft files from a first seed on, read them, and count the faults."""
    if quick:
        mutations = 200
        crafts = 60
    hostile_texts.formats()
    found = table(mutations, crafts, first)
    found["faulty"] = found["faults"] != ""
    for row in found[found["faulty"]].to_dict("records"):
        print(row)
    save_table(found, output / "hostile-inputs")
    summary = found.groupby(["made", "format", "outcome"]).agg(
        files=("seed", "size"),
        seconds=("seconds", "max"),
        megabytes=("megabytes", "max"),
        faulty=("faulty", "sum"),
    )
    print(summary.round(1).to_string())
    sys.exit(int(found["faulty"].any()))
