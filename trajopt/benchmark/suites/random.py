"""One random problem per seed, difficult for planners, to test relations between planners on."""

from __future__ import annotations

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

# Raise it whenever `random_problem` changes what a seed means.
GENERATOR_VERSION = 1

Generator = np.random.Generator

_LOWEST_VELOCITY = 0.1  # rad/s
_LOWEST_ACCELERATION = 0.2  # rad/s²


def random_problem(
    seed: int, *, joints: int | None = None, waypoints: int | None = None, jerk: bool = False
) -> Problem:
    """Return a random problem, reproducible from its seed.

    It has 1 to 7 joints and 3 to 8 waypoints, unless given. It includes what is difficult for
    planners: reversals (each displacement has a random sign or the joint's own), tiny segments (a
    hundredth to a millionth of the others), joints that rest (always or for a segment), and limits
    up to 100:1 apart, some of them asymmetric. With `jerk`, jerk limits are 3 to 300 times the
    acceleration limits.
    """
    rng = np.random.default_rng([GENERATOR_VERSION, seed])
    if joints is None:
        joints = int(rng.integers(1, 8))
    if waypoints is None:
        waypoints = int(rng.integers(3, 9))
    h = _displacements(rng, waypoints - 1, joints)
    velocity = _limits(rng, joints, _LOWEST_VELOCITY)
    acceleration = _limits(rng, joints, _LOWEST_ACCELERATION)
    jerk_limits = None
    if jerk:
        tighter = np.abs(acceleration).min(axis=1)
        decades = rng.uniform(0.5, 2.5, joints)
        jerk_limits = tighter * 10**decades
    start = rng.uniform(-1, 1, joints)
    travelled = np.cumsum(h, axis=0)
    path = np.vstack([start, start + travelled])
    limits = Limits(velocity, acceleration, jerk_limits)
    return Problem(path, limits, name=f"random-{seed}")


def _displacements(rng: Generator, segments: int, joints: int) -> Array:
    """Displacements `(segments, joints)`, rad."""
    shape = (segments, joints)
    h = rng.uniform(0.05, 1.5, shape)
    h *= _signs(rng, segments, joints)
    h *= _shrink(rng, segments)[:, None]
    # One joint in ten rests in a segment, one in ten always.
    moves = rng.uniform(size=shape)
    h *= moves > 0.1
    ever_moves = rng.uniform(size=joints)
    h *= ever_moves > 0.1
    # Some joint moves in every segment.
    still = ~h.any(axis=1)
    little = rng.uniform(0.5, 1.0)
    h[still, 0] = 0.1 * little
    return h


def _signs(rng: Generator, segments: int, joints: int) -> Array:
    """Return signs: half of the joints move in one direction, the others reverse at random."""
    either = [-1.0, 1.0]
    own = rng.choice(either, joints)
    lots = rng.uniform(size=joints)
    one_way = lots < 0.5
    each_segment = rng.choice(either, (segments, joints))
    return np.where(one_way, own, each_segment)


def _shrink(rng: Generator, segments: int) -> Array:
    """One segment in eight is tiny for every joint."""
    lots = rng.uniform(size=segments)
    tiny = lots < 0.125
    exponent = rng.uniform(-6, -2, segments)
    scale = 10**exponent
    return np.where(tiny, scale, 1.0)


def _limits(rng: Generator, joints: int, low: float) -> Array:
    """Pairs from `low` to 100 times as much; one joint in four is asymmetric."""
    decades = rng.uniform(0, 2, joints)
    high = low * 10**decades
    lots = rng.uniform(size=joints)
    asymmetric = lots < 0.25
    half_decades = rng.uniform(-0.5, 0.5, joints)
    drawn = 10**half_decades
    ratio = np.where(asymmetric, drawn, 1.0)
    return np.stack([-high * ratio, high], axis=1)
