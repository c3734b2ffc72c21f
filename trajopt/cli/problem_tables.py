"""The table of each problem that `trajopt compare` prints, what its gaps mean, and what failed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import isnan

from trajopt.benchmark.trial import Trial
from trajopt.cli import console
from trajopt.cli.console import PlainTable
from trajopt.views import table_cells
from trajopt.views.analysis.least_jerk import times_the_least
from trajopt.views.analysis.results import Line
from trajopt.views.results import Results

_CELLS = {
    "median": "median",
    "quartiles": "quartiles",
    "gap": "gap %",
    "kept": "kept",
    "jerk_integral": "∫jerk²",
    "evaluations": "evals",
    "solve_time": "time",
    "library_time": "in lib",
}
_READINGS = ("timing", "fitness")  # options for what the paper leaves open


def show(results: Results) -> None:
    """Print a table per problem, the readings used, and why runs failed."""
    problems: dict[str, list[Line]] = {}
    for line in results.lines():
        problems.setdefault(line.digest, []).append(line)
    for digest, lines in problems.items():
        console.OUT.print(_comparison(lines))
        for line in lines:
            if line.solved < line.runs:
                console.paragraph(_why_not_solved(line))
        own = [trial for trial in results.items if trial.digest == digest]
        console.paragraph(_caption(lines, _readings(own)))
        smooth = times_the_least(own)
        if smooth:
            console.paragraph(_smoothness(smooth))
        console.paragraph()


def _comparison(lines: Sequence[Line]) -> PlainTable:
    rows = [table_cells.of_summary(line) for line in lines]
    for own in rows:
        if own["dilation"] != table_cells.MISSING:
            own["kept"] += f" {own['dilation']}"
        own |= {name: "" for name, cell in own.items() if cell == table_cells.MISSING}
    # a column without an entry is left out: quartiles of single runs, a library that nobody wraps
    cells = {name: heading for name, heading in _CELLS.items() if any(own[name] for own in rows)}
    title = f"{lines[0].problem}: certified durations, s"
    table = console.table("planner", numbers=tuple(cells.values()), title=title)
    for line, own in zip(lines, rows, strict=True):
        table.row(console.option_lines(line.label), *(own[name] for name in cells))
    return table


def _smoothness(times: Mapping[str, float]) -> str:
    """Name the planners whose motions do not jump, the least ∫ jerk² for its duration first."""
    ordered = sorted(times.items(), key=lambda own: own[1])
    said = ", ".join(f"{label} {table_cells.times(ratio)}" for label, ratio in ordered)
    return f"{table_cells.LEAST_JERK}: {said} (`trajopt front` has the others)."


def _why_not_solved(line: Line) -> str:
    message = console.last_line(line.message)
    if not isnan(line.lower_bound):
        return f"{line.label}: {message}"
    missed = line.runs - line.solved
    count = f"{missed} of {line.runs} runs " if line.runs > 1 else ""
    return f"{line.label}: {count}{line.status}: {message}"


def _readings(trials: Sequence[Trial]) -> str:
    """Name the readings of the paper that answered: how joints are combined, and the fitness."""
    readings = {
        ", ".join(f"{name}={trial.options[name]}" for name in _READINGS)
        for trial in trials
        if trial.solution.trajectory is not None and trial.options.keys() >= set(_READINGS)
    }
    return "; ".join(sorted(readings))


def _caption(lines: Sequence[Line], readings: str) -> str:
    first = lines[0]
    runs = max(line.runs for line in lines)
    seeds = f"Planners with random choices ran with {runs} seeds. " * (runs > 1)
    slowed = "A motion that breaks a limit counts as slowed down until it keeps them all."
    sentences = [f"{seeds}{slowed}"]
    if first.kind is not None:
        sentences.append(table_cells.reference(first))
    if readings:
        sentences.append(f"Reading of the paper: {readings}.")
    broken = any(table_cells.of_summary(one)["dilation"] != table_cells.MISSING for one in lines)
    dilated = ", and × how much the others must be slowed down (median)" if broken else ""
    sentences.append(
        f"Kept: share of runs within every limit as claimed{dilated}. ∫jerk²: of the certified "
        "motion, all joints together, SI units; ∞ where acceleration jumps."
    )
    if not all(isnan(line.library_time) for line in lines):
        sentences.append(f"Time: of a run, s; in lib: {table_cells.LIBRARY} (medians).")
    return "\n".join(sentences)
