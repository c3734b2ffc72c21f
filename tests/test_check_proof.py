"""The script that checks a stored proof uses no toolkit, and believes no forgery."""

from __future__ import annotations

import ast
import io
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from soaks.forgeries import believed, changed, forgeries, record, text
from trajopt import Limits, Problem
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue
from trajopt.core.exceptions import TrajoptError
from trajopt.judging import check_proof

SCRIPT = Path(__file__).parents[1] / "docs" / "examples" / "best-known" / "check_proof.py"


@pytest.fixture
def checked(monkeypatch, capsys):
    """Return a function that runs the script on a text: its exit status and its output."""

    def run(content):
        monkeypatch.setattr(sys, "stdin", io.StringIO(content))
        try:
            runpy.run_path(str(SCRIPT), run_name="__main__")
        except SystemExit as end:
            return end.code, capsys.readouterr().out
        except (ArithmeticError, LookupError, TypeError, ValueError) as error:
            return error, ""

    return run


def test_it_imports_the_standard_library_only():
    script = SCRIPT.read_text(encoding="utf-8")
    nodes = list(ast.walk(ast.parse(script)))
    modules = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    modules += [name.name for node in nodes if isinstance(node, ast.Import) for name in node.names]
    imports = {module.partition(".")[0] for module in modules}
    assert imports <= sys.stdlib_module_names
    assert "trajopt" not in script


def test_it_runs_where_nothing_of_ours_can_be_imported():
    with records.file_of(catalogue.load("six-axis")).open() as file:
        ran = subprocess.run([sys.executable, "-I", SCRIPT], stdin=file, capture_output=True)
    assert ran.returncode == 0
    assert b"no motion is briefer than 1.4837" in ran.stdout


@pytest.mark.parametrize(
    "name",
    [
        "jerk-limit",
        "position-limits",  # λ jumps at position limits
        "edges-jerk-one-side",  # boxes are split
        "edges-jerk-and-position",
        "one-joint",  # in closed form, as the next one
        "edges-jerk-at-rest",
        "edges-dense-end",  # the same, of fewer waypoints than the problem has
        "moving-random-73",  # waypoints that rounding may miss, beside moving ends
        "demands-random-110",  # segments that may take no time
        "arms-kinova-gen3-tool-1000",  # ways of a tool beside the joints' limits
        "arms-ur5e-tool-250",  # these ways alone, in closed form
        "arms-ur5e-torque-60",  # torques are left out
    ],
)
def test_a_stored_proof_proves_what_is_recorded_and_no_more(checked, name):
    said = record(name)
    code, out = checked(text(said))
    assert not code, out
    said["solution"]["lower_bound"] = said["certificate"]["duration"] * (1 + 1e-9)
    code, _ = checked(text(said))
    assert code


def test_no_forgery_is_confirmed(checked):
    for forgery in forgeries("position-limits")[::24]:
        code, out = checked(forgery.text)
        assert code not in (0, False), (forgery.name, out)


def test_a_waypoint_that_differs_by_rounding_only_is_left_out(checked):
    said = record("six-axis")
    rows = said["problem"]["waypoints"]
    rows.insert(2, [q * (1 + 2.0**-51) for q in rows[1]])
    problem = Problem(rows, Limits(*said["problem"]["limits"].values()))
    said["problem"]["digest"] = problem.digest()
    code, out = checked(text(said))
    assert not code, out


def shorter_way(said):
    rows = said["problem"]["waypoints"]
    said["problem"]["waypoints"] = [[0.99 * q for q in row] for row in rows]


def faster_joints(said):
    pairs = said["problem"]["limits"]["acceleration"]
    said["problem"]["limits"]["acceleration"] = [[1.1 * a for a in pair] for pair in pairs]


def other_costates(said):
    for cell in said["proof"]["cells"]:
        cell[4] *= 1.1


def no_multipliers(said):
    said["proof"]["multipliers"] = []


@pytest.mark.parametrize("tamper", [shorter_way, faster_joints, other_costates, no_multipliers])
def test_a_tampered_proof_fails(checked, tamper):
    said = record("six-axis")
    tamper(said)
    code, _ = checked(text(said))
    assert code


def test_a_proof_does_not_choose_waypoints_that_rounding_may_miss(checked):
    """It would count those as exact: (9.1) leaves them out where nothing is asked on the way."""
    said = record("edges-dense-pair")
    assert not checked(text(said))[0]
    said["proof"]["waypoints"] = list(range(len(said["problem"]["waypoints"])))
    assert checked(text(said))[0]


def faster_tool(rows):
    for row in rows:
        row[0] *= 1.001


def smaller_arm(rows):
    for row in rows:
        for length in (4, 8, 12, 17, 18, 19):  # of the origins and the tool
            row[length] *= 0.999


def no_tool_speed(rows):
    for row in rows:
        row[0] = None


@pytest.mark.parametrize("name", ["arms-six-axis-tool-250", "arms-ur5e-tool-250"])
@pytest.mark.parametrize("tamper", [faster_tool, smaller_arm, no_tool_speed])
def test_the_ways_of_a_tampered_arm_are_no_proof(checked, name, tamper):
    """With the old digest the file is refused; with a new one the ways are shorter."""
    said = record(name)
    tamper(said["problem"]["limits"]["tool_speed"])
    with pytest.raises(check_proof.NoProof, match="digest"):
        check_proof.stated(check_proof.read(text(said))["problem"])
    said["problem"]["digest"] = check_proof.digest(check_proof.read(text(said))["problem"])
    code, _ = checked(text(said))
    assert code


@pytest.mark.parametrize("name", ["jerk-limit", "position-limits"])
def test_the_toolkit_never_proves_more_than_exact_fractions_do(checked, name):
    """The toolkit rounds: the bound on its rounding suffices for any numbers."""
    honest = record(name)
    rng = np.random.default_rng(0)
    for size in (1e-12, 1e-6, 1e-2, 1.0):
        said = changed(honest, cutoff=honest["proof"]["cutoff"])
        for table in ("cells", "multipliers"):
            numbers = np.array(said["proof"][table])
            numbers[:, 1:] *= 1 + size * rng.normal(size=numbers[:, 1:].shape)
            said["proof"][table] = numbers.tolist()
        try:
            bound = believed(text(said))
        except TrajoptError:
            continue
        said["solution"]["lower_bound"] = bound
        if bound > 0:
            code, out = checked(text(said))
            assert not code, out


def test_the_page_ships_the_very_file_that_the_product_has():
    assert SCRIPT.read_bytes() == Path(check_proof.__file__).read_bytes()
