"""Round trips of CSV and Parquet; IOHprofiler data by a reader written from its description."""

import csv
import json
import re
import sys
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
from trials import as_runs

from trajopt import InvalidInput, Limits, Problem, Relation, Solution, Status, StoreError
from trajopt.benchmark.provenance import PACKAGES
from trajopt.benchmark.trial import judge
from trajopt.core.exceptions import MissingBackend
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.views.analysis.results import Results
from trajopt.views.export import all_trials, ioh, tables

WAYPOINTS = [[0.0, 0.1], [0.4, 0.0], [1.0, 0.3], [1.5, 1.0]]
PROBLEM = Problem(WAYPOINTS, Limits([1, 2], [2, 3]), "two joints")
OTHER = Problem(WAYPOINTS, Limits([1, 2], [9, 9]), 'A/b "Prüfung", ①')
NAN, INF = np.nan, np.inf


@dataclass(frozen=True)
class Searching(Planner):
    """Quintics of `segment_time`; too short a one is dilated by the verifier. Keeps `history`."""

    segment_time: float = 2.0
    history: tuple = (
        (1, NAN),
        (3, 9.0),
        (5, 9.0),
        (8, 6.0),
        (10, 6.0),
    )
    evaluations: int | None = 10
    message: str = ""
    weight: float = NAN
    stochastic = True

    def relation(self, problem):
        return Relation.RESTRICTION

    def unsupported(self, problem):
        return None

    def solve(self, problem, *, seed=0):
        history = None if self.history is None else np.array(self.history, dtype=float)
        if history is not None:
            history[:, 1] *= self.segment_time / 2  # claims
        more = {"evaluations": self.evaluations, "history": history, "message": self.message}
        if self.segment_time < 0:
            return Solution(Status.FAILED, **more)
        if self.segment_time == 0:
            raise RuntimeError("boom")
        h = problem.displacements
        c = np.zeros((6, problem.segments, problem.joints))
        for row, factor in ((0, 6), (1, -15), (2, 10)):
            c[row] = factor * h / self.segment_time ** (5 - row)
        c[5] = problem.waypoints[:-1]
        breaks = self.segment_time * np.arange(problem.segments + 1)
        return Solution(Status.SOLVED, Trajectory(breaks, c, breaks), **more)


def run(name="mine", *, problem=PROBLEM, seeds=(0,), **options):
    return [judge(Searching(**options), problem, [seed], name)[0] for seed in seeds]


def mixed():
    """All there is: references, failures, text that CSV must quote, texts that look like gaps."""
    exact = judge(load("exact:starts=1"), PROBLEM, [0], "exact")
    words = [
        "a,b",
        'c"d',
        "e\nf",
        "g\r\nh",
        "NA",
        "nan",
        "",
        "ü①",
        " x ",
        "i\rj",
        "\t\x1b",
        "=1+1",
        "-k",
        "+",
        "@a",
        "'",
        "\n=2",
        "\r-1",
        "＝3",
    ]
    return [
        *exact,
        *run(seeds=(0, 1, 7)),
        *run(segment_time=0.1),
        *run("NA", problem=OTHER),
        *run(segment_time=-1),
        *run(segment_time=0, evaluations=None),
        *(t for w in words for t in run("None", message=w, segment_time=0.3)),
    ]


@pytest.fixture(scope="module")
def results():
    return Results(mixed())


def read_csv(path, like):
    texts = [n for n in like if like[n].map(lambda value: isinstance(value, str)).any()]
    floats = list(like.select_dtypes("float"))
    rest = {n: [""] for n in like if n not in texts} | {"kind": [""]}
    frame = pd.read_csv(
        path,
        keep_default_na=False,
        na_values=rest,
        dtype=like.dtypes.drop("started").to_dict() | dict.fromkeys(floats, object),
        parse_dates=["started"],
    )
    frame[floats] = frame[floats].astype(float)  # by Python: pandas 3.0 errs in the last digit
    for name in texts:  # an apostrophe says that what follows is text
        frame[name] = frame[name].str.removeprefix("'")
    return frame.assign(started=frame["started"].dt.as_unit("us"))


def test_csv_comes_back_as_the_frame_it_was(tmp_path, results):
    table = tables.table(results)
    all_trials.write(results, "csv", tmp_path / "new" / "t.csv")
    back = read_csv(tmp_path / "new" / "t.csv", table)
    pd.testing.assert_frame_equal(back, table, check_exact=True)


NASTY = [
    "=HYPERLINK(1)",
    "+1",
    "-2+3",
    "@SUM(A1)",
    "\tx",
    "\r=1",
    "\n=1",
    "＝1",
    "'quoted",
]


