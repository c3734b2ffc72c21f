"""The 3-5-3 spline in closed form (docs/mathematics.md, section 1; the paper's eq. 27–33).

A cubic, a quintic and a cubic through four waypoints, from rest to rest with zero acceleration at
both ends, twice continuously differentiable. Peaks come from the roots of a quadratic (for
acceleration) and a cubic (for velocity), so they are exact. Every function takes any batch shape:
`displacements` `(…, 3)` rad and `times` `(…, 3)` s broadcast against each other.

Symbols: displacements `d1, h, d3` and times `t1, T, t3` of the segments; velocity and acceleration
`v0, a0` where the quintic starts and `v1, a1` where it ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial, reduce
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

Roots = Callable[[Array], Array]
ThreeSegments = Sequence[Any] | Array  # one value or array for each

WAYPOINTS = 4
# Rounding of a position, relative to the joint's largest displacement.
_POSITION_RTOL = 1e-12
# Largest ratio of the outer segment times to the middle one; beyond it rounding dominates.
_MAX_DOUBLINGS = 50


def unsupported(problem: Problem) -> str | None:
    """Return why the 3-5-3 spline does not fit this problem, or None."""
    merged, _ = problem.merged()
    count = merged.segments + 1
    if count == WAYPOINTS:
        return None
    return f"the 3-5-3 spline takes exactly {WAYPOINTS} waypoints; this has {count}"


def infeasible(problem: Problem) -> str | None:
    """Return why no segment times keep the position limits of four waypoints, or None.

    The only reason is a joint that passes an inner waypoint on its position limit with the speed
    `3 d1/t1` or `3 d3/t3`. In all other problems a quintic that is short compared with both cubics
    keeps the limits (proof in section 1).
    """
    merged, index = problem.merged()
    if merged.segments != 3:
        return None
    first, _, third = merged.displacements
    for inner, displacement in ((1, first), (2, third)):
        on_limit = merged.waypoints[inner, :, None] == merged.limits.position
        for joint in np.flatnonzero(on_limit.any(axis=1) & (displacement != 0)):
            number = 1 + np.searchsorted(index, inner)
            label = problem.joint_labels[joint]
            return (
                f"no 3-5-3 spline keeps the position limits: {label} is at its limit at waypoint "
                f"{number} and would pass it at speed"
            )
    return None


def trajectory(problem: Problem, times: Array) -> Trajectory:
    """Return the spline through a problem's four waypoints with shared segment times `(3,)`, s.

    Raises:
        InvalidInput: The times are not three positive numbers.
    """
    times = np.asarray(times, dtype=float)
    usable = np.isfinite(times) & (times > 0)
    if times.shape != (3,) or not usable.all():
        right = "three positive segment times in seconds"
        raise InvalidInput("times", right, value=times.tolist())
    pieces = coefficients(problem.displacements.T, times)
    pieces[..., -1] += problem.waypoints[:-1]
    passed = np.cumsum(times)
    breaks = np.concatenate([[0.0], passed])
    return Trajectory(breaks, coefficients=np.moveaxis(pieces, -1, 0), waypoint_times=breaks)


def coefficients(displacements: Array, times: Array) -> Array:
    """Return each segment relative to its start, `(3, …, 6)`, highest power first, rad/s^power."""
    d1, _, d3 = _columns(displacements)
    t1, _, t3 = _columns(times)
    quintic = Quintic.of(displacements, times)
    T = quintic.T
    p1, p2, p3, p4, p5 = _hermite(quintic)
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
    third[..., 4] += quintic.v1
    third[..., 3] += quintic.a1 / 2
    third[..., 2] += d3 / t3**3
    return pieces


def _hermite(quintic: Quintic) -> tuple[Array, ...]:
    """From `(0, v0, a0)` to `(h, v1, a1)` in powers of `s = t/T`: `p1` to `p5`, with sum h."""
    h, T, v0, a0, v1, a1 = quintic
    # In units of s: velocities times T, half the accelerations times T².
    p1 = v0 * T
    p2 = a0 * T**2 / 2
    end_v = v1 * T
    end_a = a1 * T**2 / 2
    # p3 = 10 h − 6 p1 − 3 p2 − 4 end_v + end_a, and so on.
    p3 = 10 * h - 6 * p1 - 3 * p2 - 4 * end_v + end_a
    p4 = -15 * h + 8 * p1 + 3 * p2 + 7 * end_v - 2 * end_a
    p5 = 6 * h - 3 * p1 - p2 - 3 * end_v + end_a
    return p1, p2, p3, p4, p5


class Quintic(NamedTuple):
    """The middle segment: its displacement and time, and the states in which it starts and ends.

    Attributes:
        h: Displacement, rad.
        T: Time, s.
        v0, a0: Velocity, rad/s, and acceleration, rad/s², at its start.
        v1, a1: Velocity and acceleration at its end.

    All are arrays that broadcast. The rates are given by Bernstein coefficients.
    """

    h: Array
    T: Array
    v0: Array
    a0: Array
    v1: Array
    a1: Array

    @classmethod
    def of(cls, displacements: Array, times: Array) -> Quintic:
        """Return the quintic of displacements and times `(…, 3)`."""
        return cls.between(_columns(displacements), _columns(times))

    @classmethod
    def between(cls, displacements: ThreeSegments, times: ThreeSegments) -> Quintic:
        """Return the quintic between the cubics, from three displacements and three times."""
        d1, h, d3 = displacements
        t1, T, t3 = times
        # Segment 1, q = d1 (t/t1)³, ends with
        v0 = 3 * d1 / t1
        a0 = 6 * d1 / t1**2
        # Segment 3, the same backwards in time, starts with
        v1 = 3 * d3 / t3
        a1 = -6 * d3 / t3**2
        return cls(h, T, v0, a0, v1, a1)

    def velocity(self) -> tuple[Array, ...]:
        """Its five coefficients, rad/s; the first and last are also the peaks of the cubics."""
        h, T, v0, a0, v1, a1 = self
        # The velocity gained by the end accelerations in a quarter of T.
        gain = a0 * T / 4
        loss = a1 * T / 4
        second = v0 + gain
        fourth = v1 - loss
        # The five must have the mean h/T.
        bend = (a1 - a0) * T / 4
        third = 5 * h / T - 2 * (v0 + v1) + bend
        return v0, second, third, fourth, v1

    def acceleration(self) -> tuple[Array, ...]:
        """Its four coefficients, rad/s²; the first and last are also the peaks of the cubics."""
        h, T, v0, a0, v1, a1 = self
        # Four times the differences of the velocity's coefficients, over T.
        rise = 20 * h / T**2
        near_start = (12 * v0 + 8 * v1) / T
        near_end = (8 * v0 + 12 * v1) / T
        second = rise - near_start + a1 - 2 * a0
        third = -rise + near_end - 2 * a1 + a0
        return a0, second, third, a1

    def jerk(self) -> tuple[Array, ...]:
        """Its three coefficients, rad/s³."""
        return _derivative(self.acceleration(), self.T)


def _derivative(coefficients: Sequence[Array], T: Array) -> tuple[Array, ...]:
    """Differentiate a Bernstein polynomial over a time `T`: differences times degree over `T`."""
    degree = len(coefficients) - 1
    steps = [after - before for before, after in pairwise(coefficients)]
    return tuple(degree * step / T for step in steps)


def position_coefficients(displacements: ThreeSegments, times: ThreeSegments) -> tuple[Array, ...]:
    """Return the quintic's six Bernstein coefficients, counted from its start, rad."""
    d1, h, d3 = displacements
    t1, T, t3 = times
    # A fifth of v0 T, and a twentieth of a0 T², with T/t1 alone; the same at the end.
    r1 = T / t1
    r3 = T / t3
    rise = 3 * d1 * r1 / 5
    bend = rise * r1 / 2
    last_rise = 3 * d3 * r3 / 5
    last_bend = last_rise * r3 / 2
    third = 2 * rise + bend
    fifth = h - last_rise
    fourth = fifth - last_rise - last_bend
    return 0 * h, rise, third, fourth, fifth, h


