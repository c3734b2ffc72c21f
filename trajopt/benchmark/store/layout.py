"""Groups, datasets and attributes of `results.h5` for other tools, by name.

    /problems/<name>/                     waypoints, start_velocity and other demands, limits/<kind>
    /runs/<problem>/<label>/<seed>/       the verdict, as attributes
        trajectory/                       breaks, coefficients, lengths, waypoint_times
        history/                          evaluations, duration
        uses/                             limit, value, joint, time
    /trials/<field>                       a value per trial; `path` is the group of its run

All numbers are in rad, m and s. `results_file` writes this tree, and compares a file with it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.store import fields
from trajopt.benchmark.store.document import pack
from trajopt.benchmark.store.fields import FIELDS, Field
from trajopt.benchmark.trial import Trial
from trajopt.core.demand import DEMANDS
from trajopt.core.problem import Problem

References = Callable[[Sequence[Trial]], Mapping[str, float]]
"""Return the duration that gaps are measured against, s, by the problem's digest."""

ADDED_FIELDS = (
    Field("reference", "number", "s", "duration that the gap is measured against; NaN: none"),
    Field("gap", "number", "1", "certified_duration / reference - 1, so 0.083 is 8.3 %"),
    Field("path", "line", "", "group of the run in results.h5"),
)
"""Columns of `/trials` that follow from all trials together."""

VERDICT = (
    *("id", "status", "message", "claimed_duration", "certified_duration", "dilation"),
    *("position_excess", "lower_bound", "gap"),
)
"""Fields that are attributes of a run too."""

PROBLEM_NAMES = {
    "waypoints": "positions to pass in order, from rest to rest unless a demand says otherwise, "
    "(waypoints, joints)",
    **{key: f"if asked: {demand.meaning}" for key, demand in DEMANDS.items()},
    "limits/<kind>": "lowest and highest value of each joint, (joints, 2); infinite: no limit; "
    "(segments, joints, 2) where segments differ",
}
RUN_NAMES = {
    "trajectory": "motion as claimed; the certified one is this one, repaired where it missed "
    "within tolerance, and max(1, dilation) times slower; between moving ends a slower motion that "
    "the judge finds",
    "trajectory/breaks": "times at which the pieces begin and end, (pieces + 1,)",
    "trajectory/coefficients": "as scipy.interpolate.PPoly has them, (order, pieces, joints): "
    "highest power first, in the time since the start of the piece",
    "trajectory/lengths": "durations of the pieces, (pieces,); exact, where breaks are rounded",
    "trajectory/waypoint_times": "when each waypoint is passed, (waypoints,)",
    "history/evaluations": "objective evaluations that the search had spent",
    "history/duration": "its shortest certified duration by then; NaN: no candidate yet",
    "uses/limit": "the limit; `position_excess` says what is beyond a position limit",
    "uses/value": "largest value over the limit, so 1 is at the limit",
    "uses/joint": "joint that has it, counted from 1; 0: not one joint's",
    "uses/time": "when it has it",
}
"""The meaning of each name, stated once: attributes of `/problems` and `/runs`."""

_ODD = re.compile(r"[%/#\[\]\\\x00-\x1f\x7f]|^\.")


class Data(NamedTuple):
    """A dataset: numbers, or a list of texts."""

    values: NDArray[Any] | list[str]
    units: str
    description: str = ""


@dataclass(frozen=True)
class Group:
    """A group: its attributes, and its members by name."""

    members: dict[str, Group | Data] = field(default_factory=dict)
    attributes: dict[str, Any] = field(default_factory=dict)


def tree(trials: Sequence[Trial], references: References | None = None) -> Group:
    """Return all groups and datasets for other tools, of a file of these trials.

    Args:
        trials: In the order of the rows of `/trials`.
        references: None: gaps are NaN.
    """
    columns = _columns(trials, references)
    problems = Group(attributes=PROBLEM_NAMES)
    runs = Group(attributes=RUN_NAMES)
    for row, trial in enumerate(trials):
        verdict = {name: columns[name].values[row] for name in VERDICT}
        *groups, seed = columns["path"].values[row].split("/")[2:]
        place = runs
        for name in groups:
            place = place.members.setdefault(name, Group())  # type: ignore[assignment]
        place.members[seed] = _run(trial, verdict)
        problems.members.setdefault(groups[0], _problem(trial.problem))
    table = Group({**columns}, {"description": "a row per trial"})
    return Group({"problems": problems, "runs": runs, "trials": table})


