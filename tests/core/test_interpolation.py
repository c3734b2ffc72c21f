"""Interpolations of samples against closed forms and SciPy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BPoly

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import verify

RNG = np.random.default_rng(11)
TIMES = 3.0 + np.r_[0.0, np.cumsum(10.0 ** RNG.uniform(-3, 1, 9))]
VALUES = RNG.normal(size=(3, 10, 2))


@pytest.mark.parametrize(("given", "kind"), [(1, "linear"), (2, "cubic"), (3, "quintic")])
def test_pieces_are_the_hermite_polynomials_of_what_the_samples_have(given, kind):
    trajectory = Trajectory.from_samples(TIMES, *VALUES[:given])
    named = Trajectory.from_samples(TIMES, *VALUES, interpolation=kind)
    assert np.array_equal(trajectory.coefficients, named.coefficients)
    assert len(trajectory.coefficients) == 2 * given
    at_samples = np.moveaxis(VALUES[:given], 0, 1)
    reference = BPoly.from_derivatives(TIMES - TIMES[0], at_samples)
    times = np.linspace(0, trajectory.duration, 500)
    np.testing.assert_allclose(trajectory(times), reference(times), rtol=0, atol=1e-11)


def test_the_spline_is_at_rest_and_its_acceleration_does_not_jump():
    trajectory = Trajectory.from_samples(TIMES, VALUES[0], interpolation="spline")
    np.testing.assert_allclose(trajectory(trajectory.breaks), VALUES[0], atol=1e-12)
    ends = trajectory([0, trajectory.duration], 1)
    np.testing.assert_allclose(ends, 0, atol=1e-9)
    for order in (1, 2):
        pieces = trajectory.pieces(order)
        jumps = pieces.sum(axis=0)[:-1] - pieces[-1, 1:]
        np.testing.assert_allclose(jumps, 0, atol=1e-9 * np.abs(pieces).max())


def bang_bang(step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """From 0 to 1 rad with |a| = 1 rad/s²: samples on a grid that misses the switch at 1 s."""
    inner = np.arange(0.3 * step, 2.0, step)
    t = np.r_[0.0, inner[inner < 2.0 - 1e-9], 2.0]
    rising = t <= 1
    q = np.where(rising, t**2 / 2, 1 - (2 - t) ** 2 / 2)
    v = np.where(rising, t, 2 - t)
    a = np.where(rising, 1.0, -1.0)
    return t, q[:, None], v[:, None], a[:, None]


@pytest.mark.parametrize("step", [0.1, 0.02, 0.004])
def test_sampling_does_not_lower_the_overshoot_of_quintics(step):
    """Mathematics, section 11: 1.2 to 1.75 times the limit, whatever the step."""
    t, q, v, a = bang_bang(step)
    limits = Limits([10.0], [1.0])
    problem = Problem([[0.0], [1.0]], limits)
    certificate = verify(problem, Trajectory.from_samples(t, q, v, a))
    assert 1.2 < certificate.acceleration.value < 1.76
    assert abs(certificate.acceleration.time - 1) < step


def test_sent_at_its_breaks_a_motion_is_reproduced():
    """A cubic Hermite piece is any quadratic piece's twin: here the optimum, at 1.000."""
    t = np.array([0.0, 1.0, 2.0])
    limits = Limits([10.0], [1.0])
    problem = Problem([[0.0], [1.0]], limits)
    executed = Trajectory.from_samples(t, [[0.0], [0.5], [1.0]], [[0.0], [1.0], [0.0]])
    found = executed.coefficients[:, :, 0].T.tolist()
    assert found == [[0, 0.5, 0, 0], [0, -0.5, 1, 0.5]]
    certificate = verify(problem, executed)
    assert certificate.acceleration.value == pytest.approx(1, abs=1e-14)
    optimum = 2.0  # 2 sqrt(h / A)
    assert certificate.certified_duration == pytest.approx(optimum, rel=1e-13)


def test_positions_alone_are_run_with_jumps_of_velocity():
    limits = Limits([10.0], [10.0])
    problem = Problem([[0.0], [1.0]], limits)
    executed = Trajectory.from_samples([0, 1, 2], [[0.0], [0.5], [1.0]])
    certificate = verify(problem, executed)
    assert certificate.certified_duration is None
    assert "velocity jumps by 0.5 rad/s" in certificate.flaws[0]


@pytest.mark.parametrize(
    ("samples", "interpolation", "said"),
    [
        (([0.0], [[0.0]]), "auto", "positions is (1, 1): expected at least two samples"),
        (([0.0, 1.0], [0.0, 1.0]), "auto", "positions is (2,)"),
        (([0.0, 1.0], np.empty((2, 0))), "auto", "positions is (2, 0)"),
        (([0.0, 1.0, 2.0], [[0.0], [1.0]]), "auto", "times is (3,): expected 2, one per sample"),
        (([0.0, 0.0], [[0.0], [1.0]]), "auto", "times, sample 2 is 0.0: expected a time after 0"),
        (([0.0, np.nan], [[0.0], [1.0]]), "auto", "times, sample 2 is nan"),
        (([0.0, 1.0], [[0.0], [np.inf]]), "auto", "positions, sample 2, joint 1 is inf"),
        (([0, 1], [[0.0], [1.0]], [[0.0]]), "auto", "velocities is (1, 1): expected an array (2"),
        (([0, 1], [[0.0], [1.0]], None, [[0.0]] * 2), "auto", "accelerations: expected velocit"),
        (([0, 1], [[0.0], [1.0]]), "cubic", "interpolation is 'cubic': expected linear or spline"),
        (([0, 1], [[0.0], [1.0]], [[0.0]] * 2), "quintic", "interpolation is 'quintic'"),
        (([0, 1], [[0.0], [1.0]]), "septic", "expected one of auto, linear, cubic"),
    ],
)
def test_samples_that_are_no_motion_are_refused(samples, interpolation, said):
    with pytest.raises(InvalidInput) as caught:
        Trajectory.from_samples(*samples, interpolation=interpolation)
    assert said in str(caught.value)
