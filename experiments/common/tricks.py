"""Ways to cheat a judge: trajectories that claim less than an optimum known in closed form.

Each trick is a problem of one or two joints whose minimum time is that of rest-to-rest moves, and a
trajectory that is faster by what some tolerance, some overflow or some rounding might let pass.

Throughout, `h` is a displacement (rad), `V`, `A` and `J` are the limits of velocity, acceleration
and jerk (rad/s, rad/s², rad/s³), `v0` and `a0` what a motion starts with instead of 0.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trajopt.core.problem import Limits, Problem
from trajopt.core.trajectory import Trajectory

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trick:
    """A trajectory that cheats, and the optimum (s) that it claims to beat."""

    name: str
    problem: Problem
    trajectory: Trajectory
    optimum: float


# --- optima and honest motions ---


def least_time(
    h: float,
    V: float,
    A: float,
) -> float:
    """From rest to rest over `h`, s: two parabolas, and a cruise between them where `h > V²/A`."""
    if h * A <= V**2:
        # T = 2 √(h / A)
        return float(2 * (h / A) ** 0.5)
    # T = h / V + V / A
    return h / V + V / A


def least_jerky_time(h: float, J: float) -> float:
    """From rest to rest over `h` with jerk `J` alone, s: four phases of `cbrt(h / 2J)`."""
    phase = (h / (2 * J)) ** (1 / 3)
    return float(4 * phase)


def joined(
    phases: Sequence[tuple[float, float, float]],
    position: float = 0.0,
) -> Trajectory:
    """One joint from phases `(duration, velocity, acceleration)`, each where the last one ends."""
    durations = [phase[0] for phase in phases]
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    columns = []
    for duration, v, a in phases:
        columns.append([a / 2, v, position])
        position += (a / 2 * duration + v) * duration
    return one_joint(breaks, columns)


def one_joint(breaks: Array, columns: Sequence[Sequence[float]]) -> Trajectory:
    """One joint's pieces, a column of coefficients each; its waypoints are its two ends."""
    coefficients = np.array(columns).T[..., None]
    return Trajectory(breaks, coefficients, breaks[[0, -1]])


def head_start(
    h: float,
    V: float,
    A: float,
    v0: float,
) -> Trajectory:
    """A move over `h` that begins and ends with a velocity of `v0` instead of 0."""
    # h = (p² − v0²) / A without a cruise
    peak = (h * A + v0**2) ** 0.5
    if peak <= V:
        rise = (peak - v0) / A
        phases = [
            (rise, v0, A),
            (rise, peak, -A),
        ]
        return joined(phases)
    rise = (V - v0) / A
    # h = V cruise + (V² − v0²) / A
    cruise = h / V - (V**2 - v0**2) / (A * V)
    phases = [
        (rise, v0, A),
        (cruise, V, 0.0),
        (rise, V, -A),
    ]
    return joined(phases)


def together(joints: Sequence[Trajectory], waypoint_times: ArrayLike) -> Trajectory:
    """Several joints, each on breaks of its own."""
    parts = [(joint.breaks, joint.coefficients[..., 0]) for joint in joints]
    return Trajectory.joined(parts, waypoint_times)


def one_move(
    h: float,
    V: float,
    A: float,
) -> Problem:
    """One joint from 0 to `h`."""
    limits = Limits([V], [A])
    return Problem([[0.0], [h]], limits)


# --- the tricks, a family a function ---


def head_starts() -> Iterator[Trick]:
    """Velocity jumps of a millionth of a limit that the motion never comes near."""
    for V, A, h in (
        (100.0, 1.0, 1.0),
        (1e4, 1.0, 1.0),
        (1e6, 1.0, 1.0),
        (1e4, 1e4, 1e-5),
    ):
        reachable = (h * A) ** 0.5
        for share in (0.99e-6, 0.5e-6, 1e-9):
            v0 = min(share * V, 0.9 * reachable)
            yield Trick(
                f"starts at {share:g} V, V = {V:g}, A = {A:g}, h = {h:g}",
                one_move(h, V, A),
                head_start(h, V, A, v0),
                least_time(h, V, A),
            )


