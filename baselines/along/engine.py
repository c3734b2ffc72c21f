"""The fastest timing of a path between two stops: knots that move, and the motion.

The first knots are even in the path's parameter, the second ones in time. Then intervals are cut in
three where time is lost: where the tightest row leaves room, or the motion exceeds a row between
its points. That ends when neither the excess nor the change of the time matters (`_SETTLED`), or at
once where excess and lost time are next to nothing (`_PLAIN`): a path of thousands of pieces, such
as a log's, needs one program.

Between knots `s(t)` is the quintic with the program's speed and acceleration at both ends. The
motion `q(s(t))` is composed exactly, so it never leaves the path; what the quintic misses is an
excess of limits, which is measured and refined like any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from baselines.along.law import Law, excess, law
from baselines.along.path import Path, on_pieces
from baselines.along.program import POINTS, End, SpeedProgram
from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.limits import KINDS, Limits
from trajopt.core.trajectory import Trajectory

# Intervals of the first knots.
_INTERVALS = 50
_MAX_GRIDS = 9
# Knots that there must be of a path whose pieces are short beside what its timing does.
_MANY = 500
# The share of the accuracy asked for below which excess and change of the time no longer matter.
_SETTLED = 0.35
# The share of it below which excess and lost time together end it on any knots.
_PLAIN = 0.1
# Where the motion is looked at between two knots, as shares of time.
_LOOKS = np.linspace(0.0, 1.0, 17)
_BLOCK = 500  # intervals that are looked at together: a few MB
# The method starts at this share of the uniform speed,
_START_SHARE = 0.7
# on later knots at this share of the last answer, with these products of slacks and multipliers.
_WARM_SHARE, _WARM_BARRIER = 0.95, 1e-2
# The intervals that have this share of all lost time are cut.
_CUT_SHARE = 0.9
# A zone is shortened where its slow end allows a speed so many times that of its inner one.
_UNEVEN, _SHORTER, _MAX_ZONES = 8.0, 0.25, 12
# A uniform motion slower than this, s, is none.
_SLOWEST = 1e6
_HALVINGS = 50
# How often limits are tightened where the motion exceeds them, by how much of the excess (which is
# of time: of a limit of jerk it is a third), and what counts as none.
_TIGHTENED, _MARGIN, _WITHIN = 5, 3.2, 1e-9
# The distance that is then kept from every bound, for what happens between those points.
_EVERYWHERE = 2e-6
# Coefficients smaller than this, relative to the joint's positions, are left out.
_NOTHING_RTOL = 1e-25
# Knots that are closer, relative to the path, are one.
_APART_RTOL = 1e-9


class NoMotionError(Exception):
    """No motion along the path keeps the limits; the message says where."""


@dataclass(frozen=True, eq=False)
class PathTiming:
    """A motion along a path.

    Attributes:
        motion: with the times of the path's waypoints.
        excess: the part of the duration by which it must be slower to keep all limits, where the
            motion was looked at.
        grids: number of programs.
        path: with its zones.
        program: the last one, solved.
        unit: a uniform speed of the parameter that keeps all limits.
    """

    motion: Trajectory
    excess: float
    grids: int
    path: Path
    program: SpeedProgram
    unit: float


class _OnKnots:
    """The program on some knots of a path."""

    def __init__(
        self,
        path: Path,
        limits: Limits,
        knots: Array,
        ends: Sequence[End],
        unit: float,
        margin: Array | float = 0.0,
    ) -> None:
        """Set up the program; each interval keeps a `margin` to all bounds, relative to them."""
        self.path, self.limits, self.knots = path, limits, knots
        middles = (knots[1:] + knots[:-1]) / 2
        self.piece = path.pieces_at(middles)
        self.segment = path.curve.segments_at(path.s(middles)[0])
        rows = self.law(unit)
        margins = np.repeat(np.broadcast_to(margin, len(middles)), len(POINTS))[:, None]
        rows.slow[0] += margins
        rows.jerk[0] += margins
        self.program = SpeedProgram(path, rows, knots, ends, unit)

    def law(self, unit: float) -> Law:
        """Return what limits ask at the points of every interval.

        It is as large as the program, and not kept: a log has tens of thousands of intervals.
        """
        count = len(POINTS)
        sigma = (self.knots[:-1, None] + np.diff(self.knots)[:, None] * POINTS).ravel()
        states = self.path.at(sigma, np.repeat(self.piece, count))
        return law(self.limits, states, np.repeat(self.segment, count), unit)

    def motion(self, x: Array) -> tuple[Trajectory, Array, Array]:
        """Return the motion, and each interval's excess and lost time."""
        program, path = self.program, self.path
        h = program.times(x)
        s, s1, s2, _ = path.s(self.knots)
        b, slope = program.ends(x)
        sides = np.stack([np.arange(len(h)), np.arange(len(h)) + 1])
        speed = s1[sides] * np.sqrt(b)
        acceleration = s2[sides] * b + s1[sides] * slope / 2
        inner = _quintic(s[:-1] - path.curve.breaks[self.piece], np.diff(s), speed, acceleration, h)
        blocks = [slice(k, k + _BLOCK) for k in range(0, len(h), _BLOCK)]
        looks = [self._looked_at(inner[:, some], h[some], some) for some in blocks]
        over, room = (np.concatenate(own) for own in zip(*looks, strict=True))
        composed = polynomials.composed(path.curve.coefficients[:, self.piece], inner[..., None])
        breaks = np.append(0.0, np.cumsum(h))
        way = np.interp(path.sigma(path.curve.waypoint_times), self.knots, breaks)
        way[-1] = breaks[-1]
        motion = Trajectory(breaks, _in_seconds(composed, h), way, h)
        return motion, over, room * h

    def _looked_at(self, inner: Array, h: Array, some: slice) -> tuple[Array, Array]:
        """Return some intervals' excess and least room, of `s(t)` over unit intervals."""
        looks = len(_LOOKS)
        s, w, x, y = (
            polynomials.evaluate(polynomials.derivative(inner, order)[:, :, None], _LOOKS).ravel()
            / np.repeat(h, looks) ** order
            for order in range(4)
        )
        piece = np.repeat(self.piece[some], looks)
        curve = self.path.curve
        states = np.stack(on_pieces(curve, (s + curve.breaks[piece])[:, None], piece))
        segments = np.repeat(self.segment[some], looks)
        over, room = excess(self.limits, states, np.stack([w, x, y]), segments)
        return over.reshape(-1, looks).max(axis=1), np.maximum(
            room.reshape(-1, looks).max(axis=1), 0.0
        )


