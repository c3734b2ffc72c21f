"""The exact minimum time with velocity, acceleration and jerk limits (mathematics, section 4).

No discretisation. For one joint over one segment of time `T`, between two states (velocity,
acceleration), the displacements that the limits allow fill an interval `[D_lo, D_up]`, whose ends
are the profiles of `exact.jerk_profiles`, in closed form with their derivatives. So segment times
and the waypoints' states are the only variables of a small program, which an interior-point method
made for it solves (`exact.interior_point`). Jerk enters by its inverse: an unlimited one is 0, and
the profiles are then those of section 3.

    from baselines.exact.jerk import ExactJerk
    solution = ExactJerk().solve(problem)
    print(solution.trajectory.duration)
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Literal

import numpy as np

from baselines.exact import one_sided_jerk
from baselines.exact.acceleration import Exact
from baselines.exact.cells import Cells, Rows
from baselines.exact.interior_point import begun, chosen, converged, descended, near
from baselines.exact.jerk_cells import Cells as JerkCells
from baselines.exact.jerk_cells import Rows as JerkRows
from baselines.exact.jerk_cells import Start
from baselines.exact.scaled import Scaled
from baselines.exact.several_starts import Optimum, SeveralStarts
from baselines.sizes import announce, cells
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution
from trajopt.planners.planner import passing_once

# Times `starts`: how many are tried where all have failed so far.
MAX_STARTS_FACTOR = 3
# Dilations of starts: stopping at every waypoint, the most where times are random, and of the
# optimum without jerk limits.
STOPPING_DILATION = 1.05
MAX_START_DILATION = 2.0
RELAXED_DILATION = 1.1
RELAXED_GAP = 1e-2  # relative to the duration of the optimum without jerk limits
ACCEPTED = 100.0  # times the tolerances, if rounding stops the method
# Time of a start, proportional to segments times moving joints. It includes failing starts.
SECONDS = 0.03
SECONDS_PER_CELL = 2e-3


@dataclass(frozen=True)
class ExactJerk(SeveralStarts):
    """Exact minimum time under velocity, acceleration and jerk limits (several starts).

    Jerk limits may be stiff (1e5 times those of acceleration: section 3's optimum but for 1e-4) or
    soft (once), on some joints only, and all limits asymmetric; joints may rest. It starts from
    `starts` points: the answer is the best known, not proved. `solver` is its own interior-point
    method, or IPOPT on a program of other variables: an independent check.

    A jerk limit on one side only is unsupported. Acceleration could then jump the other way, and
    the optimum wants that. But where jerk is limited at all acceleration has to be continuous:
    steeper and steeper ramps approach the optimum, and none reaches it.

    Ruckig, segment by segment from the answer's waypoint states divided by `1 + 1e-6`, returns its
    segment times, except on segments so tiny that this shift leaves the interval they can reach.
    """

    starts: int = 4
    solver: Literal["interior-point", "ipopt"] = "interior-point"

    knows = ("velocity", "acceleration", "jerk")

    def unsupported(self, problem: Problem) -> str | None:
        return one_sided_jerk.unsupported(problem)

    @passing_once
    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The best of several local optima. `stats`: each start's status and duration (s).

        Where no joint that moves has a jerk limit, section 3's program is the same problem.
        """
        if not problem.limits.jerk_limited[problem.moving].any():
            return Exact(self.starts, self.agreeing, self.solver).solve(problem)
        # late: planners that are only listed need none of it
        from baselines.exact.jerk_motion import Reachable

        announce("exact-jerk", problem, self._seconds(problem))
        scaled = Reachable(problem)
        solve: Callable[[Sequence[Start]], list[Optimum]] = partial(_minimised, scaled)
        if self.solver == "ipopt":
            from baselines.exact.jerk_by_ipopt import minimised

            solve = partial(minimised, scaled)
        starts = islice(_starts(scaled), MAX_STARTS_FACTOR * self.starts)
        return self.best_of(scaled, solve, starts)

    def _seconds(self, problem: Problem) -> float:
        """About how long it will take."""
        expected_starts = min(self.starts, self.agreeing)
        return expected_starts * (SECONDS + SECONDS_PER_CELL * cells(problem))


def _starts(scaled: Scaled) -> Iterator[Start]:
    """Times and inner waypoint states to start from.

    Stopping everywhere first, then section 3's optimum, slower, then stopping everywhere in random
    times: what stops at every waypoint is within reach.
    """
    segments, joints = scaled.h.shape
    rng = np.random.default_rng(0)
    at_rest = np.zeros((segments - 1, joints))
    yield STOPPING_DILATION * scaled.stop, at_rest, at_rest
    # near section 3's optimum
    cells = Cells(scaled, 1)
    with np.errstate(all="ignore"):
        start = cells.start(scaled.stop[None], at_rest[None])
        relaxed = descended(
            begun(Rows(cells, start)), partial(near, gap_rtol=RELAXED_GAP)
        ).state.rows
    velocity = np.clip(relaxed.point.velocity[0], *scaled.v)
    if np.isfinite(velocity).all():
        yield RELAXED_DILATION * relaxed.times[0], velocity / RELAXED_DILATION, at_rest
    while True:
        slower = rng.uniform(STOPPING_DILATION, MAX_START_DILATION, segments)
        yield slower * scaled.stop, at_rest, at_rest


def _minimised(scaled: Scaled, starts: Sequence[Start]) -> list[Optimum]:
    """The local optimum near each start."""
    cells = JerkCells(scaled, kinds=2)
    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        point = cells.start(*map(np.array, zip(*starts, strict=True)))
        iterate = descended(begun(JerkRows(cells, point)), converged)
        done = converged(iterate, ACCEPTED)
    points = iterate.state.rows.point
    numbers = np.arange(len(starts))
    optima = []
    for k, times in enumerate(iterate.state.rows.times):
        optimum = Optimum(times.sum(), times, chosen(points, numbers == k), "Converged")
        if not done[k]:
            optimum = optimum._replace(duration=np.inf, status="Not_Converged")
        optima.append(optimum)
    return optima
