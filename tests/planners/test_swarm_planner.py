"""Swarms on the 3-5-3 timing problem, against sampled limits and the 14×14 system of the paper."""

from __future__ import annotations

import hashlib
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import minimize

from trajopt import InvalidInput, Limits, Problem, Status, verify
from trajopt.benchmark.suites import catalogue
from trajopt.planners import spline353
from trajopt.planners.planner import Planner, Relation
from trajopt.planners.registry import configured, options
from trajopt.planners.swarm import ISSA, PSO, SSA, Optimiser
from trajopt.planners.swarm_planner import SegmentTimes, SwarmPlanner, issa, pso, ssa

PROBLEMS = Path(__file__).parents[2] / "data" / "problems"
SIX_AXIS = Problem.from_toml(PROBLEMS / "six-axis.toml")
SUPPORTED = ["six-axis", "repeated", "tiny", "asymmetric", "jerk-limit", "resting-joint"]
MODES = [
    {"timing": timing, "fitness": fitness}
    for timing in ("shared", "per-joint")
    for fitness in ("penalty", "scaled")
]


def named(name):
    return Problem.from_toml(PROBLEMS / f"{name}.toml")


def digest(solutions):
    """Of every number that the runs found."""
    data = b""
    for s in solutions:
        data += s.trajectory.coefficients.tobytes() + s.trajectory.breaks.tobytes()
        data += b"" if s.history is None else s.history.tobytes()
        data += b"".join(np.asarray(v).tobytes() for v in s.stats.values())
    return hashlib.sha256(data).hexdigest()


def sampled_peaks(problem, times, samples=101):
    """Peak velocity and acceleration over their limits, `(2, joints)`: eq. 30–33, sampled."""
    t1, t2, t3 = times

    def row(segment, t, order):
        """The derivative of a segment's polynomial at its local times, in all 14 unknowns."""
        degree, start = ((3, 0), (5, 4), (3, 10))[segment]
        unknowns = np.zeros((*np.shape(t), 14))
        for power in range(order, degree + 1):
            factor = np.prod(np.arange(power - order + 1, power + 1.0))
            unknowns[..., start + power] = factor * t ** (power - order)
        return unknowns

    zero = np.zeros(problem.joints)
    q0, q1, q2, q3 = problem.waypoints
    system = [(row(0, 0, 0), q0), (row(0, 0, 1), zero), (row(0, 0, 2), zero), (row(0, t1, 0), q1)]
    system += [(row(1, 0, 0), q1), (row(1, t2, 0), q2), (row(2, 0, 0), q2), (row(2, t3, 0), q3)]
    system += [(row(2, t3, order), zero) for order in (1, 2)]
    system += [(row(0, t1, order) - row(1, 0, order), zero) for order in (1, 2)]
    system += [(row(1, t2, order) - row(2, 0, order), zero) for order in (1, 2)]
    unknowns = np.linalg.solve(*(np.array(side) for side in zip(*system, strict=True)))
    grid = np.linspace(0, 1, samples)
    peaks = []
    for order, limits in ((1, problem.limits.velocity), (2, problem.limits.acceleration)):
        rows = [row(k, grid * times[k], order) for k in range(3)]
        values = np.concatenate(rows) @ unknowns
        peaks.append((values[..., None] / limits).max(axis=(0, 2)))
    return np.array(peaks)


def sampled_duration(problem, times, samples=101):
    """The duration once dilated to the sampled limits: never above the true one."""
    velocity, acceleration = sampled_peaks(problem, times, samples)
    return max(velocity.max(), np.sqrt(acceleration.max())) * sum(times)


@dataclass(frozen=True)
class Probe(Optimiser):
    """Evaluates the points of the unit cube that it is given, and keeps their fitness."""

    points: tuple = ()
    fitness: list = field(default_factory=list)

    @property
    def evaluations_per_iteration(self):
        return len(self.points)

    def search(self, box, streams, iterations):
        points = box.spread(np.tile(self.points, (len(streams), 1, 1)))
        self.fitness.append((yield points))
        yield points


