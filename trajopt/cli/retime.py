"""`trajopt retime`: the fastest timing of a path that is given."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
from cyclopts import Parameter

from trajopt import retiming
from trajopt.cli import asked, console, kinds
from trajopt.cli.asked import NO_FLAGS, MotionUnit, RobotFlags
from trajopt.cli.explain import held_along
from trajopt.cli.parameters import Force, InterpolationName, Json, Writing, number
from trajopt.cli.plan import check_target, print_durations, print_smoothness, print_worst
from trajopt.cli.verify import executed
from trajopt.core.demand import END_STATES
from trajopt.core.exceptions import InvalidInput
from trajopt.core.numerals import rounded_down
from trajopt.formats import waypoints
from trajopt.formats.motion import ENDINGS
from trajopt.judgement import motion_of, passing
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.retiming import Retiming
from trajopt.views.export import motion_file
from trajopt.views.export.motion_file import Points, Target
from trajopt.views.figures import draw

_ACCURACY = 1e-3
_SAME_RTOL = 1e-6  # durations that differ by less are equal
_OF_MOTIONS = ("a CSV of a motion", "a ROS message", "a motion of polynomials", "a trial's file")


def retime(
    path: Annotated[
        str,
        Parameter(help="Motion, waypoints with limits, a problem file, or a built-in name."),
    ],
    problem: Annotated[
        str | None, Parameter(help="Problem whose waypoints the motion passes.")
    ] = None,
    *,
    robot: RobotFlags = NO_FLAGS,
    motion_unit: MotionUnit = None,
    interpolation: InterpolationName = "auto",
    spline: bool = False,
    bound: bool = False,
    accuracy: Annotated[
        float, number("Of the duration along the path, relative.", least=1e-6, most=0.1)
    ] = _ACCURACY,
    knots: str = "best",
    ends: str = "best",
    out: Writing[Path | None] = None,
    force: Force = False,
    cycle: Annotated[float, number("Control cycle, s.", least=1e-6, most=1e3)] = 1e-3,
    points: Writing[Points | None] = None,
    output: Writing[Path] = Path("results/retime"),
    json: Json = False,
) -> int:
    """Say how fast a given path can be passed, and write that motion.

    Of a motion the geometry is kept and the timing dropped; it begins and ends at rest. With a
    problem, the path passes its waypoints, and its limits and demands hold, waits and limits of a
    segment too. Waypoints get a spline. Any limits are kept that state their inequalities.

    Where the path has a corner the motion stops, and a sentence says where; under jerk limits a
    jump of the curvature is a corner, as between a controller's cubic pieces. --spline takes a
    spline through the motion's samples instead.

    Exit code 0: a certified motion; 1: none along this path; 2: bad input.

    Args:
        spline: Through the samples of the motion, not along its own path.
        bound: Say a time that no motion along the path falls below (without jerk limits).
        knots: Of a spline: uniform, chord, centripetal, limit, or the best of them.
        ends: Of a spline: not-a-knot, natural, clamped, or the best of them.
        out: Write the certified motion, as plan does.
        output: Folder for the figure.
    """
    if out is not None:
        check_target(out, force=force)
    planner = load(f"along:accuracy={accuracy},knots={knots},ends={ends}")
    found = _retimed(path, problem, robot, motion_unit, interpolation, planner, spline=spline)
    table = found.as_dict() | ({"path_bound": found.bound} if bound else {})
    code = 0 if found.motion is not None else 1
    executed_as = None
    if out is not None and found.motion is not None:
        executed_as = motion_file.write(Target(out, cycle, points), found.trial)
        table["out"] = {"file": out} | (executed_as.as_dict() if executed_as else {})
    if json:
        console.print_json(table)
        return code
    _print(found, bound=bound)
    if found.motion is None:
        return code
    with console.waiting("drawing the figure"):
        figure = draw.retimed(found, output)
    console.line(f"figure: {figure}")
    if executed_as is not None:
        console.paragraph(
            f"{out}: {executed_as.points} points, {executed_as.duration:.6g} s. Read again and "
            f"executed it keeps every limit: {executed_as.certificate.peak(found.trial.problem)}."
        )
    elif out is not None:
        console.line(f"{out} is written.")
    return code


def _retimed(
    path: str,
    problem: str | None,
    robot: RobotFlags,
    motion_unit: str | None,
    interpolation: InterpolationName,
    planner: Planner,
    *,
    spline: bool,
) -> Retiming:
    """Return the fastest motion along a path of a file, or of a built-in problem's spline."""
    file = Path(path)
    is_motion = file.suffix in ENDINGS and kinds.kind(file) in _OF_MOTIONS
    if problem is not None and not is_motion:
        right = "the motion first, then its problem: trajopt retime MOTION PROBLEM"
        raise InvalidInput("PATH", right, value=path)
    if not is_motion:
        if file.suffix in ENDINGS and file.suffix not in waypoints.ENDINGS:
            with kinds.reading(file, "motion"):
                motion_of(file)
        stated = asked.problem(path, robot, scaled=True)
        with console.waiting(f"timing {stated.name}"):
            return retiming.through(stated, planner)
    if problem is not None:
        stated = asked.problem(problem, robot)
        with asked.reading_motion(file):
            units = dict(zip(stated.joint_labels, stated.joint_units, strict=False))
            given = motion_of(file, interpolation, motion_unit, units)
            given = given.for_joints(stated.joint_names)
            given.check_units(stated)
        own = passing(stated, given.trajectory)
    else:
        if motion_unit is not None:
            robot = replace(robot, unit=motion_unit)
        with kinds.reading(file, "motion"):
            judged = executed(file, robot, interpolation, None)
        given, stated = judged.motion, judged.problem.without(*END_STATES)
        own = passing(stated, judged.executed)
    duration = given.trajectory.duration
    with console.waiting(f"timing {given.name}"):
        if spline:
            samples = given.trajectory(given.trajectory.breaks)
            through = replace(stated, waypoints=samples, demands={}, name=given.name)
            return replace(retiming.through(through, planner), given_duration=duration)
        return retiming.along(given.name, own, stated, planner, duration)


