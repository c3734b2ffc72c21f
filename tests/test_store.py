"""The store: whole files or none, everything in plain HDF5, and every field comes back."""

import json
import re
from dataclasses import dataclass, fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.interpolate import PPoly

from trajopt import Limits, Problem, Relation, Solution, Status, StoreError, Trajectory
from trajopt.benchmark import schema, store
from trajopt.benchmark.store import Store, read, records, save
from trajopt.benchmark.trial import judge, trial_id
from trajopt.planner import load

PROBLEM = Problem(
    [[0.0, 0.3], [1.0, -0.2], [1.0, -0.2], [0.4, 0.1]],
    Limits([1.0, [-2.0, 1.5]], [2.0, [-3.0, 4.0]], position=[[-2.0, 2.5], [-np.inf, np.inf]]),
    "Gelenk-Prüfung ①",
    "made up",
)


@dataclass(frozen=True)
class Stopping:
    """A quintic from rest to rest in each segment: peaks 15/8 h/T and 10/√3 h/T²."""

    segment_time: float = 3.0
    note: str = ""

    def relation(self, problem):
        return Relation.RESTRICTION

    def unsupported(self, problem):
        return None

    def solve(self, problem, *, seed=0):
        h, n = problem.displacements, problem.segments
        c = np.zeros((6, n, problem.joints))
        for row, factor in ((0, 6), (1, -15), (2, 10)):
            c[row] = factor * h / self.segment_time ** (5 - row)
        c[5] = problem.waypoints[:-1]
        breaks = self.segment_time * np.arange(n + 1)
        return Solution(
            Status.SOLVED,
            Trajectory(breaks, c, breaks),
            message=self.note,
            lower_bound=0.25,
            evaluations=7,
            history=np.array([[1.0, np.nan], [4.0, 9.5], [7.0, 9.0]]),
            setup_time=0.0,
            stats={"kind": "quintic", "a/b": 1.5, "list": ["x", "ü"], "times": np.arange(3.0)},
        )


@pytest.fixture(scope="module")
def trial():
    return judge(Stopping(0.5), PROBLEM, [3], "stopping")[0]


@pytest.fixture
def group(tmp_path, trial):
    with h5py.File(save(tmp_path / "t.h5", trial)) as file:
        yield file


def datasets(file):
    found = {}
    file.visititems(lambda n, d: found.update({n: d}) if isinstance(d, h5py.Dataset) else None)
    return found


def text(file, name):
    return file[name].asstr()[()]


def assert_same(a, b):
    """Equal in every field, and in every field of their fields."""
    assert type(a) is type(b)
    for field in fields(a):
        x, y = getattr(a, field.name), getattr(b, field.name)
        if field.name in ("problem", "limits", "solution", "trajectory", "certificate") and x:
            assert_same(x, y)
        elif field.name == "stats":
            assert x.keys() == y.keys()
            assert all(np.array_equal(x[k], y[k]) for k in x)
        elif isinstance(x, np.ndarray):
            np.testing.assert_array_equal(x, y, err_msg=field.name)
        else:
            assert x == y, field.name


def test_every_field_comes_back(tmp_path, trial):
    (back,) = read(save(tmp_path / "t.h5", trial))
    assert_same(back, trial)
    assert back.id == trial.id
    assert back.as_dict() == trial.as_dict()


@pytest.mark.parametrize("spec", ["pso:iterations=20", "exact:starts=1", "toppra"])
def test_every_field_of_a_real_planner_comes_back(tmp_path, spec):
    problem = Problem([[0.0], [0.4], [1.0], [1.5]], Limits([1.0], [2.0]), "one joint")
    (trial,) = judge(load(spec), problem, [0], spec.split(":")[0])
    (back,) = read(save(tmp_path / "t.h5", trial))
    assert back.certified_duration is not None
    assert back.solution.setup_time == pytest.approx(trial.solution.setup_time)
    assert_same(back, replace(trial, solution=replace(trial.solution, setup_time=trial.setup_time)))


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.SOLVED])
def test_failures_are_trials_with_a_status(tmp_path, trial, status):
    solution = Solution(status, message="why not")
    failure = replace(
        trial, status=status, message="why not", solution=solution, certificate=None, setup_time=0.0
    )
    with h5py.File(save(tmp_path / "t.h5", failure)) as file:
        assert text(file, "status") == str(status)
        assert np.isnan(file["certified_duration"][()])
        assert "trajectory" not in file
    (back,) = read(tmp_path / "t.h5")
    assert_same(back, failure)


