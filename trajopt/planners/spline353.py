"""The 3-5-3 spline in closed form (docs/mathematics.md, section 1; the paper's eq. 27–33).

A cubic, a quintic and a cubic through four waypoints, from rest to rest with zero acceleration at
both ends, twice continuously differentiable. Peaks come from the roots of a quadratic (for
acceleration) and a cubic (for velocity), so they are exact, and every function takes any batch
shape: `displacements` `(…, 3)` rad and `times` `(…, 3)` s broadcast against each other.

Symbols: displacements `d1, h, d3` and times `t1, T, t3` of the segments; velocity and acceleration
`v0, a0` where the quintic starts and `v1, a1` where it ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import partial, reduce
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Limits, Problem
from trajopt.core.trajectory import Trajectory

Array = NDArray[np.float64]
Roots = Callable[[Array], Array]
Segments = tuple[Array, Array, Array]  # what the three of them have

WAYPOINTS = 4
# Of a joint's largest displacement: what rounding is worth where the quintic touches a limit.
_POSITION_RTOL = 1e-12
# To 2^-26 of the segment: a position is then exact to rounding, being flat where it turns.
_BISECTIONS = 26
# Of the outer times: beyond it their ratio to the middle one is rounding.
_MOST_DOUBLINGS = 50


def unsupported(problem: Problem) -> str | None:
    """Why the 3-5-3 spline is not for this problem, or None."""
    merged, _ = problem.merged()
    count = merged.segments + 1
    if count == WAYPOINTS:
        return None
    return f"the 3-5-3 spline takes exactly {WAYPOINTS} waypoints; this has {count}"


def infeasible(problem: Problem) -> str | None:
    """Why no segment times at all keep the position limits; None where some do, or none is asked.

    Asked of four waypoints.

    Only where a joint would pass an inner waypoint on its limit with the speed `3 d1/t1` or
    `3 d3/t3`; in all other problems a quintic that is brief beside both cubics keeps them (section
    1 has the proof).
    """
    merged, index = problem.merged()
    if merged.segments != 3:
        return None
    first, _, third = merged.displacements
    outer = {1: first, 2: third}
    for inner, displacement in outer.items():
        position = merged.waypoints[inner]
        low, high = merged.limits.position.T
        on_limit = (position == low) | (position == high)
        for joint in np.flatnonzero(on_limit & (displacement != 0)):
            number = 1 + np.searchsorted(index, inner)
            label = problem.joint_labels[joint]
            return (
                f"no 3-5-3 spline keeps the position limits: {label} is at its limit at waypoint "
                f"{number} and would pass it at speed"
            )
    return None


def trajectory(problem: Problem, times: Array) -> Trajectory:
    """The spline through a problem's four waypoints with shared segment times `(3,)`, s.

    Raises:
        InvalidInput: the times are not three positive numbers.
    """
    times = np.asarray(times, dtype=float)
    usable = np.isfinite(times) & (times > 0)
    if times.shape != (3,) or not usable.all():
        raise InvalidInput(
            "times",
            "three positive segment times in seconds",
            value=times.tolist(),
        )
    constant_term = np.array([0, 0, 0, 0, 0, 1.0])
    starts = problem.waypoints[:-1, :, None]
    pieces = starts * constant_term + coefficients(problem.displacements.T, times)
    passed = np.cumsum(times)
    breaks = np.concatenate([[0.0], passed])
    return Trajectory(
        breaks,
        coefficients=np.moveaxis(pieces, -1, 0),
        waypoint_times=breaks,
    )


def coefficients(displacements: Array, times: Array) -> Array:
    """Each segment relative to its start, `(3, …, 6)`, highest power first, rad/s^power."""
    d = _columns(displacements)
    t = _columns(times)
    d1, _, d3 = d
    t1, _, t3 = t
    quintic = Quintic.between(d, t)
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
    """From `(0, v0, a0)` to `(h, v1, a1)` in powers of `s = t/T`: `p1` to `p5`, h in sum."""
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
        v1, a1: The same at its end.

    All are arrays that broadcast, or CasADi's symbols. Coefficients are Bernstein's.
    """

    h: Any
    T: Any
    v0: Any
    a0: Any
    v1: Any
    a1: Any

    @classmethod
    def between(cls, displacements: Sequence[Any], times: Sequence[Any]) -> Quintic:
        """The quintic between the cubics, from what the three segments have."""
        d1, h, d3 = displacements
        t1, T, t3 = times
        # Segment 1, q = d1 (t/t1)³, ends with
        v0 = 3 * d1 / t1
        a0 = 6 * d1 / t1**2
        # Segment 3, the same backwards in time, starts with
        v1 = 3 * d3 / t3
        a1 = -6 * d3 / t3**2
        return cls(h, T, v0, a0, v1, a1)

    def velocity(self) -> tuple[Any, ...]:
        """Its five coefficients, rad/s; the first and last are also the peaks of the cubics."""
        h, T, v0, a0, v1, a1 = self
        # What acceleration adds to velocity in a quarter of T.
        gain = a0 * T / 4
        loss = a1 * T / 4
        second = v0 + gain
        fourth = v1 - loss
        # The five must have the mean h/T.
        bend = (a1 - a0) * T / 4
        third = 5 * h / T - 2 * (v0 + v1) + bend
        return v0, second, third, fourth, v1

    def acceleration(self) -> tuple[Any, ...]:
        """Its four coefficients, rad/s²; the first and last are also the peaks of the cubics."""
        h, T, v0, a0, v1, a1 = self
        # Four times the differences of the velocity's coefficients, over T.
        rise = 20 * h / T**2
        near_start = (12 * v0 + 8 * v1) / T
        near_end = (8 * v0 + 12 * v1) / T
        second = rise - near_start + a1 - 2 * a0
        third = -rise + near_end - 2 * a1 + a0
        return a0, second, third, a1

    def jerk(self) -> tuple[Any, ...]:
        """Its three coefficients, rad/s³."""
        return _derivative(self.acceleration(), self.T)


