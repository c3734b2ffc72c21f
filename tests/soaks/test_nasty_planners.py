"""Planners that mean harm, or have an accident, do none: a row of each kind of the experiment."""

from __future__ import annotations

import sys

import pandas as pd
import pytest

from soaks import nasty_planners
from trajopt.benchmark.run import runner

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="judges and subreapers")

STOPS = "stops its judge"
# status in the table
CHOSEN = {
    "patches the verifier of trials": "solved",
    "loosens the limits of every problem in memory": "solved",
    "patches np.abs": "solved",
    "sends pickles that execute": "crashed",
    "unpickles into a bomb": "solved",
    "counts 10**30 evaluations": "crashed",
    "ends its process with code 0": "crashed",
    "kills its judge": "crashed",
    STOPS: "crashed",
    "leaves a daemon": "solved",
    "leaves a daemon and dies": "crashed",
    "takes a GiB in eight processes": "crashed",
    "prints escape sequences on the descriptor and dies": "crashed",
    "changes the working folder": "solved",
    "removes the results folder": "solved",
}


def test_what_planners_do_changes_neither_their_certificates_nor_others_rows(
    monkeypatch: pytest.MonkeyPatch,
):
    monkeypatch.setattr(nasty_planners, "TIMEOUT", 20.0)  # none of these hangs
    # A run waits for a judge as long as its trials may take: here 5 s for the one that is stopped.
    patience = runner._patience
    monkeypatch.setattr(runner, "_END_TIMEOUT_S", 3.0)  # then it is left to the server
    monkeypatch.setattr(
        runner, "_patience", lambda request: 5.0 if STOPS in repr(request) else patience(request)
    )
    rows = nasty_planners.table([list(CHOSEN)]).set_index("planner")
    assert nasty_planners.harmful(rows).empty, rows.to_string()
    assert rows["status"].to_dict() == CHOSEN
    told = rows["message"]
    assert told["takes a GiB in eight processes"] == "out of memory"
    printed = told["prints escape sequences on the descriptor and dies"]
    assert printed.endswith("last words")
    assert "\x1b" not in printed
    assert "exit code 0" in told["ends its process with code 0"]
    assert "written again" in rows["warning"]["removes the results folder"]


def test_the_experiment_would_notice():
    row = {
        "certified %": 0.0,
        "others": "same",
        "left": 0,
        "printed": 0,
        "executed": False,
        "message": "",
    }
    harms = {"certified %": -1e-3, "others": "changed", "left": 1, "printed": 1, "executed": True}
    rows = [row]
    for kind, value in harms.items():
        rows.append(row | {kind: value})
    harmful = nasty_planners.harmful(pd.DataFrame(rows))
    assert harmful.index.tolist() == [1, 2, 3, 4, 5]
