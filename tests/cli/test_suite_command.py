"""`trajopt suite`: what people and scripts read, the files it writes, and what it refuses."""

import json
import re

import pytest

from trajopt import InvalidInput, Problem, UnknownName
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites.robots import ROBOTS_VERSION
from trajopt.cli import suite as suite_cli


@pytest.fixture
def run(capsys, monkeypatch):
    """Run a command 80 columns wide: exit code, stdout."""
    monkeypatch.setenv("COLUMNS", "80")

    def call(*arguments):
        options = {"exit_on_error": False, "print_error": False, "result_action": "return_value"}
        code = suite_cli.app([str(a) for a in arguments], **options)
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
    for name, found in suite.suites().items():
        assert re.search(rf"^{name} +{len(found.problems())} ", out, re.MULTILINE)
        assert f"{name}: {found.description}" in " ".join(out.split())


def test_list_json_says_how_many_of_what_size(run):
    rows = {row["name"]: row for row in parsed(run("list", "--json")[1])["suites"]}
    assert rows.keys() == suite.suites().keys()
    assert rows["random"]["joints"] == [1, 12]
    assert rows["random"]["waypoints"] == [2, 50]
    assert rows["random"]["limits"] == ["velocity", "acceleration", "jerk"]
    assert rows["six-axis"]["joints"] == [6, 6]
    assert rows["edges"]["problems"] == len(suite.problems("edges"))
    assert all(row["version"] >= 1 for row in rows.values())


# --- show ---


@pytest.mark.parametrize("name", ["six-axis", "edges", "robots", "random"])
def test_show_has_a_line_for_each_problem_and_fits(run, name):
    code, out = run("show", name)
    lines = out.splitlines()
    assert code == 0
    assert max(map(len, lines)) <= 80
    for problem in suite.problems(name):
        (line,) = [x for x in lines if x.split()[0] == problem.name]
        words = line.split()
        assert words[1:3] == [str(problem.joints), str(len(problem.waypoints))]
        assert words[-1] == problem.digest()[:12]
        assert ("jerk" in words[3:-1] or "jerk," in words[3:-1]) == problem.has("jerk")


def test_show_json_has_whole_digests(run):
    found = parsed(run("show", "robots", "--size", 5, "--json")[1])
    assert (found["suite"], found["version"]) == ("robots", ROBOTS_VERSION)
    problems = suite.problems("robots", 5)
    assert [row["digest"] for row in found["problems"]] == [p.digest() for p in problems]
    assert [row["name"] for row in found["problems"]] == [p.name for p in problems]


# --- export ---


@pytest.mark.parametrize("name", ["six-axis", "edges", "robots", "random-tiny"])
def test_export_writes_files_that_load_to_the_same_digests(run, tmp_path, name):
    folder = tmp_path / "deep" / "er"
    problems = {p.name: p for p in suite.problems(name)}
    code, out = run("export", name, folder)
    assert code == 0
    assert out.startswith(f"{len(problems)} problem file")
    assert out.count("\n") == 1
    written = {f.stem: Problem.from_toml(f) for f in folder.iterdir()}
    assert written.keys() == problems.keys()
    for key, problem in problems.items():
        assert written[key].digest() == problem.digest()
        assert (written[key].name, written[key].source) == (problem.name, problem.source)


def test_export_again_changes_nothing_and_adds_what_is_missing(run, tmp_path):
    run("export", "random-tiny", tmp_path, "--size", 2)
    before = {f: (f.read_bytes(), f.stat().st_mtime_ns) for f in tmp_path.iterdir()}
    out = run("export", "random-tiny", tmp_path, "--size", 5)[1]
    assert out.startswith("3 problem files written to")
    assert "2 were there already" in out
    assert {f: (f.read_bytes(), f.stat().st_mtime_ns) for f in before} == before
    assert len(list(tmp_path.iterdir())) == 5


def test_export_refuses_to_overwrite_and_then_writes_nothing(run, tmp_path):
    mine = tmp_path / f"{suite.problems('edges')[-1].name}.toml"
    mine.write_text("mine", encoding="utf-8")
    with pytest.raises(InvalidInput, match=re.escape(repr(str(mine)))):
        run("export", "edges", tmp_path)
    assert [f.read_text(encoding="utf-8") for f in tmp_path.iterdir()] == ["mine"]


def test_export_json_says_which_file_is_which_problem(run, tmp_path):
    run("export", "edges", tmp_path, "--size", 1)
    found = parsed(run("export", "edges", tmp_path, "--size", 3, "--json")[1])
    digests = {Problem.from_toml(f).digest() for f in found["files"]}
    assert digests == set(found["files"].values())
    assert (len(found["files"]), len(found["written"])) == (3, 2)


def test_what_cannot_be_a_folder_is_an_error(run, tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    with pytest.raises(OSError, match="file"):
        run("export", "six-axis", tmp_path / "file")


# --- mistakes ---


@pytest.mark.parametrize("command", [["show", "robot"], ["export", "robot", "x"]])
def test_an_unknown_suite_says_which_there_are(run, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(UnknownName, match="did you mean 'robots'"):
        run(*command)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", [["show", "edges"], ["export", "edges", "x"]])
def test_no_problems_at_all_are_refused(run, command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InvalidInput, match="size"):
        run(*command, "--size", 0)
    assert not list(tmp_path.iterdir())
