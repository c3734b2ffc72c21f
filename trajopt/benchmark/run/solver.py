"""Run a planner in a process of its own, which judges nothing.

The process is forked from a judge for one planner with its options. It answers the judge's
questions in plain data (`answer.py`). Its output goes to the judge, never to the terminal.
"""

from __future__ import annotations

import os
import pickle
import signal
import struct
import sys
import traceback
import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NoReturn, TextIO

import cloudpickle

from trajopt.benchmark.run import answer, processes, profile
from trajopt.benchmark.trial import (
    OUT_OF_MEMORY,
    Answers,
    answered,
    answered_many,
    crash,
    load_required,
)
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution
from trajopt.planners import registry
from trajopt.planners.planner import Planner, Relation

SIZE = struct.Struct("<Q")  # precedes each message: its length, bytes

_INPUT = 0
_OUTPUT = 1
_ERRORS = 2
_QUESTIONS = 3
_ANSWERS = 4
_FIRST_FREE = 16  # from here up descriptors are moved, before they get the numbers above


@dataclass(frozen=True)
class Describe:
    """A question: what does this spec name, and what does that say of these problems?"""

    spec: str
    problems: Sequence[Problem]


@dataclass(frozen=True)
class Load:
    """A question: make a planner from its spec, or from an object as pickled bytes.

    Reading the bytes runs a stranger's code.
    """

    source: str | bytes


@dataclass(frozen=True)
class Empty:
    """A question without work: its time is that of asking."""


@dataclass(frozen=True)
class Solve:
    """A question: what does the loaded planner answer to a problem, a solution per seed?"""

    problem: Problem
    seeds: Sequence[int]


@dataclass(frozen=True)
class SolveMany:
    """A question: what does the loaded planner answer to these problems, each with its seed?"""

    problems: Sequence[Problem]
    seeds: Sequence[int]


Question = Describe | Load | Empty | Solve | SolveMany


@dataclass(frozen=True)
class Surroundings:
    """Environment, import path and working folder of a run, which its planners get too."""

    environment: Mapping[str, str]
    path: Sequence[str]
    folder: str

    @classmethod
    def here(cls) -> Surroundings:
        """Return those of this process."""
        try:
            folder = os.getcwd()
        except FileNotFoundError:  # deleted
            folder = os.sep
        return cls(dict(os.environ), list(sys.path), folder)


def live(
    questions: int, answers: int, output: int, around: Surroundings, memory: float | None
) -> NoReturn:
    """Answer questions in the new process until the judge hangs up.

    Args:
        questions: Descriptor to read from.
        answers: Descriptor to write to.
        output: Descriptor for standard output and standard error.
        around: The run's surroundings.
        memory: GiB that the process may have.
    """
    code = 1
    try:
        _become_own_process()
        _keep_only(questions, answers, output)
        os.environ.clear()
        os.environ.update(around.environment)
        sys.path[:] = around.path
        with suppress(OSError):
            os.chdir(around.folder)
        if memory is not None:
            _limit_memory(memory)
        warnings.simplefilter("ignore", RuntimeWarning)  # what overflows the verifier refuses
        _answer_all()
        code = 0
    finally:
        os._exit(code)


def _become_own_process() -> None:
    processes.end_with_parent()
    processes.seal_memory(False)
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    os.setsid()
    loaded = sys.modules.get("numpy.random")  # NumPy 1 loads it itself
    if loaded is not None:
        loaded.seed()  # else all processes would draw the same numbers


def _keep_only(questions: int, answers: int, output: int) -> None:
    """Close every other descriptor of the judge's, and print to the judge."""
    from fcntl import F_DUPFD, fcntl  # only Unix has it

    nothing = os.open(os.devnull, os.O_RDONLY)
    kept = [nothing, output, output, questions, answers]
    high = [fcntl(descriptor, F_DUPFD, _FIRST_FREE) for descriptor in kept]
    for place, descriptor in enumerate(high):
        os.dup2(descriptor, place, inheritable=place <= _ERRORS)
    os.closerange(len(kept), os.sysconf("SC_OPEN_MAX"))
    sys.stdin = os.fdopen(_INPUT, closefd=False)
    sys.stdout = _line_buffered(_OUTPUT)
    sys.stderr = _line_buffered(_ERRORS)


def _line_buffered(descriptor: int) -> TextIO:
    return os.fdopen(descriptor, "w", buffering=1, errors="backslashreplace", closefd=False)


def _limit_memory(memory: float) -> None:
    """Limit this process's own memory, GiB; beyond it Python raises `MemoryError`."""
    import resource  # only Unix has it

    hard = resource.getrlimit(resource.RLIMIT_DATA)[1]
    own = int(memory * 2**30)
    soft = own if hard == resource.RLIM_INFINITY else min(own, hard)
    resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


def _answer_all() -> None:
    own = os.getpid()
    solving = _Solving()
    with open(_QUESTIONS, "rb", closefd=False) as source:
        while True:
            try:
                question = pickle.load(source)
            except EOFError:
                return
            message = solving.message(question)
            if os.getpid() != own:  # a fork of the planner's that returned from `solve`
                return
            _write(SIZE.pack(len(message)) + message)


class _Solving:
    """The planner of this process, or the crash that took its place."""

    def __init__(self) -> None:
        self._planner: Planner | Solution = crash("no planner was loaded")

    def message(self, question: Question) -> bytes:
        """Return the answer to a question as a message."""
        if isinstance(question, Describe):
            return profile.described(question.spec, question.problems)
        if isinstance(question, Load):
            self._planner = _loaded(question.source)
        if isinstance(question, Solve):
            return self._solved(question)
        if isinstance(question, SolveMany):
            return self._solved_together(question)
        return b"{}"

    def _solved_together(self, question: SolveMany) -> bytes:
        """Return the answers to several problems; none where the planner fails on any."""
        if isinstance(self._planner, Planner):
            with suppress(Exception, SystemExit):
                every = answered_many(self._planner, question.problems, question.seeds)
                return answer.packed_many(every)
        return answer.NONE

    def _solved(self, question: Solve) -> bytes:
        lost = self._planner
        if isinstance(lost, Planner):
            try:
                answers = answered(lost, question.problem, question.seeds)
                return answer.packed(answers)
            except BaseException as error:  # SystemExit too
                lost = _crash(error)
        return answer.packed(Answers([lost] * len(question.seeds), Relation.RESTRICTION))


def _loaded(source: str | bytes) -> Planner | Solution:
    """Make a planner, and import what it requires."""
    try:
        made = registry.load(source) if isinstance(source, str) else cloudpickle.loads(source)
        load_required(made.requires)
    except BaseException as error:  # SystemExit too: a planner's class may fail to load here
        return _crash(error)
    planner: Planner = made
    return planner


def _crash(error: BaseException) -> Solution:
    if isinstance(error, MemoryError):
        return crash(OUT_OF_MEMORY)
    return crash("".join(traceback.format_exception(error)))


def _write(data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        written = os.write(_ANSWERS, rest)
        rest = rest[written:]
