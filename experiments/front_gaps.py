"""How close is the proved front to the best motion known, on every problem of a few segments?

    python -m experiments.front_gaps                       # every suite, up to four segments
    python -m experiments.front_gaps --problem six-axis --seconds 5
    python -m experiments.front_gaps --quick

∫ jerk² at four durations: the gap between the smoothest motion found and the bound over all segment
times, and the CPU time of motions and proofs. Problems that ask for more than `trajopt front` knows
are left out. The table goes to `front-gaps.csv` and `.md` in `--output`, its shares to standard
output; it is written anew after each problem.
"""

from __future__ import annotations

import time
from pathlib import Path

import cyclopts
import pandas as pd

from baselines.lower_bound.incumbent import incumbent
from experiments.common.output import save_table, say
from trajopt import TrajoptError
from trajopt.benchmark.front import front
from trajopt.benchmark.suites.catalogue import every_problem, load
from trajopt.core.problem import Problem

FACTORS = (1.2, 1.5, 2.0, 3.0)  # times the shortest duration known
_MAX_SEGMENTS = 4
_CLOSED = 1.0  # %


def chosen(most: int) -> list[Problem]:
    """Every problem of at most so many segments between waypoints that differ, without demands."""
    found = [listed.problem for listed in every_problem().values()]
    found = [problem for problem in found if not problem.demands]
    return [problem for problem in found if problem.merged()[0].segments <= most]


def row(problem: Problem, seconds: float) -> dict[str, object] | None:
    """The gaps of a problem in %; None where it has no front here."""
    merged, _ = problem.merged()
    cells: dict[str, object] = {
        "problem": problem.name,
        "segments": merged.segments,
        "joints": int(merged.moving.sum()),
    }
    start = time.process_time()
    try:
        known = incumbent(merged, 10.0)
        assert known is not None
        durations = [factor * known.duration for factor in FACTORS]
        points = front(problem, durations=durations, time_limit=seconds).points
    except TrajoptError as error:
        say(str(error))
        return None
    for factor, point in zip(FACTORS, points, strict=True):
        gap = 100 * (1 - (point.lower or 0.0) / point.value)
        cells[f"{factor:g} times, %"] = round(gap, 2)
    cells["CPU s"] = round(time.process_time() - start, 1)
    return cells


def shares(table: pd.DataFrame) -> pd.DataFrame:
    """Of each number of segments: problems, and how many are within 1 % at each duration."""
    gaps = [f"{factor:g} times, %" for factor in FACTORS]
    within = (table[gaps] <= _CLOSED).rename(columns=lambda name: name.removesuffix(", %"))
    groups = within.groupby(table["segments"])
    found = groups.sum().astype(int)
    found.insert(0, "problems", groups.size())
    found["median CPU s"] = table["CPU s"].groupby(table["segments"]).median().round(1)
    found["longest CPU s"] = table["CPU s"].groupby(table["segments"]).max()
    return found


def main(
    output: Path = Path("front-gaps"),
    problem: list[str] | None = None,
    segments: int = _MAX_SEGMENTS,
    seconds: float = 60.0,
    quick: bool = False,
) -> None:
    """Write the table.

    Args:
        output: Folder.
        problem: Names; by default every problem of all suites.
        segments: At most.
        seconds: Of CPU time, for the proof of each point.
        quick: One problem, one second a proof.
    """
    if quick:
        problem, seconds = ["one-joint"], 1.0
    given = [load(name) for name in problem] if problem else chosen(segments)
    rows = []
    for own in given:
        found = row(own, seconds)
        if found is None:
            continue
        rows.append(found)
        save_table(pd.DataFrame(rows), output / "front-gaps")
    print(shares(pd.DataFrame(rows)).to_string())


if __name__ == "__main__":
    cyclopts.run(main)
