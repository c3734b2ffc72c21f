"""The exact jerk-limited minimum time against closed forms, Exact, Ruckig, collocation."""

from __future__ import annotations

import itertools
from functools import cache
from itertools import islice

import numpy as np
import pytest

from baselines.collocation.uniform import Collocation
from baselines.exact.acceleration import Exact
from baselines.exact.jerk import ExactJerk
from baselines.ruckig_ import RuckigStop, RuckigVia, section
from experiments.known_optima import one_way
from soaks import relations
from trajopt import InvalidInput, Limits, Problem, Relation, Status, Trajectory, verify
from trajopt.benchmark.suites import families
from trajopt.benchmark.suites.catalogue import load
from trajopt.benchmark.suites.random import random_problem
from trajopt.planners.testing import examples

QUICK = ExactJerk(starts=2)


@cache
def drawn(seed: int, waypoints: int | None = None) -> Problem:
    return random_problem(seed, waypoints=waypoints, jerk=True)


@cache
def solved(problem: Problem, planner: ExactJerk = QUICK) -> Trajectory:
    solution = planner.solve(problem)
    assert solution.status is Status.SOLVED, solution.message
    assert solution.trajectory is not None
    certificate = verify(problem.without("position"), solution.trajectory)
    assert certificate.flaws == ()
    assert certificate.dilation <= 1 + 1e-7
    return solution.trajectory


def with_jerk(problem: Problem, factor: float) -> Problem:
    limits = problem.limits
    return Problem(
        problem.waypoints,
        Limits(limits.velocity, limits.acceleration, factor * limits.acceleration),
    )


def one_joint(*waypoints: float, jerk: float = 5.0) -> Problem:
    return Problem([[q] for q in waypoints], Limits([1.0], [2.0], [jerk]))


@pytest.mark.parametrize(
    ("problem", "optimum"),
    [
        (one_joint(0, 1.5), 1.5 / 1 + 1 / 2 + 2 / 5),  # seven phases: h/V + V/A + A/J
        (one_joint(0, 0.4, 1.0, 1.5), 1.5 / 1 + 1 / 2 + 2 / 5),  # waypoints on the way cost nothing
        (one_joint(0, 1e-6), 4 * np.cbrt(1e-6 / 10)),  # four phases: 4 ∛(h/2J)
        (one_joint(0, 1e-6, jerk=2.0), 4 * np.cbrt(1e-6 / 4)),
        (one_joint(0, 1e4, jerk=2e5), 1e4 + 1 / 2 + 1e-5),
    ],
)
def test_closed_forms(problem: Problem, optimum: float) -> None:
    assert solved(problem).duration == pytest.approx(optimum, rel=1e-8)


@pytest.mark.parametrize("name", ["six-axis", "asymmetric", "reversal"])
def test_tends_to_exact_from_above_as_jerk_grows(name: str) -> None:
    problem = load(name)
    exact = Exact().solve(load(name)).trajectory
    assert exact is not None
    gaps = [solved(with_jerk(problem, f)).duration / exact.duration - 1 for f in (1e3, 1e4, 1e5)]
    assert min(gaps) > -1e-9
    np.testing.assert_array_less(gaps[1:], 0.15 * np.array(gaps[:-1]) + 1e-8)  # first order in 1/J
    assert gaps[-1] < 1e-4


def with_a_limited_idler(problem: Problem) -> Problem:
    """Another joint that has a jerk limit and next to nothing to do."""
    travelled = np.cumsum(np.abs(problem.displacements).sum(axis=1))
    idler = 1e-4 * np.r_[0.0, travelled]
    limits = problem.limits
    return Problem(
        np.column_stack([problem.waypoints, idler]),
        Limits(
            np.vstack([limits.velocity, [-10, 10]]),
            np.vstack([limits.acceleration, [-100, 100]]),
            np.vstack([limits.jerk, [-1e4, 1e4]]),
        ),
    )


@pytest.mark.parametrize("problem", examples(), ids=lambda problem: problem.name)
def test_without_a_jerk_limit_it_is_exact(problem: Problem) -> None:
    without = problem.without("jerk", "position")
    exact = Exact().solve(without).trajectory
    assert exact is not None
    assert solved(without).duration == pytest.approx(exact.duration, rel=1e-9)
    # its own program, where some joint has one
    limited = solved(with_a_limited_idler(without))
    assert limited.duration == pytest.approx(exact.duration, rel=1e-7)


@pytest.mark.parametrize("seed", range(8))
def test_two_waypoints_equal_ruckig(seed: int) -> None:
    problem = drawn(seed, waypoints=2)
    ruckig = RuckigStop().solve(problem).trajectory
    assert ruckig is not None
    assert solved(problem, ExactJerk(starts=1)).duration == pytest.approx(ruckig.duration, rel=1e-6)


