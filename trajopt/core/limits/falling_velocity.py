"""Velocity limits that fall towards the ends of a joint's range, as Franka's robots have them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits.fields import FieldsLimit, Quantity
from trajopt.core.limits.limit import Interval, Use, where
from trajopt.core.limits.rows import JointState, Row, positive
from trajopt.core.trajectory import Trajectory

if TYPE_CHECKING:
    from trajopt.core.problem import Problem

RESTING_RTOL = 1e-9
"""A velocity below this share of the highest that the limit allows anywhere counts as rest."""

BLOCKED_RTOL = 1e-6
"""A waypoint counts as unreachable if it lies at least this share of the joint's range beyond the
last position from which the joint may move towards the end. A nearer waypoint could be reached in
some minutes at the velocity that counts as rest."""

# Width of the rounded corner of `max(0, v + o)`, relative to the offset, and to the largest
# velocity that the limit allows at any position.
_CORNER_OF_OFFSET = 1e-3
_CORNER_OF_TOP = 1e-7
_MAX_CUTS = 50  # each is a Newton step; four or five are enough
_CUT_RTOL = 1e-14
_SHOWN_USE = 10.0  # largest use in figures


@dataclass(frozen=True, eq=False)
class FallingVelocity(FieldsLimit):
    """A velocity limit that falls to zero towards the ends of a joint's range.

    The joint at `q` may move upwards no faster than `max(0, sqrt(2 d max(0, high − q)) − o)`, and
    downwards no faster than `max(0, sqrt(2 d max(0, q − low)) − o)`. This is Franka's form
    (libfranka, `include/franka/rate_limiting.h`; `<position_based_velocity_limits>` in a URDF).

    The use is the velocity over the allowed velocity at that position. A dilation by `k` divides it
    by `k`, since positions stay as they are. Where no velocity is allowed the use is infinite, and
    no dilation helps (docs/mathematics.md, section 9).

    Attributes:
        numbers: `o` in rad/s, `d` in rad/s², `low` and `high` in rad (m for a prismatic joint),
            `(joints, 4)`; a row of NaN is a joint without such a limit. The range may differ from
            the position limits.
    """

    key = "falling_velocity"
    short = "fall."
    forgiven = True
    separate = True

    fields = (
        Quantity("offset", length=1, time=-1, widens=1, none=0.0),
        Quantity("deceleration", length=1, time=-2, widens=2),
        Quantity("position", length=1, pair=True),
    )

    def __post_init__(self) -> None:
        offset, deceleration, low, high = self.numbers.T
        limited = ~np.isnan(self.numbers).all(axis=1)
        right = (offset >= 0) & (offset < np.inf)
        _refuse("offset", "a number from 0", offset, limited & ~right)
        right = (deceleration > 0) & (deceleration < np.inf)
        _refuse("deceleration", "a positive number", deceleration, limited & ~right)
        right = (low < high) & np.isfinite(low) & np.isfinite(high)
        pairs = self.numbers[:, 2:]
        _refuse("position", "a finite range, lower below upper", pairs, limited & ~right)
        super().__post_init__()

    @classmethod
    def unlimited(cls, numbers: Array) -> Bools:
        """Return which joints have an infinite deceleration: these have no such limit."""
        return np.asarray(numbers[:, 1] == np.inf)

    def rows(self, at: JointState) -> Iterator[Row]:
        """Yield `max(0, v + o)² ≤ 2 d w` towards both ends of each range.

        Where the joint may only leave an end, its velocity towards that end is 0.
        """
        for joint in np.flatnonzero(self.bounds).tolist():
            q, v = at.q[joint], at.v[joint]
            offset, deceleration, low, high = self.numbers[joint].tolist()
            top = np.sqrt(2 * deceleration * (high - low))
            corner = max(_CORNER_OF_OFFSET * offset, _CORNER_OF_TOP * float(top))
            above = positive(v + offset, corner) ** 2 - 2 * deceleration * (high - q)
            below = positive(offset - v, corner) ** 2 - 2 * deceleration * (q - low)
            yield Row(above, high=0.0, leaving=Row(v, high=0.0))
            yield Row(below, high=0.0, leaving=Row(v, low=0.0))

    def path_rows(self, at: JointState) -> Iterator[Row]:
        """Yield the velocity between those that are allowed at the position."""
        for joint in np.flatnonzero(self.bounds).tolist():
            offset, deceleration, low, high = self.numbers[joint].tolist()
            upwards, downwards = (
                np.maximum(0.0, np.sqrt(2 * deceleration * np.maximum(0.0, room)) - offset)
                for room in (high - at.q[joint], at.q[joint] - low)
            )
            yield Row(at.v[joint], -downwards, upwards)

    def worst(self, motion: Trajectory) -> Use:
        sides = self._sides(motion)
        if not np.isfinite(sides.rounding).all():
            return Use(np.nan, int(sides.joints[0]), 0.0)
        best = _at_ends(sides, motion)
        # A piece's use is at most that of its highest velocity at its smallest distance.
        fastest = polynomials.bernstein(sides.velocity).max(axis=0)
        nearest = polynomials.bernstein(sides.distance).min(axis=0)
        promising = np.nonzero(sides.use(fastest, nearest) > best.value)
        if not len(promising[0]):
            return best
        found = _cut(sides.of(promising), promising, best.value, motion)
        return found if found.value > best.value else best

    def slack(self, waypoints: Array) -> Array:
        """Return each waypoint's distance, rad, from the zones without allowed motion.

        In the last `o² / (2 d)` before an end of its range a joint may not move towards that end.
        The distances are from the upper and the lower zone, `(2, waypoints, joints)`; below 0
        inside, NaN for a joint without the limit.
        """
        offset, deceleration, low, high = self.numbers.T
        blocked = offset**2 / (2 * deceleration)
        return np.stack([high - blocked - waypoints, waypoints - low - blocked])

    def infeasible(self, problem: Problem) -> str | None:
        """Return a sentence about a waypoint that no motion reaches under this limit, or None.

        Such a waypoint is in the last `o² / (2 d)` before an end, and the joint comes from farther
        away. A joint that starts there may leave.
        """
        slack = self.slack(problem.waypoints)
        farthest = np.maximum.accumulate(slack, axis=1)
        way = np.minimum(farthest, 0.0) - slack  # towards the end, where that is not allowed
        low, high = self.numbers[:, 2:].T
        found = np.argwhere(way > BLOCKED_RTOL * (high - low))
        if not len(found):
            return None
        side, waypoint, joint = found[np.argmin(found[:, 1])].tolist()
        offset, deceleration, *ends = self.numbers[joint].tolist()
        unit = problem.unit(joint)
        blocked = offset**2 / (2 * deceleration)
        place = f"waypoint {waypoint + 1} of {problem.joint_labels[joint]}"
        at = f"{problem.waypoints[waypoint, joint]:.6g} {unit}"
        return (
            f"{place}, {at}, is out of reach: its falling velocity limit allows no motion towards "
            f"{ends[1 - side]:.6g} {unit} in the last {blocked:.3g} {unit} before it"
        )

    def flaw(self, use: Use, tolerated: Array, problem: Problem) -> str | None:
        if use.value < np.inf:
            return None
        return (
            f"{where(use, problem)}: moves where its falling velocity limit allows no motion, "
            "whatever the dilation"
        )

    def active(self, motion: Trajectory, share: float) -> Iterator[Interval]:
        """Yield where `v > share (sqrt(2 d w) − o)` and the joint moves towards the end."""
        sides = self._sides(motion)
        moving = np.nonzero(polynomials.bernstein(sides.velocity).max(axis=0) > sides.resting)
        own = sides.of(moving)
        knots = _knots(own, own.over(share), own.allowing)
        middles = (knots[1:] + knots[:-1]) / 2
        found = own.use_at(middles) > share
        for row, i in np.argwhere(found & (knots[1:] > knots[:-1])):
            _, piece, _ = (int(index[i]) for index in moving)
            start, end = motion.breaks[piece] + knots[[row, row + 1], i] * motion.lengths[piece]
            yield Interval(int(own.joints[i]), float(start), float(end))

    def along(self, motion: Trajectory, times: Array) -> Mapping[int | None, Array]:
        q, v = motion(times), motion(times, 1)
        found: dict[int | None, Array] = {}
        for joint in np.flatnonzero(self.bounds).tolist():
            offset, deceleration, low, high = self.numbers[joint]
            resting = _resting(self.numbers[joint])
            up = _use(v[:, joint], high - q[:, joint], offset, deceleration, resting)
            down = _use(-v[:, joint], q[:, joint] - low, offset, deceleration, resting)
            found[joint] = np.minimum(np.maximum(up, down), _SHOWN_USE)
        return found

    def velocities(self, joint: int, lowest: Array, highest: Array) -> tuple[Array, Array]:
        if not self.bounds[joint]:
            return super().velocities(joint, lowest, highest)
        offset, deceleration, low, high = self.numbers[joint]
        up, down = (
            np.maximum(np.sqrt(2 * deceleration * np.maximum(distance, 0.0)) - offset, 0.0)
            for distance in (high - lowest, highest - low)
        )
        return -down, up

    def edges(self, motion: Trajectory, times: Array) -> Mapping[tuple[int, int], Array]:
        found: dict[tuple[int, int], Array] = {}
        for joint in np.flatnonzero(self.bounds).tolist():
            offset, deceleration, low, high = self.numbers[joint]
            q = motion(times)[:, joint]
            distances = np.maximum([q - low, high - q], 0.0)
            down, up = np.maximum(np.sqrt(2 * deceleration * distances) - offset, 0.0)
            found[1, joint] = np.array([-down, up])
        return found

    def _sides(self, motion: Trajectory) -> _Sides:
        """Return each limited joint's motion towards the upper and the lower end of its range."""
        joints = np.flatnonzero(self.bounds)
        own = self.numbers[joints]
        offset, deceleration, low, high = own.T
        position, velocity, acceleration = (motion.pieces(n)[..., joints] for n in range(3))
        above = -position
        above[-1] += high
        below = np.array(position)
        below[-1] -= low
        signs = np.array([1.0, -1.0])[:, None, None]
        of_each = (offset, deceleration, _resting(own), joints)
        shape = (2, *velocity.shape[1:])
        return _Sides(
            np.stack([above, below], axis=1),
            signs * velocity[:, None],
            signs * acceleration[:, None],
            *(np.broadcast_to(values, shape) for values in of_each),
        )

    def of_joint(self, joint: int, problem: Problem) -> str:
        if not self.bounds[joint]:
            return "–"
        offset, deceleration, low, high = (f"{value:.6g}" for value in self.numbers[joint])
        unit = problem.unit(joint, 1)
        return f"√(2 · {deceleration} · w) − {offset} {unit}, w to {low} or {high}"

    def unit(self, problem: Problem) -> str:
        units = [problem.shared_unit(order) for order in (1, 2, 0, 0)]
        return ", ".join(units)


