"""TOPP-RA: the fastest timing of a given path (Pham & Pham 2018), from the package `toppra`.

The path's parameter counts gridpoints, and time is scaled to make the cheapest uniform path speed
1, so that the solver, whose tolerances are absolute, sees numbers near 1 whatever the units and the
size of the problem. The path's second derivative may jump at the path's breaks: each grid interval
is held to the limits with its own piece's derivatives, at `_NODES` (toppra's own interpolation
scheme takes the next piece's at the far end).

Between gridpoints the path acceleration is constant, so `s(t)` is quadratic and the answer is a
piecewise polynomial of twice the path's degree, composed exactly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Limits, Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners.planner import Planner, backend, passing_once
from trajopt.planners.rest_to_rest import stop_times

Array = NDArray[np.float64]
Knots = Literal["uniform", "chord", "centripetal", "limit"]
Ends = Literal["not-a-knot", "natural", "clamped"]

# Where in each grid interval the acceleration limits are imposed.
_NODES = (0.0, 0.5, 1.0)
# Of a velocity limit, at the path's cheapest duration: the path stands still.
_STILL_SHARE = 1e-9
# Of the even share of gridpoints: what a short piece still gets.
_SHORT_PIECE_SHARE = 0.25
# Of the whole path: shorter pieces are one step, too short to lose time in.
_INDIVISIBLE_SHARE = 1e-6
# Of the even step: where the solver's rounding of speeds must be mended.
_SHORT_STEP = 1e-2
# Of a piece's largest coefficient: what its others may be on a line.
_STRAIGHT_RTOL = 1e-9
# Where in each piece its own timing's use of the limits is sampled.
_SAMPLES = np.linspace(0.0, 1.0, 9)[:, None, None]
# Of the whole path: a piece shorter than that is none.
_BREAK_RTOL = 1e-8
# By which a start speed may exceed the highest possible one.
_SPEED_RTOL = 1e-6
# Times the limits: a path's only timing may lie on the edge, rounding beyond it.
_WIDER = 1 + 1e-6
# More than any path speed, in units of the cheapest uniform one.
_FREE_SPEED = 1e2


@dataclass(frozen=True)
class ToppRa(Planner):
    """TOPP-RA along a cubic spline through the waypoints; by default the best of twelve splines.

    - `knots`: the spline's parameter from waypoint to waypoint grows by 1, by the chord's length,
      by its square root, or by the time from stop to stop;
    - `ends`: the spline's end rule;
    - `gridpoints`: about how many intervals the path is cut into.

    `"best"` tries all rules and keeps the shortest certified duration.
    """

    knots: Literal["uniform", "chord", "centripetal", "limit", "best"] = "best"
    ends: Literal["not-a-knot", "natural", "clamped", "best"] = "best"
    gridpoints: int = 1000

    requires = ("toppra",)

    def __post_init__(self) -> None:
        if self.gridpoints < 10:
            raise InvalidInput("gridpoints", "at least 10", value=self.gridpoints)

    def unsupported(self, problem: Problem) -> str | None:
        if problem.has("jerk"):
            return "TOPP-RA does not limit jerk: its accelerations jump"
        return None

    def along(self, problem: Problem, trajectory: Trajectory) -> Solution:
        """The fastest timing of a given trajectory's path."""
        return along(problem, trajectory, gridpoints=self.gridpoints)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        solutions = {}
        for knot_rule, end_rule in rules(self.knots, self.ends):
            path = spline(problem, knot_rule, end_rule)
            solution = along(problem, path, gridpoints=self.gridpoints)
            solutions[f"{knot_rule}/{end_rule}"] = solution
        return best_of(problem, solutions)


def rules(knots: Knots | Literal["best"], ends: Ends | Literal["best"]) -> list[tuple[Knots, Ends]]:
    """The knot and end rules that are meant, `best` being all."""
    all_knots: tuple[Knots, ...] = get_args(Knots)
    if knots != "best":
        all_knots = (knots,)
    all_ends: tuple[Ends, ...] = get_args(Ends)
    if ends != "best":
        all_ends = (ends,)
    return list(product(all_knots, all_ends))


def steps_by_rule(problem: Problem) -> dict[Knots, Array]:
    """By how much the parameter grows in each segment, `(segments,)`, by knot rule."""
    every: tuple[Knots, ...] = get_args(Knots)
    return {rule: steps(problem, rule) for rule in every}