def limit_use(
    displacements: Array, times: Array, limits: Limits, exact_above: float = 0.0
) -> tuple[Array, Array, Array]:
    """Return peak velocity, acceleration and jerk over their limits, each `(…)`; 1 is at the limit.

    The last batch axis of `displacements` is the joint axis of `limits`. Where the Bernstein bound
    shows that a use stays at or below `exact_above`, the value at the segments' ends is returned
    instead of the peak. That is enough to decide whether a limit is kept, and much faster.
    """
    axes = max(np.ndim(displacements), np.ndim(times))
    d = _joints_first(displacements, axes)
    t = _joints_first(times, axes)
    joints_last = (*range(1, axes - 1), 0)
    of_velocity, of_acceleration, of_jerk = (
        _use(order, d, t, limits, exact_above).transpose(joints_last) for order in (1, 2, 3)
    )
    return of_velocity, of_acceleration, of_jerk


def keeps_limits(displacements: Array, times: Array, limits: Limits) -> Bools:
    """Return which candidates keep every limit of velocity, acceleration and jerk, `(N,)`.

    Acceleration is tested first, since it excludes most candidates of a search.

    Args:
        displacements: Of each joint, `(joints, 3)`, rad.
        times: Segment times of each candidate, shared by all joints, `(N, 3)`, s.
        limits: Of these joints.
    """
    d = _joints_first(displacements, 3)
    left = np.arange(len(times))
    for order in (2, 1, 3):
        t = _joints_first(times[left, None], 3)
        use = _use(order, d, t, limits, exact_above=1.0, decide=True)
        left = left[use.max(axis=0) <= 1]
    keeps = np.zeros(len(times), dtype=bool)
    keeps[left] = True
    return keeps


