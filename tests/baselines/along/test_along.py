"""The fastest timing of a path: closed forms, two parameters of one path, stops, refusals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from baselines.along.planner import Along, along
from baselines.topp_ra import rules, spline
from tests.kinds import TipSpeed, Torque
from trajopt import Limits, Problem, Status, Trajectory, verify
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites.catalogue import problems
from trajopt.core.limits import KINDS, JointState, Quantity, Row, RowLimit
from trajopt.planners.registry import load

pytestmark = pytest.mark.usefixtures("strangers")


class ToolAcceleration(RowLimit):
    """Squared acceleration of a prismatic tool: of no form that a path is timed under."""

    key = "tool_acceleration"
    fields = (Quantity("highest", metres=1, time=-2, common=True, widens=1),)

    def rows(self, at: JointState) -> Iterator[Row]:
        yield Row((at.a[0] / self.column("highest")[0]) ** 2, -1.0, 1.0)


del KINDS[ToolAcceleration.key]  # a kind of one test


def line(ends=((0.0,), (1.0,)), inner=()) -> Trajectory:
    """Return straight lines, a piece per unit of the parameter."""
    points = np.array([ends[0], *inner, ends[1]], dtype=float)
    at = np.arange(len(points), dtype=float)
    return Trajectory(at, np.stack([np.diff(points, axis=0), points[:-1]]), at)


def timed(path: Trajectory, limits: Limits, accuracy: float = 1e-3, **demands) -> float:
    """Return the certified duration of the planner's motion along a path, s."""
    problem = Problem(path(path.waypoint_times), limits, **demands)
    solution = Along(accuracy=accuracy).along(problem, path)
    assert solution.trajectory is not None, solution.message
    certificate = verify(problem, solution.trajectory)
    assert certificate.valid, certificate.flaws
    return float(certificate.certified_duration)


# One joint over 1 rad. Ramps: h/v + v/a + a/j, with one-sided limits h/v + v/2 (1/a + 1/d).
# Jerk alone: (32 h/j)^(1/3). Two joints 1 : 2 in the parameter: v 0.5, a 1.5, j 10. Sections of
# 1 rad with v 2, 0.5, 2 and a 4: two ramps of 0.890625 s, 2 s between. `FALLING` is the quadrature
# of 1/(sqrt(2 d (high − q)) − o) between two ramps. The state (0.6, 0.5) at the start is Ruckig's.
FALLING = {"offset": [0.1], "deceleration": [3.0], "position": [[-10.0, 1.5]]}
CLOSED = {
    "jerk": (line(), Limits([1.0], [2.0], [10.0]), {}, 1.7),
    "jerk alone": (line(), Limits([100.0], [200.0], [10.0]), {}, 3.2 ** (1 / 3)),
    "one-sided": (line(), Limits([1.0], [[-8.0, 4.0]]), {}, 1.1875),
    "two joints": (
        line(((0, 0), (1, 2))),
        Limits([1.0, 1.0], [2.0, 3.0], [10.0, 30.0]),
        {},
        2 + 1 / 3 + 0.15,
    ),
    "sections": (
        line(((0,), (3,)), inner=((1,), (2,))),
        Limits([[[-v, v]] for v in (2.0, 0.5, 2.0)], [[[-4.0, 4.0]]] * 3),
        {},
        3.78125,
    ),
    "falling velocity": (
        line(((0,), (1.2,))),
        Limits([10.0], [5.0], falling_velocity=FALLING),
        {},
        0.9874735350317472,
    ),
    "start in motion": (
        line(),
        Limits([1.0], [2.0], [10.0]),
        {"start_velocity": [0.6], "start_acceleration": [0.5]},
        1.4133723958333333,
    ),
}


@pytest.mark.parametrize("name", CLOSED)
def test_closed_forms(name):
    path, limits, demands, right = CLOSED[name]
    assert right * (1 - 1e-6) < timed(path, limits, **demands) < right * (1 + 5e-4)


@pytest.mark.parametrize("name", ["jerk", "falling velocity"])
def test_accuracy_is_an_option(name):
    path, limits, demands, right = CLOSED[name]
    assert right * (1 - 1e-6) < timed(path, limits, 1e-4, **demands) < right * (1 + 2e-4)


