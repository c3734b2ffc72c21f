"""A trial comes back bit for bit, from its own text and from `results.h5`."""

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from trials import PROBLEM, assert_same, forged, solved

from trajopt import Limits, Problem, Solution, Status, StoreError
from trajopt.benchmark.store import trial_text
from trajopt.benchmark.store.document import pack, unpack
from trajopt.benchmark.store.fields import SEED_MAX, columns
from trajopt.benchmark.store.folder import Store, recorded
from trajopt.benchmark.trial import trial_id, trials_of
from trajopt.planners.registry import load, options
from trajopt.views.analysis.versions import newest


@pytest.fixture(scope="module")
def trial():
    return solved()


@pytest.fixture(params=["text", "results.h5"])
def stored(request, tmp_path):
    """Store a trial one way or the other and read it back."""

    def back(trial):
        if request.param == "text":
            return trial_text.read(trial_text.write(trial))
        store = Store(tmp_path / trial.id)
        store.write(trial)
        (found,) = recorded(store.consolidate())
        return found

    return back


def test_every_field_comes_back(stored, trial):
    back = stored(trial)
    assert_same(back, trial)
    assert back.id == trial.id
    assert back.as_dict() == trial.as_dict()


def test_names_and_units_of_joints_come_back(stored, trial):
    names = ("joint_a²", "joint_b²")
    units = ("rad", "m")
    named = replace(trial.problem, joint_names=names, joint_units=units)
    back = stored(replace(trial, problem=named))
    assert back.problem.joint_names == names
    assert back.problem.joint_units == units
    assert stored(trial).problem.joint_names == ()


@pytest.mark.parametrize("spec", ["pso:iterations=20", "exact:starts=1", "toppra"])
def test_every_field_of_a_real_planner_comes_back(stored, spec):
    limits = Limits([1.0], [2.0])
    problem = Problem([[0.0], [0.4], [1.0], [1.5]], limits, "one joint")
    name, _, _ = spec.partition(":")
    (trial,) = trials_of(load(spec), problem, [0], name)
    assert trial.certified_duration is not None
    assert_same(stored(trial), trial)


@pytest.mark.parametrize("status", [s for s in Status if s is not Status.SOLVED])
def test_failures_are_trials_with_a_status(stored, trial, status):
    solution = Solution(status, message="why not")
    failure = replace(
        trial, status=status, message="why not", solution=solution, certificate=None, setup_time=0.0
    )
    assert_same(stored(failure), failure)


def test_certificates_of_all_kinds_come_back(stored):
    """Jerk and position limits, and a flaw that no dilation mends."""
    limits = Limits([1.0], [2.0], jerk=[3.0], position=[[-0.5, 1.2]])
    problem = Problem([[0.0], [0.4], [1.0], [0.9]], limits)
    (trial,) = trials_of(load("unoptimised"), problem, [0], "unoptimised")
    assert trial.certificate.jerk
    assert trial.certificate.position
    certificate = replace(trial.certificate, flaws=("joint 1 at 0 s: jumps", "another"))
    back = stored(replace(trial, certificate=certificate))
    assert back.certificate == certificate
    assert back.certified_duration is None


@pytest.mark.parametrize("text", ["Traceback …\n" + "ß∞𝔘" * 50_000, "", "\t\n'\"\\", "x" * 5000])
def test_long_and_odd_text_survives(stored, trial, text):
    assert stored(replace(trial, message=text)).message == text


def test_text_that_steers_terminals_is_spelled_out(stored, trial):
    odd = "nul \0, surrogate \ud800, \x1b[31mred\x9b, \r over, right to left \u202e"
    spelled = r"nul \x00, surrogate \ud800, \x1b[31mred\x9b, \r over, right to left \u202e"
    solution = replace(trial.solution, message=odd, stats={"kind": odd, odd: 1.0})
    back = stored(replace(trial, message=odd, solution=solution))
    assert back.message == spelled
    assert back.solution.message == spelled
    assert back.solution.stats == {"kind": spelled, spelled: 1.0}


def test_options_that_json_lacks_keep_the_identity(stored, trial):
    odd = {"x": np.inf, "t": (1, 2), "nan": np.nan, "deep": {"a": [None]}}
    odd = replace(trial, options=odd)
    back = stored(odd)
    assert back.id == odd.id
    assert back.options["x"] == np.inf


