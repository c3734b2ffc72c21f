"""What pages include: the gallery draws, the ROS 2 guard refuses, the workflow judges."""

from __future__ import annotations

import asyncio
import json
import os
import re
import runpy
import shutil
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from unittest.mock import AsyncMock, MagicMock

import matplotlib as mpl
import pytest
import yaml

DOCS = Path(__file__).parents[1] / "docs"
ROS = DOCS / "examples" / "ros2"
GALLERY = sorted((DOCS / "gallery").glob("plot_*.py"))


@pytest.mark.parametrize("script", GALLERY, ids=lambda path: path.stem)
def test_an_example_runs_and_draws(script, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    mpl.use("Agg")
    from matplotlib import pyplot as plt

    runpy.run_path(str(script), run_name="__main__")
    assert plt.get_fignums()
    plt.close("all")


@pytest.mark.long
def test_the_notebook_runs_without_a_warning(tmp_path, monkeypatch):
    """Warnings are errors here."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("matplotlib.pyplot.show", lambda: None)
    mpl.use("Agg")
    cells = json.loads((DOCS / "notebook.ipynb").read_text(encoding="utf-8"))["cells"]
    names = {"__name__": "__main__"}
    for cell in cells:
        if cell["cell_type"] == "code":
            exec("".join(cell["source"]), names)
    assert len(names["results"].items) == 4 + 1 + 3  # planners, the reference, seeds of ISSA


def goal(duration):
    """Return a goal of two joints that move by 0.2 rad in so many seconds."""
    points = []
    for share, velocity in [(0.0, 0.0), (0.5, 0.1), (1.0, 0.0)]:
        time = share * duration
        stamp = {"sec": int(time), "nanosec": round(1e9 * (time % 1))}
        positions = [0.2 * share, -0.2 * share]
        point = {"positions": positions, "velocities": [velocity, -velocity]}
        points.append(point | {"time_from_start": stamp})
    return {"trajectory": {"joint_names": ["joint2", "joint1"], "points": points}}


@pytest.fixture
def node(monkeypatch):
    """The node's module, run beside stand-ins for ROS, and what its node logs and serves."""
    ros = defaultdict(MagicMock)
    packages = ("rclpy", "rclpy.action", "rclpy.node", "rosidl_runtime_py")
    messages = ("action_msgs.msg", "control_msgs.action")
    for name in packages + messages:
        monkeypatch.setitem(sys.modules, name, ros[name])
    ros["rclpy.node"].Node = type("Node", (), {"__init__": lambda self, name: None})
    ros["rclpy.node"].Node.get_logger = ros["logger"]
    ros["rosidl_runtime_py"].message_to_ordereddict = lambda message: message
    monkeypatch.syspath_prepend(ROS)
    runpy.run_path(str(ROS / "guard_node.py"))
    monkeypatch.delitem(sys.modules, "guard")
    return ros


def test_the_node_forwards_what_keeps_limits_and_rejects_the_rest(node):
    [guard] = node["rclpy"].spin.call_args.args
    answers = node["rclpy.action"].GoalResponse
    assert guard.judge(goal(2.0)) == answers.ACCEPT
    assert not node["logger"]().error.called
    assert guard.judge(goal(0.2)) == answers.REJECT
    said = node["logger"]().error.call_args.args[0]
    # 0.2 rad in 0.2 s, at rest at both ends: cubic pieces, 0.1 rad in 0.1 s up to 0.1 rad/s
    assert said == "refused: joint1 reaches 11.600 of its acceleration limit at 0.000 s"
    assert guard.judge({"trajectory": {"joint_names": [], "points": []}}) == answers.REJECT
    assert "joint_names" in node["logger"]().error.call_args.args[0]


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"multi_dof_trajectory": {"points": [{}]}}, "multi_dof_trajectory"),
        ({"trajectory": goal(2.0)["trajectory"] | {"joint_names": ["q1", "q2"]}}, "['q1', 'q2']"),
    ],
)
def test_the_node_rejects_what_it_cannot_judge(node, change, word):
    [guard] = node["rclpy"].spin.call_args.args
    assert guard.judge(goal(2.0) | change) == node["rclpy.action"].GoalResponse.REJECT
    assert word in node["logger"]().error.call_args.args[0]


@pytest.mark.parametrize(
    ("accepted", "status", "asked", "ended"),
    [
        (True, "STATUS_SUCCEEDED", False, "succeed"),
        (True, "STATUS_ABORTED", False, "abort"),
        (True, "STATUS_CANCELED", True, "canceled"),
        (True, "STATUS_CANCELED", False, "abort"),
        (False, None, False, "abort"),
    ],
)
def test_the_node_ends_a_goal_as_the_controller_does(node, accepted, status, asked, ended):
    [guard] = node["rclpy"].spin.call_args.args
    codes = node["action_msgs.msg"].GoalStatus
    done = MagicMock(result="done", status=status and getattr(codes, status))
    sent = MagicMock(accepted=accepted, get_result_async=AsyncMock(return_value=done))
    guard.client.send_goal_async = AsyncMock(return_value=sent)
    handle = MagicMock(request="goal", is_cancel_requested=asked)
    handle.goal_id.uuid = b"0123456789abcdef"
    result = asyncio.run(guard.forward(handle))
    assert (result == "done") == accepted
    guard.client.send_goal_async.assert_called_once_with("goal")
    getattr(handle, ended).assert_called_once_with()
    assert sent.cancel_goal_async.called == asked
    assert not guard.running


def test_the_node_passes_a_cancel_on(node):
    [guard] = node["rclpy"].spin.call_args.args
    sent = MagicMock()
    guard.running[b"a"] = sent
    handle = MagicMock()
    handle.goal_id.uuid = b"a"
    assert guard.cancel(handle) == node["rclpy.action"].CancelResponse.ACCEPT
    sent.cancel_goal_async.assert_called_once_with()


@pytest.mark.parametrize("kept", [True, False])
def test_the_workflow_fails_where_a_motion_breaks_limits(tmp_path, kept):
    page = (DOCS / "how-to" / "github-action.md").read_text(encoding="utf-8")
    workflow, *_ = re.findall(r"```yaml\n(.*?)```", page, re.S)
    script = yaml.safe_load(workflow)["jobs"]["judge"]["steps"][-1]["run"]
    motions = DOCS / "examples" / "motions"
    (tmp_path / "motions").mkdir()
    shutil.copy(motions / "sent.yaml", tmp_path / "motions")
    limits = (motions / "joint_limits.yaml").read_text(encoding="utf-8")
    if kept:
        limits = limits.replace("!degrees ", "!degrees 9")
    (tmp_path / "joint_limits.yaml").write_text(limits, encoding="utf-8")
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    shell = ["bash", "-e", "-c", script]
    done = subprocess.run(shell, cwd=tmp_path, env=os.environ | {"PATH": path}, check=False)
    assert done.returncode == (0 if kept else 1)