def test_a_kind_that_only_says_its_rows_is_planned():
    # a single link of 1 m: its tool is as fast as the joint
    limits = Limits([100.0], [1.0], [10.0], tip_speed={"links": [1.0], "speed": 0.25})
    assert TipSpeed.key in limits.kinds
    assert 4.35 * (1 - 1e-6) < timed(line(), limits) < 4.35 * (1 + 5e-4)


def test_torques_with_gravity():
    """|a + cos q| ≤ 3/2 from −1 to 1 rad: the quadrature of two arcs of constant torque."""
    limits = Limits([100.0], [100.0], pendulum_torque={"gravity": [1.0], "torque": [1.5]})
    assert Torque.key in limits.kinds

    def rising(q):
        return 3 * (q + 1) - 2 * (np.sin(q) + np.sin(1))

    def falling(q):
        return 3 * (1 - q) + 2 * (np.sin(1) - np.sin(q))

    switch = brentq(lambda q: rising(q) - falling(q), -0.9, 0.9)
    right = quad(lambda q: rising(q) ** -0.5, -1, switch)[0]
    right += quad(lambda q: falling(q) ** -0.5, switch, 1)[0]
    assert right * (1 - 1e-6) < timed(line(((-1.0,), (1.0,))), limits) < right * (1 + 5e-4)


def test_another_form_is_refused_in_a_sentence(monkeypatch):
    monkeypatch.setitem(KINDS, ToolAcceleration.key, ToolAcceleration)
    limits = Limits([1.0], [2.0], tool_acceleration={"highest": 1.0})
    problem = Problem([[0.0], [1.0]], limits)
    solution = Along().along(problem, line())
    assert solution.status is Status.FAILED
    assert "tool acceleration limits: a row is no sum of" in solution.message


@pytest.mark.parametrize("jerk", [None, [20.0, 30.0]])
def test_a_path_in_two_parameters_takes_one_time(jerk):
    """A cubic; and the same with a parameter that stands at its ends (3 u² − 2 u³ twice)."""
    limits = Limits([1.0, 1.5], [4.0, 3.0], jerk)
    cubic = np.array([[1.0, -2.0], [-1.5, 1.0], [1.0, 1.5], [0.0, 0.0]])[:, None]
    path = Trajectory([0.0, 1.0], cubic, [0.0, 1.0])
    pace = Trajectory([0.0, 1.0], np.array([6.0, -15.0, 10.0, 0, 0, 0])[:, None, None], [0.0, 1.0])
    other = Trajectory.composed(path, pace)
    assert timed(other, limits, 1e-4) == pytest.approx(timed(path, limits, 1e-4), rel=2e-4)


def test_the_pace_of_the_given_motion_does_not_count():
    """A trapezoid of velocity, whose acceleration jumps, is a line: jerk limits ask no stop."""
    trapezoid = Trajectory(
        [0.0, 0.5, 1.0, 1.5],
        np.array([[1.0, 0.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.25, 0.75]])[..., None],
        [0.0, 1.5],
    )
    found = timed(trapezoid, Limits([1.0], [2.0], [10.0]))
    assert 1.7 * (1 - 1e-6) < found < 1.7 * (1 + 5e-4)


def test_a_motion_that_stops_is_itself():
    limits = Limits([1.0, 1.5], [2.0, 3.0], [20.0, 15.0])
    problem = Problem([[0, 0], [0.5, -0.1], [1, 0.4], [0.2, 0.8]], limits)
    own = load("ruckig-stop").solve(problem).trajectory
    solution = Along().along(problem, own)
    assert "the path itself stops at waypoint 2 and at waypoint 3" in solution.message
    found = verify(problem, solution.trajectory).certified_duration
    assert found == pytest.approx(own.duration, rel=1e-6)


def test_corners_are_passed_at_rest():
    corner = line(((0, 0), (1, 1)), inner=((1, 0),))
    problem = Problem(corner(corner.waypoint_times), Limits([1.0, 1.0], [2.0, 2.0]))
    solution = Along().along(problem, corner)
    assert "its direction jumps at waypoint 2" in solution.message
    assert verify(problem, solution.trajectory).certified_duration == pytest.approx(3, rel=5e-4)


