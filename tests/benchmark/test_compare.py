"""The runner: whatever a planner does is a recorded trial, and nothing finished runs twice."""

import os
import signal
import sys
import time
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path

import numpy as np
import pytest

import trajopt
from trajopt import (
    InvalidInput,
    Limits,
    MissingBackend,
    Problem,
    Relation,
    Solution,
    Status,
    StoreError,
    Trajectory,
)
from trajopt import comparison as run
from trajopt.benchmark.best_known import records
from trajopt.benchmark.run.runner import profiled
from trajopt.benchmark.run.tasks import Allowance, tasks_of
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.trial import OUT_OF_MEMORY, Configuration, unanswered
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load

PROBLEM = Problem([[0.0], [0.4], [1.0], [1.5]], Limits([1.0], [2.0]), "one joint")
FAST = [("exact", load("exact:starts=1"))]


def quintic(problem, t):
    """From rest to rest in each segment, within `t` seconds."""
    h = problem.displacements
    c = np.zeros((6, *h.shape))
    c[0] = 6 * h / t**5
    c[1] = -15 * h / t**4
    c[2] = 10 * h / t**3
    c[5] = problem.waypoints[:-1]
    times = t * np.arange(len(h) + 1)
    return Trajectory(times, c, times)


def solution(problem, *, waypoints=None, **more):
    """The quintic through these waypoints within 2 s a segment."""
    if waypoints is not None:
        problem = Problem(waypoints, problem.limits)
    return Solution(Status.SOLVED, quintic(problem, 2.0), **more)


@dataclass(frozen=True)
class Mine(Planner):
    """Behaves as told; leaves a mark in `log` whenever it runs."""

    does: str = "solve"
    log: str = ""
    segment_time: float = 2.0
    draws: bool = False

    @property
    def stochastic(self):
        return self.draws

    def relation(self, problem):
        return Relation.RESTRICTION

    def unsupported(self, problem):
        return "not for me" if self.does == "refuse" else None

    def solve(self, problem, *, seed=0):
        if self.log:
            with Path(self.log).open("a") as file:
                file.write(f"{self.segment_time}:{seed}\n")
        match self.does:
            case "raise":
                raise RuntimeError("I will not")
            case "exit":
                sys.exit(3)
            case "die":
                os._exit(7)
            case "devour":
                return Solution(Status.FAILED, stats={"big": np.ones(2**28)})  # 2 GiB
            case "killed":  # as a machine that runs out of memory does
                os.kill(os.getpid(), signal.SIGKILL)
            case "hang":
                time.sleep(600)
            case "number":
                return 42
            case "string":
                return Solution(Status.SOLVED, "a trajectory")
            case "status":
                return replace(solution(problem), status="splendid")
            case "history":
                return solution(problem, history=np.zeros(3))
            case "stats":
                return solution(problem, stats={"x": object()})
            case "bound":
                return solution(problem, lower_bound=10**400)
            case "digits":
                return solution(problem, stats={"x": 10**400})
            case "nothing":
                return Solution(Status.SOLVED)
            case "joints":
                return Solution(Status.SOLVED, Trajectory([0, 1], np.ones((1, 1, 2)), [0, 1]))
            case "astray":
                return solution(problem, waypoints=[[0], [1], [2], [9]])
            case "missing":
                raise MissingBackend("nosuchsolver")
        return Solution(Status.SOLVED, quintic(problem, self.segment_time + seed / 8))


@dataclass(frozen=True)
class Together(Mine):
    def solve_batch(self, problem, seeds):
        with Path(self.log).open("a") as file:
            file.write(f"batch {list(seeds)}\n")
        return [super(Together, self).solve(problem, seed=s) for s in seeds]


def compare(planners, folder, **options):
    return run.compare([PROBLEM], [*planners, *FAST], folder, **options)


def lines(path):
    return Path(path).read_text().splitlines() if Path(path).exists() else []