def jerky_head_starts() -> Iterator[Trick]:
    """Acceleration jumps of a millionth of a limit out of reach, where jerk is limited."""
    h = 1.0
    J = 1.0
    for A in (1.0e3, 1.0e6):
        a0 = min(0.99e-6 * A, 0.5)
        low = 0.0
        high = 4.0
        for _ in range(200):
            d = 0.5 * (low + high)
            reached, trajectory = _swing(a0, J, d)
            if reached < h:
                low = d
            else:
                high = d
        assert abs(reached - h) < 1e-12
        limits = Limits([1e3], [A], jerk=[J])
        yield Trick(
            f"starts with 0.99e-6 A, A = {A:g}, J = {J:g}",
            Problem([[0.0], [h]], limits),
            trajectory,
            least_jerky_time(h, J),
        )


def _swing(
    a0: float,
    J: float,
    d: float,
) -> tuple[float, Trajectory]:
    """Accelerations a0 → a0 + J d → −(a0 + J d) → −a0: what it reaches, and the motion."""
    down = 2 * (d + a0 / J)
    x = 0.0
    v = 0.0
    a = a0
    columns = []
    durations = []
    phases = [
        (d, J),
        (down, -J),
        (d, J),
    ]
    for duration, j in phases:
        durations.append(duration)
        columns.append([j / 6, a / 2, v, x])
        # x += v t + a t² / 2 + j t³ / 6
        x += v * duration + a / 2 * duration**2 + j / 6 * duration**3
        # v += a t + j t² / 2
        v += a * duration + j / 2 * duration**2
        a += j * duration
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    return x, one_joint(breaks, columns)


def misses() -> Iterator[Trick]:
    """A joint that moves less than it should, beside a joint at a large coordinate."""
    V = 1.0
    A = 1.0
    limits = Limits([V, V], [A, A])
    for coordinate, h, short in (
        (1e6, 5e-3, 5e-3),
        (1e6, 1e-2, 0.99e-2),
        (1.0, 1e-6, 0.99e-8),
        (1.0, 1e-7, 0.99e-8),
        (1.0, 1e-8, 0.99e-8),
        (1.0, 1e-7, 1e-15),
        (1e6, 1e-9, 1e-9),
    ):
        problem = Problem([[coordinate, 0.0], [coordinate, h]], limits)
        moved = problem.displacements[0, 1]
        optimum = least_time(moved, V, A)
        covered = h - short
        if covered > 0:
            own = head_start(covered, V, A, 0.0)
        else:
            breaks = np.array([0.0, 1e-3 * optimum])
            own = one_joint(breaks, [[0.0, 0.0, 0.0]])
        # Both misses: it starts late and ends early.
        moving = np.array(own.coefficients)
        moving[-1] += short / 2
        still = np.zeros_like(moving)
        still[-1] = coordinate
        both = np.concatenate([still, moving], axis=2)
        yield Trick(
            f"covers {covered:g} of {h:g} rad beside {coordinate:g} rad",
            problem,
            Trajectory(own.breaks, both, own.waypoint_times),
            optimum,
        )


def far_from_zero() -> Iterator[Trick]:
    """The move itself at a coordinate whose last place is not small beside it."""
    limits = Limits([1.0], [1.0])
    for coordinate, h in (
        (1e6, 1e-6),
        (1e6, 1e-8),
        (1e3, 1e-9),
        (1.0, 1e-12),
    ):
        problem = Problem([[coordinate], [coordinate + h]], limits)
        moved = float(problem.displacements[0, 0])
        covered = moved - 0.9 * np.spacing(coordinate)
        own = head_start(covered, 1.0, 1.0, 0.0)
        coefficients = np.array(own.coefficients)
        coefficients[-1] += coordinate
        yield Trick(
            f"an ulp short of {h:g} rad at {coordinate:g} rad",
            problem,
            Trajectory(own.breaks, coefficients, own.waypoint_times),
            least_time(moved, 1.0, 1.0),
        )


def staircases() -> Iterator[Trick]:
    """Many jumps, each small."""
    h = 1.0
    V = 100.0
    A = 1.0
    cases = {
        "10 small jumps of position": _steps_of_position(10, h, V, A),
        "1000 small jumps of position": _steps_of_position(1000, h, V, A),
        "1000 small jumps of velocity": _steps_of_velocity(1000, h, V, A),
        "30 small jumps of velocity": _steps_of_velocity(30, h, V, A),
    }
    for name, trajectory in cases.items():
        yield Trick(name, one_move(h, V, A), trajectory, least_time(h, V, A))


