"""The exact judge: true peaks from polynomial roots, every miss, and the certified duration.

Nothing is sampled, and nothing is tolerated (docs/mathematics.md, sections 2 and 7). A trajectory
whose misses and jumps are within tolerance is repaired exactly, and the repaired one is judged.
A piece's polynomial over its limit is its use of the limit. Bernstein coefficients bound that use:
roots are found only for pieces whose bound exceeds the worst use so far.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Indices
from trajopt.core.exceptions import InvalidTrajectory, WrongType, shown
from trajopt.core.limits import LIMIT_ORDERS
from trajopt.core.problem import Problem, check_problem
from trajopt.core.trajectory import EPS, Trajectory
from trajopt.judging.repair import repaired

Measure = Callable[[Array, Array, Array, Array], Array]  # (values, rounding, low, high)

PIECES_PER_CHUNK = 256  # roots are found for so many pieces at once, the largest bounds first
BREAK_TIME_RTOL = 16 * EPS  # the rounding of a break's time, relative to the duration

RATIO_KINDS = tuple(name for name, order in LIMIT_ORDERS.items() if order > 0)
"""The worst values that are ratios to a limit; dilation reduces them."""
WORST_KINDS = (*RATIO_KINDS, "position", "waypoint", "continuity")
"""Every worst value of a certificate; those that are no ratio are errors in SI units."""


@dataclass(frozen=True)
class Tolerance:
    """The largest misses and jumps that are repaired.

    A miss within tolerance is repaired, and the repaired trajectory is certified. A larger miss is
    a flaw.

    Attributes:
        limit: for velocity, acceleration and jerk to count as kept, relative.
        position: of waypoints and jumps of position, relative to the joint's largest displacement.
        position_limit: relative to the joint's largest displacement.
        jump: of velocity and acceleration at the breaks, relative to what the joint can reach:
            `min(V, sqrt(A h))` and `min(A, cbrt(J² h))`, `h` its largest displacement.
    """

    limit: float = 1e-6
    position: float = 1e-6
    position_limit: float = 1e-8
    jump: float = 1e-6


@dataclass(frozen=True)
class Worst:
    """The worst value of one kind.

    Attributes:
        value: a ratio to the limit (velocity, acceleration, jerk), or an error in SI units
            (position, waypoint, continuity: of the derivative of that `order`).
        joint: counted from 0.
        time: s.
        order: of the derivative that jumps.
    """

    value: float
    joint: int
    time: float
    order: int = 0


@dataclass(frozen=True, repr=False)
class Certificate:
    """The result of `verify`.

    Peaks of velocity, acceleration and jerk are those of the repaired trajectory, or of the given
    one where it is beyond repair; `position`, `waypoint` and `continuity` are the given one's.
    `None` where a kind does not exist for the problem, or is not judged.

    Attributes:
        duration: of the given trajectory, s.
        dilation: the exact cheapest factor `k` that brings the trajectory within its velocity,
            acceleration and jerk limits (section 2); below 1, it could be faster.
        flaws: errors that neither repair nor dilation can remove, in words. With a flaw there is no
            certified duration.
        tolerance: the tolerance used.
    """

    duration: float
    dilation: float
    velocity: Worst
    acceleration: Worst | None
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
        """Return whether the trajectory keeps every limit without dilation, within tolerance."""
        peaks = [getattr(self, kind) for kind in RATIO_KINDS]
        highest = max(worst.value for worst in peaks if worst)
        return self.valid and highest <= 1 + self.tolerance.limit

    @property
    def certified_duration(self) -> float | None:
        """`max(1, dilation) · duration` in seconds, or `None` if there is a flaw."""
        if not self.valid:
            return None
        return max(1.0, self.dilation) * self.duration

    def without_acceleration(self) -> Certificate:
        """Return the certificate that does not judge accelerations: nothing says their limits."""
        return replace(self, acceleration=None, dilation=_dilation(self.velocity, None, self.jerk))

    def __repr__(self) -> str:
        if not self.valid:
            return f"Certificate(invalid: {'; '.join(self.flaws)})"
        verdict = "feasible" if self.feasible else "not feasible"
        return (
            f"Certificate({verdict}, {self.duration:.6g} s claimed, dilation {self.dilation:.6g}, "
            f"{self.certified_duration:.6g} s certified)"
        )

    def as_dict(self) -> dict[str, Any]:
        """For JSON: joints count from 1, limits give a `ratio`, misses an `error`."""
        table: dict[str, Any] = {"feasible": self.feasible, "dilation": self.dilation}
        for kind in WORST_KINDS:
            worst: Worst | None = getattr(self, kind)
            if worst is None:
                table[kind] = None
                continue
            word = "ratio" if kind in RATIO_KINDS else "error"
            table[kind] = {word: worst.value, "joint": worst.joint + 1, "time": worst.time}
            if kind == "continuity":
                table[kind]["order"] = worst.order
        return table


def verify(
    problem: Problem, trajectory: Trajectory, tolerance: Tolerance | None = None
) -> Certificate:
    """Judge a trajectory exactly against a problem.

    Raises:
        WrongType: It is no `Trajectory`, or the first argument no `Problem`.
        InvalidTrajectory: It has another number of joints or waypoints than the problem.
    """
    _check_sizes(problem, trajectory)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        return _judged(problem, trajectory, tolerance or Tolerance())[0]


def certified(problem: Problem, trajectory: Trajectory) -> Trajectory | None:
    """The trajectory that has the certified duration.

    It is repaired where the given one missed or jumped within tolerance, and dilated where it then
    breaks a limit. None where the given one has a flaw.
    """
    _check_sizes(problem, trajectory)
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        certificate, judged = _judged(problem, trajectory, Tolerance())
    if not certificate.valid:
        return None
    if certificate.dilation <= 1:
        return judged
    return judged.dilated(certificate.dilation)


def _check_sizes(problem: Problem, trajectory: Trajectory) -> None:
    check_problem(problem)
    if not isinstance(trajectory, Trajectory):
        raise WrongType(
            f"expected a trajopt.Trajectory, got {shown(trajectory)}: `judge` takes SciPy's "
            "splines, and Trajectory.from_ppoly(spline, waypoint_times) makes one"
        )
    if trajectory.joints != problem.joints:
        raise InvalidTrajectory(f"{trajectory.joints} joints; the problem has {problem.joints}")
    if len(trajectory.waypoint_times) != len(problem.waypoints):
        given = len(trajectory.waypoint_times)
        needed = len(problem.waypoints)
        raise InvalidTrajectory(
            f"{given} waypoint times; the problem has {needed} waypoints: give waypoint_times, "
            "or let `judge` find them"
        )


def _judged(
    problem: Problem, trajectory: Trajectory, tolerance: Tolerance
) -> tuple[Certificate, Trajectory]:
    """The certificate, and the trajectory that has its peaks: repaired, if that is possible."""
    allowed = _allowed(problem, trajectory.duration, tolerance)
    waypoint, missed = _worst_miss(problem, trajectory, allowed.waypoint)
    jumps = []
    for order, jump in enumerate(allowed.jumps):
        jumps.append(_worst_jump(problem, trajectory, order, jump))
    continuity, _ = max(jumps, key=lambda jump: jump[1])
    blurred, blur = _worst_blur(trajectory, allowed.blur)
    flaws = []
    if missed > 1:
        flaws.append(_say(problem, waypoint, "misses the waypoint by"))
    for worst, excess in jumps:
        if excess > 1:
            flaws.append(_say(problem, worst, _JUMP_WORDS[worst.order]))
    if blur > 1:
        flaws.append(_say(problem, blurred, "terms cancel, which rounds the position by"))

    repair = None if flaws else repaired(problem, trajectory)
    judged = repair or trajectory
    limits = problem.limits
    velocity = _peak(judged, 1, limits.velocity, _ratio)
    acceleration = _peak(judged, 2, limits.acceleration, _ratio)
    jerk = None
    if problem.has("jerk"):
        jerk = _peak(judged, 3, limits.jerk, _ratio)
    position = None
    if problem.has("position"):
        position = _peak(trajectory, 0, limits.position, _excess)
    dilation = _dilation(velocity, acceleration, jerk)
    if position and position.value > allowed.position_limit[position.joint]:
        flaws.insert(0, _say(problem, position, "leaves its position limits by"))
    if repair is None and not flaws:
        flaws.append("it passes different waypoints at one instant, or its numbers overflow")
    if not np.isfinite(dilation * judged.duration):
        flaws.append("its peaks are not finite numbers")
    certificate = Certificate(
        duration=trajectory.duration,
        dilation=dilation,
        velocity=velocity,
        acceleration=acceleration,
        jerk=jerk,
        position=position,
        waypoint=waypoint,
        continuity=continuity,
        flaws=tuple(flaws),
        tolerance=tolerance,
    )
    return certificate, judged


def _dilation(*worst: Worst | None) -> float:
    """`k = max(peak v / V, sqrt(peak a / A), cbrt(peak j / J))` (section 2), of those there are."""
    factors = [own.value ** (1 / order) for order, own in enumerate(worst, start=1) if own]
    return float(np.max(factors))  # a factor that is not a number stays one


@dataclass(frozen=True)
class _Allowed:
    """The largest misses and jumps of each joint that are repaired, `(joints,)` each.

    Attributes:
        waypoint, position_limit, blur: rad.
        jumps: of position, velocity and acceleration: rad, rad/s, rad/s².
    """

    waypoint: Array
    position_limit: Array
    blur: Array
    jumps: tuple[Array, Array, Array]


def _allowed(problem: Problem, duration: float, tolerance: Tolerance) -> _Allowed:
    limits = problem.limits
    largest = problem.largest_displacements
    coordinates = problem.rounding

    V = np.abs(limits.velocity).min(axis=1)
    A = np.abs(limits.acceleration).min(axis=1)
    J = np.abs(limits.jerk).min(axis=1)
    reached_velocity = np.minimum(V, np.sqrt(A * largest))
    root = np.cbrt(J)
    from_jerk = root**2 * np.cbrt(largest)
    reached_acceleration = np.minimum(A, from_jerk)
    # Breaks are rounded, which moves each derivative by as much as it changes meanwhile.
    rounded = BREAK_TIME_RTOL * duration
    position_jump = tolerance.position * largest + coordinates + rounded * V
    velocity_jump = tolerance.jump * reached_velocity + rounded * A
    acceleration_jump = tolerance.jump * reached_acceleration + rounded * J
    acceleration_jump = np.where(limits.jerk_limited, acceleration_jump, np.inf)
    return _Allowed(
        waypoint=tolerance.position * largest + coordinates,
        position_limit=tolerance.position_limit * largest + coordinates,
        blur=tolerance.position * largest + 4 * coordinates,
        jumps=(position_jump, velocity_jump, acceleration_jump),
    )


def _ratio(values: Array, rounding: Array, low: Array, high: Array) -> Array:
    upwards = (values + rounding) / high
    downwards = (values - rounding) / low
    return np.maximum(upwards, downwards)


def _excess(values: Array, rounding: Array, low: Array, high: Array) -> Array:
    above = values + rounding - high
    below = low - values + rounding
    return np.maximum(above, below)


class _Peak(NamedTuple):
    """A measured value, and where: `share` of the piece has passed. Tuples order by value."""

    value: float
    piece: int
    joint: int
    share: float


def _peak(trajectory: Trajectory, order: int, limits: Array, measure: Measure) -> Worst:
    """The exact worst of a convex measure of a derivative, over all pieces and joints.

    Rounded up by what evaluating the polynomials may round.
    """
    low, high = limits.T
    unit = trajectory.pieces(order)
    rounding = polynomials.evaluation_rounding(unit)
    if not np.isfinite(rounding).all():
        beyond = np.where(np.isfinite(rounding), 0.0, np.inf)
        allowed = np.ones(trajectory.joints)
        worst, _ = _worst_of(beyond, allowed, trajectory.breaks, order)
        return replace(worst, value=np.nan)
    starts = unit[-1]
    stops = unit.sum(axis=0)
    both = np.stack([starts, stops])
    ends = measure(both, rounding, low, high)
    side, piece, joint = np.unravel_index(np.argmax(ends), ends.shape)
    highest = float(ends.max())
    best = _Peak(highest, int(piece), int(joint), float(side))

    # No piece exceeds its bound: roots are needed only where the bound exceeds the worst so far.
    bounds = measure(polynomials.bernstein(unit), rounding, low, high)
    bounds = bounds.max(axis=0)
    by_bound = np.argsort(-bounds, axis=None)
    for start in range(0, bounds.size, PIECES_PER_CHUNK):
        chunk = by_bound[start : start + PIECES_PER_CHUNK]
        promising = chunk[bounds.ravel()[chunk] > best.value]
        if not len(promising):
            break
        where = np.unravel_index(promising, bounds.shape)
        best = max(best, _peak_among(unit, rounding, where, limits, measure))
    elapsed = best.share * trajectory.lengths[best.piece]
    time = trajectory.breaks[best.piece] + elapsed
    return Worst(best.value + 0.0, best.joint, float(time))


def _peak_among(
    unit: Array, rounding: Array, where: tuple[Indices, ...], limits: Array, measure: Measure
) -> _Peak:
    """The worst of some pieces, from their critical points."""
    pieces, joints = where
    candidates = unit[:, pieces, joints]
    points = polynomials.critical_points(candidates)
    values = polynomials.evaluate(candidates[:, None], points)
    low, high = limits[joints].T
    measured = measure(values, rounding[pieces, joints], low, high)
    row, i = np.unravel_index(np.argmax(measured), measured.shape)
    return _Peak(
        value=float(measured[row, i]),
        piece=int(pieces[i]),
        joint=int(joints[i]),
        share=float(points[row, i]),
    )


def _worst_miss(problem: Problem, trajectory: Trajectory, allowed: Array) -> tuple[Worst, float]:
    """The worst miss of a waypoint, and its size over what is allowed."""
    passed = trajectory(trajectory.waypoint_times)
    errors = np.abs(passed - problem.waypoints)
    return _worst_of(errors, allowed, trajectory.waypoint_times)


def _worst_jump(
    problem: Problem, trajectory: Trajectory, order: int, allowed: Array
) -> tuple[Worst, float]:
    """The worst jump of a derivative at any break, and its size over what is allowed.

    Before and after the motion the robot rests at its first and last waypoint.
    """
    unit = trajectory.pieces(order)
    still = np.zeros((2, problem.joints))
    if order == 0:
        still = problem.waypoints[[0, -1]]
    starts = unit[-1]
    stops = unit.sum(axis=0)
    before = np.vstack([still[:1], stops])
    after = np.vstack([starts, still[1:]])
    jumps = np.abs(after - before)
    return _worst_of(jumps, allowed, trajectory.breaks, order)


def _worst_blur(trajectory: Trajectory, allowed: Array) -> tuple[Worst, float]:
    """The largest rounding of a joint's position, and its size over what is allowed."""
    rounding = polynomials.evaluation_rounding(trajectory.pieces())
    return _worst_of(rounding, allowed, trajectory.breaks)


def _worst_of(errors: Array, allowed: Array, times: Array, order: int = 0) -> tuple[Worst, float]:
    """The error `(times, joints)` that is worst beside what is allowed `(joints,)`, and that ratio.

    An error that is not a number counts as infinite (`argmax` finds it).
    """
    excess = errors / allowed
    row, joint = np.unravel_index(np.argmax(excess), excess.shape)
    worst = Worst(
        value=float(errors[row, joint]), joint=int(joint), time=float(times[row]), order=order
    )
    ratio = float(excess[row, joint])
    return worst, np.inf if np.isnan(ratio) else ratio


_JUMP_WORDS = ("position jumps by", "velocity jumps by", "acceleration jumps by")


def _say(problem: Problem, worst: Worst, what: str) -> str:
    unit = problem.unit(worst.joint, worst.order)
    label = problem.joint_labels[worst.joint]
    where = f"{label} at {worst.time:.6g} s"
    return f"{where}: {what} {worst.value:.3g} {unit}"
