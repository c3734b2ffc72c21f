"""The command `trajopt suite list | show | export`: what there is to compare planners on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import cyclopts
from cyclopts import Parameter

if TYPE_CHECKING:
    from trajopt.benchmark.suites.catalogue import Suite
    from trajopt.problem import Problem

app = cyclopts.App(
    name="suite",
    help="List benchmark suites, show their problems, write them as problem files.",
    help_format="plaintext",
)

Name = Annotated[str, Parameter(help="Suite; see `trajopt suite list`.")]
Size = Annotated[
    int | None, Parameter(help="The first N problems; random suites go on as long as one likes.")
]
Json = Annotated[bool, Parameter(negative=(), help="Print one JSON object and nothing else.")]


@app.command(name="list")
def list_(*, json: Json = False) -> int:
    """List the suites: how many problems, of what size, under which limits."""
    from trajopt.benchmark.suites import catalogue as suite

    rows = [_summary(found) for found in suite.suites().values()]
    _print_json({"suites": rows}) if json else _print_list(rows)
    return 0


@app.command
def show(name: Name, /, *, size: Size = None, json: Json = False) -> int:
    """Show a suite's problems, with the digest that keeps old results from mixing with new."""
    from trajopt.benchmark.suites import catalogue as suite

    rows = [_row(problem) for problem in suite.problems(name, size)]
    found = suite.suites()[name]
    head = {"suite": name, "version": found.version, "description": found.description}
    _print_json(head | {"problems": rows}) if json else _print_show(found, rows)
    return 0


@app.command
def export(
    name: Name,
    folder: Annotated[Path, Parameter(help="Folder; made if it is not there.")],
    /,
    *,
    size: Size = None,
    json: Json = False,
) -> int:
    """Write a suite's problems, a file each; files that differ from what is there are refused."""
    from trajopt.benchmark.suites import catalogue as suite

    found = suite.problems(name, size)
    texts = {folder / f"{problem.name}.toml": problem.to_toml() for problem in found}
    new = list(_new(texts))
    folder.mkdir(parents=True, exist_ok=True)
    for file in new:
        file.write_bytes(texts[file].encode())
    if json:
        digests = {str(file): p.digest() for file, p in zip(texts, found, strict=True)}
        _print_json({"suite": name, "files": digests, "written": [str(file) for file in new]})
    else:
        there = f"; {len(texts) - len(new)} were there already" if len(new) < len(texts) else ""
        print(f"{len(new)} problem files written to {folder}{there}")
    return 0


def _new(texts: dict[Path, str]) -> Iterator[Path]:
    """The files that are not there yet; raises before anything is written if one differs."""
    from trajopt.exceptions import InvalidInput

    for file, text in texts.items():
        if not file.exists():
            yield file
        elif file.read_bytes() != text.encode():
            right = "a folder without other files of these names; nothing is written"
            raise InvalidInput("FOLDER", right, value=str(file))


def _summary(suite: Suite) -> dict[str, Any]:
    from trajopt.problem import LIMIT_NAMES

    rows = [_row(problem) for problem in suite.problems()]
    joints, waypoints = ([row[key] for row in rows] for key in ("joints", "waypoints"))
    return {
        "name": suite.name,
        "description": suite.description,
        "version": suite.version,
        "problems": len(rows),
        "joints": [min(joints), max(joints)],
        "waypoints": [min(waypoints), max(waypoints)],
        "limits": [name for name in LIMIT_NAMES if any(name in row["limits"] for row in rows)],
    }


def _row(problem: Problem) -> dict[str, Any]:
    from trajopt.problem import LIMIT_NAMES

    limits = [name for name in LIMIT_NAMES if problem.has(name)]
    size = {"joints": problem.joints, "waypoints": len(problem.waypoints)}
    return {"name": problem.name, **size, "limits": limits, "digest": problem.digest()}


def _print_list(rows: list[dict[str, Any]]) -> None:
    from rich.console import Console

    table = _table("suite", "problems", "joints", "waypoints", "version", right=range(1, 5))
    table.add_column("also limited", overflow="fold")
    for row in rows:
        ends = [f"{low}–{high}" if low < high else str(low) for low, high in
                (row["joints"], row["waypoints"])]  # fmt: skip
        name = f"[bold]{row['name']}[/bold]"
        table.add_row(name, str(row["problems"]), *ends, str(row["version"]), _besides(row))
    console = Console(highlight=False)
    console.print(table)
    console.print("\nvelocity and acceleration are always limited")
    for row in rows:
        console.print(f"[bold]{row['name']}[/bold]: {row['description']}")


def _print_show(suite: Suite, rows: list[dict[str, Any]]) -> None:
    from rich.console import Console

    table = _table("problem", "joints", "waypoints", right=(1, 2))
    table.add_column("also limited")
    table.add_column("digest", no_wrap=True)
    for row in rows:
        sizes = str(row["joints"]), str(row["waypoints"])
        table.add_row(row["name"], *sizes, _besides(row), row["digest"][:12])
    console = Console(highlight=False)
    console.print(table)
    count = f"{len(rows)} problem{'s' * (len(rows) > 1)}"
    console.print(f"{count}, version {suite.version}: {suite.description}")


def _table(*columns: str, right: Any) -> Any:
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for index, column in enumerate(columns):
        table.add_column(column, justify="right" if index in right else "left", no_wrap=True)
    return table


def _besides(row: dict[str, Any]) -> str:
    return ", ".join(limit for limit in row["limits"] if limit not in ("velocity", "acceleration"))


def _print_json(table: dict[str, Any]) -> None:
    from trajopt.cli import tables

    print(tables.as_json(table))
