"""Under which reading of the paper's text do its running times come out, and is it an honest one?

    python -m experiments.paper_readings              # 50 seeds, 1000 iterations, ten minutes
    python -m experiments.paper_readings --quick      # a few seconds; says nothing

Open choices change one at a time from the default (penalty that only ranks, seconds, Table 3's
limits, the intended formulas), some together; each is crossed with every way of making one running
time of six joints. `readings.csv` and `.md` in `--output` hold every value; `nearest`, what comes
within 1 % of a published one; `ranking`, which algorithm comes first; `claims`, what follows.
Searches are kept in `runs/`: running again does only what is missing.
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

from experiments.common.output import save_table
from experiments.paper import figures as paper_figures
from experiments.paper.choices import READINGS, Reading
from experiments.paper.searches import (
    ALGORITHMS,
    NAMES,
    Array,
    interval,
    kept,
    running_times,
    tool_miss,
)
from trajopt import Problem, spline353, verify
from trajopt.benchmark.figures import plots
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import console

TIMINGS = ("per-joint", "shared")
NEAR = 0.01  # relative


def combined(times: Array) -> dict[str, Array]:
    """One running time per seed from the joints' own times `(seeds, joints, 3)`, s."""
    moving = times[:, np.isfinite(times[0]).all(axis=1)]
    total = moving.sum(axis=2)
    joints = np.flatnonzero(np.isfinite(times[0]).all(axis=1)) + 1
    own = {f"joint {j} alone": total[:, i] for i, j in enumerate(joints)}
    own |= {"mean": total.mean(axis=1), "sum": total.sum(axis=1), "longest": total.max(axis=1)}
    return own | {"segment-wise maximum": moving.max(axis=1).sum(axis=1)}


def judged(problem: Problem, read: Problem, times: Array) -> dict[str, object]:
    """What synchronised segment times `(seeds, 3)` are worth under the problem's own limits."""
    found = [verify(problem, spline353.trajectory(read, own)) for own in times]
    together = all(c.valid for c in found)
    certified = float(np.median([c.certified_duration or np.nan for c in found]))
    return {
        "certified s": certified if together else np.nan,
        "keeps limits": float(np.mean([c.dilation <= 1 + c.tolerance.limit for c in found])),
        "passes together": together,
    }


