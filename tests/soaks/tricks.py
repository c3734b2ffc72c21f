"""Can the judge be cheated? Motions that claim less than an optimum known in closed form.

    python tests/soak.py tricks           # some seconds
    python tests/soak.py tricks --quick   # one trick in ten

A trick is a problem whose minimum time is known in closed form, and a motion that is faster by as
much as a tolerance, an overflow or rounding might accept. `tricks.toml` lists the families. Every
trick is judged in four ways: as it is; as the certified motion, judged again; with waypoint times
found from the motion; and from a CSV file, as `trajopt judge` reads it.

*Claimed* and *certified* are percent above the optimum. Exit code 1 if a trick is certified below
the optimum.

Throughout, `h` is a displacement (rad), `V`, `A` and `J` are the limits of velocity, acceleration
and jerk (rad/s, rad/s², rad/s³), `v0` and `a0` are a velocity and an acceleration at the start.
"""

from __future__ import annotations

import math
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from experiments.common.output import say
from soaks import soak_report
from trajopt import judgement
from trajopt.core import polynomials
from trajopt.core.arrays import Array
from trajopt.core.exceptions import TrajoptError
from trajopt.core.limits import LIMIT_NAMES, Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.formats import samples_csv
from trajopt.formats.samples import Samples
from trajopt.judging.passing import waypoint_times
from trajopt.judging.verification import certified, verify

Phase = tuple[float, float | None, float]  # duration, acceleration (None: it continues), jerk

FAMILIES = tomllib.loads((soak_report.DATA / "tricks.toml").read_text(encoding="utf-8"))
CERTIFIED_BELOW = 1e-9  # relative to the optimum; rounding


@dataclass(frozen=True)
class Trick:
    """A motion that claims less than the optimum.

    Attributes:
        family: How it cheats.
        name: Different for every trick.
        optimum: s, or a proved lower bound of it that the motion claims to beat.
    """

    family: str
    name: str
    problem: Problem
    trajectory: Trajectory
    optimum: float

    @property
    def limits(self) -> str:
        """Return which kinds of limits the problem has beside velocity and acceleration."""
        return _limits(self.problem)


Case = tuple[Problem, Trajectory, float]


def tricks() -> list[Trick]:
    """Return every trick of every family."""
    found: dict[str, list[Trick]] = {}
    for key, family in FAMILIES.items():
        if "change" in family:
            given = [trick for other in family["of"] for trick in found[other]]
            found[key] = list(_changed(family, given))
        else:
            found[key] = list(_built(family))
    return [trick for own in found.values() for trick in own]


def _built(family: dict[str, Any]) -> Iterator[Trick]:
    build = globals()[family["build"]]
    title = family["name"]
    for also in family.get("also", [None]):
        limits = {} if also is None else {"also": also}
        for case in family["cases"]:
            problem, trajectory, optimum = build(**case, **limits)
            said = [f"{name} = {value:g}" for name, value in case.items()]
            where = f"{title} ({_limits(problem)})"
            name = f"{where}: {', '.join(said)}"
            yield Trick(title, name, problem, trajectory, optimum)


def _changed(family: dict[str, Any], tricks: Sequence[Trick]) -> Iterator[Trick]:
    change = globals()[family["change"]]
    for trick in tricks:
        problem, trajectory = change(trick.problem, trick.trajectory)
        name = f"{family['change']}, {trick.name}"
        yield replace(
            trick, family=family["name"], name=name, problem=problem, trajectory=trajectory
        )


def _limits(problem: Problem) -> str:
    return ", ".join(name for name in LIMIT_NAMES if problem.has(name))


# --- optima and honest motions ---


def least_time(h: float, V: float, A: float) -> float:
    """Return the least time from rest to rest over `h`, s.

    Two parabolas, and a cruise between them where `h > V²/A`.
    """
    if h * A <= V**2:
        # T = 2 √(h / A)
        return float(2 * (h / A) ** 0.5)
    # T = h / V + V / A
    return h / V + V / A


def least_time_of_jerk(h: float, J: float) -> float:
    """Return the least time from rest to rest over `h` under a jerk limit `J` alone, s.

    Four phases of `cbrt(h / 2J)` each.
    """
    return 4 * math.cbrt(h / (2 * J))


