"""A disk that is really full: a small tmpfs, where the tests may mount one (as root, on Linux)."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from trajopt import StoreError
from trajopt import comparison as run
from trajopt.benchmark.store import folder as store
from trajopt.benchmark.suites import catalogue as suite
from trajopt.planners.registry import load

PROBLEMS = [suite.load("one-joint"), suite.load("reversal")]
PLANNERS = [(name, load(name)) for name in ("unoptimised", "ruckig-stop")]
PLANNERS.append(("pso", load("pso:iterations=20")))
TRIALS = 2 * (1 + 1 + 8)  # the reference is recorded


def mount(place: Path, options: str) -> bool:
    command = ["mount", "-t", "tmpfs", "-o", options, "tmpfs", str(place)]
    try:
        return subprocess.run(command, capture_output=True, check=False).returncode == 0
    except OSError:
        return False


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    """An empty disk of 64 KB."""
    if not mount(tmp_path, "size=64k"):
        pytest.skip("may not mount a tmpfs")
    yield tmp_path
    subprocess.run(["umount", "--lazy", str(tmp_path)], check=True)


def compared(folder: Path) -> list[str]:
    results = run.compare(PROBLEMS, PLANNERS, folder, seeds=8, jobs=1)
    return sorted(t.id for t in results.items)


def test_a_full_disk_is_said_keeps_what_is_finished_and_the_run_goes_on(disk: Path) -> None:
    """One temporary file may stay: that of a worker which is killed as it writes.

    What a live run may be writing cannot be told from it for a minute. Then the next run removes it
    (`atomic.sweep`); here it is made older.
    """
    folder = disk / "results"
    with pytest.raises(StoreError, match=r"cannot be written: No space left on device"):
        compared(folder)
    kept = {t.id for t in store.read(folder)}  # a torn file would be a warning, an error here
    assert 0 < len(kept) < TRIALS
    left = list(folder.rglob(".*.tmp"))
    assert len(left) <= 1
    minutes_ago = time.time() - 120
    for file in left:
        os.utime(file, (minutes_ago, minutes_ago))
    before = {file: file.stat().st_mtime_ns for file in folder.glob("trials/*.json")}
    assert mount(disk, "remount,size=20m")
    found = compared(folder)
    assert len(found) == TRIALS
    assert kept < set(found)
    assert not list(folder.rglob(".*.tmp"))
    assert {file: file.stat().st_mtime_ns for file in before} == before


def test_no_room_for_the_results_loses_no_trial_and_no_older_results(disk: Path) -> None:
    assert mount(disk, "remount,size=20m")
    found = compared(disk / "results")
    results = store.Store(disk / "results")
    old = results.results.read_bytes()
    (disk / "filler").write_bytes(bytes(shutil.disk_usage(disk).free))
    with pytest.raises(StoreError, match=r"results\.h5: cannot be written: No space left"):
        results.consolidate()
    assert results.results.read_bytes() == old
    assert sorted(t.id for t in store.read(disk / "results")) == found


def test_a_disk_that_may_only_be_read_is_said_and_is_reported(disk: Path) -> None:
    """Also where results.h5 is not of its trials, so that `report` would make it anew."""
    assert mount(disk, "remount,size=20m")
    folder = disk / "results"
    run.compare(PROBLEMS[:1], PLANNERS[:2], folder)
    (folder / "results.h5").unlink()
    assert mount(disk, "remount,ro")
    with pytest.raises(StoreError, match=r"/unfinished: cannot be written: Read-only file system"):
        compared(folder)
    refused = r"results\.h5: cannot be written: Read-only file system"
    with pytest.raises(StoreError, match=refused):
        store.Store(folder).refresh()
    assert len(store.read(folder)) == 2
