"""Ways to forge a proof: records whose stored proof claims three times the best known duration.

Each is an honest record whose proof was changed, or replaced, by what some rounding, some unit or
some careless reading might let pass. Its text is what a stranger could submit.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator, Sequence
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue

Said = dict[str, Any]
Named = tuple[str, Said]

PROBLEMS = ("six-axis", "jerk-limit", "position-limits")
"""Velocity and acceleration limits; jerk limits too; position limits too."""

CLAIMED = 3.0
"""Of the best known duration: what each forgery asks to be believed."""

_LEAF = [3, 0, 0, 0]
_SUBNORMAL = 5e-324
# Text that stands in the file as it is: JSON cannot say it otherwise.
_RAW = "raw:"
# A key that stands in the file once more.
_AGAIN = "again:"


@dataclass(frozen=True)
class Forgery:
    """A record's text with a forged proof.

    Attributes:
        name: What was forged, and of which problem.
        text: Of the file.
        duration: Of the best known motion, s: a bound above it is false.
    """

    name: str
    text: str
    duration: float


def forgeries(problem: str) -> list[Forgery]:
    """Every forgery of every family, of one built-in problem's record."""
    honest = record(problem)
    found = []
    for family in FAMILIES:
        for name, said in family(honest):
            forged = Forgery(f"{problem}: {name}", text(said), honest["duration"])
            found.append(forged)
    return found


def record(problem: str) -> Said:
    """What the recorded file of a built-in problem says."""
    file = records.file_of(catalogue.load(problem))
    assert file is not None
    said: Said = json.loads(file.read_text(encoding="utf-8"))
    return said


def text(said: Said) -> str:
    """As JSON, with what is no JSON where it is asked for."""
    plain = json.dumps(said)
    plain = re.sub(f'"{_RAW}([^"]*)"', r"\1", plain)
    return plain.replace(_AGAIN, "")


# --- building blocks ---


def changed(honest: Said, **tables: Any) -> Said:
    """The honest proof with other tables, asked about three times the best known duration."""
    said = deepcopy(honest)
    cutoff = CLAIMED * said["duration"]
    said["lower_bound"] = cutoff
    said["proof"]["cutoff"] = [cutoff]
    said["proof"].update(tables)
    return said


def one_leaf(honest: Said, **tables: Any) -> Said:
    """A proof of nothing but one leaf without a row, with other tables."""
    said = changed(honest)
    proof = said["proof"]
    for name in proof.keys() - {"units", "cutoff"}:
        proof[name] = []
    proof["steps"] = [_LEAF]
    proof.update(tables)
    return said


def one_row(
    honest: Said,
    cells: Sequence[Any],
    multiplier: float,
    time_unit: float,
    length_unit: float,
) -> Said:
    """A leaf with one row of costates: of the segment and joint that go farthest upwards."""
    places = np.array(honest["problem"]["waypoints"])
    ways = np.diff(places, axis=0)
    ways = ways[:, np.ptp(places, axis=0) > 0]
    segment, joint = divmod(int(ways.argmax()), ways.shape[1])
    return one_leaf(
        honest,
        units=[time_unit, *[length_unit] * ways.shape[1]],
        cuts=[[segment, joint, len(cells)]],
        cells=cells,
        steps=[[3, 0, 0, 1]],
        multipliers=[[_box_rows(honest, *ways.shape), multiplier]],
    )


def _box_rows(honest: Said, segments: int, joints: int) -> int:
    """The cut-off's, the secants', and McCormick's of joints with jerk limits."""
    jerky = joints if "jerk" in honest["problem"]["limits"] else 0
    return 1 + 2 * segments + 8 * (segments - 1) * jerky


def edited(honest: Said, table: str, change: Callable[[Any], Any]) -> Said:
    """One table of the honest proof changed."""
    rows = deepcopy(honest["proof"][table])
    new = change(rows)
    return changed(honest, **{table: new})


def with_first(honest: Said, table: str, column: int, value: Any) -> Said:
    """The first row of a table with another number."""
    said = changed(honest)
    said["proof"][table][0][column] = value
    return said


def thirds(slope: float, p: float = 0.0, q: float = 0.0) -> list[list[float]]:
    """Three cells with one `λ`, `p` and `q`."""
    return [[start, p, 0, 0, q, 0, slope] for start in (0, 0.34, 0.67)]


# --- the forgeries, a family a function ---


