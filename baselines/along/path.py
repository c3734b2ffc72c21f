"""The geometry of a path: where it must be left at rest, and a parameter with finite speeds.

A path `q(s)` is piecewise polynomial. It can be followed without a stop where its direction does
not jump; under jerk limits also its curvature. The parameter itself may change its pace there: its
first derivative is made continuous (`_even`), and the jump of the second one is in `Path.bends`.

Where the motion begins or ends at rest and `q'(s)` is not 0, `s` grows like `t²` (with jerk limits
`t³`). The squared path speed then has no finite derivative. So `s = s(σ)` with `s ~ σ²` (`σ³`) in a
zone beside that end: the speed of `σ` is finite and positive at rest.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from baselines.topp_ra import backwards, straightened
from trajopt.core import dwell, polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.limits import Limits
from trajopt.core.trajectory import Trajectory

# The share of a piece beside an end at rest in which no other rest is looked for.
_BESIDE = 0.05
# A path stands where `q'` is less than this, relative to the largest of the piece.
_STILL_RTOL = 1e-6
# The largest jump of the direction, of unit length with joints in units of their velocity limits;
# and of the acceleration at top speed, relative to its limit. The judge repairs 1e-6.
_CORNER_RTOL = 3e-7
# Coefficients, relative to the largest, and changes of pace that count as none.
_NOTHING_RTOL = 1e-9
# Pieces that move less than this, relative to the whole path, are left out.
_BRIEF_RTOL = 1e-9
# s(σ) in a zone of length 1, highest power first; at its end s' = 1, s'' = 0.
_ZONES = {2: np.array([0.25, -1.0, 1.5, 0.0, 0.0]), 3: np.array([0.6, -2.0, 2.0, 0.0, 0.0, 0.0])}
# The longest zone, as a share of the first (or last) piece.
_LONGEST_ZONE = 0.3
_BISECTIONS = 60


class Stop(NamedTuple):
    """A place where a path cannot be passed without a stop.

    Attributes:
        at: the path's parameter.
        why: what jumps there, in words; empty where it only turns back, which costs no time.
    """

    at: float
    why: str


@dataclass(frozen=True, eq=False)
class Path:
    """A path that can be followed without a stop, and the parameter `σ`.

    Attributes:
        curve: `q(s)`; its `waypoint_times` are the waypoints' parameters.
        bends: at each inner break the second derivative of the parameter after it by the one
            before it.
        stands: powers of `s` by which the path leaves its start and reaches its end.
        growth: the power of `t` by which a joint leaves rest: 3 with jerk limits, else 2.
        zones: lengths, in `σ`, of the zones at both ends; 0 for none.
    """

    curve: Trajectory
    bends: Array
    stands: tuple[int, int]
    growth: int
    zones: tuple[float, float] = (0.0, 0.0)

    @property
    def length(self) -> float:
        """The end of `σ`."""
        return self.curve.duration + (1 - self._share) * sum(self.zones)

    @property
    def _share(self) -> float:
        """The part of `s` that a zone of length 1 covers."""
        return float(_ZONES[self.growth].sum())

    def with_zones(self, rests: tuple[bool, bool], size: tuple[float, float] = (1, 1)) -> Path:
        """Return the path with zones where the motion rests and the path does not stand.

        `size` is relative to the longest ones.
        """
        ends = self.curve.lengths[[0, -1]] * _LONGEST_ZONE / self._share
        start, end = (
            float(length * own) if rest and power == 1 else 0.0
            for rest, power, length, own in zip(rests, self.stands, ends, size, strict=True)
        )
        return replace(self, zones=(start, end))

    def s(self, sigma: Array) -> Array:
        """Return `s` and three derivatives by `σ`, `(4, …)`."""
        start, end = self.zones
        one = np.ones_like(sigma)
        found = np.stack([sigma - (1 - self._share) * start, one, 0 * one, 0 * one])
        for length, distance, backward in (
            (start, sigma, False),
            (end, self.length - sigma, True),
        ):
            inside = distance < length
            if not inside.any():
                continue
            zone = _ZONES[self.growth]
            for order in range(4):
                power = length ** (1.0 - order)
                value = polynomials.derivative(zone, order)
                own = power * polynomials.evaluate(value, distance[inside] / length)
                if backward:
                    own = self.curve.duration - own if order == 0 else own * (-1) ** (order + 1)
                found[order, inside] = own
        return found

    def sigma(self, s: Array) -> Array:
        """Return `σ` where the path's parameter is `s`: shifted between the zones."""
        start, end = self.zones
        found = np.clip(s + (1 - self._share) * start, 0.0, self.length)
        zone = (s < self._share * start) | (s > self.curve.duration - self._share * end)
        zone &= (s > 0) & (s < self.curve.duration)
        if zone.any():
            low, high = np.zeros(zone.sum()), np.full(zone.sum(), self.length)
            for _ in range(_BISECTIONS):
                middle = (low + high) / 2
                below = self.s(middle)[0] < s[zone]
                low, high = np.where(below, middle, low), np.where(below, high, middle)
            found[zone] = (low + high) / 2
        found[s <= 0] = 0.0
        found[s >= self.curve.duration] = self.length
        return found

    def pieces_at(self, sigma: Array) -> Indices:
        """Return the piece at each `σ`; at a break the one that it begins."""
        return np.searchsorted(self.curve.breaks[1:-1], self.s(sigma)[0], side="right")

    def at(self, sigma: Array, piece: Indices) -> Array:
        """Return `q` and three derivatives by `σ` on given pieces, `(4, …, joints)`."""
        s, s1, s2, s3 = self.s(sigma)[..., None]
        q, q1, q2, q3 = on_pieces(self.curve, s, piece)
        return np.stack([q, q1 * s1, q2 * s1**2 + q1 * s2, q3 * s1**3 + 3 * q2 * s1 * s2 + q1 * s3])


