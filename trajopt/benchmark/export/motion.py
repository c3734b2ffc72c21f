"""A certified trajectory as a file that other programs read: CSV, JSON, or HDF5."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from trajopt.benchmark.store.folder import save
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import InvalidInput, StoreError
from trajopt.trajectory import Trajectory


def writer(path: Path) -> Callable[[Path, Trial, float], None]:
    """The function that writes this kind of file; raises `InvalidInput` for an unknown ending."""
    if path.suffix not in _WRITERS:
        raise InvalidInput("--out", "a file ending in .csv, .json or .h5", value=str(path))
    return _WRITERS[path.suffix]


def _certified(trial: Trial) -> Trajectory:
    trajectory = trial.certified_trajectory
    if trajectory is None:
        raise StoreError(
            f"nothing to write: {trial.planner} has no certified trajectory ({trial.status})"
        )
    return trajectory


def _csv(path: Path, trial: Trial, rate: float) -> None:
    """Samples at `rate` per second and at the end: time, then every joint's q, v, a (SI)."""
    trajectory = _certified(trial)
    times = np.arange(int(trajectory.duration * rate) + 1) / rate
    times = np.append(times[times < trajectory.duration], trajectory.duration)
    header = ["time", *(f"{x}{j + 1}" for x in "qva" for j in range(trajectory.joints))]
    values = np.column_stack([times, *(trajectory(times, order) for order in range(3))])
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(header)
        rows.writerows(values.tolist())


def _json(path: Path, trial: Trial, rate: float) -> None:
    """The exact piecewise polynomial, and the verdict."""
    trajectory = _certified(trial)
    exact = {name: getattr(trajectory, name).tolist() for name in ("breaks", "coefficients")}
    path.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(trial.as_dict() | exact, indent=1, default=str)
    path.write_text(text, encoding="utf-8")


def _hdf5(path: Path, trial: Trial, rate: float) -> None:
    """The whole trial, as the store keeps it; its trajectory is the claimed one."""
    save(path, trial)


_WRITERS = {".csv": _csv, ".json": _json, ".h5": _hdf5}
