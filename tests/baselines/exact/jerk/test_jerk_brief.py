"""Segments a millionth of the others: the motion is certified, and near the optimum."""

import pytest

from baselines.exact.jerk import ExactJerk
from experiments.known_optima import end_to_end, one_way
from trajopt import verify


@pytest.mark.parametrize("seed", [106, 112, 185])
def test_a_brief_segment_does_not_spoil_the_motion(seed):
    """One joint, one way: Ruckig's from end to end is the optimum. Breaks' rounding spoilt it."""
    problem = one_way(seed)
    certificate = verify(problem, ExactJerk().solve(problem).trajectory)
    assert certificate.valid
    assert certificate.certified_duration == pytest.approx(end_to_end(problem), rel=2e-7)
