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
from typing import Any, Literal, get_args

import numpy as np
import scipy  # its parts are imported when they are used: listing needs none
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, backend, passing_once
from trajopt.problem import Limits, Problem
from trajopt.rest_to_rest import stop_times
from trajopt.solution import Solution, Status
from trajopt.trajectory import Trajectory
from trajopt.verification import verify

Array = NDArray[np.float64]
Knots = Literal["uniform", "chord", "centripetal", "limit"]
Ends = Literal["not-a-knot", "natural", "clamped"]

_NODES = (0.0, 0.5, 1.0)  # where in each grid interval the acceleration limits are imposed
_STILL = 1e-9  # of a velocity limit, at the path's cheapest duration: the path stands still
_SHORTEST = 0.25  # of the even share of gridpoints: what a short piece still gets
_INDIVISIBLE = 1e-6  # of the whole path: shorter pieces are one step, too short to lose time in
_SHORT = 1e-2  # of the even step: where the solver's rounding of speeds must be mended
_STRAIGHT = 1e-9  # of a piece's largest coefficient: what its others may be on a line
_SAME_BREAK = 1e-10  # of the whole path: a piece shorter than that is none
_ROUNDING = 1e-6  # by which a start speed may exceed the highest possible one
_WIDER = 1 + 1e-6  # times the limits: a path's only timing may lie on the edge, rounding beyond it
_FREE = 1e2  # more than any path speed, in units of the cheapest uniform one


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
        knots = get_args(Knots) if self.knots == "best" else (self.knots,)
        ends = get_args(Ends) if self.ends == "best" else (self.ends,)
        tried = {
            f"{k}/{e}": along(problem, spline(problem, k, e), gridpoints=self.gridpoints)
            for k, e in product(knots, ends)
        }
        return _best(problem, tried)


def spline(problem: Problem, knots: Knots, ends: Ends) -> Trajectory:
    """The cubic spline through the waypoints (no two consecutive ones alike), not timed yet.

    Its "time" is the path parameter. Not-a-knot is a parabola with three waypoints, a line
    with two.
    """
    chords = np.linalg.norm(problem.displacements, axis=1)
    steps = {
        "uniform": np.ones_like(chords),
        "chord": chords,
        "centripetal": np.sqrt(chords),
        "limit": stop_times(problem.without("jerk")),
    }
    at = np.r_[0.0, np.cumsum(steps[knots])]
    return Trajectory(at, scipy.interpolate.CubicSpline(at, problem.waypoints, bc_type=ends).c, at)


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
    scale = verify(problem, trajectory).dilation
    if start_speed is None:
        trajectory = _straightened(trajectory)
    if end_speed is None:
        trajectory = _reversed(_straightened(_reversed(trajectory)))
    attempts = (
        _along(problem.limits, trajectory, size, (start_speed, end_speed), scale, wider)
        for size, wider in ((gridpoints, 1.0), (gridpoints, _WIDER), (3 * gridpoints, _WIDER))
    )
    found = next(attempts)
    while found.trajectory is None and (another := next(attempts, None)):
        found = another
    return found


def _along(
    limits: Limits, trajectory: Trajectory, gridpoints: int, speeds: Any, scale: float, wider: float
) -> Solution:
    """The same on one grid; `scale` is the dilation that the path's own timing needs."""
    path = _unit(trajectory, gridpoints)
    grid, step, local = _cut(path)
    unit = scale * trajectory.duration / gridpoints  # of time, s
    limits = Limits(limits.velocity * unit * wider, limits.acceleration * unit**2 * wider)
    slopes = np.abs(path([0.0, path.duration], order=1))
    ends = [
        _speeds(speed, scale, bool((slope <= _STILL * limits.velocity[:, 1]).all()))
        for speed, slope in zip(speeds, slopes, strict=True)
    ]
    found, reason = _path_speeds(grid, step, local, limits, *ends)
    if found is None:
        return Solution(Status.FAILED, message=f"TOPP-RA: {reason}")
    retimed = _timed(grid, step, local, found / unit, path.waypoint_times)
    return Solution(Status.SOLVED, retimed, stats={"gridpoints": len(grid)})


def _best(problem: Problem, tried: dict[str, Solution]) -> Solution:
    """The solution of the shortest certified duration, with every candidate's result in `stats`."""
    results: dict[str, Any] = {}
    order = {}
    for rule, solution in tried.items():
        if solution.trajectory is None:
            results[rule], order[rule] = solution.message, (2, 0.0)
        else:
            certificate = verify(problem, solution.trajectory)
            results[rule] = certificate.certified_duration or "; ".join(certificate.flaws)
            order[rule] = (int(not certificate.valid), certificate.duration * certificate.dilation)
    winner = min(order, key=lambda rule: order[rule])
    stats = {"spline": winner, **tried[winner].stats, **results}
    return replace(tried[winner], stats=stats)


