"""A certified trajectory as a file that other programs read: CSV, JSON, or HDF5."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trajopt.benchmark.store.folder import save
from trajopt.benchmark.trial import Trial
from trajopt.exceptions import InvalidInput, StoreError
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]


def writer(path: Path) -> Callable[[Path, Trial, float], None]:
    """The function that writes this kind of file: of its path, a trial, and samples per second.

    Raises:
        InvalidInput: for an unknown ending.
    """
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


def _sample_times(duration: float, rate: float) -> Array:
    """`rate` times per second from 0 on, and the end (s)."""
    count = int(duration * rate) + 1
    times = np.arange(count) / rate
    before_the_end = times < duration
    return np.append(times[before_the_end], duration)


def _write_csv(path: Path, trial: Trial, rate: float) -> None:
    """Samples at `rate` per second and at the end: time, then every joint's q, v, a (SI)."""
    trajectory = _certified(trial)
    times = _sample_times(trajectory.duration, rate)
    header = ["time"]
    columns = [times]
    for order, letter in enumerate("qva"):
        header += [f"{letter}{joint + 1}" for joint in range(trajectory.joints)]
        columns += list(trajectory(times, order).T)
    values = np.column_stack(columns)
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", newline="", encoding="utf-8") as file:
        rows = csv.writer(file)
        rows.writerow(header)
        rows.writerows(values.tolist())


def _write_json(path: Path, trial: Trial, rate: float) -> None:
    """The exact piecewise polynomial, and the verdict."""
    trajectory = _certified(trial)
    exact = {
        "breaks": trajectory.breaks.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }
    text = json.dumps(trial.as_dict() | exact, indent=1, default=str)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


def _write_hdf5(path: Path, trial: Trial, rate: float) -> None:
    """The whole trial, as the store keeps it; its trajectory is the claimed one."""
    save(path, trial)


_WRITERS = {
    ".csv": _write_csv,
    ".json": _write_json,
    ".h5": _write_hdf5,
}
