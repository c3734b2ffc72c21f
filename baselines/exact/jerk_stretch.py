"""One joint's motion over some segments, found again between other knots (mathematics, section 4).

Under a jerk limit acceleration is straight between knots. Waypoints are passed when they are; the
lengths of the pieces and the accelerations at the knots are free. Limits of acceleration and jerk
are linear in both. Velocity and displacement are nearly so: a few linear programs, each about the
last one's answer, lead to the nearest motion that passes the waypoints within the limits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.linear_programs import LinearPrograms

Array = NDArray[np.float64]
Indices = NDArray[np.intp]
Bools = NDArray[np.bool_]

# How far a step may lead: of a segment's time, of the largest acceleration.
_FIRST_RADIUS = 0.1
_LAST_RADIUS = 1e-9  # where breaks were rounded, and only accelerations move
_LEAST_RADIUS = 1e-13
_SHRINKING = 30.0  # times as far as a step went may the next one go
_LENGTH_SHARE = 0.1  # of a piece's length: how far that may change in one step
_MOST_STEPS = 6
_LAST_STEPS = 3
_MISS_RTOL = 1e-14
_NEAR_LIMIT = 0.9  # of a velocity limit: what is slower in every place stays below it
_NO_COEFFICIENT = 1e-11
ROW_TOLERANCE = 1e-10  # of the radius of a step: HiGHS's least


class JointLimits(NamedTuple):
    """One joint's limits, each low and high, `(2,)`."""

    velocity: Array
    acceleration: Array
    jerk: Array

    def widened(self, dilation: float) -> JointLimits:
        """Those that a motion keeps which a dilation by this brings within these."""
        velocity = self.velocity * dilation
        acceleration = self.acceleration * dilation**2
        jerk = self.jerk * dilation**3
        return JointLimits(velocity, acceleration, jerk)


@dataclass(frozen=True)
class Linear:
    """Numbers, and how they change with some variables.

    Attributes:
        values: `(numbers,)`.
        slopes: `(numbers, variables)`; without variables, of no columns.
    """

    values: Array
    slopes: Array

    def __add__(self, other: Linear | float) -> Linear:
        if not isinstance(other, Linear):
            return Linear(self.values + other, self.slopes)
        return Linear(self.values + other.values, self.slopes + other.slopes)

    def __sub__(self, other: Linear) -> Linear:
        return self + other * -1.0

    def __mul__(self, other: Linear | Array | float) -> Linear:
        if not isinstance(other, Linear):
            factors = np.broadcast_to(other, self.values.shape)
            return Linear(self.values * factors, self.slopes * factors[:, None])
        mine = self.slopes * other.values[:, None]
        others = other.slopes * self.values[:, None]
        return Linear(self.values * other.values, mine + others)

    def __getitem__(self, rows: slice | Bools) -> Linear:
        return Linear(self.values[rows], self.slopes[rows])

    def before_and_after(self) -> Linear:
        """Sums of the numbers before each, and of all."""
        values = np.r_[0.0, np.cumsum(self.values)]
        slopes = np.cumsum(self.slopes, axis=0)
        none = np.zeros((1, slopes.shape[1]))
        return Linear(values, np.vstack([none, slopes]))

    def by_segment(self, segment: Indices) -> Linear:
        """Sums of the numbers of each segment."""
        count = segment[-1] + 1
        values = np.zeros(count)
        slopes = np.zeros((count, self.slopes.shape[1]))
        np.add.at(values, segment, self.values)
        np.add.at(slopes, segment, self.slopes)
        return Linear(values, slopes)


class _Course(NamedTuple):
    """Where a motion leads: at the knots, where acceleration vanishes, over the segments."""

    velocity: Linear
    turning_velocity: Linear
    covered: Linear


def _course(
    lengths: Linear,
    acceleration: Linear,
    start: float,
    segment: Indices,
) -> _Course:
    """The motion from velocity `start` whose acceleration is straight in every piece."""
    before = acceleration[:-1]
    after = acceleration[1:]
    # w = v + t (a + b)/2
    gains = lengths * (before + after) * 0.5
    velocity = gains.before_and_after() + start
    at_start = velocity[:-1]
    # x = t (v + t (2a + b)/6)
    twice = before * 2.0 + after
    mean = at_start + lengths * twice * (1 / 6)
    travelled = lengths * mean
    # v + σ t (a + σ (b − a)/2), where σ may stay: acceleration is 0 there
    share = _turning(before.values, after.values)
    change = (after - before) * (share / 2)
    gained = lengths * (before + change) * share
    return _Course(
        velocity,
        turning_velocity=at_start + gained,
        covered=travelled.by_segment(segment),
    )


def _turning(before: Array, after: Array) -> Array:
    """Where acceleration vanishes in each piece, of its length; else at the nearer end."""
    change = after - before
    steady = change == 0
    share = -before / np.where(steady, 1.0, change)
    share = np.where(steady, 0.0, share)
    return np.asarray(np.clip(share, 0.0, 1.0))


