"""Named problems from anywhere, and random ones that are valid and show every promised edge."""

import os

import numpy as np
import pytest

from trajopt import InvalidInput, Problem, UnknownName
from trajopt.benchmark import suite

SEEDS = range(300)


@pytest.fixture(scope="module")
def problems():
    return [suite.random_problem(seed) for seed in SEEDS]


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
    assert [suite.random_problem(s).digest() for s in SEEDS] == [p.digest() for p in problems]
    assert len({p.digest() for p in problems}) == len(problems)


def test_sizes_cover_one_to_seven_joints_and_three_to_eight_waypoints(problems):
    assert {p.joints for p in problems} == set(range(1, 8))
    assert {len(p.waypoints) for p in problems} == set(range(3, 9))


@pytest.mark.parametrize(("joints", "waypoints"), [(1, 3), (7, 8), (2, 2), (6, 4)])
def test_sizes_can_be_chosen(joints, waypoints):
    shapes = {
        suite.random_problem(s, joints=joints, waypoints=waypoints).waypoints.shape
        for s in range(20)
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
        return (signs.max(axis=0) * signs.min(axis=0) < 0).any()

    def tiny(p):
        size = np.abs(p.displacements).max(axis=1)
        return size.min() < size.max() / 100

    def rests_always(p):
        return not p.moving.all()

    def rests_for_a_segment(p):
        return ((p.displacements == 0).any(axis=0) & p.moving).any()

    def asymmetric(p):
        return any(
            (getattr(p.limits, n).sum(axis=1) != 0).any() for n in ("velocity", "acceleration")
        )

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
        p, plain = suite.random_problem(seed, jerk=True), problems[seed]
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
