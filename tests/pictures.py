"""Trajectories, trials and text boxes that the tests of figures share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.trial import trials_of
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Planner, Relation
from trajopt.planners.registry import load


def motion_of(joints, jerk=False):
    """Every joint from 0 to 1 rad in 2 s: acceleration +1, then −1 rad/s²; asymmetric limits."""
    velocity = [[-1.5, 2.0 + joint] for joint in range(joints)]
    jerks = [50.0] * joints if jerk else None
    limits = Limits(velocity, [3.0] * joints, jerks)
    waypoints = np.repeat([[0.0], [0.5], [1.0]], joints, axis=1)
    pieces = np.array([[0.5, -0.5], [0.0, 1.0], [0.0, 0.5]])
    coefficients = np.repeat(pieces[:, :, None], joints, axis=2)
    times = [0.0, 1.0, 2.0]
    return Problem(waypoints, limits, "made-up"), Trajectory(times, coefficients, times)


def texts(figure):
    """Every text of a figure."""
    return [found.get_text() for found in figure.findobj(Text) if found.get_text()]


def overlaps(figure):
    """Pairs of visible texts whose boxes overlap by more than a point."""
    FigureCanvasAgg(figure).draw()
    hidden = set()
    for axes in figure.axes:
        for axis in (axes.xaxis, axes.yaxis):
            visible = set(axis._update_ticks())
            ticks = {*axis.majorTicks, *axis.minorTicks}
            hidden |= {tick.label1 for tick in ticks - visible}
    boxes = []
    for found in figure.findobj(Text):
        if found not in hidden and found.get_visible() and found.get_text().strip():
            boxes.append((found.get_text(), found.get_window_extent().padded(-1.0)))
    pairs = []
    for number, (name, box) in enumerate(boxes):
        pairs += [(name, other) for other, its in boxes[:number] if box.overlaps(its)]
    return pairs


@dataclass(frozen=True)
class Sleepy(Planner):
    """A stochastic planner: the unoptimised answer, later with every seed; seed 3 fails."""

    stochastic = True

    def relation(self, problem):
        return Relation.RESTRICTION

    def solve(self, problem, *, seed=0):
        found = load("unoptimised").solve(problem).trajectory
        factor = 1 + seed / 10
        history = np.array([[1.0, np.nan], [10.0, 8.0 * factor], [99.0, 6.0 * factor]])
        if seed == 3:
            return Solution(Status.FAILED, history=history)
        return Solution(Status.SOLVED, found.dilated(factor), history=history)


def some_trials():
    """The exact optimum, one run of a planner, and four of another: its last one fails."""
    problem = catalogue.load("one-joint")
    exact = trials_of(load("exact"), problem, [0], "exact")
    once = trials_of(load("unoptimised"), problem, [0], "unoptimised")
    often = trials_of(Sleepy(), problem, range(4), "sleepy:deeply")
    return [*exact, *once, *often]
