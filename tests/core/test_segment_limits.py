"""Limits of one segment: files, digests, the judge."""

from __future__ import annotations

import json
from dataclasses import dataclass

import h5py
import numpy as np
import pytest

from trajopt import Limits, Planner, Problem, Solution, Status, Trajectory, verify
from trajopt.benchmark.store import folder, trial_text
from trajopt.benchmark.trial import trials_of
from trajopt.core.exceptions import InvalidInput
from trajopt.explain.active_limits import active_limits, stretches
from trajopt.judgement import as_executed, motion_of
from trajopt.planners.registry import load
from trajopt.views.figures import motions
from trajopt.views.report.panels import panel


@dataclass(frozen=True)
class Straight(Planner):
    """Knows constant limits only: it stops at every waypoint, each joint in a cubic."""

    def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
        assert problem.limits.segments is None
        h = problem.displacements
        velocity, acceleration = problem.limits.velocity[:, 1], problem.limits.acceleration[:, 1]
        times = np.maximum(1.5 * h / velocity, np.sqrt(6 * h / acceleration)).max(axis=1)
        breaks = np.concatenate([[0.0], np.cumsum(times)])
        t = times[:, None]
        cubic = np.stack([-2 * h / t**3, 3 * h / t**2, 0 * h, problem.waypoints[:-1]])
        return Solution(Status.SOLVED, Trajectory(breaks, cubic, breaks))


WAYPOINTS = [[0.0, 0.0], [1.0, 0.5], [2.0, 0.0], [2.5, 0.3]]
FILE = """
angle_unit = "deg"
waypoints = [[0, 0], [90, 45], [180, 0]]
[limits]
velocity = [90, 90]
acceleration = [180, 360]
[[limits.segment]]
"""


def slower(factor=0.25):
    """Velocity limits of 2 rad/s, in the second of three segments a quarter."""
    velocity = np.tile([[-2.0, 2.0], [-2.0, 2.0]], (3, 1, 1))
    velocity[1] *= factor
    return velocity


def problem(**more):
    return Problem(WAYPOINTS, Limits(slower(), [4.0, [-3.0, 4.0]], **more))


def read(tmp_path, text):
    file = tmp_path / "problem.toml"
    file.write_text(text)
    return Problem.from_toml(file)


def test_a_file_has_it_and_it_is_written_back(tmp_path):
    text = FILE + "number = 2\nvelocity = [30, [-120, 45]]\njerk = [900, 900]"
    found = read(tmp_path, text)
    assert np.degrees(found.limits.velocity[0]) == pytest.approx(np.array([[-90, 90]] * 2))
    own = np.degrees(found.limits.velocity[1])
    assert own == pytest.approx(np.array([[-30, 30], [-120, 45]]))
    assert found.limits.acceleration.shape == (2, 2)
    assert np.isinf(found.limits.jerk[0]).all()
    assert np.degrees(found.limits.jerk[1, :, 1]) == pytest.approx([900, 900])
    again = read(tmp_path, found.to_toml())
    assert again.digest() == found.digest()
    assert again.limits == found.limits


def test_a_robot_brings_the_rest(tmp_path):
    head = 'robot = "ur5e"\nwaypoints = [[0, 0, 0, 0, 0, 0], [90, 0, 0, 0, 0, 0]]\n'
    units = 'units.waypoints = "deg"\nunits.limits = "deg"\n'
    own = "[[limits.segment]]\nnumber = 1\nvelocity = [10, 10, 10, 10, 10, 10]\n"
    found = read(tmp_path, head + units + own)
    assert found.limits.velocity[:, 1] == pytest.approx(np.radians([10] * 6))
    whole = read(tmp_path, head + 'units.waypoints = "deg"')
    assert np.array_equal(found.limits.acceleration, whole.limits.acceleration)


def test_the_same_in_every_segment_is_no_other_problem():
    constant = Problem(WAYPOINTS, Limits([2, 2], [4, 4]))
    assert Problem(WAYPOINTS, Limits(slower(1.0), [4, 4])).digest() == constant.digest()
    assert Problem(WAYPOINTS, Limits(slower(), [4, 4])).digest() != constant.digest()


