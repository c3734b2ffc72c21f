"""Trials on someone else's workers: any executor, and Dask's, one of whose workers is killed."""

from __future__ import annotations

import os
import signal
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from distributed import Client, LocalCluster

from trajopt import InvalidInput, Status
from trajopt import comparison as run
from trajopt.benchmark.run import dask as cluster
from trajopt.benchmark.run import runner
from trajopt.benchmark.suites import catalogue as suite
from trajopt.cli import app as cli
from trajopt.core.exceptions import WorkerError
from trajopt.planners.registry import load
from trajopt.planners.swarm_planner import Unoptimised

PROBLEM = suite.load("one-joint")


@dataclass(frozen=True)
class Killing(Unoptimised):
    """Takes its process down."""

    def solve(self, problem, *, seed=0):  # type: ignore[no-untyped-def]
        os.kill(os.getpid(), signal.SIGKILL)


def statuses(folder, executor, **more):  # type: ignore[no-untyped-def]
    planners = [("ruckig-stop", load("ruckig-stop")), ("killing", Killing())]
    results = run.compare(
        [PROBLEM], planners, folder, executor=executor, fresh_reference=True, **more
    )
    return {t.planner: t.status for t in results.items}


EXPECTED = {"exact": Status.SOLVED, "ruckig-stop": Status.SOLVED, "killing": Status.CRASHED}


def test_any_executor_will_do_and_a_planner_that_dies_costs_its_trial(tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as executor:
        assert statuses(tmp_path / "threads", executor) == EXPECTED


def test_a_process_pool_is_not_broken_by_a_planner_that_dies(tmp_path: Path) -> None:
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as executor:
        assert statuses(tmp_path / "processes", executor) == EXPECTED


@pytest.mark.long
def test_a_worker_killed_during_the_run_has_its_trials_run_elsewhere(tmp_path: Path) -> None:
    killed: list[int] = []

    def kill(_: run.Progress) -> None:
        if pids and len(list((tmp_path / "trials").glob("*.json"))) >= 2:
            killed.append(pids.pop())
            os.kill(killed[-1], signal.SIGKILL)

    planners = [("pso", load("pso:iterations=30")), ("ruckig-stop", load("ruckig-stop"))]
    problems = [suite.load(name) for name in ("six-axis", "resting-joint", "reversal")]
    with (
        LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as local,
        Client(local) as client,
        cluster.executor(local.scheduler_address) as executor,
    ):
        pids = sorted(client.run(os.getpid).values())[:1]
        results = run.compare(
            problems, planners, tmp_path, seeds=20, executor=executor, progress=kill
        )
    assert len(killed) == 1
    assert [t.status for t in results.items] == [Status.SOLVED] * (3 * (20 + 1))


def test_nobody_at_the_address_is_one_line(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT_S", 0.5)
    with pytest.raises(InvalidInput, match="scheduler"), cluster.executor("tcp://127.0.0.1:9"):
        pass
    with pytest.raises(SystemExit) as stop:
        cli.main(["compare", "one-joint", "--dask", "nonsense", "--output", str(tmp_path)])
    assert stop.value.code == 2
    assert capsys.readouterr().err.startswith("trajopt: --dask is 'nonsense'")


@pytest.mark.parametrize("text", ["[1]", "{", "{}", '{"address": 1}', "[" * 100_000])
def test_a_scheduler_file_that_is_none_is_one_line(tmp_path: Path, text: str) -> None:
    file = tmp_path / "cluster.json"
    file.write_text(text)
    with pytest.raises(InvalidInput, match="--dask"), cluster.executor(str(file)):
        pass


def test_a_worker_that_judges_by_other_code_is_refused_in_a_line(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Threads are this process: as a worker of another version they have another digest."""
    own = runner.judge_digest()
    request = runner._request

    def elsewhere(*given: Any) -> Any:
        return replace(request(*given), digest=own)

    monkeypatch.setattr(runner, "_request", elsewhere)
    monkeypatch.setattr(runner, "judge_digest", lambda problem: "0")
    with ThreadPoolExecutor(1) as executor, pytest.raises(WorkerError) as refused:
        statuses(tmp_path, executor)
    assert "has another version of trajopt than this run" in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1
    assert not list((tmp_path / "trials").glob("*.json"))


class Losing(ThreadPoolExecutor):
    """Cancels what it is given, or keeps it for ever."""

    def __init__(self, *, cancels: bool, client: Any = None) -> None:
        super().__init__(1)
        self._cancels = cancels
        self._client = client

    def submit(self, *_: Any, **__: Any) -> Future[Any]:
        future: Future[Any] = Future()
        if self._cancels:
            future.cancel()
            future.set_running_or_notify_cancel()
        return future


def raising() -> None:
    raise OSError("timed out")


NO_WORKERS = SimpleNamespace(scheduler_info=lambda: {"workers": {}})
NO_SCHEDULER = SimpleNamespace(scheduler_info=raising)


@pytest.mark.parametrize(
    ("executor", "words"),
    [
        (Losing(cancels=True), "the executor was lost; what has finished is kept"),
        (Losing(cancels=False, client=NO_WORKERS), r"Dask has had no worker for 0\.01 s"),
        (Losing(cancels=False, client=NO_SCHEDULER), "Dask's scheduler is lost: OSError"),
    ],
)
def test_a_cluster_that_is_lost_is_a_line_and_no_wait(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, executor: Losing, words: str
) -> None:
    monkeypatch.setattr(cluster, "NO_WORKER_TIMEOUT_S", 0.01)
    monkeypatch.setattr(runner, "_LOOK_INTERVAL_S", 0.02)
    with pytest.raises(WorkerError, match=words):
        statuses(tmp_path, executor)
