"""Initial guesses on purpose: places within the tolerances, times the times of stopping.

The *chord* is the shortest way: each waypoint's place is the point of its box that is nearest the
middle of its neighbours' places. The times are shares of those of stopping at every waypoint, the
velocity at a waypoint the mean of the mean velocities before and after it. The chord in the times
of stopping leads to the optimum of every problem of the suites that asks for tolerances. Where
boxes overlap that is not enough: the optimum may be on any side of a box.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from baselines.exact.method.scaled import Scaled
from trajopt.core.arrays import Array

# Guesses where there are tolerances: those of `on_purpose`. Halved or doubled, no answer of the
# ablation is longer (experiments/README.md, `exact_ablation`).
EVERY_SIDE = 10
_SWEEPS = 20  # towards the chord; 10 and 40 give the same answers there
_SIDE = 0.95  # of the half width of a box; at 1 a guess has no slack
# Shares of the times of stopping, from each place. Small: the guess is far from possible. Large: it
# is far from the optimum.
_TIMES = (1.0, 0.5)
# Shares of the times at the velocity limits, all above 1: at 1 there is no slack. Halved or
# doubled, no answer of the ablation is longer.
_CRUISING = (1.3, 1.05, 2.0)
_BRIEFEST = 1e-3  # of the times of stopping, at least: boxes that overlap leave no way, so time 0
_SLOW = 2.0  # a further share, for places between the sides: more slack than at 1


class Guess(NamedTuple):
    """An initial guess, without units.

    Attributes:
        times: of the segments, `(segments,)`.
        velocities: at the waypoints with a state, `(waypoints, joints)`.
        offset: of these waypoints from their nominal places, likewise; None stands for 0.
    """

    times: Array
    velocities: Array
    offset: Array | None = None


def on_purpose(scaled: Scaled) -> Iterator[Guess]:
    """Yield the chord at three times; with tolerances ten guesses, also from the sides of boxes."""
    r = scaled.tolerance
    chord = _chord(scaled.h, scaled.tolerance)
    for share in (*_TIMES, _SLOW):
        yield _guess(scaled, chord, share)
    if not r.any():
        return
    for share in (*_TIMES, _SLOW):
        yield _guess(scaled, 0 * r, share)
    for side in (_SIDE, -_SIDE):
        for share in _TIMES:
            yield _guess(scaled, side * r, share)


def cruising(scaled: Scaled) -> Iterator[Guess]:
    """Yield guesses a little slower than at the velocity limits, for motions in motion at an end.

    A short segment next to such an end is passed at once, and the times of stopping are far. The
    way is the chord; with tolerances also along both sides of the boxes and their middles, and the
    chord whose segment next to an end in motion takes the least time.
    """
    r = scaled.tolerance
    ways = [
        (_chord(scaled.h, scaled.tolerance), own)
        for own in (_CRUISING if r.any() else _CRUISING[:1])
    ]
    if r.any():
        ways += [(side * r, _CRUISING[0]) for side in (0.0, _SIDE, -_SIDE)]
        in_motion = [end for end in (0, -1) if scaled.end_v[end].any()]
        ways += [(_at_once(scaled, end), _CRUISING[0]) for end in in_motion]
    for offset, share in ways:
        times = (_ways(scaled.h, offset) / scaled.v).max(axis=(0, 2))
        yield _guess(scaled, offset, share, times)


def _chord(h: Array, tolerance: Array) -> Array:
    """Return the offsets of the shortest way, at the waypoints with a state.

    Args:
        h: Displacements, `(segments, joints)`.
        tolerance: At these waypoints.
    """
    places = np.append(np.zeros((1, h.shape[1])), np.cumsum(h, axis=0), axis=0)
    chord = places.copy()
    inner = slice(1, len(places) - 1)
    r = tolerance[: len(places) - 2]
    if r.any():
        for _ in range(_SWEEPS):
            middle = (chord[:-2] + chord[2:]) / 2
            chord[inner] = np.clip(middle, places[inner] - r, places[inner] + r)
    return (chord - places)[1 : len(tolerance) + 1]


def _at_once(scaled: Scaled, end: int) -> Array:
    """Return the offsets of the chord whose first or last segment takes the least time.

    A joint that cannot stop passes this segment before it would stop, or after it has come back.
    Along the shortest chord another joint's way may be too long for before. So the segment takes
    the time at the velocity limits between the end and the nearest edges of the next box, and each
    joint moves on at its velocity at the end, as far as its box allows.

    Args:
        scaled: A problem with tolerances.
        end: 0 for the first segment, -1 for the last one.
    """
    h, r = scaled.h[end], scaled.tolerance[end]
    time = (np.clip(0.0, h - r, h + r) / scaled.v[:, end]).max()
    change = np.clip(time * scaled.end_v[end], h - r, h + r) - h
    offset = np.zeros_like(scaled.tolerance)
    offset[end] = change if end == 0 else -change
    others = np.array(scaled.tolerance)
    others[end] = 0.0
    return offset + _chord(_ways(scaled.h, offset), others)


def _ways(h: Array, offset: Array) -> Array:
    """Return the displacements between places, `(segments, joints)`."""
    moved = np.zeros((len(h) + 1, h.shape[1]))
    moved[1 : len(offset) + 1] = offset
    return h + np.diff(moved, axis=0)


def _guess(scaled: Scaled, offset: Array, share: float, times: Array | None = None) -> Guess:
    """Return the guess at places in a share of some times, by default those of stopping."""
    times = share * np.maximum(scaled.stop if times is None else times, _BRIEFEST * scaled.stop)
    mean = _ways(scaled.h, offset) / times[:, None]
    after = np.roll(mean, -1, axis=0)
    velocities = ((mean + after) / 2)[: len(offset)]
    return Guess(times, velocities, offset if scaled.tolerance.any() else None)
