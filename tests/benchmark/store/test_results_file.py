"""results.h5: one dataset per column, described, and readable with plain h5py."""

import re
import textwrap
from dataclasses import replace

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import PPoly
from trials import PROBLEM, Stopping, assert_same, datasets, solved

from trajopt import Limits, Problem, Solution, Status, StoreError
from trajopt.benchmark.store import results_file
from trajopt.benchmark.store.columns import COLUMNS
from trajopt.benchmark.store.folder import Store, read
from trajopt.benchmark.store.schema import encode
from trajopt.benchmark.trial import judge

SMALL = Problem([[0.0], [1.0]], Limits([1.0], [2.0]), "small")


def kinds():
    """Sizes that differ, a failure without arrays, stats that only some have."""
    a = solved()
    (b,) = judge(Stopping(0.25), SMALL, [5], "stopping")
    bare = replace(a, seed=4, status=Status.FAILED, solution=Solution(Status.FAILED, message="no"))
    bare = replace(bare, message="no", certificate=None, setup_time=0.0)
    odd = {"times": np.ones((2, 2)), "more": np.arange(5.0), "kind": 3}
    odd = replace(a, seed=6, solution=replace(a.solution, stats=odd, history=np.zeros((0, 2))))
    return [bare, a, b, odd, replace(a, seed=8)]


@pytest.fixture(scope="module")
def trials():
    return {t.id: t for t in kinds()}


@pytest.fixture(scope="module")
def path(trials, tmp_path_factory):
    store = Store(tmp_path_factory.mktemp("folder"))
    for trial in trials.values():
        store.write(trial)
    return store.consolidate()


@pytest.fixture
def file(path):
    with h5py.File(path) as opened:
        yield opened


def test_every_trial_comes_back_whatever_its_neighbours_are(path, trials):
    back = read(path)
    assert [t.id for t in back] == sorted(trials)
    for trial in back:
        assert_same(trial, trials[trial.id])


def test_columns_are_those_of_the_trials(file, trials):
    ids = file["trials/id"].asstr()[()].tolist()
    own = [trials[name] for name in ids]
    assert set(file["trials"]) == {*COLUMNS, "problem_row"}
    assert file["trials/seed"][()].tolist() == [t.seed for t in own]
    assert file["trials/planner"].asstr()[()].tolist() == ["stopping"] * 5
    assert file["trials/problem"].asstr()[()].tolist() == [t.problem.name for t in own]
    durations = np.array([t.certified_duration for t in own], dtype=float)
    np.testing.assert_array_equal(file["trials/certified_duration"], durations)
    assert np.isnan(file["trials/evaluations"][()][ids.index(kinds()[0].id)])


def test_the_certified_duration_in_the_file_is_the_closed_form(file):
    # joint 1 travels 1.0 in 0.5 s: velocity 15/8·1/0.5 of 1, acceleration 10/√3·1/0.25 of 2
    dilation = max(15 / 8 / 0.5 / 1.0, np.sqrt(10 / np.sqrt(3) / 0.25 / 2.0))
    (i,) = np.flatnonzero(file["trials/seed"][()] == 3)
    assert file["trials/claimed_duration"][i] == 1.5
    assert file["trials/dilation"][i] == pytest.approx(dilation, rel=1e-12)
    assert file["trials/certified_duration"][i] == pytest.approx(1.5 * dilation, rel=1e-12)
    assert file["trials/feasible"][i] == 0


def test_every_dataset_documents_itself(file):
    found = datasets(file)
    assert len(found) > 50
    for name, data in found.items():
        assert isinstance(data.attrs["units"], str), name
        assert data.attrs["description"], name


def test_units_are_those_of_the_quantities(file):
    units = {name: data.attrs["units"] for name, data in datasets(file).items()}
    assert units["problems/waypoints/values"] == units["problems/position/values"] == "rad"
    assert units["problems/velocity/values"] == "rad/s"
    assert units["problems/acceleration/values"] == "rad/s^2"
    assert units["problems/jerk/values"] == "rad/s^3"
    times = ("claimed_duration", "certified_duration", "setup_time", "solve_time", "lower_bound")
    seconds = [f"trials/{name}" for name in times]
    arrays = ("trajectory/breaks", "trajectory/waypoint_times", "history/duration")
    seconds += [f"{name}/values" for name in arrays]
    assert {units[name] for name in seconds} == {"s"}


def test_whatever_is_per_trial_or_problem_has_its_scale(file):
    for name, data in datasets(file).items():
        if name.endswith(("/values", "/offsets")):
            continue
        scale = "problems/digest" if name.startswith("problems/") else "trials/id"
        if name == scale:
            assert data.is_scale
        else:
            (attached,) = data.dims[0].values()
            assert attached.name == f"/{scale}", name
            assert len(attached) == len(data), name


