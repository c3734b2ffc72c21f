"""The least slower motion that keeps the states in which a route begins and ends.

A dilation changes the velocities at the ends. So a motion that breaks a limit, and is not to begin
and end at rest, is slowed down otherwise: its breaks are stretched by `k`, each segment is cut
into more pieces, and for every joint a linear program (`judging.joint_program`) looks for a motion
on these breaks that passes the waypoints, has the end states, and keeps every limit. The answer is
a motion for the least such `k` that is found (docs/mathematics.md, section 7).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.problem import Problem
from trajopt.core.resolution import spared
from trajopt.core.trajectory import Trajectory, nearest
from trajopt.judging.joint_program import JointProgram

PARTS = 16  # even pieces into which each segment is cut, beside its own breaks
CLOSE_RTOL = 1e-9  # relative to the duration: no cut is so near a break
MAX_DILATION = 2.0
LEAST_EXCESS = 1e-9  # of the first dilation that is tried
GROWTH = 8.0  # of the excess, until there is a motion
HALVINGS = 9  # of the excess that is found, on a scale of logarithms
# What the linear programs keep from each limit, relative; the second where the first one's motion
# breaks a limit by its rounding.
DISTANCES = (2e-9, 1e-6)


class Slower(NamedTuple):
    """A motion that keeps everything, and how many times as long it takes."""

    dilation: float
    motion: Trajectory


def slower(
    problem: Problem, trajectory: Trajectory, kept: Callable[[Trajectory], Trajectory | None]
) -> Slower | None:
    """Return the least slower motion that is found; None where none takes up to twice the time.

    Args:
        problem: Of as many joints and waypoints as the trajectory has.
        trajectory: A motion that breaks a limit.
        kept: Returns the motion repaired if it keeps the whole problem, else None.
    """
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
        trajectory: With the breaks of the answer, as given.
        passing: The break of each waypoint that is to be met.
        positions: Those waypoints, rad.
        distance: What the programs keep from each limit.
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
        """The motion of the least dilation that is found."""

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
        """The dilation that the joints from rest to rest need: theirs is mended by it."""
        needed = 1.0
        for joint in np.flatnonzero(~self._moves).tolist():
            own = replace(self.trajectory, coefficients=self.trajectory.coefficients[..., [joint]])
            limits = self.problem.limits.only([joint])
            for key, limit in limits.kinds.items():
                if limit.is_ratio:
                    needed = max(needed, limit.dilation(limits.worst(key, own)))
        return needed

    def _dilated(self, dilation: float) -> Trajectory | None:
        """A motion on the breaks, so many times as long, if the programs have an answer."""
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
        """One joint's coefficients, `(order + 1, pieces)`."""
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
