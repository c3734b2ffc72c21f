"""No trick is ever certified below the optimum: what is judged is the exact repair.

The theorem is of all trajectories, so tolerances may be as wide as one likes: everything is then
repaired, and the repair is a motion that keeps the problem.
"""

from __future__ import annotations

import warnings
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from soaks import soak_report
from soaks import tricks as families
from soaks.tricks import Trick, least_time, rest_to_rest, tricks
from trajopt.benchmark.trial import verdict
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.solution import Solution, Status
from trajopt.core.trajectory import Trajectory
from trajopt.judging.certificate import Tolerance
from trajopt.judging.repair import repaired
from trajopt.judging.verification import certified, verify

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


# One for each mechanism and its limits; `python tests/soak.py tricks` tries every one, also those
# whose waypoints take seconds to find.
EACH_KIND = {
    (trick.family, trick.limits): trick for trick in TRICKS.values() if trick.problem.segments < 50
}


@pytest.mark.parametrize("trick", EACH_KIND.values(), ids=lambda trick: trick.name)
def test_no_door_lets_a_trick_in(trick):
    row = families.judged(trick)
    assert row["certified %"] >= -100 * BELOW


@pytest.mark.parametrize("trick", TRICKS.values(), ids=TRICKS)
def test_every_trick_claims_less_than_the_optimum(trick):
    assert trick.trajectory.duration < trick.optimum


@pytest.mark.parametrize("tolerance", [Tolerance(), WIDE], ids=["default", "wide"])
@pytest.mark.parametrize("trick", TRICKS.values(), ids=TRICKS)
def test_no_trick_is_certified_below_the_optimum(trick, tolerance):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        certificate = verify(trick.problem, trick.trajectory, tolerance)
    duration = certificate.certified_duration
    assert duration is None or duration >= trick.optimum * (1 - BELOW)
    if duration is None:
        assert certificate.flaws


@pytest.mark.parametrize("trick", TRICKS.values(), ids=TRICKS)
def test_the_certified_trajectory_keeps_the_problem(trick):
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
    solution = Solution(Status.SOLVED, trick.trajectory)
    status, message, _ = verdict(trick.problem, solution)
    assert status is Status.INVALID
    assert message


def test_two_waypoints_at_one_instant_are_told():
    waypoints = [[0.0], [1.0], [1.0 - 1e-12], [2.0]]
    problem = Problem(waypoints, Limits([1.0], [1.0]))
    columns = [[[0.5], [0.5]], [[0.0], [1.0]]]
    line = Trajectory([0.0, 2.0, 4.0], columns, [0.0, 2.0, 2.0, 4.0])
    (flaw, *_) = verify(problem, line, WIDE).flaws
    assert "one instant" in flaw


def test_waypoints_of_one_rounding_unit_are_one():
    waypoints = [[0.0], [1.0], [1.0 - 2**-52], [2.0]]
    problem = Problem(waypoints, Limits([1.0], [1.0]))
    motion = rest_to_rest(2.0, 1.0, 1.0)
    middle = motion.duration / 2
    times = [0.0, middle, middle, motion.duration]
    again = replace(motion, waypoint_times=np.array(times))
    certificate = verify(problem, again)
    assert certificate.certified_duration == pytest.approx(3.0, rel=1e-12)


def turning_points(points):
    """One joint alone rests at its ends and where it turns; their indices."""
    signs = np.sign(np.diff(points))
    is_turn = signs[1:] != signs[:-1]
    (inner,) = np.nonzero(is_turn)
    last = len(points) - 1
    return [0, *(inner + 1), last]


def fastest(points, V, A):
    """The fastest motion of one joint through its waypoints, and when it passes them."""
    breaks = [np.zeros(1)]
    pieces = []
    times = np.zeros(len(points))
    began = 0.0
    for here, there in pairwise(turning_points(points)):
        start = points[here]
        way = points[there] - start
        size = abs(way)
        move = rest_to_rest(size, V, A)
        forwards = move.coefficients[..., 0]
        coefficients = np.sign(way) * forwards
        coefficients[-1] += start
        pieces.append(coefficients)
        breaks.append(began + move.breaks[1:])
        for k in range(here + 1, there):
            covered = abs(points[k] - start)
            passed = time_at(covered, size, V, A)
            times[k] = began + passed
        began += move.duration
        times[there] = began
    joined = np.concatenate(pieces, axis=1)
    all_breaks = np.concatenate(breaks)
    return Trajectory(all_breaks, joined[..., None], times)


