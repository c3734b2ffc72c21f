"""Is anything lost or torn when a run is killed? `kill -9` at random moments.

    python tests/soak.py kills               # 240 kills, about fifteen minutes
    python tests/soak.py kills --quick       # 5

A child process runs a small sweep. Each of its calls, or of its judges', that changes a file
permanently (sync, rename, removal) is slowed down and reported, and so is the making of
`results.h5`. The child is killed soon after a random report, so at any step and between any two;
every second one while `results.h5` is made and written. Every sixth has another run beside it in
the same folder, which goes on. Then at least the reported trials must be there, every file whole
and equal to the reference, and a resumed run must end as the reference does, with a `results.h5`
that is byte for byte the one made from the texts alone. One
row per kill goes to `kills.csv` in `--output` as soon as it is known; running again does only what
is missing. Needs POSIX.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterable, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt import compare
from trajopt.benchmark.store.folder import Store, recorded
from trajopt.benchmark.trial import Trial
from trajopt.core.exceptions import StoreError, TrajoptError
from trajopt.planners.registry import named
from trajopt.views.analysis.gap_reference import best

PROBLEMS = ("one-joint", "six-axis")
SPECS = ("ruckig-stop", "unoptimised", "exact:starts=1", "pso:iterations=20")
CALLS = ["solving", "fsync", "replace", "unlink"]
MAKING = "results.h5"  # told before it is made
STEPS = [*CALLS, *(f"{MAKING}: {step}" for step in ("making", *CALLS)), "end"]
TIMEOUT_S = 60.0
DELAY_S = 0.05
BESIDE_EVERY = 6  # kills
FAULTS = ["lost", "torn", "different", "run again", "unequal"]

# Judges; half the trials and a results.h5 are there already; the judges are killed as well.
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
    """Return by identity the parts of trials that do not depend on time and speed."""
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
    """Return the answers of an uninterrupted run."""
    trials = sweep(output / "reference")
    return answers(trials)


# Every process of the child runs this first: it slows and tells three calls of `os`.
_SITE = """
import os
import time


def tell(word):
    os.write(1, f"{time.monotonic():.6f} {word}\\n".encode())  # whole or not at all


def slowed(name):
    call = getattr(os, name)

    def own(*arguments, **keywords):
        tell(name)
        time.sleep(0.02)
        try:
            return call(*arguments, **keywords)
        finally:
            tell("solving")

    return own


for name in ("fsync", "replace", "unlink"):
    setattr(os, name, slowed(name))
"""
_PROGRAM = """
import sys
import time
from pathlib import Path

from soaks.kills import sweep
from trajopt.benchmark.store import results_file
from sitecustomize import tell

own = results_file.content


def content(*arguments):
    tell("results.h5")
    time.sleep(0.02)
    return own(*arguments)


