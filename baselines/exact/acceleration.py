"""The exact minimum time with velocity and acceleration limits (mathematics, section 3).

No discretisation. For one joint over one segment of time `T` with end velocities `u`, `w`, the
displacements that the limits allow fill an interval `[D_lo, D_up]`; its ends come from speeding up
to a peak `p`, cruising and braking. With the peaks as variables the minimum-time problem is a small
smooth NLP over segment times, waypoint velocities and peaks. It is not convex, so there are several
starts, and the answer is the best known, not a proof. From each an interior-point method made for
this program (`exact.crossover`) leads to a local optimum, or IPOPT where that fails.

    from baselines.exact.acceleration import Exact
    solution = Exact().solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from baselines.exact.acceleration_motion import Task, pieces
from baselines.exact.acceleration_profiles import extremes
from baselines.exact.crossover import Passage, minimised
from baselines.exact.several_starts import Optimum, SeveralStarts, statistics
from baselines.ipopt import Program, flat, optima_together, program, unflat
from baselines.sizes import announce, cells
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import backend, passing_once
from trajopt.planners.rest_to_rest import trapezoidal

Array = NDArray[np.float64]
Start = tuple[Array, Array]  # segment times, waypoint velocities

IPOPT: dict[str, float | str] = {
    "tol": 1e-11,
    "constr_viol_tol": 1e-10,
    "acceptable_tol": 1e-8,
    "bound_relax_factor": 0.0,
    "mu_strategy": "adaptive",
    "max_iter": 1000,
    "mumps_pivot_order": 0,  # approximate minimum degree: a fifth faster here than MUMPS's choice
}

_PATIENCE = 5  # times as many starts where all have failed so far
_VELOCITY_RTOL = 1e-15  # rounding of a velocity
_LARGEST_DILATION = 2.0  # what needs more is no answer
_DILATION_TOL = 2e-15
# What a velocity that is at its limit in the optimum misses it by: the duration feels the square.
_LIMIT_RTOL = 1e-9
_ROUNDED_TIME_RTOL = 1e-9  # of a segment's time: what its velocities can follow its rounding by
# A start's time: in proportion to cells (segments times moving joints), measured up to 7000; and
# where there are many joints to their square too, measured up to 250.
_SECONDS_PER_CELL = 2e-4
_SECONDS_PER_CELL_AND_PAIR = 3e-9


@dataclass(frozen=True)
class Exact(SeveralStarts):
    """Exact minimum time under velocity and acceleration limits (several starts).

    On 2000 random problems all of 64 starts led to one optimum (`experiments/local_optima.py`), so
    what the second of two that agree is for is a start that ends badly.
    """

    requires = ("casadi", "scipy.linalg")

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best local optimum of `starts`, or of more where all of those failed.

        `stats`: status and duration (s, infinite where it failed) of each start tried.
        """
        announce("exact", problem, self._seconds(problem))
        scaled = Scaled(problem)

        def solve_from(starts: Sequence[Start]) -> list[Optimum]:
            return _solve_from(scaled, starts)

        starts = starting_points(scaled, _PATIENCE * self.starts)
        local = optima_together(
            solve_from,
            starts,
            self.starts,
            self.agreeing,
        )
        solution = self.best(scaled, local)
        return replace(solution, stats=statistics(scaled, local))

    def _seconds(self, problem: Problem) -> float:
        """About how long it will take."""
        joints = int(problem.moving.sum())
        a_start = _SECONDS_PER_CELL + _SECONDS_PER_CELL_AND_PAIR * joints**2
        expected_starts = min(self.starts, self.agreeing)
        return a_start * expected_starts * cells(problem)


