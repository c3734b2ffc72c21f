"""A spline as a function of its times alone: how long it lasts, and by how much it breaks limits.

Two ways to make that one number, the fitness of a search (docs/mathematics.md, section 2):

- `penalty`: the duration within the limits; above every duration else, by the violation (Deb);
- `scaled`: the duration once dilated to the limits. No dilation mends a position, so position
  limits are kept by Deb's rule alone.
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

        A use that stays at or below `exact_above` may be any other number that does.
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
        """The longest duration in the box, s: a fitness above it breaks a limit."""
        return float(added(np.full(self.variables, self.high)))

    @property
    def above_any(self) -> float:
        """Above every duration in the box."""
        return float(np.nextafter(self.ceiling, np.inf))

    def penalty(self, times: Array) -> Array:
        """Deb's rule as one number, `(N,)`.

        The duration; or more than every duration in the box, by the violation of the limits.
        """
        return self.penalty_beyond(times, self.outside(times))

    def penalty_beyond(self, times: Array, outside: Array | None) -> Array:
        """`penalty` of candidates that are this far `outside`."""
        excesses = [np.maximum(use - 1.0, 0.0) for use in self.uses(times, exact_above=1.0)]
        if outside is not None:
            excesses.append(outside)
        excess = added(reduce(np.add, excesses))
        beyond = self.above_any + excess
        return np.where(excess > 0, beyond, added(times))

    def scaled(self, times: Array) -> Array:
        """The duration once dilated to the limits; Deb's rule for position limits, `(N,)`."""
        return self.scaled_beyond(times, self.outside(times))

    def scaled_beyond(self, times: Array, outside: Array | None) -> Array:
        """`scaled` of candidates that are this far `outside`."""
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
    """A spline of any family: its freedoms beside the times are those that bend it least.

    Attributes:
        family: The degrees of its pieces, whose times are the variables.
        problem: Whose joints all move, and whose consecutive waypoints differ.
    """

    family: SplineFamily
    problem: Problem
    low: float
    high: float

    @classmethod
    def of(cls, problem: Problem, shape: str, lower: float, upper: float) -> FamilyTiming:
        """Return the spline of a shape, such as "4-3-4", through a problem's waypoints.

        Args:
            problem: Whose joints all move, and whose consecutive waypoints differ.
            shape: As `spline_family.family` reads it.
            lower: The box's lower end, over its upper one.
            upper: Its upper end, over the longest stop-to-stop time of a segment.

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
        """All candidates' pieces on the unit interval, `(degree + 1, pieces · N, joints)`."""
        controls = self.family.smoothest(self.problem.displacements, times)
        unit = self.family.powers(np.moveaxis(controls, 0, 1))
        return unit.reshape(len(unit), -1, unit.shape[-1])

    def _worst(self, of_pieces: Array) -> Array:
        """The worst of each candidate's pieces: `(pieces · N, joints)` to `(N, joints)`."""
        by_piece = of_pieces.reshape(self.family.pieces, -1, of_pieces.shape[-1])
        return np.asarray(by_piece.max(axis=0))
