"""Problems and their files: what is refused and in which words, digests, round trips."""

from __future__ import annotations

import dataclasses
import hashlib
import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from trajopt.benchmark.suites import catalogue as suites
from trajopt.core.exceptions import InvalidInput, UnitWarning
from trajopt.core.limits import Limits
from trajopt.core.problem import Problem
from trajopt.core.units import mixed_units

reproducible = settings(deadline=None, derandomize=True, max_examples=60)
seeds = st.integers(0, 2**32 - 1)
INF = np.inf
NAN = np.nan
DATA = Path(__file__).parents[2] / "data"

PLAIN = {
    "name": '"p"',
    "source": '"s"',
    "angle_unit": '"rad"',
    "waypoints": "[[0.0, 0.0], [1.0, -1.0]]",
    "velocity": "[1.0, 2.0]",
    "acceleration": "[3.0, 4.0]",
    "jerk": None,
    "position": None,
}


def text(**changes: str | None) -> str:
    """A problem file with some keys changed, or left out where None."""
    values = PLAIN | changes
    extra = [k for k in changes if k not in PLAIN]
    head = [k for k in ("name", "source", "angle_unit", "waypoints", *extra) if values[k]]
    limits = [k for k in ("velocity", "acceleration", "jerk", "position") if values[k]]
    lines = [f"{k} = {values[k]}" for k in head] + ["[limits]"]
    return "\n".join(lines + [f"{k} = {values[k]}" for k in limits])


def read(tmp_path: Path, content: str | bytes) -> Problem:
    file = tmp_path / "given.toml"
    file.write_bytes(content if isinstance(content, bytes) else content.encode())
    return Problem.from_toml(file)


