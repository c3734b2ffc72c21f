"""What a gap is made of, and what holds a planner back (mathematics, section 6).

    trajectory = certified(problem, load("issa").solve(problem).trajectory)
    found = explain(problem, load("issa"), trajectory)
    print(found.gap, found.timing_gap, found.route_gap, found.notes)

Other planners are asked for what is needed by their registered names: `exact`, `exact-jerk`,
`collocation-refined` for the optimum, `toppra` for the best timing of a path, `spline353-nlp` for
the best 3-5-3.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials, spline353
from trajopt.exceptions import TrajoptError
from trajopt.explain.active_limits import Binding, binding, scattered
from trajopt.planner import Planner
from trajopt.problem import Limits, Problem
from trajopt.registry import load
from trajopt.solution import Solution
from trajopt.trajectory import Trajectory
from trajopt.verification import certified, verify

Array = NDArray[np.float64]

_SAME = 1e-9  # rad, times the largest waypoint coordinate where that exceeds 1
_SAMPLES = 50  # per segment: two piecewise quintics that agree there agree everywhere


REFERENCES = ("exact", "exact-jerk", "collocation-refined")


def references(problem: Problem) -> list[str]:
    """The planners whose shortest certified answer is a problem's best known optimum."""
    needed = (True, problem.has("jerk"), problem.has("position"))
    return [name for name, need in zip(REFERENCES, needed, strict=True) if need]


@dataclass(frozen=True, eq=False)
class Explanation:
    """Two decompositions of one gap, each a product, and the limits that bind. Gaps are ratios.

    - `gap = certified_duration / exact`, both in seconds; `exact` is the best known optimum;
    - `gap = timing_gap * route_gap`: over the best timing of its own path, and that over the
      optimum;
    - `gap = optimiser_gap * shape_gap * smoothness_gap`, of a 3-5-3 spline: over the best 3-5-3,
      that over the optimum with its jerk, and that over the optimum.

    A gap that does not apply is None, and `notes` has the reason under its name. `trajectory` and
    `optimum` are what was compared.
    """

    certified_duration: float
    exact: float | None
    gap: float | None
    timing_gap: float | None
    route_gap: float | None
    optimiser_gap: float | None
    shape_gap: float | None
    smoothness_gap: float | None
    notes: Mapping[str, str]
    binding: tuple[Binding, ...]
    trajectory: Trajectory = field(repr=False)
    optimum: Trajectory | None = field(repr=False)

    def steps(self) -> dict[str, list[tuple[str, float]]]:
        """Both decompositions that apply, from the optimum up: what was added, the duration, s."""
        chains = {
            "path and timing": ("route", "timing"),
            "the 3-5-3 family": ("smoothness", "shape", "optimiser"),
        }
        return {title: self._climb(names) for title, names in chains.items() if self._has(names)}

    def _has(self, names: tuple[str, ...]) -> bool:
        return self.exact is not None and all(getattr(self, f"{n}_gap") is not None for n in names)

    def _climb(self, names: tuple[str, ...]) -> list[tuple[str, float]]:
        ratios = np.cumprod([1.0, *(getattr(self, f"{name}_gap") for name in names)])
        return list(zip(("optimum", *names), ratios * self.exact, strict=True))

    def as_dict(self) -> dict[str, Any]:
        """For JSON: seconds and ratios; joints count from 1."""
        hidden = ("trajectory", "optimum", "binding")
        table = {k: getattr(self, k) for k in self.__dataclass_fields__ if k not in hidden}
        rows = [asdict(b) | {"joint": b.joint + 1} for b in self.binding]
        names = {"start": "from", "end": "to"}
        return table | {"binding": [{names.get(k, k): v for k, v in r.items()} for r in rows]}


class _Answer(NamedTuple):
    """A certified trajectory, or None and why not."""

    trajectory: Trajectory | None
    reason: str = ""

    @property
    def duration(self) -> float | None:
        return None if self.trajectory is None else self.trajectory.duration


def explain(problem: Problem, planner: Planner, trajectory: Trajectory) -> Explanation:
    """Decompose the gap of a planner's certified trajectory, and say which limits hold it back.

    Raises `TrajoptError` if `trajectory` has no certified duration.
    """
    own = certified(problem, trajectory)
    if own is None:
        flaws = "; ".join(verify(problem, trajectory).flaws)
        raise TrajoptError(f"no certified duration, so nothing to explain: {flaws}")
    optimum = _optimum(problem)
    ratios, notes = _ratios(problem, own, optimum)
    solver, notes["worth"] = _solver(planner, problem, own)
    found = binding(problem, own, solver)
    if scattered(found, own.duration):
        notes["worth"] += "; a local search: some of it is luck, no optimum changes like this"
    return Explanation(
        own.duration, optimum.duration, **ratios, notes=notes, binding=found, trajectory=own,
        optimum=optimum.trajectory,
    )  # fmt: skip


