"""Bring joints that start beyond their limits within them, in the least time.

A joint may be measured at a velocity, or an acceleration, beyond its limit. No motion keeps every
limit from there. Each such joint first brakes alone, as fast as its limits of acceleration and jerk
allow, into a state from which it can keep its limits. Meanwhile the other joints end their
acceleration and go on. When the last joint is within its limits, a plan begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.demand import DEMANDS
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import KINDS, Limits
from trajopt.core.problem import Problem
from trajopt.core.rounding import KEPT_RTOL
from trajopt.core.trajectory import Trajectory

ON_CYCLE_SHARE = 0.95  # of the limits in a braking that is written on a cycle
JUDGED_CYCLE_S = 0.01


class Piece(NamedTuple):
    """A piece of one joint's motion: s, its first acceleration, rad/s², and its jerk, rad/s³."""

    length: float
    acceleration: float
    jerk: float


@dataclass(frozen=True)
class OneSide:
    """A state of one joint and its limits, mirrored so that upper limits count. SI units.

    Attributes:
        velocity, acceleration: The state.
        fastest, steepest: Upper limits of velocity and acceleration.
        braking: The lower limit of acceleration, as a positive number.
        easing, rising: Lower and upper limit of jerk, as positive numbers; may be infinite.
    """

    velocity: float
    acceleration: float
    fastest: float
    steepest: float
    braking: float
    easing: float
    rising: float

    @property
    def peak(self) -> float:
        """Return the velocity when the acceleration ends, as early as the jerk limit allows."""
        return self.velocity + max(self.acceleration, 0.0) ** 2 / (2 * self.easing)

    @property
    def brakes(self) -> list[Piece]:
        """Return how it comes within its upper limits in the least time; empty if it is there."""
        v, a = self.velocity, self.acceleration
        if self.peak <= self.fastest + KEPT_RTOL * abs(self.fastest):
            beyond = a - self.steepest * (1 + KEPT_RTOL) > 0
            return [Piece((a - self.steepest) / self.easing, a, -self.easing)] if beyond else []
        if np.isinf(self.easing):
            return [Piece((v - self.fastest) / self.braking, -self.braking, 0.0)]
        found = []
        if a < -self.braking:
            found.append(Piece((-self.braking - a) / self.rising, a, self.rising))
            v += (a - self.braking) / 2 * found[-1].length
            a = -self.braking
        ramp = (a + self.braking) / self.easing
        after = v + (a - self.braking) / 2 * ramp
        if after <= self.fastest:
            root = np.sqrt(max(a**2 + 2 * self.easing * (v - self.fastest), 0.0))
            found.append(Piece(max(a + float(root), 0.0) / self.easing, a, -self.easing))
        else:
            found.append(Piece(ramp, a, -self.easing))
            found.append(Piece((after - self.fastest) / self.braking, -self.braking, 0.0))
        return found


def covered(velocity: float, pieces: Sequence[Piece]) -> tuple[float, float]:
    """Return the time, s, and the way, rad, of pieces that begin at a velocity, rad/s."""
    t = way = 0.0
    for length, a, j in pieces:
        way += velocity * length + a * length**2 / 2 + j * length**3 / 6
        velocity += a * length + j * length**2 / 2
        t += length
    return t, way


@dataclass(frozen=True, eq=False)
class Braking:
    """A motion into the limits, and what is planned after it.

    Attributes:
        asked: The problem that begins beyond limits.
        motion: From the first waypoint until all joints are within their limits.
        problem: The whole problem: the place where the braking ends is its second waypoint, and
            the first segment has limits of velocity and acceleration as wide as the braking needs.
        rest: The problem after the braking.
        ways: Time, s, and way, rad, in which each joint comes within its limits, by its index.
    """

    asked: Problem
    motion: Trajectory
    problem: Problem
    rest: Problem
    ways: dict[int, tuple[float, float]]

    def problem_of(self, motion: Trajectory) -> Problem:
        """Return the problem by which a motion is judged that somebody else planned.

        Its second waypoint is where the motion is after the time of a braking with 95 % of the
        limits, rounded up to 0.01 s: until then the wider limits hold.
        """
        longest = brake_first(self.asked, JUDGED_CYCLE_S) or self
        until = min(longest.motion.duration, motion.duration)
        waypoints = longest.problem.waypoints.copy()
        waypoints[1] = np.clip(motion(until), *self.asked.limits.position.T)
        return replace(longest.problem, waypoints=waypoints)

    def joined(self, motion: Trajectory) -> Trajectory:
        """Return the whole motion, of the braking and a motion of `rest`."""
        first = self.motion
        rows = max(len(first.coefficients), len(motion.coefficients))
        padded = []
        for own in (first.coefficients, motion.coefficients):
            padded.append(np.zeros((rows, *own.shape[1:])))
            padded[-1][rows - len(own) :] = own
        lengths = np.concatenate([first.lengths, motion.lengths])
        breaks = np.append(0.0, np.cumsum(lengths))
        times = np.append(0.0, first.duration + motion.waypoint_times)
        times[-1] = breaks[-1]
        return Trajectory(breaks, np.concatenate(padded, axis=1), times, lengths)