REFUSED = [
    # changes, key, joint (from 1), value, what is right
    ({"speed": "1"}, "speed", None, "1", "every motion is as fast as its limits allow"),
    (
        {"colour": "1"},
        "colour",
        None,
        "1",
        "one of the keys angle_unit, chain, closed, duration",
    ),
    ({"velocity": None}, "limits.velocity", None, None, "it is missing"),
    ({"acceleration": None}, "limits.acceleration", None, None, "it is missing"),
    ({"waypoints": None}, "waypoints", None, None, "it is missing"),
    ({"angle_unit": None}, "angle_unit", None, None, '"deg" or "rad"'),
    ({"angle_unit": '"degrees"'}, "angle_unit", None, "'degrees'", '"deg" or "rad"'),
    ({"angle_unit": "1"}, "angle_unit", None, "1", '"deg" or "rad"'),
    ({"angle_unit": '["deg"]'}, "angle_unit", None, "['deg']", '"deg" or "rad"'),
    ({"name": "5"}, "name", None, "5", "a string"),
    ({"source": "[]"}, "source", None, "[]", "a string"),
    ({"velocity": "[1.0, 0.0]"}, "limits.velocity", 2, "0.0", "positive"),
    ({"velocity": "[-150.0, 1.0]"}, "limits.velocity", 1, "-150.0", "positive"),
    ({"velocity": "[1.0, -0.0]"}, "limits.velocity", 2, "-0.0", "positive"),
    ({"velocity": "[1.0, nan]"}, "limits.velocity", 2, "nan", "a number or"),
    ({"velocity": "[inf, 1.0]"}, "limits.velocity", 1, "inf", "finite"),
    ({"acceleration": "[1.0, inf]"}, "limits.acceleration", 2, "inf", "finite"),
    ({"acceleration": "[1.0, [-inf, 2.0]]"}, "limits.acceleration", 2, "[-inf, 2.0]", "finite"),
    ({"acceleration": "[1.0, [1.0, 2.0]]"}, "limits.acceleration", 2, "[1.0, 2.0]", "low < 0"),
    ({"acceleration": "[[-1.0, 0.0], 1]"}, "limits.acceleration", 1, "[-1.0, 0.0]", "low < 0"),
    ({"acceleration": "[[2.0, -1.0], 1]"}, "limits.acceleration", 1, "[2.0, -1.0]", "low < 0"),
    ({"jerk": "[1.0, -5.0]"}, "limits.jerk", 2, "-5.0", "positive"),
    ({"jerk": "[1.0, nan]"}, "limits.jerk", 2, "nan", "a number or"),
    ({"jerk": "[1.0]"}, "limits.jerk", None, "1", "2 values, one per joint"),
    ({"acceleration": "[1, 2, 3]"}, "limits.acceleration", None, "3", "2 values, one per joint"),
    ({"velocity": "[1, 2, 3]"}, "limits.acceleration", None, "2", "3 values, one per joint"),
    ({"velocity": "1.0"}, "limits.velocity", None, "1.0", "a list with a number"),
    ({"velocity": "[]"}, "limits.velocity", None, "[]", "a list with a number"),
    ({"velocity": '"fast"'}, "limits.velocity", None, "'fast'", "a list with a number"),
    ({"velocity": "{}"}, "limits.velocity", None, "{}", "a list with a number"),
    ({"velocity": '[1.0, "2"]'}, "limits.velocity", 2, "'2'", "a number or a [low, high] pair"),
    ({"velocity": "[true, 1.0]"}, "limits.velocity", 1, "True", "a number or"),
    ({"velocity": "[1.0, [1, 2, 3]]"}, "limits.velocity", 2, "[1, 2, 3]", "a number or"),
    ({"velocity": "[1.0, [1]]"}, "limits.velocity", 2, "[1]", "a number or"),
    ({"velocity": '[1.0, [-1, "1"]]'}, "limits.velocity", 2, "[-1, '1']", "a number or"),
    ({"velocity": "[1.0, [-1, true]]"}, "limits.velocity", 2, "[-1, True]", "a number or"),
    ({"velocity": "[1.0, 1979-05-27]"}, "limits.velocity", 2, "datetime.date", "a number or"),
    ({"velocity": f"[1.0, 1{'0' * 390}]"}, "limits.velocity", 2, "1000", "a number or"),
    ({"position": "[[-2, 2], [2, -2]]"}, "limits.position", 2, "[2.0, -2.0]", "low < high"),
    ({"position": "[[-2, 2], [2, 2]]"}, "limits.position", 2, "[2.0, 2.0]", "low < high"),
    ({"position": "[[-2, 2], [nan, 2]]"}, "limits.position", 2, "[nan, 2]", "a number or"),
    ({"position": "[[-2, 2], -1]"}, "limits.position", 2, "[1.0, -1.0]", "low < high"),
    ({"position": "[[0, 0.5], 2]"}, "waypoints, waypoint 2", 1, "1.0", "position [0, 0.5] rad"),
    ({"position": "[2, [-0.5, 2]]"}, "waypoints, waypoint 2", 2, "-1.0", "position [-0.5, 2] rad"),
    ({"waypoints": "[]"}, "waypoints", None, "[]", "at least two rows"),
    ({"waypoints": "[[0, 0]]"}, "waypoints", None, "[[0, 0]]", "at least two rows"),
    ({"waypoints": '"two"'}, "waypoints", None, "'two'", "at least two rows"),
    ({"waypoints": "3"}, "waypoints", None, "3", "at least two rows"),
    ({"waypoints": "[0, 1]"}, "waypoints, waypoint 1", None, "0", "a row of numbers"),
    ({"waypoints": "[[], []]"}, "waypoints, waypoint 1", None, "[]", "a row of numbers"),
    ({"waypoints": '["ab", "cd"]'}, "waypoints, waypoint 1", None, "'ab'", "a row of numbers"),
    ({"waypoints": "[[0, 0], [1]]"}, "waypoints, waypoint 2", None, "[1]", "2 numbers"),
    ({"waypoints": "[[0, 0], [1, nan]]"}, "waypoints, waypoint 2", 2, "nan", "a finite number"),
    ({"waypoints": "[[inf, 0], [1, 0]]"}, "waypoints, waypoint 1", 1, "inf", "a finite number"),
    ({"waypoints": '[[0, 0], ["1", 0]]'}, "waypoints, waypoint 2", 1, "'1'", "a finite number"),
    ({"waypoints": "[[0, true], [1, 0]]"}, "waypoints, waypoint 1", 2, "True", "a finite number"),
    ({"waypoints": "[[0, [1]], [1, 0]]"}, "waypoints, waypoint 1", 2, "[1]", "a finite number"),
    ({"waypoints": f"[[0, 0], [1{'0' * 390}, 0]]"}, "waypoints, waypoint 2", 1, "1000", "finite"),
    ({"waypoints": "[[1, 2], [1, 2], [1, 2]]"}, "waypoints", None, None, "these never move"),
    ({"waypoints": "[[0.0, -0.0], [0, 0]]"}, "waypoints", None, None, "these never move"),
    ({"waypoints": "[[0], [1]]"}, "limits.velocity", None, "2", "1 values, one per joint"),
]


@pytest.mark.parametrize(("changes", "key", "joint", "value", "right"), REFUSED)
def test_a_bad_file_is_refused_in_words_that_mend_it(tmp_path, changes, key, joint, value, right):
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, text(**changes))
    error = caught.value
    message = str(caught.value)
    assert error.key == key
    assert error.file == str(tmp_path / "given.toml")
    expected = None if joint is None else joint - 1
    assert error.joint == expected
    where = key if joint is None else f"{key}, joint {joint}"
    assert message.startswith(f"{error.file}: {where}")
    assert right in message
    if value is not None:
        assert f" is {value}" in message


