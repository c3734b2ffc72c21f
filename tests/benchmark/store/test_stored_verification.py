"""`verify` computes everything again and names each difference."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from trials import PROBLEM, Stopping, edited, forged, solved

from trajopt import InvalidInput, Limits, Problem, Relation, Solution, Status, StoreError
from trajopt.benchmark.store import proofs as module
from trajopt.benchmark.store import trial_text
from trajopt.benchmark.store.folder import Store, save
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import trials_of


def checked(tmp_path, trial):
    """The one trial of a file."""
    (found,) = verification(save(tmp_path / "t.h5", trial)).trials
    return found


def test_what_was_judged_holds(tmp_path):
    trial = solved()
    found = checked(tmp_path, trial)
    assert found.holds
    assert found.differences == ()
    assert (found.id, found.recorded_claim) == (trial.id, 1.5)
    assert found.certified_duration == found.recorded_duration == trial.certified_duration
    assert found.bound == "not rechecked"  # no such planner is registered
    assert found.as_dict()["holds"] is True


def wrong_worst(trial, **changes):
    uses = trial.certificate.uses
    wrong = {**uses, "velocity": uses["velocity"]._replace(**changes)}
    return replace(trial, certificate=replace(trial.certificate, uses=wrong))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        (lambda t: replace(t, status=Status.FAILED), "status"),
        (lambda t: replace(t, label="exact"), "label"),
        (lambda t: wrong_worst(t, value=1.0), "certificate's velocity"),
        (lambda t: replace(t, certificate=replace(t.certificate, dilation=1.0)), "dilation"),
        (lambda t: replace(t, certificate=replace(t.certificate, flaws=("x",))), "certified"),
        (lambda t: replace(t, certificate=None), "feasible: recorded none"),
        (lambda t: replace(t, certificate=replace(t.certificate, duration=9.0)), "duration"),
    ],
)
def test_a_false_record_is_named(tmp_path, change, name):
    found = checked(tmp_path, change(solved()))
    assert not found.holds
    assert name in " ".join(found.differences)


def edit(*path, factor):
    """Multiply one number of a trial's JSON."""

    def change(table):
        *places, last = path
        for place in places:
            table = table[place]
        table[last] *= factor

    return change


TRAJECTORY = ("solution", "trajectory")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (edit("certificate", "dilation", factor=0.5), "dilation: recorded"),
        (edit("certificate", "duration", factor=0.9), "duration: recorded"),
        (edit("certificate", "velocity", "value", factor=0.9), "certificate's velocity"),
        (edit(*TRAJECTORY, "coefficients", 0, 0, 0, factor=1.5), "certified_duration: recorded"),
        (edit(*TRAJECTORY, "breaks", -1, factor=0.9), "waypoint_times"),
        (edit("seed", factor=5), "id: "),
        (edit("problem", "waypoints", 0, 1, factor=1.01), "problem.digest"),
        (edit("problem", "limits", "velocity", 0, 1, factor=1.01), "problem.digest"),
    ],
)
@pytest.mark.parametrize("place", ["folder", "results.h5"])
def test_a_forged_text_does_not_hold_wherever_it_is(tmp_path, place, change, words):
    trial = solved()
    text = forged(trial_text.write(trial), change)
    path = tmp_path
    if place == "folder":
        Store(path).write(trial).write_bytes(text)
    else:
        path = save(tmp_path / "results.h5", trial)
        edited(path, lambda file: file["texts"].__setitem__(0, text))
    assert words in objections(path)


def objections(path):
    """What is wrong with a file or folder of one trial."""
    try:
        found = verification(path)
    except StoreError as refused:
        return str(refused)
    (checked,) = found.trials
    assert checked.id == solved().id
    assert not found.holds
    return " ".join(checked.differences)


def test_a_built_in_name_needs_the_built_in_numbers(tmp_path):
    built_in = catalogue.load("one-joint")
    (trial,) = trials_of(Stopping(3.0), built_in, [0], "stopping")
    assert checked(tmp_path, trial).holds
    easier = Limits(1.01 * built_in.limits.velocity, built_in.limits.acceleration)
    other = Problem(built_in.waypoints, easier, "one-joint")
    (trial,) = trials_of(Stopping(3.0), other, [0], "stopping")
    assert checked(tmp_path, trial).differences == (
        "problem: its numbers are not those of the built-in one-joint",
    )
    (trial,) = trials_of(Stopping(3.0), replace(other, name="mine"), [0], "stopping")
    assert checked(tmp_path, trial).holds


