"""Colours, line styles, quantities and texts that figures and the report share.

Colours are Okabe and Ito's, which colour-blind readers can distinguish; line styles and markers
distinguish the same curves in grey. This module does not import Matplotlib.
"""

from __future__ import annotations

from math import log10
from typing import Any

from trajopt.core.limits import LimitName

BLACK = "#000000"
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
ORANGE = "#E69F00"
PURPLE = "#CC79A7"
SKY = "#56B4E9"
GREY = "#8C8C8C"
CURVES = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, BLACK, SKY)
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")

QUANTITIES: tuple[LimitName, ...] = ("position", "velocity", "acceleration", "jerk")
"""By the order of the derivative; `Problem.unit` has their units."""
ZERO_WIDTH_SPACE = "\u200b"
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
TITLE_LENGTH = 80  # characters: what fits over the widest figure

STYLE_SHEET: dict[Any, Any] = {
    "font.family": "sans-serif",
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "axes.linewidth": 0.6,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "legend.handlelength": 3.0,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "svg.fonttype": "none",
    "svg.hashsalt": "trajopt",
    "pdf.fonttype": 42,  # TrueType: what publishers accept
}


def text(name: str) -> str:
    """A name as Matplotlib draws it, character by character.

    Dollar signs start no formula, a leading underscore hides nothing from a legend, and what
    cannot be printed (line breaks, escape sequences, lone surrogates) is a space.
    """
    printable = "".join(c if c.isprintable() else " " for c in name)
    words = " ".join(printable.split())
    literal = words.replace("$", r"\$")
    if literal.startswith("_"):
        return f"{ZERO_WIDTH_SPACE}{literal}"
    return literal


def headline(name: str, rest: str = "") -> str:
    """A name and what is said of it, on one line: a name too long for that is cut."""
    room = max(20, TITLE_LENGTH - len(rest))
    if len(name) > room:
        return f"{name[: room - 1]}…{rest}"
    return f"{name}{rest}"


def power_of_ten(value: float, _: object = None) -> str:
    """A tick's number on a log axis, 10⁴; Matplotlib passes its place too."""
    exponent = f"{log10(value):.0f}"
    return f"10{exponent.translate(_SUPERSCRIPTS)}"


def plain(value: float, _: object = None) -> str:
    """A tick's number as a person writes it; Matplotlib passes its place too."""
    return f"{value:g}".replace("-", "−")
