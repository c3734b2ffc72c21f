"""What do the reference planners cost: as problems grow, many together, and beside TOPP-RA?

    python -m experiments.scaling                # up to 1000 waypoints, some minutes on a core
    python -m experiments.scaling --quick        # up to 20, and 20 together

Four tables. `scaling.csv`: random walks of seven joints, each the beginning of a longer one, with
the limits that a planner knows. The times are CPU seconds of a planner's first `solve` at a size.
They include building IPOPT's program, if it uses IPOPT, but no imports, since another problem is
solved before. The slope is the power of the number of waypoints, fitted from `FITTED_FROM`
waypoints on.

`batches.csv`: problems like six-axis, solved by one call of `solve_many`, and their motions judged
by one of `verify_many`, against one by one. Its memory is the most that one call of `solve_many`
holds at a time, measured in a call of its own.

`beside.csv`: the exact optimum and one path by TOPP-RA, at three sizes. TOPP-RA takes only the
velocity and acceleration limits, and its motion is that of one cubic spline.

`long.csv`: what `verify` takes for a motion of many pieces, and what it holds beside it.

Rows go to `--output` as soon as they are known, and running again does only what is missing; the
figure is `scaling.png` and `.svg`.
"""

from __future__ import annotations

import pickle
import time
import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import cyclopts
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from experiments.common.kept import kept
from experiments.common.output import save_table
from trajopt import Limits, Problem, verify, verify_many
from trajopt.benchmark.suites import catalogue
from trajopt.core.limits import KINDS
from trajopt.core.trajectory import Trajectory
from trajopt.planners.registry import load
from trajopt.views.figures import plots

JOINTS = 7
# Waypoints.
SIZES = {
    "exact": (3, 5, 10, 20, 50, 100, 200, 500, 1000),
    "exact-jerk": (3, 5, 10, 20, 50, 100, 200, 300),
    "collocation-refined": (3, 5, 10, 20, 30),
}
WARM_UP = 4  # waypoints of a problem that is not measured
FITTED_FROM = 10
MARGIN = 0.02  # of position limits beyond the outermost waypoints, rad
KEY = ["planner", "waypoints"]
BATCHES = (1, 10, 100, 1000)
ONE_BY_ONE = 100  # at most so many of them are solved one by one
SPREAD = 0.3  # standard deviation of a waypoint's coordinate from six-axis's, rad
JERK_PER_ACCELERATION = 10.0  # 1/s, of the jerk limits of `exact-jerk`
PEERS = {
    "exact": "exact",
    "TOPP-RA, 100 intervals": "toppra:knots=chord,ends=clamped,gridpoints=100",
    "TOPP-RA, 1000 intervals": "toppra:knots=chord,ends=clamped,gridpoints=1000",
}
REPEATS = 3
CALLS = 30  # problems that are solved at least: one alone takes milliseconds
LONG = (200_000, 2_000_000)  # samples
MB = 1e6
CYCLE_S = 1e-3


def walk(waypoints: int, *, jerk: bool, position: bool) -> Problem:
    """Uniform steps of up to 1 rad; limits 1 rad/s, 2 rad/s²; 20 rad/s³ and positions, if any."""
    rng = np.random.default_rng(0)
    steps = rng.uniform(-1, 1, (waypoints, JOINTS))
    path = np.cumsum(steps, axis=0)
    each = np.ones(JOINTS)
    jerk_limits = 20 * each if jerk else None
    walls = None
    if position:
        lowest = path.min(axis=0) - MARGIN
        highest = path.max(axis=0) + MARGIN
        walls = np.stack([lowest, highest], axis=1)
    limits = Limits(each, 2 * each, jerk_limits, walls)
    return Problem(path, limits, name=f"walk-{waypoints}")


def measured(planner: str, waypoints: int) -> list[dict[str, float]]:
    """One size's row: CPU seconds, the certified duration (s), and how many starts it took."""
    tried = load(planner)
    planned = {key: tried.plans_for(KINDS[key]) for key in ("jerk", "position")}
    problem = walk(waypoints, **planned)
    solve = tried.solve
    solve(walk(WARM_UP, **planned))
    began = time.process_time()
    solution = solve(problem)
    seconds = time.process_time() - began
    certified = np.nan
    if solution.trajectory is not None:
        certified = verify(problem, solution.trajectory).certified_duration or np.nan
    row = {
        "cpu s": seconds,
        "starts": len(solution.stats["start_status"]),
        "certified duration s": certified,
    }
    return [row]


