"""No forged proof is believed: none proves more than the best known motion takes."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from baselines.lower_bound.bound import prove
from baselines.lower_bound.dual_check import LEAF, BoundProof, proved_bound
from baselines.lower_bound.planner import Prove
from soaks import forgeries as module
from soaks.forgeries import PROBLEMS, changed, forgeries, record, text
from trajopt import InvalidInput, Limits, Problem, Solution, Status
from trajopt.benchmark.best_known import records
from trajopt.benchmark.store import folder, trial_text
from trajopt.benchmark.store.proofs import PROVED_AGAIN
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.trial import trials_of
from trajopt.cli.best_known import verify
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.rest_to_rest import end_to_end_bound

ABOVE = 1e-9  # relative to the best known duration
HONEST = {problem: record(problem) for problem in PROBLEMS}


@cache
def forgeries_of(problem):
    """Forgeries of a problem's record, by what was done; they take seconds."""
    return {own.name.removeprefix(f"{problem}: "): own for own in forgeries(problem)}


def believed(content):
    """Bound that a record's text proves, s; −∞ where it is refused."""
    try:
        return module.believed(content)
    except TrajoptError:
        return -np.inf


@pytest.mark.parametrize(
    "problem", [PROBLEMS[0], *(pytest.param(own, marks=pytest.mark.long) for own in PROBLEMS[1:])]
)
@pytest.mark.long
def test_no_forgery_is_believed_and_the_honest_proof_is(problem):
    own = HONEST[problem]
    for name, forgery in forgeries_of(problem).items():
        assert believed(forgery.text) <= forgery.duration * (1 + ABOVE), name
    honest = believed(text(own))
    assert honest >= own["solution"]["lower_bound"] * (1 - 1e-12)


@pytest.mark.parametrize(
    ("name", "right"),
    [
        (
            "multipliers that begin with 3.5 in column 0",
            "multipliers is 3.5: expected a whole number from 0 to",
        ),
        (
            "multipliers that begin with 1e30 in column 0",
            r"multipliers is 1e\+30: expected a whole number from 0 to",
        ),
        ("a kind of 0.5", "steps is 0.5: expected kinds from 0 to 3"),
        ("a kind of 7", "kinds from 0 to 3"),
        ("multipliers twice", "multipliers.* twice"),
    ],
)
def test_a_refusal_says_what_would_be_right(name, right):
    with pytest.raises(TrajoptError, match=right):
        module.believed(forgeries_of("six-axis")[name].text)


# --- what Hypothesis changes in honest proofs ---

TABLES = ("units", "tangents", "cuts", "cells", "steps", "multipliers")
EXTREMES = (0.0, -0.0, 1.0, -1.0, 0.5, 5e-324, 1e-308, 2.0**-128, 2.0**128, 1e308)


@st.composite
def mutations(draw):
    """A table, a place in it, and what happens there."""
    place = st.integers(0, 10**4)
    kind = draw(st.sampled_from(["scale", "scale all", "set", "swap", "drop", "repeat"]))
    sign = draw(st.sampled_from([-1.0, 0.5, 1.5]))
    power = draw(st.integers(-200, 200))
    factor = sign * 2.0**power
    value = draw(st.sampled_from(EXTREMES))
    table = draw(st.sampled_from(TABLES))
    first = draw(place)
    second = draw(place)
    return table, kind, first, second, factor, value


def mutated(rows, kind, first, second, factor, value):
    """A table of numbers with one change."""
    table = np.array(rows, dtype=float)
    i = first % len(table)
    j = second % len(table)
    column = second % table[0].size
    with np.errstate(all="ignore"):
        match kind:
            case "scale":
                table[i].reshape(-1)[column:] *= factor
            case "scale all":
                table *= factor
            case "set":
                np.atleast_2d(table.T).T[i, column] = value
            case "swap":
                table[[i, j]] = table[[j, i]]
            case "drop":
                table = np.delete(table, i, axis=0)
            case "repeat":
                table = np.insert(table, j, table[i], axis=0)
    return np.nan_to_num(table).tolist()


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.sampled_from(PROBLEMS), st.lists(mutations(), min_size=1, max_size=4))
def test_no_mutated_proof_proves_more_than_is_true(problem, changes):
    said = changed(HONEST[problem])
    for name, *change in changes:
        if said["proof"][name]:
            rows = said["proof"][name]
            said["proof"][name] = mutated(rows, *change)
    bound = believed(text(said))
    assert bound <= said["certificate"]["duration"] * (1 + ABOVE)


# --- one forgery among others ---


