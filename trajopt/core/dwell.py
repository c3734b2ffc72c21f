"""Split problems and motions at the waypoints where the motion waits, and join them again.

A wait begins at the time at which the motion passes its waypoint. A wait at the last waypoint lasts
until the motion ends.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory, nearest


class Part(NamedTuple):
    """A part of a motion, the time at which it begins, s, and its first waypoint's index."""

    motion: Trajectory
    begins: float
    first: int


def ends(problem: Problem) -> list[int]:
    """Return the waypoints at which a part begins or ends, in order."""
    waits = np.flatnonzero(problem.route.demand("dwell")).tolist()
    return sorted({0, len(problem.waypoints) - 1, *waits})


def parts(problem: Problem) -> list[Problem]:
    """Return the problems between the waits, in order."""
    found = []
    for first, last in pairwise(ends(problem)):
        route = problem.route.part(first, last)
        limits = problem.limits.of_segments(np.arange(first, last))
        waypoints = route.waypoints
        found.append(replace(problem, waypoints=waypoints, demands=route.demands, limits=limits))
    return found


def joined(problem: Problem, motions: Sequence[Trajectory]) -> Trajectory:
    """Return the motion of the whole problem, made of the motions of its parts and the waits."""
    waits = problem.route.demand("dwell")
    rows = max(len(motion.coefficients) for motion in motions)
    lengths = []
    coefficients = []
    times = np.zeros(len(waits))
    elapsed = 0.0
    for (first, last), motion in zip(pairwise(ends(problem)), motions, strict=True):
        own = np.zeros((rows, *motion.coefficients.shape[1:]))
        own[rows - len(motion.coefficients) :] = motion.coefficients
        still = np.zeros((2, rows, 1, problem.joints))
        still[:, -1, 0] = problem.waypoints[[first, last]]
        # a wait between two parts is added with the part before it
        before = waits[[first]] if first == 0 else np.zeros(1)
        lengths += [before, motion.lengths, waits[[last]]]
        coefficients += [still[0], own, still[1]]
        times[first + 1 : last + 1] = elapsed + before + motion.waypoint_times[1:]
        elapsed += float(before[0]) + motion.duration + float(waits[last])
    all_lengths = np.concatenate(lengths)
    passed = np.cumsum(all_lengths)
    used = np.diff(passed, prepend=0.0) > 0
    breaks = np.append(0.0, passed[used])
    times[-1] = breaks[-1]
    together = np.concatenate(coefficients, axis=1)[:, used]
    return Trajectory(breaks, together, np.minimum(times, breaks[-1]), all_lengths[used])


def cut(problem: Problem, motion: Trajectory) -> list[Part] | None:
    """Return the parts of a motion between the waits; None where a part takes no time."""
    waits = problem.route.demand("dwell")
    times = motion.waypoint_times
    found = []
    for first, last in pairwise(ends(problem)):
        begins = times[first] + waits[first]
        stops = times[last] - (waits[last] if last == len(waits) - 1 else 0.0)
        own = between(motion, begins, stops)
        if own is None:
            return None
        passed = np.clip(times[first : last + 1] - begins, 0.0, own.duration)
        passed[[0, -1]] = 0.0, own.duration
        found.append(Part(replace(own, waypoint_times=passed), float(begins), first))
    return found


def rests(problem: Problem, motion: Trajectory) -> list[Part]:
    """Return the part of the motion during each wait; it should rest there."""
    waits = problem.route.demand("dwell")
    begins = np.array(motion.waypoint_times)
    begins[-1] -= waits[-1]
    found = []
    for waypoint in np.flatnonzero(waits).tolist():
        own = between(motion, begins[waypoint], begins[waypoint] + waits[waypoint])
        if own is not None:
            found.append(Part(own, float(begins[waypoint]), waypoint))
    return found


def between(motion: Trajectory, begins: float, stops: float) -> Trajectory | None:
    """Return the part of a motion between two times, s; None where that takes no time."""
    refined = motion.refined([begins, stops])
    first, last = nearest(refined.breaks, np.array([begins, stops]))
    if last <= first:
        return None
    lengths = refined.lengths[first:last]
    breaks = np.append(0.0, np.cumsum(lengths))
    return Trajectory(breaks, refined.coefficients[:, first:last], breaks[[0, -1]], lengths)
