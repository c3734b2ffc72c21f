"""`trajopt front`: how smooth a motion of each duration can be, and how smooth planners are."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter, Token

from trajopt import comparison
from trajopt.benchmark.front import Beside, Front, Measure
from trajopt.benchmark.front import front as front_of
from trajopt.benchmark.run.processes import cpus
from trajopt.benchmark.run.tasks import Allowance
from trajopt.cli import asked, console
from trajopt.cli.asked import NO_FLAGS, RobotFlags
from trajopt.cli.compare import default_planners
from trajopt.cli.console import PlainTable
from trajopt.cli.parameters import MAX_SECONDS, Json, ProblemName, number
from trajopt.comparison import TIMEOUT
from trajopt.core import numerals
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.views import table_cells
from trajopt.views.figures import draw


def _durations(type_: Any, tokens: Sequence[Token]) -> list[float]:
    found = []
    for text in tokens[0].value.split(","):
        seconds = numerals.decimal(text.strip())
        if not 0 < seconds <= MAX_SECONDS:
            raise InvalidInput("--durations", f"seconds, above 0 to {MAX_SECONDS:g}", value=text)
        found.append(seconds)
    return found


def front(
    problem: ProblemName,
    *,
    robot: RobotFlags = NO_FLAGS,
    measure: Measure = "jerk",
    durations: Annotated[
        list[float] | None,
        Parameter(
            help="Seconds, with commas: 1.8,2,3; by default from 1.05 to 3 times the shortest.",
            converter=_durations,
            n_tokens=1,
        ),
    ] = None,
    time_limit: Annotated[
        float,
        number("CPU seconds for the proof of each point; 0: none.", least=0, most=MAX_SECONDS),
    ] = 60.0,
    planner: list[str] | None = None,
    output: Path = Path("results"),
    json: Json = False,
) -> int:
    """Say how smooth a motion of each duration can be, and how smooth the planners are.

    A curve of the least ∫ jerk² within every limit, with a proved lower bound over all segment
    times, and every planner as a point. For each planner: its ∫ jerk² relative to the least of the
    same duration, and the shortest duration with the same ∫ jerk².

    Args:
        measure: The derivative whose square is integrated.
        planner: Planners to show, repeated; all by default (with --json: none).
        output: Folder for the planners' trials and the figure.
    """
    loaded = asked.problem(problem, robot, scaled=True)
    with console.waiting(f"the front of {loaded.name}", long=True) as tell:
        found = front_of(
            loaded, measure=measure, durations=durations, time_limit=time_limit, tell=tell
        )
    wanted = planner if planner is not None or json else default_planners(Allowance(TIMEOUT))
    beside = _beside(found, loaded, wanted, output) if wanted else []
    if json:
        table = found.as_dict()
        if wanted:
            table["planners"] = [own.as_dict() for own in beside]
        console.print_json(table)
        return 0
    console.OUT.print(_curve(found))
    if beside:
        console.paragraph()
        console.OUT.print(_planners(found, beside))
        console.paragraph(
            "Times the least: of its own duration. Shortest: any motion with its smoothness.\n"
            "∞: its acceleration jumps."
        )
    with console.waiting("drawing the figure"):
        figures = draw.front(found, beside, output / "figures")
    console.line(f"figure: {figures[0]}")
    return 0


def _beside(found: Front, problem: Problem, planners: Sequence[str], output: Path) -> list[Beside]:
    results = comparison.compare(
        [problem],
        planners,
        output,
        seeds=1,
        jobs=cpus(),
        progress=console.progress_line(),
    )
    with console.waiting("the planners beside the front"):
        return found.beside(results.items)


def _curve(found: Front) -> PlainTable:
    title = f"{found.problem.name}: least ∫ {found.measure}², {found.unit}"
    table = console.table(numbers=("duration s", "least known", "proved", "gap %"), title=title)
    for point in found.points:
        lower = point.lower
        gap = table_cells.MISSING if lower is None else f"{100 * (1 - lower / point.value):.2f}"
        table.row(
            f"{point.duration:.6g}",
            table_cells.integral(point.value),
            table_cells.integral(lower),
            gap,
        )
    return table


def _planners(found: Front, beside: Sequence[Beside]) -> PlainTable:
    numbers = ("duration s", f"∫ {found.measure}²", "times the least", "shortest s")
    table = console.table("planner", numbers=numbers)
    for own in beside:
        times = own.times_the_least
        table.row(
            console.option_lines(own.label),
            f"{own.duration:.4f}",
            table_cells.integral(own.value),
            table_cells.MISSING if times is None or not np.isfinite(times) else f"{times:.3g}",
            table_cells.number(own.shortest),
        )
    return table
