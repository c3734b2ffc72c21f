"""Files that mean harm, or had an accident: refused soon, in one short line."""

from __future__ import annotations

import json
import zipfile

import numpy as np
import pytest
from work import calls, doubling

from trajopt.benchmark.suites import literature
from trajopt.core import arm_file, files
from trajopt.core.exceptions import InvalidInput, UnknownName, shown
from trajopt.core.problem import Problem
from trajopt.formats import arms, joint_limits, joint_trajectory, urdf, waypoints
from trajopt.formats.motion import check_work, motion
from trajopt.planners.kinematics import Robot

MOST_CALLS = 100_000  # an honest file of this size takes a few thousand
LONGEST_MESSAGE = 1500  # characters

READERS = {
    "problem.toml": Problem.from_toml,
    "arm.toml": lambda path: arms.named(str(path)),
    "robot.toml": Robot.from_toml,
    "published.toml": literature.published,
    "joint_limits.yaml": joint_limits.read,
    "message.yaml": motion,
    "motion.json": motion,
    "motion.csv": motion,
    "waypoints.csv": waypoints.read,
    "waypoints.json": waypoints.read,
    "waypoints.npy": waypoints.read,
    "robot.urdf": urdf.read,
}
TEXTS = [name for name in READERS if not name.endswith(".npy")]
HEADER = "time [s],elbow [rad]\n"


def refused(tmp_path, name, content):
    """The error's text for a file of this content; a number is the size of a file of zeros."""
    path = tmp_path / name
    if isinstance(content, int):
        with path.open("wb") as file:
            file.truncate(content)
    elif isinstance(content, bytes):
        path.write_bytes(content)
    else:
        path.write_text(content, encoding="utf-8")
    with pytest.raises(InvalidInput) as caught:
        calls(lambda: READERS[name](path), at_most=MOST_CALLS)
    text = str(caught.value)
    assert str(path) in text
    expected = LONGEST_MESSAGE + len(str(path))
    assert len(text) < expected
    return text


@pytest.mark.parametrize("name", READERS)
def test_ten_times_too_large_a_file(tmp_path, name):
    text = refused(tmp_path, name, 10 * files.MAX_BYTES)
    if name in TEXTS:
        assert "it has more than" in text


NUMBER = "1" * 10 * files.MAX_WORD + "x"
ONE_NUMBER = {
    ".toml": f"waypoints = [[{NUMBER}]]",
    ".yaml": f"joint_limits: {{a: {{max_velocity: {NUMBER}}}}}",
    ".json": f'{{"breaks": [{NUMBER}], "coefficients": []}}',
    ".csv": f"{HEADER}0,{NUMBER}\n",
    ".urdf": f'<robot><joint name="{NUMBER}"/></robot>',
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_number_of_thousands_of_digits(tmp_path, name):
    ending = name[name.index(".") :]
    text = refused(tmp_path, name, ONE_NUMBER[ending])
    assert f"a word of more than {files.MAX_WORD} characters" in text


DEEP = 10 * files.MAX_DEPTH
NESTED = {
    ".toml": f"a = {'[' * DEEP}{']' * DEEP}",
    ".yaml": f"{'[' * DEEP}{']' * DEEP}",
    ".json": f"{'[' * DEEP}{']' * DEEP}",
}


@pytest.mark.parametrize("name", [name for name in TEXTS if "." + name.partition(".")[2] in NESTED])
def test_nested_too_deep(tmp_path, name):
    text = refused(tmp_path, name, NESTED[name[name.index(".") :]])
    assert "nested deeper than 40" in text


def test_a_key_of_many_parts(tmp_path):
    key = " . ".join(["a"] * 20_000)
    assert "nested deeper than 40" in refused(tmp_path, "problem.toml", f"{key} = 1")


@pytest.mark.parametrize("name", TEXTS)
def test_too_many_values(tmp_path, monkeypatch, name):
    monkeypatch.setattr(files, "MAX_VALUES", 100)
    values = "1,\n" * 500
    assert "it has more than 100 values" in refused(tmp_path, name, values)


ALIASES = "a0: &a0 {k: 1}\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 10)
)
MERGED = "a0: &a0 {k: 1}\n" + "".join(
    f"a{n}: &a{n} {{<<: *a{n - 1}, b: *a{n - 1}, c: *a{n - 1}, d: *a{n - 1}}}\n"
    for n in range(1, 20)
)
CHAIN = "a0: &a0 1\n" + "".join(f"a{n}: &a{n} [*a{n - 1}]\n" for n in range(1, 400))