def test_the_certified_duration_in_the_file_is_the_closed_form(group):
    # joint 1 travels 1.0 in 0.5 s: velocity 15/8·1/0.5 of 1, acceleration 10/√3·1/0.25 of 2
    dilation = max(15 / 8 / 0.5 / 1.0, np.sqrt(10 / np.sqrt(3) / 0.25 / 2.0))
    assert group["claimed_duration"][()] == 1.5
    assert group["dilation"][()] == pytest.approx(dilation, rel=1e-12)
    assert group["certified_duration"][()] == pytest.approx(1.5 * dilation, rel=1e-12)
    assert group["feasible"][()] == 0


def test_every_dataset_documents_itself(group):
    found = datasets(group)
    assert len(found) > 40
    for name, data in found.items():
        assert isinstance(data.attrs["units"], str), name
        assert data.attrs["description"], name


def test_units_are_those_of_the_quantities(group):
    units = {name: group[name].attrs["units"] for name in datasets(group)}
    assert units["problem/waypoints"] == units["problem/position"] == "rad"
    assert units["problem/velocity"] == "rad/s"
    assert units["problem/acceleration"] == "rad/s^2"
    assert units["problem/jerk"] == "rad/s^3"
    seconds = ["claimed_duration", "certified_duration", "setup_time", "solve_time", "lower_bound"]
    seconds += ["trajectory/breaks", "trajectory/waypoint_times", "history/duration"]
    assert {units[name] for name in seconds} == {"s"}


def test_every_array_axis_of_problem_trajectory_and_history_has_its_scale(group):
    expected = {
        "problem/waypoints": ("waypoint", "joint"),
        "problem/velocity": ("joint", "side"),
        "problem/acceleration": ("joint", "side"),
        "problem/jerk": ("joint", "side"),
        "problem/position": ("joint", "side"),
        "trajectory/breaks": ("break",),
        "trajectory/coefficients": ("power", "piece", "joint"),
        "trajectory/waypoint_times": ("waypoint",),
        "history/duration": ("evaluations",),
    }
    for name, scales in expected.items():
        for axis, scale in enumerate(scales):
            (attached,) = group[name].dims[axis].values()
            assert attached.name.endswith("/" + scale), (name, axis)
            assert len(attached) == group[name].shape[axis]
    np.testing.assert_array_equal(group["scales/power"][()], [5, 4, 3, 2, 1, 0])
    np.testing.assert_array_equal(group["scales/joint"][()], [1, 2])


def test_the_file_holds_what_the_issue_lists(group, trial):
    np.testing.assert_array_equal(group["problem/waypoints"][()], PROBLEM.waypoints)
    for name in ("velocity", "acceleration", "jerk", "position"):
        np.testing.assert_array_equal(group[f"problem/{name}"][()], getattr(PROBLEM.limits, name))
    assert text(group, "problem/name") == "Gelenk-Prüfung ①"
    assert text(group, "problem/source") == "made up"
    assert text(group, "planner") == "stopping"
    assert json.loads(text(group, "options")) == {"segment_time": 0.5, "note": ""}
    assert group["seed"][()] == 3
    assert text(group, "status") == "solved"
    assert text(group, "message") == ""
    assert group["setup_time"][()] == 0
    assert group["solve_time"][()] > 0
    assert group["evaluations"][()] == 7
    np.testing.assert_array_equal(group["history/evaluations"][()], [1, 4, 7])
    np.testing.assert_array_equal(group["history/duration"][()], [np.nan, 9.5, 9.0])
    np.testing.assert_array_equal(group["trajectory/waypoint_times"][()], [0, 0.5, 1, 1.5])
    assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00$", text(group, "started"))
    versions = {name: text(group, f"provenance/{name}") for name in group["provenance"]}
    for package in ("trajopt", "numpy", "scipy", "casadi", "toppra", "ruckig", "python"):
        assert re.match(r"\d+\.\d+", versions[package]), package
    assert re.match(r"[0-9a-f]{40}", versions["commit"])
    assert "CPU" in versions["machine"]


