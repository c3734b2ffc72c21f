"""The README's Python runs as printed, and its commands are those that CI runs."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import ModuleType

import pytest

README = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")


def test_the_python_examples_run_in_order(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    module = ModuleType("readme")  # dataclasses look their module up
    monkeypatch.setitem(sys.modules, "readme", module)
    blocks = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    assert len(blocks) == 5
    for block in blocks:
        exec(compile(block, "README.md", "exec"), vars(module))
    printed = capsys.readouterr().out
    gaps = dict(re.findall(r"^(\S+): .* s, ([+-][\d.]+) %$", printed, flags=re.MULTILINE))
    assert len(gaps) == 5
    assert all(float(gap) >= 0 for gap in gaps.values())
    assert "EvenCubic" in printed
    assert vars(module)["fastest"].x[0] == 0


def test_the_commands_that_ci_runs_are_there() -> None:
    for name in ("compare", "tests"):
        assert re.search(rf"<!-- {name} -->\n```bash\n[^`]+\n```", README)


def test_the_pictures_exist() -> None:
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (Path(__file__).parents[1] / picture).is_file(), picture