def _solver(planner: Planner, problem: Problem, own: Trajectory) -> tuple[Planner | None, str]:
    """Who solves the problem again with relaxed limits: a swarm's scatter would drown the worth."""
    if not planner.stochastic:
        return planner, "this planner, planning again"
    if _is_spline353(problem, own):
        return load("spline353-nlp"), "the best 3-5-3, found again"
    return None, "this trajectory, dilated less"


def _ratios(
    problem: Problem, own: Trajectory, optimum: _Answer
) -> tuple[dict[str, float | None], dict[str, str]]:
    """Every gap by name, None with a note where it does not apply."""
    notes: dict[str, str] = {}
    retimed, best = _retimed(problem, own), _best_spline(problem, own)
    smooth = _as_smooth(problem, best)
    chain = {
        "gap": (_Answer(own), optimum),
        "timing_gap": (_Answer(own), retimed),
        "route_gap": (retimed, optimum),
        "optimiser_gap": (_Answer(own), best),
        "shape_gap": (best, smooth),
        "smoothness_gap": (smooth, optimum),
    }
    ratios = {name: _ratio(name, *pair, notes) for name, pair in chain.items()}
    return ratios, notes


def _ratio(name: str, above: _Answer, below: _Answer, notes: dict[str, str]) -> float | None:
    if above.duration is None or below.duration is None:
        notes[name] = above.reason or below.reason
        return None
    return above.duration / below.duration


def _optimum(problem: Problem) -> _Answer:
    """The first reference that keeps all limits; `exact` does so also where it ignores some."""
    reason = ""
    for name in references(problem):
        answer = _asked(name, problem)
        if answer.trajectory is not None:
            return answer
        reason = f"{name}: {answer.reason}"
    return _Answer(None, reason)


def _asked(name: str, problem: Problem) -> _Answer:
    """A registered planner's certified answer."""
    try:
        planner = load(name)
        reason = planner.unsupported(problem)
        return _Answer(None, reason) if reason else _judged(problem, planner.solve(problem))
    except TrajoptError as error:
        return _Answer(None, str(error))


def _judged(problem: Problem, solution: Solution) -> _Answer:
    if solution.trajectory is None:
        return _Answer(None, solution.message or str(solution.status))
    flaws = "; ".join(verify(problem, solution.trajectory).flaws)
    return _Answer(certified(problem, solution.trajectory), flaws)


def _shorter(a: Trajectory, b: _Answer) -> _Answer:
    """The shorter of two answers to one question; a missing one stays missing."""
    return _Answer(a) if b.duration is not None and a.duration <= b.duration else b


def _retimed(problem: Problem, own: Trajectory) -> _Answer:
    """The best timing of the trajectory's own path; its own timing is one, whatever the grid."""
    try:
        planner = load("toppra")
        reason = planner.unsupported(problem)
        if reason:
            return _Answer(None, reason)
        return _shorter(own, _judged(problem, planner.along(problem, own)))
    except TrajoptError as error:
        return _Answer(None, str(error))


def _best_spline(problem: Problem, own: Trajectory) -> _Answer:
    """The best 3-5-3 with shared times, if the trajectory is one."""
    if not _is_spline353(problem, own):
        return _Answer(None, "not a 3-5-3 spline with segment times shared by all joints")
    return _shorter(own, _asked("spline353-nlp", problem))


def _is_spline353(problem: Problem, own: Trajectory) -> bool:
    merged, index = problem.merged()
    times = np.diff(own.waypoint_times[np.unique(index, return_index=True)[1]])
    if spline353.unsupported(problem) is not None or not (times > 0).all():
        return False
    spline = spline353.trajectory(merged, times)
    ends = spline.breaks
    t = np.concatenate([np.linspace(*pair, _SAMPLES) for pair in pairwise(ends)])
    scale = max(1.0, float(np.abs(problem.waypoints).max()))
    return bool(np.abs(spline(t) - own(t)).max() <= _SAME * scale)


def _as_smooth(problem: Problem, spline: _Answer) -> _Answer:
    """The optimum when every joint's jerk may be what it is at most in this spline."""
    if spline.trajectory is None:
        return spline
    jerk = peaks(spline.trajectory, order=3)
    limits = problem.limits
    as_smooth = Limits(
        limits.velocity, limits.acceleration, np.where(jerk > 0, jerk, np.inf), limits.position
    )
    equal = Problem(problem.waypoints, as_smooth, problem.name)
    return _shorter(spline.trajectory, _asked("exact-jerk", equal))


def peaks(trajectory: Trajectory, order: int) -> Array:
    """The exact largest absolute value of a derivative, `(joints,)`, in rad/s^order."""
    unit = polynomials.stretched(
        polynomials.derivative(trajectory.coefficients, order), np.diff(trajectory.breaks)
    )
    flat = unit.reshape(len(unit), -1)
    values = np.abs(polynomials.evaluate(flat[:, None], polynomials.critical_points(flat)))
    return np.asarray(values.max(axis=0).reshape(unit.shape[1:]).max(axis=0))
