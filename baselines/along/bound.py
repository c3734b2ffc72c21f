"""A lower bound on the time along a path, under limits without jerk.

Let `b = w²` be any squared speed along the path, `x = b'/2`, and `p(σ)` any continuous function
that is 0 at both ends. Then `∫ (p b)' dσ = 0`, so the time is

    ∫ 1/√b dσ = ∫ (1/√b + p' b + 2 p x) dσ ≥ ∫ min over (b, x) that rows allow at σ of that.

The function is the program's costate, from its multipliers. At each point the minimum over `x` is
at the lowest or highest acceleration that rows allow, and what is left is convex in `b`. The
integral is Gauss's: the bound is computed, not proved. It holds under jerk limits too, which it
leaves out.
"""

from __future__ import annotations

import numpy as np

from baselines.along.ceilings import fastest, room
from baselines.along.engine import PathTiming, timed
from baselines.along.law import law
from baselines.along.path import parts
from baselines.along.program import End
from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.trajectory import Trajectory

# Of the highest speed, so that rounding does not make it infeasible; and of it, the lowest.
_WITHIN, _LOWEST = 1 - 1e-9, 1e-9
_GAUSS = np.polynomial.legendre.leggauss(4)
_GOLDEN = (5**0.5 - 1) / 2
_CUTS = 80
# A bound that is at least this share of the motion's duration is not sought to be better.
_NEAR = 0.98
# Intervals at both ends in which the costate is 0, tried in turn.
_IDLE = (0, 1, 2, 4, 8, 16)


def bound(trajectory: Trajectory, limits: Limits, accuracy: float) -> float | None:
    """Return a time, s, that no motion along a path falls below; None where none is known.

    Limits of jerk are left out. A row that damps (`c_v w` beside others) has no such bound.

    Raises:
        NoMotionError, NoLawError: As the engine.
    """
    free = limits.without("jerk")
    found, _ = parts(trajectory, free)
    total = 0.0
    for path in found:
        timing = timed(path, free, (End(), End()), accuracy)
        own = _of_part(timing, free)
        if own is None:
            return None
        total += own
    return total


def _of_part(timing: PathTiming, limits: Limits) -> float | None:
    """Return the bound of a part without stops; None where a row damps, or knows jerk.

    Beside an end where the path stands no row bounds the speed. There the rounding of the costate
    may make the minimum negative: then it is set to 0 in some intervals, which costs little.
    """
    program, path = timing.program, timing.path
    knots = program.knots
    sigma = np.r_[knots[0], (knots[1:] + knots[:-1]) / 2, knots[-1]]
    at = np.union1d(knots, sigma)
    shares, weights = _GAUSS
    points = (at[:-1, None] + np.diff(at)[:, None] * (shares + 1) / 2).ravel()
    size = (np.diff(at)[:, None] * weights / 2).ravel()
    states = path.at(points, path.pieces_at(points))
    rows = law(limits, states, path.curve.segments_at(path.s(points)[0]), timing.unit)
    damped = rows.slow[1].any(axis=0) & rows.slow[3].any(axis=0)
    if rows.jerk.size or damped.any():
        return None
    k = np.clip(np.searchsorted(sigma, points) - 1, 0, len(sigma) - 2)
    best = 0.0
    for idle in (*_IDLE, program.count):
        costate = np.r_[0.0, program.costate, 0.0]
        costate[: idle + 1] = costate[len(costate) - 1 - idle :] = 0.0
        slope = (np.diff(costate) / np.diff(sigma))[k]
        least = _least(rows.slow, slope, 2 * np.interp(points, sigma, costate))
        best = max(best, float(least @ size))
        if best > _NEAR * timing.motion.duration:
            break
    return best


def _least(rows: Array, slope: Array, rate: Array) -> Array:
    """Return the least `1/√b + slope b + rate x` that rows allow at each point, `(points,)`."""
    top = np.log(fastest(rows) * _WITHIN)

    def value(logarithm: Array) -> Array:
        w = np.exp(logarithm)
        below, above = room(rows, w)
        with np.errstate(invalid="ignore"):
            turned = np.where(rate == 0, 0.0, rate * np.where(rate > 0, below, above))
        return np.where(below > above, np.inf, 1 / w + slope * w**2 + turned)

    low, high = top + np.log(_LOWEST), top
    for _ in range(_CUTS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        lower = value(left) < value(right)
        low, high = np.where(lower, low, left), np.where(lower, right, high)
    return value((low + high) / 2)
