"""Ways to cheat a judge: trajectories that claim less than an optimum known in closed form.

Each trick is a problem of one or two joints whose minimum time is that of rest-to-rest moves, and a
trajectory that is faster by what some tolerance, some overflow or some rounding might let pass.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from trajopt.problem import Limits, Problem
from trajopt.trajectory import Trajectory


@dataclass(frozen=True)
class Trick:
    name: str
    problem: Problem
    trajectory: Trajectory
    optimum: float  # s


def least_time(h: float, V: float, A: float) -> float:
    """From rest to rest over `h`: two parabolas, with a cruise between them where `h > V²/A`."""
    return 2 * (h / A) ** 0.5 if h * A <= V**2 else h / V + V / A


def least_jerky_time(h: float, J: float) -> float:
    """From rest to rest over `h` with jerk `J` alone: four phases of `cbrt(h / 2J)`."""
    return 4 * (h / (2 * J)) ** (1 / 3)


def joined(velocity: list[tuple[float, float, float]], start: float = 0.0) -> Trajectory:
    """One joint from pieces `(duration, velocity, acceleration)`, each starting where it should."""
    breaks = np.concatenate([[0.0], np.cumsum([piece[0] for piece in velocity])])
    position = start
    columns = []
    for duration, v, a in velocity:
        columns.append([a / 2, v, position])
        position += (a / 2 * duration + v) * duration
    return Trajectory(breaks, np.array(columns).T[..., None], breaks[[0, -1]])


def head_start(h: float, V: float, A: float, v0: float) -> Trajectory:
    """A move over `h` that begins and ends with a velocity of `v0` instead of 0."""
    # h = (p² − v0²) / A without a cruise
    peak = (h * A + v0**2) ** 0.5
    if peak <= V:
        rise = (peak - v0) / A
        return joined([(rise, v0, A), (rise, peak, -A)])
    rise = (V - v0) / A
    cruise = h / V - (V**2 - v0**2) / (A * V)
    return joined([(rise, v0, A), (cruise, V, 0.0), (rise, V, -A)])


def alone(h: float, V: float, A: float, **limits: list[float]) -> Problem:
    return Problem([[0.0], [h]], Limits([V], [A], **limits))


def head_starts() -> Iterator[Trick]:
    """Velocity jumps of a millionth of a limit that the motion never comes near."""
    for V, A, h in ((100.0, 1.0, 1.0), (1e4, 1.0, 1.0), (1e6, 1.0, 1.0), (1e4, 1e4, 1e-5)):
        for share in (0.99e-6, 0.5e-6, 1e-9):
            v0 = min(share * V, 0.9 * (h * A) ** 0.5)
            trajectory = head_start(h, V, A, v0)
            name = f"starts at {share:g} V, V = {V:g}, A = {A:g}, h = {h:g}"
            yield Trick(name, alone(h, V, A), trajectory, least_time(h, V, A))


def jerky_head_starts() -> Iterator[Trick]:
    """Acceleration jumps of a millionth of a limit out of reach, where jerk is limited."""
    h = 1.0
    J = 1.0
    for A in (1.0e3, 1.0e6):
        a0 = min(0.99e-6 * A, 0.5)
        # Jerk −J, +J, mirrored, from an acceleration of a0 … : a = a0 + J t, then down to −a0 − …
        # Symmetric about the middle: phases of d: +J from a0, −J through 0, +J up to −a0.
        low, high = 0.0, 4.0
        for _ in range(200):
            d = 0.5 * (low + high)
            if _swing(a0, J, d)[0] < h:
                low = d
            else:
                high = d
        reached, trajectory = _swing(a0, J, d)
        assert abs(reached - h) < 1e-12
        problem = Problem([[0.0], [h]], Limits([1e3], [A], jerk=[J]))
        name = f"starts with 0.99e-6 A, A = {A:g}, J = {J:g}"
        yield Trick(name, problem, trajectory, least_jerky_time(h, J))


def _swing(a0: float, J: float, d: float) -> tuple[float, Trajectory]:
    """Accelerations a0 → a0 + J d → −(a0 + J d) → −a0: what it reaches, and the motion."""
    phases = [(d, J), (2 * (d + a0 / J), -J), (d, J)]
    x, v, a = 0.0, 0.0, a0
    columns = []
    for duration, j in phases:
        columns.append([j / 6, a / 2, v, x])
        x += v * duration + a / 2 * duration**2 + j / 6 * duration**3
        v += a * duration + j / 2 * duration**2
        a += j * duration
    breaks = np.concatenate([[0.0], np.cumsum([duration for duration, _ in phases])])
    return x, Trajectory(breaks, np.array(columns).T[..., None], breaks[[0, -1]])


def misses() -> Iterator[Trick]:
    """A joint that moves less than it should, beside a joint at a large coordinate."""
    for coordinate, h, short in (
        (1e6, 5e-3, 5e-3),
        (1e6, 1e-2, 0.99e-2),
        (1.0, 1e-6, 0.99e-8),
        (1.0, 1e-7, 0.99e-8),
        (1.0, 1e-8, 0.99e-8),
        (1.0, 1e-7, 1e-15),
        (1e6, 1e-9, 1e-9),
    ):
        V, A = 1.0, 1.0
        problem = Problem([[coordinate, 0.0], [coordinate, h]], Limits([V, V], [A, A]))
        covered = h - short
        if covered > 0:
            own = head_start(covered, V, A, 0.0)
        else:
            own = Trajectory([0.0, 1e-3], np.zeros((3, 1, 1)), [0.0, 1e-3])
        # Both misses: it starts late and ends early.
        moving = np.array(own.coefficients)
        moving[-1] += short / 2
        still = np.zeros_like(moving)
        still[-1] = coordinate
        coefficients = np.concatenate([still, moving], axis=2)
        trajectory = Trajectory(own.breaks, coefficients, own.waypoint_times)
        name = f"covers {covered:g} of {h:g} rad beside {coordinate:g} rad"
        yield Trick(name, problem, trajectory, least_time(problem.displacements[0, 1], V, A))


def far_from_zero() -> Iterator[Trick]:
    """The move itself at a coordinate whose last place is not small beside it."""
    for coordinate, h in ((1e6, 1e-6), (1e6, 1e-8), (1e3, 1e-9), (1.0, 1e-12)):
        problem = Problem([[coordinate], [coordinate + h]], Limits([1.0], [1.0]))
        moved = float(problem.displacements[0, 0])
        own = head_start(moved - 0.9 * np.spacing(coordinate), 1.0, 1.0, 0.0)
        coefficients = np.array(own.coefficients)
        coefficients[-1] += coordinate
        trajectory = Trajectory(own.breaks, coefficients, own.waypoint_times)
        name = f"an ulp short of {h:g} rad at {coordinate:g} rad"
        yield Trick(name, problem, trajectory, least_time(moved, 1.0, 1.0))


def staircases() -> Iterator[Trick]:
    """Many jumps, each small."""
    for pieces, kind in (
        (10, "position"),
        (1000, "position"),
        (1000, "velocity"),
        (30, "velocity"),
    ):
        h, V, A = 1.0, 100.0, 1.0
        optimum = least_time(h, V, A)
        step = 0.9e-8 if kind == "position" else 0.9e-6
        if kind == "position":
            own = head_start(h - step * (pieces - 1), V, A, 0.0)
        else:
            own = head_start(h, V, A + 2 * step * pieces, 0.0)
            optimum = least_time(h, V, A)
        breaks = np.linspace(0.0, own.duration, pieces + 1)
        columns = []
        for i, t in enumerate(breaks[:-1]):
            rising = t + 1e-12 < own.duration / 2
            if kind == "position":
                position = own(t)[0] + i * step
                columns.append([own(t, 2)[0] / 2, own(t, 1)[0], position])
            else:
                # Accelerates within the limit, and jumps by the rest at the breaks.
                columns.append([A / 2 if rising else -A / 2, own(t, 1)[0], own(t)[0]])
        coefficients = np.array(columns).T[..., None]
        trajectory = Trajectory(breaks, coefficients, breaks[[0, -1]])
        yield Trick(f"{pieces} small jumps of {kind}", alone(h, V, A), trajectory, optimum)


def overflows() -> Iterator[Trick]:
    """Half the optimum, and in a piece too short to matter numbers that overflow."""
    h, V, A = 1.0, 100.0, 1.0
    optimum = least_time(h, V, A)
    for sliver in (1e-40, 1e-60, 1e-300):
        for first, second in ((1.7e308, -1.7e308), (1e308, 1e308)):
            fast = head_start(h, 2 * V, 4 * A, 0.0)
            breaks = np.concatenate([[0.0, sliver], fast.breaks[1:]])
            coefficients = np.zeros((10, 3, 1))
            coefficients[-3:, 1:] = fast.coefficients
            coefficients[0, 0, 0] = first
            coefficients[1, 0, 0] = second
            trajectory = Trajectory(breaks, coefficients, breaks[[0, -1]])
            name = f"overflow of {first:g}, {second:g} in a piece of {sliver:g} s"
            yield Trick(name, alone(h, V, A), trajectory, optimum)


def slivers() -> Iterator[Trick]:
    """The way made in a piece too short for its velocity to be seen."""
    h, V, A = 1.0, 1.0, 1.0
    for sliver in (1e-15, 1e-100, 1e-310):
        breaks = np.array([0.0, sliver, 1.0])
        coefficients = np.zeros((4, 2, 1))
        coefficients[-1, 1, 0] = h
        with np.errstate(over="ignore"):
            slope = min(h / sliver, 1.7e308)
        coefficients[-2, 0, 0] = slope
        trajectory = Trajectory(breaks, coefficients, breaks[[0, -1]])
        name = f"all the way in {sliver:g} s"
        yield Trick(name, alone(h, V, A), trajectory, least_time(h, V, A))


def instants() -> Iterator[Trick]:
    """Waypoints passed where the motion is not."""
    h, V, A = 1e-9, 1.0, 1.0
    # 0 → 1 → 1 + h → 1 → 0: the turn at h is left out, all three in the middle are one instant.
    problem = Problem([[0.0], [1.0], [1.0 + h], [1.0], [2.0]], Limits([V], [A]))
    own = head_start(2.0, V, A, 0.0)
    middle = own.duration / 2
    # The least: two rest-to-rest turns cannot be quicker than the way without them.
    for gap in (0.0, 1e-16, 1e-12):
        times = [0.0, middle - gap, middle, middle + gap, own.duration]
        trajectory = Trajectory(own.breaks, own.coefficients, times)
        # It must stop at 1 + h and turn back: from 0 to 1 + h, back by h, and on to 2.
        optimum = least_time(1 + h, V, A) + least_time(1.0, V, A)
        name = f"a turn of {h:g} rad left out within {gap:g} s"
        yield Trick(name, problem, trajectory, optimum)


def cancellations() -> Iterator[Trick]:
    """Coefficients so large that their sum is rounding."""
    h, V, A = 1.0, 1.0, 1.0
    fast = head_start(h, 2 * V, 4 * A, 0.0)
    for size in (1e6, 1e12, 1e15):
        coefficients = np.zeros((8, 2, 1))
        coefficients[-3:] = fast.coefficients
        # size · s³ (1 − s)² · …, whose value and slope vanish at both ends of each piece.
        for piece, length in enumerate(np.diff(fast.breaks)):
            bump = np.poly([0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 0.5]) * size
            coefficients[:, piece, 0] += bump * length ** -np.arange(7, -1, -1.0)
        trajectory = Trajectory(fast.breaks, coefficients, fast.waypoint_times)
        yield Trick(
            f"terms of {size:g} that cancel", alone(h, V, A), trajectory, least_time(h, V, A)
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
    return [trick for family in FAMILIES for trick in family()]
