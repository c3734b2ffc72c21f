"""What a kind of limit must keep, as a function that checks your own kind.

    from trajopt.planners.testing_limits import check_limit

    check_limit(TipSpeed.read({"links": [0.6, 0.4], "speed": 0.5}, joints=2))

It prints what it checked, and raises where something is not kept.
"""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import TrajoptError
from trajopt.core.limits import KINDS, JointState, Limit
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import raised
from trajopt.planners.testing import ContractError

_SEEDS = (0, 1)
_SAMPLES = 2001  # of each piece
_RTOL = 1e-6  # by which the worst use may be above the largest sample, or a dilation too large
_ROUNDING = 1e-9
_WIDER = 0.01
_SHORTER = 1e-3


def check_limit(limit: Limit) -> None:
    """Raise `ContractError` unless a limit keeps what the judge and planners ask of its kind.

    - Its numbers give it again, also as a file states them; it survives pickling.
    - It gives the use of random motions: no sample is above its worst use.
    - A motion after its dilation keeps it, and a little less does not; `widened` widens it.
    - It has as many rows at any state, each with a bound. They hold where the judge says so.
    - A `separate` limit has the same use joint by joint, and in other units.

    Args:
        limit: a limit of the kind, with numbers.

    Raises:
        ContractError: What is not kept.
    """
    key = type(limit).key
    _require(KINDS.get(key) is type(limit), f"{key} is not the key of this class")
    try:
        _check_numbers(limit)
        print(f"{key}: its numbers give it again, in files too")
        if limit.has_rows():
            print(f"{key}: {_rows(limit)} rows, which planners that take rows plan for")
        for seed in _SEEDS:
            motion = _random(len(limit.bounds), seed)
            mirrored = replace(motion, coefficients=-motion.coefficients)
            for name, own in (("motion", motion), ("its mirror image", mirrored)):
                print(f"{key}: {name} {seed}: {_check_motion(limit, own)}")
    except (TrajoptError, AssertionError):
        raise
    except Exception as error:
        raise ContractError(f"{key}: {raised(error)}") from error


def _check_numbers(limit: Limit) -> None:
    kind = type(limit)
    joints = len(limit.bounds)
    given = limit.numbers
    again = {
        "of_numbers": kind.of_numbers(given),
        "read of its table": kind.read(limit.table(), joints),
        "pickling": pickle.loads(pickle.dumps(limit)),
        "converted from rad": limit.converted(np.ones(joints)),
        "widened by nothing": limit.widened(None, 0.0),
    }
    for name, own in again.items():
        same = np.allclose(own.numbers, given, rtol=1e-14, atol=0, equal_nan=True)
        _require(same, f"{limit.key}: {name} gives other numbers")
    _require(
        given.ndim == 2 and len(given) == joints, f"{limit.key}: numbers are no rows of joints"
    )


def _rows(limit: Limit) -> int:
    """Return how many rows it has, the same at any state."""
    joints = len(limit.bounds)
    counts = set()
    for seed in _SEEDS:
        tables = np.random.default_rng(seed).normal(size=(4, joints, 5))
        q, v, a, j = (list(own) for own in tables)
        rows = list(limit.rows(JointState(q, v, a, j, np.zeros(5, dtype=np.intp))))
        counts.add(len(rows))
        for row in rows:
            finite = np.isfinite(row.low).any() or np.isfinite(row.high).any()
            _require(bool(finite), f"{limit.key}: a row without bounds")
            values = np.broadcast_to(row.value, 5)
            _require(bool(np.isfinite(values).all()), f"{limit.key}: a row that is no number")
    _require(len(counts) == 1, f"{limit.key}: the number of rows depends on the state")
    at = JointState(q, v, a, j, np.zeros(5, dtype=np.intp))
    still = at._replace(j=[0 * own for own in j])
    jerky = any(np.any(x.value != y.value) for x, y in zip(rows, limit.rows(still), strict=True))
    _require(not jerky or limit.smooth >= 2, f"{limit.key}: rows with jerk need smooth = 2")
    return counts.pop()


