"""A trajectory for others: samples on the control cycle, exact JSON, HDF5 as the store keeps it."""

import csv
import json

import h5py
import numpy as np
import pytest

from trajopt import InvalidInput, Limits, Problem, StoreError
from trajopt import judge as judge_motion
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.trial import trials_of
from trajopt.planners.registry import load
from trajopt.views.export import motion_file as export

PROBLEM = Problem([[0, 0.1], [0.4, 0], [1, 0.3], [1.5, 1]], Limits([1, 2], [2, 3]), "two joints")


@pytest.fixture(scope="module")
def trial():
    """Claimed in 0.6 s, ten times too fast: what is exported must be the certified one."""
    trial = trials_of(load("unoptimised:segment_time=0.2"), PROBLEM, [0], "unoptimised")[0]
    assert trial.certificate.dilation > 2
    return trial


def written(path, trial, cycle=0.01):
    export.write(export.Target(path, cycle), trial)
    return path


def table(path):
    with path.open(newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    return header, np.array(rows, dtype=float)


@pytest.mark.parametrize("cycle", [0.01, 0.007])
def test_csv_has_one_row_per_cycle_and_the_end_is_on_one(tmp_path, trial, cycle):
    header, rows = table(written(tmp_path / "t.csv", trial, cycle))
    names = ["joint_1 [rad]", "joint_2 [rad]", "joint_1 [rad/s]", "joint_2 [rad/s]"]
    assert header == ["time [s]", *names]
    np.testing.assert_allclose(rows[:, 0], cycle * np.arange(len(rows)), atol=1e-9)
    late = rows[-1, 0] - trial.certified_duration
    assert 0 <= late < 0.01 * trial.certified_duration + 4 * cycle


def test_csv_follows_the_claimed_path_slowed_down_to_the_limits(tmp_path, trial):
    _, rows = table(written(tmp_path / "t.csv", trial))
    claimed = trial.solution.trajectory
    shares = rows[:, 0] / rows[-1, 0]
    expected = claimed(shares * claimed.duration)
    np.testing.assert_allclose(rows[:, 1:3], expected, atol=0.01)
    np.testing.assert_allclose(rows[[0, -1], 1:3], PROBLEM.waypoints[[0, -1]], atol=1e-12)
    assert np.abs(rows[:, 3:] / [1, 2]).max() <= 1


def test_what_is_written_says_what_a_controller_makes_of_it(tmp_path, trial):
    executed = export.write(export.Target(tmp_path / "t.csv", 0.01), trial)
    assert executed.pieces == "cubic"
    assert executed.certificate.feasible
    assert executed.duration == pytest.approx(table(tmp_path / "t.csv")[1][-1, 0])
    assert export.write(export.Target(tmp_path / "t.json"), trial) is None


def test_json_is_a_motion_that_can_be_judged(tmp_path, trial):
    found = judge_motion(PROBLEM, written(tmp_path / "t.json", trial))
    assert found.certificate.feasible
    assert found.certified_duration == pytest.approx(trial.certified_duration, rel=1e-9)


def test_json_is_the_exact_certified_polynomial_and_the_verdict(tmp_path, trial):
    def refuse(word):
        raise AssertionError(word)

    found = json.loads(
        written(tmp_path / "t.json", trial).read_text("utf-8"), parse_constant=refuse
    )
    k, claimed = trial.certificate.dilation, trial.solution.trajectory
    np.testing.assert_allclose(found["breaks"], claimed.breaks * k, rtol=1e-12)
    powers = np.arange(len(claimed.coefficients))[::-1, None, None]
    np.testing.assert_allclose(
        found["coefficients"], claimed.coefficients / k**powers, rtol=1e-9, atol=1e-12
    )
    assert found["certified_duration"] == found["waypoint_times"][-1] == found["breaks"][-1]
    assert found["options"] == {"segment_time": 0.2}


def test_hdf5_is_a_trial_of_the_store(tmp_path, trial):
    path = written(tmp_path / "t.h5", trial)
    (back,) = store.read(path)
    assert back.id == trial.id
    assert back.as_dict() == trial.as_dict()
    with h5py.File(path) as file:
        assert file["trials/certified_duration"][0] == trial.certified_duration


@pytest.mark.parametrize("suffix", ["csv", "json"])
def test_nothing_certified_is_nothing_to_write(tmp_path, suffix):
    stuck = trials_of(
        load("unoptimised"), Problem([[0], [1]], Limits([1], [1])), [0], "unoptimised"
    )[0]
    with pytest.raises(StoreError, match="unsupported"):
        written(tmp_path / f"t.{suffix}", stuck)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", ["t", "t.txt", "t.csv.gz", ".csv"])
def test_an_unknown_ending_is_refused(tmp_path, name):
    with pytest.raises(InvalidInput, match=r"--out.*\.csv, \.json, .*\.h5"):
        export.Target(tmp_path / name)


@pytest.mark.parametrize("suffix", ["csv", "json", "h5"])
def test_folders_are_made_and_a_file_in_their_place_is_an_os_error(tmp_path, trial, suffix):
    assert written(tmp_path / "a" / "b" / f"t.{suffix}", trial).stat().st_size > 100
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        written(tmp_path / "file" / f"t.{suffix}", trial)