def _steps_of_position(
    pieces: int,
    h: float,
    V: float,
    A: float,
) -> Trajectory:
    """A shorter move, and at every break a jump."""
    step = 0.9e-8  # rad
    covered = h - step * (pieces - 1)
    own = head_start(covered, V, A, 0.0)
    breaks = np.linspace(0.0, own.duration, pieces + 1)
    columns = []
    for i, t in enumerate(breaks[:-1]):
        position = own(t)[0] + i * step
        velocity = own(t, 1)[0]
        half = own(t, 2)[0] / 2
        columns.append([half, velocity, position])
    return one_joint(breaks, columns)


def _steps_of_velocity(
    pieces: int,
    h: float,
    V: float,
    A: float,
) -> Trajectory:
    """Accelerates within the limit, and jumps at every break by what a faster motion gains."""
    step = 0.9e-6  # rad/s
    own = head_start(h, V, A + 2 * step * pieces, 0.0)
    breaks = np.linspace(0.0, own.duration, pieces + 1)
    columns = []
    for t in breaks[:-1]:
        position = own(t)[0]
        velocity = own(t, 1)[0]
        half = -A / 2
        if t + 1e-12 < own.duration / 2:
            half = A / 2
        columns.append([half, velocity, position])
    return one_joint(breaks, columns)


def overflows() -> Iterator[Trick]:
    """Half the optimum, and in a piece too short to matter numbers that overflow."""
    h = 1.0
    V = 100.0
    A = 1.0
    fast = head_start(h, 2 * V, 4 * A, 0.0)
    for sliver in (1e-40, 1e-60, 1e-300):
        for first, second in ((1.7e308, -1.7e308), (1e308, 1e308)):
            breaks = np.concatenate([[0.0, sliver], fast.breaks[1:]])
            coefficients = np.zeros((10, 3, 1))
            coefficients[-3:, 1:] = fast.coefficients
            coefficients[0, 0, 0] = first
            coefficients[1, 0, 0] = second
            yield Trick(
                f"overflow of {first:g}, {second:g} in a piece of {sliver:g} s",
                one_move(h, V, A),
                Trajectory(breaks, coefficients, breaks[[0, -1]]),
                least_time(h, V, A),
            )


def slivers() -> Iterator[Trick]:
    """The way made in a piece too short for its velocity to be seen."""
    h = 1.0
    V = 1.0
    A = 1.0
    for sliver in (1e-15, 1e-100, 1e-310):
        breaks = np.array([0.0, sliver, 1.0])
        with np.errstate(over="ignore"):
            slope = min(h / sliver, 1.7e308)
        coefficients = np.zeros((4, 2, 1))
        coefficients[-2, 0, 0] = slope
        coefficients[-1, 1, 0] = h
        yield Trick(
            f"all the way in {sliver:g} s",
            one_move(h, V, A),
            Trajectory(breaks, coefficients, breaks[[0, -1]]),
            least_time(h, V, A),
        )


def instants() -> Iterator[Trick]:
    """Waypoints passed where the motion is not."""
    h = 1e-9
    V = 1.0
    A = 1.0
    # 0 → 1 → 1 + h → 1 → 2: the turn at 1 + h is left out, the three in the middle are one instant.
    waypoints = [[0.0], [1.0], [1.0 + h], [1.0], [2.0]]
    problem = Problem(waypoints, Limits([V], [A]))
    own = head_start(2.0, V, A, 0.0)
    middle = own.duration / 2
    # It must stop at 1 + h and turn back: from 0 to 1 + h, back by h, and on to 2. The least: the
    # two turns cannot be quicker than the way without them.
    optimum = least_time(1 + h, V, A) + least_time(1.0, V, A)
    for gap in (0.0, 1e-16, 1e-12):
        times = [0.0, middle - gap, middle, middle + gap, own.duration]
        yield Trick(
            f"a turn of {h:g} rad left out within {gap:g} s",
            problem,
            Trajectory(own.breaks, own.coefficients, np.array(times)),
            optimum,
        )


