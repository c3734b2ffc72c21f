"""The jerk-limited program from several starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baselines.exact.interior_point import Iterate, begun, converged, descended
from baselines.exact.jerk_cells import Cells, Rows
from baselines.exact.scaled import Scaled
from baselines.exact.several_starts import Optimum
from trajopt.core.arrays import Array, Bools

Start = tuple[Array, Array, Array]  # segment times, inner waypoint velocities and accelerations

# Tolerances where rounding stops the method, relative to its own.
ACCEPTED = 100.0
# Gap of the point on the way to the optimum that goes with it, relative to the last.
EARLIER = 50.0


def minimised(scaled: Scaled, starts: Sequence[Start]) -> list[Optimum]:
    """The local optimum near each start."""
    cells = Cells(scaled, kinds=2)
    columns = [
        np.array(column)
        for column in zip(
            *starts,
            strict=True,
        )
    ]
    passed = []

    def arrived(iterate: Iterate) -> Bools:
        passed.append((iterate.state.gap, iterate.state.rows.point))
        return converged(iterate)

    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        iterate = descended(begun(Rows(cells, cells.start(*columns))), arrived)
        accepted = converged(iterate, ACCEPTED)
    gaps, points = zip(
        *passed,
        strict=True,
    )
    wide = np.array(gaps) >= EARLIER * gaps[-1]
    optima = []
    for start, good in enumerate(accepted.tolist()):
        steps = np.flatnonzero(wide[:, start])
        own = [points[steps[-1] if len(steps) else 0], points[-1]]
        times = np.exp([point.log[start] for point in own])
        states = np.array([(point.velocity[start], point.acceleration[start]) for point in own])
        duration = times[-1].sum() if good else np.inf
        status = "Converged" if good else "Not_Converged"
        optima.append(Optimum(duration, times, states, status))
    return optima
