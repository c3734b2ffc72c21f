"""Velocity limits that fall towards a position limit, against closed forms and sampling."""

from __future__ import annotations

import numpy as np
import pytest

from trajopt import Limits, Problem, verify
from trajopt.benchmark.suites import catalogue
from trajopt.core import arm_file
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import FallingVelocity
from trajopt.core.out_of_scope import out_of_scope
from trajopt.core.trajectory import Trajectory
from trajopt.judging.verification import certified


def falling(offset, deceleration, low, high):
    return FallingVelocity(np.array([[offset, deceleration, low, high]], dtype=float))


def pieces(breaks, *rows):
    """One joint: a row of coefficients per piece, highest power first."""
    coefficients = np.array(rows, dtype=float).T[..., None]
    return Trajectory(breaks, coefficients, np.array(breaks)[[0, -1]])


def mirrored(limit, trajectory):
    offset, deceleration, low, high = limit.numbers[0]
    own = Trajectory(trajectory.breaks, -trajectory.coefficients, trajectory.waypoint_times)
    return falling(offset, deceleration, -high, -low), own


def both_ways(limit, trajectory):
    """The worst use, after the mirrored motion was found to have the same."""
    found = limit.worst(trajectory)
    other, backwards = mirrored(limit, trajectory)
    again = other.worst(backwards)
    assert again.value == pytest.approx(found.value, rel=1e-13)
    assert again[1:] == pytest.approx(found[1:])
    return found


def test_constant_velocity_uses_more_the_nearer_the_end_is():
    limit = falling(offset=0.2, deceleration=2.0, low=-100, high=2.5)
    motion = pieces([0, 2.4], [1, 0])
    # sqrt(4 (2.5 - q)) - 0.2 is sqrt(0.4) - 0.2 at 2.4, and below 1 from q = 2.14 on
    found = both_ways(limit, motion)
    assert found.value == pytest.approx(1 / (np.sqrt(0.4) - 0.2), rel=1e-12)
    assert (found.time, found.joint) == (2.4, 0)
    (interval,) = limit.active(motion, 1.0)
    assert interval.joint == 0
    assert (interval.start, interval.end) == (pytest.approx(2.14, rel=1e-12), 2.4)
    assert both_ways(limit, pieces([0, 2.13], [1, 0])).value < 1


def test_braking_is_worst_inside_the_piece():
    # v² = v0² - 2 b q, so w = room + v²/(2 b) and 2 d w = 2 d room + v² d/b; with r² = 2 d room and
    # m² = d/b the use is v / (sqrt(r² + m² v²) - o), largest where sqrt(r² + m² v²) = r²/o
    v0, b, d, o, room = 2.0, 1.0, 1.5, 0.5, 0.1
    high = v0**2 / (2 * b) + room
    r, m = np.sqrt(2 * d * room), np.sqrt(d / b)
    v = np.sqrt((r**2 / o) ** 2 - r**2) / m
    limit = falling(o, d, -100, high)
    motion = pieces([0, 2], [-b / 2, v0, 0])
    found = both_ways(limit, motion)
    assert 0 < v < v0
    assert found.value == pytest.approx(v / (r**2 / o - o), rel=1e-12)
    assert found.time == pytest.approx((v0 - v) / b, rel=1e-6)
    # dilated by its use, it touches the limit in one instant
    touching = motion.dilated(found.value)
    assert both_ways(limit, touching).value == pytest.approx(1, rel=1e-12)
    assert not list(limit.active(touching, 1 + 1e-9))


def test_the_limit_s_own_arc_is_at_it_all_the_time():
    # with offset 0 the limit's arc is a parabola: v = d (T - t), w = (d/2) (T - t)²
    d = 1.7
    arc = pieces([0, 2], [-d / 2, 2 * d, -2 * d])  # q = -(d/2) (2 - t)²
    limit = falling(0.0, d, -100, 0.0)
    assert both_ways(limit, arc).value == pytest.approx(1, rel=1e-9)
    (interval,) = limit.active(arc, 0.999)
    assert interval.end - interval.start == pytest.approx(2, rel=1e-3)


def test_rest_near_the_end_and_leaving_it_are_allowed():
    limit = falling(0.3, 6.0, -2.7501, 2.7501)  # nothing is allowed in the last 7.5 mrad
    still = pieces([0, 1], [0, 0, 2.745])
    leaving = pieces([0, 1], [0, -0.1, 2.745])
    entering = pieces([0, 1], [0, 0.001, 2.744])
    beyond = pieces([0, 1], [0, 0.001, 2.8])
    assert both_ways(limit, still).value == 0
    assert both_ways(limit, leaving).value < 0.02  # of what is allowed towards the far end
    for motion in (entering, beyond):
        assert both_ways(limit, motion).value == np.inf


