"""No trick is ever certified below the optimum: what is judged is the exact repair.

The theorem is of all trajectories, so tolerances may be as wide as one likes: everything is then
repaired, and the repair is a motion that keeps the problem.
"""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from experiments.soaks import tricks as families
from experiments.soaks.tricks import Trick, least_time, tricks
from trajopt.benchmark.trial import verdict
from trajopt.core.problem import Limits, Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import Tolerance, certified, verify

BELOW = 1e-9  # relative to the optimum
WIDE = Tolerance(position=1e9, position_limit=1e9, jump=1e9)
TRICKS = {trick.name: trick for trick in tricks()}


def test_there_are_tricks_of_many_mechanisms_and_limits():
    mechanisms = {trick.family for trick in TRICKS.values()}
    by_limits = {(trick.family, trick.limits) for trick in TRICKS.values()}
    assert len(mechanisms) >= 26
    assert len(by_limits) >= 51
    with_jerk_and_position = [limits for _, limits in by_limits if "jerk, position" in limits]
    assert len(with_jerk_and_position) >= 10


# The experiment judges the others, whose waypoints take seconds to find.
FEW_WAYPOINTS = [trick for trick in TRICKS.values() if len(trick.problem.waypoints) < 150]


@pytest.mark.parametrize("trick", FEW_WAYPOINTS, ids=lambda trick: trick.name)
def test_no_door_lets_a_trick_in(trick: Trick):
    row = families.judged(trick)
    assert row["certified %"] >= -100 * BELOW


@pytest.mark.parametrize("trick", TRICKS.values(), ids=TRICKS)
def test_every_trick_claims_less_than_the_optimum(trick: Trick):
    assert trick.trajectory.duration < trick.optimum


@pytest.mark.parametrize("tolerance", [Tolerance(), WIDE], ids=["default", "wide"])
@pytest.mark.parametrize("trick", TRICKS.values(), ids=TRICKS)
def test_no_trick_is_certified_below_the_optimum(trick: Trick, tolerance):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        certificate = verify(trick.problem, trick.trajectory, tolerance)
    duration = certificate.certified_duration
    assert duration is None or duration >= trick.optimum * (1 - BELOW)
    if duration is None:
        assert certificate.flaws


@pytest.mark.parametrize("trick", TRICKS.values(), ids=TRICKS)
def test_the_certified_trajectory_keeps_the_problem(trick: Trick):
    motion = certified(trick.problem, trick.trajectory)
    if motion is None or motion.duration > 1e3 * trick.optimum:  # rounding of hours shows then
        return
    segments = np.diff(motion.waypoint_times)
    if segments.min() < 1e-6 * motion.duration:  # a dilation rounds their lengths
        return
    again = verify(trick.problem, motion)
    assert again.feasible
    assert again.dilation <= 1 + 1e-12


def test_what_overflows_is_invalid_and_says_so():
    trick = next(trick for trick in TRICKS.values() if "overflow" in trick.family)
    status, message, _ = verdict(trick.problem, Solution(Status.SOLVED, trick.trajectory))
    assert status is Status.INVALID
    assert message


def test_two_waypoints_at_one_instant_are_told():
    problem = Problem([[0.0], [1.0], [1.0 - 1e-12], [2.0]], Limits([1.0], [1.0]))
    line = Trajectory([0.0, 2.0, 4.0], [[[0.5], [0.5]], [[0.0], [1.0]]], [0.0, 2.0, 2.0, 4.0])
    (flaw, *_) = verify(problem, line, WIDE).flaws
    assert "one instant" in flaw


def test_waypoints_of_one_rounding_unit_are_one():
    problem = Problem([[0.0], [1.0], [1.0 - 2**-52], [2.0]], Limits([1.0], [1.0]))
    motion = bang_bang([0.0, 1.0, 2.0], 1.0, 1.0)
    start, middle, end = motion.waypoint_times
    times = [start, middle, middle, end]
    again = Trajectory(motion.breaks, motion.coefficients, times)
    assert verify(problem, again).certified_duration == pytest.approx(3.0, rel=1e-12)


def least_time_through(points, V: float, A: float) -> float:
    """One joint alone: from rest to rest between the waypoints where it turns."""
    points = np.asarray(points)
    turns = [points[0]]
    for before, here, after in zip(points, points[1:], points[2:], strict=False):
        if (here - before) * (after - here) < 0:
            turns.append(here)
    turns.append(points[-1])
    return sum(least_time(abs(h), V, A) for h in np.diff(turns))


