"""The smoothest motion of a duration, and the shortest motion of a smoothness, within all limits.

For given segment times the motion is one spline per joint (docs/mathematics.md, section 12):
quintic for the least ∫ jerk², cubic for the least ∫ acceleration². Without active limits its only
nodes are the waypoints. Where limits are active, pieces are halved until the gain is negligible.
Segment times are variables of the same program. It is not convex in them, so the answer is the best
local optimum of a few initial guesses.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple

import numpy as np

from baselines.front.smoothest_spline import SmoothestSpline
from baselines.front.spline_program import (
    ProgramShape,
    between_nodes,
    hermite,
    integrated,
    spline_program,
    squared,
)
from baselines.ipopt import flat, unflat
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.demand import END_STATES
from trajopt.core.dwell import between
from trajopt.core.problem import Problem
from trajopt.core.route import State
from trajopt.core.trajectory import Trajectory, nearest
from trajopt.judging.smoothness import JUMP_RTOL, smoothness, squared_integral, weights
from trajopt.judging.verification import verify
from trajopt.planners.rest_to_rest import stop_times

Measure = Literal["jerk", "acceleration"]

# Pieces of each segment at first, if limits are active; the next number if all starts fail.
_START_PIECES = (6, 12, 24)
_MAX_LEVELS = 7
_MAX_PIECES = 400
# Halving ends when its relative gain is smaller.
_GAIN_RTOL = 1e-4
# Bernstein coefficients closer to their limit than this, relative to it, are at the limit.
_ACTIVE_RTOL = 1e-4
# Relative slack by which limits are kept: IPOPT's own tolerance.
_SLACK_RTOL = 1e-9
# The same where segment times are given: no rounding may lead beyond a limit, as no time mends it.
_GIVEN_SLACK_RTOL = 1e-7
# Shortest segment, relative to equal ones.
_SHORTEST_SHARE = 1e-4
# A segment's first time is chosen by its displacement, but at least by this share of the longest.
_SHORTEST_WAY = 1e-6
# A joint that uses less of every limit of its motion, at one of these places of a piece, has slack.
_AT_LIMIT = 1 - 1e-4
_PROBES = np.array([0.25, 0.75])
# It has to, for this share of a segment's time.
_FREE_SHARE = 1e-3
# A dilation that leaves the duration as it is, relative.
_SAME_RTOL = 1e-9


class NodeSpline(NamedTuple):
    """A spline without units.

    Attributes:
        pieces: Number of pieces of each segment.
        shares: Share of each piece in its segment's time, `(pieces,)`.
        times: Times of the segments, `(segments,)`.
        states: Position, velocity (and acceleration) at the nodes, `(nodes, joints)` each.
    """

    pieces: tuple[int, ...]
    shares: Array
    times: Array
    states: list[Array]

    @property
    def lengths(self) -> Array:
        """Return the durations of the pieces, `(pieces,)`."""
        return np.repeat(self.times, self.pieces) * self.shares

    @property
    def coefficients(self) -> list[list[Array]]:
        """Return the Bernstein coefficients of position, velocity, acceleration and jerk."""
        lengths = self.lengths[:, None]
        acceleration = hermite(self.states, lengths)
        q, v = self.states[:2]
        return integrated(q[:-1], v[:-1], acceleration, lengths)


@dataclass(frozen=True, eq=False)
class Least:
    """A point of the front.

    Attributes:
        trajectory: The motion; it keeps every limit.
        duration: s.
        value: Its integral, as defined in `trajopt.judging.smoothness`.
        limits_act: Whether a limit is active. If none is, a dilation of the motion is the answer
            for another duration.
    """

    trajectory: Trajectory
    duration: float
    value: float
    limits_act: bool

    def trajectory_of(self, kept: Indices) -> Trajectory:
        """Return the motion as one of the problem of some waypoints, by index."""
        passed = self.trajectory.waypoint_times[kept]
        return replace(self.trajectory, waypoint_times=passed)


def without_limits(problem: Problem, measure: Measure) -> float | None:
    """Return the least integral of a motion of 1 s without limits."""
    found = _ScaledProgram(problem, measure, 1.0).free()
    return None if found is None else found.value


def least(
    problem: Problem, measure: Measure, duration: float, start: Trajectory | None = None
) -> Least | None:
    """Return the smoothest motion of this duration, s; None if none is found.

    Args:
        problem: All its limits are kept.
        measure: `jerk` or `acceleration`, whose square is integrated.
        duration: s.
        start: A motion through the waypoints, of any duration, as one more initial guess.
    """
    return _ScaledProgram(problem, measure, duration).solve(None, start)


def free(problem: Problem, measure: Measure, duration: float) -> Least | None:
    """Return the smoothest motion of this duration, s, if it meets no limit; else None."""
    found = _ScaledProgram(problem, measure, duration).free()
    return None if found is None or found.limits_act else found


def shortest(
    problem: Problem,
    measure: Measure,
    budget: float,
    start: Trajectory | None = None,
) -> Least | None:
    """Return the shortest motion whose integral is at most the budget; None if none is found."""
    unit_time = float(stop_times(problem).sum())
    free = _ScaledProgram(problem, measure, unit_time).free()
    if free is None:
        return None
    power = 5 if measure == "jerk" else 3
    duration = unit_time * (free.value / budget) ** (1 / power)
    return _ScaledProgram(problem, measure, duration).solve(budget, start)


def smoothed(problem: Problem, motion: Trajectory) -> Trajectory:
    """Return a motion of the same waypoint times, each joint as smooth as it can be in them.

    At given times every joint is a problem of its own. Where a joint is at a limit throughout a
    segment, its motion there decides the time and stays. From the end of such a segment to the
    start of the next one it takes the least ∫ jerk² between the states at both
    (docs/mathematics.md, section 12).

    Args:
        problem: Its limits are kept. Demands on the way are not known here, so a motion with some
            is returned as it is, and so is one under limits of other kinds or of segments.
        motion: Through the waypoints, within the limits.
    """
    limits = problem.limits
    if set(problem.demands).difference(END_STATES) or limits.others or limits.segments is not None:
        return motion
    times = np.diff(motion.waypoint_times)
    if not (times > _SHORTEST_SHARE * times.mean()).all():
        return motion
    motion = motion.refined(motion.waypoint_times)
    joints = []
    for joint, free in enumerate(_free_segments(problem, motion).T):
        own = replace(motion, coefficients=motion.coefficients[..., [joint]])
        for first, last in _runs(free):
            own = _smoother(problem.only([joint]), own, first, last)
        joints.append((own.breaks, own.coefficients[:, :, 0]))
    return Trajectory.joined(joints, motion.waypoint_times)


def _free_segments(problem: Problem, motion: Trajectory) -> Bools:
    """Return where a joint is at no limit of its motion for some time, `(segments, joints)`."""
    times = motion.breaks[:-1, None] + np.diff(motion.breaks)[:, None] * _PROBES
    use = np.zeros((problem.joints, *times.shape))
    for limit in problem.limits.kinds.values():
        if limit.is_ratio:
            for joint, uses in limit.along(motion, times.ravel()).items():
                use[joint] = np.maximum(use[joint], np.abs(uses).reshape(times.shape))
    free = (use.min(axis=2) < _AT_LIMIT) * np.diff(motion.breaks)
    first = nearest(motion.breaks, motion.waypoint_times[:-1])
    spent = np.add.reduceat(free, first, axis=1).T
    return (spent > _FREE_SHARE * np.diff(motion.waypoint_times)[:, None]) & problem.moving


def _runs(free: Bools) -> Iterator[tuple[int, int]]:
    """Yield the first and last waypoint of each run of segments."""
    edges = np.flatnonzero(np.diff(free, prepend=False, append=False))
    yield from zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)


def _smoother(alone: Problem, motion: Trajectory, first: int, last: int) -> Trajectory:
    """Return one joint's motion, between two waypoints the smoothest; as it is if none is found."""
    begins, stops = motion.waypoint_times[[first, last]].tolist()
    part = between(motion, begins, stops)
    if part is None:
        return motion
    passed = motion.waypoint_times[first : last + 1] - begins
    part = replace(part, waypoint_times=np.append(passed[:-1], part.duration))
    # the states as the segments before and after have them
    ends = [alone.route.start, alone.route.end]
    if first > 0:
        ends[0] = _state(motion, np.nextafter(begins, 0.0))
    if last < alone.segments:
        ends[1] = _state(motion, stops)
    rates = 2 if alone.has("jerk") else 1  # without a jerk limit no acceleration may be demanded
    demands = {
        f"{end}_{rate}": value
        for end, state in zip(("start", "end"), ends, strict=True)
        for rate, value in zip(("velocity", "acceleration")[:rates], state, strict=False)
    }
    waypoints = alone.waypoints[first : last + 1]
    if not np.diff(waypoints, axis=0).any():
        return motion  # it rests, or returns to where it is: no problem has only equal waypoints
    asked = Problem(waypoints, alone.limits, demands=demands)
    times = np.diff(part.waypoint_times)
    found = _ScaledProgram(asked, "jerk", part.duration, times, ends).solve(None, part)
    if found is None or _jerks(found.trajectory) >= _jerks(part) * (1 - _GAIN_RTOL):
        return motion
    spliced = _spliced(motion, found.trajectory, begins, stops)
    kept = verify(alone, spliced)
    return spliced if kept.feasible and kept.dilation <= 1 + _SAME_RTOL else motion


