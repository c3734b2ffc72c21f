"""Which limits bind, when, and what they are worth, against closed forms."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.ruckig_ import RuckigStop
from trajopt import Limits, Problem, Trajectory
from trajopt.benchmark.suites.random import random_problem
from trajopt.explain.active_limits import (
    ActiveLimit,
    active_limits,
    relaxed,
    scattered,
    share_at_limits,
    stretches,
)
from trajopt.planners.rest_to_rest import stop_times


def bang(h: float = 1.0, a: float = 4.0) -> Trajectory:
    """Accelerate at `a` to the middle, brake at `a`: the fastest motion without velocity limit."""
    t = np.sqrt(h / a)
    pieces = np.array([[a / 2, -a / 2], [0.0, a * t], [0.0, h / 2]])[:, :, None]
    return Trajectory([0.0, t, 2 * t], pieces, [0.0, 2 * t])


def problem(v: float = 10.0, a: float = 4.0, **more: object) -> Problem:
    return Problem([[0.0], [1.0]], Limits([v], [a], **more))


def test_bang_bang_is_at_its_acceleration_limit_all_the_time() -> None:
    assert list(stretches(problem(), bang())) == [(0, "acceleration", 0.0, pytest.approx(1.0))]
    assert share_at_limits(problem(), bang()) == pytest.approx(1.0, abs=1e-12)


def test_the_stretch_near_the_velocity_peak_has_a_closed_form() -> None:
    # v = 4 t up to 2 at t = 0.5: above 0.99 · 2 for |t - 0.5| <= 0.005.
    found = list(stretches(problem(v=2.0, a=100.0), bang()))
    assert found == [
        (0, "velocity", pytest.approx(0.495, abs=1e-9), pytest.approx(0.505, abs=1e-9))
    ]
    assert share_at_limits(problem(v=2.0, a=100.0), bang()) == pytest.approx(0.01, rel=1e-6)


def test_lower_limits_count_too() -> None:
    down = Trajectory(bang().breaks, -bang().coefficients, bang().waypoint_times)
    mirrored = Problem([[0.0], [-1.0]], Limits([[-2.0, 50.0]], [100.0]))
    assert [row[:2] for row in stretches(mirrored, down)] == [(0, "velocity")]


def test_a_position_limit_counts_by_its_range() -> None:
    # q >= 0.99 of [0, 1] while 2 (1 - t)² <= 0.01: the last sqrt(0.005) s; alike at the start.
    near = float(np.sqrt(0.005))
    found = [r for r in stretches(problem(position=[[0.0, 1.0]]), bang()) if r[1] == "position"]
    spans = [pytest.approx((0.0, near)), pytest.approx((1.0 - near, 1.0))]
    assert [row[2:] for row in found] == spans


def test_infinite_limits_and_resting_joints_never_bind() -> None:
    still = np.concatenate([bang().coefficients, 0 * bang().coefficients], axis=2)
    two = Trajectory(bang().breaks, still, bang().waypoint_times)
    limits = Limits([10.0, 1.0], [4.0, 1.0], [np.inf, 1.0])
    found = list(stretches(Problem([[0.0, 0.0], [1.0, 0.0]], limits), two))
    assert [row[:2] for row in found] == [(0, "acceleration")]


def test_short_interruptions_are_passed_over() -> None:
    # Twelve strokes, each at the limit, with pauses of half a percent of the whole between them.
    spans = [0.1, 0.005] * 9 + [0.1]
    breaks = np.r_[0.0, np.cumsum(spans)]
    accelerations = np.array([4.0 if i % 2 == 0 else 0.0 for i in range(len(spans))])
    coefficients = np.zeros((3, len(spans), 1))
    coefficients[0, :, 0] = accelerations / 2
    jerky = Trajectory(breaks, coefficients, breaks[[0, -1]])
    assert len(list(stretches(problem(), jerky))) == 1
    assert len(list(stretches(problem(), jerky, joined=0.0))) == 10
    assert share_at_limits(problem(), jerky) == pytest.approx(1 / breaks[-1], rel=1e-9)


@pytest.mark.parametrize(("limit", "power"), [("velocity", 0.0), ("acceleration", -0.5)])
def test_one_percent_is_worth_what_the_closed_form_says(limit: str, power: float) -> None:
    # Acceleration limited rest to rest: T = 2 sqrt(h / A), whatever the velocity limit.
    (row,) = active_limits(problem(), bang(), RuckigStop())
    assert row.limit == "acceleration"
    assert row.saving == pytest.approx(1 - 1.01**-0.5, rel=1e-9)
    assert relaxed(problem(), 0, limit).digest() != problem().digest()
    assert stop_times(relaxed(problem(), 0, limit))[0] == pytest.approx(1.01**power, rel=1e-12)


def test_without_a_solver_the_trajectory_is_dilated() -> None:
    (row,) = active_limits(problem(), bang(), None)
    assert row.saving == pytest.approx(1 - 1.01**-0.5, rel=1e-9)


def test_a_motion_that_cannot_be_dilated_has_no_known_saving() -> None:
    moving = Problem([[0.0], [1.0]], Limits([9.0], [4.0]), demands={"start_velocity": [0.5]})
    motion = Exact().solve(moving).trajectory
    assert motion is not None
    assert {row.saving for row in active_limits(moving, motion, None)} == {None}


@pytest.mark.parametrize("seed", range(100, 106))
def test_savings_of_an_optimum_add_up_to_what_scaling_all_limits_saves(seed: int) -> None:
    # T is homogeneous: V dT/dV + 2 A dT/dA = -T, summed over joints (Euler).
    hard = random_problem(seed, joints=3, waypoints=4)
    optimum = Exact(8).solve(hard).trajectory
    assert optimum is not None
    active = active_limits(hard, optimum, Exact(8))
    savings = {(b.joint, b.limit): b.saving for b in active}
    factor = {"velocity": 1.0, "acceleration": 2.0}
    total = sum(factor[limit] * (worth or 0.0) for (_, limit), worth in savings.items())
    assert total == pytest.approx(0.01 * optimum.duration, rel=0.1)
    assert not scattered(active, optimum.duration)


def test_a_worth_that_no_optimum_has_is_noticed() -> None:
    for worth, lucky in (
        (0.0, False),
        (0.0049, False),
        (0.006, True),
        (-0.001, True),
        (None, False),
    ):
        assert scattered((ActiveLimit(0, "acceleration", 0.0, 1.0, worth),), 1.0) is lucky


def test_a_solver_without_an_answer_leaves_the_worth_open() -> None:
    class Silent(RuckigStop):
        def solve(self, problem: Problem, *, seed: int = 0):  # type: ignore[no-untyped-def]
            found = super().solve(problem, seed=seed)
            return type(found)(found.status)

    assert [b.saving for b in active_limits(problem(), bang(), Silent())] == [None]


def test_those_worth_most_come_first() -> None:
    hard = random_problem(101, joints=3, waypoints=4)
    optimum = Exact(8).solve(hard).trajectory
    assert optimum is not None
    found = active_limits(hard, optimum, Exact(8))
    assert len(found) > 1
    for a, b in itertools.pairwise(found):
        assert (a.saving or 0.0) >= (b.saving or 0.0)


def test_a_limit_that_opens_a_time_before_a_gap_saves_much_and_that_is_no_luck() -> None:
    """It stops 5 mrad too far and comes back; with 1 % more it brakes before."""
    v, A = 2.005, 2.0
    problem = Problem([[0.0], [1.0]], Limits([9.0], [A]), demands={"start_velocity": [v]})
    motion = Exact().solve(problem).trajectory
    assert motion is not None
    active = active_limits(problem, motion, Exact())
    later = v / A + 2 * np.sqrt((v**2 / (2 * A) - 1) / A)
    more = 1.01 * A
    sooner = (2 * np.sqrt(more + v**2 / 2) - v) / more
    assert [row.saving for row in active] == pytest.approx([later - sooner] * len(active))
    assert scattered(active, motion.duration)
    assert not scattered(active, motion.duration, dilatable=problem.route.dilatable)