results_file.content = content
sweep(Path(sys.argv[1]), jobs=int(sys.argv[2]), progress=lambda own: tell(own.finished))
tell("end")
"""
Word = tuple[float, str]  # on the machine's clock, s, and a step or a number of trials


def sweep(folder: Path, seeds: int = 8, **options: Any) -> list[Trial]:
    """Run 22 trials in a second: two problems, four planners, one of them with eight seeds."""
    planners = [named(spec) for spec in SPECS]
    return list(compare(PROBLEMS, planners, folder, seeds=seeds, **options).items)


def told(
    folder: Path,
    jobs: int,
    words: int | None = None,
    delay: float = 0.0,
    *,
    workers_too: bool = True,
    beside: bool = False,
) -> tuple[list[Word], float]:
    """Run the sweep in a process group; return its messages, and when it was killed.

    Args:
        folder: Of the trials.
        jobs: Of the comparison.
        words: It is killed after so many words; never if left out.
        delay: So long after them, s.
        workers_too: True to kill the whole group; else its judges end by themselves.
        beside: Whether another run fills the same folder, which is not killed.

    Raises:
        TrajoptError: It failed by itself.
        TimeoutExpired: A process lives on after the runner was killed.
    """
    site = folder.parent / "site"
    site.mkdir(exist_ok=True)
    (site / "sitecustomize.py").write_text(_SITE)
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(site.absolute()), *sys.path])}

    def started(output: int) -> subprocess.Popen[bytes]:
        return subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, str(folder.absolute()), str(jobs)],
            stdout=output,
            bufsize=0,  # a line leaves all that follows to `communicate`
            stderr=subprocess.DEVNULL,
            start_new_session=True,
            env=environment,
        )

    child = started(subprocess.PIPE)
    other = started(subprocess.DEVNULL) if beside else None
    lines = []
    killed = np.inf
    if words is not None and child.stdout is not None:
        lines = [child.stdout.readline() for _ in range(words)]
        time.sleep(delay)
        kill = os.killpg if workers_too else os.kill
        killed = time.monotonic()
        kill(child.pid, signal.SIGKILL)
    rest, _ = child.communicate(timeout=TIMEOUT_S)
    if other is not None and other.wait(TIMEOUT_S) != 0:
        raise TrajoptError(f"the run beside it ended with exit code {other.returncode}")
    if child.returncode not in (0, -signal.SIGKILL):
        code = child.returncode
        raise TrajoptError(f"the child ended by itself, with exit code {code}")
    told = [line.split() for line in [*lines, *rest.splitlines()] if line]
    return [(float(when), word.decode()) for when, word in told], killed


def prepared(output: Path, name: str, half: bool) -> Path:
    """Return a new folder, empty or with half of the trials and their `results.h5`."""
    folder = output / name
    shutil.rmtree(folder, ignore_errors=True)
    if half:
        sweep(output / "half", seeds=4)
        shutil.copytree(output / "half", folder)
    return folder


@cache
def uninterrupted(output: Path, jobs: int, half: bool) -> tuple[int, int]:
    """Count the messages of a run that is not killed: before `results.h5` is made, and all."""
    folder = prepared(output, "uninterrupted", half)
    words = [word for _, word in sorted(told(folder, jobs)[0])]
    shutil.rmtree(folder)
    return words.index(MAKING), len(words)


def attempt(output: Path, number: int) -> list[dict[str, Any]]:
    """Kill a run at a random moment, check it, resume it, check again; return the row."""
    jobs, half, workers_too = SETTINGS[number % len(SETTINGS)]
    draw = np.random.default_rng([1, number])
    making, count = uninterrupted(output, jobs, half)
    after = draw.integers(making if number % 2 else 0, count)
    beside = number % BESIDE_EVERY == 0
    delay = draw.uniform(0.0, DELAY_S)
    folder = prepared(output, f"kill-{number}", half)
    stored = _trials(folder.glob("trials/*.json"))
    words, killed = told(folder, jobs, int(after), delay, workers_too=workers_too, beside=beside)
    promised = max([int(word) for _, word in words if word.isdigit()], default=len(stored))
    row: dict[str, Any] = {
        "jobs": jobs,
        "half": half,
        "workers too": workers_too,
        "beside": beside,
        "hit": hit([own for own in words if own[0] <= killed]),
        "promised": promised,
        "after": after,
    }
    row |= faults(folder, promised, stored, reference(output))
    if not any(row[fault] for fault in FAULTS):
        shutil.rmtree(folder)
    return [row]


def hit(words: Sequence[Word]) -> str:
    """Return the step that the run had reached at its last message."""
    _, last = max(words, default=(0.0, "solving"))
    step = "solving" if last.isdigit() else last
    if step == "end" or MAKING not in [word for _, word in words]:
        return step
    return f"{MAKING}: {'making' if step == MAKING else step}"


def faults(folder: Path, promised: int, stored: set[str], expected: Answers) -> dict[str, Any]:
    """Count the faults that a killed run left, and those of resuming it.

    `promised` is how many trials it reported, `stored` are those that `results.h5` had before.
    """
    temporaries = list(folder.rglob(".*.tmp"))
    whole, torn = _whole(folder)
    old = whole.pop(folder / "results.h5", {})
    kept = _trials(whole)
    gone = (stored - kept) | (stored - old.keys())
    different: set[str] = set()
    for found in (old, *whole.values()):
        different |= {i for i in found if found[i] != expected.get(i)}

    written = {file: file.stat().st_mtime_ns for file in whole}
    resumed = answers(sweep(folder))
    again = [file for file, when in written.items() if file.stat().st_mtime_ns != when]

    unequal: set[str] = set()
    for end in (resumed, answers(recorded(folder / "results.h5"))):
        unequal |= {i for i, _ in end.items() ^ expected.items()}
    merged = (folder / "results.h5").read_bytes()
    (folder / "results.h5").unlink()
    if Store(folder).consolidate(references=best).read_bytes() != merged:
        unequal.add("results.h5")
    return {
        "whole": len(kept),
        "temporaries": len(temporaries),
        "torn": len(torn),
        "different": len(different),
        "lost": max(promised - len(kept), len(gone)),
        "run again": len(again),
        "unequal": len(unequal),
        "note": "; ".join(torn),
    }


def _trials(files: Iterable[Path]) -> set[str]:
    """Return the identities of the trials in these files."""
    return {file.stem for file in files}


def _whole(folder: Path) -> tuple[dict[Path, Answers], list[str]]:
    """Return the answers in readable files, and the reasons why others are not readable."""
    whole = {}
    torn = []
    for file in [*sorted(folder.glob("trials/[!.]*.json")), *folder.glob("results.h5")]:
        try:
            whole[file] = answers(recorded(file))
        except StoreError as error:
            torn.append(str(error))
    return whole, torn


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Return a row per step that was hit: kills, temporaries left, trials, faults."""
    leaving = rows["temporaries"] > 0
    counted = rows.assign(kills=1, temporaries=leaving)
    columns = ["kills", "temporaries", "promised", *FAULTS]
    sums = counted.groupby("hit")[columns].sum()
    summary = sums.reindex(STEPS, fill_value=0)
    summary.loc["all"] = summary.sum()
    return summary.rename_axis("step hit")


def main(tries: int = 240, output: Path = Path("results/kills"), quick: bool = False) -> None:
    """Kill that often and print the table; `kills-by-step.csv` and `.md` in `output` too."""
    if quick:
        tries = min(tries, 5)
    cells = {(number,): partial(attempt, output, number) for number in range(tries)}
    summary = table(kept(output / "kills.csv", ["kill"], cells))
    save_table(summary, output / "kills-by-step")
    print(summary.to_string())