class _Sides(NamedTuple):
    """Pieces of a motion seen from one end of a joint's range, and the limit there.

    Attributes:
        distance: coefficients of the distance `w` from the end, rad, `(degree + 1, …)`.
        velocity: coefficients of the velocity towards the end, rad/s.
        acceleration: coefficients of the acceleration towards the end, rad/s².
        offset, deceleration: the limit's `o` and `d`, `(…)`.
        resting: the velocity that counts as rest, rad/s, `(…)`.
        joints: index of each piece's joint, `(…)`.
    """

    distance: Array
    velocity: Array
    acceleration: Array
    offset: Array
    deceleration: Array
    resting: Array
    joints: Indices

    @property
    def rounding(self) -> Array:
        """Return the rounding error of a distance, rad, `(…)`."""
        return polynomials.evaluation_rounding(self.distance)

    def of(self, index: tuple[Any, ...]) -> _Sides:
        """Return some of the pieces."""
        return _Sides(
            distance=self.distance[:, *index],
            velocity=self.velocity[:, *index],
            acceleration=self.acceleration[:, *index],
            offset=self.offset[index],
            deceleration=self.deceleration[index],
            resting=self.resting[index],
            joints=self.joints[index],
        )

    def use(self, velocity: Array, distance: Array) -> Array:
        """Return the use at these velocities and distances, with the rounding of the distance."""
        farther = distance + self.rounding
        return _use(velocity, farther, self.offset, self.deceleration, self.resting)

    def use_at(self, points: Array) -> Array:
        """Return the use at points of the unit interval, `(points, …)`."""
        velocity = polynomials.evaluate(self.velocity[:, None], points)
        distance = polynomials.evaluate(self.distance[:, None], points)
        return self.use(velocity, distance)

    @property
    def allowing(self) -> Array:
        """Return the polynomial `2 d w − o²`, positive where some velocity is allowed."""
        found = 2 * self.deceleration * self.distance
        found[-1] -= self.offset**2
        return found

    def over(self, share: float) -> Array:
        """Return `(v/share + o)² − 2 d w`, positive where `v > 0` uses more than `share`."""
        shifted = self.velocity / share
        shifted[-1] += self.offset
        square = polynomials.product(shifted, shifted)
        return polynomials.plus(square, -2 * self.deceleration * self.distance)

    def turning(self, use: float) -> Array:
        """Return `2 a w + (v + use o) v`, zero at the extrema of `(v/use + o) / sqrt(2 d w)`."""
        shifted = np.array(self.velocity)
        shifted[-1] += use * self.offset
        left = 2 * polynomials.product(self.acceleration, self.distance)
        return polynomials.plus(left, polynomials.product(shifted, self.velocity))