EXPECTED = {
    "raise": (Status.CRASHED, "I will not"),
    "exit": (Status.CRASHED, "SystemExit: 3"),
    "number": (Status.CRASHED, "42"),
    "string": (Status.CRASHED, "'a trajectory'"),
    "status": (Status.CRASHED, "'splendid'"),
    "history": (Status.CRASHED, "history"),
    "stats": (Status.CRASHED, "Error"),
    "bound": (Status.CRASHED, "Solution.lower_bound cannot be 1000"),
    "digits": (Status.CRASHED, "a result cannot hold 1000"),
    "nothing": (Status.FAILED, "without a trajectory"),
    "joints": (Status.INVALID, "2 joints; the problem has 1"),
    "astray": (Status.INVALID, "misses the waypoint"),
    "missing": (Status.MISSING, "pip install nosuchsolver"),
    "refuse": (Status.UNSUPPORTED, "not for me"),
    "solve": (Status.SOLVED, ""),
}


def check(results, expected):
    found = {trial.planner: trial for trial in results.items}
    assert found.keys() == {*expected, "exact"}
    for name, (status, words) in expected.items():
        trial = found[name]
        assert trial.status is status, (name, trial.message)
        assert words in trial.message, name
        is_certified = trial.certified_duration is not None
        assert is_certified == (name == "solve")
    assert found["exact"].certified_duration == pytest.approx(2.0, abs=1e-6)


def by_id(trials):
    return {trial.id: trial for trial in trials}


def test_every_misdeed_is_recorded_and_the_others_go_on(tmp_path):
    results = compare([(name, Mine(name)) for name in EXPECTED], tmp_path)
    check(results, EXPECTED)
    ran = by_id(results.items)
    stored = by_id(store.read(tmp_path / "results.h5"))
    assert stored.keys() == ran.keys()
    for key, trial in stored.items():
        assert trial.status is ran[key].status


def test_dying_and_devouring_in_worker_processes_cost_one_trial_each(tmp_path):
    expected = {
        "die": (Status.CRASHED, "exit code 7"),
        "devour": (Status.CRASHED, "out of memory"),
        "killed": (Status.CRASHED, "was killed, perhaps because the machine ran out of memory"),
        **{name: EXPECTED[name] for name in ("raise", "exit", "string", "stats", "solve")},
    }
    planners = [(name, Mine(name)) for name in expected]
    check(compare(planners, tmp_path, jobs=2, timeout=60.0, memory=1.0), expected)


def test_hanging_in_a_worker_process_costs_one_trial(tmp_path):
    planners = [(name, Mine(name)) for name in ("hang", "solve")]
    for timeout in (4.0, 20.0):  # a busy machine may need the longer one
        results = compare(planners, tmp_path, jobs=2, timeout=timeout)
        if [trial.status for trial in results.items].count(Status.TIMEOUT) == 1:
            break
    stopped = (Status.TIMEOUT, f"stopped after {timeout:g} s")
    check(results, {"hang": stopped, "solve": EXPECTED["solve"]})


def test_a_planner_of_mine_is_judged_like_ours_here_and_in_other_processes(tmp_path):
    @dataclass(frozen=True)
    class Local(Mine):  # not importable: only its pickled self reaches the worker
        pass

    planners = [("local", Local(segment_time=0.1)), ("pso", load("pso:iterations=20"))]
    here = compare(planners, tmp_path / "a", seeds=2, jobs=0)
    there = compare(planners, tmp_path / "b", seeds=2, jobs=2)
    # 15/8 · 0.6 rad / 0.1 s against 1 rad/s; 10/√3 · 0.6 / 0.1² against 2 rad/s²
    k = max(15 / 8 * 6, np.sqrt(10 / np.sqrt(3) * 60 / 2))
    (mine,) = [trial for trial in here.items if trial.planner == "local"]
    assert mine.certified_duration == pytest.approx(0.3 * k, rel=1e-9)
    others = by_id(there.items)
    assert by_id(here.items).keys() == others.keys()
    for trial in here.items:
        one = trial.solution.trajectory
        other = others[trial.id].solution.trajectory
        np.testing.assert_array_equal(one.breaks, other.breaks)
        np.testing.assert_array_equal(one.coefficients, other.coefficients)
        np.testing.assert_array_equal(one.waypoint_times, other.waypoint_times)


