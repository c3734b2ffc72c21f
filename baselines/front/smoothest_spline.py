"""The smoothest spline through the waypoints without limits.

Between the states at its ends a piece's integral is a quadratic form of its step and of the states
(docs/mathematics.md, section 12). So the states between given segment times solve one banded system
for all joints, and segment times are found by a descent, whose gradient needs no further system: at
the optimum the states' own derivatives are zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.linalg import solveh_banded
from scipy.optimize import minimize

from baselines.front.spline_program import hermite, inner, integrated
from trajopt.core.arrays import Array

# Shortest segment, relative to equal ones: shorter ones gain less than 1e-3.
_SHORTEST_SHARE = 1e-4
# Least share that a segment gets of the time that the shortest segments leave.
_LEAST_SHARE = 1e-9
# A descent that stalls among segments of very different lengths goes on when it begins anew.
_DESCENTS = 4
_GAIN_RTOL = 1e-10
# The descent ends where the integral changes by its rounding only.
_OPTIONS = {"maxiter": 2000, "maxcor": 30, "ftol": 1e-15, "gtol": 1e-9}


@dataclass(frozen=True, eq=False)
class SmoothestSpline:
    """The waypoints, and what is fixed at the ends.

    Attributes:
        q: Waypoints, `(segments + 1, joints)`.
        ends: Velocity (and acceleration) at both ends, `(2, joints)` each; the pieces are quintic
            if both are given, else cubic.
        weights: Of the joints in the integral, `(joints,)`.
        order: Order of the derivative whose square is integrated: 3 or 2.
    """

    q: Array
    ends: list[Array]
    weights: Array
    order: int

    def best_times(self, first: Array) -> Array:
        """Return segment times of the same sum with a locally least integral.

        Args:
            first: The times from which the descent starts, `(segments,)`.
        """
        best, value = first, self.least(first)[0]
        for _ in range(_DESCENTS):
            times = self._descent(best)
            reached = self.least(times)[0]
            gain = 1 - reached / value
            if gain > 0:
                best, value = times, reached
            if gain < _GAIN_RTOL:
                break
        return best

    def _descent(self, first: Array) -> Array:
        """Return where a descent ends; its variables are logarithms of what may be shared out."""
        shortest = _SHORTEST_SHARE * first.mean()
        rest = first.sum() - shortest * len(first)

        def shares(logarithms: Array) -> Array:
            own = np.exp(logarithms - logarithms.max())
            return np.asarray(own / own.sum(), dtype=float)

        def objective(logarithms: Array) -> tuple[float, Array]:
            own = shares(logarithms)
            value, rate, _ = self.least(shortest + rest * own)
            slope = rest * own * rate / value
            return float(np.log(value)), slope - own * slope.sum()

        start = np.log(np.maximum((first - shortest) / rest, _LEAST_SHARE))
        bounds = [(np.log(_LEAST_SHARE), 0.0)] * len(first)
        found = minimize(objective, start, jac=True, bounds=bounds, options=_OPTIONS)
        return shortest + rest * shares(found.x)

    def least(self, times: Array) -> tuple[float, Array, list[Array]]:
        """Return the least integral, its derivative by each segment time, and the states.

        Args:
            times: Of the segments, `(segments,)`.

        Returns:
            The integral, `(segments,)`, and position, velocity (and acceleration) at the
            waypoints, `(segments + 1, joints)` each.
        """
        count, rates = len(times), len(self.ends)
        form = _form(self.order, rates)
        powers = np.array([0, *range(1, rates + 1), *range(1, rates + 1)])
        sizes = times[:, None] ** powers
        heights = times ** (1 - 2 * self.order)
        local = heights[:, None, None] * sizes[:, :, None] * form * sizes[:, None, :]
        steps = np.diff(self.q, axis=0)
        states = np.zeros((count + 1, rates, self.q.shape[1]))
        states[[0, -1]] = np.stack(self.ends, axis=1)
        if count > 1:
            states[1:-1] = _interior(local, steps, states)
        own = np.concatenate([steps[:, None], states[:-1], states[1:]], axis=1)
        own = own * sizes[:, :, None]
        product = np.einsum("ij,kjm->kim", form, own)
        values = heights * ((own * product).sum(axis=1) @ self.weights)
        turned = heights * ((powers[:, None] * own * product).sum(axis=1) @ self.weights)
        rate = ((1 - 2 * self.order) * values + 2 * turned) / times
        return float(values.sum()), rate, [self.q, *np.moveaxis(states, 1, 0)]


def _interior(local: Array, steps: Array, states: Array) -> Array:
    """Return the states at the waypoints between, where the sum of the forms is least.

    Args:
        local: The form of each segment, of its step and the states at its ends.
        steps: Displacements of the segments, `(segments, joints)`.
        states: Those at the ends are known, the others zero, `(segments + 1, rates, joints)`.
    """
    count, rates = len(steps), states.shape[1]
    band = 2 * rates - 1  # a state meets those of its own waypoint and of both neighbours
    matrix = np.zeros((band + 1, rates * (count + 1)))
    right = -np.einsum("ki,kj->kij", local[:, 1:, 0], steps)
    own = np.concatenate([states[:-1], states[1:]], axis=1)
    right -= np.einsum("kij,kjm->kim", local[:, 1:, 1:], own)
    total = np.zeros(states.shape)
    total[:-1] += right[:, :rates]
    total[1:] += right[:, rates:]
    place = rates * np.arange(count)
    for i in range(2 * rates):
        for j in range(i, 2 * rates):
            matrix[band + i - j, place + j] += local[:, 1 + i, 1 + j]
    band = min(band, rates * (count - 1) - 1)
    inside = matrix[-band - 1 :, rates:-rates]
    # short segments make huge entries: with ones on the diagonal the system keeps its digits
    scale = 1 / np.sqrt(inside[band])
    for shift in range(band + 1):
        inside[band - shift, shift:] *= scale[shift:] * scale[: len(scale) - shift]
    flat = total[1:-1].reshape(-1, states.shape[2]) * scale[:, None]
    found = solveh_banded(inside, flat) * scale[:, None]
    return np.asarray(found.reshape(count - 1, rates, -1), dtype=float)


@lru_cache(maxsize=4)
def _form(order: int, rates: int) -> Array:
    """Return the quadratic form of the integral over a piece of length 1.

    Its variables are the step, then velocity (and acceleration) at the start and at the end.
    """
    size = 1 + 2 * rates
    places = np.eye(size)
    states = [np.array([np.zeros(size), places[0]])]
    states += [places[[1 + rate, 1 + rates + rate]] for rate in range(rates)]
    q, v = states[:2]
    one = np.ones((1, 1))
    found = integrated(q[:-1], v[:-1], hermite(states, one), one)[order]
    columns = [coefficient[0] for coefficient in found]
    return np.asarray(
        inner([own[:, None] for own in columns], [own[None] for own in columns], 1.0), dtype=float
    )
