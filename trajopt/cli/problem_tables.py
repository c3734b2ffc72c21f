"""The table of each problem that `trajopt compare` prints, what its gaps mean, and what failed."""

from __future__ import annotations

from collections.abc import Sequence
from math import isnan

from trajopt.benchmark.trial import Trial
from trajopt.cli import console
from trajopt.cli.console import Grid
from trajopt.views.analysis.results import Line, Results
from trajopt.views.figures.style import dilated

_READINGS = ("timing", "fitness")  # options for what the paper leaves open


def show(results: Results) -> None:
    """Print a table per problem, the readings used, and why runs failed."""
    readings = _readings(results.items)
    problems: dict[str, list[Line]] = {}
    for line in results.lines():
        problems.setdefault(line.digest, []).append(line)
    for lines in problems.values():
        console.OUT.print(_comparison(lines))
        for line in lines:
            if line.solved < line.runs:
                console.paragraph(_why_not_solved(line))
        console.paragraph(_caption(lines, readings))
        console.paragraph()


def _comparison(lines: Sequence[Line]) -> Grid:
    numbers = ("median s", "quartiles s", "gap %", "kept limits", "evals", "time s")
    title = f"{lines[0].problem}: certified durations"
    table = console.table(
        "planner",
        *numbers,
        numbers=numbers,
        title=title,
    )
    for line in lines:
        cells = _without_duration(line) if isnan(line.median) else _durations(line)
        table.row(console.option_lines(line.label), *cells, f"{line.solve_time:.3f}")
    return table


def _without_duration(line: Line) -> list[str]:
    known = line.status if isnan(line.lower_bound) else f"≥ {line.lower_bound:.4f}"
    return [known, "", "", "", ""]


def _durations(line: Line) -> list[str]:
    quartiles = f"{line.q1:.4f}–{line.q3:.4f}" if line.runs > 1 else ""
    kept_limits = f"{line.kept:.0%}".replace("%", " %")
    if line.dilation > 1:
        kept_limits += f" {dilated(line.dilation)}"
    gap = console.number(100 * line.gap, "+.2f", missing="")
    evaluations = console.number(line.evaluations, ".0f", missing="")
    return [f"{line.median:.4f}", quartiles, gap, kept_limits, evaluations]


def _why_not_solved(line: Line) -> str:
    rows = line.message.strip().splitlines()
    message = rows[-1] if rows else ""
    if not isnan(line.lower_bound):
        return f"{line.label}: {message}"
    count = f"{line.runs - line.solved} of {line.runs} runs " if line.runs > 1 else ""
    return f"{line.label}: {count}{line.status}: {message}"


def _readings(trials: Sequence[Trial]) -> str:
    """Name the readings of the paper that were run: how joints are combined, and the fitness."""
    readings = set()
    for trial in trials:
        chosen = [f"{n}={trial.options[n]}" for n in _READINGS if n in trial.options]
        readings.add(", ".join(chosen))
    return "; ".join(sorted(filter(None, readings)))


def _caption(lines: Sequence[Line], readings: str) -> str:
    first = lines[0]
    runs = max(line.runs for line in lines)
    seeds = f"Up to {runs} seeds. " * (runs > 1)
    sentences = [f"{seeds}Durations are the verifier's: claimed × max(1, dilation)."]
    if first.kind is not None:
        sentences.append(_reference(first))
    if readings:
        sentences.append(f"Reading: {readings}.")
    sentences.append(
        "Kept limits: share of runs that did as claimed; × the others' median dilation."
    )
    return "\n".join(sentences)


def _reference(line: Line) -> str:
    """Name the reference of the gaps, and how closely it is proved."""
    known = "the best known, not proved (see --certify)"
    if line.proved > 0:
        within = 100 * (line.reference / line.proved - 1)
        by = f", recorded: {line.recorded_proof}" if line.recorded_proof else ""
        known = f"proved within {within:.3f} % (lower bound {line.proved:.6f} s{by})"
    sentences = {
        "exact": "Gap to the exact optimum, {:.6f} s: {}.",
        "refined": "Gap to refined collocation, {:.6f} s, its own error below 0.01 %: {}.",
        "relaxed": "Gap to the best known without some of the limits, {:.6f} s: {}.",
        "lower bound": "Gap to a lower bound, {:.6f} s: {}.",
        "best known": f"Gap to the best known, {line.recorded}, {{:.6f}} s: {{}}.",
    }
    return sentences[line.kind or "exact"].format(line.reference, known)
