"""The one exact judge: true peaks from polynomial roots, every miss, and the certified duration.

Nothing is sampled (docs/mathematics.md, sections 2 and 7). Dividing a piece's
polynomial by its limit gives its use of the limit; Bernstein coefficients bound that use, and only
the pieces whose bound exceeds the worst use found so far need their roots.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.exceptions import InvalidTrajectory
from trajopt.problem import Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]
Measure = Callable[[Array, Array, Array], Array]  # (values, low, high) -> use of the limit

_STAIRCASE = 4.0  # a joint's jumps may add up to this many times what one may be
_CHUNK = 256  # pieces whose roots are found at once, the most promising first


@dataclass(frozen=True)
class Tolerance:
    """How far a trajectory may stray and still count as keeping its word.

    - `limit`: relative, for velocity, acceleration and jerk;
    - `position`: rad, for waypoints, position limits and jumps of position, times the largest
      waypoint coordinate where that exceeds 1;
    - `jump`: of velocity and acceleration at the breaks, relative to their limits.

    A joint's jumps may add up to four times what one of them may be.
    """

    limit: float = 1e-6
    position: float = 1e-8
    jump: float = 1e-6


@dataclass(frozen=True)
class Worst:
    """The worst value of one kind: `joint` counts from 0, `time` in seconds.

    `value` is a ratio to the limit (velocity, acceleration, jerk) or an error in SI units
    (position, waypoint, continuity; of the derivative of that `order`, in sum where many jumps
    small by themselves add up).
    """

    value: float
    joint: int
    time: float
    order: int = 0


@dataclass(frozen=True)
class Certificate:
    """What `verify` found. `None` where a kind does not exist for the problem.

    `dilation` is the exact cheapest factor `k` that brings the trajectory within its velocity,
    acceleration and jerk limits; below 1, it left something on the table. `flaws` lists what no
    dilation can mend; then there is no certified duration.
    """

    duration: float
    dilation: float
    velocity: Worst
    acceleration: Worst
    jerk: Worst | None
    position: Worst | None
    waypoint: Worst
    continuity: Worst
    flaws: tuple[str, ...]
    tolerance: Tolerance

    @property
    def valid(self) -> bool:
        return not self.flaws

    @property
    def feasible(self) -> bool:
        """Whether the trajectory keeps every limit as it stands, within tolerance."""
        ratios = [w.value for w in (self.velocity, self.acceleration, self.jerk) if w]
        return self.valid and max(ratios) <= 1 + self.tolerance.limit

    @property
    def certified_duration(self) -> float | None:
        """`max(1, dilation) · duration` in seconds, or `None` if dilation cannot mend it."""
        return max(1.0, self.dilation) * self.duration if self.valid else None

    def as_dict(self) -> dict[str, Any]:
        """For JSON: joints count from 1, limits give a `ratio`, misses an `error`."""
        table: dict[str, Any] = {"feasible": self.feasible, "dilation": self.dilation}
        for kind in ("velocity", "acceleration", "jerk", "position", "waypoint", "continuity"):
            worst: Worst | None = getattr(self, kind)
            word = "ratio" if kind in ("velocity", "acceleration", "jerk") else "error"
            table[kind] = worst and {
                word: worst.value,
                "joint": worst.joint + 1,
                "time": worst.time,
            }
            if worst and kind == "continuity":
                table[kind]["order"] = worst.order
        return table


def verify(
    problem: Problem, trajectory: Trajectory, tolerance: Tolerance | None = None
) -> Certificate:
    """Judge a trajectory exactly against a problem.

    Raises `InvalidTrajectory` if it has another number of joints or waypoints than the problem.
    """
    tolerance = tolerance or Tolerance()
    _check_sizes(problem, trajectory)
    limits, scale = problem.limits, max(1.0, float(np.abs(problem.waypoints).max()))
    velocity = _peak(trajectory, 1, limits.velocity, _ratio)
    acceleration = _peak(trajectory, 2, limits.acceleration, _ratio)
    jerk = _peak(trajectory, 3, limits.jerk, _ratio) if problem.has("jerk") else None
    position = _peak(trajectory, 0, limits.position, _excess) if problem.has("position") else None
    waypoint = _worst_miss(problem, trajectory)
    jumps = _jumps(problem, trajectory, tolerance, scale)
    worst_jump = max(jumps, key=lambda pair: pair[1])[0]
    flaws = _flaws(position, waypoint, jumps, tolerance.position * scale)
    roots = [(velocity, 1.0), (acceleration, 0.5), (jerk, 1 / 3)]
    dilation = max(worst.value**power for worst, power in roots if worst)
    return Certificate(
        trajectory.duration, dilation, velocity, acceleration, jerk, position, waypoint, worst_jump,
        flaws, tolerance,
    )  # fmt: skip


def certified(problem: Problem, trajectory: Trajectory) -> Trajectory | None:
    """The trajectory, dilated where it breaks a limit; None where dilation cannot mend it."""
    certificate = verify(problem, trajectory)
    return trajectory.dilated(max(1.0, certificate.dilation)) if certificate.valid else None


def _check_sizes(problem: Problem, trajectory: Trajectory) -> None:
    if trajectory.joints != problem.joints:
        raise InvalidTrajectory(f"{trajectory.joints} joints; the problem has {problem.joints}")
    if len(trajectory.waypoint_times) != len(problem.waypoints):
        given, needed = len(trajectory.waypoint_times), len(problem.waypoints)
        raise InvalidTrajectory(f"{given} waypoint times; the problem has {needed} waypoints")


def _ratio(values: Array, low: Array, high: Array) -> Array:
    return np.maximum(values / high, values / low)


def _excess(values: Array, low: Array, high: Array) -> Array:
    return np.maximum(values - high, low - values)


def _peak(trajectory: Trajectory, order: int, limits: Array, measure: Measure) -> Worst:
    """The exact worst of a convex measure of a derivative, over all pieces and joints."""
    lengths, (low, high) = np.diff(trajectory.breaks), limits.T
    derivative = polynomials.derivative(trajectory.coefficients, order)
    unit = polynomials.stretched(derivative, lengths)
    bounds = measure(polynomials.bernstein(unit), low, high).max(axis=0)
    ends = measure(np.stack([unit[-1], unit.sum(axis=0)]), low, high)
    side, piece, joint = np.unravel_index(np.argmax(ends), ends.shape)
    best = (float(ends[side, piece, joint]), int(piece), int(joint), float(side))
    order_by_bound = np.argsort(-bounds, axis=None)
    for start in range(0, bounds.size, _CHUNK):
        chunk = order_by_bound[start : start + _CHUNK]
        chunk = chunk[bounds.ravel()[chunk] > best[0]]
        if not len(chunk):
            break
        best = max(
            best, _peak_among(unit, np.unravel_index(chunk, bounds.shape), low, high, measure)
        )
    value, piece_, joint_, s = best
    return Worst(value + 0.0, joint_, float(trajectory.breaks[piece_] + s * lengths[piece_]))


def _peak_among(
    unit: Array, where: tuple[NDArray[np.intp], ...], low: Array, high: Array, measure: Measure
) -> tuple[float, int, int, float]:
    pieces, joints = where
    candidates = unit[:, pieces, joints]
    points = polynomials.critical_points(candidates)
    values = measure(polynomials.evaluate(candidates[:, None], points), low[joints], high[joints])
    row, i = np.unravel_index(np.argmax(values), values.shape)
    return float(values[row, i]), int(pieces[i]), int(joints[i]), float(points[row, i])


def _worst_miss(problem: Problem, trajectory: Trajectory) -> Worst:
    errors = np.abs(trajectory(trajectory.waypoint_times) - problem.waypoints)
    row, joint = np.unravel_index(np.argmax(errors), errors.shape)
    time = float(trajectory.waypoint_times[row])
    return Worst(float(errors[row, joint]), int(joint), time)


def _jumps(
    problem: Problem, trajectory: Trajectory, tolerance: Tolerance, scale: float
) -> list[tuple[Worst, float]]:
    """The worst jump of each order at any break, and its size over its tolerance.

    Before and after the motion the robot rests at its first and last waypoint. Acceleration counts
    for the joints whose jerk is limited.
    """
    limits = problem.limits
    position = np.full(problem.joints, tolerance.position * scale)
    velocity = tolerance.jump * np.abs(limits.velocity).min(axis=1)
    jerk_limited = np.isfinite(limits.jerk).any(axis=1)
    acceleration = tolerance.jump * np.abs(limits.acceleration).min(axis=1)
    allowed = [position, velocity, np.where(jerk_limited, acceleration, np.inf)]
    return [_worst_jump(problem, trajectory, order, a) for order, a in enumerate(allowed)]


def _worst_jump(
    problem: Problem, trajectory: Trajectory, order: int, allowed: Array
) -> tuple[Worst, float]:
    lengths = np.diff(trajectory.breaks)
    unit = polynomials.stretched(polynomials.derivative(trajectory.coefficients, order), lengths)
    still = problem.waypoints[[0, -1]] if order == 0 else np.zeros((2, problem.joints))
    before = np.vstack([still[:1], unit.sum(axis=0)])
    after = np.vstack([unit[-1], still[1:]])
    jumps = np.abs(after - before)
    # A staircase of tiny jumps is as good as a large one, so their sum counts too.
    candidates = np.stack([jumps.max(axis=0), jumps.sum(axis=0)])
    excess = candidates / (allowed * np.array([[1.0], [_STAIRCASE]]))
    kind, joint = np.unravel_index(np.argmax(excess), excess.shape)
    time = float(trajectory.breaks[np.argmax(jumps[:, joint])])
    worst = Worst(float(candidates[kind, joint]), int(joint), time, order)
    return worst, float(excess[kind, joint])


def _flaws(
    position: Worst | None, waypoint: Worst, jumps: list[tuple[Worst, float]], allowed: float
) -> tuple[str, ...]:
    """What dilation cannot mend, in words."""
    found = []
    if position and position.value > allowed:
        found.append(_say(position, "leaves its position limits by", "rad"))
    if waypoint.value > allowed:
        found.append(_say(waypoint, "misses the waypoint by", "rad"))
    units = (
        ("position jumps by", "rad"),
        ("velocity jumps by", "rad/s"),
        ("acceleration jumps by", "rad/s²"),
    )
    found += [_say(worst, *units[worst.order]) for worst, excess in jumps if excess > 1]
    return tuple(found)


def _say(worst: Worst, what: str, unit: str) -> str:
    return f"joint {worst.joint + 1} at {worst.time:.6g} s: {what} {worst.value:.3g} {unit}"
