"""The bound over all segment times: closed forms, a problem that is not convex, random problems."""

from __future__ import annotations

import numpy as np
import pytest

import trajopt
from baselines.front.bound import _SimplexSearch, problem_rows, prove, shortest_times
from baselines.front.curve import bound_with_limits
from baselines.front.dual import free_bounds
from baselines.front.least import least, without_limits
from baselines.lower_bound.incumbent import incumbent
from trajopt.benchmark.suites.catalogue import load
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem

FAR = Limits(velocity=[100.0], acceleration=[1000.0])


def bounded(problem, order=3, within=2e-3):
    measure = {3: "jerk", 2: "acceleration"}[order]
    value = without_limits(problem, measure)
    return value, prove(problem, order, None, value, within=within, deadline=np.inf)


@pytest.mark.parametrize(("order", "constant"), [(3, 720.0), (2, 12.0)])
def test_one_segment_is_the_closed_form(order, constant):
    value, bound = bounded(Problem([[0.0], [2.0]], FAR), order)
    assert value == pytest.approx(4 * constant, rel=1e-8)
    assert 4 * constant * (1 - 1e-6) < bound.lower <= 4 * constant


def test_two_segments_on_a_straight_way_lose_nothing_by_the_waypoint():
    """The free motion from 0 to 1 passes 1/2 in its middle: the waypoint costs nothing."""
    value, bound = bounded(Problem([[0.0], [0.5], [1.0]], FAR))
    assert bound.closed
    assert value == pytest.approx(720.0, rel=1e-6)
    assert 720 * (1 - 2.1e-3) < bound.lower <= 720


def test_a_front_that_is_not_convex_in_the_times():
    """836.3 and 835.6 with 1025.9 between them (exact fractions): a bound is below the least."""
    problem = Problem([[0.0], [0.011], [-0.046], [-0.156]], FAR)
    value, bound = bounded(problem)
    assert value <= 835.7
    assert bound.closed
    assert value * (1 - 2.1e-3) < bound.lower <= value * (1 + 1e-9)


@pytest.mark.parametrize(("order", "low", "high"), [(3, 16476.9, 16477.68), (2, 138.698, 138.705)])
def test_six_axis_has_the_trials_own_constant(order, low, high):
    """Proved in the trial to 1e-4; found by three independent programs."""
    value, bound = bounded(load("six-axis"), order)
    assert low < value < high
    assert bound.closed
    assert bound.lower > low * (1 - 2.1e-3)


def test_a_simplex_is_below_every_value_in_it():
    """Each motion with segment times of the simplex has at least the bound: 200 of each."""
    rng = np.random.default_rng(1)
    problem = load("six-axis")
    rows, _ = problem_rows(problem, np.arange(4), 3, None)
    from baselines.front.dual import best_costates

    equations = rows.only(np.arange(rows.equations))
    for _ in range(20):
        corners = rng.dirichlet(np.ones(3), size=3)
        low = free_bounds(rows, corners[None])[0]
        times = rng.dirichlet(np.ones(3), size=200) @ corners
        assert low <= best_costates(equations, times)[1].min() * (1 + 1e-9)


def test_with_active_limits_the_bound_is_above_the_one_without():
    problem = load("six-axis")
    found = least(problem, "jerk", 2.0)
    bound = prove(
        problem,
        3,
        2.0,
        found.value,
        within=5e-3,
        deadline=np.inf,
        times=np.diff(found.trajectory.waypoint_times),
    )
    assert bound.closed
    assert found.value * (1 - 5.1e-3) < bound.lower <= found.value
    assert bound.lower > 16477.7 / 2.0**5


@pytest.mark.parametrize(("name", "kept"), [("one-joint", [0, 3]), ("repeated", [0, 1, 2, 3])])
def test_where_many_limits_act_the_bound_is_close(name, kept):
    """At 1.2 times the minimum. One joint that never turns passes its waypoints anyway."""
    problem, _ = load(name).merged()
    fastest = incumbent(problem, 10.0)
    found = least(problem, "jerk", 1.2 * fastest.duration, fastest.trajectory)
    bound = bound_with_limits(problem, "jerk", found, 20.0)
    assert bound.closed
    assert bound.proof.kept.tolist() == kept
    assert found.value * (1 - 5.1e-3) < bound.lower <= found.value


@pytest.mark.parametrize("name", ["edges-straight", "random-collinear-j7-w4-08"])
def test_a_segment_at_its_velocity_limit_is_no_obstacle(name):
    """Where a segment can hardly be shorter, half of all times are impossible: once 29 % apart."""
    problem = load(name)
    fastest = incumbent(problem, 10.0)
    found = least(problem, "jerk", 1.2 * fastest.duration, fastest.trajectory)
    bound = bound_with_limits(problem, "jerk", found, 20.0)
    assert bound.closed
    assert found.value * (1 - 5.1e-3) < bound.lower <= found.value


