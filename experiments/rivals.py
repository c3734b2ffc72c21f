"""How far are other authors' planners from the optimum, as documented and with equal effort?

    python -m experiments.rivals            # 44 problems, half an hour of CPU
    python -m experiments.rivals --quick    # six-axis alone
    python -m experiments.rivals --rival gcs
    python -m experiments.rivals --tolerance    # 42 problems whose waypoints have a tolerance

Every rival runs twice on the six-axis problem, `jerk-limit` and the 42 problems of eleven arms: as
in its authors' example (one try), and with the same effort for all, the best of twelve settings
(`baselines/third_party`). Certified durations are compared with the best known motion.

The folder `--output` keeps the trials, and a second run adds only what is missing. Its files
`rivals.csv` and `rivals.md` hold the table.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import cyclopts

from experiments.common.output import save_table
from experiments.common.spread import compared, spread
from trajopt import Problem
from trajopt.benchmark.suites import catalogue

# By row: as the planner's authors' example has it, and with the effort of all. `along` is of this
# project: TOPP-RA's splines, timed under every limit.
RIVALS = {
    "toppra, documented": "toppra:knots=uniform,ends=not-a-knot",
    "toppra, effort": "toppra",
    "along, documented": "along:knots=uniform,ends=not-a-knot",
    "along, effort": "along",
    "copp, documented": "copp:tries=1",
    "copp, effort": "copp",
    "drake-kto, documented": "drake-kto:tries=1",
    "drake-kto, effort": "drake-kto",
    "gcs, documented": "gcs:tries=1",
    "gcs, effort": "gcs",
    "totg, documented": "totg:tries=1",
    "totg, effort": "totg",
    "totg-ruckig, documented": "totg-ruckig:tries=1",
    "totg-ruckig, effort": "totg-ruckig",
    "iterative-spline, documented": "iterative-spline:tries=1",
    "iterative-spline, effort": "iterative-spline",
    "minsnap, documented": "minsnap:tries=1",
    "minsnap, effort": "minsnap",
    "ruckig-search, documented": "ruckig-stop",
    "ruckig-search, effort": "ruckig-search",
}
# Those that plan within a tolerance.
WITHIN = {"gcs, four tries": "gcs:tries=4", "collocation": "collocation"}
GROUPS = ("six-axis", "jerk-limit", "4 waypoints", "8 waypoints", "16 waypoints", "jerk limits")


def problems() -> Iterator[tuple[str, Problem]]:
    """Every problem with its group."""
    for name in ("six-axis", "jerk-limit"):
        yield name, catalogue.load(name)
    for problem in catalogue.problems("robots"):
        group = f"{len(problem.waypoints)} waypoints"
        if problem.has("jerk"):
            group = "jerk limits"
        yield group, problem


def within_tolerance() -> Iterator[tuple[str, Problem]]:
    """Every problem of the suite `demands` with a tolerance, with its group."""
    for problem in catalogue.problems("demands"):
        if "tolerance" in problem.demands:
            yield "jerk limits" if problem.has("jerk") else "no jerk limits", problem


def main(
    *problem: str,
    rival: Sequence[str] = (),
    output: Path = Path("results/rivals"),
    quick: bool = False,
    tolerance: bool = False,
) -> None:
    """Run what is missing, then write and print the table.

    Args:
        problem: Names of problems; all 44 if none is given.
        rival: Planners, or rows such as "gcs, documented"; all if none is given.
        output: The folder.
        quick: The problem six-axis alone.
        tolerance: Problems whose waypoints have a tolerance, and planners that know it.
    """
    if quick:
        problem = ("six-axis",)
    known = within_tolerance() if tolerance else problems()
    chosen = [(group, own) for group, own in known if not problem or own.name in problem]
    rivals = WITHIN if tolerance else RIVALS
    run = {
        row: spec
        for row, spec in rivals.items()
        if not rival or not {row, row.split(",")[0]}.isdisjoint(rival)
    }
    trials = compared(chosen, run.items(), output)
    table = spread(trials, ["planner"])
    rows = [row for row in rivals if row in table.index]
    groups = [group for group in ("no jerk limits", *GROUPS) if group in table]
    shown = table.loc[rows, groups].fillna("–")
    save_table(shown, output / "rivals")
    print(shown.to_string())


if __name__ == "__main__":
    cyclopts.run(main)
