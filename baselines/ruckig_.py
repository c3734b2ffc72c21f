"""Ruckig, the open edition (Berscheid & Kröger 2021), and a search of ours around it.

Offline it takes no intermediate waypoints, so every segment is a section of its own, from one state
(position, velocity, acceleration) to the next with all joints arriving together. `RuckigStop` rests
at every waypoint; `RuckigVia` starts there and improves the states at the waypoints between.

Ruckig knows one jerk limit for both sides: an asymmetric one counts at its tighter side. It ignores
position limits; here every section is checked against them. With jerk unlimited it ignores
accelerations. Its tolerances are absolute, so every section has units of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from baselines import segment_units
from baselines.exact.rounded import Clock, assembled, clocks, through
from baselines.linear_programs import Entries, LinearPrograms
from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import LIMIT_NAMES, Limits, Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import EPS, nearest
from trajopt.planners.planner import Planner, backend, passing_once

Array = NDArray[np.float64]

# One joint's breaks and coefficients, as `Trajectory.joined` takes them.
Part = tuple[Array, Array]
# Of each case's segment, from 0.
Numbers = NDArray[np.intp]
# Evaluations spent, and the best total by then, s.
History = list[tuple[int, float]]

_LOPSIDED = "Ruckig's jerk limit is symmetric: the tighter side was used"
# Relative: how far inside its limits a state at a waypoint stays.
_INSIDE_MARGIN = 1e-9
# The directions of a rise and a fall.
_WAYS = np.array([1.0, -1.0])[:, None, None, None, None]
# Of the trust region: how far differences reach to either side.
_PROBES = 0.1 * _WAYS
# Starts: parts of the mean velocity about a waypoint.
_MEAN_SHARES = (0.0, 1.0, 0.5, 1.5)
# Of the limits: how far random starts lie from the best.
_KICK_RADII = (0.1, 0.5, 0.02)
# Of the limits: the trust region at first and at last.
_START_RADIUS = 0.5
_LAST_RADIUS = 1e-5
# Relative: the smallest gain that is a step.
_GAIN_RTOL = 1e-7
# Times the states at both ends: exactly opposite states at one place crash Ruckig 0.19.
_INWARDS = np.array([1.0, 1 - 1e-14])[:, None, None]
# Of the highest acceleration: jumps that are rounding, as the judge counts them.
_JUMPS_RTOL = 1e-11
# Of the highest jerk: what fitting a motion to rounded breaks may add, a third of it in duration.
_MENDED_JERK_RTOL = 1e-8
# Of the largest coordinate: what rounding may carry a position beyond its limit.
_POSITION_RTOL = 1e-12


@dataclass(frozen=True)
class RuckigStop(Planner):
    """Ruckig from waypoint to waypoint, stopping at each."""

    requires = ("ruckig",)
    knows = LIMIT_NAMES

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        sections = Sections(problem)
        return _solution(problem, sections, sections.at_rest, [])


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

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        sections = Sections(problem)
        states, history = improved(sections, self.evaluations)
        return _solution(problem, sections, states, history)


class Sections:
    """Ruckig on the segments of a problem (no two consecutive waypoints alike), moving joints only.

    `states` are `(2, waypoints, moving joints)`: velocity, rad/s, and acceleration, rad/s² (unused
    for joints without a jerk limit). `at_ends` are such states where segments start and end, of
    several cases: `(2, 2 ends, cases, moving joints)`. `unit_times` are the segments' units of
    time, s; `low` and `high` bound the states at every waypoint; `evaluations` counts the sections
    computed.
    """

    def __init__(self, problem: Problem) -> None:
        ruckig = backend("ruckig")
        self.moving = np.flatnonzero(problem.moving)
        self.waypoints = problem.waypoints[:, self.moving]
        self.limits = problem.limits.only(self.moving)
        joints = len(self.moving)
        self._solver = ruckig.Ruckig(joints)
        self._trajectory = ruckig.Trajectory(joints)
        self._units = segment_units.of_segments(Problem(self.waypoints, self.limits))
        self.unit_times = np.array([units.time for units in self._units])
        self._unit_lengths = np.array([units.lengths for units in self._units])
        self._inputs = self._sections(ruckig)
        # Units of the whole motion: its longest segment's time, each joint's range.
        self.longest_stop = float(self.unit_times.max())
        speeds = np.ptp(self.waypoints, axis=0) / self.longest_stop
        self.state_units = np.stack([speeds, speeds / self.longest_stop])[:, None]
        self.low, self.high = self._bounds()
        self._lowest, self._highest = self._positions()
        self._walled = np.isfinite(self.limits.position).any()
        self._success = (ruckig.Result.Working, ruckig.Result.Finished)
        self._error = ruckig.RuckigError
        self.evaluations = 0

    def _bounds(self) -> tuple[Array, Array]:
        """The lowest and highest states: inside limits, resting at both ends, not idly accelerated.

        Without a jerk limit Ruckig does not read a joint's acceleration.
        """
        own = self.limits
        limits = np.stack([own.velocity, own.acceleration])
        boxes = limits * (1 - _INSIDE_MARGIN)
        jerk_limited = np.isfinite(own.jerk).any(axis=1)
        boxes[1, ~jerk_limited] = 0
        low = self.at_rest
        high = self.at_rest
        low[:, 1:-1] = boxes[:, None, :, 0]
        high[:, 1:-1] = boxes[:, None, :, 1]
        return low, high

    def _positions(self) -> tuple[Array, Array]:
        """Each joint's lowest and highest position, but for rounding."""
        coordinates = np.abs(self.waypoints)
        size = np.maximum(coordinates.max(axis=0), 1)
        slack = _POSITION_RTOL * size
        lowest, highest = self.limits.position.T
        return lowest - slack, highest + slack

    @property
    def at_rest(self) -> Array:
        return np.zeros((2, *self.waypoints.shape))

    def minima(self, k: Numbers, at_ends: Array) -> Array:
        """Each joint's own least time, s; NaN where Ruckig refuses.

        Args:
            k: the segments' numbers, from 0, `(cases,)`.
            at_ends: the states that they start from and end at.

        Returns:
            `(cases, moving joints)`.
        """
        refused = [np.nan] * len(self.moving)
        minima = []
        for _, solved in self._calculated(k, at_ends):
            own = refused
            if solved:
                own = self._trajectory.independent_min_durations
            minima.append(own)
        return np.asarray(minima * self.unit_times[k, None])

    def durations(self, k: Numbers, at_ends: Array) -> list[float]:
        """Times with all joints together, s; infinite where the states break a limit.

        The arguments are those of `minima`.
        """
        durations = []
        for number, solved in self._calculated(k, at_ends, checked=True):
            duration = np.inf
            if solved and self._inside(number):
                duration = self._time(number)
            durations.append(duration)
        return durations

    def profiles(self, states: Array) -> Iterator[tuple[float, list[Part]]]:
        """Each segment's duration, s, and every joint's `(breaks, cubics)` in its units."""
        for k, solved in self._calculated(*_every_segment(states)):
            if not solved:
                raise ArithmeticError(f"Ruckig gave up on segment {k + 1}")
            yield self._time(k), self._own_profiles()

    def fitted(
        self,
        k: int,
        profiles: list[Part],
        ends: Array,
        clock: Clock,
    ) -> list[Part]:
        """The profiles of segment `k` over the breaks that a trajectory stores.

        A phase of a stiff jerk limit is so brief that its rounded length counts. Of such a joint
        acceleration is straight between the rounded breaks, and the waypoint is met; unless a
        phase is briefer still and would break the jerk limit.

        Returns:
            Every joint's stored breaks, s, and its displacement since the segment's start, rad.
        """
        units = self._units[k]
        (u, _), (w, b) = [units.states(state) for state in ends]
        target = self._inputs[k].target_position
        planned = [breaks for breaks, _ in profiles]
        parts = []
        for j, stored in enumerate(clock.shared(planned)):
            breaks, cubics = profiles[j]
            mended = None
            levels = np.r_[2 * cubics[1], b[j]]
            if _stiff(levels, cubics, clock):
                kept = nearest(breaks, clock.elapsed(stored))
                mended = through(
                    clock.lengths(stored),
                    levels[kept],
                    (u[j], w[j]),
                    target[j],
                )
            if mended is None or _harder(mended, cubics):
                stored = clock.stored(breaks)
                mended = cubics
            parts.append((stored, units.in_radians(mended, j)))
        return parts

    def _time(self, k: int) -> float:
        """Of segment `k`, just computed, s."""
        time: float = self._trajectory.duration
        return time * self._units[k].time

    def _own_profiles(self) -> list[Part]:
        """Every joint's `(breaks, cubics)` in the segment just computed, in its units."""
        duration = self._trajectory.duration
        profiles = self._trajectory.profiles[0]
        return [_cubics(profile, duration) for profile in profiles]

    def _rebuilt(self, k: int, joint: int) -> Part:
        """A joint's motion in segment `k`, just computed, s and rad."""
        units = self._units[k]
        profile = self._trajectory.profiles[0][joint]
        breaks, cubics = _cubics(profile, self._trajectory.duration)
        coefficients = units.in_radians(cubics, joint)
        coefficients[-1] += self.waypoints[k, joint]
        return breaks * units.time, coefficients

    def _sections(self, ruckig: Any) -> list[Any]:
        """Ruckig's input for every segment in its units, but for the states at its ends."""
        inputs = []
        ways = np.diff(self.waypoints, axis=0)
        for way, units in zip(ways, self._units, strict=True):
            given = _input(ruckig, units.limits(self.limits))
            target = way / units.lengths
            given.target_position = target.tolist()
            inputs.append(given)
        return inputs

    def _calculated(
        self,
        k: Numbers,
        at_ends: Array,
        *,
        checked: bool = False,
    ) -> Iterator[tuple[int, bool]]:
        """Each case's segment, and whether Ruckig solves it, which has just been computed then.

        `checked`, from states that keep their limits.
        """
        time = self.unit_times[k, None]
        lengths = self._unit_lengths[k]
        states = segment_units.states_in(at_ends * _INWARDS, time, lengths)
        velocity, acceleration = [state.tolist() for state in states]
        for number, *section in zip(k.tolist(), *velocity, *acceleration, strict=True):
            yield number, self._is_solved(number, *section, checked=checked)

    def _is_solved(
        self,
        k: int,
        velocity: list[float],
        target_velocity: list[float],
        acceleration: list[float],
        target_acceleration: list[float],
        *,
        checked: bool,
    ) -> bool:
        """Whether Ruckig solves segment `k` between states in its units."""
        given = self._inputs[k]
        given.current_velocity = velocity
        given.current_acceleration = acceleration
        given.target_velocity = target_velocity
        given.target_acceleration = target_acceleration
        self.evaluations += 1
        try:
            if checked and not self._solver.validate_input(given, True, True):
                return False
            result = self._solver.calculate(given, self._trajectory)
            return result in self._success
        except (self._error, ValueError):  # a result code that its own enumeration lacks
            return False

    def _inside(self, k: int) -> bool:
        """Whether segment `k`, just computed, keeps the position limits."""
        if not self._walled:
            return True
        # No joint gets beyond where it would turn at top speed: (q0 + q1 ± V T)/2.
        top_speed = np.abs(self.limits.velocity).max(axis=1)
        both = self.waypoints[k] + self.waypoints[k + 1]
        reach = top_speed * self._time(k)
        low = (both - reach) / 2 < self._lowest
        high = (both + reach) / 2 > self._highest
        for j in np.flatnonzero(low | high).tolist():
            motion = self._rebuilt(k, j)
            if not _within(*motion, self._lowest[j], self._highest[j]):
                return False
        return True


