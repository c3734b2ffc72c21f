"""The front of duration and smoothness of a problem, and motions compared with it.

front = trajopt.front("six-axis", durations=[1.8, 2.0, 3.0])
for point in front.points:
    print(point.duration, point.value, point.lower)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Literal, Protocol, cast

import numpy as np

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial
from trajopt.core.demand import names
from trajopt.core.exceptions import InvalidInput, TrajoptError
from trajopt.core.numerals import is_number
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.smoothness import FrontPoint, unit
from trajopt.judging.verification import verify
from trajopt.planners.planner import Planner
from trajopt.planners.registry import configured, entries
from trajopt.planners.rest_to_rest import stop_times

Measure = Literal["jerk", "acceleration"]


class KnowsFront(Protocol):
    """A planner that knows the smoothest motions of a problem."""

    def front(
        self,
        problem: Problem,
        durations: Sequence[float] | None,
        time_limit: float,
        tell: Callable[[str], None],
    ) -> list[FrontPoint]:
        """Return a point for each duration; `tell` is called with what is done next."""
        ...

    def smoothed(self, problem: Problem, motion: Trajectory) -> Trajectory:
        """Return the smoothest motion of the same waypoint times."""
        ...


@dataclass(frozen=True)
class Beside:
    """A motion compared with the front.

    Attributes:
        label: Label of the planner, or name of the motion.
        duration: Certified duration, s.
        value: Its integral; infinite where it jumps.
        times_the_least: Its integral over the least one of the same duration; infinite where it
            jumps, None where no motion of its duration is found.
        shortest: The shortest duration with the same integral, s; None where it jumps.
    """

    label: str
    duration: float
    value: float
    times_the_least: float | None
    shortest: float | None

    def as_dict(self) -> dict[str, Any]:
        """Return the values for JSON; infinite ones are None."""
        return {
            "label": self.label,
            "duration": self.duration,
            "value": self.value if np.isfinite(self.value) else None,
            "times_the_least": self.times_the_least if np.isfinite(self.value) else None,
            "shortest": self.shortest,
        }


@dataclass(frozen=True, eq=False)
class Front:
    """The smoothest motions of several durations.

    Attributes:
        problem: All its limits are kept.
        measure: `jerk` or `acceleration`, whose square is integrated.
        points: Points in the order of durations.
    """

    problem: Problem
    measure: Measure
    points: tuple[FrontPoint, ...]

    @cached_property
    def unit(self) -> str:
        """Return the unit of the integrals."""
        return unit(self.problem, 3 if self.measure == "jerk" else 2)

    def as_dict(self) -> dict[str, Any]:
        """Return the front for JSON, in SI units; `lower` is None where nothing is proved."""
        names = ("duration", "value", "lower")
        return {"points": [{name: getattr(p, name) for name in names} for p in self.points]}

    def beside(self, trials: Iterable[Trial]) -> list[Beside]:
        """Return the trials with a certified motion, compared with the front, by duration."""
        found = []
        for trial in trials:
            duration, smooth = trial.certified_duration, trial.smoothness
            if duration is None or smooth is None:
                continue
            value = smooth.jerk_integral
            if self.measure == "acceleration":
                value = smooth.acceleration_integral
            found.append(self._stand(trial.label, duration, value))
        return sorted(found, key=lambda own: own.duration)

    def _stand(self, label: str, duration: float, value: float) -> Beside:
        if not np.isfinite(value):
            return Beside(label, duration, value, np.inf, None)
        least = self._smooth(duration=duration).solve(self.problem).stats.get("value")
        shortest = self._smooth(budget=value).solve(self.problem).trajectory
        return Beside(
            label,
            duration,
            value,
            None if least is None else value / least,
            None if shortest is None else shortest.duration,
        )

    def _smooth(self, **options: float) -> Planner:
        return _smooth(self.measure, **options)


def front(
    problem: Problem | str | Path,
    *,
    measure: Measure = "jerk",
    durations: Sequence[float] | None = None,
    time_limit: float = 60.0,
    tell: Callable[[str], None] = lambda step: None,
) -> Front:
    """Return the front of duration and smoothness (docs/mathematics.md, section 12).

    Args:
        problem: A problem, the name of a built-in one, or a problem file.
        measure: `jerk` or `acceleration`, whose square is integrated.
        durations: s; by default from 1.05 to 3 times the shortest known duration.
        time_limit: Seconds of CPU time for the proof of each point; with 0 nothing is proved.
        tell: Called with what is done next, and at first with how long all may take.

    Raises:
        InvalidInput: A duration is no positive number, or too short for any motion known.
        TrajoptError: The problem has a demand, or limits of a kind, that the front does not know.
    """
    if measure not in ("jerk", "acceleration"):
        raise InvalidInput("measure", "'jerk' or 'acceleration'", value=measure)
    if not (is_number(time_limit) and 0 <= time_limit < np.inf):
        raise InvalidInput("time_limit", "seconds, 0 or more", value=time_limit)
    for duration in durations if durations is not None else ():
        if not (is_number(duration) and 0 < duration < np.inf):
            raise InvalidInput("durations", "positive numbers", value=duration)
    if durations is not None and not len(durations):
        raise InvalidInput("durations", "at least one, s")
    given = catalogue.given(problem)
    smooth = _smooth(measure)
    reason = _unknown(smooth, given)
    if reason is not None:
        raise TrajoptError(f"{given.name} has no front here: {reason}")
    planner = cast(KnowsFront, smooth)
    asked = None if durations is None else sorted(map(float, durations))
    return Front(given, measure, tuple(planner.front(given, asked, time_limit, tell)))


def smoothest(problem: Problem, motion: Trajectory) -> Trajectory:
    """Return a motion of the same waypoint times within every limit, each joint as smooth as it is.

    Of all motions of minimum time this is the one whose joints have the least ∫ jerk²: joints that
    do not decide the time stop jerking. A motion with demands on its way, or under limits of other
    kinds than each joint's own, is returned as it is.

    Raises:
        MissingBackend: CasADi is not installed.
    """
    return cast(KnowsFront, _smooth("jerk")).smoothed(problem, motion)


@dataclass(frozen=True)
class FreeLeast:
    """The least ∫ jerk² known of all durations in which the smoothest motion meets no limit.

    Without active limits the smoothest motion of another duration is a dilation of this one, and
    its integral is `constant / duration⁵`.

    Attributes:
        constant: Integral of a motion of 1 s, in the problem's units.
        shortest: The shortest duration in which it keeps every limit, s.
    """

    constant: float
    shortest: float

    def times(self, duration: float, value: float) -> float | None:
        """Return an integral over the least of the same duration; None where limits act."""
        if duration < self.shortest * (1 - _SHORTEST_RTOL):
            return None
        return value * duration**5 / self.constant


def free_least(problem: Problem) -> FreeLeast | None:
    """Return the least ∫ jerk² where no limit acts, from one short search; None if one always does.

    None too where the front does not know the problem's limits or demands.
    """
    if _unknown(_smooth("jerk"), problem) is not None:
        return None
    slow = _SLOW * float(stop_times(problem).sum())
    solution = _smooth("jerk", duration=slow).solve(problem)
    motion = solution.trajectory
    if motion is None or solution.stats["limits_act"]:
        return None
    shortest = motion.duration * verify(problem, motion).dilation
    return FreeLeast(float(solution.stats["value"]) * motion.duration**5, shortest)


# A duration in which limits rarely act, relative to that of stopping at every waypoint.
_SLOW = 3.0
_SHORTEST_RTOL = 1e-9


def _unknown(smooth: Planner, problem: Problem) -> str | None:
    """Return what the front does not know of a problem: it may leave nothing out."""
    kinds = problem.limits.kinds
    left_out = [names([key]) for key in problem.demands if key not in smooth.knows]
    left_out += [f"{kinds[key].name()} limits" for key in smooth.unknown(problem)]
    if left_out:
        return f"it does not know {' and '.join(left_out)}"
    return smooth.unsupported(problem)


def _smooth(measure: Measure, **options: float) -> Planner:
    """Return the planner of the smoothest motions, loaded by its entry point like any planner."""
    return configured(entries()["smooth"].load(), {"measure": measure, **options}, "smooth")
