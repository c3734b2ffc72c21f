"""The tables of `results.h5`, and how rows become tables.

    /trials/<field>          (N,)     a row per trial: by problem, label, seed, identity
    /texts                   (N,)     the sealed text of each row: the only evidence
    /code/provenance         (C,)     versions, commit and machine; `trials/code` is its row
    /problems/<name>/                 waypoints, demands, limits/<kind>
        waypoint_times       (n, W)   a row for each of its n trials; `trials/row` is the row
        uses/…               (n, kinds)
        certified/, claimed/          motions, one after the other: `start` and `count` of each
        history/                      searches, likewise
        best/                         the shortest motion known, and the proved bound

All numbers are in rad, m and s. A trial is a `Table` of one row, made where it is judged
(`table`); everything else is choosing rows of tables (`Rows.column`). `results_file` writes them.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.store import fields
from trajopt.benchmark.store.document import pack
from trajopt.benchmark.store.fields import FIELDS, Field
from trajopt.benchmark.trial import Trial
from trajopt.core.demand import DEMANDS
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

Column = NDArray[Any]
Table = Mapping[str, Mapping[str, Column]]
"""The rows of trials of one problem: a column by group and name. Texts are bytes."""

Key = tuple[str, str]
"""A problem's name and digest."""

MAX_DEGREE = 15
"""Of motions in the tables, which all have as many coefficients as the highest; texts have all."""

_OF_PROBLEM = ("source", "joint_names", "joint_units", "digest")  # attributes of its group
_OWN = tuple(own for own in FIELDS if own.name not in (*_OF_PROBLEM, "problem", "provenance"))
ADDED_FIELDS = (
    Field("reference", "number", "s", "duration that the gap is measured against; NaN: none"),
    Field("gap", "number", "1", "certified_duration / reference - 1, so 0.083 is 8.3 %"),
    Field("code", "integer", "1", "row in /code, from 0"),
    Field("row", "integer", "1", "row in the tables of its problem, from 0"),
)
"""Columns that follow from all trials together."""

COLUMNS = (Field("problem", "line", "", "group in /problems"), *_OWN, *ADDED_FIELDS)
"""The columns of `/trials`, in the order of tables for people."""

MOTIONS = ("certified", "claimed")
GROUPS = ("uses", *MOTIONS, "history")
"""The groups of a problem's tables."""

RAGGED = {"breaks": 0, "lengths": 0, "coefficients": 1, "evaluations": 0, "duration": 0}
"""The axis of the knots or evaluations that a group's `count` counts."""

MEANINGS = {
    "waypoints": "positions to pass in order, from rest to rest unless a demand says otherwise, "
    "(waypoints, joints)",
    **{key: f"if asked: {demand.meaning}" for key, demand in DEMANDS.items()},
    "limits": "lowest and highest value of each joint, (joints, 2); infinite: no limit; "
    "(segments, joints, 2) where segments differ",
    "waypoint_times": "when the claimed motion passes each waypoint, (trials, waypoints); NaN: no "
    "motion",
    "uses": "largest use of each limit that the problem's attribute `uses` names, (trials, "
    "limits); NaN: none",
    "uses/value": "value over the limit, so 1 is at the limit",
    "uses/joint": "joint that has it, counted from 1; 0: not one joint's",
    "uses/time": "when it has it",
    "certified": "the motion that has the certified duration: the claimed one, repaired where it "
    "missed within tolerance, and slowed down until it keeps the limits",
    "claimed": "the motion as the planner returned it",
    "history": "certified duration of the search over its evaluations",
    "start": "where the rows of a trial begin",
    "count": "how many rows it has; 0: none",
    "breaks": "times at which the pieces begin; the last is the end of the motion",
    "lengths": "durations of the pieces, exact where breaks are rounded; 0 at the last break",
    "coefficients": "as scipy.interpolate.PPoly has them, (order, breaks, joints): highest power "
    "first, in the time since the break; at the last break the end position",
    "evaluations": "objective evaluations that the search had spent",
    "duration": "its shortest certified duration by then; NaN: no candidate yet",
    "best": "the shortest motion known, and the largest lower bound proved; lower_bound NaN: none",
    "best/coefficients": "(order, pieces, joints), as scipy.interpolate.PPoly has them",
}
"""What names mean, stated once."""

_ODD = re.compile(r"[%/#\[\]\\\x00-\x1f\x7f]|^\.")


class BestMotion(NamedTuple):
    """What is known of a problem's optimum; durations in s.

    Attributes:
        duration: That gaps are measured against.
        kind: Of the reference, as the report has it.
        lower_bound: No motion is faster; NaN: nothing is proved.
        source: Whose motion it is; empty where it is none.
        motion: The motion; None where the reference is none.
    """

    duration: float
    kind: str
    lower_bound: float
    source: str = ""
    motion: Trajectory | None = None


References = Callable[[Sequence[Trial]], Mapping[str, BestMotion]]
"""Return what is known of each problem, by its digest, given its references' trials."""


def table(trial: Trial, text: bytes) -> Table:
    """Return a trial as a table of one row; its verdict is taken as it is.

    Args:
        trial: As `trial_text.read` gives it; its certificate has the motion (`Trial.differences`).
        text: Of the trial.
    """
    problem = trial.problem
    values = {own.name: _column(own, trial) for own in (*_OWN, fields.PROVENANCE)}
    claimed = trial.solution.trajectory
    if claimed is not None and claimed.joints != problem.joints:
        claimed = None
    history = trial.certified_history
    evaluations, duration = (history if len(history) > 1 else history[:0]).T
    return {
        "trials": values,
        "texts": {"text": _objects([text])},
        "": {"waypoint_times": _waypoint_times(problem, claimed)},
        "uses": _uses(trial),
        "certified": _knots(trial.certified_trajectory, problem),
        "claimed": _knots(claimed, problem),
        "history": {
            "count": np.array([len(duration)]),
            "evaluations": evaluations,
            "duration": duration,
        },
    }