def least_time_of_swing(h: float, J: float) -> float:
    """Return the least time between two turns `h` apart under a jerk limit `J` alone, s.

    `cbrt(12 h / J)`.
    """
    return math.cbrt(12 * h / J)


def least_time_of_turn(h: float, J: float) -> float:
    """Return the least time between two turns `h` apart, s: acceleration 1, or jerk `J` alone."""
    if math.isinf(J):
        return least_time(h, np.inf, 1.0)
    return least_time_of_swing(h, J)


def driven(phases: Sequence[Phase], x: float = 0.0, v: float = 0.0, a: float = 0.0) -> Trajectory:
    """Return the motion of one joint from its phases, with continuous position and velocity."""
    breaks = [0.0]
    columns = []
    for duration, acceleration, jerk in phases:
        if acceleration is not None:
            a = acceleration
        if duration <= 0:
            continue
        columns.append([jerk / 6, a / 2, v, x])
        breaks.append(breaks[-1] + duration)
        x += ((jerk / 6 * duration + a / 2) * duration + v) * duration
        v += (jerk / 2 * duration + a) * duration
        a += jerk * duration
    return one_joint(breaks, columns)


def one_joint(breaks: ArrayLike, columns: ArrayLike) -> Trajectory:
    """Return the motion of one joint from its pieces, a column of coefficients each.

    Its waypoints are its two ends.
    """
    coefficients = np.array(columns, dtype=float).T[..., None]
    times = np.asarray(breaks, dtype=float)
    return Trajectory(times, coefficients, times[[0, -1]])


def together(joints: Sequence[Trajectory], times: ArrayLike) -> Trajectory:
    """Return the motion of several joints, each on breaks of its own."""
    parts = [(joint.breaks, joint.coefficients[..., 0]) for joint in joints]
    return Trajectory.joined(parts, times)


def rest_to_rest(h: float, V: float, A: float, v0: float = 0.0) -> Trajectory:
    """Return a motion over `h` that begins and ends with the velocity `v0`."""
    # h = (p² − v0²) / A without a cruise
    peak = min(V, (h * A + v0**2) ** 0.5)
    rise = (peak - v0) / A
    cruise = 0.0
    if peak == V:
        # h = V cruise + (V² − v0²) / A
        rest = h - (V**2 - v0**2) / A
        cruise = max(0.0, rest / V)
    phases = [(rise, A, 0.0), (cruise, 0.0, 0.0), (rise, -A, 0.0)]
    return driven(phases, v=v0)


def smooth_cruise(h: float, J: float) -> Trajectory:
    """Return the fastest motion from rest to rest over `h`, limits 1, 1 and the jerk `J`."""
    ramp = 1 / J
    steady = 1 - ramp
    cruise = h - 1 - ramp
    phases = [
        (ramp, None, J),
        (steady, 1.0, 0.0),
        (ramp, None, -J),
        (cruise, 0.0, 0.0),
        (ramp, None, -J),
        (steady, -1.0, 0.0),
        (ramp, None, J),
    ]
    return driven(phases)


def instead_of_move(
    cheat: Trajectory, h: float = 1.0, V: float = 1.0, A: float = 1.0, start: float = 0.0
) -> Case:
    """Return a trick: a motion that claims to be one joint's over `h`."""
    limits = Limits([V], [A])
    problem = Problem([[start], [start + h]], limits)
    moved = float(problem.displacements[0, 0])
    return problem, cheat, least_time(moved, V, A)


# --- builders of families ---


def head_start(V: float, A: float, h: float, share: float) -> Case:
    """Return tricks whose velocity jumps by a share of its limit at both ends."""
    reachable = (h * A) ** 0.5
    v0 = min(share * V, 0.9 * reachable)
    return instead_of_move(rest_to_rest(h, V, A, v0), h, V, A)


def accelerated_start(A: float, a0: float) -> Case:
    """Return a motion over 1 rad with a jerk of 1 whose acceleration begins at `a0`, not at 0."""
    # d up, 2 s down and d up, with s = d + a0, cover 2 s³ − 2 a0² s + 2 a0³/3 = 1: Newton's method.
    s = 0.5 ** (1 / 3)
    for _ in range(50):
        missing = s**3 - a0**2 * s + a0**3 / 3 - 0.5
        s -= missing / (3 * s**2 - a0**2)
    d = s - a0
    cheat = driven([(d, a0, 1.0), (2 * s, None, -1.0), (d, None, 1.0)])
    limits = Limits([1e3], [A], jerk=[1.0])
    return Problem([[0.0], [1.0]], limits), cheat, least_time_of_jerk(1.0, 1.0)


