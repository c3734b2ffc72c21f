"""The problems that all compared planners answer: only on these do medians compare like with like.

found = common(results.gaps(), ["toppra", "mine"])
found.gaps                # median gap of each, over the same problems
found.problems            # these, by their digests
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from trajopt.views.analysis import statistics
from trajopt.views.analysis.overview import measured
from trajopt.views.analysis.pairwise import medians

# A planner that answers a smaller share of the problems is not compared with the others.
LEAST_SHARE = 0.5


@dataclass(frozen=True, eq=False)
class Common:
    """Planners that are compared, and the problems that they are compared on.

    Attributes:
        gaps: Median over the problems of the median gaps of each compared planner, a ratio minus 1,
            the smallest first.
        problems: Those that all of these planners answer, by their digests.
        answered: The number of problems that each planner answers, of all that were asked for.
        every: The number of problems with a known optimum.
    """

    gaps: pd.Series[float]
    problems: Sequence[str]
    answered: pd.Series[int]
    every: int

    @property
    def left_out(self) -> list[str]:
        """Return the planners that are not compared."""
        return [str(label) for label in self.answered.index if label not in self.gaps.index]


def common(gaps: pd.DataFrame, labels: Sequence[str]) -> Common:
    """Choose the planners that can be compared, and the problems that all of them answer.

    A planner is compared if it answers at least `LEAST_SHARE` of the problems with a known optimum.
    Where no problem is left that all of these answer, the one with the fewest answers is left out.

    Args:
        gaps: Of `Results.gaps()`.
        labels: The planners, by their names with options.
    """
    known = measured(gaps)
    durations = medians(known).reindex(columns=list(labels))
    has_answer = durations.map(np.isfinite)
    answered = has_answer.sum().astype(int)
    enough = answered[answered >= LEAST_SHARE * len(durations)]
    chosen = (enough if len(enough) else answered)[lambda counts: counts > 0]
    chosen = chosen.sort_values(ascending=False, kind="stable")
    while len(chosen) > 1 and not has_answer[chosen.index].all(axis=1).any():
        chosen = chosen.iloc[:-1]
    on_all = has_answer[chosen.index].all(axis=1)
    problems = [str(digest) for digest in on_all.index[on_all]] if len(chosen) else []
    own = known[known["digest"].isin(problems) & known["label"].isin(chosen.index)]
    by_problem = own["gap"].fillna(np.inf).groupby([own["label"], own["digest"]]).median()
    found = by_problem.groupby(level="label").apply(lambda values: statistics.median(values))
    return Common(
        found.astype(float).sort_values(kind="stable"), problems, answered, len(durations)
    )
