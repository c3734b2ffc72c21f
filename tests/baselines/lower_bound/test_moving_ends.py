"""Lower bounds of motions that begin or end in motion, against closed forms and Ruckig's optima."""

from __future__ import annotations

import json
import subprocess
import sys
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from work import HANG_S

from baselines.lower_bound import dual_check
from baselines.lower_bound.bound import prove
from baselines.lower_bound.branching import branch_and_bound
from baselines.lower_bound.planner import Prove
from baselines.ruckig_ import RuckigStop
from soaks.moving_ends import drawn, optimum
from trajopt import Limits, Problem, Status
from trajopt.benchmark.store.document import pack, problem_table
from trajopt.core.exceptions import InvalidInput

WITHIN = 1e-4
SCRIPT = Path(__file__).parents[3] / "docs" / "examples" / "best-known" / "check_proof.py"


def bound_of(problem, target, looks=10**6):
    """The bound of a search that is asked about motions up to a target, s.

    It ends when it has looked at its clock so many times.
    """
    left = count(looks, -1)
    return branch_and_bound(problem, target, WITHIN, lambda: next(left) < 0)


@pytest.mark.parametrize("jerk", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_the_bound_of_two_waypoints_is_ruckigs_optimum(seed, jerk):
    problem = drawn(2 * seed + jerk, joints=2, jerk=jerk)
    shortest = optimum(problem).duration
    found = bound_of(problem, shortest / (1 + WITHIN))
    assert 1 - 2 * WITHIN < found.lower_bound / shortest <= 1


@pytest.mark.parametrize("seed", range(3))
def test_through_waypoints_upper_and_lower_bound_meet(seed):
    bound = prove(drawn(seed, waypoints=4, joints=2, jerk=False), time_limit=HANG_S)
    assert bound.status == "proved"
    assert bound.proved_within <= WITHIN * (1 + 1e-9)


def test_the_bound_sees_through_a_gap():
    """Asked about a motion that passes after the gap, it stops at the one before it.

    One joint of 1 rad/s² at 1 rad/s passes 0.2 rad after 1 − √0.6 s, or from 1 + √0.6 s on, and is
    to stop at 1 rad: `p = √(1 + 1/2)` and T = 2 p − 1 in one go.
    """
    problem = Problem([[0.0], [0.2], [1.0]], Limits([9.0], [1.0]), start_velocity=[1.0])
    best = 2 * np.sqrt(1.5) - 1
    found = bound_of(problem, 1.75 * best, looks=100)
    assert 1 - 1e-3 < found.lower_bound / best <= 1


def test_a_proof_is_of_its_own_ends():
    problem = drawn(0, joints=2, jerk=False)
    solution = Prove().solve(problem)
    assert solution.status is Status.SOLVED
    again = Prove().stored_bound(problem, solution.stats)
    assert again == pytest.approx(solution.lower_bound, rel=1e-12)
    proof = dual_check.BoundProof.stored(solution.stats)
    faster = {key: 1.3 * own for key, own in problem.demands.items()}
    other = Problem(problem.waypoints, problem.limits, demands=faster)
    try:  # rows of costates are valid for any ends: what they prove of these is no more than true
        proved = dual_check.proved_bound(other, proof)
    except InvalidInput:
        return
    assert proved <= optimum(other).duration


def checked(problem, bound, stats):
    """What the script in exact fractions says of a proof."""
    said = {"problem": problem_table(problem), "solution": {"lower_bound": bound, "stats": stats}}
    return subprocess.run(
        [sys.executable, "-I", SCRIPT], input=json.dumps(said), text=True, capture_output=True
    )


@pytest.mark.parametrize("seed", [2, 7])
def test_exact_fractions_prove_the_same(seed):
    """Two joints, three waypoints; two joints under jerk limits that begin and end accelerating."""
    problem = drawn(seed, waypoints=2 + (seed == 2), joints=2, jerk=seed == 7)
    solution = Prove().solve(problem)
    stats = {key: pack(own) for key, own in solution.stats.items() if key.startswith("proof_")}
    ran = checked(problem, solution.lower_bound, stats)
    assert ran.returncode == 0, ran.stderr
    assert checked(problem, 1.001 * solution.lower_bound, stats).returncode == 1
    slower = {key: 0.5 * own for key, own in problem.demands.items()}
    other = Problem(problem.waypoints, problem.limits, demands=slower)
    shortest = RuckigStop().solve(other).trajectory.duration
    ran = checked(other, shortest * (1 + 1e-6), stats)
    assert ran.returncode == 1  # never more than a motion takes