def test_a_forged_file_does_not_hold_and_the_others_are_checked(tmp_path, capsys):
    for name in ("units of 2^560 s and 2^0 rad", "multipliers twice", "a subnormal λ"):
        file = tmp_path / f"{len(name)}.json"
        file.write_text(forgeries_of("six-axis")[name].text, encoding="utf-8")
    honest = records.file_of(load("jerk-limit"))
    (tmp_path / honest.name).write_bytes(honest.read_bytes())
    assert verify(registry=tmp_path) == 1
    said = " ".join(capsys.readouterr().out.split())
    assert "Trials verified anew: 4; 3 do not hold what was recorded." in said


def test_a_file_that_breaks_the_check_does_not_hold(tmp_path, monkeypatch):
    def breaks(*_):
        raise OverflowError("of whatever nobody thought of")

    monkeypatch.setattr("trajopt.benchmark.trial.verify_many", breaks)
    (difference,) = records.checked(records.file_of(load("six-axis"))).differences
    assert difference == (
        "record: it cannot be checked, OverflowError: of whatever nobody thought of"
    )


def test_a_forged_trial_is_not_proved_again(tmp_path, monkeypatch):
    text = forgeries_of("six-axis")["units of 2^30 s and 2^-1022 rad"].text
    own = trial_text.read(text.encode())
    stats = {"proof": "proved", **own.solution.stats}
    forged = Solution(Status.INVALID, None, "without a motion", own.lower_bound, stats=stats)
    monkeypatch.setattr(Prove, "solve", lambda *_, **__: forged)
    (trial,) = trials_of(Prove(time_limit=1e-3), own.problem, [0], "prove")
    folder.Store(tmp_path).write(trial)
    (found,) = verification(tmp_path).trials
    assert trial.lower_bound == own.lower_bound
    assert found.bound != PROVED_AGAIN
    assert not found.holds


def test_a_bound_on_some_trajectories_is_none_on_all(tmp_path, monkeypatch):
    """The best 3-5-3 takes 4.31 s, as its proof proves, and the optimum 1.48 s."""
    planner = Prove(family="spline353", within=0.1)
    found = planner.solve(load("six-axis"))
    forged = replace(found, status=Status.INVALID, trajectory=None, message="no motion")
    forged = replace(forged, lower_bound=found.stats["lower_bound"])
    monkeypatch.setattr(Prove, "solve", lambda *_, **__: forged)
    (trial,) = trials_of(planner, load("six-axis"), [0], "prove")
    folder.Store(tmp_path).write(trial)
    (again,) = verification(tmp_path).trials
    assert again.lower_bound > 3
    assert again.bound != PROVED_AGAIN
    assert "some trajectories only" in again.differences[0]


@pytest.mark.parametrize(("name", "value"), [("proof_cells", "x"), ("proof_cels", [1.0])])
def test_what_is_no_table_of_a_proof_is_refused(name, value):
    stats = records.find(load("six-axis")).trial.solution.stats
    with pytest.raises(InvalidInput, match=f"stats, {name}: expected"):
        BoundProof.stored({**stats, name: value})


# --- arithmetic ---


def test_limits_of_the_smallest_number_prove_no_more_than_is_true():
    """In floats `V ∫|λ|` is 0 in each cell. The shortest motion takes 10 s and a ramp of 1 s."""
    least = 5e-324
    limits = Limits([least], [least])
    problem = Problem([[0.0], [10 * least]], limits)
    cells = np.zeros((3, 7))
    cells[:, 0] = [0, 0.34, 0.67]
    cells[:, 6] = 1
    proof = BoundProof(
        units=np.ones(2),
        cutoff=np.array([1e6]),
        tangents=np.zeros((0, 2)),
        cuts=np.array([[0.0, 0, 3]]),
        cells=cells,
        steps=np.array([[LEAF, 0.0, 0, 1]]),
        multipliers=np.array([[3.0, 2.0**127]]),
    )
    assert 0 < proved_bound(problem, proof) <= 11


def test_bounds_in_closed_form_are_rounded_down():
    rng = np.random.default_rng(0)
    for _ in range(50):
        way = rng.uniform(0, 1, (6, 1)).cumsum(axis=0)
        lowest = [0.1, 0.5]
        highest = [0.3, 1.0]
        v, a = rng.uniform(lowest, highest).tolist()
        problem = Problem(way, Limits([v], [a]))
        first, *_, last = map(Fraction, way[:, 0])
        velocity = Fraction(v)
        ramps = velocity / Fraction(a)
        exact = (last - first) / velocity + ramps
        assert Fraction(end_to_end_bound(problem)) <= exact


def test_a_gap_wider_than_the_bound_that_needs_no_solver_is_proved():
    """The cut-off would lie below the time that a single segment takes."""
    limits = Limits([1.0], [2.0])
    problem = Problem([[0.0], [1.5]], limits)
    bound = prove(problem, within=20.0, time_limit=5)
    assert 1.49 <= bound.lower_bound <= 2.0
    assert bound.status == "proved"
