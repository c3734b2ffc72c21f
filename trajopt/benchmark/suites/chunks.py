"""Chunks of targets as a learned policy emits them, made by a stated generator.

A way from rest to rest is a quintic of `s` (no velocity and acceleration at its ends), and three
sines that vanish with their first derivative there. It is sampled at a rate. Of the same way there
are four kinds:

- smooth: the samples;
- noisy: each target of each joint is off by normal noise of 0.05°, as a policy's predictions are;
- anchored: from the middle on all targets are shifted by 20 to 70 mrad, up or down, joint by joint:
  a new chunk begins there, which was predicted from another place;
- counts: rounded to 4096 counts per turn, as a servo of a low-cost arm has them.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from itertools import count

import numpy as np

from trajopt.benchmark.suites.suite import Suite, source
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

# Raise it whenever a chunk changes.
VERSION = 1

KINDS = ("smooth", "noisy", "anchored", "counts")
RATE = 30.0
"""Targets per second."""
TARGETS, JOINTS = 50, 7
NOISE = float(np.radians(0.05))
"""Standard deviation of a noisy chunk's targets, rad."""
SHIFTS = (0.02, 0.07)
"""Least and largest shift of an anchored chunk, rad."""
COUNTS = 4096
"""Counts of an encoder per turn."""
VELOCITY, ACCELERATION, TOLERANCE = 2.0, 10.0, 0.005
"""Limits of each joint of the suite, rad/s and rad/s², and how far a target may be missed, rad."""
_OF_EACH_KIND = 3  # by default
_REACH = 0.6  # rad: most that a joint's end is from its start
_WAVES = 0.15  # rad: standard deviation of the first sine; the others have a half and a third of it


def targets(kind: str, number: int, size: int = TARGETS, joints: int = JOINTS) -> Array:
    """Return the targets of a chunk, rad, `(size, joints)`.

    Args:
        kind: one of `KINDS`.
        number: chunks of one number and of several kinds have the same way.
        size: number of targets.
        joints: number of joints.
    """
    rng = np.random.default_rng([VERSION, 66, number])
    s = np.linspace(0.0, 1.0, size)
    rise = s**3 * (10 - 15 * s + 6 * s**2)
    way = np.outer(rise, rng.uniform(-_REACH, _REACH, joints))
    for wave in (1, 2, 3):
        shape = 2 * np.sin(np.pi * wave * s) * s * (1 - s)
        way += np.outer(shape, rng.normal(0.0, _WAVES / wave, joints))
    if kind == "noisy":
        return np.asarray(way + rng.normal(0.0, NOISE, way.shape))
    if kind == "anchored":
        way[size // 2 :] += rng.choice([-1, 1], joints) * rng.uniform(*SHIFTS, joints)
    if kind == "counts":
        step = 2 * np.pi / COUNTS
        return np.asarray(np.round(way / step) * step)
    return way


def problem(kind: str, number: int) -> Problem:
    """Return the problem of a chunk: from rest to rest through its targets, as fast as can be."""
    limits = Limits([VELOCITY] * JOINTS, [ACCELERATION] * JOINTS)
    name, where = f"chunks-{kind}-{number}", source("chunks", f"version {VERSION}")
    return Problem(targets(kind, number), limits, name, where, tolerance=TOLERANCE)


def _stream() -> Iterator[Problem]:
    for number in count():
        for kind in KINDS:
            yield problem(kind, number)


def _named(name: str) -> Problem | None:
    match = re.fullmatch(rf"chunks-({'|'.join(KINDS)})-(0|[1-9]\d{{0,8}})", name)
    return problem(match[1], int(match[2])) if match else None


SUITE = Suite(
    "chunks",
    "chunks of targets as learned policies emit them, 50 within 5 mrad",
    VERSION,
    _stream,
    _named,
    size=_OF_EACH_KIND * len(KINDS),
    recorded=False,
)
