"""`exact-jerk` between states in motion, accelerations too: Ruckig, IPOPT's value, relations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import trajopt
from baselines.exact.jerk import ExactJerk
from baselines.lower_bound.planner import Prove
from baselines.ruckig_ import RuckigStop
from soaks import mixes
from soaks.moving_ends import drawn, optimum
from trajopt import Limits, Problem, Status, verify
from trajopt.benchmark.suites.mixes import halves, inherited


def solved(problem):
    solution = ExactJerk().solve(problem)
    assert solution.status is Status.SOLVED
    certificate = verify(problem, solution.trajectory)
    assert certificate.feasible
    assert certificate.certified_duration == pytest.approx(solution.trajectory.duration, rel=1e-8)
    return solution.trajectory


def test_two_segments_share_their_only_waypoint():
    """IPOPT, every joint with its own pieces of constant jerk, found the same to 5e-11."""
    problem = Problem(
        [[0, 0], [-0.534233, -0.826166], [-1.011512, -0.169544]],
        Limits([2.157952, 0.532101], [4.133913, 3.556266], [37.537328, 69.228089]),
        start_velocity=[-0.195428, -0.148995],
        end_velocity=[-0.877892, 0.279073],
        start_acceleration=[1.47562, 0.455386],
    )
    assert solved(problem).duration == pytest.approx(3.0292890934571433, rel=1e-9)


def test_a_brief_first_segment_is_passed_at_speed():
    """A proved bound stands at 0.7314 s; later than that waypoint 2 is passed a second time."""
    problem = Problem(
        [[0.0], [0.09562864326763143], [0.18366094049740106]],
        Limits([1.2927130426302411], [3.661044795736327], [20.108985405398094]),
        start_velocity=[0.9309486638993973],
        end_velocity=[-0.6852915329029059],
    )
    bound = Prove().solve(problem).lower_bound
    assert bound > 0.731
    certificate = verify(problem, ExactJerk().solve(problem).trajectory)
    assert certificate.certified_duration == pytest.approx(bound, rel=2e-4)


# of 739 the first times that are possible end 0.1 % after the optimum
@pytest.mark.parametrize("seed", [*range(1, 17, 2), 739])
def test_two_waypoints_are_ruckigs(seed):
    problem = drawn(seed, jerk=True)
    assert solved(problem).duration == pytest.approx(optimum(problem).duration, rel=1e-8)


@pytest.mark.parametrize(("seed", "joint"), [(5, 0), (7, 1)])
def test_a_start_at_its_velocity_limit(seed, joint):
    """The first velocity is at its limit exactly, and stays there to the last bit."""
    given = drawn(seed, jerk=True)
    velocity, acceleration = np.array([given.start_velocity, given.start_acceleration])
    velocity[joint], acceleration[joint] = given.limits.velocity[joint, 1], 0.0
    ends = {**given.demands, "start_velocity": velocity, "start_acceleration": acceleration}
    problem = Problem(given.waypoints, given.limits, demands=ends)
    motion = solved(problem)
    assert motion(0.0, 1) == pytest.approx(velocity, abs=1e-14)
    assert motion.duration == pytest.approx(optimum(problem).duration, rel=1e-8)


# a part is possible at one single instant: of one segment in 13 and 473, of more in 77 and 2091
@pytest.mark.parametrize(
    "seed", [13, *(pytest.param(seed, marks=pytest.mark.long) for seed in (2027, 473, 2091, 77))]
)
def test_a_solved_problem_cut_in_two_and_time_reversed(seed):
    problem = drawn(seed, waypoints=3 + seed // 2 % 3, jerk=True)
    motion = solved(problem)
    for k, cut in enumerate(motion.waypoint_times[1:-1], 1):
        there = {"velocity": motion(cut, 1), "acceleration": motion(cut, 2)}
        for rows, end, duration in (
            (slice(0, k + 1), "end", cut),
            (slice(k, None), "start", motion.duration - cut),
        ):
            other = {"end": "start", "start": "end"}[end]
            demands = {f"{end}_{rate}": own for rate, own in there.items()}
            demands |= {key: own for key, own in problem.demands.items() if key.startswith(other)}
            part = Problem(problem.waypoints[rows], problem.limits, demands=demands)
            # docs/limitations.md: of 77 one part is 0.38 % too long on some processors
            exactly = 4e-3 if seed == 77 else 2e-8
            assert solved(part).duration == pytest.approx(duration, rel=exactly)
    route = problem.route.reversed()
    backwards = Problem(route.waypoints, problem.limits, demands=route.demands)
    assert solved(backwards).duration == pytest.approx(motion.duration, rel=2e-8)


def test_impossible_accelerations_are_infeasible():
    limits = Limits([2.0], [4.0], [6.0])
    problem = Problem([[0.0], [1.0]], limits, start_velocity=[1.5], start_acceleration=[3.0])
    solution = ExactJerk().solve(problem)
    assert solution.status is Status.INFEASIBLE
    assert "under its jerk limit to 2.25 rad/s at least" in solution.message


def test_three_waypoints_are_passed_before_the_joint_can_stop():
    """`prove --within 1e-7` stands there, at half of what passing one a second time takes."""
    problem = Problem(
        [[0.0], [0.067], [0.1399], [0.198], [0.3481]],
        Limits([1.0254], [3.1775], [25.4355]),
        start_velocity=[0.8846],
        start_acceleration=[1.4112],
    )
    assert solved(problem).duration == pytest.approx(0.5690227, rel=1e-6)


def test_a_start_on_its_ramp_to_the_velocity_limit():
    """Any less jerk would pass the limit, and any more is none that is allowed."""
    limits = Limits([1.0], [3.0], [25.0])
    demands = {"start_velocity": [0.98], "start_acceleration": [1.0]}
    problem = Problem([[0.0], [1.0]], limits, demands=demands)
    assert solved(problem).duration == pytest.approx(optimum(problem).duration, rel=1e-8)
    onwards = Problem([[0.0], [1.0], [2.3]], limits, demands=demands)
    straight = optimum(Problem([[0.0], [2.3]], limits, demands=demands))
    assert solved(onwards).duration == pytest.approx(straight.duration, rel=1e-8)


def test_a_start_as_fast_as_another_segment_allows():
    """Its own segment allows more, so its limits are made tighter for rounding all the same."""
    velocity = np.array([[1.0, 1.5], [0.3, 0.4], [1.0, 1.5]])
    acceleration = np.array([[2.0, 3.0], [2.0, 3.0], [0.5, 0.6]])
    jerk = np.array([[20.0, 30.0], [10.0, 10.0], [20.0, 30.0]])
    limits = Limits(*(np.stack([-own, own], axis=-1) for own in (velocity, acceleration, jerk)))
    waypoints = [[0.0, 0.0], [1.0, -0.5], [0.5, 0.5], [1.2, 0.2]]
    solved(Problem(waypoints, limits, start_velocity=[0.3, -0.4]))


@pytest.mark.long
def test_tiny_steps_beside_an_end_are_passed():
    """Of five steps two are tiny: no start that begins on a grid converged there."""
    assert solved(trajopt.problem("moving-random-33")).duration < 1.857


def test_an_end_at_the_velocity_limit_may_still_accelerate():
    # a cam of Riboli and others (2023, Table 3, piece 1)
    demands = {"end_velocity": [15.7], "end_acceleration": [75.4]}
    problem = Problem([[0.0], [np.pi]], Limits([15.7], [1e4], [1500.0]), demands=demands)
    ruckig = RuckigStop().solve(problem).trajectory
    found = ExactJerk().solve(problem).trajectory
    assert verify(problem, found).certified_duration == pytest.approx(ruckig.duration, rel=1e-6)


@pytest.mark.long
def test_a_part_of_an_optimum_that_leaves_no_inside():
    """A part of a certified motion took 0.04258938 s; from inside none is found below 0.0533 s."""
    problem = Problem(
        [[0.0], [8.4e-05], [0.000412757517918983]],
        Limits([1.601871], [[-1.599542, 1.766186]], [59.485646]),
        end_velocity=[0.013382027714502812],
        end_acceleration=[-0.5734150050219664],
    )
    assert solved(problem).duration == pytest.approx(0.04258938009379499, rel=1e-6)


def test_a_segment_whose_motion_rounding_breaks_at_the_first_possible_time():
    """The part of an optimum takes all of (a₁ − a₀)/J; the next possible time is 1.39 s."""
    first, last, jerk = 1.5430938707889499, 2.9435092608620455, 30.697618156896606
    problem = Problem(
        [[0.7481378505409366], [0.7078002167132799]],
        Limits([1.9519798456729365], [3.447400030759276], [jerk]),
        start_velocity=[-0.9300611748560841],
        end_velocity=[-0.8277224845595595],
        start_acceleration=[first],
        end_acceleration=[last],
    )
    assert solved(problem).duration == pytest.approx((last - first) / jerk, rel=1e-9)


def test_a_millisecond_whose_states_are_rounded_takes_a_millisecond():
    """The last of an optimum; no motion has exactly these numbers in less than 0.8 s."""
    problem = Problem(
        [[0.7799827529625233], [0.7793642988193056]],
        Limits([2.942240493677268], [3.3648225019397575], [97.47072729440593]),
        start_velocity=[-0.6182206811993832],
        end_velocity=[-0.6186713601147602],
        start_acceleration=[-0.4994142790249283],
        end_acceleration=[-0.4019435530332159],
    )
    assert solved(problem).duration == pytest.approx(0.001, rel=1e-6)


@pytest.mark.long
@pytest.mark.parametrize(
    ("seed", "cut", "half"),
    [
        # no guess but slowed times of the optimum without jerk limits leads there: 84 % too long
        (2707, 1.083, 1),
        # IPOPT's point missed a state by 1e-12 until its sharpening weighed nothing else: 20 %
        (2399, 2.7881827396096877, 0),
    ],
)
def test_a_cut_motion_of_mixed_demands_is_planned_again_as_short(seed, cut, half):
    drawn = mixes.drawn(seed)
    whole = replace(drawn, demands=inherited(drawn))
    solution, duration = mixes.solved(whole)
    part = halves(whole, solution.trajectory, cut)[half]
    took = duration - cut if half else cut
    assert mixes.solved(part)[1] <= took * (1 + 1e-6)
