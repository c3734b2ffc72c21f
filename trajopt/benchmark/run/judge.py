"""Judge answers in a process that never runs a planner's code, so that its verdict can be trusted.

A judge is forked from the server (`server.py`) and serves one run and one planner with its options
until that ends. The planner runs in a solver process (`solver.py`), whose answers are plain data.
The judge measures the time of an answer, verifies it on the run's own problem, stores the trials,
and sends them to the run. Everything that a planner started ends with its solver process.
"""

from __future__ import annotations

import os
import pickle
import select
import signal
import socket
import sys
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, NoReturn

from trajopt.benchmark.run import answer, processes, solver
from trajopt.benchmark.run.solver import Surroundings
from trajopt.benchmark.run.tasks import Allowance
from trajopt.benchmark.store.folder import Store, Written
from trajopt.benchmark.trial import (
    OUT_OF_MEMORY,
    Answers,
    Entrant,
    Exchange,
    Trial,
    crash,
    judged_many,
    now,
    unanswered,
)
from trajopt.core.exceptions import WorkerError
from trajopt.core.harmless import harmless
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status

_CHUNK_BYTES = 1 << 16  # bytes read at once
_TAIL_BYTES = 4096  # bytes of a planner's output that are kept
_TAIL_LINES = 10
_MEMORY_INTERVAL_S = 0.1  # between two measurements of the memory in use
_NO_MEMORY_TO_VERIFY = "verifying it took more memory than there is"
_EMPTY_QUESTIONS = 3  # number of empty questions; the shortest time is that of asking


@dataclass(frozen=True)
class Request:
    """A request to a judge: run one planner on one problem with these seeds.

    Attributes:
        source: The planner's spec, or the planner pickled: reading that would run its code.
        digest: Of the code that judges where the run was started.
    """

    entrant: Entrant
    problem: Problem
    seeds: tuple[int, ...]
    source: str | bytes
    store: Store
    allowed: Allowance
    digest: str = ""


@dataclass(frozen=True)
class Requests:
    """A request to a judge: requests of one planner, each with one seed, answered together.

    Where that gives no answer in the time of one trial, each is answered alone.
    """

    requests: tuple[Request, ...]


@dataclass(frozen=True)
class Inquiry:
    """A request to a judge: have a planner described (`profile.described`)."""

    question: solver.Describe
    allowed: Allowance


class _Allotment(NamedTuple):
    """Time and memory that questions may take: s, the monotonic clock at their end, GiB."""

    seconds: float
    end: float
    memory: float | None

    @classmethod
    def of(cls, allowed: Allowance, trials: int = 1) -> _Allotment:
        """Return the limit of so many trials from now on."""
        seconds = allowed.timeout * trials
        return cls(seconds, time.monotonic() + seconds, allowed.memory)


class Ending(NamedTuple):
    """Status and message of trials whose solver process did not answer."""

    status: Status
    message: str


class JudgeError(NamedTuple):
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


def _served(
    bench: _Bench, request: Request | Requests | Inquiry
) -> list[Written] | bytes | Ending | JudgeError:
    try:
        if isinstance(request, Inquiry):
            return bench.inquire(request)
        if isinstance(request, Requests):
            return bench.serve_together(request)
        return bench.serve(request)
    except Exception as error:
        with suppress(Exception):
            pickle.loads(pickle.dumps(error))
            return JudgeError(error)
        return JudgeError(WorkerError(traceback.format_exc()))