def _use(
    velocity: Array, distance: Array, offset: Array, deceleration: Array, resting: Array
) -> Array:
    """Return velocity over allowed velocity: 0 at rest, infinite where no motion is allowed."""
    with np.errstate(divide="ignore", invalid="ignore"):
        allowed = np.sqrt(2 * deceleration * np.maximum(distance, 0.0)) - offset
        use = np.where(allowed > 0, velocity / allowed, np.inf)
        return np.where(velocity > resting, use, 0.0)


def _resting(numbers: Array) -> Array:
    """Return the velocity below which a joint counts as at rest, rad/s, `(joints,)`."""
    _, deceleration, low, high = numbers.T
    return RESTING_RTOL * np.sqrt(2 * deceleration * (high - low))


def _at_ends(sides: _Sides, motion: Trajectory) -> Use:
    """Return the worst use at the ends of pieces."""
    points = np.zeros((2, *sides.offset.shape))
    points[1] = 1.0
    uses = sides.use_at(points)
    end, side, piece, place = np.unravel_index(np.argmax(uses), uses.shape)
    joint = int(sides.joints[side, piece, place])
    return Use(float(uses[end, side, piece, place]), joint, float(motion.breaks[piece + end]))


def _knots(own: _Sides, *functions: Array) -> Array:
    """Return the sorted points between which the use has one formula and no function a root."""
    moving = np.array(own.velocity)
    moving[-1] -= own.resting
    roots = [polynomials.unit_roots(function) for function in (moving, *functions)]
    start = np.zeros((1, moving.shape[1]))
    points = np.vstack([start, start + 1.0, *roots])
    return np.sort(np.nan_to_num(points, nan=0.0), axis=0)


