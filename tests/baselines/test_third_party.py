"""Other people's planners against closed forms, and what is said where they are not installed."""

from __future__ import annotations

import importlib.util

import numpy as np
import pytest

from baselines.third_party import imported
from baselines.third_party.rtb_jtraj import RtbJtraj
from baselines.topp_ra import ToppRa
from trajopt import Limits, MissingBackend, Problem, Status, Trajectory, verify
from trajopt.benchmark.suites.catalogue import load
from trajopt.planner import Planner
from trajopt.registry import entries
from trajopt.registry import load as planner

NAMES = [name for name, entry in entries().items() if "third_party" in entry.point.module]


def installed(spec: str) -> Planner:
    """The planner, or a skipped test that says what to install."""
    missing = entries()[spec.partition(":")[0]].missing()
    if missing is not None:
        pytest.skip(missing)
    return planner(spec)


def certified(spec: str, problem: Problem) -> float:
    solution = installed(spec).solve(problem)
    assert solution.status is Status.SOLVED
    assert isinstance(solution.trajectory, Trajectory)
    duration = verify(problem, solution.trajectory).certified_duration
    assert duration is not None
    return duration


@pytest.mark.parametrize("name", NAMES)
def test_where_it_is_not_installed_the_extra_is_named(
    name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    own = entries()[name].load()
    missing = entries()[name].missing()
    assert missing is not None
    assert missing.endswith(f'pip install "trajopt[{own.extra}]"')


def test_an_import_that_fails_names_the_extra() -> None:
    with pytest.raises(MissingBackend, match=r'pip install "trajopt\[some\]"'):
        imported("no_such_package.inside", "some")


def test_jtraj_stops_with_quintics() -> None:
    """Peaks 15/8 h/T, 10/√3 h/T² and 60 h/T³, each segment on its own."""
    limits = Limits([1.0], [2.0], [10.0])
    problem = Problem([[0.0], [0.1], [2.1]], limits)
    short = max(15 / 8 * 0.1, np.sqrt(10 / np.sqrt(3) * 0.1 / 2), np.cbrt(60 * 0.1 / 10))
    long = max(15 / 8 * 2, np.sqrt(10 / np.sqrt(3) * 2 / 2), np.cbrt(60 * 2 / 10))
    assert certified("rtb-jtraj:velocities=zero", problem) == pytest.approx(short + long, rel=1e-9)
    assert RtbJtraj().solve(problem).stats["zero"] == pytest.approx(short + long, rel=1e-9)


def test_least_jerk_between_two_points_is_the_quintic() -> None:
    """10 s³ − 15 s⁴ + 6 s⁵, its velocity the limit: T = 15/8 h/V."""
    problem = Problem([[0.0], [3.0]], Limits([1.0], [20.0]))
    duration = certified("minsnap:minimised=jerk,knots=uniform", problem)
    assert duration == pytest.approx(15 / 8 * 3, rel=1e-9)


@pytest.mark.parametrize("rule", ["knots=limit,ends=natural", "knots=chord,ends=clamped"])
def test_two_implementations_of_toppra_agree(rule: str) -> None:
    problem = load("asymmetric")
    theirs = certified(f"drake-toppra:{rule},gridpoints=300", problem)
    ours = certified(f"toppra:{rule},gridpoints=300", problem)
    assert theirs == pytest.approx(ours, rel=2e-2)
    assert ToppRa(gridpoints=300).unsupported(problem) is None


def test_copp_without_jerk_limits_is_toppra() -> None:
    problem = load("six-axis")
    rule = "knots=limit,ends=natural,gridpoints=300"
    assert certified(f"copp:{rule}", problem) == pytest.approx(
        certified(f"toppra:{rule}", problem), rel=1e-2
    )


def test_copp_and_kto_keep_jerk_limits_by_themselves() -> None:
    problem = load("jerk-limit")
    for spec in ("copp:knots=limit,ends=natural", "drake-kto:knots=limit"):
        solution = installed(spec).solve(problem)
        assert solution.trajectory is not None
        assert verify(problem, solution.trajectory).dilation < 1.01


def test_kto_is_a_bspline_through_the_waypoints() -> None:
    problem = load("position-limits")
    solution = installed("drake-kto:order=6,knots=chord").solve(problem)
    assert solution.trajectory is not None
    certificate = verify(problem, solution.trajectory)
    assert certificate.feasible
    assert len(solution.trajectory.coefficients) == 6
    chords = np.linalg.norm(problem.displacements, axis=1)
    shares = np.r_[0, np.cumsum(chords)] / chords.sum()
    times = solution.trajectory.waypoint_times / solution.trajectory.duration
    np.testing.assert_allclose(times, shares, atol=1e-12)


def test_totg_passes_the_points_of_the_path() -> None:
    problem = load("six-axis")
    solution = installed("totg:knots=uniform,ends=natural").solve(problem)
    assert solution.trajectory is not None
    assert verify(problem, solution.trajectory).valid
    at = solution.trajectory.waypoint_times
    np.testing.assert_allclose(solution.trajectory(at), problem.waypoints, atol=1e-12)