def position_room(problem: Problem) -> Array | None:
    """Return the position limits minus the second waypoint.

    `(joints, 2)`, rad; None where there are no position limits.
    """
    limits = problem.limits.position
    if not np.isfinite(limits).any():
        return None
    return limits - problem.waypoints[1, :, None]


def position_excess(displacements: Array, times: Array, room: Array) -> Array:
    """Return how far each joint leaves its position limits, over its largest displacement, `(…)`.

    It is 0 within the limits and exact elsewhere. No dilation changes it.

    Args:
        displacements: `(…, 3)`, rad; the last batch axis is the joints. No joint rests.
        times: `(…, 3)`, s.
        room: Position limits minus the second waypoint, `(joints, 2)`, rad.
    """
    d, controls = _positions(displacements, times)
    axes = controls.ndim
    # The quintic stays within the range of its controls: if they keep the limits, it does.
    excess = np.maximum(_beyond(controls, _by_joint(room, axes - 1)), 0.0)
    needed = np.flatnonzero(excess > 0)
    curves = polynomials.from_bernstein(_at(controls, needed))
    extremes = polynomials.evaluate(curves[:, None], polynomials.critical_points(curves))
    largest = np.broadcast_to(np.abs(d).max(axis=0), excess.shape)
    joint = needed // (excess.size // len(excess))
    share = _beyond(extremes, room[joint]) / largest.reshape(-1)[needed]
    flat = excess.reshape(-1)
    flat[needed] = np.maximum(share - _POSITION_RTOL, 0.0)
    return excess.transpose(*range(1, axes - 1), 0)


def position_bounds(displacements: Array, times: Array, room: Array) -> Array:
    """Return whether each joint may leave its position limits: by more than 0, rad, `(…)`.

    It is the Bernstein bound of both halves of the quintic. Arguments as of `position_excess`.
    """
    _, controls = _positions(displacements, times)
    room = _by_joint(room, controls.ndim - 1)
    bounds = np.maximum(*(_beyond(half, room) for half in _halves(controls)))
    return bounds.transpose(*range(1, bounds.ndim), 0)


def _positions(displacements: Array, times: Array) -> tuple[Array, Array]:
    """Displacements `(3, joints, …)`, and the quintic's Bernstein coefficients `(6, joints, …)`."""
    axes = max(np.ndim(displacements), np.ndim(times))
    d = _joints_first(displacements, axes)
    t = _joints_first(times, axes)
    return d, _stacked(*position_coefficients(d, t))


