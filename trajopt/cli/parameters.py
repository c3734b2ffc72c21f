"""Parameters that several commands have, and numbers that are taken as given or refused."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar

from cyclopts import Group, Parameter, Token
from cyclopts.validators import Number

from trajopt.core import numerals
from trajopt.core.interpolation import Interpolation

T = TypeVar("T")
MAX_SECONDS = 1e8  # three years: beyond, the system's clocks overflow
_MAX_SEED = 2**63 - 1  # the largest integer that the store holds


def _whole(type_: Any, tokens: Sequence[Token]) -> int:
    return numerals.whole(tokens[0].value)


def _decimal(type_: Any, tokens: Sequence[Token]) -> float:
    return numerals.decimal(tokens[0].value)


def whole_number(
    help: str, *, least: int | None = None, most: int | None = None, group: Group | None = None
) -> Parameter:
    """A parameter that is a whole number from `least` to `most`."""
    limits = Number(gte=least, lte=most)
    return _grouped(Parameter(help=help, converter=_whole, validator=limits), group)


def number(
    help: str,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
    group: Group | None = None,
) -> Parameter:
    """A parameter that is a finite number above `above`, from `least` to `most`."""
    limits = Number(gt=above, gte=least, lte=most)
    return _grouped(Parameter(help=help, converter=_decimal, validator=limits), group)


def _grouped(found: Parameter, group: Group | None) -> Parameter:
    """Put a parameter into a group of the help; without one it takes its class's."""
    return found if group is None else Parameter.combine(found, Parameter(group=group))


def beside(results: Path, name: str) -> Path:
    """Return the path of a file made of results: in their folder, or beside their file."""
    folder = results.parent if results.is_file() else results
    return folder / name


# Groups of options in a command's help, in this order.
CONTENDERS = Group("Planners and problems", sort_key=1)
ROBOT = Group("Robot and units", sort_key=2)
RUNNING = Group("Running", sort_key=3)
WRITING = Group("Writing", sort_key=4)

Planning = Annotated[T, Parameter(group=CONTENDERS)]
Running = Annotated[T, Parameter(group=RUNNING)]
Writing = Annotated[T, Parameter(group=WRITING)]

ProblemName = Annotated[
    str, Parameter(help="Built-in name, problem file (.toml), or waypoints with limits.")
]
PlannerSpec = Annotated[
    str, Parameter(help="NAME or FILE.py:NAME, with :key=value,… behind it; see `trajopt list`.")
]
Seed = Annotated[
    int, whole_number("Seed of the random stream of stochastic planners.", least=0, most=_MAX_SEED)
]
Timeout = Annotated[
    float,
    number("Seconds after which the planner is stopped.", least=1, most=MAX_SECONDS),
]
Json = Annotated[
    bool,
    Parameter(help="Print one JSON object and nothing else.", group=WRITING, show_default=False),
]
MotionFile = Annotated[
    Path, Parameter(help="Samples (.csv), a JointTrajectory (.yaml, .json) or polynomials (.json).")
]
InterpolationName = Annotated[
    Interpolation,
    Parameter(help="How samples are joined; auto: as a controller would join them."),
]
Noise = Annotated[
    float | None,
    number("Standard deviation of the noise of a log's positions, rad (m).", least=0),
]
Resolution = Annotated[
    float | None, number("Step of the sensors of a log's positions, rad (m).", above=0)
]
Commanded = Annotated[
    bool | None,
    Parameter(
        name="--commanded",
        negative="--measured",
        help="A log's positions were sent: known to their digits. Or measured.",
    ),
]
Window = Annotated[
    float,
    number("Time, s, over which `kept` excludes an excess of 5 %.", above=0),
]
LogOut = Annotated[
    Path | None,
    Parameter(name="--out", help="Write a log's motion within its half widths, as plan --out."),
]
Force = Annotated[bool, Parameter(help="Overwrite the file of --out.")]
