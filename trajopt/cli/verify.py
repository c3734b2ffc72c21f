"""`trajopt verify`: check stored trials again, or a motion against a robot's limits."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import tau
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from trajopt.benchmark import episodes
from trajopt.benchmark.episodes import Episode
from trajopt.benchmark.logs import AS_LOG, LogOptions
from trajopt.benchmark.store.folder import is_trial
from trajopt.benchmark.store.recheck import CheckedTrial, Verification, verification
from trajopt.benchmark.suites import catalogue
from trajopt.cli import asked, console, evidence_words, kinds
from trajopt.cli.asked import NO_FLAGS, RobotFlags, RobotOptions
from trajopt.cli.console import PlainTable
from trajopt.cli.judge import advice, check_log_out, standing_words, write_log_motion
from trajopt.cli.parameters import (
    Commanded,
    Force,
    InterpolationName,
    Json,
    LogOut,
    Noise,
    Resolution,
    Window,
    number,
)
from trajopt.cli.plan import print_smoothness, print_worst
from trajopt.core.arm_file import arm_files
from trajopt.core.arrays import Array
from trajopt.core.demand import END_STATES
from trajopt.core.exceptions import FileNote, InvalidInput, TrajoptError
from trajopt.core.interpolation import Interpolation
from trajopt.core.limits import KINDS, Limits
from trajopt.core.units import ANGLES
from trajopt.formats.motion import ENDINGS, WITH_UNITS, Motion, motion, of_samples
from trajopt.formats.samples import known_as
from trajopt.judgement import Execution, as_executed, taking_over
from trajopt.judging.evidence import DEFAULT_WINDOW_S
from trajopt.planners.rest_to_rest import step_times
from trajopt.views import table_cells
from trajopt.views.analysis.gap_reference import best

MAX_TRIALS_LISTED = 200  # of more trials, only those that do not hold are listed
_JUMP_SCALE = 100.0  # rad/s²: in place of accelerations that are not judged
_NO_LIMIT = 1e6  # rad/s²: the same where other joints have a limit
_OF_MOTIONS = ("duration s", "velocity", "acceleration", "jerk")
_OF_EPISODES = ("duration s", "velocity", "acceleration", "step", "held")
_NUMBERS = ("seed", "claimed s", "certified s", "dilation", "verdict")


def verify(
    path: Path,
    *more: Path,
    robot: RobotFlags = NO_FLAGS,
    interpolation: InterpolationName = "auto",
    noise: Noise = None,
    resolution: Resolution = None,
    commanded: Commanded = None,
    window: Window = DEFAULT_WINDOW_S,
    rate: Annotated[
        float | None, number("Samples per second of episodes without times.", above=0)
    ] = None,
    before: Path | None = None,
    at: Annotated[float | None, number("Time of the hand-over in it, s.", least=0)] = None,
    out: LogOut = None,
    force: Force = False,
    json: Json = False,
) -> int:
    """Verify every stored trajectory anew, from the file alone; or a motion within limits.

    Limits are a robot's (--robot, --urdf, and --limits joint_limits.yaml over it); --limits alone
    takes a robot's or a problem's name too.

    A motion needs no waypoints. The answer is its peaks as a controller runs it, and how much
    slower it must run, or how much faster it may. Where no joint has an acceleration limit, only
    velocities and positions are judged, and a line says so.

    Positions of a log are known to a half width: by their digits, the step of the sensors and
    noise, all found from the samples unless they are stated. Its verdict is one of three: broken
    (proved, exit code 1), kept as far as these widths tell, or cannot be told.

    Args:
        path: Results folder or results.h5; or a motion's file.
        more: Further motions: each gets a line, and the exit code is that of the worst. Episodes of
            learned policies (.parquet, .hdf5, .mcap) get a line each.
        before: Motion that runs until this one takes over, at --at.
    """
    if (before is None) != (at is None):
        raise InvalidInput("--at", "--before FILE and --at SECONDS, both or neither", value=at)
    recorded = any(map(episodes.is_recorded, (path, *more)))
    if rate is not None and not recorded:
        right = f"episodes ({', '.join(episodes.RECORDED)}): a motion has times"
        raise InvalidInput("--rate", right, value=rate)
    if recorded or (path.suffix in ENDINGS and not path.is_dir() and not is_trial(path)):
        log = None
        if interpolation in AS_LOG:
            log = LogOptions(noise, resolution, commanded, window)
        check_log_out(out, force=force)
        judged = _Judged(robot, interpolation, log, before, at)
        if recorded:
            return _verify_episodes([path, *more], judged, rate, json)
        if more:
            return _verify_motions([path, *more], judged, out, json)
        return _verify_motion(path, judged, out, json)
    if more:
        raise InvalidInput("PATH", "motions, or one folder of results", value=str(path))
    of_motion = bool(robot.said) or interpolation != "auto" or out is not None
    of_motion |= any(own is not None for own in (noise, resolution, commanded))
    with kinds.reading(path, "motion" if of_motion else "results"):
        if of_motion:
            right = f"a motion's file ({', '.join(ENDINGS)}) with limits and --interpolation"
            raise InvalidInput("PATH", right, value=str(path))
        found = verification(path, best)
    report(found, json)
    return 0 if found.holds else 1


def report(found: Verification, json: bool) -> None:
    """Print which trials hold, and what does not."""
    if not json:
        _print(found)
        return
    rows = [trial.as_dict() for trial in found.trials]
    told = {"holds": found.holds, "summary": found.summary(), "misstated": list(found.misstated)}
    console.print_json({**told, "trials": rows})


@dataclass(frozen=True)
class _Judged:
    """How a motion is judged by limits alone: the options of the command."""

    robot: RobotOptions
    interpolation: Interpolation
    log: LogOptions | None
    before: Path | None
    at: float | None

    @property
    def robot_by_name(self) -> RobotOptions:
        """Return the flags with a robot's name where --limits has one."""
        name = self.robot.limits
        if name is None or name.suffix in (".yaml", ".yml"):
            return self.robot
        return replace(self.robot, robot=str(name), limits=None)

    @property
    def limits(self) -> str:
        """Return whose limits these are, in words.

        Raises:
            InvalidInput: No option says it.
        """
        of_files = ("--unit", "--no-unwrap")
        said = {flag: own for flag, own in self.robot.said.items() if flag not in of_files}
        if not said:
            right = "joint_limits.yaml, a robot or a problem, whose limits the motion is to keep"
            raise InvalidInput("--limits", right)
        if self.robot.acceleration is not None:
            said["--acceleration"] = f"{self.robot.acceleration:g} rad/s² for joints without one"
        if self.robot.payload is not None:
            said["--payload"] = f"payload {self.robot.payload:g} kg"
        for key, own in self.robot.numbers.items():
            said[f"--{key.replace('_', '-')}"] = f"{KINDS[key].name()} {own}"
        return ", ".join(map(str, said.values()))

    def __call__(self, path: Path, given: Motion | None = None) -> Execution:
        """Return the verdict on the motion of a file, or on one that was read from it."""
        with kinds.reading(path, "motion"):
            found = executed(path, self.robot, self.interpolation, self.log, given)
        if self.before is not None and self.at is not None:
            units = dict.fromkeys(found.problem.joint_names, "rad")
            with kinds.reading(self.before, "motion"):
                unit = self.robot.unit if self.before.suffix in WITH_UNITS else None
                earlier = motion(self.before, self.interpolation, unit, units)
                earlier = earlier.for_joints(found.problem.joint_names)
            found = taking_over(found, earlier, self.at)
        if "deg" in (self.robot.unit or ""):
            _warn_of_radians(found)
        return found


