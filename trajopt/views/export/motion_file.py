"""A certified trajectory as a file: samples, a ROS message, a picture, or exact polynomials.

Samples for a controller are verified as executed: the breaks of the motion are moved to whole
control cycles (`trajopt.formats.on_cycle`), the file is written, read again, joined as the
controller joins it, and verified. Only then does the file take its place.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Literal

import numpy as np

from trajopt.benchmark.store import atomic
from trajopt.benchmark.store.document import trajectory_table
from trajopt.benchmark.store.folder import save
from trajopt.benchmark.trial import Trial, trials_of
from trajopt.core.exceptions import InvalidInput, StoreError, WrongType, shown
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.formats import joint_trajectory, on_cycle, samples_csv
from trajopt.formats.motion import motion as read_motion
from trajopt.formats.on_cycle import OnCycle
from trajopt.formats.samples import Samples
from trajopt.judgement import Execution, GivenMotion, passing
from trajopt.judging.certificate import Certificate
from trajopt.judging.verification import verify
from trajopt.views.analysis.gap_reference import best

Points = Literal["breaks", "cycles"]

MESSAGES = (".yaml", ".yml")
PICTURES = (".png", ".svg", ".pdf")
_ENDINGS = (".csv", ".json", *MESSAGES, *PICTURES, ".h5")


@dataclass(frozen=True)
class Target:
    """A file to be written.

    Attributes:
        path: Its ending determines the format.
        cycle: Control cycle, s.
        points: Times of the samples: the motion's breaks, or every cycle. By default a message has
            them at the breaks and a CSV file every cycle. A .json file is a message if points are
            given; otherwise it has the exact piecewise polynomial with its verdict.
        goal: True for a message as a goal of the action `FollowJointTrajectory`.
        units: Units of the joints in a .csv file, for example "deg"; by default rad and m.

    Raises:
        InvalidInput: The ending is unknown, or its format has no points or no goal.
    """

    path: Path
    cycle: float = 1e-3
    points: Points | None = None
    goal: bool = False
    units: Sequence[str] = ()

    def __post_init__(self) -> None:
        if self.path.suffix not in _ENDINGS:
            right = f"a file ending in {', '.join(_ENDINGS)}"
            raise InvalidInput("--out", right, value=str(self.path))
        if self.points is not None and self.path.suffix in (*PICTURES, ".h5"):
            right = f"left out for a {self.path.suffix} file, which has no points"
            raise InvalidInput("--points", right, value=self.points)

        if self.goal and self.path.suffix not in (".json", *MESSAGES):
            right = f"left out for {self.path.name}; a goal's file ends in .yaml, .yml or .json"
            raise InvalidInput("--as", right, value="goal")

    @property
    def executed(self) -> bool:
        """True for samples that a controller is to run."""
        sampled = self.path.suffix in (".csv", *MESSAGES)
        return sampled or self.goal or self.points is not None

    @property
    def at_breaks(self) -> bool:
        """True for samples at the motion's breaks, not every cycle."""
        return self.path.suffix != ".csv" if self.points is None else self.points == "breaks"


@dataclass(frozen=True)
class Executed:
    """The motion that a controller makes of a written file.

    Attributes:
        points: Number of points.
        pieces: Kind of the pieces between them: cubic or quintic.
        duration: s.
        longer: Excess over the duration of the certified trajectory, relative.
        certificate: The verdict on the executed motion.
    """

    points: int
    pieces: str
    duration: float
    longer: float
    certificate: Certificate

    def as_dict(self) -> dict[str, Any]:
        """For JSON: SI units."""
        return {
            "points": self.points,
            "interpolation": self.pieces,
            "duration": self.duration,
            "certificate": self.certificate.as_dict(),
        }


def write(
    path: Target | Path | str, trial: Trial, *, cycle: float = 1e-3, points: Points | None = None
) -> Executed | None:
    """Write a trial's certified trajectory, and judge what a controller makes of the file.

    Args:
        path: The file, which is overwritten. Its ending determines the format: .csv, .yaml (a ROS
            message), .json, .png, .svg, .pdf or .h5. Or a `Target`, which has all arguments.
        trial: An answer, of `trajopt.plan` or `Results.items`.
        cycle: Of the controller, s; every point is on it.
        points: Where samples are: at the motion's breaks, or every cycle (`Target`).

    Returns:
        The verdict on the motion as executed; None for a file that no controller runs.

    Raises:
        WrongType: The second argument is no trial.
        InvalidInput: The cycle is too long for the motion.
        StoreError: There is no certified trajectory, the file cannot be written, or the executed
            motion would break a limit; then the file is not kept.
    """
    if not isinstance(trial, Trial):
        raise WrongType(
            f"expected an answer of trajopt.plan, got {shown(trial)}: "
            "plan(problem, planner) gives one, verified, and write(path, answer) writes it"
        )
    if not isinstance(path, Target):
        try:
            return write(Target(Path(path), cycle, points), trial)
        except InvalidInput as error:  # it names the command's option
            key = error.key.replace("--out", "--path").removeprefix("--")
            raise InvalidInput(key, error.expected, value=error.value) from None
    target = path
    if target.executed:
        return _write_executed(target, trial)
    if target.path.suffix == ".h5":
        save(target.path, trial, best)
    elif target.path.suffix == ".json":
        _write_text(target.path, _exact(trial))
    else:
        title = f"{trial.label} on {trial.problem.name}"
        _draw(target.path, trial.problem, _certified(trial), title)
    return None


