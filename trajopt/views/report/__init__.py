"""One self-contained HTML page of a run: tables, curves, trajectories, failures, every trial.

    write(Results(store.read("results")), Path("results/report.html"))

The page needs no server and no network. The trials, each problem's curves and trajectories, and
the chart library are in it compressed, to a third of their size. The library is Plotly's
distribution for curves and maps (npm's `plotly.js-cartesian-dist-min`), unchanged: a third of all
of Plotly.
"""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import Any

from trajopt.core.exceptions import InvalidInput, MissingBackend
from trajopt.views.analysis.pairwise import TIE_DIGITS
from trajopt.views.analysis.results import Tables
from trajopt.views.analysis.searches import TARGETS
from trajopt.views.packing import as_text, packed_json
from trajopt.views.report import content, rivals, suite_curves
from trajopt.views.report import panels as motions

try:
    import jinja2
    from markupsafe import Markup, escape
except ImportError:  # `write` raises an error
    jinja2 = None  # type: ignore[assignment]

CHARTS = Path(__file__).parent / "web" / "plotly-cartesian-4.1.1.min.js.gz"
TRAJECTORIES = 60  # problems whose trajectories are in the page: each takes up to 150 kB
_BEGINNING = 1000  # characters, in which a report says whose it is


def write(
    results: Tables, path: Path, *, command: str = "", trajectories: int = TRAJECTORIES
) -> Path:
    """Write the report of the trials to a file; it links to `trials/` where that is beside it.

    Args:
        results: the trials.
        path: the file.
        command: the command that made the results, to be shown.
        trajectories: for at most so many problems the median run of each planner has its trajectory
            in the page, which says which are left out.

    Returns:
        The path.

    Raises:
        InvalidInput: there is no trial.
        MissingBackend: the extra `report` is not installed.
        OSError: the file cannot be written.
    """
    if jinja2 is None:
        raise MissingBackend("jinja2", "report")
    if not results.items:
        raise InvalidInput("results", "at least one trial")
    page = content.page(results)
    suites = suite_curves.suites(page)
    seeds = suite_curves.between_seeds(page)
    tables = {"suites": suites, "seeds": seeds, "files": (path.parent / "trials").is_dir()}
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("trajopt.views.report", "web"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["breaks"] = _breaks
    environment.filters["whole"] = _whole
    environment.filters["number"] = _number
    html = environment.get_template("template.html").render(
        page=page,
        digest=_digest(results),
        columns=page.columns,
        tied=TIE_DIGITS,
        command=command,
        kept=trajectories,
        targets=[f"{100 * target:g} %" for target in TARGETS],
        whole=suites[0],
        against=rivals.first(results.items, page.labels),
        seeds=seeds,
        blobs=_blobs(page, tables, trajectories),
    )
    path.write_text(html, encoding="utf-8")
    return path


def is_of(results: Tables, path: Path) -> bool:
    """Return whether a file is the report of these trials, by its first lines."""
    try:
        with path.open(encoding="utf-8") as file:
            beginning = file.read(_BEGINNING)
    except (OSError, UnicodeDecodeError):
        return False
    return f'content="{_digest(results)}"' in beginning


def _digest(results: Tables) -> str:
    """SHA-256 of the trials' identities and the times at which they were run."""
    runs = sorted(f"{trial.id} {trial.started}" for trial in results.items)
    return hashlib.sha256("\n".join(runs).encode()).hexdigest()


def _breaks(label: str) -> Markup:
    """A planner's label that may go on to the next line between its options."""
    parts = re.split("(?<=[:,])", label)
    return Markup("<span>{}</span>").format(Markup("<wbr>").join(parts))


def _number(value: float | None) -> str:
    """Return a number as a browser's script reads it; empty for none."""
    if value is None:
        return ""
    return "Infinity" if value == float("inf") else str(value)


def _whole(html: str) -> Markup:
    """The same text or HTML, of which no line ends within 3-5-3."""
    return Markup(re.sub(r"3-5-3(?![^<>]*>)", '<span class="whole">3-5-3</span>', escape(html)))


def _blobs(page: content.Page, tables: dict[str, Any], trajectories: int) -> dict[str, str]:
    """Return the packed parts of the page: Plotly, the trials, and each problem."""
    data = content.trial_table(page) | tables
    blobs = {"data": packed_json(data), "plotly": as_text(CHARTS.read_bytes())}
    drawn = page.drawn(trajectories)
    for number, trials in enumerate(page.trials_by_problem):
        shown = number in drawn
        own = motions.panel(trials, page.labels, with_motions=shown)
        blobs[f"problem-{number}"] = packed_json(own)
    return blobs
