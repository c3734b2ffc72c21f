"""The numbers that pages print are those of a stored output, which says from which code it is."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from experiments.published.smooth353 import times_the_least
from trajopt.benchmark.best_known import records
from trajopt.benchmark.suites import literature
from trajopt.benchmark.suites.catalogue import load

ROOT = Path(__file__).parents[1]
PAGE = (ROOT / "docs" / "literature.md").read_text(encoding="utf-8")
KNOWN = pd.read_csv(ROOT / "docs" / "literature" / "known.csv").set_index("problem")
VERDICTS = pd.read_csv(ROOT / "docs" / "literature" / "verdicts.csv")
COMMIT = re.compile(r"[0-9a-f]{40}")
NUMBERS = {  # columns of the page's table, and of the stored one
    "published, s": "published s",
    "best known, s": "best known s",
    "lower bound, s": "lower bound s",
    "stopping, s": "stopping s",
}


def test_what_is_known_of_the_literature_is_said_by_a_known_code():
    assert set(KNOWN.index) == set(literature.files())
    assert KNOWN["commit"].map(COMMIT.fullmatch).all()


@pytest.mark.parametrize("name", literature.files())
def test_the_literature_page_says_what_was_found_and_what_is_recorded(name):
    """The page said 5.5275 s, not proved, where the record proves 6.2527 s."""
    row = KNOWN.loc[name]
    best = row["best known s"]
    bound = row["lower bound s"]
    section = PAGE.split(f"### {name}\n")[1].split("\n### ")[0]
    assert f"- here: {best:.6g} s (" in section
    assert f"no motion is faster than {bound:.6g} s (" in section
    record = records.find(literature.published(name).problem)
    if record is not None:
        assert bound >= record.lower_bound * (1 - 1e-6)
        assert best <= record.duration * (1 + 1e-6)


def test_the_table_of_the_literature_page_is_the_stored_one():
    lines = [line.strip("| ").split("|") for line in PAGE.splitlines() if line.startswith("| ")]
    cells = [[cell.strip() for cell in line] for line in lines]
    start = next(i for i, row in enumerate(cells) if row[0] == "problem")
    heading = cells[start]
    shown = cells[start + 1 : start + 1 + len(VERDICTS)]
    stored = VERDICTS.merge(KNOWN, left_on="problem", right_index=True, suffixes=("", " now"))
    for row, own in zip(shown, stored.to_dict("records"), strict=True):
        said = dict(zip(heading, row, strict=True))
        assert (said["problem"], said["verdict"]) == (own["problem"], own["verdict"])
        for column, name in NUMBERS.items():
            assert float(said[column]) == pytest.approx(own[name], rel=1e-5)
        assert own["best known s"] == own["best known s now"]
        assert own["lower bound s"] == own["lower bound s now"]


def test_how_smooth_a_3_5_3_can_be_is_what_two_pages_say():
    """Of `unoptimised` with equal times the closed form is near: 50.9 times on six-axis."""
    six_axis = times_the_least(load("six-axis"))
    assert 45 < six_axis < 50.9
    words = " ".join((ROOT / "docs" / "six-axis.md").read_text(encoding="utf-8").split())
    assert f"has {six_axis:.1f} times the least of its duration" in words
    published = [name for name in literature.files() if "-353" in name]
    said = PAGE.count("the smoothest 3-5-3 through these waypoints that we found")
    assert said == len(published) == 2
    for name in published:
        least = times_the_least(literature.published(name).problem)
        assert f"has {least:.1f} times the least ∫ jerk² of its duration" in PAGE
