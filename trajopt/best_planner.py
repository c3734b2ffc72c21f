"""Plan with the best planner for a problem's limits.

answer = trajopt.plan(problem)
answer.certified_duration, answer.certified_trajectory
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol, cast

import numpy as np

from trajopt.benchmark.best_known import records
from trajopt.benchmark.best_known.records import Record
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial, trials_of, verdict
from trajopt.core.exceptions import TrajoptError
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.core.trajectory import Trajectory
from trajopt.explain.references import OPTIMUM_WITH_POSITION, best_planners
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load, named
from trajopt.planners.rest_to_rest import end_to_end_bound, stop_times

QUICK = "along"  # answers in seconds where `OPTIMUM_WITH_POSITION` may take minutes
OPTIMUM_RTOL = 1e-4  # an answer this close to the proved bound, relative, is called the optimum
# Of answers without a motion the lowest one is shown; all other statuses are 1.
_ORDER = {Status.INFEASIBLE: 0, Status.UNSUPPORTED: 2}


@dataclass(frozen=True)
class Best:
    """The answer of the best planner.

    Attributes:
        trial: The planner's trial.
        relaxed: Shortest duration known without the limits that the planner ignores, s.
        proved: Lower bound, proved in closed form, in the record, or by `prove` here, s.
        stopping: Duration of the motion that stops at every waypoint, s; None where it may break a
            limit.
        record: The best known answer of the problem, or None.
        left_out: Kinds of limits that the planner does not know, by their keys.
        stopped: After how many seconds a planner of all limits was stopped; None if none was.
    """

    trial: Trial
    relaxed: float | None
    proved: float
    stopping: float | None
    record: Record | None = None
    left_out: tuple[str, ...] = ()
    stopped: float | None = None

    def as_dict(self) -> dict[str, float | None]:
        """Return the entries for JSON, beside the trial's; s."""
        return {
            "relaxed_duration": self.relaxed,
            "recorded_duration": self.record.duration if self.record else None,
            "proved_bound": self.proved,
            "stopping_duration": self.stopping,
        }


def best(
    problem: Problem,
    seed: int,
    proof_time: float = 0.0,
    tell: Callable[[str], None] = lambda step: None,
    timeout: float = np.inf,
) -> Best:
    """Run the best planners in turn, until an answer keeps all limits.

    The first planners ignore limits that they do not know. If their answer keeps these limits too,
    no faster motion is known. If not, the other planners run, and the shortest certified answer is
    returned. It is dilated if it breaks a limit that no planner knows.

    Under limits that depend on position that may take minutes. Where a best known motion of such a
    problem is recorded, it is the answer, verified now. Under limits of several joints together,
    torques say, a path is timed first (`QUICK`): seconds after `timeout` its motion is the answer.

    Args:
        problem: What is planned.
        seed: Of the random stream.
        proof_time: s of CPU time for a lower bound, where neither a closed form nor the record
            proves the answer within `OPTIMUM_RTOL`.
        tell: Called with each step, in words, when it begins.
        timeout: Wall time, s, of the planner that may take minutes.
    """
    relaxed: float | None = None
    trials: list[Trial] = []
    left_out: list[tuple[str, ...]] = []
    reasons = []
    record = records.find(problem)
    names = best_planners(problem)
    others = problem.limits.others.values()
    known = _known(problem, record) if OPTIMUM_WITH_POSITION in names else None
    if known is not None:
        trials, left_out, names = [known], [()], []
    for name in names:
        try:
            own_name, planner = named(name)
        except TrajoptError as error:
            reasons.append(str(error))
            continue
        if name == OPTIMUM_WITH_POSITION and not all(own.separate for own in others):
            tell(f"{QUICK} times a path")
            quick = trials_of(load(QUICK), problem, [seed], QUICK)[0]
            trials.append(quick)
            left_out.append(())
            first = quick.certified_duration
            known_s = f"{QUICK} takes {first:.4g} s; " if first else ""
            tell(f"{known_s}{own_name} looks for less, which may take minutes")
            trial = _within(timeout, planner, own_name, problem, seed)
        else:
            tell(f"{own_name} plans")
            trial = trials_of(planner, problem, [seed], own_name)[0]
        trials.append(trial)
        left_out.append(tuple(planner.unknown(problem)))
        ignores = bool(left_out[-1])
        if relaxed is None:
            relaxed = trial.claimed_duration if ignores and not trial.feasible else None
        infeasible = trial.status is Status.INFEASIBLE
        if infeasible or (trial.certified_duration and (trial.feasible or not ignores)):
            break
    if not trials:
        raise TrajoptError(f"no planner can be asked: {'; '.join(reasons)}")
    durations = [own.certified_duration or np.inf for own in trials]
    # without a motion: a proof that there is none, else the first failure, else the first refusal
    order = [_ORDER.get(own.status, 1) for own in trials]
    chosen = min(range(len(trials)), key=lambda own: (durations[own], order[own], own))
    proved = end_to_end_bound(problem)
    if record is not None:
        proved = max(proved, record.lower_bound)
    if proof_time and known is None and proved * (1 + OPTIMUM_RTOL) < durations[chosen] < np.inf:
        tell("a lower bound is proved")
        proved = max(proved, _proof(trials[chosen], proof_time))
    return Best(
        trial=trials[chosen],
        relaxed=relaxed,
        proved=proved,
        stopping=_stopping(problem),
        record=record,
        left_out=left_out[chosen],
        stopped=timeout if any(own.status is Status.TIMEOUT for own in trials) else None,
    )


