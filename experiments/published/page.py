"""The text of docs/literature.md, from what was judged."""

from __future__ import annotations

from collections import Counter

import pandas as pd

from experiments.published.judged import Judged, optimised, table
from trajopt.benchmark.suites.literature import Published
from trajopt.explain.verdicts import MEANINGS, Known, Verdict
from trajopt.views import table_cells

COMMAND = "python -m experiments.literature --output docs"

# Relative: a best known motion that is no faster than stopping.
_SAME_RTOL = 1e-4

_HEAD = """\
# The literature on trial

Published running times for stated waypoints and limits, each beside the shortest motion known for
the same numbers, a proved lower bound, and the plan any user has: stopping at every waypoint.
Written by `{command}`; each section's command reproduces its verdicts.

How to read it:

- **A time above the best known is no error.** Most sources minimise something else as well (jerk,
  energy, a weighted sum), or keep to one family of curves, and say so. What is compared here is
  the time alone, under the limits that the source states.
- **The judge is the same for all.** The best known motion is verified exactly; a claim, which comes
  without its motion, can only be compared with it (docs/mathematics.md, section 11). A printed
  digit is rounded in the claim's favour.
- **The digits are second-hand.** They were read from copies, from a picture, or by machine, as each
  section says. Nobody has yet held them against the publisher's page, so a verdict here is about
  the numbers as read. A mistake is a bug of ours: please report it.
- **What a source leaves open** is said, and where it can be read in two ways, each reading is a
  problem of its own.
"""

_ANSWER = """\
## If it is your work

A published time is half of an answer; the motion is the other half. Send it, and the table shows
what the verifier certifies in place of the printed number:

1. Write the motion as a file: samples of every joint over time as CSV or as a JointTrajectory
   message, or its polynomials as JSON.
2. `trajopt judge your-motion.csv NAME` judges it against the problem as it is stated here:
   waypoints, limits and rest at both ends, from polynomial roots. What joins the samples is part of
   the question (`--interpolation`), and so is by how much a waypoint may be missed
   (`--via-tolerance`).
3. Open an issue with the file. If a number, a unit or a reading is wrong, the problem's file in
   `data/literature` is the place to mend it, and its `checked` says who compared it with the
   publisher's page.

The same file can be given to every planner here: `trajopt compare NAME`.
"""


def page(
    problems: list[Judged],
    beyond: list[Published],
    folder: str,
) -> str:
    """The whole page.

    Args:
        problems: those that can be stated, judged.
        beyond: those that cannot.
        folder: of the figure, as the page names it.
    """
    parts = [_HEAD.format(command=COMMAND), _summary(problems, folder)]
    claimed = [problem for problem in problems if problem.judgements]
    silent = [problem for problem in problems if not problem.judgements]
    parts.append("## Problem by problem\n")
    parts += [_section(problem) for problem in claimed]
    parts.append("## Without a published time\n")
    parts += [_section(problem) for problem in silent]
    parts.append(_beyond(beyond))
    parts.append(_ANSWER)
    return "\n".join(parts)


