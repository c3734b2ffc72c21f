"""results.h5: what people find in it with plain h5py, and what `verify` finds in a forged one."""

import json
import re
import shutil
import textwrap
import tracemalloc
from dataclasses import replace

import h5py
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.interpolate import PPoly
from trials import Stopping, assert_same, edited, solved

from trajopt import Limits, Problem, Solution, Status, StoreError, Trajectory
from trajopt.benchmark.store import layout, results_file, trial_text
from trajopt.benchmark.store.folder import Store, read, rebuilt, save
from trajopt.benchmark.store.layout import COLUMNS, BestMotion
from trajopt.benchmark.store.recheck import verification
from trajopt.benchmark.trial import trials_of
from trajopt.judging.verification import certified

LIMITS = Limits([1.0], [2.0])
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


def motion_of(problem, row, name="certified"):
    """A motion as users read it, and its end."""
    own = problem[name]
    first, count = own["start"][row], own["count"][row]
    coefficients = own["coefficients"][:, first : first + count - 1]
    breaks = own["breaks"][first : first + count]
    return PPoly(coefficients, breaks), own["coefficients"][-1, first + count - 1]


def row_of(file, seed):
    (row,) = np.flatnonzero(file["trials/seed"][()] == seed)
    return row


def test_every_trial_comes_back_whatever_its_neighbours_are(path, trials):
    back = read(path)
    assert {t.id for t in back} == set(trials)
    for trial in back:
        assert_same(trial, trials[trial.id])


def test_columns_are_those_of_the_trials_by_problem_label_and_seed(file, trials):
    ids = file["trials/id"].asstr()[()].tolist()
    own = [trials[name] for name in ids]
    assert own == sorted(own, key=lambda t: (t.problem.name, t.label, t.seed, t.id))
    assert set(file["trials"]) == {field.name for field in COLUMNS}
    assert file["trials/seed"][()].tolist() == [t.seed for t in own]
    assert file["trials/problem"].asstr()[()].tolist() == [t.problem.name for t in own]
    options = [json.loads(text) for text in file["trials/options"].asstr()[()]]
    assert options == [t.options for t in own]
    durations = np.array([t.certified_duration for t in own], dtype=float)
    np.testing.assert_array_equal(file["trials/certified_duration"], durations)
    bare = ids.index(kinds()[0].id)
    assert np.isnan(file["trials/evaluations"][bare])
    texts = file["texts"][()]
    assert texts.tolist() == [trial_text.write(t) for t in own]
    codes = file["code/provenance"].asstr()[()]
    said = [json.loads(codes[code]) for code in file["trials/code"][()]]
    assert said == [t.provenance for t in own]


def test_the_certified_duration_in_the_file_is_the_closed_form(file):
    # joint 1 travels 1.0 in 0.5 s: velocity 15/8·1/0.5 of 1, acceleration 10/√3·1/0.25 of 2
    dilation = max(15 / 8 / 0.5 / 1.0, np.sqrt(10 / np.sqrt(3) / 0.25 / 2.0))
    i = row_of(file, 3)
    assert file["trials/claimed_duration"][i] == 1.5
    assert file["trials/dilation"][i] == pytest.approx(dilation, rel=1e-12)
    assert file["trials/certified_duration"][i] == pytest.approx(1.5 * dilation, rel=1e-12)
    assert file["trials/feasible"][i] == 0


def test_every_dataset_has_a_unit_and_a_meaning_and_texts_are_utf_8(file):
    for field in COLUMNS:
        data = file[f"trials/{field.name}"]
        assert data.attrs["units"] == field.unit
        assert data.attrs["description"] == field.meaning
    numbers = []

    def check(name, place):
        if isinstance(place, h5py.Dataset):
            assert isinstance(place.attrs["units"], str), name
            assert place.attrs["description"], name
            kind = h5py.check_string_dtype(place.dtype)
            assert kind is None or kind.encoding == "utf-8", name
            numbers.append(name)

    file.visititems(check)
    assert len(numbers) > len(COLUMNS)
    assert "JSON" in file["texts"].attrs["description"]


