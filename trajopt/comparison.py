"""Run planners on problems, keep every trial, and return their results.

    from trajopt import compare

    results = compare(["six-axis"], ["toppra", MyPlanner()], "my-results", jobs=2)
    print(results.summary())

A judge writes each finished trial to a file of its own, so nothing that finished can be lost.
The same call again runs only the trials that are missing. A planner that raises, hangs or ends its
process is a recorded trial, and the run goes on.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from contextlib import closing, contextmanager
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from trajopt.benchmark.best_known import records
from trajopt.benchmark.run import runner
from trajopt.benchmark.run.profile import Profile
from trajopt.benchmark.run.progress import Progress, Report, reporter
from trajopt.benchmark.run.tasks import Allowance, missing, tasks_of
from trajopt.benchmark.store import unfinished
from trajopt.benchmark.store.folder import Seen, Store
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Trial, now
from trajopt.core.exceptions import InvalidInput, PlannerWarning
from trajopt.core.problem import Problem
from trajopt.planners.planner import Planner
from trajopt.views.analysis.gap_reference import best
from trajopt.views.analysis.versions import Kept, last_versions

if TYPE_CHECKING:
    from trajopt.views.results import Results

TIMEOUT = 600.0  # s, of a trial

Contestant = str | Planner | tuple[str, object] | object


@contextmanager
def _kept() -> Iterator[None]:
    """Have an interruption say that what is finished is kept."""
    try:
        yield
    except KeyboardInterrupt as stop:
        stop.add_note("finished trials are kept, run the same command to go on")
        raise


@_kept()
def compare(
    problems: Sequence[Problem | str | Path] | Problem | str | Path,
    planners: Sequence[Contestant] | str | Planner,
    folder: Path | str = "results",
    *,
    seeds: int = 30,
    jobs: int = 1,
    fresh: bool = False,
    timeout: float = TIMEOUT,
    memory: float | None = None,
    progress: Report | bool | None = None,
    executor: Executor | None = None,
    fresh_reference: bool = False,
) -> Results:
    """Run every planner on every problem, keep every trial, return those that were asked for.

    Gaps are to the best known motion of a problem, which is verified anew. For a problem that has
    none, the references that it needs join the planners. Trials already in `folder` are kept unless
    `fresh`: those of the same problem, planner, options, seed and code. Trials that crashed, missed
    a package or hit a smaller limit are run again.

    Args:
        problems: Problems, names of built-in ones, or problem files; one alone needs no list.
        planners: Planners, names (`"toppra:knots=chord"`, `"./my_planner.py:MyPlanner"`), or pairs
            of a name and a planner. Stochastic ones run with seeds 0 … `seeds` − 1 on the problems
            that they support, all others once.
        folder: Where the trials are kept.
        seeds: Number of seeds of each stochastic planner.
        jobs: Number of trials that run side by side. Each runs in a process of its planner and is
            judged in another one. With 0 all run and are judged in this process, without
            supervision, for a debugger.
        fresh: Whether to run trials again that are already there.
        timeout: Seconds after which a trial in a child process is stopped.
        memory: GiB that a trial's process may use (Linux). Its own memory is limited by the system;
            the memory of all its children together is measured ten times a second.
        progress: True for a line on standard error, False for none; by default there is one in a
            terminal and in a notebook. A function is called with a `Progress` at the start and
            after each task.
        fresh_reference: Whether the references join on every problem.
        executor: Runs the trials instead of `jobs`: any of `concurrent.futures`, or a Dask
            client's. Its workers must see `folder`; they isolate and judge as `jobs` does.

    Returns:
        The trials asked for; `kept` counts those that were there before.

    Warns with `PlannerWarning` of a planner that uses its seed without `stochastic = True`, and of
    a history that contradicts its answer.

    Raises:
        InvalidInput: The options of a planner cannot be seen.
        StoreError: The folder cannot be written.
        WorkerError: A judge failed.
    """
    # late: a planner's process imports `compare` where its module does, and needs no tables
    from trajopt.views.results import Results

    if isinstance(problems, str | Path | Problem):
        problems = [problems]
    if isinstance(planners, str | Planner):
        planners = [planners]
    limits = {"timeout": timeout, "memory": memory}
    for name, value in limits.items():
        if jobs == 0 and executor is None and value not in (TIMEOUT, None):
            right = "jobs=1 or more beside it: with jobs=0 trials run in this process, unsupervised"
            raise InvalidInput(name, right, value=value)
    store = Store(Path(folder).absolute())  # planners may change the working folder
    allowed = Allowance.of(jobs, executor, timeout, memory)
    loaded = [catalogue.given(problem) for problem in problems]

    def ask(contestant: Contestant) -> Profile:
        return runner.profiled(contestant, loaded, allowed)

    solved = [] if fresh_reference else _solved(loaded)
    tasks = tasks_of(loaded, [ask(planner) for planner in planners], seeds, ask, solved)
    asked = {trial_id for task in tasks for trial_id in task.ids.values()}
    seen = store.seen(asked)
    stored = seen.trials.values()
    ended = {t.id for t in stored if not t.runs_again or allowed.would_stop(t)}
    done = set() if fresh else asked & ended
    waiting = [batch for task in tasks for batch in missing(task, done)]
    finished = len(done)
    trusted = executor is None and allowed.jobs > 0  # judges of this run, which no planner sees
    report = reporter(progress)
    report(Progress(len(asked), finished, len(done)))
    entrants = {own: task.profile.entrant.label for task in waiting for own in task.ids.values()}
    if waiting:
        unfinished.begin(store.folder, len(asked), entrants)
    with closing(runner.run(waiting, store, allowed, executor)) as run:
        for task, written in run:
            finished += len(task.seeds)
            seen.add(written, trusted=trusted)
            answers = [seen.trials[own] for own in task.ids.values() if own in seen.trials]
            report(Progress(len(asked), finished, len(done), _answer(answers)))
    unfinished.end(store.folder)
    store.restore(seen)
    store.consolidate(seen, best)
    own = [seen.trials[trial_id] for trial_id in sorted(asked & seen.trials.keys())]
    trials = _marked(store, seen, own)
    _warn_of_histories(trials)
    starts = [datetime.fromisoformat(trial.started) for trial in trials if trial.id in done]
    kept = Kept(len(starts), len(trials), min(starts)) if starts else None
    return Results(trials, kept=kept)


def _answer(trials: Sequence[Trial]) -> str:
    """Return a line about one planner's trials on a problem: the median duration, or a status."""
    if not trials:
        return ""
    first = trials[0]
    durations = [trial.certified_duration for trial in trials if trial.certified_duration]
    runs = f", the median of {len(durations)} runs" if len(durations) > 1 else ""
    said = f"{np.median(durations):.4f} s{runs}" if durations else str(first.status)
    return f"{first.label} on {first.problem.name}: {said}"


def _solved(problems: Iterable[Problem]) -> list[str]:
    """Return the problems, by their digests, whose recorded motion keeps every limit."""
    return [own.digest() for own in problems if records.answer(own).trajectory is not None]


def _warn_of_histories(trials: Sequence[Trial]) -> None:
    """Warn of each planner with a history that contradicts its answer."""
    wrong = {trial.label: trial for trial in trials if trial.solution.history_flaw}
    for label, trial in wrong.items():
        message = f"{label}: a history is left out: {trial.solution.history_flaw}"
        warnings.warn(PlannerWarning(message), stacklevel=3)


def _marked(store: Store, seen: Seen, trials: Sequence[Trial]) -> Sequence[Trial]:
    """Mark trials that would be hidden, since the folder holds a later version of their planner.

    The report shows the newest version of each planner: the version asked for last.
    """
    shown = {own.id for own in last_versions(seen.versions)[0]}
    marked = [replace(trial, asked=now()) for trial in trials if trial.id not in shown]
    if not marked:
        return trials
    seen.add(store.write_all(marked), trusted=True)
    store.consolidate(seen, best)
    return [trial for trial in trials if trial.id in shown] + marked
