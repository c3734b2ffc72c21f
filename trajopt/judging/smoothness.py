"""How smooth a motion is: ∫ jerk² and ∫ acceleration², exactly from its polynomials.

    found = smoothness(problem, trajectory)
    print(found.jerk_integral, found.acceleration_integral)

The integrals (docs/mathematics.md, section 12) are sums over the joints, if all joints have one
unit. With both rad and m each joint is first divided by its acceleration limit. Where a derivative
jumps, the integral of the next one's square is infinite. The robot rests before and after the
motion, so acceleration also jumps where a motion starts with full acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.certificate import Certificate
from trajopt.judging.verification import certified

# If all jumps of a joint's derivative together are smaller than this, they are rounding. They count
# relative to the joint's limit times the largest use of a limit by any joint. So neither a dilation
# nor a joint that hardly moves changes the answer.
JUMP_RTOL = 1e-6
JUMPING = ("position", "velocity", "acceleration")
"""The derivatives that may jump, by order."""


@dataclass(frozen=True)
class Jump:
    """A jump of a joint's derivative: the largest, relative to its scale.

    Attributes:
        value: In rad/s^order or m/s^order.
        joint: Counted from 0.
        time: s.
        order: 0 for position, 1 for velocity, 2 for acceleration.
    """

    value: float
    joint: int
    time: float
    order: int


@dataclass(frozen=True)
class Smoothness:
    """Integrals over a motion.

    Attributes:
        jerk_integral: `Σ ∫ jerk² dt` over the joints, rad²/s⁵ (m²/s⁵); `Σ ∫ (jerk / A)² dt`, 1/s,
            where joints have both units. Infinite where a velocity or an acceleration jumps.
        acceleration_integral: The same of acceleration: rad²/s³ (m²/s³), or s. Infinite where a
            velocity jumps.
        jerk_rms_sum: `Σ √(∫ jerk² dt / duration)`, rad/s³ (m/s³), or 1/s, as in some papers.
        jump: The largest jump of the lowest derivative that jumps; None if none does.
    """

    jerk_integral: float
    acceleration_integral: float
    jerk_rms_sum: float
    jump: Jump | None = None

    def dilated(self, factor: float) -> Smoothness:
        """Return the integrals of the motion that is slowed down by this factor."""
        jump = self.jump
        if jump is not None:
            value = jump.value / factor**jump.order
            jump = replace(jump, value=value, time=jump.time * factor)
        return Smoothness(
            jerk_integral=self.jerk_integral / factor**5,
            acceleration_integral=self.acceleration_integral / factor**3,
            jerk_rms_sum=self.jerk_rms_sum / factor**3,
            jump=jump,
        )

    def as_dict(self) -> dict[str, Any]:
        """Return the integrals for JSON; an infinite one is null, and `jump` gives the reason."""
        table: dict[str, Any] = {}
        for name in ("jerk_integral", "acceleration_integral", "jerk_rms_sum"):
            value = getattr(self, name)
            table[name] = value if np.isfinite(value) else None
        table["jump"] = None
        if self.jump is not None:
            table["jump"] = {
                "of": JUMPING[self.jump.order],
                "value": self.jump.value,
                "joint": self.jump.joint + 1,
                "time": self.jump.time,
            }
        return table


@dataclass(frozen=True, eq=False)
class FrontPoint:
    """The smoothest motion of a duration.

    Attributes:
        duration: s.
        value: The integral of the best motion found, in the units of `Smoothness`.
        lower: Proved lower bound on the integral of any motion of this duration; None without one.
        trajectory: The best motion found; it keeps every limit.
    """

    duration: float
    value: float
    lower: float | None
    trajectory: Trajectory


def weights(problem: Problem) -> Array:
    """Return the factor on each joint's squares, `(joints,)`.

    It is 1 where all joints have one unit. Otherwise it is `1/A²`, where `A` is the smaller side of
    the joint's acceleration limit.
    """
    if len({problem.unit(joint) for joint in range(problem.joints)}) == 1:
        return np.ones(problem.joints)
    return np.abs(problem.limits.in_all_segments().acceleration).min(axis=1) ** -2.0


def unit(problem: Problem, order: int) -> str:
    """Return the unit of the integral of the squared derivative of this order (3: jerk)."""
    if len({problem.unit(joint) for joint in range(problem.joints)}) > 1:
        return {2: "s", 3: "1/s"}[order]
    return f"{problem.unit(0)}²/s{ {2: '³', 3: '⁵'}[order] }"


def smoothness(problem: Problem, trajectory: Trajectory) -> Smoothness:
    """Return the integrals of a motion of a problem's joints.

    Args:
        problem: Its units and limits; its waypoints give the scale of jumps of position.
        trajectory: The motion, `(joints,)` as the problem's.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        jumps = [_jump(problem, trajectory, order) for order in range(3)]
        factors = weights(problem)
        accelerations = factors * squared_integral(trajectory, 2)
        jerks = factors * squared_integral(trajectory, 3)
    if jumps[0] or jumps[1]:
        accelerations = np.full_like(accelerations, np.inf)
    if any(jumps):
        jerks = np.full_like(jerks, np.inf)
    return Smoothness(
        jerk_integral=float(jerks.sum()),
        acceleration_integral=float(accelerations.sum()),
        jerk_rms_sum=float(np.sqrt(jerks / trajectory.duration).sum()),
        jump=next(filter(None, jumps), None),
    )