def write_log(path: Path, found: Execution) -> bool:
    """Write the motion within a log's half widths, as `write` does; return if there is one.

    For a broken log it is a slower motion that keeps the limits, if one was found. Samples are at
    the motion's breaks, so cubic pieces between them are the motion itself. A trial (.h5) states
    the motion as its planner, without the verdict on the log. A picture shows the log itself, how
    accurately it is known, and the rows that prove a limit broken.
    """
    told = found.evidence
    if told is not None and path.suffix in PICTURES:
        from trajopt.views.figures import log, plots

        figure = log.premise(found)
        _write_by(path, lambda file: plots.write(figure, file))
        return True
    if told is None or (told.motion is None and told.slower is None):
        return False
    motion = told.motion if told.slower is None else told.slower.motion
    assert motion is not None
    own = passing(found.problem, motion)
    if path.suffix == ".h5":
        given = GivenMotion(read_motion(own))
        (trial,) = trials_of(given, found.problem, [0], found.motion.name)
        save(path, trial, best)
    elif path.suffix == ".json":
        _write_text(path, json.dumps(_polynomials(found.problem, own), indent=1))
    else:
        times = own.breaks
        if path.suffix in MESSAGES:
            times = np.round(times, 9)  # which a message holds
            times = times[np.append(True, np.diff(times) > 0)]
        within = np.minimum(times, own.breaks[-1])
        names = _names(found.problem)
        units = found.problem.joint_units
        samples = Samples(names, times, own(within), own(within, 1), joint_units=units)
        form = samples_csv.write if path.suffix == ".csv" else joint_trajectory.write
        _write_by(path, lambda file: form(file, samples))
    return True


def _certified(trial: Trial) -> Trajectory:
    trajectory = trial.certified_trajectory
    if trajectory is None:
        raise StoreError(
            f"nothing to write: {trial.planner} has no certified trajectory ({trial.status})"
        )
    return trajectory


def _exact(trial: Trial) -> str:
    """The exact piecewise polynomial, and the verdict, as JSON."""
    exact = _polynomials(trial.problem, _certified(trial))
    return json.dumps(trial.as_dict() | exact, indent=1, default=str)


def _polynomials(problem: Problem, trajectory: Trajectory) -> dict[str, Any]:
    return {"joint_names": list(problem.joint_names)} | trajectory_table(trajectory)


def _names(problem: Problem) -> tuple[str, ...]:
    """The joints' names in a file, which must have some."""
    return problem.joint_names or tuple(f"joint_{joint + 1}" for joint in range(problem.joints))


def _write_text(path: Path, text: str) -> None:
    atomic.write(path, lambda file: file.write_text(text, encoding="utf-8"))


def _draw(
    path: Path, problem: Problem, trajectory: Trajectory, title: str, name: str = "planner"
) -> None:
    """Every joint against time, with its limits."""
    from trajopt.views.figures import motions, plots  # Matplotlib is for those who draw

    figure = motions.motion(problem, trajectory, title=title, own_name=name)
    _write_by(path, lambda file: plots.write(figure, file))


def _write_by(path: Path, write: Callable[[Path], object]) -> None:
    """Write a file as a whole, by a function that looks at its ending."""
    with TemporaryDirectory() as folder:
        written = Path(folder) / f"motion{path.suffix}"
        write(written)
        content = written.read_bytes()
    atomic.write(path, lambda file: file.write_bytes(content))


def _write_executed(target: Target, trial: Trial) -> Executed:
    problem = trial.problem
    trajectory = _certified(trial)
    motion = on_cycle.moved(problem, trajectory, target.cycle)
    names = _names(problem)
    samples = motion.at_breaks(names) if target.at_breaks else motion.at_cycles(names)
    samples = replace(samples, joint_units=problem.joint_units)
    with TemporaryDirectory() as folder:
        written = Path(folder) / f"motion{target.path.suffix}"
        if target.path.suffix == ".csv":
            samples_csv.write(written, samples, target.units)
            back = samples_csv.read(written)
        else:
            joint_trajectory.write(written, samples, goal=target.goal)
            back = joint_trajectory.read(written)
        content = written.read_bytes()
    executed = _judged(trial, trajectory, motion, back)
    if not executed.certificate.feasible:
        why = "; ".join(executed.certificate.flaws) or executed.certificate.peak(trial.problem)
        raise StoreError(f"{target.path}: not written: executed, {why}")
    atomic.write(target.path, lambda file: file.write_bytes(content))
    return executed


def _judged(trial: Trial, planned: Trajectory, motion: OnCycle, samples: Samples) -> Executed:
    """Return the verdict on the motion that a controller makes of samples read from a file."""
    executed = Trajectory.from_samples(
        samples.times,
        samples.positions,
        samples.velocities,
        samples.accelerations,
        waypoint_times=motion.waypoint_times,
    )
    return Executed(
        points=len(samples.times),
        pieces=samples.interpolation(),
        duration=executed.duration,
        longer=executed.duration / planned.duration - 1,
        certificate=verify(trial.problem, executed),
    )