def test_the_example_of_the_docstring_reads_the_fastest_trajectory(path, trials):
    (code,) = re.findall(r"(?s)plain h5py:\n\n(.*?)\n\n", results_file.__doc__)
    names = {"h5py": h5py, "np": np, "PPoly": PPoly}
    exec(textwrap.dedent(code).replace("results/results.h5", str(path)), names)
    (fastest,) = (t for t in trials.values() if t.problem.name == "small")
    expected = certified(SMALL, fastest.solution.trajectory)
    times = np.linspace(0, fastest.certified_duration, 50)
    for order in range(3):
        found = names["fastest"](times, nu=order)
        np.testing.assert_allclose(found, expected(times, order), atol=1e-9)
    # 15/8 · 1 rad / 0.25 s is 7.5 times 1 rad/s; 10/√3 · 1 rad / (0.25 s)² is √46.2 times 2 rad/s²
    assert names["fastest"].x[-1] == pytest.approx(0.25 * 7.5, rel=1e-12)


def test_pandas_and_xarray_read_the_columns(path, file):
    columns = {}
    for name, data in file["trials"].items():
        columns[name] = data.asstr()[()] if data.dtype.kind == "O" else data[()]
    counts = pd.DataFrame(columns).groupby("problem")["certified_duration"].count()
    assert counts.to_dict() == {"Gelenk-Prüfung ①": 3, "small": 1}
    with xr.open_dataset(path, group="trials", engine="h5netcdf", phony_dims="sort") as table:
        np.testing.assert_array_equal(table["seed"], file["trials/seed"])
        assert table["certified_duration"].attrs["units"] == "s"


def test_problems_have_waypoints_and_limits_in_si_units(file):
    problem = file["problems/Gelenk-Prüfung ①"]
    assert problem.attrs["joint_names"].tolist() == ["joint 1", "joint 2"]
    assert problem.attrs["uses"].tolist() == ["velocity", "acceleration"]
    np.testing.assert_array_equal(problem["waypoints"], solved().problem.waypoints)
    assert set(problem["limits"]) == {"velocity", "acceleration", "position"}
    assert problem["limits/velocity"][()].tolist() == [[-1.0, 1.0], [-2.0, 1.5]]
    assert problem["limits/position"][()].tolist() == [[-2.0, 2.5], [-np.inf, np.inf]]
    units = {name: data.attrs["units"] for name, data in problem["limits"].items()}
    assert units == {"velocity": "rad/s", "acceleration": "rad/s^2", "position": "rad"}


@pytest.mark.parametrize("seed", [3, 8])
def test_a_row_has_its_motions_its_search_and_its_uses_of_the_limits(file, seed):
    """Joint 1 travels 1.0 in 0.5 s: peaks 15/8·2 of 1 and 10/√3·4 of 2, at 1/2 and 1/2 ± √3/6."""
    problem = file["problems/Gelenk-Prüfung ①"]
    row = file["trials/row"][row_of(file, seed)]
    dilation = max(15 / 8 * 2, np.sqrt(10 / np.sqrt(3) * 4 / 2))
    expected = solved().solution.trajectory
    claimed, end = motion_of(problem, row, "claimed")
    np.testing.assert_array_equal(claimed.c, expected.coefficients)
    np.testing.assert_array_equal(claimed.x, expected.breaks)
    np.testing.assert_allclose(end, [0.4, 0.1], rtol=1e-12)
    own, _ = motion_of(problem, row)
    times = np.linspace(0, 1.5, 40)
    np.testing.assert_allclose(own(dilation * times), expected(times), atol=1e-12)
    np.testing.assert_array_equal(problem["waypoint_times"][row], expected.waypoint_times)

    search = problem["history"]
    chosen = slice(search["start"][row], search["start"][row] + search["count"][row])
    assert search["evaluations"][chosen].tolist() == [1.0, 4.0, 7.0, 7.0]
    claims = np.array([np.nan, 1.5 * 1.5, 1.5, 1.5])
    np.testing.assert_allclose(search["duration"][chosen], claims * dilation, rtol=1e-12)

    uses = problem["uses"]
    assert uses["joint"][row].tolist() == [1, 1]
    ratios = [15 / 8 * 2, 10 / np.sqrt(3) * 4 / 2]
    np.testing.assert_allclose(uses["value"][row], ratios, rtol=1e-12)
    assert uses["time"][row, 0] == pytest.approx(0.25)
    assert abs(uses["time"][row, 1] - 0.25) == pytest.approx(np.sqrt(3) / 6 * 0.5)


