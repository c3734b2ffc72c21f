"""The command line. In reading order:

- `app`: the commands, exit codes and errors in one line;
- `console`: prints text, tables and progress;
- `parameters`, `asked`: flags that several commands share;
- `plan`, `explain`, `judge`, `verify`, `prove`: one problem or motion;
- `compare` with `problem_tables`, `suite_table`, `against`: many trials and their tables;
- `listing`, `suite`, `new`, `claims`, `best_known`: problems and what is known of them;
- `export`, `report`: files made of stored trials.
"""

from __future__ import annotations

import atexit
import gc
import os
import sys

STOPPED = 130  # the exit code after Ctrl-C
GC_THRESHOLD = 200_000  # objects between two garbage collections, since imports leave no garbage


def main(arguments: list[str] | None = None) -> None:
    """Run a command; `arguments` are those of the process by default."""
    gc.set_threshold(GC_THRESHOLD)
    atexit.register(gc.freeze)  # the last garbage collection would take 0.1 s
    # Matrices here are small, and starting a thread per core takes 0.1 s.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        # imported here, where Ctrl-C is caught
        from trajopt.cli.app import main as run

        run(arguments)
    except KeyboardInterrupt:  # during imports, or a second Ctrl-C
        sys.exit(STOPPED)
    finally:  # Ctrl-C while Python ends is ignored
        import signal

        signal.signal(signal.SIGINT, signal.SIG_IGN)
