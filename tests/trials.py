"""A problem, a planner and a trial that use all there is to store; shared by the store's tests."""

import json
from dataclasses import dataclass, fields, replace

import h5py
import numpy as np

from trajopt import Limits, Problem, Relation, Solution, Status, Trajectory
from trajopt.benchmark.store import results_file
from trajopt.benchmark.store.trial_text import sealed
from trajopt.benchmark.trial import trials_of
from trajopt.planners.planner import Planner

PROBLEM = Problem(
    [[0.0, 0.3], [1.0, -0.2], [1.0, -0.2], [0.4, 0.1]],
    Limits([1.0, [-2.0, 1.5]], [2.0, [-3.0, 4.0]], position=[[-2.0, 2.5], [-np.inf, np.inf]]),
    "Gelenk-Prüfung ①",
    "made up",
)


@dataclass(frozen=True)
class Stopping(Planner):
    """A quintic from rest to rest in each segment: peaks 15/8 h/T and 10/√3 h/T²."""

    segment_time: float = 3.0
    note: str = ""

    def relation(self, problem):
        return Relation.RESTRICTION

    def unsupported(self, problem):
        return None

    def solve(self, problem, *, seed=0):
        h, n = problem.displacements, problem.segments
        c = np.zeros((6, n, problem.joints))
        for row, factor in ((0, 6), (1, -15), (2, 10)):
            c[row] = factor * h / self.segment_time ** (5 - row)
        c[5] = problem.waypoints[:-1]
        breaks = self.segment_time * np.arange(n + 1)
        return Solution(
            Status.SOLVED,
            Trajectory(breaks, c, breaks),
            message=self.note,
            lower_bound=0.25,
            evaluations=7,
            history=np.array([[1.0, np.nan], [4.0, 1.5 * breaks[-1]], [7.0, breaks[-1]]]),
            setup_time=0.0,
            stats={"kind": "quintic", "a/b": 1.5, "list": ["x", "ü"], "times": np.arange(3.0)},
        )


def solved():
    """Claimed in 1.5 s, which is too fast: the verifier dilates it."""
    return trials_of(Stopping(0.5), PROBLEM, [3], "stopping")[0]


def edited(path, change):
    """A `results.h5` that was changed, sealed again as a forger would."""
    seal = len(results_file.seal(b""))
    path.write_bytes(path.read_bytes()[:-seal])
    with h5py.File(path, "r+") as file:
        change(file)
    content = path.read_bytes()
    path.write_bytes(content + results_file.seal(content))
    return path


def forged(text, change):
    """A trial's text whose JSON was changed, sealed again as a forger would."""
    table = json.loads(text)
    change(table)
    del table["schema"], table["sha256"]
    return sealed(table)


def assert_same(a, b):
    """Equal in every field, and in every field of their fields."""
    assert type(a) is type(b)
    for field in fields(a):
        if field.name in ("motion", "judged"):
            continue  # no text states them
        x = getattr(a, field.name)
        y = getattr(b, field.name)
        if field.name in ("problem", "limits", "solution", "trajectory") and x:
            assert_same(x, y)
        elif field.name == "stats":
            assert x.keys() == y.keys()
            for key in x:
                assert type(x[key]) is type(y[key]), key
                np.testing.assert_array_equal(x[key], y[key], err_msg=key)
        elif isinstance(x, np.ndarray):
            np.testing.assert_array_equal(x, y, err_msg=field.name)
        else:
            assert x == y, field.name


def as_runs(trials, label="mine"):
    """Trials as the runs of one version of one planner, a seed each."""
    same = {"planner": label, "label": label, "options": {}}
    runs = []
    for seed, trial in enumerate(trials):
        provenance = trial.provenance | {"planner_digest": "one version"}
        runs.append(replace(trial, seed=seed, provenance=provenance, **same))
    return runs