def _beyond(positions: Array, room: Array) -> Array:
    """Largest excess of several positions over their limits `(…, 2)`; negative within."""
    above = positions.max(axis=0) - room[..., 1]
    below = room[..., 0] - positions.min(axis=0)
    return np.maximum(above, below)


def keeping_times(displacements: Array, limits: Limits, room: Array, unit: float) -> Array:
    """Return segment times `(3,)`, s, that keep every limit, if any do (see `infeasible`).

    The outer times are doubled until the quintic is short enough beside both cubics to keep the
    position limits. Then all three are dilated to the other limits.

    Args:
        displacements: Of each joint, `(joints, 3)`, rad.
        limits: Of these joints.
        room: As for `position_excess`.
        unit: Any time, s.
    """
    outer = np.array([1.0, 0.0, 1.0])
    for doublings in range(_MAX_DOUBLINGS):
        times = unit * np.exp2(doublings * outer)
        excess = position_excess(displacements, times[None], room)
        if not excess.any():
            break
    return times * dilation(displacements, times[None], limits)


def dilation(displacements: Array, times: Array, limits: Limits) -> Array:
    """Return the least dilation that keeps all limits of all joints (last axis), exactly, `(…)`."""
    use = limit_use(displacements, times, limits)
    factor = cheapest_dilation(*use)
    return factor.max(axis=-1)


def cheapest_dilation(velocity_use: Array, acceleration_use: Array, jerk_use: Array) -> Array:
    """Return the dilation that brings these uses of the limits to 1 (section 2), by joint."""
    # Dilating by k divides velocity by k, acceleration by k², jerk by k³.
    for_acceleration = np.sqrt(acceleration_use)
    for_jerk = np.cbrt(jerk_use)
    factor = np.maximum(velocity_use, for_acceleration)
    return np.maximum(factor, for_jerk)


def _columns(values: Array) -> ThreeSegments:
    """The values of the three segments, each an array.

    NumPy's powers of numbers and of arrays differ in the last digit.
    """
    values = np.asarray(values, dtype=float)
    return [values[..., segment] for segment in range(3)]


def _joints_first(values: Array, axes: int) -> Array:
    """Values `(…, joints, 3)` as `(3, joints, …)`, padded to `axes` axes so that all broadcast.

    The candidates, of which there are many, then lie side by side in memory.
    """
    # an array stays what it is: it may be a record of symbols (`trajopt.planners.compiled`)
    array = values if isinstance(values, np.ndarray) else np.asarray(values, dtype=float)
    missing = (1,) * (axes - array.ndim)
    padded = array.reshape(missing + array.shape)
    ordered = padded.transpose(axes - 1, axes - 2, *range(axes - 2))
    return ordered.copy()


def _stacked(*controls: Array) -> Array:
    shape = (len(controls), *np.broadcast(*controls).shape)
    # the first control of a position is a constant, and no record of symbols
    table = np.empty_like(controls[1], shape=shape)
    for row, control in enumerate(controls):
        table[row] = control
    return table


def _ratio(values: Iterable[Array], limits: Array) -> Array:
    """Return the largest ratio of values to the limit on their side; `limits` `(…, 2)`."""
    several = list(values)
    # two at a time: of so few, NumPy's own maximum over an axis takes three times as long
    forwards = reduce(np.maximum, several) / limits[..., 1]
    backwards = reduce(np.minimum, several) / limits[..., 0]
    return np.maximum(forwards, backwards)


def _by_joint(limits: Array, axes: int) -> Array:
    """`(joints, 2)` as `(joints, 1, …, 2)`, for values with so many axes, joints first."""
    return limits.reshape(-1, *(1,) * (axes - 1), 2)


