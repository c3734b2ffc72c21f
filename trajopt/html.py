"""Small tables in HTML: what a notebook shows of an object."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape


def table(caption: str, header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table with a caption; all texts are shown as they are."""
    lines = [f"<table><caption>{escape(caption)}</caption>", _row("th", header)]
    for row in rows:
        lines.append(_row("td", row))
    lines.append("</table>")
    return "\n".join(lines)


def _row(tag: str, cells: Sequence[str]) -> str:
    shown = [f"<{tag}>{escape(cell)}</{tag}>" for cell in cells]
    return f"<tr>{''.join(shown)}</tr>"
