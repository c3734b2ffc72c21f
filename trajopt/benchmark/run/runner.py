"""Run tasks in this process, in judged processes beside it, or on another program's workers."""

from __future__ import annotations

import atexit
import os
import pickle
import platform
import socket
import time
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Executor
from concurrent.futures import wait as wait_for
from contextlib import closing, suppress
from dataclasses import replace
from itertools import islice
from math import inf
from multiprocessing.connection import wait
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import cloudpickle

from trajopt.benchmark.provenance import judge_digest
from trajopt.benchmark.run import answer, dask, server
from trajopt.benchmark.run.judge import (
    Ending,
    Inquiry,
    JudgeError,
    Request,
    Requests,
    judge_here,
    record,
)
from trajopt.benchmark.run.processes import cpus
from trajopt.benchmark.run.profile import Profile
from trajopt.benchmark.run.solver import Describe, Surroundings
from trajopt.benchmark.run.tasks import HAS_JUDGES, OWN_PROCESS, Allowance, Task, missing, together
from trajopt.benchmark.store.folder import Store, Written
from trajopt.benchmark.trial import (
    Answers,
    Configuration,
    Trial,
    answered,
    answered_many,
    copied,
    now,
)
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput, TrajoptError, WorkerError
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.planners.planner import Planner
from trajopt.planners.registry import find

IMPORT_TIMEOUT_S = 60.0  # for a stranger's planner to be imported and described
MIN_JUDGING_TIMEOUT_S = 120.0  # beyond the time of the trials that a judge asks for
_END_TIMEOUT_S = 30.0  # for a judge to end
_KILLED = "the process that judged it was killed, perhaps by the planner"
_NEVER = "the process that judged it took too long, or was stopped, perhaps by the planner"
_LOOK_INTERVAL_S = 5.0  # between two looks whether an executor has workers
_MAX_IDLE = 1  # judges that an executor's worker keeps


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
    for group in together(tasks, 1):
        started = now()
        for task, answers in zip(group, _answers(group), strict=True):
            plain = answer.unpacked(answer.packed(answers), len(task.seeds))
            timed = replace(answers, solutions=plain.solutions, relation=plain.relation)
            request = _request(task, b"", store, allowed)
            yield Finished(task, judge_here([request], [timed], started))


def _answers(group: Sequence[Task]) -> Iterator[Answers]:
    """Yield the answers to tasks of one planner, asked together if it takes many."""
    planner = group[0].profile.planner
    if len(group) > 1:
        problems = [copied(task.problem) for task in group]
        with suppress(Exception, SystemExit):  # asked one by one, the crash is recorded
            yield from answered_many(planner, problems, [task.seeds[0] for task in group])
            return
    for task in group:
        yield answered(planner, copied(task.problem), task.seeds)


def in_children(tasks: Sequence[Task], store: Store, allowed: Allowance) -> Generator[Finished]:
    """Run `allowed.jobs` tasks at a time, each planner in a process that a judge supervises."""
    server.load({name for task in tasks for name in task.profile.requires})
    with closing(Judges()) as judges:
        yield from judges.run(tasks, store, allowed)


class Judges:
    """Judge processes of this machine. Each serves one planner, and waits for its next tasks."""

    def __init__(self) -> None:
        self._idle: list[_Judge] = []
        self._busy: dict[_Judge, Group] = {}

    def run(self, tasks: Sequence[Task], store: Store, allowed: Allowance) -> Generator[Finished]:
        """Run `allowed.jobs` tasks at a time."""
        waiting = _requests(tasks, store, allowed)
        busy = self._busy
        while waiting or busy:
            while waiting and len(busy) < allowed.jobs:
                asked = waiting.popleft()
                judge = self._for(asked.request, allowed.jobs)
                busy[judge] = asked
                judge.ask(asked.request)
            first = min(judge.deadline for judge in busy)
            left = None if first == inf else max(0.0, first - time.monotonic())
            ready = wait([judge.link for judge in busy], left)
            late = time.monotonic()
            for judge in [own for own in busy if own.link in ready or own.deadline <= late]:
                asked = busy[judge]
                done = judge.answer()
                del busy[judge]
                if isinstance(done, list):
                    self._idle.append(judge)
                else:
                    judge.end()
                    if len(asked.tasks) > 1:  # one of them cost the others nothing but time
                        waiting.extendleft(reversed(asked.alone()))
                        continue
                yield from asked.finished(done)

    def _for(self, request: Request | Requests, jobs: int) -> _Judge:
        """Return the idle judge of a planner, or a new one in place of an idle one of another."""
        source = _source(request)
        for judge in self._idle:
            if judge.source == source:
                self._idle.remove(judge)
                return judge
        if len(self._idle) + len(self._busy) >= jobs:
            self._idle.pop(0).end()
        return _Judge(source)

    def close(self) -> None:
        """End all judges, and what they still run."""
        for judge in [*self._idle, *self._busy]:
            judge.end()


