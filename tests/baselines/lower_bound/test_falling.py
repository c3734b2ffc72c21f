"""Falling velocity limits in lower bounds: rows, proofs, the script that checks them."""

from __future__ import annotations

import io
import json
import runpy
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from work import HANG_S

from baselines.collocation.uniform import Collocation
from baselines.lower_bound import costates
from baselines.lower_bound.bound import prove
from baselines.lower_bound.dual_check import BoundProof, cuts, proved_bound
from baselines.lower_bound.planner import Prove
from baselines.lower_bound.relaxation import Relaxation
from tests.baselines.collocation.test_falling import one_joint, to_rest_near_the_end
from tests.baselines.lower_bound.test_proof import assert_rows_hold, random_cells, variables
from trajopt import InvalidInput, Limits, Problem, Relation, Status, verify
from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import Origin
from trajopt.benchmark.store import trial_text

SCRIPT = Path(__file__).parents[3] / "docs" / "examples" / "best-known" / "check_proof.py"


def two_joints(seed: int, *, jerk: float | None = None, waypoints: int = 3) -> Problem:
    rng = np.random.default_rng(seed)
    low, high = np.array([-2.0, -1.0]), np.array([2.0, 1.5])
    offset, deceleration = rng.uniform(0, 0.4, 2), rng.uniform(1, 12, 2)
    near = offset**2 / (2 * deceleration) + 1e-2
    law = {"offset": offset, "deceleration": deceleration, "position": np.array([low, high]).T}
    limits = Limits([3.0, 2.5], [8.0, 6.0], jerk and [jerk] * 2, falling_velocity=law)
    return Problem(rng.uniform(low + near, high - near, (waypoints, 2)), limits)


@pytest.mark.parametrize(("seed", "jerk"), [(0, None), (1, None), (2, 200.0)])
def test_every_row_holds_for_a_verified_trajectory(seed, jerk):
    problem = two_joints(seed, jerk=jerk)
    trajectory = Collocation(intervals=12).solve(problem).trajectory
    certificate = verify(problem, trajectory)
    assert certificate.feasible
    assert certificate.uses["falling_velocity"].value > 0.9
    relaxation = Relaxation.of(problem, 1.01 * trajectory.duration)
    x = variables(relaxation, problem, trajectory)
    root = relaxation.root_box()
    assert (root.low - 1e-9 <= x).all()
    assert (x <= root.high + 1e-9).all()
    rng = np.random.default_rng(seed)
    for _ in range(400):
        k = int(rng.integers(relaxation.segments))
        j = int(rng.integers(relaxation.joints))
        cells = random_cells(rng, jerky=relaxation.jerky[j], walled=True)
        rates = rng.normal(size=(len(cells), 1)) * rng.choice([0.0, 1.0, 10.0], (len(cells), 1))
        row = cuts(relaxation, [costates.Cut(k, j, np.hstack([cells, rates]))])
        assert_rows_hold(row, x, rtol=1e-9)


def test_cells_without_rates_are_cells_with_rates_of_zero():
    problem = two_joints(0)
    relaxation = Relaxation.of(problem, 5.0)
    cells = random_cells(np.random.default_rng(0), jerky=False, walled=True)
    whole = np.hstack([cells, np.zeros((len(cells), 1))])
    one, other = (costates.row(relaxation, 0, 0, own) for own in (cells, whole))
    assert one[0].tolist() == other[0].tolist()
    assert one[1] == other[1]


@pytest.mark.parametrize("goal", [2.45, -2.7])
def test_the_optimum_along_the_parabola_is_proved(goal):
    problem = one_joint(0.0, goal)
    optimum = to_rest_near_the_end(abs(goal))
    found = prove(problem, within=2e-4, time_limit=HANG_S)
    assert found.status == "proved"
    assert optimum * (1 - 2e-4) <= found.lower_bound <= optimum * (1 + 1e-9)
    assert found.upper_bound >= optimum * (1 - 1e-9)
    assert proved_bound(problem, found.proof) == found.lower_bound


