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

import numpy as np

from trajopt.core.arrays import Array

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
_REACH = 0.6  # rad: most that a joint's end is from its start
_WAVES = 0.15  # rad: standard deviation of the first sine; the others have a half and a third of it


def targets(kind: str, number: int, count: int = TARGETS, joints: int = JOINTS) -> Array:
    """Return the targets of a chunk, rad, `(count, joints)`.

    Args:
        kind: one of `KINDS`.
        number: chunks of one number and of several kinds have the same way.
        count: number of targets.
        joints: number of joints.
    """
    rng = np.random.default_rng([VERSION, 66, number])
    s = np.linspace(0.0, 1.0, count)
    rise = s**3 * (10 - 15 * s + 6 * s**2)
    way = np.outer(rise, rng.uniform(-_REACH, _REACH, joints))
    for wave in (1, 2, 3):
        shape = 2 * np.sin(np.pi * wave * s) * s * (1 - s)
        way += np.outer(shape, rng.normal(0.0, _WAVES / wave, joints))
    if kind == "noisy":
        return np.asarray(way + rng.normal(0.0, NOISE, way.shape))
    if kind == "anchored":
        way[count // 2 :] += rng.choice([-1, 1], joints) * rng.uniform(*SHIFTS, joints)
    if kind == "counts":
        step = 2 * np.pi / COUNTS
        return np.asarray(np.round(way / step) * step)
    return way
