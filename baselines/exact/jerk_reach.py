"""A jerk-limited problem without units, and which times and waypoint states it can reach.

IPOPT meets its constraints to a tolerance; here its answer becomes exactly reachable, at the price
of a tiny dilation.
"""

from __future__ import annotations

import numpy as np

from baselines.exact import jerk_profiles as jerk_profile
from baselines.exact.acceleration_motion import covering
from baselines.exact.jerk_motion import combined
from baselines.exact.jerk_profiles import BRIEF, Array, Extremes, Limit, Sides, State
from baselines.exact.jerk_slivers import Task, without_slivers
from baselines.exact.jerk_stretch import JointLimits
from baselines.exact.rounded import NO_PIECES, Clock, Pieces, assembled, clocks
from trajopt.problem import Problem
from trajopt.rest_to_rest import stop_times
from trajopt.trajectory import Trajectory

_CHEAP = 1e-6  # a dilation below 1 + this is as good as none
_LARGEST_DILATION = 2.0  # what needs more is no answer
_DILATION_BISECTIONS = 5
# Of a limit without units: a velocity below it is lost in a solver's absolute tolerances.
_SLOW = 1e-3


class Scaled:
    """The moving joints without units: time in mean stop times, accelerations of order one.

    Attributes:
        h: displacements, `(segments, joints)`.
        v: velocity limits, `(2, joints)`, low first.
        a: acceleration limits, `(2, joints)`, low first.
        r: inverse jerk limits, `(2, joints)`, low first, not negative.
        speed: a unit of velocity, `(joints,)`, for a solver with absolute tolerances: the higher
            limit of joints that are slow beside the others, else 1.
        jerky: which joints have a jerk limit, `(joints,)`.
        stop: each segment's time if all joints stop at both its ends, `(segments,)`.
        shortest: each segment's time at the velocity limit, `(segments,)`.
        unit: the unit of time, s.
        units: the units of jerk, acceleration, velocity and position, rad/s^power, `(4, joints)`.
    """

    def __init__(self, problem: Problem) -> None:
        moving = problem.moving
        limits = problem.limits
        velocity = limits.velocity[moving].T
        acceleration = limits.acceleration[moving].T
        jerk = limits.jerk[moving].T
        displacements = problem.displacements[:, moving]

        without_position = problem.without("position")
        stop = stop_times(without_position)
        unit = float(stop.mean())
        # the acceleration that is reached: at its limit, or as far as jerk allows
        by_jerk = np.abs(jerk) * unit
        reached = np.minimum(np.abs(acceleration), by_jerk)
        lowest = reached.min(axis=0)
        powers = np.arange(-1.0, 3.0)[:, None]
        units = lowest * unit**powers
        j_unit, a_unit, v_unit, q_unit = units

        self.problem = problem
        self.moving = moving
        self.unit = unit
        self.units = units
        self.stop = stop / unit
        self.r = j_unit / np.abs(jerk)
        self.a = acceleration / a_unit
        self.v = velocity / v_unit
        self.h = displacements / q_unit
        fastest = np.abs(self.v).max(axis=0)
        self.speed = np.where(fastest < _SLOW, fastest, 1.0)
        self.jerky = self.r.any(axis=0)
        # T >= h / V2 forwards, T >= h / (-V1) backwards
        slowest, fastest = self.v
        forwards = self.h / fastest
        backwards = self.h / slowest
        by_joint = np.maximum(forwards, backwards)
        self.shortest = by_joint.max(axis=1)

    def sides(self, k: float = 1.0) -> Sides:
        """Limits of the upper and the mirrored lower profile, for motions `k` times as fast."""
        v1, v2 = np.abs(self.v) * k
        a1, a2 = np.abs(self.a) * k**2
        r1, r2 = self.r / k**3
        upper = Limit(v2, a2, a1, r2, r1)
        lower = Limit(v1, a1, a2, r1, r2)
        return upper, lower

    def extremes(self, times: Array, states: Array, k: float = 1.0) -> Extremes:
        """The extreme profiles of every segment and joint."""
        start, end = _ends(states)
        return jerk_profile.extremes(
            start,
            end,
            times[:, None],
            self.sides(k),
        )

    def trajectory(self, times: Array, states: Array) -> Trajectory:
        """The explicit answer: the motion through these states, without slivers."""
        motion = self.motion(times, states)
        passages = motion.waypoint_times
        joints = []
        # not where a segment is flown by in less time than can be stored
        takes_time = np.diff(passages) > 0
        stored = np.isin(passages, motion.breaks)
        mendable = self.jerky & takes_time.all() & stored.all()
        for index, joint in enumerate(np.flatnonzero(self.moving)):
            own = _own_pieces(motion, joint)
            if mendable[index]:
                task = self._task(index, joint, passages)
                own = without_slivers(own, task)
            joints.append(own)
        return Trajectory.of_moving(
            self.problem.waypoints[0],
            self.moving,
            joints,
            passages,
        )

    def _task(self, index: int, joint: np.intp, passages: Array) -> Task:
        """What one of the moving joints does, and its number among all."""
        lowest, highest = 1 / self.r[:, index]
        limits = JointLimits(
            velocity=self.v[:, index],
            acceleration=self.a[:, index],
            jerk=np.array([-lowest, highest]),
        )
        return Task(
            alone=self.problem.without("position").only([joint]),
            passages=passages,
            waypoints=self.problem.waypoints[:-1, joint],
            unit=self.unit,
            units=self.units[:, index],
            h=self.h[:, index],
            limits=limits,
        )

    def motion(self, times: Array, states: Array) -> Trajectory:
        """In each segment a convex combination of both extreme profiles."""
        passages = np.r_[0.0, np.cumsum(times)] * self.unit
        rounded = np.diff(passages) / self.unit
        states = self._through_brief(times, rounded, states)
        states = self._through_narrow(times, rounded, states)
        both = self.extremes(rounded, states)
        segments = []
        for k, clock in enumerate(clocks(passages, self.unit)):
            segment = self._segment(
                k,
                states,
                both,
                clock,
            )
            segments.append(segment)
        return assembled(self.problem, passages, segments)

    def _through_brief(self, times: Array, rounded: Array, states: Array) -> Array:
        """The states, with the velocities that pass a brief segment in its rounded time.

        A break is rounded by 1e-15 s. At a constant velocity that is a displacement which jerk
        could not make up for within 1e-6 s, and a change of the velocity of 1e-9: the long
        neighbours hardly notice. Of two brief segments in a row the briefer one decides.
        """
        states = states.copy()
        velocity = states[0]
        given = velocity.copy()
        by_length = np.argsort(-times)
        for k in by_length:
            if times[k] < BRIEF:
                ends = slice(k, k + 2)
                quicker = times[k] / rounded[k]
                velocity[ends] = quicker * given[ends]
        return states

    def _through_narrow(self, times: Array, rounded: Array, states: Array) -> Array:
        """The states, those after a narrow segment where constant jerk leads.

        A break is rounded. Over a segment of 1e-6 s the velocity that acceleration gains within
        rounding of a break, 1e-15 rad/s, is worth a percent of the jerk limit, over a long one
        nothing: so the long one has to make up for it.
        """
        states = states.copy()
        velocity, acceleration = states
        both = self.extremes(times, states)
        start, end = _ends(states)
        narrow = both.narrow(
            start,
            end,
            times[:, None],
            self.h,
        )
        narrow &= self.jerky
        for k in range(len(times) - 1):
            joints = narrow[k]
            u = velocity[k, joints]
            a = acceleration[k, joints]
            b = acceleration[k + 1, joints]
            # w = u + (a + b) T/2
            w = u + (a + b) / 2 * rounded[k]
            velocity[k + 1, joints] = w
        return states

    def _segment(
        self,
        k: int,
        states: Array,
        both: Extremes,
        clock: Clock,
    ) -> list[Pieces]:
        """Stored breaks (s) and coefficients (rad/s^power) of every joint over one segment."""
        if clock.length == 0:
            return [NO_PIECES] * len(self.jerky)
        # The breaks of joints without a jerk limit are where they are: acceleration may jump there.
        order = np.argsort(self.jerky, kind="stable")
        places = np.array([clock.start, clock.end])
        pieces: list[Pieces] = [NO_PIECES] * len(order)
        for i in order:
            ends = states[:, k : k + 2, i]
            h = self.h[k, i]
            if self.jerky[i]:
                upper, lower = self.sides()
                stored, part = combined(
                    ends,
                    h,
                    both.at(k, i),
                    sides=(upper.at(i), lower.at(i)),
                    clock=clock,
                    places=places,
                )
            else:
                stored, part = covering(
                    h,
                    ends[0],
                    self.v[:, i],
                    self.a[:, i],
                    clock,
                )
            places = np.union1d(places, stored)
            powers = len(part)
            units = self.units[-powers:, i]
            pieces[i] = (stored, part * units[:, None])
        return pieces