class Scaled:
    """The moving joints without units: time in mean stop times, tighter acceleration limit 1.

    Attributes:
        h: displacements, `(segments, joints)`.
        v: velocity limits, `(2, joints)`, low first.
        a: acceleration limits, `(2, joints)`, low first.
        rounding: of the waypoints, at the larger of a segment's two, likewise.
        stop: each segment's time if all joints stop at both its ends, `(segments,)`.
        shortest: each segment's time at the velocity limit, `(segments,)`.
        unit: the unit of time, s.
        units: the units of acceleration, velocity and position, rad/s^power, `(3, joints)`.
    """

    def __init__(self, problem: Problem) -> None:
        moving = problem.moving
        velocity = problem.limits.velocity[moving]
        acceleration = problem.limits.acceleration[moving]
        displacements = problem.displacements[:, moving]

        by_joint = trapezoidal(displacements, velocity, acceleration)
        stop = by_joint.max(axis=1)
        unit = float(stop.mean())
        tighter = np.abs(acceleration).min(axis=1)
        powers = np.arange(3)[:, None]
        units = tighter * unit**powers
        a_unit, v_unit, q_unit = units

        self.problem = problem
        self.moving = moving
        self.unit = unit
        self.units = units
        self.stop = stop / unit
        self.a = acceleration.T / a_unit
        self.v = velocity.T / v_unit
        self.h = displacements / q_unit
        positions = np.abs(problem.waypoints[:, moving])
        larger = np.maximum(positions[:-1], positions[1:])
        self.rounding = np.spacing(larger) / q_unit
        # T >= h / V2 forwards, T >= h / (-V1) backwards
        slowest, fastest = self.v
        forwards = self.h / fastest
        backwards = self.h / slowest
        by_joint = np.maximum(forwards, backwards)
        self.shortest = by_joint.max(axis=1)

    def trajectory(self, times: Array, velocities: Array) -> Trajectory:
        """The explicit answer: each joint's motion of least acceleration through each segment."""
        passages = np.r_[0.0, np.cumsum(times)] * self.unit
        rounded = np.diff(passages) / self.unit
        ends = _with_rest(self._in_rounded_times(times, rounded, velocities))
        waypoints = self.problem.waypoints
        task = Task(
            self.h,
            ends[:-1],
            ends[1:],
            self.v,
            self.a,
            self.unit,
            self.units,
            waypoints[:-1, self.moving],
            self.problem.limits.position[self.moving].T,
        )
        return Trajectory.of_moving(
            waypoints[0],
            self.moving,
            pieces(task, passages),
            passages,
        )

    def _in_rounded_times(
        self,
        times: Array,
        rounded: Array,
        velocities: Array,
    ) -> Array:
        """Waypoint velocities that brief segments are passed with in their rounded times.

        Of two segments the briefer one feels its rounding most. Its mean velocity becomes what its
        displacement asks for (where rounding of the waypoints does not hide the difference), the
        step over it what acceleration gains.
        """
        quicker = _ratio(times, rounded)[:, None]
        longer = _ratio(rounded, times)[:, None]
        missed = np.abs(quicker - 1) * np.abs(self.h)
        is_hidden = missed <= self.rounding
        ends = _with_rest(velocities)
        mean = (ends[:-1] + ends[1:]) / 2
        mean *= np.where(is_hidden, 1.0, quicker)
        step = ends[1:] - ends[:-1]
        step *= longer
        half = step / 2
        before = mean + half
        after = mean - half
        briefer = times[:-1] < times[1:]
        rounded_velocities = np.where(briefer[:, None], before[:-1], after[1:])
        return self.within(rounded_velocities)

    def within(self, velocities: Array) -> Array:
        """Velocities within their limits; one that hardly misses its limit is at it."""
        lowest, highest = self.v
        slowest, fastest = self.v * (1 - _LIMIT_RTOL)
        within = np.where(velocities > fastest, highest, velocities)
        return np.where(within < slowest, lowest, within)


def _ratio(times: Array, others: Array) -> Array:
    """Of two times of each segment; 1 where they differ by more than is worth following."""
    ratio = np.divide(
        times,
        others,
        out=np.ones_like(times),
        where=others > 0,
    )
    is_close = np.abs(ratio - 1) <= _ROUNDED_TIME_RTOL
    return np.where(is_close, ratio, 1.0)


def _with_rest(velocities: Array) -> Array:
    """Waypoint velocities with rest at both ends, `(segments + 1, joints)`."""
    inner, joints = velocities.shape
    ends = np.zeros((inner + 2, joints))  # in place of `np.pad`, 50 us slower
    ends[1:-1] = velocities
    return ends


def reachable(
    times: Array,
    velocities: Array,
    scaled: Scaled,
    k: float,
) -> bool:
    """Whether times and waypoint velocities are reachable where limits allow `k` times the speed.

    Velocity limits are `k` times as wide, acceleration limits `k²` times. In the briefest segments
    velocities differ by less than their rounding, which no dilation mends: let it be.
    """
    ends = _with_rest(velocities)
    u = ends[:-1]
    w = ends[1:]
    t = times[:, None]
    h = scaled.h
    v = scaled.v * k
    a = scaled.a * k**2
    slowest, fastest = v
    braking, speeding = a
    size = np.abs(u) + np.abs(w)
    rounding = _VELOCITY_RTOL * size
    step = w - u
    reach = extremes(u, w, t, v, a)
    conditions = [
        # −V1 ≤ v ≤ V2 at the waypoints
        slowest <= ends,
        ends <= fastest,
        # −A1 T ≤ w − u ≤ A2 T
        braking * t - rounding <= step,
        step <= speeding * t + rounding,
        # D_lo ≤ h ≤ D_up
        reach.d_lo - h <= rounding * t,
        h - reach.d_up <= rounding * t,
    ]
    return all(bool(condition.all()) for condition in conditions)


