"""The independent method against closed forms, demand by demand, and its table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments import mixes_truths
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

LINE = [[0.0], [1.0], [2.0]]
BACK = [[0.0], [1.0], [0.0]]


@pytest.mark.parametrize(
    ("problem", "expected"),
    [
        (Problem(LINE, Limits([10], [0.5])), 4.0),  # 2 √(h/A)
        (Problem(LINE, Limits([0.5], [1.0])), 4.5),  # h/V + V/A
        (Problem(LINE, Limits([10], [10], [1.0])), 4.0),  # ∛(32 h/J)
        (Problem(BACK, Limits([10], [1.0])), 4.0),  # 4 √(h/A): it turns with full acceleration
        (Problem(BACK, Limits([10], [1.0]), tolerance=[0.19]), 3.6),  # the same, of 0.81
        (Problem(LINE, Limits([10], [1.0]), dwell=[0, 0.3, 0]), 4.3),  # twice 2 √(h/A)
        (Problem(LINE, Limits([1], [1]), start_velocity=[1.0]), 2.5),  # cruises, and brakes
        (Problem(LINE, Limits([10], [1]), given_times=[2.5, 2.5]), 5.0),
        (
            Problem(LINE, Limits([10], [0.5]), least_times=[3.0, 0.0]),
            5.0,
        ),  # waits 1 s, brakes for 2
    ],
)
def test_closed_forms(problem: Problem, expected: float) -> None:
    duration, agree = mixes_truths.found(problem, 2, np.random.default_rng(0))
    assert duration == pytest.approx(expected, rel=1e-7)
    assert agree >= 1


def test_a_segment_of_no_time() -> None:
    """It turns 0.7 rad away, where both boxes are, with full acceleration: 4 √(h/A)."""
    turn = Problem([[0.0], [1.0], [0.95], [0.0]], Limits([10], [1.0]), tolerance=[0.3])
    own = mixes_truths.motions(turn)
    assert own.at_once.tolist() == [1]
    times = own.least(np.random.default_rng(0), no_time=1)
    assert times is not None
    assert times[1] == 0
    assert times.sum() == pytest.approx(4 * np.sqrt(0.7), rel=1e-7)


def test_a_closed_motion_does_not_stop_where_it_closes() -> None:
    """Back and forth for ever: it turns at both ends, 2 √(2 h/A) for each way."""
    problem = Problem(BACK, Limits([10], [1.0]), closed=True)
    duration, _ = mixes_truths.found(problem, 2, np.random.default_rng(0))
    assert duration == pytest.approx(4.0, rel=1e-7)


def test_the_table_has_both_methods_and_the_bound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    first, *_ = mixes_truths.mixes.SUITE.problems()
    monkeypatch.setattr(mixes_truths.mixes.SUITE.__class__, "problems", lambda _: [first, first])
    mixes_truths.main(quick=True, output=tmp_path)
    table = pd.read_csv(tmp_path / "mixes-truths.csv")
    assert (table["IPOPT above it"].abs() < 1e-6).all()
    assert (table["bound below it"] < 1e-3).all()
