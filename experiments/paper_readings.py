"""Under which reading of the paper's text do its running times come out, and is it an honest one?

    python -m experiments.paper_readings              # 50 seeds, 1000 iterations, ten minutes
    python -m experiments.paper_readings --quick      # a few seconds; not meaningful

Open choices change one at a time from the default (penalty that only ranks, seconds, Table 3's
limits, the intended formulas), some together; each is crossed with every way of making one running
time of six joints. `readings.csv` and `.md` in `--output` hold every value; `nearest`, what comes
within 1 % of a published one; `ranking`, which algorithm comes first.
Searches are stored in `runs/`: running again does only what is missing.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments.common.output import progress, save_table
from experiments.paper.choices import READINGS, Reading
from experiments.paper.kept_searches import (
    ALGORITHMS,
    NAMES,
    budget,
    interval,
    running_times,
    stored,
)
from trajopt import Problem, verify
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core.arrays import Array
from trajopt.planners import spline353

TIMINGS = ("per-joint", "shared")
NEAR = 0.01  # relative


def moving_joints(times: Array) -> NDArray[np.intp]:
    """The joints (from 0) that have times of their own."""
    return np.flatnonzero(np.isfinite(times[0]).all(axis=1))


def combined(times: Array) -> dict[str, Array]:
    """One running time per seed from the joints' own times `(seeds, joints, 3)`, s."""
    joints = moving_joints(times)
    moving = times[:, joints]
    total = moving.sum(axis=2)
    values = {f"joint {joint + 1} alone": total[:, i] for i, joint in enumerate(joints)}
    values["mean"] = total.mean(axis=1)
    values["sum"] = total.sum(axis=1)
    values["longest"] = total.max(axis=1)
    values["segment-wise maximum"] = moving.max(axis=1).sum(axis=1)
    return values


def judged(problem: Problem, read: Problem, times: Array) -> dict[str, object]:
    """Claims of synchronised segment times `(seeds, 3)` under the problem's own limits."""
    certificates = [verify(problem, spline353.trajectory(read, own)) for own in times]
    together = all(c.valid for c in certificates)
    within = [c.dilation <= 1 + c.tolerance.limit for c in certificates]
    certified = np.median([c.certified_duration or np.nan for c in certificates])
    return {
        "certified s": float(certified) if together else np.nan,
        "keeps limits": float(np.mean(within)),
        "passes together": together,
    }


def alone(problem: Problem, read: Problem, times: Array) -> dict[str, object]:
    """Claims of joints timed alone `(seeds, joints, 3)`, which pass no point together."""
    moving = moving_joints(times)
    displacements = read.displacements.T[moving]
    limits = problem.limits.only(moving)
    v, a, _ = spline353.limit_use(displacements, times[:, moving], limits)
    within = np.maximum(v, a).max(axis=1) <= 1 + 1e-6
    return {"keeps limits": float(np.mean(within)), "passes together": False}


def rows(reading: Reading, algorithm: str, timing: str, times: Array) -> Iterator[dict[str, Any]]:
    """All the running times that one search can be said to have found."""
    problem = suite.load("six-axis")
    read = reading.problem(problem)
    published = running_times()[algorithm]
    if timing == "per-joint":
        values = combined(times)
        apart = alone(problem, read, times)
    else:
        any_joint = np.flatnonzero(problem.moving)[0]
        values = {timing: times[:, any_joint].sum(axis=1)}
        apart = {}
    for combination, seconds in values.items():
        marks = apart
        if combination in ("segment-wise maximum", "shared"):
            marks = judged(problem, read, np.nanmax(times, axis=1))
        claimed = interval(seconds)
        yield {
            "reading": reading.name,
            "combination": combination,
            "algorithm": NAMES[algorithm],
            "seeds": len(seconds),
            "claimed s": claimed.value,
            "low s": claimed.low,
            "high s": claimed.high,
            **marks,
            "published s": published,
            "difference s": claimed.value - published,
        }


