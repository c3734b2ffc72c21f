"""The texts of a figure, drawn together: in pixels as one outline, in other files as text.

Matplotlib takes about a millisecond for a text in pixels, and a motion has eighty of them, numbers
mostly, which are the same in figure after figure. Every place is in inches from the figure's lower
left corner, every size in points.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.text import Text
from matplotlib.textpath import TextPath
from matplotlib.transforms import Transform
from numpy.typing import NDArray

from trajopt.views.figures.style import BLACK

Array = NDArray[np.float64]

_POINT = 1 / 72  # inches
_ALONG = {"left": 0.0, "center": 0.5, "right": 1.0}  # the share of a text before its place


class _Outline(NamedTuple):
    """A text of size 1 whose baseline starts at the origin."""

    vertices: Array  # (n, 2)
    codes: NDArray[np.uint8]  # (n,), of Matplotlib's paths
    width: float


@dataclass(frozen=True)
class Words:
    """A text on one line: the place of its baseline's `anchor`, and how it is written there."""

    x: float
    y: float
    text: str
    size: float
    anchor: Literal["left", "center", "right"]
    upwards: bool = False

    @property
    def width(self) -> float:
        """How much it takes of its line, inches."""
        return self.size * _POINT * _outline(self.text).width

    def outline(self) -> Path:
        """Its letters' outlines at their place."""
        outline = _outline(self.text)
        scale = self.size * _POINT
        before = _ALONG[self.anchor] * outline.width
        letters = scale * (outline.vertices - (before, 0.0))
        if self.upwards:
            across, up = letters.T
            letters = np.column_stack([-up, across])
        place = np.array([self.x, self.y])
        return Path(letters + place, outline.codes)

    def artist(self, inches: Transform) -> Text:
        """The same as one of Matplotlib's texts."""
        return Text(
            self.x,
            self.y,
            self.text,
            fontsize=self.size,
            color=BLACK,
            ha=self.anchor,
            va="baseline",
            rotation=90 if self.upwards else 0,
            rotation_mode="anchor",
            transform=inches,
        )


class Lettering(Artist):
    """Many texts as one artist of a figure."""

    def __init__(self, words: Iterable[Words], inches: Transform) -> None:
        super().__init__()
        self._words = [own for own in words if own.text.strip()]
        self._inches = inches

    def draw(self, renderer: Any) -> None:
        """Draw all of them, in the way that suits the file."""
        for artist in self._artists(in_pixels=isinstance(renderer, RendererAgg)):
            artist.draw(renderer)

    def get_children(self) -> list[Artist]:
        """Its texts, for whoever looks what a figure says."""
        return self._artists(in_pixels=False)

    def _artists(self, *, in_pixels: bool) -> list[Artist]:
        if in_pixels:
            artists: list[Artist] = [self._outlines()]
        else:
            artists = [own.artist(self._inches) for own in self._words]
        figure = self.get_figure()
        if figure is not None:
            for artist in artists:
                artist.set_figure(figure)
        return artists

    def _outlines(self) -> PathPatch:
        letters = Path.make_compound_path(*(own.outline() for own in self._words))
        return PathPatch(letters, color=BLACK, lw=0, transform=self._inches)


@cache
def height(text: str) -> float:
    """How far a text's letters reach above its baseline, in its size."""
    return float(_outline(text).vertices[:, 1].max())


@cache
def depth(text: str) -> float:
    """How far they reach below it, likewise."""
    return float(-_outline(text).vertices[:, 1].min())


@cache
def _outline(text: str) -> _Outline:
    path = TextPath((0.0, 0.0), text, size=1.0)
    vertices = np.asarray(path.vertices, dtype=float)
    codes = np.asarray(path.codes, dtype=np.uint8)
    width = float(vertices[:, 0].max(initial=0.0))
    return _Outline(vertices, codes, width)
