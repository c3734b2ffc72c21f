"""What is in one problem's panel: limits, convergence, and the trajectories of median runs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trajopt import polynomials
from trajopt.benchmark.analysis.searches import histories, searches
from trajopt.benchmark.figures.plots import QUANTITIES
from trajopt.benchmark.report import curves
from trajopt.benchmark.report.packing import rounded
from trajopt.benchmark.trial import Trial
from trajopt.explain.active_limits import stretches
from trajopt.problem import LimitName, Problem
from trajopt.trajectory import Trajectory

Array = NDArray[np.float64]

Span = tuple[float, float]  # start and end, s
Stretch = tuple[int, LimitName, float, float]  # joint from 0, limit, start and end, s

POINTS = 200


def panel(trials: Sequence[Trial], labels: Sequence[str], *, with_motions: bool) -> dict[str, Any]:
    """One problem's panel, ready for JSON. Joints count from 0 here; the page counts from 1."""
    problem = trials[0].problem
    found = histories(trials)
    searching = searches([found])
    runs = {label: own for label, own in found[1].items() if label in searching}
    groups: dict[str, list[Trial]] = {}
    for trial in trials:
        groups.setdefault(trial.label, []).append(trial)
    medians = [median_run(own) for own in groups.values()] if with_motions else []
    kinds = QUANTITIES if problem.has("jerk") else QUANTITIES[:3]
    return {
        "joints": problem.joints, "waypoints": problem.waypoints, "quantities": kinds,
        "limits": {name: getattr(problem.limits, name) for name, _ in kinds},
        "source": problem.source, "best": found[0],
        "convergence": curves.bands(runs, labels),
        "motions": sorted(
            (_motion(t, labels.index(t.label), len(kinds)) for t in medians if t),
            key=lambda motion: int(motion["planner"]),
        ),
    }  # fmt: skip


def median_run(runs: Sequence[Trial]) -> Trial | None:
    """The run with the median certified duration (the lower of two), of those that have one."""
    certified = [t for t in runs if t.certified_trajectory is not None]
    ordered = sorted(certified, key=lambda t: (t.certified_duration or np.inf, t.seed))
    return ordered[(len(ordered) - 1) // 2] if ordered else None


def _motion(trial: Trial, planner: int, orders: int) -> dict[str, Any]:
    trajectory = trial.certified_trajectory
    assert trajectory is not None
    times, values = sampled(trajectory, orders)
    busy, held = use(trial.problem, trajectory)
    return {
        "planner": planner, "trial": trial.id, "seed": trial.seed, "t": rounded(times, 5),
        "values": [[rounded(joint) for joint in order] for order in values],
        "passed": trajectory.waypoint_times, "busy": busy, "held": held,
    }  # fmt: skip


def sampled(trajectory: Trajectory, orders: int, points: int = POINTS) -> tuple[Array, Array]:
    """At most `points` times `(m,)`, and derivatives `(orders, joints, m)` at them.

    Breaks are there twice, before and after a jump, unless there are too many of them.
    """
    pieces = len(trajectory.breaks) - 1
    if 2 * pieces > points:
        times = np.linspace(0.0, trajectory.duration, points)
        return times, np.stack([trajectory(times, order).T for order in range(orders)])
    local = np.linspace(0.0, 1.0, points // pieces)[:, None] * np.diff(trajectory.breaks)
    derived = [polynomials.derivative(trajectory.coefficients, k) for k in range(orders)]
    found = [polynomials.evaluate(c[:, None], local[..., None]) for c in derived]
    joints = [f.swapaxes(0, 1).reshape(-1, trajectory.joints).T for f in found]
    return (trajectory.breaks[:-1] + local).T.ravel(), np.stack(joints)


def use(problem: Problem, trajectory: Trajectory) -> tuple[float, list[Stretch]]:
    """The share of its time with some joint at a limit of motion, and the longest three stretches.

    Interruptions shorter than 1 % of the duration are passed over in the stretches.
    """
    spans: dict[tuple[int, LimitName], list[Span]] = {}
    for joint, limit, start, end in stretches(problem, trajectory, joined=0.0):
        if limit != "position":
            spans.setdefault((joint, limit), []).append((start, end))
    busy = sum(b - a for a, b in _merged([s for own in spans.values() for s in own], 0.0))
    joined = [
        (*k, *s) for k, own in spans.items() for s in _merged(own, 0.01 * trajectory.duration)
    ]
    return busy / trajectory.duration, sorted(joined, key=lambda s: s[2] - s[3])[:3]


def _merged(spans: Sequence[Span], slack: float) -> list[Span]:
    merged: list[Span] = []
    for start, end in sorted(spans):
        if merged and start <= merged[-1][1] + slack:
            start, last = merged.pop()
            end = max(end, last)
        merged.append((start, end))
    return merged