@pytest.mark.parametrize(
    ("table", "message"),
    [
        ("number = 0\nvelocity = [1, 1]", "limits.segment.number is 0: expected a whole number"),
        ("number = 3\nvelocity = [1, 1]", "from 1 to 2, the segments between waypoints"),
        ("number = 1.5\nvelocity = [1, 1]", "limits.segment.number is 1.5"),
        ("velocity = [1, 1]", "limits.segment.number: expected this key"),
        (
            "number = 1",
            "expected velocity, acceleration, jerk, tool_speed, torque or link_speed beside number",
        ),
        ("number = 2\nvelocity = [1]", "limits.velocity, segment 2 is 1: expected 2 values"),
        ("number = 2\nvelocity = [1, -1]", "limits.velocity, segment 2, joint 2 is -1.0"),
        ("number = 2\nvelocity = [inf, 1]", "segment 2, joint 1 is inf"),
        ("number = 2\njerk = ['a', 1]", "limits.jerk, segment 2, joint 1 is 'a'"),
        ("number = 2\nposition = [9, 9]", "a range is the same in every segment"),
        ("number = 2\nspeed = [9, 9]", "limits.segment.speed"),
        ("number = 2\njerk = [9, 9]\n[[limits.segment]]\nnumber = 2", "each segment once"),
    ],
)
def test_what_a_table_may_not_say(tmp_path, table, message):
    with pytest.raises(InvalidInput) as raised:
        read(tmp_path, FILE + table)
    assert message in str(raised.value)
    assert "problem.toml" in str(raised.value)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Problem(WAYPOINTS[:3], problem().limits), "limits.velocity is 3: expected 2"),
        (lambda: Limits(slower(), [1, 1], position=slower()), "a range is the same"),
        (lambda: Limits(slower(), slower()[:2]), "limits.acceleration is 2: expected 3 segments"),
        (lambda: Limits(-slower(), [1, 1]), "limits.velocity, segment 1, joint 1 is -2.0"),
        (lambda: Limits([[[-1, 1], 1], [1]], [1, 1]), "segment 2 is 1: expected 2 values"),
        (
            lambda: Limits([1, 1], [1, 1], segment=[]),
            r"[[limits.segment]] of a problem file",
        ),
        (
            lambda: Problem(WAYPOINTS, Limits([1, 1], [1, 1]), per_section_max_velocity=[[1, 1]]),
            "[[limits.segment]] of a problem file",
        ),
    ],
)
def test_what_python_may_not_say(make, message):
    with pytest.raises((InvalidInput, TypeError)) as raised:
        make()
    assert message in str(raised.value)


def passing(speed=1.0):
    """From 0 to 2 rad: at 2 rad/s² up to 1 rad/s, which holds at the waypoint at 1 rad."""
    breaks = [0.0, 0.5, 2.0, 2.5]
    coefficients = [[1.0, 0.0, -1.0], [0.0, 1.0, 1.0], [0.0, 0.25, 1.75]]
    motion = Trajectory(breaks, np.array(coefficients)[..., None], [0.0, 1.25, 2.5])
    return motion.dilated(1 / speed)


def one_joint(low=0.5, **more):
    velocity = [[[-1.0, 1.0]], [[-1.0, low]]]
    return Problem([[0.0], [1.0], [2.0]], Limits(velocity, [2.0], **more))


def test_a_break_at_a_waypoint_belongs_to_both_segments():
    found = verify(one_joint(), passing())
    assert found.velocity.value == pytest.approx(2.0, rel=1e-12)
    assert 1.25 - 1e-9 <= found.velocity.time <= 2.0
    assert found.dilation == pytest.approx(2.0, rel=1e-12)
    assert found.certified_duration == pytest.approx(5.0, rel=1e-12)
    assert verify(one_joint(1.0), passing()).dilation == pytest.approx(1.0, rel=1e-12)
    # a wider limit in one segment counts there only
    assert verify(one_joint(4.0), passing()).velocity.value == pytest.approx(1.0, rel=1e-12)


def test_the_largest_dilation_of_all_segments_counts():
    acceleration = [[[-2.0, 2.0]], [[-0.5, 2.0]]]
    velocity = [[[-1.0, 1.0]], [[-1.0, 0.8]]]
    asked = Problem([[0.0], [1.0], [2.0]], Limits(velocity, acceleration))
    found = verify(asked, passing())
    assert found.velocity.value == pytest.approx(1 / 0.8, rel=1e-12)
    assert found.acceleration.value == pytest.approx(4.0, rel=1e-12)
    assert found.acceleration.time >= 2.0
    assert found.dilation == pytest.approx(2.0, rel=1e-12)


