"""The process that judges: it never runs a planner's code, so that what it finds is believed.

It is forked from the server (`server.py`), does what the run asks until the run ends, and has one
solver process at a time (`solver.py`): for each planner with its options a new one. What that
answers is plain data; the judge verifies it on the run's own problem, writes the trials, and sends
them to the run. Whatever a planner started ends with its solver process.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from types import FrameType
from typing import Any, NamedTuple, NoReturn

from trajopt.benchmark.run import answer, processes, solver
from trajopt.benchmark.run.plan import Allowance
from trajopt.benchmark.run.solver import Question, Surroundings
from trajopt.benchmark.store.columns import harmless
from trajopt.benchmark.store.folder import Store, Written
from trajopt.benchmark.trial import (
    OUT_OF_MEMORY,
    Answers,
    Entrant,
    Trial,
    crash,
    judged,
    now,
    unanswered,
)
from trajopt.core.exceptions import WorkerError
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status

_CHUNK = 1 << 16  # bytes read at once
_TAIL = 4096  # bytes of what a planner printed that are kept
_TAIL_LINES = 10
_LOOK = 0.1  # s between two looks at the memory in use
_VERIFYING = 60.0  # s that verifying answers may take at least
_CLOCK_SLACK = 0.5  # s, by which a solver's clock may differ from the judge's, and
_CLOCK_SHARE = 0.2  # the share of the time besides

Job = Callable[[], Any]


@dataclass(frozen=True)
class Request:
    """Some seeds of one planner on one problem, as a judge is asked to run them."""

    entrant: Entrant
    problem: Problem
    seeds: tuple[int, ...]
    planner: bytes
    store: Store
    allowed: Allowance

    @property
    def question(self) -> Question:
        """What the solver process is asked of it."""
        return Question(self.planner, self.problem, self.seeds)


class Ending(NamedTuple):
    """What became of a solver process that did not answer."""

    status: Status
    message: str


class Failure(NamedTuple):
    """What a job raised in a judge."""

    error: BaseException


def serve(link: socket.socket) -> NoReturn:
    """In a new process: do one job after another until the run hangs up."""
    processes.adopt_orphans()
    processes.seal_memory(True)
    with link.makefile("rwb") as stream:
        around: Surroundings = pickle.load(stream)
        os.environ.clear()
        os.environ.update(around.environment)
        bench = _Bench(link, around)
        while True:
            try:
                job = pickle.load(stream)
            except EOFError:
                bench.leave()
            done = _done(job, bench)
            pickle.dump(done, stream)
            stream.flush()


def _done(job: Request | Job, bench: _Bench) -> Any:
    """What comes of a job, or what it raised, if that can travel."""
    try:
        if isinstance(job, Request):
            return bench.try_it(job)
        return job()
    except Exception as error:
        with suppress(Exception):
            pickle.loads(pickle.dumps(error))
            return Failure(error)
        return Failure(WorkerError(traceback.format_exc()))


def judge_here(request: Request, answers: Answers, started: str) -> list[Written]:
    """Judge answers in this process, and store the trials."""
    limits = request.allowed.as_dict()
    trials = judged(request.entrant, request.problem, request.seeds, answers, started, limits)
    return request.store.write_all(trials, instead=_lost)


def record(request: Request, status: Status, message: str) -> list[Written]:
    """Store that the planner never answered: it hung, or its process died."""
    limits = request.allowed.as_dict()
    trials = [
        unanswered(request.entrant, request.problem, seed, status, message, limits)
        for seed in request.seeds
    ]
    return request.store.write_all(trials)


def _lost(trial: Trial) -> Trial:
    """Instead of a trial whose answer no file can hold, while it says why."""
    message = traceback.format_exc()
    solution = Solution(Status.CRASHED, message=message)
    return replace(
        trial, status=solution.status, message=message, solution=solution, certificate=None
    )


class _Solver:
    """A solver process as its judge sees it: its number, and the ends of its pipes."""

    def __init__(self, request: Request, around: Surroundings) -> None:
        self.is_for = (request.planner, request.allowed.memory)
        questions, self.ask = os.pipe()
        self.hear, answers = os.pipe()
        self.output, output = os.pipe()
        self.process = os.fork()
        if self.process == 0:
            solver.live(questions, answers, output, around, request.allowed.memory)
        for descriptor in (questions, answers, output):
            os.close(descriptor)
        for descriptor in (self.ask, self.output):
            os.set_blocking(descriptor, False)
        self.sources = {self.hear, self.output}
        self.tail = b""

    def signal(self, sign: signal.Signals) -> None:
        """To it and what it started in its group."""
        for send in (os.killpg, os.kill):  # it may not lead its group yet
            with suppress(ProcessLookupError, PermissionError):
                send(self.process, sign)

    def read(self, descriptor: int) -> bytes:
        """What can be read; a pipe that it has closed is forgotten."""
        data = os.read(descriptor, _CHUNK)
        if not data:
            self.sources.discard(descriptor)
        return data

    def drain(self) -> None:
        """Read what it printed, and keep the end of that."""
        with suppress(BlockingIOError):
            self.tail = (self.tail + self.read(self.output))[-_TAIL:]

    def take(self, question: bytes) -> bytes:
        """Send the beginning of a question; what is left of it."""
        with suppress(BlockingIOError):
            try:
                return question[os.write(self.ask, question[:_CHUNK]) :]
            except BrokenPipeError:  # it ended, and will be found so
                return b""
        return question

    @property
    def last_lines(self) -> str:
        """The end of what it printed since it was asked, harmless to a terminal."""
        lines = self.tail.decode(errors="backslashreplace").split("\n")
        text = "\n".join(lines[-_TAIL_LINES:]).strip()
        return str(harmless(text))

    def end(self) -> None:
        """It, and whatever descends from it."""
        self.signal(signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(self.process, 0)
        processes.end_children()
        self.drain()
        for descriptor in (self.ask, self.hear, self.output):
            os.close(descriptor)


class _Bench:
    """Where a judge tries planners: its link to the run, and the solver process of the moment."""

    def __init__(self, link: socket.socket, around: Surroundings) -> None:
        self._link = link
        self._around = around
        self._solver: _Solver | None = None
        self._child_ended = processes.wake_on_children()

    def leave(self) -> NoReturn:
        """End what was started, and this process."""
        self._clear()
        processes.end_children()
        os._exit(0)

    def try_it(self, request: Request) -> list[Written]:
        """Let the planner answer, judge that and store the trials."""
        started = now()
        began = time.monotonic()
        reply = self._reply(request)
        elapsed = time.monotonic() - began
        current = self._solver
        printed = "" if current is None else current.last_lines
        if isinstance(reply, Ending):
            self._clear()
            return record(request, reply.status, _with_output(reply.message, printed))
        try:
            answers = answer.unpacked(reply, len(request.seeds))
        except Exception as error:
            self._clear()
            message = f"its process answered what no planner can: {type(error).__name__}: {error}"
            return record(request, Status.CRASHED, _with_output(message[:_TAIL], printed))
        solutions = [_saying(solution, printed) for solution in answers.solutions]
        timed = replace(answers, solutions=solutions, wall_time=_believed(answers, elapsed))
        limit = max(_VERIFYING, request.allowed.timeout * len(request.seeds))
        try:
            with _at_most(limit):
                return judge_here(request, timed, started)
        except TimeoutError:
            return record(request, Status.CRASHED, f"verifying it took more than {limit:g} s")
        except MemoryError:
            return record(request, Status.CRASHED, "verifying it took more memory than there is")

    def _reply(self, request: Request) -> bytes | Ending:
        """The message of the solver process, or how it ended without one."""
        current = self._solver_for(request)
        question = pickle.dumps(request.question)
        heard = bytearray()
        seconds = request.allowed.timeout * len(request.seeds)
        look = time.monotonic()
        end = look + seconds
        ending = Ending(Status.TIMEOUT, f"stopped after {seconds:g} s")
        while True:
            left = end - time.monotonic()
            if left <= 0:
                return ending
            sources: list[Any] = [*current.sources, self._child_ended, self._link]
            sinks = [current.ask] if question else []
            ready, open_, _ = select.select(sources, sinks, [], min(left, _LOOK))
            if self._link in ready:
                self.leave()
            if open_:
                question = current.take(question)
            if current.output in ready:
                current.drain()
            if current.hear in ready:
                heard += current.read(current.hear)
                if current.hear not in current.sources:  # closed: it can answer no more
                    end = min(end, time.monotonic() + _LOOK)
                    ending = Ending(Status.CRASHED, "its process closed the way for its answer")
            length = _length(heard)
            if length > answer.LARGEST:
                return Ending(Status.CRASHED, str(answer.TooLarge()))
            if len(heard) >= solver.SIZE.size + max(length, 1):
                current.signal(signal.SIGSTOP)  # until it is asked again
                current.drain()
                return bytes(heard[solver.SIZE.size :][:length])
            if self._child_ended in ready:
                os.read(self._child_ended, _CHUNK)
                code = processes.ended().get(current.process)
                if code is not None:
                    return Ending(Status.CRASHED, _obituary(code))
            if time.monotonic() >= look:
                look = time.monotonic() + _LOOK
                if self._has_too_much(request.allowed.memory):
                    return Ending(Status.CRASHED, OUT_OF_MEMORY)

    def _has_too_much(self, memory: float | None) -> bool:
        return memory is not None and processes.memory_in_use() > memory * 2**30

    def _solver_for(self, request: Request) -> _Solver:
        """The process that has the planner already, or a new one."""
        current = self._solver
        if current is not None and current.is_for == (request.planner, request.allowed.memory):
            current.tail = b""
            current.signal(signal.SIGCONT)
            return current
        self._clear()
        self._solver = _Solver(request, self._around)
        return self._solver

    def _clear(self) -> None:
        if self._solver is not None:
            self._solver.end()
        self._solver = None


def _length(heard: bytearray) -> int:
    """Bytes of the message that has begun, if its beginning is there."""
    if len(heard) < solver.SIZE.size:
        return 0
    (length,) = solver.SIZE.unpack_from(heard)
    return int(length)


def _obituary(code: int) -> str:
    if code == -signal.SIGKILL:
        return "its process was killed, perhaps because the machine ran out of memory"
    return f"its process died with exit code {code}, without an answer"


def _with_output(message: str, printed: str) -> str:
    return f"{message}; what it printed last:\n{printed}" if printed else message


def _saying(solution: Solution, printed: str) -> Solution:
    """A crash with what the planner printed; any other answer as it is."""
    if solution.status is not Status.CRASHED or not printed:
        return solution
    return crash(f"what it printed last:\n{printed}\n\n{solution.message}")


def _believed(answers: Answers, elapsed: float) -> float:
    """Seconds that the call took: the planner's process says so, unless the judge saw longer."""
    known = answers.loading_time + answers.wall_time
    slack = _CLOCK_SLACK + _CLOCK_SHARE * elapsed
    if known > elapsed or elapsed > known + slack:
        return elapsed
    return answers.wall_time


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raises `TimeoutError` in a block that takes longer."""

    def late(sign: int, frame: FrameType | None) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, 1e9))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
