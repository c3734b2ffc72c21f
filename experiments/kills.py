"""Is anything lost or torn when a run is killed? `kill -9` at random moments of every phase.

    python -m experiments.kills               # 200 kills, about thirteen minutes
    python -m experiments.kills --quick       # 10

A child process runs a small sweep and tells each step to a pipe. A moment is drawn within a phase
(start-up until the first trial, solving, writing a trial, consolidating) of an uninterrupted run;
the child is killed then, the phase in which it died is what its last words say. After that every
trial that it told to be kept must be there and equal to the reference, every file whole, and
resuming must end as the reference does. One row per kill goes to `kills.csv` in `--output` as soon
as it is known; running again does only what is missing. Needs POSIX.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterable
from functools import cache
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.killed import PHASES, Child, sweep
from experiments.common.output import save_table
from trajopt.benchmark.store.folder import read
from trajopt.benchmark.trial import Trial
from trajopt.cli import console
from trajopt.exceptions import StoreError

FAULTS = ["lost", "torn", "different", "run again", "unequal"]

# worker processes; half the trials and a results.h5 are there already; workers are killed as well
SETTINGS = [
    (0, False, True), (0, True, True), (1, False, True), (2, True, True),
    (2, False, False), (1, True, False), (2, False, True), (2, True, False),
]  # fmt: skip


def answers(trials: Iterable[Trial]) -> dict[str, tuple[Any, ...]]:
    """By identity, all of a trial that does not depend on when and how fast it ran."""
    return {t.id: _answer(t) for t in trials}


def _answer(one: Trial) -> tuple[Any, ...]:
    found = one.solution
    arrays = [found.history]
    if found.trajectory:
        names = ("coefficients", "breaks", "waypoint_times")
        arrays += [getattr(found.trajectory, name) for name in names]
    numbers = (one.status, one.message, one.certified_duration, one.lower_bound, found.evaluations)
    return *numbers, *(None if array is None else array.tobytes() for array in arrays)


@cache
def reference(output: Path) -> dict[str, tuple[Any, ...]]:
    """The answers of the uninterrupted run."""
    return answers(sweep(output / "reference"))


def started(output: Path, name: str, jobs: int, half: bool) -> tuple[Path, Child]:
    """A child at work in a new folder, empty or with half of the trials and their `results.h5`."""
    folder = output / name
    shutil.rmtree(folder, ignore_errors=True)
    if half:
        sweep(output / "half", seeds=4)
        shutil.copytree(output / "half", folder)
    return folder, Child(folder, jobs)


@cache
def uninterrupted(output: Path, jobs: int, half: bool) -> Child:
    """A child that was left alone: it knows how long its phases take."""
    folder, child = started(output, "timeline", jobs, half)
    while child.listen():
        pass
    child.bury()
    shutil.rmtree(folder)
    return child


def attempt(output: Path, number: int) -> dict[str, Any]:
    """Kill a run at the moment that this number draws, look, resume it, look again: one row."""
    rng, wanted = np.random.default_rng([1, number]), PHASES[number % 4]
    jobs, half, workers_too = SETTINGS[number // 4 % len(SETTINGS)]
    phase = uninterrupted(output, jobs, half).lengths(wanted)
    turn, part = int(rng.integers(len(phase))), float(rng.uniform())
    folder, child = started(output, f"kill-{number}", jobs, half)
    stored = {file.stem for file in folder.glob("trials/*.h5")}
    try:
        moment = child.entered(wanted, turn + 1) + part * phase[turn]
        time.sleep(max(0.0, moment - time.monotonic()))
        child.kill(workers_too)
        promised = stored | {word.trial for word in child.words if word.trial}
        row: dict[str, Any] = {
            "kill": number, "jobs": jobs, "half": half, "workers too": workers_too,
            "wanted": wanted, "hit": child.hit, "promised": len(promised),
            "moment (s)": round(child.died - child.words[0].time, 4),
        }  # fmt: skip
        row |= faults(folder, promised, stored, reference(output))
    finally:
        child.bury()
    if not any(row[fault] for fault in FAULTS):
        shutil.rmtree(folder)
    return row


def faults(
    folder: Path, promised: set[str], stored: set[str], expected: dict[str, Any]
) -> dict[str, Any]:
    """What a killed run left behind, and what came of resuming it; zeros where nothing is wrong.

    `promised` are the trials that it told to be kept, `stored` those that `results.h5` had before.
    """
    left, (whole, torn) = len(list(folder.rglob(".*.tmp"))), _whole(folder)
    old = whole.pop(folder / "results.h5", {})
    kept = {file.stem for file in whole}
    wrong = {i for one in [old, *whole.values()] for i in one if one[i] != expected.get(i)}
    times = {file: file.stat().st_mtime_ns for file in whole if file.stem in promised}
    ended = (answers(sweep(folder)), answers(read(folder / "results.h5")))
    again = [file for file, when in times.items() if file.stat().st_mtime_ns != when]
    return {
        "whole": len(kept), "temporaries": left, "torn": len(torn), "different": len(wrong),
        "lost": len((promised - kept) | (stored - old.keys())), "run again": len(again),
        "unequal": len({i for end in ended for i, _ in end.items() ^ expected.items()}),
        "note": "; ".join(torn),
    }  # fmt: skip


def _whole(folder: Path) -> tuple[dict[Path, dict[str, Any]], list[str]]:
    """The answers in every file that can be read, and why the others cannot."""
    whole, torn = {}, []
    for file in sorted(folder.rglob("[!.]*.h5")):
        try:
            whole[file] = answers(read(file))
        except StoreError as error:
            torn.append(str(error))
    return whole, torn


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Per phase hit: kills, of them those that left half-written temporaries, trials, faults."""
    phases = rows.assign(kills=1, temporaries=rows["temporaries"] > 0).groupby("hit")
    columns = ["kills", "temporaries", "promised", *FAULTS]
    found = phases[columns].sum().reindex(PHASES, fill_value=0)
    found.loc["all"] = found.sum()
    return found.rename_axis("phase hit")


def main(tries: int = 200, output: Path = Path("results/kills"), quick: bool = False) -> None:
    """Kill that often and print the table; `kills-by-phase.csv` and `.md` in `output` too."""
    tries = min(tries, 10) if quick else tries
    output.mkdir(parents=True, exist_ok=True)
    file = output / "kills.csv"
    rows = pd.read_csv(file).to_dict("records") if file.exists() else []
    with console.progress(tries) as advance:
        advance(len(rows))
        for number in sorted(set(range(tries)) - {row["kill"] for row in rows}):
            rows.append(attempt(output, number))
            pd.DataFrame(rows).to_csv(file.with_suffix(".part"), index=False)
            file.with_suffix(".part").replace(file)
            advance(1)
    summary = table(pd.DataFrame(rows))
    save_table(summary, output / "kills-by-phase")
    print(summary.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
