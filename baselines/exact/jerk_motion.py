"""The jerk-limited motion through given waypoint states, between stored breaks (mathematics, 4).

In each segment a joint may take any convex combination of its two extreme profiles that covers the
displacement. Its acceleration is straight between breaks: evenly spaced ones, the same for all
joints, where the limits leave room for that, else those of its profiles. What a trajectory stores
are times since its start, rounded, so the breaks are rounded first, and the least change of the
accelerations at the inner ones makes up for what that costs.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from baselines.exact.acceleration_motion import covering
from baselines.exact.jerk_cells import Cells
from baselines.exact.jerk_structure import Settled, in_stored_time, settled, unsettled
from baselines.exact.rounded import (
    DISTINCT_RTOL,
    NO_PIECES,
    Pieces,
    assembled,
    clocks,
    outwards,
    through,
    together,
)
from baselines.exact.scaled import Scaled
from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify

# Evenly spaced pieces of a segment that are tried.
_EVEN = (1, 4, 8)
# Pieces of a profile that are left out where the limits allow it, as shares of a segment.
_SLIVERS = (1e-3, 1e-5, 1e-7, 0.0)
_BRIEFEST_S = 2e-10  # and those that last no longer in any case
# Or shorter than this share of a segment, where that is less.
_BRIEFEST_RTOL = 1e-3
# A break is left out where no limit is exceeded by more than this share.
_EXCESS_RTOL = 3e-10
_MISS_RTOL = 1e-14  # of velocities: what the end may be missed by
# A phase vanishes where it keeps less than the first share of its length, in cells whose reach
# leaves less than the second one: the first pair that serves.
_VANISHING = ((0.5, 1.0), (0.2, 1.0), (0.2, 1e-7))
# Dilations of the optimum as it is, tried when nothing else serves.
_SLOWER = 1 + np.array([0, 1e-9, 2e-9, 5e-9, 1e-8, 2e-8, 5e-8, 1e-7, 1e-6])
# Its states are put on a limit that they miss by less than this, in units of the velocity that the
# segment allows: for limits of acceleration by the ramp to them, and for limits of velocity.
_NEAR_LIMIT = 1e-11
_NEAR_TOP = 1e-8
# They also miss it by less than this share of the acceleration.
_NEARBY = 1e-2
_ENOUGH = 1 + 1e-10  # certified duration, relative to the optimum's
# A profile with a smaller share is left out.
_ALONE = 1e-8
_TINY = 1e-300  # instead of dividing by 0


class _Cells(NamedTuple):
    """The combinations of extreme profiles, a cell on the last axis.

    Attributes:
        ends: velocities at the start and at the end, `(2, cells)`.
        h: displacements.
        knots: of both profiles, since the segment's start, `(8, 2 sides, cells)`.
        levels: accelerations there, straight in between.
        stored: knots of tight cells as they are stored, s, `(8, cells)`; not a number in others.
        share: of the upper profile.
        velocity: limits, low and high, `(2, cells)`.
        acceleration: likewise.
        jerk: likewise.
        rounding: of the waypoints.
        start: of the segment, s.
        end: of the segment, s.
    """

    ends: Array
    h: Array
    knots: Array
    levels: Array
    stored: Array
    share: Array
    velocity: Array
    acceleration: Array
    jerk: Array
    rounding: Array
    start: Array
    end: Array

    def of(self, some: NDArray[np.intp]) -> Self:
        """Some of the cells."""
        return type(self)(*(table[..., some] for table in self))

    def accelerations(self, times: Array) -> Array:
        """Accelerations at times since the segments' starts, `(times, cells)`."""
        passed = (times[:, None, None] - self.knots[:-1]) / np.diff(self.knots, axis=0)
        steps = np.diff(self.levels, axis=0) * np.clip(
            np.nan_to_num(passed),
            0.0,
            1.0,
        )
        high, low = np.moveaxis(self.levels[0] + steps.sum(axis=1), 1, 0)
        inner = self.share * high + (1 - self.share) * low
        first, last = self.levels[[0, -1], 0]
        inner = np.where(
            times > 0,
            inner,
            first,
        )
        return np.where(
            times < self.knots[-1, 0],
            inner,
            last,
        )


class _Fit(NamedTuple):
    """Motions of some cells.

    Attributes:
        stored: breaks, s, those after the segment's end repeat it, `(pieces + 1, cells)`.
        cubics: position coefficients, `(4, pieces, cells)`.
        excess: the share by which they pass a limit.
    """

    stored: Array
    cubics: Array
    excess: Array