def apart(problem: Problem, read: Problem, times: Array) -> dict[str, object]:
    """What joints on their own clocks `(seeds, joints, 3)` do; the tool's misses of one run.

    That run is the one whose slowest joint takes the median time.
    """
    moving = np.flatnonzero(np.isfinite(times[0]).all(axis=1))
    limits = problem.limits.only(moving)
    v, a, _ = spline353.limit_use(read.displacements.T[moving], times[:, moving], limits)
    longest = combined(times)["longest"]
    median = times[np.argsort(longest)[len(longest) // 2]]
    at, nearest = tool_miss(suite.robot("six-axis"), read, median)
    return {
        "keeps limits": float(np.mean(np.maximum(v, a).max(axis=1) <= 1 + 1e-6)),
        "passes together": False,
        **{f"miss at point {k} mm": at[k - 1] for k in (2, 3)},
        **{f"nearest to point {k} mm": nearest[k - 1] for k in (2, 3)},
    }


def rows(reading: Reading, algorithm: str, timing: str, times: Array) -> Iterator[dict[str, Any]]:
    """All the running times that one search can be said to have found."""
    problem = suite.load("six-axis")
    read, published = reading.problem(problem), running_times()[algorithm]
    moving = int(np.flatnonzero(problem.moving)[0])
    values = combined(times) if timing == "per-joint" else {timing: times[:, moving].sum(axis=1)}
    alone = apart(problem, read, times) if timing == "per-joint" else {}
    for combination, seconds in values.items():
        whole = combination in ("segment-wise maximum", "shared")
        found = judged(problem, read, np.nanmax(times, axis=1)) if whole else alone
        e = interval(seconds)
        yield {
            "reading": reading.name, "combination": combination, "algorithm": NAMES[algorithm],
            "seeds": len(seconds), "claimed s": e.value, "low s": e.low, "high s": e.high, **found,
            "published s": published, "difference s": e.value - published,
        }  # fmt: skip


def nearest(table: pd.DataFrame) -> pd.DataFrame:
    """Claims within 1 % of a published running time, whichever algorithm's it is."""
    hits = []
    for name in ALGORITHMS:
        relative = table["claimed s"] / running_times()[name] - 1
        hits.append(table[relative.abs() < NEAR].assign(near=NAMES[name], off=100 * relative))
    kept_columns = ["near", "off", "reading", "combination", "algorithm", "claimed s"]
    marks = ["certified s", "keeps limits", "passes together"]
    return pd.concat(hits)[kept_columns + marks].rename(columns={"off": "off %"})


def chance(table: pd.DataFrame) -> float:
    """How much of 3–4 s lies within 1 % of some claim: hits that mean nothing."""
    targets, claims = np.linspace(3, 4, 2001), table["claimed s"].to_numpy()
    return float((np.abs(claims / targets[:, None] - 1) < NEAR).any(axis=1).mean())


def ranking(table: pd.DataFrame) -> pd.DataFrame:
    """Per reading and combination: the algorithms by median, and the worst of their three misses.

    `≈` where the medians' intervals overlap. Readings tried on PSO alone have no rank.
    """
    own = table.set_index(["reading", "combination", "algorithm"])[["claimed s", "low s", "high s"]]
    found = []
    for reading, combination in [(r, c) for r in READINGS for c in table["combination"].unique()]:
        if reading.algorithms != ALGORITHMS and not reading.beside:
            continue
        sources = {a: reading.name if a in reading.algorithms else reading.beside
                   for a in ALGORITHMS}  # fmt: skip
        cells = {NAMES[a]: own.loc[(name, combination, NAMES[a])] for a, name in sources.items()}
        off = [cells[NAMES[a]]["claimed s"] / running_times()[a] - 1 for a in ALGORITHMS]
        found.append({"reading": reading.name, "combination": combination, "order": order(cells),
                      "worst difference %": 100 * float(np.abs(off).max())})  # fmt: skip
    return pd.DataFrame(found).sort_values("worst difference %")


def order(cells: dict[str, pd.Series[Any]]) -> str:
    """Algorithms by median, `<` where their intervals are apart."""
    names = sorted(cells, key=lambda name: float(cells[name]["claimed s"]))
    text = names[0]
    for before, after in itertools.pairwise(names):
        apart_ = cells[before]["high s"] < cells[after]["low s"]
        text += f" {'<' if apart_ else '≈'} {after}"
    return text


def claims(table: pd.DataFrame, ranked: pd.DataFrame) -> pd.DataFrame:
    """What all readings together say."""
    best, published = ranked.iloc[0], running_times()
    honest = table[table["passes together"] & (table["keeps limits"] == 1)]["claimed s"].min()
    first = int(ranked["order"].str.startswith("ISSA <").sum())
    where = f"{best['reading']}, {best['combination']}"
    rows = [
        ("one reading gives all three running times (worst difference, %)", 0.0,
         best["worst difference %"], best["worst difference %"] < 100 * NEAR, where),
        (f"readings, of {len(ranked)}, with ISSA before both others", np.nan, first, first > 0,
         "their intervals apart"),
        ("ISSA's time, limits kept and points passed together (s)", published["issa"], honest,
         honest < (1 + NEAR) * published["issa"], "the shortest median of any reading"),
    ]  # fmt: skip
    frame = pd.DataFrame(rows, columns=["claim", "paper", "ours", "verdict", "note"])
    frame["verdict"] = np.where(frame["verdict"], "reproduced", "not reproduced")
    return frame.assign(command="python -m experiments.paper_readings")


def main(
    seeds: int = 50, *, quick: bool = False, output: Path = Path("results/paper_readings")
) -> None:
    """Search under every reading, and print what comes near the published running times."""
    seeds, iterations = (4, 20) if quick else (seeds, 1000)
    tasks = [(r, a, t) for r in READINGS for a in r.algorithms for t in TIMINGS]
    found: list[dict[str, Any]] = []
    with console.progress(len(tasks)) as advance:
        for reading, algorithm, timing in tasks:
            file = f"{reading.name}-{algorithm}-{timing}-{seeds}x{iterations}.npz"
            search = partial(reading.search, algorithm, timing, seeds, iterations)
            runs = kept(output / "runs" / file.replace(" ", "_"), search)
            found += rows(reading, algorithm, timing, runs.times)
            advance(1)
    table = pd.DataFrame(found)
    tables = {"readings": table, "nearest": nearest(table), "ranking": ranking(table)}
    tables["claims"] = claims(table, tables["ranking"])
    for name, own in tables.items():
        save_table(own, output / name)
    plots.save(paper_figures.readings(table, [r.name for r in READINGS]), output / "readings")
    print(tables["nearest"].to_string(index=False, float_format="{:.4f}".format))
    print(tables["ranking"].head(12).to_string(index=False, float_format="{:.2f}".format))
    print(tables["claims"].drop(columns="command").to_string(index=False))
    print(f"{len(table)} values; {100 * chance(table):.0f} % of all times from 3 to 4 s lie within "
          "1 % of one of them.")  # fmt: skip


if __name__ == "__main__":
    cyclopts.run(main)