STATS = {
    "nothing": None,
    "yes": True,
    "text": "ß \n\t",
    "int": 10**19 - 1,
    "inf": -np.inf,
    "nan": np.nan,
    "whole": [1.0, 2.0],
    "nested": {"a": [1, 2.5, [], {}], "b": None},
    "ints": np.arange(3),
    "truths": np.array([[True], [False]]),
    "single": np.float32([0.1, np.nan]),
    "words": np.array(["a", "ü"]),
    "none": np.zeros(0),
    "no rows": np.zeros((0, 4)),
    "cube": np.arange(24.0).reshape(2, 3, 4),
    "a/b c.d%ü": np.array([np.nan, np.inf, -0.0, 5e-324]),
    "transposed": np.arange(6.0).reshape(2, 3).T,
}


def test_stats_of_every_kind_come_back(stored, trial):
    full = replace(trial, solution=replace(trial.solution, stats=STATS))
    back = stored(full).solution.stats
    assert back.keys() == STATS.keys()
    for name, value in STATS.items():
        assert type(back[name]) is type(value), name
        np.testing.assert_array_equal(back[name], value, err_msg=name)
        if isinstance(value, np.ndarray):
            assert back[name].dtype == value.dtype, name
            assert back[name].shape == value.shape, name
            assert back[name].tobytes() == value.tobytes(), name
    assert all(isinstance(value, float) for value in back["whole"])


NO_VALUES = [object(), b"bytes", {1, 2}, 1j, np.array([object()]), 10**19, -(10**400)]


@pytest.mark.parametrize("value", NO_VALUES)
def test_what_cannot_be_kept_is_a_type_error_that_shows_it(trial, value):
    odd = replace(trial.solution, stats={"x": value})
    with pytest.raises(TypeError, match=r"cannot hold"):
        trial_text.write(replace(trial, solution=odd))


@pytest.mark.parametrize("value", [{"$float": "x"}, {"$array": 1}, np.zeros(2_500_000)])
def test_what_would_not_be_read_back_is_not_written(trial, value):
    odd = replace(trial.solution, stats={"x": value})
    with pytest.raises((ValueError, TypeError, KeyError)):
        trial_text.write(replace(trial, solution=odd))


@pytest.mark.parametrize("odd", [2.5, np.float32(3), Fraction(7, 2)])
def test_odd_numbers_of_a_planner_do_not_spoil_the_file(stored, trial, odd):
    solution = replace(trial.solution, lower_bound=odd)
    back = stored(replace(trial, solution=solution))
    assert back.lower_bound == float(odd)


def test_seeds_of_64_bits_come_back_and_others_are_refused(stored, trial):
    assert stored(replace(trial, seed=SEED_MAX)).seed == 2**63 - 1
    for seed in (2**63, -1):
        with pytest.raises(StoreError, match=rf"seed {seed} cannot be stored"):
            trial_text.write(replace(trial, seed=seed))


@pytest.mark.parametrize("history", [None, np.zeros((0, 2)), np.array([[1.0, np.inf]])])
def test_an_empty_history_is_not_the_same_as_none(stored, trial, history):
    one = replace(trial, solution=replace(trial.solution, history=history))
    assert_same(stored(one), one)


PRINTABLE = st.text(st.characters(exclude_categories=("C", "Z")))


@given(
    st.floats(allow_nan=False)
    | st.integers(1 - 10**19, 10**19 - 1)
    | PRINTABLE
    | st.booleans()
    | st.none()
)
def test_plain_values_survive_strict_json(value):
    def refuse(word):
        raise AssertionError(word)

    text = json.dumps(pack(value), allow_nan=False)
    back = unpack(json.loads(text, parse_constant=refuse))
    assert back == value
    assert type(back) is type(value)
    assert str(back) == str(value)  # -0.0 too


def test_every_field_has_a_value_in_every_trial(trial):
    blank = replace(trial, solution=Solution(Status.FAILED), certificate=None)
    found = columns([trial, blank])
    assert found["planner"] == ["stopping"] * 2
    assert np.isnan(found["certified_duration"]).tolist() == [False, True]


# --- a stranger's text ---