class Reachable(Scaled):
    """A problem without units, and the motions through given waypoint states."""

    def trajectory(self, times: Array, states: Array) -> Trajectory:
        """The motion of an optimum: of those without the phases that vanish, the certified one.

        Args:
            times: of the segments, on the way to the optimum and there, `(2, segments)`.
            states: of the inner waypoints likewise, `(2, 2, segments - 1, joints)`.
        """
        within = self.problem.without("position")
        enough = _ENOUGH * self.unit * times[-1].sum()
        shortest = np.inf
        for optimum in self._settled(times, states):
            if self.unit * optimum.times.sum() >= shortest:
                continue  # none is certified below its own duration
            own = motion(self, optimum)
            certified = verify(within, own).certified_duration or np.inf
            if certified < shortest:
                best = own
                shortest = certified
            if shortest <= enough:
                break
        return best

    def _settled(self, times: Array, states: Array) -> Iterator[Settled]:
        """The optimum without the phases that vanish, and as it is."""
        if self.r.all():
            for most, near in _VANISHING:
                yield settled(
                    self,
                    times,
                    states,
                    most,
                    near,
                )
        velocity, acceleration = _at_limits(
            self,
            times[-1],
            *states[-1],
        )
        put = np.array([[velocity, acceleration]])
        for k in _SLOWER:
            slower = np.array([k, k**2])[:, None, None]
            yield unsettled(k * times, put / slower)


def motion(scaled: Scaled, optimum: Settled) -> Trajectory:
    """The motion of an optimum in the units of its problem."""
    passages = np.r_[0.0, np.cumsum(optimum.times * scaled.unit)]
    cells = _cells(
        scaled,
        in_stored_time(scaled, optimum, passages),
        passages,
    )
    fits = iter(_fitted(cells, scaled.unit, DISTINCT_RTOL * passages[-1]))
    segments = []
    for k, clock in enumerate(clocks(passages, scaled.unit)):
        pieces = []
        for i, jerky in enumerate(scaled.r.any(axis=0)):
            stored, part = next(fits)
            if not jerky and clock.length > 0:
                cell = k * len(scaled.units[0]) + i
                stored, part = covering(
                    cells.h[cell],
                    cells.ends[:, cell],
                    scaled.v[:, i],
                    scaled.a[:, i],
                    clock,
                )
            powers = len(part)
            pieces.append((stored, part * scaled.units[-powers:, i, None]))
        segments.append(pieces)
    return assembled(scaled.problem, passages, segments)


def _at_limits(
    scaled: Scaled,
    times: Array,
    velocity: Array,
    acceleration: Array,
) -> tuple[Array, Array]:
    """Return the states, those that hardly differ from a limit put on it.

    The velocity that such a ramp gains is the square of the difference.

    So is what acceleration differs from 0 by where a joint cruises through a waypoint.
    """
    briefer = np.minimum(
        times[:-1],
        times[1:],
    )[:, None]
    slowest = np.maximum(
        scaled.r.max(axis=0),
        _TINY,
    )
    a1, a2 = scaled.a
    v1, v2 = scaled.v
    # change of the states that the limits allow in the briefer segment
    room = np.minimum(
        np.minimum(a2, -a1),
        briefer / slowest,
    )
    fast = np.minimum(
        np.minimum(v2, -v1),
        room * briefer,
    )
    # a ramp to the limit gains the velocity (A − a)² r / 2
    near = np.sqrt(_NEAR_LIMIT * fast / slowest)
    near = np.minimum(near, _NEARBY * room)
    acceleration = np.where(
        a2 - acceleration <= near,
        a2,
        acceleration,
    )
    acceleration = np.where(
        acceleration - a1 <= near,
        a1,
        acceleration,
    )
    steady = acceleration**2 * slowest <= _NEAR_TOP * fast
    steady &= np.abs(acceleration) <= _NEARBY * room
    at_high = steady & (v2 - velocity <= _NEAR_TOP * fast)
    at_low = steady & (velocity - v1 <= _NEAR_TOP * fast)
    velocity = np.where(
        at_high,
        v2,
        np.where(at_low, v1, velocity),
    )
    return velocity, np.where(
        at_high | at_low,
        0.0,
        acceleration,
    )


