"""The page about best known answers prints what the commands print, but for the numbers."""

from __future__ import annotations

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from trajopt import cli

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGE = (DOCS / "best-known.md").read_text(encoding="utf-8")
BLOCKS = re.findall(r"```text\n\$ ([\s\S]*?)```", PAGE)
PROOF = "python check_proof.py < "


def words(text):
    """Without numbers: a better record changes those."""
    return re.sub(r"[+-]?\d[\d.]*", "#", " ".join(text.split()))


@pytest.mark.parametrize(
    "block",
    [block for block in BLOCKS if not block.startswith(PROOF)],
    ids=["list", "verify", "propose"],
)
def test_the_commands_print_what_the_page_has(block, capsys, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    *before, last = block.split("$ ")
    for command in before:
        with pytest.raises(SystemExit):
            cli.main(shlex.split(command)[1:])
    capsys.readouterr()
    command, _, printed = last.partition("\n")
    with pytest.raises(SystemExit):
        cli.main(shlex.split(command)[1:])
    assert words(capsys.readouterr().out) == words(printed)


def test_the_script_prints_what_the_page_has():
    (block,) = [block for block in BLOCKS if block.startswith(PROOF)]
    command, _, printed = block.partition("\n")
    file = ROOT / command.removeprefix(PROOF)
    script = DOCS / "examples" / "best-known" / "check_proof.py"
    with file.open() as record:
        ran = subprocess.run([sys.executable, script], stdin=record, capture_output=True, text=True)
    assert ran.returncode == 0
    assert words(ran.stdout) == words(printed)


def test_the_files_exist():
    for target in re.findall(r"\]\(([^)#]+)\)", PAGE):
        assert (DOCS / target).exists(), target
