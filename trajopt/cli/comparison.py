"""A comparison run and shown: a table per problem, or one of many problems (`trajopt compare`)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from trajopt import comparison as benchmark
from trajopt.benchmark.best_known import records
from trajopt.benchmark.run import dask as cluster
from trajopt.benchmark.run.pool import Pool
from trajopt.benchmark.run.processes import cpus
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.cli import console
from trajopt.comparison import Comparison
from trajopt.core.exceptions import TrajoptError
from trajopt.core.interpolation import Interpolation
from trajopt.core.problem import Problem
from trajopt.judging.falling_velocity import caveats
from trajopt.planners.registry import entries, named
from trajopt.planners.registry import label as label_of
from trajopt.views.analysis.summary import Line, Summary
from trajopt.views.figures import draw
from trajopt.views.figures.style import dilated

if TYPE_CHECKING:
    from trajopt.benchmark.given_motion import GivenMotion

MANY = 12  # problems, beyond which there is one page in place of a table and figures each

_READINGS = ("timing", "fitness")  # options that say how the paper was read


def run(
    names: Sequence[str],
    planners: Sequence[str] | None,
    *,
    motions: Sequence[Path],
    interpolation: Interpolation,
    suites: Sequence[str],
    seeds: int,
    jobs: int | None,
    output: Path,
    fresh: bool,
    timeout: float,
    memory: float | None,
    dask: str | None,
    certify: bool,
    against: str | None,
) -> int:
    """Run planners on problems; print the table, store every trial, draw the figures.

    Args:
        names: Of problems, or their files.
        planners: As `registry.load` takes them; None for all that do not wait to be asked for.
        motions: Files to judge beside the planners.
        interpolation: Between the samples of those.
        suites: Whose problems are run too.
        seeds: So many, from 0, of each stochastic planner.
        jobs: Worker processes; None for one per CPU.
        output: The results' folder.
        fresh: Whether what is there runs again.
        timeout: Of a trial, s.
        memory: Of a trial's process, GiB; None for no limit.
        dask: A scheduler's address or file, if the trials run there.
        certify: Whether lower bounds are proved too.
        against: The planner that all others are tested against; it runs too.

    Returns:
        The exit code.
    """
    loaded = _problems(names, suites)
    processes = jobs or cpus()
    folder = output.absolute()
    few = len(loaded) <= MANY
    with Pool(processes) as pool:
        specs: list[benchmark.Contestant] = [*(planners or _default_planners())]
        if motions:
            specs += _motions(motions, interpolation)
        if certify:
            specs = [*specs, "certify"]
        rival = None
        if against is not None:
            rival = label_of(*named(against))
            specs = [*specs, against]

        elsewhere = cluster.executor(dask) if dask else nullcontext()
        with console.trials() as advance, elsewhere as executor:
            ran = benchmark.run(
                loaded,
                specs,
                folder,
                pool,
                seeds=seeds,
                fresh=fresh,
                timeout=timeout,
                memory=memory,
                progress=advance,
                executor=executor,
            )
    if few:
        with console.waiting("drawing the figures"):
            figures = draw.draw(ran.trials, folder / "figures")
    if ran.kept:
        console.line(str(ran.kept))
        console.paragraph()
    summary = Summary(ran.trials)
    trials = f"{len(ran.trials)} trials"
    if not few:
        page = _show_many(ran, output)
        made = [f"stored:  {output / 'results.h5'} ({trials})", f"report:  {page} ({trials})"]
    else:
        _show_each(summary)
        made = [f"stored:  {output / 'results.h5'} ({trials} of this comparison)"]
        if figures:
            made.append(f"figures: {output / 'figures'} ({len(figures)} files)")
    if rival is not None:
        _show_against(ran, rival)
    for sentence in caveats(loaded):
        console.paragraph(sentence)
    _warn(summary)
    for line in made:
        console.line(line)
    for sentence in _better_than_recorded(summary, output):
        console.paragraph(sentence)
    answered = any(trial.is_answered for trial in ran.trials)
    return 0 if answered else 1


def _motions(
    files: Sequence[Path],
    interpolation: Interpolation,
) -> Iterator[tuple[str, GivenMotion]]:
    """Each motion under its file's name, or its whole path where two have one name."""
    # YAML and more: not where no motion is given
    from trajopt.benchmark.given_motion import GivenMotion
    from trajopt.formats.motion import motion as motion_of

    names = Counter(file.name for file in files)
    for file in files:
        name = file.name if names[file.name] == 1 else str(file)
        yield name, GivenMotion(motion_of(file, interpolation))


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


