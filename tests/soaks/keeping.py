"""What does it cost to keep results, and to read them? CPU time and memory, by number of trials.

    python tests/soak.py keeping                        # about half an hour
    python tests/soak.py keeping --before CHECKOUT      # beside an older version's sources
    python tests/soak.py keeping --quick                # a few trials

Real trials of three kinds are kept again and again under new seeds: of three pieces, of the
six-axis problem (95 of eight planners), and of motions of 1,660 pieces of 8 joints. Each
measurement is a process of its own. *judging* is what a judge does beside its verdict: the trial's
text, and its row; judges work side by side. *keeping* is what the run does with each message of a
judge, and
*results.h5* its share of writing that once. Then one trial is added to many. Last, `export`,
`report` and `diff` read folders; the exponent is that of their times between two numbers of trials,
from an empty command's time on (1: linear). Files are in memory (`/dev/shm`), where there is such a
place, so that no disk is measured. Tables go to `--output`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from itertools import product
from math import log
from pathlib import Path
from shutil import rmtree
from typing import Any, NamedTuple

import pandas as pd

from experiments.common.output import save_table, say

SOURCES = Path(__file__).parents[2]
MEMORY = Path("/dev/shm")
NEW = 1000  # trials that are kept at once
ROUNDS = 3  # of which the least counts
LONG = "random-unequal-j8-w50-jerk-11"
_MB = 1024.0  # ru_maxrss is in kB

# It runs in older versions too: all that is used of them exists since 0.3.
_PROGRAM = """
import json, pickle, sys, time
from dataclasses import replace
from pathlib import Path

from trajopt.benchmark.store import trial_text
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.trial import verdict
from trajopt.views.analysis import gap_reference

base, folder, first, count = sys.argv[1:]
references = getattr(gap_reference, "best", None) or gap_reference.durations
stated = [trial_text.read(path.read_bytes()) for path in sorted(Path(base).glob("trials/*.json"))]
trials = [replace(own, certificate=verdict(own.problem, own.solution)[2]) for own in stated]
fresh = [
    replace(trials[number % len(trials)], seed=number)
    for number in range(int(first), int(first) + int(count))
]
store = Store(Path(folder))
spent = {}


def timed(name, call, *arguments, **keywords):
    began = time.process_time()
    found = call(*arguments, **keywords)
    spent[name] = spent.get(name, 0.0) + time.process_time() - began
    return found


try:
    seen = timed("seen", store.seen, {own.id for own in fresh})
except TypeError:
    seen = timed("seen", store.seen)
for one in fresh:
    written = timed("judging", store.write_all, [one])
    message = timed("judging", pickle.dumps, written)
    sent = timed("keeping", pickle.loads, message)
    if hasattr(seen, "judge_trials"):
        timed("keeping", seen.add, sent)
    else:
        timed("keeping", seen.add, sent, trusted=True)
if hasattr(seen, "judge_trials"):
    timed("keeping", seen.judge_trials, trusted=True)
timed("results.h5", store.consolidate, seen, references)
print(json.dumps(spent | {"MB": store.results.stat().st_size / 1e6}))
"""


_COMPARED = """
import sys

from trajopt import compare
from trajopt.benchmark.suites import catalogue