def on_executor(
    tasks: Sequence[Task], store: Store, allowed: Allowance, executor: Executor
) -> Generator[Finished]:
    """Run the tasks on an executor's workers, each of which has judges of its own.

    Raises:
        WorkerError: The executor has lost its workers, or one of them judges by other code.
    """
    tasks_of = {}
    for asked in _requests(tasks, store, allowed):
        tasks_of[executor.submit(supervised, asked.request)] = asked
    look = dask.watch(executor)
    left = set(tasks_of)
    try:
        while left:
            done, left = wait_for(left, _LOOK_INTERVAL_S, FIRST_COMPLETED)
            for future in done:
                yield from tasks_of[future].finished(future.result())
            if not done:
                look()
    except (CancelledError, BrokenExecutor) as error:
        raise WorkerError("the executor was lost; what has finished is kept") from error
    finally:
        for future in tasks_of:
            future.cancel()


def supervised(request: Request | Requests) -> list[Written]:
    """Run a request under a judge of this process, which is an executor's worker.

    Raises:
        WorkerError: The worker's installation judges by other code than the run's.
    """
    parts = request.requests if isinstance(request, Requests) else (request,)
    if any(judge_digest(part.problem) != part.digest for part in parts):
        raise WorkerError(
            f"a worker on {platform.node()} has another version of trajopt than this run; install "
            "the same there"
        )
    source = _source(request)
    own = _idle.setdefault(os.getpid(), [])
    known = [judge for judge in own if judge.source == source]
    judge = known[0] if known else _Judge(source)
    if known:
        own.remove(judge)
    judge.ask(request)
    done = judge.answer()
    if isinstance(done, list):
        own.append(judge)
    else:
        judge.end()
    while len(own) > _MAX_IDLE:
        own.pop(0).end()
    if isinstance(request, Requests) and not isinstance(done, list):
        return [written for part in parts for written in supervised(part)]
    return _or_lost(done, parts[0])


def profiled(contestant: object, problems: Sequence[Problem], allowed: Allowance) -> Profile:
    """Describe a planner, a spec, or a pair of a name and a planner.

    A stranger's code is imported in a process of its own: no longer than a trial may take, nor
    than `IMPORT_TIMEOUT_S`.

    Raises:
        TrajoptError: There is no such planner, or it cannot be imported or described.
    """
    if not isinstance(contestant, str):
        configuration = Configuration.given(contestant)
        return Profile.of(configuration, configuration.planner, problems)
    spec = find(contestant)
    if spec.is_own or not HAS_JUDGES:
        return Profile.of(Configuration.given(contestant), spec.text, problems)
    limited = replace(allowed, timeout=min(allowed.timeout, IMPORT_TIMEOUT_S))
    judge = _Judge("")
    try:
        judge.ask(Inquiry(Describe(spec.text, tuple(problems)), limited))
        said = judge.answer()
    finally:
        judge.end()
    if isinstance(said, bytes):
        return Profile.read(said, spec)
    assert isinstance(said, Ending)
    raise TrajoptError(f"planner {contestant!r} cannot be loaded: {said.message}")


class Supervised(Planner):
    """A planner that runs in a process of its own, under a judge, and answers here.

    Args:
        contestant: A planner, a spec, or a pair of a name and a planner.
        problem: That it will be asked first.
        jobs: How many trials run side by side.
        timeout: Wall time of a trial, s, after which it is stopped.
    """

    def __init__(
        self, contestant: object, problem: Problem, jobs: int = 1, timeout: float = inf
    ) -> None:
        self._allowed = Allowance(timeout, jobs=jobs, isolation=OWN_PROCESS, echo=True)
        if not HAS_JUDGES:
            self._allowed = Allowance()
        self.profile = profiled(contestant, [problem], self._allowed)
        self.stochastic = self.profile.stochastic
        # the planner itself says in its process what it leaves out
        self.knows = (*KINDS, *DEMANDS, "segment")
        self._judges = Judges()

    def trials(self, problem: Problem, seeds: Sequence[int]) -> list[Trial]:
        """Run it on a problem; return the judged answers, one a seed."""
        task = Task(problem, self.profile, tuple(seeds))
        with TemporaryDirectory(prefix="trajopt-") as folder:
            store = Store(Path(folder))
            tasks = list(missing(task, set()))
            run = here if self._allowed.jobs == 0 else self._judges.run
            found = [one for done in run(tasks, store, self._allowed) for one in done.written]
        trials = [one.trial for one in found]
        return sorted(trials, key=lambda trial: trial.seed)

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """Return its answer, before anyone has checked it."""
        return self.trials(problem, [seed])[0].solution

    def close(self) -> None:
        """End its processes."""
        self._judges.close()


