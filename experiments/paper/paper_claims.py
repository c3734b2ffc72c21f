"""The paper's quantitative claims beside our numbers, and the verdict on each."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from experiments.paper.equations import CENTRE, HOLDS
from experiments.paper.kept_searches import ALGORITHMS, Found, percent_below, reference
from trajopt import Problem
from trajopt.views.analysis import statistics

Estimates = dict[str, statistics.Estimate]  # by the keys of `data/reference/claims.csv`

COMMAND = "python -m experiments.paper_study"


def estimates(tables: dict[str, pd.DataFrame]) -> Estimates:
    """Our numbers in the study's tables."""
    ours = _angles(tables["table2"])
    for _, row in tables["running-times"].iterrows():
        prefix = "segment-wise"
        if row["timing"] == "shared":
            prefix = "time"
        algorithm = row["algorithm"]
        ours[f"{prefix}-{algorithm}"] = statistics.Estimate(
            row["claimed s"], row["low s"], row["high s"]
        )
    for name in ("table4", "table5"):
        for _, row in tables[name].iterrows():
            if row["measure"] == "evaluations":
                continue
            joint = row["joint"]
            other = row["ISSA over"].lower()
            ours[f"{name}-{joint}-{other}"] = statistics.Estimate(
                row["ours %"], row["low %"], row["high %"]
            )
    return ours


def equations(table: pd.DataFrame) -> Estimates:
    """Errors of the equations as printed; those that hold, and those of the wrist, by the worst."""
    printed = table.set_index("key")["as printed"]
    ours = {str(key): exactly(error) for key, error in printed.items()}
    for key, words in (("eq-hold", HOLDS), ("eq-wrist", CENTRE)):
        ours[key] = exactly(table.loc[table["right"] == words, "as printed"].max())
    return ours


def _angles(table: pd.DataFrame) -> Estimates:
    """Table 2: how many angles are the paper's, and the one that a singularity leaves free."""
    free = table.query("point == 2 and joint in (4, 6)")
    fixed = table.drop(free.index)
    same = fixed["difference"].abs() < 1e-6
    degrees = free["ours deg"].iloc[0]
    return {"table2-fixed": exactly(same.sum()), "table2-free": exactly(degrees)}


def totals(found: Found, problem: Problem) -> Estimates:
    """Claims on shared times: who is how much faster, and the shortest of all runs."""
    durations = {}
    for name in ALGORITHMS:
        times = found[name, "shared"].times[:, 1]
        durations[name] = times.sum(axis=1)
    issa = durations["issa"]
    fixed = np.full(2, 6.0)  # s, the unoptimised 3-5-3
    medians = [np.median(durations[name]) for name in ALGORITHMS]
    shortest = min(times.min() for times in durations.values())
    faster = sum(median < np.median(issa) for median in medians)
    joint1 = 0.0
    if problem.moving[0]:
        joint1 = np.nan
    return {
        "below-ssa": statistics.bootstrap(percent_below, issa, durations["ssa"]),
        "below-pso": statistics.bootstrap(percent_below, issa, durations["pso"]),
        "below-unoptimised": statistics.bootstrap(percent_below, issa, fixed),
        "rank": exactly(1 + faster),
        "shortest-shared": exactly(shortest),
        "joint1": exactly(joint1),
    }


def exactly(value: float) -> statistics.Estimate:
    """A number that no seed changes."""
    number = float(value)
    return statistics.Estimate(number, number, number)


def verdict(row: dict[str, Any], ours: Estimates) -> str:
    """Return whether our interval, widened by the slack, holds the paper's number but not zero.

    Undecided: the text contradicts itself or leaves it open, or what misses with shared times is
    met by the segment-wise maximum of joints searched alone, and the text does not say which.
    """
    key = str(row["key"])
    number = row["paper"]
    held = []
    for read in (key, key.replace("time-", "segment-wise-")):
        if read in ours:
            holds = _holds(ours[read], number, row["slack"])
            held.append(holds)
    if held and held[0]:
        return "reproduced"
    if any(held) or key not in ours or key == "table2-free":
        return "cannot be decided from the text"
    return "not reproduced"


def _holds(ours: statistics.Estimate, number: float, slack: float) -> bool:
    low = ours.low - slack
    high = ours.high + slack
    if not low <= number <= high:
        return False
    nothing = ours.low <= 0 <= ours.high
    return bool(number == 0 or not nothing)


def claims(ours: Estimates) -> pd.DataFrame:
    """Every quantitative claim of the paper: its number, ours, the difference, the verdict."""
    published = reference("claims").fillna({"key": "", "note": ""})
    unknown = exactly(np.nan)
    rows = []
    for row in published.to_dict("records"):
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
