"""Counts that pages print are those of the program: what is added changes them."""

from __future__ import annotations

import re
from functools import cache
from math import floor
from pathlib import Path

import pandas as pd
import pytest

from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import catalogue, robots
from trajopt.cli.app import app
from trajopt.planners.registry import entries, named

ROOT = Path(__file__).parents[1]
WORDS = {"ten": 10, "eleven": 11, "twelve": 12, "thirteen": 13, "fourteen": 14}


@cache
def problems() -> int:
    return len(catalogue.every_problem())


@cache
def closed() -> int:
    """Count the problems whose recorded motion and bound are less than 0.1 % apart."""
    found = (records.find(own.problem) for own in catalogue.every_problem().values())
    return sum(own.duration / own.lower_bound - 1 < records.CLOSED_WITHIN for own in found)


def of_suite(name: str) -> int:
    return len(catalogue.problems(name))


def commands(app=app) -> int:
    names = [name for name in app if not name.startswith("-")]
    return sum(commands(app[name]) or 1 for name in names)


def compared() -> int:
    """Count the planners that `compare --prove` runs."""
    return sum(not named(name)[1].on_request for name in entries()) + 1


def ranked() -> int:
    """Count other libraries' optimisers in the arena's table."""
    table = pd.read_csv(ROOT / "experiments" / "stored" / "arena.csv", comment="#")
    return int(table["optimiser"].str.match("mealpy |pymoo ").sum())


COUNTS = [
    ("README.md", r"for each of (\d+) problems", problems),
    ("README.md", r"proved lower bound; (\d+) are closed", closed),
    ("README.md", r"All (\w+) planners\]\(docs/six-axis.md\)", compared),
    ("README.md", r"\[(\d+) metaheuristics against", ranked),
    ("docs/arena.md", r"# (\d+) metaheuristics", ranked),
    ("docs/how-to/any-optimiser.md", r"rank among the (\d+) optimisers", ranked),
    ("docs/explanation/house.md", r"\| (\d+) problems and random families", problems),
    ("docs/explanation/house.md", r"of (\d+) problems closed", problems),
    ("docs/explanation/house.md", r"(\d+) of \d+ problems closed", closed),
    ("docs/explanation/house.md", r"\| (\d+) commands", commands),
    ("docs/robots.md", r"(\w+) arms are there with", lambda: len(robots.arm_files())),
    ("experiments/README.md", r"suite `moving` has (\d+) problems", lambda: of_suite("moving")),
    ("experiments/README.md", r"suite `sections` has (\d+) problems", lambda: of_suite("sections")),
    ("experiments/README.md", r"suite `demands` has (\d+) problems", lambda: of_suite("demands")),
]


@pytest.mark.parametrize(("page", "pattern", "count"), COUNTS)
def test_a_count_is_that_of_the_program(page, pattern, count):
    text = " ".join((ROOT / page).read_text(encoding="utf-8").split())
    (said,) = re.findall(pattern, text)
    assert (WORDS[said.lower()] if said.isalpha() else int(said)) == count()


@pytest.mark.parametrize("page", ["README.md", "docs/results.md", "docs/explanation/house.md"])
def test_pages_have_the_number_of_published_times_of_the_page_that_is_generated(page):
    said = [
        re.findall(r"(\d+) published (?:running times|numbers)", (ROOT / own).read_text("utf-8"))
        for own in ("docs/literature.md", page)
    ]
    assert said[0] == said[1]


@pytest.mark.parametrize("page", ["README.md", "docs/index.md", "docs/six-axis.md"])
def test_a_page_rounds_a_bound_down(page):
    """A number above the proved one is not proved; to six decimals there is one that is."""
    known = records.find(catalogue.load("six-axis"))
    text = (ROOT / page).read_text(encoding="utf-8")
    said = re.findall(r"No (?:motion|trajectory) takes less than ([\d.]+) s", text, re.IGNORECASE)
    assert said == [f"{floor(known.lower_bound * 1e6) / 1e6:.6f}"]
