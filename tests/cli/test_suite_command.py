"""`trajopt suite`: what people and scripts read, the files it writes, and what it refuses."""

import json
import re

import pytest

from trajopt import InvalidInput, Problem
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites import robots
from trajopt.cli import suite as suite_cli


@pytest.fixture
def run(capsys, monkeypatch):
    """Run a command 80 columns wide: exit code, stdout."""
    monkeypatch.setenv("COLUMNS", "80")

    def call(*arguments):
        options = {"exit_on_error": False, "print_error": False, "result_action": "return_value"}
        code = suite_cli.app(" ".join(map(str, arguments)).split(), **options)
        out, err = capsys.readouterr()
        assert not err
        return code, out

    return call


def parsed(out):
    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(out, parse_constant=refuse)


# --- list ---


def test_list_names_every_suite_and_fits(run):
    code, out = run("list")
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    words = " ".join(out.split())
    for name, found in suite.suites().items():
        count = len(found.problems())
        assert re.search(rf"^{name} +{count} ", out, re.MULTILINE)
        assert f"{name}: {found.description}" in words


def test_list_json_says_how_many_of_what_size(run):
    _, out = run("list --json")
    rows = {row["name"]: row for row in parsed(out)["suites"]}
    assert rows.keys() == suite.suites().keys()
    random = rows["random"]
    assert random["joints"] == [1, 12]
    assert random["waypoints"] == [2, 50]
    assert random["limits"] == ["velocity", "acceleration", "jerk"]
    assert rows["six-axis"]["joints"] == [6, 6]
    assert rows["edges"]["problems"] == len(suite.problems("edges"))
    assert all(row["version"] >= 1 for row in rows.values())


# --- show ---


@pytest.mark.parametrize("name", ["six-axis", "edges", "robots", "random"])
def test_show_has_a_line_for_each_problem_and_fits(run, name):
    code, out = run("show", name)
    assert code == 0
    rows = {}
    for line in out.splitlines():
        assert len(line) <= 80
        first, *rest = line.split()
        rows[first] = rest
    for problem in suite.problems(name):
        joints, waypoints, *limits, digest = rows[problem.name]
        assert int(joints) == problem.joints
        assert int(waypoints) == len(problem.waypoints)
        assert digest == problem.digest()[:12]
        assert ("jerk" in " ".join(limits)) == problem.has("jerk")


def test_show_json_has_whole_digests(run):
    _, out = run("show robots --size 5 --json")
    found = parsed(out)
    assert found["suite"] == "robots"
    assert found["version"] == robots.VERSION
    for row, problem in zip(found["problems"], suite.problems("robots", 5), strict=True):
        assert row["digest"] == problem.digest()
        assert row["name"] == problem.name


# --- export ---


def files_of(folder):
    """The content and the time of the last change of every file."""
    found = {}
    for file in folder.iterdir():
        changed = file.stat().st_mtime_ns
        found[file] = (file.read_bytes(), changed)
    return found


@pytest.mark.parametrize("name", ["six-axis", "edges", "robots", "random-tiny"])
def test_export_writes_files_that_load_to_the_same_digests(run, tmp_path, name):
    folder = tmp_path / "deep" / "er"
    problems = suite.problems(name)
    code, out = run("export", name, folder)
    assert code == 0
    assert out.startswith(f"{len(problems)} problem file")
    assert out.count("\n") == 1
    assert len(files_of(folder)) == len(problems)
    for problem in problems:
        written = Problem.from_toml(folder / f"{problem.name}.toml")
        assert written.digest() == problem.digest()
        assert written.name == problem.name
        assert written.source == problem.source


def test_export_again_changes_nothing_and_adds_what_is_missing(run, tmp_path):
    run("export random-tiny", tmp_path, "--size 2")
    before = files_of(tmp_path)
    _, out = run("export random-tiny", tmp_path, "--size 5")
    assert out.startswith("3 problem files written to")
    assert "2 were there already" in out
    after = files_of(tmp_path)
    assert len(after) == 5
    assert before.items() <= after.items()


def test_export_refuses_to_overwrite_and_then_writes_nothing(run, tmp_path):
    last = suite.problems("edges")[-1]
    mine = tmp_path / f"{last.name}.toml"
    mine.write_text("mine", encoding="utf-8")
    before = files_of(tmp_path)
    with pytest.raises(InvalidInput, match=re.escape(str(mine))):
        run("export edges", tmp_path)
    assert files_of(tmp_path) == before


def test_export_json_says_which_file_is_which_problem(run, tmp_path):
    run("export edges", tmp_path, "--size 1")
    _, out = run("export edges", tmp_path, "--size 3 --json")
    found = parsed(out)
    assert len(found["files"]) == 3
    assert len(found["written"]) == 2
    for file, digest in found["files"].items():
        assert Problem.from_toml(file).digest() == digest


def test_what_cannot_be_a_folder_is_an_error(run, tmp_path):
    file = tmp_path / "file"
    file.write_text("", encoding="utf-8")
    with pytest.raises(OSError, match="file"):
        run("export six-axis", file)


# --- mistakes ---
