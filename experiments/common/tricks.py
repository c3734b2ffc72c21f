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
from numpy.typing import NDArray

from trajopt.problem import Limits, Problem
from trajopt.trajectory import Trajectory

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


def joined(phases: Sequence[tuple[float, float, float]]) -> Trajectory:
    """One joint from phases `(duration, velocity, acceleration)`, each where the last one ends."""
    durations = [phase[0] for phase in phases]
    breaks = np.concatenate([[0.0], np.cumsum(durations)])
    position = 0.0
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
)


def tricks() -> list[Trick]:
    """Every trick of every family; their names differ."""
    found: list[Trick] = []
    for family in FAMILIES:
        found += family()
    return found
