"""Read me first: a proved lower bound on the minimum time, and the check of its proof."""

from __future__ import annotations

from dataclasses import replace

import pytest

from baselines.lower_bound.bound import prove
from baselines.lower_bound.dual_check import proved_bound
from trajopt import Limits, Problem

# 1.5 rad at most 1 rad/s and 2 rad/s²: the trapezoid takes 1.5/1 + 1/2 = 2 s
PROBLEM = Problem([[0.0], [1.5]], Limits([1.0], [2.0]))


def test_a_bound_has_two_ends() -> None:
    bound = prove(PROBLEM, within=1e-4)
    assert bound.status == "proved"
    assert bound.lower_bound <= 2.0 <= bound.upper_bound * (1 + 1e-9)
    assert bound.proved_within <= 1e-4 * (1 + 1e-6)


def test_the_proof_needs_no_solver() -> None:
    bound = prove(PROBLEM, within=1e-4)
    assert proved_bound(PROBLEM, bound.proof) == bound.lower_bound


def test_any_multipliers_prove_some_bound_and_never_a_false_one() -> None:
    proof = prove(PROBLEM, within=1e-4).proof
    for factor in (0.0, 0.5, 1.5):
        multipliers = proof.multipliers.copy()
        multipliers[:, 1] *= factor
        changed = replace(proof, multipliers=multipliers)
        assert proved_bound(PROBLEM, changed) <= 2.0


def test_the_best_353_spline_has_a_bound_of_its_own() -> None:
    problem = Problem([[0.0], [0.4], [1.0], [1.5]], Limits([1.0], [2.0]))
    spline = prove(problem, "spline353", within=1e-3)
    every = prove(problem, within=1e-3)
    assert every.upper_bound == pytest.approx(2.0, rel=1e-6)
    assert spline.lower_bound > every.upper_bound