def test_the_second_time_nothing_runs_and_fresh_runs_everything(tmp_path):
    planner = ("mine", Mine(log=str(tmp_path / "log")))
    first = compare([planner], tmp_path)
    again = compare([planner], tmp_path)
    assert lines(tmp_path / "log") == ["2.0:0"]
    assert [t.as_dict() for t in again.items] == [t.as_dict() for t in first.items]
    assert first.kept is None
    assert (again.kept.count, again.kept.total) == (2, 2)
    assert again.kept.since == min(datetime.fromisoformat(t.started) for t in first.items)
    more = compare([planner, ("new", Mine(segment_time=3.0))], tmp_path)
    assert str(more.kept).startswith("2 of 3 trials kept from ")
    compare([planner], tmp_path, fresh=True)
    assert lines(tmp_path / "log") == ["2.0:0", "2.0:0"]


def test_results_that_hold_every_trial_are_not_built_again(tmp_path):
    first = run.compare([PROBLEM], FAST, tmp_path)
    stamp = (tmp_path / "results.h5").stat()
    again = run.compare([PROBLEM], FAST, tmp_path)
    assert (tmp_path / "results.h5").stat().st_ino == stamp.st_ino
    assert [trial.id for trial in again.items] == [trial.id for trial in first.items]


@pytest.mark.parametrize("change", ["removed", "damaged"])
def test_results_that_may_not_hold_every_trial_are_built_again(tmp_path, change):
    run.compare([PROBLEM], FAST, tmp_path)
    results = tmp_path / "results.h5"
    if change == "removed":
        results.unlink()
    else:
        results.write_bytes(results.read_bytes()[:-100])
    old = results.read_bytes() if results.exists() else b""
    inode = results.stat().st_ino if results.exists() else 0
    (trial,) = run.compare([PROBLEM], FAST, tmp_path).items
    assert trial.status is Status.SOLVED
    (stored,) = store.read(results)
    assert stored.id == trial.id
    assert change != "damaged" or results.read_bytes() != old
    assert results.stat().st_ino != inode


def test_only_new_seeds_options_and_planners_run(tmp_path):
    log = str(tmp_path / "log")
    mine = Mine(log=log, draws=True)
    assert len(compare([("mine", mine)], tmp_path, seeds=2).items) == 3
    assert len(compare([("mine", mine)], tmp_path, seeds=3).items) == 4
    assert lines(log) == ["2.0:0", "2.0:1", "2.0:2"]
    changed = Mine(log=log, draws=True, segment_time=3.0)
    results = compare([("mine", mine), ("changed", changed)], tmp_path, seeds=1)
    assert lines(log)[3:] == ["3.0:0"]
    durations = [t.claimed_duration for t in results.items if t.planner != "exact"]
    assert sorted(durations) == [6.0, 9.0]
    fewer = compare([("mine", mine)], tmp_path, seeds=1)
    assert len(fewer.items) == 2
    assert len(store.read(tmp_path)) == 5


def test_a_refusal_is_recorded_once_however_many_seeds(tmp_path):
    @dataclass(frozen=True)
    class Broken(Mine):
        def unsupported(self, problem):
            raise RuntimeError("cannot say")

    planners = [("no", Mine("refuse", draws=True)), ("?", Broken(draws=True))]
    items = compare(planners, tmp_path, seeds=3).items
    found = [f"{trial.planner} {trial.seed} {trial.status}" for trial in items]
    expected = ["? 0 crashed", "? 1 crashed", "? 2 crashed", "exact 0 solved", "no 0 unsupported"]
    assert sorted(found) == expected