def checked(monkeypatch, problem: Problem, lower_bound: float, proof: BoundProof) -> bool:
    """Return whether the script confirms a bound."""
    motion = Collocation(intervals=4).solve(problem)
    solution = replace(motion, lower_bound=lower_bound, stats=proof.arrays())
    origin = Origin("test", "", "2026-11-26")
    record = records.made(problem, solution, origin, origin)
    text = trial_text.write(record.trial, brief=True)
    monkeypatch.setattr(sys, "stdin", io.StringIO(text.decode()))
    try:
        runpy.run_path(str(SCRIPT), run_name="__main__")
    except SystemExit as end:
        return not end.code
    return False


@pytest.mark.parametrize(
    ("seed", "jerk"), [(0, None), pytest.param(2, 200.0, marks=pytest.mark.long)]
)
def test_the_script_confirms_a_proof_and_no_more(monkeypatch, seed, jerk):
    problem = two_joints(seed, jerk=jerk)
    found = prove(problem, within=2e-2, time_limit=HANG_S)
    assert found.proved_within < 2.01e-2
    assert found.proof.rates.size
    assert checked(monkeypatch, problem, found.lower_bound, found.proof)
    assert not checked(monkeypatch, problem, found.lower_bound * 1.01, found.proof)
    # whatever the rates are, the toolkit proves no more than exact fractions do
    rng = np.random.default_rng(0)
    for size in (1e-9, 1e-3, 1.0):
        rates = found.proof.rates * [1.0, 1.0]
        rates[:, 1] *= 1 + size * rng.normal(size=len(rates))
        forged = replace(found.proof, rates=rates)
        proved = proved_bound(problem, forged)
        assert proved <= found.upper_bound
        assert proved <= 0 or checked(monkeypatch, problem, proved, forged)


def test_a_proof_is_stored_and_read_back_with_its_rates():
    problem = one_joint(0.0, 2.7)
    planner = Prove(within=1e-3, time_limit=HANG_S)
    assert planner.relation(problem) is Relation.SAME
    found = planner.solve(problem)
    assert found.status is Status.SOLVED
    assert planner.stored_bound(problem, found.stats) == found.lower_bound
    # a proof with rates proves nothing of a problem without the limit
    free = problem.without("falling_velocity")
    with pytest.raises(InvalidInput, match="no change of λ"):
        planner.stored_bound(free, found.stats)
    plain = prove(free, time_limit=HANG_S).proof.arrays()
    assert "proof_rates" not in plain


def test_a_waypoint_out_of_reach_is_infeasible_for_the_bound():
    found = Prove().solve(one_joint(0.0, 2.7475, 0.0))
    assert found.status is Status.INFEASIBLE
    assert "waypoint 2 of joint 1" in found.message


def test_a_joint_that_begins_where_nothing_is_allowed_may_leave():
    problem = one_joint(2.748, 0.5, 1.5)
    found = prove(problem, within=2e-4, time_limit=HANG_S)
    assert found.status == "proved"


def test_the_record_s_text_holds_the_limit():
    """The script reads the limit's numbers from the record, and its digest covers them."""
    problem = two_joints(0)
    motion = Collocation(intervals=4).solve(problem)
    origin = Origin("test", "", "2026-11-26")
    record = records.made(problem, replace(motion, lower_bound=0.1), origin, origin)
    said = json.loads(trial_text.write(record.trial, brief=True))
    assert len(said["problem"]["limits"]["falling_velocity"]) == 2


def test_a_bound_of_splines_leaves_the_limit_out_and_says_so():
    problem = one_joint(0.0, 0.5, 2.0, 2.6)
    found = Prove(family="spline353", within=1e-2, time_limit=HANG_S).solve(problem)
    assert "falling velocity limits are left out" in found.message
