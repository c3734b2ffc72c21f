"""The 3-5-3 spline in closed form (mathematics, section 1; the paper's eq. 27–33).

A cubic, a quintic and a cubic through four waypoints, from rest to rest with zero acceleration at
both ends, twice continuously differentiable. Peaks come from the roots of a quadratic (for
acceleration) and a cubic (for velocity), so they are exact, and every function takes any batch
shape: `displacements` `(…, 3)` rad and `times` `(…, 3)` s broadcast against each other.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.exceptions import InvalidInput
from trajopt.problem import Limits, Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]
Roots = Callable[[Array], Array]


def unsupported(problem: Problem) -> str | None:
    """Why the 3-5-3 spline is not for this problem, or None."""
    count = problem.merged()[0].segments + 1
    return None if count == 4 else f"the 3-5-3 spline takes exactly 4 waypoints; this has {count}"


def trajectory(problem: Problem, times: Array) -> Trajectory:
    """The spline through a problem's four waypoints with shared segment times `(3,)`, s."""
    times = np.asarray(times, dtype=float)
    if times.shape != (3,) or not (np.isfinite(times) & (times > 0)).all():
        raise InvalidInput("times", "three positive segment times in seconds", value=times.tolist())
    start = problem.waypoints[:-1, :, None] * [0, 0, 0, 0, 0, 1.0]
    local = start + coefficients(problem.displacements.T, times)
    breaks = np.r_[0.0, np.cumsum(times)]
    return Trajectory(breaks, np.moveaxis(local, -1, 0), breaks)


def coefficients(displacements: Array, times: Array) -> Array:
    """Each segment relative to its start, `(3, …, 6)`, highest power first, rad/s^power."""
    (d1, h, d3), (t1, t2, t3) = _split(displacements, times)
    v0, a0, v1, a1 = _boundary(d1, d3, t1, t3)
    # Quintic Hermite from (0, v0, a0) to (h, v1, a1) over t2, in powers of t/t2.
    p1, p2, end_v, end_a = v0 * t2, a0 * t2**2 / 2, v1 * t2, a1 * t2**2 / 2
    p3 = 10 * h - 6 * p1 - 3 * p2 - 4 * end_v + end_a
    p4 = -15 * h + 8 * p1 + 3 * p2 + 7 * end_v - 2 * end_a
    p5 = 6 * h - 3 * p1 - p2 - 3 * end_v + end_a
    zero = np.zeros_like(p5)
    return np.stack(
        [
            np.stack([zero, zero, zero + d1 / t1**3, zero, zero, zero], axis=-1),
            np.stack([p5 / t2**5, p4 / t2**4, p3 / t2**3, p2 / t2**2, p1 / t2, zero], axis=-1),
            np.stack([zero, zero, zero + d3 / t3**3, a1 / 2 + zero, v1 + zero, zero], axis=-1),
        ]
    )


def velocity_controls(displacements: Array, times: Array) -> Array:
    """Bernstein coefficients of the quintic's velocity, `(5, …)`, rad/s.

    The first and last are its ends, which are also the peaks of the two cubics.
    """
    (d1, h, d3), (t1, t2, t3) = _split(displacements, times)
    v0, a0, v1, a1 = _boundary(d1, d3, t1, t3)
    middle = 5 * h / t2 - 2 * (v0 + v1) + (a1 - a0) * t2 / 4
    return np.stack(np.broadcast_arrays(v0, v0 + a0 * t2 / 4, middle, v1 - a1 * t2 / 4, v1))


def acceleration_controls(displacements: Array, times: Array) -> Array:
    """Bernstein coefficients of the quintic's acceleration, `(4, …)`, rad/s².

    The first and last are its ends, which are also the peaks of the two cubics.
    """
    (d1, h, d3), (t1, t2, t3) = _split(displacements, times)
    v0, a0, v1, a1 = _boundary(d1, d3, t1, t3)
    rise = 20 * h / t2**2
    second = rise - (12 * v0 + 8 * v1) / t2 + a1 - 2 * a0
    third = -rise + (8 * v0 + 12 * v1) / t2 - 2 * a1 + a0
    return np.stack(np.broadcast_arrays(a0, second, third, a1))


