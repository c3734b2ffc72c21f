"""Rows of limits in both transcriptions, against closed forms; the arithmetic, against NumPy's."""

from __future__ import annotations

from math import comb, sin

import casadi as ca
import numpy as np
import pytest
from numpy.polynomial import Polynomial as Power
from scipy.integrate import quad
from scipy.optimize import brentq

from baselines.collocation.refined import CollocationRefined
from baselines.collocation.symbols import NotPolynomialError, Polynomial, Symbol
from baselines.collocation.uniform import Collocation
from experiments.torque import CopsArm, cops
from tests.test_new_limit import SpeedSum
from trajopt import Limits, Problem, Status, Trajectory, verify
from trajopt.core.limits import KINDS
from trajopt.core.limits.rows import Row, positive


def closest(problem: Problem) -> tuple[float, float]:
    """Return the certified duration of `collocation-refined`, s, and its stated error."""
    found = CollocationRefined(starts=1, refinements=1).solve(problem)
    assert found.status is Status.SOLVED, found.message
    certificate = verify(problem, found.trajectory)
    assert certificate.feasible
    return certificate.certified_duration, found.stats["error_estimate"]


# Both joints move 1 rad the other way, to rest. With 0.8 rad/s together each moves at 0.4 rad/s and
# speeds up at 2 rad/s²: 1 / 0.4 + 0.4 / 2 s. With 2 rad/s² apart each speeds up at 1 rad/s².
CLOSED_FORMS = [
    (1.0, {"speeds_together": {"sum": 0.8}}, 2.7),
    (5.0, {"apart": {"difference": 2.0}}, 2.0),
]


@pytest.mark.usefixtures("strangers")
@pytest.mark.parametrize(("velocity", "others", "optimum"), CLOSED_FORMS)
def test_a_row_of_two_joints_is_planned(velocity, others, optimum):
    limits = Limits([velocity] * 2, [2, 2], **others)
    problem = Problem([[0.0, 0.0], [1.0, -1.0]], limits)
    found, _ = closest(problem)
    assert optimum * (1 - 1e-9) < found < optimum * (1 + 1e-7)
    uniform = verify(problem, Collocation().solve(problem).trajectory)
    assert uniform.feasible
    assert optimum * (1 - 1e-9) < uniform.certified_duration < optimum * 1.02


@pytest.mark.usefixtures("strangers")
def test_a_pendulum_is_planned():
    """With all torque forwards, then backwards, the energy `v²/2` is known at every angle."""
    gravity, torque, goal = 5.0, 8.0, 2.0
    limits = Limits([5], [100], pendulum_torque={"gravity": [gravity], "torque": [torque]})
    problem = Problem([[0.0], [goal]], limits)

    def forwards(q: float) -> float:
        return 2 * (torque * q - gravity * sin(q))

    def backwards(q: float) -> float:
        return 2 * (torque * (goal - q) + gravity * (sin(goal) - sin(q)))

    turn = brentq(lambda q: forwards(q) - backwards(q), 0.1, goal - 0.1)
    # dq / v with q = x² from the end at rest
    first, _ = quad(lambda x: 2 * x / forwards(x * x) ** 0.5, 0, turn**0.5)
    last, _ = quad(lambda x: 2 * x / backwards(goal - x * x) ** 0.5, 0, (goal - turn) ** 0.5)
    optimum = first + last
    found, error = closest(problem)
    assert optimum * (1 - 1e-9) < found < optimum * (1 + error)
    assert error < 2e-3


@pytest.mark.usefixtures("strangers")
@pytest.mark.parametrize(("most", "power", "way"), [(10.0, 4.0, 1.0), (7.86, 1.27, 1.34)])
def test_the_stated_error_of_a_product_covers_the_true_one(most, power, way):
    """From rest `most` until v · a is the power, then v² grows with time, then −`most`."""
    limits = Limits([5], [most], motor_power={"power": [power]})
    problem = Problem([[0.0], [way]], limits)
    turn = power / most
    before = turn**2 / (2 * most)

    def missed(top: float) -> float:
        return before + (top**3 - turn**3) / (3 * power) + top**2 / (2 * most) - way

    top = brentq(missed, turn, 5)
    optimum = turn / most + (top**2 - turn**2) / (2 * power) + top / most
    found, error = closest(problem)
    assert optimum * (1 - 1e-9) < found < optimum * (1 + error)
    assert error < 2e-3