def steps(problem: Problem, knots: Knots) -> Array:
    """By how much the parameter grows in each segment, `(segments,)`."""
    if knots == "limit":
        return stop_times(problem.without("jerk"))
    if knots == "uniform":
        return np.ones(problem.segments)
    chords = np.linalg.norm(problem.displacements, axis=1)
    if knots == "chord":
        return np.asarray(chords)
    return np.asarray(np.sqrt(chords))


def spline(problem: Problem, knots: Knots, ends: Ends) -> Trajectory:
    """The cubic spline through the waypoints (no two consecutive ones alike), not timed yet.

    Its "time" is the path parameter. Not-a-knot is a parabola with three waypoints, a line
    with two.
    """
    import scipy  # late: planners that are only listed need none of it

    at = np.r_[0.0, np.cumsum(steps(problem, knots))]
    cubics = scipy.interpolate.CubicSpline(at, problem.waypoints, bc_type=ends)
    return Trajectory(at, cubics.c, at)


def along(
    problem: Problem,
    trajectory: Trajectory,
    *,
    gridpoints: int = 1000,
    start_speed: float | None = None,
    end_speed: float | None = None,
) -> Solution:
    """The fastest timing of any trajectory's path under the velocity and acceleration limits.

    `start_speed` and `end_speed` are path speeds `ds/dt` with the trajectory's own time as `s`: 1
    is as timed. `None` means 0, or any where the path stands still (`q'(s) = 0`): the robot rests
    there at whatever path speed. A trajectory from rest to rest is such a path. Held to path speed
    0, it loses time at first order in the grid; left free, it can keep its own timing. Where it
    leaves or reaches rest along a line `q0 + d s^m`, `m ≥ 3`, as a 3-5-3 spline does, the fastest
    path speed there is infinite: the line itself is then the path, from path speed 0.

    Every break is a gridpoint, and each piece is cut evenly into steps of about `1/gridpoints` of
    the whole. The claim holds at the gridpoints; certify it.
    """
    scale = sampled_dilation(problem.without("jerk").limits, trajectory)
    if start_speed is None:
        trajectory = _straightened(trajectory)
    if end_speed is None:
        trajectory = _reversed(_straightened(_reversed(trajectory)))
    speeds = (start_speed, end_speed)
    attempts = [
        (gridpoints, 1.0),
        (gridpoints, _WIDER),
        (3 * gridpoints, _WIDER),
    ]
    for size, wider in attempts:
        solution = _along(
            problem.limits,
            trajectory,
            size,
            speeds,
            scale,
            wider,
        )
        if solution.trajectory is not None:
            break
    return solution


def sampled_dilation(limits: Limits, path: Trajectory) -> float:
    """The cheapest uniform dilation of a path's own timing, as `_SAMPLES` of each piece show it.

    It is a unit, not a verdict: a peak that the samples miss makes the numbers a little larger.
    """
    lengths = np.diff(path.breaks)
    unit = polynomials.stretched(path.coefficients, lengths)
    slowness = 1 / lengths[:, None]
    highest = 0.0
    bounds = (limits.velocity, limits.acceleration, limits.jerk)
    for order, pairs in enumerate(bounds, start=1):
        rates = polynomials.derivative(unit, order)
        values = polynomials.evaluate(rates[:, None], _SAMPLES) * slowness**order
        low, high = pairs.T
        use = np.maximum(values / high, values / low).max()
        highest = max(highest, float(use) ** (1 / order))
    return highest


def _along(
    limits: Limits,
    trajectory: Trajectory,
    gridpoints: int,
    speeds: tuple[float | None, float | None],
    scale: float,
    wider: float,
) -> Solution:
    """The same on one grid; `scale` is about the dilation that the path's own timing needs."""
    path = unit_path(trajectory, gridpoints)
    grid = cut(path)
    unit = scale * trajectory.duration / gridpoints  # of time, s
    velocity = limits.velocity * unit * wider
    acceleration = limits.acceleration * unit**2 * wider
    own_limits = Limits(velocity, acceleration)

    both_ends = [0.0, path.duration]
    slopes = np.abs(path(both_ends, order=1))
    still = slopes <= _STILL_SHARE * velocity[:, 1]
    start_speed, end_speed = speeds
    start = _speeds(start_speed, scale, bool(still[0].all()))
    end = _speeds(end_speed, scale, bool(still[1].all()))

    path_speeds, reason = _path_speeds(
        grid,
        own_limits,
        start,
        end,
    )
    if path_speeds is None:
        return Solution(Status.FAILED, message=f"TOPP-RA: {reason}")
    retimed = timed(grid, path_speeds / unit, path.waypoint_times)
    stats = {"gridpoints": len(grid.at)}
    return Solution(Status.SOLVED, retimed, stats=stats)