@pytest.mark.parametrize(
    ("content", "key"),
    [
        ("", "limits"),
        ("waypoints = [[0], [1]]\n", "limits"),
        ('limits = "none"\nwaypoints = [[0], [1]]', "limits"),
        ("limits = [1]\nwaypoints = [[0], [1]]", "limits"),
        (text() + "\nsnap = [1, 2]", "limits.snap"),
    ],
)
def test_a_file_without_its_tables(tmp_path, content, key):
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, content)
    assert caught.value.key == key


@pytest.mark.parametrize(
    "content",
    [
        b"velocity = [",
        b"\x00\xff\xfe\x89PNG",
        b"x = 1\nx = 2",
        "größe = 1".encode("latin-1"),
        b"x = 1" + b"0" * 5000,
    ],
)
def test_what_is_no_toml_is_said_to_be_none(tmp_path, content):
    with pytest.raises(InvalidInput, match=r"given\.toml.*expected a readable TOML file"):
        read(tmp_path, content)


def test_missing_files_and_folders(tmp_path):
    with pytest.raises(InvalidInput, match=r"nowhere\.toml: it does not exist"):
        Problem.from_toml(tmp_path / "nowhere.toml")
    with pytest.raises(InvalidInput, match=r"directory.*readable TOML file"):
        Problem.from_toml(tmp_path)


def test_errors_in_degrees_show_what_the_file_says(tmp_path):
    """Not its radians: the reader shall find the number in the file."""
    with pytest.raises(InvalidInput, match=r"limits\.velocity, joint 1 is -150\.0"):
        read(tmp_path, text(angle_unit='"deg"', velocity="[-150.0, 1.0]"))
    with pytest.raises(InvalidInput, match=r"joint 2 is \[90\.0, -90\.0\]"):
        read(tmp_path, text(angle_unit='"deg"', position="[[-9, 9], [90, -90]]"))


def test_degrees_become_radians(tmp_path):
    changes = {
        "waypoints": "[[0, 90], [180, -45]]",
        "velocity": "[180, [-90, 360]]",
        "acceleration": "[18.0, 9.0]",
        "jerk": "[inf, 360]",
        "position": "[[0, 180], 90]",
    }
    problem = read(tmp_path, text(angle_unit='"deg"', **changes))
    pi = np.pi
    exact = {"rtol": 1e-15, "atol": 0}
    expected = [[0, pi / 2], [pi, -pi / 4]]
    np.testing.assert_allclose(problem.waypoints, expected, **exact)
    limits = problem.limits
    expected = [[-pi, pi], [-pi / 2, 2 * pi]]
    np.testing.assert_allclose(limits.velocity, expected, **exact)
    expected = [pi / 10, pi / 20]
    found = limits.acceleration[:, 1]
    np.testing.assert_allclose(found, expected, **exact)
    expected = [[-INF, INF], [-2 * pi, 2 * pi]]
    np.testing.assert_allclose(limits.jerk, expected, **exact)
    expected = [[0, pi], [-pi / 2, pi / 2]]
    np.testing.assert_allclose(limits.position, expected, **exact)


# --- units ---

DEGREES = {  # the six-axis numbers of joints 2 to 4, as a file in degrees has them
    "waypoints": "[[0, -45, 0], [-30, -30, 30], [-45, -20, 45], [-50, -20, 60]]",
    "velocity": "[180, 210, 360]",
    "acceleration": "[120, 160, 170]",
}
RADIANS = {
    "waypoints": "[[0.0, -0.79, 0.0], [-0.52, -0.52, 0.52], [-0.79, -0.35, 0.79], "
    "[-0.87, -0.35, 1.05]]",
    "velocity": "[3.14, 3.67, 6.28]",
    "acceleration": "[2.09, 2.79, 2.97]",
}


def units(waypoints: str, limits: str) -> str:
    return f'{{waypoints = "{waypoints}", limits = "{limits}"}}'


def numbers(waypoints_in: dict[str, str], limits_in: dict[str, str]) -> dict[str, str]:
    limits = {key: limits_in[key] for key in ("velocity", "acceleration")}
    return {"waypoints": waypoints_in["waypoints"], **limits}


@pytest.mark.parametrize("unit", ["deg", "rad"])
@pytest.mark.parametrize("limit_unit", ["deg", "rad"])
def test_waypoints_and_limits_each_have_their_unit(tmp_path, unit, limit_unit):
    changes = {"angle_unit": None, "units": units(unit, limit_unit), "jerk": "[5, 6]"}
    problem = read(tmp_path, text(**changes, position="[90, [-60, 2]]"))
    size = {"deg": np.pi / 180, "rad": 1.0}
    values = np.array([[0, 0], [1, -1]])
    assert problem.waypoints.tolist() == (values * size[unit]).tolist()
    for name, high in {"velocity": [1, 2], "acceleration": [3, 4], "jerk": [5, 6]}.items():
        expected = np.array(high) * size[limit_unit]
        found = getattr(problem.limits, name)[:, 1].tolist()
        assert found == expected.tolist()
    assert problem.limits.position[0, 1] == 90 * size[limit_unit]


