"""The extreme profiles against linear programs, and their derivatives against differences."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import linprog

from baselines.exact.jerk.profiles import ExtremeProfiles, SegmentLimits

Array = NDArray[np.float64]

RISE, FALL = 2.0, 1.5  # the acceleration limits
TOP = 1.0  # the velocity limit


def furthest(start: Array, end: Array, t: float, factor: float, steps: int = 400) -> float | None:
    """The most displacement by piecewise constant jerk, which lies inside; none if unreachable.

    Jerk between `−factor` and `2 factor`.
    """
    (u, a), (w, b), dt = start, end, t / steps
    sums = np.tril(np.ones((steps, steps))) * dt  # jerk to acceleration after each step
    gains = sums @ sums - sums * dt / 2  # and to velocity
    times = dt * np.arange(1, steps + 1)
    weight = (t - times + dt / 2) ** 2 / 2 * dt + dt**3 / 24
    rows = np.vstack([sums, -sums, gains])
    ends = np.vstack([sums[-1], gains[-1]])
    edges = np.r_[np.full(steps, RISE) - a, np.full(steps, FALL) + a, TOP - u - a * times]
    changes = [b - a, w - u - a * t]
    answer = linprog(-weight, rows, edges, ends, changes, bounds=(-factor, 2 * factor))
    return None if answer.x is None else u * t + a * t**2 / 2 - answer.fun


def both(one: float | Array, other: float | Array) -> Array:
    """Of both ends, for one side."""
    return np.array([[one], [other]], dtype=float)


def side(value: float | Array) -> Array:
    return np.array([value], dtype=float)


def highest(start: Array, end: Array, t: float, factor: float) -> ExtremeProfiles:
    (u, a), (w, b) = start, end
    limits = SegmentLimits(
        both(RISE, FALL), side(TOP / t), side(0.5 / factor / t), side(1 / factor / t), 0
    )
    return ExtremeProfiles(both(u, w) / t, both(a, -b), limits)


@pytest.mark.parametrize("factor", [1.0, 3.0, 10.0])
def test_the_highest_profile_is_the_best_of_all(factor: float) -> None:
    rng = np.random.default_rng(int(factor))
    compared = 0
    for _ in range(4):
        t = rng.uniform(0.3, 3)
        (u, w) = rng.uniform(-0.3, 0.3, 2)
        (a, b) = rng.uniform(-0.4, 0.4, 2)
        start = np.array([u, a])
        end = np.array([w, b])
        found = highest(start, end, t, factor)
        reached = furthest(start, end, t, factor)
        assert bool(found.reachable[0]) == (reached is not None)
        if reached is None:
            continue
        displacement = found.value[0] * t**2
        assert reached <= displacement + 1e-9
        assert displacement == pytest.approx(reached, abs=30 * (t / 400) ** 2)
        compared += 1
    assert compared


def test_acceleration_may_stay_below_zero_throughout() -> None:
    """Too short to raise it to 0 and lower it again: against a linear program once more."""
    start = np.array([0.5, -1.0])
    end = np.array([0.1, -1.0])
    t = 0.45
    found = highest(start, end, t, 3.0)
    assert found.rises[0, 0] < 0
    assert found.reachable.all()
    reached = furthest(start, end, t, 3.0)
    assert found.value[0] * t**2 == pytest.approx(reached, abs=30 * (t / 400) ** 2)


def drawn(kinds: int) -> tuple[Array, Array]:
    """Variables `(5, …)` of cells of many kinds, and their limits: V, A1, A2, r1, r2, h."""
    rng = np.random.default_rng(0)
    t = np.exp(rng.uniform(-2, 2, kinds))
    up = np.exp(rng.uniform(-3, 1, kinds))
    down = up * rng.choice([1.0, 0.3, 3.0], kinds)
    fall, rise = rng.uniform(0.5, 2, (2, kinds))
    top = np.exp(rng.uniform(-1, 1.5, kinds))
    h = rng.uniform(-0.8, 0.8, kinds) * top * t
    small = 0.9 * np.minimum(rise, fall) * np.minimum(1, t / up / 2)
    a, b = rng.uniform(-1, 1, (2, kinds)) * small
    x0, x1 = rng.uniform(-0.3, 0.3, (2, kinds))
    without_jerk = rng.random(kinds) < 0.1
    up[without_jerk] = down[without_jerk] = 0.0
    return np.array([np.log(t), x0, a, x1, b]), np.array([top, fall, rise, down, up, h])


def profiles(variables: Array, numbers: Array) -> ExtremeProfiles:
    log, x0, a, x1, b = variables
    top, fall, rise, down, up, h = numbers
    t = np.exp(log)
    steep = h / t**2
    limits = SegmentLimits(
        both(rise, fall), side(top / t) - steep, side(up / t), side(down / t), side(steep)
    )
    return ExtremeProfiles(both(x0, x1), both(a, b), limits)


def test_derivatives_are_what_differences_tend_to() -> None:
    """Displacement beyond the cell's own, over its time and both states, twice."""
    variables, numbers = drawn(4000)
    with np.errstate(all="ignore"):
        found = profiles(variables, numbers)
        first, second = found.slopes()
        for i, step in enumerate(1e-6 * np.eye(5)[:, :, None]):
            up = profiles(variables + step, numbers)
            down = profiles(variables - step, numbers)
            by_difference = (up.value - down.value) / 2e-6
            twice = (up.slopes().first - down.slopes().first) / 2e-6
            # not across a change of who holds its limit, where second derivatives jump
            kept = found.reachable & up.reachable & down.reachable
            for one, other in ((found, up), (found, down)):
                kept &= ((one.hold > 0) == (other.hold > 0)).all(axis=0)
                kept &= (one.cruise > 0) == (other.cruise > 0)
            assert kept.mean() > 0.4
            scale = 1 + np.abs(by_difference)
            assert (np.abs(first[i] - by_difference) / scale)[kept].max() < 1e-8
            scale = 1 + np.abs(twice)
            assert np.quantile((np.abs(second[:, i] - twice) / scale)[:, kept], 0.999) < 1e-7


