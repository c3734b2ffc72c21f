"""The trajectory: a piecewise polynomial of time, one per joint, on common breaks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt import polynomials
from trajopt.exceptions import InvalidTrajectory

Array = NDArray[np.float64]

# Breaks closer than this fraction of the duration are one break.
_SAME_BREAK = 1e-13


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Positions of all joints over `[0, duration]`, in the layout of `scipy.interpolate.PPoly`.

    - `breaks` `(pieces + 1,)`: strictly increasing times from 0, s;
    - `coefficients` `(degree + 1, pieces, joints)`: highest power first, in the time since the
      piece's start, rad/s^power;
    - `waypoint_times` `(waypoints,)`: when each waypoint is passed, from 0 to `duration`, s.

    Raises `InvalidTrajectory` where these do not fit together or are not finite.
    """

    breaks: Array
    coefficients: Array
    waypoint_times: Array

    def __post_init__(self) -> None:
        for name in ("breaks", "coefficients", "waypoint_times"):
            array = np.array(getattr(self, name), dtype=float)
            if not np.isfinite(array).all():
                raise InvalidTrajectory(f"{name} holds a value that is not finite")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        _check(self.breaks, self.coefficients, self.waypoint_times)

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
        time = np.clip(np.asarray(t, dtype=float), 0.0, self.duration)
        piece = np.clip(
            np.searchsorted(self.breaks, time, side="right") - 1, 0, len(self.breaks) - 2
        )
        local = (time - self.breaks[piece])[..., None]
        return polynomials.evaluate(
            polynomials.derivative(self.coefficients, order)[:, piece], local
        )

    def dilated(self, factor: float) -> Trajectory:
        """The same path, `factor` times as slow: the n-th derivative divides by `factor ** n`."""
        if not 0 < factor < np.inf:
            raise InvalidTrajectory(f"the factor of a dilation must be positive, got {factor}")
        coefficients = polynomials.stretched(self.coefficients, 1.0 / factor)
        return Trajectory(self.breaks * factor, coefficients, self.waypoint_times * factor)

    @classmethod
    def joined(cls, joints: Sequence[tuple[Array, Array]], waypoint_times: ArrayLike) -> Trajectory:
        """Put joints with breaks of their own on the union of all breaks.

        `joints` holds `(breaks, coefficients)` per joint, coefficients `(degree + 1, pieces)`,
        all starting at 0 and ending together (to rounding).
        """
        times = np.asarray(waypoint_times, dtype=float)
        breaks = _union([breaks for breaks, _ in joints], times)
        degree = max(len(c) for _, c in joints)
        columns = [_resampled(own, c, breaks, degree) for own, c in joints]
        return cls(breaks, np.stack(columns, axis=-1), times)

    @classmethod
    def of_moving(
        cls,
        start: Array,
        moving: NDArray[np.bool_],
        parts: Sequence[tuple[Array, Array]],
        waypoint_times: ArrayLike,
    ) -> Trajectory:
        """Joints that move, joined, beside those that stay where they start.

        Args:
            start: Where each joint starts, `(joints,)`, rad.
            moving: Which joints move, `(joints,)`.
            parts: `(breaks, coefficients)` of each joint that moves, as for `joined`.
            waypoint_times: When each waypoint is passed, s.
        """
        times = np.asarray(waypoint_times, dtype=float)
        whole = times[[0, -1]]
        joints = [(whole, np.array([[q]])) for q in start]
        for joint, part in zip(np.flatnonzero(moving), parts, strict=True):
            joints[joint] = part
        return cls.joined(joints, times)


def _check(breaks: Array, coefficients: Array, waypoint_times: Array) -> None:
    if breaks.ndim != 1 or len(breaks) < 2 or breaks[0] != 0 or (np.diff(breaks) <= 0).any():
        raise InvalidTrajectory("breaks must be strictly increasing times from 0")
    if (
        coefficients.ndim != 3
        or coefficients.shape[1] != len(breaks) - 1
        or 0 in coefficients.shape
    ):
        expected = f"(degree + 1, {len(breaks) - 1}, joints)"
        raise InvalidTrajectory(f"coefficients are {coefficients.shape}, expected {expected}")
    slack = 1e-12 * breaks[-1]
    ends_fit = (
        waypoint_times.ndim == 1
        and waypoint_times.size >= 2
        and np.allclose(waypoint_times[[0, -1]], breaks[[0, -1]], rtol=0, atol=slack)
    )
    if not ends_fit or (np.diff(waypoint_times) < 0).any():
        raise InvalidTrajectory("waypoint_times must not decrease, from 0 to the last break")


def _union(all_breaks: Sequence[Array], times: Array) -> Array:
    """All breaks, those that rounding split counted once; waypoint times win over neighbours."""
    slack = _SAME_BREAK * times[-1]
    others = np.concatenate(all_breaks)
    near = np.searchsorted(times, others).clip(1, len(times) - 1)
    distance = np.minimum(np.abs(others - times[near - 1]), np.abs(others - times[near]))
    inside = others[(distance > slack) & (others > 0) & (others < times[-1])]
    merged = np.unique(np.concatenate([times, inside]))
    return merged[np.r_[True, np.diff(merged) > slack]]


def _resampled(own: Array, coefficients: Array, breaks: Array, degree: int) -> Array:
    """One joint's polynomials on finer breaks, padded with zero leading coefficients."""
    middle = 0.5 * (breaks[:-1] + breaks[1:])
    piece = np.clip(np.searchsorted(own, middle, side="right") - 1, 0, len(own) - 2)
    moved = polynomials.shifted(coefficients[:, piece], breaks[:-1] - own[piece])
    return np.concatenate([np.zeros((degree - len(moved), moved.shape[1])), moved])