def _derivative(coefficients: Sequence[Any], T: Any) -> tuple[Any, ...]:
    """Of a Bernstein polynomial over a time `T`: the differences times the degree, over `T`."""
    degree = len(coefficients) - 1
    steps = [after - before for before, after in pairwise(coefficients)]
    return tuple(degree * step / T for step in steps)


def position_coefficients(displacements: Sequence[Any], times: Sequence[Any]) -> tuple[Any, ...]:
    """The quintic's six Bernstein coefficients from its start on, rad: of arrays or symbols."""
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


def velocity_controls(displacements: Array, times: Array) -> Array:
    """Bernstein coefficients of the quintic's velocity, `(5, …)`, rad/s.

    The first and last are its ends, which are also the peaks of the two cubics.
    """
    quintic = Quintic.between(_columns(displacements), _columns(times))
    return _stacked(*quintic.velocity())


def acceleration_controls(displacements: Array, times: Array) -> Array:
    """Bernstein coefficients of the quintic's acceleration, `(4, …)`, rad/s².

    The first and last are its ends, which are also the peaks of the two cubics.
    """
    quintic = Quintic.between(_columns(displacements), _columns(times))
    return _stacked(*quintic.acceleration())


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
    axes = max(np.ndim(displacements), np.ndim(times))
    d = _joints_first(displacements, axes)
    t = _joints_first(times, axes)
    uses = [
        velocity_use(d, t, limits.velocity, exact_above),
        acceleration_use(d, t, limits.acceleration, exact_above),
        jerk_use(d, t, limits.jerk),
    ]
    joints_last = (*range(1, axes - 1), 0)
    of_velocity, of_acceleration, of_jerk = (use.transpose(joints_last) for use in uses)
    return of_velocity, of_acceleration, of_jerk


def velocity_use(
    displacements: Segments,
    times: Segments,
    limits: Array,
    exact_above: float = 0.0,
) -> Array:
    """Peak velocity over its limit, `(joints, …)`, with the joints first and all axes there.

    Args:
        displacements: Of the three segments, `(joints, 1, …)` each, rad.
        times: Of the three segments, of as many axes, s.
        limits: Low and high, `(joints, 2)`, rad/s.
        exact_above: As for `limit_use`.
    """
    quintic = Quintic.between(displacements, times)
    return _use(
        _stacked(*quintic.velocity()),
        limits,
        exact_above,
        slope=quintic.acceleration,
        roots=_cubic_roots,
    )


def acceleration_use(
    displacements: Segments,
    times: Segments,
    limits: Array,
    exact_above: float = 0.0,
) -> Array:
    """Peak acceleration over its limit; as `velocity_use`."""
    quintic = Quintic.between(displacements, times)
    controls = quintic.acceleration()
    return _use(
        _stacked(*controls),
        limits,
        exact_above,
        slope=partial(_derivative, controls, quintic.T),
        roots=_quadratic_roots,
    )


