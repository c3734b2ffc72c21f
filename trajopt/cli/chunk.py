"""`trajopt chunk`: execute the targets of a learned policy as fast as the arm allows."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from cyclopts import Parameter

from trajopt.benchmark import episodes
from trajopt.benchmark.episodes import Episode
from trajopt.chunks import TOLERANCE, Chunk, ChunkAnswer, Mode, answers, from_samples
from trajopt.cli import asked, console, kinds, starting
from trajopt.cli.asked import NO_FLAGS, RobotFlags, RobotOptions
from trajopt.cli.parameters import Force, Json, Timeout, Writing, number, whole_number
from trajopt.cli.plan import check_target
from trajopt.cli.starting import STARTING
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.limits import Limits
from trajopt.core.numerals import is_number, parsed
from trajopt.formats.robot_limits import RobotLimits
from trajopt.formats.samples import Samples, known_as
from trajopt.formats.waypoints import begins
from trajopt.views.export import motion_file
from trajopt.views.export.motion_file import Points, Target

_NUMBERS = ("targets", "given s", "answer s", "late s", "off")
_OF_STATE = ("start_velocity", "start_acceleration", "end_velocity")
_Numbers = Annotated[
    str | None, Parameter(help="One number per joint: 0.2,0,-0.1,…", group=STARTING)
]


@dataclass(frozen=True)
class _States:
    """The states at the ends of chunks, as the flags give them.

    Attributes:
        running: returns the state of the motion that the first chunk takes over.
        numbers: of velocities and accelerations, as they were written, by their keys.
        on: whether each chunk ends as fast as the next one begins.
    """

    running: Callable[[Sequence[str], int], Sequence[Array]] | None
    numbers: dict[str, str]
    on: bool


def chunk(
    path: Annotated[
        Path,
        Parameter(help="Targets, one chunk or several: .csv, .npz, .json, .parquet, .hdf5, .mcap."),
    ],
    *,
    robot: RobotFlags = NO_FLAGS,
    tolerance: Annotated[
        float, number("How far a target may be missed, rad (m).", least=0)
    ] = TOLERANCE,
    fastest: bool = False,
    at_given_times: bool = False,
    rate: Annotated[
        float | None, number("Targets per second, where the file has no times.", above=0)
    ] = None,
    size: Annotated[
        int | None, whole_number("Targets of a chunk, where the file has longer episodes.", least=2)
    ] = None,
    from_: Annotated[
        Path | None,
        Parameter(
            name="--from", help="Motion that runs: the first chunk takes over.", group=STARTING
        ),
    ] = None,
    at: Annotated[
        float | None, number("Time of the hand-over in it, s.", least=0, group=STARTING)
    ] = None,
    start_velocity: _Numbers = None,
    start_acceleration: _Numbers = None,
    end_velocity: _Numbers = None,
    on_to_next: Annotated[
        bool, Parameter(help="Each chunk ends as fast as the next one begins.", group=STARTING)
    ] = False,
    out: Writing[Path | None] = None,
    force: Force = False,
    cycle: Annotated[float, number("Control cycle, s.", least=1e-6, most=1e3)] = 1e-3,
    points: Writing[Points | None] = None,
    quick: bool = False,
    timeout: Timeout = 60.0,
    json: Json = False,
) -> int:
    """Plan the motion through the targets of each chunk of a learned policy.

    The motion begins at rest at the first target, or in the state that the flags give; it passes
    each target within the tolerance, and ends at the last one. It is verified, and takes no longer
    than the clamped spline through the targets, slowed down to the limits (or sped up to them).

    A file has several chunks where a column `chunk` or `episode_index`, or a further axis of its
    arrays, tells them apart, or by --size. One that cannot be used gets a line, and the others go
    on.

    Exit code 0: all are answered; 1: one has no motion; 2: bad input.

    Args:
        fastest: In the least time (the default).
        at_given_times: No target sooner after the one before than the file says; the least delay.
        out: Write the motion, as plan does; of several chunks a file each, with its name.
        quick: Under jerk limits, from rest: tenths of a second, and 1 to 4 % slower a motion.
        timeout: Seconds for a chunk with jerk limits; then the quick answer, or the spline.
    """
    if fastest and at_given_times:
        raise InvalidInput("--fastest", "--fastest or --at-given-times, not both", value=True)
    mode: Mode = "at-given-times" if at_given_times else "fastest"
    said = dict(zip(_OF_STATE, (start_velocity, start_acceleration, end_velocity), strict=True))
    numbers = {key: value for key, value in said.items() if value is not None}
    if (from_ is None) != (at is None):
        raise InvalidInput("--at", "--from FILE and --at SECONDS, both or neither", value=at)
    if from_ is not None and any(key.startswith("start") for key in numbers):
        raise InvalidInput("--from", "--from, or --start-velocity and others", value=str(from_))
    if on_to_next and end_velocity is not None:
        raise InvalidInput("--on-to-next", "it or --end-velocity, not both", value=True)
    running = None
    if from_ is not None and at is not None:
        running = starting.hand_over(from_, at, robot.unit)
    states = _States(running, numbers, on_to_next)
    arm = asked.robot_limits(path.name, robot)
    with kinds.reading(path, "targets"):
        units = {**dict.fromkeys(arm.joints, ""), **arm.units}
        parts = episodes.read(path, robot.unit, units, rate=rate, size=size)
    targets = [out and _file_of(out, part, len(parts)) for part in parts]
    for target in targets:
        if target is not None:
            check_target(target, force=force)
    asked.note_factors(arm, robot)
    chunks = [_chunk(part, arm, robot, tolerance, parts, states) for part in parts]
    sampled = out is not None and Target(out, cycle, points).executed
    with console.waiting(f"planning {len(parts)} chunks" if len(parts) > 1 else "planning"):
        asked_for = [chunk for chunk in chunks if isinstance(chunk, Chunk)]
        planned = [_for_cycles(chunk, cycle) for chunk in asked_for] if sampled else asked_for
        found = iter(answers(planned, mode, timeout=timeout, quick=quick))
    told: list[dict[str, Any]] = []
    table = console.table("chunk", "verdict", numbers=_NUMBERS)
    codes = []
    for part, made, target in zip(parts, chunks, targets, strict=True):
        if not isinstance(made, Chunk):
            words = str(made).replace("unit=", "--unit ")
            table.row(part.name, words)
            told.append({"chunk": part.name, "error": words})
            codes.append(2)
            continue
        answer = replace(next(found), chunk=made)
        told.append(answer.as_dict())
        table.row(part.name, _verdict(answer), *_numbers(answer))
        codes.append(1 if answer.motion is None else 0)
        if target is not None and answer.motion is not None:
            try:
                trial = replace(answer.trial, problem=made.asked(mode))
                written = motion_file.write(Target(target, cycle, points), trial)
            except InvalidInput as error:
                console.note(f"{target} is not written: {error}; .json has the exact motion")
                codes.append(1)
                continue
            told[-1]["out"] = {"file": target} | (written.as_dict() if written else {})
    if json:
        console.print_json({"mode": mode, "tolerance": tolerance, "chunks": told})
    else:
        console.OUT.print(table)
        console.paragraph(_explained(mode, tolerance))
    return max(codes)


def _chunk(
    part: Episode,
    arm: RobotLimits,
    robot: RobotOptions,
    tolerance: float,
    parts: Sequence[Episode],
    states: _States,
) -> Chunk | TrajoptError:
    """Return a part of the file as a chunk, or what is wrong with it."""
    if part.samples is None:
        return part.error or TrajoptError("it has no samples")
    try:
        samples, names = _of_robot(part.samples, arm)
        asked.note_acceleration(robot, completed=arm.completed.intersection(names))
        limits = arm.limits(names)
        place, demands = _ends(part, samples, names, limits, parts, states)
        return from_samples(
            samples.positions,
            limits,
            times=samples.times,
            tolerance=tolerance,
            start=place,
            name=part.name,
            **arm.described(names),
            **demands,
        )
    except TrajoptError as error:
        return error


def _for_cycles(chunk: Chunk, cycle: float) -> Chunk:
    """Return the chunk within a tolerance that leaves half a cycle for each target.

    Samples for a controller are on whole cycles: there the motion has to be within the tolerance.
    """
    problem = chunk.problem
    fastest = np.abs(problem.limits.in_all_segments(tightest=False).velocity).max(axis=1)
    left = problem.route.demand("tolerance") - fastest * cycle / 2
    if "tolerance" not in problem.demands:
        return chunk
    near = np.maximum(left, 0.5 * problem.demands["tolerance"])
    demands = {**problem.demands, "tolerance": near}
    return replace(chunk, problem=replace(problem, demands=demands))


def _of_robot(samples: Samples, arm: RobotLimits) -> tuple[Samples, tuple[str, ...]]:
    """Return the samples of the robot's joints, and these joints' names."""
    names = known_as(samples.joint_names, arm.joint_names, ordered=arm.ordered)
    if set(arm.joints) < set(names):  # and a gripper's, which are left out
        samples = samples.for_joints([names.index(name) for name in arm.joint_names])
        names = arm.joint_names
    if not set(names) <= set(arm.joints):
        right = f"joints of {arm.source}: {', '.join(arm.joints)}"
        raise InvalidInput("joint names", right, value=list(names))
    return samples, names


def _ends(
    part: Episode,
    samples: Samples,
    names: Sequence[str],
    limits: Limits,
    parts: Sequence[Episode],
    states: _States,
) -> tuple[Array | None, dict[str, Any]]:
    """Return where a chunk's motion begins, if not at its first target, and the states asked."""
    place = None
    demands: dict[str, Any] = {
        key: _row(key, said, len(names)) for key, said in states.numbers.items()
    }
    number = parts.index(part)
    if states.running is not None and number == 0:
        place, *rates = states.running(names, len(names))
        demands |= begins(limits, *rates)
    if states.on:
        if number:
            demands["start_velocity"] = _first_velocity(samples)
        later = parts[number + 1].samples if number + 1 < len(parts) else None
        if later is not None:
            demands["end_velocity"] = _first_velocity(later)
    return place, demands