def repair(
    times: Array,
    velocities: Array,
    scaled: Scaled,
    largest: float = _LARGEST_DILATION,
) -> float:
    """The smallest dilation that makes times and waypoint velocities exactly reachable.

    Solvers meet constraints to a tolerance; dilating by `k` widens every reachable interval.
    Infinite where it were larger than the `largest`.
    """
    low = 1.0
    high = 1.0 + _DILATION_TOL
    while not reachable(times, velocities, scaled, high):
        low = high
        high = 1 + 4 * (high - 1)
        if high > largest:
            return np.inf
    while high - low > _DILATION_TOL:
        middle = 0.5 * (low + high)
        if reachable(times, velocities, scaled, middle):
            high = middle
        else:
            low = middle
    return high


@cache
def _solver(segments: int, joints: int) -> Program:
    """IPOPT for all problems of this size, built once; the numbers are parameters.

    Some segments are a billion times as long as others. So `u`, `w` and the peaks count from the
    segment's mean velocity `h/T`, in units of `T` (the acceleration limit is 1), and `T`
    logarithmically: then what they can reach is of order one, whatever its length.
    """
    ca = backend("casadi")

    def table(name: str) -> Any:
        return ca.MX.sym(name, segments, joints)

    # variables: segment times, waypoint velocities, end velocities and peaks of each segment
    log = ca.MX.sym("log", segments)
    v = ca.MX.sym("v", segments - 1, joints)
    u = table("u")
    w = table("w")
    p_up = table("up")
    p_lo = table("lo")
    # parameters: displacements, stop times, limits, the highest velocity in reach
    h = table("h")
    stop = ca.MX.sym("stop", segments)
    names = ("v1", "v2", "a1", "a2", "top")
    limits = [ca.MX.sym(name, 1, joints) for name in names]

    # every constraint is a table over segments and joints
    tables = [ca.repmat(limit, segments, 1) for limit in limits]
    v1, v2, a1, a2, top = tables
    times = stop * ca.exp(log)
    t = ca.repmat(times, 1, joints)
    mean = h / t
    rest = ca.MX.zeros(1, joints)
    after = ca.vertcat(rest, v)
    before = ca.vertcat(v, rest)
    velocity_rows = [
        # equal: a segment's end velocities are its waypoints', at rest at both ends
        mean + t * u - after,
        mean + t * w - before,
        # not negative: peaks within the velocity limits
        v2 - mean - t * p_up,
        mean + t * p_lo - v1,
    ]
    # D_up(p) ≥ h ≥ D_lo(p): from the mean velocity, over T², h becomes 0 and p T becomes p
    rise = (p_up - u) ** 2 / (2 * a2)
    fall = (p_up - w) ** 2 / (2 * a1)
    d_up = p_up - rise - fall
    fall = (p_lo - u) ** 2 / (2 * a1)
    rise = (p_lo - w) ** 2 / (2 * a2)
    minus_d_lo = -p_lo - fall - rise
    # −A1 T ≤ w − u ≤ A2 T: not negative, and at most A1 + A2
    step_row = w - u + a1
    reach_rows = [step_row, d_up, minus_d_lo]
    # all together no slower than stopping at every waypoint
    spare_time = ca.sum1(stop - times)
    scaled_rows = [row / top for row in velocity_rows]
    return program(
        "exact",
        variables=(log, v, u, w, p_up, p_lo),
        parameters=(h, stop, *limits),
        objective=ca.sum1(times),
        constraints=[*scaled_rows, *reach_rows, spare_time],
        options=IPOPT,
    )


class HasStopTimes(Protocol):
    """A problem without units, with or without jerk limits."""

    h: Array
    stop: Array


def starting_points(
    scaled: HasStopTimes,
    count: int,
    stopping: float = 1.0,
) -> Iterator[Start]:
    """Times and waypoint velocities to start from: stopping first, then random ones.

    Args:
        scaled: the problem.
        count: how many.
        stopping: times the stop times is what the first one takes.
    """
    segments, joints = scaled.h.shape
    rng = np.random.default_rng(0)
    inner = (segments - 1, joints)
    at_rest = np.zeros(inner)
    yield stopping * scaled.stop, at_rest
    for _ in range(count - 1):
        times = scaled.stop * rng.uniform(0.5, 1.5, segments)
        # between the mean velocities before and after the waypoint, times a random speed
        mean = scaled.h / times[:, None]
        before = mean[:-1]
        after = mean[1:]
        mix = rng.uniform(size=inner)
        between = mix * before + (1 - mix) * after
        speed = rng.uniform(0, 1.5, (segments - 1, 1))
        yield times, between * speed