def _verify_motion(path: Path, judged: _Judged, out: Path | None, json: bool) -> int:
    """Judge a motion as a controller runs it, by limits alone."""
    asked.check_motion_unit(judged.robot.unit, [path], "--unit")
    limits = judged.limits
    found = judged(path)
    if json:
        write_log_motion(out, found, quiet=True)
        console.print_json(found.as_dict())
    else:
        _print_execution(found, limits)
        write_log_motion(out, found)
    return 1 if found.broken else 0


def _verify_motions(paths: Sequence[Path], judged: _Judged, out: Path | None, json: bool) -> int:
    """Judge several motions by the same limits: a line each, the exit code of the worst."""
    for path in paths:
        if path.suffix not in ENDINGS:
            right = (
                "motions only beside a motion; limits go behind --limits (joint_limits.yaml, a "
                "problem file, a robot's name), and `trajopt judge MOTION PROBLEM` judges by "
                "waypoints too"
            )
            raise InvalidInput("PATH", right, file=str(path))
    if out is not None:
        raise InvalidInput("--out", "one motion, whose log is written", value=str(out))
    limits = judged.limits
    table = console.table("motion", "verdict", numbers=_OF_MOTIONS)
    told: list[dict[str, Any]] = []
    codes = []
    for path in paths:
        try:
            found = judged(path)
        except TrajoptError as error:
            words = str(error).replace("unit=", "--unit ")
            table.row(path.name, words)
            told.append({"motion": path.name, "error": words})
            codes.append(2)
            continue
        uses = [found.certificate.uses.get(key) for key in ("velocity", "acceleration", "jerk")]
        shown = ["" if use is None else f"{use.value:.4f}" for use in uses]
        table.row(path.name, _told_briefly(found), f"{found.certificate.duration:.6g}", *shown)
        told.append(found.as_dict())
        codes.append(1 if found.broken else 0)
    if json:
        console.print_json({"motions": told})
    else:
        console.OUT.print(table)
        console.paragraph(f"Uses are shares of the limits of {limits}.")
    return max(codes)