def too_small(honest: Said) -> Iterator[Named]:
    """Numbers whose products are 0 in binary arithmetic, and are not."""
    t = honest["proof"]["units"][0]
    tiny = 2.0**-400
    yield "a subnormal λ", one_row(honest, thirds(_SUBNORMAL), 1e300, t, tiny)
    yield "a small λ", one_row(honest, thirds(1e-320), 1e300, t, tiny)
    yield "a λ as small as a proof's may be", one_row(honest, thirds(2.0**-128), 1e38, t, 2.0**-128)
    line = [[start, 0, 0, 0, -_SUBNORMAL * start, -_SUBNORMAL, 1e-320] for start in (0, 0.5)]
    yield "a subnormal q", one_row(honest, line, 1e300, t, tiny)
    bent = [[start, _SUBNORMAL, 0, 0, 0, 0, 1e-320] for start in (0, 0.5)]
    yield "a subnormal p", one_row(honest, bent, 1e300, t, tiny)
    yield "p and q at once", one_row(honest, thirds(1e-322, 1e-322, 1e-322), 1e300, t, tiny)
    jump = [[0, 0, 0, 0, 0, 0, 0], [0.5, 0, 0, 0, 0, 0, _SUBNORMAL]]
    yield "λ that jumps by subnormal numbers", one_row(honest, jump, 1e300, t, tiny)
    narrow = [[0, 0, 0, 0, 0, 0, 1], [1e-320, 0, 0, 0, 0, 0, 1]]
    yield "cells of no width to speak of", one_row(honest, narrow, 1e300, t, tiny)
    small = [[row, 1e-310] for row, _ in honest["proof"]["multipliers"]]
    yield "subnormal multipliers", changed(honest, multipliers=small)
    places = [[k, 1e-200] for k, _ in honest["proof"]["tangents"]]
    yield "tangents at 1e-200", changed(honest, tangents=places)


def too_large(honest: Said) -> Iterator[Named]:
    """Numbers whose products are infinite, or whose differences are none."""
    t = honest["proof"]["units"][0]
    yield "λ = 1e300", one_row(honest, thirds(1e300), 1e300, t, 1.0)
    huge = [[0, 1e300, -1e300, 1e300, 1e300, -1e300, 1e300]]
    yield "costates of 1e300 that cancel", one_row(honest, huge, 1.0, t, 1.0)
    large = [[row, 1.7e308] for row, _ in honest["proof"]["multipliers"]]
    yield "multipliers of 1.7e308", changed(honest, multipliers=large)
    places = [[k, 1e200] for k, _ in honest["proof"]["tangents"]]
    yield "tangents at 1e200", changed(honest, tangents=places)
    yield "a step to 1e300", one_leaf(honest, steps=[[0, 0, 1e300, 0], _LEAF])
    for name, cutoff in (("1e308", 1e308), ("subnormal", _SUBNORMAL), ("negative", -1.0)):
        yield f"a cut-off that is {name}", changed(honest, cutoff=[cutoff])
    yield "two cut-offs", changed(honest, cutoff=[1.0, CLAIMED * honest["duration"]])
    yield "no cut-off", changed(honest, cutoff=[])
    for number in ("NaN", "Infinity", "-Infinity", "1e999", "1" + 400 * "0", "true", "null"):
        raw = _RAW + number
        yield f"{number:.9} as a multiplier", with_first(honest, "multipliers", 1, raw)
        yield f"{number:.9} in a cell", with_first(honest, "cells", 6, raw)
        yield f"{number:.9} as the cut-off", changed(honest, cutoff=[raw])


def other_units(honest: Said) -> Iterator[Named]:
    """Units in which limits are infinite, squares are 0, or numbers another's."""
    _, *lengths = honest["proof"]["units"]
    for time, length in (
        (30, -1022),
        (0, -1022),
        (0, 1000),
        (560, 0),
        (560, 560),
        (-560, -560),
        (600, 1000),
        (400, 800),
        (-300, 0),
        (1023, 1023),
        (-1074, -1074),
        (127, 127),
        (-128, -128),
        (100, -128),
        (-100, 127),
    ):
        units = [2.0**time, *[2.0**length] * len(lengths)]
        yield f"units of 2^{time} s and 2^{length} rad", one_leaf(honest, units=units)
        yield f"the same and the honest rows, 2^{time}, 2^{length}", changed(honest, units=units)

    def times(factor: float) -> Callable[[Any], Any]:
        return lambda units: [factor * unit for unit in units]

    yield "units twice as large", edited(honest, "units", times(2))
    yield "units of which none is a power of two", edited(honest, "units", times(1.5))
    yield "negative units", edited(honest, "units", times(-1))
    yield "units of 0", edited(honest, "units", times(0))
    yield "a unit too many", edited(honest, "units", lambda units: [*units, 1.0])
    yield "a unit too few", edited(honest, "units", lambda units: units[:-1])
    yield "a smaller unit of time", edited(honest, "units", lambda u: [u[0] / 8, *u[1:]])
    yield "a larger unit of time", edited(honest, "units", lambda u: [u[0] * 8, *u[1:]])


