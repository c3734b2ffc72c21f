"""All trials as one table, in CSV or Parquet."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd

from trajopt.benchmark.store import atomic
from trajopt.benchmark.store.document import pack
from trajopt.benchmark.trial import Trial
from trajopt.planners.planner import backend
from trajopt.views.analysis.results import Results

# A spreadsheet takes a cell that starts with one of these for a formula, and runs it. An apostrophe
# says that what follows is text.
_MARKED = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠", "'")


def table(results: Results) -> pd.DataFrame:
    """Return `results.gaps()` (s) and the origin of each trial.

    Further columns:
        batch: runs solved together.
        started: UTC.
        options: all of them as JSON, NaN and infinity as `{"$float": "nan"}`.
        provenance_*: the commit, the machine and the versions, empty where not installed.
    """
    items = results.items
    trials = results.gaps()
    trials["batch"] = pd.Series([trial.batch for trial in items], dtype=int)
    started = [trial.started for trial in items]
    instants = pd.to_datetime(started, utc=True, format="ISO8601")
    trials["started"] = instants.as_unit("us")
    trials["options"] = pd.Series([options_text(trial) for trial in items], dtype="str")
    names: dict[str, None] = {}
    for trial in items:
        names |= dict.fromkeys(trial.provenance)
    for name in names:
        values = [str(trial.provenance.get(name, "")) for trial in items]
        trials[f"provenance_{name}"] = pd.Series(values, dtype="str")
    return trials


def options_text(trial: Trial) -> str:
    """All options as JSON, as the store writes them."""
    as_json = json.dumps(dict(trial.options), default=str)
    plain = json.loads(as_json)
    return json.dumps(pack(plain), sort_keys=True, ensure_ascii=False)


def write_csv(results: Results, path: Path) -> None:
    """UTF-8, RFC 4180, floats with all their digits.

    Texts that a spreadsheet would run as a formula get an apostrophe in front, and so do those that
    start with one: taking it off gives every text back. Numbers stay numbers.
    """
    trials = table(results)
    for name in trials.select_dtypes(exclude=["number", "bool", "datetimetz"]):
        trials[name] = _inert(trials[name])

    def fill(place: Path) -> None:
        # with \r\n as the end of a line, texts with a lone \r in them are quoted
        trials.to_csv(
            place,
            index=False,
            lineterminator="\r\n",
            errors="backslashreplace",
        )

    atomic.write(path, fill)


def write_parquet(results: Results, path: Path) -> None:
    """Types included; needs pyarrow."""
    backend("pyarrow", "parquet")
    trials = table(results)

    def fill(place: Path) -> None:
        trials.to_parquet(place, engine="pyarrow", index=False)

    atomic.write(path, fill)


def _inert(texts: pd.Series[str]) -> pd.Series[str]:
    """The texts, marked as such where a spreadsheet would run them."""
    marked = texts.str.startswith(_MARKED, na=False)
    return texts.mask(marked, "'" + texts.astype(str))