def _straightened(path: Trajectory) -> Trajectory:
    """The same path, its first piece `q0 + d s^m`, `m ≥ 3`, as a line; the slope after it stays."""
    length = path.breaks[1]
    size = np.abs(polynomials.stretched(path.coefficients[:, 0], length))[:-1].max(axis=1)
    powers = len(size) - np.flatnonzero(size > _STRAIGHT * size.max())
    if len(powers) != 1 or powers[0] < 3:
        return path
    m, coefficients = int(powers[0]), np.array(path.coefficients)
    coefficients[-2, 0] = coefficients[-1 - m, 0] * m * length ** (m - 1)
    coefficients[:-2, 0] = 0.0
    saved = length - length / m
    inside = length / m * (path.waypoint_times / length) ** m
    times = np.where(path.waypoint_times < length, inside, path.waypoint_times - saved)
    return Trajectory(np.r_[0.0, path.breaks[1:] - saved], coefficients, times)


def _reversed(path: Trajectory) -> Trajectory:
    """The same path from its end to its start."""
    ends = polynomials.shifted(path.coefficients, np.diff(path.breaks)[:, None])
    ends[-2::-2] *= -1
    breaks, times = (path.duration - t[::-1] for t in (path.breaks, path.waypoint_times))
    return Trajectory(breaks, ends[:, ::-1], times)


def _unit(trajectory: Trajectory, length: float) -> Trajectory:
    """The same path over [0, length], without its pieces too short for the solver."""
    scaled = trajectory.dilated(length / trajectory.duration)
    own = scaled.breaks
    breaks = own[np.r_[True, np.diff(own) > _SAME_BREAK * own[-1]]]
    breaks[-1] = own[-1]
    piece = np.searchsorted(own, 0.5 * (breaks[:-1] + breaks[1:]), side="right") - 1
    offset = (breaks[:-1] - own[piece])[:, None]
    coefficients = polynomials.shifted(scaled.coefficients[:, piece], offset)
    return Trajectory(breaks, coefficients, scaled.waypoint_times)


def _cut(path: Trajectory) -> tuple[Array, Array, Array]:
    """The grid, its steps, the path on each: polynomials on [0, 1], `(degree + 1, N, joints)`."""
    lengths = np.diff(path.breaks)
    least = path.duration * _SHORTEST / len(lengths)
    even = np.ceil(np.maximum(lengths, least)).astype(int)
    parts = np.where(lengths < _INDIVISIBLE * path.duration, 1, even)
    piece = np.repeat(np.arange(len(parts)), parts)
    number = np.arange(len(piece)) - np.repeat(np.cumsum(parts) - parts, parts)
    offset, step = number * (lengths / parts)[piece], (lengths / parts)[piece]
    moved = polynomials.shifted(path.coefficients[:, piece], offset[:, None])
    grid = np.r_[path.breaks[piece] + offset, path.breaks[-1]]
    return grid, step, polynomials.stretched(moved, step)


def _speeds(speed: float | None, scale: float, still: bool) -> tuple[float, float]:
    """The interval of path speeds allowed at an end."""
    if speed is None:
        return 0.0, _FREE if still else 0.0
    return speed * scale, speed * scale


def _path_speeds(
    grid: Array,
    step: Array,
    local: Array,
    limits: Limits,
    start: tuple[float, float],
    end: tuple[float, float],
) -> tuple[Array | None, str]:
    """The path speed at every gridpoint, or None and why not."""
    algorithm = backend("toppra").algorithm.TOPPRA(
        [_constraint(step, local, limits)],
        SimpleNamespace(path_interval=grid[[0, -1]]),
        gridpoints=grid,
        solver_wrapper="seidel",
    )
    controllable = algorithm.compute_controllable_sets(*end)
    if not np.isfinite(controllable).all():
        return None, "the path cannot be followed to its end"
    # The package takes one end speed; here the end's whole interval is allowed.
    algorithm.compute_controllable_sets = lambda *_: controllable
    fastest = float(np.sqrt(controllable[0, 1]))
    if start[0] > fastest * (1 + _ROUNDING):
        return None, f"the path cannot be started at {start[0] / fastest:.6g} times its top speed"
    algorithm.compute_parameterization(min(start[1], fastest), 0.0)
    data = algorithm.problem_data
    if data.sd_vec is None or not np.isfinite(data.sd_vec).all():
        return None, data.return_code.value
    speeds = _smoothed(data.sd_vec, data.sdd_vec, step)
    if (speeds[1:] + speeds[:-1] <= 0).any():
        return None, "the path comes to a standstill"
    return speeds, ""