def _verify_episodes(paths: Sequence[Path], judged: _Judged, rate: float | None, json: bool) -> int:
    """Judge each episode of some files by the same limits: a line each, the worst exit code.

    Positions that were commanded are judged as known to their digits: what is broken is broken by
    every motion through them. With --interpolation linear they are joined by lines.
    """
    limits = judged.limits
    table = console.table("episode", "verdict", numbers=_OF_EPISODES)
    told: list[dict[str, Any]] = []
    codes = []
    for path in paths:
        own = asked.robot_limits(path.name, judged.robot_by_name)
        units = {**dict.fromkeys(own.joints, ""), **own.units}
        try:
            with kinds.reading(path, "targets"):
                parts = episodes.read(path, judged.robot.unit, units, rate=rate)
        except TrajoptError as error:
            if len(paths) == 1:
                raise
            parts = [Episode(path.stem, None, error)]
        for part in parts:
            name = (
                part.name
                if len(paths) == 1
                else f"{path.stem} {part.name}".removesuffix(f" {path.stem}")
            )
            try:
                if part.samples is None:
                    raise part.error or InvalidInput("samples", "some")
                with warnings.catch_warnings():
                    if told:  # what was said of the first one
                        warnings.simplefilter("ignore", FileNote)
                    found = judged(path, of_samples(name, part.samples, judged.interpolation))
            except TrajoptError as error:
                words = str(error).replace("unit=", "--unit ")
                table.row(name, words)
                told.append({"episode": name, "error": words})
                codes.append(2)
                continue
            of_targets = {"steps": _steps(found), "held": _held(found)}
            told.append({"episode": name, **of_targets, **found.as_dict()})
            table.row(name, _told_briefly(found), *_uses(found))
            codes.append(1 if found.broken else 0)
    if json:
        console.print_json({"episodes": told})
    else:
        console.OUT.print(table)
        console.paragraph(
            f"Uses are shares of the limits of {limits}"
            + (
                ", of the gentlest motion found through the positions as they are known"
                if judged.log is not None
                else f", joined as {judged.interpolation}"
            )
            + "; step: the largest change from one position to the next, and when; held: where "
            "each position is held until the next, the time that a joint needs for its step, from "
            "rest to rest, over the time until the next: the largest ratio, and when."
        )
    return max(codes)


def _told_briefly(found: Execution) -> str:
    """Return the verdict, with the first flaw, or the strongest proof where a limit is broken."""
    evidence = found.evidence
    if evidence is None:
        return found.certificate.reason
    proof = evidence.conviction
    if proof is None:
        return str(evidence.verdict)
    joint = found.problem.joint_labels[proof.joint]
    if proof.limit == "position":
        unit = found.problem.unit(proof.joint)
        return f"broken: {joint}, {proof.at_least:.3g} {unit} out of range at {proof.start:.4g} s"
    limit = proof.limit or "all limits together"
    return f"broken: {joint}, {proof.at_least:.4g} of its {limit} limit at {proof.start:.4g} s"


