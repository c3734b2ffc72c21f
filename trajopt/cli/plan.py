"""`trajopt plan`: one planner, one problem, one verdict."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.table import Table

from trajopt.benchmark.export import motion
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial, judge
from trajopt.cli import console
from trajopt.cli.parameters import Json, PlannerSpec, ProblemName, Seed, number
from trajopt.exceptions import InvalidInput
from trajopt.registry import named
from trajopt.verification import WORST_KINDS

_UNITS = ("rad", "rad/s", "rad/s²")  # of a position and its derivatives


def plan(
    problem: ProblemName,
    *,
    planner: PlannerSpec,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        Parameter(help="Write the certified trajectory (.csv, .json) or the trial (.h5)."),
    ] = None,
    force: Annotated[bool, Parameter(negative=(), help="Overwrite the file of --out.")] = False,
    rate: Annotated[float, number("Samples per second in a .csv file.", above=0, most=1e6)] = 1e3,
    json: Json = False,
) -> int:
    """Run one planner on one problem and verify its answer."""
    if out is not None:
        write = motion.writer(out)
        check_target(out, force=force)
    name, chosen = named(planner)
    file = catalogue.find(problem)
    trial = judge(chosen, catalogue.load(problem), [seed], name)[0]
    if json:
        path = None if file is None else str(file)
        names = {"problem": trial.problem.name, "problem_file": path}
        console.print_json(names | trial.as_dict())
    else:
        print_trial(trial, problem)
    if out is not None:
        if trial.certified_trajectory is None and out.suffix != ".h5":
            console.note(f"{out} is not written: no certified trajectory")
            return 1
        write(out, trial, rate)
    return 0 if trial.certified_duration or trial.lower_bound else 1


def check_target(path: Path, *, force: bool) -> None:
    """Find out before the work that a file cannot be written after it.

    Raises:
        InvalidInput: It is there already (and not `force`), is a folder, or its folder cannot be
            written or made.
    """
    if path.is_dir():
        raise InvalidInput("--out", "a file, not a folder", value=str(path))
    if path.exists() and not force:
        right = "a file that is not there yet, or --force to overwrite it"
        raise InvalidInput("--out", right, value=str(path))
    if path.exists():
        writable = os.access(path, os.W_OK)
    else:
        folder = _nearest_folder(path)
        writable = folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
    if not writable:
        raise InvalidInput("--out", "a file that can be written", value=str(path))


def _nearest_folder(path: Path) -> Path:
    """The closest ancestor that exists: folders between are made when the file is written."""
    for folder in path.absolute().parents:
        if folder.exists():
            return folder
    return path.absolute()


def print_trial(trial: Trial, problem: str) -> None:
    """The verdict, then the worst value of each kind; `problem` is the name or file asked for."""
    where = "" if problem == trial.problem.name else f" ({problem})"
    title = f"[bold]{console.markup(trial.label)}[/bold] on "
    title += console.markup(f"{trial.problem.name}{where}")
    console.OUT.print(f"{title}: [bold]{trial.status}[/bold]", soft_wrap=True)
    if trial.message:
        console.paragraph(trial.message.strip().splitlines()[-1])
    durations = {
        "claimed": trial.claimed_duration,
        "certified": trial.certified_duration,
        "lower bound": trial.lower_bound,
    }
    for name, value in durations.items():
        if value is not None:
            console.paragraph(f"  {name:<12}{value:.6f} s")
    certified = trial.certified_trajectory
    if certified is not None:
        passed = ", ".join(f"{t:.6g}" for t in certified.waypoint_times)
        console.paragraph(f"  {'waypoints':<12}{passed} s")
    computing = f"{trial.solve_time:.3f} s, after {trial.setup_time:.3f} s of setup"
    console.paragraph(f"  {'computing':<12}{computing}")
    if trial.certificate:
        console.OUT.print(_worst_values(trial.certificate.as_dict()))


def _worst_values(certificate: dict[str, Any]) -> Table:
    table = console.table("worst", "value", "joint", "time [s]")
    for kind in WORST_KINDS:
        worst = certificate[kind]
        if worst is None:
            continue
        if "ratio" in worst:
            value = f"{worst['ratio']:.6f} of limit"
        else:
            value = f"{worst['error']:.2e} {_UNITS[worst.get('order', 0)]}"
        table.add_row(kind, value, str(worst["joint"]), f"{worst['time']:.6f}")
    return table
