"""Can a malicious or faulty planner spoil a comparison?

    python tests/soak.py nasty_planners           # 85 planners, about a minute
    python tests/soak.py nasty_planners --quick   # 8

Each runs together with harmless planners, in a folder of its own. Its code is in
`nasty_planners.toml`. *Status* and *certified* are its entries in the comparison's table, the
latter in percent above an optimum known in closed form. *Others* says whether every other row is
the same as without it. *Left* is the number of its processes that still run. *Printed* is the
number of bytes that reached the terminal. *Executed* says whether something that it sent ran in
another process. The table goes to `nasty_planners.csv` and `.md` in `--output`. Exit code 1 if one
of them did harm: it was certified below the optimum, changed another's row, left a process or
printed something.

A planner runs with the rights of the user: it can end the comparison, and remove files. But its
statements must never be trusted.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import chdir, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from experiments.common.output import progress, save_table
from soaks.nasty import OPTIMUM, PROBLEM, Nasty, planners
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.trial import Trial
from trajopt.comparison import compare
from trajopt.core.exceptions import StoreError

CERTIFIED_BELOW = 1e-9  # relative to the optimum; rounding
OTHERS = ("ruckig-stop", "ruckig-search")  # before it; `exact`, the reference, is after it

TIMEOUT = 2.0  # s
MEMORY = 0.4  # GiB
_PATIENCE = 5.0  # s, for killed processes to end


def rows(
    group: Mapping[str, Nasty], folder: Path, expected: Mapping[tuple[str, int], Any]
) -> Iterator[dict[str, Any]]:
    """Compare these planners in this folder; yield a row per planner."""
    folder.mkdir()
    with printed(folder / "terminal") as terminal, chdir(folder):
        trials, warned = outcome([*OTHERS, *group.items()])
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
    """Return the trials of a comparison in a relative folder, and its warnings."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        run = partial(compare, timeout=TIMEOUT, memory=MEMORY, jobs=1, seeds=2)
        try:
            trials = list(run([PROBLEM], entrants, "kept").items)
        except StoreError as error:  # the stored trials are still there
            warnings.warn(str(error), stacklevel=1)
            trials = Store(Path("kept")).read()
    said = [str(one.message).partition(": ")[2] for one in caught]
    return trials, "; ".join(said)


def answers(trials: Sequence[Trial]) -> dict[tuple[str, int], Any]:
    """Return the parts of each trial that do not depend on the clock."""
    return {
        (one.planner, one.seed): (one.status, one.certified_duration, one.message) for one in trials
    }


def above(trials: Sequence[Trial]) -> float | None:
    """Return how many percent the shortest certified duration is above the optimum."""
    durations = [one.certified_duration for one in trials]
    known = [duration for duration in durations if duration is not None]
    return 100 * (min(known) / OPTIMUM - 1) if known else None


def left(file: Path) -> list[int]:
    """Return the processes noted in a file that still run after a while."""
    noted = file.read_text().split() if file.exists() else []
    end = time.monotonic() + _PATIENCE
    while True:
        living = [int(number) for number in noted if _lives(number)]
        if not living or time.monotonic() > end:
            return living
        time.sleep(0.02)


def _lives(process: str) -> bool:
    """Return whether a process runs; a zombie does not."""
    with suppress(OSError):
        facts = Path(f"/proc/{process}/stat").read_text()
        return facts.rpartition(")")[2].split()[0] != "Z"
    return False


@contextmanager
def printed(file: Path) -> Iterator[Path]:
    """Redirect the output of all processes to a file."""
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


def table(groups: Sequence[Sequence[str]] = (), most: int | None = None) -> pd.DataFrame:
    """Return a row per planner, each compared alone or with its group.

    Args:
        groups: Names of planners.
        most: Without groups, how many planners there are at most.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place).resolve()
        found = planners(folder)
        alone = folder / "alone"
        alone.mkdir()
        with chdir(alone):
            expected = answers(outcome(OTHERS)[0])
        made: list[dict[str, Any]] = []
        groups = groups or [[name] for name in found][:most]
        with progress(len(groups), "comparisons") as advance:
            for number, names in enumerate(groups):
                group = {name: found[name] for name in names}
                made += rows(group, folder / f"comparison-{number}", expected)
                advance(1)
    return pd.DataFrame(made)


def harmful(made: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of planners that did harm."""
    forging = made["certified %"] < -100 * CERTIFIED_BELOW
    changing = made["others"] != "same"
    leaving = made["left"] > 0
    printing = made["printed"] > 0
    untried = made["message"].str.startswith("NameError")  # its code is wrong
    return made[forging | changing | leaving | printing | made["executed"] | untried]


def main(output: Path = Path("results/nasty_planners"), quick: bool = False) -> None:
    """Run every planner, or the first eight if `quick`; write the table and print it."""
    made = table(most=8 if quick else None)
    save_table(made, output / "nasty_planners")
    print(made.to_string(index=False, na_rep="", float_format="{:.3g}".format))
    harm = harmful(made)
    print(f"did harm: {len(harm)} of {len(made)}")
    if len(harm):
        sys.exit(1)
