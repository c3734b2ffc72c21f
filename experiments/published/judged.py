"""A published problem with what is known of it and every claim judged."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd

from trajopt.benchmark.best_known.surveyed import with_record
from trajopt.benchmark.provenance import provenance
from trajopt.benchmark.suites import literature
from trajopt.benchmark.suites.literature import Published
from trajopt.explain.verdicts import JudgedClaim, Known, judge_claim, survey


@dataclass(frozen=True, eq=False)
class JudgedProblem:
    """A published problem that can be stated here.

    Attributes:
        published: what the source says, and how it is read.
        known: by what its claims are judged.
        judgements: one per claim.
    """

    published: Published
    known: Known
    judgements: tuple[JudgedClaim, ...]

    @property
    def name(self) -> str:
        return self.published.name

    @property
    def command(self) -> str:
        """Return the command that reproduces every verdict."""
        return f"trajopt claims {self.name}"


def judged(name: str, time_limit: float) -> JudgedProblem:
    """Survey a published problem and judge its claims."""
    published = literature.published(name)
    assert published.problem is not None
    computed = survey(published.problem, published.families, time_limit=time_limit)
    known = with_record(computed)
    judgements = [judge_claim(claim, known) for claim in published.claims]
    return JudgedProblem(published, known, tuple(judgements))


def optimised(published: Published, judgement: JudgedClaim) -> bool:
    """Return whether the source optimised anything to get this time."""
    objective = judgement.claim.objective or published.objective
    return objective != "none"


def table(problems: list[JudgedProblem]) -> pd.DataFrame:
    """One row per claim: durations in seconds, ratios minus 1 in %, and the command."""
    rows = []
    for problem in problems:
        for judgement in problem.judgements:
            rows.append(_row(problem, judgement))
    return pd.DataFrame(rows)


def known(problems: list[JudgedProblem]) -> pd.DataFrame:
    """One row per problem: what is known of it, s, and the code that found it."""
    rows = []
    for problem in problems:
        found = problem.known
        row = {
            "problem": problem.name,
            "best known s": found.best,
            "best by": found.best_by,
            "lower bound s": found.lower_bound,
            "bound by": found.bound_by,
            "stopping s": found.stopping,
            "commit": provenance()["commit"],
        }
        rows.append(row)
    return pd.DataFrame(rows)


def _row(problem: JudgedProblem, judgement: JudgedClaim) -> dict[str, Any]:
    claim = judgement.claim
    known = problem.known
    return {
        "problem": problem.name,
        "method": claim.method,
        "objective": claim.objective or problem.published.objective,
        "published s": claim.duration,
        "verdict": str(judgement.verdict),
        "best known s": known.best,
        "best by": known.best_by,
        "lower bound s": known.lower_bound,
        "bound by": known.bound_by,
        "stopping s": known.stopping,
        "above best %": _percent(judgement.excess),
        "above stopping %": _percent(judgement.over_stopping),
        "above its family %": _percent(judgement.over_family),
        "above equal jerk %": _percent(judgement.over_equal_jerk),
        "table": claim.table,
        "command": problem.command,
    }


def _percent(excess: float | None) -> float | None:
    if excess is None:
        return None
    return 100 * excess
