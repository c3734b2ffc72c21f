"""The extreme profiles of one joint without a jerk limit (mathematics, section 3).

Between two velocities, which motion of time `t` covers most displacement, and which least? Both
speed up or brake to a peak, cruise, and go on to the other velocity at full acceleration. What lies
between both displacements is covered by a convex combination of their velocities.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.exact.rounded import apart

Array = NDArray[np.float64]

_MISS_RTOL = 1e-13  # of the way a joint travels: more than rounding, as the judge counts it
_WIDTH_RTOL = 1e-15  # an interval of displacements as narrow as its rounding is a point
_NO_SHARE = 1e-12  # a profile of which there is so little in a motion adds nothing to it
_SLIVER = 1e-9  # of a segment: pieces that short come from IPOPT's tolerance, not from the optimum


class Extremes(NamedTuple):
    """Peaks and displacements of the upper and the lower profile, arrays of one shape."""

    p_up: Array
    d_up: Array
    p_lo: Array
    d_lo: Array


def extremes(
    u: Array,
    w: Array,
    t: Array,
    v: Array,
    a: Array,
) -> Extremes:
    """The profiles of most and of least displacement (mathematics, section 3).

    Meaningful where `|w − u|` is within the acceleration limits. All arguments broadcast.

    Args:
        u: velocity at the start.
        w: velocity at the end.
        t: time of the segment.
        v: velocity limits, low and high.
        a: acceleration limits, low and high.
    """
    v1 = -v[0]
    v2 = v[1]
    a1 = -a[0]
    a2 = a[1]

    # the peak where both ramps fill the segment: (A1 A2 T + A1 u + A2 w) / (A1 + A2)
    sum_a = a1 + a2
    gained = a1 * a2 * t
    weighted = gained + a1 * u + a2 * w
    p_up = np.minimum(v2, weighted / sum_a)
    # D_up(p) = p T − (p − u)² / (2 A2) − (p − w)² / (2 A1)
    first = (p_up - u) ** 2 / (2 * a2)
    last = (p_up - w) ** 2 / (2 * a1)
    d_up = p_up * t - first - last

    # downwards: (A2 u + A1 w − A1 A2 T) / (A1 + A2)
    weighted = a2 * u + a1 * w - gained
    p_lo = np.maximum(-v1, weighted / sum_a)
    # D_lo(p) = p T + (p − u)² / (2 A1) + (p − w)² / (2 A2)
    first = (p_lo - u) ** 2 / (2 * a1)
    last = (p_lo - w) ** 2 / (2 * a2)
    d_lo = p_lo * t + first + last
    return Extremes(p_up, d_up, p_lo, d_lo)


class Polygon(NamedTuple):
    """A velocity profile: straight between its four knots."""

    knots: Array
    velocities: Array

    @property
    def displacement(self) -> float:
        lengths = np.diff(self.knots)
        return float(_travelled(self.velocities, lengths)[-1])

    def at(self, times: Array) -> Array:
        return np.interp(times, self.knots, self.velocities)


class Fit(NamedTuple):
    """A motion over given breaks, by its accelerations and its state before each piece.

    `miss` is what its displacement differs from the one asked for, `path` the way it travels.
    """

    acceleration: Array
    velocity: Array
    position: Array
    miss: float
    path: float


class Reach(NamedTuple):
    """What one joint can do in one segment: both extreme profiles, and its acceleration limits."""

    upper: Polygon
    lower: Polygon
    a: Array  # low and high

    @classmethod
    def between(
        cls,
        u: float,
        w: float,
        t: float,
        v: Array,
        a: Array,
    ) -> Reach:
        """The reach between two velocities.

        Args:
            u: velocity at the start.
            w: velocity at the end.
            t: time of the segment.
            v: velocity limits, low and high.
            a: acceleration limits, low and high.
        """
        both = extremes(
            np.array(u),
            np.array(w),
            np.array(t),
            v,
            a,
        )
        p_up, _, p_lo, _ = map(float, both)
        # where the cruises of the upper and the lower profile begin and end
        braking, speeding = a
        upper_cruise = [
            (p_up - u) / speeding,
            t + (p_up - w) / braking,
        ]
        lower_cruise = [
            (p_lo - u) / braking,
            t + (p_lo - w) / speeding,
        ]
        upper_cruise = np.clip(upper_cruise, 0, t)
        lower_cruise = np.clip(lower_cruise, 0, t)
        upper = Polygon(
            knots=np.r_[0, upper_cruise, t],
            velocities=np.array([u, p_up, p_up, w]),
        )
        lower = Polygon(
            knots=np.r_[0, lower_cruise, t],
            velocities=np.array([u, p_lo, p_lo, w]),
        )
        return cls(upper, lower, a)

    def breaks(self, h: float) -> Array:
        """The times between which acceleration is constant, for a displacement `h`.

        Pieces that are nothing but IPOPT's tolerance are left out, where `h` is covered without
        them as well as with them, and so are the knots of a profile that has no share in it.
        """
        share = _share(h, self.upper.displacement, self.lower.displacement)
        used = []
        if share > _NO_SHARE:
            used.append(self.upper.knots)
        if share < 1 - _NO_SHARE:
            used.append(self.lower.knots)
        knots = np.concatenate(used)
        t = knots[-1]
        every = apart(knots, t, 0.0)
        fewer = apart(knots, t, _SLIVER * t)
        if len(fewer) == len(every):
            return every
        all_fitted = self.fitted(every, h)
        fitted = self.fitted(fewer, h)
        as_close = fitted.miss <= all_fitted.miss + _MISS_RTOL * fitted.path
        braking, speeding = self.a
        steepest = np.where(fitted.acceleration > 0, speeding, braking)
        utilisation = fitted.acceleration / steepest
        within = (utilisation <= 1 + _SLIVER).all()
        return fewer if as_close and within else every

    def covering(self, h: float, breaks: Array) -> Array:
        """The motion that covers `h`, between these breaks.

        Args:
            h: displacement, between `D_lo` and `D_up`.
            breaks: from 0 to the segment's time, `(pieces + 1,)`.

        Returns:
            Position coefficients since the segment's start `(3, pieces)`.
        """
        fitted = self.fitted(breaks, h)
        # over a brief piece, rounding of the velocities shows
        acceleration = np.clip(fitted.acceleration, *self.a)
        return np.stack([acceleration / 2, fitted.velocity, fitted.position])

    def fitted(self, breaks: Array, h: float) -> Fit:
        """The convex combination of both profiles, as these breaks have them, that covers `h`."""
        lengths = np.diff(breaks)
        upper = self.upper.at(breaks)
        lower = self.lower.at(breaks)
        d_up = _travelled(upper, lengths)[-1]
        d_lo = _travelled(lower, lengths)[-1]
        # v(t) = λ v_up(t) + (1 − λ) v_lo(t)
        share = _share(h, d_up, d_lo)
        velocity = share * upper + (1 - share) * lower
        travelled = _travelled(velocity, lengths)
        before = velocity[:-1]
        after = velocity[1:]
        mean_speed = np.abs(before + after) / 2
        return Fit(
            acceleration=(after - before) / lengths,
            velocity=before,
            position=np.r_[0.0, travelled[:-1]],
            miss=abs(travelled[-1] - h),
            path=float(lengths @ mean_speed),
        )


def _travelled(velocity: Array, lengths: Array) -> Array:
    """The displacement after each piece."""
    # Δq = Δt (v0 + v1)/2
    sums = velocity[:-1] + velocity[1:]
    return np.cumsum(lengths * sums / 2)


def _share(h: float, d_up: float, d_lo: float) -> float:
    """The share of the upper profile that covers `h`; any will do where both are one."""
    # λ = (h − D_lo) / (D_up − D_lo)
    width = d_up - d_lo
    rounding = _WIDTH_RTOL * (abs(d_up) + abs(d_lo))
    if width <= rounding:
        return 1.0
    share = (h - d_lo) / width
    return float(np.clip(share, 0.0, 1.0))
