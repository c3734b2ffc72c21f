"""Fill the registry of best known answers: the references first, then proofs of what is open.

    python -m experiments.best_known                         # all suites, about 40 CPU minutes
    python -m experiments.best_known six-axis --seconds 60   # one suite, longer proofs

Every trial is kept in `--output`, so that running again goes on where it stopped; what is better
than the record of `--registry` takes its place, stage by stage:

1. `exact` and `ruckig-stop` everywhere: where the answer of `exact` keeps every limit, it is the
   optimum as far as anyone knows;
2. elsewhere `exact-jerk` and `ruckig-search` under jerk limits, `collocation-refined` under
   position limits;
3. linear programs prove what they can in `--seconds` about every problem whose gap is open.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import cyclopts

from baselines.lower_bound.branching import prove
from trajopt.benchmark.best_known import proposal, records
from trajopt.benchmark.best_known.proposal import Candidate
from trajopt.benchmark.best_known.record import CLOSED_WITHIN
from trajopt.benchmark.run import runner
from trajopt.benchmark.run.plan import Allowance, Task, missing
from trajopt.benchmark.store.folder import Store
from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import Configuration
from trajopt.cli import console
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.explain.references import (
    OPTIMUM,
    OPTIMUM_WITH_JERK,
    OPTIMUM_WITH_POSITION,
    PROOF,
    THROUGH_WAYPOINTS,
)
from trajopt.planners.planner import Planner
from trajopt.planners.registry import named

SUITES = ("six-axis", "edges", "literature", "robots", "random")
STOPPING = "ruckig-stop"
PROOF_TRIAL = "proof"
# A proof asks for half of what counts as closed, and the other half is room.
ASKED_GAP = CLOSED_WITHIN / 2


@dataclass(frozen=True)
class Proof(Planner):
    """The linear programs' lower bound, asked for up to what is known; no trajectory.

    Args:
        known: Duration of the best known motion, s.
        seconds: Of wall time.
    """

    known: float
    seconds: float

    knows = ("velocity", "acceleration", "jerk", "position")

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        """The bound as `lower_bound`, s; its proof among `stats`."""
        merged, _ = problem.merged()
        target = self.known / (1 + ASKED_GAP)
        deadline = time.perf_counter() + self.seconds
        found = prove(merged, target, ASKED_GAP, deadline)
        message = f"no trajectory is faster than {found.lower_bound:.9g} s"
        return Solution(
            Status.INVALID,
            message=message,
            lower_bound=found.lower_bound,
            stats=found.proof.arrays(),
        )


@dataclass(frozen=True)
class Filling:
    """Folders of trials and records, and the limits of a trial."""

    store: Store
    registry: Path
    timeout: float
    jobs: int

    def run(self, stage: str, tasks: Sequence[Task]) -> None:
        """Run what no earlier run has finished, and record what is better."""
        allowed = Allowance.of(self.jobs, None, self.timeout, None)
        stopped = {t.id for t in self.store.unanswered() if allowed.would_stop(t)}
        done = self.store.finished() | stopped
        waiting = [batch for task in tasks for batch in missing(task, done)]
        with console.progress(len(waiting), stage) as advance:
            for finished in runner.run(waiting, self.store, allowed):
                advance(len(finished.task.seeds))
        if not tasks:
            return
        trials = proposal.of_trials(self.store.consolidate())
        candidates = [_by_registered_planner(candidate) for candidate in trials]
        improved = 0
        for outcome in proposal.outcomes(candidates, self.registry):
            if outcome.after is not None:
                proposal.write(outcome.after, self.registry)
                improved += 1
        console.line(f"{stage}: {len(tasks)} trials, {improved} records written")

    def unanswered(self, problems: Sequence[Problem]) -> Iterator[Problem]:
        """Problems whose best motion is not from `exact` and is not proved optimal."""
        for problem in problems:
            record = records.find(problem, self.registry)
            if record is None or (record.motion.method != OPTIMUM and not record.closed):
                yield problem

    def proofs(self, problems: Sequence[Problem], seconds: float) -> Iterator[Task]:
        """One for each motion that is not proved to be the optimum, the smallest first."""
        for problem in sorted(problems, key=_size):
            record = records.find(problem, self.registry)
            if record is not None and not record.closed:
                proof = Proof(record.duration, seconds)
                yield Task(problem, Configuration.of(proof, PROOF_TRIAL), (0,))


def main(
    *suites: str,
    seconds: float = 10.0,
    timeout: float = 60.0,
    jobs: int = 1,
    output: Path = Path("results/best-known"),
    registry: Path | None = None,
) -> None:
    """Fill the registry with what the references and the proofs find."""
    chosen = suites or SUITES
    problems = [problem for suite in chosen for problem in catalogue.problems(suite)]
    where = registry or records.folder_to_write()
    where.mkdir(parents=True, exist_ok=True)
    filling = Filling(Store(output), where, timeout, jobs)

    filling.run("exact", list(_tasks(problems, OPTIMUM, STOPPING)))
    jerky = [problem for problem in filling.unanswered(problems) if problem.has("jerk")]
    filling.run("jerk", list(_tasks(jerky, OPTIMUM_WITH_JERK, THROUGH_WAYPOINTS)))
    walled = [problem for problem in filling.unanswered(problems) if problem.has("position")]
    filling.run("position", list(_tasks(walled, OPTIMUM_WITH_POSITION)))

    filling.run("proofs", list(filling.proofs(problems, seconds)))


def _by_registered_planner(candidate: Candidate) -> Candidate:
    """A proof is checked, and could be found, by the registered planner of proofs."""
    name, _, _ = candidate.origin.method.partition(":")
    if name != PROOF_TRIAL:
        return candidate
    own = replace(candidate.origin, method=PROOF, version=version("mintime"))
    return replace(candidate, origin=own)


def _tasks(problems: Sequence[Problem], *planners: str) -> Iterator[Task]:
    """Every planner on every problem, the smallest problems first."""
    for spec in planners:
        name, planner = named(spec)
        configuration = Configuration.of(planner, name)
        for problem in sorted(problems, key=_size):
            yield Task(problem, configuration, (0,))


def _size(problem: Problem) -> int:
    return problem.segments * problem.joints


if __name__ == "__main__":
    cyclopts.run(main)
