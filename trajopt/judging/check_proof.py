"""Check a record's lower bound in exact fractions: python check_proof.py < RECORD.json

This is the kernel of all proofs of lower bounds: whatever searches for a proof, a bound is believed
because this file derives it again. It imports the standard library only and solves nothing.

All numbers are fractions. Roots, quotients, sines and cosines are rounded to 128 binary places,
such that the bound only gets smaller. Equation numbers are those of docs/mathematics/bounds.md.

In reading order: the problem as its file states it; the least times of a tool's ways; the bound in
closed form; the relaxation's variables and their box; its rows; the walk through the tree of boxes.
"""

from __future__ import annotations

import hashlib
import json
import struct
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache, partial
from itertools import pairwise
from math import floor, inf, isqrt, nan
from typing import Any, NamedTuple

RAISE, LOWER, BRANCH, LEAF = range(4)  # kinds of steps
LOWER_SIDE, UPPER_SIDE = range(2)
BOUNDED = ("velocity", "acceleration", "jerk", "position")
END_STATES = ("start_velocity", "start_acceleration", "end_velocity", "end_acceleration")
POINT_SPEEDS = ("tool_speed", "link_speed")
# numbers of each joint in these limits: speed; the joint's origin, axis, whether it slides; a point
ORIGIN, AXIS, SLIDES, POINT = slice(1, 13), slice(13, 16), 16, slice(17, 20)
SHORT_CHORD = Fraction(1, 10**9)  # m; a shorter way of a point counts as none
IGNORED = ("duration", "least_duration")  # a bound without them holds with them
DEMANDS = (*IGNORED, "closed", "dwell", "given_times", "least_times", "tolerance", *END_STATES)
DESCRIPTION = ("name", "source", "digest", "joint_names", "joint_units", "waypoints", "limits")
TABLES = {  # the tables of a proof, and how many columns each has; 0 for a plain list
    "units": 0,
    "cutoff": 0,
    "tangents": 2,
    "cuts": 3,
    "cells": 7,
    "steps": 4,
    "multipliers": 2,
    "square_tangents": 2,
    "ramps": 3,
    "rates": 2,
    "waypoints": 0,
    "joints": 0,
}
OPTIONAL = ("square_tangents", "ramps", "rates", "waypoints", "joints")
PLACES = 2**128  # roots and quotients are multiples of 1/PLACES
ROUNDING_RTOL = Fraction(1, 2**48)  # of a coordinate, relative to its joint's largest
# docs/mathematics/verification.md, (9.1): steps so short that rounding decides their direction
SHORT_STEP = 60 * 10**5
IN_LINE_RTOL = Fraction(1, 100)
MIN_UNIT_SHARE = Fraction(1, 1000)  # of the longest step: what a joint's steps are measured in
OVERLAP_MARGIN = Fraction(1025, 1024)
ZERO, ONE, HALF, THIRD = Fraction(0), Fraction(1), Fraction(1, 2), Fraction(1, 3)

Numbers = list[Fraction]
Pair = tuple[Fraction | None, Fraction | None]  # limits downwards and upwards; None: no limit
Limits = list[list[Pair]]  # by segment and joint
Sizes = list[list[tuple[Fraction, Fraction]]]  # by segment and joint, where each has both limits
Quadratic = tuple[Fraction, Fraction, Fraction]  # f₀ + f₁ s + f₂ s²
Interval = tuple[Fraction, Fraction]  # both ends of an enclosure, of a sine say
Row = tuple[dict[int, Fraction], Fraction]  # coefficients by variable; upper bound of their sum


class NoProof(Exception):
    """The file proves nothing: the part that is wrong, what would be right, and the value."""

    def __init__(self, part: str, expected: str, value: object = None) -> None:
        self.part, self.expected = part, expected
        self.value = float(value) if isinstance(value, Fraction) else value
        shown = "" if value is None else f" is {self.value}"
        super().__init__(f"{part}{shown}: expected {expected}")


# --- numbers ---


def rounded_down(x: Fraction) -> Fraction:
    return Fraction(floor(x * PLACES), PLACES)


def rounded_up(x: Fraction) -> Fraction:
    return -rounded_down(-x)


def root_below(x: Fraction) -> Fraction:
    """Return √x, rounded down."""
    return Fraction(isqrt(floor(x * PLACES**2)), PLACES)


def root_above(x: Fraction) -> Fraction:
    """Return √x, rounded up."""
    return root_below(x) + Fraction(1, PLACES)


def largest_product(c: Fraction, low: Fraction, high: Fraction) -> Fraction:
    """Return the largest `c z` for z from low to high."""
    return max(c * low, c * high)


def total(terms: Iterable[Fraction]) -> Fraction:
    return sum(terms, ZERO)


def counted(what: str, x: Fraction, count: int) -> int:
    """Return a number that counts or numbers something."""
    if x != floor(x) or not 0 <= x < count:
        raise NoProof(what, f"a whole number from 0 to {count - 1}", x)
    return int(x)


# --- the file ---


def read(text: str) -> dict[str, Any]:
    """Return a record; its floats are the fractions that they are in binary.

    Raises:
        NoProof: A key stands there twice, or a number is not finite.
        ValueError: It is no JSON.
    """

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        named = dict(pairs)
        if len(named) < len(pairs):
            raise NoProof("the text", "no key twice")
        return named

    def number(digits: str) -> Fraction:
        if float(digits) in (inf, -inf):
            raise NoProof("a number", "a finite one", digits)
        return Fraction(float(digits))

    def constant(name: str) -> Fraction:
        raise NoProof("a number", "a finite one", name)

    record: dict[str, Any] = json.loads(
        text,
        parse_float=number,
        parse_int=Fraction,
        parse_constant=constant,
        object_pairs_hook=unique,
    )
    return record


def shape(table: Any) -> tuple[int, ...]:
    return (len(table), *shape(table[0])) if isinstance(table, list) else ()


def flat(table: Any) -> list[Any]:
    return [x for row in table for x in flat(row)] if isinstance(table, list) else [table]


def digest(problem: dict[str, Any]) -> str:
    """Return the SHA-256 of a problem's numbers: waypoints, limits, then all else by name."""

    def infinite(pairs: Any) -> Any:  # a missing limit is an infinite one
        if isinstance(pairs[0][0], list):
            return [infinite(segment) for segment in pairs]
        return [[-inf if low is None else low, inf if up is None else up] for low, up in pairs]

    waypoints, limits = problem["waypoints"], problem["limits"]
    unlimited = [[None, None]] * len(waypoints[0])
    tables = [("", waypoints)]
    tables += [("", infinite(limits.get(name, unlimited))) for name in BOUNDED]
    others = {name: table for name, table in problem.items() if name not in DESCRIPTION}
    if "closed" in others:
        others["closed"] = Fraction(others["closed"])
    others |= {name: table for name, table in limits.items() if name not in BOUNDED}
    total_of = hashlib.sha256()
    for name, table in tables + sorted(others.items()):
        total_of.update(name.encode() + repr(shape(table)).encode())
        values = (nan if x is None else float(x) for x in flat(table))
        total_of.update(b"".join(struct.pack("<d", x) for x in values))
    return total_of.hexdigest()


