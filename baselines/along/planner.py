"""The planner `along`: the fastest timing of a path, under every kind of limit with rows.

from trajopt.planners.registry import load

load("along").along(problem, trajectory)         # a trajectory's own path
load("along:knots=chord,ends=natural").solve(problem)  # a spline through the waypoints
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from typing import Literal

import numpy as np

from baselines.along.bound import bound
from baselines.along.ceilings import ceilings
from baselines.along.engine import NoMotionError, PathTiming, timed
from baselines.along.law import NoLawError
from baselines.along.path import Path, Stop, parts
from baselines.along.program import End
from baselines.topp_ra import Ends, Knots, best_of, rules, spline, steps
from trajopt.core.arrays import Array
from trajopt.core.demand import END_STATES
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.route import State
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.certificate import Tolerance
from trajopt.planners.planner import Planner
from trajopt.planners.reductions import EQUAL_WAYPOINTS, reduced

# Accuracy of a first timing of every spline, and how many of the shortest are timed again.
_ROUGH, _AGAIN = 2e-2, 3
# A path leaves in the direction of a velocity or acceleration if they differ by less, relative.
_PARALLEL_RTOL = 1e-6
_SHOWN_STOPS = 3
# Lengths of the path's tangent that are tried where the motion begins or ends with a velocity,
# relative to the segment's mean.
_TANGENTS = (0.5, 1.0, 2.0, 4.0)


@dataclass(frozen=True)
class Along(Planner):
    """The fastest timing of a spline through the waypoints, under any limits; jerk too.

    - `knots`, `ends`: the spline's rules, as TOPP-RA's (`toppra`);
    - `accuracy`: of the duration along that path, relative.

    `"best"` times the splines of all rules roughly, and the three shortest ones accurately.
    """

    knots: Literal["uniform", "chord", "centripetal", "limit", "best"] = "best"
    ends: Literal["not-a-knot", "natural", "clamped", "best"] = "best"
    accuracy: float = 1e-3

    on_request = True
    knows = ("rows", "segment", *END_STATES)

    def __post_init__(self) -> None:
        if not 1e-6 <= self.accuracy <= 0.1:
            raise InvalidInput("accuracy", "a number from 1e-6 to 0.1", value=self.accuracy)

    def along(self, problem: Problem, trajectory: Trajectory) -> Solution:
        """Return the fastest timing of a given trajectory's path.

        Where the path stops, turns back, or has a corner the motion stops too, and the message says
        where. Under jerk limits a jump of the curvature is a corner.
        """
        return along(problem, trajectory, self.accuracy)

    def ceilings(self, problem: Problem, motion: Trajectory, times: Array) -> dict[str, Array]:
        """Return for each limit how many times as fast as a motion its path could be passed.

        That is the maximum velocity curve of each limit, by key, at times `(points,)`, s. Limits of
        jerk have none.
        """
        return ceilings(problem, motion, times)

    def bound(self, problem: Problem, path: Trajectory) -> float | None:
        """Return a time, s, that no motion along a path falls below, but for a quadrature's error.

        Jerk limits are left out of it. None where no bound is known.
        """
        try:
            return bound(path, problem.limits, self.accuracy)
        except (NoMotionError, NoLawError):
            return None

    @reduced(EQUAL_WAYPOINTS)
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        paths = _paths(problem, rules(self.knots, self.ends))
        if len(paths) > _AGAIN:
            rough = {name: _claim(along(problem, path, _ROUGH)) for name, path in paths.items()}
            paths = {name: paths[name] for name in sorted(rough, key=rough.__getitem__)[:_AGAIN]}
        found = {name: along(problem, path, self.accuracy) for name, path in paths.items()}
        if problem.route.at_rest and all(own.trajectory is None for own in found.values()):
            straight = along(problem, _straight(problem), self.accuracy)
            why = next(iter(found.values())).message
            lines = "along straight lines, with stops"
            if straight.trajectory is None:
                lines = f"along straight lines: {straight.message}"
            message = f"{lines}; along a spline: {why}"
            return replace(straight, message=message, stats={"spline": "none", **straight.stats})
        return best_of(problem, found)


def _paths(problem: Problem, tried: Sequence[tuple[Knots, Ends]]) -> dict[str, Trajectory]:
    """Return a spline for each pair of rules; between moving ends, for several tangents."""
    if problem.route.at_rest:
        return {f"{knots}/{ends}": spline(problem, knots, ends) for knots, ends in tried}
    found = {}
    for knots, ends in tried:
        for tangent in _TANGENTS:
            if problem.has("jerk"):
                found[f"{knots}/quintic/{tangent:g}"] = _quintic(problem, knots, tangent)
            else:
                found[f"{knots}/{ends}/{tangent:g}"] = spline(problem, knots, ends, tangent)
    return found


def _quintic(problem: Problem, knots: Knots, tangent: float) -> Trajectory:
    """Return the quintic spline through the waypoints, with the states at moving ends.

    Its slope there is `tangent` times the segment's mean, and its second derivative that of the
    motion at a constant speed of the parameter. At rest its second and third derivatives are 0.
    """
    from scipy.interpolate import make_interp_spline

    growth = steps(problem, knots)
    at = np.append(0.0, np.cumsum(growth))
    means = np.linalg.norm(problem.displacements, axis=1) / growth
    conditions = []
    for end, state in ((0, problem.route.start), (-1, problem.route.end)):
        speed = np.linalg.norm(state.velocity)
        joints = np.zeros(problem.joints)
        if speed > 0:
            pace = tangent * means[end] / speed
            own = [(1, pace * state.velocity), (2, pace**2 * state.acceleration)]
        elif state.acceleration.any():
            pace = tangent * means[end] / growth[end] / np.linalg.norm(state.acceleration)
            own = [(1, joints), (2, pace * state.acceleration)]
        else:
            own = [(2, joints), (3, joints)]
        conditions.append(own)
    quintics = make_interp_spline(at, problem.waypoints, k=5, bc_type=tuple(conditions))
    return Trajectory.from_spline(quintics, waypoint_times=at)


def _straight(problem: Problem) -> Trajectory:
    """Return straight lines through the waypoints."""
    slopes = problem.displacements
    at = np.arange(problem.segments + 1.0)
    return Trajectory(at, np.stack([slopes, problem.waypoints[:-1]]), at)


def _claim(solution: Solution) -> float:
    return np.inf if solution.trajectory is None else solution.trajectory.duration


def along(problem: Problem, trajectory: Trajectory, accuracy: float) -> Solution:
    """Return the fastest timing of a trajectory's path under all limits of a problem."""
    outside = _outside(problem, trajectory)
    if outside:
        return Solution(Status.FAILED, message=outside)
    found, stops = parts(trajectory, problem.limits)
    if not found:
        return Solution(Status.FAILED, message="the path does not move")
    try:
        ends = _ends(problem, found)
        timings = [
            timed(path, problem.limits, own, accuracy, exactly=not problem.route.dilatable)
            for path, own in zip(found, ends, strict=True)
        ]
    except (NoMotionError, NoLawError) as error:
        return Solution(Status.FAILED, message=str(error))
    stats = {
        "knots": sum(own.program.count for own in timings),
        "grids": sum(own.grids for own in timings),
        "stops": len(stops),
    }
    motion = _joined(timings, trajectory)
    return Solution(Status.SOLVED, motion, stopping(trajectory, stops), stats=stats)


