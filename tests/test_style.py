"""How much a line holds: one thought each, in every module of the library, measured.

The measure is expression nodes (`ast.expr`) per line of code; docstrings, comments and blank lines
are no code. Seven codebases of the field have means of 2.8 to 4.4.
"""

from __future__ import annotations

import ast
import io
import tokenize
from dataclasses import dataclass
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = ("trajopt", "baselines", "experiments")

# A line holds one thought: what seven codebases of the field keep, and no more.
MEAN_NODES_PER_LINE = 4.5
MODULE_NODES_PER_LINE = 6.5
PACKED_ASSIGNMENTS = 0
UNFORMATTED_STATEMENTS = 0

WORST_SHOWN = 15
_NO_CODE = {
    tokenize.COMMENT,
    tokenize.DEDENT,
    tokenize.ENCODING,
    tokenize.ENDMARKER,
    tokenize.INDENT,
    tokenize.NEWLINE,
    tokenize.NL,
}


@dataclass(frozen=True)
class Module:
    path: Path
    nodes: int
    lines: int
    packed: tuple[int, ...]
    unformatted: tuple[int, ...]

    @property
    def density(self) -> float:
        return self.nodes / max(1, self.lines)


def docstrings(tree):
    """The first lines of all docstrings."""
    owners = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, owners) and ast.get_docstring(node, clean=False) is not None:
            found.add(node.body[0].lineno)
    return found


def code_lines(text, tree):
    """The lines on which a token stands that is neither a comment nor part of a docstring."""
    starts = docstrings(tree)
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        is_docstring = token.type == tokenize.STRING and token.start[0] in starts
        if token.type not in _NO_CODE and not is_docstring:
            lines.add(token.start[0])
            if token.end[0] > token.start[0]:
                lines.update(range(token.start[0], token.end[0] + 1))
    return lines


def calls(node):
    return any(isinstance(part, ast.Call) for part in ast.walk(node))


def packed_assignments(tree):
    """`a, b = f(x), g(y)`: two thoughts in a line."""
    for node in ast.walk(tree):
        if not isinstance(node, ast.Assign) or not isinstance(node.targets[0], ast.Tuple):
            continue
        if isinstance(node.value, ast.Tuple) and calls(node.value):
            yield node.lineno


def unformatted_statements(text, tree):
    """Statements that the formatter must leave alone, but for tables of literals."""
    marked = {n for n, line in enumerate(text.splitlines(), 1) if "# fmt: skip" in line}
    if not marked:
        return
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt) and node.end_lineno in marked:
            marked.discard(node.end_lineno)
            value = getattr(node, "value", None)
            if value is None or calls(value):
                yield node.end_lineno


def measured(path):
    text = path.read_text(encoding="utf-8")
    tree = ast.parse(text)
    return Module(
        path=path.relative_to(ROOT),
        nodes=sum(isinstance(node, ast.expr) for node in ast.walk(tree)),
        lines=len(code_lines(text, tree)),
        packed=tuple(packed_assignments(tree)),
        unformatted=tuple(unformatted_statements(text, tree)),
    )


@cache
def modules():
    """Every module of the library, measured when the first test asks."""
    paths = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
    return [measured(path) for path in paths]


def listed(attribute):
    rows = [f"{m.path}:{line}" for m in modules() for line in getattr(m, attribute)]
    return len(rows), "\n".join(rows)


def test_a_line_holds_one_thought():
    found = modules()
    worst = sorted(found, key=lambda module: -module.density)[:WORST_SHOWN]
    table = "\n".join(f"{module.density:5.2f}  {module.path}" for module in worst)
    mean = sum(module.nodes for module in found) / sum(module.lines for module in found)
    print(f"expression nodes per line of code: {mean:.2f}; the fullest modules:\n{table}")
    assert mean <= MEAN_NODES_PER_LINE
    assert worst[0].density <= MODULE_NODES_PER_LINE, table


def test_no_assignment_makes_two_calls_for_two_names():
    count, rows = listed("packed")
    assert count <= PACKED_ASSIGNMENTS, rows


def test_the_formatter_is_switched_off_only_around_tables():
    count, rows = listed("unformatted")
    assert count <= UNFORMATTED_STATEMENTS, rows


def test_the_measure_itself():
    text = (
        '"""Doc."""\n\n# a comment\na, b = f(1), 2  # two\nx = [\n    1,\n    2,\n]  # fmt: skip\n'
    )
    tree = ast.parse(text)
    assert code_lines(text, tree) == {4, 5, 6, 7, 8}
    assert list(packed_assignments(tree)) == [4]
    assert list(unformatted_statements(text, tree)) == []
    other = "y = f(\n    1,\n)  # fmt: skip\n"
    assert list(unformatted_statements(other, ast.parse(other))) == [3]
