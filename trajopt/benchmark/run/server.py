"""The process that judges are forked from: what every trial needs is loaded once, there.

Forking a process that has loaded solvers, or runs threads, is not safe. This one has loaded
neither, and forks a judge in milliseconds where a fresh interpreter takes half a second. It imports
from where the run does, never from the folder that the run happens to stand in, and ends all its
judges, and what planners started, when the run has ended, however that ends.

Nothing that takes long is imported here: a command starts the server first of all, and imports the
rest meanwhile.
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
from contextlib import suppress
from importlib import import_module
from typing import NoReturn

_LOADED = (
    "trajopt.benchmark.run.judge",
    "trajopt.benchmark.store.trial_file",
    "trajopt.planners.swarm_planner",
)
# `-P`: the working folder may hold a `json.py` of its own
_COMMAND = (sys.executable, "-P", "-c")
_PROGRAM = """\
import json, sys
sys.path[:] = json.loads(sys.argv[1])
from trajopt.benchmark.run import server
server.serve(int(sys.argv[2]))
"""
# so that trials side by side do not fight for cores; NumPy reads it as it loads
SINGLE_THREADED = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}


class _Server:
    """The server of one process."""

    def __init__(self) -> None:
        self.owner = os.getpid()
        self.is_used = False
        self.control, theirs = socket.socketpair()
        path = json.dumps([entry for entry in sys.path if isinstance(entry, str)])
        with theirs:
            self.process = subprocess.Popen(
                [*_COMMAND, _PROGRAM, path, str(theirs.fileno())],
                stdin=subprocess.DEVNULL,
                env=os.environ | SINGLE_THREADED,
                pass_fds=[theirs.fileno()],
                start_new_session=True,  # a Ctrl-C is the run's business
            )

    @property
    def is_mine(self) -> bool:
        """Whether it runs, and this process did not inherit it by a fork."""
        return self.owner == os.getpid() and self.process.poll() is None

    def fork(self, link: socket.socket) -> None:
        """Let it fork a judge that serves this link."""
        self.is_used = True
        socket.send_fds(self.control, [b"\0"], [link.fileno()])

    def end(self) -> None:
        """End it, with all its judges and what planners started."""
        self.control.close()
        if self.owner == os.getpid():
            if not self.is_used:  # perhaps it is still starting
                self.process.kill()
            self.process.wait()


_lock = threading.Lock()
_servers: list[_Server] = []  # the last one is used


def start() -> None:
    """Start the server, if none is running; returns at once."""
    with _lock:
        _started()


def judge() -> socket.socket:
    """The link to a new judge."""
    mine, theirs = socket.socketpair()
    with _lock, theirs:
        _started().fork(theirs)
    return mine


def _started() -> _Server:
    if not _servers or not _servers[-1].is_mine:
        server = _Server()
        atexit.register(server.end)
        _servers.append(server)
    return _servers[-1]


def serve(descriptor: int) -> NoReturn:
    """In the server: fork a judge for each descriptor that comes, until the run hangs up."""
    from trajopt.benchmark.provenance import provenance
    from trajopt.benchmark.run import judge, processes

    for name in _LOADED:
        import_module(name)
    provenance()  # for all judges: it asks git
    gc.freeze()  # else looking for garbage would copy every page in every judge
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
            for process in judges:
                with suppress(ProcessLookupError):
                    os.kill(process, signal.SIGCONT)  # if a planner stopped it
        if sources[0] in ready:
            message, links, _, _ = socket.recv_fds(control, 1, 1)
            if not message:
                processes.end_children()
                os._exit(0)
            for link in links:
                process = os.fork()
                if process == 0:
                    control.close()
                    try:
                        judge.serve(socket.socket(fileno=link))
                    finally:
                        os._exit(1)
                judges.add(process)
                os.close(link)