def test_shortest_times_are_closed_forms():
    """From rest 2 to 1/2 m/s² (1/4 s and 1/16 m to 1/2 m/s), at 1/2 m/s, then braking with 1."""
    limits = Limits([[-1.0, 0.5]], [[-1.0, 2.0]])
    problem = Problem([[0.0], [1.0], [3.0], [3.125]], limits)
    found = shortest_times(problem, np.arange(4))
    assert found == pytest.approx([0.25 + (1 - 1 / 16) / 0.5, 4.0, 0.5], rel=1e-8)
    back = Problem(-np.array([[0.0], [2.0], [2.125]]), limits)
    assert shortest_times(back, np.arange(3)) == pytest.approx(
        [1 + 1.5, (2 * 0.125 / 2) ** 0.5], rel=1e-8
    )


@pytest.mark.parametrize("order", [2, 3])
def test_the_square_of_costates_is_their_gram_matrix(order):
    """Two ways of the same integral: along the motion, and by products of all pairs of kernels."""
    rng = np.random.default_rng(order)
    rows, _ = problem_rows(load("six-axis"), np.arange(4), order, 1.7)
    some = rows.only(np.sort(rng.choice(len(rows.power), 30, replace=False)))
    times = rng.dirichlet(np.ones(3), size=(2, 3))
    costates = rng.normal(size=(2, 3, 30, 5))
    squares, error = some.squares(costates, times)
    by_pairs = np.einsum("bprn,bprs,bpsn->bp", costates, some.gram(times), costates)
    assert squares == pytest.approx(by_pairs, rel=1e-11)
    assert (np.abs(squares - by_pairs) <= error).all()


@pytest.mark.long
def test_four_segments_are_proved():
    """Costates that gain 1 change little with the times; the best ones change a thousandfold."""
    walk = np.cumsum(np.random.default_rng(1).normal(size=(5, 7)), axis=0)
    problem = Problem(walk, Limits([1e6] * 7, [1e6] * 7))
    value, bound = bounded(problem, within=0.1)
    assert bound.closed
    assert 0.899 * value < bound.lower <= value


@pytest.mark.parametrize(
    "seed", [1, 2, 3, *(pytest.param(seed, marks=pytest.mark.long) for seed in (0, 4, 5))]
)
def test_no_bound_is_above_a_motion(seed):
    """Random problems of one to five segments, with limits that act or do not."""
    rng = np.random.default_rng(seed)
    segments, joints = int(rng.integers(1, 6)), int(rng.integers(1, 4))
    walk = np.cumsum(rng.normal(size=(segments + 1, joints)), axis=0)
    limits = Limits(rng.uniform(0.5, 2, joints), rng.uniform(1, 4, joints))
    problem = Problem(walk, limits)
    durations = incumbent(problem, 10.0).duration * np.array([1.1, 2.0])
    for point in trajopt.front(problem, durations=durations, time_limit=0.3).points:
        assert point.lower is not None
        assert 0 < point.lower <= point.value * (1 + 1e-9)


def test_python_and_its_errors():
    told = []
    front = trajopt.front(
        "one-joint", measure="acceleration", durations=[5.0, 3.0], tell=told.append
    )
    assert told == ["2 durations, proofs take up to 180 CPU s", "3 s, 1 of 2", "5 s, 2 of 2"]
    assert [point.duration for point in front.points] == [3.0, 5.0]
    assert front.points[1].trajectory.duration == pytest.approx(5.0)
    assert front.as_dict()["points"][0].keys() == {"duration", "value", "lower"}
    for wrong in ([], [-1.0], [np.inf]):
        with pytest.raises(InvalidInput, match="durations"):
            trajopt.front("one-joint", durations=wrong)
    with pytest.raises(InvalidInput, match="the shortest known takes 2 s"):
        trajopt.front("one-joint", durations=[1.5])


def test_there_and_back_again_drops_no_waypoint_between_two_that_are_the_same():
    """Without it two waypoints in a row were one, and the program's start was no number."""
    problem = Problem([[0.0], [1.0], [0.0], [1.0]], Limits([1.0], [2.0]))
    (point,) = trajopt.front(problem, durations=[8.0], time_limit=1.0).points
    assert point.lower is not None
    assert point.lower <= point.value


def test_a_search_ends_where_its_least_bound_is_of_a_simplex_that_is_not_halved():
    """Other simplices cannot raise the bound: on six-axis they took all of the time limit."""
    rows, _ = problem_rows(Problem([[0.0], [0.5], [1.0]], FAR), np.arange(3), 3, None)
    search = _SimplexSearch(rows, np.inf, np.eye(rows.segments), np.ones(rows.low.shape, bool))
    search.bounds, search.open_simplices = [3.0, 1.0, 2.0], [2, 1]
    assert search.may_improve
    search.least_left = 1.5
    assert search.may_improve
    search.open_simplices = [2]
    assert not search.may_improve
    search.least_left, search.open_simplices = np.inf, []
    assert not search.may_improve
