"""The interior-point method of both exact planners: closed forms, differences, and IPOPT."""

from __future__ import annotations

from itertools import islice
from typing import Any

import numpy as np
import pytest

from baselines.exact.acceleration.cells import AccelerationTables
from baselines.exact.acceleration.newton_step import AccelerationInequalities
from baselines.exact.acceleration.planner import Exact, Passing, starting_points
from baselines.exact.jerk.cells import JerkInequalities, JerkTables, JerkUnknowns
from baselines.exact.method import crossover, interior_point
from baselines.exact.method.scaled import Abreast, Scaled
from trajopt import Limits, Problem
from trajopt.benchmark.suites import families
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem


def duration(problem: Problem) -> float:
    """The optimum from the first start, s, without crossover."""
    scaled = Passing(problem)
    cells = AccelerationTables(Abreast([scaled]))
    ((times, velocities, _),) = starting_points(scaled, 1)
    point = cells.start(times[None], velocities[None], 0 * velocities[None])
    iterate = interior_point.begun(AccelerationInequalities(cells, point))
    iterate = interior_point.descended(iterate, interior_point.converged)
    assert interior_point.converged(iterate)
    return scaled.unit * float(iterate.state.duration[0])


def by_ipopt(problem: Problem) -> float:
    """IPOPT's optimum, s."""
    stats = Exact(starts=1, solver="ipopt").solve(problem).stats
    assert stats["start_status"] == ["Solve_Succeeded"]
    return float(stats["start_duration"][0])


@pytest.mark.parametrize("length", [1e-9, 1e-3, 1.0, 1e4])
def test_one_way_in_one_joint(length: float) -> None:
    problem = Problem([[0.0], [length]], Limits([1.0], [2.0]))
    cruising = length / 1.0 + 1.0 / 2.0  # h/V + V/A
    triangle = 2 * np.sqrt(length / 2.0)  # 2 √(h/A)
    expected = cruising if length > 0.5 else triangle  # where the peak √(h A) is 1
    assert duration(problem) == pytest.approx(expected, rel=1e-11)


def test_waypoints_on_a_monotone_path_cost_nothing() -> None:
    path = np.cumsum([0, 0.3, 0.4, 1.2, 0.05, 0.9])
    problem = Problem(path[:, None], Limits([[-0.3, 0.8]], [[-1.0, 3.0]]))
    # speed up at 3, cruise at 0.8, brake at 1: h/V + V/2 (1/3 + 1/1)
    expected = path[-1] / 0.8 + 0.8 / 2 * (1 / 3 + 1)
    assert duration(problem) == pytest.approx(expected, rel=1e-11)


@pytest.mark.parametrize("name", ["six-axis", "asymmetric", "seven-waypoints", "resting-joint"])
def test_ipopt_finds_the_same_optimum(name: str) -> None:
    problem = load(name)
    assert duration(problem) == pytest.approx(by_ipopt(problem), rel=1e-9)


@pytest.mark.parametrize("seed", range(40, 55))
def test_ipopt_finds_the_same_optimum_of_random_ones(seed: int) -> None:
    problem = random_problem(seed, jerk=False)
    assert duration(problem) == pytest.approx(by_ipopt(problem), rel=1e-9)


_OFFSET = 0.01  # of waypoints within a tolerance


def drawn(segments: int, joints: int, **demands: Any) -> Problem:
    """A random problem with asymmetric limits, jerk limits among them."""
    rng = np.random.default_rng(segments)
    steps = rng.uniform(-1, 1, (segments + 1, joints))
    sides = rng.uniform(0.5, 2.0, (3, joints, 2)) * [-1, 1]
    velocity, acceleration, jerk = sides
    limits = Limits(velocity, acceleration, 4 * jerk)
    return Problem(np.cumsum(steps, axis=0), limits, **demands)


def asked(segments: int, joints: int, demanding: bool) -> dict[str, Any]:
    """A tolerance and least times, or nothing."""
    return {"tolerance": [0.1] * joints, "least_times": [0.1] * segments} if demanding else {}


