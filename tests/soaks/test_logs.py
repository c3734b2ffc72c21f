"""No lawful log of the corpus is convicted, most others are found, and one thing has one number."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from soaks import logs


@pytest.mark.long
def test_no_lawful_log_is_convicted_and_most_others_are_found(tmp_path):
    assert logs.main(count=48, seed=5, output=tmp_path) == 0
    counts = pd.read_csv(tmp_path / "logs.csv").set_index("logs of")
    encoders = counts.loc["encoders"]
    assert encoders["lawful"] >= 8
    assert encoders["convicted"] == 0
    assert encoders["of these found"] >= 0.9 * encoders["the oracle finds"] > 0
    assert counts.loc[list(logs.PECULIAR), "convicted"].sum() == 0


@pytest.mark.parametrize("order", [2, 3])
@pytest.mark.parametrize("exceeds", ["", "velocity", "acceleration", "jerk"])
def test_a_motion_uses_what_it_says(order, exceeds):
    """The largest differences of dense samples, against the limits."""
    if exceeds == "jerk" and order == 2:
        return
    for seed in range(4):
        own = logs.motion(np.random.default_rng(seed), order, exceeds)
        t = np.linspace(0, own.duration, 40001)
        q = own(t)
        for name, limit in zip(
            ["velocity", "acceleration", "jerk"][:order], (2, 5, 100), strict=False
        ):
            q = np.diff(q) / t[1]
            used = np.abs(q).max() / limit
            if name == exceeds:
                assert 1.04 < used < 2.02
            elif name != "velocity" and not (exceeds and order == 3):
                assert used < 1.003


def test_a_convicted_lawful_log_fails_the_soak():
    rows = [
        {"number": i, "kind": "encoder", "exceeds": "", "verdict": "broken", "oracle": None}
        | {"differs": "", "noise": 0.0, "rate": 50, "form": "%r", "velocities": ""}
        for i in range(3)
    ]
    frame = pd.DataFrame(rows)
    assert any("3 of 3 convicted" in own for own in logs.failures(logs.table(frame), frame))


def test_a_number_that_differs_is_said():
    own = logs.case(np.random.default_rng(2), "exact")
    while not own.exceeds:
        own = logs.case(np.random.default_rng(int(own.log.times[-1] * 1e9)), "exact")
    found = logs.evidence(own.log, own.limits)
    assert found.conviction is not None
    assert logs.numbers_differ(found) == ""
    other = replace(found, convictions=[replace(found.conviction, at_least=58.6)])
    assert "58.6" in logs.numbers_differ(other)
