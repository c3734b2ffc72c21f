"""Parameters that several commands have, and numbers that are taken as given or refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

from cyclopts import Parameter, Token
from cyclopts.validators import Number

from trajopt.core import numerals
from trajopt.core.interpolation import Interpolation

MAX_SECONDS = 1e8  # three years: beyond, the system's clocks overflow
_MAX_SEED = 2**63 - 1  # the largest integer that the store holds


def _whole(type_: Any, tokens: Sequence[Token]) -> int:
    return numerals.whole(tokens[0].value)


def _decimal(type_: Any, tokens: Sequence[Token]) -> float:
    return numerals.decimal(tokens[0].value)


def whole_number(help: str, *, least: int | None = None, most: int | None = None) -> Parameter:
    """A parameter that is a whole number from `least` to `most`."""
    return Parameter(help=help, converter=_whole, validator=Number(gte=least, lte=most))


def number(
    help: str, *, above: float | None = None, least: float | None = None, most: float | None = None
) -> Parameter:
    """A parameter that is a finite number above `above`, from `least` to `most`."""
    return Parameter(help=help, converter=_decimal, validator=Number(gt=above, gte=least, lte=most))


def beside(results: Path, name: str) -> Path:
    """Return the path of a file made of results: in their folder, or beside their file."""
    folder = results.parent if results.is_file() else results
    return folder / name


ProblemName = Annotated[
    str, Parameter(help="Built-in name, problem file (.toml), or waypoints with limits.")
]
PlannerSpec = Annotated[
    str, Parameter(help="NAME or FILE.py:NAME, with :key=value,… behind it; see `trajopt list`.")
]
Seed = Annotated[
    int, whole_number("Seed of the random stream of stochastic planners.", least=0, most=_MAX_SEED)
]
Json = Annotated[bool, Parameter(help="Print one JSON object and nothing else.")]
MotionFile = Annotated[
    Path, Parameter(help="Samples (.csv), a JointTrajectory (.yaml, .json) or polynomials (.json).")
]
InterpolationName = Annotated[
    Interpolation,
    Parameter(help="What joins the samples; auto: what a controller does with what they have."),
]
Noise = Annotated[
    float, number("Standard deviation of the noise of a log's positions, rad (m).", least=0)
]
Window = Annotated[
    float,
    number("A log counts as kept if an excess of 5 % over so many s would show.", above=0),
]
LogOut = Annotated[
    Path | None,
    Parameter(name="--out", help="Write a log's motion within its digits: .csv or .json."),
]
Force = Annotated[bool, Parameter(help="Overwrite the file of --out.")]