def _own_pieces(motion: Trajectory, joint: np.intp) -> Pieces:
    """One joint's pieces: they begin where its own polynomial changes, and at waypoints."""
    coefficients = motion.coefficients[..., joint]
    cubic, square, *_ = coefficients
    jerk_changes = np.diff(cubic, prepend=np.nan) != 0
    # without jerk, where another acceleration begins
    is_steady = cubic == 0
    acceleration_changes = np.diff(square, prepend=np.nan) != 0
    changes = jerk_changes | (is_steady & acceleration_changes)
    begins = motion.breaks[:-1]
    passed = np.isin(begins, motion.waypoint_times)
    starts = changes | passed
    breaks = motion.breaks[np.append(starts, True)]
    return breaks, coefficients[:, starts]


def _ends(states: Array) -> tuple[State, State]:
    """Velocities and accelerations at the start, and at the end, of every segment."""
    velocity, acceleration = states
    start = (velocity[:-1], acceleration[:-1])
    end = (velocity[1:], acceleration[1:])
    return start, end


def repaired(
    times: Array,
    states: Array,
    scaled: Scaled,
) -> tuple[float, Array, Array]:
    """The smallest dilation that makes times and waypoint states reachable, and those.

    In a segment so brief that what its states reach is narrower than IPOPT's tolerance, no dilation
    helps: if its time and states are replaced by those that reach, the long neighbours hardly
    notice.
    """
    k = repair(times, states, scaled)
    if k < 1 + _CHEAP:
        return k, times, states
    smooth_times, smooth_states = _smoothed(times, states, scaled)
    smooth_k = repair(smooth_times, smooth_states, scaled)
    if smooth_k < k:
        return smooth_k, smooth_times, smooth_states
    return k, times, states


