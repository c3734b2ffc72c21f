"""Records: what is written comes back, what is false is said, what is better takes its place."""

from __future__ import annotations

import hashlib
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from trials import forged, solved

from trajopt import Limits, Problem, Solution, Status, Trajectory, verify
from trajopt.benchmark.best_known import proposal, records
from trajopt.benchmark.best_known.proposal import Candidate
from trajopt.benchmark.best_known.records import CLOSED_FORM, Origin, made
from trajopt.benchmark.store import trial_text
from trajopt.benchmark.store.proofs import proved
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.suites import catalogue
from trajopt.core.exceptions import InvalidInput, TrajoptError

OURS = Origin("bang-bang", "0.1.0", "2026-11-22")
CLOSED = replace(OURS, method=CLOSED_FORM)
# 1 rad at 1 rad/s² from rest to rest takes 2 s; the second joint needs less and waits.
PROBLEM = Problem(
    [[0.0, 0.1], [1.0, -0.1]],
    Limits([5.0, [-2.0, 1.5]], [1.0, 1.0], position=[[-1.0, 2.0], [-np.inf, np.inf]]),
    "Gelenk ①/2",
    "made up",
    ["a", "b"],
)
BOUND = 2.0


def motion(duration=2.0):
    """Bang-bang in so many seconds."""
    half = duration / 2
    a = np.array([1.0, -0.2]) / half**2
    up = np.array([a / 2, 0 * a, PROBLEM.waypoints[0]])
    down = np.array([-a / 2, a * half, PROBLEM.waypoints.mean(axis=0)])
    coefficients = np.stack([up, down], axis=1)
    return Trajectory([0.0, half, duration], coefficients, [0.0, duration])


def solution(duration=2.0, lower_bound=1.9999999999, **proof):
    stats = {f"proof_{name}": array for name, array in proof.items()}
    return Solution(Status.SOLVED, motion(duration), lower_bound=lower_bound, stats=stats)


def record(duration=2.0, lower_bound=BOUND, bound=CLOSED, problem=PROBLEM, **proof):
    return made(problem, solution(duration, lower_bound, **proof), OURS, bound)


def six_axis():
    problem = catalogue.load("six-axis")
    return records.file_of(problem)


def written(folder, own):
    return records.write(own, folder)


def changed(file, change):
    """Change a file's JSON and seal it again, as a forger would."""
    text = forged(file.read_bytes(), change)
    file.write_bytes(text)
    return file


def edited(*path, value):
    """Replace one value of a record's JSON."""

    def change(table):
        *places, last = path
        for place in places:
            table = table[place]
        table[last] = value

    return change


def test_everything_comes_back(tmp_path):
    proof = {"cells": np.array([[0.0, 1e-17], [1 / 3, -2.0]]), "cutoff": np.array([7.0])}
    own = record(**proof)
    back = records.read(written(tmp_path, own))
    assert back.problem.digest() == PROBLEM.digest()
    assert (back.problem.name, back.problem.joint_names) == ("Gelenk ①/2", ("a", "b"))
    assert (back.duration, back.lower_bound) == (own.duration, 2.0)
    assert (back.motion, back.bound) == (OURS, CLOSED)
    np.testing.assert_array_equal(back.trajectory.breaks, own.trajectory.breaks)
    np.testing.assert_array_equal(back.trajectory.coefficients, own.trajectory.coefficients)
    for name, array in proof.items():
        np.testing.assert_array_equal(back.trial.solution.stats[f"proof_{name}"], array)


def test_a_record_is_a_trials_text_that_states_the_motion_joint_by_joint(tmp_path):
    file = written(tmp_path, record())
    stated = trial_text.row(file.read_bytes())
    assert stated["solution"]["trajectory"] == {
        "waypoint_times": [0.0, 2.0],
        "joints": [[[0.0, 0.5, 0.0, 0.0], [1.0, -0.5]], [[0.0, -0.1, 0.0, 0.1], [1.0, 0.1]]],
    }
    assert stated["options"] == {"motion": asdict(OURS), "bound": asdict(CLOSED)}
    assert verification(file).holds


