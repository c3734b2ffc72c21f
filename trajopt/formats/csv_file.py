"""Tables of numbers as CSV: separators, headings with units, numbers; errors name line and column.

Cells are separated by commas, semicolons or tabs, in some files by spaces. Between semicolons or
tabs a comma is a decimal point. Empty lines and lines that start with # are ignored.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from trajopt.core import files, numerals
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput

Line = tuple[int, str]  # its number in the file, and its text

ABOVE = "text above it may begin with #"
"""What an error says of a file that begins with other text than its table."""

_MAX_COLUMNS = 2000
_LOOKED_AT = 100  # lines, for columns of text
_LONGEST_HEADING = 1000  # characters
_INDEX = re.compile(
    r"|#|no|nr|id|idx|index|unnamed: 0|pts?|points?|rows?|samples?|frame(_index)?", re.IGNORECASE
)
# A unit behind a name without brackets: joint1_deg, joint1_vel_deg_s.
_SUFFIX = re.compile(r"(.+)_(deg|rad|mm)(?:_?(?:per_)?(s|s2))?")
_LIST = re.compile(r"\[[^\[\]]*\]|\([^()]*\)")
# A word, perhaps with a unit in brackets behind it: "elbow [deg]".
_WORD = re.compile(r"[^\s\[(]\S*(?:\s+[\[(][^\s\])]{0,20}[\])])?")


@dataclass(frozen=True)
class Table:
    """A table whose numbers are not read yet.

    Attributes:
        headings: One per column; all empty where the file has no header.
        line: The number of the first line with content.
        separator: The character between cells, or None for spaces.
        lines: The lines of numbers.
        cells: Column by column, where lines do not have them: of arrays, of lists in cells.
    """

    headings: Sequence[str]
    line: int
    separator: str | None
    lines: Sequence[Line]
    cells: Sequence[Sequence[str]] = ()

    def __post_init__(self) -> None:
        if len(self.headings) > _MAX_COLUMNS:
            right = f"at most {_MAX_COLUMNS} columns"
            raise InvalidInput(f"line {self.line}", right, value=len(self.headings))
        longest = max(self.headings, key=len)
        if len(longest) > _LONGEST_HEADING:
            right = f"headings of at most {_LONGEST_HEADING} characters"
            raise InvalidInput(f"line {self.line}", right, value=longest)

    @property
    def preceded(self) -> bool:
        """Return whether the first line looks like text above the header: one cell, no number."""
        rows = [_cells(text, own) for own in ",;\t" for _, text in self.lines[:5] if own in text]
        return self.separator is None and any(len(row) > len(self.headings) for row in rows)

    @property
    def indexed(self) -> bool:
        """Return whether the first column is an index of rows, as pandas writes it."""
        first, *others = self.headings
        return any(others) and _INDEX.fullmatch(first) is not None

    @cached_property
    def columns(self) -> Sequence[Sequence[str]]:
        """The cells, column by column.

        Raises:
            InvalidInput: A line has another number of cells.
        """
        if self.cells:
            return self.cells
        rows = [_cells(text, self.separator) for _, text in self.lines]
        for (line, _), row in zip(self.lines, rows, strict=True):
            if len(row) == len(self.headings):
                continue
            if row is rows[0] and self.preceded:
                right = f"a header; {ABOVE}"
                raise InvalidInput(f"line {self.line}", right, value=" ".join(self.headings))
            right = f"{len(self.headings)} cells, one per column of the first line"
            raise InvalidInput(f"line {line}", right, value=len(row))
        return [*zip(*rows, strict=True)] or [()] * len(self.headings)

    def texts(self) -> set[int]:
        """Return the columns without a number in the first lines."""
        first = [cells[:_LOOKED_AT] for cells in self.columns]
        return {index for index, own in enumerate(first) if own and not any(map(_is_number, own))}

    def numbers(self, columns: Sequence[int]) -> Array:
        """Return the numbers of these columns, `(lines, columns)`.

        Raises:
            InvalidInput: A cell is not a finite number; names the first one in the file.
        """
        found = np.array([numerals.floats(self.columns[index]) for index in columns]).T
        for row, own in np.argwhere(~np.isfinite(found)).tolist():
            value = self.columns[columns[own]][row]
            key = self.place(row, columns[own])
            raise InvalidInput(key, "a finite number, like -1.5e-3", value=value)
        return found

    def place(self, row: int, column: int) -> str:
        """Name a cell, for errors, by its line in the file and its column, from 1."""
        line, _ = self.lines[row]
        where = f"line {line}, column {column + 1}" if self.lines[row][1] else f"row {line}"
        return f"{where}, {self.headings[column]}," if self.headings[column] else where


def table(text: str, *, commented: bool = False) -> Table:
    """Return the table in a text.

    Args:
        text: The file's text.
        commented: True if the header may be in a comment, as NumPy writes it.

    Raises:
        InvalidInput: The text is empty.
    """
    content: list[Line] = []
    comment = ""
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip().startswith("#"):
            comment = comment if content else line.lstrip("# ")
        elif line.strip(" ,;\t"):
            content.append((number, line))
    if not content:
        raise InvalidInput("line 1", "a header, and lines of numbers; there are none")
    number, first = content[0]
    separator = next((own for own in ";,\t" if own in first), None)
    if separator is None and text.count(" ") > files.MAX_VALUES:
        raise InvalidInput("values", f"at most {files.MAX_VALUES}", value=text.count(" "))
    headings = _headings(first, separator)
    if not headings:
        raise InvalidInput(f"line {number}", "a heading or a number", value=first)
    if not any(map(_is_number, headings)):
        return Table(headings, number, separator, content[1:])
    columns = len(_cells(first, separator))
    headings = _headings(comment, separator) if commented else []
    if len(headings) != columns:
        headings = [""] * columns
    return Table(headings, number, separator, content)


def parted(given: Table) -> Table:
    """Return the table with a column for each number of a list in a cell, `[0.1, 0.2]`.

    Raises:
        InvalidInput: The lists of a column differ in length.
    """
    if not given.lines or not any(map(_LIST.fullmatch, _cells(given.lines[0][1], given.separator))):
        return given
    headings: list[str] = []
    cells: list[Sequence[str]] = []
    for index, (name, column) in enumerate(zip(given.headings, given.columns, strict=True)):
        if not _LIST.fullmatch(column[0]):
            headings.append(name)
            cells.append(column)
            continue
        lists = [re.split(r"[\s,;]+", cell.strip("[](){} ")) for cell in column]
        count = len(lists[0])
        for row, own in enumerate(lists):
            if len(own) != count:
                right = f"a list of {count} numbers, as in the line before"
                raise InvalidInput(given.place(row, index), right, value=column[row])
        headings += [f"{name}[{number}]" for number in range(count)]
        cells += [*zip(*lists, strict=True)]
    return replace(given, headings=headings, cells=cells)


def _headings(line: str, separator: str | None) -> list[str]:
    return _WORD.findall(line) if separator is None else _cells(line, separator)


def heading(cell: str) -> tuple[str, str | None]:
    """A column's name, and its unit in brackets; None where it has none."""
    suffix = _SUFFIX.fullmatch(cell)
    if suffix:
        rate = {"s": "/s", "s2": "/s^2", None: ""}[suffix[3]]
        return suffix[1], suffix[2] + rate
    start = max(cell.rfind("["), cell.rfind("("))
    unit = cell[start + 1 : -1].replace(" ", "").replace("°", "deg")
    if start < 0 or cell[-1] not in "])" or unit.isdecimal():  # q[0] is a name
        return cell, None
    return cell[:start].strip(), unit


def _is_number(cell: str) -> bool:
    return numerals.parsed(cell) is not None


def _cells(line: str, separator: str | None) -> list[str]:
    """Return the cells of a line; without a separator they are the words."""
    row = line.split(separator)
    if separator is not None and '"' in line:
        (row,) = csv.reader([line], delimiter=separator)
    if separator in (";", "\t"):
        row = [cell.replace(",", ".") for cell in row]
    return [*map(str.strip, row)]
