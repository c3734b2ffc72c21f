"""`trajopt prove`: prove a lower bound on the minimum time."""

from __future__ import annotations

import time
from math import isfinite, nan
from pathlib import Path
from typing import Annotated, Any, Literal

from trajopt.cli import asked, console
from trajopt.cli.asked import NO_FLAGS, RobotFlags
from trajopt.cli.parameters import MAX_SECONDS, Json, ProblemName, number
from trajopt.core.exceptions import TrajoptError
from trajopt.core.numerals import rounded_down
from trajopt.core.solution import Status
from trajopt.judging.verification import verify
from trajopt.planners.registry import configured, entries

_LEFT_OUT = "limits left out"


def prove(
    problem: ProblemName,
    *,
    robot: RobotFlags = NO_FLAGS,
    family: Literal["free", "spline353"] = "free",
    within: Annotated[float, number("Relative gap of both bounds at which to stop.")] = 1e-4,
    time_limit: Annotated[
        float, number("CPU seconds; then the bounds so far are the answer.", most=MAX_SECONDS)
    ] = 60.0,
    json: Json = False,
) -> int:
    """Prove a lower bound on the minimum time.

    Args:
        family: Any trajectory, or the 3-5-3 spline with shared times.
    """
    loaded = asked.problem(problem, robot, scaled=True)
    options = {"family": family, "within": within, "time_limit": time_limit}
    planner = configured(entries()["prove"].load(), options, "prove")
    began = time.perf_counter()
    proof = planner.solve(loaded)
    if proof.status is Status.UNSUPPORTED:
        raise TrajoptError(proof.message)
    if proof.status is Status.INFEASIBLE:
        return _infeasible(loaded.name, asked.file(problem), family, proof.message, as_json=json)
    table = {
        "problem": loaded.name,
        "problem_file": asked.file(problem),
        "family": family,
        "lower_bound": proof.stats["lower_bound"],
        "upper_bound": proof.stats["upper_bound"],
        "proved_within": proof.stats["proved_within"],
        "status": proof.stats["proof"],
        "solve_time": time.perf_counter() - began,
    }
    if proof.status is Status.RELAXED and proof.trajectory is not None:
        # the bound holds without the limits that it leaves out; the motion may break them
        upper = verify(loaded, proof.trajectory).certified_duration or nan
        table["upper_bound"] = upper
        table["proved_within"] = upper / proof.stats["lower_bound"] - 1
        if not table["proved_within"] <= within:
            table["status"] = _LEFT_OUT
    if json:
        console.print_json(table)
    else:
        _print(table, proof.message)
    return 0


def _infeasible(name: str, file: Path | None, family: str, reason: str, *, as_json: bool) -> int:
    """Print that no motion keeps the limits, and why."""
    if as_json:
        table = {"problem": name, "problem_file": file, "family": family}
        console.print_json(table | {"status": str(Status.INFEASIBLE), "message": reason})
    else:
        console.headline("", f"{_what(name, family)}: ", str(Status.INFEASIBLE))
        console.paragraph(f"  {reason}")
    return 0


def _what(name: str, family: str) -> str:
    """Return which motions of a problem the bound is about, in words."""
    return name if family == "free" else f"{name}, {family} splines alone"


def _print(table: dict[str, Any], message: str) -> None:
    """Print the bounds; the planner's message gives the reason for a gap between them."""
    console.headline("", f"{_what(table['problem'], table['family'])}: ", table["status"])
    console.line(f"  lower bound {rounded_down(table['lower_bound'], '.9f')} s")
    if isfinite(table["proved_within"]):
        console.line(
            f"  upper bound {table['upper_bound']:.9f} s, a verified trajectory's duration"
        )
        console.line(f"  within      {100 * table['proved_within']:.6f} %")
        if table["status"] != "proved":
            console.paragraph(message)
    else:
        console.line("  upper bound none")
    if not isfinite(table["proved_within"]) or table["status"] == _LEFT_OUT:
        console.paragraph(f"  {message}")
    console.line(f"  computing   {table['solve_time']:.2f} s")
