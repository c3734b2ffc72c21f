"""The phases of an optimum under jerk limits, without those that vanish (mathematics, section 4).

A cell is *tight* where its displacement is the most or the least that its limits allow: its motion
is an extreme profile. An interior-point method only tends to such a profile. A phase that takes no
time at the optimum still takes a time that falls with a root of the barrier, and the states at the
waypoints are off by as much. Two points on the method's way tell which phases these are: lengths
that fall from one to the other vanish.

The phases that stay are unknowns, as the segment times and the waypoint states are. The equations
say that each tight cell passes its waypoints with their states, at the limits that it holds.
Newton's method solves them with the least step, in which changes of the times count most: so they
stay those of the optimum. A profile is followed from both its ends to its peak, since a long cruise
would magnify the rounding of the ramp before it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from baselines.exact.jerk_cells import Cells, Rows
from baselines.exact.rounded import DISTINCT_RTOL, integrated, outwards, together
from baselines.exact.scaled import Scaled
from trajopt.core.arrays import Array, Bools

Indices = NDArray[np.intp]

# A row is active where it leaves less than this share of what it left before.
_FALL = 0.3
# So is one that leaves less than this share of the acceleration that its cell allows.
_ACTIVE = 1e-9
# A phase that takes less than this share of a ramp vanishes in any case.
_NOTHING = 1e-6
# Weight of a change that is only made where no other one serves.
_LIGHT = 1e-3
_MAX_STEPS = 6
_LAST_STEP = 1e-9  # relative to the units: the next one is rounding
_MENDINGS = 4  # of linear equations: all but the first mend rounding
_REGULAR = 1e-14  # for equations that say the same
# Both ends: accelerations change their signs backwards in time.
_FLIPS = np.array([[1.0], [-1.0]])
_EQUATIONS = 12


class Settled(NamedTuple):
    """Segment times, waypoint states, and the profiles of the tight cells.

    Attributes:
        times: of the segments, `(segments,)`.
        states: velocities and accelerations, 0 at both ends, `(2, segments + 1, joints)`.
        cells: segments and joints of the tight cells, `(2, tight)`.
        knots: ends of their phases, since the segment's start or stored (s), `(8, tight)`.
        levels: accelerations there, straight in between.
    """

    times: Array
    states: Array
    cells: Indices
    knots: Array
    levels: Array


def unsettled(times: Array, states: Array) -> Settled:
    """The last of the given points, no cell being tight."""
    nothing = np.zeros((8, 0))
    return Settled(
        times[-1],
        np.pad(states[-1], ((0, 0), (1, 1), (0, 0))),
        np.zeros(
            (2, 0),
            dtype=np.intp,
        ),
        nothing,
        nothing,
    )


class _Tight(NamedTuple):
    """The tight cells; a profile's halves lead from its two ends to its peak.

    Attributes:
        cells: segments and joints, `(2, tight)`.
        lengths: of both halves' ramps, holds and last ramps in turn, and of the cruise,
            `(7, tight)`.
        stays: which of them do not vanish.
        jerks: of each half's phases, `(3, 1, tight)`.
        cruises: whether the peak is at the velocity limit, `(tight,)`.
        held: whether a half reaches its acceleration limit, `(2 ends, tight)`.
        levels: that limit, likewise.
        tops: the velocity limit, `(tight,)`.
        fast: signs of the velocity limits that the ramps at both ends reach, 0 without one, those
            limits and inverse jerks, `(3, 2 ends, tight)`.
        steep: likewise of the acceleration limits that both ends are at, `(2, 2 ends, tight)`.
        acceleration: the unit: the limit, or as far as jerk leads in the segment's time.
        velocity: the unit: the limit, or as far as acceleration leads in that time.
    """

    cells: Indices
    lengths: Array
    stays: Bools
    jerks: Array
    cruises: Bools
    held: Bools
    levels: Array
    tops: Array
    fast: Array
    steep: Array
    acceleration: Array
    velocity: Array


def settled(
    scaled: Scaled,
    times: Array,
    states: Array,
    most: float,
    near: float,
) -> Settled:
    """The optimum near the last of two points, its phases those that do not vanish.

    Args:
        scaled: a problem whose moving joints all have jerk limits.
        times: of the segments, `(2 points, segments)`.
        states: velocities and accelerations, `(2 points, 2, segments - 1, joints)`.
        most: a phase vanishes where it keeps less than this share of its length.
        near: a tight cell's reach leaves less than this share of the acceleration that it allows.
    """
    rows = Cells(scaled).rows(times, states[:, 0], states[:, 1])
    units = _units(scaled, times[-1])
    tight = _tight(
        rows,
        units,
        most,
        near,
    )
    return _solved(
        scaled,
        unsettled(times, states),
        units,
        tight,
    )


def _units(scaled: Scaled, times: Array) -> Array:
    """Velocities and accelerations that the limits allow in each cell."""
    t = times[:, None]
    limit = np.abs(scaled.a).min(axis=0)
    slowest = scaled.r.max(axis=0)
    acceleration = np.minimum(
        limit,
        t / slowest,
    )
    fastest = np.abs(scaled.v).max(axis=0)
    velocity = np.minimum(
        fastest,
        acceleration * t,
    )
    return np.array([velocity, acceleration])


def _falls(values: Array, least: Array, most: float = _FALL) -> Bools:
    """Which values `(…, 2 points, segments, joints)` keep less than `most`, or are negligible."""
    before = values[..., 0, :, :]
    now = values[..., 1, :, :]
    return np.asarray((now < most * before) | (now < least))


def _tight(rows: Rows, units: Array, most: float, near: float) -> _Tight:
    cells = rows.cells
    velocity, acceleration = units
    ramp = velocity / acceleration
    phases = rows.phases * rows.t
    # the cruise is in both halves
    lengths = np.concatenate([phases[:3].reshape(6, *phases.shape[2:]), phases[3, :1]])
    stays = ~_falls(
        lengths,
        _NOTHING * ramp,
        most,
    )
    is_tight = _falls(
        rows.reach,
        _ACTIVE * acceleration,
    )
    is_tight &= rows.reach[:, 1] < near * acceleration
    # of two extreme profiles that are the same motion, the one of fewer phases
    upper, lower = stays.sum(axis=0)
    both = is_tight.all(axis=0)
    is_tight &= ~both | np.array([upper <= lower, upper > lower])
    side, segment, joint = np.nonzero(is_tight)

    def own(table: NDArray[Any]) -> NDArray[Any]:
        return table[..., side, segment, joint]

    def limit(table: Array) -> Array:
        return table[..., side, 0, 0, joint]

    ends = np.array([segment, segment + 1])
    least = np.minimum(
        units[::-1, :-1],
        units[::-1, 1:],
    )

    def at_ends(kind: int, *tables: Array) -> Array:
        active = _falls(
            rows.values[kind][..., :-1, :],
            _ACTIVE * least[kind],
        )
        inner = np.pad(active, ((0, 0), (1, 1), (0, 0)))
        upper, lower = inner[:, ends, joint]
        found = [1.0 * upper - lower]
        for of_upper, of_lower in tables:
            high = of_upper[0, 0, joint]
            low = of_lower[0, 0, joint]
            found.append(upper * high + lower * low)
        return np.array(found)

    unused = cells.steepest - rows.profiles.rises
    reached = own(
        _falls(
            unused,
            _ACTIVE * acceleration,
        )
    )
    kept = own(stays)
    moves = kept[:6].reshape(3, 2, -1)
    signs = 1.0 - 2.0 * side
    none = np.zeros_like(signs)
    jerks = [signs / limit(cells.up), none, -signs / limit(cells.down)]
    return _Tight(
        np.array([segment, joint]),
        np.where(
            kept,
            own(lengths[:, :, 1]),
            0.0,
        ),
        kept,
        np.array(jerks)[:, None],
        own(lengths[6, :, 1]) > 0,
        reached & moves.any(axis=0) | moves[1],
        signs * limit(cells.steepest),
        signs * limit(cells.fastest),
        at_ends(-1, cells.fastest, cells.falling),
        at_ends(-2, cells.widest),
        acceleration[segment, joint],
        velocity[segment, joint],
    )


def _solved(scaled: Scaled, near: Settled, units: Array, tight: _Tight) -> Settled:
    """Newton's method on the equations of the tight cells."""
    times = near.times
    segment, joint = tight.cells
    h = scaled.h[segment, joint]
    ramp = tight.velocity / tight.acceleration
    briefer, way = _briefer(scaled, times)
    states = near.states.copy()
    # velocities count from the mean one of the briefer segment, which changes with its time
    states[0] -= way / times[briefer, None]
    x = np.concatenate([times, states.ravel(), tight.lengths.ravel()])
    of_times = times.copy()
    np.minimum.at(of_times, segment, ramp)
    of_states = np.zeros_like(states)
    of_states[:, 1:-1] = np.minimum(
        units[:, :-1],
        units[:, 1:],
    )
    of_phases = tight.stays * ramp
    scale = np.concatenate([_LIGHT * of_times, of_states.ravel(), of_phases.ravel()])

    # places among all unknowns
    ends = np.array([segment, segment + 1])
    velocities = len(times) + ends * way.shape[1] + joint
    accelerations = velocities + way.size
    phases = len(times) + states.size + np.arange(of_phases.size).reshape(of_phases.shape)
    places = np.concatenate(
        [
            phases[:6],
            velocities,
            accelerations,
            phases[6:],
            segment[None],
            briefer[ends],
        ]
    )
    travelled = way[ends, joint]
    of_rows = np.array(
        [
            ramp,
            tight.velocity * ramp,
            *2 * [tight.acceleration],
            *2 * [tight.velocity],
            *2 * [tight.acceleration],
            *2 * [tight.velocity],
            *2 * [tight.acceleration],
        ]
    )
    for _ in range(_MAX_STEPS):
        own = x[places]
        brief_times = own[12:]
        own[6:8] += travelled / brief_times
        missing, slopes = _equations(
            tight,
            own,
            h,
        )
        slower = -travelled / brief_times**2
        slopes = np.concatenate(
            [slopes, slower * slopes[:, 6:8]],
            axis=1,
        )
        step = _least_step(
            missing / of_rows,
            slopes / of_rows[:, None] * scale[places],
            places,
            len(x),
        )
        x = x + scale * step
        if np.abs(step).max() < _LAST_STEP:
            break
    times = x[: len(times)]
    states = x[len(times) :][: states.size].reshape(states.shape)
    states[0] += way / times[briefer, None]
    halves = x[phases[:6]].reshape(3, 2, -1)
    starts = states[:, ends, joint]
    reached, _, _ = _followed(
        halves,
        starts,
        tight.jerks,
    )
    lengths = [*halves[:, 0], x[phases[6]], *halves[::-1, 1]]
    knots = np.cumsum(
        [np.zeros_like(ramp), *lengths],
        axis=0,
    )
    levels = np.concatenate([reached[:, 0], -reached[::-1, 1]])
    return Settled(times, states, tight.cells, knots, levels)


