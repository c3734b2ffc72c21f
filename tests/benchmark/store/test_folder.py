"""The folder: whole files or none, whatever the disk, a signal or another run does."""

import errno
import os
import pickle
import platform
import re
import signal
import subprocess
import sys
import time
import warnings
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from trials import assert_same, edited, solved

from trajopt import Solution, Status, StoreError
from trajopt.benchmark.store import folder as module
from trajopt.benchmark.store import results_file, trial_text
from trajopt.benchmark.store.folder import DamagedFile, Store, atomic, read, recorded, save


@pytest.fixture(scope="module")
def trial():
    return solved()


def files(folder):
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*") if p.is_file())


# --- atomic writing ---


def finished(store):
    """The identities of the trials that need not run again."""
    return {trial.id for trial in store.seen().trials.values() if not trial.runs_again}


def test_no_temporary_file_is_left(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    results.consolidate()
    assert files(tmp_path) == ["results.h5", f"trials/{trial.id}.json"]


@pytest.mark.parametrize("moment", ["write", "sync", "rename"])
def test_a_crash_while_writing_leaves_no_file_and_an_old_one_intact(
    tmp_path, trial, monkeypatch, moment
):
    def crash(*_):
        raise RuntimeError("pulled the plug")

    place = {"write": (Path, "write_bytes"), "sync": (atomic, "_sync"), "rename": (os, "replace")}
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

    def crash(*_):
        raise RuntimeError("pulled the plug")

    monkeypatch.setattr(results_file, "content", crash)
    with pytest.raises(RuntimeError):
        results.consolidate()
    assert results.results.read_bytes() == old
    assert sorted(p.name for p in tmp_path.iterdir()) == ["results.h5", "trials"]


def test_a_folder_is_read_from_its_trials_whatever_results_h5_says(tmp_path, trial):
    results = Store(tmp_path)
    path = results.write(trial)
    results.consolidate()
    path.write_bytes(b"damaged")
    with pytest.warns(DamagedFile, match=path.name):
        assert read(tmp_path) == []


def test_results_h5_that_holds_everything_is_left_as_it_is_and_another_is_replaced(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    file = results.consolidate()
    whole, inode = file.read_bytes(), file.stat().st_ino
    for age in (0.0, 1e10):  # also one dated in the future
        os.utime(file, (age, age))
        assert results.consolidate().stat().st_ino == inode
    for changed in (whole[:-1], whole[:-40] + bytes(40), b"", b"\x89HDF\r\n\x1a\n"):
        file.write_bytes(changed)
        os.utime(file, (1e10, 1e10))
        assert results.consolidate().read_bytes() == whole


def older(file):
    file.write_bytes(b"HDF5 trajopt3" + bytes(32))


def of_other_code(file):
    edited(file, lambda own: own.attrs.modify("judge", "0" * 64))


def of_fewer_trials(file):
    save(file, read(file.parent)[0])


@pytest.mark.parametrize("stale", [Path.unlink, older, of_other_code, of_fewer_trials])
def test_a_reader_of_the_folder_refreshes_what_is_not_of_its_trials(tmp_path, trial, stale):
    store = Store(tmp_path)
    store.write_all([trial, replace(trial, seed=4)])
    whole = store.consolidate().read_bytes()
    stale(store.results)
    assert store.refresh()
    assert store.results.read_bytes() == whole
    assert not store.refresh()
    (tmp_path / "trials" / f"{0:020x}.json").write_bytes(b"damaged")
    assert not store.refresh()  # the same file again
    assert store.results.read_bytes() == whole


def test_the_file_is_synced_before_it_is_renamed_and_the_folder_after(tmp_path, trial, monkeypatch):
    steps = []
    sync = atomic._sync
    rename = os.replace
    monkeypatch.setattr(atomic, "_sync", lambda p: (steps.append(Path(p).suffix), sync(p)))
    monkeypatch.setattr(os, "replace", lambda a, b: (steps.append("rename"), rename(a, b)))
    Store(tmp_path).write(trial)
    assert steps == [".tmp", "rename", ""]


def test_trials_that_finish_together_are_synced_before_any_is_renamed(tmp_path, trial, monkeypatch):
    steps = []
    sync = atomic._sync
    rename = os.replace
    monkeypatch.setattr(atomic, "_sync", lambda p: (steps.append(Path(p).suffix), sync(p)))
    monkeypatch.setattr(os, "replace", lambda a, b: (steps.append("rename"), rename(a, b)))
    trials = [replace(trial, seed=seed) for seed in range(3)]
    paths = [written.found.path for written in Store(tmp_path).write_all(trials)]
    assert steps == [".tmp", ".tmp", ".tmp", "rename", "rename", "rename", ""]
    assert paths == [Store(tmp_path).path(one.id) for one in trials]
    assert {t.id for t in read(tmp_path)} == {one.id for one in trials}


def test_what_judges_of_this_run_send_is_not_read_again(tmp_path, trial, monkeypatch):
    store = Store(tmp_path)
    sent = [pickle.dumps(store.write_all([replace(trial, seed=seed)])) for seed in range(4)]
    with monkeypatch.context() as patched:
        patched.setattr(trial_text, "read", pytest.fail)
        seen = module.Seen()
        for message in sent:
            seen.add(pickle.loads(message), trusted=True)
        merged = store.consolidate(seen).read_bytes()
    found = list(seen.trials.values())
    for own, other in zip(found, sorted(recorded(tmp_path), key=lambda one: one.seed), strict=True):
        assert_same(own, other)
    assert len({id(own.problem) for own in found}) == 1
    assert not any(own.solution.trajectory.breaks.flags.writeable for own in found)
    store.results.unlink()
    assert store.consolidate().read_bytes() == merged
    unknown = module.Seen()  # of an executor's worker: read, and judged
    monkeypatch.setattr(trial_text, "read", refused)
    with pytest.raises(OSError, match="read"):
        unknown.add(pickle.loads(sent[0]), trusted=False)


def refused(text):
    raise OSError("read")


def test_what_the_disk_refuses_does_not_take_those_before_it_along(tmp_path, trial, monkeypatch):
    write = Path.write_bytes
    trials = [replace(trial, seed=seed) for seed in range(4)]

    def full(path, data):
        if path.name.startswith(f".{trials[2].id}"):
            write(path, data[:1000])
            raise OSError(errno.ENOSPC, "No space left on device")
        write(path, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(StoreError, match=rf"{trials[2].id}\.json.*No space left on device"):
        Store(tmp_path).write_all(trials)
    assert files(tmp_path) == sorted(f"trials/{one.id}.json" for one in trials[:2])


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
    with pytest.raises(StoreError, match=rf"{other.id}\.json.*No space left on device"):
        results.write(other)
    with pytest.raises(StoreError, match="No space left on device"):
        results.write(trial)
    assert files(tmp_path) == [f"trials/{trial.id}.json"]
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
    assert re.search(r"\.(h5|json): cannot be written: File too large\n", done.stdout)
    assert done.stderr == ""
    assert len(files(tmp_path)) == 12
    assert len(read(tmp_path)) == 12


# --- the folder as index ---


def test_results_h5_holds_what_the_trial_files_hold(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    results.write(replace(trial, seed=4, message="other"))
    found = sorted(read(results.consolidate()), key=lambda own: own.id)
    for a, b in zip(found, read(tmp_path), strict=True):
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
    assert finished(results) == {failed.id}
    assert {t.id for t in results.read() if t.runs_again} == {absent.id, crashed.id}
    for found in (results.read(), read(results.consolidate()), read(tmp_path)):
        assert {t.status for t in found} == {Status.MISSING, Status.CRASHED, Status.FAILED}


def test_the_backend_s_answer_replaces_its_absence_and_is_never_replaced_by_it(tmp_path, trial):
    results = Store(tmp_path)
    results.write(absent_of(trial))
    results.write(trial)
    assert files(tmp_path) == [f"trials/{trial.id}.json"]
    results.write(absent_of(trial))  # a run elsewhere, without the backend, into this folder
    for found in (results.read(), read(results.consolidate())):
        assert [t.status for t in found] == [Status.SOLVED]
    assert finished(results) == {trial.id}


def test_what_another_run_finishes_meanwhile_is_not_restored(tmp_path, trial):
    results = Store(tmp_path)
    results.write(absent_of(trial))
    seen = results.seen()
    results.write(trial)
    results.restore(seen)
    assert files(tmp_path) == [f"trials/{trial.id}.json"]


def test_what_others_remove_or_change_is_written_again(tmp_path, trial):
    results = Store(tmp_path)
    removed = results.write(trial)
    changed = results.write(replace(trial, seed=4))
    texts = [removed.read_bytes(), changed.read_bytes()]
    seen = results.seen()
    removed.unlink()
    changed.write_bytes(texts[0])
    with pytest.warns(DamagedFile, match="removed or changed 2 trials during the run; they are"):
        results.restore(seen)
    assert [removed.read_bytes(), changed.read_bytes()] == texts


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
    assert finished(results) == {other.id}
    assert trial.id not in finished(results)
    words = rf"{trial.id}\.json: damaged.*; running its comparison again replaces it"
    for reading in (lambda: read(results.consolidate()), results.read, lambda: read(tmp_path)):
        with pytest.warns(DamagedFile, match=words):
            assert [t.id for t in reading()] == [other.id]
    with pytest.raises(StoreError, match=words):
        read(results.path(trial.id))


def test_a_flipped_bit_is_found_when_the_file_is_read(tmp_path, trial):
    results = Store(tmp_path)
    path = results.write(trial)
    rng = np.random.default_rng(0)
    data = path.read_bytes()
    for place in rng.integers(len(data), size=60):
        broken = bytearray(data)
        broken[place] ^= 1 << int(rng.integers(8))
        path.write_bytes(broken)
        with pytest.warns(DamagedFile, match="checksum|start"):
            assert results.read() == []


def test_what_is_damaged_is_listed_beside_what_was_read(tmp_path, trial):
    results = Store(tmp_path)
    found = []
    damaged(results.write(trial), "one bit")
    results.write(replace(trial, seed=4))
    (back,) = recorded(tmp_path, found.append)
    assert back.seed == 4
    (error,) = found
    assert error.path == results.path(trial.id)


def test_many_damaged_files_are_one_line(tmp_path, trial):
    results = Store(tmp_path)
    results.write(trial)
    for number in range(30):
        results.path(f"{number:020x}").write_bytes(b"junk")
    words = rf"trials: 30 files are left out; the first, .*{0:020x}\.json: damaged"
    for reading in (results.read, lambda: read(tmp_path), results.consolidate):
        with pytest.warns(DamagedFile, match=words) as warned:
            reading()
        assert len(warned) == 1


def pipe(place):
    os.mkfifo(place)


def device(place):
    place.symlink_to("/dev/zero")


def folder_instead(place):
    place.mkdir()


def broken_link(place):
    place.symlink_to("nowhere")


def of_another_version(place):
    head = b'{\n"schema": "trajopt-5",\n"sha256": "' + b"0" * 64 + b'",\n'
    place.write_bytes(head + f'"id": "{place.stem}",\n'.encode())


def of_an_old_layout(place):
    place.with_suffix(".h5").write_bytes(b"HDF5")


@pytest.mark.skipif(os.name != "posix", reason="pipes and devices of this kind are POSIX's")
@pytest.mark.parametrize(
    ("bad", "words"),
    [
        (pipe, "it is a pipe"),
        (device, "it is a pipe, a socket or a device"),
        (folder_instead, "Is a directory"),
        (broken_link, "no such file"),
        (of_another_version, "written by another version of trajopt"),
        (of_an_old_layout, ""),
    ],
)
def test_one_bad_file_is_left_out_and_named_and_blocks_no_other(tmp_path, trial, bad, words):
    results = Store(tmp_path)
    results.write(trial)
    bad(tmp_path / "trials" / f"{0:020x}.json")
    readers = [results.read, results.consolidate, lambda: read(tmp_path)]
    for reader in readers:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            reader()
        said = [str(warning.message) for warning in caught]
        assert len(said) == bool(words)
        assert all("0000.json" in line and words in line for line in said)
    assert finished(results) == {trial.id}
    assert [own.id for own in read(tmp_path / "results.h5")] == [trial.id]


def test_a_trial_under_another_s_name_is_not_finished(tmp_path, trial):
    results = Store(tmp_path)
    other = replace(trial, seed=4)
    content = results.write(trial).read_bytes()
    results.write(other).write_bytes(content)
    assert finished(results) == {trial.id}


ANOTHER = "written by another version of trajopt; run again into another folder"


def older_trial(folder):
    (folder / "trials").mkdir()
    (folder / "trials" / f"{0:020x}.h5").write_bytes(b"HDF5")


def older_results(folder):
    seal = b"trajopt3" + bytes(32)
    (folder / "results.h5").write_bytes(b"HDF5" + seal)


def newer_trial(folder):
    text = b'{\n"schema": "trajopt-5",\n"sha256": "' + b"0" * 64 + b'",\n'
    (folder / "trials").mkdir()
    name = f"{0:020x}"
    (folder / "trials" / f"{name}.json").write_bytes(text + f'"id": "{name}",\n'.encode())


@pytest.mark.parametrize("fill", [older_trial, older_results, newer_trial])
def test_a_folder_of_another_version_is_refused_in_words_and_left_as_it_is(tmp_path, fill):
    fill(tmp_path)
    before = files(tmp_path)
    results = Store(tmp_path)
    with pytest.raises(StoreError, match=ANOTHER):
        finished(results)
    with pytest.raises(StoreError):
        read(tmp_path)
    assert files(tmp_path) == before


def test_results_of_another_version_are_refused_too(tmp_path):
    older_results(tmp_path)
    with pytest.raises(StoreError, match=rf"results\.h5: {ANOTHER}"):
        read(tmp_path / "results.h5")


@pytest.mark.parametrize("name", ["nothing", "nothing.h5", "."])
def test_a_path_without_results_is_a_store_error_naming_it(tmp_path, name):
    with pytest.raises(StoreError, match=re.escape(str(tmp_path / name))):
        read(tmp_path / name)


def test_hdf5_of_something_else_is_a_store_error(tmp_path):
    with h5py.File(tmp_path / "x.h5", "w") as file:
        file["x"] = 1
    with pytest.raises(StoreError, match=r"x\.h5"):
        read(tmp_path / "x.h5")


# --- other runs ---


def temporary(folder, host, process, age):
    path = folder / f".x~{host}~{process}~0123.tmp"
    path.write_bytes(b"half")
    os.utime(path, (time.time() - age,) * 2)
    return path


def test_litter_of_killed_runs_is_removed_and_live_ones_keep_theirs(tmp_path, trial):
    results = Store(tmp_path)
    here = platform.node()
    results.write(trial)
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    cases = [
        (here, gone.pid, 120, False),
        (here, gone.pid, 5, True),
        (here, os.getpid(), 3600, True),
        (here, 1, 3600, True),
        ("elsewhere", gone.pid, 3600, True),
        ("elsewhere", os.getpid(), 90_000, False),
    ]
    for folder in (tmp_path, tmp_path / "trials"):
        for host, process, age, stays in cases:
            path = temporary(folder, host, process, age)
            results.consolidate()
            assert path.exists() == stays
            path.unlink(missing_ok=True)
        strange = folder / ".strange.tmp"
        strange.write_text("")
        hour_ago = time.time() - 3600
        os.utime(strange, (hour_ago, hour_ago))
        results.consolidate()
        assert strange.exists()


def test_results_are_rebuilt_when_another_run_finished_meanwhile(tmp_path, trial, monkeypatch):
    results = Store(tmp_path)
    other = replace(trial, seed=4)
    results.write(trial)
    content = results_file.content
    turns = []

    def interrupted(*given):
        data = content(*given)
        if not turns:
            turns.append(1)
            results.write(other)
            Store(tmp_path).consolidate()
        return data

    monkeypatch.setattr(results_file, "content", interrupted)
    results.consolidate()
    assert {t.id for t in read(results.results)} == {trial.id, other.id}


def test_a_trial_that_another_run_finishes_meanwhile_is_read(tmp_path, trial, monkeypatch):
    results = Store(tmp_path)
    listed = module._trial_files
    results.write(absent_of(trial))

    def then_finished(folder):
        found = listed(folder)
        results.write(trial)
        return found

    monkeypatch.setattr(module, "_trial_files", then_finished)
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
    rng = np.random.default_rng(1)
    promised = set()
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
        assert promised <= finished(Store(tmp_path))
        assert promised <= {t.id for t in read(tmp_path)}
    assert promised <= {t.id for t in read(Store(tmp_path).consolidate())}
