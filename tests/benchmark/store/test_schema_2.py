"""A folder that the release before this one wrote loses nothing."""

import shutil
import tarfile
from pathlib import Path

import numpy as np
import pytest
from trials import assert_same

from trajopt import Status
from trajopt.benchmark.store.folder import Store, read
from trajopt.benchmark.store.verification import verification
from trajopt.benchmark.suites import catalogue
from trajopt.comparison import compare
from trajopt.planners.registry import named

ARCHIVE = Path(__file__).with_name("schema2.tar.xz")


@pytest.fixture
def folder(tmp_path):
    with tarfile.open(ARCHIVE) as archive:
        archive.extractall(tmp_path, filter="data")
    return tmp_path / "schema2"


def test_every_trial_is_read_from_both_kinds_of_files(folder):
    trials = read(folder)
    by_planner = {t.planner: t for t in trials}
    assert by_planner.keys() == {"exact", "pso", "certify", "toppra"}
    assert by_planner["exact"].certified_duration == pytest.approx(2.0, rel=1e-9)  # 1.5/1 + 1/2
    assert by_planner["certify"].lower_bound == pytest.approx(2.0, rel=1e-4)
    assert by_planner["toppra"].status is Status.MISSING
    assert by_planner["pso"].options["population"] == 5
    assert by_planner["pso"].solution.history.shape[1] == 2
    assert by_planner["pso"].provenance["numpy"] == "2.4.6"
    for one, other in zip(trials, read(folder / "results.h5"), strict=True):
        assert_same(one, other)


def test_its_trials_are_finished_and_hold(folder):
    assert len(Store(folder).finished()) == 3
    found = verification(folder)
    assert found.holds, [t.differences for t in found.trials]
    assert len(found.trials) == 4


def test_compare_goes_on_in_it_and_keeps_what_is_there(folder):
    before = {f.name: f.read_bytes() for f in (folder / "trials").iterdir()}
    old = read(folder)
    results = compare([catalogue.load("one-joint")], [named("ruckig-stop")], folder, jobs=0)
    assert {t.planner for t in results.items} >= {"ruckig-stop"}
    after = {f.name: f.read_bytes() for f in (folder / "trials").iterdir()}
    assert before.items() <= after.items()
    stored = {(t.planner, t.label, t.started): t for t in read(folder / "results.h5")}
    for trial in old:
        assert_same(stored[trial.planner, trial.label, trial.started], trial)


def test_a_flipped_bit_in_an_old_trial_file_is_still_found(folder):
    path = sorted((folder / "trials").glob("*.h5"))[0]
    whole = path.read_bytes()
    for place in np.random.default_rng(0).integers(len(whole) - 16, size=20):
        broken = bytearray(whole)
        broken[place] ^= 1
        path.write_bytes(broken)
        with pytest.warns(UserWarning, match="checksum"):
            assert len(read(folder)) == 3


def test_an_old_results_file_alone_is_enough(folder):
    shutil.rmtree(folder / "trials")
    assert len(verification(folder / "results.h5").trials) == 4
