"""The overview of many problems, counted by hand on made-up trials."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from test_results import OTHER, leaving, run
from trials import as_runs

from trajopt import Limits, Problem
from trajopt.benchmark.trial import Configuration, Trial, unanswered
from trajopt.core.solution import Status
from trajopt.planners.swarm_planner import Unoptimised
from trajopt.views.results import Results


def refused(problem: Problem) -> Trial:
    picky = Configuration.of(Unoptimised(), "picky")
    return unanswered(picky.entrant, problem, 0, Status.UNSUPPORTED, "not for me")


@pytest.fixture
def items() -> Sequence[Trial]:
    return [
        *run("exact", 2.0),
        *run("exact", 4.0, problem=OTHER),
        *run("mine", 3.0, 2.2, 2.4),
        *run("mine", 6.0, -1, -1, problem=OTHER),
        *as_runs([*run("picky", 2.5), refused(OTHER)], "picky"),
        *run("prove", -1, bound=1.5),
    ]


def test_trials_are_counted_by_what_became_of_them(items: Sequence[Trial]) -> None:
    table = Results(items).planners()
    counts = table[["problems", "trials", "solved", "bounds", "failed", "unsupported"]]
    assert counts.loc["mine"].tolist() == [2, 6, 4, 0, 2, 0]
    assert counts.loc["picky"].tolist() == [1, 1, 1, 0, 0, 1]
    assert counts.loc["prove"].tolist() == [1, 1, 0, 1, 0, 0]
    assert counts.loc["exact"].tolist() == [2, 2, 2, 0, 0, 0]


def test_planners_on_different_problems_are_compared_by_one_on_the_same_problems() -> None:
    """`often` is 10 % and 50 % above the optimum, `seldom` 20 % above on the second alone."""
    items = [
        *run("exact", 2.0),
        *run("exact", 4.0, problem=OTHER),
        *run("often", 2.2),
        *run("often", 6.0, problem=OTHER),
        *run("seldom", 4.8, problem=OTHER),
    ]
    table = Results(items).planners()
    assert set(table["yardstick"]) == {"often"}
    assert table["gap"][["often", "seldom"]].tolist() == pytest.approx([0.3, 0.2])
    assert table["there"][["often", "seldom", "exact"]].tolist() == pytest.approx([0.3, 0.5, 0.3])


def test_proved_counts_problems_whose_motion_meets_its_bound() -> None:
    items = [
        *run("exact", 2.0),
        *run("prove", -1, bound=1.999),
        *run("mine", 3.0, 3.5),
        *run("exact", 4.0, problem=OTHER),
        *run("prove", -1, bound=3.9, problem=OTHER),
        *run("mine", 4.5, problem=OTHER),
    ]
    table = Results(items).planners()
    assert table.loc["mine", ["problems", "proved"]].tolist() == [2, 1]
    bound_alone = Results([*run("prove", -1, bound=1.999), *run("mine", 3.0)])
    assert bound_alone.planners().loc["mine", "proved"] == 0


def test_a_missing_answer_is_worse_than_any(items: Sequence[Trial]) -> None:
    table = Results(items).planners()
    assert table.loc["exact", ["gap", "worst"]].tolist() == [0, 0]
    assert table.loc["picky", "gap"] == pytest.approx(0.25)
    # medians 2.4/2 - 1 = 0.2, and none where two of three runs failed: half have no answer
    assert table.loc["mine", "gap"] == np.inf
    assert table.loc["mine", "worst"] == pytest.approx(0.5)
    assert np.isnan(table.loc["prove", "gap"])
    assert table.index[0] == "exact"


def test_the_farthest_and_the_slowest_answers_are_said() -> None:
    """A rad and half a rad beyond a limit of 0.5 rad, and gaps of 50, 20 and 10 %."""
    limits = Limits([10.0], [100.0], position=[[-1.0, 0.5]])
    out = Problem([[0.0], [0.4], [0.5]], limits, "within")
    beyond = as_runs([*leaving(out, 1.0), *leaving(out, 1.5), *leaving(out, 0.4)])
    table = Results([*run("exact", 2.0), *run("slow", 3.0, 2.4, 2.2), *beyond]).planners()
    assert table.loc["mine", "position_excess"] == pytest.approx(1.0)
    assert table.loc["slow", "worst"] == pytest.approx(0.5)
    assert table.loc["slow", "gap"] == pytest.approx(0.2)
