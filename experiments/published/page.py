"""The text of docs/literature.md, from what was judged: `literature.md.jinja` and its numbers."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping, Sequence

import jinja2
import pandas as pd

from experiments.published.judged import JudgedProblem, optimised, table
from experiments.published.smooth353 import times_the_least
from trajopt.benchmark.suites.literature import Published
from trajopt.explain.verdicts import MEANINGS, Verdict
from trajopt.views import table_cells

# Relative: a best known motion that is no faster than stopping.
_SAME_RTOL = 1e-4
_SLIP = " (one source, probably a slip of a unit in print: read otherwise, all are above)"
# Columns of the tables, and their headings.
_SUMMARY = {
    "problem": "problem",
    "method": "method",
    "published s": "published, s",
    "best known s": "best known, s",
    "lower bound s": "lower bound, s",
    "stopping s": "stopping, s",
    "above best %": "above best known",
    "above stopping %": "above stopping",
    "verdict": "verdict",
}
_CLAIMS = {
    "method": "method",
    "objective": "optimised",
    "table": "where",
    "published s": "published, s",
    "above best %": "above best known",
    "above stopping %": "above stopping",
    "above its family %": "above best of its family",
    "above equal jerk %": "above best at its own peak jerk",
    "verdict": "verdict",
}


def page(problems: Sequence[JudgedProblem], beyond: Sequence[Published], folder: str) -> str:
    """The whole page.

    Args:
        problems: those that can be stated, judged.
        beyond: those that cannot.
        folder: of the figure, as the page names it.
    """
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("experiments.published", ""),
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        undefined=jinja2.StrictUndefined,
    )
    claimed = [problem for problem in problems if problem.judgements]
    impossible = [problem for problem in claimed if Verdict.IMPOSSIBLE in _verdicts([problem])]
    return environment.get_template("literature.md.jinja").render(
        problems=problems,
        claimed=claimed,
        beyond=beyond,
        folder=folder,
        numbers=numbers(problems),
        sources=_sources(claimed),
        verdicts=_verdicts(claimed),
        meanings=MEANINGS,
        slip=_SLIP if _sources(impossible) == 1 else "",
        table=_markdown,
        summary=_SUMMARY,
        claims=_CLAIMS,
        times_the_least=times_the_least,
        **_beside_stopping(claimed),
    )


def numbers(problems: Sequence[JudgedProblem]) -> int:
    """Count the published numbers; one that several problems of a source share counts once."""
    most: Counter[tuple[str, float]] = Counter()
    for problem in problems:
        own = [(_source(problem), claim.duration) for claim in problem.published.claims]
        most |= Counter(own)
    return most.total()


def _sources(problems: Sequence[JudgedProblem]) -> int:
    """Count the publications; one without a DOI is known by its authors and year."""
    return len({_source(problem) for problem in problems})


def _source(problem: JudgedProblem) -> str:
    own = problem.published
    until_year = re.match(r".*?\d{4}", own.source)
    return own.doi or (until_year[0] if until_year else own.source)


def _verdicts(problems: Sequence[JudgedProblem]) -> list[Verdict]:
    return [judgement.verdict for problem in problems for judgement in problem.judgements]


def _beside_stopping(problems: Sequence[JudgedProblem]) -> dict[str, int]:
    """Count the published times above the best known that are longer than stopping everywhere.

    `slower` are all of them, and of `optimal` stopping is the best known motion. `searched` are
    times that something was optimised for where stopping is not, of which `lost` are longer.
    """
    counts = dict.fromkeys(("lost", "searched", "slower", "optimal"), 0)
    for problem in problems:
        known = problem.known
        stopping_is_best = known.best is not None and (
            known.stopping <= known.best * (1 + _SAME_RTOL)
        )
        for judgement in problem.judgements:
            if judgement.verdict is not Verdict.ABOVE:
                continue
            longer = judgement.over_stopping > 0
            counts["slower"] += longer
            if stopping_is_best:
                counts["optimal"] += longer
            elif known.problem.segments > 1 and optimised(problem.published, judgement):
                counts["searched"] += 1
                counts["lost"] += longer
    return counts


def _markdown(problems: list[JudgedProblem], columns: Mapping[str, str]) -> str:
    """The verdicts on these problems' claims; ratios that none of them has are left out."""
    rows = table(problems)
    ratios = [name for name in columns if name.endswith("%")]
    shown = [name for name in columns if name not in ratios or rows[name].notna().any()]
    for name in ratios:
        rows[name] = [_percent(value) for value in rows[name]]
    named = rows[shown].rename(columns=columns)
    text: str = named.to_markdown(index=False, floatfmt=".6g", missingval="")
    return text


def _percent(value: float) -> str:
    """A ratio minus 1; NaN is an empty cell."""
    if pd.isna(value):
        return ""
    return table_cells.percent(value / 100)