def _outside(problem: Problem, path: Trajectory) -> str:
    """Say that a path breaks limits that no timing mends, and where; else nothing."""
    tolerated = Tolerance().position_limit * problem.largest_displacements
    for limit in problem.limits.kinds.values():
        if limit.is_ratio:
            continue
        use = limit.worst(path)
        if limit.flaw(use, tolerated, problem):
            joint = use.joint
            whose = "" if joint is None else f" of {problem.joint_labels[joint]}"
            unit = "" if joint is None else f" {problem.unit(joint)}"
            segment = int(path.segments_at(use.time)) + 1
            return (
                f"the path leaves the {limit.name()} limits{whose} by {use.value:.3g}{unit} in "
                f"segment {segment}: no timing changes that"
            )
    return ""


def stopping(path: Trajectory, stops: Sequence[Stop]) -> str:
    """Say where a path has to stop, and why; nothing where it has not."""
    if not stops:
        return ""
    said = []
    for why, alike in groupby(stops[:_SHOWN_STOPS], attrgetter("why")):
        places = " and ".join(_place(path, stop.at) for stop in alike)
        said.append(f"{why} {places}")
    more = len(stops) - _SHOWN_STOPS
    rest = f", and {more} more" if more > 0 else ""
    return f"the motion stops where the path cannot be passed: {', '.join(said)}{rest}"


