"""The resumable comparison: problem × planner × seed, each trial kept.

    from trajopt import compare

    results = compare(["six-axis"], ["toppra", MyPlanner()], "my-results", jobs=2)
    print(results.summary())

A judge writes each finished trial to a file of its own, so nothing that finished can be lost;
running again does only what is missing. A planner that raises, hangs or takes its process
down is a recorded trial, and the run goes on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from datetime import datetime
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from trajopt.benchmark.run.plan import OWN_PROCESS, Allowance, Task, missing, plan
from trajopt.benchmark.run.pool import Pool
from trajopt.benchmark.store.folder import Seen, Store, read
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Configuration, Trial, now
from trajopt.core.problem import Problem
from trajopt.planners.planner import Planner
from trajopt.planners.registry import named
from trajopt.views.analysis.summary import Kept
from trajopt.views.analysis.versions import newest

if TYPE_CHECKING:
    from trajopt.benchmark.run.runner import Finished
    from trajopt.views.analysis.results import Results

Contestant = str | Planner | tuple[str, object] | object


@dataclass(frozen=True)
class Progress:
    """How many of the trials there are already, and how many of those an earlier run had left."""

    total: int
    finished: int
    kept: int


class Comparison(NamedTuple):
    """The trials asked for, and how many of them were there before."""

    trials: Sequence[Trial]
    kept: Kept | None


def compare(
    problems: Sequence[Problem | str | Path],
    planners: Sequence[Contestant],
    folder: Path | str = "results",
    *,
    seeds: int = 30,
    jobs: int = 0,
    fresh: bool = False,
    timeout: float = 600.0,
    memory: float | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
    executor: Executor | None = None,
) -> Results:
    """Run every planner on every problem, keep every trial, return those that were asked for.

    The references that a problem needs join the planners, since gaps need those. Trials already in
    `folder` are kept unless `fresh`: those of the same problem, planner, options, seed and code.
    Those that crashed, lacked a backend, or were stopped for time or memory that they may exceed
    now, run again.

    Args:
        problems: Problems, names of built-in ones, or problem files.
        planners: Planners, registered ones by their names (`"toppra:knots=chord"`), or pairs of a
            name and a planner. Stochastic ones run with seeds 0 … `seeds` − 1 on the problems that
            they support, all others once.
        folder: Where the trials are kept.
        seeds: How many.
        jobs: How many trials run side by side, each in a process of its planner's own, judged in
            another; with 0 they run in this process, unsupervised.
        fresh: Whether to run again what is there.
        timeout: Seconds after which a trial in a child process is stopped.
        memory: GiB that a trial's child process may have (Linux): at once what is its own, and,
            looked at ten times a second, what it and its children share too.
        progress: Called with the state of the run at its start and after each task.
        executor: Runs the trials instead of `jobs`: any of `concurrent.futures`, or a Dask
            client's. Its workers must see `folder`; they isolate and judge as `jobs` does.

    Returns:
        The trials asked for; `kept` says how many of them were there before, and since when.

    Raises:
        InvalidInput: for a planner whose options cannot be seen.
        StoreError: if the folder cannot be written.
        WorkerError: if a judge fails.
    """
    with Pool(jobs) as pool:
        ran = run(
            problems,
            planners,
            folder,
            pool,
            seeds=seeds,
            fresh=fresh,
            timeout=timeout,
            memory=memory,
            progress=progress,
            executor=executor,
        )
    # pandas: not for workers, who import this module too
    from trajopt.views.analysis.results import Results

    return Results(ran.trials, ran.kept)


def run(
    problems: Sequence[Problem | str | Path],
    planners: Sequence[Contestant],
    folder: Path | str,
    pool: Pool,
    *,
    seeds: int = 30,
    fresh: bool = False,
    timeout: float = 600.0,
    memory: float | None = None,
    progress: Callable[[Progress], None] = lambda _: None,
    executor: Executor | None = None,
) -> Comparison:
    """`compare`, which says what the arguments are, without its tables: pandas takes long.

    The pool's processes run the trials.
    """
    store = Store(Path(folder).absolute())  # whatever becomes of the working folder
    here = executor is None and pool.jobs == 0
    side_by_side = pool.jobs if executor is None else 0
    allowed = Allowance()
    if not here:
        allowed = Allowance(timeout, memory, side_by_side, _isolation(executor))
    loaded = [p if isinstance(p, Problem) else catalogue.load(str(p)) for p in problems]
    tasks = plan(loaded, [_configuration(planner) for planner in planners], seeds)
    asked = {trial_id for task in tasks for trial_id in task.ids.values()}
    done = set() if fresh else asked & _done(store, allowed)
    waiting = [batch for task in tasks for batch in missing(task, done)]
    finished = len(done)
    progress(Progress(len(asked), finished, len(done)))
    before = store.stamps() if waiting else {}
    seen = Seen()
    for task, written in _run(waiting, store, allowed, pool, executor):
        finished += len(task.seeds)
        progress(Progress(len(asked), finished, len(done)))
        seen.add(written)
    found = None if waiting else store.current(asked)
    if found is None:
        store.restore(before, seen)
        found = _consolidated(store, asked, seen)
    trials = _shown(store, found)
    starts = [datetime.fromisoformat(trial.started) for trial in trials if trial.id in done]
    kept = Kept(len(starts), len(trials), min(starts)) if starts else None
    return Comparison(trials, kept)


def _shown(store: Store, trials: Sequence[Trial]) -> Sequence[Trial]:
    """The trials, marked where the folder holds a later version of their planner's."""
    last: dict[str, str] = {}
    for trial in trials:
        when = trial.asked or trial.started
        last[trial.label] = max(when, last.get(trial.label, ""))
    later = set()
    for trial_id, label, started, asked in store.columns("id", "label", "started", "asked"):
        when = asked or started
        if when > last.get(label, when):  # as text: UTC, ISO 8601
            later.add(trial_id)
    if not later:
        return trials
    everything = [*trials, *read(store.results, later)]
    shown = {trial.id for trial in newest(everything).trials}
    marked = [replace(trial, asked=now()) for trial in trials if trial.id not in shown]
    if not marked:
        return trials
    store.write_all(marked)
    store.consolidate()
    return [trial for trial in trials if trial.id in shown] + marked


