"""`--help`: two examples of every command, which a page runs; and what a command alone says."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trajopt.cli import main
from trajopt.cli.app import _COMMANDS
from trajopt.cli.examples import EXAMPLES

PAGE = (Path(__file__).parents[2] / "docs" / "commands.md").read_text(encoding="utf-8")
RUN = [line.partition("  #")[0].strip() for line in PAGE.splitlines()]  # by tests/test_blocks.py
NUMERIC = ("--seed", "--acceleration", "--via-tolerance", "--within")  # once hidden by their groups


def test_every_command_has_two_examples_that_the_page_runs():
    assert set(EXAMPLES) == set(_COMMANDS)
    for command, lines in EXAMPLES.items():
        assert len(lines) == 2
        for line in lines:
            assert line.startswith(f"trajopt {command}")
            assert line in RUN


@pytest.mark.parametrize("command", EXAMPLES)
def test_help_ends_with_the_examples(command, capsys):
    with pytest.raises(SystemExit) as ended:
        main([command, "--help"])
    printed = capsys.readouterr().out
    assert not ended.value.code
    assert all(line in printed for line in EXAMPLES[command])


def test_no_option_is_lost_in_the_groups(capsys):
    """Every keyword of a command's function stands in its help."""
    printed = ""
    for command in ("plan", "judge", "explain", "prove", "compare"):
        with pytest.raises(SystemExit):
            main([command, "--help"])
        printed += capsys.readouterr().out
    for flag in NUMERIC:
        assert re.search(rf"{flag}\b", printed)


@pytest.mark.parametrize("kind", ["planners", "problems", "robots", "limits"])
def test_one_list_is_a_part_of_all(kind, capsys):
    printed = []
    for asked in (["list"], ["list", kind]):
        with pytest.raises(SystemExit):
            main(asked)
        printed.append(capsys.readouterr().out.strip())
    assert printed[1] in printed[0]