def section(
    limits: Limits,
    start: tuple[Array, Array, Array],
    end: tuple[Array, Array, Array],
) -> tuple[float, Array]:
    """One section between two states (position, velocity, acceleration; each `(joints,)`).

    Returns its duration with all joints arriving together, and the least time of each joint that
    moves, s. Infinite and NaN where Ruckig refuses. Raises `InvalidInput` where no joint moves.
    """
    start_position, *start_rates = start
    end_position, *end_rates = end
    waypoints = np.array([start_position, end_position])
    sections = Sections(Problem(waypoints, limits))
    by_waypoint = np.array([start_rates, end_rates])
    states = by_waypoint[:, :, sections.moving].swapaxes(0, 1)
    (minima,) = sections.minima(*_every_segment(states))
    (duration,) = sections.durations(*_every_segment(states))
    return duration, minima


def improved(sections: Sections, evaluations: int) -> tuple[Array, History]:
    """Better states at the waypoints than rest, and the best total by evaluations spent.

    Descends from rest, from the waypoints' mean velocities, and then from random steps away from
    the best so far (always the same ones), while the budget lasts.
    """
    best = sections.at_rest
    shortest = _total(sections, best)
    history = [(sections.evaluations, shortest)]
    refused = not np.isfinite(shortest)
    inner = best[:, 1:-1]
    if refused or inner.size == 0:
        return best, history
    generator = np.random.default_rng(0)
    programs = StepPrograms(sections)
    guesses = _guesses(sections)
    while sections.evaluations < evaluations:
        radius = generator.choice(_KICK_RADII)
        lower, upper = _bounds(sections, best, radius)
        start = generator.uniform(lower, upper)
        if guesses:
            start = guesses.pop(0)
        states, total = _descended(sections, programs, start, evaluations)
        if total < shortest:
            best = states
            shortest = total
            history.append((sections.evaluations, shortest))
    return best, history