@dataclass(frozen=True)
class Stretch:
    """One joint's motion over some segments, without units.

    Attributes:
        lengths: of the pieces, `(pieces,)`.
        acceleration: at the knots between them, `(pieces + 1,)`.
        ends: velocities that the motion has at its start, and shall have at its end.
        segment: which segment each piece belongs to, from 0, `(pieces,)`.
        h: displacements that the segments shall have, `(segments,)`.
    """

    lengths: Array
    acceleration: Array
    ends: tuple[float, float]
    segment: Indices
    h: Array

    @property
    def times(self) -> Array:
        """Of the segments."""
        lengths = _constant(self.lengths)
        return lengths.by_segment(self.segment).values

    @property
    def velocity(self) -> Array:
        """At the knots."""
        return self._course().velocity.values

    def dilation(self, limits: JointLimits) -> float:
        """The least that brings the motion within its limits; below 1, they leave room."""
        course = self._course()
        jerk = np.diff(self.acceleration) / self.lengths
        velocity = np.r_[course.velocity.values, course.turning_velocity.values]
        by_velocity = utilisation(velocity, limits.velocity)
        by_acceleration = utilisation(self.acceleration, limits.acceleration)
        by_jerk = utilisation(jerk, limits.jerk)
        quicker = np.sqrt(by_acceleration)
        smoother = np.cbrt(by_jerk)
        return float(max(by_velocity, quicker, smoother))

    def missed(self) -> float:
        """The largest miss of a displacement or of the last velocity, of what the joint does."""
        _, end = self.ends
        course = self._course()
        velocity = course.velocity.values
        fastest = _size(velocity)
        paths = fastest * self.times
        short = (course.covered.values - self.h) / paths
        slow = (velocity[-1] - end) / fastest
        return _largest(np.r_[short, slow])

    def _course(self) -> _Course:
        start, _ = self.ends
        lengths = _constant(self.lengths)
        acceleration = _constant(self.acceleration)
        return _course(
            lengths,
            acceleration,
            start,
            self.segment,
        )


def _constant(values: Array) -> Linear:
    """Numbers that do not change."""
    return Linear(values, np.zeros((len(values), 0)))


def utilisation(values: Array, limits: Array) -> float:
    """The largest share of a limit that values use."""
    low, high = limits
    shares = np.maximum(values / low, values / high)
    return float(shares.max())


def _largest(values: Array) -> float:
    return float(np.abs(values).max())


def _size(values: Array) -> float:
    """The largest of them, or 1."""
    return _largest(values) or 1.0


def refitted(
    programs: LinearPrograms,
    stretch: Stretch,
    limits: JointLimits,
    shortest: Array,
    rounded: Callable[[Stretch], Stretch],
) -> Stretch | None:
    """The motion nearest to one that passes its waypoints within its limits, if steps lead to it.

    Args:
        programs: solves its linear programs.
        stretch: what to start from; its displacements and last velocity may be missed.
        limits: of the joint.
        shortest: what each piece's length is at least, `(pieces,)`.
        rounded: the same with the lengths between breaks as they are stored.
    """
    found = _stepped(
        programs,
        stretch,
        limits,
        shortest,
    )
    if found is None:
        return None
    stored = rounded(found)
    if stored.lengths.min() <= 0:
        return None
    return between_breaks(programs, stored, limits, _LAST_RADIUS)


def _stepped(
    programs: LinearPrograms,
    stretch: Stretch,
    limits: JointLimits,
    shortest: Array,
) -> Stretch | None:
    """Where steps lead that change lengths and accelerations, each smaller than the last."""
    radius = _FIRST_RADIUS
    for _ in range(_MOST_STEPS):
        step = _Step(stretch, limits, shortest, breaks_move=True)
        found = step.nearest(programs, radius)
        if found is None:
            return None
        stretch, moved = found
        passed = stretch.missed() <= _MISS_RTOL
        kept = stretch.dilation(limits) <= 1
        if (passed and kept) or moved <= _LEAST_RADIUS:
            return stretch
        radius = _smaller(radius, moved)
    return stretch


def between_breaks(
    programs: LinearPrograms,
    stretch: Stretch,
    limits: JointLimits,
    radius: float,
) -> Stretch | None:
    """The nearest motion between the same breaks: what rounding them missed is made up for.

    Args:
        programs: solves its linear programs.
        stretch: what to start from.
        limits: of the joint.
        radius: how far the first step may lead, of the largest acceleration.

    Returns:
        The motion; None where the linear programs have no answer.
    """
    for _ in range(_LAST_STEPS):
        step = _Step(stretch, limits, stretch.lengths, breaks_move=False)
        found = step.nearest(programs, radius)
        if found is None:
            return None
        stretch, moved = found
        radius = _smaller(radius, moved)
    return stretch


def _smaller(radius: float, moved: float) -> float:
    """The next step's radius: steps get smaller fast, and HiGHS meets rows to a share of it."""
    wanted = max(_SHRINKING * moved, _LEAST_RADIUS)
    return min(radius, wanted)


