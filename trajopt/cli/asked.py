"""Read the problem of a command: by its name, by its file, or as waypoints with a robot.

`trajopt plan six-axis`, `trajopt plan mine.toml`, `trajopt judge motion.csv waypoints.csv --robot
ur5e`, `trajopt verify motion.csv --urdf robot.urdf --limits joint_limits.yaml`. A file of the wrong
kind is named for what it is (`kinds`).
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from trajopt.benchmark.suites import catalogue
from trajopt.cli import console, kinds
from trajopt.cli.parameters import ROBOT, number
from trajopt.core import files, problem_file
from trajopt.core.arrays import Array
from trajopt.core.exceptions import FileNote, InvalidInput, TrajoptError
from trajopt.core.limits import KINDS, Limits
from trajopt.core.problem import Problem
from trajopt.formats import arms, joint_limits, urdf, waypoints
from trajopt.formats.motion import WITH_UNITS
from trajopt.formats.robot_limits import RobotLimits


@dataclass(frozen=True)
class RobotOptions:
    """The flags that give waypoints of a file their limits.

    Attributes:
        robot: Robot of the waypoints; see `trajopt list`.
        urdf: URDF of the waypoints' robot: joint names, positions, velocities.
        limits: MoveIt's joint_limits.yaml: adds to the robot's limits, or replaces them.
        unit: Units of waypoints (or of a motion) without a header, such as deg,mm,ms.
        no_unwrap: Keep whole turns of joints that a URDF calls continuous.
    """

    robot: str | None = None
    urdf: Path | None = None
    limits: Path | None = None
    unit: str | None = None
    acceleration: Annotated[
        float | None, number("Acceleration limit of joints without one, rad/s^2 (m/s^2).", above=0)
    ] = None
    no_unwrap: bool = False
    payload: Annotated[
        float | None, number("Mass at the tool, kg, for limits of torque.", above=0)
    ] = None

    @property
    def numbers(self) -> dict[str, float | str]:
        """Return the limits that are one number or text, by key (`Limit.flag`)."""
        stated = {key: getattr(self, key, None) for key in _FLAGS}
        return {key: number for key, number in stated.items() if number is not None}

    @property
    def of_waypoints(self) -> dict[str, object]:
        """Return the flags that were given and go with waypoints alone, with their values."""
        flags = {
            "--robot": self.robot,
            "--urdf": self.urdf,
            "--limits": self.limits,
            "--unit": self.unit,
            "--acceleration": self.acceleration,
            "--no-unwrap": self.no_unwrap or None,
        }
        return {flag: value for flag, value in flags.items() if value is not None}

    @property
    def said(self) -> dict[str, object]:
        """Return all flags that were given, with their values."""
        numbers = {f"--{key.replace('_', '-')}": own for key, own in self.numbers.items()}
        carried = {} if self.payload is None else {"--payload": self.payload}
        return {**self.of_waypoints, **carried, **numbers}


MotionUnit = Annotated[
    str | None,
    Parameter(
        help="Units of the motion where its header has none, as --unit of waypoints.", group=ROBOT
    ),
]
_FLAGS = {key: kind.flag for key, kind in KINDS.items() if kind.flag}


def _with_numbers() -> type[RobotOptions]:
    """Return the flags with an option for each kind of limit that is one number."""
    hints: dict[str, Any] = {}
    for key, words in _FLAGS.items():
        if KINDS[key].flag_is_text:
            hints[key] = Annotated[str | None, Parameter(help=words)]
        else:
            hints[key] = Annotated[float | None, number(words, above=0)]
    members = {"__annotations__": hints, "__module__": __name__, **dict.fromkeys(hints)}
    return dataclass(frozen=True)(type("RobotFlags", (RobotOptions,), members))


if TYPE_CHECKING:
    RobotFlags = RobotOptions
else:
    RobotFlags = Annotated[_with_numbers(), Parameter(name="*", group=ROBOT)]
NO_FLAGS = RobotOptions()
_PAYLOAD = "a limit that it weighs on beside it, as --torque urdf"


def file(name_or_path: str) -> Path | None:
    """Return the file of a problem or of waypoints; None for a problem that code generates."""
    if _is_waypoints(name_or_path):
        return Path(name_or_path)
    return catalogue.find(name_or_path)


def _is_waypoints(name_or_path: str) -> bool:
    return Path(name_or_path).suffix in waypoints.ENDINGS


def problems(names: Sequence[str], robot: RobotOptions) -> list[Problem]:
    """Return several problems to plan, each once; the flags go to those that are waypoints."""
    if not any(map(_is_waypoints, names)):
        _check_unused(", ".join(names) or "--suite", robot)
    found = []
    for name in names:
        if _is_waypoints(name):
            found.append(problem(name, robot, scaled=True))
        else:
            found.append(with_numbers(problem(name, scaled=True), robot))
    return found


def with_numbers(problem: Problem, robot: RobotOptions) -> Problem:
    """Return a problem with the limits that are one number, in place of its own of these kinds."""
    if not robot.numbers:
        if robot.payload is not None:
            raise InvalidInput("--payload", _PAYLOAD, value=robot.payload)
        return problem
    limits: dict[str, Any] = {**problem.limits.kinds, **robot.numbers}
    try:
        chain = catalogue.chain(problem)
        if chain is not None and robot.payload is not None:
            chain = chain.carrying({"mass": robot.payload})
        return replace(problem, limits=Limits(**limits), chain=chain)
    except InvalidInput as error:
        raise error.in_file(problem.name) from None


def problem(
    name_or_path: str,
    robot: RobotOptions = NO_FLAGS,
    *,
    scaled: bool = False,
    start: Callable[[Sequence[str], int], Sequence[Array]] | None = None,
) -> Problem:
    """Return a problem by its built-in name, its file, or as waypoints with a robot.

    Args:
        name_or_path: A built-in name, a problem file, or a file of waypoints.
        robot: The flags.
        scaled: Whether to apply the scaling factors of a `joint_limits.yaml`, as MoveIt's planners
            do; a line then says so.
        start: The state in which waypoints of a file begin, as `waypoints.problem` takes it.

    Raises:
        TrajoptError: The flags do not go with it, there is no problem or robot of this name, or a
            file cannot be used; it says which, and what would be right.
    """
    path = Path(name_or_path)
    with kinds.reading(path, "waypoints" if robot.said else "problem"):
        if not _is_waypoints(name_or_path):
            _check_unused(name_or_path, robot)
            return with_numbers(catalogue.load(name_or_path), robot)
        if not path.exists():
            raise files.absent(path)
        own = robot_limits(name_or_path, robot)
        planned = own.scaled() if scaled else own
        if planned is not own:
            console.HELD.append(
                f"{robot.limits}: planned with {100 * own.velocity_scaling:g} % of the velocity "
                f"and {100 * own.acceleration_scaling:g} % of the acceleration limits, its default "
                "scaling factors; write 1.0 there for all of them"
            )
        elif not scaled:
            note_factors(own, robot)
        found = waypoints.problem(
            path, planned, robot.unit, unwrap=not robot.no_unwrap, start=start
        )
        note_acceleration(robot, completed=own.completed.intersection(found.joint_names))
        return found


def note_factors(own: RobotLimits, robot: RobotOptions) -> None:
    """Note that scaling factors are ignored where a motion is judged."""
    if own.scaled() is not own:
        console.HELD.append(
            f"{robot.limits}: its default scaling factors (velocity {own.velocity_scaling:g}, "
            f"acceleration {own.acceleration_scaling:g}) are not applied, they are no limits of "
            "the robot; for the scaled limits multiply max_velocity and max_acceleration there"
        )


def note_acceleration(robot: RobotOptions, *, completed: Collection[str]) -> None:
    """Note that --acceleration had no effect if every joint had an acceleration limit."""
    if robot.acceleration is not None and not completed:
        console.HELD.append(
            f"--acceleration {robot.acceleration:g} has no effect: every joint has an acceleration "
            "limit already; lower ones go into a joint_limits.yaml behind --limits"
        )


@contextmanager
def reading_motion(path: Path) -> Iterator[None]:
    """Read a motion where waypoints are read too; errors name the flag of the motion's units."""
    try:
        with kinds.reading(path, "motion"):
            yield
    except TrajoptError as error:
        raise TrajoptError(str(error).replace("unit=", "--motion-unit ")) from None


