"""docs/robots.md and docs/planner.md: what they print still comes out, in an empty folder."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
from importlib import import_module
from pathlib import Path

import pytest

from trajopt.cli import main
from trajopt.planners.testing import check_planner

DOCS = Path(__file__).parents[1] / "docs"
ROBOTS = (DOCS / "robots.md").read_text(encoding="utf-8")
PLANNER = (DOCS / "planner.md").read_text(encoding="utf-8")
FILES = re.compile(r"^```\w+ (\S+)\n(.*?)^```$", re.M | re.S)
# A command and what it printed; what is piped on shows a part of that.
COMMANDS = re.compile(r"^\$ trajopt ([^|\n]+?)(?: \| [^\n]*)?\n((?:(?!\$ |```).*\n)*)", re.M)
CERTIFIED = re.compile(r"certified +([\d.]+) s")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty folder but for the page's own files."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    shutil.copy(DOCS / "examples" / "ur5e" / "ur5e.urdf", tmp_path)
    for name, text in FILES.findall(ROBOTS) + FILES.findall(PLANNER):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


def test_the_commands_for_a_robot_print_what_the_page_says(folder, capsys):
    commands = COMMANDS.findall(ROBOTS)
    assert len(commands) == 10
    for command, shown in commands:
        if command.endswith(("motion.png", "0.008")):
            continue  # the same motion again, as a picture and as samples
        with pytest.raises(SystemExit) as ended:
            main(shlex.split(command))
        out, err = capsys.readouterr()
        failed = shown.startswith("trajopt: ")
        assert ended.value.code == (2 if failed else 0), command
        if failed:
            assert " ".join(err.split()) == " ".join(shown.split())
        for own, said in zip(CERTIFIED.findall(out), CERTIFIED.findall(shown), strict=False):
            assert float(own) == pytest.approx(float(said), rel=1e-4)
    assert (folder / "motion.yaml").is_file()


def test_the_planners_of_the_page_keep_the_contract(folder, monkeypatch, capsys):
    monkeypatch.syspath_prepend(str(folder))
    modules = {name: import_module(name) for name in ("planner", "function")}
    for name in modules:  # the page's, and nobody else's afterwards
        monkeypatch.delitem(sys.modules, name)
    check_planner(modules["planner"].EvenCubic())
    printed = capsys.readouterr().out
    shown = re.search(r"^EvenCubic: .*?^```$", PLANNER, re.M | re.S)
    assert " ".join(printed.split()) == " ".join(shown[0].removesuffix("```").split())
    check_planner(modules["function"].even)
