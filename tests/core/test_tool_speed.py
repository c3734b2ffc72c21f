"""Speed of a tool: against Pinocchio, along a line in closed form, and as files state it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.along.planner import Along
from baselines.lower_bound.planner import Prove
from soaks import arms
from trajopt import Limits, Problem, Trajectory
from trajopt.best_planner import best
from trajopt.cli.best_words import sentences
from trajopt.core import arm_file
from trajopt.core.chain import LinkChain
from trajopt.core.exceptions import InvalidInput
from trajopt.core.limits import ToolSpeed
from trajopt.core.solution import Status
from trajopt.judging.verification import verify
from trajopt.planners.testing_limits import check_limit

# Two links, 0.6 m and 0.4 m: sin and cos of both angles give the tool's place.
TWO_LINKS = """name = "two links"
angle_unit = "deg"
waypoints = [[0, 20], [40, 60], [90, 30], [120, 80]]
limits.velocity = [180, 180]
limits.acceleration = [600, 600]
limits.tool_speed = 0.5
chain.xyz = [[0, 0, 0], [0.6, 0, 0]]
chain.rpy = [[0, 0, 0], [0, 0, 0]]
chain.axis = [[0, 0, 1], [0, 0, 1]]
chain.tool_xyz = [0.4, 0, 0]
"""


def gantry(tool: float, **demands) -> Problem:
    """A tool on two rails, at right angles: from (0, 0) to (0.6, 0.8) m."""
    chain = LinkChain(np.tile(np.eye(4), (2, 1, 1)), np.eye(3)[:2], np.ones(2, dtype=bool))
    limits = Limits([10.0, 10.0], [3.0, 4.0], tool_speed=tool)
    return Problem(
        [[0.0, 0.0], [0.6, 0.8]], limits, joint_units=["m", "m"], chain=chain, demands=demands
    )


def test_a_line_at_constant_tool_speed_takes_its_closed_form():
    """1 m with 5 m/s² along the line, at most 0.5 m/s: `d/v + v/a`."""
    problem = gantry(0.5)
    found = Along().solve(problem)
    certificate = verify(problem, found.trajectory)
    assert certificate.certified_duration == pytest.approx(1 / 0.5 + 0.5 / 5, rel=1e-4)


def test_a_steady_speed_is_judged_exactly():
    """Half a metre in 2 s, straight; and one joint of 0.3 m that turns at 2 rad/s."""
    line = Trajectory([0.0, 2.0], [[[0.15, 0.2]], [[0.0, 0.0]]], [0.0, 2.0])
    limit = gantry(0.5).limits.kinds["tool_speed"]
    use = limit.worst(line)
    assert use.value == pytest.approx(0.25 / 0.5, rel=2e-8)
    assert limit.dilation(use, line) == use.value
    tool = np.eye(4)
    tool[0, 3] = 0.3
    chain = LinkChain([np.eye(4)], [[0.0, 0.0, 1.0]], [False], tool)
    turning = ToolSpeed.read(1.0, 1).for_chain(chain)
    motion = Trajectory([0.0, 5.0], [[[2.0]], [[1.0]]], [0.0, 5.0])
    assert turning.worst(motion).value == pytest.approx(0.6, rel=2e-8)


@pytest.mark.parametrize("seed", range(4))
def test_random_arms_move_as_in_pinocchio(seed):
    """Turning and sliding joints about any axes: the speed everywhere, and its peak."""
    apart, above = arms.tried(seed)
    assert apart < 1e-13
    # the peak is the largest of 2,000 samples, or a little more between two of them
    assert -1e-12 <= above < 1e-6


def test_the_tool_moves_as_the_derivative_of_its_place():
    for name in arm_file.arm_files():
        chain = arm_file.read(name).chain
        if chain is None:
            continue
        rng = np.random.default_rng(1)
        q, v = rng.normal(size=(2, chain.joints, 7))
        place, speed = chain.moving(chain.tool_point, list(q), list(v))
        moved = chain.forward((q + 1e-30j * v).T)[:, :3, 3]
        np.testing.assert_allclose(np.transpose(place), moved.real, atol=1e-14)
        np.testing.assert_allclose(np.transpose(speed), moved.imag / 1e-30, atol=1e-13)


def test_a_file_states_a_number_and_keeps_the_frames(tmp_path):
    file = tmp_path / "links.toml"
    file.write_text(TWO_LINKS, encoding="utf-8")
    problem = Problem.from_toml(file)
    limit = problem.limits.kinds["tool_speed"]
    assert isinstance(limit, ToolSpeed)
    # the chords: of both links as complex numbers, 4.4411 s together
    angles = np.cumsum(problem.waypoints, axis=1)
    tips = 0.6 * np.exp(1j * angles[:, 0]) + 0.4 * np.exp(1j * angles[:, 1])
    np.testing.assert_allclose(limit.least_times(problem), abs(np.diff(tips)) / 0.5, rtol=1e-11)
    (tmp_path / "again.toml").write_text(problem.to_toml(), encoding="utf-8")
    again = Problem.from_toml(tmp_path / "again.toml")
    assert again.digest() == problem.digest()
    assert again.chain is None
    check_limit(limit)


def test_the_least_time_of_a_segment_knows_no_tolerance():
    assert gantry(0.5).limits.kinds["tool_speed"].least_times(gantry(0.5)) == pytest.approx([2.0])
    loose = gantry(0.5)
    rows = [[0.0, 0.0], [0.3, 0.4], [0.6, 0.8], [0.0, 0.8]]
    loose = Problem(rows, loose.limits, tolerance=[[0, 0], [0.01, 0.0], [0, 0], [0, 0]])
    times = loose.limits.kinds["tool_speed"].least_times(loose)
    assert times == pytest.approx([0.0, 0.0, 1.2])


@pytest.mark.parametrize(
    ("changes", "key", "right"),
    [
        ({"= 0.5\n": "= 0\n"}, "limits.tool_speed", "a positive number, m/s"),
        ({"= 0.5\n": "= -0.5\n"}, "limits.tool_speed", "a positive number, m/s"),
        ({"= 0.5\n": '= "fast"\n'}, "limits.tool_speed", "a number, or a table with speed"),
        ({"chain.": "# chain."}, "limits.tool_speed", "the link frames of all joints"),
        ({"chain.rpy": "# chain.rpy"}, "chain.rpy", "it is missing"),
        ({"[0.6, 0, 0]]": "[0.6, 0]]"}, "chain.xyz", "three finite numbers per joint of 2"),
        ({"[0, 0, 1]]": "[0, 0, 0]]"}, "chain.axis", "a direction"),
        ({"chain.tool_xyz": "chain.flange_xyz"}, "chain.flange_xyz", "xyz"),
    ],
)
def test_a_file_that_is_wrong_gets_a_line(tmp_path, changes, key, right):
    text = TWO_LINKS
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / "links.toml"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(InvalidInput) as caught:
        Problem.from_toml(file)
    message = str(caught.value)
    assert caught.value.key == key
    assert right in message
    assert "\n" not in message
    assert str(file) in message


def test_frames_that_are_no_frames_get_a_line():
    stated = gantry(0.5).limits.kinds["tool_speed"].table()
    twice = [2 * number for number in stated["origins"][1]]
    with pytest.raises(InvalidInput, match=r"tool_speed\.origins, joint 2"):
        ToolSpeed.read({**stated, "origins": [stated["origins"][0], twice]}, 2)
    with pytest.raises(InvalidInput, match=r"tool_speed\.axes, joint 1"):
        ToolSpeed.read({**stated, "axes": [[0, 0, 2], [0, 1, 0]]}, 2)
    with pytest.raises(InvalidInput, match="a list of 12 numbers per joint"):
        ToolSpeed.read({**stated, "origins": [[1], [1]]}, 2)
    assert not ToolSpeed.read(np.inf, 2).bounds.any()


def test_a_bound_knows_the_chords_and_its_proof_is_checked_again():
    """The gantry's least time is 2.1 s; its chord takes 2 s, without the limit it is 0.89 s."""
    problem = gantry(0.5)
    prover = Prove()
    found = prover.solve(problem)
    assert found.status is Status.RELAXED
    assert "but for the least times of segments" in found.message
    assert 2 * (1 - 2e-4) <= found.lower_bound <= 2.1
    assert prover.stored_bound(problem, found.stats) == pytest.approx(found.lower_bound, rel=1e-9)
    slower = replace(problem, demands={"given_times": [3.0]})
    assert prover.solve(slower).lower_bound <= 3.0


def test_a_planner_that_takes_long_is_stopped_and_a_path_is_timed(tmp_path):
    file = tmp_path / "links.toml"
    file.write_text(TWO_LINKS, encoding="utf-8")
    problem = Problem.from_toml(file)
    steps = []
    found = best(problem, 0, tell=steps.append, timeout=0.001)
    assert found.trial.planner == "along"
    assert found.proved == pytest.approx(
        problem.limits.others["tool_speed"].least_times(problem).sum()
    )
    duration = verify(problem, Along().solve(problem).trajectory).certified_duration
    assert found.trial.certified_duration == pytest.approx(duration, rel=1e-9)
    assert any("collocation-refined looks for less, which may take minutes" in own for own in steps)
    said = " ".join(sentences(found))
    assert "collocation-refined was stopped after 0.001 s (`--timeout`)" in said
