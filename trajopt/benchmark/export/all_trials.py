"""All trials in a format that other programs read: CSV, Parquet, IOHprofiler.

write(Results("results"), "csv", Path("trials.csv"))
write(Results("results"), "ioh", Path("ioh"))        # a folder; zip it for IOHanalyzer's page
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from trajopt.benchmark.analysis.results import Results
from trajopt.benchmark.export import ioh, tables
from trajopt.exceptions import InvalidInput


def write(results: Results, to: str, path: Path) -> None:
    """Write all trials to a file (`csv`, `parquet`: see `tables.table`) or a new folder (`ioh`).

    Raises:
        InvalidInput: for another format.
        StoreError: where the disk refuses, where the folder holds files already, or for `ioh` if no
            trial has a history.
        MissingBackend: for `parquet` without pyarrow.
    """
    if to not in _WRITERS:
        raise InvalidInput("--to", " or ".join(_WRITERS), value=to)
    writer = _WRITERS[to]
    writer(results, path)


_WRITERS: dict[str, Callable[[Results, Path], None]] = {
    "csv": tables.write_csv,
    "parquet": tables.write_parquet,
    "ioh": ioh.write,
}
