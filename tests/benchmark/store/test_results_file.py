"""results.h5: a dataset per field, described, readable with plain h5py, and the trials' texts."""

import json
import re
import textwrap
import time
import zlib
from dataclasses import replace

import h5py
import numpy as np
import pandas as pd
import pytest
from scipy.interpolate import PPoly
from trials import Stopping, assert_same, solved

from trajopt import Limits, Problem, Solution, Status, StoreError
from trajopt.benchmark.store import results_file, trial_text
from trajopt.benchmark.store.fields import FIELDS
from trajopt.benchmark.store.folder import Store, read, save
from trajopt.benchmark.trial import judge

LIMITS = Limits([1.0], [2.0])
SMALL = Problem([[0.0], [1.0]], LIMITS, "small")


def kinds():
    """Sizes that differ, a failure without arrays, stats that only some have."""
    a = solved()
    (b,) = judge(Stopping(0.25), SMALL, [5], "stopping")
    failed = Solution(Status.FAILED, message="no")
    bare = replace(a, seed=4, status=Status.FAILED, solution=failed)
    bare = replace(bare, message="no", certificate=None, setup_time=0.0)
    stats = {"times": np.ones((2, 2)), "more": np.arange(5.0), "kind": 3}
    odd = replace(a.solution, stats=stats, history=np.zeros((0, 2)))
    odd = replace(a, seed=6, solution=odd)
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
    assert set(file["trials"]) == {field.name for field in FIELDS}
    assert file["trials/seed"][()].tolist() == [t.seed for t in own]
    assert file["trials/problem"].asstr()[()].tolist() == [t.problem.name for t in own]
    options = [json.loads(text) for text in file["trials/options"].asstr()[()]]
    assert options == [t.options for t in own]
    durations = np.array([t.certified_duration for t in own], dtype=float)
    np.testing.assert_array_equal(file["trials/certified_duration"], durations)
    bare = ids.index(kinds()[0].id)
    assert np.isnan(file["trials/evaluations"][bare])


def test_the_certified_duration_in_the_file_is_the_closed_form(file):
    # joint 1 travels 1.0 in 0.5 s: velocity 15/8·1/0.5 of 1, acceleration 10/√3·1/0.25 of 2
    dilation = max(15 / 8 / 0.5 / 1.0, np.sqrt(10 / np.sqrt(3) / 0.25 / 2.0))
    (i,) = np.flatnonzero(file["trials/seed"][()] == 3)
    assert file["trials/claimed_duration"][i] == 1.5
    assert file["trials/dilation"][i] == pytest.approx(dilation, rel=1e-12)
    assert file["trials/certified_duration"][i] == pytest.approx(1.5 * dilation, rel=1e-12)
    assert file["trials/feasible"][i] == 0


def test_every_dataset_documents_itself_and_has_its_scale(file):
    for field in FIELDS:
        data = file[f"trials/{field.name}"]
        assert data.attrs["units"] == field.unit
        assert data.attrs["description"] == field.meaning
        if field.name == "id":
            assert data.is_scale
        else:
            (scale,) = data.dims[0].values()
            assert scale.name == "/trials/id"
    assert "JSON" in file["texts"].attrs["description"]


def test_the_example_of_the_docstring_reads_the_fastest_trajectory(path, trials):
    (code,) = re.findall(r"(?s)plain h5py:\n\n(.*?)\n\n", results_file.__doc__)
    names = {"h5py": h5py, "np": np, "PPoly": PPoly, "json": json}
    exec(textwrap.dedent(code).replace("results/results.h5", str(path)), names)
    certified = [t for t in trials.values() if t.certified_duration]
    fastest = min(certified, key=lambda t: t.certified_duration)
    expected = fastest.solution.trajectory
    times = np.linspace(0, fastest.claimed_duration, 50)
    for order in range(3):
        found = names["fastest"](times, nu=order)
        np.testing.assert_allclose(found, expected(times, order), atol=1e-9)
    assert fastest.problem.name == "small"


def test_pandas_reads_the_columns(file):
    columns = {}
    for name, data in file["trials"].items():
        columns[name] = data.asstr()[()] if data.dtype.kind == "S" else data[()]
    counts = pd.DataFrame(columns).groupby("problem")["certified_duration"].count()
    assert counts.to_dict() == {"Gelenk-Prüfung ①": 3, "small": 1}


def test_no_trials_are_a_file_too(tmp_path):
    path = tmp_path / "x.h5"
    path.write_bytes(results_file.content([], []))
    assert read(path) == []


def test_a_text_much_longer_than_the_others_does_not_fill_the_file(tmp_path, monkeypatch):
    monkeypatch.setattr(results_file, "_PADDED_BYTES", 100)
    monkeypatch.setattr(results_file, "_PADDED_RATIO", 1)
    long = "ß" * 300
    store = Store(tmp_path)
    failed = Solution(Status.FAILED, message=long)
    lost = replace(solved(), status=Status.FAILED, message=long, solution=failed, certificate=None)
    store.write_all([lost, replace(solved(), seed=9)])
    with h5py.File(store.consolidate()) as file:
        assert sorted(file["trials/message"].asstr()[()]) == ["", long]


