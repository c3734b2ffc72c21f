"""`exact` between states in motion: closed forms, Ruckig, another transcription, and relations."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.exact.acceleration import Exact
from baselines.exact.acceleration.gaps import starts
from baselines.exact.acceleration.planner import Passing
from soaks.moving_ends import drawn, halves, optimum
from trajopt import Limits, Problem, Status, verify

PASSED = [[0.0, 0.0], [-2.689449, 1.636343], [-2.051154, 1.344296], [-2.363103, 1.648131]]


def solved(problem):
    solution = Exact().solve(problem)
    assert solution.status is Status.SOLVED
    certificate = verify(problem, solution.trajectory)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(solution.trajectory.duration, rel=1e-9)
    return solution.trajectory


def one_joint(h, v0, limits=(100.0, 1.0)):
    V, A = limits
    return Problem([[0.0], [h]], Limits([V], [A]), start_velocity=[v0])


@pytest.mark.parametrize(
    ("problem", "duration"),
    [
        # p = √(A h + v0²/2), T = (2 p − v0)/A
        (one_joint(1.0, 0.5), 2 * np.sqrt(1.125) - 0.5),
        (one_joint(1.0, -0.5), 2 * np.sqrt(1.125) + 0.5),
        # it overshoots to 0.5 and returns: T = v0/A + 2 √(0.3/A)
        (one_joint(0.2, 1.0, (2.0, 1.0)), 1 + 2 * np.sqrt(0.3)),
        # IPOPT, every joint with its own pieces of constant acceleration
        (
            Problem(
                PASSED,
                Limits([2.131962, 1.245757], [7.768735, 7.438951]),
                start_velocity=[0.40554, 0.44078],
                end_velocity=[0.04523, 0.568381],
            ),
            2.573584644814449,
        ),
        # it begins at its velocity limit
        (one_joint(3.0, 1.0, (1.0, 2.0)), 3.0 + 0.25),
    ],
)
def test_known_optima(problem, duration):
    assert solved(problem).duration == pytest.approx(duration, rel=1e-9)


@pytest.mark.parametrize("seed", [*range(0, 20, 2), 234])
def test_two_waypoints_are_ruckigs(seed):
    """In 234 all joints pass together before 1.03 s, or after 4.37 s."""
    problem = drawn(seed, jerk=False)
    assert solved(problem).duration == pytest.approx(optimum(problem).duration, rel=1e-9)


@pytest.mark.parametrize("seed", [*range(4), 8, 20])
def test_a_solved_problem_cut_in_two_and_time_reversed(seed):
    """In 8 and 20 the first part is possible, before a gap, in one single time."""
    problem = drawn(seed, waypoints=4, joints=None if seed > 4 else 2, jerk=False)
    motion = solved(problem)
    parts_take_as_long(problem, motion, motion.waypoint_times[1])
    route = problem.route.reversed()
    backwards = Problem(route.waypoints, problem.limits, demands=route.demands)
    assert solved(backwards).duration == pytest.approx(motion.duration, rel=1e-9)


def parts_take_as_long(problem, motion, cut):
    """Solve both parts of a motion that is cut at a time, in its state there."""
    for part, own in zip(halves(problem, motion, cut), (cut, motion.duration - cut), strict=True):
        assert solved(part).duration == pytest.approx(own, rel=1e-9)


@pytest.mark.parametrize(
    ("seed", "waypoints", "cut"),
    [
        # the motion needs a limit whole: without its briefest piece it used 5e-11 too much
        (1286, 5, 1),
        (2008, 3, 1.1535015850647599),
        # one joint brakes and another one speeds up throughout the first segment, or the last one
        (1612, 5, 1),
        (2041, 4, 1.2015616640065578),
        # two such segments follow each other
        (2019, 6, 0.7201920019346588),
        # the gap after the only time is so narrow that a descent crosses it
        (2026, 5, 2.7622158182705934),
        # no segment has an interval without a gap after it
        (2094, 5, 2),
        # the only time stands between two gaps
        (2139, 6, 1.1414813883598207),
        # two segments after another that only limits wider at first lead to
        (2094, 5, 2.888803778491184),
        # after the first segment the only joint cannot stop in the last one either
        (2162, 5, 2),
        # from limits that are wider the linear programs come near by a quarter at a time
        (2345, 4, 1.5382818066298352),
        # one segment so brief that the rounding of its waypoints uses 8e-13 of a limit
        (2033, 4, 1.6733827372107732),
        # two joints' breaks are 2e-15 s apart: no acceleration over it corrects the motion
        (2070, 3, 1.8326660889399968),
        # one segment of one piece, whose break of 2e-14 s cannot be removed
        (2091, 6, 1.5827023439737382),
    ],
)
def test_a_cut_motion_that_is_possible_at_single_instants(seed, waypoints, cut):
    """Cut at a waypoint, or at a time within a segment, s."""
    problem = drawn(seed, waypoints=waypoints, jerk=False)
    motion = solved(problem)
    at_waypoint = isinstance(cut, int)
    parts_take_as_long(problem, motion, motion.waypoint_times[cut] if at_waypoint else cut)


def test_the_only_time_ends_at_the_next_segments_velocity_limit():
    """Joint 1 brakes throughout the first segment to 0.437 rad/s; once 31 % too long."""
    waypoints = [
        [0.05789116925482042, 1.0844120590816129],
        [0.166670085434923, 1.0529501357251383],
        [0.1938671291381097, 0.9649225963440551],
        [0.30671689749422815, 1.2011306779069753],
    ]
    velocity = [
        [1.0091961681938613, 0.9665001175773835],
        [0.436629968707757, 1.9378747831732919],
        [0.6758269630257192, 2.7947548905402906],
    ]
    acceleration = [
        [3.6178241480415347, 2.5554445174856326],
        [6.571208430145692, 7.479425269496057],
        [2.6415007071077112, 3.7019128668488297],
    ]
    limits = (np.multiply.outer(np.array(own), [-1, 1]) for own in (velocity, acceleration))
    problem = Problem(
        waypoints,
        Limits(*limits),
        start_velocity=[0.9888031700404573, -0.011124340767554794],
        end_velocity=[0.05852393505032951, 1.4390652045118362],
    )
    motion = solved(problem)
    # what the part of a certified motion takes from there
    assert motion.duration == pytest.approx(0.81881528078642, rel=1e-9)
    brakes = (0.9888031700404573 - 0.436629968707757) / 3.6178241480415347
    assert motion.waypoint_times[1] == pytest.approx(brakes, rel=1e-9)


def test_starts_stand_on_both_sides_of_every_gap():
    """Two joints that cannot stop, of 0.2 and 0.21 rad: before and after both gaps."""
    problem = Problem(
        [[0.0, 0.0], [0.2, 0.21], [1.0, 1.0]],
        Limits([2.0, 2.0], [1.0, 1.0]),
        start_velocity=[1.0, 1.0],
    )
    scaled = Passing(problem)
    times = sorted(own[0] * scaled.unit for own, _ in starts(scaled))
    gaps = [1 + np.array([-1, 1]) * np.sqrt(1 - 2 * h) for h in (0.2, 0.21)]
    assert len(times) >= 2  # the gaps overlap: 0.225–1.775 s and 0.238–1.762 s
    assert all(t < gaps[0][0] for t in times[:-1])
    assert times[-1] > gaps[0][1]
    assert solved(problem).waypoint_times[1] < gaps[0][0]


def test_a_start_that_cannot_stop_before_two_waypoints():
    """It brakes all the way, passes both, and comes back from `x = v0²/(2A)` to the second."""
    A, v0, first, second = 3.0624145, 1.525898544, 0.341971395, 0.372759886
    problem = Problem([[0.0], [-first], [-second]], Limits([1.8188604], [A]), start_velocity=[-v0])
    back = v0**2 / (2 * A) - second
    assert solved(problem).duration == pytest.approx(v0 / A + 2 * np.sqrt(back / A), rel=1e-9)


def test_a_start_that_cannot_be_kept_is_infeasible():
    solution = Exact().solve(one_joint(1.0, -1.01, (1.0, 1.0)))
    assert solution.status is Status.INFEASIBLE
    assert solution.message == (
        "the start velocity of joint 1, -1.01 rad/s, is beyond its limit, -1 rad/s: it brakes to it"
        " in 0.01 s and 0.01005 rad at least; `trajopt plan --brake-first` does that, and plans "
        "from there"
    )