LINKS = [0.6, 0.4, 0.2]
ROUTE = np.radians([[0.0, 20.0], [40.0, 60.0], [90.0, 30.0]])


def arm(route, links, speed=0.5) -> Problem:
    joints = len(links)
    own = {"links": links, "speed": speed}
    limits = Limits(np.radians([180] * joints), np.radians([600] * joints), tip_speed=own)
    return Problem(route, limits)


@pytest.mark.usefixtures("strangers")
def test_the_speed_of_a_tool_is_planned():
    """No motion is faster than the tool along the chords of its path, at the limit."""
    problem = arm(ROUTE, LINKS[:2])
    shoulder, elbow = ROUTE.T
    first, second = LINKS[:2]
    x = first * np.cos(shoulder) + second * np.cos(shoulder + elbow)
    y = first * np.sin(shoulder) + second * np.sin(shoulder + elbow)
    chords = np.hypot(np.diff(x), np.diff(y)).sum() / 0.5
    found, error = closest(problem)
    # it speeds up and brakes within that, and stays near the chords
    assert chords < found < chords * 1.1
    assert error < 1e-3


@pytest.mark.usefixtures("strangers")
def test_a_joint_with_one_place_may_help_the_others():
    """A third link whose waypoints are all at one angle: it may rest there, or move."""
    angle = 0.3
    three = arm(np.column_stack([ROUTE, np.full(len(ROUTE), angle)]), LINKS)
    tool = LINKS[1] + LINKS[2] * np.exp(1j * angle)
    longer, turned = abs(tool), np.angle(tool)
    two = arm(ROUTE + np.array([0.0, turned]), [LINKS[0], longer])
    assert three.only([0, 1]).limits.kinds["tip_speed"].bounds.all()
    # not with a joint left out that moves
    assert "tip_speed" not in three.only([0, 2]).limits.kinds
    found = [Collocation().solve(problem) for problem in (three, two)]
    durations = [
        verify(problem, own.trajectory).certified_duration
        for problem, own in zip((three, two), found, strict=True)
    ]
    assert durations[1] * 0.99 < durations[0] < durations[1]


@pytest.mark.usefixtures("strangers")
def test_a_joint_that_cannot_help_takes_no_time():
    """The other pendulum has one angle, which its torque holds."""
    own = {"gravity": [5.0, 5.0], "torque": [8.0, 8.0]}
    both = Problem([[0.0, 1.0], [1.0, 1.0]], Limits([5] * 2, [50] * 2, pendulum_torque=own))
    single = {"gravity": [5.0], "torque": [8.0]}
    one = Problem([[0.0], [1.0]], Limits([5], [50], pendulum_torque=single))
    durations = []
    for problem in (both, one):
        certificate = verify(problem, Collocation(10).solve(problem).trajectory)
        assert certificate.feasible
        durations.append(certificate.certified_duration)
    assert durations[0] == pytest.approx(durations[1], rel=1e-7)


@pytest.mark.long
def test_the_robot_arm_of_cops_takes_its_published_time(monkeypatch):
    """A rod that turns is pulled in meanwhile, and tilted: 9.1414 s (Dolan and Moré, COPS)."""
    monkeypatch.setitem(KINDS, CopsArm.key, CopsArm)
    found = CollocationRefined().solve(cops())
    assert verify(cops(), found.trajectory).certified_duration == pytest.approx(9.1414, rel=1e-4)


