"""Records: what is written comes back, what is false is said, what is better takes its place."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace

import numpy as np
import pytest

from trajopt import Limits, Problem, Trajectory, verify
from trajopt.benchmark.best_known import proposal, record_check, records
from trajopt.benchmark.best_known.proposal import Candidate
from trajopt.benchmark.best_known.record import CLOSED_FORM, Origin, Record, evidence, read, text
from trajopt.benchmark.suites import catalogue
from trajopt.core.exceptions import InvalidInput, StoreError, TrajoptError

OURS = Origin("bang-bang", "0.1.0", "2026-11-22")
# 1 rad at 1 rad/s² from rest to rest takes 2 s; the second joint needs less and waits.
PROBLEM = Problem(
    [[0.0, 0.1], [1.0, -0.1]],
    Limits(
        [5.0, [-2.0, 1.5]],
        [1.0, 1.0],
        position=[[-1.0, 2.0], [-np.inf, np.inf]],
    ),
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
    down = np.array(
        [
            -a / 2,
            a * half,
            PROBLEM.waypoints.mean(axis=0),
        ]
    )
    coefficients = np.stack([up, down], axis=1)
    return Trajectory([0.0, half, duration], coefficients, [0.0, duration])


def record(duration=2.0, proof=None, **changes):
    by = replace(OURS, method=CLOSED_FORM)
    stated = evidence(motion(duration), proof or {})
    found = Record(PROBLEM, duration, 1.9999, OURS, by, stated)
    return replace(found, **changes)


def six_axis():
    problem = catalogue.load("six-axis")
    return records.file_of(problem)


def written(folder, own):
    folder.mkdir(exist_ok=True)
    file = folder / own.file_name
    file.write_text(text(own), encoding="utf-8")
    return file


def test_everything_comes_back(tmp_path):
    proof = {
        "cells": np.array([[0.0, 1e-17], [1 / 3, -2.0]]),
        "cutoff": np.array([7.0]),
    }
    own = record(proof=proof)
    back = read(written(tmp_path, own))
    assert back.problem.digest() == PROBLEM.digest()
    assert (back.problem.name, back.problem.joint_names) == ("Gelenk ①/2", ("a", "b"))
    assert (back.duration, back.lower_bound) == (2.0, 1.9999)
    assert (back.motion, back.bound) == (OURS, own.bound)
    np.testing.assert_array_equal(back.trajectory.breaks, own.trajectory.breaks)
    np.testing.assert_allclose(
        back.trajectory([0.3, 1.7]),
        own.trajectory([0.3, 1.7]),
        atol=1e-15,
    )
    assert back.proof.keys() == proof.keys()
    for name, array in proof.items():
        np.testing.assert_array_equal(back.proof[name], array)


def test_it_is_found_by_its_numbers_whatever_it_is_called(tmp_path):
    file = written(tmp_path, record())
    assert file.name == f"Gelenk___2.{PROBLEM.digest()[:16]}.json"
    renamed = replace(PROBLEM, name="another")
    other = Problem(PROBLEM.waypoints * 1.5, PROBLEM.limits, PROBLEM.name)
    assert records.find(renamed, tmp_path).duration == 2.0
    assert records.find(other, tmp_path) is None


def test_what_is_true_holds(tmp_path):
    checked = record_check.checked(written(tmp_path, record()))
    assert checked.differences == ()
    assert checked.duration == pytest.approx(2.0, rel=1e-12)
    assert checked.lower_bound == pytest.approx(2.0, rel=1e-9)


@pytest.mark.parametrize(
    ("own", "said"),
    [
        (record(duration=1.9), "duration: recorded 1.9, certified 2"),
        (replace(record(), duration=1.99999), "duration: recorded 1.99999, certified 2"),
        (record(lower_bound=2.0 + 1e-6), "lower bound: recorded 2.000001, proved 2"),
        (record(lower_bound=2.5), "lower bound: it is above the duration"),
        (record(proof={"steps": np.ones((1, 4))}), "lower bound: "),
        (record(bound=OURS), "lower bound: certify finds no proof in it"),
        (record(problem=replace(PROBLEM, name="six-axis")), "not those of the built-in six-axis"),
    ],
)
def test_what_is_not_true_does_not_hold(tmp_path, own, said):
    checked = record_check.checked(written(tmp_path, own))
    assert any(said in difference for difference in checked.differences)


def test_a_motion_that_misses_does_not_hold(tmp_path):
    coefficients = motion().coefficients + 0.1
    elsewhere = replace(motion(), coefficients=coefficients)
    away = replace(record(), evidence=evidence(elsewhere, {}))
    checked = record_check.checked(written(tmp_path, away))
    assert "misses the waypoint" in checked.differences[0]
    assert checked.duration is None


def test_a_file_under_another_problems_name_does_not_hold(tmp_path):
    file = written(tmp_path, record())
    other = file.rename(tmp_path / f"six-axis{catalogue.load('six-axis').digest()[:16]}.json")
    (difference,) = record_check.checked(other).differences
    assert difference.startswith("file: its name should end in")


def test_a_proof_is_checked_anew(tmp_path):
    file = six_axis()
    own = read(file)
    assert record_check.checked(file).holds
    stronger = replace(own, lower_bound=own.lower_bound * (1 + 1e-6))
    (difference,) = record_check.checked(written(tmp_path, stronger)).differences
    assert difference.startswith("lower bound: recorded")


@pytest.mark.parametrize("name", ["cells", "multipliers"])
def test_a_proof_with_another_number_proves_no_more(tmp_path, name):
    """Whatever stands there, it is no proof of a bound above the optimum."""
    own = read(six_axis())
    rng = np.random.default_rng(0)
    for place in rng.choice(own.proof[name].size, 10, replace=False):
        array = own.proof[name].copy()
        array.ravel()[place] += 0.5
        proof = {**own.proof, name: array}
        changed = replace(own, evidence=evidence(own.trajectory, proof))
        try:
            proved = record_check.proved(changed)
        except TrajoptError:
            continue
        assert proved <= own.duration


def whole(file):
    """All that a record's file holds."""
    found = read(file)
    return found.trajectory, found.proof


