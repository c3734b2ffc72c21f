"""Adopt, watch and end processes by the means of the system; most are Linux's."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path

KILL_TIMEOUT_S = 5.0  # for killed processes to be gone
_PAUSE_S = 0.002  # between two looks

# Options of Linux's prctl.
_SET_PARENT_DEATH_SIGNAL = 1
_SET_DUMPABLE = 4
_SET_CHILD_SUBREAPER = 36


def cpus() -> int:
    """Return how many CPUs this process may use, or all where the system does not tell."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def adopt_orphans() -> None:
    """Become the parent of every descendant whose own parent ends (Linux)."""
    _control(_SET_CHILD_SUBREAPER, 1)


def end_with_parent() -> None:
    """Have this process killed when its parent ends (Linux)."""
    _control(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def seal_memory(sealed: bool) -> None:
    """Keep other processes of this user from this process's memory, or let them (Linux)."""
    _control(_SET_DUMPABLE, not sealed)


def _control(option: int, value: int) -> None:
    with suppress(AttributeError, OSError):  # not Linux
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def wake_on_children() -> int:
    """Return a descriptor that becomes readable whenever a child of this process ends."""
    readable, writable = os.pipe()
    os.set_blocking(readable, False)
    os.set_blocking(writable, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(writable, warn_on_full_buffer=False)
    return readable


def ended() -> dict[int, int]:
    """Return the exit codes of children that ended since the last call (below 0: a signal)."""
    codes: dict[int, int] = {}
    with suppress(ChildProcessError):
        while True:
            process, status = os.waitpid(-1, os.WNOHANG)
            if process == 0:
                break
            codes[process] = os.waitstatus_to_exitcode(status)
    return codes


def end_children(but: Collection[int] = ()) -> None:
    """Kill every child of this process except some, and the orphans that it adopts meanwhile."""
    deadline = time.monotonic() + KILL_TIMEOUT_S
    while _has_children() and time.monotonic() < deadline:
        own = os.getpid()
        children = {process for process, parent in _parents().items() if parent == own}
        doomed = children.difference(but)
        if not doomed:
            return
        for process in doomed:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
        time.sleep(_PAUSE_S)


def _has_children() -> bool:
    """Collect the children that have ended; tell if there are others."""
    try:
        while os.waitpid(-1, os.WNOHANG) != (0, 0):
            pass
    except ChildProcessError:
        return False
    return True


def memory_in_use() -> int:
    """Return the bytes that the descendants of this process hold, mapped files excepted.

    Memory that several of them share counts in each that has touched it.
    """
    parents = _parents()
    own = os.getpid()
    return sum(_held(process) for process in parents if own in _ancestors(process, parents))


def _ancestors(process: int, parents: dict[int, int]) -> Iterator[int]:
    while process in parents:
        process = parents[process]
        yield process


def _held(process: int) -> int:
    """Return the bytes of a process that belong to no file (Linux)."""
    kilobytes = 0
    with suppress(OSError):
        for line in Path(f"/proc/{process}/status").read_bytes().splitlines():
            if line.startswith((b"RssAnon:", b"RssShmem:")):
                kilobytes += int(line.split()[1])
    return 1024 * kilobytes


def _parents() -> dict[int, int]:
    """Return the parent of every process of the system that can be seen (Linux)."""
    parents: dict[int, int] = {}
    with suppress(OSError):
        for name in filter(str.isdigit, os.listdir("/proc")):
            with suppress(OSError):
                stat = Path(f"/proc/{name}/stat").read_bytes()
                parents[int(name)] = int(stat.rpartition(b")")[2].split()[1])
    return parents