def _briefer(scaled: Scaled, times: Array) -> tuple[Indices, Array]:
    """The briefer of every waypoint's two segments, and the displacements there.

    Returns:
        Segments `(segments + 1,)`, and displacements `(segments + 1, joints)`, 0 at both ends.
    """
    segments, joints = scaled.h.shape
    briefer = np.zeros(
        segments + 1,
        dtype=np.intp,
    )
    briefer[1:-1] = np.arange(segments - 1) + (times[1:] < times[:-1])
    way = np.zeros((segments + 1, joints))
    way[1:-1] = scaled.h[briefer[1:-1]]
    return briefer, way


def _followed(lengths: Array, starts: Array, jerks: Array) -> tuple[Array, Array, Array]:
    """Both halves of each profile, from their ends to the peak.

    Args:
        lengths: of the phases, `(3, 2 ends, tight)`.
        starts: velocities and accelerations at the ends, `(2, 2 ends, tight)`.
        jerks: of the phases.

    Returns:
        Accelerations and velocities at the phases' ends `(4, 2 ends, tight)`, and the way.
    """
    velocities = [starts[0]]
    accelerations = [_FLIPS * starts[1]]
    way = np.zeros_like(starts[0])
    for t, jerk in zip(
        lengths,
        jerks,
        strict=True,
    ):
        v = velocities[-1]
        a = accelerations[-1]
        way = way + t * (v + t * (a / 2 + t * jerk / 6))
        velocities.append(v + t * (a + t * jerk / 2))
        accelerations.append(a + t * jerk)
    return np.array(accelerations), np.array(velocities), way