def test_a_row_without_a_motion_has_its_verdict_alone(file):
    i = row_of(file, 4)
    problem, row = file["problems/Gelenk-Prüfung ①"], file["trials/row"][i]
    assert [problem[name]["count"][row] for name in ("certified", "claimed", "history")] == [0] * 3
    assert np.isnan(problem["waypoint_times"][row]).all()
    assert np.isnan(problem["uses/value"][row]).all()
    assert file["trials/status"].asstr()[i], file["trials/message"].asstr()[i] == ("failed", "no")
    assert np.isnan(file["trials/certified_duration"][i])


def test_motions_of_a_high_degree_are_in_their_text_alone(tmp_path):
    """A table has as many coefficients as its highest motion: one of degree 60 would be ten."""
    steep = np.zeros((61, 1, 1))
    steep[-4:-2, 0, 0] = [-2 / 27, 3 / 9]  # 1 rad within 3 s
    line = Trajectory([0.0, 3.0], steep, [0.0, 3.0])
    brief = Trajectory([0.0, 3.0], steep[-4:], [0.0, 3.0])
    high = Trajectory([0.0, 3.0], np.where(np.arange(61)[:, None, None] == 0, 1e-30, steep), [0, 3])
    base = solved()
    store = Store(tmp_path)
    for seed, motion in enumerate((line, brief, high)):
        (own,) = trials_of(Stopping(3.0), SMALL, [seed], "own")
        store.write(replace(own, solution=Solution(Status.SOLVED, motion), certificate=None))
    with h5py.File(store.consolidate()) as file:
        claimed = file["problems/small/claimed"]
        assert claimed["count"][()].tolist() == [0, 2, 0]
        assert claimed["coefficients"].shape == (4, 2, 1)
    assert base


def test_the_best_known_motion_and_bound_stand_beside_the_problem(tmp_path):
    """Rest to rest over 1 rad within 1 rad/s and 2 rad/s² takes 1 + 1/2 s."""
    (trial,) = trials_of(Stopping(3.0), SMALL, [0], "stopping")
    motion = trial.solution.trajectory
    optimum = {SMALL.digest(): BestMotion(1.5, "exact", 1.25, "exact, seed 0", motion)}
    content = rebuilt([trial_text.write(trial)], lambda trials: optimum)
    path = tmp_path / "x.h5"
    path.write_bytes(content)
    with h5py.File(path) as file:
        assert file["trials/reference"][0] == 1.5
        assert file["trials/gap"][0] == pytest.approx(1.0, rel=1e-12)
        best = file["problems/small/best"]
        assert (best.attrs["duration"], best.attrs["lower_bound"]) == (1.5, 1.25)
        assert (best.attrs["kind"], best.attrs["source"]) == ("exact", "exact, seed 0")
        drawn = PPoly(best["coefficients"][()], best["breaks"][()])
        np.testing.assert_allclose(drawn(1.5), [0.5], rtol=1e-12)


# --- one file, however it was made ---