def short_way(coordinate: float, h: float, short: float) -> Case:
    """Return tricks in which a joint starts late and ends early, beside one that rests."""
    limits = Limits([1.0, 1.0], [1.0, 1.0])
    problem = Problem([[coordinate, 0.0], [coordinate, h]], limits)
    moved = float(problem.displacements[0, 1])
    optimum = least_time(moved, 1.0, 1.0)
    covered = h - short
    own = driven([(1e-3 * optimum, 0.0, 0.0)])
    if covered > 0:
        own = rest_to_rest(covered, 1.0, 1.0)
    rest = driven([(own.duration, 0.0, 0.0)], coordinate)
    late = _shifted(own, short / 2)
    return problem, together([rest, late], own.waypoint_times), optimum


def _shifted(motion: Trajectory, x: float) -> Trajectory:
    coefficients = np.array(motion.coefficients)
    coefficients[-1] += x
    return replace(motion, coefficients=coefficients)


def short_at_coordinate(coordinate: float, h: float) -> Case:
    """Return moves at a coordinate whose last place is large beside the move."""
    moved = coordinate + h - coordinate
    covered = moved - 0.9 * float(np.spacing(coordinate))
    own = rest_to_rest(covered, 1.0, 1.0)
    return instead_of_move(_shifted(own, coordinate), h, start=coordinate)


def position_steps(pieces: int) -> Case:
    """Return a trick: a shorter move, and a jump of 0.9e-8 rad at every break."""
    step = 0.9e-8
    own = rest_to_rest(1.0 - step * (pieces - 1), 100.0, 1.0)
    breaks = np.linspace(0.0, own.duration, pieces + 1)
    columns = []
    for i, t in enumerate(breaks[:-1]):
        (x,) = own(t)
        (v,) = own(t, 1)
        (a,) = own(t, 2)
        columns.append([a / 2, v, x + i * step])
    return instead_of_move(one_joint(breaks, columns), V=100.0)


def velocity_steps(pieces: int) -> Case:
    """Return a trick within the acceleration limit that gains 0.9e-6 rad/s at every break."""
    own = rest_to_rest(1.0, 100.0, 1.0 + 1.8e-6 * pieces)
    breaks = np.linspace(0.0, own.duration, pieces + 1)
    columns = []
    for t in breaks[:-1]:
        (x,) = own(t)
        (v,) = own(t, 1)
        speeds_up = t + 1e-12 < own.duration / 2
        columns.append([0.5 if speeds_up else -0.5, v, x])
    return instead_of_move(one_joint(breaks, columns), V=100.0)


def overflow(length: float, first: float, second: float) -> Case:
    """Return a trick of half the optimum whose first piece has coefficients that overflow."""
    fast = rest_to_rest(1.0, 200.0, 4.0)
    breaks = np.concatenate([[0.0, length], fast.breaks[1:]])
    coefficients = np.zeros((10, 3, 1))
    coefficients[-4:, 1:] = fast.coefficients
    coefficients[0, 0, 0] = first
    coefficients[1, 0, 0] = second
    cheat = Trajectory(breaks, coefficients, breaks[[0, -1]])
    return instead_of_move(cheat, V=100.0)


def short_piece(length: float) -> Case:
    """Return a trick that covers the way within `length` seconds."""
    with np.errstate(over="ignore"):
        slope = float(min(np.float64(1.0) / length, 1.7e308))
    breaks = [0.0, length, 1.0]
    cheat = one_joint(breaks, [[slope, 0.0], [0.0, 1.0]])
    return instead_of_move(cheat)


def turn_left_out(gap: float) -> Case:
    """Return a trick through 0, 1, 1 + h, 1, 2 that passes the middle three within `2 gap` s."""
    h = 1e-9
    waypoints = [[0.0], [1.0], [1.0 + h], [1.0], [2.0]]
    problem = Problem(waypoints, Limits([1.0], [1.0]))
    own = rest_to_rest(2.0, 1.0, 1.0)
    middle = own.duration / 2
    near = [middle - gap, middle, middle + gap]
    times = np.array([0.0, *near, own.duration])
    # It stops at 1 + h, turns back and goes on from at most 1.
    optimum = least_time(1 + h, 1.0, 1.0) + least_time(1.0, 1.0, 1.0)
    return problem, replace(own, waypoint_times=times), optimum


