"""One segment between two states in motion, in one piece: the least time that its states allow.

A joint changes its velocity from `u` to `w` in `|w − u| / A` or more. A joint with a jerk limit
changes its acceleration from `a₀` to `a₁` in `|a₁ − a₀| / J` or more. The largest of these times
over all joints is a lower bound. A joint that needs all of it has one constant acceleration (or
jerk), so its motion is known. A short part of an optimal motion, the last millisecond before a
controller's goal say, is of that kind in every joint.

The states of such a part are rounded where they were computed, and no motion may have exactly these
numbers in less than a thousand times as long. So states may be missed by their rounding
(`trajopt.core.rounding`): the judge certifies such a motion as it is.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.rounding import Rounding, of_states
from trajopt.core.trajectory import Trajectory
from trajopt.judging.certificate import Certificate
from trajopt.judging.verification import verify

# Times that differ by less, relative, are one: the first whose motion needs no rounding is taken.
SAME_RTOL = 1e-9
# Rounding of the states of a microsecond makes its time longer by no more than this, relative.
LATER_RTOL = 1e-7
_NEWTON_STEPS = 8  # quadratic, so 8 end at rounding
# A state that is missed by more roundings than this is no rounded one. Larger: `nearly` holds where
# the states are simply far apart. Smaller: a rounded state far from its motion is not told.
NEAR = 1e6
# Times the bound: an answer that takes longer is told to be long by rounding. Only the message
# depends on it.
LONG = 2.0


def motion(problem: Problem) -> Trajectory | None:
    """Return the fastest motion of a single piece that joins the end states.

    Args:
        problem: With the limits that count.

    Returns:
        A motion that the judge certifies as it is; None where there is none of one piece.
    """
    if problem.segments > 1 or problem.route.at_rest or problem.route.demand("closed"):
        return None
    known = of_states(problem)
    least = _least(problem)[0]
    found: list[tuple[Trajectory, Certificate]] = []
    for time in _times(problem, least):
        if found and time > found[0][0].duration * (1 + SAME_RTOL):
            break
        own = _of_time(problem, time)
        if (_missed(problem, own, known) > 1).any():
            continue
        certificate = verify(problem, own)
        if certificate.valid and certificate.dilation <= 1:
            found.append((own, certificate))
    strict = [own for own, certificate in found if certificate.rounded is None]
    return next(iter([*strict, *(own for own, _ in found)]), None)


def nearly(problem: Problem) -> bool:
    """Return whether rounded states alone may keep a motion of one segment from the least time.

    Then the joint that needs all of that time, and has no other motion, nearly meets its state.
    """
    least, joint = _least(problem)
    if not least > 0:
        return False
    missed = _missed(problem, _of_time(problem, least), of_states(problem))
    return bool((missed[:, joint] < NEAR).all())


def rounded_away(problem: Problem, duration: float) -> str:
    """Return a sentence if a state's last digits make a motion long; empty if they do not.

    Args:
        problem: As in `motion`, which has no answer.
        duration: Of the answer, s.
    """
    if problem.segments > 1 or problem.route.at_rest or problem.route.demand("closed"):
        return ""
    least, joint = _least(problem)
    if not 0 < LONG * least < duration:
        return ""
    own = _of_time(problem, least)
    # the joint that needs all of this time has no other motion
    missed = _missed(problem, own, of_states(problem))[:, joint]
    order = int(missed.argmax())
    if not 1 < missed[order] < NEAR:
        return ""
    wanted = (problem.waypoints[1], *problem.route.end)[order][joint]
    away = abs(float(own(least, order)[joint] - wanted))
    label, unit = problem.joint_labels[joint], problem.unit(joint, order)
    return (
        f"{label} can reach the end state in {least:.6g} s only within {away:.1g} {unit} of it; "
        f"exactly, it takes {duration:.6g} s"
    )


def _least(problem: Problem) -> tuple[float, int]:
    """Return the least time that the end states allow, s, and the joint that needs it."""
    (u, a0), (w, a1) = problem.route.start, problem.route.end
    limits = problem.limits
    jerky = limits.jerk_limited
    gain = np.where(jerky, a1 - a0, w - u)
    size = (len(gain), 2)
    sides = np.where(jerky[:, None], limits.jerk.reshape(size), limits.acceleration.reshape(size))
    needed = gain / np.where(gain > 0, sides[:, 1], sides[:, 0])
    joint = int(needed.argmax())
    asked = problem.route.demand("least_times")[0] + problem.route.demand("given_times")[0]
    return max(float(needed[joint]), float(asked)), joint


def _times(problem: Problem, least: float) -> Iterator[float]:
    """Yield the least time, then those of each joint's own way that are as short, in order.

    States that are rounded may be possible a little later than at the least time.
    """
    (u, a0), (w, a1) = problem.route.start, problem.route.end
    h = problem.displacements[0]
    jerky = problem.limits.jerk_limited
    with np.errstate(all="ignore"):
        time = h / ((u + w) / 2)
        for _ in range(_NEWTON_STEPS):  # h = u T + (2 a₀ + a₁) T²/6
            miss = time * (u + time * (2 * a0 + a1) / 6) - h
            time = np.where(jerky, time - miss / (u + time * (2 * a0 + a1) / 3), time)
        of_velocity = np.where(jerky, (w - u) / ((a0 + a1) / 2), np.nan)
    own = np.concatenate([[least], time, of_velocity])
    near = own[(own >= least) & (own <= least * (1 + LATER_RTOL))]
    yield from np.unique(near[near > 0]).tolist()


def _of_time(problem: Problem, time: float) -> Trajectory:
    """Return the motion of one constant acceleration or jerk of each joint, within its limits."""
    (u, a0), (w, a1) = problem.route.start, problem.route.end
    limits = problem.limits
    size = (len(u), 2)
    jerky = limits.jerk_limited
    jerk = np.clip((a1 - a0) / time, *limits.jerk.reshape(size).T)
    steady = np.clip((w - u) / time, *limits.acceleration.reshape(size).T)
    rows = [np.where(jerky, jerk, 0.0) / 6, np.where(jerky, a0, steady) / 2, u]
    coefficients = np.array([*rows, problem.waypoints[0]])[:, None]
    if not jerky.any():
        coefficients = coefficients[1:]
    return Trajectory(np.array([0.0, time]), coefficients, np.array([0.0, time]))


def _missed(problem: Problem, own: Trajectory, known: Rounding) -> Array:
    """Return the misses of the end's place and state over their rounding, `(3, joints)`."""
    wanted = (problem.waypoints[1], *problem.route.end)
    missed = np.array(
        [
            np.abs(own(own.duration, order) - state) / rounding
            for order, (state, rounding) in enumerate(zip(wanted, known, strict=True))
        ]
    )
    missed[2] *= problem.limits.jerk_limited
    return missed