def _solve_from(scaled: Scaled, starts: Sequence[Start]) -> list[Optimum]:
    """The local optimum near each start, dilated until it is exactly reachable."""

    def reached(passage: Passage, largest_dilation: float) -> Optimum | None:
        optimum = _reached(scaled, passage, "Converged", largest_dilation)
        return optimum if np.isfinite(optimum.duration) else None

    optima = []
    for start, optimum in zip(starts, minimised(scaled, starts, reached), strict=True):
        if optimum is None:
            optimum = _solve_by_ipopt(scaled, start)
        optima.append(optimum)
    return optima


def _solve_by_ipopt(scaled: Scaled, start: Start) -> Optimum:
    """One run of IPOPT, its answer dilated until it is exactly reachable."""
    low, high = _bounds(scaled)
    x0 = np.clip(_point(scaled, *start), low, high)
    # no velocity is above its limit, nor above accelerating at 1 all the time
    limit = np.abs(scaled.v).max(axis=0)
    top = np.minimum(limit, scaled.stop.sum())
    a1, a2 = np.abs(scaled.a)
    parameters = flat(
        scaled.h,
        scaled.stop,
        *scaled.v,
        a1,
        a2,
        top,
    )
    # as `_solver` has them: two tables that vanish, five and a number that are not negative
    table = np.ones(scaled.h.shape)
    vanishing = 0 * table
    unbounded = np.inf * table
    highest = flat(
        vanishing,
        vanishing,
        unbounded,
        unbounded,
        table * (a1 + a2),
        unbounded,
        unbounded,
        np.array([np.inf]),
    )
    solver = _solver(*scaled.h.shape)
    run = solver(
        start=x0,
        parameters=parameters,
        bounds=(low, high),
        constraint_bounds=(0.0, highest),
    )
    passage = _read(scaled, run.x)
    if not run.success:
        times, velocities = _passing(scaled, passage)
        return Optimum(np.inf, times, velocities, run.status)
    return _reached(scaled, passage, run.status)


def _reached(
    scaled: Scaled,
    passage: Passage,
    status: str,
    largest_dilation: float = _LARGEST_DILATION,
) -> Optimum:
    """A passage, dilated by no more until it is exactly reachable."""
    times, velocities = _passing(scaled, passage)
    k = repair(times, velocities, scaled, largest_dilation)
    duration = k * float(times.sum())
    return Optimum(
        duration,
        k * times,
        velocities / k,
        status,
    )


def _passing(scaled: Scaled, passage: Passage) -> tuple[Array, Array]:
    """Times and waypoint velocities; of two segments the briefer one knows better."""
    times = scaled.stop * np.exp(passage.log)
    t = times[:, None]
    mean = scaled.h / t
    after, before = mean + t * passage.ends
    briefer = times[:-1] < times[1:]
    velocities = np.where(briefer[:, None], before[:-1], after[1:])
    return times, scaled.within(velocities)


def _point(scaled: Scaled, times: Array, velocities: Array) -> Array:
    """IPOPT's variables for times and waypoint velocities, which need not be reachable."""
    ends = _with_rest(velocities)
    t = times[:, None]
    mean = scaled.h / t
    u = (ends[:-1] - mean) / t
    w = (ends[1:] - mean) / t
    larger = np.maximum(u, w)
    smaller = np.minimum(u, w)
    log = np.log(times / scaled.stop)
    return flat(
        log,
        velocities,
        u,
        w,
        np.maximum(larger, 0.0),
        np.minimum(smaller, 0.0),
    )


def _read(scaled: Scaled, x: Array) -> Passage:
    """What IPOPT's variables say of the passage."""
    every = scaled.h.shape
    segments, joints = every
    inner = (segments - 1, joints)
    shapes = [(segments,), inner, every, every]
    log, _, u, w = unflat(x, shapes)
    return Passage(log, np.stack([u, w]))


def _bounds(scaled: Scaled) -> tuple[Array, Array]:
    """Bounds of all variables; no segment takes longer than stopping everywhere does.

    From the mean velocity, none strays further than half a limit does in the segment's time.
    """
    stop = scaled.stop
    shortest = np.log(scaled.shortest / stop)
    longest = np.log(stop.sum() / stop)
    slowest, fastest = scaled.v
    a1, a2 = np.abs(scaled.a)
    half_a1 = a1 / 2
    half_a2 = a2 / 2
    wide = (a1 + a2) / 2
    zero = 0 * wide
    u = (-half_a2, half_a1)
    w = (-half_a1, half_a2)
    p_up = (zero, wide)
    p_lo = (-wide, zero)

    segments = np.ones((len(stop), 1))
    inner = segments[1:]
    low = [shortest, inner * slowest]
    high = [longest, inner * fastest]
    for lowest, highest in (u, w, p_up, p_lo):
        low.append(segments * lowest)
        high.append(segments * highest)
    return flat(*low), flat(*high)