def test_degrees_beside_a_urdfs_radians_are_the_same_problem(tmp_path):
    """The two ways to write it differ by the rounding of three digits."""
    mixed = text(**numbers(DEGREES, RADIANS), angle_unit=None, units=units("deg", "rad"))
    plain = text(**DEGREES, angle_unit='"deg"')
    one = read(tmp_path, mixed)
    other = read(tmp_path, plain)
    assert one.waypoints.tolist() == other.waypoints.tolist()
    np.testing.assert_allclose(one.limits.velocity, other.limits.velocity, rtol=2e-3)
    np.testing.assert_allclose(one.limits.acceleration, other.limits.acceleration, rtol=4e-3)


@pytest.mark.parametrize("unit", ['"deg"', '"rad"'])
@pytest.mark.parametrize(
    ("waypoints", "limits", "words"),
    [
        (DEGREES, RADIANS, "look like degrees beside radians"),
        (RADIANS, DEGREES, "look like radians beside degrees"),
    ],
)
def test_numbers_that_look_mixed_are_warned_of(tmp_path, unit, waypoints, limits, words):
    content = text(**numbers(waypoints, limits), angle_unit=unit)
    with pytest.warns(UnitWarning, match=rf"given\.toml.*{words}.*units\.waypoints") as caught:
        read(tmp_path, content)
    assert caught[0].filename == __file__


@pytest.mark.parametrize("given", [DEGREES, RADIANS])
def test_numbers_of_one_unit_are_not(tmp_path, given):
    read(tmp_path, text(**given, angle_unit='"deg"'))
    read(tmp_path, text(**given, angle_unit='"rad"'))


def test_who_says_both_units_is_not_warned(tmp_path):
    content = text(**numbers(DEGREES, RADIANS), angle_unit=None, units=units("deg", "deg"))
    expected = 3.14 * np.pi / 180
    assert read(tmp_path, content).limits.velocity[0, 1] == expected


def test_no_built_in_problem_looks_mixed():
    """Neither in radians, as they are here, nor in degrees, as an arm's file may have them."""
    built_in = []
    for name in ("six-axis", "edges", "robots", "random"):
        built_in.extend(suites.problems(name))
    assert len(built_in) >= 197
    for problem in built_in:
        limits = problem.limits
        found = mixed_units(problem.waypoints, limits.velocity, limits.acceleration)
        assert found is None, problem.name
    for problem in suites.problems("robots"):
        rates = [np.rad2deg(x) for x in (problem.limits.velocity, problem.limits.acceleration)]
        assert mixed_units(np.rad2deg(problem.waypoints), *rates) is None, problem.name


@pytest.mark.parametrize(
    ("changes", "key", "right"),
    [
        ({"units": '"deg"', "angle_unit": None}, "units", "a table"),
        ({"units": '{waypoints = "deg"}', "angle_unit": None}, "units.limits", "missing"),
        ({"units": '{limits = "deg"}', "angle_unit": None}, "units.waypoints", "missing"),
        ({"units": units("deg", "m"), "angle_unit": None}, "units.limits", '"deg" or "rad"'),
        ({"units": '{waypoints = "rad", limits = 1}', "angle_unit": None}, "units.limits", "rad"),
        ({"units": '{time = "s"}', "angle_unit": None}, "units.time", "limits, waypoints"),
        ({"units": units("deg", "rad")}, "angle_unit", "left out beside units"),
    ],
)
def test_units_that_say_nothing_are_refused(tmp_path, changes, key, right):
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, text(**changes))
    assert caught.value.key == key
    assert right in str(caught.value)


def test_a_file_without_a_name_is_called_after_itself(tmp_path):
    assert read(tmp_path, text(name=None, source=None)).name == "given"
    assert read(tmp_path, text(name=None, source=None)).source == ""
    assert read(tmp_path, text()).name == "p"


@pytest.mark.parametrize(
    ("given", "pairs"),
    [
        ([1, 2.5], [[-1, 1], [-2.5, 2.5]]),
        ([1, [-2, 3]], [[-1, 1], [-2, 3]]),
        (((-1, 4), [-2, 3]), [[-1, 4], [-2, 3]]),
        (np.array([1, 2]), [[-1, 1], [-2, 2]]),
        (np.array([[-1.0, 2], [-3, 4]]), [[-1, 2], [-3, 4]]),
        ([np.float32(1), np.int64(2)], [[-1, 1], [-2, 2]]),
        ([1, np.array([-2, 3])], [[-1, 1], [-2, 3]]),
    ],
)
def test_a_limit_is_a_number_or_a_pair_per_joint(given, pairs):
    limits = Limits(given, given, given, given)
    for name in ("velocity", "acceleration", "jerk", "position"):
        assert getattr(limits, name).tolist() == pairs
    assert limits.joints == 2


