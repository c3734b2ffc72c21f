"""Tool speed and torques of single segments: closed forms, files, stores, the judge."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from baselines.along.planner import Along
from baselines.collocation.refined import CollocationRefined
from baselines.lower_bound.planner import Prove
from trajopt import Limits, Problem, Status, Trajectory, verify
from trajopt.benchmark.store import folder, trial_text
from trajopt.benchmark.trial import trials_of
from trajopt.core.bodies import Masses, body
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.explain.active_limits import active_limits
from trajopt.planners.registry import load

GANTRY = """name = "gantry"
units.waypoints = ["m", "m"]
units.limits = ["m", "m"]
waypoints = [[0, 0], [0.6, 0.8], [1.2, 1.6]]
chain.xyz = [[0, 0, 0], [0, 0, 0]]
chain.rpy = [[0, 0, 0], [0, 0, 0]]
chain.axis = [[1, 0, 0], [0, 1, 0]]
[limits]
velocity = [10, 10]
acceleration = [3, 4]
tool_speed = 0.5
[[limits.segment]]
number = 2
tool_speed = 0.25
"""


def read(tmp_path, text: str) -> Problem:
    file = tmp_path / "arm.toml"
    file.write_text(text, encoding="utf-8")
    return Problem.from_toml(file)


def rails() -> LinkChain:
    """Two rails at right angles, which carry 1 kg without gravity."""
    bodies = np.array([body(0.0, [0] * 3, [0] * 6), body(1.0, [0] * 3, [0] * 6)])
    masses = Masses(bodies, np.zeros(2), np.zeros(2), np.full(2, 100.0), gravity=np.zeros(3))
    return LinkChain(np.tile(np.eye(4), (2, 1, 1)), np.eye(3)[:2], np.ones(2, bool), masses=masses)


def gantry(waypoints=((0.0, 0.0), (0.6, 0.8), (1.2, 1.6)), demands=None, **limits) -> Problem:
    found = Limits([10.0, 10.0], [3.0, 4.0], **limits)
    units = ["m", "m"]
    return Problem(waypoints, found, joint_units=units, chain=rails(), demands=demands or {})


def flywheel(each, upright: bool = True) -> Problem:
    """A joint with 0.5 kg m² turns by 2 rad; upright about an axis without gravity."""
    bodies = np.array([body(2.0, [0.5, 0, 0], [0] * 6)])
    masses = Masses(bodies, np.zeros(1), np.zeros(1), np.array([np.nan]))
    axis = [0.0, 0.0, 1.0] if upright else [0.0, -1.0, 0.0]
    chain = LinkChain([np.eye(4)], [axis], [False], masses=masses)
    return Problem([[0.0], [1.0], [2.0]], Limits([10.0], [100.0], torque=each), chain=chain)


def steady() -> Trajectory:
    """The gantry's two metres at 0.5 m/s."""
    return Trajectory([0.0, 4.0], [[[0.3, 0.4]], [[0.0, 0.0]]], [0.0, 2.0, 4.0])


# 5 m/s² along the line: 0.5 m/s in the first metre, 0.25 m/s from the second waypoint on.
LINE = 0.5 / 5 + 0.25 / 5 + (1 - 0.25 / 10 - 0.1875 / 10) / 0.5 + (1 - 0.0625 / 10) / 0.25 + 0.05
# 2 rad/s² in the first rad, 0.5 in the second, which is entered at 1 rad/s: from the peak `p` the
# joint brakes to it, `p²/4 + (p² − 1)/4 = 1`, in `p/2 + (p − 1)/2`, and then for 2 s.
WHEEL = 2.5**0.5 - 0.5 + 2.0


@pytest.mark.parametrize("planner", [Along(), CollocationRefined()], ids=["along", "collocation"])
def test_planners_reach_the_closed_forms(planner):
    for problem, least in (
        (gantry(tool_speed=[0.5, 0.25]), LINE),
        (flywheel([[1], [0.25]]), WHEEL),
    ):
        found = planner.solve(problem)
        certified = verify(problem, found.trajectory).certified_duration
        assert certified == pytest.approx(least, rel=2e-3)
        assert certified >= least * (1 - 1e-6)


