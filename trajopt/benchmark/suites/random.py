"""One random problem per seed: what the relations are tested on, made to break planners."""

from __future__ import annotations

import numpy as np

from trajopt.problem import Array, Limits, Problem

# Raise it whenever `random_problem` changes what a seed means.
GENERATOR_VERSION = 1

_LOWEST_VELOCITY = 0.1  # rad/s
_LOWEST_ACCELERATION = 0.2  # rad/s²


def random_problem(
    seed: int,
    *,
    joints: int | None = None,
    waypoints: int | None = None,
    jerk: bool = False,
) -> Problem:
    """A random problem: 1–7 joints and 3–8 waypoints unless given, reproducible from its seed.

    It includes what breaks planners: reversals (each displacement has a random sign or the joint's
    own), tiny segments (a hundredth to a millionth of the others), joints that rest (always or for
    a segment), and limits up to 100:1 apart, some of them asymmetric. With `jerk`, jerk limits of
    3 to 300 times the acceleration.
    """
    rng = np.random.default_rng([GENERATOR_VERSION, seed])
    n = joints
    if n is None:
        n = int(rng.integers(1, 8))
    count = waypoints
    if count is None:
        count = int(rng.integers(3, 9))
    h = _displacements(rng, count - 1, n)
    velocity = _limits(rng, n, _LOWEST_VELOCITY)
    acceleration = _limits(rng, n, _LOWEST_ACCELERATION)
    stiffness = None
    if jerk:
        tighter = np.abs(acceleration).min(axis=1)
        stiffness = tighter * 10 ** rng.uniform(0.5, 2.5, n)
    start = rng.uniform(-1, 1, n)
    path = np.vstack([start, start + np.cumsum(h, axis=0)])
    limits = Limits(velocity, acceleration, stiffness)
    return Problem(path, limits, name=f"random-{seed}")


def _displacements(rng: np.random.Generator, k: int, n: int) -> Array:
    h = rng.uniform(0.05, 1.5, (k, n))
    h = h * _signs(rng, k, n)
    h = h * _shrink(rng, k)[:, None]
    # One joint in ten rests in a segment, one in ten always; some joint moves in every segment.
    h *= rng.uniform(size=(k, n)) > 0.1
    h *= np.where(rng.uniform(size=n) > 0.1, 1.0, 0.0)
    still = ~h.any(axis=1)
    h[still, 0] = 0.1 * rng.uniform(0.5, 1.0)
    return h


def _signs(rng: np.random.Generator, k: int, n: int) -> Array:
    """Half of the joints go one way, the others turn back at random."""
    own = rng.choice([-1.0, 1.0], n)
    one_way = rng.uniform(size=n) < 0.5
    either = rng.choice([-1.0, 1.0], (k, n))
    return np.where(one_way, own, either)


def _shrink(rng: np.random.Generator, k: int) -> Array:
    """One segment in eight is tiny for every joint."""
    tiny = rng.uniform(size=k) < 0.125
    scale = 10 ** rng.uniform(-6, -2, k)
    return np.where(tiny, scale, 1.0)


def _limits(rng: np.random.Generator, n: int, low: float) -> Array:
    """Pairs from `low` to 100 times as much; one joint in four is asymmetric."""
    high = low * 10 ** rng.uniform(0, 2, n)
    asymmetric = rng.uniform(size=n) < 0.25
    drawn = 10 ** rng.uniform(-0.5, 0.5, n)
    ratio = np.where(asymmetric, drawn, 1.0)
    return np.stack([-high * ratio, high], axis=1)