def edited(said, path, value):
    *places, last = path
    part = said
    for place in places:
        part = part[place]
    part[last] = value


@pytest.mark.parametrize(
    ("path", "value", "named"),
    [
        (["schema"], 2, "schema is 2: expected 1"),
        (["extra"], 1, "record: extra is 1"),
        (["duration"], "2", "duration"),
        (["duration"], 0, "duration"),
        (["lower_bound"], float("nan"), "NaN is no number of JSON"),
        (["motion", "date"], "yesterday", "motion.date"),
        (["motion", "method"], "", "motion.method"),
        (["motion", "submitter"], "\x1b[2J", "motion.submitter"),
        (["motion", "submitter"], "a" * 301, "motion.submitter"),
        (["motion"], [], "motion: expected an object with"),
        (["problem", "digest"], "0" * 64, "problem.digest"),
        (["problem", "waypoints", 0, 0], 0.1, "problem.digest"),
        (["problem", "waypoints", 0, 0], 1e999, "Infinity is no number of JSON"),
        (["problem", "limits", "velocity", 0], 5, "problem.limits.velocity"),
        (["problem", "limits", "velocity"], {}, "problem.limits.velocity"),
        (["problem", "limits", "snap"], [[-1, 1]], "problem.limits"),
        (["problem", "joint_names"], ["a", 2], "problem.joint_names"),
        (["trajectory", "joints"], [], "trajectory"),
        (["proof"], [], "proof"),
        (["proof", "cells"], [[1], [1, 2]], "proof.cells"),
        (["proof", "cells"], [["1"]], "proof.cells"),
        (["proof", "cells"], "1", "proof.cells"),
        (["proof", "cells"], [[10**390]], "proof.cells"),
    ],
)
def test_what_is_no_record_is_one_clear_error(tmp_path, path, value, named):
    file = written(tmp_path, record())
    said = json.loads(file.read_text(encoding="utf-8"))
    edited(said, path, value)
    file.write_text(json.dumps(said), encoding="utf-8")
    with pytest.raises(InvalidInput) as error:
        whole(file)
    assert named in str(error.value)


