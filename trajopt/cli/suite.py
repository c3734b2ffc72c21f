"""`trajopt suite list | show | export`: suites of problems to compare planners on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import cyclopts
from cyclopts import Parameter
from rich.text import Text

from trajopt.benchmark.suites import catalogue
from trajopt.benchmark.suites.suite import Suite
from trajopt.cli import console, examples
from trajopt.cli.parameters import Json, whole_number
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import KINDS
from trajopt.core.problem import Problem

app = cyclopts.App(
    name="suite",
    help="List benchmark suites, show their problems, write them as problem files.",
    help_format="plaintext",
    help_epilogue=examples.in_words("suite"),
)

Name = Annotated[str, Parameter(help="Suite; see `trajopt suite list`.")]
Size = Annotated[
    int | None,
    whole_number("The first N problems; random suites go on as long as one likes.", most=1_000_000),
]


@app.command(name="list")
def list_(*, json: Json = False) -> int:
    """List the suites: how many problems, of what size, under which limits."""
    rows = [_summary(suite) for suite in catalogue.suites().values()]
    if json:
        console.print_json({"suites": rows})
    else:
        _print_list(rows)
    return 0


@app.command
def show(name: Name, /, *, size: Size = None, json: Json = False) -> int:
    """Show a suite's problems, with the digest that keeps old results from mixing with new."""
    rows = [_row(problem) for problem in catalogue.problems(name, size)]
    suite = catalogue.suites()[name]
    if json:
        head = {"suite": name, "version": suite.version, "description": suite.description}
        console.print_json(head | {"problems": rows})
    else:
        _print_show(suite, rows)
    return 0


@app.command
def export(name: Name, folder: Path, /, *, size: Size = None, json: Json = False) -> int:
    """Write a suite's problems, a file each; files that differ from what is there are refused.

    Args:
        folder: Folder; made if it is not there.
    """
    problems = {folder / f"{p.name}.toml": p for p in catalogue.problems(name, size)}
    texts = {file: problem.to_toml() for file, problem in problems.items()}
    missing = list(_missing(texts))
    folder.mkdir(parents=True, exist_ok=True)
    for file in missing:
        file.write_bytes(texts[file].encode())
    if json:
        digests = {str(file): problem.digest() for file, problem in problems.items()}
        console.print_json({"suite": name, "files": digests, "written": missing})
        return 0
    said = f"{len(missing)} problem files written to {folder}"
    if len(missing) < len(texts):
        said += f"; {len(texts) - len(missing)} were there already"
    console.line(said)
    return 0


def _missing(texts: dict[Path, str]) -> Iterator[Path]:
    """Yield the files that do not exist; raise if a file exists with another text."""
    for file, text in texts.items():
        if not file.exists():
            yield file
        elif file.read_bytes() != text.encode():
            right = "a folder without other files of these names; nothing is written"
            raise InvalidInput("FOLDER", right, value=str(file))


def _summary(suite: Suite) -> dict[str, Any]:
    rows = [_row(problem) for problem in suite.problems()]
    joints = [row["joints"] for row in rows]
    waypoints = [row["waypoints"] for row in rows]
    limited = {limit for row in rows for limit in row["limits"]}
    return {
        "name": suite.name,
        "description": suite.description,
        "version": suite.version,
        "problems": len(rows),
        "joints": [min(joints), max(joints)],
        "waypoints": [min(waypoints), max(waypoints)],
        "limits": [key for key in KINDS if key in limited],
    }


def _row(problem: Problem) -> dict[str, Any]:
    return {
        "name": problem.name,
        "joints": problem.joints,
        "waypoints": len(problem.waypoints),
        "limits": list(problem.limits.kinds),
        "digest": problem.digest(),
    }


def _print_list(rows: Sequence[dict[str, Any]]) -> None:
    numbers = ("problems", "joints", "waypoints", "version")
    table = console.table("suite", *numbers, "also limited", numbers=numbers)
    for row in rows:
        table.row(
            console.bold(row["name"]),
            row["problems"],
            _range(*row["joints"]),
            _range(*row["waypoints"]),
            row["version"],
            _besides(row),
        )
    console.OUT.print(table)
    console.paragraph("\nvelocity and acceleration are always limited")
    for row in rows:
        name = console.bold(row["name"])
        console.OUT.print(Text.assemble(name, ": ", row["description"]))


def _print_show(suite: Suite, rows: Sequence[dict[str, Any]]) -> None:
    sizes = ("joints", "waypoints")
    table = console.table("problem", *sizes, "also limited", "digest", numbers=sizes)
    for row in rows:
        digest = row["digest"][:12]
        sizes = (row["joints"], row["waypoints"])
        table.row(row["name"], *sizes, _besides(row), digest)
    console.OUT.print(table)
    count = "1 problem" if len(rows) == 1 else f"{len(rows)} problems"
    console.paragraph(f"{count}, version {suite.version}: {suite.description}")


def _range(low: int, high: int) -> str:
    return f"{low}–{high}" if low < high else str(low)


def _besides(row: dict[str, Any]) -> str:
    """Name the limits besides velocity and acceleration, which every problem has."""
    return ", ".join(KINDS[key].short for key in row["limits"][2:])
