"""Read the problem of a command: by its name, by its file, or as waypoints with a robot.

`trajopt plan six-axis`, `trajopt plan mine.toml`, `trajopt judge motion.csv waypoints.csv --robot
ur5e`, `trajopt verify motion.csv --urdf robot.urdf --limits joint_limits.yaml`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt.benchmark.suites import catalogue
from trajopt.cli import console
from trajopt.cli.parameters import number
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.formats import arms, joint_limits, urdf, waypoints
from trajopt.formats.robot_limits import RobotLimits
from trajopt.formats.waypoints import Unit

_SOURCES = "--robot NAME, --urdf FILE or --limits joint_limits.yaml"


@dataclass(frozen=True)
class Robot:
    """The flags that give waypoints of a file their limits.

    Attributes:
        robot: A built-in arm's name.
        urdf: A robot description.
        limits: A `joint_limits.yaml`: it says what the others do not, or other values.
        unit: Of the waypoints' angles.
        acceleration: Of joints that have no such limit, rad/s² (m/s²).
    """

    robot: Annotated[str | None, Parameter(help="Robot of the waypoints; see `trajopt list`.")] = (
        None
    )
    urdf: Annotated[
        Path | None,
        Parameter(help="URDF of the waypoints' robot: joint names, positions, velocities."),
    ] = None
    limits: Annotated[
        Path | None,
        Parameter(help="MoveIt's joint_limits.yaml: adds to the robot's limits, or replaces them."),
    ] = None
    unit: Annotated[
        Unit | None, Parameter(help="Unit of the waypoints' angles; by default rad.")
    ] = None
    acceleration: Annotated[
        float | None,
        number("Acceleration limit of joints without one, rad/s^2 (m/s^2).", above=0),
    ] = None

    @property
    def said(self) -> dict[str, object]:
        """The flags that were given, with their values."""
        flags = {
            "--robot": self.robot,
            "--urdf": self.urdf,
            "--limits": self.limits,
            "--unit": self.unit,
            "--acceleration": self.acceleration,
        }
        return {flag: value for flag, value in flags.items() if value is not None}


def problem(
    name_or_path: str,
    robot: Robot,
    *,
    scaled: bool = False,
) -> Problem:
    """Return a problem by its built-in name, its file, or as waypoints with a robot.

    Args:
        name_or_path: A built-in name, a problem file, or a file of waypoints.
        robot: The flags.
        scaled: Whether the scaling factors of a `joint_limits.yaml` count, as they do for MoveIt's
            planners; then a line says so.

    Raises:
        InvalidInput: The flags do not go with it, or a file cannot be used; it says which, and
            what would be right.
        UnknownName: There is no problem or robot of this name.
    """
    path = Path(name_or_path)
    if path.suffix not in waypoints.ENDINGS:
        _check_unused(name_or_path, robot)
        return catalogue.load(name_or_path)
    if not path.is_file():
        right = "a file of waypoints that exists"
        raise InvalidInput("problem", right, file=name_or_path)
    own = robot_limits(name_or_path, robot)
    planned = own.scaled() if scaled else own
    if planned is not own:
        console.note(
            f"{robot.limits}: planned with {100 * own.velocity_scaling:g} % of the velocity and "
            f"{100 * own.acceleration_scaling:g} % of the acceleration limits, its default scaling "
            "factors; write 1.0 there for all of them"
        )
    return waypoints.problem(path, planned, robot.unit)


def _check_unused(name: str, robot: Robot) -> None:
    for flag, value in robot.said.items():
        endings = ", ".join(waypoints.ENDINGS)
        right = f"no such flag with {name}, which has its own; it goes with waypoints ({endings})"
        raise InvalidInput(flag, right, value=str(value))


def robot_limits(name: str, robot: Robot) -> RobotLimits:
    """The limits of the robot, and of the file of limits over it.

    Args:
        name: What they are for, as an error names it.
        robot: The flags.

    Raises:
        InvalidInput: No flag says whose limits; two do; or a file cannot be used.
    """
    if robot.robot is not None and robot.urdf is not None:
        raise InvalidInput("--urdf", "--robot or --urdf, not both", value=str(robot.urdf))
    sources = []
    if robot.robot is not None:
        sources.append(arms.named(robot.robot))
    if robot.urdf is not None:
        sources.append(urdf.read(robot.urdf))
    if robot.limits is not None:
        sources.append(joint_limits.read(robot.limits))
    if not sources:
        raise InvalidInput(name, f"its robot's limits beside it: {_SOURCES}")
    first, *others = sources
    for other in others:
        first = first.updated(other)
    if robot.acceleration is not None:
        first = first.with_acceleration(robot.acceleration)
    return first
