"""A long motion is judged and repaired in blocks: the same bits, little memory."""

import tracemalloc

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from tests import kinds
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core import trajectory as motions
from trajopt.judging import repair
from trajopt.judging.tube import tube


def motion(jerk, miss, speed=0.9, joints=(0, 1, 2)):
    """Cubics, or quintics under jerk limits; the states of some joints do not quite fit."""
    times = np.linspace(0.0, 6.0, 61)
    phase = np.arange(3)
    positions = np.sin(times[:, None] + phase)
    velocities = np.cos(times[:, None] + phase)
    own = Trajectory.from_samples(times, positions, velocities, *([-positions] if jerk else []))
    coefficients = np.array(own.coefficients)
    missed = miss * np.random.default_rng(0).uniform(-1, 1, coefficients[-2:].shape)
    coefficients[-2:, :, joints] += missed[..., joints]
    lengths = [0, 20, 60]
    ends = {
        "start_velocity": velocities[0],
        "end_velocity": velocities[-1],
        **(
            {"start_acceleration": -positions[0], "end_acceleration": -positions[-1]}
            if jerk
            else {}
        ),
    }
    limits = Limits([speed] * 3, [2.0] * 3, [9.0] * 3 if jerk else None)
    problem = Problem(positions[lengths], limits, demands=ends)
    return problem, Trajectory(own.breaks, coefficients, times[lengths])


def in_blocks(monkeypatch, whole):
    """Return the motion anew, which is judged in blocks from now on."""
    monkeypatch.setattr(motions, "KEPT_VALUES", 100)
    monkeypatch.setattr(repair, "_MOST_CELLS", 0)
    monkeypatch.setattr(repair, "_BLOCK", 7)
    again = Trajectory(whole.breaks, whole.coefficients, whole.waypoint_times)
    assert len(list(again.blocks())) > 3
    return again


@pytest.mark.parametrize("jerk", [False, True])
@pytest.mark.parametrize("miss", [0.0, 1e-10, 1e-8])
@pytest.mark.parametrize("joints", [(0, 1, 2), (1,)])
@pytest.mark.parametrize("speed", [0.9, 1.5])
def test_a_motion_in_blocks_has_the_same_certificate(monkeypatch, jerk, miss, joints, speed):
    problem, whole = motion(jerk, miss, speed, joints)
    expected = verify(problem, whole)
    assert expected.judged is not None
    found = verify(problem, in_blocks(monkeypatch, whole))
    assert found.as_dict() == expected.as_dict()
    assert found.flaws == expected.flaws
    assert found.valid == (speed > 1)
    assert (found.repair is None) == (found.judged is not None) == (not found.valid)
    ours = found.certified_motion if found.valid else found.judged
    theirs = expected.judged
    np.testing.assert_array_equal(ours.coefficients, theirs.coefficients)


@pytest.mark.parametrize("walls", [None, [[-0.5, 2.0]] * 2])
def test_a_motion_in_blocks_is_slowed_down_as_far(monkeypatch, walls):
    times = np.linspace(0.0, 4.0, 41)
    share = times[:, None] / 4
    positions = share**2 * (3 - 2 * share) * [1.0, 2.0]
    velocities = 6 * share * (1 - share) / 4 * [1.0, 2.0]
    whole = Trajectory.from_samples(times, positions, velocities)
    problem = Problem(positions[[0, -1]], Limits([1.0, 0.5], [9.0, 9.0], position=walls))
    expected = verify(problem, whole)
    assert expected.dilation == pytest.approx(1.5, rel=1e-9)  # 6/4 · 1/4 · 2 over 0.5
    found = verify(problem, in_blocks(monkeypatch, whole))
    assert found.as_dict() == expected.as_dict()
    ours, theirs = found.certified_motion, expected.certified_motion
    np.testing.assert_array_equal(ours.coefficients, theirs.coefficients)
    assert verify(problem, ours).feasible