def test_every_piece_is_judged_by_its_segment():
    found = verify(gantry(tool_speed=[0.5, 0.25]), steady(), at_rest=False)
    use = found.uses["tool_speed"]
    assert use.value == pytest.approx(2.0, rel=1e-7)
    assert use.time >= 2.0
    assert found.dilation == pytest.approx(2.0, rel=1e-7)
    wide = verify(gantry(tool_speed=[0.5, 4.0]), steady(), at_rest=False)
    assert wide.uses["tool_speed"].value == pytest.approx(1.0, rel=1e-7)
    # 0.5 kg m² at 1 rad/s² all along: half of 1 N m, twice 0.25 N m
    motion = Trajectory([0.0, 2.0], [[[0.5]], [[0.0]], [[0.0]]], [0.0, 2**0.5, 2.0])
    use = flywheel([[1.0], [0.25]]).limits.kinds["torque"].worst(motion)
    assert (use.joint, use.value) == (0, pytest.approx(2.0, rel=1e-7))
    assert use.time >= 2**0.5
    assert flywheel([[1.0], [0.25]]).limits.kinds["torque"].dilation(use, motion) == pytest.approx(
        2**0.5, rel=1e-6
    )


def test_a_segment_without_time_keeps_its_tool_speed():
    """Boxes that overlap: both inner waypoints are passed at once, at 0.5 m/s."""
    rows = [[0.0, 0.0], [0.6, 0.8], [0.6003, 0.8004], [1.2, 1.6]]
    demands = {"tolerance": [[0.0, 0.0], [0.01, 0.01], [0.01, 0.01], [0.0, 0.0]]}
    problem = gantry(rows, demands, tool_speed=[0.5, 0.1, 0.5])
    motion = Trajectory(steady().breaks, steady().coefficients, [0.0, 2.0, 2.0, 4.0])
    assert problem.limits.worst("tool_speed", motion).value == pytest.approx(5.0, rel=1e-7)


def test_a_file_has_it_and_it_is_written_back(tmp_path):
    found = read(tmp_path, GANTRY)
    assert found.limits.kinds["tool_speed"].column("speed")[:, 0].tolist() == [0.5, 0.25]
    assert found.digest() == gantry(tool_speed=[0.5, 0.25]).digest()
    assert read(tmp_path, found.to_toml()).digest() == found.digest()
    alone = read(tmp_path, GANTRY.replace("tool_speed = 0.5\n", ""))  # no other segment has any
    assert np.isnan(alone.limits.kinds["tool_speed"].column("speed")[0]).all()
    assert read(tmp_path, alone.to_toml()).digest() == alone.digest()
    assert verify(alone, steady(), at_rest=False).uses["tool_speed"].value == pytest.approx(2.0)
    assert alone.limits.kinds["tool_speed"].least_times(alone) == pytest.approx([0.0, 4.0])
    same = read(tmp_path, GANTRY.replace("0.25", "0.5"))
    assert same.digest() == gantry(tool_speed=0.5).digest()


def test_shares_and_numbers_of_a_robots_torques(tmp_path):
    head = 'robot = "ur5e"\nunits.waypoints = "deg"\nunits.limits = "deg"\n'
    rows = (
        "waypoints = [[0, -90, 90, 0, 0, 0], [40, -60, 60, 10, 20, 0], [80, -80, 70, 0, 0, 30]]\n"
    )
    own = '[limits]\ntorque = true\n[[limits.segment]]\nnumber = 2\ntorque = "60 %"\n'
    found = read(tmp_path, head + rows + own)
    each = found.limits.kinds["torque"].column("torque")
    assert each == pytest.approx(np.array([[150] * 3 + [28] * 3, [90] * 3 + [16.8] * 3]))
    assert read(tmp_path, found.to_toml()).digest() == found.digest()
    assert found.limits.kinds["torque"].of_joint(0, found) == (
        "150 N m (segment 1), 90 N m (segment 2)"
    )


def test_gravity_contradicts_where_neither_segment_holds():
    """9.81 N m at 0 rad, 9.81 cos 2 at the end; the second segment's limit is not the start's."""
    assert flywheel([[12.0], [9.0]], upright=False).limits.segments == 2
    with pytest.raises(InvalidInput, match=r"limits\.torque, joint 1 is 9\.0: .*waypoint 1"):
        flywheel([[9.0], [12.0]], upright=False)