def _guesses(sections: Sections) -> list[Array]:
    """Rest, and shares of the mean velocity about each waypoint if one stops at its neighbours."""
    rest = sections.at_rest
    minima = sections.minima(*_every_segment(rest))
    times = np.nanmax(minima, axis=1)
    waypoints = sections.waypoints
    # v_k = (q_(k+1) − q_(k−1)) / (T_k + T_(k+1))
    ways = waypoints[2:] - waypoints[:-2]
    spans = times[1:] + times[:-1]
    means = sections.at_rest
    means[0, 1:-1] = ways / spans[:, None]
    lower, upper = _bounds(sections, rest, 1.0)
    guesses = []
    for share in _MEAN_SHARES:
        guess = np.clip(share * means, lower, upper)
        guesses.append(guess)
    return guesses


def _descended(
    sections: Sections,
    programs: StepPrograms,
    states: Array,
    evaluations: int,
) -> tuple[Array, float]:
    """A local optimum and its total, by a sequential linear programme.

    The total is `Σ_k max_j τ_kj`, and a joint's own least time `τ_kj` depends on its own states at
    the segment's ends only, so one section gives the differences of all joints. The linear model's
    steps count only where the measured total falls; elsewhere the trust region shrinks, and the
    differences with it.
    """
    best = _total(sections, states)
    radius = _START_RADIUS
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
    """The duration of all segments, s."""
    return sum(sections.durations(*_every_segment(states)))