@pytest.mark.parametrize("name", NASTY)
def test_no_spreadsheet_runs_a_cell_and_numbers_stay_numbers(tmp_path, name):
    problem = replace(PROBLEM, name=name)
    trials = [*run(name, problem=problem, segment_time=-1, message=name), *run("exact")]
    all_trials.write(Results(trials), "csv", tmp_path / "t.csv")
    with (tmp_path / "t.csv").open(newline="", encoding="utf-8") as file:
        head, *rows = csv.reader(file)
    numbers = set(tables.table(Results(trials)).select_dtypes("number"))
    for row in rows:
        for column, cell in zip(head, row, strict=True):
            if column in numbers and cell:
                assert np.isfinite(float(cell))
            else:
                assert not cell.startswith(tuple("=+-@\t\r\n＝"))
    first = dict(zip(head, rows[0], strict=True))
    assert first["problem"] == first["message"] == f"'{name}"


def test_a_negative_number_is_no_formula(tmp_path):
    (faster,) = run(segment_time=2.0)
    (exact,) = run("exact", segment_time=3.0)
    all_trials.write(Results([exact, faster]), "csv", tmp_path / "t.csv")
    gaps = pd.read_csv(tmp_path / "t.csv")["gap"]
    assert gaps.tolist() == [0, pytest.approx(-1 / 3)]
    assert ",-0.333" in (tmp_path / "t.csv").read_text("utf-8")


def test_parquet_comes_back_as_the_frame_it_was_types_included(tmp_path, results):
    pq = pytest.importorskip("pyarrow.parquet")
    table = tables.table(results)
    all_trials.write(results, "parquet", tmp_path / "t.parquet")
    pd.testing.assert_frame_equal(pd.read_parquet(tmp_path / "t.parquet"), table, check_exact=True)
    kinds = {f.name: str(f.type) for f in pq.read_schema(tmp_path / "t.parquet")}
    expected = {
        "seed": "int64",
        "feasible": "bool",
        "gap": "double",
        "evaluations": "double",
        "started": "timestamp[us, tz=UTC]",
        "batch": "int64",
    }
    assert {n: kinds[n] for n in expected} == expected
    assert {kinds[n] for n in ("options", "message", "kind")} <= {"string", "large_string"}


def test_one_row_per_trial_with_its_gap_options_and_provenance(results):
    table = tables.table(results)
    assert table["id"].tolist() == [t.id for t in results.items]
    reference = results.items[0].certified_duration
    expected = [
        t.certified_duration / reference - 1 if t.certified_duration else NAN
        for t in results.items
        if t.problem is PROBLEM
    ]
    np.testing.assert_allclose(
        table.loc[table["digest"] == PROBLEM.digest(), "gap"],
        expected,
        rtol=1e-12,
    )
    options = json.loads(table["options"][1])
    assert options["segment_time"] == 2.0
    assert options["weight"] == {"$float": "nan"}
    for name in (*PACKAGES, "commit", "python", "machine"):
        assert table[f"provenance_{name}"][0] == results.items[0].provenance[name]
    started = [pd.Timestamp(t.started) for t in results.items]
    assert table["started"].tolist() == started


@pytest.mark.parametrize("to", ["csv", "parquet"])
def test_no_trials_are_a_table_without_rows(tmp_path, to):
    if to == "parquet":
        pytest.importorskip("pyarrow")
    all_trials.write(Results([]), to, tmp_path / "t")
    back = pd.read_csv(tmp_path / "t") if to == "csv" else pd.read_parquet(tmp_path / "t")
    assert len(back) == 0
    assert {"id", "gap", "options", "started"} <= set(back)


def test_parquet_without_pyarrow_says_how_to_mend_it(tmp_path, results, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingBackend, match=r"mintime\[parquet\]"):
        all_trials.write(results, "parquet", tmp_path / "t.parquet")
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_format_is_refused(tmp_path, results):
    with pytest.raises(InvalidInput, match="--to is 'xls': expected csv or parquet or ioh"):
        all_trials.write(results, "xls", tmp_path / "t.xls")


# IOHprofiler


def read_ioh(folder):
    """Runs by algorithm and function, from the published format alone.

    Asserts what IOHanalyzer 0.1.8.2 takes for granted (R/readFiles.R; upload.R for the paths).
    """
    found = {}
    for path in folder.rglob("*.*"):
        inside = path.relative_to(folder).as_posix()
        assert not re.search("zip|bz|gz|tar|xz|csv|txt", inside)
    for path in folder.rglob("*.json"):
        meta = json.loads(path.read_text("utf-8"), parse_constant=pytest.fail)
        for scenario in meta["scenarios"]:
            lines = (path.parent / scenario["path"]).read_text("utf-8").splitlines()
            blocks = []
            for line in lines:
                if not any(c.isdigit() for c in line.split(" ")[0]):
                    assert line == "evaluations raw_y"
                    blocks.append([])
                else:
                    blocks[-1].append([float(x) for x in line.split(" ")])
            spent = [[row[0] for row in b] for b in blocks]
            assert all(s == sorted(set(s)) and s[0] == 1 for s in spent)
            assert len({e for s in spent for e in s}) > 1
            assert [s[-1] for s in spent] == [r["evals"] for r in scenario["runs"]]
            key = meta["algorithm"]["name"], meta["function_name"]
            assert key not in found
            found[key] = meta, scenario, [np.array(b) for b in blocks]
    return found


