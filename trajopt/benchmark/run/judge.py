"""Judge answers in a process that never runs a planner's code, so that its verdict can be trusted.

A judge is forked from the server (`server.py`) and serves one run until that ends. It has one
solver process at a time (`solver.py`), a new one for each planner with its options. The answer of
that process is plain data. The judge verifies it on the run's own problem, stores the trials, and
sends them to the run. Everything that a planner started ends with its solver process.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from types import FrameType
from typing import Any, NamedTuple, NoReturn

from trajopt.benchmark.run import answer, processes, solver
from trajopt.benchmark.run.solver import Surroundings
from trajopt.benchmark.run.tasks import Allowance
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
from trajopt.core.harmless import harmless
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status

_CHUNK_BYTES = 1 << 16  # read at once
_TAIL_BYTES = 4096  # kept of a planner's output
_TAIL_LINES = 10
_MEMORY_INTERVAL_S = 0.1  # between two measurements of the memory in use
MIN_VERIFICATION_TIMEOUT_S = 60.0
# A solver's clock may lag behind the judge's by this: seconds, plus a share of the time.
_CLOCK_ATOL_S = 0.5
_CLOCK_RTOL = 0.2


@dataclass(frozen=True)
class Request:
    """A request to a judge: run one planner on one problem with these seeds.

    `planner` is pickled: reading it would run a stranger's code.
    """

    entrant: Entrant
    problem: Problem
    seeds: tuple[int, ...]
    planner: bytes
    store: Store
    allowed: Allowance


class Ending(NamedTuple):
    """Status and message of trials whose solver process did not answer."""

    status: Status
    message: str


class Failure(NamedTuple):
    """An error of the judge itself, which the run raises."""

    error: BaseException


def serve(link: socket.socket) -> NoReturn:
    """Serve one request after another in a new process until the run hangs up."""
    processes.adopt_orphans()
    processes.seal_memory(True)
    with link.makefile("rwb") as stream:
        around: Surroundings = pickle.load(stream)
        os.environ.clear()
        os.environ.update(around.environment)
        bench = _Bench(link, around)
        while True:
            try:
                request = pickle.load(stream)
            except EOFError:
                bench.leave()
            done = _served(bench, request)
            pickle.dump(done, stream)
            stream.flush()


def _served(bench: _Bench, request: Request) -> list[Written] | Failure:
    try:
        return bench.serve(request)
    except Exception as error:
        with suppress(Exception):
            pickle.loads(pickle.dumps(error))
            return Failure(error)
        return Failure(WorkerError(traceback.format_exc()))


def judge_here(request: Request, answers: Answers, started: str) -> list[Written]:
    """Verify answers in this process and store the trials."""
    limits = request.allowed.as_dict()
    trials = judged(request.entrant, request.problem, request.seeds, answers, started, limits)
    return request.store.write_all(trials, instead=_lost)


def record(request: Request, status: Status, message: str) -> list[Written]:
    """Store trials of a planner that did not answer: it hung, or its process died."""
    limits = request.allowed.as_dict()
    trials = [
        unanswered(request.entrant, request.problem, seed, status, message, limits)
        for seed in request.seeds
    ]
    return request.store.write_all(trials)


def _lost(trial: Trial) -> Trial:
    """Return a crashed trial in place of one that cannot be stored, with the current exception."""
    message = traceback.format_exc()
    solution = Solution(Status.CRASHED, message=message)
    return replace(
        trial, status=solution.status, message=message, solution=solution, certificate=None
    )


class _Solver:
    """A solver process as its judge sees it: its number, and the judge's ends of its pipes."""

    def __init__(self, request: Request, around: Surroundings) -> None:
        self.key = (request.planner, request.allowed.memory)
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
        """Send a signal to the process and its group."""
        for send in (os.killpg, os.kill):  # at its start the process has no group of its own yet
            with suppress(ProcessLookupError, PermissionError):
                send(self.process, sign)

    def read(self, descriptor: int) -> bytes:
        """Read from a pipe; forget the pipe if the process has closed it."""
        data = os.read(descriptor, _CHUNK_BYTES)
        if not data:
            self.sources.discard(descriptor)
        return data

    def drain(self) -> None:
        """Read its output, and keep the end."""
        with suppress(BlockingIOError):
            self.tail = (self.tail + self.read(self.output))[-_TAIL_BYTES:]

    def take(self, question: bytes) -> bytes:
        """Send as much of a question as the pipe takes; return the rest."""
        with suppress(BlockingIOError):
            try:
                return question[os.write(self.ask, question[:_CHUNK_BYTES]) :]
            except BrokenPipeError:  # it ended, which the signal of its end will tell
                return b""
        return question

    @property
    def last_lines(self) -> str:
        """Return the end of its output since the question, without control characters."""
        lines = self.tail.decode(errors="backslashreplace").split("\n")
        text = "\n".join(lines[-_TAIL_LINES:]).strip()
        return harmless(text)

    def end(self) -> None:
        """Kill it and all its descendants."""
        self.signal(signal.SIGKILL)
        with suppress(ChildProcessError):
            os.waitpid(self.process, 0)
        processes.end_children()
        self.drain()
        for descriptor in (self.ask, self.hear, self.output):
            os.close(descriptor)