def test_the_worst_joint_is_named_and_the_others_do_not_count():
    row = [0.2, 2.0, -100, 2.5]
    one = pieces([0, 2.4], [1, 0])
    twice = Trajectory(one.breaks, np.repeat(one.coefficients, 2, axis=2), one.waypoint_times)
    alone = FallingVelocity(np.array([row])).worst(one)
    second = FallingVelocity(np.array([[np.nan] * 4, row]))
    assert second.worst(twice) == alone._replace(joint=1)
    assert second.bounds.tolist() == [False, True]
    assert second.widened(1, 0.5).worst(twice).value == pytest.approx(alone.value / 1.5)
    assert {interval.joint for interval in second.active(twice, 1.0)} == {1}


def sampled(limit, trajectory, count=100_001):
    (offset, deceleration, low, high), times = limit.numbers[0], np.linspace(0, 2, count)
    q, v = trajectory(times)[:, 0], trajectory(times, 1)[:, 0]
    uses = []
    for speed, distance in ((v, high - q), (-v, q - low)):
        allowed = np.sqrt(2 * deceleration * np.maximum(0, distance)) - offset
        uses.append(np.where(allowed > 0, speed / np.maximum(allowed, 1e-300), np.inf))
        uses[-1][speed <= 0] = 0
    return np.maximum(*uses)


@pytest.mark.parametrize("degree", [1, 2, 3, 5, 6, 7])
def test_any_degree_against_sampling(degree):
    rng = np.random.default_rng(degree)
    kept = 0
    for _ in range(6):
        motion = pieces([0, 0.7, 1.1, 2.0], *rng.normal(size=(3, degree + 1)))
        low, high = np.quantile(motion(np.linspace(0, 2, 999)), [0.05, 0.9])
        low, high = low - rng.uniform(0, 2), high + rng.uniform(0, 2)
        limit = falling(rng.uniform(0, 0.4), rng.uniform(0.2, 8), low, high)
        found = both_ways(limit, motion).value
        uses = sampled(limit, motion)
        if found == np.inf:
            assert uses.max() > 50
            continue
        kept += 1
        assert uses.max() == pytest.approx(found, rel=1e-3)
        assert uses.max() <= found * (1 + 1e-12)
        assert both_ways(limit, motion.dilated(found)).value == pytest.approx(1, rel=1e-12)
        share = sum(own.end - own.start for own in limit.active(motion, found / 2)) / 2
        assert share == pytest.approx(np.mean(uses > found / 2), abs=1e-4)
    assert kept > 1


# --- in a problem ---

NEAR = {"offset": [0.3], "deceleration": [6.0], "position": [[-2.7501, 2.7501]]}


def test_it_is_judged_as_every_limit():
    free = Problem([[0.0], [2.7]], Limits([3.0], [8.0]))
    arm = Problem([[0.0], [2.7]], Limits([3.0], [8.0], falling_velocity=NEAR))
    assert arm.digest() != free.digest()
    # the fastest motion brakes from 3 rad/s at 8 rad/s²
    motion = pieces([0, 0.375, 0.9, 1.275], [4, 0, 0], [0, 3, 0.5625], [-4, 3, 2.1375])
    assert verify(free, motion).feasible
    found = verify(arm, motion)
    assert found.valid
    assert not found.feasible
    assert found.dilation == found.uses["falling_velocity"].value > 1.2
    assert verify(arm, certified(arm, motion)).feasible


def test_a_waypoint_where_nothing_is_allowed_has_no_motion():
    arm = Problem([[0.0], [2.745]], Limits([1.0], [2.0], falling_velocity=NEAR))
    h = 2.745
    motion = pieces([0, 9], [-2 * h / 729, 3 * h / 81, 0, 0])
    found = verify(arm, motion)
    assert found.dilation == np.inf
    assert found.certified_duration is None
    assert "where its falling velocity limit allows no motion" in found.flaws[0]


