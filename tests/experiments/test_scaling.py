"""The scaling experiment in small: slopes of known powers, rows kept, a figure drawn."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from experiments import scaling


@pytest.mark.parametrize("power", [1.0, 1.5, 3.0])
def test_the_slope_is_the_power(power):
    waypoints = np.array([3, 10, 100, 1000])
    seconds = 0.02 * waypoints**power
    seconds[0] = 7.0  # small problems do not count
    rows = pd.DataFrame({"waypoints": waypoints, "cpu s": seconds})
    assert scaling.slope(rows) == pytest.approx(power)


def test_one_size_has_no_slope():
    rows = pd.DataFrame({"waypoints": [3, 10], "cpu s": [0.1, 0.2]})
    assert np.isnan(scaling.slope(rows))


def test_a_walk_is_the_beginning_of_a_longer_one():
    short = scaling.walk(3, jerk=True, position=True)
    long = scaling.walk(8, jerk=False, position=False)
    np.testing.assert_array_equal(long.waypoints[:3], short.waypoints)
    assert short.has("jerk")
    assert short.has("position")
    assert not long.has("jerk")
    assert not long.has("position")


@pytest.mark.long
def test_sizes_are_measured_once_and_drawn(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(scaling, "together", lambda planner, count: [{"MB": 1.0}])
    monkeypatch.setattr(scaling, "beside", lambda peer, problem: [{"ms": 1.0}])
    monkeypatch.setattr(scaling, "long_motion", lambda samples, position: [{"MB": 1.0}])
    scaling.main(most=3, output=tmp_path)
    table = pd.read_csv(tmp_path / "scaling.csv")
    assert table["planner"].tolist() == ["exact", "exact-jerk", "collocation-refined"]
    # limits take time
    without, limited, walled = table["certified duration s"]
    assert without < limited <= walled
    assert (tmp_path / "scaling.png").exists()
    monkeypatch.setattr(scaling, "measured", pytest.fail)
    scaling.main(most=3, output=tmp_path)
    assert "exact-jerk" in capsys.readouterr().out


def test_a_single_size_has_no_slope_to_print(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(scaling, "SIZES", {"exact": (3,)})
    monkeypatch.setattr(scaling, "together", lambda planner, count: [{"MB": 1.0}])
    monkeypatch.setattr(scaling, "beside", lambda peer, problem: [{"ms": 1.0}])
    monkeypatch.setattr(scaling, "long_motion", lambda samples, position: [{"MB": 1.0}])
    scaling.main(output=tmp_path)
    assert "nan" not in capsys.readouterr().out
    assert "nan" not in (tmp_path / "scaling.svg").read_text()


def test_problems_together_are_those_one_by_one(monkeypatch):
    monkeypatch.setattr(scaling, "REPEATS", 1)
    (row,) = scaling.together("exact", 3)
    assert row["largest difference"] < 1e-12
    assert row["MB"] > 0
    first, second = scaling.like_six_axis(2, jerk=True)
    assert first.has("jerk")
    assert not np.array_equal(first.waypoints, second.waypoints)


def test_a_long_motion_is_measured_beside_its_size():
    (row,) = scaling.long_motion(500, position=True)
    cubics = 499 * 6 * 4 * 8  # bytes of their coefficients
    assert cubics < 1e6 * row["motion, MB"] < 1.2 * cubics
    assert row["MB"] > 0
