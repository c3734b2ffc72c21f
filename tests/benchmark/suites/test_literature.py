"""Published problems: every file's facts, digits that are kept, and files that are refused."""

import re

import numpy as np
import pytest

from trajopt import InvalidInput, Problem, UnknownName
from trajopt.benchmark.suites import catalogue, literature

STATED = literature.files()
BEYOND = literature.files_beyond()


def test_every_problem_of_the_collection_is_there():
    # 35 published problems: 29 stated here, one of them in two readings
    assert len(STATED) == 30
    assert len(BEYOND) == 5
    with_claims = [name for name in STATED if literature.published(name).claims]
    assert len(with_claims) == 24  # 23, one of them in two readings


@pytest.mark.parametrize("name", STATED)
def test_a_file_says_where_its_numbers_come_from(name):
    found = literature.published(name)
    assert found.name == found.problem.name == name
    assert found.source
    assert found.objective
    assert found.transcription
    # nobody has held them against the publisher's page
    assert found.checked.startswith("not yet")
    assert found.doi == "" or re.fullmatch(r"10\.\d{4,}/\S+", found.doi)
    for claim in found.claims:
        assert claim.method
        assert claim.table
        assert 0 < claim.rounding <= 0.05 < claim.duration


@pytest.mark.parametrize("name", STATED)
def test_a_problem_is_found_by_its_name_in_every_command(name):
    assert catalogue.find(name) == STATED[name]
    assert catalogue.load(name).digest() == literature.published(name).problem.digest()


def test_the_suite_holds_each_problem_once():
    problems = catalogue.problems("literature")
    assert [problem.name for problem in problems] == list(STATED)
    assert len({problem.digest() for problem in problems}) == len(problems)


@pytest.mark.parametrize("name", BEYOND)
def test_a_problem_that_cannot_be_stated_says_why(name):
    found = literature.published(name)
    assert found.problem is None
    with pytest.raises(InvalidInput, match=re.escape(found.beyond)):
        catalogue.find(name)


def test_an_unknown_name_offers_the_nearest():
    with pytest.raises(UnknownName, match="did you mean 'fang2020-task"):
        catalogue.load("fang2020-task")
    with pytest.raises(UnknownName, match="did you mean 'fang2020-task"):
        literature.published("fang2020-task")


def test_units_are_those_of_each_file():
    degrees = literature.published("fang2020-task1").problem
    np.testing.assert_allclose(np.degrees(degrees.waypoints[0, 3]), 150.0)
    np.testing.assert_allclose(np.degrees(degrees.limits.jerk[1, 1]), 66.0)
    mixed = literature.published("yu2022-aubo-ga").problem
    assert mixed.waypoints[0, 0] == 0.5236
    np.testing.assert_allclose(np.degrees(mixed.limits.velocity[0, 1]), 150.0)


FILE = """
waypoints = [[0.0], [1.0]]
units = {waypoints = "rad", limits = "rad"}

[limits]
velocity = [1.0]
acceleration = [1.0]

[published]
objective = "time"

[[published.claims]]
method = "a swarm"
time = 4.50
unit = "s"
"""


def read(tmp_path, text, name="own.toml"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return literature.published(path)


def test_a_file_of_one_s_own_is_read_with_the_digits_as_printed(tmp_path):
    (claim,) = read(tmp_path, FILE).claims
    assert claim.duration == 4.5
    assert claim.rounding == 0.005  # 4.50, not 4.5
    assert Problem.from_toml(tmp_path / "own.toml").joints == 1
    (short,) = read(tmp_path, FILE.replace("4.50", "12"), "whole.toml").claims
    assert (short.duration, short.rounding) == (12.0, 0.5)
    (milli,) = read(tmp_path, FILE.replace('"s"', '"ms"'), "ms.toml").claims
    assert milli.duration == pytest.approx(0.0045)
    assert milli.rounding == pytest.approx(5e-6)


def test_peak_jerks_are_read_in_their_unit(tmp_path):
    text = FILE + 'peak_jerk = [180.0]\njerk_unit = "deg"\n'
    (claim,) = read(tmp_path, text).claims
    assert claim.peak_jerk == pytest.approx((np.pi,))


def test_a_problem_file_without_publication_has_no_claims(tmp_path):
    found = read(tmp_path, FILE.partition("[published]")[0])
    assert found.claims == ()
    assert found.name == "own"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("4.50", '"4.50"', "claim 1, time is '4.50': expected a finite number"),
        ("4.50", "nan", "claim 1, time is nan: expected a finite number"),
        ("4.50", "true", "claim 1, time is True: expected a finite number"),
        ("4.50", "-1.0", "claim 1, time is -1.0: expected a positive duration"),
        ("4.50", "0", "claim 1, time is 0.0: expected a positive duration"),
        ('"s"', '"min"', 'claim 1, unit is \'min\': expected "s" or "ms"'),
        ('unit = "s"', "", 'claim 1, unit: expected "s" or "ms"'),
        ("time =", "tiem =", "claim 1, tiem is Decimal('4.50'): expected the key time"),
        ("objective", "goal", "published.goal is 'time': expected one of the keys"),
        ('objective = "time"', "objective = 3", "objective is 3: expected a string"),
        ('objective = "time"', "unsaid = 3", "published.unsaid is 3: expected a list of texts"),
        (
            'unit = "s"',
            'unit = "s"\nfamily = "4-3-4"',
            "family is '4-3-4': expected one of 3-5-3, quintic",
        ),
        ('unit = "s"', 'unit = "s"\npeak_jerk = [1]', 'jerk_unit: expected "deg" or "rad"'),
        ('unit = "s"', 'unit = "s"\njerk_unit = "deg"\npeak_jerk = ["a"]', "peak_jerk is"),
        ("[[published.claims]]", "[published.claims]", "expected tables [[published.claims]]"),
        ("velocity = [1.0]", "velocity = [-1.0]", "limits.velocity, joint 1 is -1.0"),
        ("velocity = [1.0]", "velocity = [", "expected a readable TOML file"),
    ],
)
def test_a_file_that_is_wrong_is_refused_with_its_key(tmp_path, old, new, message):
    assert old in FILE
    with pytest.raises(InvalidInput) as error:
        read(tmp_path, FILE.replace(old, new))
    assert "own.toml" in str(error.value)
    assert message in str(error.value)


def test_claims_that_are_no_table_are_refused(tmp_path):
    text = FILE.partition("[published]")[0].replace("[limits]", "published = 3\n[limits]")
    with pytest.raises(InvalidInput, match="published is 3: expected a table"):
        read(tmp_path, text)
    text = FILE.partition("[[published.claims]]")[0] + "claims = [1]\n"
    with pytest.raises(InvalidInput, match="claim 1 is 1: expected a table"):
        read(tmp_path, text, "b.toml")