def _equations(tight: _Tight, own: Array, h: Array) -> tuple[Array, Array]:
    """The residuals of the equations `(12, tight)` and their slopes `(12, 12, tight)`.

    Args:
        tight: the cells.
        own: their unknowns: six phases, velocities, accelerations, cruise, segment time, …
        h: their displacements.
    """
    count = len(h)
    lengths = own[:6].reshape(3, 2, count)
    starts = own[6:10].reshape(2, 2, count)
    cruise = own[10]
    jerks = tight.jerks
    cruises = tight.cruises
    accelerations, velocities, ways = _followed(
        lengths,
        starts,
        jerks,
    )
    total = lengths.sum(axis=0)
    left = total - np.cumsum(
        lengths,
        axis=0,
    )
    # each half's slopes over its phases, and over velocity and acceleration at its end
    shape = (5, 2, count)
    accelerated = np.zeros(shape)
    accelerated[:3] = jerks
    accelerated[4] = _FLIPS
    faster = np.ones(shape)
    faster[:3] = accelerations[1:] + jerks * left
    faster[4] = _FLIPS * total
    further = np.empty(shape)
    further[:3] = velocities[1:] + left * (accelerations[1:] + jerks * left / 2)
    further[3] = total
    further[4] = _FLIPS * total**2 / 2

    missing = np.empty((_EQUATIONS, count))
    slopes = np.zeros((_EQUATIONS, 12, count))
    of_halves = slopes[:, :10].reshape(_EQUATIONS, *shape)
    # the time, and the way
    missing[0] = total.sum(axis=0) + cruise - own[11]
    missing[1] = ways.sum(axis=0) + cruise * tight.tops - h
    of_halves[0, :3] = 1.0
    of_halves[1] = further
    slopes[0, 10] = 1.0
    slopes[0, 11] = -1.0
    slopes[1, 10] = tight.tops
    # acceleration and velocity at the peak: those of a cruise, or the same of both halves
    first, last = accelerations[3]
    first_peak, last_peak = velocities[3]
    together = np.where(
        cruises,
        0.0,
        1.0,
    )
    missing[2] = first + together * last
    missing[3] = cruises * last
    missing[4] = first_peak - np.where(
        cruises,
        tight.tops,
        last_peak,
    )
    missing[5] = cruises * (last_peak - tight.tops)
    for row, table, sign in ((2, accelerated, 1.0), (4, faster, -1.0)):
        of_halves[row, :, 0] = table[:, 0]
        of_halves[row, :, 1] = sign * together * table[:, 1]
        of_halves[row + 1, :, 1] = cruises * table[:, 1]
    # the acceleration that is held
    missing[6:8] = tight.held * (accelerations[1] - tight.levels)
    for end, held in enumerate(tight.held):
        of_halves[6 + end, 0, end] = held * jerks[0, 0]
        of_halves[6 + end, 4, end] = held * _FLIPS[end]
    # limits at the waypoints
    v, a = starts
    sign, top, r = tight.fast
    up, steepest = tight.steep
    missing[8:10] = sign * v + r * a**2 / 2 - top
    missing[10:] = up * a - steepest
    for end in (0, 1):
        slopes[8 + end, 6 + end] = sign[end]
        slopes[8 + end, 8 + end] = r[end] * a[end]
        slopes[10 + end, 8 + end] = up[end]
    return missing, slopes


