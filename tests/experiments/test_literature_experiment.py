"""The page of published times: what it says follows from the sources and closed forms."""

from types import SimpleNamespace

import pandas as pd
import pytest

from experiments import literature
from experiments.published import page
from trajopt.benchmark.suites import literature as suite


@pytest.fixture(scope="module")
def output(tmp_path_factory):
    """The page of a problem with claims and of one without, both optima in closed form."""
    folder = tmp_path_factory.mktemp("page")
    literature.main("fang2020-task1", "topico-example3", output=folder)
    return folder


def test_the_table_judges_every_claim_and_names_its_command(output):
    rows = pd.read_csv(output / "literature" / "verdicts.csv")
    claims = suite.published("fang2020-task1").claims
    assert list(rows["published s"]) == [claim.duration for claim in claims]
    # over the 4.0 s that the source itself gives
    above = [25 * claim.duration - 100 for claim in claims]
    assert list(rows["above best %"]) == pytest.approx(above)
    assert set(rows["command"]) == {"trajopt claims fang2020-task1"}


def test_the_page_says_what_was_optimised_and_how_the_digits_were_read(output):
    text = (output / "literature.md").read_text(encoding="utf-8")
    published = suite.published("fang2020-task1")
    assert published.objective in text
    assert published.transcription in text
    assert f"https://doi.org/{published.doi}" in text
    assert "- **1 equal**" in text
    assert "7 published numbers (of 1 sources), read second-hand; 7 verdicts on 1 problems" in text
    # two waypoints: stopping is the only plan there is
    assert "0 of the 0 times" in text
    assert "for 6 of them stopping is the best known motion" in text
    assert "`trajopt claims fang2020-task1` says so." in text
    for name in suite.files_beyond():
        assert f"**{name}**" in text


def test_a_number_that_is_read_in_two_ways_counts_once():
    readings = [suite.published(name) for name in ("yang2024-dbo-353", "yang2024-dbo-353-rad")]
    both = [SimpleNamespace(published=published) for published in readings]
    assert page.numbers(both) == len(readings[0].claims) == 3


def test_the_picture_of_the_page_is_there_and_small(output):
    picture = output / "literature" / "all.png"
    assert "(literature/all.png)" in (output / "literature.md").read_text(encoding="utf-8")
    assert 5_000 < picture.stat().st_size < 100_000


def test_a_source_without_a_doi_is_known_by_its_authors_and_year():
    """Two papers without one are two sources; two problems of a paper are one."""
    published = [suite.published(path) for path in suite.files().values()]
    claimed = [SimpleNamespace(published=own) for own in published if own.claims]
    assert len({own.published.doi for own in claimed}) == 8  # the empty one counts once
    assert page._sources(claimed) == 9
