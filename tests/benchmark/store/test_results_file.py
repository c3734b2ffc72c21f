"""results.h5: what people find in it with plain h5py, and the trials' texts."""

import json
import re
import shutil
import textwrap
import time
import zlib
from dataclasses import replace

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.interpolate import PPoly
from trials import Stopping, assert_same, solved

from trajopt import Limits, Problem, Solution, Status, StoreError
from trajopt.benchmark.store import layout, results_file, trial_text
from trajopt.benchmark.store.fields import FIELDS
from trajopt.benchmark.store.folder import Store, read, save
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.trial import trials_of

LIMITS = Limits([1.0], [2.0])
COLUMNS = (*FIELDS, *layout.ADDED_FIELDS)
SMALL = Problem([[0.0], [1.0]], LIMITS, "small")


def kinds():
    """Sizes that differ, a failure without arrays, stats that only some have."""
    a = solved()
    (b,) = trials_of(Stopping(0.25), SMALL, [5], "stopping")
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
    assert set(file["trials"]) == {field.name for field in COLUMNS}
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
    for field in COLUMNS:
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
    names = {"h5py": h5py, "np": np, "PPoly": PPoly}
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
        columns[name] = data.asstr()[()] if data.dtype.kind == "O" else data[()]
    counts = pd.DataFrame(columns).groupby("problem")["certified_duration"].count()
    assert counts.to_dict() == {"Gelenk-Prüfung ①": 3, "small": 1}


@pytest.mark.parametrize("engine", [{"engine": "h5netcdf", "phony_dims": "sort"}])
def test_xarray_opens_the_table_and_a_run(path, trials, engine):
    with xr.open_dataset(path, group="trials", **engine) as table:
        assert table.sizes == {"id": len(trials)}
        place = str(table["path"].values[list(table["id"].values).index(solved().id)])
    with xr.open_dataset(path, group=f"{place}/trajectory", **engine) as motion:
        np.testing.assert_array_equal(motion["breaks"], solved().solution.trajectory.breaks)
        assert motion["breaks"].attrs["units"] == "s"


def test_every_dataset_has_a_unit_and_texts_are_utf_8(file):
    numbers = []

    def check(name, place):
        if isinstance(place, h5py.Dataset):
            assert isinstance(place.attrs["units"], str), name
            kind = h5py.check_string_dtype(place.dtype)
            assert kind is None or kind.encoding == "utf-8", name
            numbers.append(name)

    file.visititems(check)
    assert len(numbers) > len(FIELDS)


def test_problems_have_waypoints_and_limits_in_si_units(file):
    problem = file["problems/Gelenk-Prüfung ①"]
    assert problem.attrs["joint_names"].tolist() == ["joint 1", "joint 2"]
    np.testing.assert_array_equal(problem["waypoints"], solved().problem.waypoints)
    assert set(problem["limits"]) == {"velocity", "acceleration", "position"}
    assert problem["limits/velocity"][()].tolist() == [[-1.0, 1.0], [-2.0, 1.5]]
    assert problem["limits/position"][()].tolist() == [[-2.0, 2.5], [-np.inf, np.inf]]
    units = {name: data.attrs["units"] for name, data in problem["limits"].items()}
    assert units == {"velocity": "rad/s", "acceleration": "rad/s^2", "position": "rad"}


def test_a_run_has_its_verdict_its_motion_its_search_and_its_uses_of_the_limits(file):
    """Joint 1 travels 1.0 in 0.5 s: peaks 15/8·2 of 1 and 10/√3·4 of 2, at 1/2 and 1/2 ± √3/6."""
    run = file["runs/Gelenk-Prüfung ①/stopping:segment_time=0.5/3"]
    dilation = max(15 / 8 * 2, np.sqrt(10 / np.sqrt(3) * 4 / 2))
    assert run.attrs["status"] == "solved"
    assert run.attrs["dilation"] == pytest.approx(dilation, rel=1e-12)
    assert run.attrs["certified_duration"] == pytest.approx(1.5 * dilation, rel=1e-12)
    assert "certified_duration: s" in run.attrs["units"].splitlines()
    expected = solved().solution.trajectory
    for name, data in run["trajectory"].items():
        np.testing.assert_array_equal(data, getattr(expected, name))
    assert set(run["trajectory"]) == {"breaks", "coefficients", "lengths", "waypoint_times"}

    assert run["history/evaluations"][()].tolist() == [1.0, 4.0, 7.0, 7.0]
    durations = run["history/duration"][()]
    claims = np.array([np.nan, 1.5 * 1.5, 1.5, 1.5])
    np.testing.assert_allclose(durations, claims * dilation, rtol=1e-12)

    uses = run["uses"]
    assert uses["limit"].asstr()[()].tolist() == ["velocity", "acceleration"]
    assert uses["joint"][()].tolist() == [1, 1]
    np.testing.assert_allclose(uses["value"], [15 / 8 * 2, 10 / np.sqrt(3) * 4 / 2], rtol=1e-12)
    assert uses["time"][0] == pytest.approx(0.25)
    assert abs(uses["time"][1] - 0.25) == pytest.approx(np.sqrt(3) / 6 * 0.5)