def test_plain_h5py_and_scipy_rebuild_the_trajectory(group, trial):
    breaks = group["trajectory/breaks"][()]
    rebuilt = PPoly(group["trajectory/coefficients"][()], breaks)
    times = np.linspace(0, breaks[-1], 101)
    s = np.clip(times / 0.5, 0, 1)[:, None]
    first = PROBLEM.waypoints[0] + (10 * s**3 - 15 * s**4 + 6 * s**5) * PROBLEM.displacements[0]
    np.testing.assert_allclose(rebuilt(times[:34]), first[:34], atol=1e-12)
    for order in range(3):
        expected = trial.solution.trajectory(times, order)
        np.testing.assert_allclose(rebuilt(times, nu=order), expected, atol=1e-11)


def test_long_and_odd_text_survives(tmp_path, trial):
    note = "Traceback …\n" + "ß∞𝔘" * 50_000
    (back,) = read(save(tmp_path / "t.h5", replace(trial, message=note)))
    assert back.message == note
    (back,) = read(save(tmp_path / "t.h5", replace(trial, message="nul \0, surrogate \ud800")))
    assert back.message == "nul \\0, surrogate \\ud800"


def test_options_that_json_lacks_are_stored_and_keep_the_identity(tmp_path, trial):
    odd = replace(trial, options={"path": Path("/tmp"), "n": np.int64(3), "x": np.inf, "t": (1, 2)})
    (back,) = read(save(tmp_path / "t.h5", odd))
    assert back.id == odd.id


# --- atomic writing ---


