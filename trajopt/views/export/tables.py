"""All trials as one table, in CSV or Parquet."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from trajopt.benchmark.store import atomic
from trajopt.planners.planner import backend
from trajopt.views.analysis.results import Tables

# A spreadsheet runs a cell that starts with one of these as a formula. An apostrophe in front marks
# it as text.
_MARKED = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠", "'")


def table(results: Tables) -> pd.DataFrame:
    """Return `results.gaps()` (s), `started` as an instant, and a column per fact of provenance.

    Those are `provenance_commit`, `provenance_machine` and so on, empty where not installed.
    """
    trials = results.gaps()
    instants = pd.to_datetime(trials["started"], utc=True, format="ISO8601")
    trials["started"] = instants.dt.as_unit("us")
    facts = pd.DataFrame([dict(trial.provenance) for trial in results.items], dtype="str")
    facts = facts.fillna("").add_prefix("provenance_")
    return trials.drop(columns="provenance").join(facts)


def write_csv(results: Tables, path: Path) -> None:
    """Write a table as CSV: UTF-8, RFC 4180, floats with all their digits.

    Texts that a spreadsheet would run as a formula get an apostrophe in front, and so do those that
    start with an apostrophe. Removing the first one restores every text. Numbers stay numbers.
    """
    trials = table(results)
    for name in trials.select_dtypes(exclude=["number", "bool", "datetimetz"]):
        trials[name] = _inert(trials[name])

    def fill(place: Path) -> None:
        # with \r\n as the end of a line, texts with a lone \r in them are quoted
        trials.to_csv(place, index=False, lineterminator="\r\n", errors="backslashreplace")

    atomic.write(path, fill)


def write_parquet(results: Tables, path: Path) -> None:
    """Types included; needs pyarrow."""
    backend("pyarrow", "parquet")
    trials = table(results)

    def fill(place: Path) -> None:
        trials.to_parquet(place, engine="pyarrow", index=False)

    atomic.write(path, fill)


def _inert(texts: pd.Series[str]) -> pd.Series[str]:
    """Return the texts, with an apostrophe where a spreadsheet would run them."""
    marked = texts.str.startswith(_MARKED, na=False)
    return texts.mask(marked, "'" + texts.astype(str))