def on_pieces(curve: Trajectory, s: Array, piece: Indices) -> list[Array]:
    """Return a curve and three derivatives at parameters `(…, 1)`, on given pieces."""
    local = s - curve.breaks[piece][..., None]
    found = []
    for order in range(4):
        derivative = polynomials.derivative(curve.coefficients, order)
        found.append(polynomials.evaluate(derivative[:, piece], local))
    return found


def parts(path: Trajectory, limits: Limits) -> tuple[list[Path], list[Stop]]:
    """Return the parts of a path between its stops, and the stops that cost time.

    Each part has all waypoints: the parameters of those outside are its start or its end.
    """
    growth = 3 if limits.jerk_limited.any() else 2
    known = limits.in_all_segments()
    speeds, accelerations = (
        np.abs(own).min(axis=1) for own in (known.velocity, known.acceleration)
    )
    found_moving = _moving(path, speeds)
    if found_moving is None:
        return [], []
    moving, passed = found_moving
    whole = moving.refined(_turns(moving, speeds))
    stops = list(_stops(whole, speeds, accelerations, jerk=growth == 3))
    cuts = [0.0, *(stop.at for stop in stops), whole.duration]
    found = []
    for begin, end in pairwise(cuts):
        own = dwell.between(whole, begin, end)
        if own is not None:
            waypoints = np.clip(whole.waypoint_times - begin, 0.0, own.duration)
            waypoints[[0, -1]] = 0.0, own.duration
            found.append(_prepared(replace(own, waypoint_times=waypoints), growth))
    return found, [Stop(float(np.interp(stop.at, passed, path.breaks)), stop.why) for stop in stops]


def _prepared(curve: Trajectory, growth: int) -> Path:
    """Return a part as a path: lines at its ends, and an even parameter."""
    ends = _powers(curve)
    if ends[0] != growth:
        curve = straightened(curve, least=2)
    if ends[1] != growth:
        curve = backwards(straightened(backwards(curve), least=2))
    curve = _even(curve)
    before, after = _sides(curve)
    steepness = np.einsum("bj,bj->b", after[1], after[1])
    jumps = np.einsum("bj,bj->b", before[2] - after[2], after[1])
    lengths = np.minimum(curve.lengths[1:], curve.lengths[:-1])
    told = np.abs(jumps) * lengths > _NOTHING_RTOL * steepness
    bends = np.divide(jumps, steepness, out=np.zeros(len(told)), where=told & (steepness > 0))
    return Path(curve, bends, _powers(curve), growth)


def _moving(path: Trajectory, speeds: Array) -> tuple[Trajectory, Array] | None:
    """Return a path without the pieces in which it stands, and its parameters at all breaks.

    None if nothing moves.
    """
    moves = (np.abs(path.pieces()[:-1]).sum(axis=0) / speeds).max(axis=1, initial=0.0)
    moving = moves > _BRIEF_RTOL * moves.sum()
    if not moving.any():
        return None
    lengths = path.lengths[moving]
    breaks = np.append(0.0, np.cumsum(lengths))
    passed = np.append(0.0, np.cumsum(np.where(moving, path.lengths, 0.0)))
    waypoints = np.interp(path.waypoint_times, path.breaks, passed)
    waypoints[-1] = breaks[-1]
    own = Trajectory(breaks, path.coefficients[:, moving], waypoints, lengths)
    return own, passed


