"""Kinds of limits of packages and files: planned, judged, verified, refused in a line."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.kinds import STRANGERS
from trajopt import Limits, Problem, Trajectory
from trajopt.benchmark import provenance
from trajopt.core.exceptions import InvalidInput, TrajoptError, UnknownName
from trajopt.core.limits import KINDS, Row, strangers
from trajopt.core.limits.limit import in_file
from trajopt.planners.testing import ContractError
from trajopt.planners.testing_limits import check_limit

EXAMPLE = Path(__file__).parents[2] / "docs" / "examples" / "limit-package"
MODULE = (EXAMPLE / "tip_speed.py").read_text(encoding="utf-8")


def installed(folder: Path, name: str, points: dict[str, str], module: str) -> None:
    """Put a package with entry points into a folder, as an installer leaves it."""
    (folder / f"{name}.py").write_text(module, encoding="utf-8")
    about = folder / f"{name}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"{key} = {value}\n" for key, value in points.items()]
    (about / "entry_points.txt").write_text("[trajopt.limits]\n" + "".join(lines))


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Install packages into a folder of the import path; they are forgotten afterwards."""
    before = dict(KINDS)
    monkeypatch.syspath_prepend(str(tmp_path))

    def add(*given):
        installed(tmp_path, *given)
        strangers.registered.cache_clear()

    yield add
    KINDS.clear()
    KINDS.update(before)
    monkeypatch.undo()
    strangers.registered.cache_clear()
    for name, module in list(sys.modules.items()):
        if str(getattr(module, "__file__", None)).startswith(str(tmp_path)):
            del sys.modules[name]


def said(error) -> str:
    text = str(error.value)
    assert "\n" not in text
    return text


def run(folder: Path, *arguments: str, packages: Path | None = None):
    """Run a command in a process of its own."""
    path = [str(packages)] if packages else []
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path), "COLUMNS": "200"}
    return subprocess.run(
        [sys.executable, "-m", "trajopt.cli", *arguments],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
        check=False,
    )


@pytest.mark.long
def test_the_kind_of_a_package_is_compared_verified_and_unknown_without_it(tmp_path):
    """The example's problem: 4.441 s along the chords, and 4.52 s are possible."""
    packages = tmp_path / "packages"
    packages.mkdir()
    installed(packages, "tip_speed", {"tip_speed": "tip_speed:TipSpeed"}, MODULE)
    shutil.copy(EXAMPLE / "two-links.toml", tmp_path)
    planner = "collocation-refined:starts=1,refinements=1"
    asked = ("compare", "two-links.toml", "--planner", planner, "--output", "results")
    done = run(tmp_path, *asked, packages=packages)
    assert done.returncode == 0, done.stderr
    found = run(tmp_path, "verify", "results", "--json", packages=packages)
    assert found.returncode == 0, found.stderr
    assert 4.4411 < json.loads(found.stdout)["trials"][0]["certified_duration"] < 4.52
    shutil.copy(EXAMPLE / "tip_speed.py", tmp_path)
    by_file = run(tmp_path, "verify", "results", "--kind", "tip_speed.py:TipSpeed")
    assert by_file.returncode == 0, by_file.stderr
    shutil.move(tmp_path / "tip_speed.py", packages / "moved.py")
    without = run(tmp_path, "verify", "results")
    assert without.returncode == 2
    assert "'tip_speed' limits, a kind that is not known here" in without.stderr
    assert "damaged" not in without.stderr
    assert without.stderr.count("\n") == 1


def test_a_package_is_imported_when_a_problem_has_its_key(package):
    package(
        "loud",
        {"loud": "loud:Loud"},
        MODULE.replace("TipSpeed", "Loud").replace("tip_speed", "loud"),
    )
    assert "loud" not in sys.modules
    Problem([[0.0], [1.0]], Limits([1], [1]))
    assert "loud" not in sys.modules
    own = Problem([[0.0], [1.0]], Limits([1], [1], loud={"links": [0.5], "speed": 0.1}))
    assert list(own.limits.kinds) == ["velocity", "acceleration", "loud"]
    assert "loud" in sys.modules
    # its file counts in what judged
    assert provenance.judge_digest(own) != provenance.judge_digest(own.without("loud"))
    assert provenance.judge_digest(own.without("loud")) == provenance.provenance()["judge_digest"]