def best_of(problem: Problem, solutions: dict[str, Solution]) -> Solution:
    """The solution of the shortest certified duration, with every candidate's result in `stats`.

    A single one is left to the verifier of its trial.
    """
    if len(solutions) == 1:
        ((rule, only),) = solutions.items()
        return replace(only, stats={"spline": rule, **only.stats})
    results: dict[str, Any] = {}
    # valid ones first, then invalid ones, then failures
    ranks: dict[str, tuple[int, float]] = {}
    for rule, solution in solutions.items():
        if solution.trajectory is None:
            results[rule] = solution.message
            ranks[rule] = (2, 0.0)
            continue
        certificate = verify(problem, solution.trajectory)
        flaws = "; ".join(certificate.flaws)
        results[rule] = certificate.certified_duration or flaws
        dilated = certificate.duration * certificate.dilation
        ranks[rule] = (int(not certificate.valid), dilated)
    winner = min(ranks, key=lambda rule: ranks[rule])
    best = solutions[winner]
    stats = {"spline": winner, **best.stats, **results}
    return replace(best, stats=stats)


def _straightened(path: Trajectory) -> Trajectory:
    """The same path, its first piece `q0 + d s^m`, `m ≥ 3`, as a line; the slope after it stays."""
    length = path.breaks[1]
    first = path.coefficients[:, 0]
    piece = polynomials.stretched(first, length)
    curved = np.abs(piece)[:-1]
    sizes = curved.max(axis=1)
    present = sizes > _STRAIGHT_RTOL * sizes.max()
    powers = len(sizes) - np.flatnonzero(present)
    if len(powers) != 1 or powers[0] < 3:
        return path

    # the line's slope is the curve's where it ends, m d s^(m−1), so it is m times as short
    m = int(powers[0])
    coefficients = np.array(path.coefficients)
    d = coefficients[-1 - m, 0]
    slope = d * m * length ** (m - 1)
    coefficients[-2, 0] = slope
    coefficients[:-2, 0] = 0.0
    saved = length - length / m
    later = path.breaks[1:] - saved
    breaks = np.r_[0.0, later]

    # waypoints on the line where the curve reaches them, those after it as much earlier
    waypoints = path.waypoint_times
    on_curve = (waypoints / length) ** m
    inside = length / m * on_curve
    beyond = waypoints - saved
    times = np.where(waypoints < length, inside, beyond)
    return Trajectory(breaks, coefficients, times)


def _reversed(path: Trajectory) -> Trajectory:
    """The same path from its end to its start."""
    lengths = np.diff(path.breaks)
    ends = polynomials.shifted(path.coefficients, lengths[:, None])
    ends[-2::-2] *= -1
    breaks = path.duration - path.breaks[::-1]
    times = path.duration - path.waypoint_times[::-1]
    return Trajectory(breaks, ends[:, ::-1], times)


def unit_path(trajectory: Trajectory, length: float) -> Trajectory:
    """The same path over [0, length], without its pieces too short for the solver."""
    scaled = trajectory.dilated(length / trajectory.duration)
    own = scaled.breaks
    apart = np.diff(own) > _BREAK_RTOL * own[-1]
    breaks = own[np.r_[True, apart]]
    breaks[-1] = own[-1]
    begins = breaks[:-1]
    middles = 0.5 * (begins + breaks[1:])
    piece = np.searchsorted(own, middles, side="right") - 1
    offset = begins - own[piece]
    pieces = scaled.coefficients[:, piece]
    coefficients = polynomials.shifted(pieces, offset[:, None])
    return Trajectory(breaks, coefficients, scaled.waypoint_times)


class Grid(NamedTuple):
    """A path cut into steps.

    Attributes:
        at: The path parameter at the gridpoints, `(N + 1,)`.
        step: Lengths of the steps, `(N,)`.
        local: The path over each, polynomials on [0, 1], `(degree + 1, N, joints)`.
    """

    at: Array
    step: Array
    local: Array