def cancelling_terms(size: float) -> Case:
    """Return a trick: half the optimum, plus `size · s³ (s − 1)³ (s − 1/2)`, zero at both ends."""
    fast = rest_to_rest(1.0, 2.0, 4.0)
    bump = size * np.poly([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.5])
    coefficients = np.zeros((8, len(fast.lengths), 1))
    coefficients[-4:] = fast.coefficients
    bumps = np.tile(bump[:, None], len(fast.lengths))
    coefficients[..., 0] += polynomials.stretched(bumps, 1 / fast.lengths)
    return instead_of_move(replace(fast, coefficients=coefficients))


def smooth_step(rests: int) -> Case:
    """Return a trick of half the optimum, one polynomial with zero derivatives at both ends."""
    slope = np.poly([0.0] * rests + [1.0] * rests)
    rise = np.polyint(slope)
    rise /= rise.sum()
    unit = one_joint([0.0, 1.0], [rise])
    return instead_of_move(unit)


def too_fast(by: float, also: str) -> Case:
    """Return the optimum, run faster by less than the tolerance of limits."""
    jerk = [1e3] if "jerk" in also else None
    position = [[0.0, 5.0]] if "position" in also else None
    problem = Problem([[0.0], [5.0]], Limits([1.0], [1.0], jerk=jerk, position=position))
    optimal = smooth_cruise(5.0, 1e3) if jerk else rest_to_rest(5.0, 1.0, 1.0)
    return problem, optimal.dilated(1 - by), optimal.duration


def passages(
    turns: int, d: float, slope: float, also: str, elapsed: float = 0.0, coordinate: float = 0.0
) -> Case:
    """Two joints at the same speed, past pairs of waypoints `d` and `slope · d` apart.

    Between the two of a pair the second joint's mean velocity is at most `slope`, so its velocity
    at the pair is at most `slope + A L / 2` after `L` seconds. That costs it `(1 − slope)²` seconds
    at least, which no `L` makes less.
    """
    jerk = [1e3, 1e3] if "jerk" in also else None
    position = [1e7, 1e7] if "position" in also else None
    limits = Limits([1.0, 1.0], [1.0, 1.0], jerk=jerk, position=position)
    end = turns + 1.0
    waypoints = [[0.0, coordinate]]
    passed = []
    for turn in range(1, turns + 1):
        there = coordinate + turn
        waypoints.append([turn, there])
        waypoints.append([turn + d, there + slope * d])
        time = turn + 0.5
        passed += [time, time + elapsed]
    waypoints.append([end, coordinate + end])
    own = smooth_cruise(end, 1e3) if jerk else rest_to_rest(end, 1.0, 1.0)
    joints = [own, _shifted(own, coordinate)]
    duration = own.duration
    late = (duration - end - 1) / 2
    times = [0.0, *(time + late for time in passed), duration]
    lost = (1 - max(slope, 0.0)) ** 2
    optimum = end + 1 + turns * lost
    return Problem(waypoints, limits), together(joints, times), optimum


def passages_at_coordinate(turns: int, d: float, also: str) -> Case:
    """Return a trick whose second joint moves by one unit in the last place of its coordinate."""
    coordinate = 1e5
    slope = float(np.spacing(coordinate)) / d
    return passages(turns, d, slope, also, elapsed=d, coordinate=coordinate)


