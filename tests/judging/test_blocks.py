"""A long motion is judged and repaired in blocks: the same bits, little memory."""

import tracemalloc

import numpy as np
import pytest

from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core import trajectory as motions
from trajopt.judging import repair
from trajopt.judging.tube import tube


def motion(jerk, miss):
    """Cubics, or quintics under jerk limits, whose states do not quite fit together."""
    times = np.linspace(0.0, 6.0, 61)
    phase = np.arange(3)
    positions = np.sin(times[:, None] + phase)
    velocities = np.cos(times[:, None] + phase)
    own = Trajectory.from_samples(times, positions, velocities, *([-positions] if jerk else []))
    coefficients = np.array(own.coefficients)
    coefficients[-1] += miss * np.random.default_rng(0).uniform(-1, 1, coefficients[-1].shape)
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
    limits = Limits([0.9] * 3, [2.0] * 3, [9.0] * 3 if jerk else None)
    problem = Problem(positions[lengths], limits, demands=ends)
    return problem, Trajectory(own.breaks, coefficients, times[lengths])


@pytest.mark.parametrize("jerk", [False, True])
@pytest.mark.parametrize("miss", [0.0, 1e-10, 1e-8])
def test_a_motion_in_blocks_has_the_same_certificate(monkeypatch, jerk, miss):
    problem, whole = motion(jerk, miss)
    expected = verify(problem, whole)
    assert expected.judged is not None
    monkeypatch.setattr(motions, "KEPT_VALUES", 100)
    monkeypatch.setattr(repair, "_MOST_CELLS", 0)
    monkeypatch.setattr(repair, "_BLOCK", 7)
    again = Trajectory(whole.breaks, whole.coefficients, whole.waypoint_times)
    assert len(list(again.blocks())) > 5
    found = verify(problem, again)
    assert found.as_dict() == expected.as_dict()
    assert found.flaws == expected.flaws
    np.testing.assert_array_equal(found.judged.coefficients, expected.judged.coefficients)


def held(function, *args, **options):
    """Return the most bytes that a call holds at a time."""
    tracemalloc.start()
    function(*args, **options)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return most


@pytest.mark.parametrize("walls", [None, [[-1.5, 1.5]] * 6])
def test_the_verdict_on_a_longer_motion_holds_little_beside_the_repaired_one(monkeypatch, walls):
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
    repaired = own.coefficients[:, 10_000:].nbytes
    assert most[1] - most[0] < 1.5 * repaired


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
