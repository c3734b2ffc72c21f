"""JointTrajectory messages: every wrapping and spelling, exact there and back, errors that help."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trajopt.core.exceptions import InvalidInput
from trajopt.formats import joint_trajectory
from trajopt.formats.samples import Samples

ECHOED = """\
joint_names:
- shoulder
- elbow
points:
- positions: [0.0, 0]
  velocities: [0, 0]
  accelerations: []
  effort: []
  time_from_start: {sec: 0, nanosec: 0}
- positions: [1e-1, -0.25]
  velocities: [0.0, 0.0]
  accelerations: []
  effort: []
  time_from_start:
    sec: 1
    nanosec: 500000000
---
"""


def message(**changes):
    table = {
        "joint_names": ["shoulder", "elbow"],
        "points": [
            {"positions": [0.0, 0.0], "velocities": [0.0, 0.0], "time_from_start": 0},
            {"positions": [0.1, -0.25], "velocities": [0.0, 0.0], "time_from_start": 1.5},
        ],
    }
    return table | changes


def check_two_points(samples):
    assert samples.joint_names == ("shoulder", "elbow")
    assert samples.times.tolist() == [0, 1.5]
    assert samples.positions.tolist() == [[0, 0], [0.1, -0.25]]
    assert samples.velocities.tolist() == [[0, 0], [0, 0]]
    assert samples.accelerations is None
    assert samples.interpolation() == "cubic"


def test_what_ros2_topic_echo_prints(tmp_path):
    path = tmp_path / "echoed.yaml"
    path.write_text(ECHOED)
    check_two_points(joint_trajectory.read(path))


@pytest.mark.parametrize(
    "wrapped",
    [
        lambda m: m,
        lambda m: {"header": {"frame_id": ""}, **m},
        lambda m: {"joint_trajectory": m, "multi_dof_joint_trajectory": {"points": []}},
        lambda m: {"trajectory": m, "path_tolerance": [], "goal_time_tolerance": {"sec": 0}},
        lambda m: {"goal_id": {"uuid": [0]}, "goal": {"trajectory": m}},
        lambda m: {"trajectory": [{"joint_trajectory": m}], "model_id": "robot"},
    ],
    ids=["plain", "header", "RobotTrajectory", "goal", "action goal", "DisplayTrajectory"],
)
def test_every_wrapping(tmp_path, wrapped):
    path = tmp_path / "wrapped.json"
    path.write_text(json.dumps(wrapped(message())))
    check_two_points(joint_trajectory.read(path))


@pytest.mark.parametrize(
    "time", [1.5, "1.5", {"sec": 1, "nanosec": 500_000_000}, {"secs": 1, "nsecs": 500_000_000}]
)
def test_every_spelling_of_a_duration(time):
    table = message()
    table["points"][1]["time_from_start"] = time
    check_two_points(joint_trajectory.from_message(table))


@pytest.mark.parametrize("ending", [".json", ".yaml"])
def test_there_and_back_to_the_last_bit_but_for_nanoseconds(tmp_path, ending):
    rng = np.random.default_rng(5)
    sums = np.cumsum(rng.uniform(1e-3, 2.0, 20))
    times = np.r_[0.0, sums]
    drawn = rng.integers(-12, 3, (3, 21, 3))
    values = rng.normal(size=(3, 21, 3)) * 10.0**drawn
    samples = Samples(("a", "b", "c"), times, *values)
    path = tmp_path / f"motion{ending}"
    joint_trajectory.write(path, samples)
    read = joint_trajectory.read(path)
    np.testing.assert_allclose(read.times, times, rtol=0, atol=0.51e-9)
    for name in ("positions", "velocities", "accelerations"):
        expected = getattr(samples, name).tolist()
        assert getattr(read, name).tolist() == expected


def with_point(**changes):
    table = message()
    table["points"][1] |= changes
    return table


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"foo": 1}, "expected a JointTrajectory"),
        ([], "expected a JointTrajectory"),
        ({"trajectory": {"joint_trajectory": {"joint_names": ["a"]}}}, "expected a JointTraj"),
        (message(points=[]), "points is []: expected at least two points"),
        (message(points=[1, 2]), "points, point 1 is 1: expected a table"),
        (message(joint_names=[]), "joint_names is []"),
        (message(joint_names=["a", "a"]), "joint_names, joint 2 is 'a': expected names that"),
        (with_point(positions=[1.0]), "points, point 2: positions is [1.0]: expected 2 numbers"),
        (with_point(positions=[]), "points, point 2: positions is []: expected numbers in every"),
        (with_point(velocities=[1, None]), "velocities, joint 2: expected a finite number"),
        (with_point(velocities=[1, float("nan")]), "velocities, joint 2 is nan: expected a fin"),
        (with_point(velocities=[1, True]), "velocities, joint 2 is True: expected a finite"),
        (with_point(velocities=[0, "..."]), "--full-length"),
        (with_point(time_from_start=0), "times, sample 2 is 0.0: expected a time after 0 s"),
        (with_point(time_from_start={"sec": "x"}), "time_from_start.sec is 'x'"),
        (with_point(time_from_start={}), "time_from_start is {}: expected {sec, nanosec}"),
        (with_point(time_from_start={"s": 1}), "expected {sec, nanosec}"),
        (message(points=message()["points"][1:] * 2), "time_from_start is 1.5: expected 0, with"),
    ],
)
def test_errors_name_the_point_the_joint_and_what_would_be_right(table, said):
    with pytest.raises(InvalidInput) as caught:
        joint_trajectory.from_message(table)
    assert said in str(caught.value)


def test_a_first_point_after_time_zero_is_refused():
    table = message()
    table["points"][0]["time_from_start"] = 0.5
    with pytest.raises(InvalidInput, match=r"point 1: time_from_start is 0\.5: expected 0, with"):
        joint_trajectory.from_message(table)


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("m.json", b"{", "m.json: JointTrajectory"),
        ("m.yaml", b"a: [", "m.yaml: JointTrajectory"),
        ("m.yaml", b"\xff\xfe\x00", "m.yaml: JointTrajectory"),
        ("m.yaml", b"", "m.yaml: JointTrajectory is 0: expected one message"),
        ("m.yaml", (ECHOED + ECHOED).encode(), "is 2: expected one message"),
        ("m.json", json.dumps(message(joint_names=3)).encode(), "m.json: joint_names is 3"),
    ],
)
def test_errors_name_the_file(tmp_path, name, content, said):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InvalidInput) as caught:
        joint_trajectory.read(path)
    assert said in str(caught.value)


def test_a_file_that_is_not_there_and_an_ending_that_is_unknown(tmp_path):
    with pytest.raises(InvalidInput, match="does not exist"):
        joint_trajectory.read(tmp_path / "none.yaml")
    samples = joint_trajectory.from_message(message())
    with pytest.raises(InvalidInput, match=r"ending in \.json, \.yaml or \.yml"):
        joint_trajectory.write(tmp_path / "m.txt", samples)


def of_play_motion(**changes):
    """A motion as `play_motion` keeps it, and as `play_motion2` does."""
    points = message()["points"]
    meta = {"name": "Wave", "usage": "demo", "description": "wave"}
    table = {"joints": message()["joint_names"], "meta": meta}
    first = table | {"points": [own | {"velocities": []} for own in points]}
    positions = [item for own in points for item in own["positions"]]
    second = table | {"positions": positions, "times_from_start": [0.0, 1.5]}
    return first | changes, second | changes


@pytest.mark.parametrize("version", [0, 1])
def test_a_motion_of_play_motion(tmp_path, version):
    own = of_play_motion()[version]
    for whole in (own, {"play_motion2": {"ros__parameters": {"motions": {"wave": own}}}}):
        path = tmp_path / "motions.yaml"
        path.write_text(json.dumps(whole))
        samples = joint_trajectory.read(path)
        assert samples.joint_names == ("shoulder", "elbow")
        assert samples.times.tolist() == [0, 1.5]
        assert samples.positions.tolist() == [[0, 0], [0.1, -0.25]]
        assert samples.velocities is None


def test_a_file_of_motions_names_each_and_each_alone_is_read():
    for own in of_play_motion():
        both = {"wave": own, "nod": own}
        with pytest.raises(InvalidInput, match=r"wave, motions\.nod.*a file of its own"):
            joint_trajectory.from_message({"motions": both})
        assert joint_trajectory.from_message(both["nod"]).times.tolist() == [0, 1.5]


@pytest.mark.parametrize(
    "changes",
    [{"positions": [0, 0, 1]}, {"positions": 0}, {"times_from_start": 1.5}, {"positions": None}],
)
def test_positions_that_do_not_fit_the_times(changes):
    _, own = of_play_motion(**changes)
    with pytest.raises(InvalidInput, match=r"wave\.positions.*2 numbers.*each of times_from_start"):
        joint_trajectory.from_message({"wave": own})
