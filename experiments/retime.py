"""How fast is the planner `along` along a given path, beside TOPP-RA, COPP and itself?

    python -m experiments.retime            # 100 walks and more, some minutes on one core
    python -m experiments.retime --quick    # 3 walks of each kind

Random walks of 10 waypoints and six joints, with asymmetric limits; the path is the natural spline
over chords. Every duration is certified. `--suites` adds what the path costs: the best of twelve
splines beside the best known motion of each problem of two suites.

- grids: `along` and TOPP-RA at 1000, 4000 gridpoints over TOPP-RA at 16,000, minus 1;
- bound: the bound along the path over `along`, minus 1;
- copp: `along` over COPP on the same path, with jerk limits (needs `copp-py`), minus 1;
- uniform: `along` over the uniform dilation of a quintic law, with jerk limits, minus 1; and over
  the proved bound of all motions through the waypoints, along any path;
- relations: the path reversed, the time in other units, another parameter, over the path itself;
- stops: `ruckig-stop` retimed over itself, minus 1; and the dilation of all answers.

Rows go to `retime.csv` in `--output` as soon as they are known.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Literal

import cyclopts
import numpy as np

from baselines.along.planner import Along
from baselines.topp_ra import ToppRa, backwards, spline
from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt import Limits, Problem, Solution, Status, Trajectory, verify
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue
from trajopt.planners.registry import load

WAYPOINTS, JOINTS = 10, 6
GRIDS = (1000, 4000, 16000)
ACCURACIES = (1e-3, 1e-4)
SUITES = ("robots", "random")
UNIT = 7.3  # s, of another clock
PROOF_S = 5
KEY = ["question", "number"]


def walk(number: int, *, jerk: bool) -> Problem:
    """Return normal steps with asymmetric limits; jerk 10 or 30 times the acceleration in 1/s."""
    rng = np.random.default_rng([64, number])
    waypoints = np.cumsum(rng.normal(size=(WAYPOINTS, JOINTS)), axis=0)

    def pairs(low: float, high: float) -> Any:
        return np.stack([-rng.uniform(low, high, JOINTS), rng.uniform(low, high, JOINTS)], axis=1)

    velocity, acceleration = pairs(1.0, 3.0), pairs(2.0, 8.0)
    factor = 10.0 if number % 2 else 30.0
    limits = Limits(velocity, acceleration, factor * acceleration if jerk else None)
    return Problem(waypoints, limits, f"walk-{number}")


def judged(problem: Problem, solution: Solution) -> tuple[float, float]:
    """Return the certified duration, s, and the dilation; NaN without a certificate."""
    if solution.trajectory is None:
        return np.nan, np.nan
    found = verify(problem, solution.trajectory)
    return found.certified_duration or np.nan, found.dilation


def measured(
    problem: Problem, path: Trajectory, accuracy: float = ACCURACIES[0]
) -> tuple[float, float, float]:
    """Return certified duration, s, dilation, and CPU seconds of `along`."""
    began = time.process_time()
    solution = Along(accuracy=accuracy).along(problem, path)
    seconds = time.process_time() - began
    return (*judged(problem, solution), seconds)


def row(measure: str, value: float, seconds: float = np.nan) -> dict[str, Any]:
    return {"measure": measure, "value": value, "cpu s": seconds}


def grids(number: int) -> Iterator[dict[str, Any]]:
    """Compare with TOPP-RA without jerk limits; the bound along the path."""
    problem = walk(number, jerk=False)
    path = spline(problem, "chord", "natural")
    durations = {}
    for size in GRIDS:
        began = time.process_time()
        solution = ToppRa(gridpoints=size).along(problem, path)
        seconds = time.process_time() - began
        durations[size] = judged(problem, solution)[0], seconds
    finest = durations[GRIDS[-1]][0]
    for size, (duration, seconds) in durations.items():
        yield row(f"TOPP-RA {size}", duration / finest - 1, seconds)
    for accuracy in ACCURACIES:
        duration, dilation, seconds = measured(problem, path, accuracy)
        yield row(f"along {accuracy:g}", duration / finest - 1, seconds)
        yield row(f"dilation {accuracy:g}", dilation - 1)
        began = time.process_time()
        bound = Along(accuracy=accuracy).bound(problem, path) or np.nan
        yield row(f"bound {accuracy:g}", bound / duration - 1, time.process_time() - began)


def jerk(number: int) -> Iterator[dict[str, Any]]:
    """Compare with COPP and with a uniform dilation, under jerk limits."""
    problem = walk(number, jerk=True)
    path = spline(problem, "chord", "natural")
    duration, dilation, seconds = measured(problem, path)
    yield row("dilation, jerk", dilation - 1)
    fine, _, longer = measured(problem, path, ACCURACIES[1])
    yield row("along 0.001 over 0.0001", duration / fine - 1, seconds)
    quintic = law(path)
    yield row(
        "over the uniform dilation of a quintic law", duration / judged(problem, quintic)[0] - 1
    )
    yield row("bound without jerk", (Along().bound(problem, path) or np.nan) / duration - 1)
    proved = load(f"prove:time_limit={PROOF_S}").solve(problem).stats["lower_bound"]
    yield row("over the proved bound of any path", duration / float(proved) - 1)
    if find_spec("copp_py") is not None:
        import copp_py

        from baselines.third_party.copp import Copp

        began = time.process_time()
        theirs = Copp()._along(problem, path, copp_py)
        cost = time.process_time() - began
        found = judged(problem, Solution(Status.SOLVED, theirs))[0]
        yield row("over COPP", duration / found - 1, cost)
        yield row("0.0001 over COPP", fine / found - 1, longer)


def law(path: Trajectory) -> Solution:
    """Return a path at the pace of the quintic from rest to rest."""
    pace = np.array([6.0, -15.0, 10.0, 0, 0, 0])[:, None, None] * path.duration
    whole = Trajectory(np.array([0.0, 1.0]), pace, np.array([0.0, 1.0]))
    shares = np.linspace(0, 1, 20001)
    times = np.interp(path.waypoint_times, whole(shares)[:, 0], shares)
    for _ in range(3):  # Newton's method
        rate = np.maximum(whole(times, 1)[:, 0], 1e-12)
        times = np.clip(times - (whole(times)[:, 0] - path.waypoint_times) / rate, 0, 1)
    times[[0, -1]] = 0.0, 1.0
    return Solution(Status.SOLVED, Trajectory.composed(path, whole, waypoint_times=times))


def relations(number: int) -> Iterator[dict[str, Any]]:
    """Compare a path with itself: reversed, on another clock, with another parameter; and stops."""
    for limited in (False, True):
        problem = walk(number, jerk=limited)
        path = spline(problem, "chord", "natural")
        word = "jerk" if limited else "no jerk"
        for accuracy in ACCURACIES:
            own, *_ = measured(problem, path, accuracy)
            there = replace(
                problem, waypoints=problem.waypoints[::-1].copy(), limits=_mirrored(problem)
            )
            yield row(
                f"reversed, {word}, {accuracy:g}",
                measured(there, backwards(path), accuracy)[0] / own - 1,
            )
            clock = replace(problem, limits=problem.limits.in_units(UNIT, 1.0))
            yield row(
                f"other clock, {word}, {accuracy:g}",
                measured(clock, path, accuracy)[0] * UNIT / own - 1,
            )
            other = law(path).trajectory
            assert other is not None
            yield row(
                f"other parameter, {word}, {accuracy:g}",
                measured(problem, other, accuracy)[0] / own - 1,
            )
        even = replace(problem, limits=_symmetric(problem))  # Ruckig knows no other jerk limits
        stopping = load("ruckig-stop").solve(even).trajectory
        assert stopping is not None
        duration, _, seconds = measured(even, stopping)
        yield row(f"ruckig-stop over itself, {word}", duration / stopping.duration - 1, seconds)


def _symmetric(problem: Problem) -> Limits:
    """Return the tighter side of all limits, for both sides."""
    own = problem.limits
    sides = [np.abs(pairs).min(axis=1) for pairs in (own.velocity, own.acceleration, own.jerk)]
    return Limits(*sides[: 3 if problem.has("jerk") else 2])


def _mirrored(problem: Problem) -> Limits:
    """Return the limits of motions backwards in time: velocity and jerk change their sign."""
    own = problem.limits
    jerk = -own.jerk[:, ::-1] if problem.has("jerk") else None
    return Limits(-own.velocity[:, ::-1], own.acceleration, jerk)


def price(suite: str, problem: Problem) -> Iterator[dict[str, Any]]:
    """Compare the best of twelve splines, timed by `along`, with the best known motion."""
    known = records.find(problem)
    planner = load("along")
    if known is None or planner.unsupported(problem):
        return
    began = time.process_time()
    solution = planner.solve(problem)
    seconds = time.process_time() - began
    above = judged(problem, solution)[0] / known.duration - 1
    yield row(f"path over best known, {suite}", above, seconds)


def main(
    walks: int = 100,
    output: Path = Path("results/retime"),
    quick: bool = False,
    suites: bool = False,
    only: Literal["all", "grids", "jerk", "relations", "price"] = "all",
) -> None:
    """Measure everything that is missing, and print medians and extremes.

    `walks`: of each kind, a quarter of them for the relations; `suites`: what the path costs, too;
    `quick`: 3 walks.
    """
    count = 3 if quick else walks
    cells: dict[Any, Any] = {}
    for question in (grids, jerk, relations):
        if only not in ("all", question.__name__):
            continue
        for number in range(count if question is not relations else max(count // 4, 3)):
            cells[question.__name__, str(number)] = partial(_listed, question, number)
    if suites:
        for suite in SUITES:
            for problem in catalogue.problems(suite)[:: 20 if quick else 1]:
                cells["price", problem.name] = partial(_listed, price, suite, problem)
    table = kept(output / "retime.csv", KEY, cells)
    found = table.groupby("measure", sort=False).agg(
        count=("value", "count"),
        median=("value", "median"),
        least=("value", "min"),
        most=("value", "max"),
        cpu=("cpu s", "median"),
    )
    save_table(found, output / "summary")
    print(found.to_string(float_format="{:.3g}".format))


def _listed(question: Any, *of: Any) -> list[dict[str, Any]]:
    return list(question(*of))


if __name__ == "__main__":
    cyclopts.run(main)