def tiny_swings(swings: int, each: float) -> Case:
    """Straight lines of the first joint, whose velocity jumps by three rounding units.

    Before the swings the second joint takes the time; the third one, which rests but for next to
    nothing, keeps the waypoints apart.
    """
    J = 1.0
    A = 1e8
    big = 0.002
    quintic = 0.5  # s
    begin = 1 + 1 / A
    fastest = 1.875 * big / quintic
    h = 1.5 * np.finfo(float).eps * fastest * each
    turns = np.arange(swings + 1)
    times = np.concatenate([[0.0], begin + each * turns])
    waypoints = np.zeros((swings + 2, 3))
    waypoints[0, 0] = -big
    waypoints[1:, 0] = h * (turns % 2)
    waypoints[1:, 1] = 1.0
    waypoints[1:, 2] = 1e-20 * turns
    rise = _quintic(quintic, big)
    rise[-1] = -big
    lengths = np.diff(times)
    slopes = np.diff(waypoints, axis=0) / lengths[:, None]
    lines = np.stack([slopes, waypoints[:-1]])
    swinging = np.zeros((6, swings + 2))
    swinging[4:, 1:] = lines[..., 0]
    swinging[:, 0] = rise
    swinging[:, 1] = 0.0
    ends = times[[0, -1]]
    breaks = np.insert(times, 1, quintic)
    first = Trajectory(breaks, swinging[..., None], ends)
    # a break where the quintic is at its fastest
    first = first.refined([quintic / 2])
    ramp = 1 / A
    second = driven(
        [(ramp, A, 0.0), (1 - ramp, 0.0, 0.0), (ramp, -A, 0.0), (times[-1] - begin, 0.0, 0.0)]
    )
    third = Trajectory(times, lines[..., 2:], ends)
    unlimited = [np.inf, np.inf]
    limits = Limits([1.0] * 3, [1.0, A, A], jerk=[J, *unlimited])
    optimum = 1 + (swings - 2) * least_time_of_swing(h, J)
    cheat = together([first, second, third], times)
    return Problem(waypoints, limits), cheat, optimum


def swings_within_tolerance(swings: int, h: float, each: float, also: str) -> Case:
    """Straight lines there and back, where each swing takes from rest to rest.

    Before the swings a second joint takes 2 s, less at most half of the first swing.
    """
    jerk = [10.0, np.inf] if "jerk" in also else None
    position = [[0.0, 1.0], [0.0, 1.0]] if "position" in also else None
    limits = Limits([9.0, 9.0], [1.0, 1.0], jerk=jerk, position=position)
    turns = np.arange(swings + 1)
    times = np.concatenate([[0.0], 2 + each * turns])
    waypoints = np.zeros((swings + 2, 2))
    swung = h * (turns % 2)
    waypoints[1:, 0] = 0.5 - swung
    waypoints[1:, 1] = 1.0
    columns = np.zeros((6, swings + 1))
    columns[:, 0] = _quintic(2.0, 0.5)
    columns[5, 1:] = waypoints[1:-1, 0]
    columns[4, 1:] = -np.diff(swung) / np.diff(times[1:])
    first = one_joint(times, columns.T)
    rest = times[-1] - 2
    second = driven([(1.0, 1.0, 0.0), (1.0, -1.0, 0.0), (rest, 0.0, 0.0)])
    swing = least_time_of_swing(h, 10.0) if jerk else least_time(h, 9.0, 1.0)
    optimum = 2 + (swings - 1) * swing
    return Problem(waypoints, limits), together([first, second], times), optimum


def alternating(steps: int, size: float, joints: int, also: str, by: float) -> Case:
    """Tiny steps in line at full speed, the second joint's alternately longer by four last places.

    Missed by their rounding they are in line, so the optimum is that of the straight way, and the
    motion is faster by less than the tolerance of limits.
    """
    jerk = [1.0] * joints if "jerk" in also else None
    last_place = float(np.spacing(2.0))
    ways = size * np.arange(steps + 1)
    line = np.concatenate([[0.0], 2.0 + ways, [4.0]])
    waypoints = np.repeat(line[:, None], joints, axis=1)
    waypoints[1:-1, 1:] += 4 * last_place * (np.arange(steps + 1) % 2)[:, None]
    motion = smooth_cruise(4.0, 1.0) if jerk else rest_to_rest(4.0, 1.0, 1.0)
    # it cruises at 2 rad, at a velocity of 1
    middle = motion.duration / 2
    times = np.concatenate([[0.0], middle + ways, [motion.duration]])
    limits = Limits([1.0] * joints, [1.0] * joints, jerk=jerk)
    cheat = together([motion] * joints, times).dilated(1 - by)
    return Problem(waypoints, limits), cheat, motion.duration