def _smoothed(speeds: Array, accelerations: Array, step: Array) -> Array:
    """The speeds, with the solver's own path acceleration on very short steps.

    The solver lowers squared speeds by 1e-8 here and there, which is a large acceleration there.
    """
    squared = speeds**2
    for i in np.flatnonzero(step < _SHORT)[::-1]:
        if 0 < i < len(step) - 1:
            squared[i] = max(0.0, squared[i + 1] - 2 * step[i] * accelerations[i])
    return np.asarray(np.sqrt(squared))


def _constraint(step: Array, local: Array, limits: Limits) -> Any:
    """Both limits on every grid interval, as toppra's `a u + b x + c ≤ 0` and `x ≤ bound`.

    With path acceleration `u`, and path speed squared `x` where the interval starts, the joints'
    acceleration is `q'(s) u + q''(s) (x + 2 (s − s_i) u)`. Velocity is held to its limit at the
    gridpoints and between them: from rest a path may reach it within one interval.
    """
    step = step[:, None]
    first, second = (polynomials.derivative(local, k) / step**k for k in (1, 2))
    low, high = limits.acceleration.T
    rows = []
    for node in _NODES:
        slope, bend = (polynomials.evaluate(d, np.array(node)) for d in (first, second))
        u = slope + 2 * node * step * bend
        rows += [_normalised(u, bend, -high), _normalised(-u, -bend, low)]
    slope = polynomials.evaluate(first, np.array(0.5))
    bound = np.where(slope > 0, limits.velocity[:, 1], limits.velocity[:, 0]) ** 2
    rows.append(_normalised(step * slope**2, slope**2, -bound))
    a, b, c = (np.concatenate(parts, axis=1) for parts in zip(*rows, strict=True))
    a, b, c = (np.concatenate([part, part[-1:]]) for part in (a, b, c))  # toppra asks for one more
    constraint = backend("toppra").constraint.LinearConstraint()
    constraint.identical = True
    bounds = _speed_bounds(first, limits.velocity)
    f, g = np.eye(a.shape[1]), np.zeros(a.shape[1])
    constraint.compute_constraint_params = lambda *_: (a, b, c, f, g, None, bounds)
    return constraint


def _normalised(a: Array, b: Array, c: Array) -> tuple[Array, Array, Array]:
    """Each row over its largest coefficient: the solver's tolerances are absolute."""
    size = np.maximum(np.maximum(np.abs(a), np.abs(b)), np.abs(c) / _FREE**2)
    return a / size, b / size, c / size


def _speed_bounds(first: Array, velocity: Array) -> Array:
    """`0 ≤ x ≤ (V / q')²` at the gridpoints, `(N + 1, 2)`."""
    slope = np.concatenate([first[-1], first[:, -1:].sum(axis=0)])
    use = np.maximum(slope / velocity[:, 1], slope / velocity[:, 0]).max(axis=1)
    top = 1 / np.maximum(use, 1 / _FREE) ** 2
    return np.stack([np.zeros_like(top), top], axis=1)


def _timed(grid: Array, step: Array, local: Array, speeds: Array, waypoints: Array) -> Trajectory:
    """The path at `s(t)`, quadratic on each interval; `waypoints` are parameters."""
    durations = 2 * step / (speeds[1:] + speeds[:-1])
    breaks = np.r_[0.0, np.cumsum(durations)]
    linear = 2 * speeds[:-1] / (speeds[1:] + speeds[:-1])
    composed = _composed(local, linear[:, None])
    i = np.searchsorted(grid[1:-1], waypoints, side="right")
    squared = np.interp(waypoints, grid, speeds**2)
    times = breaks[i] + 2 * (waypoints - grid[i]) / np.maximum(speeds[i] + np.sqrt(squared), 1e-300)
    coefficients = polynomials.stretched(composed, 1 / durations)
    return Trajectory(breaks, coefficients, times)


def _composed(local: Array, linear: Array) -> Array:
    """`p(c w + (1 − c) w²)` by Horner's rule, all on [0, 1]: twice the degree."""
    result = local[:1]
    for row in local[1:]:
        zero = np.zeros_like(result[:1])
        result = np.concatenate([(1 - linear) * result, zero, zero]) + np.concatenate(
            [zero, linear * result, zero]
        )
        result[-1] += row
    return result
