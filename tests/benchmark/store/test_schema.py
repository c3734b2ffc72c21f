"""What is kept of a trial comes back bit by bit, from a trial file and from results.h5 alike."""

import json
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from trials import PROBLEM, assert_same, solved

from trajopt import Limits, Problem, Solution, Status, StoreError
from trajopt.benchmark.store.columns import COLUMNS, SEED_MAX
from trajopt.benchmark.store.folder import Store, read, save
from trajopt.benchmark.store.schema import decode, encode, pack, unpack
from trajopt.benchmark.trial import judge, trial_id
from trajopt.planners.registry import load, options


@pytest.fixture(scope="module")
def trial():
    return solved()


@pytest.fixture(params=["trial file", "results.h5"])
def stored(request, tmp_path):
    """Stores a trial one way or the other and reads it back."""

    def back(trial):
        if request.param == "trial file":
            (found,) = read(save(tmp_path / "t.h5", trial))
        else:
            store = Store(tmp_path / trial.id)
            store.write(trial)
            (found,) = read(store.consolidate())
        return found

    return back


def test_every_field_comes_back(stored, trial):
    back = stored(trial)
    assert_same(back, trial)
    assert back.id == trial.id
    assert back.as_dict() == trial.as_dict()


def test_names_of_joints_come_back(stored, trial):
    names = [f"joint_{letter}²" for letter in "abcdefghij"[: trial.problem.joints]]
    named = replace(trial.problem, joint_names=tuple(names))
    back = stored(replace(trial, problem=named))
    assert back.problem.joint_names == named.joint_names
    assert stored(trial).problem.joint_names == trial.problem.joint_names == ()


@pytest.mark.parametrize("spec", ["pso:iterations=20", "exact:starts=1", "toppra"])
def test_every_field_of_a_real_planner_comes_back(stored, spec):
    problem = Problem([[0.0], [0.4], [1.0], [1.5]], Limits([1.0], [2.0]), "one joint")
    (trial,) = judge(load(spec), problem, [0], spec.split(":")[0])
    back = stored(trial)
    assert back.certified_duration is not None
    assert back.solution.setup_time == pytest.approx(trial.setup_time)
    assert_same(back, replace(trial, solution=replace(trial.solution, setup_time=trial.setup_time)))


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
    (trial,) = judge(load("unoptimised"), problem, [0], "unoptimised")
    assert trial.certificate.jerk
    assert trial.certificate.position
    certificate = replace(trial.certificate, flaws=("joint 1 at 0 s: jumps", "another"))
    back = stored(replace(trial, certificate=certificate))
    assert back.certificate == certificate
    assert back.certified_duration is None


@pytest.mark.parametrize("text", ["Traceback …\n" + "ß∞𝔘" * 50_000, "", "\t\n'\"\\"])
def test_long_and_odd_text_survives(stored, trial, text):
    assert stored(replace(trial, message=text)).message == text


def test_text_that_hdf5_lacks_or_that_steers_terminals_is_spelt_out(stored, trial):
    odd = "nul \0, surrogate \ud800, \x1b[31mred\x9b, \r over, right to left \u202e"
    spelt = r"nul \x00, surrogate \ud800, \x1b[31mred\x9b, \r over, right to left \u202e"
    solution = replace(trial.solution, message=odd, stats={"kind": odd, odd: 1.0})
    back = stored(replace(trial, message=odd, solution=solution, label=f"stopping:a\n{odd}"))
    assert back.message == back.solution.message == spelt
    assert back.solution.stats == {"kind": spelt, spelt: 1.0}
    assert back.label == r"stopping:a\n" + spelt


def test_options_that_json_lacks_are_stored_and_keep_the_identity(stored, trial):
    odd = {"path": Path("/tmp"), "n": np.int64(3), "x": np.inf, "t": (1, 2), "nan": np.nan}
    odd = replace(trial, options=odd)
    back = stored(odd)
    assert back.id == odd.id
    assert back.options["x"] == np.inf