def _show_many(ran: Comparison, folder: Path) -> Path:
    """A line per planner, and a page, whose path is returned."""
    # pandas: not where there are few problems
    from trajopt.cli import overview
    from trajopt.views.analysis.results import Results

    return overview.show(Results(ran.trials, ran.kept), folder)


def _show_against(ran: Comparison, rival: str) -> None:
    """Every planner against one."""
    # pandas: not where nobody asks for it
    from trajopt.cli import against
    from trajopt.views.analysis.results import Results

    against.show(Results(ran.trials, ran.kept), rival)


def _warn(summary: Summary) -> None:
    for trial in summary.suspicious():
        below = -100 * summary.gap(trial)
        console.ERR.print(
            f"[bold red]BUG OR BETTER OPTIMUM[/bold red]: {console.markup(trial.label)} "
            f"(seed {trial.seed}) on {console.markup(trial.problem.name)} is {below:.6f} % below "
            f"the reference; trial {trial.id}"
        )


def _better_than_recorded(summary: Summary, folder: Path) -> Iterator[str]:
    """Answers better than the best known, and what to do with them."""
    improvements = summary.improvements()
    for trial in improvements:
        record = records.find(trial.problem)
        if record is None or trial.certified_duration is None:
            continue
        less = 100 * (1 - trial.certified_duration / record.duration)
        yield (
            f"{trial.label} on {trial.problem.name} takes {trial.certified_duration:.6f} s, "
            f"{less:.4g} % less than the best known, {record.motion}, {record.duration:.6f} s."
        )
    if improvements:
        yield f"To record what is better: trajopt best-known propose {folder}"


# --- a table per problem ---


def _show_each(summary: Summary) -> None:
    """Tables, the readings used, and what failed and why."""
    readings = _readings(summary.trials)
    problems: dict[str, list[Line]] = {}
    for line in summary.lines():
        problems.setdefault(line.digest, []).append(line)
    for lines in problems.values():
        console.OUT.print(_comparison(lines))
        for line in lines:
            if line.solved < line.runs:
                console.paragraph(_why_not_solved(line))
        console.paragraph(_caption(lines, readings))
        console.paragraph()


def _comparison(lines: Sequence[Line]) -> Table:
    numbers = ("median s", "quartiles s", "gap %", "kept limits", "evals", "time s")
    title = f"{lines[0].problem}: certified durations"
    table = console.table("planner", *numbers, numbers=numbers, title=title)
    for line in lines:
        name = console.option_lines(line.label)
        time = f"{line.solve_time:.3f}"
        if isnan(line.median):
            table.add_row(name, _without_duration(line), "", "", "", "", time)
        else:
            table.add_row(name, *_durations(line), time)
    return table


def _without_duration(line: Line) -> str:
    if isnan(line.lower_bound):
        return console.markup(line.status)
    return f"≥ {line.lower_bound:.4f}"


def _durations(line: Line) -> list[str]:
    quartiles = ""
    if line.runs > 1:
        quartiles = f"{line.q1:.4f}–{line.q3:.4f}"
    kept_limits = f"{100 * line.kept:.0f} %"
    if line.dilation > 1:
        kept_limits += f" {dilated(line.dilation)}"
    gap = "" if isnan(line.gap) else f"{100 * line.gap:+.2f}"
    evaluations = "" if isnan(line.evaluations) else f"{line.evaluations:.0f}"
    return [f"{line.median:.4f}", quartiles, gap, kept_limits, evaluations]


def _why_not_solved(line: Line) -> str:
    rows = line.message.strip().splitlines()
    message = rows[-1] if rows else ""
    if not isnan(line.lower_bound):
        return f"{line.label}: {message}"
    count = f"{line.runs - line.solved} of {line.runs} runs " if line.runs > 1 else ""
    return f"{line.label}: {count}{line.status}: {message}"


def _readings(trials: Sequence[Trial]) -> str:
    """The readings of the paper that were run: how joints are combined, and the fitness."""
    readings = set()
    for trial in trials:
        chosen = [f"{n}={trial.options[n]}" for n in _READINGS if n in trial.options]
        readings.add(", ".join(chosen))
    return "; ".join(sorted(filter(None, readings)))


def _caption(lines: Sequence[Line], readings: str) -> str:
    first = lines[0]
    runs = max(line.runs for line in lines)
    sentences = [f"Up to {runs} seeds. Durations are the verifier's: claimed × max(1, dilation)."]
    if first.kind is not None:
        sentences.append(_reference(first))
    if readings:
        sentences.append(f"Reading: {readings}.")
    sentences.append(
        "Kept limits: share of runs that did as claimed; × the others' median dilation."
    )
    return "\n".join(sentences)


def _reference(line: Line) -> str:
    """What the gaps are measured against, and how much of it is proved."""
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
