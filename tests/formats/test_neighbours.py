"""A key beside the right one: whatever it is called and holds, the file is read as without it."""

from __future__ import annotations

import json
import re
import warnings

import pytest

from trajopt.core import problem_file
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.out_of_scope import out_of_scope
from trajopt.core.problem import Problem
from trajopt.formats import joint_limits, joint_state, joint_trajectory, motion, urdf, waypoints
from trajopt.formats.motion import motion as read_motion

VALUES = [True, 1.5, "text", [1.0, 2.0], {"a": 1}]
NEIGHBOURS = ["{}s", "has_{}", "{}_limits", "min_{}", "max_{}", "{}_of_others", "drake_{}"]

RATES = {"max_velocity": 2, "max_acceleration": 4, "max_jerk": 50, "max_deceleration": 4}
JOINT = {
    **{key: key != "has_soft_limits" for key in joint_limits.JOINT if key.startswith("has_")},
    **RATES,
    **{f"min_{kind}": -1 for kind in ("velocity", "acceleration", "jerk", "effort")},
    "min_position": -3,
    "max_position": 3,
    "angle_wraparound": False,
    "max_effort": 5,
    "k_position": 1,
    "k_velocity": 1,
    "soft_lower_limit": -2,
    "soft_upper_limit": 2,
}
POINTS = [
    {"positions": [0.0], "velocities": [0.0], "accelerations": [0.0], "effort": [0.0]}
    | {"time_from_start": time}
    for time in (0, 1)
]
POINTS[1]["positions"] = [1.0]
MESSAGE = {"header": {}, "joint_names": ["j"], "points": POINTS, "meta": {"name": "nod"}}
STATES = [
    {"header": {"stamp": {"sec": sec, "nanosec": 0}}, "name": ["j"], "position": [sec]}
    | {"velocity": [0.0], "effort": [0.0]}
    for sec in (0.0, 1.0)
]
STATES = [json.loads(json.dumps(own).replace('.0, "nano', ', "nano')) for own in STATES]
PP = {"form": "pp", "breaks": [0, 1], "coefs": [[1, 0]], "pieces": 1, "order": 2, "dim": 1}
POLYNOMIALS = {"breaks": [0, 1], "coefficients": [[[1.0]], [[0.0]]], "joint_names": ["j"]}
POLYNOMIALS |= {"lengths": [1.0], **dict.fromkeys(motion._OF_TRIAL, "of a trial")}
ROWS = {"waypoints": [[0.0], [1.0]], "joint_names": ["j"], "unit": "rad"}
LIMIT = {"lower": -3, "upper": 3, "velocity": 2, "effort": 1}
LIMIT |= {"acceleration": 4, "deceleration": 4, "jerk": 50}
ELEMENTS = {
    "limit": LIMIT,
    "safety_controller": {"soft_lower_limit": -2, "soft_upper_limit": 2}
    | {"k_position": 1, "k_velocity": 1},
    "position_based_velocity_limits": {"velocity_offset": 0.1, "deceleration_limit": 2},
    "dynamics": {"damping": 1},
}


def robot(elements):
    """A URDF of one joint with these elements and attributes."""
    inner = ""
    for tag, own in elements.items():
        attributes = own if isinstance(own, dict) else {"value": own}
        said = " ".join(f'{key}="{value}"' for key, value in attributes.items())
        inner += f"<{tag} {said}/>"
    return f'<robot name="r"><joint name="j" type="revolute">{inner}</joint></robot>'


def yaml_of(documents):
    return "\n---\n".join(map(json.dumps, documents))


def limits_of(path):
    own = joint_limits.read(path)
    return own.joints


def joints_of(path):
    own = urdf.read(path)
    assert not own.unsound, own.unsound
    return own.joints, {key: rows["j"].tolist() for key, rows in own.others.items()}


def digest(path):
    return read_motion(path).digest()


def outcome(read, path):
    """What is read, or the error's words."""
    try:
        return read(path)
    except InvalidInput as error:
        return str(error)