@pytest.mark.parametrize(
    ("points", "module", "key", "words"),
    [
        (
            {"tipspeed": "wrong:TipSpeed"},
            MODULE,
            "tipspeed",
            "'tip_speed', at wrong:TipSpeed of package wrong",
        ),
        ({"raises": "wrong:TipSpeed"}, "raise RuntimeError('no disk')", "raises", "no disk"),
        ({"absent": "wrong:Missing"}, MODULE, "absent", "wrong:Missing"),
        ({"number": "wrong:np"}, MODULE, "number", "a subclass of Limit"),
        (
            {"mine": "wrong:TipSpeed"},
            MODULE.replace('"tip_speed"', '"velocity"'),
            "mine",
            "trajopt.core.limits.joint_limit.Velocity has this one",
        ),
        (
            {"odd": "wrong:TipSpeed"},
            MODULE.replace('"tip_speed"', '"Tip Speed"'),
            "odd",
            "small letters",
        ),
    ],
)
def test_a_package_that_is_wrong_gets_a_line(package, points, module, key, words):
    package("wrong", points, module)
    with pytest.raises(InvalidInput) as error:
        Limits([1], [1], **{key: {"links": [1], "speed": 1}})
    assert words in said(error)
    assert KINDS["velocity"].__module__ == "trajopt.core.limits.joint_limit"


def test_a_package_cannot_take_a_key_of_ours(package, capsys):
    package("taking", {"velocity": "taking:TipSpeed"}, MODULE)
    assert Limits([1], [1]).kinds["velocity"].key == "velocity"
    assert "taking" not in sys.modules
    from trajopt.cli import main

    with pytest.raises(SystemExit):
        main(["list", "limits"])
    assert "taking:TipSpeed of package taking has this key too" in " ".join(
        capsys.readouterr().out.split()
    )


def test_kinds_of_others_come_after_ours_whoever_is_imported_first(package):
    for name in ("second", "first"):
        kind = name.title()
        package(
            name,
            {name: f"{name}:{kind}"},
            MODULE.replace("TipSpeed", kind).replace("tip_speed", name),
        )
    stated = {"links": [0.5], "speed": 0.1}
    own = Limits([1], [1], second=stated, first=stated)
    assert list(own.kinds) == ["velocity", "acceleration", "first", "second"]


@pytest.mark.parametrize(
    ("spec", "kind", "words"),
    [
        ("nowhere.py:X", InvalidInput, "a Python file that exists"),
        ("", InvalidInput, "FILE.py:NAME"),
        ("own.py:Other", UnknownName, "known: TipSpeed"),
        ("empty.py:X", UnknownName, "known: none"),
        ("own.py:np", InvalidInput, "a subclass of Limit"),
        ("broken.py:X", TrajoptError, "SyntaxError"),
        ("json.py:X", InvalidInput, "a file of another name"),
    ],
)
def test_a_file_that_is_wrong_gets_a_line(package, tmp_path, monkeypatch, spec, kind, words):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(MODULE)
    Path("broken.py").write_text("def")
    Path("empty.py").write_text("")
    Path("json.py").write_text(MODULE)
    with pytest.raises(kind) as error:
        in_file(spec)
    assert words in said(error)


@pytest.mark.usefixtures("strangers")
def test_kinds_keep_the_contract(capsys):
    two = {
        "tip_speed": {"links": [0.6, 0.4], "speed": 0.5},
        "pendulum_torque": {"gravity": [5.0, 6.0], "torque": [8.0, 9.0]},
        "motor_power": {"power": [4.0, 5.0]},
        "apart": {"difference": 4.0},
        "speeds_together": {"sum": 4.0},
        "velocity": [1.0, 2.0],
        "acceleration": [1.0, [-3.0, 2.0]],
        "jerk": [1.0, 2.0],
        "position": [[-1.0, 1.0], [0.0, 2.0]],
    }
    assert set(two) >= set(STRANGERS)
    for key, stated in two.items():
        check_limit(KINDS[key].read(stated, 2))
        assert f"{key}: its numbers give it again" in capsys.readouterr().out


OWN = {
    "velocity": [0.5],
    "acceleration": [0.5],
    "jerk": [0.5],
    "falling_velocity": {"offset": [0.1], "deceleration": [0.5], "position": [[-2.0, 2.0]]},
}


