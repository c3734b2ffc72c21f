"""Tables of numbers as CSV: separators, headings with units, numbers; errors name line and column.

Cells are separated by commas, semicolons or tabs, in some files by spaces. Empty lines are ignored.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence

from trajopt.core import numerals
from trajopt.core.exceptions import InvalidInput

Line = tuple[int, str]  # its number in the file, and its text


def lines(text: str) -> list[Line]:
    """The lines that are not empty, with their numbers from 1."""
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.strip(" ,;\t"):
            found.append((number, line))
    return found


def is_comment(line: str) -> bool:
    return line.lstrip().startswith("#")


def separator_of(line: str) -> str | None:
    """The character that separates the cells of a line, or None."""
    for separator in ";,\t":
        if separator in line:
            return separator
    return None


def cells(line: str, separator: str | None) -> list[str]:
    """The cells of a line; without a separator they are the words."""
    if separator is None:
        return line.split()
    (row,) = csv.reader([line], delimiter=separator)
    return [cell.strip() for cell in row]


def heading(cell: str) -> tuple[str, str | None]:
    """A column's name, and its unit in brackets; None where it has none."""
    start = max(cell.rfind("["), cell.rfind("("))
    if start < 0 or cell[-1] not in "])":
        return cell, None
    unit = cell[start + 1 : -1]
    return cell[:start].strip(), unit.strip()


def numbers(line: int, own_cells: Sequence[str], headings: Sequence[str]) -> list[float]:
    """The numbers of a line, one per column.

    Args:
        line: The line's number, for errors.
        own_cells: The cells of the line.
        headings: The columns' headings, for errors; empty texts where the file has no header.

    Raises:
        InvalidInput: Another number of cells, or a cell that is not a finite number.
    """
    if len(own_cells) != len(headings):
        right = f"{len(headings)} cells, one per column of the first line"
        raise InvalidInput(f"line {line}", right, value=len(own_cells))
    row = []
    for column, cell in enumerate(own_cells, start=1):
        number = numerals.parsed(cell)
        if number is None or not numerals.is_number(number):
            key = place(line, column, headings[column - 1])
            raise InvalidInput(key, "a finite number, like -1.5e-3", value=cell)
        row.append(float(number))
    return row


def place(line: int, column: int, column_heading: str) -> str:
    """The place of a cell, for errors; columns count from 1."""
    where = f"line {line}, column {column}"
    return f"{where}, {column_heading}," if column_heading else where