def in_stored_time(scaled: Scaled, optimum: Settled, passages: Array) -> Settled:
    """The optimum between stored times, by the least change of accelerations and velocities.

    Those that are 0, as in a cruise, change only where no others serve.

    Args:
        scaled: the problem.
        optimum: as it is without rounding.
        passages: when the waypoints are passed, s.
    """
    rounded = np.diff(passages) / scaled.unit
    # the velocities that pass a brief segment in its rounded time
    briefer, way = _briefer(scaled, optimum.times)
    states = optimum.states.copy()
    if rounded.all():
        slower = 1 / rounded - 1 / optimum.times
        states[0] += way * slower[briefer, None]
    segment, joint = optimum.cells
    if not len(segment):
        return optimum._replace(times=rounded, states=states)

    start = passages[segment]
    ends = (start, passages[segment + 1])
    stored = outwards(
        optimum.knots,
        *ends,
        scaled.unit,
    )
    stored = together(
        stored,
        *ends,
        DISTINCT_RTOL * passages[-1],
    )
    lengths = np.diff(stored, axis=0) / scaled.unit
    elapsed = (stored - start) / scaled.unit
    whole = elapsed[-1]
    # Unknowns are velocities and accelerations at all waypoints, and accelerations at all breaks.
    # Breaks at one place share one, and the first and the last have the waypoints'.
    before, after = np.array([segment, segment + 1]) * way.shape[1] + joint
    place = np.cumsum(
        [0 * segment, *(lengths > 0)],
        axis=0,
    )
    own = states.size + np.arange(place.size).reshape(place.shape)
    breaks = np.take_along_axis(
        own,
        place,
        axis=0,
    )
    breaks = np.where(
        place == 0,
        way.size + before,
        breaks,
    )
    breaks = np.where(
        place == place[-1],
        way.size + after,
        breaks,
    )
    x = np.concatenate([states.ravel(), np.zeros(place.size)])
    x[breaks] = optimum.levels
    # 1 more at a break: half of both lengths more velocity, as if gained at their centroids
    none = np.zeros_like(whole)
    ones = np.ones_like(whole)
    rising = np.array([none, *lengths / 2])
    falling = np.array([*lengths / 2, none])
    left = whole - elapsed
    gained = rising * (left + 2 / 3 * rising) + falling * (left - 2 / 3 * falling)
    slopes = np.array(
        [
            [ones, -ones, *(rising + falling)],
            [whole, none, *gained],
        ]
    )
    places = np.array([before, after, *breaks])

    velocity = _units(scaled, rounded)[0, segment, joint]
    of_rows = np.array([velocity, velocity * whole])
    scale = np.abs(x)
    scale[breaks] = np.maximum(
        scale[breaks],
        _LIGHT * velocity / whole,
    )
    scale[places[:2]] = np.maximum(
        scale[places[:2]],
        velocity,
    )
    scale[: states.size].reshape(states.shape)[:, [0, -1]] = 0.0
    for _ in range(_MENDINGS):
        _, speed, position = integrated(
            lengths,
            x[breaks],
            x[before],
        )
        missing = np.array([speed - x[after], position - scaled.h[segment, joint]])
        x += scale * _least_step(
            missing / of_rows,
            slopes / of_rows[:, None] * scale[places],
            places,
            len(x),
        )
    return Settled(
        rounded,
        x[: states.size].reshape(states.shape),
        optimum.cells,
        stored,
        x[breaks],
    )