def _every_segment(states: Array) -> tuple[Numbers, Array]:
    """All segments' numbers, and the states at their ends."""
    _, waypoints, _ = states.shape
    k = np.arange(waypoints - 1)
    both_ends = np.array([k, k + 1])
    return k, states[:, both_ends]


def _bounds(
    sections: Sections,
    states: Array,
    radius: float,
) -> tuple[Array, Array]:
    """The trust region around the states."""
    reach = radius * np.minimum(sections.high, -sections.low)
    lower = np.maximum(states - reach, sections.low)
    upper = np.minimum(states + reach, sections.high)
    return lower, upper


class StepPrograms:
    """The linear programs that propose steps.

    Rows, one per segment and joint: times + up·rise − down·fall ≤ τ. Variables: the rise of every
    state, its fall, and every segment's τ. The solver's tolerances are absolute, so states and
    times are in units of the whole motion.
    """

    def __init__(self, sections: Sections) -> None:
        self._sections = sections
        self._programs = LinearPrograms()
        rest = sections.at_rest
        self._segments, _ = _every_segment(rest)
        # the waypoints at both ends of every segment, `(2, segments)`
        self._ends = np.stack([self._segments, self._segments + 1])
        free = np.zeros(2 * rest.size)
        taken = np.ones(len(self._segments))
        self._cost = np.concatenate([free, taken])

        # in a segment's and joint's row: the states at both ends of the segment, and its τ
        variables = np.arange(free.size)
        both_ways = variables.reshape(2, *rest.shape)
        at_ends = both_ways[..., self._ends, :]
        *_, segments, joints = at_ends.shape
        row = np.arange(segments * joints)
        by_joint = row.reshape(segments, joints)
        own_row = np.broadcast_to(by_joint, at_ends.shape)
        time = free.size + row // joints
        rows = _raveled(own_row, row)
        columns = _raveled(at_ends, time)
        self._row_by_row = np.argsort(rows, kind="stable")
        self._rows = rows[self._row_by_row]
        self._columns = columns[self._row_by_row]

    def proposed(self, states: Array, radius: float) -> Array:
        """The states that minimise the linear model within the trust region."""
        sections = self._sections
        lower, upper = _bounds(sections, states, radius)
        above = upper - states
        below = states - lower
        room = np.stack([above, below])
        times, slopes = self._model(states, room)

        units = sections.state_units
        longest = sections.longest_stop
        scaled = slopes * units[:, None] / longest
        less_time = np.full(times.size, -1.0)
        values = _raveled(scaled, less_time)
        matrix = Entries(
            self._rows,
            self._columns,
            values[self._row_by_row],
        )
        above_rows = -times.ravel() / longest
        unbounded = np.full(len(times), np.inf)
        highest = _raveled(room / units, unbounded)
        answer = self._programs.minimised_sparse(
            self._cost,
            matrix,
            above_rows,
            highest,
        )
        if answer is None:
            return states
        steps = answer[: room.size]
        rise, fall = steps.reshape(room.shape)
        proposed = states + (rise - fall) * units
        return np.asarray(np.clip(proposed, lower, upper))

    def _model(self, states: Array, room: Array) -> tuple[Array, Array]:
        """The least times, and by how much they grow with the rises and falls.

        Args:
            states: where the model is made.
            room: how far each state may rise and fall, `(2, *states.shape)`.

        Returns:
            The least times, `(segments, joints)`, and what a joint's grows by with the rise and the
            fall of its own states at the segment's ends, `(2 ways, 2 orders, 2 ends, segments,
            joints)`. Where the slope upwards is the smaller one (a dent), both are their mean.
        """
        # a case is one state at one end of one segment, moved in all joints at once
        steps = _PROBES * room[..., self._ends, :]
        way, order, end, segment = np.nonzero(steps.any(axis=-1))
        step = steps[way, order, end, segment]
        numbers = np.concatenate([self._segments, segment])
        count = len(self._segments)
        case = np.arange(count, len(numbers))
        at_ends = states[:, self._ends]
        moved = at_ends[:, :, numbers]
        moved[order, end, case] += step

        minima = self._sections.minima(numbers, moved)
        times = minima[:count]
        change = minima[count:] - times[segment]
        slope = np.divide(
            change,
            step,
            out=np.zeros_like(step),
            where=step != 0,
        )
        slope[np.isnan(slope)] = 0
        slopes = np.zeros_like(steps)
        slopes[way, order, end, segment] = slope

        up, down = slopes
        mean = 0.5 * (up + down)
        slopes = np.where(up < down, mean, slopes)
        refused = np.isnan(times)
        return np.where(refused, 0, times), slopes * _WAYS