def like_six_axis(count: int, *, jerk: bool) -> list[Problem]:
    """Problems of the shape and the limits of six-axis, their waypoints moved at random."""
    rng = np.random.default_rng(0)
    base = catalogue.load("six-axis")
    limits = base.limits
    if jerk:
        each = np.abs(limits.acceleration).min(axis=1)
        limits = Limits(limits.velocity, limits.acceleration, JERK_PER_ACCELERATION * each)
    paths = base.waypoints + rng.normal(0, SPREAD, (count, *base.waypoints.shape))
    return [
        replace(base, waypoints=path, limits=limits, name=f"like-{i}")
        for i, path in enumerate(paths)
    ]


def together(planner: str, count: int) -> list[dict[str, float]]:
    """One batch's row: CPU ms a problem, together and one by one, and MB of memory."""
    tried = load(planner)
    problems = like_six_axis(count, jerk=tried.plans_for(KINDS["jerk"]))
    some = problems[:ONE_BY_ONE]
    times = max(REPEATS, CALLS // count)
    tried.solve(problems[0])
    spent, many = least(lambda: tried.solve_many(problems), times)
    alone, one_by_one = least(lambda: [tried.solve(problem) for problem in some], times)
    motions = [solution.trajectory for solution in many]
    copies = [fresh(motions) for _ in range(times)]
    judging, certificates = least(lambda: verify_many(problems, copies.pop()), times)
    copies = [fresh(motions[:ONE_BY_ONE]) for _ in range(times)]
    judging_alone, _ = least(lambda: list(map(verify, some, copies.pop())), times)
    tracemalloc.start()
    tried.solve_many(problems)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    pairs = zip(durations(many), durations(one_by_one), strict=False)
    alike = zip(certificates, map(verify, problems, fresh(motions)), strict=True)
    row = {
        "together ms": 1e3 * spent / count,
        "one by one ms": 1e3 * alone / len(some),
        "judged together ms": 1e3 * judging / count,
        "judged one by one ms": 1e3 * judging_alone / len(some),
        "other certificates": sum(own != other for own, other in alike),
        "MB": most / 1e6,
        "largest difference": max(abs(own / other - 1) for own, other in pairs),
    }
    return [row]


def fresh(motions: list[Any]) -> list[Any]:
    """Return copies of motions, of which nothing has been computed."""
    return [pickle.loads(pickle.dumps(motion)) for motion in motions]


def durations(solutions: list[Any]) -> list[float]:
    return [solution.trajectory.duration for solution in solutions]


def least(call: Callable[[], Any], times: int = REPEATS) -> tuple[float, Any]:
    """The least CPU time of some calls, s, and what the last returned."""
    spent = []
    for _ in range(times):
        began = time.process_time()
        found = call()
        spent.append(time.process_time() - began)
    return min(spent), found


def sizes(quick: bool) -> dict[str, Problem]:
    """Problems of three sizes, waypoints × joints, under limits of velocity and acceleration."""
    rng = np.random.default_rng(1)
    flat = np.cumsum(rng.uniform(-1, 1, (300, 2)), axis=0)
    problems = {"six-axis (4 × 6)": catalogue.load("six-axis").without("jerk", "position")}
    if not quick:
        problems["100 × 7"] = walk(100, jerk=False, position=False)
        problems["300 × 2"] = Problem(flat, Limits([1.0] * 2, [2.0] * 2), "300 × 2")
    return problems


def beside(peer: str, problem: Problem) -> list[dict[str, float]]:
    """One peer's row: CPU ms, and the certified duration in s."""
    planner = load(PEERS[peer])
    planner.solve(walk(WARM_UP, jerk=False, position=False))
    spent, solution = least(lambda: planner.solve(problem))
    certified = verify(problem, solution.trajectory).certified_duration or np.nan
    return [{"ms": 1e3 * spent, "certified duration s": certified}]


def long_motion(samples: int, position: bool) -> list[dict[str, float]]:
    """Judge cubics of six joints from samples every millisecond, between their own ends.

    Returns:
        The size of the motion, and the most memory that `verify` holds beside it, MB; CPU time, s.
    """
    rng = np.random.default_rng(0)
    times = np.arange(samples) * CYCLE_S
    rate, phase = rng.uniform(0.5, 2.0, 6), rng.uniform(0.0, 6.0, 6)
    angle = rate * times[:, None] + phase
    motion = Trajectory.from_samples(times, 0.5 * np.sin(angle), 0.5 * rate * np.cos(angle))
    walls = [[-3.0, 3.0]] * 6 if position else None
    ends: dict[str, Any] = {
        f"{end}_velocity": motion(t, 1) for end, t in (("start", 0.0), ("end", times[-1]))
    }
    limits = Limits([3.0] * 6, [10.0] * 6, position=walls)
    problem = Problem(motion(motion.waypoint_times), limits, **ends)
    arrays = motion.breaks, motion.coefficients, motion.lengths
    tracemalloc.start()
    began = time.process_time()
    verify(problem, motion)
    cpu = time.process_time() - began
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    sizes = sum(array.nbytes for array in arrays) / MB, most / MB
    return [{"motion, MB": sizes[0], "CPU s": cpu, "MB": sizes[1]}]


def slope(rows: pd.DataFrame) -> float:
    """The power of the waypoints that a planner's times grow with; NaN of one size alone."""
    fitted = rows[rows["waypoints"] >= FITTED_FROM]
    if len(fitted) < 2:
        return np.nan
    powers = np.polyfit(np.log(fitted["waypoints"]), np.log(fitted["cpu s"]), deg=1)
    return float(powers[0])


@plots.styled
def drawn(table: pd.DataFrame) -> Figure:
    """Times against waypoints on logarithmic axes, a curve per planner with its slope above."""
    figure = Figure(figsize=(5.4, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.set_xscale("log")
    axes.set_yscale("log")
    by_planner = table.groupby("planner")
    for planner, own in by_planner:
        own = own.sort_values("waypoints")
        x = own["waypoints"]
        power = slope(own)
        label = planner if np.isnan(power) else f"{planner}: slope {power:.2f}"
        colour = plots.planner_look(planner)["color"]
        axes.plot(x, own["cpu s"], color=colour, marker=plots.planner_mark(planner), label=label)
    axes.set_xlabel("waypoints")
    axes.set_ylabel("CPU time, s")
    figure.legend(loc="outside upper left")
    return figure


def main(most: int = 1000, output: Path = Path("results/scaling"), quick: bool = False) -> None:
    """Measure what is missing, print the tables and the slopes, draw the times of one problem.

    Args:
        most: Number of waypoints, and of problems together.
        output: Folder.
        quick: Up to 20 waypoints, and 20 problems together.
    """
    if quick:
        most = min(most, 20)
    cells = {}
    for planner, counts in SIZES.items():
        for waypoints in counts:
            if waypoints <= most:
                cells[planner, waypoints] = partial(measured, planner, waypoints)
    table = kept(output / "scaling.csv", KEY, cells)
    save_table(table, output / "scaling")
    print(table.to_string(index=False, float_format="{:.3g}".format))
    for planner, rows in table.groupby("planner"):
        if not np.isnan(power := slope(rows)):
            print(f"{planner}: time grows as waypoints to the power {power:.2f}")
    plots.save(drawn(table), output / "scaling")
    batches = {
        (planner, count): partial(together, planner, count)
        for planner in ("exact", "exact-jerk")
        for count in BATCHES
        if count <= most
    }
    peers = {
        (size, peer): partial(beside, peer, problem)
        for size, problem in sizes(quick).items()
        for peer in PEERS
    }
    motions = {
        (samples, walls): partial(long_motion, samples, walls == "yes")
        for samples in ([2000, 4000] if quick else LONG)
        for walls in ("no", "yes")
    }
    found = [
        ("long", kept(output / "long.csv", ["samples", "position limits"], motions)),
        ("batches", kept(output / "batches.csv", ["planner", "problems"], batches)),
        ("beside", kept(output / "beside.csv", ["waypoints × joints", "planner"], peers)),
    ]
    for name, table in found:
        save_table(table, output / name)
        print(table.to_string(index=False, float_format="{:.3g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
