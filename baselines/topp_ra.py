"""TOPP-RA: the fastest timing of a given path (Pham & Pham 2018), from the package `toppra`.

The solver's tolerances are absolute. So the path's parameter counts gridpoints, and time is scaled
to make the cheapest uniform path speed 1: the numbers are near 1 for any problem. The path's second
derivative may jump at the path's breaks. So each grid interval keeps the limits with its own
piece's derivatives, at `_NODES` (toppra's own interpolation scheme takes the next piece's at the
far end).

Between gridpoints the path acceleration is constant. So `s(t)` is quadratic, and the answer is a
piecewise polynomial of twice the path's degree, composed exactly.

Where the motion begins or ends with a velocity, the path begins or ends in its direction.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from types import SimpleNamespace
from typing import Any, Literal, NamedTuple, get_args

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.demand import END_VELOCITIES
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import Planner, backend
from trajopt.planners.reductions import EQUAL_WAYPOINTS, reduced
from trajopt.planners.rest_to_rest import stop_times

Knots = Literal["uniform", "chord", "centripetal", "limit"]
Ends = Literal["not-a-knot", "natural", "clamped"]

# Points of each grid interval, as shares, at which the acceleration limits are imposed.
_NODES = (0.0, 0.5, 1.0)
# A path stands still where `q'(s)` is smaller, relative to the limit at the shortest duration.
_STILL_RTOL = 1e-9
# Least number of gridpoints of a short piece, relative to an even share of all gridpoints.
_SHORT_PIECE_SHARE = 0.25
# Pieces shorter than this, relative to the whole path, are a single step.
_INDIVISIBLE_RTOL = 1e-6
# Coefficients of a piece smaller than this, relative to the largest one, count as 0.
_STRAIGHT_RTOL = 1e-9
# Number of samples of each piece in its own timing.
_SAMPLES = np.linspace(0.0, 1.0, 9)[:, None, None]
# Pieces shorter than this, relative to the whole path, are left out.
_BREAK_RTOL = 1e-8
# Factor on the limits if rounding makes a path infeasible whose only timing is exactly at them.
_WIDER = 1 + 1e-6
# Factor on the limits where the motion begins or ends with a velocity: it cannot be dilated by the
# excess between gridpoints.
_TIGHTER = 1 - 1e-5
# First step of the search for knots, of the logarithm of a segment's share.
_KNOT_STEP = 0.3
# More than any path speed, in units of the cheapest uniform one.
_FREE_SPEED = 1e2
# Rounding of a path speed at the start, relative.
_SPEED_RTOL = 1e-7
# A path's direction at an end is that of the velocity if they differ by less, relative.
_PARALLEL_RTOL = 1e-6
# Where the motion begins or ends with a velocity: lengths of the path's tangent that are tried in
# turn, relative to the segment's mean, until this many of the paths can be followed.
_TANGENTS = tuple(2.0 ** np.arange(-1, 7))
_FOLLOWED = 2


@dataclass(frozen=True)
class ToppRa(Planner):
    """TOPP-RA along a cubic spline through the waypoints; by default the best of twelve splines.

    - `knots`: the spline's parameter from waypoint to waypoint grows by 1, by the chord's length,
      by its square root, or by the time from stop to stop;
    - `ends`: the spline's end rule;
    - `gridpoints`: approximate number of intervals into which the path is cut;
    - `search`: number of further splines, for which Nelder and Mead's simplex method moves the
      knots of the best one.

    `"best"` tries all rules and keeps the shortest certified duration. With a velocity at an end
    the spline's tangent there has its direction, and several lengths are tried, instead of that
    end's rule.
    """

    knots: Literal["uniform", "chord", "centripetal", "limit", "best"] = "best"
    ends: Literal["not-a-knot", "natural", "clamped", "best"] = "best"
    gridpoints: int = 1000
    search: int = 0

    requires = ("toppra",)
    knows = ("velocity", "acceleration", "segment", *END_VELOCITIES)

    def __post_init__(self) -> None:
        if self.gridpoints < 10:
            raise InvalidInput("gridpoints", "at least 10", value=self.gridpoints)
        if self.search < 0:
            raise InvalidInput("search", "0 or more", value=self.search)

    def unsupported(self, problem: Problem) -> str | None:
        if problem.has("jerk"):
            return "TOPP-RA does not limit jerk: its accelerations jump"
        return None

    def along(self, problem: Problem, trajectory: Trajectory) -> Solution:
        """Return the fastest timing of a given trajectory's path."""
        return along(problem, trajectory, gridpoints=self.gridpoints)

    @reduced(EQUAL_WAYPOINTS)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        solutions: dict[str, Solution] = {}
        tried = rules(self.knots, self.ends)
        if all(key in problem.demands for key in END_VELOCITIES):
            # no end is left to which the end rule applies
            tried = [*{rule[0]: rule for rule in tried}.values()]
        shortest: dict[str, float] = {}
        for rule in tried:
            solutions |= self._timed(problem, *rule, shortest)
        best = replace(best_of(problem, solutions), evaluations=len(solutions))
        if self.search and best.trajectory is not None and problem.segments > 1:
            return self._searched(problem, best)
        return best

    def _timed(
        self, problem: Problem, knot_rule: Knots, end_rule: Ends, shortest: dict[str, float]
    ) -> dict[str, Solution]:
        """Return the timing of a rule's spline; with velocities at the ends, for several tangents.

        Longer and longer tangents are tried until two of the paths can be followed: along a longer
        one the path bends less. The first one that can be followed is kept in `shortest`, by knot
        rule: with the next end rule shorter ones are not tried again.
        """
        name = f"{knot_rule}/{end_rule}"
        if problem.route.at_rest:
            path = spline(problem, knot_rule, end_rule)
            return {name: along(problem, path, gridpoints=self.gridpoints)}
        solutions = {}
        followed = 0
        for tangent in _TANGENTS:
            if tangent < shortest.get(knot_rule, 0.0):
                continue
            path = spline(problem, knot_rule, end_rule, tangent)
            solution = along(problem, path, gridpoints=self.gridpoints, again=False)
            solutions[f"{name}/{tangent:g}"] = solution
            if solution.trajectory is not None:
                shortest.setdefault(knot_rule, tangent)
                followed += 1
            if followed == _FOLLOWED:
                break
        return solutions

    def _searched(self, problem: Problem, best: Solution) -> Solution:
        """Return the best of the splines whose knots a simplex search places."""
        from scipy.optimize import minimize

        knot_rule, end_rule, *length = best.stats["spline"].split("/")
        tangent = float(*length) if length else 1.0
        found = [(_cost(problem, best), best)]

        def cost(logs: Array) -> float:
            at = np.exp(np.r_[0.0, logs]) * steps(problem, knot_rule)
            path = spline(problem, at, end_rule, tangent)
            solution = along(problem, path, gridpoints=self.gridpoints)
            found.append((_cost(problem, solution), solution))
            return found[-1][0]

        start = np.zeros(problem.segments - 1)
        options = {"maxfev": self.search, "initial_simplex": _simplex(start)}
        minimize(cost, start, method="Nelder-Mead", options=options)
        shortest = min(found, key=lambda own: own[0])[1]
        evaluations = (best.evaluations or 0) + len(found) - 1
        stats = {**best.stats, **shortest.stats}
        return replace(shortest, evaluations=evaluations, stats=stats)


