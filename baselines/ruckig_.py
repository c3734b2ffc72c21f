"""Ruckig, the open edition (Berscheid & Kröger 2021), and a search of ours around it.

The open edition takes no intermediate waypoints. So Ruckig plans every segment as a section of its
own, from one state (position, velocity, acceleration) to the next, and all joints arrive together.
`RuckigStop` rests at every inner waypoint. `RuckigVia` starts from that motion and improves the
states at the inner waypoints.

Ruckig takes one jerk limit for both sides, so of an asymmetric limit it gets the tighter side. It
ignores position limits, so every section is checked against them here. Without a jerk limit it
ignores accelerations. Its `minimum_duration` is a segment's least, or given, time.

Its tolerances are absolute, so every section has its own units. The unit of time is its time from
rest to rest. The unit of length is the distance that a joint can travel from rest to rest in that
time, under its tightest limit. Then velocity limits are at least 1, acceleration limits at least 4,
jerk limits at least 32, displacements at most 1. A miss of 1e-8 costs as little in a segment of
1e-5 rad as in one of 1 rad. Ruckig gets the same numbers whatever the units of the problem.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy  # its submodules are imported when they are used: listing planners does not need them
from numpy.typing import NDArray

from baselines.linear_programs import LinearProgram
from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.demand import END_STATES
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.limits import LIMIT_NAMES, Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.library_time import inside_library
from trajopt.planners.planner import Planner, backend
from trajopt.planners.reductions import RESTING_JOINTS, SIMPLEST, reduced
from trajopt.planners.rest_to_rest import stop_times

# One joint's breaks and coefficients, as `Trajectory.joined` takes them.
Part = tuple[Array, Array]
# Indices of segments, one per case.
Numbers = NDArray[np.intp]
# Evaluations spent, and the shortest total time by then, s.
History = list[tuple[int, float]]

_LOPSIDED = "Ruckig's jerk limit is symmetric: the tighter side was used"
# Distance of a waypoint's states from their limits, relative.
_STATE_MARGIN = 1e-9
# Signs of a rise and of a fall.
_SIGNS = np.array([1.0, -1.0])[:, None, None, None, None]
# Step of the differences, relative to the trust region.
_DIFFERENCE_SHARE = 0.1
# Initial guesses of a waypoint's velocity, as shares of the mean velocity around it.
_MEAN_SHARES = (0.0, 1.0, 0.5, 1.5)
# Radii around the best states from which random initial guesses are drawn, relative to the limits.
_RANDOM_RADII = (0.1, 0.5, 0.02)
# First and last radius of the trust region, relative to the limits.
_FIRST_RADIUS = 0.5
_LAST_RADIUS = 1e-5
# Least gain of an accepted step, relative.
_GAIN_RTOL = 1e-7
# Feasibility tolerance of the programs that propose steps.
_ROW_TOLERANCE = 1e-7
# Factors on the states at both ends: exactly opposite states at one position crash Ruckig 0.19.
_END_FACTORS = np.array([1.0, 1 - 1e-14])[:, None, None]
# Rounding of a given time, relative.
_GIVEN_RTOL = 1e-9
# Rounding of a position beyond its limit, relative to the largest coordinate.
_POSITION_RTOL = 1e-12


@dataclass(frozen=True)
class RuckigStop(Planner):
    """Ruckig from waypoint to waypoint, stopping at each."""

    requires = ("ruckig",)
    knows = (*LIMIT_NAMES, "segment", *END_STATES, "least_times", "given_times")

    def unsupported(self, problem: Problem) -> str | None:
        limited = np.asarray(np.isfinite(problem.limits.jerk).any(axis=-1))
        if limited.ndim == 2 and (limited != limited[0]).any():
            return "it does not know a joint's jerk limit in some segments only"
        return None

    @reduced(SIMPLEST)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        sections = Sections(problem)
        return _solution(problem, sections, sections.stopping, [])


@dataclass(frozen=True)
class RuckigVia(RuckigStop):
    """Our local search for the states at the waypoints, with Ruckig in every segment.

    Not Ruckig's own waypoint planner, which runs on its maker's server only. The search begins at
    rest and improves velocities (and accelerations, under jerk limits).

    - `evaluations`: how many segments Ruckig computes.
    """

    evaluations: int = 8000  # Ruckig's sections, about 0.06 ms each with the search around them

    def __post_init__(self) -> None:
        if self.evaluations < 1:
            raise InvalidInput("evaluations", "at least 1", value=self.evaluations)

    @reduced(SIMPLEST)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        sections = Sections(problem)
        states, history = improved(sections, self.evaluations)
        return _solution(problem, sections, states, history)


class Sections:
    """Ruckig on the segments of a problem whose consecutive waypoints differ and joints all move.

    `states` are `(2, waypoints, joints)`: velocity, rad/s, and
    acceleration, rad/s² (unused for joints without a jerk limit). `at_ends` are the states at both
    ends of the segments of several cases: `(2, 2 ends, cases, joints)`.

    Attributes:
        waypoints: rad.
        unit_times: Each segment's unit of time, s.
        low, high: Bounds of the states at every waypoint.
        evaluations: Number of sections computed.
    """

    def __init__(self, problem: Problem) -> None:
        ruckig = backend("ruckig")
        self.waypoints = problem.waypoints
        self.route = problem.route
        self.limits = problem.limits
        joints = problem.joints
        self._solver = ruckig.Ruckig(joints)
        self._trajectory = ruckig.Trajectory(joints)
        self._success = (ruckig.Result.Working, ruckig.Result.Finished)
        # a result code that Ruckig's own enumeration lacks is a ValueError
        self._errors = (ruckig.RuckigError, ValueError)
        self.least_times = self.route.demand("least_times") + self.route.demand("given_times")
        stops = stop_times(problem)
        # equal waypoints with a time between them stay apart
        self.unit_times = np.where(stops > 0, stops, self.least_times)
        self._unit_lengths = _travelled(self.limits, self.unit_times[:, None])
        ways = np.diff(self.waypoints, axis=0)
        self._longest = np.full(len(ways), np.inf)
        if "given_times" in self.route.demands:
            self._longest = self.least_times * (1 + _GIVEN_RTOL)
        of_each = zip(ways, self.unit_times, self._unit_lengths, self.least_times, strict=True)
        self._inputs = [
            _input(ruckig, own.in_units(time, lengths[:, None]), way / lengths, least / time)
            for own, (way, time, lengths, least) in zip(
                self._limits_of_each(), of_each, strict=True
            )
        ]
        # units of the whole motion: its longest segment's time, each joint's range
        self.longest_stop = float(self.unit_times.max())
        ranges = np.ptp(self.waypoints, axis=0)
        # a joint that only begins or ends in motion has no range
        speeds = np.where(ranges > 0, ranges, ranges.max()) / self.longest_stop
        self.state_units = np.stack([speeds, speeds / self.longest_stop])[:, None]
        self.low, self.high = self._bounds()
        slack = _POSITION_RTOL * np.maximum(np.abs(self.waypoints).max(axis=0), 1)
        lowest, highest = self.limits.position.T
        self._lowest = lowest - slack
        self._highest = highest + slack
        widest = self.limits.in_all_segments(tightest=False)
        self._fastest = np.abs(widest.velocity).max(axis=1)
        self._has_position_limits = bool(np.isfinite(self.limits.position).any())
        self.evaluations = 0

    def _bounds(self) -> tuple[Array, Array]:
        """Return bounds of the states: inside their limits, and equal at both ends of the motion.

        Without a jerk limit Ruckig does not read a joint's acceleration: it is 0.
        """
        both = (_passing(own) for own in (self.limits.velocity, self.limits.acceleration))
        boxes = np.stack(np.broadcast_arrays(*both)) * (1 - _STATE_MARGIN)
        boxes[1][:, ~self.limits.jerk_limited] = 0
        low = self.stopping
        high = self.stopping
        low[:, 1:-1] = boxes[..., 0]
        high[:, 1:-1] = boxes[..., 1]
        return low, high

    def _limits_of_each(self) -> list[Limits]:
        """Return the limits of every segment."""
        numbers = range(len(self.waypoints) - 1)
        return [self.limits.of_segments(np.array([number])) for number in numbers]

    @property
    def stopping(self) -> Array:
        """Return states of rest at the inner waypoints, and the given ones at both ends."""
        states = np.zeros((2, *self.waypoints.shape))
        states[:, 0] = self.route.start
        states[:, -1] = self.route.end
        return states

    def minima(self, k: Numbers, at_ends: Array) -> Array:
        """Return each joint's own least time, s, `(cases, joints)`; NaN where Ruckig refuses.

        Args:
            k: Indices of the segments, `(cases,)`.
            at_ends: The states at both ends.
        """
        unknown = [np.nan] * self.limits.joints
        minima = [
            self._trajectory.independent_min_durations if solved else unknown
            for _, solved in self._calculated(k, at_ends)
        ]
        return np.multiply(minima, self.unit_times[k, None])

    def durations(self, k: Numbers, at_ends: Array) -> list[float]:
        """Return the times with all joints together, s.

        Infinite where a limit is broken, or a given time exceeded. The arguments are those of
        `minima`.
        """
        return [
            self._time(number) if solved and self._is_kept(number) else np.inf
            for number, solved in self._calculated(k, at_ends, checked=True)
        ]

    def _is_kept(self, k: int) -> bool:
        """Return whether segment `k`, just computed, keeps its given time and position limits."""
        return self._time(k) <= self._longest[k] and self._keeps_positions(k)

    def motions(self, states: Array) -> Iterator[Trajectory]:
        """Yield the motion of each segment."""
        for k, solved in self._calculated(*_every_segment(states)):
            if not solved:
                raise ArithmeticError(f"Ruckig gave up on segment {k + 1}")
            if self._time(k) > self._longest[k]:
                raise ArithmeticError(
                    f"Ruckig takes {self._time(k):.6g} s for segment {k + 1} between these states; "
                    f"{self.least_times[k]:.6g} s are given"
                )
            parts = []
            for joint, start in enumerate(self.waypoints[k]):
                breaks, cubics = self._cubics(joint)
                time = self.unit_times[k]
                coefficients = polynomials.stretched(cubics, 1 / time)
                coefficients *= self._unit_lengths[k, joint]
                coefficients[-1] += start
                parts.append((time * breaks, coefficients))
            yield Trajectory.joined(parts, [0.0, self._time(k)])

    def _time(self, k: int) -> float:
        """Return the time of segment `k`, just computed, s."""
        time: float = self._trajectory.duration * self.unit_times[k]
        return time

    def _cubics(self, joint: int) -> Part:
        """Return a joint's `(breaks, coefficients)` in the section just computed, in its units."""
        profile = self._trajectory.profiles[0][joint]
        lengths = []
        cubics = []
        for part in (profile.brake, profile, profile.accel):
            for t, j, a, v, p in zip(part.t, part.j, part.a, part.v, part.p, strict=False):
                if t > 0:
                    # q(t) = p + v t + a t²/2 + j t³/6
                    lengths.append(t)
                    cubics.append([j / 6, a / 2, v, p])
        if not lengths:
            lengths = [self._trajectory.duration]
            cubics = [[0.0, 0.0, profile.vf, profile.pf]]
        breaks = np.append(0.0, np.cumsum(lengths))
        breaks[-1] = self._trajectory.duration
        return breaks, np.array(cubics).T

    def _calculated(
        self, k: Numbers, at_ends: Array, *, checked: bool = False
    ) -> Iterator[tuple[int, bool]]:
        """Yield each case's segment, and whether Ruckig has just solved it.

        With `checked`, a section whose states break a limit is refused.
        """
        time = self.unit_times[k, None]
        velocity, acceleration = at_ends * _END_FACTORS * time / self._unit_lengths[k]
        starts, ends = velocity.tolist()
        first_bends, last_bends = (acceleration * time).tolist()
        for case, number in enumerate(k.tolist()):
            given = self._inputs[number]
            given.current_velocity = starts[case]
            given.current_acceleration = first_bends[case]
            given.target_velocity = ends[case]
            given.target_acceleration = last_bends[case]
            yield number, self._solves(given, checked)

    def _solves(self, given: Any, checked: bool) -> bool:
        self.evaluations += 1
        try:
            with inside_library():
                if checked and not self._solver.validate_input(given, True, True):
                    return False
                result = self._solver.calculate(given, self._trajectory)
            return result in self._success
        except self._errors:
            return False

    def _keeps_positions(self, k: int) -> bool:
        """Return whether segment `k`, just computed, keeps the position limits."""
        if not self._has_position_limits:
            return True
        # the extreme position of a joint is at most (q0 + q1 ± V T)/2: top speed there and back
        both = self.waypoints[k] + self.waypoints[k + 1]
        farthest = self._fastest * self._time(k)
        low = (both - farthest) / 2 < self._lowest
        high = (both + farthest) / 2 > self._highest
        for j in np.flatnonzero(low | high).tolist():
            breaks, cubics = self._cubics(j)
            unit = polynomials.stretched(cubics, np.diff(breaks)) * self._unit_lengths[k, j]
            unit[-1] += self.waypoints[k, j]
            points = polynomials.critical_points(unit)
            extremes = polynomials.evaluate(unit[:, None], points)
            if extremes.min() < self._lowest[j] or extremes.max() > self._highest[j]:
                return False
        return True


