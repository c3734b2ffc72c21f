"""Named problems, real arms, suites of problems, and random ones that break planners.

    suite.problems("robots")              # every problem of a suite
    suite.problems("random", size=600)    # a random suite goes on as long as one likes

Results are kept by the digests of problems: a problem that changes never mixes with old results.
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, Literal, get_args
from zlib import crc32

import numpy as np

from trajopt.benchmark.suites import families
from trajopt.exceptions import InvalidInput, UnknownName
from trajopt.kinematics import Robot
from trajopt.problem import LIMIT_NAMES, Limits, Problem

# Raise it whenever `random_problem` changes what a seed means.
GENERATOR_VERSION = 1

# Raise it whenever an arm, or what is drawn for it, changes.
ROBOTS_VERSION = 1

ROBOT_WAYPOINTS = (4, 8, 16)
_PER_FAMILY = 18

Status = Literal["published", "configuration", "quoted", "assumed", "memory"]


def data_folder() -> Path:
    """Where the problem files live: inside the installed package, or beside it in a checkout."""
    package = Path(__file__).resolve().parents[2]
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
    return {file.stem: file for file in sorted((data_folder() / "kinematics").glob("*.toml"))}


def robot(name_or_path: str) -> Robot:
    """A robot by built-in name or path; raises `UnknownName`, or `InvalidInput` naming the key."""
    if name_or_path not in robot_files() and not Path(name_or_path).is_file():
        raise UnknownName("robot", name_or_path, robot_files())
    return Robot.from_toml(robot_files().get(name_or_path, Path(name_or_path)))


@dataclass(frozen=True)
class Origin:
    """Where an arm's limits of one kind come from. `status` is

    - `published`: the maker's own document, which was read;
    - `configuration`: a robot model or configuration in a public repository, which was read;
    - `quoted`: a book or paper, as somebody else quotes it;
    - `assumed`: nobody publishes it, `rule` says what was assumed instead;
    - `memory`: remembered, not checked.
    """

    status: Status
    source: str
    address: str = ""
    rule: str = ""


@dataclass(frozen=True, eq=False)
class Arm:
    """A real robot arm: its limits, rad and s, and the origin of each kind of them."""

    name: str
    description: str
    limits: Limits
    origins: Mapping[str, Origin]


@cache
def arm_files() -> dict[str, Path]:
    """Every built-in arm file by name."""
    return {file.stem: file for file in sorted((data_folder() / "robots").glob("*.toml"))}


def arm(name_or_path: str) -> Arm:
    """An arm by built-in name or path; raises `UnknownName`, or `InvalidInput` naming the key."""
    path = arm_files().get(name_or_path, Path(name_or_path))
    if not path.is_file():
        raise UnknownName("arm", name_or_path, arm_files())
    try:
        return _arm(tomllib.loads(path.read_text(encoding="utf-8")))
    except InvalidInput as error:
        raise error.in_file(str(path)) from None
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        right, reason = "an arm file like those in data/robots", f"{type(error).__name__}: {error}"
        raise InvalidInput("arm", right, value=reason, file=str(path)) from None


def _arm(table: dict[str, Any]) -> Arm:
    name, description = table.pop("name"), table.pop("description")
    for key in table:
        if key not in LIMIT_NAMES:
            known = ", ".join(("name", "description", *LIMIT_NAMES))
            raise InvalidInput(key, f"one of the keys {known}", value=table[key])
    units = {"deg": np.pi / 180, "rad": 1.0}
    limits: dict[str, Any] = {}
    for kind, entry in table.items():
        limits[kind] = np.array(entry.pop("values"), dtype=float) * units[entry.pop("angle_unit")]
    origins = {kind: Origin(**entry) for kind, entry in table.items()}
    for kind, origin in origins.items():
        if origin.status not in get_args(Status):
            raise InvalidInput(f"{kind}.status", " or ".join(get_args(Status)), value=origin.status)
    return Arm(name, description, Limits(**limits), origins)


def robot_problem(arm: Arm, waypoints: int, *, jerk: bool = False) -> Problem:
    """An arm's problem: waypoints drawn evenly from its joint ranges, under its own limits.

    From the middle 95 % of each range, and from at most a turn; the same waypoints with its jerk
    limits, if it has any, as without.
    """
    rng = np.random.default_rng([ROBOTS_VERSION, crc32(arm.name.encode()), waypoints])
    low, high = np.clip(arm.limits.position, -2 * np.pi, 2 * np.pi).T  # some turn without end
    reach = np.minimum(0.95 * (high - low) / 2, np.pi)
    q = (low + high) / 2 + reach * (2 * rng.random((waypoints, len(reach))) - 1)
    limits = arm.limits if jerk else arm.limits.without("jerk")
    name = f"robots-{arm.name}-w{waypoints}{'-jerk' if jerk else ''}"
    source = f"{arm.description}; data/arms/{arm.name}.toml, version {ROBOTS_VERSION}"
    return Problem(q, limits, name, source)


def _robots() -> Iterator[Problem]:
    for real in map(arm, arm_files()):
        for jerk in (False, True) if "jerk" in real.origins else (False,):
            yield from (robot_problem(real, count, jerk=jerk) for count in ROBOT_WAYPOINTS)


def _edges() -> Iterator[Problem]:
    yield from (load(name) for name in problem_files() if name != "six-axis")
    yield from families.edges()


@dataclass(frozen=True)
class Suite:
    """Problems that belong together; `stream` makes them, lazily and always the same ones.

    Where `stream` has no end, `size` is how many of them are meant by default.
    """

    name: str
    description: str
    version: int
    stream: Callable[[], Iterator[Problem]]
    size: int | None = None

    def problems(self, size: int | None = None) -> list[Problem]:
        """The first `size` problems, or fewer where there are no more."""
        if size is not None and size < 1:
            raise InvalidInput("size", "1 or more", value=size)
        return list(islice(self.stream(), size or self.size))


def suites() -> dict[str, Suite]:
    """Every suite by name; each random family is one too."""
    count, version = len(families.FAMILIES), families.VERSION
    found = [
        Suite("six-axis", "the problem of Ma et al. 2024", 1, lambda: iter([load("six-axis")])),
        Suite("edges", "degenerate problems, one kind each", families.EDGES_VERSION, _edges),
        Suite("robots", f"{len(arm_files())} real arms", ROBOTS_VERSION, _robots),
        Suite("random", "its families by turns", version, families.stream, count * _PER_FAMILY),
    ]
    for name, family in families.FAMILIES.items():
        stream = partial(families.stream, name)
        found.append(Suite(f"random-{name}", family.description, version, stream, _PER_FAMILY))
    return {suite.name: suite for suite in found}


def problems(name: str, size: int | None = None) -> list[Problem]:
    """The problems of a suite, each with its own name; raises `UnknownName` or `InvalidInput`."""
    if name not in (known := suites()):
        raise UnknownName("suite", name, known)
    return known[name].problems(size)


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
