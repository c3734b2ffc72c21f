"""Kinds of limits that state their numbers and rows: files, judging, dilation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from tests.kinds import Power, SpeedsTogether, TipSpeed, Torque
from trajopt import Limits, Problem, Trajectory, verify
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import Quantity
from trajopt.core.limits.enclosures import Enclosure
from trajopt.core.limits.rows import positive

pytestmark = pytest.mark.usefixtures("strangers")

LINKS = {"links": [0.6, 0.4], "speed": 0.5}


def motion(joints: int, pieces: int = 3, seed: int = 0, degree: int = 5) -> Trajectory:
    """Return random polynomials, continuous or not."""
    rng = np.random.default_rng(seed)
    breaks = np.append(0.0, np.cumsum(rng.uniform(0.5, 2.0, pieces)))
    return Trajectory(breaks, rng.normal(size=(degree + 1, pieces, joints)), breaks[[0, -1]])


def formula(x, y):
    return (
        np.cos(x) * y**3
        + np.sin(y) / (2 + np.square(x))
        - positive(x - y, 1e-3)
        + np.sqrt(1 + x * x)
        + np.minimum(x, abs(y))
        - np.maximum(2 * x, -y)
    )


@pytest.mark.parametrize("seed", range(5))
def test_enclosures_hold_everywhere_and_are_of_second_order(seed):
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=(2, 4))
    at = np.linspace(-1, 1, 1001)
    errors = []
    for half in (1.0, 0.1, 0.01, 0.001):
        scaled = coefficients * half ** np.arange(3, -1, -1.0)
        found = formula(*(Enclosure.of_polynomial(own[:, None]) for own in scaled))
        exact = formula(*(np.polyval(own, at) for own in scaled))
        low, high = found.values
        assert (low <= exact + 1e-13).all()
        assert (high >= exact - 1e-13).all()
        assert found.middle == pytest.approx(exact[500], abs=1e-13)
        errors.append(float((high - low)[0] - np.ptp(exact)))
    assert errors[3] < 0.02 * errors[2] < 0.02 * 0.05 * errors[1]


def test_what_has_no_bounds_says_so():
    with pytest.raises(TypeError, match="log"):
        np.log(Enclosure.of_polynomial(np.ones((2, 1))))


@pytest.mark.parametrize("kind", [TipSpeed, Power, SpeedsTogether, Torque])
@pytest.mark.parametrize("seed", range(3))
def test_the_worst_use_is_that_of_dense_samples(kind, seed):
    own = motion(2, seed=seed)
    numbers = np.full((2, sum(field.columns for field in kind.fields)), 0.7)
    limit = kind(numbers)
    use = limit.worst(own)
    shares = np.linspace(1e-12, 1 - 1e-12, 20_001)  # a derivative may jump at a break
    times = np.concatenate(
        [start + shares * length for start, length in zip(own.breaks, own.lengths, strict=False)]
    )
    sampled = limit.along(own, times)[None]
    assert use.value >= sampled.max() * (1 - 1e-12) - 1e-12
    assert use.value <= sampled.max() * (1 + 1e-6)
    assert limit.along(own, np.array([use.time]))[None] == pytest.approx(use.value, rel=1e-6)


def test_a_tool_at_its_limit_all_the_time_is_judged_exactly():
    """One joint turns steadily: the tool's speed is the length times the rate."""
    steady = Trajectory(
        [0.0, 1.0, 3.0], np.tile([[[0.8, 0.0]], [[0.0, 0.3]]], (1, 2, 1)), [0.0, 3.0]
    )
    limit = TipSpeed(np.array([[0.5, 0.4], [0.0, 0.4]]))
    assert limit.worst(steady).value == pytest.approx(1.0, abs=3e-8)
    assert limit.dilation(limit.worst(steady), steady) == pytest.approx(1.0, abs=3e-8)


