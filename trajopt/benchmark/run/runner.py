"""Tasks run in this process, in supervised child processes, or on someone else's workers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed

import cloudpickle

from trajopt.benchmark.run import workers
from trajopt.benchmark.run.plan import Allowance, Task
from trajopt.benchmark.run.pool import Pool
from trajopt.benchmark.store.folder import Store


def here(tasks: Sequence[Task], store: Store) -> Iterator[Task]:
    """Run the tasks in this process, unsupervised; yields each when it has finished."""
    for task in tasks:
        workers.do(task, store, Allowance())
        yield task


def in_children(
    tasks: Sequence[Task], store: Store, allowed: Allowance, pool: Pool
) -> Iterator[Task]:
    """The same in supervised child processes, longest tasks first."""
    if not tasks:
        return
    processes = pool.processes(most=len(tasks))
    futures = {
        workers.schedule(processes, task, cloudpickle.dumps(task), store, allowed): task
        for task in _longest_first(tasks)
    }
    yield from _finished(futures, store, allowed)


def on_executor(
    tasks: Sequence[Task], store: Store, allowed: Allowance, executor: Executor
) -> Iterator[Task]:
    """The same on someone else's workers, which write their own trial files."""
    futures = {
        executor.submit(workers.supervised, cloudpickle.dumps(task), store, allowed): task
        for task in _longest_first(tasks)
    }
    try:
        yield from _finished(futures, store, allowed)
    except BaseException:
        for future in futures:
            if not future.done():
                future.cancel()
        raise


def _longest_first(tasks: Sequence[Task]) -> list[Task]:
    return sorted(tasks, key=lambda task: -len(task.seeds))


def _finished(
    futures: dict[Future[None], Task], store: Store, allowed: Allowance
) -> Iterator[Task]:
    for future in as_completed(futures):
        task = futures[future]
        workers.record_failure(future, task, store, allowed)
        yield task
