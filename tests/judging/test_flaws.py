"""`flaws` finds what `verify` finds; peaks and repair are left out where a dilation mends all."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging import verification
from trajopt.judging.verification import flaws, verify

WAYPOINTS = np.array([[0.0, 0.3], [0.4, -0.2], [0.9, 0.1]])
V, A = [0.2, 0.3], [0.5, 0.6]  # the motion below breaks them
LIMITS = Limits(V, A)
PROBLEMS = {
    "plain": {},
    "jerk": {"limits": Limits(V, A, [2, 2])},
    "range": {"limits": Limits(V, A, position=[1, 1])},
    "tolerance": {"tolerance": [0.01, 0.0]},
    "least times": {"least_times": [2.0, 0.5]},
    "least duration": {"least_duration": 3.0},
    "waits": {"dwell": [0.0, 0.1, 0.0]},
    "given times": {"given_times": [1.0, 1.0]},
    "in motion": {"start_velocity": [0.1, 0.0]},
}


def stopping(*place: float) -> Trajectory:
    """Return quintics from rest to rest, a second each; by default through the middle waypoint."""
    waypoints = np.array([WAYPOINTS[0], place or WAYPOINTS[1], WAYPOINTS[2]])
    blend = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])
    coefficients = blend[:, None, None] * np.diff(waypoints, axis=0)
    coefficients[-1] = waypoints[:-1]
    times = np.arange(len(waypoints), dtype=float)
    return Trajectory(times, coefficients, times)


def bent(order: int, by: float) -> Trajectory:
    """Return that motion with a derivative of its second piece's start changed."""
    motion = stopping()
    coefficients = np.array(motion.coefficients)
    coefficients[-1 - order, 1, 0] += by
    return replace(motion, coefficients=coefficients)


def at_one_instant() -> Trajectory:
    """Return that motion with a waypoint passed when the last one is."""
    return replace(stopping(), waypoint_times=np.array([0.0, 2.0, 2.0]))


MOTIONS: dict[str, Callable[[], Trajectory]] = {
    "right": stopping,
    "nearly right": lambda: bent(0, 1e-9),
    "misses": lambda: stopping(0.4, -0.201),
    "jumps": lambda: bent(1, 1e-3),
    "bends": lambda: bent(2, 1e-3),
    "at one instant": at_one_instant,
    "leaves the range": lambda: stopping(2.4, -0.2),
}


@pytest.mark.parametrize("motion", MOTIONS)
@pytest.mark.parametrize("asked", PROBLEMS)
def test_they_are_those_of_the_certificate(asked: str, motion: str) -> None:
    problem = Problem(WAYPOINTS, **{"limits": LIMITS, **PROBLEMS[asked]})
    found = MOTIONS[motion]()
    assert flaws(problem, found) == verify(problem, found).flaws


def test_equal_places_of_one_instant_are_no_flaw_and_different_ones_are() -> None:
    """Both within what is repaired: only the layout of the repair tells."""
    near = Problem([[0.0], [1.0], [1.0 + 1e-9], [2.0]], Limits([1], [1]))
    blend = np.array([6.0, -15.0, 10.0, 0.0, 0.0, 0.0])[:, None, None]
    coefficients = blend * np.array([[1.0], [1.0]])
    coefficients[-1] = [[0.0], [1.0]]
    motion = Trajectory([0.0, 1.0, 2.0], coefficients, [0.0, 1.0, 1.0, 2.0])
    assert "one instant" in flaws(near, motion)[0]
    same = Problem([[0.0], [1.0], [1.0], [2.0]], Limits([1], [1]))
    assert flaws(same, motion) == ()


def test_no_peak_is_computed_where_none_decides(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither the worst use of a limit nor the repaired motion."""
    monkeypatch.setattr(verification, "repaired", None)
    monkeypatch.setattr(Limits, "worst", None)
    assert flaws(Problem(WAYPOINTS, LIMITS), stopping()) == ()