def _cells(scaled: Scaled, optimum: Settled, passages: Array) -> _Cells:
    """The combinations of extreme profiles, those of a segment one after another.

    Those of tight cells are profiles alone.
    """
    times = optimum.times
    velocity, acceleration = optimum.states[:, None]
    t = np.where(
        times > 0,
        times,
        1.0,
    )[None]
    rows = Cells(scaled).rows(t, velocity[:, 1:-1], acceleration[:, 1:-1])
    profiles = rows.profiles
    a, b = profiles.acceleration
    rise, fall = profiles.rises
    peak = np.clip(
        0.0,
        -fall,
        rise,
    )
    (ramp, _), (hold, last_hold), (release, pull), (cruise, _) = rows.phases
    phases = np.array([ramp, hold, release, cruise, pull, last_hold])
    knots = np.cumsum(
        np.maximum(
            phases,
            0.0,
        ),
        axis=0,
    )
    whole = np.ones_like(knots[:1])
    knots = np.concatenate(
        [
            0 * whole,
            np.minimum(
                knots,
                1.0,
            ),
            whole,
        ]
    )
    # the sides are mirrored
    sides = np.array([1.0, -1.0])[:, None, None, None]
    levels = sides * np.array([a, rise, rise, peak, peak, -fall, -fall, -b])
    high, low = np.maximum(
        rows.reach,
        0.0,
    )
    share = low / np.maximum(
        high + low,
        _TINY,
    )
    share = np.where(
        share < _ALONE,
        0.0,
        share,
    )
    share = np.where(
        share > 1 - _ALONE,
        1.0,
        share,
    )
    # one profile alone has no other's knots
    knots = times[:, None] * np.where(
        share == 1,
        knots[:, :1],
        np.where(
            share == 0,
            knots[:, 1:],
            knots,
        ),
    )
    knots = knots[:, :, 0]
    levels = levels[:, :, 0]
    segment, joint = optimum.cells
    knots[:, :, segment, joint] = (optimum.knots - passages[segment])[:, None] / scaled.unit
    stored = np.full(
        knots[:, 0].shape,
        np.nan,
    )
    stored[:, segment, joint] = optimum.knots
    levels[:, :, segment, joint] = optimum.levels[:, None]
    share[0, segment, joint] = 1.0
    signs = np.array([[-1.0], [1.0]])
    jerk = signs / np.maximum(
        scaled.r,
        _TINY,
    )
    positions = np.abs(scaled.problem.waypoints[:, scaled.moving])
    rounding = np.spacing(
        np.maximum(
            positions[:-1],
            positions[1:],
        )
    )
    segments, joints = scaled.h.shape

    def flat(table: Array) -> Array:
        every = np.broadcast_to(
            table,
            (*table.shape[:-2], segments, joints),
        )
        return every.reshape(*every.shape[:-2], -1)

    return _Cells(
        flat(np.array([velocity[0, :-1], velocity[0, 1:]])),
        flat(scaled.h),
        flat(knots),
        flat(levels),
        flat(stored),
        flat(share[0]),
        flat(scaled.v[:, None]),
        flat(scaled.a[:, None]),
        flat(jerk[:, None]),
        flat(rounding / scaled.units[-1]),
        flat(passages[:-1, None]),
        flat(passages[1:, None]),
    )


def _fitted(cells: _Cells, unit: float, resolution: float) -> list[Pieces]:
    """The motion of fewest breaks that keeps the limits; else the one that breaks them least."""
    left = np.arange(len(cells.h))
    chosen: list[Pieces] = [NO_PIECES] * len(left)
    least = np.full(
        len(left),
        np.inf,
    )
    with np.errstate(all="ignore"):
        for levels, stored in _grids(cells, unit, resolution):
            if not len(left):
                break
            fit = _through(
                cells.of(left),
                levels[:, left],
                stored[:, left],
                unit,
            )
            better = fit.excess < least[left]
            for cell in np.flatnonzero(better):
                breaks = fit.stored[:, cell]
                pieces = int((breaks < breaks[-1]).sum())
                chosen[left[cell]] = (breaks[: pieces + 1], fit.cubics[:, :pieces, cell])
            least[left] = np.minimum(
                least[left],
                np.where(
                    better,
                    fit.excess,
                    np.inf,
                ),
            )
            left = left[~(fit.excess <= _EXCESS_RTOL)]
    return chosen