def stairs(steps: int, size: float, also: str) -> Case:
    """Two joints that take tiny steps in turn, on their diagonal at full speed.

    Of two steps `L1 + L2` is at least `sqrt(2 d / A)`: a joint's mean velocity is 0 in one step and
    `d / L` in the other. So its velocity falls below `sqrt(2 d A)` among the stairs, and what
    lies before and after takes 2 s each but for that.
    """
    jerk = [1e3, 1e3] if "jerk" in also else None
    taken = np.arange(steps + 1)
    waypoints = np.zeros((steps + 3, 2))
    waypoints[1:-1, 0] = 1.0 + size * (taken - taken // 2)
    waypoints[1:-1, 1] = 1.0 + size * (taken // 2)
    waypoints[-1] = 2.0
    motion = smooth_cruise(2.0, 1e3) if jerk else rest_to_rest(2.0, 1.0, 1.0)
    passed = motion.duration / 2 + size / 2 * (taken + 0.5)
    times = np.concatenate([[0.0], passed, [motion.duration]])
    slowest = float((2 * size) ** 0.5)
    optimum = 2 * least_time(1.0, 1.0, 1.0) - 2 * slowest - 2 * size * steps
    limits = Limits([1.0, 1.0], [1.0, 1.0], jerk=jerk)
    return Problem(waypoints, limits), together([motion, motion], times), optimum


def zigzag(swings: int, h: float, step: float, spared: int, missed: int, also: str) -> Case:
    """A joint swings by `h`, less what it `missed` on both sides, while another one takes a step.

    `missed` and `spared` count roundings of coordinates. Waypoints in line may be missed by one: it
    is `spared`. Between two waypoints beside one another the joint turns, and from turn to turn it
    takes `cbrt(12 h / J)` or `2 sqrt(h / A)`. Before and after its swings the other one takes 1 s.
    """
    away = 0.01
    jerk = 1.0 if "jerk" in also else np.inf
    fast = 1e9
    turns = np.arange(swings + 1)
    waypoints = np.ones((swings + 3, 2))
    waypoints[0, 0] = 0.0
    waypoints[1:-1, 0] += step * turns
    waypoints[-1, 0] += step * swings + 1.0
    waypoints[1:-1, 1] += h * (turns % 2)
    waypoints[-1, 1] += away
    limits = Limits([1.0, 1.0], [fast, 1.0], jerk=[np.inf, jerk])
    problem = Problem(waypoints, limits)
    _, rounding = problem.rounding
    swung = h - 2 * missed * rounding
    least = least_time_of_turn(h - 2 * spared * rounding, jerk)
    each = least_time_of_turn(swung, jerk)
    pace = step / each
    slowing = (1 - pace) / fast
    # 1 rad at a velocity of 1, but for its ramps
    wait = 1 + 0.5 / fast + slowing * (1 - pace) / 2
    rest = wait - 1 / fast - slowing
    there = [(1 / fast, fast, 0.0), (rest, 0.0, 0.0), (slowing, -fast, 0.0)]
    back = [(duration, -acceleration, 0.0) for duration, acceleration, _ in there[::-1]]
    first = driven([*there, (each * swings, 0.0, 0.0), *back])
    # as steep at the first turn as between two swings
    steep = 1.0 if np.isinf(jerk) else jerk * each / 2
    bend = steep * wait**2 / 2
    rise = bend * _per_duration([1.0, -2.0, 1.0, 0.0, 0.0, 0.0], wait)
    fall = bend * _per_duration([-1.0, 3.0, -3.0, 1.0, 0.0, 0.0], wait) + _quintic(wait, away)
    rise[-1] = fall[-1] = 1.0
    phases: list[Phase] = []
    for turn in range(swings):
        sign = 1.0 - 2.0 * (turn % 2)
        if np.isinf(jerk):
            phases += [(each / 2, sign, 0.0), (each / 2, -sign, 0.0)]
        else:
            phases.append((each, sign * steep, -sign * jerk))
    swinging = driven(phases, x=1.0 + missed * rounding)
    middle = np.zeros((6, len(phases)))
    middle[2:] = swinging.coefficients[..., 0]
    breaks = np.concatenate([[0.0], wait + swinging.breaks, [2 * wait + swinging.duration]])
    second = one_joint(breaks, np.column_stack([rise, middle, fall]).T)
    times = np.concatenate([[0.0], wait + each * turns, [breaks[-1]]])
    optimum = 2.0 + (swings - 2) * least
    return problem, together([first, second], times), optimum


def _quintic(duration: float, h: float) -> Array:
    """From rest to rest over `h`, `(6,)`: 10 s³ − 15 s⁴ + 6 s⁵."""
    return h * _per_duration([6.0, -15.0, 10.0, 0.0, 0.0, 0.0], duration)


def _per_duration(shape: Sequence[float], duration: float) -> Array:
    """Return the coefficients in powers of time, s, of a quintic of the share of the duration."""
    powers = np.arange(5, -1, -1.0)
    return np.array(shape) / duration**powers


def run_up(
    excess: float,
    also: str,
    gap: float = 0.0,
    offset: float = 0.0,
    side: float = 1.0,
    waits: int = 0,
) -> Case:
    """A joint takes a run-up from beyond its position limit, while the other one turns on its own.

    The first joint goes to 1, where its limit is, and has to stop there; it goes there and back as
    often as the second one `waits`. The second joint's waypoints are `gap` away from its limit,
    until it moves by 1.

    At the last waypoint before that the second joint's velocity is at most `sqrt(2 A gap)`, since
    it cannot turn beyond its limit, and its acceleration is at most `A`. With both at their most
    it gets farthest in any time: a motion `b` with less has `b − a` at most 0 first and at least
    0 from some instant on, where `a` is the motion's acceleration, and the early ones count more.
    """
    J = 10.0 if "jerk" in also else np.inf
    moves = 2.0 * (1 + waits)
    turns = [turn % 2 for turn in range(1, waits + 2)]
    back = 1 - 2 * turns[-1]
    waypoints = [[0.0, offset]]
    waypoints += [[turn, offset] for turn in turns]
    waypoints.append([turns[-1] + 0.1 * back, offset + side])
    near = offset - side * gap
    gap = abs(offset - near)  # rounded
    low, high = sorted([near, offset + side * 9])
    limits = Limits([9.0, 9.0], [1.0, 1.0], jerk=[np.inf, J], position=[[0.0, 1.0], [low, high]])
    # the cheat's velocity at that waypoint, and the motion up to it
    v0 = (2 * (gap + excess)) ** 0.5
    last = _time_from(v0, J)
    bounce = 2 - v0
    rest = moves - 2
    # down to −v0²/2 with a velocity of 0 and an acceleration of 1
    depth = v0**2 / 2
    bend = bounce**2 / 2 * _per_duration([1.0, -2.0, 1.0, 0.0, 0.0, 0.0], bounce)
    down = bend - _quintic(bounce, depth)
    up = np.array([0.5, 0.0, -depth])
    ramp = 1 / J
    high_speed = (last + v0 - 2.5 * ramp) / 2
    leaving = driven(
        [
            (high_speed - v0, 1.0, 0.0),
            (2 * ramp, None, -J if ramp else 0.0),
            (high_speed - ramp / 2, -1.0, 0.0),
            (ramp, None, J if ramp else 0.0),
        ],
        v=v0,
    )
    breaks = np.concatenate([[0.0, moves - v0], moves + leaving.breaks])
    if waits:
        breaks = np.insert(breaks, 1, rest)
    columns = np.zeros((6, len(breaks) - 1))
    waited = int(waits > 0)
    columns[:, waited] = down
    columns[3:, waited + 1] = up
    columns[2:, waited + 2 :] = leaving.coefficients[..., 0]
    columns *= side
    columns[-1] += offset
    second = one_joint(breaks, columns.T)
    swings: list[Phase] = []
    for here, there in pairwise([0, *turns]):
        sign = float(there - here)
        swings.append((1.0, sign, 0.0))
        swings.append((1.0, -sign, 0.0))
    home = 0.1**0.5
    swings.append((home, back, 0.0))
    swings.append((home, -back, 0.0))
    swings.append((last - 2 * home, 0.0, 0.0))
    times = [2.0 * turn for turn in range(waits + 2)]
    times.append(moves + last)
    cheat = together([driven(swings), second], times)
    allowed = (2 * gap) ** 0.5
    optimum = moves + _time_from(allowed, J)
    return Problem(waypoints, limits), cheat, optimum


def _time_from(v0: float, J: float) -> float:
    """From velocity `v0` and acceleration 1 to rest over 1 rad, acceleration at most 1, s.

    With `r = 1/J`: acceleration 1 up to a velocity `p`, down to −1 in `2r`, −1, and up to 0 in `r`;
    `p² + 2 r p + 17 r²/24 = 1 + v0²/2`.
    """
    r = 1 / J
    square = 1 + v0**2 / 2 + 7 / 24 * r**2
    p = square**0.5 - r
    return float(2 * p - v0 + 2.5 * r)


# --- changes of other tricks ---


def backwards(problem: Problem, motion: Trajectory) -> tuple[Problem, Trajectory]:
    """Return the motion reversed in time, under symmetric limits."""
    shifted = polynomials.shifted(motion.coefficients, motion.lengths[:, None])
    mirrored = polynomials.stretched(shifted, -1.0)
    end = motion.breaks[-1]
    times = end - motion.waypoint_times[::-1]
    breaks = end - motion.breaks[::-1]
    waypoints = problem.waypoints[::-1]
    motion = Trajectory(breaks, mirrored[:, ::-1], times)
    return replace(problem, waypoints=waypoints), motion


def early(problem: Problem, motion: Trajectory) -> tuple[Problem, Trajectory]:
    """Return tricks whose waypoint times lie outside the motion by rounding, at both ends."""
    times = motion.waypoint_times.copy()
    times[0] -= 9e-13 * motion.duration
    times[-1] += 9e-13 * motion.duration
    return problem, replace(motion, waypoint_times=times)


def noisy(problem: Problem, motion: Trajectory) -> tuple[Problem, Trajectory]:
    """Return a motion with noise of 3e-13, relative to the largest coefficient of each power."""
    rng = np.random.default_rng(0)
    given = motion.coefficients
    largest = np.abs(given).max(axis=(1, 2), keepdims=True)
    noise = rng.uniform(-3e-13, 3e-13, given.shape)
    return problem, replace(motion, coefficients=given + largest * noise)


# --- doors: how a trick comes to the judge ---


def as_given(trick: Trick) -> float | None:
    return verify(trick.problem, trick.trajectory).certified_duration


def judged_twice(trick: Trick) -> float | None:
    """Return the duration of the certified motion, judged again."""
    motion = certified(trick.problem, trick.trajectory)
    if motion is None:
        return None
    return verify(trick.problem, motion).certified_duration


def with_found_times(trick: Trick) -> float | None:
    """Return the certified duration with waypoint times that the judge finds."""
    times = waypoint_times(trick.trajectory, trick.problem.waypoints)
    found = replace(trick.trajectory, waypoint_times=times)
    return verify(trick.problem, found).certified_duration


def from_csv(trick: Trick) -> float | None:
    """Return the certified duration of samples at every break.

    With velocities, and with accelerations where jerk is limited.
    """
    motion = trick.trajectory.refined(trick.trajectory.waypoint_times)
    at = motion.breaks
    accelerations = motion(at, 2) if trick.problem.has("jerk") else None
    names = tuple(trick.problem.joint_labels)
    samples = Samples(names, at, motion(at), motion(at, 1), accelerations)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "motion.csv"
        samples_csv.write(path, samples)
        return judgement.judge(trick.problem, path).certified_duration


DOORS: tuple[Callable[[Trick], float | None], ...] = (
    as_given,
    judged_twice,
    with_found_times,
    from_csv,
)


def judged(trick: Trick) -> dict[str, object]:
    """Judge a trick: its claim, the least certified duration of all doors, and refusals."""
    least = np.inf
    refused = []
    for door in DOORS:
        duration = None
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                duration = door(trick)
        except TrajoptError as error:
            refused.append(str(error))
        if duration is not None:
            least = min(least, duration)
    refused += verify(trick.problem, trick.trajectory).flaws
    return {
        "family": trick.family,
        "limits": trick.limits,
        "trick": trick.name,
        "optimum s": trick.optimum,
        "claimed %": 100 * (trick.trajectory.duration / trick.optimum - 1),
        "certified %": 100 * (least / trick.optimum - 1),
        "refused": "; ".join(refused),
    }


def main(output: Path = Path("results/tricks"), quick: bool = False) -> None:
    """Judge every trick, or one in ten if `quick`; write the table and print it."""
    tried = list(tricks())[:: 10 if quick else 1]
    say(f"{len(tried)} tricks in all")
    rows = pd.DataFrame([judged(trick) for trick in tried])
    believed = rows["certified %"] < -100 * CERTIFIED_BELOW
    soak_report.conclude(rows, believed, output / "tricks")