def probed(problem, points, **changes):
    """Fitness of segment times `(m, 3)`, s, each within the planner's box."""
    high = SegmentTimes.of(problem.merged()[0], SwarmPlanner()).high.max()
    unit = (np.asarray(points) / high - 1e-3) / (1 - 1e-3)
    assert unit.min() >= 0
    assert unit.max() <= 1
    probe = Probe(len(points), tuple(map(tuple, unit)))
    SwarmPlanner(probe, iterations=1, **changes).solve(problem)
    return probe.fitness[0][0], 3 * high


@pytest.fixture(scope="module")
def elsewhere():
    """Results of another process with seed 7: the digest of each swarm in each mode."""
    code = (
        "from tests.planners.test_swarm_planner import *\n"
        "for mode in MODES:\n"
        "    for optimiser in (PSO(), SSA(), ISSA()):\n"
        "        planner = SwarmPlanner(optimiser, iterations=10, **mode)\n"
        "        print(digest([planner.solve(SIX_AXIS, seed=7)]))"
    )
    there = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return np.reshape(there.stdout.split(), (len(MODES), 3)).tolist()


@pytest.mark.parametrize("mode", MODES)
def test_a_run_gives_the_same_bits_alone_in_a_batch_and_in_another_process(mode, elsewhere):
    planners = [SwarmPlanner(o, iterations=10, **mode) for o in (PSO(), SSA(), ISSA())]
    batches = [planner.solve_batch(SIX_AXIS, range(30)) for planner in planners]
    for planner, batch in zip(planners, batches, strict=True):
        assert digest([planner.solve(SIX_AXIS, seed=7)]) == digest([batch[7]])
        assert digest(planner.solve_batch(SIX_AXIS, [29, 7])) == digest([batch[29], batch[7]])
    assert elsewhere[MODES.index(mode)] == [digest([batch[7]]) for batch in batches]


@pytest.mark.parametrize("name", SUPPORTED)
@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("optimiser", [PSO(), SSA(), ISSA()])
def test_every_answer_is_certified(name, mode, optimiser):
    problem = named(name)
    planner = SwarmPlanner(optimiser, iterations=15, **mode)
    assert planner.unsupported(problem) is None
    for solution in planner.solve_batch(problem, [0, 1]):
        certificate = verify(problem, solution.trajectory)
        assert solution.status == Status.SOLVED
        assert solution.message == ""
        assert certificate.valid
        if planner.timing == "shared":
            assert certificate.feasible
            assert certificate.dilation <= 1 + 1e-12
            assert solution.history[-1, 0] == solution.evaluations
            assert solution.history[-1, 1] == pytest.approx(solution.trajectory.duration, rel=1e-12)
            assert (np.diff(solution.history[:, 0]) > 0).all()
            durations = solution.history[~np.isnan(solution.history[:, 1]), 1]
            assert (np.diff(durations) <= 0).all()
        if planner.fitness == "scaled" and planner.timing == "shared":
            assert certificate.dilation == pytest.approx(1, rel=1e-9)


@pytest.mark.long
def test_no_swarm_beats_the_best_353_and_pso_reaches_it():
    grid = [(i, j, 16 - i - j) for i in range(1, 15) for j in range(1, 16 - i)]
    start = min(grid, key=lambda t: sampled_duration(SIX_AXIS, np.array(t, float), 11))
    found = minimize(
        lambda logs: sampled_duration(SIX_AXIS, np.exp([*logs, 0])),
        np.log(np.array(start[:2]) / start[2]),
        method="Nelder-Mead",
        options={"xatol": 1e-6, "fatol": 1e-9},
    )
    for optimiser in (PSO(), SSA(), ISSA()):
        for fitness in ("penalty", "scaled"):
            planner = SwarmPlanner(optimiser, fitness=fitness, iterations=150)
            solutions = planner.solve_batch(SIX_AXIS, range(3))
            durations = [verify(SIX_AXIS, s.trajectory).certified_duration for s in solutions]
            assert min(durations) > found.fun * (1 - 1e-7)
            assert isinstance(optimiser, SSA) or min(durations) < found.fun * (1 + 1e-3)


