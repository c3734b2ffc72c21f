"""The better of what was computed and what is recorded, checked before it counts."""

from dataclasses import replace

import numpy as np
import pytest

from trajopt import Limits, Problem, Solution, Status, Trajectory
from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import CLOSED_FORM, Origin, made
from trajopt.benchmark.best_known.surveyed import with_record
from trajopt.explain.verdicts import Known

# 1 rad at 1 rad/s² from rest to rest: 2 s, bang-bang.
PROBLEM = Problem([[0.0], [1.0]], Limits([5.0], [1.0]))
OPTIMUM = 2.0
MOTION = Origin("bang-bang", "0.1.0", "2026-11-22")
BOUND = Origin(CLOSED_FORM, "0.1.0", "2026-11-22")


def bang_bang():
    halves = [[0.5, -0.5], [0.0, 1.0], [0.0, 0.5]]
    return Trajectory(np.array([0.0, 1.0, 2.0]), np.array(halves)[:, :, None], np.array([0.0, 2.0]))


def written(folder, *, lower_bound=OPTIMUM, origin=BOUND):
    solution = Solution(Status.SOLVED, bang_bang(), lower_bound=lower_bound)
    records.write(made(PROBLEM, solution, MOTION, origin), folder)
    return folder


def computed(best=2.5, lower_bound=1.5):
    return Known(PROBLEM, best, "exact", lower_bound, "prove", 2.5, {})


def test_what_is_recorded_and_better_counts_and_is_named(tmp_path):
    known = with_record(computed(), written(tmp_path))
    assert known.best == pytest.approx(OPTIMUM, rel=1e-9)
    assert known.best_by == "recorded: bang-bang 0.1.0, 2026-11-22"
    assert known.trajectory.duration == known.best
    assert known.lower_bound == pytest.approx(OPTIMUM, rel=1e-9)
    assert known.bound_by == "recorded: closed form 0.1.0, 2026-11-22, checked again"
    assert known.proved


def test_without_an_answer_the_recorded_one_is_the_best(tmp_path):
    known = with_record(computed(best=None), written(tmp_path))
    assert known.best == pytest.approx(OPTIMUM, rel=1e-9)


def test_what_was_computed_stays_where_it_is_as_good(tmp_path):
    both = computed(best=OPTIMUM, lower_bound=OPTIMUM)
    assert with_record(both, written(tmp_path)) is both
    assert records.find(PROBLEM, tmp_path) is not None
    elsewhere = replace(both, problem=Problem([[0.0], [2.0]], PROBLEM.limits))
    assert with_record(elsewhere, tmp_path) is elsewhere


def test_a_recorded_bound_counts_for_what_its_proof_proves(tmp_path):
    boasting = written(tmp_path, lower_bound=2.4)
    assert with_record(computed(), boasting).lower_bound == pytest.approx(OPTIMUM, rel=1e-9)


def test_a_recorded_bound_without_a_proof_counts_in_closed_form(tmp_path):
    by_prove = Origin("prove", "0.1.0", "2026-11-22")
    unproved = written(tmp_path, lower_bound=2.4, origin=by_prove)
    assert with_record(computed(), unproved).lower_bound == pytest.approx(OPTIMUM, rel=1e-9)