def proof_of(stats: dict[str, Any]) -> dict[str, Any]:
    """Return the tables of the proof among a record's `stats`; empty for a closed form."""
    prefix = "proof_"
    tables = {
        name.removeprefix(prefix): table["$array"]
        for name, table in stats.items()
        if name.startswith(prefix)
    }
    return whole(tables) if tables else {}


def whole(
    tables: dict[str, Any],
    columns_of: dict[str, int] = TABLES,
    optional: Sequence[str] = OPTIONAL,
) -> dict[str, Any]:
    """Return a proof with all its tables; those that it need not have are empty.

    Raises:
        NoProof: A table is missing, or is not one of numbers with so many columns.
    """
    for name in tables:
        if name not in columns_of:
            raise NoProof("a table", ", ".join(columns_of), name)
    proof = {name: [] for name in optional} | tables
    for name, columns in columns_of.items():
        if not isinstance(proof.get(name), list):
            raise NoProof(name, "a table of finite numbers")
        for row in proof[name]:
            numbers = row if columns else [row]
            if not isinstance(numbers, list) or len(numbers) != max(columns, 1):
                raise NoProof(name, f"rows of {max(columns, 1)}", shape(row))
            if not all(isinstance(x, Fraction) for x in numbers):
                raise NoProof(name, "a table of finite numbers")
    return proof


# --- the problem ---


class ExactFall(NamedTuple):
    """At the distance w from an end of its range, a joint's velocity is at most √(2 d w) − o."""

    offset: Fraction
    deceleration: Fraction
    low: Fraction
    high: Fraction


@dataclass(frozen=True)
class ExactProblem:
    """What every motion must do. A limit is two positive sizes, one for each direction.

    Attributes:
        waypoints: (waypoints, joints).
        velocity, acceleration, jerk: by segment, joint and side.
        position: by joint and side, signed.
        falling: by joint.
        tolerance: half widths, (waypoints, joints).
        least_times: (segments,), s; those of the tool's ways among them.
        waits: at rest at each waypoint, (waypoints,), s.
        ends: start velocity and acceleration, end velocity and acceleration, of each joint.
        closed: the motion ends in the state in which it begins, whatever it is.
        times_are_given: the least times are also the longest.
    """

    waypoints: list[Numbers]
    velocity: Sizes
    acceleration: Sizes
    jerk: Limits
    position: list[Pair]
    falling: list[ExactFall | None]
    tolerance: list[Numbers]
    least_times: Numbers
    waits: Numbers
    ends: list[Numbers]
    closed: bool
    times_are_given: bool

    @property
    def joints(self) -> range:
        return range(len(self.waypoints[0]))

    @property
    def segments(self) -> range:
        return range(len(self.least_times))

    def displacements(self) -> list[Numbers]:
        return [
            [end - start for start, end in zip(*points, strict=True)]
            for points in pairwise(self.waypoints)
        ]

    def slack(self) -> list[Numbers]:
        """Return by how much a segment's displacement may differ from its nominal one."""
        return [
            [before + after for before, after in zip(*points, strict=True)]
            for points in pairwise(self.tolerance)
        ]


def stated(problem: dict[str, Any]) -> ExactProblem:
    """Return the problem that a file states, of all its waypoints and joints.

    Raises:
        NoProof: It has another digest, or a demand that is unknown here.
    """
    if digest(problem) != problem["digest"]:
        raise NoProof("digest", "that of the problem's numbers", problem["digest"])
    unknown = problem.keys() - {*DESCRIPTION, *DEMANDS}
    if unknown:
        raise NoProof("a demand", ", ".join(DEMANDS), ", ".join(sorted(unknown)))
    waypoints, limits = problem["waypoints"], problem["limits"]
    joints, segments = len(waypoints[0]), len(waypoints) - 1
    unlimited = [[None, None]] * joints
    velocity, acceleration, jerk, position = (limits.get(name, unlimited) for name in BOUNDED)
    if len(shape(position)) == 3:
        raise NoProof("position", "one pair of limits for each joint")

    def by_segment(pairs: Any) -> Limits:
        table = pairs if len(shape(pairs)) == 3 else [pairs] * segments
        return [[tuple(x and abs(x) for x in pair) for pair in row] for row in table]

    falls = limits.get("falling_velocity", [[None]] * joints)
    tolerance = problem.get("tolerance", [[ZERO] * joints] * len(waypoints))
    no_falls = any(map(any, tolerance))  # a relaxation where waypoints have tolerances
    rest = [ZERO] * joints
    exact_times = problem.get("given_times")
    return ExactProblem(
        waypoints=waypoints,
        velocity=both_sided("velocity", by_segment(velocity)),
        acceleration=both_sided("acceleration", by_segment(acceleration)),
        jerk=by_segment(jerk),
        position=[(low, high) for low, high in position],
        falling=[None if None in fall or no_falls else ExactFall(*fall) for fall in falls],
        tolerance=tolerance,
        least_times=exact_times or problem.get("least_times", [ZERO] * segments),
        waits=problem.get("dwell", [ZERO] * len(waypoints)),
        ends=[
            list(states) for states in zip(*(problem.get(k, rest) for k in END_STATES), strict=True)
        ],
        closed=bool(problem.get("closed")),
        times_are_given=bool(exact_times),
    )


def both_sided(name: str, limits: Limits) -> Sizes:
    table = [[(low, high) for low, high in row if low and high] for row in limits]
    if list(map(len, table)) != list(map(len, limits)):
        raise NoProof(name, "two limits of each joint that are not 0")
    return table


def through(problem: ExactProblem, numbers: Sequence[int]) -> ExactProblem:
    """Leave out all waypoints but these, the first and the last among them.

    A segment between two of them keeps the limits of the last one that it replaces; a waypoint
    gets the tightest tolerance, and the waits, of those up to the next one.
    """
    groups = list(pairwise([*numbers, len(problem.waypoints)]))
    last = [number - 1 for number in numbers[1:]]
    return replace(
        problem,
        waypoints=[problem.waypoints[k] for k in numbers],
        velocity=[problem.velocity[k] for k in last],
        acceleration=[problem.acceleration[k] for k in last],
        jerk=[problem.jerk[k] for k in last],
        tolerance=[[min(r) for r in zip(*problem.tolerance[i:k], strict=True)] for i, k in groups],
        least_times=[total(problem.least_times[i:k]) for i, k in pairwise(numbers)],
        waits=[total(problem.waits[i:k]) for i, k in groups],
    )