def test_penalty_is_debs_rule():
    rng = np.random.default_rng(3)
    points = rng.uniform(0.05, 3.5, (200, 3))
    fitness, ceiling = probed(SIX_AXIS, points)
    excess = np.array([np.maximum(sampled_peaks(SIX_AXIS, t) - 1, 0).sum() for t in points])
    clear = (excess == 0) | (excess > 1e-3)  # sampling cannot tell the others
    feasible = excess[clear] == 0
    np.testing.assert_allclose(fitness[clear][feasible], points[clear][feasible].sum(axis=1))
    np.testing.assert_allclose(
        (fitness[clear] - ceiling)[~feasible], excess[clear][~feasible], rtol=2e-2, atol=1e-3
    )
    assert 10 < feasible.sum() < 190
    assert fitness[clear][feasible].max() <= ceiling < fitness[clear][~feasible].min()


def test_scaled_fitness_is_the_dilated_duration():
    points = np.random.default_rng(4).uniform(0.05, 3.5, (30, 3))
    fitness, _ = probed(SIX_AXIS, points, fitness="scaled")
    expected = [sampled_duration(SIX_AXIS, t, 1001) for t in points]
    np.testing.assert_allclose(fitness, expected, rtol=1e-4)
    assert (fitness >= np.array(expected) * (1 - 1e-12)).all()
    doubled, _ = probed(SIX_AXIS, points / 2, fitness="scaled")
    np.testing.assert_allclose(doubled, fitness, rtol=1e-12)  # only the ratios matter


def test_jerk_counts_where_it_is_limited():
    problem = named("jerk-limit")
    times = SwarmPlanner(PSO(), iterations=100).solve(problem).stats["segment_times"]
    fitness, ceiling = probed(problem, [times, times * 0.99])
    assert fitness[0] == pytest.approx(times.sum())
    assert fitness[1] > ceiling
    without = SwarmPlanner(PSO(), iterations=100).solve(problem.without("jerk"))
    assert without.trajectory.duration < times.sum()


@pytest.mark.parametrize(("optimiser", "worst"), [(PSO(), 35.4), (ISSA(), 45)])
@pytest.mark.parametrize("fitness", ["penalty", "scaled"])
def test_position_limits_are_kept(optimiser, worst, fitness):
    """The best 3-5-3 takes 35.18857 s, by a search of a grid of ratios."""
    problem = named("position-limits")
    planner = SwarmPlanner(optimiser, fitness=fitness, iterations=120)
    for solution in planner.solve_batch(problem, [0, 1]):
        assert solution.message == ""
        certificate = verify(problem, solution.trajectory)
        assert certificate.feasible
        assert 35.18857 <= certificate.duration < worst
        durations = solution.history[~np.isnan(solution.history[:, 1]), 1]
        assert durations[-1] == pytest.approx(certificate.duration, rel=1e-9)


def test_what_leaves_a_position_limit_ranks_behind_what_keeps_all():
    """Equal times go 1/8 beyond a limit at 2 (by hand: tests/test_spline353.py)."""
    limits = Limits([4.0, 1e3], [12.0, 1e4], position=[[-1.0, 2.0], [-np.inf, np.inf]])
    problem = Problem([[0.0, 0.0], [1.0, 1.0], [1.0, 2.0], [0.0, 3.0]], limits)
    points = np.array([[1.0, 1.0, 1.0], [1.1, 1.1, 1.1], [1.0, 0.5, 1.0]])
    free, _ = probed(problem.without("position"), points)
    np.testing.assert_allclose(free[:2], [3.0, 3.3])
    for fitness in ("penalty", "scaled"):
        found, ceiling = probed(problem, points, fitness=fitness)
        beyond = found[:2] / ceiling - 1 if fitness == "scaled" else found[:2] - ceiling
        np.testing.assert_allclose(beyond, 1 / 8)
    dilated, _ = probed(problem.without("position"), points, fitness="scaled")
    assert found[2] == pytest.approx(dilated[2], rel=1e-12)
    assert found[2] < ceiling


