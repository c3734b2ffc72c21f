"""`trajopt plan`: run one planner on one problem, verify and write its answer."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from cyclopts import Parameter

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import BETTER_RTOL
from trajopt.benchmark.front import smoothest as smoothest_of
from trajopt.benchmark.run.runner import Supervised
from trajopt.benchmark.trial import Trial
from trajopt.best_planner import best
from trajopt.cli import asked, console, starting
from trajopt.cli.asked import NO_FLAGS, RobotFlags
from trajopt.cli.best_words import ADD_JERK_LIMITS, sentences
from trajopt.cli.parameters import WRITING, Json, ProblemName, Seed, Timeout, Writing, number
from trajopt.cli.starting import NO_START, StartFlags
from trajopt.core.braking import brake_first
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.formats import yaml_file
from trajopt.judging.certificate import Certificate
from trajopt.judging.smoothness import Smoothness, unit
from trajopt.judging.verification import verify
from trajopt.views import table_cells
from trajopt.views.export import motion_file
from trajopt.views.export.motion_file import PICTURES, Executed, Points, Target

_CYCLE_S = 1e-3
_PROOF_TIME_S = 1.0
# Segments times joints that are smoothed in a few seconds.
_MOST_SMOOTHED = 200
_MAX_ARGUMENT_BYTES = 131_072  # of one argument, in Linux

Form = Literal["message", "goal"]


def plan(
    problem: ProblemName,
    *,
    planner: str | None = None,
    robot: RobotFlags = NO_FLAGS,
    start: StartFlags = NO_START,
    seed: Seed = 0,
    out: Writing[Path | None] = None,
    force: Writing[bool] = False,
    out_anyway: Writing[bool] = False,
    cycle: Annotated[
        float | None,
        number(
            "Control cycle, s; all points are on it. By default 0.001.",
            least=1e-6,
            most=1e3,
            group=WRITING,
        ),
    ] = None,
    rate: Annotated[
        float | None, number("Control cycles per second.", above=0, most=1e6, group=WRITING)
    ] = None,
    points: Writing[Points | None] = None,
    form: Annotated[
        Form,
        Parameter(
            name="--as", help="A ROS message, or a FollowJointTrajectory goal.", group=WRITING
        ),
    ] = "message",
    smoothest: Annotated[bool | None, Parameter(negative="--no-smoothest")] = None,
    timeout: Timeout = 600.0,
    json: Json = False,
) -> int:
    """Run one planner on one problem and verify its answer.

    The problem is a built-in name, a problem file, or a file of waypoints (.csv, .txt, .npy,
    .json) with --robot, --urdf or --limits.

    Args:
        planner: NAME or FILE.py:NAME, as `trajopt explain`; by default the best one.
        out: Write the certified motion: .csv, .yaml (ROS), .json, .png, .svg, .pdf; the trial: .h5.
        force: Overwrite the file of --out.
        out_anyway: Write the motion even if it breaks a limit at any speed.
        smoothest: Of all motions with its waypoint times take the smoothest, joint by joint. By
            default so in pictures and in samples of every cycle, where no planner is named.
        points: Points at the motion's breaks (a message's), or every cycle (a CSV's).
    """
    target = None
    if out is not None:
        target = Target(out, _cycle(cycle, rate), points, form == "goal")
        check_target(out, force=force)
    asked_for = starting.problem(problem, robot, start)
    on_cycle = target is not None and target.path.suffix not in (*PICTURES, ".h5")
    cycle_s = target.cycle if target is not None and on_cycle else 0.0
    braking = brake_first(asked_for, cycle_s) if start.brake_first else None
    planned = braking.rest if braking else asked_for
    found = None
    with console.waiting(f"planning {asked_for.name}", long=True) as tell:
        if planner is None:
            found = best(planned, seed, _PROOF_TIME_S, tell, timeout)
            trial = found.trial
        else:
            with closing(Supervised(planner, planned, timeout=timeout)) as chosen:
                (trial,) = chosen.trials(planned, [seed])
        if smoothest is None:
            smoothest = planner is None and target is not None and _shows(target, planned)
        if smoothest:
            tell("the joints that do not decide are smoothed")
            trial = _smoothest(trial)
    if braking:
        trial = starting.braked(braking, trial)
    names = {"problem": trial.problem.name, "problem_file": asked.file(problem)}
    table = names | trial.as_dict() | (found.as_dict() if found else {}) | starting.as_dict(braking)
    if not json:
        print_trial(trial, problem)
        if braking:
            starting.print_braking(braking)
        about = "After the braking: " if braking else ""
        for sentence in sentences(found) if found else _of_one_planner(trial):
            console.paragraph(f"{about}{sentence}")
            about = ""
    broken = _unmended(trial)
    code = 0 if (out_anyway if broken else trial.is_answered) else 1
    written = _without(trial, broken)
    if target is not None and broken and not out_anyway and target.path.suffix != ".h5":
        kinds = " and ".join(KINDS[key].name() for key in broken)
        console.note(f"{out} is not written: the motion breaks {kinds} limits; --out-anyway does")
    elif target is not None and not written.certified_trajectory and target.path.suffix != ".h5":
        console.note(f"{out} is not written: no certified trajectory")
        code = 1
    elif target is not None:
        units = asked.units(problem, robot)
        executed = motion_file.write(replace(target, units=units), written)
        table["out"] = {"file": out} | (executed.as_dict() if executed else {})
        if not json:
            every = "every other limit" if broken else "every limit"
            console.paragraph(_written(target, written, executed, every))
        if target.goal and not json:
            console.line(f"Send it: {_sending(target.path)}")
    if json:
        console.print_json(table)
    return code


def _shows(target: Target, problem: Problem) -> bool:
    """Return whether a file shows how smooth a motion is: a picture, or samples of every cycle.

    A message has points at the breaks, and the smoothest motion has several times as many. A route
    of many segments and joints would take too long.
    """
    shown = target.path.suffix in PICTURES or (target.executed and not target.at_breaks)
    return shown and problem.segments * problem.joints <= _MOST_SMOOTHED


def _smoothest(trial: Trial) -> Trial:
    """Return the trial with the smoothest motion of its duration, if it keeps every limit."""
    motion = trial.solution.trajectory
    if motion is None or not trial.feasible:
        return trial
    own = smoothest_of(trial.problem, motion)
    solution = replace(trial.solution, trajectory=own)
    return replace(trial, solution=solution, certificate=verify(trial.problem, own))


def _unmended(trial: Trial) -> list[str]:
    """Return the keys of the limits that the motion breaks however it is slowed down."""
    uses = trial.certificate.uses if trial.certificate else {}
    return [key for key, use in uses.items() if use.value == np.inf]


def _without(trial: Trial, keys: list[str]) -> Trial:
    """Return the trial, judged without these limits."""
    motion = trial.solution.trajectory
    if not keys or motion is None:
        return trial
    lifted = trial.problem.without(*keys)
    return replace(trial, problem=lifted, certificate=verify(lifted, motion))


def _of_one_planner(trial: Trial) -> Iterator[str]:
    """Say that a shorter motion is known; that a planner of jerk limits was given none."""
    record = records.find(trial.problem)
    duration = trial.certified_duration
    if record is not None and duration and duration > record.duration * (1 + BETTER_RTOL):
        above = table_cells.percent(duration / record.duration - 1)
        yield (
            f"The best known motion takes {record.duration:.6f} s ({record.motion}): this one is "
            f"{above} above it."
        )
    if trial.planner == "exact-jerk" and not trial.problem.has("jerk"):
        yield f"{trial.problem.name} has no jerk limits: {ADD_JERK_LIMITS}"


def _cycle(cycle: float | None, rate: float | None) -> float:
    """Return the control cycle, s, rounded to nanoseconds."""
    if cycle is not None and rate is not None:
        raise InvalidInput("--rate", "--cycle or --rate, not both", value=rate)
    seconds = 1 / rate if rate else cycle or _CYCLE_S
    return max(round(seconds, 9), 1e-6)


def _written(target: Target, trial: Trial, executed: Executed | None, every: str) -> str:
    """Tell what was written, and how a controller executes it."""
    if executed is None:
        return f"{target.path} is written."
    certificate = executed.certificate
    return (
        f"{target.path}: {executed.points} points, {executed.duration:.6g} s "
        f"({100 * executed.longer:.2f} % longer, for whole cycles of {target.cycle:g} s). Read "
        f"again and executed with {executed.pieces} pieces it keeps {every}: "
        f"{certificate.peak(trial.problem)}. It passes every waypoint (to "
        f"{certificate.waypoint.value:.0e} {trial.problem.unit(certificate.waypoint.joint)})."
    )


def _sending(path: Path) -> str:
    """Return the command of ROS 2 that sends a goal to a controller."""
    action = "/joint_trajectory_controller/follow_joint_trajectory"
    command = f"ros2 action send_goal {action} control_msgs/action/FollowJointTrajectory"
    file = shlex.quote(str(path))
    if path.stat().st_size < _MAX_ARGUMENT_BYTES:
        return f'{command} "$(cat {file})"'
    return f"{command} --stdin < {file}"


def check_target(path: Path, *, force: bool, key: str = "--out") -> None:
    """Check before the work whether a file can be written after it.

    Raises:
        InvalidInput: The file exists (and `force` is False), is a folder, or its folder cannot be
            written or made.
        MissingBackend: YAML needs a package that is not installed.
    """
    if path.suffix in (".yaml", ".yml"):
        yaml_file.check_installed()
    if path.is_dir():
        raise InvalidInput(key, "a file, not a folder", value=str(path))
    if path.exists() and not force:
        right = "a file that is not there yet, or --force to overwrite it"
        raise InvalidInput(key, right, value=str(path))
    # missing parent folders are made when the file is written
    nearest = path if path.exists() else next(p for p in path.absolute().parents if p.exists())
    needed = os.W_OK if nearest == path else os.W_OK | os.X_OK
    if nearest.is_dir() == (nearest == path) or not os.access(nearest, needed):
        raise InvalidInput(key, "a file that can be written", value=str(path))


def print_trial(trial: Trial, problem: str) -> None:
    """Print the verdict and the worst values; `problem` is the name or file that was asked for."""
    where = "" if problem == trial.problem.name else f" ({problem})"
    grade = table_cells.grade(trial.status, feasible=trial.feasible, slower=trial.dilation)
    console.headline(trial.label, f" on {trial.problem.name}{where}: ", grade)
    if trial.message:
        console.paragraph(console.last_line(trial.message))
    certified = trial.certified_trajectory
    print_durations(
        trial.claimed_duration,
        trial.certified_duration,
        None if certified is None else certified.waypoint_times,
        trial.lower_bound,
    )
    inside = table_cells.seconds(trial.library_time)
    library = "" if inside == table_cells.MISSING else f" ({inside} s of it in the library)"
    console.paragraph(
        f"  computing   {trial.solve_time:.3f} s{library}, after {trial.setup_time:.3f} s of setup"
    )
    print_smoothness(trial.smoothness, trial.problem)
    if trial.certificate:
        print_worst(trial.certificate, trial.problem)


def print_durations(
    claimed: float | None,
    certified: float | None,
    waypoint_times: Iterable[float] | None,
    lower_bound: float | None = None,
) -> None:
    """Print the durations that exist, s, and when the motion passes its waypoints, s."""
    durations = {"claimed": claimed, "certified": certified, "lower bound": lower_bound}
    for name, value in durations.items():
        if value is not None:
            console.paragraph(f"  {name:<12}{value:.6f} s")
    if waypoint_times is not None:
        times = [f"{time:.6g}" for time in waypoint_times]
        console.paragraph(f"  waypoints   {', '.join(times)} s")


def print_worst(certificate: Certificate, problem: Problem) -> None:
    """Print the worst use of each limit, the worst miss and the worst jump."""
    table = console.table("worst", "value", "joint", "time [s]")
    for key, use in certificate.uses.items():
        joint = "" if use.joint is None else _short_label(problem, use.joint)
        table.row(KINDS[key].name(), KINDS[key].amount(use, problem), joint, f"{use.time:.6f}")
    if certificate.least_times is not None:
        share, _, begins = certificate.least_times
        table.row("least times", f"{share:.6f} of time taken", "", f"{begins:.6f}")
    for name, worst in {
        "waypoint": certificate.waypoint,
        "continuity": certificate.continuity,
    }.items():
        value = f"{worst.value:.2e} {problem.unit(worst.joint, worst.order)}"
        table.row(name, value, _short_label(problem, worst.joint), f"{worst.time:.6f}")
    console.OUT.print(table)
    if certificate.rounded is not None:
        console.paragraph(
            f"Kept as returned: it misses a state by {certificate.rounded:.1g} of its rounding."
        )


def _short_label(problem: Problem, joint: int) -> str:
    return problem.joint_labels[joint].removeprefix("joint ")


def print_smoothness(found: Smoothness | None, problem: Problem) -> None:
    """Print the integrals of a certified motion; of an infinite one, what jumps."""
    if found is None:
        return
    integrals = {"acceleration": found.acceleration_integral, "jerk": found.jerk_integral}
    for order, (name, value) in enumerate(integrals.items(), start=2):
        if np.isfinite(value):
            text = f"{table_cells.integral(value)} {unit(problem, order)}"
        elif found.jump is not None:
            jump = found.jump
            joint = problem.joint_labels[jump.joint]
            size = f"{jump.value:.4g} {problem.unit(jump.joint, jump.order)}"
            text = f"infinite: {joint} jumps by {size} at {jump.time:.6g} s"
        else:
            text = "infinite"
        console.paragraph(f"  {f'∫ {name}²':<16}{text}")
