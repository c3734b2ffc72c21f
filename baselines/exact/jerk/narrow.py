"""Initial guesses where a motion is possible at a single instant: limits that become narrower.

A method that begins inside all limits has no room there: where a joint has to brake as much as it
can to pass a waypoint at the latest time before a gap, say, or where one joint's first possible
time is another one's last. Wider limits give room. A guess inside them is centred, then the limits
become as narrow as leaves it inside, and so on until they are the problem's own. The intervals
of time before and after a gap have to stay apart, so limits are not much wider.
"""

from __future__ import annotations

import copy
from collections.abc import Iterable

import numpy as np

from baselines.exact.jerk.cells import (
    START_BARRIER_RTOL,
    JerkInequalities,
    JerkTables,
    JerkUnknowns,
)
from baselines.exact.jerk.gaps import JerkStart
from baselines.exact.method.interior_point import begun, descended
from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Bools

# The share by which limits are wider at first. It falls by the smallest of these factors that
# leaves the guess inside; below the least share limits are the problem's own.
_WIDEST = 0.015
_FACTORS = np.append([0.97, 0.9, 0.8, 0.7], 0.5 ** np.arange(1, 35))
_LEAST = 1e-12
_ROUNDS = 100
# The share of what is left to rounding that a start may use where none is inside all limits.
_MOST_SPARE = 0.9
_CENTRING_STEPS = 8
# Complementarity gap of a centred guess, relative to its duration: in proportion to the share, but
# not so large that the guess leaves its interval of time.
_GAP = 200.0
_MOST_GAP = 0.3


class NarrowStart(JerkStart):
    """A start that limits narrowed to: an optimum, to 200 times the share that was left of them."""


class _WiderTables(JerkTables):
    """The tables of a problem with limits that are wider by a share."""

    def __init__(self, scaled: Scaled, share: float) -> None:
        own = copy.copy(scaled)
        factor = 1 + share
        own.v, own.waypoint_v = scaled.v * factor, scaled.waypoint_v * factor
        own.a, own.waypoint_a = scaled.a * factor, scaled.waypoint_a * factor
        own.r = scaled.r / factor
        if scaled.passing is not None:
            own.passing = scaled.passing * factor
        super().__init__(own, kinds=2)
        self.share = share


class _Central(JerkInequalities):
    """Inequalities with a barrier in proportion to the share by which limits are wider."""

    cells: _WiderTables

    def __init__(self, cells: _WiderTables, point: JerkUnknowns) -> None:
        super().__init__(cells, point)
        self.min_gap_rtol = min(_GAP * cells.share, _MOST_GAP)
        self.start_barrier = self.start_barrier * self.min_gap_rtol / START_BARRIER_RTOL

    @property
    def is_inside(self) -> bool:
        """Return whether the point keeps all of these limits, with room."""
        return bool(self.values.min() > 0 and self.profiles.reachable.all())


def inside(scaled: Scaled, starts: Iterable[JerkStart], spare: float) -> list[JerkStart]:
    """Return starts inside all limits, without those that lead to none.

    Args:
        scaled: A problem that begins or ends in motion.
        starts: Found within limits that are wider by 1 %; some may be outside.
        spare: The share by which the limits are tighter for rounding.
    """
    with np.errstate(all="ignore"):
        found = [_narrowed(scaled, start, _MOST_SPARE * spare) for start in starts]
    return [own for own in found if own is not None]


def _narrowed(scaled: Scaled, start: JerkStart, spare: float) -> JerkStart | None:
    """Return the start if it is inside all limits, else where narrower limits lead from it."""

    def rows(at: JerkUnknowns, share: float) -> _Central:
        return _Central(_WiderTables(scaled, share), at)

    point = JerkTables(scaled).linked(*(own[None] for own in start))
    if rows(point, 0.0).is_inside:
        return start
    share = _WIDEST
    for _ in range(_ROUNDS):
        begins = begun(rows(point, share))
        centred = descended(begins, _never, _CENTRING_STEPS).state.rows.point
        if not rows(centred, share).is_inside:
            break
        point = centred
        narrower = [own for own in share * _FACTORS[::-1] if own > _LEAST]
        share = next((own for own in (0.0, *narrower) if rows(point, own).is_inside), share)
        if share == 0.0:
            break
    if share > spare:
        return None
    return NarrowStart(np.exp(point.log[0]), point.velocity[0], point.acceleration[0])


def _never(_: object) -> Bools:
    return np.zeros(1, dtype=bool)