folder, name, seeds, *planners = sys.argv[1:]
problems = {own.name: own for _, own in catalogue.every_problem().values()}
compare(problems.get(name) or catalogue.load(name), planners, folder, seeds=int(seeds))
"""


class Kind(NamedTuple):
    """Trials to keep: of a problem, by these planners."""

    problem: str
    planners: Sequence[str]
    seeds: int = 3
    together: int = 1000  # trials that are kept at once


ONCE = ("toppra", "ruckig-search", "ruckig-stop", "spline353-nlp", "unoptimised")
KINDS = {
    "3 pieces, 1 joint": Kind("one-joint", ("unoptimised", "ruckig-stop", "pso:iterations=20")),
    "six-axis": Kind("six-axis", (*ONCE, "pso", "ssa", "issa"), 30),
    "1,660 pieces, 8 joints": Kind(LONG, ("ruckig-stop",), 1, 200),
}


def based(kind: Kind, folder: Path, sources: Path) -> Path:
    """Compare the planners of a kind, by these sources; return the folder."""
    arguments = [str(folder), kind.problem, str(kind.seeds), *kind.planners]
    measured(["-c", _COMPARED, *arguments], sources, folder.parent)
    return folder


class Used(NamedTuple):
    """What a process took: CPU s, its largest memory in MB, and what it printed."""

    seconds: float
    memory: float
    out: str


def measured(command: Sequence[str], sources: Path, folder: Path) -> Used:
    """Run a command of some sources' version to its end.

    Raises:
        RuntimeError: It failed.
    """
    own = {"PYTHONPATH": str(sources), "XDG_CACHE_HOME": str(folder), "OMP_NUM_THREADS": "1"}
    errors = folder / "errors"
    with errors.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-P", *command],
            stdout=subprocess.PIPE,
            stderr=stream,
            text=True,
            env=os.environ | own,
            cwd=folder,
        )
        assert process.stdout is not None
        out = process.stdout.read()
        _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    process.stdout.close()
    if process.returncode != 0:
        raise RuntimeError(f"{command[-1]}: {errors.read_text()[-2000:]}")
    return Used(used.ru_utime + used.ru_stime, used.ru_maxrss / _MB, out)


def added(base: Path, folder: Path, first: int, count: int, sources: Path) -> dict[str, float]:
    """Keep so many trials more in a folder; return the CPU s of each part, and sizes in MB."""
    arguments = [str(base), str(folder), str(first), str(count)]
    used = measured(["-c", _PROGRAM, *arguments], sources, folder.parent)
    found: dict[str, float] = json.loads(used.out)
    return found | {"peak": used.memory}


def per_trial(base: Path, work: Path, count: int, sources: Path) -> dict[str, float]:
    """Return the CPU ms that a trial takes of so many that are kept at once."""
    spent = added(base, work / "kept", 0, count, sources)
    return {name: 1e3 * spent[name] / count for name in ("judging", "keeping", "results.h5")}


def one_more(
    base: Path, folder: Path, sizes: Sequence[int], sources: Path
) -> Iterator[dict[str, float]]:
    """Fill a folder up to each number of trials, then measure one more."""
    there = 0
    idle = measured(["-c", "import trajopt.benchmark.store.folder"], sources, folder.parent).memory
    for size in sizes:
        while there < size:
            count = min(NEW, size - there)
            added(base, folder, there, count, sources)
            there += count
        spent = added(base, folder, there, 1, sources)
        there += 1
        parts = ("seen", "keeping", "results.h5")
        yield {
            "trials": size,
            "one more, CPU s": sum(spent[part] for part in parts),
            "file, MB": spent["MB"],
            "peak / file": (spent["peak"] - idle) / spent["MB"],
        }


def commands(base: Path, folder: Path, sizes: Sequence[int]) -> Iterator[dict[str, Any]]:
    """Measure what reads a folder, by number of trials."""
    there = 0
    known: dict[str, tuple[int, float]] = {}
    empty = measured(["-m", "trajopt.cli", "--help"], SOURCES, folder.parent).seconds
    for size in sizes:
        while there < size:
            count = min(NEW, size - there)
            added(base, folder, there, count, SOURCES)
            there += count
        results = str(folder)
        asked = {
            "export": ["export", results, "--to", "csv", "--out", "trials.csv"],
            "report": ["report", results, "--out", "report.html"],
            "diff": ["diff", results, str(folder / "results.h5")],
        }
        for name, words in asked.items():
            for file in ("trials.csv", "report.html"):
                (folder.parent / file).unlink(missing_ok=True)
            used = measured(["-m", "trajopt.cli", *words], SOURCES, folder.parent)
            own = max(1e-3, used.seconds - empty)
            before = known.get(name)
            power = log(own / before[1]) / log(size / before[0]) if before else float("nan")
            known[name] = size, own
            yield {
                "command": name,
                "trials": size,
                "CPU s": used.seconds,
                "ms a trial": 1e3 * own / size,
                "peak, MB": used.memory,
                "exponent": power,
            }
            say(f"{name} of {size} trials: {used.seconds:.1f} s")


def main(
    sizes: tuple[int, ...] = (1000, 5000, 20000),
    read: tuple[int, ...] = (2000, 5000, 20000),
    before: Path | None = None,
    output: Path = Path("results/keeping"),
    *,
    quick: bool = False,
) -> None:
    """Measure, and print three tables.

    Args:
        sizes: Numbers of six-axis trials to which one is added.
        read: Numbers of trials of three pieces that commands read.
        before: Sources of an older version, measured beside this one, up to 5,000 trials.
    """
    count = NEW
    if quick:
        sizes, read, count = (20, 40), (20, 40), 20
    versions = {"now": SOURCES} | ({"before": before.absolute()} if before else {})
    with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as place:
        work = Path(place)
        say("comparing, for trials to keep")
        bases = {}
        for version, sources in versions.items():
            (work / version).mkdir()
            for number, (name, kind) in enumerate(KINDS.items()):
                folder = work / version / str(number)
                bases[name, version] = based(kind, folder, sources)
        print(_costs(bases, versions, count, work, output).to_string(float_format="{:.2f}".format))
        print(_more(bases, versions, sizes, work, output).to_string(index=False))
        folder = work / "read" / "results"
        folder.parent.mkdir()
        rows = pd.DataFrame(commands(bases["3 pieces, 1 joint", "now"], folder, read))
        save_table(rows, output / "commands")
        print(rows.to_string(index=False, float_format="{:.3g}".format))


Bases = dict[tuple[str, str], Path]  # folders, by kind and version


def _costs(
    bases: Bases, versions: dict[str, Path], count: int, work: Path, output: Path
) -> pd.DataFrame:
    """Return CPU ms a trial, by kind, part and version."""
    found: dict[tuple[str, str, str], float] = {}
    for kind, _, version in product(KINDS, range(ROUNDS), versions):  # versions take turns
        place = Path(tempfile.mkdtemp(dir=work))
        own = min(count, KINDS[kind].together)
        costs = per_trial(bases[kind, version], place, own, versions[version])
        costs["run, serial"] = costs["keeping"] + costs["results.h5"]
        say(f"{kind}, {version}: {costs['run, serial']:.2f} ms a trial")
        for part, cost in costs.items():
            cell = kind, part, version
            found[cell] = min(cost, found.get(cell, cost))
        rmtree(place)
    table = pd.Series(found).unstack()
    if "before" in table:
        table = table[["before", "now"]].assign(ratio=table["before"] / table["now"])
    table.index.names = ["trials", "CPU ms a trial"]
    save_table(table, output / "costs")
    return table


def _more(
    bases: Bases, versions: dict[str, Path], sizes: Sequence[int], work: Path, output: Path
) -> pd.DataFrame:
    """Return what one more trial costs, by number of trials and version."""
    rows = []
    for version, sources in versions.items():
        folder = work / f"more-{version}" / "results"
        folder.parent.mkdir()
        wanted = [size for size in sizes if version == "now" or size <= 5000]
        for row in one_more(bases["six-axis", version], folder, wanted, sources):
            rows.append({"version": version, **row})
            say(f"one more than {row['trials']}, {version}: {row['one more, CPU s']:.2f} s")
        rmtree(folder)
    table = pd.DataFrame(rows)
    save_table(table, output / "one-more")
    return table