def jerk_use(displacements: Segments, times: Segments, limits: Array) -> Array:
    """Peak jerk over its limit, always exact; as `velocity_use`.

    The quintic's is a parabola, the cubics' are constant.
    """
    d1, _, d3 = displacements
    t1, _, t3 = times
    shape = np.broadcast_shapes(d1.shape, t1.shape)
    if not np.isfinite(limits).any():
        return np.zeros(shape)
    quintic = Quintic.between(displacements, times)
    jerk = _stacked(*quintic.jerk())
    # j = 6 d/t³
    first = 6 * d1 / t1**3
    third = 6 * d3 / t3**3
    # The parabola b0 (1−s)² + 2 b1 s (1−s) + b2 s² turns at s = (b0 − b1)/(b0 − 2 b1 + b2).
    b0, b1, b2 = jerk
    curvature = b0 - 2 * b1 + b2
    with np.errstate(divide="ignore", invalid="ignore"):
        turn = (b0 - b1) / curvature
    turn = np.nan_to_num(turn)
    extreme = _de_casteljau(jerk, np.clip(turn, 0.0, 1.0))
    values = _stacked(b0, b2, first, third, extreme)
    return _ratio(values, _by_joint(limits, len(shape)))


def position_room(problem: Problem) -> Array | None:
    """The position limits of the joints that move, seen from the second waypoint, `(joints, 2)`.

    None where there are none at all.
    """
    moving = problem.moving
    limits = problem.limits.position[moving]
    if not np.isfinite(limits).any():
        return None
    start = problem.waypoints[1, moving]
    return np.asarray(limits - start[:, None])


def position_excess(displacements: Array, times: Array, room: Array) -> Array:
    """How far beyond its position limits each joint goes over its largest displacement, `(…)`.

    It is 0 within them, and exact elsewhere; no dilation changes it.

    Args:
        displacements: As everywhere, their last batch axis being the joints; no joint's are all 0.
        times: As everywhere.
        room: Lowest and highest position, seen from the second waypoint, `(joints, 2)`, rad.
    """
    axes = max(np.ndim(displacements), np.ndim(times))
    d = _joints_first(displacements, axes)
    t = _joints_first(times, axes)
    controls = _stacked(*position_coefficients(d, t))
    own_room = _by_joint(room, axes - 1)
    low = own_room[..., 0]
    high = own_room[..., 1]
    # The quintic stays within its controls: where these keep the limits, no root is needed.
    above = controls.max(axis=0) - high
    below = low - controls.min(axis=0)
    needed = np.maximum(above, below) > 0
    shape = needed.shape
    excess = np.zeros(shape)
    if needed.any():
        lowest, highest = _extremes(controls[:, needed])
        high = np.broadcast_to(high, shape)
        above = highest - high[needed]
        low = np.broadcast_to(low, shape)
        below = low[needed] - lowest
        distances = [np.abs(one) for one in d]
        largest = reduce(np.maximum, distances)
        largest = np.broadcast_to(largest, shape)
        beyond = np.maximum(above, below)
        beyond /= largest[needed]
        excess[needed] = np.maximum(beyond - _POSITION_RTOL, 0.0)
    joints_last = (*range(1, axes - 1), 0)
    return excess.transpose(joints_last)


def keeping_times(displacements: Array, limits: Limits, room: Array, unit: float) -> Array:
    """Segment times `(3,)`, s, that keep every limit, if any do (see `infeasible`).

    Their quintic is so brief beside both cubics that it keeps to the room: for that the outer times
    are doubled until they do. Then all three are dilated to the other limits.

    Args:
        displacements: Of each joint, `(joints, 3)`, rad.
        limits: Of these joints.
        room: As for `position_excess`.
        unit: Any time, s.
    """
    outer = np.array([1.0, 0.0, 1.0])
    for doublings in range(_MOST_DOUBLINGS):
        times = unit * np.exp2(doublings * outer)
        excess = position_excess(displacements, times[None], room)
        if not excess.any():
            break
    return np.asarray(times * dilation(displacements, times[None], limits))


def _extremes(controls: Array) -> tuple[Array, Array]:
    """The lowest and the highest value of Bernstein quintics `(6, N)`, `(N,)` each."""
    # A derivative's controls are the differences; where it vanishes its factor does not matter.
    slope = np.diff(controls, axis=0)
    turns = _quartic_crossings(slope)
    values = _de_casteljau(controls[:, None], turns)
    ends = controls[[0, -1]]
    everywhere = np.concatenate([ends, values])
    return everywhere.min(axis=0), everywhere.max(axis=0)


