"""Fork judges from one small process, which has loaded what every trial needs.

It is not safe to fork a process that runs threads or has loaded solvers. The server has done
neither, and forks a judge in milliseconds, where a fresh interpreter takes half a second. What of
SciPy a comparison's planners require it loads once for all of them: a third of a second. It
imports this package from where the run does, all else as a fresh interpreter, and only then from
the run's other folders: a `json.py` beside a script hides nothing. When the run ends, in whatever
way, the server kills all judges and everything that planners started.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Collection
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import NoReturn

_LOADED = ("trajopt.benchmark.run.judge", "trajopt.planners.swarm_planner")
# `-P`: the working folder may hold a `json.py` of its own.
_COMMAND = (sys.executable, "-P", "-c")
_PROGRAM = """\
import json, sys
folder, others, descriptor = sys.argv[1:]
own = [*sys.path]
sys.path.insert(0, folder)
import trajopt
sys.path[:] = dict.fromkeys([*own, *json.loads(others)])
from trajopt.benchmark.run import server
server.serve(int(descriptor))
"""
_SHARED = ("scipy.linalg", "scipy.optimize")  # start no threads
_END_TIMEOUT_S = 30.0  # for killed processes to be gone
_START_TIMEOUT_S = 60.0  # for a judge to say that it runs
_STARTED = b"\n"  # what it says
_DYING_S = 1.0  # from the end of its links to that of a server
_FORK = b"\xff"  # a message; any other is a number in `_SHARED`
# Trials that run side by side must not fight for cores. NumPy reads this when it is imported.
SINGLE_THREADED = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class _Server:
    """The server of one process."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self.control, theirs = socket.socketpair()
        folder = str(Path(__file__).parents[3])
        others = json.dumps([entry for entry in sys.path if isinstance(entry, str)])
        with theirs:
            self.process = subprocess.Popen(
                [*_COMMAND, _PROGRAM, folder, others, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                env=os.environ | SINGLE_THREADED,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # Ctrl-C is for the run alone
            )
        atexit.register(self.end)

    @property
    def is_usable(self) -> bool:
        """Tell if it runs and belongs to this process, not to one that forked this process."""
        return self.owner == os.getpid() and self.process.poll() is None

    def end(self) -> None:
        """End it, all its judges and what planners started."""
        self.control.close()
        if self.owner != os.getpid():
            return
        self.process.send_signal(signal.SIGCONT)
        try:
            self.process.wait(_END_TIMEOUT_S)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()


_lock = threading.Lock()
_servers: list[_Server] = []  # the last one is used


def judge_link(starts: int = 3) -> socket.socket:
    """Start a judge; return the link to it.

    A planner may just have killed the server, or stopped it: then another one starts the judge.

    Args:
        starts: How many servers are tried.
    """
    mine, theirs = socket.socketpair()
    with _lock, theirs:
        control = _control()
        used = _servers[-1]
        with suppress(OSError):  # it is not there any more
            socket.send_fds(control, [_FORK], [theirs.fileno()])
    if _has_started(mine, used) or starts == 1:
        return mine
    mine.close()
    return judge_link(starts - 1)


def _has_started(link: socket.socket, used: _Server) -> bool:
    """Wait until a judge runs; return False if its server is gone, which may take a moment."""
    link.settimeout(_START_TIMEOUT_S)
    with suppress(ConnectionError, subprocess.TimeoutExpired):
        try:
            if link.recv(len(_STARTED)):
                link.settimeout(None)
                return True
            used.process.wait(_DYING_S)
        except TimeoutError:
            used.end()
    return False


def load(required: Collection[str]) -> None:
    """Have later judges' planners find those of `_SHARED` loaded that they require."""
    with _lock:
        for number, name in enumerate(_SHARED):
            if name in required:
                with suppress(OSError):  # it has just been killed
                    _control().sendall(bytes([number]))


def _control() -> socket.socket:
    """Return the link to a server that runs."""
    if not _servers or not _servers[-1].is_usable:
        _servers.append(_Server())
    _servers[-1].process.send_signal(signal.SIGCONT)  # a planner may have stopped it
    return _servers[-1].control


def serve(descriptor: int) -> NoReturn:
    """Fork a judge for each descriptor that arrives, in the server, until the run hangs up."""
    from trajopt.benchmark.provenance import provenance
    from trajopt.benchmark.run import judge, processes

    for name in _LOADED:
        import_module(name)
    provenance()  # runs git: once here, for all judges
    gc.freeze()  # else garbage collection would copy every page in every judge
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    processes.adopt_orphans()
    child_ended = processes.wake_on_children()
    control = socket.socket(fileno=descriptor)
    judges: set[int] = set()
    sources = (control.fileno(), child_ended)
    while True:
        ready, _, _ = select.select(sources, [], [])
        if child_ended in ready:
            os.read(child_ended, 4096)
            judges -= processes.ended().keys()
            processes.end_children(but=judges)  # orphans of a judge that was killed
        if sources[0] in ready:
            message, links, _, _ = socket.recv_fds(control, 1, 1)
            if not message:
                processes.end_children()
                os._exit(0)
            if message != _FORK:
                with suppress(ImportError):  # the planner meets it again, and is recorded
                    import_module(_SHARED[message[0]])
                gc.freeze()
            for link in links:
                process = os.fork()
                if process == 0:
                    control.close()
                    try:
                        mine = socket.socket(fileno=link)
                        mine.sendall(_STARTED)
                        judge.serve(mine)
                    finally:
                        os._exit(1)
                judges.add(process)
                os.close(link)