def judge_here(
    requests: Sequence[Request], every: Sequence[Answers], started: str
) -> list[Written]:
    """Verify the answers to some requests in this process, and store the trials together."""
    asked = [
        Exchange(own.entrant, own.problem, own.seeds, answers, own.allowed.as_dict())
        for own, answers in zip(requests, every, strict=True)
    ]
    return requests[0].store.write_all(judged_many(asked, started), instead=_lost)


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

    def __init__(self, around: Surroundings, memory: float | None, *, echo: bool = False) -> None:
        self._echo = echo
        questions, self.ask = os.pipe()
        self.hear, answers = os.pipe()
        self.output, output = os.pipe()
        self.process = os.fork()
        if self.process == 0:
            solver.live(questions, answers, output, around, memory)
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
            data = self.read(self.output)
            self.tail = (self.tail + data)[-_TAIL_BYTES:]
            if self._echo:
                sys.stderr.write(harmless(data.decode(errors="backslashreplace")))
                sys.stderr.flush()

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
        self._asking_time = 0.0  # s, of an empty question
        self._child_ended = processes.wake_on_children()

    def leave(self) -> NoReturn:
        """End everything that was started, then this process."""
        self._clear()
        processes.end_children()
        os._exit(0)

    def inquire(self, inquiry: Inquiry) -> bytes | Ending:
        """Ask for a description; return the message, or in a line how the process ended."""
        limit = _Allotment.of(inquiry.allowed)
        self._solver = _Solver(self._around, limit.memory)
        reply = self._reply(inquiry.question, limit)
        printed = self._printed().rpartition("\n")[2]
        self._clear()
        if isinstance(reply, Ending) and printed:
            return Ending(reply.status, f"{reply.message}; it printed last: {printed}")
        return reply

    def serve(self, request: Request) -> list[Written]:
        """Ask the planner, verify its answers and store the trials."""
        started = now()
        question = solver.Solve(request.problem, request.seeds)
        reply, loading_time, wall_time = self._timed(request, question)
        printed = self._printed()
        if isinstance(reply, Ending):
            self._clear()
            return record(request, reply.status, _with_output(reply.message, printed))
        try:
            answers = answer.unpacked(reply, len(request.seeds))
        except MemoryError:
            return record(request, Status.CRASHED, _NO_MEMORY_TO_VERIFY)
        except Exception as error:
            self._clear()
            wrong = f"its process answered what no planner can: {type(error).__name__}"
            message = _with_output(f"{wrong}: {error}"[:_TAIL_BYTES], printed)
            return record(request, Status.CRASHED, message)
        timed = replace(answers, loading_time=loading_time, wall_time=wall_time)
        return self._judged([request], [timed], started, printed)

    def _judged(
        self, requests: Sequence[Request], every: Sequence[Answers], started: str, printed: str
    ) -> list[Written]:
        explained = [
            replace(own, solutions=[_explained(one, printed) for one in own.solutions])
            for own in every
        ]
        try:
            return judge_here(requests, explained, started)
        except MemoryError:
            if len(requests) == 1:
                return record(requests[0], Status.CRASHED, _NO_MEMORY_TO_VERIFY)
        found = []
        for request, own in zip(requests, every, strict=True):
            found += self._judged([request], [own], started, printed)
        return found

    def serve_together(self, together: Requests) -> list[Written]:
        """Ask the planner for all answers at once; where it gives none, for one after the other.

        So a problem on which it hangs or crashes costs the others nothing but that time.
        """
        started = now()
        requests = together.requests
        problems = [own.problem for own in requests]
        question = solver.SolveMany(problems, [seed for own in requests for seed in own.seeds])
        reply, loading_time, wall_time = self._timed(requests[0], question)
        printed = self._printed()
        try:
            counts = [len(own.seeds) for own in requests]
            every = [] if isinstance(reply, Ending) else answer.unpacked_many(reply, counts)
        except Exception:  # it crashed in its process, or answered what no planner can
            every = []
        if not every:
            if isinstance(reply, Ending):
                self._clear()
            return [written for own in requests for written in self.serve(own)]
        timed = [
            Answers(own.solutions, own.relation, loading_time, wall_time, len(requests))
            for own in every
        ]
        return self._judged(requests, timed, started, printed)

    def _timed(
        self, request: Request, question: solver.Solve | solver.SolveMany
    ) -> tuple[bytes | Ending, float, float]:
        """Return the answer, or how the process ended, and the times to load and to solve, s.

        Both are measured here, less the time of an empty question.
        """
        limit = _Allotment.of(request.allowed, len(request.seeds))
        loading_time = 0.0

        def asked(question: solver.Question) -> tuple[bytes | Ending, float]:
            began = time.monotonic()
            reply = self._reply(question, limit)
            return reply, time.monotonic() - began

        if self._solver is not None:
            self._solver.tail = b""
        else:
            self._solver = _Solver(self._around, limit.memory, echo=request.allowed.echo)
            reply, loading_time = asked(solver.Load(request.source))
            times = []
            for _ in range(_EMPTY_QUESTIONS):
                if isinstance(reply, Ending):
                    return reply, 0.0, 0.0
                reply, seconds = asked(solver.Empty())
                times.append(seconds)
            self._asking_time = min(times)
        reply, wall_time = asked(question)
        loading_time, wall_time = (
            max(0.0, seconds - self._asking_time) for seconds in (loading_time, wall_time)
        )
        return reply, loading_time, wall_time

    def _reply(self, asked: solver.Question, limit: _Allotment) -> bytes | Ending:
        """Return the message of the solver process, or how it ended without one."""
        current = self._solver
        assert current is not None
        end = limit.end
        current.signal(signal.SIGCONT)
        question = pickle.dumps(asked)
        heard = bytearray()
        look = time.monotonic()
        ending = Ending(Status.TIMEOUT, f"stopped after {limit.seconds:g} s")
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
                memory = limit.memory
                if memory is not None and processes.memory_in_use() > memory * 2**30:
                    return Ending(Status.CRASHED, OUT_OF_MEMORY)

    def _printed(self) -> str:
        """Return the end of the planner's output."""
        assert self._solver is not None
        self._solver.drain()
        return self._solver.last_lines

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
