"""The 3-5-3 spline in closed form (docs/mathematics.md, section 1; the paper's eq. 27–33).

A cubic, a quintic and a cubic through four waypoints, from rest to rest with zero acceleration at
both ends, twice continuously differentiable. Peaks come from the roots of a quadratic (for
acceleration) and a cubic (for velocity), so they are exact, and every function takes any batch
shape: `displacements` `(…, 3)` rad and `times` `(…, 3)` s broadcast against each other.

Symbols: displacements `d1, h, d3` and times `t1, T, t3` of the segments; velocity and acceleration
`v0, a0` where the quintic starts and `v1, a1` where it ends.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.exceptions import InvalidInput
from trajopt.problem import Limits, Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]
Roots = Callable[[Array], Array]

WAYPOINTS = 4


def unsupported(problem: Problem) -> str | None:
    """Why the 3-5-3 spline is not for this problem, or None."""
    merged, _ = problem.merged()
    count = merged.segments + 1
    if count == WAYPOINTS:
        return None
    return f"the 3-5-3 spline takes exactly {WAYPOINTS} waypoints; this has {count}"


def trajectory(problem: Problem, times: Array) -> Trajectory:
    """The spline through a problem's four waypoints with shared segment times `(3,)`, s.

    Raises:
        InvalidInput: the times are not three positive numbers.
    """
    times = np.asarray(times, dtype=float)
    if times.shape != (3,) or not (np.isfinite(times) & (times > 0)).all():
        raise InvalidInput(
            "times",
            "three positive segment times in seconds",
            value=times.tolist(),
        )
    constant_term = np.array([0, 0, 0, 0, 0, 1.0])
    start = problem.waypoints[:-1, :, None] * constant_term
    pieces = start + coefficients(problem.displacements.T, times)
    breaks = np.concatenate([[0.0], np.cumsum(times)])
    return Trajectory(breaks, np.moveaxis(pieces, -1, 0), waypoint_times=breaks)


def coefficients(displacements: Array, times: Array) -> Array:
    """Each segment relative to its start, `(3, …, 6)`, highest power first, rad/s^power."""
    d1, _, d3 = _columns(displacements)
    t1, _, t3 = _columns(times)
    h, T, v0, a0, v1, a1 = _quintic(displacements, times)
    # Quintic Hermite from (0, v0, a0) to (h, v1, a1) in powers of s = t/T: h = p1 + … + p5 at 1.
    p1 = v0 * T
    p2 = a0 * T**2 / 2
    end_v = v1 * T
    end_a = a1 * T**2 / 2
    p3 = 10 * h - 6 * p1 - 3 * p2 - 4 * end_v + end_a
    p4 = -15 * h + 8 * p1 + 3 * p2 + 7 * end_v - 2 * end_a
    p5 = 6 * h - 3 * p1 - p2 - 3 * end_v + end_a
    pieces = np.zeros((3, *p5.shape, 6))
    first, second, third = pieces
    # q = d1 (t/t1)³
    first[..., 2] += d1 / t1**3
    # q = p1 (t/T) + … + p5 (t/T)⁵
    second[..., 4] = p1 / T
    second[..., 3] = p2 / T**2
    second[..., 2] = p3 / T**3
    second[..., 1] = p4 / T**4
    second[..., 0] = p5 / T**5
    # q = d3 (1 − (1 − t/t3)³) = v1 t + a1/2 t² + d3 (t/t3)³
    third[..., 4] += v1
    third[..., 3] += a1 / 2
    third[..., 2] += d3 / t3**3
    return pieces


def velocity_controls(displacements: Array, times: Array) -> Array:
    """Bernstein coefficients of the quintic's velocity, `(5, …)`, rad/s.

    The first and last are its ends, which are also the peaks of the two cubics.
    """
    return _velocity_controls(_quintic(displacements, times))


def acceleration_controls(displacements: Array, times: Array) -> Array:
    """Bernstein coefficients of the quintic's acceleration, `(4, …)`, rad/s².

    The first and last are its ends, which are also the peaks of the two cubics.
    """
    return _acceleration_controls(_quintic(displacements, times))


def limit_use(
    displacements: Array,
    times: Array,
    limits: Limits,
    exact_above: float = 0.0,
) -> tuple[Array, Array, Array]:
    """Peak velocity, acceleration and jerk over their limits, each `(…)`; 1 is at the limit.

    The last batch axis of `displacements` is the joint axis of `limits`. Where the Bernstein bound
    shows that a use stays at or below `exact_above`, the value at the segments' ends is returned
    instead of the peak: enough to know that a limit is met, and much cheaper.
    """
    quintic = _quintic(displacements, times)
    velocity = _velocity_controls(quintic)
    acceleration = _acceleration_controls(quintic)
    # The derivative of a cubic in Bernstein form: three times the differences, over T.
    jerk = 3 * np.diff(acceleration, axis=0) / quintic.T
    velocity_use = _use(
        velocity,
        limits.velocity,
        exact_above,
        slope=acceleration,
        roots=_cubic_roots,
    )
    acceleration_use = _use(
        acceleration,
        limits.acceleration,
        exact_above,
        slope=jerk,
        roots=_quadratic_roots,
    )
    jerk_use = _jerk_use(displacements, times, jerk, limits.jerk)
    return velocity_use, acceleration_use, jerk_use


def dilation(displacements: Array, times: Array, limits: Limits) -> Array:
    """The exact cheapest dilation that meets all limits of all joints (last axis), `(…)`."""
    use = limit_use(displacements, times, limits)
    return np.asarray(cheapest_dilation(*use).max(axis=-1))


def cheapest_dilation(velocity_use: Array, acceleration_use: Array, jerk_use: Array) -> Array:
    """The dilation that brings these shares of the limits to 1 (section 2), joint by joint."""
    # Dilating by k divides velocity by k, acceleration by k², jerk by k³.
    factor = np.maximum(velocity_use, np.sqrt(acceleration_use))
    return np.asarray(np.maximum(factor, np.cbrt(jerk_use)))


class _Quintic(NamedTuple):
    """The middle segment: its displacement and time, and the states in which it starts and ends."""

    h: Array
    T: Array
    v0: Array
    a0: Array
    v1: Array
    a1: Array


def _quintic(displacements: Array, times: Array) -> _Quintic:
    d1, h, d3 = _columns(displacements)
    t1, T, t3 = _columns(times)
    # Segment 1, q = d1 (t/t1)³, ends with
    v0 = 3 * d1 / t1
    a0 = 6 * d1 / t1**2
    # Segment 3, the same backwards in time, starts with
    v1 = 3 * d3 / t3
    a1 = -6 * d3 / t3**2
    return _Quintic(h, T, v0, a0, v1, a1)


def _columns(values: Array) -> tuple[Array, Array, Array]:
    """The values of the three segments, arrays also where they are one number each.

    NumPy's powers of numbers and of arrays differ in the last digit.
    """
    values = np.asarray(values, dtype=float)
    return values[..., 0], values[..., 1], values[..., 2]


def _velocity_controls(quintic: _Quintic) -> Array:
    h, T, v0, a0, v1, a1 = quintic
    # What acceleration adds to velocity in a quarter of T.
    gain = a0 * T / 4
    loss = a1 * T / 4
    # The five must have the mean h/T.
    middle = 5 * h / T - 2 * (v0 + v1) + (a1 - a0) * T / 4
    return _stacked(v0, v0 + gain, middle, v1 - loss, v1)


def _acceleration_controls(quintic: _Quintic) -> Array:
    h, T, v0, a0, v1, a1 = quintic
    # Four times the differences of the velocity's controls, over T.
    rise = 20 * h / T**2
    near_start = (12 * v0 + 8 * v1) / T
    near_end = (8 * v0 + 12 * v1) / T
    second = rise - near_start + a1 - 2 * a0
    third = -rise + near_end - 2 * a1 + a0
    return _stacked(a0, second, third, a1)


def _stacked(*controls: Array) -> Array:
    return np.stack(np.broadcast_arrays(*controls))


def _ratio(values: Array, limits: Array) -> Array:
    """Values over the limit of their own sign; `limits` `(…, 2)`."""
    low = limits[..., 0]
    high = limits[..., 1]
    return np.maximum(values / high, values / low)


def _use(
    controls: Array,
    limits: Array,
    exact_above: float,
    slope: Array,
    roots: Roots,
) -> Array:
    """Worst ratio of a Bernstein polynomial: at its ends, and where its slope is zero if needed."""
    ends = controls[[0, -1]]
    use = np.asarray(_ratio(ends, limits).max(axis=0))
    # The polynomial stays within its controls: where these are low enough, no root is needed.
    inner = controls[1:-1]
    bound = _ratio(inner, limits).max(axis=0)
    needed = bound > np.maximum(use, exact_above)
    if not needed.any():
        return use
    at = np.nan_to_num(roots(slope[:, needed]))
    values = _de_casteljau(controls[:, None, needed], np.clip(at, 0.0, 1.0))
    own_limits = np.broadcast_to(limits, (*needed.shape, 2))[needed]
    peak = _ratio(values, own_limits).max(axis=0)
    use[needed] = np.maximum(use[needed], peak)
    return use


def _jerk_use(displacements: Array, times: Array, jerk: Array, limits: Array) -> Array:
    """Worst ratio of the quintic's parabola `jerk` `(3, …)` and of the cubics' constants."""
    if not np.isfinite(limits).any():
        return np.zeros(jerk.shape[1:])
    # j = 6 d/t³
    d = np.asarray(displacements)[..., [0, 2]]
    t = np.asarray(times)[..., [0, 2]]
    cubics = 6 * d / t**3
    # The parabola b0 (1−s)² + 2 b1 s (1−s) + b2 s² turns at s = (b0 − b1)/(b0 − 2 b1 + b2).
    b0, b1, b2 = jerk
    curvature = b0 - 2 * b1 + b2
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = np.nan_to_num((b0 - b1) / curvature)
    extreme = _de_casteljau(jerk, np.clip(turn, 0.0, 1.0))
    ends = jerk[[0, -1]]
    values = np.concatenate([ends, np.moveaxis(cubics, -1, 0), extreme[None]])
    return np.asarray(_ratio(values, limits).max(axis=0))


def _de_casteljau(controls: Array, s: Array) -> Array:
    """Evaluate Bernstein polynomials `(degree + 1, …)` at `s`."""
    points = list(controls)
    while len(points) > 1:
        neighbours = itertools.pairwise(points)
        points = [a + (b - a) * s for a, b in neighbours]
    return np.asarray(points[0])


def _quadratic_roots(controls: Array) -> Array:
    """Roots of Bernstein parabolas `(3, N)`: `(2, N)`, NaN where there are none."""
    b0, b1, b2 = controls
    # (b0 − 2 b1 + b2) s² + 2 (b1 − b0) s + b0 = 0
    second = b0 - 2 * b1 + b2
    first = 2 * (b1 - b0)
    return polynomials.quadratic_roots(second, first, b0)


def _cubic_roots(controls: Array) -> Array:
    """Roots of Bernstein cubics `(4, N)`: `(3, N)`, NaN where there are fewer."""
    b0, b1, b2, b3 = controls
    # (b3 − b0 + 3 (b1 − b2)) s³ + 3 (b0 − 2 b1 + b2) s² + 3 (b1 − b0) s + b0 = 0
    third = b3 - b0 + 3 * (b1 - b2)
    second = 3 * (b0 - 2 * b1 + b2)
    first = 3 * (b1 - b0)
    return polynomials.cubic_roots(third, second, first, b0)
