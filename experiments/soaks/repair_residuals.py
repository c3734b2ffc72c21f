"""Does the exact repair leave anything to mend? Computed in exact fractions.

    python -m experiments.soaks.repair_residuals                  # 500 motions, ten CPU s

Random motions, bent and cut at random, are repaired. What the repair still misses and how it still
jumps is computed without rounding; mending that would use some share of the limits. The theorem of
`docs/mathematics.md`, section 7, says 0 for real numbers; the share is what rounding adds to it.
"""

from __future__ import annotations

from fractions import Fraction

import cyclopts
import numpy as np
from numpy.typing import NDArray

from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidInput
from trajopt.core.problem import Limits, Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging import repair
from trajopt.judging.verification import Tolerance, verify

Array = NDArray[np.float64]
Exact = NDArray[np.object_]

WIDE = Tolerance(position=1e9, position_limit=1e9, jump=1e9)
SHARES = (0.5, 0.9, 0.99, 1.0)
_ORDERS = {"velocity": 1, "acceleration": 2, "jerk": 3}


def use_left(
    problem: Problem,
    mended: Trajectory,
    dilation: float,
) -> float:
    """The share of a limit that mending what is left would use, of the dilated motion."""
    layout = repair._layout(problem, mended)
    assert layout is not None
    motion = layout.trajectory
    coefficients = _fractions(motion.coefficients)
    breaks = _fractions(motion.breaks)
    lengths = np.diff(breaks)[:, None]
    travel = _value(coefficients, lengths) - coefficients[-1]
    reached = np.add.reduceat(travel, layout.first)
    waypoints = _fractions(layout.waypoints)
    short = np.diff(waypoints, axis=0) - reached
    missed = np.asarray(short, dtype=float)
    jumps = [
        _jumps(coefficients, lengths, 1),
        _jumps(coefficients, lengths, 2),
    ]
    limits = problem.limits
    jerk_limited = limits.jerk_limited
    by_order = {1: ~jerk_limited, 2: jerk_limited}
    use = 0.0
    for order, joints in by_order.items():
        if not joints.any():
            continue
        own = [jump[:, joints] for jump in jumps[:order]]
        added = repair._cancelling(layout, missed[:, joints], own)
        for name, derivative in _ORDERS.items():
            taken = polynomials.derivative(added, derivative)
            unit = polynomials.stretched(taken, motion.lengths)
            controls = np.abs(polynomials.bernstein(unit))
            sizes = np.abs(limits.by_name()[name])
            allowed = sizes.min(axis=1)
            share = controls / allowed[joints]
            of_dilated = share.max() / dilation**derivative
            use = max(use, float(of_dilated))
    return use


def _fractions(numbers: Array) -> Exact:
    exactly = np.vectorize(Fraction, otypes=[object])
    return np.asarray(exactly(numbers))


def _value(coefficients: Exact, at: Exact) -> Exact:
    value = coefficients[0]
    for row in coefficients[1:]:
        value = value * at + row
    return np.asarray(value)


def _jumps(
    coefficients: Exact,
    lengths: Exact,
    order: int,
) -> Array:
    """Jumps of a derivative at every break, before and after a rest, `(breaks, joints)`."""
    for _ in range(order):
        degree = len(coefficients) - 1
        powers = np.arange(degree, 0, -1)
        coefficients = coefficients[:-1] * powers[:, None, None]
    rest = 0 * coefficients[-1, :1]
    after = np.concatenate([coefficients[-1], rest])
    before = np.concatenate([rest, _value(coefficients, lengths)])
    jumps = after - before
    return np.asarray(jumps, dtype=float)


