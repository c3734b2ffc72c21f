"""One task in a supervised child process, which may raise, hang, devour memory or die.

The child writes its trials itself, a file each; what it could not write is recorded for it. It
leads a process group of its own, so that nothing a planner started outlives it.
"""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import threading
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Future
from contextlib import contextmanager, suppress
from dataclasses import replace
from multiprocessing.util import Finalize
from pathlib import Path

import cloudpickle
import pebble

from trajopt.benchmark.run import fork_server
from trajopt.benchmark.run.plan import Allowance, Task
from trajopt.benchmark.run.threads import single_threaded
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.trial import Trial, run, unanswered
from trajopt.exceptions import StoreError, WorkerError
from trajopt.solution import Solution, Status

_GUARD = """\
no worker process could start. A script that calls compare does it under a guard, since each worker
imports the script first:

    if __name__ == "__main__":
        results = compare(...)

(or give compare jobs=0: then the trials run in this process, unsupervised). No trial that waited is
stored."""

_kept = threading.local()  # of an executor's worker: its pool
_watchdogs: list[subprocess.Popen[bytes]] = []  # of this process, so that none is collected


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
    if not hasattr(_kept, "pool"):
        _kept.pool = _pool(1)
        Finalize(None, _stopped, (_kept.pool,), exitpriority=100)
    pool: pebble.ProcessPool = _kept.pool
    return pool


def _stopped(pool: pebble.ProcessPool) -> None:
    """Before multiprocessing waits for the worker's children, which would wait for work forever."""
    pool.stop()  # type: ignore[no-untyped-call]
    pool.join()


def _pool(workers: int) -> pebble.ProcessPool:
    """Processes of the fork server, which started with an environment of its own."""
    _forget_standard_input()
    fork_server.start()
    return pebble.ProcessPool(
        max_workers=workers,
        context=fork_server.context(),
        initializer=_begin,
        initargs=(os.getpid(), dict(os.environ)),
    )


def _forget_standard_input() -> None:
    """Python calls standard input a file of the script, which workers then look for in vain."""
    script = vars(sys.modules["__main__"])
    file = script.get("__file__")
    if file is not None and not Path(file).exists():
        del script["__file__"]


def _begin(run: int, environment: dict[str, str]) -> None:
    """In a new worker: the run's environment and a process group of its own."""
    os.environ.clear()
    os.environ.update(environment)
    # h5py: before a limit to the memory may keep a trial from being written
    from trajopt.benchmark.store import trial_file as trial_file

    _lead_group(run)
    fork_server.hear_ctrl_c()


def _lead_group(run: int) -> None:
    """Make this process lead a group, which ends with it or with the run."""
    if not hasattr(os, "setsid"):  # not a Unix
        return
    os.setsid()
    watchdog = Path(__file__).with_name("watchdog.py")
    command = [sys.executable, "-I", "-S", str(watchdog), str(os.getpid()), str(run)]
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    _watchdogs.append(process)


def schedule(
    pool: pebble.ProcessPool, task: Task, pickled: bytes, store: Store, allowed: Allowance
) -> Future[None]:
    """Send the task to the pool, which stops it when its time is over."""
    child: Future[None] = pool.schedule(
        _work, args=(pickled, store, allowed), timeout=allowed.timeout * len(task.seeds)
    )
    return child


def _work(pickled: bytes, store: Store, allowed: Allowance) -> None:
    """In the worker process."""
    _hold_to(allowed.memory)
    do(cloudpickle.loads(pickled), store, allowed)


def submit(pool: pebble.ProcessPool, job: Callable[[], None]) -> Future[None]:
    """Send a job that is no trial: it has all the time and memory that there is."""
    child: Future[None] = pool.schedule(_unlimited, args=(job,))
    return child


def _unlimited(job: Callable[[], None]) -> None:
    """In the worker process, which a trial may have been before."""
    _hold_to(None)
    job()


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


def do(task: Task, store: Store, allowed: Allowance) -> None:
    """Run, judge and store the task's trials, in this process."""
    trials = run(task.configuration, task.problem, task.seeds, allowed.as_dict())
    store.write_all(trials, instead=_lost)


def _lost(trial: Trial) -> Trial:
    """Instead of a trial whose answer HDF5 cannot hold, while it says why."""
    message = traceback.format_exc()
    status = Status.CRASHED
    solution = Solution(status, message=message)
    return replace(trial, status=status, message=message, solution=solution, certificate=None)


def record_failure(future: Future[None], task: Task, store: Store, allowed: Allowance) -> None:
    """A worker that hung or died leaves no trials behind; record what happened instead.

    Raises `WorkerError` where no worker ever took the task: that says nothing of its planner.
    """
    error = future.exception()
    if error is None:
        return
    if isinstance(error, StoreError | WorkerError):
        raise error
    if isinstance(error, BrokenExecutor):
        raise WorkerError(_GUARD) from None
    status, message = _ending(error, task, allowed)
    limits = allowed.as_dict()
    for seed, trial_id in task.ids.items():
        if not store.has(trial_id):
            lost = unanswered(task.configuration, task.problem, seed, status, message, limits)
            store.write(lost)


def _ending(error: BaseException, task: Task, allowed: Allowance) -> tuple[Status, str]:
    """What became of a worker, from what its future raised."""
    if isinstance(error, TimeoutError):
        return Status.TIMEOUT, f"stopped after {allowed.timeout * len(task.seeds):g} s"
    if isinstance(error, pebble.ProcessExpired):
        return Status.CRASHED, _obituary(error.exitcode)
    # the planner does not load in another process
    return Status.CRASHED, "".join(traceback.format_exception(error))


def _obituary(exitcode: int) -> str:
    if exitcode == -9:  # SIGKILL
        return "its process was killed, perhaps because the machine ran out of memory"
    return f"its process died with exit code {exitcode}"


@contextmanager
def pool_of(jobs: int) -> Iterator[pebble.ProcessPool]:
    """So many workers, none of which outlives the block."""
    pool = _pool(jobs)
    try:
        with fork_server.uninterrupted():
            _ = pool.active  # starts them
        yield pool
    except BaseException:
        pool.stop()  # type: ignore[no-untyped-call]
        raise
    finally:
        pool.close()  # type: ignore[no-untyped-call]
        pool.join()
