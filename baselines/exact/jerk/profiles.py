"""Compute the extreme profiles under a jerk limit in closed form (mathematics, section 4).

Between two states (velocity, acceleration), which profile covers most displacement in a given time?

A *rise* from `(u, a)` takes the acceleration to `A` with the jerk limit upwards `J2`, holds it for
`d`, and returns it to 0 with the jerk limit downwards `J1`. With `r = 1/J` it takes the time
`(r1 + r2) A − r2 a + d` and ends at the peak `u − r2 a²/2 + (r1 + r2) A²/2 + A d`. Backwards in
time velocity and jerk keep their signs and acceleration changes its own. So the *fall* from the
peak to `(w, −b)` is, backwards, a rise from `(w, b)`, and the profile is rise, cruise, fall: seven
phases with jerk `+ 0 − 0 − 0 +`. Both meet at one peak and fill the time: two equations for what
the rise and the fall do, one linear or quadratic for each choice of who holds its acceleration at
its limit. An `A` below 0 is no exception: its return to 0 takes negative time.

A cell counts time in its own `T` and velocities from its mean velocity, so `T` is 1 and the
displacement 0. The formulas go on smoothly where a first ramp would take negative time: there the
states are out of reach, and the most displacement is below the least. Without a jerk limit
(`r = 0`) ramps take no time: section 3.

The most displacement is concave in the states, and the value of a state is its costate: with
`m` the middle between the two jerks of the rise, `∂D/∂u = m` and `∂D/∂a = t1 (m − t1/2)`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools

_TINY = 1e-300  # instead of dividing by 0
# Least acceleration of a rise to the velocity limit, relative to the acceleration limit.
_LEAST_RISE = 1e-12
# Rounding of a phase, relative to the segment's time.
_ROUNDING = 1e-12

# Indices of a cell's variables: logarithm of the time, then velocity and acceleration at each end.
TIME = 0
VELOCITIES = (1, 3)
ACCELERATIONS = (2, 4)
_VARIABLES = 5


class SegmentLimits(NamedTuple):
    """Limits of the profiles in the cell's units; arrays broadcast to `(2 sides, …)`.

    Attributes:
        steepest: accelerations of the rise and of the fall, `(2 ends, 2 sides, …)`.
        top: velocity.
        up: inverse jerk upwards.
        down: inverse jerk downwards.
        steep: `h/T²`, by which velocities from the mean change with the time.
        beyond: whether a cruise may be a little negative.
    """

    steepest: Array
    top: Array
    up: Array
    down: Array
    steep: Array
    beyond: bool = False


class Slopes(NamedTuple):
    """How the most displacement changes with the variables of a cell.

    Attributes:
        first: derivatives, `(5, 2 sides, …)`.
        second: and theirs, `(5, 5, 2 sides, …)`.
    """

    first: Array
    second: Array


class ExtremeProfiles:
    """The profiles of most displacement; the lower ones are mirrored, on an axis of sides.

    Args:
        velocity: at both ends, `(2 ends, 2 sides, …)`.
        acceleration: likewise, at the end seen backwards.
        limits: of the cells.

    Attributes:
        rises: accelerations of the rise and of the fall, `(2 ends, 2 sides, …)`.
        first: times of their first ramps; negative where the states are out of reach.
        hold: times for which they are held.
        cruise: time at the peak.
        value: displacement beyond the cell's own, in units of its time squared.
    """

    def __init__(self, velocity: Array, acceleration: Array, limits: SegmentLimits) -> None:
        steepest, top, up, down, *_ = limits
        c = up + down
        jerky = c > 0
        half = 0.5 / np.where(jerky, c, 1.0)
        # Counted from a constant acceleration: in a brief segment jerk changes little of it.
        a, b = acceleration
        common = np.where(jerky, (a - b) / 2, 0.0)
        apart = np.array([common, -common])
        counted = acceleration - apart
        limit = steepest - apart
        opposite = limit[::-1]
        base = velocity + apart / 2 - up * counted**2 / 2
        time = 1 + up * counted.sum(axis=0)
        difference = base[1] - base[0]
        toward = np.array([difference, -difference])
        # no hold: both together fill the time, the lower base has further to climb
        tilt = toward / time
        free = time * half + tilt
        # one held: what the other one reaches, and the limit more
        climbed = limit * time - toward
        square = np.maximum(4 * half * climbed, _TINY)
        root = np.sqrt(square)
        over = jerky & (free > limit)
        alone = over & (root - limit <= opposite)
        alone[1] &= ~alone[0]
        none = jerky & ~over.any(axis=0)
        both = ~(none | alone.any(axis=0))
        held = alone | both
        beside = root[::-1] - opposite
        rises = np.where(alone[::-1], beside, free)
        rises = np.where(held, limit, rises) + apart
        together = steepest.sum(axis=0)
        spare = time - c * together
        difference = opposite**2 - limit**2
        excess = toward + c * difference / 2
        shared = (opposite * spare + excess) / together
        hold = np.where(both, shared, 0.0)
        hold = np.where(alone, time - c * root, hold)
        # a peak above the limit becomes a cruise at the limit
        bases = velocity - up * acceleration**2 / 2
        rise, _ = rises
        risen = rise * (c * rise / 2 + hold[0])
        highest = bases[0] + risen
        gap = top - bases
        least = _LEAST_RISE * steepest
        square = np.maximum(4 * half * gap, least**2)
        full = np.sqrt(square)
        kept = ~jerky | (full > steepest)
        limited = np.where(kept, steepest, full)
        held_for = gap / steepest - c * steepest / 2
        needed = np.where(kept, held_for, 0.0)
        # also where the cruise were a little negative: D is the lesser of both, each smooth
        braking = down * limited / 2
        spent = up * (limited - acceleration) + needed + braking
        is_below = (gap > 0).all(axis=0)
        near = limits.beyond & is_below & (spent.sum(axis=0) < 1)
        cruises = (rises >= 0).all(axis=0) & np.isfinite(top)
        cruises &= (highest > top) | near
        rises = np.where(cruises, limited, rises)
        hold = np.where(cruises, needed, hold)

        apart = np.where(cruises, 0.0, apart)
        start = velocity + apart / 2
        counted = acceleration - apart
        reached = rises - apart
        first = up * (reached - counted)
        last = down * reached
        until = first + hold
        whole = until + last
        cruise = np.where(cruises, 1 - whole.sum(axis=0), 0.0)
        gained = first * (counted + reached) / 2
        after = start + gained + reached * hold
        eased = reached * last / 2
        peak = after[0] + eased[0]
        # D = p − ∫ t a dt over rise and fall, t from their own end
        ramped = first**2 * (counted + 2 * reached) / 6
        kept_on = hold * (first + hold / 2)
        released = last * (until + last / 3) / 2
        moments = ramped + reached * (kept_on + released)

        self.limits = limits
        self.velocity = velocity
        self.acceleration = acceleration
        self.rises = rises
        self.first = first
        self.hold = hold
        self.cruise = cruise
        self.value = peak - moments.sum(axis=0)
        slow_enough = gap >= -_ROUNDING * np.abs(top)
        self._slow_enough = ~cruises | slow_enough.all(axis=0)
        self._choice = (alone, both, held, cruises, kept)
        tilts = tilt + np.array([common, -common])
        speeds = after + apart * (until - 0.5)
        self._numbers = (half, time, tilts, root, full, until, speeds)

    @property
    def reachable(self) -> Bools:
        """Return whether all phases take time and both ends keep the velocity limit."""
        briefest = np.minimum(self.first, self.hold).min(axis=0)
        return np.asarray((briefest >= -_ROUNDING) & self._slow_enough)

    def slopes(self) -> Slopes:
        """The costates, and how they change."""
        steepest, top, up, down, steep, _ = self.limits
        alone, both, held, cruises, kept = self._choice
        half, time, tilt, root, full, until, after = self._numbers
        acceleration = self.acceleration
        rises = self.rises
        first = self.first
        c = up + down
        last = down * rises
        shape = (_VARIABLES, *rises.shape)
        d_base = np.zeros(shape)
        d_base[TIME] = up * acceleration**2 / 2
        d_time = np.zeros((_VARIABLES, *time.shape))
        d_time[TIME] = 1 - time
        for end, (v, a) in enumerate(zip(VELOCITIES, ACCELERATIONS, strict=True)):
            d_base[v, end] = 1.0
            d_base[a, end] = -up * acceleration[end]
            d_time[a] = up
        d_time = d_time[:, None]

        # the accelerations reached: free, beside one that is held, or below the velocity limit
        d_difference = d_base[:, 1] - d_base[:, 0]
        d_toward = np.stack([d_difference, -d_difference], axis=1)
        d_free = d_time * (half - tilt / time) + d_toward / time
        d_free[TIME] += half * time
        d_climbed = steepest * d_time - d_toward
        d_root = 2 * half * d_climbed / root
        d_root[TIME] += root / 2
        beside = d_root[:, ::-1]
        d_rises = np.where(alone[::-1], beside, d_free)
        d_rises = np.where(held, 0.0, d_rises)
        # the holds
        together = steepest.sum(axis=0)
        opposite = steepest[::-1]
        d_both = (opposite * d_time + d_toward) / together
        # opposite − (opposite² − steepest²) / (2 together)
        d_both[TIME] += c * together / 2
        d_alone = d_time - c * d_root
        d_alone[TIME] += c * root
        d_hold = np.where(both, d_both, 0.0)
        d_hold = np.where(alone, d_alone, d_hold)
        if cruises.any():
            d_gap = -d_base
            d_gap[TIME] += steep - top
            d_full = 2 * half * d_gap / full
            d_full[TIME] += full / 2
            d_limited = np.where(kept, 0.0, d_full)
            d_needed = d_gap / steepest
            d_needed[TIME] += c * steepest / 2
            d_needed = np.where(kept, d_needed, 0.0)
            d_rises = np.where(cruises, d_limited, d_rises)
            d_hold = np.where(cruises, d_needed, d_hold)
        d_first = up * d_rises
        d_first[TIME] -= first
        for end, a in enumerate(ACCELERATIONS):
            d_first[a, end] -= up
        d_last = down * d_rises
        d_last[TIME] -= last
        d_until = d_first + d_hold

        # the costate vanishes in the middle of the last ramp, or between both holds
        left = 1 - until.sum(axis=0)
        rest = np.where(cruises, last, left)
        middle = until + rest / 2
        d_left = -d_until.sum(axis=1)
        d_rest = np.where(cruises, d_last, d_left[:, None])
        d_middle = d_until + d_rest / 2
        worth = first * (middle - first / 2)
        d_worth = d_middle * first + (middle - first) * d_first

        # over the time: velocities from the mean change with it, and so does every limit
        ends = self.velocity
        rise, _ = rises
        peak = after[0] + rise * left / 2
        highest = np.where(cruises, top, peak)
        between = steep * (1 - middle.sum(axis=0))
        by_ends = (middle * ends).sum(axis=0)
        by_time = by_ends + highest - 2 * self.value + between
        longer = self.hold[0] + (first[0] + left) / 2
        mean = (acceleration[0] + rise) / 2
        ramped = d_first[TIME, 0] * mean
        kept_on = d_hold[TIME, 0] + d_left[TIME] / 2
        lifted = d_rises[TIME, 0] * longer
        peak_by_time = ramped + rise * kept_on + lifted
        highest_by_time = np.where(cruises, steep - top, peak_by_time)
        moved = (d_middle[TIME] * (ends - steep)).sum(axis=0)
        lost = 2 * (by_time + between)
        twice = moved + highest_by_time - lost

        first_order = np.empty((_VARIABLES, *time.shape))
        second = np.empty((_VARIABLES, *first_order.shape))
        first_order[TIME] = by_time
        second[TIME, TIME] = twice
        for end, (v, a) in enumerate(zip(VELOCITIES, ACCELERATIONS, strict=True)):
            first_order[v] = middle[end]
            first_order[a] = worth[end]
            second[v] = d_middle[:, end]
            second[a] = d_worth[:, end]
            second[TIME, v] = d_middle[TIME, end]
            second[TIME, a] = d_worth[TIME, end]
        return Slopes(first_order, second)
