"""`trajopt judge`: a motion that anyone planned, judged against a problem."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt import judgement
from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import BETTER_RTOL
from trajopt.cli import asked, console, evidence_words
from trajopt.cli.asked import NO_FLAGS, MotionUnit, RobotFlags
from trajopt.cli.explain import sentences
from trajopt.cli.parameters import (
    ROBOT,
    Commanded,
    Force,
    InterpolationName,
    Json,
    LogOut,
    MotionFile,
    Noise,
    ProblemName,
    Resolution,
    Window,
    Writing,
    number,
)
from trajopt.cli.plan import check_target, print_durations, print_smoothness, print_worst
from trajopt.cli.starting import BrakeFirst, print_braking
from trajopt.core.problem import Problem
from trajopt.formats.motion import ARRAYS, TABLES
from trajopt.formats.waypoints import ENDINGS
from trajopt.judgement import Execution, Judgement
from trajopt.judging.certificate import Certificate
from trajopt.judging.ends import Standing
from trajopt.judging.evidence import DEFAULT_WINDOW_S
from trajopt.views import race as page
from trajopt.views.export import motion_file
from trajopt.views.export.motion_file import Target
from trajopt.views.figures import draw
from trajopt.views.figures.shown_motion import ShownMotion

_LEAST_DOUBT = 1e-3  # s: a motion that is known exactly has none to speak of
_ADVICE = {
    "linear": "The samples are positions only, which a controller joins with straight lines: send "
    "velocities too, or say how else they are joined (--interpolation spline)."
}


def judge(
    motion: MotionFile,
    problem: ProblemName,
    *,
    robot: RobotFlags = NO_FLAGS,
    motion_unit: MotionUnit = None,
    interpolation: InterpolationName = "auto",
    via_tolerance: Annotated[
        float, number("How far each joint may miss a waypoint, rad (m).", least=0)
    ] = 0.0,
    noise: Noise = None,
    resolution: Resolution = None,
    commanded: Commanded = None,
    window: Window = DEFAULT_WINDOW_S,
    brake_first: BrakeFirst = False,
    scaled: Annotated[
        bool, Parameter(help="Apply the scaling factors of --limits, as plan does.", group=ROBOT)
    ] = False,
    out: LogOut = None,
    force: Force = False,
    race: Writing[Path | None] = None,
    output: Writing[Path] = Path("results/judge"),
    json: Json = False,
) -> int:
    """Judge a motion that anyone planned: what it claims, what holds, and what it loses.

    The problem is a built-in name, a problem file, or a file of waypoints (.csv, .txt, .npy,
    .json) with --robot, --urdf or --limits. Then --unit is of the waypoints alone, and the
    motion's header or --motion-unit says the motion's.

    Exit code 0: it keeps every limit and passes every waypoint; 1: it does not; 2: bad input. A log
    that passes the waypoints is broken (1) only if that is proved, as `trajopt verify` says.

    Args:
        race: Write a page with the motion beside the optimum on one clock.
        output: Folder for the figure.
    """
    if Path(problem).suffix not in ENDINGS and motion.suffix in (*TABLES, *ARRAYS):
        motion_unit = motion_unit or robot.unit
        robot = replace(robot, unit=None)
    asked.check_motion_unit(motion_unit, [motion], "--motion-unit")
    check_log_out(out, force=force)
    if race is not None:
        check_target(race, force=force, key="--race")
    loaded = asked.problem(problem, robot, scaled=scaled)
    with asked.reading_motion(motion):
        found = judgement.judge(
            loaded,
            motion,
            interpolation=interpolation,
            via_tolerance=via_tolerance,
            unit=motion_unit,
            noise=noise,
            resolution=resolution,
            commanded=commanded,
            window=window,
            brake_first=brake_first,
        )
    told = found.best
    with console.waiting("asking the references"):
        explanation = told.explanation
    if told.below_optimum and told.gap is not None:
        below = f"{-100 * told.gap:.6f} % below the best known optimum"
        console.warn_of_bug(f"{told.motion.name} on {told.problem.name} is {below}")
    code = 1 if found.broken or found.certificate.flaws else 0
    if race is not None:
        page.write(*_racing(told), race)
    if json:
        write_log_motion(out, found, quiet=True)
        console.print_json(found.as_dict())
        return code
    _print(found)
    if found.braking is not None:
        print_braking(found.braking)
    if told is not found:
        console.paragraph(f"{_unlike(told, found)}: {' '.join(told.certificate.lines())}")
    for sentence in _durations(told, second=told is not found):
        console.paragraph(sentence)
    if explanation is not None:
        slowed = told.certificate.dilation > 1 and not told.certificate.feasible
        for sentence in sentences(told.motion.name, told.problem, explanation, slowed=slowed):
            console.paragraph(f"- {sentence}")
    for sentence in _better_than_recorded(found, motion):
        console.paragraph(sentence)
    with console.waiting("drawing the figure"):
        figure = draw.judged(found, output)
    console.line(f"figure: {figure}")
    if race is not None:
        console.line(f"race: {race}")
    write_log_motion(out, found)
    return code


def _racing(told: Judgement) -> tuple[Problem, list[ShownMotion]]:
    """Return the problem, and the motion as it was executed beside the optimum where one is known.

    A motion that breaks a limit shows by how much: its bars are full before it is slowed down.
    """
    motions = [ShownMotion(told.motion.name, told.motion.name, told.executed)]
    explained = told.explanation
    optimum = None if explained is None else explained.optimum
    if optimum is not None:
        motions.insert(0, ShownMotion("exact", "optimum", optimum))
    return told.problem, motions


def _unlike(told: Judgement, found: Judgement) -> str:
    """Say by what the second verdict differs from the first."""
    parts = []
    if told.tolerance_needed and not found.tolerance_needed:
        unit = found.problem.shared_unit()
        size = f"{told.via_tolerance:g}"
        parts.append(f"Within {size} {unit} of all waypoints (--via-tolerance {size})")
    if told.ends_taken:
        rate = f"{told.ends_taken:.2g} {found.problem.shared_unit()}/s"
        parts.append(f"{'with' if parts else 'With'} the velocities at its ends (up to {rate})")
    if found.problem.has("jerk") and not told.problem.has("jerk"):
        parts.append("without the jerk limits" if parts else "Without the jerk limits")
    return " and ".join(parts)


def _durations(told: Judgement, *, second: bool) -> Iterator[str]:
    """Say how the duration compares with the optimum: of a second verdict, and without standing."""
    gap, certified, stands = told.gap, told.certified_duration, told.standing
    other = second and (told.tolerance_needed or told.ends_taken)
    if gap is None or certified is None or not (stands or other):
        return
    if not stands:
        same = "through these points" if told.tolerance_needed else "with the same ends"
        yield f"That takes {1 + gap:.4g} times the optimum {same}."
        return
    moving = (1 + gap) * (1 - (stands.start + stands.end) / stands.duration)
    yield (
        f"It stands {stands.start:.3g} s + {stands.end:.3g} s; moving, it takes {moving:.4g} times "
        f"the optimum; whole, {1 + gap:.4g} times."
    )


def check_log_out(path: Path | None, *, force: bool) -> None:
    """Check before the work whether a log's motion can be written."""
    if path is not None:
        Target(path)  # refuses an unknown ending
        check_target(path, force=force)