def of_certified(
    problem: Problem, trajectory: Trajectory, certificate: Certificate
) -> Smoothness | None:
    """Return the integrals of the certified motion; None where the given one has a flaw."""
    if not certificate.valid:
        return None
    if certificate.dilation > 1 and not problem.route.dilatable:
        slower = certificate.motion or certified(problem, trajectory)
        return None if slower is None else smoothness(problem, slower)
    return smoothness(problem, trajectory).dilated(max(1.0, certificate.dilation))


def squared_integral(trajectory: Trajectory, order: int) -> Array:
    """Return ∫ derivative² dt, `(joints,)`, by Gauss's rule, which is exact for polynomials."""
    unit_pieces = trajectory.pieces(order)
    nodes, shares = _gauss(len(unit_pieces))
    values = polynomials.evaluate(unit_pieces[:, None], (0.5 * (1 + nodes))[:, None, None])
    means = np.tensordot(0.5 * shares, values**2, axes=1)
    total = trajectory.lengths @ means
    return np.where(np.isnan(total), np.inf, total)


@cache
def _gauss(count: int) -> tuple[Array, Array]:
    """Return the nodes and weights of Gauss's rule on [-1, 1]."""
    return np.polynomial.legendre.leggauss(count)


def _jump(problem: Problem, trajectory: Trajectory, order: int) -> Jump | None:
    """Return the largest jump of a derivative; None if all jumps together are rounding."""
    pieces = trajectory.pieces(order)
    starts, stops = pieces[-1], pieces.sum(axis=0)
    route = problem.route
    scale = problem.largest_displacements
    if order == 0:
        still = np.stack([starts[0], stops[-1]])
    else:
        still = np.stack([route.start[order - 1], route.end[order - 1]])
        if "closed" in route.demands:  # a closed motion is continued by itself
            still = np.stack([stops[-1], starts[0]])
        known = problem.limits.in_all_segments()
        limit = np.abs((known.velocity, known.acceleration)[order - 1]).min(axis=1)
        scale = limit * (np.abs(polynomials.bernstein(pieces)).max(axis=(0, 1)) / limit).max()
    jumps = np.abs(np.vstack([starts, still[1:]]) - np.vstack([still[:1], stops]))
    relative = np.nan_to_num(jumps / np.where(scale > 0, scale, 1.0), nan=np.inf)
    if relative.sum(axis=0).max() <= JUMP_RTOL:
        return None
    place, joint = np.unravel_index(relative.argmax(), relative.shape)
    time = float(trajectory.breaks[place])
    return Jump(float(jumps[place, joint]), int(joint), time, order)
