"""The race: several motions through the same waypoints on one clock, as one page without a network.

    write(problem, [ShownMotion("exact", "exact optimum", motion), ...], Path("race.html"))

Each motion has a picture of its arm (`trajopt.core.chain`), or a dial per joint where no link
frames are known; discs for its waypoints; and a bar for the use of each limit of each joint.
`fragment` is the same as a part of another page.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path

from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Problem
from trajopt.views import table_cells
from trajopt.views.figures.shown_motion import ShownMotion
from trajopt.views.packing import packed_json
from trajopt.views.race import course
from trajopt.views.race.course import Goal

WEB = Path(__file__).parent / "web"
_NARROW_KINDS = 3  # kinds of limits whose bars fit beside each other in half a phone's width
_EQUAL_RTOL = 5e-5  # above the goal by less is not said


def write(
    problem: Problem, motions: Sequence[ShownMotion], path: Path, *, notes: Sequence[str] = ()
) -> Path:
    """Write the page, and the folder that it is in; arguments as of `fragment`.

    Raises:
        OSError: The file cannot be written.
    """
    parts = {
        "race": fragment(problem, motions, notes=notes, level=1),
        "title": escape(_title(problem)),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(_filled("page.html", parts), encoding="utf-8")
    return path


def fragment(
    problem: Problem,
    motions: Sequence[ShownMotion],
    *,
    notes: Sequence[str] = (),
    level: int = 2,
    goal: Goal | None = None,
) -> str:
    """Return the race as HTML that works in any page: style and script belong to it alone.

    Args:
        problem: Has the limits and waypoints.
        motions: At least one, in the order in which they stand.
        notes: Sentences below, of planners that have no motion for example.
        level: Of its heading.
        goal: What durations are compared with; by default the best known (`course.goal`).

    Raises:
        InvalidInput: There is no motion.
    """
    if not motions:
        raise InvalidInput("motions", "at least one")
    goal = goal or course.goal(problem, motions)
    lanes = "".join(
        _lane(problem, motion, goal, course.colour(motion, motions)) for motion in motions
    )
    parts = {
        "h": f"h{level}",
        "title": escape(_title(problem)),
        "lead": escape(_lead(goal)),
        "wide": " wide" if len(problem.limits.kinds) > _NARROW_KINDS else "",
        "lanes": lanes,
        "notes": "".join(f"<p>{escape(note)}</p>" for note in notes),
        "style": _web("race.css"),
        "data": packed_json(course.data(problem, motions, goal)),
        "script": _web("race.js").replace("{{ yours }}", _web("yours.js")),
    }
    return _filled("race.html", parts)


def _filled(name: str, parts: Mapping[str, str]) -> str:
    """Return a template with its places filled; a text that looks like a place stays as it is."""
    return re.sub(r"\{\{ (\w+) \}\}", lambda place: parts[place[1]], _web(name))


def _title(problem: Problem) -> str:
    count = len(problem.waypoints)
    return f"{problem.name}: the same {count} waypoints, the same limits. Who is there first?"


def _lead(goal: Goal) -> str:
    return f"{goal.said} Bars: how much of each limit is used now; outlined: all of it."


def _lane(problem: Problem, motion: ShownMotion, goal: Goal, colour: str) -> str:
    """Return a motion's part of the page, which says its result without a script."""
    duration = motion.trajectory.duration
    times = "".join(
        f'<li data-time="{time!r}">{time:.2f}</li>'
        for time in motion.trajectory.waypoint_times.tolist()
    )
    above = duration / goal.duration - 1
    gap = f" <small>{table_cells.percent(above)}</small>" if abs(above) > _EQUAL_RTOL else ""
    return (
        f'<figure class="race-lane" style="--own:{colour}">'
        f"<figcaption><b>{escape(motion.name)}</b><span>{duration:.2f} s{gap}</span></figcaption>"
        f'<div class="race-arm" aria-hidden="true"></div>'
        f'<p class="race-status"></p><p>{escape(course.why(problem, motion))}</p>'
        f'<ol aria-label="{escape(motion.name)} passes the waypoints at, s">{times}</ol>'
        f'<div class="race-bars" aria-hidden="true"></div></figure>'
    )


def _web(name: str) -> str:
    return (WEB / name).read_text(encoding="utf-8").strip()