def _jerks(motion: Trajectory) -> float:
    """Return ∫ jerk² of a joint between its ends, infinite where its acceleration jumps."""
    pieces = motion.pieces(2)
    jumps = np.abs(pieces[-1, 1:] - pieces.sum(axis=0)[:-1])
    if jumps.max(initial=0.0) > JUMP_RTOL * np.abs(pieces).max():
        return np.inf
    return float(squared_integral(motion, 3).sum())


def _state(motion: Trajectory, time: float) -> State:
    return State(motion(time, 1), motion(time, 2))


def _spliced(motion: Trajectory, part: Trajectory, begins: float, stops: float) -> Trajectory:
    """Return the motion with another part between two of its breaks, s."""
    first, last = nearest(motion.breaks, np.array([begins, stops])).tolist()
    rows = max(len(motion.coefficients), len(part.coefficients))
    tables = (motion.coefficients[:, :first], part.coefficients, motion.coefficients[:, last:])
    filled = [np.pad(own, ((rows - len(own), 0), (0, 0), (0, 0))) for own in tables]
    lengths = (motion.lengths[:first], part.lengths, motion.lengths[last:])
    breaks = (motion.breaks[: first + 1], begins + part.breaks[1:-1], motion.breaks[last:])
    return Trajectory(
        np.concatenate(breaks),
        np.concatenate(filled, axis=1),
        motion.waypoint_times,
        np.concatenate(lengths),
    )