def test_it_is_found_by_its_numbers_whatever_it_is_called(tmp_path):
    file = written(tmp_path, record())
    assert file.name == f"Gelenk___2.{PROBLEM.digest()[:16]}.json"
    renamed = replace(PROBLEM, name="another")
    other = Problem(PROBLEM.waypoints * 1.5, PROBLEM.limits, PROBLEM.name)
    assert records.find(renamed, tmp_path).duration == pytest.approx(2.0, rel=1e-12)
    assert records.find(other, tmp_path) is None


def test_what_is_true_holds(tmp_path):
    checked = records.checked(written(tmp_path, record()))
    assert checked.differences == ()
    assert checked.certified_duration == pytest.approx(2.0, rel=1e-12)
    assert checked.lower_bound == 2.0


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (record(lower_bound=2.0 + 1e-6), "lower bound: recorded 2.000001, computed 2"),
        (record(lower_bound=2.0 + 1e-6, bound=OURS), "lower bound: recorded 2.000001"),
        (record(lower_bound=2.5), "lower bound: 2.5 s, but 2 s is certified"),
        (record(steps=np.ones((1, 4))), "lower bound: "),
        (record(problem=replace(PROBLEM, name="six-axis")), "not those of the built-in six-axis"),
    ],
)
def test_what_is_not_true_does_not_hold(tmp_path, own, said):
    checked = records.checked(written(tmp_path, own))
    assert any(said in difference for difference in checked.differences)


COEFFICIENTS = ("solution", "trajectory", "joints", 0, 0)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (edited("certificate", "duration", value=1.99999), "recorded 1.99999, computed 2"),
        (edited("certificate", "dilation", value=0.9), "dilation: recorded 0.9, computed 1"),
        (edited(*COEFFICIENTS, value=[0.0, 0.6, 0.0, 0.0]), "certified_duration: recorded 2"),
        (edited(*COEFFICIENTS, value=[0.0, 0.5, 0.0, 0.2]), "certified_duration: recorded 2"),
        (edited("planner", value="exact"), "id: "),
    ],
)
def test_a_forged_file_does_not_hold(tmp_path, change, said):
    checked = records.checked(changed(written(tmp_path, record()), change))
    assert said in " ".join(checked.differences)


def test_a_file_under_another_problems_name_does_not_hold(tmp_path):
    file = written(tmp_path, record())
    other = file.rename(tmp_path / f"six-axis{catalogue.load('six-axis').digest()[:16]}.json")
    (difference,) = records.checked(other).differences
    assert difference.startswith("file: its name should end in")


def test_a_proof_is_checked_anew(tmp_path):
    file = six_axis()
    own = records.read(file)
    assert records.checked(file).holds
    copy = tmp_path / file.name
    copy.write_bytes(file.read_bytes())
    changed(copy, edited("solution", "lower_bound", value=own.lower_bound * (1 + 1e-11)))
    (difference,) = records.checked(copy).differences
    assert difference.startswith("lower bound: recorded")


@pytest.mark.parametrize("name", ["proof_cells", "proof_multipliers"])
def test_a_proof_with_another_number_proves_no_more(name):
    """Whatever stands there, it is no proof of a bound above the optimum."""
    own = records.read(six_axis())
    solution = own.trial.solution
    rng = np.random.default_rng(0)
    for place in rng.choice(solution.stats[name].size, 10, replace=False):
        array = solution.stats[name].copy()
        array.ravel()[place] += 0.5
        other = replace(solution, stats={**solution.stats, name: array})
        try:
            bound = proved(replace(own.trial, solution=other))
        except TrajoptError:
            continue
        assert bound <= own.duration


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (["options", "motion", "date"], 20261122, "date"),
        (["options", "motion", "submitter"], "a" * 301, "submitter"),
        (["options", "motion"], [], "options"),
        (["options"], {}, "options"),
        (["solution", "lower_bound"], None, "record"),
    ],
)
def test_what_is_no_record_is_one_clear_error(tmp_path, monkeypatch, path, value, named):
    file = written(tmp_path, record())
    monkeypatch.setattr("trajopt.benchmark.trial.trial_id", lambda *_: own_id)
    own_id = trial_text.stated_id(file.read_bytes())
    changed(file, edited(*path, value=value))
    with pytest.raises(InvalidInput, match=named) as error:
        records.read(file)
    assert file.name in str(error.value)