def distinct_waypoints(problem: ExactProblem) -> list[int]:
    """Return the waypoints that differ from the one before by more than rounding, or take time."""
    points = problem.waypoints
    rounding = [ROUNDING_RTOL * max(map(abs, column)) for column in zip(*points, strict=True)]
    numbers, last = [0], points[0]
    for k, point in enumerate(points[1:], start=1):
        steps = zip(point, last, rounding, strict=True)
        differs = any(abs(x - y) > size for x, y, size in steps)
        if differs:
            last = point
        if differs or problem.least_times[k - 1] > 0:
            numbers.append(k)
    return numbers


def resolved_waypoints(problem: ExactProblem) -> list[int]:
    """Return the waypoints but for those between two short steps in one line, see (9.1).

    Rounding may miss them. Where the limits change at one, it stays.
    """
    steps = problem.displacements()
    joints = problem.joints
    columns = list(zip(*problem.waypoints, strict=True))
    rounding = [ROUNDING_RTOL * max(map(abs, column)) for column in columns]
    longest = [max(map(abs, column)) for column in zip(*steps, strict=True)]
    longest = [size or max(longest) for size in longest]
    units = [max(size, max(longest) * MIN_UNIT_SHARE) for size in longest]
    scaled = [[step[j] / units[j] for j in joints] for step in steps]
    sizes = [max(map(abs, step)) for step in scaled]

    def short(k: int) -> bool:
        cubes = (SHORT_STEP * rounding[j] * longest[j] ** 2 for j in joints)
        return all(abs(h) ** 3 <= cube for h, cube in zip(steps[k], cubes, strict=True))

    def in_line(k: int) -> bool:
        blur = 1 / sizes[k - 1] + 1 / sizes[k]
        turns = [abs(scaled[k - 1][j] / sizes[k - 1] - scaled[k][j] / sizes[k]) for j in joints]
        return all(turns[j] <= IN_LINE_RTOL + blur * rounding[j] / units[j] for j in joints)

    def limits(k: int) -> object:
        return problem.velocity[k], problem.acceleration[k], problem.jerk[k]

    inner = range(1, len(steps))
    unresolved = {k for k in inner if short(k - 1) and short(k) and in_line(k)}
    changes = {k for k in inner if limits(k - 1) != limits(k)}
    return [k for k in range(len(columns[0])) if k not in unresolved - changes]


def loosest(limits: Any) -> Any:
    """Return by joint and side the largest limit of several segments; None where one has none."""
    return [
        tuple(None if None in side else max(side) for side in zip(*pairs, strict=True))
        for pairs in zip(*limits, strict=True)
    ]


def through_stated(problem: ExactProblem, numbers: Sequence[Fraction]) -> ExactProblem:
    """Leave out all waypoints but those that the proof counts: a relaxation.

    Each segment gets the loosest limits of those that it replaces, each waypoint its own tolerance.
    """
    last = len(problem.waypoints) - 1
    counts = [counted("waypoints", k, last + 1) for k in numbers]
    if counts != sorted({*counts, 0, last, *(k for k, wait in enumerate(problem.waits) if wait)}):
        right = "rising numbers from the first to the last, with all at which it waits"
        raise NoProof("waypoints", right, counts)
    spans = list(pairwise(counts))
    return replace(
        through(problem, counts),
        velocity=[loosest(problem.velocity[i:k]) for i, k in spans],
        acceleration=[loosest(problem.acceleration[i:k]) for i, k in spans],
        jerk=[loosest(problem.jerk[i:k]) for i, k in spans],
        tolerance=[problem.tolerance[k] for k in counts],
    )


def of_moving_joints(problem: ExactProblem) -> ExactProblem:
    columns = zip(*problem.waypoints, strict=True)
    moving = [j for j, x in enumerate(columns) if len(set(x)) > 1 or any(problem.ends[j])]
    return of_joints(problem, moving)


def of_stated_joints(problem: ExactProblem, numbers: Sequence[Fraction]) -> ExactProblem:
    """Leave out all joints but those that the proof counts: a relaxation."""
    counts = [counted("joints", j, len(problem.joints)) for j in numbers]
    if counts != sorted({*counts}):
        raise NoProof("joints", "rising numbers", counts)
    return of_joints(problem, counts)


def of_joints(problem: ExactProblem, numbers: Sequence[int]) -> ExactProblem:
    def chosen(row: Any) -> Any:
        return [row[j] for j in numbers]

    return replace(
        problem,
        waypoints=list(map(chosen, problem.waypoints)),
        velocity=list(map(chosen, problem.velocity)),
        acceleration=list(map(chosen, problem.acceleration)),
        jerk=list(map(chosen, problem.jerk)),
        position=chosen(problem.position),
        falling=chosen(problem.falling),
        tolerance=list(map(chosen, problem.tolerance)),
        ends=chosen(problem.ends),
    )


def counted_problem(said: dict[str, Any], proof: dict[str, Any]) -> ExactProblem:
    """Return the problem of a file, of those waypoints and joints that a bound counts.

    The least times of segments between these are at least those of a tool's ways.
    """
    problem = stated(said)
    numbers = distinct_waypoints(problem)
    problem = through(problem, numbers)
    chosen = proof.get("waypoints")
    if not said.keys() & {"dwell", "given_times", "least_times", "tolerance"}:
        if chosen:
            right = "none where a motion may miss some by rounding"
            raise NoProof("waypoints", right, len(chosen))
        resolved = resolved_waypoints(problem)
        problem = through(problem, resolved)
        numbers = [numbers[k] for k in resolved]
    if not problem.times_are_given:
        least = list(map(max, problem.least_times, chord_times(said, numbers)))
        problem = replace(problem, least_times=least)
    if chosen:
        problem = through_stated(problem, chosen)
    if proof.get("joints"):
        problem = of_stated_joints(problem, proof["joints"])
    return of_moving_joints(problem)


# --- the least times of a tool's ways ---


def chord_times(problem: dict[str, Any], numbers: Sequence[int]) -> Numbers:
    """Return for ways between some waypoints the longest time of a point's straight way, (7.7c).

    A way has the largest speed of its segments. Its time is 0 beside a waypoint with a tolerance,
    since the point's place there is not known.
    """
    limits, waypoints = problem["limits"], [problem["waypoints"][k] for k in numbers]
    tolerance = problem.get("tolerance", [[ZERO]] * len(problem["waypoints"]))
    exact = [not any(tolerance[k]) for k in numbers]
    least = [ZERO] * (len(numbers) - 1)
    for name in [kind for kind in POINT_SPEEDS if kind in limits]:
        table = limits[name]
        by_segment = table if len(shape(table)) == 3 else [table] * (len(problem["waypoints"]) - 1)
        rows = by_segment[0]
        for j in range(len(rows) - 1 if name == "tool_speed" else 0, len(rows)):
            speeds = [segment[j][0] for segment in by_segment]
            if not any(speeds):
                continue
            places = [place_of(rows[: j + 1], q[: j + 1]) for q in waypoints]
            for k, (ends, segments) in enumerate(
                zip(pairwise(places), pairwise(numbers), strict=True)
            ):
                way, passed = distance_below(*ends), speeds[slice(*segments)]
                if all(passed) and exact[k] and exact[k + 1] and way > SHORT_CHORD:
                    least[k] = max(least[k], rounded_down(way / max(passed)))
    return least