def test_each_joint_may_keep_its_position_limit_alone():
    problem = named("position-limits")
    solution = SwarmPlanner(PSO(), timing="per-joint", iterations=200).solve(problem)
    assert solution.message == ""
    for joint, times in enumerate(solution.stats["joint_times"]):
        alone = problem.only([joint])
        assert verify(alone, spline353.trajectory(alone, times)).feasible


@pytest.mark.parametrize("timing", ["shared", "per-joint"])
def test_a_limit_passed_at_speed_is_infeasible(timing):
    limits = Limits([2.0], [5.0], position=[[0.0, 1.0]])
    problem = Problem([[0.2], [1.0], [0.5], [0.0]], limits)
    for solution in SwarmPlanner(timing=timing, iterations=5).solve_batch(problem, [0, 1]):
        assert solution.status is Status.INFEASIBLE
        assert "at its limit at waypoint 2" in solution.message


@pytest.mark.parametrize("fitness", ["penalty", "scaled"])
def test_each_joint_alone_is_at_least_as_fast_as_together(fitness):
    planner = SwarmPlanner(PSO(), iterations=200, timing="per-joint", fitness=fitness)
    solution = planner.solve(SIX_AXIS, seed=3)
    times = solution.stats["joint_times"]
    durations = solution.stats["joint_durations"]
    assert np.isnan(times[0]).all()
    assert np.isnan(durations[0])
    np.testing.assert_allclose(durations[1:], times[1:].sum(axis=1))
    assert (solution.stats["segment_times"] == times[1:].max(axis=0)).all()
    assert solution.trajectory.duration == pytest.approx(times[1:].max(axis=0).sum())
    assert solution.evaluations == 5 * (30 + 200 * 30)
    together = SwarmPlanner(PSO(), iterations=200).solve(SIX_AXIS, seed=3)
    assert durations[1:].max() < together.trajectory.duration
    for joint in range(1, 6):
        lone = Problem(
            SIX_AXIS.waypoints[:, [joint]],
            Limits(SIX_AXIS.limits.velocity[[joint]], SIX_AXIS.limits.acceleration[[joint]]),
        )
        assert np.max(sampled_peaks(lone, times[joint])) <= 1 + 1e-9
        spent, best = solution.stats["joint_history"][
            solution.stats["joint_history"][:, 0] == joint, 1:
        ].T
        assert spent[-1] == 30 + 200 * 30
        assert best[-1] == pytest.approx(durations[joint], rel=1e-12)
    assert solution.history is None


def test_a_resting_segment_lets_its_time_go_to_the_lower_bound():
    solution = SwarmPlanner(PSO(), iterations=200, timing="per-joint", lower=0.01).solve(SIX_AXIS)
    t1, t2, t3 = solution.stats["joint_times"][5]  # the last joint moves in the third segment only
    longest = 2 * np.sqrt(np.radians(30) / np.radians(330))  # stop to stop, never at full speed
    assert t1 == pytest.approx(0.01 * 4 * longest, rel=1e-12)
    assert min(t2, t3) > t1


def test_identical_waypoints_are_passed_once():
    problem = named("repeated")
    merged = Problem(problem.waypoints[[0, 1, 3, 4]], problem.limits)
    solution, alone = (SwarmPlanner(PSO(), iterations=30).solve(p) for p in (problem, merged))
    times = solution.trajectory.waypoint_times
    assert len(times) == 5
    assert times[1] == times[2]
    assert solution.trajectory.duration == alone.trajectory.duration


def test_half_the_time_scale_gives_half_the_times_bit_for_bit():
    limits = SIX_AXIS.limits
    faster = Problem(SIX_AXIS.waypoints, Limits(2 * limits.velocity, 4 * limits.acceleration))
    for optimiser in (PSO(), SSA(), ISSA()):
        planner = SwarmPlanner(optimiser, space="unit", fitness="scaled", iterations=30)
        slow, fast = (planner.solve(p).stats["segment_times"] for p in (SIX_AXIS, faster))
        assert (slow == 2 * fast).all()


