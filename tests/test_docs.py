"""What the code cites, the repository holds: sections of docs/mathematics.md, and its files."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from trajopt.benchmark.store.fields import FIELDS
from trajopt.benchmark.store.layout import ADDED_FIELDS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
MATHEMATICS = ROOT / "docs" / "mathematics.md"
SOURCES = sorted(
    path
    for folder in ("trajopt", "baselines", "experiments", "tests")
    for path in (ROOT / folder).rglob("*.py")
    if path != Path(__file__)
)

# "docs/mathematics.md, section 3", "mathematics.md, sections 3 and 4", "mathematics, section 9",
# also where a line of a docstring or comment ends in between.
GAP = r"[\s#]*"
CITED = re.compile(
    rf"mathematics(?:\.md)?`?,?{GAP}sections?{GAP}(\d+b?)(?:(?:,| and){GAP}(\d+b?))?", re.I
)
NAMED = re.compile(rf"mathematics(?:\.md\b|,{GAP}section|{GAP}\d|:)", re.I)
# "section 3", where it is neither the paper's nor a part like 4.2.
BARE = re.compile(rf"(?<!paper's )\bsection{GAP}(\d+b?)\b(?!\.\d)")
PATHS = re.compile(r"\b(?:docs|data)/[\w./-]*\w\.(?:md|toml|csv|png)\b")


def headings() -> set[str]:
    """Return the numbers of the sections, on the four pages behind docs/mathematics.md."""
    pages = (DOCS / "mathematics").glob("*.md")
    texts = [page.read_text(encoding="utf-8") for page in pages]
    return {number for text in texts for number in re.findall(r"^#+ (\d+b?)\. ", text, re.M)}


def test_every_section_is_found_from_the_page_that_the_code_cites():
    """A row of its table leads to the page and the heading."""
    rows = re.findall(
        r"^\| (\d+\w?) \| \[(.*)\]\((mathematics/[\w-]+\.md)#\1-.*\) \|$",
        MATHEMATICS.read_text(encoding="utf-8"),
        re.M,
    )
    for number, title, page in rows:
        text = (DOCS / page).read_text(encoding="utf-8")
        assert re.search(rf"^#+ {number}\. {re.escape(title)}$", text, re.M)
    assert {number for number, *_ in rows} >= headings()


def test_equations_are_numbered_by_section_without_a_gap():
    numbers = []
    for page in (DOCS / "mathematics").glob("*.md"):
        text = page.read_text(encoding="utf-8")
        for section in re.split(r"^## ", text, flags=re.M)[1:]:
            own = re.findall(r"\\tag\{(\d+)\.(\d+)\}", section)
            assert {head for head, _ in own} <= {section.split(".")[0]}
            assert [int(tail) for _, tail in own] == list(range(1, len(own) + 1))
            numbers += own
    assert len(numbers) >= 35


def test_sections_are_numbered_without_a_gap():
    assert headings() == {*map(str, range(1, 14)), "7b"}


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_citation_of_the_mathematics_names_a_section_that_exists(path):
    text = path.read_text(encoding="utf-8")
    cited = {number for match in CITED.findall(text) for number in match if number}
    cited |= set(BARE.findall(text))
    assert cited <= headings()
    # Not "see the mathematics" without a number.
    assert len(NAMED.findall(text)) <= len(CITED.findall(text))


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_every_file_that_a_docstring_names_exists(path):
    named = PATHS.findall(path.read_text(encoding="utf-8"))
    missing = [name for name in named if not (ROOT / name).is_file()]
    assert missing == []


def test_the_page_of_files_lists_every_field_of_a_trial():
    columns = (*FIELDS, *ADDED_FIELDS)
    rows = [f"| `{f.name}` | {f.unit} | {f.meaning} |".replace("|  |", "| |") for f in columns]
    page = (DOCS / "files.md").read_text(encoding="utf-8")
    assert "\n".join(rows) in page