def test_names_of_suites_are_built_in_too(tmp_path):
    arm = catalogue.problems("robots")[0]
    fake = replace(PROBLEM, name=arm.name)
    (trial,) = trials_of(Stopping(3.0), fake, [0], "stopping")
    assert not checked(tmp_path, trial).holds


def test_a_folder_of_crashes_holds_nothing_and_says_so(tmp_path):
    crash = Solution(Status.CRASHED, message="no licence")
    trial = solved()
    for seed in range(3):
        failed = replace(trial, seed=seed, status=Status.CRASHED, solution=crash, certificate=None)
        Store(tmp_path).write(failed)
    found = verification(tmp_path)
    assert not found.holds
    assert all(t.holds for t in found.trials)
    assert "No trial has a certified duration or a lower bound" in " ".join(found.summary())
    Store(tmp_path).write(trial)
    assert verification(tmp_path).holds


def test_a_bound_above_a_certified_duration_of_the_same_problem_does_not_hold(tmp_path):
    trial = solved()
    store = Store(tmp_path)
    store.write(trial)
    slower = 1.01 * trial.certified_duration
    for seed, bound, name in ((7, slower, PROBLEM.name), (8, slower, "renamed")):
        solution = Solution(Status.INVALID, lower_bound=bound)
        problem = replace(PROBLEM, name=name)
        store.write(
            replace(
                trial,
                seed=seed,
                problem=problem,
                status=Status.INVALID,
                solution=solution,
                certificate=None,
            )
        )
    wrong = [t for t in verification(tmp_path).trials if not t.holds]
    assert {t.seed for t in wrong} == {7, 8}
    assert all("is certified" in t.differences[0] for t in wrong)


@dataclass(frozen=True)
class Proving(Stopping):
    """Stores what proves a bound of 1.9 s, unless it has lost it."""

    lost: bool = False

    def stored_bound(self, problem, stats):
        if self.lost:
            raise InvalidInput("proof", "boxes that cover everything")
        return 1.9

    def relation(self, problem):
        return Relation.SAME


class Entry:
    def missing(self):
        return None

    def load(self):
        return Proving()


@pytest.mark.parametrize(
    ("bound", "options", "said"),
    [
        (1.9, {}, "proved again"),
        (1.8, {}, "not proved"),
        (2.01, {}, "not proved"),
        (1.9, {"lost": True}, "not proved"),
        (1.9, {"unknown": 1}, "not rechecked"),
        (None, {}, ""),
    ],
)
def test_bounds_are_proved_again_from_what_their_planner_stored(
    tmp_path, monkeypatch, bound, options, said
):
    monkeypatch.setattr(module, "entries", lambda: {"stopping": Entry()})
    trial = solved()
    solution = replace(trial.solution, lower_bound=bound)
    trial = replace(trial, solution=solution, options={**trial.options, **options})
    path = save(tmp_path / "t.h5", trial)
    found = verification(path)
    assert found.trials[0].bound == said
    assert found.holds == (said != "not proved")
    assert not said or f"Lower bounds: 1 {said}." in found.summary()


@pytest.mark.parametrize("bound", ["1.9", [1.9], np.array([1.9, 2.0])])
def test_a_bound_that_is_no_number_does_not_hold(tmp_path, monkeypatch, bound):
    monkeypatch.setattr(module, "entries", lambda: {"stopping": Entry()})
    trial = solved()
    solution = replace(trial.solution, lower_bound=None, stats={"lower_bound": bound})
    found = verification(save(tmp_path / "t.h5", replace(trial, solution=solution)))
    assert not found.holds
    assert found.trials[0].differences == ("lower bound: it is no number",)


def test_an_edited_text_is_refused(tmp_path):
    """A weaker bound is true too, but the text was edited: the seal is wrong."""
    path = Store(tmp_path).write(solved())
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"lower_bound":0.25', '"lower_bound":0.24'), encoding="utf-8")
    with pytest.raises(OSError, match=r"its checksum differs"):
        verification(path)


def test_nobody_is_told_to_remove_a_file(tmp_path):
    (tmp_path / "thesis.h5").write_bytes(b"not yours")
    with pytest.raises(OSError, match=r"thesis\.h5") as error:
        verification(tmp_path / "thesis.h5")
    assert "delete" not in str(error.value)
    assert "replace" not in str(error.value)