class _ScaledProgram:
    """A problem without units: mean segment time 1, largest displacement of each joint 1.

    Segment times are variables, unless they are given, s, `(segments,)`. The states at the ends are
    the problem's, or given.
    """

    def __init__(
        self,
        problem: Problem,
        measure: Measure,
        duration: float,
        times: Array | None = None,
        ends: Sequence[State] | None = None,
    ) -> None:
        self.problem = problem
        self.times = None if times is None else times * problem.segments / duration
        self.measure = measure
        self.moving = problem.moving
        self.duration = duration
        self.order = 3 if measure == "jerk" else 2
        self.quintic = measure == "jerk" or problem.has("jerk")
        self.unit = duration / problem.segments
        states = (problem.route.start, problem.route.end) if ends is None else ends
        velocities = np.array([state.velocity[self.moving] for state in states]) * self.unit
        accelerations = np.array([state.acceleration[self.moving] for state in states])
        rates = [velocities, accelerations * self.unit**2]
        fastest = np.abs(rates).max(axis=(0, 1))
        self.scale = np.maximum(problem.largest_displacements[self.moving], fastest)
        self.ends = [own / self.scale for own in rates]
        self.origin = problem.waypoints[0, self.moving]
        self.q = (problem.waypoints[:, self.moving] - self.origin) / self.scale
        limits = problem.limits.by_name()
        self.limits = {0: self._limits(limits["position"] - problem.waypoints[0][:, None], 0)}
        for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
            pairs = limits[name] * (1 - (_SLACK_RTOL if times is None else _GIVEN_SLACK_RTOL))
            self.limits[order] = self._limits(pairs, order)
        for order, rate in enumerate(self.ends, start=1):  # a state at a limit keeps it
            low, high = self.limits[order]
            wider = np.minimum(low, rate.min(axis=0)), np.maximum(high, rate.max(axis=0))
            self.limits[order] = np.array(wider)
        own = weights(problem)[self.moving] * self.scale**2
        self.integral_unit = float(own.max()) / self.unit ** (2 * self.order - 1)
        self.weights = own / own.max()

    def _limits(self, pairs: Array, order: int) -> Array:
        """Return the limits of the moving joints without units, `(2, joints)`."""
        return (pairs[self.moving] * self.unit**order / self.scale[:, None]).T

    # --- splines ---

    def resting(self, times: Array) -> NodeSpline:
        """Return the spline that rests at every waypoint between, with one piece per segment."""
        states = [self.q]
        for ends in self.ends[: 2 if self.quintic else 1]:
            states.append(np.zeros(self.q.shape))
            states[-1][[0, -1]] = ends
        count = len(times)
        return NodeSpline((1,) * count, np.ones(count), times, states)

    def trajectory(self, spline: NodeSpline) -> Trajectory:
        """Return the motion in the problem's units; a given duration is exact."""
        lengths = spline.lengths * self.unit
        breaks = np.append(0.0, np.cumsum(lengths))
        factors = [self.scale / self.unit**order for order in range(len(spline.states))]
        rates = [state * factor for state, factor in zip(spline.states, factors, strict=True)]
        rates[0] = rates[0] + self.origin
        passed = np.append(0, np.cumsum(spline.pieces))
        rates[0][passed] = self.problem.waypoints[:, self.moving]
        own = Trajectory.from_samples(breaks, *rates, waypoint_times=breaks[passed])
        return own.beside(self.problem.waypoints[0], self.moving)

    def sampled(self, motion: Trajectory, pieces: tuple[int, ...], shares: Array) -> NodeSpline:
        """Return the spline through a motion's states at the nodes."""
        passed = motion.waypoint_times
        lengths = np.repeat(np.diff(passed), pieces) * shares
        nodes = np.append(0.0, np.cumsum(lengths))
        unit = motion.duration / self.problem.segments
        states = []
        for order in range(3 if self.quintic else 2):
            rate = motion(nodes, order)[:, self.moving] - self.origin * (order == 0)
            states.append(rate * unit**order / self.scale)
        return NodeSpline(pieces, shares, np.diff(passed) / unit, states)

    def value(self, spline: NodeSpline) -> float:
        """Return the integral, without units."""
        coefficients = spline.coefficients[self.order]
        return float((squared(coefficients, spline.lengths[:, None]) * self.weights).sum())

    # --- search ---

    def solve(self, budget: float | None, start: Trajectory | None) -> Least | None:
        """Return the optimum without limits; if it breaks one, that with limits on finer pieces."""
        free = self.free()
        if free is not None and not free.limits_act:
            return free
        for pieces in _START_PIECES:
            for spline in self._starts(pieces, free, start):
                found = self._refined(spline, budget)
                if found is not None:
                    return found
        return None

    def free(self) -> Least | None:
        """Return the smoothest motion without limits; `limits_act` is true if it breaks one."""
        ends = self.ends[: 2 if self.quintic else 1]
        smoothest = SmoothestSpline(self.q, ends, self.weights, self.order)
        try:
            found = [self._unlimited(smoothest, times) for times in self._shares()]
        except np.linalg.LinAlgError:  # steps so short that the states' system has no digits left
            return None
        best = self.trajectory(min(found, key=self.value))
        certificate = verify(self.problem, best)
        return self._point(best, limits_act=not certificate.valid or certificate.dilation > 1)

    def _unlimited(self, smoothest: SmoothestSpline, first: Array) -> NodeSpline:
        times = first
        if self.times is None and len(first) > 1:
            times = smoothest.best_times(first)
        _, _, states = smoothest.least(times)
        return NodeSpline((1,) * len(times), np.ones(len(times)), times, states)

    def _shares(self) -> Iterator[Array]:
        """Yield initial segment times: in proportion to displacements, and more equal ones."""
        count = self.problem.segments
        if self.times is not None or count == 1:
            yield np.ones(1) if self.times is None else self.times
            return
        ways = np.abs(np.diff(self.q, axis=0)).max(axis=1)
        ways = np.maximum(ways, _SHORTEST_WAY * ways.max())
        for power in (0.3, 0.7):
            times = ways**power
            yield count * times / times.sum()

    def _starts(
        self, count: int, free: Least | None, start: Trajectory | None
    ) -> Iterator[NodeSpline]:
        pieces = (count,) * self.problem.segments
        shares = np.full(sum(pieces), 1 / count)
        if free is not None:
            yield self.sampled(free.trajectory, pieces, shares)
        if start is not None:
            yield self.sampled(start, pieces, shares)
        if self.times is not None:
            return
        times = stop_times(self.problem) / self.unit
        resting = self.resting(times * len(times) / times.sum())
        yield self.sampled(self.trajectory(resting), pieces, shares)

    def _refined(self, start: NodeSpline, budget: float | None) -> Least | None:
        """Halve the pieces where limits become active or inactive, until the gain is negligible."""
        orders = tuple(order for order in range(4) if np.isfinite(self.limits[order]).any())
        spline = self._solved(start, orders, budget, warm=False)
        if spline is None:
            return None
        goal = self._goal(spline, budget)
        for _ in range(_MAX_LEVELS):
            halved = self._halved(spline, orders)
            if halved is None:
                break
            finer = self._solved(halved, orders, budget, warm=True)
            if finer is None:
                finer = self._solved(halved, orders, budget, warm=False)
            if finer is None:
                break
            reached = self._goal(finer, budget)
            gain = 1 - reached / goal
            if gain > 0:
                spline, goal = finer, reached
            if gain < _GAIN_RTOL:
                break
        return self._point(self.trajectory(spline), limits_act=True)

    def _goal(self, spline: NodeSpline, budget: float | None) -> float:
        """Return the objective's value; a duration is converted to an integral."""
        if budget is None:
            return self.value(spline)
        return float(spline.times.sum() ** (2 * self.order - 1))

    def _point(self, trajectory: Trajectory, *, limits_act: bool) -> Least:
        found = smoothness(self.problem, trajectory)
        value = found.jerk_integral if self.order == 3 else found.acceleration_integral
        return Least(trajectory, trajectory.duration, value, limits_act)

    def _solved(
        self, start: NodeSpline, orders: tuple[int, ...], budget: float | None, *, warm: bool
    ) -> NodeSpline | None:
        """Return IPOPT's local optimum on the pieces of `start`."""
        count = len(self.q) - 1
        joints = len(self.scale)
        layout = ProgramShape(
            start.pieces, joints, self.order, self.quintic, orders, budget is not None, warm
        )
        size = self.value(start)
        scaled = self.weights / size
        bound = float(count)
        if budget is not None:
            bound = budget / self.integral_unit / size
        variables = [table.shape for table in self._variables(start)]
        bounds = self._bounds(start, variables, orders)
        low, high = self._constraint_bounds(start, orders)
        lowest, highest = (-np.inf, 0.0) if budget is not None else (0.0, 0.0)
        if self.times is not None:  # their sum is no equation for any variable
            lowest, highest = -np.inf, np.inf
        run = spline_program(layout)(
            flat(start.times, *self._variables(start)),
            flat(start.shares, scaled, np.array([bound])),
            bounds,
            (np.append(low, lowest), np.append(high, highest)),
        )
        if not run.success:
            return None
        times, *found = unflat(run.x, [(count,), *variables])
        states = found[: len(start.states)]
        if budget is None:
            times = times * count / times.sum()
        return start._replace(times=times, states=states)

    def _variables(self, spline: NodeSpline) -> list[Array]:
        """Return the states of a spline as the program's variables."""
        acceleration = hermite(spline.states, spline.lengths[:, None])
        return [*spline.states, *(acceleration[1:-1] if self.quintic else acceleration)]

    def _bounds(
        self, spline: NodeSpline, shapes: list[tuple[int, ...]], orders: tuple[int, ...]
    ) -> tuple[Array, Array]:
        """Return the bounds of times and variables; waypoints and the ends' states are fixed."""
        passed = np.append(0, np.cumsum(spline.pieces))
        sides = []
        for side, infinite in enumerate((-np.inf, np.inf)):
            tables = [np.full(shape, infinite) for shape in shapes]
            for order, table in enumerate(tables):
                own = min(order, 2)
                if own in orders:
                    table[:] = self.limits[own][side]
            tables[0][passed] = self.q
            for table, ends in zip(tables[1 : len(spline.states)], self.ends, strict=False):
                table[[0, -1]] = ends
            times = np.full(len(spline.times), infinite if side else _SHORTEST_SHARE)
            if self.times is not None:
                times = self.times
            sides.append(flat(times, *tables))
        return sides[0], sides[1]

    def _constraint_bounds(
        self, spline: NodeSpline, orders: tuple[int, ...]
    ) -> tuple[Array, Array]:
        rows = np.zeros((sum(spline.pieces), len(self.scale)))
        found = spline.coefficients
        links = [np.zeros(2 * rows.size)]
        low, high = list(links), list(links)
        for order in orders:
            count = len(between_nodes(found, order))
            for side, tables in enumerate((low, high)):
                tables.append(np.tile(flat(rows + self.limits[order][side]), count))
        return np.concatenate(low), np.concatenate(high)

    # --- pieces ---

    def _halved(self, spline: NodeSpline, orders: tuple[int, ...]) -> NodeSpline | None:
        """Halve the pieces in a part of which a limit is active, and their neighbours."""
        chosen = self._mixed(spline, orders)
        segment = np.repeat(np.arange(len(spline.pieces)), spline.pieces)
        if not chosen.any() or len(chosen) + chosen.sum() > _MAX_PIECES:
            return None
        repeats = np.where(chosen, 2, 1)
        shares = np.repeat(spline.shares / repeats, repeats)
        pieces: Indices = np.bincount(np.repeat(segment, repeats))
        return self.sampled(self.trajectory(spline), tuple(pieces.tolist()), shares)

    def _mixed(self, spline: NodeSpline, orders: tuple[int, ...]) -> Bools:
        """Pieces with coefficients at a limit, unless all of them are, beside others like it."""
        found = spline.coefficients
        chosen = np.zeros(sum(spline.pieces), dtype=bool)
        for order in orders:
            low, high = self.limits[order]
            # a node's own value belongs to both of its pieces
            table = np.array(found[order])
            for limit in (low, high):
                size = np.abs(np.where(np.isfinite(limit), limit, 0.0))
                near = np.abs(table - limit) <= _ACTIVE_RTOL * size
                some = near.any(axis=0)
                whole = near.all(axis=0)
                part = (some & ~whole).any(axis=1)
                chosen |= part
        beside = chosen.copy()
        beside[1:] |= chosen[:-1]
        beside[:-1] |= chosen[1:]
        return chosen