def test_a_problem_file_states_it(tmp_path):
    text = """
    waypoints = [[0, 0], [30, 40]]
    units.waypoints = "deg"
    units.limits = "deg"
    [limits]
    velocity = [90, 90]
    acceleration = [180, 180]
    [limits.falling_velocity]
    offset = [18, 0]
    deceleration = [360, inf]
    position = [[-150, 160], [-inf, inf]]
    """
    file = tmp_path / "arm.toml"
    file.write_text(text)
    problem = Problem.from_toml(file)
    (row, none) = problem.limits.kinds["falling_velocity"].numbers
    assert row == pytest.approx(np.radians([18, 360, -150, 160]), rel=1e-15)
    assert np.isnan(none).all()
    file.write_text(problem.to_toml())
    assert Problem.from_toml(file) == problem
    assert "falling_velocity" not in problem.only([1]).limits.kinds
    words = [own.of_joint(0, problem) for own in problem.limits.kinds.values()]
    assert words[:2] == ["± 1.5708 rad/s", "± 3.14159 rad/s²"]
    assert words[2] == "√(2 · 6.28319 · w) − 0.314159 rad/s, w to -2.61799 or 2.79253"
    assert problem.limits.kinds["falling_velocity"].of_joint(1, problem) == "–"


def test_the_fr3_s_own_numbers_are_libfranka_s():
    numbers = arm_file.read("franka-fr3").limits.kinds["falling_velocity"].numbers
    # rate_limiting.h: -0.20 + sqrt(5.17 (1.79180 - q)), 0.35 - sqrt(11 (-0.54092 + q))
    assert numbers[1] == pytest.approx([0.20, 5.17 / 2, -1.7918, 1.79180], rel=1e-15)
    assert numbers[5, :3] == pytest.approx([0.35, 11 / 2, 0.54092], rel=1e-15)
    assert len(numbers) == 7
    assert "falling_velocity" not in arm_file.read("franka-panda").limits.kinds
    assert catalogue.load("robots-franka-fr3-w4").has("falling_velocity")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"offset": [-1]}, "falling_velocity.offset, joint 1 is -1"),
        ({"offset": ["1"]}, "a number per joint"),
        ({"offset": [0.1, 0.1]}, "1 values"),
        ({"offset": None}, "a number per joint"),
        ({"deceleration": [0]}, "falling_velocity.deceleration, joint 1 is 0"),
        ({"deceleration": [-np.inf]}, "a positive number"),
        ({"position": [[1, -2]]}, "lower below upper"),
        ({"position": [[-np.inf, 1]]}, "a finite range"),
        ({"position": [1]}, "a pair"),
        ({"speed": [1]}, "falling_velocity.speed"),
    ],
)
def test_what_is_no_such_limit_is_refused(changes, words):
    with pytest.raises(InvalidInput, match=words):
        Limits([1.0], [1.0], falling_velocity={**NEAR, **changes})
    with pytest.raises(InvalidInput, match="a table with offset"):
        Limits([1.0], [1.0], falling_velocity=[1.0])


def test_a_file_says_the_robot_s_own_or_none(tmp_path):
    text = """
    robot = "franka-fr3"
    joint_names = ["fr3_joint1", "fr3_joint6"]
    waypoints = [[0, 90], [30, 100]]
    units.waypoints = "deg"
    [limits]
    """
    file = tmp_path / "arm.toml"
    file.write_text(text + "falling_velocity = true")
    own = Problem.from_toml(file)
    file.write_text(text)
    assert Problem.from_toml(file) == own
    assert own.limits.kinds["falling_velocity"].numbers[1, 2] == 0.54092
    file.write_text(text + "falling_velocity = false")
    assert Problem.from_toml(file) == own.without("falling_velocity")
    other = text.replace("franka-fr3", "franka-panda").replace("fr3_joint", "panda_joint")
    file.write_text(other + "falling_velocity = true")
    with pytest.raises(InvalidInput, match="of the robot, but franka-panda has none"):
        Problem.from_toml(file)
    file.write_text(
        "waypoints = [[0], [1]]\n angle_unit = 'rad'\n [limits]\n velocity = [1]\n"
        "acceleration = [1]\n falling_velocity = true"
    )
    with pytest.raises(InvalidInput, match="true is the one beside a robot"):
        Problem.from_toml(file)


@pytest.mark.parametrize("key", ["position_based_velocity_limits", "velocity_offset"])
def test_franka_s_own_words_are_answered_with_ours(key):
    assert "limits.falling_velocity" in out_of_scope(key)


def test_a_figure_s_edge_is_what_is_allowed_along_the_motion():
    limit = falling(0.3, 6.0, -2.7501, 2.7501)
    motion = pieces([0, 1.0], [2.0, 0.5])
    times = np.linspace(0, 1, 9)
    ((place, (low, high)),) = limit.edges(motion, times).items()
    assert place == (1, 0)
    assert (2.0 / high) == pytest.approx(limit.along(motion, times)[0], rel=1e-12)
    assert (low <= -1).all()
    assert limit.edges(pieces([0, 1.0], [0.0, 3.0]), times)[1, 0][1].tolist() == [0.0] * 9