def nearest(table: pd.DataFrame) -> pd.DataFrame:
    """Claims within 1 % of a published running time, whichever algorithm's it is."""
    hits = []
    for name in ALGORITHMS:
        relative = table["claimed s"] / running_times()[name] - 1
        marked = table.assign(**{"near": NAMES[name], "off %": 100 * relative})
        hits.append(marked[relative.abs() < NEAR])
    claim = ["near", "off %", "reading", "combination", "algorithm", "claimed s"]
    marks = ["certified s", "keeps limits", "passes together"]
    return pd.concat(hits)[claim + marks]


def chance(table: pd.DataFrame) -> float:
    """Share of 3–4 s within 1 % of some claim, where a hit proves nothing."""
    targets = np.linspace(3, 4, 2001)
    claims = table["claimed s"].to_numpy()
    relative = claims / targets[:, None] - 1
    hit = (np.abs(relative) < NEAR).any(axis=1)
    return float(hit.mean())


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Per reading and combination: the algorithms by median, and the worst of their three misses.

    `≈` where the medians' intervals overlap. Readings tried on PSO alone have no rank.
    """
    claimed = table.set_index(["reading", "combination", "algorithm"])
    claimed = claimed[["claimed s", "low s", "high s"]]
    published = running_times()
    ranked = []
    for reading, combination in itertools.product(READINGS, table["combination"].unique()):
        if reading.algorithms != ALGORITHMS and not reading.beside:
            continue
        cells = {}
        differences = []
        for algorithm in ALGORITHMS:
            source = reading.name if algorithm in reading.algorithms else reading.beside
            cell = claimed.loc[(source, combination, NAMES[algorithm])]
            cells[NAMES[algorithm]] = cell
            differences.append(cell["claimed s"] / published[algorithm] - 1)
        row = {
            "reading": reading.name,
            "combination": combination,
            "order": order(cells),
            "worst difference %": 100 * float(np.abs(differences).max()),
        }
        ranked.append(row)
    return pd.DataFrame(ranked).sort_values("worst difference %")


def order(cells: dict[str, pd.Series[Any]]) -> str:
    """Algorithms by median, `<` where their intervals are apart."""
    names = sorted(cells, key=lambda name: float(cells[name]["claimed s"]))
    text = names[0]
    for before, after in itertools.pairwise(names):
        clear = cells[before]["high s"] < cells[after]["low s"]
        sign = "<" if clear else "≈"
        text += f" {sign} {after}"
    return text


def main(
    seeds: int = 50, *, quick: bool = False, output: Path = Path("results/paper_readings")
) -> None:
    """Search under every reading, and print what comes near the published running times."""
    seeds, iterations = budget(seeds, quick)
    tasks = [(r, a, t) for r in READINGS for a in r.algorithms for t in TIMINGS]
    found: list[dict[str, Any]] = []
    with progress(len(tasks)) as advance:
        for reading, algorithm, timing in tasks:
            file = f"{reading.name}-{algorithm}-{timing}-{seeds}x{iterations}.npz"
            search = partial(reading.search, algorithm, timing, seeds, iterations)
            runs = stored(output / "runs" / file.replace(" ", "_"), search)
            found += rows(reading, algorithm, timing, runs.times)
            advance(1)
    table = pd.DataFrame(found)
    tables = {"readings": table, "nearest": nearest(table), "ranking": ranking(table)}
    for name, own in tables.items():
        save_table(own, output / name)
    print(tables["nearest"].to_string(index=False, float_format="{:.4f}".format))
    print(tables["ranking"].head(12).to_string(index=False, float_format="{:.2f}".format))
    share = 100 * chance(table)
    print(
        f"{len(table)} values; {share:.0f} % of all times from 3 to 4 s lie within "
        "1 % of one of them."
    )


if __name__ == "__main__":
    cyclopts.run(main)
