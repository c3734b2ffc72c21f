"""Other people's planners against closed forms, and the message if one is not installed."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from baselines.third_party import TRIES, Rival
from baselines.third_party.copp import Copp
from baselines.third_party.drake_kto import DrakeKto
from baselines.third_party.iterative_spline import IterativeSpline
from baselines.third_party.minsnap import MinSnap, optimised, spline
from baselines.third_party.totg_ruckig import TotgRuckig
from baselines.topp_ra import ToppRa
from trajopt import Limits, Problem, Solution, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.core import polynomials
from trajopt.core.exceptions import InvalidInput
from trajopt.planners.planner import Planner, backend
from trajopt.planners.registry import entries
from trajopt.planners.registry import load as planner

NAMES = [name for name, entry in entries().items() if "third_party" in entry.point.module]


def installed(spec: str) -> Planner:
    """Return the planner, or skip the test with the command that installs it."""
    missing = entries()[spec.partition(":")[0]].missing()
    if missing is not None:
        pytest.skip(missing)
    return planner(spec)


def duration(problem: Problem, solution: Solution) -> float:
    assert isinstance(solution.trajectory, Trajectory)
    certified = verify(problem, solution.trajectory).certified_duration
    assert certified is not None
    return certified


def certified(spec: str, problem: Problem) -> float:
    return duration(problem, installed(spec).solve(problem))


@pytest.mark.parametrize("name", NAMES)
def test_where_it_is_not_installed_the_extra_is_named(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    own = entries()[name].load()
    missing = entries()[name].missing()
    assert missing is not None
    assert missing.endswith(f'pip install "mintime[{own.extra}]"')


@pytest.mark.parametrize("name", NAMES)
def test_everybody_gets_twelve_tries_and_the_authors_own_is_first(name: str) -> None:
    rival = entries()[name].load()
    assert isinstance(rival, Rival)
    assert rival.tries == TRIES == len(set(rival.settings)) == len(rival.settings)
    for tries in (0, 13):
        with pytest.raises(InvalidInput, match="from 1 to 12"):
            planner(f"{name}:tries={tries}")
    waypoints = [[0.0, 0.0], [0.6, 0.1], [1.0, 0.5]]
    problem = Problem(waypoints, Limits([1.0, 1.0], [2.0, 2.0]))
    first = installed(f"{name}:tries=1").solve(problem)
    assert first.stats["spline"] == "/".join(map(str, rival.settings[0]))
    better = installed(f"{name}:tries=2")
    by_two = certified(f"{name}:tries=2", problem)
    assert by_two <= certified(f"{name}:tries=1", problem)
    results = [key for key in better.solve(problem).stats if "/" in key]
    assert len(results) == 2


def test_least_jerk_between_two_points_is_the_quintic() -> None:
    """10 s³ − 15 s⁴ + 6 s⁵, its velocity the limit: T = 15/8 h/V."""
    installed("minsnap")
    problem = Problem([[0.0], [3.0]], Limits([1.0], [20.0]))
    solution = MinSnap().tried(problem, "limit", "jerk", 5)
    assert solution.trajectory is not None
    assert solution.trajectory.duration == pytest.approx(15 / 8 * 3, rel=1e-9)


def test_minsnap_optimises_the_ratios_of_its_times() -> None:
    """Mirrored waypoints: from uneven times back to even ones."""
    installed("minsnap")
    waypoints = [[0.0, 0.0], [1.0, 0.9], [2.0, 0.0]]
    problem = Problem(waypoints, Limits([1.0, 1.0], [2.0, 2.0]))

    def at(durations: np.ndarray) -> Trajectory:
        return spline(problem, durations, 3, 5, backend("minsnap_trajectories"))

    durations = optimised(problem, np.array([1.0, 2.0]), at)
    assert durations[0] == pytest.approx(durations[1], rel=1e-2)


def test_copp_without_jerk_limits_is_toppra() -> None:
    installed("copp")
    problem = load("six-axis")
    theirs = Copp().tried(problem, "limit", "natural")
    ours = ToppRa("limit", "natural").solve(problem)
    assert duration(problem, theirs) == pytest.approx(duration(problem, ours), rel=1e-2)


def test_copps_own_path_passes_the_waypoints() -> None:
    problem = load("six-axis")
    solution = installed("copp:tries=1").solve(problem)
    assert solution.trajectory is not None
    at = solution.trajectory.waypoint_times
    np.testing.assert_allclose(solution.trajectory(at), problem.waypoints, atol=1e-12)


def test_copp_and_kto_keep_jerk_limits_by_themselves() -> None:
    problem = load("jerk-limit")
    settings = {Copp(): ("limit", "natural"), DrakeKto(): (5, "limit")}
    for rival, setting in settings.items():
        pytest.importorskip(rival.requires[0])
        solution = rival.tried(problem, *setting)
        assert solution.trajectory is not None
        assert verify(problem, solution.trajectory).dilation < 1.01


def test_kto_is_a_bspline_through_the_waypoints() -> None:
    installed("drake-kto")
    problem = load("position-limits")
    solution = DrakeKto(order=6).tried(problem, 4, "chord")
    assert solution.trajectory is not None
    certificate = verify(problem, solution.trajectory)
    assert certificate.feasible
    assert len(solution.trajectory.coefficients) == 6
    chords = np.linalg.norm(problem.displacements, axis=1)
    shares = np.r_[0, np.cumsum(chords)] / chords.sum()
    times = solution.trajectory.waypoint_times / solution.trajectory.duration
    np.testing.assert_allclose(times, shares, atol=1e-12)


def test_gcs_passes_through_boxes_and_begins_in_motion() -> None:
    # one joint turns 0.1 before its waypoint: 0.9 there, and as far back; exact curves are faster
    gcs = installed("gcs:tries=4")
    there = Problem([[0.0], [1.0], [0.0]], Limits([9.0], [2.0]), demands={"tolerance": 0.1})
    least = 4 * np.sqrt(0.9 / 2)
    assert least <= duration(there, gcs.solve(there)) <= 1.3 * least
    # from 0.5 rad/s it speeds up to √(2 + 0.125) rad/s, and brakes
    moving = Problem([[0.0], [1.0]], Limits([3.0], [2.0]), demands={"start_velocity": [0.5]})
    least = (2 * np.sqrt(2 + 0.125) - 0.5) / 2
    solution = gcs.solve(moving)
    assert least <= duration(moving, solution) <= 1.3 * least
    assert solution.trajectory is not None
    np.testing.assert_allclose(solution.trajectory(0.0, 1), [0.5], atol=1e-6)


def test_gcs_keeps_limits_of_jerk_and_position_by_itself() -> None:
    gcs = installed("gcs:tries=1")
    for name in ("jerk-limit", "position-limits"):
        solution = gcs.solve(load(name))
        assert solution.trajectory is not None
        assert verify(load(name), solution.trajectory).dilation < 1 + 1e-6


def test_totg_runs_its_own_motion_through_the_waypoints() -> None:
    """Its duration is that of TOTG's own clock, but for errors between the points."""
    problem = load("six-axis")
    solution = installed("totg:tries=1").solve(problem)
    motion = solution.trajectory
    assert motion is not None
    np.testing.assert_allclose(motion(motion.waypoint_times), problem.waypoints, atol=1e-12)
    assert motion.duration == pytest.approx(solution.stats["own duration"], rel=1e-2)
    assert verify(problem, motion).dilation < 1.1


def test_the_iterative_spline_without_added_points_is_a_cubic_within_its_limits() -> None:
    """Its own clamped spline: acceleration is continuous, and the executed quintics are cubics."""
    installed("iterative-spline")
    problem = load("six-axis")
    motion = IterativeSpline().tried(problem, "no points added", "limit", "natural").trajectory
    assert motion is not None
    certificate = verify(problem, motion)
    assert certificate.valid
    assert certificate.dilation < 1.005  # checked at its points, which its cubics join
    fourth = polynomials.derivative(motion.coefficients, 4)
    assert np.abs(fourth).max() < 1e-3  # rad/s⁴; jerks are of 10 rad/s³, pieces of 0.04 s
    np.testing.assert_allclose(motion(motion.waypoint_times), problem.waypoints, atol=1e-12)


def test_moveits_chain_is_longer_the_more_points_it_gets() -> None:
    """Its smoothing keeps one mean interval: between 20 points in a segment Ruckig needs more."""
    installed("totg-ruckig")
    problem = load("six-axis")
    chain = [
        TotgRuckig().tried(problem, count, "uniform", "not-a-knot").trajectory
        for count in (2, 5, 20)
    ]
    few, more, many = [motion.duration for motion in chain if motion is not None]
    assert few < more < many
