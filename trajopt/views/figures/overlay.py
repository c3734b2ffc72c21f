"""Motions of several planners on one time axis: one joint's position, the hardest used limit."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trajopt.core.problem import Problem
from trajopt.views.figures.explanation import highest_use
from trajopt.views.figures.plots import Look, Picture, planner_look, styled
from trajopt.views.figures.sampling import curve
from trajopt.views.figures.shown_motion import ShownMotion as ShownMotion
from trajopt.views.figures.style import text

WIDTH_IN = 5.6  # narrow, so that its texts are legible on a phone
HEIGHT_IN = 4.4
LABEL_LINE = 0.09  # height of a line of a label, share of the upper panel's height
MAX_ROWS = 2  # of labels of two lines each
LABEL_CHARACTER = 0.0155  # width of a character, roughly, share of the panel's width
EQUAL_RTOL = 1e-3  # durations closer than this are said to be equal
LABEL_SHIFT = 0.4  # share of a label's width by which it may stand right of its motion's end
FONT_PT = 9.5
TITLE_CHARACTERS = 66  # as many as surely fit the figure's width
CUT_OFF = 3.0  # times the shortest duration; slower motions are cut off, and say so by an arrow
EDGE = 1.3  # times the longest duration that is not cut off
FULL = 105.0  # %, of the axis of used limits


@styled
def overlay(
    problem: Problem, motions: Sequence[ShownMotion], order: Sequence[str] = (), title: str = ""
) -> Figure:
    """Draw one joint of several motions against time, with their waypoints and durations.

    Below is the highest use of any limit; where it is under 100 %, the motion could be faster. The
    joint is the one whose displacements take longest at its full velocity.

    Args:
        problem: Has the limits and waypoints.
        motions: The optimum first.
        order: All planners of the comparison, which have their colours in this order.
        title: Over the figure; by default how the longest and the shortest motion compare.
    """
    figure = Picture(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
    joint = _busiest(problem)
    angular = problem.joint_units[joint] == "rad" if problem.joint_units else True
    scale = np.degrees(1.0) if angular else 1.0
    labels = [motion.planner for motion in motions]
    known = [*order, *(label for label in labels if label not in order)]
    ends = []
    durations = [motion.trajectory.duration for motion in motions]
    alike = max(own for own in durations if own <= CUT_OFF * min(durations))
    shown_until = min(max(durations), EDGE * alike)
    for place, motion in enumerate(motions):
        colour = planner_look(motion.planner, known)["color"]
        on_top = place == 0
        look: Look = {"color": colour, "lw": 1.2 if on_top else 2.4, "zorder": 2.5 if on_top else 2}
        trajectory = motion.trajectory
        times, positions = curve(trajectory, 0)
        upper.plot(times, scale * positions[:, joint], **look)
        passed = trajectory.waypoint_times
        places = scale * problem.waypoints[:, joint]
        upper.plot(passed, places, "o", mec=colour, mfc="white", ms=5, mew=1.2, zorder=3)
        times, use = highest_use(problem, trajectory)
        lower.plot(times, 100 * use, **look | {"lw": 1.0 if on_top else 1.8})
        beyond = " →" if trajectory.duration > shown_until else ""
        said = f"{text(motion.name)}\n{trajectory.duration:.2f} s{beyond}"
        ends.append((min(trajectory.duration, shown_until), float(places[-1]), said, colour))
    upper.set_xlim(-0.02 * shown_until, 1.12 * shown_until)
    _name_ends(upper, ends)
    unit = "deg" if angular else problem.unit(joint)
    upper.set_ylabel(f"{problem.joint_labels[joint]} ({unit})")
    lower.set_ylabel("hardest used\nlimit (%)")
    lower.set_xlabel("time (s)")
    lower.set_ylim(0, FULL)
    lines = wrap(title or _said(problem, motions), TITLE_CHARACTERS)
    figure.suptitle("\n".join(map(text, lines)), x=0.01, ha="left", fontsize=FONT_PT)
    for axes in (upper, lower):
        axes.tick_params(labelsize=FONT_PT - 1)
        for label in (axes.xaxis.label, axes.yaxis.label):
            label.set_fontsize(FONT_PT)
    return figure


def _busiest(problem: Problem) -> int:
    """Return the joint whose displacements take longest at its full velocity."""
    way = np.abs(problem.displacements).sum(axis=0)
    return int(np.argmax(way / problem.limits.in_all_segments().velocity.max(axis=1)))


def _said(problem: Problem, motions: Sequence[ShownMotion]) -> str:
    """Say how the motions compare."""
    durations = [motion.trajectory.duration for motion in motions]
    longest = int(np.argmax(durations))
    ratio = durations[longest] / min(durations)
    if ratio <= 1 + EQUAL_RTOL:
        return f"Same {len(problem.waypoints)} waypoints, same limits: all take as long"
    more = f"{ratio:.1f} times" if ratio > 1.5 else f"{100 * (ratio - 1):.1f} % more than"
    name = motions[longest].name
    equal = durations[0] <= min(durations) * (1 + EQUAL_RTOL)
    best = motions[0 if equal else int(np.argmin(durations))]
    shortest = "the optimum" if best.planner == "exact" else best.name
    waypoints = f"Same {len(problem.waypoints)} waypoints, same limits"
    return f"{waypoints}: {name} takes {more} {shortest}"


def _name_ends(axes: Axes, ends: Sequence[tuple[float, float, str, str]]) -> None:
    """Write each motion's name and duration below its end; names that would touch are moved.

    A name and its duration are two lines; where that needs many rows, they are one.
    """
    low, high = axes.get_ylim()
    lines = 2
    placed = _placed(axes, ends)
    if max(row for _, row, _, _ in placed) >= MAX_ROWS:
        lines = 1
        placed = _placed(axes, [(*own[:2], own[2].replace("\n", " "), own[3]) for own in ends])
    step = (lines + 0.2) * LABEL_LINE
    rows = 1 + max(row for _, row, _, _ in placed)
    needed = step * rows
    span = (high - low) / (1 - needed)
    lowest = min(end[1] for end in ends)
    falls = lowest < 0.5 * (low + high)
    shown = [tick for tick in axes.get_yticks() if low <= tick <= high]
    axes.set_yticks(shown)
    axes.set_ylim((high - span, high) if falls else (low, low + span))
    for centre, row, said, colour in placed:
        height = needed - step * row - 0.02
        if not falls:
            height = 1 - needed + step * (rows - row) - 0.02
        axes.text(
            centre,
            height,
            said,
            color=colour,
            ha="center",
            va="top",
            fontsize=FONT_PT,
            transform=axes.transAxes,
        )


def _placed(
    axes: Axes, ends: Sequence[tuple[float, float, str, str]]
) -> list[tuple[float, int, str, str]]:
    """Return each label's centre (share of the width), row, text and colour."""
    left, right = axes.get_xlim()
    rows: list[float] = []  # where each row of names ends, relative to the width
    placed = []
    for time, _, said, colour in sorted(ends):
        width = LABEL_CHARACTER * max(map(len, said.splitlines()))
        centre = min((time - left) / (right - left), 1 - width / 2)
        lefts = centre - width * (0.5 - LABEL_SHIFT)  # the farthest to the right that it may begin
        row = next((i for i, end in enumerate(rows) if end < lefts), len(rows))
        if row == len(rows):
            rows.append(0.0)
        centre = max(centre, rows[row] + width / 2)
        rows[row] = centre + width / 2 + 2 * LABEL_CHARACTER
        placed.append((centre, row, said, colour))
    return placed
