"""Named problems, and random ones that exercise what breaks planners."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np

from trajopt.exceptions import InvalidInput, UnknownName
from trajopt.kinematics import Robot
from trajopt.problem import Limits, Problem

# Raise it whenever `random_problem` changes what a seed means.
GENERATOR_VERSION = 1


def data_folder() -> Path:
    """Where the problem files live: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[1]
    return next(f for f in (package / "data", package.parent / "data") if f.is_dir())


@cache
def problem_files() -> dict[str, Path]:
    """Every built-in problem file by name, the paper's own first."""
    files = sorted(
        (data_folder() / "problems").glob("*.toml"), key=lambda f: (f.stem != "six-axis", f)
    )
    return {file.stem: file for file in files}


def find(name_or_path: str) -> Path:
    """The file of a problem, from its built-in name or its path; a path has a dot or a slash.

    Raises `UnknownName` with the names there are, or `InvalidInput` if the file does not exist.
    """
    if name_or_path in problem_files():
        return problem_files()[name_or_path]
    path = Path(name_or_path)
    if path.is_file():
        return path
    if path.suffix or len(path.parts) > 1:
        raise InvalidInput(
            "problem", "a problem file that exists, or a built-in name", file=name_or_path
        )
    raise UnknownName("problem", name_or_path, problem_files())


def load(name_or_path: str) -> Problem:
    """A problem by built-in name or path; errors name the file, key, joint and value."""
    return Problem.from_toml(find(name_or_path))


@cache
def robot_files() -> dict[str, Path]:
    """Every built-in robot file by name."""
    return {file.stem: file for file in sorted((data_folder() / "robots").glob("*.toml"))}


def robot(name_or_path: str) -> Robot:
    """A robot by built-in name or path; raises `UnknownName`, or `InvalidInput` naming the key."""
    if name_or_path not in robot_files() and not Path(name_or_path).is_file():
        raise UnknownName("robot", name_or_path, robot_files())
    return Robot.from_toml(robot_files().get(name_or_path, Path(name_or_path)))


def random_problem(
    seed: int, *, joints: int | None = None, waypoints: int | None = None, jerk: bool = False
) -> Problem:
    """A random problem: 1–7 joints and 3–8 waypoints unless given, reproducible from its seed.

    It includes what breaks planners: reversals (each displacement has a random sign or the joint's
    own), tiny segments (a hundredth to a millionth of the others), joints that rest (always or for
    a segment), and limits up to 100:1 apart, some of them asymmetric. With `jerk`, jerk limits of
    3 to 300 times the acceleration.
    """
    rng = np.random.default_rng([GENERATOR_VERSION, seed])
    n = joints or int(rng.integers(1, 8))
    k = (waypoints or int(rng.integers(3, 9))) - 1
    h = rng.uniform(0.05, 1.5, (k, n)) * _signs(rng, k, n) * _shrink(rng, k)[:, None]
    h *= rng.uniform(size=(k, n)) > 0.1
    h *= np.where(rng.uniform(size=n) > 0.1, 1.0, 0.0)
    h[~h.any(axis=1), 0] = 0.1 * rng.uniform(0.5, 1.0)
    limits = {
        name: _limits(rng, n, low) for name, low in (("velocity", 0.1), ("acceleration", 0.2))
    }
    if jerk:
        limits["jerk"] = np.abs(limits["acceleration"]).min(axis=1) * 10 ** rng.uniform(0.5, 2.5, n)
    start = rng.uniform(-1, 1, n)
    return Problem(
        np.vstack([start, start + np.cumsum(h, axis=0)]), Limits(**limits), f"random-{seed}"
    )


def _signs(rng: np.random.Generator, k: int, n: int) -> np.ndarray:
    """Half of the joints go one way, the others turn back at random."""
    own = rng.choice([-1.0, 1.0], n)
    return np.where(rng.uniform(size=n) < 0.5, own, rng.choice([-1.0, 1.0], (k, n)))


def _shrink(rng: np.random.Generator, k: int) -> np.ndarray:
    """One segment in eight is tiny for every joint."""
    return np.where(rng.uniform(size=k) < 0.125, 10 ** rng.uniform(-6, -2, k), 1.0)


def _limits(rng: np.random.Generator, n: int, low: float) -> np.ndarray:
    """Pairs from `low` to 100 times as much; one joint in four is asymmetric."""
    high = low * 10 ** rng.uniform(0, 2, n)
    ratio = np.where(rng.uniform(size=n) < 0.25, 10 ** rng.uniform(-0.5, 0.5, n), 1.0)
    return np.stack([-high * ratio, high], axis=1)
