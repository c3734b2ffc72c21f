"""Draw mutants of a folder's code and name those that the tests do not notice.

    python tests/mutants.py trajopt/judging tests/judging           # 40 mutants
    python tests/mutants.py trajopt/core tests/core --count 10 --seed 7

A mutant is a copy of the packages in which one operator, number, truth value or function is
replaced. The tests run on it until one fails. A mutant that survives is printed: a test is missing
there, or the line is not needed, or the mutant is equivalent. Exit code 1 if one survived.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("trajopt", "baselines", "experiments")
TIMEOUT_S = 600.0  # of the tests on a mutant: one that hangs is noticed

# What an operator or a name becomes.
COMPARED = {"<": "<=", "<=": "<", ">": ">=", ">=": ">", "==": "!=", "!=": "==", "is": "is not"}
COMPARED |= {"is not": "is", "in": "not in", "not in": "in"}
COMPUTED = {"+": "-", "-": "+", "*": "/", "/": "*", "//": "*", "%": "*", "**": "*", "&": "|"}
COMPUTED |= {"|": "&", "@": "*", "and": "or", "or": "and"}
NAMED = {"any": "all", "all": "any", "min": "max", "max": "min", "isfinite": "isnan"}
NAMED |= {"minimum": "maximum", "maximum": "minimum", "floor": "ceil", "True": "False"}
NAMED |= {"False": "True"}


class Change(NamedTuple):
    """Replace the characters from `start` to `end` of a file by a text."""

    file: Path
    start: int
    end: int
    text: str

    def applied(self, source: str) -> str:
        """Return the source with the change."""
        return source[: self.start] + self.text + source[self.end :]

    def said(self, source: str) -> str:
        """Name the place, and the line before and after."""
        line = source.count("\n", 0, self.start)
        before = source.splitlines()[line].strip()
        after = self.applied(source).splitlines()[line].strip()
        return f"{self.file}:{line + 1}\n    {before}\n    {after}"


def changes(file: Path) -> Iterator[Change]:
    """Yield every change that a file's code allows: not of annotations and docstrings."""
    source = (ROOT / file).read_text(encoding="utf-8")
    starts = [0]
    for line in source.splitlines(keepends=True):
        starts.append(starts[-1] + len(line.encode()))
    data = source.encode()

    def place(line: int, column: int) -> int:
        return len(data[: starts[line - 1] + column].decode())

    def begin(node: ast.expr) -> int:
        return place(node.lineno, node.col_offset)

    def end(node: ast.expr) -> int:
        return place(node.end_lineno or 0, node.end_col_offset or 0)

    def between(left: ast.expr, right: ast.expr, known: dict[str, str]) -> Iterator[Change]:
        start, stop = end(left), begin(right)
        sign = source[start:stop].strip(" \n()")
        if sign in known and source.count(sign, start, stop) == 1:
            at = source.index(sign, start, stop)
            yield Change(file, at, at + len(sign), known[sign])

    for node in _code(ast.parse(source)):
        if isinstance(node, ast.Compare):
            operands = [node.left, *node.comparators]
            for left, right in pairwise(operands):
                yield from between(left, right, COMPARED)
        elif isinstance(node, ast.BinOp):
            yield from between(node.left, node.right, COMPUTED)
        elif isinstance(node, ast.BoolOp):
            yield from between(node.values[0], node.values[1], COMPUTED)
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub | ast.Invert):
            sign = "not" if isinstance(node.op, ast.Not) else "-"  # or ~
            yield Change(file, begin(node), begin(node) + len(sign), "")
        elif isinstance(node, ast.Constant) and type(node.value) in (int, float, bool):
            text = str(not node.value if isinstance(node.value, bool) else node.value + 1)
            yield Change(file, begin(node), end(node), text)
        elif isinstance(node, ast.Name | ast.Attribute):
            name = node.id if isinstance(node, ast.Name) else node.attr
            if name in NAMED:
                yield Change(file, end(node) - len(name), end(node), NAMED[name])


def _code(tree: ast.AST) -> Iterator[ast.AST]:
    """Yield the nodes of a tree that run: no annotations."""
    yield tree
    for name, value in ast.iter_fields(tree):
        if name in ("annotation", "returns"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if isinstance(child, ast.AST):
                yield from _code(child)


def noticed(change: Change | None, tests: list[str]) -> bool:
    """Return whether a test fails on a mutant; on the code as it is, without a change."""
    with tempfile.TemporaryDirectory(prefix="mutant-") as place:
        folder = Path(place)
        for own in ROOT.iterdir():
            if own.name in PACKAGES:
                shutil.copytree(
                    own, folder / own.name, ignore=shutil.ignore_patterns("__pycache__")
                )
            elif not own.name.startswith("."):
                (folder / own.name).symlink_to(own)
        if change is not None:
            file = folder / change.file
            file.write_text(change.applied(file.read_text(encoding="utf-8")), encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", *tests]
        try:
            done = subprocess.run(
                command,
                cwd=folder,
                env=os.environ | {"PYTHONPATH": str(folder)},
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                timeout=TIMEOUT_S,
                check=False,
            )
        except subprocess.TimeoutExpired:
            return True
        return done.returncode != 0


def main() -> int:
    """Draw mutants, run the tests on each, print the survivors."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path, help="of the package, or a file: trajopt/judging")
    parser.add_argument("tests", nargs="+", help="files and folders of tests")
    parser.add_argument("--count", type=int, default=40, help="mutants")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    asked = parser.parse_args()
    where = (ROOT / asked.folder).resolve()
    files = [where] if where.is_file() else sorted(where.rglob("*.py"))
    every = [change for file in files for change in changes(file.relative_to(ROOT))]
    drawn = random.Random(asked.seed).sample(every, min(asked.count, len(every)))
    if noticed(None, asked.tests):
        print("the tests fail on the code as it is", file=sys.stderr)
        return 2
    survivors = 0
    for number, change in enumerate(drawn, start=1):
        if not noticed(change, asked.tests):
            survivors += 1
            print(f"survived: {change.said((ROOT / change.file).read_text())}", flush=True)
        print(
            f"{number} of {len(drawn)} mutants, {survivors} survived", file=sys.stderr, flush=True
        )
    print(f"{survivors} of {len(drawn)} mutants survived (of {len(every)} possible)")
    return 1 if survivors else 0


if __name__ == "__main__":
    sys.exit(main())