def _uses(found: Execution) -> list[str]:
    """Return duration, uses, largest step and hold of an episode, as the table shows them."""
    uses = [found.certificate.uses.get(key) for key in ("velocity", "acceleration")]
    return [
        f"{found.certificate.duration:.6g}",
        *("" if use is None or not np.isfinite(use.value) else f"{use.value:.4f}" for use in uses),
        *(f"{size:.3g}\nat {at:.4g}" for size, _, at in (_steps(found)[0], _held(found)[0])),
    ]


def _steps(found: Execution) -> list[tuple[float, int, float]]:
    """Return each joint's largest change between two positions, its number from 1, and when, s.

    The largest of all joints comes first.
    """
    samples = found.motion.samples
    return [] if samples is None else _largest(np.diff(samples.positions, axis=0), samples.times)


def _held(found: Execution) -> list[tuple[float, int, float]]:
    """Return each joint's largest ratio where every position is held until the next, as `_steps`.

    A held position is a step, for which the joint needs the time from rest to rest. The ratio is
    that time over the time until the next position: above 1 the joint is still under way then.
    """
    samples = found.motion.samples
    if samples is None:
        return []
    limits = found.problem.limits
    if found.certificate.uses.get("acceleration") is None:
        limits = Limits(limits.velocity, [_NO_LIMIT] * limits.joints)
    needed = step_times(np.diff(samples.positions, axis=0), limits)
    return _largest(needed / np.diff(samples.times)[:, None], samples.times)


def _largest(sizes: Array, times: Array) -> list[tuple[float, int, float]]:
    """Return of each joint the largest of sizes `(steps, joints)`, its number and when, s."""
    sizes = np.abs(sizes)
    rows = sizes.argmax(axis=0).tolist()
    every = [
        (float(sizes[row, joint]), joint + 1, float(times[row + 1] - times[0]))
        for joint, row in enumerate(rows)
    ]
    return sorted(every, reverse=True)


def executed(
    path: Path,
    robot: RobotFlags,
    interpolation: Interpolation,
    log: LogOptions | None,
    read: Motion | None = None,
) -> Execution:
    """Judge the motion by the limits of a file, a robot or a problem.

    Joints are found by their names, or in their order where the motion or the problem has none.

    Args:
        path: The file.
        robot: The flags of the limits.
        interpolation: How samples are joined.
        log: How a log is judged.
        read: The motion, where it was read from the file already.
    """
    if robot.limits is not None and robot.limits.suffix not in (".yaml", ".yml"):
        if robot.robot is not None or robot.urdf is not None:
            right = "joint_limits.yaml beside --robot or --urdf"
            raise InvalidInput("--limits", right, value=str(robot.limits))
        name = str(robot.limits)
        if robot.limits.is_file() or name not in arm_files():
            with kinds.reading(robot.limits, "limits"):
                problem = asked.with_numbers(catalogue.load(name), robot)
            asked.note_acceleration(robot, completed=())
            stated = zip(problem.joint_labels, problem.joint_units, strict=False)
            units = dict(stated) or dict.fromkeys(problem.joint_names, "rad")
            given = read or motion(path, interpolation, robot.unit, units)
            return as_executed(
                given.for_joints(problem.joint_names),
                problem.limits,
                joint_units=problem.joint_units,
                ends={key: own for key, own in problem.demands.items() if key in END_STATES},
                log=log,
            )
        robot = replace(robot, robot=name, limits=None)
    own = asked.robot_limits(path.name, robot)
    units = {**dict.fromkeys(own.joints, ""), **own.units}
    given = read or motion(path, interpolation, robot.unit, units)
    names = known_as(
        given.joint_names, own.joint_names, ordered=own.ordered and not given.of_message
    )
    names = names or own.names_of(given.trajectory.joints)
    if set(own.joints) < set(names):  # and a gripper's, which are left out
        names = own.joint_names
    if not set(names) <= set(own.joints):
        order = "" if own.ordered else " (it says no order)"
        right = f"joints of {own.source}{order}: {', '.join(own.joints)}; rename them"
        raise InvalidInput("joint_names", right, value=list(names), file=given.name)
    asked.note_factors(own, robot)
    asked.note_acceleration(robot, completed=own.completed.intersection(names))
    described = own.described(names)
    del described["joint_names"]
    free = [name for name in names if not own.limits_acceleration([name])]
    judged = len(free) < len(names)
    whole = own.with_acceleration(_NO_LIMIT if judged else _JUMP_SCALE) if free else own
    limits = whole.limits(names)
    if free:
        which = "accelerations are" if not judged else f"accelerations of {', '.join(free)} are"
        console.HELD.append(
            f"{own.source}: no acceleration limits, so {which} not judged; "
            "--acceleration 2.0, say, is one for every joint"
        )
    return as_executed(given.for_joints(names), limits, accelerations=judged, log=log, **described)


