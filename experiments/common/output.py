"""Write the table of an experiment as CSV and Markdown."""

from __future__ import annotations

from pathlib import Path

import pandas as pd


def save_table(table: pd.DataFrame, stem: Path) -> None:
    """Write `stem.csv` with all digits, and `stem.md` with six; a named index is the first column.

    Raises `OSError` where the folder cannot be written.
    """
    stem.parent.mkdir(parents=True, exist_ok=True)
    if any(table.index.names):
        table = table.reset_index()
    table.to_csv(stem.with_suffix(".csv"), index=False)
    given = table.notna()
    blank = table.astype(object).where(given, None)
    text = blank.to_markdown(index=False, floatfmt=".6g", missingval="")
    markdown = stem.with_suffix(".md")
    markdown.write_text(f"{text}\n")
