"""Read me first: a planner's answer becomes a trial, judged and kept, and never runs twice.

`suites` has the problems, `run` the processes, `store` the files, `best_known` the records.
"""

from __future__ import annotations

import pytest

from trajopt import Results, Status, compare
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import load


def test_a_trial_is_an_answer_with_a_verdict_that_the_planner_does_not_make() -> None:
    problem = catalogue.load("six-axis")
    (trial,) = trials_of(load("unoptimised:segment_time=1"), problem, [0], "unoptimised")
    assert trial.status is Status.SOLVED
    assert trial.claimed_duration == 3.0  # three segments
    assert trial.certificate is not None
    assert trial.certificate.dilation > 1  # it breaks limits: a slower motion keeps them
    assert trial.certified_duration == pytest.approx(3.0 * trial.certificate.dilation)


def test_a_comparison_keeps_each_trial_in_a_file_and_runs_only_what_is_missing(tmp_path) -> None:
    first = compare("one-joint", ["unoptimised"], tmp_path)
    files = {file.stem for file in (tmp_path / "trials").glob("*.json")}
    assert files == {trial.id for trial in first.items}
    assert {trial.planner for trial in first.items} == {"unoptimised"}  # the optimum is recorded
    second = compare("one-joint", ["unoptimised", "ruckig-stop"], tmp_path)
    assert second.kept is not None
    assert (second.kept.count, second.kept.total) == (1, 2)


def test_what_is_read_back_is_what_was_judged(tmp_path) -> None:
    compared = compare("one-joint", ["unoptimised"], tmp_path)
    for source in (tmp_path, tmp_path / "results.h5"):
        read = Results(source)
        assert {t.id: t.certified_duration for t in read.items} == {
            t.id: t.certified_duration for t in compared.items
        }
