"""Colours, line styles, quantities and texts that figures and the report share.

Colours are Okabe and Ito's, which colour-blind readers can distinguish, the light ones darkened to
3:1 on white; line styles and markers distinguish the same curves in grey. A planner of this toolkit
has one colour and mark everywhere. This module does not import Matplotlib.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain, count
from math import log10
from typing import Any

from trajopt.core.limits import LimitName

BLACK = "#000000"
BLUE = "#0072B2"
VERMILION = "#D55E00"
GREEN = "#009E73"
ORANGE = "#BF8300"
PURPLE = "#C8709F"
SKY = "#3399CC"
GREY = "#8C8C8C"
CURVES = (BLUE, VERMILION, GREEN, ORANGE, PURPLE, BLACK, SKY)
DASHES = ("-", (0, (5, 1.5)), (0, (1, 1.2)), (0, (6, 1.5, 1, 1.5)))
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">")

# Planners with a look of their own, by its place. A column is a kind of planner and a colour of
# `CURVES`: references, swarms, timing of a path, Ruckig, splines, users' own (the first of them),
# other optimisers. Marks and dashes differ within a column.
KNOWN = (
    *("exact", "issa", "toppra", "ruckig-stop", "spline353-nlp", "", "collocation"),
    *("exact-jerk", "pso", "copp", "ruckig-search", "spline", "", "drake-kto"),
    *("collocation-refined", "ssa", "totg", "", "unoptimised", "", "gcs"),
    *("prove", "cmaes", "totg-ruckig", "", "minsnap", "", ""),
    *("best-known", "de", "iterative-spline", "", "smooth", "", ""),
)
_OWN_FIRST = CURVES.index(BLACK)

# Names for readers who do not know this toolkit's.
SPOKEN = {
    "toppra": "TOPP-RA",
    "ruckig-stop": "Ruckig with stops",
    "ruckig-search": "Ruckig with searched waypoints",
    "issa": "ISSA + 3-5-3",
    "ssa": "SSA + 3-5-3",
    "pso": "PSO + 3-5-3",
    "spline353-nlp": "best 3-5-3 spline",
    "unoptimised": "3-5-3, unoptimised",
}

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


def places(labels: Iterable[str]) -> dict[str, int]:
    """Return the place of each planner's look.

    A planner of this toolkit has its own look, also with options. If two labels are of one planner,
    the one with fewer options has that look. Other labels get places after the toolkit's, with
    colours that no planner shown here has, as long as there are any.
    """
    order = list(dict.fromkeys(labels))
    found: dict[str, int] = {}
    taken: set[int] = set()
    for label in sorted(order, key=len):
        name = label.partition(":")[0]
        if name in KNOWN and (place := KNOWN.index(name)) not in taken:
            found[label] = place
            taken.add(place)
    colours = {place % len(CURVES) for place in taken}
    first = [len(KNOWN) + (_OWN_FIRST + i) % len(CURVES) for i in range(len(CURVES))]
    fresh = [place for place in first if place % len(CURVES) not in colours]
    rest = (place for place in count(len(KNOWN)) if place not in fresh)
    free = chain(fresh, rest)
    return {label: found[label] if label in found else next(free) for label in order}


def text(name: str) -> str:
    """Return text that Matplotlib draws as this name, character by character.

    Without it a dollar sign would start a formula, and a leading underscore would hide the name
    from a legend. Characters that cannot be printed (line breaks, escape sequences, lone
    surrogates) become spaces.
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