def _cut(own: _Sides, index: tuple[Indices, ...], known: float, motion: Trajectory) -> Use:
    """Return the worst use of some pieces by Newton's method, from the largest use `k` known.

    Dilated by `k`, a motion is within the limit where `(v/k + o) / sqrt(2 d w) ≤ 1`. The maximum of
    the left side is at a root of the polynomial `turning(k)`. If the use at that root is larger
    than `k`, it is the next `k`. If not, `k` is the worst use.
    """
    knots = _knots(own, own.allowing)
    middles = (knots[1:] + knots[:-1]) / 2
    points = np.vstack([knots, middles])
    best = Use(-np.inf, None, 0.0)
    for cut in range(_MAX_CUTS):
        uses = own.use_at(points)
        row, i = np.unravel_index(np.argmax(uses), uses.shape)
        worst = float(uses[row, i])
        if worst > best.value:
            piece = int(index[1][i])
            time = motion.breaks[piece] + points[row, i] * motion.lengths[piece]
            best = Use(worst, int(own.joints[i]), float(time))
        if worst == np.inf or (cut > 0 and worst <= known * (1 + _CUT_RTOL)):
            break
        known = max(known, worst)
        points = np.nan_to_num(polynomials.unit_roots(own.turning(known)), nan=0.0)
    return best


def _refuse(column: str, right: str, values: Array, wrong: Bools) -> None:
    for joint in np.flatnonzero(wrong).tolist():
        key = f"limits.{FallingVelocity.key}.{column}"
        raise InvalidInput(key, right, value=values[joint].tolist(), joint=joint)