def time_at(x, h, V, A):
    """When a move from rest to rest over `h` is at `x`, s."""
    duration = least_time(h, V, A)
    if x > h / 2:
        return duration - time_at(h - x, h, V, A)
    peak = min(V, (h * A) ** 0.5)
    rise = peak / A
    risen = peak * rise / 2
    if x <= risen:
        return (2 * x / A) ** 0.5
    return rise + (x - risen) / peak


@st.composite
def cheats(draw):
    """The fastest motion, made faster still, cut at random, bent within tolerance and beyond."""
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    h = 10.0 ** rng.uniform(-7, 3)
    V = 10.0 ** rng.uniform(-2, 6)
    A = 10.0 ** rng.uniform(-2, 6)
    signs = rng.choice([-1.0, 1.0], count - 1)
    exponents = rng.uniform(-4, 0, count - 1)
    steps = signs * h * 10.0**exponents
    start = rng.choice([0.0, 1.0, 1e3]) * h
    ways = np.cumsum(steps)
    points = np.concatenate([[start], start + ways])
    motion = fastest(points, V, A)
    optimum = motion.duration

    cut_count = rng.integers(0, 6)
    cuts = rng.uniform(0, optimum, cut_count)
    gap = 10.0 ** rng.uniform(-15, -6)
    close = cuts[:2] + optimum * gap
    inside = np.clip([*cuts, *close], 0, optimum)
    motion = motion.refined(inside)
    size = 10.0 ** rng.uniform(-17, -3)
    of_powers = [0.0, A, (A * h) ** 0.5, h]
    sizes = size * np.array(of_powers)[:, None, None]
    shape = motion.coefficients.shape
    share = rng.choice([0.2, 1.0])
    is_bent = rng.random(shape) < share
    noise = sizes * rng.normal(size=shape)
    bent = motion.coefficients + is_bent * noise

    times = motion.waypoint_times.copy()
    moved = rng.normal(size=count - 2)
    times[1:-1] += moved * optimum * size
    within = np.clip(times, 0, optimum)
    ordered = np.maximum.accumulate(within)
    small = 10.0 ** rng.uniform(-12, -1)
    gain = rng.choice([0.0, small])
    slow = Trajectory(motion.breaks, bent, ordered)
    cheat = slow.dilated(1 - gain)
    limits = Limits([V], [A])
    problem = Problem(points[:, None], limits)
    return Trick("random", "random", problem, cheat, optimum)


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
    motion = repaired(trick.problem, trick.trajectory)
    if motion is None:
        return
    waypoints = trick.problem.waypoints
    size = np.abs(waypoints).max()
    slopes = motion.pieces(1)
    speed = np.abs(slopes).sum(axis=0).max()
    misses = motion(motion.waypoint_times) - waypoints
    longest = motion.lengths.max()
    scale = size + speed * longest
    assert np.abs(misses).max() <= 1e-13 * scale
    for order, scale in ((0, size), (1, speed)):
        unit = motion.pieces(order)
        begins = unit[-1]
        ends = unit.sum(axis=0)
        jumps = begins[1:] - ends[:-1]
        terms = np.abs(unit).sum(axis=0).max()
        largest = np.abs(jumps).max(initial=0.0)
        assert largest <= 1e-12 * max(scale, terms)
    ends = slopes.sum(axis=0)
    for velocity in (motion(0.0, 1), ends[-1]):
        assert np.abs(velocity).max() <= 1e-12 * speed


def test_what_is_printed_fits_a_terminal(tmp_path, capsys):
    tried = []
    for trick in TRICKS.values():
        row = {"family": trick.family, "trick": trick.name}
        tried.append(row)
    rows = pd.DataFrame(tried)
    first, *_ = rows["family"]
    soak_report.conclude(rows, rows["family"] == "", tmp_path / "tricks")
    with pytest.raises(SystemExit):
        soak_report.conclude(rows, rows["family"] == first, tmp_path / "tricks")
    printed = capsys.readouterr().out.splitlines()
    assert printed[0] == "tried won family"
    tables = printed[: 2 * rows["family"].nunique()]
    assert max(map(len, tables)) <= 80
