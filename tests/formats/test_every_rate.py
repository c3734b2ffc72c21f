"""A number that bounds a rate is read, refused or named in a line: every key of every format."""

from __future__ import annotations

import warnings
from itertools import chain

import pytest

from trajopt.core import arm_file, problem_file
from trajopt.core.exceptions import FileNote, InvalidInput
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem
from trajopt.formats import joint_limits, urdf

# Keys that bound no velocity, acceleration or jerk: flags, positions, efforts and their gains.
NO_RATE = {
    "angle_wraparound",
    "has_effort_limits",
    "has_position_limits",
    "has_soft_limits",
    "k_velocity",
    "max_effort",
    "max_position",
    "min_effort",
    "min_position",
    "lower",
    "upper",
    "effort",
    "soft_lower_limit",
    "soft_upper_limit",
    "joint",
    "multiplier",
    "offset",
}
ENTRY = {"max_velocity": 2, "max_acceleration": 4, "max_jerk": 50}
JOINT_KEYS = {*joint_limits.JOINT, *chain(*(k.elsewhere for k in joint_limits.JOINT.values()))}
LIMIT = 'lower="-3" upper="3" velocity="2" effort="1" '


def outcome(read, path):
    """What comes of a file: its limits, the error, or what the lines say."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            own = read(path)
            if own.unsound:
                return str(own.unsound["j"])
            return own.joints["j"], str(own.others), " ".join(str(w.message) for w in caught)
        except InvalidInput as error:
            return str(error)


def heeded(read, path, without, key):
    found = outcome(read, path)
    if found[:2] == without[:2] and not isinstance(found, str):
        return key in found[2]
    return True


@pytest.mark.parametrize("key", sorted(JOINT_KEYS - NO_RATE))
def test_every_key_of_a_joint_limits_yaml(tmp_path, key):
    path = tmp_path / "l.yaml"

    def written(entry):
        own = ", ".join(f"{name}: {value}" for name, value in entry.items())
        path.write_text(f"joint_limits: {{j: {{{own}}}}}")

    written(ENTRY)
    without = outcome(joint_limits.read, path)
    written(ENTRY | {key: "false" if key.startswith("has_") else -0.5 if "min" in key else 0.5})
    if key == "has_deceleration_limits":  # without max_deceleration it lifts nothing
        assert outcome(joint_limits.read, path) == without
        return
    assert heeded(joint_limits.read, path, without, key)


RATES = [
    ("limit", "velocity"),
    ("limit", "acceleration"),
    ("limit", "deceleration"),
    ("limit", "jerk"),
    ("limit", "max_velocity"),
    ("limit", "gear_velocity"),
    ("limit", "accel"),
    ("dynamics", "max_speed"),
    ("velocity_limits", "max"),
    ("safety_controller", "k_position"),
    ("position_based_velocity_limits", "velocity_offset"),
    ("position_based_velocity_limits", "deceleration_limit"),
]


def test_the_walk_has_every_attribute_that_is_known():
    known = {(tag, name) for tag, names in urdf.ATTRIBUTES.items() for name in names}
    assert {(tag, name) for tag, name in known if name not in NO_RATE} <= set(RATES)


@pytest.mark.parametrize(("tag", "key"), RATES)
def test_every_attribute_of_a_urdf(tmp_path, tag, key):
    path = tmp_path / "r.urdf"

    def written(own, other=""):
        path.write_text(
            '<robot name="r"><link name="a"/><link name="b"/><joint name="j" type="revolute">'
            f'<parent link="a"/><child link="b"/><limit {own}/>{other}</joint></robot>'
        )

    written(LIMIT)
    without = outcome(urdf.read, path)
    said = f'{key}="0.5"'
    if tag != "limit":
        written(LIMIT, f"<{tag} {said}/>")
    elif key == "velocity":
        written(LIMIT.replace('velocity="2"', said))
    else:
        written(LIMIT + said)
    assert heeded(urdf.read, path, without, key)


INTERFACES = """<ros2_control name="c" type="system"><joint name="j">
<command_interface name="velocity"><param name="min">-0.5</param><param name="max">9</param>
</command_interface></joint></ros2_control>"""


def test_a_narrower_range_of_an_interface_is_named(tmp_path):
    path = tmp_path / "r.urdf"
    joint = f'<joint name="j" type="revolute"><limit {LIMIT}/></joint>'
    path.write_text(f'<robot name="r">{joint}{INTERFACES}</robot>')
    with pytest.warns(FileNote, match="not read: ros2_control velocity min of j$"):
        urdf.read(path)


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("servo: {j: {max_velocity: 0.1}}", "servo.j.max_velocity"),
        ("rates: {max_accel: 1}", "rates.max_accel"),
        ("top_speed: 0.1", "top_speed"),
    ],
)
def test_a_rate_under_an_unknown_section_is_named(tmp_path, text, named):
    path = tmp_path / "l.yaml"
    path.write_text(f"joint_limits: {{j: {{max_velocity: 2}}}}\n{text}\n")
    with pytest.warns(FileNote, match=f"not read: {named}$"):
        joint_limits.read(path)


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("max_velocity: 2, min_velocity: 0.5", "min_velocity is 0.5: expected a negative number"),
        ("min_velocity: -1", "min_velocity is -1: expected a negative number, beside max_velocity"),
        ("max_velocity: $(arg fast)", "this is a template, which a launch file or xacro fills in"),
        ("max_velocity: 2, max_deceleration: 1", "expected max_acceleration beside it"),
        ("max_velocity: 2, lower: 0", "j.lower is 0: expected the key min_position"),
        ("velocity: 2", "j.velocity is 2: expected the key max_velocity"),
    ],
)
def test_a_limit_that_is_half_said(tmp_path, entry, words):
    path = tmp_path / "l.yaml"
    path.write_text(f"joint_limits: {{j: {{{entry}}}}}")
    with pytest.raises(InvalidInput) as caught:
        joint_limits.read(path)
    assert words in str(caught.value)


def test_pairs_and_braking(tmp_path):
    path = tmp_path / "l.yaml"
    own = "max_velocity: 3, min_velocity: -2, max_acceleration: 4, min_acceleration: -1, "
    path.write_text(
        f"joint_limits: {{j: {{{own} max_jerk: 9, min_jerk: -7, max_deceleration: 2}}}}"
    )
    with pytest.warns(FileNote, match="the smaller one holds for both: j$"):
        limits = joint_limits.read(path).limits(["j"])
    assert limits.velocity.tolist() == [[-2, 3]]
    assert limits.acceleration.tolist() == [[-1, 2]]
    assert limits.jerk.tolist() == [[-7, 9]]


def slider(path, own):
    joint = f'<joint name="j" type="prismatic"><limit {LIMIT}{own}/></joint>'
    path.write_text(f'<robot name="r">{joint}</robot>')
    return urdf.read(path)


DRAKE = '<robot name="r" xmlns:drake="http://drake.mit.edu">'


@pytest.mark.parametrize("root", [DRAKE, '<robot name="r">'])  # declared, and not
def test_drake_s_limits_are_read(tmp_path, root):
    path = tmp_path / "r.urdf"
    own = 'drake:acceleration="3" drake:jerk="40"'
    joint = f'<joint name="j" type="revolute"><limit {LIMIT}{own}/></joint>'
    path.write_text(f"{root}{joint}<sensor:camera name='c'/></robot>")
    limits = urdf.read(path).limits(["j"])
    assert limits.acceleration.tolist() == [[-3, 3]]
    assert limits.jerk.tolist() == [[-40, 40]]


def test_macros_of_an_undeclared_xacro_are_refused(tmp_path):
    path = tmp_path / "r.urdf"
    joint = f'<joint name="j" type="revolute"><limit {LIMIT}/></joint>'
    path.write_text(f'<robot name="r">{joint}<xacro:arm/></robot>')
    with pytest.raises(InvalidInput, match=r"make one: xacro r\.urdf > robot\.urdf"):
        urdf.read(path)


def test_a_urdf_of_version_1_2(tmp_path):
    path = tmp_path / "r.urdf"
    limits = slider(path, 'acceleration="1" jerk="20"').limits(["j"])
    assert limits.acceleration.tolist() == [[-1, 1]]
    assert limits.jerk.tolist() == [[-20, 20]]
    with pytest.warns(FileNote, match="the smaller one holds for both: j$"):
        own = slider(path, 'acceleration="3" deceleration="2"')
    assert own.limits(["j"]).acceleration.tolist() == [[-2, 2]]
    assert "acceleration" not in slider(path, 'acceleration="0" jerk="inf"').joints["j"]
    negative = slider(path, 'acceleration="-1"')
    with pytest.raises(InvalidInput, match=r"limit acceleration is -1\.0: expected 0"):
        negative.limits(["j"])
    template = slider(path, 'acceleration="${a}"')
    with pytest.raises(InvalidInput, match=r"is '\$\{a\}': expected a number; xacro"):
        template.limits(["j"])


# --- problem files and arm files: every key that they may hold ---

PROBLEM = """name = "n"
source = "s"
joint_names = ["j"]
waypoints = [[0], [1], [-1]]
units = {waypoints = "rad", limits = "rad"}
"""
FRAME = "origins = [[1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]], axes = [[0, 0, 1]], slides = [0]"
BODY = (
    "mass = [2.0], centre = [[0.3, 0, 0]], inertia = [[0, 0, 0, 0, 0, 0]], damping = [0.1], "
    "friction = [0.2], gravity = [0, 0, -9.81]"
)
OF_KIND = {  # what a table of limits says, and another value
    **dict.fromkeys(("velocity", "acceleration", "jerk"), ("[2.0]", "[1.0]")),
    "position": ("[[-3, 3]]", "[[-2, 2]]"),
    "falling_velocity": (
        "{offset = [0.1], deceleration = [2.0], position = [[-3, 3]]}",
        "{offset = [0.1], deceleration = [1.0], position = [[-3, 3]]}",
    ),
    "tool_speed": (
        f"{{speed = 0.5, {FRAME}, tool = [0.3, 0, 0]}}",
        f"{{speed = 0.4, {FRAME}, tool = [0.3, 0, 0]}}",
    ),
    "link_speed": (
        f"{{speed = [0.5], {FRAME}, place = [[0.3, 0, 0]]}}",
        f"{{speed = [0.4], {FRAME}, place = [[0.3, 0, 0]]}}",
    ),
    "torque": (f"{{torque = [5.0], {FRAME}, {BODY}}}", f"{{torque = [4.0], {FRAME}, {BODY}}}"),
}


def problem_of(path):
    """What a problem file says, or why it is refused."""
    try:
        own = Problem.from_toml(path)
    except InvalidInput as error:
        return str(error)
    return problem_file.text(own)


def limits_of(values):
    return "[limits]\n" + "".join(f"{key} = {value}\n" for key, value in values.items())


@pytest.mark.parametrize("kind", KINDS)
def test_every_limit_of_a_problem_file(tmp_path, kind):
    path = tmp_path / "p.toml"
    whole = {key: OF_KIND[key][0] for key in ("velocity", "acceleration", kind)}
    found = set()
    for value in OF_KIND[kind]:
        path.write_text(PROBLEM + limits_of(whole | {kind: value}))
        found.add(problem_of(path))
    assert len(found) == 2
    assert all(f"{kind} = " in text or f"limits.{kind}]" in text for text in found)


@pytest.mark.parametrize("value", ["0.5", "'other'"])
@pytest.mark.parametrize("key", sorted({*problem_file.KEYS, "max_velocity", "speed"}))
def test_every_key_of_a_problem_file(tmp_path, key, value):
    """A number or a text under any key changes the problem, or is refused."""
    path = tmp_path / "p.toml"
    limits = limits_of({key: OF_KIND[key][0] for key in ("velocity", "acceleration")})
    path.write_text(PROBLEM + limits)
    without = problem_of(path)
    lines = [line for line in PROBLEM.splitlines() if not line.startswith(f"{key} = ")]
    path.write_text("\n".join([f"{key} = {value}", *lines, limits if key != "limits" else ""]))
    if key == "published":  # of a paper's problem, which another reader checks
        assert problem_of(path) == without
        return
    assert problem_of(path) != without


@pytest.mark.parametrize("kind", KINDS)
def test_every_limit_of_an_arm_file(tmp_path, kind):
    path = tmp_path / "a.toml"
    found = []
    for value in OF_KIND[kind]:
        whole = {key: OF_KIND[key][0] for key in ("velocity", "acceleration")} | {kind: value}
        tables = [
            f'[{key}]\nvalues = {own}\nangle_unit = "rad"\nstatus = "assumed"\nsource = "s"\n'
            for key, own in whole.items()
        ]
        path.write_text('name = "a"\ndescription = "d"\n' + "".join(tables))
        found.append(arm_file.read(str(path)).limits)
        path.write_text(path.read_text() + "max_speed = 1\n")
        with pytest.raises(InvalidInput, match="max_speed"):
            arm_file.read(str(path))
    assert found[0] != found[1]
