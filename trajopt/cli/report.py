"""`trajopt report`: one page about all trials of a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from trajopt.cli import console
from trajopt.cli.parameters import beside, whole_number
from trajopt.views import report as page
from trajopt.views.analysis.results import Results


def report(
    folder: Annotated[
        Path,
        Parameter(help="Results folder of a comparison, or its results.h5."),
    ],
    *,
    trajectories: Annotated[
        int, whole_number("Problems shown with their trajectories.", least=0)
    ] = 60,
) -> int:
    """Write one self-contained, interactive page about all trials of a folder: report.html."""
    with console.waiting("writing the report"):
        results = Results(folder)
        file = page.write(
            results,
            beside(folder, "report.html"),
            command=f"trajopt report {folder}",
            trajectories=trajectories,
        )
    megabytes = file.stat().st_size / 1e6
    trials = len(results.items)
    console.line(f"report: {file} ({megabytes:.1f} MB, {trials} trials)")
    if results.left_out:
        console.paragraph(results.newest)
    return 0