ONE = Limits([1.0], [1.0])


@pytest.mark.parametrize(
    "waypoints",
    [np.array(5.0), None, [np.array(1.0)] * 2, np.zeros((2, 1, 1)), b"ab", [b"a", b"b"], {1: 2}],
)
def test_waypoints_of_another_shape(waypoints):
    with pytest.raises(InvalidInput, match="waypoint"):
        Problem(waypoints, ONE)


@pytest.mark.parametrize(
    "velocity", [np.array(1.0), 1.0, None, [np.array(1.0)], [1j], [np.complex128(1)], b"a", [None]]
)
def test_limits_of_another_shape(velocity):
    with pytest.raises(InvalidInput, match=r"limits\.velocity"):
        Limits(velocity, [1.0])


def test_large_integers_are_numbers():
    problem = Problem([[0], [10**21]], ONE)
    assert problem.waypoints[1, 0] == 1e21
    limits = Limits([10**300], [1])
    assert limits.velocity[0, 1] == 1e300


def test_a_waypoint_on_its_position_limit_is_inside():
    limits = Limits([1.0], [1.0], position=[[0.1, 0.3]])
    problem = Problem([[0.1], [0.3]], limits)
    assert problem.has("position")


def test_what_a_problem_says_of_itself():
    limits = Limits([1] * 3, [2] * 3, [INF, 5, [-INF, 3]], [[-INF, 9], 9, 9])
    problem = Problem([[0, 1, 2], [0, 1, 3], [0, 1, 2], [0, 1, 5]], limits)
    assert (problem.joints, problem.segments) == (3, 3)
    assert problem.moving.tolist() == [False, False, True]
    assert problem.displacements.tolist() == [[0, 0, 1], [0, 0, -1], [0, 0, 3]]
    for name in ("velocity", "acceleration", "jerk", "position"):
        assert problem.has(name)
    assert not Problem([[0], [1]], ONE).has("jerk")
    assert not Problem([[0], [1]], ONE).has("position")


def test_without_lifts_a_limit_and_nothing_else():
    limits = Limits([1.0], [2.0], [3.0], [[-4, 4]])
    problem = Problem([[0.0], [1.0]], limits, "a", "b")
    free = problem.without("jerk")
    assert not free.has("jerk")
    assert free.has("position")
    assert not problem.without("jerk", "position").has("position")
    assert (free.name, free.source) == ("a", "b")
    assert np.array_equal(free.limits.velocity, limits.velocity)
    assert problem.has("jerk")
    assert problem.without().digest() == problem.digest()


@pytest.mark.parametrize("joints", [[0, 2], np.array([True, False, True]), np.array([0, 2])])
def test_only_some_joints(joints):
    limits = Limits([1, 2, 3], [4, 5, 6], [7, 8, 9], [[-1, 1], [-2, 2], [-3, 3]])
    problem = Problem([[0, 0, 0], [0.1, 0.2, 0.3]], limits, "a", "b")
    some = problem.only(joints)
    assert some.waypoints.tolist() == [[0, 0], [0.1, 0.3]]
    assert some.limits.velocity.tolist() == [[-1, 1], [-3, 3]]
    found = some.limits.acceleration[:, 1].tolist()
    assert found == [4, 6]
    found = some.limits.jerk[:, 1].tolist()
    assert found == [7, 9]
    found = some.limits.position[:, 0].tolist()
    assert found == [-1, -3]
    assert (some.name, some.source) == ("a", "b")


def test_only_joints_that_rest_are_no_problem():
    limits = Limits([1, 1], [1, 1])
    problem = Problem([[0, 0], [1, 0]], limits)
    with pytest.raises(InvalidInput, match="never move"):
        problem.only([1])


@pytest.mark.parametrize(
    ("waypoints", "merged", "index"),
    [
        ([0, 1, 2], [0, 1, 2], [0, 1, 2]),
        ([0, 1, 1, 2], [0, 1, 2], [0, 1, 1, 2]),
        ([0, 0, 0, 1, 1], [0, 1], [0, 0, 0, 1, 1]),
        ([0, 1, 0, 0, 1], [0, 1, 0, 1], [0, 1, 2, 2, 3]),
        ([0, 0.0, -0.0, 1], [0, 1], [0, 0, 0, 1]),
        ([1, 1 + 2e-16, 2], [1, 2], [0, 0, 1]),
        ([1, 1 + 1e-14, 2], [1, 1 + 1e-14, 2], [0, 1, 2]),
    ],
)
def test_repeated_waypoints_merge(waypoints, merged, index):
    limits = Limits([1, 1], [1, 1])
    problem = Problem([[x, 7.0] for x in waypoints], limits, "kept")
    short, where = problem.merged()
    assert short.waypoints[:, 0].tolist() == merged
    assert where.tolist() == index
    assert short.name == "kept"
    np.testing.assert_allclose(short.waypoints[where], problem.waypoints, rtol=1e-15)


