"""The paper's quantitative claims beside our numbers, and the verdict on each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from experiments.paper.searches import ALGORITHMS, Found, percent_below, reference
from trajopt import Problem
from trajopt.benchmark.analysis import statistics

COMMAND = "python -m experiments.paper_study"


def estimates(tables: dict[str, pd.DataFrame]) -> dict[str, statistics.Estimate]:
    """Our numbers by the keys of `data/reference/claims.csv`."""
    angles, times = tables["table2"], tables["running-times"].set_index(["timing", "algorithm"])
    free = angles.query("point == 2 and joint in (4, 6)")
    fixed = (angles.drop(free.index)["difference"].abs() < 1e-6).sum()
    ours = {"table2-fixed": exactly(fixed), "table2-free": exactly(free["ours deg"].iloc[0])}
    for (timing, name), row in times.iterrows():
        prefix = "time" if timing == "shared" else "segment-wise"
        three = [row[column] for column in ("claimed s", "low s", "high s")]
        ours[f"{prefix}-{name}"] = statistics.Estimate(*three)
    for name in ("table4", "table5"):
        for row in tables[name][tables[name]["measure"] != "evaluations"].to_dict("records"):
            key = f"{name}-{row['joint']}-{row['ISSA over'].lower()}"
            ours[key] = statistics.Estimate(row["ours %"], row["low %"], row["high %"])
    return ours


def totals(found: Found, problem: Problem) -> dict[str, statistics.Estimate]:
    """Claims on shared times: who is how much faster, and the shortest of all runs."""
    own = {a: found[a, "shared"].times[:, 1].sum(axis=1) for a in ALGORITHMS}
    rank = 1 + sum(bool(np.median(own[a]) < np.median(own["issa"])) for a in ALGORITHMS)
    below = {a: statistics.bootstrap(percent_below, own["issa"], own[a]) for a in ("ssa", "pso")}
    below["unoptimised"] = statistics.bootstrap(percent_below, own["issa"], np.full(2, 6.0))
    shortest = min(float(times.min()) for times in own.values())
    return {f"below-{name}": e for name, e in below.items()} | {
        "rank": exactly(rank), "shortest-shared": exactly(shortest),
        "joint1": exactly(0.0 if not problem.moving[0] else np.nan),
    }  # fmt: skip


def exactly(value: float) -> statistics.Estimate:
    return statistics.Estimate(float(value), float(value), float(value))


def verdict(row: dict[str, Any], ours: dict[str, statistics.Estimate]) -> str:
    """Whether our interval, widened by the slack, holds the paper's number, and not zero as well.

    Undecided: the text contradicts itself or leaves it open, or what misses with shared times is
    met by the segment-wise maximum of joints searched alone, and the text does not say which.
    """
    keys = [row["key"], str(row["key"]).replace("time-", "segment-wise-")]
    held = [_holds(ours[key], row["paper"], row["slack"]) for key in keys if key in ours]
    if held and held[0]:
        return "reproduced"
    open_ = any(held) or row["key"] not in ours or row["key"] == "table2-free"
    return "cannot be decided from the text" if open_ else "not reproduced"


def _holds(e: statistics.Estimate, number: float, slack: float) -> bool:
    nothing = number != 0 and e.low <= 0 <= e.high
    return bool(e.low - slack <= number <= e.high + slack) and not nothing


def claims(ours: dict[str, statistics.Estimate]) -> pd.DataFrame:
    """Every quantitative claim of the paper: its number, ours, the difference, the verdict."""
    rows = []
    for row in reference("claims").fillna({"key": "", "note": ""}).to_dict("records"):
        e = ours.get(row["key"], statistics.Estimate(np.nan, np.nan, np.nan))
        rows.append({
            "claim": row["claim"], "paper": row["paper"], "ours": e.value, "low": e.low,
            "high": e.high, "difference": e.value - row["paper"], "verdict": verdict(row, ours),
            "note": row["note"], "command": COMMAND,
        })  # fmt: skip
    return pd.DataFrame(rows)
