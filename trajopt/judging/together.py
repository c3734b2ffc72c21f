"""Judge many motions at once: the pieces of all of them are one table.

    certificates = verify_many(problems, trajectories)

Certificates are those of `verify`, to the bit: a row of the table takes the very operations that it
takes alone. Sums along a motion and the choice of the worst value are made motion by motion, in the
order of `verify`. Whatever is unusual is left to `verify`: demands, limits of segments or of other
kinds, pieces of a high degree, a waypoint between breaks, a miss that is a flaw or has to be
repaired.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator, Sequence
from functools import cached_property

import numpy as np

from trajopt.core import polynomials
from trajopt.core.arrays import Array, Bools, Indices
from trajopt.core.limits import LIMIT_ORDERS, Use
from trajopt.core.limits.peaks import peaks, ratio, use
from trajopt.core.problem import Problem
from trajopt.core.resolution import is_brief
from trajopt.core.trajectory import Trajectory
from trajopt.judging.certificate import Certificate, Tolerance
from trajopt.judging.repair import NEGLIGIBLE_USE, Corrections
from trajopt.judging.verification import (
    MENDED,
    Allowed,
    allowed_errors,
    check_sizes,
    verify,
    worst_of,
)

FEWEST = 4  # motions that are a table: fewer are faster alone
MAX_CELLS = 50_000  # pieces times joints of a table: a few MB
# Of pieces: rounding of a higher degree has to be repaired as a rule. (From degree 7 on NumPy would
# add a lone polynomial's coefficients in another order than those of many.)
MAX_DEGREE = 3


def verify_many(
    problems: Sequence[Problem],
    trajectories: Sequence[Trajectory],
    tolerance: Tolerance | None = None,
) -> list[Certificate]:
    """Judge a motion of each problem: the certificates of `verify`, to the bit.

    Args:
        problems: One for each motion.
        trajectories: The motions.
        tolerance: As `verify` takes it.

    Raises:
        WrongType, InvalidTrajectory: As `verify` does, for any of them.
        ValueError: There are not as many motions as problems.
    """
    pairs = list(zip(problems, trajectories, strict=True))
    for problem, motion in pairs:
        check_sizes(problem, motion)
    found: dict[int, Certificate] = {}
    for places in _parts(pairs):
        table = _Table([pairs[place] for place in places], tolerance or Tolerance())
        certificates = table.certificates()
        found |= {places[number]: certificate for number, certificate in certificates.items()}
    return [
        found[place] if place in found else verify(problem, motion, tolerance)
        for place, (problem, motion) in enumerate(pairs)
    ]


def _parts(pairs: Sequence[tuple[Problem, Trajectory]]) -> Iterator[list[int]]:
    """Yield the places of motions that are a table; none of those that are judged alone."""
    alike: dict[Hashable, list[int]] = {}
    for place, (problem, motion) in enumerate(pairs):
        key = _alike(problem, motion)
        if key is not None:
            alike.setdefault(key, []).append(place)
    for places in alike.values():
        sizes = [len(pairs[place][1].lengths) * pairs[place][1].joints for place in places]
        numbers = np.cumsum(sizes) // MAX_CELLS
        for number in np.unique(numbers):
            part = [
                place for place, part_of in zip(places, numbers, strict=True) if part_of == number
            ]
            if len(part) >= FEWEST:
                yield part


def _alike(problem: Problem, motion: Trajectory) -> Hashable:
    """Return what motions of one table have in common; None for one that is judged alone."""
    limits = problem.limits
    usual = not problem.demands and limits.segments is None and limits.kinds.keys() <= MENDED
    degree = len(motion.coefficients) - 1
    if not usual or not 1 <= degree <= MAX_DEGREE or problem.merged()[0] is not problem:
        return None
    at = _breaks_at_waypoints(motion)
    if (motion.breaks[at] != motion.waypoint_times).any() or (np.diff(at) < 1).any():
        return None
    return degree, tuple(limits.kinds), tuple(limits.smooth)


def _breaks_at_waypoints(motion: Trajectory) -> Indices:
    at = motion.breaks.searchsorted(motion.waypoint_times)
    return np.minimum(at, len(motion.lengths))


class _Table:
    """Motions one after the other: a row for each piece, for each break, for each waypoint.

    Args:
        pairs: Problems, alike, and their motions, of one degree.
        tolerance: The largest misses and jumps that are repaired.
    """

    def __init__(self, pairs: Sequence[tuple[Problem, Trajectory]], tolerance: Tolerance) -> None:
        self._problems = [problem for problem, _ in pairs]
        self._motions = [motion for _, motion in pairs]
        self._tolerance = tolerance
        motions = self._motions
        self._coefficients = np.concatenate([motion.coefficients for motion in motions], axis=1)
        self._lengths = np.concatenate([motion.lengths for motion in motions])
        self._breaks = np.concatenate([motion.breaks for motion in motions])
        self._waypoints = np.concatenate([problem.waypoints for problem in self._problems])
        self._pieces = _Shares([len(motion.lengths) for motion in motions])
        self._knots = _Shares([len(motion.breaks) for motion in motions])
        self._passed = _Shares([len(problem.waypoints) for problem in self._problems])
        # of each piece, the break at which it begins
        self._begins = np.arange(len(self._lengths)) + self._pieces.owner
        at = np.concatenate([_breaks_at_waypoints(motion) for motion in motions])
        self._at = at + self._knots.first[self._passed.owner]
        self._joints = self._coefficients.shape[2]

    def certificates(self) -> dict[int, Certificate]:
        """Return the certificates by motion, but of those that are to be judged alone."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            is_whole = self._needs_no_repair()
            if not is_whole.any():
                return {}
            allowed = self._allowed()
            errors = self._misses(), *self._jumps, polynomials.evaluation_rounding(self._units[0])
            repaired = self._rebased()
            is_finite = np.asarray(np.isfinite(repaired).all(axis=(0, 2)))
            is_whole &= self._pieces.all(is_finite)
            uses = {key: self._worst(key) for key in self._problems[0].limits.kinds}
            found = {}
            for row in np.flatnonzero(is_whole).tolist():
                judged = self._motion(row, repaired)
                used = {key: uses[key][row] for key in uses}
                certificate = self._certificate(row, judged, allowed, errors, used)
                if certificate is not None:
                    found[row] = certificate
            return found

    def _certificate(
        self,
        row: int,
        judged: Trajectory,
        allowed: Allowed,
        errors: tuple[Array, ...],
        uses: dict[str, Use | None],
    ) -> Certificate | None:
        """Return the certificate of a motion; None where something is a flaw."""
        problem, motion = self._problems[row], self._motions[row]
        missed, *jumps, blurred = errors
        times = motion.waypoint_times
        waypoint, excess = worst_of(missed[self._passed.of(row)], allowed.waypoint[row], times)
        knots = self._knots.of(row)
        found = [
            worst_of(jump[knots], most[row], motion.breaks, order)
            for order, (jump, most) in enumerate(zip(jumps, allowed.jumps, strict=True))
        ]
        blurs = blurred[self._pieces.of(row)]
        _, blur = worst_of(blurs, allowed.blur[row], motion.breaks)
        continuity, jumped = max(found, key=lambda jump: jump[1])
        if max(excess, jumped, blur) > 1:
            return None
        dilation = 0.0
        kept: dict[str, Use] = {}
        for key, use_of in uses.items():
            if use_of is None:
                return None
            needed = problem.limits.kinds[key].dilation(use_of, judged)
            if not np.isfinite(needed * judged.duration):
                return None
            dilation = float(np.maximum(dilation, needed))
            kept[key] = use_of
        return Certificate(
            duration=motion.duration,
            dilation=dilation,
            uses=kept,
            waypoint=waypoint,
            continuity=continuity,
            flaws=(),
            tolerance=self._tolerance,
            judged=judged,
        )

    # --- misses and jumps ---

    @cached_property
    def _units(self) -> list[Array]:
        """Position … jerk on the unit interval, as `Trajectory.pieces` has them."""
        found = []
        for order in range(4):
            derivative = polynomials.derivative(self._coefficients, order)
            degree = len(derivative) - 1
            factors = [polynomials.powers(motion.lengths, degree) for motion in self._motions]
            found.append(derivative * np.concatenate(factors, axis=1)[..., None])
        return found

    @cached_property
    def _jumps(self) -> list[Array]:
        """The jumps of position, velocity and acceleration, `(breaks, joints)` each."""
        # position before the start and after the end; the rest is rest
        resting = [self._waypoints[self._passed.first], self._waypoints[self._passed.last]]
        found = []
        for order, unit in enumerate(self._units[:3]):
            before, after = np.zeros((2, len(self._breaks), self._joints))
            if order == 0:
                before[self._knots.first], after[self._knots.last] = resting
            after[self._begins] = unit[-1]
            before[self._begins + 1] = unit.sum(axis=0)
            found.append(np.abs(after - before))
        return found

    def _misses(self) -> Array:
        """Return the miss of each waypoint, `(waypoints, joints)`."""
        owner = self._passed.owner
        # no piece begins at the last break: the last piece ends there
        piece = np.minimum(self._at - owner, self._pieces.last[owner])
        local = self._breaks[self._at] - self._breaks[self._begins[piece]]
        values = polynomials.evaluate(self._coefficients[:, piece], local[:, None])
        return np.abs(values - self._waypoints)

    def _allowed(self) -> Allowed:
        return allowed_errors(
            *self._limits,
            smooth=self._problems[0].limits.smooth,
            largest=self._largest,
            coordinates=self._rounding,
            duration=np.array([[motion.duration] for motion in self._motions]),
            tolerance=self._tolerance,
        )

    @cached_property
    def _limits(self) -> list[Array]:
        """The smaller sides of velocity, acceleration and jerk limits, `(motions, joints)`."""
        kinds = ("velocity", "acceleration", "jerk")
        every = ([getattr(problem.limits, name) for problem in self._problems] for name in kinds)
        return [np.abs(sides).min(axis=2) for sides in every]

    @cached_property
    def _largest(self) -> Array:
        return np.array([problem.largest_displacements for problem in self._problems])

    @cached_property
    def _rounding(self) -> Array:
        return np.array([problem.rounding for problem in self._problems])

    # --- the repair ---

    @cached_property
    def _travel(self) -> Array:
        """Each piece's displacement, from its velocity alone, rad, `(pieces, joints)`."""
        return self._units[0][:-1].sum(axis=0)

    @cached_property
    def _segments(self) -> tuple[Indices, Indices, Indices]:
        """Each segment's first waypoint, its first piece, and the motion that it is of."""
        first: Indices = np.delete(np.arange(len(self._waypoints)), self._passed.last)
        owner = self._passed.owner[first]
        return first, self._at[first] - owner, owner

    def _rebased(self) -> Array:
        """Return the coefficients with positions integrated anew from each segment's waypoint."""
        waypoint, piece, _ = self._segments
        segment = np.repeat(np.arange(len(piece)), np.diff(piece, append=len(self._lengths)))
        ended = np.concatenate([np.cumsum(self._travel[pieces], axis=0) for pieces in self._pieces])
        before = ended - self._travel
        found = np.array(self._coefficients)
        found[-1] = before - before[piece][segment]
        found[-1] += self._waypoints[waypoint][segment]
        return found

    def _needs_no_repair(self) -> Bools:
        """Return of which motions a bound shows that the corrections are negligible."""
        waypoint, piece, owner = self._segments
        steps = self._waypoints[waypoint + 1] - self._waypoints[waypoint]
        brief = is_brief(steps, self._rounding[owner], self._largest[owner])
        missed = steps - np.add.reduceat(self._travel, piece)
        lengths = np.add.reduceat(self._lengths, piece)[:, None]
        longest = np.maximum.reduceat(lengths, _begins(owner))[owner]
        rate = np.maximum.reduceat(np.abs(missed / lengths), _begins(owner))[owner]
        whole = np.diff(piece, append=len(self._lengths))
        ends = self._at[waypoint + 1]
        until_end = np.repeat(self._breaks[ends], whole) - self._breaks[self._begins]
        allowed = [self._rounding, *(NEGLIGIBLE_USE * limit for limit in self._limits)]
        kept = ~brief
        bends = self._problems[0].limits.smooth >= 2
        for order, joints in ((1, ~bends), (2, bends)):
            jumps = self._jumps[1 : order + 1]
            corrections = Corrections(
                first=piece,
                lengths=lengths,
                longest=longest,
                until_end=until_end[:, None],
                rate=rate[:, joints],
                missed=missed[:, joints],
                starting=[jump[self._begins][:, joints] for jump in jumps],
                ending=[jump[ends][:, joints] for jump in jumps],
            )
            kept &= corrections.negligible([most[owner][:, joints] for most in allowed])
        return np.logical_and.reduceat(kept, _begins(owner))

    def _motion(self, row: int, repaired: Array) -> Trajectory:
        """Return a motion with its coefficients in the table."""
        motion = self._motions[row]
        coefficients = np.array(repaired[:, self._pieces.of(row)])
        return motion.with_coefficients(coefficients, motion.waypoint_times)

    def _worst(self, key: str) -> list[Use | None]:
        """Return the worst use of a limit by each motion; None where it is to be judged alone."""
        numbers = np.array([problem.limits.kinds[key].numbers for problem in self._problems])
        unit = self._units[LIMIT_ORDERS[key]]  # type: ignore[index]
        found = peaks(unit, numbers[self._pieces.owner], ratio, list(self._pieces))
        pairs = zip(found, self._motions, strict=True)
        return [worst and use(worst, motion) for worst, motion in pairs]


class _Shares:
    """Which rows of a table are whose.

    Args:
        counts: How many each has.
    """

    def __init__(self, counts: Sequence[int]) -> None:
        ends = np.cumsum(counts)
        self.first: Indices = (ends - counts).astype(np.intp)
        self.last: Indices = self.first + counts - 1
        self.owner = np.repeat(np.arange(len(counts)), counts)

    def __iter__(self) -> Iterator[slice]:
        return map(slice, self.first.tolist(), (self.last + 1).tolist())

    def of(self, number: int) -> slice:
        """Return the rows of one."""
        return slice(int(self.first[number]), int(self.last[number]) + 1)

    def all(self, rows: Bools) -> Bools:
        """Return for which all rows are true."""
        return np.logical_and.reduceat(rows, self.first)


def _begins(owner: Indices) -> Indices:
    """Return the rows at which a new owner begins."""
    return np.flatnonzero(np.diff(owner, prepend=-1))