def drawn(rng: np.random.Generator) -> tuple[Problem, Trajectory]:
    """A problem of any size with any limits, and cubic pieces that are bent and cut.

    Raises:
        InvalidInput: the waypoints drawn are one.
    """
    problem = _drawn_problem(rng)
    motion = _through(rng, problem.waypoints)
    cuts = rng.uniform(0, motion.duration, 3)
    beside = motion.duration * _power(rng, -15, -6, 3)
    times = np.concatenate([cuts, cuts + beside])
    motion = motion.refined(times)
    given = motion.coefficients
    sizes = np.abs(given)
    largest = sizes.max(axis=1, keepdims=True)
    share = _power(rng, -17, -4)
    noise = rng.normal(size=given.shape)
    bent = given + share * largest * noise
    moved = Trajectory(
        motion.breaks,
        bent,
        motion.waypoint_times,
    )
    factor = _power(rng, -2, 2)
    return problem, moved.dilated(float(factor))


def _power(
    rng: np.random.Generator,
    low: float,
    high: float,
    size: int | tuple[int, int] | None = None,
) -> Array:
    """Powers of ten."""
    exponents = rng.uniform(low, high, size)
    return np.asarray(10.0**exponents)


def _drawn_problem(rng: np.random.Generator) -> Problem:
    joints = int(rng.integers(1, 4))
    segments = int(rng.integers(1, 8))
    shape = (segments, joints)
    h = _power(rng, -9, 2)
    spread = rng.choice([0.0, 3.0, 9.0])
    sizes = h * _power(rng, -spread, 0, shape)
    signs = rng.choice([-1.0, 1.0, 0.0], shape)
    far = rng.choice([0.0, 1.0, 1e3, 1e6], joints)
    moved = np.cumsum(signs * sizes, axis=0)
    start = np.zeros((1, joints))
    waypoints = far + np.concatenate([start, moved])
    limited = rng.random(joints) < 0.4
    steep = h * _power(rng, -1, 5, joints)
    jerk = np.where(limited, steep, np.inf)
    gaps = h * rng.choice([1e-13, 1e-9, 0.1], (2, joints))
    low = waypoints.min(axis=0) - gaps[0]
    high = waypoints.max(axis=0) + gaps[1]
    position = None
    if rng.random() < 0.5:
        position = np.stack([low, high], axis=1)
    limits = Limits(
        _power(rng, -2, 4, joints),
        _power(rng, -2, 4, joints),
        list(jerk),
        position,
    )
    return Problem(waypoints, limits)


def _through(rng: np.random.Generator, waypoints: Array) -> Trajectory:
    """Cubic pieces from waypoint to waypoint, with any velocity there, at rest at both ends."""
    displacements = np.diff(waypoints, axis=0)
    segments = len(displacements)
    brief = rng.choice([0.0, 3.0, 8.0])
    lengths = _power(rng, -brief, 0, (segments, 1))
    slopes = displacements / lengths
    speeds = np.zeros_like(waypoints)
    speeds[1:-1] = slopes[:-1] * rng.normal(size=(segments - 1, 1))
    begin = speeds[:-1]
    end = speeds[1:]
    square = 3 * slopes - 2 * begin - end
    cube = begin + end - 2 * slopes
    rows = [
        cube / lengths**2,
        square / lengths,
        begin,
        waypoints[:-1],
    ]
    ended = np.cumsum(lengths)
    breaks = np.concatenate([[0.0], ended])
    return Trajectory(breaks, np.stack(rows), breaks)


def main(motions: int = 500, seed: int = 0) -> None:
    """Repair random motions and print what is left, in shares of the motions."""
    rng = np.random.default_rng(seed)
    left: list[float] = []
    while len(left) < motions:
        try:
            problem, motion = drawn(rng)
        except InvalidInput:
            continue
        certificate = verify(problem, motion, WIDE)
        mended = repair.repaired(problem, motion)
        if not certificate.valid or mended is None:
            continue
        dilation = max(1.0, certificate.dilation)
        left.append(use_left(problem, mended, dilation))
    for share in SHARES:
        most = np.quantile(left, share)
        print(f"{share:5.0%} of {motions}: at most {most:.1e} of a limit")


if __name__ == "__main__":
    cyclopts.run(main)