@pytest.mark.parametrize("t", [1e-2, 1e-5, 1e-8])
def test_constant_jerk_through_a_brief_segment_is_within_reach(t: float) -> None:
    """And so little beyond it that nothing is left of it in units of the acceleration."""
    rng = np.random.default_rng(1)
    cells = 200
    a = rng.uniform(-1, 1, cells)
    jerk = rng.uniform(-0.9, 0.9, cells)  # limits: −1 and 2
    b = a + jerk * t
    mean = (a + b) / 2
    # u = h/T − a T/2 − j T²/6 and w = h/T + b T/2 − j T²/6, in units of T, h/T less
    ends = np.array([-a / 2 - jerk * t / 6, b / 2 - jerk * t / 6])
    for sign, up, down in ((1.0, 0.5, 1.0), (-1.0, 1.0, 0.5)):
        steepest = np.full((2, 1, cells), 2.0)
        limits = SegmentLimits(steepest, side(np.full(cells, 1e9)), side(up / t), side(down / t), 0)
        found = ExtremeProfiles(sign * ends[:, None], sign * both(a, -b), limits)
        assert found.reachable.all()
        assert (found.value > 0).all()
        assert (found.value < t).all()
    assert np.abs(mean).max() > 0.9


def test_a_joint_at_its_velocity_limit_cruises() -> None:
    """A rise of 1e-7 of the acceleration limit once made six more phases."""
    profile = highest((TOP, 0.0), (TOP, 0.0), 2.0, 1.0)
    assert np.abs(profile.rises).max() <= 1e-11
    assert np.abs(profile.first).max() <= 1e-11
    assert profile.cruise == pytest.approx(1.0, abs=1e-11)


@pytest.mark.parametrize(
    ("acceleration", "velocity", "level", "hold", "cruise", "displacement"),
    [
        (10.0, np.inf, 8.0, 0.0, 0.0, 1.0),
        (4.0, np.inf, 4.0, 0.25, 0.0, 0.75),
        (4.0, 1.0, 4.0, 0.125, 0.25, 0.625),
    ],
)
def test_the_worked_example(
    acceleration: float,
    velocity: float,
    level: float,
    hold: float,
    cruise: float,
    displacement: float,
) -> None:
    """docs/mathematics/exact.md, section 5: from rest to rest in 1 s, jerk limits of 32 rad/s³."""
    jerk = side(1 / 32)
    limits = SegmentLimits(
        both(side(acceleration), side(acceleration)), side(velocity), jerk, jerk, side(0.0)
    )
    at_rest = both(side(0.0), side(0.0))
    found = ExtremeProfiles(at_rest, at_rest, limits)
    assert found.reachable.all()
    for table, expected in ((found.rises, level), (found.hold, hold), (found.cruise, cruise)):
        np.testing.assert_allclose(table, expected, rtol=1e-14)
    np.testing.assert_allclose(found.value, displacement, rtol=1e-14)