def test_crashes_and_missing_backends_are_tried_again_and_a_planner_that_gave_up_is_not(tmp_path):
    log = str(tmp_path / "log")
    planners = [
        ("bad", Mine("raise", log)),
        ("beaten", Mine("nothing", log, 3.0)),
        ("absent", Mine("missing", log, 5.0)),
    ]
    for _ in range(2):
        results = compare(planners, tmp_path)
    assert sorted(lines(log)) == ["2.0:0", "2.0:0", "3.0:0", "5.0:0", "5.0:0"]
    assert len(results.items) == 4


def test_a_crash_whose_cause_is_gone_leaves_only_the_answer(tmp_path):
    cause = tmp_path / "the licence server is down"
    cause.touch()

    @dataclass(frozen=True)
    class Licensed(Mine):
        def solve(self, problem, *, seed=0):
            if cause.exists():
                raise RuntimeError(cause.name)
            return super().solve(problem, seed=seed)

    def status():
        results = compare([("licensed", Licensed())], tmp_path)
        return {trial.planner: trial.status for trial in results.items}["licensed"]

    assert status() is Status.CRASHED
    cause.unlink()
    assert status() is Status.SOLVED
    assert len(list((tmp_path / "trials").glob("*.json"))) == 2


def test_a_longer_timeout_tries_again(tmp_path):
    messages = []
    for timeout in (0.5, 1.0):
        results = compare([("hang", Mine("hang"))], tmp_path, jobs=1, timeout=timeout)
        messages += [t.message for t in results.items if t.planner == "hang"]
    assert messages == ["stopped after 0.5 s", "stopped after 1 s"]


def test_the_same_or_a_shorter_timeout_does_not():
    limits = Allowance(60.0).as_dict()
    mine = Configuration.of(Mine()).entrant
    stopped = unanswered(mine, PROBLEM, 0, Status.TIMEOUT, "stopped after 60 s", limits)
    assert Allowance(60.0).would_stop(stopped)
    assert Allowance(1.0).would_stop(stopped)
    assert not Allowance(61.0).would_stop(stopped)
    assert not Allowance().would_stop(stopped)
    earlier = replace(stopped, provenance={"mintime": "0.1.0"})  # did not say its limit
    assert not Allowance(1.0).would_stop(earlier)


def test_only_more_memory_tries_a_trial_again_that_had_too_little():
    def ended(message, memory):
        mine = Configuration.of(Mine()).entrant
        limits = Allowance(9.0, memory).as_dict()
        return unanswered(mine, PROBLEM, 0, Status.CRASHED, message, limits)

    short = ended(OUT_OF_MEMORY, 1.0)
    assert Allowance(9.0, 1.0).would_stop(short)
    assert Allowance(99.0, 0.5).would_stop(short)
    assert not Allowance(9.0, 1.5).would_stop(short)
    assert not Allowance(9.0, None).would_stop(short)
    assert not Allowance(9.0, 0.5).would_stop(ended("another reason", 1.0))
    assert not Allowance(9.0, 0.5).would_stop(ended(OUT_OF_MEMORY, None))


def test_a_damaged_trial_runs_again(tmp_path):
    planner = ("mine", Mine(log=str(tmp_path / "log")))
    results = compare([planner], tmp_path)
    (mine,) = [t for t in results.items if t.planner == "mine"]
    path = tmp_path / "trials" / f"{mine.id}.json"
    path.write_bytes(path.read_bytes()[:1000])
    again = compare([planner], tmp_path)
    assert len(lines(tmp_path / "log")) == 2
    assert {t.id for t in again.items} == {t.id for t in results.items}


