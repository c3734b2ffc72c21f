"""Run a command on an input; measure time and memory; list broken promises."""

from __future__ import annotations

import contextlib
import io
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from trajopt.cli import app
from trajopt.core.exceptions import TrajoptError

LONGEST_S = 10.0  # of CPU
MEMORY_MB = 500.0  # whole process
WARNING = "trajopt: warning: "
MOST_WARNINGS = 2  # beside the one line of an error: of a damaged file, and of what else it has
LONGEST_LINE = 1500  # characters
ESCAPES = ("\x1b[31m", "\x1b]0;title\x07", "\x9b2J", "\r", "\u202e")


@dataclass(frozen=True)
class CommandOutcome:
    """Outcome of a command: exit code, texts, traceback, CPU seconds, MB."""

    code: int
    out: str
    err: str
    trace: str
    seconds: float
    megabytes: float

    def faults(self) -> list[str]:
        """List broken promises: one line of error, no traceback, bounded time and memory."""
        found = []
        lines = self.err.strip().splitlines()
        warned = [line for line in lines if line.startswith(WARNING)]
        errors = [line for line in lines if not line.startswith(WARNING)]
        if self.trace:
            last = self.trace.strip().splitlines()[-1]
            found.append(f"traceback: {last}")
        elif "Traceback" in self.err:
            found.append(f"traceback: {lines[-1]}")
        elif self.code not in (0, 1, 2):
            found.append(f"exit code {self.code}")
        if self.code == 2 and len(errors) != 1:
            found.append(f"{len(errors)} lines of error")
        if len(warned) > MOST_WARNINGS:
            found.append(f"{len(warned)} warnings")
        longest = max(map(len, lines), default=0)
        if longest > LONGEST_LINE:
            found.append(f"a line of {longest} characters")
        if any(escape in self.out + self.err for escape in ESCAPES):
            found.append("an escape sequence")
        if self.seconds > LONGEST_S:
            found.append(f"{self.seconds:.0f} s")
        if self.megabytes > MEMORY_MB:
            found.append(f"{self.megabytes:.0f} MB")
        return found


def by(command: Sequence[str] | Callable[[], object]) -> CommandOutcome:
    """Return the outcome of a command, or of a reader in Python: its errors are exit code 2."""
    out = io.StringIO()
    err = io.StringIO()
    code = 0
    trace = ""
    _forget_peak()
    began = time.process_time()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            if callable(command):
                command()
            else:
                app.main(list(command))
        except SystemExit as end:
            code = int(end.code or 0)
        except TrajoptError as error:
            print(error, file=err)
            code = 2
        except Exception:
            trace = traceback.format_exc()
    return CommandOutcome(
        code,
        out.getvalue(),
        err.getvalue(),
        trace,
        seconds=time.process_time() - began,
        megabytes=_peak_mb(),
    )


def _forget_peak() -> None:
    """Reset the peak memory of this process (Linux)."""
    Path("/proc/self/clear_refs").write_text("5")


def _peak_mb() -> float:
    status = Path("/proc/self/status").read_text()
    (line,) = [line for line in status.splitlines() if line.startswith("VmHWM")]
    return int(line.split()[1]) / 1024
