"""A trial: one planner on one problem with one seed, judged by the verifier."""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import time
import traceback
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt.exceptions import InvalidTrajectory, MissingBackend
from trajopt.planner import Planner, Relation, adapted
from trajopt.problem import Problem
from trajopt.registry import label
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import Certificate, verify

Array = NDArray[np.float64]

PACKAGES = ("trajopt", "numpy", "scipy", "casadi", "toppra", "ruckig", "pyscipopt", "h5py")


@dataclass(frozen=True, eq=False)
class Trial:
    """What one planner answered, and what the verifier found.

    `planner` is its name, `label` the name with the options that differ from the registered ones.
    `status` and `message` are the verdict: the planner's own status, unless the verifier found
    what no dilation can mend. `solve_time` and `setup_time` are wall seconds without and for
    building what later calls reuse; of a batch of `batch` runs solved together, each has its share.
    """

    problem: Problem
    planner: str
    label: str
    options: Mapping[str, Any]
    seed: int
    relation: Relation
    status: Status
    message: str
    solution: Solution
    certificate: Certificate | None
    setup_time: float
    solve_time: float
    batch: int
    started: str
    provenance: Mapping[str, str]

    @cached_property
    def id(self) -> str:
        """Identity: problem digest, planner, all options, seed and package version."""
        release = self.provenance["trajopt"]
        return trial_id(self.problem, self.planner, self.options, self.seed, release)

    @property
    def claimed_duration(self) -> float | None:
        """The duration of the trajectory as the planner returned it, s."""
        trajectory = self.solution.trajectory
        return None if trajectory is None else trajectory.duration

    @property
    def certified_duration(self) -> float | None:
        """The duration that the verifier vouches for, s."""
        return self.certificate.certified_duration if self.certificate else None

    @property
    def lower_bound(self) -> float | None:
        return self.solution.lower_bound

    @property
    def certified_trajectory(self) -> Trajectory | None:
        """The trajectory, dilated where it broke a limit; None where dilation cannot mend it."""
        trajectory = self.solution.trajectory
        if trajectory is None or self.certificate is None or not self.certificate.valid:
            return None
        return trajectory.dilated(max(1.0, self.certificate.dilation))

    @property
    def certified_history(self) -> Array:
        """What the search had certified after so many evaluations: `(m, 2)`, evaluations and s.

        A planner's history holds claims; the dilation that its answer needed is applied to all of
        them. NaN before the first candidate within the limits, and everywhere if the answer has no
        certified duration. It ends at all evaluations that were spent.
        """
        spent = float(self.solution.evaluations or 0)
        history = self.solution.history
        if history is None or not len(history):
            return np.array([[spent, np.nan]])
        end = [max(spent, history[-1, 0]), history[-1, 1]]
        certified = np.vstack([history, end])
        if self.certificate is None or not self.certificate.valid:
            certified[:, 1] = np.nan
        else:
            certified[:, 1] *= max(1.0, self.certificate.dilation)
        return certified

    def as_dict(self) -> dict[str, Any]:
        """For JSON: SI units, joints count from 1, None for what does not exist."""
        certified = self.certified_trajectory
        return {
            "problem": self.problem.name,
            "planner": self.planner,
            "options": dict(self.options),
            "seed": self.seed,
            "status": str(self.status),
            "message": self.message,
            "claimed_duration": self.claimed_duration,
            "certified_duration": self.certified_duration,
            "lower_bound": self.lower_bound,
            "waypoint_times": None if certified is None else certified.waypoint_times.tolist(),
            "evaluations": self.solution.evaluations,
            "setup_time": self.setup_time,
            "solve_time": self.solve_time,
            "certificate": self.certificate.as_dict() if self.certificate else None,
        }