@pytest.mark.usefixtures("strangers")
@pytest.mark.parametrize(
    "stranger",
    [
        {"pendulum_torque": {"gravity": [0.5, 0.5], "torque": [0.55, 0.55]}},
        {"motor_power": {"power": [0.05, 0.05]}},
    ],
)
def test_a_limit_of_each_joint_alone_that_a_stranger_wrote_is_judged_as_in_one(
    monkeypatch, stranger
):
    """The dilation under the first is no power of its use: it is one of the repaired motion."""
    monkeypatch.setattr(kinds.Torque, "separate", True)
    monkeypatch.setattr(kinds.Torque, "monotone", True)
    times = np.linspace(0.0, 4.0, 41)
    share = times[:, None] / 4
    positions = share**2 * (3 - 2 * share) * [1.0, 0.5]
    velocities = 6 * share * (1 - share) / 4 * [1.0, 0.5]
    given = Trajectory.from_samples(times, positions, velocities)
    coefficients = np.array(given.coefficients)
    coefficients[-2] += 1e-7 * np.random.default_rng(0).uniform(-1, 1, coefficients[-2].shape)
    whole = Trajectory(given.breaks, coefficients, given.waypoint_times)
    problem = Problem(positions[[0, -1]], Limits([1.0] * 2, [9.0] * 2, **stranger))
    expected = verify(problem, whole)
    assert expected.valid
    assert expected.dilation > 1.01
    found = verify(problem, in_blocks(monkeypatch, whole))
    assert found.as_dict() == expected.as_dict()


def test_joints_of_other_degrees_in_blocks_have_the_same_certificate(monkeypatch):
    """Cubics; where jerk is limited their acceleration does not jump either, but for 1e-9 rad/s².

    The correction of such a joint is a quintic.
    """
    times = np.linspace(0.0, 6.0, 61)
    spline = CubicSpline(times, np.sin(times[:, None] + np.arange(3)), bc_type="clamped")
    coefficients = np.array(spline.c)
    coefficients[1] += 1e-9 * np.random.default_rng(0).uniform(-1, 1, coefficients[1].shape)
    ends = {
        f"{end}_acceleration": spline(t, 2) * [0, 1, 0] for end, t in (("start", 0.0), ("end", 6.0))
    }
    limits = Limits([1.5] * 3, [100.0] * 3, [np.inf, 1500.0, np.inf])
    problem = Problem(spline(times[[0, -1]]), limits, demands=ends)
    whole = Trajectory(times, coefficients, times[[0, -1]])
    expected = verify(problem, whole)
    assert expected.valid
    assert len(expected.judged.coefficients) == 6
    found = verify(problem, in_blocks(monkeypatch, whole))
    assert found.as_dict() == expected.as_dict()
    np.testing.assert_array_equal(found.certified_motion.coefficients, expected.judged.coefficients)


def held(function, *args, **options):
    """Return the most bytes that a call holds at a time."""
    tracemalloc.start()
    function(*args, **options)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most


@pytest.mark.parametrize("walls", [None, [[-1.5, 1.5]] * 6])
def test_the_verdict_on_a_longer_motion_holds_less_than_a_second_one(monkeypatch, walls):
    monkeypatch.setattr(motions, "KEPT_VALUES", 20_000)
    monkeypatch.setattr(repair, "_MOST_CELLS", 20_000)
    monkeypatch.setattr(repair, "_BLOCK", 500)
    most = []
    for count in (10_000, 20_000):
        times = np.linspace(0.0, 6.0, count + 1)
        phase = np.arange(6)
        own = Trajectory.from_samples(
            times, np.sin(times[:, None] + phase), np.cos(times[:, None] + phase)
        )
        ends = {"start_velocity": own(0.0, 1), "end_velocity": own(6.0, 1)}
        limits = Limits([1.5] * 6, [2.0] * 6, position=walls)
        problem = Problem(own(own.waypoint_times), limits, demands=ends)
        most.append(held(verify, problem, own))
    assert most[1] - most[0] < 0.75 * own.coefficients[:, 10_000:].nbytes


def test_a_longer_log_holds_memory_in_proportion():
    most = []
    for count in (2_000, 4_000):
        times = np.arange(count) * 1e-3
        half = np.full(count, 1e-6)
        limits = [(-2.0, 2.0), (-10.0, 10.0)]
        options = {"rest": True, "rounds": 1}
        if not most:  # imports hold memory, too
            tube(times, np.sin(times) ** 2, half, limits, **options)
        most.append(held(tube, times, np.sin(times) ** 2, half, limits, **options))
    assert most[1] - most[0] < 2_300 * 2_000
