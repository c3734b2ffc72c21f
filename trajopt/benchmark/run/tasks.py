"""Plan tasks: which planner runs on which problem with which seeds, within which limits."""

from __future__ import annotations

import socket
import warnings
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property

from trajopt.benchmark.run.profile import Profile
from trajopt.benchmark.trial import OUT_OF_MEMORY, Entrant, Trial
from trajopt.core.exceptions import InvalidInput, PlannerWarning
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.explain.references import references
from trajopt.planners.registry import entries

HAS_JUDGES = hasattr(socket, "send_fds")  # on Unix
IN_PROCESS = "nothing: all in one process"
OWN_PROCESS = "a process of the planner's own, judged in another"

MAX_BATCH_SEEDS = 30  # solved together: enough to be fast, and few to lose when a process dies
# Problems solved together: enough to be fast, few to begin again, and so small, in segments times
# joints, that they take seconds.
MAX_TOGETHER = 100
MAX_CELLS_TOGETHER = 4000


@dataclass(frozen=True)
class Allowance:
    """Limits of a trial, and where it runs.

    Attributes:
        timeout: Wall time, s.
        memory: GiB for its process; None for no limit.
        jobs: Number of trials that run side by side in processes of this machine.
        isolation: Where it runs, in the report's words.
        echo: Whether what its planner prints goes to standard error.
    """

    timeout: float = float("inf")
    memory: float | None = None
    jobs: int = 0
    isolation: str = IN_PROCESS
    echo: bool = False

    @classmethod
    def of(
        cls, jobs: int, executor: Executor | None, timeout: float, memory: float | None
    ) -> Allowance:
        """Return the limits under these arguments of `trajopt.compare`.

        A trial in the run's own process has no limits.
        """
        if executor is not None:
            isolation = f"{OWN_PROCESS}; on a worker of {type(executor).__name__}"
            return cls(timeout, memory, isolation=isolation)
        if jobs > 0 and HAS_JUDGES:
            return cls(timeout, memory, jobs, OWN_PROCESS)
        return cls()

    def as_dict(self) -> dict[str, str]:
        """Return the limits as a trial's provenance has them."""
        memory = "" if self.memory is None else f"{self.memory:g}"
        jobs = str(self.jobs) if self.jobs else ""
        return {
            "timeout_limit": f"{self.timeout:g}",
            "memory_limit": memory,
            "jobs": jobs,
            "isolation": self.isolation,
        }

    def would_stop(self, trial: Trial) -> bool:
        """Tell if a trial hit a limit of time or memory that is as tight in this allowance.

        A trial that crashed for another reason may succeed when it runs again.
        """
        if trial.status is Status.TIMEOUT:
            had = trial.provenance.get("timeout_limit", "")
            return bool(had) and self.timeout <= float(had)
        if trial.status is Status.CRASHED and trial.message == OUT_OF_MEMORY:
            had = trial.provenance.get("memory_limit", "")
            return bool(had) and self.memory is not None and self.memory <= float(had)
        return False


@dataclass(frozen=True)
class Task:
    """Some seeds of one planner on one problem."""

    problem: Problem
    profile: Profile
    seeds: tuple[int, ...]

    @cached_property
    def ids(self) -> dict[int, str]:
        """Return the trials' identities by their seeds."""
        entrant = self.profile.entrant
        return {seed: entrant.trial_id(self.problem, seed) for seed in self.seeds}


Asking = Callable[[str], Profile]


def tasks_of(
    problems: Sequence[Problem],
    profiles: Sequence[Profile],
    seeds: int,
    ask: Asking,
    solved: Collection[str] = (),
) -> list[Task]:
    """Return a task per problem and planner with all its seeds; identical tasks once.

    The references that a problem needs join the planners: `ask` describes them. Problems that are
    `solved`, by their digests, need none. `PlannerWarning` warns of a planner that uses its seed,
    but does not say whether it is stochastic.

    Raises:
        InvalidInput: Two different planners have the same label.
    """
    _check_labels([profile.entrant for profile in profiles])
    for profile in profiles:
        if seeds > 1 and profile.may_be_stochastic:
            label = profile.entrant.label
            message = f"{label} runs once: set `stochastic = True` if the seed matters, else False"
            warnings.warn(PlannerWarning(message), stacklevel=3)
    given = {profile.entrant.name for profile in profiles}
    joining: dict[str, Profile] = {}
    tasks: dict[str, Task] = {}
    for problem in problems:
        also = []
        for name in () if problem.digest() in solved else references(problem):
            if name in given or name not in entries():
                continue
            if name not in joining:
                joining[name] = ask(name)
            also.append(joining[name])
        for profile in [*profiles, *also]:
            runs = seeds if profile.varies(problem) else 1
            task = Task(problem, profile, tuple(range(runs)))
            tasks.setdefault(task.ids[0], task)
    return list(tasks.values())


def _check_labels(entrants: Sequence[Entrant]) -> None:
    """Refuse two planners of one label: tables and figures know planners by their labels."""
    known: dict[str, Entrant] = {}
    for entrant in entrants:
        if known.setdefault(entrant.label, entrant) != entrant:
            right = "a name of its own for each planner, as in (name, planner)"
            raise InvalidInput("planners", right, value=entrant.label)


def missing(task: Task, done: set[str]) -> Iterator[Task]:
    """Yield tasks of the unfinished seeds, several in a task if the planner solves batches."""
    seeds = [seed for seed in task.seeds if task.ids[seed] not in done]
    size = MAX_BATCH_SEEDS if task.profile.batched else 1
    for start in range(0, len(seeds), size):
        batch = seeds[start : start + size]
        yield replace(task, seeds=tuple(batch))


def together(tasks: Sequence[Task], jobs: int) -> list[list[Task]]:
    """Return the tasks in groups: those of one planner and one shape that it solves together.

    Args:
        tasks: In the order in which they run.
        jobs: How many groups run side by side: none is so large that others have none.
    """
    groups: dict[object, list[list[Task]]] = {}
    alike = Counter(_alike(task) for task in tasks)
    for task in tasks:
        key = _alike(task)
        if key is None:
            groups.setdefault(id(task), []).append([task])
            continue
        cells = max(1, task.problem.segments * task.problem.joints)
        most = min(MAX_TOGETHER, MAX_CELLS_TOGETHER // cells, -(-alike[key] // max(jobs, 1)))
        own = groups.setdefault(key, [])
        if not own or len(own[-1]) >= most:
            own.append([])
        own[-1].append(task)
    return [group for own in groups.values() for group in own]


def _alike(task: Task) -> object:
    """Return what tasks of one group have in common; None for one that runs alone."""
    if not task.profile.takes_many or len(task.seeds) > 1:
        return None
    return id(task.profile), task.problem.waypoints.shape