def _raveled(*arrays: NDArray[Any]) -> NDArray[Any]:
    return np.concatenate([array.ravel() for array in arrays])


def _input(ruckig: Any, limits: Limits) -> Any:
    given = ruckig.InputParameter(limits.joints)
    given.min_velocity, given.max_velocity = limits.velocity.T.tolist()
    given.min_acceleration, given.max_acceleration = limits.acceleration.T.tolist()
    tighter = np.abs(limits.jerk).min(axis=1)
    given.max_jerk = tighter.tolist()
    return given


def _phases(profile: Any) -> Iterator[tuple[float, list[float]]]:
    """Every phase that takes time: its duration and its cubic."""
    for part in (profile.brake, profile, profile.accel):
        states = zip(
            part.t,
            part.j,
            part.a,
            part.v,
            part.p,
            strict=False,
        )
        for t, j, a, v, p in states:
            if t > 0:
                # q(t) = p + v t + a t²/2 + j t³/6
                yield t, [j / 6, a / 2, v, p]


def _cubics(profile: Any, time: float) -> Part:
    """One joint's `(breaks, coefficients)` over a section of that time."""
    phases = list(_phases(profile))
    if not phases:
        line = [0.0, 0.0, profile.vf, profile.pf]
        phases = [(time, line)]
    durations = [t for t, _ in phases]
    cubics = [cubic for _, cubic in phases]
    breaks = np.r_[0.0, np.cumsum(durations)]
    breaks[-1] = time
    return breaks, np.array(cubics).T