def random_problem(seed: int) -> Problem:
    rng = np.random.default_rng(seed)
    joints = rng.integers(1, 5)
    rows = rng.integers(2, 6)

    def pairs():
        drawn = rng.uniform(-9, 9, joints)
        return np.stack([-(10.0 ** rng.uniform(-9, 9, joints)), 10.0**drawn])

    values = np.array([[-INF], [INF]])
    jerk = np.where(rng.random((2, joints)) < 0.4, values, pairs())
    drawn = rng.integers(-12, 6, joints)
    waypoints = rng.normal(size=(rows, joints)) * 10.0**drawn
    reach = np.abs(waypoints).max(axis=0) + 1
    position = np.where(rng.random((2, joints)) < 0.4, np.array([[-INF], [INF]]), [-reach, reach])
    limits = Limits(pairs().T, pairs().T, jerk.T, position.T)
    return Problem(waypoints, limits, f"problem {seed}", "at random")


@reproducible
@given(seeds, st.text(), st.text())
def test_writing_and_reading_keeps_every_bit(tmp_path_factory, seed, name, source):
    problem = dataclasses.replace(random_problem(seed), name=name, source=source)
    file = tmp_path_factory.getbasetemp() / "trip.toml"
    file.write_bytes(problem.to_toml().encode())
    again = Problem.from_toml(file)
    assert again.digest() == problem.digest()
    assert (again.name, again.source) == (name, source)
    assert np.array_equal(again.waypoints, problem.waypoints)
    assert again.to_toml() == problem.to_toml()


def arrays(problem: Problem) -> dict[str, np.ndarray]:
    names = ("velocity", "acceleration", "jerk", "position")
    return {"waypoints": problem.waypoints} | {n: getattr(problem.limits, n) for n in names}


def test_changing_any_number_changes_the_digest():
    limits = Limits([1, [-1, 2]], [3, 4], [5, [-INF, 6]], [[-7, 8], 9])
    problem = Problem([[0.0, 1.0], [2.0, -1.0]], limits)
    seen = {problem.digest()}
    for name, array in arrays(problem).items():
        for place in np.ndindex(array.shape):
            changed = {k: v.copy() for k, v in arrays(problem).items()}
            value = changed[name][place]
            changed[name][place] = np.nextafter(value, 0 if value else 1)
            waypoints = changed.pop("waypoints")
            seen.add(Problem(waypoints, Limits(**changed)).digest())
    expected = 1 + sum(a.size for a in arrays(problem).values())
    assert len(seen) == expected


def test_digests_depend_on_numbers_only():
    limits = Limits([1.0, 1.0], [2.0, 2.0])
    one = Problem([[0.0, 0.0], [1.0, 1.0]], limits, "one", "here")
    expected = Problem([[0, -0.0], [1, 1]], limits, "two", "there").digest()
    assert one.digest() == expected
    assert one.digest() == dataclasses.replace(one).digest()
    joints = Problem([[0.0], [0.0], [1.0], [1.0]], Limits([1.0], [2.0]))
    assert one.digest() != joints.digest()
    expected = Problem([[0, 0], [1, 1]], Limits([1, 2], [1, 2])).digest()
    assert one.digest() != expected
    assert len(one.digest()) == 64


def test_the_digest_is_the_same_on_every_machine_and_for_ever():
    """SHA-256 of the arrays' shapes and little-endian numbers, written out by hand."""
    low = struct.pack("<d", -np.inf)
    high = struct.pack("<d", np.inf)
    parts = [
        b"(2, 1)" + struct.pack("<2d", 0, 1),
        b"(1, 2)" + struct.pack("<2d", -1, 1),
        b"(1, 2)" + struct.pack("<2d", -2, 2),
        b"(1, 2)" + low + high,
        b"(1, 2)" + low + high,
    ]
    limits = Limits([1.0], [2.0])
    problem = Problem([[0.0], [1.0]], limits)
    expected = hashlib.sha256(b"".join(parts)).hexdigest()
    assert problem.digest() == expected


@pytest.mark.parametrize("name", ["velocity", "acceleration", "jerk", "position"])
def test_nothing_can_be_changed(name):
    given = np.array([[0.0], [1.0]])
    problem = Problem(given, Limits([1.0], [2.0]))
    given[0] = 9
    assert problem.waypoints[0] == 0
    for array in (problem.waypoints, getattr(problem.limits, name)):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 5
    with pytest.raises(dataclasses.FrozenInstanceError):
        problem.name = "other"


