"""A motion's figure shows its curves, limits and waypoints, panel by panel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from pictures import motion_of, overlaps, texts

from trajopt import Trajectory
from trajopt.core.limits import Limits
from trajopt.views.figures import motions, style
from trajopt.views.figures.plots import planner_look
from trajopt.views.figures.style import BLUE


@pytest.mark.parametrize("joints", [1, 6, 12])
def test_a_row_is_a_joint_counted_from_one(joints):
    problem, trajectory = motion_of(joints)
    slower = trajectory.dilated(1.5)
    figure = motions.motion(problem, trajectory, slower, "title")
    assert len(figure.axes) == 3 * joints
    shown = set(texts(figure))
    assert {f"joint {j + 1}" for j in range(joints)} <= shown
    assert {"position (rad)", "velocity (rad/s)", "acceleration (rad/s²)"} <= shown
    assert {"exact optimum", "limit", "waypoint", "planner"} <= shown
    assert overlaps(figure) == []


def test_jerk_has_a_column_where_it_is_limited():
    figure = motions.motion(*motion_of(1, jerk=True))
    assert len(figure.axes) == 4
    assert "jerk (rad/s³)" in texts(figure)


def test_a_panel_has_limits_and_both_curves_on_one_time_axis():
    problem, trajectory = motion_of(2)
    figure = motions.motion(problem, trajectory, trajectory.dilated(2.0))
    velocity = figure.axes[4]  # second joint; 3 panels a row
    assert velocity.get_xlim() == (0, 4)
    low, high, own, reference = velocity.lines[:4]  # the optimum on top
    assert list(low.get_ydata()) == [-1.5, -1.5]
    assert list(high.get_ydata()) == [3.0, 3.0]
    # the peak is 1 rad/s at half of 2 s; dilated by 2 it is 0.5 rad/s
    assert max(own.get_ydata()) == pytest.approx(1.0)
    assert max(own.get_xdata()) == pytest.approx(2.0)
    assert max(reference.get_ydata()) == pytest.approx(0.5)
    assert max(reference.get_xdata()) == pytest.approx(4.0)


def test_waypoints_are_dots_in_positions_and_lines_elsewhere():
    problem, trajectory = motion_of(1)
    position, velocity, _ = motions.motion(problem, trajectory).axes
    dots = next(line for line in position.lines if line.get_marker() == "o")
    np.testing.assert_allclose(dots.get_xydata(), [[0, 0], [1, 0.5], [2, 1]])
    passing = velocity.lines[-1]
    assert list(passing.get_xdata()) == [1, 1]


def test_limits_are_grey_and_a_motion_has_its_planner_s_colour():
    problem, trajectory = motion_of(1)
    green = planner_look("toppra")["color"]
    figure = motions.motion(problem, trajectory, trajectory, colour=green)
    low, high, own, reference = figure.axes[1].lines[:4]
    assert {line.get_color() for line in (low, high)} == {"0.35"}
    assert (own.get_color(), reference.get_color()) == (green, BLUE)
    assert reference.get_zorder() > own.get_zorder()


def test_a_waypoint_that_is_missed_is_in_view():
    """A motion from 0 to 1 rad through a waypoint at 3 rad: the axis reaches it."""
    problem, trajectory = motion_of(1)
    far = replace(problem, waypoints=np.array([[0.0], [3.0], [1.0]]))
    low, high = motions.motion(far, trajectory).axes[0].get_ylim()
    assert low < 0
    assert high > 3


def test_joints_at_rest_take_no_row_and_are_named():
    problem, trajectory = motion_of(2)
    coefficients = trajectory.coefficients.copy()
    coefficients[:, :, 1] = 0.0
    resting = Trajectory(trajectory.breaks, coefficients, trajectory.waypoint_times)
    waypoints = problem.waypoints.copy()
    waypoints[:, 1] = 0.0
    figure = motions.motion(replace(problem, waypoints=waypoints), resting, title="two joints")
    assert len(figure.axes) == 3
    assert "at rest: joint 2" in figure._suptitle.get_text()


def test_what_lies_beyond_a_limit_is_grey_and_limits_are_in_view():
    """Positions from 0 to 1 rad are drawn between limits of −3 and 4 rad."""
    problem, trajectory = motion_of(1)
    limits = Limits([2.0], [3.0], position=[[-3.0, 4.0]])
    limited = replace(problem, limits=limits)
    position = motions.motion(limited, trajectory).axes[0]
    low, high = position.get_ylim()
    below, above = (patch.get_corners()[:, 1] for patch in position.patches)
    assert min(below) < low < max(below) == pytest.approx(-3.0)
    assert max(above) > high > min(above) == pytest.approx(4.0)


def test_a_title_fits_into_the_figure():
    title = style.headline("n" * 500, ", 1.234 s")
    figure = motions.motion(*motion_of(2), title=title)
    FigureCanvasAgg(figure).draw()
    extent = figure._suptitle.get_window_extent()
    assert extent.x1 <= figure.bbox.x1