def test_a_jump_of_curvature_is_a_corner_under_jerk_limits_only():
    # a line, then a parabola with the same direction
    path = Trajectory(
        [0.0, 1.0, 2.0],
        np.array([[[0, 0], [0, 0.5]], [[1, 0], [1, 0]], [[0, 0], [1, 0]]], dtype=float),
        [0.0, 1.0, 2.0],
    )
    two = [1.0, 1.0], [2.0, 2.0]
    free = Problem(path(path.waypoint_times), Limits(*two))
    bound = Problem(path(path.waypoint_times), Limits(*two, [20.0, 20.0]))
    assert Along().along(free, path).message == ""
    assert "its curvature jumps at waypoint 2" in Along().along(bound, path).message


def test_a_path_outside_position_limits_says_where():
    path = Trajectory([0.0, 1.0], np.array([[-4.0], [5.0], [0.0]])[:, None], [0.0, 1.0])
    problem = Problem([[0.0], [1.0]], Limits([1.0], [2.0], position=[[0.0, 1.2]]))
    solution = Along().along(problem, path)
    assert solution.status is Status.FAILED
    assert "leaves the position limits of joint 1 by 0.363 rad in segment 1" in solution.message


def test_a_path_that_touches_a_position_limit_but_for_rounding_is_timed():
    top = 1.0 - 1e-13
    path = Trajectory([0.0, 1.0], np.array([[-4.0], [4.0], [0.0]])[:, None], [0.0, 1.0])
    problem = Problem([[0.0], [0.5], [0.0]], Limits([1.0], [2.0], position=[[0.0, top]]))
    path = Trajectory(path.breaks, path.coefficients, [0.0, (1 - 0.5**0.5) / 2, 1.0])
    solution = Along().along(problem, path)
    assert verify(problem, solution.trajectory).certified_duration == pytest.approx(3, rel=5e-4)


def test_where_no_speed_is_allowed():
    # the law allows no motion upwards beyond 1.5 − 0.1²/6
    problem = Problem([[0.0], [1.499]], Limits([10.0], [5.0], falling_velocity=FALLING))
    solution = Along().along(problem, line(((0,), (1.499,))))
    assert solution.status is Status.FAILED
    assert "keeps the falling velocity limits in segment 1" in solution.message


def test_splines_outside_position_limits_leave_straight_lines():
    position = [[0.0, 1.0]]
    problem = Problem([[0], [1], [0.9], [1]], Limits([1.0], [2.0], position=position))
    solution = Along(knots="chord", ends="natural").solve(problem)
    assert solution.message.startswith("along straight lines, with stops")
    assert verify(problem, solution.trajectory).valid


@pytest.mark.long
def test_velocities_at_the_ends_under_jerk_limits():
    limits = Limits([1.0, 1.5], [2.0, 3.0], [20.0, 15.0])
    ends = {"start_velocity": [0.3, 0.1], "end_velocity": [0.0, 0.2]}
    problem = Problem([[0, 0], [0.5, 0.2], [1, 0.4]], limits, **ends)
    solution = Along(knots="chord").solve(problem)
    assert verify(problem, solution.trajectory).feasible


@pytest.mark.long
def test_tiny_steps_have_a_timing_along_every_spline():
    """Rows were tightened beyond their bounds, and the method did not converge."""
    problem = {own.name: own for own in problems("random")}["random-tiny-j9-w6-jerk-01"]
    for rule in rules():
        solution = along(problem, spline(problem, *rule), 2e-2)
        assert verify(problem, solution.trajectory).valid


def test_a_time_that_is_no_number_is_no_answer():
    """The squared speed was positive where it is asked for, and negative in between."""
    (problem,) = (own for own in problems("random") if own.name == "random-huge-j2-w3-jerk-10")
    solution = Along(knots="limit", ends="not-a-knot", accuracy=0.02).solve(problem)
    certified = verify(problem, solution.trajectory).certified_duration
    known = records.find(problem).duration
    assert known < certified < 1.02 * known