def started(problem: Problem) -> AccelerationInequalities:
    """The program without jerk limits near two starts."""
    rng = np.random.default_rng(0)
    scaled = Passing(problem)
    ((times, velocities, _),) = starting_points(scaled, 1)
    moved = velocities + rng.uniform(-0.1, 0.1, (2, *velocities.shape))
    cells = AccelerationTables(Abreast([scaled] * 2))
    return AccelerationInequalities(
        cells, cells.start(np.stack([times, 0.9 * times]), moved, 0 * moved + _OFFSET)
    )


def started_under_jerk(problem: Problem) -> JerkInequalities:
    """The program with jerk limits near two starts."""
    rng = np.random.default_rng(0)
    scaled = Scaled(problem)
    segments, joints = scaled.h.shape
    states = rng.uniform(-0.1, 0.1, (2, 2, segments - 1, joints))
    times = np.stack([1.5 * scaled.stop, 2 * scaled.stop])
    cells = JerkTables(scaled, kinds=2)
    point = cells.linked(times, *states)
    return JerkInequalities(cells, point._replace(offset=point.offset + _OFFSET))


@pytest.mark.parametrize("start", [started, started_under_jerk])
@pytest.mark.parametrize("joints", [1, 3])
@pytest.mark.parametrize("segments", [1, 2, 5])
@pytest.mark.parametrize("demanding", [False, True])
def test_a_step_changes_rows_as_differences_say(
    start, segments: int, joints: int, demanding: bool
) -> None:
    """Rows are differentiated by hand: along a step they change as they do in small."""
    rows = start(drawn(segments, joints, **asked(segments, joints, demanding)))
    rng = np.random.default_rng(1)
    multipliers = rng.uniform(0.1, 1.0, rows.values.shape)
    with np.errstate(all="ignore"):
        step, change = rows.linear(multipliers, multipliers).step(multipliers)
        size = 1e-6 / max(1.0, np.abs(step.log).max())
        values = []
        for length in (size, -size):
            point = interior_point.moved(rows.point, step, np.full(2, length))
            values.append(type(rows)(rows.cells, point).values)
        ahead, behind = values
    differences = (ahead - behind) / (2 * size)
    np.testing.assert_allclose(change, differences, atol=1e-5 * np.abs(change).max())


@pytest.mark.parametrize("segments", [1, 2, 5])
@pytest.mark.parametrize("demanding", [False, True])
def test_a_step_bends_rows_as_second_differences_say(segments: int, demanding: bool) -> None:
    rows = started_under_jerk(drawn(segments, 3, **asked(segments, 3, demanding)))
    rng = np.random.default_rng(1)
    multipliers = rng.uniform(0.1, 1.0, rows.values.shape)
    with np.errstate(all="ignore"):
        linear = rows.linear(multipliers, multipliers)
        step, _ = linear.step(multipliers)
        size = 1e-4 / max(1.0, np.abs(step.log).max())
        ahead, behind = (rows.after(step, np.full(2, length)).values for length in (size, -size))
        bending = linear.bending(step)
    differences = (ahead - 2 * rows.values + behind) / (2 * size**2)
    np.testing.assert_allclose(bending, differences, atol=1e-3 * np.abs(bending).max())


@pytest.mark.parametrize("segments", [1, 2, 5])
def test_the_matrix_is_how_the_lagrangian_bends(segments: int) -> None:
    """Along a line in its unknowns: 1/T, accelerations and the ends in briefer segments."""
    rng = np.random.default_rng(2)
    scaled = Scaled(drawn(segments, 3))
    times = scaled.stop * rng.uniform(1.5, 3.0, segments)
    states = rng.uniform(-0.1, 0.1, (2, 1, segments - 1, 3))
    cells = JerkTables(scaled, kinds=2)
    start = JerkInequalities(cells, cells.linked(times[None], *states))
    multipliers = rng.uniform(0.1, 1.0, start.values.shape)
    with np.errstate(all="ignore"):
        (band,) = start.linear(multipliers, 0 * multipliers).chain.bands()
    line = rng.uniform(-1.0, 1.0, len(band))
    lagrangians = []
    for length in (-1e-4, 0.0, 1e-4):
        rows = JerkInequalities(cells, along(start.point, cells, length * line))
        pressed = multipliers * rows.values
        lagrangians.append(rows.times.sum() - pressed.sum())
    before, here, after = lagrangians
    difference = (before - 2 * here + after) / 1e-4**2
    assert twice(band, line) == pytest.approx(difference, rel=1e-5)


