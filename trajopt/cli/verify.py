"""`trajopt verify`: claimed against certified, trial by trial, and what does not hold."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt.benchmark.store.verification import CheckedTrial, Verification, verification
from trajopt.cli import console
from trajopt.cli.parameters import Json

_NUMBERS = ("seed", "claimed s", "certified s", "dilation", "verdict")


def verify(
    path: Annotated[Path, Parameter(help="Results folder, or a results.h5.")],
    *,
    json: Json = False,
) -> int:
    """Verify every stored trajectory anew, from the file alone."""
    found = verification(path)
    if json:
        rows = [trial.as_dict() for trial in found.trials]
        console.print_json({"holds": found.holds, "summary": found.summary(), "trials": rows})
    else:
        _print(found)
    return 0 if found.holds else 1


def _print(found: Verification) -> None:
    table = console.table("problem", "planner", *_NUMBERS, numbers=_NUMBERS)
    for trial in found.trials:
        verdict = console.markup(trial.status)
        if not trial.holds:
            verdict = "[bold red]DOES NOT HOLD[/bold red]"
        table.add_row(
            console.markup(trial.problem),
            console.option_lines(trial.planner),
            "–" if trial.seed is None else str(trial.seed),
            _number(trial.claimed_duration),
            _number(trial.certified_duration),
            _number(trial.dilation),
            verdict,
        )
    console.OUT.print(table)
    for sentence in found.summary():
        console.paragraph(sentence)
    for trial in found.trials:
        if not trial.holds:
            console.paragraph(_what_is_wrong(trial))


def _what_is_wrong(trial: CheckedTrial) -> str:
    name = f"{trial.planner} on {trial.problem}, seed {trial.seed}, trial {trial.id}"
    flaws = [flaw for flaw in trial.flaws if flaw]
    return f"{name}: {'; '.join([*trial.differences, *flaws])}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.6f}"
