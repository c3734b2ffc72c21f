"""Judges that a command shares: its trials run there first, then its figures are drawn.

with Pool(jobs=2) as pool:
    drawn = pool.submit(job)
"""

from __future__ import annotations

import pickle
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from types import TracebackType
from typing import Any

from trajopt.benchmark.run import server
from trajopt.benchmark.run.server import SINGLE_THREADED
from trajopt.core.exceptions import WorkerError

HAS_JUDGES = hasattr(socket, "send_fds")  # a Unix


class JudgeDied(Exception):
    """A judge ended before it answered: somebody killed it, or the system did."""


class _Judge:
    """A judge process, seen from the run."""

    def __init__(self) -> None:
        # NumPy and more: not where no process is to start
        from dataclasses import replace

        from trajopt.benchmark.run.solver import Surroundings

        self._link = server.judge()
        self._stream: Any = self._link.makefile("rwb")
        here = Surroundings.here()
        environment = {**here.environment, **SINGLE_THREADED}
        pickle.dump(replace(here, environment=environment), self._stream)

    def ask(self, job: object) -> Any:
        """What comes of a job; raises what it raised there, or `JudgeDied`."""
        from trajopt.benchmark.run.judge import Failure

        data = pickle.dumps(job)
        try:
            self._stream.write(data)
            self._stream.flush()
            done = pickle.load(self._stream)
        except (EOFError, OSError, pickle.UnpicklingError) as error:
            raise JudgeDied from error
        if isinstance(done, Failure):
            raise done.error
        return done

    def end(self) -> None:
        """Hang up, so that it ends what it is at and itself, and wait until it has."""
        with suppress(OSError):
            self._link.shutdown(socket.SHUT_WR)
            while self._link.recv(1 << 16):
                pass
        with suppress(OSError):
            self._stream.close()
        self._link.close()


class Judges:
    """Judge processes, each of which does one job at a time; started as they are needed."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._idle: list[_Judge] = []
        self._all: list[_Judge] = []
        self._ended = False

    @property
    def are_running(self) -> bool:
        return bool(self._all)

    def ask(self, job: object) -> Any:
        """Do something that can be pickled in a process that is idle, and wait for what it gives.

        Raises:
            JudgeDied: the process ended before it answered.
            Exception: whatever the job raised.
        """
        judge = self._taken()
        answer = judge.ask(job)
        with self._lock:
            self._idle.append(judge)
        return answer

    def end(self) -> None:
        """End them all, busy or not."""
        with self._lock:
            self._ended = True
            judges = list(self._all)
        for judge in judges:
            judge.end()

    def _taken(self) -> _Judge:
        with self._lock:
            if self._idle:
                return self._idle.pop()
            if self._ended:
                raise WorkerError("the run has ended")
            judge = _Judge()
            self._all.append(judge)
            return judge


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """A further Ctrl-C changes nothing in the block."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


class Pool:
    """So many judges, started when they are needed; none outlives the block.

    When the block ends with an error, or by Ctrl-C, what they are at is stopped. Where the system
    has no such processes, it has none: `jobs` is 0.
    """

    def __init__(self, jobs: int) -> None:
        self.jobs = jobs if HAS_JUDGES else 0
        self._judges = Judges()
        self._threads = ThreadPoolExecutor(max(1, self.jobs))

    def __enter__(self) -> Pool:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        if error is None:
            self._threads.shutdown()
        with _uninterrupted():
            self._threads.shutdown(wait=False, cancel_futures=True)
            self._judges.end()
            self._threads.shutdown()

    @property
    def is_running(self) -> bool:
        """Whether its processes have started."""
        return self._judges.are_running

    def submit(self, job: Callable[[], Any] | object) -> Future[Any]:
        """Do something that can be pickled, after what was submitted before."""
        return self._threads.submit(self._judges.ask, job)
