"""The fastest timing of a path that is given: a motion's own, or a spline through waypoints.

found = trajopt.retime("plan.yaml", limits)
print(found.duration, found.given_duration, found.motion)
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

import numpy as np
from numpy.typing import ArrayLike

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial, trials_of
from trajopt.core import dwell, polynomials
from trajopt.core.arrays import Array
from trajopt.core.demand import DEMANDS, END_STATES
from trajopt.core.exceptions import InvalidInput
from trajopt.core.interpolation import Interpolation
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.explain.active_limits import Hold, holds
from trajopt.explain.references import PATH_TIMING
from trajopt.formats.motion import Motion
from trajopt.judgement import as_executed, motion_of, passing
from trajopt.judging.verification import certified
from trajopt.planners.planner import Planner
from trajopt.planners.registry import configured, load

if TYPE_CHECKING:
    from scipy.interpolate import BSpline, PPoly

_PLANNER = PATH_TIMING.partition(":")[0]


class _Timer(Protocol):
    """A planner that times paths, and knows the speeds that limits allow along them."""

    def ceilings(self, problem: Problem, motion: Trajectory, times: Array) -> dict[str, Array]:
        """Return by key how many times as fast as a motion its path could be passed."""
        ...

    def bound(self, problem: Problem, path: Trajectory) -> float | None:
        """Return a time, s, that no motion along a path falls below; None where none is known."""
        ...


@dataclass(frozen=True)
class GivenPath(Planner):
    """The fastest timing of a given path, or its own timing where that is shorter."""

    path: Trajectory
    planner: Planner

    knows = ("rows", "segment", *END_STATES, "dwell")

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        times = self.path.waypoint_times
        motions, said = [], []
        stats: dict[str, Any] = {}
        for part, (first, last) in zip(
            dwell.parts(problem), pairwise(dwell.ends(problem)), strict=True
        ):
            cut = dwell.between(self.path, times[first], times[last])
            if cut is None:
                message = f"the path takes no time from waypoint {first + 1} to {last + 1}"
                return Solution(Status.FAILED, message=message)
            passed = np.clip(times[first : last + 1] - times[first], 0.0, cut.duration)
            passed[[0, -1]] = 0.0, cut.duration
            found = self.planner.along(part, replace(cut, waypoint_times=passed))
            if found.trajectory is None:
                return found
            motions.append(found.trajectory)
            said.append(found.message)
            stats |= found.stats
        motion = dwell.joined(problem, motions) if len(motions) > 1 else motions[0]
        as_given = certified(problem, self.path)
        if as_given is not None and as_given.duration < motion.duration:
            motion = as_given
        return Solution(Status.SOLVED, motion, "; ".join(filter(None, said)), stats=stats)

    def options(self) -> dict[str, Any]:
        return self.planner.options()

    def defaults(self) -> dict[str, Any]:
        return self.planner.defaults()


@dataclass(frozen=True, eq=False)
class Retiming:
    """The fastest motion along a path.

    Attributes:
        name: of the path.
        trial: the motion, judged. `trajopt.write` writes it for a controller.
        path: the path, with the waypoints' parameters; None for a spline that the planner chose.
        given_duration: of the motion whose path it is, s; None for waypoints.
        given_certified: its certified duration, s: slower if it breaks a limit; None where it has a
            flaw.
        misses: how far the path passes from a waypoint that was asked for, at most, rad (or m). The
            path counts: the waypoints of `problem` are where it passes.
    """

    name: str
    trial: Trial
    path: Trajectory | None
    given_duration: float | None
    given_certified: float | None = None
    misses: float = 0.0

    def __repr__(self) -> str:
        if self.duration is None:
            return f"Retiming({self.name}: {self.trial.message})"
        return f"Retiming({self.name}: {self.duration:.6g} s certified)"

    @property
    def problem(self) -> Problem:
        return self.trial.problem

    @property
    def motion(self) -> Trajectory | None:
        """The certified motion; None where there is none, and `trial.message` says why."""
        return self.trial.certified_trajectory

    @property
    def duration(self) -> float | None:
        """The certified duration, s; None without one."""
        return self.trial.certified_duration

    @cached_property
    def held(self) -> list[Hold]:
        """The limits that hold the motion back, those for the longest time first."""
        return [] if self.motion is None else holds(self.problem, self.motion)

    @cached_property
    def leaves(self) -> float | None:
        """The largest distance of the certified motion from the path, rad (or m).

        The motion is composed with the path exactly. This is what the verifier's repair changed,
        and rounding.
        """
        composed = self.trial.solution.trajectory
        if self.motion is None or composed is None:
            return None
        return apart(self.motion, composed.dilated(self.motion.duration / composed.duration))

    @cached_property
    def bound(self) -> float | None:
        """A time, s, that no motion along the path falls below; None where none is known.

        It is computed by a quadrature, some 0.2 % below the motion, and not proved. Jerk limits
        are left out of it.
        """
        path = self.motion if self.path is None else self.path
        if path is None:
            return None
        found = cast(_Timer, load(_PLANNER)).bound(self.problem, path)
        return None if found is None else found + float(self.problem.route.demand("dwell").sum())

    def ceilings(self, times: Array) -> dict[str, Array]:
        """Return the highest speed along the path that each limit allows, relative to the motion's.

        By key, at times of the motion `(points,)`, s: the maximum velocity curve of each limit.
        Limits of jerk have none.
        """
        if self.motion is None:
            return {}
        return cast(_Timer, load(_PLANNER)).ceilings(self.problem, self.motion, times)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON: SI units, joints count from 1, None for what does not exist."""
        found = []
        for (joint, limit, start, end), share in self.held:
            number = None if joint is None else joint + 1
            found.append(
                {"joint": number, "limit": limit, "share": share, "from": start, "to": end}
            )
        return {
            "path": self.name,
            "given_duration": self.given_duration,
            "given_certified_duration": self.given_certified,
            "leaves_path": self.leaves,
            "misses_waypoints": self.misses,
            "held_back_by": found,
            **self.trial.as_dict(),
        }