@pytest.mark.parametrize("seed", [1, 3, 6, 7, 8])
def test_ruckig_from_its_waypoint_states_returns_its_segment_times(seed: int) -> None:
    """Mathematics, section 10: states divided by 1 + 1e-6 keep rounding off a longer branch."""
    problem = drawn(seed)
    trajectory = solved(problem)
    times = trajectory.waypoint_times
    velocities, accelerations = (trajectory(times, order) / (1 + 1e-6) for order in (1, 2))
    states = list(zip(problem.waypoints, velocities, accelerations, strict=True))
    ruckig = [section(problem.limits, *ends)[0] for ends in itertools.pairwise(states)]
    np.testing.assert_allclose(ruckig, np.diff(times), rtol=1e-5, atol=1e-5 * times[-1])


@pytest.mark.parametrize(
    "problem",
    [
        load("jerk-limit"),
        Problem([[0.0], [1.0], [0.4]], Limits([[-1, 0.6]], [[-3.0, 2.0]], [[-4.0, 9.0]])),
        Problem([[0.0, 0], [0.5, 1], [1.0, 0.5]], Limits([1, 2], [3, 4], [8.0, np.inf])),
    ],
    ids=["jerk-limit", "asymmetric", "mixed"],
)
def test_collocation_tends_to_it_from_above(problem: Problem) -> None:
    exact = solved(problem).duration
    solutions = [Collocation(intervals=n).solve(problem).trajectory for n in (10, 20, 40)]
    gaps = np.array([t.duration / exact - 1 for t in solutions if t])
    assert len(gaps) == 3
    assert (gaps > -1e-7).all()
    assert (gaps[1:] < 0.6 * gaps[:-1]).all()
    assert gaps[-1] < 2e-3


@pytest.mark.parametrize("seed", [0, 1, 3, 6, 7, 8])
def test_never_above_ruckig_nor_below_exact(seed: int) -> None:
    problem = drawn(seed)
    duration = solved(problem).duration
    ruckig = RuckigVia(evaluations=1000).solve(problem).trajectory
    exact = Exact().solve(problem).trajectory
    assert ruckig is not None
    assert exact is not None
    assert exact.duration * (1 - 1e-8) <= duration <= ruckig.duration * (1 + 1e-8)


def test_a_profile_may_stay_below_zero_down_to_the_other_sides_limit() -> None:
    # Found by the soak: bounded by its own side's limit it stopped 3.4e-5 above Ruckig.
    limits = Limits([6.416], [[-0.929, 0.528]], [77.9])
    problem = Problem([[-0.363], [-0.729], [-1.458]], limits)
    ruckig = RuckigVia().solve(problem).trajectory
    exact = ExactJerk(1).solve(problem).trajectory
    assert ruckig is not None
    assert exact is not None
    assert exact.duration <= ruckig.duration


@pytest.mark.parametrize("seed", [237, 471, 899, 925, 1437])
def test_what_the_soak_found_stays_mended(seed: int) -> None:
    # Brief segments, asymmetric accelerations, rounding at a velocity limit, starts that all fail.
    problem = relations.drawn(seed)
    exact = ExactJerk().solve(problem).trajectory
    assert exact is not None
    for planner in (Collocation(), RuckigVia(2000)):
        other = planner.solve(problem).trajectory
        assert other is not None
        assert exact.duration <= other.duration * (1 + 1e-7)


def test_scaling_permuting_mirroring_and_reversing() -> None:
    waypoints = np.array([[0.0, 0.2], [0.7, -0.3], [0.5, 0.4], [1.2, 0.9]])
    v = np.array([[-1, 0.7], [-2, 2]])
    a = np.array([[-2.0, 3], [-4, 3]])
    j = [[-9.0, 6], [-8, 20]]
    jerk = np.array(j)
    planner = ExactJerk(starts=1)
    duration = solved(Problem(waypoints, Limits(v, a, jerk)), planner).duration
    mirrored, backwards = (-x[:, ::-1] for x in (a, jerk))
    alike = [
        (waypoints, Limits(3 * v, 9 * a, 27 * jerk), 3.0),
        (waypoints[:, ::-1], Limits(v[::-1], a[::-1], jerk[::-1]), 1.0),
        (-waypoints, Limits(-v[:, ::-1], mirrored, backwards), 1.0),
        (waypoints[::-1], Limits(-v[:, ::-1], a, backwards), 1.0),  # accelerations keep their sign
    ]
    for points, limits, factor in alike:
        other = solved(Problem(points, limits), planner).duration
        assert factor * other == pytest.approx(duration, rel=1e-7)


