"""The extreme profiles of one joint under a jerk limit (mathematics, section 4). NumPy alone.

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

from trajopt import polynomials

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
State = tuple[Array, Array]  # velocity, acceleration
Pieces = tuple[Array, Array]  # breaks, and position coefficients (4, pieces)

_BISECTIONS = 50  # of an interval of order one: to rounding
_BLOCKED = 1e-9  # of a segment: time that a profile without a cruise may leave over
_HARDLY = 1e-2  # of a joint's acceleration, and of a segment's time
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

    def within(self, limit: Limit) -> Bools:
        """Whether there is such a profile, and its peak keeps the velocity limit."""
        return np.asarray((self.slack >= 0) & (self.peak <= limit.velocity))

    def avoids_zero(self, t: Array) -> Bools:
        """Whether it hardly passes through acceleration 0."""
        low = np.minimum(self.rise, self.fall) < _HARDLY
        return np.asarray(low & (self.cruise < _HARDLY * t))


class Extremes(NamedTuple):
    """The profile of most displacement, and the mirrored one of least."""

    upper: Profile
    lower: Profile

    def at(self, *index: int) -> Extremes:
        """One entry of all arrays."""
        return Extremes(*(Profile(*(x[index] for x in profile)) for profile in self))

    def reach(self, h: Array, sides: Sides) -> Bools:
        """Whether displacement `h` lies between both, and both keep their limits."""
        kept = self.upper.within(sides[0]) & self.lower.within(sides[1])
        return kept & (-self.lower.displacement <= h) & (h <= self.upper.displacement)

    def share(self, h: Array) -> Array:
        """The share of the upper profile that covers `h`; any will do where both are one."""
        least = -self.lower.displacement
        width = np.maximum(self.upper.displacement - least, _TINY)
        return np.asarray(np.clip((h - least) / width, 0.0, 1.0))


def extremes(start: State, end: State, t: Array, sides: Sides) -> Extremes:
    """Both extreme profiles between two states in time `t`, all broadcasting."""
    (u, a), (w, b) = start, end
    return Extremes(highest((u, a), (w, -b), t, sides[0]), highest((-u, -a), (-w, b), t, sides[1]))


def highest(start: State, end: State, t: Array, limit: Limit) -> Profile:
    """The profile of most displacement in time `t`, `end` being seen backwards in time.

    One number decides it, found by bisection: see `_Family`.
    """
    family = _Family(start, end, t, limit)
    low, high = np.full(family.shape, -1.0), np.full(family.shape, 1.0)
    low = np.where(family.at(high).slack >= 0, high, low)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        fits = family.at(middle).slack >= 0
        low, high = np.where(fits, middle, low), np.where(fits, high, middle)
    found = family.at(low)
    blocked = (low < 0) & (found.slack > _BLOCKED * t)  # too long for one kind, short for the other
    return found._replace(slack=np.where(blocked, -found.slack, found.slack))


class _Family:
    """The candidates between two states, one for every number `z` from −1 to 1.

    From 0 to 1 the peak grows, from the least one to the limit. From −1 to 0 it is the acceleration
    that stays below 0 which grows: the fall's if that is `late`, else the rise's.
    """

    def __init__(self, start: State, end: State, t: Array, limit: Limit) -> None:
        self.start, self.end, self.t, self.limit = start, end, t, limit
        self.c = limit.up + limit.down
        # where a rise would end that aims at acceleration 0
        bases = [u - a**2 * limit.up / 2 for u, a in (start, end)]
        gains = [self.c * np.maximum(a, 0) ** 2 / 2 for _, a in (start, end)]
        self.late, self.base = bases[1] > bases[0], np.maximum(*bases)
        self.least = np.maximum(bases[0] + gains[0], bases[1] + gains[1])
        self.shape = self.least.shape
        self.weakest = np.minimum(np.where(self.late, end[1], start[1]), 0.0)
        fallen = np.sqrt(2 * (self.least - self.base) / np.where(self.c > 0, self.c, np.inf))
        self.nearest = np.maximum(-fallen, self.weakest)
        steepest = np.where(self.late, limit.fall, limit.rise)
        self.reach = np.clip(limit.velocity - self.least, 0.0, steepest * t)
        self.top = np.maximum(limit.velocity, self.least)  # least + reach, but for rounding

    def at(self, z: Array) -> Profile:
        """The candidate `z`; its slack is negative where it takes longer than `t`."""
        up, down = self.limit.up, self.limit.down
        below = self.nearest - np.minimum(z, 0.0) * (self.weakest - self.nearest)
        raised = np.minimum(self.least + np.maximum(z, 0.0) * self.reach, self.top)
        peak = np.where(z < 0, self.base + self.c * below**2 / 2, raised)
        apart = (self.c > 0) & (z < 0)
        rise, rise_hold = self._ascent(self.start, peak, self.limit.rise, apart & ~self.late, below)
        fall, fall_hold = self._ascent(self.end, peak, self.limit.fall, apart & self.late, below)
        _, before, ascended = risen(*self.start, rise, rise_hold, up, down)
        _, after, descended = risen(*self.end, fall, fall_hold, up, down)
        slack = self.t - before - after
        cruise = np.maximum(slack, 0.0)
        displacement = ascended + cruise * peak + descended
        return Profile(rise, fall, rise_hold, cruise, fall_hold, peak, displacement, slack)

    def _ascent(self, state: State, peak: Array, most: Array, apart: Bools, below: Array) -> State:
        """Acceleration and hold of the quickest rise to `peak`; of one `apart` from 0, `below`."""
        u, a = state
        gap = np.maximum(peak - u + a**2 * self.limit.up / 2, 0.0)
        full = np.where(self.c > 0, np.sqrt(2 * gap / np.maximum(self.c, _TINY)), np.inf)
        hold = np.where(full > most, (gap - most**2 * self.c / 2) / most, 0.0)
        return np.where(apart, below, np.minimum(full, most)), np.where(apart, 0.0, hold)


def risen(u: Any, a: Any, rise: Any, hold: Any, up: Any, down: Any) -> tuple[Any, Any, Any]:
    """Peak, time and displacement of a rise from velocity `u`, acceleration `a`; CasADi's too.

    To acceleration `rise` at jerk `1/up`, held for `hold`, then to 0 at jerk `−1/down`.
    """
    first, last = (rise - a) * up, rise * down
    v1 = u + first * (a + rise) / 2
    v2 = v1 + rise * hold
    held = (v1 + v2) / 2 * hold
    moved = first * (u + first * (2 * a + rise) / 6) + held + last * (v2 + rise * last / 3)
    return v2 + rise * last / 2, first + hold + last, moved


def combined(states: Array, t: float, h: Array, both: Extremes, sides: Sides) -> Pieces:
    """The convex combination of one segment's extreme profiles that covers exactly `h`.

    `states` are the velocities and accelerations at its ends, `(2, 2)`.
    """
    (u, _), (a, b) = states
    share = float(both.share(h))
    upper = _phases(both.upper, (u, a), -b, sides[0])
    lower = _phases(both.lower, (-u, -a), b, sides[1])
    breaks = np.unique(np.clip(np.r_[upper[0], lower[0], t], 0.0, t))
    high, low = (_resampled(pieces, breaks) for pieces in (upper, lower))
    return breaks, share * high - (1 - share) * low


def _phases(profile: Profile, start: State, b: Array, limit: Limit) -> Pieces:
    """The seven phases of an extreme profile from `start` to acceleration `−b`: starts, cubics."""
    rise, fall, up, down = map(float, (profile.rise, profile.fall, limit.up, limit.down))
    between = float(np.clip(0.0, -fall, rise))
    levels = np.array([start[1], rise, rise, between, between, -fall, -fall, -b])
    ramps = np.abs(np.diff(levels)[::2]) * [up, down, down, up]
    holds = np.array([profile.rise_hold, profile.cruise, profile.fall_hold, 0.0], dtype=float)
    lengths = np.stack([ramps, holds], axis=1).ravel()[:7]
    jerks = np.array([1 / up, 0.0, -1 / down, 0.0, -1 / down, 0.0, 1 / up])
    first, last = levels[:-1], levels[1:]
    velocity = _accumulated(start[0], lengths * (first + last) / 2)
    position = _accumulated(0.0, lengths * (velocity + lengths * (2 * first + last) / 6))
    return _accumulated(0.0, lengths), np.stack([jerks / 6, first / 2, velocity, position])


def _accumulated(start: Array | float, steps: Array) -> Array:
    """The value before each step."""
    return np.asarray(start + np.r_[0.0, np.cumsum(steps[:-1])])


def _resampled(pieces: Pieces, breaks: Array) -> Array:
    """Coefficients of the same profile between these breaks, its own among them."""
    starts, coefficients = pieces
    middle = (breaks[:-1] + breaks[1:]) / 2
    at = np.searchsorted(starts, middle, side="right") - 1
    return polynomials.shifted(coefficients[:, at], breaks[:-1] - starts[at])
