"""Points of curves: trajectories with both sides of each break, searches as quartiles over runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.trajectory import Trajectory
from trajopt.views.analysis import statistics
from trajopt.views.analysis.curves import Curves

POINTS_PER_CURVE = 240
FEWEST_PER_PIECE = 5


def both_sides(trajectory: Trajectory, order: int, per_piece: int) -> tuple[Array, Array]:
    """Sample every polynomial piece, its ends included, so that jumps at breaks are vertical.

    Args:
        trajectory: what is sampled.
        order: of the derivative; 0 is position.
        per_piece: points of each piece, at least 2.

    Returns:
        Times `(pieces * per_piece,)` in seconds, each inner break twice, and the values there
        `(pieces * per_piece, joints)`: before a break, then after it.
    """
    coefficients = polynomials.derivative(trajectory.coefficients, order)
    durations = np.diff(trajectory.breaks)
    shares = np.linspace(0.0, 1.0, per_piece)
    local = shares[:, None] * durations  # s from the start of each piece
    by_joint = local[..., None]
    values = polynomials.evaluate(coefficients[:, None], by_joint)
    starts = trajectory.breaks[:-1]
    times = (starts + local).T.ravel()
    in_order = values.swapaxes(0, 1)  # (pieces, per_piece, joints)
    return times, in_order.reshape(-1, trajectory.joints)


def curve(trajectory: Trajectory, order: int) -> tuple[Array, Array]:
    """`both_sides` with as many points as a figure shows: straight pieces need their ends only."""
    coefficients = polynomials.derivative(trajectory.coefficients, order)
    straight = not coefficients[:-2].any()
    if straight:
        return both_sides(trajectory, order, per_piece=2)
    pieces = coefficients.shape[1]
    share = POINTS_PER_CURVE // pieces + 1
    return both_sides(trajectory, order, per_piece=max(FEWEST_PER_PIECE, share))


def over_runs(runs: Sequence[Array], points: int = 120) -> tuple[Array, Array]:
    """Quartiles over runs of the best duration by so many evaluations.

    Args:
        runs: per run `(m, 2)`: evaluations, and the best duration by then (NaN before the first).
        points: how many numbers of evaluations, evenly spaced on a log axis, at most.

    Returns:
        Evaluations `(points,)` and quartiles `(3, points)`. A run without an answer counts as
        infinitely long: a quartile is +inf until enough runs have one.
    """
    end = max(1.0, *(run[-1, 0] for run in runs))
    evaluations = np.unique(np.geomspace(1.0, end, points).round())
    return evaluations, statistics.quartiles_over_runs(runs, evaluations)


def bounded(curves: Mapping[str, tuple[Array, Array]]) -> Curves:
    """Return curves of quartiles whose upper one is drawn wherever there is a median.

    Where more than a quarter of the runs have no answer, the upper quartile is infinite: a band is
    drawn up to the largest number of all curves there.
    """
    top = max(np.max(q, where=np.isfinite(q), initial=0.0) for _, q in curves.values())
    found = {}
    for label, (spent, (low, middle, high)) in curves.items():
        endless = np.isfinite(middle) & np.isinf(high)
        found[label] = (spent, np.array([low, middle, np.where(endless, top, high)]))
    return found
