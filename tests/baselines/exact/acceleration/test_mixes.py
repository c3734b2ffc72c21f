"""Mixed demands: optima that another method or a part of a certified motion knows."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.acceleration.planner import Passing
from baselines.exact.method import guesses
from soaks import mixes
from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites.mixes import halves

# Waypoints, tolerance of the second one, velocity and acceleration limits of both segments, the
# velocities at the ends, and the minimum time: IPOPT, every joint in its own pieces of constant
# acceleration, from several starts, and a part of a whole motion that the judge certifies.
KNOWN = {
    "2 % too long from random guesses": (
        [[0.590411, -1.430918], [0.755777, -2.649842], [0.918371, -3.035649]],
        [0.406615, 0.406615],
        [
            [[-0.618687, 0.618687], [-1.186879, 1.186879]],
            [[-0.261159, 0.47416], [-1.541189, 2.732413]],
        ],
        [
            [[-5.753566, 5.753566], [-9.739873, 9.739873]],
            [[-1.7404, 1.7404], [-5.072482, 5.072482]],
        ],
        {"start_velocity": [0.5556589999999998, -1.1868789999999996]},
        1.3585159959058284,
    ),
    "47 % too long from guesses beside a gap": (
        [[0.0, 0.0], [-0.000304, 0.891329], [0.01615523475426914, 0.7040258555729388]],
        [0.001395, 0.257645],
        [
            [[-1.251827, 1.251827], [-0.878515, 0.878515]],
            [[-2.781806, 2.781806], [-1.101129, 1.101129]],
        ],
        [
            [[-6.075368, 6.075368], [-0.875954, 0.875954]],
            [[-7.961336, 7.961336], [-3.052089, 3.052089]],
        ],
        {"end_velocity": [0.18843206907888793, 0.6957909357498033]},
        1.308489420288039,
    ),
}


@pytest.mark.parametrize("case", KNOWN)
def test_an_optimum_that_another_method_knows(case):
    waypoints, tolerance, velocity, acceleration, demands, optimum = KNOWN[case]
    boxes = [np.zeros(2), tolerance, np.zeros(2)]
    limits = Limits(np.array(velocity), np.array(acceleration))
    problem = Problem(waypoints, limits, demands={"tolerance": boxes, **demands})
    motion = Exact().solve(problem).trajectory
    assert verify(problem, motion).certified_duration == pytest.approx(optimum, rel=1e-6)


@pytest.mark.parametrize(
    ("seed", "share"),
    [
        # the last segment of the first part takes 11 ms, next to the edge of a box
        (46, None),
        # guesses in the times of stopping lead to motions 30 and 105 % too long
        (30, 3.6315851360233564),
        (88, 1.2588770581455684),
        # its first part ends with a segment of one single time, by the limits of three joints
        (32684, 1.919045256573567),
        # 24 ms before its end a joint leaves the edge of its box: once 48 % too long
        pytest.param(5590, 4.350779224084628, marks=pytest.mark.long),
    ],
)
def test_a_cut_motion_is_planned_again_as_short(seed, share):
    """`share`: what the second part takes, s; the first one takes 0.565 s where it is None."""
    drawn = mixes.drawn(seed)
    kept = {key: own for key, own in drawn.demands.items() if key not in ("given_times", "dwell")}
    whole = Problem(drawn.waypoints, drawn.limits, demands=kept)
    solution, duration = mixes.solved(whole)
    cut = 0.565 if share is None else duration - share
    parts = halves(whole, solution.trajectory, cut)
    for part, own in zip(parts, (cut, duration - cut), strict=True):
        assert mixes.solved(part)[1] <= own * (1 + 1e-6)


def test_a_guess_passes_the_last_segment_before_a_gap():
    """Joint 1 ends backwards and cannot stop; joint 0 is in time from the edge of its box alone."""
    V, r, w, A = 0.3, 0.3, 0.3, 0.5
    problem = Problem(
        [[0.0, 0.0], [1.0, -0.31], [1.305, -0.02]],
        Limits([V, 0.4], [2.0, A]),
        end_velocity=[V, -w],
        demands={"tolerance": np.array([0, r, 0])[:, None] * np.ones(2)},
    )
    scaled = Passing(problem)
    # even over the 0.01 rad from the edge of its box, joint 1 ends so soon, or comes back (4.6)
    before = (w - np.sqrt(w**2 - 2 * A * 0.01)) / A
    found = []
    for guess in guesses.cruising(scaled):
        time = guess.times[-1] * scaled.unit
        way = (scaled.h[-1] - guess.offset[-1]) * scaled.units[-1]
        found.append(time < before and (np.abs(way) <= np.array([V, w]) * time).all())
    assert any(found)


def test_a_loop_whose_tolerances_overlap_its_end_is_planned():
    """Its box of waypoint 5 holds waypoint 6, the first again: once no problem was made of it."""
    points = np.array([-0.05204787, 0.43142614, -0.31923619, -0.51933366, 0.09636914, -0.05204787])
    tolerance = np.array([0, 0.226, 0.226, 0.226, 0.226, 0])[:, None]
    problem = Problem(
        points[:, None],
        Limits(velocity=[1.0], acceleration=[2.0]),
        demands={"closed": True, "tolerance": tolerance},
    )
    solution = Exact().solve(problem)
    assert solution.trajectory is not None
    # closed form: the way from one side of the boxes to the other and back, turning at both
    way = (0.43142614 - 0.226) - (-0.51933366 + 0.226)
    assert solution.trajectory.duration >= 2 * way / 1.0
    assert verify(problem, solution.trajectory).feasible


def test_a_loop_with_boxes_that_leave_its_merged_waypoints_no_way():
    """Merged, its last waypoint was within the tolerance of the first: once an error."""
    points = np.array([-0.385, 0.204, 1.435, -0.498, 0.286, -0.385])
    tolerance = np.array([0, 0.754, 0.754, 0.754, 0.754, 0])[:, None]
    problem = Problem(
        points[:, None],
        Limits(velocity=[1.0], acceleration=[4.0]),
        demands={"closed": True, "tolerance": tolerance},
    )
    solution = Exact().solve(problem)
    # closed form: out to the box of the third waypoint and back
    way = 1.435 - 0.754 + 0.385
    assert solution.trajectory.duration >= 2 * way / 1.0
    assert verify(problem, solution.trajectory).feasible


def test_one_pair_of_several_neighbours_is_passed_at_one_instant():
    """IPOPT with free pieces finds 2.34135 s; without a problem of each pair it is 0.4 % more."""
    problem = mixes.drawn(20716)
    assert mixes.solved(problem)[1] == pytest.approx(2.34135317641, rel=1e-8)
