"""Real robot arms: the limits of each, with the origin of every kind, and problems under them."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args
from zlib import crc32

import numpy as np

from trajopt.benchmark.suites import built_in
from trajopt.exceptions import InvalidInput, UnknownName
from trajopt.problem import LIMIT_NAMES, Limits, Problem

# Raise it whenever an arm, or what is drawn for it, changes.
ROBOTS_VERSION = 1

ROBOT_WAYPOINTS = (4, 8, 16)
_REACH_SHARE = 0.95  # of a joint's range, around its middle
_UNITS = {"deg": np.pi / 180, "rad": 1.0}
_NAME = re.compile(r"robots-(?P<arm>.+)-w(?P<waypoints>\d+)(?P<jerk>-jerk)?")

Status = Literal["published", "configuration", "quoted", "assumed", "memory"]


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


def arm_files() -> dict[str, Path]:
    """Every built-in arm file by name."""
    return built_in.files("robots")


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
        raise InvalidInput(
            "arm",
            "an arm file like those in data/robots",
            value=f"{type(error).__name__}: {error}",
            file=str(path),
        ) from None


def _arm(table: dict[str, Any]) -> Arm:
    name = table.pop("name")
    description = table.pop("description")
    limits: dict[str, Any] = {}
    origins = {}
    for kind in table:
        if kind not in LIMIT_NAMES:
            known = ", ".join(("name", "description", *LIMIT_NAMES))
            raise InvalidInput(kind, f"one of the keys {known}", value=table[kind])
    for kind, entry in table.items():
        values = np.array(entry.pop("values"), dtype=float)
        limits[kind] = values * _UNITS[entry.pop("angle_unit")]
        origins[kind] = Origin(**entry)
    for kind, origin in origins.items():
        statuses = get_args(Status)
        if origin.status not in statuses:
            raise InvalidInput(f"{kind}.status", " or ".join(statuses), value=origin.status)
    return Arm(name, description, Limits(**limits), origins)


def robot_problem(arm: Arm, waypoints: int, *, jerk: bool = False) -> Problem:
    """An arm's problem: waypoints drawn evenly from its joint ranges, under its own limits.

    From the middle 95 % of each range, and from at most a turn; the same waypoints with its jerk
    limits, if it has any, as without.
    """
    key = crc32(arm.name.encode())
    rng = np.random.default_rng([ROBOTS_VERSION, key, waypoints])
    # Some joints turn without end.
    turn = 2 * np.pi
    low, high = np.clip(arm.limits.position, -turn, turn).T
    half = _REACH_SHARE * (high - low) / 2
    reach = np.minimum(half, np.pi)
    middle = (low + high) / 2
    joints = len(reach)
    unit = 2 * rng.random((waypoints, joints)) - 1
    ending = "-jerk"
    limits = arm.limits
    if not jerk:
        ending = ""
        limits = limits.without("jerk")
    return Problem(
        middle + reach * unit,
        limits,
        name=f"robots-{arm.name}-w{waypoints}{ending}",
        source=f"{arm.description}; data/robots/{arm.name}.toml, version {ROBOTS_VERSION}",
    )


def stream() -> Iterator[Problem]:
    """Every arm at every size, with and without its jerk limits."""
    for name in arm_files():
        real = arm(name)
        for jerk in (False, True):
            if jerk and "jerk" not in real.origins:
                continue
            for count in ROBOT_WAYPOINTS:
                yield robot_problem(real, count, jerk=jerk)


def named(name: str) -> Problem | None:
    """The problem of this name, of any size, or None."""
    match = _NAME.fullmatch(name)
    if match is None or match["arm"] not in arm_files():
        return None
    real = arm(match["arm"])
    jerk = match["jerk"] is not None
    waypoints = int(match["waypoints"])
    if waypoints < 2 or (jerk and "jerk" not in real.origins):
        return None
    problem = robot_problem(real, waypoints, jerk=jerk)
    return problem if problem.name == name else None