def changed(*path, to):
    """A change of one value in a trial's JSON."""

    def change(table):
        *places, last = path
        for place in places:
            table = table[place]
        table[last] = to

    return change


def nested(depth):
    """A list in a list, so many times."""
    return [nested(depth - 1)] if depth else []


HOSTILE = (
    [10**18, 10**19, 10**400, -1, 1e308, {"$float": "inf"}, {"$float": "nan"}, None, True, "", "x"]
    + ["9999-99-99", "9999-12-31T23:59:59-14:00", nested(3), nested(100), "x" * 250, {}]
    + [{"$array": [10**30], "dtype": dtype, "shape": [1]} for dtype in ("<f8", "<i8", "<U1")]
)


def places(value, path=()):
    """Every place of a trial's JSON; of a list its first item."""
    if path:
        yield path
    if isinstance(value, dict):
        for key, own in value.items():
            yield from places(own, (*path, key))
    elif isinstance(value, list) and value:
        yield from places(value[0], (*path, 0))


def test_any_value_at_any_place_is_refused_or_harms_no_table(trial):
    text = trial_text.write(trial)
    for path in places(json.loads(text)):
        for value in HOSTILE:
            try:
                found = trial_text.read(forged(text, changed(*path, to=value)))
            except (ValueError, TypeError, ArithmeticError, LookupError):
                continue
            found = replace(found, certificate=trial.certificate)  # verdicts are computed anew
            columns([found, trial])
            shown = newest([trial, found])
            assert len(shown.trials) + sum(shown.left_out.values()) in (1, 2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (changed("seed", to="3"), "seed: expected a whole number"),
        (changed("seed", to=True), "seed: expected a whole number"),
        (changed("seed", to=4), "but its content makes it"),
        (changed("batch", to=0), "batch"),
        (changed("label", to="two\nlines"), "label: expected a line"),
        (changed("message", to="\x1b[31m"), "control characters"),
        (changed("started", to="yesterday"), "started: expected a time"),
        (changed("status", to="excellent"), "excellent"),
        (changed("provenance", to={"mintime": 3}), "provenance: mintime: expected text"),
        (changed("provenance", to={}), "provenance: trajopt"),
        (changed("extra", to=1), "extra"),
        (changed("problem", "digest", to="0" * 64), "problem.digest"),
        (changed("problem", "waypoints", 0, 0, to=0.1), "problem.digest"),
        (changed("problem", "limits", "velocity", 0, to=5), "problem.limits.velocity"),
        (changed("certificate", "flaws", to="none"), "flaws"),
        (changed("certificate", "velocity", "joint", to=3), "velocity: joint 3"),
        (changed("certificate", "dilation", to="1"), "expected numbers"),
        (changed("solution", "trajectory", to=None), "there is no trajectory"),
        (changed("solution", "trajectory", "breaks", -1, to=0.9), "increasing|waypoint_times"),
        (changed("solution", "evaluations", to=-1), "Solution.evaluations"),
        (changed("solution", "lower_bound", to={"$float": "inf"}), "Solution.lower_bound"),
        (changed("solution", "lower_bound", to=10**400), "1000.*more than 19 digits"),
        (changed("setup_time", to={"$float": "inf"}), "setup_time: expected a finite number"),
        (changed("asked", to="9999-99-99"), "asked: expected a time .*, or nothing"),
        (changed("label", to="x" * 3_000_000), "label: expected a line of at most 2000"),
        (changed("problem", "name", to="x" * 3_000_000), "name is 'xxx.*at most 200 characters"),
        (changed("certificate", "waypoint", to=3), "certificate: waypoint"),
        (changed("options", to=[[]] * 3 + [nested(50)]), "deeper than 40"),
        (changed("solution", "stats", to={"x": {"$array": [1], "dtype": "O"}}), "an array of"),
    ],
)
def test_what_is_no_trial_is_refused_though_it_is_sealed(trial, change, words):
    text = trial_text.write(trial)
    with pytest.raises(ValueError, match=words):
        trial_text.read(forged(text, change))


