"""Where a plan begins: in a motion that runs (--from, --at), or beyond limits (--brake-first)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Group, Parameter

from trajopt.benchmark.trial import Trial, verdict
from trajopt.cli import asked, console, kinds
from trajopt.cli.asked import RobotOptions
from trajopt.cli.parameters import number
from trajopt.core.arrays import Array
from trajopt.core.braking import Braking
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.formats.motion import WITH_UNITS, motion
from trajopt.formats.waypoints import ENDINGS, begins

STARTING = Group("Start", sort_key=2)
BrakeFirst = Annotated[
    bool,
    Parameter(
        name="--brake-first",
        negative=(),
        help="A start beyond a limit brakes into the limits first, in the least time.",
        group=STARTING,
    ),
]


@dataclass(frozen=True)
class StartOptions:
    """The flags that say where a plan begins.

    Attributes:
        from_: Motion that runs; the plan takes over from it, at --at.
        at: Time of the hand-over in it, s.
        brake_first: Whether a start beyond a limit brakes into the limits first.
    """

    from_: Annotated[
        Path | None,
        Parameter(name="--from", help="Motion that runs: the plan takes over from it, at --at."),
    ] = None
    at: Annotated[float | None, number("Time of the hand-over in it, s.", least=0)] = None
    brake_first: BrakeFirst = False


StartFlags = Annotated[StartOptions, Parameter(name="*", group=STARTING)]
NO_START = StartOptions()


def problem(name: str, robot: RobotOptions, start: StartOptions) -> Problem:
    """Return the problem to plan, beginning in the state of the motion that runs.

    A file of waypoints has the goals: the state comes before them. In a problem the state is in
    place of the first waypoint.

    Raises:
        TrajoptError: A flag or a file cannot be used.
    """
    if start.from_ is None or start.at is None:
        if start.from_ is not None or start.at is not None:
            right = "--from FILE and --at SECONDS, both or neither"
            raise InvalidInput("--at", right, value=start.at)
        return asked.problem(name, robot, scaled=True)
    state = hand_over(start.from_, start.at, robot.unit)
    if Path(name).suffix in ENDINGS:
        return asked.problem(name, robot, scaled=True, start=state)
    found = asked.problem(name, robot)
    position, *rates = state(found.joint_names, found.joints)
    demands = {**found.demands, **begins(found.limits, *rates)}
    return replace(found, waypoints=np.array([position, *found.waypoints[1:]]), demands=demands)


def hand_over(
    path: Path, at: float, unit: str | None
) -> Callable[[Sequence[str], int], Sequence[Array]]:
    """Return what gives the state in which a motion of a file is left.

    It takes names and number of joints, and returns position, velocity and acceleration.

    Args:
        path: The motion that runs.
        at: Time of the hand-over in it, s.
        unit: Units of columns whose header says none.

    Raises:
        TrajoptError: The file cannot be read.
    """
    with kinds.reading(path, "motion"):
        running = motion(path, unit=unit if path.suffix in WITH_UNITS else None)

    def state(names: Sequence[str], joints: int) -> Sequence[Array]:
        own = running.for_joints(names).trajectory
        if own.joints != joints:
            right = f"{joints}, as the goals have"
            raise InvalidInput("joints", right, value=own.joints, file=str(path))
        if at > own.duration:
            right = f"a time from 0 to {own.duration:.6g} s, in {path}"
            raise InvalidInput("--at", right, value=at)
        return [own(at, order) for order in range(3)]

    return state


def braked(found: Braking, trial: Trial) -> Trial:
    """Return the trial of the whole motion, of the braking and the answer to the rest."""
    motion = trial.certified_trajectory
    if motion is None:
        return trial
    whole = found.joined(motion)
    solution = replace(
        trial.solution, trajectory=whole, lower_bound=None, history=None, evaluations=None, stats={}
    )
    status, message, certificate = verdict(found.problem, solution)
    return replace(
        trial,
        problem=found.problem,
        solution=solution,
        status=status,
        message=message,
        certificate=certificate,
    )


def print_braking(found: Braking) -> None:
    """Say how each joint that is beyond a limit comes within it."""
    labels, problem = found.problem.joint_labels, found.problem
    said = [
        f"{labels[joint]} in {t:.6g} s and {abs(way):.6g} {problem.unit(joint)}"
        for joint, (t, way) in found.ways.items()
    ]
    console.paragraph(
        f"It begins beyond limits, and brakes into them in {found.motion.duration:.6g} s "
        f"({', '.join(said)}): until then wider limits of velocity and acceleration hold."
    )


def as_dict(found: Braking | None) -> dict[str, object]:
    """Return the entry for JSON; joints count from 1."""
    if found is None:
        return {}
    joints = [
        {"joint": joint + 1, "time": t, "way": float(np.abs(way))}
        for joint, (t, way) in found.ways.items()
    ]
    return {"braking": {"duration": found.motion.duration, "joints": joints}}