FILES = sorted((DATA / "problems").glob("*.toml"))


@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_the_shipped_problems_load_and_say_where_they_come_from(file):
    problem = Problem.from_toml(file)
    assert problem.name == file.stem
    assert problem.source
    assert problem.moving.any()


def test_six_axis_is_the_papers_tables_2_and_3():
    problem = Problem.from_toml(DATA / "problems" / "six-axis.toml")
    table_2 = [  # degrees: one row per joint, one column per path point
        [0, 0, 0, 0],
        [0, -30, -45, -50],
        [-45, -30, -20, -20],
        [0, 30, 45, 60],
        [0, 0, 30, 60],
        [0, 0, 0, 30],
    ]
    velocity = [150, 180, 210, 360, 360, 450]
    acceleration = [93, 120, 160, 170, 260, 330]
    found = np.rad2deg(problem.waypoints.T)
    np.testing.assert_allclose(found, table_2, rtol=1e-14, atol=0)
    limits = problem.limits
    found = np.rad2deg(limits.velocity[:, 1])
    np.testing.assert_allclose(found, velocity, rtol=1e-14)
    found = np.rad2deg(limits.acceleration[:, 1])
    np.testing.assert_allclose(found, acceleration, rtol=1e-14)
    assert np.array_equal(limits.velocity[:, 0], -limits.velocity[:, 1])
    assert np.array_equal(limits.acceleration[:, 0], -limits.acceleration[:, 1])
    assert not problem.has("jerk")
    assert not problem.has("position")
    assert problem.moving.tolist() == [False, True, True, True, True, True]


def test_the_six_axis_robot_is_the_papers_table_1():
    robot = tomllib.loads((DATA / "kinematics" / "six-axis.toml").read_text(encoding="utf-8"))
    assert (robot["angle_unit"], robot["convention"]) == ("deg", "modified-dh")
    millimetres = {"a": [0, 200, 715.6, 256, 0, 0], "d": [0, 0, -94.4, 845.5, 0, 83.8]}
    for key, values in millimetres.items():
        expected = [x / 1000 for x in values]
        assert robot[key] == pytest.approx(expected, rel=1e-12)
    assert robot["alpha"] == [0, -90, 0, -90, 90, -90]
    assert robot["theta"] == [0] * 6
    ranges = [[-150, 180], [-60, 120], [-45, 45], [-90, 90], [-90, 90], [-180, 180]]
    assert robot["joint_range"] == ranges


# --- joint names and robots ---

TWO_OF_UR5E = """
robot = "ur5e"
joint_names = ["elbow_joint", "wrist_3_joint"]
units.waypoints = "deg"
waypoints = [[0, 0], [90, -45]]
"""


def test_a_file_with_a_robot_has_its_limits_and_names(tmp_path):
    problem = read(
        tmp_path,
        'robot = "ur5e"\nunits.waypoints = "deg"\nwaypoints = [[0,0,0,0,0,0], [9,9,9,9,9,9]]',
    )
    assert problem.joint_names[2] == "elbow_joint"
    assert problem.joint_labels == problem.joint_names
    assert np.allclose(problem.limits.velocity[:, 1], np.pi)  # 180 deg/s
    assert np.allclose(problem.limits.acceleration[:, 1], 5)
    assert np.allclose(problem.limits.position[2], [-np.pi, np.pi])
    assert np.allclose(problem.waypoints[1], np.deg2rad(9))


def test_a_file_chooses_joints_and_replaces_kinds_of_limits(tmp_path):
    text = TWO_OF_UR5E + 'units.limits = "deg"\n[limits]\nvelocity = [90, [-45, 60]]\n'
    problem = read(tmp_path, text)
    assert problem.joint_names == ("elbow_joint", "wrist_3_joint")
    assert np.allclose(np.rad2deg(problem.limits.velocity), [[-90, 90], [-45, 60]])
    assert np.allclose(np.rad2deg(problem.limits.position), [[-180, 180], [-360, 360]])
    again = read(tmp_path, problem.to_toml())
    assert again.joint_names == problem.joint_names
    assert again.digest() == problem.digest()


RAIL = """
waypoints = [[0, 0], [200, 90]]
joint_names = ["rail", "elbow"]
units.waypoints = ["mm", "deg"]
units.limits = "deg"
[limits]
velocity = [1.5, 180]
acceleration = [[-2, 3], 90]
position = [[-0.1, 0.5], [-180, 180]]
"""