@pytest.mark.parametrize("name", ["joint_limits.yaml", "message.yaml"])
@pytest.mark.parametrize(
    ("text", "words"),
    [
        (f"{ALIASES}joint_limits: *a9\n", "it has more than 20000 values, line 5"),
        (f"{MERGED}joint_limits: *a19\n", "it has more than 20000 values"),
        (CHAIN, "nested deeper than 40, line 41"),
        ("a: &a [*a]", "an alias *a of no value before it, line 1"),
        ("a: *b", "an alias *b of no value before it, line 1"),
        ("a: &a {b: 1}\nc: {<<: [*a, *a]}", "a merge key << of more than one table, line 2"),
        ("[1, 2]: 3", "a key is no text, line 1"),
        ("{a: 1}: 3", "a key is no text, line 1"),
        ("a: 1\nb: 2\n'a': 3", "the key a is there twice, line 3"),
        ("a: !!binary x", "a tag tag:yaml.org,2002:binary"),
    ],
)
def test_what_yaml_makes_endless_or_ambiguous(tmp_path, monkeypatch, name, text, words):
    monkeypatch.setattr(files, "MAX_VALUES", 20_000)
    assert words in refused(tmp_path, name, text)


@pytest.mark.parametrize("value", ["1:30", "010", "0o10", "0x10", "1_000", ".inf", "٣", "'010'"])
def test_what_is_another_number_in_another_yaml(tmp_path, value):
    text = f"joint_limits: {{elbow: {{max_velocity: {value}}}}}"
    assert "elbow.max_velocity is " in refused(tmp_path, "joint_limits.yaml", text)


@pytest.mark.filterwarnings("ignore::trajopt.core.exceptions.FileNote")
def test_aliases_and_merge_keys_of_real_files(tmp_path):
    path = tmp_path / "joint_limits.yaml"
    path.write_text(
        "fast: &fast 1.5\n"
        "joint_limits:\n"
        "  a: &a {max_velocity: *fast, max_acceleration: 2, min_effort: -1}\n"
        "  b: *a\n"
        "  c: {max_velocity: 3, <<: *a}\n"
    )
    joints = joint_limits.read(path).joints
    assert joints["a"] == {"velocity": (-1.5, 1.5), "acceleration": (-2, 2)}
    assert joints["b"] == joints["a"]
    assert joints["c"] == {"velocity": (-3, 3), "acceleration": (-2, 2)}


def test_a_joint_may_have_any_name(tmp_path):
    path = tmp_path / "joint_limits.yaml"
    path.write_text("joint_limits: {on: {max_velocity: 1}, 010: {max_velocity: 1e-1}}")
    read = joint_limits.read(path)
    assert read.joint_names == ("on", "010")
    assert read.joints["010"] == {"velocity": (-0.1, 0.1)}


@pytest.mark.parametrize("name", ["motion.json", "waypoints.json"])
def test_a_key_twice_in_json(tmp_path, name):
    assert "the key a is there twice" in refused(tmp_path, name, '[{"a": 1, "b": 2, "a": 3}]')


POINT = {"positions": [0.0], "time_from_start": 0}
MESSAGE = {"joint_names": ["elbow"], "points": [POINT, {"positions": [1], "time_from_start": 1}]}


def message(**changes):
    first, second = MESSAGE["points"]
    return {**MESSAGE, "points": [first, second | changes]}


POLYNOMIALS = {"breaks": [0, 1], "coefficients": [[[1]]]}


@pytest.mark.parametrize(
    ("name", "table", "words"),
    [
        ("joint_limits.yaml", {"default_velocity_scaling": 0.1}, "default_velocity_scaling_f"),
        ("joint_limits.yaml", {"joint_limits": {"a": {"max_velocty": 1}}}, "the key max_velocity"),
        ("message.yaml", message(acceleration=[1]), "the key accelerations"),
        ("motion.json", message(acceleration=[1]), "point 2: acceleration is [1]: expected the"),
        ("motion.json", MESSAGE | {"unit": "deg"}, "unit is 'deg': expected this key left out"),
        ("motion.json", POLYNOMIALS | {"unit": "deg"}, "unit is 'deg': expected this key left"),
        ("motion.json", POLYNOMIALS | {"joint_name": ["a"]}, "expected the key joint_names"),
        ("waypoints.json", {"waypoints": [[1]], "units": "deg"}, "units is 'deg': expected the"),
    ],
)
def test_an_unknown_key_names_the_nearest(tmp_path, name, table, words):
    table = {"joint_limits": {"a": {}}} | table if name == "joint_limits.yaml" else table
    assert words in refused(tmp_path, name, json.dumps(table))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("velocity =", "velocty =", "limits.velocty is [1]: expected the key velocity"),
        ("units.limits", "units.limit", "units.limit is 'rad': expected the key limits"),
        ("source", "sorce", "sorce is 'here': expected the key source"),
        ("[1]\nlimits.a", f"[0x{'f' * 300}]\nlimits.a", "limits.velocity, joint 1 is "),
        ("'here'", f"0x{'f' * 5000}", "a word of more than"),
    ],
)
def test_what_is_wrong_in_a_problem_file(tmp_path, old, new, words):
    text = """source = 'here'
waypoints = [[0], [1]]
units.waypoints = 'rad'
units.limits = 'rad'
limits.velocity = [1]
limits.acceleration = [2]
"""
    assert old in text
    expected = refused(tmp_path, "problem.toml", text.replace(old, new, 1))
    assert words in expected