def _in_seconds(unit: Array, h: Array) -> Array:
    """Return polynomials of the unit interval in time, without coefficients that are nothing.

    The path's degree times five can be 75, and `h ** -75` overflows. On a short piece the highest
    powers add less than can be told.
    """
    counts = np.abs(unit) > _NOTHING_RTOL * np.abs(unit).max(axis=(0, 1))
    first = int(np.argmax(counts.any(axis=(1, 2))))
    powers = np.arange(len(unit) - 1 - first, -1, -1.0)[:, None]
    with np.errstate(over="ignore", invalid="ignore"):
        found = unit[first:] * (h**-powers)[..., None]
    return np.where(counts[first:] & np.isfinite(found), found, 0.0)


def _quintic(start: Array, change: Array, speed: Array, acceleration: Array, h: Array) -> Array:
    """Return `s` over unit intervals from its values at both ends, `(6, N)`."""
    v0, v1 = speed * h
    a0, a1 = acceleration * h**2
    missing, dv, da = change - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
    return np.stack(
        [
            6 * missing - 3 * dv + da / 2,
            -15 * missing + 7 * dv - da,
            10 * missing - 4 * dv + da / 2,
            a0 / 2,
            v0,
            start,
        ]
    )


def timed(
    path: Path, limits: Limits, ends: Sequence[End], accuracy: float, *, exactly: bool = False
) -> PathTiming:
    """Return the fastest motion along a path.

    Args:
        path: without zones.
        limits: of the problem.
        ends: the squared speed of the path's parameter, and its derivative, where the motion
            begins and ends in motion; free elsewhere.
        accuracy: of the duration, relative.
        exactly: whether the excess is removed, for a motion that cannot be slowed down as a whole.

    Raises:
        NoMotionError: No motion along the path keeps all limits, or none is found.
        NoLawError: A limit's rows have another form than a path's timing takes.
    """
    path, grid, unit = _started(path, limits, ends)
    must = _must(path)
    before: tuple[_OnKnots, Array] | None = None
    last = np.inf
    is_cut = False
    for count in range(1, _MAX_GRIDS + 1):
        try:
            x = _solved(grid, before, unit, accuracy)
        except NoMotionError:
            if before is None:
                raise
            grid, x = before  # the answer on coarser knots stands
            break
        motion, over, lost = grid.motion(x)
        worst = float(over.max())
        excess_time = float(over @ motion.lengths)
        settled = excess_time < _SETTLED * accuracy * motion.duration
        settled &= abs(motion.duration / last - 1) < _SETTLED * accuracy
        plain = excess_time + lost.sum() < _PLAIN * accuracy * motion.duration
        if count == _MAX_GRIDS or plain or (is_cut and settled):
            break
        last = motion.duration
        before = grid, x
        knots = grid.knots
        if count == 1:
            knots = _spread(must, grid.knots, motion.breaks / motion.duration)
        # a path of many pieces has the same knots then
        is_cut = np.array_equal(knots, grid.knots)
        if is_cut:
            knots = _cut(grid.knots, over, motion.lengths, lost, accuracy)
        grid = _OnKnots(path, limits, knots, ends, unit)
    margin = np.zeros(grid.program.count)
    if exactly:  # at an end in motion a limit may be used whole
        margin[1:-1] = _EVERYWHERE
    for _ in range(_TIGHTENED):
        if worst <= (_WITHIN if exactly else _SETTLED * accuracy):
            break
        margin = 1 - (1 - margin) / (1 + _MARGIN * over)
        before = grid, x
        tighter = _OnKnots(path, limits, grid.knots, ends, unit, margin)
        try:
            x = _solved(tighter, before, unit, accuracy)
        except NoMotionError:
            break  # the verifier slows down what was found
        grid = tighter
        motion, over, _ = grid.motion(x)
        worst = float(over.max())
    return PathTiming(motion, worst, count, path, grid.program, unit)