def write_log_motion(path: Path | None, found: Execution, *, quiet: bool = False) -> None:
    """Write the motion that keeps the limits as near to a log as its digits allow.

    A line says what was written, or why there is no such motion.
    """
    if path is None:
        return
    if not motion_file.write_log(path, found):
        what = (
            "no log" if found.evidence is None else "a log without a motion within its half widths"
        )
        console.note(f"{path} is not written: {found.motion.name} is {what}")
    elif path.suffix in motion_file.PICTURES and not quiet:
        console.line(f"{path}: the log, and what it is known to")
    elif not quiet:
        slower = found.evidence and found.evidence.slower
        longer = f", {slower.factor:.4f} times as long: it keeps the limits" if slower else ""
        console.line(f"{path}: the motion within the half widths{longer}")


def _better_than_recorded(found: Judgement, motion: Path) -> Iterator[str]:
    """Say if it is shorter than the best known motion, and name the command that records it."""
    record = records.find(found.problem)
    duration = found.certified_duration
    if record is None or duration is None or duration >= record.duration * (1 - BETTER_RTOL):
        return
    less = 100 * (1 - duration / record.duration)
    yield (
        f"- It takes {less:.4g} % less than the best known, {record.motion}: record it with "
        f"trajopt best-known propose {motion} {found.problem.name}"
    )


def _print(found: Judgement) -> None:
    verdict = found.certificate.verdict
    if found.evidence is not None:
        verdict = f"{evidence_words.headline(found.evidence, found)}; {verdict}"
    console.headline(found.motion.name, f" on {found.problem.name}: ", verdict)
    if found.evidence is not None:
        evidence_words.print_evidence(found.evidence, found)
    for sentence in _verdict(found):
        console.paragraph(sentence)
    times = found.trajectory.waypoint_times
    print_durations(found.claimed_duration, found.certified_duration, times)
    print_smoothness(found.smoothness, found.problem)
    print_worst(found.certificate, found.problem)


def _verdict(found: Judgement) -> Iterator[str]:
    """Say how the motion was executed, what is wrong with it, and what corrects it."""
    certificate = found.certificate
    kind = found.motion.interpolation
    if found.evidence is not None and found.evidence.motion is not None:
        yield "Judged as the motion within these widths."
        kind = "polynomial"
    elif kind == "polynomial":
        yield "Executed as its own polynomials."
    else:
        pieces = len(found.trajectory.lengths)
        yield f"Executed with {pieces} {kind} pieces between its samples."
    yield " ".join(certificate.lines())
    yield from advice(certificate, kind)
    if found.tolerance_needed:
        yield (
            f"It misses the problem's own waypoints, by less than {found.via_tolerance:g} "
            f"{found.problem.shared_unit()}: "
            "judged, and compared, through the points that it passes."
        )
        within, duration = found.optimum_within, found.certified_duration
        if within is not None and duration is not None:
            yield (
                f"Within that tolerance of every waypoint the best known optimum is {within:.6g} "
                f"s: this takes {100 * (duration / within - 1):.2f} % longer."
            )


def standing_words(found: Standing) -> str:
    """Say how long a motion stands at its ends."""
    stands = f"It stands {found.start:.3g} s + {found.end:.3g} s"
    if found.doubt > _LEAST_DOUBT:
        stands += (
            f" (within its widths, which a motion at its limits leaves in {found.doubt:.2g} s)"
        )
    return f"{stands}, and moves for {found.moving:.6g} s."


def advice(certificate: Certificate, interpolation: str) -> Iterator[str]:
    """Say what to do about flaws that come from how samples are joined."""
    if certificate.flaws and interpolation in _ADVICE:
        yield _ADVICE[interpolation]