def _simplex(start: Array) -> Array:
    """Return corners around a start: each coordinate larger by `_KNOT_STEP`."""
    return np.vstack([start, start + _KNOT_STEP * np.eye(len(start))])


def _cost(problem: Problem, solution: Solution) -> float:
    """Return the certified duration, s; infinite without one."""
    if solution.trajectory is None:
        return np.inf
    certified = verify(problem, solution.trajectory).certified_duration
    return np.inf if certified is None else certified


def rules(knots: str = "best", ends: str = "best") -> list[tuple[Any, Any]]:
    """Return the pairs of knot and end rules; `best` stands for all rules."""
    return [
        pair
        for pair in product(get_args(Knots), get_args(Ends))
        if knots in (pair[0], "best") and ends in (pair[1], "best")
    ]


def steps(problem: Problem, knots: Knots) -> Array:
    """Return the growth of the parameter in each segment, `(segments,)`."""
    if knots == "limit":
        return stop_times(problem.without("jerk"))
    if knots == "uniform":
        return np.ones(problem.segments)
    chords = np.linalg.norm(problem.displacements, axis=1)
    if knots == "chord":
        return chords
    return np.sqrt(chords)


def spline(problem: Problem, knots: Knots | Array, ends: Ends, tangent: float = 1.0) -> Trajectory:
    """Return the cubic spline through the waypoints, before it is timed.

    `knots` is a rule, or the growth of the parameter in each segment, `(segments,)`. No two
    consecutive waypoints may be identical. The spline's "time" is the path parameter. Not-a-knot
    is a parabola with three waypoints, a line with two. Where the motion begins or ends with a
    velocity, the path's derivative has its direction, and is `tangent` times the segment's mean.
    """
    import scipy  # late: planners that are only listed need none of it

    growth = steps(problem, knots) if isinstance(knots, str) else knots
    at = np.r_[0.0, np.cumsum(growth)]
    conditions: list[Any] = [ends, ends]
    means = np.linalg.norm(problem.displacements, axis=1) / growth
    for end, state in ((0, problem.route.start), (-1, problem.route.end)):
        speed = np.linalg.norm(state.velocity)
        if speed > 0:
            conditions[end] = (1, tangent * means[end] * state.velocity / speed)
    cubics = scipy.interpolate.CubicSpline(at, problem.waypoints, bc_type=tuple(conditions))
    return Trajectory(at, cubics.c, at)


