"""The waypoints and joints that decide the minimum time of a problem within tolerance.

A motion through a few of many targets passes most of the others anyway, and most joints have time
to spare. A problem of some waypoints and of some joints is a relaxation, and its bound is proved
the sooner the fewer segments it has: of 50 targets of 7 joints some six, of two to four joints,
take as long as all to some 0.3 %.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from baselines.lower_bound.apart import relaxed
from baselines.lower_bound.incumbent import Incumbent, kept
from trajopt.core.arrays import Bools, Indices
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners import registry
from trajopt.planners.few_targets import passing, turning

# A local optimum to so much is enough: a loss of time is told to some 1e-4.
_PLANNER = "exact:within=1e-4"
_JERK_PLANNER = "exact-jerk:starts=1"
LEAST_LOSS = 2e-4


class DecisivePart(NamedTuple):
    """A problem of some waypoints and joints, by their numbers from 0, and its fastest motion.

    Without the others that motion is shorter, by a share `loss` of the whole time at most.
    """

    problem: Problem
    waypoints: Indices
    joints: Indices
    known: Incumbent
    loss: float

    @property
    def size(self) -> int:
        return len(self.waypoints) + len(self.joints)


def parts(
    problem: Problem, duration: float, losses: Sequence[float], late: Callable[[], bool]
) -> list[DecisivePart]:
    """Return a part of a problem for each loss, those of larger losses within the others.

    Args:
        problem: Without identical consecutive waypoints; all joints move. Under jerk limits, from
            rest to rest; they count in the parts, and not in what these may lose.
        duration: Of its fastest motion, s.
        losses: Shares of the duration that may be lost, rising, at least `LEAST_LOSS`.
        late: Returns whether the time is over; fewer parts are the answer then.
    """
    search = _Thinning(problem, late)
    if search.grow(duration * (1 - losses[0] / 2)) and search.motion is not None:
        # a motion through all waypoints that is faster than the one known
        duration = min(duration, search.motion.duration)
    found: list[DecisivePart] = []
    for loss in losses:
        search.thin(duration * (1 - loss))
        part = search.part(loss)
        if part is None or late():
            break
        if not found or part.size < found[-1].size:
            found.append(part)
    return found


class _Thinning:
    """Some waypoints and joints of a problem, and the motion through them."""

    def __init__(self, problem: Problem, late: Callable[[], bool]) -> None:
        self.problem = problem
        self.late = late
        self.planner = registry.load(_PLANNER)
        self.stays = problem.route.demand("dwell") > 0
        self.stays[[0, -1]] = True
        self.kept = self.stays | turning(problem)
        self.joints = list(range(problem.joints))
        self.motion: Trajectory | None = None

    def grow(self, least: float) -> bool:
        """Add the waypoints that a motion through the others misses, until it takes as long.

        Returns:
            Whether it passes all of them before.
        """
        while not self.late():
            self.motion = self._motion(self.kept, self.joints)
            if self.motion is None or self.motion.duration >= least:
                return False
            missed = passing(self.problem, self.kept, self.motion).missed
            if not missed:
                return True
            self.kept[missed] = True
        return False

    def thin(self, least: float) -> None:
        """Leave out each joint and waypoint without which the others take as long.

        Waypoints beside short segments are tried first: these are the hardest to bound.
        """
        self._leave_joints(least)
        if self.motion is None:
            return
        briefest = np.full(len(self.kept), np.inf)
        times = np.diff(self.motion.waypoint_times)
        briefest[np.flatnonzero(self.kept)[1:-1]] = np.minimum(times[:-1], times[1:])
        for waypoint in briefest.argsort()[: np.isfinite(briefest).sum()].tolist():
            if self.stays[waypoint]:
                continue
            fewer = self.kept.copy()
            fewer[waypoint] = False
            self._take(fewer, self.joints, least)
        self._leave_joints(least)

    def _leave_joints(self, least: float) -> None:
        moves = np.abs(self.problem.displacements).sum(axis=0)
        for joint in sorted(self.joints, key=moves.__getitem__):
            self._take(self.kept, [own for own in self.joints if own != joint], least)

    def _take(self, waypoints: Bools, joints: list[int], least: float) -> None:
        """Go on with these if a motion through them takes that long, s."""
        if self.late() or not joints:
            return
        motion = self._motion(waypoints, joints)
        if motion is not None and motion.duration >= least:
            self.kept, self.joints, self.motion = waypoints, joints, motion

    def _motion(self, waypoints: Bools, joints: Sequence[int]) -> Trajectory | None:
        """Return the fastest motion through some waypoints; None where none is needed."""
        try:
            asked = relaxed(self.problem, np.flatnonzero(waypoints)).only(joints)
        except InvalidInput:
            return None
        known = asked.without(*self.planner.unknown(asked))
        return self.planner.solve(known).trajectory

    def part(self, loss: float) -> DecisivePart | None:
        if self.motion is None:
            return None
        waypoints, joints = np.flatnonzero(self.kept), np.array(self.joints)
        own = relaxed(self.problem, waypoints).only(joints)
        motion: Trajectory | None = self.motion
        if own.has("jerk"):
            motion = registry.load(_JERK_PLANNER).solve(own).trajectory
        if motion is None:
            return None
        known = kept(own, motion)
        return known and DecisivePart(own, waypoints, joints, known, loss)