# A format's keys, the file's name, how it is written with one table changed, and how it is read.
FORMATS = {
    "joint limits": (
        joint_limits.JOINT,
        JOINT,
        "l.yaml",
        lambda own: json.dumps({"joint_limits": {"j": own}}),
        limits_of,
    ),
    "elements": (urdf.ELEMENTS, ELEMENTS, "r.urdf", robot, joints_of),
    "limit": (urdf.LIMIT, LIMIT, "r.urdf", lambda own: robot({"limit": own}), joints_of),
    "safety": (
        urdf.SAFETY,
        ELEMENTS["safety_controller"],
        "r.urdf",
        lambda own: robot(ELEMENTS | {"safety_controller": own}),
        joints_of,
    ),
    "message": (joint_trajectory.MESSAGE, MESSAGE, "m.json", json.dumps, digest),
    "point": (
        joint_trajectory.POINT,
        POINTS[1],
        "m.json",
        lambda own: json.dumps(MESSAGE | {"points": [POINTS[0], own]}),
        digest,
    ),
    "state": (
        joint_state.STATE,
        STATES[1],
        "m.yaml",
        lambda own: yaml_of([STATES[0], own]),
        digest,
    ),
    "pp": (motion.MATLAB, PP, "m.json", json.dumps, digest),
    "polynomials": (motion.POLYNOMIALS, POLYNOMIALS, "m.json", json.dumps, digest),
    "rows": (
        waypoints.TABLE,
        ROWS,
        "w.json",
        json.dumps,
        lambda path: waypoints.read(path).rows.tolist(),
    ),
}
PAIRS = [(name, key) for name, own in FORMATS.items() for key in own[0] if key in own[1]]


def test_every_key_is_tried():
    """But the elements and attributes that make a joint another one, or none."""
    tried = set(PAIRS)
    missing = {(name, key) for name, own in FORMATS.items() for key in own[0]} - tried
    assert {key for _, key in missing} <= {
        "mimic",
        *(["axis", "calibration", "child", "origin", "parent"]),
    }


@pytest.mark.parametrize(("name", "key"), PAIRS)
def test_a_neighbour_of_a_right_key_changes_nothing(tmp_path, name, key):
    keys, right, file, written, read = FORMATS[name]
    path = tmp_path / file
    path.write_text(written(right))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileNote)
        expected = read(path)
        for pattern in NEIGHBOURS:
            neighbour = pattern.format(key)
            if neighbour in keys or any(neighbour in own.elsewhere for own in keys.values()):
                continue
            for value in VALUES:
                path.write_text(written(right | {neighbour: value}))
                if file.endswith("urdf") and isinstance(value, dict) and name != "elements":
                    continue  # an attribute is a text
                found = outcome(read, path)
                if found != expected:  # of ours, which asks for something
                    assert "this key left out: " in found, (neighbour, value)
                    assert out_of_scope(neighbour) or "unit" in neighbour


@pytest.mark.parametrize("value", VALUES)
def test_what_is_not_read_is_said(tmp_path, value):
    path = tmp_path / "l.yaml"
    own = RATES | {"has_max_jerk": value, "has_jerk": False}
    path.write_text(json.dumps({"joint_limits": {"j": own, "k": own}}))
    with pytest.warns(FileNote, match="not read: has_max_jerk, has_jerk$"):
        joint_limits.read(path)


def test_a_misspelt_key_is_refused_whose_value_fits(tmp_path):
    path = tmp_path / "l.yaml"
    for key, value in {"max_jerks": 30, "has_jerk_limit": True, "min_positon": "-1"}.items():
        path.write_text(json.dumps({"joint_limits": {"j": {"max_velocity": 2, key: value}}}))
        near = {"max_jerks": "max_jerk", "has_jerk_limit": "has_jerk_limits"}
        with pytest.raises(InvalidInput, match=f"the key {near.get(key, 'min_position')}$"):
            joint_limits.read(path)
    path.write_text(json.dumps({"joint_limits": {"j": {"max_velocity": 2, "max_jerks": False}}}))
    with pytest.warns(FileNote, match="not read: max_jerks$"):
        assert joint_limits.read(path).joint_names == ("j",)


PROBLEM = 'waypoints = [[0], [1], [2]]\nunits = {waypoints = "rad", limits = "rad"}\n'
LIMITS = "[limits]\nvelocity = [2]\nacceleration = [4]\n"


def written(path):
    return problem_file.text(Problem.from_toml(path))


@pytest.mark.parametrize("key", [*problem_file.KEYS, "velocity", "acceleration"])
def test_a_neighbour_in_a_problem_file_is_read_or_has_a_sentence(tmp_path, key):
    """What asks for something is refused: the file is written for this tool."""
    path = tmp_path / "p.toml"
    path.write_text(PROBLEM + LIMITS)
    expected = written(path)
    for pattern in NEIGHBOURS:
        for value in ("true", "1.5", "'x'", "[1.0]"):
            said = f"{pattern.format(key)} = {value}\n"
            of_limits = key in ("velocity", "acceleration")
            path.write_text(PROBLEM + LIMITS + said if of_limits else said + PROBLEM + LIMITS)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", FileNote)
                found = outcome(written, path)
            if found != expected:
                present = key in ("waypoints", "units", "limits", "velocity", "acceleration")
                assert not present or "left out: " in found, said
                assert re.search("left out: |the key |one of the keys", found)
