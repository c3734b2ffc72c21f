"""What a reader is told of the code's structure is true: every file that a text names exists."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = [
    path.parent
    for top in ("trajopt", "baselines", "experiments")
    for path in sorted((ROOT / top).rglob("__init__.py"))
]
PAGES = [ROOT / "CONTRIBUTING.md", ROOT / "docs" / "explanation" / "house.md"]
# `name`, or `name.py`, before the colon that begins what it is for.
ENTRY = re.compile(r"^- ((?:`[\w.]+`(?:, | with |, by )?)+)", re.M)
PLACE = re.compile(r"`((?:trajopt|baselines|experiments|docs|tests|data)/[a-z_./-]*)`")


def docstring(package: Path) -> str:
    text = (package / "__init__.py").read_text(encoding="utf-8")
    return ast.get_docstring(ast.parse(text)) or ""


def reading_order(package: Path) -> list[str]:
    """Return the modules that the docstring of a package lists."""
    _, found, listed = docstring(package).partition("eading order")
    entries = ENTRY.findall(listed) if found else []
    return [name for entry in entries for name in re.findall(r"`([\w.]+)`", entry)]


def exists(place: Path) -> bool:
    return place.exists() or place.with_suffix(".py").exists()


ORDERED = [package for package in PACKAGES if "eading order" in docstring(package)]


@pytest.mark.parametrize("package", ORDERED, ids=lambda path: path.relative_to(ROOT).as_posix())
def test_a_reading_order_names_files_that_exist(package):
    names = reading_order(package)
    assert names
    assert [name for name in names if not exists(package / name)] == []


def test_reading_orders_are_found():
    assert len(ORDERED) >= 15


@pytest.mark.parametrize("page", PAGES, ids=lambda path: path.name)
def test_a_page_about_the_code_names_places_that_exist(page):
    places = PLACE.findall(page.read_text(encoding="utf-8"))
    assert len(places) >= 15
    assert [place for place in places if not exists(ROOT / place)] == []
