"""Are the paper's tables and claims reproduced at its own settings?

    python -m experiments.paper_study                 # 50 seeds, 1000 iterations
    python -m experiments.paper_study --figures       # draws the paper's Figures 5 to 7 too
    python -m experiments.paper_study --quick         # small; not meaningful

The searches took 31 s of computing on a core of 2026. While it runs it says how long is left on
the machine at hand, and at the end what it took.

Where the text says nothing, the toolkit's defaults are used. Every table in `--output` holds ours,
the paper's and the difference: `table2`, `table4`, `table5`, `running-times`, `equations`, and
`claims` with a verdict on each. Searches are stored in `runs/`: running again does only what is
missing.

- Accuracy (Table 4): by how much ISSA's final duration of a joint alone is below the other's,
  `100 (1 − T_ISSA / T_other)`, medians over seeds.
- Speed (Table 5): likewise for the number of iterations after which a run stays within 1 % of its
  own end, as in a convergence plot; and for the number of evaluations, which is its cost.
- Intervals are 95 % bootstrap intervals over seeds.
"""

from __future__ import annotations

import itertools
import time
from functools import partial
from pathlib import Path

import cyclopts
import numpy as np
import pandas as pd

from experiments.common.output import progress, save_table, say
from experiments.paper import figures as paper_figures
from experiments.paper import kept_searches as paper
from experiments.paper.equations import checks
from experiments.paper.kept_searches import (
    ALGORITHMS,
    NAMES,
    Found,
    budget,
    interval,
    percent_below,
    reference,
)
from experiments.paper.paper_claims import claims, equations, estimates, totals
from trajopt import Problem, Trajectory, verify
from trajopt.benchmark.suites import catalogue as suite
from trajopt.core.arrays import Array
from trajopt.planners import spline353
from trajopt.planners.kinematics import Robot, cartesian_problem
from trajopt.planners.registry import configured, load
from trajopt.planners.swarm_planner import SwarmPlanner, Unoptimised
from trajopt.views.analysis import statistics
from trajopt.views.figures import plots

SETTLED = 1.01  # times a run's own final duration
TIMINGS = ("per-joint", "shared")


def table2(robot: Robot, problem: Problem) -> pd.DataFrame:
    """Joint angles from the poses of Table 2's points, each the nearest to the one before."""
    poses = robot.forward(problem.waypoints)
    ours = np.degrees(cartesian_problem(robot, poses, problem.limits).waypoints)
    table = reference("table2").drop(columns="source")
    table = table.rename(columns={"degrees": "paper deg"})
    point = table["point"] - 1
    joint = table["joint"] - 1
    table["ours deg"] = ours[point, joint].round(9) + 0.0  # no −0
    return table.assign(difference=table["ours deg"] - table["paper deg"])


def settled(curves: list[Array]) -> Array:
    """Evaluations until each run is within 1 % of its own end."""
    evaluations = []
    for curve in curves:
        spent, best = curve.T
        first = np.argmax(best <= SETTLED * best[-1])
        evaluations.append(spent[first])
    return np.array(evaluations)


def iterations(evaluations: Array, algorithm: str) -> Array:
    """The iterations that these evaluations belong to; the first population is iteration 0."""
    planner = load(algorithm)
    assert isinstance(planner, SwarmPlanner)
    beyond = np.maximum(evaluations - planner.optimiser.population, 0)
    return np.asarray(np.ceil(beyond / planner.optimiser.evaluations_per_iteration))


def table4(found: Found, joint: int, algorithm: str) -> dict[str, Array]:
    """Final durations of a joint alone, s."""
    curves = found[algorithm, "per-joint"].curves(joint - 1)
    return {"final duration": np.array([curve[-1, 1] for curve in curves])}


def table5(found: Found, joint: int, algorithm: str) -> dict[str, Array]:
    """Iterations and evaluations of the searches of a joint alone."""
    spent = settled(found[algorithm, "per-joint"].curves(joint - 1))
    return {"iterations": iterations(spent, algorithm), "evaluations": spent}


MEASURES = {"table4": table4, "table5": table5}


