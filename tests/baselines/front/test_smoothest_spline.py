"""The smoothest spline without limits, beside SciPy's splines and a search by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.optimize import minimize_scalar

from baselines.front.smoothest_spline import SmoothestSpline

Q = np.array([[0.0, 1.0], [0.4, 1.3], [0.5, -1.0], [2.0, -1.0], [1.9, 0.0]])
WEIGHTS = np.array([1.0, 0.3])
TIMES = np.array([0.7, 0.4, 1.1, 1e-2])
VELOCITY = np.array([[0.2, -0.1], [0.0, 0.3]])
ACCELERATION = np.array([[-1.0, 0.0], [0.5, 2.0]])


def spline_of(order):
    ends = [VELOCITY, ACCELERATION] if order == 3 else [VELOCITY]
    return SmoothestSpline(Q, ends, WEIGHTS, order)


def by_scipy(q, ends, weights, order, times):
    """The interpolating spline is the smoothest one (de Boor); its integral by quadrature."""
    breaks = np.append(0.0, np.cumsum(times))
    sides = [[(rate + 1, own[side]) for rate, own in enumerate(ends)] for side in (0, 1)]
    spline = make_interp_spline(breaks, q, 2 * order - 1, bc_type=tuple(sides))
    points, shares = np.polynomial.legendre.leggauss(5)
    at = breaks[:-1, None] + times[:, None] * (points + 1) / 2
    squares = spline.derivative(order)(at) ** 2 @ weights
    value = (squares * shares * times[:, None] / 2).sum()
    return value, [spline.derivative(rate)(breaks) for rate in range(order)]


@pytest.mark.parametrize("order", [2, 3])
def test_given_times_make_the_interpolating_spline(order):
    smoothest = spline_of(order)
    value, _, states = smoothest.least(TIMES)
    expected, known = by_scipy(Q, smoothest.ends, WEIGHTS, order, TIMES)
    assert value == pytest.approx(expected, rel=1e-9)
    for own, right in zip(states, known, strict=True):
        np.testing.assert_allclose(own, right, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("order", [2, 3])
def test_the_derivative_is_that_of_the_integral(order):
    smoothest = spline_of(order)
    _, rate, _ = smoothest.least(TIMES)
    for segment, time in enumerate(TIMES):
        step = np.zeros(len(TIMES))
        step[segment] = 1e-6 * time
        up, down = (smoothest.least(TIMES + sign * step)[0] for sign in (1, -1))
        assert rate[segment] == pytest.approx((up - down) / (2e-6 * time), rel=1e-4)


@pytest.mark.parametrize(("order", "ratio"), [(2, 5.0), (3, 0.3), (3, 1e-3)])
def test_two_segments_share_their_time_best(order, ratio):
    q = np.array([[0.0], [1.0], [1.0 + ratio]])
    rest = [np.zeros((2, 1))] * (order - 1)
    weights = np.ones(1)

    def value(first):
        return by_scipy(q, rest, weights, order, np.array([first, 2 - first]))[0]

    best = minimize_scalar(value, bounds=(0.01, 1.99), options={"xatol": 1e-10}, method="bounded")
    times = SmoothestSpline(q, rest, weights, order).best_times(np.ones(2))
    assert times.sum() == pytest.approx(2.0, rel=1e-12)
    assert times[0] == pytest.approx(best.x, rel=1e-5)
    assert value(times[0]) <= best.fun * (1 + 1e-9)