def written(path, trials):
    all_trials.write(Results(trials), "ioh", path / "ioh")
    return read_ioh(path / "ioh")


def curve(path, **options):
    """A file with a single evaluation is not written."""
    runs = as_runs([*run(**options), *run()])
    ((_, scenario, blocks),) = written(path, runs).values()
    assert len(scenario["runs"]) == len(blocks) == 2
    return blocks[0].tolist(), scenario["runs"][0]


@pytest.mark.parametrize("name", ["../../etc/x", "a/b", "$(id) $x$ \\frac", "a\nb\r", "=1", "ü①\0"])
def test_names_are_text_and_never_part_of_a_path(tmp_path, name):
    problem = replace(PROBLEM, name=name)
    trials = [replace(t, label=name) for t in run(problem=problem)]
    assert set(written(tmp_path / "deep", trials)) == {(name, name)}
    files = [p.relative_to(tmp_path) for p in tmp_path.rglob("*") if p.is_file()]
    assert sorted(f.as_posix() for f in files) == [
        "deep/ioh/algorithm_1/IOHprofiler_f1.json",
        "deep/ioh/algorithm_1/data_f1/IOHprofiler_f1_DIM3.dat",
    ]


# Files of IOHexperimenter 0.3.22: ioh.logger.Analyzer on BBOB's sphere.
LOGGED = {
    "version",
    "suite",
    "function_id",
    "function_name",
    "maximization",
    "algorithm",
    "experiment_attributes",
    "attributes",
    "scenarios",
}


def test_files_are_those_that_iohexperimenter_writes_but_for_names(tmp_path):
    named = replace(OTHER, name="start.csv to target.zip")
    written(tmp_path, [*run(), *run("pso:restart=1", problem=named)])
    files = {p.relative_to(tmp_path / "ioh").as_posix() for p in tmp_path.rglob("*.*")}
    assert {f for f in files if f.endswith(("json", "dat"))} == {
        "algorithm_1/IOHprofiler_f2.json",
        "algorithm_1/data_f2/IOHprofiler_f2_DIM3.dat",
        "algorithm_2/IOHprofiler_f1.json",
        "algorithm_2/data_f1/IOHprofiler_f1_DIM3.dat",
    }


def test_the_meta_file_has_the_keys_and_says_what_was_run(tmp_path):
    trials = run(seeds=(4, 2), segment_time=0.5)
    ((meta, scenario, _),) = written(tmp_path, trials).values()
    assert set(meta) == LOGGED | {"run_attributes"}
    assert (meta["maximization"], meta["function_name"]) == (False, "two joints")
    assert (meta["algorithm"]["name"], meta["function_id"]) == ("mine:segment_time=0.5", 1)
    assert json.loads(meta["algorithm"]["info"])["segment_time"] == 0.5
    assert trials[0].provenance["mintime"] in meta["experiment_attributes"][0]["provenance"]
    assert set(scenario) == {"dimension", "path", "runs"}
    assert scenario["dimension"] == 3
    assert [r["seed"] for r in scenario["runs"]] == [2, 4]
    for r in scenario["runs"]:
        assert set(r) == {"instance", "evals", "best", "seed"}
        assert set(r["best"]) == {"evals", "y", "x"}
        assert sum(r["best"]["x"]) == pytest.approx(trials[0].certified_duration, rel=1e-12)


def test_a_history_is_its_first_row_each_improvement_and_the_last(tmp_path):
    block, summary = curve(tmp_path)
    assert block == [[1, INF], [3, 9], [8, 6], [10, 6]]
    assert (
        summary["evals"],
        summary["best"]["evals"],
        summary["best"]["y"],
    ) == (10, 8, 6)


def test_durations_are_dilated_as_the_answer_was(tmp_path):
    (trial,) = run(segment_time=0.5)  # claims a quarter
    # 15/8 h/T and 10/√3 h/T² against the limits of both joints
    h = np.abs(np.diff(WAYPOINTS, axis=0)).max(axis=0)
    k = max((15 / 8 * h / 0.5 / [1, 2]).max(), np.sqrt((10 / np.sqrt(3) * h / 0.25 / [2, 3]).max()))
    assert k > 1.5
    ((_, scenario, (block,)),) = written(tmp_path, [trial]).values()
    np.testing.assert_allclose(
        block[1:, 1],
        np.array([9, 6, 6]) / 4 * k,
        rtol=1e-9,
    )
    assert scenario["runs"][0]["best"]["y"] == block[-1, 1]


