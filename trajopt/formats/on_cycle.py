"""A motion moved to whole control cycles, so that a controller's interpolation reproduces it.

A controller joins the points that it is sent with cubic pieces (positions and velocities) or
quintic ones (accelerations too). Between two breaks on the cycle, a cubic piece reproduces a motion
of constant acceleration exactly, and a quintic piece one of constant jerk (docs/mathematics.md,
section 11). With samples between breaks it does not: bang-bang motions overshoot then.

Therefore the breaks are moved to the nearest cycle, so that breaks close to each other become one.
The motion between them is found again, joint by joint (`trajopt.judging.joint_program`). If there
is no solution, the motion is made one cycle longer, and tried again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from trajopt.core import dwell
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import JointLimit, LimitName
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.formats.samples import Samples
from trajopt.judging.joint_program import JointProgram
from trajopt.judging.passing import within_tolerance
from trajopt.judging.verification import verify

Indices = NDArray[np.int_]

MAX_LENGTHENING = 0.25  # share of the duration; with a longer motion the cycle is too long
GOOD_LENGTHENING = 0.01  # share of the duration; beyond it more breaks are tried
MAX_PIECES = 400  # for a motion whose own pieces have a higher degree
CONSTANT_RTOL = 1e-4  # relative to a limit; a smaller variation counts as constant
SAME_PLACE_RTOL = 1e-12  # relative to the largest displacement; nearer waypoints are equal
TIME_DECIMALS = 9  # a ROS message holds nanoseconds
_MOST_PER_BREAK = 4  # cycles a break, with fewer of which every cycle is a break
SAME_CYCLE = 1e-6  # cycles; a time nearer to a cycle is on it


@dataclass(frozen=True, eq=False)
class OnCycle:
    """A motion whose breaks are all whole cycles.

    Attributes:
        cycle: s.
        breaks: In cycles from 0, `(pieces + 1,)`.
        waypoints: In cycles, one per waypoint.
        states: Positions, velocities and, where the problem limits jerk, accelerations at the
            breaks, `(2 or 3, pieces + 1, joints)`, rad and s.
    """

    cycle: float
    breaks: Indices
    waypoints: Indices
    states: Array

    @property
    def duration(self) -> float:
        """s."""
        return float(self._times(self.breaks)[-1])

    @property
    def waypoint_times(self) -> Array:
        """s, one per waypoint."""
        return self._times(self.waypoints)

    def at_breaks(self, joint_names: Sequence[str]) -> Samples:
        """The fewest points that reproduce the motion."""
        return Samples(tuple(joint_names), self._times(self.breaks), *self.states)

    def at_cycles(self, joint_names: Sequence[str]) -> Samples:
        """A point every cycle; these reproduce the motion too."""
        motion = self.at_breaks(joint_names).trajectory()
        every = np.arange(self.breaks[-1] + 1)
        times = self._times(every)
        orders = range(len(self.states))
        states = np.stack([motion(times, order) for order in orders])
        # At breaks the states are exact, without the rounding of an evaluation.
        states[:, self.breaks] = self.states
        return Samples(tuple(joint_names), times, *states)

    def _times(self, cycles: Indices) -> Array:
        """s, as decimal fractions: 0.3, not 0.30000000000000004."""
        return np.round(cycles * self.cycle, TIME_DECIMALS)


def moved(problem: Problem, trajectory: Trajectory, cycle: float) -> OnCycle:
    """Return the motion with all breaks on whole cycles, in the fewest cycles, within all limits.

    Args:
        problem: Its waypoints and limits.
        trajectory: A certified one of this problem.
        cycle: s, whole nanoseconds.

    Raises:
        InvalidInput: The cycle is too long for the motion.
    """
    if "dwell" in problem.demands:
        return _with_waits(within_tolerance(problem, trajectory), trajectory, cycle)
    merged, index = problem.merged()
    _, first = np.unique(index, return_index=True)
    search = _CycleSearch(
        problem=merged,
        trajectory=trajectory,
        waypoint_times=trajectory.waypoint_times[first],
        cycle=cycle,
        order=3 if problem.has("jerk") else 2,
    )
    found = search.shortest()
    long = trajectory.duration * (1 + GOOD_LENGTHENING) + 3 * cycle
    if found is None or found.duration > long:
        other = replace(search, beside=True).shortest()
        candidates = [motion for motion in (found, other) if motion is not None]
        found = min(candidates, key=lambda motion: motion.duration, default=None)
    if found is None:
        right = f"a shorter one: a motion of {trajectory.duration:.4g} s has too few of these"
        raise InvalidInput("--cycle", right, value=cycle)
    return replace(found, waypoints=found.waypoints[index])


def _with_waits(problem: Problem, trajectory: Trajectory, cycle: float) -> OnCycle:
    """The motion part by part, with waits of whole cycles between them."""
    waits = np.ceil(problem.route.demand("dwell") / cycle - SAME_CYCLE).astype(int)
    cut = dwell.cut(problem, trajectory) or []
    found: list[OnCycle] = []
    for own, part in zip(dwell.parts(problem), cut, strict=True):
        found.append(moved(own, part.motion, cycle))
    breaks = [np.zeros(1, dtype=int)]
    waypoints = [np.zeros(1, dtype=int)]
    states = [found[0].states[:, :1]]
    elapsed = int(waits[0])
    for (_, last), motion in zip(pairwise(dwell.ends(problem)), found, strict=True):
        breaks.append(elapsed + motion.breaks)
        states.append(motion.states)
        waypoints.append(elapsed + motion.waypoints[1:])
        elapsed += int(motion.breaks[-1]) + int(waits[last])
    breaks.append(np.array([elapsed]))
    states.append(found[-1].states[:, -1:])
    waypoints[-1][-1] = elapsed
    together, first = np.unique(np.concatenate(breaks), return_index=True)
    return OnCycle(
        cycle, together, np.concatenate(waypoints), np.concatenate(states, axis=1)[:, first]
    )


@dataclass(frozen=True, eq=False)
class _CycleSearch:
    """The search for the fewest cycles in which the motion can be done.

    Attributes:
        problem: Without a waypoint twice.
        trajectory: As planned.
        waypoint_times: s, one per waypoint.
        cycle: s.
        order: Of the derivative that is constant on each piece: 2 or 3.
        beside: True for further breaks one cycle before and after each break. They are needed if
            limits are so high that a velocity or acceleration changes within less than a cycle.
    """

    problem: Problem
    trajectory: Trajectory
    waypoint_times: Array
    cycle: float
    order: int
    beside: bool = False

    def shortest(self) -> OnCycle | None:
        """The motion in the fewest cycles; None where it would get much longer.

        The added cycles double until there is a motion; then bisection finds the fewest.
        """
        cycles = self.trajectory.duration / self.cycle
        least = int(np.ceil(cycles - SAME_CYCLE))
        most = int(least * (1 + MAX_LENGTHENING)) + 1
        low = least - 1
        high = least
        found = self._in_cycles(high)
        while found is None and high < most:
            low = high
            more = max(1, 2 * (high - least))
            high = min(most, least + more)
            found = self._in_cycles(high)
        while found is not None and high - low > 1:
            middle = (low + high) // 2
            shorter = self._in_cycles(middle)
            if shorter is None:
                low = middle
            else:
                high = middle
                found = shorter
        return found

    def _in_cycles(self, cycles: int) -> OnCycle | None:
        """The motion in this many cycles, if it can be done within the limits."""
        waypoints = self._waypoints(cycles)
        if waypoints[-1] != cycles:
            return None
        factor = cycles * self.cycle / self.trajectory.duration
        stretched = self.trajectory.dilated(factor)
        breaks = np.union1d(self._breaks(stretched, cycles), waypoints)
        times = np.asarray(breaks * self.cycle, dtype=float)
        passing = np.searchsorted(breaks, waypoints)
        course = stretched(times)
        # within a tolerance, where the motion is at that cycle
        r = self.problem.route.demand("tolerance")
        near = np.clip(course[passing], self.problem.waypoints - r, self.problem.waypoints + r)
        places = np.where(r > 0, near, self.problem.waypoints)
        planned = stretched(times, self.order - 1)
        joints = []
        for joint in range(self.problem.joints):
            program = JointProgram(
                times=times,
                order=self.order,
                passing=passing,
                positions=places[:, joint],
                limits=self.problem.limits.only([joint]),
                planned=planned[:, joint],
                ends=self._ends(stretched, joint),
                course=course[:, joint],
            )
            states = program.solved()
            if states is None:
                return None
            joints.append(states)
        found = OnCycle(self.cycle, breaks, waypoints, np.stack(joints, axis=-1))
        return found if self._kept(found) else None

    def _kept(self, found: OnCycle) -> bool:
        """Return whether the judge finds the motion within all limits.

        The joints' programs do not know the limits of several joints. And what they leave of an end
        state, to their tolerance, is in the last piece, which may be a single cycle.
        """
        motion = found.at_breaks(self.problem.joint_labels).trajectory()
        passed = replace(motion, waypoint_times=found.waypoint_times)
        return verify(self.problem, passed).feasible

    def _ends(self, motion: Trajectory, joint: int) -> Array:
        """A joint's velocity (and acceleration) at both ends; a closed motion's are its own."""
        if "closed" not in self.problem.demands:
            return self.problem.route.ends(joint, self.order - 1)
        own = [motion(motion.duration, order)[joint] for order in range(1, self.order)]
        return np.array([own, own])

    def _waypoints(self, cycles: int) -> Indices:
        """The nearest whole cycle of each waypoint, each later than the one before.

        Waypoints that differ by rounding only may share a cycle.
        """
        shares = self.waypoint_times / self.trajectory.duration
        found = np.rint(shares * cycles).astype(int)
        distances = np.abs(self.problem.displacements).max(axis=1)
        apart = distances > SAME_PLACE_RTOL * distances.max()
        least = self.problem.route.demand("least_times") / self.cycle
        steps = np.maximum(apart, np.ceil(least - SAME_CYCLE)).astype(int)
        for segment, step in enumerate(steps):
            earliest = found[segment] + step
            found[segment + 1] = max(found[segment + 1], earliest)
        return found

    def _breaks(self, stretched: Trajectory, cycles: int) -> Indices:
        """The nearest whole cycles of the breaks.

        There are more where pieces have a higher degree, and with limits that are no intervals of a
        joint's derivatives, since the motion is not straight there.
        """
        wanted = stretched.breaks / self.cycle
        kinds = self.problem.limits.kinds.values()
        if not self._constant() or not all(isinstance(own, JointLimit) for own in kinds):
            step = max(1, cycles // MAX_PIECES)
            even = np.arange(0, cycles, step)
            wanted = np.append(wanted, even)
        found = np.rint(wanted).astype(int)
        if self.beside and _MOST_PER_BREAK * len(np.unique(found)) > cycles:
            return np.arange(cycles + 1)
        if self.beside:
            around = np.concatenate([found - 1, found, found + 1])
            found = around.clip(0, cycles)
        return found

    def _constant(self) -> bool:
        """Return whether the derivative of this order is constant on each piece."""
        unit = self.trajectory.pieces(self.order)
        varying = np.abs(unit[:-1]).sum(axis=0)
        kind: LimitName = "jerk" if self.order == 3 else "acceleration"
        pairs = self.problem.limits.in_all_segments().by_name()[kind]
        limit = np.abs(pairs).min(axis=1)
        usual = np.minimum(limit, np.abs(unit).max())
        return bool(np.all(varying.max(axis=0) <= CONSTANT_RTOL * usual))