@pytest.mark.parametrize(
    ("seed", "words"),
    [
        (b'3,\n"seed":3', "the key seed is there twice"),
        (b"NaN", "NaN is no number of JSON"),
        (b"9" * 60_000, "99.*… has more than 19 digits"),
        (b"1e999", "1e999 is too large for a number"),
        (b"[" * 100_000, "deeper than 40|Expecting"),
    ],
)
def test_what_is_no_json_is_refused_though_it_is_sealed(trial, seed, words):
    _, _, _, body = trial_text.write(trial).split(b"\n", 3)
    changed = body.replace(b'"seed": 3', b'"seed": ' + seed)
    assert changed != body
    with pytest.raises(ValueError, match=words):
        trial_text.read(trial_text.seal(changed))


def test_a_trajectory_stated_joint_by_joint_comes_back(trial):
    text = trial_text.write(trial, brief=True)
    assert b'"joints":[[' in text
    assert b'"breaks":' not in text
    back = trial_text.read(text)
    assert_same(back.solution.trajectory, trial.solution.trajectory)


@pytest.mark.parametrize("brief", [False, True])
def test_lengths_that_breaks_round_come_back(trial, brief):
    own = trial.solution.trajectory
    exact = own.lengths * (1 + 1e-15)
    trajectory = replace(own, lengths=exact)
    changed = replace(trial, solution=replace(trial.solution, trajectory=trajectory))
    text = trial_text.write(changed, brief=brief)
    assert b'"lengths":' in text
    back = trial_text.read(text)
    np.testing.assert_array_equal(back.solution.trajectory.lengths, exact)
    assert b'"lengths":' not in trial_text.write(trial, brief=brief)


def test_every_flipped_bit_is_found(trial):
    text = trial_text.write(trial)
    rng = np.random.default_rng(0)
    for place in rng.integers(len(text), size=200):
        broken = bytearray(text)
        broken[place] ^= 1 << int(rng.integers(8))
        with pytest.raises((ValueError, StoreError)):
            trial_text.read(bytes(broken))


def test_another_version_is_refused_in_words(trial):
    text = trial_text.write(trial).replace(b"trajopt-4", b"trajopt-5", 1)
    with pytest.raises(StoreError, match="another version of trajopt"):
        trial_text.read(text)


# --- identity ---


def changed_problems():
    limits = PROBLEM.limits
    names = ("velocity", "acceleration", "jerk", "position")
    yield Problem(np.nextafter(PROBLEM.waypoints, 9), limits)
    for name in names:
        pairs = {other: getattr(limits, other) for other in names}
        pairs[name] = pairs[name].copy()
        pairs[name][1, 1] = 3.25
        yield Problem(PROBLEM.waypoints, Limits(**pairs))


def test_identity_is_numbers_planner_options_seed_and_version_and_not_the_name():
    own = {"population": 30, "fitness": "penalty"}
    first = trial_id(PROBLEM, "pso", own, 0, "0.1.0")
    ids = [first]
    for problem in changed_problems():
        ids.append(trial_id(problem, "pso", own, 0, "0.1.0"))
    for name, value in (("population", 31), ("fitness", "scaled"), ("new", None)):
        ids.append(trial_id(PROBLEM, "pso", own | {name: value}, 0, "0.1.0"))
    ids.append(trial_id(PROBLEM, "ssa", own, 0, "0.1.0"))
    ids.append(trial_id(PROBLEM, "pso", own, 1, "0.1.0"))
    ids.append(trial_id(PROBLEM, "pso", own, 0, "0.1.1"))
    assert len(set(ids)) == len(ids) == 12
    renamed = replace(PROBLEM, name="renamed", source="x")
    assert trial_id(renamed, "pso", own, 0, "0.1.0") == first
    turned = {"fitness": "penalty", "population": 30}
    assert trial_id(PROBLEM, "pso", turned, 0, "0.1.0") == first


@pytest.mark.parametrize(
    ("spec", "change"), [("issa", "levy=False"), ("toppra", "ends=natural"), ("exact", "starts=2")]
)
def test_every_option_of_every_registered_planner_is_in_the_identity(spec, change):
    ids = set()
    for one in (spec, f"{spec}:{change}"):
        ids.add(trial_id(PROBLEM, "p", options(load(one)), 0, "0"))
    assert len(ids) == 2


def test_a_path_is_no_option_that_a_text_holds(trial):
    with pytest.raises(TypeError, match="cannot hold"):
        trial_text.write(replace(trial, options={"path": Path("/tmp")}))