def place_of(rows: list[list[Fraction]], q: Numbers) -> list[Interval]:
    """Return where a point of the last joint's link is, m, at positions of the joints up to there.

    From the last joint to the base: each turns the point about its axis, or shifts it along it,
    and its origin takes it to the frame of the joint before.
    """
    place = [constant(x) for x in rows[-1][POINT]]
    for row, position in zip(reversed(rows), reversed(q), strict=True):
        if row[SLIDES]:
            place = [
                plus(x, constant(position * along))
                for x, along in zip(place, row[AXIS], strict=True)
            ]
        else:
            place = turned(place, row[AXIS], position)
        x, y, z, shift = (row[ORIGIN][i::4] for i in range(4))
        place = [
            plus(constant(shift[i]), *map(times, place, map(constant, (x[i], y[i], z[i]))))
            for i in range(3)
        ]
    return place


def turned(place: list[Interval], axis: Numbers, angle: Fraction) -> list[Interval]:
    """Return x + sin θ u × x + (1 − cos θ) u × (u × x), by Rodrigues."""
    sine, (low, high) = sine_and_cosine(angle)
    across = cross(axis, place)
    back = cross(axis, across)
    return [
        plus(x, times(sine, y), times((1 - high, 1 - low), z))
        for x, y, z in zip(place, across, back, strict=True)
    ]


def sine_and_cosine(x: Fraction) -> tuple[Interval, Interval]:
    """Return sin x and cos x: Taylor's sums at x/2ⁿ below 1, where the angle is then doubled.

    No derivative exceeds 1, so what the sums leave out is at most the first term left out.
    """
    doublings = floor(abs(x)).bit_length()
    share, term, n, sums = x / 2**doublings, ONE, 0, [ZERO, ZERO]
    while abs(term) > Fraction(1, PLACES):
        sums[n % 2] += term if n % 4 < 2 else -term
        n += 1
        term *= share / n
    rest = abs(term)
    cosine, sine = ((rounded_down(s - rest), rounded_up(s + rest)) for s in sums)
    for _ in range(doublings):
        low, high = times(sine, sine)
        doubled = times(constant(Fraction(2)), times(sine, cosine)), (1 - 2 * high, 1 - 2 * low)
        sine, cosine = ((max(low, -ONE), min(high, ONE)) for low, high in doubled)
    return sine, cosine


def distance_below(one: list[Interval], other: list[Interval]) -> Fraction:
    """Return the least distance of two places, rounded down."""
    apart = [
        max(low - end, start - high, ZERO)
        for (low, high), (start, end) in zip(one, other, strict=True)
    ]
    return root_below(total(gap**2 for gap in apart))


def constant(x: Fraction) -> Interval:
    return x, x


def plus(*terms: Interval) -> Interval:
    return total(low for low, _ in terms), total(high for _, high in terms)


def times(one: Interval, other: Interval) -> Interval:
    products = [x * y for x in one for y in other]
    return rounded_down(min(products)), rounded_up(max(products))


def cross(u: Numbers, x: list[Interval]) -> list[Interval]:
    """Return the vector product u × x."""
    return [
        plus(times(constant(u[i - 2]), x[i - 1]), times(constant(-u[i - 1]), x[i - 2]))
        for i in range(3)
    ]


# --- a bound in closed form ---


def farthest(problem: ExactProblem, time: Fraction, j: int, side: int) -> Fraction:
    """Return at least the longest way of one joint from rest to rest in a given time."""
    velocity = loosest(problem.velocity)[j][side]
    braking, speeding = loosest(problem.acceleration)[j]
    slowness = 1 / braking + 1 / speeding
    peak = min(velocity, time / slowness)
    way = peak * (time - peak * slowness / 2)
    if None in loosest(problem.jerk)[j]:
        return way
    v, a, jerk = (
        max(loosest(limits)[j]) for limits in (problem.velocity, problem.acceleration, problem.jerk)
    )
    half = time / 2
    v = min(v, jerk * half**2 / 4 if half * jerk <= 2 * a else a * (half - a / jerk))
    rise = v / a + a / jerk if v * jerk >= a**2 else 2 * root_below(v / jerk)
    return min(way, v * (time - rise))


def holds_in_closed_form(said: dict[str, Any], claim: Fraction) -> bool:
    """Return whether no motion is shorter than a claim, by one joint alone or by velocities."""
    problem = counted_problem(said, {})
    moving_time = claim - total(problem.waits)
    ways = problem.displacements()
    if not problem.closed and not any(map(any, problem.ends)):
        for j, way in enumerate(map(total, zip(*ways, strict=True))):
            if farthest(problem, moving_time, j, way > 0) <= abs(way):
                return True
    at_least = ZERO
    for k, slack in enumerate(problem.slack()):
        times = [
            (abs(way) - slack[j]) / problem.velocity[k][j][way > 0] for j, way in enumerate(ways[k])
        ]
        at_least += max(problem.least_times[k], *times)
    return moving_time <= at_least


# --- the relaxation: its variables and their box ---


class Variables(NamedTuple):
    """Numbers of the first variables of each kind; a segment's time T has the segment's number.

    Of each segment T, 1/T and T². Of each state, that is of each joint at a waypoint where its
    motion is not given: velocity v, acceleration a, a T of the segments before and after, offset y
    from the waypoint, y/T of the segments before and after.
    """

    inverse: int
    square: int
    velocity: int
    acceleration: int
    before: int
    after: int
    offset: int
    offset_before: int
    offset_after: int

    @classmethod
    def of(cls, segments: int, states: int) -> Variables:
        first = 3 * segments
        return cls(segments, 2 * segments, *(first + i * states for i in range(7)))

    @property
    def boxed(self) -> int:
        """Number of those that a box has sides of: T, v and a, up to here."""
        return self.before


class ExactBox(NamedTuple):
    """Lowest and highest T, v and a; 0 in the places of 1/T and T²."""

    low: Numbers
    high: Numbers

    def is_empty(self) -> bool:
        return any(low > high for low, high in zip(*self, strict=True))

    def raised(self, x: int, at: Fraction) -> ExactBox:
        low = [*self.low]
        low[x] = max(low[x], rounded_down(at))
        return ExactBox(low, self.high)

    def lowered(self, x: int, at: Fraction) -> ExactBox:
        high = [*self.high]
        high[x] = min(high[x], rounded_up(at))
        return ExactBox(self.low, high)


class Cell(NamedTuple):
    """Costates from a place s of a segment to the next cell: quadratic p, linear q and λ."""

    start: Fraction
    p: Quadratic
    q: Quadratic
    slope: Fraction
    rate: Fraction  # of λ = slope + rate s