def _check_motion(limit: Limit, motion: Trajectory) -> str:
    use = limit.worst(motion)
    if not limit.is_ratio:
        return f"worst use {use.value:.6g}"
    along = limit.along(motion, _times(motion)).values()
    sampled = max((float(np.max(own)) for own in along), default=0.0)
    above = f"{limit.key}: its worst use is {use.value:.9g}, and {sampled:.9g} at a sample"
    _require(use.value >= sampled - _ROUNDING * max(use.value, 1.0), above)
    dilation = limit.dilation(use, motion)
    if not np.isfinite(dilation) or dilation == 0:
        return f"worst use {use.value:.6g}, dilation {dilation:.6g}"
    kept = limit.worst(motion.dilated(dilation)).value
    _require(kept <= 1 + _RTOL, f"{limit.key}: after its dilation the use is {kept:.9g}")
    faster = motion.dilated(dilation * (1 - _SHORTER))
    _require(limit.worst(faster).value > 1, f"{limit.key}: a smaller dilation is enough")
    if limit.has_rows():
        slower = motion.dilated(dilation * (1 + _RTOL))
        _require(_hold(limit, slower), f"{limit.key}: the judge keeps it, and its rows do not")
        _require(not _hold(limit, faster), f"{limit.key}: its rows keep it, and the judge does not")
    wider = limit.widened(None, _WIDER).worst(motion).value
    _require(wider < use.value, f"{limit.key}: widened, its use is not less")
    if limit.separate:
        _check_units(limit, motion, use.value)
    return f"worst use {use.value:.6g}, dilation {dilation:.6g}"


def _hold(limit: Limit, motion: Trajectory) -> bool:
    """Return whether all rows hold at samples."""
    times = _times(motion)
    q, v, a, j = (list(motion(times, order).T) for order in range(4))
    state = JointState(q, v, a, j, motion.segments_at(times))
    return all(
        bool(((row.value >= row.low) & (row.value <= row.high)).all()) for row in limit.rows(state)
    )


def _times(motion: Trajectory) -> Array:
    """Return samples within all pieces, s: at a break a derivative may jump."""
    shares = np.linspace(_ROUNDING, 1 - _ROUNDING, _SAMPLES)
    return np.ravel(motion.breaks[:-1, None] + shares * motion.lengths[:, None])


def _check_units(limit: Limit, motion: Trajectory, use: float) -> None:
    lengths = np.linspace(0.5, 2.0, motion.joints)
    second = 3.0
    other = motion.dilated(1 / second)
    scaled = Trajectory(other.breaks, other.coefficients / lengths, other.waypoint_times)
    alone = np.eye(motion.joints)  # the others stay at 0
    each = [
        limit.worst(replace(motion, coefficients=motion.coefficients * own)).value for own in alone
    ]
    apart = abs(max(each) - use) <= _RTOL * max(abs(use), 1.0)
    _require(apart, f"{limit.key}: separate, and the use of one joint depends on others")
    found = limit.in_units(second, lengths[:, None]).worst(scaled).value
    same = abs(found - use) <= _RTOL * max(abs(use), 1.0)
    _require(same, f"{limit.key}: in other units its use is {found:.9g} instead of {use:.9g}")


def _random(joints: int, seed: int) -> Trajectory:
    """Return pieces of random polynomials, near 0 and slow enough to be usual."""
    rng = np.random.default_rng(seed)
    breaks = np.append(0.0, np.cumsum(rng.uniform(0.5, 1.5, 3)))
    coefficients: Array = rng.normal(size=(4, 3, joints)) * 0.3
    return Trajectory(breaks, coefficients, breaks[[0, -1]])


def _require(condition: bool, breach: str) -> None:
    if not condition:
        raise ContractError(breach)
