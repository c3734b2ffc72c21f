"""The extreme profiles against linear programs, and their combinations against their limits."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from baselines.exact.jerk_motion import combined
from baselines.exact.jerk_profiles import Limit, extremes, highest
from baselines.exact.rounded import Clock
from trajopt import polynomials

Array = NDArray[np.float64]

RISE, FALL = 2.0, 1.5  # the acceleration limits
TOP, BOTTOM = 1.0, 0.8  # the velocity limits


def limit(factor: float) -> Limit:
    """Jerk between `−factor` and `2 factor`."""
    return Limit(*map(np.array, (TOP, RISE, FALL, 0.5 / factor, 1 / factor)))


def furthest(start: Array, end: Array, t: float, factor: float, steps: int = 400) -> float | None:
    """The most displacement by piecewise constant jerk, which lies inside; none if unreachable."""
    (u, a), (w, b), dt = start, end, t / steps
    sums = np.tril(np.ones((steps, steps))) * dt  # jerk to acceleration after each step
    gains = sums @ sums - sums * dt / 2  # and to velocity
    times = dt * np.arange(1, steps + 1)
    weight = (t - times + dt / 2) ** 2 / 2 * dt + dt**3 / 24
    rows, ends = np.vstack([sums, -sums, gains]), np.vstack([sums[-1], gains[-1]])
    edges = np.r_[np.full(steps, RISE) - a, np.full(steps, FALL) + a, TOP - u - a * times]
    changes = [b - a, w - u - a * t]
    answer = linprog(-weight, rows, edges, ends, changes, bounds=(-factor, 2 * factor))
    return None if answer.x is None else u * t + a * t**2 / 2 - answer.fun


@pytest.mark.parametrize("factor", [1.0, 3.0, 10.0])
def test_the_highest_profile_is_the_best_of_all(factor: float) -> None:
    rng, compared = np.random.default_rng(int(factor)), 0
    for _ in range(4):
        t, (u, w), (a, b) = (
            rng.uniform(0.3, 3),
            rng.uniform(-0.3, 0.3, 2),
            rng.uniform(-0.4, 0.4, 2),
        )
        reached = furthest(np.array([u, a]), np.array([w, b]), t, factor)
        if reached is None:
            continue
        found = highest((u, a), (w, -b), np.array(t), limit(factor))
        assert reached <= float(found.displacement) + 1e-9
        assert float(found.displacement) == pytest.approx(reached, abs=30 * (t / 400) ** 2)
        compared += 1
    assert compared


def test_acceleration_may_stay_below_zero_throughout() -> None:
    """Too short to raise it to 0 and lower it again: against a linear program once more."""
    start, end, t = np.array([0.5, -1.0]), np.array([0.1, -1.0]), 0.45
    found = highest(tuple(start), (end[0], -end[1]), np.array(t), limit(3.0))
    reached = furthest(start, end, t, 3.0)
    assert found.rise < 0
    assert found.slack == pytest.approx(0, abs=1e-12)
    assert float(found.displacement) == pytest.approx(reached, abs=30 * (t / 400) ** 2)


def test_too_little_time_is_a_negative_slack() -> None:
    rest, fast = (np.zeros(()), np.zeros(())), (np.array(0.9), np.zeros(()))
    for start, end in ((rest, fast), (fast, rest)):
        assert highest(start, end, np.array(0.5), limit(3.0)).slack < 0
        assert highest(start, end, np.array(2.0), limit(3.0)).slack >= 0


@pytest.mark.parametrize("factor", [0.5, 3.0, 1e5])
def test_combinations_cover_their_displacement_within_the_limits(factor: float) -> None:
    rng, joints, t = np.random.default_rng(0), 40, 8.0
    states = rng.uniform(-1, 1, (2, 2, joints)) * np.reshape([0.5, 0.3 * min(factor, 1)], (2, 1, 1))
    (u, w), (a, b) = states
    sides = limit(factor), Limit(*map(np.array, (BOTTOM, FALL, RISE, 1 / factor, 0.5 / factor)))
    both = extremes((u, a), (w, b), np.full(joints, t), sides)
    least, most = -both.lower.displacement, both.upper.displacement
    h = least + rng.uniform(size=joints) * (most - least)
    wider = tuple(side._replace(velocity=side.velocity * (1 + 1e-12)) for side in sides)
    assert both.reach(h, wider).all()  # wider: peaks at the limit are rounded
    assert not both.reach(most + 1e-6, wider).any()
    clock = Clock(start=0.0, end=t, unit=1.0, resolution=0.0)
    places = np.array([0.0, t])
    for i, ends in enumerate(np.moveaxis(states, 2, 0)):
        breaks, cubics = combined(ends, h[i], both.at(i), sides, clock, places)
        check_ends_and_breaks(breaks, cubics, np.vstack([[0.0, h[i]], ends]))
        check_limits(breaks, cubics, factor)


@pytest.mark.parametrize("t", [1e-2, 1e-4, 1e-6, 1e-7])
def test_constant_jerk_through_a_brief_segment_is_within_reach(t: float) -> None:
    rng, joints = np.random.default_rng(1), 200
    u = rng.uniform(-0.5, 0.5, joints)
    a = rng.uniform(-1, 1, joints)
    jerk = rng.uniform(-0.9, 0.9, joints)  # limits: −1 and 2
    b = a + jerk * t
    w = u + (a + b) * t / 2
    h = u * t + a * t**2 / 2 + jerk * t**3 / 6
    sides = limit(1.0), Limit(*map(np.array, (BOTTOM, FALL, RISE, 1.0, 0.5)))
    assert extremes((u, a), (w, b), np.full(joints, t), sides).reach(h, sides).all()


def check_ends_and_breaks(breaks: Array, cubics: Array, expected: Array) -> None:
    """Position, velocity, acceleration: as expected at both ends, and without jumps between."""
    for order, (first, last) in enumerate(expected):
        coefficients = polynomials.derivative(cubics, order)
        before, after = coefficients[-1], polynomials.evaluate(coefficients, np.diff(breaks))
        np.testing.assert_allclose(np.r_[before, last], np.r_[first, after], atol=1e-8)


def check_limits(breaks: Array, cubics: Array, factor: float) -> None:
    within = np.diff(breaks) * np.linspace(0, 1, 20)[:, None]
    limits = [(-BOTTOM, TOP), (-FALL, RISE), (-factor, 2 * factor)]
    for order, (low, high) in enumerate(limits, start=1):
        values = polynomials.evaluate(polynomials.derivative(cubics, order)[:, None], within)
        slack = 1e-9 * (high - low)
        assert low - slack <= values.min() <= values.max() <= high + slack
