"""Planners that mean harm, or have an accident: their code is in `nasty_planners.toml`."""

from __future__ import annotations

import gc
import json
import mmap
import os
import pickle
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
import tomllib
import types
import warnings
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from trajopt.benchmark import trial
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging import verification
from trajopt.judging.certificate import Certificate
from trajopt.planners.planner import Planner

PROBLEM = Problem([[0.0], [1.0]], Limits([1.0], [1.0]), "one joint, 1 rad")
OPTIMUM = 2.0  # s: 1 rad at 1 rad/s and 1 rad/s², all of it accelerating or braking

_FILE = Path(__file__).with_name("data") / "nasty_planners.toml"
_SLEEP = "import time; time.sleep(600)"


class Bomb:
    """An object that leaves a mark in any process that unpickles it."""

    def __init__(self, mark: str) -> None:
        self.mark = mark

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (f"touch {self.mark}",)


@dataclass(frozen=True)
class Nasty(Planner):
    """A planner that runs a text as its code; it notes in `notes` what it started."""

    code: str
    notes: str
    loading: str = ""

    def __setstate__(self, state: dict[str, Any]) -> None:
        for name, value in state.items():
            object.__setattr__(self, name, value)
        exec(self.loading, self._names(PROBLEM, 0))

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        names = self._names(problem, seed)
        exec(self.code, names)
        answer: Solution = names["answer"]
        return answer

    def _names(self, problem: Problem, seed: int) -> dict[str, Any]:
        """Return the names that its code can use."""
        notes = Path(self.notes)
        claim = honest(problem).dilated(0.5)

        def note(process: int) -> None:
            with (notes / "processes").open("a") as file:
                file.write(f"{process}\n")

        return globals() | {
            "planner": self,
            "problem": problem,
            "seed": seed,
            "notes": notes,
            "note": note,
            "SLEEP": _SLEEP,
            "honest": honest(problem),
            "claim": claim,
            "answer": Solution(Status.SOLVED, claim),
            "forged": forged,
        }


def honest(problem: Problem) -> Trajectory:
    """Return the optimum: half of the way at full acceleration, half at full braking."""
    half = 0.5 * OPTIMUM
    way = problem.waypoints[1] - problem.waypoints[0]
    pieces = np.zeros((3, 2, problem.joints))
    pieces[:, 0] = [0.5 * way, 0.0 * way, problem.waypoints[0]]
    pieces[:, 1] = [-0.5 * way, way, problem.waypoints[0] + 0.5 * way]
    return Trajectory(np.array([0.0, half, OPTIMUM]), pieces, np.array([0.0, OPTIMUM]))


def forged(problem: Problem, trajectory: Trajectory, *_: Any) -> Certificate:
    """Return a certificate that accepts any motion."""
    certificate = _VERIFY(PROBLEM, honest(PROBLEM))
    return replace(certificate, duration=trajectory.duration, dilation=0.5)


_VERIFY = verification.verify


_MODULES = (gc, json, mmap, os, pickle, re, shutil, signal, subprocess, sys, threading, time, types)
_OTHERS = (suppress, warnings, trial)  # other modules that their code uses


def planners(folder: Path) -> dict[str, Nasty]:
    """Return every planner of the file by its name, with a folder each for its notes."""
    found = {}
    for number, (name, row) in enumerate(tomllib.loads(_FILE.read_text()).items()):
        notes = folder / str(number)
        notes.mkdir(parents=True)
        found[name] = Nasty(notes=str(notes), **row)
    return found
