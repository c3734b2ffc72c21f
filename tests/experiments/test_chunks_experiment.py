"""The measures of the experiment about chunks, beside closed forms."""

import numpy as np
import pytest

from experiments import chunks
from trajopt.benchmark.suites.chunks import JOINTS


def test_a_cubic_has_the_jerk_of_its_third_differences():
    step = 0.01
    times = np.arange(101) * step
    rows = np.outer(times**3, [1.0, 2.0])  # jerk 6 and 12
    assert chunks.jerk_integral(rows, step) == pytest.approx((36 + 144) * 98 * step, rel=1e-6)


def test_a_clamp_changes_nothing_that_is_slow_enough_and_limits_the_rest():
    slow = np.linspace(0, 0.1, 11)[:, None] * np.ones(JOINTS)
    assert chunks.followed(slow, 0.1, 1.0)[1:12] == pytest.approx(slow)
    fast = np.vstack([np.zeros(JOINTS), np.ones(JOINTS)])
    found = chunks.followed(fast, 0.1, 1.0)
    assert np.diff(found, axis=0).max() == pytest.approx(chunks.VELOCITY * 0.1)
    assert found[-1] == pytest.approx(np.ones(JOINTS))


def test_positions_that_are_sent_have_the_acceleration_of_their_second_differences():
    asked = chunks.chunk("smooth", 0)
    step = 0.02
    rows = np.zeros((60, JOINTS))
    rows[:, 0] = 0.5 * (np.arange(60) * step) ** 2  # 1 rad/s², then a stop from 1.18 rad/s
    found = chunks.sent("parabola", asked, rows, step)
    stop = (rows[-1, 0] - rows[-2, 0]) / step**2
    assert found["acceleration"] == pytest.approx(stop / chunks.ACCELERATION)
    assert found["velocity"] == pytest.approx(stop * step / chunks.VELOCITY)
