"""Run tasks in this process, in judged processes beside it, or on another program's workers."""

from __future__ import annotations

import atexit
import os
import pickle
import socket
from collections import deque
from collections.abc import Generator, Sequence
from concurrent.futures import Executor, as_completed
from contextlib import suppress
from dataclasses import replace
from multiprocessing.connection import wait
from typing import Any, NamedTuple

import cloudpickle

from trajopt.benchmark.run import answer, server
from trajopt.benchmark.run.judge import Failure, Request, judge_here, record
from trajopt.benchmark.run.solver import Surroundings
from trajopt.benchmark.run.tasks import Allowance, Task
from trajopt.benchmark.store.folder import Store, Written
from trajopt.benchmark.trial import answered, copied, now
from trajopt.core.solution import Status


class Finished(NamedTuple):
    """A task whose trials are stored, and what was written."""

    task: Task
    written: list[Written]


def run(
    tasks: Sequence[Task], store: Store, allowed: Allowance, executor: Executor | None = None
) -> Generator[Finished]:
    """Run tasks and store their trials; yield each task when it has finished.

    Close the iterator to stop what still runs.
    """
    if executor is not None:
        return on_executor(tasks, store, allowed, executor)
    if allowed.jobs > 0:
        return in_children(tasks, store, allowed)
    return here(tasks, store, allowed)


def here(tasks: Sequence[Task], store: Store, allowed: Allowance) -> Generator[Finished]:
    """Run the tasks in this process, unsupervised."""
    for task in tasks:
        started = now()
        answers = answered(task.configuration.planner, copied(task.problem), task.seeds)
        plain = answer.unpacked(answer.packed(answers), len(task.seeds))
        request = _request(task, b"", store, allowed)
        yield Finished(task, judge_here(request, plain, started))


def in_children(tasks: Sequence[Task], store: Store, allowed: Allowance) -> Generator[Finished]:
    """Run `allowed.jobs` tasks at a time, each planner in a process that a judge supervises."""
    waiting = _requests(tasks, store, allowed)
    idle: list[_Judge] = []
    busy: dict[_Judge, tuple[Task, Request]] = {}
    try:
        while waiting or busy:
            while waiting and len(busy) < allowed.jobs:
                judge = idle.pop() if idle else _Judge()
                task, request = waiting.popleft()
                busy[judge] = task, request
                judge.ask(request)
            ready = wait([judge.link for judge in busy])
            for judge in [judge for judge in busy if judge.link in ready]:
                task, request = busy[judge]
                written = judge.answer()
                del busy[judge]
                if written is not None:
                    idle.append(judge)
                yield Finished(task, _or_lost(written, request))
    finally:
        for judge in [*idle, *busy]:
            judge.end()


def on_executor(
    tasks: Sequence[Task], store: Store, allowed: Allowance, executor: Executor
) -> Generator[Finished]:
    """Run the tasks on an executor's workers, each of which has judges of its own."""
    futures = {}
    for task, request in _requests(tasks, store, allowed):
        futures[executor.submit(supervised, request)] = task
    try:
        for future in as_completed(futures):
            yield Finished(futures[future], future.result())
    finally:
        for future in futures:
            future.cancel()


def supervised(request: Request) -> list[Written]:
    """Run a request under a judge of this process, which is an executor's worker."""
    own = _idle.setdefault(os.getpid(), [])
    try:
        judge = own.pop()
    except IndexError:
        judge = _Judge()
    judge.ask(request)
    written = judge.answer()
    if written is not None:
        own.append(judge)
    return _or_lost(written, request)


class _Judge:
    """A judge process, as the run sees it."""

    def __init__(self) -> None:
        self.link = server.judge()
        self._stream: Any = self.link.makefile("rwb")
        here = Surroundings.here()
        environment = {**here.environment, **server.SINGLE_THREADED}
        pickle.dump(replace(here, environment=environment), self._stream)

    def ask(self, request: Request) -> None:
        """Send a request."""
        message = pickle.dumps(request)
        with suppress(OSError):  # a judge that died has no answer
            self._stream.write(message)
            self._stream.flush()

    def answer(self) -> list[Written] | None:
        """Wait for what was written; None if the judge was killed.

        Raises:
            Exception: What the judge failed at, such as a full disk.
        """
        try:
            done = pickle.load(self._stream)
        except (EOFError, OSError, pickle.UnpicklingError):
            return None
        if isinstance(done, Failure):
            raise done.error
        written: list[Written] = done
        return written

    def end(self) -> None:
        """Hang up, which ends the judge and its planner, and wait until it has ended."""
        with suppress(OSError):
            self.link.shutdown(socket.SHUT_WR)
            while self.link.recv(1 << 16):
                pass
        with suppress(OSError):
            self._stream.close()
        self.link.close()


# Idle judges of an executor's worker, by the worker's process.
_idle: dict[int, list[_Judge]] = {}


@atexit.register
def _end_idle() -> None:
    for judge in _idle.pop(os.getpid(), []):
        judge.end()


def _or_lost(written: list[Written] | None, request: Request) -> list[Written]:
    if written is not None:
        return written
    message = "the process that judged it was killed, perhaps by the planner"
    return record(request, Status.CRASHED, message)


def _requests(
    tasks: Sequence[Task], store: Store, allowed: Allowance
) -> deque[tuple[Task, Request]]:
    """Return a request for each task, the longest first.

    Requests of one planner are neighbours: a judge keeps the planner's process.
    """
    pickled: dict[int, bytes] = {}
    for task in tasks:
        planner = task.configuration.planner
        if id(planner) not in pickled:
            pickled[id(planner)] = cloudpickle.dumps(planner)
    turns = list(pickled)

    def rank(task: Task) -> tuple[int, int]:
        return -len(task.seeds), turns.index(id(task.configuration.planner))

    requests: deque[tuple[Task, Request]] = deque()
    for task in sorted(tasks, key=rank):
        planner_bytes = pickled[id(task.configuration.planner)]
        requests.append((task, _request(task, planner_bytes, store, allowed)))
    return requests


def _request(task: Task, planner: bytes, store: Store, allowed: Allowance) -> Request:
    entrant = task.configuration.entrant
    return Request(entrant, task.problem, task.seeds, planner, store, allowed)