def _solved(
    grid: _OnKnots, before: tuple[_OnKnots, Array] | None, unit: float, accuracy: float
) -> Array:
    """Return the program's answer, from near the last one, or else from a uniform speed.

    Raises:
        NoMotionError: The method does not converge from either.
    """
    program = grid.program
    for former in (before, None):
        start, barrier = _start(grid, former, unit)
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            try:
                x = program.solve(start, 1e-2 * accuracy, barrier)
            except (np.linalg.LinAlgError, ValueError):
                continue
            # positive at all nodes of the quadratures, also of the one of the times
            if program.positive(x).min() > 0 and np.isfinite(program.times(x)).all():
                return x
    raise NoMotionError("no timing of this path is found: the method does not converge")


def _started(path: Path, limits: Limits, ends: Sequence[End]) -> tuple[Path, _OnKnots, float]:
    """Return the path with zones, its first knots, and a uniform speed that keeps all limits.

    Zones are no longer than speeding up takes: their slow end would be cut too coarsely.
    """
    rests = (ends[0].b is None, ends[1].b is None)
    size = np.ones(2)
    for _ in range(_MAX_ZONES):
        own = path.with_zones(rests, (size[0], size[1]))
        must = _must(own)
        knots = _spread(must, np.array([0.0, own.length]), np.array([0.0, 1.0]))
        usual = _usual(own, limits)
        grid = _OnKnots(own, limits, knots, ends, usual)
        rows = grid.law(usual)
        allowed = _uniform(rows, len(POINTS))
        uneven = np.zeros(2, dtype=bool)
        for end, zone in enumerate(own.zones):
            if zone:
                inside = knots[1:] <= zone * (1 + 1e-9)
                if end:
                    inside = own.length - knots[:-1] <= zone * (1 + 1e-9)
                inner = allowed[inside][0 if end else -1]
                uneven[end] = allowed[inside].max() > _UNEVEN * inner
        if not uneven.any():
            break
        size[uneven] *= _SHORTER
    unit = float(allowed.min())
    if unit * _SLOWEST < own.length:
        raise NoMotionError(_where(grid, rows, allowed))
    return own, grid, unit