def test_stochastic_planners_run_every_seed_and_the_others_once(tmp_path):
    planners = [("a", Mine(draws=True)), ("b", Mine(segment_time=3.0))]
    results = compare(planners, tmp_path, seeds=3)
    runs = [f"{trial.planner}{trial.seed}" for trial in results.items]
    assert sorted(runs) == ["a0", "a1", "a2", "b0", "exact0"]


def test_solve_batch_gets_the_seeds_together_where_it_exists(tmp_path):
    planner = Together(log=str(tmp_path / "log"), draws=True)
    results = compare([("t", planner)], tmp_path, seeds=4)
    assert lines(tmp_path / "log")[0] == "batch [0, 1, 2, 3]"
    mine = {trial.seed: trial for trial in results.items if trial.planner == "t"}
    durations = [mine[seed].claimed_duration for seed in range(4)]
    assert durations == [6, 6.375, 6.75, 7.125]
    assert {trial.batch for trial in mine.values()} == {4}


def test_the_exact_reference_joins_by_itself_and_only_once(tmp_path):
    results = run.compare([PROBLEM], [("mine", Mine())], tmp_path, fresh_reference=True)
    assert sorted(t.planner for t in results.items) == ["exact", "mine"]
    assert results.references()["kind"].tolist() == ["exact"]
    twice = [profiled(pair, [PROBLEM], Allowance()) for pair in FAST * 2]
    assert [t.profile.entrant.name for t in tasks_of([PROBLEM], twice, 5, pytest.fail)] == ["exact"]


def test_a_problem_that_is_solved_needs_no_reference_and_has_the_same_gaps(tmp_path):
    """`one-joint` is recorded; the same waypoints under other limits are not."""
    (trial,) = run.compare([PROBLEM], [("mine", Mine())], tmp_path / "a").items
    results = trajopt.Results([trial])
    known = results.references().iloc[0]
    assert known["kind"] == "best known"
    assert known["reference"] == pytest.approx(2.0, rel=1e-9)  # 1.5/1 + 1/2
    assert known["proved"] == pytest.approx(2.0, rel=1e-4)
    planned = run.compare([PROBLEM], [("mine", Mine())], tmp_path / "b", fresh_reference=True)
    both = planned.gaps().set_index("label")["gap"]
    assert results.gaps()["gap"].tolist() == pytest.approx([both["mine"]], abs=1e-6, nan_ok=True)
    unknown = replace(PROBLEM, limits=Limits([1.0], [2.5]))
    found = run.compare([unknown], [("mine", Mine())], tmp_path / "c")
    assert sorted(own.planner for own in found.items) == ["exact", "mine"]


def test_a_record_that_is_damaged_is_no_reference(tmp_path, monkeypatch):
    """Its motion made faster: it breaks a limit, and is certified as long as it was."""
    true = records.find(PROBLEM)
    faster = replace(true, trajectory=true.trajectory.dilated(0.5), duration=true.duration / 2)
    monkeypatch.setattr(records, "find", lambda problem, where=None: faster)
    results = run.compare([PROBLEM], [("mine", Mine())], tmp_path)
    assert results.references()["reference"].tolist() == pytest.approx([2.0], rel=1e-9)


def test_progress_counts_every_trial_once(tmp_path):
    for _ in range(2):
        seen = []
        compare([("a", Mine(draws=True))], tmp_path, seeds=3, progress=seen.append)
        assert [state.total for state in seen] == [4] * len(seen)
        counts = [state.finished for state in seen]
        assert counts == sorted(counts)
        assert counts[-1] == 4
        assert {state.kept for state in seen} == {counts[0]}


def test_a_folder_that_cannot_be_written_is_an_error_not_a_trial(tmp_path):
    (tmp_path / "file").write_text("")
    for jobs in (0, 1):
        with pytest.raises(StoreError, match="file"):
            compare([("mine", Mine())], tmp_path / "file", jobs=jobs)


def test_a_misspelt_option_is_the_caller_s_mistake():
    with pytest.raises(InvalidInput, match="segment_tme"):
        load("unoptimised:segment_tme=1")
