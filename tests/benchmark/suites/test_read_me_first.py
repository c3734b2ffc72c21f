"""Suites: every problem has a name, and a name means the same numbers everywhere."""

from trajopt.benchmark.suites import catalogue, literature


def test_a_problem_is_loaded_by_its_name():
    problem = catalogue.load("six-axis")
    assert (problem.joints, len(problem.waypoints)) == (6, 4)


def test_a_name_of_a_suite_may_choose_a_size():
    assert len(catalogue.load("robots-ur5e-w4").waypoints) == 4
    assert len(catalogue.load("robots-ur5e-w100").waypoints) == 100


def test_a_suite_is_a_list_of_problems():
    edges = [problem.name for problem in catalogue.problems("edges")]
    assert "edges-zigzag" in edges


def test_a_random_suite_goes_on_as_long_as_one_likes():
    first = catalogue.problems("random-tiny", size=2)
    more = catalogue.problems("random-tiny", size=30)
    assert len(more) == 30
    assert [problem.digest() for problem in more[:2]] == [problem.digest() for problem in first]


def test_a_published_problem_comes_with_its_published_times():
    published = literature.published("fang2020-task1")
    durations = [claim.duration for claim in published.claims]
    assert min(durations) == 4.0


def test_problems_of_one_arm_are_one_group():
    groups = {catalogue.group(catalogue.load(f"robots-ur5e-w{n}")) for n in (4, 8)}
    assert groups == {"robots-ur5e"}
