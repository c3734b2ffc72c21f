"""`trajopt claims`: published times, each judged by what is known of its problem."""

from __future__ import annotations

from typing import Annotated, Any

from cyclopts import Parameter

from trajopt.benchmark.best_known.surveyed import with_record
from trajopt.benchmark.suites import literature
from trajopt.benchmark.suites.literature import Published
from trajopt.cli import console
from trajopt.cli.parameters import MAX_SECONDS, Json, number
from trajopt.core.exceptions import InvalidInput
from trajopt.explain.claims import MEANINGS, JudgedClaim, Known, Verdict, judge, survey
from trajopt.views.figures import style

_ZERO = 5e-5  # a ratio minus 1 that would be shown as 0.00 %
_PROBLEM = "Published problem, or a problem file with claims; without it, they are listed."


def claims(
    problem: Annotated[str | None, Parameter(help=_PROBLEM)] = None,
    *,
    time_limit: Annotated[
        float, number("Seconds for the proof of a lower bound.", above=0, most=MAX_SECONDS)
    ] = 20.0,
    json: Json = False,
) -> int:
    """Judge the times that were published for a problem; list the problems if none is named."""
    if problem is None:
        return _list(json=json)
    published = literature.published(problem)
    if published.problem is None:
        right = f"a problem that can be stated here, but {published.beyond}"
        raise InvalidInput("problem", right, value=published.name)
    with console.waiting("asking the references"):
        computed = survey(published.problem, published.families, time_limit=time_limit)
        known = with_record(computed)
        judgements = [judge(claim, known) for claim in published.claims]
    if json:
        console.print_json(as_dict(published, known, judgements))
    else:
        _print(published, known, judgements)
    return 0


def _list(*, json: bool) -> int:
    """Every published problem that can be stated, with how many times were published for it."""
    rows = []
    for name in literature.files():
        published = literature.published(name)
        rows.append({"name": name, "claims": len(published.claims), "source": published.source})
    if json:
        console.print_json({"problems": rows})
        return 0
    table = console.table("problem", "claims", "source", numbers=("claims",))
    for row in rows:
        name = console.markup(row["name"])
        table.add_row(f"[bold]{name}[/bold]", str(row["claims"]), console.markup(row["source"]))
    console.OUT.print(table)
    console.paragraph("Judge the times of one: trajopt claims PROBLEM")
    return 0


def as_dict(published: Published, known: Known, judgements: list[JudgedClaim]) -> dict[str, Any]:
    """For JSON: seconds, and ratios minus 1."""
    return {
        "problem": published.name,
        "source": published.source,
        "doi": published.doi,
        "objective": published.objective,
        "reading": published.reading,
        "unsaid": list(published.unsaid),
        "transcription": published.transcription,
        "checked": published.checked,
        "best": known.best,
        "best_by": known.best_by,
        "lower_bound": known.lower_bound,
        "bound_by": known.bound_by,
        "stopping": known.stopping,
        "best_of_family": dict(known.best_of_family),
        "claims": [_row(judgement) for judgement in judgements],
    }


def _row(judgement: JudgedClaim) -> dict[str, Any]:
    claim = judgement.claim
    return {
        "method": claim.method,
        "duration": claim.duration,
        "rounding": claim.rounding,
        "table": claim.table,
        "objective": claim.objective,
        "verdict": str(judgement.verdict),
        "excess": judgement.excess,
        "over_stopping": judgement.over_stopping,
        "over_family": judgement.over_family,
        "over_equal_jerk": judgement.over_equal_jerk,
    }


def _print(published: Published, known: Known, judgements: list[JudgedClaim]) -> None:
    name = console.markup(published.name)
    source = console.markup(published.source)
    console.OUT.print(f"[bold]{name}[/bold]: {source}")
    facts = {
        "reading": published.reading,
        "optimised": published.objective,
        "unsaid": "; ".join(published.unsaid),
        "digits": f"{published.transcription}; {published.checked}",
    }
    for name, text in facts.items():
        if text:
            console.paragraph(f"  {name}: {text}")
    for sentence in _known(known):
        console.paragraph(f"  {sentence}")
    if not judgements:
        console.paragraph("No time was published, or none was read.")
        return
    console.OUT.print(_table(judgements))
    found = {own.verdict for own in judgements}
    for verdict, meaning in MEANINGS.items():
        if verdict in found:
            console.paragraph(f"{verdict}: {meaning}")


def _known(known: Known) -> list[str]:
    sentences = []
    proof = f"no motion is faster than {known.lower_bound:.6g} s ({known.bound_by})"
    if known.best is None:
        sentences.append(f"best known: none ({known.best_by}); {proof}")
    elif known.proved:
        sentences.append(f"optimum: {known.best:.6g} s ({known.best_by}), proved; {proof}")
    else:
        sentences.append(f"best known: {known.best:.6g} s ({known.best_by}); {proof}")
    sentences.append(f"stopping at every waypoint: {known.stopping:.6g} s")
    for family, best in known.best_of_family.items():
        sentences.append(f"best {family}: {best:.6g} s")
    return sentences


def _table(judgements: list[JudgedClaim]) -> Any:
    numbers = ["published s", "above best", "over stopping"]
    beside = {
        "over its family": [own.over_family for own in judgements],
        "at its own jerk": [own.over_equal_jerk for own in judgements],
    }
    shown = [name for name, values in beside.items() if set(values) != {None}]
    headings = (*numbers, *shown)
    table = console.table("method", *headings, "verdict", numbers=headings)
    for row, own in enumerate(judgements):
        table.add_row(
            console.markup(own.claim.method),
            f"{own.claim.duration:g}",
            percent(own.excess),
            percent(own.over_stopping),
            *(percent(beside[name][row]) for name in shown),
            _coloured(own.verdict),
        )
    return table


def percent(excess: float | None) -> str:
    """A ratio minus 1 with its sign; a dash for None."""
    if excess is None:
        return "–"
    if abs(excess) < _ZERO:
        return "0.00 %"
    return style.percent(excess)


def _coloured(verdict: Verdict) -> str:
    if verdict in (Verdict.IMPOSSIBLE, Verdict.UNPROVED):
        return f"[bold red]{verdict}[/bold red]"
    return str(verdict)
