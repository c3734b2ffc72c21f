"""Units of angles and lengths, and numbers that were probably written in the wrong one."""

from __future__ import annotations

from math import pi

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

ANGLES = {"deg": pi / 180, "rad": 1.0}  # rad
LENGTHS = {"m": 1.0, "mm": 1e-3}  # m
UNITS = ANGLES | LENGTHS

# Usual ranges of an arm's numbers, by which `mixed_units` distinguishes degrees from radians.
_WAYPOINTS_DEG = (4 * pi, 720.0)  # deg; in radians they would be more than two turns
_VELOCITY_RAD = (0.05, 4 * pi)  # rad/s
_WAYPOINTS_RAD = (0.0, 2 * pi)  # rad
_VELOCITY_DEG = (30.0, 1000.0)  # deg/s
_ACCELERATION_DEG = (30.0, 1e5)  # deg/s²
_SLOW_SEGMENT_S = 3.0  # at full velocity; slower segments suggest different units
_SPAN_RAD = 4 * pi  # of one joint; larger spans suggest different units, however dense the samples
_FAST_SEGMENT_S = 0.05  # at full velocity; faster segments suggest different units


def mixed_units(waypoints: Array, velocity: Array, acceleration: Array) -> str | None:
    """Describe why waypoints and limits seem to mix degrees and radians, or return None.

    The numbers are those of a file with one unit. Two signs are needed, on joints that move: sizes
    that are usual for an arm in the supposed units, and durations that only a mixture explains.

    Args:
        waypoints: `(waypoints, joints)`.
        velocity: `(joints, 2)`, `[low, high]`.
        acceleration: `(joints, 2)`, `[low, high]`.
    """
    steps = np.abs(np.diff(waypoints, axis=0))
    moving = steps.any(axis=0)
    angle = np.abs(waypoints[:, moving]).max()
    speed = np.abs(velocity[moving]).min(axis=1)
    thrust = np.abs(acceleration[moving]).min(axis=1)
    # the longest a joint needs for a segment at full velocity: max h / v
    with np.errstate(over="ignore"):  # a limit of 1e-320
        longest = (steps[:, moving] / speed).max()
    span = np.ptp(waypoints[:, moving], axis=0).max()

    sizes = f"waypoints up to {angle:.4g} beside velocity limits of {speed.min():.4g}"
    if speed.max() > speed.min():
        sizes += f" to {speed.max():.4g}"
    sizes += f" ({longest:.2g} s for the longest segment at full velocity)"
    degrees_beside_radians = (
        (longest > _SLOW_SEGMENT_S or span > _SPAN_RAD)
        and _all_within(angle, _WAYPOINTS_DEG)
        and _all_within(speed, _VELOCITY_RAD)
    )
    if degrees_beside_radians:
        return f"{sizes} look like degrees beside radians"
    radians_beside_degrees = (
        longest < _FAST_SEGMENT_S
        and _all_within(angle, _WAYPOINTS_RAD)
        and _all_within(speed, _VELOCITY_DEG)
        and _all_within(thrust, _ACCELERATION_DEG)
    )
    if radians_beside_degrees:
        return f"{sizes} look like radians beside degrees"
    return None


def _all_within(values: Array, ends: tuple[float, float]) -> bool:
    low, high = ends
    return bool(np.all((values >= low) & (values <= high)))
