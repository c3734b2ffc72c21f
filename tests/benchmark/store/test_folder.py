"""The folder: whole files or none, whatever the disk, a signal or another run does."""

import errno
import json
import os
import platform
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from scipy.interpolate import PPoly
from trials import PROBLEM, assert_same, datasets, edited, solved

from trajopt import Solution, Status, StoreError
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.store import results_file
from trajopt.benchmark.store.folder import DamagedFile, Store, atomic, read, records, save
from trajopt.benchmark.store.hdf5 import SCHEMA


@pytest.fixture(scope="module")
def trial():
    return solved()


@pytest.fixture
def group(tmp_path, trial):
    with h5py.File(save(tmp_path / "t.h5", trial)) as file:
        yield file


def files(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


# --- a trial file ---


def test_the_trial_file_holds_what_the_issue_lists(group, trial):
    def refuse(word):
        raise AssertionError(word)

    record = json.loads(group["record"].asstr()[()], parse_constant=refuse)
    assert record["problem"] == "Gelenk-Prüfung ①"
    assert record["source"] == "made up"
    assert record["planner"] == "stopping"
    assert record["options"] == {"segment_time": 0.5, "note": ""}
    assert (record["seed"], record["evaluations"], record["batch"]) == (3, 7, 1)
    assert (record["status"], record["message"]) == ("solved", "")
    assert record["setup_time"] == 0
    assert record["solve_time"] > 0
    assert record["certificate"]["velocity"]["joint"] == 1  # of two, counted from 1
    assert re.match(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}\+00:00$", record["started"])
    for package in ("trajopt", "numpy", "scipy", "casadi", "toppra", "ruckig", "python"):
        assert re.match(r"\d+\.\d+", record["provenance"][package]), package
    assert "CPU" in record["provenance"]["machine"]
    assert record["numbers"]["waypoints"] == PROBLEM.waypoints.tolist()
    assert record["numbers"]["position"][1] == [{"$float": "-inf"}, {"$float": "inf"}]
    np.testing.assert_array_equal(group["history/evaluations"][()], [1, 4, 7])
    np.testing.assert_array_equal(group["history/duration"][()], [np.nan, 2.25, 1.5])
    np.testing.assert_array_equal(group["trajectory/waypoint_times"][()], [0, 0.5, 1, 1.5])
    np.testing.assert_array_equal(group["stats/times"][()], [0, 1, 2])


def test_every_dataset_of_a_trial_file_documents_itself(group):
    found = datasets(group)
    assert len(found) == 7
    for name, data in found.items():
        assert isinstance(data.attrs["units"], str), name
        assert data.attrs["description"], name
    assert group["trajectory/breaks"].attrs["units"] == "s"
    assert group["trajectory/coefficients"].attrs["units"] == "rad/s^power"


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


def test_a_trial_file_is_small(tmp_path, trial):
    arrays = sum(a.nbytes for a in arrays_of(trial))
    assert save(tmp_path / "t.h5", trial).stat().st_size < arrays + 11_000


def arrays_of(trial):
    trajectory = trial.solution.trajectory
    return trajectory.breaks, trajectory.coefficients, trajectory.waypoint_times


# --- atomic writing ---


def test_no_temporary_file_is_left(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    results.consolidate()
    assert files(tmp_path) == ["results.h5", f"trials/{trial.id}.h5"]


@pytest.mark.parametrize("moment", ["write", "sync", "rename"])
def test_a_crash_while_writing_leaves_no_file_and_an_old_one_intact(
    tmp_path, trial, monkeypatch, moment
):
    def crash(*_):
        raise RuntimeError("pulled the plug")

    place = {
        "write": (Path, "write_bytes"),
        "sync": (atomic, "_sync"),
        "rename": (os, "replace"),
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

    def crash(trials):
        raise RuntimeError("pulled the plug")

    monkeypatch.setattr(results_file, "content", crash)
    with pytest.raises(RuntimeError):
        results.consolidate()
    assert results.results.read_bytes() == old
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.h5", "trials"]


def test_a_folder_is_read_from_results_h5_only_while_that_holds_every_trial(tmp_path, trial):
    """No trial file is opened where `results.h5` is younger than all of them."""
    results = Store(tmp_path)
    path = results.write(trial)
    results.consolidate()
    before = path.stat()
    path.write_bytes(b"damaged")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert [found.id for found in read(tmp_path)] == [trial.id]
    path.write_bytes(b"damaged")
    with pytest.warns(DamagedFile, match=path.name):
        assert read(tmp_path) == []


def test_the_file_is_synced_before_it_is_renamed_and_the_folder_after(tmp_path, trial, monkeypatch):
    steps = []
    sync, rename = atomic._sync, os.replace
    monkeypatch.setattr(atomic, "_sync", lambda p: (steps.append(Path(p).suffix), sync(p)))
    monkeypatch.setattr(os, "replace", lambda a, b: (steps.append("rename"), rename(a, b)))
    Store(tmp_path).write(trial)
    assert steps == [".tmp", "rename", ""]


def test_trials_that_finish_together_are_synced_before_any_is_renamed(tmp_path, trial, monkeypatch):
    steps = []
    sync, rename = atomic._sync, os.replace
    monkeypatch.setattr(atomic, "_sync", lambda p: (steps.append(Path(p).suffix), sync(p)))
    monkeypatch.setattr(os, "replace", lambda a, b: (steps.append("rename"), rename(a, b)))
    trials = [replace(trial, seed=seed) for seed in range(3)]
    paths = [written.path for written in Store(tmp_path).write_all(trials)]
    assert steps == [".tmp", ".tmp", ".tmp", "rename", "rename", "rename", ""]
    assert paths == [Store(tmp_path).path(one.id) for one in trials]
    assert {t.id for t in read(tmp_path)} == {one.id for one in trials}


def test_what_the_disk_refuses_does_not_take_those_before_it_along(tmp_path, trial, monkeypatch):
    write = Path.write_bytes
    trials = [replace(trial, seed=seed) for seed in range(4)]

    def full(path, data):
        if path.name.startswith(f".{trials[2].id}"):
            write(path, data[:1000])
            raise OSError(errno.ENOSPC, "No space left on device")
        write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(StoreError, match=rf"{trials[2].id}\.h5.*No space left on device"):
        Store(tmp_path).write_all(trials)
    assert files(tmp_path) == sorted(f"trials/{one.id}.h5" for one in trials[:2])


def test_another_trial_takes_the_place_of_one_that_no_file_can_hold(tmp_path, trial):
    odd = replace(trial, seed=4, solution=replace(trial.solution, stats={"x": object()}))

    def blank(one):
        assert one is odd
        return absent_of(one)

    with pytest.raises(TypeError, match="cannot hold"):
        Store(tmp_path).write_all([trial, odd])
    assert files(tmp_path) == []
    Store(tmp_path).write_all([trial, odd], instead=blank)
    assert {(t.seed, t.status) for t in read(tmp_path)} == {(3, Status.SOLVED), (4, Status.MISSING)}


def test_a_file_where_a_folder_should_be_is_a_store_error(tmp_path, trial):
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreError, match=re.escape(str(tmp_path / "file"))):
        Store(tmp_path / "file").write(trial)


def test_a_full_disk_is_said_in_words_and_loses_nothing(tmp_path, trial, monkeypatch):
    results = Store(tmp_path)
    old = results.write(trial)
    before = old.read_bytes()

    def full(path, data):
        with path.open("wb") as file:
            file.write(data[:1000])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    other = replace(trial, seed=4)
    with pytest.raises(StoreError, match=rf"{other.id}\.h5.*No space left on device"):
        results.write(other)
    with pytest.raises(StoreError, match="No space left on device"):
        results.write(trial)
    assert files(tmp_path) == [f"trials/{trial.id}.h5"]
    assert old.read_bytes() == before


FILL = """
import resource, sys
from dataclasses import replace
sys.path.insert(0, sys.argv[2])
from trials import solved
from trajopt import StoreError
from trajopt.benchmark.store.folder import Store
store, trial = Store(__import__("pathlib").Path(sys.argv[1])), solved()
for seed in range(12):
    store.write(replace(trial, seed=seed))
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[3]),) * 2)
try:
    store.consolidate() if int(sys.argv[3]) > 4096 else store.write(replace(trial, seed=99))
except StoreError as error:
    print(error)
"""


@pytest.mark.skipif(os.name != "posix", reason="limits of this kind are POSIX's")
@pytest.mark.parametrize("limit", [2000, 8192])
def test_a_limit_on_the_size_of_files_stops_at_a_whole_file(tmp_path, limit):
    """A real refusal by the system, of a trial file and of results.h5."""
    command = [
        sys.executable,
        "-c",
        FILL,
        str(tmp_path),
        str(Path(__file__).parents[2]),
        str(limit),
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert re.search(r"\.h5: cannot be written: File too large\n", done.stdout)
    assert done.stderr == ""
    assert len(files(tmp_path)) == 12
    assert len(read(tmp_path)) == 12


# --- the folder as index ---


def test_results_h5_holds_what_the_trial_files_hold(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    results.write(replace(trial, seed=4, message="other"))
    for a, b in zip(read(results.consolidate()), read(tmp_path), strict=True):
        assert_same(a, b)


def absent_of(trial):
    solution = Solution(Status.MISSING, message="pip install it")
    return replace(trial, status=Status.MISSING, solution=solution, certificate=None)


def test_missing_backends_are_not_finished_but_are_read(tmp_path, trial):
    results = Store(tmp_path)
    absent = absent_of(trial)
    failed = replace(trial, seed=9, status=Status.FAILED, solution=Solution(Status.FAILED))
    crashed = replace(trial, seed=8, status=Status.CRASHED, solution=Solution(Status.CRASHED))
    for kept in (absent, failed, crashed):
        results.write(kept)
    assert results.finished() == {failed.id}
    assert {t.id for t in results.unanswered()} == {absent.id, crashed.id}
    assert not results.has(absent.id)
    assert results.has(failed.id)
    for found in (results.read(), read(results.consolidate()), read(tmp_path)):
        assert {t.status for t in found} == {Status.MISSING, Status.CRASHED, Status.FAILED}
    assert [t.status for t in read(tmp_path, {absent.id})] == [Status.MISSING]


def test_the_backend_s_answer_replaces_its_absence_and_is_never_replaced_by_it(tmp_path, trial):
    results = Store(tmp_path)
    results.write(absent_of(trial))
    results.write(trial)
    assert files(tmp_path) == [f"trials/{trial.id}.h5"]
    results.write(absent_of(trial))  # a run elsewhere, without the backend, into this folder
    for found in (results.read(), read(tmp_path, {trial.id}), read(results.consolidate())):
        assert [t.status for t in found] == [Status.SOLVED]
    assert results.finished() == {trial.id}


def damaged(path, how):
    data = bytearray(path.read_bytes())
    if how == "empty":
        data = bytearray()
    elif how == "truncated":
        data = data[: len(data) // 2]
    elif how == "last byte":
        data = data[:-1]
    elif how == "text":
        data = bytearray(b"not HDF5, but longer than sixteen bytes")
    elif how == "zeroed":
        data[2000:] = bytes(len(data) - 2000)
    elif how == "one bit":
        data[data.index(b"made up")] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize("how", ["empty", "truncated", "text", "zeroed"])
def test_a_damaged_trial_is_not_finished_and_does_not_spoil_the_others(tmp_path, trial, how):
    results = Store(tmp_path)
    other = replace(trial, seed=4)
    damaged(results.write(trial), how)
    results.write(other)
    assert results.finished() == {other.id}
    assert not results.has(trial.id)
    words = rf"{trial.id}\.h5: damaged.*; running its comparison again replaces it"
    for reading in (lambda: read(results.consolidate()), results.read, lambda: read(tmp_path)):
        with pytest.warns(DamagedFile, match=words):
            assert [t.id for t in reading()] == [other.id]
    with pytest.raises(StoreError, match=words):
        read(results.path(trial.id))


def test_a_flipped_bit_is_found_when_the_file_is_read(tmp_path, trial):
    results = Store(tmp_path)
    path = results.write(trial)
    rng, data = np.random.default_rng(0), path.read_bytes()
    for place in rng.integers(len(data), size=60):
        broken = bytearray(data)
        broken[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        with pytest.warns(DamagedFile, match="checksum|its"):
            assert results.read() == []


def test_what_is_damaged_is_listed_beside_what_was_verified(tmp_path, trial):
    results, found = Store(tmp_path), []
    damaged(results.write(trial), "one bit")
    results.write(replace(trial, seed=4))
    ((back, record),) = records(tmp_path, found.append)
    assert (back.seed, record["certified_duration"]) == (4, trial.certified_duration)
    (error,) = found
    assert error.path == results.path(trial.id)


@pytest.mark.parametrize(("schema", "words"), [(SCHEMA + 1, "upgrade trajopt"), (1, "run again")])
def test_another_schema_is_refused_in_words_before_anything_runs(tmp_path, trial, schema, words):
    results = Store(tmp_path)
    path = results.write(trial)
    with h5py.File(path, "r+") as file:
        file.attrs["schema"] = schema
    ways = [results.finished, results.read, results.consolidate]
    ways += [lambda: read(path), lambda: read(tmp_path)]
    for way in ways:
        with pytest.raises(StoreError, match=rf"schema {schema}, this reads {SCHEMA}; {words}"):
            way()
    assert files(tmp_path) == [f"trials/{trial.id}.h5"]


def test_results_of_another_schema_are_refused_too(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    with edited(results.consolidate()) as file:
        file.attrs["schema"] = SCHEMA + 1
    with pytest.raises(StoreError, match=rf"results\.h5: written with schema {SCHEMA + 1}"):
        read(results.results)


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
    with edited(path) as file:
        file["trajectory/breaks"][-1] *= 0.9
    ((back, record),) = records(path)
    assert back.status is Status.INVALID
    assert "waypoint_times" in back.message
    assert back.certified_duration is None
    assert record["claimed_duration"] == 1.5


def test_records_are_verified_anew(tmp_path, trial):
    path = save(tmp_path / "t.h5", trial)
    with edited(path) as file:
        file["trajectory/coefficients"][0] *= 1.01
    ((back, record),) = records(path)
    assert back.certified_duration is None
    assert "waypoint" in " ".join(back.certificate.flaws)
    assert record["certified_duration"] == trial.certified_duration


# --- other runs ---


def temporary(folder, host, process, age):
    path = folder / f".x~{host}~{process}~0123.tmp"
    path.write_bytes(b"half")
    os.utime(path, (time.time() - age,) * 2)
    return path


def test_litter_of_killed_runs_is_removed_and_live_ones_keep_theirs(tmp_path, trial):
    results, here = Store(tmp_path), platform.node()
    results.write(trial)
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    cases = [
        (here, gone.pid, 120, False), (here, gone.pid, 5, True), (here, os.getpid(), 3600, True),
        (here, 1, 3600, True), ("elsewhere", gone.pid, 3600, True),
        ("elsewhere", os.getpid(), 90_000, False),
    ]  # fmt: skip
    for folder in (tmp_path, tmp_path / "trials"):
        left = [(temporary(folder, *case[:3]), case[3]) for case in cases]
        (folder / ".strange.tmp").write_text("")
        os.utime(folder / ".strange.tmp", (time.time() - 3600,) * 2)
        results.consolidate()
        assert [path.exists() for path, _ in left] == [
            any(stays for (h, p, _, stays) in cases if f"~{h}~{p}~" in path.name)
            for path, _ in left
        ]


def test_results_are_rebuilt_when_another_run_finished_meanwhile(tmp_path, trial, monkeypatch):
    results, other = Store(tmp_path), replace(trial, seed=4)
    results.write(trial)
    content, turns = results_file.content, []

    def interrupted(trials):
        data = content(trials)
        if not turns:
            turns.append(1)
            results.write(other)
            Store(tmp_path).consolidate()
        return data

    monkeypatch.setattr(results_file, "content", interrupted)
    results.consolidate()
    assert {t.id for t in read(results.results)} == {trial.id, other.id}


def test_a_trial_that_another_run_finishes_meanwhile_is_read(tmp_path, trial, monkeypatch):
    results, listed = Store(tmp_path), store._trial_files
    results.write(absent_of(trial))

    def then_finished(folder):
        found = listed(folder)
        results.write(trial)
        return found

    monkeypatch.setattr(store, "_trial_files", then_finished)
    assert [t.status for t in results.read()] == [Status.SOLVED]


WRITER = """
import sys
from dataclasses import replace
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from trials import solved
from trajopt.benchmark.store.folder import Store
store, trial = Store(Path(sys.argv[1])), solved()
for seed in range(int(sys.argv[3]), 10**6):
    one = replace(trial, seed=seed)
    store.write(one)
    print(one.id, flush=True)
    if seed % 5 == 0:
        store.consolidate()
"""


def test_killed_writers_lose_nothing_they_reported(tmp_path):
    """Two at once into one folder, killed at random moments; each line is a promise."""
    rng, promised = np.random.default_rng(1), set()
    for turn in range(2):
        command = [sys.executable, "-c", WRITER, str(tmp_path), str(Path(__file__).parents[2])]
        running = [
            subprocess.Popen(
                [*command, str(10**5 * (2 * turn + k))], stdout=subprocess.PIPE, text=True
            )
            for k in range(2)
        ]
        for process in running:
            promised.add(process.stdout.readline().strip())
        time.sleep(float(rng.uniform(0.05, 0.3)))
        for process in running:
            process.send_signal(signal.SIGKILL)
            promised |= {line.strip() for line in process.stdout if line.endswith("\n")}
            process.stdout.close()
            process.wait()
        assert promised <= Store(tmp_path).finished()
        assert promised <= {t.id for t in read(tmp_path)}
    assert promised <= {t.id for t in read(Store(tmp_path).consolidate())}
