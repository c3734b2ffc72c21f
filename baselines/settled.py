"""From IPOPT's answer, which meets its bounds to a tolerance, to one that meets them exactly.

What an answer does not feel, IPOPT leaves off its bound by far more than its tolerance: where the
objective hardly depends on a ramp of 1e-5, the ramp remains. Here whatever is that close to a bound
is put on it, and the nearest point at which all equations hold then is found.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from baselines.ipopt import Array, Bounds, Program

if TYPE_CHECKING:
    import scipy

Bools = NDArray[np.bool_]

_MOST_STEPS = 5
_MISS_TOL = 1e-14
# Where equations depend on each other, the least step is the limit of this going to 0.
_DEPENDENCE = 1e-13


def settled(
    program: Program,
    start: Array,
    parameters: Array,
    bounds: Bounds,
    constraint_bounds: Bounds,
    near: float,
) -> Array | None:
    """The nearest point on all bounds that `start` is near to, by Gauss-Newton steps.

    None where they do not converge at once: such bounds contradict each other, or nearly.

    Args:
        program: whose variables, parameters and constraints these are.
        start: near an optimum.
        parameters: the problem's numbers.
        bounds: lowest and highest value of every variable.
        constraint_bounds: lowest and highest value of every constraint.
        near: distances below this count as none.
    """
    lowest, highest = bounds
    x = np.clip(start, lowest, highest)
    values, _ = program.linear(x, parameters)
    aim, active = _nearest_bound(values, constraint_bounds, near)
    x, fixed = _nearest_bound(x, bounds, near)
    free = ~fixed
    for _ in range(_MOST_STEPS):
        values, jacobian = program.linear(x, parameters)
        miss = (aim - values)[active]
        largest = np.abs(miss).max(initial=0.0)
        if largest <= _MISS_TOL:
            return x
        if not np.isfinite(largest):
            return None
        rows = jacobian[active][:, free]
        try:
            step = _least_step(rows, miss)
        except RuntimeError:  # SuperLU's word for a singular matrix
            return None
        x[free] += step
        x = np.clip(x, lowest, highest)
    return None


def _nearest_bound(values: Array, bounds: Bounds, near: float) -> tuple[Array, Bools]:
    """The values, those near a bound on it, and which they are; both bounds alike are always."""
    low, high = np.broadcast_arrays(*bounds, values)[:2]
    at_low = values - low < near
    at_high = high - values < near
    equal = low == high
    moved = np.where(at_high, high, values)
    moved = np.where(at_low | equal, low, moved)
    return moved, at_low | at_high | equal


def _least_step(rows: scipy.sparse.csr_array, miss: Array) -> Array:
    """The shortest step that makes up for `miss`, where equations allow it."""
    import scipy  # late: planners that are only listed need none of it

    # A Aᵀ y = miss, step = Aᵀ y
    squared = rows @ rows.T
    count = len(miss)
    regular = squared + _DEPENDENCE * scipy.sparse.eye_array(count)
    factors = scipy.sparse.linalg.splu(regular.tocsc())
    y = factors.solve(miss)
    left = miss - squared @ y
    y += factors.solve(left)
    return np.asarray(rows.T @ y)
