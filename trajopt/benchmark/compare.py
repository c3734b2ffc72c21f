"""The resumable loop over problem × planner × seed, in supervised child processes.

Each worker writes its trials itself, one file per finished trial, so nothing that finished can be
lost; running again does only what is missing. A planner that raises, hangs or takes its process
down is a recorded trial, and the run goes on.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import cloudpickle

from trajopt.benchmark.run import workers
from trajopt.benchmark.run.workers import Allowance, Task
from trajopt.benchmark.store.folder import Store, read
from trajopt.explain.references import references
from trajopt.planner import Planner, adapted
from trajopt.problem import Problem
from trajopt.registry import entries

if TYPE_CHECKING:
    from trajopt.benchmark.analysis.results import Results

Progress = Callable[[int], None]  # called with the number of trials that just finished

_BATCH = 15  # seeds solved together at most: large enough to be fast, small enough to lose little


def compare(
    problems: Sequence[Problem],
    planners: Sequence[tuple[str, Planner]],
    folder: Path | str,
    *,
    seeds: int = 30,
    jobs: int = 0,
    fresh: bool = False,
    timeout: float = 600.0,
    memory: float | None = None,
    progress: Progress = lambda _: None,
    executor: Executor | None = None,
) -> Results:
    """Run every planner on every problem, keep every trial, return those that were asked for.

    `planners` are `(name, planner)` pairs; stochastic ones run with seeds 0 … `seeds − 1` on the
    problems that they support, everything else once. The references that a problem needs join
    them, since gaps need those. Trials already in `folder` are not run again unless `fresh`. `jobs`
    child processes run the trials, each for at most `timeout` seconds, and with at most `memory`
    GiB where the system can hold it to that (Linux); with 0 they run in this process, unsupervised.
    An `executor` (any of `concurrent.futures`, or a Dask client's) runs them instead of `jobs`; its
    workers must see `folder`, and supervise each trial in a child process of their own.

    Raises `StoreError` if the folder cannot be written.
    """
    from trajopt.benchmark.analysis.results import (
        Results,  # pandas, SciPy's statistics: not for workers
    )

    store = Store(Path(folder))
    tasks = plan(problems, planners, seeds)
    done = set() if fresh else store.finished()
    todo = [batch for task in tasks for batch in _missing(task, done)]
    finished = sum(len(task.seeds) for task in tasks) - sum(len(task.seeds) for task in todo)
    progress(finished)
    where = partial(_run_on, executor) if executor else partial(_run, jobs)
    for count in where(todo, store, Allowance(timeout, memory)):
        progress(count)
    asked = {task.trial_id(seed) for task in tasks for seed in task.seeds}
    return Results(read(store.consolidate(), asked))


def plan(
    problems: Sequence[Problem], planners: Sequence[tuple[str, Planner]], seeds: int
) -> list[Task]:
    """One task per problem and planner with all its seeds, references too; identical ones once."""
    given = [(name, adapted(planner)) for name, planner in planners]
    tasks: dict[str, Task] = {}
    for problem in problems:
        for name, planner in [*given, *_references(problem, {name for name, _ in given})]:
            runs = seeds if _varies(planner, problem) else 1
            task = Task(problem, name, planner, tuple(range(runs)))
            tasks.setdefault(task.trial_id(0), task)
    return list(tasks.values())


def _varies(planner: Planner, problem: Problem) -> bool:
    """Whether another seed may give another answer; a refusal needs no second trial."""
    try:
        return planner.stochastic and planner.unsupported(problem) is None
    except Exception:  # its trials will say so
        return True


def _references(problem: Problem, given: set[str]) -> list[tuple[str, Planner]]:
    """The planners whose answer gaps are measured against, unless they are given already."""
    names = [n for n in references(problem) if n in entries() and n not in given]
    return [(name, entries()[name].load()) for name in names]


def _missing(task: Task, done: set[str]) -> Iterator[Task]:
    """The task's unfinished seeds, in batches for planners that advance them together."""
    seeds = [seed for seed in task.seeds if task.trial_id(seed) not in done]
    size = _BATCH if task.planner.batched else 1
    for start in range(0, len(seeds), size):
        yield replace(task, seeds=tuple(seeds[start : start + size]))


def _run(jobs: int, tasks: Sequence[Task], store: Store, allowed: Allowance) -> Iterator[int]:
    """Run the tasks, longest first, and yield how many trials each one finished."""
    if jobs == 0:
        for task in tasks:
            workers.do(task, store)
            yield len(task.seeds)
        return
    with workers.single_threaded(), workers.pool_of(min(jobs, max(1, len(tasks)))) as pool:
        futures: dict[Future[None], Task] = {
            workers.schedule(pool, task, cloudpickle.dumps(task), store, allowed): task
            for task in sorted(tasks, key=lambda task: -len(task.seeds))
        }
        for future in as_completed(futures):
            workers.record_failure(future, futures[future], store, allowed)
            yield len(futures[future].seeds)


def _run_on(
    executor: Executor, tasks: Sequence[Task], store: Store, allowed: Allowance
) -> Iterator[int]:
    """The same on someone else's workers, which write their own trial files."""
    ordered = sorted(tasks, key=lambda task: -len(task.seeds))
    futures = {
        executor.submit(workers.supervised, cloudpickle.dumps(task), store, allowed): task
        for task in ordered
    }
    try:
        for future in as_completed(futures):
            workers.record_failure(future, futures[future], store, allowed)
            yield len(futures[future].seeds)
    except BaseException:
        for future in futures:
            if not future.done():
                future.cancel()
        raise


def cpus() -> int:
    """The CPUs this process may use; all of them where the system does not say."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