def cancelling(honest: Said) -> Iterator[Named]:
    """Large terms whose sum is rounding."""
    t = honest["proof"]["units"][0]
    many = np.linspace(0, 1, 20_001)[:-1]
    steps = [[start, 0, 0, 0, 0, 0, 1] for start in many.tolist()]
    yield "20,000 cells", one_row(honest, steps, 1.0, t, 1.0)
    swings = [[start, 0, 0, 0, 1e17 * (-1) ** i, 0, 1] for i, start in enumerate(many.tolist())]
    yield "20,000 jumps of 1e17", one_row(honest, swings, 1.0, t, 1.0)
    bump = [[0, 1e17, -4e17, 4e17, 4e17, -8e17, 8e17]]
    yield "a p and a q of 1e17 that cancel", one_row(honest, bump, 1e-17, t, 1.0)
    line = [[0, 0, 0, 0, 0.5e17, -1e17, 1e17]]
    yield "a q of 1e17 against λ", one_row(honest, line, 1e-17, t, 1.0)
    rows = honest["proof"]["multipliers"]
    twice = [[row, y * size] for row, y in rows for size in (1e17, -1e17)]
    yield "multipliers of both signs", _one_step(honest, twice)
    _, *lengths = honest["proof"]["units"]
    secants = [[row, 1e30] for row in range(_box_rows(honest, 3, len(lengths)))]
    yield "every row of the box 1e30 times", _one_step(honest, secants)
    thousand = [[row, 1e5 * y] for row, y in rows for _ in range(100)]
    yield "every row a hundred times", _one_step(honest, thousand)


def _one_step(honest: Said, multipliers: Sequence[Sequence[float]]) -> Said:
    leaf = [3, 0, 0, len(multipliers)]
    return changed(honest, steps=[leaf], multipliers=multipliers)


def boxes(honest: Said) -> Iterator[Named]:
    """Steps to boxes in which the motion is not, and trees that leave some out."""
    h = CLAIMED * honest["duration"] / honest["proof"]["units"][0]
    cases = {
        "a time raised without a row": [[0, 0, h, 0], _LEAF],
        "a time lowered without a row": [[1, 0, 1e-9, 0], _LEAF],
        "a time lowered below 0": [[1, 0, -1, 0], _LEAF],
        "an inverse raised without a row": [[0, 3, 1e9, 0], _LEAF],
        "a square lowered without a row": [[1, 6, 1e-9, 0], _LEAF],
        "a velocity lowered without a row": [[1, 9, -1e9, 0], _LEAF],
        "a branch without its upper leaf": [[2, 0, 1e9, 0], _LEAF],
        "a branch outside the box": [[2, 0, 1e9, 0], _LEAF, _LEAF],
        "a branch below the box": [[2, 0, -1, 0], _LEAF, _LEAF],
        "a branch of an inverse": [[2, 3, 1e-9, 0], _LEAF, _LEAF],
        "a branch of what is always 0": [[2, 10**3, 1, 0], _LEAF, _LEAF],
        "no step": [],
        "a leaf too many": [_LEAF, _LEAF],
        "only a step to a leaf": [[0, 0, h, 0]],
        "more multipliers than there are": [[3, 0, 0, 10**6]],
        "fewer than no multipliers": [[3, 0, 0, -1]],
        "a kind of 0.5": [[0.5, 0, h, 0], _LEAF],
        "a kind of 7": [[7, 0, h, 0], _LEAF],
        "a kind of -1": [[-1, 0, h, 0], _LEAF],
        "a variable of 0.5": [[0, 0.5, h, 0], _LEAF],
        "a variable of -1": [[0, -1, h, 0], _LEAF],
        "a count of 0.5": [[3, 0, 0, 0.5]],
    }
    for name, steps in cases.items():
        yield name, one_leaf(honest, steps=steps)


