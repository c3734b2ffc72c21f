"""The site's pages: their commands and blocks run, and its examples end with a picture."""

from __future__ import annotations

import re
import runpy
import shlex
import shutil
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from trajopt import Limits, compare
from trajopt.cli import main

DOCS = Path(__file__).parents[1] / "docs"
GALLERY = sorted((DOCS / "gallery").glob("plot_*.py"))
PAGES = sorted(path for part in ("how-to", "symptoms") for path in (DOCS / part).glob("*.md"))
COMMANDS = re.compile(r"^ *(trajopt .*)$", re.M)
BLOCKS = re.compile(r"^```bash\n(.*?)^```$", re.M | re.S)
WAYPOINTS = "0,-90,90,-90,-90,0\n40,-70,80,-100,-90,20\n60,-90,90,-90,-90,0\n"
LIMITS = Limits(velocity=[2.0, 2.5], acceleration=[5.0, 6.0])


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    """A folder of results."""
    folder = tmp_path_factory.mktemp("site") / "results"
    compare(["one-joint"], ["ruckig-stop"], folder, jobs=1)
    return folder


@pytest.fixture
def folder(tmp_path, monkeypatch, finished):
    """A folder with the files that the pages name."""
    monkeypatch.chdir(tmp_path)
    for file in (DOCS / "examples" / "motions").iterdir():
        shutil.copy(file, tmp_path)
    shutil.copy(DOCS / "examples" / "ur5e" / "ur5e.urdf", tmp_path / "robot.urdf")
    shutil.copytree(finished, tmp_path / "results")
    shutil.copy(finished / "results.h5", tmp_path)
    (tmp_path / "waypoints.csv").write_text(WAYPOINTS, encoding="utf-8")
    return tmp_path


def commands():
    for page in PAGES:
        for block in BLOCKS.findall(page.read_text(encoding="utf-8")):
            for command in COMMANDS.findall(block):
                yield pytest.param(command, id=f"{page.stem}: {command}")


@pytest.mark.parametrize("command", list(commands()))
def test_a_command_of_a_page_runs(folder, command):
    if "--dask" in command:
        pytest.skip("needs a cluster")
    if "--urdf" in command:
        command = command.replace("--limits joint_limits.yaml", "--acceleration 5")
    if "franka" in command:
        with pytest.raises(SystemExit):
            main(shlex.split("plan robots-franka-fr3-w4 --planner ruckig-stop --out motion.csv"))
    with pytest.raises(SystemExit) as ended:
        main(shlex.split(command)[1:])
    assert ended.value.code in (0, 1)


@pytest.mark.parametrize("script", GALLERY, ids=lambda path: path.stem)
def test_an_example_runs_and_draws(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    runpy.run_path(str(script), run_name="__main__")
    assert plt.get_fignums()
    plt.close("all")


@pytest.mark.parametrize("times", [[0.0, 1.0, 2.0], [0.0, 0.1, 0.2]])
def test_the_guard_refuses_what_breaks_limits(times):
    refusal = runpy.run_path(str(DOCS / "examples" / "ros2" / "guard.py"))["refusal"]
    positions = [[0.0, 0.0], [0.1, -0.1], [0.2, -0.2]]
    velocities = [[0.0, 0.0], [0.1, -0.1], [0.0, 0.0]]
    points = []
    for time, position, velocity in zip(times, positions, velocities, strict=True):
        duration = {"sec": int(time), "nanosec": round(1e9 * (time % 1))}
        points.append({"positions": position, "velocities": velocity, "time_from_start": duration})
    goal = {"trajectory": {"joint_names": ["b", "a"], "points": points}}
    why = refusal(goal, ["a", "b"], LIMITS)
    too_fast = np.isclose(times[-1], 0.2)
    assert bool(why) == too_fast
    assert ("not feasible" in why) == too_fast


def test_the_guard_refuses_what_it_cannot_read():
    refusal = runpy.run_path(str(DOCS / "examples" / "ros2" / "guard.py"))["refusal"]
    assert "points" in refusal({"trajectory": {"joint_names": ["a"], "points": []}}, ["a"], LIMITS)
