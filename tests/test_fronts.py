"""The recorded fronts: their motions keep every limit and have the recorded integrals."""

from __future__ import annotations

import json
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from experiments.fronts import as_fractions, checker
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.trajectory import Trajectory
from trajopt.judging.smoothness import smoothness
from trajopt.judging.verification import verify

RECORDS = sorted((Path(__file__).parents[1] / "data" / "fronts").glob("*.json"))


@pytest.mark.parametrize("path", RECORDS, ids=lambda path: path.stem)
def test_the_motions_of_a_record_are_what_it_says(path):
    record = json.loads(path.read_text(encoding="utf-8"))
    problem, _ = load(record["problem"]["name"]).merged()
    assert problem.digest() == record["problem"]["digest"]
    for point in record["points"]:
        motion = Trajectory(**{name: np.array(own) for name, own in point["trajectory"].items()})
        certificate = verify(problem, motion)
        assert certificate.feasible
        assert certificate.certified_duration == pytest.approx(point["duration"], rel=1e-9)
        found = smoothness(problem, motion).jerk_integral
        assert found == pytest.approx(point["value"], rel=1e-6)
        assert 0 < point["lower"] <= point["value"]


def test_a_recorded_proof_holds_in_whole_numbers():
    """The others take minutes: the script checks any record."""
    path = next(path for path in RECORDS if path.stem == "one-joint")
    record = json.loads(path.read_text(encoding="utf-8"))
    point = record["points"][-1]
    proof = record["proofs"][point["proof"]]
    assert proof["duration"] == [0.0]  # of 1 s without limits
    claim = Fraction(point["lower"]) * Fraction(point["duration"]) ** 5
    stated = as_fractions(record["problem"])
    assert checker().proved(stated, claim, as_fractions(proof)) >= claim * (1 - Fraction(1, 10**9))
