"""What the judge says of a motion: its certificate, and the same in words.

    certificate = verify(problem, trajectory)
    print(certificate.verdict, *certificate.lines())

Terminal, pages, figures and files take a verdict's words from here.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from math import floor
from typing import Any

import numpy as np

from trajopt.core.limits import KINDS, LIMIT_NAMES, Use
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory

NEARLY_FEASIBLE_RTOL = 1e-3  # a smaller dilation is due to rounding and tolerances of solvers
_FACTOR_DIGITS = 1e4  # a planner's scaling factors are rounded down to four decimals


@dataclass(frozen=True)
class Tolerance:
    """The largest misses and jumps that are repaired.

    A miss within tolerance is repaired, and the repaired trajectory is certified. A larger miss is
    a flaw.

    Attributes:
        limit: excess over velocity, acceleration and jerk limits that counts as none, relative.
        position: misses of waypoints and jumps of position, relative to the joint's largest
            displacement.
        position_limit: excess over a position limit, relative to the joint's largest displacement.
        jump: jumps of velocity and acceleration at the breaks, relative to the largest values that
            the joint can reach in its largest displacement `h`: `min(V, sqrt(A h))` and
            `min(A, cbrt(J² h))`.
        bridge: s. A jump is also repaired if it is smaller than the change that the next limit
            allows in this time: `V` times it for position, `A` for velocity, `J` for acceleration.
    """

    limit: float = 1e-6
    position: float = 1e-6
    position_limit: float = 1e-8
    jump: float = 1e-6
    bridge: float = 1e-6


@dataclass(frozen=True)
class Worst:
    """The worst miss of a waypoint, or the worst jump.

    Attributes:
        value: in SI units of the derivative of this `order`.
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

    Uses of limits are measured on the repaired trajectory, or on the given one where no repair is
    possible. `waypoint`, `continuity` and the uses of position limits are measured on the given
    one.

    Attributes:
        duration: of the given trajectory, s.
        dilation: the least factor `k` that brings the trajectory within its limits (section 2).
            Below 1, the trajectory could be faster. Infinite where no factor does.
        uses: the worst use of each limit that is judged, by its key.
        flaws: errors that neither repair nor dilation can remove, in words. With a flaw there is no
            certified duration.
        tolerance: the tolerance used.
        least_times: least time over time taken, for the segment, or the whole motion, where this
            is largest, and when that begins; None where the problem has no least times.
        motion: the longer motion that has the certified duration, where a dilation would change
            the states at the ends; None elsewhere, and in a stored certificate.
        judged: the motion that was judged, repaired where it missed within tolerance; None in a
            stored certificate, and where the motion is so long that it was judged joint by joint.
        repair: makes the motion that was judged where it is that long.
    """

    duration: float
    dilation: float
    uses: Mapping[str, Use]
    waypoint: Worst
    continuity: Worst
    flaws: tuple[str, ...]
    tolerance: Tolerance
    least_times: Use | None = None
    rounded: float | None = field(default=None, compare=False)
    motion: Trajectory | None = field(default=None, compare=False)
    judged: Trajectory | None = field(default=None, compare=False)
    repair: Callable[[], Trajectory | None] | None = field(default=None, compare=False)

    @property
    def velocity(self) -> Use:
        return self.uses["velocity"]

    @property
    def acceleration(self) -> Use | None:
        """Return the worst use of the acceleration limits; None where they are not judged."""
        return self.uses.get("acceleration")

    @property
    def jerk(self) -> Use | None:
        """Return the worst use of the jerk limits; None where there are none."""
        return self.uses.get("jerk")

    @property
    def position(self) -> Use | None:
        """Return the worst excess over the position limits, rad; below 0 it is a margin."""
        return self.uses.get("position")

    @property
    def ratios(self) -> dict[str, Use]:
        """Return every use that is a ratio, 1 at the limit, by its key; also of least times."""
        found = {key: use for key, use in self.uses.items() if KINDS[key].is_ratio}
        if self.least_times is not None:
            found["least_times"] = self.least_times
        return found

    @property
    def valid(self) -> bool:
        return not self.flaws

    @property
    def feasible(self) -> bool:
        """Return whether the trajectory keeps every limit without dilation, within tolerance."""
        ratios = [use.value for use in self.ratios.values()]
        return self.valid and max(ratios, default=0.0) <= 1 + self.tolerance.limit

    @property
    def nearly_feasible(self) -> bool:
        """Return whether the dilation is within the tolerances of solvers.

        A planner that ignores a limit usually needs more.
        """
        return self.valid and self.dilation <= 1 + NEARLY_FEASIBLE_RTOL

    @property
    def certified_duration(self) -> float | None:
        """`max(1, dilation) · duration` in seconds, or `None` if there is a flaw."""
        if not self.valid:
            return None
        return max(1.0, self.dilation) * self.duration

    @property
    def certified_motion(self) -> Trajectory | None:
        """The motion of the certified duration; None with a flaw, and in a stored certificate.

        A long motion, of more than 200,000 pieces times joints, is repaired anew at each call.
        """
        if not self.valid:
            return None
        judged = self.repair() if self.repair else self.judged
        if judged is None or self.motion is not None or self.dilation <= 1:
            return judged
        return judged.dilated(self.dilation)

    @property
    def verdict(self) -> str:
        """The verdict in a word or two."""
        return "feasible" if self.feasible else "not feasible"

    @property
    def reason(self) -> str:
        """The verdict, and the first flaw if there is one."""
        return ": ".join([self.verdict, *self.flaws[:1]])

    def __repr__(self) -> str:
        if not self.valid:
            return f"Certificate(invalid: {'; '.join(self.flaws)})"
        return (
            f"Certificate({self.verdict}, {self.duration:.6g} s claimed, dilation "
            f"{self.dilation:.6g}, {self.certified_duration:.6g} s certified)"
        )

    def lines(self) -> Iterator[str]:
        """Yield sentences: what is wrong, and how much slower or faster the motion keeps all."""
        fastest = self.dilation * self.duration
        if self.flaws:
            yield f"Slowing down does not help: {'; '.join(self.flaws)}."
            if 1 < self.dilation < np.inf:
                yield f"Besides, its limits need it {self.dilation:.6f} times as slow."
        elif self.feasible and self.dilation >= 1:
            yield "It keeps every limit."
        elif self.feasible:
            faster = 1 / self.dilation
            yield f"It could run {faster:.6f} times as fast within every limit, in {fastest:.6f} s."
        elif self.motion is not None:
            longer = f"{self.dilation:.6f} times as long, {fastest:.6f} s"
            yield f"A motion {longer}, keeps every limit and the states at the ends."
        else:
            slowed = f"Slowed down {self.dilation:.6f} times, to {fastest:.6f} s"
            yield f"{slowed}, it keeps every limit."
            yield f"To plan it again, multiply the planner's limits: {self._scaled()}."

    def _scaled(self) -> str:
        """Return a planner's scaling factors that have the effect of the dilation."""
        powers = {"velocity": 1, "acceleration": 2, "jerk": 3}
        return ", ".join(
            # rounded down; a factor that rounding put just below a decimal is that decimal
            f"{key} {floor(_FACTOR_DIGITS / self.dilation**order + 1e-5) / _FACTOR_DIGITS:.4f}"
            for key, order in powers.items()
            if key in self.uses
        )

    def peak(self, problem: Problem) -> str:
        """Say where the highest use is: "its peak is 0.98 of the jerk limit of J2"."""
        ratios = {key: use for key, use in self.ratios.items() if key in KINDS}
        key, use = max(ratios.items(), key=lambda item: item[1].value)
        words = f"its peak is {use.value:.5f} of the {KINDS[key].name()} limit"
        return words if use.joint is None else f"{words} of {problem.joint_labels[use.joint]}"

    def as_dict(self) -> dict[str, Any]:
        """Return the certificate for JSON: joints count from 1; a `ratio` or an `error` each.

        A kind of limit is None where the problem does not have it, or it is not judged.
        """
        table: dict[str, Any] = {"feasible": self.feasible, "dilation": self.dilation}
        for key in dict.fromkeys((*LIMIT_NAMES, *self.uses)):
            use = self.uses.get(key)
            word = "ratio" if KINDS[key].is_ratio else "error"
            table[key] = None
            if use is not None:
                joint = None if use.joint is None else use.joint + 1
                table[key] = {word: use.value, "joint": joint, "time": use.time}
        for key, worst in {"waypoint": self.waypoint, "continuity": self.continuity}.items():
            table[key] = {"error": worst.value, "joint": worst.joint + 1, "time": worst.time}
        table["continuity"]["order"] = self.continuity.order
        if self.least_times is not None:
            table["least_times"] = {"ratio": self.least_times.value, "time": self.least_times.time}
        return table
