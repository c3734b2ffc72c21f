"""What every experiment writes: its table as CSV and Markdown, and how far it is."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd

from trajopt.cli import console


@contextmanager
def progress(total: int, what: str = "trials") -> Iterator[Callable[[int], None]]:
    """Show progress as `console.progress` does, and print the total on standard error first."""
    say(f"{total} {what} in all")
    with console.progress(total, what) as advance:
        yield advance


def say(text: str) -> None:
    """Print a line on standard error."""
    print(f"experiment: {text}", file=sys.stderr, flush=True)


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