def along(point: JerkUnknowns, cells: JerkTables, step: np.ndarray) -> JerkUnknowns:
    """The point after a step of the unknowns, every link met."""
    (log,) = point.log
    (acceleration,) = point.acceleration
    start, end = point.ends[:, 0]
    last = np.append(step, np.zeros(6)).reshape(len(log), 7)
    times = np.exp(log) / (1 - last[:, 0])
    velocities = []
    accelerations = []
    for k, before in enumerate(acceleration):
        of_velocity, of_acceleration = last[k, 1:].reshape(3, 2).T
        brief = k if log[k] < log[k + 1] else k + 1
        own = end[k] if brief == k else start[k + 1]
        t = times[brief]
        velocities.append(cells.h[0, brief] / t + t * (own + of_velocity))
        accelerations.append(before + of_acceleration)
    states = np.reshape([velocities, accelerations], (2, 1, -1, 3))
    return cells.linked(times[None], *states)


def twice(band: np.ndarray, line: np.ndarray) -> float:
    """A quadratic form of a matrix whose lower band is given, a row per unknown."""
    total = 0.0
    for column, entries in enumerate(band):
        below = line[column : column + len(entries)]
        products = entries[: len(below)] * below * line[column]
        total += 2 * products.sum() - products[0]
    return total


def test_families_of_extremes_converge() -> None:
    """Segments of 1e-9 rad to 15 000 rad and limits a million to one apart, most of them."""
    problems = []
    for family in ("tiny", "huge", "unequal"):
        problems += islice(families.stream(family), 6)
    converged = [Exact(starts=1).solve(problem).stats["start_status"] for problem in problems]
    assert converged.count(["Converged"]) >= 0.9 * len(problems)


def test_the_worked_example_of_crossover() -> None:
    """docs/implementation-notes.md: which inequality keeps what in a step, and what is left."""
    problem = Problem([[0.0], [1.0], [2.0]], Limits([5.0], [1.0]))
    scaled = Passing(problem)
    tables = AccelerationTables(Abreast([scaled]))
    ((times, velocities, _),) = starting_points(scaled, 1)
    start = AccelerationInequalities(
        tables, tables.start(times[None], velocities[None], 0 * velocities[None])
    )
    iterate = interior_point.descended(interior_point.begun(start), crossover.ATTEMPTS[0])
    slacks = iterate.state.slacks / iterate.before.slacks
    multipliers = iterate.state.multipliers / iterate.before.multipliers
    velocity, reach = 0, 1
    np.testing.assert_allclose(slacks[velocity], 1.0, atol=2e-3)
    np.testing.assert_allclose(multipliers[velocity], 0.25, atol=2e-3)
    upper, lower = 0, 1
    np.testing.assert_allclose(slacks[reach, upper], 0.25, atol=2e-3)
    np.testing.assert_allclose(multipliers[reach, upper], 1.0, atol=2e-3)
    np.testing.assert_allclose(slacks[reach, lower], 0.5, atol=2e-3)
    np.testing.assert_allclose(multipliers[reach, lower], 0.5, atol=2e-3)
    assert scaled.unit * iterate.state.duration.item() - 2 * np.sqrt(2) > 1e-8
    crossed, optimal = crossover._crossed(iterate)
    assert optimal.all()
    assert scaled.unit * crossed.times.sum() == pytest.approx(2 * np.sqrt(2), abs=1e-14)