def _least_step(missing: Array, slopes: Array, places: Indices, size: int) -> Array:
    """The least step that the equations ask for, `(size,)`.

    Args:
        missing: their residuals, `(equations, tight)`.
        slopes: over the cells' unknowns, `(equations, unknowns, tight)`.
        places: of these among all unknowns, `(unknowns, tight)`.
        size: number of all unknowns.
    """
    import scipy  # late: planners that are only listed need none of it

    count = missing.size
    equations = size + np.arange(count).reshape(missing.shape)
    some = slopes != 0
    rows = np.broadcast_to(
        equations[:, None],
        slopes.shape,
    )[some]
    columns = np.broadcast_to(
        places,
        slopes.shape,
    )[some]
    diagonal = np.arange(size + count)
    # [1, Cᵀ; C, 0]
    entries = [
        slopes[some],
        slopes[some],
        np.ones(size),
        np.full(
            count,
            -_REGULAR,
        ),
    ]
    lower = np.concatenate([rows, columns, diagonal])
    upper = np.concatenate([columns, rows, diagonal])
    matrix = scipy.sparse.coo_matrix((np.concatenate(entries), (lower, upper)))
    wanted = np.zeros(size + count)
    wanted[size:] = -missing.ravel()
    solution = scipy.sparse.linalg.splu(matrix.tocsc()).solve(wanted)
    return np.asarray(solution[:size])