def _warn_of_radians(found: Execution) -> None:
    """Warn if the motion, read in degrees, is so small that it would be slow in radians too."""
    span = np.degrees(found.problem.largest_displacements.max())
    speed = found.certificate.velocity.value
    if span <= tau and speed <= ANGLES["deg"]:
        console.note(
            f"warning: {found.motion.name} moves {span:.3g} deg at {100 * speed:.2g} % of a "
            "velocity limit; are its angles in rad, and not in deg?"
        )


def _print_execution(found: Execution, limits: str) -> None:
    certificate = found.certificate
    verdict = certificate.verdict
    if certificate.acceleration is None:
        limits += ", accelerations not judged"
    if found.evidence is not None:
        verdict = evidence_words.headline(found.evidence, found)
    console.headline(found.motion.name, f" within {limits}: ", verdict)
    if found.evidence is not None:
        evidence_words.print_evidence(found.evidence, found)
        if found.evidence.motion is None:
            return
        console.paragraph(f"The motion within these widths, {certificate.duration:.6f} s:")
        if not certificate.feasible and found.evidence.verdict != "broken":
            console.paragraph(" ".join(certificate.lines()))
        for sentence in _at_ends(found):
            console.paragraph(sentence)
        print_worst(certificate, found.problem)
        return
    pieces = len(found.motion.trajectory.lengths)
    kind = found.motion.interpolation
    console.paragraph(f"Executed with {pieces} {kind} pieces, {certificate.duration:.6f} s.")
    for sentence in [" ".join(certificate.lines()), *advice(certificate, kind), *_at_ends(found)]:
        console.paragraph(sentence)
    print_smoothness(found.smoothness, found.problem)
    print_worst(certificate, found.problem)


def _at_ends(found: Execution) -> Iterator[str]:
    """Say how the motion begins and ends, if not at rest, and how long it stands there."""
    if found.jumps:
        unit = found.problem.shared_unit()
        units = (unit, f"{unit}/s", f"{unit}/s²")
        sizes = [f"{own.value:.3g} {per}" for own, per in zip(found.jumps, units, strict=True)]
        yield f"At the hand-over position, velocity and acceleration jump by {', '.join(sizes)}."
    elif found.cut or (found.evidence is not None and not found.evidence.at_rest):
        motion, unit = found.executed, found.problem.shared_unit()
        fastest = np.abs(motion(np.array([0.0, motion.duration]), 1)).max(axis=1)
        said = " and ".join(
            f"{verb} at {speed:.3g} {unit}/s"
            for verb, speed in zip(("begins", "ends"), fastest, strict=True)
        )
        yield f"It {said}{': no problem was stated that forbids it' if found.cut else ''}."
    if found.standing:
        yield standing_words(found.standing)


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


def _table(trials: Iterable[CheckedTrial]) -> PlainTable:
    table = console.table("problem", "planner", numbers=_NUMBERS)
    for trial in trials:
        durations = (trial.claimed_duration, trial.certified_duration, trial.dilation)
        table.row(
            trial.problem,
            console.option_lines(trial.planner),
            table_cells.number(trial.seed, "d"),
            *(table_cells.number(value, ".6f") for value in durations),
            trial.status if trial.holds else console.alarm("DOES NOT HOLD"),
        )
    return table


def _what_is_wrong(trial: CheckedTrial) -> str:
    name = f"{trial.planner} on {trial.problem}" if trial.problem else trial.planner
    if trial.seed is not None:
        name += f", seed {trial.seed}"
    if trial.id:
        name += f", trial {trial.id}"
    return f"{name}: {'; '.join([*trial.differences, *filter(None, trial.flaws)])}"
