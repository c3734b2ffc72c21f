"""Do the main job, its second run and a listing take less time than in another version?

    python tests/soak.py commands trajopt                    # the one that is installed
    python tests/soak.py commands trajopt old/bin/trajopt    # and another environment's, in turn
    python tests/soak.py commands trajopt --quick            # two seeds, once

Wall times of README's main command into a fresh folder, of the same command again, and of `trajopt
list`, of each installed command in turn. Wall times on a busy machine vary, so compare the ratios:
they are those of medians to the first command's. The table goes to `commands.csv` and `.md` in
`--output`.
"""

from __future__ import annotations

import shutil
import subprocess
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd

from experiments.common.output import save_table, say

MAIN_JOB = ("compare", "six-axis", "--prove")


def measured(command: str, folder: Path, seeds: int) -> dict[str, float]:
    """Return the wall times of the three tasks, s, the first into a fresh folder."""
    shutil.rmtree(folder, ignore_errors=True)
    compare = (*MAIN_JOB, "--seeds", str(seeds), "--output", str(folder))
    return {
        "main job": timed(command, *compare),
        "second run": timed(command, *compare),
        "list": timed(command, "list"),
    }


def timed(command: str, *arguments: str) -> float:
    """Return the wall time of a command, s.

    Raises:
        CalledProcessError: where it fails.
    """
    began = time.perf_counter()
    subprocess.run([command, *arguments], check=True, capture_output=True)
    return time.perf_counter() - began


def medians(rounds: Sequence[dict[str, dict[str, float]]]) -> pd.DataFrame:
    """Return a row per task: each command's median, s, and the ratios to the first command."""
    table = pd.DataFrame()
    first, *others = rounds[0]
    for command in rounds[0]:
        own = pd.DataFrame([taken[command] for taken in rounds])
        table[f"{command}, s"] = own.median()
    for command in others:
        table[f"{command} / {first}"] = table[f"{command}, s"] / table[f"{first}, s"]
    return table.rename_axis("task")


def main(
    command: str,
    *others: str,
    rounds: int = 3,
    seeds: int = 30,
    quick: bool = False,
    output: Path = Path("results/commands"),
) -> None:
    """Time the commands in turn, and print the table."""
    if quick:
        rounds = 1
        seeds = 2
    say(f"{rounds} rounds of {1 + len(others)} environments")
    taken = []
    for _ in range(rounds):
        by_command = {}
        for number, own in enumerate((command, *others)):
            by_command[own] = measured(own, output / f"results-{number}", seeds)
        taken.append(by_command)
    table = medians(taken)
    save_table(table, output / "commands")
    print(table.to_string(float_format="{:.2f}".format))
