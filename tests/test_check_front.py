"""The script that checks a front's bounds in exact fractions, and what it refuses."""

from __future__ import annotations

import ast
import copy
import io
import json
import shutil
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from baselines.front.bound import prove
from baselines.front.least import least, without_limits
from experiments.fronts import added, stated_problem
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.judging import check_front, check_proof
from trajopt.judging.check_proof import NoProof

EXAMPLES = Path(__file__).parents[1] / "docs" / "examples" / "best-known"
# Two segments: few simplices.
PROBLEM = Problem([[0.0, 0.0], [0.7, -0.2], [1.0, 0.5]], Limits([1.0, 1.0], [2.0, 2.0]))


def proofs(duration=None, within=2e-2):
    found = None if duration is None else least(PROBLEM, "jerk", duration)
    value = without_limits(PROBLEM, "jerk") if found is None else found.value
    times = None if found is None else np.diff(found.trajectory.waypoint_times)
    bound = prove(PROBLEM, 3, duration, value, within=within, deadline=np.inf, times=times)
    kept = []
    exact = added(kept, PROBLEM, bound)
    return value, bound, exact, kept[0]


def checked(claim, proof, said=None):
    """Return what the script proves, after a file has been written and read."""
    stated = check_proof.read(json.dumps([said or stated_problem(PROBLEM), proof]))
    return check_front.proved(stated[0], Fraction(claim), stated[1])


@pytest.mark.parametrize("duration", [None, 2.4])
def test_fractions_prove_what_floating_point_found(duration):
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
    assert checked(bound.lower * 1.03, proof) < bound.lower * 1.03 * 0.999


def test_no_proof_is_of_another_problem():
    _, bound, _, proof = proofs()
    stated = stated_problem(PROBLEM)
    stated["waypoints"][1] = [0.5, 0.2]
    with pytest.raises(NoProof, match="digest"):
        checked(bound.lower, proof, stated)
    stated["digest"] = check_proof.digest(check_proof.read(json.dumps(stated)))
    assert checked(bound.lower, proof, stated) < bound.lower
    with pytest.raises(NoProof, match="a demand is end_velocity"):
        checked(bound.lower, proof, stated_problem(PROBLEM) | {"end_velocity": [1.0, 0.0]})


def replaced(table, at, row):
    def mutated(proof):
        proof[table][at] = row

    return mutated


@pytest.mark.parametrize(
    ("reason", "mutated"),
    [
        # it would be at rest at the second one
        ("waypoints", lambda proof: proof.update(kept=[0.0, 1.0], costates=[])),
        ("waypoints", lambda proof: proof["kept"].reverse()),
        ("order", replaced("order", 0, 4.0)),
        ("duration", replaced("duration", 0, -2.4)),
        ("shortest", replaced("shortest", 0, 1.5)),
        ("shortest", replaced("shortest", 0, -0.5)),
        ("shortest", lambda proof: proof["shortest"].pop()),
        ("limits", replaced("limits", 0, [1.0, 2.0, 0.0, 0.5])),
        ("limits", replaced("limits", 0, [1.0, 0.0, 0.5, 0.25])),
        # no 32nds: cut to one instant it would be the limit of another derivative
        ("limits", replaced("limits", 0, [1.0, 0.0, 0.001, 0.002])),
        ("limits", replaced("limits", 0, [0.0, 0.0, 0.0, 0.5])),  # a mean of positions
        ("costates", replaced("costates", 0, [0.0, 999.0, 0.0, 1.0, 1.0])),
        ("costates", replaced("costates", 0, [0.0, 0.0, 0.0, 1.0])),
        ("steps", lambda proof: proof["steps"].pop()),
        ("steps", lambda proof: proof["steps"].append([-1.0, -1.0])),
        ("steps", replaced("steps", 0, [0.0, 0.0])),
        ("steps", replaced("steps", 0, [0.0, 2.0])),
        ("a table", lambda proof: proof.update(more=[])),
        ("steps", lambda proof: proof.pop("steps")),
    ],
)
def test_a_part_that_is_wrong_is_named(proof_with_limits, reason, mutated):
    _, proof = copy.deepcopy(proof_with_limits)
    mutated(proof)
    with pytest.raises(NoProof, match=f"^{reason}"):
        checked(1.0, proof)


@pytest.mark.parametrize(("measure", "code"), [("jerk", 0), ("acceleration", 1), ("snap", 1)])
def test_a_proof_is_of_the_measure_that_the_record_states(
    proof_with_limits, measure, code, monkeypatch
):
    _, proof = proof_with_limits
    duration = proof["duration"][0]
    record = {
        "problem": stated_problem(PROBLEM),
        "measure": measure,
        "points": [{"duration": duration, "lower": 1.0, "proof": 0}],
        "proofs": [proof],
    }
    monkeypatch.setattr("sys.stdin", io.StringIO(json.dumps(record)))
    with pytest.raises(SystemExit) as ended:
        check_front.main()
    assert bool(ended.value.code) == bool(code)


@pytest.fixture(scope="module")
def proof_with_limits():
    value, _, _, proof = proofs(2.2, within=5e-2)
    assert proof["costates"]
    return value, proof


def test_no_mutant_of_any_row_proves_more_than_a_motion_has(proof_with_limits):
    value, proof = proof_with_limits
    refused = 0
    for table, rows in proof.items():
        for at in range(0, len(rows), max(1, len(rows) // 8)):
            for change in (lambda x: 2 * x, lambda x: 0.9 * x, lambda x: -x, lambda x: x + 1):
                mutant = copy.deepcopy(proof)
                row = rows[at]
                mutant[table][at] = list(map(change, row)) if isinstance(row, list) else change(row)
                try:
                    assert checked(1.001 * value, mutant) <= value, (table, at)
                except NoProof:
                    refused += 1
    assert refused > 40


def test_it_imports_the_standard_library_and_the_kernel_only():
    nodes = list(ast.walk(ast.parse((EXAMPLES / "check_front.py").read_text(encoding="utf-8"))))
    modules = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    modules += [name.name for node in nodes if isinstance(node, ast.Import) for name in node.names]
    assert {*modules} - sys.stdlib_module_names - {"collections.abc"} == {
        "trajopt.judging",
        "check_proof",
    }


def test_it_runs_beside_the_kernel_where_nothing_else_of_ours_is(tmp_path):
    for name in ("check_proof.py", "check_front.py"):
        shutil.copy(EXAMPLES / name, tmp_path)
    done = subprocess.run(
        [sys.executable, "-E", "-s", "-S", tmp_path / "check_front.py"],
        input='{"points": []}',
        capture_output=True,
        text=True,
    )
    assert (done.returncode, done.stderr) == (0, "")


def test_a_bound_for_every_duration_uses_no_limits():
    # limits rule out 1 s: by those costates anything would be proved, of slow motions too
    _, bound, _, proof = proofs(2.2)
    assert proof["limits"]
    mutant = {**copy.deepcopy(proof), "duration": [0], "shortest": [0, 0]}
    with pytest.raises(NoProof, match="limits"):
        checked(bound.lower * 2.2**5, mutant)
