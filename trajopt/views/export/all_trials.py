"""All trials in a format that other programs read: CSV, Parquet, IOHprofiler, LaTeX.

write(Results("results"), "csv", Path("trials.csv"))
write(Results("results"), "ioh", Path("ioh"))        # a folder; zip it for IOHanalyzer's page
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from trajopt.core.exceptions import InvalidInput
from trajopt.views.analysis.results import Results
from trajopt.views.export import ioh, latex, tables


def write(results: Results, to: str, path: Path) -> None:
    """Write all trials to a file or a folder.

    Args:
        results: the trials.
        to: `csv` or `parquet`, all trials as `tables.table` has them; `ioh`, a new folder of
            convergence histories; `latex`, a folder of tables.
        path: the file or folder.

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
    "latex": latex.write,
}
