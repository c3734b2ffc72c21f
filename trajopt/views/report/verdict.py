"""The first part of a report: a sentence, and for one problem durations and motions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from io import StringIO
from math import isfinite, isnan
from typing import Any

from trajopt.benchmark.best_known.records import CLOSED_WITHIN
from trajopt.benchmark.trial import Trial
from trajopt.explain.references import PROVERS, REFERENCES
from trajopt.views import table_cells
from trajopt.views.analysis.results import Line, Tables
from trajopt.views.analysis.shortfalls import listed, sentences, users
from trajopt.views.figures import draw
from trajopt.views.figures.draw import LOOKED_FOR
from trajopt.views.figures.style import SPOKEN

NAMED = 4  # planners that a sentence compares at most, besides a user's own


def of_problem(results: Tables) -> str:
    """Return how far planners are above the optimum: "toppra 8.3 %, issa 190.9 % (median)".

    What is missing, has failed or is slowed down comes first.
    """
    return " ".join([*_caveats(results), _above_optimum(results)])


def _above_optimum(results: Tables) -> str:
    lines = results.lines()
    answered = [line for line in lines if _competes(line.label) and isfinite(line.gap)]
    first = lines[0]
    if first.kind is None:
        return "No optimum is known for this problem, so gaps are unknown."
    known = f"{first.reference:.4f} s"
    optimum = f"the best known {known}, not proved"
    if first.reference < first.proved * (1 + CLOSED_WITHIN):
        optimum = f"the proved {known}"
    if not answered:
        return f"No other planner has an answer; the optimum is {optimum.removeprefix('the ')}."
    named = _named([line.label for line in answered], users(results))
    said = [_above(line) for line in answered if line.label in named]
    return f"{', '.join(said)} above {optimum}{_more(len(answered) - len(said))}."


def of_suite(results: Tables) -> str:
    """Return what is missing or has failed, then median gaps on the problems that all answer."""
    return " ".join([*_caveats(results), *_compared(results)])


def _compared(results: Tables) -> Iterator[str]:
    """Yield the sentences that compare planners on the same problems."""
    found = results.common()
    if found.gaps.empty:
        yield "No optimum is known for these problems, so gaps are unknown."
        return
    labels = [str(label) for label in found.gaps.index]
    named = _named(labels, users(results))
    said = [
        f"{_spoken(own)} {table_cells.percent(found.gaps[own])}" for own in labels if own in named
    ]
    count = len(found.problems)
    on = f"On the {count} problems" if count > 1 else "On the one problem"
    who = "all of these answer" if len(labels) > 1 else "it answers"
    more = _more(len(labels) - len(said))
    yield f"{on} that {who}, the median gap to the optimum is: {', '.join(said)}{more}."
    few = [f"{_spoken(own)} ({found.answered[own]} of {found.every})" for own in found.left_out]
    if few:
        yield f"Not compared, with too few answers: {listed(few)}."


def _caveats(results: Tables) -> Iterator[str]:
    """Yield what comes first: what a stopped run misses, who failed, and who is slowed down."""
    if results.stopped:
        yield str(results.stopped)
    yield from sentences(results, _spoken)


def _named(labels: Sequence[str], own: Collection[str]) -> set[str]:
    """Choose the planners that a sentence names, of some in order of their gaps.

    A user's own planners are named, then those that are looked for, then the best.
    """
    first = [label for label in labels if label in own]
    wanted = [label for label in labels if _name(label) in LOOKED_FOR]
    most = max(NAMED, len(first))
    return set(list(dict.fromkeys([*first, *wanted, *labels]))[:most])


def _more(count: int) -> str:
    return f", and {count} more below" if count > 0 else ""


def _competes(label: str) -> bool:
    """Return whether a planner is compared with the optimum, and is no reference itself."""
    return _name(label) not in {*REFERENCES, *PROVERS}


def _name(label: str) -> str:
    """Return the planner's name, without its options."""
    return label.partition(":")[0]


def _above(line: Line) -> str:
    percent = table_cells.percent(line.gap).removeprefix("+")
    return f"{_spoken(line.label)} {percent}{' (median)' if line.runs > 1 else ''}"


def _spoken(label: str) -> str:
    """Return a planner's name in a sentence, its options in brackets."""
    name, _, options = label.partition(":")
    spoken = SPOKEN.get(name, name).removesuffix(" + 3-5-3")
    return f"{spoken} ({options})" if options else spoken


def durations(results: Tables, labels: Sequence[str]) -> list[dict[str, Any]]:
    """Return a line per planner of one problem: its duration, and where its bar ends, %."""
    lines = sorted(results.lines(), key=lambda line: (isnan(line.median), line.median))
    finite = [line.max for line in lines if isfinite(line.max)]
    longest = max(finite, default=1.0)
    found = []
    for line in lines:
        own = table_cells.of_summary(line)
        width = line.median / longest if isfinite(line.median) else 0.0
        within = (end / line.median if width else 0.0 for end in (line.min, line.max))
        low, high = (round(100 * share, 2) for share in within)
        found.append(
            {
                "planner": labels.index(line.label),
                "label": line.label,
                "width": round(100 * width, 2),
                "low": low,
                "high": high if line.runs > 1 else low,
                "median": own["median"],
                "gap": own["gap"],
                "runs": line.runs,
            }
        )
    return found


def overlaid(trials: Sequence[Trial]) -> str:
    """Return the motions of a few planners on one time axis, as SVG; empty without two."""
    from trajopt.views.figures import plots

    figure = draw.overlaid(trials)
    if figure is None:
        return ""
    content = StringIO()
    plots.save_svg(figure, content)
    text = content.getvalue()
    return text[text.index("<svg") :]
