"""What there is to run: tasks, of which those that an earlier run has finished are left out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

from trajopt.benchmark.trial import OUT_OF_MEMORY, Configuration, Entrant, Trial
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.core.solution import Status
from trajopt.explain.references import references
from trajopt.planners.registry import entries

IN_PROCESS = "nothing: all in one process"
OWN_PROCESS = "a process of the planner's own, judged in another"

_BATCH = 30  # seeds solved together at most: large enough to be fast, small enough to lose little


@dataclass(frozen=True)
class Allowance:
    """What a trial may use.

    Args:
        timeout: Seconds of wall time.
        memory: GiB for its process; None: any.
        jobs: How many trials may run side by side; 0: not known.
        isolation: Where it runs, as the report says it.
    """

    timeout: float = float("inf")
    memory: float | None = None
    jobs: int = 0
    isolation: str = IN_PROCESS

    def as_dict(self) -> dict[str, str]:
        """As a trial's provenance has it."""
        memory = "" if self.memory is None else f"{self.memory:g}"
        jobs = str(self.jobs) if self.jobs else ""
        return {
            "timeout_limit": f"{self.timeout:g}",
            "memory_limit": memory,
            "jobs": jobs,
            "isolation": self.isolation,
        }

    def would_stop(self, trial: Trial) -> bool:
        """Whether a trial that ran out of time or memory has no more of it now.

        Any other crash may have had a cause that is gone, so that nothing speaks for the same end.
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
    configuration: Configuration
    seeds: tuple[int, ...]

    @cached_property
    def ids(self) -> dict[int, str]:
        """The trials' identities by their seeds."""
        entrant = self.configuration.entrant
        return {seed: entrant.trial_id(self.problem, seed) for seed in self.seeds}


def plan(
    problems: Sequence[Problem],
    configurations: Sequence[Configuration],
    seeds: int,
) -> list[Task]:
    """One task per problem and planner with all its seeds, references too; identical ones once.

    Raises:
        InvalidInput: Two planners have one name with the same options shown, and differ.
    """
    _check_labels([configuration.entrant for configuration in configurations])
    given = {configuration.entrant.name for configuration in configurations}
    joining: dict[str, Configuration] = {}
    tasks: dict[str, Task] = {}
    for problem in problems:
        also = []
        for name in references(problem):
            if name in given or name not in entries():
                continue
            if name not in joining:
                joining[name] = Configuration.of(entries()[name].load(), name)
            also.append(joining[name])
        for configuration in [*configurations, *also]:
            runs = seeds if _varies(configuration, problem) else 1
            task = Task(problem, configuration, tuple(range(runs)))
            tasks.setdefault(task.ids[0], task)
    return list(tasks.values())


def _check_labels(entrants: Sequence[Entrant]) -> None:
    """Tables and figures know planners by their labels."""
    known: dict[str, Entrant] = {}
    for entrant in entrants:
        if known.setdefault(entrant.label, entrant) != entrant:
            right = "a name of its own for each planner, as in (name, planner)"
            raise InvalidInput("planners", right, value=entrant.label)


def _varies(configuration: Configuration, problem: Problem) -> bool:
    """Whether another seed may give another answer; a refusal needs no second trial."""
    planner = configuration.planner
    try:
        return planner.stochastic and planner.unsupported(problem) is None
    except Exception:  # its trials will say so
        return True


def missing(task: Task, done: set[str]) -> Iterator[Task]:
    """The task's unfinished seeds, in batches for planners that advance them together."""
    seeds = [seed for seed in task.seeds if task.ids[seed] not in done]
    size = _BATCH if task.configuration.planner.batched else 1
    for start in range(0, len(seeds), size):
        batch = seeds[start : start + size]
        yield replace(task, seeds=tuple(batch))
