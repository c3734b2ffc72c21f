"""Motions from files: CSV in others' units, polynomials, and errors that name line and column."""

from __future__ import annotations

import json
import warnings

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from trajopt.core.exceptions import FileNote, InvalidInput, InvalidTrajectory
from trajopt.core.trajectory import Trajectory
from trajopt.formats import samples_csv
from trajopt.formats.motion import motion
from trajopt.formats.samples import Samples


def file(tmp_path, text, name="m.csv"):
    path = tmp_path / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


@pytest.mark.parametrize(
    "text",
    [
        "time [s],a [rad],b [rad],a [rad/s],b [rad/s]\n0,0,0,0,0\n1.5,0.1,-1,0,0.5\n",
        "time [s], a [rad], b [rad], a_velocity [rad/s], b_velocity [rad/s]\n"
        "0,0,0,0,0\n\n# a remark\n1.5, .1, -1.0, 0, 5e-1\n",
        "# time [ms]; a_vel (rad/s); b_vel (rad/s); b (rad); a (rad)\n0;0;0;0;0\n1500;0;.5;-1;.1",
        "t [s]\ta_position [rad]\tb_position [rad]\ta [rad/s]\tb [rad/s]\r\n"
        "1700000000.25\t0\t0\t0\t0\r\n1700000001.75\t0.1\t-1\t0\t0.5\r\n",
        "\ufefftime [s],a [mm],b [m],a [mm/s],b [m/s]\n-2,0,0,0,0\n-0.5,100,-1,0,0.5\n",
    ],
    ids=["ours", "suffixes", "semicolons", "epoch, tabs", "mm"],
)
def test_one_motion_in_every_spelling(tmp_path, text):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", FileNote)  # of times that do not start at 0
        samples = samples_csv.read(file(tmp_path, text))
    order = [samples.joint_names.index(name) for name in ("a", "b")]
    assert samples.times.tolist() == [0, 1.5]
    found = samples.positions[:, order]
    np.testing.assert_allclose(found, [[0, 0], [0.1, -1]], rtol=1e-15)
    found = samples.velocities[:, order].tolist()
    assert found == [[0, 0], [0, 0.5]]
    assert samples.accelerations is None


def test_degrees_are_degrees_column_by_column(tmp_path):
    text = "time [s],a [deg],b [rad],a [deg/s^2],b [rad/s²],a [°/s],b [rad/s]\n"
    text += "0,180,1,360,2,90,3\n1,0,0,0,0,0,0"
    samples = samples_csv.read(file(tmp_path, text))
    np.testing.assert_allclose(samples.positions[0], [np.pi, 1])
    expected = [np.pi / 2, 3]
    np.testing.assert_allclose(samples.velocities[0], expected)
    expected = [2 * np.pi, 2]
    np.testing.assert_allclose(samples.accelerations[0], expected)


