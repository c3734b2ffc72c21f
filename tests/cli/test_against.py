"""`trajopt compare … --against`: the words and numbers of its tables, from closed forms."""

from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from trajopt import Limits, Planner, Problem, Solution, Status, Trajectory
from trajopt.benchmark.trial import trials_of
from trajopt.cli import against, app
from trajopt.cli import compare as command
from trajopt.views.results import Results

PROBLEM = Problem([[0.0], [1.0]], Limits([10.0], [100.0]), "one step")


@dataclass(frozen=True)
class Quintic(Planner):
    """Rest to rest within `first + seed` seconds; no answer where the way is `beyond`."""

    first: float = 1.0
    beyond: float = np.inf
    stochastic = True

    def solve(self, problem, *, seed=0):
        way = problem.waypoints[-1, 0] - problem.waypoints[0, 0]
        if way > self.beyond:
            return Solution(Status.NOT_CONVERGED, message="too far")
        t = self.first + seed
        c = np.zeros((6, 1, 1))
        c[0] = 6 * way / t**5
        c[1] = -15 * way / t**4
        c[2] = 10 * way / t**3
        c[5] = problem.waypoints[0]
        breaks = np.array([0.0, t])
        trajectory = Trajectory(breaks, c, breaks)
        return Solution(Status.SOLVED, trajectory)


def shown(capsys, trials, rival):
    against.show(Results(trials), rival)
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    return out


def row(out, name):
    return next(line.split()[1:] for line in out.splitlines() if line.startswith(name))


def test_on_one_problem_seeds_are_compared(capsys):
    """All of 1 … 5 s are shorter than all of 11 … 15 s: exact p is 2 / C(10, 5) = 0.008.

    Newcombe's interval of 25 pairs won of 25 begins where his equation has its root, at 0.64.
    """
    fast = trials_of(Quintic(1.0), PROBLEM, range(5), "fast")
    slow = trials_of(Quintic(11.0), PROBLEM, range(5), "slow")
    once = trials_of(Quintic(1.0), PROBLEM, [0], "once")
    out = shown(capsys, [*fast, *slow, *once], "slow:first=11.0")
    assert out.startswith("Against slow:first=11.0 (5 runs)")
    assert " ".join(row(out, "fast")) == "5 3.0000 0.2308 0.008 0.008 1.00 [0.64–1.00]"
    assert "\nonce" not in out
    assert "Mann and Whitney" in out
    assert "Not tested against slow:first=11.0: once." in out


def test_over_problems_all_and_where_both_answer(capsys):
    """Half the time on problems up to 2 rad, no answer on the one of 3 rad; the median is 0.5."""
    trials = []
    for way in (1.0, 2.0, 3.0):
        problem = replace(PROBLEM, waypoints=np.array([[0.0], [way]]), name=f"{way}")
        trials += trials_of(Quintic(4.0), problem, [0], "slow")
        trials += trials_of(Quintic(2.0, beyond=2.5), problem, [0], "some")
    out = shown(capsys, trials, "slow:first=4.0")
    assert out.startswith("Against slow:first=4.0, problem by problem")
    lines = [line.split() for line in out.splitlines()]
    rows = [" ".join(line) for line in lines]
    assert any(row.startswith("some 3 2 0 1 0.5000 ") for row in rows)
    assert any(row.startswith("both answer 2 2 0 0 0.5000 ") for row in rows)
    assert "signed ranks" in out


def test_without_spread_there_is_nothing_to_compare(capsys):
    first = trials_of(Quintic(1.0), PROBLEM, [0], "a")
    second = trials_of(Quintic(2.0), PROBLEM, [0], "b")
    words = shown(capsys, first + second, "a").split()
    assert " ".join(words) == (
        "Not tested against a: b:first=2.0. On one problem runs are compared, which takes several "
        "of both planners. Give more problems, or a --suite."
    )


def test_against_runs_that_planner_too(capsys, tmp_path, monkeypatch):
    slow = trials_of(Quintic(11.0), PROBLEM, range(5), "slow")
    fast = trials_of(Quintic(1.0), PROBLEM, range(5), "fast")
    asked = []

    def compared(problems, planners, folder, **options):
        asked.extend(planners)
        return Results([*fast, *slow])

    monkeypatch.setattr(command.comparison, "compare", compared)
    monkeypatch.setattr(command.draw, "draw", lambda *arguments, **options: [])
    rival = "slow:first=11.0"
    entrant = SimpleNamespace(label=rival)
    monkeypatch.setattr(command, "profiled", lambda *_: SimpleNamespace(entrant=entrant))
    arguments = ["compare", "one-joint", "--planner", "exact", "--output", str(tmp_path)]
    with pytest.raises(SystemExit) as stop:
        app.main([*arguments, "--against", "ruckig-stop"])
    assert stop.value.code == 0
    assert asked == ["exact", "ruckig-stop"]
    out = capsys.readouterr().out
    against_it = out[out.index("Against") :]
    assert row(against_it, "fast")[0] == "5"
