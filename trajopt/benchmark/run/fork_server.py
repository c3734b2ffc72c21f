"""The process that worker processes are forked from: what every trial needs is loaded once, there.

Forking a process that has loaded solvers, or runs threads, is not safe. This one has loaded neither
(Python's own `multiprocessing.forkserver`), and forks a worker in milliseconds where a fresh
interpreter takes half a second. Systems without it, or whose libraries do not stand a fork, start
fresh interpreters, as Python itself does there.

Nothing of this package is imported here: a command starts the server first of all, and imports the
rest meanwhile.
"""

from __future__ import annotations

import multiprocessing
import sys
from multiprocessing.context import BaseContext

from trajopt.benchmark.run.threads import single_threaded

_IS_SAFE = sys.platform == "linux"
_LOADED = ["trajopt.benchmark.run.workers", "trajopt.benchmark.store.trial_file"]


def context() -> BaseContext:
    """How worker processes are started here."""
    return multiprocessing.get_context("forkserver" if _IS_SAFE else "spawn")


def start() -> None:
    """Start the server, if there is to be one and none is running; returns at once."""
    if not _IS_SAFE:
        return
    # sockets: not where no process is to start
    from multiprocessing import forkserver

    multiprocessing.set_forkserver_preload(_LOADED)
    with single_threaded():
        forkserver.ensure_running()
