"""`trajopt compare`: run planners on problems, print the tables, draw the figures."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

from trajopt import comparison
from trajopt.benchmark.best_known import records
from trajopt.benchmark.run import dask as cluster
from trajopt.benchmark.run.processes import cpus
from trajopt.benchmark.run.runner import profiled
from trajopt.benchmark.run.tasks import Allowance
from trajopt.benchmark.suites import catalogue
from trajopt.cli import against as versus
from trajopt.cli import asked, console, problem_tables, suite_table
from trajopt.cli.asked import NO_FLAGS, MotionUnit, RobotFlags
from trajopt.cli.parameters import (
    MAX_SECONDS,
    RUNNING,
    InterpolationName,
    Planning,
    ProblemName,
    Running,
    Writing,
    number,
    whole_number,
)
from trajopt.comparison import Contestant
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.interpolation import Interpolation
from trajopt.core.problem import Problem
from trajopt.formats.motion import ARRAYS, TABLES
from trajopt.judgement import GivenMotion, motion_of
from trajopt.planners.registry import entries
from trajopt.views.analysis.gap_reference import improvements
from trajopt.views.figures import draw
from trajopt.views.results import Results

MAX_PROBLEMS_WITH_TABLES = 12  # more problems get one page in place of a table and figures each


def compare(
    *problems: ProblemName,
    robot: RobotFlags = NO_FLAGS,
    planner: Planning[list[str] | None] = None,
    motion: Planning[list[Path] | None] = None,
    motion_unit: MotionUnit = None,
    interpolation: InterpolationName = "auto",
    suite: Planning[list[str] | None] = None,
    seeds: Annotated[
        int,
        whole_number(
            "Seeds 0 … N−1 of each stochastic planner.", least=1, most=1_000_000, group=RUNNING
        ),
    ] = 30,
    jobs: Annotated[
        int | None,
        whole_number(
            "Worker processes; by default one per CPU.", least=1, most=4096, group=RUNNING
        ),
    ] = None,
    output: Writing[Path] = Path("results"),
    fresh: Running[bool] = False,
    fresh_reference: Running[bool] = False,
    timeout: Annotated[
        float,
        number("Seconds after which a trial is stopped.", least=1, most=MAX_SECONDS, group=RUNNING),
    ] = 600.0,
    memory: Annotated[
        float | None,
        number(
            "GiB that a trial's process may use (Linux); no limit by default.",
            least=0.25,
            most=1e6,
            group=RUNNING,
        ),
    ] = None,
    dask: Running[str | None] = None,
    prove: Planning[bool] = False,
    against: Planning[str | None] = None,
    common: bool = False,
) -> int:
    """Run planners on problems; print the table, store every trial, draw the figures.

    Args:
        planner: NAME or FILE.py:NAME, with :key=value,…, repeated; see `trajopt list`.
        motion: File of a motion to judge beside the planners (`trajopt judge`), repeated.
        suite: All problems of a suite; see `trajopt suite list`.
        output: Results folder; what is there already is kept.
        fresh: Run everything again.
        fresh_reference: Plan the references too where a best known motion is recorded.
        dask: Address or file of a Dask scheduler to run the trials on.
        prove: Prove lower bounds too: same as --planner prove.
        against: Planner to test all others against; it is run too.
        common: Show tables of only the problems that all planners answer.
    """
    if not problems and not suite:
        right = "at least one problem file or built-in name (see `trajopt list`), or a --suite"
        raise InvalidInput("PROBLEM", right)
    output = _outside_deleted_folder(output)
    allowed = Allowance(timeout, memory)
    loaded = asked.problems(problems, robot)
    for name in dict.fromkeys(suite or []):
        loaded += [asked.with_numbers(own, robot) for own in catalogue.problems(name)]
    contestants: list[Contestant] = [*(planner or default_planners(allowed))]
    asked.check_motion_unit(motion_unit, motion or [], "--motion-unit")
    contestants += _motions(motion or [], interpolation, motion_unit)
    if prove:
        contestants.append("prove")
    rival = None
    if against is not None:
        rival = profiled(against, [], allowed).entrant.label
        contestants.append(against)
    elsewhere = cluster.executor(dask) if dask else nullcontext()
    with elsewhere as executor:
        results = comparison.compare(
            loaded,
            contestants,
            output,
            seeds=seeds,
            jobs=jobs or cpus(),
            fresh=fresh,
            timeout=timeout,
            memory=memory,
            progress=console.progress_line(answers=len(loaded) <= MAX_PROBLEMS_WITH_TABLES),
            executor=executor,
            fresh_reference=fresh_reference,
        )
    shown = results.only(common=common)
    names = {own.digest for own in shown.items}
    _show(shown, [own for own in loaded if own.digest() in names], output, rival)
    return 0 if any(trial.is_answered for trial in results.items) else 1


def _show(results: Results, problems: Sequence[Problem], folder: Path, rival: str | None) -> None:
    """Print and draw the results."""
    count = f"{len(results.items)} trials"
    stored = f"stored:  {folder / 'results.h5'} ({count}"
    if results.kept:
        console.line(str(results.kept))
        console.paragraph()
    if len(problems) > MAX_PROBLEMS_WITH_TABLES:
        page = suite_table.show(results, folder)
        files = [f"{stored})"]
        if page is not None:
            files.append(f"report:  {page} ({count})")
    else:
        with console.waiting("drawing the figures"):
            figures = draw.draw(results.items, folder / "figures")
        problem_tables.show(results)
        files = [f"{stored} of this comparison)"]
        if figures:
            files.append(f"figures: {folder / 'figures'} ({len(figures)} files)")
    if rival is not None:
        versus.show(results, rival)
    _warn(results)
    for file in files:
        console.line(file)
    for sentence in _better_than_recorded(results, folder):
        console.paragraph(sentence)


def _outside_deleted_folder(output: Path) -> Path:
    """Leave the working folder if it was deleted: no process can start in it."""
    try:
        os.getcwd()
    except FileNotFoundError:
        folder = output.absolute()
        os.chdir(folder.anchor)
        return folder
    return output


def _motions(
    files: Sequence[Path], interpolation: Interpolation, unit: str | None
) -> Iterator[tuple[str, GivenMotion]]:
    """Yield each motion with its file's name, or its whole path where two have one name."""
    names = Counter(file.name for file in files)
    for file in files:
        name = file.name if names[file.name] == 1 else str(file)
        with asked.reading_motion(file):
            own = unit if file.suffix in (*TABLES, *ARRAYS) else None
            given = motion_of(file, interpolation, own)
        yield name, GivenMotion(given)


def default_planners(allowed: Allowance) -> list[str]:
    """Return the planners that take part unless others are named.

    Say on standard error which of them cannot be imported.
    """
    names = []
    for name in entries():
        try:
            if not profiled(name, [], allowed).on_request:
                names.append(name)
        except TrajoptError as error:
            console.note(f"left out: {error}")
    return names


def _warn(results: Results) -> None:
    for row in results.suspicious().itertuples():
        below = -100 * row.gap
        console.warn_of_bug(
            f"{row.label} (seed {row.seed}) on {row.problem} is {below:.6f} % below the "
            f"reference; trial {row.id}"
        )


def _better_than_recorded(results: Results, folder: Path) -> Iterator[str]:
    """Name the answers that are better than the best known, and the command that records them."""
    found = improvements(results.items)
    for trial in found:
        record = records.find(trial.problem)
        if record is None or trial.certified_duration is None:
            continue
        less = 100 * (1 - trial.certified_duration / record.duration)
        yield (
            f"{trial.label} on {trial.problem.name} takes {trial.certified_duration:.6f} s, "
            f"{less:.4g} % less than the best known, {record.motion}, {record.duration:.6f} s."
        )
    if found:
        yield f"To record what is better: trajopt best-known propose {folder}"
