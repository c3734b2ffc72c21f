"""`trajopt plan`: one planner, one problem, one verdict."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter
from rich.table import Table

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial, judge
from trajopt.cli import asked, console
from trajopt.cli.asked import Robot
from trajopt.cli.best import Best, best, sentences
from trajopt.cli.parameters import Json, ProblemName, Seed, number
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.formats.waypoints import ENDINGS
from trajopt.judging.falling_velocity import Excess, excess
from trajopt.judging.verification import RATIO_KINDS, WORST_KINDS, Certificate, Worst
from trajopt.planners.registry import named
from trajopt.views.export import motion
from trajopt.views.export.motion import Executed, Points, Target, peak

_OWN_LIMITS = Robot()
_CYCLE = 1e-3  # s


def plan(
    problem: ProblemName,
    *,
    planner: Annotated[
        str | None,
        Parameter(help="NAME or NAME:key=value,...; by default the best one for the limits."),
    ] = None,
    robot: Annotated[Robot, Parameter(name="*")] = _OWN_LIMITS,
    seed: Seed = 0,
    out: Annotated[
        Path | None,
        Parameter(
            help="Write the certified motion: .csv, .yaml (a ROS message), .json, .png, .svg, "
            ".pdf; or the trial: .h5."
        ),
    ] = None,
    force: Annotated[bool, Parameter(negative=(), help="Overwrite the file of --out.")] = False,
    cycle: Annotated[
        float | None,
        number("Control cycle, s; all points are on it. By default 0.001.", least=1e-6, most=1e3),
    ] = None,
    rate: Annotated[
        float | None, number("The same as cycles per second.", above=0, most=1e6)
    ] = None,
    points: Annotated[
        Points | None,
        Parameter(help="Points at the motion's breaks (a message's), or every cycle (a CSV's)."),
    ] = None,
    json: Json = False,
) -> int:
    """Run one planner on one problem and verify its answer.

    The problem is a built-in name, a problem file, or a file of waypoints (.csv, .txt, .npy,
    .json) with --robot, --urdf or --limits.
    """
    target = None
    if out is not None:
        target = Target(out, _cycle(cycle, rate), points)
        check_target(out, force=force)
    asked_for = asked.problem(problem, robot, scaled=True)
    found = None
    if planner is None:
        with console.waiting(f"planning {asked_for.name}"):
            found = best(asked_for, seed)
        trial = found.trial
    else:
        name, chosen = named(planner)
        trial = judge(chosen, asked_for, [seed], name)[0]
    table = _table(trial, problem, found)
    if not json:
        print_trial(trial, problem)
        if found is not None:
            for sentence in sentences(found):
                console.paragraph(sentence)
    code = 0 if trial.is_answered else 1
    if target is not None:
        if trial.certified_trajectory is None and target.path.suffix != ".h5":
            console.note(f"{out} is not written: no certified trajectory")
            code = 1
        else:
            executed = motion.write(target, trial)
            table["out"] = {"file": str(out)} | (executed.as_dict() if executed else {})
            if not json:
                console.paragraph(_written(target, trial, executed))
    if json:
        console.print_json(table)
    return code


def _cycle(cycle: float | None, rate: float | None) -> float:
    """The control cycle, s, in whole nanoseconds."""
    if cycle is not None and rate is not None:
        raise InvalidInput("--rate", "--cycle or --rate, not both", value=rate)
    seconds = _CYCLE if cycle is None else cycle
    if rate is not None:
        seconds = 1 / rate
    return max(round(seconds, 9), 1e-6)


def _written(target: Target, trial: Trial, executed: Executed | None) -> str:
    """What was written, and what a controller makes of it."""
    if executed is None:
        return f"{target.path} is written."
    certificate = executed.certificate
    return (
        f"{target.path}: {executed.points} points, {executed.duration:.6g} s "
        f"({100 * executed.longer:.2f} % longer, for whole cycles of {target.cycle:g} s). Read "
        f"again and executed with {executed.pieces} pieces it keeps every limit: "
        f"{peak(certificate, trial)}. It passes every waypoint (to "
        f"{certificate.waypoint.value:.0e} {trial.problem.unit(certificate.waypoint.joint)})."
    )


def _table(trial: Trial, problem: str, found: Best | None) -> dict[str, Any]:
    """For JSON."""
    file = Path(problem) if Path(problem).suffix in ENDINGS else catalogue.find(problem)
    path = None if file is None else str(file)
    names = {"problem": trial.problem.name, "problem_file": path}
    choice = {} if found is None else found.as_dict()
    return names | trial.as_dict() | choice


def check_target(path: Path, *, force: bool, key: str = "--out") -> None:
    """Find out before the work that a file cannot be written after it.

    Raises:
        InvalidInput: It is there already (and not `force`), is a folder, or its folder cannot be
            written or made.
    """
    if path.is_dir():
        raise InvalidInput(key, "a file, not a folder", value=str(path))
    if path.exists() and not force:
        right = "a file that is not there yet, or --force to overwrite it"
        raise InvalidInput(key, right, value=str(path))
    if path.exists():
        writable = os.access(path, os.W_OK)
    else:
        folder = _nearest_folder(path)
        writable = folder.is_dir() and os.access(folder, os.W_OK | os.X_OK)
    if not writable:
        raise InvalidInput(key, "a file that can be written", value=str(path))


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
        console.OUT.print(worst_values(trial.certificate, trial.problem))
    if certified is not None and trial.problem.falling_velocity:
        found = excess(trial.problem.falling_velocity, certified)
        console.paragraph(own_velocity_limits(found, trial.problem))


def own_velocity_limits(found: Excess, problem: Problem) -> str:
    """Whether a motion keeps the arm's own velocity limits, which fall towards position limits."""
    limits = "the arm's own velocity limits, which fall near its position limits"
    if found.kept:
        return f"It keeps {limits}."
    unit = problem.unit(found.joint, order=1)
    joint = problem.joint_labels[found.joint]
    return (
        f"It breaks {limits}: {joint} by {found.value:.4g} {unit} at {found.time:.6g} s, where it "
        f"moves at {found.velocity:.4g} and may at {found.allowed:.4g} {unit}; some joint is too "
        f"fast for {100 * found.share:.1f} % of the time. No planner here keeps these limits yet."
    )


def worst_values(certificate: Certificate, problem: Problem) -> Table:
    """The worst of each kind; a joint by its name where it has one."""
    table = console.table("worst", "value", "joint", "time [s]")
    for kind in WORST_KINDS:
        worst: Worst | None = getattr(certificate, kind)
        if worst is None:
            continue
        if kind in RATIO_KINDS:
            value = f"{worst.value:.6f} of limit"
        else:
            value = f"{worst.value:.2e} {problem.unit(worst.joint, worst.order)}"
        label = problem.joint_labels[worst.joint]
        joint = console.markup(label.removeprefix("joint "))
        table.add_row(kind, value, joint, f"{worst.time:.6f}")
    return table