HEADER = "time [s],a [rad],b [rad]\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "line 1: expected a header"),
        ("\n\n", "line 1: expected a header"),
        ("0,1,2\n", "rename the columns of m.csv: time [s],joint_1 [rad],joint_2 [rad]"),
        ("time [s],a\n", "header: expected the unit of angles: unit=deg or unit=rad; rename the"),
        ("time [s],a [Nm]\n", "header: expected columns of positions"),
        ("t,a,a_vel\n", "rename the columns of m.csv: time [s],a [rad],a [rad/s]"),
        ("a [rad]\n", "header: expected time [s], then"),
        ("time [s]\n0\n1\n", "header: expected columns of positions"),
        ("time [s],a [rad],a [deg]\n", "header is 'a': expected a column that"),
        ("a [m],time,a [rad/s]\n", "header is 'a [rad]': expected a unit that goes with"),
        ("t,a [rad]\n0,0\n8,1\n16,2\n", "times is 'steps of 8': expected a unit in the heading"),
        ("time [s],a [rad],c [rad/s]\n", "each joint that has positions, and no other: a"),
        (HEADER, "samples is 0: expected at least two lines"),
        (HEADER + "0,0,0\n", "samples is 1: expected at least two lines"),
        (HEADER + "0,0,0\n1,2\n", "line 3 is 2: expected 3 cells"),
        (HEADER + "0,0,0\n\n1,x,2\n", "line 4, column 2, a [rad], is 'x': expected a finite"),
        (HEADER + "0,0,0\n1,nan,2\n", "line 3, column 2, a [rad], is 'nan'"),
        (HEADER + "0,0,0\n1,1e999,2\n", "is '1e999'"),
        (HEADER + "0,0,0\n1,,2\n", "line 3, column 2, a [rad], is ''"),
        ("time [s];a [rad]\n0;0\n1;1.000,5\n", "line 3, column 2, a [rad], is '1.000.5'"),
        ("a [rad] " * 2001, "line 1 is 2001: expected at most 2000 columns"),
        (HEADER + "0,0,0\n0,1,2\n", "line 3, column 1, time [s], is 0.0: expected a time after"),
        (b"time [s],a [rad/s\xb2]\n", "expected a readable CSV file"),
    ],
)
def test_every_malformed_line_is_named(tmp_path, text, said):
    path = file(tmp_path, text)
    with pytest.raises(InvalidInput) as caught:
        motion(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert said in str(caught.value)


def test_polynomials_are_read_as_they_are(tmp_path):
    spline = CubicSpline([0.0, 1.0, 3.0], [[0.0, 1.0], [1.0, 0.0], [2.0, 2.0]])
    table = {"breaks": spline.x.tolist(), "coefficients": spline.c.tolist()}
    content = json.dumps(table | {"joint_names": ["a", "b"]})
    path = file(tmp_path, content, "m.json")
    read = motion(path)
    assert read.interpolation == "polynomial"
    assert read.joint_names == ("a", "b")
    assert np.array_equal(read.trajectory.coefficients, spline.c)
    assert read.digest() == motion(spline).digest() == motion(read.trajectory).digest()
    swapped = read.for_joints(["b", "a"])
    assert np.array_equal(swapped.trajectory.coefficients, spline.c[..., ::-1])
    assert swapped.digest() != read.digest()
    with pytest.raises(InvalidInput, match="expected the joints c, d"):
        read.for_joints(["c", "d"])


def test_polynomials_may_say_the_lengths_that_breaks_round(tmp_path):
    breaks = [0.0, 1000.0, 1000.0 + 1e-9]
    table = {"breaks": breaks, "coefficients": [[[1.0], [1.0]], [[0.0], [1000.0]]]}
    plain = motion(file(tmp_path, json.dumps(table), "plain.json"))
    exact = table | {"lengths": [1000.0, 1.00001e-9]}
    read = motion(file(tmp_path, json.dumps(exact), "exact.json"))
    assert read.trajectory.lengths[1] == 1.00001e-9
    assert read.digest() != plain.digest()
    wrong = table | {"lengths": [1000.0, 1e-6]}
    with pytest.raises(InvalidInput, match="lengths"):
        motion(file(tmp_path, json.dumps(wrong), "wrong.json"))


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"breaks": [0, 1], "coefficients": [[[1]]], "joint_names": ["a", "b"]}, "1 names"),
        ({"breaks": [0, 1, 2], "coefficients": [[[1]]]}, "that fit together"),
        ({"breaks": [0, 1], "coefficients": [1]}, "is '(2,) and (1,)'"),
        ({"breaks": [], "coefficients": []}, "is '(0,) and (0,)': expected"),
        ({"breaks": "x", "coefficients": None}, "breaks is 'x': expected breaks"),
        ({"breaks": [0, 1], "coefficients": [[["1"]]]}, "coefficients is [[['1']]]"),
        ({"breaks": [0, 10**390], "coefficients": [[[1]]]}, "has more than 19 digits"),
        ({"breaks": [0, float("nan")], "coefficients": [[[1]]]}, "NaN is no number of JSON"),
        ({"breaks": [0, 1], "coefficients": [[[1]]], "joint_names": 3}, "joint_names is 3"),
        ({"breaks": [0, 1], "coefficients": [[[1]]], "unit": "deg"}, "unit is 'deg': expected"),
        ({"breaks": [0, 1]}, "the arrays are breaks (2,)"),
    ],
)
def test_polynomials_that_do_not_fit_are_refused(tmp_path, table, said):
    path = file(tmp_path, json.dumps(table), "m.json")
    with pytest.raises(InvalidInput) as caught:
        motion(path)
    assert str(path) in str(caught.value)
    assert said in str(caught.value)


def test_what_cannot_be_interpolated_is_refused(tmp_path):
    path = file(tmp_path, HEADER + "0,0,0\n1,1,1\n")
    assert motion(path).interpolation == "linear"
    assert motion(path, "spline").interpolation == "spline"
    with pytest.raises(InvalidInput, match=r"m\.csv: interpolation is 'cubic'"):
        motion(path, "cubic")
    rest = Trajectory([0, 1], [[[0.0]]], [0, 1])
    with pytest.raises(InvalidInput, match="nothing to interpolate"):
        motion(rest, "cubic")
    with pytest.raises(InvalidInput, match=r"ending in \.csv"):
        motion(tmp_path / "m.xlsx")
    with pytest.raises(InvalidInput, match="does not exist"):
        motion(tmp_path / "none.csv")
    with pytest.raises(InvalidTrajectory, match="not list"):
        motion([1, 2])
    samples = Samples(("a",), [0, 1], [[0.0], [1.0]])
    assert motion(samples).joint_names == ("a",)