def _travelled(limits: Limits, time: Array) -> Array:
    """Return the distance that each joint can travel from rest to rest in a time, rad."""
    V, A, J = (np.abs(limits.by_name()[name]).min(axis=-1) for name in LIMIT_NAMES[:3])
    return np.min([V * time, A * time**2 / 4, J * time**3 / 32], axis=0)


def _passing(pairs: Array) -> Array:
    """Return the tighter limits of both segments at inner waypoints, `(…, joints, 2)`."""
    if pairs.ndim == 2:
        return pairs[None]
    low, high = np.moveaxis(pairs, -1, 0)
    tighter = np.maximum(low[:-1], low[1:]), np.minimum(high[:-1], high[1:])
    return np.stack(tighter, axis=-1)


def _input(ruckig: Any, limits: Limits, target: Array, least_time: float) -> Any:
    """Return Ruckig's input for one segment, without the states at its ends."""
    given = ruckig.InputParameter(limits.joints)
    given.min_velocity, given.max_velocity = limits.velocity.T.tolist()
    given.min_acceleration, given.max_acceleration = limits.acceleration.T.tolist()
    given.max_jerk = np.abs(limits.jerk).min(axis=1).tolist()
    given.target_position = target.tolist()
    if least_time > 0:
        given.minimum_duration = least_time
    return given


