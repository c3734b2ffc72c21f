"""A planner's answer: a status, a trajectory if it found one, and its effort."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.numerals import is_number, rounded_down
from trajopt.core.trajectory import Trajectory

HISTORY_RTOL = 1e-9  # between a history's last claim and the trajectory's duration


class Status(StrEnum):
    """How a trial ended. Anything but `SOLVED` comes with a message that says why."""

    SOLVED = "solved"
    RELAXED = "relaxed"  # a planner's word: some limits are left out. A trial never says it
    INFEASIBLE = "infeasible"  # proved: no trajectory exists
    FAILED = "failed"  # the solver gave up
    INVALID = "invalid"  # the verifier found what no dilation can mend
    UNSUPPORTED = "unsupported"  # not for this problem; the message says why
    TIMEOUT = "timeout"
    CRASHED = "crashed"
    MISSING = "missing"  # a backend is not installed


@dataclass(frozen=True, eq=False)
class Solution:
    """A planner's answer, before anyone has checked it.

    - `trajectory`: its duration is the planner's *claim*; the verifier certifies another;
    - `lower_bound`: seconds that no trajectory through these waypoints can beat, if that is proved;
    - `evaluations`: how often the planner evaluated its objective, if it counts them;
    - `history` `(m, 2)`: evaluations spent, and the shortest duration claimed by then (NaN before
      the first), s; what the last row claims is `trajectory` (see `history_flaw`);
    - `setup_time`: the part of the wall time spent building what later calls reuse, s;
    - `library_time`: the part of it spent inside the calls of a library that plans, s, if the
      planner wraps one (`trajopt.planners.library_time`);
    - `stats`: other results; values are numbers, strings or arrays.
    """

    status: Status
    trajectory: Trajectory | None = None
    message: str = ""
    lower_bound: float | None = None
    evaluations: int | None = None
    history: Array | None = None
    setup_time: float = 0.0
    library_time: float | None = None
    stats: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        said = [str(self.status)]
        if isinstance(self.trajectory, Trajectory):
            said.append(f"{self.trajectory.duration:.6g} s")
        if self.lower_bound is not None and is_number(self.lower_bound):
            said.append(f"lower bound {rounded_down(self.lower_bound, '.6g')} s")
        said += str(self.message).strip().splitlines()[-1:]
        return f"Solution({', '.join(said)})"

    @property
    def disagreement(self) -> float | None:
        """By how much the second shortest of its starts ends above the shortest, relative.

        0 where two starts agree, infinite where one alone succeeded; None where the planner states
        no starts.
        """
        durations = self.stats.get("start_duration")
        if durations is None:
            return None
        shortest, second, *_ = sorted([*np.ravel(durations), np.inf, np.inf])
        if not np.isfinite(second):
            return float(np.inf)
        return float(second / shortest - 1)

    @property
    def history_flaw(self) -> str:
        """The reason why `history` contradicts the answer; empty if it is consistent or missing.

        Evaluations and claims must be in order, and the last claim must be the trajectory's
        duration.
        """
        if self.history is None or not len(self.history):
            return ""
        if self.history.shape[1:] != (2,):
            return f"it must be (m, 2), got {self.history.shape}"
        spent, claims = self.history.T
        nothing = np.isnan(claims)
        found = claims[~nothing]
        begun = nothing[:-1] | ~nothing[1:]  # once there is a claim there are others
        falls = np.diff(found) <= 0
        counts = np.diff(spent) >= 0
        in_order = begun.all() and falls.all() and counts.all()
        if not in_order:
            return "its evaluations must not fall, nor its durations rise"
        if not found.size:
            return ""
        if self.trajectory is None:
            return "there is no trajectory"
        claimed = self.trajectory.duration
        if abs(found[-1] - claimed) <= HISTORY_RTOL * claimed:
            return ""
        return f"it ends at {found[-1]:.9g} s, but the trajectory takes {claimed:.9g} s"