def cancellations() -> Iterator[Trick]:
    """Coefficients so large that their sum is rounding."""
    h = 1.0
    V = 1.0
    A = 1.0
    fast = head_start(h, 2 * V, 4 * A, 0.0)
    powers = np.arange(7, -1, -1.0)
    roots = [0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.5]
    for size in (1e6, 1e12, 1e15):
        coefficients = np.zeros((8, 2, 1))
        coefficients[-3:] = fast.coefficients
        # size · s³ (s − 1)³ (s − 1/2): its value and slope vanish at both ends of each piece.
        bump = np.poly(roots) * size
        for piece, length in enumerate(np.diff(fast.breaks)):
            coefficients[:, piece, 0] += bump * length**-powers
        yield Trick(
            f"terms of {size:g} that cancel",
            one_move(h, V, A),
            Trajectory(fast.breaks, coefficients, fast.waypoint_times),
            least_time(h, V, A),
        )


def stops_left_out() -> Iterator[Trick]:
    """Waypoints so close that both are passed at one instant, at full speed."""
    for name, limits in _passage_limits(2):
        for turns, d, slope in (
            (1, 9e-11, 0.0),
            (3, 2e-11, 0.0),
            (99, 9e-13, 0.0),
            (1, 9e-11, -1.0),
            (1, 4e-11, 0.5),
        ):
            yield _passages(f"{turns} at one instant, {name}", limits, turns, d, slope, 0.0)


def stops_rushed_through() -> Iterator[Trick]:
    """The same, passed one after the other as fast as the joint that moves goes."""
    for name, limits in _passage_limits(2):
        for turns, d, slope in (
            (1, 9e-11, 0.0),
            (1, 1e-8, 0.0),
            (3, 1e-12, 0.0),
            (1, 9e-11, -1.0),
            (1, 4e-11, 0.5),
        ):
            yield _passages(f"{turns} rushed through, {name}", limits, turns, d, slope, d)


def stops_far_from_zero() -> Iterator[Trick]:
    """The way of the slower joint is one unit in the last place of its coordinate."""
    coordinate = 1e5
    unit = float(np.spacing(coordinate))
    for name, limits in _passage_limits(2):
        for turns, d in (
            (1, 1.0e-10),
            (1, 3e-11),
            (3, 3e-11),
        ):
            slope = unit / d
            what = f"{turns} at {coordinate:g} rad, {name}"
            yield _passages(what, limits, turns, d, slope, d, coordinate)


def _passage_limits(joints: int) -> Iterator[tuple[str, Limits]]:
    """Velocity and acceleration of 1, whatever else is limited."""
    ones = [1.0] * joints
    far = [1e7] * joints
    yield "no more limits", Limits(ones, ones)
    yield "jerk limits", Limits(ones, ones, jerk=[1e3] * joints)
    yield "position limits", Limits(ones, ones, position=far)


def _passages(
    what: str,
    limits: Limits,
    turns: int,
    d: float,
    slope: float,
    elapsed: float,
    coordinate: float = 0.0,
) -> Trick:
    """Two joints at the same speed, past pairs of waypoints `d` and `slope · d` apart.

    Between the two of a pair the second joint's mean velocity is at most `slope`, so its velocity
    at the pair is at most `slope + A L / 2` after `L` seconds. That costs it `(1 − slope)²` seconds
    at least, which no `L` makes less.
    """
    waypoints = [[0.0, coordinate]]
    times = [0.0]
    for turn in range(1, turns + 1):
        there = coordinate + turn
        waypoints.append([turn, there])
        waypoints.append([turn + d, there + slope * d])
        time = turn + 0.5
        times.append(time)
        times.append(time + elapsed)
    end = turns + 1.0
    waypoints.append([end, coordinate + end])
    problem = Problem(waypoints, limits)
    phases = [
        (1.0, 0.0, 1.0),
        (end - 1, 1.0, 0.0),
        (1.0, 1.0, -1.0),
    ]
    if problem.has("jerk"):
        first = _jerky_cruise(end, 0.0)
        second = _jerky_cruise(end, coordinate)
        late = (first.duration - end - 1) / 2
        later = [time + late for time in times[1:]]
        times = [0.0, *later]
    else:
        first = joined(phases)
        second = joined(phases, coordinate)
    times.append(first.duration)
    lost = (1 - max(slope, 0.0)) ** 2
    return Trick(
        f"{what}, {d:g} rad and {slope:g} of that apart",
        problem,
        together([first, second], times),
        turns + 2 + turns * lost,
    )


