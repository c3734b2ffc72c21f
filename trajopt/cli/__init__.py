"""The command line."""

from __future__ import annotations

import atexit
import gc
import os
import sys

STOPPED = 130  # the exit code after Ctrl-C
_OBJECTS = 200_000  # made between two looks for garbage, of which modules that load make none


def main(arguments: list[str] | None = None) -> None:
    """Run a command; `arguments` are those of the process by default."""
    gc.set_threshold(_OBJECTS)
    atexit.register(gc.freeze)  # a last look through all that was loaded takes a tenth of a second
    # matrices here are small, and a thread per core takes a tenth of a second to start
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        # here, where Ctrl-C is heard
        from trajopt.cli.app import main as run

        run(arguments)
    except KeyboardInterrupt:  # while it loads, or a second one
        sys.exit(STOPPED)
    finally:  # one that comes while Python ends changes nothing
        import signal

        signal.signal(signal.SIGINT, signal.SIG_IGN)
