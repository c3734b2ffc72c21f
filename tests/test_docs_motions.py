"""The page about motions prints what the commands print, and its Python runs."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from trajopt import cli

DOCS = Path(__file__).parents[1] / "docs"
PAGE = (DOCS / "motions.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```text\n\$ trajopt (.*)\n([\s\S]*?)```", PAGE)


@pytest.fixture
def examples(tmp_path, monkeypatch):
    shutil.copytree(DOCS / "examples" / "motions", tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)


@pytest.mark.parametrize(("command", "printed"), BLOCKS[1:4], ids=["judge", "tolerance", "verify"])
def test_the_verdict_is_printed_as_the_page_has_it(examples, capsys, command, printed):
    """But for the sentences about the gap, which other versions of the solvers may change."""
    with pytest.raises(SystemExit) as ended:
        cli.main(command.split())
    assert ended.value.code == 1
    shown = [line.rstrip() for line in capsys.readouterr().out.splitlines()]
    verdict, _, _ = printed.partition("\n- ")
    verdict = verdict.rstrip()
    assert " ".join("\n".join(shown).split()).startswith(" ".join(verdict.split()))


def test_the_python_runs(examples):
    (code,) = re.findall(r"```python\n(.*?)```", PAGE, re.DOTALL)
    names: dict[str, object] = {}
    exec(compile(code, "motions.md", "exec"), names)
    assert names["judged"].gap == pytest.approx(0.425, abs=1e-3)


def test_the_pictures_and_files_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (DOCS / target).exists(), target
