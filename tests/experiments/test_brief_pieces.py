"""Brief pieces of a motion, and those that it could do without, in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from experiments.common.brief_pieces import brief, needless
from trajopt import Limits, Problem, Trajectory, verify


def rest_to_rest(ramp: float, *cuts: float) -> tuple[Problem, Trajectory]:
    """The least time with a jerk of 1: up for a ramp, down for two, up for one; cut elsewhere."""
    switches = ramp * np.array([0.0, 1.0, 3.0, 4.0])
    breaks = np.unique([*switches, *cuts])
    middles = (breaks[:-1] + breaks[1:]) / 2
    jerk = np.where(np.abs(middles - 2 * ramp) < ramp, -1.0, 1.0)
    states = [(0.0, 0.0, 0.0)]
    for length, own in zip(np.diff(breaks), jerk, strict=True):
        a, v, q = states[-1]
        speed = v + a * length + own * length**2 / 2
        place = q + v * length + a * length**2 / 2 + own * length**3 / 6
        states.append((a + own * length, speed, place))
    acceleration, velocity, position = np.transpose(states)
    rows = jerk / 6, acceleration[:-1] / 2, velocity[:-1], position[:-1]
    motion = Trajectory(breaks, np.array(rows)[..., None], breaks[[0, -1]])
    # twice its ramp cubed
    problem = Problem([[0.0], [2 * ramp**3]], Limits([10.0], [10.0], [1.0]))
    return problem, motion


@pytest.mark.parametrize(
    ("ramp", "cuts", "brief_pieces", "unused"),
    [
        (1.0, (), 0, 0),
        # a break 5e-7 s after another one, where jerk does not change
        (1.0, (2.0, 2.0 + 5e-7), 1, 1),
        (1.0, (0.5e-6,), 1, 1),
        # without a change of jerk the motion takes longer
        (4e-7, (), 3, 0),
    ],
)
def test_a_brief_piece_is_needless_where_jerk_does_not_change(
    ramp: float, cuts: tuple[float, ...], brief_pieces: int, unused: int
) -> None:
    problem, motion = rest_to_rest(ramp, *cuts)
    assert verify(problem, motion).dilation <= 1 + 1e-12
    assert len(brief(motion)) == brief_pieces
    assert needless(problem, motion) == unused