def _print(found: Retiming, *, bound: bool) -> None:
    trial = found.trial
    if found.motion is None or found.duration is None:
        console.headline(found.name, ": ", "no motion along this path")
        console.paragraph(trial.message)
        return
    console.headline(found.name, " along its path: ", f"{found.duration:.6g} s")
    for sentence in _sentences(found):
        console.paragraph(sentence)
    if bound:
        console.paragraph(_bounded(found))
    print_durations(trial.claimed_duration, found.duration, found.motion.waypoint_times)
    print_smoothness(trial.smoothness, trial.problem)
    if trial.certificate is not None:
        print_worst(trial.certificate, trial.problem)


def _bounded(found: Retiming) -> str:
    """Say what no motion along the path falls below."""
    least = found.bound
    if least is None or found.duration is None:
        return "No bound along this path is known under these limits."
    above = 100 * (found.duration / least - 1)
    jerk = ", whose jerk limits are left out of it" if found.problem.has("jerk") else ""
    return (
        f"No motion along this path takes less than {rounded_down(least, '.6g')} s (computed, not "
        f"proved): this one is {above:.2g} % above that{jerk}."
    )


def _sentences(found: Retiming) -> Iterator[str]:
    """Say how much faster the motion is, what holds it back, and how far it leaves the path."""
    given, within, own = found.given_duration, found.given_certified, found.duration
    if given is not None and own is not None:
        said = f"The given motion takes {given:.6g} s"
        if within is None:
            yield f"{said}, and cannot be slowed down to the limits."
        elif within > given * (1 + _SAME_RTOL):
            yield (
                f"{said} and breaks limits; slowed down to them, {within:.6g} s. Along the same "
                f"path this is {within / own:.4g} times as fast."
            )
        elif within > own * (1 + _SAME_RTOL):
            yield f"{said}: this is {within / own:.4g} times as fast, along the same path."
        else:
            yield f"{said}: no faster timing of its path is known."
    unit = found.problem.shared_unit()
    if found.misses:
        yield (
            f"The path passes up to {found.misses:.2g} {unit} from the problem's waypoints: it is "
            "kept, and goes through its own points."
        )
    if found.path is None and "spline" in found.trial.solution.stats:
        yield f"The path is the spline {found.trial.solution.stats['spline']}."
    if found.motion is not None:
        yield from held_along(found.problem, found.motion, found.trial.message)
    if found.leaves is not None and np.isfinite(found.leaves):
        yield f"It leaves the path by at most {found.leaves:.1e} {unit}."
