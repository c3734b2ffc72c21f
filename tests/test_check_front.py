"""The script that checks a front's bounds with whole numbers only, and what it refuses."""

from __future__ import annotations

import subprocess
import sys
from fractions import Fraction

import numpy as np
import pytest

from baselines.front.bound import prove
from baselines.front.least import least, without_limits
from experiments.fronts import added, as_fractions, checker, stated_problem
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

# Two segments: few simplices.
PROBLEM = Problem([[0.0, 0.0], [0.7, -0.2], [1.0, 0.5]], Limits([1.0, 1.0], [2.0, 2.0]))


def proofs(duration=None):
    found = None if duration is None else least(PROBLEM, "jerk", duration)
    value = without_limits(PROBLEM, "jerk") if found is None else found.value
    times = None if found is None else np.diff(found.trajectory.waypoint_times)
    bound = prove(PROBLEM, 3, duration, value, within=2e-2, deadline=np.inf, times=times)
    kept = []
    exact = added(kept, stated_problem(PROBLEM), bound)
    return value, bound, exact, kept[0]


@pytest.mark.parametrize("duration", [None, 2.4])
def test_whole_numbers_prove_what_floating_point_found(duration):
    value, bound, exact, _ = proofs(duration)
    assert bound.closed
    assert exact == pytest.approx(bound.lower, rel=1e-9)
    assert value * (1 - 2.01e-2) < exact <= value


def test_costates_of_limits_prove_more_than_the_equations():
    _, _, with_limits, proof = proofs(2.2)
    _, _, free, _ = proofs()
    assert proof["costates"]
    assert with_limits > free / 2.2**5 * 1.01


def test_a_search_that_gets_nowhere_ends_with_a_valid_proof(monkeypatch):
    # beside the least duration; without an end it halved simplices to points, which is no proof
    monkeypatch.setattr("baselines.front.bound.SHORTEST_EDGE", 0.05)
    value, bound, exact, _ = proofs(2.0)
    assert not bound.closed
    assert exact == pytest.approx(bound.lower, rel=1e-9)
    assert 0 < exact < 0.98 * value


def test_a_higher_claim_is_not_proved():
    _, bound, _, proof = proofs()
    claim = Fraction(bound.lower) * Fraction(103, 100)
    stated = as_fractions(stated_problem(PROBLEM))
    found = checker().proved(stated, claim, as_fractions(proof))
    assert found < claim * Fraction(999, 1000)


@pytest.mark.parametrize("damage", ["cut", "another waypoint"])
def test_a_damaged_proof_proves_nothing(damage):
    _, bound, _, proof = proofs()
    stated = stated_problem(PROBLEM)
    if damage == "cut":
        proof["steps"] = proof["steps"][:-1]
        with pytest.raises(SystemExit, match="without a bound"):
            checker().proved(as_fractions(stated), Fraction(bound.lower), as_fractions(proof))
        return
    stated["waypoints"][1] = [0.5, 0.2]
    claim = Fraction(bound.lower)
    assert checker().proved(as_fractions(stated), claim, as_fractions(proof)) < claim


def test_it_needs_this_package_for_nothing():
    script = checker().__file__
    done = subprocess.run(
        [sys.executable, "-I", script], input='{"points": []}', capture_output=True, text=True
    )
    assert (done.returncode, done.stderr) == (0, "")
