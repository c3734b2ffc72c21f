"""The lower bound where limits differ from segment to segment, and its proof."""

from __future__ import annotations

import io
import json
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
from work import HANG_S

from baselines.exact.acceleration.planner import Exact
from baselines.lower_bound.planner import Prove
from trajopt import Limits, Problem
from trajopt.benchmark.store.document import problem_table
from trajopt.core.exceptions import InvalidInput
from trajopt.planners.rest_to_rest import end_to_end_bound

SCRIPT = Path(__file__).parents[3] / "docs" / "examples" / "best-known" / "check_proof.py"


def drawn(seed, repeated=False):
    rng = np.random.default_rng([51, seed])
    segments, joints = 3, 2
    waypoints = np.cumsum(rng.normal(0, 1, (segments + 1, joints)), axis=0)
    pairs = [
        [-1, 1] * rng.uniform(low, high, (segments, joints))[..., None]
        for low, high in ((0.3, 2), (0.5, 6))
    ]
    if repeated:
        waypoints = np.insert(waypoints, 1, waypoints[1], axis=0)
        pairs = [np.insert(own, 1, 9 * own[0], axis=0) for own in pairs]
    return Problem(waypoints, Limits(*pairs))


def stated(problem, stats, bound):
    """The text that the script reads."""
    proof = {
        name: {"$array": value.tolist()}
        for name, value in stats.items()
        if name.startswith("proof_")
    }
    answer = {"lower_bound": bound, "stats": proof}
    return json.dumps({"problem": problem_table(problem), "solution": answer})


@pytest.fixture
def checked(monkeypatch, capsys):
    def run(text):
        monkeypatch.setattr(sys, "stdin", io.StringIO(text))
        with pytest.raises(SystemExit) as end:
            runpy.run_path(str(SCRIPT), run_name="__main__")
        capsys.readouterr()
        return end.value.code

    return run


@pytest.mark.parametrize(("seed", "repeated"), [(0, False), (1, True)])
def test_the_optimum_is_proved_and_the_script_believes_no_more(checked, seed, repeated):
    problem = drawn(seed, repeated)
    planner = Prove(within=1e-3, time_limit=HANG_S)
    found = planner.solve(problem)
    optimum = Exact().solve(problem).trajectory.duration
    assert optimum / (1 + 1e-3) <= found.lower_bound <= optimum * (1 + 1e-12)
    assert planner.stored_bound(problem, found.stats) == found.lower_bound
    assert not checked(stated(problem, found.stats, found.lower_bound))
    assert checked(stated(problem, found.stats, optimum * (1 + 1e-6)))
    # the same proof says nothing of tighter limits elsewhere, nor of the widest everywhere
    widest = Problem(problem.waypoints, problem.limits.in_all_segments(tightest=False))
    with pytest.raises(InvalidInput):
        planner.stored_bound(widest, found.stats | {"proof_units": found.stats["proof_units"][:1]})
    assert planner.stored_bound(widest, found.stats) < found.lower_bound


def test_a_bound_in_closed_form(checked):
    velocity = [[[-2, 2]], [[-0.5, 0.5]], [[-1, 1]]]
    problem = Problem([[0.0], [1.0], [2.0], [4.0]], Limits(velocity, [100.0]))
    bound = end_to_end_bound(problem)
    assert bound == pytest.approx(0.5 + 2 + 2, rel=1e-9)
    assert not checked(stated(problem, {}, bound))
    assert checked(stated(problem, {}, bound * (1 + 1e-9)))
    assert Exact().solve(problem).trajectory.duration >= bound


def test_a_family_of_splines_has_constant_limits():
    problem = Problem([[0.0], [1.0], [2.0], [4.0]], Limits([[[-1, 1]], [[-2, 2]], [[-1, 1]]], [9]))
    assert "the same in all segments" in Prove(family="spline353").unsupported(problem)