def test_a_thousand_trials_take_little_room(tmp_path):
    """30 pieces of 6 joints and a history of 300 rows: 11 kB of numbers alone."""
    rng = np.random.default_rng(0)
    base = solved()
    store = Store(tmp_path)
    trials = []
    for seed in range(100):
        steps = np.arange(1, 301) * 30.0
        durations = 1 + np.sort(rng.random(300))[::-1]
        stats = {"coefficients": rng.normal(size=(3, 30, 6))}
        history = np.stack([steps, durations], axis=1)
        solution = replace(base.solution, stats=stats, history=history)
        trials.append(replace(base, seed=seed, solution=solution))
    store.write_all(trials)
    assert store.consolidate().stat().st_size / 100 < 12_000


def test_zeros_that_compress_well_are_read_back(tmp_path):
    zeros = np.zeros(1_000_000)
    trial = solved()
    solution = replace(trial.solution, stats={"zeros": zeros})
    (back,) = read(save(tmp_path / "x.h5", replace(trial, solution=solution)))
    np.testing.assert_array_equal(back.solution.stats["zeros"], zeros)


# --- damage and forgery ---


def test_every_reader_refuses_a_results_file_with_one_changed_byte(path, tmp_path):
    whole = path.read_bytes()
    places = np.random.default_rng(0).integers(len(whole), size=40)
    copy = tmp_path / "results.h5"
    for place in places:
        broken = bytearray(whole)
        broken[place] ^= 1 << int(place % 8)
        copy.write_bytes(broken)
        with pytest.raises(StoreError, match=r"results\.h5: damaged"):
            read(copy)


CHUNK = 1 << 18


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ({"data": np.zeros(4, np.uint8)}, "deflated chunks"),
        ({"shape": (4,), "dtype": "f8", "chunks": (CHUNK,), "maxshape": (None,)}, "bytes"),
        ({"shape": (4,), "dtype": "u1", "external": [("secret", 0, 4)]}, "deflated chunks"),
        ({"shape": (1 << 40,), "dtype": "u1", "chunks": (CHUNK,), "compression": 1}, "."),
    ],
)
def test_texts_that_lie_elsewhere_or_are_no_bytes_are_refused(tmp_path, what, words):
    path = save(tmp_path / "x.h5", solved())
    with h5py.File(path, "r+") as file:
        del file["texts"]
        file.create_dataset("texts", **what)
    path.write_bytes(results_file.sealed(path.read_bytes()))
    with pytest.raises(StoreError, match=words):
        read(path)


def test_a_chunk_that_inflates_beyond_its_size_is_refused(tmp_path):
    path = save(tmp_path / "x.h5", solved())
    with h5py.File(path, "r+") as file:
        stored = zlib.compress(bytes(2 * CHUNK))
        file["texts"].id.write_direct_chunk((0,), stored)
    path.write_bytes(results_file.sealed(path.read_bytes()))
    with pytest.raises(StoreError, match="a chunk that is not of its size"):
        read(path)


def test_links_are_never_followed(tmp_path):
    path = save(tmp_path / "x.h5", solved())
    with h5py.File(path, "r+") as file:
        file.move("texts", "moved")
        file["texts"] = h5py.SoftLink("/moved")
    path.write_bytes(results_file.sealed(path.read_bytes()))
    with pytest.raises(StoreError, match="in this very file"):
        read(path)


def test_a_file_of_nothing_but_damaged_texts_is_refused_at_once(tmp_path):
    path = save(tmp_path / "x.h5", solved())
    with h5py.File(path, "r+") as file:
        texts = file["texts"]
        texts.resize((40 * CHUNK,))
        texts[...] = 0
    path.write_bytes(results_file.sealed(path.read_bytes()))
    with pytest.raises(StoreError, match="it does not start as a trial's text does"):
        read(path)


@pytest.mark.parametrize(
    ("repeated", "words"),
    [
        (b"\0", "it does not start as a trial's text does"),
        (trial_text.sealed({"id": "0" * 20, "problem": None}) + b"\0", "two of trial 0000"),
    ],
)
def test_millions_of_texts_in_a_small_file_are_refused_at_once(tmp_path, repeated, words):
    """Half a gigabyte that deflates to half a megabyte: to look at each text takes minutes."""
    path = save(tmp_path / "x.h5", solved())
    texts = repeated * (CHUNK // len(repeated) + 1)
    stored = zlib.compress(texts[:CHUNK])
    with h5py.File(path, "r+") as file:
        data = file["texts"]
        data.resize((2000 * CHUNK,))
        for start in range(0, 2000 * CHUNK, CHUNK):
            data.id.write_direct_chunk((start,), stored)
    path.write_bytes(results_file.sealed(path.read_bytes()))
    start = time.process_time()
    with pytest.raises(ValueError, match=words):
        list(results_file.read(path))
    assert time.process_time() - start < 2.0


def test_one_damaged_text_under_a_right_seal_refuses_the_file(tmp_path):
    texts = [trial_text.write(solved()), b"damaged"]
    path = tmp_path / "x.h5"
    path.write_bytes(results_file.content([solved()], texts))
    with pytest.raises(StoreError, match="it does not start as a trial's text does"):
        read(path)