def test_a_dilation_sees_gravity():
    """At 0 rad with 6 rad/s², gravity 5 and torque 8: 6 / k² + 5 = 8."""
    limit = Torque(np.array([[5.0, 8.0]]))
    short = Trajectory([0.0, 1e-6], [[[3.0]], [[0.0]], [[0.0]]], [0.0, 1e-6])
    use = limit.worst(short)
    assert use.value == pytest.approx(11 / 8, rel=3e-8)
    assert limit.dilation(use, short) == pytest.approx(np.sqrt(2), rel=1e-7)
    slow = short.dilated(10.0)
    assert limit.dilation(limit.worst(slow), slow) == pytest.approx(np.sqrt(2) / 10, rel=1e-7)
    weak = Torque(np.array([[5.0, 4.0]]))
    assert weak.dilation(weak.worst(short), short) == np.inf
    problem = Problem(
        [[0.0], [1.0]], Limits([9], [9], pendulum_torque={"gravity": [5.0], "torque": [4.0]})
    )
    h = 1.0
    smooth = Trajectory(
        [0.0, 2.0], np.array([-2 * h / 8, 3 * h / 4, 0, 0])[:, None, None], [0.0, 2.0]
    )
    certificate = verify(problem, smooth)
    assert certificate.certified_duration is None
    assert not certificate.feasible


def test_active_intervals_have_exact_ends():
    """v = 6 s (1 − s) rad/s is above 0.9 · 1.4 rad/s between two roots."""
    one = Trajectory(
        [0.0, 1.0], np.array([-2.0, 3.0, 0.0, 0.0])[:, None, None] * [1.0, 0.0], [0, 1]
    )
    limit = SpeedsTogether(np.array([[1.4], [1.4]]))
    (found,) = limit.active(one, 0.9)
    start = brentq(lambda s: 6 * s * (1 - s) - 0.9 * 1.4, 0, 0.5)
    assert (found.start, found.end) == (
        pytest.approx(start, abs=1e-12),
        pytest.approx(1 - start, abs=1e-12),
    )
    assert found.joint is None


TEXT = """
name = "two links"
angle_unit = "deg"
waypoints = [[0, 20], [40, 60]]
[limits]
velocity = [180, 180]
acceleration = [600, 600]
tip_speed = { links = [0.6, 0.4], speed = 0.5 }
pendulum_torque = { gravity = [5.0, 6.0], torque = [8.0, 9.0] }
motor_power = { power = [4000.0, 5000.0] }
"""


def test_a_file_states_the_fields(tmp_path):
    file = tmp_path / "two.toml"
    file.write_text(TEXT)
    problem = Problem.from_toml(file)
    kinds = problem.limits.kinds
    assert kinds["tip_speed"].column("links").tolist() == [0.6, 0.4]  # metres have no angle
    assert kinds["tip_speed"].column("speed").tolist() == [0.5, 0.5]
    assert kinds["motor_power"].numbers[:, 0] == pytest.approx(
        np.radians(1) ** 2 * np.array([4e3, 5e3])
    )
    file.write_text(problem.to_toml())
    again = Problem.from_toml(file)
    assert again == problem
    assert again.digest() == problem.digest()
    wider = problem.limits.widened("tip_speed", None, 0.01).kinds["tip_speed"]
    assert wider.numbers.tolist() == [[0.6, 0.505], [0.4, 0.505]]


@pytest.mark.parametrize(
    ("stated", "said"),
    [
        ("links = [0.6, 0.4]", "limits.tip_speed"),
        ("links = [0.6], speed = 0.5", "2 values, a number per joint"),
        ('links = [0.6, "a"], speed = 0.5', "joint 2"),
        ("links = [0.6, 0.4], speed = [0.5, 0.5]", "a number"),
        ("links = [0.6, 0.4], speed = 0.5, colour = 1", "colour"),
    ],
)
def test_a_wrong_field_is_named(stated, said, tmp_path):
    file = tmp_path / "two.toml"
    file.write_text(TEXT.replace("links = [0.6, 0.4], speed = 0.5", stated))
    with pytest.raises(InvalidInput) as error:
        Problem.from_toml(file)
    assert said in str(error.value)


def test_units_follow_the_declared_powers():
    limit = Power(np.array([[4.0]]))
    assert limit.in_units(2.0, 0.5).numbers.tolist() == [[4.0 * 2**3 / 0.5**2]]
    pair = Quantity("range", length=1, pair=True, common=True)
    assert pair.read("range", [-1, 2], 2).tolist() == [[-1, 2], [-1, 2]]
    assert pair.written(pair.read("range", [-1, 2], 2)) == [-1, 2]


def test_a_joint_without_the_limit_is_not_bounded():
    numbers = np.array([[4.0], [np.nan]])
    limits = Limits([1, 1], [2, 2], motor_power=Power(numbers))
    problem = replace(Problem([[0.0, 0.0], [1.0, 1.0]], limits))
    assert problem.limits.kinds["motor_power"].bounds.tolist() == [True, False]
    assert "motor_power" not in problem.only([1]).limits.kinds
