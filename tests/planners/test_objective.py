"""The objective of a spline's times: against the swarms' fitness, the verifier and closed forms."""

from __future__ import annotations

import pickle

import numpy as np
import pytest
from scipy.optimize import differential_evolution

import trajopt
from trajopt import InvalidInput, Limits, Problem, UnknownName, verify
from trajopt.planners.compiled import compiled
from trajopt.planners.objective import Objective
from trajopt.planners.swarm_planner import SegmentTimes, SwarmPlanner
from trajopt.planners.timing import FamilyTiming

FOUR_WAYPOINTS = ["six-axis", "repeated", "tiny", "asymmetric", "jerk-limit", "resting-joint"]
SHAPES = ["3-5-3", "4-3-4", "3", "5", "7", "5-5-5"]


def drawn(f, count=300, seed=0):
    """Candidates of the box, half of them near its lower end, where limits are broken."""
    rng = np.random.default_rng(seed)
    candidates = rng.uniform(f.low, f.high, (count, f.variables))
    candidates[::2] *= 0.4
    return candidates


@pytest.mark.parametrize("fitness", ["penalty", "scaled"])
@pytest.mark.parametrize("name", [*FOUR_WAYPOINTS, "robots-puma-560-w4"])
def test_it_is_the_fitness_that_the_swarms_search_in_their_box(name, fitness):
    problem = trajopt.problem(name)
    task = SegmentTimes.of(problem.merged()[0], SwarmPlanner(fitness=fitness))
    f = trajopt.objective(problem, fitness=fitness)
    assert f.variables == 3
    assert (f.low == task.low[0]).all()
    assert (f.high == task.high[0]).all()
    candidates = drawn(f)
    np.testing.assert_allclose(f(candidates), task.fitness(candidates[None])[0], rtol=1e-12)


@pytest.mark.parametrize("fitness", ["penalty", "scaled"])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("name", ["six-axis", "jerk-limit"])
def test_what_it_says_of_a_candidate_the_verifier_says_of_the_motion(name, shape, fitness):
    problem = trajopt.problem(name)
    f = trajopt.objective(problem, shape=shape, fitness=fitness)
    candidates = np.repeat(np.linspace(0.05, 0.95, 12)[:, None], f.variables, axis=1) * f.high
    for candidate, value in zip(candidates, f(candidates), strict=True):
        motion = f.trajectory(candidate)
        certificate = verify(problem, motion)
        assert not certificate.flaws
        if value <= f.ceiling:
            assert motion.duration == pytest.approx(value, rel=1e-12)
            assert certificate.certified_duration == pytest.approx(value, rel=1e-9)
        else:
            assert certificate.certified_duration > motion.duration * (1 + 1e-9)


def test_a_candidate_alone_is_the_same_bits_as_among_others_and_is_counted():
    for shape in ("3-5-3", "4-3-4"):
        f = trajopt.objective("six-axis", shape=shape)
        candidates = drawn(f, 20)
        together = f(candidates)
        assert together.shape == (20,)
        alone = [f(candidate) for candidate in candidates]
        assert all(isinstance(value, float) for value in alone)
        np.testing.assert_allclose(together, alone, rtol=0 if shape == "3-5-3" else 1e-12)
        assert f.evaluations == 40
        assert f(candidates[:0]).shape == (0,)
        assert f(candidates[0].tolist()) == alone[0]


def test_position_limits_are_kept_by_debs_rule():
    """Both inner waypoints lie near a limit: slow outer segments overshoot it."""
    limits = Limits([1.0], [1.0], position=[[-0.02, 1.02]])
    problem = Problem([[0.5], [1.0], [0.0], [0.5]], limits)
    f = trajopt.objective(problem)
    candidates = drawn(f, 200)
    values = f(candidates)
    motions = [f.trajectory(candidate) for candidate in candidates]
    for motion, value in zip(motions, values, strict=True):
        at = motion(np.linspace(0.0, motion.duration, 400))
        if value <= f.ceiling:
            assert at.min() >= -0.02 - 1e-9
            assert at.max() <= 1.02 + 1e-9
    assert (values <= f.ceiling).any()
    beyond = [motion(np.linspace(0.0, motion.duration, 400)).max() > 1.021 for motion in motions]
    assert (values[beyond] > f.ceiling).all()
    assert any(beyond)


def test_the_shape_353_of_the_families_is_the_closed_form():
    problem = trajopt.problem("six-axis")
    f = trajopt.objective(problem)
    family = FamilyTiming.of(problem, "3-5-3", lower=1e-3, upper=4.0)
    candidates = np.random.default_rng(1).uniform(0.3, 3.0, (200, 3))
    np.testing.assert_allclose(family.penalty(candidates), f(candidates), rtol=1e-8)
    np.testing.assert_allclose(
        family.scaled(candidates),
        trajopt.objective(problem, fitness="scaled")(candidates),
        rtol=1e-8,
    )