def apart(one: Trajectory, other: Trajectory) -> float:
    """Return a bound on the distance of two motions of one duration, rad, at any time."""
    left, right = one.refined(other.breaks), other.refined(one.breaks)
    if len(left.lengths) != len(right.lengths):
        return float("nan")
    difference = polynomials.plus(left.pieces(), -right.pieces())
    rounding = polynomials.evaluation_rounding(left.pieces()).max()
    return float(np.abs(polynomials.bernstein(difference)).max() + rounding)


def retime(
    path: str | Path | Motion | Trajectory | PPoly | BSpline | ArrayLike,
    limits: Limits | Problem | str | Path,
    *,
    accuracy: float = 1e-3,
    knots: str = "best",
    ends: str = "best",
    interpolation: Interpolation = "auto",
    unit: str | None = None,
    **demands: Any,
) -> Retiming:
    """Return the fastest motion along a path, under any limits that state their rows.

    A motion's geometry is kept, its timing dropped. Waypoints get a spline. Where the path has a
    corner (under jerk limits also of its curvature), the motion stops, and its message says where.

    Args:
        path: a file of a motion, or a motion: `Trajectory`, SciPy's piecewise polynomials, what
            `trajopt.formats.motion` reads; or waypoints, rad, `(waypoints, joints)`.
        limits: or a problem (an object, a name, a problem file), whose limits and demands are kept,
            and whose waypoints the path passes.
        accuracy: of the duration along the path, relative.
        knots, ends: the spline's rules, as the planner `along` has them; of waypoints only.
        interpolation: how a file's samples are joined; by default as a controller joins them.
        unit: units of a CSV's columns whose header says none, like "deg" or "deg,mm,ms".
        demands: `start_velocity`, `end_velocity`, `dwell` and others, as a `Problem` has them;
            beside `Limits` only.

    Raises:
        InvalidInput: The path, the limits or the demands cannot be used; the message says which.
    """
    rules = {"accuracy": accuracy, "knots": knots, "ends": ends}
    planner = configured(load(_PLANNER), rules, _PLANNER)
    asked = limits if isinstance(limits, Limits) else catalogue.given(limits)
    if isinstance(asked, Problem) and demands:
        right = "these among the problem's own demands: Problem(…, start_velocity=…)"
        raise InvalidInput("demands", right, value=sorted(demands))
    if not isinstance(path, str | Path | Motion | Trajectory) and not _is_spline(path):
        return _through(np.asarray(path, dtype=float), asked, planner, demands)
    units: dict[str, str] = {}
    names: Sequence[str] = ()
    if isinstance(asked, Problem):
        names = asked.joint_names
        known = zip(asked.joint_labels, asked.joint_units, strict=False)
        units = dict(known) or dict.fromkeys(names, "rad")
    given = motion_of(path, interpolation, unit, units).for_joints(names)
    trajectory = given.trajectory
    if isinstance(asked, Problem):
        given.check_units(asked)
        return along(given.name, passing(asked, trajectory), asked, planner, trajectory.duration)
    if (
        isinstance(path, Trajectory)
        and (np.ptp(trajectory(trajectory.waypoint_times), axis=0) > 0).any()
    ):
        problem = Problem(trajectory(trajectory.waypoint_times), asked, name=given.name, **demands)
        return along(given.name, trajectory, problem, planner, trajectory.duration)
    states = {
        key: np.asarray(values, dtype=float) for key, values in demands.items() if key in DEMANDS
    }
    problem = as_executed(given, asked, ends=states).problem
    return along(given.name, passing(problem, trajectory), problem, planner, trajectory.duration)


