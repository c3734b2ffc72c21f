"""The second method of `exact` and `exact-jerk` in motion: IPOPT, every joint in its own pieces.

The interior-point method of `exact.jerk` begins strictly inside all inequalities. Near the optimum
of a part of an optimal motion there may be no inside: each joint's states just before the part's
end leave it one motion. And where tolerances meet states in motion, a guess may lead to another
local optimum.

Here every joint passes each segment in a few pieces of constant acceleration, or of constant jerk
where any is limited, as long as it likes. Every optimum can be written so. At first waypoints may
be missed, at a cost, so no guess is impossible; then they are met. The planner makes the motion of
the times and states that are found.

The velocity on a piece is a quadratic. It stays between its ends and `v + a d/2`, the Bernstein
coefficient between them; with a break at its peak nothing is lost.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from baselines.exact.method.scaled import Scaled
from baselines.ipopt import Bounds, Options, Program, flat, program, unflat
from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidTrajectory
from trajopt.core.problem import Problem
from trajopt.core.rounding import of_states
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import backend

# Pieces of a joint in a segment where no jerk is limited (it speeds up, cruises, brakes), and else.
# Fewer: optima that need more are not found. More: IPOPT takes longer.
PIECES = (3, 8)
# Shares of the limits that are left to rounding, the next where one is not enough. A larger share:
# a motion longer by as much. A smaller one: IPOPT's rounding breaks a limit.
SPARES = (0.0, 1e-12, 1e-10, 1e-8)
# Guesses of the segment times: shares of those at the velocity limits, of their mean, and of those
# of stopping; then these times factors. Guesses only: a descent from them may end in any optimum.
_SHARES = (1.3, 1.3, 0.3)
_MORE = (2.3, 1.5, 3.0)
# Under jerk limits, each before one of the others: the fastest motion without them so much slower,
# and whether its velocities and places are taken too. At 1 jerk has no slack.
_SLOWER = ((1.3, True), (2.0, False), (1.0, True))
# Guesses times segments times joints, and iterations times these: bounds of the CPU time. Smaller:
# larger problems get fewer guesses, or an iterate far from converged. Larger: more seconds.
_MOST_CELLS = 36
_MOST_ITERATIONS = 500
_ITERATIONS_CELLS = 4000
_LONGEST = 1e3  # longest time of a segment, times that of the guess: an end to IPOPT's steps
_BRIEFEST = 1e-6  # least time of a segment in a guess, as a share of stopping: not 0
# Cost of missing a waypoint, in units of the time and the way. Too low: the first descent
# ends where it misses waypoints.
_MISS_COST = 100.0
_MISSING = 0.1  # miss in a guess, in the same units: positive, as IPOPT begins inside
# Shares by which limits are widened at first, the next from the answer within the last. A smaller
# first one: there is next to no inside. The last one is what the linear programs have to remove.
_WIDER = (1e-3, 1e-5, 1e-7, 1e-9)
_MISSED = 1e-6  # a larger miss at the end of a descent: it has found no motion
# After IPOPT, in units of the largest excess over a constraint: constraints with more slack do not
# count; no variable changes by more. Smaller: a needed change is forbidden. Larger: larger
# programs.
_FAR = 1e5
_EXCESS_COST = 1e9  # relative to all changes together: so large that the excess comes first
_SHARPENINGS = 5  # linear programs at most; each about squares the excess, as Newton's method
_SHARP = 4e-16  # without units: a smaller excess is rounding
_NONE = 1e-10  # a larger excess afterwards: it misses a waypoint
_OPTIONS: Options = {
    "tol": 1e-10,
    "constr_viol_tol": 1e-12,
    "bound_relax_factor": 0.0,
    "mu_strategy": "monotone",
    "acceptable_tol": 1e-9,
    "acceptable_constr_viol_tol": 1e-11,
}


class FreeGuess(NamedTuple):
    """A guess: every joint in its mean velocity, or with the velocities and places of a motion.

    Attributes:
        times: of the segments, without units, `(segments,)`.
        like: a motion whose waypoint times are a share of these.
    """

    times: Array
    like: Trajectory | None = None


class FreeOptimum(NamedTuple):
    """A local optimum, without units.

    Attributes:
        times: of the segments, `(segments,)`.
        velocity, acceleration: at the waypoints with a state, `(waypoints, joints)`.
        offset: of these waypoints from their nominal places, likewise.
        pieces: of the joints, one after another: their lengths, and velocities, accelerations and
            jerks at their starts, `(4, pieces, joints)`.
        converged: whether IPOPT says that it is one. If not, this is its last iterate.
    """

    times: Array
    velocity: Array
    acceleration: Array
    offset: Array
    pieces: Array
    converged: bool

    def duration(self) -> float:
        return float(self.times.sum())


def choices(problem: Problem) -> int:
    """Return for how many choices of merged neighbours it is tried: with none, with most, …"""
    return max(2, _MOST_CELLS // (problem.segments * problem.joints))


def guesses(scaled: Scaled, faster: Trajectory | None = None) -> Iterator[FreeGuess]:
    """Yield guesses; fewer of larger problems.

    Args:
        scaled: The problem.
        faster: A motion without jerk limits, where there is one.
    """
    briefest = _BRIEFEST * scaled.stop
    cruising = np.maximum(scaled.shortest, briefest)
    even = np.full_like(cruising, cruising.mean())
    pairs = zip((cruising, even, scaled.stop), _SHARES, strict=True)
    found = [FreeGuess(share * own) for own, share in pairs]
    if faster is None:
        found += [FreeGuess(more * own.times) for own, more in zip(found, _MORE, strict=True)]
    else:
        times = np.maximum(np.diff(faster.waypoint_times) / scaled.unit, briefest)
        slower = [FreeGuess(by * times, faster if whole else None) for by, whole in _SLOWER]
        found = list(chain.from_iterable(zip(slower, found, strict=True)))
    yield from found[: _MOST_CELLS // scaled.h.size]


def minimised(
    scaled: Scaled,
    times: Array,
    like: Trajectory | None = None,
    *,
    widened: bool = False,
    below: float = np.inf,
) -> FreeOptimum | None:
    """Return the motion to which IPOPT comes from a guess, if it meets all waypoints.

    It may not have converged: a thousand iterations may change nothing but multipliers. The judge
    decides about the motion.

    Args:
        scaled: The problem, whose limits leave a share to rounding.
        times, like: As in `FreeGuess`.
        widened: Whether the limits are wider at first, so that there is an inside.
        below: Duration of a known motion, without units. Where IPOPT comes to a longer one that may
            still miss waypoints, or exceed limits, it ends: what follows is longer yet.
    """
    segments, joints = scaled.h.shape
    jerky = scaled.r.max(axis=(0, 1)) > 0
    pieces = PIECES[int(jerky.any())]
    with np.errstate(divide="ignore"):
        steepest = np.array([[[-1.0]], [[1.0]]]) / scaled.r
    # units in which what is reached in a segment is of order one: of time, of each joint's way
    unit = times.mean()
    reached = [
        np.abs(own).min(axis=(0, 1)) * unit**order
        for order, own in enumerate((scaled.v, scaled.a, steepest), start=1)
    ]
    way = np.min(reached, axis=0)
    rate, bend = unit / way, unit**2 / way

    def by_piece(limits: Array) -> Array:
        """Return limits of segments as those of their pieces, `(2, pieces, joints)`."""
        whole = np.broadcast_to(limits, (2, segments, joints))
        return np.array(np.repeat(whole, pieces, axis=1))

    v, a = by_piece(rate * scaled.v), by_piece(bend * scaled.a)
    jerk = np.where(jerky, by_piece(unit**3 / way * steepest), 0.0)
    v_at_start, a_at_start = v.copy(), a.copy()
    at_waypoints, at_ends = slice(pieces, None, pieces), slice(pieces - 1, None, pieces)
    v_at_start[:, at_waypoints] = rate * scaled.waypoint_v
    a_at_start[:, at_waypoints] = np.where(jerky, bend * scaled.waypoint_a, a[:, at_waypoints])
    v_at_start[:, 0] = rate * scaled.end_v[0]
    # a joint without a jerk limit begins with any acceleration, and it may jump at each break
    a_at_start[:, 0] = np.where(jerky, bend * scaled.end_a[0], a[:, 0])
    jumps = np.where(jerky, 0.0, np.inf) * np.ones_like(a[0])
    box = scaled.tolerance / way
    least = np.maximum(scaled.shortest * (not box.any()), scaled.least) / unit
    shares = times / unit
    lengths = np.repeat(shares[:, None] / pieces, pieces, axis=0) * np.ones_like(a[0])
    still = np.zeros_like(lengths)
    missing = np.zeros((2 * segments, joints))
    low = flat(least, still, v_at_start[0], a_at_start[0], jerk[0], -box, missing)
    longest = _LONGEST * shares, still + np.inf
    high = flat(*longest, v_at_start[1], a_at_start[1], jerk[1], box, missing + np.inf)
    if np.any(low > high):
        return None
    h = scaled.h / way
    speed, offset = np.repeat(h / shares[:, None], pieces, axis=0), 0 * box
    if like is not None:
        passed = like.waypoint_times
        starts = np.linspace(passed[:-1], passed[1:], pieces, endpoint=False, axis=1).ravel()
        speed = like(starts, 1) * (like.duration / (scaled.unit * times.sum()))
        speed *= rate / scaled.units[2]
        inner = slice(1, len(box) + 1)
        offset = like(passed[inner]) - scaled.problem.waypoints[inner]
        offset /= scaled.units[-1] * way
    guess = flat(shares, lengths, speed, still, still, offset, missing + _MISSING)
    exact = flat(*longest, v_at_start[1], a_at_start[1], jerk[1], box, missing)
    solver = _solver(segments, joints, pieces)
    parameters = flat(h, rate * scaled.end_v[1:], bend * jerky * scaled.end_a[1:])
    rows = (
        flat(0 * h, 0 * h, still, -jumps, a[0], v[0], v[0][at_ends]),
        flat(0 * h, 0 * h, still, jumps, a[1], v[1], v[1][at_ends]),
    )
    answer, converged, is_longer = None, False, False
    wider = _WIDER if widened else (0.0,)
    # each begins at the answer of the last; what does not converge in the widest limits, waypoints
    # met, does not in tighter ones
    for order, (most, by) in enumerate([(high, wider[0]), *((exact, by) for by in wider)]):
        wide = [_widened((low, most), by), _widened(rows, by)]
        run = solver(np.clip(guess, *wide[0]), parameters, *wide)
        if not run.x[-missing.size :].max() <= _MISSED:
            break
        guess = run.x
        if run.success or not converged:
            answer, converged = run.x, run.success
        is_longer = run.success and unit * run.x[:segments].sum() >= below
        if is_longer or (order == 1 and not run.success):
            break
    if answer is None:
        return None
    if segments == 1:  # its states may leave one motion; a quarter of their rounding is left to it
        place, swift, steep = of_states(scaled.problem) / scaled.units[[3, 2, 1]] / 4
        end = still.copy()
        end[-1] = 1.0
        of_end = 0 * h + place / way, end * rate * swift, end * bend * steep
        spare = flat(0 * h, *of_end, still, still, 0 * h)
        rows = (rows[0] - spare, rows[1] + spare)
    if not is_longer:
        answer, excess = _sharpened(solver, answer, parameters, (low, exact), rows)
        if excess > _NONE:
            return None
    shapes = [times.shape, *([still.shape] * 4), box.shape, missing.shape]
    found, lengths, velocity, acceleration, jerks, offset, _ = unflat(answer, shapes)
    velocity, acceleration = velocity / rate, acceleration / bend
    return FreeOptimum(
        unit * found,
        velocity[at_waypoints],
        jerky * acceleration[at_waypoints],
        way * offset,
        np.array([unit * lengths, velocity, acceleration, jerks * way / unit**3]),
        converged,
    )


def motion(scaled: Scaled, found: FreeOptimum) -> Trajectory | None:
    """Return the motion of the pieces themselves, each joint with breaks of its own, if it is one.

    Near an end that leaves a joint one motion the planner's own motion, of the same states, may
    exceed a limit by the rounding of these.
    """
    places = np.array(scaled.problem.waypoints)
    places[1 : len(found.offset) + 1] += scaled.units[-1] * found.offset
    segments, joints = scaled.h.shape
    tables = []
    for joint in range(joints):
        lengths, velocity, acceleration, jerk = (
            own * table[:, joint].reshape(segments, -1)
            for own, table in zip(
                (scaled.unit, *scaled.units[2::-1, joint]), found.pieces, strict=True
            )
        )
        gained = lengths * (velocity + lengths * (acceleration / 2 + lengths * jerk / 6))
        position = places[:-1, [joint]] + np.cumsum(gained, axis=1) - gained
        breaks = np.append(0.0, np.cumsum(lengths))
        kept = np.diff(breaks) > 0
        rows = np.array([jerk / 6, acceleration / 2, velocity, position]).reshape(4, -1)
        tables.append((np.append(breaks[:-1][kept], breaks[-1]), rows[:, kept]))
    try:
        return Trajectory.joined(tables, np.append(0.0, np.cumsum(scaled.unit * found.times)))
    except InvalidTrajectory:
        return None


def _sharpened(
    solver: Program, x: Array, parameters: Array, bounds: Bounds, rows: Bounds
) -> tuple[Array, float]:
    """Return a point near `x` that keeps the constraints to rounding, and its excess.

    IPOPT keeps them to 1e-12, or not at all where it did not converge.

    Each linear program has the constraints' first derivatives. It looks for the least excess, and
    for the least change besides.
    """
    from scipy.optimize import linprog  # late: few motions need it
    from scipy.sparse import block_array

    best = np.clip(x, *bounds)
    values, derivatives = solver.linear(best, parameters)
    unit = _excess(values, rows)
    for _ in range(_SHARPENINGS):
        if unit <= _SHARP:
            break
        above, below = (values - rows[0]) / unit, (rows[1] - values) / unit
        near = [side < _FAR for side in (above, below)]
        change = [-derivatives[near[0]], derivatives[near[1]]]
        excess = [-np.ones((own.sum(), 1)) for own in near]
        found = linprog(
            np.append(np.ones(2 * len(x)), _EXCESS_COST),
            A_ub=block_array([[own, -own, one] for own, one in zip(change, excess, strict=True)]),
            b_ub=np.concatenate([above[near[0]], below[near[1]]]),
            bounds=np.vstack(
                [
                    *(
                        np.column_stack([0 * x, np.clip(room / unit, 0, _FAR)])
                        for room in (bounds[1] - best, best - bounds[0])
                    ),
                    [0.0, np.inf],
                ]
            ),
            options={"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
        )
        if found.x is None:
            break
        upwards, downwards = found.x[:-1].reshape(2, -1)
        tried = np.clip(best + unit * (upwards - downwards), *bounds)
        values, derivatives = solver.linear(tried, parameters)
        after = _excess(values, rows)
        if not after < unit:
            break
        best, unit = tried, after
    return best, unit


def _widened(bounds: Bounds, by: float) -> Bounds:
    """Return bounds that leave a share more."""
    low, high = (np.where(np.isfinite(own), own, 0.0) for own in bounds)
    return bounds[0] - by * np.abs(low), bounds[1] + by * np.abs(high)


def _excess(values: Array, rows: Bounds) -> float:
    """Return by how much values leave their bounds at most."""
    return float(np.maximum(rows[0] - values, values - rows[1]).max())


@cache
def _solver(segments: int, joints: int, pieces: int) -> Program:
    """Return the program for all problems of this size, built once; its data are parameters."""
    ca = backend("casadi")
    most = min(_MOST_ITERATIONS, _ITERATIONS_CELLS // (segments * joints))
    count = segments * pieces

    def table(rows: int) -> Any:
        return ca.MX.sym("table", rows, joints)

    times = ca.MX.sym("T", segments)
    lengths, velocity, acceleration, jerk = (table(count) for _ in range(4))
    offset = table(segments - 1)
    h, end_v, end_a = table(segments), table(1), table(1)
    of_segments = np.repeat(np.eye(segments), pieces, axis=0).T
    d = lengths
    after_v = velocity + d * (acceleration + d * jerk / 2)
    after_a = acceleration + d * jerk
    next_v = ca.vertcat(velocity[1:, :], end_v)
    next_a = ca.vertcat(acceleration[1:, :], end_a)
    way = of_segments @ (d * (velocity + d * (acceleration / 2 + d * jerk / 6)))
    still = ca.MX.zeros(1, joints)
    misses = table(2 * segments)
    missed = misses[:segments, :] - misses[segments:, :]
    moved = ca.vertcat(offset, still) - ca.vertcat(still, offset)
    return program(
        "free_pieces",
        variables=[times, lengths, velocity, acceleration, jerk, offset, misses],
        parameters=[h, end_v, end_a],
        objective=ca.sum1(times) + _MISS_COST * ca.sum1(ca.vec(misses)),
        constraints=[
            of_segments @ lengths - ca.repmat(times, 1, joints),
            way + missed - moved - h,
            after_v - next_v,
            after_a - next_a,
            after_a,
            velocity + d * acceleration / 2,
            after_v[pieces - 1 :: pieces, :],
        ],
        options={**_OPTIONS, "max_iter": most},
    )
