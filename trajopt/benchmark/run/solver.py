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
import time
import traceback
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import NoReturn, TextIO

import cloudpickle

from trajopt.benchmark.run import answer, processes
from trajopt.benchmark.trial import OUT_OF_MEMORY, Answers, answered, crash
from trajopt.core.problem import Problem
from trajopt.planners.planner import Planner, Relation

SIZE = struct.Struct("<Q")  # precedes each message: its length, bytes

_INPUT = 0
_OUTPUT = 1
_ERRORS = 2
_QUESTIONS = 3
_ANSWERS = 4
_FIRST_FREE = 16  # from here up descriptors are moved, before they get the numbers above

# A planner as pickled bytes (reading them runs a stranger's code), the problem, and the seeds.
Question = tuple[bytes, Problem, Sequence[int]]


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
        _answer_all()
        code = 0
    finally:
        os._exit(code)


def _become_own_process() -> None:
    processes.end_with_parent()
    processes.seal_memory(False)
    signal.set_wakeup_fd(-1)
    for sign in (signal.SIGCHLD, signal.SIGALRM):
        signal.signal(sign, signal.SIG_DFL)
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
    planners: dict[bytes, Planner] = {}
    with open(_QUESTIONS, "rb", closefd=False) as source:
        while True:
            try:
                question = pickle.load(source)
            except EOFError:
                return
            message = _message(question, planners)
            if os.getpid() != own:  # a fork of the planner's that returned from `solve`
                return
            _write(SIZE.pack(len(message)) + message)


def _message(question: Question, planners: dict[bytes, Planner]) -> bytes:
    """Return the planner's answers, or a crash for each, as a message."""
    pickled, problem, seeds = question
    try:
        began = time.perf_counter()
        if pickled not in planners:
            planners[pickled] = cloudpickle.loads(pickled)
        loaded = time.perf_counter()
        answers = answered(planners[pickled], problem, seeds)
        loading_time = answers.loading_time + loaded - began
        return answer.packed(replace(answers, loading_time=loading_time))
    except MemoryError:
        lost = crash(OUT_OF_MEMORY)
    except BaseException:  # SystemExit too: a planner's class may fail to load here
        lost = crash(traceback.format_exc())
    answers = Answers([lost] * len(seeds), Relation.RESTRICTION)
    return answer.packed(answers)


def _write(data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        written = os.write(_ANSWERS, rest)
        rest = rest[written:]