@pytest.mark.parametrize(
    ("kind", "words"),
    [("acceleration", "acceleration: expected this key"), ("velocity", "velocity: expected this")],
)
def test_an_arm_without_a_limit_that_every_problem_needs(tmp_path, kind, words):
    text = arm_file.arm_files()["ur5e"].read_text(encoding="utf-8")
    expected = refused(tmp_path, "arm.toml", text.replace(f"[{kind}]", "[jerk]"))
    assert words in expected


def test_a_wrong_limit_of_an_arm_names_its_file(tmp_path):
    text = arm_file.arm_files()["ur5e"].read_text(encoding="utf-8")
    wrong = text.replace("[180, 180", "[0, 180", 1)
    assert "limits.velocity, joint 1 is 0.0" in refused(tmp_path, "arm.toml", wrong)


@pytest.mark.parametrize(
    "duration",
    [
        {"sec": 1, "nanosec": 5e9},
        {"sec": 1, "nanosec": -1},
        {"sec": 1, "nanosec": 2**64},
        {"sec": 1, "nanosec": 0.5},
        {"sec": 2**31, "nanosec": 0},
        {"sec": -1, "nanosec": 0},
        {"secs": 1, "nsecs": 10**9},
    ],
)
def test_a_duration_that_no_message_holds(duration):
    with pytest.raises(InvalidInput, match="a whole number from 0 to"):
        joint_trajectory.from_message(message(time_from_start=duration))


def test_a_message_of_many_points_takes_work_in_proportion():
    points = [{"positions": [float(n)], "time_from_start": n} for n in range(4000)]

    def read(count):
        joint_trajectory.from_message({"joint_names": ["elbow"], "points": points[:count]})

    assert doubling(read, 2000) < 2.1


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ("0,0\n1e-9999999999999999999999,1\n", "line 3, column 1, time [s],"),
        ("0,0\n1,1e-9999999999999999999999\n", "line 3, column 2, elbow [rad],"),
        ("0,0\n1,1_0\n", "is '1_0': expected a finite number"),
        ("0,0\n1,١\n", "expected a finite number"),
    ],
)
def test_a_cell_that_is_no_number(tmp_path, rows, words):
    assert words in refused(tmp_path, "motion.csv", HEADER + rows)


def test_polynomials_that_are_too_much_work(tmp_path):
    high = {"breaks": [0, 1], "coefficients": [[[1]]] * 5001}
    assert "at most degree 100" in refused(tmp_path, "motion.json", json.dumps(high))
    with pytest.raises(InvalidInput, match="400000 pieces of degree 7 for 6 joints"):
        check_work(8, 400_000, 6)


def npy(tmp_path, shape, kind="<f8"):
    path = tmp_path / "header.npy"
    header = {"descr": kind, "fortran_order": False, "shape": shape}
    with path.open("wb") as file:
        np.lib.format.write_array_header_1_0(file, header)
    return path.read_bytes()


def test_arrays_that_are_none(tmp_path):
    expected = refused(tmp_path, "waypoints.npy", npy(tmp_path, (10**12, 1)) + bytes(64))
    assert "a readable .npy file" in expected
    with zipfile.ZipFile(tmp_path / "waypoints.npz", "w") as archive:
        archive.writestr("a.npy", "x")
    expected = refused(tmp_path, "waypoints.npy", (tmp_path / "waypoints.npz").read_bytes())
    assert "a readable .npy file" in expected
    old = npy(tmp_path, (2, 1)).replace(b"(2, 1)", b"(2L,1)") + bytes(16)  # NumPy warns of it
    assert "a readable .npy file" in refused(tmp_path, "waypoints.npy", old)
    expected = refused(tmp_path, "waypoints.npy", npy(tmp_path, (2,), "<c16") + bytes(32))
    assert "an array of numbers" in expected


def test_errors_show_the_beginning_of_a_value():
    found = len(shown([list(range(10**5))] * 10**5))
    assert found < 801
    found = len(shown("a" * 10**6))
    assert found < 300
    assert shown(10**5000) == "a value of type int"
    assert shown([0.5, -1]) == "[0.5, -1]"
    found = len(str(InvalidInput("k" * 10**6, "e" * 10**6, value={"a": "b" * 10**6})))
    assert found < 2000
    found = len(str(UnknownName("planner", "p" * 10**6, ["exact"])))
    assert found < 300


def test_a_urdf_of_a_million_nested_tags_is_refused_before_it_is_parsed(tmp_path):
    file = tmp_path / "deep.urdf"
    file.write_text("<robot>" + "<a>" * 1_000_000, encoding="utf-8")
    with pytest.raises(InvalidInput, match="at most 400000 tags"):
        urdf.read(file)
