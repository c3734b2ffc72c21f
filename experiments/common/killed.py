"""A small sweep in a process of its own, which tells each step to a pipe until it is killed."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trajopt.benchmark import compare as run
from trajopt.benchmark import trial
from trajopt.benchmark.run import workers
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import TrajoptError
from trajopt.registry import load

PHASES = ["start-up", "solving", "writing", "consolidating", "end"]


def sweep(folder: Path, jobs: int = 0, seeds: int = 8) -> list[Trial]:
    """22 trials in a second: two problems, four planners, one of them with eight seeds."""
    specs = ("ruckig-stop", "unoptimised", "exact:starts=1", "pso:iterations=20")
    planners = [(spec.partition(":")[0], load(spec)) for spec in specs]
    problems = [suite.load(name) for name in ("one-joint", "six-axis")]
    return list(run.compare(problems, planners, folder, jobs=jobs, seeds=seeds).items)


# --- in the child and its workers ---


class Told(Store):
    """A store that tells before and after it writes."""

    def write(self, trial: Trial) -> Path:
        _tell("writing")
        path = super().write(trial)
        _tell(f"solving {trial.id}")
        return path

    def consolidate(self) -> Path:
        _tell("consolidating")
        path = super().consolidate()
        _tell("end")
        return path

    def __reduce__(self) -> tuple[Any, ...]:
        return told, (self.folder,)


def told(folder: Path) -> Told:
    """Makes this process tell, be it the child or, where the store is unpickled, a worker."""
    vars(run)["Store"] = told
    vars(workers)["run"] = _run
    return Told(folder)


def _run(*args: Any) -> list[Trial]:
    _tell("solving")
    return trial.run(*args)


def _tell(words: str) -> None:
    os.write(1, f"{os.getpid()} {time.monotonic():.6f} {words}\n".encode())  # whole or not at all


# --- the one who kills ---


@dataclass(frozen=True)
class Word:
    """What a process told: when (s, monotonic clock), its phase, and the trial it just kept."""

    process: int
    time: float
    phase: str
    trial: str = ""


class Child:
    """The sweep in a process group of its own, and everything it told so far."""

    def __init__(self, folder: Path, jobs: int) -> None:
        path = folder.absolute()
        code = (
            f"from pathlib import *; from experiments.common import killed; killed.told({path!r})\n"
        )
        command = [sys.executable, "-c", code + f"killed.sweep({path!r}, {jobs})"]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, start_new_session=True
        )
        self.words = [Word(self.process.pid, time.monotonic(), "start-up")]
        self.rest = b""

    def listen(self, seconds: float = 60.0) -> bool:
        """Hear what it tells within so many seconds; False if that is nothing."""
        assert self.process.stdout
        if not select.select([self.process.stdout], [], [], seconds)[0]:
            return False
        data = os.read(self.process.stdout.fileno(), 1 << 16)
        *lines, self.rest = (self.rest + data).split(b"\n")
        for process, when, *words in (line.decode().split() for line in lines):
            self.words.append(Word(int(process), float(when), *words))
        return bool(data)

    def entered(self, phase: str, times: int) -> float:
        """When it entered this phase for the nth time (s); if it never does, its end."""
        while len(found := self.entries(phase)) < times:
            if not self.listen():
                return time.monotonic()
        return found[times - 1].time

    def entries(self, phase: str) -> list[Word]:
        return [word for word in self.words if word.phase == phase and not word.trial]

    def kill(self, workers_too: bool) -> None:
        """At once, and hear its last words. Raises `TrajoptError` if it had failed by itself."""
        (os.killpg if workers_too else os.kill)(self.process.pid, signal.SIGKILL)
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
        last = {w.process: w.phase for w in self.words if w.time <= self.died}
        return max(last.values(), key=PHASES.index)

    def lengths(self, phase: str) -> list[float]:
        """How long it was in this phase each time (s)."""
        if phase == "start-up":
            return [self.entries("solving")[0].time - self.words[0].time]
        return [self._next(word).time - word.time for word in self.entries(phase)]

    def _next(self, word: Word) -> Word:
        return next(w for w in self.words if w.process == word.process and w.time > word.time)