def section(
    limits: Limits, start: tuple[Array, Array, Array], end: tuple[Array, Array, Array]
) -> tuple[float, Array]:
    """Solve one section between two states (position, velocity, acceleration; each `(joints,)`).

    Returns:
        Its duration with all joints arriving together, and the least time of each joint that moves,
        s. Infinite and NaN where Ruckig refuses.

    Raises:
        InvalidInput: No joint moves.
    """
    problem = Problem(np.array([start[0], end[0]]), limits)
    sections = Sections(RESTING_JOINTS.apply(problem))
    states = np.stack([start[1:], end[1:]], axis=1)[..., problem.moving]
    (minima,) = sections.minima(*_every_segment(states))
    (duration,) = sections.durations(*_every_segment(states))
    return duration, minima


# --- the search ---


def improved(sections: Sections, evaluations: int) -> tuple[Array, History]:
    """Return better states at the waypoints than rest, and the best total by evaluations spent.

    The search descends from rest, from the waypoints' mean velocities, and then from random points
    around the best states so far, as long as the budget lasts. The random numbers are always the
    same.
    """
    best = sections.stopping
    shortest = _total(sections, best)
    history = [(sections.evaluations, shortest)]
    if not np.isfinite(shortest) or len(sections.waypoints) == 2:
        return best, history
    generator = np.random.default_rng(0)
    programs = StepPrograms(sections)
    guesses = _guesses(sections)
    while sections.evaluations < evaluations:
        radius = generator.choice(_RANDOM_RADII)
        start = generator.uniform(*_trust_region(sections, best, radius))
        if guesses:
            start = guesses.pop(0)
        states, total = _descended(sections, programs, start, evaluations)
        if total < shortest:
            best = states
            shortest = total
            history.append((sections.evaluations, shortest))
    return best, history