@pytest.mark.parametrize("segment_time", [-1.0, 0.0])
def test_a_run_that_certified_nothing_spent_its_evaluations_and_found_nothing(
    tmp_path, segment_time
):
    failure = run(segment_time=segment_time)
    runs = as_runs([*failure, *run()])
    ((_, scenario, blocks),) = written(tmp_path, runs).values()
    spent = [[1, INF], [10, INF]] if segment_time < 0 else [[1, INF]]  # a crash tells nothing
    assert blocks[0].tolist() == spent
    assert scenario["runs"][0]["best"] == {
        "evals": 1,
        "y": sys.float_info.max,
        "x": [],
    }
    assert blocks[1][-1].tolist() == [10, 6]


@pytest.mark.parametrize(
    ("history", "evaluations", "expected"),
    [
        (((1, 6.0),), 1, [[1, 6]]),
        (((1, 6.0),), None, [[1, 6]]),
        (((0, 6.0),), None, [[1, 6]]),
        (
            ((3, 6.0),),
            8,
            [[1, INF], [3, 6], [8, 6]],
        ),
        (((3, 6.0),), 2, [[1, INF], [3, 6]]),
        (
            ((1, 9.0), (1, 8.0), (4, 7.0), (4, 6.0)),
            4,
            [[1, 8], [4, 6]],
        ),
        (
            ((1, NAN), (2, NAN)),
            2,
            [[1, INF], [2, INF]],
        ),
        (
            ((1.0, 20 / 3), (1e15, 6.0)),
            None,
            [[1, 20 / 3], [1e15, 6]],
        ),
        (
            ((2, 9.0), (7, 8.0)),
            7,
            [[1, INF], [7, INF]],
        ),  # not the answer's
    ],
)
def test_odd_histories_keep_to_the_format(tmp_path, history, evaluations, expected):
    block, summary = curve(tmp_path, history=history, evaluations=evaluations)
    assert block == expected
    assert summary["evals"] == expected[-1][0]


def test_without_rows_a_history_is_a_run_that_found_nothing(tmp_path):
    (trial,) = run()
    trial = replace(trial, solution=replace(trial.solution, history=np.empty((0, 2))))
    ((_, _, (block,)),) = written(tmp_path, [trial]).values()
    assert block.tolist() == [[1, INF], [10, INF]]


def test_searches_of_one_evaluation_are_left_out_and_named(tmp_path):
    short = run("short", history=((1, 6.0),), evaluations=1, seeds=(0, 1))
    found = written(tmp_path, [*short, *run()])
    assert {name for name, _ in found} == {"mine"}
    assert ioh.without_history(Results([*short, *run()])) == [short[0].label]
    with pytest.raises(StoreError, match="no trial has a history of two evaluations"):
        all_trials.write(Results(short), "ioh", tmp_path / "none")


def test_planners_without_histories_are_left_out_and_named(tmp_path):
    one, other = as_runs([*run(), *run(problem=OTHER, history=None)])
    trials = [one, *run("exact", history=None), other]
    assert set(written(tmp_path, trials)) == {("mine", "two joints")}
    assert ioh.without_history(Results(trials)) == [trials[1].label]
    with pytest.raises(StoreError, match="no trial has a history"):
        all_trials.write(Results(trials[1:]), "ioh", tmp_path / "none")
    assert [p.name for p in tmp_path.iterdir()] == ["ioh"]


def test_a_folder_with_files_in_it_stays_as_it_is(tmp_path):
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes").write_text("")
    (tmp_path / "file").write_text("")
    for path in (tmp_path / "full", tmp_path / "file", tmp_path / "file" / "ioh"):
        with pytest.raises(StoreError, match=path.name):
            all_trials.write(Results(run()), "ioh", path)
    assert [p.name for p in (tmp_path / "full").iterdir()] == ["notes"]
    assert {p.name for p in tmp_path.iterdir()} == {"full", "file"}


def test_names_that_look_alike_do_not_collide(tmp_path):
    same = Problem(WAYPOINTS, Limits([1, 2], [7, 7]), "two-joints")
    long = [
        Problem(
            WAYPOINTS,
            Limits([1, 2], [n, n]),
            "x" * 300 + str(n),
        )
        for n in (4, 5)
    ]
    names = ["a:b", "a_b", "ä:b"]
    trials = [t for n in names for p in (PROBLEM, same, *long) for t in run(n, problem=p)]
    found = written(tmp_path, trials)
    assert len(found) == 12
    numbers = {name: meta["function_id"] for (_, name), (meta, _, _) in found.items()}
    assert sorted(numbers.values()) == [1, 2, 3, 4]