def rows(honest: Said) -> Iterator[Named]:
    """Rows of other segments, joints, numbers; costates that do not divide a segment."""
    for row in (3.5, -1, 10**18, 2**63, 1e30, -0.5):
        yield f"row {row}", with_first(honest, "multipliers", 0, row)
    large = [[row, 1e6 * y] for row, y in honest["proof"]["multipliers"]]
    yield "multipliers a million times as large", changed(honest, multipliers=large)
    negative = [[row, -1e6 * y] for row, y in honest["proof"]["multipliers"]]
    yield "negative multipliers", changed(honest, multipliers=negative)
    pairs = honest["proof"]["multipliers"]
    moved = [[pairs[i - 1][0], 1e3 * y] for i, (_, y) in enumerate(pairs)]
    yield "multipliers of other rows", changed(honest, multipliers=moved)
    for column, name in ((0, "segment"), (1, "joint")):
        for value in (-1, 0.5, 99):
            yield f"a row of {name} {value}", with_first(honest, "cuts", column, value)
    yield "a row without cells", with_first(honest, "cuts", 2, 0)
    yield "a row of half a cell", with_first(honest, "cuts", 2, 0.5)
    for start in (-0.5, 0.5, 1.0, 1e-9):
        yield f"a first cell that starts at {start}", with_first(honest, "cells", 0, start)
    yield "cells upside down", edited(honest, "cells", lambda cells: cells[::-1])
    mirrored = [[start, *(-x for x in own)] for start, *own in honest["proof"]["cells"]]
    yield "cells with the other sign", changed(honest, cells=mirrored)
    yield "cells of another row", edited(honest, "cells", lambda cells: cells[1:] + cells[:1])
    if "jerk" not in honest["problem"]["limits"]:
        yield "p where no jerk is limited", with_first(honest, "cells", 1, 1.0)
        yield "a ramp where no jerk is limited", changed(honest, ramps=[[0, 0, 1]])
    steps = [[0, 0, 0, 0, 0, 0, 0], [0.5, 0, 0, 0, 0, 0, 1]]
    t = honest["proof"]["units"][0]
    yield "λ that jumps where there is no wall", one_row(honest, steps, 1e6, t, 1.0)
    yield "λ that jumps down there", one_row(honest, steps[::-1], 1e6, t, 1.0)
    ramps = [[0, 0, side] for side in (2, -1, 0.5)]
    yield "ramps of other sides", changed(honest, ramps=ramps)
    yield "a square tangent at -1", changed(honest, square_tangents=[[0, -1]])
    yield "a tangent at -1", changed(honest, tangents=[[0, -1]])
    yield "a tangent at 0", changed(honest, tangents=[[0, 0]])


def truncated(honest: Said) -> Iterator[Named]:
    """Tables that end too early, or are none."""
    for table in ("cells", "cuts", "tangents", "multipliers", "steps", "units"):
        yield f"{table} cut in half", edited(honest, table, lambda rows: rows[: len(rows) // 2])
        yield f"{table} with a row too many", edited(honest, table, lambda rows: [*rows, rows[-1]])
        without = changed(honest)
        del without["proof"][table]
        yield f"no {table}", without
    yield "rows of other lengths", edited(honest, "cells", lambda rows: [rows[0][:3], *rows[1:]])
    flat = [number for row in honest["proof"]["cells"] for number in row]
    yield "cells in one row", changed(honest, cells=flat)
    yield "no proof", changed(honest) | {"proof": {}}
    closed = changed(honest) | {"proof": {}}
    closed["bound"] = closed["bound"] | {"method": "closed form"}
    yield "a bound in closed form that is none", closed


def twice(honest: Said) -> Iterator[Named]:
    """A key that stands in the file twice: once honest, once not."""
    for name in ("lower_bound", "duration", "proof", "trajectory"):
        said = changed(honest)
        said[_AGAIN + name] = said[name]
        yield f"{name} twice", said
    for name in ("multipliers", "units", "cells"):
        said = one_leaf(honest, units=[2.0**30, *[2.0**-1022] * 8][: len(honest["proof"]["units"])])
        said["proof"][_AGAIN + name] = said["proof"][name]
        yield f"{name} twice", said
    said = changed(honest)
    said["problem"][_AGAIN + "limits"] = said["problem"]["limits"]
    yield "limits twice", said


def other_problems(honest: Said) -> Iterator[Named]:
    """Proofs, or numbers, that are another problem's."""
    for name in (*PROBLEMS, "seven-waypoints", "reversal"):
        other = record(name)
        if other["problem"]["name"] != honest["problem"]["name"] and other["proof"]:
            yield f"the proof of {name}", changed(honest, **other["proof"])
    slow = changed(honest)
    for pairs in slow["problem"]["limits"].values():
        pairs[:] = [[low and low / 9, high and high / 9] for low, high in pairs]
    yield "limits of a slower robot under the same digest", slow
    long = changed(honest)
    long["problem"]["waypoints"] = [[9 * q for q in row] for row in long["problem"]["waypoints"]]
    yield "a longer way under the same digest", long


FAMILIES: tuple[Callable[[Said], Iterator[Named]], ...] = (
    too_small,
    too_large,
    other_units,
    cancelling,
    boxes,
    rows,
    truncated,
    twice,
    other_problems,
)