def _guesses(sections: Sections) -> list[Array]:
    """Return rest, and shares of the mean velocity around each waypoint."""
    rest = sections.stopping
    minima = sections.minima(*_every_segment(rest))
    times = np.nanmax(minima, axis=1)
    # v_k = (q_(k+1) − q_(k−1)) / (T_k + T_(k+1))
    ways = sections.waypoints[2:] - sections.waypoints[:-2]
    means = sections.stopping
    means[0, 1:-1] = ways / (times[1:] + times[:-1])[:, None]
    region = _trust_region(sections, rest, 1.0)
    return [np.clip(share * means, *region) for share in _MEAN_SHARES]


def _descended(
    sections: Sections, programs: StepPrograms, states: Array, evaluations: int
) -> tuple[Array, float]:
    """Return a local optimum and its total time, by sequential linear programming.

    The total is `Σ_k max_j τ_kj`. A joint's own least time `τ_kj` depends only on its own states at
    the segment's ends, so one section gives the differences of all joints. A step is accepted if it
    shortens the total; otherwise the trust region shrinks, and the differences with it.
    """
    best = _total(sections, states)
    radius = _FIRST_RADIUS
    while radius > _LAST_RADIUS and sections.evaluations < evaluations:
        trial = programs.proposed(states, radius)
        total = _total(sections, trial)
        if total < best * (1 - _GAIN_RTOL):
            states = trial
            best = total
            radius = min(2 * radius, 1.0)
        else:
            radius /= 3
    return states, best


