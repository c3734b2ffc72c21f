"""What do planners that mean harm, or have an accident, make of a comparison?

    python -m experiments.nasty_planners       # 85 planners, about a minute

Each runs between planners that do no harm, in a folder of its own; what it does,
`common/nasty_planners.toml` says. *Status* and *certified* are what the table says of it, the
latter in percent above an optimum known in closed form; *others* whether every other row is what it
is without it; *left* how many processes that it started still run; *printed* how many bytes reached
the terminal; *executed* whether something that it sent ran in another process. The
table goes to `nasty_planners.csv` and `.md` in `--output`. Exit code 1 if one of them did harm: was
certified below the optimum, changed another's row, left a process or printed something.

A planner runs as the user who compares: it may end the comparison, and remove files for good. What
it may not do is to be believed.
"""

from __future__ import annotations

import gc
import json
import mmap
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import types
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import save_table
from trajopt import verification
from trajopt.benchmark import trial
from trajopt.benchmark.compare import compare
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.trial import Trial
from trajopt.cli import console
from trajopt.exceptions import StoreError
from trajopt.planner import Planner
from trajopt.problem import Limits, Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [1.0]), "one joint, 1 rad")
OPTIMUM = 2.0  # s: 1 rad at 1 rad/s and 1 rad/s², all of it accelerating or braking
CERTIFIED_BELOW = 1e-9  # of the optimum: what rounding may gain
OTHERS = ("ruckig-stop", "pso:iterations=5")

TIMEOUT = 2.0  # s
MEMORY = 0.4  # GiB
_FILE = Path(__file__).parent / "common" / "nasty_planners.toml"
_SLEEP = "import time; time.sleep(600)"
_PATIENCE = 5.0  # s, for what is ended to be gone


class Bomb:
    """Leaves a mark in whatever process unpickles it."""

    def __init__(self, mark: str) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch {self.mark}",)


@dataclass(frozen=True)
class Nasty(Planner):
    """Does as its code says; `notes` is where it writes down what it started."""

    code: str
    notes: str
    loading: str = ""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)
        exec(self.loading, self._names(PROBLEM, 0))

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        names = self._names(problem, seed)
        exec(self.code, names)
        answer: Solution = names["answer"]
        return answer

    def _names(self, problem: Problem, seed: int) -> dict[str, Any]:
        """What its code finds."""
        notes = Path(self.notes)
        claim = honest(problem).dilated(0.5)

        def note(process: int) -> None:
            with (notes / "processes").open("a") as file:
                file.write(f"{process}\n")

        return globals() | {
            "planner": self,
            "problem": problem,
            "seed": seed,
            "notes": notes,
            "note": note,
            "SLEEP": _SLEEP,
            "honest": honest(problem),
            "claim": claim,
            "answer": Solution(Status.SOLVED, claim),
            "forged": forged,
        }


def honest(problem: Problem) -> Trajectory:
    """The optimum: half of the way at full acceleration, half at full braking."""
    half = 0.5 * OPTIMUM
    way = problem.waypoints[1] - problem.waypoints[0]
    pieces = np.zeros((3, 2, problem.joints))
    pieces[:, 0] = [0.5 * way, 0.0 * way, problem.waypoints[0]]
    pieces[:, 1] = [-0.5 * way, way, problem.waypoints[0] + 0.5 * way]
    return Trajectory(np.array([0.0, half, OPTIMUM]), pieces, np.array([0.0, OPTIMUM]))


def forged(problem: Problem, trajectory: Trajectory, *_: Any) -> verification.Certificate:
    """A certificate that praises whatever it is given."""
    certificate = _VERIFY(PROBLEM, honest(PROBLEM))
    return replace(certificate, duration=trajectory.duration, dilation=0.5)


_VERIFY = verification.verify


# what the planners' code uses
_MODULES = (gc, json, mmap, pickle, re, shutil, signal, subprocess, threading, trial, types)


def planners(folder: Path) -> dict[str, Nasty]:
    """Every planner of the file by its name; each has a folder for its notes below this one."""
    found = {}
    for number, (name, row) in enumerate(tomllib.loads(_FILE.read_text()).items()):
        notes = folder / str(number)
        notes.mkdir(parents=True)
        found[name] = Nasty(notes=str(notes), **row)
    return found


