"""A record of a problem is the reference of a comparison where it is shorter."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt import Limits, Problem, Relation, Solution, Status, Trajectory
from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import Origin, made
from trajopt.benchmark.trial import trials_of
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.views import table_cells
from trajopt.views.analysis.gap_reference import improvements
from trajopt.views.results import Results

PROBLEM = Problem([[0.0], [1.0]], Limits([10.0], [100.0]), "one")


class Fixed(Planner):
    """A quintic of a given duration, or only a bound."""

    def __init__(self, duration, bound=None):
        self.duration = duration
        self.bound = bound

    def options(self):
        return {"duration": self.duration}

    def relation(self, problem):
        return Relation.RESTRICTION

    def unsupported(self, problem):
        return None

    def solve(self, problem, *, seed=0):
        t = self.duration
        if t is None:
            return Solution(Status.FAILED, message="gave up", lower_bound=self.bound)
        c = [6 / t**5, -15 / t**4, 10 / t**3, 0, 0, 0]
        trajectory = Trajectory([0, t], np.reshape(c, (6, 1, 1)), [0, t])
        return Solution(Status.SOLVED, trajectory, lower_bound=self.bound)


def run(name, duration, bound=None):
    return trials_of(Fixed(duration, bound), PROBLEM, [0], name)


@pytest.fixture
def recorded(monkeypatch):
    """A registry in which the toy problem's best known motion takes 1.4 s, proved to 1.3 s."""

    def known(duration, bound, *, proves=True):
        by = Origin("theirs", "1.0", "2026-11-22")
        record = made(PROBLEM, Fixed(duration, bound).solve(PROBLEM), by, by)
        own = {PROBLEM.digest(): record}
        monkeypatch.setattr(records, "find", lambda problem: own.get(problem.digest()))
        monkeypatch.setattr(records, "bound", lambda problem: bound if proves else None)

    return known


def test_a_record_is_the_reference_only_where_it_is_better_than_what_was_computed(recorded):
    recorded(1.4, 1.3)
    results = Results([*run("exact", 1.5), *run("mine", 2.8)])
    duration, kind, proved, by, proof = results.references().iloc[0].tolist()
    assert (duration, kind, proved) == (1.4, "best known", 1.3)
    assert by == proof == "theirs 1.0, 2026-11-22"
    assert results.gaps()["gap"].tolist() == pytest.approx([1.5 / 1.4 - 1, 1.0])
    same = Results([*run("exact", 1.4), *run("mine", 2.8)])
    assert same.references().iloc[0].tolist()[:2] == [1.4, "exact"]
    bound = Results([*run("exact", None, bound=1.2), *run("mine", 2.8)])
    assert bound.references().iloc[0].tolist()[:2] == [1.4, "best known"]


def test_a_record_needs_no_computed_reference(recorded):
    recorded(1.4, 1.3)
    assert Results(run("mine", 2.8)).gaps()["gap"].tolist() == pytest.approx([1.0])


def test_the_higher_of_two_proofs_counts(recorded):
    recorded(1.5, 1.3)
    lower = Results([*run("exact", 1.5), *run("prove", None, bound=1.2)])
    assert lower.references().iloc[0].tolist()[2:] == [1.3, "", "theirs 1.0, 2026-11-22"]
    higher = Results([*run("exact", 1.5), *run("prove", None, bound=1.4)])
    assert higher.references().iloc[0].tolist()[2:] == [1.4, "", ""]


def test_a_recorded_bound_that_nothing_proves_is_none(recorded):
    recorded(1.5, 1.3, proves=False)
    found = Results(run("mine", 2.8)).references().iloc[0]
    assert np.isnan(found["proved"])
    assert found["recorded_proof"] == ""


def test_an_answer_below_the_record_is_an_improvement_once(recorded):
    recorded(1.5, 1.3)
    trials = [*run("exact", 1.5), *run("mine", 1.45), *run("other", 1.48)]
    assert [trial.planner for trial in improvements(trials)] == ["mine"]
    assert improvements(run("exact", 1.5 * (1 - 1e-7))) == []
    recorded(1.4, 1.3)
    assert improvements(trials) == []


def test_a_bound_in_closed_form_counts_where_it_closes_the_problem():
    """1 rad at 10 rad/s and 100 rad/s² takes 2 √(1/100) = 0.2 s, and the bound 2e-13 s less."""
    fast = trials_of(load("exact"), PROBLEM, [0], "exact")
    [row] = Results(fast).references().itertuples()
    assert (row.reference, row.proved) == pytest.approx((0.2, 0.2), rel=1e-6)
    assert "proved within 0.000 % (lower bound 0.199999 s)" in table_cells.reference(row)
    assert np.isnan(Results(run("exact", 1.4)).references()["proved"]).all()
