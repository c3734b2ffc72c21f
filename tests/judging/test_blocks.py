"""A long motion is judged block by block and repaired joint by joint: the same bits."""

import numpy as np
import pytest

from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core import trajectory as motions
from trajopt.judging import repair


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
    again = Trajectory(whole.breaks, whole.coefficients, whole.waypoint_times)
    assert len(list(again.blocks())) > 5
    found = verify(problem, again)
    assert found.as_dict() == expected.as_dict()
    assert found.flaws == expected.flaws
    np.testing.assert_array_equal(found.judged.coefficients, expected.judged.coefficients)