def _isolation(executor: Executor | None) -> str:
    """How a trial is kept apart from the run, as its provenance says it."""
    if executor is None:
        return OWN_PROCESS
    return f"{OWN_PROCESS}; on a worker of {type(executor).__name__}"


def _consolidated(store: Store, asked: set[str], seen: Seen) -> list[Trial]:
    """The trials asked for, all trials being in `results.h5` now, by their identities."""
    file = store.consolidate(seen)
    trials = [trial for trial_id, trial in seen.trials.items() if trial_id in asked]
    others = asked - seen.trials.keys()
    if others:
        trials += read(file, others)
    return sorted(trials, key=lambda trial: trial.id)


def _configuration(planner: Contestant) -> Configuration:
    if isinstance(planner, str):
        name, loaded = named(planner)
        return Configuration.of(loaded, name)
    if isinstance(planner, tuple):
        name, own = planner
        return Configuration.of(own, name)
    return Configuration.of(planner)


def _done(store: Store, allowed: Allowance) -> set[str]:
    """Identities of the trials that would end no better if they ran again."""
    stopped = {trial.id for trial in store.unanswered() if allowed.would_stop(trial)}
    return store.finished() | stopped


def _run(
    tasks: Sequence[Task],
    store: Store,
    allowed: Allowance,
    pool: Pool,
    executor: Executor | None,
) -> Iterator[Finished]:
    if not tasks:
        return iter(())
    # judges: not where nothing is to run
    from trajopt.benchmark.run import runner

    if executor is not None:
        return runner.on_executor(tasks, store, allowed, executor)
    if pool.jobs == 0:
        return runner.here(tasks, store, allowed)
    return runner.in_children(tasks, store, allowed, pool)
