"""What a proof's rows come from, and how a proof stores it: a table a kind."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.lower_bound.costates import CELL_COLUMNS, Cut
from baselines.lower_bound.jerk_rows import Ramp, SquareTangent

Array = NDArray[np.float64]
Indices = NDArray[np.intp]


class Tangent(NamedTuple):
    """To `1/T` of a segment: where it touches."""

    segment: int
    at: float


Source = Tangent | SquareTangent | Ramp | Cut
# In the order in which a proof counts its rows.
_KINDS = (SquareTangent, Tangent, Ramp, Cut)


class Tables(NamedTuple):
    """Rows as a proof stores them."""

    square_tangents: Array
    tangents: Array
    ramps: Array
    cuts: Array
    cells: Array


def in_order(sources: Sequence[Source], numbers: Sequence[int]) -> list[int]:
    """Chosen rows, kind by kind."""
    ordered = []
    for kind in _KINDS:
        for number in numbers:
            if isinstance(sources[number], kind):
                ordered.append(number)
    return ordered


def tables(sources: Sequence[Source]) -> Tables:
    """Rows that stand in order, as a proof stores them."""
    squares = []
    tangents = []
    ramps = []
    heads = []
    cells = [np.zeros((0, CELL_COLUMNS))]
    for source in sources:
        match source:
            case SquareTangent():
                squares.append(source)
            case Tangent():
                tangents.append(source)
            case Ramp():
                ramps.append(source)
            case Cut(segment, joint, own):
                heads.append((segment, joint, len(own)))
                cells.append(own)
    return Tables(
        square_tangents=_table(squares, 2),
        tangents=_table(tangents, 2),
        ramps=_table(ramps, 3),
        cuts=_table(heads, 3),
        cells=np.concatenate(cells),
    )


def _table(rows: Sequence[Sequence[float]], columns: int) -> Array:
    table = np.array(rows, dtype=float)
    return table.reshape(-1, columns)