def _first_velocity(samples: Samples) -> Array:
    """Return the velocity between the first two targets, rad/s."""
    return np.asarray(np.diff(samples.positions[:2], axis=0)[0] / np.diff(samples.times[:2])[0])


def _row(key: str, said: str, joints: int) -> Array:
    """Return the numbers of a flag, one per joint."""
    found = [parsed(number) for number in said.replace(";", ",").split(",")]
    if len(found) != joints or not all(map(is_number, found)):
        right = f"{joints} numbers with commas between them, one per joint"
        raise InvalidInput(f"--{key.replace('_', '-')}", right, value=said)
    return np.array(found, dtype=float)


def _file_of(out: Path, part: Episode, count: int) -> Path:
    return out if count == 1 else out.with_name(f"{out.stem}-{part.name}{out.suffix}")


def _verdict(answer: ChunkAnswer) -> str:
    if answer.motion is None:
        return answer.trial.message
    return f"certified, {answer.trial.planner}"


def _numbers(answer: ChunkAnswer) -> list[str]:
    shown = [str(len(answer.chunk.times)), f"{answer.chunk.given_duration:.4f}"]
    for value, form in ((answer.duration, ".4f"), (answer.delay, ".4f"), (answer.deviation, ".2g")):
        shown.append("" if value is None else format(value + 0.0, form))
    return shown


def _explained(mode: Mode, tolerance: float) -> str:
    late = "late: how much later than the file says the most late target is passed"
    if mode == "at-given-times":
        late += " (the least that is possible where no target follows the one before sooner)"
    return f"{late}; off: the largest distance from a target, of {tolerance:g} rad allowed."
