"""Every forged place is named, each kind of edit is made somewhere, and the soak notices a miss."""

from __future__ import annotations

import h5py
import pandas as pd
import pytest

from soaks import forged_tables
from trajopt.benchmark.store import results_file
from trajopt.benchmark.store.results_file import seal


@pytest.fixture(scope="module")
def template(tmp_path_factory):
    return forged_tables.template(tmp_path_factory.mktemp("honest"))


def test_each_edit_is_made_at_every_place_of_its_kind(template, tmp_path):
    path = tmp_path / "honest.h5"
    path.write_bytes(template[0])
    with h5py.File(path) as file:
        made = pd.DataFrame(forged_tables.forgeries(file))
        columns = []
        file.visititems(lambda name, own: columns.append(isinstance(own, h5py.Dataset)))
    places = made.groupby(["of", "edit"])["place"].nunique()
    assert (places["column"] == sum(columns)).all()
    assert (places["group"] == len(columns) - sum(columns) + 1).all()  # and the root
    assert (places["group or column"] == len(columns)).all()
    assert sum(columns) > 50


def test_a_few_of_them_are_named(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(forged_tables, "QUICK", 401)
    forged_tables.main(tmp_path, quick=True)
    assert "forgeries named or refused" in capsys.readouterr().out
    table = pd.read_csv(tmp_path / "forged-tables.csv")
    assert table["held"].sum() == 0
    assert table["places"].iloc[-1] >= 5


def test_a_forgery_that_is_believed_is_an_error(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(forged_tables, "QUICK", 1201)
    monkeypatch.setattr(results_file, "differences", lambda *_: [])
    with pytest.raises(SystemExit, match="1"):
        forged_tables.main(tmp_path, quick=True)
    assert "held: " in capsys.readouterr().out


def test_the_honest_file_holds_and_forged_texts_do_not(template, tmp_path):
    content, known = template
    path = tmp_path / "results.h5"
    path.write_bytes(content + seal(content))
    assert forged_tables.verdict(path, "", known) == "held"
    for edit, change in forged_tables.OF_TEXTS.items():
        forgery = forged_tables.Forgery("", edit, "", lambda f, c=change: c(f, ""), "")
        row = forged_tables.attempt(content, forgery, path, known)
        assert row is not None
        assert row["said"] in ("named", "refused"), edit