def cut(path: Trajectory) -> Grid:
    lengths = np.diff(path.breaks)
    shortest = path.duration * _SHORT_PIECE_SHARE / len(lengths)
    even = np.ceil(np.maximum(lengths, shortest)).astype(int)
    indivisible = lengths < _INDIVISIBLE_SHARE * path.duration
    parts = np.where(indivisible, 1, even)

    # of every step: its piece, and its number in it
    piece = np.repeat(np.arange(len(parts)), parts)
    before = np.cumsum(parts) - parts
    steps_before = np.repeat(before, parts)
    number = np.arange(len(piece)) - steps_before

    even_steps = lengths / parts
    step = even_steps[piece]
    offset = number * step
    pieces = path.coefficients[:, piece]
    moved = polynomials.shifted(pieces, offset[:, None])
    starts = path.breaks[piece] + offset
    at = np.r_[starts, path.breaks[-1]]
    local = polynomials.stretched(moved, step)
    return Grid(at, step, local)


def _speeds(
    speed: float | None,
    scale: float,
    still: bool,
) -> tuple[float, float]:
    """The interval of path speeds allowed at an end."""
    if speed is not None:
        scaled = speed * scale
        return scaled, scaled
    if still:
        return 0.0, _FREE_SPEED
    return 0.0, 0.0


def _path_speeds(
    grid: Grid,
    limits: Limits,
    start: tuple[float, float],
    end: tuple[float, float],
) -> tuple[Array | None, str]:
    """The path speed at every gridpoint, or None and why not."""
    interval = grid.at[[0, -1]]
    algorithm = backend("toppra").algorithm.TOPPRA(
        [_constraint(grid, limits)],
        SimpleNamespace(path_interval=interval),
        gridpoints=grid.at,
        solver_wrapper="seidel",
    )
    controllable = algorithm.compute_controllable_sets(*end)
    if not np.isfinite(controllable).all():
        return None, "the path cannot be followed to its end"
    # The package takes one end speed; here the end's whole interval is allowed.
    algorithm.compute_controllable_sets = lambda *_: controllable
    fastest = float(np.sqrt(controllable[0, 1]))
    slowest_start, fastest_start = start
    if slowest_start > fastest * (1 + _SPEED_RTOL):
        times = slowest_start / fastest
        return None, f"the path cannot be started at {times:.6g} times its top speed"
    start_speed = min(fastest_start, fastest)
    algorithm.compute_parameterization(start_speed, 0.0)
    data = algorithm.problem_data
    if data.sd_vec is None or not np.isfinite(data.sd_vec).all():
        return None, data.return_code.value
    speeds = _smoothed(data.sd_vec, data.sdd_vec, grid.step)
    sums = speeds[1:] + speeds[:-1]
    if (sums <= 0).any():
        return None, "the path comes to a standstill"
    return speeds, ""


def _smoothed(
    speeds: Array,
    accelerations: Array,
    step: Array,
) -> Array:
    """The speeds, with the solver's own path acceleration on very short steps.

    The solver lowers squared speeds by 1e-8 here and there, which is a large acceleration there.
    """
    squared = speeds**2
    short = np.flatnonzero(step < _SHORT_STEP)
    for i in short[::-1]:
        if 0 < i < len(step) - 1:
            # x_i = x_(i+1) − 2 Δ u
            gain = 2 * step[i] * accelerations[i]
            before = squared[i + 1] - gain
            squared[i] = max(0.0, before)
    return np.asarray(np.sqrt(squared))


