"""Report of every soak: a row per attack, a line per family, exit code 1 if one succeeded."""

from __future__ import annotations

import sys
from pathlib import Path

import pandas as pd

from experiments.common.output import save_table

DATA = Path(__file__).with_name("data")
WIDTH = 80  # characters of a terminal's line


def conclude(rows: pd.DataFrame, succeeded: pd.Series[bool], stem: Path) -> None:
    """Write the table, and print a line per family and the attacks that succeeded.

    Args:
        rows: A row per attack; its family is in the column `family`.
        succeeded: Whether each attack did. If any did, the process ends with exit code 1.
        stem: Of the files' names.
    """
    save_table(rows, stem)
    families = succeeded.groupby(rows["family"], sort=False)
    table = families.agg(attacks="size", succeeded="sum")
    print("tried won family")
    for family, tried, own in table.itertuples():
        print(f"{tried:5} {own:3} {family}")
    print(f"{succeeded.sum()} of {len(rows)} attacks of {len(table)} families succeeded")
    if succeeded.any():
        print(rows[succeeded].to_string(index=False, line_width=WIDTH))
        sys.exit(1)