def _summary(problems: list[Judged], folder: str) -> str:
    judgements = [own for problem in problems for own in problem.judgements]
    counts = Counter(own.verdict for own in judgements)
    lines = [
        "## All of them\n",
        f"![Every published time over the best known]({folder}/all.png)\n",
        f"{numbers(problems)} published numbers (of {_sources(problems)} sources), read "
        f"second-hand; {len(judgements)} verdicts on {_claimed(problems)} problems, since a number "
        "that can be read in several ways is judged in each:\n",
    ]
    for verdict, meaning in MEANINGS.items():
        if counts[verdict]:
            whose = _whose(verdict, problems)
            lines.append(f"- **{counts[verdict]} {verdict}**: {meaning}{whose};")
    lines.append(_beside_stopping(problems))
    rows = table(problems)
    columns = {
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
    shown = rows[list(columns)].rename(columns=columns)
    for ratio in ("above best known", "above stopping"):
        shown[ratio] = [_percent(value) for value in shown[ratio]]
    lines.append(_markdown(shown))
    lines.append("")
    return "\n".join(lines)


def numbers(problems: list[Judged]) -> int:
    """Count the published numbers; one that several problems of a source share counts once."""
    most: Counter[tuple[str, float]] = Counter()
    for problem in problems:
        own = [(problem.published.doi, claim.duration) for claim in problem.published.claims]
        most |= Counter(own)
    return most.total()


def _sources(problems: list[Judged]) -> int:
    return len({problem.published.doi for problem in problems if problem.judgements})


def _whose(verdict: Verdict, problems: list[Judged]) -> str:
    """That what is impossible is one source's, where it is: probably a slip in what is printed."""
    if verdict is not Verdict.IMPOSSIBLE:
        return ""
    sources = set()
    for problem in problems:
        if any(own.verdict is verdict for own in problem.judgements):
            sources.add(problem.published.doi)
    if len(sources) > 1:
        return ""
    return " (one source, probably a slip of a unit in print: read otherwise, all are above)"


def _beside_stopping(problems: list[Judged]) -> str:
    """Count the published times that are longer than stopping at every waypoint."""
    searched = []
    slower = []
    optimal = []
    for problem in problems:
        known = problem.known
        above = [own for own in problem.judgements if own.verdict is Verdict.ABOVE]
        longer = [own for own in above if own.over_stopping > 0]
        slower += longer
        if known.best is not None and known.stopping <= known.best * (1 + _SAME_RTOL):
            optimal += longer
        elif known.problem.segments > 1:
            searched += [own for own in above if optimised(problem.published, own)]
    lost = sum(judgement.over_stopping > 0 for judgement in searched)
    return (
        f"- {lost} of the {len(searched)} times above the best known that were optimised, for time "
        "or for anything else, are longer than stopping at every waypoint, where a motion that "
        f"does not stop is faster. (All {len(slower)} longer ones are no measure: for "
        f"{len(optimal)} of them stopping is the best known motion.)\n"
    )


def _claimed(problems: list[Judged]) -> int:
    return sum(bool(problem.judgements) for problem in problems)


def _percent(value: float | None) -> str:
    if value is None or pd.isna(value):
        return ""
    if abs(value) < 5e-3:
        return "0.00 %"
    return table_cells.percent(value / 100)


def _markdown(rows: pd.DataFrame) -> str:
    text: str = rows.to_markdown(index=False, floatfmt=".6g", missingval="")
    return text


def _section(problem: Judged) -> str:
    lines = [f"### {problem.name}\n", *_facts(problem.published), *_known(problem.known), ""]
    if problem.judgements:
        lines += [_claims(problem), "", f"`{problem.command}` says so.\n"]
    return "\n".join(lines)


def _facts(published: Published) -> list[str]:
    """A line per fact of the source that there is."""
    source = published.source
    if published.doi:
        source += f", [doi:{published.doi}](https://doi.org/{published.doi})"
    facts = {
        "source": source,
        "method": published.family,
        "optimised": published.objective,
        "read here": published.reading,
        "unsaid, or not read": "; ".join(published.unsaid),
        "note": published.note,
        "digits": f"read {published.transcription}; {published.checked}",
    }
    return [f"- {name}: {text}" for name, text in facts.items() if text]


def _known(known: Known) -> list[str]:
    """Describe the best known motion and bound of a problem in one line."""
    bound = f"no motion is faster than {known.lower_bound:.6g} s ({known.bound_by})"
    stopping = f"stopping at every waypoint takes {known.stopping:.6g} s"
    if known.best is None:
        return [f"- here: no certified motion; {bound}; {stopping}"]
    word = "optimum, proved" if known.proved else "best known, not proved"
    best = f"{known.best:.6g} s ({word}; {known.best_by})"
    families = [f"best {name} {best:.6g} s" for name, best in known.best_of_family.items()]
    return [f"- here: {'; '.join([best, bound, stopping, *families])}"]


def _claims(problem: Judged) -> str:
    rows = table([problem])
    names = {
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
    ratios = [name for name in names if name.endswith("%")]
    empty = [name for name in ratios if rows[name].isna().all()]
    for name in ratios:
        rows[name] = [_percent(value) for value in rows[name]]
    shown = [name for name in names if name not in empty]
    return _markdown(rows[shown].rename(columns=names))


def _beyond(beyond: list[Published]) -> str:
    lines = [
        "## What cannot be stated here yet\n",
        "Their numbers wait in `data/literature/beyond`:\n",
    ]
    for published in beyond:
        lines.append(f"- **{published.name}**: {published.source}: {published.beyond}.")
    lines.append("")
    return "\n".join(lines)