def _constraint(grid: Grid, limits: Limits) -> Any:
    """Both limits on every grid interval, as toppra's `a u + b x + c ≤ 0` and `x ≤ bound`.

    With path acceleration `u`, and path speed squared `x` where the interval starts, the joints'
    acceleration is `q'(s) u + q''(s) (x + 2 (s − s_i) u)`. Velocity is held to its limit at the
    gridpoints and between them: from rest a path may reach it within one interval. Beside a point
    where the path stands still the fastest speed falls from `_FREE_SPEED` like `1/s`, so that over
    the first steps velocity exceeds its limit elsewhere, the more the larger the unit makes that
    speed (`edges-slow` along the clamped spline over chords: 2 %).
    """
    step = grid.step[:, None]
    # a joint at rest keeps its limits: its rows would only cost the solver time
    moves = grid.local[:-1].any(axis=(0, 1))
    local = grid.local[:, :, moves]
    limits = limits.only(moves)
    first = polynomials.derivative(local, 1) / step
    second = polynomials.derivative(local, 2) / step**2
    low, high = limits.acceleration.T
    rows = []
    for node in _NODES:
        # q' u + q'' (x + 2 (s − s_i) u) between both limits
        slope = polynomials.evaluate(first, np.array(node))
        bend = polynomials.evaluate(second, np.array(node))
        u = slope + 2 * node * step * bend
        upper = _normalised(u, bend, -high)
        lower = _normalised(-u, -bend, low)
        rows += [upper, lower]

    # q'² (x + Δ u) ≤ V² in the middle of the step
    slope = polynomials.evaluate(first, np.array(0.5))
    backward_limit, forward_limit = limits.velocity.T
    top = np.where(slope > 0, forward_limit, backward_limit)
    square = slope**2
    middle = _normalised(step * square, square, -(top**2))
    rows.append(middle)

    # beside each other, for every step; toppra asks for one more at the end
    a, b, c = np.concatenate(rows, axis=2)[:, [*range(len(step)), -1]]
    bounds = _speed_bounds(first, limits.velocity)
    # toppra's F (a u + b x + c) ≤ g, and no limit on u alone
    count = a.shape[1]
    f = np.eye(count)
    g = np.zeros(count)
    parameters = (a, b, c, f, g, None, bounds)
    constraint = backend("toppra").constraint.LinearConstraint()
    constraint.identical = True
    constraint.compute_constraint_params = lambda *_: parameters
    return constraint


def _normalised(
    a: Array,
    b: Array,
    c: Array,
) -> Array:
    """Each row over its largest coefficient, `(3, …)`: the solver's tolerances are absolute."""
    largest = np.maximum(np.abs(a), np.abs(b))
    constant = np.abs(c) / _FREE_SPEED**2
    rows = np.empty((3, *a.shape))
    rows[0] = a
    rows[1] = b
    rows[2] = c
    rows /= np.maximum(largest, constant)
    return rows


def _speed_bounds(first: Array, velocity: Array) -> Array:
    """`0 ≤ x ≤ (V / q')²` at the gridpoints, `(N + 1, 2)`."""
    last = first[:, -1:].sum(axis=0)
    slope = np.concatenate([first[-1], last])
    slowest, fastest = velocity.T
    forwards = slope / fastest
    backwards = slope / slowest
    by_joint = np.maximum(forwards, backwards)
    use = by_joint.max(axis=1)
    use = np.maximum(use, 1 / _FREE_SPEED)
    top = 1 / use**2
    return np.stack([np.zeros_like(top), top], axis=1)


def timed(
    grid: Grid,
    speeds: Array,
    waypoints: Array,
) -> Trajectory:
    """The path at `s(t)`, quadratic on each interval; `waypoints` are parameters."""
    # a step takes 2 Δ/(v_i + v_(i+1)); over it, s = c w + (1 − c) w² with w = time/step's time
    before = speeds[:-1]
    sums = speeds[1:] + before
    durations = 2 * grid.step / sums
    breaks = np.r_[0.0, np.cumsum(durations)]
    linear = 2 * before / sums
    composed = _composed(grid.local, linear[:, None])

    # to a waypoint inside a step: 2 (s − s_i)/(v_i + v(s)), v² being linear in s
    inner = grid.at[1:-1]
    i = np.searchsorted(inner, waypoints, side="right")
    squared = np.interp(waypoints, grid.at, speeds**2)
    speed_sums = speeds[i] + np.sqrt(squared)
    speed_sums = np.maximum(speed_sums, 1e-300)
    inside = waypoints - grid.at[i]
    times = breaks[i] + 2 * inside / speed_sums
    coefficients = polynomials.stretched(composed, 1 / durations)
    return Trajectory(breaks, coefficients, times)


def _composed(local: Array, linear: Array) -> Array:
    """`p(c w + (1 − c) w²)` by Horner's rule, all on [0, 1]: twice the degree."""
    result = local[:1]
    for row in local[1:]:
        zero = np.zeros_like(result[:1])
        square = (1 - linear) * result
        times_square = np.concatenate([square, zero, zero])
        times_linear = np.concatenate([zero, linear * result, zero])
        result = times_square + times_linear
        result[-1] += row
    return result