class _Judge:
    """A judge process, as the run sees it, and the source of its planner."""

    def __init__(self, source: str | bytes) -> None:
        self.source = source
        self.deadline = inf  # of the answer, on the monotonic clock
        self.link = server.judge_link()
        self._stream: Any = self.link.makefile("rwb")
        here = Surroundings.here()
        environment = {**here.environment, **server.SINGLE_THREADED}
        pickle.dump(replace(here, environment=environment), self._stream)

    def ask(self, request: Request | Requests | Inquiry) -> None:
        """Send a request."""
        message = pickle.dumps(request)
        self.deadline = time.monotonic() + _patience(request)
        with suppress(OSError):  # a judge that died has no answer
            self._stream.write(message)
            self._stream.flush()

    def answer(self) -> list[Written] | bytes | Ending:
        """Wait for what was written, or described, or how the judge ended without an answer.

        Raises:
            Exception: What the judge failed at, such as a full disk.
        """
        left = None if self.deadline == inf else max(0.0, self.deadline - time.monotonic())
        if not wait([self.link], left):
            return Ending(Status.CRASHED, _NEVER)
        self.link.settimeout(_END_TIMEOUT_S)  # for the rest of an answer that has begun
        try:
            done = pickle.load(self._stream)
            self.link.settimeout(None)
        except (EOFError, OSError, pickle.UnpicklingError):
            return Ending(Status.CRASHED, _KILLED)
        if isinstance(done, JudgeError):
            raise done.error
        answer: list[Written] | bytes | Ending = done
        return answer

    def end(self) -> None:
        """Hang up, which ends the judge and its planner, and wait until it has ended."""
        with suppress(OSError):
            self.link.settimeout(_END_TIMEOUT_S)
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


def _patience(request: Request | Requests | Inquiry) -> float:
    """Return how long a judge may take to answer, s: to ask, and to judge."""
    if isinstance(request, Requests):
        own = request.requests[0].allowed.timeout  # together, before each is asked alone
        return own + sum(map(_patience, request.requests))
    count = len(request.seeds) if isinstance(request, Request) else 1
    asking = request.allowed.timeout * count
    return asking + max(MIN_JUDGING_TIMEOUT_S, asking)


def _source(request: Request | Requests) -> str | bytes:
    """Return what makes the planner of a request."""
    return (request.requests[0] if isinstance(request, Requests) else request).source


def _or_lost(done: list[Written] | bytes | Ending, request: Request) -> list[Written]:
    if isinstance(done, Ending):
        return record(request, done.status, done.message)
    assert isinstance(done, list)
    return done


class Group(NamedTuple):
    """Tasks that are asked together, and the request of each."""

    tasks: Sequence[Task]
    requests: tuple[Request, ...]

    @property
    def request(self) -> Request | Requests:
        return self.requests[0] if len(self.requests) == 1 else Requests(self.requests)

    def alone(self) -> list[Group]:
        """Return each task alone."""
        pairs = zip(self.tasks, self.requests, strict=True)
        return [Group([task], (request,)) for task, request in pairs]

    def finished(self, done: list[Written] | bytes | Ending) -> Iterator[Finished]:
        """Yield each task with what was written of it."""
        written = iter(_or_lost(done, self.requests[0]))
        for task in self.tasks:
            yield Finished(task, list(islice(written, len(task.seeds))))


def _requests(tasks: Sequence[Task], store: Store, allowed: Allowance) -> deque[Group]:
    """Return the requests: single runs, whose answers come at once, then the longest.

    Requests of one planner are neighbours: a judge keeps the planner's process.
    """
    made: dict[int, str | bytes] = {}
    for task in tasks:
        if id(task.profile) not in made:
            made[id(task.profile)] = _pickled(task.profile)
    turns = list(made)

    def rank(task: Task) -> tuple[bool, int, int]:
        return len(task.seeds) > 1, -len(task.seeds), turns.index(id(task.profile))

    def asked(group: Sequence[Task]) -> Group:
        sources = [made[id(task.profile)] for task in group]
        pairs = zip(group, sources, strict=True)
        return Group(group, tuple(_request(task, own, store, allowed) for task, own in pairs))

    groups = together(sorted(tasks, key=rank), allowed.jobs or cpus())
    return deque(asked(group) for group in groups)


def _pickled(profile: Profile) -> str | bytes:
    """Return what a process makes the planner from: its spec, or the object pickled."""
    if isinstance(profile.source, str):
        return profile.source
    try:
        pickled: bytes = cloudpickle.dumps(profile.source)
    except Exception as error:
        right = f"an object that can be pickled, or jobs=0 ({type(error).__name__}: {error})"
        raise InvalidInput(f"planner {profile.entrant.label}", right) from error
    return pickled


def _request(task: Task, source: str | bytes, store: Store, allowed: Allowance) -> Request:
    for key, limit in task.problem.limits.kinds.items():
        if type(limit).__module__ == "__main__":
            right = "a kind in a file of its own: the process that judges cannot import this one"
            raise InvalidInput(f"limits.{key}", right, value="a class of this script")
    digest = judge_digest(task.problem)
    entrant = task.profile.entrant
    return Request(entrant, task.problem, task.seeds, source, store, allowed, digest)