def along(
    problem: Problem, trajectory: Trajectory, *, gridpoints: int = 1000, again: bool = True
) -> Solution:
    """Return the fastest timing of a trajectory's path under velocity and acceleration limits.

    The robot rests at both ends. Where the path stands still (`q'(s) = 0`), as that of a trajectory
    from rest to rest does, it rests at any path speed. At path speed 0 it would lose time at first
    order in the grid; with a free speed it can keep its own timing.

    A 3-5-3 spline leaves and reaches rest along a line `q0 + d s^m`, `m ≥ 3`. The fastest path
    speed there is infinite, so the line itself becomes the path, from path speed 0.

    Where the problem's motion begins or ends with a velocity, the path must have its direction
    there, and the path speed is fixed.

    Every break is a gridpoint, and each piece is cut evenly into steps of about `1/gridpoints` of
    the whole. The limits hold at the gridpoints only: verify the answer. A path that cannot be
    followed is tried `again` with limits wider by 1e-6, and on a finer grid.
    """
    known = problem.without("jerk").limits.in_all_segments()
    scale = sampled_dilation(known, trajectory)
    if problem.limits.segments is not None:  # every waypoint is a gridpoint
        trajectory = trajectory.refined(trajectory.waypoint_times)
    trajectory = straightened(trajectory)
    trajectory = backwards(straightened(backwards(trajectory)))
    speeds = _end_speeds(problem, trajectory)
    if isinstance(speeds, str):
        return Solution(Status.UNSUPPORTED, message=speeds)
    tries = [(gridpoints, 1.0), (gridpoints, _WIDER), (3 * gridpoints, _WIDER)]
    if not problem.route.at_rest:
        tries.insert(0, (gridpoints, _TIGHTER))
    for size, wider in tries if again else tries[:-2]:
        solution = _along(problem.limits, trajectory, size, scale, wider, speeds)
        if solution.trajectory is not None:
            break
    return solution


def _end_speeds(problem: Problem, path: Trajectory) -> list[float] | str:
    """Return the path speed at both ends; or a message, if the path has another direction there.

    NaN where the motion rests.
    """
    speeds = []
    states = {"start": problem.route.start, "end": problem.route.end}
    slopes = path([0.0, path.duration], order=1)
    for (word, state), slope in zip(states.items(), slopes, strict=True):
        velocity = state.velocity
        size = float(np.linalg.norm(velocity))
        steepness = float(slope @ slope)
        speed = float(velocity @ slope) / steepness if steepness > 0 else 0.0
        if size == 0:
            speed = np.nan
        elif not np.linalg.norm(velocity - max(speed, 0) * slope) <= _PARALLEL_RTOL * size:
            return f"TOPP-RA: the path does not leave along the {word} velocity"
        speeds.append(speed)
    return speeds


