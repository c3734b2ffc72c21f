"""Ends a worker's process group when the worker, or the run that it belongs to, has ended.

A program of its own, since whoever has to do this must outlive both, however they end:

    python watchdog.py WORKER RUN

with their process numbers; the worker leads its group. It imports nothing of this package, and is
started with an interpreter that loads no packages.
"""

import contextlib
import os
import select
import signal
import sys
import time

_PAUSE = 0.2  # s between two looks, where the system cannot wait for a process


def wait_for_any(processes: list[int]) -> None:
    """Return once one of these processes has ended."""
    if not hasattr(os, "pidfd_open"):  # not Linux
        while all(_lives(process) for process in processes):
            time.sleep(_PAUSE)
        return
    with contextlib.suppress(ProcessLookupError):
        ended = [os.pidfd_open(process) for process in processes]
        select.select(ended, [], [])


def _lives(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


if __name__ == "__main__":
    worker, run = (int(argument) for argument in sys.argv[1:])
    wait_for_any([worker, run])
    with contextlib.suppress(ProcessLookupError, PermissionError):
        os.killpg(worker, signal.SIGKILL)
