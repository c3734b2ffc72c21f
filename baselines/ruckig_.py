"""Ruckig, the open edition, on this machine only (Berscheid & Kröger 2021): point to point.

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
from baselines.linear_programs import LinearPrograms
from trajopt import polynomials
from trajopt.exceptions import InvalidInput
from trajopt.planner import Planner, backend, passing_once
from trajopt.problem import LIMIT_NAMES, Limits, Problem
from trajopt.solution import Solution, Status
from trajopt.trajectory import EPS, nearest

Array = NDArray[np.float64]

# One joint's breaks and coefficients, as `Trajectory.joined` takes them.
Part = tuple[Array, Array]
# Evaluations spent, and the best total by then, s.
History = list[tuple[int, float]]

_LOPSIDED = "Ruckig's jerk limit is symmetric: the tighter side was used"
# Relative: how far inside its limits a state at a waypoint stays.
_INSIDE_MARGIN = 1e-9
# Of the trust region: how far differences reach.
_PROBE_SHARE = 0.1
# Starts: parts of the mean velocity about a waypoint.
_MEAN_SHARES = (0.0, 1.0, 0.5, 1.5)
# Of the limits: how far random starts lie from the best.
_KICK_RADII = (0.1, 0.5, 0.02)
# Of the limits: the trust region at first and at last.
_START_RADIUS = 0.5
_LAST_RADIUS = 1e-5
# Relative: the smallest gain that is a step.
_GAIN_RTOL = 1e-7
# Times an end state: exactly opposite states at one place crash Ruckig 0.19.
_INWARDS = 1 - 1e-14
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
    """Ruckig through the waypoints, their velocities (and accelerations) improved from stopping."""

    evaluations: int = 8000  # Ruckig's sections, about 0.1 ms each with the search around them

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
    for joints without a jerk limit). A segment's `start` and `end` are such states at one waypoint,
    `(2, moving joints)`. `evaluations` counts the sections computed.
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
        self._inputs = self._sections(ruckig)
        # Units of the whole motion: its longest segment's time, each joint's range.
        self.longest_stop = max(units.time for units in self._units)
        speeds = np.ptp(self.waypoints, axis=0) / self.longest_stop
        self.state_units = np.stack([speeds, speeds / self.longest_stop])[:, None]
        self._success = (ruckig.Result.Working, ruckig.Result.Finished)
        self._error = ruckig.RuckigError
        self.evaluations = 0

    @property
    def at_rest(self) -> Array:
        return np.zeros((2, *self.waypoints.shape))

    def minima(self, k: int, starts: Array, ends: Array) -> Array:
        """Each joint's own least time for segment `k`, s; NaN where Ruckig refuses.

        Args:
            k: the segment's number, from 0.
            starts: states that it starts from, `(2, cases, moving joints)`.
            ends: states that it ends at, of the same shape.

        Returns:
            `(cases, moving joints)`.
        """
        refused = [np.nan] * len(self.moving)
        minima = []
        for section in self._between(k, starts, ends):
            if self._is_solved(k, *section):
                minima.append(self._trajectory.independent_min_durations)
            else:
                minima.append(refused)
        own = np.array(minima).reshape(-1, len(self.moving))
        return own * self._units[k].time

    def duration(self, k: int, start: Array, end: Array) -> float:
        """Time of segment `k` with all joints together; infinite if the states break a limit, s."""
        if not self._calculate(k, start, end, checked=True):
            return np.inf
        if not self._inside(k):
            return np.inf
        return self._time(k)

    def profiles(
        self,
        k: int,
        start: Array,
        end: Array,
    ) -> tuple[float, list[Part]]:
        """The duration of segment `k`, s, and every joint's `(breaks, cubics)` in its units."""
        if not self._calculate(k, start, end):
            raise ArithmeticError(f"Ruckig gave up on segment {k + 1}")
        return self._time(k), self._own_profiles()

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

    @property
    def unit_times(self) -> Array:
        """The unit of time of each segment, s."""
        return np.array([units.time for units in self._units])

    def _time(self, k: int) -> float:
        """Of segment `k`, just computed, s."""
        time: float = self._trajectory.duration
        return time * self._units[k].time

    def _own_profiles(self) -> list[Part]:
        """Every joint's `(breaks, cubics)` in the segment just computed, in its units."""
        duration = self._trajectory.duration
        profiles = self._trajectory.profiles[0]
        return [_cubics(profile, duration) for profile in profiles]

    def _rebuilt(self, k: int) -> list[Part]:
        """Every joint's motion in segment `k`, just computed, s and rad."""
        units = self._units[k]
        parts = []
        for joint, (breaks, cubics) in enumerate(self._own_profiles()):
            coefficients = units.in_radians(cubics, joint)
            coefficients[-1] += self.waypoints[k, joint]
            parts.append((breaks * units.time, coefficients))
        return parts

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

    def _calculate(
        self,
        k: int,
        start: Array,
        end: Array,
        *,
        checked: bool = False,
    ) -> bool:
        """Whether Ruckig solves segment `k`; `checked`, from states that keep their limits."""
        (section,) = self._between(k, start[:, None], end[:, None])
        return self._is_solved(k, *section, checked=checked)

    def _between(self, k: int, starts: Array, ends: Array) -> Iterator[tuple[list[float], ...]]:
        """Velocity and acceleration at both ends of each case, as Ruckig's input takes them."""
        units = self._units[k]
        states = [
            *units.states(starts),
            *units.states(ends * _INWARDS),
        ]
        return zip(*[state.tolist() for state in states], strict=True)

    def _is_solved(
        self,
        k: int,
        velocity: list[float],
        acceleration: list[float],
        target_velocity: list[float],
        target_acceleration: list[float],
        *,
        checked: bool = False,
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
        position = self.limits.position
        if not np.isfinite(position).any():
            return True
        coordinates = np.abs(self.waypoints)
        size = np.maximum(coordinates.max(axis=0), 1)
        slack = _POSITION_RTOL * size
        lowest, highest = position.T
        low = lowest - slack
        high = highest + slack
        for j, (breaks, coefficients) in enumerate(self._rebuilt(k)):
            if not _within(breaks, coefficients, low[j], high[j]):
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
    leaving = np.array(start_rates)[:, sections.moving]
    arriving = np.array(end_rates)[:, sections.moving]
    (minima,) = sections.minima(0, leaving[:, None], arriving[:, None])
    return sections.duration(0, leaving, arriving), minima


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
    programs = LinearPrograms()
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
    minima = _minima(sections, rest)
    times = np.array([np.nanmax(own) for own in minima])
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
    programs: LinearPrograms,
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
        trial = _proposed(sections, programs, states, radius)
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
    total = 0.0
    for k, (start, end) in _each_segment(states):
        total += sections.duration(k, start, end)
    return total


def _bounds(
    sections: Sections,
    states: Array,
    radius: float,
) -> tuple[Array, Array]:
    """The trust region around the states, inside their limits; ends, and no idle acceleration."""
    own = sections.limits
    limits = np.stack([own.velocity, own.acceleration])
    boxes = limits * (1 - _INSIDE_MARGIN)
    jerk_limited = np.isfinite(own.jerk).any(axis=1)
    boxes[1, ~jerk_limited] = 0
    # (order, 1, joints): velocity and acceleration
    low = boxes[:, None, :, 0]
    high = boxes[:, None, :, 1]
    reach = radius * np.minimum(high, -low)
    lower = np.maximum(states - reach, low)
    upper = np.minimum(states + reach, high)
    lower[:, [0, -1]] = 0
    upper[:, [0, -1]] = 0
    return lower, upper


def _proposed(
    sections: Sections,
    programs: LinearPrograms,
    states: Array,
    radius: float,
) -> Array:
    """The states that minimise the linear model within the trust region."""
    lower, upper = _bounds(sections, states, radius)
    above = upper - states
    below = states - lower
    times, up, down = _model(sections, states, above, below)
    segments, joints = times.shape

    # Rows: times + up·rise − down·fall ≤ τ, one per segment and joint; columns: rise, fall, τ.
    # The solver's tolerances are absolute, so states and times are in units of the whole motion.
    units = sections.state_units
    longest = sections.longest_stop
    own_segment = np.repeat(np.eye(segments), joints, axis=0)
    rises = (up * units).reshape(len(up), -1) / longest
    falls = (down * units).reshape(len(up), -1) / longest
    columns = [rises, -falls, -own_segment]
    matrix = np.concatenate(columns, axis=1)
    free = np.zeros(2 * states.size)
    cost = np.r_[free, np.ones(segments)]
    unbounded = np.full(segments, np.inf)
    room_above = above / units
    room_below = below / units
    highest = np.r_[room_above.ravel(), room_below.ravel(), unbounded]

    answer = programs.minimised(
        cost,
        matrix,
        -times.ravel() / longest,
        highest,
    )
    if answer is None:
        return states
    steps = answer[: 2 * states.size]
    rise, fall = steps.reshape(2, *states.shape)
    proposed = states + (rise - fall) * units
    return np.asarray(np.clip(proposed, lower, upper))


def _model(
    sections: Sections,
    states: Array,
    above: Array,
    below: Array,
) -> tuple[Array, Array, Array]:
    """Least times `(segments, joints)`, and their slopes upwards and downwards, a row for each.

    Where the slope upwards is the smaller one (a dent), both are their mean.
    """
    times = np.array(_minima(sections, states))
    up = _slopes(sections, states, times, above)
    down = _slopes(sections, states, times, -below)
    mean = 0.5 * (up + down)
    dent = up < down
    up = np.where(dent, mean, up)
    down = np.where(dent, mean, down)
    return np.nan_to_num(times), up, down


def _slopes(
    sections: Sections,
    states: Array,
    times: Array,
    room: Array,
) -> Array:
    """Differences of the least times towards one side, `(segments · joints, *states.shape)`."""
    _, count, joints = states.shape
    segments = count - 1
    slopes = np.zeros((segments, joints, *states.shape))
    own = np.arange(joints)
    steps = _PROBE_SHARE * room
    for k in range(segments):
        # one case for every state at either end that may move
        at_ends = _ends(steps, k)
        side, order = np.nonzero(at_ends.any(axis=2))
        case = np.arange(len(side))
        step = at_ends[side, order]
        moved = np.repeat(_ends(states, k)[:, :, None], len(case), axis=2)
        moved[side, order, case] += step
        change = sections.minima(k, *moved) - times[k]
        slope = np.divide(
            change,
            step,
            out=np.zeros_like(step),
            where=step != 0,
        )
        waypoint = k + side
        slopes[k, own, order[:, None], waypoint[:, None], own] = slope
    finite = np.nan_to_num(slopes)
    return finite.reshape(segments * joints, *states.shape)


def _minima(sections: Sections, states: Array) -> list[Array]:
    """Each segment's least times, `(joints,)` each."""
    minima = []
    for k, (start, end) in _each_segment(states):
        (own,) = sections.minima(k, start[:, None], end[:, None])
        minima.append(own)
    return minima


def _each_segment(states: Array) -> Iterator[tuple[int, Array]]:
    """Every segment's number and the states at its ends."""
    segments = states.shape[1] - 1
    for k in range(segments):
        yield k, _ends(states, k)


def _ends(states: Array, k: int) -> Array:
    """The states where segment `k` starts and ends: `(2, 2, joints)`."""
    both = states[:, k : k + 2]
    return both.swapaxes(0, 1)


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
        for k, (start, end) in _each_segment(states):
            duration, own = sections.profiles(k, start, end)
            durations.append(duration)
            profiles.append(own)
    except ArithmeticError as error:
        return Solution(Status.FAILED, message=str(error))
    passages = np.r_[0.0, np.cumsum(durations)]
    segments = []
    for k, clock in enumerate(clocks(passages, sections.unit_times)):
        fitted = sections.fitted(
            k,
            profiles[k],
            _ends(states, k),
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