def _stiff(acceleration: Array, cubics: Array, clock: Clock) -> bool:
    """Whether acceleration changes by more than rounding while its breaks are rounded."""
    rounding = EPS * clock.end / clock.unit
    jerk = 6 * np.abs(cubics[0])
    jumps = jerk.sum() * rounding
    return bool(jumps > _JUMPS_RTOL * np.abs(acceleration).max())


def _harder(mended: Array, cubics: Array) -> bool:
    """Whether the mended motion has more jerk than its profile, beyond what rounding may cost."""
    highest = np.abs(mended[0]).max()
    allowed = np.abs(cubics[0]).max() * (1 + _MENDED_JERK_RTOL)
    return bool(highest > allowed)


def _within(
    breaks: Array,
    coefficients: Array,
    low: float,
    high: float,
) -> bool:
    """Whether one joint's positions lie in `[low, high]`: by their bounds, or by their extremes."""
    unit = polynomials.stretched(coefficients, np.diff(breaks))
    bounds = polynomials.bernstein(unit)
    if low <= bounds.min() and bounds.max() <= high:
        return True
    points = polynomials.critical_points(unit)
    extremes = polynomials.evaluate(unit[:, None], points)
    return bool(low <= extremes.min() and extremes.max() <= high)


def _solution(
    problem: Problem,
    sections: Sections,
    states: Array,
    history: History,
) -> Solution:
    durations = []
    profiles = []
    try:
        for duration, own in sections.profiles(states):
            durations.append(duration)
            profiles.append(own)
    except ArithmeticError as error:
        return Solution(Status.FAILED, message=str(error))
    by_waypoint = states.swapaxes(0, 1)
    passages = np.r_[0.0, np.cumsum(durations)]
    segments = []
    for k, clock in enumerate(clocks(passages, sections.unit_times)):
        fitted = sections.fitted(
            k,
            profiles[k],
            by_waypoint[k : k + 2],
            clock,
        )
        segments.append(fitted)
    message = ""
    low, high = problem.limits.jerk.T
    if (-low != high).any():
        message = _LOPSIDED
    table = None
    if history:
        table = np.array(history)
    return Solution(
        Status.SOLVED,
        assembled(problem, passages, segments),
        message,
        evaluations=sections.evaluations,
        history=table,
    )
