"""Costates of extremal motions in closed form, where no position limit is active.

Over a segment in normalised time (`costates.py`), a few motions between given states are extremal,
each with its mirror image:

- the longest displacement: jerk up, acceleration at its limit, jerk down, cruise, jerk down,
  deceleration at its limit, jerk up;
- the highest velocity at the end: jerk up, acceleration at its limit, jerk down;
- the highest velocity that the acceleration at the start leads to, and that from which the
  deceleration at the end comes;
- the highest acceleration at the end.

At the exact switching times, a motion's costates give the inequality that a point violates most.
Other switching times give a valid inequality too. An error of a switching time weakens it by the
square of that error.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from baselines.lower_bound import costates
from baselines.lower_bound.costates import CELL_COLUMNS, Costates, Cut
from baselines.lower_bound.relaxation import Relaxation
from trajopt.core.arrays import Array, Bools

# Bisections of a switching time, to 2⁻⁴⁴ of the segment.
_BISECTIONS = 44
# Stand-ins for an infinite jerk limit, in normalised time, where accelerations are about 1. The one
# for a single side is smaller: the acceleration's jump then has a duration that can be computed.
_WIDE_JERK = 1e13
_WIDE_JERK_ONE_SIDE = 1e6
# Narrower cells are left out, in normalised time.
_MIN_WIDTH = 2.0**-34


class NormalisedSegment(NamedTuple):
    """States and limits of segments and joints in normalised time: arrays of one shape.

    Attributes:
        h: Displacements, `h S`.
        v0, v1: Velocities at both ends.
        a0, a1: Accelerations at both ends.
        v_up, v_down: Sizes of the velocity limits.
        a_up, a_down: Sizes of the acceleration limits, `A T`.
        j_up, j_down: Sizes of the jerk limits, `J Q`.
    """

    h: Array
    v0: Array
    v1: Array
    a0: Array
    a1: Array
    v_up: Array
    v_down: Array
    a_up: Array
    a_down: Array
    j_up: Array
    j_down: Array

    def limited(self) -> NormalisedSegment:
        """Replace infinite jerk limits by very wide ones."""
        free_up = np.isinf(self.j_up)
        free_down = np.isinf(self.j_down)
        none = np.where(free_up & free_down, _WIDE_JERK, _WIDE_JERK_ONE_SIDE)
        return self._replace(
            j_up=np.where(free_up, none, self.j_up), j_down=np.where(free_down, none, self.j_down)
        )

    def reversed(self) -> NormalisedSegment:
        """Reverse time: accelerations change their sign, and jerks do not."""
        return self._replace(
            v0=self.v1, v1=self.v0, a0=-self.a1, a1=-self.a0, a_up=self.a_down, a_down=self.a_up
        )


class PhaseEnds(NamedTuple):
    """Ends of the phases of the longest displacement, but for the last one."""

    jerk: Array
    hold: Array
    release: Array
    cruise: Array
    brake: Array
    brake_hold: Array


# limits of a segment that takes almost no time vanish in its units: NaN violates no row
@np.errstate(divide="ignore", invalid="ignore", over="ignore")
def violated(relaxation: Relaxation, x: Array, tolerance: float) -> list[Cut]:
    """Return the most violated inequality of each segment and joint.

    Args:
        relaxation: Its limits are used.
        x: Its variables.
        tolerance: Least violation of an inequality of cost 1; negative for nearly active ones too.
    """
    largest = np.full(relaxation.h.shape, tolerance)
    best: dict[tuple[int, int], Cut] = {}
    for cells in families(_points(relaxation, x)):
        cells[1, ..., 1:] *= -1
        shares, costs = _violations(relaxation, x, cells)
        for number in np.argwhere(shares > tolerance):
            mirrored, segment, joint = number.tolist()
            place = (segment, joint)
            violation = shares[mirrored, segment, joint]
            if violation > largest[place]:
                largest[place] = violation
                chosen = _with_width(cells[mirrored, segment, joint])
                chosen[:, 1:] /= costs[mirrored, segment, joint]
                best[place] = Cut(segment, joint, chosen)
    return list(best.values())


def _violations(relaxation: Relaxation, x: Array, cells: Array) -> tuple[Array, Array]:
    """Return the violations of inequalities at a point, over their costs, and these costs.

    Args:
        relaxation: Its limits are used.
        x: Its variables.
        cells: Costates of all segments and joints, and of their mirror images, `(2, segments,
            joints, cells, 7)`.
    """
    shape = cells.shape[:3]
    _, segments, joints = np.indices(shape).reshape(3, -1)
    given = Costates(segments, joints, cells.reshape(-1, *cells.shape[3:]))
    coefficients, bounds = costates.rows(relaxation, given)
    values = x[relaxation.every_row_columns[segments, joints]]
    values = values * relaxation.every_row_factors[segments, joints]
    terms = coefficients * values
    # the right-hand side holds those of T and Q
    costs = bounds - terms[:, 0] - terms[:, 2]
    gains = terms.sum(axis=1) - terms[:, 0] - terms[:, 2]
    shares = np.where(costs == 0, -np.inf, (gains - costs) / costs)
    return shares.reshape(shape), costs.reshape(shape)


def _widths(cells: Array) -> Array:
    starts = cells[..., 0]
    ends = np.ones_like(starts)
    ends[..., :-1] = starts[..., 1:]
    return ends - starts


def _with_width(cells: Array) -> Array:
    """Leave out cells without width."""
    chosen = cells[_widths(cells) > _MIN_WIDTH]
    chosen[0, 0] = 0.0
    return chosen


def families(point: NormalisedSegment) -> list[Array]:
    """Return costates of all segments and joints and their mirror images, by family.

    Returns:
        Per family `(2, segments, joints, cells, 7)`; cells may have no width.
    """
    limited = point.limited()
    tables = [
        _displacement(limited),
        _end_velocity(limited),
        _velocity_after_start(limited),
        _velocity_before_end(limited),
        _end_acceleration(limited),
    ]
    for cells in tables:
        _without_free_jerk(point, cells)
    return tables


def _points(relaxation: Relaxation, x: Array) -> NormalisedSegment:
    """Return all segments and joints, then their mirror images: `(2, segments, joints)`."""
    v0, v1 = x[relaxation.velocity_at]
    after, before = x[relaxation.scaled_at] * relaxation.scaled_factors
    time = x[relaxation.time][:, None]
    square = x[relaxation.square][:, None]
    j_down, j_up = relaxation.j
    a_down, a_up = relaxation.a
    v_down = relaxation.v[0] * np.ones_like(time)
    v_up = relaxation.v[1] * np.ones_like(time)
    h = relaxation.h * x[relaxation.inverse][:, None]
    if relaxation.tolerant:
        start, end = x[relaxation.offset_at]
        h = h + end - start
    return NormalisedSegment(
        h=_mirrored(h, -h),
        v0=_mirrored(v0, -v0),
        v1=_mirrored(v1, -v1),
        a0=_mirrored(after, -after),
        a1=_mirrored(before, -before),
        v_up=_mirrored(v_up, v_down),
        v_down=_mirrored(v_down, v_up),
        a_up=_mirrored(a_up * time, a_down * time),
        a_down=_mirrored(a_down * time, a_up * time),
        j_up=_mirrored(j_up * square, j_down * square),
        j_down=_mirrored(j_down * square, j_up * square),
    )


def _mirrored(values: Array, mirrored: Array) -> Array:
    return np.stack([values, mirrored])


def _without_free_jerk(point: NormalisedSegment, cells: Array) -> None:
    """Set `p` to 0 where its sign has no jerk limit: such phases take no time."""
    p0 = cells[..., 1]
    p1 = cells[..., 2]
    p2 = cells[..., 3]
    # in the middle of the cell
    s = _widths(cells) / 2
    p = p0 + s * (p1 + s * p2)
    free_up = np.isinf(point.j_up)[..., None]
    free_down = np.isinf(point.j_down)[..., None]
    upwards = free_up & (p > 0)
    downwards = free_down & (p < 0)
    both = free_up & free_down
    cells[upwards | downwards | both, 1:4] = 0.0


def _cell(
    start: Array,
    *,
    p0: Array | float = 0.0,
    p1: Array | float = 0.0,
    p2: float = 0.0,
    q0: Array | float = 0.0,
    q1: float = 0.0,
    slope: float = 0.0,
) -> Array:
    """Return a cell as `costates.row` takes it, `(..., 7)`."""
    cell = np.empty((*start.shape, CELL_COLUMNS))
    columns = (start, p0, p1, p2, q0, q1, slope)
    for number, column in enumerate(columns):
        cell[..., number] = column
    return cell


# --- the longest displacement ---


def _displacement(point: NormalisedSegment) -> Array:
    """Return the costates of the longest displacement.

    `λ = 1`. `q = m − τ`, but 0 in the cruise. `p' = −q`, but 0 while acceleration is held. While
    jerk is at its lower limit, from `r` to `s`, `p = (τ − r)(τ − s)/2`, so `m` is the mean of `r`
    and `s`. Without a cruise the two such phases are one.
    """
    at = _instants(point)
    cruises = at.cruise > at.release
    first_root = np.where(cruises, at.cruise, at.hold)
    last_root = np.where(cruises, at.release, at.brake)
    m_rise = (at.hold + last_root) / 2
    m_fall = (first_root + at.brake) / 2
    zero = np.zeros_like(m_rise)

    # p = ∫ q from the start to the end of the first phase
    p_start = at.jerk * (m_rise - at.jerk / 2)
    p_fall = (at.cruise - first_root) * (at.cruise - at.brake) / 2
    rising_jerk = _turning(zero, m_rise, p0=p_start)
    holding = _held(at.jerk, m_rise)
    releasing = _turning(at.hold, m_rise)
    # without a cruise its cell has no width, and continues what is beside it
    cruising = _cell(
        at.release,
        p0=np.where(cruises, 0.0, p_fall),
        q0=np.where(cruises, 0.0, m_fall - at.cruise),
        slope=1.0,
    )
    braking_jerk = _turning(at.cruise, m_fall, p0=p_fall)
    braking = _held(at.brake, m_fall)
    ending = _turning(at.brake_hold, m_fall)
    phases = [rising_jerk, holding, releasing, cruising, braking_jerk, braking, ending]
    return np.stack(phases, axis=-2)


def _turning(start: Array, m: Array, p0: Array | float = 0.0) -> Array:
    """Return a cell in which jerk is at a limit: `q = m − τ` and `p' = −q`."""
    return _cell(start, p0=p0, p1=start - m, p2=0.5, q0=m - start, q1=-1.0, slope=1.0)


def _held(start: Array, m: Array) -> Array:
    """Return a cell in which acceleration is at a limit: `q = m − τ` and `p = 0`."""
    return _cell(start, q0=m - start, q1=-1.0, slope=1.0)


def _instants(point: NormalisedSegment) -> PhaseEnds:
    """Return the switching times, with a cruise if the peak velocity would exceed its limit."""

    def is_early(instant: Array) -> Bools:
        _, _, velocity = _falling(point, instant)
        return velocity <= point.v1

    hold = _latest(is_early, point)
    jerk, peak, _ = _rising(point, hold)
    brake, brake_hold, _ = _falling(point, hold)
    middle = (hold + brake) / 2
    direct = PhaseEnds(jerk, hold, middle, middle, brake, brake_hold)
    cruises = (_height(point, hold) > point.v_up) & (peak > 0)
    if not cruises.any():
        return direct
    by_cruise = _with_cruise(point)
    return PhaseEnds(*np.where(cruises, by_cruise, direct))


def _with_cruise(point: NormalisedSegment) -> PhaseEnds:
    rise = _to_cruise(point)
    fall = _to_cruise(point.reversed())
    # the rise and the fall meet in the middle if there is no time for a cruise
    meeting = (rise[2] + 1 - fall[2]) / 2
    middle = np.clip(meeting, 0.0, 1.0)
    jerk, hold, release = np.minimum(rise, middle)
    fall = np.minimum(fall, 1 - middle)
    brake_hold, brake, cruise = 1 - fall
    return PhaseEnds(jerk, hold, release, cruise, brake, brake_hold)


def _to_cruise(point: NormalisedSegment) -> Array:
    """Return when a rise reaches full acceleration, leaves it, and is at the velocity limit."""

    def is_low(instant: Array) -> Bools:
        return _height(point, instant) <= point.v_up

    hold = _latest(is_low, point)
    jerk, peak, _ = _rising(point, hold)
    release = hold + np.maximum(peak, 0.0) / point.j_down
    return np.stack([jerk, hold, np.minimum(release, 1.0)])


def _latest(holds: Callable[[Array], Bools], point: NormalisedSegment) -> Array:
    """Return the latest instant up to which a condition holds; 0 if it never holds."""
    low = np.zeros_like(point.v0)
    high = np.ones_like(point.v0)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        true = holds(middle)
        low = np.where(true, middle, low)
        high = np.where(true, high, middle)
    return low


def _rising(point: NormalisedSegment, instant: Array) -> tuple[Array, Array, Array]:
    """Return when acceleration is full, its peak, and the velocity gained until an instant."""
    missing = point.a_up - point.a0
    ramp = np.clip(missing / point.j_up, 0.0, 1.0)
    full = np.minimum(ramp, instant)
    peak = point.a0 + point.j_up * full
    ramped = full * (point.a0 + peak) / 2
    held = (instant - full) * peak
    return full, peak, ramped + held


def _height(point: NormalisedSegment, instant: Array) -> Array:
    """Return the final velocity of a rise that is released at an instant."""
    _, peak, gained = _rising(point, instant)
    released = np.maximum(peak, 0.0) ** 2 / (2 * point.j_down)
    return point.v0 + gained + released


def _falling(point: NormalisedSegment, instant: Array) -> tuple[Array, Array, Array]:
    """Return when deceleration is full, when it is released, and the velocity at the end.

    Jerk is at its limit downwards from the instant, and upwards at last, so that the acceleration
    at the end is the given one.
    """
    _, peak, gained = _rising(point, instant)
    # peak − J (τ − s) meets a1 − J' (1 − τ)
    over = peak + point.j_down * instant - point.a1 + point.j_up
    meets = over / (point.j_down + point.j_up)
    meets = np.clip(meets, instant, 1.0)
    lowest = peak - point.j_down * (meets - instant)
    is_held = lowest < -point.a_down
    full = instant + (peak + point.a_down) / point.j_down
    leaves = 1 - (point.a1 + point.a_down) / point.j_up
    brake = np.where(is_held, full, meets)
    brake = np.clip(brake, instant, 1.0)
    brake_hold = np.where(is_held, leaves, meets)
    brake_hold = np.clip(brake_hold, brake, 1.0)

    trough = peak - point.j_down * (brake - instant)
    end = trough + point.j_up * (1 - brake_hold)
    lost = (brake - instant) * (peak + trough) / 2
    held = (brake_hold - brake) * trough
    eased = (1 - brake_hold) * (trough + end) / 2
    velocity = point.v0 + gained + lost + held + eased
    return brake, brake_hold, velocity


# --- the others ---


def _end_velocity(point: NormalisedSegment) -> Array:
    """Return the costates of the highest end velocity.

    `q = 1`. `p` falls to 0, stays 0 while acceleration is held, and falls again.
    """
    rise = (point.a_up - point.a0) / point.j_up
    fall = (point.a_up - point.a1) / point.j_down
    # without a hold a0 + J s = a1 + J' (1 − s)
    over = point.a1 - point.a0 + point.j_down
    meets = over / (point.j_up + point.j_down)
    is_held = rise + fall < 1
    jerk = np.where(is_held, rise, meets)
    jerk = np.clip(jerk, 0.0, 1.0)
    hold = np.where(is_held, 1 - fall, meets)
    hold = np.clip(hold, jerk, 1.0)
    phases = [
        _cell(np.zeros_like(jerk), p0=jerk, p1=-1.0, q0=1.0),
        _cell(jerk, q0=1.0),
        _cell(hold, p1=-1.0, q0=1.0),
    ]
    return np.stack(phases, axis=-2)


def _velocity_after_start(point: NormalisedSegment) -> Array:
    """Return the costates of the velocity after the start: `q = −1` until acceleration is 0."""
    release = np.clip(point.a0 / point.j_down, 0.0, 1.0)
    phases = [_cell(np.zeros_like(release), p0=-release, p1=1.0, q0=-1.0), _cell(release)]
    return np.stack(phases, axis=-2)


def _velocity_before_end(point: NormalisedSegment) -> Array:
    """Return the costates of the velocity before the end: `q = 1` once deceleration begins."""
    braking = np.clip(-point.a1 / point.j_down, 0.0, 1.0)
    phases = [_cell(np.zeros_like(braking)), _cell(1 - braking, p1=-1.0, q0=1.0)]
    return np.stack(phases, axis=-2)


def _end_acceleration(point: NormalisedSegment) -> Array:
    """Return the costates of the highest end acceleration: `p = 1`."""
    whole = _cell(np.zeros_like(point.a0), p0=1.0)
    return whole[..., None, :]