def test_the_same_texts_give_the_same_bytes_however_they_came(path, trials, tmp_path):
    """Added one by one, in another order, replaced, removed: as made at once."""
    store = Store(tmp_path)
    for own_id in sorted(trials, reverse=True):
        store.write(trials[own_id])
        store.consolidate()
    assert store.results.read_bytes() == path.read_bytes()
    first = next(iter(trials.values()))
    history = np.array([[float(n), 9.0 - n] for n in range(5)])
    longer = replace(first, solution=replace(first.solution, history=history), message="no!")
    for change in (
        lambda: store.write(longer),
        lambda: store.write(first),
        lambda: store.path(solved().id).unlink(),
        lambda: store.write(trials[solved().id]),
    ):
        change()
        found = store.consolidate().read_bytes()
        texts = [file.read_bytes() for file in sorted((tmp_path / "trials").iterdir())]
        judge = results_file.judge_of(store.results)
        assert found[: -len(results_file.seal(b""))] == rebuilt(texts, judge=judge)
    assert found == path.read_bytes()


def test_rows_of_another_judge_are_made_again(path, tmp_path, monkeypatch):
    folder = tmp_path / "r"
    shutil.copytree(path.parent, folder)
    other = "0" * 64

    def change(file):
        file.attrs["judge"] = other
        file["trials/certified_duration"][...] = 0.5

    edited(folder / "results.h5", change)
    assert Store(folder).consolidate().read_bytes() == path.read_bytes()


def test_a_last_file_that_is_no_use_is_made_again(path, tmp_path):
    folder = tmp_path / "r"
    shutil.copytree(path.parent, folder)
    for name in ("trials/label", "trials/row", "problems/small", "problems/small/certified/count"):
        edited(folder / "results.h5", lambda file, name=name: file.__delitem__(name))
        assert Store(folder).consolidate().read_bytes() == path.read_bytes()


# --- names ---


@pytest.mark.parametrize(
    "name", ["a/b", "../x", ".", "", "100 %", "%2F", "a\\b", "q[0]", "①", "x" * 200, "runs/#1"]
)
def test_a_problem_of_any_name_is_where_its_rows_say(tmp_path, name):
    (trial,) = trials_of(Stopping(), replace(SMALL, name=name), [5], f"./{name[:150]}.py:P")
    with h5py.File(save(tmp_path / "x.h5", trial)) as file:
        problem = file["problems"][file["trials/problem"][0]]
        assert list(file["problems"].values()) == [problem]
        assert problem.attrs["name"] == name
        np.testing.assert_array_equal(problem["waypoints"], SMALL.waypoints)


def test_names_that_differ_have_groups_that_differ():
    names = ["", ".", "%2E", "a/b", "a%2Fb", "a%252Fb", "#", "%"]
    assert len({layout.escaped(name) for name in names}) == len(names)


def test_two_problems_of_one_name_have_a_group_each(tmp_path):
    other = Problem([[0.0], [2.0]], LIMITS, "small")
    trials = [trials_of(Stopping(), problem, [0], "stopping")[0] for problem in (SMALL, other)]
    store = Store(tmp_path)
    store.write_all(trials)
    with h5py.File(store.consolidate()) as file:
        ends = sorted(problem["waypoints"][-1, 0] for problem in file["problems"].values())
        assert ends == [1.0, 2.0]
        for trial_id, name in zip(file["trials/id"], file["trials/problem"], strict=True):
            (trial,) = (own for own in trials if own.id == trial_id.decode())
            assert file["problems"][name].attrs["digest"] == trial.digest


# --- what the texts do not give ---


def no_references(trials):
    return {}


OWN = "problems/Gelenk-Prüfung ①"
TOGETHER = 10  # members that are changed at once


def everything(file):
    """Every group and column of a file."""
    names = []
    file.visit(names.append)
    return names


