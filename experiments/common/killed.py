"""A small sweep in a process of its own, which tells each step to a pipe until it is killed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trajopt import comparison as run
from trajopt.benchmark.run import judge, runner
from trajopt.benchmark.store.folder import Seen, Store, Written
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import Trial, now
from trajopt.core.exceptions import TrajoptError
from trajopt.planners.registry import named

PHASES = ["start-up", "solving", "writing", "consolidating", "end"]
SPECS = ("ruckig-stop", "unoptimised", "exact:starts=1", "pso:iterations=20")


def sweep(
    folder: Path,
    jobs: int = 0,
    seeds: int = 8,
) -> list[Trial]:
    """22 trials in a second: two problems, four planners, one of them with eight seeds."""
    problems = [suite.load(name) for name in ("one-joint", "six-axis")]
    planners = [named(spec) for spec in SPECS]
    results = run.compare(
        problems,
        planners,
        folder,
        jobs=jobs,
        seeds=seeds,
    )
    return list(results.items)


# --- in the child and its workers ---


class Told(Store):
    """A store that tells before and after it writes."""

    def write_all(
        self,
        trials: Iterable[Trial],
        instead: Callable[[Trial], Trial] | None = None,
    ) -> list[Written]:
        _tell("writing")
        stored = super().write_all(trials, instead)
        for one in stored:
            trial_id, _, _ = one.path.name.partition(".")
            _tell(f"solving {trial_id}")
        return stored

    def consolidate(self, seen: Seen | None = None) -> Path:
        _tell("consolidating")
        path = super().consolidate(seen)
        _tell("end")
        return path

    def __reduce__(self) -> tuple[Any, ...]:
        return told, (self.folder,)


def told(folder: Path) -> Told:
    """Makes this process tell, be it the child or, where the store is unpickled, a judge."""
    vars(run)["Store"] = told
    for module in (judge, runner):
        vars(module)["now"] = _now
    return Told(folder)


def _now() -> str:
    _tell("solving")
    return now()


def _tell(words: str) -> None:
    line = f"{os.getpid()} {time.monotonic():.6f} {words}\n"
    os.write(1, line.encode())  # whole or not at all


# --- the one who kills ---


_PROGRAM = """
import sys
from pathlib import Path

from experiments.common import killed

folder = Path(sys.argv[1])
killed.told(folder)
killed.sweep(folder, jobs=int(sys.argv[2]))
"""


@dataclass(frozen=True)
class Word:
    """A message of a process: its time (s, monotonic clock), phase, and the trial just kept."""

    process: int
    time: float
    phase: str
    trial: str = ""


class Child:
    """The sweep in a process group of its own, and everything it told so far."""

    def __init__(self, folder: Path, jobs: int) -> None:
        path = str(folder.absolute())
        self.process = subprocess.Popen(
            [sys.executable, "-c", _PROGRAM, path, str(jobs)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        birth = Word(self.process.pid, time.monotonic(), "start-up")
        self.words = [birth]
        self.rest = b""

    def listen(self, seconds: float = 60.0) -> bool:
        """Hear what it tells within so many seconds; False if that is nothing."""
        pipe = self.process.stdout
        assert pipe is not None
        ready, _, _ = select.select([pipe], [], [], seconds)
        if not ready:
            return False
        data = os.read(pipe.fileno(), 1 << 16)
        *lines, self.rest = (self.rest + data).split(b"\n")
        for line in lines:
            process, when, *words = line.decode().split()
            word = Word(int(process), float(when), *words)
            self.words.append(word)
        return bool(data)

    def entered(self, phase: str, times: int) -> float:
        """When it entered this phase for the nth time (s); if it never does, its end."""
        while len(self.entries(phase)) < times:
            if not self.listen():
                return time.monotonic()
        entry = self.entries(phase)[times - 1]
        return entry.time

    def entries(self, phase: str) -> list[Word]:
        return [word for word in self.words if word.phase == phase and not word.trial]

    def kill(self, workers_too: bool) -> None:
        """At once, and hear its last words. Raises `TrajoptError` if it had failed by itself."""
        if workers_too:
            os.killpg(self.process.pid, signal.SIGKILL)
        else:
            os.kill(self.process.pid, signal.SIGKILL)
        self.died = time.monotonic()
        code = self.process.wait()
        while self.listen(0):
            pass
        if code not in (0, -signal.SIGKILL):
            raise TrajoptError(f"the child ended by itself, with exit code {code}")

    def bury(self) -> None:
        """End the workers that outlived it."""
        with suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.communicate()

    @property
    def hit(self) -> str:
        """The phase in which it died: the furthest that any of its processes was in."""
        last = {word.process: word.phase for word in self.words if word.time <= self.died}
        return max(last.values(), key=PHASES.index)

    def lengths(self, phase: str) -> list[float]:
        """Return the duration of each stay in this phase, s."""
        if phase == "start-up":
            birth = self.words[0]
            first = self.entries("solving")[0]
            return [first.time - birth.time]
        return [self._next(entry).time - entry.time for entry in self.entries(phase)]

    def _next(self, word: Word) -> Word:
        """Return the next message of the same process."""
        own = [other for other in self.words if other.process == word.process]
        return next(other for other in own if other.time > word.time)
