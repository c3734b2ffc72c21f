"""A figure for a dark page: nothing of it is dark on dark, and colours of planners stay."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.colors import to_rgb, to_rgba
from matplotlib.figure import Figure

from trajopt.views.figures.dark import dark
from trajopt.views.figures.style import BLACK, CURVES

PAGE = "#0d1117"  # the ground of dark pages of GitHub


def luminance(colour):
    """WCAG 2's relative luminance."""
    share = np.array(to_rgb(colour))
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return linear @ [0.2126, 0.7152, 0.0722]


def contrast(colour):
    return (luminance(colour) + 0.05) / (luminance(PAGE) + 0.05)


def test_read_me_first():
    figure = Figure()
    axes = figure.subplots()
    (black,) = axes.plot([0, 1], color=BLACK)
    (hollow,) = axes.plot([1, 0], "o", color=CURVES[0], markerfacecolor="white")
    title = axes.set_title("durations")
    area = axes.fill_between([0, 1], [1, 2], color="0.55", alpha=0.4)
    dark(figure)
    assert figure.patch.get_alpha() == axes.patch.get_alpha() == 0
    shown = [black.get_color(), title.get_color(), axes.spines["left"].get_edgecolor()]
    shown += [tick.label1.get_color() for tick in axes.xaxis.get_major_ticks()]
    assert min(map(contrast, shown)) > 10
    assert to_rgba(hollow.get_color()) == to_rgba(CURVES[0])
    assert contrast(hollow.get_markerfacecolor()) < 1.1  # the page's own
    assert area.get_facecolor()[0, 3] == pytest.approx(0.4)


@pytest.mark.parametrize("colour", [own for own in CURVES if own != BLACK])
def test_the_colours_of_planners_are_seen_on_dark_pages(colour):
    assert contrast(colour) >= 3