@pytest.mark.long
def test_verification_names_every_member_that_is_gone_and_every_column_that_is_changed(
    path, tmp_path
):
    with h5py.File(path) as file:
        names = [name for name in everything(file) if name != "texts"]
        columns = [name for name in names if isinstance(file[name], h5py.Dataset)]
        filled = {name for name in columns if file[name].size}
    expected = tmp_path / "right.h5"
    shutil.copy(path, expected)
    content = expected.read_bytes()[: -len(results_file.seal(b""))]
    copy = tmp_path / "x.h5"

    def found(change):
        shutil.copy(path, copy)
        edited(copy, change)
        return results_file.differences(copy, content)

    def each(members, change):
        """Change some members at a time; each is named."""
        for first in range(0, len(members), TOGETHER):
            some = members[first : first + TOGETHER]
            said = found(lambda file, some=some: [change(file, name) for name in some])
            yield some, said

    assert found(lambda file: None) == []
    for name in set(names) - set(columns):
        assert f"/{name}" in found(lambda file, name=name: file.__delitem__(name))
    for some, said in each(columns, lambda file, name: file.__delitem__(name)):
        assert {f"/{name}" for name in some} <= set(said)
    for some, said in each(sorted(filled), lambda file, name: changed(file[name])):
        assert {f"/{name}" for name in some} <= set(said)
    for some, said in each(columns, lambda file, name: file[name].attrs.modify("units", "ms")):
        assert sorted(said) == sorted(f"/{name}: units" for name in some)


def changed(data):
    """Change the first value of a column."""
    first = (0,) * data.ndim
    value = data[first]
    if data.dtype.kind == "O":
        data[first] = "mine"
    else:
        data[first] = 7.5 if np.isnan(value) else value + 1


def plain(name, **kind):
    """Replace a column by one that is stored in another way."""

    def change(file):
        data, about = file[name][()], dict(file[name].attrs)
        del file[name]
        made = file.create_dataset(name, **({"data": data} | kind))
        made.attrs.update(about)

    return change


def link(name, target):
    def change(file):
        del file[name]
        file[name] = target

    return change


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda f: f.__delitem__("problems"), "/problems"),
        (lambda f: f.attrs.modify("title", "by NIST"), "/: title"),
        (lambda f: f.attrs.create("command", "by NIST"), "/: attributes"),
        (lambda f: f.attrs.__delitem__("judge"), "/: attributes"),
        (lambda f: f.attrs.create("schema", 5, dtype="i4"), "/: schema"),
        (lambda f: f.__setitem__("more", 1.0), "/: names"),
        (lambda f: f[OWN].attrs.create("best", "yes"), f"/{OWN}: attributes"),
        (lambda f: f[OWN].attrs.modify("source", "NIST"), f"/{OWN}: source"),
        (lambda f: f[OWN].attrs.create("name", np.zeros((9, 9))), f"/{OWN}: name"),
        (lambda f: f["trials/gap"].make_scale("x"), "/trials/gap: attributes"),
        (lambda f: f.create_group(f"{OWN}/mine"), f"/{OWN}: names"),
        (lambda f: f["problems"].__setitem__("again", f["/"]), "/problems: names"),
        (link("trials", h5py.SoftLink("/code")), "/trials"),
        (link("trials/gap", h5py.SoftLink("/trials/gap")), "/trials/gap"),
        (link("trials/gap", h5py.ExternalLink("/etc/passwd", "/x")), "/trials/gap"),
        (plain("trials/gap", dtype="f4"), "/trials/gap"),
        (plain("trials/gap", dtype=">f8"), "/trials/gap"),
        (plain("trials/gap", chunks=(2,)), "/trials/gap"),
        (plain("trials/gap", fillvalue=7.0), "/trials/gap"),
        (plain("trials/planner", dtype=h5py.string_dtype("ascii")), "/trials/planner"),
        (
            plain("trials/seed", data=np.zeros(2**22), chunks=(2**20,), compression=9),
            "/trials/seed",
        ),
        (lambda f: h5py.h5o.set_comment(f["trials"].id, b"by NIST"), "/trials: comment"),
        (lambda f: h5py.h5o.set_comment(f["trials/gap"].id, b"NIST"), "/trials/gap: comment"),
    ],
)
def test_verification_names_what_the_texts_do_not_give(path, tmp_path, change, named):
    copy = tmp_path / "results.h5"
    shutil.copy(path, copy)
    edited(copy, change)
    found = verification(copy, no_references)
    assert named in found.misstated
    assert not found.holds
    assert named in found.summary()[-1]


