"""Named problems from anywhere, real arms, suites, and random problems that show every edge."""

import hashlib
import os
from dataclasses import replace
from urllib.parse import urlparse

import numpy as np
import pytest

from trajopt import InvalidInput, Limits, Problem, UnknownName
from trajopt.benchmark.suites import catalogue as suite
from trajopt.benchmark.suites import edges, families, robots
from trajopt.benchmark.suites.random import random_problem
from trajopt.benchmark.trial import trial_id
from trajopt.core import arm_file

SEEDS = range(300)


@pytest.fixture(scope="module")
def problems():
    return [random_problem(seed) for seed in SEEDS]


def test_the_paper_s_problem_comes_first_and_every_file_loads():
    names = list(suite.problem_files())
    assert names[0] == "six-axis"
    assert len(names) >= 6
    for name in names:
        assert suite.load(name).name == name


def test_a_name_is_found_from_another_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert suite.find("six-axis").is_absolute()
    assert suite.load("six-axis").joints == 6


def test_a_path_is_relative_to_where_one_stands(tmp_path, monkeypatch):
    text = suite.find("one-joint").read_text("utf-8")
    (tmp_path / "mine.toml").write_text(text, encoding="utf-8")
    (tmp_path / "sub").mkdir()
    monkeypatch.chdir(tmp_path / "sub")
    assert suite.load(os.path.join("..", "mine.toml")).digest() == suite.load("one-joint").digest()
    with pytest.raises(InvalidInput, match=r"^mine\.toml: "):
        suite.find("mine.toml")


