"""Slow a motion down as little as possible without changing the states at its ends.

A dilation changes the velocities at the ends. So where a route begins or ends in motion, a motion
that breaks a limit is slowed down in another way. Its times are multiplied by `k`, and each segment
is cut into more pieces. For every joint a linear program (`judging.joint_program`) then looks for a
motion on these breaks that passes the waypoints, has the end states, and keeps every limit. The
answer is the motion of the least such `k` that is found (docs/mathematics.md, section 9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.end_states import impossible
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.trajectory import Trajectory, nearest
from trajopt.judging.joint_program import JointProgram

PARTS = 16  # equal parts into which each segment is cut, beside its own breaks
CLOSE_RTOL = 1e-9  # least distance of a cut from a break, relative to the duration
MAX_DILATION = 2.0
LEAST_EXCESS = 1e-9  # `k - 1` of the first attempt
GROWTH = 8.0  # factor on `k - 1` until there is a motion
HALVINGS = 9  # bisections of `log(k - 1)` after that
# Distance from each limit in the linear programs, relative. The second is used if the motion of the
# first breaks a limit by its rounding.
DISTANCES = (2e-9, 1e-6)


class Slower(NamedTuple):
    """A motion that keeps the whole problem, and its duration relative to the given motion's."""

    dilation: float
    motion: Trajectory


def slower(
    problem: Problem, trajectory: Trajectory, kept: Callable[[Trajectory], Trajectory | None]
) -> Slower | None:
    """Return the fastest slower motion that is found; None if it would take over twice the time.

    Args:
        problem: Of as many joints and waypoints as the trajectory has.
        trajectory: A motion that breaks a limit.
        kept: Returns the repaired motion if it keeps the whole problem, else None.
    """
    if impossible(problem) is not None:  # no motion keeps the limits with these states at its ends
        return None
    for distance in DISTANCES:
        search = _Search.of(problem, trajectory, distance)
        found = search.least(kept) if search else None
        if found:
            return found
    return None


@dataclass(frozen=True, eq=False)
class _Search:
    """The search for the least dilation.

    Attributes:
        problem: The whole problem.
        trajectory: The given motion, with the breaks of the answer.
        passing: Index of the break of each waypoint to meet.
        positions: These waypoints, rad.
        distance: Distance from each limit in the programs, relative.
    """

    problem: Problem
    trajectory: Trajectory
    passing: Indices
    positions: Array
    distance: float

    @classmethod
    def of(cls, problem: Problem, trajectory: Trajectory, distance: float) -> _Search | None:
        merged, index = problem.merged()
        _, first = np.unique(index, return_index=True)
        first = first[~spared(merged)]
        times = trajectory.waypoint_times[first]
        own = trajectory.refined(times)
        shares = np.arange(1, PARTS) / PARTS
        cuts = (times[:-1, None] + np.diff(times)[:, None] * shares).ravel()
        apart = np.abs(cuts - own.breaks[nearest(own.breaks, cuts)])
        own = own.refined(cuts[apart > CLOSE_RTOL * own.duration])
        passing = nearest(own.breaks, times)
        passing[[0, -1]] = 0, len(own.breaks) - 1
        if not np.all(np.diff(passing) > 0):
            return None
        return cls(problem, own, passing, problem.waypoints[first], distance)

    def least(self, kept: Callable[[Trajectory], Trajectory | None]) -> Slower | None:
        """Return the motion of the least dilation that is found."""

        def tried(excess: float) -> Slower | None:
            dilated = self._dilated(1 + excess)
            motion = kept(dilated) if dilated else None
            if motion is None:
                return None
            return Slower(motion.duration / self.trajectory.duration, motion)

        low = 0.0
        high = max(LEAST_EXCESS, self._resting_dilation - 1)
        found = tried(high)
        while found is None and high < MAX_DILATION - 1:
            low = high
            high = min(high * GROWTH, MAX_DILATION - 1)
            found = tried(high)
        if found is None or low == 0.0:
            return found
        for _ in range(HALVINGS):
            middle = np.sqrt(low * high)
            shorter = tried(middle)
            if shorter is None:
                low = middle
            else:
                high, found = middle, shorter
        return found

    @cached_property
    def _moves(self) -> Bools:
        """Which joints begin or end in motion, `(joints,)`."""
        return np.any([*self.problem.route.start, *self.problem.route.end], axis=0)

    @cached_property
    def _resting_dilation(self) -> float:
        """The dilation that joints which begin and end at rest need; it suffices for them."""
        needed = 1.0
        for joint in np.flatnonzero(~self._moves).tolist():
            own = replace(self.trajectory, coefficients=self.trajectory.coefficients[..., [joint]])
            limits = self.problem.limits.only([joint])
            for key, limit in limits.kinds.items():
                if limit.is_ratio:
                    needed = max(needed, limit.dilation(limits.worst(key, own), own))
        return needed

    def _dilated(self, dilation: float) -> Trajectory | None:
        """Return a motion that is slower by a factor; None if a joint's program has no solution."""
        slower = self.trajectory.dilated(dilation)
        lengths = slower.lengths
        times = np.append(0.0, np.cumsum(lengths))
        coefficients = slower.coefficients
        for joint in np.flatnonzero(self._moves).tolist():
            own = self._of_joint(joint, slower, times)
            if own is None:
                return None
            coefficients = np.array(coefficients)
            coefficients[..., joint] = 0.0
            padded = np.zeros((len(own), *coefficients.shape[1:]))
            padded[..., joint] = own
            coefficients = polynomials.plus(coefficients, padded)
        return replace(slower, coefficients=coefficients)

    def _of_joint(self, joint: int, slower: Trajectory, times: Array) -> Array | None:
        """Return the coefficients of one joint's motion, `(order + 1, pieces)`, or None."""
        limits = self.problem.limits.only([joint])
        order = 3 if limits.smooth[0] >= 2 else 2
        program = JointProgram(
            times=times,
            order=order,
            passing=self.passing,
            positions=self.positions[:, joint],
            limits=limits,
            planned=slower(times, order - 1)[:, joint],
            ends=self.problem.route.ends(joint, order - 1),
            distance=self.distance,
            course=slower(times)[:, joint],
        )
        states = program.solved()
        if states is None:
            return None
        rates = np.diff(states[-1]) / np.diff(times)
        factorials = [1.0, 1.0, 2.0, 6.0]
        rows = [rates, *states[::-1, :-1]]
        return np.array([row / factorials[order - i] for i, row in enumerate(rows)])