def _jerky_cruise(h: float, start: float) -> Trajectory:
    """From rest to rest over `h` with velocity and acceleration of 1 and jerk of 1000."""
    ramp = 1e-3
    j = 1e3
    steady = 1 - ramp
    cruise = h - 1 - ramp
    phases = [
        (ramp, j),
        (steady, 0.0),
        (ramp, -j),
        (cruise, 0.0),
        (ramp, -j),
        (steady, 0.0),
        (ramp, j),
    ]
    breaks = [0.0]
    columns = []
    x = start
    v = 0.0
    a = 0.0
    for t, jerk in phases:
        columns.append([jerk / 6, a / 2, v, x])
        breaks.append(breaks[-1] + t)
        x += (v + (a / 2 + jerk / 6 * t) * t) * t
        v += (a + jerk / 2 * t) * t
        a += jerk * t
    return one_joint(np.array(breaks), columns)


def tiny_swings() -> Iterator[Trick]:
    """Jumps of a few rounding units instead of swings, where jerk is limited.

    A swing of `h` between two turns takes `cbrt(12 h / J)` seconds or more. Before the swings the
    second joint takes the time, meanwhile the third has next to nothing to do.
    """
    J = 1.0
    A = 1e8
    big = 0.002
    done = 0.5
    begin = 1 + 1 / A
    largest = 1.875 * big / done  # rad/s, of a quintic from rest to rest
    jump = 1.5 * np.finfo(float).eps * largest
    limits = Limits(
        [1.0, 1.0, 1.0],
        [1.0, A, A],
        jerk=[J, np.inf, np.inf],
    )
    ramp = 1 / A
    cruise = [
        (ramp, 0.0, A),
        (1 - ramp, 1.0, 0.0),
        (ramp, 1.0, -A),
    ]
    for swings, each in (
        (100, 1e-10),
        (300, 1e-10),
        (300, 1e-11),
    ):
        h = jump * each
        turns = np.arange(swings + 1)
        swung = begin + each * turns
        times = np.concatenate([[0.0], swung])
        waypoints = np.zeros((swings + 2, 3))
        waypoints[0, 0] = -big
        waypoints[1:, 0] = h * (turns % 2)
        waypoints[1:, 1] = 1.0
        waypoints[1:, 2] = 1e-20 * turns
        # straight lines, and before them a quintic that the judge sees at its fastest
        moved = np.diff(waypoints, axis=0)
        lengths = np.diff(times)[:, None]
        slopes = moved / lengths
        lines = np.stack([slopes, waypoints[:-1]])
        swinging = np.zeros((6, swings + 2))
        swinging[4:, 1:] = lines[..., 0]
        swinging[:, 1] = 0.0
        swinging[0, 0] = 6 * big / done**5
        swinging[1, 0] = -15 * big / done**4
        swinging[2, 0] = 10 * big / done**3
        swinging[5, 0] = -big
        breaks = np.insert(times, 1, done)
        ends = times[[0, -1]]
        first = Trajectory(breaks, swinging[..., None], ends)
        first = first.refined([done / 2])
        rest = times[-1] - begin
        second = joined([*cruise, (rest, 0.0, 0.0)])
        last = Trajectory(times, lines[..., 2:], ends)
        swing = (12 * h / J) ** (1 / 3)
        yield Trick(
            f"{swings} swings of {h:.1g} rad within {each:g} s",
            Problem(waypoints, limits),
            together([first, second, last], times),
            1.0 + (swings - 2) * swing,
        )


def _past_the_limit(
    offset: float,
    gap: float,
    excess: float,
    side: float,
    waits: int,
) -> Trick:
    """A joint takes a run-up from beyond its position limit, while the other one turns on its own.

    The first joint moves from 0 to 1, where its limit is, and has to stop there. The second one
    waits beside its limit, or so little as `gap` away, and then moves by 1.
    """
    V = 9.0
    A = 1.0
    run_up = (2 * A * (gap + excess)) ** 0.5
    allowed = (2 * A * gap) ** 0.5
    moves = 2.0 * (1 + waits)
    last = _time_with_run_up(run_up)
    backwards = run_up / 2**0.5
    outwards = -side
    wait = moves - 2 * backwards - run_up
    peak = (last + run_up) / 2
    speeding = peak - run_up
    second = joined(
        [
            (wait, 0.0, 0.0),
            (backwards, 0.0, outwards),
            (backwards + run_up, outwards * backwards, side),
            (speeding, side * run_up, side),
            (peak, side * peak, outwards),
        ],
        offset,
    )
    phases = []
    turns = []
    for turn in range(waits + 1):
        sign = (-1.0) ** turn
        phases += [
            (1.0, 0.0, sign),
            (1.0, sign, -sign),
        ]
        turns.append((1 + sign) / 2)
    home = 0.1**0.5
    back = -sign
    phases += [
        (home, 0.0, back),
        (home, back * home, -back),
        (last - 2 * home, 0.0, 0.0),
    ]
    waypoints = [[0.0, offset]]
    waypoints += [[turn, offset] for turn in turns]
    end = turns[-1] + 0.1 * back
    waypoints.append([end, offset + side])
    near = offset - side * gap
    far = offset + side * 9
    limits = Limits(
        [V, V],
        [A, A],
        position=[[0.0, 1.0], sorted([near, far])],
    )
    times = [2.0 * turn for turn in range(waits + 2)]
    times.append(moves + last)
    where = f"{gap:g} rad from {offset:g}, side {side:g}, {waits} waits"
    return Trick(
        f"{excess:g} rad beyond a limit {where}",
        Problem(waypoints, limits),
        together([joined(phases), second], times),
        moves + _time_with_run_up(allowed),
    )


