"""The README's Python runs as printed, and its commands are those that CI runs."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trajopt import compare

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(page: str) -> list[str]:
    """Return the Python blocks of a page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)


def test_the_readme_s_example_runs(capsys: pytest.CaptureFixture[str]) -> None:
    [block] = blocks("README.md")
    exec(compile(block, "README.md", "exec"), {})
    printed = capsys.readouterr().out
    gaps = dict(re.findall(r"^(\S+): .* s, ([+-][\d.]+) %$", printed, flags=re.MULTILINE))
    assert len(gaps) == 5
    assert all(float(gap) >= 0 for gap in gaps.values())


def test_the_kinematics_example_runs() -> None:
    [block] = blocks("docs/kinematics.md")
    names: dict[str, object] = {}
    exec(compile(block, "docs/kinematics.md", "exec"), names)
    assert names["again"].joints == 6


def test_the_fastest_motion_is_read_from_a_results_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    compare(["one-joint"], ["ruckig-stop"], "my-results", jobs=1)
    names: dict[str, object] = {}
    for block in blocks("docs/files.md"):
        exec(compile(block, "docs/files.md", "exec"), names)
    assert names["fastest"].x[0] == 0


def test_the_commands_that_ci_runs_are_there() -> None:
    for name in ("compare", "tests"):
        assert re.search(rf"<!-- {name} -->\n```bash\n[^`]+\n```", README)


def test_the_pictures_exist() -> None:
    for picture in re.findall(r"!\[.*?\]\((.*?)\)", README):
        assert (ROOT / picture).is_file(), picture
