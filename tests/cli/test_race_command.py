"""`trajopt race`: the page of a problem, and who is not in it."""

from __future__ import annotations

PROBLEM = """
robot = "ur5e"
waypoints = [[0, -90, 90, -90, -90, 0], [20, -80, 80, -95, -90, 10]]
units.waypoints = "deg"
"""


def test_planners_stand_beside_the_optimum(run, tmp_path):
    code, out, _ = run("race mine.toml ruckig-stop spline353-nlp", mine__toml=PROBLEM)
    assert code == 0
    page = (tmp_path / "race.html").read_text(encoding="utf-8")
    assert "<b>Ruckig with stops</b>" in page
    assert "spline353-nlp has no motion here (unsupported): " in " ".join(out.split())
    assert "<p>spline353-nlp has no motion here" in page
    assert out.splitlines()[-1].startswith("race: race.html (")
    # the robot of the file has its link frames: an arm, not dials
    assert "mine: the same 2 waypoints" in page
    code, _, err = run("race mine.toml")
    assert code == 2
    assert "--out is 'race.html': expected a file that is not there yet, or --force" in err
