"""Texts drawn as outlines stand where Matplotlib writes the same texts."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import pytest
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from trajopt.views.figures.words import Lettering, Words, depth, height


def ink(figure: Figure, artist: Artist) -> NDArray[np.float64]:
    """Left, right, upper and lower end of what is not white, pixels."""
    figure.add_artist(artist)
    canvas: Any = FigureCanvasAgg(figure)
    canvas.draw()
    pixels = np.asarray(canvas.buffer_rgba())[:, :, 0]
    rows, columns = np.nonzero(pixels < 128)
    return np.array([columns.min(), columns.max(), rows.min(), rows.max()], dtype=float)


@pytest.mark.parametrize("anchor", ["left", "center", "right"])
@pytest.mark.parametrize("upwards", [False, True])
@pytest.mark.parametrize("text", ["−0.25", "velocity (rad/s²)", r"a\$b_{x}"])
def test_an_outline_stands_where_matplotlib_writes_the_text(
    text: str, anchor: Literal["left", "center", "right"], upwards: bool
) -> None:
    words = Words(1.0, 1.0, text, 8.0, anchor, upwards)
    drawn = Figure((2, 2), dpi=200)
    written = Figure((2, 2), dpi=200)
    inches = drawn.dpi_scale_trans
    ends = ink(drawn, Lettering([words], inches))
    expected = ink(written, words.artist(written.dpi_scale_trans))
    np.testing.assert_allclose(ends, expected, atol=3.0)  # a hundredth of an inch and a half


def test_letters_reach_as_high_and_as_deep_as_they_do() -> None:
    """Of the em: capitals and digits of a sans-serif are about 0.73 of it, and no digit hangs."""
    assert height("0") == pytest.approx(0.73, abs=0.03)
    assert depth("p") == pytest.approx(0.21, abs=0.03)
    assert abs(depth("1")) < 0.02


def test_texts_are_found_and_blank_ones_are_no_error() -> None:
    figure = Figure((2, 2))
    inches = figure.dpi_scale_trans
    blank = Words(1, 1, "", 8, "left")
    lettering = Lettering([blank, Words(1, 1, "a", 8, "left")], inches)
    assert [text.get_text() for text in lettering.get_children()] == ["a"]  # type: ignore[attr-defined]
    figure.add_artist(Lettering([blank], inches))
    FigureCanvasAgg(figure).draw()