def along(
    name: str,
    path: Trajectory,
    problem: Problem,
    planner: Planner | None = None,
    given_duration: float | None = None,
) -> Retiming:
    """Return the fastest motion along a path that passes a problem's waypoints.

    Args:
        name: of the path.
        path: with the waypoints' parameters.
        problem: the limits and demands.
        planner: by default `along`.
        given_duration: of the motion whose path it is, s.
    """
    passed = path(path.waypoint_times)
    away = np.abs(passed - problem.waypoints)
    misses = float(np.where(away > problem.rounding, away, 0.0).max())
    if misses:
        low, high = problem.limits.position.T
        moved = np.clip(passed, low, high)
        problem = replace(problem, waypoints=moved, name=f"{problem.name}, as passed")
    timed = GivenPath(path, planner or load(_PLANNER))
    (trial,) = trials_of(timed, problem, [0], "retime")
    given = None if given_duration is None else certified(problem, path)
    within = None if given is None else given.duration
    return Retiming(name, trial, path, given_duration, within, misses)


def _through(
    waypoints: Array, asked: Limits | Problem, planner: Planner, demands: Mapping[str, Any]
) -> Retiming:
    """Return the fastest motion along the best spline through waypoints."""
    if isinstance(asked, Problem):
        right = "limits beside waypoints: retime(waypoints, problem.limits)"
        raise InvalidInput("limits", right, value=asked.name)
    problem = Problem(waypoints, asked, name="waypoints", **demands)
    return through(problem, planner)


def through(problem: Problem, planner: Planner | None = None) -> Retiming:
    """Return the fastest motion along the best spline through a problem's waypoints."""
    (trial,) = trials_of(planner or load(_PLANNER), problem, [0], _PLANNER)
    return Retiming(problem.name, trial, None, None)


def _is_spline(path: object) -> bool:
    """Return whether it is a piecewise polynomial of SciPy."""
    return any(hasattr(path, name) for name in ("breaks", "x", "tck", "t")) and callable(path)
