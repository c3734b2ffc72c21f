"""The figure of a front says how far one motion is above the least, and how short it can be."""

from __future__ import annotations

import numpy as np

from trajopt import Trajectory, problem
from trajopt.benchmark.front import Beside, Front
from trajopt.judging.smoothness import FrontPoint
from trajopt.views.figures.front import curve

REST = Trajectory([0.0, 1.0], np.zeros((1, 1, 6)), [0.0, 1.0])  # not drawn
FRONT = Front(
    problem("six-axis"),
    "jerk",
    (FrontPoint(1.0, 100.0, 99.0, REST), FrontPoint(2.0, 100 / 32, 99 / 32, REST)),
)


def texts(beside):
    shown = curve(FRONT, beside).axes[0].texts
    return [own.get_text() for own in shown if own.get_text()]


def test_the_motion_farthest_above_the_least_has_its_sentence():
    beside = [
        Beside("exact", 0.9, np.inf, np.inf, None),
        Beside("near", 1.5, 20.0, 1.5, 1.4),
        Beside("far", 2.0, 50.0, 16.0, 1.15),
    ]
    assert texts(beside)[-2:] == ["16 times the least", "as smooth in 1.15 s"]


def test_motions_that_jump_have_none():
    assert not any("least" in own for own in texts([Beside("exact", 0.9, np.inf, np.inf, None)]))
