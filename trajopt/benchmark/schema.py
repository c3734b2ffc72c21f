"""What a trial looks like in HDF5, with plain h5py in mind.

Every dataset carries its `units` and a `description`, arrays have dimension scales. Whatever an
attribute would be too small for (64 KiB) is a dataset. `store.py` says where the files are.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any
from urllib.parse import quote, unquote

import h5py
import numpy as np

from trajopt.benchmark.trial import Trial, verdict
from trajopt.exceptions import InvalidTrajectory, StoreError
from trajopt.planner import Relation
from trajopt.problem import LIMIT_NAMES, Limits, Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory

SCHEMA = 1  # raise it whenever a reader of this version could misread the file

_UNITS = {"position": "rad", "velocity": "rad/s", "acceleration": "rad/s^2", "jerk": "rad/s^3"}


def write_trial(group: Any, trial: Trial) -> None:
    """One trial, whole: problem, planner, verdict, trajectory, history, provenance."""
    group.attrs["schema"] = SCHEMA
    group.attrs["description"] = "one planner on one problem with one seed, judged by the verifier"
    for name, (value, units, description) in _scalars(trial).items():
        _put(group, name, value, units, description)
    scales = _Scales(group)
    _write_problem(group.create_group("problem"), trial.problem, scales)
    if trial.solution.trajectory is not None:
        _write_trajectory(group.create_group("trajectory"), trial.solution.trajectory, scales)
    if trial.solution.history is not None:
        history = group.create_group("history")
        columns = np.asarray(trial.solution.history, dtype=float).T
        names = (
            ("evaluations", "1", "evaluations spent"),
            ("duration", "s", "best duration by then"),
        )
        for column, (name, units, description) in zip(columns, names, strict=True):
            _put(history, name, column, units, description)
        history["evaluations"].make_scale("evaluations")
        history["duration"].dims[0].attach_scale(history["evaluations"])
    stats = group.create_group("stats")
    for name, value in trial.solution.stats.items():
        _put(stats, quote(name, safe=" "), value, "", "reported by the planner (SI units)")
    versions = group.create_group("provenance")
    for name, text in trial.provenance.items():
        _put(versions, name, text, "", "version, commit or machine that produced this trial")


def read_trial(group: Any) -> Trial:
    """The trial as it was judged, its certificate computed anew from the stored trajectory.

    A trajectory that is none (any more) leaves an invalid trial without one.
    """
    check_schema(group)
    problem = _read_problem(group["problem"])
    trajectory, damage = _read_trajectory(group)
    history = None
    if "history" in group:
        history = np.stack([group["history"][n][()] for n in ("evaluations", "duration")], axis=1)
    text = {n: group[n].asstr()[()] for n in _TEXT}
    if damage:
        text |= {"status": str(Status.INVALID), "message": f"the stored trajectory: {damage}"}
    number = {n: group[n][()] for n in ("lower_bound", "evaluations", "setup_time", "solve_time")}
    batch = int(group["batch"][()])
    solution = Solution(
        Status(text["planner_status"]),
        trajectory,
        text["planner_message"],
        lower_bound=optional(number["lower_bound"], float),
        evaluations=optional(number["evaluations"], int),
        history=history,
        setup_time=float(number["setup_time"]) * batch,
        stats={unquote(name): _value(data) for name, data in group["stats"].items()},
    )
    return Trial(
        problem, text["planner"], text["label"], json.loads(text["options"]),
        int(group["seed"][()]),
        Relation[text["relation"]], Status(text["status"]), text["message"], solution,
        verdict(problem, solution)[2], float(number["setup_time"]), float(number["solve_time"]),
        batch, text["started"],
        {name: data.asstr()[()] for name, data in group["provenance"].items()},
    )  # fmt: skip


def _read_trajectory(group: Any) -> tuple[Trajectory | None, str]:
    if "trajectory" not in group:
        return None, ""
    arrays = (group["trajectory"][n][()] for n in ("breaks", "coefficients", "waypoint_times"))
    try:
        return Trajectory(*arrays), ""
    except InvalidTrajectory as error:
        return None, str(error)


_TEXT = (
    "planner", "label", "options", "relation", "status", "message", "planner_status",
    "planner_message", "started",
)  # fmt: skip


def _scalars(t: Trial) -> dict[str, tuple[Any, str, str]]:
    c = t.certificate
    return {
        "id": (t.id, "", "identity: problem digest, planner, options, seed, package version"),
        "planner": (t.planner, "", "planner name"),
        "label": (t.label, "", "planner name with the options that differ from its defaults"),
        "options": (json.dumps(dict(t.options), default=str), "", "all planner options, as JSON"),
        "seed": (t.seed, "1", "seed of the random stream; 0 for deterministic planners"),
        "relation": (t.relation.name, "", "how the answer relates to the minimum-time problem"),
        "status": (str(t.status), "", "verdict"),
        "message": (t.message, "", "why, if not solved"),
        "planner_status": (str(t.solution.status), "", "what the planner itself reported"),
        "planner_message": (t.solution.message, "", "what the planner itself said"),
        "claimed_duration": (t.claimed_duration, "s", "duration of the trajectory as returned"),
        "certified_duration": (
            t.certified_duration, "s", "max(1, dilation) x claimed; NaN: beyond mending"),
        "lower_bound": (t.lower_bound, "s", "no trajectory beats this, according to the planner"),
        "dilation": (c and c.dilation, "1", "exact cheapest time dilation that meets the limits"),
        "feasible": (c and float(c.feasible), "1", "1 if it keeps every limit as claimed"),
        "certificate": (json.dumps(c.as_dict() if c else None), "", "worst values, joints from 1"),
        "evaluations": (t.solution.evaluations, "1", "objective evaluations; NaN if not counted"),
        "setup_time": (t.setup_time, "s", "wall time for building what later calls reuse"),
        "solve_time": (t.solve_time, "s", "wall time besides; a batch's divided by its runs"),
        "batch": (t.batch, "1", "runs that were solved together"),
        "started": (t.started, "", "start time, UTC, ISO 8601"),
    }  # fmt: skip


class _Scales:
    """The dimension scales of one trial, each made when first needed and shared by its arrays."""

    def __init__(self, group: Any) -> None:
        self.group = group.create_group("scales")

    def attach(self, data: Any, *names: str) -> None:
        for axis, name in enumerate(names):
            if name not in self.group:
                last = data.shape[axis]
                values = {"power": np.arange(last)[::-1], "side": np.arange(last)}
                _put(self.group, name, values.get(name, np.arange(1, last + 1)), "1", _SCALES[name])
                self.group[name].make_scale(name)
            data.dims[axis].attach_scale(self.group[name])


_SCALES = {
    "joint": "joint number, from 1",
    "waypoint": "waypoint number, from 1",
    "side": "0: low, 1: high",
    "piece": "piece number, from 1",
    "break": "break number, from 1",
    "power": "power of the time since the piece's start",
}


def _write_problem(group: Any, problem: Problem, scales: _Scales) -> None:
    _put(group, "name", problem.name, "", "problem name")
    _put(group, "source", problem.source, "", "where its numbers come from")
    _put(group, "digest", problem.digest(), "", "SHA-256 of its numbers")
    _put(
        group,
        "waypoints",
        problem.waypoints,
        "rad",
        "positions to pass in order, from rest to rest",
    )
    scales.attach(group["waypoints"], "waypoint", "joint")
    for name in LIMIT_NAMES:
        description = f"{name} limits, low and high; infinite where there is none"
        _put(group, name, getattr(problem.limits, name), _UNITS[name], description)
        scales.attach(group[name], "joint", "side")


def _write_trajectory(group: Any, trajectory: Trajectory, scales: _Scales) -> None:
    group.attrs["description"] = (
        "piecewise polynomial, scipy.interpolate.PPoly(coefficients, breaks)"
    )
    _put(group, "breaks", trajectory.breaks, "s", "start of each piece, and the end")
    _put(group, "coefficients", trajectory.coefficients, "rad/s^power", "highest power first")
    _put(group, "waypoint_times", trajectory.waypoint_times, "s", "when each waypoint is passed")
    scales.attach(group["breaks"], "break")
    scales.attach(group["coefficients"], "power", "piece", "joint")
    scales.attach(group["waypoint_times"], "waypoint")


def _read_problem(group: Any) -> Problem:
    limits = Limits(**{name: group[name][()] for name in LIMIT_NAMES})
    return Problem(
        group["waypoints"][()], limits, group["name"].asstr()[()], group["source"].asstr()[()]
    )


def _put(group: Any, name: str, value: Any, units: str, description: str) -> None:
    array = np.asarray(np.nan if value is None else value)
    if array.dtype.kind in "OUS":
        texts = value if isinstance(value, str) or array.ndim else json.dumps(value, default=str)
        texts = _storable(texts) if isinstance(texts, str) else texts
        data = group.create_dataset(name, data=texts, dtype=h5py.string_dtype())
    else:
        data = group.create_dataset(name, data=array)
    data.attrs["units"], data.attrs["description"] = units, description


def _storable(text: str) -> str:
    """HDF5 text holds neither NUL nor lone surrogates."""
    return text.replace("\0", "\\0").encode("utf-8", "backslashreplace").decode()


def _value(data: Any) -> Any:
    if not h5py.check_string_dtype(data.dtype):
        return data[()]
    return list(data.asstr()[()]) if data.shape else data.asstr()[()]


def optional(value: float, kind: Callable[[float], Any]) -> Any:
    """A stored number; NaN stands for None."""
    return None if np.isnan(value) else kind(value)


def check_schema(group: Any) -> None:
    """Raise `StoreError` for a file that a newer version wrote."""
    schema = int(group.attrs.get("schema", 0))
    if schema > SCHEMA:
        name = group.file.filename
        raise StoreError(
            f"{name}: written with schema {schema}, this version reads up to {SCHEMA}; "
            "upgrade trajopt"
        )
