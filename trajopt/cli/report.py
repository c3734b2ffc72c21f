"""`trajopt report`: one page about all trials of one or several folders."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import Annotated

from trajopt.benchmark.store.folder import Store
from trajopt.cli import console, kinds
from trajopt.cli.parameters import Writing, beside, whole_number
from trajopt.core.exceptions import StoreError
from trajopt.views import report as page
from trajopt.views.analysis.gap_reference import best
from trajopt.views.results import Results


def report(
    folder: Path,
    *others: Path,
    planner: list[str] | None = None,
    common: bool = False,
    out: Writing[Path | None] = None,
    trajectories: Annotated[
        int, whole_number("Problems shown with their trajectories.", least=0)
    ] = 60,
) -> int:
    """Write one self-contained, interactive page about all trials of one or several folders.

    A results.h5 in them that is old, damaged or missing is made anew from the trials.

    Args:
        folder: Results folder of a comparison, or its results.h5.
        others: More of them, for one page about all.
        planner: Show this planner and the references alone, repeated.
        common: Show only the problems that all planners answer.
        out: By default report.html in the folder; of several, in this folder.
    """
    place = Path("report.html") if others else beside(folder, "report.html")
    folders = (folder, *others)
    with console.waiting("writing the report"):
        with ExitStack() as stack:
            for one in folders:
                stack.enter_context(kinds.reading(one, "results"))
            results = Results.of(*folders).only(planner or [], common=common)
        file = page.write(
            results,
            out or place,
            command=f"trajopt report {' '.join(map(str, folders))}",
            trajectories=trajectories,
        )
        for one in filter(Path.is_dir, folders):
            _refresh(Store(one))
    megabytes = file.stat().st_size / 1e6
    trials = len(results.items)
    console.line(f"report: {file} ({megabytes:.1f} MB, {trials} trials)")
    if results.left_out:
        console.paragraph(results.newest)
    return 0


def _refresh(store: Store) -> None:
    """Make `results.h5` anew where it is not of the folder's trials, and say so."""
    try:
        if store.refresh(best):
            console.note(f"{store.results}: made anew from the trials")
    except StoreError as error:  # a folder that others may only read
        console.note(f"{error}; it is not of the trials in trials/")