def test_the_space_searched_matters_to_sparrows_but_not_to_particles():
    def times(optimiser, iterations):
        planners = [
            SwarmPlanner(optimiser, space=space, iterations=iterations)
            for space in ("seconds", "unit")
        ]
        return [p.solve(SIX_AXIS, seed=1).stats["segment_times"] for p in planners]

    np.testing.assert_allclose(*times(PSO(), 20), rtol=1e-9)
    assert not np.allclose(*times(SSA(), 20), rtol=1e-3)


@pytest.mark.parametrize("timing", ["shared", "per-joint"])
def test_a_search_without_a_feasible_candidate_says_so_and_still_answers(timing):
    solution = SwarmPlanner(SSA(), timing=timing, upper=0.1, iterations=3).solve(SIX_AXIS)
    certificate = verify(SIX_AXIS, solution.trajectory)
    assert solution.status == Status.SOLVED
    assert "no candidate kept the limits" in solution.message
    assert certificate.certified_duration > solution.trajectory.duration
    if solution.history is not None:
        assert np.isnan(solution.history[:, 1]).all()
    else:
        assert np.isnan(solution.stats["joint_durations"]).all()


@pytest.mark.parametrize("planner", [pso, ssa, issa])
def test_evaluations_are_a_budget_too(planner):
    solution = configured(planner, {"evaluations": "100"}).solve(SIX_AXIS)
    assert solution.evaluations == 100
    assert solution.history[-1, 0] == 100


def test_contract():
    assert isinstance(issa, Planner)
    assert issa.stochastic
    assert issa.relation(SIX_AXIS) is Relation.RESTRICTION
    assert "exactly 4 waypoints; this has 7" in issa.unsupported(named("seven-waypoints"))
    assert [p.description.split()[-1] for p in (pso, ssa, issa)] == ["PSO.", "SSA.", "ISSA."]
    assert issa.solve_batch(SIX_AXIS, []) == []


def test_the_papers_settings_are_the_defaults():
    paper = {
        "population": 30,
        "iterations": 1000,
        "discoverers": 0.2,
        "vigilantes": 0.1,
        "safety": 0.8,
    }
    assert paper.items() <= options(issa).items()


def test_options_of_optimiser_and_planner_do_not_collide():
    for planner in (pso, ssa, issa):
        assert len(options(planner)) == len(vars(planner)) - 1 + len(vars(planner.optimiser))


def test_options_are_set_from_text():
    changed = configured(
        issa, {"fitness": "scaled", "population": "50", "chaos": "false", "upper": "3"}
    )
    assert (changed.fitness, changed.optimiser.population, changed.optimiser.chaos) == (
        "scaled",
        50,
        False,
    )
    with pytest.raises(InvalidInput, match="discoverers"):
        configured(issa, {"discoverers": "2.0"})


@pytest.mark.parametrize(
    "change",
    [
        {"timing": "alone"},
        {"fitness": "best"},
        {"space": "hours"},
        {"iterations": -1},
        {"evaluations": 0},
        {"upper": 0.0},
        {"lower": 1.0},
        {"upper": float("nan")},
    ],
)
def test_a_bad_option_is_named(change):
    with pytest.raises(InvalidInput, match=f"^{next(iter(change))} .*expected"):
        SwarmPlanner(**change)


@pytest.mark.parametrize("timing", ["shared", "per-joint"])
@pytest.mark.parametrize("name", ["six-axis", "jerk-limit"])
def test_below_an_incumbent_the_fitness_is_exact_and_elsewhere_not_below_it(name, timing):
    problem = catalogue.load(name)
    task = SegmentTimes.of(problem, SwarmPlanner(timing=timing))
    low, high = task.box(5)
    random = np.random.default_rng(3)
    # times from the longest that stopping takes to far below it: kept and broken limits
    x = low[:, None] + random.random((len(low), 40, 3)) ** 2 * (high - low)[:, None]
    exact = task.fitness(x)
    incumbent = random.permuted(exact, axis=1)
    compared = task.fitness(x, incumbent)
    below = exact < incumbent
    assert 0.3 < below.mean() < 0.7
    np.testing.assert_array_equal(compared[below], exact[below])
    assert (compared[~below] >= incumbent[~below]).all()
