"""One jerk-limited joint's motion over one segment, between stored breaks (mathematics, section 4).

It is the convex combination of both extreme profiles that covers the displacement, whose breaks are
then rounded as a trajectory stores them. In a segment of hours a ramp of a millisecond is 1e-8
longer or shorter by that, and what its velocity misses would be mended over all of the segment. So
the accelerations at the rounded breaks are found anew: by the least change, else by a small linear
program that keeps the limits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from baselines.exact.jerk_profiles import BRIEF, Extremes, Limit, Profile, Sides, State
from baselines.exact.jerk_stretch import (
    ROW_TOLERANCE,
    JointLimits,
    Stretch,
    between_breaks,
    utilisation,
)
from baselines.exact.rounded import Clock, Pieces, accumulated, apart, integrated, through
from baselines.linear_programs import LinearPrograms
from trajopt import polynomials

Array = NDArray[np.float64]

# Of a segment: pieces so short are left out, the longest first, where the limits allow it.
_SLIVERS = (1e-5, 1e-7, 1e-9, 1e-12)
_BRIEF_PIECES = 4
# Breaks of two joints that are so near each other are at one place, where limits allow it.
_NEAR_S = 1e-6
_NEAR_UNIT_RTOL = 1e-3  # of the mean stop time, where that is brief
_MENDED_RTOL = 1e-9  # what rounding breaks and leaving slivers out may pass a limit by
# That a linear program may cost: what is worth fewer pieces, then as little as limits allow.
_DILATIONS = ((1e-12, 3e-10), (3e-9,), (3e-8,), (3e-7,), (3e-6,))
_RADIUS = 1e-6  # of the largest acceleration: how far its first step may lead
_MISS_RTOL = 1e-13


def combined(
    states: Array,
    h: Array,
    both: Extremes,
    sides: Sides,
    clock: Clock,
    places: Array,
) -> Pieces:
    """The motion between one segment's extreme profiles that covers exactly `h`.

    Breaks are rounded before the motion is fitted to them: in a segment of 1e-6 s, a break's
    rounding is worth 1e-9 of the displacement, and mending that later would cost a large jerk.

    Args:
        states: velocities, then accelerations, at both ends, `(2, 2)`.
        h: displacement.
        both: the extreme profiles over the segment's time.
        sides: the limits of both.
        clock: the segment's times.
        places: stored breaks of other joints, in order, s, the segment's ends among them.

    Returns:
        Stored breaks, s, `(pieces + 1,)`, and position coefficients, `(4, pieces)`.
    """
    t = clock.length
    velocities, accelerations = states
    u, w = velocities
    a, b = accelerations
    start = (u, a)
    end = (w, b)
    if both.narrow(start, end, np.array(t), h):
        # q(t) = u t + a t²/2 + j t³/6
        jerk = (b - a) / t
        cubic = [
            jerk / 6,
            a / 2,
            u,
            0.0,
        ]
        whole = np.array([0.0, t])
        return clock.stored(whole), np.array(cubic)[:, None]
    upper_side, lower_side = sides
    mirrored = (-u, -a)
    upper = _phases(both.upper, start, -b, upper_side)
    lower = _phases(both.lower, mirrored, b, lower_side)
    upper_starts, _ = upper
    lower_starts, _ = lower
    knots = np.r_[upper_starts, lower_starts]
    knots = np.clip(knots, 0.0, t)
    breaks = np.unique(np.r_[knots, t])
    # q(t) = λ q_up(t) + (1 − λ) q_lo(t), the lower one being mirrored
    share = float(both.share(h))
    high = _resampled(upper, breaks)
    low = _resampled(lower, breaks)
    exact = share * high - (1 - share) * low
    acceleration = np.r_[2 * exact[1], b]
    task = _Task(
        ends=(float(u), float(w)),
        h=float(h),
        limits=_joint_limits(sides),
        clock=clock,
        places=places,
    )
    closest = clock.resolution / clock.unit
    grids = list(_grids(knots, t, closest))
    near = min(_NEAR_S, _NEAR_UNIT_RTOL * clock.unit)
    for kept in grids:
        levels = np.interp(kept, breaks, acceleration)
        for distance in (near, 0.0):
            pieces = task.least_change(kept, levels, distance)
            if pieces is not None:
                return pieces
    for dilations in _DILATIONS:
        for kept in grids:
            levels = np.interp(kept, breaks, acceleration)
            pieces = task.within_limits(kept, levels, dilations)
            if pieces is not None:
                return pieces
    return clock.stored(breaks), exact


def _grids(knots: Array, t: float, closest: float) -> Iterator[Array]:
    """Breaks to try, the fewest first.

    In a brief segment one grid for all joints: pieces between breaks that differ by rounding would
    cost a large jerk.
    """
    if t < BRIEF:
        yield np.linspace(0.0, t, _BRIEF_PIECES + 1)
    fewest = 0
    for sliver in _SLIVERS:
        shortest = max(sliver * t, closest)
        kept = apart(knots, t, shortest)
        if len(kept) > fewest:
            yield kept
        fewest = len(kept)


def _joint_limits(sides: Sides) -> JointLimits:
    """The limits of both sides, each low and high."""
    upper, lower = sides
    return JointLimits(
        velocity=np.array([-lower.velocity, upper.velocity]),
        acceleration=np.array([-upper.fall, upper.rise]),
        jerk=np.array([-1 / upper.down, 1 / upper.up]),
    )


@dataclass(frozen=True)
class _Task:
    """What the joint has to do in the segment.

    Attributes:
        ends: velocities at the start and at the end.
        h: displacement.
        limits: of the joint.
        clock: the segment's times.
        places: stored breaks of other joints.
    """

    ends: tuple[float, float]
    h: float
    limits: JointLimits
    clock: Clock
    places: Array

    def least_change(
        self,
        kept: Array,
        levels: Array,
        near: float,
    ) -> Pieces | None:
        """The motion nearest to these accelerations at these breaks, if it keeps its limits.

        Breaks so `near` those of other joints, s, are there.
        """
        stored = self.clock.stored_at(kept, self.places, near)
        lengths = self.clock.lengths(stored)
        mended = through(lengths, levels, self.ends, self.h)
        if mended is None or not _keeps(self.limits, lengths, mended):
            return None
        return stored, mended

    def within_limits(
        self,
        kept: Array,
        levels: Array,
        dilations: tuple[float, ...],
    ) -> Pieces | None:
        """The same by linear programs that keep the limits, where no ramp was rounded briefer."""
        stored = self.clock.stored_outwards(kept, self.places)
        lengths = self.clock.lengths(stored)
        if lengths.min() <= 0:
            return None
        stretch = Stretch(
            lengths,
            levels,
            self.ends,
            segment=np.zeros(len(lengths), dtype=np.intp),
            h=np.array([self.h]),
        )
        programs = LinearPrograms(ROW_TOLERANCE)
        for dilation in dilations:
            found = between_breaks(
                programs,
                stretch,
                self.limits.widened(1 + dilation),
                _RADIUS,
            )
            if found is None:
                continue
            largest = 1 + dilation + _MENDED_RTOL
            if found.missed() <= _MISS_RTOL and found.dilation(self.limits) <= largest:
                u, _ = self.ends
                cubics, _, _ = integrated(lengths, found.acceleration, u)
                return stored, cubics
        return None


def _keeps(limits: JointLimits, lengths: Array, cubics: Array) -> bool:
    """Whether a motion keeps its limits of jerk, acceleration and velocity, to `_MENDED_RTOL`."""
    cubic, square, linear, _ = cubics
    jerk = 6 * cubic
    acceleration = 2 * square
    velocity = np.r_[linear, _turning(lengths, cubics)]
    utilisations = [
        utilisation(jerk, limits.jerk),
        utilisation(acceleration, limits.acceleration),
        utilisation(velocity, limits.velocity),
    ]
    return max(utilisations) <= 1 + _MENDED_RTOL


def _turning(lengths: Array, cubics: Array) -> Array:
    """Velocity where acceleration vanishes in a piece; where it does not, at the nearer end."""
    cubic, square, linear, _ = cubics
    jerk = 6 * cubic
    acceleration = 2 * square
    changing = np.where(jerk == 0, np.inf, jerk)
    zero = -acceleration / changing
    when = np.clip(zero, 0.0, lengths)
    # v + t (a + j t/2)
    mean = acceleration + when * jerk / 2
    return np.asarray(linear + when * mean)


def _phases(
    profile: Profile,
    start: State,
    b: Array,
    limit: Limit,
) -> Pieces:
    """The seven phases of an extreme profile from `start` to acceleration `−b`: starts, cubics."""
    u, a = start
    rise = float(profile.rise)
    fall = float(profile.fall)
    up = float(limit.up)
    down = float(limit.down)
    # accelerations between the phases, whose jerks are + 0 − 0 − 0 +
    between = float(np.clip(0.0, -fall, rise))
    levels = np.array([a, rise, rise, between, between, -fall, -fall, -b])
    rising = 1 / up
    falling = -1 / down
    jerks = np.array([rising, 0.0, falling, 0.0, falling, 0.0, rising])
    changes = np.diff(levels)[::2]
    ramps = np.abs(changes) * [up, down, down, up]
    holds = [
        profile.rise_hold,
        profile.cruise,
        profile.fall_hold,
    ]
    lengths = np.zeros(7)
    lengths[::2] = ramps
    lengths[1::2] = holds
    # v += d (a0 + a1)/2, q += d (v + d (2 a0 + a1)/6)
    first = levels[:-1]
    last = levels[1:]
    gains = lengths * (first + last) / 2
    velocity = accumulated(u, gains)
    mean = velocity + lengths * (2 * first + last) / 6
    position = accumulated(0.0, lengths * mean)
    starts = accumulated(0.0, lengths)
    rows = [
        jerks / 6,
        first / 2,
        velocity,
        position,
    ]
    return starts, np.stack(rows)


def _resampled(pieces: Pieces, breaks: Array) -> Array:
    """Coefficients of the same profile between these breaks, its own among them."""
    starts, coefficients = pieces
    begins = breaks[:-1]
    middle = (begins + breaks[1:]) / 2
    at = np.searchsorted(starts, middle, side="right") - 1
    moved = begins - starts[at]
    return polynomials.shifted(coefficients[:, at], moved)