def _within(timeout: float, planner: Planner, name: str, problem: Problem, seed: int) -> Trial:
    """Return a planner's trial, stopped after some seconds: in a process of its own."""
    if timeout == np.inf:
        return trials_of(planner, problem, [seed], name)[0]
    from trajopt.benchmark.run.runner import Supervised  # late: needs cloudpickle

    with closing(Supervised((name, planner), problem, timeout=timeout)) as supervised:
        return supervised.trials(problem, [seed])[0]


def _known(problem: Problem, record: Record | None) -> Trial | None:
    """Return the trial of the recorded motion, judged now; None unless it keeps every limit."""
    if record is None:
        return None
    began = time.perf_counter()
    status, message, certificate = verdict(problem, record.trial.solution)
    if certificate is None or not certificate.feasible:
        return None
    return replace(
        record.trial,
        problem=problem,
        status=status,
        message=message,
        certificate=certificate,
        solve_time=time.perf_counter() - began,
    )


class Prover(Protocol):
    """A planner that proves lower bounds."""

    def beside(self, problem: Problem, motion: Trajectory) -> float:
        """Return a lower bound, s, with a motion that keeps every limit as the target."""
        ...


def _proof(answer: Trial, seconds: float) -> float:
    """Return a proved lower bound, s; 0 where `prove` cannot run or leaves limits out."""
    motion = answer.certified_trajectory
    if motion is None:
        return 0.0
    try:
        prover = cast(Prover, load(f"prove:time_limit={seconds}"))
        return prover.beside(answer.problem, motion)
    except TrajoptError:
        return 0.0


def _stopping(problem: Problem) -> float | None:
    """Return the time of stopping at every waypoint, s; None where that may break a demand."""
    demand = problem.route.demand
    if problem.limits.others or not problem.route.dilatable:
        return None
    times = np.maximum(stop_times(problem), demand("least_times"))
    return max(float(times.sum() + demand("dwell").sum()), float(demand("least_duration")))


def plan(problem: Problem | str | Path, planner: object = None, *, seed: int = 0) -> Trial:
    """Plan a motion, by default with the best planner for the limits, and verify it.

    Args:
        problem: Or the name of a built-in one, or a problem file.
        planner: A planner, a registered one by its name (`"toppra:knots=chord"`), or None for the
            one that `trajopt plan` chooses: the first reference whose answer keeps all limits.
        seed: Of the random stream.

    Returns:
        The judged answer. Its `certified_trajectory` keeps every limit and takes
        `certified_duration` seconds; both are None if the planner failed, and `message` says why.

    Raises:
        InvalidInput: The problem file or the planner's options cannot be used.
        UnknownName: There is no problem or planner of this name.
        WrongType: The problem is something else.
    """
    asked = catalogue.given(problem)
    if planner is None:
        return best(asked, seed).trial
    from trajopt.benchmark.run.runner import Supervised  # late: needs cloudpickle

    with closing(Supervised(planner, asked)) as chosen:
        return chosen.trials(asked, [seed])[0]