def _total(sections: Sections, states: Array) -> float:
    """Return the duration of all segments, s."""
    return sum(sections.durations(*_every_segment(states)))


def _every_segment(states: Array) -> tuple[Numbers, Array]:
    """Return the indices of all segments, and the states at their ends."""
    k = np.arange(states.shape[1] - 1)
    return k, states[:, np.array([k, k + 1])]


def _trust_region(sections: Sections, states: Array, radius: float) -> tuple[Array, Array]:
    """Return the lowest and highest states within a radius."""
    farthest = radius * np.maximum(np.minimum(sections.high, -sections.low), 0.0)
    lower = np.maximum(states - farthest, sections.low)
    upper = np.minimum(states + farthest, sections.high)
    return lower, upper


class StepPrograms:
    """The linear programs that propose steps.

    Rows, one per segment and joint: time + up · rise − down · fall ≤ τ. Variables: the rise of
    every state, its fall, and every segment's τ. The solver's tolerances are absolute, so states
    and times are in units of the whole motion.
    """

    def __init__(self, sections: Sections) -> None:
        self._sections = sections
        rest = sections.stopping
        self._segments, _ = _every_segment(rest)
        # the waypoints at both ends of every segment, `(2, segments)`
        self._ends = np.stack([self._segments, self._segments + 1])
        steps = 2 * rest.size
        self._cost = np.append(np.zeros(steps), np.ones(len(self._segments)))
        # the columns of a segment's and joint's row: the states at both ends of the segment, and τ
        variables = np.arange(steps).reshape(2, *rest.shape)
        at_ends = variables[..., self._ends, :]
        rows = np.arange(at_ends[0, 0, 0].size)
        by_joint = rows.reshape(at_ends.shape[-2:])
        time = steps + rows // rest.shape[-1]
        all_rows = np.append(np.broadcast_to(by_joint, at_ends.shape), rows)
        places = (all_rows, np.append(at_ends, time))
        order = np.arange(len(all_rows))
        shape = (len(rows), len(self._cost))
        self._matrix = scipy.sparse.csr_matrix((order, places), shape)
        self._order = self._matrix.data
        self._program = LinearProgram(_ROW_TOLERANCE)

    def proposed(self, states: Array, radius: float) -> Array:
        """Return the states that minimise the linear model within the trust region."""
        sections = self._sections
        lower, upper = _trust_region(sections, states, radius)
        slack = np.stack([upper - states, states - lower])
        times, slopes = self._model(states, slack)
        units = sections.state_units
        longest = sections.longest_stop
        values = np.append(slopes * units[:, None] / longest, np.full(times.size, -1.0))
        self._matrix.data = values[self._order]
        self._program.load(
            np.append(np.zeros(slack.size), sections.least_times / longest),
            np.append(slack / units, np.full(len(times), np.inf)),
            self._matrix,
            above=-times.ravel() / longest,
        )
        try:
            answer = self._program.minimised(self._cost).x
        except TrajoptError:
            answer = None
        if answer is None:
            return states
        rise, fall = answer[: slack.size].reshape(slack.shape)
        return np.clip(states + (rise - fall) * units, lower, upper)

    def _model(self, states: Array, slack: Array) -> tuple[Array, Array]:
        """Return the least times, and their slopes with the rises and falls.

        Args:
            states: Where the model is made.
            slack: How far each state may rise and fall, `(2, *states.shape)`.

        Returns:
            The least times, `(segments, joints)`, and the slopes of a joint's times with the rise
            and the fall of its own states at the segment's ends, `(2 signs, 2 orders, 2 ends,
            segments, joints)`. Where the time is not convex, both slopes are their mean.
        """
        # a case is one state at one end of one segment, moved in all joints at once
        steps = _SIGNS * _DIFFERENCE_SHARE * slack[..., self._ends, :]
        sign, order, end, segment = np.nonzero(steps.any(axis=-1))
        step = steps[sign, order, end, segment]
        count = len(self._segments)
        numbers = np.concatenate([self._segments, segment])
        moved = states[:, self._ends][:, :, numbers]
        moved[order, end, np.arange(count, len(numbers))] += step

        minima = self._sections.minima(numbers, moved)
        times = minima[:count]
        change = minima[count:] - times[segment]
        slope = np.divide(change, step, out=np.zeros_like(step), where=step != 0)
        slopes = np.zeros_like(steps)
        slopes[sign, order, end, segment] = np.where(np.isnan(slope), 0.0, slope)
        up, down = slopes
        slopes = np.where(up < down, 0.5 * (up + down), slopes)
        return np.where(np.isnan(times), 0.0, times), slopes * _SIGNS


# --- the answer ---


def _solution(problem: Problem, sections: Sections, states: Array, history: History) -> Solution:
    try:
        motions = [*sections.motions(states)]
    except ArithmeticError as error:
        return Solution(Status.FAILED, message=str(error))
    trajectory = Trajectory.of_segments((own.lengths, own.coefficients) for own in motions)
    low, high = np.moveaxis(problem.limits.jerk, -1, 0)
    return Solution(
        Status.SOLVED,
        trajectory,
        _LOPSIDED if (-low != high).any() else "",
        evaluations=sections.evaluations,
        history=np.array(history) if history else None,
    )