def _place(path: Trajectory, at: float) -> str:
    """Say where a parameter of a path is."""
    near = np.abs(path.waypoint_times - at)
    waypoint = int(near.argmin())
    if near[waypoint] <= 1e-6 * path.duration:
        return f"at waypoint {waypoint + 1}"
    segment = int(path.segments_at(at))
    begin, end = path.waypoint_times[segment : segment + 2]
    return f"in segment {segment + 1}, after {100 * (at - begin) / (end - begin):.3g} % of it"


def _ends(problem: Problem, found: Sequence[Path]) -> list[list[End]]:
    """Return the path speeds at both ends of each part.

    Raises:
        NoMotionError: The path has another direction than the motion at its start or end.
    """
    ends = [[End(), End()] for _ in found]
    states = {
        "start": (found[0], 0, problem.route.start),
        "end": (found[-1], -1, problem.route.end),
    }
    for word, (path, side, state) in states.items():
        ends[side][side] = _end(path, word, side, _smooth(problem, state))
    for path, own in zip(found, ends, strict=True):
        for k in (0, 1):
            if own[k].b is None and 1 < path.stands[k] < path.growth:
                own[k] = End(0.0)
    return ends


def _smooth(problem: Problem, state: State) -> State:
    """Return a state without the accelerations of joints whose acceleration may jump."""
    return State(state.velocity, np.where(problem.limits.smooth >= 2, state.acceleration, 0.0))


def _end(path: Path, word: str, side: int, state: State) -> End:
    """Return the squared speed of a path's parameter, and its derivative, in a state at an end."""
    if not state.velocity.any() and not state.acceleration.any():
        return End()
    at = np.array([0.0 if side == 0 else path.length])
    _, q1, q2, _ = path.at(at, path.pieces_at(at))[:, 0]
    if not state.velocity.any():
        b = _share(state.acceleration, q2) if path.stands[side] == 2 else 0.0
        if b <= 0:
            raise NoMotionError(f"the path does not leave along the {word} acceleration")
        return End(b)
    speed = _share(state.velocity, q1) if path.stands[side] == 1 else 0.0
    if speed <= 0:
        raise NoMotionError(f"the path does not leave along the {word} velocity")
    if path.growth < 3:
        return End(speed**2)
    rest = state.acceleration - q2 * speed**2
    turning = np.abs(q2).max() + np.abs(q1).max() / path.length
    size = float(np.abs(state.acceleration).max() + turning * speed**2)
    acceleration = float(rest @ q1 / (q1 @ q1))
    if np.abs(rest - acceleration * q1).max() > _PARALLEL_RTOL * size:
        raise NoMotionError(f"the path does not leave with the {word} acceleration")
    return End(speed**2, 2 * acceleration)


def _share(vector: Array, direction: Array) -> float:
    """Return a vector over a parallel one; 0 if they are not parallel, or point apart."""
    factor = float(vector @ direction / max(float(direction @ direction), 1e-300))
    close = np.linalg.norm(vector - factor * direction) <= _PARALLEL_RTOL * np.linalg.norm(vector)
    return max(factor, 0.0) if close else 0.0


def _joined(timings: Sequence[PathTiming], path: Trajectory) -> Trajectory:
    """Return the motions of the parts one after another."""
    if len(timings) == 1:
        return timings[0].motion
    rows = max(len(own.motion.coefficients) for own in timings)
    lengths = np.concatenate([own.motion.lengths for own in timings])
    pieces = []
    for own in timings:
        missing = rows - len(own.motion.coefficients)
        pieces.append(np.pad(own.motion.coefficients, ((missing, 0), (0, 0), (0, 0))))
    breaks = np.append(0.0, np.cumsum(lengths))
    waypoints = np.sum([own.motion.waypoint_times for own in timings], axis=0)
    waypoints[-1] = breaks[-1]
    return Trajectory(
        breaks, np.concatenate(pieces, axis=1), np.minimum(waypoints, breaks[-1]), lengths
    )
