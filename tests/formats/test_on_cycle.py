"""Motions on whole control cycles: reproduced by the controller's pieces, hardly longer."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.trajectory import Trajectory
from trajopt.formats import on_cycle, samples_csv
from trajopt.formats.on_cycle import moved
from trajopt.judging.verification import certified, verify
from trajopt.planners.registry import load

TWO = Limits([1.0, 1.5], [2.0, 3.0])


def motion(problem, planner, cycle):
    trajectory = certified(problem, load(planner).solve(problem).trajectory)
    return trajectory, moved(problem, trajectory, cycle)


def executed(problem, found, samples):
    """The certificate of what a controller runs."""
    own = Trajectory.from_samples(
        samples.times,
        samples.positions,
        samples.velocities,
        samples.accelerations,
        waypoint_times=found.waypoint_times,
    )
    return verify(problem, own)


def test_a_triangle_whose_breaks_are_on_the_cycle_stays_as_it_is():
    # 0.5 rad at 2 rad/s²: half a second up to 1 rad/s, half a second down
    limits = Limits([5.0], [2.0])
    problem = Problem([[0.0], [0.5]], limits)
    _, found = motion(problem, "ruckig-stop", 0.25)
    samples = found.at_breaks(["a"])
    # it is at its limit, and what is written stays 1e-5 below: a cycle more
    assert found.duration == pytest.approx(1.25)
    assert samples.accelerations is None
    exact = moved(Problem([[0.0], [0.499]], Limits([5.0], [2.0])), _triangle(0.499), 0.25)
    assert exact.duration == 1.0
    assert np.allclose(exact.at_breaks(["a"]).velocities[1], 0.998)


def _triangle(h):
    """Up for half a second and down: v = 2 h."""
    coefficients = np.array([[2 * h, -2 * h], [0.0, 2 * h], [0.0, h / 2]])
    return Trajectory([0.0, 0.5, 1.0], coefficients[:, :, None], [0.0, 1.0])


@pytest.mark.parametrize("cycle", [0.001, 0.008, 0.05])
def test_constant_acceleration_is_executed_as_planned_by_cubic_pieces(cycle):
    problem = Problem([[0, 0.2], [0.5, -0.4], [0.9, 0.1], [0.3, 0.2]], TWO)
    planned, found = motion(problem, "exact", cycle)
    breaks = found.at_breaks(["a", "b"])
    every = found.at_cycles(["a", "b"])
    cycles = breaks.times / cycle
    assert np.allclose(cycles, np.rint(cycles), atol=1e-6)
    assert np.diff(breaks.times).min() > 0.999 * cycle
    expected = round(found.duration / cycle) + 1
    assert len(every.times) == expected
    assert planned.duration <= found.duration <= planned.duration + 8 * cycle
    for samples in (breaks, every):
        certificate = executed(problem, found, samples)
        assert samples.interpolation() == "cubic"
        assert certificate.feasible
        assert certificate.acceleration.value > 0.99  # it wastes nothing
        assert certificate.waypoint.value < 1e-12


def test_constant_jerk_is_executed_as_planned_by_quintic_pieces():
    limits = Limits([1.0, 1.5], [2.0, 3.0], jerk=[20, 30], position=[[-1, 1], [-1, 1]])
    problem = Problem([[0, 0.2], [0.5, -0.4], [0.9, 0.1]], limits)
    planned, found = motion(problem, "exact-jerk", 0.001)
    certificate = executed(problem, found, found.at_breaks(["a", "b"]))
    assert found.at_breaks(["a", "b"]).interpolation() == "quintic"
    assert certificate.feasible
    assert found.duration < 1.005 * planned.duration
    assert executed(problem, found, found.at_cycles(["a", "b"])).feasible


def test_a_joint_without_a_jerk_limit_loses_a_cycle_and_no_more():
    limits = Limits([9.0, 9.0], [2.0, 3.0], jerk=[np.inf, 30])
    problem = Problem([[0, 0], [0.5, 0.02], [0, 0]], limits)
    planned, found = motion(problem, "ruckig-stop", 0.002)
    assert executed(problem, found, found.at_breaks(["a", "b"])).feasible
    assert found.duration < planned.duration + 10 * 0.002


def test_smooth_motions_waypoints_twice_and_joints_at_rest():
    problem = Problem([[0, 1], [0.5, 1], [0.5, 1], [0.9, 1], [0.3, 1]], TWO)
    planned, found = motion(problem, "unoptimised", 0.004)
    assert executed(problem, found, found.at_cycles(["a", "b"])).feasible
    assert found.duration < 1.01 * planned.duration
    times = found.waypoint_times
    assert times[1] == times[2]


def test_waypoints_a_rounding_unit_apart_share_a_cycle():
    limits = Limits([1.0], [2.0])
    problem = Problem([[0.0], [1.0], [np.nextafter(1, 2)], [2.0]], limits)
    planned, found = motion(problem, "exact", 0.001)
    assert executed(problem, found, found.at_breaks(["a"])).feasible
    assert found.duration < planned.duration + 0.01


def test_limits_so_high_that_they_act_at_once_get_a_cycle_to_do_so():
    # |h| / V, since the acceleration takes a microsecond; but on the cycle, a cycle
    limits = Limits([1, 1], [1e6, 1e6])
    problem = Problem([[0, 0], [1, -0.5], [0.4, 0.6]], limits)
    planned, found = motion(problem, "exact", 0.001)
    assert planned.duration == pytest.approx(2.1, abs=1e-5)
    assert executed(problem, found, found.at_breaks(["a", "b"])).feasible
    assert found.duration < 2.1 + 0.01


def test_a_cycle_longer_than_the_motion_allows_is_refused():
    problem = Problem([[0, 0], [0.1, 0.1], [0.2, 0], [0.3, 0.1]], TWO)
    with pytest.raises(InvalidInput, match="expected a shorter one"):
        motion(problem, "exact", 1.0)


# --- samples as CSV ---


def test_samples_come_back_to_the_last_bit(tmp_path):
    limits = Limits([1, 1], [2, 3], jerk=[20, 30])
    problem = Problem([[0, 0.2], [0.5, -0.4]], limits)
    _, found = motion(problem, "ruckig-stop", 0.01)
    samples = found.at_breaks(["a [left]", "b, right"])
    samples_csv.write(tmp_path / "m.csv", samples)
    back = samples_csv.read(tmp_path / "m.csv")
    assert back.joint_names == samples.joint_names
    for name in ("times", "positions", "velocities", "accelerations"):
        assert np.array_equal(getattr(back, name), getattr(samples, name))


@pytest.mark.parametrize("jerk", [None, [5000.0]])
@pytest.mark.parametrize(
    "waypoints",
    [
        [[0.0], [2.7], [2.0]],
        [[0.0], [-2.7], [-2.0]],
        [[2.748], [2.6], [0.5]],  # begins where nothing is allowed
    ],
)
def test_a_falling_velocity_limit_is_kept_between_the_points(waypoints, jerk):
    """Joint 1 of the Franka FR3 along the parabola: a chord on each piece keeps what is run."""
    law = {"offset": [0.3], "deceleration": [6.0], "position": [[-2.7501, 2.7501]]}
    problem = Problem(waypoints, Limits([2.62], [10.0], jerk, falling_velocity=law))
    planned, found = motion(problem, "collocation", 1e-3)
    certificate = executed(problem, found, found.at_breaks(["a"]))
    assert certificate.feasible
    if waypoints[0] == [0.0]:
        assert certificate.uses["falling_velocity"].value > 0.95
    assert found.duration < planned.duration * 1.002 + 2e-3


def test_a_program_s_answer_is_judged(monkeypatch):
    """What a program leaves of an end state is in the last piece: here it is too steep."""
    problem = Problem([[0.0], [1.0]], Limits([1.0], [1.0]))
    _, usual = motion(problem, "exact", 0.05)

    class Rough(on_cycle.JointProgram):
        def solved(self):
            states = super().solved()
            if states is not None and self.times[-1] == pytest.approx(usual.duration):
                states[1][-2] += 0.1
            return states

    monkeypatch.setattr(on_cycle, "JointProgram", Rough)
    _, found = motion(problem, "exact", 0.05)
    assert found.duration == pytest.approx(usual.duration + 0.05)
    assert executed(problem, found, found.at_breaks(["a"])).feasible
