"""A trial: what the verifier certifies of an answer, and of the history behind it."""

from dataclasses import replace

import numpy as np
import pytest
from trials import PROBLEM, Stopping, solved

from trajopt import InvalidInput, Problem, Relation, Solution, Status
from trajopt.benchmark.trial import Answers, Configuration, judged, trials_of


def test_a_certified_history_is_the_claimed_one_dilated_as_the_answer_was():
    """The largest step is 1.2 rad in 0.5 s: its peaks 15/8 h/T and 10/√3 h/T² give the dilation."""
    trial = solved()
    speeds = 15 / 8 * np.array([1.0 / 1.0, 0.6 / 1.0, 0.5 / 1.5, 0.3 / 1.5]) / 0.5
    peak = 10 / np.sqrt(3) / 0.5**2
    accelerations = peak * np.array([1.0 / 2.0, 0.6 / 2.0, 0.5 / 3.0, 0.3 / 3.0])
    dilation = max(speeds.max(), np.sqrt(accelerations.max()))
    assert dilation > 2
    evaluations, duration = trial.certified_history.T
    assert evaluations.tolist() == [1, 4, 7, 7]
    np.testing.assert_allclose(duration, dilation * np.array([np.nan, 2.25, 1.5, 1.5]), rtol=1e-12)
    assert duration[-1] == pytest.approx(trial.certified_duration, rel=1e-15)


@pytest.mark.parametrize(
    ("history", "flaw"),
    [
        ([[1, 16.0], [7, 3.9]], "it ends at 3.9 s, but the trajectory takes 1.5 s"),  # certified
        ([[1, 1.4], [7, 1.5]], "nor its durations rise"),
        ([[1, 1.5], [7, np.nan]], "nor its durations rise"),
        ([[7, 2.0], [1, 1.5]], "its evaluations must not fall"),
        ([[np.nan, 2.0], [1, 1.5]], "its evaluations must not fall"),
        ([2.0, 1.5], "it must be (m, 2), got (2,)"),
    ],
)
def test_a_history_that_does_not_lead_to_the_answer_is_no_curve(history, flaw):
    """A planner that keeps certified durations had them dilated twice: its curve ended above."""
    trial = solved()
    wrong = replace(trial.solution, history=np.array(history, dtype=float))
    assert flaw in wrong.history_flaw
    curve = replace(trial, solution=wrong).certified_history
    np.testing.assert_array_equal(curve, [[7, np.nan]])


def test_an_answer_that_keeps_every_limit_has_the_history_that_it_claims():
    trial = trials_of(Stopping(9.0), PROBLEM, [0], "stopping")[0]
    assert trial.certificate.feasible
    assert trial.certified_history[1:, 1].tolist() == [40.5, 27.0, 27.0]


def test_without_a_certified_answer_nothing_in_the_history_is_certified():
    moved = PROBLEM.waypoints + np.array([0.0, 1.0])
    solution = Stopping().solve(Problem(moved, PROBLEM.limits))

    class Astray(Stopping):
        def solve(self, problem, *, seed=0):
            return solution

    trial = trials_of(Astray(), PROBLEM, [0], "astray")[0]
    assert trial.certified_duration is None
    assert trial.certified_history[:, 0].tolist() == [1, 4, 7, 7]
    assert np.isnan(trial.certified_history[:, 1]).all()


def test_importing_what_a_planner_requires_is_no_part_of_solving(tmp_path, monkeypatch):
    (tmp_path / "slow_to_import.py").write_text("import time; time.sleep(0.5)")
    monkeypatch.syspath_prepend(tmp_path)

    class Requiring(Stopping):
        requires = ("slow_to_import", "no_such_module")

        def solve(self, problem, *, seed=0):
            import slow_to_import  # noqa: F401

            return super().solve(problem, seed=seed)

    first, second = (trials_of(Requiring(), PROBLEM, [0], "requiring")[0] for _ in range(2))
    assert first.setup_time >= 0.5
    assert first.solve_time < 0.5
    assert second.setup_time < 0.5


@pytest.mark.parametrize(
    ("stated", "setup", "solve"),
    [
        (0.0, 0.75, 2.0),  # 3 s to load and 8 s to answer, for 4 runs
        (2.0, 1.25, 1.5),
        (8.0, 2.75, 0.0),
        (8.1, 0.75, 2.0),  # more than passed is no setup
        (1e6, 0.75, 2.0),
    ],
)
def test_times_are_those_that_passed_whatever_a_planner_states(stated, setup, solve):
    entrant = Configuration.of(Stopping(), "stopping").entrant
    solutions = [Solution(Status.FAILED, message="no", setup_time=stated)] * 4
    answers = Answers(solutions, Relation.RESTRICTION, loading_time=3.0, wall_time=8.0)
    trials = judged(entrant, PROBLEM, range(4), answers, "2026-01-01T00:00:00+00:00")
    assert [(trial.setup_time, trial.solve_time) for trial in trials] == [(setup, solve)] * 4
    assert [trial.batch for trial in trials] == [4] * 4


def test_a_planner_s_name_and_options_have_bounds():
    with pytest.raises(InvalidInput, match=r"planner is .*expected a name of at most 200"):
        Configuration.of(Stopping(), "x" * 201)
    with pytest.raises(InvalidInput, match="options that are said in at most 2000 characters"):
        Configuration.of(Stopping(note="y" * 3000), "x")