def sampled_dilation(limits: Limits, path: Trajectory) -> float:
    """Return the cheapest uniform dilation of a path's own timing at `_SAMPLES` of each piece.

    It is used as a unit only, so missing a peak between the samples does no harm.
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
    scale: float,
    wider: float,
    speeds: list[float],
) -> Solution:
    """Time the path on one grid.

    Args:
        limits: Of the problem.
        trajectory: The path.
        gridpoints: About how many steps.
        scale: About the dilation that the path's own timing needs.
        wider: Factor on the limits.
        speeds: Path speeds at both ends (`_end_speeds`).
    """
    path = unit_path(trajectory, gridpoints)
    grid = cut(path)
    unit = scale * trajectory.duration / gridpoints  # unit of time, s
    own_limits = Limits(
        velocity=limits.velocity * unit * wider, acceleration=limits.acceleration * unit**2 * wider
    )
    slopes = np.abs(path([0.0, path.duration], order=1))
    use = (slopes / own_limits.in_all_segments().velocity[:, 1]).max(axis=1)
    # in gridpoints per unit
    given = np.array(speeds) * gridpoints / trajectory.duration * unit
    at_rest = np.isnan(given)
    lowest = np.where(at_rest, 0.0, given)
    highest = np.where(at_rest & (use <= _STILL_RTOL), _FREE_SPEED, lowest)
    segment = path.segments_at(grid.at[:-1] + grid.step / 2)
    limited = tuple(
        pairs[None] if pairs.ndim == 2 else pairs[segment]
        for pairs in (own_limits.velocity, own_limits.acceleration)
    )
    path_speeds, reason = _path_speeds(grid, limited, lowest, highest)
    if path_speeds is None:
        return Solution(Status.FAILED, message=f"TOPP-RA: {reason}")
    retimed = timed(grid, path_speeds / unit, path.waypoint_times)
    stats = {"gridpoints": len(grid.at)}
    return Solution(Status.SOLVED, retimed, stats=stats)


def best_of(problem: Problem, solutions: dict[str, Solution]) -> Solution:
    """Return the solution of the shortest certified duration, with all results in `stats`.

    A single solution is returned without being verified here. With given velocities at the
    ends verification may take long: then a motion whose claim is above the shortest certified
    duration is not verified, and its result is its claim, s.
    """
    if len(solutions) == 1:
        ((rule, only),) = solutions.items()
        return replace(only, stats={"spline": rule, **only.stats})
    results: dict[str, Any] = {}
    # valid ones first, then invalid ones, then failures
    ranks: dict[str, tuple[int, float]] = {}
    shortest = np.inf
    claims = {
        rule: np.inf if solution.trajectory is None else solution.trajectory.duration
        for rule, solution in solutions.items()
    }
    for rule in sorted(solutions, key=lambda rule: claims[rule]):
        solution = solutions[rule]
        if solution.trajectory is None:
            results[rule] = solution.message
            ranks[rule] = (2, 0.0)
            continue
        if not problem.route.at_rest and claims[rule] >= shortest:
            results[rule] = claims[rule]
            continue
        certificate = verify(problem, solution.trajectory)
        shortest = min(shortest, certificate.certified_duration or np.inf)
        flaws = "; ".join(certificate.flaws)
        results[rule] = certificate.certified_duration or flaws
        dilated = certificate.duration * certificate.dilation
        ranks[rule] = (int(not certificate.valid), dilated)
    winner = min((rule for rule in solutions if rule in ranks), key=lambda rule: ranks[rule])
    best = solutions[winner]
    results = {rule: results[rule] for rule in solutions}
    stats = {"spline": winner, **best.stats, **results}
    return replace(best, stats=stats)


def straightened(path: Trajectory, least: int = 3) -> Trajectory:
    """Turn a first piece `q0 + d s^m`, `m ≥ least`, into a line; the slope at its end stays."""
    length = path.breaks[1]
    first = path.coefficients[:, 0]
    piece = polynomials.stretched(first, length)
    curved = np.abs(piece)[:-1]
    sizes = curved.max(axis=1)
    present = sizes > _STRAIGHT_RTOL * sizes.max()
    powers = len(sizes) - np.flatnonzero(present)
    if len(powers) != 1 or powers[0] < least:
        return path

    # the line has the slope at the curve's end, m d s^(m−1), so it is m times shorter
    m = int(powers[0])
    coefficients = np.array(path.coefficients)
    d = coefficients[-1 - m, 0]
    slope = d * m * length ** (m - 1)
    coefficients[-2, 0] = slope
    coefficients[:-2, 0] = 0.0
    saved = length - length / m
    later = path.breaks[1:] - saved
    breaks = np.r_[0.0, later]

    # a waypoint on the line is where the curve reaches it; later ones move by the same amount
    waypoints = path.waypoint_times
    on_curve = (waypoints / length) ** m
    inside = length / m * on_curve
    beyond = waypoints - saved
    times = np.where(waypoints < length, inside, beyond)
    return Trajectory(breaks, coefficients, times)


def backwards(path: Trajectory) -> Trajectory:
    """Reverse a path."""
    lengths = np.diff(path.breaks)
    ends = polynomials.shifted(path.coefficients, lengths[:, None])
    ends[-2::-2] *= -1
    breaks = path.duration - path.breaks[::-1]
    times = path.duration - path.waypoint_times[::-1]
    return Trajectory(breaks, ends[:, ::-1], times)


def unit_path(trajectory: Trajectory, length: float) -> Trajectory:
    """Stretch a path to [0, length], without pieces that are too short for the solver."""
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


class PathGrid(NamedTuple):
    """A path cut into steps.

    Attributes:
        at: Path parameter at the gridpoints, `(N + 1,)`.
        step: Lengths of the steps, `(N,)`.
        local: Path over each step, polynomials on [0, 1], `(degree + 1, N, joints)`.
    """

    at: Array
    step: Array
    local: Array


def cut(path: Trajectory) -> PathGrid:
    """Cut a path into steps of about 1; every break is a gridpoint."""
    lengths = np.diff(path.breaks)
    shortest = path.duration * _SHORT_PIECE_SHARE / len(lengths)
    even = np.ceil(np.maximum(lengths, shortest)).astype(int)
    indivisible = lengths < _INDIVISIBLE_RTOL * path.duration
    parts = np.where(indivisible, 1, even)

    pieces = zip(path.breaks[:-1], lengths, parts, strict=True)
    steps = [start + length * np.arange(count) / count for start, length, count in pieces]
    fine = path.refined(np.concatenate(steps))
    return PathGrid(fine.breaks, fine.lengths, fine.pieces(0))


def _path_speeds(
    grid: PathGrid, limits: tuple[Array, ...], lowest: Array, highest: Array
) -> tuple[Array | None, str]:
    """Return the path speed at every gridpoint, or None and the reason.

    `limits` of velocity and acceleration are `(N, joints, 2)`, or `(1, joints, 2)` where all steps
    have the same. `lowest` and `highest` are the speeds allowed at both ends.
    """
    interval = grid.at[[0, -1]]
    toppra = backend("toppra")
    constraint = _constraint(grid, limits)
    with inside_library():
        algorithm = toppra.algorithm.TOPPRA(
            [constraint],
            SimpleNamespace(path_interval=interval),
            gridpoints=grid.at,
            solver_wrapper="seidel",
        )
        controllable = algorithm.compute_controllable_sets(float(lowest[1]), float(highest[1]))
    if not np.isfinite(controllable).all():
        return None, "the path cannot be followed to its end"
    # the package takes a single end speed; here the whole interval is allowed
    algorithm.compute_controllable_sets = lambda *_: controllable
    slowest, fastest = np.sqrt(controllable[0])
    start = np.clip(highest[0], slowest, fastest)
    if not lowest[0] * (1 - _SPEED_RTOL) <= start <= highest[0] * (1 + _SPEED_RTOL):
        return None, "the path cannot be followed from its velocity at the start"
    with inside_library():
        algorithm.compute_parameterization(float(start), 0.0)
    data = algorithm.problem_data
    if data.sd_vec is None or not np.isfinite(data.sd_vec).all():
        return None, data.return_code.value
    speeds = np.asarray(data.sd_vec)
    sums = speeds[1:] + speeds[:-1]
    if (sums <= 0).any():
        return None, "the path comes to a standstill"
    return speeds, ""


def _constraint(grid: PathGrid, limits: tuple[Array, ...]) -> Any:
    """Return both limits on every grid interval as toppra's `a u + b x + c ≤ 0` and `x ≤ bound`.

    With path acceleration `u`, and the squared path speed `x` where the interval starts, the
    joints' acceleration is

        q'(s) u + q''(s) (x + 2 (s − s_i) u).

    The velocity limits count at the gridpoints and in the middle: from rest a path may reach its
    limit within one interval. Beside a point where the path stands still, the fastest speed falls
    from `_FREE_SPEED` like `1/s`. Velocity exceeds its limit between the nodes there; the excess
    grows with the unit's speed (2 % for `edges-slow` along the clamped spline over chords).
    """
    step = grid.step[:, None]
    # a joint at rest keeps its limits: its rows are left out
    moves = grid.local[:-1].any(axis=(0, 1))
    local = grid.local[:, :, moves]
    velocity, acceleration = (own[:, moves] for own in limits)
    first = polynomials.derivative(local, 1) / step
    second = polynomials.derivative(local, 2) / step**2
    low, high = np.moveaxis(acceleration, -1, 0)
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
    backward_limit, forward_limit = np.moveaxis(velocity, -1, 0)
    top = np.where(slope > 0, forward_limit, backward_limit)
    square = slope**2
    middle = _normalised(step * square, square, -(top**2))
    rows.append(middle)

    # beside each other, for every step; toppra needs one more at the end
    a, b, c = np.concatenate(rows, axis=2)[:, [*range(len(step)), -1]]
    bounds = _speed_bounds(first, velocity)
    # toppra's F (a u + b x + c) ≤ g, and no limit on u alone
    count = a.shape[1]
    f = np.eye(count)
    g = np.zeros(count)
    parameters = (a, b, c, f, g, None, bounds)
    constraint = backend("toppra").constraint.LinearConstraint()
    constraint.identical = True
    constraint.compute_constraint_params = lambda *_: parameters
    return constraint


def _normalised(a: Array, b: Array, c: Array) -> Array:
    """Divide each row by its largest coefficient, `(3, …)`, for the absolute tolerances."""
    largest = np.maximum(np.abs(a), np.abs(b))
    constant = np.abs(c) / _FREE_SPEED**2
    rows = np.stack(np.broadcast_arrays(a, b, c))
    return rows / np.maximum(largest, constant)


def _speed_bounds(first: Array, velocity: Array) -> Array:
    """Return the bounds `0 ≤ x ≤ (V / q')²` at the gridpoints, `(N + 1, 2)`."""
    last = first[:, -1:].sum(axis=0)
    slope = np.concatenate([first[-1], last])
    slowest, fastest = np.moveaxis(velocity, -1, 0)
    if len(velocity) > 1:  # at a gridpoint the limits of the steps on both sides
        steps = np.arange(len(velocity))
        before, after = np.append(0, steps), np.append(steps, steps[-1])
        slowest = np.maximum(slowest[before], slowest[after])
        fastest = np.minimum(fastest[before], fastest[after])
    forwards = slope / fastest
    backwards = slope / slowest
    by_joint = np.maximum(forwards, backwards)
    use = by_joint.max(axis=1)
    use = np.maximum(use, 1 / _FREE_SPEED)
    top = 1 / use**2
    return np.stack([np.zeros_like(top), top], axis=1)


def timed(grid: PathGrid, speeds: Array, waypoints: Array) -> Trajectory:
    """Return the path at `s(t)`, quadratic on each interval; `waypoints` are parameters."""
    # a step takes 2 Δ/(v_i + v_(i+1)); over it, s = c w + (1 − c) w² with w = time/step's time
    before = speeds[:-1]
    sums = speeds[1:] + before
    durations = 2 * grid.step / sums
    breaks = np.r_[0.0, np.cumsum(durations)]
    linear = 2 * before / sums
    square = 1 - linear
    inner = np.stack([square, linear, np.zeros_like(linear)])[..., None]
    composed = polynomials.composed(grid.local, inner)

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