STATS = {
    "nothing": None, "yes": True, "text": "ß \n\t", "int": 2**70, "inf": -np.inf,
    "nan": np.nan, "nested": {"a": [1, 2.5, [], {}], "b": None}, "ints": np.arange(3),
    "truths": np.array([[True], [False]]), "single": np.float32([0.1, np.nan]),
    "words": np.array(["a", "ü"]), "none": np.zeros(0), "no rows": np.zeros((0, 4)),
    "cube": np.arange(24.0).reshape(2, 3, 4), "a/b c.d%ü": np.array([np.nan, np.inf, -0.0, 5e-324]),
    "transposed": np.arange(6.0).reshape(2, 3).T,
}  # fmt: skip


def test_stats_of_every_kind_come_back(stored, trial):
    full = replace(trial, solution=replace(trial.solution, stats=STATS))
    back = stored(full).solution.stats
    assert back.keys() == STATS.keys()
    for name, value in STATS.items():
        assert type(back[name]) is type(value), name
        np.testing.assert_array_equal(back[name], value, err_msg=name)
        if isinstance(value, np.ndarray):
            assert (back[name].dtype, back[name].shape) == (value.dtype, value.shape), name
            assert back[name].tobytes() == value.tobytes(), name


@pytest.mark.parametrize("value", [object(), b"bytes", {1, 2}, 1j, np.array([object()])])
def test_what_cannot_be_kept_is_a_type_error_that_shows_it(trial, value):
    with pytest.raises(TypeError, match=r"cannot hold"):
        encode(replace(trial, solution=replace(trial.solution, stats={"x": value})))


@pytest.mark.parametrize("odd", [np.nan, np.inf, -np.inf, 2.5, np.float32(3), Fraction(7, 2)])
def test_odd_numbers_of_a_planner_do_not_spoil_the_file(stored, trial, odd):
    solution = replace(trial.solution, lower_bound=odd, evaluations=odd, setup_time=odd)
    back = stored(replace(trial, solution=solution, setup_time=odd, solve_time=odd))
    assert back.lower_bound == (odd if odd == odd else None)
    assert back.solution.evaluations == (int(odd) if abs(odd) < np.inf else None)
    np.testing.assert_equal((back.setup_time, back.solve_time), (float(odd), float(odd)))


def test_seeds_of_64_bits_come_back_and_others_are_refused(stored, trial):
    assert stored(replace(trial, seed=SEED_MAX)).seed == SEED_MAX == 2**63 - 1
    for seed in (2**63, -1):
        with pytest.raises(StoreError, match=rf"seed {seed} cannot be stored"):
            encode(replace(trial, seed=seed))


def test_an_empty_history_is_not_the_same_as_none(stored, trial):
    for history in (None, np.zeros((0, 2)), np.array([[1.0, np.inf]])):
        one = replace(trial, solution=replace(trial.solution, history=history))
        assert_same(stored(one), one)


@given(st.floats(allow_nan=False) | st.integers() | st.text() | st.booleans() | st.none())
def test_plain_values_survive_strict_json(value):
    def refuse(word):
        raise AssertionError(word)

    back = unpack(json.loads(json.dumps(pack(value), allow_nan=False), parse_constant=refuse))
    assert back == value
    assert type(back) is type(value)
    assert str(back) == str(value)  # -0.0 too


def test_every_column_is_in_every_row_and_none_besides(trial):
    blank = replace(trial, solution=Solution(Status.FAILED), certificate=None)
    for one in (trial, blank):
        row = encode(one).row
        assert row.keys() == COLUMNS.keys()
        json.dumps(row, allow_nan=False)


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
        a, b = (
            trial_id(PROBLEM, "p", options(load(s)), 0, "0") for s in (spec, f"{spec}:{change}")
        )
        assert a != b


@pytest.mark.parametrize("odd", [{"trajopt": 3}, {}, {"trajopt": "0", "planner_digest": []}])
def test_a_provenance_that_makes_no_identity_is_refused(trial, odd):
    kept = encode(trial)
    kept.row["provenance"] = odd
    with pytest.raises(ValueError, match="provenance: "):
        decode(kept)
