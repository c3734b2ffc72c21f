"""How smooth can the motions of ten problems be, proved with whole numbers?

    python -m experiments.fronts --output data/fronts
    python -m experiments.fronts --quick                  # one problem, five seconds a proof

Writes a record a problem: the problem, its smoothest motions known, and proofs over all segment
times. `trajopt/judging/check_front.py` checks a record in exact fractions. What it proves is the
record's lower bound. The table goes to standard output.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np

from baselines.front.bound import FrontBound, FrontProof
from baselines.front.curve import LIMITS_WITHIN, bound_with_limits, free_bound
from baselines.front.least import Least, least
from baselines.lower_bound.incumbent import incumbent
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.problem import Problem
from trajopt.judging.proved_bounds import proved_integral

PROBLEMS = (
    "six-axis",
    "one-joint",
    "asymmetric",
    "reversal",
    "repeated",
    "resting-joint",
    "yu2025-task4",
    "random-zigzag-j3-w3-11",
    "random-smooth-j3-w4-01",
    "random-zigzag-j7-w3-01",
)
FACTORS = (1.2, 1.5, 2.0, 3.0)  # durations, relative to the shortest known
_POWER = 5  # power of the duration in the least ∫ jerk²
_DIGITS = 12  # digits of a costate; any costates prove a bound
_SAFETY = 1 - 1e-12


def record(problem: Problem, seconds: float) -> dict[str, Any]:
    """Return the record of a problem's front."""
    merged, _ = problem.merged()
    known = incumbent(merged, 10.0)
    assert known is not None
    proofs: list[dict[str, Any]] = []
    free = free_bound(merged, "jerk", seconds)
    free_lower = added(proofs, merged, free)
    points = []
    for factor in FACTORS:
        found = least(merged, "jerk", factor * known.duration, known.trajectory)
        assert found is not None
        lower, place = free_lower / found.duration**_POWER, 0
        if found.limits_act and lower < found.value * (1 - LIMITS_WITHIN):
            bound = bound_with_limits(merged, "jerk", found, seconds)
            if bound.lower > lower:
                lower, place = added(proofs, merged, bound), len(proofs) - 1
        points.append(point(found, lower, place))
    return {
        "schema": "trajopt-front-2",
        "problem": stated_problem(merged),
        "measure": "jerk",
        "points": points,
        "proofs": proofs,
    }


def added(proofs: list[dict[str, Any]], problem: Problem, bound: FrontBound) -> float:
    """Keep a proof, and return what the exact check says that it proves."""
    tables = vars(shortened(bound.proof))
    proofs.append({name: table.tolist() for name, table in tables.items()})
    return proved_integral(problem, tables, bound.lower) * _SAFETY


def shortened(proof: FrontProof) -> FrontProof:
    """The proof with short decimals for its costates."""
    table = np.array(proof.costates)
    digits = np.vectorize(lambda value: float(f"{value:.{_DIGITS}g}"), otypes=[float])
    if len(table):
        table[:, 3:] = digits(table[:, 3:])
    return FrontProof(**{**vars(proof), "costates": table})


def point(found: Least, lower: float, proof: int) -> dict[str, Any]:
    """A point of a record."""
    motion = found.trajectory
    return {
        "duration": found.duration,
        "value": found.value,
        "lower": lower,
        "proof": proof,
        "trajectory": {
            "breaks": motion.breaks.tolist(),
            "coefficients": motion.coefficients.tolist(),
            "waypoint_times": motion.waypoint_times.tolist(),
        },
    }


def stated_problem(problem: Problem) -> dict[str, Any]:
    """The problem's numbers."""
    return {
        "name": problem.name,
        "digest": problem.digest(),
        "waypoints": problem.waypoints.tolist(),
        "limits": {
            name: [
                [side if np.isfinite(side) else None for side in pair] for pair in table.tolist()
            ]
            for name, table in problem.limits.by_name().items()
        },
        "joint_units": list(problem.joint_units),
    }


def main(
    output: Path = Path("fronts"),
    problem: list[str] | None = None,
    seconds: float = 60.0,
    quick: bool = False,
) -> None:
    """Write the records.

    Args:
        output: Folder.
        problem: Names; all ten by default.
        seconds: Of CPU time, for a proof.
        quick: One problem, five seconds a proof.
    """
    output.mkdir(parents=True, exist_ok=True)
    print("problem,duration,value,lower,gap_percent")
    for name in ["one-joint"] if quick else problem or PROBLEMS:
        found = record(load(name), 5.0 if quick else seconds)
        path = output / f"{name}.json"
        path.write_text(json.dumps(found, separators=(",", ":")) + "\n", encoding="utf-8")
        for own in found["points"]:
            gap = 100 * (1 - own["lower"] / own["value"])
            cells = f"{own['duration']:.6g},{own['value']:.6g},{own['lower']:.6g},{gap:.2f}"
            print(f"{name},{cells}", flush=True)


if __name__ == "__main__":
    cyclopts.run(main)