def test_a_file_that_holds_is_said_to_hold_also_of_another_judge(path, tmp_path):
    assert verification(path, no_references).holds
    copy = tmp_path / "results.h5"
    shutil.copy(path, copy)
    edited(copy, lambda file: file.attrs.modify("judge", "f" * 64))
    assert verification(copy, no_references).holds
    edited(copy, lambda file: file.attrs.modify("judge", "x" * 64))
    assert verification(copy, no_references).misstated == ("/: judge",)


def test_a_folder_is_verified_with_its_results_file(path, tmp_path):
    folder = tmp_path / "folder"
    shutil.copytree(path.parent, folder)
    edited(folder / "results.h5", lambda file: file["trials/seed"].__setitem__(0, 99))
    assert verification(folder, no_references).misstated == ("/trials/seed",)


def test_a_hundred_trials_take_little_room(tmp_path):
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
    assert store.consolidate().stat().st_size / 100 < 35_000


def test_no_trials_are_a_file_too(tmp_path):
    path = tmp_path / "x.h5"
    content = rebuilt([])
    path.write_bytes(content + results_file.seal(content))
    assert read(path) == []


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


TEXTS = h5py.string_dtype()


@pytest.mark.parametrize(
    ("what", "words"),
    [
        ({"data": np.zeros(4, np.uint8)}, "texts of any length"),
        ({"data": np.array([b"x"])}, "texts of any length"),
        ({"shape": (4,), "dtype": "u1", "external": [("secret", 0, 4)]}, "in one piece"),
        ({"shape": (4,), "dtype": TEXTS, "chunks": (4,), "compression": 1}, "in one piece"),
        ({"shape": (1 << 40,), "dtype": TEXTS, "chunks": (1 << 18,)}, "in one piece"),
        ({"shape": (1 << 40,), "dtype": TEXTS}, "a text in each row"),
        ({"shape": (2, 2), "dtype": TEXTS}, "a column"),
        ({"data": ["x"], "dtype": TEXTS}, "does not start as a trial's text does"),
    ],
)
def test_texts_that_lie_elsewhere_or_are_no_texts_are_refused(tmp_path, what, words):
    path = save(tmp_path / "x.h5", solved())

    def change(file):
        del file["texts"]
        file.create_dataset("texts", **what)

    with pytest.raises(StoreError, match=words):
        read(edited(path, change))


def test_links_are_never_followed(tmp_path):
    path = save(tmp_path / "x.h5", solved())

    def change(file):
        file.move("texts", "moved")
        file["texts"] = h5py.SoftLink("/moved")

    with pytest.raises(StoreError, match="in this very file"):
        read(edited(path, change))


def test_one_text_a_thousand_times_is_refused_at_once(tmp_path):
    """Every row is the same 20 MB of the file: to read all at once takes 20 GB."""
    path = save(tmp_path / "x.h5", solved())
    long = trial_text.sealed({"id": "0" * 20, "problem": "x" * 20_000_000})

    def change(file):
        del file["texts"]
        file.create_dataset("texts", data=[long] + [b"x"] * 999, dtype=TEXTS)
        place = file["texts"].id.get_offset()
        file.flush()
        with open(file.filename, "r+b") as stream:
            stream.seek(place)
            first = stream.read(16)
            stream.seek(place)
            stream.write(first * 1000)

    path = edited(path, change)
    tracemalloc.start()
    with pytest.raises(ValueError, match="two of trial 0000"):
        list(results_file.read(path))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1e9  # bytes; the few texts that are read together


def test_one_damaged_text_under_a_right_seal_refuses_the_file(tmp_path):
    path = save(tmp_path / "x.h5", solved())
    edited(path, lambda file: file["texts"].__setitem__(0, "damaged"))
    with pytest.raises(StoreError, match="it does not start as a trial's text does"):
        read(path)
