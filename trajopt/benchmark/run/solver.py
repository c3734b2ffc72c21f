"""The process that a planner runs in, of which nothing is believed.

It is forked from a judge for one planner with its options, and answers the judge's questions in
plain data (`answer.py`). What it prints goes to the judge, not to the terminal.
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
from typing import NoReturn

import cloudpickle

from trajopt.benchmark.run import answer, processes
from trajopt.benchmark.trial import OUT_OF_MEMORY, Answers, answered, crash
from trajopt.core.problem import Problem
from trajopt.planners.planner import Planner, Relation

SIZE = struct.Struct("<Q")  # before each message: its length, bytes

_INPUT = 0
_OUTPUT = 1
_ERRORS = 2
_QUESTIONS = 3  # the descriptors that it has, besides the standard ones
_ANSWERS = 4
_OUT_OF_THE_WAY = 16


@dataclass(frozen=True)
class Surroundings:
    """What the run that a planner belongs to has around it."""

    environment: Mapping[str, str]
    path: Sequence[str]
    folder: str

    @classmethod
    def here(cls) -> Surroundings:
        """Of this process."""
        try:
            folder = os.getcwd()
        except FileNotFoundError:  # deleted
            folder = os.sep
        return cls(dict(os.environ), list(sys.path), folder)


@dataclass(frozen=True)
class Question:
    """What a planner is asked; the planner is pickled, since reading it runs a stranger's code."""

    planner: bytes
    problem: Problem
    seeds: Sequence[int]


def live(
    questions: int, answers: int, output: int, around: Surroundings, memory: float | None
) -> NoReturn:
    """In the new process: answer until nobody asks any more.

    Args:
        questions: The descriptor to read from.
        answers: The descriptor to write to.
        output: The descriptor that takes what is printed.
        around: What the planner finds around it.
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
            _hold_to(memory)
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


def _keep_only(questions: int, answers: int, output: int) -> None:
    """Let go of every descriptor of the judge's, and print to the judge."""
    from fcntl import F_DUPFD, fcntl  # of Unix: trials in the run's own process need none

    nothing = os.open(os.devnull, os.O_RDONLY)
    kept = [nothing, output, output, questions, answers]
    high = [fcntl(descriptor, F_DUPFD, _OUT_OF_THE_WAY) for descriptor in kept]
    for place, descriptor in enumerate(high):
        os.dup2(descriptor, place, inheritable=place <= _ERRORS)
    os.closerange(len(kept), os.sysconf("SC_OPEN_MAX"))
    sys.stdin = open(_INPUT, closefd=False)  # noqa: SIM115
    sys.stdout = open(_OUTPUT, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115
    sys.stderr = open(_ERRORS, "w", buffering=1, errors="backslashreplace", closefd=False)  # noqa: SIM115


def _hold_to(memory: float) -> None:
    """Beyond so many GiB of its own this process gets no more: Python's `MemoryError`."""
    import resource  # of Unix, likewise

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
            if os.getpid() != own:  # a fork that the planner forgot to end
                return
            _write(SIZE.pack(len(message)) + message)


def _message(question: Question, planners: dict[bytes, Planner]) -> bytes:
    """What the planner answers, or why it does not."""
    try:
        began = time.perf_counter()
        if question.planner not in planners:
            planners[question.planner] = cloudpickle.loads(question.planner)
        loaded = time.perf_counter()
        answers = answered(planners[question.planner], question.problem, question.seeds)
        loading_time = answers.loading_time + loaded - began
        return answer.packed(replace(answers, loading_time=loading_time))
    except MemoryError:
        lost = crash(OUT_OF_MEMORY)
    except BaseException:  # it does not load in another process, or raises what is no Exception
        lost = crash(traceback.format_exc())
    answers = Answers([lost] * len(question.seeds), Relation.RESTRICTION)
    return answer.packed(answers)


def _write(data: bytes) -> None:
    rest = memoryview(data)
    while rest:
        written = os.write(_ANSWERS, rest)
        rest = rest[written:]