def brake_first(problem: Problem, cycle: float = 0.0) -> Braking | None:
    """Return the braking of a problem that starts beyond limits; None if it starts within them.

    Velocities and accelerations count, and velocities to which an acceleration leads. From `rest`
    on every limit is kept; until there only those of jerk and position, and those of acceleration
    unless the start is beyond them.

    Args:
        problem: The problem.
        cycle: Control cycle, s, of a motion that is written: then the braking ends on a cycle, and
            leaves a controller that switches on cycles some of its limits, `1 - ON_CYCLE_SHARE`.

    Raises:
        InvalidInput: The braking takes longer than a given time, or leaves a position limit.
    """
    limits = problem.limits
    if limits.segments is not None:
        limits = limits.of_segments(np.arange(limits.segments)[:1]).in_all_segments()
    start = problem.route.start
    eased = limits
    for key in ("acceleration", "jerk"):
        share = ON_CYCLE_SHARE if cycle else 1.0
        eased = eased.with_limit(KINDS[key].of_numbers(share * limits.by_name()[key]))
    found = [_both_sides(limits, eased, *start, j) for j in range(problem.joints)]
    braking = {j: pieces for j, pieces in enumerate(found) if pieces}
    if not braking:
        return None
    v0 = start.velocity.tolist()
    ways = {j: covered(v0[j], pieces) for j, pieces in braking.items()}
    ends = max(t for t, _ in ways.values())
    if cycle:
        ends = cycle * np.ceil(ends / cycle - KEPT_RTOL)
    states = zip(problem.waypoints[0].tolist(), v0, start.acceleration.tolist(), strict=True)
    motion = Trajectory.joined(
        [
            _course(*state, pieces, eased.jerk[j].tolist(), ends)
            for j, (state, pieces) in enumerate(zip(states, found, strict=True))
        ],
        [0.0, ends],
    )
    _check(problem, motion)
    whole = _whole(problem, limits, motion)
    return Braking(problem, motion, whole, _rest(whole, limits, motion), ways)


def _check(problem: Problem, motion: Trajectory) -> None:
    """Refuse a braking that leaves position limits, or takes longer than a given time."""
    demand = problem.route.demand
    for key, given in (
        ("given_times, segment 1", float(demand("given_times")[0])),
        ("duration", float(demand("duration"))),
    ):
        if given and motion.duration >= given:
            right = f"more than the braking takes, {motion.duration:.6g} s"
            raise InvalidInput(key, right, value=given)
    low, high = problem.limits.position.T
    place = motion(motion.duration)
    beyond = np.maximum(place - high, low - place) > problem.rounding
    for j in np.flatnonzero(beyond).tolist():
        right = f"a state from which it brakes within limits.position: it gets to {place[j]:.6g}"
        value = float(problem.route.start.velocity[j])
        raise InvalidInput("start_velocity", f"{right} {problem.unit(j)}", value=value, joint=j)