def test_another_trial_is_no_record(tmp_path):
    file = tmp_path / "x.json"
    file.write_bytes(trial_text.write(solved()))
    with pytest.raises(InvalidInput, match=r"x\.json: record is 'stopping.*expected a trial of"):
        records.read(file)


@pytest.mark.parametrize("content", [b"", b"{", b"null", b'"x"', b"{}", b"\xff\xfe"])
def test_what_is_no_json_of_ours_is_one_clear_error(tmp_path, content):
    file = tmp_path / "x.json"
    file.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"x\.json: record"):
        records.read(file)
    assert not records.checked(file).holds


# --- what is recorded ---

FILES = records.files()
# Twenty, others every time a record changes: CI checks them all (`trajopt best-known verify`).
SAMPLE = sorted(FILES, key=lambda file: hashlib.sha256(file.read_bytes()).digest())[:20]


@pytest.mark.long
def test_every_recorded_file_is_one_and_lies_where_it_belongs():
    problems = catalogue.every_problem()
    digests = set()
    for file in FILES:
        own = records.read(file)
        digests.add(own.problem.digest())
        assert file.name == own.file_name
        assert own.problem.name == problems[own.problem.digest()].problem.name
        assert own.lower_bound <= own.duration * (1 + 1e-9)
    assert len(digests) == len(FILES)


@pytest.mark.parametrize("file", SAMPLE, ids=lambda file: file.name)
def test_what_is_recorded_holds(file):
    assert records.checked(file).differences == ()


# --- the list of what is proved ---


def test_the_list_names_every_file_as_it_is():
    """`trajopt best-known verify --write-list` proves all of them and writes it anew."""
    lines = (records.folder() / records.PROVED).read_text().splitlines()
    found = {file.relative_to(records.folder()).as_posix(): file.read_bytes() for file in FILES}
    now = {f"{hashlib.sha256(content).hexdigest()}  {name}" for name, content in found.items()}
    assert set(lines) == now


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """A folder with the record of six-axis alone; and how often a proof is checked."""
    own = records.read(Path(shutil.copy(six_axis(), tmp_path)))
    monkeypatch.setattr(records, "folder", lambda: tmp_path)
    checks = []
    monkeypatch.setattr(records.proofs, "proved", lambda trial: checks.append(trial) or 1.25)
    return own, checks


def test_a_listed_bound_is_not_proved_again(asked, tmp_path):
    own, checks = asked
    records.write_list(records.files(), tmp_path)
    assert records.bound(own.problem) == own.lower_bound
    assert not checks


def test_a_bound_that_is_not_listed_is_proved_now(asked, tmp_path):
    own, checks = asked
    assert records.bound(own.problem) == 1.25
    assert len(checks) == 1


def test_a_file_that_was_changed_and_sealed_is_not_listed(asked, tmp_path):
    own, _ = asked
    records.write_list(records.files(), tmp_path)
    (file,) = records.files()
    changed(file, edited("solution", "lower_bound", value=1.48385))
    assert records.find(own.problem).lower_bound == 1.48385
    assert records.bound(own.problem) == 1.25


def test_all_files_together_stay_small():
    """698 records; the four largest take 8 MB, those of moving, sections and demands 12 MB."""
    assert sum(file.stat().st_size for file in FILES) < 28e6


@pytest.mark.parametrize(
    ("page", "said"),
    [
        ("README.md", "each of {} problems"),
        ("docs/best-known.md", "confirms all {} bounds"),
        ("docs/results.md", "each of {} [problems]"),
        ("docs/explanation/house.md", "of {} problems closed"),
        ("docs/limitations.md", "of the {} suite problems"),
        ("docs/mathematics/bounds.md", "all {} stored bounds"),
        ("experiments/README.md", "| all | {} |"),
    ],
)
def test_pages_say_how_many_problems_there_are(page, said):
    root = Path(__file__).parents[3]
    text = " ".join((root / page).read_text(encoding="utf-8").split())
    assert said.format(len(catalogue.every_problem())) in text


# --- what is better ---