def _smoothed(
    times: Array,
    states: Array,
    scaled: Scaled,
) -> tuple[Array, Array]:
    """Times and states, where a brief segment is not reachable those of constant jerk through it.

    Its time becomes the one that changes the velocities least: a rounding error of the time is
    worth a million such errors of the velocity where a segment is a millionth as long as others.
    """
    times = times.copy()
    states = states.copy()
    velocity, acceleration = states
    both = scaled.extremes(times, states)
    reachable = both.reach(scaled.h, scaled.sides())
    for k in range(1, len(times) - 1):  # the outer ends of the first and the last rest
        t = times[k]
        joints = np.flatnonzero(~reachable[k])
        if t >= BRIEF or not joints.size:
            continue
        h = scaled.h[k, joints]
        u = velocity[k, joints]
        w = velocity[k + 1, joints]
        a = acceleration[k, joints]
        b = acceleration[k + 1, joints]
        # constant jerk: h = v T with the mean velocity v = (u + w)/2 − (b − a) T/12
        middle = (u + w) / 2
        mean = middle - (b - a) * t / 12
        covered = h @ mean
        if covered > 0:
            # the T that minimises |h − v T|
            best = covered / (mean @ mean)
            t = np.clip(best, t / 2, 2 * t)
        # h = u T + a T²/2 + (b − a) T²/6
        sped = a * t / 2
        jerked = (b - a) * t / 6
        u = h / t - sped - jerked
        # w = u + (a + b) T/2
        w = u + (a + b) / 2 * t
        times[k] = t
        velocity[k, joints] = u
        velocity[k + 1, joints] = w
    return times, states


def repair(times: Array, states: Array, scaled: Scaled) -> float:
    """The smallest dilation that makes times and waypoint states exactly reachable.

    Dilating by `k` multiplies the velocity limits by `k`, the accelerations by `k²` and the jerks
    by `k³`, which widens every reachable interval.
    """
    low = 1.0
    high = 1.0 + 1e-14
    while not _reachable(times, states, scaled, high):
        low = high
        high = 1 + 10 * (high - 1)
        if high > _LARGEST_DILATION:
            return np.inf
    for _ in range(_DILATION_BISECTIONS):
        middle = 0.5 * (low + high)
        if _reachable(times, states, scaled, middle):
            high = middle
        else:
            low = middle
    return high


def _reachable(
    times: Array,
    states: Array,
    scaled: Scaled,
    k: float,
) -> bool:
    """Whether limits widened by a dilation by `k` admit these times and states."""
    velocity, acceleration = states
    v1, v2 = scaled.v * k
    a1, a2 = scaled.a * k**2
    conditions = [
        v1 <= velocity,
        velocity <= v2,
        a1 <= acceleration,
        acceleration <= a2,
    ]
    if not all(bool(condition.all()) for condition in conditions):
        return False
    both = scaled.extremes(times, states, k)
    reached = both.reach(scaled.h, scaled.sides(k))
    return bool(reached.all())
