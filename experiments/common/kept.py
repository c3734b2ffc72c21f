"""Tables that grow in a file, so that an interrupted experiment can continue."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import pandas as pd
import pebble

from experiments.common.output import progress

Rows = Any  # a table, or a list of rows by column
Cell = Callable[[], Rows]
Key = Any  # a tuple, the values of the columns that tell cells apart


def in_turn(cells: Iterable[Cell]) -> Iterator[Rows]:
    """Compute cells one after the other, in this process."""
    return (cell() for cell in cells)


def kept(
    file: Path,
    columns: Sequence[str],
    cells: Mapping[Key, Cell],
    compute: Callable[[Iterable[Cell]], Iterable[Rows]] = in_turn,
) -> pd.DataFrame:
    """Return a file's table once it has the rows of every cell.

    Args:
        file: CSV. The rows of a cell are added as soon as they are known.
        columns: Names of the columns that tell the cells apart.
        cells: By their values in these columns. Those that the file has are not computed.
        compute: Yields the rows of cells, in their order.
    """
    done: set[Key] = set()
    if file.exists():
        keys = pd.read_csv(file, usecols=columns)[[*columns]]
        done = set(keys.itertuples(index=False, name=None))
    missing = {key: cell for key, cell in cells.items() if key not in done}
    file.parent.mkdir(parents=True, exist_ok=True)
    with progress(len(cells)) as advance:
        advance(len(cells) - len(missing))
        for key, rows in zip(missing, compute(missing.values()), strict=True):
            table = pd.DataFrame(rows)
            for place, name in enumerate(columns):
                table.insert(place, name, [key[place]] * len(table))
            if len(table):
                table.to_csv(file, mode="a", header=not file.exists(), index=False)
            advance(1)
    return pd.read_csv(file)


def apart(
    cells: Iterable[Cell],
    *,
    lost: Callable[[BaseException], Rows],
    workers: int,
    timeout: float,
    start: str = "spawn",
    cells_per_worker: int = 0,
) -> Iterator[Rows]:
    """Compute each cell in a child process; `lost` gives the rows of one that died or hung.

    Args:
        cells: They can be pickled.
        lost: Of the error that says what happened to the process.
        workers: Processes at once.
        timeout: Of a cell, s.
        start: How processes start; "fork" where no solver was loaded.
        cells_per_worker: After so many a process is replaced; 0: never.
    """
    context = get_context(start)
    pool = pebble.ProcessPool(workers, max_tasks=cells_per_worker, context=context)
    try:
        running = [pool.schedule(cell, timeout=timeout) for cell in cells]
        for future in running:
            error = future.exception()
            yield lost(error) if error else future.result()
    finally:
        pool.stop()  # type: ignore[no-untyped-call]
        pool.join()
