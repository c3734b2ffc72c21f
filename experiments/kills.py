"""Is anything lost or torn when a run is killed? `kill -9` at random moments of every phase.

    python -m experiments.kills               # 200 kills, about ten minutes
    python -m experiments.kills --quick       # 5

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
from functools import cache, partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.kept import kept
from experiments.common.killed import PHASES, Child, sweep
from experiments.common.output import save_table
from trajopt.benchmark.store.folder import read
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import StoreError

FAULTS = ["lost", "torn", "different", "run again", "unequal"]

# Worker processes; half the trials and a results.h5 are there already; workers are killed as well.
SETTINGS = [
    (0, False, True),
    (0, True, True),
    (1, False, True),
    (2, True, True),
    (2, False, False),
    (1, True, False),
    (2, False, True),
    (2, True, False),
]

Answer = tuple[Any, ...]
Answers = dict[str, Answer]  # by a trial's identity


def answers(trials: Iterable[Trial]) -> Answers:
    """By identity, all of a trial that does not depend on when and how fast it ran."""
    return {trial.id: _answer(trial) for trial in trials}


def _answer(trial: Trial) -> Answer:
    solution = trial.solution
    answer: list[Any] = [
        trial.status,
        trial.message,
        trial.certified_duration,
        trial.lower_bound,
        solution.evaluations,
    ]
    if solution.history is not None:
        answer.append(solution.history.tobytes())
    if solution.trajectory is not None:
        arrays = (
            solution.trajectory.coefficients,
            solution.trajectory.breaks,
            solution.trajectory.waypoint_times,
        )
        answer += [array.tobytes() for array in arrays]
    return tuple(answer)


@cache
def reference(output: Path) -> Answers:
    """The answers of the uninterrupted run."""
    trials = sweep(output / "reference")
    return answers(trials)


def started(
    output: Path,
    name: str,
    jobs: int,
    half: bool,
) -> tuple[Path, Child]:
    """A child at work in a new folder, empty or with half of the trials and their `results.h5`."""
    folder = output / name
    shutil.rmtree(folder, ignore_errors=True)
    if half:
        sweep(output / "half", seeds=4)
        shutil.copytree(output / "half", folder)
    return folder, Child(folder, jobs)


@cache
def uninterrupted(
    output: Path,
    jobs: int,
    half: bool,
) -> Child:
    """A child that was left alone: it knows how long its phases take."""
    folder, child = started(output, "timeline", jobs, half)
    while child.listen():
        pass
    child.bury()
    shutil.rmtree(folder)
    return child


def attempt(output: Path, number: int) -> list[dict[str, Any]]:
    """Kill a run at the moment that this number draws, look, resume it, look again: one row."""
    wanted = PHASES[number % 4]
    setting = number // 4 % len(SETTINGS)
    jobs, half, workers_too = SETTINGS[setting]
    lengths = uninterrupted(output, jobs, half).lengths(wanted)
    rng = np.random.default_rng([1, number])
    turn = int(rng.integers(len(lengths)))
    part = float(rng.uniform())
    folder, child = started(output, f"kill-{number}", jobs, half)
    stored = _trials(folder.glob("trials/*.json"))
    try:
        moment = child.entered(wanted, turn + 1) + part * lengths[turn]
        left = moment - time.monotonic()
        time.sleep(max(0.0, left))
        child.kill(workers_too)
        told = {word.trial for word in child.words if word.trial}
        promised = stored | told
        lived = child.died - child.words[0].time
        row: dict[str, Any] = {
            "jobs": jobs,
            "half": half,
            "workers too": workers_too,
            "wanted": wanted,
            "hit": child.hit,
            "promised": len(promised),
            "moment (s)": round(lived, 4),
        }
        row |= faults(folder, promised, stored, reference(output))
    finally:
        child.bury()
    if not any(row[fault] for fault in FAULTS):
        shutil.rmtree(folder)
    return [row]


def faults(
    folder: Path,
    promised: set[str],
    stored: set[str],
    expected: Answers,
) -> dict[str, Any]:
    """Count the faults that a killed run left, and those of resuming it.

    `promised` are the trials that it told to be kept, `stored` those that `results.h5` had before.
    """
    temporaries = list(folder.rglob(".*.tmp"))
    whole, torn = _whole(folder)
    old = whole.pop(folder / "results.h5", {})
    kept = _trials(whole)
    lost = (promised - kept) | (stored - old.keys())
    different: set[str] = set()
    for found in (old, *whole.values()):
        different |= {i for i in found if found[i] != expected.get(i)}

    written = {}
    for file in whole:
        if file.stem in promised:
            written[file] = file.stat().st_mtime_ns
    resumed = answers(sweep(folder))
    again = [file for file, when in written.items() if file.stat().st_mtime_ns != when]

    unequal: set[str] = set()
    for end in (resumed, answers(read(folder / "results.h5"))):
        unequal |= {i for i, _ in end.items() ^ expected.items()}
    return {
        "whole": len(kept),
        "temporaries": len(temporaries),
        "torn": len(torn),
        "different": len(different),
        "lost": len(lost),
        "run again": len(again),
        "unequal": len(unequal),
        "note": "; ".join(torn),
    }


def _trials(files: Iterable[Path]) -> set[str]:
    """The identities of the trials in these files."""
    return {file.stem for file in files}


def _whole(folder: Path) -> tuple[dict[Path, Answers], list[str]]:
    """The answers in every file that can be read, and why the others cannot."""
    whole = {}
    torn = []
    for file in [*sorted(folder.glob("trials/[!.]*.json")), *folder.glob("results.h5")]:
        try:
            trials = read(file)
            whole[file] = answers(trials)
        except StoreError as error:
            torn.append(str(error))
    return whole, torn


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Per phase hit: kills, of them those that left half-written temporaries, trials, faults."""
    leaving = rows["temporaries"] > 0
    counted = rows.assign(kills=1, temporaries=leaving)
    columns = ["kills", "temporaries", "promised", *FAULTS]
    sums = counted.groupby("hit")[columns].sum()
    summary = sums.reindex(PHASES, fill_value=0)
    summary.loc["all"] = summary.sum()
    return summary.rename_axis("phase hit")


def main(
    tries: int = 200,
    output: Path = Path("results/kills"),
    quick: bool = False,
) -> None:
    """Kill that often and print the table; `kills-by-phase.csv` and `.md` in `output` too."""
    if quick:
        tries = min(tries, 5)
    cells = {(number,): partial(attempt, output, number) for number in range(tries)}
    summary = table(kept(output / "kills.csv", ["kill"], cells))
    save_table(summary, output / "kills-by-phase")
    print(summary.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