def trial_id(
    problem: Problem, planner: str, options: Mapping[str, Any], seed: int, release: str
) -> str:
    """The trial's identity as 20 hexadecimal digits."""
    identity = [problem.digest(), planner, dict(options), seed, release]
    text = json.dumps(identity, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def judge(planner: Planner, problem: Problem, seeds: Sequence[int], name: str) -> list[Trial]:
    """Run a planner and verify its answers, one trial per seed; what it raises is recorded."""
    planner = adapted(planner)
    blank = failed(planner, problem, seeds[0], name, Status.FAILED, "")
    began, count = time.perf_counter(), len(seeds)
    solutions = _solutions(planner, problem, seeds)
    wall = (time.perf_counter() - began) / count
    relation, trials = _relation(planner, problem), []
    for seed, solution in zip(seeds, solutions, strict=True):
        status, message, certificate = verdict(problem, solution)
        setup = solution.setup_time / count
        trial = replace(blank, seed=seed, solution=solution, relation=relation, batch=count)
        trial = replace(trial, status=status, message=message, certificate=certificate)
        trials.append(replace(trial, setup_time=setup, solve_time=max(0.0, wall - setup)))
    return trials


def failed(
    planner: Planner, problem: Problem, seed: int, name: str, status: Status, message: str
) -> Trial:
    """The trial of a planner that never answered: it hung, or its process died."""
    started = datetime.now(UTC).isoformat(timespec="seconds")
    return Trial(
        problem, name, label(name, planner), planner.options(), seed, Relation.RESTRICTION, status,
        message, Solution(status, message=message), None, 0.0, 0.0, 1, started, provenance(),
    )  # fmt: skip


def verdict(problem: Problem, solution: Solution) -> tuple[Status, str, Certificate | None]:
    """The verifier's word on a solution: its status, message and certificate."""
    if solution.trajectory is None:
        if solution.status is Status.SOLVED:
            return Status.FAILED, "reported solved without a trajectory", None
        return solution.status, solution.message, None
    try:
        certificate = verify(problem, solution.trajectory)
    except InvalidTrajectory as error:
        return Status.INVALID, str(error), None
    if certificate.valid or solution.status is not Status.SOLVED:
        return solution.status, solution.message, certificate
    flaws = "; ".join(certificate.flaws)
    return Status.INVALID, "; ".join(filter(None, [solution.message, flaws])), certificate


def _relation(planner: Planner, problem: Problem) -> Relation:
    try:
        return planner.relation(problem)
    except Exception:  # the planner's fault; its trial says so
        return Relation.RESTRICTION


def _solutions(planner: Planner, problem: Problem, seeds: Sequence[int]) -> list[Solution]:
    try:
        reason = planner.unsupported(problem)
        if reason is not None:
            return [Solution(Status.UNSUPPORTED, message=reason)] * len(seeds)
        found = planner.solve_batch(problem, seeds)
        if len(found) != len(seeds):
            raise TypeError(f"solve_batch must return one Solution per seed, got {found!r:.200}")
        return [_well_formed(solution) for solution in found]
    except MissingBackend as error:
        return [Solution(Status.MISSING, message=str(error))] * len(seeds)
    except MemoryError:
        return [Solution(Status.CRASHED, message="out of memory")] * len(seeds)
    except (Exception, SystemExit):
        return [Solution(Status.CRASHED, message=traceback.format_exc())] * len(seeds)


def _well_formed(answer: Any) -> Solution:
    """The answer, or a crash that says which part of it is not what a `Solution` holds."""
    if not isinstance(answer, Solution):
        message = f"solve must return a Solution, got {answer!r:.200}"
        return Solution(Status.CRASHED, message=message)
    for name, kinds in _KINDS.items():
        if not isinstance(value := getattr(answer, name), kinds):
            message = f"Solution.{name} cannot be {value!r:.200}"
            return Solution(Status.CRASHED, message=message)
    if answer.history is not None and answer.history.shape[1:] != (2,):
        message = f"Solution.history must be (m, 2), got {answer.history.shape}"
        return Solution(Status.CRASHED, message=message)
    return answer


_KINDS: dict[str, Any] = {
    "status": Status, "trajectory": Trajectory | None, "message": str, "lower_bound": Real | None,
    "evaluations": Real | None, "history": np.ndarray | None, "setup_time": Real, "stats": Mapping,
}  # fmt: skip


@cache
def provenance() -> dict[str, str]:
    """Versions of this package and of every solver, the commit, and the machine."""
    return {name: _version(name) for name in PACKAGES} | {
        "python": platform.python_version(),
        "commit": _commit(),
        "machine": f"{platform.system()} {platform.machine()}, {os.cpu_count()} CPUs",
    }


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return ""


def _commit() -> str:
    """The commit of the checkout this runs from, marked if changed; empty when installed."""
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return ""
    command = [
        "git",
        "-C",
        str(root),
        "describe",
        "--always",
        "--dirty",
        "--abbrev=40",
        "--exclude=*",
    ]
    try:
        return subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=10
        ).stdout.strip()
    except (OSError, subprocess.TimeoutExpired):
        return ""