def key(problem: Problem) -> Key:
    """Return the key of a problem's tables."""
    return problem.name, problem.digest()


def _column(own: Field, trial: Trial) -> Column:
    values = fields.column(own, [trial])
    if isinstance(values, np.ndarray):
        return values
    return _objects([text.encode() for text in pack(values)])


def _objects(values: Sequence[Any]) -> Column:
    found = np.empty(len(values), dtype=object)
    found[:] = values
    return found


def _waypoint_times(problem: Problem, claimed: Trajectory | None) -> Column:
    count = len(problem.waypoints)
    if claimed is None or len(claimed.waypoint_times) != count:
        return np.full((1, count), np.nan)
    return claimed.waypoint_times[None]


def limits_used(problem: Problem) -> list[str]:
    """Return the limits, and the demand, whose use is a ratio: the columns of `uses`."""
    kinds = [name for name in KINDS if name in problem.limits.kinds and KINDS[name].is_ratio]
    has_least = "least_times" in problem.demands or "least_duration" in problem.demands
    return kinds + ["least_times"] * has_least


def _uses(trial: Trial) -> dict[str, Column]:
    names = limits_used(trial.problem)
    found = np.full((3, 1, len(names)), np.nan)
    ratios = trial.certificate.ratios if trial.certificate else {}
    for place, name in enumerate(names):
        if name in ratios:
            use = ratios[name]
            found[:, 0, place] = use.value, 0 if use.joint is None else use.joint + 1, use.time
    return dict(zip(("value", "joint", "time"), found, strict=True))


def _knots(motion: Trajectory | None, problem: Problem) -> dict[str, Column]:
    """Return a motion, a row per break: the last one holds the end position."""
    if motion is None or len(motion.coefficients) > MAX_DEGREE + 1:
        none = np.zeros(0)
        flat = np.zeros((1, 0, problem.joints))
        return {"count": np.array([0]), "breaks": none, "coefficients": flat, "lengths": none}
    pieces = motion.coefficients
    end = np.zeros((len(pieces), 1, motion.joints))
    for power in pieces[:, -1]:
        end[-1, 0] = end[-1, 0] * motion.lengths[-1] + power
    return {
        "count": np.array([len(motion.breaks)]),
        "breaks": motion.breaks,
        "coefficients": np.concatenate([pieces, end], axis=1),
        "lengths": np.append(motion.lengths, 0.0),
    }


# --- choosing rows ---


class Rows:
    """Rows of several tables of one problem, in a chosen order.

    Args:
        parts: Rows in memory, or those of an open file.
        rows: A part and a row of it, for each row.
    """

    def __init__(self, parts: Sequence[Any], rows: Iterable[tuple[int, int]]) -> None:
        self._parts = parts
        self.count = 0
        self._runs: list[list[int]] = []  # part, first row, end: neighbours in one slice
        for part, row in rows:
            self.count += 1
            if self._runs and self._runs[-1][0] == part and self._runs[-1][2] == row:
                self._runs[-1][2] = row + 1
            else:
                self._runs.append([part, row, row + 1])
        self._ends: dict[str, list[Column]] = {}

    def column(self, group: str, name: str) -> Column:
        """Return a column of these rows; coefficients of lower order get leading zeros."""
        ragged = name in RAGGED and group in (*MOTIONS, "history")
        axis = RAGGED[name] if ragged else 0
        arrays: dict[int, Column] = {}
        slices = []
        for part, begin, end in self._runs:
            if part not in arrays:
                arrays[part] = self._parts[part][group][name]
            if ragged:
                ends = self._ends_of(group)[part]
                begin, end = ends[begin], ends[end]
            own = arrays[part]
            slices.append(own[begin:end] if axis == 0 else own[:, begin:end])
        if name == "coefficients":
            slices = _of_one_order(slices)
        return slices[0] if len(slices) == 1 else np.concatenate(slices, axis=axis)

    def _ends_of(self, group: str) -> list[Column]:
        """Return where the rows of a ragged group end, by part; the first is 0."""
        if group not in self._ends:
            counts = [part[group]["count"] for part in self._parts]
            self._ends[group] = [np.append(0, np.cumsum(count)) for count in counts]
        return self._ends[group]


def _of_one_order(pieces: Sequence[Column]) -> list[Column]:
    """Add leading zeros up to the highest order that a piece of some motion needs."""
    order = max(map(_order, pieces), default=1)
    found = []
    for own in pieces:
        lacking = max(0, order - len(own))
        raised = np.pad(own, ((lacking, 0), (0, 0), (0, 0))) if lacking else own
        found.append(raised[len(raised) - order :])
    return found


def _order(pieces: Column) -> int:
    """Return the number of coefficients from the highest that is not 0 everywhere."""
    (used,) = np.nonzero(pieces.any(axis=(1, 2)))
    return len(pieces) - int(used[0]) if len(used) else 1


# --- names ---


def groups(keys: Iterable[Key]) -> dict[Key, str]:
    """Return the name of each problem's group; several of one name end with `#` and a digest."""
    known = sorted(set(keys))
    names = [name for name, _ in known]
    return {
        (name, digest): escaped(name) + (f"#{digest[:20]}" if names.count(name) > 1 else "")
        for name, digest in known
    }


def escaped(name: str) -> str:
    """Return the name as a link of HDF5 may be called: odd characters as in URLs, `/` as `%2F`."""
    return _ODD.sub(lambda odd: "".join(f"%{byte:02X}" for byte in odd[0].encode()), name) or "%"