def test_a_problem_is_stored_once(file):
    digests = file["problems/digest"].asstr()[()].tolist()
    assert sorted(digests) == sorted([PROBLEM.digest(), SMALL.digest()])
    owners = [digests[row] for row in file["trials/problem_row"]]
    assert owners == file["trials/digest"].asstr()[()].tolist()
    waypoints, i = file["problems/waypoints"], digests.index(PROBLEM.digest())
    start, end = waypoints["offsets"][i : i + 2]
    own = waypoints["values"][start:end].reshape(waypoints["shape"][i])
    np.testing.assert_array_equal(own, PROBLEM.waypoints)


def test_the_example_of_the_docstring_reads_the_fastest_trajectory(path, trials, monkeypatch):
    (code,) = re.findall(r"(?s)plain h5py:\n\n(.*)", results_file.__doc__)
    names = {"h5py": h5py, "np": np, "PPoly": PPoly}
    exec(textwrap.dedent(code).replace("results/results.h5", str(path)), names)
    fastest = min(
        (t for t in trials.values() if t.certified_duration), key=lambda t: t.certified_duration
    )
    expected, t = fastest.solution.trajectory, np.linspace(0, fastest.claimed_duration, 50)
    for order in range(3):
        np.testing.assert_allclose(names["trajectory"](t, nu=order), expected(t, order), atol=1e-9)
    assert fastest.problem.name == "small"


def test_pandas_reads_the_columns(file, trials):
    frame = pd.DataFrame(
        {n: c.asstr()[()] if c.dtype.kind == "S" else c[()] for n, c in file["trials"].items()}
    )
    assert frame.groupby("problem")["certified_duration"].count().to_dict() == {
        "Gelenk-Prüfung ①": 3,
        "small": 1,
    }


def write(tmp_path, trials):
    data = results_file.content(lambda: map(encode, trials))
    (tmp_path / "x.h5").write_bytes(data)
    return tmp_path / "x.h5"


def test_no_trials_are_a_file_too(tmp_path):
    assert read(write(tmp_path, [])) == []


def test_arrays_larger_than_what_is_held_back_stay_in_order(tmp_path, monkeypatch):
    monkeypatch.setattr(results_file, "_BUFFER", 7)
    monkeypatch.setattr(results_file, "_CHUNK", 5)
    for a, b in zip(read(write(tmp_path, kinds())), kinds(), strict=True):
        np.testing.assert_equal(a.solution.trajectory is None, b.solution.trajectory is None)
        assert a.id == b.id
        if b.solution.trajectory:
            assert_same(a.solution.trajectory, b.solution.trajectory)


def test_texts_too_long_to_pad_are_read_the_same_way(tmp_path, monkeypatch):
    monkeypatch.setattr(results_file, "_PADDED_BYTES", 100)
    monkeypatch.setattr(results_file, "_PADDED_RATIO", 1)
    long = replace(solved(), message="ß" * 300)
    assert read(write(tmp_path, [long, solved()]))[0].message == "ß" * 300


def test_a_thousand_trials_take_little_room(tmp_path):
    """30 pieces of 6 joints and a history of 300 rows: 11 kB of numbers alone."""
    rng, steps = np.random.default_rng(0), np.arange(1, 301) * 30.0
    trial, base = solved(), encode(solved())
    random = [
        replace(
            base,
            row=base.row | {"id": f"{i:020x}", "seed": i, "solve_time": rng.random()},
            arrays={
                "trajectory/breaks": np.sort(rng.random(31)),
                "trajectory/coefficients": rng.normal(size=(3, 30, 6)),
                "trajectory/waypoint_times": np.sort(rng.random(4)),
                "history/evaluations": steps,
                "history/duration": 1 + np.sort(rng.random(300))[::-1],
            },
        )
        for i in range(300)
    ]
    assert len(results_file.content(lambda: random)) / 300 < 10_000
    assert trial.problem.joints == 2


def test_what_compresses_like_a_bomb_is_stored_so_that_it_can_be_read(tmp_path):
    """56 MB of zeros, deflated to 56 kB, would be more than such a file may claim."""
    zeros = np.zeros(7_000_000)
    trial = solved()
    trial = replace(trial, solution=replace(trial.solution, stats={"zeros": zeros}))
    path = write(tmp_path, [trial])
    assert path.stat().st_size > zeros.nbytes
    np.testing.assert_array_equal(read(path)[0].solution.stats["zeros"], zeros)


def test_every_reader_refuses_a_results_file_with_one_changed_byte(path, tmp_path):
    whole = path.read_bytes()
    places = np.random.default_rng(0).integers(len(whole), size=40)
    for place in places:
        broken = bytearray(whole)
        broken[place] ^= 1 << int(place % 8)
        copy = tmp_path / "results.h5"
        copy.write_bytes(broken)
        with pytest.raises(StoreError, match=r"results\.h5: damaged"):
            read(copy)