def bang_bang(points, V: float, A: float) -> Trajectory:
    """The fastest motion of one joint through its waypoints, and when it passes them."""
    breaks = [0.0]
    columns = []
    times = [0.0]
    start = points[0]
    for k, (here, after) in enumerate(zip(points[1:], [*points[2:], None], strict=True)):
        turns = after is None or (after - here) * (here - start) < 0
        if not turns:
            continue
        sign = np.sign(here - start)
        distance = abs(here - start)
        peak = min(V, (distance * A) ** 0.5)
        phases = [(peak / A, 0.0, A), (distance / peak - peak / A, peak, 0.0), (peak / A, peak, -A)]
        position = start
        began = len(columns)
        for duration, v, a in phases:
            if duration > 1e-9 * peak / A:
                columns.append([sign * a / 2, sign * v, position])
                breaks.append(breaks[-1] + duration)
                position += sign * (v + a / 2 * duration) * duration
        times += passing(points[len(times) : k + 2], breaks[began:], columns[began:], sign)
        start = here
    times[-1] = breaks[-1]
    coefficients = np.array(columns).T[..., None]
    return Trajectory(breaks, coefficients, np.maximum.accumulate(times))


def passing(points, breaks, columns, sign) -> list[float]:
    """When a monotone motion passes each point: a quadratic's root in the right piece."""
    times = []
    for point in points:
        for (half, v, x), begin, end in zip(columns, breaks, breaks[1:], strict=False):
            reached = x + v * (end - begin) + half * (end - begin) ** 2
            if sign * (reached - point) >= -1e-12:
                break
        c = x - point
        root = (v * v - 4 * half * c) ** 0.5 if v * v > 4 * half * c else 0.0
        slope = v + sign * root
        times.append(begin + (min(-2 * c / slope, end - begin) if slope else end - begin))
    return times


@st.composite
def cheats(draw) -> Trick:
    """The fastest motion, made faster still, cut at random, bent within tolerance and beyond."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    count = int(rng.integers(2, 7))
    h = 10.0 ** rng.uniform(-7, 3)
    V = 10.0 ** rng.uniform(-2, 6)
    A = 10.0 ** rng.uniform(-2, 6)
    signs = rng.choice([-1.0, 1.0], count - 1)
    steps = signs * h * 10.0 ** rng.uniform(-4, 0, count - 1)
    points = rng.choice([0.0, 1.0, 1e3]) * h + np.r_[0.0, np.cumsum(steps)]
    optimum = least_time_through(points, V, A)
    motion = bang_bang(points, V, A)

    inner = np.sort(rng.uniform(0, motion.duration, int(rng.integers(0, 6))))
    slivers = inner[: int(rng.integers(0, 3))] + motion.duration * 10.0 ** rng.uniform(-15, -6)
    motion = motion.refined(np.clip(np.r_[inner, slivers], 0, motion.duration))
    coefficients = np.array(motion.coefficients)
    size = 10.0 ** rng.uniform(-17, -3)
    sizes = np.array([A, (A * h) ** 0.5, h]) * size
    bent = rng.random(coefficients.shape) < rng.choice([0.2, 1.0])
    coefficients += bent * rng.normal(size=coefficients.shape) * sizes[:, None, None]
    times = motion.waypoint_times.copy()
    times[1:-1] += rng.normal(size=count - 2) * motion.duration * size
    times = np.maximum.accumulate(np.clip(times, 0, motion.duration))
    faster = 1 - rng.choice([0.0, 10.0 ** rng.uniform(-12, -1)])
    bent_motion = Trajectory(motion.breaks, coefficients, times).dilated(faster)
    problem = Problem(points[:, None], Limits([V], [A]))
    return Trick("random", "random", problem, bent_motion, optimum)


@settings(deadline=None, derandomize=True, max_examples=250)
@given(cheats())
def test_hypothesis_cannot_cheat_either(trick):
    for tolerance in (Tolerance(), WIDE):
        duration = verify(trick.problem, trick.trajectory, tolerance).certified_duration
        assert duration is None or duration >= trick.optimum * (1 - BELOW)


@settings(deadline=None, derandomize=True, max_examples=100)
@given(cheats())
def test_a_repaired_motion_needs_no_second_repair(trick):
    """Passes every waypoint, rests and does not jump, but for rounding."""
    from trajopt.judging.repair import repaired

    motion = repaired(trick.problem, trick.trajectory)
    if motion is None:
        return
    size = np.abs(trick.problem.waypoints).max()
    speed = np.abs(motion.pieces(1)).sum(axis=0).max()
    misses = motion(motion.waypoint_times) - trick.problem.waypoints
    assert np.abs(misses).max() <= 1e-13 * (size + speed * motion.lengths.max())
    for order, scale in ((0, size), (1, speed)):
        unit = motion.pieces(order)
        jumps = unit[-1, 1:] - unit.sum(axis=0)[:-1]
        terms = np.abs(unit).sum(axis=0).max()
        assert np.abs(jumps).max(initial=0.0) <= 1e-12 * max(scale, terms)
    assert np.abs(motion(0.0, 1)).max() <= 1e-12 * speed
    assert np.abs(motion.pieces(1).sum(axis=0)[-1]).max() <= 1e-12 * speed