def compared(name: str, found: Found) -> pd.DataFrame:
    """Table 4 or 5 beside the paper's, percent; its Table 5 counts iterations."""
    measured = MEASURES[name]
    rows = []
    for _, published in reference(name).iterrows():
        joint = int(published["joint"])
        other = published["over"]
        ours = measured(found, joint, "issa")
        others = measured(found, joint, other)
        for measure in ours:
            estimate = statistics.bootstrap(percent_below, ours[measure], others[measure])
            row = {
                "joint": joint,
                "ISSA over": NAMES[other],
                "measure": measure,
                "ours %": estimate.value,
                "low %": estimate.low,
                "high %": estimate.high,
                "paper %": np.nan if measure == "evaluations" else published["percent"],
            }
            rows.append(row)
    return pd.DataFrame(rows).assign(difference=lambda t: t["ours %"] - t["paper %"])


def synchronised(found: Found, problem: Problem, algorithm: str, timing: str) -> list[Trajectory]:
    """One trajectory per seed; of joints searched alone, each segment's longest time."""
    times = np.nanmax(found[algorithm, timing].times, axis=1)
    return [spline353.trajectory(problem, own) for own in times]


def running_times(found: Found, problem: Problem) -> pd.DataFrame:
    """Claimed and certified durations (medians with intervals, s) beside the paper's."""
    published = paper.running_times()
    fixed = Unoptimised().solve(problem).trajectory
    assert fixed is not None
    cases = {("unoptimised", "shared"): [fixed]}
    for timing, algorithm in itertools.product(TIMINGS, ALGORITHMS):
        cases[algorithm, timing] = synchronised(found, problem, algorithm, timing)
    rows = []
    for (algorithm, timing), trajectories in cases.items():
        certificates = [verify(problem, trajectory) for trajectory in trajectories]
        certified = interval([c.certified_duration or np.nan for c in certificates])
        claimed = interval([t.duration for t in trajectories])
        row = {
            "algorithm": algorithm,
            "timing": timing,
            "seeds": len(trajectories),
            "claimed s": claimed.value,
            "low s": claimed.low,
            "high s": claimed.high,
            "certified s": certified.value,
            "keeps limits": float(np.mean([c.feasible for c in certificates])),
            "paper s": published[algorithm],
            "difference s": claimed.value - published[algorithm],
        }
        rows.append(row)
    return pd.DataFrame(rows)


def searched(output: Path, problem: Problem, seeds: int, iterations: int) -> Found:
    """All searches, each stored as soon as it is done."""
    found = {}
    cases = list(itertools.product(TIMINGS, ALGORITHMS))
    before = time.process_time()
    with progress(len(cases), "searches") as advance:
        for timing, algorithm in cases:
            options = {"timing": timing, "iterations": iterations}
            planner = configured(load(algorithm), options)
            file = output / "runs" / f"{algorithm}-{timing}-{seeds}x{iterations}.npz"
            search = partial(paper.swarm, planner, problem, seeds)
            found[algorithm, timing] = paper.stored(file, search)
            advance(1)
    say(f"the searches took {time.process_time() - before:.1f} s of computing")
    return found


def draw(found: Found, robot: Robot, problem: Problem, iterations: int, folder: Path) -> None:
    """Write the paper's Figures 5, 6 and 7 as `fig5`, `fig6` and `fig7`, PNG and SVG."""
    motions = paper_figures.median_motions(found, problem)
    plots.save(paper_figures.tool_path(robot, problem, motions), folder / "fig5")
    plots.save(paper_figures.convergence(found, problem, iterations), folder / "fig6")
    plots.save(paper_figures.joint_curves(problem, motions), folder / "fig7")


def main(
    seeds: int = 50,
    *,
    quick: bool = False,
    figures: bool = False,
    output: Path = Path("results/paper_study"),
) -> None:
    """Run the study, write its tables, and print the claims.

    Args:
        seeds: How many runs of each search.
        quick: Four runs of 20 iterations.
        figures: Draw the paper's Figures 5 to 7 too, into the folder `figures` of the output.
        output: The folder.
    """
    seeds, iterations = budget(seeds, quick)
    problem = suite.load("six-axis")
    robot = suite.robot("six-axis")
    found = searched(output, problem, seeds, iterations)
    tables = {
        "table4": compared("table4", found),
        "table5": compared("table5", found),
        "table2": table2(robot, problem),
        "running-times": running_times(found, problem),
        "equations": checks(robot, problem),
    }
    ours = estimates(tables) | totals(found, problem) | equations(tables["equations"])
    tables["claims"] = claims(ours)
    for name, table in tables.items():
        save_table(table, output / name)
    if figures:
        draw(found, robot, problem, iterations, output / "figures")
    columns = ["claim", "paper", "ours", "verdict"]
    print(tables["claims"][columns].to_string(index=False, float_format="{:.5g}".format))


if __name__ == "__main__":
    cyclopts.run(main)
