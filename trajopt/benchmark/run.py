"""The resumable loop over problem × planner × seed, in supervised child processes.

Each worker writes its trials itself, one file per finished trial, so nothing that finished can be
lost; running again does only what is missing. A planner that raises, hangs or takes its process
down is a recorded trial, and the run goes on.
"""

from __future__ import annotations

import multiprocessing
import os
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from multiprocessing.util import Finalize
from pathlib import Path
from typing import TYPE_CHECKING

import cloudpickle
import pebble

from trajopt.benchmark.store import Store, read
from trajopt.benchmark.trial import failed, judge, provenance, trial_id
from trajopt.exceptions import StoreError, WorkerError
from trajopt.gap import references
from trajopt.planner import Planner, entries, options
from trajopt.problem import Problem
from trajopt.solution import Solution, Status

if TYPE_CHECKING:
    from trajopt.benchmark.results import Results

Progress = Callable[[int], None]  # called with the number of trials that just finished

_thread = threading.local()
_BATCH = 15  # seeds solved together at most: large enough to be fast, small enough to lose little


@dataclass(frozen=True)
class Task:
    """Some seeds of one planner on one problem."""

    problem: Problem
    name: str
    planner: Planner
    seeds: tuple[int, ...]

    def trial_id(self, seed: int) -> str:
        release = provenance()["trajopt"]
        return trial_id(self.problem, self.name, options(self.planner), seed, release)


def compare(
    problems: Sequence[Problem],
    planners: Sequence[tuple[str, Planner]],
    folder: Path | str,
    *,
    seeds: int = 30,
    jobs: int = 0,
    fresh: bool = False,
    timeout: float = 600.0,
    progress: Progress = lambda _: None,
    executor: Executor | None = None,
) -> Results:
    """Run every planner on every problem, keep every trial, return those that were asked for.

    `planners` are `(name, planner)` pairs; stochastic ones run with seeds 0 … `seeds − 1`, the
    others once. The references that a problem needs join them, since gaps need those. Trials
    already in `folder` are not run again unless `fresh`. `jobs` child processes run the trials,
    each for at most `timeout` seconds; with 0 they run in this process, unsupervised. An
    `executor` (any of `concurrent.futures`, or a Dask client's) runs them instead of `jobs`; its
    workers must see `folder`, and supervise each trial in a child process of their own.

    Raises `StoreError` if the folder cannot be written.
    """
    from trajopt.benchmark.results import Results  # pandas, SciPy's statistics: not for workers

    store = Store(Path(folder))
    tasks = plan(problems, planners, seeds)
    done = set() if fresh else store.finished()
    todo = [batch for task in tasks for batch in _missing(task, done)]
    finished = sum(len(task.seeds) for task in tasks) - sum(len(task.seeds) for task in todo)
    progress(finished)
    where = partial(_run_on, executor) if executor else partial(_run, jobs)
    for count in where(todo, store, timeout):
        progress(count)
    asked = {task.trial_id(seed) for task in tasks for seed in task.seeds}
    return Results(read(store.consolidate(), asked))


def plan(
    problems: Sequence[Problem], planners: Sequence[tuple[str, Planner]], seeds: int
) -> list[Task]:
    """One task per problem and planner with all its seeds, references too; identical ones once."""
    tasks: dict[str, Task] = {}
    for problem in problems:
        for name, planner in [*planners, *_references(problem, {name for name, _ in planners})]:
            stochastic = getattr(planner, "stochastic", False)
            task = Task(problem, name, planner, tuple(range(seeds if stochastic else 1)))
            tasks.setdefault(task.trial_id(0), task)
    return list(tasks.values())


def _references(problem: Problem, given: set[str]) -> list[tuple[str, Planner]]:
    """The planners whose answer gaps are measured against, unless they are given already."""
    names = [n for n in references(problem) if n in entries() and n not in given]
    return [(name, entries()[name].load()) for name in names]


def _missing(task: Task, done: set[str]) -> Iterator[Task]:
    """The task's unfinished seeds, in batches for planners that advance them together."""
    seeds = [seed for seed in task.seeds if task.trial_id(seed) not in done]
    size = _BATCH if hasattr(task.planner, "solve_batch") else 1
    for start in range(0, len(seeds), size):
        yield replace(task, seeds=tuple(seeds[start : start + size]))


def _run(jobs: int, tasks: Sequence[Task], store: Store, timeout: float) -> Iterator[int]:
    """Run the tasks, longest first, and yield how many trials each one finished."""
    if jobs == 0:
        for task in tasks:
            _do(task, store)
            yield len(task.seeds)
        return
    with _single_threaded(), _pool(min(jobs, max(1, len(tasks)))) as pool:
        futures: dict[Future[None], Task] = {
            pool.schedule(
                _work, args=(cloudpickle.dumps(task), store), timeout=timeout * len(task.seeds)
            ): task
            for task in sorted(tasks, key=lambda task: -len(task.seeds))
        }
        for future in as_completed(futures):
            _record_failure(future, futures[future], store, timeout)
            yield len(futures[future].seeds)


def _run_on(
    executor: Executor, tasks: Sequence[Task], store: Store, timeout: float
) -> Iterator[int]:
    """The same on someone else's workers, which write their own trial files."""
    ordered = sorted(tasks, key=lambda task: -len(task.seeds))
    futures = {
        executor.submit(_supervised, cloudpickle.dumps(task), store, timeout): task
        for task in ordered
    }
    try:
        for future in as_completed(futures):
            _record_failure(future, futures[future], store, timeout)
            yield len(futures[future].seeds)
    except BaseException:
        for future in futures:
            if not future.done():
                future.cancel()
        raise


def _supervised(pickled: bytes, store: Store, timeout: float) -> None:
    """In an executor's worker: the task in a child process, which may hang or die.

    Raises `WorkerError` where the worker may not have children.
    """
    if multiprocessing.current_process().daemon:
        raise WorkerError(
            "a worker that is a daemon cannot supervise trials; start Dask's workers with "
            "DASK_DISTRIBUTED__WORKER__DAEMON=False in their environment"
        )
    task = cloudpickle.loads(pickled)
    with _single_threaded():
        child = _own_pool().schedule(_work, (pickled, store), timeout=timeout * len(task.seeds))
        _record_failure(child, task, store, timeout)


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


def _work(pickled: bytes, store: Store) -> None:
    """In the worker process."""
    _do(cloudpickle.loads(pickled), store)


def _do(task: Task, store: Store) -> None:
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


def _record_failure(future: Future[None], task: Task, store: Store, timeout: float) -> None:
    """A worker that hung or died leaves no trials behind; record what happened instead."""
    error = future.exception()
    if error is None:
        return
    if isinstance(error, StoreError | WorkerError):
        raise error
    if isinstance(error, TimeoutError):
        status, message = Status.TIMEOUT, f"stopped after {timeout * len(task.seeds):g} s"
    elif isinstance(error, pebble.ProcessExpired):
        status, message = Status.CRASHED, f"its process died with exit code {error.exitcode}"
    else:  # the planner does not load in another process
        status, message = Status.CRASHED, "".join(traceback.format_exception(error))
    for seed in task.seeds:
        if not store.has(task.trial_id(seed)):
            store.write(failed(task.planner, task.problem, seed, task.name, status, message))


@contextmanager
def _pool(jobs: int) -> Iterator[pebble.ProcessPool]:
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
def _single_threaded() -> Iterator[None]:
    """Children inherit one thread each for linear algebra, so that jobs do not fight for cores."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            os.environ.pop(name) if value is None else os.environ.update({name: value})
