"""Round trips of CSV and Parquet."""

import csv
import json
import sys
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest

from trajopt import Limits, Problem, Relation, Solution, Status
from trajopt.benchmark.provenance import PACKAGES
from trajopt.benchmark.trial import trials_of
from trajopt.core.exceptions import MissingBackend
from trajopt.core.trajectory import Trajectory
from trajopt.planners.planner import Planner
from trajopt.planners.registry import load
from trajopt.views.export import tables
from trajopt.views.results import Results

WAYPOINTS = [[0.0, 0.1], [0.4, 0.0], [1.0, 0.3], [1.5, 1.0]]
PROBLEM = Problem(WAYPOINTS, Limits([1, 2], [2, 3]), "two joints")
OTHER = Problem(WAYPOINTS, Limits([1, 2], [9, 9]), 'A/b "Prüfung", ①')
NAN, INF = np.nan, np.inf


@dataclass(frozen=True)
class Searching(Planner):
    """Quintics of `segment_time`; too short a one is dilated by the verifier. Keeps `history`."""

    segment_time: float = 2.0
    history: tuple = ((1, NAN), (3, 9.0), (5, 9.0), (8, 6.0), (10, 6.0))
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
    return [trials_of(Searching(**options), problem, [seed], name)[0] for seed in seeds]


def mixed():
    """All there is: references, failures, text that CSV must quote, texts that look like gaps."""
    exact = trials_of(load("exact:starts=1"), PROBLEM, [0], "exact")
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
    tables.write_csv(results, tmp_path / "new" / "t.csv")
    back = read_csv(tmp_path / "new" / "t.csv", table)
    pd.testing.assert_frame_equal(back, table, check_exact=True)


NASTY = ["=HYPERLINK(1)", "+1", "-2+3", "@SUM(A1)", "\tx", "\r=1", "\n=1", "＝1", "'quoted"]


@pytest.mark.parametrize("name", NASTY)
def test_no_spreadsheet_runs_a_cell_and_numbers_stay_numbers(tmp_path, name):
    problem = replace(PROBLEM, name=name)
    trials = [*run(name, problem=problem, segment_time=-1, message=name), *run("exact")]
    tables.write_csv(Results(trials), tmp_path / "t.csv")
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
    tables.write_csv(Results([exact, faster]), tmp_path / "t.csv")
    gaps = pd.read_csv(tmp_path / "t.csv")["gap"]
    assert gaps.tolist() == [0, pytest.approx(-1 / 3)]
    assert ",-0.333" in (tmp_path / "t.csv").read_text("utf-8")


def test_parquet_comes_back_as_the_frame_it_was_types_included(tmp_path, results):
    pq = pytest.importorskip("pyarrow.parquet")
    table = tables.table(results)
    tables.write_parquet(results, tmp_path / "t.parquet")
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
        table.loc[table["digest"] == PROBLEM.digest(), "gap"], expected, rtol=1e-12
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
    write, read = {
        "csv": (tables.write_csv, pd.read_csv),
        "parquet": (tables.write_parquet, pd.read_parquet),
    }[to]
    write(Results([]), tmp_path / "t")
    back = read(tmp_path / "t")
    assert len(back) == 0
    assert {"id", "gap", "options", "started"} <= set(back)


def test_parquet_without_pyarrow_says_how_to_mend_it(tmp_path, results, monkeypatch):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(MissingBackend, match=r"mintime\[parquet\]"):
        tables.write_parquet(results, tmp_path / "t.parquet")
    assert list(tmp_path.iterdir()) == []