@pytest.mark.parametrize(
    ("own", "message"),
    [
        ("tool_speed = -1", "limits.tool_speed, segment 2 is -1.0: expected a positive number"),
        ("tool_speed = [1, 2]", "limits.tool_speed, segment 2 is [1, 2]: expected a number"),
        ("tool_speed = {speed = 1}", "segment 2 is {'speed': 1}: expected its limit alone"),
        ("torque = [1]", "limits.torque, segment 2 is [1]: expected 2 numbers"),
        ("torque = [[1, 1]]", "limits.torque, segment 2 is [[1, 1]]: expected 2 numbers"),
        ("torque = [9, 9]", "limits.torque is [9.0, 9.0]: expected an arm whose masses are known"),
        ("falling_velocity = 1", "limits.segment.falling_velocity"),
    ],
)
def test_what_a_table_may_not_say(tmp_path, own, message):
    with pytest.raises(InvalidInput) as raised:
        read(tmp_path, GANTRY.replace("tool_speed = 0.25", own))
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_frames_of_a_store_are_the_same_in_all_segments():
    own = gantry(tool_speed=[0.5, 0.25]).limits.kinds["tool_speed"]
    forged = own.numbers.copy()
    forged[1, :, -1] += 1.0
    with pytest.raises(InvalidInput, match="the same frames in all segments"):
        type(own).of_numbers(forged)


def test_it_is_explained_by_segment():
    motion = Trajectory(steady().breaks, steady().coefficients, [0.0, 2.0, 4.0]).dilated(2.0)
    problem = gantry(tool_speed=[0.5, 0.25])
    (held,) = [row for row in active_limits(problem, motion, None) if row.limit == "tool_speed"]
    assert (held.joint, held.segment) == (None, 1)
    assert (held.start, held.end) == pytest.approx((4.0, 8.0), abs=1e-9)


def test_a_bound_counts_the_way_in_each_segment():
    """A metre at 0.5 m/s and one at 0.25 m/s."""
    problem = gantry(tool_speed=[0.5, 0.25])
    prover = Prove()
    found = prover.solve(problem)
    assert 6 * (1 - 2e-4) <= found.lower_bound <= LINE
    assert prover.stored_bound(problem, found.stats) == pytest.approx(found.lower_bound, rel=1e-9)


def test_who_does_not_know_it_refuses_or_has_the_tightest():
    problem = gantry(tool_speed=[0.5, 0.25])
    assert load("exact").solve(problem).status is Status.UNSUPPORTED
    tightest = problem.limits.in_all_segments().kinds["tool_speed"]
    assert tightest.table() == gantry(tool_speed=0.25).limits.kinds["tool_speed"].table()
    alone = gantry(tool_speed=[np.inf, 0.25]).limits
    assert "tool_speed" not in alone.in_all_segments(tightest=False).kinds


def test_it_is_stored_and_read_back(tmp_path):
    problem = gantry(tool_speed=[np.inf, 0.25], torque=[[9, 9], [9, np.inf]])
    trial = trials_of(load("along"), problem, [0])[0]
    text = trial_text.write(trial)
    assert np.shape(json.loads(text)["problem"]["limits"]["torque"])[:2] == (2, 2)
    assert trial_text.read(text).problem == problem
    folder.save(tmp_path / "results.h5", trial)
    with h5py.File(tmp_path / "results.h5") as file:
        (stored,) = file["problems"].values()
        numbers = problem.limits.kinds["tool_speed"].numbers
        np.testing.assert_array_equal(stored["limits/tool_speed"], numbers)


def test_waypoints_stay_where_a_limit_changes_and_parts_keep_theirs():
    limits = gantry(tool_speed=[np.inf, 0.25]).limits
    assert limits.changes.tolist() == [True]
    three = Limits([1.0, 1.0], [1.0, 1.0], tool_speed=[np.inf, np.inf, 0.25])
    assert three.changes.tolist() == [False, True]
    assert "tool_speed" not in limits.of_segments(np.array([0])).kinds
    (wider,) = limits.widened("tool_speed", None, 0.1, 1).kinds["tool_speed"].column("speed")[1:, 0]
    assert wider == pytest.approx(0.275)
    with pytest.raises(InvalidInput, match="the same in all segments, beside"):
        limits.in_segments("tool_speed", {0: limits.kinds["tool_speed"]}, 2)