def check_motion_unit(unit: str | None, motions: Sequence[Path], flag: str) -> None:
    """Refuse --motion-unit if no motion is a table: messages are always in rad and m."""
    if unit is not None and not any(path.suffix in WITH_UNITS for path in motions):
        names = ", ".join(path.name for path in motions) or "no motion"
        raise InvalidInput(flag, f"no such flag with {names}, which is in rad and m", value=unit)


def _check_unused(name: str, robot: RobotOptions) -> None:
    for flag, value in robot.of_waypoints.items():
        endings = ", ".join(waypoints.ENDINGS)
        right = f"no such flag with {name}, which has its own; it goes with waypoints ({endings})"
        raise InvalidInput(flag, right, value=str(value))


def robot_limits(name: str, robot: RobotOptions) -> RobotLimits:
    """Return the limits of the robot, completed or replaced by those of --limits.

    Args:
        name: The name of the problem or motion, for errors.
        robot: The flags.

    Raises:
        TrajoptError: No flag says whose limits; two do; or a file cannot be used.
    """
    if robot.robot is not None and robot.urdf is not None:
        raise InvalidInput("--urdf", "--robot or --urdf, not both", value=str(robot.urdf))
    sources = []
    if robot.robot is not None:
        sources.append(arms.named(robot.robot))
    if robot.urdf is not None:
        with kinds.reading(robot.urdf, "--urdf"):
            sources.append(urdf.read(robot.urdf))
    if robot.limits is not None:
        with kinds.reading(robot.limits, "--limits"):
            sources.append(joint_limits.read(robot.limits))
    if not sources:
        raise TrajoptError(f"{name}: give limits with --urdf, --limits or --robot")
    found = reduce(RobotLimits.updated, sources)
    if not found.joints:
        right = "at least one joint, or --robot or --urdf beside the scaling factors"
        raise InvalidInput("joint_limits", right, file=found.source)
    if robot.acceleration is not None:
        found = found.with_acceleration(robot.acceleration)
    if robot.payload is not None and not robot.numbers:
        raise InvalidInput("--payload", _PAYLOAD, value=robot.payload)
    return replace(found, stated=robot.numbers, payload=robot.payload)


def units(name_or_path: str, robot: RobotOptions) -> Sequence[str]:
    """Return the units of a file's waypoints, one per joint; empty for a built-in name."""
    path = Path(name_or_path)
    if _is_waypoints(name_or_path):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", FileNote)  # these notes were printed for the problem
            return waypoints.units(path, robot_limits(name_or_path, robot), robot.unit)
    return problem_file.units(path) if path.is_file() else ()
