"""`trajopt claims`: what a person and a script read, and what is refused."""

import json

import pytest

from trajopt.benchmark.suites import literature
from trajopt.cli import app


@pytest.fixture
def run(capsys, monkeypatch):
    """Run a command 80 columns wide: exit code, stdout, stderr."""
    monkeypatch.setenv("COLUMNS", "80")

    def call(*arguments):
        with pytest.raises(SystemExit) as stopped:
            app.main(["claims", *arguments])
        out, err = capsys.readouterr()
        return stopped.value.code, out, err

    return call


def test_it_says_what_is_known_and_judges_every_claim(run):
    code, out, _ = run("fang2020-task1")
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    words = " ".join(out.split())
    assert "proved optimum: 4 s (ruckig-search); no motion is faster than" in words
    assert "not yet compared with the publisher's page" in words
    assert "equal: as long as the best known motion, to the digits printed" in words
    # 4.7177 s over the 4.0 s that the source itself prints
    (row,) = [line for line in out.splitlines() if "4.7177" in line]
    assert row.count("+17.9 %") == 2
    assert "unproved" not in out


def test_json_has_every_claim_with_its_source(run):
    code, out, _ = run("fang2020-task2", "--json")
    table = json.loads(out)
    assert code == 0
    assert table["doi"] == "10.1016/j.mechmachtheory.2020.103957"
    assert table["best"] == pytest.approx(1.9299, abs=5e-5)
    assert [claim["verdict"] for claim in table["claims"]] == ["above"] * 5 + ["equal"]
    assert all(claim["table"] for claim in table["claims"])


def test_without_a_problem_it_lists_them(run):
    code, out, _ = run()
    assert code == 0
    assert max(map(len, out.splitlines())) <= 80
    assert "trajopt claims PROBLEM" in out
    table = json.loads(run("--json")[1])
    counts = {row["name"]: row["claims"] for row in table["problems"]}
    assert list(counts) == list(literature.files())
    assert counts["fang2020-task1"] == 7