def _both_sides(
    limits: Limits, eased: Limits, velocity: Array, acceleration: Array, j: int
) -> list[Piece]:
    """Return how a joint comes within its limits, from above or below, by those that are eased."""
    (slow, fast), (brake, steep) = limits.velocity[j].tolist(), eased.acceleration[j].tolist()
    ease, rise = eased.jerk[j].tolist()
    v, a = float(velocity[j]), float(acceleration[j])
    above = OneSide(v, a, fast, steep, -brake, -ease, rise).brakes
    below = OneSide(-v, -a, -slow, -brake, steep, rise, -ease).brakes
    mirrored = [Piece(t, -own, -jerk) for t, own, jerk in below]
    # beyond a velocity on one side and an acceleration on the other, the first takes both back
    return max(above, mirrored, key=lambda pieces: sum(piece.length for piece in pieces))


def _course(
    q: float, v: float, a: float, pieces: list[Piece], jerk_limits: Sequence[float], ends: float
) -> tuple[Array, Array]:
    """Return a joint's breaks and coefficients: it brakes, ends its acceleration, and goes on."""
    if pieces:
        t, own, jerk = pieces[-1]
        a = own + jerk * t
    ease, rise = jerk_limits
    jerk = rise if a < 0 else ease
    eased = [Piece(-a / jerk, a, jerk)] if np.isfinite(jerk) and a else []
    rows, breaks = [], [0.0]
    for length, own, rate in [*pieces, *eased, Piece(np.inf, 0.0, 0.0)]:
        t = min(length, ends - breaks[-1])
        if t > 0:
            rows.append([rate / 6, own / 2, v, q])
            q += v * t + own * t**2 / 2 + rate * t**3 / 6
            v += own * t + rate * t**2 / 2
            breaks.append(breaks[-1] + t)
    breaks[-1] = ends
    return np.array(breaks), np.array(rows).T


def _range(motion: Trajectory, order: int) -> tuple[Array, Array]:
    """Return bounds on the values of a derivative, `(joints,)` each: of Bernstein's polynomials.

    A motion on a control cycle is planned by such bounds too.
    """
    unit = motion.pieces(order)
    bounds = polynomials.bernstein(unit.reshape(len(unit), -1)).reshape(-1, motion.joints)
    return bounds.min(axis=0), bounds.max(axis=0)


def _whole(problem: Problem, limits: Limits, motion: Trajectory) -> Problem:
    """Return the problem with the braking as its first segment, whose limits are wide enough."""
    wide = {}
    for order, key in enumerate(("velocity", "acceleration"), start=1):
        low, high = limits.by_name()[key].T
        least, most = _range(motion, order)
        wide[key] = np.stack([np.minimum(low, least), np.maximum(high, most)], axis=-1)
    segments = problem.segments + 1
    own = problem.limits.of_segments(np.arange(segments).clip(1) - 1)
    for key, pairs in wide.items():
        table = np.array(np.broadcast_to(own.by_name()[key], (segments, *pairs.shape)))
        table[0] = pairs
        own = own.with_limit(KINDS[key].of_numbers(table))
    demands = {}
    for key, numbers in problem.demands.items():
        for axis, name in enumerate(DEMANDS[key].axes):
            if name != "joints":
                numbers = np.insert(numbers, int(name == "waypoints"), 0.0, axis)
        demands[key] = numbers
    if "given_times" in demands:
        demands["given_times"][:2] = motion.duration, demands["given_times"][1] - motion.duration
    if "least_times" in demands:
        demands["least_times"][1] = max(demands["least_times"][1] - motion.duration, 0.0)
    waypoints = np.insert(problem.waypoints, 1, motion(motion.duration), axis=0)
    return replace(problem, waypoints=waypoints, limits=own, demands=demands)


def _rest(whole: Problem, limits: Limits, motion: Trajectory) -> Problem:
    """Return the problem after the braking, in the state in which it ends."""
    last = whole.segments
    demands = {key: DEMANDS[key].part(own, 1, last) for key, own in whole.demands.items()}
    for key in ("least_duration", "duration"):
        if key in demands:
            demands[key] = np.maximum(demands[key] - motion.duration, 0.0)
    rates = [motion(motion.duration, order) for order in (1, 2)]
    demands["start_velocity"] = np.clip(rates[0], *limits.velocity.T)
    within = np.clip(rates[1], *limits.acceleration.T)
    demands["start_acceleration"] = np.where(limits.jerk_limited, within, 0.0)
    return replace(
        whole,
        name=f"{whole.name} after braking",
        waypoints=whole.waypoints[1:],
        limits=whole.limits.of_segments(np.arange(1, last)),
        demands=demands,
    )