def test_a_run_without_a_motion_has_its_verdict_alone(file):
    run = file["runs/Gelenk-Prüfung ①/stopping:segment_time=0.5/4"]
    assert list(run) == []
    assert (run.attrs["status"], run.attrs["message"]) == ("failed", "no")
    assert np.isnan(run.attrs["certified_duration"])


def test_gaps_are_fractions_of_the_reference_that_is_given(tmp_path):
    """Rest to rest over 1 rad within 1 rad/s and 2 rad/s² takes 1 + 1/2 s."""
    (trial,) = trials_of(Stopping(3.0), SMALL, [0], "stopping")
    text = trial_text.write(trial)
    path = tmp_path / "x.h5"
    optimum = {SMALL.digest(): 1.5}
    path.write_bytes(results_file.content([trial], [text], lambda trials: optimum))
    with h5py.File(path) as file:
        assert file["trials/reference"][0] == 1.5
        assert file["trials/gap"][0] == pytest.approx(1.0, rel=1e-12)
        assert file["runs/small/stopping/0"].attrs["gap"] == file["trials/gap"][0]


# --- names ---


@pytest.mark.parametrize(
    "name", ["a/b", "../x", ".", "", "100 %", "%2F", "a\\b", "q[0]", "①", "x" * 200, "runs/#1"]
)
def test_a_run_of_any_name_is_where_its_path_says(tmp_path, name):
    (trial,) = trials_of(Stopping(), replace(SMALL, name=name), [5], f"./{name[:150]}.py:P")
    with h5py.File(save(tmp_path / "x.h5", trial)) as file:
        (path,) = file["trials/path"].asstr()[()]
        assert path.count("/") == 4
        assert file[path].attrs["id"] == trial.id
        problem = file[path.replace("/runs/", "/problems/").rsplit("/", 2)[0]]
        assert problem.attrs["name"] == name
        np.testing.assert_array_equal(problem["waypoints"], SMALL.waypoints)


def test_names_that_differ_have_groups_that_differ():
    names = ["", ".", "%2E", "a/b", "a%2Fb", "a%252Fb", "#", "%"]
    assert len({layout.escaped(name) for name in names}) == len(names)


def test_the_version_that_ran_last_has_the_plain_seed_for_a_name():
    new = replace(solved(), started="2026-02-01T00:00:00+00:00")
    old = replace(
        new, provenance={**new.provenance, "planner_digest": "old"}, started="2026-01-01T00:00:00Z"
    )
    plain = "/runs/Gelenk-Prüfung ①/stopping:segment_time=0.5/3"
    assert layout.paths([old, new]) == [f"{plain}#{old.id}", plain]
    assert layout.paths([new, old]) == [plain, f"{plain}#{old.id}"]
    asked = replace(old, asked="2026-03-01T00:00:00+00:00")
    assert layout.paths([asked, new]) == [plain, f"{plain}#{new.id}"]


def test_two_problems_of_one_name_have_a_group_each(tmp_path):
    other = Problem([[0.0], [2.0]], LIMITS, "small")
    trials = [trials_of(Stopping(), problem, [0], "stopping")[0] for problem in (SMALL, other)]
    store = Store(tmp_path)
    store.write_all(trials)
    with h5py.File(store.consolidate()) as file:
        ends = sorted(problem["waypoints"][-1, 0] for problem in file["problems"].values())
        assert ends == [1.0, 2.0]
        for trial_id, path in zip(file["trials/id"], file["trials/path"], strict=True):
            assert file[path].attrs["id"] == trial_id.decode()


# --- what the texts do not give ---


def no_references(trials):
    return {}