def test_no_temporary_file_is_left(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    results.consolidate()
    files = sorted(p.relative_to(tmp_path).as_posix() for p in tmp_path.rglob("*") if p.is_file())
    assert files == ["results.h5", f"trials/{trial.id}.h5"]


@pytest.mark.parametrize("moment", ["write", "sync", "rename"])
def test_a_crash_while_writing_leaves_no_file_and_an_old_one_intact(
    tmp_path, trial, monkeypatch, moment
):
    def crash(*_):
        raise RuntimeError("pulled the plug")

    place = {
        "write": (schema, "_write_trajectory"),
        "sync": (store, "_sync"),
        "rename": (store.os, "replace"),
    }
    results = Store(tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(*place[moment], crash)
        with pytest.raises(RuntimeError, match="plug"):
            results.write(trial)
    assert list((tmp_path / "trials").iterdir()) == []
    old = results.write(trial).read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr(*place[moment], crash)
        with pytest.raises(RuntimeError, match="plug"):
            results.write(trial)
    assert [p.read_bytes() for p in (tmp_path / "trials").iterdir()] == [old]


def test_a_crash_while_consolidating_keeps_the_old_results(tmp_path, trial, monkeypatch):
    results = Store(tmp_path)
    results.write(trial)
    old = results.consolidate().read_bytes()

    def crash(out, files):
        out.create_group("trials")
        raise RuntimeError("pulled the plug")

    monkeypatch.setattr(store, "_copy_all", crash)
    with pytest.raises(RuntimeError):
        results.consolidate()
    assert results.results.read_bytes() == old
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.h5", "trials"]


def test_the_file_is_synced_before_it_is_renamed_and_the_folder_after(tmp_path, trial, monkeypatch):
    steps = []
    sync, rename = store._sync, store.os.replace
    monkeypatch.setattr(store, "_sync", lambda p: (steps.append(Path(p).suffix), sync(p)))
    monkeypatch.setattr(store.os, "replace", lambda a, b: (steps.append("rename"), rename(a, b)))
    Store(tmp_path).write(trial)
    assert steps == [".tmp", "rename", ""]


def test_a_file_where_a_folder_should_be_is_a_store_error(tmp_path, trial):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match=re.escape(str(tmp_path / "file"))):
        Store(tmp_path / "file").write(trial)


# --- the folder as index ---


def test_results_h5_holds_the_trial_files_unchanged(tmp_path, trial):
    results = Store(tmp_path)
    other = replace(trial, seed=4, message="other")
    results.write(trial)
    results.write(other)
    with h5py.File(results.consolidate()) as file:
        assert sorted(file["trials"]) == sorted([trial.id, other.id])
        for one in (trial, other):
            copied = datasets(file["trials"][one.id])
            with h5py.File(results.path(one.id)) as source:
                original = datasets(source)
                assert copied.keys() == original.keys()
                for name, data in original.items():
                    np.testing.assert_array_equal(copied[name][()], data[()], err_msg=name)
                    assert copied[name].attrs["units"] == data.attrs["units"]
            (scale,) = file["trials"][one.id]["trajectory/breaks"].dims[0].values()
            assert scale.attrs["description"] == "break number, from 1"
    for a, b in zip(read(results.results), read(tmp_path), strict=True):
        assert_same(a, b)


def test_missing_backends_are_not_finished_but_are_read(tmp_path, trial):
    results = Store(tmp_path)
    absent = replace(trial, status=Status.MISSING, solution=Solution(Status.MISSING))
    failed = replace(trial, seed=9, status=Status.CRASHED, solution=Solution(Status.CRASHED))
    results.write(absent)
    results.write(failed)
    assert results.finished() == {failed.id}
    assert {t.status for t in results.read()} == {Status.MISSING, Status.CRASHED}


def damaged(path, how):
    data = bytearray(path.read_bytes())
    if how == "empty":
        data = bytearray()
    elif how == "truncated":
        data = data[: len(data) // 2]
    elif how == "text":
        data = bytearray(b"not HDF5")
    elif how == "zeroed":
        data[2000:] = bytes(len(data) - 2000)
    path.write_bytes(data)


@pytest.mark.parametrize("how", ["empty", "truncated", "text", "zeroed"])
def test_a_damaged_trial_is_not_finished_and_does_not_spoil_the_others(tmp_path, trial, how):
    results = Store(tmp_path)
    other = replace(trial, seed=4)
    damaged(results.write(trial), how)
    results.write(other)
    assert results.finished() == {other.id}
    assert [t.id for t in read(results.consolidate())] == [other.id]
    assert [t.id for t in results.read()] == [other.id]
    with pytest.raises(StoreError, match=trial.id):
        read(tmp_path)


def test_a_newer_schema_is_refused_in_words(tmp_path, trial):
    results = Store(tmp_path)
    path = results.write(trial)
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = store.SCHEMA + 1
    for place in (path, tmp_path, results.consolidate()):
        with pytest.raises(StoreError, match=r"schema 2.*up to 1.*upgrade"):
            read(place)


@pytest.mark.parametrize("name", ["nothing", "nothing.h5", "."])
def test_a_path_without_results_is_a_store_error_naming_it(tmp_path, name):
    with pytest.raises(StoreError, match=re.escape(str(tmp_path / name))):
        read(tmp_path / name)


def test_hdf5_of_something_else_is_a_store_error(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(StoreError, match=r"x\.h5"):
        read(tmp_path / "x.h5")


def test_a_stored_trajectory_that_is_none_any_more_reads_as_invalid(tmp_path, trial):
    path = save(tmp_path / "t.h5", trial)
    with h5py.File(path, "r+") as file:
        file["trajectory/breaks"][-1] *= 0.9
    ((back, record),) = records(path)
    assert back.status is Status.INVALID
    assert "waypoint_times" in back.message
    assert back.certified_duration is None
    assert record.claimed_duration == 1.5


# --- identity ---


def changed_problems():
    w, limits = PROBLEM.waypoints, PROBLEM.limits
    kinds = {n: getattr(limits, n) for n in ("velocity", "acceleration", "jerk", "position")}
    yield Problem(np.nextafter(w, 9), limits)
    for name, value in kinds.items():
        value = value.copy()
        value[1, 1] = 3.25
        yield Problem(w, Limits(**kinds | {name: value}))


def test_identity_is_numbers_planner_options_seed_and_version_and_not_the_name():
    base = (PROBLEM, "pso", {"population": 30, "fitness": "penalty"}, 0, "0.1.0")
    ids = [trial_id(*base)]
    ids += [trial_id(p, *base[1:]) for p in changed_problems()]
    ids += [trial_id(*base[:1], "ssa", *base[2:])]
    ids += [trial_id(*base[:2], {**base[2], k: v}, *base[3:]) for k, v in
            (("population", 31), ("fitness", "scaled"), ("new", None))]  # fmt: skip
    ids += [trial_id(*base[:3], 1, "0.1.0"), trial_id(*base[:4], "0.1.1")]
    assert len(set(ids)) == len(ids) == 12
    assert trial_id(replace(PROBLEM, name="renamed", source="x"), *base[1:]) == ids[0]
    assert trial_id(*base[:2], {"fitness": "penalty", "population": 30}, *base[3:]) == ids[0]


def test_every_option_of_every_registered_planner_is_in_the_identity():
    for spec, change in (("issa", "levy=False"), ("toppra", "ends=natural"), ("exact", "starts=2")):
        a, b = (judge_id(load(s)) for s in (spec, f"{spec}:{change}"))
        assert a != b


def judge_id(planner):
    from trajopt.planner import options

    return trial_id(PROBLEM, "p", options(planner), 0, "0")