def test_a_joint_that_rests_and_a_waypoint_twice() -> None:
    points = [[0, 0.2], [0.4, 0.2], [0.4, 0.2], [1.2, 0.2]]
    problem = Problem(points, Limits([1.0, 1.0], [2.0, 2.0], [5.0, 5.0]))
    trajectory = solved(problem)
    assert trajectory.duration == pytest.approx(1.2 + 1 / 2 + 2 / 5, rel=1e-8)
    assert trajectory.waypoint_times[1] == trajectory.waypoint_times[2]


@pytest.mark.parametrize("seed", range(6))
def test_no_joint_has_slivers_in_a_brief_segment_nor_pieces_of_rounding(seed: int) -> None:
    """Pieces of 1e-12 s once cost twice the duration: their rounding, mended, breaks the jerk."""
    trajectory = solved(drawn(seed))
    for joint in trajectory.coefficients[0].T:
        own = np.flatnonzero(np.diff(joint)) + 1
        switches = trajectory.breaks[np.r_[0, own, -1]]
        assert np.diff(switches).min() > 1e-10


def test_a_position_limit_makes_it_a_relaxation() -> None:
    problem = load("position-limits")
    solution = QUICK.solve(problem)
    free = solved(problem.without("position")).duration
    assert QUICK.relation(problem) is Relation.RELAXATION
    assert (solution.status, solution.lower_bound) == (Status.RELAXED, None)
    assert solution.trajectory.duration == pytest.approx(free, rel=1e-9)
    assert QUICK.relation(load("jerk-limit")) is Relation.SAME


def test_a_jerk_limit_on_one_side_only_is_unsupported() -> None:
    problem = Problem([[0.0], [1.0]], Limits([1.0], [2.0], [[-5.0, np.inf]]))
    assert "one side only" in str(QUICK.unsupported(problem))
    assert QUICK.unsupported(load("jerk-limit")) is None


@pytest.mark.parametrize("option", ["starts", "agreeing"])
def test_no_start_is_refused(option: str) -> None:
    with pytest.raises(InvalidInput, match=f"{option} is 0: expected at least 1"):
        ExactJerk(**{option: 0})


def test_the_optimum_between_two_waypoints_of_extreme_limits() -> None:
    """The optimum without jerk limits, once a start, overflows here."""
    problem = random_problem(649, waypoints=2, jerk=True)
    solution = ExactJerk().solve(problem)
    assert solution.status is Status.SOLVED
    ruckig = RuckigStop().solve(problem).trajectory
    assert solution.trajectory is not None
    assert ruckig is not None
    assert solution.trajectory.duration == pytest.approx(ruckig.duration, rel=1e-9)


def test_where_no_start_converges_a_motion_that_is_certified_is_the_answer(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("baselines.exact.method.interior_point.MAX_ITERATIONS", 5)
    problem = random_problem(3, jerk=True)
    solution = ExactJerk().solve(problem)
    assert solution.status is Status.SOLVED
    assert solution.message
    assert verify(problem, solution.trajectory).feasible


@pytest.mark.parametrize("seed", [7, 21, 78])
def test_the_first_two_starts_converge(seed: int) -> None:
    """Beside brief segments the second one once was far out of reach."""
    solution = ExactJerk().solve(one_way(seed))
    assert solution.stats["start_status"] == ["Converged"] * 2


@pytest.mark.parametrize(
    ("number", "starts"), [(4, 4), (17, 4), pytest.param(16, 1, marks=pytest.mark.long)]
)
def test_every_start_converges_where_segments_are_brief(number: int, starts: int) -> None:
    """A segment of 1e-7 s sets its waypoints' velocities in proportion to 1/T."""
    problems = list(islice(families.stream("tiny"), number + 1))
    solution = ExactJerk(starts=starts, agreeing=starts).solve(problems[number])
    assert solution.stats["start_status"] == ["Converged"] * starts
    assert solution.trajectory is not None
    certificate = verify(problems[number], solution.trajectory)
    assert certificate.certified_duration == pytest.approx(solution.trajectory.duration, rel=1e-6)


def test_a_jerk_limit_of_a_resting_joint_is_none() -> None:
    """The others have no jerk limit: the answer keeps every limit, and says so."""
    limits = Limits([1.0, 1.0], [2.0, 2.0], [[-np.inf, np.inf], [-3.0, 3.0]])
    problem = Problem([[0.0, 0.0], [1.0, 0.0]], limits)
    solution = ExactJerk().solve(problem)
    assert solution.status is Status.SOLVED
    assert solution.trajectory is not None
    # to the velocity limit and back: 1/1 + 1/2 s
    assert solution.trajectory.duration == pytest.approx(1.5, rel=1e-12)
