"""One thread for linear algebra in each child process, so that jobs do not fight for cores."""

from __future__ import annotations

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_THREADS = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class _SingleThreaded:
    """How many blocks ask for single threads, and the environment before the first of them."""

    def __init__(self) -> None:
        self.lock = threading.Lock()
        self.blocks = 0
        self.before: dict[str, str | None] = {}

    def enter(self) -> None:
        with self.lock:
            if self.blocks == 0:
                self.before = {name: os.environ.get(name) for name in _THREADS}
                os.environ.update(_THREADS)
            self.blocks += 1

    def leave(self) -> None:
        with self.lock:
            self.blocks -= 1
            if self.blocks > 0:
                return
            for name, value in self.before.items():
                del os.environ[name]
                if value is not None:
                    os.environ[name] = value


_single_threaded = _SingleThreaded()


@contextmanager
def single_threaded() -> Iterator[None]:
    """Children that start in the block inherit one thread each.

    By the environment, since a child imports the user's script, and with it NumPy, before any line
    of ours could limit the threads that NumPy has started by then; and what a planner starts
    inherits it too. Blocks may overlap: an executor's worker may have several threads.
    """
    _single_threaded.enter()
    try:
        yield
    finally:
        _single_threaded.leave()
