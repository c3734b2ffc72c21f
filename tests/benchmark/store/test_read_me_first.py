"""Read me first: a trial is a sealed text; a folder holds texts and `results.h5`."""

import json

import h5py
import numpy as np
from trials import assert_same, solved

from trajopt.benchmark.store import trial_text
from trajopt.benchmark.store.folder import Store, read
from trajopt.benchmark.store.recheck import verification


def test_a_trial_is_one_json_text_that_reads_back_bit_for_bit():
    trial = solved()
    text = trial_text.write(trial)
    stated = json.loads(text)
    assert stated["planner"] == "stopping"
    assert stated["solution"]["trajectory"]["breaks"] == [0.0, 0.5, 1.0, 1.5]
    assert_same(trial_text.read(text), trial)


def test_a_folder_holds_a_text_per_trial_and_results_h5_for_everybody(tmp_path):
    store = Store(tmp_path)
    trial = solved()
    path = store.write(trial)
    assert path == tmp_path / "trials" / f"{trial.id}.json"
    store.consolidate()
    with h5py.File(tmp_path / "results.h5") as file:
        durations = file["trials/certified_duration"]
        assert durations.attrs["units"] == "s"
        np.testing.assert_array_equal(durations, [trial.certified_duration])
    for place in (tmp_path, tmp_path / "results.h5", path):
        (back,) = read(place)
        assert_same(back, trial)


def test_whoever_gets_a_file_can_have_everything_computed_again(tmp_path):
    store = Store(tmp_path)
    store.write(solved())
    assert verification(store.consolidate()).holds
