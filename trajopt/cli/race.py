"""`trajopt race`: motions of several planners side by side on one clock, as a page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated

from trajopt import comparison
from trajopt.benchmark.front import smoothest
from trajopt.benchmark.run.processes import cpus
from trajopt.benchmark.trial import Trial
from trajopt.cli import asked, console
from trajopt.cli.asked import NO_FLAGS, RobotFlags
from trajopt.cli.parameters import Force, ProblemName, Running, Writing, whole_number
from trajopt.cli.plan import check_target
from trajopt.core.exceptions import shortened
from trajopt.explain.references import REFERENCES
from trajopt.views import race as page
from trajopt.views.analysis.versions import by_label
from trajopt.views.figures.draw import LOOKED_FOR, median_run, shown_motions
from trajopt.views.report.verdict import of_problem

OPTIMUM = "exact"  # whose look the first motion has
_REASON_LENGTH = 200  # characters


def race(
    problem: ProblemName,
    *planners: str,
    robot: RobotFlags = NO_FLAGS,
    seeds: Annotated[
        Running[int], whole_number("Runs of each stochastic planner; the median is shown.", least=1)
    ] = 1,
    out: Writing[Path] = Path("race.html"),
    force: Force = False,
    output: Writing[Path] = Path("results"),
) -> int:
    """Show motions of planners side by side on one clock, as a page that needs no network.

    The optimum, or the best known motion, is the first of them: of all motions of its duration the
    smoothest, so that full bars are those of the limits that decide.

    Args:
        planners: Beside the optimum; by default toppra, ruckig-stop and issa.
        out: The page.
        output: Folder of the planners' trials.
    """
    check_target(out, force=force)
    loaded = asked.problem(problem, robot, scaled=True)
    results = comparison.compare(
        [loaded],
        planners or LOOKED_FOR,
        output,
        seeds=seeds,
        jobs=cpus(),
        progress=console.progress_line() if console.ERR.is_terminal else False,
    )
    motions = shown_motions(results.items, every=True)
    if motions and motions[0].planner == OPTIMUM:
        with console.waiting("the smoothest motion of the optimum's duration"):
            motions[0] = motions[0]._replace(trajectory=smoothest(loaded, motions[0].trajectory))
    reasons = list(_absent(results.items))
    if motions:
        page.write(loaded, motions, out, notes=reasons)
        console.paragraph(of_problem(results))
    for reason in reasons:
        console.paragraph(reason)
    if not motions:
        return 1
    console.line(f"race: {out} ({out.stat().st_size / 1000:.0f} kB)")
    return 0


def _absent(trials: Sequence[Trial]) -> Iterator[str]:
    """Yield why planners are not in the race."""
    for label, runs in by_label(trials).items():
        if median_run(runs) is None and runs[0].planner not in REFERENCES:
            reason = shortened(runs[0].message or "", _REASON_LENGTH)
            yield f"{label} has no motion here ({runs[0].status.value}): {reason}"
