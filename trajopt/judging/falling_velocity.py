"""Velocity limits that fall towards a position limit, checked exactly.

A maker may allow less velocity near the ends of a joint's range (`arm_file.FallingVelocity`).
No planner keeps these limits yet, and no certificate counts them; here a motion is checked against
them (docs/mathematics.md, section 7). On a piece everything is a polynomial of time, so the worst
excess and the share of the time come from roots, not from samples.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.problem import FallingVelocity, Problem
from trajopt.core.trajectory import Trajectory

Array = NDArray[np.float64]

_NAMED_MAX = 6  # problems that are named one by one
EXCESS_ATOL = 1e-6
"""rad/s (m/s for a prismatic joint). An excess below it is rounding, and counts as kept."""


@dataclass(frozen=True)
class Excess:
    """By how much a motion is faster than velocity limits that fall towards position limits.

    Attributes:
        value: The largest excess, rad/s (m/s for a prismatic joint); 0 where there is none.
        joint: The joint with the largest excess, counted from 0.
        time: When it is largest, s.
        velocity: The joint's velocity then, rad/s.
        allowed: What the joint is allowed then, in the direction of its velocity, rad/s, `≥ 0`.
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
        trajectory: The motion, as it is: nothing is repaired or slowed down.
    """
    worst = Excess()
    intervals = [np.empty((2, 0))]
    for joint, limit in enumerate(limits):
        if limit is None:
            continue
        for side in _sides(limit, trajectory, joint):
            largest, too_fast = _on_side(side, joint, trajectory)
            worst = max(worst, largest, key=lambda found: found.value)
            intervals.append(too_fast)
    if worst.kept:
        return Excess()
    share = _total_length(np.hstack(intervals)) / trajectory.duration
    return Excess(worst.value, worst.joint, worst.time, worst.velocity, worst.allowed, share)


def caveats(problems: Iterable[Problem]) -> Iterator[str]:
    """Say of which problems the constant velocity limits are not all that the arm has."""
    names = [problem.name for problem in problems if problem.falling_velocity]
    if names:
        which = ", ".join(names[:_NAMED_MAX])
        if len(names) > _NAMED_MAX:
            which += f" and {len(names) - _NAMED_MAX} more"
        yield f"{which}: constant velocity limits; the arm allows less near its position limits."


@dataclass(frozen=True)
class _Side:
    """One joint's motion towards one end of its range, mirrored so that the end is the upper one.

    Attributes:
        sign: 1 for the upper end, -1 for the lower one.
        square: `2 d w`, where `w` is the distance to the end, `(degree + 1, pieces)`, rad²/s².
        velocity: `(degree, pieces)`, rad/s, positive towards the end.
        acceleration: `(degree − 1, pieces)`, rad/s².
    """

    limit: FallingVelocity
    sign: int
    square: Array
    velocity: Array
    acceleration: Array

    def over(self) -> Array:
        """`(v + o)² − 2 d w`: where `v > 0`, the joint is too fast where it is positive."""
        shifted = polynomials.plus(self.velocity, np.array([[self.limit.offset]]))
        return polynomials.plus(polynomials.product(shifted, shifted), -self.square)

    def only(self, pieces: NDArray[np.intp]) -> _Side:
        return _Side(
            self.limit,
            self.sign,
            self.square[:, pieces],
            self.velocity[:, pieces],
            self.acceleration[:, pieces],
        )

    def points(self) -> Array:
        """Where an excess can begin, end or be largest, on the unit interval, `(points, pieces)`.

        The excess `e = v + o − sqrt(2 d w)` has the derivative `a + d v / sqrt(2 d w)`. It vanishes
        only where `a² 2 d w = d² v²`. Where nothing is allowed the excess is `v`.
        """
        deceleration = self.limit.deceleration
        squared_velocity = polynomials.product(self.velocity, self.velocity)
        squared_acceleration = polynomials.product(self.acceleration, self.acceleration)
        slope = polynomials.product(squared_acceleration, self.square)
        functions = (
            self.over(),
            self.velocity,
            self.acceleration,
            polynomials.plus(self.square, np.array([[-(self.limit.offset**2)]])),
            polynomials.plus(slope, -(deceleration**2) * squared_velocity),
        )
        ends = np.array([[0.0], [1.0]]) * np.ones(self.velocity.shape[1])
        roots = [polynomials.unit_roots(function) for function in functions]
        return np.sort(np.nan_to_num(np.vstack([ends, *roots]), nan=0.0), axis=0)

    def allowed(self, points: Array) -> Array:
        """What the limit allows, rad/s, at points of the unit interval, `(points, pieces)`."""
        square = polynomials.evaluate(self.square[:, None], points)
        root = np.sqrt(np.maximum(square, 0.0))
        return np.maximum(root - self.limit.offset, 0.0)


def _sides(limit: FallingVelocity, trajectory: Trajectory, joint: int) -> Iterator[_Side]:
    position, velocity, acceleration = [trajectory.pieces(order)[..., joint] for order in range(3)]
    for sign, end in ((1, limit.high), (-1, limit.low)):
        distance = polynomials.plus(-sign * position, np.array([[sign * end]]))
        square = 2 * limit.deceleration * distance
        yield _Side(limit, sign, square, sign * velocity, sign * acceleration)


def _on_side(side: _Side, joint: int, trajectory: Trajectory) -> tuple[Excess, Array]:
    """The largest excess towards one end, and the intervals that are too fast, s, `(2, count)`."""
    over = polynomials.bernstein(side.over()).max(axis=0)
    towards = polynomials.bernstein(side.velocity).max(axis=0)
    pieces = np.flatnonzero((over > 0) & (towards > 0))
    if not len(pieces):
        return Excess(), np.empty((2, 0))
    side = side.only(pieces)
    points = side.points()
    allowed = side.allowed(points)
    velocity = polynomials.evaluate(side.velocity[:, None], points)
    found = velocity - allowed
    times = trajectory.breaks[pieces] + points * trajectory.lengths[pieces]
    worst = np.unravel_index(np.argmax(found), found.shape)
    largest = Excess(
        value=max(0.0, float(found[worst])),
        joint=joint,
        time=float(times[worst]),
        velocity=side.sign * float(velocity[worst]),
        allowed=float(allowed[worst]),
    )
    middles = (points[1:] + points[:-1]) / 2
    inside = polynomials.evaluate(side.velocity[:, None], middles) - side.allowed(middles)
    too_fast = inside > EXCESS_ATOL
    return largest, np.stack([times[:-1][too_fast], times[1:][too_fast]])


def _total_length(intervals: Array) -> float:
    """The length that intervals `(2, count)` cover together: where they overlap it counts once."""
    starts, ends = intervals[:, np.argsort(intervals[0])]
    covered = np.maximum.accumulate(np.concatenate([[0.0], ends[:-1]]))
    new = np.maximum(ends - np.maximum(starts, covered), 0.0)
    return float(new.sum())
