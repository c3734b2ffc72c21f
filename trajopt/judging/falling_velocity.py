"""Velocity limits that fall towards a position limit, checked exactly.

A maker may allow less velocity near the ends of a joint's range (`problem.FallingVelocity`).
Planners do not keep these limits, and certificates ignore them. This module checks a motion against
them (docs/mathematics.md, section 7). On a piece everything is a polynomial of time, so the worst
excess and its share of the time come from roots, not from samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.limits import FallingVelocity
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

MAX_NAMED = 6  # problems that a warning names
EXCESS_ATOL = 1e-6
"""rad/s (m/s for a prismatic joint). A smaller excess is rounding, and the limit counts as kept."""


@dataclass(frozen=True)
class Excess:
    """The worst excess over velocity limits that fall towards position limits.

    Attributes:
        value: The largest excess, rad/s (m/s for a prismatic joint); 0 if the limits are kept.
        joint: The joint with the largest excess, counted from 0.
        time: When it is largest, s.
        velocity: The joint's velocity then, rad/s.
        allowed: The velocity allowed then, in the direction of motion, rad/s, `≥ 0`.
        share: The share of the motion's time in which some joint is too fast, 0 to 1.
    """

    value: float = 0.0
    joint: int = 0
    time: float = 0.0
    velocity: float = 0.0
    allowed: float = 0.0
    share: float = 0.0

    @property
    def kept(self) -> bool:
        return self.value <= EXCESS_ATOL

    def as_dict(self) -> dict[str, float | int | bool]:
        """For JSON: SI units, joints count from 1."""
        return {**vars(self), "joint": self.joint + 1, "kept": self.kept}


def excess(limits: Sequence[FallingVelocity | None], trajectory: Trajectory) -> Excess:
    """Return the largest excess of a motion over falling velocity limits, and its share of time.

    Args:
        limits: One per joint, or None where a joint has no such limit.
        trajectory: The motion, which is neither repaired nor slowed down.
    """
    worst = Excess()
    intervals = [np.empty((2, 0))]
    for joint, limit in enumerate(limits):
        if limit is None:
            continue
        for sign in (1, -1):
            largest, too_fast = _on_side(limit, sign, joint, trajectory)
            worst = max(worst, largest, key=lambda found: found.value)
            intervals.append(too_fast)
    if worst.kept:
        return Excess()
    together = np.hstack(intervals)
    share = _total_length(together) / trajectory.duration
    return replace(worst, share=share)


def caveats(problems: Iterable[Problem]) -> Iterator[str]:
    """Name the problems whose arms have stricter velocity limits than the problem."""
    names = [problem.name for problem in problems if problem.falling_velocity]
    if names:
        which = ", ".join(names[:MAX_NAMED])
        if len(names) > MAX_NAMED:
            which += f" and {len(names) - MAX_NAMED} more"
        yield f"{which}: constant velocity limits; the arm allows less near its position limits."


def _on_side(
    limit: FallingVelocity, sign: int, joint: int, trajectory: Trajectory
) -> tuple[Excess, Array]:
    """The largest excess towards one end, and the intervals that are too fast, s, `(2, count)`.

    The motion is mirrored for the lower end (`sign` −1), so that the end is always the upper one.
    With `w` the distance to the end, the joint is too fast where `v > 0` and
    `(v + o)² − 2 d w > 0`.
    """
    motion = []
    for order in range(3):
        unit = trajectory.pieces(order)
        motion.append(sign * unit[..., joint])
    position, velocity, acceleration = motion
    end = limit.high if sign > 0 else -limit.low
    double = 2 * limit.deceleration
    square = -double * position
    square[-1] += double * end
    shifted = np.array(velocity)
    shifted[-1] += limit.offset
    over = polynomials.plus(polynomials.product(shifted, shifted), -square)

    # A piece is slow enough where a bound of the excess, or of the velocity, is not positive.
    highest_over = polynomials.bernstein(over).max(axis=0)
    fastest = polynomials.bernstein(velocity).max(axis=0)
    pieces = np.flatnonzero((highest_over > 0) & (fastest > 0))
    if not len(pieces):
        return Excess(), np.empty((2, 0))
    functions = [own[:, pieces] for own in (over, square, velocity, acceleration)]
    points = _points(limit, *functions)
    _, square, velocity, _ = functions

    def beyond(shares: Array) -> tuple[Array, Array]:
        """The excess and the velocity, rad/s, at points of the unit interval."""
        value = polynomials.evaluate(velocity[:, None], shares)
        under_root = polynomials.evaluate(square[:, None], shares)
        root = np.sqrt(np.maximum(under_root, 0.0))
        allowed = np.maximum(root - limit.offset, 0.0)
        return value - allowed, value

    found, speeds = beyond(points)
    times = trajectory.breaks[pieces] + points * trajectory.lengths[pieces]
    worst = np.unravel_index(np.argmax(found), found.shape)
    largest = float(found[worst])
    speed = float(speeds[worst])
    middles = (points[1:] + points[:-1]) / 2
    inside, _ = beyond(middles)
    too_fast = inside > EXCESS_ATOL
    begins = times[:-1]
    ends = times[1:]
    intervals = np.stack([begins[too_fast], ends[too_fast]])
    return Excess(
        value=max(0.0, largest),
        joint=joint,
        time=float(times[worst]),
        velocity=sign * speed,
        allowed=speed - largest,
    ), intervals


def _points(
    limit: FallingVelocity, over: Array, square: Array, velocity: Array, acceleration: Array
) -> Array:
    """Points of the unit interval where an excess can begin, end or be largest, `(points, pieces)`.

    The excess `e = v + o − sqrt(2 d w)` has the derivative `a + d v / sqrt(2 d w)`. It vanishes
    only where `a² 2 d w = d² v²`. Where nothing is allowed the excess is `v`.
    """
    braking = limit.deceleration * velocity
    left = polynomials.product(polynomials.product(acceleration, acceleration), square)
    right = polynomials.product(braking, braking)
    allowed = np.array(square)
    allowed[-1] -= limit.offset**2
    functions = (over, velocity, acceleration, allowed, polynomials.plus(left, -right))
    start = np.zeros((1, velocity.shape[1]))
    roots = [polynomials.unit_roots(function) for function in functions]
    points = np.vstack([start, start + 1.0, *roots])
    return np.sort(np.nan_to_num(points, nan=0.0), axis=0)


def _total_length(intervals: Array) -> float:
    """The length that intervals `(2, count)` cover together: where they overlap it counts once."""
    by_start = np.argsort(intervals[0])
    starts, ends = intervals[:, by_start]
    ended = np.insert(ends[:-1], 0, 0.0)
    covered = np.maximum.accumulate(ended)
    new = np.maximum(ends - np.maximum(starts, covered), 0.0)
    return float(new.sum())
