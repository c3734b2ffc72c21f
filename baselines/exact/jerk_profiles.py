"""The extreme profiles of one joint under a jerk limit (mathematics, section 4).

Between two states (velocity, acceleration), which profile of time `t` covers most displacement?

A *rise* from `(u, a)` takes the acceleration to `A` with the jerk limit upwards `J2`, holds it for
`d`, and returns it to 0 with the jerk limit downwards `J1`. With `r = 1/J` it ends at the peak

    p = u − r2 a²/2 + (r1 + r2) A²/2 + A d.

Backwards in time velocity and jerk keep their signs and acceleration changes its own. So the *fall*
from the peak to `(w, −b)` is, backwards, a rise from `(w, b)` under the same jerk limits, and the
profile is rise, cruise, fall: seven phases with jerk `+ 0 − 0 − 0 +`. Each rise is the quickest to
its peak, held only at its acceleration limit. A higher peak covers more and leaves less time for
the cruise: the peak is the highest that time and velocity limit allow.

Where even the least peak leaves no time, the acceleration stays below 0 in between. Then one rise
aims at an `A < 0`, without a hold, and its return to 0 takes negative time, which the other rise's
return gives back: both together go straight from `A` to the other's deceleration, and the formulas
hold as they stand.

Asymmetric limits: a rise has the upper acceleration limit, a fall the lower one, both the same two
jerk limits. The least displacement is the most of the mirrored joint: all states change their signs
and all limits their sides. Without a jerk limit (`r = 0`) ramps take no time: section 3.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
State = tuple[Array, Array]  # velocity, acceleration

BRIEF = 1e-3  # of the mean stop time: a segment over which jerk may be taken as constant

_BISECTIONS = 50  # of an interval of order one: to rounding
_BLOCKED = 1e-9  # of a segment: time that a profile without a cruise may leave over
_NEAR_ZERO = 1e-2  # of a joint's acceleration, and of a segment's time
_ROUNDING_RTOL = 4e-16  # of the largest term of a sum
_TINY = 1e-300  # instead of dividing by 0


class Limit(NamedTuple):
    """What bounds one side: peak velocity, rise and fall, inverse jerk upwards and downwards."""

    velocity: Array
    rise: Array
    fall: Array
    up: Array
    down: Array

    def at(self, joint: int) -> Limit:
        """Those of one joint."""
        return Limit(*(x[joint] for x in self))


Sides = tuple[Limit, Limit]  # of the upper profile, and of the mirrored lower one


class Profile(NamedTuple):
    """An extreme profile: a rise, a cruise and a rise backwards. Arrays broadcast alike."""

    rise: Array  # acceleration held in the rise
    fall: Array  # deceleration held in the fall
    rise_hold: Array
    cruise: Array
    fall_hold: Array
    peak: Array  # velocity
    displacement: Array
    slack: Array  # time left over by the quickest profile of this kind: negative if there is none
    displacement_rounding: Array
    slack_rounding: Array

    def within(self, limit: Limit) -> Bools:
        """Whether there is such a profile, and its peak keeps the velocity limit."""
        in_time = self.slack >= -self.slack_rounding
        slow_enough = self.peak <= limit.velocity
        return np.asarray(in_time & slow_enough)

    def avoids_zero(self, t: Array) -> Bools:
        """Whether it hardly passes through acceleration 0."""
        lower = np.minimum(self.rise, self.fall)
        brief = self.cruise < _NEAR_ZERO * t
        return np.asarray((lower < _NEAR_ZERO) & brief)


class Extremes(NamedTuple):
    """The profile of most displacement, and the mirrored one of least."""

    upper: Profile
    lower: Profile

    @property
    def d_up(self) -> Array:
        """The most displacement."""
        return self.upper.displacement

    @property
    def d_lo(self) -> Array:
        """The least displacement."""
        return -self.lower.displacement

    def at(self, *index: int) -> Extremes:
        """One entry of all arrays."""
        profiles = [Profile(*(x[index] for x in profile)) for profile in self]
        return Extremes(*profiles)

    def reach(self, h: Array, sides: Sides) -> Bools:
        """Whether displacement `h` lies between both, and both keep their limits, to rounding.

        Over a segment of 1e-6 of the others' time all that jerk can change is 1e-18 of a
        displacement: less than rounding where the terms of a profile cancel.
        """
        upper_side, lower_side = sides
        upper_within = self.upper.within(upper_side)
        lower_within = self.lower.within(lower_side)
        above_lowest = self.d_lo - h <= self.lower.displacement_rounding
        below_highest = h - self.d_up <= self.upper.displacement_rounding
        return upper_within & lower_within & above_lowest & below_highest

    def narrow(
        self,
        start: State,
        end: State,
        t: Array,
        h: Array,
    ) -> Bools:
        """Whether the motion is one of constant jerk, and all that jerk can change is rounding."""
        u, a = start
        w, b = end
        # h = u T + a T²/2 + (b − a) T²/6
        cruised = u * t
        sped = a * t**2 / 2
        jerked = (b - a) * t**2 / 6
        displacement = cruised + sped + jerked
        # w = u + (a + b) T/2
        velocity = u + (a + b) * t / 2

        missed = np.abs(displacement - h)
        gained = np.abs(velocity - w) * t
        width = self.d_up - self.d_lo
        largest = np.maximum(missed, gained)
        largest = np.maximum(largest, width)
        upper_rounding = self.upper.displacement_rounding
        lower_rounding = self.lower.displacement_rounding
        rounding = 4 * (upper_rounding + lower_rounding)
        return np.asarray(largest <= rounding)

    def share(self, h: Array) -> Array:
        """The share of the upper profile that covers `h`; any will do where both are one."""
        # λ = (h − D_lo) / (D_up − D_lo)
        width = np.maximum(self.d_up - self.d_lo, _TINY)
        share = (h - self.d_lo) / width
        return np.asarray(np.clip(share, 0.0, 1.0))


def extremes(
    start: State,
    end: State,
    t: Array,
    sides: Sides,
) -> Extremes:
    """Both extreme profiles between two states in time `t`, all broadcasting."""
    u, a = start
    w, b = end
    upper_side, lower_side = sides
    # the upper one and the mirrored lower one in one go, on an axis of their own
    shape = np.broadcast_shapes(
        np.shape(u),
        upper_side.velocity.shape,
    )
    starts = (
        _pair(u, -u, shape),
        _pair(a, -a, shape),
    )
    ends = (
        _pair(w, -w, shape),
        _pair(-b, b, shape),
    )
    limits = []
    for upper_limit, lower_limit in zip(upper_side, lower_side, strict=True):
        pair = _pair(
            upper_limit,
            lower_limit,
            shape,
        )
        limits.append(pair)
    both = highest(
        starts,
        ends,
        t,
        Limit(*limits),
    )
    upper = []
    lower = []
    for one, other in both:
        upper.append(one)
        lower.append(other)
    return Extremes(
        Profile(*upper),
        Profile(*lower),
    )


def _pair(one: Array, other: Array, shape: tuple[int, ...]) -> Array:
    """Both on a first axis, each broadcast to this shape."""
    pair = np.empty((2, *shape))
    pair[0] = one
    pair[1] = other
    return pair


def highest(
    start: State,
    end: State,
    t: Array,
    limit: Limit,
) -> Profile:
    """The profile of most displacement in time `t`, `end` being seen backwards in time.

    One number decides it, found by bisection: see `_Family`.
    """
    family = _Family(start, end, t, limit)
    low = np.full(family.shape, -1.0)
    high = np.full(family.shape, 1.0)
    # the highest candidate of all, where it leaves time
    fits = family.slack(high) >= 0
    low = np.where(fits, high, low)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        fits = family.slack(middle) >= 0
        low = np.where(fits, middle, low)
        high = np.where(fits, high, middle)
    profile = family.at(low)
    # too long for a profile through acceleration 0, too short for one that stays below it
    slack = profile.slack
    left_over = slack > _BLOCKED * t
    blocked = (low < 0) & left_over
    return profile._replace(slack=np.where(blocked, -slack, slack))


class _Family:
    """The candidates between two states, one for every number `z` from −1 to 1.

    From 0 to 1 the peak grows, from the lowest one to the limit. From −1 to 0 it is the
    acceleration that stays below 0 which grows, from `deep` to `shallow`: the fall's if that is
    `late`, else the rise's. Arrays of both, of the rise and of the fall, have them on a first axis.
    """

    def __init__(
        self,
        start: State,
        end: State,
        t: Array,
        limit: Limit,
    ) -> None:
        self.t = t
        self.up = limit.up
        self.down = limit.down
        u, a = start
        w, b = end
        shape = np.broadcast_shapes(
            np.shape(u),
            limit.velocity.shape,
        )
        velocity = _pair(u, w, shape)
        acceleration = _pair(a, b, shape)
        steepest = _pair(
            limit.rise,
            limit.fall,
            shape,
        )
        r2 = limit.up
        c = r2 + limit.down
        # u − r2 a²/2: the peak of a rise that aims at acceleration 0
        lifted = acceleration**2 * r2 / 2
        bases = velocity - lifted
        rise_base, fall_base = bases
        late = fall_base > rise_base
        base = bases.max(axis=0)
        # and (r1 + r2) a²/2 more: the lowest peak of a rise that starts with acceleration a > 0
        upwards = np.maximum(acceleration, 0)
        gains = c * upwards**2 / 2
        lowest = bases + gains
        lowest_peak = lowest.max(axis=0)

        self.velocity = velocity
        self.acceleration = acceleration
        self.steepest = steepest
        self.c = c
        self.base = base
        self.lowest_peak = lowest_peak
        self.shape = lowest_peak.shape
        # below 0: from no rise at all, to where base + (r1 + r2) A²/2 is the lowest peak
        own = np.where(late, b, a)
        self.deep = np.minimum(own, 0.0)
        finite_c = np.where(c > 0, c, np.inf)
        above_base = 2 * (lowest_peak - base)
        fallen = np.sqrt(above_base / finite_c)
        self.shallow = np.maximum(-fallen, self.deep)
        self.depth = self.deep - self.shallow
        # above 0: up to the velocity limit, or as far as time allows
        quickest = np.where(late, limit.fall, limit.rise)
        spare = limit.velocity - lowest_peak
        self.span = np.clip(spare, 0.0, quickest * t)
        self.top = np.maximum(limit.velocity, lowest_peak)  # lowest + span, but for rounding

        # what every candidate needs: r2 a²/2, (r1 + r2) A²/2 of the steepest, who stays below 0
        self.lifted = lifted
        self.ramped = steepest**2 * c / 2
        self.some_c = np.maximum(c, _TINY)
        self.jerky = c > 0
        staying = np.stack([~late, late])
        self.may_stay_below = staying & self.jerky

    def slack(self, z: Array) -> Array:
        """The time that candidate `z` leaves of `t`; negative where it takes longer."""
        _, rises, holds = self._ascents(z)
        # r2 (A − a) + d + r1 A
        first = (rises - self.acceleration) * self.up
        last = rises * self.down
        before, after = first + holds + last
        return np.asarray(self.t - before - after)

    def at(self, z: Array) -> Profile:
        """The candidate `z`; its slack is negative where it takes longer than `t`."""
        peak, rises, holds = self._ascents(z)
        _, times, displacements = risen(
            self.velocity,
            self.acceleration,
            rises,
            holds,
            self.up,
            self.down,
        )
        before, after = times
        ascended, descended = displacements
        slack = self.t - before - after
        cruise = np.maximum(slack, 0.0)
        # a rise to an acceleration below 0 returns in negative time: much may cancel
        all_times = self.t + np.abs(before) + np.abs(after)
        u, w = np.abs(self.velocity)
        speeds = u + w + np.abs(peak)
        rise, fall = rises
        rise_hold, fall_hold = holds
        return Profile(
            rise=rise,
            fall=fall,
            rise_hold=rise_hold,
            cruise=cruise,
            fall_hold=fall_hold,
            peak=peak,
            displacement=ascended + cruise * peak + descended,
            slack=slack,
            displacement_rounding=_ROUNDING_RTOL * all_times * speeds,
            slack_rounding=_ROUNDING_RTOL * all_times,
        )

    def _ascents(self, z: Array) -> tuple[Array, Array, Array]:
        """The peak of candidate `z`; accelerations and holds of the quickest rise and fall to it.

        Those of a rise that stays below 0 are given by `z`, without a hold.
        """
        is_below = z < 0
        negative = np.minimum(z, 0.0)
        positive = np.maximum(z, 0.0)
        below = self.shallow - negative * self.depth
        raised = self.lowest_peak + positive * self.span
        raised = np.minimum(raised, self.top)
        # p = u − r2 a²/2 + (r1 + r2) A²/2
        from_below = self.base + self.c * below**2 / 2
        peak = np.where(is_below, from_below, raised)
        # p − u + r2 a²/2 = (r1 + r2) A²/2 + A d
        gaps = np.maximum(peak - self.velocity + self.lifted, 0.0)
        # without a hold: A = sqrt(2 gap / (r1 + r2))
        without_hold = np.sqrt(2 * gaps / self.some_c)
        full = np.where(self.jerky, without_hold, np.inf)
        # with one, at the limit: d = (gap − (r1 + r2) A²/2) / A
        needed = (gaps - self.ramped) / self.steepest
        holds = np.where(full > self.steepest, needed, 0.0)
        through_zero = np.minimum(full, self.steepest)
        stays_below = self.may_stay_below & is_below
        rises = np.where(stays_below, below, through_zero)
        holds = np.where(stays_below, 0.0, holds)
        return peak, rises, holds


def risen(
    u: Any,
    a: Any,
    rise: Any,
    hold: Any,
    up: Any,
    down: Any,
) -> tuple[Any, Any, Any]:
    """A rise: to acceleration `rise` at jerk `1/up`, held, then to 0 at jerk `−1/down`.

    Args:
        u: velocity at its start; this and all others are numbers, arrays or CasADi's symbols.
        a: acceleration at its start.
        rise: acceleration `A` held.
        hold: time `d` of holding it.
        up: inverse jerk `r2` of the first ramp.
        down: inverse jerk `r1` of the last ramp.

    Returns:
        Peak velocity, time and displacement.
    """
    # t1 = r2 (A − a), t3 = r1 A
    first = (rise - a) * up
    last = rise * down
    # v1 = u + t1 (a + A)/2, v2 = v1 + A d
    v1 = u + first * (a + rise) / 2
    v2 = v1 + rise * hold
    # x1 = t1 (u + t1 (2a + A)/6)
    mean = u + first * (2 * a + rise) / 6
    ramped = first * mean
    # x2 = d (v1 + v2)/2
    held = (v1 + v2) / 2 * hold
    # x3 = t3 (v2 + t3 A/3)
    mean = v2 + rise * last / 3
    released = last * mean
    # p = v2 + t3 A/2
    peak = v2 + rise * last / 2
    duration = first + hold + last
    displacement = ramped + held + released
    return peak, duration, displacement
