"""The README's Python runs as printed, and its commands are those that CI runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trajopt.core.out_of_scope import SCOPE

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_readme_s_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    [block] = re.findall(r"```python\n(.*?)```", README, flags=re.DOTALL)
    exec(compile(block, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    gaps = dict(re.findall(r"^(\S+): .* s, ([+-][\d.]+) %$", printed, flags=re.MULTILINE))
    assert len(gaps) == 5
    assert all(float(gap) >= 0 for gap in gaps.values())


def test_the_commands_that_ci_runs_are_there() -> None:
    for name in ("compare", "tests"):
        assert re.search(rf"<!-- {name} -->\n```bash\n[^`]+\n```", README)


def test_the_pictures_exist() -> None:
    pictures = re.findall(r"!\[.*?\]\((.*?)\)", README)
    pictures += re.findall(r'src(?:set)?="(.*?)"', README)
    assert "docs/_static/race-dark.png" in pictures
    for picture in pictures:
        assert (ROOT / picture).is_file(), picture


def test_the_scope_is_that_of_the_help() -> None:
    [scope] = re.findall(r"<!-- scope -->\n(.*?)<!-- end of scope -->", README, flags=re.DOTALL)
    assert " ".join(scope.replace("**", "").split()) == SCOPE
