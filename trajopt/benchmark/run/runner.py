"""Tasks run in this process, by judges of this machine, or on someone else's workers."""

from __future__ import annotations

import atexit
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future, as_completed
from typing import NamedTuple

import cloudpickle

from trajopt.benchmark.run import answer
from trajopt.benchmark.run.judge import Request, judge_here, record
from trajopt.benchmark.run.plan import Allowance, Task
from trajopt.benchmark.run.pool import JudgeDied, Judges, Pool
from trajopt.benchmark.store.folder import Store, Written
from trajopt.benchmark.trial import answered, copied, now
from trajopt.core.solution import Status

_judges = Judges()  # of an executor's worker
atexit.register(_judges.end)


class Finished(NamedTuple):
    """A task whose trials are stored, and what was written."""

    task: Task
    written: list[Written]


def here(tasks: Sequence[Task], store: Store, allowed: Allowance) -> Iterator[Finished]:
    """Run the tasks in this process, unsupervised; yields each when it has finished."""
    for task in tasks:
        started = now()
        planner = task.configuration.planner
        answers = answered(planner, copied(task.problem), task.seeds)
        plain = answer.unpacked(answer.packed(answers), len(task.seeds))
        request = _request(task, b"", store, allowed)
        yield Finished(task, judge_here(request, plain, started))


def in_children(
    tasks: Sequence[Task], store: Store, allowed: Allowance, pool: Pool
) -> Iterator[Finished]:
    """The same in solver processes that judges supervise, longest tasks first."""
    futures = {
        pool.submit(request): (task, request) for task, request in _requests(tasks, store, allowed)
    }
    yield from _finished(futures)


def on_executor(
    tasks: Sequence[Task], store: Store, allowed: Allowance, executor: Executor
) -> Iterator[Finished]:
    """The same on someone else's workers, each of which has judges of its own."""
    futures = {
        executor.submit(supervised, request): (task, request)
        for task, request in _requests(tasks, store, allowed)
    }
    try:
        yield from _finished(futures)
    except BaseException:
        for future in futures:
            if not future.done():
                future.cancel()
        raise


def supervised(request: Request) -> list[Written]:
    """In an executor's worker: the task in a solver process, which may hang or die."""
    try:
        written: list[Written] = _judges.ask(request)
    except JudgeDied:
        return lost(request)
    return written


def lost(request: Request) -> list[Written]:
    """Store that a judge ended, and with it what it was at."""
    message = "the process that judged it was killed, perhaps by the planner"
    return record(request, Status.CRASHED, message)


def _requests(
    tasks: Sequence[Task], store: Store, allowed: Allowance
) -> Iterator[tuple[Task, Request]]:
    """Longest first; those of one planner together, since a judge keeps its process."""
    planners = [task.configuration.planner for task in tasks]
    turns = {id(planner): turn for turn, planner in enumerate(planners)}
    pickled = {id(planner): b"" for planner in planners}
    for task in sorted(tasks, key=lambda t: (-len(t.seeds), turns[id(t.configuration.planner)])):
        planner = task.configuration.planner
        pickled[id(planner)] = pickled[id(planner)] or cloudpickle.dumps(planner)
        yield task, _request(task, pickled[id(planner)], store, allowed)


def _request(task: Task, planner: bytes, store: Store, allowed: Allowance) -> Request:
    entrant = task.configuration.entrant
    return Request(entrant, task.problem, task.seeds, planner, store, allowed)


def _finished(
    futures: dict[Future[list[Written]], tuple[Task, Request]],
) -> Iterator[Finished]:
    for future in as_completed(futures):
        task, request = futures[future]
        try:
            written = future.result()
        except JudgeDied:
            written = lost(request)
        yield Finished(task, written)
