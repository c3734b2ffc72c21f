"""States in which no motion begins or ends: proved, in words; and none is refused that has one."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt import Limits, Problem, Status
from trajopt.core.end_states import impossible
from trajopt.planners.registry import load

WALLS = {"position": [[-1.0, 2.0]]}


def problem(limits=None, **demands):
    own = {"velocity": [2.0], "acceleration": [4.0], **(limits or {})}
    return Problem([[0.0], [1.0]], Limits(**own), demands=demands)


@pytest.mark.parametrize(
    ("limits", "demands", "said"),
    [
        (
            {},
            {"start_velocity": [-2.5]},
            "the start velocity of joint 1, -2.5 rad/s, is beyond its",
        ),
        ({}, {"end_velocity": [2.1]}, "limit, 2 rad/s"),
        ({"jerk": [9.0]}, {"end_acceleration": [4.5]}, "beyond its limit, 4 rad/s²"),
        # 1.5 + 3²/(2·6) = 2.25
        (
            {"jerk": [6.0]},
            {"start_velocity": [1.5], "start_acceleration": [3.0]},
            "under its jerk limit to 2.25 rad/s at least",
        ),
        # at the end it has come from 1.5 + 3²/(2·6), where it slows down
        (
            {"jerk": [6.0]},
            {"end_velocity": [1.5], "end_acceleration": [-3.0]},
            "under its jerk limit to 2.25 rad/s at least",
        ),
        # 2²/(2·1.5) = 4/3 rad to stop, the wall is 1 rad away
        (
            {"acceleration": [1.5], **WALLS},
            {"start_velocity": [-2.0]},
            "takes 1.33333 rad to stop, and its position limit is 1 rad away",
        ),
        (
            {"acceleration": [1.5], **WALLS},
            {"end_velocity": [-2.0]},
            "takes 1.33333 rad to reach, and its position limit is 1 rad away",
        ),
    ],
)
def test_what_is_impossible_is_said_with_the_joint(limits, demands, said):
    asked = problem(limits, **demands)
    assert said in impossible(asked)
    solution = load("ruckig-stop").solve(asked)
    assert solution.status is Status.INFEASIBLE
    assert said in solution.message


def test_what_is_possible_is_not_refused():
    """Ends at every limit; a wall that is just far enough."""
    assert impossible(problem(start_velocity=[-2.0], end_velocity=[2.0])) is None
    wall = {"acceleration": [2.0], **WALLS}  # 2²/(2·2) = 1
    assert impossible(problem(wall, start_velocity=[-2.0])) is None
    assert impossible(problem()) is None
    ramp = {"jerk": [6.0]}
    ends = {"start_velocity": [1.25], "start_acceleration": [3.0]}
    assert impossible(problem(ramp, **ends)) is None


@pytest.mark.parametrize("seed", range(5))
def test_the_way_to_stop_is_that_of_the_hardest_braking(seed):
    """A joint that brakes as hard as jerk and acceleration allow, simulated, stops at the wall."""
    rng = np.random.default_rng(seed)
    v, a = rng.uniform(0.2, 1), rng.uniform(-1, 1)
    A, J = rng.uniform(1, 3), rng.uniform(1, 20)
    if v - a**2 / (2 * J) < 0:  # it turns while its acceleration ends
        a = 0.0
    q, speed, bend, step = 0.0, v, a, 1e-4
    while speed > 0:
        q += speed * step
        speed += bend * step
        bend = max(bend - J * step, -A)
    far = Limits([9.0], [A], jerk=[J], position=[[-5.0, q + 1e-3]])
    near = Limits([9.0], [A], jerk=[J], position=[[-5.0, q - 1e-3]])
    ends = {"start_velocity": [v], "start_acceleration": [a]}
    assert impossible(Problem([[0.0], [-1.0]], far, demands=ends)) is None
    assert "to stop" in impossible(Problem([[0.0], [-1.0]], near, demands=ends))


def test_a_place_counts_as_known_to_its_rounding():
    """The way in which it stops, V²/2A = 2e3 rad, is known to less than its place, 1e-3 rad, is."""
    V, A = 1e3, 250.0
    way = V**2 / (2 * A)
    limits = Limits([V], [A], position=[[-1.0, way]])
    for beyond, is_possible in ((1e-13, True), (1e-9, False)):
        start = way * beyond
        problem = Problem([[start], [1.0]], limits, start_velocity=[V])
        assert (impossible(problem) is None) is is_possible
