"""`trajopt compare`: run planners on problems, and a table per problem, or one of many problems."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from math import inf, isfinite, isnan
from pathlib import Path
from typing import Annotated, Any

import pandas as pd
from cyclopts import Parameter
from rich.table import Table

from trajopt.benchmark import compare as benchmark
from trajopt.benchmark.analysis.failures import failures, in_words
from trajopt.benchmark.analysis.overview import overview
from trajopt.benchmark.analysis.results import Results
from trajopt.benchmark.figures import draw
from trajopt.benchmark.run import dask as cluster
from trajopt.benchmark.suites import catalogue
from trajopt.cli import against as tests
from trajopt.cli import console
from trajopt.cli.parameters import MAX_SECONDS, number, whole_number
from trajopt.exceptions import InvalidInput, TrajoptError
from trajopt.problem import Problem
from trajopt.registry import entries, named
from trajopt.registry import label as label_of

MANY = 12  # problems, beyond which there is one page in place of a table and figures each

_MEANING = """\
Problems: as supported. Bounds: answers that ignore a limit on purpose.
Gap: median over problems of the median gap to a known optimum (none: on half of
them it has no answer). Worst: of any solved trial."""
_KINDS_SHOWN = 3  # of a planner's failures
_READINGS = ("timing", "fitness")  # options that say how the paper was read


def compare(
    *problems: Annotated[str, Parameter(help="Problem file, or the name of a built-in problem.")],
    planner: Annotated[
        list[str] | None,
        Parameter(help="NAME[:key=value,…], repeated for each planner; all by default."),
    ] = None,
    suite: Annotated[
        list[str] | None, Parameter(help="All problems of a suite; see `trajopt suite list`.")
    ] = None,
    seeds: Annotated[
        int,
        whole_number("Seeds 0 … N−1 of each stochastic planner.", least=1, most=1_000_000),
    ] = 30,
    jobs: Annotated[
        int | None,
        whole_number("Worker processes; by default one per CPU.", least=1, most=4096),
    ] = None,
    output: Annotated[
        Path, Parameter(help="Results folder; what is there already is kept.")
    ] = Path("results"),
    fresh: Annotated[bool, Parameter(negative=(), help="Run everything again.")] = False,
    timeout: Annotated[
        float,
        number("Seconds after which a trial is stopped.", least=1, most=MAX_SECONDS),
    ] = 600.0,
    memory: Annotated[
        float | None,
        number(
            "GiB that a trial's process may use (Linux); no limit by default.",
            least=0.25,
            most=1e6,
        ),
    ] = None,
    dask: Annotated[
        str | None,
        Parameter(help="Address or file of a Dask scheduler to run the trials on."),
    ] = None,
    certify: Annotated[
        bool, Parameter(negative=(), help="Prove lower bounds too: same as --planner certify.")
    ] = False,
    against: Annotated[
        str | None,
        Parameter(help="NAME[:key=value,…] to test all others against; it is run too."),
    ] = None,
) -> int:
    """Run planners on problems; print the table, store every trial, draw the figures."""
    if not problems and not suite:
        right = "at least one problem file or built-in name (see `trajopt list`), or a --suite"
        raise InvalidInput("PROBLEM", right)
    loaded = _problems(problems, suite or [])
    specs = planner or _default_planners()
    if certify:
        specs = [*specs, "certify"]
    rival = None
    if against is not None:
        rival = label_of(*named(against))
        specs = [*specs, against]
    processes = jobs or benchmark.cpus()
    folder = output.resolve()
    _leave_deleted_folder(folder)
    elsewhere = cluster.executor(dask) if dask else nullcontext()
    with console.trials() as advance, elsewhere as executor:
        results = benchmark.compare(
            loaded,
            specs,
            folder,
            seeds=seeds,
            jobs=processes,
            fresh=fresh,
            timeout=timeout,
            memory=memory,
            progress=advance,
            executor=executor,
        )
    if results.kept:
        console.line(str(results.kept))
        console.paragraph()
    if len(loaded) > MANY:
        _show_many(results, output, rival)
    else:
        _show_each(results, output, processes, rival)
    trials = results.trials()
    answered = (trials["status"] == "solved") | trials["lower_bound"].notna()
    return 0 if answered.any() else 1


def _leave_deleted_folder(other: Path) -> None:
    """Worker processes cannot start in a working folder that was deleted."""
    try:
        os.getcwd()
    except FileNotFoundError:
        os.chdir(other.anchor)


def _problems(names: Sequence[str], suites: Sequence[str]) -> list[Problem]:
    """The problems asked for, each once."""
    problems = [catalogue.load(name) for name in dict.fromkeys(names)]
    for name in dict.fromkeys(suites):
        problems += catalogue.problems(name)
    return problems


def _default_planners() -> list[str]:
    """Every planner that can be imported and does not wait to be asked for by name.

    Of those that cannot (a stranger's, broken) only a warning.
    """
    names = []
    for name, entry in entries().items():
        try:
            if not entry.load().on_request:
                names.append(name)
        except TrajoptError as error:
            console.note(f"left out: {error}")
    return names


# --- a table per problem ---


def _show_each(results: Results, folder: Path, processes: int, rival: str | None) -> None:
    """Tables, the readings used, what failed and why, and where everything is."""
    with console.waiting("drawing the figures"):
        figures = draw.draw(results, folder / "figures", processes=processes)
    readings = _readings(results)
    for _, rows in results.summary().groupby("digest", sort=False):
        console.OUT.print(_comparison(rows))
        for row in rows[rows["solved"] < rows["runs"]].itertuples():
            console.paragraph(_why_not_solved(row))
        console.paragraph(_caption(rows, readings))
        console.paragraph()
    if rival is not None:
        tests.show(results, rival)
    _warn(results)
    trials = len(results.items)
    console.line(f"stored:  {folder / 'results.h5'} ({trials} trials of this comparison)")
    if figures:
        console.line(f"figures: {folder / 'figures'} ({len(figures)} files)")


def _comparison(rows: pd.DataFrame) -> Table:
    numbers = ("median s", "quartiles s", "gap %", "kept limits", "evals", "time s")
    title = f"{rows['problem'].iloc[0]}: certified durations"
    table = console.table("planner", *numbers, numbers=numbers, title=title)
    for row in rows.itertuples():
        name = console.option_lines(row.label)
        time = f"{row.solve_time:.3f}"
        if isnan(row.median):
            table.add_row(name, _without_duration(row), "", "", "", "", time)
        else:
            table.add_row(name, *_durations(row), time)
    return table


def _without_duration(row: Any) -> str:
    if isnan(row.lower_bound):
        return console.markup(row.status)
    return f"≥ {row.lower_bound:.4f}"


def _durations(row: Any) -> list[str]:
    quartiles = ""
    if row.runs > 1:
        quartiles = f"{row.q1:.4f}–{row.q3:.4f}"
    kept_limits = f"{100 * row.kept:.0f} %"
    if row.dilation > 1:
        kept_limits += f" ×{row.dilation:.4f}"
    gap = "" if isnan(row.gap) else f"{100 * row.gap:+.2f}"
    evaluations = "" if isnan(row.evaluations) else f"{row.evaluations:.0f}"
    return [f"{row.median:.4f}", quartiles, gap, kept_limits, evaluations]


def _why_not_solved(row: Any) -> str:
    lines = str(row.message).strip().splitlines()
    message = lines[-1] if lines else ""
    if not isnan(row.lower_bound):
        return f"{row.label}: {message}"
    count = f"{row.runs - row.solved} of {row.runs} runs " if row.runs > 1 else ""
    return f"{row.label}: {count}{row.status}: {message}"


def _readings(results: Results) -> str:
    """The readings of the paper that were run: how joints are combined, and the fitness."""
    readings = set()
    for trial in results.items:
        chosen = [f"{n}={trial.options[n]}" for n in _READINGS if n in trial.options]
        readings.add(", ".join(chosen))
    return "; ".join(sorted(filter(None, readings)))


def _caption(rows: pd.DataFrame, readings: str) -> str:
    first = rows.iloc[0]
    runs = rows["runs"].max()
    lines = [f"Up to {runs} seeds. Durations are the verifier's: claimed × max(1, dilation)."]
    if not isnan(first["reference"]):
        lines.append(_reference(first))
    if readings:
        lines.append(f"Reading: {readings}.")
    lines.append("Kept limits: share of runs that did as claimed; × the others' median dilation.")
    return "\n".join(lines)


def _reference(row: pd.Series[Any]) -> str:
    """What the gaps are measured against, and how much of it is proved."""
    reference, proved = row["reference"], row["proved"]
    known = "the best known, not proved (see --certify)"
    if proved > 0:
        within = 100 * (reference / proved - 1)
        known = f"proved within {within:.3f} % (lower bound {proved:.6f} s)"
    sentences = {
        "exact": "Gap to the exact optimum, {:.6f} s: {}.",
        "refined": "Gap to refined collocation, {:.6f} s, its own error below 0.01 %: {}.",
        "lower bound": "Gap to a lower bound, {:.6f} s, the optimum without some limits: {}.",
    }
    return sentences[row["kind"]].format(reference, known)


# --- one table of many problems ---


def _show_many(results: Results, folder: Path, rival: str | None) -> None:
    """One line per planner, what is suspicious, and where everything is."""
    from trajopt.benchmark import report  # its page: not where there are few problems

    with console.waiting("writing the report"):
        page = report.write(
            results,
            folder / "report.html",
            command=f"trajopt report {folder}",
        )
    numbers = ("problems", "solved", "failed", "bounds", "gap %", "worst %", "time s")
    table = console.table("planner", *numbers, numbers=numbers)
    for row in overview(results).itertuples():
        table.add_row(*_overview_cells(row))
    console.OUT.print(table)
    for sentence in _why_failed(results):
        console.paragraph(sentence)
    console.paragraph(_MEANING)
    console.paragraph()
    if rival is not None:
        tests.show(results, rival)
    _warn(results)
    trials = len(results.items)
    console.line(f"stored:  {folder / 'results.h5'} ({trials} trials)")
    console.line(f"report:  {page} ({trials} trials)")


def _overview_cells(row: Any) -> list[str]:
    gap = "none" if row.gap == inf else _percent(row.gap)
    return [
        console.option_lines(row.Index),
        str(row.problems),
        f"{row.solved} of {row.trials}",
        str(row.failed),
        str(row.bounds),
        gap,
        _percent(row.worst),
        f"{row.time:.3f}",
    ]


def _why_failed(results: Results) -> Iterator[str]:
    """What kept each planner's trials from being solved, the most frequent kinds by their size."""
    reasons = failures(results)
    for label, own in reasons.groupby(level="label", sort=False):
        sentence = f"{label}: {own['count'].sum()} failed: {in_words(own.head(_KINDS_SHOWN))}"
        others = own["count"].iloc[_KINDS_SHOWN:].sum()
        if others:
            sentence += f"; {others} in other ways"
        yield sentence


def _percent(gap: float) -> str:
    return f"{100 * gap:+.2f}" if isfinite(gap) else ""


def _warn(results: Results) -> None:
    for row in results.suspicious().itertuples():
        console.ERR.print(
            f"[bold red]BUG OR BETTER OPTIMUM[/bold red]: {console.markup(row.label)} "
            f"(seed {row.seed}) on {console.markup(row.problem)} is {-100 * row.gap:.6f} % below "
            f"the reference; trial {row.id}"
        )
