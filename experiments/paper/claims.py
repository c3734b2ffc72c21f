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
    ours = _angles(tables["table2"])
    for _, row in tables["running-times"].iterrows():
        prefix = "time" if row["timing"] == "shared" else "segment-wise"
        key = f"{prefix}-{row['algorithm']}"
        ours[key] = statistics.Estimate(row["claimed s"], row["low s"], row["high s"])
    for name in ("table4", "table5"):
        for _, row in tables[name].iterrows():
            if row["measure"] == "evaluations":
                continue
            key = f"{name}-{row['joint']}-{row['ISSA over'].lower()}"
            ours[key] = statistics.Estimate(row["ours %"], row["low %"], row["high %"])
    return ours


def _angles(table: pd.DataFrame) -> dict[str, statistics.Estimate]:
    """Table 2: how many angles are the paper's, and the one that a singularity leaves free."""
    free = table.query("point == 2 and joint in (4, 6)")
    fixed = table.drop(free.index)
    same = fixed["difference"].abs() < 1e-6
    return {
        "table2-fixed": exactly(same.sum()),
        "table2-free": exactly(free["ours deg"].iloc[0]),
    }


def totals(found: Found, problem: Problem) -> dict[str, statistics.Estimate]:
    """Claims on shared times: who is how much faster, and the shortest of all runs."""
    own = {name: found[name, "shared"].times[:, 1].sum(axis=1) for name in ALGORITHMS}
    issa = own["issa"]
    medians = {name: np.median(times) for name, times in own.items()}
    faster = [name for name in ALGORITHMS if medians[name] < medians["issa"]]
    shortest = min(float(times.min()) for times in own.values())
    unoptimised = np.full(2, 6.0)
    return {
        "below-ssa": statistics.bootstrap(percent_below, issa, own["ssa"]),
        "below-pso": statistics.bootstrap(percent_below, issa, own["pso"]),
        "below-unoptimised": statistics.bootstrap(percent_below, issa, unoptimised),
        "rank": exactly(1 + len(faster)),
        "shortest-shared": exactly(shortest),
        "joint1": exactly(np.nan if problem.moving[0] else 0.0),
    }


def exactly(value: float) -> statistics.Estimate:
    return statistics.Estimate(float(value), float(value), float(value))


def verdict(row: dict[str, Any], ours: dict[str, statistics.Estimate]) -> str:
    """Whether our interval, widened by the slack, holds the paper's number, and not zero as well.

    Undecided: the text contradicts itself or leaves it open, or what misses with shared times is
    met by the segment-wise maximum of joints searched alone, and the text does not say which.
    """
    key = str(row["key"])
    held = []
    for read in (key, key.replace("time-", "segment-wise-")):
        if read in ours:
            held.append(_holds(ours[read], row["paper"], row["slack"]))
    if held and held[0]:
        return "reproduced"
    if any(held) or key not in ours or key == "table2-free":
        return "cannot be decided from the text"
    return "not reproduced"


def _holds(ours: statistics.Estimate, number: float, slack: float) -> bool:
    nothing = number != 0 and ours.low <= 0 <= ours.high
    within = ours.low - slack <= number <= ours.high + slack
    return bool(within and not nothing)


def claims(ours: dict[str, statistics.Estimate]) -> pd.DataFrame:
    """Every quantitative claim of the paper: its number, ours, the difference, the verdict."""
    unknown = exactly(np.nan)
    rows = []
    for row in reference("claims").fillna({"key": "", "note": ""}).to_dict("records"):
        own = ours.get(row["key"], unknown)
        claim = {
            "claim": row["claim"],
            "paper": row["paper"],
            "ours": own.value,
            "low": own.low,
            "high": own.high,
            "difference": own.value - row["paper"],
            "verdict": verdict(row, ours),
            "note": row["note"],
            "command": COMMAND,
        }
        rows.append(claim)
    return pd.DataFrame(rows)
