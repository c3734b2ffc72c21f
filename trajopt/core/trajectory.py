"""The trajectory: a piecewise polynomial of time, one per joint, on common breaks."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from trajopt.core import interpolation as between
from trajopt.core import piecewise, polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.interpolation import Interpolation
from trajopt.core.piecewise import PiecewisePolynomial

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly


EPS = float(np.finfo(float).eps)
# Relative to the duration. Closer breaks are one break: sums of durations in different orders
# differ by rounding. Dropping a longer piece, which moves, would make a jump.
BREAK_RTOL = 16 * EPS
# Relative to the duration: rounding between a length and the difference of its breaks. Less than
# the distance of two breaks, so that a piece that is cut has two parts.
LENGTH_RTOL = 8 * EPS
# Relative to the duration: rounding of the first and last waypoint times.
END_RTOL = 1e-12
# Relative to the duration. A nearer crossing of a path's break is at the break of s(t) itself.
CROSSING_RTOL = 1e-12
# Relative to the domain: rounding by which s(t) may leave it.
DOMAIN_RTOL = 1e-12
# Most coefficients of a motion whose pieces on the unit interval are kept: 8 MB. Those of a longer
# one, such as a log, are computed block by block.
KEPT_VALUES = 1_000_000


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions of all joints over `[0, duration]`, in the layout of `scipy.interpolate.PPoly`.

    Attributes:
        breaks: strictly increasing times from 0, s, `(pieces + 1,)`.
        coefficients: highest power first, in the time since the piece's start, rad/s^power,
            `(degree + 1, pieces, joints)`.
        waypoint_times: when each waypoint is passed, from 0 to `duration`, s, `(waypoints,)`.
        lengths: duration of each piece, s, `(pieces,)`; by default the differences of the breaks.
            These round: after half a minute a break is known to 4e-15 s, a tenth of a millionth of
            a piece of 5e-8 s. Lengths that are given are exact, and the breaks are their sums.

    Raises:
        InvalidTrajectory: these do not fit together or are not finite.
    """

    breaks: Array
    coefficients: Array
    waypoint_times: Array
    lengths: Array = field(default_factory=partial(np.zeros, 0))

    def __post_init__(self) -> None:
        if not np.size(self.lengths):
            object.__setattr__(self, "lengths", np.diff(np.ravel(self.breaks)))
        for own in fields(self):
            array = np.array(getattr(self, own.name), dtype=float)
            if not np.isfinite(array).all():
                raise InvalidTrajectory(f"{own.name} holds a value that is not finite")
            array.setflags(write=False)
            object.__setattr__(self, own.name, array)
        _check(self)

    @property
    def duration(self) -> float:
        """Total time, s."""
        return float(self.breaks[-1])

    @property
    def joints(self) -> int:
        return int(self.coefficients.shape[2])

    def __call__(self, t: ArrayLike, order: int = 0) -> Array:
        """Position (or its derivative of `order`) at times `t` `(…)`: `(…, joints)`.

        Times outside `[0, duration]` are moved to the nearer end. At a break the later piece
        counts.
        """
        wanted = np.asarray(t, dtype=float)
        time = np.clip(wanted, 0.0, self.duration)
        piece = self._piece_at(time)
        local = time - self.breaks[piece]
        derivative = polynomials.derivative(self.coefficients, order)
        return polynomials.evaluate(derivative[:, piece], local[..., None])

    def __repr__(self) -> str:
        times = [f"{time:.6g}" for time in self.waypoint_times]
        passed = ", ".join(times)
        pieces = len(self.lengths)
        degree = len(self.coefficients) - 1
        return (
            f"Trajectory({self.duration:.6g} s, {self.joints} joints, {pieces} pieces of degree "
            f"{degree}, waypoints at {passed} s)"
        )

    def pieces(self, order: int = 0, some: slice = slice(None)) -> Array:
        """The derivative of `order`, every piece on the unit interval `[0, 1]`.

        Args:
            order: of the derivative.
            some: which pieces; by default all.

        Returns:
            Coefficients `(degree + 1 − order, pieces, joints)`, highest power first, whose values
            are rad/s^order.
        """
        found = self._pieces.get(order)
        if found is None:
            is_kept = self.coefficients.size <= KEPT_VALUES
            wanted = slice(None) if is_kept else some
            derivative = polynomials.derivative(self.coefficients[:, wanted], order)
            found = polynomials.stretched(derivative, self.lengths[wanted])
            found.setflags(write=False)
            if not is_kept:
                return found
            self._pieces[order] = found
        return found[:, some]

    def ends(self, order: int = 0) -> tuple[Array, Array]:
        """The derivative of `order` at both ends of every piece, `(pieces, joints)` each."""
        starts, stops = [], []
        for some in self.blocks():
            unit = self.pieces(order, some)
            starts.append(unit[-1].copy())  # not a view, which would keep the block
            stops.append(unit.sum(axis=0))
        if len(starts) == 1:
            return starts[0], stops[0]
        return np.concatenate(starts), np.concatenate(stops)

    def blocks(self) -> Iterator[slice]:
        """Yield the pieces in blocks, in order: of one block everything fits into memory."""
        size = max(1, KEPT_VALUES // (len(self.coefficients) * self.joints))
        count = len(self.lengths)
        for first in range(0, count, size):
            yield slice(first, min(first + size, count))

    @cached_property
    def _pieces(self) -> dict[int, Array]:
        """Results of `pieces` by order: the verifier needs them several times."""
        return {}

    def __getstate__(self) -> dict[str, Array]:
        """The arrays alone: results computed from them are not sent between processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def __setstate__(self, arrays: dict[str, Array]) -> None:
        """Take arrays from another process, which are as unchangeable here."""
        for array in arrays.values():
            array.setflags(write=False)
        self.__dict__.update(arrays)

    def with_coefficients(self, coefficients: Array, waypoint_times: Array) -> Trajectory:
        """The motion of other polynomials between the same breaks.

        Args:
            coefficients: finite; the array is taken over, which cannot be changed then: a copy of a
                log's motion may be hundreds of MB.
            waypoint_times: at breaks, s.
        """
        found = object.__new__(Trajectory)
        arrays = {"coefficients": coefficients, "waypoint_times": waypoint_times}
        found.__setstate__({**self.__getstate__(), **arrays})
        return found

    def dilated(self, factor: float) -> Trajectory:
        """Slow the motion down `factor` times: the n-th derivative divides by `factor ** n`.

        Raises:
            InvalidTrajectory: the factor is not a positive number.
        """
        if not 0 < factor < np.inf:
            raise InvalidTrajectory(f"the factor of a dilation must be positive, got {factor}")
        coefficients = polynomials.stretched(self.coefficients, 1.0 / factor)
        breaks, times, lengths = (
            array * factor for array in (self.breaks, self.waypoint_times, self.lengths)
        )
        return Trajectory(breaks, coefficients, times, lengths)

    def refined(self, times: ArrayLike) -> Trajectory:
        """Add a break at each of these times, s, without changing the motion.

        A time within rounding of a break adds none; times outside `[0, duration]` are moved to the
        nearer end.
        """
        within = np.asarray(times, dtype=float)
        wanted = np.clip(within, 0.0, self.duration)
        slack = BREAK_RTOL * self.duration
        neighbours = self.breaks[nearest(self.breaks, wanted)]
        distance = np.abs(wanted - neighbours)
        missing = distance > slack
        if not missing.any():
            return self
        added = np.unique(wanted[missing])
        breaks = np.union1d(self.breaks, added)
        piece = self._piece_at(breaks[:-1])
        offset = breaks[:-1] - self.breaks[piece]
        given = self.coefficients[:, piece]
        coefficients = polynomials.shifted(given, offset[:, None])
        following = np.append(offset[1:], 0.0)
        end = np.where(following > 0, following, self.lengths[piece])
        return Trajectory(breaks, coefficients, self.waypoint_times, end - offset)

    def segments_at(self, times: ArrayLike) -> Indices:
        """Return the segment of each time, s, from 0; of a waypoint's the one that it begins."""
        return np.searchsorted(self.waypoint_times[1:-1], np.asarray(times), side="right")

    @classmethod
    def of_segments(cls, segments: Iterable[tuple[Array, Array]]) -> Trajectory:
        """Put the segments between waypoints one after another.

        Args:
            segments: the lengths of each one's pieces, s, `(pieces,)`, and their coefficients, as a
                trajectory has them, of one degree. Lengths stay as they are. A piece that is too
                short to change the time since the start is left out.
        """
        all_lengths, all_coefficients = zip(*segments, strict=True)
        lengths = np.concatenate(all_lengths)
        coefficients = np.concatenate(all_coefficients, axis=1)
        passed = np.cumsum(lengths)
        before = np.append(0.0, passed[:-1])
        used = passed > before
        breaks = np.append(0.0, passed[used])
        counts = [len(own) for own in all_lengths]
        ends = np.cumsum(counts) - 1
        passages = np.append(0.0, passed[ends])
        return cls(breaks, coefficients[:, used], passages, lengths[used])

    @classmethod
    def joined(cls, joints: Sequence[tuple[Array, Array]], waypoint_times: ArrayLike) -> Trajectory:
        """Put joints with breaks of their own on the union of all breaks.

        Args:
            joints: `(breaks, coefficients)` of each joint, coefficients `(degree + 1, pieces)`,
                all starting at 0 and ending together (to rounding).
            waypoint_times: s, `(waypoints,)`.
        """
        times = np.asarray(waypoint_times, dtype=float)
        breaks = _union([breaks for breaks, _ in joints], times)
        rows = max(len(coefficients) for _, coefficients in joints)
        starts = breaks[:-1]
        middles = 0.5 * (starts + breaks[1:])
        found = np.zeros((rows, len(starts), len(joints)))
        for joint, (own, coefficients) in enumerate(joints):
            # each joint's own pieces, from where they start, missing powers as zeros
            piece = np.searchsorted(own[1:-1], middles, side="right")
            own_pieces = np.zeros((rows, len(starts)))
            own_pieces[rows - len(coefficients) :] = coefficients[:, piece]
            found[..., joint] = polynomials.shifted(own_pieces, starts - own[piece])
        return cls(breaks, found, times)

    def beside(self, start: Array, moving: Bools) -> Trajectory:
        """The motion of the joints that move, beside joints that stay where they start.

        Args:
            start: where each joint starts, `(joints,)`, rad.
            moving: which joints move, `(joints,)`.
        """
        rows, pieces, _ = self.coefficients.shape
        coefficients = np.zeros((rows, pieces, len(start)))
        coefficients[-1] = start
        coefficients[..., moving] = self.coefficients
        return replace(self, coefficients=coefficients)

    @classmethod
    def from_samples(
        cls,
        times: ArrayLike,
        positions: ArrayLike,
        velocities: ArrayLike | None = None,
        accelerations: ArrayLike | None = None,
        *,
        interpolation: Interpolation = "auto",
        waypoint_times: ArrayLike | None = None,
    ) -> Trajectory:
        """The motion that a controller runs between samples (docs/mathematics.md, section 11).

        Nothing is smoothed: each piece is the polynomial that the interpolation names, through all
        samples. The motion starts at time 0, whatever the first sample's time.

        Args:
            times: strictly increasing, s, `(samples,)`.
            positions: rad, `(samples, joints)`.
            velocities: rad/s, `(samples, joints)`, if known.
            accelerations: rad/s², `(samples, joints)`, if known; only beside velocities.
            interpolation: by default what `joint_trajectory_controller` of ros2_control does:
                straight lines, with velocities cubic and with accelerations quintic pieces.
            waypoint_times: when each waypoint is passed, s since the first sample; by default
                the start and the end alone.

        Raises:
            InvalidInput: Samples that are no motion, or lack what the interpolation needs.
        """
        t = np.asarray(times, dtype=float)
        q = np.asarray(positions, dtype=float)
        v = None if velocities is None else np.asarray(velocities, dtype=float)
        a = None if accelerations is None else np.asarray(accelerations, dtype=float)
        between.check(t, q, v, a)
        coefficients = between.pieces(interpolation, t, q, v, a)
        breaks = t - t[0]
        if waypoint_times is None:
            waypoint_times = breaks[[0, -1]]
        return cls(breaks, coefficients, np.asarray(waypoint_times, dtype=float))

    @classmethod
    def from_ppoly(cls, ppoly: PPoly, *, waypoint_times: ArrayLike | None = None) -> Trajectory:
        """The motion of SciPy's piecewise polynomial (`PPoly`, `CubicSpline` and others).

        Polynomials and breaks are taken over; time is moved so that the first break is 0.

        Args:
            ppoly: of time in seconds, radians, `(joints,)` or one number for one joint.
            waypoint_times: when each waypoint is passed, s since the first break; by default the
                start and the end alone.

        Raises:
            InvalidTrajectory: The polynomial has several axes, is complex or not finite, or runs
                backwards.
        """
        return cls._of_pieces(piecewise.of_scipy(ppoly), waypoint_times)

    @classmethod
    def from_spline(cls, spline: BSpline, *, waypoint_times: ArrayLike | None = None) -> Trajectory:
        """The motion of SciPy's B-spline, on its interval `[t[k], t[-k - 1]]`.

        Every piece between two knots is converted exactly. A spline may jump where knots are
        repeated, which is judged like any jump. Time is moved so that the interval starts at 0.

        Args:
            spline: of time in seconds, radians, `(joints,)` or one number for one joint.
            waypoint_times: as for `from_ppoly`.

        Raises:
            InvalidTrajectory: The spline has several axes, or is complex or not finite.
        """
        return cls._of_pieces(piecewise.of_scipy(spline), waypoint_times)

    @classmethod
    def composed(
        cls,
        path: Trajectory | PPoly | BSpline,
        s_of_t: Trajectory | PPoly | BSpline,
        *,
        waypoint_times: ArrayLike | None = None,
    ) -> Trajectory:
        """The motion `q(s(t))` along a path: a polynomial on every piece, exactly.

        It has breaks where `s(t)` has them, and where `s(t)` crosses a break of the path. `s(t)`
        may run back and forth, and may stand.

        Args:
            path: `q(s)`, radians, of any parameter `s`.
            s_of_t: one function of time in seconds, whose values stay within the path's domain.
            waypoint_times: as for `from_ppoly`.

        Raises:
            InvalidTrajectory: `s(t)` is several functions, or leaves the path's domain.
        """
        outer = _pieces_of(path)
        inner = cls._of_pieces(_pieces_of(s_of_t), None)
        if inner.joints != 1:
            raise InvalidTrajectory("the path's parameter s(t) must be one function")
        _check_domain(outer, inner)
        s = _broken_at(inner, outer.breaks[1:-1])
        # Each piece of s(t) lies within one piece of the path: that of its middle.
        middle = s(s.breaks[:-1] + 0.5 * s.lengths)[:, 0]
        after = np.searchsorted(outer.breaks[1:-1], middle, side="right")
        local = np.array(s.coefficients)  # s(t) since that piece's start
        local[-1, :, 0] -= outer.breaks[after]
        result = polynomials.composed(outer.coefficients[:, after], local)
        return cls._of_pieces(PiecewisePolynomial(s.breaks, result), waypoint_times)

    @classmethod
    def _of_pieces(
        cls, pieces: PiecewisePolynomial, waypoint_times: ArrayLike | None
    ) -> Trajectory:
        breaks = pieces.breaks - pieces.breaks[0]
        if waypoint_times is None:
            waypoint_times = breaks[[0, -1]]
        return cls(breaks, pieces.coefficients, np.asarray(waypoint_times, dtype=float))

    def _piece_at(self, time: Array) -> Indices:
        after = np.searchsorted(self.breaks, time, side="right")
        last = len(self.breaks) - 2
        return np.clip(after - 1, 0, last)


def _pieces_of(function: Trajectory | PPoly | BSpline) -> PiecewisePolynomial:
    if isinstance(function, Trajectory):
        return PiecewisePolynomial(function.breaks, function.coefficients)
    return piecewise.of_scipy(function)


def _check_domain(path: PiecewisePolynomial, s: Trajectory) -> None:
    """Refuse a parameter `s(t)` that leaves the path: its extrema lie within the domain."""
    unit = s.pieces()[..., 0]
    points = polynomials.critical_points(unit)
    values = polynomials.evaluate(unit[:, None], points)
    lowest = values.min()
    highest = values.max()
    first = path.breaks[0]
    last = path.breaks[-1]
    slack = DOMAIN_RTOL * max(last - first, abs(first), abs(last))
    inside = lowest >= first - slack and highest <= last + slack
    if not inside:  # also where a value is not a number
        reached = f"s(t) runs from {lowest:.9g} to {highest:.9g}"
        raise InvalidTrajectory(f"{reached}; the path from {first:.9g} to {last:.9g}")


def _broken_at(s: Trajectory, levels: Array) -> Trajectory:
    """Add a break wherever a function of time crosses one of the levels."""
    unit = s.pieces()[..., 0]
    times = []
    for level in levels:
        shifted = np.array(unit)
        shifted[-1] -= level
        shares = polynomials.unit_roots(shifted)
        row, piece = np.nonzero(np.isfinite(shares))
        elapsed = shares[row, piece] * s.lengths[piece]
        times.append(s.breaks[piece] + elapsed)
    crossings = np.concatenate([np.zeros(0), *times])
    distance = np.abs(crossings - s.breaks[nearest(s.breaks, crossings)])
    return s.refined(crossings[distance > CROSSING_RTOL * s.duration])


def _check(trajectory: Trajectory) -> None:
    breaks = trajectory.breaks
    if breaks.ndim != 1 or len(breaks) < 2 or breaks[0] != 0 or not _rises(breaks):
        raise InvalidTrajectory("breaks must be strictly increasing times from 0")
    pieces = len(breaks) - 1
    shape = trajectory.coefficients.shape
    fits = len(shape) == 3 and shape[1] == pieces
    if not fits or 0 in shape:
        expected = f"(degree + 1, {pieces}, joints)"
        raise InvalidTrajectory(f"coefficients are {shape}, expected {expected}")
    rounding = END_RTOL * breaks[-1]
    lengths = trajectory.lengths
    if lengths.shape != (pieces,) or not (lengths > 0).all():
        raise InvalidTrajectory(f"lengths must be {pieces} times above 0")
    summed = np.cumsum(lengths)
    is_far = np.abs(summed - breaks[1:]) > rounding
    differs = np.abs(lengths - np.diff(breaks)) > LENGTH_RTOL * breaks[-1]
    if is_far.any() or differs.any():
        raise InvalidTrajectory("lengths must be the differences of the breaks, but for rounding")
    waypoint_times = trajectory.waypoint_times
    if waypoint_times.ndim != 1 or waypoint_times.size < 2:
        raise InvalidTrajectory("waypoint_times must be two or more times")
    misses = waypoint_times[[0, -1]] - breaks[[0, -1]]
    near = np.abs(misses).max() <= rounding
    if not near or (np.diff(waypoint_times) < 0).any():
        raise InvalidTrajectory("waypoint_times must not decrease, from 0 to the last break")


def _rises(times: Array) -> bool:
    steps = np.diff(times)
    return bool((steps > 0).all())


def nearest(sorted_times: Array, wanted: Array) -> Indices:
    """The index of the nearest of some sorted times to each wanted one."""
    after = np.searchsorted(sorted_times, wanted)
    after = after.clip(1, len(sorted_times) - 1)
    before = after - 1
    to_before = np.abs(wanted - sorted_times[before])
    to_after = np.abs(wanted - sorted_times[after])
    return np.where(to_before <= to_after, before, after)


def _union(all_breaks: Sequence[Array], times: Array) -> Array:
    """All breaks that differ by more than rounding; waypoint times replace their neighbours."""
    slack = BREAK_RTOL * times[-1]
    others = np.concatenate(all_breaks)
    waypoint = times[nearest(times, others)]
    distance = np.abs(others - waypoint)
    within = (others > 0) & (others < times[-1])
    inside = others[within & (distance > slack)]
    merged = np.unique(np.concatenate([times, inside]))
    apart = np.diff(merged) > slack
    return merged[np.r_[True, apart]]
