"""The command line: a command prints a table or one JSON object, and an error is one line."""

import json

import pytest

from trajopt.cli import main


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    """Run a command in an empty folder; return its exit code, output and errors."""
    monkeypatch.chdir(tmp_path)

    def ran(words):
        with pytest.raises(SystemExit) as ended:
            main(words.split())
        out, err = capsys.readouterr()
        return ended.value.code, out, err

    return ran


def test_a_plan_says_what_is_claimed_and_what_is_certified(run):
    code, out, err = run("plan one-joint --planner unoptimised")
    assert (code, err) == (0, "")
    assert "unoptimised on one-joint: solved" in out
    assert "certified   6.000000 s" in out


def test_json_is_for_scripts(run):
    code, out, _ = run("plan one-joint --planner unoptimised --json")
    assert code == 0
    assert json.loads(out)["certified_duration"] == 6.0


def test_a_comparison_prints_a_table_and_keeps_its_trials(run, tmp_path):
    code, out, _ = run("compare one-joint --planner ruckig-stop --jobs 1 --output results")
    assert code == 0
    assert "one-joint: certified durations" in out
    assert (tmp_path / "results" / "results.h5").is_file()


def test_nothing_solved_is_code_1_and_bad_input_is_code_2_with_one_line(run):
    code, _, _ = run("plan seven-waypoints --planner unoptimised")
    assert code == 1
    code, out, err = run("plan six-axes")
    assert (code, out) == (2, "")
    assert err.startswith("trajopt: no problem is called 'six-axes'")
    assert err.count("\n") == 1
