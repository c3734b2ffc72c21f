"""The content of one problem's panel: limits, convergence, and trajectories of median runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from trajopt.benchmark.trial import Trial
from trajopt.core.arrays import Array
from trajopt.core.limits import KINDS, Limit
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.explain.active_limits import Stretch, share_at_limits, stretches
from trajopt.views.analysis.searches import histories, searches
from trajopt.views.analysis.versions import by_label
from trajopt.views.figures.draw import median_run
from trajopt.views.figures.sampling import both_sides
from trajopt.views.figures.style import QUANTITIES
from trajopt.views.packing import rounded
from trajopt.views.report import suite_curves

POINTS = 200
LONGEST = 3  # number of intervals at a limit that are named


def panel(trials: Sequence[Trial], labels: Sequence[str], *, with_motions: bool) -> dict[str, Any]:
    """One problem's panel, ready for JSON. Joints count from 0 here; the page counts from 1."""
    problem = trials[0].problem
    found = histories(trials)
    best, histories_by_label = found
    searching = searches([found])
    runs = {label: own for label, own in histories_by_label.items() if label in searching}
    quantities = QUANTITIES if problem.has("jerk") else QUANTITIES[:3]
    orders = range(len(quantities))
    widest = problem.limits.in_all_segments(tightest=False)
    own = {name: getattr(problem.limits, name) for name in quantities}
    by_segment = {name: pairs for name, pairs in own.items() if pairs.ndim == 3}
    motions = []
    if with_motions:
        medians = {label: median_run(own) for label, own in by_label(trials).items()}
        for place, label in enumerate(labels):
            if trial := medians.get(label):
                motions.append(_motion(trial, place, len(quantities)))
    return {
        "joints": problem.joints,
        "names": list(problem.joint_labels),
        "waypoints": problem.waypoints,
        "quantities": [(name, problem.shared_unit(n)) for n, name in enumerate(quantities)],
        "units": [[problem.unit(joint, n) for n in orders] for joint in range(problem.joints)],
        "limits": {name: getattr(widest, name) for name in quantities},
        "segments": by_segment,
        "spans": {
            name: [
                problem.limits.kinds[name].of_joint(joint, problem)
                for joint in range(problem.joints)
            ]
            for name in by_segment
        },
        "others": [
            (own.name(), [own.of_joint(joint, problem) for joint in range(problem.joints)])
            for own in _without_a_quantity(problem)
        ],
        "source": problem.source,
        "best": best,
        "convergence": suite_curves.bands(runs, labels),
        "motions": motions,
    }


def _motion(trial: Trial, planner: int, orders: int) -> dict[str, Any]:
    trajectory = trial.certified_trajectory
    assert trajectory is not None
    times, values = sampled(trajectory, orders)
    busy, held = use(trial.problem, trajectory)
    return {
        "planner": planner,
        "trial": trial.id,
        "seed": trial.seed,
        "t": rounded(times, 5),
        "values": [[rounded(joint) for joint in order] for order in values],
        "uses": [(name, rounded(own, 3)) for name, own in _uses(trial.problem, trajectory, times)],
        "passed": trajectory.waypoint_times,
        "busy": busy,
        "held": held,
    }


def _without_a_quantity(problem: Problem) -> list[Limit]:
    """Return the limits that are no lines in the charts of positions and their derivatives."""
    return [own for key, own in problem.limits.kinds.items() if key not in QUANTITIES]


def _uses(problem: Problem, trajectory: Trajectory, times: Array) -> Iterator[tuple[str, Array]]:
    """Names and uses, at times (s), of the limits whose use the page cannot compute itself."""
    for limit in _without_a_quantity(problem):
        for joint, use in limit.along(trajectory, times).items():
            name = "" if joint is None else f"{problem.joint_labels[joint]} "
            yield f"{name}{limit.short}", use


def sampled(trajectory: Trajectory, orders: int, points: int = POINTS) -> tuple[Array, Array]:
    """Sample a trajectory and its derivatives at the same times.

    Args:
        trajectory: what is sampled.
        orders: how many derivatives, position included.
        points: how many times at most.

    Returns:
        Times `(m,)` in seconds, and values `(orders, joints, m)`. Breaks are there twice, before
        and after a jump, unless there are too many of them.
    """
    pieces = len(trajectory.breaks) - 1
    if 2 * pieces > points:
        times = np.linspace(0.0, trajectory.duration, points)
        values = [trajectory(times, order) for order in range(orders)]
    else:
        values = []
        for order in range(orders):
            times, own = both_sides(trajectory, order, points // pieces)
            values.append(own)
    by_joint = [own.T for own in values]
    return times, np.stack(by_joint)


def use(problem: Problem, trajectory: Trajectory) -> tuple[float, list[Stretch]]:
    """Return the share of time with a joint at a limit of motion, and the three longest intervals.

    Interruptions of the intervals shorter than 1 % of the duration are ignored.
    """
    motion = []
    for own in stretches(problem, trajectory):
        if KINDS[own.limit].is_ratio:
            motion.append(own)
    longest = sorted(motion, key=lambda own: own.start - own.end)
    share = share_at_limits(problem, trajectory)
    return share, longest[:LONGEST]