RUN = "runs/Gelenk-Prüfung ①/stopping:segment_time=0.5/3"


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda f: f[RUN].attrs.modify("certified_duration", 1.0), f"/{RUN}: certified_duration"),
        (lambda f: f[RUN].attrs.modify("status", "proved"), f"/{RUN}: status"),
        (lambda f: f[RUN].attrs.create("status", np.zeros((9, 9))), f"/{RUN}: status"),
        (lambda f: f[f"{RUN}/uses"].attrs.create("x", 1), None),
        (lambda f: f[f"{RUN}/trajectory/breaks"].__setitem__(1, 0.4), f"/{RUN}/trajectory/breaks"),
        (
            lambda f: f[f"{RUN}/trajectory/breaks"].attrs.modify("units", "ms"),
            f"/{RUN}/trajectory/breaks",
        ),
        (lambda f: f[f"{RUN}/uses/limit"].__setitem__(0, "jerk"), f"/{RUN}/uses/limit"),
        (lambda f: f["trials/gap"].__setitem__(2, 0.0), "/trials/gap"),
        (lambda f: f["trials/label"].__setitem__(2, "mine"), "/trials/label"),
        (lambda f: f.__delitem__("problems/small"), "/problems/small"),
        (lambda f: f.create_group("runs/small/mine"), "/runs/small/mine"),
        (lambda f: f.__setitem__("more", 1.0), "/more"),
        (lambda f: f.move(f"{RUN}/uses/value", f"{RUN}/uses/time2"), f"/{RUN}/uses/time2"),
        (
            lambda f: (
                f.__delitem__(f"{RUN}/uses/value"),
                f.__setitem__(f"{RUN}/uses/value", h5py.SoftLink(f"/{RUN}/uses/time")),
            ),
            f"/{RUN}/uses/value",
        ),
        (
            lambda f: (
                f.__delitem__("trials/gap"),
                f.create_dataset(
                    "trials/gap", data=np.ones(5), chunks=(1 << 20,), maxshape=(None,)
                ),
            ),
            "/trials/gap",
        ),
    ],
)
def test_verification_names_what_the_texts_do_not_give(path, tmp_path, change, named):
    copy = tmp_path / "results.h5"
    shutil.copy(path, copy)
    assert verification(copy, no_references).misstated == ()
    with h5py.File(copy, "r+") as file:
        change(file)
    copy.write_bytes(results_file.sealed(copy.read_bytes()))
    found = verification(copy, no_references)
    assert named in (found.misstated or (None,))
    assert found.holds == (named is None)
    assert named is None or named in found.summary()[-1]


def test_a_file_of_version_0_2_is_verified_by_its_texts_alone(path, tmp_path):
    copy = tmp_path / "results.h5"
    shutil.copy(path, copy)
    with h5py.File(copy, "r+") as file:
        for name in ("runs", "problems", "trials/path"):
            del file[name]
    copy.write_bytes(results_file.sealed(copy.read_bytes()))
    assert verification(copy, no_references).holds


def test_texts_of_another_type_and_links_elsewhere_are_not_followed(path, tmp_path):
    copy = tmp_path / "results.h5"
    secret = tmp_path / "secret.h5"
    shutil.copy(path, copy)
    with h5py.File(secret, "w") as file:
        file["label"] = ["mine"] * 5
    with h5py.File(copy, "r+") as file:
        for name in ("label", "planner", "problem"):
            del file[f"trials/{name}"]
        file["trials/label"] = h5py.ExternalLink(str(secret), "/label")
        file["trials/planner"] = np.array([b"mine"] * 5)
        kind = h5py.vlen_dtype(np.float64)
        file.create_dataset("trials/problem", shape=(5,), dtype=kind)
        for name in ("planner", "problem"):
            file[f"trials/{name}"].attrs["units"] = ""
    copy.write_bytes(results_file.sealed(copy.read_bytes()))
    named = {"/trials/label", "/trials/planner", "/trials/problem"}
    assert named <= set(verification(copy, no_references).misstated)


def test_a_folder_is_verified_with_its_results_file(path, tmp_path):
    folder = tmp_path / "folder"
    shutil.copytree(path.parent, folder)
    with h5py.File(folder / "results.h5", "r+") as file:
        file["trials/seed"][0] = 99
    whole = (folder / "results.h5").read_bytes()
    (folder / "results.h5").write_bytes(results_file.sealed(whole))
    assert verification(folder, no_references).misstated == ("/trials/seed",)


def test_a_thousand_trials_take_little_room(tmp_path):
    """30 pieces of 6 joints and a history of 300 rows: 11 kB of numbers, in the text and beside."""
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
    assert store.consolidate().stat().st_size / 100 < 30_000


def test_no_trials_are_a_file_too(tmp_path):
    path = tmp_path / "x.h5"
    path.write_bytes(results_file.content([], []))
    assert read(path) == []


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