def test_equal_waypoints_are_one_and_the_segment_between_asks_nothing():
    velocity = [[[-1.0, 1.0]], [[-1e-3, 1e-3]], [[-1.0, 0.5]]]
    asked = Problem([[0.0], [1.0], [1.0], [2.0]], Limits(velocity, [2.0]))
    merged, index = asked.merged()
    assert merged == one_joint()
    assert index.tolist() == [0, 1, 1, 2]
    motion = Trajectory(passing().breaks, passing().coefficients, [0.0, 1.25, 1.25, 2.5])
    assert verify(asked, motion).dilation == pytest.approx(2.0, rel=1e-12)


def test_where_limits_change_a_waypoint_is_exact():
    from trajopt.core.resolution import spared

    steps = np.linspace(0, 1e-9, 6)[:, None]
    waypoints = np.vstack([steps, [[1.0]]])
    constant = Problem(waypoints, Limits([1.0], [2.0]))
    velocity = np.ones((6, 1, 2)) * [-1, 1]
    velocity[:3] *= 0.5
    changing = Problem(waypoints, Limits(velocity, [2.0]))
    assert spared(constant)[3]
    assert not spared(changing)[3]
    assert np.delete(spared(changing), 3).tolist() == np.delete(spared(constant), 3).tolist()


def test_it_is_explained_by_segment():
    asked = one_joint()
    motion = passing().dilated(2.0)
    found = [row for row in active_limits(asked, motion, None) if row.limit == "velocity"]
    (own,) = found
    assert (own.joint, own.segment) == (0, 1)
    # half the speed: it cruises from 1 s to 4 s, and 1 % of the speed on both ramps
    assert (own.start, own.end) == pytest.approx((2.5, 4.01), abs=1e-6)
    assert own.saving == pytest.approx(5.0 * (1 - 1 / 1.01), rel=1e-9)
    both = [one for one in stretches(one_joint(1.0), passing()) if one.limit == "velocity"]
    assert len(both) == 1


def test_it_is_stored_and_read_back(tmp_path):
    asked = one_joint()
    trial = trials_of(load("ruckig-stop"), asked, [0])[0]
    text = trial_text.write(trial)
    assert np.shape(json.loads(text)["problem"]["limits"]["velocity"]) == (2, 1, 2)
    assert trial_text.read(text).problem == asked
    folder.save(tmp_path / "results.h5", trial)
    with h5py.File(tmp_path / "results.h5") as file:
        (stored,) = file["problems"].values()
        assert stored["limits/velocity"].shape == (2, 1, 2)
        assert stored["limits/acceleration"].shape == (1, 2)


def test_who_does_not_know_it_plans_with_the_tightest_limits():
    asked = one_joint()
    planner = Straight()
    found = planner.solve(asked)
    assert found.status is Status.SOLVED
    assert "the tightest limits of all segments" in found.message
    assert verify(asked, found.trajectory).dilation <= 1 + 1e-6


def test_figures_draw_each_segments_limits():
    figure = motions.motion(one_joint(), passing().dilated(2.0))
    velocity = figure.axes[1]
    edges = [line for line in velocity.lines if line.get_drawstyle() == "steps-post"]
    assert [line.get_ydata().tolist() for line in edges] == [[-1, -1, -1], [1, 0.5, 0.5]]
    assert edges[0].get_xdata() == pytest.approx([0, 2.5, 5])


def test_the_report_has_each_segments_limits():
    trial = trials_of(load("ruckig-stop"), one_joint(), [0])[0]
    found = panel([trial], ["ruckig-stop"], with_motions=True)
    assert found["segments"]["velocity"].shape == (2, 1, 2)
    assert found["limits"]["velocity"].tolist() == [[-1, 1]]
    spans = found["spans"]["velocity"]
    assert spans == ["± 1 (segment 1), -1 … 0.5 (segment 2) rad/s"]


def test_limits_alone_tell_no_segments():
    with pytest.raises(InvalidInput, match="trajopt judge MOTION PROBLEM"):
        as_executed(motion_of(passing()), one_joint().limits)
