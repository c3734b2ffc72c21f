"""The style of every module, measured: code in a line, code in all, and sentences.

The measure of code is the expression node (`ast.expr`); docstrings, comments and blank lines are no
code. Seven codebases of the field have means of 2.8 to 4.4 nodes per line of code.

A ceiling on a sum stands where the sum stands: whoever lowers the sum lowers the ceiling. Those on
the parts of the house are in `docs/explanation/house.md`.
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SOURCES = ("trajopt", "baselines", "experiments")
TESTS = ("tests",)

MAX_MEAN_NODES_PER_LINE = {SOURCES: 4.6, TESTS: 5.0}
MAX_MODULE_NODES_PER_LINE = {SOURCES: 6.5, TESTS: 7.3}
MAX_PACKED_ASSIGNMENTS = {SOURCES: 0, TESTS: 0}
MAX_UNFORMATTED_STATEMENTS = {SOURCES: 0, TESTS: 0}
MAX_RIDDLES = 32

# A sentence that begins or speaks like this often has no subject (see `docs/glossary.md`).
RIDDLE_START = re.compile(
    r"(Of (the|what|all|a|an|its|that)\b|What\b|Those\b|The same\b|Whether\b"
    r"|How (far|much|long|many)\b|By what\b|That of\b|From what\b|To what\b|Where\b)"
)
RIDDLE_WORDS = re.compile(
    r"\b(is none|are none|is worth|says so|lets? be|knows? (no|nothing|of)|pulls|so much"
    r"|as it stands|asked after)\b"
)

UNFORMATTED = re.compile(r"#\s*fmt:\s*skip")
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
    riddles: tuple[int, ...]

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
    marked = {n for n, line in enumerate(text.splitlines(), 1) if UNFORMATTED.search(line)}
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
        riddles=tuple(riddles(text, tree)),
    )


def riddles(text, tree):
    """Yield the lines of docstrings and comments that are probably hard to understand."""
    owners = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    for node in ast.walk(tree):
        words = ast.get_docstring(node) if isinstance(node, owners) else None
        if words and (RIDDLE_START.match(words) or RIDDLE_WORDS.search(words)):
            yield node.body[0].lineno
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        words = token.string.lstrip("# ").strip() if token.type == tokenize.COMMENT else ""
        capital = words[:1].upper() + words[1:]
        if RIDDLE_START.match(capital) or RIDDLE_WORDS.search(words):
            yield token.start[0]


@cache
def modules(folders):
    """Return the measures of every module of these folders."""
    paths = [path for folder in folders for path in sorted((ROOT / folder).rglob("*.py"))]
    return [measured(path) for path in paths]


def listed(attribute, folders):
    rows = [f"{m.path}:{line}" for m in modules(folders) for line in getattr(m, attribute)]
    return len(rows), "\n".join(rows)


@pytest.mark.parametrize("folders", [SOURCES, TESTS])
def test_a_line_holds_one_thought(folders):
    found = modules(folders)
    worst = sorted(found, key=lambda module: -module.density)[:WORST_SHOWN]
    table = "\n".join(f"{module.density:5.2f}  {module.path}" for module in worst)
    mean = sum(module.nodes for module in found) / sum(module.lines for module in found)
    print(f"expression nodes per line of code: {mean:.2f}; the fullest modules:\n{table}")
    assert mean <= MAX_MEAN_NODES_PER_LINE[folders]
    assert worst[0].density <= MAX_MODULE_NODES_PER_LINE[folders], table


@pytest.mark.parametrize("folders", [SOURCES, TESTS])
def test_no_assignment_makes_two_calls_for_two_names(folders):
    count, rows = listed("packed", folders)
    assert count <= MAX_PACKED_ASSIGNMENTS[folders], rows


@pytest.mark.parametrize("folders", [SOURCES, TESTS])
def test_the_formatter_is_switched_off_only_around_tables(folders):
    count, rows = listed("unformatted", folders)
    assert count <= MAX_UNFORMATTED_STATEMENTS[folders], rows


def parts():
    """Return (names, ceiling) of each part that the page of the house lists."""
    page = (ROOT / "docs" / "explanation" / "house.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`.*?`) \| ([\d,]+) \|", page, re.M)
    return [(re.findall(r"`(.+?)`", names), int(most.replace(",", ""))) for names, most in rows]


def test_no_part_of_the_house_grows():
    ceilings = {tuple(names): most for names, most in parts()}
    owner = {name: names for names in ceilings for name in names}
    nodes = dict.fromkeys(ceilings, 0)
    for module in modules(SOURCES):
        path = module.path.with_suffix("").as_posix()
        own = [name for name in owner if f"{path}/".startswith(f"{name}/")]
        nodes[owner[max(own, key=len)]] += module.nodes
    print(f"expression nodes: {sum(nodes.values())}")
    for names, most in ceilings.items():
        assert nodes[names] <= most, names


def test_sentences_have_a_subject():
    count, rows = listed("riddles", SOURCES + TESTS)
    assert count <= MAX_RIDDLES, rows


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