def test_a_built_in_name_wins_over_a_file_without_ending_only_if_known(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bare").write_text(suite.find("one-joint").read_text("utf-8"), encoding="utf-8")
    assert suite.load("bare").joints == 1


def test_an_unknown_name_says_what_there_is():
    with pytest.raises(UnknownName, match="did you mean 'six-axis'"):
        suite.find("six-axes")
    with pytest.raises(UnknownName, match=r"known: .*one-joint"):
        suite.find("qqq")


def test_a_seed_means_the_same_problem_and_another_seed_another(problems):
    assert [random_problem(s).digest() for s in SEEDS] == [p.digest() for p in problems]
    assert len({p.digest() for p in problems}) == len(problems)


def test_sizes_cover_one_to_seven_joints_and_three_to_eight_waypoints(problems):
    assert {p.joints for p in problems} == set(range(1, 8))
    assert {len(p.waypoints) for p in problems} == set(range(3, 9))


@pytest.mark.parametrize(("joints", "waypoints"), [(1, 3), (7, 8), (2, 2), (6, 4)])
def test_sizes_can_be_chosen(joints, waypoints):
    shapes = {
        random_problem(s, joints=joints, waypoints=waypoints).waypoints.shape for s in range(20)
    }
    assert shapes == {(waypoints, joints)}


def test_files_written_from_them_are_read_back_the_same(problems, tmp_path):
    for problem in problems[::30]:
        (tmp_path / "p.toml").write_text(problem.to_toml(), encoding="utf-8")
        assert Problem.from_toml(tmp_path / "p.toml").digest() == problem.digest()


def share(problems, feature):
    return np.mean([feature(p) for p in problems])


def test_the_promised_edges_are_common(problems):
    def reverses(p):
        signs = np.sign(p.displacements)
        both = signs.max(axis=0) * signs.min(axis=0)
        return (both < 0).any()

    def tiny(p):
        size = np.abs(p.displacements).max(axis=1)
        return size.min() < size.max() / 100

    def rests_always(p):
        return not p.moving.all()

    def rests_for_a_segment(p):
        return ((p.displacements == 0).any(axis=0) & p.moving).any()

    def asymmetric(p):
        velocity = p.limits.velocity.sum(axis=1)
        acceleration = p.limits.acceleration.sum(axis=1)
        return velocity.any() or acceleration.any()

    for feature in (reverses, tiny, rests_always, rests_for_a_segment, asymmetric):
        assert 0.1 < share(problems, feature) < 0.95, feature.__name__


def test_limits_are_up_to_a_hundred_to_one_apart(problems):
    for name in ("velocity", "acceleration"):
        high = [getattr(p.limits, name)[:, 1] for p in problems]
        ratios = np.array([h.max() / h.min() for h in high])
        assert 50 < ratios.max() <= 100
        assert ((ratios > 10).mean()) > 0.2


def test_every_segment_moves_and_every_number_is_finite(problems):
    for p in problems:
        assert p.displacements.any(axis=1).all()
        assert np.isfinite([p.limits.velocity, p.limits.acceleration]).all()
        assert not p.has("jerk")
        assert not p.has("position")


def test_jerk_limits_come_on_request_between_3_and_300_accelerations(problems):
    for seed in range(50):
        p = random_problem(seed, jerk=True)
        plain = problems[seed]
        assert p.without("jerk").digest() != p.digest()
        np.testing.assert_array_equal(p.limits.acceleration, plain.limits.acceleration)
        ratio = p.limits.jerk[:, 1] / np.abs(p.limits.acceleration).min(axis=1)
        assert (ratio >= 10**0.5 * (1 - 1e-12)).all()
        assert (ratio <= 10**2.5 * (1 + 1e-12)).all()


def test_a_robot_is_found_by_name_and_by_path() -> None:
    by_name = suite.robot("six-axis")
    assert by_name.joints == 6
    by_path = suite.robot(str(suite.robot_files()["six-axis"]))
    assert (by_path.a == by_name.a).all()
    with pytest.raises(UnknownName, match="six-axis"):
        suite.robot("six-axes")


# --- real arms ---


@pytest.fixture(scope="module")
def arms():
    return {name: robots.arm(name) for name in robots.arm_files()}


def test_six_arms_or_more_each_under_its_own_name(arms):
    asked = {"ur5e", "ur10e", "franka-fr3", "kuka-iiwa-14", "abb-irb-120", "puma-560"}
    assert asked <= arms.keys()
    assert all(arm.name == name for name, arm in arms.items())
    assert {arm.limits.joints for arm in arms.values()} == {5, 6, 7, 12}


def test_every_number_has_an_origin(arms):
    for arm in arms.values():
        assert {"position", "velocity", "acceleration"} <= arm.origins.keys()
        assert ("jerk" in arm.origins) == np.isfinite(arm.limits.jerk).all()
        for kind, origin in arm.origins.items():
            assert origin.source, (arm.name, kind)
            assert origin.checked, (arm.name, kind)
            assert bool(origin.rule) == (origin.status == "assumed")
            if origin.status in ("published", "configuration", "assumed"):
                assert urlparse(origin.address).scheme == "https"
            if origin.status == "memory":
                assert "not re-checked" in origin.source


def test_what_is_assumed_follows_its_rule(arms):
    assumed = set()
    for name, arm in arms.items():
        for kind, origin in arm.origins.items():
            if origin.status == "assumed":
                assumed.add(name)
                assert kind == "acceleration"
                assert origin.rule.startswith("ten times the velocity limit")
                tenfold = 10 * arm.limits.velocity
                np.testing.assert_allclose(arm.limits.acceleration, tenfold, rtol=1e-12)
    assert assumed == {"abb-irb-120", "kuka-iiwa-14", "puma-560"}


@pytest.mark.parametrize(
    ("name", "kind", "printed", "digits"),
    [  # as other documents print the same limits, in radians
        ("abb-irb-120", "velocity", "4.36332 4.36332 4.36332 5.58505 5.58505 7.33038", 5),
        ("abb-irb-120", "position", "2.87979 1.91986 1.22173 2.79253 2.094395 6.98132", 5),
        (
            "kuka-iiwa-14",
            "velocity",
            "1.483529 1.483529 1.745329 1.308996 2.268928 2.356194 2.356194",
            6,
        ),
        ("kuka-iiwa-14", "position", "2.967 2.094 2.967 2.094 2.967 2.094 3.054", 3),
        ("crs-a255", "velocity", "3.67 3.67 3.67 11.8 23.6", 1),
        ("crs-a255", "acceleration", "8.7 8.7 8.7 39.1 78.4", 1),
        # 360, 300, 360, 381, 388 and 615 degrees
        ("kuka-kr6-r700", "velocity", "6.28319 5.23599 6.28319 6.64970 6.77188 10.73377", 4),
        # counts per second over counts per radian
        ("puma-560", "velocity", "1.9166 1.5119 2.4020 5.3396 5.0888 5.7377", 2),
    ],
)
def test_limits_agree_with_what_is_printed_elsewhere(arms, name, kind, printed, digits):
    high = getattr(arms[name].limits, kind)[:, 1]
    expected = np.array(printed.split(), dtype=float)
    assert np.abs(high - expected).max() < 10.0**-digits


def test_waypoints_lie_inside_the_joint_ranges_and_fill_them(arms):
    for name, arm in arms.items():
        q = np.vstack([robots.robot_problem(arm, n).waypoints for n in range(90, 100)])
        low, high = arm.limits.position.T
        assert (q > low).all(), name
        assert (q < high).all(), name
        width = np.minimum(0.95 * (high - low), 2 * np.pi)
        assert (np.ptp(q, axis=0) > 0.95 * width).all(), name
        assert (np.ptp(q, axis=0) <= width * (1 + 1e-12)).all(), name


def test_jerk_limits_change_the_limits_only(arms):
    arm = arms["franka-fr3"]
    limited = robots.robot_problem(arm, 5, jerk=True)
    free = robots.robot_problem(arm, 5)
    assert limited.without("jerk").digest() == free.digest()
    assert (limited.limits.jerk[:, 1] == 5000).all()
    assert limited.name == "robots-franka-fr3-w5-jerk"
    assert free.name == "robots-franka-fr3-w5"


ARM = """
name = "mine"
description = "two joints"
[position]
angle_unit = "deg"
values = [[-90, 90], [-inf, inf]]
status = "memory"
source = "mine"
[velocity]
angle_unit = "rad"
values = [1, 2]
status = "memory"
source = "mine"
[acceleration]
angle_unit = "deg"
values = [[-180, 90], [-180, 180]]
status = "memory"
source = "mine"
"""


def test_an_arm_of_one_s_own_is_read_from_its_path(tmp_path):
    (tmp_path / "mine.toml").write_text(ARM, encoding="utf-8")
    arm = robots.arm(str(tmp_path / "mine.toml"))
    turn = np.pi / 2
    expected = Limits(
        velocity=[1, 2],
        acceleration=[[-np.pi, turn], np.pi],
        position=[[-turn, turn], [-np.inf, np.inf]],
    )
    for kind in ("velocity", "acceleration", "jerk", "position"):
        np.testing.assert_allclose(getattr(arm.limits, kind), getattr(expected, kind))
    q = robots.robot_problem(arm, 200).waypoints
    assert np.pi * 0.9 < np.abs(q[:, 1]).max() <= np.pi  # it turns without end: one turn


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ('name = "mine"', "", "name"),
        ('"memory"', '"rumour"', "status is 'rumour'"),
        ("[1, 2]", "[1, -2]", "limits.velocity, joint 2"),
        ("[1, 2]", "[1, 2, 3]", "acceleration is 2: expected 3"),
        ("[1, 2]", "[1, [2]]", "velocity.values is [1, [2]]"),
        ('"deg"', '"turns"', "turns"),
        ("[velocity]", "[speed]", "speed"),
        ("[velocity]", "[velocity", "robot"),
        ("source", "sauce", "sauce"),
        ("[position]", "extra = 1\n[position]", "extra"),
    ],
)
def test_a_wrong_arm_file_is_one_line_that_names_it(tmp_path, old, new, word):
    (tmp_path / "mine.toml").write_text(ARM.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(InvalidInput, match=r"mine\.toml: ") as error:
        robots.arm(str(tmp_path / "mine.toml"))
    assert word in str(error.value)
    assert "\n" not in str(error.value)


def test_an_unknown_arm_says_which_there_are():
    with pytest.raises(UnknownName, match="did you mean 'ur5e'"):
        robots.arm("ur5")


# --- suites ---


@pytest.fixture(scope="module")
def suites():
    return {name: suite.problems(name) for name in suite.suites()}


def test_the_suites_are_those_of_the_issue_and_one_per_random_family(suites):
    families_ = [f"random-{family}" for family in families.FAMILIES]
    assert list(suites) == [
        "six-axis",
        "edges",
        "robots",
        "literature",
        "moving",
        "sections",
        "demands",
        "mixes",
        "rivals-own",
        "arms",
        "chunks",
        "random",
        *families_,
    ]
    assert [p.name for p in suites["six-axis"]] == ["six-axis"]
    assert len(suites["edges"]) >= 20
    assert len(suites["random"]) == 108
    assert all(found.version >= 1 for found in suite.suites().values())


def test_no_two_problems_share_a_name_or_a_digest(suites):
    main = [p for name in ("six-axis", "edges", "robots", "random") for p in suites[name]]
    assert len({p.name for p in main}) == len({p.digest() for p in main}) == len(main)


def test_a_family_s_suite_is_its_part_of_random(suites):
    for family in families.FAMILIES:
        part = [p.name for p in suites["random"] if p.name.startswith(f"random-{family}-")]
        assert [p.name for p in suites[f"random-{family}"]] == part


def test_edges_are_the_small_files_and_the_ones_made_in_code(suites):
    files = set(suite.problem_files()) - {"six-axis"}
    made = {p.name for p in edges.stream()}
    assert {p.name for p in suites["edges"]} == files | made


def test_the_default_random_suite_covers_sizes_and_jerk(suites):
    assert {p.joints for p in suites["random"]} == set(range(1, 13))
    assert {len(p.waypoints) for p in suites["random"]} == set(families.WAYPOINTS)
    for family in families.FAMILIES:
        assert {p.has("jerk") for p in suites[f"random-{family}"]} == {True, False}


def test_robots_are_every_arm_at_every_size_with_jerk_where_there_is(suites, arms):
    own = [arms[name] for name in robots.SUITE_ARMS]
    jerky = sum("jerk" in arm.origins for arm in own)
    assert jerky >= 1
    assert len(suites["robots"]) == len(robots.ROBOT_WAYPOINTS) * (len(own) + jerky)
    assert all(p.has("position") for p in suites["robots"])


def test_building_again_and_a_smaller_size_give_the_same_problems(suites):
    for name, found in suites.items():
        again = suite.problems(name, 3)
        assert [p.digest() for p in again] == [p.digest() for p in found[:3]]


def test_random_suites_go_on_and_the_others_end():
    assert len(suite.problems("random-tiny", 25)) == 25
    assert len(suite.problems("six-axis", 25)) == 1


def test_every_problem_of_every_suite_is_loaded_by_its_name(suites):
    for problems in suites.values():
        for problem in problems:
            found = suite.load(problem.name)
            assert (found.name, found.digest()) == (problem.name, problem.digest())


def test_a_name_says_more_than_the_suite_has():
    others = robots.arm_files().keys() - set(robots.SUITE_ARMS)
    assert {suite.load(f"robots-{name}-w4").joints for name in others} == {5, 6, 7, 12}
    assert len(suite.load("robots-ur5e-w5").waypoints) == 5
    beyond = suite.problems("random-zigzag", 40)[-1]
    assert suite.load(beyond.name).digest() == beyond.digest()
    assert suite.find(beyond.name) is None


@pytest.mark.parametrize(
    "name",
    [
        "robots-ur5e-w1",
        "robots-ur5e-w04",
        "robots-ur5-w4",
        "robots-puma-560-w4-jerk",
        "edges-",
        "edges-tiniest",
        "random-zigzag-j0-w4-01",
        "random-zigzag-j1-w1-01",
        "random-zigzag-j1-w4-1",
        "random-zigzags-j1-w4-01",
    ],
)
def test_a_name_that_no_suite_makes_is_unknown(name):
    with pytest.raises(UnknownName):
        suite.load(name)


def test_a_slip_in_a_suite_s_name_suggests_the_right_one():
    with pytest.raises(UnknownName, match="did you mean 'robots-ur5e-w4'"):
        suite.load("robots-ur5-w4")


def test_an_unknown_suite_or_no_problem_at_all_is_refused():
    with pytest.raises(UnknownName, match="did you mean 'robots'"):
        suite.problems("robot")
    with pytest.raises(InvalidInput, match=r"^size is 0"):
        suite.problems("edges", 0)


def test_every_problem_is_read_back_the_same(suites, tmp_path):
    for problem in suites["robots"] + suites["random"][::9]:
        (tmp_path / "p.toml").write_text(problem.to_toml(), encoding="utf-8")
        assert Problem.from_toml(tmp_path / "p.toml").digest() == problem.digest()


def test_numbers_recorded_once_are_still_the_numbers(suites):
    """A change detector, no more: if it fails, undo the change or raise the suite's version."""
    for name, (version, recorded) in RECORDED.items():
        assert suite.suites()[name].version == version
        together = "".join(p.digest() for p in suites[name]).encode()
        assert hashlib.sha256(together).hexdigest()[:16] == recorded, name


RECORDED = {
    "six-axis": (1, "6fdaaa44af88f0d8"),
    "edges": (2, "5ed76d0928e5bada"),
    "robots": (2, "4128d89005e8538b"),
    "random": (1, "a3dba3efa3d9a8eb"),
}


def test_a_changed_problem_of_the_same_name_has_other_trials(suites):
    problem = suites["robots"][0]
    q = problem.waypoints.copy()
    q[1, 2] = np.nextafter(q[1, 2], 0)
    changed = replace(problem, waypoints=q)
    assert changed.name == problem.name
    ids = {trial_id(p, "exact", {}, 0, "0.1.0") for p in (problem, changed)}
    assert len(ids) == 2
    renamed = replace(problem, name="another")
    assert trial_id(renamed, "exact", {}, 0, "0.1.0") in ids


@pytest.mark.parametrize(
    ("name", "owner"),
    [
        ("robots-ur5e-w4", "ur5e"),
        ("robots-ur10e-w8", "ur10e"),
        ("robots-kinova-gen3-w4", "kinova-gen3"),
        ("robots-crs-a255-w4", None),
    ],
)
def test_a_stored_problem_finds_the_link_frames_of_its_robot(name, owner):
    problem = suite.load(name)
    stored = replace(problem, chain=None, name="stored")
    links = suite.chain(stored)
    expected = owner and arm_file.read(owner).chain.forward(problem.waypoints)
    assert (links is None) == (owner is None)
    if links is not None:
        np.testing.assert_array_equal(links.forward(problem.waypoints), expected)


def test_the_paper_s_problem_and_its_robot_share_their_frames():
    paper = suite.load("six-axis")
    tip = suite.robot("six-axis").forward(paper.waypoints)
    np.testing.assert_array_equal(suite.chain(paper).forward(paper.waypoints), tip)
    assert suite.chain(suite.load("random-smooth-j5-w3-00")) is None
