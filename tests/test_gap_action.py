"""The gap table's action; in the long test as GitHub runs it: its steps in a repository."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from soaks.action import ACTION, Changed, called_longer
from trajopt import Problem, Solution
from trajopt.planners.planner import Planner

yaml = pytest.importorskip("yaml")

PLANNER = """
from dataclasses import dataclass, replace

from trajopt.planners.planner import Planner
from trajopt.planners.registry import load


@dataclass(frozen=True)
class Mine(Planner):
    def solve(self, problem, *, seed=0):
        solution = load("ruckig-stop").solve(problem)
        return replace(solution, trajectory=solution.trajectory.dilated({longer}))
"""
GH = """#!/usr/bin/env bash
printf '%s\\n' "$*" > "$RUNNER_TEMP/called"
cp "${{@: -1}}" "$RUNNER_TEMP/comment.md"
""".replace("{{", "{").replace("}}", "}")


def committed(folder: Path, longer: float) -> str:
    """Commit the planner, whose motions take longer by a factor; return the commit."""
    (folder / "my_planner.py").write_text(PLANNER.format(longer=longer))
    git = ["git", "-c", "user.name=A", "-c", "user.email=a@b.c"]
    subprocess.run(["git", "add", "."], cwd=folder, check=True)
    subprocess.run([*git, "commit", "-qm", "one"], cwd=folder, check=True)
    head = ["git", "rev-parse", "HEAD"]
    return subprocess.run(head, cwd=folder, check=True, capture_output=True, text=True).stdout[:-1]


def filled(value: str, known: Mapping[str, str]) -> str:
    """Put values in the place of GitHub's expressions."""
    return re.sub(r"\$\{\{ (.*?) \}\}", lambda found: known[found[1]], value)


@pytest.mark.long
def test_a_pull_request_that_takes_1_percent_longer_gets_its_table_and_fails(
    tmp_path: Path,
) -> None:
    repository, temporary, programs = (tmp_path / own for own in ("mine", "temp", "bin"))
    for folder in (repository, temporary, programs):
        folder.mkdir()
    (programs / "gh").write_text(GH)
    (programs / "gh").chmod(0o755)
    subprocess.run(["git", "init", "-q"], cwd=repository, check=True)
    base = committed(repository, 1.0)
    committed(repository, 1.01)

    action = yaml.safe_load((ACTION / "action.yml").read_text())
    given = {"planner": "./my_planner.py:Mine", "problems": "one-joint", "seeds": "1"}
    inputs = {name: own.get("default", "") for name, own in action["inputs"].items()} | given
    known = {f"inputs.{name}": value for name, value in inputs.items()}
    known |= {
        "github.event.pull_request.base.sha": base,
        "github.event.pull_request.number": "7",
        "github.token": "secret",
    }
    output, summary = temporary / "output", temporary / "summary"
    environment = os.environ | {
        "PATH": f"{programs}:{Path(sys.executable).parent}:{os.environ['PATH']}",
        "GITHUB_ACTION_PATH": str(ACTION),
        "GITHUB_OUTPUT": str(output),
        "GITHUB_STEP_SUMMARY": str(summary),
        "RUNNER_TEMP": str(temporary),
    }
    codes = {}
    for step in action["runs"]["steps"][1:]:  # the first installs the package
        own = {name: filled(value, known) for name, value in step["env"].items()}
        shell = ["bash", "--noprofile", "--norc", "-eo", "pipefail", "-c", step["run"]]
        done = subprocess.run(shell, cwd=repository, env=environment | own, check=False)
        codes[step["name"]] = done.returncode
        if "id" in step:
            for name, value in re.findall(r"(.*)=(.*)", output.read_text()):
                known[f"steps.{step['id']}.outputs.{name}"] = value
    *others, last = codes.values()
    assert not any(others), codes
    assert last == 1
    comment = (temporary / "comment.md").read_text()
    assert re.search(r"\| one-joint \| `.*` \| .* \| .* \| \+1\.00 % \| \*\*longer\*\* \|", comment)
    assert summary.read_text() == comment
    assert (temporary / "called").read_text().startswith("pr comment 7 ")


@pytest.mark.long
def test_noise_is_not_called_longer() -> None:
    """One of the forty runs of `python tests/soak.py action`."""
    assert not called_longer(Changed(0), Changed(1))


def test_answers_that_are_lost_are_called_longer() -> None:
    class Lost(Changed):
        def solve(self, problem: Problem, *, seed: int = 0) -> Solution:
            raise ValueError("a change that breaks it")

    assert issubclass(Lost, Planner)
    assert called_longer(Changed(0), Lost(0), ["six-axis"], 2)