def _use(
    order: int, d: Array, t: Array, limits: Limits, exact_above: float, decide: bool = False
) -> Array:
    """Peak of the derivative of this order over its limit, `(joints, …)`.

    Args:
        order: 1, 2 or 3.
        d: Displacements, `(3, joints, …)`.
        t: Times, with as many axes.
        limits: Of the joints.
        exact_above: As for `limit_use`.
        decide: Whether any peak above `exact_above` may be returned for a candidate above it.
    """
    above = (exact_above, decide)
    if order == 3 and not limits.jerk_limited.any():
        return np.zeros(np.broadcast_shapes(d[0].shape, t[0].shape))
    quintic = Quintic.between(d, t)
    if order == 1:
        controls = _stacked(*quintic.velocity())
        return _peak_use(controls, limits.velocity, above, quintic.acceleration, _cubic_roots)
    acceleration = quintic.acceleration()
    jerk = partial(_derivative, acceleration, quintic.T)
    if order == 2:
        controls = _stacked(*acceleration)
        return _peak_use(controls, limits.acceleration, above, jerk, _quadratic_roots)
    controls = _stacked(*jerk())
    slope = partial(_derivative, list(controls), quintic.T)
    use = _peak_use(controls, limits.jerk, above, slope, _linear_roots)
    # The cubics have the constant jerk 6 d/t³.
    first, _, third = 6 * d / t**3
    of_cubics = _ratio((first, third), _by_joint(limits.jerk, use.ndim))
    return np.maximum(use, of_cubics)


def _peak_use(
    controls: Array,
    limits: Array,
    above: tuple[float, bool],
    slope: Callable[[], Sequence[Array]],
    roots: Roots,
) -> Array:
    """Worst ratio of Bernstein polynomials `(degree + 1, joints, …)`: `(joints, …)`.

    At their ends, and where their slope is zero if needed: `above` is `_use`'s `exact_above` and
    `decide`.
    """
    exact_above, decide = above
    own_limits = _by_joint(limits, controls.ndim - 1)
    use = _ratio(controls[:: len(controls) - 1], own_limits)
    # The polynomial stays within the range of its controls: roots are needed only above it.
    bound = _ratio(controls[1:-1], own_limits)
    enough = np.maximum(use, exact_above)
    if decide:
        # one joint above it at an end decides for the candidate
        enough = np.where(use.max(axis=0) > exact_above, np.inf, enough)
    needed = np.flatnonzero(bound > enough)
    if not needed.size:
        return use
    steepness = _stacked(*slope())
    turns = roots(_at(steepness, needed))
    # NaN, no root, becomes 0
    s = np.fmin(np.fmax(turns, 0.0), 1.0)
    inner = _at(controls, needed)
    extremes = _de_casteljau(inner[:, None], s)
    joint = needed // (use.size // len(use))
    peak = _ratio(extremes, limits[joint])
    flat = use.reshape(-1)
    flat[needed] = np.maximum(flat[needed], peak)
    return use


def _at(controls: Array, places: Indices) -> Array:
    """The polynomials at some indices of the flattened batch, `(degree + 1, N)`."""
    flat = controls.reshape(len(controls), -1)
    return flat[:, places]


def _halves(controls: Array) -> tuple[Array, Array]:
    """Bernstein coefficients of both halves, the second's from its end."""
    left, right = [], []
    points = controls
    while len(points):
        left.append(points[0])
        right.append(points[-1])
        points = (points[:-1] + points[1:]) / 2
    return _stacked(*left), _stacked(*right)


def _de_casteljau(controls: Array, s: Array) -> Array:
    """Evaluate Bernstein polynomials `(degree + 1, …)` at `s`."""
    points = controls
    while len(points) > 1:
        first = points[:-1]
        points = first + (points[1:] - first) * s
    return points[0]


def _linear_roots(controls: Array) -> Array:
    """Roots of Bernstein lines `(2, N)`: `(1, N)`, NaN or infinite without a root."""
    b0, b1 = controls
    with np.errstate(divide="ignore", invalid="ignore"):
        return (b0 / (b0 - b1))[None]


def _quadratic_roots(controls: Array) -> Array:
    """Roots of Bernstein parabolas `(3, N)`: `(2, N)`, NaN without a root."""
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
