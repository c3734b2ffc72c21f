"""`trajopt explain`: split a planner's gap into its parts, in words."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt.benchmark.best_known import records
from trajopt.benchmark.run.processes import cpus
from trajopt.benchmark.run.runner import Supervised
from trajopt.benchmark.trial import Trial
from trajopt.cli import asked, console
from trajopt.cli.asked import NO_FLAGS, RobotFlags
from trajopt.cli.parameters import Json, PlannerSpec, ProblemName, Seed, Timeout, Writing
from trajopt.cli.plan import print_trial
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.core.trajectory import Trajectory
from trajopt.explain import decomposition
from trajopt.explain.active_limits import ActiveLimit, holds, share_at_limits
from trajopt.explain.decomposition import Explanation
from trajopt.judgement import without_jerk
from trajopt.judging.verification import verify
from trajopt.views.figures import draw

RUNS = 30  # seeds of a stochastic planner; the median run is explained
# Limits of the best timing of a path: how many are named, of those at which it is for this share.
_NAMED, _MENTIONED = 3, 0.01
MIN_SAVING_RTOL = 1e-5  # relative to the duration; limits that save less are not mentioned


def explain(
    problem: ProblemName,
    *,
    planner: PlannerSpec,
    robot: RobotFlags = NO_FLAGS,
    seed: Annotated[
        Seed | None,
        Parameter(help=f"Seed of a stochastic planner; by default its median run of {RUNS}."),
    ] = None,
    output: Writing[Path] = Path("results/explain"),
    timeout: Timeout = 600.0,
    json: Json = False,
) -> int:
    """Say what a planner's gap is made of, and which limits hold it back.

    Args:
        output: Folder for the figures.
    """
    asked_for = asked.problem(problem, robot, scaled=True)
    with closing(Supervised(planner, asked_for, cpus(), timeout)) as chosen:
        return _explain(chosen, asked_for, problem, seed, output, json)


def _explain(
    chosen: Supervised,
    asked_for: Problem,
    problem: str,
    seed: int | None,
    output: Path,
    json: bool,
) -> int:
    with console.waiting("running the planner"):
        trial = explained_run(chosen, asked_for, seed)
    names = {"problem": trial.problem.name, "planner": trial.label, "seed": trial.seed}
    if trial.certified_trajectory is None:
        lifted = _without_jerk(trial, chosen, seed)
        if json:
            told = {"status": trial.status, "message": trial.message}
            console.print_json(names | told | {"without_jerk": lifted and lifted.as_dict()})
            return 1
        print_trial(trial, problem)
        if lifted is not None:
            console.paragraph("Without the jerk limits:")
            relaxed = without_jerk(trial.problem) or trial.problem
            for sentence in sentences(trial.label, relaxed, lifted):
                console.paragraph(f"- {sentence}")
        return 1
    with console.waiting("asking the references"):
        recorded = records.answer(trial.problem)
        found = decomposition.explain(trial.problem, chosen, trial.certified_trajectory, recorded)
        figures = draw.explain(trial, found, output)
    if json:
        console.print_json(names | found.as_dict() | {"figures": figures})
        return 0
    for sentence in _sentences(trial, found, median=seed is None and chosen.stochastic):
        console.paragraph(f"- {sentence}")
    pictures = ", ".join(figure.name for figure in figures if figure.suffix == ".png")
    console.line(f"figures: {pictures} in {figures[0].parent}")
    return 0


def _without_jerk(trial: Trial, planner: Supervised, seed: int | None) -> Explanation | None:
    """Explain the motion without jerk limits, where these alone refuse it, or its planner."""
    lifted = without_jerk(trial.problem)
    if lifted is None:
        return None
    if trial.status is Status.UNSUPPORTED:
        with console.waiting("running the planner without jerk limits"):
            trial = explained_run(planner, lifted, seed)
    trajectory = trial.solution.trajectory
    if trajectory is None or not verify(lifted, trajectory).valid:
        return None
    with console.waiting("asking the references"):
        return decomposition.explain(lifted, planner, trajectory, records.answer(lifted))


def explained_run(planner: Supervised, problem: Problem, seed: int | None) -> Trial:
    """Return the run with this seed; by default the median of a stochastic planner's runs.

    Of two runs in the middle the shorter is returned. Runs without an answer count as the longest.
    """
    seeds = [seed or 0]
    if seed is None and planner.stochastic:
        seeds = list(range(RUNS))
    trials = planner.trials(problem, seeds)
    trials.sort(key=lambda trial: trial.certified_duration or math.inf)
    return trials[(len(trials) - 1) // 2]


def _sentences(trial: Trial, found: Explanation, *, median: bool) -> Iterator[str]:
    run = ""
    if trial.solution.history is not None:
        run = f" (seed {trial.seed})"
    if median:
        run = f" (seed {trial.seed}, the median of {RUNS})"
    return sentences(f"{trial.label}{run}", trial.problem, found)


def sentences(
    subject: str, problem: Problem, found: Explanation, *, slowed: bool = False
) -> Iterator[str]:
    """Explain the gap of a motion in a few sentences.

    Args:
        subject: The motion's name.
        problem: What it was planned for.
        found: The parts of its gap.
        slowed: Whether the motion breaks limits, so that it is explained slowed down to them.
    """
    slower = "slowed down to the limits it " * slowed
    what = f"{subject}: {slower}" if slowed else f"{subject} "
    what += f"takes {found.certified_duration:.4f} s on {problem.name}"
    if found.exact is None or found.gap is None:
        yield f"{what}; no optimum to compare with: {found.notes['gap']}."
    else:
        known = f"{found.exact:.4f} s"
        if found.recorded:
            known += f" (recorded: {found.recorded})"
        yield f"{what}, {1 + found.gap:.3f} times the best known optimum, {known}."
    steps = found.steps()
    yield from _path_and_timing(problem, found, dict(steps.get("path and timing", ())))
    if "the 3-5-3 family" in steps:
        yield _family(found, dict(steps["the 3-5-3 family"]))
    yield _share_at_limits(problem, found)
    yield _active_limits(problem, found)


def _path_and_timing(problem: Problem, found: Explanation, step: dict[str, float]) -> Iterator[str]:
    if found.retimed is None:
        why = found.notes.get("timing_gap") or found.notes.get("route_gap")
        yield f"Its timing and its path cannot be told apart: {why}."
        return
    costs = f"its timing costs {_percent(found.timing_gap)}"
    if step:
        costs += f", its path {_percent(found.route_gap)}"
    yield f"The best timing of its own path takes {found.retimed.duration:.4f} s: {costs}."
    yield from held_along(problem, found.retimed, found.notes.get("timing", ""))


def held_along(problem: Problem, motion: Trajectory, stops: str) -> Iterator[str]:
    """Name the limits that hold the best timing of a path back, and say where it has to stop."""
    found = [own for own in holds(problem, motion) if own.share > _MENTIONED][:_NAMED]
    if found:
        said = []
        for longest, share in found:
            whose = KINDS[longest.limit].name()
            if longest.joint is not None:
                whose += f" of {problem.joint_labels[longest.joint]}"
            at = f"longest {longest.start:.2f}–{longest.end:.2f} s"
            said.append(f"{whose} ({100 * share:.0f} % of its time, {at})")
        yield f"That timing is held back by {', '.join(said)}."
    if stops:
        yield f"{stops[:1].upper()}{stops[1:]}."


def _family(found: Explanation, step: dict[str, float]) -> str:
    optimiser = _percent(found.optimiser_gap)
    shape = _percent(found.shape_gap)
    smoothness = _percent(found.smoothness_gap)
    return (
        f"The best 3-5-3 takes {step['shape']:.4f} s: its optimiser costs {optimiser}, "
        f"the 3-5-3 shape {shape}, its smoothness {smoothness}."
    )


def _percent(gap: float | None) -> str:
    return "–" if gap is None else f"{100 * gap:z.2f} %"


def _share_at_limits(problem: Problem, found: Explanation) -> str:
    own = 100 * share_at_limits(problem, found.trajectory)
    sentence = f"Some joint is at a limit for {own:.0f} % of its time"
    if found.optimum is None:
        return f"{sentence}."
    best = 100 * share_at_limits(problem, found.optimum)
    return f"{sentence}; in the optimum, for {best:.0f} %."


def _active_limits(problem: Problem, found: Explanation) -> str:
    """Name the three limits that cost most time, each with its longest interval."""
    if not found.active_limits:
        return "No limit holds it back: none is used to 99 %."
    if all(interval.saving is None for interval in found.active_limits):
        return "It reaches limits; what a higher one would save is not known."
    least = MIN_SAVING_RTOL * found.certified_duration
    longest = _longest(found.active_limits)
    costly = [interval for interval in longest if _saving(interval) > least]
    if not costly:
        return "It reaches limits, but a higher one alone would save no time."
    costly.sort(key=_saving, reverse=True)
    held = ", ".join(_said(problem, interval) for interval in costly[:3])
    return f"Held back by {held}. In brackets: time saved if this limit were 1 % higher."


def _longest(intervals: Iterable[ActiveLimit]) -> list[ActiveLimit]:
    """Return the longest interval of each limit of each joint."""
    longest: dict[tuple[int | None, str, int | None], ActiveLimit] = {}
    for interval in sorted(intervals, key=lambda own: own.start - own.end):
        longest.setdefault((interval.joint, interval.limit, interval.segment), interval)
    return list(longest.values())


def _saving(interval: ActiveLimit) -> float:
    """Return the time that a limit 1 % higher would save, s."""
    return interval.saving or 0.0


def _said(problem: Problem, interval: ActiveLimit) -> str:
    where = KINDS[interval.limit].name()
    if interval.joint is not None:
        where += f" of {problem.joint_labels[interval.joint]}"
    if interval.segment is not None:
        where += f" in segment {interval.segment + 1}"
    when = f"{interval.start:.2f}–{interval.end:.2f} s"
    milliseconds = 1000 * _saving(interval)
    return f"{where} at {when} ({milliseconds:.1f} ms)"
