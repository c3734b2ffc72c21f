"""What docs/how-to/ioh-and-coco.md writes, read by the programs that it is for.

They run where they are installed: `.ci/run` has them beside mealpy, in an environment of its own.
"""

from __future__ import annotations

import re
import warnings
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).parents[1] / "docs" / "how-to" / "ioh-and-coco.md"
CODE = re.compile(r"^```python\n(.*?)^```$", re.M | re.S)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """The names of the page's code, run in a folder of its own but for the block of `ioh`."""
    folder = tmp_path_factory.mktemp("histories")
    names: dict = {}
    blocks = [code for code in CODE.findall(PAGE.read_text(encoding="utf-8")) if "ioh." not in code]
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        for code in blocks:
            exec(compile(code, PAGE.name, "exec"), names)
    return folder, names


def first_within(runs, target):
    """Evaluations of each run until its best is at most this, s; NaN if never."""
    spent = []
    for run in runs:
        reached = run[run[:, 1] <= target, 0]
        spent.append(reached[0] if len(reached) else np.nan)
    return spent


def test_iohinspector_reads_the_histories(written):
    inspector = pytest.importorskip("iohinspector")
    folder, names = written
    for planner, runs in names["histories"].items():
        manager = inspector.DataManager()
        manager.add_folder(str(folder / "ioh-histories" / planner))
        assert manager.overview["algorithm_name"].unique().to_list() == [planner]
        table = manager.load(monotonic=False, include_meta_data=True)
        for number, run in enumerate(runs, 1):
            own = table.filter(table["data_id"] == table["data_id"].unique().sort()[number - 1])
            np.testing.assert_allclose(own["evaluations"].to_numpy(), run[:, 0])
            np.testing.assert_allclose(own["raw_y"].to_numpy(), run[:, 1], rtol=1e-9)


def test_cocopp_reads_the_histories(written):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it asks for an archive in the network, and for 15 runs
        cocopp = pytest.importorskip("cocopp")
        folder, names = written
        for planner, runs in names["histories"].items():
            (data,) = cocopp.pproc.DataSetList(str(folder / "coco-histories" / planner))
            assert (data.algId, data.dim, data.maxevals.tolist()) == (planner, 3, [3000.0] * 3)
            gaps = [run[-1, 1] - names["BEST"] for run in runs]
            np.testing.assert_allclose(data.finalfunvals, gaps, rtol=1e-6)
            for target in (0.1, 0.01):  # two of its targets: 10 to a whole fifth
                spent = data.detEvals([target])[0]
                np.testing.assert_allclose(spent, first_within(runs, names["BEST"] + target))


def test_ioh_logs_a_wrapped_problem(tmp_path, monkeypatch):
    ioh = pytest.importorskip("ioh")
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    (code,) = [code for code in CODE.findall(PAGE.read_text(encoding="utf-8")) if "ioh." in code]
    exec(compile(code, PAGE.name, "exec"), names)
    assert isinstance(names["problem"].meta_data, ioh.MetaData)
    assert names["f"].evaluations >= 600
    (log,) = Path("ioh-random").rglob("*.dat")
    text = log.read_text(encoding="utf-8")
    assert text.count("evaluations raw_y") == 3
    first = text.splitlines()[1].split()
    drawn = np.random.default_rng(0).uniform(names["f"].low, names["f"].high)
    assert float(first[1]) == pytest.approx(names["f"](drawn), rel=1e-9)
