"""A figure for a dark page: a transparent ground, greys turned over, colours as they are.

dark(draw.overlaid(trials)).savefig("overlay-dark.png")
"""

from __future__ import annotations

from typing import Any

import matplotlib.colors
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.text import Text

from trajopt.core.arrays import Array

_PROPERTIES = ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor")
_GREY = 0.02  # largest difference of red, green and blue of a grey
# Lightness of what is white and of what is black on paper: the latter has 15:1 on the former.
_GROUND, _INK = 0.06, 0.93


def dark(figure: Figure) -> Figure:
    """Change a figure for a dark page, and return it: black becomes light, white becomes dark.

    The figure and its axes have no ground of their own. The colours of planners stay: they have at
    least 3:1 on black too.
    """
    figure.canvas.draw()  # the ticks are made when they are drawn
    for artist in figure.findobj():
        _turn_over(artist)
        box = artist.get_bbox_patch() if isinstance(artist, Text) else None
        if box is not None:
            _turn_over(box)
    for axes in figure.findobj(Axes):
        axes.tick_params(which="both", color=str(_INK), labelcolor=str(_INK))
        axes.patch.set_alpha(0)
    figure.patch.set_alpha(0)
    return figure


def _turn_over(artist: Artist) -> None:
    properties: dict[str, Any] = {}
    for name in _PROPERTIES:
        getter = getattr(artist, f"get_{name}", None)
        if getter is None or not hasattr(artist, f"set_{name}"):
            continue
        value = getter()
        if value is None or (isinstance(value, str) and value in ("none", "auto")):
            continue
        properties[name] = _turned(value)
    if properties:
        artist.set(**properties)


def _turned(value: Any) -> Array:
    """Return a colour, or several `(n, 4)`, with greys between ink and ground."""
    colours = np.array(matplotlib.colors.to_rgba_array(value))
    greys = np.ptp(colours[:, :3], axis=1) <= _GREY
    colours[greys, :3] = _INK + (_GROUND - _INK) * colours[greys, :3]
    return colours[0] if np.ndim(value) < 2 else colours
