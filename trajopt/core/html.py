"""Small tables in HTML: what a notebook shows of an object."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def table(caption: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with a caption; all texts are shown as they are."""
    title = escape(caption)
    head = _row("th", header)
    body = [_row("td", row) for row in rows]
    lines = [
        "<table>",
        f"<caption>{title}</caption>",
        head,
        *body,
        "</table>",
    ]
    return "\n".join(lines)


def _row(tag: str, cells: Sequence[str]) -> str:
    shown = ""
    for cell in cells:
        content = escape(cell)
        shown += f"<{tag}>{content}</{tag}>"
    return f"<tr>{shown}</tr>"