def _grids(
    cells: _Cells,
    unit: float,
    resolution: float,
) -> Iterator[tuple[Array, Array]]:
    """Accelerations and stored breaks (s) to try, the fewest first."""
    t = (cells.end - cells.start) / unit
    for pieces in _EVEN:
        local = np.linspace(
            np.zeros_like(t),
            t,
            pieces + 1,
        )
        stored = np.linspace(
            cells.start,
            cells.end,
            pieces + 1,
        )
        yield cells.accelerations(local), stored
    knots = np.sort(cells.knots.reshape(-1, len(t)), axis=0)
    closest = np.maximum(
        resolution / unit,
        np.minimum(
            _BRIEFEST_S / unit,
            _BRIEFEST_RTOL * t,
        ),
    )
    (own,) = _apart(
        knots,
        closest,
        knots,
    )
    ends = (cells.start, cells.end)
    tight = np.repeat(
        cells.stored,
        2,
        axis=0,
    )
    loose = np.isnan(tight)
    levels = np.where(
        loose,
        cells.accelerations(own),
        np.repeat(
            cells.levels[:, 0],
            2,
            axis=0,
        ),
    )
    every = together(
        np.where(
            loose,
            outwards(
                own,
                *ends,
                unit,
            ),
            tight,
        ),
        *ends,
        resolution,
    )
    for sliver in _SLIVERS:
        far = np.where(
            loose[0],
            sliver * t * unit,
            0.0,
        )
        stored, kept = _apart(
            every,
            np.maximum(
                far,
                resolution,
            ),
            every,
            levels,
        )
        yield kept, stored


def _apart(knots: Array, closest: Array, *tables: Array) -> list[Array]:
    """The tables without knots that follow or precede too closely; the last one repeats.

    Args:
        knots: in order, `(knots, cells)`.
        closest: how near is too near.
        tables: of the knots' shape.
    """
    gaps = np.diff(knots, axis=0)
    kept = (gaps[:-1] > closest) & (knots[-1] - knots[1:-1] > closest)
    whole = np.ones_like(kept[:1])
    kept = np.concatenate([whole, kept, whole])
    order = np.argsort(~kept, axis=0, kind="stable")
    left = np.take_along_axis(
        kept,
        order,
        axis=0,
    )
    left[-1] = False
    return [
        np.where(
            left,
            np.take_along_axis(
                table,
                order,
                axis=0,
            ),
            table[-1],
        )
        for table in tables
    ]


def _through(cells: _Cells, levels: Array, stored: Array, unit: float) -> _Fit:
    """The motions with these breaks, near these accelerations."""
    lengths = np.diff(stored, axis=0) / unit
    inner = (stored > cells.start) & (stored < cells.end)
    cubics = through(
        lengths,
        levels,
        cells.ends,
        cells.h,
        inner.astype(float),
    )
    return _Fit(
        stored,
        cubics,
        _excess(cells, lengths, cubics),
    )


def _excess(cells: _Cells, lengths: Array, cubics: Array) -> Array:
    """The largest share by which a motion passes its limits of jerk, acceleration and velocity."""
    cubic, square, linear, _ = cubics
    w = cells.ends[1]
    last = cubics[:, -1]
    reached = polynomials.evaluate(
        polynomials.derivative(last),
        lengths[-1],
    )
    short = (
        polynomials.evaluate(
            last,
            lengths[-1],
        )
        - cells.h
    )
    fastest = np.abs(linear).max(axis=0) + np.abs(w)
    further = np.maximum(
        np.abs(short) - cells.rounding,
        0.0,
    )
    missed = np.maximum(
        np.abs(reached - w),
        further / lengths.sum(axis=0),
    )
    jerk = 6 * cubic
    acceleration = 2 * square
    changing = np.where(
        jerk == 0,
        np.inf,
        jerk,
    )
    # velocity where acceleration vanishes in a piece; where it does not, at the nearer end
    when = np.clip(
        -acceleration / changing,
        0.0,
        lengths,
    )
    turning = linear + when * (acceleration + when * jerk / 2)
    worst = np.zeros_like(fastest)
    for values, (low, high) in (
        (jerk, cells.jerk),
        (acceleration, cells.acceleration),
        (linear, cells.velocity),
        (turning, cells.velocity),
    ):
        worst = np.maximum(
            worst,
            np.maximum(
                values.max(axis=0) / high,
                values.min(axis=0) / low,
            ),
        )
    return np.where(
        missed > _MISS_RTOL * fastest,
        1 + missed / fastest,
        worst - 1,
    )
