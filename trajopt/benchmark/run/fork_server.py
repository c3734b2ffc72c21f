"""The process that worker processes are forked from: what every trial needs is loaded once, there.

Forking a process that has loaded solvers, or runs threads, is not safe. This one has loaded neither
(Python's own `multiprocessing.forkserver`), and forks a worker in milliseconds where a fresh
interpreter takes half a second. Systems without it, or whose libraries do not stand a fork, start
fresh interpreters, as Python itself does there.

Nothing that takes long is imported here: a command starts the server first of all, and imports the
rest meanwhile.
"""

from __future__ import annotations

import multiprocessing
import signal
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing.context import BaseContext

from trajopt.benchmark.run.threads import single_threaded

_IS_SAFE = sys.platform == "linux"
_CAN_WAIT = hasattr(signal, "pthread_sigmask")  # a Unix
_LOADED = ["trajopt.benchmark.run.workers", "trajopt.benchmark.store.trial_file"]


def context() -> BaseContext:
    """How worker processes are started here."""
    return multiprocessing.get_context("forkserver" if _IS_SAFE else "spawn")


def start() -> None:
    """Start the server, if there is to be one and none is running; returns at once."""
    if not _IS_SAFE:
        return
    # sockets: not where no process is to start
    from multiprocessing import forkserver, resource_tracker

    multiprocessing.set_forkserver_preload(_LOADED)
    resource_tracker.ensure_running()  # which the server needs, and whose start lets Ctrl-C through
    with single_threaded(), uninterrupted():
        forkserver.ensure_running()


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Ctrl-C waits for the end of the block; what starts in it does not hear it.

    A process that is interrupted while it starts says so in twenty lines that help nobody.
    """
    if not _CAN_WAIT:
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def hear_ctrl_c() -> None:
    """In a new worker: let it, and what it starts, hear Ctrl-C as any process does."""
    if _CAN_WAIT:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