def _usual(path: Path, limits: Limits) -> float:
    """Return a speed of the parameter at about the velocity limits."""
    velocity = np.abs(limits.in_all_segments().velocity).min(axis=1)
    sigma = np.linspace(0.0, path.length, 4 * len(path.curve.lengths) + 1)
    slopes = path.at(sigma, path.pieces_at(sigma))[1]
    return float(1 / (np.abs(slopes) / velocity).max())


def _uniform(law: Law, points: int) -> Array:
    """Return the uniform speed that each interval alone allows, by bisection."""
    rows = np.concatenate([law.slow, law.jerk], axis=2)
    c0, cv, c2, _, c3, *_ = rows.reshape(7, -1, points * rows.shape[2])
    low, high = np.zeros(c0.shape[0]) - 30.0, np.zeros(c0.shape[0]) + 30.0
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        w = 10.0 ** middle[:, None]
        kept = (c0 + w * (cv + w * (c2 + w * c3)) <= 0).all(axis=1)
        low, high = np.where(kept, middle, low), np.where(kept, high, middle)
    return 10.0**low


def _where(grid: _OnKnots, rows: Law, allowed: Array) -> str:
    """Say where, and under which limit, no motion along the path is possible."""
    interval = int(allowed.argmin())
    points = slice(interval * len(POINTS), (interval + 1) * len(POINTS))
    at_rest = np.concatenate([rows.slow[0], rows.jerk[0]], axis=1)[points].max(axis=0)
    kind = KINDS[rows.keys[int(at_rest.argmax())]].name()
    segment = int(grid.segment[interval]) + 1
    return f"no motion along this path keeps the {kind} limits in segment {segment}"


def _must(path: Path) -> Array:
    """Return the parameters that are knots of every grid."""
    inner = path.sigma(np.union1d(path.curve.breaks, path.curve.waypoint_times))
    start, end = path.zones
    every = np.unique(np.r_[0.0, start, path.length - end, inner, path.length])
    apart = np.diff(every) > _APART_RTOL * path.length
    every = every[np.r_[True, apart]]
    every[-1] = path.length
    return every


def _spread(must: Array, sigma: Array, share: Array) -> Array:
    """Return knots that are even in a quantity that is `share` of its whole at some `sigma`.

    Between two that must be knots there are at least two intervals; one where these are `_MANY`.
    """
    at = np.interp(must, sigma, share)
    least = 2 if len(must) <= _MANY else 1
    counts = np.maximum(least, np.rint(_INTERVALS * np.diff(at))).astype(int)
    knots = [
        np.interp(np.linspace(a, b, count + 1), share, sigma)[1:-1]
        for a, b, count in zip(at[:-1], at[1:], counts, strict=True)
    ]
    return np.sort(np.concatenate([must, *knots]))


def _start(
    grid: _OnKnots, before: tuple[_OnKnots, Array] | None, unit: float
) -> tuple[Array, float | None]:
    """Return where the method starts: near the last answer, or at a uniform speed."""
    program = grid.program
    if before is not None:
        former, x = before[0].program, before[1]
        knots = program.knots
        start = np.empty(program.unknowns)
        if program.cubic:
            start[::2], start[1::2] = former.at(x, knots), former.at(x, knots, 1)
        else:
            start[::2] = former.at(x, knots)
            start[1::2] = former.at(x, (knots[1:] + knots[:-1]) / 2)
        start *= _WARM_SHARE
        if program.positive(start).min() > 0:
            return start, _WARM_BARRIER * float(former.times(x).sum()) / program.rows_in_all
    return program.uniform(_START_SHARE * unit), None


def _cut(knots: Array, over: Array, h: Array, lost: Array, accuracy: float) -> Array:
    """Return the knots, and two more in each interval that loses time or exceeds limits."""
    order = np.argsort(-lost)
    enough = 1 + int(np.searchsorted(np.cumsum(lost[order]), _CUT_SHARE * lost.sum()))
    losing = order[:enough]
    losing = losing[lost[losing] > 1e-3 * accuracy * h.sum()]
    cost = over * h
    exceeding = np.flatnonzero((over > 0.2 * accuracy) & (cost > 0.1 * cost.max()))
    cut = np.union1d(losing, exceeding)
    thirds = np.diff(knots)[cut] / 3
    return np.sort(np.concatenate([knots, knots[cut] + thirds, knots[cut] + 2 * thirds]))
