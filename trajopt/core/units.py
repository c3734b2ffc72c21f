"""Units of angles, lengths and times, and numbers that were probably written in the wrong one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import pi

import numpy as np

from trajopt.core.arrays import Array
from trajopt.core.exceptions import InvalidInput

ANGLES = {"deg": pi / 180, "rad": 1.0}  # rad
LENGTHS = {"m": 1.0, "mm": 1e-3}  # m
UNITS = ANGLES | LENGTHS
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9}  # s
UNIT = "unit="  # the key of an error; a command says --unit in its place
_BY_KIND = {"angle": ANGLES, "length": LENGTHS, "time": TIMES}

# Usual ranges of an arm's numbers, by which `mixed_units` distinguishes degrees from radians.
_WAYPOINTS_DEG = (4 * pi, 720.0)  # deg; in radians they would be more than two turns
_VELOCITY_RAD = (0.05, 4 * pi)  # rad/s
_WAYPOINTS_RAD = (0.0, 2 * pi)  # rad
_VELOCITY_DEG = (30.0, 1000.0)  # deg/s
_ACCELERATION_DEG = (30.0, 1e5)  # deg/s²
_SLOW_SEGMENT_S = 3.0  # at full velocity; slower segments suggest different units
_SPAN_RAD = 4 * pi  # of one joint; larger spans suggest different units, however dense the samples
_FAST_SEGMENT_S = 0.05  # at full velocity; faster segments suggest different units


def asked(text: str | None) -> dict[str, str]:
    """Return the units of an option like `unit="deg,mm,ms"`, by "angle", "length" and "time".

    Raises:
        InvalidInput: A unit is unknown, or there are two of a kind.
    """
    found: dict[str, str] = {}
    for unit in text.replace(" ", "").split(",") if text else ():
        kinds = [kind for kind, units in _BY_KIND.items() if unit in units and kind not in found]
        if not kinds:
            right = "deg or rad; with a comma also m or mm, and s, ms, us or ns for times"
            raise InvalidInput(UNIT, right, value=text)
        found[kinds[0]] = unit
    return found


def completed(
    said: Sequence[str | None], slides: Sequence[bool], wanted: Mapping[str, str]
) -> list[str | None]:
    """Return each column's unit: its own, or that of other columns of its kind, or the wanted one.

    Args:
        said: The unit that each column states, or None.
        slides: True for columns of lengths.
        wanted: Units by "angle" and "length", as `asked` returns them.

    Raises:
        InvalidInput: A column contradicts what is wanted, or others of its kind have several units.
    """
    found = []
    for own, slide in zip(said, slides, strict=True):
        kind = "length" if slide else "angle"
        asked_for = wanted.get(kind)
        if own and asked_for not in (own, None):
            raise contradicted(own, asked_for)
        units = [unit for unit in _BY_KIND[kind] if unit in said]
        if not own and len(units) > 1:
            raise InvalidInput("header", "a unit in every column, or one for all of a kind")
        found.append(own or next(iter(units), asked_for))
    return found


def contradicted(own: str, asked_for: str | None) -> InvalidInput:
    """Return the error of a unit that is asked for where the file has its own."""
    return InvalidInput(UNIT, f"left out, or {own} as the file says", value=asked_for)


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
