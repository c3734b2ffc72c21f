"""Compute the extreme profiles under a jerk limit in closed form (mathematics, section 5).

Between two states (velocity, acceleration), which profile covers most displacement in a given time?
It has seven phases, with the jerk `+ 0 − 0 − 0 +`:

    rise     ramp from the first acceleration up to the level p1, hold it for d1, ramp to 0
    cruise   at the velocity limit, where the rise reaches it
    fall     the mirror image of a rise: seen backwards it begins at the last state

A rise from `(u, a)` with the inverse jerks `r2` upwards and `r1` downwards takes the time
`(r1 + r2) p − r2 a + d`. It ends at the velocity `u − r2 a²/2 + (r1 + r2) p²/2 + p d`. Backwards in
time velocity and jerk keep their signs, and acceleration changes its own. So the fall to `(w, −b)`
is a rise from `(w, b)`, and both ends are one table, on an axis of two.

Rise and fall fill the time (5.2) and meet at one peak velocity (5.3): two equations for the levels
and the holds. `_filling` solves them, `_to_velocity_limit` replaces a peak above the velocity limit
by a cruise. A level below 0 is no exception: its ramp to 0 takes negative time.

Units and frame: a cell counts time in its own `T` and velocities from its mean velocity `h/T`. So
`T` is 1 and the displacement is 0. The formulas continue smoothly where a first ramp would take
negative time. There the states are out of reach, and the most displacement is below the least.
Without a jerk limit (`r = 0`) ramps take no time, which is section 4.

A worked example is in docs/mathematics/exact.md, section 5.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from trajopt.core.arrays import Array, Bools

_TINY = 1e-300  # instead of dividing by 0
# Least level of a rise to the velocity limit, relative to the acceleration limit: its derivatives
# have the level as a divisor.
_LEAST_LEVEL = 1e-12
# Rounding of a phase, relative to the segment's time. Smaller: states of an optimum count as out of
# reach. Larger: states that are out of reach count as reached.
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
    """Derivatives of the most displacement by the variables of a cell.

    Attributes:
        first: derivatives, `(5, 2 sides, …)`.
        second: second derivatives, `(5, 5, 2 sides, …)`.
    """

    first: Array
    second: Array


class _Filling(NamedTuple):
    """Rise and fall that fill the time and meet at one peak, whatever the velocity limit is.

    Tables of both ends are `(2 ends, 2 sides, …)`.

    Attributes:
        level: `p` of each end.
        hold: `d` of each end.
        alone: where this end is held at its acceleration limit and the other one is not held.
        both: where both are held, `(2 sides, …)`.
        offset: mean acceleration of the two end states, as each end sees it.
        budget: `S` of (5.2), the time for levels and holds, `(2 sides, …)`.
        lead: `±Δ/S`, by which an end's level is above half of both.
        sum_of_levels: `p1 + p2` where this end is held alone, counted from the offsets.
    """

    level: Array
    hold: Array
    alone: Bools
    both: Bools
    offset: Array
    budget: Array
    lead: Array
    sum_of_levels: Array

    @property
    def held(self) -> Bools:
        """Where an end is held at its acceleration limit."""
        return self.alone | self.both


def _filling(velocity: Array, acceleration: Array, limits: SegmentLimits) -> _Filling:
    """Solve (5.2) and (5.3) for the levels and the holds."""
    steepest, _, up, down, *_ = limits
    c = up + down
    jerky = c > 0
    half = _half(c)
    # Accelerations are counted from their mean: in a short segment jerk changes little of it.
    a, b = acceleration
    mean = np.where(jerky, (a - b) / 2, 0.0)
    offset = np.array([mean, -mean])
    counted = acceleration - offset
    limit = steepest - offset
    other_limit = limit[::-1]
    # The velocity at which each end's first ramp would begin with zero acceleration.
    base = velocity + offset / 2 - up * counted**2 / 2
    budget = 1 + up * _of_both(counted)  # S
    difference = base[1] - base[0]  # Δ
    climb = np.array([difference, -difference])
    # No hold: p = S/(2c) ± Δ/S. The end with the lower base has the higher level.
    lead = climb / budget
    free = budget * half + lead
    # One held at A: p1 + p2 = √(2 (A S − Δ)/c).
    square = np.maximum(4 * half * (limit * budget - climb), _TINY)
    sum_of_levels = np.sqrt(square)
    # Exactly one case fits: no hold, one end held alone, or both held.
    too_steep = jerky & (free > limit)
    alone = too_steep & (sum_of_levels - limit <= other_limit)
    alone[1] &= ~alone[0]
    none = jerky & ~(too_steep[0] | too_steep[1])
    both = ~(none | alone[0] | alone[1])
    level = np.where(alone[::-1], sum_of_levels[::-1] - other_limit, free)
    level = np.where(alone | both, limit, level) + offset
    # Both held: (5.2) and (5.3) are linear in d1 and d2.
    together = _of_both(steepest)
    spare = budget - c * together
    squares = other_limit**2 - limit**2
    shared = (other_limit * spare + (climb + c * squares / 2)) / together
    hold = np.where(both, shared, 0.0)
    hold = np.where(alone, budget - c * sum_of_levels, hold)
    return _Filling(level, hold, alone, both, offset, budget, lead, sum_of_levels)


class _Cruise(NamedTuple):
    """Rise and fall to the velocity limit, where the peak would be above it.

    Attributes:
        cruises: where the profile has a cruise, `(2 sides, …)`.
        level: `p` of each end, `(2 ends, 2 sides, …)`.
        hold: `d` of each end, likewise.
        held: where the level is at its acceleration limit, likewise.
        full: level of an end that is not held, likewise.
        gap: from the base to the velocity limit, likewise.
    """

    cruises: Bools
    level: Array
    hold: Array
    held: Bools
    full: Array
    gap: Array


def _to_velocity_limit(
    filling: _Filling, velocity: Array, acceleration: Array, limits: SegmentLimits
) -> _Cruise:
    """Return how each end reaches the velocity limit, and where that makes a cruise."""
    steepest, top, up, down, *_ = limits
    c = up + down
    base = velocity - up * acceleration**2 / 2
    rise, _ = filling.level
    peak = base[0] + rise * (c * rise / 2 + filling.hold[0])
    gap = top - base
    # Without a hold: c p²/2 = gap. With one: c A²/2 + A d = gap.
    square = np.maximum(4 * _half(c) * gap, (_LEAST_LEVEL * steepest) ** 2)
    full = np.sqrt(square)
    held = ~(c > 0) | (full > steepest)
    level = np.where(held, steepest, full)
    hold = np.where(held, gap / steepest - c * steepest / 2, 0.0)
    # Near the kink the displacement is the lesser of two smooth functions, with a cruise and
    # without: the one with a cruise continues where the cruise were a little negative.
    spent = up * (level - acceleration) + hold + down * level / 2
    nearly = limits.beyond & (np.minimum(*gap) > 0) & (_of_both(spent) < 1)
    cruises = (np.minimum(*filling.level) >= 0) & np.isfinite(top)
    cruises &= (peak > top) | nearly
    return _Cruise(cruises, level, hold, held, full, gap)


class ExtremeProfiles:
    """The profiles of most displacement; those of least are mirrored, on an axis of sides.

    Args:
        velocity: at both ends, `(2 ends, 2 sides, …)`.
        acceleration: likewise, at the end seen backwards.
        limits: of the cells.

    Attributes:
        rises: levels of the rise and of the fall, `(2 ends, 2 sides, …)`.
        first: times of their first ramps; negative where the states are out of reach.
        hold: times for which the levels are held.
        cruise: time at the peak.
        value: displacement beyond the cell's own, in units of its time squared.
    """

    def __init__(self, velocity: Array, acceleration: Array, limits: SegmentLimits) -> None:
        filling = _filling(velocity, acceleration, limits)
        to_limit = _to_velocity_limit(filling, velocity, acceleration, limits)
        cruises = to_limit.cruises
        level = np.where(cruises, to_limit.level, filling.level)
        hold = np.where(cruises, to_limit.hold, filling.hold)

        # The phases, accelerations counted from the offset as long as there is no cruise.
        offset = np.where(cruises, 0.0, filling.offset)
        start = velocity + offset / 2
        counted = acceleration - offset
        reached = level - offset
        first = limits.up * (reached - counted)
        last = limits.down * reached
        until = first + hold
        whole = until + last
        cruise = np.where(cruises, 1 - _of_both(whole), 0.0)

        # Displacement D = peak − ∫ t a dt over rise and fall, with t from each one's own end.
        after_hold = start + first * (counted + reached) / 2 + reached * hold
        peak = after_hold[0] + reached[0] * last[0] / 2
        of_first = first**2 * (counted + 2 * reached) / 6
        of_hold = hold * (first + hold / 2)
        of_last = last * (until + last / 3) / 2
        moments = of_first + reached * (of_hold + of_last)

        self.limits = limits
        self.velocity = velocity
        self.acceleration = acceleration
        self.rises = level
        self.first = first
        self.hold = hold
        self.cruise = cruise
        self.value = peak - _of_both(moments)
        slow_enough = to_limit.gap >= -_ROUNDING * np.abs(limits.top)
        self._slow_enough = ~cruises | slow_enough.all(axis=0)
        self._filling = filling
        self._to_limit = to_limit
        self._until = until
        self._velocity_after_hold = after_hold + offset * (until - 0.5)

    @property
    def reachable(self) -> Bools:
        """Return whether all phases take time and both ends keep the velocity limit."""
        return np.asarray(self.ends_reachable.all(axis=0) & self._slow_enough)

    @property
    def ends_reachable(self) -> Bools:
        """Return whether the phases of each end take time, `(2 ends, 2 sides, …)`."""
        return np.asarray(np.minimum(self.first, self.hold) >= -_ROUNDING)

    def slopes(self) -> Slopes:
        """Return the first and second derivatives of the displacement by a cell's variables.

        The first ones are the costates of (5.4), with `m` the middle between the two jerks.
        """
        _, top, up, down, steep, _ = self.limits
        cruises = self._to_limit.cruises
        until = self._until
        acceleration = self.acceleration
        level = self.rises
        first = self.first
        last = down * level
        d_level, d_hold = self._level_slopes()
        d_first = up * d_level
        d_first[TIME] -= first
        for end, a in enumerate(ACCELERATIONS):
            d_first[a, end] -= up
        d_last = down * d_level
        d_last[TIME] -= last
        d_until = d_first + d_hold

        # m is the middle of the last ramp, or without a cruise of the time between both holds;
        # ∂D/∂u = m, and ∂D/∂a = t1 (m − t1/2).
        left = 1 - _of_both(until)
        rest = np.where(cruises, last, left)
        middle = until + rest / 2
        d_left = -(d_until[:, 0] + d_until[:, 1])
        d_rest = np.where(cruises, d_last, d_left[:, None])
        d_middle = d_until + d_rest / 2
        by_acceleration = first * (middle - first / 2)
        d_by_acceleration = d_middle * first + (middle - first) * d_first

        # By the time: velocities from the mean change with it, and so does every limit.
        ends = self.velocity
        after_hold = self._velocity_after_hold
        rise, _ = level
        peak = after_hold[0] + rise * left / 2
        highest = np.where(cruises, top, peak)
        between = steep * (1 - _of_both(middle))
        by_ends = _of_both(middle * ends)
        by_time = by_ends + highest - 2 * self.value + between
        longer = self.hold[0] + (first[0] + left) / 2
        mean = (acceleration[0] + rise) / 2
        ramped = d_first[TIME, 0] * mean
        held_on = d_hold[TIME, 0] + d_left[TIME] / 2
        lifted = d_level[TIME, 0] * longer
        peak_by_time = ramped + rise * held_on + lifted
        highest_by_time = np.where(cruises, steep - top, peak_by_time)
        moved = _of_both(d_middle[TIME] * (ends - steep))
        lost = 2 * (by_time + between)
        twice = moved + highest_by_time - lost

        first_order = np.empty((_VARIABLES, *left.shape))
        second = np.empty((_VARIABLES, *first_order.shape))
        first_order[TIME] = by_time
        second[TIME, TIME] = twice
        for end, (v, a) in enumerate(zip(VELOCITIES, ACCELERATIONS, strict=True)):
            first_order[v] = middle[end]
            first_order[a] = by_acceleration[end]
            second[v] = d_middle[:, end]
            second[a] = d_by_acceleration[:, end]
            second[TIME, v] = d_middle[TIME, end]
            second[TIME, a] = d_by_acceleration[TIME, end]
        return Slopes(first_order, second)

    def _level_slopes(self) -> tuple[Array, Array]:
        """Derivatives of levels and holds, `(5, 2 ends, 2 sides, …)`, each by the chain rule.

        The cases are those of `_filling` and `_to_velocity_limit`, in the same order.
        """
        steepest, top, up, down, steep, _ = self.limits
        _, _, alone, both, offset, budget, lead, sum_of_levels = self._filling
        cruises, _, _, held_at_limit, full, _ = self._to_limit
        c = up + down
        half = _half(c)
        acceleration = self.acceleration
        d_base = np.zeros((_VARIABLES, *self.rises.shape))
        d_base[TIME] = up * acceleration**2 / 2
        d_budget = np.zeros((_VARIABLES, *budget.shape))
        d_budget[TIME] = 1 - budget
        for end, (v, a) in enumerate(zip(VELOCITIES, ACCELERATIONS, strict=True)):
            d_base[v, end] = 1.0
            d_base[a, end] = -up * acceleration[end]
            d_budget[a] = up
        d_budget = d_budget[:, None]

        d_difference = d_base[:, 1] - d_base[:, 0]
        d_climb = np.empty(d_base.shape)
        d_climb[:, 0] = d_difference
        d_climb[:, 1] = -d_difference
        whole_lead = lead + offset
        d_free = d_budget * (half - whole_lead / budget) + d_climb / budget
        d_free[TIME] += half * budget
        d_sum = 2 * half * (steepest * d_budget - d_climb) / sum_of_levels
        d_sum[TIME] += sum_of_levels / 2
        d_level = np.where(alone[::-1], d_sum[:, ::-1], d_free)
        d_level = np.where(self._filling.held, 0.0, d_level)
        together = _of_both(steepest)
        opposite = steepest[::-1]
        d_both = (opposite * d_budget + d_climb) / together
        # opposite − (opposite² − steepest²) / (2 together) is together / 2
        d_both[TIME] += c * together / 2
        d_alone = d_budget - c * d_sum
        d_alone[TIME] += c * sum_of_levels
        d_hold = np.where(both, d_both, 0.0)
        d_hold = np.where(alone, d_alone, d_hold)
        if cruises.any():
            d_gap = -d_base
            d_gap[TIME] += steep - top
            d_full = 2 * half * d_gap / full
            d_full[TIME] += full / 2
            d_held_for = d_gap / steepest
            d_held_for[TIME] += c * steepest / 2
            d_level = np.where(cruises, np.where(held_at_limit, 0.0, d_full), d_level)
            d_hold = np.where(cruises, np.where(held_at_limit, d_held_for, 0.0), d_hold)
        return d_level, d_hold


def _of_both(ends: Array) -> Array:
    """Return the sum over both ends; `sum` takes three times as long for two rows."""
    return ends[0] + ends[1]


def _half(c: Array) -> Array:
    """Return `1/(2c)`; 1/2 without a jerk limit, where it is not used."""
    return 0.5 / np.where(c > 0, c, 1.0)