@pytest.mark.usefixtures("strangers")
def test_rows_may_depend_on_the_segment(monkeypatch):
    """At a waypoint the limits of both segments hold; a piece may reach over it."""
    kind = KINDS["speeds_together"]
    highest = np.array([0.8, 0.3, 0.8])

    def rows(self, at):
        bound = highest[at.segments] * self.column("sum")[0]
        yield Row(at.v[0] + at.v[1], -bound, bound)
        yield Row(at.v[0] - at.v[1], -bound, bound)

    monkeypatch.setattr(kind, "rows", rows)
    waypoints = [[0.0, 0.0], [0.5, -0.5], [1.0, -1.0], [1.5, -1.5]]
    problem = Problem(waypoints, Limits([1, 1], [2, 2], speeds_together={"sum": 1.0}))
    motion = Collocation(12).solve(problem).trajectory
    certificate = verify(problem, motion)
    assert certificate.feasible
    assert certificate.uses["speeds_together"].value == pytest.approx(1, abs=1e-6)
    # 0.5 rad each at 0.15 rad/s, and at most 0.4 rad/s before and after
    middle = np.diff(motion.waypoint_times)[1]
    assert 0.5 / 0.15 * (1 - 1e-9) < middle < 0.5 / 0.15 * 1.001
    one = Trajectory([0.0, 4.0], [[[0.25, -0.25]], [[0.0, 0.0]]], [0.0, 1.0, 3.0, 4.0])
    assert problem.limits.kinds["speeds_together"].worst(one).value == pytest.approx(0.5 / 0.3)


def test_a_continuous_acceleration_needs_a_jerk_limit(monkeypatch, strangers):
    monkeypatch.setattr(KINDS["motor_power"], "smooth", 2)
    limits = Limits([5], [10], motor_power={"power": [4.0]})
    for planner in (Collocation(), CollocationRefined()):
        found = planner.solve(Problem([[0.0], [1.0]], limits))
        assert found.status is Status.UNSUPPORTED
        assert "has no jerk limit" in found.message


def test_a_kind_without_rows_is_refused(monkeypatch):
    monkeypatch.setitem(KINDS, "speed_sum", SpeedSum)
    limits = Limits([1, 1], [2, 2], speed_sum={"joints": [1, 2], "sum": 0.8})
    found = Collocation().solve(Problem([[0.0, 0.0], [1.0, -1.0]], limits))
    assert found.status is Status.UNSUPPORTED
    assert "speed sum" in found.message


FALLING = {"offset": [0.1], "deceleration": [6.0], "position": [[-1.02, 1.02]]}
BROKEN = [
    ("velocity", {}),
    ("acceleration", {}),
    ("jerk", {"jerk": [20.0]}),
    ("position", {"position": [[-0.92, 0.92], [-2, 2]]}),
    ("falling_velocity", {"falling_velocity": FALLING}),
]


@pytest.mark.parametrize(("key", "others"), BROKEN)
@pytest.mark.parametrize("back", [False, True])
def test_the_judge_notices_a_row_that_is_too_wide(key, others, back, monkeypatch):
    """The judge of our own kinds does not ask their rows."""
    waypoints = np.array([[-0.8], [0.9], [-1.0], [0.0]])
    if key == "position":  # the first joint overshoots, while the second needs its time
        waypoints = np.array([[0.0, 0.0], [0.88, 0.0], [0.89, 1.0]])
    joints = waypoints.shape[1]
    limits = Limits([2] * joints, [8] * joints, **others)
    problem = Problem(-waypoints if back else waypoints, limits)
    kind = KINDS[key]
    right = kind.rows

    def wide(self, at):
        for row in right(self, at):
            spread = 0.1 if key == "falling_velocity" else 0.05 * (row.high - row.low)
            yield Row(row.value, row.low - spread, row.high + spread)

    assert verify(problem, Collocation(12).solve(problem).trajectory).feasible
    monkeypatch.setattr(kind, "rows", wide)
    certificate = verify(problem, Collocation(12).solve(problem).trajectory)
    assert not certificate.feasible
    assert certificate.uses[key].value > (1.0 if kind.is_ratio else 1e-3)


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
    assert float(np.square(x).at(0.5)) == pytest.approx(p(0.5) ** 2, abs=1e-13)
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