def candidate(duration, submitter=""):
    return Candidate(PROBLEM, replace(OURS, submitter=submitter), motion(duration))


def test_the_first_motion_is_recorded_with_the_bound_in_closed_form(tmp_path):
    (outcome,) = proposal.outcomes([candidate(3.0), candidate(2.2)], tmp_path)
    assert outcome.shorter
    assert outcome.after.bound.method == CLOSED_FORM
    file = records.write(outcome.after, tmp_path)
    assert records.checked(file).holds
    kept = records.find(PROBLEM, tmp_path)
    assert kept.duration == pytest.approx(2.2, rel=1e-9)
    assert kept.lower_bound == pytest.approx(BOUND, rel=1e-9)
    assert not kept.closed


def test_a_shorter_motion_takes_its_place_and_a_longer_one_does_not(tmp_path):
    written(tmp_path, record(duration=2.2))
    (longer,) = proposal.outcomes([candidate(2.2)], tmp_path)
    assert longer.after is None
    (outcome,) = proposal.outcomes([candidate(2.1, "A. Nother")], tmp_path)
    file = records.write(outcome.after, tmp_path)
    assert list(tmp_path.iterdir()) == [file]
    kept = records.find(PROBLEM, tmp_path)
    assert str(kept.motion) == "bang-bang 0.1.0, A. Nother, 2026-11-22"
    assert verify(PROBLEM, kept.trajectory).feasible


def test_a_motion_below_what_is_proved_is_a_contradiction(tmp_path):
    written(tmp_path, record(duration=2.2, lower_bound=2.15))
    with pytest.raises(TrajoptError, match="one of them is wrong"):
        list(proposal.outcomes([candidate(2.1)], tmp_path))


def test_a_motion_that_breaks_a_limit_counts_as_long_as_its_slow_down(tmp_path):
    (outcome,) = proposal.outcomes([candidate(1.0)], tmp_path)
    assert outcome.duration == pytest.approx(2.0)
    checked = records.checked(records.write(outcome.after, tmp_path))
    assert checked.holds
    assert checked.certified_duration == pytest.approx(2.0)


def test_a_better_proof_is_kept_with_as_few_digits_as_it_needs(tmp_path):
    own = records.read(six_axis())
    without = Solution(Status.SOLVED, own.trajectory, lower_bound=1.0)
    written(tmp_path, made(own.problem, without, OURS, CLOSED))
    proof = own.trial.solution.stats
    long = {name: array + 0.0 for name, array in proof.items()}
    long["proof_multipliers"][:, 1] *= 1 + 1e-13
    (outcome,) = proposal.outcomes([Candidate(own.problem, OURS, None, long)], tmp_path)
    assert outcome.tighter
    assert not outcome.shorter
    assert outcome.after.lower_bound == pytest.approx(own.lower_bound, rel=2e-6)
    file = records.write(outcome.after, tmp_path)
    assert records.checked(file).holds
    assert file.stat().st_size < 1.1 * six_axis().stat().st_size


def test_a_motion_is_kept_with_as_few_numbers_as_it_needs(tmp_path):
    """Breaks at which nothing changes but the rounding are left out."""
    finer = replace(candidate(3.0), trajectory=motion(3.0).refined([0.1, 1 / 3, 2.2]))
    (outcome,) = proposal.outcomes([finer], tmp_path)
    file = records.write(outcome.after, tmp_path)
    kept = records.find(PROBLEM, tmp_path).trajectory
    assert kept.breaks.tolist() == [0.0, 1.5, 3.0]
    assert records.checked(file).holds


def test_a_record_is_a_proposal(tmp_path):
    """A file of another registry is proposed with its own origins."""
    own = records.read(six_axis())
    (outcome,) = proposal.outcomes(proposal.of_trials(six_axis(), "A. Nother"), tmp_path)
    assert outcome.after.motion == own.motion
    assert outcome.after.bound == own.bound
    assert outcome.after.duration == pytest.approx(own.duration, rel=1e-9)
    assert outcome.after.lower_bound == pytest.approx(own.lower_bound, rel=2e-5)
    (again,) = proposal.outcomes(proposal.of_trials(six_axis()), six_axis().parent)
    assert again.after is None
