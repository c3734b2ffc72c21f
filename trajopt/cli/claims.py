"""`trajopt claims`: judge published times by the best known motion and the proved bound."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

from cyclopts import Parameter
from rich.text import Text

from trajopt.benchmark.best_known.surveyed import with_record
from trajopt.benchmark.suites import literature
from trajopt.benchmark.suites.literature import Published
from trajopt.cli import console, kinds
from trajopt.cli.console import PlainTable
from trajopt.cli.parameters import MAX_SECONDS, Json, number
from trajopt.core.exceptions import InvalidInput
from trajopt.core.numerals import rounded_down
from trajopt.explain.verdicts import MEANINGS, JudgedClaim, Known, Verdict, judge_claim, survey
from trajopt.views import table_cells

_PUBLISHED_FIELDS = ("source", "doi", "objective", "reading", "unsaid", "transcription", "checked")
_KNOWN_FIELDS = ("best", "best_by", "lower_bound", "bound_by", "stopping", "best_of_family")
_CLAIM_FIELDS = ("method", "duration", "rounding", "table", "objective")
_JUDGED_FIELDS = ("excess", "over_stopping", "over_family", "over_equal_jerk")
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
    with kinds.reading(problem, "stated problem"):
        published = literature.published(problem)
    if published.problem is None:
        right = f"a problem that can be stated here, but {published.beyond}"
        raise InvalidInput("problem", right, value=published.name)
    with console.waiting("asking the references"):
        computed = survey(published.problem, published.families, time_limit=time_limit)
        known = with_record(computed)
        judgements = [judge_claim(claim, known) for claim in published.claims]
    if json:
        console.print_json(as_dict(published, known, judgements))
    else:
        _print(published, known, judgements)
    return 0


def _list(*, json: bool) -> int:
    """List the published problems that can be stated, with the number of their claims."""
    rows = []
    for name in literature.files():
        published = literature.published(name)
        rows.append({"name": name, "claims": len(published.claims), "source": published.source})
    if json:
        console.print_json({"problems": rows})
        return 0
    table = console.table("problem", "claims", "source", numbers=("claims",))
    for row in rows:
        table.row(console.bold(row["name"]), row["claims"], row["source"])
    console.OUT.print(table)
    console.paragraph("Judge the times of one: trajopt claims PROBLEM")
    return 0


def as_dict(published: Published, known: Known, judgements: list[JudgedClaim]) -> dict[str, Any]:
    """Return what is known of a problem and its claims for JSON: seconds, and ratios minus 1."""
    facts = {
        "problem": published.name,
        **_fields(published, _PUBLISHED_FIELDS),
        **_fields(known, _KNOWN_FIELDS),
    }
    claims = []
    for own in judgements:
        verdict = {"verdict": str(own.verdict), **_fields(own, _JUDGED_FIELDS)}
        claims.append(_fields(own.claim, _CLAIM_FIELDS) | verdict)
    return facts | {"claims": claims}


def _fields(value: object, names: Sequence[str]) -> dict[str, Any]:
    return {name: getattr(value, name) for name in names}


def _print(published: Published, known: Known, judgements: list[JudgedClaim]) -> None:
    title = console.bold(published.name)
    console.OUT.print(Text.assemble(title, f": {published.source}"))
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
    name = "proved optimum" if known.proved else "best known"
    best = "none" if known.best is None else f"{known.best:.6g} s"
    lower = rounded_down(known.lower_bound, ".6g")
    proof = f"no motion is faster than {lower} s ({known.bound_by})"
    families = known.best_of_family.items()
    return [
        f"{name}: {best} ({known.best_by}); {proof}",
        f"stopping at every waypoint: {known.stopping:.6g} s",
        *(f"best {family}: {duration:.6g} s" for family, duration in families),
    ]


def _table(judgements: list[JudgedClaim]) -> PlainTable:
    columns: dict[str, list[float | None]] = {
        "above best": [own.excess for own in judgements],
        "over stopping": [own.over_stopping for own in judgements],
        "over its family": [own.over_family for own in judgements],
        "at its own jerk": [own.over_equal_jerk for own in judgements],
    }
    for optional in ("over its family", "at its own jerk"):
        if set(columns[optional]) == {None}:
            del columns[optional]
    numbers = ("published s", *columns)
    table = console.table("method", *numbers, "verdict", numbers=numbers)
    for row, own in enumerate(judgements):
        ratios = (percent(column[row]) for column in columns.values())
        claim = own.claim
        verdict = _coloured(own.verdict)
        table.row(claim.method, f"{claim.duration:g}", *ratios, verdict)
    return table


def percent(excess: float | None) -> str:
    """Format a ratio minus 1 with its sign; a dash for None."""
    return table_cells.MISSING if excess is None else table_cells.percent(excess)


def _coloured(verdict: Verdict) -> str | Text:
    alarming = verdict in (Verdict.IMPOSSIBLE, Verdict.UNPROVED)
    return console.alarm(verdict) if alarming else str(verdict)