class _Bench:
    """A judge's link to its run, and its current solver process."""

    def __init__(self, link: socket.socket, around: Surroundings) -> None:
        self._link = link
        self._around = around
        self._solver: _Solver | None = None
        self._child_ended = processes.wake_on_children()

    def leave(self) -> NoReturn:
        """End everything that was started, then this process."""
        self._clear()
        processes.end_children()
        os._exit(0)

    def serve(self, request: Request) -> list[Written]:
        """Ask the planner, verify its answers and store the trials."""
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
            return record(request, Status.CRASHED, _with_output(message[:_TAIL_BYTES], printed))
        solutions = [_explained(solution, printed) for solution in answers.solutions]
        timed = replace(answers, solutions=solutions, wall_time=_believed(answers, elapsed))
        limit = max(MIN_VERIFICATION_TIMEOUT_S, request.allowed.timeout * len(request.seeds))
        try:
            with _at_most(limit):
                return judge_here(request, timed, started)
        except TimeoutError:
            return record(request, Status.CRASHED, f"verifying it took more than {limit:g} s")
        except MemoryError:
            return record(request, Status.CRASHED, "verifying it took more memory than there is")

    def _reply(self, request: Request) -> bytes | Ending:
        """Return the message of the solver process, or how it ended without one."""
        current = self._solver_for(request)
        question = pickle.dumps((request.planner, request.problem, request.seeds))
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
            ready, open_, _ = select.select(sources, sinks, [], min(left, _MEMORY_INTERVAL_S))
            if self._link in ready:
                self.leave()
            if open_:
                question = current.take(question)
            if current.output in ready:
                current.drain()
            if current.hear in ready:
                heard += current.read(current.hear)
                if current.hear not in current.sources:  # it cannot answer any more
                    end = min(end, time.monotonic() + _MEMORY_INTERVAL_S)
                    ending = Ending(Status.CRASHED, "its process closed the way for its answer")
            length = _length(heard)
            if length > answer.MAX_MESSAGE_BYTES:
                return Ending(Status.CRASHED, answer.TOO_LARGE)
            if len(heard) >= solver.SIZE.size + max(length, 1):
                current.signal(signal.SIGSTOP)  # until it is asked again
                current.drain()
                return bytes(heard[solver.SIZE.size :][:length])
            if self._child_ended in ready:
                os.read(self._child_ended, _CHUNK_BYTES)
                code = processes.ended().get(current.process)
                if code is not None:
                    return Ending(Status.CRASHED, _cause_of_end(code))
            if time.monotonic() >= look:
                look = time.monotonic() + _MEMORY_INTERVAL_S
                memory = request.allowed.memory
                if memory is not None and processes.memory_in_use() > memory * 2**30:
                    return Ending(Status.CRASHED, OUT_OF_MEMORY)

    def _solver_for(self, request: Request) -> _Solver:
        """Return the current process if it has this planner, else a new one."""
        current = self._solver
        if current is not None and current.key == (request.planner, request.allowed.memory):
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
    """Return the length of the message that has begun, bytes; 0 while it is not known."""
    if len(heard) < solver.SIZE.size:
        return 0
    (length,) = solver.SIZE.unpack_from(heard)
    return int(length)


def _cause_of_end(code: int) -> str:
    if code == -signal.SIGKILL:
        return "its process was killed, perhaps because the machine ran out of memory"
    return f"its process died with exit code {code}, without an answer"


def _with_output(message: str, printed: str) -> str:
    return f"{message}; what it printed last:\n{printed}" if printed else message


def _explained(solution: Solution, printed: str) -> Solution:
    """Add the planner's output to the message of a crash."""
    if solution.status is not Status.CRASHED or not printed:
        return solution
    return crash(f"what it printed last:\n{printed}\n\n{solution.message}")


def _believed(answers: Answers, elapsed: float) -> float:
    """Return the wall time of the call, s, by the planner's clock where that agrees with ours."""
    known = answers.loading_time + answers.wall_time
    slack = _CLOCK_ATOL_S + _CLOCK_RTOL * elapsed
    if known > elapsed or elapsed > known + slack:
        return elapsed
    return answers.wall_time


@contextmanager
def _at_most(seconds: float) -> Iterator[None]:
    """Raise `TimeoutError` in the block when it takes longer."""

    def late(sign: int, frame: FrameType | None) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    signal.setitimer(signal.ITIMER_REAL, min(seconds, 1e9))
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
