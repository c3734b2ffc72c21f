"""The jerk-limited program from several starts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from baselines.exact.interior_point import begun, converged, descended
from baselines.exact.jerk_cells import Cells, Rows
from baselines.exact.scaled import Scaled
from baselines.exact.several_starts import Optimum
from trajopt.core.arrays import Array

Start = tuple[Array, Array, Array]  # segment times, inner waypoint velocities and accelerations

# Tolerances where rounding stops the method, relative to its own.
ACCEPTED = 100.0


def minimised(scaled: Scaled, starts: Sequence[Start]) -> list[Optimum]:
    """The local optimum near each start."""
    cells = Cells(scaled, kinds=2)
    columns = [np.array(column) for column in zip(*starts, strict=True)]
    # a method that diverges overflows: it has not converged
    with np.errstate(all="ignore"):
        iterate = begun(Rows(cells, cells.start(*columns)))
        iterate = descended(iterate, converged)
        accepted = converged(iterate, ACCEPTED)
    point = iterate.state.rows.point
    times = np.exp(point.log)
    states = np.stack([point.velocity, point.acceleration], axis=1)
    return [
        Optimum(float(own.sum()), own, state, "Converged")
        if good
        else Optimum(np.inf, own, state, "Not_Converged")
        for own, state, good in zip(times, states, accepted, strict=True)
    ]