@pytest.mark.parametrize("limits", ['"deg"', '["m", "deg"]'])
def test_a_unit_per_joint(tmp_path, limits):
    problem = read(tmp_path, RAIL.replace('units.limits = "deg"', f"units.limits = {limits}"))
    assert problem.joint_units == ("m", "rad")
    assert np.allclose(problem.waypoints[1], [0.2, np.pi / 2], rtol=1e-15)
    assert np.allclose(problem.limits.velocity[:, 1], [1.5, np.pi])
    assert np.allclose(problem.limits.acceleration, [[-2, 3], [-np.pi / 2, np.pi / 2]])
    assert np.allclose(problem.limits.position, [[-0.1, 0.5], [-np.pi, np.pi]])
    assert [problem.shared_unit(order) for order in (0, 3)] == ["rad or m", "rad/s³ or m/s³"]
    assert problem.without("position").unit(0, order=1) == "m/s"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('["mm", "deg"]', '["mm"]', "units.waypoints is ['mm']: expected 2 units, one per joint"),
        ('["mm", "deg"]', "[]", "units.waypoints is []: expected 2 units"),
        ('["mm", "deg"]', '["mm", 1]', "units.waypoints, joint 2 is 1: expected deg or rad or m"),
        ('["mm", "deg"]', '"mm"', 'units.waypoints is \'mm\': expected "deg" or "rad", or a'),
        ('= "deg"', '= ["deg", "m"]', "units.limits is ['deg', 'm']: expected the same kinds"),
        ("[200, 90]", "[600, 90]", "value inside limits.position [-0.1, 0.5] m"),
        ('joint_names = ["rail", "elbow"]', 'robot = "ur5e"', "units, joint 1 is 'm': expected"),
        ("velocity = [1.5, 180]", "velocity = [1.5, 180, 1]", "expected 3 values, one per joint"),
    ],
)
def test_what_is_wrong_with_a_unit_per_joint_is_named(tmp_path, old, new, words):
    assert old in RAIL
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, RAIL.replace(old, new))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('units.waypoints = "deg"', 'units.waypoints = ["deg"]', "expected 2 units, one per joint"),
        ('units.waypoints = "deg"', 'units.waypoints = ["deg", "m"]', "joint 2 is 'm'"),
    ],
)
def test_a_robot_s_joints_turn(tmp_path, old, new, words):
    assert old in TWO_OF_UR5E
    with pytest.raises(InvalidInput, match=words):
        read(tmp_path, TWO_OF_UR5E.replace(old, new))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('"ur5e"', '"ur5"', "robot is 'ur5': expected one of abb-irb-120, "),
        ('"elbow_joint"', '"elbow"', "joint 1 is 'elbow': expected a joint of ur5e: shoulder_pan"),
        (
            '"wrist_3_joint"',
            '"elbow_joint"',
            "joint 2 is 'elbow_joint': expected names that differ",
        ),
        ('["elbow_joint", "wrist_3_joint"]', "7", "joint_names is 7"),
        ('["elbow_joint", "wrist_3_joint"]', "[]", "expected 2 names, one per joint"),
        ('waypoints = "deg"', 'limits = "deg"', "units.waypoints: expected this key"),
        ("[90, -45]", "[190, -45]", "waypoint 2, joint 1 is 3.3"),
    ],
)
def test_what_is_wrong_with_a_robot_is_named(tmp_path, old, new, words):
    with pytest.raises(InvalidInput) as caught:
        read(tmp_path, TWO_OF_UR5E.replace(old, new))
    assert words in str(caught.value)


def test_names_of_joints_belong_to_the_problem_but_not_to_its_digest():
    limits = Limits([1, 1], [1, 1])
    plain = Problem([[0, 0], [1, 1]], limits)
    named = Problem([[0, 0], [1, 1]], limits, joint_names=["a", "b"])
    assert plain.joint_labels == ("joint 1", "joint 2")
    assert named.digest() == plain.digest()
    assert named.only([1]).joint_names == ("b",)
    assert named.merged()[0].joint_names == ("a", "b")
    for wrong in (["a"], ["a", "a"], ["a", ""], ["a", 3], ["a", "b\n"]):
        with pytest.raises(InvalidInput, match="joint_names"):
            Problem([[0, 0], [1, 1]], limits, joint_names=wrong)


def test_a_name_has_at_most_200_characters():
    limits = Limits([1.0], [1.0])
    assert Problem([[0.0], [1.0]], limits, "x" * 200, joint_names=["j" * 200]).name == "x" * 200
    with pytest.raises(InvalidInput, match=r"name is 'xxx.*…': expected a name of at most 200"):
        Problem([[0.0], [1.0]], limits, "x" * 201)
    with pytest.raises(InvalidInput, match=r"joint_names, joint 1.*: expected a name of"):
        Problem([[0.0], [1.0]], limits, joint_names=["j" * 3_000_000])