def rows(
    group: Mapping[str, Nasty], folder: Path, expected: Mapping[tuple[str, int], Any]
) -> Iterator[dict[str, Any]]:
    """What came of a comparison, in this folder, that these planners are in: a row of each."""
    folder.mkdir()
    with printed(folder / "terminal") as terminal, working_in(folder):
        trials, warned = outcome([OTHERS[0], *group.items(), OTHERS[1]])
    rest = answers([one for one in trials if one.planner not in group])
    for name, planner in group.items():
        notes = Path(planner.notes)
        own = [one for one in trials if one.planner == name]
        lines = [one.message.strip().splitlines() for one in own]
        yield {
            "planner": name,
            "status": ", ".join(str(one.status) for one in own) or "no trial",
            "certified %": above(own),
            "others": "same" if rest == expected else "changed",
            "left": len(left(notes / "processes")),
            "printed": terminal.stat().st_size,
            "executed": (notes / "executed").exists(),
            "message": "; ".join(words[-1][:80] for words in lines if words),
            "warning": warned,
        }


def outcome(entrants: Sequence[Any]) -> tuple[list[Trial], str]:
    """The trials of a comparison whose folder is relative, and what it warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = partial(compare, timeout=TIMEOUT, memory=MEMORY, jobs=1, seeds=2)
        try:
            trials = list(run([PROBLEM], entrants, "kept").items)
        except StoreError as error:  # what is stored is still there
            warnings.warn(str(error), stacklevel=1)
            trials = Store(Path("kept")).read()
    said = [str(one.message).partition(": ")[2] for one in caught]
    return trials, "; ".join(said)


def answers(trials: Sequence[Trial]) -> dict[tuple[str, int], Any]:
    """Of each planner and seed what does not depend on the clock."""
    return {
        (one.planner, one.seed): (one.status, one.certified_duration, one.message) for one in trials
    }


def above(trials: Sequence[Trial]) -> float | None:
    """How far the shortest certified duration is above the optimum, percent."""
    durations = [one.certified_duration for one in trials]
    known = [duration for duration in durations if duration is not None]
    return 100 * (min(known) / OPTIMUM - 1) if known else None


def left(file: Path) -> list[int]:
    """The processes noted in a file that still run after a while."""
    noted = file.read_text().split() if file.exists() else []
    end = time.monotonic() + _PATIENCE
    while True:
        living = [int(number) for number in noted if _lives(number)]
        if not living or time.monotonic() > end:
            return living
        time.sleep(0.02)


def _lives(process: str) -> bool:
    """Whether it runs; a zombie, whose parent has not looked yet, does not."""
    with suppress(OSError):
        facts = Path(f"/proc/{process}/stat").read_text()
        return facts.rpartition(")")[2].split()[0] != "Z"
    return False


@contextmanager
def printed(file: Path) -> Iterator[Path]:
    """What any process prints meanwhile goes to a file instead of the terminal."""
    sys.stdout.flush()
    kept = [os.dup(1), os.dup(2)]
    with file.open("wb") as stream:
        for descriptor in (1, 2):
            os.dup2(stream.fileno(), descriptor)
        try:
            yield file
        finally:
            for descriptor, old in zip((1, 2), kept, strict=True):
                os.dup2(old, descriptor)
                os.close(old)


@contextmanager
def working_in(folder: Path) -> Iterator[None]:
    """This folder is the working folder meanwhile."""
    before = os.getcwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def table(groups: Sequence[Sequence[str]] = ()) -> pd.DataFrame:
    """A row per planner: of all, each compared alone, or of these, those of a group together."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place).resolve()
        found = planners(folder)
        alone = folder / "alone"
        alone.mkdir()
        with working_in(alone):
            expected = answers(outcome(OTHERS)[0])
        made: list[dict[str, Any]] = []
        groups = groups or [[name] for name in found]
        with console.progress(len(groups), "comparisons") as advance:
            for number, names in enumerate(groups):
                group = {name: found[name] for name in names}
                made += rows(group, folder / f"comparison-{number}", expected)
                advance(1)
    return pd.DataFrame(made)


def harmful(made: pd.DataFrame) -> pd.DataFrame:
    """The rows of planners that did harm."""
    forging = made["certified %"] < -100 * CERTIFIED_BELOW
    changing = made["others"] != "same"
    leaving = made["left"] > 0
    printing = made["printed"] > 0
    return made[forging | changing | leaving | printing | made["executed"]]


def main(output: Path = Path("results/nasty_planners")) -> None:
    """Run every planner, write the table and print it."""
    made = table()
    save_table(made, output / "nasty_planners")
    print(made.to_string(index=False, na_rep="", float_format="{:.3g}".format))
    harm = harmful(made)
    print(f"did harm: {len(harm)} of {len(made)}")
    if len(harm):
        sys.exit(1)


if __name__ == "__main__":
    cyclopts.run(main)
