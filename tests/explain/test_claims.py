"""Judging published times: every verdict from bounds and optima that are known in closed form."""

import numpy as np
import pytest

from trajopt import InvalidInput, Limits, Problem
from trajopt.benchmark.suites import literature
from trajopt.explain import verdicts
from trajopt.explain.references import ReferenceAnswer
from trajopt.explain.verdicts import Claim, Known, Verdict, judge_claim, survey
from trajopt.planners.registry import load

# One joint, 4 rad at V = 2, A = 1: it reaches the limit, 4/2 + 2/1 = 4 s.
STRAIGHT = Problem([[0.0], [4.0]], Limits([2.0], [1.0]))


def known(best=10.0, lower_bound=9.0, stopping=15.0):
    return Known(STRAIGHT, best, "exact", lower_bound, "prove", stopping, {})


@pytest.mark.parametrize(
    ("duration", "verdict"),
    [
        (8.9, Verdict.IMPOSSIBLE),
        (9.0, Verdict.UNPROVED),
        (9.9, Verdict.UNPROVED),
        (10.0, Verdict.EQUAL),
        (10.1, Verdict.ABOVE),
    ],
)
def test_a_claim_stands_below_the_bound_below_the_best_or_above_it(duration, verdict):
    judgement = judge_claim(Claim("m", duration), known())
    assert judgement.verdict is verdict
    assert judgement.excess == pytest.approx(duration / 10 - 1)
    assert judgement.over_stopping == pytest.approx(duration / 15 - 1)


@pytest.mark.parametrize(
    ("duration", "rounding", "verdict"),
    [
        (8.9, 0.05, Verdict.IMPOSSIBLE),
        (8.9, 0.1, Verdict.UNPROVED),  # 9.0 is printed so, and 9.0 is not refuted
        (9.9, 0.1, Verdict.EQUAL),
        (10.1, 0.1, Verdict.EQUAL),
        (10.1, 0.05, Verdict.ABOVE),
    ],
)
def test_a_printed_digit_is_rounded_in_the_claim_s_favour(duration, rounding, verdict):
    assert verdicts.verdict(Claim("m", duration, rounding), known()) is verdict


def test_without_a_best_known_only_the_bound_speaks():
    nothing = known(best=None)
    assert verdicts.verdict(Claim("m", 8.0), nothing) is Verdict.IMPOSSIBLE
    judgement = judge_claim(Claim("m", 12.0), nothing)
    assert judgement.verdict is Verdict.OPEN
    assert judgement.excess is None
    assert not nothing.proved


@pytest.mark.parametrize("verdict", Verdict)
def test_every_verdict_has_its_meaning(verdict):
    assert verdicts.MEANINGS[verdict]


@pytest.mark.parametrize("duration", [0.0, -1.0, np.nan, np.inf])
def test_a_claim_is_a_positive_duration(duration):
    with pytest.raises(InvalidInput, match=r"^time is .*: expected a positive duration"):
        Claim("m", duration)


def test_a_family_is_one_whose_best_is_known():
    with pytest.raises(InvalidInput, match="one of 3-5-3, quintic spline, septic spline, or none"):
        Claim("m", 1.0, family="4-3-4")
    with pytest.raises(InvalidInput, match="rounding"):
        Claim("m", 1.0, rounding=-1.0)


def test_two_waypoints_are_the_closed_form_and_proved_by_it():
    found = survey(STRAIGHT)
    assert found.best == pytest.approx(4.0, rel=1e-9)
    assert found.lower_bound == pytest.approx(4.0, rel=1e-9)
    assert found.lower_bound < 4.0
    assert found.bound_by == "closed form"
    assert found.stopping == pytest.approx(4.0)
    assert found.proved
    assert verdicts.verdict(Claim("m", 3.99), found) is Verdict.IMPOSSIBLE


def test_the_best_of_a_family_stands_beside_a_claim(monkeypatch):
    asked = []

    def answer(name, problem):
        asked.append(name)
        trajectory = load("ruckig-search").solve(problem).trajectory  # 4 s
        return ReferenceAnswer(trajectory)

    monkeypatch.setattr(verdicts, "asked", answer)
    found = survey(STRAIGHT, ["3-5-3"])
    # the first answer meets the closed form, so nobody else is asked
    assert asked == ["ruckig-search", "spline353-nlp"]
    judgement = judge_claim(Claim("m", 8.0, family="3-5-3"), found)
    assert judgement.over_family == pytest.approx(1.0)
    assert judge_claim(Claim("m", 8.0), found).over_family is None


def test_the_optimum_under_the_source_s_own_peak_jerk():
    # From rest to rest over h with jerk alone limited: T = cbrt(32 h / J) = 4 s for h = 2, J = 1.
    loose = Problem([[0.0], [2.0]], Limits([100.0], [100.0]))
    judgement = judge_claim(Claim("m", 8.0, peak_jerk=(1.0,)), survey(loose))
    assert judgement.over_equal_jerk == pytest.approx(8 / 4 - 1, rel=1e-6)


def test_a_peak_jerk_is_one_number_per_joint():
    with pytest.raises(InvalidInput, match="1 numbers, one per joint"):
        verdicts.under_peak_jerk(STRAIGHT, [1.0, 2.0])
    resting = verdicts.under_peak_jerk(STRAIGHT, [0.0])
    assert not resting.has("jerk")


# --- outside checks: what others printed for optima, without us ---


@pytest.mark.parametrize(
    ("name", "printed"), [("fang2020-task1", "4.0"), ("fang2020-task2", "1.9299")]
)
def test_the_bang_bang_optima_that_fang_et_al_print(name, printed):
    published = literature.published(name)
    found = survey(published.problem)
    digits = len(printed.partition(".")[2])
    assert f"{found.best:.{digits}f}" == printed
    assert found.proved
    verdicts = {judge_claim(own, found).verdict for own in published.claims if "bang" in own.method}
    assert verdicts == {Verdict.EQUAL}


@pytest.mark.parametrize("path", [1, 3])
def test_the_closed_form_of_yu_et_al_s_monotone_paths(path):
    problem = literature.published(f"yu2025-task2-path{path}").problem
    found = survey(problem)
    # 85° at V = 100 °/s and A = 150 °/s²: h/V + V/A, whatever lies on the way
    assert found.best == pytest.approx(85 / 100 + 100 / 150, rel=1e-6)
    assert f"{found.best:.6f}" == "1.516667"
    assert found.proved


def test_a_published_time_below_a_closed_form_bound_is_impossible():
    published = literature.published("yang2024-dbo-353")
    problem = published.problem
    # At 2.5 °/s the three segments' longest ways are 46.5°, 140.4° and 40.81°.
    bound = (46.5 + 140.4 + 40.81) / 2.5
    found = Known(problem, None, "", bound, "closed form", bound, {})
    assert verdicts.end_to_end_bound(problem) == pytest.approx(bound, rel=1e-9)
    assert {judge_claim(own, found).verdict for own in published.claims} == {Verdict.IMPOSSIBLE}
