"""What a motion does at its ends, and whole turns: against closed forms."""

from __future__ import annotations

from math import pi, tau

import numpy as np
import pytest

from trajopt.core.limits import Limits
from trajopt.core.trajectory import Trajectory
from trajopt.judging.ends import standing, standing_of, states
from trajopt.judging.turns import unwrapped

LIMITS = Limits([2, 2], [5, 5], [100, 100])


def moved(t, before=0.0):
    """Two joints that stand, then follow a quintic over 1 s, then stand."""
    s = np.clip(t - before, 0, 1)
    q = 10 * s**3 - 15 * s**4 + 6 * s**5
    return np.stack([q, -q / 2], axis=-1)


def test_states_are_those_of_the_motion_within_its_limits():
    motion = Trajectory([0, 2], np.array([[[0.5]], [[3.0]], [[0.0]]]), [0, 2])
    found = states(motion, Limits([2], [1], [9]))
    # the highest power first: q = t²/2 + 3 t, so 3 to 5 rad/s at 1 rad/s²; 2 rad/s is the limit
    assert {name: own.tolist() for name, own in found.items()} == {
        "start_velocity": [2],
        "start_acceleration": [1],
        "end_velocity": [2],
        "end_acceleration": [1],
    }


@pytest.mark.parametrize("half", [1e-6, 1e-4, 1e-3])
@pytest.mark.parametrize(("before", "after"), [(0.3, 0.5), (0.0, 0.2)])
def test_a_recorded_motion_stands_as_long_as_it_does_within_its_doubt(before, after, half):
    t = np.arange(0, before + 1 + after + 1e-9, 0.002)
    found = standing(t, moved(t, before), np.array([half, half]), LIMITS)
    hidden = np.cbrt(12 * half / 100)
    assert found.doubt == pytest.approx(hidden)
    # the quintic starts with 60 of 100 rad/s³, and half of that in the other joint
    slack = hidden * np.cbrt(100 / 60) + 0.004
    assert before - 0.002 <= found.start <= before + slack
    assert after - 0.002 <= found.end <= after + slack
    assert found.moving == pytest.approx(t[-1] - found.start - found.end)
    assert bool(found) == (max(found.start, found.end) > hidden)


def test_a_motion_of_polynomials_stands_exactly_as_long_as_it_does():
    t = np.array([0, 0.25, 1.25, 1.75])
    pieces = np.zeros((4, 3, 1))
    pieces[:, 1, 0] = [-2, 3, 0, 0]  # 3 s² - 2 s³
    pieces[3, 2, 0] = 1
    found = standing_of(Trajectory(t, pieces, [0, 1.75]), Limits([2], [7], [20]))
    assert (found.start, found.end) == (0.25, 0.5)
    assert found.moving == 1
    assert found


def test_what_only_stands_stands_the_whole_time():
    found = standing(np.arange(5.0), np.zeros((5, 2)), np.zeros(2), LIMITS)
    assert (found.start, found.end, found.moving) == (4, 0, 4)


@pytest.mark.parametrize("rate", [50, 250, 1000])
@pytest.mark.parametrize("turn", [tau, 2 * tau])
def test_whole_turns_are_no_motion(rate, turn):
    t = np.arange(0, 6, 1 / rate)
    true = np.stack([1.9 * t, 9 * np.cos(0.2 * t)], axis=1)  # 1.9 and 1.8 rad/s at most
    whole, wrapped = np.divmod(true + pi, turn)
    found, rows = unwrapped(t, wrapped, np.full(2, 1e-3), LIMITS)
    assert found - found[0] == pytest.approx(true - true[0])
    assert rows == [np.flatnonzero(np.diff(own)).tolist() for own in whole.T]


@pytest.mark.parametrize("size", [3.0, 6.0, 6.5])
def test_other_jumps_stay(size):
    t = np.arange(0, 1, 0.01)
    q = np.where(t < 0.5, 0.0, size)[:, None]
    found, rows = unwrapped(t, q, np.array([1e-3]), Limits([2], [5]))
    assert (found == q).all()
    assert rows == [[]]


def test_a_joint_with_position_limits_and_one_that_slides_do_not_turn():
    t = np.arange(0, 1, 0.01)
    q = np.where(t < 0.5, 0.0, tau)[:, None]
    half = np.array([1e-3])
    assert unwrapped(t, q, half, Limits([2], [5], position=[[-7, 7]]))[1] == [[]]
    assert unwrapped(t, q, half, Limits([2], [5]), turns=(False,))[1] == [[]]
    assert unwrapped(t, q, half, Limits([2], [5]))[1] == [[49]]
