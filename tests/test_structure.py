"""What a reader is told of the code's structure is true: every file that a text names exists."""

from __future__ import annotations

import ast
import itertools
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


PACKAGES = ("trajopt", "baselines", "experiments")
VERBS = ("compare", "judge", "plan", "verify")  # public functions of the package


def definitions(kind: type[ast.AST]) -> list[tuple[str, str]]:
    """Names of all classes or functions of the packages, each with its file."""
    found = []
    for file in sorted(itertools.chain(*((ROOT / own).rglob("*.py") for own in PACKAGES))):
        tree = ast.parse(file.read_text(encoding="utf-8"))
        place = file.relative_to(ROOT).as_posix()
        found += [(node.name, place) for node in ast.walk(tree) if isinstance(node, kind)]
    return found


def test_a_name_is_of_one_class():
    places: dict[str, list[str]] = {}
    for name, place in definitions(ast.ClassDef):
        places.setdefault(name, []).append(place)
    assert len(places) > 200
    assert {name: own for name, own in places.items() if len(own) > 1} == {}


def test_a_public_verb_is_one_function():
    """The command of this name beside it calls it."""
    found = definitions(ast.FunctionDef)
    places = [(name, own) for name, own in found if name in VERBS and "/cli/" not in own]
    assert sorted(name for name, _ in places) == sorted(VERBS), places