def _turns(path: Trajectory, speeds: Array) -> Array:
    """Return the parameters within pieces where the path stands for an instant.

    Beside an end where it stands the place of such a root is rounding.
    """
    slopes = path.pieces(1) / speeds
    square = np.sum([polynomials.product(own, own) for own in np.moveaxis(slopes, -1, 0)], axis=0)
    places = polynomials.critical_points(square)
    values = polynomials.evaluate(square[:, None], places)
    still = values <= _STILL_RTOL**2 * values.max(axis=0)
    start, end = np.where(still[:2], _BESIDE, _STILL_RTOL)
    inner = still & (places > start) & (places < 1 - end)
    _, piece = np.nonzero(inner)
    return np.asarray(path.breaks[piece] + places[inner] * path.lengths[piece])


def _sides(path: Trajectory) -> tuple[list[Array], list[Array]]:
    """Return position and three derivatives on both sides of each inner break."""
    inner = np.arange(len(path.lengths) - 1)
    at = path.breaks[1:-1, None]
    return on_pieces(path, at, inner), on_pieces(path, at, inner + 1)


def _stops(path: Trajectory, speeds: Array, accelerations: Array, *, jerk: bool) -> Iterator[Stop]:
    """Yield the breaks that cannot be passed without a stop."""
    scaled = replace(path, coefficients=path.coefficients / speeds)
    before, after = _sides(scaled)
    sizes = [np.linalg.norm(own[1], axis=1) for own in (before, after)]
    rates = np.abs(scaled.pieces(1)).sum(axis=0).max(axis=1)
    still = (sizes[0] < _STILL_RTOL * rates[:-1]) | (sizes[1] < _STILL_RTOL * rates[1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        directions = [
            own[1] / size[:, None] for own, size in zip((before, after), sizes, strict=True)
        ]
        turned = np.abs(directions[0] - directions[1]).max(axis=1) > _CORNER_RTOL
        curvatures = [
            _across(own[2] / size[:, None] ** 2, directions[1])
            for own, size in zip((before, after), sizes, strict=True)
        ]
        # each joint within its limit: the squared speed is at most the number of joints
        jumps = np.abs(curvatures[0] - curvatures[1]) * path.joints * speeds / accelerations
        bent = (jumps.max(axis=1) > _CORNER_RTOL) & jerk
    turns = still & _turns_smoothly(before, after, scaled.lengths)
    for k, at in enumerate(path.breaks[1:-1].tolist()):
        if turns[k]:
            if not jerk:  # at rest for an instant, on both sides with any acceleration
                yield Stop(at, "")
        elif still[k]:
            yield Stop(at, "the path itself stops")
        elif turned[k]:
            yield Stop(at, "its direction jumps")
        elif bent[k]:
            yield Stop(at, "its curvature jumps")


def _turns_smoothly(before: list[Array], after: list[Array], lengths: Array) -> Bools:
    """Return at which breaks a path that stands has one second derivative, which is not 0.

    There it turns back. A motion passes: under jerk limits its acceleration is not 0.
    """
    sizes = np.maximum(np.linalg.norm(before[2], axis=1), np.linalg.norm(after[2], axis=1))
    moves = np.maximum(lengths[1:], lengths[:-1]) ** 2 * sizes
    jumps = np.abs(before[2] - after[2]).max(axis=1)
    return np.asarray(
        (jumps <= _CORNER_RTOL * sizes) & (moves > _STILL_RTOL * moves.max(initial=0.0))
    )


def _across(vectors: Array, directions: Array) -> Array:
    """Return the parts of vectors that are normal to directions of length 1."""
    along = np.einsum("bj,bj->b", vectors, directions)
    return np.asarray(vectors - along[:, None] * directions)


def _even(path: Trajectory) -> Trajectory:
    """Stretch the parameter of each piece, so that `q'` does not jump."""
    before, after = _sides(path)
    sizes = [np.linalg.norm(own[1], axis=1) for own in (before, after)]
    rates = np.abs(path.pieces(1)).sum(axis=2).max(axis=0)
    passes = np.minimum(*sizes) > _STILL_RTOL * np.minimum(rates[1:], rates[:-1])
    ratios = np.divide(sizes[1], sizes[0], out=np.ones(len(passes)), where=passes)
    ratios = np.where(np.abs(ratios - 1) < _NOTHING_RTOL, 1.0, ratios)
    if (ratios == 1).all():
        return path
    factors = np.append(1.0, np.cumprod(ratios))
    lengths = path.lengths * factors
    breaks = np.append(0.0, np.cumsum(lengths))
    waypoints = np.interp(path.waypoint_times, path.breaks, breaks)
    coefficients = polynomials.stretched(path.coefficients, 1 / factors)
    return Trajectory(breaks, coefficients, waypoints, lengths)


def _powers(path: Trajectory) -> tuple[int, int]:
    """Return the lowest powers of the parameter in which the path leaves both ends."""
    found = []
    for own in (path, backwards(path)):
        sizes = np.abs(own.pieces()[:-1, 0]).max(axis=1)[::-1]
        found.append(1 + int(np.argmax(sizes > _NOTHING_RTOL * sizes.max())))
    return found[0], found[1]
