"""`trajopt best-known` as a user types it."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest
from trials import forged

from trajopt import cli
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue


@pytest.fixture
def run(capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "registry").mkdir()

    def ran(*arguments):
        with pytest.raises(SystemExit) as ended:
            cli.main(["best-known", *arguments])
        captured = capsys.readouterr()
        return ended.value.code, captured.out, captured.err

    return ran


@pytest.fixture
def known(tmp_path):
    """A registry with six-axis alone."""
    file = records.file_of(catalogue.load("six-axis"))
    return shutil.copy(file, tmp_path / "registry" / file.name)


def planned(tmp_path, planner, problem="one-joint"):
    with pytest.raises(SystemExit):
        cli.main(["plan", problem, "--planner", planner, "--out", "motion.json"])
    return "motion.json"


def test_list_says_what_is_known_and_what_is_not(run, known):
    code, out, _ = run("list", "six-axis", "one-joint", "--registry", "registry")
    assert code == 0
    rows = {line.split()[0]: line.split() for line in out.splitlines()}
    assert rows["six-axis"][1] == "1.4839"
    assert rows["six-axis"][4:6] == ["closed", "exact"]
    assert rows["one-joint"][1:] == ["–", "–", "–", "none"]
    assert max(map(len, out.splitlines())) <= 80


def test_list_of_everything_counts_by_suite(run, known):
    code, out, _ = run("list", "--registry", "registry")
    assert code == 0
    (row,) = [line.split() for line in out.splitlines() if line.startswith("edges ")]
    problems, closed, still_open, none = map(int, row[1:5])
    assert (closed, still_open, none) == (0, 0, problems)


def test_list_as_json(run, known):
    code, out, _ = run("list", "six-axis", "one-joint", "--registry", "registry", "--json")
    six_axis, one_joint = json.loads(out)["records"]
    assert code == 0
    assert six_axis["status"] == "closed"
    assert 0 < six_axis["proved_within"] < 1e-3
    assert six_axis["file"].endswith(known.name)
    assert one_joint["status"] is None


def test_verify_ends_with_1_where_something_does_not_hold(run, known):
    code, out, _ = run("verify", "--registry", "registry")
    assert code == 0
    assert "Trials verified anew: 1; all hold what was recorded." in out
    assert "Lower bounds: 1 proved again." in out

    def claim_more(table):
        table["solution"]["lower_bound"] += 0.00005

    known.write_bytes(forged(known.read_bytes(), claim_more))
    code, out, _ = run("verify", "--registry", "registry")
    assert code == 1
    words = " ".join(out.split())
    assert f"best-known on six-axis, seed 0, trial {known.name}: lower bound: recorded" in words
    code, out, _ = run("verify", "--registry", "registry", "--json")
    assert code == 1
    assert json.loads(out)["holds"] is False


def test_verify_of_nothing_does_not_hold(run):
    code, out, _ = run("verify", "one-joint", "--registry", "registry")
    assert code == 1
    assert "no record on one-joint: nothing is recorded" in out


def test_what_holds_is_listed_as_sha256sum_reads_it(run, known, tmp_path):
    folder = tmp_path / "registry"
    (folder / "reversal.json").write_text("damaged")
    code, out, _ = run("verify", "--write-list", "--registry", "registry")
    assert code == 1
    assert out.splitlines()[-1] == f"written: registry/{records.PROVED}"
    name = Path(known).name
    digest = hashlib.sha256(Path(known).read_bytes()).hexdigest()
    assert (folder / records.PROVED).read_text() == f"{digest}  {name}\n"
    assert records.listed(folder) == {digest}
    code, _, err = run("verify", "six-axis", "--write-list", "--registry", "registry")
    assert code == 2
    assert "--write-list" in err
    assert run("verify", "--registry", "none", "--write-list")[0] == 1
    assert not (tmp_path / "none").exists()


def test_a_motion_is_proposed_once(run, tmp_path, capsys):
    motion = planned(tmp_path, "ruckig-stop")
    own = ("one-joint", "--submitter", "A. Nother", "--method", "by hand", "--registry", "registry")
    code, out, _ = run("propose", motion, *own)
    assert code == 0
    words = " ".join(out.split())
    assert "is the first motion recorded" in words
    assert "open a pull request" in words
    kept = records.find(catalogue.load("one-joint"), tmp_path / "registry")
    assert (kept.motion.method, kept.motion.submitter) == ("by hand", "A. Nother")
    assert run("verify", "--registry", "registry")[0] == 0
    code, out, _ = run("propose", motion, *own)
    assert code == 1
    assert "is no improvement" in " ".join(out.split())
    assert "nothing is written" in " ".join(out.split())
    (tmp_path / motion).unlink()
    motion = planned(tmp_path, "ruckig-search")
    capsys.readouterr()
    code, out, _ = run("propose", motion, *own, "--json")
    (outcome,) = json.loads(out)["outcomes"]
    assert code == 0
    assert outcome["new_duration"] < outcome["recorded_duration"]


def test_compare_offers_to_record_what_is_better_and_its_folder_is_proposed(
    run, tmp_path, capsys, monkeypatch
):
    motion = planned(tmp_path, "ruckig-stop")
    run("propose", motion, "one-joint", "--registry", "registry")
    monkeypatch.setattr(records, "folder", lambda: tmp_path / "registry")
    with pytest.raises(SystemExit) as ended:
        cli.main(["compare", "one-joint", "--planner", "exact", "--jobs", "1"])
    words = " ".join(capsys.readouterr().out.split())
    assert ended.value.code == 0
    assert "exact on one-joint takes 2.000000 s" in words
    assert "less than the best known, motion.json" in words
    assert words.endswith("To record what is better: trajopt best-known propose results")
    code, out, _ = run("propose", "results", "--registry", "registry")
    assert code == 0
    assert "(motion.json" in " ".join(out.split())
    with pytest.raises(SystemExit):
        cli.main(["compare", "one-joint", "--planner", "exact", "--jobs", "1"])
    assert "best-known propose" not in capsys.readouterr().out


def test_stored_trials_are_proposed_with_their_planners_names(run, tmp_path, capsys):
    with pytest.raises(SystemExit):
        cli.main(["plan", "one-joint", "--planner", "ruckig-stop", "--out", "trial.h5"])
    capsys.readouterr()
    code, out, _ = run("propose", "trial.h5", "--registry", "registry", "--json")
    (outcome,) = json.loads(out)["outcomes"]
    assert code == 0
    assert outcome["recorded_duration"] is None
    kept = records.find(catalogue.load("one-joint"), tmp_path / "registry")
    assert kept.motion.method == "ruckig-stop"
    assert kept.motion.version