def _time_with_run_up(v0: float) -> float:
    """From velocity `v0` to rest over 1 rad with an acceleration of 1, s."""
    # the peak velocity p: (p² − v0²) / 2 + p² / 2 = 1
    peak = float((1 + v0**2 / 2) ** 0.5)
    return 2 * peak - v0


def run_ups() -> Iterator[Trick]:
    """Waypoints on a position limit."""
    for excess in (0.99e-8, 1e-10, 1e-12):
        for side in (1.0, -1.0):
            yield _past_the_limit(0.0, 0.0, excess, side, 0)


def run_ups_beside_a_limit() -> Iterator[Trick]:
    """Waypoints next to a position limit."""
    for gap in (1e-12, 1e-9, 1e-6):
        yield _past_the_limit(0.0, gap, 0.99e-8, 1.0, 0)


def run_ups_after_waiting() -> Iterator[Trick]:
    """A joint that rests on its position limit for several segments."""
    for waits in (1, 2, 5):
        yield _past_the_limit(0.0, 0.0, 0.99e-8, 1.0, waits)


def run_ups_far_from_zero() -> Iterator[Trick]:
    """Position limits at a coordinate whose last place is not small."""
    for offset in (1e3, 1e6):
        yield _past_the_limit(offset, 0.0, 0.99e-8, 1.0, 0)
        yield _past_the_limit(offset, 2.0**-20, 2.0**-30, 1.0, 0)


def early_waypoint_times() -> Iterator[Trick]:
    """Waypoint times that leave the motion by rounding."""
    for trick in (*misses(), *run_ups()):
        motion = trick.trajectory
        late = 9e-13 * motion.duration
        times = motion.waypoint_times.copy()
        times[0] -= late
        times[-1] += late
        moved = Trajectory(motion.breaks, motion.coefficients, times)
        yield Trick(f"{trick.name}, early", trick.problem, moved, trick.optimum)


def bent_everywhere() -> Iterator[Trick]:
    """Noise on motions that cheat already."""
    rng = np.random.default_rng(0)
    bent = [
        *stops_rushed_through(),
        *run_ups(),
        *run_ups_beside_a_limit(),
    ]
    for trick in bent:
        motion = trick.trajectory
        given = motion.coefficients
        sizes = np.abs(given)
        largest = sizes.max(axis=(1, 2), keepdims=True)
        noise = rng.uniform(-3e-13, 3e-13, given.shape)
        added = largest * noise
        moved = Trajectory(motion.breaks, given + added, motion.waypoint_times)
        yield Trick(f"{trick.name}, bent", trick.problem, moved, trick.optimum)


FAMILIES: tuple[Callable[[], Iterator[Trick]], ...] = (
    head_starts,
    jerky_head_starts,
    misses,
    far_from_zero,
    staircases,
    overflows,
    slivers,
    instants,
    cancellations,
    stops_left_out,
    stops_rushed_through,
    stops_far_from_zero,
    tiny_swings,
    run_ups,
    run_ups_beside_a_limit,
    run_ups_after_waiting,
    run_ups_far_from_zero,
    early_waypoint_times,
    bent_everywhere,
)


def tricks() -> list[Trick]:
    """Every trick of every family; their names differ."""
    found: list[Trick] = []
    for family in FAMILIES:
        found += family()
    return found