def _quartic_crossings(controls: Array) -> Array:
    """Instants `(4, N)` among which are all where Bernstein quartics `(5, N)` change their sign.

    Between neighbouring roots of the derivative, a cubic, there is one at most: it is bisected.
    """
    bends = np.diff(controls, axis=0)
    knots = np.zeros((5, *controls.shape[1:]))
    roots = _cubic_roots(bends)
    # NaN, no root, becomes 0
    roots = np.nan_to_num(roots)
    knots[1:4] = np.clip(roots, 0.0, 1.0)
    knots[4] = 1.0
    knots.sort(axis=0)
    powers = polynomials.from_bernstein(controls)[:, None]
    low = knots[:-1]
    high = knots[1:]
    negative = polynomials.evaluate(powers, low) < 0
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        below = polynomials.evaluate(powers, middle) < 0
        left = below == negative
        low = np.where(left, middle, low)
        high = np.where(left, high, middle)
    return np.asarray((low + high) / 2)


def dilation(displacements: Array, times: Array, limits: Limits) -> Array:
    """The exact cheapest dilation that meets all limits of all joints (last axis), `(…)`."""
    use = limit_use(displacements, times, limits)
    factor = cheapest_dilation(*use)
    return np.asarray(factor.max(axis=-1))


def cheapest_dilation(velocity_use: Array, acceleration_use: Array, jerk_use: Array) -> Array:
    """The dilation that brings these shares of the limits to 1 (section 2), joint by joint."""
    # Dilating by k divides velocity by k, acceleration by k², jerk by k³.
    for_acceleration = np.sqrt(acceleration_use)
    for_jerk = np.cbrt(jerk_use)
    factor = np.maximum(velocity_use, for_acceleration)
    return np.asarray(np.maximum(factor, for_jerk))


def _columns(values: Array) -> Segments:
    """The values of the three segments, arrays also where they are one number each.

    NumPy's powers of numbers and of arrays differ in the last digit.
    """
    values = np.asarray(values, dtype=float)
    first = values[..., 0]
    second = values[..., 1]
    third = values[..., 2]
    return first, second, third


def _joints_first(values: Array, axes: int) -> Segments:
    """The same of `(…, joints, 3)`, each `(joints, …)`, with so many axes that all broadcast.

    Side by side in memory lie then the candidates, of which there are many, and not the few joints.
    """
    array = np.asarray(values, dtype=float)
    missing = (1,) * (axes - array.ndim)
    padded = array.reshape(missing + array.shape)
    ordered = padded.transpose(axes - 1, axes - 2, *range(axes - 2))
    first, second, third = np.ascontiguousarray(ordered)
    return first, second, third


def _stacked(*controls: Array) -> Array:
    shape = np.broadcast(*controls).shape
    table = np.empty((len(controls), *shape))
    for row, control in enumerate(controls):
        table[row] = control
    return table


def _ratio(values: Iterable[Array], limits: Array) -> Array:
    """The worst of several values over the limit of its own sign; `limits` `(…, 2)`."""
    several = list(values)
    low = limits[..., 0]
    high = limits[..., 1]
    # two at a time: of so few, NumPy's own maximum over an axis takes three times as long
    forwards = reduce(np.maximum, several) / high
    backwards = reduce(np.minimum, several) / low
    return np.asarray(np.maximum(forwards, backwards))


def _by_joint(limits: Array, axes: int) -> Array:
    """`(joints, 2)` as `(joints, 1, …, 2)`, for values with so many axes, joints first."""
    return limits.reshape(-1, *(1,) * (axes - 1), 2)


def _use(
    controls: Array,
    limits: Array,
    exact_above: float,
    slope: Callable[[], Sequence[Array]],
    roots: Roots,
) -> Array:
    """Worst ratio of Bernstein polynomials `(degree + 1, joints, …)`: `(joints, …)`.

    At their ends, and where their slope is zero if needed.
    """
    shape = controls.shape[1:]
    own_limits = _by_joint(limits, len(shape))
    use = _ratio(controls[:: len(controls) - 1], own_limits)
    # The polynomial stays within its controls: where these are low enough, no root is needed.
    bound = _ratio(controls[1:-1], own_limits)
    enough = np.maximum(use, exact_above)
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


def _at(controls: Array, places: NDArray[np.intp]) -> Array:
    """The polynomials at some places of the flattened batch, `(degree + 1, N)`."""
    flat = controls.reshape(len(controls), -1)
    return flat[:, places]


def _de_casteljau(controls: Array, s: Array) -> Array:
    """Evaluate Bernstein polynomials `(degree + 1, …)` at `s`."""
    points = controls
    while len(points) > 1:
        first = points[:-1]
        points = first + (points[1:] - first) * s
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
