"""Rows of limits in both transcriptions, against closed forms; the arithmetic, against NumPy's."""

from __future__ import annotations

from collections.abc import Iterator
from math import comb

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import Polynomial as Power

from baselines.collocation.refined import CollocationRefined
from baselines.collocation.symbols import NotPolynomialError, Polynomial, Symbol
from baselines.collocation.uniform import Collocation
from tests.test_new_limit import SpeedSum
from trajopt import Limits, Problem, Status, verify
from trajopt.core.limits import KINDS
from trajopt.core.limits.rows import JointState, Row, positive


class PlannedSpeedSum(SpeedSum):
    """|v1| + |v2| ≤ S of the first two joints, in rows."""

    key = "planned_speed_sum"

    @classmethod
    def read(cls, value, joints):
        return cls(np.array([[value], [value]]))

    def rows(self, at: JointState) -> Iterator[Row]:
        highest = self.numbers[0, 0]
        yield Row((at.v[0] + at.v[1]) / highest, -1.0, 1.0)
        yield Row((at.v[0] - at.v[1]) / highest, -1.0, 1.0)


class Apart(PlannedSpeedSum):
    """|a1 − a2| ≤ S."""

    key = "apart"
    degree = 2

    def rows(self, at: JointState) -> Iterator[Row]:
        yield Row((at.a[0] - at.a[1]) / self.numbers[0, 0], -1.0, 1.0)

    def _signed(self, motion):
        first, second = np.moveaxis(motion.pieces(2), -1, 0) / self.numbers[0, 0]
        return np.stack([first - second, second - first], axis=1)


OWN = {kind.key: kind for kind in (PlannedSpeedSum, Apart)}
for key in OWN:
    del KINDS[key]  # they are there in the tests below only


@pytest.fixture(autouse=True)
def known(monkeypatch):
    for key, kind in OWN.items():
        monkeypatch.setitem(KINDS, key, kind)


# Both joints move 1 rad the other way, to rest. With S = 0.8 each moves at 0.4 rad/s and speeds up
# at 2 rad/s²: 1 / 0.4 + 0.4 / 2 s. With S = 2 each speeds up at 1 rad/s²: 2 sqrt(1 / 1) s.
CLOSED_FORMS = [
    (1.0, {"planned_speed_sum": 0.8}, 2.7),
    (5.0, {"apart": 2.0}, 2.0),
]


@pytest.mark.parametrize(("velocity", "others", "optimum"), CLOSED_FORMS)
def test_a_row_of_two_joints_is_planned(velocity, others, optimum):
    limits = Limits([velocity] * 2, [2, 2], **others)
    problem = Problem([[0.0, 0.0], [1.0, -1.0]], limits)
    found = CollocationRefined(starts=2).solve(problem)
    certificate = verify(problem, found.trajectory)
    assert certificate.feasible
    assert optimum * (1 - 1e-9) < certificate.certified_duration < optimum * (1 + 1e-7)
    uniform = verify(problem, Collocation().solve(problem).trajectory)
    assert uniform.feasible
    assert optimum * (1 - 1e-9) < uniform.certified_duration < optimum * 1.02


def test_a_kind_without_rows_is_refused(monkeypatch):
    monkeypatch.setitem(KINDS, "speed_sum", SpeedSum)
    limits = Limits([1, 1], [2, 2], speed_sum={"joints": [1, 2], "sum": 0.8})
    found = Collocation().solve(Problem([[0.0, 0.0], [1.0, -1.0]], limits))
    assert found.status is Status.UNSUPPORTED
    assert "speed sum" in found.message


def bernstein(power: Power, degree: int) -> list[float]:
    """Return Bernstein coefficients on the unit interval, by values at as many points."""
    at = np.linspace(0, 1, degree + 1)
    table = [
        [comb(degree, k) * s**k * (1 - s) ** (degree - k) for k in range(degree + 1)] for s in at
    ]
    return np.linalg.solve(table, power(at)).tolist()


def test_polynomials_compute_as_numpy_s_do():
    p, q = Power([1.0, -2.0, 0.5]), Power([0.3, 0.7])
    x = Polynomial([ca.DM([c]) for c in bernstein(p, 2)], continuous=True)
    y = Polynomial([ca.DM([c]) for c in bernstein(q, 1)], continuous=False)

    def formula(a, b):
        return 2 * a - a * b**3 / 4 + b * b - 1.5

    found = formula(x, y)
    expected = bernstein(formula(p, q), 5)
    assert [float(part) for part in found.parts] == pytest.approx(expected, abs=1e-13)
    assert not found.continuous
    assert (x + x * 2).continuous
    assert float(found.at(0.3)) == pytest.approx(formula(p(0.3), q(0.3)), abs=1e-13)
    matrix = np.array([[1.0, 2.0], [0.0, -1.0]]) @ np.array([x, y], dtype=object)
    assert float(matrix[0].at(0.5)) == pytest.approx(p(0.5) + 2 * q(0.5), abs=1e-13)
    of_intervals = x * np.array([1.0, 2.0])  # a limit that differs from segment to segment
    assert not of_intervals.continuous


def test_what_is_no_polynomial_says_so():
    x = Polynomial([ca.MX.sym("x", 3)], continuous=True)
    for function in (
        np.cos,
        np.abs,
        lambda own: 1 / own,
        lambda own: own**-1,
        lambda own: own**0.5,
    ):
        with pytest.raises(NotPolynomialError):
            function(x)


def test_symbols_compute_as_numbers_do():
    x = ca.MX.sym("x", 3)
    numbers = np.array([0.1, 0.2, 0.7])

    def formula(own):
        entries = np.array([own, own], dtype=object) if isinstance(own, Symbol) else [own, own]
        both = np.array([[1.0, 2.0]]) @ np.asarray(entries)
        return np.cos(own) * both[0] + np.maximum(own, 0.15) - np.abs(-own) ** 2 / numbers

    function = ca.Function("f", [x], [formula(Symbol(x)).column])
    found = np.asarray(function(numbers)).ravel()
    assert found == pytest.approx(formula(numbers), abs=1e-15)
    sine = ca.Function("f", [x], [np.sin(np.array([Symbol(x)], dtype=object))[0].column])
    assert np.asarray(sine(numbers)).ravel() == pytest.approx(np.sin(numbers), abs=1e-15)


@pytest.mark.parametrize("value", [-1.0, -1e-3, 0.0, 1e-3, 2.0])
def test_the_corner_of_positive_is_above_it(value):
    smooth = float(positive(Polynomial([ca.DM([value])], continuous=True), 1e-3).parts[0])
    assert positive(value, 1e-3) == max(0.0, value)
    assert max(0.0, value) < smooth <= max(0.0, value) + 0.5e-3
