"""The recorded fronts: their motions keep every limit and have the recorded integrals."""

from __future__ import annotations

import io
import json
from pathlib import Path

import numpy as np
import pytest

from trajopt.benchmark.suites.catalogue import load
from trajopt.core.trajectory import Trajectory
from trajopt.judging import check_front
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


def test_recorded_proofs_hold_in_fractions(monkeypatch, capsys):
    """The other records take half a minute together: the script checks any of them."""
    path = next(path for path in RECORDS if path.stem == "random-zigzag-j3-w3-11")
    monkeypatch.setattr("sys.stdin", io.StringIO(path.read_text(encoding="utf-8")))
    with pytest.raises(SystemExit) as ended:
        check_front.main()
    assert not ended.value.code
    assert capsys.readouterr().out.count(": holds") == 4
