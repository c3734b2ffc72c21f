"""`trajopt front`: its JSON, its tables, its figure, its errors."""

from __future__ import annotations

import json

import pytest

from trajopt import cli


@pytest.fixture
def trajopt(capsys):
    """Run a command here: exit code, stdout, stderr."""

    def run(line):
        with pytest.raises(SystemExit) as stop:
            cli.main(line.split())
        out, err = capsys.readouterr()
        return stop.value.code, out, err

    return run


def test_json_has_the_points(trajopt):
    code, out, err = trajopt("front six-axis --durations 2,3 --time-limit 20 --json")
    assert (code, err) == (0, "")
    found = json.loads(out)
    assert list(found) == ["points"]
    assert [list(point) for point in found["points"]] == [["duration", "value", "lower"]] * 2
    tight, loose = found["points"]
    assert tight["value"] == pytest.approx(518.95, rel=1e-3)
    assert loose["value"] == pytest.approx(67.809, rel=1e-3)
    for point in found["points"]:
        assert 0.98 * point["value"] < point["lower"] <= point["value"]


def test_nothing_is_proved_without_time(trajopt):
    _, out, _ = trajopt("front one-joint --durations 3 --time-limit 0 --json")
    assert json.loads(out)["points"][0]["lower"] is None


def test_planners_stand_beside_it(trajopt, tmp_path):
    """The fastest 3-5-3 has 94 times the least of its time, which 1.764 s suffice for."""
    command = f"front six-axis --durations 2,4 --output {tmp_path} --planner spline353-nlp"
    code, out, _ = trajopt(f"{command} --planner exact --time-limit 1")
    assert code == 0
    row = next(line for line in out.splitlines() if line.startswith("spline353-nlp"))
    assert row.split()[-2:] == ["94.2", "1.7635"]
    row = next(line for line in out.splitlines() if line.startswith("exact"))
    assert "∞" in row
    stem = tmp_path / "figures" / "six-axis-front-jerk"
    for ending in (".png", ".svg", ".pdf"):
        assert stem.with_suffix(ending).stat().st_size > 1000
    assert max(map(len, out.splitlines()[:-1])) <= 80
