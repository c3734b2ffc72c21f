"""One task in a supervised child process, which may raise, hang, devour memory or die.

The child writes its trials itself, a file each; what it could not write is recorded for it.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
import traceback
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing.util import Finalize

import cloudpickle
import pebble

from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.trial import failed, judge, provenance, trial_id
from trajopt.exceptions import StoreError, WorkerError
from trajopt.planner import Planner
from trajopt.problem import Problem
from trajopt.solution import Solution, Status

_thread = threading.local()


@dataclass(frozen=True)
class Allowance:
    """What a trial may use: `timeout` in s, and `memory` in GiB for its process (None: any)."""

    timeout: float = 600.0
    memory: float | None = None


@dataclass(frozen=True)
class Task:
    """Some seeds of one planner on one problem."""

    problem: Problem
    name: str
    planner: Planner
    seeds: tuple[int, ...]

    def trial_id(self, seed: int) -> str:
        release = provenance()["trajopt"]
        return trial_id(self.problem, self.name, self.planner.options(), seed, release)


def supervised(pickled: bytes, store: Store, allowed: Allowance) -> None:
    """In an executor's worker: the task in a child process, which may hang or die.

    Raises `WorkerError` where the worker may not have children.
    """
    if multiprocessing.current_process().daemon:
        raise WorkerError(
            "a worker that is a daemon cannot supervise trials; start Dask's workers with "
            "DASK_DISTRIBUTED__WORKER__DAEMON=False in their environment"
        )
    task = cloudpickle.loads(pickled)
    with single_threaded():
        child = schedule(_own_pool(), task, pickled, store, allowed)
        record_failure(child, task, store, allowed)


def _own_pool() -> pebble.ProcessPool:
    """A child process for each of the worker's threads, kept: starting one takes a second."""
    if not hasattr(_thread, "pool"):
        spawn = multiprocessing.get_context("spawn")
        _thread.pool = pebble.ProcessPool(max_workers=1, context=spawn)
        Finalize(None, _stopped, (_thread.pool,), exitpriority=100)
    pool: pebble.ProcessPool = _thread.pool
    return pool


def _stopped(pool: pebble.ProcessPool) -> None:
    """Before multiprocessing waits for the worker's children, which would wait for work forever."""
    pool.stop()  # type: ignore[no-untyped-call]
    pool.join()


def schedule(
    pool: pebble.ProcessPool, task: Task, pickled: bytes, store: Store, allowed: Allowance
) -> Future[None]:
    """Send the task to the pool, which stops it when its time is over."""
    child: Future[None] = pool.schedule(
        _work, args=(pickled, store, allowed.memory), timeout=allowed.timeout * len(task.seeds)
    )
    return child


def _work(pickled: bytes, store: Store, memory: float | None) -> None:
    """In the worker process."""
    _hold_to(memory)
    do(cloudpickle.loads(pickled), store)


def _hold_to(memory: float | None) -> None:
    """Beyond so many GiB this process gets no more, which Python calls a `MemoryError`.

    `None` takes back what an earlier task set: an executor's children are kept.
    """
    with suppress(ImportError):  # not a Unix
        import resource

        hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
        own = hard if memory is None else int(memory * 2**30)
        soft = own if hard == resource.RLIM_INFINITY else min(own, hard)
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def do(task: Task, store: Store) -> None:
    """Run, judge and store the task's trials, in this process."""
    for trial in judge(task.planner, task.problem, task.seeds, task.name):
        try:
            store.write(trial)
        except StoreError:
            raise
        except Exception:  # an answer that HDF5 cannot hold
            message = traceback.format_exc()
            status, lost = Status.CRASHED, Solution(Status.CRASHED, message=message)
            blank = replace(trial, status=status, message=message, solution=lost, certificate=None)
            store.write(blank)


def record_failure(future: Future[None], task: Task, store: Store, allowed: Allowance) -> None:
    """A worker that hung or died leaves no trials behind; record what happened instead."""
    error = future.exception()
    if error is None:
        return
    if isinstance(error, StoreError | WorkerError):
        raise error
    if isinstance(error, TimeoutError):
        status, message = Status.TIMEOUT, f"stopped after {allowed.timeout * len(task.seeds):g} s"
    elif isinstance(error, pebble.ProcessExpired):
        status, message = Status.CRASHED, _obituary(error.exitcode)
    else:  # the planner does not load in another process
        status, message = Status.CRASHED, "".join(traceback.format_exception(error))
    for seed in task.seeds:
        if not store.has(task.trial_id(seed)):
            store.write(failed(task.planner, task.problem, seed, task.name, status, message))


def _obituary(exitcode: int) -> str:
    if exitcode == -9:  # SIGKILL
        return "its process was killed, perhaps because the machine ran out of memory"
    return f"its process died with exit code {exitcode}"


@contextmanager
def pool_of(jobs: int) -> Iterator[pebble.ProcessPool]:
    """Fresh interpreters: forking a process that has loaded solvers is not safe."""
    pool = pebble.ProcessPool(max_workers=jobs, context=multiprocessing.get_context("spawn"))
    try:
        yield pool
    except BaseException:
        pool.stop()  # type: ignore[no-untyped-call]
        raise
    finally:
        pool.close()  # type: ignore[no-untyped-call]
        pool.join()


@contextmanager
def single_threaded() -> Iterator[None]:
    """Children inherit one thread each for linear algebra, so that jobs do not fight for cores."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
