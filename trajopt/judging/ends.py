"""How a motion begins and ends: the states that it has there, and how long it stands.

Where no problem was stated, these are facts and no faults: limits alone judge. A recorded motion
often stands before and after, which is part of its duration but not of its motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import factorial

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.limits import Limits
from trajopt.core.trajectory import Trajectory

_BETWEEN = 4  # times at which a piece is compared with the motion's end


def states(motion: Trajectory, limits: Limits) -> dict[str, Array]:
    """Return the states at both ends as demands (`trajopt.core.demand.END_STATES`).

    They are moved into the limits. Accelerations are states where the jerk is limited.
    """
    bounds = {"velocity": limits.velocity}
    if np.isfinite(limits.jerk).any():
        bounds["acceleration"] = limits.acceleration
    return {
        f"{end}_{rate}": np.clip(motion(time, order), *pairs.T)
        for end, time in (("start", 0.0), ("end", motion.duration))
        for order, (rate, pairs) in enumerate(bounds.items(), start=1)
    }


@dataclass(frozen=True)
class Standing:
    """How long a motion stands still at its start and at its end.

    Attributes:
        start, end: s. They may creep within the half widths of their positions.
        doubt: A motion at its largest jerk (or acceleration) leaves the half widths in this time,
            s.
        duration: Of the whole motion, s.
    """

    start: float
    end: float
    doubt: float
    duration: float

    @property
    def moving(self) -> float:
        """Return the duration without both, s; that of the whole if the motion only stands."""
        return self.duration - self.start - self.end or self.duration

    def __bool__(self) -> bool:
        """Return whether it stands longer than the doubt."""
        return max(self.start, self.end) > self.doubt


def standing(times: Array, positions: Array, half: Array, limits: Limits) -> Standing:
    """Return how long all joints stay within one band, as wide as positions are known.

    Args:
        times: Increasing, s, `(samples,)`.
        positions: `(samples, joints)`.
        half: Half width of each joint's positions, `(joints,)`; 0 where they are exact.
        limits: Of the joints.
    """
    spans = []
    for own in (positions, positions[::-1]):
        width = np.maximum.accumulate(own) - np.minimum.accumulate(own)
        still = np.all(width <= 2 * half, axis=1)
        spans.append(len(still) if still.all() else int(np.argmin(still)))
    whole = float(times[-1] - times[0])
    if len(times) in spans:
        return Standing(whole, 0.0, 0.0, whole)
    limits = limits.in_all_segments()
    order = 3 if np.isfinite(limits.jerk).all() else 2
    sizes = np.abs(limits.jerk if order == 3 else limits.acceleration).min(axis=1)
    hidden = (2 * half * factorial(order) / sizes) ** (1 / order)
    doubt = float(hidden.max())
    first, last = spans
    return Standing(
        float(times[first - 1] - times[0]), float(times[-1] - times[-last]), doubt, whole
    )


def standing_of(motion: Trajectory, limits: Limits) -> Standing:
    """Return how long a motion stands, exactly: pieces that stay where the motion begins or ends.

    Rounding counts as standing, `1e-12` of what a joint moves.
    """
    inner = np.linspace(0, 1, _BETWEEN, endpoint=False)
    breaks = motion.breaks
    times = np.append((breaks[:-1, None] + inner * np.diff(breaks)[:, None]).ravel(), breaks[-1])
    positions = motion(times)
    return standing(times, positions, 1e-12 * np.ptp(positions, axis=0), limits)