class _Step:
    """The linear program about a motion: its variables are changes of lengths and accelerations.

    Lengths count in their segment's time, accelerations in the largest of the motion.
    """

    def __init__(
        self,
        stretch: Stretch,
        limits: JointLimits,
        shortest: Array,
        *,
        breaks_move: bool,
    ) -> None:
        self._stretch = stretch
        pieces = len(stretch.lengths)
        variables = 2 * pieces + 1
        times = stretch.times[stretch.segment]
        size = _size(stretch.acceleration)
        length_slopes = np.eye(pieces, variables) * times[:, None]
        acceleration_slopes = np.eye(pieces + 1, variables, k=pieces) * size
        self._lengths = Linear(stretch.lengths, length_slopes)
        self._acceleration = Linear(stretch.acceleration, acceleration_slopes)
        # the accelerations at both ends are the neighbours' too
        self._reach = np.full(variables, np.inf)
        self._reach[[pieces, -1]] = 0.0
        self._reach[:pieces] = 0.0
        if breaks_move:
            longer = _LENGTH_SHARE * stretch.lengths
            longer = np.maximum(longer, 2 * shortest)
            self._reach[:pieces] = longer / times
        self._matrices: list[Array] = []
        self._highest: list[Array] = []
        start, _ = stretch.ends
        course = _course(
            self._lengths,
            self._acceleration,
            start,
            stretch.segment,
        )
        self._pass_waypoints(course)
        self._keep_times(shortest)
        self._keep_velocity(course.velocity, limits)
        self._keep_velocity(course.turning_velocity, limits)
        self._keep_acceleration_and_jerk(limits, shortest)

    def nearest(
        self,
        programs: LinearPrograms,
        radius: float,
    ) -> tuple[Stretch, float] | None:
        """The nearest motion within this radius, and how far it is; None if there is none."""
        matrix = np.vstack(self._matrices)
        matrix[np.abs(matrix) < _NO_COEFFICIENT] = 0.0
        # up and down: their sum is how far each variable moves
        both = np.hstack([matrix, -matrix])
        highest = np.minimum(self._reach / radius, 1.0)
        highest = np.tile(highest, 2)
        found = programs.minimised(
            np.ones(len(highest)),
            both,
            np.concatenate(self._highest) / radius,
            highest,
        )
        if found is None:
            return None
        up, down = np.split(found, 2)
        changes = radius * (up - down)
        moved = replace(
            self._stretch,
            lengths=_changed(self._lengths, changes),
            acceleration=_changed(self._acceleration, changes),
        )
        if moved.lengths.min() <= 0:
            return None
        return moved, _largest(changes)

    def _pass_waypoints(self, course: _Course) -> None:
        stretch = self._stretch
        _, end = stretch.ends
        fastest = _size(stretch.velocity)
        self._equal(course.covered, stretch.h, fastest * stretch.times)
        self._equal(course.velocity[-1:], end, fastest)

    def _keep_times(self, shortest: Array) -> None:
        """Segments take as long as before, and no piece is shorter than it may be."""
        stretch = self._stretch
        times = self._lengths.by_segment(stretch.segment)
        self._equal(times, times.values, times.values)
        self._not_below(self._lengths, shortest, shortest)

    def _keep_velocity(self, velocity: Linear, limits: JointLimits) -> None:
        """Only where a limit is near."""
        low, high = limits.velocity
        is_high = velocity.values > _NEAR_LIMIT * high
        self._not_above(velocity[is_high], high, high)
        is_low = velocity.values < _NEAR_LIMIT * low
        self._not_below(velocity[is_low], low, -low)

    def _keep_acceleration_and_jerk(self, limits: JointLimits, shortest: Array) -> None:
        low, high = limits.acceleration
        size = _size(self._stretch.acceleration)
        self._not_above(self._acceleration, high, size)
        self._not_below(self._acceleration, low, size)
        # b − a <= j t, and not less than the lower limit's
        low, high = limits.jerk
        before = self._acceleration[:-1]
        after = self._acceleration[1:]
        rises = after - before
        highest = self._lengths * high
        lowest = self._lengths * low
        lengths = np.maximum(self._stretch.lengths, shortest)
        self._not_above(rises - highest, 0.0, high * lengths)
        self._not_below(rises - lowest, 0.0, -low * lengths)

    def _equal(
        self,
        numbers: Linear,
        wanted: Array | float,
        size: Array | float,
    ) -> None:
        """Rows: these numbers become the wanted ones."""
        self._not_above(numbers, wanted, size)
        self._not_below(numbers, wanted, size)

    def _not_below(
        self,
        numbers: Linear,
        lowest: Array | float,
        size: Array | float,
    ) -> None:
        """Rows: these numbers stay above `lowest`."""
        mirrored = numbers * -1.0
        self._not_above(mirrored, -lowest, size)

    def _not_above(
        self,
        numbers: Linear,
        highest: Array | float,
        size: Array | float,
    ) -> None:
        """Rows: these numbers stay below `highest`; HiGHS sees them in their sizes."""
        sizes = np.broadcast_to(size, numbers.values.shape)
        spare = highest - numbers.values
        self._matrices.append(numbers.slopes / sizes[:, None])
        self._highest.append(spare / sizes)


def _changed(numbers: Linear, changes: Array) -> Array:
    """The numbers after changes of the variables."""
    return np.asarray(numbers.values + numbers.slopes @ changes)