@pytest.mark.parametrize(
    "content", [b"", b"{", b"[" * 100_000, b"\xff\xfe", b"null", b'"x"', b"{}"]
)
def test_what_is_no_json_of_ours_is_one_clear_error(tmp_path, content):
    file = tmp_path / "x.json"
    file.write_bytes(content)
    with pytest.raises(InvalidInput, match=r"x\.json: record"):
        read(file)
    assert not record_check.checked(file).holds


# --- what is recorded ---

FILES = records.files()
# Twenty, others every time a record changes: CI checks them all (`trajopt best-known verify`).
SAMPLE = sorted(FILES, key=lambda file: hashlib.sha256(file.read_bytes()).digest())[:20]


def test_every_recorded_file_is_one_and_lies_where_it_belongs():
    problems = catalogue.every_problem()
    digests = set()
    for file in FILES:
        own = read(file)
        digests.add(own.problem.digest())
        assert file.name == own.file_name
        assert own.problem.name == problems[own.problem.digest()].problem.name
        assert own.lower_bound <= own.duration * (1 + 1e-9)
    assert len(digests) == len(FILES)


@pytest.mark.parametrize("file", SAMPLE, ids=lambda file: file.name)
def test_what_is_recorded_holds(file):
    assert record_check.checked(file).differences == ()


def test_all_files_together_stay_small():
    assert sum(file.stat().st_size for file in FILES) < 15e6


# --- what is better ---


def candidate(duration, submitter=""):
    return Candidate(PROBLEM, replace(OURS, submitter=submitter), motion(duration))


def test_the_first_motion_is_recorded_with_the_bound_in_closed_form(tmp_path):
    (outcome,) = proposal.outcomes([candidate(3.0), candidate(2.2)], tmp_path)
    assert outcome.shorter
    assert outcome.after.bound.method == CLOSED_FORM
    file = proposal.write(outcome.after, tmp_path)
    assert record_check.checked(file).holds
    kept = records.find(PROBLEM, tmp_path)
    assert kept.duration == pytest.approx(2.2, rel=1e-9)
    assert kept.lower_bound == pytest.approx(BOUND, rel=1e-9)
    assert not kept.closed


def test_a_shorter_motion_takes_its_place_and_a_longer_one_does_not(tmp_path):
    written(tmp_path, record(duration=2.2))
    (longer,) = proposal.outcomes([candidate(2.2)], tmp_path)
    assert longer.after is None
    (outcome,) = proposal.outcomes([candidate(2.1, "A. Nother")], tmp_path)
    file = proposal.write(outcome.after, tmp_path)
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
    checked = record_check.checked(proposal.write(outcome.after, tmp_path))
    assert checked.holds
    assert checked.duration == pytest.approx(2.0)


def test_a_better_proof_is_kept_with_as_few_digits_as_it_needs(tmp_path):
    own = read(six_axis())
    by = replace(OURS, method=CLOSED_FORM)
    stated = evidence(own.trajectory, {})
    weaker = replace(own, lower_bound=1.0, evidence=stated, bound=by)
    written(tmp_path, weaker)
    long = {name: array + 0.0 for name, array in own.proof.items()}
    long["multipliers"][:, 1] *= 1 + 1e-13
    (outcome,) = proposal.outcomes([Candidate(own.problem, OURS, None, long)], tmp_path)
    assert outcome.tighter
    assert not outcome.shorter
    assert outcome.after.lower_bound == pytest.approx(own.lower_bound, rel=2e-6)
    file = proposal.write(outcome.after, tmp_path)
    assert record_check.checked(file).holds
    assert file.stat().st_size < 1.1 * six_axis().stat().st_size


def test_a_record_that_cannot_be_written_leaves_the_old_one(tmp_path):
    written(tmp_path, record(duration=2.2))
    own = record(duration=2.1)
    lying = replace(own, duration=1.0)
    with pytest.raises(StoreError, match="another one when it is read again"):
        proposal.write(lying, tmp_path)
    assert records.find(PROBLEM, tmp_path).duration == 2.2