def test_outside_the_box_the_nearest_inside_counts_and_nan_is_infinite():
    f = trajopt.objective("six-axis")
    assert f(f.high * 2) == f(f.high)
    assert f([-1.0, 1.0, 1.0]) == f([f.low[0], 1.0, 1.0])
    assert f([np.nan, 1.0, 1.0]) == np.inf
    assert f([[np.inf, 1.0, 1.0], [1.0, 1.0, 1.0]])[0] == np.inf
    assert f.trajectory(f.high * 2).duration == pytest.approx(f.high.sum())


def test_a_copy_in_another_process_gives_the_same_bits():
    f = trajopt.objective("six-axis")
    candidates = drawn(f, 5)
    values = f(candidates)
    assert (pickle.loads(pickle.dumps(f))(candidates) == values).all()


def test_repeated_waypoints_are_passed_once():
    problem = trajopt.problem("repeated")
    f = trajopt.objective("repeated")
    motion = f.trajectory(f.high)
    assert len(motion.waypoint_times) == len(problem.waypoints)
    assert verify(problem, motion).feasible


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"problem": "six-axes"}, "six-axis"),
        ({"problem": "seven-waypoints", "shape": "3-5-3"}, "exactly 4 waypoints"),
        ({"problem": "six-axis", "shape": "2-5-2"}, "degrees from 3 to 9"),
        ({"problem": "six-axis", "shape": "3-5"}, "degrees for 3 segments"),
        ({"problem": "six-axis", "shape": None}, "degrees from 3 to 9"),
        ({"problem": "six-axis", "fitness": "deb"}, "'penalty' or 'scaled'"),
    ],
)
def test_what_cannot_be_used_is_named(arguments, words):
    with pytest.raises((InvalidInput, UnknownName), match=words):
        trajopt.objective(**arguments)


@pytest.mark.parametrize("times", [1.0, [1.0, 2.0], np.ones((2, 4)), "abc", np.ones((1, 1, 3))])
def test_times_of_another_shape_are_named(times):
    f = trajopt.objective("six-axis")
    with pytest.raises(InvalidInput, match=r"\(3,\) or \(n, 3\)"):
        f(times)
    with pytest.raises(InvalidInput):
        f.trajectory(times)


def test_an_optimiser_of_another_library_finds_the_proved_optimum():
    """`prove --family spline353` proves that no 3-5-3 of six-axis is below 4.31038 s."""
    f = Objective(trajopt.problem("six-axis"), fitness="scaled")
    box = np.column_stack([f.low, f.high])
    found = differential_evolution(f, box, rng=0, polish=False, tol=1e-10)
    assert found.nfev == f.evaluations
    assert 4.31037 < found.fun < 4.3106
    assert trajopt.judge("six-axis", f.trajectory(found.x)).certified_duration == pytest.approx(
        found.fun, rel=1e-9
    )


def test_a_function_that_cannot_be_recorded_is_refused():
    """Numbers written into an array of floats are lost; nothing else would tell."""

    def lossy(times):
        table = np.zeros(times.shape)
        table[:] = times**2
        return table.sum(axis=1)

    sample = np.array([1.0, 2.0])
    assert compiled(lambda times: (times**2).sum(axis=1), sample)(sample) == 5.0
    with pytest.raises(RuntimeError, match="lossy"):
        compiled(lossy, sample)


@pytest.mark.parametrize("shape", ["3-5-3", "5"])
def test_limits_per_segment_count_as_the_tightest_everywhere(shape):
    free = Problem([[0.0], [1.0], [2.0], [3.0]], Limits([1.0], [4.0]))
    pairs = [[[-3.0, 3.0]], [[-1.0, 2.0]], [[-2.0, 1.0]]]
    own = Problem(free.waypoints, Limits(pairs, [4.0]))
    f, g = (trajopt.objective(each, shape=shape, fitness="scaled") for each in (own, free))
    times = 0.4 * g.high
    assert f(times) == g(times)
    assert trajopt.judge(own, f.trajectory(times)).certificate.feasible


def test_what_no_times_can_keep_is_refused():
    limits = Limits([1.0], [4.0])
    for demands in ({"start_velocity": [0.5]}, {"dwell": [0.0, 0.2, 0.0]}, {"least_times": [1, 1]}):
        problem = Problem([[0.0], [1.0], [2.0]], limits, demands=demands)
        with pytest.raises(InvalidInput, match=f"do not know {next(iter(demands))[:5]}"):
            trajopt.objective(problem, shape="5")