def limit_use(
    displacements: Array, times: Array, limits: Limits, exact_above: float = 0.0
) -> tuple[Array, Array, Array]:
    """Peak velocity, acceleration and jerk over their limits, each `(…)`; 1 is at the limit.

    The last batch axis of `displacements` is the joint axis of `limits`. Where the Bernstein bound
    shows that a use stays at or below `exact_above`, the value at the segments' ends is returned
    instead of the peak: enough to know that a limit is kept, and much cheaper.
    """
    velocity = velocity_controls(displacements, times)
    acceleration = acceleration_controls(displacements, times)
    jerk = 3 * np.diff(acceleration, axis=0) / np.asarray(times)[..., 1]
    use_v = _use(velocity, limits.velocity, exact_above, _cubic_roots, acceleration)
    use_a = _use(acceleration, limits.acceleration, exact_above, _quadratic_roots, jerk)
    return use_v, use_a, _jerk_use(displacements, times, jerk, limits.jerk)


def dilation(displacements: Array, times: Array, limits: Limits) -> Array:
    """The exact cheapest dilation that meets all limits of all joints (last axis), `(…)`."""
    v, a, j = limit_use(displacements, times, limits)
    return np.asarray(np.maximum(np.maximum(v, np.sqrt(a)), np.cbrt(j)).max(axis=-1))


def _split(displacements: Array, times: Array) -> tuple[tuple[Array, ...], tuple[Array, ...]]:
    d, t = np.asarray(displacements, dtype=float), np.asarray(times, dtype=float)
    return (d[..., 0], d[..., 1], d[..., 2]), (t[..., 0], t[..., 1], t[..., 2])


def _boundary(d1: Array, d3: Array, t1: Array, t3: Array) -> tuple[Array, Array, Array, Array]:
    """Velocity and acceleration where the quintic starts and ends: v0, a0, v1, a1."""
    return 3 * d1 / t1, 6 * d1 / t1**2, 3 * d3 / t3, -6 * d3 / t3**2


def _ratio(values: Array, limits: Array) -> Array:
    return np.maximum(values / limits[..., 1], values / limits[..., 0])


def _use(controls: Array, limits: Array, exact_above: float, roots: Roots, slope: Array) -> Array:
    """Worst ratio of a Bernstein polynomial: at its ends, and where its slope is zero if needed."""
    use = _ratio(controls[[0, -1]], limits).max(axis=0)
    bound = _ratio(controls[1:-1], limits).max(axis=0)
    needed = bound > np.maximum(use, exact_above)
    if needed.any():
        pairs = np.broadcast_to(limits, (*needed.shape, 2))[needed]
        inner = roots(slope[:, needed])
        values = _de_casteljau(controls[:, None, needed], np.clip(np.nan_to_num(inner), 0.0, 1.0))
        use[needed] = np.maximum(use[needed], _ratio(values, pairs).max(axis=0))
    return np.asarray(use)


def _jerk_use(displacements: Array, times: Array, jerk: Array, limits: Array) -> Array:
    """The quintic's jerk is a parabola, the cubics' is constant: 6 d/t³."""
    if not np.isfinite(limits).any():
        return np.zeros(jerk.shape[1:])
    cubics = 6 * np.asarray(displacements)[..., [0, 2]] / np.asarray(times)[..., [0, 2]] ** 3
    ends = np.concatenate([jerk[[0, -1]], np.moveaxis(cubics, -1, 0)])
    curve = jerk[0] - 2 * jerk[1] + jerk[2]
    with np.errstate(divide="ignore", invalid="ignore"):
        vertex = np.clip(np.nan_to_num((jerk[0] - jerk[1]) / curve), 0.0, 1.0)
    values = np.concatenate([ends, _de_casteljau(jerk, vertex)[None]])
    return np.asarray(_ratio(values, limits).max(axis=0))


def _de_casteljau(controls: Array, s: Array) -> Array:
    """Evaluate Bernstein polynomials `(degree + 1, …)` at `s`."""
    points = list(controls)
    while len(points) > 1:
        points = [a + (b - a) * s for a, b in itertools.pairwise(points)]
    return np.asarray(points[0])


def _quadratic_roots(b: Array) -> Array:
    """Roots of Bernstein parabolas `(3, N)`: `(2, N)`, NaN where there are none."""
    return polynomials.quadratic_roots(b[0] - 2 * b[1] + b[2], 2 * (b[1] - b[0]), b[0])


def _cubic_roots(b: Array) -> Array:
    """Roots of Bernstein cubics `(4, N)`: `(3, N)`, NaN where there are fewer."""
    third = b[3] - b[0] + 3 * (b[1] - b[2])
    return polynomials.cubic_roots(third, 3 * (b[0] - 2 * b[1] + b[2]), 3 * (b[1] - b[0]), b[0])