@dataclass(frozen=True)
class ExactRelaxation:
    """Linear inequalities that every motion shorter than the cut-off satisfies.

    All is in the proof's units of time and of each joint's lengths.

    Attributes:
        problem: in these units; velocity limits are at most what can be reached.
        cutoff: only motions up to this time count.
        at: the variables' numbers.
        products: segment and joint of each a T: of states of joints with a jerk limit.
        offsets: segment and joint of each y: of states with a tolerance.
        instants: segment, joint and side of each row of a segment that may take no time.
    """

    problem: ExactProblem
    cutoff: Fraction
    at: Variables
    ways: list[Numbers]
    slack: list[Numbers]
    products: list[tuple[int, int]]
    offsets: list[tuple[int, int]]
    instants: list[tuple[int, int, int]]

    @classmethod
    def of(cls, problem: ExactProblem, proof: dict[str, Any]) -> ExactRelaxation:
        """Return the relaxation of a proof's units and cut-off."""
        units, cutoff = proof["units"], proof["cutoff"]
        if len(units) != len(problem.joints) + 1 or min(units) <= 0:
            raise NoProof("units", "positive units of time and every joint")
        if len(cutoff) != 1 or cutoff[0] <= 0:
            raise NoProof("cutoff", "one positive time")
        problem = in_units(problem, units[0], units[1:])
        limit = cutoff[0] / units[0]
        if not problem.closed:
            problem = replace(problem, velocity=reachable(problem, limit))
        segments, joints = problem.segments, problem.joints
        states = segments if problem.closed else segments[:-1]
        ways, slack = problem.displacements(), problem.slack()
        limited = [j for j in joints if any(row[j] != (None, None) for row in problem.jerk)]
        overlapping = [
            k
            for k in segments
            if not problem.least_times[k]
            and all(abs(h) <= OVERLAP_MARGIN * r for h, r in zip(ways[k], slack[k], strict=True))
        ]
        return cls(
            problem=problem,
            cutoff=limit,
            at=Variables.of(len(segments), len(states) * len(joints)),
            ways=ways,
            slack=slack,
            products=[(k, j) for k in states for j in limited],
            offsets=[(k, j) for k in states for j in joints if problem.tolerance[k + 1][j]],
            instants=[(k, j, side) for k in overlapping for j in joints for side in range(2)],
        )

    def state_after(self, k: int, j: int) -> int | None:
        """Return the number of a joint's state at the end of segment k; None where it is given."""
        joints, last = len(self.problem.joints), len(self.problem.segments) - 1
        return k * joints + j if k < last or self.problem.closed else None

    def state_before(self, k: int, j: int) -> int | None:
        """Return the number of a joint's state at the start of segment k."""
        if k > 0:
            return self.state_after(k - 1, j)
        return self.state_after(len(self.problem.segments) - 1, j)

    def segment_after(self, k: int) -> int:
        return (k + 1) % len(self.problem.segments)

    # --- where velocity limits fall towards the end of a range ---

    def distance_to_end(self, k: int, j: int, side: int) -> Fraction:
        """Return how far waypoint k is from the end of the range."""
        fall = self.fall(j)
        return abs((fall.high if side else fall.low) - self.problem.waypoints[k][j])

    def distance_to_rest(self, k: int, j: int, side: int) -> Fraction:
        """Return how far waypoint k is from where no velocity is allowed."""
        fall = self.fall(j)
        return self.distance_to_end(k, j, side) - fall.offset**2 / (2 * fall.deceleration)

    def fall(self, j: int) -> ExactFall:
        fall = self.problem.falling[j]
        assert fall is not None
        return fall

    # --- sides of variables ---

    def velocity_limit(self, k: int, j: int, side: int) -> Fraction:
        """Return the largest velocity at the end of segment k."""
        V = self.problem.velocity
        limit = min(V[k][j][side], V[self.segment_after(k)][j][side])
        if self.problem.falling[j] is None:
            return limit
        fall = self.fall(j)
        far = root_above(2 * fall.deceleration * self.distance_to_end(k + 1, j, side))
        return min(limit, max(far - fall.offset, ZERO))

    def root_box(self) -> ExactBox:
        """Return a box that holds every motion up to the cut-off."""
        problem, at, products = self.problem, self.at, set(self.products)
        low, high = [ZERO] * at.boxed, [ZERO] * at.boxed
        for k in problem.segments:
            least = problem.least_times[k]
            times = [
                rounded_down(
                    max(abs(way) - self.slack[k][j], ZERO) / problem.velocity[k][j][way > 0]
                )
                for j, way in enumerate(self.ways[k])
            ]
            low[k] = max(least, *times) if times else least
            high[k] = least if problem.times_are_given else self.cutoff
            for j in problem.joints:
                state = self.state_after(k, j)
                rests = problem.waits[k + 1] and not problem.closed
                if state is None or rests:
                    continue
                v, a = at.velocity + state, at.acceleration + state
                low[v], high[v] = -self.velocity_limit(k, j, 0), self.velocity_limit(k, j, 1)
                if (k, j) in products:
                    here, there = (problem.acceleration[i][j] for i in (k, self.segment_after(k)))
                    low[a], high[a] = -min(here[0], there[0]), min(here[1], there[1])
        return ExactBox(low, high)

    def sides(self, x: int, box: ExactBox) -> tuple[Fraction, Fraction] | None:
        """Return the least and the largest value of a variable; None: nothing bounds it."""
        low, high = box
        at = self.at
        if x < at.inverse or at.velocity <= x < at.before:
            return low[x], high[x]
        if x < at.square:
            return self.inverse_sides(x - at.inverse, box)
        if x < at.velocity:
            return low[x - at.square] ** 2, high[x - at.square] ** 2
        states = at.after - at.before
        state = (x - at.before) % states
        k, j = divmod(state, len(self.problem.joints))
        is_after = at.after <= x < at.offset or x >= at.offset_after
        segment = self.segment_after(k) if is_after else k
        if x < at.offset:
            a = at.acceleration + state
            corners = [y * t for y in (low[a], high[a]) for t in (low[segment], high[segment])]
            return min(corners), max(corners)
        radius = self.problem.tolerance[k + 1][j]
        if x < at.offset_before:
            return -radius, radius
        inverse = self.inverse_sides(segment, box)
        return inverse and (-radius * inverse[1], radius * inverse[1])

    def inverse_sides(self, k: int, box: ExactBox) -> tuple[Fraction, Fraction] | None:
        """Return the sides of 1/T; None where a segment may take no time."""
        low, high = box.low[k], box.high[k]
        return (rounded_down(1 / high), rounded_up(1 / low)) if low > 0 else None

    # --- rows of a box ---

    def box_row(self, i: int, box: ExactBox) -> Row | None:
        """Return row i of a box: the cut-off, then (7.8), (7.9), the same for y/T, instants.

        None where it bounds nothing because a segment may take no time.
        """
        low, high = box
        if i == 0:
            return dict.fromkeys(self.problem.segments, ONE), self.cutoff
        i -= 1
        if i < 2 * len(self.problem.segments):
            k, of_square = divmod(i, 2)
            ends, product = low[k] + high[k], low[k] * high[k]
            if of_square:
                return {k: -ends, self.at.square + k: ONE}, -product
            return {k: ONE, self.at.inverse + k: product}, ends
        i -= 2 * len(self.problem.segments)
        if i < 8 * len(self.products):
            return self.acceleration_product(i, box)
        i -= 8 * len(self.products)
        if i < 8 * len(self.offsets):
            return self.offset_product(i, box)
        return self.instant(*self.instants[i - 8 * len(self.offsets)])

    def box_rows(self) -> int:
        segments, pairs = len(self.problem.segments), len(self.products) + len(self.offsets)
        return 1 + 2 * segments + 8 * pairs + len(self.instants)

    def acceleration_product(self, i: int, box: ExactBox) -> Row:
        """Return row i of all a T, (7.9)."""
        is_after, i = divmod(i, 4 * len(self.products))
        (k, j), corner = self.products[i // 4], i % 4
        state = k * len(self.problem.joints) + j
        x, t = self.at.acceleration + state, self.segment_after(k) if is_after else k
        product = (self.at.after if is_after else self.at.before) + state
        x_sides, t_sides = (box.low[x], box.high[x]), (box.low[t], box.high[t])
        return corner_row(corner, product, x, x_sides, t, t_sides)

    def offset_product(self, i: int, box: ExactBox) -> Row | None:
        """Return row i of all y/T: (7.9) with y for a and 1/T for T."""
        is_after, i = divmod(i, 4 * len(self.offsets))
        (k, j), corner = self.offsets[i // 4], i % 4
        state = k * len(self.problem.joints) + j
        segment = self.segment_after(k) if is_after else k
        inverse_sides = self.inverse_sides(segment, box)
        if inverse_sides is None:
            return None
        radius = self.problem.tolerance[k + 1][j]
        product = (self.at.offset_after if is_after else self.at.offset_before) + state
        y, inverse = self.at.offset + state, self.at.inverse + segment
        return corner_row(corner, product, y, (-radius, radius), inverse, inverse_sides)

    def instant(self, k: int, j: int, side: int) -> Row:
        """Return h + y₁ − y₀ ≤ V T of a segment that may take no time."""
        sign = 1 if side else -1
        row = {k: -self.problem.velocity[k][j][side]}
        for state, change in ((self.state_before(k, j), -sign), (self.state_after(k, j), sign)):
            if state is not None:
                add(row, self.at.offset + state, Fraction(change))
        return row, -sign * self.ways[k][j]

    def square_tangent(self, k: int, t: Fraction, box: ExactBox) -> Row:
        """Return (7.10), from (h − T) (T − t)² ≥ 0."""
        h = box.high[k]
        row = {self.at.square + k: ONE, k: -h - 2 * t, self.at.inverse + k: -h * t**2}
        return row, -2 * h * t - t**2

    # --- rows of all boxes ---

    def tangent(self, k: int, t: Fraction) -> Row:
        """Return the tangent to 1/T at t, times t², (7.8)."""
        return {k: -ONE, self.at.inverse + k: -(t**2)}, -2 * t

    def ramp(self, k: int, j: int, side: int) -> Row:
        """Return a₁ − a₀ ≤ J T, (7.11)."""
        jerk = self.problem.jerk[k][j][side]
        if jerk is None:
            raise NoProof("ramps", "joints with a jerk limit on that side", j)
        sign = Fraction(1 if side else -1)
        row, bound = {k: -jerk}, ZERO
        before, after = self.state_before(k, j), self.state_after(k, j)
        _, start, _, end = self.problem.ends[j]
        if before is None:
            bound += sign * start
        else:
            add(row, self.at.acceleration + before, -sign)
        if after is None:
            bound -= sign * end
        else:
            add(row, self.at.acceleration + after, sign)
        return row, bound

    def costates(self, k: int, j: int, cells: Sequence[Cell]) -> Row:
        """Return the row of any functions p, q and λ, (7.7).

        λ h is at most what changes of p cost in acceleration, of q in velocity, of λ in position,
        and what p' + q costs in acceleration, q' + λ in velocity, p in jerk.
        """
        problem, at = self.problem, self.at
        widths = [end - start for start, end in pairwise([*(c.start for c in cells), ONE])]
        if not cells or cells[0].start != 0 or min(widths) <= 0:
            raise NoProof("cells", "starts that rise from 0 to below 1")
        jerk, V, A = problem.jerk[k][j], problem.velocity[k][j], problem.acceleration[k][j]
        p = [without_free_jerk(c.p, width, jerk) for c, width in zip(cells, widths, strict=True)]
        if jerk == (None, None) and any(map(any, p)):
            raise NoProof("cells", "no p for a joint without jerk limits")
        q = [cell.q for cell in cells]
        slope_ends = [c.slope + c.rate * width for c, width in zip(cells, widths, strict=True)]
        row = {k: -jumps(p, widths, A), at.square + k: ZERO}
        bound = jumps(q, widths, V)
        distance = ZERO  # times 1/T: how far λ lets the joint be
        for end, later in zip(slope_ends, cells[1:], strict=False):
            change = later.slope - end
            if change:
                distance += change * self.farthest_position(k, j, change > 0)
        for cell, f, width in zip(cells, p, widths, strict=True):
            row[at.square + k] -= integral_bound(f, width, (jerk[0] or ZERO, jerk[1] or ZERO))
            row[k] -= integral_bound((f[1] + cell.q[0], 2 * f[2] + cell.q[1], ZERO), width, A)
            turn = (cell.q[1] + cell.slope, cell.rate, ZERO)
            side = cell.rate > 0
            if cell.rate and self.has_tangent(k, j, side, turn[0]):
                # (7.7b): velocity and position are bounded together
                fall, start, rate = self.fall(j), abs(turn[0]), abs(cell.rate)
                last = start + rate * width
                squares = width * (start**2 + start * last + last**2) * THIRD
                row[k] -= fall.deceleration * squares / (2 * rate)
                distance += rate * width * self.distance_to_end(k, j, side)
                bound -= fall.offset * width * (start + last) * HALF
                continue
            if cell.rate:
                distance += cell.rate * width * self.farthest_position(k, j, side)
            bound += integral_bound(turn, width, V)
        row[at.inverse + k] = slope_ends[-1] * self.ways[k][j] - distance
        ends = (
            Ends(p[0][0], q[0][0], cells[0].slope),
            Ends(value(p[-1], widths[-1]), value(q[-1], widths[-1]), slope_ends[-1]),
        )
        return row, bound + self.add_end_states(row, k, j, *ends)

    def has_tangent(self, k: int, j: int, side: int, start: Fraction) -> bool:
        """Return whether (7.7a) bounds a joint where λ grows, with q' + λ of the same sign."""
        same_sign = start >= 0 if side else start <= 0
        return (
            self.problem.falling[j] is not None
            and same_sign
            and self.distance_to_rest(k, j, side) > 0
        )

    def farthest_position(self, k: int, j: int, side: int) -> Fraction:
        """Return the farthest position that segment k may reach, from its start."""
        limit = self.problem.position[j][side]
        sign = 1 if side else -1
        ends = [] if limit is None else [sign * (limit - self.problem.waypoints[k][j])]
        if self.problem.falling[j] is not None:
            ends.append(max(self.distance_to_rest(k, j, side), ZERO))
        if not ends:
            raise NoProof("cells", "no change of λ without a position limit")
        return sign * min(ends)

    def add_end_states(
        self, row: dict[int, Fraction], k: int, j: int, start: Ends, end: Ends
    ) -> Fraction:
        """Add p a T + q v + λ y/T at the end less that at the start; return the bound's change."""
        at, bound = self.at, ZERO
        v0, a0, v1, a1 = self.problem.ends[j]
        before, after = self.state_before(k, j), self.state_after(k, j)
        if before is None:
            row[k] -= start.p * a0
            bound += start.q * v0
        else:
            add(row, at.velocity + before, -start.q)
            add(row, at.after + before, -start.p)
            add(row, at.offset_after + before, -start.slope)
        if after is None:
            row[k] += end.p * a1
            bound -= end.q * v1
        else:
            add(row, at.velocity + after, end.q)
            add(row, at.before + after, end.p)
            add(row, at.offset_before + after, end.slope)
        return bound


class Ends(NamedTuple):
    """Costates at one end of a segment."""

    p: Fraction
    q: Fraction
    slope: Fraction


def in_units(problem: ExactProblem, time: Fraction, lengths: Numbers) -> ExactProblem:
    """Return a problem with times in a unit, and each joint's lengths in one of its own."""
    rate, rate_of_rate, jerk = ([time**order / size for size in lengths] for order in (1, 2, 3))

    def scaled(table: Any, units: Numbers) -> Any:  # the last axis but pairs is the joints
        return [
            [tuple(x and x * unit for x in pair) for pair, unit in zip(row, units, strict=True)]
            for row in table
        ]

    def lengths_of(table: list[Numbers]) -> list[Numbers]:
        return [[x / size for x, size in zip(row, lengths, strict=True)] for row in table]

    (position,) = scaled([problem.position], [1 / size for size in lengths])
    return replace(
        problem,
        waypoints=lengths_of(problem.waypoints),
        velocity=scaled(problem.velocity, rate),
        acceleration=scaled(problem.acceleration, rate_of_rate),
        jerk=scaled(problem.jerk, jerk),
        position=position,
        falling=[
            fall
            and ExactFall(
                fall.offset * time / size,
                fall.deceleration * time**2 / size,
                fall.low / size,
                fall.high / size,
            )
            for fall, size in zip(problem.falling, lengths, strict=True)
        ],
        tolerance=lengths_of(problem.tolerance),
        least_times=[seconds / time for seconds in problem.least_times],
        waits=[seconds / time for seconds in problem.waits],
        ends=[
            [x * unit for x, unit in zip(states, (v, a, v, a), strict=True)]
            for states, v, a in zip(problem.ends, rate, rate_of_rate, strict=True)
        ],
    )


def reachable(problem: ExactProblem, cutoff: Fraction) -> Sizes:
    """Return velocity limits no larger than what a motion of the cut-off can reach.

    It speeds up from the start's velocity to a peak, and brakes from there to the end's.
    """
    peaks = []
    for (v0, _, v1, _), (braking, speeding) in zip(
        problem.ends, loosest(problem.acceleration), strict=True
    ):
        gained = (abs(v0) + abs(v1)) / min(braking, speeding)
        peaks.append(rounded_up((cutoff + gained) / (1 / braking + 1 / speeding)))
    return [
        [(min(low, peak), min(high, peak)) for (low, high), peak in zip(row, peaks, strict=True)]
        for row in problem.velocity
    ]


# --- parts of rows ---


def add(row: dict[int, Fraction], x: int, coefficient: Fraction) -> None:
    row[x] = row.get(x, ZERO) + coefficient


def corner_row(
    corner: int,
    product: int,
    x: int,
    x_sides: tuple[Fraction, Fraction],
    t: int,
    t_sides: tuple[Fraction, Fraction],
) -> Row:
    """Return (x − x̂) (t − t̂) of known sign at corner (x̂, t̂) of their box (McCormick).

    Corners 0 and 1, both low and both high, bound the product from below; 2 and 3 from above.
    """
    sign = -1 if corner < 2 else 1
    x_at, t_at = x_sides[corner in (1, 2)], t_sides[corner in (1, 3)]
    return {product: Fraction(sign), t: -sign * x_at, x: -sign * t_at}, -sign * x_at * t_at


def value(f: Quadratic, s: Fraction) -> Fraction:
    return f[0] + s * (f[1] + s * f[2])


def without_free_jerk(f: Quadratic, width: Fraction, jerk: Pair) -> Quadratic:
    """Return p, moved until it has one sign only where jerk is limited on one side only."""
    if jerk == (None, None) or None not in jerk:
        return f
    vertex = min(max(-f[1] / (2 * f[2]), ZERO), width) if f[2] else ZERO
    values = [value(f, s) for s in (ZERO, vertex, width)]
    wrong = min(ZERO, *values) if jerk[LOWER_SIDE] is None else max(ZERO, *values)
    return f[0] - wrong, f[1], f[2]


def integral_bound(f: Quadratic, width: Fraction, limits: tuple[Fraction, Fraction]) -> Fraction:
    """Return at least ∫ (up f⁺ + down f⁻) from 0 to the width.

    Where f changes its sign is only known to 128 binary places: the other sign's share is bounded
    by the largest value of that sign.
    """
    if not any(f):
        return ZERO
    f0, f1, f2 = f
    roots = []
    vertex = -f1 / (2 * f2) if f2 else ZERO
    if f2 and f1**2 > 4 * f2 * f0:
        half = root_below(f1**2 / 4 - f2 * f0) / f2
        roots = [vertex - half, vertex + half]
    elif f1 and not f2:
        roots = [-f0 / f1]
    inner = [rounded_down(s) for s in roots]
    borders = sorted([ZERO, width, *(s for s in inner if 0 < s < width)])
    bound = ZERO
    for start, end in pairwise(borders):
        at_start, at_end = (s * (f0 + s * (f1 * HALF + s * f2 * THIRD)) for s in (start, end))
        integral = at_end - at_start
        sign = 1 if integral >= 0 else -1
        places = [start, end, *([vertex] if start < vertex < end else [])]
        other_sign = max(ZERO, *(-sign * value(f, s) for s in places))
        bound += largest_product(integral, -limits[0], limits[1])
        bound += total(limits) * other_sign * (end - start)
    return bound


def jumps(
    functions: Sequence[Quadratic], widths: Numbers, limits: tuple[Fraction, Fraction]
) -> Fraction:
    """Return what the jumps from each cell to the next cost, by their signs."""
    ends = [value(f, width) for f, width in zip(functions, widths, strict=True)]
    changes = [f[0] - end for f, end in zip(functions[1:], ends, strict=False)]
    return total(largest_product(change, -limits[0], limits[1]) for change in changes)


# --- the proof ---


@dataclass(frozen=True)
class ProofRows:
    """The rows of a proof by their numbers: of a box, square tangents, tangents, ramps, costates.

    Attributes:
        squares: segment and place of each square tangent.
        fixed: rows that hold in every box.
    """

    relaxation: ExactRelaxation
    squares: list[tuple[int, Fraction]]
    fixed: list[Row]

    @classmethod
    def of(cls, relaxation: ExactRelaxation, proof: dict[str, Any]) -> ProofRows:
        segments, joints = len(relaxation.problem.segments), len(relaxation.problem.joints)

        def numbers(name: str, k: Fraction, j: Fraction) -> tuple[int, int]:
            return counted(name, k, segments), counted(name, j, joints)

        squares, tangents = (
            [(counted(name, k, segments), t) for k, t in proof[name]]
            for name in ("square_tangents", "tangents")
        )
        for _, t in [*squares, *tangents]:
            if t <= 0:
                raise NoProof("tangents", "places above 0", t)
        fixed = [relaxation.tangent(k, t) for k, t in tangents]
        for k, j, side in proof["ramps"]:
            fixed.append(relaxation.ramp(*numbers("ramps", k, j), counted("ramps", side, 2)))
        cells, used = cells_of(proof), 0
        for k, j, count in proof["cuts"]:
            last = used + counted("cuts", count, len(cells) - used + 1)
            fixed.append(relaxation.costates(*numbers("cuts", k, j), cells[used:last]))
            used = last
        return cls(relaxation, squares, fixed)

    def __len__(self) -> int:
        return self.relaxation.box_rows() + len(self.squares) + len(self.fixed)

    def row(self, i: int, box: ExactBox) -> Row | None:
        """Return row i in a box; None where it bounds nothing."""
        of_box = self.relaxation.box_rows()
        if i < of_box:
            return self.relaxation.box_row(i, box)
        i -= of_box
        if i < len(self.squares):
            return self.relaxation.square_tangent(*self.squares[i], box)
        return self.fixed[i - len(self.squares)]

    def bound(
        self, objective: dict[int, Fraction], box: ExactBox, multipliers: list[Numbers]
    ) -> Fraction:
        """Return a lower bound of an objective on a box, (7.12): any multipliers y ≥ 0 give one.

        A row with a variable that nothing bounds counts with the multiplier 0.
        """
        sides = cache(partial(self.relaxation.sides, box=box))
        coefficients, constant = dict(objective), ZERO
        for number, y in multipliers:
            row = self.row(int(number), box) if y > 0 else None
            if row is None or any(c and sides(x) is None for x, c in row[0].items()):
                continue
            for x, c in row[0].items():
                add(coefficients, x, y * c)
            constant -= y * row[1]
        for x, c in coefficients.items():
            ends = sides(x) if c else None
            if ends is not None:
                constant -= largest_product(-c, *ends)
        return constant


def cells_of(proof: dict[str, Any]) -> list[Cell]:
    rates = [ZERO] * len(proof["cells"])
    for cell, rate in proof["rates"]:
        rates[counted("rates", cell, len(rates))] = rate
    return [
        Cell(start, (p0, p1, p2), (q0, q1, ZERO), slope, rate)
        for (start, p0, p1, p2, q0, q1, slope), rate in zip(proof["cells"], rates, strict=True)
    ]


def proved(said: dict[str, Any], proof: dict[str, Any]) -> Fraction:
    """Return the lower bound that a proof proves of a problem, s; both as `read` returns them.

    The proof is a tree of boxes. Every step is about the last box that is left: it moves one side
    as far as its multipliers prove, splits the box, or bounds the time in it. The least bound of
    all leaves holds for every motion up to the cut-off; a longer one takes the cut-off at least.

    Raises:
        NoProof: A part is not what it must be, or the tree has a branch without a leaf.
    """
    problem = counted_problem(said, proof)
    relaxation = ExactRelaxation.of(problem, proof)
    rows = ProofRows.of(relaxation, proof)
    times = dict.fromkeys(problem.segments, ONE)
    boxes, lowest, used = [relaxation.root_box()], relaxation.cutoff, 0
    if boxes[0].is_empty():
        raise NoProof("cutoff", "a time in which every segment can be passed", proof["cutoff"][0])
    for kind, variable, at, count in proof["steps"]:
        if not boxes:
            raise NoProof("steps", "no step after the last leaf")
        if kind not in (RAISE, LOWER, BRANCH, LEAF):
            raise NoProof("steps", "kinds from 0 to 3", kind)
        box = boxes.pop()
        last = used + counted("steps", count, len(proof["multipliers"]) - used + 1)
        multipliers = proof["multipliers"][used:last]
        used = last
        for number, _ in multipliers:
            counted("multipliers", number, len(rows))
        x = counted("steps", variable, relaxation.at.boxed)
        if relaxation.at.inverse <= x < relaxation.at.velocity:
            raise NoProof("steps", "a time, a velocity or an acceleration", variable)
        if box.is_empty():
            boxes += [] if kind == LEAF else [box] * (1 + (kind == BRANCH))
        elif kind == LEAF:
            lowest = min(lowest, rows.bound(times, box, multipliers))
        elif kind == BRANCH:  # the lower part comes first
            boxes += [box.raised(x, at), box.lowered(x, at)]
        elif kind == RAISE:
            least = rows.bound({x: ONE}, box, multipliers)
            boxes.append(box.raised(x, min(least, at) if at else least))
        else:
            largest = -rows.bound({x: -ONE}, box, multipliers)
            boxes.append(box.lowered(x, max(largest, at) if at else largest))
    if boxes:
        raise NoProof("steps", "a leaf at the end of every branch")
    return max(lowest * proof["units"][0], ZERO) + total(problem.waits)


def main() -> None:
    """Check the record on the standard input; exit code 1 where its bound does not hold."""
    try:
        record = read(sys.stdin.read())
        claim, proof = record["solution"]["lower_bound"], proof_of(record["solution"]["stats"])
        if proof:
            bound = proved(record["problem"], proof)
            holds = bound >= claim
            print(f"no motion is briefer than {float(bound):.9f} s; recorded: {float(claim):.9f} s")
        else:
            holds = holds_in_closed_form(record["problem"], claim)
            word = "holds" if holds else "does not hold"
            print(f"closed form: {float(claim):.9f} s {word}")
    except NoProof as reason:
        sys.exit(f"no proof: {reason}")
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        sys.exit(f"no proof: the file is no record: {error!r}")
    sys.exit(not holds)


if __name__ == "__main__":
    main()
