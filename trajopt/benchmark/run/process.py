"""This process: whether it may start a comparison, and on how many CPUs."""

from __future__ import annotations

import multiprocessing
import os
import sys

_UNGUARDED = 77  # exit code of a worker that was about to start the comparison that started it


def refuse_in_starting_worker() -> None:
    """End this process if it is a worker that is still importing the script that started it.

    Without a guard that script calls `compare` again, there and in that one's workers. The parent
    sees them end and explains (`WorkerError`).
    """
    if getattr(multiprocessing.current_process(), "_inheriting", False):  # as multiprocessing does
        sys.exit(_UNGUARDED)


def cpus() -> int:
    """The CPUs this process may use; all of them where the system does not say."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1
