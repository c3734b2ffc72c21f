"""The check of bounds of 3-5-3 splines: its rows are the spline's derivatives, its boxes hold."""

from __future__ import annotations

import copy
from fractions import Fraction

import numpy as np
import pytest

from baselines.lower_bound import ratio_boxes
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.judging import check_proof, check_spline353
from trajopt.judging.check_proof import NoProof
from trajopt.judging.proved_bounds import exact, stated
from trajopt.planners import spline353

WAYPOINTS = [[0.0, 0.5], [0.7, -0.2], [0.9, -0.9], [1.6, 0.3]]
LIMITS = Limits(
    [[-1.0, 2.0], [-1.5, 1.0]],
    [[-4.0, 3.0], [-5.0, 6.0]],
    [[-40.0, 50.0], [-60.0, 30.0]],
    [[-1.0, 2.0], [-1.1, 1.0]],
)
PROBLEM = Problem(WAYPOINTS, LIMITS)
KEYS = ("position", "velocity", "acceleration", "jerk", "jerk", "jerk")


@pytest.mark.parametrize("kind", range(6))
@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_row_is_a_derivative_of_the_spline_less_its_limit(kind, side, joint):
    """Of any segment times: times the middle one to the power of its order."""
    times, instant = np.array([0.7, 0.4, 0.9]), 0.375
    motion = spline353.trajectory(PROBLEM, times)
    order = min(kind, 3)
    at = {4: 0.0, 5: times.sum()}.get(kind, times[0] + instant * times[1])
    value = motion(at, order)[joint]
    limit = getattr(LIMITS, KEYS[kind])[joint, side]
    beyond = (-1, 1)[side] * (value - limit) * times[1] ** order
    problem = check_proof.stated(stated(PROBLEM))
    (row,) = check_spline353.rows_of(problem, exact([[kind, joint, side, instant]]))
    point = times[1] / times[0], times[1] / times[2]
    total = times.sum()
    whole = check_spline353.SplineRows([row], Fraction(total))
    assert float(whole.least(row, (point[0], point[0], point[1], point[1]))) == pytest.approx(
        beyond, rel=1e-12, abs=1e-12
    )


def test_the_least_of_a_box_is_below_every_point_of_it():
    rng = np.random.default_rng(0)
    problem = check_proof.stated(stated(PROBLEM))
    for _ in range(100):
        kind, joint, side = (int(rng.integers(n)) for n in (6, 2, 2))
        (row,) = check_spline353.rows_of(problem, exact([[kind, joint, side, rng.random()]]))
        search = check_spline353.SplineRows([row], Fraction(rng.uniform(0.5, 5)))
        corner, size = np.exp(rng.uniform(-2, 2, 2)), np.exp(rng.uniform(-6, 1))
        ends = np.array([corner, corner * (1 + size)]).T
        least = search.least(row, tuple(ends.ravel().tolist()))
        for first, last in rng.uniform(*ends.T, (20, 2)).tolist():
            assert least <= search.least(row, (first, first, last, last))


@pytest.fixture(scope="module")
def proof():
    return ratio_boxes.best_spline(load("reversal"), 1e-3, lambda: False)


def test_no_mutant_of_any_row_or_step_proves_more_than_the_best_spline_has(proof):
    said = stated(load("reversal"))
    tables = {name: exact(own.tolist()) for name, own in vars(proof.proof).items()}
    assert check_spline353.proved(said, tables) == tables["cutoff"][0]
    tables["cutoff"] = [Fraction(1.0001 * proof.times.sum())]
    rng = np.random.default_rng(0)
    for name in ("rows", "steps"):
        for at in rng.integers(len(tables[name]), size=30):
            mutant = copy.deepcopy(tables)
            if name == "rows":
                mutant[name][at] = exact([*map(int, rng.integers((6, 3, 2))), rng.random()])
            else:
                mutant[name][at] = Fraction(int(rng.integers(2 + len(tables["rows"]))))
            with pytest.raises(NoProof):
                check_spline353.proved(said, mutant)


@pytest.mark.parametrize(
    ("change", "part"),
    [
        (lambda said: said | {"tolerance": exact([[0.1]] * 4)}, "a demand"),
        (lambda said: said | {"waypoints": said["waypoints"][:3]}, "digest"),
    ],
)
def test_a_proof_of_another_problem_is_refused(proof, change, part):
    tables = {name: exact(own.tolist()) for name, own in vars(proof.proof).items()}
    with pytest.raises(NoProof, match=part):
        check_spline353.proved(change(stated(load("reversal"))), tables)