def _columns(trials: Sequence[Trial], references: References | None) -> dict[str, Data]:
    """Return the datasets of `/trials` by name."""
    columns = fields.columns(trials)
    known = references(trials) if references else {}
    reference = np.array([known.get(trial.digest, np.nan) for trial in trials], dtype=float)
    columns["reference"] = reference
    columns["gap"] = columns["certified_duration"] / reference - 1
    columns["path"] = paths(trials)
    found = {}
    for own in (*FIELDS, *ADDED_FIELDS):
        values = columns[own.name]
        if not isinstance(values, np.ndarray):
            values = pack(values)
        found[own.name] = Data(values, own.unit, own.meaning)
    return found


def _problem(problem: Problem) -> Group:
    limits: dict[str, Group | Data] = {
        key: Data(own.numbers, _ascii(own.unit(problem)))
        for key, own in problem.limits.kinds.items()
    }
    length = problem.shared_unit()
    demands: dict[str, Group | Data] = {
        key: Data(numbers, _ascii(DEMANDS[key].unit(length)))
        for key, numbers in problem.demands.items()
    }
    waypoints = Data(problem.waypoints, length)
    about = {
        "name": problem.name,
        "source": problem.source,
        "digest": problem.digest(),
        "joint_names": list(problem.joint_labels),
        "joint_units": [problem.unit(joint) for joint in range(problem.joints)],
    }
    members = {"waypoints": waypoints, **demands, "limits": Group(limits)}
    return Group(members, pack(about))


def _ascii(unit: str) -> str:
    """Return a unit in ASCII: `h5dump` shows nothing else."""
    return unit.replace("²", "^2").replace("³", "^3")


def _run(trial: Trial, verdict: Mapping[str, Any]) -> Group:
    """Return the group of a trial; missing parts have no subgroup."""
    units = {own.name: own.unit for own in (*FIELDS, *ADDED_FIELDS)}
    lines = [f"{name}: {units[name]}" for name in verdict if units[name]]
    run = Group(attributes={**verdict, "units": "\n".join(lines)})
    trajectory = trial.solution.trajectory
    if trajectory is not None:
        unit = trial.problem.shared_unit(1)  # per s
        run.members["trajectory"] = Group(
            {
                "breaks": Data(trajectory.breaks, "s"),
                "coefficients": Data(trajectory.coefficients, f"{unit}^power"),
                "lengths": Data(trajectory.lengths, "s"),
                "waypoint_times": Data(trajectory.waypoint_times, "s"),
            }
        )
    history = trial.certified_history
    if len(history) > 1:
        evaluations, duration = history.T
        run.members["history"] = Group(
            {"evaluations": Data(evaluations, "1"), "duration": Data(duration, "s")}
        )
    uses = list(_uses(trial))
    if uses:
        limits, values, joints, times = zip(*uses, strict=True)
        run.members["uses"] = Group(
            {
                "limit": Data(list(limits), ""),
                "value": Data(np.array(values), "1"),
                "joint": Data(np.array(joints), "1"),
                "time": Data(np.array(times), "s"),
            }
        )
    return run


def _uses(trial: Trial) -> Iterator[tuple[str, float, int, float]]:
    """Yield limit, largest value over it, joint from 1 (0: not one joint's), and time, s."""
    ratios = trial.certificate.ratios if trial.certificate else {}
    for key, use in ratios.items():
        yield key, use.value, 0 if use.joint is None else use.joint + 1, use.time


# --- names ---


def paths(trials: Sequence[Trial]) -> list[str]:
    """Return the group of each trial's run.

    A planner may have several trials with one label and seed, for example of two versions of its
    code. Then the one that ran last is named by its seed; the names of the others also have their
    identities. Of several problems with one name the first is named by it alone.
    """
    problems: dict[tuple[str, str], str] = {}
    last: dict[tuple[str, str, int], Trial] = {}
    for trial in trials:
        name = trial.problem.name
        taken = any(name == other for other, _ in problems)
        ending = f"#{trial.digest}" if taken else ""
        problem = problems.setdefault((name, trial.digest), escaped(name) + ending)
        key = (problem, trial.label, trial.seed)
        last[key] = max(last.get(key, trial), trial, key=lambda own: own.asked or own.started)
    found = []
    for trial in trials:
        problem = problems[trial.problem.name, trial.digest]
        is_last = last[problem, trial.label, trial.seed] is trial
        ending = "" if is_last else f"#{trial.id}"
        found.append(f"/runs/{problem}/{escaped(trial.label)}/{trial.seed}{ending}")
    return found


def escaped(name: str) -> str:
    """Return the name as a link of HDF5 may be called: odd characters as in URLs, `/` as `%2F`."""
    return _ODD.sub(lambda odd: "".join(f"%{byte:02X}" for byte in odd[0].encode()), name) or "%"
