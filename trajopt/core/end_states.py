"""Prove in closed form that no motion can begin or end in a given state.

Each joint is tested alone. At the start its velocity `v` and acceleration `a` must be within their
limits `V` and `A`. Under a jerk limit `J` an acceleration does not end at once, so `v + a²/(2 J)`
must be within `V` too, where `J` is the limit on the side that ends the acceleration. A joint that
moves towards a position limit must be able to stop before it. At the motion's end the same holds
backwards in time.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trajopt.core.braking import OneSide, covered
from trajopt.core.problem import Problem
from trajopt.core.rounding import KEPT_RTOL, of_states

_BRAKES = ": it brakes to it in"
_BRAKE_FIRST = "; `trajopt plan --brake-first` does that, and plans from there"


@dataclass(frozen=True)
class _Joint(OneSide):
    """One joint's state at an end, mirrored so that it moves upwards, SI units.

    Its upper limits are those of the first segment, the others the widest of all segments.

    Attributes:
        widest: The widest upper velocity limit of all segments.
        room: Distance to the upper position limit.
    """

    widest: float
    room: float

    @property
    def way(self) -> float:
        """Return the least distance in which the joint stops; 0 where it does not move upwards."""
        v, a, J = self.velocity, max(self.acceleration, -self.braking), self.easing
        if np.isinf(J):
            return max(v, 0.0) ** 2 / (2 * self.braking)
        if a**2 + 2 * J * v < 0:
            return 0.0  # its velocity stays below 0
        stops = (a + np.sqrt(a**2 + 2 * J * v)) / J
        ramp = (a + self.braking) / J
        t = min(stops, ramp)
        way = v * t + a * t**2 / 2 - J * t**3 / 6
        left = v + a * t - J * t**2 / 2
        return max(0.0, way + max(left, 0.0) ** 2 / (2 * self.braking))


def impossible(problem: Problem) -> str | None:
    """Return a sentence if no motion can begin or end in the demanded states; else None.

    The sentence states a proof: the end, the joint, and the limit that is exceeded. None does not
    mean that a motion exists.
    """
    if problem.route.at_rest:
        return None
    for is_end in (False, True):
        reasons = [
            _reason(problem, number, is_end=is_end, upwards=upwards)
            for number in range(problem.joints)
            for upwards in (True, False)
        ]
        said = "; ".join(filter(None, reasons))
        if said:
            return said + _BRAKE_FIRST * (_BRAKES in said)
    return None


def _reason(problem: Problem, number: int, *, is_end: bool, upwards: bool) -> str | None:
    state = problem.route.end if is_end else problem.route.start
    velocity, acceleration = (float(rate[number]) for rate in state)
    # backwards in time velocity changes its sign, acceleration does not
    sign = 1.0 if upwards else -1.0
    time = -1.0 if is_end else 1.0
    own = _joint(problem, number, sign, time, is_end=is_end)
    word = "end" if is_end else "start"
    said = f"the {word} velocity of {problem.joint_labels[number]}, {velocity:.6g}"
    unit, per_s, per_s2 = (problem.unit(number, order) for order in range(3))
    verb = "ends" if is_end else "starts"
    if own.velocity > own.fastest * (1 + KEPT_RTOL):
        beyond = f"{said} {per_s}, is beyond its limit, {sign * time * own.fastest:.6g} {per_s}"
        return beyond if is_end else f"{beyond}{_braked(own, unit)}"
    if own.acceleration > own.steepest * (1 + KEPT_RTOL):
        beyond = (
            f"the {word} acceleration of {problem.joint_labels[number]}, {acceleration:.6g} "
            f"{per_s2}, is beyond its limit, {sign * own.steepest:.6g} {per_s2}"
        )
        return beyond if is_end else f"{beyond}{_braked(own, unit)}"
    if own.peak > own.widest * (1 + KEPT_RTOL):
        beyond = (
            f"{problem.joint_labels[number]} {verb} at {velocity:.6g} {per_s} and "
            f"{acceleration:.6g} {per_s2}, which leads beyond its velocity limit: under its jerk "
            f"limit to {sign * time * own.peak:.6g} {per_s} at least"
        )
        return beyond if is_end else f"{beyond}{_braked(own, unit)}"
    rounding = float(of_states(problem).position[number])
    if own.way > own.room * (1 + KEPT_RTOL) + rounding:
        side = "to stop" if not is_end else "to reach"
        return (
            f"{said} {per_s}, takes {own.way:.6g} {unit} {side}, and its position limit is "
            f"{own.room:.6g} {unit} away"
        )
    return None


def _braked(own: _Joint, unit: str) -> str:
    """Say in what time and way a joint brakes into its limits."""
    t, way = covered(own.velocity, own.brakes)
    return f"{_BRAKES} {t:.6g} s and {abs(way):.6g} {unit} at least"


def _joint(problem: Problem, number: int, sign: float, time: float, *, is_end: bool) -> _Joint:
    """Return a joint at an end, mirrored: time runs away from the end, `sign` is upwards."""
    state = problem.route.end if is_end else problem.route.start
    place = -1 if is_end else 0
    whole = problem.limits
    there = (
        whole if whole.segments is None else whole.of_segments(np.arange(whole.segments)[[place]])
    )
    there = there.in_all_segments()
    anywhere = whole.in_all_segments(tightest=False)

    def side(pairs: np.ndarray, towards: float) -> float:
        low, high = pairs[number]
        return float(high if towards > 0 else -low)

    position = float(problem.waypoints[place, number])
    low, high = whole.position[number]
    # jerk changes its sign with time, as velocity does
    return _Joint(
        velocity=sign * time * float(state.velocity[number]),
        acceleration=sign * float(state.acceleration[number]),
        fastest=side(there.velocity, sign * time),
        steepest=side(there.acceleration, sign),
        braking=side(anywhere.acceleration, -sign),
        easing=side(anywhere.jerk, -sign * time),
        rising=side(anywhere.jerk, sign * time),
        widest=side(anywhere.velocity, sign * time),
        room=float(high - position if sign > 0 else position - low),
    )
