"""What the system can do with processes: adopt those that lost their parent, and end them all."""

from __future__ import annotations

import ctypes
import os
import signal
import time
from collections.abc import Collection, Iterator
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

_PATIENCE = 5.0  # s, for killed processes to be gone
_PAUSE = 0.002  # s between two looks

_SET_PARENT_DEATH_SIGNAL = 1  # of Linux's prctl
_SET_DUMPABLE = 4
_SET_CHILD_SUBREAPER = 36


class Relative(NamedTuple):
    """A process and its parent, by their numbers."""

    process: int
    parent: int


def cpus() -> int:
    """The CPUs this process may use; all of them where the system does not say."""
    affinity = getattr(os, "sched_getaffinity", None)
    return len(affinity(0)) if affinity else os.cpu_count() or 1


def adopt_orphans() -> None:
    """What descends from this process becomes its child when its own parent ends (Linux)."""
    _control(_SET_CHILD_SUBREAPER, 1)


def end_with_parent() -> None:
    """This process is killed when its parent ends (Linux)."""
    _control(_SET_PARENT_DEATH_SIGNAL, signal.SIGKILL)


def seal_memory(sealed: bool) -> None:
    """Whether other processes of this user are kept from this one's memory (Linux)."""
    _control(_SET_DUMPABLE, not sealed)


def _control(option: int, value: int) -> None:
    with suppress(AttributeError, OSError):  # not Linux
        ctypes.CDLL(None).prctl(option, value, 0, 0, 0)


def wake_on_children() -> int:
    """A descriptor that becomes readable whenever a child of this process ends."""
    readable, writable = os.pipe()
    os.set_blocking(readable, False)
    os.set_blocking(writable, False)
    signal.signal(signal.SIGCHLD, lambda *_: None)
    signal.set_wakeup_fd(writable, warn_on_full_buffer=False)
    return readable


def ended() -> dict[int, int]:
    """The children that have ended since the last look, with their exit codes (< 0: a signal)."""
    codes: dict[int, int] = {}
    with suppress(ChildProcessError):
        while True:
            process, status = os.waitpid(-1, os.WNOHANG)
            if process == 0:
                break
            codes[process] = os.waitstatus_to_exitcode(status)
    return codes


def end_children(but: Collection[int] = ()) -> None:
    """Kill every child of this process but some; orphans that it adopts meanwhile too."""
    end = time.monotonic() + _PATIENCE
    while _has_children() and time.monotonic() < end:
        own = os.getpid()
        children = {one.process for one in _relatives() if one.parent == own}
        doomed = children.difference(but)
        if not doomed:
            return
        for process in doomed:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(process, signal.SIGKILL)
        time.sleep(_PAUSE)


def _has_children() -> bool:
    """Whether this process has any, once those that have ended are forgotten."""
    try:
        while os.waitpid(-1, os.WNOHANG) != (0, 0):
            pass
    except ChildProcessError:
        return False
    return True


def memory_in_use() -> int:
    """Bytes that the descendants of this process hold: their own, and memory they share.

    What several of them share counts in each that touched it; files that are mapped do not count.
    """
    parents = dict(_relatives())
    own = os.getpid()
    total = 0
    for process in parents:
        if own in _ancestors(process, parents):
            total += _held(process)
    return total


def _ancestors(process: int, parents: dict[int, int]) -> Iterator[int]:
    while process in parents:
        process = parents[process]
        yield process


def _held(process: int) -> int:
    """Bytes of a process that are no file's (Linux)."""
    kilobytes = 0
    with suppress(OSError):
        for line in Path(f"/proc/{process}/status").read_bytes().splitlines():
            if line.startswith((b"RssAnon:", b"RssShmem:")):
                kilobytes += int(line.split()[1])
    return 1024 * kilobytes


def _relatives() -> Iterator[Relative]:
    """Every process of the system that can be seen (Linux)."""
    with suppress(OSError):
        for name in os.listdir("/proc"):
            if not name.isdigit():
                continue
            with suppress(OSError):
                facts = Path(f"/proc/{name}/stat").read_bytes()
                parent = facts.rpartition(b")")[2].split()[1]
                yield Relative(int(name), int(parent))
