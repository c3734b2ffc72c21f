"""A spline as a function of its times alone: its duration and its violation of limits.

There are two ways to combine both in one number, the fitness of a search (docs/mathematics.md,
section 2):

- `penalty`: the duration within the limits. Otherwise a number above every duration, which grows
  with the violation (Deb's rule);
- `scaled`: the duration after dilation to the limits. A dilation does not change positions, so
  position limits are kept by Deb's rule.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.planners import spline_family
from trajopt.planners.rest_to_rest import stop_times
from trajopt.planners.spline_family import SplineFamily
from trajopt.planners.swarm.optimiser import added


class Timing(ABC):
    """A spline with free times; candidates are `(N, variables)`, s, each between `low` and `high`.

    Attributes:
        variables: Number of times.
        low, high: The box of every time, s.
    """

    variables: int
    low: float
    high: float

    @abstractmethod
    def uses(self, times: Array, exact_above: float = 0.0) -> Sequence[Array]:
        """Return peak velocity, acceleration (and jerk) over their limits, each `(N, joints)`.

        A use of at most `exact_above` may be replaced by any other such number.
        """

    @abstractmethod
    def outside(self, times: Array) -> Array | None:
        """Return how far each joint leaves its position limits, over its largest displacement.

        `(N, joints)`, 0 within; None without position limits.
        """

    @abstractmethod
    def trajectory(self, problem: Problem, times: Array) -> Trajectory:
        """Return the motion of all joints of the merged problem at times `(variables,)`, s."""

    def fast(self, fitness: str) -> Callable[[Array], Array]:
        """Return `penalty` or `scaled`, as fast as it can be for a few candidates."""
        own: Callable[[Array], Array] = getattr(self, fitness)
        return own

    @property
    def ceiling(self) -> float:
        """Return the longest duration in the box, s; a larger fitness means a broken limit."""
        return float(added(np.full(self.variables, self.high)))

    @property
    def above_any(self) -> float:
        """Return a number above every duration in the box, s."""
        return float(np.nextafter(self.ceiling, np.inf))

    def penalty(self, times: Array) -> Array:
        """Return Deb's rule as one number, `(N,)`.

        It is the duration; with a violation of limits it is more than every duration in the box.
        """
        return self.penalty_beyond(times, self.outside(times))

    def penalty_beyond(self, times: Array, outside: Array | None) -> Array:
        """Return `penalty` of candidates with this excess over position limits."""
        excesses = [np.maximum(use - 1.0, 0.0) for use in self.uses(times, exact_above=1.0)]
        if outside is not None:
            excesses.append(outside)
        excess = added(reduce(np.add, excesses))
        beyond = self.above_any + excess
        return np.where(excess > 0, beyond, added(times))

    def scaled(self, times: Array) -> Array:
        """Return the duration after dilation; Deb's rule for position limits, `(N,)`."""
        return self.scaled_beyond(times, self.outside(times))

    def scaled_beyond(self, times: Array, outside: Array | None) -> Array:
        """Return `scaled` of candidates with this excess over position limits."""
        duration = self.dilation(times) * added(times)
        if outside is None:
            return duration
        excess = added(outside)
        # Only candidates that keep their position limits are below `above_any`.
        beyond = np.maximum(duration, self.above_any) * (1.0 + excess)
        return np.where(excess > 0, beyond, duration)

    def dilation(self, times: Array) -> Array:
        """Return the cheapest dilation that brings every use to 1, `(N,)`."""
        roots = [np.sqrt, np.cbrt]
        factor, *others = self.uses(times)
        # Dilating by k divides velocity by k, acceleration by k², jerk by k³.
        for root, use in zip(roots, others, strict=False):
            factor = np.maximum(factor, root(use))
        return factor.max(axis=-1)


@dataclass(frozen=True, eq=False)
class FamilyTiming(Timing):
    """A spline of any family; at given times it is the smoothest one of the family.

    Attributes:
        family: The degrees of its pieces, whose times are the variables.
        problem: All its joints move, and its consecutive waypoints differ.
    """

    family: SplineFamily
    problem: Problem
    low: float
    high: float

    @classmethod
    def of(cls, problem: Problem, shape: str, lower: float, upper: float) -> FamilyTiming:
        """Return the spline of a shape, such as "4-3-4", through a problem's waypoints.

        Args:
            problem: All its joints move, and its consecutive waypoints differ.
            shape: As for `spline_family.family`.
            lower: Lower end of the box over its upper end.
            upper: Upper end of the box over the longest time of a segment from rest to rest.

        Raises:
            InvalidInput: The shape does not fit the problem.
        """
        jerk_limited = problem.has("jerk")
        family = spline_family.family(shape, problem.segments, "rest", jerk_limited)
        high = upper * float(stop_times(problem.without("position")).max())
        return cls(family, problem, low=lower * high, high=high)

    @property
    def variables(self) -> int:  # type: ignore[override]
        return self.family.pieces

    def uses(self, times: Array, exact_above: float = 0.0) -> list[Array]:
        own = self.problem
        unit = self._unit(times)
        lengths = times.T.reshape(-1)
        bounds = [own.limits.velocity, own.limits.acceleration]
        if own.has("jerk"):
            bounds.append(own.limits.jerk)
        uses = []
        for order, limits in enumerate(bounds, start=1):
            _, use = spline_family.peaks(unit, lengths, order, limits)
            uses.append(self._worst(use))
        return uses

    def outside(self, times: Array) -> Array | None:
        own = self.problem
        if not own.has("position"):
            return None
        span = np.ptp(own.waypoints, axis=0)
        starts = own.waypoints[list(self.family.segments), :, None]
        room = (own.limits.position - starts) / span[:, None]
        of_all = np.repeat(room, len(times), axis=0)
        _, beyond = spline_family.farthest(self._unit(times) / span, of_all)
        # Rounding of a position is no excess.
        return np.maximum(self._worst(beyond) - spline_family.POSITION_RTOL, 0.0)

    def trajectory(self, problem: Problem, times: Array) -> Trajectory:
        smoothest = self.family.smoothest(problem.displacements, times)
        unit = self.family.powers(self.family.joined(smoothest, times))
        unit[-1] += problem.waypoints[list(self.family.segments)]
        breaks = np.concatenate([[0.0], np.cumsum(times)])
        ends = np.cumsum([0, *self.family.parts])
        pieces = polynomials.stretched(unit, 1 / np.diff(breaks))
        return Trajectory(breaks, pieces, breaks[ends])

    def _unit(self, times: Array) -> Array:
        """Return all pieces on the unit interval, `(degree + 1, pieces · N, joints)`."""
        controls = self.family.smoothest(self.problem.displacements, times)
        unit = self.family.powers(np.moveaxis(controls, 0, 1))
        return unit.reshape(len(unit), -1, unit.shape[-1])

    def _worst(self, of_pieces: Array) -> Array:
        """Return the largest value over each candidate's pieces, `(N, joints)`."""
        by_piece = of_pieces.reshape(self.family.pieces, -1, of_pieces.shape[-1])
        return np.asarray(by_piece.max(axis=0))
