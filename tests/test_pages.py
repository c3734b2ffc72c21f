"""docs/planner.md: its planners keep the contract, and go by their files."""

from __future__ import annotations

import json
import re
import sys
from importlib import import_module
from pathlib import Path

import pytest

from trajopt.cli import main
from trajopt.planners.testing import check_planner

DOCS = Path(__file__).parents[1] / "docs"
PLANNER = (DOCS / "planner.md").read_text(encoding="utf-8")
FILES = re.compile(r"^```\w+ (\S+)\n(.*?)^```$", re.M | re.S)
MODULES = ("planner", "function", "search")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder but for the page's own files."""
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.findall(PLANNER):
        (tmp_path / name).write_text(text, encoding="utf-8")
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield tmp_path
    for name in MODULES:  # the page's, and nobody else's afterwards
        sys.modules.pop(name, None)


def test_the_planners_of_the_page_keep_the_contract(folder, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(folder))
    modules = {name: import_module(name) for name in MODULES}
    check_planner(modules["planner"].EvenCubic())
    printed = capsys.readouterr().out
    shown = re.search(r"^EvenCubic: .*?^```$", PLANNER, re.M | re.S)
    assert " ".join(printed.split()) == " ".join(shown[0].removesuffix("```").split())
    check_planner(modules["function"].even)
    check_planner(modules["search"].RandomCubic(draws=5))


def test_a_planner_goes_by_its_file(folder, capsys):
    """The exact optimum of the problem is proved; the page's planner is twice as slow."""
    with pytest.raises(SystemExit):
        main(["explain", "six-axis", "--planner", "./planner.py:EvenCubic", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (found["planner"], found["gap"]) == ("EvenCubic", pytest.approx(1.0218, abs=1e-4))
