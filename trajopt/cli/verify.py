"""`trajopt verify`: check stored trials again, or a motion against a robot's limits."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt.benchmark.judgement import Execution, as_executed
from trajopt.benchmark.store.folder import is_trial
from trajopt.benchmark.store.verification import CheckedTrial, Verification, verification
from trajopt.benchmark.suites import catalogue
from trajopt.cli import asked, console
from trajopt.cli.asked import Robot
from trajopt.cli.console import Grid
from trajopt.cli.parameters import InterpolationName, Json
from trajopt.cli.plan import print_worst
from trajopt.core.arm_file import arm_files
from trajopt.core.exceptions import InvalidInput
from trajopt.core.interpolation import Interpolation
from trajopt.formats.motion import ENDINGS, Motion, motion
from trajopt.judging.verification import Certificate

_NO_ROBOT = Robot()
MAX_TRIALS_LISTED = 200  # of more trials, only those that do not hold are listed
_NUMBERS = ("seed", "claimed s", "certified s", "dilation", "verdict")


def verify(
    path: Annotated[Path, Parameter(help="Results folder or results.h5; or a motion's file.")],
    *,
    robot: Annotated[Robot, Parameter(name="*")] = _NO_ROBOT,
    interpolation: InterpolationName = "auto",
    json: Json = False,
) -> int:
    """Verify every stored trajectory anew, from the file alone; or a motion within limits.

    Limits are a robot's (--robot, --urdf, and --limits joint_limits.yaml over it); --limits alone
    takes a robot's or a problem's name too.

    A motion needs no waypoints: told are its peaks as a controller runs it, the slow-down that it
    needs, and how fast it may run at most.
    """
    if path.suffix in ENDINGS and not path.is_dir() and not is_trial(path):
        return _verify_motion(path, robot, interpolation, json)
    if robot.said or interpolation != "auto":
        right = f"a motion's file ({', '.join(ENDINGS)}) with limits and --interpolation"
        raise InvalidInput("PATH", right, value=str(path))
    found = verification(path)
    if json:
        rows = [trial.as_dict() for trial in found.trials]
        console.print_json(
            {
                "holds": found.holds,
                "summary": found.summary(),
                "trials": rows,
            }
        )
    else:
        _print(found)
    return 0 if found.holds else 1


def _verify_motion(
    path: Path,
    robot: Robot,
    interpolation: Interpolation,
    json: bool,
) -> int:
    """Judge a motion as a controller runs it, by limits alone."""
    if robot.unit is not None:
        right = "no such flag: a motion's columns have their units in the header"
        raise InvalidInput("--unit", right, value=robot.unit)
    if not robot.said:
        right = "joint_limits.yaml, a robot or a problem, whose limits the motion is to keep"
        raise InvalidInput("--limits", right)
    given = motion(path, interpolation)
    found = _executed(given, robot)
    if json:
        console.print_json(found.as_dict())
    else:
        _print_execution(found, ", ".join(map(str, robot.said.values())))
    return 0 if found.kept else 1


def _executed(given: Motion, robot: Robot) -> Execution:
    """Judge the motion by the limits of a file, a robot or a problem.

    Joints are found by their names, or in their order where the motion or the problem has none.
    """
    if robot.limits is not None and robot.limits.suffix not in (".yaml", ".yml"):
        if len(robot.said) > 1:
            right = "joint_limits.yaml beside --robot or --urdf"
            raise InvalidInput("--limits", right, value=str(robot.limits))
        name = str(robot.limits)
        if robot.limits.is_file() or name not in arm_files():
            problem = catalogue.load(name)
            return as_executed(
                given.for_joints(problem.joint_names),
                problem.limits,
                joint_units=problem.joint_units,
                falling_velocity=problem.falling_velocity,
            )
        robot = Robot(robot=name)
    own = asked.robot_limits(given.name, robot)
    names = given.joint_names or own.names_of(given.trajectory.joints)
    described = own.described(names)
    del described["joint_names"]
    return as_executed(given, own.limits(names), **described)


def _print_execution(found: Execution, limits: str) -> None:
    verdict = "feasible" if found.kept else "not feasible"
    console.headline(found.motion.name, f" within {limits}: ", verdict)
    certificate = found.certificate
    pieces = len(found.motion.trajectory.lengths)
    kind = found.motion.interpolation
    console.paragraph(f"Executed with {pieces} {kind} pieces, {certificate.duration:.6f} s.")
    for sentence in _mended(certificate):
        console.paragraph(sentence)
    print_worst(certificate, found.excess, found.problem)


def _mended(certificate: Certificate) -> Iterator[str]:
    if certificate.flaws:
        yield f"No slow-down mends it: {'; '.join(certificate.flaws)}."
        return
    fastest = certificate.dilation * certificate.duration
    if certificate.feasible:
        faster = 1 / certificate.dilation
        yield f"Time-scaled it could run {faster:.6f} times as fast, in {fastest:.6f} s."
    else:
        yield f"Slowed down {certificate.dilation:.6f} times, to {fastest:.6f} s, it keeps them."


def _print(found: Verification) -> None:
    wrong = [trial for trial in found.trials if not trial.holds]
    shown = found.trials if len(found.trials) <= MAX_TRIALS_LISTED else wrong
    if shown:
        console.OUT.print(_table(shown))
    for sentence in found.summary():
        console.paragraph(sentence)
    if len(found.trials) > len(shown):
        console.paragraph("Trials that hold are not listed; --json has all of them.")
    for trial in wrong:
        console.paragraph(_what_is_wrong(trial))


def _table(trials: Iterable[CheckedTrial]) -> Grid:
    table = console.table("problem", "planner", *_NUMBERS, numbers=_NUMBERS)
    for trial in trials:
        durations = (trial.claimed_duration, trial.certified_duration, trial.dilation)
        table.row(
            trial.problem,
            console.option_lines(trial.planner),
            console.number(trial.seed, "d"),
            *(console.number(value, ".6f") for value in durations),
            trial.status if trial.holds else console.alarm("DOES NOT HOLD"),
        )
    return table


def _what_is_wrong(trial: CheckedTrial) -> str:
    name = f"{trial.planner} on {trial.problem}, seed {trial.seed}, trial {trial.id}"
    return f"{name}: {'; '.join([*trial.differences, *filter(None, trial.flaws)])}"