@pytest.mark.parametrize("key", OWN)
@pytest.mark.parametrize("place", [0, 1])
@pytest.mark.parametrize("by", [0.9, 1.1])
def test_a_row_that_is_not_the_judge_s_is_noticed(key, place, by, monkeypatch):
    kind = KINDS[key]
    right = kind.rows

    def wrong(self, at):
        for number, row in enumerate(right(self, at)):
            mutated = number == place if key == "falling_velocity" else True
            if key == "falling_velocity":
                shift = (by - 1) * 4.0 if mutated else 0.0
                yield Row(row.value, row.low, row.high + shift)
            else:
                low, high = (
                    (by if place == 0 else 1) * row.low,
                    (by if place == 1 else 1) * row.high,
                )
                yield Row(row.value, low, high)

    check_limit(kind.read(OWN[key], 1))
    monkeypatch.setattr(kind, "rows", wrong)
    with pytest.raises(ContractError, match="rows"):
        check_limit(kind.read(OWN[key], 1))


@pytest.mark.usefixtures("strangers")
def test_the_reference_for_a_kind_of_others_plans_by_rows():
    from trajopt.explain.references import best_planners, references

    problem = Problem([[0.0], [1.0]], Limits([1], [1], motor_power={"power": [4.0]}))
    assert references(problem) == ["exact", "collocation-refined"]
    assert "collocation-refined" in best_planners(problem)
    assert references(problem.without("motor_power")) == ["exact"]


@pytest.mark.usefixtures("strangers")
def test_a_motion_on_whole_cycles_keeps_limits_of_several_joints():
    """The joints' own programs on the cycle do not know such a limit."""
    from baselines.collocation.uniform import Collocation
    from trajopt.formats.on_cycle import moved
    from trajopt.judging.verification import certified

    limits = Limits([2, 2], [8, 8], speeds_together={"sum": 0.8})
    problem = Problem([[0.0, 0.0], [0.3, -0.2], [0.5, 0.4]], limits)
    planned = certified(problem, Collocation(10).solve(problem).trajectory)
    executed = moved(problem, planned, 0.01).at_breaks(["a", "b"])
    motion = executed.trajectory()
    assert problem.limits.kinds["speeds_together"].worst(motion).value <= 1 + 1e-6
    assert motion.duration < planned.duration * 1.05


def test_rows_that_raise_are_a_line(package):
    """Whatever the code of a stranger does, the judge says whose it is."""
    raising = MODULE.replace(
        "        angle = rate", "        raise ValueError('no idea')\n        angle = rate"
    )
    package(
        "raising",
        {"raising": "raising:Raising"},
        raising.replace("TipSpeed", "Raising").replace("tip_speed", "raising"),
    )
    limit = Limits([1], [1], raising={"links": [0.5], "speed": 0.1}).kinds["raising"]
    motion = Trajectory([0.0, 1.0], [[[1.0]], [[0.0]]], [0.0, 1.0])
    with pytest.raises(TrajoptError) as error:
        limit.worst(motion)
    assert said(error) == "the rows of raising limits raise ValueError: no idea"
    one_sided = (
        MODULE.replace("high=1.0", "low=0.0, high=1.0")
        .replace("TipSpeed", "Sided")
        .replace("tip_speed", "sided")
    )
    package("sided", {"sided": "sided:Sided"}, one_sided)
    limit = Limits([1], [1], sided={"links": [0.5], "speed": 0.1}).kinds["sided"]
    with pytest.raises(InvalidInput) as wrong:
        limit.worst(motion)
    assert "a negative low and a positive high" in said(wrong)


def test_the_contract_notices_joints_together_and_jerk(strangers, monkeypatch):
    limit = KINDS["speeds_together"].read({"sum": 4.0}, 2)
    monkeypatch.setattr(type(limit), "separate", True)
    with pytest.raises(ContractError, match="depends on others"):
        check_limit(limit)
    monkeypatch.setattr(type(limit), "separate", False)
    monkeypatch.setattr(type(limit), "rows", lambda self, at: iter([Row(at.j[0] / 4, -1.0, 1.0)]))
    with pytest.raises(ContractError, match="smooth = 2"):
        check_limit(limit)


def test_a_kind_of_a_script_needs_a_file_of_its_own(tmp_path):
    """The process that judges cannot import a script."""
    script = (
        MODULE
        + """
if __name__ == "__main__":
    from trajopt import Limits, Problem, compare

    limits = Limits([1, 1], [2, 2], tip_speed={"links": [0.6, 0.4], "speed": 0.5})
    problem = Problem([[0.0, 0.0], [1.0, -1.0]], limits, "script")
    compare([problem], ["collocation"], "results")
"""
    )
    (tmp_path / "script.py").write_text(script)
    command = [sys.executable, "script.py"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
    assert "limits.tip_speed is 'a class of this script': expected a kind in a file" in done.stderr
